"""Diagnostics: what the world refused, why, and about which body; and how the engine is, like a heartbeat."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mindstage.bridge.description import Remark
from mindstage.engines import SpawnReport
from mindstage.errors import MindstageError, WorldError
from mindstage.msgs import builtin_interfaces, diagnostic_msgs, std_msgs
from mindstage.ros.outlet import Outlet
from mindstage.stage import Stage

__all__ = ["Diagnostics", "health"]


class Diagnostics:
    """Tells on `/mindstage/diagnostics` why something was refused or broke: some replies have no room for a reason."""

    def __init__(self, outlet: Outlet[diagnostic_msgs.DiagnosticArray], stage: Stage) -> None:
        self._outlet = outlet
        self._stage = stage

    def refused(self, what: str, error: WorldError) -> None:
        """The world says no."""
        facts = vars(error)
        about = str(facts.get("body") or facts.get("child") or "")
        self._tell([_status(diagnostic_msgs.Level.WARN, what, str(error), about, {"kind": type(error).__name__})])

    def broke(self, what: str, error: MindstageError) -> None:
        """The reason lies elsewhere."""
        self._tell([_status(diagnostic_msgs.Level.ERROR, what, str(error), "", {"kind": type(error).__name__})])

    def failed(self, what: str, reasons: Iterable[tuple[str, str]]) -> None:
        """Some of many things did not go: the id of each, and why."""
        self._tell([_status(diagnostic_msgs.Level.WARN, what, reason, id, {}) for id, reason in reasons])

    def spawned(self, what: str, report: SpawnReport) -> None:
        """What could not be spawned."""
        lists = (report.failed_bodies, report.failed_constraints, report.failed_attachments)
        self.failed(what, [(failure.id, failure.reason) for failures in lists for failure in failures])

    def remarked(self, what: str, remarks: Iterable[Remark]) -> None:
        """What was assumed on the way in."""
        told = ((remark, id) for remark in remarks for id in remark.ids)
        self._tell(
            [_status(diagnostic_msgs.Level.OK, what, remark.text, id, {"field": remark.field}) for remark, id in told]
        )

    def _tell(self, status: list[diagnostic_msgs.DiagnosticStatus]) -> None:
        if status:
            header = std_msgs.Header(stamp=builtin_interfaces.Time.at(self._stage.frame.time_s))
            self._outlet.publish(diagnostic_msgs.DiagnosticArray(header=header, status=tuple(status)))


def health(stage: Stage, *, took_s: float | None, trouble: MindstageError | None) -> diagnostic_msgs.DiagnosticArray:
    """How the engine is.

    Args:
        stage: whose.
        took_s: how long its answer took [s].
        trouble: why there was none.
    """
    frame = stage.frame
    if trouble is not None:
        level, text = diagnostic_msgs.Level.ERROR, str(trouble)
    elif frame.fault:
        level, text = diagnostic_msgs.Level.WARN, f"the world stands still: {frame.fault}"
    else:
        level, text = diagnostic_msgs.Level.OK, "playing" if frame.playing else "paused"
    values = {
        "time_s": f"{frame.time_s:.3f}",
        "bodies": str(len(frame.ids)),
        "speed": f"{frame.speed:g}",
        "real_time_factor": f"{frame.real_time_factor:.3f}",
        "answered_in_s": "" if took_s is None else f"{took_s:.6f}",
    }
    status = _status(level, f"engine {stage.engine_name}", text, "", values)
    return diagnostic_msgs.DiagnosticArray(
        header=std_msgs.Header(stamp=builtin_interfaces.Time.at(frame.time_s)), status=(status,)
    )


def _status(
    level: diagnostic_msgs.Level, what: str, text: str, about: str, values: Mapping[str, str]
) -> diagnostic_msgs.DiagnosticStatus:
    told = {"id": about, **values}
    return diagnostic_msgs.DiagnosticStatus(
        level=level,
        name=f"mindstage: {what}",
        message=text,
        hardware_id=about,
        values=tuple(diagnostic_msgs.KeyValue(key=key, value=value) for key, value in told.items()),
    )
