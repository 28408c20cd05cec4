"""Diagnostics: what the world refused, why, and about which body; and how the engine is, like a heartbeat."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mindstage.bridge.description import ConversionNote
from mindstage.engines import SpawnReport
from mindstage.errors import MindstageError, WorldError
from mindstage.msgs import builtin_interfaces, diagnostic_msgs, std_msgs
from mindstage.ros.outlet import Publisher
from mindstage.stage import Simulation

__all__ = ["DiagnosticsPublisher", "health_status"]


class DiagnosticsPublisher:
    """Tells on `/mindstage/diagnostics` why something was refused or broke: some replies have no room for a reason."""

    def __init__(self, publisher: Publisher[diagnostic_msgs.DiagnosticArray], simulation: Simulation) -> None:
        self._publisher = publisher
        self._simulation = simulation

    def report_refusal(self, operation: str, error: WorldError) -> None:
        """The world says no."""
        facts = vars(error)
        about = str(facts.get("body") or facts.get("child") or "")
        self._publish([_status(diagnostic_msgs.Level.WARN, operation, str(error), about, {"kind": error.code})])

    def report_error(self, operation: str, error: MindstageError) -> None:
        """The reason lies elsewhere."""
        self._publish([_status(diagnostic_msgs.Level.ERROR, operation, str(error), "", {"kind": error.code})])

    def report_failures(self, operation: str, reasons: Iterable[tuple[str, str]]) -> None:
        """Some of many things did not go: the id of each, and why."""
        self._publish([_status(diagnostic_msgs.Level.WARN, operation, reason, id, {}) for id, reason in reasons])

    def report_spawn(self, operation: str, report: SpawnReport) -> None:
        """What could not be spawned."""
        lists = (report.failed_bodies, report.failed_joints, report.failed_attachments)
        self.report_failures(operation, [(failure.id, failure.reason) for failures in lists for failure in failures])

    def report_notes(self, operation: str, notes: Iterable[ConversionNote]) -> None:
        """What was assumed on the way in."""
        told = ((remark, id) for remark in notes for id in remark.ids)
        self._publish(
            [
                _status(diagnostic_msgs.Level.OK, operation, remark.text, id, {"field": remark.field})
                for remark, id in told
            ]
        )

    def _publish(self, status: list[diagnostic_msgs.DiagnosticStatus]) -> None:
        if status:
            header = std_msgs.Header(stamp=builtin_interfaces.Time.at(self._simulation.state.time_s))
            self._publisher.publish(diagnostic_msgs.DiagnosticArray(header=header, status=tuple(status)))


def health_status(
    simulation: Simulation, *, response_time_s: float | None, error: MindstageError | None
) -> diagnostic_msgs.DiagnosticArray:
    """How the engine is.

    Args:
        stage: whose.
        took_s: how long its answer took [s].
        trouble: why there was none.
    """
    frame = simulation.state
    if error is not None:
        level, text = diagnostic_msgs.Level.ERROR, str(error)
    elif frame.error:
        level, text = diagnostic_msgs.Level.WARN, f"the world stands still: {frame.error}"
    else:
        level, text = diagnostic_msgs.Level.OK, "playing" if frame.playing else "paused"
    values = {
        "time_s": f"{frame.time_s:.3f}",
        "bodies": str(len(frame.ids)),
        "speed": f"{frame.speed:g}",
        "real_time_factor": f"{frame.real_time_factor:.3f}",
        "answered_in_s": "" if response_time_s is None else f"{response_time_s:.6f}",
    }
    status = _status(level, f"engine {simulation.engine_name}", text, "", values)
    return diagnostic_msgs.DiagnosticArray(
        header=std_msgs.Header(stamp=builtin_interfaces.Time.at(frame.time_s)), status=(status,)
    )


def _status(
    level: diagnostic_msgs.Level, name: str, text: str, ids: str, values: Mapping[str, str]
) -> diagnostic_msgs.DiagnosticStatus:
    told = {"id": ids, **values}
    return diagnostic_msgs.DiagnosticStatus(
        level=level,
        name=f"mindstage: {name}",
        message=text,
        hardware_id=ids,
        values=tuple(diagnostic_msgs.KeyValue(key=key, value=value) for key, value in told.items()),
    )
