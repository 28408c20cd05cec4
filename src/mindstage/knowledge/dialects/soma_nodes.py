"""SOMA's nodes: values that stand some things without a name away from what they are said of.

An object has a localization, which has a region, which has numbers; how many of those stand between differs from map to
map, so a value is looked for among all that hangs below, the nearest first.

Restating: what maps that we write in another dialect say twice, once in its words and once in dialect 1's.

Such a map says so of itself (`ms:dialect`), and each node that only restates something says what (`ms:restates`). A
pose is not said twice: its numbers stand where the dialect has them. Read back, it goes to where dialect 1 has it, and
what is restated goes away, so that the map is what it was before it was written.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.dialects.unit_conversion import original_property
from mindstage.knowledge.rdf import FindingSink, Graph, Severity, local_name
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.nested import sorted_facts
from mindstage.knowledge.rdf_mapping.properties import QUATERNION, TRANSLATION, literal_text
from mindstage.knowledge.vocabulary import (
    DIALECT,
    HAS_LOCALIZATION,
    HAS_POSE,
    HAS_SHAPE,
    OBJECT_ACTED_ON,
    PARENT,
    RESTATES,
    TYPE,
    dul,
    soma,
)
from mindstage.scene import BlankNode, FactValue, Iri, IriRef, Literal, PropertyAssertion, Vector, World

__all__ = [
    "ARRAY",
    "HAS_COMPONENT",
    "POSE_6D",
    "SAME_DIALECT",
    "SPACE_REGION",
    "DualDialectInfo",
    "RdfNode",
    "RdfNodes",
    "check_restated_sizes",
    "dual_dialect_info",
    "is_restatement_of",
    "restated_sizes",
    "to_soma_pose",
    "without_restatements",
]


_MAX_DEPTH = 5
_BRACKETS = re.compile(r"[\[\]()]")
_SEPARATORS = re.compile(r"[\s,;]+")


class RdfNode(NamedTuple):
    """A thing, and what is said about it."""

    name: Iri | None
    facts: Sequence[PropertyAssertion]

    def types(self) -> tuple[str, ...]:
        """The local names of its classes."""
        return tuple(local_name(cls) for cls in types_of(self.facts))

    def values(self, *properties: Iri) -> list[FactValue]:
        """All that is said by some properties."""
        return [fact.value for fact in self.facts if fact.property in properties]

    def has(self, *properties: Iri) -> bool:
        """Whether anything is said by some properties."""
        return any(fact.property in properties for fact in self.facts)

    def number(self, *properties: Iri) -> float | None:
        """The first finite number that is said by some properties."""
        numbers = (words.parse_number(words.literal_text(value) or "") for value in self.values(*properties))
        return next((number for number in numbers if number is not None), None)

    def numbers(self, *properties: Iri) -> tuple[float, ...]:
        """The first row of finite numbers that is said by some properties; none where one of them is no number."""
        for value in self.values(*properties):
            text = _BRACKETS.sub(" ", words.literal_text(value) or "").strip()
            row = [words.parse_number(part) for part in _SEPARATORS.split(text)]
            numbers = tuple(number for number in row if number is not None)
            if len(numbers) == len(row):
                return numbers
        return ()


class RdfNodes:
    """The things of a graph, nested or not."""

    def __init__(self, graph: Graph, individuals: Container[Iri] = ()) -> None:
        """Looks nothing up yet.

        Args:
            graph: what is said.
            individuals: things of their own, below which nothing of another one hangs.
        """
        self._graph, self._individuals = graph, individuals

    def node_from_value(self, value: FactValue) -> RdfNode | None:
        """What a value stands for, if it is a thing that something is said about."""
        if isinstance(value, BlankNode):
            return RdfNode(None, value.facts)
        if isinstance(value, IriRef) and value.iri in self._graph:
            return RdfNode(value.iri, self._graph[value.iri])
        return None

    def node_named(self, subject: Iri) -> RdfNode:
        """A thing by its name."""
        return RdfNode(subject, self._graph.get(subject, ()))

    def descendants(self, start: RdfNode, *properties: Iri, depth: int = _MAX_DEPTH) -> Iterator[RdfNode]:
        """What hangs on some properties of a thing, and what hangs on that, the nearest first."""
        seen = set() if start.name is None else {start.name}
        level = self._child_nodes(start.values(*properties), seen)
        for _ in range(depth):
            yield from level
            level = self._child_nodes((fact.value for above in level for fact in above.facts), seen)

    def _child_nodes(self, values: Iterable[FactValue], seen: set[Iri]) -> list[RdfNode]:
        """The things among some values, each named one once: a web of names has more ways than anyone could go."""
        found = []
        for value in values:
            if isinstance(value, BlankNode):
                found.append(RdfNode(None, value.facts))
            elif isinstance(value, IriRef) and value.iri not in seen and self._is_nested(value.iri):
                seen.add(value.iri)
                found.append(RdfNode(value.iri, self._graph[value.iri]))
        return found

    def _is_nested(self, name: Iri) -> bool:
        return name in self._graph and name not in self._individuals


ARRAY = soma("array_double")
SPACE_REGION = soma("hasSpaceRegion")
POSE_6D = soma("6DPose")
HAS_COMPONENT = dul("hasComponent")
SAME_DIALECT = "same"
"""Says of a map that it is in its own words, in which it restates where things have moved."""
_POSE_CODECS = {TRANSLATION.property: TRANSLATION, QUATERNION.property: QUATERNION}
_SHELVED_PROPERTIES = {original_property(property): property for property in (HAS_LOCALIZATION, HAS_SHAPE)}
"""Where another dialect's own statements stand that are not true any more, and where they stood."""


