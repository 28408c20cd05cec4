"""Questions that compare and count things: sizes, numbers, likeness, things that are not where they belong, states."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from enum import StrEnum

import numpy as np

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import individual_text, missing_instance, source_text
from mindstage.knowledge.queries.proximity import (
    PlacedBodies,
    missing_bodies,
    placed_states,
    unless_bodies_are_missing,
)
from mindstage.knowledge.queries.spatial import body_claims
from mindstage.knowledge.queries.storage import storage_place
from mindstage.knowledge.questions import (
    MAP_SOURCE,
    AnswerRow,
    AskedArguments,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    PropertyName,
    QuestionContext,
    StateAccess,
    ValueName,
    question,
)
from mindstage.ranges import Count
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import HAS_POSE, THING, TYPE, knowrob, ms
from mindstage.scene import Body, Iri, IriRef, Literal, PropertyAssertion
from mindstage.scene.bounding_boxes import footprints, polygon_areas
from mindstage.scene.spatial import SpatialRelation
from mindstage.scene.transforms import Array

__all__ = [
    "ClassCount",
    "LargerRow",
    "Measure",
    "MisplacedRow",
    "SimilarRow",
    "StateRow",
    "how_many",
    "larger_than",
    "misplaced",
    "similar_to",
    "states",
]

_TOLERANCE = 1e-6
"""Values that differ by a smaller fraction are equal."""
_SIZE_PROPERTY = knowrob("depthOfObject")
_CONTAINER_FOR = knowrob("typePrimaryFunction-containerFor")
_STATE_PROPERTIES = (ms("state"), knowrob("stateOfObject"))
_MIN_COMMON_FRACTION = 0.5
_SIMILAR_COUNT = 10


# -- larger than -------------------------------------------------------------------------------------------------------


class Measure(StrEnum):
    """What bodies are compared by."""

    VOLUME = "volume"
    """Volume of the bounding box [m³]."""
    HEIGHT = "height"
    """Vertical extent at the current pose [m]."""
    LENGTH = "length"
    """The longest side of the bounding box [m]."""
    FOOTPRINT = "footprint"
    """Area of the vertical projection of the bounding box [m²]."""
    MASS = "mass"
    """The mass that the map states [kg]."""


class LargerRow(AnswerRow, frozen=True, kw_only=True):
    """A body that is larger than another one by a measure."""

    thing: IndividualName
    measure: Measure
    other: IndividualName
    value: float
    """Of the thing, in the unit of the measure."""
    other_value: float
    map: MapName
    """The map that `thing` is described in."""
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    needs="thing or other: the comparisons of all pairs of bodies are not listed",
)
def larger_than(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    measure: Measure | None = None,
    other: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[LargerRow]:
    """Which bodies are larger, taller, longer or heavier than others; the most similar first.

    `thing` or `other` must be given: the smaller bodies, or the larger ones. `volume` is that of the bounding box,
    `height` the vertical extent at the current pose, `length` the longest side, `footprint` the area seen from above,
    `mass` what the map states. A difference of less than 1e-6 of the value is none.

    Examples:
        larger_than fridge height oven
        larger_than measure=height other=fridge
    """
    for bodies in placed_states(present, map):
        given = [bodies.row_of(each) for each in (thing, other) if each is not None]
        if None in given:
            continue
        fixed = given[0] or 0
        for each in Measure if measure is None else (measure,):
            values = _values(bodies, each)
            free = [given[1] or 0] if len(given) == 2 else [row for row in range(len(values)) if row != fixed]
            pairs = [(fixed, row) if thing is not None else (row, fixed) for row in free]
            larger = [pair for pair in pairs if values[pair[0]] > values[pair[1]] * (1.0 + _TOLERANCE)]
            for one, two in sorted(larger, key=lambda pair: (values[pair[0]] - values[pair[1]], pair)):
                yield LargerRow(
                    thing=bodies.iri(one),
                    measure=each,
                    other=bodies.iri(two),
                    value=_rounded(values[one]),
                    other_value=_rounded(values[two]),
                    map=bodies.map(one),
                    source=bodies.state.source,
                )


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


def _values(bodies: PlacedBodies, measure: Measure) -> list[float]:
    """The measure of each body; not a number, which is neither larger nor smaller, where it is unknown."""
    placed = bodies.placed
    extents = 2 * placed.boxes.half_extents
    match measure:
        case Measure.VOLUME:
            found: Array = extents.prod(axis=1)
        case Measure.HEIGHT:
            found = placed.high[:, 2] - placed.low[:, 2]
        case Measure.LENGTH:
            found = extents.max(axis=1, initial=0.0)
        case Measure.FOOTPRINT:
            found = polygon_areas(footprints(placed.boxes))
        case Measure.MASS:
            return [body.physics.mass_kg or float("nan") for body in placed.bodies]
    known = np.array([body.size is not None for body in placed.bodies], dtype=bool)
    return np.where(known, found, np.nan).tolist()  # type: ignore[no-any-return]


_UNITS = {
    Measure.VOLUME: "m³",
    Measure.HEIGHT: "m",
    Measure.LENGTH: "m",
    Measure.FOOTPRINT: "m²",
    Measure.MASS: "kg",
}


@larger_than.explain
def _explain_larger(kb: QuestionContext, row: LargerRow) -> Iterator[str]:
    unit = _UNITS[row.measure]
    thing, other = local_name(row.thing), local_name(row.other)
    yield f"{row.measure} of {thing}: {row.value:g} {unit}; of {other}: {row.other_value:g} {unit}"
    yield source_text(row.source)


@larger_than.missing
@unless_bodies_are_missing("thing", "other")
def _missing_larger(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    measure = asked.plain("measure", Measure)
    by = f" by {measure}" if measure is not None else ""
    what = individual_text(kb.reasoner, asked.thing) if asked.thing is not None else "nothing"
    verb = "is larger" if asked.thing is None else "is not larger"
    than = local_name(asked.other) if asked.other is not None else "any other body"
    unknown = " whose mass is stated" if measure is Measure.MASS else ""
    reason = f"{what}{unknown if asked.thing is None else ''} {verb} than {than}{by}"
    claims = body_claims((asked.thing, asked.other), asked.present.states(asked.map), asked.map)
    claims += tuple(
        Claim(kind=ClaimKind.NOT_LARGER, subject=asked.thing, object=asked.other, detail=each, map=asked.map)
        for each in ([measure] if measure is not None else Measure)
    )
    yield MissingKnowledge(THING, _SIZE_PROPERTY, reason, claims=claims)


# -- how many ----------------------------------------------------------------------------------------------------------


class ClassCount(AnswerRow, frozen=True, kw_only=True):
    """The number of individuals of a class."""

    cls: ClassName
    count: int
    map: MapName
    place: IndividualName | None
    """The body that they are on or in; None for the whole map."""
    source: str
    """Where the poses come from, if a place was given: the name of the engine, or "map"."""


@question(sentences=("how many {cls} are in {map}",))
def how_many(
    kb: QuestionContext,
    cls: ClassName | None = None,
    map: MapName | None = None,
    place: IndividualName | None = None,
    *,
    present: StateAccess,
) -> Iterator[ClassCount]:
    """How many individuals of a class, with those of its subclasses, a map has; or how many are on or in a place now.

    On and inside are those of the question `where_is`. A class without individuals has no row.

    Examples:
        how_many Cup
        how_many Plate place=table
    """
    index = kb.reasoner
    wanted, source = _contents(present, place, map) if place is not None else (None, MAP_SOURCE)
    for each in sorted(index.members_by_map) if map is None else (map,):
        if wanted is not None:
            members = [iri for iri, home in wanted if home == each]
        else:
            members = list(index.members(cls, each)) if cls is not None else list(index.individuals_in(each))
        if cls is not None:
            count = sum(index.is_member(member, cls) for member in members)
            if count:
                yield ClassCount(cls=cls, count=count, map=each, place=place, source=source)
            continue
        counts = Counter(
            above
            for member in members
            for above in {above: None for own in index.types_of(member) for above in index.classes.above(own)}
        )
        for above in sorted(counts):
            yield ClassCount(cls=above, count=counts[above], map=each, place=place, source=source)


def _contents(present: StateAccess, place: Iri, map: Iri | None) -> tuple[list[tuple[Iri, Iri]], str]:
    """What is on or in a body, with the maps, and the source of the poses."""
    source, found = MAP_SOURCE, dict[tuple[Iri, Iri], None]()
    for state in present.states(map):
        ids = [body.id for body in state.world.bodies if body.iri == place]
        homes = state.map_of_body
        relations = (SpatialRelation.ON, SpatialRelation.INSIDE)
        if ids:
            source = state.source
            for pair in state.relations.related(others=ids, relations=relations):
                found[pair.body.iri, homes[pair.body.id]] = None
    return list(found), source


@how_many.explain
def _explain_count(kb: QuestionContext, row: ClassCount) -> Iterator[str]:
    if row.place is not None:
        number = f"{row.count} of the individuals in {local_name(row.map)} that are a {local_name(row.cls)}"
        yield f"{number}: on or inside {local_name(row.place)}"
        yield source_text(row.source)
        return
    own = Counter(local_name(kb.reasoner.class_of(each) or THING) for each in kb.reasoner.members(row.cls, row.map))
    kinds = ", ".join(f"{number} {name}" for name, number in sorted(own.items())[:20])
    yield f"of the {sum(own.values())} individuals in {local_name(row.map)} that are a {local_name(row.cls)}: {kinds}"


@how_many.missing
def _missing_count(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.place is not None:
        yield from missing_bodies(kb, (asked.place,), asked.map, asked.present)
        kind = f"no {local_name(asked.cls)}" if asked.cls is not None else "nothing"
        reason = f"{kind} is on or in {individual_text(kb.reasoner, asked.place)}"
        claims = body_claims((asked.place,), asked.present.states(asked.map), asked.map)
        yield MissingKnowledge(asked.cls or THING, HAS_POSE, reason, claims=claims)
    elif asked.cls is not None:
        yield from missing_instance(kb.reasoner, asked.cls, None, asked.map)


# -- alike -------------------------------------------------------------------------------------------------------------


class SimilarRow(AnswerRow, frozen=True, kw_only=True):
    """A body that is like another one."""

    thing: IndividualName
    other: IndividualName
    rank: int
    """1 for the most similar."""
    common: ClassName
    """The most specific class of both."""
    same_class: bool
    same_mesh: bool
    """Whether both state the same mesh."""
    size_difference: float | None
    """The largest relative difference of their sorted extents, 0 to 1; None if a size is unknown."""
    map: MapName
    """The map that `other` is described in."""


@question(
    needs="thing: the similarities of all pairs of bodies are not listed",
    sentences=(
        "what is (like|similar to|the same as) {thing}",
        "is {thing} (like|similar to|the same as) {other}",
        "(what|which things) (looks|look) like {thing}",
        "find something like {thing}",
        "are {thing} and {other} (alike|similar|the same)",
    ),
)
def similar_to(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    other: IndividualName | None = None,
    map: MapName | None = None,
    count: Count | None = None,
    *,
    present: StateAccess,
) -> Iterator[SimilarRow]:
    """What is the same as, or like, a thing: by class, mesh and size; the most similar first.

    `thing` must be given. Others share at least half of the classes of both (the Jaccard index of their ancestors), or
    state the same mesh. Those of the same class come first, then those that share more classes, then those with the
    same mesh, then those whose sorted extents differ less. `count` is the largest number of answers, 10 if it is left
    out.

    Examples:
        similar_to milk_carton_1
        similar_to plate_1 count=3
    """
    if thing is None:
        return
    limit = _SIMILAR_COUNT if count is None else count
    states_now = [(state, state.map_of_body) for state in present.states()]
    all_bodies = [(body, homes[body.id]) for state, homes in states_now for body in state.world.bodies]
    own = next((body for body, _ in all_bodies if body.iri == thing), None)
    if own is None:
        return
    above = {cls: frozenset(kb.reasoner.classes.above(cls)) for cls in {body.cls for body, _ in all_bodies}}
    ranked = []
    for at, (body, home) in enumerate(all_bodies):
        if body.iri == thing or map not in {None, home}:
            continue
        mine, theirs = above[own.cls], above[body.cls]
        common = len(mine & theirs) / max(1, len(mine | theirs))
        same_mesh = own.mesh is not None and own.mesh == body.mesh
        if common >= _MIN_COMMON_FRACTION or same_mesh:
            difference = _size_difference(own, body)
            order = (
                body.cls != own.cls,
                -round(common, 9),
                not same_mesh,
                2.0 if difference is None else difference,
                at,
            )
            ranked.append((order, body, home, same_mesh, difference))
    ranked.sort(key=lambda each: each[0])
    for rank, (_, body, home, same_mesh, difference) in enumerate(ranked[:limit], start=1):
        yield SimilarRow(
            thing=thing,
            other=body.iri,
            rank=rank,
            common=next((cls for cls in kb.reasoner.classes.above(own.cls) if cls in above[body.cls]), THING),
            same_class=body.cls == own.cls,
            same_mesh=same_mesh,
            size_difference=difference,
            map=home,
        )


def _size_difference(one: Body, other: Body) -> float | None:
    if one.size is None or other.size is None:
        return None
    pairs = zip(sorted(one.size), sorted(other.size), strict=True)
    return round(max(abs(a - b) / max(a, b, 1e-12) for a, b in pairs), 6)


@similar_to.explain
def _explain_similar(kb: QuestionContext, row: SimilarRow) -> Iterator[str]:
    kind = f"both are a {local_name(row.common)}" + ("" if row.same_class else ", the most specific class of both")
    yield kind
    if row.same_mesh:
        yield "both have the same mesh"
    if row.size_difference is not None:
        yield (
            f"their extents differ by at most {row.size_difference:.1%}"
            if row.size_difference
            else "they have one size"
        )


@similar_to.missing
def _missing_similar(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    thing = asked.needed("thing")
    cls = kb.reasoner.class_of(thing) or THING
    found = [lack for lack in missing_bodies(kb, (thing,), None, asked.present) if lack.property == HAS_POSE]
    yield from found
    if not found:
        what = local_name(asked.other) if asked.other is not None else "nothing"
        how = (
            f"among the {asked.plain('count', int) or _SIMILAR_COUNT} bodies that are most like"
            if asked.other is not None
            else "like"
        )
        reason = f"{what} is {'not ' if asked.other is not None else ''}{how} {individual_text(kb.reasoner, thing)}"
        claims = body_claims((thing, asked.other), asked.present.states(None), None)
        yield MissingKnowledge(cls, TYPE, f"{reason}: by class or mesh", claims=claims)


# -- misplaced ---------------------------------------------------------------------------------------------------------


class MisplacedRow(AnswerRow, frozen=True, kw_only=True):
    """A thing that is not where it belongs."""

    thing: IndividualName
    belongs: tuple[ClassName, ...]
    """The classes of places that store it, the most specific first."""
    homes: tuple[IndividualName, ...]
    """The individuals of these classes that are here."""
    now: tuple[IndividualName, ...]
    """What it is on or in; empty if that is nothing."""
    map: MapName
    """The map that the thing is described in."""
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    sentences=(
        "(what|which {cls}) is misplaced",
        "is {thing} misplaced",
        "what is not (where it belongs|in its place)",
        "which {cls} are not (where they belong|in their place)",
        "(what|which {cls}) is (in the wrong place|out of place)",
        "is {thing} (in the wrong place|out of place)",
        "is (anything|something) (misplaced|out of place|in the wrong place)",
        "is {thing} where it belongs",
        "what (should be|has to be) put away",
    )
)
def misplaced(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    map: MapName | None = None,
    cls: ClassName | None = None,
    *,
    present: StateAccess,
) -> Iterator[MisplacedRow]:
    """Which things are not where they belong: neither on nor in a place that stores things of their class.

    Where a thing belongs is the answer to the question `storage_place` for its class; where it is, that of
    `where_is`: on or inside a body, or on or inside something that is (bread in a basket in a cupboard). Things of
    classes that no place stores are not listed. `cls` restricts the things to a class.

    Examples:
        misplaced
        misplaced cls=Cup
    """
    for bodies in placed_states(present, map):
        hosts = _hosts(bodies)
        homes: dict[Iri, tuple[tuple[Iri, ...], tuple[Iri, ...], frozenset[Iri]]] = {}
        for row, body in enumerate(bodies.placed.bodies):
            if thing not in {None, body.iri} or not (cls is None or kb.reasoner.is_member(body.iri, cls)):
                continue
            if body.cls not in homes:
                homes[body.cls] = _storage(kb, bodies, body.cls)
            belongs, stores, storing = homes[body.cls]
            if belongs and not _chain(hosts, body.iri) & storing and body.iri not in storing:
                yield MisplacedRow(
                    thing=body.iri,
                    belongs=belongs,
                    homes=stores,
                    now=tuple(hosts.get(body.iri, ())),
                    map=bodies.map(row),
                    source=bodies.state.source,
                )


def _storage(
    kb: QuestionContext, bodies: PlacedBodies, cls: Iri
) -> tuple[tuple[Iri, ...], tuple[Iri, ...], frozenset[Iri]]:
    """The classes of places that store things of a class, and the bodies of these classes, also as a set."""
    if not kb.reasoner.is_class(cls):  # nothing but the body mentions it
        return (), (), frozenset()
    belongs = tuple(row.place for row in storage_place.ask(kb, {"item": cls}))
    places = sorted((body.iri, body.cls) for body in bodies.placed.bodies)
    stores = tuple(dict.fromkeys(iri for place in belongs for iri, own in places if kb.reasoner.is_a(own, place)))
    return belongs, stores, frozenset(stores)


def _hosts(bodies: PlacedBodies) -> dict[Iri, list[Iri]]:
    """What each body is directly on or in, the bodies that it is in first, smaller gaps before larger ones."""
    relations = (SpatialRelation.INSIDE, SpatialRelation.ON)
    pairs = list(bodies.state.relations.related(relations=relations))
    pairs.sort(key=lambda pair: (pair.relation is SpatialRelation.ON, abs(pair.gap), pair.other.id))
    found: dict[Iri, list[Iri]] = {}
    for pair in pairs:
        if pair.other.iri not in found.setdefault(pair.body.iri, []):
            found[pair.body.iri].append(pair.other.iri)
    return found


def _chain(hosts: Mapping[Iri, list[Iri]], start: Iri) -> set[Iri]:
    """Everything that a body is on or in, at any depth."""
    seen, pending = set[Iri](), [*hosts.get(start, ())]
    while pending:
        each = pending.pop()
        if each not in seen:
            seen.add(each)
            pending += hosts.get(each, ())
    return seen


@misplaced.explain
def _explain_misplaced(kb: QuestionContext, row: MisplacedRow) -> Iterator[str]:
    now = ", ".join(map(local_name, row.now)) or "nothing"
    yield f"{individual_text(kb.reasoner, row.thing)} is on or in {now}"
    homes = f": {', '.join(map(local_name, row.homes))}" if row.homes else ", of which there is none here"
    yield f"things of its class are stored in {' or '.join(map(local_name, row.belongs))}{homes}"
    yield source_text(row.source)


@misplaced.missing
def _missing_misplaced(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    if asked.thing is None:
        if asked.cls is not None and not storage_place.ask(kb, {"item": asked.cls}):
            yield from storage_place.ask(kb, {"item": asked.cls}).missing
        return
    found = list(missing_bodies(kb, (asked.thing,), asked.map, asked.present))
    yield from found
    own = kb.reasoner.class_of(asked.thing)
    if found or own is None or not kb.reasoner.is_class(own):
        return
    places = storage_place.ask(kb, {"item": own})
    if not places:
        yield from places.missing
        return
    for bodies in placed_states(asked.present, asked.map):
        storing = _storage(kb, bodies, own)[2]
        at = sorted(_chain(_hosts(bodies), asked.thing) & storing)
        if at:
            homes = ", ".join(local_name(each) for each in at)
            reason = f"{individual_text(kb.reasoner, asked.thing)} is where it belongs: on or in {homes}"
            claims = body_claims((asked.thing, *at), asked.present.states(asked.map), asked.map)
            claims += tuple(
                Claim(kind=ClaimKind.ON_OR_IN, subject=asked.thing, object=each, map=asked.map) for each in at
            )
            yield MissingKnowledge(own, _CONTAINER_FOR, reason, is_filler=True, claims=claims)


# -- states ------------------------------------------------------------------------------------------------------------


class StateRow(AnswerRow, frozen=True, kw_only=True):
    """A state of a thing."""

    thing: IndividualName
    property: PropertyName
    value: ValueName
    asserted: bool
    """Whether it was asserted at run time, rather than by a file."""


@question(
    sentences=(
        "what is the state of {thing}",
        "which states does {thing} have",
        "what is asserted about {thing}",
    )
)
def states(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    property: PropertyName | None = None,
    value: ValueName | None = None,
) -> Iterator[StateRow]:
    """Which states of things were asserted: that a cup is clean, a stove is on, or milk is on a table.

    Everything that was asserted of an individual at run time (`tell`), its classes too; and of the statements in files
    those with the properties ms:state and knowrob:stateOfObject or subproperties of them. ms:state takes any word:
    `tell("stove", "state", "on")`. A state holds until it is retracted; what can be measured, such as whether a drawer
    is
    open, is answered by `articulated_parts` and `where_is`.

    Examples:
        states
        states value=clean
    """
    properties = {each for root in _STATE_PROPERTIES for each in (root, *kb.reasoner.properties.sub_properties(root))}
    told = set(kb.statements(runtime_only=True))
    stated = {each for name in sorted(properties) for each in kb.statements(property=name)}
    rows = []
    for subject, fact in told | stated:
        if kb.reasoner.is_individual(subject):
            rows.append(
                StateRow(
                    thing=subject,
                    property=fact.property,
                    value=_value_text(fact),
                    asserted=(subject, fact) in told,
                )
            )
    yield from sorted(rows, key=lambda row: (row.thing, row.property, row.value, not row.asserted))


def _value_text(fact: PropertyAssertion) -> str:
    match fact.value:
        case IriRef(iri):
            return iri
        case Literal(text):
            return text
        case _:
            return "…"


@states.explain
def _explain_state(kb: QuestionContext, row: StateRow) -> Iterator[str]:
    by = "it was asserted at run time" if row.asserted else "a file states it"
    yield f"{local_name(row.thing)} {local_name(row.property)} {local_name(row.value)}: {by}"


@states.missing
def _missing_state(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    value = asked.plain("value", str)
    what = individual_text(kb.reasoner, asked.thing) if asked.thing is not None else "anything"
    of = f"{local_name(asked.property)} " if asked.property is not None else ""
    wanted = f"{of}{local_name(value)} " if value is not None else of
    cls = kb.reasoner.class_of(asked.thing) if asked.thing is not None else None
    reason = f"no state {wanted}of {what} was asserted: tell it, as in tell milk_carton_1 state clean"
    rows = kb.statements(property=_STATE_PROPERTIES[0])
    is_stated = any(asked.thing in {None, row[0]} and value in {None, _value_text(row[1])} for row in rows)
    claim = Claim(kind=ClaimKind.NO_STATEMENT, subject=asked.thing, property=_STATE_PROPERTIES[0], object=value)
    if is_stated:  # of another property than the one that is wanted
        claim = Claim(kind=ClaimKind.NO_STATEMENT, subject=asked.thing, property=asked.property, object=value)
    claims = (claim,) if asked.property is not None or not is_stated else ()
    yield MissingKnowledge(cls or THING, asked.property or _STATE_PROPERTIES[0], reason, claims=claims)
