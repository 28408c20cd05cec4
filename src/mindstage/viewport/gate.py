"""Gate: who may come to the page, and what they get there; it stands before everything else at the port.

A browser goes wherever any page sends it, this machine's own ports included. So a request counts only if it is
addressed to this machine by a name that is known to be its own (a stranger's name can be made to point here), a
websocket only if our own page opens it, and from other machines both only with the token.
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Collection, Mapping
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Protocol
from urllib.parse import parse_qsl, urlencode, urlsplit

import msgspec

from mindstage.bridge.access import Access, is_loopback
from mindstage.errors import AccessRefused
from mindstage.viewport.files import File, page_files

__all__ = ["CHANNEL", "Answer", "Gate", "Headers", "place_of", "view_key"]

CHANNEL = "/mindstage/channel"
"""Where the page opens its websocket."""

_VIEW = re.compile(r"/view/([a-z0-9]{8,40})/?")
_HOST = re.compile(r"[A-Za-z0-9.\-_]+(:\d{1,5})?|\[[0-9A-Fa-f:.]+\](:\d{1,5})?")
_COOKIE_AGE_S = 30 * 24 * 3600


class Headers(Protocol):
    """Of a request, by name in any case."""

    def get(self, key: str, default: None = None, /) -> str | None:
        """One of them."""


class Answer(msgspec.Struct, frozen=True):
    """What a request is answered with."""

    status: HTTPStatus
    body: bytes
    headers: Mapping[str, str]


def view_key(path: str) -> str | None:
    """Whose view it is, by the path of its page or its websocket; None for any other path."""
    match = _VIEW.fullmatch(place_of(path))
    return match[1] if match else None


def place_of(path: str) -> str:
    """A request's path without what follows a question mark; two slashes in front are no other host's name here."""
    return path.partition("?")[0]


class Gate:
    """Judges requests by their path and headers; it knows neither sockets nor the disk."""

    def __init__(self, *, host: str, token: str | None = None, origins: Collection[str] = ()) -> None:
        """The rules.

        Args:
            host: where the server listens; others than this machine's own need a token.
            token: what visitors must know, or None.
            origins: addresses under which the page may be opened beside its own, such as `https://robot.example`,
                behind which somebody else passes requests on.

        Raises:
            AccessRefused: others could reach it, and there is no token.
        """
        if not token and not is_loopback(host):
            raise AccessRefused(host, cause="everyone in the network could come; give a token, or serve at 127.0.0.1")
        self._access = Access(host=host, token=token or None, origins=())
        self._at_home = is_loopback(host)
        self._origins = frozenset(origin.rstrip("/").lower() for origin in origins)
        self._names = frozenset(urlsplit(origin).netloc for origin in self._origins)
        self._pass = hmac.new(token.encode(), b"mindstage page", hashlib.sha256).hexdigest() if token else ""

    # -- the order of questions ----------------------------------------------------------------------------------------

    def judge_socket(self, path: str, headers: Headers) -> Answer | None:
        """Why a websocket may not be opened; None where it may."""
        if (refusal := self._refuse_name(headers)) is not None:
            return refusal
        origin = headers.get("Origin")
        if origin is not None and not self._is_own(origin, headers.get("Host") or ""):
            return _refused(HTTPStatus.FORBIDDEN, "pages of that origin may not come in; open this server's own page")
        if not self._is_known(path, headers):
            return _refused(HTTPStatus.UNAUTHORIZED, "a token is needed: open the page with ?token=… first")
        if place_of(path) != CHANNEL and view_key(path) is None:
            return _refused(HTTPStatus.NOT_FOUND, "there is no such websocket")
        return None

    def answer(self, path: str, headers: Headers) -> Answer | None:
        """What a plain request gets; None where it is the view's own page, which viser has: see `view_headers`."""
        if (refusal := self._refuse_name(headers)) is not None:
            return refusal
        site = headers.get("Sec-Fetch-Site")
        place = place_of(path)
        if site in {"cross-site", "same-site"} and place != "/":
            return _refused(HTTPStatus.FORBIDDEN, "pages from elsewhere may only link to /")
        if not self._is_known(path, headers):
            return self._sign_in(place, wrong=self._access.shown_in(path, headers.get("Authorization")) is False)
        if place == "/":
            return self._cookie(path) or self._file(page_files()["index.html"], headers)
        if view_key(path) is not None:
            return None
        file = page_files().get(place.removeprefix("/mindstage/")) if place.startswith("/mindstage/") else None
        return self._file(file, headers) if file else _refused(HTTPStatus.NOT_FOUND, "there is no such page; try /")

    # -- names and tokens ----------------------------------------------------------------------------------------------

    def _refuse_name(self, headers: Headers) -> Answer | None:
        host = (headers.get("Host") or "").lower()
        if _HOST.fullmatch(host) is not None:
            name = urlsplit(f"//{host}").hostname or ""
            if host in self._names or is_loopback(name) or not self._at_home:
                return None
        text = "this server is not known by that name; open it as http://127.0.0.1 or http://localhost"
        return _refused(HTTPStatus.MISDIRECTED_REQUEST, text)

    def _is_own(self, origin: str, host: str) -> bool:
        try:
            page = urlsplit(origin.lower())
        except ValueError:
            return False
        own = page.scheme in {"http", "https"} and page.netloc == host.lower()
        return own or origin.rstrip("/").lower() in self._origins

    def _is_known(self, path: str, headers: Headers) -> bool:
        if not self._access.needs_token:
            return True
        shown = self._access.shown_in(path, headers.get("Authorization"))
        if shown is not None:
            return shown
        try:
            cookie = SimpleCookie(headers.get("Cookie") or "")
        except CookieError:
            return False
        return any(
            hmac.compare_digest(self._pass.encode(), morsel.value.encode("utf-8", "surrogateescape"))
            for name, morsel in cookie.items()
            if name == "mindstage"
        )

    def _cookie(self, path: str) -> Answer | None:
        """Takes a token out of the address, where others could read it, and into a cookie that scripts cannot see."""
        query = parse_qsl(path.partition("?")[2], keep_blank_values=True)
        if not self._access.needs_token or "token" not in dict(query):
            return None
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        cookie = f"mindstage={self._pass}; Path=/; HttpOnly; SameSite=Strict; Max-Age={_COOKIE_AGE_S}"
        headers = {"Location": f"/?{rest}" if rest else "/", "Set-Cookie": cookie, "Cache-Control": "no-store"}
        return Answer(HTTPStatus.SEE_OTHER, b"", _SAFE | headers)

    def _sign_in(self, place: str, *, wrong: bool) -> Answer:
        why = "That is not the token." if wrong else "A token is needed."
        if place != "/":
            return _refused(HTTPStatus.UNAUTHORIZED, why)
        body = page_files()["sign-in.html"].content.replace(b"{{message}}", why.encode())
        style = hashlib.sha256(body.partition(b"<style>")[2].partition(b"</style>")[0]).digest()
        policy = f"default-src 'none'; style-src 'sha256-{_base64(style)}'; form-action 'self'; frame-ancestors 'none'"
        headers = {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": policy}
        return Answer(HTTPStatus.UNAUTHORIZED, body, _SAFE | {"Cache-Control": "no-store"} | headers)

    # -- answers -------------------------------------------------------------------------------------------------------

    def _file(self, file: File, headers: Headers) -> Answer:
        told = {"Content-Type": file.type, "ETag": file.tag, "Cache-Control": "no-cache"}
        told["Content-Security-Policy"] = _page_policy(headers.get("Host") or "")
        if headers.get("If-None-Match") == file.tag:
            return Answer(HTTPStatus.NOT_MODIFIED, b"", _SAFE | told)
        return Answer(HTTPStatus.OK, file.content, _SAFE | told)

    def view_headers(self, headers: Headers) -> Mapping[str, str]:
        """What goes with the view's own page: it is one file with its scripts in it, and only our page may hold it."""
        return _SAFE | {
            "X-Frame-Options": "SAMEORIGIN",
            "Cache-Control": "no-cache",
            "Content-Security-Policy": _view_policy(headers.get("Host") or ""),
        }


_SAFE: dict[str, str] = {
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


def _refused(status: HTTPStatus, text: str) -> Answer:
    headers = {"Content-Type": "text/plain; charset=utf-8", "Cache-Control": "no-store"}
    return Answer(status, f"{text}\n".encode(), _SAFE | headers)


def _base64(digest: bytes) -> str:
    from base64 import b64encode

    return b64encode(digest).decode()
