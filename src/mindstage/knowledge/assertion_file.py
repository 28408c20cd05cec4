"""Triples: single statements, as RDF's own tools see them: found, told and taken back without being understood.

Questions say more, and `tell` knows what a statement about a class means; this is for those who speak RDF.

Told files: what was told, as a Turtle file that can be loaded like any ontology.

A statement is written behind what the file says already, whoever wrote that. To take one back the file is written anew,
which is only done to files that began here: others may hold comments, or numbers to the letter.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError
from mindstage.files import atomic_write
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.knowledge.names import PREFIXES
from mindstage.knowledge.owl import node_label
from mindstage.knowledge.rdf import RdfTerm
from mindstage.knowledge.reasoner_properties import node_from_label
from mindstage.knowledge.store import term_from_node
from mindstage.knowledge.tell import RUNTIME_GRAPH, AssertableValue
from mindstage.scene import Iri

__all__ = ["AssertionFile", "Triple", "TripleStoreView"]


_FIRST_LINE = "# Told to Mindstage, which writes this file anew when something is taken back.\n"


class AssertionFile:
    """One file, and the knowledge base that its statements are understood by."""

    def __init__(self, path: Path, knowledge: KnowledgeBase) -> None:
        """Loads the file where there is one.

        Raises:
            InvalidArgumentError: it is not called like a Turtle file.
            SourceParseError: it cannot be read.
        """
        if path.suffix.lower() != ".ttl":
            raise InvalidArgumentError(str(path), cause="what is told is written as Turtle", remedy="call it .ttl")
        self.path = path.resolve()
        self._knowledge = knowledge
        if path.exists():
            knowledge.load((), ontologies=path)

    def tell(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Adds a statement; False where it was known before.

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement.
            OSError: the file cannot be written.
        """
        known = set(self._quads(RUNTIME_GRAPH))
        self._knowledge.tell(subject, property, value)
        new = [quad.triple for quad in self._quads(RUNTIME_GRAPH) if quad not in known]
        if new:
            before = self.path.read_text(encoding="utf-8") if self.path.exists() else _FIRST_LINE
            declared = ox.parse(before, ox.RdfFormat.TURTLE, base_iri=self.path.as_uri())
            for _ in declared:
                pass
            self._write(f"{before.rstrip()}\n\n{_turtle(new, declared.prefixes)}")
        return bool(new)

    def retract(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Takes a statement back; False where the file does not say it.

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement, or the file began elsewhere.
            OSError: the file cannot be written.
        """
        if not self.path.read_text(encoding="utf-8").startswith(_FIRST_LINE):
            cause = "others wrote it, and what they wrote besides statements would be lost"
            raise InvalidArgumentError(str(self.path), cause=cause, remedy="take the statement out by hand")
        graph = ox.NamedNode(self.path.as_uri())
        before = self._quads(graph)
        self._knowledge.retract(subject, property, value)
        left = self._quads(graph)
        if len(left) == len(before):
            return False
        self._write(f"{_FIRST_LINE}\n{_turtle(_without_orphaned_blank_nodes(left), {})}")
        return True

    def _quads(self, graph: ox.NamedNode) -> list[ox.Quad]:
        return list(self._knowledge.store.quads_for_pattern(None, None, None, graph))

    def _write(self, text: str) -> None:
        atomic_write(self.path, text.encode())


def _turtle(triples: list[ox.Triple], declared: Mapping[str, str]) -> str:
    """Statements, after those prefixes of ours that they use and that nobody has declared yet."""
    text = (ox.serialize(triples, format=ox.RdfFormat.TURTLE, prefixes=PREFIXES) or b"").decode()
    body = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("@prefix "))
    used = (name for name in PREFIXES if re.search(rf"(?<!\w){name}:", body))
    head = [f"@prefix {name}: <{PREFIXES[name]}> .\n" for name in used if declared.get(name) != PREFIXES[name]]
    return "".join([*head, "\n" if head else "", body])


def _without_orphaned_blank_nodes(quads: list[ox.Quad]) -> list[ox.Triple]:
    """Statements without those about things that have no name and that nothing speaks of any more."""
    while True:
        spoken_of = {quad.object for quad in quads}
        left = [quad for quad in quads if not isinstance(quad.subject, ox.BlankNode) or quad.subject in spoken_of]
        if len(left) == len(quads):
            return [quad.triple for quad in left]
        quads = left


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
