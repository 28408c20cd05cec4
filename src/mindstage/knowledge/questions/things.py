"""Questions about single things, and about maps as a whole."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mindstage.errors import ArgumentRefused
from mindstage.knowledge.questions.question import ClassName, IndividualName, MapName, Row, question
from mindstage.knowledge.questions.words import is_line
from mindstage.world import Body, Fact, Iri, Pose, Tag, Vector, difference

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["Counts", "SameMaps", "Thing", "analyse", "identical_maps", "what_is"]


class Thing(Row, frozen=True, kw_only=True):
    """What is known of an individual."""

    individual: IndividualName
    classes: tuple[ClassName, ...]
    """As told, the most special first."""
    map: MapName | None
    label: str | None = None
    pose: Pose | None = None
    size: Vector | None = None
    """Depth, width, height [m]."""
    mass_kg: float | None = None
    mobility: str | None = None
    tags: tuple[Tag, ...] = ()
    facts: tuple[Fact, ...] = ()
    """Every other statement about it; empty for what has no place in a world."""


@question
def what_is(kb: KnowledgeBase, individual: IndividualName | None = None, map: MapName | None = None) -> Iterator[Thing]:
    """What an individual is: classes, pose, size, mass, tags and every other fact, as its map tells them.

    What was told afterwards is in the classes, not in the rest.

    Examples:
        what_is milk_carton_1
    """
    index = kb.index
    for each in sorted(index.maps_of) if individual is None else (individual,):
        told = sorted(index.types.get(each, ()), key=lambda cls: (-len(index.classes.above(cls)), cls))
        places = index.maps_of.get(each, ()) if map is None else [map] if map in index.maps_of.get(each, ()) else []
        for place in places:
            body = kb.body_of(each, place)
            yield _thing(each, tuple(told), place, body)
        if not places and map is None:
            yield Thing(individual=each, classes=tuple(told), map=None)


def _thing(individual: Iri, classes: tuple[Iri, ...], map: Iri, body: Body | None) -> Thing:
    if body is None:
        return Thing(individual=individual, classes=classes, map=map)
    physics = body.physics
    return Thing(
        individual=individual,
        classes=classes,
        map=map,
        label=body.label,
        pose=body.pose,
        size=body.size,
        mass_kg=physics.mass_kg,
        mobility=physics.mobility.value if physics.mobility else None,
        tags=body.tags,
        facts=body.facts,
    )


@what_is.because
def _superclasses(kb: KnowledgeBase, row: Thing) -> Iterator[str]:
    classes = kb.index.classes
    for cls in row.classes:
        yield from is_line(classes.path(cls, max(classes.above(cls), key=lambda above: classes.above(cls)[above])))


class Counts(Row, frozen=True, kw_only=True):
    """A map in numbers."""

    map: MapName
    classes: int
    individuals: int
    objects: int
    constraints: int
    relations: int


@question
def analyse(kb: KnowledgeBase, map: MapName | None = None) -> Iterator[Counts]:
    """A map in numbers, as its files tell it: what the thesis's analyse_semantic_map counts.

    Examples:
        analyse
    """
    for each in sorted(kb.maps()) if map is None else {map} & {*kb.maps()}:
        told = kb.analyse(each)
        yield Counts(
            map=each,
            classes=told.classes,
            individuals=told.individuals,
            objects=told.objects,
            constraints=told.constraints,
            relations=told.relations,
        )


class SameMaps(Row, frozen=True, kw_only=True):
    """Two maps, held against each other."""

    a: MapName
    b: MapName
    identical: bool
    differing: tuple[str, ...]
    """Ids of all that stands in one only, or differs by more than the tolerance."""


@question
def identical_maps(
    kb: KnowledgeBase, a: MapName | None = None, b: MapName | None = None, tolerance: float = 0.0
) -> Iterator[SameMaps]:
    """Whether two maps tell of the same world, and the ids of all that differs by more than the tolerance.

    A map that was only told of, and stands in no file, is not compared.

    Examples:
        identical_maps kitchen kitchen
    """
    if not tolerance >= 0.0:
        raise ArgumentRefused(
            "identical_maps, tolerance", cause=f"{tolerance} forgives nothing", remedy="give 0 or more"
        )
    known = sorted(kb.maps())
    for one in known if a is None else {a} & {*known}:
        for other in known if b is None else {b} & {*known}:
            if one != other or (a and b):
                found = difference(kb.world(one), kb.world(other))
                ids = [*found.only_in_a, *found.only_in_b, *(change.id for change in found.beyond(tolerance))]
                yield SameMaps(a=one, b=other, identical=not ids, differing=tuple(dict.fromkeys(ids)))
