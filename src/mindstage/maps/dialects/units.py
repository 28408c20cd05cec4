"""Units, handedness and quaternion order of a map, decided once for each map and recorded as assumptions.

The choice of the user takes precedence, then the declaration in the map, then the evidence in its numbers where a
dialect leaves the convention open, then the default of the dialect. The default of a dialect yields where the evidence
rules it out: loggers of one dialect were configured differently. Evidence rests on two observations: furniture has
similar sizes everywhere, and most bodies are upright and aligned with the walls.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import Any, TypeVar

from mindstage.maps.dialects.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.maps.dialects.membership import pose_facts, types_of
from mindstage.maps.dialects.source_map import SourceMap, ignore_finding
from mindstage.maps.rdf_mapping.fields import ClassGeometry
from mindstage.maps.rdf_mapping.properties import QUATERNION, SIZE, TRANSLATION, literal_text
from mindstage.rdf.graphs import Graph, Severity
from mindstage.rdf.vocabulary import FRAME, QUATERNION_ORDER, UNITS
from mindstage.scene import Iri

__all__ = [
    "ConventionEvidence",
    "ConventionGuess",
    "collect_evidence",
    "decide_quaternion_order",
    "default_conventions",
    "guess_quaternion_order",
    "guess_units",
    "infer_conventions",
]


_SAMPLE_SIZE = 500
"""Number of individuals that are evaluated, evenly spread over the map."""
_TYPICAL_EXTENT_M = 0.4
"""Median of the largest extents of household objects [m]: handles, cups, drawers, cupboards."""
_TYPICAL_SPREAD_M = 2.0
"""Median distance of household objects from their median position [m]."""
_SIZE_TOLERANCE = 2.0
"""Maximum factor between the size of a class in a map and in an ontology."""
_UPRIGHT_COSINE = 0.999
_MIN_DECISIVE_BODIES = 5
"""Number of bodies that must be upright in only one order to rule out the other one."""
_MIN_UNROTATED_BODIES = 10
"""Number of bodies that must all be unrotated in one order, and none in the other, to rule the other one out."""
_DECISIVE_RATIO = 4
"""Least ratio of the bodies that are upright in one order only to those that are in the other one only."""
_UPRIGHT_SHARE = 0.75
"""Least share of the bodies that must be upright in an order for it to rule out the other one."""
_MIN_AGREEING_CLASSES = 3
"""Number of classes whose sizes must agree with those in ontologies to rule out units in which none does."""


ConventionT = TypeVar("ConventionT", bound=Enum)


@dataclass(frozen=True, slots=True)
class ConventionGuess:
    """A convention that the numbers of a map indicate, and the evidence for it."""

    value: LengthUnit | Handedness | QuaternionOrder | None
    """None if the numbers indicate nothing."""
    evidence: str
    is_conclusive: bool = False
    """Whether any other value would give an implausible world."""
    is_overwhelming: bool = False
    """Whether it takes precedence over the default of a dialect."""


@dataclass(frozen=True, slots=True)
class ConventionEvidence:
    """The numbers of a sample of a map's individuals, in the units of the map."""

    positions: Sequence[tuple[float, ...]]
    quaternions: Sequence[tuple[float, ...]]
    sizes: Mapping[Iri, tuple[float, ...]]
    """By class, the extents of one of its individuals or of the class itself."""
    largest_extents: Sequence[float]
    """The largest extent of each individual that has a size."""
    known_sizes: Mapping[Iri, float]
    """By class, the largest extent that ontologies give [m]."""

    def guess_units(self) -> ConventionGuess:
        """Guesses the unit of lengths."""
        fits = {unit: self._matching_class_count(unit) for unit in LengthUnit}
        best = max(fits, key=lambda unit: fits[unit])
        if fits[best]:
            known = len(self.known_sizes.keys() & self.sizes.keys())
            others = sum(fits.values()) - fits[best]
            counts = ", ".join(f"{fits[unit]} in {unit.value}" for unit in LengthUnit if unit is not best)
            return ConventionGuess(
                best,
                f"the sizes of {fits[best]} of {known} classes agree with those in ontologies ({counts})",
                is_conclusive=True,
                is_overwhelming=fits[best] >= _MIN_AGREEING_CLASSES and not others and 2 * fits[best] >= known,
            )
        if self.largest_extents:
            typical = median(self.largest_extents)
            unit = _closest_unit(typical, _TYPICAL_EXTENT_M)
            text = f"the median of {len(self.largest_extents)} bodies would be {typical / unit.per_meter:.2g} m large"
            return ConventionGuess(unit, _with_alternatives(text, typical, unit), len(self.largest_extents) >= 5)
        if len(self.positions) > 1:
            spread = median(self._distances())
            unit = _closest_unit(spread, _TYPICAL_SPREAD_M) if spread else LengthUnit.METERS
            distance = f"{spread / unit.per_meter:.2g} m"
            text = f"without sizes; the median distance of {len(self.positions)} bodies from their center is {distance}"
            return ConventionGuess(unit if spread else None, text)
        return ConventionGuess(None, "there are too few numbers to decide")

    def height_range(self, unit: LengthUnit) -> str:
        """Describes the range of heights [m], which should contain the ground."""
        if not self.positions:
            return "nothing has a position"
        heights = [position[2] / unit.per_meter for position in self.positions]
        return f"heights go from {min(heights):.2f} to {max(heights):.2f} m"

    def _matching_class_count(self, unit: LengthUnit) -> int:
        """Returns the number of classes whose size agrees with the ontologies."""
        return sum(
            1 / _SIZE_TOLERANCE < max(size) / unit.per_meter / self.known_sizes[cls] < _SIZE_TOLERANCE
            for cls, size in self.sizes.items()
            if self.known_sizes.get(cls) and max(size)
        )

    def _distances(self) -> list[float]:
        middle = [median(axis) for axis in zip(*self.positions, strict=True)]
        return [math.dist(position, middle) for position in self.positions]


