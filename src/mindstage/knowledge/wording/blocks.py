"""Blocks: a world as statements in the order of a map file, subject by subject, before any syntax.

What the readers of dialect 1 understand is said in its words, what it has no word for in ours (see `vocabulary`), and
facts and resources are said as they stand.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import Any, TypeVar

from mindstage.errors import MapUnwritable
from mindstage.knowledge.findings import Severity
from mindstage.knowledge.names import local_name, part_name
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    LIGHT_CLASSES,
    NAMED_INDIVIDUAL,
    ONTOLOGY,
    OWL_CLASS,
    PARENT,
    SEMANTIC_MAP,
    THING,
    TYPE,
)
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.body_sizes import say_size
from mindstage.knowledge.wording.materials import say_materials
from mindstage.knowledge.wording.nesting import NESTING
from mindstage.knowledge.wording.parts import ANGULAR_PART, LINEAR_PART, POSE_PART, Part
from mindstage.knowledge.wording.sizes import class_sizes_of
from mindstage.knowledge.wording.statements import Heard, Said
from mindstage.knowledge.wording.tags import say_tags
from mindstage.world import (
    Anonymous,
    Body,
    BodyId,
    Constraint,
    Fact,
    Iri,
    Light,
    Reference,
    Resource,
    World,
)

__all__ = ["Block", "Section", "sections_of"]

T = TypeVar("T")


@dataclass(slots=True)
class Block:
    """What is said about one subject."""

    subject: Iri
    facts: list[Fact]
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """Blocks that stand together under a heading."""

    heading: str
    blocks: Sequence[Block]


def sections_of(world: World) -> Sequence[Section]:
    """The statements of a world.

    Raises:
        MapUnwritable: two of its parts have one name, or a value is no value (an infinite mass, a child that is not
            there).
    """
    writing = _Writing(world)
    individuals = list(writing.individuals())
    ontologies, properties, classes, others = writing.resources()
    sections = (
        Section("Ontologies", ontologies),
        Section("Property Definitions", properties),
        Section("Class Definitions", classes),
        Section("Individuals", individuals),
        Section("Further Statements", others),
    )
    deep = _Deep(writing.mentioned)
    for section in sections:
        for block in section.blocks:
            block.facts = [deep.shallow(fact) for fact in block.facts]
    return (*sections, Section("Nodes Inside Nodes", list(deep.blocks())))


class _Deep:
    """Nodes nested too deeply for any recursion get labels and blocks of their own."""

    def __init__(self, mentioned: Container[str]) -> None:
        self._labels = (Iri(f"_:deep{n}") for n in count(1) if f"_:deep{n}" not in mentioned)
        self._waiting: list[tuple[Iri, Sequence[Fact]]] = []

    def shallow(self, fact: Fact, level: int = 1) -> Fact:
        if not isinstance(fact.value, Anonymous):
            return fact
        if level == NESTING:
            label = next(self._labels)
            self._waiting.append((label, fact.value.facts))
            return Fact(fact.property, Reference(label))
        return Fact(fact.property, Anonymous(tuple(self.shallow(inner, level + 1) for inner in fact.value.facts)))

    def blocks(self) -> Iterator[Block]:
        for label, facts in self._waiting:  # grows while it runs
            yield Block(label, [self.shallow(fact) for fact in facts])


class _Writing:
    """One world on its way into statements."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.iris = _iris_by_id(world)
        self.sizes = class_sizes_of(world.resources)
        self.mentioned = _mentioned(world)
        self.own = {world.iri, *self.iris.values(), *_left_out(world)}
        self.parts: dict[Iri, tuple[Part[Any], Any, Block]] = {}
        self.parents: dict[BodyId, list[Iri]] = {}
        self.children: dict[BodyId, list[Iri]] = {}
        for attachment in world.attachments:
            self.parents.setdefault(attachment.child, []).append(self._end(attachment.parent, attachment.child))
            self.children.setdefault(attachment.parent, []).append(self._end(attachment.child, attachment.parent))

    def individuals(self) -> Iterator[Block]:
        """The map, then bodies, constraints and lights, each followed by its parts."""
        yield self._map()
        for body in self.world.bodies:
            yield from self._body(body)
        for constraint in self.world.constraints:
            yield from self._constraint(constraint)
        for light in self.world.lights:
            yield from self._light(light)

    def resources(self) -> tuple[list[Block], ...]:
        """All others: ontologies, properties, classes, the rest. What is said of a part joins what the part says."""
        sorted_out: tuple[list[Block], ...] = ([], [], [], [])
        ontologies, properties, classes, others = sorted_out
        for resource in self.world.resources:
            if resource.iri in self.parts:
                self.parts[resource.iri][2].facts.extend(resource.facts)
                continue
            types = types_of(resource.facts)
            name = local_name(resource.iri)
            if ONTOLOGY in types:
                ontologies.append(Block(resource.iri, list(resource.facts)))
            elif any(cls.endswith("Property") for cls in types):
                properties.append(Block(resource.iri, list(resource.facts)))
            elif OWL_CLASS in types:
                classes.append(Block(resource.iri, list(resource.facts), f"Class {name}"))
            else:
                others.append(Block(resource.iri, list(resource.facts)))
        return sorted_out

    # -- individuals ---------------------------------------------------------------------------------------------------

    def _map(self) -> Block:
        world = self.world
        said = Said(world.iri, world.facts)
        said.add(TYPE, NAMED_INDIVIDUAL)
        said.add(TYPE, SEMANTIC_MAP)
        name = local_name(world.iri)
        says_name = world.name != name or said.told(words.LABEL_WORD) == name
        said.value(words.LABEL_WORD, world.name if says_name else None)
        return Block(world.iri, said.everything(), f"Semantic Map {world.name}")

    def _begin(self, thing: Body | Constraint | Light, cls: Iri | None) -> Said:
        said = Said(thing.iri, thing.facts)
        said.add(TYPE, NAMED_INDIVIDUAL)
        if cls is not None:
            said.add(TYPE, cls)
        said.add(DESCRIBED_IN_MAP, self.world.iri)
        said.value(words.ID, thing.id if thing.id != local_name(thing.iri) else None)
        return said

    def _body(self, body: Body) -> Iterator[Block]:
        said = self._begin(body, None if body.cls == THING else body.cls)
        for child in self.children.get(body.id, ()):
            said.add(CHILD, child)
        for parent in self.parents.get(body.id, ()):
            said.add(PARENT, parent)
        said.value(words.LABEL_WORD, body.label)
        physics = body.physics
        said.value(words.MOBILITY, physics.mobility)
        said.value(words.MASS, physics.mass_kg)
        said.value(words.OVERLAP_EVENTS, physics.overlap_events)
        said.value(words.GRAVITY, physics.gravity)
        classes = (body.cls, *(cls for cls in types_of(body.facts) if cls != body.cls))
        say_size(said, classes, body.size, self.sizes)
        pose = self._part(said, body, POSE_PART, body.pose)
        said.value(words.MESH, body.mesh)
        said.value(words.SHAPE, body.shape.kind if body.shape else None)
        say_materials(said, body.materials)
        say_tags(said, body.tags)
        yield Block(body.iri, said.everything(), f"Individual {local_name(body.cls)}")
        yield from pose

    def _constraint(self, constraint: Constraint) -> Iterator[Block]:
        said = self._begin(constraint, CONSTRAINT)
        said.add(PARENT, self._end(constraint.parent, constraint.id))
        said.add(CHILD, self._end(constraint.child, constraint.id))
        say_tags(said, constraint.tags)
        said.value(words.DISABLE_COLLISION, constraint.disable_collision)
        parts = [
            *self._part(said, constraint, POSE_PART, constraint.pose),
            *self._part(said, constraint, LINEAR_PART, constraint.linear),
            *self._part(said, constraint, ANGULAR_PART, constraint.angular),
        ]
        yield Block(constraint.iri, said.everything(), "Constraint")
        yield from parts

    def _light(self, light: Light) -> Iterator[Block]:
        said = self._begin(light, LIGHT_CLASSES[light.kind])
        said.value(words.COLOUR, light.colour)
        said.value(words.INTENSITY, light.intensity)
        say_tags(said, light.tags)
        pose = self._part(said, light, POSE_PART, light.pose)
        yield Block(light.iri, said.everything(), "Light")
        yield from pose

    def _end(self, body: BodyId, other: BodyId) -> Iri:
        if body not in self.iris:
            raise MapUnwritable(other, cause=f"it has to do with {body!r}, which is not in the world")
        return self.iris[body]

    # -- parts ---------------------------------------------------------------------------------------------------------

    def _part(self, said: Said, whole: Body | Constraint | Light, part: Part[T], value: T) -> Iterable[Block]:
        """Says a part, under the name that the facts have for it if nothing else stands under that name."""
        told = next((fact.value for fact in whole.facts if fact.property == part.property), None)
        if isinstance(told, Anonymous) and part.read(Heard(whole.iri, told.facts, _silent, is_part=True)) == value:
            return ()
        name = told.iri if isinstance(told, Reference) and told.iri not in self.own else None
        if name in self.parts:
            other, there, _ = self.parts[name]
            if other is part and there == value:
                return ()
            name = None
        if name is None:
            name = part_name(whole.iri, part.suffix, self.mentioned)
            said.add(part.property, name)
        own = Said(name)
        own.add(TYPE, NAMED_INDIVIDUAL)
        own.add(TYPE, part.cls)
        part.write(own, value)
        block = Block(name, own.everything())
        self.parts[name] = (part, value, block)
        return (block,)


