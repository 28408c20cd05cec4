"""The gate of a server: which requests are let in, decided by host name, origin, token, cookie and address.

Any web page can make a browser send requests to this machine. Therefore the `Host` of a request must be a name of this
machine (DNS rebinding), the `Origin` of a websocket an allowed page, and both need the token unless the server listens
at a loopback address. All servers of Mindstage have a gate, and decide nothing of this themselves. A gate does no I/O.
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Collection
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Protocol
from urllib.parse import parse_qs, parse_qsl, urlencode, urlsplit

import msgspec

from mindstage.access.limits import CLOCK_SKEW, COOKIE_AGE, DEFAULT_VISITOR_LIMITS, VisitorLimits
from mindstage.access.visitors import Visitor, VisitorRegistry, is_loopback
from mindstage.errors import AuthenticationError

__all__ = ["Denial", "Gate", "RequestHeaders"]

_HOST = re.compile(r"[A-Za-z0-9.\-_]+(:\d{1,5})?|\[[0-9A-Fa-f:.]+\](:\d{1,5})?")
_COOKIE = "mindstage"
_LOCAL_NAMES = "this is not a host name of this server; open http://127.0.0.1 or http://localhost"
_TOKEN_REQUIRED = "a token is required"
_TOO_MANY_TOKENS = "too many wrong tokens were sent from this address; wait a minute"


class RequestHeaders(Protocol):
    """Headers of a request; names are case-insensitive."""

    def get(self, key: str, /) -> str | None:
        """The value of a header, or None."""


class RosAuth(Protocol):
    """A token, or rosauth's hash of it, with what is hashed."""

    @property
    def token(self) -> str | None: ...
    @property
    def mac(self) -> str: ...
    @property
    def client(self) -> str: ...
    @property
    def dest(self) -> str: ...
    @property
    def rand(self) -> str: ...
    @property
    def t(self) -> int: ...
    @property
    def level(self) -> str: ...
    @property
    def end(self) -> int: ...


class Denial(msgspec.Struct, frozen=True):
    """Why a request is not let in."""

    status: HTTPStatus
    text: str


