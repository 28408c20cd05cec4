"""A simulation with a small kitchen, its ROS interface at a local node, and clients; all are closed after the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.engines import MujocoEngine
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient
from tests.kitchenette import kitchenette
from tests.ros.ros_messages import Ask, Call, question_caller


@pytest.fixture(scope="session")
def knowledge() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        yield knowledge


@pytest.fixture
def empty_simulation(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        yield simulation


@pytest.fixture
def simulation(empty_simulation: Simulation) -> Simulation:
    assert empty_simulation.spawn(kitchenette()).ok
    return empty_simulation


@pytest.fixture
def local_node() -> Iterator[LocalNode]:
    with LocalNode() as local_node:
        yield local_node


@pytest.fixture
def server(local_node: LocalNode) -> Iterator[RosbridgeServer]:
    with RosbridgeServer(local_node, port=0) as server:
        yield server


@pytest.fixture
def ros_interface(simulation: Simulation, local_node: LocalNode) -> Iterator[RosInterface]:
    with RosInterface(simulation, local_node) as ros_interface:
        yield ros_interface


@pytest.fixture
def call(ros_interface: RosInterface, local_node: LocalNode) -> Call:
    """Calls a service in the namespace, or one with an absolute name."""

    def call(service: str, /, **args: Any) -> Any:
        place = service if service.startswith("/") else f"/unreal/{service}"
        return local_node.call_service(place, args, timeout_s=TIMEOUT_S)

    return call


@pytest.fixture
def ask(call: Call) -> Ask:
    """Calls the service of a question."""
    return question_caller(call)


@pytest.fixture
def client(server: RosbridgeServer, ros_interface: RosInterface) -> Iterator[RosbridgeClient]:
    """A client, over a socket."""
    with RosbridgeClient(server.url) as client:
        yield client.wait_connected(TIMEOUT_S)


@pytest.fixture
def make_raw_client(server: RosbridgeServer, ros_interface: RosInterface) -> Iterator[Callable[[], RawClient]]:
    """Creates raw clients."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(closing(RawClient(server.url)))
