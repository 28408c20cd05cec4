"""Questions about single things, and how much there is of them.

Questions about what things are made of.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import msgspec

from mindstage.knowledge.explain import (
    individual_text,
    membership_lines,
    missing_description,
    missing_file,
    statement_line,
    subclass_line,
)
from mindstage.knowledge.questions import (
    AnswerRow,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    question,
)
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.reasoner import PartOfStep, Reasoner
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, THING, TYPE, knowrob
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    Body,
    Iri,
    Joint,
    LinearLimits,
    Pose,
    PropertyAssertion,
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
    "analyse",
    "handle_of",
    "part_of",
    "what_is",
]


_HANDLE_CLASS = knowrob("Handle")


class PartOf(AnswerRow, frozen=True, kw_only=True):
    """A thing that is a part of another one, at any depth."""

    part: IndividualName
    whole: IndividualName
    depth: int
    """1 for a part, 2 for a part of a part, and so on."""
    map: MapName
    """The map that the whole is described in."""


@question
def part_of(
    kb: QuestionContext,
    part: IndividualName | None = None,
    whole: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[PartOf]:
    """Parts and wholes to any depth, whichever side tells of it; give the one to get the other.

    What a constraint joins is no part of it, nor of one another.

    Examples:
        part_of whole=fridge_door
        part_of fridge_door_handle
    """
    index = kb.reasoner
    if part is not None and whole is None:
        for up in index.wholes(part):
            for place in index.maps_of.get(up.individual, ()):
                yield PartOf(part=part, whole=up.individual, depth=up.depth, map=place)
        return
    for place in sorted(index.members_by_map) if map is None else (map,):
        for each in sorted(index.members_by_map[place]) if whole is None else (whole,):
            if place in index.maps_of.get(each, ()):
                for down in index.parts(each):
                    yield PartOf(part=down.individual, whole=each, depth=down.depth, map=place)


@part_of.explain
def _explain_part(kb: QuestionContext, row: PartOf) -> Iterator[str]:
    yield from _part_lines(kb.reasoner.parts(row.whole), row.part)


@part_of.missing
def _missing_parts(
    kb: QuestionContext, part: Iri | None = None, whole: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    if thing := whole or part:
        if map and map not in kb.reasoner.maps_of.get(thing, ()):
            yield from missing_description(kb.reasoner, thing, map)
            return
        what = (
            f"no part of {local_name(whole)}" if part and whole else "a part of nothing" if part else "made of nothing"
        )
        why = f"{local_name(part or thing)} is {what}: neither child, parent nor a property of parts leads there"
        yield MissingKnowledge(kb.reasoner.class_of(thing) or THING, CHILD, why)


class HandleOf(AnswerRow, frozen=True, kw_only=True):
    """A handle of a thing."""

    default_column: ClassVar[str] = "handle"
    individual: IndividualName
    handle: IndividualName
    map: MapName
    """The map that the thing is described in."""


@question
def handle_of(
    kb: QuestionContext,
    individual: IndividualName | None = None,
    handle: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[HandleOf]:
    """The handles of a thing: parts, at any depth, that are Handles; or all that a handle is the handle of.

    What hangs on a thing by a constraint counts as a part here: the handle of an oven's door is the oven's.

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
            for up in index.wholes(each, through_joints=True):
                places = () if index.is_member(up.individual, CONSTRAINT) else index.maps_of.get(up.individual, ())
                for place in places:
                    yield HandleOf(individual=up.individual, handle=each, map=place)


def _find_handles(reasoner: Reasoner, individual: Iri) -> Iterator[Iri]:
    parts = () if reasoner.is_member(individual, CONSTRAINT) else reasoner.parts(individual, through_joints=True)
    return (down.individual for down in parts if reasoner.is_member(down.individual, _HANDLE_CLASS))


@handle_of.explain
def _explain_handle(kb: QuestionContext, row: HandleOf) -> Iterator[str]:
    yield from _part_lines(kb.reasoner.parts(row.individual, through_joints=True), row.handle)
    yield from membership_lines(kb.reasoner, row.handle, _HANDLE_CLASS)


