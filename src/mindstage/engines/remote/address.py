"""Address: where a far engine is, as people type it: `ros://HOST:PORT/NAMESPACE?token=…`.

Only the host must be there. The port is rosbridge's 9090, the namespace Unreal's plugin's, and the profile is found
out by asking.
"""

from __future__ import annotations

from enum import StrEnum
from urllib.parse import SplitResult, parse_qs, quote, unquote, urlsplit

import msgspec

from mindstage.errors import EngineUnavailableError

__all__ = ["SCHEME", "RemoteProfile", "RemoteUrl"]

SCHEME = "ros://"
_FORMAT_HINT = f"write {SCHEME}HOST:PORT/NAMESPACE, with ?token=… where one is needed"


class RemoteProfile(StrEnum):
    """Which services a far engine offers."""

    MINDSTAGE = "mindstage"
    """Another Mindstage: the whole contract, and nothing is lost on the way."""
    UNREAL = "unreal"
    """Unreal's plugin UROSWorldControl, or whoever speaks like it: what `world_control_msgs` has, and no more."""


class RemoteUrl(msgspec.Struct, frozen=True, kw_only=True):
    """A rosbridge, and the namespace at it."""

    host: str
    port: int = 9090
    namespace: str = "unreal"
    token: str = ""
    profile: RemoteProfile | None = None
    """None where the far side shall be asked."""

    @classmethod
    def parse(cls, text: str) -> RemoteUrl:
        """Reads what was typed.

        Raises:
            EngineUnavailableError: it is no such address.
        """
        parts = _split(text)
        asked = _parse_query(text, parts.query)
        profile = asked.get("profile")
        if profile is not None and profile not in {each.value for each in RemoteProfile}:
            known = " or ".join(each.value for each in RemoteProfile)
            raise EngineUnavailableError(
                _without_query(text), cause=f"no profile {profile!r}", remedy=f"choose {known}"
            )
        return cls(
            host=parts.hostname or "",
            port=9090 if parts.port is None else parts.port,
            namespace=unquote(parts.path).strip("/") or "unreal",
            token=asked.get("token", ""),
            profile=None if profile is None else RemoteProfile(profile),
        )

    @property
    def url(self) -> str:
        """Of the websocket, without the token."""
        return f"ws://{self._authority}"

    def __str__(self) -> str:
        """As it may be shown: without the token."""
        return f"{SCHEME}{self._authority}/{quote(self.namespace)}"

    @property
    def _authority(self) -> str:
        return f"{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def _split(text: str) -> SplitResult:
    try:
        parts = urlsplit(text)
        _ = parts.port  # is read only now, and refused only now
    except ValueError as error:
        raise EngineUnavailableError(
            _without_query(text), cause=f"it is no address: {error}", remedy=_FORMAT_HINT
        ) from error
    if f"{parts.scheme}://" != SCHEME or not parts.hostname or "@" in parts.netloc:
        raise EngineUnavailableError(_without_query(text), cause="it is no address", remedy=_FORMAT_HINT)
    return parts


def _parse_query(text: str, query: str) -> dict[str, str]:
    """What stands behind the question mark."""
    asked = parse_qs(query, keep_blank_values=True)
    unknown = [key for key in asked if key not in {"token", "profile"}]
    if unknown:
        cause = f"an address has no {unknown[0]!r}"
        raise EngineUnavailableError(_without_query(text), cause=cause, remedy="there is token and profile")
    return {key: values[-1] for key, values in asked.items()}


def _without_query(text: str) -> str:
    """What was typed, without what may be secret in it."""
    return text.partition("?")[0]
