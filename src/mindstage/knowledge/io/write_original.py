"""Own words: a world written back in the dialect of the map that it came from.

What a map says itself is written as it stands there, and nothing else, as long as its reader makes the same world of
it. Of what has changed since, as much is said as the reader needs; how is found out by reading. Where that leads
nowhere (somebody took a part off, which no statement of the map allows) the world is written in dialect 1's words.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import msgspec

from mindstage.knowledge.dialects import read_world
from mindstage.knowledge.dialects.conventions import Assumption, UnitConventions
from mindstage.knowledge.dialects.knowrob1 import KNOWROB1_DIALECT, perception_blocks
from mindstage.knowledge.dialects.membership import individuals_by_map
from mindstage.knowledge.dialects.soma_export import SOMA_DIALECT, SomaPoseWriter, write_as_soma
from mindstage.knowledge.dialects.soma_nodes import SAME_DIALECT, dual_dialect_info, without_restatements
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.dialects.unit_conversion import (
    CONVERTED_PROPERTIES,
    is_converted,
    original_conventions,
    original_property,
    restore_declarations,
    restore_facts,
)
from mindstage.knowledge.graph_diff import SourceMapView, canonical_statement
from mindstage.knowledge.rdf import Severity
from mindstage.knowledge.rdf_mapping.nested import NESTED_RESOURCES, nest_blank_nodes
from mindstage.knowledge.rdf_mapping.serialize import DocumentSection, SubjectBlock
from mindstage.knowledge.vocabulary import CHILD, DIALECT, FRAME, HAS_POSE, PARENT, QUATERNION_ORDER, UNITS
from mindstage.scene import (
    Body,
    Iri,
    IriRef,
    Joint,
    Light,
    Literal,
    NamedResource,
    PropertyAssertion,
    World,
    WorldDiff,
    diff,
)

__all__ = ["write_in_source_dialect"]

SEMLOG_DIALECT = "SemLog"
_DEFINITION_SECTIONS = 3
"""Sections of ontologies, properties and classes, which stand first."""
_PART_PROPERTIES = frozenset(part.property for part in NESTED_RESOURCES)
_ORIGINAL_PROPERTIES = frozenset(map(original_property, CONVERTED_PROPERTIES))
_DECLARATIONS = frozenset({UNITS, FRAME, QUATERNION_ORDER})


def write_in_source_dialect(
    world: World, all_sections: Sequence[DocumentSection], source_view: SourceMapView
) -> tuple[Sequence[DocumentSection], tuple[str, ...]]:
    """The sections of a map that says the same as its origin where the world is still the same.

    With them comes what could not be said in the map's own words.

    Args:
        world: as it is now.
        whole: all of it in the words of dialect 1.
        origin: the map that it came from.
    """
    writing = _SourceDialectWriter(world, all_sections, source_view)
    return writing.sections(), tuple(writing.notes)


class _SourceDialectWriter:
    def __init__(self, world: World, all_sections: Sequence[DocumentSection], source_view: SourceMapView) -> None:
        self.world, self.all_sections, self.dialect = world, all_sections, source_view.dialect
        self.source_map = without_restatements(source_view.source_map)
        self.dual_dialect = dual_dialect_info(source_view.source_map)
        self.notes: list[str] = []
        self.target = _without_original_numbers(world)
        self.conventions = None if is_converted(self.source_map) else original_conventions(world.facts)
        told = self.source_map.graph
        self.source_facts = {
            subject: {canonical_statement(fact): at for at, fact in enumerate(facts)} for subject, facts in told.items()
        }
        self.source_order = {subject: at for at, subject in enumerate(told)}

    def sections(self) -> Sequence[DocumentSection]:
        full = self._in_source_order(
            [self._in_source_dialect(block) for section in self.all_sections for block in section.blocks]
        )
        for away in (_DECLARATIONS, frozenset[Iri]()) if self.conventions else (frozenset[Iri](),):
            changed: set[Iri] = set()
            while True:
                blocks = list(self._only_changes(full, changed, away))
                found = diff(self.target, _without_original_numbers(read_world(self._source_map_of(blocks))))
                if found.identical():
                    self._add_note(changed)
                    return self._with_moved_poses(self._sections(blocks), changed)
                touched = self._changed_subjects(found, full)
                if touched <= changed:
                    break
                changed |= touched
        if self.dialect != SEMLOG_DIALECT or self.conventions:
            self.notes.append(f"what has changed cannot be said as {self.dialect} says it; SemLog's words are used")
        return self.all_sections

    # -- saying --------------------------------------------------------------------------------------------------------

    def _in_source_dialect(self, block: SubjectBlock) -> SubjectBlock:
        """All that is said of one thing, as the map says such things."""
        facts: Sequence[PropertyAssertion] = block.facts
        if self.conventions:
            facts = restore_facts(facts, self.conventions)
            if block.subject == self.world.iri:
                facts = restore_declarations(facts, self.conventions)
        told = self.source_facts.get(block.subject, {})
        return replace(block, facts=[_restore_role(fact, told) for fact in facts])

    def _in_source_order(self, blocks: Iterable[SubjectBlock]) -> list[SubjectBlock]:
        """As the map has them, what is new last: where readers take the first of several, it is the same one then."""
        last = len(self.source_order)
        return sorted(blocks, key=lambda block: self.source_order.get(block.subject, last))

    def _only_changes(
        self, blocks: Iterable[SubjectBlock], changed: Container[Iri], excluded: Container[Iri]
    ) -> Iterator[SubjectBlock]:
        """What the map itself says, and all that is to be said of what has changed."""
        for block in blocks:
            told = self.source_facts.get(block.subject, {})
            said = [(fact, canonical_statement(fact)) for fact in block.facts]
            if block.subject not in changed:
                plain = {each for _, each in said}
                otherwise = {fact.property for fact in told if fact not in plain} | _DECLARATIONS
                said = [(fact, each) for fact, each in said if each in told or fact.property in otherwise]
            said = [(fact, each) for fact, each in said if fact.property not in excluded or each in told]
            if block.subject not in changed:
                said.sort(key=lambda pair: told.get(pair[1], -1))  # what has changed counts, so it comes first
            if said:
                yield replace(block, facts=[fact for fact, _ in said])

    def _sections(self, blocks: Iterable[SubjectBlock]) -> Sequence[DocumentSection]:
        """Under the headings that they have in the whole; individuals and all else in the order of the map."""
        headings = {
            block.subject: section.heading
            for section in self.all_sections[:_DEFINITION_SECTIONS]
            for block in section.blocks
        }
        sorted_out: dict[str, list[SubjectBlock]] = {
            section.heading: [] for section in self.all_sections[:_DEFINITION_SECTIONS]
        }
        rest = sorted_out["Individuals"] = []
        for block in blocks:
            sorted_out.get(headings.get(block.subject, ""), rest).append(block)
        return [DocumentSection(heading, each) for heading, each in sorted_out.items()]

    # -- moving --------------------------------------------------------------------------------------------------------

    def _with_moved_poses(
        self, sections: Sequence[DocumentSection], changed: Container[Iri]
    ) -> Sequence[DocumentSection]:
        """The same, and where things have moved to in the words of the dialect, as it was restated before."""
        if self.dual_dialect.dialect == SOMA_DIALECT:
            return write_as_soma(self.world, sections)[0]
        moved = [body for body in self.world.bodies if body.iri in changed or body.iri in self.dual_dialect.pose_iris]
        if not moved or self.dialect not in (SOMA_DIALECT, KNOWROB1_DIALECT):
            return sections
        blocks = {block.subject: block for section in sections for block in section.blocks}
        more: list[SubjectBlock] = []
        if self.dialect == SOMA_DIALECT:
            bodies = {body.iri for body in self.world.bodies}
            places = SomaPoseWriter(blocks, blocks.keys() - bodies)
            said = [body for body in moved if places.write(body, blocks[body.iri].facts)]
        else:
            said = [body for body in moved if any(fact.property == HAS_POSE for fact in blocks[body.iri].facts)]
            for body in said:
                more += perception_blocks(body, self.source_map.graph, blocks)
        if said:
            blocks[self.world.iri].facts.append(PropertyAssertion(DIALECT, Literal(SAME_DIALECT)))
        return [*sections, DocumentSection("What Has Moved", more)]

    def _add_note(self, changed: Container[Iri]) -> None:
        if self.dialect == SEMLOG_DIALECT:
            return
        things: list[Body | Joint | Light] = [*self.world.bodies, *self.world.joints, *self.world.lights]
        count = sum(thing.iri in changed for thing in things)
        if count:
            self.notes.append(f"{count} things have changed, or are new; SemLog's words say how")

    # -- reading -------------------------------------------------------------------------------------------------------

    def _source_map_of(self, blocks: Iterable[SubjectBlock]) -> SourceMap:
        told: dict[Iri, list[PropertyAssertion]] = {}
        for block in blocks:
            told.setdefault(block.subject, []).extend(block.facts)
        graph = nest_blank_nodes(told)
        return replace(
            self.source_map,
            graph=graph,
            members=individuals_by_map(graph).get(self.source_map.map, ()),
            report=_ignore_finding,
            add_assumption=_ignore_assumption,
            conventions=UnitConventions(),
        )

    def _changed_subjects(self, diff: WorldDiff, blocks: Iterable[SubjectBlock]) -> set[Iri]:
        """The things that came out otherwise, and their parts."""
        things: Iterable[Body | Joint | Light] = chain(self.world.bodies, self.world.joints, self.world.lights)
        iris: Mapping[str, Iri] = {thing.id: thing.iri for thing in things}
        ids = {*diff.only_in_a, *diff.only_in_b, *(change.id for change in diff.changed)}
        touched = {iris.get(id, Iri(id)) for id in ids}
        parts = {
            fact.value.iri
            for block in blocks
            if block.subject in touched
            for fact in block.facts
            if fact.property in _PART_PROPERTIES and isinstance(fact.value, IriRef)
        }
        return touched | parts


def _without_original_numbers(world: World) -> World:
    """The world without the numbers that stand for those in SI: once something moves, others are given."""
    if original_conventions(world.facts) is None:
        return world
    resources = {
        resource.iri: tuple(fact for fact in resource.facts if fact.property not in _ORIGINAL_PROPERTIES)
        for resource in world.resources
    }
    empty = {resource.iri for resource in world.resources if not resources[resource.iri]}

    def plain(facts: Iterable[PropertyAssertion]) -> tuple[PropertyAssertion, ...]:
        kept = (fact for fact in facts if fact.property not in _ORIGINAL_PROPERTIES)
        return tuple(f for f in kept if not (f.property in _PART_PROPERTIES and _referenced_iri(f) in empty))

    return msgspec.structs.replace(
        world,
        bodies=tuple(msgspec.structs.replace(body, facts=plain(body.facts)) for body in world.bodies),
        joints=tuple(msgspec.structs.replace(each, facts=plain(each.facts)) for each in world.joints),
        lights=tuple(msgspec.structs.replace(light, facts=plain(light.facts)) for light in world.lights),
        resources=tuple(NamedResource(iri, facts) for iri, facts in resources.items() if facts),
    )


def _referenced_iri(fact: PropertyAssertion) -> Iri | None:
    return fact.value.iri if isinstance(fact.value, IriRef) else None


def _restore_role(fact: PropertyAssertion, source_facts: Container[PropertyAssertion]) -> PropertyAssertion:
    """What a reader has put another name on for dialect 1's sake goes under its own name again."""
    for role in (PARENT, CHILD):
        if fact.property == original_property(role) and PropertyAssertion(role, fact.value) in source_facts:
            return PropertyAssertion(role, fact.value)
    return fact


def _ignore_finding(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
    """It has been said when the map was read."""


def _ignore_assumption(assumption: Assumption) -> None:
    """The same."""
