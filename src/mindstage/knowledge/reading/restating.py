"""Restating: what maps that we write in another dialect say twice, once in its words and once in dialect 1's.

Such a map says so of itself (`ms:dialect`), and each node that only restates something says what (`ms:restates`). A
pose is not said twice: its numbers stand where the dialect has them. Read back, it goes to where dialect 1 has it, and
what is restated goes away, so that the map is what it was before it was written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from mindstage.knowledge.findings import Report, Severity
from mindstage.knowledge.readers.soma_nodes import Node
from mindstage.knowledge.reading.conversion import given
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.other_words import HAS_LOCALIZATION, HAS_SHAPE, OBJECT_ACTED_ON, dul, soma
from mindstage.knowledge.vocabulary import DIALECT, HAS_POSE, PARENT, RESTATES, TYPE
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.nesting import sorted_facts
from mindstage.knowledge.wording.words import QUATERNION, TRANSLATION, text_in
from mindstage.world import Anonymous, Fact, FactValue, Iri, Literal, Reference, Vector, World

__all__ = [
    "ARRAY",
    "HAS_COMPONENT",
    "SAME",
    "SIX_POSE",
    "SPACE_REGION",
    "Restated",
    "compare_restated",
    "localized",
    "restated_by",
    "restated_extents",
    "restored",
    "restores",
]

ARRAY = soma("array_double")
SPACE_REGION = soma("hasSpaceRegion")
SIX_POSE = soma("6DPose")
HAS_COMPONENT = dul("hasComponent")
SAME = "same"
"""Says of a map that it is in its own words, in which it restates where things have moved."""
_ROW_WORDS = {TRANSLATION.property: TRANSLATION, QUATERNION.property: QUATERNION}
_SHELVED = {given(property): property for property in (HAS_LOCALIZATION, HAS_SHAPE)}
"""Where another dialect's own statements stand that are not true any more, and where they stood."""


def restores(facts: Sequence[Fact], what: Iri) -> bool:
    """Whether a node says that it restates what a property says."""
    return Fact(RESTATES, Reference(what)) in facts


# -- poses -------------------------------------------------------------------------------------------------------------


def localized(facts: Sequence[Fact]) -> list[Fact] | None:
    """A pose as SOMA says it; None where it is told in a way that would not come back."""
    numbers = [fact for fact in facts if fact.property in _ROW_WORDS]
    if {fact.property for fact in numbers} != _ROW_WORDS.keys() or len(numbers) != len(_ROW_WORDS):
        return None
    if Fact(TYPE, Reference(SIX_POSE)) in facts or any(not _is_plain(fact) for fact in numbers):
        return None
    return [Fact(TYPE, Reference(SIX_POSE)), *(_turned(fact, ARRAY) for fact in facts)]


def _is_plain(fact: Fact) -> bool:
    value = fact.value
    plain = isinstance(value, Literal) and value.datatype is None and value.language is None
    return plain and _ROW_WORDS[fact.property].understand(value) is not None


def _placed(facts: Sequence[Fact]) -> list[Fact]:
    """The same as dialect 1 says it."""
    return [_turned(fact, None) for fact in facts if fact != Fact(TYPE, Reference(SIX_POSE))]


def _turned(fact: Fact, datatype: Iri | None) -> Fact:
    """Numbers of a pose under another datatype; a quaternion has its scalar last where there is one."""
    if fact.property not in _ROW_WORDS:
        return fact
    parts: Sequence[str] = (text_in(fact.value) or "").split()
    if _ROW_WORDS[fact.property].understand(Literal(" ".join(parts))) is None:
        numbers = Node(None, [fact]).numbers(fact.property)  # others write brackets and commas
        if not numbers:
            return fact
        parts = [repr(number) for number in numbers]
    if fact.property == QUATERNION.property:
        parts = [*parts[1:], parts[0]] if datatype else [parts[-1], *parts[:-1]]
    return Fact(fact.property, Literal(" ".join(parts), datatype))


# -- reading -----------------------------------------------------------------------------------------------------------


def restored(excerpt: Excerpt) -> Excerpt:
    """The excerpt of a map as it was before it was written in other words; as it is, if it never was."""
    if not any(fact.property == DIALECT for fact in excerpt.graph.get(excerpt.map, ())):
        return excerpt
    return replace(excerpt, graph=_Restoring(excerpt).graph())