def guess_quaternion_order(quaternions: Sequence[tuple[float, ...]]) -> ConventionGuess:
    """Guesses the position of the scalar in the quaternions of a map's bodies.

    A rotation about the vertical, read in the wrong order, is one about another axis. Bodies that are upright in only
    one order therefore decide; without such bodies, an order in which none is rotated.

    Args:
        quaternions: four numbers each, as given.
    """
    if not quaternions:
        return ConventionGuess(None, "no rotation is given")
    rows = {
        order: [(d, a, b, c) if order is QuaternionOrder.XYZW else (a, b, c, d) for a, b, c, d in quaternions]
        for order in QuaternionOrder
    }
    is_upright = {order: [_is_upright(row) for row in rows[order]] for order in QuaternionOrder}
    upright = {order: sum(is_upright[order]) for order in QuaternionOrder}
    unrotated = {
        order: sum(abs(row[0]) / math.hypot(*row) > _UPRIGHT_COSINE for row in rows[order]) for order in QuaternionOrder
    }
    score = {order: upright[order] + unrotated[order] for order in QuaternionOrder}
    best = max(score, key=lambda order: score[order])
    other = next(order for order in QuaternionOrder if order is not best)
    only = {
        order: sum(a and not b for a, b in zip(is_upright[order], is_upright[against], strict=True))
        for order, against in ((best, other), (other, best))
    }
    number = len(quaternions)
    text = "; ".join(
        f"as {order.value} {upright[order]} of {number} are upright and {unrotated[order]} are not rotated"
        for order in (best, other)
    )
    if score[best] == score[other]:
        return ConventionGuess(None, text)
    stands = only[best] >= max(_MIN_DECISIVE_BODIES, _DECISIVE_RATIO * only[other])
    aligned = unrotated[best] == number >= _MIN_UNROTATED_BODIES and unrotated[other] == 0
    return ConventionGuess(
        best,
        text,
        is_conclusive=number >= 5 and score[best] >= number and score[other] <= score[best] / 2,
        is_overwhelming=upright[best] >= _UPRIGHT_SHARE * number and (stands or aligned),
    )


