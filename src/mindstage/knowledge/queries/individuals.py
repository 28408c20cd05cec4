"""Questions about individuals: what they are, their parts and handles, and the statistics of maps."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import ClassVar

import msgspec

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import (
    individual_text,
    membership_lines,
    missing_description,
    missing_file,
    missing_instance,
    restriction_line,
    source_text,
    statement_line,
    subclass_line,
)
from mindstage.knowledge.owl import RestrictionType
from mindstage.knowledge.questions import (
    MAP_SOURCE,
    AnswerRow,
    AskedArguments,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    WorldState,
    question,
)
from mindstage.knowledge.reasoner import PartOfStep, Reasoner
from mindstage.maps.rdf_mapping.properties import BOUNDING_BOX, MESH, SIZE
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import CHILD, CONSTRAINT, HAS_POSE, THING, TYPE, knowrob
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    Body,
    Iri,
    Joint,
    Light,
    LinearLimits,
    Pose,
    PropertyAssertion,
    Quaternion,
    Tag,
    Vector,
    World,
)

__all__ = [
    "HandleOf",
    "IndividualDescription",
    "JointSummary",
    "MapCounts",
    "PartOf",
    "PoseRow",
    "analyze",
    "handle_of",
    "part_of",
    "pose_of",
    "what_is",
]


_HANDLE_CLASS = knowrob("Handle")
_FRAME = "map"
"""The frame of poses; also the root of tf."""


class PartOf(AnswerRow, frozen=True, kw_only=True):
    """An individual that is a part of another one, at any depth."""

    part: IndividualName
    whole: IndividualName
    depth: int
    """1 for a part, 2 for a part of a part, and so on."""
    map: MapName
    """The map that the whole is described in."""


@question(
    sentences=(
        "(which|what) parts does {whole} have",
        "what does {whole} consist of",
        "what is {part} [a] part of",
        "what does {part} belong to",
        "what is {whole} made up of",
        "list [the] parts of {whole}",
    )
)
def part_of(
    kb: QuestionContext,
    part: IndividualName | None = None,
    whole: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[PartOf]:
    """Parts and wholes to any depth, whichever of the two states the relation; give one to find the other.

    A body that a joint connects to another one is not a part of it.

    Examples:
        part_of whole=fridge_door
        part_of fridge_door_handle
    """
    index = kb.reasoner
    if part is not None and whole is None:
        for step in index.wholes(part):
            for place in index.maps_of.get(step.individual, ()):
                yield PartOf(part=part, whole=step.individual, depth=step.depth, map=place)
        return
    for place in sorted(index.members_by_map) if map is None else (map,):
        for each in sorted(index.members_by_map[place]) if whole is None else (whole,):
            if place in index.maps_of.get(each, ()):
                for step in index.parts(each):
                    yield PartOf(part=step.individual, whole=each, depth=step.depth, map=place)


@part_of.explain
def _explain_part(kb: QuestionContext, row: PartOf) -> Iterator[str]:
    yield from _part_lines(kb.reasoner.parts(row.whole), row.part)


@part_of.missing
def _missing_parts(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    index = kb.reasoner
    individual = asked.whole or asked.part
    if individual is None or not _is_described(index, individual, asked.map):
        yield from missing_description(index, individual, asked.map)
        return
    found = asked.whole if asked.part is None else asked.part
    steps = index.wholes(asked.part) if asked.part else index.parts(individual)
    if any(asked.whole in {None, step.individual} for step in steps):
        where = f"in {local_name(asked.map)}" if asked.map else "in any map"
        claim = Claim(kind=ClaimKind.PART, subject=asked.whole, object=asked.part)
        reason = f"{local_name(asked.part or individual)} is a part, but nothing that it is a part of is {where}"
        yield MissingKnowledge(index.class_of(individual) or THING, CHILD, reason, claims=(claim,))
        return
    what = (
        f"no part of {local_name(asked.whole)}"
        if asked.part and asked.whole
        else "a part of nothing"
        if asked.part
        else "made of nothing"
    )
    why = "neither child, parent nor a part-of property relates them"
    if (
        any(asked.whole in {None, step.individual} for step in index.wholes(asked.part, through_joints=True))
        if asked.part
        else any(True for _ in index.parts(individual, through_joints=True))
    ):
        why = "only joints connect it to other bodies, which does not make a part"
    claim = Claim(kind=ClaimKind.NOT_PART, subject=asked.whole, object=asked.part)
    reason = f"{local_name(found or individual)} is {what}: {why}"
    yield MissingKnowledge(index.class_of(individual) or THING, CHILD, reason, claims=(claim,))


class HandleOf(AnswerRow, frozen=True, kw_only=True):
    """A handle of an individual."""

    default_column: ClassVar[str] = "handle"
    individual: IndividualName
    handle: IndividualName
    map: MapName
    """The map that the individual is described in."""


@question(
    sentences=(
        "(where|what|which) is the handle of {individual}",
        "which handle does {individual} have",
        "what are the handles of {individual}",
        "how do i open {individual}",
        "where do i (grasp|grip) {individual}",
        "what does {handle:Handle} open",
        "which handle opens {individual}",
        "whose handle is {handle:Handle}",
        "what is {handle:Handle} the handle of",
    )
)
def handle_of(
    kb: QuestionContext,
    individual: IndividualName | None = None,
    handle: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[HandleOf]:
    """The handles of an individual, which are its parts of class Handle at any depth; or what a handle belongs to.

    A body that a joint connects to the individual counts as a part here: the handle of an oven door is also the oven's.

    Examples:
        handle_of fridge_door
    """
    index = kb.reasoner
    if individual is not None:
        for found in _find_handles(index, individual):
            for place in index.maps_of.get(individual, ()):
                yield HandleOf(individual=individual, handle=found, map=place)
        return
    for each in index.members(_HANDLE_CLASS) if handle is None else (handle,):
        if index.is_member(each, _HANDLE_CLASS):
            for step in index.wholes(each, through_joints=True):
                places = () if index.is_member(step.individual, CONSTRAINT) else index.maps_of.get(step.individual, ())
                for place in places:
                    yield HandleOf(individual=step.individual, handle=each, map=place)


def _find_handles(reasoner: Reasoner, individual: Iri) -> Iterator[Iri]:
    parts = () if reasoner.is_member(individual, CONSTRAINT) else reasoner.parts(individual, through_joints=True)
    return (step.individual for step in parts if reasoner.is_member(step.individual, _HANDLE_CLASS))


@handle_of.explain
def _explain_handle(kb: QuestionContext, row: HandleOf) -> Iterator[str]:
    yield from _part_lines(kb.reasoner.parts(row.individual, through_joints=True), row.handle)
    yield from membership_lines(kb.reasoner, row.handle, _HANDLE_CLASS)


@handle_of.missing
def _missing_handle(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    index = kb.reasoner
    if asked.handle and not index.is_member(asked.handle, _HANDLE_CLASS):
        claim = Claim(kind=ClaimKind.NOT_INSTANCE, subject=asked.handle, object=_HANDLE_CLASS)
        reason = f"{individual_text(index, asked.handle)} is no Handle"
        yield MissingKnowledge(index.class_of(asked.handle) or THING, TYPE, reason, claims=(claim,))
    elif asked.individual is not None and not _is_described(index, asked.individual, asked.map):
        yield from missing_description(index, asked.individual, asked.map)
    elif asked.individual is not None:
        yield _missing_handle_of(index, asked.individual, asked.handle)
    elif asked.handle:
        steps = list(index.wholes(asked.handle, through_joints=True))
        name = individual_text(index, asked.handle)
        claim = Claim(kind=ClaimKind.NOT_PART, object=asked.handle)
        why = f"{name} is the handle of nothing: it is a part of nothing"
        if wholes := [step.individual for step in steps if not index.is_member(step.individual, CONSTRAINT)]:
            where = local_name(asked.map) if asked.map else "any map"
            why = (
                f"{name} is a part of {', '.join(local_name(each) for each in wholes)}, and none of them is in {where}"
            )
            claim = Claim(kind=ClaimKind.PART, subject=wholes[0], object=asked.handle)
        yield MissingKnowledge(index.class_of(asked.handle) or THING, CHILD, why, claims=(claim,))
    else:
        yield from missing_instance(index, _HANDLE_CLASS, None, asked.map)


def _is_described(reasoner: Reasoner, individual: Iri, map: Iri | None) -> bool:
    """Whether an individual is in a map, or in any map."""
    places = reasoner.maps_of.get(individual, ())
    return bool(places) if map is None else map in places


def _missing_handle_of(reasoner: Reasoner, individual: Iri, handle: Iri | None) -> MissingKnowledge:
    """The missing statement if an individual of a map has no handle, or not the given one."""
    others = list(_find_handles(reasoner, individual))
    is_joint = reasoner.is_member(individual, CONSTRAINT)
    steps = () if others or is_joint else reasoner.parts(individual, through_joints=True)
    parts = [step.individual for step in steps]
    if others:
        lacks = f"has another handle, {', '.join(local_name(each) for each in others)}"
    elif is_joint:
        lacks = "has no handle: it is a joint, which has no parts"
    else:
        lacks = f"has no handle: {'none of its parts is a Handle' if parts else 'it has no parts'}"
    claims = [Claim(kind=ClaimKind.PART, subject=individual, object=each) for each in others]
    claims += [Claim(kind=ClaimKind.NOT_INSTANCE, subject=each, object=_HANDLE_CLASS) for each in parts]
    if (not parts and not others) or handle:
        claims.append(Claim(kind=ClaimKind.NOT_PART, subject=individual, object=handle))
    reason = f"{individual_text(reasoner, individual)} {lacks}"
    return MissingKnowledge(reasoner.class_of(individual) or THING, CHILD, reason, claims=tuple(claims))


def _part_lines(parts: Iterator[PartOfStep], part: Iri) -> Iterator[str]:
    for step in parts:
        if step.individual == part:
            yield from map(statement_line, step.path)
            return


class JointSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The two bodies that a joint connects, and its limits."""

    parent: Iri
    child: Iri
    linear: LinearLimits
    angular: AngularLimits

    def __str__(self) -> str:
        return f"{local_name(self.parent)} to {local_name(self.child)}, {', '.join(_unlocked_axes(self)) or 'fixed'}"


