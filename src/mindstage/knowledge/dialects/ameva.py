"""Dialect 3, AMEVA's maps: dialect 1's words in other units, with joints that say neither axis nor limits.

How its numbers are meant is decided by evidence (see `inferred_membership`); what classes say of all their members, members then
say themselves; and a joint gets the axis and range that the things it joins make likely. Whatever was there is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from mindstage.knowledge.readers.ameva_joints import add_joint_definitions
from mindstage.knowledge.readers.semlog import read_semlog
from mindstage.knowledge.readers.semlog_early import with_tag_properties
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.knowledge.reading.conversion import convert_source_map, is_converted
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.reading.settling import infer_conventions
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
from mindstage.world import BlankNode, Iri, IriRef, PropertyAssertion, World

__all__ = ["AMEVA_DIALECT", "is_ameva", "read_ameva"]

AMEVA_DIALECT = "AMEVA"
AMEVA_DEFAULTS = UnitConventions(units=LengthUnit.CENTIMETERS, frame=Handedness.UNREAL, quaternion=QuaternionOrder.XYZW)

_DISTINCTIVE_PROPERTIES = frozenset({knowrob("maskColor"), knowrob("levelName")})
_CLASS_VALUED = (MASS.property, MESH.property)
"""What a class may say of all its members."""


def is_ameva(source_map: SourceMap) -> bool:
    """Whether a map is of this dialect, and still as it was written: what we write of one is in dialect 1."""
    if is_converted(source_map):
        return False
    classes: set[Iri] = set()
    for iri in (source_map.map, *source_map.members):
        for fact in source_map.graph.get(iri, ()):
            if fact.property in _DISTINCTIVE_PROPERTIES:
                return True
            if fact.property == TYPE and isinstance(fact.value, IriRef):
                classes.add(fact.value.iri)
    said = (fact for cls in classes for fact in _class_values(source_map.graph.get(cls, ())))
    return not JOINT_CLASSES.isdisjoint(classes) or any(fact.property in _CLASS_VALUED for fact in said)


def read_ameva(source_map: SourceMap) -> World:
    """Reads a map of dialect 3."""
    conventions = infer_conventions(source_map, AMEVA_DEFAULTS)
    source_map = convert_source_map(source_map, conventions, dialect=AMEVA_DIALECT)
    return read_semlog(add_joint_definitions(with_tag_properties(_with_class_values(source_map))))


def _with_class_values(source_map: SourceMap) -> SourceMap:
    """Members say what their classes say of them, where they say nothing else."""
    told: dict[Iri, dict[Iri, PropertyAssertion]] = {}
    members = set(source_map.members)
    for cls, facts in source_map.graph.items():
        for fact in _class_values(facts) if cls not in members else ():
            if fact.property in _CLASS_VALUED:
                told.setdefault(cls, {}).setdefault(fact.property, fact)
    if not told:
        return source_map
    graph = dict(source_map.graph)
    for member in source_map.members:
        facts = graph[member]
        types = types_of(facts)
        above = (cls for level in source_map.hierarchy.levels(types) for cls in level)
        inherited: dict[Iri, PropertyAssertion] = {}
        for cls in above:
            inherited = {**told.get(cls, {}), **inherited}
        own = {fact.property for fact in facts}
        graph[member] = [*facts, *(fact for property, fact in inherited.items() if property not in own)]
    return replace(source_map, graph=graph)


def _class_values(facts: Sequence[PropertyAssertion]) -> Iterator[PropertyAssertion]:
    """What a class says of its members: plainly, or by a restriction to a value."""
    for fact in facts:
        if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS) and isinstance(fact.value, BlankNode):
            inner = fact.value.facts
            on = [each.value.iri for each in inner if each.property == ON_PROPERTY and isinstance(each.value, IriRef)]
            yield from (PropertyAssertion(on[0], each.value) for each in inner if each.property == HAS_VALUE and on)
        elif fact.property in _CLASS_VALUED:
            yield fact
