"""Sockets: our own doors in viser's web server, at the one port that both share.

viser serves its page and its websocket by one call of `websockets.asyncio.server.serve`. While one of our servers is
being made, that call goes through here: the gate judges each request first, our own paths are answered by us, and the
rest is viser's. Nothing else of viser is touched, and a server whose doors were not put in is never opened.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Protocol

from viser.infra import _infra as _viser

from mindstage.viewport.gate import CHANNEL, HttpResponse, RequestFilter, request_path
from mindstage.viewport.viewpage import ViserPage

__all__ = ["ConnectionClosed", "HttpRoutes", "WebSocket", "patched_viser"]

_infra: Any = _viser  # what it imports is not exported
ConnectionClosed: type[Exception] = _infra.websockets.exceptions.ConnectionClosed
_serve = _infra.websockets.asyncio.server.serve
_patch_lock = threading.Lock()
_handshake_log = logging.getLogger("mindstage.viewport.handshakes")
_handshake_log.addHandler(logging.NullHandler())  # what strangers try is told to those who configured logging


class WebSocket(Protocol):
    """What is used of a websocket."""

    request: Any
    protocol: Any

    async def send(self, message: bytes, /, *, text: bool) -> None:
        """Sends a message when there is room for it."""

    async def recv(self) -> str | bytes:
        """Waits for the next message."""

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Says goodbye."""


class HttpRoutes:
    """Our side of the port."""

    def __init__(self, gate: RequestFilter, *, channel: Callable[[WebSocket], Awaitable[None]]) -> None:
        """The doors of one server.

        Args:
            gate: who may come in.
            channel: keeps a page's own websocket until it is closed.
        """
        self._filter, self._channel = gate, channel
        self._view: ViserPage | None = None
        self.patched = False
        """Whether a server has them."""

    def serve(self, handler: Callable[[Any], Awaitable[None]], *args: Any, **options: Any) -> Any:
        """Called by viser in place of `websockets.asyncio.server.serve`."""
        page = options["process_request"]

        async def handle(socket: Any) -> None:
            await (self._channel(socket) if request_path(socket.request.path) == CHANNEL else handler(socket))

        def process(socket: Any, request: Any) -> Any:
            return self._process(socket, request, page)

        self.patched = True
        return _serve(handle, *args, **options | {"process_request": process, "server_header": None, "logger": _handshake_log})

    def _process(self, socket: Any, request: Any, page: Callable[[Any, Any], Any]) -> Any:
        headers = request.headers
        if (headers.get("Upgrade") or "").lower() == "websocket":
            refusal = self._filter.socket_error(request.path, headers)
            return None if refusal is None else _response(socket, refusal)
        answer = self._filter.respond(request.path, headers)
        if answer is None:
            answer = self._view_answer(request, lambda plain: page(socket, plain))
        return _response(socket, answer)

    def _view_answer(self, request: Any, page: Callable[[Any], Any]) -> HttpResponse:
        """Viser's page, with our words in its head."""
        if self._view is None:
            plain = page(replace(request, path="/", headers=type(request.headers)()))
            self._view = ViserPage(plain.body)
        return self._view.answer(request.headers, self._filter.view_headers(request.headers))


def _response(socket: Any, answer: HttpResponse) -> Any:
    response = socket.respond(answer.status, "")
    response.body = answer.body
    for name in ("Content-Type", "Content-Length"):
        response.headers.pop(name, None)
    for name, value in answer.headers.items():
        response.headers[name] = value
    response.headers["Content-Length"] = str(len(answer.body))
    return response


class _ModuleProxy:
    """A module, but for some of its names."""

    def __init__(self, module: Any, **names: Any) -> None:
        self._module = module
        self.__dict__.update(names)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


@contextmanager
def patched_viser(routes: HttpRoutes) -> Iterator[None]:
    """Whatever server viser makes meanwhile has these doors."""
    with _patch_lock:
        library = _infra.websockets
        server = _ModuleProxy(library.asyncio.server, serve=routes.serve)
        _infra.websockets = _ModuleProxy(library, asyncio=_ModuleProxy(library.asyncio, server=server))
        try:
            yield
        finally:
            _infra.websockets = library