class _Restoring:
    def __init__(self, excerpt: Excerpt) -> None:
        self.excerpt, self.told = excerpt, excerpt.graph
        self.poses: set[Iri] = set()
        """Poses that have names."""
        self.components: set[tuple[Iri, Fact]] = set()

    def graph(self) -> Mapping[Iri, Sequence[Fact]]:
        graph: dict[Iri, Sequence[Fact]] = {}
        for subject, facts in self.told.items():
            if not any(fact.property == RESTATES and fact.value != Reference(HAS_COMPONENT) for fact in facts):
                graph[subject] = self._thing(subject, facts)
        for pose in self.poses:
            graph[pose] = _placed(graph.get(pose, ()))
        for whole, part in self.components:
            graph[whole] = [fact for fact in graph.get(whole, ()) if fact != part]
        return graph

    def _thing(self, subject: Iri, facts: Sequence[Fact]) -> list[Fact]:
        found: list[Fact] = []
        is_restated = False
        for fact in facts:
            inner = fact.value.facts if isinstance(fact.value, Anonymous) else ()
            if fact.property == RESTATES:
                self._forget_component(subject, facts)
            elif not any(each.property == RESTATES for each in inner):
                found.append(fact)
            else:
                is_restated = True
                if restores(inner, HAS_POSE):
                    found += [Fact(HAS_POSE, place) for place in self._places(inner)]
        if is_restated:
            found = [Fact(_SHELVED.get(fact.property, fact.property), fact.value) for fact in found]
        if subject == self.excerpt.map:
            found = [fact for fact in found if fact.property != DIALECT]
        return found

    def _places(self, facts: Sequence[Fact]) -> list[FactValue]:
        places: list[FactValue] = []
        for fact in facts:
            if fact.property == SPACE_REGION and isinstance(fact.value, Anonymous):
                places.append(Anonymous(sorted_facts(_placed(fact.value.facts))))
            elif fact.property == SPACE_REGION and isinstance(fact.value, Reference):
                self.poses.add(fact.value.iri)
                places.append(fact.value)
        return places

    def _forget_component(self, subject: Iri, facts: Sequence[Fact]) -> None:
        if restores(facts, HAS_COMPONENT):
            part = Fact(HAS_COMPONENT, Reference(subject))
            wholes = (fact.value for fact in facts if fact.property == PARENT)
            self.components.update((whole.iri, part) for whole in wholes if isinstance(whole, Reference))


class Restated(NamedTuple):
    """What a map says in other words, too."""

    dialect: str = ""
    """In whose words all of it is written, or `SAME`; nothing, where nothing is restated."""
    places: frozenset[Iri] = frozenset()
    """The things whose places are told so."""


def restated_by(excerpt: Excerpt) -> Restated:
    """What a map that we have written says in other words."""
    told = (text_in(fact.value) for fact in excerpt.graph.get(excerpt.map, ()) if fact.property == DIALECT)
    dialect = next((text for text in told if text), "")
    if not dialect:
        return Restated()
    places: set[Iri] = set()
    for subject, facts in excerpt.graph.items():
        if restores(facts, HAS_POSE):
            seen = (fact.value for fact in facts if fact.property == OBJECT_ACTED_ON)
            places.update(value.iri for value in seen if isinstance(value, Reference))
        if any(isinstance(fact.value, Anonymous) and restores(fact.value.facts, HAS_POSE) for fact in facts):
            places.add(subject)
    return Restated(dialect, frozenset(places))


# -- what is said twice ------------------------------------------------------------------------------------------------


def restated_extents(excerpt: Excerpt) -> Mapping[Iri, Sequence[float]]:
    """How large things are in another dialect's words, where dialect 1's say it too."""
    found: dict[Iri, Sequence[float]] = {}
    if not any(fact.property == DIALECT for fact in excerpt.graph.get(excerpt.map, ())):
        return found
    for member in excerpt.members:
        for fact in excerpt.graph.get(member, ()):
            if fact.property == HAS_SHAPE and isinstance(fact.value, Anonymous):
                if not restores(fact.value.facts, words.SIZE[0].property):
                    continue
                for region in (each.value for each in fact.value.facts if isinstance(each.value, Anonymous)):
                    assert isinstance(region, Anonymous)
                    if extents := extents_in(Node(None, region.facts)):
                        found[member] = extents
    return found


def extents_in(node: Node) -> Sequence[float]:
    """The extents of a shape along x, y and z; nothing, where it does not tell them."""
    radius = node.number(soma("hasRadius"))
    length = node.number(soma("hasLength"))
    if radius is not None:
        return 2 * radius, 2 * radius, 2 * radius if length is None else length
    told = [node.number(soma(name)) for name in ("hasDepth", "hasWidth", "hasHeight")]
    extents = [extent for extent in told if extent is not None]
    return extents if len(extents) == len(told) else ()


def compare_restated(told: Mapping[Iri, Sequence[float]], world: World, report: Report) -> None:
    """Reports where somebody has changed a size in one dialect's words only."""
    for body in world.bodies:
        said = told.get(body.iri)
        if said is not None and body.size != tuple(said):
            what = f"as a shape it is {_row(said)}, and as a thing {_row(body.size or ())}"
            did = "the latter counts; the shape only restates it"
            report(Severity.WARNING, body.iri, HAS_SHAPE, what, did)


def _row(numbers: Sequence[float] | Vector) -> str:
    return " x ".join(f"{number:g}" for number in numbers) or "without a size"
