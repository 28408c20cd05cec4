"""Blocks: a world as statements in the order of a map file, subject by subject, before any syntax.

What the readers of dialect 1 understand is said in its words, what it has no word for in ours (see `all_names`), and
facts and resources are said as they stand.

Prefixes: short forms of names, and the check that a name is one.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import Any, TypeVar

import pyoxigraph as ox

from mindstage.errors import MapWriteError
from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.rdf import Severity, local_name, namespace_of, part_name, xml_local_name
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.fields import map_class_sizes, write_materials, write_size, write_tags
from mindstage.knowledge.rdf_mapping.nested import (
    MAX_NESTING,
    NESTED_ANGULAR_LIMITS,
    NESTED_LINEAR_LIMITS,
    NESTED_POSE,
    NestedResource,
)
from mindstage.knowledge.rdf_mapping.properties import SubjectReader, SubjectWriter
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    KNOWROB,
    LIGHT_CLASSES,
    MS,
    NAMED_INDIVIDUAL,
    ONTOLOGY,
    OWL,
    OWL_CLASS,
    PARENT,
    RDF,
    RDFS,
    SEMANTIC_MAP,
    THING,
    TYPE,
    XSD,
)
from mindstage.scene import (
    BlankNode,
    Body,
    BodyId,
    Iri,
    IriRef,
    Joint,
    Light,
    Literal,
    NamedResource,
    PropertyAssertion,
    World,
)

__all__ = ["DocumentSection", "PrefixTable", "SubjectBlock", "is_plain_name", "to_sections"]


T = TypeVar("T")


@dataclass(slots=True)
class SubjectBlock:
    """What is said about one subject."""

    subject: Iri
    facts: list[PropertyAssertion]
    comment: str = ""


@dataclass(frozen=True, slots=True)
class DocumentSection:
    """Blocks that stand together under a heading."""

    heading: str
    blocks: Sequence[SubjectBlock]


def to_sections(world: World) -> Sequence[DocumentSection]:
    """The statements of a world.

    Raises:
        MapWriteError: two of its parts have one name, or a value is no value (an infinite mass, a child that is not
            there).
    """
    writing = _WorldSerializer(world)
    individuals = list(writing.individuals())
    ontologies, properties, classes, others = writing.resources()
    sections = (
        DocumentSection("Ontologies", ontologies),
        DocumentSection("Property Definitions", properties),
        DocumentSection("Class Definitions", classes),
        DocumentSection("Individuals", individuals),
        DocumentSection("Further Statements", others),
    )
    deep = _DeepNodeFlattener(writing.used_names)
    for section in sections:
        for block in section.blocks:
            block.facts = [deep.flatten(fact) for fact in block.facts]
    return (*sections, DocumentSection("Nodes Inside Nodes", list(deep.blocks())))


class _DeepNodeFlattener:
    """Nodes nested too deeply for any recursion get labels and blocks of their own."""

    def __init__(self, used_names: Container[str]) -> None:
        self._labels = (Iri(f"_:deep{n}") for n in count(1) if f"_:deep{n}" not in used_names)
        self._pending: list[tuple[Iri, Sequence[PropertyAssertion]]] = []

    def flatten(self, fact: PropertyAssertion, level: int = 1) -> PropertyAssertion:
        if not isinstance(fact.value, BlankNode):
            return fact
        if level == MAX_NESTING:
            label = next(self._labels)
            self._pending.append((label, fact.value.facts))
            return PropertyAssertion(fact.property, IriRef(label))
        return PropertyAssertion(
            fact.property, BlankNode(tuple(self.flatten(inner, level + 1) for inner in fact.value.facts))
        )

    def blocks(self) -> Iterator[SubjectBlock]:
        for label, facts in self._pending:  # grows while it runs
            yield SubjectBlock(label, [self.flatten(fact) for fact in facts])


class _WorldSerializer:
    """One world on its way into statements."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.iris = _iris_by_id(world)
        self.sizes = map_class_sizes(world.resources)
        self.used_names = _all_iris(world)
        self.top_level = {world.iri, *self.iris.values(), *_omitted_individuals(world)}
        self.nested_resources: dict[Iri, tuple[NestedResource[Any], Any, SubjectBlock]] = {}
        self.parents: dict[BodyId, list[Iri]] = {}
        self.children: dict[BodyId, list[Iri]] = {}
        for attachment in world.attachments:
            self.parents.setdefault(attachment.child, []).append(self._body_iri(attachment.parent, attachment.child))
            self.children.setdefault(attachment.parent, []).append(self._body_iri(attachment.child, attachment.parent))

    def individuals(self) -> Iterator[SubjectBlock]:
        """The map, then bodies, constraints and lights, each followed by its parts."""
        yield self._map()
        for body in self.world.bodies:
            yield from self._body(body)
        for constraint in self.world.joints:
            yield from self._constraint(constraint)
        for light in self.world.lights:
            yield from self._light(light)

    def resources(self) -> tuple[list[SubjectBlock], ...]:
        """All others: ontologies, properties, classes, the rest. What is said of a part joins what the part says."""
        sorted_out: tuple[list[SubjectBlock], ...] = ([], [], [], [])
        ontologies, properties, classes, others = sorted_out
        for resource in self.world.resources:
            if resource.iri in self.nested_resources:
                self.nested_resources[resource.iri][2].facts.extend(resource.facts)
                continue
            types = types_of(resource.facts)
            name = local_name(resource.iri)
            if ONTOLOGY in types:
                ontologies.append(SubjectBlock(resource.iri, list(resource.facts)))
            elif any(cls.endswith("Property") for cls in types):
                properties.append(SubjectBlock(resource.iri, list(resource.facts)))
            elif OWL_CLASS in types:
                classes.append(SubjectBlock(resource.iri, list(resource.facts), f"Class {name}"))
            else:
                others.append(SubjectBlock(resource.iri, list(resource.facts)))
        return sorted_out

    # -- individuals ---------------------------------------------------------------------------------------------------

    def _map(self) -> SubjectBlock:
        world = self.world
        said = SubjectWriter(world.iri, world.facts)
        said.add_reference(TYPE, NAMED_INDIVIDUAL)
        said.add_reference(TYPE, SEMANTIC_MAP)
        name = local_name(world.iri)
        says_name = world.name != name or said.first_value(words.LABEL_CODEC) == name
        said.write(words.LABEL_CODEC, world.name if says_name else None)
        return SubjectBlock(world.iri, said.all_facts(), f"Semantic Map {world.name}")

    def _start_entity(self, entity: Body | Joint | Light, cls: Iri | None) -> SubjectWriter:
        said = SubjectWriter(entity.iri, entity.facts)
        said.add_reference(TYPE, NAMED_INDIVIDUAL)
        if cls is not None:
            said.add_reference(TYPE, cls)
        said.add_reference(DESCRIBED_IN_MAP, self.world.iri)
        said.write(words.ID, entity.id if entity.id != local_name(entity.iri) else None)
        return said

    def _body(self, body: Body) -> Iterator[SubjectBlock]:
        said = self._start_entity(body, None if body.cls == THING else body.cls)
        for child in self.children.get(body.id, ()):
            said.add_reference(CHILD, child)
        for parent in self.parents.get(body.id, ()):
            said.add_reference(PARENT, parent)
        said.write(words.LABEL_CODEC, body.label)
        physics = body.physics
        said.write(words.MOBILITY, physics.mobility)
        said.write(words.MASS, physics.mass_kg)
        said.write(words.OVERLAP_EVENTS, physics.overlap_events)
        said.write(words.GRAVITY, physics.gravity)
        classes = (body.cls, *(cls for cls in types_of(body.facts) if cls != body.cls))
        write_size(said, classes, body.size, self.sizes)
        pose = self._write_nested(said, body, NESTED_POSE, body.pose)
        said.write(words.MESH, body.mesh)
        said.write(words.SHAPE, body.shape.type if body.shape else None)
        write_materials(said, body.materials)
        write_tags(said, body.tags)
        yield SubjectBlock(body.iri, said.all_facts(), f"Individual {local_name(body.cls)}")
        yield from pose

    def _constraint(self, constraint: Joint) -> Iterator[SubjectBlock]:
        said = self._start_entity(constraint, CONSTRAINT)
        said.add_reference(PARENT, self._body_iri(constraint.parent, constraint.id))
        said.add_reference(CHILD, self._body_iri(constraint.child, constraint.id))
        write_tags(said, constraint.tags)
        said.write(words.DISABLE_COLLISION, constraint.disable_collision)
        parts = [
            *self._write_nested(said, constraint, NESTED_POSE, constraint.pose),
            *self._write_nested(said, constraint, NESTED_LINEAR_LIMITS, constraint.linear),
            *self._write_nested(said, constraint, NESTED_ANGULAR_LIMITS, constraint.angular),
        ]
        yield SubjectBlock(constraint.iri, said.all_facts(), "Constraint")
        yield from parts

    def _light(self, light: Light) -> Iterator[SubjectBlock]:
        said = self._start_entity(light, LIGHT_CLASSES[light.type])
        said.write(words.COLOR, light.color)
        said.write(words.INTENSITY, light.intensity)
        write_tags(said, light.tags)
        pose = self._write_nested(said, light, NESTED_POSE, light.pose)
        yield SubjectBlock(light.iri, said.all_facts(), "Light")
        yield from pose

    def _body_iri(self, body: BodyId, other: BodyId) -> Iri:
        if body not in self.iris:
            raise MapWriteError(other, cause=f"it has to do with {body!r}, which is not in the world")
        return self.iris[body]

    # -- parts ---------------------------------------------------------------------------------------------------------

    def _write_nested(
        self, writer: SubjectWriter, owner: Body | Joint | Light, nested_resource: NestedResource[T], value: T
    ) -> Iterable[SubjectBlock]:
        """Says a part, under the name that the facts have for it if nothing else stands under that name."""
        told = next((fact.value for fact in owner.facts if fact.property == nested_resource.property), None)
        if (
            isinstance(told, BlankNode)
            and nested_resource.read(SubjectReader(owner.iri, told.facts, _ignore_finding, is_nested=True)) == value
        ):
            return ()
        name = told.iri if isinstance(told, IriRef) and told.iri not in self.top_level else None
        if name in self.nested_resources:
            other, there, _ = self.nested_resources[name]
            if other is nested_resource and there == value:
                return ()
            name = None
        if name is None:
            name = part_name(owner.iri, nested_resource.suffix, self.used_names)
            writer.add_reference(nested_resource.property, name)
        own = SubjectWriter(name)
        own.add_reference(TYPE, NAMED_INDIVIDUAL)
        own.add_reference(TYPE, nested_resource.cls)
        nested_resource.write(own, value)
        block = SubjectBlock(name, own.all_facts())
        self.nested_resources[name] = (nested_resource, value, block)
        return (block,)