class Gate:
    """Decides which requests one server answers. Belongs to the thread of the server's loop."""

    def __init__(
        self,
        *,
        host: str,
        token: str | None = None,
        origins: Collection[str] = (),
        local_pages: bool = False,
        secure: bool = False,
        limits: VisitorLimits = DEFAULT_VISITOR_LIMITS,
    ) -> None:
        """Creates a gate that nobody has passed.

        Args:
            host: the address that the server listens at; any other than a loopback address needs a token.
            token: the token that clients need, or None.
            origins: further origins of web pages, such as `https://robot.example`; `null` is that of a page that was
                opened as a file.
            local_pages: whether every page of this machine may open websockets, and behind a token also those of the
                same host; otherwise only those of this server.
            secure: whether the server uses TLS; the cookie is then sent over TLS only.
            limits: limits of each address.

        Raises:
            AuthenticationError: the host is not a loopback address, and there is no token.
        """
        if not token and not is_loopback(host):
            cause = "everyone in the network could connect; give a token, or serve at 127.0.0.1"
            raise AuthenticationError(host, cause=cause)
        self._token = (token or "").encode()
        self._local_only = is_loopback(host)
        self._local_pages = local_pages
        self._origins = frozenset(origin.rstrip("/").lower() for origin in origins)
        self._host_names = frozenset(urlsplit(origin).netloc for origin in self._origins)
        self._cookie_attributes = "; Secure" if secure else ""
        self._cookie_value = hmac.new(self._token, b"mindstage page", hashlib.sha256).hexdigest() if token else ""
        self.visitors = VisitorRegistry(limits)
        """The addresses that requests come from."""

    @property
    def needs_token(self) -> bool:
        """Whether clients must send a token."""
        return bool(self._token)

    def request_denial(self, path: str, headers: RequestHeaders, visitor: Visitor, now_s: float) -> Denial | None:
        """Checks a request; None if it is allowed.

        Args:
            path: the path of the request, with its query.
            visitor: where the request comes from.
            now_s: the time, of any clock [s].
        """
        if (denial := self._host_denial(headers)) is not None:
            return denial
        if headers.get("Sec-Fetch-Site") in {"cross-site", "same-site"} and path.partition("?")[0] != "/":
            return Denial(HTTPStatus.FORBIDDEN, "other sites may only link to /")
        return self._token_denial(path, headers, visitor, now_s)

    def socket_denial(
        self,
        path: str,
        headers: RequestHeaders,
        visitor: Visitor,
        now_s: float,
        *,
        token_may_follow: bool = False,
    ) -> Denial | None:
        """Checks the handshake of a websocket, as `request_denial`.

        Args:
            path: the path of the request, with its query.
            visitor: where the request comes from.
            now_s: the time, of any clock [s].
            token_may_follow: whether a client without a token may send it later, see `admit`.
        """
        if (denial := self._host_denial(headers)) is not None:
            return denial
        if not self._is_allowed_origin(headers.get("Origin"), headers.get("Host") or ""):
            return Denial(HTTPStatus.FORBIDDEN, "this origin is not allowed; open the page of this server")
        if not visitor.may_connect:
            return Denial(HTTPStatus.TOO_MANY_REQUESTS, "too many connections are open from this address")
        if token_may_follow and not self.has_token(path, headers) and visitor.may_try_token(now_s):
            return None
        return self._token_denial(path, headers, visitor, now_s)

    def admit(self, auth: RosAuth, visitor: Visitor, *, now_s: float, clock_s: float) -> Denial | None:
        """Checks a token that was sent after the handshake.

        Args:
            auth: the token.
            visitor: where it comes from.
            now_s: the time, of any clock [s].
            clock_s: Unix time [s].
        """
        return self._try_token(self._is_valid(auth, clock_s), visitor, now_s)

    def has_token(self, path: str, headers: RequestHeaders) -> bool:
        """Whether a request has a token, right or wrong; as `?token=` or `Authorization: Bearer`."""
        return self._sent_token(path, headers) is not None

    def is_authenticated(self, path: str, headers: RequestHeaders) -> bool:
        """Whether a request that was let in needs no further token."""
        return not self.needs_token or self._matches(self._sent_token(path, headers)) or self._has_cookie(headers)

    def cookie_redirect(self, path: str) -> dict[str, str] | None:
        """Headers that replace a token in the query of the page by an HttpOnly cookie; None if there is no token."""
        query = parse_qsl(path.partition("?")[2], keep_blank_values=True)
        if not self.needs_token or "token" not in dict(query):
            return None
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        cookie = f"{_COOKIE}={self._cookie_value}; Path=/; HttpOnly; SameSite=Strict; Max-Age={COOKIE_AGE.count}"
        return {"Location": f"/?{rest}" if rest else "/", "Set-Cookie": cookie + self._cookie_attributes}

    def _host_denial(self, headers: RequestHeaders) -> Denial | None:
        host = (headers.get("Host") or "").lower()
        if _HOST.fullmatch(host) is not None:
            name = urlsplit(f"//{host}").hostname or ""
            if host in self._host_names or is_loopback(name) or not self._local_only:
                return None
        return Denial(HTTPStatus.MISDIRECTED_REQUEST, _LOCAL_NAMES)

    def _is_allowed_origin(self, origin: str | None, host: str) -> bool:
        """Whether a program (None), or a page of this origin, may open a websocket at a server of this host."""
        if origin is None or origin.rstrip("/").lower() in self._origins:
            return True
        try:
            page, server = urlsplit(origin.lower()), urlsplit(f"//{host.lower()}")
            page_name, server_name = page.hostname or "", server.hostname or ""
        except ValueError:
            return False
        if not self._local_pages:
            return page.scheme in {"http", "https"} and page.netloc == server.netloc
        # Without a token a host name proves nothing, since its owner can let it resolve to this machine.
        return is_loopback(page_name) or (not self._local_only and page_name != "" and page_name == server_name)

    def _token_denial(self, path: str, headers: RequestHeaders, visitor: Visitor, now_s: float) -> Denial | None:
        if not self.needs_token:
            return None
        sent = self._sent_token(path, headers)
        if sent is not None:
            return self._try_token(self._matches(sent), visitor, now_s, sent=bool(sent))
        if self._has_cookie(headers):
            return None
        if not visitor.may_try_token(now_s):
            return Denial(HTTPStatus.TOO_MANY_REQUESTS, _TOO_MANY_TOKENS)
        return Denial(HTTPStatus.UNAUTHORIZED, _TOKEN_REQUIRED)

    def _try_token(self, is_valid: bool, visitor: Visitor, now_s: float, *, sent: bool = True) -> Denial | None:
        if not self.needs_token:
            return None
        if not visitor.may_try_token(now_s):
            return Denial(HTTPStatus.TOO_MANY_REQUESTS, _TOO_MANY_TOKENS)
        if is_valid:
            return None
        visitor.add_failed_token(now_s)
        return Denial(HTTPStatus.UNAUTHORIZED, "invalid token" if sent else _TOKEN_REQUIRED)

    def _sent_token(self, path: str, headers: RequestHeaders) -> str | None:
        tokens = parse_qs(path.partition("?")[2], keep_blank_values=True).get("token", [])
        scheme, _, value = (headers.get("Authorization") or "").partition(" ")
        if headers.get("Authorization") is not None:
            bearer = value.strip() if scheme.lower() == "bearer" else ""
            tokens = [bearer] if bearer or not tokens else tokens
        return tokens[0] if tokens else None

    def _is_valid(self, auth: RosAuth, clock_s: float) -> bool:
        if auth.token is not None:
            return self._matches(auth.token)
        if abs(clock_s - auth.t) > CLOCK_SKEW.maximum or auth.end <= clock_s:
            return False
        signed = f"{auth.client}{auth.dest}{auth.rand}{auth.t}{auth.level}{auth.end}"
        expected = hashlib.sha512(self._token + signed.encode("utf-8", "surrogateescape")).hexdigest()
        return hmac.compare_digest(expected.encode(), auth.mac.encode("utf-8", "surrogateescape"))

    def _matches(self, token: str | None) -> bool:
        return token is not None and hmac.compare_digest(self._token, token.encode("utf-8", "surrogateescape"))

    def _has_cookie(self, headers: RequestHeaders) -> bool:
        try:
            cookie = SimpleCookie(headers.get("Cookie") or "")
        except CookieError:
            return False
        return any(
            hmac.compare_digest(self._cookie_value.encode(), morsel.value.encode("utf-8", "surrogateescape"))
            for name, morsel in cookie.items()
            if name == _COOKIE
        )