def _silent(severity: Severity, individual: str, property: str, what: str, did: str) -> None:
    """Whoever reads the file will hear of it."""


def _iris_by_id(world: World) -> dict[BodyId, Iri]:
    iris: dict[BodyId, Iri] = {}
    names = {world.iri: "the map"}
    things: Iterable[Body | Constraint | Light] = chain(world.bodies, world.constraints, world.lights)
    for thing in things:
        if thing.id in iris:
            raise MapUnwritable(repr(thing.id), cause="two things have this id")
        if thing.iri in names:
            raise MapUnwritable(repr(thing.id), cause=f"{names[thing.iri]} is called <{thing.iri}> too")
        iris[thing.id] = thing.iri
        names[thing.iri] = repr(thing.id)
    return iris


def _left_out(world: World) -> Iterator[Iri]:
    """Individuals of the map that are not in the world, and nobody's part for that."""
    for resource in world.resources:
        types = types_of(resource.facts)  # a part that says where it is described has lost its only one on the way
        telling = (PARENT, CHILD, DESCRIBED_IN_MAP) if CONSTRAINT in types else (DESCRIBED_IN_MAP,)
        if types and any(fact.property in telling for fact in resource.facts):
            yield resource.iri


def _mentioned(world: World) -> set[Iri]:
    """All names of a world, so that none of them is given to a part."""
    owners: Iterable[World | Body | Constraint | Light | Resource] = chain(
        (world,), world.bodies, world.constraints, world.lights, world.resources
    )
    names: set[Iri] = set()
    for owner in owners:
        names.add(owner.iri)
        waiting = list(owner.facts)
        while waiting:
            value = waiting.pop().value
            if isinstance(value, Reference):
                names.add(value.iri)
            elif isinstance(value, Anonymous):
                waiting.extend(value.facts)
    return names