def _ignore_finding(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
    """Whoever reads the file will hear of it."""


def _iris_by_id(world: World) -> dict[BodyId, Iri]:
    iris: dict[BodyId, Iri] = {}
    names = {world.iri: "the map"}
    things: Iterable[Body | Joint | Light] = chain(world.bodies, world.joints, world.lights)
    for thing in things:
        if thing.id in iris:
            raise MapWriteError(repr(thing.id), cause="two things have this id")
        if thing.iri in names:
            raise MapWriteError(repr(thing.id), cause=f"{names[thing.iri]} is called <{thing.iri}> too")
        iris[thing.id] = thing.iri
        names[thing.iri] = repr(thing.id)
    return iris


def _omitted_individuals(world: World) -> Iterator[Iri]:
    """Individuals of the map that are not in the world, and nobody's part for that."""
    for resource in world.resources:
        types = types_of(resource.facts)  # a part that says where it is described has lost its only one on the way
        telling = (PARENT, CHILD, DESCRIBED_IN_MAP) if CONSTRAINT in types else (DESCRIBED_IN_MAP,)
        if types and any(fact.property in telling for fact in resource.facts):
            yield resource.iri


def _all_iris(world: World) -> set[Iri]:
    """All names of a world, so that none of them is given to a part."""
    owners: Iterable[World | Body | Joint | Light | NamedResource] = chain(
        (world,), world.bodies, world.joints, world.lights, world.resources
    )
    names: set[Iri] = set()
    for owner in owners:
        names.add(owner.iri)
        waiting = list(owner.facts)
        while waiting:
            value = waiting.pop().value
            if isinstance(value, IriRef):
                names.add(value.iri)
            elif isinstance(value, BlankNode):
                waiting.extend(value.facts)
    return names


is_plain_name = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*").fullmatch
"""Matches what may follow a prefix, or be a label, in XML and Turtle alike."""

_XMLNS = "http://www.w3.org/2000/xmlns/"
"""The one namespace that no prefix may stand for."""


class PrefixTable:
    """All names of a file: each checked once, with a short form where there is one."""

    def __init__(self, map: Iri, sections: Iterable[DocumentSection]) -> None:
        """Gathers the names.

        Raises:
            MapWriteError: one is not an IRI.
        """
        self.prefixes = {OWL: "owl", XSD: "xsd", KNOWROB: "knowrob", RDFS: "rdfs", RDF: "rdf"}
        self.blank_node_labels: dict[Iri, str] = {}
        iris, labels = {map: None}, {}  # type: dict[Iri, None], dict[Iri, None]
        self._properties: dict[Iri, tuple[str, str] | None] = {}
        languages: set[str] = set()
        datatypes: set[Iri] = set()
        for fact in _all_facts(sections, iris):
            self._properties[fact.property] = None
            if isinstance(fact.value, IriRef):
                iris[fact.value.iri] = None
            elif isinstance(fact.value, Literal):
                if fact.value.language:
                    languages.add(fact.value.language)
                elif fact.value.datatype:
                    datatypes.add(fact.value.datatype)
        for iri in iris:
            if iri.startswith("_:"):
                labels[iri] = None
            else:
                _check_iri(iri)
        for iri in (*self._properties, *datatypes):
            _check_iri(iri)
        for language in languages:
            _check_language(language)
        self._assign_labels(labels)
        self._assign_prefixes(map)
        for property in self._properties:
            match = xml_local_name(property)
            if match and match.start() and property[: match.start()] != _XMLNS:
                self._properties[property] = property[: match.start()], match[0]
                self._assign_prefix(property[: match.start()])

    def split(self, property: Iri) -> tuple[str, str] | None:
        """Prefix and name of a property; None where no name can be split off."""
        parts = self._properties[property]
        return None if parts is None else (self.prefixes[parts[0]], parts[1])

    def _assign_labels(self, labels: Iterable[Iri]) -> None:
        fits = {label: label[2:] for label in labels if is_plain_name(label[2:])}
        taken = set(fits.values())
        free = (name for number in count(1) if (name := f"b{number}") not in taken)
        self.blank_node_labels = {label: fits.get(label) or next(free) for label in labels}

    def _assign_prefixes(self, map: Iri) -> None:
        if (namespace := namespace_of(map)) and not map.startswith("_:"):
            self._assign_prefix(namespace)

    def _assign_prefix(self, namespace: str) -> None:
        if namespace in self.prefixes:
            return
        last = re.split(r"[/:]", namespace.rstrip("#/:"))[-1].lower()
        name = "ms" if namespace == MS else re.sub(r"\.\w+$", "", last)
        if not is_plain_name(name) or name.startswith(("_", "xml")):
            name = "ns"
        taken = set(self.prefixes.values())
        candidates = (f"{name}{number}" for number in count(2))
        self.prefixes[namespace] = name if name not in taken else next(new for new in candidates if new not in taken)


def _all_facts(sections: Iterable[DocumentSection], subjects: dict[Iri, None]) -> Iterator[PropertyAssertion]:
    for section in sections:
        for block in section.blocks:
            subjects[block.subject] = None
            waiting = list(block.facts)
            while waiting:
                fact = waiting.pop()
                yield fact
                if isinstance(fact.value, BlankNode):
                    waiting.extend(fact.value.facts)


def _check_iri(iri: str) -> None:
    try:
        ox.NamedNode(iri)
    except ValueError as error:
        raise MapWriteError(f"<{iri}>", cause=f"it is not an IRI: {error}") from error


def _check_language(language: str) -> None:
    try:
        ox.Literal("", language=language)
    except ValueError as error:
        raise MapWriteError(f"a text in the language {language!r}", cause=str(error)) from error
