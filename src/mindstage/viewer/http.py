"""Gate: who may come to the page, and what they get there; it stands before everything else at the port.

A browser goes wherever any page sends it, this machine's own ports included. So a request counts only if it is
addressed to this machine by a name that is known to be its own (a stranger's name can be made to point here), a
websocket only if our own page opens it, and from other machines both only with the token.

Files: what the page is made of, read once from the package; no path from outside ever reaches the disk.

View page: viser's own page as we serve it, without its panel and with our few scripts for the picture.
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

from mindstage.bridge.server import TokenAuth, is_loopback
from mindstage.errors import AuthenticationError

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
    """One file as a browser gets it."""

    type: str
    content: bytes
    etag: str
    """Changes whenever the content does."""


@cache
def page_files() -> dict[str, StaticFile]:
    """All files of the page by name: a fixed list, against which wishes are held."""
    found = {}
    # Wheels are always unpacked, so that what lies beside this file is a folder.
    for path in Path(__file__).with_name("page").iterdir():
        if (type := _TYPES.get(path.suffix)) is not None:
            content = path.read_bytes()
            found[path.name] = StaticFile(type, content, f'"{hashlib.sha256(content).hexdigest()[:24]}"')
    return found


CHANNEL = "/mindstage/channel"
"""Where the page opens its websocket."""

_VIEW = re.compile(r"/view/([a-z0-9]{8,40})/?")
_HOST = re.compile(r"[A-Za-z0-9.\-_]+(:\d{1,5})?|\[[0-9A-Fa-f:.]+\](:\d{1,5})?")
_COOKIE_MAX_AGE_S = 30 * 24 * 3600


class RequestHeaders(Protocol):
    """Of a request, by name in any case."""

    def get(self, key: str, default: None = None, /) -> str | None:
        """One of them."""


class HttpResponse(msgspec.Struct, frozen=True):
    """What a request is answered with."""

    status: HTTPStatus
    body: bytes
    headers: Mapping[str, str]


def view_key(path: str) -> str | None:
    """Whose view it is, by the path of its page or its websocket; None for any other path."""
    match = _VIEW.fullmatch(request_path(path))
    return match[1] if match else None


def request_path(path: str) -> str:
    """A request's path without what follows a question mark; two slashes in front are no other host's name here."""
    return path.partition("?")[0]


class RequestFilter:
    """Judges requests by their path and headers; it knows neither sockets nor the disk."""

    def __init__(self, *, host: str, token: str | None = None, origins: Collection[str] = ()) -> None:
        """The rules.

        Args:
            host: where the server listens; others than this machine's own need a token.
            token: what visitors must know, or None.
            origins: addresses under which the page may be opened beside its own, such as `https://robot.example`,
                behind which somebody else passes requests on.

        Raises:
            AuthenticationError: others could reach it, and there is no token.
        """
        if not token and not is_loopback(host):
            raise AuthenticationError(
                host, cause="everyone in the network could come; give a token, or serve at 127.0.0.1"
            )
        self._auth = TokenAuth(host=host, token=token or None, origins=())
        self._local_only = is_loopback(host)
        self._origins = frozenset(origin.rstrip("/").lower() for origin in origins)
        self._host_names = frozenset(urlsplit(origin).netloc for origin in self._origins)
        self._cookie_value = hmac.new(token.encode(), b"mindstage page", hashlib.sha256).hexdigest() if token else ""

    # -- the order of questions ----------------------------------------------------------------------------------------

    def socket_error(self, path: str, headers: RequestHeaders) -> HttpResponse | None:
        """Why a websocket may not be opened; None where it may."""
        if (refusal := self._host_error(headers)) is not None:
            return refusal
        origin = headers.get("Origin")
        if origin is not None and not self._is_same_origin(origin, headers.get("Host") or ""):
            return _error_response(
                HTTPStatus.FORBIDDEN, "pages of that origin may not come in; open this server's own page"
            )
        if not self._is_authenticated(path, headers):
            return _error_response(HTTPStatus.UNAUTHORIZED, "a token is needed: open the page with ?token=… first")
        if request_path(path) != CHANNEL and view_key(path) is None:
            return _error_response(HTTPStatus.NOT_FOUND, "there is no such websocket")
        return None

    def respond(self, path: str, headers: RequestHeaders) -> HttpResponse | None:
        """What a plain request gets; None where it is the view's own page, which viser has: see `view_headers`."""
        if (refusal := self._host_error(headers)) is not None:
            return refusal
        site = headers.get("Sec-Fetch-Site")
        place = request_path(path)
        if site in {"cross-site", "same-site"} and place != "/":
            return _error_response(HTTPStatus.FORBIDDEN, "pages from elsewhere may only link to /")
        if not self._is_authenticated(path, headers):
            return self._login_page(
                place, wrong=self._auth.check_handshake(path, headers.get("Authorization")) is False
            )
        if place == "/":
            return self._cookie(path) or self._file(page_files()["index.html"], headers)
        if view_key(path) is not None:
            return None
        file = page_files().get(place.removeprefix("/mindstage/")) if place.startswith("/mindstage/") else None
        return (
            self._file(file, headers) if file else _error_response(HTTPStatus.NOT_FOUND, "there is no such page; try /")
        )

    # -- names and tokens ----------------------------------------------------------------------------------------------

    def _host_error(self, headers: RequestHeaders) -> HttpResponse | None:
        host = (headers.get("Host") or "").lower()
        if _HOST.fullmatch(host) is not None:
            name = urlsplit(f"//{host}").hostname or ""
            if host in self._host_names or is_loopback(name) or not self._local_only:
                return None
        text = "this server is not known by that name; open it as http://127.0.0.1 or http://localhost"
        return _error_response(HTTPStatus.MISDIRECTED_REQUEST, text)

    def _is_same_origin(self, origin: str, host: str) -> bool:
        try:
            page = urlsplit(origin.lower())
        except ValueError:
            return False
        own = page.scheme in {"http", "https"} and page.netloc == host.lower()
        return own or origin.rstrip("/").lower() in self._origins

    def _is_authenticated(self, path: str, headers: RequestHeaders) -> bool:
        if not self._auth.needs_token:
            return True
        shown = self._auth.check_handshake(path, headers.get("Authorization"))
        if shown is not None:
            return shown
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
        """Takes a token out of the address, where others could read it, and into a cookie that scripts cannot see."""
        query = parse_qsl(path.partition("?")[2], keep_blank_values=True)
        if not self._auth.needs_token or "token" not in dict(query):
            return None
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        cookie = f"mindstage={self._cookie_value}; Path=/; HttpOnly; SameSite=Strict; Max-Age={_COOKIE_MAX_AGE_S}"
        headers = {"Location": f"/?{rest}" if rest else "/", "Set-Cookie": cookie, "Cache-Control": "no-store"}
        return HttpResponse(HTTPStatus.SEE_OTHER, b"", _SECURITY_HEADERS | headers)

    def _login_page(self, path: str, *, wrong: bool) -> HttpResponse:
        why = "That is not the token." if wrong else "A token is needed."
        if path != "/":
            return _error_response(HTTPStatus.UNAUTHORIZED, why)
        body = page_files()["sign-in.html"].content.replace(b"{{message}}", why.encode())
        style = hashlib.sha256(body.partition(b"<style>")[2].partition(b"</style>")[0]).digest()
        policy = f"default-src 'none'; style-src 'sha256-{_base64(style)}'; form-action 'self'; frame-ancestors 'none'"
        headers = {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": policy}
        return HttpResponse(HTTPStatus.UNAUTHORIZED, body, _SECURITY_HEADERS | {"Cache-Control": "no-store"} | headers)

    # -- answers -------------------------------------------------------------------------------------------------------

    def _file(self, file: StaticFile, headers: RequestHeaders) -> HttpResponse:
        told = {"Content-Type": file.type, "ETag": file.etag, "Cache-Control": "no-cache"}
        told["Content-Security-Policy"] = _page_policy(headers.get("Host") or "")
        if headers.get("If-None-Match") == file.etag:
            return HttpResponse(HTTPStatus.NOT_MODIFIED, b"", _SECURITY_HEADERS | told)
        return HttpResponse(HTTPStatus.OK, file.content, _SECURITY_HEADERS | told)

    def view_headers(self, headers: RequestHeaders) -> Mapping[str, str]:
        """What goes with the view's own page: it is one file with its scripts in it, and only our page may hold it."""
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
        "worker-src blob: data:; style-src 'self' 'unsafe-inline'; img-src data: blob:; font-src data:; "
        f"connect-src 'self' data: blob: ws://{host} wss://{host}; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'self'"
    )


