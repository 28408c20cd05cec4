"""Questions about what stands open, now.

Questions about where things are relative to one another, now.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import StrEnum

import numpy as np

from mindstage.knowledge.explain import individual_text
from mindstage.knowledge.questions import (
    MAP_SOURCE,
    AnswerRow,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    WorldState,
    question,
)
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.vocabulary import CHILD, HAS_POSE, knowrob
from mindstage.scene import Body, BodyId, Iri, Joint, World
from mindstage.scene.bounding_boxes import OrientedBoxes, face_coverage
from mindstage.scene.kinematics import JointDisplacement, RigidGroups, joint_displacement, moving_body
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from mindstage.scene.transforms import normalize, pose_array

__all__ = ["JointOpenness", "OpenState", "SpatialRelationRow", "openings", "source_text", "where_is"]


_RELATION_ORDER = {relation: at for at, relation in enumerate(SpatialRelation)}
_SIZE_PROPERTY = knowrob("depthOfObject")


class SpatialRelationRow(AnswerRow, frozen=True, kw_only=True):
    """How one thing stands to another."""

    thing: IndividualName
    relation: SpatialRelation
    other: IndividualName
    map: MapName
    """The map that the thing is described in."""
    gap: float
    """[m]: level for next_to, to the nearest side for inside, upright for the rest; negative where they overlap."""
    share: float
    """From 0 to 1: of the height for next_to, of the thing for inside, of the smaller footprint for the rest."""
    source: str
    """Who says so: the engine that runs the place, or "map" as it was told."""


@question
def where_is(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    relation: SpatialRelation | None = None,
    other: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[SpatialRelationRow]:
    """Where a thing is relative to others: on, inside, above, below or next_to; the nearest of a kind first.

    It is measured, by the boxes around things and with down along -z. On: from 20 mm in it to 5 mm over it. Above and
    below: up to 3 m. Next to: no more than 0.25 m apart, at the same height. Inside: 80 % of it along each axis, the
    contents of fridges and drawers too; and the milk in the fridge is not next to the cup outside. What everything is
    in, such as walls, is left out, and what hangs on doors and drawers rests on nothing else.

    Asked of a running stage, things are where the engine has them; else where their maps tell.

    Examples:
        where_is milk_carton_1
        where_is _ on counter_left
        where_is plate_3 on
    """
    for moment in present.states(map):
        homes, ids = moment.map_of_body(), {body.iri: body.id for body in moment.world.bodies}
        if not {thing, other} <= {None, *ids}:
            continue
        found = SpatialRelations(moment.world).related(
            subjects=None if thing is None else (ids[thing],),
            others=None if other is None else (ids[other],),
            relations=tuple(SpatialRelation) if relation is None else (relation,),
        )
        for each in sorted(
            found, key=lambda each: (each.body.id, _RELATION_ORDER[each.relation], each.gap, each.other.id)
        ):
            yield SpatialRelationRow(
                thing=each.body.iri,
                relation=each.relation,
                other=each.other.iri,
                map=homes[each.body.id],
                gap=each.gap,
                share=each.overlap,
                source=moment.source,
            )


@where_is.explain
def _explain_relation(kb: QuestionContext, row: SpatialRelationRow) -> Iterator[str]:
    thing, other, gap, share = local_name(row.thing), local_name(row.other), f"{row.gap:g} m", f"{row.share:.0%}"
    match row.relation:
        case SpatialRelation.INSIDE:
            yield f"{share} of {thing} is in {other}, {gap} from its nearest side"
        case SpatialRelation.NEXT_TO:
            yield f"{gap} between {thing} and {other}, which share {share} of the smaller height"
        case SpatialRelation.BELOW:
            yield f"{gap} from the top of {thing} up to {other}, which share {share} of the smaller footprint"
        case _:
            yield f"{gap} from the top of {other} up to {thing}, which share {share} of the smaller footprint"
    yield source_text(row.source)


def source_text(source: str) -> str:
    """Who says how things are, in words."""
    return "as the map tells; no engine was asked" if source == MAP_SOURCE else f"as {source} has it now"


@where_is.missing
def _missing_relation(
    kb: QuestionContext,
    thing: Iri | None = None,
    relation: SpatialRelation | None = None,
    other: Iri | None = None,
    map: Iri | None = None,
    *,
    present: StateAccess,
) -> Iterator[MissingKnowledge]:
    moments = present.states(map)
    for each in (thing, other):
        cls = kb.reasoner.class_of(each) if each else None
        if each and cls:
            yield from _missing_pose(each, cls, moments)


def _missing_pose(individual: Iri, cls: Iri, world_states: tuple[WorldState, ...]) -> Iterator[MissingKnowledge]:
    bodies = [body for moment in world_states for body in moment.world.bodies if body.iri == individual]
    if not bodies:
        yield MissingKnowledge(
            cls, HAS_POSE, f"{local_name(individual)} is nowhere: no place that is looked at has a body of it"
        )
    elif all(body.size is None for body in bodies):
        yield MissingKnowledge(
            cls, _SIZE_PROPERTY, f"{local_name(individual)} has no size: neither it nor {local_name(cls)} tells one"
        )


_OPEN_FRACTION = 0.05
_OPEN_M, _OPEN_RAD = 0.02, 0.1
"""Where nothing limits how far it goes."""
_FRONT_CLASSES = (knowrob("PortalCovering"), knowrob("StorageConstruct"))
_CONTAINER = knowrob("Container")
_STATE_PROPERTY = knowrob("stateOfObject")


class OpenState(StrEnum):
    """Whether one can reach in."""

    OPEN = "open"
    CLOSED = "closed"


class JointOpenness(AnswerRow, frozen=True, kw_only=True):
    """One door, drawer or lid."""

    thing: IndividualName
    """What it belongs to."""
    state: OpenState
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
    kb: QuestionContext,
    thing: IndividualName | None = None,
    state: OpenState | None = None,
    front: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[JointOpenness]:
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
    for moment in present.states(map):
        yield from _find_openings(kb, moment, front)


def _find_openings(kb: QuestionContext, world_state: WorldState, front: Iri | None = None) -> Iterator[JointOpenness]:
    homes = world_state.map_of_body()
    bodies = {body.id: body for body in world_state.world.bodies}
    furniture = _ContainerFinder(kb, world_state.spawned)
    for joint in world_state.world.joints:
        if joint.parent not in bodies or joint.child not in bodies:
            continue
        moving, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
        if front not in {None, moving.iri} or not _is_front(kb, moving):
            continue
        went, source = _displacement(joint, world_state)
        if went is not None:
            yield JointOpenness(
                thing=furniture.container_of(moving, holder).iri,
                state=OpenState.OPEN if _is_open(went) else OpenState.CLOSED,
                front=moving.iri,
                share=None if went.fraction is None else round(went.fraction, 6),
                way=round(went.displacement, 6),
                unit="m" if went.is_prismatic else "rad",
                map=homes[moving.id],
                source=source,
            )


@openings.explain
def _explain_opening(kb: QuestionContext, row: JointOpenness) -> Iterator[str]:
    share = "" if row.share is None else f", {row.share:.0%} of its way"
    verb = "slid" if row.unit == "m" else "turned"
    yield f"{local_name(row.front)} of {local_name(row.thing)} has {verb} by {row.way:g} {row.unit}{share}"
    yield source_text(row.source)


@openings.missing
def _missing_opening(
    kb: QuestionContext,
    thing: Iri | None = None,
    state: OpenState | None = None,
    front: Iri | None = None,
    map: Iri | None = None,
    *,
    present: StateAccess,
) -> Iterator[MissingKnowledge]:
    moments = present.states(map)
    there = [row for moment in moments for row in _find_openings(kb, moment)]
    if why := _unopenable_reason(kb, there, thing, front):
        yield MissingKnowledge(_CONTAINER, CHILD, why)
    elif state is OpenState.OPEN and moments and all(moment.joint_positions is None for moment in moments):
        why = "nobody measured what is open: without an engine that knows its joints, all is closed as the maps have it"
        yield MissingKnowledge(_CONTAINER, _STATE_PROPERTY, why)


def _unopenable_reason(kb: QuestionContext, rows: list[JointOpenness], thing: Iri | None, front: Iri | None) -> str:
    """Why nothing opens a thing, or a front opens nothing, in whatever state it is; empty where something does."""
    owners = {row.front: local_name(row.thing) for row in rows}
    if front is not None and front not in owners:
        return (
            f"{individual_text(kb.reasoner, front)} opens nothing: it is no door, drawer or lid that a constraint moves"
        )
    if thing is None or any(row.thing == thing and front in {None, row.front} for row in rows):
        return ""
    if front is not None:
        return f"{local_name(front)} opens {owners[front]}, not {local_name(thing)}"
    if thing in owners:
        name = local_name(thing)
        return f"nothing opens {name}, which itself opens {owners[thing]}: ask for front={name}"
    return f"{individual_text(kb.reasoner, thing)} has no door, drawer or lid that a constraint moves"


def _is_front(kb: QuestionContext, body: Body) -> bool:
    """Whether something that moves is a door, a drawer or a lid; what no ontology knows may be one."""
    above = kb.reasoner.classes.above(body.cls)
    return len(above) <= 1 or any(kb.reasoner.is_a(body.cls, cls) for cls in _FRONT_CLASSES)


def _displacement(joint: Joint, world_state: WorldState) -> tuple[JointDisplacement | None, str]:
    """How far something went, and who says so."""
    positions = world_state.joint_positions.get(joint.id) if world_state.joint_positions else None
    return joint_displacement(joint, positions or (0.0,) * 6), world_state.source if positions else MAP_SOURCE


def _is_open(displacement: JointDisplacement) -> bool:
    if displacement.fraction is not None:
        return displacement.fraction >= _OPEN_FRACTION
    return displacement.displacement >= (_OPEN_M if displacement.is_prismatic else _OPEN_RAD)


class _ContainerFinder:
    """What doors and drawers belong to, by how everything was told: closed."""

    def __init__(self, kb: QuestionContext, maps: Iterable[World]) -> None:
        self._kb = kb
        self._map_bodies: dict[BodyId, Body] = {}
        self._rigid_neighbors: dict[BodyId, list[Body]] = {}
        for world in maps:
            groups: dict[int, list[Body]] = {}
            for body, number in zip(world.bodies, RigidGroups.from_world(world).root_row.tolist(), strict=True):
                self._map_bodies[body.id] = body
                self._rigid_neighbors[body.id] = groups.setdefault(number, [])
                self._rigid_neighbors[body.id].append(body)

    def container_of(self, front: Body, parent: Body) -> Body:
        """The container that a front closes, of all that hangs together with what holds the front."""
        closed = self._map_bodies.get(front.id, front)
        containers = [
            body
            for body in self._rigid_neighbors.get(parent.id, ())
            if body.size is not None and self._kb.reasoner.is_a(body.cls, _CONTAINER)
        ]
        if closed.size is None or not containers:
            return parent
        poses = pose_array(body.pose for body in (closed, *containers))
        poses[:, 3:] = normalize(poses[:, 3:])
        boxes = OrientedBoxes.from_poses(
            poses, np.array([body.size for body in (closed, *containers)], dtype=np.float64)
        )
        covered = face_coverage(boxes, 0, np.arange(1, len(containers) + 1))
        return containers[int(np.argmax(covered))] if covered.max() > 0.0 else parent
