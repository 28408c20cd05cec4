"""A hub with a server on a free port, and clients for it; all are closed afterwards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from mindstage.bridge import Client, Hub, Server

from .talking import PATIENCE_S, Talker


@pytest.fixture
def hub() -> Iterator[Hub]:
    with Hub() as hub:
        yield hub


@pytest.fixture
def server(hub: Hub) -> Iterator[Server]:
    with Server(hub, port=0) as server:
        yield server


@pytest.fixture
def talker(server: Server) -> Iterator[Callable[..., Talker]]:
    """Makes bare clients."""
    with ExitStack() as stack:
        yield lambda url=None, **options: stack.enter_context(closing(Talker(url or server.url, **options)))


@pytest.fixture
def client(server: Server) -> Iterator[Callable[..., Client]]:
    """Makes our own clients."""
    with ExitStack() as stack:

        def make(url: str | None = None, **options: Any) -> Client:
            return stack.enter_context(Client(url or server.url, **options)).wait_connected(PATIENCE_S)

        yield make