def _unlocked_axes(joint: JointSummary) -> Iterator[str]:
    """The axes that are not locked, with their limits."""
    linear, angular = joint.linear, joint.angular
    for axis in ("x", "y", "z", "twist", "swing2", "swing1"):
        slides = axis in {"x", "y", "z"}
        unit = "m" if slides else "rad"
        motions = linear if slides else angular
        motion, middle = getattr(motions, axis), getattr(motions, f"{axis}_middle")
        limit = linear.limit if slides else getattr(angular, f"{axis}_limit")
        text = f" {limit:g} {unit}" if middle == 0.0 else f" {middle - limit:g} to {middle + limit:g} {unit}"
        if motion is not AxisMotion.LOCKED:
            yield f"{axis} {motion.name.lower()}{text if motion is AxisMotion.LIMITED else ''}"


class PoseRow(AnswerRow, frozen=True, kw_only=True):
    """Where a body, joint or light is, and how it is oriented."""

    thing: IndividualName
    position: Vector
    """x, y, z [m] in `frame`."""
    quaternion: Quaternion
    """w, x, y, z: the rotation from the axes of the thing to those of `frame`."""
    frame: str
    """The frame of the pose: "map", whose z axis points up and which tf and all maps that are spawned share."""
    map: MapName
    """The map that the thing is described in."""
    source: str
    """Where the pose comes from: the name of the engine, or "map"."""


