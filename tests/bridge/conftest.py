"""A local node with a server on a free port, and clients for it; all are closed after the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from tests.bridge.certificates import certificates
from tests.bridge.raw_client import TIMEOUT_S, RawClient

__all__ = ["certificates"]


@pytest.fixture
def local_node() -> Iterator[LocalNode]:
    with LocalNode() as local_node:
        yield local_node


@pytest.fixture
def server(local_node: LocalNode) -> Iterator[RosbridgeServer]:
    with RosbridgeServer(local_node, port=0) as server:
        yield server


@pytest.fixture
def make_raw_client(server: RosbridgeServer) -> Iterator[Callable[..., RawClient]]:
    """Creates raw clients."""
    with ExitStack() as stack:
        yield lambda url=None, **options: stack.enter_context(closing(RawClient(url or server.url, **options)))


@pytest.fixture
def client(server: RosbridgeServer) -> Iterator[Callable[..., RosbridgeClient]]:
    """Creates clients."""
    with ExitStack() as stack:

        def make(url: str | None = None, **options: Any) -> RosbridgeClient:
            return stack.enter_context(RosbridgeClient(url or server.url, **options)).wait_connected(TIMEOUT_S)

        yield make
