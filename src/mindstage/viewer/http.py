"""HTTP of the page: static files, and viser's page with added scripts, for requests that the gate lets in.

Paths are looked up in a fixed list of files, never on the disk.
"""

from __future__ import annotations

import gzip
import hashlib
import re
from collections.abc import Callable, Mapping
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import NamedTuple

import msgspec

from mindstage.access.gate import Denial, Gate, RequestHeaders
from mindstage.access.policies import CONTROL, READ, EntryKind, EntryPoint, Policy
from mindstage.access.visitors import Visitor
from mindstage.errors import RequestLimitError
from mindstage.textures.baking import content_version
from mindstage.textures.catalog import texture_names
from mindstage.textures.images import TextureMap, texture_jpeg

__all__ = [
    "CHANNEL",
    "STARTING",
    "HttpResponse",
    "RequestFilter",
    "StaticFile",
    "ViserPage",
    "page_files",
    "request_path",
    "view_key",
]


_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


class StaticFile(msgspec.Struct, frozen=True):
    """A file of the page."""

    type: str
    content: bytes
    etag: str
    """A hash of the content."""


@cache
def page_files() -> dict[str, StaticFile]:
    """All files of the page by name, read once."""
    found = {}
    # Wheels are unpacked on installation, so the folder exists.
    for path in Path(__file__).with_name("web").iterdir():
        if (type := _TYPES.get(path.suffix)) is not None:
            content = path.read_bytes()
            found[path.name] = StaticFile(type, content, f'"{hashlib.sha256(content).hexdigest()[:24]}"')
    return found


_TEXTURE = re.compile(r"/mindstage/textures/([a-z_]+)-(color|roughness|normal)-([0-9a-f]+)\.jpg")
_TEXTURE_PIXELS = 256
_FOREVER = "public, max-age=31536000, immutable"


def texture_path(name: str, map: TextureMap) -> str | None:
    """The path of an image of a texture, which has the version of its content; pages load each once."""
    return f"/mindstage/textures/{name}-{map}-{content_version()}.jpg"


def is_texture_path(path: str) -> bool:
    """Whether a request is for an image of a texture, which may have to be computed."""
    return _TEXTURE.fullmatch(request_path(path)) is not None


CHANNEL = "/mindstage/channel"
"""Path of the page's websocket."""

_VIEW = re.compile(r"/view/([a-z0-9]{8,40})/?")


class HttpResponse(msgspec.Struct, frozen=True):
    """The response to a request."""

    status: HTTPStatus
    body: bytes
    headers: Mapping[str, str]


STARTING = HttpResponse(
    HTTPStatus.SERVICE_UNAVAILABLE,
    b"starting\n",
    {"Content-Type": "text/plain; charset=utf-8", "Retry-After": "1", "Cache-Control": "no-store"},
)
"""The answer to all requests until the server is opened."""


def view_key(path: str) -> str | None:
    """The session key in the path of a view's page or websocket; None for any other path."""
    match = _VIEW.fullmatch(request_path(path))
    return match[1] if match else None


def request_path(path: str) -> str:
    """The path without the query; unlike `urlsplit`, two leading slashes do not start a host name."""
    return path.partition("?")[0]


class Route(NamedTuple):
    """A path of the page."""

    name: str
    pattern: re.Pattern[str]
    policy: Policy
    answer: Callable[[str, RequestHeaders], HttpResponse | None]
    """Called with the path and the headers; None leaves the response to viser."""


SOCKETS = ((CHANNEL, re.compile(re.escape(CHANNEL)), CONTROL), ("/view/KEY", _VIEW, CONTROL))
"""Name, pattern and policy of the paths of websockets."""


