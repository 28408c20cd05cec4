"""Evidence: what a map's own numbers tell about how they are meant.

Furniture is about as large everywhere, and most things stand upright and square to the room. What a person would see
at a glance in a drawing, a reader can count: how large the things are, and how many would lie on their side.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.conventions import Handedness, LengthUnit, QuaternionOrder
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.vocabulary import HAS_POSE
from mindstage.knowledge.wording.sizes import ClassSizes
from mindstage.knowledge.wording.words import QUATERNION, SIZE, TRANSLATION
from mindstage.world import BlankNode, Iri, IriRef, PropertyAssertion

__all__ = ["ConventionEvidence", "ConventionGuess", "collect_evidence"]

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
