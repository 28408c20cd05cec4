"""Parts: the individuals that belong to another one and have no meaning without it.

An object has a pose, a constraint has a pose, a linear and an angular part, and each of them is an individual of its
own in a map. Here stands how each is read and how it is written.

Nesting: a thing without a name goes into the one statement that mentions it.

What several statements mention, or none, stands as a subject under its label. So a world says the same of a map
however its file was written: nested, with labels, or statement by statement.

Reading parts: finds an individual's pose and the like, and remembers what is left of them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count, pairwise
from typing import Any, Generic, TypeVar

import msgspec

from mindstage.knowledge.rdf import FindingSink, Graph, is_generated_label, is_part_name
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.properties import PropertyCodec, SubjectReader, SubjectWriter
from mindstage.knowledge.vocabulary import (
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
"""Levels of things inside things; those below keep a label, since a list of a thousand items has a thousand levels."""

Mentions = Mapping[Iri, Sequence[tuple[Iri, int]]]
"""By label, the subjects that mention it, and where among their facts."""


def sorted_facts(facts: Iterable[PropertyAssertion]) -> tuple[PropertyAssertion, ...]:
    """Facts in the one order that an `BlankNode` has them in: by property, then value."""
    told = sorted(facts, key=_property_key)
    if any(one.property == other.property for one, other in pairwise(told)):
        told.sort(key=lambda fact: (fact.property, msgspec.json.encode(fact.value)))
    return tuple(told)


def _property_key(fact: PropertyAssertion) -> Iri:
    return fact.property


def nest_blank_nodes(graph: Graph) -> Graph:
    """The same graph, with all that can go inside inside. Labels that are left and were drawn by lot become numbers."""
    mentions = _count_mentions(graph)
    if not mentions and not any(subject.startswith("_:") for subject in graph):
        return graph
    told = dict(graph)
    inside = _nestable(graph, mentions)
    changed: dict[Iri, list[PropertyAssertion]] = {}
    for label in inside:
        owner, index = mentions[label][0]
        inner = BlankNode(sorted_facts(told.pop(label, ())))
        facts = changed.get(owner)
        if facts is None:
            told[owner] = facts = changed[owner] = list(told[owner])
        facts[index] = PropertyAssertion(facts[index].property, inner)
    return _renumbered(told, [label for label in mentions if label not in inside])


def _count_mentions(graph: Graph) -> Mentions:
    mentions: dict[Iri, list[tuple[Iri, int]]] = {}
    for subject, facts in graph.items():
        for index, fact in enumerate(facts):
            value = fact.value
            if isinstance(value, IriRef) and value.iri[:2] == "_:":
                mentions.setdefault(value.iri, []).append((subject, index))
    return mentions


def _nestable(graph: Graph, mentions: Mentions) -> dict[Iri, None]:
    """The labels of what goes inside, the innermost first."""
    depths: dict[Iri, int] = {}
    for start in mentions:
        chain: dict[Iri, None] = {}
        label = start
        while label not in depths and label not in chain and _can_nest(label, graph, mentions):
            chain[label] = None
            label = mentions[label][0][0]
        depth = depths.get(label, 0)
        in_circle = label in chain
        for inner in reversed(chain):
            # In a circle nothing is innermost: all keep their labels.
            depth = depths[inner] = 0 if in_circle else depth + 1
            in_circle = in_circle and inner != label
    inside = [label for label, depth in depths.items() if depth % MAX_NESTING]
    return dict.fromkeys(sorted(inside, key=depths.__getitem__, reverse=True))


def _can_nest(label: Iri, graph: Graph, mentions: Mentions) -> bool:
    """Whether one statement alone mentions it. Maps and their individuals stay subjects whoever mentions them."""
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


T = TypeVar("T")

_UNIT_TOLERANCE = 1e-3
"""Six digits, as maps write them, leave a norm a thousand times nearer to 1."""


@dataclass(frozen=True, slots=True)
class NestedResource(Generic[T]):
    """One kind of part."""

    property: Iri
    """Whole to part."""
    cls: Iri
    suffix: str
    """What a part without a name of its own is called, after the whole."""
    read: Callable[[SubjectReader], T | None]
    write: Callable[[SubjectWriter, T], None]


def _read_pose(reader: SubjectReader) -> Pose | None:
    position, quaternion = reader.read(words.TRANSLATION), reader.read(words.QUATERNION)
    for word, value in ((words.TRANSLATION, position), (words.QUATERNION, quaternion)):
        if value is None and not reader.indexes_of(word.property):
            reader.warn(word.property, "a pose does not tell it", "it is no pose then")
    if position is None or quaternion is None:
        return None
    norm = math.hypot(*quaternion)
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        what, did = f"the quaternion has the norm {norm:.6g} and not 1", "it is normalised where it is used"
        reader.warn(words.QUATERNION.property, what, did)
    x, y, z = position
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k))


def _write_pose(writer: SubjectWriter, pose: Pose) -> None:
    writer.write(words.QUATERNION, pose.quaternion)
    writer.write(words.TRANSLATION, pose.position)


def _read_motion(reader: SubjectReader, codec: PropertyCodec[AxisMotion]) -> AxisMotion:
    motion = reader.read(codec)
    if motion is None:
        reader.warn(codec.property, "nothing understandable is told", "it is taken as locked")
        return AxisMotion.LOCKED
    return motion


def _read_limit(reader: SubjectReader, codec: PropertyCodec[float], *motions: AxisMotion) -> float:
    limit = reader.read(codec)
    if limit is None and AxisMotion.LIMITED in motions:
        reader.warn(codec.property, "nothing understandable is told", "it is taken as 0")
    return limit or 0.0


def _read_center(reader: SubjectReader, codec: PropertyCodec[float]) -> float:
    """Not told is 0, and 0 is not told."""
    return reader.read(codec, keep_if=lambda middle: not middle) or 0.0


def _read_soft_limit(
    reader: SubjectReader, enabled: PropertyCodec[bool], stiffness: PropertyCodec[float], damping: PropertyCodec[float]
) -> SoftLimit:
    return SoftLimit(
        enabled=reader.read(enabled) or False,
        stiffness=reader.read(stiffness) or 0.0,
        damping=reader.read(damping) or 0.0,
    )


def _write_soft_limit(
    writer: SubjectWriter,
    soft: SoftLimit,
    enabled: PropertyCodec[bool],
    stiffness: PropertyCodec[float],
    damping: PropertyCodec[float],
) -> None:
    writer.write(enabled, soft.enabled)
    writer.write(stiffness, soft.stiffness)
    writer.write(damping, soft.damping)


def _read_linear(reader: SubjectReader) -> LinearLimits:
    x, y, z = (_read_motion(reader, word) for word in (words.X_MOTION, words.Y_MOTION, words.Z_MOTION))
    soft = _read_soft_limit(reader, words.SOFT, words.STIFFNESS, words.DAMPING)
    return LinearLimits(
        x=x,
        y=y,
        z=z,
        limit=_read_limit(reader, words.LIMIT, x, y, z),
        x_middle=_read_center(reader, words.X_MIDDLE),
        y_middle=_read_center(reader, words.Y_MIDDLE),
        z_middle=_read_center(reader, words.Z_MIDDLE),
        soft_limit=soft,
    )


def _write_linear(writer: SubjectWriter, linear: LinearLimits) -> None:
    writer.write(words.X_MOTION, linear.x)
    writer.write(words.Y_MOTION, linear.y)
    writer.write(words.Z_MOTION, linear.z)
    writer.write(words.LIMIT, linear.limit)
    writer.write(words.X_MIDDLE, linear.x_middle or None)
    writer.write(words.Y_MIDDLE, linear.y_middle or None)
    writer.write(words.Z_MIDDLE, linear.z_middle or None)
    _write_soft_limit(writer, linear.soft_limit, words.SOFT, words.STIFFNESS, words.DAMPING)


def _read_angular(reader: SubjectReader) -> AngularLimits:
    swing1, swing2, twist = (_read_motion(reader, word) for word in (words.SWING1, words.SWING2, words.TWIST))
    return AngularLimits(
        swing1=swing1,
        swing2=swing2,
        twist=twist,
        swing1_limit=_read_limit(reader, words.SWING1_LIMIT, swing1),
        swing2_limit=_read_limit(reader, words.SWING2_LIMIT, swing2),
        twist_limit=_read_limit(reader, words.TWIST_LIMIT, twist),
        swing1_middle=_read_center(reader, words.SWING1_MIDDLE),
        swing2_middle=_read_center(reader, words.SWING2_MIDDLE),
        twist_middle=_read_center(reader, words.TWIST_MIDDLE),
        swing_soft_limit=_read_soft_limit(reader, words.SWING_SOFT, words.SWING_STIFFNESS, words.SWING_DAMPING),
        twist_soft_limit=_read_soft_limit(reader, words.TWIST_SOFT, words.TWIST_STIFFNESS, words.TWIST_DAMPING),
    )


def _write_angular(writer: SubjectWriter, angular: AngularLimits) -> None:
    writer.write(words.SWING1, angular.swing1)
    writer.write(words.SWING2, angular.swing2)
    writer.write(words.TWIST, angular.twist)
    writer.write(words.SWING1_LIMIT, angular.swing1_limit)
    writer.write(words.SWING2_LIMIT, angular.swing2_limit)
    writer.write(words.TWIST_LIMIT, angular.twist_limit)
    writer.write(words.SWING1_MIDDLE, angular.swing1_middle or None)
    writer.write(words.SWING2_MIDDLE, angular.swing2_middle or None)
    writer.write(words.TWIST_MIDDLE, angular.twist_middle or None)
    _write_soft_limit(writer, angular.swing_soft_limit, words.SWING_SOFT, words.SWING_STIFFNESS, words.SWING_DAMPING)
    _write_soft_limit(writer, angular.twist_soft_limit, words.TWIST_SOFT, words.TWIST_STIFFNESS, words.TWIST_DAMPING)


NESTED_POSE = NestedResource(HAS_POSE, POSE, "pose", _read_pose, _write_pose)
NESTED_LINEAR_LIMITS = NestedResource(HAS_LINEAR, LINEAR_CONSTRAINT, "linear", _read_linear, _write_linear)
NESTED_ANGULAR_LIMITS = NestedResource(HAS_ANGULAR, ANGULAR_CONSTRAINT, "angular", _read_angular, _write_angular)
NESTED_RESOURCES: tuple[NestedResource[Any], ...] = (NESTED_POSE, NESTED_LINEAR_LIMITS, NESTED_ANGULAR_LIMITS)


@dataclass(frozen=True, slots=True)
class _NestedValue:
    index: int
    node: Iri | None
    """None for a part without a name."""
    value: Any
    remaining: tuple[PropertyAssertion, ...]


class NestedResourceReader:
    """Takes parts out of a graph. The first one that can be understood counts; the others stay as they are."""

    def __init__(self, graph: Graph, individuals: Container[Iri], report: FindingSink) -> None:
        """Begins with nothing taken.

        Args:
            graph: where parts are looked up.
            individuals: things of their own, which are nobody's part.
            report: where findings go.
        """
        self._graph = graph
        self._individuals = individuals
        self._report = report
        self._resource_types: dict[Iri, NestedResource[Any]] = {}
        self.remaining_facts: dict[Iri, tuple[PropertyAssertion, ...]] = {}
        """By part that was taken, what nothing was made of; often nothing."""

    def read(self, reader: SubjectReader, nested_resource: NestedResource[T]) -> T | None:
        """The part of an individual, or None; only if there is one, anything is taken."""
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
                    "it is told twice, differently",
                    "the first counts, the other stays a fact",
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
        told = reader.facts[index].value
        node, facts = None, ()  # type: Iri | None, Iterable[PropertyAssertion]
        if isinstance(told, IriRef):
            node, facts = told.iri, self._graph.get(told.iri, ())
            if (
                not facts
                or node in self._individuals
                or self._resource_types.get(node, nested_resource) is not nested_resource
            ):
                why = "stands for something else as well" if facts else "is not described anywhere"
                reader.warn(nested_resource.property, f"{node} {why}", "it stays a fact")
                return None
        elif isinstance(told, BlankNode):
            facts = told.facts
        else:
            reader.warn(nested_resource.property, f"{told.text!r} is a text and not a thing", "it stays a fact")
            return None
        inner = SubjectReader(node or reader.subject, tuple(facts), self._report, is_nested=True)
        inner.consume_references(TYPE, NAMED_INDIVIDUAL, nested_resource.cls)
        value = nested_resource.read(inner)
        return None if value is None else _NestedValue(index, node, value, inner.remaining())

    def _consume_generated_name(self, reader: SubjectReader, nested_resource: NestedResource[Any]) -> None:
        """A mere name that nothing is said of, and that the part gets anyway where it is written."""
        if len(reader.indexes_of(nested_resource.property)) == 1:
            for index, name in reader.references(nested_resource.property):
                if name not in self._graph and self._is_generated_name(name, reader, nested_resource):
                    reader.consume(index)

    def _is_generated_name(self, node: Iri, reader: SubjectReader, nested_resource: NestedResource[Any]) -> bool:
        return is_part_name(node, reader.subject, nested_resource.suffix) and self._mention_counts[node] == 1

    def _is_redundant(self, reader: SubjectReader, nested_resource: NestedResource[T], found: _NestedValue) -> bool:
        """Whether the part's name and all about it come back by themselves when it is written."""
        others = [
            reader.facts[index].value for index in reader.indexes_of(nested_resource.property) if index != found.index
        ]
        if found.remaining or (others and not self._is_other_resource(others[0], nested_resource)):
            return False
        if found.node is None:
            return True
        return self._is_generated_name(found.node, reader, nested_resource)

    def _is_other_resource(self, value: FactValue, nested_resource: NestedResource[Any]) -> bool:
        """Whether a writer would take it for no name of this part either, and make one up."""
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