def is_restatement_of(facts: Sequence[PropertyAssertion], property: Iri) -> bool:
    """Whether a node says that it restates what a property says."""
    return PropertyAssertion(RESTATES, IriRef(property)) in facts


# -- poses -------------------------------------------------------------------------------------------------------------


def to_soma_pose(facts: Sequence[PropertyAssertion]) -> list[PropertyAssertion] | None:
    """A pose as SOMA says it; None where it is told in a way that would not come back."""
    numbers = [fact for fact in facts if fact.property in _POSE_CODECS]
    if {fact.property for fact in numbers} != _POSE_CODECS.keys() or len(numbers) != len(_POSE_CODECS):
        return None
    if PropertyAssertion(TYPE, IriRef(POSE_6D)) in facts or any(not _is_plain(fact) for fact in numbers):
        return None
    return [PropertyAssertion(TYPE, IriRef(POSE_6D)), *(_convert_pose_number(fact, ARRAY) for fact in facts)]


def _is_plain(fact: PropertyAssertion) -> bool:
    value = fact.value
    plain = isinstance(value, Literal) and value.datatype is None and value.language is None
    return plain and _POSE_CODECS[fact.property].decode(value) is not None


def _to_dialect1_pose(facts: Sequence[PropertyAssertion]) -> list[PropertyAssertion]:
    """The same as dialect 1 says it."""
    return [_convert_pose_number(fact, None) for fact in facts if fact != PropertyAssertion(TYPE, IriRef(POSE_6D))]


def _convert_pose_number(fact: PropertyAssertion, datatype: Iri | None) -> PropertyAssertion:
    """Numbers of a pose under another datatype; a quaternion has its scalar last where there is one."""
    if fact.property not in _POSE_CODECS:
        return fact
    parts: Sequence[str] = (literal_text(fact.value) or "").split()
    if _POSE_CODECS[fact.property].decode(Literal(" ".join(parts))) is None:
        numbers = RdfNode(None, [fact]).numbers(fact.property)  # others write brackets and commas
        if not numbers:
            return fact
        parts = [repr(number) for number in numbers]
    if fact.property == QUATERNION.property:
        parts = [*parts[1:], parts[0]] if datatype else [parts[-1], *parts[:-1]]
    return PropertyAssertion(fact.property, Literal(" ".join(parts), datatype))


# -- reading -----------------------------------------------------------------------------------------------------------


def without_restatements(source_map: SourceMap) -> SourceMap:
    """The excerpt of a map as it was before it was written in other words; as it is, if it never was."""
    if not any(fact.property == DIALECT for fact in source_map.graph.get(source_map.map, ())):
        return source_map
    return replace(source_map, graph=_RestatementRemover(source_map).graph())


