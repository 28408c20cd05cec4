"""A stage with a small kitchen and its face at a hub, and clients for it; all are closed afterwards."""

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
from tests.bridge.talking import TIMEOUT_S, RawClient
from tests.kitchenette import kitchenette
from tests.ros.asking import Ask, Call, question_caller


@pytest.fixture(scope="session")
def knowledge() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        yield knowledge


@pytest.fixture
def empty_stage(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine()) as stage:
        yield stage


@pytest.fixture
def stage(empty_stage: Simulation) -> Simulation:
    assert empty_stage.spawn(kitchenette()).ok
    return empty_stage


@pytest.fixture
def hub() -> Iterator[LocalNode]:
    with LocalNode() as hub:
        yield hub


@pytest.fixture
def server(hub: LocalNode) -> Iterator[RosbridgeServer]:
    with RosbridgeServer(hub, port=0) as server:
        yield server


@pytest.fixture
def face(stage: Simulation, hub: LocalNode) -> Iterator[RosInterface]:
    with RosInterface(stage, hub) as face:
        yield face


@pytest.fixture
def call(face: RosInterface, hub: LocalNode) -> Call:
    """Calls a service under the namespace, or one from the root."""

    def call(service: str, /, **args: Any) -> Any:
        place = service if service.startswith("/") else f"/unreal/{service}"
        return hub.call_service(place, args, timeout_s=TIMEOUT_S)

    return call


@pytest.fixture
def ask(call: Call) -> Ask:
    """Asks a question by its own service."""
    return question_caller(call)


@pytest.fixture
def client(server: RosbridgeServer, face: RosInterface) -> Iterator[RosbridgeClient]:
    """Ours, over a socket."""
    with RosbridgeClient(server.url) as client:
        yield client.wait_connected(TIMEOUT_S)


@pytest.fixture
def talker(server: RosbridgeServer, face: RosInterface) -> Iterator[Callable[[], RawClient]]:
    """Makes bare clients that say what they want."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(closing(RawClient(server.url)))
