"""Errors of a bridge: whoever is at its other end, or on the way there."""

from __future__ import annotations

from collections.abc import Iterable

from mindstage.errors.hints import also, near, near_names
from mindstage.errors.root import MindstageError

__all__ = [
    "AccessRefused",
    "BridgeError",
    "BridgeUnavailable",
    "ConnectionLost",
    "MessageRefused",
    "OfferRefused",
    "ServiceFailed",
    "ServiceTimedOut",
    "ServiceUnknown",
    "TypeUnknown",
]


class BridgeError(MindstageError):
    """The reason lies at the other end of a bridge, or on the way there."""


class BridgeUnavailable(BridgeError):
    """Nobody can be served at the address that was asked for."""

    def __init__(self, host: str, port: int, *, cause: str) -> None:
        self.host = host
        self.port = port
        self.cause = cause
        super().__init__(host, port)

    def __str__(self) -> str:
        where = f"{self.host}, port {self.port}"
        return f"the bridge cannot be served at {where}: {self.cause}; try 127.0.0.1 or another port"


class AccessRefused(BridgeError):
    """A token is needed, and none was given or another one."""

    def __init__(self, where: str, *, cause: str) -> None:
        self.where = where
        self.cause = cause
        super().__init__(where)

    def __str__(self) -> str:
        return f"no access to {self.where}: {self.cause}"


class ConnectionLost(BridgeError):
    """Nobody is at the other end, or nobody any more; whether what was asked was done there, nobody knows."""

    def __init__(self, where: str, *, cause: str) -> None:
        self.where = where
        self.cause = cause
        super().__init__(where)

    def __str__(self) -> str:
        return f"no connection to {self.where}: {self.cause}"


class ServiceUnknown(BridgeError):
    """Nobody offers a service, or an action, of that name."""

    def __init__(self, service: str, *, known: Iterable[str] = ()) -> None:
        self.service = service
        self.near = near(service, known)
        super().__init__(service)

    def __str__(self) -> str:
        # rosbridge's own words, by which its clients know what happened.
        return f"Service {self.service} does not exist{also(near_names(self.near))}"


class ServiceTimedOut(BridgeError):
    """A service did not answer, or an action did not end, in time."""

    def __init__(self, service: str, *, timeout_s: float) -> None:
        self.service = service
        self.timeout_s = timeout_s
        super().__init__(service)

    def __str__(self) -> str:
        return f"{self.service} did not answer within {self.timeout_s:g} s; give it more time, or ask whether it lives"


class ServiceFailed(BridgeError):
    """A service, or an action, could not do what it was asked for, for a reason that lies outside of the world."""

    def __init__(self, service: str, *, cause: str) -> None:
        self.service = service
        self.cause = cause
        super().__init__(service)

    def __str__(self) -> str:
        return f"{self.service} failed: {self.cause}"


class OfferRefused(BridgeError):
    """A service, action or topic cannot be offered under that name."""

    def __init__(self, name: str, *, cause: str) -> None:
        self.name = name
        self.cause = cause
        super().__init__(name)

    def __str__(self) -> str:
        return f"{self.name!r} cannot be offered: {self.cause}"


class MessageRefused(BridgeError):
    """A message has not the form that its type promises."""

    def __init__(self, what: str, *, path: str = "", cause: str, remedy: str = "", id: str | int | None = None) -> None:
        self.what = what
        self.path = path
        """Where in the message, such as `models[3].pose.position.x`."""
        self.cause = cause
        self.remedy = remedy
        self.id = id
        """The message's own id on the wire, where it could be read."""
        super().__init__(what)

    def __str__(self) -> str:
        where = f"{self.path}: " if self.path else ""
        return f"{self.what}: {where}{self.cause}{also(self.remedy)}"


class TypeUnknown(BridgeError):
    """No message, service or action is defined under that name."""

    def __init__(self, name: str, *, kind: str, known: Iterable[str] = ()) -> None:
        self.name = name
        self.kind = kind
        self.near = near(name, known)
        super().__init__(name)

    def __str__(self) -> str:
        return f"no {self.kind} type {self.name!r} is known{also(near_names(self.near))}"
