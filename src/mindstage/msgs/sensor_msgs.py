"""sensor_msgs: joints, and the picture that a marker may carry."""

from __future__ import annotations

from mindstage.msgs.message import Message
from mindstage.msgs.primitives import Bytes, Float64, String
from mindstage.msgs.std_msgs import Header

__all__ = ["CompressedImage", "JointState"]


class JointState(Message, frozen=True):
    """Where joints stand; each list is empty or as long as the names."""

    header: Header = Header()
    name: tuple[String, ...] = ()
    position: tuple[Float64, ...] = ()
    """[rad] or [m]."""
    velocity: tuple[Float64, ...] = ()
    effort: tuple[Float64, ...] = ()


class CompressedImage(Message, frozen=True):
    """A picture as a file's content."""

    header: Header = Header()
    format: String = ""
    data: Bytes = b""
