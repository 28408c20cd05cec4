"""Losses: what a map's sources say and a written file does not, statement by statement.

Two graphs are held against each other as worlds are, one level below: by what they state. Numbers count by their
value, things without a name by what is said about them. What a writer names itself (poses, limits) is taken as part of
the thing that it belongs to.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence

from mindstage.knowledge.bulk import bulk_work
from mindstage.knowledge.graph import Graph, united
from mindstage.knowledge.names import is_part_name
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.conversion import given
from mindstage.knowledge.reading.origin import Origin
from mindstage.knowledge.reading.restating import SIX_POSE, restored
from mindstage.knowledge.vocabulary import CHILD, PARENT
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.parts import PARTS
from mindstage.knowledge.wording.words import Word
from mindstage.world import Anonymous, Fact, Iri, Reference, Resource, Statement, World, difference

__all__ = ["lost_statements", "plainly"]

_RENAMED = {given(role): role for role in (PARENT, CHILD)}
_PARTS = {part.property: part for part in PARTS}
_BY_VALUE: Mapping[Iri, Word[object]] = {
    word.property: word
    for each in vars(words).values()
    for word in (each if isinstance(each, tuple) else (each,))
    if isinstance(word, Word) and word.by_value
}


def lost_statements(before: Origin, after: Origin, *, moved: Container[Iri] = ()) -> tuple[Statement, ...]:
    """The statements of one map that another one, written from it, does not make.

    Takes a time that grows with the number of statements. What the second one says beyond the first is no loss, and
    what it says in other words is none if it says which: numbers that it keeps from before they were converted, and
    places that stand where another dialect has them.

    Args:
        before: the map.
        after: what was written and read again.
        moved: things that are somewhere else by now; numbers about them, and about their parts, may differ.
    """
    with bulk_work():
        told = _as_resources(before, before.excerpt.graph)
        said = _as_resources(after, _in_all_words(after), parts_too=True)
        lost = difference(told, said).lost
    parts = {
        fact.value.iri
        for subject, facts in before.excerpt.graph.items()
        if subject in moved
        for fact in facts
        if fact.property in _PARTS and isinstance(fact.value, Reference)
    }
    return tuple(each for each in lost if not ((each.id in moved or each.id in parts) and _is_number(each)))


def _is_number(statement: Statement) -> bool:
    return isinstance(statement.said, Fact) and statement.said.property.split()[-1] in _BY_VALUE


def plainly(fact: Fact) -> Fact:
    """The statement as we would write it, if it says a number."""
    word = _BY_VALUE.get(fact.property)
    if word is None:
        return fact
    value = word.understand(fact.value)
    return fact if value is None or not word.repeats(value, fact.value) else Fact(fact.property, word.say(value))


def _in_all_words(origin: Origin) -> Graph:
    """What a map says, in its own words and in those that it says they stand for."""
    plain = Origin(restored(origin.excerpt))
    graphs = [origin.excerpt.graph, plain.excerpt.graph]
    if (before := plain.given()) is not None:
        graphs.append({subject: [_as_given(fact) for fact in facts] for subject, facts in before.excerpt.graph.items()})
    return united(graphs)


def _as_given(fact: Fact) -> Fact:
    """A relation that a reader has put another name on, under its own one."""
    return Fact(_RENAMED.get(fact.property, fact.property), fact.value)


def _as_resources(origin: Origin, graph: Graph, *, parts_too: bool = False) -> World:
    """The statements of a graph by what they are about: parts count as their wholes, or as both."""
    members = frozenset(origin.excerpt.members)
    parts = {
        fact.value.iri
        for subject, facts in graph.items()
        for fact in facts
        if isinstance(fact.value, Reference) and _is_own_part(subject, fact, graph) and fact.value.iri not in members
    }
    told = (
        (subject, tuple(dict.fromkeys(_told(facts, parts, graph))))
        for subject, facts in graph.items()
        if parts_too or subject not in parts
    )
    return World(iri=origin.map, resources=tuple(Resource(subject, facts) for subject, facts in told))


def _is_own_part(subject: Iri, fact: Fact, graph: Graph) -> bool:
    """Whether a writer may have given this part its name."""
    part = _PARTS.get(fact.property)
    if part is None or not isinstance(fact.value, Reference):
        return False
    facts = graph.get(fact.value.iri, ())
    return is_part_name(fact.value.iri, subject, part.suffix) and {part.cls, SIX_POSE}.issuperset(types_of(facts))


def _told(facts: Sequence[Fact], parts: Container[Iri], graph: Graph) -> Iterator[Fact]:
    """What is said about a thing, and of its parts, each under the names of both."""
    for fact in facts:
        value = fact.value
        inner: Sequence[Fact] | None = None
        if fact.property in _PARTS:
            if isinstance(value, Anonymous):
                inner = value.facts
            elif isinstance(value, Reference) and value.iri in parts:
                inner = graph[value.iri]
        if inner is None:
            yield plainly(fact)
        else:
            yield from (Fact(Iri(f"{fact.property} {each.property}"), plainly(each).value) for each in inner)
