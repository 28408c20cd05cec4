"""Graphs: what a source says, exactly, as facts by subject.

The store of pyoxigraph rounds typed numbers (177.512833 becomes 177.51283), so a map is not read from it but from
here, where every literal keeps its text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import count

import pyoxigraph as ox

from mindstage.knowledge.bulk import bulk_work
from mindstage.knowledge.vocabulary import XSD
from mindstage.world import Fact, FactValue, Iri, Literal, Reference

__all__ = ["Graph", "drawn", "graph_of", "united"]

Graph = Mapping[Iri, Sequence[Fact]]
"""Subjects and their facts, both in the order of the source. Things without a name have a label here (`_:x`)."""

STRING = XSD + "string"

drawn = re.compile(r"_:[a-f][0-9a-f]{19,31}").fullmatch
"""Matches the labels that the parser draws by lot, for things to which the source gives not even a label."""


def graph_of(quads: Iterable[ox.Quad], taken: set[str]) -> Graph:
    """Gathers parsed statements, each once.

    Args:
        quads: as the parser gives them.
        taken: labels that stand for something in other sources; those of this one join them.

    Raises:
        ValueError: a statement is about statements (RDF 1.2), which facts have no form for.
    """
    labels = _Labels(taken)
    graph: dict[Iri, list[Fact]] = {}
    same: dict[str, Iri] = {}  # one string for each name, so that it is hashed and kept once
    with bulk_work():
        for quad in quads:
            node = quad.subject
            subject = Iri(node.value) if isinstance(node, ox.NamedNode) else labels.name(node)
            facts = graph.get(subject)
            if facts is None:
                facts = graph[subject] = []
            property = quad.predicate.value
            term = quad.object
            value: FactValue
            if isinstance(term, ox.NamedNode):
                name = term.value
                value = Reference(same.setdefault(name, Iri(name)))
            elif not isinstance(term, ox.Literal):
                value = Reference(labels.name(term))
            elif language := term.language:
                value = Literal(term.value, None, language)
            else:
                datatype = term.datatype.value
                plain = datatype == STRING
                value = Literal(term.value, None if plain else same.setdefault(datatype, Iri(datatype)))
            facts.append(Fact(same.setdefault(property, Iri(property)), value))
        for facts in graph.values():
            if len(set(facts)) != len(facts):
                facts[:] = dict.fromkeys(facts)
    taken.update(labels.own.values())
    return graph


def united(graphs: Sequence[Graph]) -> Graph:
    """What several sources say together, each statement once."""
    if len(graphs) == 1:
        return graphs[0]
    told: dict[Iri, dict[Fact, None]] = {}
    for graph in graphs:
        for subject, facts in graph.items():
            told.setdefault(subject, {}).update(dict.fromkeys(facts))
    return {subject: list(facts) for subject, facts in told.items()}


class _Labels:
    """One source's labels, none of which stands for anything in another source."""

    def __init__(self, taken: set[str]) -> None:
        self._taken = taken
        self.own: dict[str, Iri] = {}

    def name(self, term: object) -> Iri:
        if isinstance(term, ox.NamedNode):
            return Iri(term.value)
        if not isinstance(term, ox.BlankNode):
            raise ValueError("a statement about statements (RDF 1.2) has no place in a world")
        label = self.own.get(term.value)
        if label is None:
            label = self.own[term.value] = self._free(Iri(f"_:{term.value}"))
        return label

    def _free(self, label: Iri) -> Iri:
        if label not in self._taken:
            return label
        return next(other for n in count(2) if (other := Iri(f"{label}-{n}")) not in self._taken)
