"""Dialect 5, SOMA: any world as a map of KnowRob 2 that needs no other file.

Places stand where SOMA has them, and nowhere else. Shapes, colours, parts and joints are said once more in its words,
in nodes that say so; what it has no words for (physics, tags, lights, several axes at once) stays in dialect 1's and
ours. So those who know only SOMA find what they look for, and we read the same world again (see `restating`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from mindstage.knowledge.names import part_name
from mindstage.knowledge.readers.soma_nodes import Node, Nodes
from mindstage.knowledge.reading.conversion import given
from mindstage.knowledge.reading.other_words import HAS_COLOUR, HAS_JOINT, HAS_LOCALIZATION, HAS_SHAPE, urdf
from mindstage.knowledge.reading.restating import HAS_COMPONENT, extents_in, localized
from mindstage.knowledge.vocabulary import (
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    DIALECT,
    HAS_POSE,
    HAS_VALUE,
    ON_PROPERTY,
    OWL,
    OWL_CLASS,
    RESTATES,
    SUBCLASS_OF,
    TYPE,
)
from mindstage.knowledge.wording.blocks import Block, Section
from mindstage.knowledge.wording.nesting import sorted_facts
from mindstage.knowledge.wording.words import QUATERNION, TRANSLATION
from mindstage.knowledge.writers.soma_nodes import (
    axes_of,
    colour_node,
    joint_node,
    limits_node,
    localization_node,
    node,
    shape_node,
)
from mindstage.world import Anonymous, Body, Constraint, Fact, FactValue, Iri, Literal, Physics, Pose, Reference, World

__all__ = ["SOMA_DIALECT", "Places", "in_soma"]

SOMA_DIALECT = "SOMA"
_WITHOUT_AXIS = {0: "FixedJoint", 6: "FloatingJoint"}
_RESTRICTION = Iri(OWL + "Restriction")


def in_soma(world: World, whole: Sequence[Section]) -> tuple[Sequence[Section], tuple[str, ...]]:
    """The sections of a map in SOMA's words, and what those have no way to say.

    Args:
        world: what is written.
        whole: all of it in the words of dialect 1.
    """
    sections = [replace(section, blocks=[replace(block, facts=list(block.facts)) for block in section.blocks])
                for section in whole]  # fmt: skip
    blocks = {block.subject: block for section in sections for block in section.blocks}
    writing = _Writing(world, blocks)
    writing.run()
    return [*sections[:2], Section("Joint Classes", writing.classes), *sections[2:]], tuple(_untold(world))


def _untold(world: World) -> Sequence[str]:
    """What those who know only SOMA will not find in such a map, in sentences."""
    several = [each.id for each in world.constraints if len(axes_of(each)) not in (1, *_WITHOUT_AXIS)]
    dynamic = [body.id for body in world.bodies if body.physics != Physics()]
    told = (
        (several, "joints move in several ways at once"),
        (dynamic, "bodies say how they take part in the physics"),
        ([light.id for light in world.lights], "lights shine"),
        ([body.id for body in world.bodies if body.tags], "bodies have tags"),
    )
    return [f"{len(ids)} {what}, for which SOMA has no words: SemLog's are used" for ids, what in told if ids]


class _Writing:
    def __init__(self, world: World, blocks: dict[Iri, Block]) -> None:
        self.world, self.blocks = world, blocks
        self.bodies = {body.id: body for body in world.bodies}
        self.parents = {attachment.child: attachment.parent for attachment in world.attachments}
        self.others = {thing.iri for thing in world.constraints} | {thing.iri for thing in world.lights}
        self.classes: list[Block] = []

    def run(self) -> None:
        """Says everything; the map last, since it is told then what others were written in before."""
        places = Places(self.blocks, self.others)
        for body in self.world.bodies:
            facts = self.blocks[body.iri].facts
            places.say(body, facts)
            self._say_shape(body, facts)
            self._say_colour(body, facts)
            self._say_whole(body, facts)
        for constraint in self.world.constraints:
            self._say_joint(constraint)
        facts = self.blocks[self.world.iri].facts
        facts.insert(0, Fact(DIALECT, Literal(SOMA_DIALECT)))

    def _say_shape(self, body: Body, facts: list[Fact]) -> None:
        if any(fact.property == HAS_SHAPE for fact in facts):
            nodes = Nodes({})
            shapes = nodes.below(Node(body.iri, facts), HAS_SHAPE)
            if body.size is None or any(tuple(extents_in(shape)) == body.size for shape in shapes):
                return
            _shelve(facts, HAS_SHAPE)
        if (shape := shape_node(body)) is not None:
            facts.append(Fact(HAS_SHAPE, shape))

    def _say_colour(self, body: Body, facts: list[Fact]) -> None:
        colour = next((material.colour for material in body.materials if material.colour), None)
        if colour is not None and all(fact.property != HAS_COLOUR for fact in facts):
            facts.append(Fact(HAS_COLOUR, colour_node(colour)))

    def _say_whole(self, body: Body, facts: list[Fact]) -> None:
        if body.id not in self.parents:
            return
        whole = self.blocks[self.bodies[self.parents[body.id]].iri]
        part = Fact(HAS_COMPONENT, Reference(body.iri))
        if part not in whole.facts:
            whole.facts.append(part)
            facts.append(Fact(RESTATES, Reference(HAS_COMPONENT)))

    def _say_joint(self, constraint: Constraint) -> None:
        parent, child = self.bodies[constraint.parent], self.bodies[constraint.child]
        facts = self.blocks[parent.iri].facts
        told = (fact.value.facts for fact in facts if fact.property == HAS_JOINT and isinstance(fact.value, Anonymous))
        if any(Fact(urdf("hasChildLink"), Reference(child.iri)) in each for each in told):
            return
        if (cls := self._joint_class(constraint)) is not None:
            facts.append(Fact(HAS_JOINT, joint_node(constraint, cls, (parent.iri, child.iri), parent.pose)))

    def _joint_class(self, constraint: Constraint) -> Iri | None:
        """What kind of joint it is; one that ends somewhere has a class of its own, which says where."""
        axes = axes_of(constraint)
        if len(axes) != 1:
            return urdf(_WITHOUT_AXIS[len(axes)]) if len(axes) in _WITHOUT_AXIS else None
        axis = axes[0]
        if axis.range is None:
            return urdf("ContinuousJoint" if axis.turns else "PrismaticJoint")
        restriction = node(
            _RESTRICTION,
            [
                Fact(ON_PROPERTY, Reference(urdf("hasJointLimits"))),
                Fact(HAS_VALUE, limits_node(axis.range)),
            ],
        )
        cls = part_name(constraint.iri, "class", self.blocks)
        block = Block(
            cls,
            [
                Fact(TYPE, Reference(OWL_CLASS)),
                Fact(RESTATES, Reference(CONSTRAINT)),
                Fact(SUBCLASS_OF, Reference(urdf("RevoluteJoint" if axis.turns else "PrismaticJoint"))),
                Fact(SUBCLASS_OF, restriction),
            ],
        )
        self.classes.append(block)
        self.blocks[cls] = block
        return cls


class Places:
    """Says where bodies are in SOMA's words and not in dialect 1's."""

    def __init__(self, blocks: Mapping[Iri, Block], others: Iterable[Iri]) -> None:
        """Begins.

        Args:
            blocks: by subject, all that is said; poses among it change.
            others: what is no body, and keeps its pose as it is.
        """
        self.blocks = blocks
        self._spared = {
            fact.value.iri
            for other in others
            for fact in blocks[other].facts
            if fact.property == HAS_POSE and isinstance(fact.value, Reference)
        }
        self._said: set[Iri] = set()

    def say(self, body: Body, facts: list[Fact]) -> bool:
        """Says where a body is, unless it does so itself; a place that is not true any more is shelved.

        Args:
            body: what is somewhere.
            facts: all that is said about it, which changes.
        """
        at = next((index for index, fact in enumerate(facts) if fact.property == HAS_POSE), None)
        if at is None or _says_place(facts, body.pose):
            return False
        place = self._place(facts[at].value)
        if place is None:
            return False
        facts[at] = Fact(HAS_LOCALIZATION, localization_node(place))
        _shelve(facts, HAS_LOCALIZATION, but=at)
        return True

    def _place(self, value: FactValue) -> FactValue | None:
        if isinstance(value, Anonymous) and not any(isinstance(inner.value, Anonymous) for inner in value.facts):
            told = localized(value.facts)
            return None if told is None else Anonymous(sorted_facts(told))
        if not isinstance(value, Reference) or value.iri not in self.blocks or value.iri in self._spared:
            return None
        if value.iri not in self._said:
            if any(fact.property == DESCRIBED_IN_MAP for fact in self.blocks[value.iri].facts):
                return None  # what else it is could not be told without its being a pose
            told = localized(self.blocks[value.iri].facts)
            if told is None:
                return None
            self.blocks[value.iri].facts = told
            self._said.add(value.iri)
        return value


def _says_place(facts: Sequence[Fact], pose: Pose) -> bool:
    """Whether something says itself in SOMA's words that it is there."""
    here = Node(None, facts)
    for below in Nodes({}).below(here, HAS_LOCALIZATION):
        position, rotation = below.numbers(TRANSLATION.property), below.numbers(QUATERNION.property)
        if position == pose.position and len(rotation) == 4:
            return (rotation[3], *rotation[:3]) == pose.quaternion
    return False


def _shelve(facts: list[Fact], property: Iri, *, but: int | None = None) -> None:
    """Puts aside what is not true any more; whoever reads the map puts it back."""
    for index, fact in enumerate(facts):
        if fact.property == property and index != but:
            facts[index] = Fact(given(property), fact.value)
