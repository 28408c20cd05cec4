"""tf2_msgs: the tree of frames."""

from __future__ import annotations

from mindstage.msgs.geometry_msgs import TransformStamped
from mindstage.msgs.message import Message

__all__ = ["TFMessage"]


class TFMessage(Message, frozen=True):
    """Some edges of the tree."""

    transforms: tuple[TransformStamped, ...] = ()
