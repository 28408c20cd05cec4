"""builtin_interfaces: a moment and a span of time, in both spellings."""

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.message import Message
from mindstage.msgs.primitives import Int32, Uint32

__all__ = ["Duration", "Time"]

ROS1_NAMES = {"sec": "secs", "nanosec": "nsecs"}
BILLION = 1_000_000_000


class Time(Message, frozen=True):
    """A moment: {sec, nanosec} in ROS 2, {secs, nsecs} in ROS 1."""

    ros1_names: ClassVar = ROS1_NAMES

    sec: Int32 = 0
    nanosec: Uint32 = 0

    @classmethod
    def at(cls, time_s: float) -> Time:
        """The moment so many seconds after time began; a number carries about 0.1 us over decades."""
        seconds, rest = divmod(round(time_s * BILLION), BILLION)
        return cls(sec=seconds, nanosec=rest)

    @property
    def seconds(self) -> float:
        """As one number [s]."""
        return self.sec + self.nanosec / BILLION


class Duration(Message, frozen=True):
    """A span of time: {sec, nanosec} in ROS 2, {secs, nsecs} in ROS 1, where the second may be negative too."""

    ros1_names: ClassVar = ROS1_NAMES

    sec: Int32 = 0
    nanosec: Int32 = 0

    @property
    def seconds(self) -> float:
        """As one number [s]."""
        return self.sec + self.nanosec / BILLION
