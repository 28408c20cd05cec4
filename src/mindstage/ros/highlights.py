"""Highlights: a message lights bodies up, whether or not anyone listens, and tells why."""

from __future__ import annotations

from mindstage.bridge.description import color_from_message, color_message
from mindstage.msgs import mindstage_msgs
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.stage import Simulation, StateSnapshot

__all__ = ["HighlightSubscriber", "highlight_groups"]


class HighlightSubscriber:
    """Shows on a stage what messages want lit."""

    def __init__(self, simulation: Simulation, diagnostics: DiagnosticsPublisher) -> None:
        self._simulation = simulation
        self._diagnostics = diagnostics

    def on_highlight(self, message: mindstage_msgs.LitBodies) -> None:
        """Lights up what has a body; what has none is told on the diagnostics."""
        color = color_from_message(message.color) if message.color.a > 0.0 else None
        shown = self._simulation.highlight(message.ids, color, label=message.label, missing_ok=True)
        self._diagnostics.report_failures("highlight", [(each.id, each.reason) for each in shown.unhighlighted])


def highlight_groups(frame: StateSnapshot) -> mindstage_msgs.LitGroups:
    """All that is lit in a frame."""
    groups = (
        mindstage_msgs.LitBodies(ids=group.ids, color=color_message(group.color), label=group.label)
        for group in frame.highlight_groups
    )
    return mindstage_msgs.LitGroups(groups=tuple(groups))
