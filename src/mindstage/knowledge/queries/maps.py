"""Questions about maps: which are loaded, what they contain, and how two of them differ."""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import Any

import msgspec

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import (
    membership_lines,
    missing_description,
    missing_file,
    missing_instance,
    statement_line,
)
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    question,
)
from mindstage.knowledge.reasoner_properties import ObjectTriple
from mindstage.ranges import NotNegative
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, THING, TYPE
from mindstage.scene import MECHANICAL_KINDS, Iri, WorldDiff, diff

__all__ = [
    "InstanceOfClass",
    "MapDifference",
    "MapEquality",
    "MapInfo",
    "MapMember",
    "differences",
    "everything_in_map",
    "identical_maps",
    "individual_of_class",
    "maps",
]


class MapInfo(AnswerRow, frozen=True, kw_only=True):
    """A map and the number of its individuals."""

    map: MapName
    individuals: int


@question(
    sentences=(
        "which maps are (loaded|there)",
        "what maps are (loaded|there)",
        "list [all] maps",
        "which environments are (loaded|there)",
    )
)
def maps(kb: QuestionContext, map: MapName | None = None) -> Iterator[MapInfo]:
    """All semantic maps that are loaded, with the number of their individuals.

    Examples:
        maps
    """
    index = kb.reasoner
    for each in sorted(index.members_by_map) if map is None else (map,):
        yield MapInfo(map=each, individuals=len(index.members_by_map[each]))


@maps.explain
def _explain_map(kb: QuestionContext, row: MapInfo) -> Iterator[str]:
    if SEMANTIC_MAP in kb.reasoner.types.get(row.map, ()):
        yield statement_line(ObjectTriple(row.map, TYPE, SEMANTIC_MAP))
    yield f"{row.individuals} have describedInMap {local_name(row.map)}; their poses and limits are not counted"


@maps.missing
def _missing_maps(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, None, asked.map)


class MapMember(AnswerRow, frozen=True, kw_only=True):
    """An individual that is described in a map."""

    individual: IndividualName
    cls: ClassName | None
    """The most specific of its classes."""
    map: MapName


@question(
    sentences=(
        "what is in {map}",
        "what is there",
        "which (things|objects) are in {map}",
        "what does the map {map} contain",
        "is {individual} in {map}",
        "does {individual} exist",
    )
)
def everything_in_map(
    kb: QuestionContext, individual: IndividualName | None = None, map: MapName | None = None
) -> Iterator[MapMember]:
    """Everything that is described in a map: objects and joints.

    Examples:
        everything_in_map
        everything_in_map milk_carton_1
    """
    index = kb.reasoner
    for place in sorted(index.members_by_map) if map is None else (map,):
        for each in index.individuals_in(place, individual):
            yield MapMember(individual=each, cls=index.class_of(each), map=place)


@everything_in_map.explain
def _explain_membership(kb: QuestionContext, row: MapMember) -> Iterator[str]:
    yield statement_line(ObjectTriple(row.individual, DESCRIBED_IN_MAP, row.map))