class _RestatementRemover:
    def __init__(self, source_map: SourceMap) -> None:
        self.source_map, self.source_graph = source_map, source_map.graph
        self.poses: set[Iri] = set()
        """Poses that have names."""
        self.components: set[tuple[Iri, PropertyAssertion]] = set()

    def graph(self) -> Mapping[Iri, Sequence[PropertyAssertion]]:
        graph: dict[Iri, Sequence[PropertyAssertion]] = {}
        for subject, facts in self.source_graph.items():
            if not any(fact.property == RESTATES and fact.value != IriRef(HAS_COMPONENT) for fact in facts):
                graph[subject] = self._strip(subject, facts)
        for pose in self.poses:
            graph[pose] = _to_dialect1_pose(graph.get(pose, ()))
        for whole, part in self.components:
            graph[whole] = [fact for fact in graph.get(whole, ()) if fact != part]
        return graph

    def _strip(self, subject: Iri, facts: Sequence[PropertyAssertion]) -> list[PropertyAssertion]:
        found: list[PropertyAssertion] = []
        is_restated = False
        for fact in facts:
            inner = fact.value.facts if isinstance(fact.value, BlankNode) else ()
            if fact.property == RESTATES:
                self._mark_component(subject, facts)
            elif not any(each.property == RESTATES for each in inner):
                found.append(fact)
            else:
                is_restated = True
                if is_restatement_of(inner, HAS_POSE):
                    found += [PropertyAssertion(HAS_POSE, place) for place in self._restated_poses(inner)]
        if is_restated:
            found = [
                PropertyAssertion(_SHELVED_PROPERTIES.get(fact.property, fact.property), fact.value) for fact in found
            ]
        if subject == self.source_map.map:
            found = [fact for fact in found if fact.property != DIALECT]
        return found

    def _restated_poses(self, facts: Sequence[PropertyAssertion]) -> list[FactValue]:
        places: list[FactValue] = []
        for fact in facts:
            if fact.property == SPACE_REGION and isinstance(fact.value, BlankNode):
                places.append(BlankNode(sorted_facts(_to_dialect1_pose(fact.value.facts))))
            elif fact.property == SPACE_REGION and isinstance(fact.value, IriRef):
                self.poses.add(fact.value.iri)
                places.append(fact.value)
        return places

    def _mark_component(self, subject: Iri, facts: Sequence[PropertyAssertion]) -> None:
        if is_restatement_of(facts, HAS_COMPONENT):
            part = PropertyAssertion(HAS_COMPONENT, IriRef(subject))
            wholes = (fact.value for fact in facts if fact.property == PARENT)
            self.components.update((whole.iri, part) for whole in wholes if isinstance(whole, IriRef))


class DualDialectInfo(NamedTuple):
    """What a map says in other words, too."""

    dialect: str = ""
    """In whose words all of it is written, or `SAME_DIALECT`; nothing, where nothing is restated."""
    pose_iris: frozenset[Iri] = frozenset()
    """The things whose places are told so."""


def dual_dialect_info(source_map: SourceMap) -> DualDialectInfo:
    """What a map that we have written says in other words."""
    told = (literal_text(fact.value) for fact in source_map.graph.get(source_map.map, ()) if fact.property == DIALECT)
    dialect = next((text for text in told if text), "")
    if not dialect:
        return DualDialectInfo()
    places: set[Iri] = set()
    for subject, facts in source_map.graph.items():
        if is_restatement_of(facts, HAS_POSE):
            seen = (fact.value for fact in facts if fact.property == OBJECT_ACTED_ON)
            places.update(value.iri for value in seen if isinstance(value, IriRef))
        if any(isinstance(fact.value, BlankNode) and is_restatement_of(fact.value.facts, HAS_POSE) for fact in facts):
            places.add(subject)
    return DualDialectInfo(dialect, frozenset(places))


# -- what is said twice ------------------------------------------------------------------------------------------------


def restated_sizes(source_map: SourceMap) -> Mapping[Iri, Sequence[float]]:
    """How large things are in another dialect's words, where dialect 1's say it too."""
    found: dict[Iri, Sequence[float]] = {}
    if not any(fact.property == DIALECT for fact in source_map.graph.get(source_map.map, ())):
        return found
    for member in source_map.members:
        for fact in source_map.graph.get(member, ()):
            if fact.property == HAS_SHAPE and isinstance(fact.value, BlankNode):
                if not is_restatement_of(fact.value.facts, words.SIZE[0].property):
                    continue
                for region in (each.value for each in fact.value.facts if isinstance(each.value, BlankNode)):
                    assert isinstance(region, BlankNode)
                    if extents := extents_of(RdfNode(None, region.facts)):
                        found[member] = extents
    return found


def extents_of(node: RdfNode) -> Sequence[float]:
    """The extents of a shape along x, y and z; nothing, where it does not tell them."""
    radius = node.number(soma("hasRadius"))
    length = node.number(soma("hasLength"))
    if radius is not None:
        return 2 * radius, 2 * radius, 2 * radius if length is None else length
    told = [node.number(soma(name)) for name in ("hasDepth", "hasWidth", "hasHeight")]
    extents = [extent for extent in told if extent is not None]
    return extents if len(extents) == len(told) else ()


def check_restated_sizes(restated: Mapping[Iri, Sequence[float]], world: World, report: FindingSink) -> None:
    """Reports where somebody has changed a size in one dialect's words only."""
    for body in world.bodies:
        said = restated.get(body.iri)
        if said is not None and body.size != tuple(said):
            what = f"as a shape it is {_numbers_text(said)}, and as a thing {_numbers_text(body.size or ())}"
            did = "the latter counts; the shape only restates it"
            report(Severity.WARNING, body.iri, HAS_SHAPE, what, did)


def _numbers_text(numbers: Sequence[float] | Vector) -> str:
    return " x ".join(f"{number:g}" for number in numbers) or "without a size"
