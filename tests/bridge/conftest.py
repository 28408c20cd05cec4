"""A hub with a server on a free port, and clients for it; all are closed afterwards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from tests.bridge.talking import TIMEOUT_S, RawClient


@pytest.fixture
def hub() -> Iterator[LocalNode]:
    with LocalNode() as hub:
        yield hub


@pytest.fixture
def server(hub: LocalNode) -> Iterator[RosbridgeServer]:
    with RosbridgeServer(hub, port=0) as server:
        yield server


@pytest.fixture
def talker(server: RosbridgeServer) -> Iterator[Callable[..., RawClient]]:
    """Makes bare clients."""
    with ExitStack() as stack:
        yield lambda url=None, **options: stack.enter_context(closing(RawClient(url or server.url, **options)))


@pytest.fixture
def client(server: RosbridgeServer) -> Iterator[Callable[..., RosbridgeClient]]:
    """Makes our own clients."""
    with ExitStack() as stack:

        def make(url: str | None = None, **options: Any) -> RosbridgeClient:
            return stack.enter_context(RosbridgeClient(url or server.url, **options)).wait_connected(TIMEOUT_S)

        yield make
