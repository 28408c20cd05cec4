"""Events as they are detected: each gets an id, a begin and an end, and is reported once when it begins and ends.

Relations such as a contact come and go from frame to frame. `RelationLog` makes events of them: it drops those that are
shorter than a minimum, and joins those that are divided by a shorter gap.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from msgspec.structs import replace

from mindstage.episodes.recording import EpisodeEvent, EpisodeEventKind, EventState

__all__ = ["EventLog", "RelationLog"]

Key = TypeVar("Key", bound=Hashable)


class EventLog:
    """All events of an episode, and those that changed since they were last taken."""

    def __init__(self) -> None:
        self._events: dict[str, EpisodeEvent] = {}
        self._changed: dict[str, None] = {}
        self._counts: Counter[EpisodeEventKind] = Counter()
        self.is_final = False
        """Whether nothing follows, so that the events are final."""

    def add(self, kind: EpisodeEventKind, begin_s: float, end_s: float | None = None, **fields: Any) -> str:
        """Adds an event and returns its id."""
        self._counts[kind] += 1
        id = f"{kind.value}_{self._counts[kind]}"
        self._events[id] = EpisodeEvent(
            id=id, kind=kind, begin_s=begin_s, end_s=end_s, state=EventState.PROVISIONAL, **fields
        )
        self._changed[id] = None
        return id

    def end(self, id: str, end_s: float, **fields: Any) -> None:
        """Ends an event, not before it began, and replaces other fields of it."""
        event = self._events[id]
        self._events[id] = replace(event, end_s=max(end_s, event.begin_s), **fields)
        self._changed[id] = None

    def event(self, id: str) -> EpisodeEvent:
        """An event as it is now."""
        return self._events[id]

    def withdraw(self, id: str) -> None:
        """Takes back an event that turned out to be none."""
        self._events[id] = replace(self._events[id], state=EventState.WITHDRAWN)
        self._changed[id] = None

    def end_all(self, time_s: float, reason: str) -> None:
        """Ends all events that last, for a reason that is added to their evidence."""
        for id, event in tuple(self._events.items()):
            if event.end_s is None and event.state is not EventState.WITHDRAWN:
                self.end(id, time_s, evidence=(*event.evidence, reason))

    def take_changed(self) -> tuple[EpisodeEvent, ...]:
        """The events that began or ended since the last call, each as it is now."""
        changed, self._changed = self._changed, {}
        return tuple(self._events[id] for id in changed)

    @property
    def events(self) -> tuple[EpisodeEvent, ...]:
        """All events that were not withdrawn, in the order of their begin."""
        events = [event for event in self._events.values() if event.state is not EventState.WITHDRAWN]
        if self.is_final:
            events = [replace(event, state=EventState.FINAL) for event in events]
        return tuple(sorted(events, key=lambda event: event.begin_s))


@dataclass(slots=True)
class _Relation:
    begin_s: float
    end_s: float | None = None
    """When it ceased; None while it holds."""
    event: str | None = None
    """The id of its event; None until it has lasted long enough."""


class RelationLog(Generic[Key]):
    """Makes events of one kind from relations that begin and cease to hold."""

    def __init__(
        self,
        log: EventLog,
        kind: EpisodeEventKind,
        *,
        min_duration_s: float,
        describe: Callable[[Key], dict[str, Any]],
    ) -> None:
        """Creates a log without relations.

        Args:
            log: where the events are added.
            kind: the kind of all events.
            min_duration_s: shorter relations are dropped, and shorter gaps do not divide one [s].
            describe: the fields of the event of a relation, called when the event is added.
        """
        self._log = log
        self._kind = kind
        self._min_duration_s = min_duration_s
        self._describe = describe
        self._relations: dict[Key, _Relation] = {}
        self._unsettled: dict[Key, None] = {}
        """Those that may become an event, end or be dropped as time passes."""

    def begin(self, key: Key, time_s: float) -> None:
        """A relation holds from a time on; does nothing if it holds already."""
        relation = self._relations.get(key)
        if relation is not None and relation.end_s is not None and time_s - relation.end_s >= self._min_duration_s:
            self._close(key, relation)
            relation = None
        if relation is None:
            self._relations[key] = _Relation(time_s)
            self._unsettled[key] = None
        else:
            relation.end_s = None
            if relation.event is not None:
                self._unsettled.pop(key, None)

    def cease(self, key: Key, time_s: float, *, at_once: bool = False) -> None:
        """A relation holds no longer from a time on; does nothing if it did not hold.

        Args:
            key: the relation.
            time_s: when it ceased [s].
            at_once: whether it cannot go on after a gap, as after one of the bodies was put elsewhere.
        """
        relation = self._relations.get(key)
        if relation is None:
            return
        if relation.end_s is None:
            relation.end_s = max(time_s, relation.begin_s)
            self._unsettled[key] = None
        if at_once:
            self._close(key, relation)

    def holds(self, key: Key) -> bool:
        """Whether a relation holds, even if it has not lasted long enough yet."""
        relation = self._relations.get(key)
        return relation is not None and relation.end_s is None

    def begin_s(self, key: Key) -> float:
        """Since when a relation has held [s]; it must hold."""
        return self._relations[key].begin_s

    def settle(self, time_s: float) -> None:
        """Decides the relations that have held, or not held, for long enough at a time [s]."""
        for key in list(self._unsettled):
            relation = self._relations[key]
            if relation.end_s is None:
                if time_s - relation.begin_s >= self._min_duration_s - _ROUNDING_S:
                    relation.event = self._log.add(self._kind, relation.begin_s, **self._describe(key))
                    del self._unsettled[key]
            elif time_s - relation.end_s >= self._min_duration_s - _ROUNDING_S:
                self._close(key, relation)

    def finish(self) -> None:
        """Ends the relations that had ceased when the recording ended."""
        for key in list(self._unsettled):
            relation = self._relations[key]
            if relation.end_s is not None:
                self._close(key, relation)

    def _close(self, key: Key, relation: _Relation) -> None:
        assert relation.end_s is not None
        del self._relations[key]
        self._unsettled.pop(key, None)
        if relation.event is not None:
            self._log.end(relation.event, relation.end_s)
        elif relation.end_s - relation.begin_s >= self._min_duration_s - _ROUNDING_S:
            self._log.add(self._kind, relation.begin_s, relation.end_s, **self._describe(key))


_ROUNDING_S = 1e-6
