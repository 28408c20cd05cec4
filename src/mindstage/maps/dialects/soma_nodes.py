"""RDF nodes of SOMA maps, and the removal of what a map restates in a second dialect.

SOMA puts values behind a chain of nodes: an object has a localization, which has a region, which has the numbers. The
length of the chain differs between maps, so a value is searched for breadth-first among all descendants.

A map that Mindstage writes in another dialect states everything in the vocabulary of dialect 1, and restates it in the
other one. It names that dialect by `ms:dialect`, and each restating node names the property that it restates by
`ms:restates`. Poses are written only once, where the other dialect has them. `without_restatements` moves them back and
removes the restating nodes, so that reading gives the map that was written.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from mindstage.maps.dialects.membership import references, types_of
from mindstage.maps.dialects.source_map import SourceMap
from mindstage.maps.dialects.unit_conversion import original_property
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.nested import sorted_facts
from mindstage.maps.rdf_mapping.properties import QUATERNION, TRANSLATION, literal_text
from mindstage.rdf.graphs import FindingSink, Graph, Severity, local_name
from mindstage.rdf.vocabulary import (
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
    "LENGTH",
    "POSE_6D",
    "RADIUS",
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


ARRAY = soma("array_double")
SPACE_REGION = soma("hasSpaceRegion")
POSE_6D = soma("6DPose")
HAS_COMPONENT = dul("hasComponent")
SAME_DIALECT = "same"
"""Value of `ms:dialect` in a map that restates only poses that have changed, in its own dialect."""
RADIUS, LENGTH = soma("hasRadius"), soma("hasLength")
_EXTENTS = tuple((soma(name),) for name in ("hasDepth", "hasWidth", "hasHeight"))
_POSE_CODECS = {TRANSLATION.property: TRANSLATION, QUATERNION.property: QUATERNION}
_SET_ASIDE_PROPERTIES = {original_property(property): property for property in (HAS_LOCALIZATION, HAS_SHAPE)}
"""Maps the name under which an outdated statement of another dialect is kept to the original property."""


class RdfNode(NamedTuple):
    """A node of the graph with its statements; the name of a blank node is None."""

    name: Iri | None
    facts: Sequence[PropertyAssertion]

    def types(self) -> tuple[str, ...]:
        """Returns the local names of its classes."""
        return tuple(local_name(cls) for cls in types_of(self.facts))

    def values(self, *properties: Iri) -> list[FactValue]:
        """Returns the values of some properties, in the order of the statements."""
        return [fact.value for fact in self.facts if fact.property in properties]

    def has(self, *properties: Iri) -> bool:
        """Whether any of some properties has a value."""
        return any(fact.property in properties for fact in self.facts)

    def number(self, *properties: Iri) -> float | None:
        """Returns the first finite number among the values of some properties, or None."""
        numbers = (codecs.parse_number(codecs.literal_text(value) or "") for value in self.values(*properties))
        return next((number for number in numbers if number is not None), None)

    def numbers(self, *properties: Iri) -> tuple[float, ...]:
        """Returns the first value of some properties that is a row of finite numbers; empty if there is none."""
        for value in self.values(*properties):
            text = _BRACKETS.sub(" ", codecs.literal_text(value) or "").strip()
            row = [codecs.parse_number(part) for part in _SEPARATORS.split(text)]
            numbers = tuple(number for number in row if number is not None)
            if len(numbers) == len(row):
                return numbers
        return ()


class RdfNodes:
    """Access to the nodes of a graph, whether they are blank nodes or named."""

    def __init__(self, graph: Graph, individuals: Container[Iri] = ()) -> None:
        """Creates the view; nothing is indexed.

        Args:
            graph: the statements.
            individuals: resources at which `descendants` stops, as their nodes are not part of another individual.
        """
        self._graph, self._individuals = graph, individuals

    def node_from_value(self, value: FactValue) -> RdfNode | None:
        """Returns the node that a value refers to; None for a literal or a resource without statements."""
        if isinstance(value, BlankNode):
            return RdfNode(None, value.facts)
        if isinstance(value, IriRef) and value.iri in self._graph:
            return RdfNode(value.iri, self._graph[value.iri])
        return None

    def node_named(self, subject: Iri) -> RdfNode:
        """Returns the node of a named resource."""
        return RdfNode(subject, self._graph.get(subject, ()))

    def descendants(self, start: RdfNode, *properties: Iri, depth: int = _MAX_DEPTH) -> Iterator[RdfNode]:
        """Yields the nodes reachable through some properties of a node, breadth-first, down to a depth."""
        seen = set() if start.name is None else {start.name}
        level = self._child_nodes(start.values(*properties), seen)
        for _ in range(depth):
            yield from level
            level = self._child_nodes((fact.value for above in level for fact in above.facts), seen)

    def _child_nodes(self, values: Iterable[FactValue], seen: set[Iri]) -> list[RdfNode]:
        """Returns the nodes among some values; a named one is visited only once, or cycles would never end."""
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


def is_restatement_of(facts: Sequence[PropertyAssertion], property: Iri) -> bool:
    """Whether a node is marked as restating a property."""
    return PropertyAssertion(RESTATES, IriRef(property)) in facts


# -- poses -------------------------------------------------------------------------------------------------------------


def to_soma_pose(facts: Sequence[PropertyAssertion]) -> list[PropertyAssertion] | None:
    """Converts a pose of dialect 1 to SOMA's form; None if the conversion would not be reversible."""
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
    """Converts a pose of SOMA's form to that of dialect 1."""
    return [_convert_pose_number(fact, None) for fact in facts if fact != PropertyAssertion(TYPE, IriRef(POSE_6D))]


