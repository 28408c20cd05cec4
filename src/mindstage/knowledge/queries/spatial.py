"""Questions about the current state: where bodies are relative to one another, and which containers are open."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum

import numpy as np

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import individual_text, source_text
from mindstage.knowledge.questions import (
    MAP_SOURCE,
    AnswerRow,
    AskedArguments,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    WorldState,
    question,
)
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import CHILD, HAS_POSE, knowrob
from mindstage.scene import Body, BodyId, Iri, Joint
from mindstage.scene.bounding_boxes import OrientedBoxes, face_coverage
from mindstage.scene.joint_kinematics import (
    JointDisplacement,
    RigidGroups,
    is_robot_part,
    joint_displacement,
    moving_body,
)
from mindstage.scene.spatial import SpatialRelation
from mindstage.scene.transforms import normalize, pose_array

__all__ = [
    "ContainerFinder",
    "JointOpenness",
    "OpenState",
    "SpatialRelationRow",
    "articulated_parts",
    "body_claims",
    "find_articulated_parts",
    "missing_pose",
    "where_is",
]


_RELATION_ORDER = {relation: at for at, relation in enumerate(SpatialRelation)}
_SIZE_PROPERTY = knowrob("depthOfObject")

_OPEN_FRACTION = 0.05
_OPEN_M, _OPEN_RAD = 0.02, 0.1
"""For joints without limits."""
_PART_CLASSES = (knowrob("PortalCovering"), knowrob("StorageConstruct"))
_CONTAINER = knowrob("Container")
_HANDLE, _DRAWER = knowrob("Handle"), knowrob("Drawer")
_STATE_PROPERTY = knowrob("stateOfObject")


class SpatialRelationRow(AnswerRow, frozen=True, kw_only=True):
    """A spatial relation between two bodies."""

    thing: IndividualName
    relation: SpatialRelation
    other: IndividualName
    map: MapName
    """The map that `thing` is described in."""
    gap: float
    """Distance [m]: horizontal for next_to, to the nearest side for inside, else vertical; negative if they overlap."""
    share: float
    """From 0 to 1: of the height for next_to, of the volume for inside, of the smaller footprint for the rest."""
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    sentences=(
        "what is {thing} {relation}",
        "what is the content of {other} {relation=inside}",
    ),
    is_relation=True,
)
def where_is(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    relation: SpatialRelation | None = None,
    other: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[SpatialRelationRow]:
    """Where a body is relative to others: on, inside, above, below or next_to them; the nearest of each relation first.

    The relations are measured between bounding boxes, with down along -z. On: from 20 mm inside the other body to 5 mm
    above it. Above and below: up to 3 m apart. Next to: at most 0.25 m apart at the same height. Inside: at least 80 %
    along each axis, which includes the contents of fridges and drawers; a body inside a container is not next to the
    bodies outside. Bodies that contain all others, such as walls, are left out, and bodies on doors and drawers rest on
    nothing else.

    The poses are those of the running simulation, or those of the maps if there is none.

    Examples:
        where_is milk_carton_1
        where_is _ on counter_left
        where_is plate_3 on
    """
    for state in present.states(map):
        homes, ids = state.map_of_body, state.id_of_iri
        if not all(each is None or each in ids for each in (thing, other)):
            continue
        found = state.relations.related(
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
                source=state.source,
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


@where_is.missing
def _missing_relation(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    states = asked.present.states(asked.map)
    for each in (asked.thing, asked.other):
        cls = kb.reasoner.class_of(each) if each else None
        if each and cls:
            yield from missing_pose(each, cls, states, asked.map)


def missing_pose(
    individual: Iri, cls: Iri, world_states: tuple[WorldState, ...], map: Iri | None
) -> Iterator[MissingKnowledge]:
    """The missing pose or size of an individual that a question about places asks for."""
    bodies = [body for state in world_states for body in state.world.bodies if body.iri == individual]
    name = local_name(individual)
    if not bodies:
        reason = f"{name} has no pose: no map or simulation that was asked has its body"
        claim = Claim(kind=ClaimKind.NO_BODY, subject=individual, map=map)
        yield MissingKnowledge(cls, HAS_POSE, reason, claims=(claim,))
    elif all(body.size is None for body in bodies):
        reason = f"{name} has no size: neither it nor {local_name(cls)} states one"
        claim = Claim(kind=ClaimKind.NO_SIZE, subject=individual, map=map)
        yield MissingKnowledge(cls, _SIZE_PROPERTY, reason, claims=(claim,))


def body_claims(
    individuals: Iterable[Iri | None], world_states: tuple[WorldState, ...], map: Iri | None
) -> tuple[Claim, ...]:
    """Which of some individuals have bodies, on which reasons about places rely; None is left out."""
    placed = {body.iri for state in world_states for body in state.world.bodies}
    return tuple(
        Claim(kind=ClaimKind.BODY if each in placed else ClaimKind.NO_BODY, subject=each, map=map)
        for each in dict.fromkeys(individuals)
        if each is not None
    )


class OpenState(StrEnum):
    """Whether a container is open or closed."""

    OPEN = "open"
    CLOSED = "closed"


class JointOpenness(AnswerRow, frozen=True, kw_only=True):
    """One door, drawer or lid."""

    thing: IndividualName
    """The container that the door, drawer or lid belongs to."""
    state: OpenState
    part: IndividualName
    """The door, drawer or lid."""
    share: float | None
    """How far it is open, from 0 to 1 of its range; None if the joint has no limits."""
    way: float
    """The displacement of the joint, in `unit`."""
    unit: str
    """m or rad."""
    map: MapName
    """The map that the part is described in."""
    source: str
    """Where the displacement comes from: the name of the engine, or "map"."""


@question(
    sentences=(
        "how far is {thing} (open|opened)",
        "how far is {part:PortalCovering,Drawer} (open|opened)",
        "what opens {thing}",
        "which doors and drawers does {thing} have",
        "what does {part:PortalCovering,Drawer} (open|close)",
    ),
    is_relation=True,
)
def articulated_parts(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    state: OpenState | None = None,
    part: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[JointOpenness]:
    """Which containers are open or closed, and how far: one answer for each door, drawer and lid that a joint moves.

    Closed is the pose in the map. A container is open from 5 % of the joint's range, or from 20 mm or 0.1 rad if the
    joint has no limits. A door belongs to the container of which it covers most, among the bodies that are fixed to
    the other body of the joint. Knobs, taps and the joints of robots open nothing.

    The displacements are those of the running simulation. Without one, or if the engine does not measure a joint,
    everything is closed, as in the map.

    Examples:
        articulated_parts fridge
        articulated_parts state=closed part=drawer_left_1
    """
    for world_state in present.states(map):
        yield from find_articulated_parts(kb, world_state, part, thing=thing)


def find_articulated_parts(
    kb: QuestionContext,
    world_state: WorldState,
    part: Iri | None = None,
    furniture: ContainerFinder | None = None,
    *,
    thing: Iri | None = None,
) -> Iterator[JointOpenness]:
    """The doors, drawers and lids of a state, or one of them.

    Args:
        kb: the knowledge base.
        part: the door, drawer or lid; None for all.
        furniture: finds the containers; it can be used again for a state with the same spawned worlds.
        thing: only those that may belong to this container; None for all.
    """
    homes, rows, bodies = world_state.map_of_body, world_state.row_of_id, world_state.world.bodies
    furniture = furniture or ContainerFinder(kb, world_state.derived(RigidNeighbors))
    fixed = None if thing is None else furniture.fixed_to(world_state.id_of_iri.get(thing))
    for joint in world_state.world.joints:
        if joint.parent not in rows or joint.child not in rows:
            continue
        if fixed is not None and joint.parent not in fixed and joint.child not in fixed:
            continue
        moving, holder = moving_body(joint, bodies[rows[joint.parent]], bodies[rows[joint.child]])
        displacement, source = _displacement(joint, world_state)
        if displacement is None or part not in {None, moving.iri} or is_robot_part(moving):
            continue
        if _is_articulated_part(kb, moving) or (displacement.is_prismatic and _is_drawer_handle(kb, moving, holder)):
            yield JointOpenness(
                thing=furniture.container_of(moving, holder).iri,
                state=OpenState.OPEN if _is_open(displacement) else OpenState.CLOSED,
                part=moving.iri,
                share=None if displacement.fraction is None else round(displacement.fraction, 6),
                way=round(displacement.displacement, 6),
                unit="m" if displacement.is_prismatic else "rad",
                map=homes[moving.id],
                source=source,
            )


@articulated_parts.explain
def _explain_articulated_part(kb: QuestionContext, row: JointOpenness) -> Iterator[str]:
    share = "" if row.share is None else f", {row.share:.0%} of its range"
    verb = "slid" if row.unit == "m" else "turned"
    yield f"{local_name(row.part)} of {local_name(row.thing)} has {verb} by {row.way:g} {row.unit}{share}"
    yield source_text(row.source)


@articulated_parts.missing
def _missing_articulated_part(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    world_states = asked.present.states(asked.map)
    rows = [row for each in world_states for row in find_articulated_parts(kb, each)]
    if why := _unopenable_reason(kb, rows, asked.thing, asked.part):
        claims = body_claims((asked.thing, asked.part), world_states, asked.map)
        if asked.part is not None and not any(row.part == asked.part for row in rows):
            claims += _unmoved_claims(kb, world_states, asked.part, asked.map)
        yield MissingKnowledge(_CONTAINER, CHILD, why, claims=claims)
    elif (
        asked.plain("state", OpenState) is OpenState.OPEN
        and world_states
        and all(each.joint_positions is None for each in world_states)
    ):
        why = "joint positions are unknown: without an engine that measures them, all is closed as in the maps"
        claims = body_claims((asked.thing, asked.part), world_states, asked.map)
        yield MissingKnowledge(_CONTAINER, _STATE_PROPERTY, why, claims=claims)


def _unmoved_claims(
    kb: QuestionContext, world_states: tuple[WorldState, ...], part: Iri, map: Iri | None
) -> tuple[Claim, ...]:
    """Why an individual is no door, drawer or lid that a joint moves: no joint connects it, or its class is another."""
    ids = {(state.world.iri, body.id) for state in world_states for body in state.world.bodies if body.iri == part}
    joints = ((state.world.iri, end) for state in world_states for joint in state.world.joints
              for end in (joint.parent, joint.child))  # fmt: skip
    if not ids.intersection(joints):
        return (Claim(kind=ClaimKind.NO_JOINT, subject=part, map=map),)
    return tuple(
        Claim(kind=ClaimKind.NOT_INSTANCE, subject=part, object=cls)
        for cls in _PART_CLASSES
        if not kb.reasoner.is_member(part, cls)
    )


def _unopenable_reason(kb: QuestionContext, rows: list[JointOpenness], thing: Iri | None, part: Iri | None) -> str:
    """Why nothing opens a container, or a part opens nothing, in any state; empty if something does."""
    owners = {row.part: local_name(row.thing) for row in rows}
    if part is not None and part not in owners:
        return f"{individual_text(kb.reasoner, part)} opens nothing: it is no door, drawer or lid that a joint moves"
    if thing is None or any(row.thing == thing and part in {None, row.part} for row in rows):
        return ""
    if part is not None:
        return f"{local_name(part)} opens {owners[part]}, not {local_name(thing)}"
    if thing in owners:
        name = local_name(thing)
        return f"nothing opens {name}, which itself opens {owners[thing]}: ask for part={name}"
    return f"{individual_text(kb.reasoner, thing)} has no door, drawer or lid that a joint moves"


def _is_articulated_part(kb: QuestionContext, body: Body) -> bool:
    """Whether a moving body is a door, a drawer or a lid; bodies of unknown classes may be."""
    above = kb.reasoner.classes.above(body.cls)
    return len(above) <= 1 or any(kb.reasoner.is_a(body.cls, cls) for cls in _PART_CLASSES)


def _is_drawer_handle(kb: QuestionContext, moving: Body, holder: Body) -> bool:
    """Whether a sliding body is the handle of a drawer, which maps of SOMA name as the child of the drawer's joint."""
    return kb.reasoner.is_a(moving.cls, _HANDLE) and kb.reasoner.is_a(holder.cls, _DRAWER)


