"""Highlights: a message lights bodies up, whether or not anyone listens, and tells why."""

from __future__ import annotations

from mindstage.bridge.description import colour_from, colour_message
from mindstage.msgs import mindstage_msgs
from mindstage.ros.diagnostics import Diagnostics
from mindstage.stage import Frame, Stage

__all__ = ["Highlights", "lit_groups"]


class Highlights:
    """Shows on a stage what messages want lit."""

    def __init__(self, stage: Stage, diagnostics: Diagnostics) -> None:
        self._stage = stage
        self._diagnostics = diagnostics

    def on_highlight(self, message: mindstage_msgs.LitBodies) -> None:
        """Lights up what has a body; what has none is told on the diagnostics."""
        colour = colour_from(message.color) if message.color.a > 0.0 else None
        shown = self._stage.highlight(message.ids, colour, label=message.label, missing_ok=True)
        self._diagnostics.failed("highlight", [(each.id, each.reason) for each in shown.not_lit])


def lit_groups(frame: Frame) -> mindstage_msgs.LitGroups:
    """All that is lit in a frame."""
    groups = (
        mindstage_msgs.LitBodies(ids=group.ids, color=colour_message(group.colour), label=group.label)
        for group in frame.lit
    )
    return mindstage_msgs.LitGroups(groups=tuple(groups))
