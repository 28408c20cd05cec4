"""std_srvs: services that do something and say whether it worked."""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from mindstage.msgs.message import Message, Service
from mindstage.msgs.primitives import Bool, String

__all__ = ["Empty", "SetBool", "Trigger"]


class Empty(Service):
    """Does something that cannot fail."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        pass


class SetBool(Service):
    """Switches something on or off."""

    class Request(Message, frozen=True):
        data: Bool = False

    class Response(Message, frozen=True):
        success: Bool = False
        message: String = ""


class Trigger(Service):
    """Does something, and says whether it worked."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        success: Bool = False
        message: String = ""
