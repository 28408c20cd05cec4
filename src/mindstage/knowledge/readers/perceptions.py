"""Perceptions: where KnowRob 1 says that things are, and when it was that they were there."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.matrices import MatrixPose, pose_from_matrix
from mindstage.knowledge.readers.rewording import DialectNormalizer
from mindstage.knowledge.reading.other_words import EVENT_OCCURS_AT, OBJECT_ACTED_ON, ORIENTATION, START_TIME
from mindstage.knowledge.vocabulary import knowrob
from mindstage.knowledge.wording import words
from mindstage.world import BlankNode, FactValue, Iri, IriRef, Literal, Pose, PropertyAssertion
from mindstage.world.geometry import Array

__all__ = ["PerceivedPoses"]

_MATRIX_ELEMENTS = {knowrob(f"m{row}{column}"): (row, column) for row in range(4) for column in range(4)}
_LAST_COLUMN = {(0, 3), (1, 3), (2, 3)}
_REQUIRED_ELEMENTS = frozenset((row, column) for row in range(3) for column in range(4))
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*", re.ASCII)
_SECONDS = re.compile(r"(\d+(?:\.\d+)?)$", re.ASCII)


class _Perception(NamedTuple):
    """One place at which something was seen."""

    time_s: float
    """Seconds; least where nobody says when."""
    order: int
    """Of several at one time, what was told first counts."""
    pose_node: FactValue
    property: Iri


class PerceivedPoses:
    """All that is said about where things are."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._by_individual: dict[Iri, list[_Perception]] = {}
        for facts in graph.values():
            self._collect(facts)

    def _collect(self, facts: Sequence[PropertyAssertion]) -> None:
        seen = [fact.value.iri for fact in facts if fact.property == OBJECT_ACTED_ON and isinstance(fact.value, IriRef)]
        if not seen:
            return
        at = max((_time_of(fact.value) for fact in facts if fact.property == START_TIME), default=-np.inf)
        for place in (fact.value for fact in facts if fact.property == EVENT_OCCURS_AT):
            for individual in seen:
                sights = self._by_individual.setdefault(individual, [])
                sights.append(_Perception(at, -len(sights), place, EVENT_OCCURS_AT))

    def perceptions_of(self, individual: Iri) -> list[_Perception]:
        """Where it was seen, the last time first; then where it says itself that it is."""
        facts = self._graph.get(individual, ())
        told = [_Perception(-np.inf, 0, fact.value, ORIENTATION) for fact in facts if fact.property == ORIENTATION]
        return [*sorted(self._by_individual.get(individual, ()), reverse=True, key=lambda sight: sight[:2]), *told]

    def latest_pose(self, normalizer: DialectNormalizer, individual: Iri) -> MatrixPose | None:
        """The last place of a thing that can be understood; what had to be done for it is reported."""
        for sight in self.perceptions_of(individual):
            found = self._parse_pose(sight.pose_node)
            if isinstance(found, str):
                normalizer.warn(individual, sight.property, found, "it tells no place")
                continue
            for what, did in found.repairs:
                normalizer.warn(individual, sight.property, what, did)
            return found
        return None

    def _parse_pose(self, node: FactValue) -> MatrixPose | str:
        facts = self._facts(node)
        name = local_name(node.iri) if isinstance(node, IriRef) else "its matrix"
        if not facts:
            return f"{name} is not described anywhere"
        if pose := _pose_from_facts(facts):
            return MatrixPose(pose)
        return self._parse_matrix(name, facts)

    def _parse_matrix(self, name: str, facts: Sequence[PropertyAssertion]) -> MatrixPose | str:
        told: dict[tuple[int, int], float] = {}
        for fact in facts:
            if place := _MATRIX_ELEMENTS.get(fact.property):
                number = words.parse_number(words.literal_text(fact.value) or "")
                if number is None:
                    return (
                        f"{name} has {_value_text(fact.value)} as m{place[0]}{place[1]}, which is not a finite number"
                    )
                told.setdefault(place, number)
        missing = _REQUIRED_ELEMENTS - told.keys()
        by_rows = missing <= _LAST_COLUMN and any(told.get((3, column)) for column in range(3))
        if missing and not by_rows:
            return f"{name} does not tell {', '.join(f'm{row}{column}' for row, column in sorted(missing))}"
        matrix = np.eye(4)
        for place, number in told.items():
            matrix[place] = number
        return pose_from_matrix(matrix)

    def _facts(self, value: FactValue) -> list[PropertyAssertion]:
        if isinstance(value, BlankNode):
            return list(value.facts)
        return list(self._graph.get(value.iri, ())) if isinstance(value, IriRef) else []


def _time_of(value: FactValue) -> float:
    """Seconds of a time point, which KnowRob writes into its name, or of a date."""
    text = local_name(value.iri) if isinstance(value, IriRef) else words.literal_text(value) or ""
    if found := _DATE.search(text):
        try:
            date = datetime.fromisoformat(found[0])
        except ValueError:
            return -np.inf
        return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    seconds = _SECONDS.search(text.strip())
    return float(seconds[1]) if seconds else -np.inf


def _pose_from_facts(facts: list[PropertyAssertion]) -> Pose | None:
    """A pose told by translation and quaternion, as the last maps of this kind have it."""
    found: dict[Iri, Array] = {}
    for word in (words.TRANSLATION, words.QUATERNION):
        values = (word.decode(fact.value) for fact in facts if fact.property == word.property)
        told = next((value for value in values if value is not None), None)
        if told is None:
            return None
        found[word.property] = np.array(told)
    x, y, z = found[words.TRANSLATION.property].tolist()
    w, i, j, k = found[words.QUATERNION.property].tolist()
    return Pose((x, y, z), (w, i, j, k))


def _value_text(value: FactValue) -> str:
    return repr(value.text) if isinstance(value, Literal) else "a thing"
