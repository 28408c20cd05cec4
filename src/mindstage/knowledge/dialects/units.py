"""Evidence: what a map's own numbers tell about how they are meant.

Furniture is about as large everywhere, and most things stand upright and square to the room. What a person would see
at a glance in a drawing, a reader can count: how large the things are, and how many would lie on their side.

Settling: how a map's numbers are meant, decided once for each map and said aloud.

What the user says counts first, then what the map itself says, then the evidence where a dialect leaves it open, and
last what is usual in the dialect.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import Any, TypeVar

from mindstage.knowledge.dialects.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.rdf import Graph, Severity
from mindstage.knowledge.rdf_mapping.fields import ClassSizes
from mindstage.knowledge.rdf_mapping.properties import QUATERNION, SIZE, TRANSLATION, literal_text
from mindstage.knowledge.vocabulary import FRAME, HAS_POSE, QUATERNION_ORDER, UNITS
from mindstage.scene import BlankNode, Iri, IriRef, PropertyAssertion

__all__ = ["ConventionEvidence", "ConventionGuess", "collect_evidence", "default_conventions", "infer_conventions"]


_SAMPLE_SIZE = 500
"""Individuals looked at, evenly spread; more tell no more."""
_TYPICAL_EXTENT_M = 0.4
"""The largest extent of the middle one of a household's things [m]: handles and cups, drawers, cupboards."""
_TYPICAL_SPREAD_M = 2.0
"""How far the middle one of them is from the middle of all [m]."""
_SIZE_TOLERANCE = 2.0
"""Sizes of one class differ by less than this factor from what an ontology says of it."""
_UPRIGHT_COSINE = 0.999


@dataclass(frozen=True, slots=True)
class ConventionGuess:
    """What the numbers speak for, and how clearly."""

    value: LengthUnit | Handedness | QuaternionOrder | None
    """None where they speak for nothing."""
    evidence: str
    is_conclusive: bool = False
    """Whether another answer would make a world that no household looks like."""


@dataclass(frozen=True, slots=True)
class ConventionEvidence:
    """The numbers of some of a map's individuals, as they stand."""

    positions: Sequence[tuple[float, ...]]
    quaternions: Sequence[tuple[float, ...]]
    sizes: Mapping[Iri, tuple[float, ...]]
    """By class, of each individual's largest extent, or the class's own."""
    largest_extents: Sequence[float]
    """The largest extent of each individual that has a size."""
    known_sizes: Mapping[Iri, float]
    """By class, the largest extent that ontologies tell of it [m]."""

    def guess_units(self) -> ConventionGuess:
        """What lengths are counted in."""
        fits = {unit: self._matching_class_count(unit) for unit in LengthUnit}
        best = max(fits, key=lambda unit: fits[unit])
        if fits[best]:
            known = len(self.known_sizes.keys() & self.sizes.keys())
            return ConventionGuess(
                best, f"{fits[best]} of {known} classes that ontologies know are as large as they say", True
            )
        if self.largest_extents:
            typical = median(self.largest_extents)
            unit = _paeth(typical, _TYPICAL_EXTENT_M)
            told = (
                f"the middle one of {len(self.largest_extents)} things would be {typical / unit.per_meter:.2g} m large"
            )
            return ConventionGuess(unit, _with_alternatives(told, typical, unit), len(self.largest_extents) >= 5)
        if len(self.positions) > 1:
            spread = median(self._distances())
            unit = _paeth(spread, _TYPICAL_SPREAD_M) if spread else LengthUnit.METERS
            told = f"nothing has a size; the middle one of {len(self.positions)} is {spread / unit.per_meter:.2g} m off"
            return ConventionGuess(unit if spread else None, told)
        return ConventionGuess(None, "there are too few numbers to tell")

    def guess_quaternion_order(self) -> ConventionGuess:
        """Where quaternions have their scalar."""
        if not self.quaternions:
            return ConventionGuess(None, "no rotation is told")
        upright = {order: sum(map(_is_upright, self._rotations(order))) for order in QuaternionOrder}
        square = {order: sum(map(_is_unrotated, self._rotations(order))) for order in QuaternionOrder}
        score = {order: upright[order] + square[order] for order in QuaternionOrder}
        best = max(score, key=lambda order: score[order])
        number = len(self.quaternions)
        told = "; ".join(
            f"as {order.value} {upright[order]} of {number} stand upright and {square[order]} are not turned"
            for order in sorted(QuaternionOrder, key=lambda order: order is not best)
        )
        worst = min(score.values())
        if score[best] == worst:
            return ConventionGuess(None, told)
        return ConventionGuess(best, told, number >= 5 and score[best] >= number and worst <= score[best] / 2)

    def height_range(self, unit: LengthUnit) -> str:
        """Where the ground is, as far as positions tell."""
        if not self.positions:
            return "nothing has a position"
        heights = [position[2] / unit.per_meter for position in self.positions]
        return f"heights go from {min(heights):.2f} to {max(heights):.2f} m"

    def _matching_class_count(self, unit: LengthUnit) -> int:
        """How many classes are about as large as ontologies say."""
        return sum(
            1 / _SIZE_TOLERANCE < max(size) / unit.per_meter / self.known_sizes[cls] < _SIZE_TOLERANCE
            for cls, size in self.sizes.items()
            if self.known_sizes.get(cls) and max(size)
        )

    def _rotations(self, order: QuaternionOrder) -> Iterator[tuple[float, ...]]:
        for a, b, c, d in self.quaternions:
            yield (d, a, b, c) if order is QuaternionOrder.XYZW else (a, b, c, d)

    def _distances(self) -> list[float]:
        middle = [median(axis) for axis in zip(*self.positions, strict=True)]
        return [math.dist(position, middle) for position in self.positions]


