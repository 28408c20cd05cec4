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
from mindstage.stage import Frame, Guest, Stage, Statistics
from mindstage.viewport.channel import Channel
from mindstage.viewport.visitor import Visitor
from mindstage.viewport.worlddesk import Nothing

__all__ = ["Entry", "EntryKind", "Report", "State", "StatusDesk"]

_MOST_ENTRIES = 5000
"""So many entries a page gets at once; how many there are it is told besides."""
_PERIOD_S = 0.5
"""Nobody reads numbers faster."""
_GUESTS_S = 2.0


class State(msgspec.Struct, frozen=True, kw_only=True):
    """What is always in view."""

    engine: str
    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    fault: str
    bodies: int
    statistics: Statistics | None
    """None where the engine does not say."""
    clients: tuple[Guest, ...]
    browsers: int
    report: int
    """Counts up when the report is another."""
    errors: int
    """Things of the map that are not there, and what could not be spawned."""
    warnings: int
    assumptions: int


class EntryKind(msgspec.Struct, frozen=True):
    """A group of entries, as people call it."""

    name: str
    count: int


class Entry(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was found, assumed or decided."""

    group: str
    text: str
    ids: tuple[str, ...] = ()
    """Bodies that it is about."""
    is_error: bool = False
    """Whether something is missing because of it."""


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """All of them, the gravest first."""

    groups: tuple[EntryKind, ...]
    entries: tuple[Entry, ...]
    total: int


class StatusDesk:
    """Tells the channel's visitors how things are."""

    def __init__(self, stage: Stage, channel: Channel) -> None:
        """Offers `status.report`, and publishes `status` whenever it is told of a frame.

        Args:
            stage: whose status it is.
            channel: to the pages.
        """
        self._stage, self._channel = stage, channel
        self._due = self._guests_due = 0.0
        self._guests: tuple[Guest, ...] = ()
        self._told: tuple[object, str] = ((), "")
        self._reported: object = None
        self._counted: tuple[int, int, int, int] = (0, 0, 0, 0)
        channel.offer("status.report", Nothing, self._tell_report, lane="status")

    def tell(self, frame: Frame) -> None:
        """Publishes the state, if it is time, or bodies came or went, or the world came to a stop."""
        now = time.monotonic()
        if now < self._due and self._told[0] is frame.ids and self._told[1] == frame.fault:
            return
        self._due, self._told = now + _PERIOD_S, (frame.ids, frame.fault)
        if now >= self._guests_due:
            self._guests, self._guests_due = self._stage.company.guests(), now + _GUESTS_S
        self._count()
        self._channel.publish("status", self._state(frame))

    def _count(self) -> None:
        """Looks again at what there is to report, if there may be more or less of it."""
        knowledge = self._stage.knowledge
        now = (self._stage.reports, knowledge.findings(), len(knowledge.assumptions()))
        if now != self._reported:
            self._reported = now
            entries = list(entries_about(self._stage))
            grave = sum(entry.is_error for entry in entries)
            assumed = sum(entry.group == _ASSUMED for entry in entries)
            self._counted = (self._counted[0] + 1, grave, len(entries) - grave - assumed, assumed)

    def _state(self, frame: Frame) -> State:
        report, errors, warnings, assumptions = self._counted
        return State(
            engine=self._stage.engine_name,
            time_s=round(frame.time_s, 1),
            playing=frame.playing,
            speed=frame.speed,
            real_time_factor=round(frame.real_time_factor, 2),
            fault=frame.fault,
            bodies=len(frame.ids),
            statistics=frame.statistics,
            clients=self._guests,
            browsers=len(self._channel.visitors),
            report=report,
            errors=errors,
            warnings=warnings,
            assumptions=assumptions,
        )

    def _tell_report(self, _: Visitor, __: Nothing) -> Report:
        return report_about(self._stage)


_MISSING = "map error"
_ODD = "map warning"
_FAILED = "not spawned"
_ASSUMED = "assumption"


def report_about(stage: Stage) -> Report:
    """All that is to be told about what is on a stage."""
    entries = sorted(entries_about(stage), key=lambda entry: not entry.is_error)
    counts = dict.fromkeys((entry.group for entry in entries), 0)
    for entry in entries:
        counts[entry.group] += 1
    groups = tuple(EntryKind(name, count) for name, count in counts.items())
    return Report(groups=groups, entries=tuple(entries[:_MOST_ENTRIES]), total=len(entries))


def entries_about(stage: Stage) -> Iterator[Entry]:
    """What was found odd in the maps, assumed about them, and decided when they were spawned."""
    by_iri = {str(body.iri): body.id for world in stage.worlds for body in world.bodies}
    for finding in stage.knowledge.findings():
        grave = finding.severity is Severity.ERROR
        about = ", ".join(local_name(name) for name in (finding.individual, finding.property) if name)
        text = f"{about}: {finding.what}; {finding.did}"
        ids = (by_iri[finding.individual],) if finding.individual in by_iri else ()
        yield Entry(group=_MISSING if grave else _ODD, text=text, ids=ids, is_error=grave)
    for assumption in stage.knowledge.assumptions():
        how = "set" if assumption.overridden else "assumed"
        text = f"{local_name(assumption.map)}: {assumption.about} {how} to {assumption.value}, {assumption.evidence}"
        yield Entry(group=_ASSUMED, text=text)
    for report in stage.reports:
        for failure in (*report.failed_bodies, *report.failed_constraints, *report.failed_attachments):
            yield Entry(group=_FAILED, text=f"{failure.id}: {failure.reason}", is_error=True)
        for note in report.notes:
            yield Entry(group=note.kind.value, text=note.text, ids=note.ids)