@question(
    sentences=(
        "what is the (pose|position|orientation) of {thing}",
        "where exactly is {thing}",
        "at which position is {thing}",
        "what are the coordinates of {thing}",
        "which (pose|position|orientation) does {thing} have",
    )
)
def pose_of(
    kb: QuestionContext, thing: IndividualName | None = None, map: MapName | None = None, *, present: StateAccess
) -> Iterator[PoseRow]:
    """Where a body, joint or light is at present: its position [m], and its orientation as a quaternion w, x, y, z.

    The pose is that of the center of the box of a body, in the frame of the map. It comes from the running simulation;
    if that does not have the thing, or there is none, from the map.

    Examples:
        pose_of milk_carton_1
        pose_of fridge_door
    """
    running = present.running()
    simulated = {world.iri for world in running.spawned} if running else set()
    if running and map in {None, *simulated}:
        homes = {each.iri: world.iri for world in reversed(running.spawned) for each in _entities(world)}
        for entity in _entities(running.world):
            if thing in {None, entity.iri}:
                yield _pose_row(entity, homes.get(entity.iri, running.world.iri), running.source)
    described = kb.reasoner.maps_of.get(thing, ()) if thing else kb.maps()
    for place in sorted(described):
        if place not in simulated and map in {None, place}:
            entities = _entities(kb.world(place)) if thing is None else [kb.scene_entity(thing, place)]
            yield from (_pose_row(entity, place, MAP_SOURCE) for entity in entities if entity is not None)


def _entities(world: World) -> Iterator[Body | Joint | Light]:
    return chain(world.bodies, world.joints, world.lights)


