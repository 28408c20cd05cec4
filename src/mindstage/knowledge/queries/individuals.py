"""Questions about single things, and how much there is of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import (
    AnswerRow,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    question,
)
from mindstage.knowledge.questions.words import membership_lines, missing_description, missing_file, subclass_line
from mindstage.knowledge.reasoning import Reasoner
from mindstage.world import (
    AngularLimits,
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

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["IndividualDescription", "JointSummary", "MapCounts", "analyse", "what_is"]


class JointSummary(msgspec.Struct, frozen=True, kw_only=True):
    """What a constraint joins, and how that moves."""

    parent: Iri
    child: Iri
    linear: LinearLimits
    angular: AngularLimits


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
    kb: KnowledgeBase, individual: IndividualName | None = None, map: MapName | None = None
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
    kb: KnowledgeBase, individual: Iri, classes: tuple[Iri, ...], map: Iri | None
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
def _explain_individual(kb: KnowledgeBase, row: IndividualDescription) -> Iterator[str]:
    classes = kb.reasoner.classes
    for cls in row.classes:
        farthest = max(classes.above(cls), key=lambda above: classes.above(cls)[above])
        yield from membership_lines(kb.reasoner, row.individual, cls)
        yield from subclass_line(classes.path(cls, farthest))


@what_is.missing
def _missing_individual(
    kb: KnowledgeBase, individual: Iri | None = None, map: Iri | None = None
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
def analyse(kb: KnowledgeBase, map: MapName | None = None) -> Iterator[MapCounts]:
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
def _explain_counts(kb: KnowledgeBase, row: MapCounts) -> Iterator[str]:
    name = local_name(row.map)
    yield f"{row.individuals} individuals say describedInMap {name}; their poses and limits are not counted"
    yield f"{row.constraints} of them are of a class that is a Constraint, and the other {row.objects} are objects"
    yield f"{row.classes} different classes are told as their types"
    yield f"{row.relations} different pairs of parent and child, the two ends of constraints among them"


@analyse.missing
def _missing_counts(kb: KnowledgeBase, map: Iri | None = None) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, None, None) if map is None else missing_file(map)
