"""Access: who may come in, told by a token and, for browsers, by the page that wants to.

A page from anywhere can open a websocket to this very machine; only its `SourceMapView` gives it away. Programs send none.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
from collections.abc import Collection
from urllib.parse import parse_qs, urlsplit

from mindstage.bridge.protocol import Auth

__all__ = ["TokenAuth", "is_loopback"]

_MAX_CLOCK_SKEW_S = 5.0
"""rosauth's bound: a proof is no older."""


def is_loopback(host: str) -> bool:
    """Whether only this machine itself reaches that host."""
    if host.strip("[]").lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class TokenAuth:
    """Decides; holds the token and tells it to nobody."""

    def __init__(self, *, host: str, token: str | None, origins: Collection[str]) -> None:
        """The rules.

        Args:
            host: where the server listens.
            token: what a client must know, or None.
            origins: pages that may come in beside those of this machine, such as `https://robot.example`; `null` is
                what a page has that was opened as a file.
        """
        self._local_only = is_loopback(host)
        self._token = None if token is None else token.encode()
        self._origins = frozenset(origin.rstrip("/").lower() for origin in origins)

    @property
    def needs_token(self) -> bool:
        """Whether a client must show one."""
        return self._token is not None

    def allows_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether a browser's page may come in.

        Args:
            origin: the handshake's `SourceMapView`; None for a program.
            host: the handshake's `Host`. A page of that very host may come in where a token protects it; without one
                its name proves nothing, for whoever owns a name can let it point to this machine.
        """
        if origin is None or origin.rstrip("/").lower() in self._origins:
            return True
        try:
            page = urlsplit(origin).hostname or ""
            here = urlsplit(f"//{host or ''}").hostname or ""
        except ValueError:
            return False
        return is_loopback(page) or (not self._local_only and page != "" and page == here)

    def check_handshake(self, path: str, authorization: str | None) -> bool | None:
        """Whether the handshake's `?token=` or `Authorization: Bearer` is the token; None if there is neither."""
        shown = parse_qs(urlsplit(path).query, keep_blank_values=True).get("token", [])
        if authorization is not None:
            scheme, _, value = authorization.partition(" ")
            bearer = value.strip() if scheme.lower() == "bearer" else ""
            shown = [bearer] if bearer or not shown else shown
        return self._token_matches(shown[0]) if shown else None

    def check_auth(self, auth: Auth, now_s: float) -> bool:
        """Whether an `auth` shows that the client knows the token: as it is, or by rosauth's hash with it.

        Args:
            auth: what the client says.
            now_s: the present moment, since 1970 [s].
        """
        if auth.token is not None:
            return self._token_matches(auth.token)
        if abs(now_s - auth.t) > _MAX_CLOCK_SKEW_S or auth.end <= now_s or self._token is None:
            return False
        said = f"{auth.client}{auth.dest}{auth.rand}{auth.t}{auth.level}{auth.end}"
        proof = hashlib.sha512(self._token + said.encode("utf-8", "surrogateescape")).hexdigest()
        return hmac.compare_digest(proof.encode(), auth.mac.encode("utf-8", "surrogateescape"))

    def _token_matches(self, token: str) -> bool:
        return self._token is not None and hmac.compare_digest(self._token, token.encode("utf-8", "surrogateescape"))
