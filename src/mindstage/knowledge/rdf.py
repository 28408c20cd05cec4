"""Graphs: what a source says, exactly, as facts by subject.

The store of pyoxigraph rounds typed numbers (177.512833 becomes 177.51283), so a map is not read from it but from
here, where every literal keeps its text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import count

import pyoxigraph as ox

from mindstage.knowledge.bulk import gc_paused
from mindstage.knowledge.vocabulary import XSD
from mindstage.world import FactValue, Iri, IriRef, Literal, PropertyAssertion

__all__ = ["Graph", "graph_from_quads", "is_generated_label", "merge_graphs"]

Graph = Mapping[Iri, Sequence[PropertyAssertion]]
"""Subjects and their facts, both in the order of the source. Things without a name have a label here (`_:x`)."""

STRING = XSD + "string"

is_generated_label = re.compile(r"_:[a-f][0-9a-f]{19,31}").fullmatch
"""Matches the labels that the parser draws by lot, for things to which the source gives not even a label."""


def graph_from_quads(quads: Iterable[ox.Quad], used_labels: set[str]) -> Graph:
    """Gathers parsed statements, each once.

    Args:
        quads: as the parser gives them.
        taken: labels that stand for something in other sources; those of this one join them.

    Raises:
        ValueError: a statement is about statements (RDF 1.2), which facts have no form for.
    """
    labels = _BlankNodeLabels(used_labels)
    graph: dict[Iri, list[PropertyAssertion]] = {}
    same: dict[str, Iri] = {}  # one string for each name, so that it is hashed and kept once
    with gc_paused():
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
                value = IriRef(same.setdefault(name, Iri(name)))
            elif not isinstance(term, ox.Literal):
                value = IriRef(labels.name(term))
            elif language := term.language:
                value = Literal(term.value, None, language)
            else:
                datatype = term.datatype.value
                plain = datatype == STRING
                value = Literal(term.value, None if plain else same.setdefault(datatype, Iri(datatype)))
            facts.append(PropertyAssertion(same.setdefault(property, Iri(property)), value))
        for facts in graph.values():
            if len(set(facts)) != len(facts):
                facts[:] = dict.fromkeys(facts)
    used_labels.update(labels.assigned.values())
    return graph


def merge_graphs(graphs: Sequence[Graph]) -> Graph:
    """What several sources say together, each statement once."""
    if len(graphs) == 1:
        return graphs[0]
    told: dict[Iri, dict[PropertyAssertion, None]] = {}
    for graph in graphs:
        for subject, facts in graph.items():
            told.setdefault(subject, {}).update(dict.fromkeys(facts))
    return {subject: list(facts) for subject, facts in told.items()}


class _BlankNodeLabels:
    """One source's labels, none of which stands for anything in another source."""

    def __init__(self, used: set[str]) -> None:
        self._used = used
        self.assigned: dict[str, Iri] = {}

    def name(self, term: object) -> Iri:
        if isinstance(term, ox.NamedNode):
            return Iri(term.value)
        if not isinstance(term, ox.BlankNode):
            raise ValueError("a statement about statements (RDF 1.2) has no place in a world")
        label = self.assigned.get(term.value)
        if label is None:
            label = self.assigned[term.value] = self._unused(Iri(f"_:{term.value}"))
        return label

    def _unused(self, label: Iri) -> Iri:
        if label not in self._used:
            return label
        return next(other for n in count(2) if (other := Iri(f"{label}-{n}")) not in self._used)
