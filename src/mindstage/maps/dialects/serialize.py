"""A world as statements in the order of a map file, subject by subject, independent of the syntax.

Everything is written with the terms of dialect 1, or with our own terms where there are none (see
`mindstage.rdf.vocabulary`); facts and resources are written unchanged. A `PrefixTable` checks all names of a file
and shortens them.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import Any, TypeVar

import pyoxigraph as ox

from mindstage.errors import MapWriteError
from mindstage.maps.dialects.membership import types_of
from mindstage.maps.dialects.unit_conversion import with_pivot
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.fields import map_class_geometry, write_materials, write_mesh, write_size, write_tags
from mindstage.maps.rdf_mapping.nested import (
    MAX_NESTING,
    NESTED_ANGULAR_LIMITS,
    NESTED_LINEAR_LIMITS,
    NESTED_POSE,
    NestedResource,
    sorted_facts,
)
from mindstage.maps.rdf_mapping.properties import SubjectReader, SubjectWriter
from mindstage.rdf.graphs import Severity, local_name, namespace_of, part_name, xml_local_name
from mindstage.rdf.vocabulary import (
    ASSUMED_PARENT,
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    GIVEN_SIZES,
    HAS_POSE,
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

is_plain_name = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*").fullmatch
"""Matches names that can follow a prefix, or be a label, in XML and Turtle alike."""
_XMLNS = "http://www.w3.org/2000/xmlns/"
"""The namespace that cannot have a prefix."""


@dataclass(slots=True)
class SubjectBlock:
    """The statements about one subject."""

    subject: Iri
    facts: list[PropertyAssertion]
    comment: str = ""


@dataclass(frozen=True, slots=True)
class DocumentSection:
    """A section of a file with a heading."""

    heading: str
    blocks: Sequence[SubjectBlock]


def to_sections(world: World) -> Sequence[DocumentSection]:
    """Converts a world to statements.

    Raises:
        MapWriteError: two entities have the same name, or a value cannot be written (an infinite mass, a child that is
            not in the world).
    """
    serializer = _WorldSerializer(world)
    individuals = list(serializer.individuals())
    ontologies, properties, classes, others = serializer.resources()
    sections = (
        DocumentSection("Ontologies", ontologies),
        DocumentSection("Property Definitions", properties),
        DocumentSection("Class Definitions", classes),
        DocumentSection("Individuals", individuals),
        DocumentSection("Further Statements", others),
    )
    flattener = _DeepNodeFlattener(serializer.used_names)
    for section in sections:
        for block in section.blocks:
            block.facts = [flattener.flatten(_with_nested_pivot(fact)) for fact in with_pivot(block.facts)]
    return (*sections, DocumentSection("Nodes Inside Nodes", list(flattener.blocks())))


def _with_nested_pivot(fact: PropertyAssertion) -> PropertyAssertion:
    if fact.property != HAS_POSE or not isinstance(fact.value, BlankNode):
        return fact
    return PropertyAssertion(HAS_POSE, BlankNode(sorted_facts(with_pivot(fact.value.facts))))


class _DeepNodeFlattener:
    """Moves blank nodes below `MAX_NESTING` to labels and blocks of their own."""

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
    """Converts one world to statements."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.iris = _iris_by_id(world)
        self.class_geometry = map_class_geometry(world.resources)
        self.used_names = _all_iris(world)
        self.top_level = {world.iri, *self.iris.values(), *_omitted_individuals(world)}
        self.nested_resources: dict[Iri, tuple[NestedResource[Any], Any, SubjectBlock]] = {}
        self.parents: dict[BodyId, list[Iri]] = {}
        self.jointed = {end for joint in world.joints for end in (joint.parent, joint.child)}
        self.children: dict[BodyId, list[Iri]] = {}
        for attachment in world.attachments:
            self.parents.setdefault(attachment.child, []).append(self._body_iri(attachment.parent, attachment.child))
            self.children.setdefault(attachment.parent, []).append(self._body_iri(attachment.child, attachment.parent))

    def individuals(self) -> Iterator[SubjectBlock]:
        """The map, then bodies, joints and lights, each followed by its nested resources."""
        yield self._map()
        for body in self.world.bodies:
            yield from self._body(body)
        for joint in self.world.joints:
            yield from self._joint(joint)
        for light in self.world.lights:
            yield from self._light(light)

    def resources(self) -> tuple[list[SubjectBlock], ...]:
        """Ontologies, properties, classes and all others; statements about a nested resource are added to its block."""
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
        writer = SubjectWriter(world.iri, world.facts)
        writer.add_reference(TYPE, NAMED_INDIVIDUAL)
        writer.add_reference(TYPE, SEMANTIC_MAP)
        name = local_name(world.iri)
        has_label = world.name != name or writer.first_value(codecs.LABEL_CODEC) == name
        writer.write(codecs.LABEL_CODEC, world.name if has_label else None)
        if len(self.class_geometry) and not any(fact.property == GIVEN_SIZES for fact in world.facts):
            # The sizes of classes would be interpreted again, and their frame may be inferred differently.
            writer.add_fact(PropertyAssertion(GIVEN_SIZES, Literal("body")))
        return SubjectBlock(world.iri, writer.all_facts(), f"Semantic Map {world.name}")

    def _start_entity(self, entity: Body | Joint | Light, cls: Iri | None) -> SubjectWriter:
        writer = SubjectWriter(entity.iri, entity.facts)
        writer.add_reference(TYPE, NAMED_INDIVIDUAL)
        if cls is not None:
            writer.add_reference(TYPE, cls)
        writer.add_reference(DESCRIBED_IN_MAP, self.world.iri)
        writer.write(codecs.ID, entity.id if entity.id != local_name(entity.iri) else None)
        return writer

    def _body(self, body: Body) -> Iterator[SubjectBlock]:
        writer = self._start_entity(body, None if body.cls == THING else body.cls)
        for child in self.children.get(body.id, ()):
            writer.add_reference(CHILD, child)
        for parent in self.parents.get(body.id, ()):
            writer.add_reference(PARENT, parent)
        writer.write(codecs.LABEL_CODEC, body.label)
        physics = body.physics
        writer.write(codecs.MOBILITY, physics.stated_mobility)
        # That of other bodies is assumed again when the map is read.
        is_assumed = "mobility" in physics.assumed and body.id in self.jointed
        writer.write(codecs.ASSUMED_MOBILITY, physics.mobility if is_assumed else None)
        writer.write(codecs.MASS, physics.mass_kg)
        writer.write(codecs.OVERLAP_EVENTS, physics.overlap_events)
        writer.write(codecs.GRAVITY, physics.gravity)
        classes = (body.cls, *(cls for cls in types_of(body.facts) if cls != body.cls))
        write_size(writer, classes, body.size, self.class_geometry)
        pose = self._write_nested(writer, body, NESTED_POSE, body.pose)
        write_mesh(writer, classes, body.mesh, self.class_geometry)
        writer.write(codecs.SHAPE, body.shape.type if body.shape else None)
        write_materials(writer, body.materials)
        write_tags(writer, body.tags)
        yield SubjectBlock(body.iri, writer.all_facts(), f"Individual {local_name(body.cls)}")
        yield from pose

    def _joint(self, joint: Joint) -> Iterator[SubjectBlock]:
        writer = self._start_entity(joint, CONSTRAINT)
        role = ASSUMED_PARENT if "parent" in joint.assumed else PARENT
        writer.add_reference(role, self._body_iri(joint.parent, joint.id))
        writer.add_reference(CHILD, self._body_iri(joint.child, joint.id))
        write_tags(writer, joint.tags)
        writer.write(codecs.ASSUMED, " ".join(joint.assumed) or None)
        writer.write(codecs.DISABLE_COLLISION, joint.disable_collision)
        mimic = joint.mimic
        writer.write(codecs.MIMICS, None if mimic is None else self._body_iri(mimic.joint, joint.id))
        if mimic is not None:
            writer.write(codecs.MIMIC_MULTIPLIER, mimic.multiplier)
            writer.write(codecs.MIMIC_OFFSET, mimic.offset or None)
        parts = [
            *self._write_nested(writer, joint, NESTED_POSE, joint.pose),
            *self._write_nested(writer, joint, NESTED_LINEAR_LIMITS, joint.linear),
            *self._write_nested(writer, joint, NESTED_ANGULAR_LIMITS, joint.angular),
        ]
        yield SubjectBlock(joint.iri, writer.all_facts(), "Constraint")
        yield from parts

    def _light(self, light: Light) -> Iterator[SubjectBlock]:
        writer = self._start_entity(light, LIGHT_CLASSES[light.type])
        writer.write(codecs.COLOR, light.color)
        writer.write(codecs.INTENSITY, light.intensity)
        write_tags(writer, light.tags)
        pose = self._write_nested(writer, light, NESTED_POSE, light.pose)
        yield SubjectBlock(light.iri, writer.all_facts(), "Light")
        yield from pose

    def _body_iri(self, body: BodyId, other: BodyId) -> Iri:
        if body not in self.iris:
            raise MapWriteError(other, cause=f"it refers to {body!r}, which is not in the world")
        return self.iris[body]

    # -- parts ---------------------------------------------------------------------------------------------------------

    def _write_nested(
        self, writer: SubjectWriter, owner: Body | Joint | Light, nested_resource: NestedResource[T], value: T
    ) -> Iterable[SubjectBlock]:
        """Writes a nested resource, with the name that the facts have for it unless that is used otherwise."""
        given = next((fact.value for fact in owner.facts if fact.property == nested_resource.property), None)
        if (
            isinstance(given, BlankNode)
            and nested_resource.read(SubjectReader(owner.iri, given.facts, _ignore_finding, is_nested=True)) == value
        ):
            return ()
        name = given.iri if isinstance(given, IriRef) and given.iri not in self.top_level else None
        if name in self.nested_resources:
            other, written, _ = self.nested_resources[name]
            if other is nested_resource and written == value:
                return ()
            name = None
        if name is None:
            name = part_name(owner.iri, nested_resource.suffix, self.used_names)
            writer.add_reference(nested_resource.property, name)
        nested = SubjectWriter(name)
        nested.add_reference(TYPE, NAMED_INDIVIDUAL)
        nested.add_reference(TYPE, nested_resource.cls)
        nested_resource.write(nested, value)
        block = SubjectBlock(name, nested.all_facts())
        self.nested_resources[name] = (nested_resource, value, block)
        return (block,)


