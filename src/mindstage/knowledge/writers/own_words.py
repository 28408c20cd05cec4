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

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.reading.assumptions import Assumption
from mindstage.knowledge.reading.census import census_of
from mindstage.knowledge.reading.conventions import Conventions
from mindstage.knowledge.reading.conversion import (
    CONVERTED,
    declared,
    given,
    given_conventions,
    is_converted,
    unconverted,
)
from mindstage.knowledge.reading.dialects import read_world
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.losses import plainly
from mindstage.knowledge.reading.origin import Origin
from mindstage.knowledge.reading.restating import SAME, restated_by, restored
from mindstage.knowledge.vocabulary import CHILD, DIALECT, FRAME, HAS_POSE, PARENT, QUATERNION_ORDER, UNITS
from mindstage.knowledge.wording.blocks import Block, Section
from mindstage.knowledge.wording.nesting import nested
from mindstage.knowledge.wording.parts import PARTS
from mindstage.knowledge.writers.knowrob1 import KNOWROB1_DIALECT, perception_blocks
from mindstage.knowledge.writers.soma import SOMA_DIALECT, Places, in_soma
from mindstage.world import (
    Body,
    Constraint,
    Difference,
    Fact,
    Iri,
    Light,
    Literal,
    Reference,
    Resource,
    World,
    difference,
)

__all__ = ["in_own_words"]

SEMLOG_DIALECT = "SemLog"
_DEFINITIONS = 3
"""Sections of ontologies, properties and classes, which stand first."""
_PART_PROPERTIES = frozenset(part.property for part in PARTS)
_GIVEN = frozenset(map(given, CONVERTED))
_DECLARATIONS = frozenset({UNITS, FRAME, QUATERNION_ORDER})


def in_own_words(world: World, whole: Sequence[Section], origin: Origin) -> tuple[Sequence[Section], tuple[str, ...]]:
    """The sections of a map that says the same as its origin where the world is still the same.

    With them comes what could not be said in the map's own words.

    Args:
        world: as it is now.
        whole: all of it in the words of dialect 1.
        origin: the map that it came from.
    """
    writing = _Writing(world, whole, origin)
    return writing.sections(), tuple(writing.notes)