def _pose_row(entity: Body | Joint | Light, map: Iri, source: str) -> PoseRow:
    pose = entity.pose
    return PoseRow(
        thing=entity.iri, position=pose.position, quaternion=pose.quaternion, frame=_FRAME, map=map, source=source
    )


@pose_of.explain
def _explain_pose(kb: QuestionContext, row: PoseRow) -> Iterator[str]:
    x, y, z = row.position
    yield f"the center of {local_name(row.thing)} is at {x:g} {y:g} {z:g} m in the frame {row.frame}"
    yield source_text(row.source)


@pose_of.missing
def _missing_pose(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None:
        yield from missing_description(kb.reasoner, None, asked.map)
    elif asked.map and asked.map not in kb.reasoner.maps_of.get(asked.thing, ()):
        yield from missing_description(kb.reasoner, asked.thing, asked.map)
    else:
        why = f"{individual_text(kb.reasoner, asked.thing)} has no pose: no map or simulation that was asked places it"
        claim = Claim(kind=ClaimKind.NO_BODY, subject=asked.thing, map=asked.map)
        yield MissingKnowledge(kb.reasoner.class_of(asked.thing) or THING, HAS_POSE, why, claims=(claim,))


class IndividualDescription(AnswerRow, frozen=True, kw_only=True):
    """Everything that is known about an individual."""

    individual: IndividualName
    classes: tuple[ClassName, ...]
    """The asserted classes, the most specific first; then those that are inferred."""
    map: MapName | None
    label: str | None = None
    pose: Pose | None = None
    size: Vector | None = None
    """Depth, width, height [m]."""
    mass_kg: float | None = None
    mobility: str | None = None
    mesh: str | None = None
    joint: JointSummary | None = None
    """Only if the individual is a joint."""
    assumed: tuple[str, ...] = ()
    """What no map states and its reader assumed, such as `mobility`, or the `axis`, `limits` or `parent` of a joint."""
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()
    """All other statements: those of the map that have no field here, and those asserted at run time."""
    source: str | None = None
    """Where the pose comes from: the name of the engine, or "map"; None without a pose."""


@question(
    sentences=(
        "what is {individual}",
        "describe {individual}",
        "what do you know about {individual}",
        "tell me about {individual}",
        "how (big|large) is {individual}",
        "what (size|mass) does {individual} have",
        "what is the (size|mesh|joint limit) of {individual}",
        "which properties does {individual} have",
        "what kind of thing is {individual}",
    )
)
def what_is(
    kb: QuestionContext, individual: IndividualName | None = None, map: MapName | None = None, *, present: StateAccess
) -> Iterator[IndividualDescription]:
    """What an individual is: its classes, pose, size, mass, mesh, tags, joint limits, and all other statements.

    Classes that are not asserted are inferred from definitions, and from the domains and ranges of properties. Classes
    and other statements include those asserted at run time. The pose is that of the running simulation, if it has the
    individual, as `source` says; everything else is as the map's file gives it.

    Examples:
        what_is milk_carton_1
        what_is fridge_door_hinge
    """
    index = kb.reasoner
    running = present.running()
    spawned = {world.iri for world in running.spawned} if running else set()
    live = {entity.iri: entity for entity in _entities(running.world)} if running else {}
    for each in sorted({*index.maps_of, *live}) if individual is None else (individual,):
        classes = _most_specific_first(index, each)
        places = index.maps_of.get(each, ()) if map is None else [map] if map in index.maps_of.get(each, ()) else []
        entity = live.get(each)
        for place in places:
            described = _description(kb, each, classes, place)
            yield _with_current_pose(described, entity, running) if place in spawned else described
        if not places and map is None:
            if not classes and isinstance(entity, Body):
                classes = (entity.cls,)
            yield _with_current_pose(_description(kb, each, classes, None), entity, running)


def _with_current_pose(
    description: IndividualDescription, entity: Body | Joint | Light | None, running: WorldState | None
) -> IndividualDescription:
    """The description with the pose that the engine has."""
    if entity is None or running is None:
        return description
    return msgspec.structs.replace(description, pose=entity.pose, source=running.source)


def _most_specific_first(reasoner: Reasoner, individual: Iri) -> tuple[Iri, ...]:
    asserted = reasoner.types.get(individual, ())
    order = {
        cls: (cls not in asserted, -len(reasoner.classes.above(cls)), cls) for cls in reasoner.types_of(individual)
    }
    return tuple(sorted(order, key=lambda cls: order[cls]))


def _description(
    kb: QuestionContext, individual: Iri, classes: tuple[Iri, ...], map: Iri | None
) -> IndividualDescription:
    entity = kb.scene_entity(individual, map) if map else None
    if entity is None:
        return IndividualDescription(individual=individual, classes=classes, map=map, facts=kb.facts_of(individual))
    facts = tuple(dict.fromkeys((*entity.facts, *kb.facts_of(individual, runtime_only=True))))
    description = IndividualDescription(
        individual=individual,
        classes=classes,
        map=map,
        pose=entity.pose,
        tags=entity.tags,
        facts=facts,
        source=MAP_SOURCE,
    )
    match entity:
        case Body(physics=physics):
            return msgspec.structs.replace(
                description,
                label=entity.label,
                size=entity.size,
                mass_kg=physics.mass_kg,
                mobility=physics.mobility.value if physics.mobility else None,
                mesh=entity.mesh,
                assumed=physics.assumed,
            )
        case Joint():
            return msgspec.structs.replace(
                description, joint=_joint_summary(kb.world(map), entity), assumed=entity.assumed
            )
        case _:
            return description


def _joint_summary(world: World, joint: Joint) -> JointSummary:
    iris = {body.id: body.iri for body in world.bodies}
    parent, child = (iris.get(id, Iri(id)) for id in (joint.parent, joint.child))
    return JointSummary(parent=parent, child=child, linear=joint.linear, angular=joint.angular)


@what_is.explain
def _explain_individual(kb: QuestionContext, row: IndividualDescription) -> Iterator[str]:
    classes = kb.reasoner.classes
    for cls in row.classes:
        farthest = max(classes.above(cls), key=lambda above: classes.above(cls)[above])
        yield from membership_lines(kb.reasoner, row.individual, cls)
        yield from subclass_line(classes.path(cls, farthest))
    yield from _lines_of_class_values(kb, row)
    for name in row.assumed:
        yield f"no map states the {name} of {local_name(row.individual)}: it is assumed"


def _lines_of_class_values(kb: QuestionContext, row: IndividualDescription) -> Iterator[str]:
    """The classes that give the size and the mesh of an individual, where it does not state its own."""
    own = {fact.property for fact in kb.facts_of(row.individual)}
    sizes = tuple(codec.property for codec in (*SIZE, BOUNDING_BOX))
    for value, properties in ((row.size, sizes), (row.mesh, (MESH.property,))):
        if value is None or own.intersection(properties):
            continue
        for property in properties:
            given = [
                (len(kb.reasoner.classes.path(cls, each.cls)), each.cls, each.restriction)
                for cls in row.classes
                for each in kb.reasoner.restrictions(cls)
                if each.restriction.property == property
                and each.restriction.restriction_type is RestrictionType.HAS_VALUE
            ]
            if given:
                _, cls, restriction = min(given, key=lambda each: each[:2])
                yield restriction_line(cls, restriction)


@what_is.missing
def _missing_individual(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, asked.individual, asked.map)


class MapCounts(AnswerRow, frozen=True, kw_only=True):
    """The statistics of one map."""

    map: MapName
    classes: int
    individuals: int
    objects: int
    constraints: int
    relations: int


@question(
    sentences=(
        "what does {map} contain in numbers",
        "how big is the map {map}",
        "how many (joints|individuals) are there",
    )
)
def analyze(kb: QuestionContext, map: MapName | None = None) -> Iterator[MapCounts]:
    """Counts of what a map describes, as its files state it: the numbers of the thesis's analyse_semantic_map.

    Examples:
        analyze
    """
    for each in sorted(kb.maps()) if map is None else {map} & {*kb.maps()}:
        counts = kb.map_statistics(each)
        yield MapCounts(
            map=each,
            classes=counts.classes,
            individuals=counts.individuals,
            objects=counts.objects,
            constraints=counts.constraints,
            relations=counts.relations,
        )


@analyze.explain
def _explain_counts(kb: QuestionContext, row: MapCounts) -> Iterator[str]:
    name = local_name(row.map)
    yield f"{row.individuals} individuals have describedInMap {name}; their poses and limits are not counted"
    yield f"{row.constraints} of them are of a class that is a Constraint, and the other {row.objects} are objects"
    yield f"{row.classes} different classes are asserted as their types"
    yield f"{row.relations} different pairs of parent and child, including the two ends of each constraint"


@analyze.missing
def _missing_counts(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, None, None) if asked.map is None else missing_file(asked.map)