def _convert_pose_number(fact: PropertyAssertion, datatype: Iri | None) -> PropertyAssertion:
    """Converts a statement of a pose to another datatype; with a datatype, quaternions are written scalar last."""
    if fact.property not in _POSE_CODECS:
        return fact
    parts: Sequence[str] = (literal_text(fact.value) or "").split()
    if _POSE_CODECS[fact.property].decode(Literal(" ".join(parts))) is None:
        numbers = RdfNode(None, [fact]).numbers(fact.property)  # some maps write brackets and commas
        if not numbers:
            return fact
        parts = [repr(number) for number in numbers]
    if fact.property == QUATERNION.property:
        parts = [*parts[1:], parts[0]] if datatype else [parts[-1], *parts[:-1]]
    return PropertyAssertion(fact.property, Literal(" ".join(parts), datatype))


# -- reading -----------------------------------------------------------------------------------------------------------


def without_restatements(source_map: SourceMap) -> SourceMap:
    """Returns the map without its restatements; a map without `ms:dialect` is returned unchanged."""
    if not any(fact.property == DIALECT for fact in source_map.graph.get(source_map.map, ())):
        return source_map
    return replace(source_map, graph=_RestatementRemover(source_map).graph())


class _RestatementRemover:
    def __init__(self, source_map: SourceMap) -> None:
        self.source_map, self.source_graph = source_map, source_map.graph
        self.poses: set[Iri] = set()
        """Named poses that have been restated."""
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
        kept: list[PropertyAssertion] = []
        is_restated = False
        for fact in facts:
            inner = fact.value.facts if isinstance(fact.value, BlankNode) else ()
            if fact.property == RESTATES:
                self._mark_component(subject, facts)
            elif not any(each.property == RESTATES for each in inner):
                kept.append(fact)
            else:
                is_restated = True
                if is_restatement_of(inner, HAS_POSE):
                    kept += [PropertyAssertion(HAS_POSE, pose) for pose in self._restated_poses(inner)]
        if is_restated:
            kept = [
                PropertyAssertion(_SET_ASIDE_PROPERTIES.get(fact.property, fact.property), fact.value) for fact in kept
            ]
        if subject == self.source_map.map:
            kept = [fact for fact in kept if fact.property != DIALECT]
        return kept

    def _restated_poses(self, facts: Sequence[PropertyAssertion]) -> list[FactValue]:
        poses: list[FactValue] = []
        for fact in facts:
            if fact.property == SPACE_REGION and isinstance(fact.value, BlankNode):
                poses.append(BlankNode(sorted_facts(_to_dialect1_pose(fact.value.facts))))
            elif fact.property == SPACE_REGION and isinstance(fact.value, IriRef):
                self.poses.add(fact.value.iri)
                poses.append(fact.value)
        return poses

    def _mark_component(self, subject: Iri, facts: Sequence[PropertyAssertion]) -> None:
        if is_restatement_of(facts, HAS_COMPONENT):
            part = PropertyAssertion(HAS_COMPONENT, IriRef(subject))
            self.components.update((whole, part) for whole in references(facts, PARENT))


