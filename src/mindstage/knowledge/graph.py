"""Graphs: what a source says, exactly, as facts by subject.

The store of pyoxigraph rounds typed numbers (177.512833 becomes 177.51283), so a map is not read from it but from
here, where every literal keeps its text. A node without a name that only one statement mentions becomes an
`Anonymous` inside that statement; one that several mention, or none, stands as a subject under a label.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import count

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.bulk import bulk_work
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, TYPE, XSD
from mindstage.world import Anonymous, Fact, FactValue, Iri, Literal, Reference

__all__ = ["NESTING", "Graph", "graph_of", "sorted_facts"]

Graph = Mapping[Iri, list[Fact]]
"""Subjects and their facts, both in the order of the source."""

NESTING = 64
"""Levels of nodes inside nodes; those below get a label, since a list of a thousand items is a thousand levels deep."""

STRING = XSD + "string"
_DRAWN = re.compile(r"_:[a-f][0-9a-f]{19,31}")


def graph_of(quads: Iterable[ox.Quad], taken: set[str]) -> Graph:
    """Gathers parsed statements.

    Args:
        quads: as the parser gives them.
        taken: labels that stand for something in other graphs; those of this one join them.

    Raises:
        ValueError: a statement is about statements (RDF 1.2), which facts have no form for.
    """
    builder = _Builder()
    with bulk_work():
        for quad in dict.fromkeys(quads):
            builder.add(quad)
        return builder.finish(taken)


def sorted_facts(facts: Iterable[Fact]) -> tuple[Fact, ...]:
    """Facts in the one order that an `Anonymous` has them in: by property, then value."""
    return tuple(sorted(facts, key=_fact_key))


def _fact_key(fact: Fact) -> tuple[str, bytes]:
    return fact.property, msgspec.json.encode(fact.value)


class _Builder:
    """Facts by subject, and for each node without a name where it is mentioned."""

    def __init__(self) -> None:
        self.facts: dict[Iri, list[Fact]] = {}
        self.mentions: dict[Iri, list[tuple[Iri, int]]] = {}

    def add(self, quad: ox.Quad) -> None:
        subject = self._name(quad.subject)
        facts = self.facts.get(subject)
        if facts is None:
            facts = self.facts[subject] = []
        term = quad.object
        value: FactValue
        if isinstance(term, ox.Literal):
            datatype = term.datatype.value
            if term.language:
                value = Literal(term.value, None, term.language)
            else:
                value = Literal(term.value, None if datatype == STRING else Iri(datatype))
        else:
            name = self._name(term)
            value = Reference(name)
            if isinstance(term, ox.BlankNode):
                self.mentions.setdefault(name, []).append((subject, len(facts)))
        facts.append(Fact(Iri(quad.predicate.value), value))

    @staticmethod
    def _name(term: object) -> Iri:
        if isinstance(term, ox.NamedNode):
            return Iri(term.value)
        if isinstance(term, ox.BlankNode):
            return Iri("_:" + term.value)
        raise ValueError("a statement about statements (RDF 1.2) has no place in a world")

    def finish(self, taken: set[str]) -> Graph:
        for node in self._nested():
            owner, index = self.mentions.pop(node)[0]
            inner = Anonymous(sorted_facts(self.facts.pop(node, ())))
            self.facts[owner][index] = Fact(self.facts[owner][index].property, inner)
        return self._labelled(taken)

    def _nested(self) -> list[Iri]:
        """The nodes that go inside the statement that mentions them, the innermost first."""
        depths: dict[Iri, int] = {}
        for start in self.mentions:
            chain: dict[Iri, None] = {}
            node = start
            while node not in depths and node not in chain and self._may_nest(node):
                chain[node] = None
                node = self.mentions[node][0][0]
            depth = depths.get(node, 0)
            in_circle = node in chain
            for inner in reversed(chain):
                # Nodes in a circle have no innermost one: all of them keep their labels.
                depth = depths[inner] = 0 if in_circle else depth + 1
                in_circle = in_circle and inner != node
        nested = [node for node, depth in depths.items() if depth % NESTING]
        return sorted(nested, key=depths.__getitem__, reverse=True)

    def _may_nest(self, node: Iri) -> bool:
        """Whether one statement alone mentions it. Individuals of a map stay subjects whoever mentions them."""
        if len(self.mentions.get(node, ())) != 1:
            return False
        return not any(
            fact.property == DESCRIBED_IN_MAP or (fact.property == TYPE and fact.value == Reference(SEMANTIC_MAP))
            for fact in self.facts.get(node, ())
        )

    def _labelled(self, taken: set[str]) -> Graph:
        """Labels that the parser drew by lot become numbers, and no label stands for two things."""
        labels = dict.fromkeys(name for name in (*self.facts, *self.mentions) if name.startswith("_:"))
        drawn = [label for label in labels if label in taken or _DRAWN.fullmatch(label)]
        taken.update(labels.keys() - set(drawn))
        free = (Iri(f"_:b{number}") for number in count(1) if f"_:b{number}" not in taken)
        renamed = dict(zip(drawn, free, strict=False))
        taken.update(renamed.values())
        if not renamed:
            return self.facts
        return {
            renamed.get(subject, subject): [_renamed(fact, renamed) for fact in facts]
            for subject, facts in self.facts.items()
        }


def _renamed(fact: Fact, names: Mapping[Iri, Iri]) -> Fact:
    value = fact.value
    if isinstance(value, Reference) and value.iri in names:
        return Fact(fact.property, Reference(names[value.iri]))
    if isinstance(value, Anonymous):
        return Fact(fact.property, Anonymous(sorted_facts(_renamed(inner, names) for inner in value.facts)))
    return fact
