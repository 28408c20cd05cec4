"""Writing of a world in the dialect of the map that it was read from.

Statements of the source map are written unchanged, to the spelling of each number, and nothing is added, as long as
reading them gives the same world. For what has changed, as many statements are added as reading requires, which is
found by trial. If no such statements exist, as after a part was detached that the map states to be attached, the world
is written in the vocabulary of dialect 1.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Any

import msgspec

from mindstage.maps.dialects.conventions import Assumption, UnitConventions
from mindstage.maps.dialects.detection import read_world
from mindstage.maps.dialects.knowrob1 import KNOWROB1_DIALECT, PerceivedPoses, perception_blocks
from mindstage.maps.dialects.membership import individuals_by_map, is_membership, types_of
from mindstage.maps.dialects.serialize import DocumentSection, SubjectBlock
from mindstage.maps.dialects.soma_export import SOMA_DIALECT, SomaPoseWriter, write_as_soma
from mindstage.maps.dialects.soma_nodes import SAME_DIALECT, dual_dialect_info, without_restatements
from mindstage.maps.dialects.source_map import SourceMap, ignore_finding
from mindstage.maps.dialects.unit_conversion import (
    CONVERTED_PROPERTIES,
    is_converted,
    original_conventions,
    original_property,
    restore_declarations,
    restore_facts,
    restore_size_declaration,
)
from mindstage.maps.io.graph_diff import SourceMapView, canonical_statement
from mindstage.maps.rdf_mapping.fields import ClassGeometry
from mindstage.maps.rdf_mapping.nested import NESTED_RESOURCES, nest_blank_nodes
from mindstage.maps.rdf_mapping.properties import MESH, SIZE, PropertyCodec
from mindstage.rdf.vocabulary import (
    CHILD,
    DIALECT,
    FRAME,
    GIVEN_SIZES,
    HAS_POSE,
    PARENT,
    PIVOT,
    QUATERNION_ORDER,
    SIZES,
    UNITS,
)
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
"""Number of leading sections: ontologies, properties and classes."""
_PART_PROPERTIES = frozenset(part.property for part in NESTED_RESOURCES)
_ORIGINAL_PROPERTIES = frozenset(map(original_property, CONVERTED_PROPERTIES))
_DECLARATIONS = frozenset({UNITS, FRAME, QUATERNION_ORDER, SIZES, GIVEN_SIZES, PIVOT})


def write_in_source_dialect(
    world: World, all_sections: Sequence[DocumentSection], source_view: SourceMapView
) -> tuple[Sequence[DocumentSection], tuple[str, ...]]:
    """Rewrites the sections of a map in the dialect of its source.

    Args:
        all_sections: its complete description in the vocabulary of dialect 1.
        source_view: the map that the world was read from.

    Returns:
        The sections, and sentences about what the source's dialect cannot express.
    """
    writer = _SourceDialectWriter(world, all_sections, source_view)
    return writer.sections(), tuple(writer.notes)


class _SourceDialectWriter:
    def __init__(self, world: World, all_sections: Sequence[DocumentSection], source_view: SourceMapView) -> None:
        self.world, self.all_sections, self.dialect = world, all_sections, source_view.dialect
        self.original_map = source_view.source_map
        self.source_map = without_restatements(self.original_map)
        self.dual_dialect = dual_dialect_info(self.original_map)
        self.notes: list[str] = []
        self.target = _without_original_numbers(world)
        self.conventions = None if is_converted(self.source_map) else original_conventions(world.facts)
        self.has_boxes = _has_inferred_boxes(all_sections)
        self.source_world = source_view.world
        self.source_order = {subject: at for at, subject in enumerate(self.source_map.graph)}
        self._statements: dict[Iri, dict[PropertyAssertion, list[PropertyAssertion]]] = {}

    def sections(self) -> Sequence[DocumentSection]:
        if self._differs_from(self._source_world()).identical():
            return self._sections(self._unchanged_blocks())
        all_blocks = [block for section in self.all_sections for block in section.blocks]
        # First without declarations, then with them, then with the boxes that were inferred instead of their evidence.
        attempts = [(_DECLARATIONS, True), (frozenset({PIVOT}), True), (frozenset[Iri](), False)]
        for excluded, as_given in attempts if self.conventions or self.has_boxes else attempts[1:2]:
            full = self._in_source_order([self._in_source_dialect(block, as_given=as_given) for block in all_blocks])
            # Values of a touched subject are replaced. If that is not enough, everything about it is stated.
            replaced, restated = set[Iri](), set[Iri]()
            touched = set[Iri]()
            while True:
                restated |= touched & replaced
                replaced |= touched
                blocks = list(self._only_changes(full, replaced, restated, excluded))
                difference = self._differs_from(read_world(self._source_map_of(blocks)))
                if difference.identical():
                    self._add_note(restated)
                    return self._with_moved_poses(self._sections(blocks), restated)
                touched = self._changed_subjects(difference, full)
                if touched <= restated:
                    break
        if self.dialect != SEMLOG_DIALECT or self.conventions:
            self.notes.append(f"{self.dialect} cannot express the changes; SemLog's vocabulary is used")
        return self.all_sections

    # -- writing -------------------------------------------------------------------------------------------------------

    def _unchanged_blocks(self) -> Iterator[SubjectBlock]:
        """Yields the statements of the source as they are, without those that reading them implies."""
        implied = self.original_map.implied_members
        for subject, facts in self.original_map.graph.items():
            if subject in implied:
                facts = [fact for fact in facts if not is_membership(fact, self.original_map.map)]
            if facts:
                yield SubjectBlock(subject, list(facts), self._comments.get(subject, ""))

    @cached_property
    def _comments(self) -> Mapping[Iri, str]:
        return {block.subject: block.comment for section in self.all_sections for block in section.blocks}

    def _source_facts(self, subject: Iri) -> Mapping[PropertyAssertion, Sequence[PropertyAssertion]]:
        """The statements of the source about a subject, by their canonical form."""
        found = self._statements.get(subject)
        if found is None:
            found = self._statements[subject] = {}
            for fact in self.source_map.graph.get(subject, ()):
                found.setdefault(canonical_statement(fact), []).append(fact)
        return found

    @cached_property
    def _ontology_values(self) -> Mapping[Iri, frozenset[PropertyAssertion]]:
        """By body, the sizes and meshes that ontologies give for its classes, which are not written with it."""
        if not self.source_map.ontologies:
            return {}
        geometry = ClassGeometry(self.source_map.ontologies, self.source_map.hierarchy, ignore_finding)
        found = {}
        for body in self.world.bodies:
            classes = (body.cls, *(cls for cls in types_of(body.facts) if cls != body.cls))
            given: tuple[tuple[PropertyCodec[Any], object], ...]
            given = (*zip(SIZE, geometry.get(classes), strict=True), (MESH, geometry.mesh(classes)))
            found[body.iri] = frozenset(
                PropertyAssertion(codec.property, codec.encode(value)) for codec, value in given if value is not None
            )
        return found

    def _in_source_dialect(self, block: SubjectBlock, *, as_given: bool) -> SubjectBlock:
        """Restores the original numbers and properties of a block; without `as_given`, sizes are not inferred again."""
        source_facts = self._source_facts(block.subject)
        of_class = self._ontology_values.get(block.subject, frozenset())
        facts: Sequence[PropertyAssertion] = [
            fact for fact in block.facts if fact not in of_class or fact in source_facts
        ]
        boxes = [fact for fact in facts if fact.property == GIVEN_SIZES and fact not in source_facts]
        if self.conventions:
            facts = restore_facts(facts, self.conventions)
            if block.subject == self.world.iri:
                facts = restore_declarations(facts, self.conventions)
        if boxes:
            facts = restore_size_declaration(facts)
            if not as_given:
                facts = [*(fact for fact in facts if fact.property != SIZES), *boxes]
        return replace(block, facts=list(facts))

    def _in_source_order(self, blocks: Iterable[SubjectBlock]) -> list[SubjectBlock]:
        """Sorts blocks as in the source map, new ones last, since readers use the first of several values."""
        last = len(self.source_order)
        return sorted(blocks, key=lambda block: self.source_order.get(block.subject, last))

    def _only_changes(
        self,
        blocks: Iterable[SubjectBlock],
        replaced: Container[Iri],
        restated: Container[Iri],
        excluded: Container[Iri],
    ) -> Iterator[SubjectBlock]:
        """Yields the statements of the source as they are, and those that have changed.

        Args:
            blocks: the complete description of the world.
            replaced: subjects of which some properties have other values than in the source.
            restated: subjects of which everything is stated.
            excluded: properties of which only statements of the source are written.
        """
        for block in blocks:
            spelled = self._source_facts(block.subject)
            # Where everything is stated, a reader renames nothing, so renamed properties stay as they are.
            source: Container[PropertyAssertion] = () if block.subject in restated else spelled
            statements = [(each, canonical_statement(each)) for each in (_restore_role(f, source) for f in block.facts)]
            if block.subject not in restated:
                written = {each for _, each in statements}
                changed = set(_DECLARATIONS)
                if block.subject in replaced:
                    changed |= {each.property for each in spelled if each not in written}
                statements = [
                    (fact, each) for fact, each in statements if each not in spelled and fact.property in changed
                ]  # changed values first, to take precedence
                if block.subject in replaced:
                    statements += [(fact, fact) for fact in spelled if fact in written]
                else:
                    statements += [(fact, fact) for fact in spelled]
            facts = [
                each
                for fact, canonical in statements
                if fact.property not in excluded or canonical in spelled
                for each in spelled.get(canonical, (fact,))
            ]
            if facts:
                yield replace(block, facts=list(dict.fromkeys(facts)))

    def _sections(self, blocks: Iterable[SubjectBlock]) -> Sequence[DocumentSection]:
        """Groups blocks under the headings of their definitions; all other blocks become individuals."""
        headings = {
            block.subject: section.heading
            for section in self.all_sections[:_DEFINITION_SECTIONS]
            for block in section.blocks
        }
        by_heading: dict[str, list[SubjectBlock]] = {
            section.heading: [] for section in self.all_sections[:_DEFINITION_SECTIONS]
        }
        rest = by_heading["Individuals"] = []
        for block in blocks:
            by_heading.get(headings.get(block.subject, ""), rest).append(block)
        return [DocumentSection(heading, each) for heading, each in by_heading.items()]

    # -- changed poses -------------------------------------------------------------------------------------------------

    def _with_moved_poses(
        self, sections: Sequence[DocumentSection], changed: Container[Iri]
    ) -> Sequence[DocumentSection]:
        """Adds changed poses in the vocabulary of the dialect, as restatements."""
        if self.dual_dialect.dialect == SOMA_DIALECT:
            return write_as_soma(self.world, sections)[0]
        moved = [body for body in self.world.bodies if body.iri in changed or body.iri in self.dual_dialect.pose_iris]
        if not moved or self.dialect not in (SOMA_DIALECT, KNOWROB1_DIALECT):
            return sections
        blocks = {block.subject: block for section in sections for block in section.blocks}
        added: list[SubjectBlock] = []
        if self.dialect == SOMA_DIALECT:
            bodies = {body.iri for body in self.world.bodies}
            poses = SomaPoseWriter(blocks, blocks.keys() - bodies)
            written = [body for body in moved if poses.write(body, blocks[body.iri].facts)]
        else:
            written = [body for body in moved if any(fact.property == HAS_POSE for fact in blocks[body.iri].facts)]
            perceived = PerceivedPoses(self.source_map.graph)
            for body in written:
                added += perception_blocks(body, perceived, blocks)
        if written:
            blocks[self.world.iri].facts.append(PropertyAssertion(DIALECT, Literal(SAME_DIALECT)))
        return [*sections, DocumentSection("What Has Moved", added)]

    def _add_note(self, changed: Container[Iri]) -> None:
        if self.dialect == SEMLOG_DIALECT:
            return
        individuals: list[Body | Joint | Light] = [*self.world.bodies, *self.world.joints, *self.world.lights]
        count = sum(each.iri in changed for each in individuals)
        if count:
            self.notes.append(f"{count} individuals have changed, or are new; SemLog's vocabulary is used for them")

    # -- reading -------------------------------------------------------------------------------------------------------

    def _source_map_of(self, blocks: Iterable[SubjectBlock]) -> SourceMap:
        facts_by_subject: dict[Iri, list[PropertyAssertion]] = {}
        for block in blocks:
            facts_by_subject.setdefault(block.subject, []).extend(block.facts)
        graph = nest_blank_nodes(facts_by_subject)
        return replace(
            self.source_map,
            graph=graph,
            members=individuals_by_map(graph).get(self.source_map.map, ()),
            report=ignore_finding,
            add_assumption=_ignore_assumption,
            conventions=UnitConventions(),
            mesh_bounds=None,  # others may read the file without the meshes
        )

    def _source_world(self) -> World:
        if self.source_world is not None:
            return self.source_world
        graph = self.source_map.graph
        return read_world(self._source_map_of(SubjectBlock(subject, list(facts)) for subject, facts in graph.items()))

    def _differs_from(self, other: World) -> WorldDiff:
        return diff(self.target, _without_original_numbers(other))

    def _changed_subjects(self, diff: WorldDiff, blocks: Iterable[SubjectBlock]) -> set[Iri]:
        """Returns the individuals that differ, and their nested resources."""
        individuals: Iterable[Body | Joint | Light] = chain(self.world.bodies, self.world.joints, self.world.lights)
        iris: Mapping[str, Iri] = {each.id: each.iri for each in individuals}
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


def _has_inferred_boxes(sections: Iterable[DocumentSection]) -> bool:
    """Whether a reader infers boxes of bodies from the statements of the source."""
    return any(
        fact.property in (GIVEN_SIZES, PIVOT)
        for section in sections
        for block in section.blocks
        for fact in block.facts
    )


def _without_original_numbers(world: World) -> World:
    """Returns the world without the numbers of its source, which do not apply to values that have changed."""
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
    """Restores a property that a reader has renamed to `original_property`."""
    for role in (PARENT, CHILD):
        if fact.property == original_property(role) and PropertyAssertion(role, fact.value) in source_facts:
            return PropertyAssertion(role, fact.value)
    return fact


def _ignore_assumption(assumption: Assumption) -> None:
    """Discards assumptions: they were reported when the map was read."""