class _Writing:
    def __init__(self, world: World, whole: Sequence[Section], origin: Origin) -> None:
        self.world, self.whole, self.dialect = world, whole, origin.dialect
        self.excerpt = restored(origin.excerpt)
        self.restated = restated_by(origin.excerpt)
        self.notes: list[str] = []
        self.now = _without_given(world)
        self.conventions = None if is_converted(self.excerpt) else given_conventions(world.facts)
        told = self.excerpt.graph
        self.told = {subject: {plainly(fact): at for at, fact in enumerate(facts)} for subject, facts in told.items()}
        self.places = {subject: at for at, subject in enumerate(told)}

    def sections(self) -> Sequence[Section]:
        full = self._in_order([self._said(block) for section in self.whole for block in section.blocks])
        for away in (_DECLARATIONS, frozenset[Iri]()) if self.conventions else (frozenset[Iri](),):
            changed: set[Iri] = set()
            while True:
                blocks = list(self._reduced(full, changed, away))
                found = difference(self.now, _without_given(read_world(self._excerpt(blocks))))
                if found.identical():
                    self._note(changed)
                    return self._restated(self._sections(blocks), changed)
                touched = self._touched(found, full)
                if touched <= changed:
                    break
                changed |= touched
        if self.dialect != SEMLOG_DIALECT or self.conventions:
            self.notes.append(f"what has changed cannot be said as {self.dialect} says it; SemLog's words are used")
        return self.whole

    # -- saying --------------------------------------------------------------------------------------------------------

    def _said(self, block: Block) -> Block:
        """All that is said of one thing, as the map says such things."""
        facts: Sequence[Fact] = block.facts
        if self.conventions:
            facts = unconverted(facts, self.conventions)
            if block.subject == self.world.iri:
                facts = declared(facts, self.conventions)
        told = self.told.get(block.subject, {})
        return replace(block, facts=[_renamed(fact, told) for fact in facts])

    def _in_order(self, blocks: Iterable[Block]) -> list[Block]:
        """As the map has them, what is new last: where readers take the first of several, it is the same one then."""
        last = len(self.places)
        return sorted(blocks, key=lambda block: self.places.get(block.subject, last))

    def _reduced(self, full: Iterable[Block], changed: Container[Iri], away: Container[Iri]) -> Iterator[Block]:
        """What the map itself says, and all that is to be said of what has changed."""
        for block in full:
            told = self.told.get(block.subject, {})
            said = [(fact, plainly(fact)) for fact in block.facts]
            if block.subject not in changed:
                plain = {each for _, each in said}
                otherwise = {fact.property for fact in told if fact not in plain} | _DECLARATIONS
                said = [(fact, each) for fact, each in said if each in told or fact.property in otherwise]
            said = [(fact, each) for fact, each in said if fact.property not in away or each in told]
            if block.subject not in changed:
                said.sort(key=lambda pair: told.get(pair[1], -1))  # what has changed counts, so it comes first
            if said:
                yield replace(block, facts=[fact for fact, _ in said])

    def _sections(self, blocks: Iterable[Block]) -> Sequence[Section]:
        """Under the headings that they have in the whole; individuals and all else in the order of the map."""
        headings = {block.subject: section.heading for section in self.whole[:_DEFINITIONS] for block in section.blocks}
        sorted_out: dict[str, list[Block]] = {section.heading: [] for section in self.whole[:_DEFINITIONS]}
        rest = sorted_out["Individuals"] = []
        for block in blocks:
            sorted_out.get(headings.get(block.subject, ""), rest).append(block)
        return [Section(heading, each) for heading, each in sorted_out.items()]

    # -- moving --------------------------------------------------------------------------------------------------------

    def _restated(self, sections: Sequence[Section], changed: Container[Iri]) -> Sequence[Section]:
        """The same, and where things have moved to in the words of the dialect, as it was restated before."""
        if self.restated.dialect == SOMA_DIALECT:
            return in_soma(self.world, sections)[0]
        moved = [body for body in self.world.bodies if body.iri in changed or body.iri in self.restated.places]
        if not moved or self.dialect not in (SOMA_DIALECT, KNOWROB1_DIALECT):
            return sections
        blocks = {block.subject: block for section in sections for block in section.blocks}
        more: list[Block] = []
        if self.dialect == SOMA_DIALECT:
            bodies = {body.iri for body in self.world.bodies}
            places = Places(blocks, blocks.keys() - bodies)
            said = [body for body in moved if places.say(body, blocks[body.iri].facts)]
        else:
            said = [body for body in moved if any(fact.property == HAS_POSE for fact in blocks[body.iri].facts)]
            for body in said:
                more += perception_blocks(body, self.excerpt.graph, blocks)
        if said:
            blocks[self.world.iri].facts.append(Fact(DIALECT, Literal(SAME)))
        return [*sections, Section("What Has Moved", more)]

    def _note(self, changed: Container[Iri]) -> None:
        if self.dialect == SEMLOG_DIALECT:
            return
        things: list[Body | Constraint | Light] = [*self.world.bodies, *self.world.constraints, *self.world.lights]
        count = sum(thing.iri in changed for thing in things)
        if count:
            self.notes.append(f"{count} things have changed, or are new; SemLog's words say how")

    # -- reading -------------------------------------------------------------------------------------------------------

    def _excerpt(self, blocks: Iterable[Block]) -> Excerpt:
        told: dict[Iri, list[Fact]] = {}
        for block in blocks:
            told.setdefault(block.subject, []).extend(block.facts)
        graph = nested(told)
        return replace(
            self.excerpt,
            graph=graph,
            members=census_of(graph).get(self.excerpt.map, ()),
            report=_silent,
            keep_assumption=_unheard,
            conventions=Conventions(),
        )

    def _touched(self, found: Difference, full: Iterable[Block]) -> set[Iri]:
        """The things that came out otherwise, and their parts."""
        things: Iterable[Body | Constraint | Light] = chain(
            self.world.bodies, self.world.constraints, self.world.lights
        )
        iris: Mapping[str, Iri] = {thing.id: thing.iri for thing in things}
        ids = {*found.only_in_a, *found.only_in_b, *(change.id for change in found.changed)}
        touched = {iris.get(id, Iri(id)) for id in ids}
        parts = {
            fact.value.iri
            for block in full
            if block.subject in touched
            for fact in block.facts
            if fact.property in _PART_PROPERTIES and isinstance(fact.value, Reference)
        }
        return touched | parts


def _without_given(world: World) -> World:
    """The world without the numbers that stand for those in SI: once something moves, others are given."""
    if given_conventions(world.facts) is None:
        return world
    resources = {
        resource.iri: tuple(fact for fact in resource.facts if fact.property not in _GIVEN)
        for resource in world.resources
    }
    empty = {resource.iri for resource in world.resources if not resources[resource.iri]}

    def plain(facts: Iterable[Fact]) -> tuple[Fact, ...]:
        kept = (fact for fact in facts if fact.property not in _GIVEN)
        return tuple(f for f in kept if not (f.property in _PART_PROPERTIES and _names(f) in empty))

    return msgspec.structs.replace(
        world,
        bodies=tuple(msgspec.structs.replace(body, facts=plain(body.facts)) for body in world.bodies),
        constraints=tuple(msgspec.structs.replace(each, facts=plain(each.facts)) for each in world.constraints),
        lights=tuple(msgspec.structs.replace(light, facts=plain(light.facts)) for light in world.lights),
        resources=tuple(Resource(iri, facts) for iri, facts in resources.items() if facts),
    )


def _names(fact: Fact) -> Iri | None:
    return fact.value.iri if isinstance(fact.value, Reference) else None


def _renamed(fact: Fact, told: Container[Fact]) -> Fact:
    """What a reader has put another name on for dialect 1's sake goes under its own name again."""
    for role in (PARENT, CHILD):
        if fact.property == given(role) and Fact(role, fact.value) in told:
            return Fact(role, fact.value)
    return fact


def _silent(severity: Severity, individual: str, property: str, what: str, did: str) -> None:
    """It has been said when the map was read."""


def _unheard(assumption: Assumption) -> None:
    """The same."""
