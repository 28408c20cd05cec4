"""Status: how the world, its engine and its guests are, and what was assumed about its map.

The short state goes to all visitors a few times a second, and only if it changed. The long lists (findings,
assumptions, what became of each spawn) are asked for by whoever looks at them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import msgspec

from mindstage.knowledge import Severity
from mindstage.knowledge.names import local_name
from mindstage.stage import ConnectedClient, EngineStats, Simulation, StateSnapshot
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.visitor import ClientSession
from mindstage.viewport.worlddesk import EmptyRequest

__all__ = ["ReportEntry", "ReportGroup", "ReportMessage", "StatusHandler", "StatusMessage"]

_MAX_ENTRIES = 5000
"""So many entries a page gets at once; how many there are it is told besides."""
_PUBLISH_INTERVAL_S = 0.5
"""Nobody reads numbers faster."""
_CLIENTS_INTERVAL_S = 2.0


class StatusMessage(msgspec.Struct, frozen=True, kw_only=True):
    """What is always in view."""

    engine: str
    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    fault: str
    bodies: int
    statistics: EngineStats | None
    """None where the engine does not say."""
    clients: tuple[ConnectedClient, ...]
    browsers: int
    report: int
    """Counts up when the report is another."""
    errors: int
    """Things of the map that are not there, and what could not be spawned."""
    warnings: int
    assumptions: int


class ReportGroup(msgspec.Struct, frozen=True):
    """A group of entries, as people call it."""

    name: str
    count: int


class ReportEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was found, assumed or decided."""

    group: str
    text: str
    ids: tuple[str, ...] = ()
    """Bodies that it is about."""
    is_error: bool = False
    """Whether something is missing because of it."""


class ReportMessage(msgspec.Struct, frozen=True, kw_only=True):
    """All of them, the gravest first."""

    groups: tuple[ReportGroup, ...]
    entries: tuple[ReportEntry, ...]
    total: int


class StatusHandler:
    """Tells the channel's visitors how things are."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Offers `status.report`, and publishes `status` whenever it is told of a frame.

        Args:
            stage: whose status it is.
            channel: to the pages.
        """
        self._simulation, self._channel = simulation, channel
        self._due = self._clients_due = 0.0
        self._clients: tuple[ConnectedClient, ...] = ()
        self._last_message: tuple[object, str] = ((), "")
        self._last_report_key: object = None
        self._counts: tuple[int, int, int, int] = (0, 0, 0, 0)
        channel.register("status.report", EmptyRequest, self._get_report, queue="status")

    def publish(self, frame: StateSnapshot) -> None:
        """Publishes the state, if it is time, or bodies came or went, or the world came to a stop."""
        now = time.monotonic()
        if now < self._due and self._last_message[0] is frame.ids and self._last_message[1] == frame.error:
            return
        self._due, self._last_message = now + _PUBLISH_INTERVAL_S, (frame.ids, frame.error)
        if now >= self._clients_due:
            self._clients, self._clients_due = self._simulation.clients.clients(), now + _CLIENTS_INTERVAL_S
        self._update_report()
        self._channel.publish("status", self._message(frame))

    def _update_report(self) -> None:
        """Looks again at what there is to report, if there may be more or less of it."""
        knowledge = self._simulation.knowledge
        now = (self._simulation.reports, knowledge.findings(), len(knowledge.assumptions()))
        if now != self._last_report_key:
            self._last_report_key = now
            entries = list(report_entries(self._simulation))
            grave = sum(entry.is_error for entry in entries)
            assumed = sum(entry.group == _ASSUMPTION for entry in entries)
            self._counts = (self._counts[0] + 1, grave, len(entries) - grave - assumed, assumed)

    def _message(self, frame: StateSnapshot) -> StatusMessage:
        report, errors, warnings, assumptions = self._counts
        return StatusMessage(
            engine=self._simulation.engine_name,
            time_s=round(frame.time_s, 1),
            playing=frame.playing,
            speed=frame.speed,
            real_time_factor=round(frame.real_time_factor, 2),
            fault=frame.error,
            bodies=len(frame.ids),
            statistics=frame.stats,
            clients=self._clients,
            browsers=len(self._channel.sessions),
            report=report,
            errors=errors,
            warnings=warnings,
            assumptions=assumptions,
        )

    def _get_report(self, _: ClientSession, __: EmptyRequest) -> ReportMessage:
        return simulation_report(self._simulation)


_MAP_ERROR = "map error"
_MAP_WARNING = "map warning"
_NOT_SPAWNED = "not spawned"
_ASSUMPTION = "assumption"


def simulation_report(simulation: Simulation) -> ReportMessage:
    """All that is to be told about what is on a stage."""
    entries = sorted(report_entries(simulation), key=lambda entry: not entry.is_error)
    counts = dict.fromkeys((entry.group for entry in entries), 0)
    for entry in entries:
        counts[entry.group] += 1
    groups = tuple(ReportGroup(name, count) for name, count in counts.items())
    return ReportMessage(groups=groups, entries=tuple(entries[:_MAX_ENTRIES]), total=len(entries))


def report_entries(simulation: Simulation) -> Iterator[ReportEntry]:
    """What was found odd in the maps, assumed about them, and decided when they were spawned."""
    by_iri = {str(body.iri): body.id for world in simulation.worlds for body in world.bodies}
    for finding in simulation.knowledge.findings():
        grave = finding.severity is Severity.ERROR
        about = ", ".join(local_name(name) for name in (finding.individual, finding.property) if name)
        text = f"{about}: {finding.problem}; {finding.action}"
        ids = (by_iri[finding.individual],) if finding.individual in by_iri else ()
        yield ReportEntry(group=_MAP_ERROR if grave else _MAP_WARNING, text=text, ids=ids, is_error=grave)
    for assumption in simulation.knowledge.assumptions():
        how = "set" if assumption.overridden else "assumed"
        text = f"{local_name(assumption.map)}: {assumption.topic} {how} to {assumption.value}, {assumption.evidence}"
        yield ReportEntry(group=_ASSUMPTION, text=text)
    for report in simulation.reports:
        for failure in (*report.failed_bodies, *report.failed_joints, *report.failed_attachments):
            yield ReportEntry(group=_NOT_SPAWNED, text=f"{failure.id}: {failure.reason}", is_error=True)
        for note in report.notes:
            yield ReportEntry(group=note.kind.value, text=note.text, ids=note.ids)
