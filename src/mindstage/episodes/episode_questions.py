"""Questions about episodes: what happened, what held when, what changed, and where things were.

They are about all episodes of the knowledge base, or the one that is named. `at`, `during`, `since` and `until`
restrict them to what lasts at some time of that interval; their intervals are not cut.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from functools import partial

import numpy as np

from mindstage.episodes.intervals import AllenRelation, Interval, MaximalIntervals, allen_relation
from mindstage.episodes.recording import EpisodeEventKind
from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.history import EventFilter, History, PastEvent, WorldState
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.queries.spatial import ContainerFinder, OpenState, RigidNeighbors, find_articulated_parts
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    ClassName,
    IndividualName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    question,
)
from mindstage.ranges import Time
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import EVENT, TYPE, ms
from mindstage.scene import Body, BodyId, Iri, Pose, Vector, World
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array

__all__ = [
    "AllenRow",
    "ChangeRow",
    "HeldRelation",
    "HoldsRow",
    "LastSeenRow",
    "MovedByRow",
    "OccurrenceRow",
    "TrajectoryRow",
    "WorldChange",
    "allen",
    "changed",
    "holds",
    "last_seen",
    "occurs",
    "trajectory",
    "who_moved",
]

_KINDS = frozenset(kind.value for kind in EpisodeEventKind)
_MAX_PAIRS = 500_000
_MOVED_M, _TURNED_RAD = 1e-3, math.radians(1.0)
_MOVING_EDITS = frozenset({"set poses", "attach", "detach", "place", "pull", "spawn", "add robot", "undo", "redo"})


# -- occurs ----------------------------------------------------------------------------------------------------------


class OccurrenceRow(AnswerRow, frozen=True, kw_only=True):
    """An event of an episode."""

    event: ClassName
    """Its class, or the more general one that was given."""
    thing: IndividualName
    begin: float
    """Time since the begin of the episode [s]."""
    end: float | None
    """None if it had not ended at the end of the episode."""
    kind: ClassName
    """Its own class."""
    other: IndividualName | None
    """What the thing touched, rested on, was in, or left."""
    agent: str | None
    joint: IndividualName | None
    amount: float | None
    """Impulse [N s], distance or height [m], or angle [rad]; of opening and closing the travel of the joint."""
    name: str
    """Unique in the episode, such as "PickingUp_3"."""
    episode: str


@question(
    sentences=(
        "what happened [to {thing}]",
        "which events happened [to {thing}]",
        "when did {event} [of {thing}] (happen|occur)",
        "did {event} [of {thing}] (happen|occur)",
    ),
    is_relation=True,
    about_past=True,
)
def occurs(
    kb: QuestionContext,
    event: ClassName | None = None,
    thing: IndividualName | None = None,
    begin: Time | None = None,
    end: Time | None = None,
    *,
    present: StateAccess,
) -> Iterator[OccurrenceRow]:
    """What happened in the episodes: contacts, grasps, falls and other events, in the order of their begin.

    A class of events stands for all its subclasses: Action for everything that an agent caused. A given `begin` or
    `end` must be exactly that of the event; to ask about an interval, use `during`, `since` and `until`.

    Examples:
        occurs PickingUp
        occurs Action milk_carton_1
    """
    for each in present.find_events(None if event is None else _kinds(kb, event), None if thing is None else {thing}):
        cls = ms(each.kind)
        yield OccurrenceRow(
            event=cls if event is None else event,
            thing=each.thing,
            begin=each.begin_s,
            end=each.end_s,
            kind=cls,
            other=each.other,
            agent=each.agent,
            joint=each.joint,
            amount=each.amount,
            name=each.id,
            episode=each.episode,
        )


def _kinds(kb: QuestionContext, cls: Iri) -> frozenset[str]:
    """The kinds of events that are a class or a subclass of it."""
    below = {cls, *kb.reasoner.classes.below(cls)}
    return frozenset(local_name(each) for each in below if each == ms(local_name(each))) & _KINDS


@occurs.explain
def _explain_occurrence(kb: QuestionContext, row: OccurrenceRow) -> Iterator[str]:
    until = "until the end of the episode" if row.end is None else f"to {row.end:.3f} s"
    yield f"{row.name} of {row.episode} lasts from {row.begin:.3f} {until}"
    wanted = EventFilter(kinds=frozenset({local_name(row.kind)}), things=frozenset({row.thing}), episode=row.episode)
    for source in kb.episodes:
        yield from (line for event in source.find_events(wanted) if event.id == row.name for line in event.evidence)


@occurs.missing
def _missing_occurrence(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    what = "event" if asked.event is None else local_name(asked.event)
    of = "" if asked.thing is None else f" of {local_name(asked.thing)}"
    if asked.event is not None and not _kinds(kb, asked.event):
        yield MissingKnowledge(asked.event, TYPE, f"{what} is no class of events that are detected")
    else:
        reason = f"no {what}{of} happened in {_asked_episodes(asked.present)}"
        yield MissingKnowledge(EVENT if asked.event is None else asked.event, TYPE, reason)


def _asked_episodes(present: StateAccess) -> str:
    names = [name for source in present.episodes for name in source.names() if present.time.episode in {None, name}]
    return names[0] if len(names) == 1 else f"{len(names)} episodes"


# -- holds -----------------------------------------------------------------------------------------------------------


class HeldRelation(StrEnum):
    """A relation that two bodies have for some time."""

    ON = "on"
    INSIDE = "inside"
    ABOVE = "above"
    BELOW = "below"
    NEXT_TO = "next_to"
    """The first five are those of `where_is`."""
    TOUCHING = "touching"
    """The engine reported a contact."""
    ATTACHED = "attached"
    """The first body is attached to the second one."""
    OPEN = "open"
    """The door, drawer or lid `b` of the container `a` is open, as `articulated_parts` measures it."""
    CLOSED = "closed"


_SPATIAL = {HeldRelation(each.value): each for each in SpatialRelation}
_OPENNESS = frozenset({HeldRelation.OPEN, HeldRelation.CLOSED})
_Fact = tuple[HeldRelation, Iri, Iri]


class HoldsRow(AnswerRow, frozen=True, kw_only=True):
    """A relation of two bodies, and an interval in which it holds, and before and after which it does not."""

    relation: HeldRelation
    a: IndividualName
    b: IndividualName
    begin: float
    """Time since the begin of the episode [s]."""
    end: float
    """When it no longer holds, or the end of the episode, at which it still holds [s]."""
    episode: str


@question(
    sentences=("when (is|was) {a} {relation} {b}", "how long was {a} {relation} {b}", "when was {a} {relation}"),
    is_relation=True,
    about_past=True,
)
def holds(
    kb: QuestionContext,
    relation: HeldRelation | None = None,
    a: IndividualName | None = None,
    b: IndividualName | None = None,
    begin: Time | None = None,
    end: Time | None = None,
    *,
    present: StateAccess,
) -> Iterator[HoldsRow]:
    """When a relation held between two bodies: the maximal intervals, in the order of their begin.

    The relations are those of `where_is`, and touching, attached, open and closed. A relation holds from the first
    frame of the episode in which it is found until the first one in which it is not. Contacts are those that the engine
    reported; bodies that have not moved since still touch. A given `begin` or `end` must be exactly that of the
    interval; to ask about a time, use `at`, `during`, `since` and `until`.

    Examples:
        holds on milk_carton_1
        holds open fridge
    """
    for history in present.histories():
        span = _span(present, history)
        if span is None:
            continue
        held, last = kb.cached(
            ("held", history, history.end_s, relation, a, b), partial(_held, kb, history, relation, a, b)
        )
        rows = [(each, fact) for fact, intervals in held.items() for each in intervals]
        for each, fact in sorted(rows):
            held_relation, one, other = fact
            if each.begin <= span.end and (each.end > span.begin or (each.end == history.end_s and fact in last)):
                yield HoldsRow(
                    relation=held_relation, a=one, b=other, begin=each.begin, end=each.end, episode=history.name
                )


def _span(present: StateAccess, history: History) -> Interval | None:
    """The part of an episode that a question is about; None if it is none."""
    if (at := present.time.at_s) is not None:
        return Interval(at, at) if history.begin_s <= at <= history.end_s else None
    span = present.time.span_in(history)
    return None if span is None else Interval(*span)


def _held(
    kb: QuestionContext, history: History, relation: HeldRelation | None, a: Iri | None, b: Iri | None
) -> tuple[Mapping[_Fact, tuple[Interval, ...]], frozenset[_Fact]]:
    """Everything that held at some time of an episode, with its maximal intervals, and what holds at the end."""
    wanted = tuple(HeldRelation) if relation is None else (relation,)
    found = MaximalIntervals[_Fact]()
    finder: tuple[tuple[World, ...], ContainerFinder] | None = None
    for begin, state in history.states():
        facts = [*_spatial_facts(state, wanted, a, b), *_link_facts(state, wanted, a, b)]
        if not _OPENNESS.isdisjoint(wanted):
            if finder is None or finder[0] != state.spawned:
                finder = state.spawned, ContainerFinder(kb, RigidNeighbors(state))
            for row in find_articulated_parts(kb, state, b, finder[1]):
                kind = HeldRelation.OPEN if row.state is OpenState.OPEN else HeldRelation.CLOSED
                if kind in wanted and a in {None, row.thing}:
                    facts.append((kind, row.thing, row.part))
        found.add(begin, facts)
    last = found.current
    return found.finish(history.end_s), last


def _spatial_facts(state: WorldState, wanted: Sequence[HeldRelation], a: Iri | None, b: Iri | None) -> Iterator[_Fact]:
    relations = [_SPATIAL[each] for each in wanted if each in _SPATIAL]
    if not relations:
        return
    ids = {body.iri: body.id for body in state.world.bodies}
    if not {a, b} <= {None, *ids}:
        return
    pairs = state.relations.related(
        subjects=None if a is None else (ids[a],), others=None if b is None else (ids[b],), relations=relations
    )
    for pair in pairs:
        yield HeldRelation(pair.relation.value), pair.body.iri, pair.other.iri


def _link_facts(state: WorldState, wanted: Sequence[HeldRelation], a: Iri | None, b: Iri | None) -> Iterator[_Fact]:
    """Attachments and contacts."""
    links: list[tuple[HeldRelation, BodyId, BodyId]] = []
    if HeldRelation.ATTACHED in wanted:
        links += [(HeldRelation.ATTACHED, each.child, each.parent) for each in state.world.attachments]
    if HeldRelation.TOUCHING in wanted:
        links += [(HeldRelation.TOUCHING, *ends) for pair in state.touching or () for ends in (pair, pair[::-1])]
    if not links:
        return
    iris = {body.id: body.iri for body in state.world.bodies}
    for relation, one, other in links:
        if one in iris and other in iris and a in {None, iris[one]} and b in {None, iris[other]}:
            yield relation, iris[one], iris[other]


@holds.explain
def _explain_holding(kb: QuestionContext, row: HoldsRow) -> Iterator[str]:
    yield f"found in every frame of {row.episode} from {row.begin:.3f} to {row.end:.3f} s, and not before or after"


@holds.missing
def _missing_holding(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    yield from _never_there((asked.a, asked.b), asked.present)
    what = "no relation" if asked.relation is None else f"{asked.relation} never"
    yield MissingKnowledge(EVENT, TYPE, f"{what} held between them in {_asked_episodes(asked.present)}")


def _never_there(things: Sequence[Iri | None], present: StateAccess) -> Iterator[MissingKnowledge]:
    for thing in things:
        known = thing is None or any(source.find_individual(thing) is not None for source in present.episodes)
        if thing is not None and not known:
            reason = f"{local_name(thing)} has no body in {_asked_episodes(present)}"
            yield MissingKnowledge(EVENT, TYPE, reason)


# -- Allen's relations -----------------------------------------------------------------------------------------------


class AllenRow(AnswerRow, frozen=True, kw_only=True):
    """The relation of the intervals of two events of one episode."""

    first: str
    """The name of an event, or the class that was given."""
    relation: AllenRelation
    second: str
    first_event: str
    """The name of the event, such as "PickingUp_3"."""
    second_event: str
    episode: str


@question(
    sentences=(
        "is {first} {relation} {second}",
        "(what|which event) (is|was) {relation} {second}",
        "what was the temporal relation of {first} to {second}",
    ),
    about_past=True,
)
def allen(
    kb: QuestionContext,
    first: str | None = None,
    relation: AllenRelation | None = None,
    second: str | None = None,
    *,
    present: StateAccess,
) -> Iterator[AllenRow]:
    """How the intervals of two events are related, by the thirteen relations of Allen (1983), such as before or meets.

    An event is given by its name, as `occurs` answers it, or as a class of events. One that had not ended lasts until
    the end of the episode. Exactly one relation holds between two events.

    Examples:
        allen PickingUp_1 before PuttingDown_1
        allen Falling _ Contact
    """
    for episode, events in _by_episode(present.find_events()).items():
        firsts, seconds = _selected(kb, events, first), _selected(kb, events, second)
        if len(firsts) * len(seconds) > _MAX_PAIRS:
            cause = f"{len(firsts)} and {len(seconds)} events of {episode} are more than {_MAX_PAIRS:,} pairs"
            raise InvalidArgumentError("allen", cause=cause, remedy="give first or second")
        for one in firsts:
            for other in seconds:
                if one.id == other.id:
                    continue
                found = allen_relation(_interval(one), _interval(other))
                if relation in {None, found}:
                    yield AllenRow(
                        first=one.id if first is None else first,
                        relation=found,
                        second=other.id if second is None else second,
                        first_event=one.id,
                        second_event=other.id,
                        episode=episode,
                    )


def _interval(event: PastEvent) -> Interval:
    return Interval(event.begin_s, event.episode_end_s if event.end_s is None else event.end_s)


def _by_episode(events: Sequence[PastEvent]) -> Mapping[str, list[PastEvent]]:
    found: dict[str, list[PastEvent]] = {}
    for event in events:
        found.setdefault(event.episode, []).append(event)
    return found


def _selected(kb: QuestionContext, events: Sequence[PastEvent], text: str | None) -> Sequence[PastEvent]:
    if text is None:
        return events
    if named := [event for event in events if event.id == text]:
        return named
    if "_" in text and text.rpartition("_")[0] in _KINDS:  # the name of an event that this episode does not have
        return ()
    kinds = _kinds(kb, kb.names.find(text, EntityType.CLASS))
    return [event for event in events if event.kind in kinds]


@allen.missing
def _missing_relation(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    how = "related to" if asked.relation is None else asked.relation.replace("_", " ")
    reason = (
        f"no {asked.first or 'event'} is {how} another {asked.second or 'event'} in {_asked_episodes(asked.present)}"
    )
    yield MissingKnowledge(EVENT, TYPE, reason)


# -- changes ---------------------------------------------------------------------------------------------------------


class WorldChange(StrEnum):
    """How a body differs between two times."""

    MOVED = "moved"
    APPEARED = "appeared"
    DISAPPEARED = "disappeared"
    ATTACHED = "attached"
    DETACHED = "detached"


class ChangeRow(AnswerRow, frozen=True, kw_only=True):
    """A body that differs between two times."""

    default_column = "thing"

    thing: IndividualName
    change: WorldChange
    distance: float | None
    """Between the two positions [m]; None unless it moved."""
    angle: float | None
    """Between the two orientations [degrees]."""
    was: IndividualName | None
    """What it was on or in, or attached to, at the first time."""
    now: IndividualName | None
    """What it was on or in, or is attached to, at the second time."""
    since: float
    until: float
    episode: str


@question(
    sentences=("what [has] changed", "what [has] changed since {since}", "what [has] moved", "what is different"),
    about_past=True,
)
def changed(
    kb: QuestionContext, since: Time | None = None, until: Time | None = None, *, present: StateAccess
) -> Iterator[ChangeRow]:
    """What differs between two times [s], by default the begin and the end: bodies that moved, appeared, disappeared.

    A body has moved if its position differs by at least 1 mm, or its orientation by at least 1 degree; the farthest
    first. What happened in between and was undone is not listed; `occurs` and `trajectory` have it.

    Examples:
        changed
        changed since=2.5
    """
    for history in present.histories():
        span = _span(present, history)
        if span is None:
            continue
        begin, end = span.begin if since is None else since, span.end if until is None else until
        if end < begin:
            raise InvalidArgumentError("until", cause=f"{end:g} s is before {begin:g} s", remedy="exchange them")
        rows = _differences(history.state_at(begin), history.state_at(end))
        for thing, change, distance, angle, was, now in rows:
            yield ChangeRow(
                thing=thing,
                change=change,
                distance=distance,
                angle=angle,
                was=was,
                now=now,
                since=begin,
                until=end,
                episode=history.name,
            )


_Difference = tuple[Iri, WorldChange, float | None, float | None, Iri | None, Iri | None]


def _differences(before: WorldState, after: WorldState) -> list[_Difference]:
    first, second = ({body.iri: body for body in state.world.bodies} for state in (before, after))
    places = _places(before.world), _places(after.world)
    found: list[_Difference] = []
    for iri, body in second.items():
        if iri not in first:
            found.append((iri, WorldChange.APPEARED, None, None, None, places[1].get(iri)))
            continue
        distance, angle = _displacement(first[iri], body)
        if distance >= _MOVED_M or angle >= _TURNED_RAD:
            turned = round(math.degrees(angle), 6)
            was, now = places[0].get(iri), places[1].get(iri)
            found.append((iri, WorldChange.MOVED, round(distance, 6), turned, was, now))
    for iri in first.keys() - second.keys():
        found.append((iri, WorldChange.DISAPPEARED, None, None, places[0].get(iri), None))
    held = _holders(before.world), _holders(after.world)
    for iri in sorted(first.keys() & second.keys()):
        was, now = held[0].get(iri), held[1].get(iri)
        if was != now:
            change = WorldChange.DETACHED if now is None else WorldChange.ATTACHED
            found.append((iri, change, None, None, was, now))
    return sorted(found, key=lambda each: (-(each[2] or 0.0), each[0], each[1]))


def _displacement(before: Body, after: Body) -> tuple[float, float]:
    """The distance [m] and the angle [rad] between the poses of a body."""
    start, end = normalized_pose_array(before.pose), normalized_pose_array(after.pose)
    angle = 2.0 * math.atan2(float(np.linalg.norm(_imaginary(start, end))), abs(float(start[3:] @ end[3:])))
    return float(np.linalg.norm(end[:3] - start[:3])), angle


def _imaginary(start: Array, end: Array) -> Array:
    """The imaginary part of the rotation between two poses, which is exact for small angles."""
    w, v, x, u = start[3], start[4:], end[3], end[4:]
    rotation: Array = w * u - x * v - np.cross(v, u)
    return rotation


def _places(world: World) -> Mapping[Iri, Iri]:
    """What each body is on, or else in: the nearest."""
    found: dict[Iri, tuple[bool, float, Iri]] = {}
    for pair in SpatialRelations(world).related(relations=(SpatialRelation.ON, SpatialRelation.INSIDE)):
        rank = (pair.relation is SpatialRelation.INSIDE, pair.gap, pair.other.iri)
        found[pair.body.iri] = min(rank, found.get(pair.body.iri, rank))
    return {iri: rank[2] for iri, rank in found.items()}


def _holders(world: World) -> Mapping[Iri, Iri]:
    iris = {body.id: body.iri for body in world.bodies}
    return {iris[each.child]: iris[each.parent] for each in world.attachments if {each.child, each.parent} <= {*iris}}


@changed.missing
def _missing_change(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    yield MissingKnowledge(EVENT, TYPE, f"nothing differs between these times in {_asked_episodes(asked.present)}")


# -- places and motions of things ------------------------------------------------------------------------------------


class LastSeenRow(AnswerRow, frozen=True, kw_only=True):
    """The last time at which a thing existed in an episode, and where it was then."""

    thing: IndividualName
    time: float
    """[s] since the begin of the episode."""
    place: IndividualName | None
    """What it was on, or else in."""
    position: Vector
    moved: float | None
    """The last time at which it moved; None if it did not."""
    unix_time: float | None
    """`time` in seconds since 1970; None if it is unknown when the episode was recorded."""
    episode: str


@question(
    sentences=(
        "where was {thing} last seen",
        "when was {thing} last seen",
        "when did (you|i|we) last see {thing}",
        "where did (you|i|we) last see {thing}",
    ),
    about_past=True,
)
def last_seen(
    kb: QuestionContext, thing: IndividualName | None = None, *, present: StateAccess
) -> Iterator[LastSeenRow]:
    """When and where a thing was last, in each episode that has it; the latest episode first.

    Examples:
        last_seen milk_carton_1
    """
    if thing is None:
        return
    order = list(enumerate(present.histories()))
    for _, history in sorted(order, key=lambda each: (each[1].start_unix_s or 0.0, each[0]), reverse=True):
        if thing not in history.individuals() or (span := _span(present, history)) is None:
            continue
        last: tuple[float, Body, World] | None = None
        moved: float | None = None
        gone = False
        for begin, state in history.states(*span):
            body = next((each for each in state.world.bodies if each.iri == thing), None)
            if body is None:
                gone = True
                continue
            if last is not None and last[1].pose != body.pose:
                moved = begin
            last, gone = (begin, body, state.world), False
        if last is None:
            continue
        time = last[0] if gone else span.end
        yield LastSeenRow(
            thing=thing,
            time=time,
            place=_places(last[2]).get(thing),
            position=last[1].pose.position,
            moved=moved,
            unix_time=None if history.start_unix_s is None else history.start_unix_s + time,
            episode=history.name,
        )


class TrajectoryRow(AnswerRow, frozen=True, kw_only=True):
    """A pose of a thing, and the time from which it had this pose."""

    thing: IndividualName
    time: float
    """[s] since the begin of the episode."""
    position: Vector
    """[m]."""
    quaternion: tuple[float, float, float, float]
    """w, x, y, z."""
    episode: str


@question(
    sentences=("how did {thing} move", "where did {thing} move", "what is the (path|trajectory) of {thing}"),
    about_past=True,
)
def trajectory(
    kb: QuestionContext, thing: IndividualName | None = None, *, present: StateAccess
) -> Iterator[TrajectoryRow]:
    """The poses of a thing over time: the first one, and each one that differs from the one before.

    Examples:
        trajectory milk_carton_1
    """
    if thing is None:
        return
    for history in present.histories():
        span = _span(present, history)
        if span is None or thing not in history.individuals():
            continue
        before: Pose | None = None
        for begin, state in history.states(*span):
            pose = next((each.pose for each in state.world.bodies if each.iri == thing), None)
            if pose is not None and pose != before:
                unit = pose_from_array(normalized_pose_array(pose))
                yield TrajectoryRow(
                    thing=thing, time=begin, position=pose.position, quaternion=unit.quaternion, episode=history.name
                )
            before = pose


class MovedByRow(AnswerRow, frozen=True, kw_only=True):
    """Something that moved a thing."""

    thing: IndividualName
    agent: str
    """The body, as its IRI, or the name of the client."""
    how: str
    """The class of the event, or the edit."""
    begin: float
    end: float | None
    amount: float | None
    """See `occurs`."""
    episode: str


@question(sentences=("who [has] moved {thing}", "what [has] moved {thing}", "who touched {thing}"), about_past=True)
def who_moved(
    kb: QuestionContext, thing: IndividualName | None = None, *, present: StateAccess
) -> Iterator[MovedByRow]:
    """Who moved a thing, and how: the agents of events about it, and the clients that edited it.

    Examples:
        who_moved milk_carton_1
    """
    things = None if thing is None else {thing}
    rows = [
        MovedByRow(
            thing=each.thing,
            agent=each.agent,
            how=each.kind,
            begin=each.begin_s,
            end=each.end_s,
            amount=each.amount,
            episode=each.episode,
        )
        for each in present.find_events(things=things)
        if each.agent is not None
    ]
    for history in present.histories() if _edits_are_known(present) else ():
        span = _span(present, history)
        for time_s, kind, client, moved in history.edits() if span is not None else ():
            if kind in _MOVING_EDITS and client and span is not None and span.begin <= time_s <= span.end:
                rows += [
                    MovedByRow(
                        thing=each, agent=client, how=kind, begin=time_s, end=time_s, amount=None, episode=history.name
                    )
                    for each in moved
                    if thing in {None, each}
                ]
    yield from sorted(rows, key=lambda row: (row.episode, row.begin))


_MAX_OPENED_EPISODES = 50
"""Files of more episodes are not opened for their edits, which no index has."""


def _edits_are_known(present: StateAccess) -> bool:
    return (
        present.time.episode is not None or sum(len(each.names()) for each in present.episodes) < _MAX_OPENED_EPISODES
    )


@who_moved.missing
def _missing_mover(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    absent = list(_never_there((asked.thing,), asked.present))
    yield from absent
    if not absent:
        what = "anything" if asked.thing is None else local_name(asked.thing)
        yield MissingKnowledge(
            EVENT, TYPE, f"nothing is recorded to have moved {what} in {_asked_episodes(asked.present)}"
        )


@last_seen.missing
@trajectory.missing
def _missing_thing(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    absent = list(_never_there((asked.thing,), asked.present))
    yield from absent
    if asked.thing is None:
        yield MissingKnowledge(EVENT, TYPE, "give thing: the things are not listed one after the other")
    elif not absent:
        yield MissingKnowledge(
            EVENT, TYPE, f"nothing is recorded of {local_name(asked.thing)} in {_asked_episodes(asked.present)}"
        )