@handle_of.missing
def _missing_handle(
    kb: QuestionContext, individual: Iri | None = None, handle: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    index = kb.reasoner
    if handle and not index.is_member(handle, _HANDLE_CLASS):
        yield MissingKnowledge(index.class_of(handle) or THING, TYPE, f"{individual_text(index, handle)} is no Handle")
    elif individual and map and map not in index.maps_of.get(individual, ()):
        yield from missing_description(index, individual, map)
    elif individual is not None:
        others = ", ".join(local_name(each) for each in _find_handles(index, individual))
        lacks = f"has another handle, {others}" if others else "has no handle: none of its parts is a Handle"
        yield MissingKnowledge(
            index.class_of(individual) or THING, CHILD, f"{individual_text(index, individual)} {lacks}"
        )
    elif handle:
        why = f"{individual_text(index, handle)} is the handle of nothing: it is a part of nothing"
        yield MissingKnowledge(index.class_of(handle) or THING, CHILD, why)


def _part_lines(parts: Iterator[PartOfStep], part: Iri) -> Iterator[str]:
    for down in parts:
        if down.individual == part:
            yield from map(statement_line, down.path)
            return


class JointSummary(msgspec.Struct, frozen=True, kw_only=True):
    """What a constraint joins, and how that moves."""

    parent: Iri
    child: Iri
    linear: LinearLimits
    angular: AngularLimits

    def __str__(self) -> str:
        return f"{local_name(self.parent)} to {local_name(self.child)}, {', '.join(_unlocked_axes(self)) or 'fixed'}"


def _unlocked_axes(joint: JointSummary) -> Iterator[str]:
    """The axes that are not locked."""
    linear, angular = joint.linear, joint.angular
    for axis in ("x", "y", "z", "twist", "swing2", "swing1"):
        slides = axis in {"x", "y", "z"}
        motion = getattr(linear if slides else angular, axis)
        limit = f" {linear.limit:g} m" if slides else f" {getattr(angular, f'{axis}_limit', 0.0):g} rad"
        if motion is not AxisMotion.LOCKED:
            yield f"{axis} {motion.name.lower()}{limit if motion is AxisMotion.LIMITED else ''}"


class IndividualDescription(AnswerRow, frozen=True, kw_only=True):
    """What is known of an individual."""

    individual: IndividualName
    classes: tuple[ClassName, ...]
    """As told, the most special first; then those that follow from definitions, or where nothing is told."""
    map: MapName | None
    label: str | None = None
    pose: Pose | None = None
    size: Vector | None = None
    """Depth, width, height [m]."""
    mass_kg: float | None = None
    mobility: str | None = None
    mesh: str | None = None
    joint: JointSummary | None = None
    """Of a constraint."""
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()
    """Every other statement about it: those that its map has no field for, and those told at run time."""


@question
def what_is(
    kb: QuestionContext, individual: IndividualName | None = None, map: MapName | None = None
) -> Iterator[IndividualDescription]:
    """What an individual is: classes, pose, size, mass, mesh, tags, how a constraint moves, and every other fact.

    Where nobody says what it is, a property that it has may do so by its domain or range. Classes and facts are as
    they were told last; everything else is as its map tells it.

    Examples:
        what_is milk_carton_1
        what_is fridge_door_hinge
    """
    index = kb.reasoner
    for each in sorted(index.maps_of) if individual is None else (individual,):
        told = _most_specific_first(index, each)
        places = index.maps_of.get(each, ()) if map is None else [map] if map in index.maps_of.get(each, ()) else []
        for place in places:
            yield _description(kb, each, told, place)
        if not places and map is None:
            yield _description(kb, each, told, None)


def _most_specific_first(reasoner: Reasoner, individual: Iri) -> tuple[Iri, ...]:
    told = reasoner.types.get(individual, ())
    order = {cls: (cls not in told, -len(reasoner.classes.above(cls)), cls) for cls in reasoner.types_of(individual)}
    return tuple(sorted(order, key=lambda cls: order[cls]))


def _description(
    kb: QuestionContext, individual: Iri, classes: tuple[Iri, ...], map: Iri | None
) -> IndividualDescription:
    placed = kb.scene_entity(individual, map) if map else None
    if placed is None:
        return IndividualDescription(individual=individual, classes=classes, map=map, facts=kb.facts_of(individual))
    facts = tuple(dict.fromkeys((*placed.facts, *kb.facts_of(individual, runtime_only=True))))
    known = IndividualDescription(
        individual=individual, classes=classes, map=map, pose=placed.pose, tags=placed.tags, facts=facts
    )
    match placed:
        case Body(physics=physics):
            return msgspec.structs.replace(
                known,
                label=placed.label,
                size=placed.size,
                mass_kg=physics.mass_kg,
                mobility=physics.mobility.value if physics.mobility else None,
                mesh=placed.mesh,
            )
        case Joint():
            return msgspec.structs.replace(known, joint=_joint_summary(kb.world(map), placed))
        case _:
            return known


def _joint_summary(world: World, constraint: Joint) -> JointSummary:
    iris = {body.id: body.iri for body in world.bodies}
    parent, child = (iris.get(id, Iri(id)) for id in (constraint.parent, constraint.child))
    return JointSummary(parent=parent, child=child, linear=constraint.linear, angular=constraint.angular)


@what_is.explain
def _explain_individual(kb: QuestionContext, row: IndividualDescription) -> Iterator[str]:
    classes = kb.reasoner.classes
    for cls in row.classes:
        farthest = max(classes.above(cls), key=lambda above: classes.above(cls)[above])
        yield from membership_lines(kb.reasoner, row.individual, cls)
        yield from subclass_line(classes.path(cls, farthest))


@what_is.missing
def _missing_individual(
    kb: QuestionContext, individual: Iri | None = None, map: Iri | None = None
) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, individual, map)


class MapCounts(AnswerRow, frozen=True, kw_only=True):
    """A map in numbers."""

    map: MapName
    classes: int
    individuals: int
    objects: int
    constraints: int
    relations: int


@question
def analyse(kb: QuestionContext, map: MapName | None = None) -> Iterator[MapCounts]:
    """A map in numbers, as its files tell it: what the thesis's analyse_semantic_map counts.

    Examples:
        analyse
    """
    for each in sorted(kb.maps()) if map is None else {map} & {*kb.maps()}:
        told = kb.map_statistics(each)
        yield MapCounts(
            map=each,
            classes=told.classes,
            individuals=told.individuals,
            objects=told.objects,
            constraints=told.constraints,
            relations=told.relations,
        )


@analyse.explain
def _explain_counts(kb: QuestionContext, row: MapCounts) -> Iterator[str]:
    name = local_name(row.map)
    yield f"{row.individuals} individuals say describedInMap {name}; their poses and limits are not counted"
    yield f"{row.constraints} of them are of a class that is a Constraint, and the other {row.objects} are objects"
    yield f"{row.classes} different classes are told as their types"
    yield f"{row.relations} different pairs of parent and child, the two ends of constraints among them"


@analyse.missing
def _missing_counts(kb: QuestionContext, map: Iri | None = None) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, None, None) if map is None else missing_file(map)