def _displacement(joint: Joint, world_state: WorldState) -> tuple[JointDisplacement | None, str]:
    """The displacement of a joint (None if it is fixed), and where it comes from."""
    positions = world_state.joint_positions.get(joint.id) if world_state.joint_positions else None
    return joint_displacement(joint, positions or (0.0,) * 6), world_state.source if positions else MAP_SOURCE


def _is_open(displacement: JointDisplacement) -> bool:
    if displacement.fraction is not None:
        return displacement.fraction >= _OPEN_FRACTION
    return displacement.displacement >= (_OPEN_M if displacement.is_prismatic else _OPEN_RAD)


class RigidNeighbors:
    """The bodies of the maps of a state, where all is closed, and what is fixed to each."""

    def __init__(self, state: WorldState) -> None:
        self.bodies: dict[BodyId, Body] = {}
        self.fixed_to: dict[BodyId, Sequence[Body]] = {}
        for world in state.spawned:
            groups: dict[int, list[Body]] = {}
            for body, number in zip(world.bodies, RigidGroups.from_world(world).root_row.tolist(), strict=True):
                self.bodies[body.id] = body
                self.fixed_to[body.id] = groups.setdefault(number, [])
                groups[number].append(body)


class ContainerFinder:
    """Finds the containers that doors and drawers belong to, from the poses in the maps, where all are closed."""

    def __init__(self, kb: QuestionContext, neighbors: RigidNeighbors) -> None:
        self._kb = kb
        self._map_bodies, self._rigid_neighbors = neighbors.bodies, neighbors.fixed_to

    def fixed_to(self, id: BodyId | None) -> frozenset[BodyId]:
        """A body and what is fixed to it in the maps."""
        return frozenset(body.id for body in self._rigid_neighbors.get(id, ())) | {id} if id else frozenset()

    def container_of(self, part: Body, parent: Body) -> Body:
        """The container that a part closes, among the bodies that are fixed to `parent`; `parent` if there is none."""
        closed = self._map_bodies.get(part.id, part)
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
