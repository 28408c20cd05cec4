"""diagnostic_msgs: how the parts of a system are."""

from __future__ import annotations

from mindstage.msgs.message import Message
from mindstage.msgs.primitives import String, Uint8Code
from mindstage.msgs.std_msgs import Header

__all__ = ["DiagnosticArray", "DiagnosticStatus", "KeyValue", "Level"]


class Level(Uint8Code):
    """How bad it is."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class KeyValue(Message, frozen=True):
    """One detail."""

    key: String = ""
    value: String = ""


class DiagnosticStatus(Message, frozen=True):
    """How one part is."""

    level: Level = Level.OK
    name: String = ""
    message: String = ""
    hardware_id: String = ""
    values: tuple[KeyValue, ...] = ()


class DiagnosticArray(Message, frozen=True):
    """How some parts are."""

    header: Header = Header()
    status: tuple[DiagnosticStatus, ...] = ()
