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
from mindstage.knowledge.reading.conventions import Frame, QuaternionOrder, Units
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.vocabulary import HAS_POSE
from mindstage.knowledge.wording.sizes import ClassSizes
from mindstage.knowledge.wording.words import QUATERNION, SIZE, TRANSLATION
from mindstage.world import Anonymous, Fact, Iri, Reference

__all__ = ["Evidence", "Guess", "evidence_in"]

_SAMPLE = 500
"""Individuals looked at, evenly spread; more tell no more."""
_TYPICAL_M = 0.4
"""The largest extent of the middle one of a household's things [m]: handles and cups, drawers, cupboards."""
_TYPICAL_SPREAD_M = 2.0
"""How far the middle one of them is from the middle of all [m]."""
_FITS = 2.0
"""Sizes of one class differ by less than this factor from what an ontology says of it."""
_SQUARE = 0.999


@dataclass(frozen=True, slots=True)
class Guess:
    """What the numbers speak for, and how clearly."""

    value: Units | Frame | QuaternionOrder | None
    """None where they speak for nothing."""
    evidence: str
    is_clear: bool = False
    """Whether another answer would make a world that no household looks like."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """The numbers of some of a map's individuals, as they stand."""

    positions: Sequence[tuple[float, ...]]
    quaternions: Sequence[tuple[float, ...]]
    sizes: Mapping[Iri, tuple[float, ...]]
    """By class, of each individual's largest extent, or the class's own."""
    largest: Sequence[float]
    """The largest extent of each individual that has a size."""
    known: Mapping[Iri, float]
    """By class, the largest extent that ontologies tell of it [m]."""

    def units(self) -> Guess:
        """What lengths are counted in."""
        fits = {unit: self._fitting(unit) for unit in Units}
        best = max(fits, key=lambda unit: fits[unit])
        if fits[best]:
            known = len(self.known.keys() & self.sizes.keys())
            return Guess(best, f"{fits[best]} of {known} classes that ontologies know are as large as they say", True)
        if self.largest:
            typical = median(self.largest)
            unit = _nearest(typical, _TYPICAL_M)
            told = f"the middle one of {len(self.largest)} things would be {typical / unit.per_metre:.2g} m large"
            return Guess(unit, _or_else(told, typical, unit), len(self.largest) >= 5)
        if len(self.positions) > 1:
            spread = median(self._distances())
            unit = _nearest(spread, _TYPICAL_SPREAD_M) if spread else Units.METRES
            told = f"nothing has a size; the middle one of {len(self.positions)} is {spread / unit.per_metre:.2g} m off"
            return Guess(unit if spread else None, told)
        return Guess(None, "there are too few numbers to tell")

    def quaternion(self) -> Guess:
        """Where quaternions have their scalar."""
        if not self.quaternions:
            return Guess(None, "no rotation is told")
        upright = {order: sum(map(_is_upright, self._rotations(order))) for order in QuaternionOrder}
        square = {order: sum(map(_is_unturned, self._rotations(order))) for order in QuaternionOrder}
        score = {order: upright[order] + square[order] for order in QuaternionOrder}
        best = max(score, key=lambda order: score[order])
        number = len(self.quaternions)
        told = "; ".join(
            f"as {order.value} {upright[order]} of {number} stand upright and {square[order]} are not turned"
            for order in sorted(QuaternionOrder, key=lambda order: order is not best)
        )
        worst = min(score.values())
        if score[best] == worst:
            return Guess(None, told)
        return Guess(best, told, number >= 5 and score[best] >= number and worst <= score[best] / 2)

    def levels(self, unit: Units) -> str:
        """Where the ground is, as far as positions tell."""
        if not self.positions:
            return "nothing has a position"
        heights = [position[2] / unit.per_metre for position in self.positions]
        return f"heights go from {min(heights):.2f} to {max(heights):.2f} m"

    def _fitting(self, unit: Units) -> int:
        """How many classes are about as large as ontologies say."""
        return sum(
            1 / _FITS < max(size) / unit.per_metre / self.known[cls] < _FITS
            for cls, size in self.sizes.items()
            if self.known.get(cls) and max(size)
        )

    def _rotations(self, order: QuaternionOrder) -> Iterator[tuple[float, ...]]:
        for a, b, c, d in self.quaternions:
            yield (d, a, b, c) if order is QuaternionOrder.XYZW else (a, b, c, d)

    def _distances(self) -> list[float]:
        middle = [median(axis) for axis in zip(*self.positions, strict=True)]
        return [math.dist(position, middle) for position in self.positions]


def evidence_in(excerpt: Excerpt) -> Evidence:
    """What can be counted in a map."""
    members = excerpt.members[:: max(1, len(excerpt.members) // _SAMPLE)]
    poses = [list(_pose_facts(excerpt.graph, excerpt.graph.get(member, ()))) for member in members]
    own = ClassSizes([_about_classes(excerpt, members)], excerpt.hierarchy, _silent)
    known = ClassSizes(excerpt.background, excerpt.hierarchy, _silent)
    sizes: dict[Iri, tuple[float, ...]] = {}
    largest: list[float] = []
    for member in members:
        facts = excerpt.graph.get(member, ())
        types = types_of(facts)
        extents = [word.first(facts) for word in SIZE]
        size = [
            extent if extent is not None else of_class for extent, of_class in zip(extents, own.of(types), strict=True)
        ]
        whole = tuple(extent for extent in size if extent is not None)
        if types and len(whole) == len(SIZE) and any(whole):
            largest.append(max(whole))
            sizes[types[0]] = whole
    return Evidence(
        positions=[position for facts in poses if (position := TRANSLATION.first(facts)) is not None],
        quaternions=[rotation for facts in poses if (rotation := QUATERNION.first(facts)) is not None],
        sizes=sizes,
        largest=largest,
        known={cls: max(of_cls) for cls in sizes if (of_cls := [x for x in known.of((cls,)) if x is not None])},
    )


def _about_classes(excerpt: Excerpt, members: Sequence[Iri]) -> Graph:
    """What a map says about the classes of some individuals, and about what has no name, which may be shared."""
    told = {cls for member in members for cls in types_of(excerpt.graph.get(member, ()))}
    above = {cls for each in told for cls in excerpt.hierarchy.ancestors(each)}
    return {
        subject: facts
        for subject, facts in excerpt.graph.items()
        if subject in told or subject in above or subject[:2] == "_:"
    }


def _pose_facts(graph: Graph, facts: Sequence[Fact]) -> Iterator[Fact]:
    for fact in facts:
        if fact.property == HAS_POSE:
            if isinstance(fact.value, Reference):
                yield from graph.get(fact.value.iri, ())
            elif isinstance(fact.value, Anonymous):
                yield from fact.value.facts


def _nearest(length: float, typical_m: float) -> Units:
    return min(Units, key=lambda unit: abs(math.log10(length / unit.per_metre / typical_m)))


def _or_else(told: str, typical: float, unit: Units) -> str:
    others = ", ".join(f"{typical / other.per_metre:.2g} m in {other.value}" for other in Units if other is not unit)
    return f"{told} ({others})"


def _is_upright(rotation: tuple[float, ...]) -> bool:
    length = math.hypot(*rotation)  # of squares, the least numbers would leave nothing
    _, x, y, _ = rotation
    return 1.0 - 2.0 * ((x / length) ** 2 + (y / length) ** 2) > _SQUARE


def _is_unturned(rotation: tuple[float, ...]) -> bool:
    return abs(rotation[0]) / math.hypot(*rotation) > _SQUARE


def _silent(severity: Severity, individual: str, property: str, what: str, did: str) -> None:
    """Reading reports the same."""
