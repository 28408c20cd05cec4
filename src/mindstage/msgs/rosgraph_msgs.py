"""rosgraph_msgs: simulated time."""

from __future__ import annotations

from mindstage.msgs.builtin_interfaces import Time
from mindstage.msgs.message import Message

__all__ = ["Clock"]


class Clock(Message, frozen=True):
    """What time it is in the simulation."""

    clock: Time = Time()
