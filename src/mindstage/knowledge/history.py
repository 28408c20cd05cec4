"""What questions use of the past: the state of a world at any time, and the events that happened.

`History` is the past of one world, such as a recorded episode, and `EpisodeSource` is one or many of them. The package
`episodes` provides both. Times are seconds since the begin of an episode. A state lasts until the next one begins, and
the last one also at the end of the episode.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from operator import is_
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import msgspec
from msgspec.structs import replace

from mindstage.errors import InvalidArgumentError
from mindstage.ranges import Time, check_fields, check_number, declared_range
from mindstage.scene import NO_GEOMETRY, Body, BodyId, GeometryMap, Iri, World

if TYPE_CHECKING:  # many questions use no state
    from mindstage.scene.bounding_boxes import Indices
    from mindstage.scene.joint_kinematics import RigidGroups
    from mindstage.scene.spatial import SpatialRelations

__all__ = [
    "MAP_SOURCE",
    "NOW",
    "EpisodeSource",
    "EventFilter",
    "History",
    "PastEvent",
    "QuestionTime",
    "SingleEpisode",
    "WorldState",
    "histories_of",
    "time_arguments",
]

MAP_SOURCE = "map"
"""The `WorldState.source` of a map that no engine simulates."""
T = TypeVar("T")
_MIN_MOVED, _MOVED_SHARE = 64, 8
"""What was derived is made anew if more than 64 bodies, and more than one of 8, have moved."""
_TIME_WORDS = ("at", "during", "since", "until", "episode")


class WorldState(msgspec.Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """The state of a scene at one point in time."""

    world: World
    """All entities in their current state."""
    spawned: tuple[World, ...]
    """The same entities as they were spawned, one world per map."""
    joint_positions: Mapping[BodyId, tuple[float, ...]] | None = None
    """Displacement of each joint since then: x, y, z [m], twist, swing2, swing1 [rad]; None if it is unknown."""
    source: str = MAP_SOURCE
    """Where the state comes from: the name of the engine, or "map"."""
    geometry: GeometryMap = NO_GEOMETRY
    """The collision shapes and support surfaces of its bodies; those without an entry are boxes."""
    touching: Collection[tuple[BodyId, BodyId]] | None = None
    """The pairs of bodies that touch, each once; None if contacts are unknown."""

    @property
    def shape_source(self) -> str:
        """Where the state and the shapes of its bodies come from."""
        return self.source if self.geometry else f"{self.source}, bounding boxes"

    @property
    def map_of_body(self) -> Mapping[BodyId, Iri]:
        """The map that each body came from."""
        return self.derived(_map_of_body)

    @property
    def id_of_iri(self) -> Mapping[Iri, BodyId]:
        """The body of each individual; the last one of several."""
        return self.derived(_id_of_iri)

    @property
    def row_of_id(self) -> Mapping[BodyId, int]:
        """The place of each body in the world."""
        return self.derived(_row_of_id)

    @property
    def individuals(self) -> Mapping[str, Iri]:
        """The individual of each body, by its id and its IRI."""
        return self.derived(_individuals)

    @property
    def rigid_groups(self) -> RigidGroups:
        """The groups of bodies that attachments connect."""
        return self.derived(_rigid_groups)

    @property
    def relations(self) -> SpatialRelations:
        """The spatial relations of the bodies."""
        return self.derived(_relations, _moved_relations)

    def derived(self, make: Callable[[WorldState], T], moved: Callable[[T, WorldState, Indices], T] | None = None) -> T:
        """An object that is made of this state, which is kept, and must not be changed.

        Args:
            make: makes it.
            moved: makes it of that of an earlier state, this state, and the rows of the bodies that have moved since.
                Without it the object does not depend on poses.
        """
        kept: dict[object, T] = self.__dict__.setdefault("_derived", {})
        if make not in kept:
            earlier: tuple[T, Indices] | None = self.__dict__.get("_earlier", {}).get(make)
            if earlier is None:
                kept[make] = make(self)
            else:
                kept[make] = earlier[0] if moved is None else moved(earlier[0], self, earlier[1])
        return kept[make]

    def moved_rows(self, earlier: WorldState) -> Indices | None:
        """The rows of the bodies that are elsewhere than in an earlier state; None if more than poses has changed."""
        import numpy as np

        now, then = self.world, earlier.world
        if len(now.bodies) != len(then.bodies) or len(now.joints) != len(then.joints):
            return None
        rows = _different_rows(now.bodies, then.bodies)
        moved = (*((now.bodies[row], then.bodies[row]) for row in rows),)
        joints = ((now.joints[row], then.joints[row]) for row in _different_rows(now.joints, then.joints))
        others = [
            getattr(now, name) == getattr(then, name)
            for name in now.__struct_fields__
            if name not in {"bodies", "joints"}
        ]
        is_motion = (
            all(others)
            and all(replace(body, pose=before.pose) == before for body, before in moved)
            and all(replace(joint, pose=before.pose) == before for joint, before in joints)
            and self.spawned == earlier.spawned
            and (self.source, self.touching) == (earlier.source, earlier.touching)
            and _has_same_values(self.geometry, earlier.geometry)
        )
        return np.array(rows, dtype=np.intp) if is_motion else None

    def following(self, earlier: WorldState) -> WorldState:
        """This state, which takes over what was derived of an earlier one; the earlier one if nothing has changed."""
        import numpy as np

        rows = self.moved_rows(earlier)
        if rows is None:
            return self
        same_joints = (self.world.joints, self.joint_positions) == (earlier.world.joints, earlier.joint_positions)
        if not len(rows) and same_joints:
            return earlier
        older: Mapping[object, tuple[object, Indices]] = earlier.__dict__.get("_earlier", {})
        known = {make: (value, np.union1d(before, rows)) for make, (value, before) in older.items()}
        known |= {make: (value, rows) for make, value in list(earlier.__dict__.get("_derived", {}).items())}
        most = max(_MIN_MOVED, len(self.world.bodies) // _MOVED_SHARE)
        self.__dict__["_earlier"] = {make: each for make, each in known.items() if len(each[1]) <= most}
        return self


def _has_same_values(now: GeometryMap, then: GeometryMap) -> bool:
    return now is then or (now.keys() == then.keys() and all(value is then[id] for id, value in now.items()))


def _different_rows(now: Sequence[object], then: Sequence[object]) -> list[int]:
    if now is then:
        return []
    return [row for row, is_same in enumerate(map(is_, now, then)) if not is_same]


def _map_of_body(state: WorldState) -> Mapping[BodyId, Iri]:
    maps = {body.id: world.iri for world in reversed(state.spawned) for body in world.bodies}
    return MappingProxyType({body.id: maps.get(body.id, state.world.iri) for body in state.world.bodies})


def _id_of_iri(state: WorldState) -> Mapping[Iri, BodyId]:
    return MappingProxyType({body.iri: body.id for body in state.world.bodies})


def _row_of_id(state: WorldState) -> Mapping[BodyId, int]:
    return MappingProxyType({body.id: row for row, body in enumerate(state.world.bodies)})


def _individuals(state: WorldState) -> Mapping[str, Iri]:
    bodies = state.world.bodies
    by_id: dict[str, Iri] = {body.id: body.iri for body in reversed(bodies)}
    return MappingProxyType(by_id | {body.iri: body.iri for body in bodies})


def _rigid_groups(state: WorldState) -> RigidGroups:
    from mindstage.scene.joint_kinematics import RigidGroups

    return RigidGroups.from_world(state.world)


def _relations(state: WorldState) -> SpatialRelations:
    from mindstage.scene.spatial import SpatialRelations

    return SpatialRelations(state.world)


def _moved_relations(before: SpatialRelations, state: WorldState, rows: Indices) -> SpatialRelations:
    return before.moved(state.world, rows)


class PastEvent(msgspec.Struct, frozen=True, kw_only=True):
    """An event of an episode, with the individuals that took part in it."""

    episode: str
    id: str
    """Unique in the episode, such as "PickingUp_3"."""
    kind: str
    """The local name of its class, such as "PickingUp"."""
    begin_s: float
    end_s: float | None
    """None if it had not ended at the end of the episode."""
    episode_end_s: float
    thing: Iri
    other: Iri | None = None
    agent: str | None = None
    """What caused it: the IRI of a body, or the name of a client."""
    joint: Iri | None = None
    amount: float | None = None
    """See `EpisodeEvent.amount`."""
    evidence: tuple[str, ...] = ()


class EventFilter(msgspec.Struct, frozen=True, kw_only=True):
    """Which events are wanted; None stands for all."""

    kinds: frozenset[str] | None = None
    things: frozenset[Iri] | None = None
    """Individuals of which one must be the thing of the event."""
    episode: str | None = None
    begin_s: Time | None = None
    """Only events that last beyond, or until, this time [s]."""
    end_s: Time | None = None
    """Only events that have begun by this time [s]."""

    def __post_init__(self) -> None:
        check_fields(self)

    def accepts(self, event: PastEvent) -> bool:
        """Whether an event is wanted."""
        return (
            (self.kinds is None or event.kind in self.kinds)
            and (self.things is None or event.thing in self.things)
            and (self.episode is None or event.episode == self.episode)
            and (self.begin_s is None or event.end_s is None or event.end_s >= self.begin_s)
            and (self.end_s is None or event.begin_s <= self.end_s)
        )


class History(Protocol):
    """The past of one world."""

    @property
    def name(self) -> str:
        """The name of the episode."""

    @property
    def begin_s(self) -> float:
        """The time of the first state [s]."""

    @property
    def end_s(self) -> float:
        """The time of the last state [s]."""

    @property
    def start_unix_s(self) -> float | None:
        """The wall time at which the episode began, in seconds since 1970; None if it is unknown."""

    def state_at(self, time_s: float) -> WorldState:
        """The state at a time [s].

        Raises:
            EpisodeTimeError: the time is before the begin or after the end of the episode.
        """

    def states(self, begin_s: float | None = None, end_s: float | None = None) -> Iterator[tuple[float, WorldState]]:
        """The state at a time [s], and each later one until another time that differs from the one before it.

        Yields:
            The time at which the state begins, which is `begin_s` for the first one, and the state.

        Raises:
            EpisodeTimeError: a time is before the begin or after the end of the episode.
        """

    def events(self) -> Sequence[PastEvent]:
        """All events, in the order of their begin."""

    def edits(self) -> Sequence[tuple[float, str, str, tuple[Iri, ...]]]:
        """What was done to the world other than by physics: time [s], kind, client and individuals, in order."""

    def bodies(self) -> Sequence[Body]:
        """The bodies that exist at some time, each once."""

    def individuals(self) -> Mapping[str, Iri]:
        """The IRI of each body that exists at some time, by id and by IRI."""

    def resume(self, time_s: float) -> Any:
        """A new `Simulation` that continues from the state at a time [s]; the caller closes it."""


class EpisodeSource(Protocol):
    """One or many episodes."""

    def names(self) -> Sequence[str]:
        """The names of the episodes."""

    def history(self, name: str) -> History:
        """One episode."""

    def find_events(self, wanted: EventFilter) -> Iterable[PastEvent]:
        """Events of all episodes, in the order of episodes and of their begin."""

    def find_individual(self, name: str) -> Iri | None:
        """The IRI of a body that exists at some time in an episode, by IRI or id; None if there is none."""

    def individuals_of(self, classes: Collection[Iri]) -> Sequence[Iri]:
        """The bodies of some classes that exist at some time."""


class SingleEpisode:
    """An `EpisodeSource` with one episode."""

    def __init__(self, history: History) -> None:
        self._history = history

    def names(self) -> Sequence[str]:
        """See `EpisodeSource`."""
        return (self._history.name,)

    def history(self, name: str) -> History:
        """See `EpisodeSource`."""
        return self._history

    def find_events(self, wanted: EventFilter) -> Iterable[PastEvent]:
        """See `EpisodeSource`."""
        return (event for event in self._history.events() if wanted.accepts(event))

    def find_individual(self, name: str) -> Iri | None:
        """See `EpisodeSource`."""
        return self._history.individuals().get(name)

    def individuals_of(self, classes: Collection[Iri]) -> Sequence[Iri]:
        """See `EpisodeSource`."""
        return tuple(dict.fromkeys(body.iri for body in self._history.bodies() if body.cls in classes))


def histories_of(sources: Iterable[EpisodeSource], episode: str | None = None) -> list[History]:
    """The episodes of some sources, or the one with a name.

    Raises:
        InvalidArgumentError: there is none with that name.
    """
    listed = [(source, name) for source in sources for name in source.names()]
    found = [source.history(name) for source, name in listed if episode in {None, name}]
    if episode is not None and not found:
        known = ", ".join(name for _, name in listed[:10]) or "none"
        raise InvalidArgumentError("episode", cause=f"there is none named {episode!r}", remedy=f"there is {known}")
    return found


class QuestionTime(msgspec.Struct, frozen=True, kw_only=True):
    """The time that a question is about."""

    at_s: float | None = None
    since_s: float | None = None
    until_s: float | None = None
    episode: str | None = None

    @property
    def is_span(self) -> bool:
        """Whether it is an interval, rather than one time or the present."""
        return self.since_s is not None or self.until_s is not None

    def span_in(self, history: History) -> tuple[float, float] | None:
        """The part of an episode [s]; None if the episode has no part of it."""
        begin = history.begin_s if self.since_s is None else max(self.since_s, history.begin_s)
        end = history.end_s if self.until_s is None else min(self.until_s, history.end_s)
        return (begin, end) if begin <= end else None


NOW = QuestionTime()
"""No other time than the present."""


def time_arguments(
    args: Mapping[str, object], *, declared: Collection[str] = ()
) -> tuple[QuestionTime, dict[str, object]]:
    """Separates what is said about the time of a question from its arguments.

    Args:
        args: `at` is a time [s], `during` a pair of times or "begin..end", `since` and `until` are times, and `episode`
            is a name. Numbers may be text.
        declared: the arguments that the question has, which are left to it.

    Raises:
        InvalidArgumentError: a time is no number, or the end is before the begin, or both a time and an interval are
            given.
    """
    taken = {name: args[name] for name in _TIME_WORDS if name in args and name not in declared}
    words = {name: value for name, value in taken.items() if value is not None}
    rest = {name: value for name, value in args.items() if name not in taken}
    if not words:
        return NOW, rest
    since, until = (_seconds(name, words[name]) if name in words else None for name in ("since", "until"))
    if "during" in words:
        since, until = _pair(words["during"], since, until)
    at = _seconds("at", words["at"]) if "at" in words else None
    if at is not None and (since is not None or until is not None):
        cause = "it is given together with an interval"
        raise InvalidArgumentError("at", cause=cause, remedy="give a time, or during, since and until")
    if since is not None and until is not None and until < since:
        raise InvalidArgumentError("during", cause=f"{until:g} s is before {since:g} s", remedy="exchange them")
    episode = None if "episode" not in words else str(words["episode"])
    return QuestionTime(at_s=at, since_s=since, until_s=until, episode=episode), rest


_TIME = declared_range(Time)


def _seconds(name: str, value: object) -> float:
    try:
        number = msgspec.convert(value, float, strict=False)
    except msgspec.ValidationError:
        check_number(value, _TIME, name)
        raise
    check_number(number, _TIME, name)
    return number


def _pair(value: object, since: float | None, until: float | None) -> tuple[float, float]:
    if since is not None or until is not None:
        raise InvalidArgumentError("during", cause="since or until is given as well", remedy="give one or the other")
    ends = value.split("..") if isinstance(value, str) else value
    if not isinstance(ends, tuple | list) or len(ends) != 2:
        raise InvalidArgumentError("during", cause=f"{value!r} is no interval", remedy="give two times, such as 1.5..3")
    return _seconds("during", ends[0]), _seconds("during", ends[1])