@everything_in_map.missing
def _missing_members(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    yield from missing_description(kb.reasoner, asked.individual, asked.map)


class InstanceOfClass(AnswerRow, frozen=True, kw_only=True):
    """An individual of a class or of one of its subclasses."""

    cls: ClassName
    individual: IndividualName
    map: MapName


@question(
    sentences=(
        "what class does {individual} have",
        "which classes does {individual} have",
        "is {individual} a kind of {cls}",
        "is {individual} an instance of {cls}",
        "what are the instances of {cls}",
    )
)
def individual_of_class(
    kb: QuestionContext,
    cls: ClassName | None = None,
    individual: IndividualName | None = None,
    map: MapName | None = None,
) -> Iterator[InstanceOfClass]:
    """The individuals of a class and of its subclasses in a map; or all classes of an individual.

    Examples:
        individual_of_class Handle
        individual_of_class individual=milk_carton_1
    """
    index = kb.reasoner
    if cls is not None and individual is None:
        members, maps_of = index.members(cls, map), index.maps_of
        found = [(place, each) for each in members for place in ((map,) if map else maps_of.get(each, ()))]
        for place, each in sorted(found, key=itemgetter(0)):  # within a map they are in order already
            yield InstanceOfClass(cls=cls, individual=each, map=place)
        return
    for place in sorted(index.members_by_map) if map is None else (map,):
        for each in index.individuals_in(place, individual):
            classes = {above: None for own in index.types_of(each) for above in index.classes.above(own)}
            for above in classes if cls is None else [cls] if cls in classes else []:
                yield InstanceOfClass(cls=above, individual=each, map=place)


@individual_of_class.explain
def _explain_class(kb: QuestionContext, row: InstanceOfClass) -> Iterator[str]:
    yield from membership_lines(kb.reasoner, row.individual, row.cls)


@individual_of_class.missing
def _missing_individuals(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    index = kb.reasoner
    places = index.maps_of.get(asked.individual, ()) if asked.individual else ()
    if asked.individual and not (asked.map in places if asked.map else places):
        yield from missing_description(index, asked.individual, asked.map)
    elif asked.cls:
        yield from missing_instance(index, asked.cls, asked.individual, asked.map)
    elif asked.individual:
        reason = f"the class of {local_name(asked.individual)} is unknown: no type of it is a class"
        claim = Claim(kind=ClaimKind.NO_CLASS, subject=asked.individual)
        yield MissingKnowledge(THING, TYPE, reason, claims=(claim,))
    else:
        yield from missing_description(index, None, asked.map)


class MapEquality(AnswerRow, frozen=True, kw_only=True):
    """The result of comparing two maps."""

    a: MapName
    b: MapName
    identical: bool
    """In everything, including sizes, meshes and other statements."""
    identical_mechanics: bool
    """In poses, masses, limits and existing entities only, which is what the thesis compares."""
    differing: tuple[str, ...]
    """The ids of entities that only one of the maps has, or that differ by more than the tolerance."""


@question(
    sentences=(
        "are {a} and {b} (identical|equal|same|the same)",
        "is {a} identical to {b}",
        "is {a} the same map as {b}",
        "are {a} and {b} identical within {tolerance}",
    )
)
def identical_maps(
    kb: QuestionContext, a: MapName | None = None, b: MapName | None = None, tolerance: NotNegative = 0.0
) -> Iterator[MapEquality]:
    """Whether two maps describe the same world, and the ids of all entities that differ by more than the tolerance.

    A map that no loaded file describes is not compared.

    Examples:
        identical_maps kitchen kitchen
    """
    for one, other, found in _map_pairs(kb, a, b, tolerance):
        ids = [*found.only_in_a, *found.only_in_b, *(change.id for change in found.exceeding(tolerance))]
        yield MapEquality(
            a=one,
            b=other,
            identical=not ids,
            identical_mechanics=found.identical(tolerance, kinds=MECHANICAL_KINDS),
            differing=tuple(dict.fromkeys(ids)),
        )


class MapDifference(AnswerRow, frozen=True, kw_only=True):
    """An entity, or one of its fields, that differs between two maps."""

    a: MapName
    b: MapName
    id: str
    """The id of a body, joint or light; the IRI of anything else."""
    field: str
    """Dotted, such as `pose.position`; empty if only one of the maps has the entity."""
    in_a: str | None
    """The first map's value as JSON; None if it has none."""
    in_b: str | None
    error: float | None
    """The difference of the two values, in meters, radians or kilograms; None if they are not numbers."""


@question(
    sentences=(
        "how do {a} and {b} differ",
        "what is the difference between {a} and {b}",
        "(what is the difference|what are the differences) between the [two] maps",
        "how do the [two] maps differ",
        "what has changed (from|between) {a} (to|and) {b}",
        "compare {a} (and|with) {b}",
        "how does {a} differ from {b} by more than {tolerance}",
    )
)
def differences(
    kb: QuestionContext, a: MapName | None = None, b: MapName | None = None, tolerance: NotNegative = 0.0
) -> Iterator[MapDifference]:
    """How two maps differ: the entities that only one of them has, and each field with different values.

    Examples:
        differences kitchen kitchen
    """
    for one, other, found in _map_pairs(kb, a, b, tolerance):
        for id in found.only_in_a:
            yield MapDifference(a=one, b=other, id=id, field="", in_a=id, in_b=None, error=None)
        for id in found.only_in_b:
            yield MapDifference(a=one, b=other, id=id, field="", in_a=None, in_b=id, error=None)
        for change in found.exceeding(tolerance):
            yield MapDifference(
                a=one,
                b=other,
                id=change.id,
                field=change.field,
                in_a=_json_text(change.a),
                in_b=_json_text(change.b),
                error=change.error,
            )


@identical_maps.explain
def _explain_comparison(kb: QuestionContext, row: MapEquality) -> Iterator[str]:
    a, b = kb.world(row.a), kb.world(row.b)
    numbers = f"{len(a.bodies)} and {len(b.bodies)} bodies, {len(a.joints)} and {len(b.joints)} joints"
    yield f"{numbers} were compared, including all fields and other statements"
    for each in differences.ask(kb, {"a": row.a, "b": row.b}):
        if each.id in row.differing:
            yield _difference_text(each)


@differences.explain
def _explain_difference(kb: QuestionContext, row: MapDifference) -> Iterator[str]:
    yield _difference_text(row)


@identical_maps.missing
@differences.missing
def _missing_map_pair(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    known = kb.maps()
    for map in dict.fromkeys(map for map in (asked.a, asked.b) if map and map not in known):
        yield from missing_file(map)
    if len(known) < 2 and not (asked.a and asked.b):
        loaded = {0: "no map is", 1: "1 map is"}[len(known)]
        reason = f"{loaded} loaded, and a comparison needs two"
        claim = Claim(kind=ClaimKind.FEWER_MAPS, object="2")
        yield MissingKnowledge(SEMANTIC_MAP, DESCRIBED_IN_MAP, reason, claims=(claim,))


def _map_pairs(
    kb: QuestionContext, a: Iri | None, b: Iri | None, tolerance: float
) -> Iterator[tuple[Iri, Iri, WorldDiff]]:
    """All pairs of different maps; a map and itself only if both arguments are given."""
    known = sorted(kb.maps())
    for one in known if a is None else {a} & {*known}:
        for other in known if b is None else {b} & {*known}:
            if one != other or (a and b):
                yield one, other, diff(kb.world(one), kb.world(other))


def _difference_text(row: MapDifference) -> str:
    """The two values of a field, or the only map that has the entity."""
    if not row.field:
        return f"{row.id} is only in {local_name(row.a if row.in_b is None else row.b)}"
    apart = "" if row.error is None else f", {row.error:g} apart"
    return f"{row.id} {row.field}: {row.in_a} in {local_name(row.a)}, {row.in_b} in {local_name(row.b)}{apart}"


def _json_text(value: Any) -> str | None:
    return None if value is None else msgspec.json.encode(value).decode()