def decide_quaternion_order(
    source_map: SourceMap, quaternions: Sequence[tuple[float, ...]], default: QuaternionOrder, *, dialect: str
) -> QuaternionOrder:
    """Decides the quaternion order of a map whose dialect fixes it, and records the decision as an assumption.

    Args:
        quaternions: those of its bodies, as given.
        default: the order of the dialect, which only overwhelming evidence replaces.
        dialect: name of the dialect.
    """
    guess = guess_quaternion_order(quaternions[:: max(1, len(quaternions) // _SAMPLE_SIZE)])
    return _decide_default(source_map, "quaternion", QUATERNION_ORDER, QuaternionOrder, default, guess, dialect)


def collect_evidence(source_map: SourceMap) -> ConventionEvidence:
    """Collects the numbers of a sample of a map's individuals."""
    members = source_map.members[:: max(1, len(source_map.members) // _SAMPLE_SIZE)]
    poses = [pose_facts(source_map.graph, source_map.graph.get(member, ())) or () for member in members]
    own = ClassGeometry([_class_graph(source_map, members)], source_map.hierarchy, ignore_finding)
    known = ClassGeometry(source_map.ontologies, source_map.hierarchy, ignore_finding)
    sizes: dict[Iri, tuple[float, ...]] = {}
    largest: list[float] = []
    for member in members:
        facts = source_map.graph.get(member, ())
        types = types_of(facts)
        whole = tuple(abs(extent) for extent in own.of(facts, types) if extent is not None)
        if types and len(whole) == len(SIZE) and any(whole):
            largest.append(max(whole))
            sizes[types[0]] = whole
    return ConventionEvidence(
        positions=[position for facts in poses if (position := TRANSLATION.first_value(facts)) is not None],
        quaternions=[rotation for facts in poses if (rotation := QUATERNION.first_value(facts)) is not None],
        sizes=sizes,
        largest_extents=largest,
        known_sizes=_largest_known(known, sizes),
    )


def guess_units(source_map: SourceMap, sizes: Mapping[Iri, Sequence[float]]) -> ConventionGuess:
    """Guesses the unit of lengths of a map whose sizes a reader has found.

    Args:
        sizes: the three extents of individuals, in the units of the map.
    """
    by_class = {
        types[0]: tuple(map(abs, size))
        for member, size in sizes.items()
        if any(size) and (types := types_of(source_map.graph.get(member, ())))
    }
    known = ClassGeometry(source_map.ontologies, source_map.hierarchy, ignore_finding)
    return ConventionEvidence(
        positions=(),
        quaternions=(),
        sizes=by_class,
        largest_extents=[max(map(abs, size)) for size in sizes.values() if any(size)],
        known_sizes=_largest_known(known, by_class),
    ).guess_units()


def _largest_known(known: ClassGeometry, classes: Iterable[Iri]) -> dict[Iri, float]:
    """Returns the largest extent that ontologies give, by class [m]."""
    return {cls: max(sizes) for cls in classes if (sizes := [x for x in known.get((cls,)) if x is not None])}


def _class_graph(source_map: SourceMap, members: Sequence[Iri]) -> Graph:
    """Returns the statements about the classes of some individuals, and about blank nodes, which classes may share."""
    classes = {cls for member in members for cls in types_of(source_map.graph.get(member, ()))}
    ancestors = {cls for each in classes for cls in source_map.hierarchy.ancestors(each)}
    return {
        subject: facts
        for subject, facts in source_map.graph.items()
        if subject in classes or subject in ancestors or subject[:2] == "_:"
    }


def _closest_unit(length: float, typical_m: float) -> LengthUnit:
    return min(LengthUnit, key=lambda unit: abs(math.log10(length / unit.per_meter / typical_m)))


def _with_alternatives(evidence: str, typical: float, unit: LengthUnit) -> str:
    others = ", ".join(
        f"{typical / other.per_meter:.2g} m in {other.value}" for other in LengthUnit if other is not unit
    )
    return f"{evidence} ({others})"


def _is_upright(rotation: tuple[float, ...]) -> bool:
    length = math.hypot(*rotation)  # the squares of very small numbers would underflow
    _, x, y, _ = rotation
    return 1.0 - 2.0 * ((x / length) ** 2 + (y / length) ** 2) > _UPRIGHT_COSINE


def infer_conventions(source_map: SourceMap, defaults: UnitConventions) -> UnitConventions:
    """Decides the conventions of a map whose dialect leaves them open.

    Args:
        defaults: conventions that hold where there is no evidence.
    """
    evidence = collect_evidence(source_map)
    units = _decide(source_map, "units", UNITS, LengthUnit, defaults.units, evidence.guess_units())
    frame = _decide(source_map, "frame", FRAME, Handedness, defaults.frame, _guess_handedness(units, evidence))
    order = guess_quaternion_order(evidence.quaternions)
    quaternion = _decide(source_map, "quaternion", QUATERNION_ORDER, QuaternionOrder, defaults.quaternion, order)
    return UnitConventions(units=units, frame=frame, quaternion=quaternion)


def default_conventions(source_map: SourceMap, defaults: UnitConventions, *, dialect: str) -> UnitConventions:
    """Decides the conventions of a map whose dialect fixes them; contradicting evidence is reported.

    Args:
        defaults: conventions of the dialect.
        dialect: name of the dialect.
    """
    evidence = collect_evidence(source_map)
    units = _decide_default(source_map, "units", UNITS, LengthUnit, defaults.units, evidence.guess_units(), dialect)
    frame_guess = ConventionGuess(None, evidence.height_range(units))
    if units is LengthUnit.CENTIMETERS is not defaults.units:
        handedness = _guess_handedness(units, evidence)
        frame_guess = ConventionGuess(handedness.value, handedness.evidence, is_overwhelming=True)
    frame = _decide_default(source_map, "frame", FRAME, Handedness, defaults.frame, frame_guess, dialect)
    order = guess_quaternion_order(evidence.quaternions)
    quaternion = _decide_default(
        source_map, "quaternion", QUATERNION_ORDER, QuaternionOrder, defaults.quaternion, order, dialect
    )
    return UnitConventions(units=units, frame=frame, quaternion=quaternion)


def _decide_default(
    source_map: SourceMap,
    topic: str,
    property: Iri,
    enum_type: type[ConventionT],
    default: ConventionT | None,
    guess: ConventionGuess,
    dialect: str,
) -> ConventionT:
    """Decides a convention that a dialect fixes; evidence against it replaces it if overwhelming, or is reported."""
    assert default is not None
    evidence = f"the default of {dialect} maps; {guess.evidence}"
    value: Any = default
    if guess.is_overwhelming and guess.value not in (None, default):
        value, evidence = guess.value, f"not {default.value}, the default of {dialect} maps: {guess.evidence}"
    settled = _decide(source_map, topic, property, enum_type, default, ConventionGuess(value, evidence))
    if guess.is_conclusive and guess.value not in (None, settled) and getattr(source_map.conventions, topic) is None:
        _report_contradiction(source_map, topic, property, settled, guess)
    return settled


def _decide(
    source_map: SourceMap,
    topic: str,
    property: Iri,
    enum_type: type[ConventionT],
    default: ConventionT | None,
    guess: ConventionGuess,
) -> ConventionT:
    chosen = getattr(source_map.conventions, topic)
    declared = _declared_value(source_map, property, enum_type)
    if chosen is not None:
        otherwise = f" indicates {guess.value.value}" if guess.value is not None else ""
        value, evidence = (
            chosen,
            f"chosen by the user; the evidence{otherwise or ' is inconclusive'} ({guess.evidence})",
        )
    elif declared is not None:
        value, evidence = declared, f"declared in the map by {property}"
    elif guess.value is not None:
        value, evidence = enum_type(guess.value.value), guess.evidence
    else:
        value, evidence = default, f"the default of this dialect; {guess.evidence}"
    assert isinstance(value, enum_type)
    source_map.record_assumption(topic, str(value.value), evidence)
    return value


def _declared_value(source_map: SourceMap, property: Iri, enum_type: type[ConventionT]) -> ConventionT | None:
    names = {str(choice.value): choice for choice in enum_type}
    for fact in source_map.graph.get(source_map.map, ()):
        if fact.property == property:
            text = literal_text(fact.value)
            if text is not None and text.strip().lower() in names:
                return names[text.strip().lower()]
            problem = f"{text if text is not None else 'its value'!r} is not one of {', '.join(names)}"
            source_map.report(
                Severity.WARNING, source_map.map, property, problem, "it is ignored, and evidence decides"
            )
    return None


def _guess_handedness(units: LengthUnit, evidence: ConventionEvidence) -> ConventionGuess:
    """Guesses handedness from the unit, which the logger decides too: a mirrored map would be equally plausible."""
    levels = evidence.height_range(units)
    if units is LengthUnit.CENTIMETERS:
        why = "Unreal uses centimeters, and a logger that converts axes converts lengths as well"
        return ConventionGuess(Handedness.UNREAL, f"{why}; z is up: {levels}")
    return ConventionGuess(
        Handedness.ROS, f"a logger that converts lengths to {units.value} converts axes as well; z is up: {levels}"
    )


def _report_contradiction(
    source_map: SourceMap, topic: str, property: Iri, chosen: Enum, guess: ConventionGuess
) -> None:
    assert guess.value is not None
    problem = f"its numbers indicate {guess.value.value}: {guess.evidence}"
    action = f"they are read as {chosen.value}; --{topic} {guess.value.value} would change that"
    source_map.report(Severity.WARNING, source_map.map, property, problem, action)