class RequestFilter:
    """Answers requests that the gate lets in, by path and headers. Does no I/O."""

    def __init__(self, gate: Gate) -> None:
        """Creates the filter.

        Args:
            gate: decides which requests are let in.
        """
        self.gate = gate
        self.routes = (
            Route("/", re.compile("/"), CONTROL, self._index),
            Route("/view/KEY", _VIEW, CONTROL, lambda path, headers: None),
            Route("/mindstage/textures/NAME.jpg", _TEXTURE, READ, lambda path, headers: _texture_response(path)),
            Route("/mindstage/FILE", re.compile("/mindstage/[^/]+"), CONTROL, self._named_file),
        )
        """The paths that are answered, the first that matches."""

    def socket_error(
        self, path: str, headers: RequestHeaders, *, visitor: Visitor | None = None, now_s: float = 0.0
    ) -> HttpResponse | None:
        """Checks a websocket handshake; returns the refusal, or None if it is allowed.

        Args:
            path: the path of the request, with its query.
            visitor: where the request comes from; by default this machine.
            now_s: the time, of any clock [s].
        """
        visitor = visitor or self.gate.visitors.visitor(None)
        denial = self.gate.socket_denial(path, headers, visitor, now_s) or self._excess(path, visitor, now_s)
        if denial is None and not any(pattern.fullmatch(request_path(path)) for _, pattern, _ in SOCKETS):
            denial = Denial(HTTPStatus.NOT_FOUND, "there is no such websocket")
        return None if denial is None else _error_response(denial)

    def respond(
        self, path: str, headers: RequestHeaders, *, visitor: Visitor | None = None, now_s: float = 0.0
    ) -> HttpResponse | None:
        """Answers a request; None for the page of the view, which viser provides, see `view_headers`.

        Args:
            path: the path of the request, with its query.
            visitor: where the request comes from; by default this machine.
            now_s: the time, of any clock [s].
        """
        route, visitor = request_path(path), visitor or self.gate.visitors.visitor(None)
        denial = self.gate.request_denial(path, headers, visitor, now_s) or self._excess(path, visitor, now_s)
        if denial is not None:
            is_login = denial.status is HTTPStatus.UNAUTHORIZED and route == "/"
            return (
                _login_page(denial, wrong=self.gate.has_token(path, headers)) if is_login else _error_response(denial)
            )
        entry = next((each for each in self.routes if each.pattern.fullmatch(route)), None)
        if entry is None:
            return _error_response(Denial(HTTPStatus.NOT_FOUND, "there is no such page; open /"))
        return entry.answer(path, headers)

    def entry_points(self) -> tuple[EntryPoint, ...]:
        """The paths that are answered."""
        routes = (EntryPoint(EntryKind.ROUTE, each.name, each.policy) for each in self.routes)
        return (*routes, *(EntryPoint(EntryKind.SOCKET, name, policy) for name, _, policy in SOCKETS))

    def _excess(self, path: str, visitor: Visitor, now_s: float) -> Denial | None:
        policies = [(each.pattern, each.policy) for each in self.routes] + [each[1:] for each in SOCKETS]
        try:
            for pattern, policy in policies:
                if pattern.fullmatch(request_path(path)):
                    policy.admit("the page", len(path), visitor, now_s)
        except RequestLimitError as error:
            return Denial(HTTPStatus.TOO_MANY_REQUESTS, str(error))
        return None

    # -- responses -----------------------------------------------------------------------------------------------------

    def _index(self, path: str, headers: RequestHeaders) -> HttpResponse:
        redirect = self.gate.cookie_redirect(path)
        if redirect is None:
            return self._file(page_files()["index.html"], headers)
        return HttpResponse(HTTPStatus.SEE_OTHER, b"", _SECURITY_HEADERS | {"Cache-Control": "no-store"} | redirect)

    def _named_file(self, path: str, headers: RequestHeaders) -> HttpResponse:
        route = request_path(path)
        file = page_files().get(route.removeprefix("/mindstage/")) if route.startswith("/mindstage/") else None
        return (
            self._file(file, headers)
            if file
            else _error_response(Denial(HTTPStatus.NOT_FOUND, "there is no such page; open /"))
        )

    def _file(self, file: StaticFile, headers: RequestHeaders) -> HttpResponse:
        sent = {"Content-Type": file.type, "ETag": file.etag, "Cache-Control": "no-cache"}
        sent["Content-Security-Policy"] = _page_policy(headers.get("Host") or "")
        if headers.get("If-None-Match") == file.etag:
            return HttpResponse(HTTPStatus.NOT_MODIFIED, b"", _SECURITY_HEADERS | sent)
        return HttpResponse(HTTPStatus.OK, file.content, _SECURITY_HEADERS | sent)

    def view_headers(self, headers: RequestHeaders) -> Mapping[str, str]:
        """Response headers of the view's page: its scripts are inline, and only pages of this server may frame it."""
        return _SECURITY_HEADERS | {
            "X-Frame-Options": "SAMEORIGIN",
            "Cache-Control": "no-cache",
            "Content-Security-Policy": _view_policy(headers.get("Host") or ""),
        }