def _ignore_finding(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
    """Findings are reported when the written file is read."""


def _iris_by_id(world: World) -> dict[BodyId, Iri]:
    iris: dict[BodyId, Iri] = {}
    names = {world.iri: "the map"}
    entities: Iterable[Body | Joint | Light] = chain(world.bodies, world.joints, world.lights)
    for entity in entities:
        if entity.id in iris:
            raise MapWriteError(repr(entity.id), cause="two entities have this id")
        if entity.iri in names:
            raise MapWriteError(repr(entity.id), cause=f"{names[entity.iri]} has the same IRI <{entity.iri}>")
        iris[entity.id] = entity.iri
        names[entity.iri] = repr(entity.id)
    return iris


def _omitted_individuals(world: World) -> Iterator[Iri]:
    """Individuals of the map that are not in the world; they cannot be nested resources."""
    for resource in world.resources:
        types = types_of(resource.facts)  # a nested resource with a map of its own has no owner any more
        map_properties = (
            (ASSUMED_PARENT, PARENT, CHILD, DESCRIBED_IN_MAP) if CONSTRAINT in types else (DESCRIBED_IN_MAP,)
        )
        if types and any(fact.property in map_properties for fact in resource.facts):
            yield resource.iri


def _all_iris(world: World) -> set[Iri]:
    """All names of a world, so that no generated name equals one of them."""
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


class PrefixTable:
    """The checked names of a file, with prefixes."""

    def __init__(self, map: Iri, sections: Iterable[DocumentSection]) -> None:
        """Collects and checks all names.

        Raises:
            MapWriteError: a name is not an IRI.
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
        """The prefix and the local name of a property; None if it cannot be split."""
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