def collect_evidence(source_map: SourceMap) -> ConventionEvidence:
    """What can be counted in a map."""
    members = source_map.members[:: max(1, len(source_map.members) // _SAMPLE_SIZE)]
    poses = [list(_pose_facts(source_map.graph, source_map.graph.get(member, ()))) for member in members]
    own = ClassSizes([_class_graph(source_map, members)], source_map.hierarchy, _ignore_finding)
    known = ClassSizes(source_map.ontologies, source_map.hierarchy, _ignore_finding)
    sizes: dict[Iri, tuple[float, ...]] = {}
    largest: list[float] = []
    for member in members:
        facts = source_map.graph.get(member, ())
        types = types_of(facts)
        extents = [word.first_value(facts) for word in SIZE]
        size = [
            extent if extent is not None else of_class for extent, of_class in zip(extents, own.get(types), strict=True)
        ]
        whole = tuple(extent for extent in size if extent is not None)
        if types and len(whole) == len(SIZE) and any(whole):
            largest.append(max(whole))
            sizes[types[0]] = whole
    return ConventionEvidence(
        positions=[position for facts in poses if (position := TRANSLATION.first_value(facts)) is not None],
        quaternions=[rotation for facts in poses if (rotation := QUATERNION.first_value(facts)) is not None],
        sizes=sizes,
        largest_extents=largest,
        known_sizes={cls: max(of_cls) for cls in sizes if (of_cls := [x for x in known.get((cls,)) if x is not None])},
    )


def _class_graph(source_map: SourceMap, members: Sequence[Iri]) -> Graph:
    """What a map says about the classes of some individuals, and about what has no name, which may be shared."""
    told = {cls for member in members for cls in types_of(source_map.graph.get(member, ()))}
    above = {cls for each in told for cls in source_map.hierarchy.ancestors(each)}
    return {
        subject: facts
        for subject, facts in source_map.graph.items()
        if subject in told or subject in above or subject[:2] == "_:"
    }


def _pose_facts(graph: Graph, facts: Sequence[PropertyAssertion]) -> Iterator[PropertyAssertion]:
    for fact in facts:
        if fact.property == HAS_POSE:
            if isinstance(fact.value, IriRef):
                yield from graph.get(fact.value.iri, ())
            elif isinstance(fact.value, BlankNode):
                yield from fact.value.facts


def _paeth(length: float, typical_m: float) -> LengthUnit:
    return min(LengthUnit, key=lambda unit: abs(math.log10(length / unit.per_meter / typical_m)))


def _with_alternatives(evidence: str, typical: float, unit: LengthUnit) -> str:
    others = ", ".join(
        f"{typical / other.per_meter:.2g} m in {other.value}" for other in LengthUnit if other is not unit
    )
    return f"{evidence} ({others})"


def _is_upright(rotation: tuple[float, ...]) -> bool:
    length = math.hypot(*rotation)  # of squares, the least numbers would leave nothing
    _, x, y, _ = rotation
    return 1.0 - 2.0 * ((x / length) ** 2 + (y / length) ** 2) > _UPRIGHT_COSINE


def _is_unrotated(rotation: tuple[float, ...]) -> bool:
    return abs(rotation[0]) / math.hypot(*rotation) > _UPRIGHT_COSINE


def _ignore_finding(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
    """Reading reports the same."""


ConventionT = TypeVar("ConventionT", bound=Enum)


def infer_conventions(source_map: SourceMap, defaults: UnitConventions) -> UnitConventions:
    """The conventions of a map whose dialect leaves them open.

    Args:
        excerpt: the map.
        usual: what holds where nothing speaks for anything.
    """
    evidence = collect_evidence(source_map)
    units = _decide(source_map, "units", UNITS, LengthUnit, defaults.units, evidence.guess_units())
    frame = _decide(source_map, "frame", FRAME, Handedness, defaults.frame, _guess_handedness(units, evidence))
    order = evidence.guess_quaternion_order()
    quaternion = _decide(source_map, "quaternion", QUATERNION_ORDER, QuaternionOrder, defaults.quaternion, order)
    return UnitConventions(units=units, frame=frame, quaternion=quaternion)


def default_conventions(source_map: SourceMap, defaults: UnitConventions, *, dialect: str) -> UnitConventions:
    """The conventions of a map whose dialect settles them; evidence that speaks against that is reported.

    Args:
        excerpt: the map.
        usual: what holds in the dialect.
        dialect: its name.
    """
    evidence = collect_evidence(source_map)
    guesses: dict[str, ConventionGuess] = {
        "units": evidence.guess_units(),
        "quaternion": evidence.guess_quaternion_order(),
    }
    settled: dict[str, Any] = {}
    for about, property, kind in (
        ("units", UNITS, LengthUnit),
        ("frame", FRAME, Handedness),
        ("quaternion", QUATERNION_ORDER, QuaternionOrder),
    ):
        value = getattr(defaults, about)
        guess = guesses.get(about) or ConventionGuess(None, evidence.height_range(settled["units"]))
        so = f"{dialect} maps have it; {guess.evidence}"
        settled[about] = _decide(source_map, about, property, kind, value, ConventionGuess(value, so))
        if (
            guess.is_conclusive
            and guess.value not in (None, settled[about])
            and getattr(source_map.conventions, about) is None
        ):
            _report_contradiction(source_map, about, property, settled[about], guess)
    return UnitConventions(**settled)


def _decide(
    source_map: SourceMap,
    topic: str,
    property: Iri,
    enum_type: type[ConventionT],
    default: ConventionT | None,
    guess: ConventionGuess,
) -> ConventionT:
    told = getattr(source_map.conventions, topic)
    declared = _declared_value(source_map, property, enum_type)
    if told is not None:
        otherwise = f" would be {guess.value.value}" if guess.value is not None else ""
        value, evidence = told, f"the user says so; by evidence it{otherwise or ' is open'} ({guess.evidence})"
    elif declared is not None:
        value, evidence = declared, f"the map says so by {property}"
    elif guess.value is not None:
        value, evidence = enum_type(guess.value.value), guess.evidence
    else:
        value, evidence = default, f"usual in this dialect; {guess.evidence}"
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
            what = f"{text if text is not None else 'its value'!r} is not one of {', '.join(names)}"
            source_map.report(Severity.WARNING, source_map.map, property, what, "it is decided by evidence")
    return None


def _guess_handedness(units: LengthUnit, evidence: ConventionEvidence) -> ConventionGuess:
    """Handedness cannot be seen in a mirror: a mirrored kitchen is a kitchen. What wrote the map gives it away."""
    levels = evidence.height_range(units)
    if units is LengthUnit.CENTIMETERS:
        why = "centimetres are what Unreal counts in, and a logger that converts axes converts lengths as well"
        return ConventionGuess(Handedness.UNREAL, f"{why}; z is up: {levels}")
    return ConventionGuess(
        Handedness.ROS, f"whoever converts lengths to {units.value} converts axes as well; z is up: {levels}"
    )


def _report_contradiction(
    source_map: SourceMap, topic: str, property: Iri, chosen: Enum, guess: ConventionGuess
) -> None:
    assert guess.value is not None
    what = f"its numbers look like {guess.value.value}: {guess.evidence}"
    did = f"they are read as {chosen.value}; --{topic} {guess.value.value} would change that"
    source_map.report(Severity.WARNING, source_map.map, property, what, did)
