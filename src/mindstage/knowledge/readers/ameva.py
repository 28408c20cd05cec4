"""Dialect 3, AMEVA's maps: dialect 1's words in other units, with joints that say neither axis nor limits.

How its numbers are meant is decided by evidence (see `settling`); what classes say of all their members, members then
say themselves; and a joint gets the axis and range that the things it joins make likely. Whatever was there is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from mindstage.knowledge.readers.ameva_joints import with_joints
from mindstage.knowledge.readers.semlog import read_semlog
from mindstage.knowledge.readers.semlog_early import with_told_by_tags
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.conventions import Conventions, Frame, QuaternionOrder, Units
from mindstage.knowledge.reading.conversion import convert, is_converted
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.settling import conventions_by_evidence
from mindstage.knowledge.vocabulary import (
    EQUIVALENT_CLASS,
    HAS_VALUE,
    JOINT_CLASSES,
    ON_PROPERTY,
    SUBCLASS_OF,
    TYPE,
    knowrob,
)
from mindstage.knowledge.wording.words import MASS, MESH
from mindstage.world import Anonymous, Fact, Iri, Reference, World

__all__ = ["AMEVA", "is_ameva", "read_ameva"]

AMEVA = "AMEVA"
USUAL = Conventions(units=Units.CENTIMETRES, frame=Frame.UNREAL, quaternion=QuaternionOrder.XYZW)

_HALLMARKS = frozenset({knowrob("maskColor"), knowrob("levelName")})
_OF_CLASSES = (MASS.property, MESH.property)
"""What a class may say of all its members."""


def is_ameva(excerpt: Excerpt) -> bool:
    """Whether a map is of this dialect, and still as it was written: what we write of one is in dialect 1."""
    if is_converted(excerpt):
        return False
    classes: set[Iri] = set()
    for iri in (excerpt.map, *excerpt.members):
        for fact in excerpt.graph.get(iri, ()):
            if fact.property in _HALLMARKS:
                return True
            if fact.property == TYPE and isinstance(fact.value, Reference):
                classes.add(fact.value.iri)
    said = (fact for cls in classes for fact in _said_by(excerpt.graph.get(cls, ())))
    return not JOINT_CLASSES.isdisjoint(classes) or any(fact.property in _OF_CLASSES for fact in said)


def read_ameva(excerpt: Excerpt) -> World:
    """Reads a map of dialect 3."""
    conventions = conventions_by_evidence(excerpt, USUAL)
    excerpt = convert(excerpt, conventions, dialect=AMEVA)
    return read_semlog(with_joints(with_told_by_tags(_with_class_values(excerpt))))


def _with_class_values(excerpt: Excerpt) -> Excerpt:
    """Members say what their classes say of them, where they say nothing else."""
    told: dict[Iri, dict[Iri, Fact]] = {}
    members = set(excerpt.members)
    for cls, facts in excerpt.graph.items():
        for fact in _said_by(facts) if cls not in members else ():
            if fact.property in _OF_CLASSES:
                told.setdefault(cls, {}).setdefault(fact.property, fact)
    if not told:
        return excerpt
    graph = dict(excerpt.graph)
    for member in excerpt.members:
        facts = graph[member]
        types = types_of(facts)
        above = (cls for level in excerpt.hierarchy.levels(types) for cls in level)
        inherited: dict[Iri, Fact] = {}
        for cls in above:
            inherited = {**told.get(cls, {}), **inherited}
        own = {fact.property for fact in facts}
        graph[member] = [*facts, *(fact for property, fact in inherited.items() if property not in own)]
    return replace(excerpt, graph=graph)


def _said_by(facts: Sequence[Fact]) -> Iterator[Fact]:
    """What a class says of its members: plainly, or by a restriction to a value."""
    for fact in facts:
        if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS) and isinstance(fact.value, Anonymous):
            inner = fact.value.facts
            on = [
                each.value.iri for each in inner if each.property == ON_PROPERTY and isinstance(each.value, Reference)
            ]
            yield from (Fact(on[0], each.value) for each in inner if each.property == HAS_VALUE and on)
        elif fact.property in _OF_CLASSES:
            yield fact