_SECURITY_HEADERS: dict[str, str] = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


def _page_policy(host: str) -> str:
    return (
        f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; frame-src 'self'; "
        f"connect-src 'self' ws://{host} wss://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


def _view_policy(host: str) -> str:
    return (
        "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob: data:; "
        "worker-src blob: data:; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; "
        f"connect-src 'self' data: blob: ws://{host} wss://{host}; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'self'"
    )


def _texture_response(path: str) -> HttpResponse:
    """The image of a texture at a path, which may have to be computed."""
    match = _TEXTURE.fullmatch(request_path(path))
    if match is None or match[1] not in texture_names():
        return _error_response(Denial(HTTPStatus.NOT_FOUND, "there is no such texture"))
    content = texture_jpeg(match[1], TextureMap(match[2]), _TEXTURE_PIXELS)
    headers = {"Content-Type": "image/jpeg", "Cache-Control": _FOREVER}
    return HttpResponse(HTTPStatus.OK, content, _SECURITY_HEADERS | headers)


def _error_response(denial: Denial) -> HttpResponse:
    headers = {"Content-Type": "text/plain; charset=utf-8", "Cache-Control": "no-store"}
    return HttpResponse(denial.status, f"{denial.text}\n".encode(), _SECURITY_HEADERS | headers)


def _login_page(denial: Denial, *, wrong: bool) -> HttpResponse:
    message = "That is not the token." if wrong else "A token is needed."
    body = page_files()["sign-in.html"].content.replace(b"{{message}}", message.encode())
    style = hashlib.sha256(body.partition(b"<style>")[2].partition(b"</style>")[0]).digest()
    policy = f"default-src 'none'; style-src 'sha256-{_base64(style)}'; form-action 'self'; frame-ancestors 'none'"
    headers = {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": policy}
    return HttpResponse(denial.status, body, _SECURITY_HEADERS | {"Cache-Control": "no-store"} | headers)


def _base64(digest: bytes) -> str:
    from base64 import b64encode

    return b64encode(digest).decode()


_STYLESHEETS = ("viserOverrides.css",)
_SCRIPTS = (
    "bodyPoses.js",
    "clippingPlane.js",
    "culling.js",
    "labels.js",
    "levelsOfDetail.js",
    "placeholders.js",
    "renderQuality.js",
    "selectionBox.js",
    "sunShadow.js",
    "surroundings.js",
)
"""Modules of the page that are added to viser's page."""
_FIRST_SCRIPT = "viserHooks.js"
"""The script that must run before viser's, and is therefore part of the page."""


class ViserPage:
    """Viser's page with added scripts and styles: a single file of some megabytes, which browsers cache."""

    def __init__(self, viser: bytes) -> None:
        """Adds the scripts and styles.

        Args:
            viser: the page of viser.
        """
        available = page_files()
        links = [f"<script>{available[_FIRST_SCRIPT].content.decode()}</script>"]
        links += [f'<link rel="stylesheet" href="/mindstage/{name}" />' for name in _STYLESHEETS if name in available]
        links += [f'<script type="module" src="/mindstage/{name}"></script>' for name in _SCRIPTS if name in available]
        self._page = viser.replace(b"<title>", "".join(links).encode() + b"<title>", 1)
        self._compressed = gzip.compress(self._page, compresslevel=6)
        self._etag = f'"{hashlib.sha256(self._page).hexdigest()[:24]}"'

    def answer(self, headers: RequestHeaders, response_headers: Mapping[str, str]) -> HttpResponse:
        """Answers a request for the page.

        Args:
            response_headers: additional headers of the response.
        """
        sent = {
            "Content-Type": "text/html; charset=utf-8",
            "ETag": self._etag,
            "Vary": "Accept-Encoding",
            **response_headers,
        }
        if headers.get("If-None-Match") == self._etag:
            return HttpResponse(HTTPStatus.NOT_MODIFIED, b"", sent)
        if "gzip" in (headers.get("Accept-Encoding") or ""):
            return HttpResponse(HTTPStatus.OK, self._compressed, sent | {"Content-Encoding": "gzip"})
        return HttpResponse(HTTPStatus.OK, self._page, sent)
