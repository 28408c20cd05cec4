"""Nested resources: poses and limits, which are individuals of their own in a map, and nested blank nodes.

A body has a pose; a joint has a pose, linear limits and angular limits. Each `NestedResource` declares how one of them
is read and written, and `NestedResourceReader` finds them in a graph.

A blank node that exactly one statement refers to is nested into that statement. All others are subjects under a label,
so a graph is the same regardless of how its file was written: nested, with labels, or statement by statement.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import count, pairwise
from operator import attrgetter
from typing import Any, Generic, TypeVar

import msgspec

from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.properties import PropertyCodec, SubjectReader, SubjectWriter
from mindstage.rdf.graphs import FindingSink, Graph, is_generated_label, is_part_name
from mindstage.rdf.vocabulary import (
    ANGULAR_CONSTRAINT,
    DESCRIBED_IN_MAP,
    HAS_ANGULAR,
    HAS_LINEAR,
    HAS_POSE,
    LINEAR_CONSTRAINT,
    NAMED_INDIVIDUAL,
    POSE,
    SEMANTIC_MAP,
    TYPE,
)
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    BlankNode,
    FactValue,
    Iri,
    IriRef,
    LinearLimits,
    Literal,
    Pose,
    PropertyAssertion,
    SoftLimit,
)

__all__ = [
    "MAX_NESTING",
    "NESTED_ANGULAR_LIMITS",
    "NESTED_LINEAR_LIMITS",
    "NESTED_POSE",
    "NESTED_RESOURCES",
    "NestedResource",
    "NestedResourceReader",
    "nest_blank_nodes",
    "sorted_facts",
]


MAX_NESTING = 64
"""The maximum depth of nesting; deeper nodes keep labels, since a list of a thousand items has a thousand levels."""

Mentions = Mapping[Iri, Sequence[tuple[Iri, int]]]
"""By label, the subjects that refer to it, and the index of the statement."""

T = TypeVar("T")
_UNIT_TOLERANCE = 1e-3
"""Maps write six digits, which leaves the norm a thousand times nearer to 1."""


def sorted_facts(facts: Iterable[PropertyAssertion]) -> tuple[PropertyAssertion, ...]:
    """Statements in the canonical order of a `BlankNode`: by property, then by value."""
    ordered = sorted(facts, key=attrgetter("property"))
    if any(one.property == other.property for one, other in pairwise(ordered)):
        ordered.sort(key=lambda fact: (fact.property, msgspec.json.encode(fact.value)))
    return tuple(ordered)


def nest_blank_nodes(graph: Graph) -> Graph:
    """Nests all blank nodes that can be nested. Random labels of the others are replaced by numbered ones."""
    mentions = _count_mentions(graph)
    if not mentions and not any(subject.startswith("_:") for subject in graph):
        return graph
    nested = dict(graph)
    nestable = _nestable(graph, mentions)
    changed: dict[Iri, list[PropertyAssertion]] = {}
    for label in nestable:
        owner, index = mentions[label][0]
        inner = BlankNode(sorted_facts(nested.pop(label, ())))
        facts = changed.get(owner)
        if facts is None:
            nested[owner] = facts = changed[owner] = list(nested[owner])
        facts[index] = PropertyAssertion(facts[index].property, inner)
    return _renumbered(nested, [label for label in mentions if label not in nestable])


def _count_mentions(graph: Graph) -> Mentions:
    mentions: dict[Iri, list[tuple[Iri, int]]] = {}
    for subject, facts in graph.items():
        for index, fact in enumerate(facts):
            value = fact.value
            if isinstance(value, IriRef) and value.iri[:2] == "_:":
                mentions.setdefault(value.iri, []).append((subject, index))
    return mentions


def _nestable(graph: Graph, mentions: Mentions) -> dict[Iri, None]:
    """The labels of the blank nodes to nest, the innermost first."""
    depths: dict[Iri, int] = {}
    for start in mentions:
        chain: dict[Iri, None] = {}
        label = start
        while label not in depths and label not in chain and _can_nest(label, graph, mentions):
            chain[label] = None
            label = mentions[label][0][0]
        depth = depths.get(label, 0)
        in_cycle = label in chain
        for inner in reversed(chain):
            # In a cycle no node is innermost, and all keep their labels.
            depth = depths[inner] = 0 if in_cycle else depth + 1
            in_cycle = in_cycle and inner != label
    nestable = [label for label, depth in depths.items() if depth % MAX_NESTING]
    return dict.fromkeys(sorted(nestable, key=depths.__getitem__, reverse=True))


def _can_nest(label: Iri, graph: Graph, mentions: Mentions) -> bool:
    """Whether exactly one statement refers to it. Maps and their individuals are never nested."""
    if len(mentions.get(label, ())) != 1:
        return False
    owner, index = mentions[label][0]
    return graph[owner][index].property != DESCRIBED_IN_MAP and not any(
        fact.property == DESCRIBED_IN_MAP or (fact.property == TYPE and fact.value == IriRef(SEMANTIC_MAP))
        for fact in graph.get(label, ())
    )


def _renumbered(graph: Graph, mentioned: Iterable[Iri]) -> Graph:
    labels = dict.fromkeys(label for label in (*graph, *mentioned) if label.startswith("_:"))
    free = (label for n in count(1) if (label := Iri(f"_:b{n}")) not in labels)
    renamed = {label: next(free) for label in labels if is_generated_label(label)}
    if not renamed:
        return graph
    return {
        renamed.get(subject, subject): [_renamed(fact, renamed) for fact in facts] for subject, facts in graph.items()
    }


def _renamed(fact: PropertyAssertion, names: Mapping[Iri, Iri]) -> PropertyAssertion:
    value = fact.value
    if isinstance(value, IriRef) and value.iri in names:
        return PropertyAssertion(fact.property, IriRef(names[value.iri]))
    if isinstance(value, BlankNode):
        return PropertyAssertion(
            fact.property, BlankNode(sorted_facts(_renamed(inner, names) for inner in value.facts))
        )
    return fact


@dataclass(frozen=True, slots=True)
class NestedResource(Generic[T]):
    """A type of nested resource."""

    property: Iri
    """The property that relates the owner to it."""
    cls: Iri
    suffix: str
    """The suffix of generated names, after the name of the owner."""
    read: Callable[[SubjectReader], T | None]
    write: Callable[[SubjectWriter, T], None]


def _read_pose(reader: SubjectReader) -> Pose | None:
    position, quaternion = reader.read(codecs.TRANSLATION), reader.read(codecs.QUATERNION)
    for codec, value in ((codecs.TRANSLATION, position), (codecs.QUATERNION, quaternion)):
        if value is None and not reader.indexes_of(codec.property):
            reader.warn(codec.property, "it is missing in a pose", "the pose is not used")
    if position is None or quaternion is None:
        return None
    norm = math.hypot(*quaternion)
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        problem, action = f"the quaternion has the norm {norm:.6g} and not 1", "it is normalized where it is used"
        reader.warn(codecs.QUATERNION.property, problem, action)
    x, y, z = position
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k))


def _write_pose(writer: SubjectWriter, pose: Pose) -> None:
    writer.write(codecs.QUATERNION, pose.quaternion)
    writer.write(codecs.TRANSLATION, pose.position)


def _read_motion(reader: SubjectReader, codec: PropertyCodec[AxisMotion]) -> AxisMotion:
    motion = reader.read(codec)
    if motion is None:
        reader.warn(codec.property, "there is no valid value", "it is taken as locked")
        return AxisMotion.LOCKED
    return motion


LimitsT = TypeVar("LimitsT", LinearLimits, AngularLimits)


def _read_limits(
    limits_type: type[LimitsT],
    fields: Mapping[str, PropertyCodec[Any]],
    soft_fields: Sequence[str],
    reader: SubjectReader,
) -> LimitsT:
    values: dict[str, Any] = {}
    for name, codec in fields.items():
        if name.endswith("_middle"):  # 0 if absent, and 0 is never written
            values[name] = reader.read(codec, keep_if=lambda middle: not middle) or 0.0
        elif name.endswith("limit"):
            limit, own = reader.read(codec), name.removesuffix("_limit")
            motions = [values[own]] if own in values else values.values()
            if limit is None and AxisMotion.LIMITED in motions:
                reader.warn(codec.property, "there is no valid value", "it is taken as 0")
            values[name] = limit or 0.0
        else:
            values[name] = _read_motion(reader, codec)
    for name in soft_fields:
        read = {field: reader.read(codec) for field, codec in codecs.SOFT_LIMITS[name].items()}
        values[name] = SoftLimit(**{field: value for field, value in read.items() if value is not None})
    return limits_type(**values)


def _write_limits(
    fields: Mapping[str, PropertyCodec[Any]],
    soft_fields: Sequence[str],
    writer: SubjectWriter,
    limits: LinearLimits | AngularLimits,
) -> None:
    for name, codec in fields.items():
        value = getattr(limits, name)
        writer.write(codec, None if value == 0 and name.endswith("_middle") else value)
    for name in soft_fields:
        for field, codec in codecs.SOFT_LIMITS[name].items():
            writer.write(codec, getattr(getattr(limits, name), field))


NESTED_POSE = NestedResource(HAS_POSE, POSE, "pose", _read_pose, _write_pose)
_LINEAR = codecs.LINEAR_LIMITS, ("soft_limit",)
_ANGULAR = codecs.ANGULAR_LIMITS, ("swing_soft_limit", "twist_soft_limit")
NESTED_LINEAR_LIMITS = NestedResource(
    HAS_LINEAR,
    LINEAR_CONSTRAINT,
    "linear",
    partial(_read_limits, LinearLimits, *_LINEAR),
    partial(_write_limits, *_LINEAR),
)
NESTED_ANGULAR_LIMITS = NestedResource(
    HAS_ANGULAR,
    ANGULAR_CONSTRAINT,
    "angular",
    partial(_read_limits, AngularLimits, *_ANGULAR),
    partial(_write_limits, *_ANGULAR),
)
NESTED_RESOURCES: tuple[NestedResource[Any], ...] = (NESTED_POSE, NESTED_LINEAR_LIMITS, NESTED_ANGULAR_LIMITS)


@dataclass(frozen=True, slots=True)
class _NestedValue:
    index: int
    node: Iri | None
    """None for a blank node."""
    value: Any
    remaining: tuple[PropertyAssertion, ...]


class NestedResourceReader:
    """Reads nested resources from a graph. The first valid one is used; the others remain as they are."""

    def __init__(self, graph: Graph, individuals: Container[Iri], report: FindingSink) -> None:
        """Creates a reader that has read nothing yet.

        Args:
            graph: the graph to look resources up in.
            individuals: individuals that are never nested resources.
            report: receives findings.
        """
        self._graph = graph
        self._individuals = individuals
        self._report = report
        self._resource_types: dict[Iri, NestedResource[Any]] = {}
        self.remaining_facts: dict[Iri, tuple[PropertyAssertion, ...]] = {}
        """The statements about each resource that were not used; often none."""

    def read(self, reader: SubjectReader, nested_resource: NestedResource[T]) -> T | None:
        """Reads the nested resource of an individual, and consumes its statement; None if there is no valid one."""
        found: _NestedValue | None = None
        for index in reader.indexes_of(nested_resource.property):
            other = self._parse(reader, index, nested_resource)
            if other is None:
                continue
            if found is None:
                found = other
            elif other.value != found.value:
                reader.warn(
                    nested_resource.property,
                    "it has different values",
                    "the first is used, the other stays a fact",
                )
        if found is None:
            self._consume_generated_name(reader, nested_resource)
            return None
        if found.node is not None:
            self._resource_types[found.node] = nested_resource
            self.remaining_facts[found.node] = found.remaining
        if self._is_redundant(reader, nested_resource, found):
            reader.consume(found.index)
        else:
            reader.mark_leading(found.index)
        value: T = found.value
        return value

    def _parse(self, reader: SubjectReader, index: int, nested_resource: NestedResource[T]) -> _NestedValue | None:
        target = reader.facts[index].value
        node, facts = None, ()  # type: Iri | None, Iterable[PropertyAssertion]
        if isinstance(target, IriRef):
            node, facts = target.iri, self._graph.get(target.iri, ())
            if (
                not facts
                or node in self._individuals
                or self._resource_types.get(node, nested_resource) is not nested_resource
            ):
                reason = "is also used as something else" if facts else "is not described anywhere"
                reader.warn(nested_resource.property, f"{node} {reason}", "it stays a fact")
                return None
        elif isinstance(target, BlankNode):
            facts = target.facts
        else:
            reader.warn(nested_resource.property, f"{target.text!r} is a literal and not a resource", "it stays a fact")
            return None
        inner = SubjectReader(node or reader.subject, tuple(facts), self._report, is_nested=True)
        inner.consume_references(TYPE, NAMED_INDIVIDUAL, nested_resource.cls)
        value = nested_resource.read(inner)
        return None if value is None else _NestedValue(index, node, value, inner.remaining())

    def _consume_generated_name(self, reader: SubjectReader, nested_resource: NestedResource[Any]) -> None:
        """Consumes a reference to a generated name without statements, which would be written anyway."""
        if len(reader.indexes_of(nested_resource.property)) == 1:
            for index, name in reader.references(nested_resource.property):
                if name not in self._graph and self._is_generated_name(name, reader, nested_resource):
                    reader.consume(index)

    def _is_generated_name(self, node: Iri, reader: SubjectReader, nested_resource: NestedResource[Any]) -> bool:
        return is_part_name(node, reader.subject, nested_resource.suffix) and self._mention_counts[node] == 1

    def _is_redundant(self, reader: SubjectReader, nested_resource: NestedResource[T], found: _NestedValue) -> bool:
        """Whether writing the value generates the same name and statements again."""
        others = [
            reader.facts[index].value for index in reader.indexes_of(nested_resource.property) if index != found.index
        ]
        if found.remaining or (others and not self._is_other_resource(others[0], nested_resource)):
            return False
        if found.node is None:
            return True
        return self._is_generated_name(found.node, reader, nested_resource)

    def _is_other_resource(self, value: FactValue, nested_resource: NestedResource[Any]) -> bool:
        """Whether a writer would not use this as the name of the resource either, and generate one."""
        if isinstance(value, IriRef):
            return (
                value.iri in self._individuals
                or self._resource_types.get(value.iri, nested_resource) is not nested_resource
            )
        return isinstance(value, Literal)

    @cached_property
    def _mention_counts(self) -> Counter[Iri]:
        counter: Counter[Iri] = Counter()
        waiting: list[Iterable[PropertyAssertion]] = list(self._graph.values())
        while waiting:
            for fact in waiting.pop():
                if isinstance(fact.value, IriRef):
                    counter[fact.value.iri] += 1
                elif isinstance(fact.value, BlankNode):
                    waiting.append(fact.value.facts)
        return counter
