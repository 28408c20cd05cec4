"""Questions about what stands open, now."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from mindstage.knowledge.moment import TOLD, Moment, Present
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import IndividualName, MapName, Missing, Row, question
from mindstage.knowledge.questions.space import source_line
from mindstage.knowledge.questions.words import thing_text
from mindstage.knowledge.vocabulary import CHILD, knowrob
from mindstage.world import Body, BodyId, Constraint, Iri, World
from mindstage.world.assemblies import Assemblies, moving_end
from mindstage.world.boxes import Boxes, coverage
from mindstage.world.geometry import pose_array, unit
from mindstage.world.travel import Travel, travel

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["Opening", "State", "openings"]

_OPEN_SHARE = 0.05
_OPEN_M, _OPEN_RAD = 0.02, 0.1
"""Where nothing limits how far it goes."""
_FRONTS = (knowrob("PortalCovering"), knowrob("StorageConstruct"))
_CONTAINER = knowrob("Container")
_STATE = knowrob("stateOfObject")


class State(StrEnum):
    """Whether one can reach in."""

    OPEN = "open"
    CLOSED = "closed"


class Opening(Row, frozen=True, kw_only=True):
    """One door, drawer or lid."""

    thing: IndividualName
    """What it belongs to."""
    state: State
    front: IndividualName
    """The door, drawer or lid."""
    share: float | None
    """How far it is open, from 0 to 1 of its way; None where nothing limits that."""
    way: float
    """The same in its unit."""
    unit: str
    """m or rad."""
    map: MapName
    """The map that the front is described in."""
    source: str
    """Who says so: the engine that runs the place, or "map" as it was told."""


@question
def openings(
    kb: KnowledgeBase,
    thing: IndividualName | None = None,
    state: State | None = None,
    front: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: Present,
) -> Iterator[Opening]:
    """Which containers are open or closed, and how far: one answer for each door, drawer and lid on a constraint.

    Closed is how the map has it. It counts as open from 5 % of the way that it can go; where nothing limits that, from
    20 mm or 0.1 rad. A door belongs to the container that it covers most of, among what hangs together with the body
    that the constraint names; knobs and taps open nothing.

    Asked of a running stage, the engine tells how far each constraint has moved. Without one, or where the engine does
    not know, everything is closed, which is only the map's word.

    Examples:
        openings fridge
        openings state=closed front=drawer_left_1
    """
    for moment in present.moments(map):
        yield from _openings(kb, moment, front)


def _openings(kb: KnowledgeBase, moment: Moment, front: Iri | None = None) -> Iterator[Opening]:
    homes = moment.homes()
    bodies = {body.id: body for body in moment.world.bodies}
    furniture = _Furniture(kb, moment.told)
    for joint in moment.world.constraints:
        if joint.parent not in bodies or joint.child not in bodies:
            continue
        moving, holder = moving_end(joint, bodies[joint.parent], bodies[joint.child])
        if front not in {None, moving.iri} or not _opens(kb, moving):
            continue
        went, source = _went(joint, moment)
        if went is not None:
            yield Opening(
                thing=furniture.owner(moving, holder).iri,
                state=State.OPEN if _is_open(went) else State.CLOSED,
                front=moving.iri,
                share=None if went.share is None else round(went.share, 6),
                way=round(went.way, 6),
                unit="m" if went.slides else "rad",
                map=homes[moving.id],
                source=source,
            )


@openings.because
def _how_far(kb: KnowledgeBase, row: Opening) -> Iterator[str]:
    share = "" if row.share is None else f", {row.share:.0%} of its way"
    verb = "slid" if row.unit == "m" else "turned"
    yield f"{local_name(row.front)} of {local_name(row.thing)} has {verb} by {row.way:g} {row.unit}{share}"
    yield source_line(row.source)


@openings.lacking
def _unmeasured(
    kb: KnowledgeBase,
    thing: Iri | None = None,
    state: State | None = None,
    front: Iri | None = None,
    map: Iri | None = None,
    *,
    present: Present,
) -> Iterator[Missing]:
    moments = present.moments(map)
    there = [row for moment in moments for row in _openings(kb, moment)]
    if why := _nothing_moves(kb, there, thing, front):
        yield Missing(_CONTAINER, CHILD, why)
    elif state is State.OPEN and moments and all(moment.joints is None for moment in moments):
        why = "nobody measured what is open: without an engine that knows its joints, all is closed as the maps have it"
        yield Missing(_CONTAINER, _STATE, why)


def _nothing_moves(kb: KnowledgeBase, there: list[Opening], thing: Iri | None, front: Iri | None) -> str:
    """Why nothing opens a thing, or a front opens nothing, in whatever state it is; empty where something does."""
    owners = {row.front: local_name(row.thing) for row in there}
    if front is not None and front not in owners:
        return f"{thing_text(kb.index, front)} opens nothing: it is no door, drawer or lid that a constraint moves"
    if thing is None or any(row.thing == thing and front in {None, row.front} for row in there):
        return ""
    if front is not None:
        return f"{local_name(front)} opens {owners[front]}, not {local_name(thing)}"
    if thing in owners:
        name = local_name(thing)
        return f"nothing opens {name}, which itself opens {owners[thing]}: ask for front={name}"
    return f"{thing_text(kb.index, thing)} has no door, drawer or lid that a constraint moves"


def _opens(kb: KnowledgeBase, moving: Body) -> bool:
    """Whether something that moves is a door, a drawer or a lid; what no ontology knows may be one."""
    above = kb.index.classes.above(moving.cls)
    return len(above) <= 1 or any(kb.index.is_a(moving.cls, cls) for cls in _FRONTS)


def _went(joint: Constraint, moment: Moment) -> tuple[Travel | None, str]:
    """How far something went, and who says so."""
    positions = moment.joints.get(joint.id) if moment.joints else None
    return travel(joint, positions or (0.0,) * 6), moment.source if positions else TOLD


def _is_open(went: Travel) -> bool:
    if went.share is not None:
        return went.share >= _OPEN_SHARE
    return went.way >= (_OPEN_M if went.slides else _OPEN_RAD)


class _Furniture:
    """What doors and drawers belong to, by how everything was told: closed."""

    def __init__(self, kb: KnowledgeBase, told: Iterable[World]) -> None:
        self._kb = kb
        self._told: dict[BodyId, Body] = {}
        self._mates: dict[BodyId, list[Body]] = {}
        for world in told:
            groups: dict[int, list[Body]] = {}
            for body, number in zip(world.bodies, Assemblies.of(world).number.tolist(), strict=True):
                self._told[body.id] = body
                self._mates[body.id] = groups.setdefault(number, [])
                self._mates[body.id].append(body)

    def owner(self, front: Body, holder: Body) -> Body:
        """The container that a front closes, of all that hangs together with what holds the front."""
        closed = self._told.get(front.id, front)
        containers = [
            body
            for body in self._mates.get(holder.id, ())
            if body.size is not None and self._kb.index.is_a(body.cls, _CONTAINER)
        ]
        if closed.size is None or not containers:
            return holder
        poses = pose_array(body.pose for body in (closed, *containers))
        poses[:, 3:] = unit(poses[:, 3:])
        boxes = Boxes.of(poses, np.array([body.size for body in (closed, *containers)], dtype=np.float64))
        covered = coverage(boxes, 0, np.arange(1, len(containers) + 1))
        return containers[int(np.argmax(covered))] if covered.max() > 0.0 else holder
