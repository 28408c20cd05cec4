"""HTTP of the page: static files, the filter of requests (host, origin, token), and viser's page with added scripts.

Any web page can make a browser send requests to this machine. Therefore a request is allowed only if its `Host` is a
name of this machine (DNS rebinding), a websocket only from the page's own origin, and both need the token unless the
server listens on a loopback address. Paths are looked up in a fixed list of files, never on the disk.
"""

from __future__ import annotations

import gzip
import hashlib
import hmac
import re
from collections.abc import Collection, Mapping
from functools import cache
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Protocol
from urllib.parse import parse_qsl, urlencode, urlsplit

import msgspec

from mindstage.access.limits import COOKIE_AGE, DEFAULT_VISITOR_LIMITS, VisitorLimits
from mindstage.access.visitors import Visitor, VisitorRegistry, is_loopback
from mindstage.bridge.server import TokenAuth
from mindstage.errors import AuthenticationError
from mindstage.textures.baking import content_version
from mindstage.textures.catalog import texture_names
from mindstage.textures.images import TextureMap, texture_jpeg

__all__ = [
    "CHANNEL",
    "HttpResponse",
    "RequestFilter",
    "RequestHeaders",
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
    for path in Path(__file__).with_name("page").iterdir():
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
_HOST = re.compile(r"[A-Za-z0-9.\-_]+(:\d{1,5})?|\[[0-9A-Fa-f:.]+\](:\d{1,5})?")
_TOKEN_REQUIRED = "a token is required; open the page with ?token=… first"
_TOO_MANY_TOKENS = "too many wrong tokens were sent from this address; wait a minute"


class RequestHeaders(Protocol):
    """Headers of a request; names are case-insensitive."""

    def get(self, key: str, default: None = None, /) -> str | None:
        """The value of a header, or None."""


class HttpResponse(msgspec.Struct, frozen=True):
    """The response to a request."""

    status: HTTPStatus
    body: bytes
    headers: Mapping[str, str]


def view_key(path: str) -> str | None:
    """The session key in the path of a view's page or websocket; None for any other path."""
    match = _VIEW.fullmatch(request_path(path))
    return match[1] if match else None


def request_path(path: str) -> str:
    """The path without the query; unlike `urlsplit`, two leading slashes do not start a host name."""
    return path.partition("?")[0]


class RequestFilter:
    """Decides by path and headers which requests are allowed. Does no I/O."""

    def __init__(
        self,
        *,
        host: str,
        token: str | None = None,
        origins: Collection[str] = (),
        secure: bool = False,
        visitor_limits: VisitorLimits = DEFAULT_VISITOR_LIMITS,
    ) -> None:
        """Creates the filter.

        Args:
            host: the address that the server listens on; any other than a loopback address needs a token.
            token: the token that clients need, or None.
            origins: further origins of the page, such as `https://robot.example` for a reverse proxy.
            secure: whether the server uses TLS; the cookie is then sent over TLS only.
            visitor_limits: limits of each client address.

        Raises:
            AuthenticationError: the host is not a loopback address, and there is no token.
        """
        if not token and not is_loopback(host):
            raise AuthenticationError(
                host, cause="everyone in the network could open the page; give a token, or serve at 127.0.0.1"
            )
        self._auth = TokenAuth(host=host, token=token or None, origins=())
        self._local_only = is_loopback(host)
        self._origins = frozenset(origin.rstrip("/").lower() for origin in origins)
        self._host_names = frozenset(urlsplit(origin).netloc for origin in self._origins)
        self._cookie_attributes = "; Secure" if secure else ""
        self.visitors = VisitorRegistry(visitor_limits)
        """The addresses that requests come from."""
        self._cookie_value = hmac.new(token.encode(), b"mindstage page", hashlib.sha256).hexdigest() if token else ""

    # -- checks --------------------------------------------------------------------------------------------------------

    def socket_error(
        self, path: str, headers: RequestHeaders, *, visitor: Visitor | None = None, now_s: float = 0.0
    ) -> HttpResponse | None:
        """Checks a websocket handshake; returns the refusal, or None if it is allowed.

        Args:
            path: the path of the request, with its query.
            headers: the headers of the request.
            visitor: where the request comes from; by default this machine.
            now_s: the time, of any clock [s].
        """
        visitor = visitor or self.visitors.visitor(None)
        refusal = self._host_error(headers)
        if refusal is None and not visitor.may_connect:
            refusal = _error_response(HTTPStatus.TOO_MANY_REQUESTS, "too many pages are open at this address")
        if refusal is not None:
            return refusal
        origin = headers.get("Origin")
        if origin is not None and not self._is_same_origin(origin, headers.get("Host") or ""):
            return _error_response(HTTPStatus.FORBIDDEN, "this origin is not allowed; open the page of this server")
        is_blocked = not visitor.may_try_token(now_s)
        if not self._is_authenticated(path, headers, visitor, now_s):
            status = HTTPStatus.TOO_MANY_REQUESTS if is_blocked else HTTPStatus.UNAUTHORIZED
            return _error_response(status, _TOO_MANY_TOKENS if is_blocked else _TOKEN_REQUIRED)
        if request_path(path) != CHANNEL and view_key(path) is None:
            return _error_response(HTTPStatus.NOT_FOUND, "there is no such websocket")
        return None

    def respond(
        self, path: str, headers: RequestHeaders, *, visitor: Visitor | None = None, now_s: float = 0.0
    ) -> HttpResponse | None:
        """Answers a request; None for the page of the view, which viser provides, see `view_headers`.

        Args:
            path: the path of the request, with its query.
            headers: the headers of the request.
            visitor: where the request comes from; by default this machine.
            now_s: the time, of any clock [s].
        """
        visitor = visitor or self.visitors.visitor(None)
        if (refusal := self._host_error(headers)) is not None:
            return refusal
        site = headers.get("Sec-Fetch-Site")
        route = request_path(path)
        if site in {"cross-site", "same-site"} and route != "/":
            return _error_response(HTTPStatus.FORBIDDEN, "other sites may only link to /")
        is_blocked = not visitor.may_try_token(now_s)
        if not self._is_authenticated(path, headers, visitor, now_s):
            return self._login_page(route, wrong=self._has_token(path, headers), is_blocked=is_blocked)
        if route == "/":
            return self._cookie(path) or self._file(page_files()["index.html"], headers)
        if view_key(path) is not None:
            return None
        return _texture_response(route) or self._named_file(route, headers)

    # -- host, origin and token ----------------------------------------------------------------------------------------

    def _host_error(self, headers: RequestHeaders) -> HttpResponse | None:
        host = (headers.get("Host") or "").lower()
        if _HOST.fullmatch(host) is not None:
            name = urlsplit(f"//{host}").hostname or ""
            if host in self._host_names or is_loopback(name) or not self._local_only:
                return None
        text = "this is not a host name of this server; open http://127.0.0.1 or http://localhost"
        return _error_response(HTTPStatus.MISDIRECTED_REQUEST, text)

    def _is_same_origin(self, origin: str, host: str) -> bool:
        try:
            page = urlsplit(origin.lower())
        except ValueError:
            return False
        own = page.scheme in {"http", "https"} and page.netloc == host.lower()
        return own or origin.rstrip("/").lower() in self._origins

    def _has_token(self, path: str, headers: RequestHeaders) -> bool:
        return self._auth.check_handshake(path, headers.get("Authorization")) is not None

    def _is_authenticated(self, path: str, headers: RequestHeaders, visitor: Visitor, now_s: float) -> bool:
        if not self._auth.needs_token:
            return True
        if not self._has_token(path, headers):
            return self._has_cookie(headers)
        if not visitor.may_try_token(now_s):
            return False
        allowed = self._auth.check_handshake(path, headers.get("Authorization")) is True
        if not allowed:
            visitor.add_failed_token(now_s)
        return allowed

    def _has_cookie(self, headers: RequestHeaders) -> bool:
        try:
            cookie = SimpleCookie(headers.get("Cookie") or "")
        except CookieError:
            return False
        return any(
            hmac.compare_digest(self._cookie_value.encode(), morsel.value.encode("utf-8", "surrogateescape"))
            for name, morsel in cookie.items()
            if name == "mindstage"
        )

    def _cookie(self, path: str) -> HttpResponse | None:
        """Redirects a request with a token in its query: to the address without it, with an HttpOnly cookie instead."""
        query = parse_qsl(path.partition("?")[2], keep_blank_values=True)
        if not self._auth.needs_token or "token" not in dict(query):
            return None
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        cookie = f"mindstage={self._cookie_value}; Path=/; HttpOnly; SameSite=Strict; Max-Age={COOKIE_AGE.count}"
        cookie += self._cookie_attributes
        headers = {"Location": f"/?{rest}" if rest else "/", "Set-Cookie": cookie, "Cache-Control": "no-store"}
        return HttpResponse(HTTPStatus.SEE_OTHER, b"", _SECURITY_HEADERS | headers)

    def _login_page(self, path: str, *, wrong: bool, is_blocked: bool) -> HttpResponse:
        if is_blocked:
            return _error_response(HTTPStatus.TOO_MANY_REQUESTS, _TOO_MANY_TOKENS)
        message = "That is not the token." if wrong else "A token is needed."
        if path != "/":
            return _error_response(HTTPStatus.UNAUTHORIZED, message)
        body = page_files()["sign-in.html"].content.replace(b"{{message}}", message.encode())
        style = hashlib.sha256(body.partition(b"<style>")[2].partition(b"</style>")[0]).digest()
        policy = f"default-src 'none'; style-src 'sha256-{_base64(style)}'; form-action 'self'; frame-ancestors 'none'"
        headers = {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": policy}
        return HttpResponse(HTTPStatus.UNAUTHORIZED, body, _SECURITY_HEADERS | {"Cache-Control": "no-store"} | headers)

    # -- responses -----------------------------------------------------------------------------------------------------

    def _named_file(self, route: str, headers: RequestHeaders) -> HttpResponse:
        file = page_files().get(route.removeprefix("/mindstage/")) if route.startswith("/mindstage/") else None
        return (
            self._file(file, headers)
            if file
            else _error_response(HTTPStatus.NOT_FOUND, "there is no such page; open /")
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


def _texture_response(route: str) -> HttpResponse | None:
    """The image of a texture at a path, which may have to be computed; None if there is none."""
    match = _TEXTURE.fullmatch(route)
    if match is None or match[1] not in texture_names():
        return None
    content = texture_jpeg(match[1], TextureMap(match[2]), _TEXTURE_PIXELS)
    headers = {"Content-Type": "image/jpeg", "Cache-Control": _FOREVER}
    return HttpResponse(HTTPStatus.OK, content, _SECURITY_HEADERS | headers)


def _error_response(status: HTTPStatus, text: str) -> HttpResponse:
    headers = {"Content-Type": "text/plain; charset=utf-8", "Cache-Control": "no-store"}
    return HttpResponse(status, f"{text}\n".encode(), _SECURITY_HEADERS | headers)


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
            headers: the headers of the request.
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
