"""Perceptions: where KnowRob 1 says that things are, and when it was that they were there."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.matrices import Placement, placement_of
from mindstage.knowledge.readers.rewording import Rewording
from mindstage.knowledge.reading.other_words import EVENT_OCCURS_AT, OBJECT_ACTED_ON, ORIENTATION, START_TIME
from mindstage.knowledge.vocabulary import knowrob
from mindstage.knowledge.wording import words
from mindstage.world import Anonymous, Fact, FactValue, Iri, Literal, Pose, Reference
from mindstage.world.geometry import Array

__all__ = ["Perceptions"]

_ELEMENTS = {knowrob(f"m{row}{column}"): (row, column) for row in range(4) for column in range(4)}
_LAST_COLUMN = {(0, 3), (1, 3), (2, 3)}
_NEEDED = frozenset((row, column) for row in range(3) for column in range(4))
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*", re.ASCII)
_SECONDS = re.compile(r"(\d+(?:\.\d+)?)$", re.ASCII)


class _Sight(NamedTuple):
    """One place at which something was seen."""

    at: float
    """Seconds; least where nobody says when."""
    order: int
    """Of several at one time, what was told first counts."""
    place: FactValue
    property: Iri


class Perceptions:
    """All that is said about where things are."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._seen: dict[Iri, list[_Sight]] = {}
        for facts in graph.values():
            self._gather(facts)

    def _gather(self, told: Sequence[Fact]) -> None:
        seen = [
            fact.value.iri for fact in told if fact.property == OBJECT_ACTED_ON and isinstance(fact.value, Reference)
        ]
        if not seen:
            return
        at = max((_seconds(fact.value) for fact in told if fact.property == START_TIME), default=-np.inf)
        for place in (fact.value for fact in told if fact.property == EVENT_OCCURS_AT):
            for individual in seen:
                sights = self._seen.setdefault(individual, [])
                sights.append(_Sight(at, -len(sights), place, EVENT_OCCURS_AT))

    def sights(self, individual: Iri) -> list[_Sight]:
        """Where it was seen, the last time first; then where it says itself that it is."""
        facts = self._graph.get(individual, ())
        told = [_Sight(-np.inf, 0, fact.value, ORIENTATION) for fact in facts if fact.property == ORIENTATION]
        return [*sorted(self._seen.get(individual, ()), reverse=True, key=lambda sight: sight[:2]), *told]

    def placement(self, rewording: Rewording, individual: Iri) -> Placement | None:
        """The last place of a thing that can be understood; what had to be done for it is reported."""
        for sight in self.sights(individual):
            found = self._understand(sight.place)
            if isinstance(found, str):
                rewording.warn(individual, sight.property, found, "it tells no place")
                continue
            for what, did in found.remedies:
                rewording.warn(individual, sight.property, what, did)
            return found
        return None

    def _understand(self, place: FactValue) -> Placement | str:
        facts = self._facts(place)
        name = local_name(place.iri) if isinstance(place, Reference) else "its matrix"
        if not facts:
            return f"{name} is not described anywhere"
        if pose := _pose_in(facts):
            return Placement(pose)
        return self._placement(name, facts)

    def _placement(self, name: str, facts: Sequence[Fact]) -> Placement | str:
        told: dict[tuple[int, int], float] = {}
        for fact in facts:
            if place := _ELEMENTS.get(fact.property):
                number = words.number_in(words.text_in(fact.value) or "")
                if number is None:
                    return f"{name} has {_shown(fact.value)} as m{place[0]}{place[1]}, which is not a finite number"
                told.setdefault(place, number)
        missing = _NEEDED - told.keys()
        by_rows = missing <= _LAST_COLUMN and any(told.get((3, column)) for column in range(3))
        if missing and not by_rows:
            return f"{name} does not tell {', '.join(f'm{row}{column}' for row, column in sorted(missing))}"
        matrix = np.eye(4)
        for place, number in told.items():
            matrix[place] = number
        return placement_of(matrix)

    def _facts(self, value: FactValue) -> list[Fact]:
        if isinstance(value, Anonymous):
            return list(value.facts)
        return list(self._graph.get(value.iri, ())) if isinstance(value, Reference) else []


def _seconds(value: FactValue) -> float:
    """Seconds of a time point, which KnowRob writes into its name, or of a date."""
    text = local_name(value.iri) if isinstance(value, Reference) else words.text_in(value) or ""
    if found := _DATE.search(text):
        try:
            date = datetime.fromisoformat(found[0])
        except ValueError:
            return -np.inf
        return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    seconds = _SECONDS.search(text.strip())
    return float(seconds[1]) if seconds else -np.inf


def _pose_in(facts: list[Fact]) -> Pose | None:
    """A pose told by translation and quaternion, as the last maps of this kind have it."""
    found: dict[Iri, Array] = {}
    for word in (words.TRANSLATION, words.QUATERNION):
        values = (word.understand(fact.value) for fact in facts if fact.property == word.property)
        told = next((value for value in values if value is not None), None)
        if told is None:
            return None
        found[word.property] = np.array(told)
    x, y, z = found[words.TRANSLATION.property].tolist()
    w, i, j, k = found[words.QUATERNION.property].tolist()
    return Pose((x, y, z), (w, i, j, k))


def _shown(value: FactValue) -> str:
    return repr(value.text) if isinstance(value, Literal) else "a thing"
