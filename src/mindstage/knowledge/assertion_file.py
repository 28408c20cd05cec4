"""Triples: single statements, as RDF's own tools see them: found, told and taken back without being understood.

Questions say more, and `tell` knows what a statement about a class means; this is for those who speak RDF.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.reasoning.expressions import node_label
from mindstage.knowledge.reasoning.properties import node_from_label
from mindstage.knowledge.stores.sparql import RdfTerm, term_from_node
from mindstage.knowledge.teaching import RUNTIME_GRAPH
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.base import KnowledgeBase

__all__ = ["Triple", "TripleStoreView"]

Node = ox.NamedNode | ox.BlankNode


class Triple(NamedTuple):
    """One statement; what has no name is called `_:label`."""

    subject: Iri
    property: Iri
    value: RdfTerm


class TripleStoreView:
    """Everything that a knowledge base was told, statement by statement."""

    def __init__(self, knowledge: KnowledgeBase) -> None:
        self._knowledge = knowledge
        self._store = knowledge._store

    def find(
        self, subject: str | None = None, property: str | None = None, value: RdfTerm | None = None
    ) -> Iterator[Triple]:
        """Statements as they were told, each once; None leaves an end open.

        Raises:
            InvalidArgumentError: one of them is no name.
        """
        seen = set()
        for quad in self._quads(subject, property, value):
            about = node_label(quad.subject) or Iri(str(quad.subject))
            triple = Triple(about, Iri(quad.predicate.value), term_from_node(quad.object))
            if triple not in seen:
                seen.add(triple)
                yield triple

    def find_entailed(
        self, subject: str | None = None, property: str | None = None, value: RdfTerm | None = None
    ) -> Iterator[Triple]:
        """Statements of a property, and of those that imply it or its inverse.

        Raises:
            InvalidArgumentError: one of them is no name.
        """
        if property is None:
            yield from self.find(subject, None, value)
            return
        found: dict[Triple, None] = {}
        for node, forward in self._knowledge.reasoner.properties.used_expressions(Iri(property)):
            if forward:
                told = self.find(subject, node.value, value)
                found |= {Triple(one, Iri(property), other): None for one, _, other in told}
            elif value is None or value.kind != "literal":
                start = None if value is None else _resource_text(value)
                told = self.find(start, node.value, None if subject is None else _resource_term(subject))
                found |= {
                    Triple(Iri(_resource_text(other)), Iri(property), _resource_term(one)): None
                    for one, _, other in told
                    if other.kind != "literal"
                }
        yield from found

    def add(self, subject: str, property: str, value: RdfTerm) -> None:
        """Tells a statement, whatever it may mean; the next question knows it.

        Raises:
            InvalidArgumentError: one of them is no name.
        """
        quad = ox.Quad(_node(subject), _property(property), _object(value), RUNTIME_GRAPH)
        with self._knowledge.lock:
            self._store.add(quad)
            self._knowledge._invalidate([quad])

    def remove(self, subject: str | None = None, property: str | None = None, value: RdfTerm | None = None) -> int:
        """Takes statements back, whoever told them, and says how many.

        Raises:
            InvalidArgumentError: one of them is no name.
        """
        with self._knowledge.lock:
            quads = list(self._quads(subject, property, value))
            for quad in quads:
                self._store.remove(quad)
            if quads:
                self._knowledge._invalidate(quads)
                self._knowledge.forget_derived()
        return len(quads)

    def _quads(self, subject: str | None, property: str | None, value: RdfTerm | None) -> Iterator[ox.Quad]:
        about = None if subject is None else _node(subject)
        link = None if property is None else _property(property)
        yield from self._store.quads_for_pattern(about, link, None if value is None else _object(value))


def _resource_term(name: str) -> RdfTerm:
    return RdfTerm("blank", name[2:]) if name.startswith("_:") else RdfTerm("iri", name)


def _resource_text(term: RdfTerm) -> str:
    return f"_:{term.value}" if term.kind == "blank" else term.value


def _property(name: str) -> ox.NamedNode:
    node = _node(name)
    if isinstance(node, ox.BlankNode):
        raise InvalidArgumentError(name, cause="a property has a name")
    return node


def _node(name: str) -> Node:
    try:
        return node_from_label(Iri(name))
    except ValueError as error:
        raise InvalidArgumentError(f"<{name}>", cause=str(error), remedy="give it whole, or with a prefix") from error


def _object(value: RdfTerm) -> Node | ox.Literal:
    if value.kind != "literal":
        return _node(_resource_text(value))
    try:
        datatype = ox.NamedNode(value.datatype) if value.datatype and not value.language else None
        return ox.Literal(value.value, datatype=datatype, language=value.language)
    except ValueError as error:
        raise InvalidArgumentError(repr(value.value), cause=str(error)) from error