class DualDialectInfo(NamedTuple):
    """The second dialect of a map that Mindstage has written, and what is restated in it."""

    dialect: str = ""
    """Name of the dialect, or `SAME_DIALECT`; empty if nothing is restated."""
    pose_iris: frozenset[Iri] = frozenset()
    """The individuals whose poses are restated."""


def dual_dialect_info(source_map: SourceMap) -> DualDialectInfo:
    """Returns what a map that Mindstage has written restates in a second dialect."""
    declared = (
        literal_text(fact.value) for fact in source_map.graph.get(source_map.map, ()) if fact.property == DIALECT
    )
    dialect = next((text for text in declared if text), "")
    if not dialect:
        return DualDialectInfo()
    restated_poses: set[Iri] = set()
    for subject, facts in source_map.graph.items():
        if is_restatement_of(facts, HAS_POSE):
            restated_poses.update(references(facts, OBJECT_ACTED_ON))
        if any(isinstance(fact.value, BlankNode) and is_restatement_of(fact.value.facts, HAS_POSE) for fact in facts):
            restated_poses.add(subject)
    return DualDialectInfo(dialect, frozenset(restated_poses))


# -- sizes ---------------------------------------------------------------------------------------------------------


def restated_sizes(source_map: SourceMap) -> Mapping[Iri, Sequence[float]]:
    """Returns the sizes that SOMA shapes restate, by individual [m]."""
    found: dict[Iri, Sequence[float]] = {}
    if not any(fact.property == DIALECT for fact in source_map.graph.get(source_map.map, ())):
        return found
    for member in source_map.members:
        for fact in source_map.graph.get(member, ()):
            if fact.property == HAS_SHAPE and isinstance(fact.value, BlankNode):
                if not is_restatement_of(fact.value.facts, codecs.SIZE[0].property):
                    continue
                for region in (each.value for each in fact.value.facts if isinstance(each.value, BlankNode)):
                    assert isinstance(region, BlankNode)
                    if extents := extents_of(RdfNode(None, region.facts)):
                        found[member] = extents
    return found


def extents_of(node: RdfNode) -> tuple[float, ...]:
    """Returns the extents of a shape node along x, y and z; empty if one is missing or negative."""
    radius, length = node.number(RADIUS), node.number(LENGTH, *_EXTENTS[2])
    if radius is not None:
        return (2 * radius, 2 * radius, 2 * radius if length is None else length)
    extents = tuple(extent for each in _EXTENTS if (extent := node.number(*each)) is not None)
    return extents if len(extents) == len(_EXTENTS) and min(extents) >= 0.0 else ()


def check_restated_sizes(restated: Mapping[Iri, Sequence[float]], world: World, report: FindingSink) -> None:
    """Reports sizes that differ between the two dialects, as after an edit of one of them only."""
    for body in world.bodies:
        size = restated.get(body.iri)
        if size is not None and body.size != tuple(size):
            problem = f"as a shape its size is {_numbers_text(size)}, and as a body {_numbers_text(body.size or ())}"
            action = "the latter counts; the shape only restates it"
            report(Severity.WARNING, body.iri, HAS_SHAPE, problem, action)


def _numbers_text(numbers: Sequence[float] | Vector) -> str:
    return " x ".join(f"{number:g}" for number in numbers) or "without a size"