def _error_response(status: HTTPStatus, text: str) -> HttpResponse:
    headers = {"Content-Type": "text/plain; charset=utf-8", "Cache-Control": "no-store"}
    return HttpResponse(status, f"{text}\n".encode(), _SECURITY_HEADERS | headers)


def _base64(digest: bytes) -> str:
    from base64 import b64encode

    return b64encode(digest).decode()


_STYLESHEETS = ("viserOverrides.css",)
_SCRIPTS = ("clippingPlane.js", "shadowBias.js")
"""Of our files, those that the picture itself needs."""


class ViserPage:
    """One file with everything in it, some megabytes; browsers keep it as long as it is the same."""

    def __init__(self, viser: bytes) -> None:
        """Viser's page as it comes with it."""
        there = page_files()
        links = [f'<link rel="stylesheet" href="/mindstage/{name}" />' for name in _STYLESHEETS if name in there]
        links += [f'<script type="module" src="/mindstage/{name}"></script>' for name in _SCRIPTS if name in there]
        self._page = viser.replace(b"<title>", "".join(links).encode() + b"<title>", 1)
        self._compressed = gzip.compress(self._page, compresslevel=6)
        self._etag = f'"{hashlib.sha256(self._page).hexdigest()[:24]}"'

    def answer(self, headers: RequestHeaders, request_headers: Mapping[str, str]) -> HttpResponse:
        """The page for a request.

        Args:
            headers: of the request.
            told: headers that go with it.
        """
        request_headers = {
            "Content-Type": "text/html; charset=utf-8",
            "ETag": self._etag,
            "Vary": "Accept-Encoding",
            **request_headers,
        }
        if headers.get("If-None-Match") == self._etag:
            return HttpResponse(HTTPStatus.NOT_MODIFIED, b"", request_headers)
        if "gzip" in (headers.get("Accept-Encoding") or ""):
            return HttpResponse(HTTPStatus.OK, self._compressed, request_headers | {"Content-Encoding": "gzip"})
        return HttpResponse(HTTPStatus.OK, self._page, request_headers)
