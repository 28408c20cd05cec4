"""A stage with a small kitchen and its face at a hub, and clients for it; all are closed afterwards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from mindstage.bridge import Client, Hub, Server
from mindstage.engines import MujocoEngine
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.ros import RosFace
from mindstage.stage import Stage
from tests.bridge.talking import PATIENCE_S, Talker
from tests.kitchenette import kitchenette

from .asking import Ask, Call, asking


@pytest.fixture(scope="session")
def knowledge() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        yield knowledge


@pytest.fixture
def empty_stage(knowledge: KnowledgeBase) -> Iterator[Stage]:
    with Stage(knowledge, MujocoEngine()) as stage:
        yield stage


@pytest.fixture
def stage(empty_stage: Stage) -> Stage:
    assert empty_stage.spawn(kitchenette()).ok
    return empty_stage


@pytest.fixture
def hub() -> Iterator[Hub]:
    with Hub() as hub:
        yield hub


@pytest.fixture
def server(hub: Hub) -> Iterator[Server]:
    with Server(hub, port=0) as server:
        yield server


@pytest.fixture
def face(stage: Stage, hub: Hub) -> Iterator[RosFace]:
    with RosFace(stage, hub) as face:
        yield face


@pytest.fixture
def call(face: RosFace, hub: Hub) -> Call:
    """Calls a service under the namespace, or one from the root."""

    def call(service: str, /, **args: Any) -> Any:
        place = service if service.startswith("/") else f"/unreal/{service}"
        return hub.call_service(place, args, timeout_s=PATIENCE_S)

    return call


@pytest.fixture
def ask(call: Call) -> Ask:
    """Asks a question by its own service."""
    return asking(call)


@pytest.fixture
def client(server: Server, face: RosFace) -> Iterator[Client]:
    """Ours, over a socket."""
    with Client(server.url) as client:
        yield client.wait_connected(PATIENCE_S)


@pytest.fixture
def talker(server: Server, face: RosFace) -> Iterator[Callable[[], Talker]]:
    """Makes bare clients that say what they want."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(closing(Talker(server.url)))
