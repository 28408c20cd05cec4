"""Files of asserted statements, and access to the triples of a knowledge base.

An `AssertionFile` is a Turtle file that can be loaded like any ontology. A new statement is appended to what the file
contains. Several processes may write one file: each locks it, and reads what the others have written. A retraction
rewrites the file, which is only allowed for files that were created here: others may contain
comments and number formats that would be lost.

A `TripleStoreView` finds, adds and removes single triples without interpreting them, as RDF tools do; questions and
`KnowledgeBase.tell` interpret statements about classes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError, SourceParseError
from mindstage.files import atomic_write, file_lock
from mindstage.knowledge.knowledge_base import KnowledgeBase
from mindstage.knowledge.names import PREFIXES
from mindstage.knowledge.owl import node_label
from mindstage.knowledge.store import term_from_node
from mindstage.knowledge.tell import RUNTIME_GRAPH, AssertableValue
from mindstage.rdf.graphs import RdfTerm, node_from_label
from mindstage.scene import Iri

__all__ = ["RUNTIME_GRAPH_IRI", "AssertionFile", "Triple", "TripleStoreView"]


_FIRST_LINE = "# Told to Mindstage, which writes this file anew when something is taken back.\n"

RUNTIME_GRAPH_IRI = Iri(RUNTIME_GRAPH.value)
"""The graph of statements that were asserted at run time."""
Node = ox.NamedNode | ox.BlankNode


class AssertionFile:
    """A Turtle file of assertions, with the knowledge base that resolves their names."""

    def __init__(self, path: Path, knowledge: KnowledgeBase) -> None:
        """Loads the file if it exists.

        Raises:
            InvalidArgumentError: its name does not end in .ttl.
            SourceParseError: it cannot be read.
        """
        if path.suffix.lower() != ".ttl":
            raise InvalidArgumentError(str(path), cause="assertions are written as Turtle", remedy="call it .ttl")
        self.path = path.resolve()
        self._knowledge = knowledge
        self._known_text = self._graph_text = self._read()
        """The text whose statements the knowledge base has, and the text that the graph of the file has."""
        if self._known_text:
            knowledge.load((), ontologies=self.path)

    def tell(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Asserts a statement in the knowledge base and in the file; returns whether it is new.

        Raises:
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
            InvalidArgumentError: the three do not form a statement.
            OSError: the file cannot be written.
        """
        with file_lock(self.path):
            if (text := self._read()) != self._known_text:
                self._reload(text)
            known = set(self._quads(RUNTIME_GRAPH))
            self._knowledge.tell(subject, property, value)
            new = [quad.triple for quad in self._quads(RUNTIME_GRAPH) if quad not in known]
            if new:
                before = text or _FIRST_LINE
                declared = ox.parse(before, ox.RdfFormat.TURTLE, base_iri=self.path.as_uri())
                for _ in declared:
                    pass
                self._write(f"{before.rstrip()}\n\n{_turtle(new, declared.prefixes)}")
            return bool(new)

    def retract(self, subject: str, property: str, value: AssertableValue) -> bool:
        """Removes a statement from the knowledge base and from the file; returns whether the file had contained it.

        Raises:
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
            InvalidArgumentError: the three do not form a statement, or the file was not created here.
            OSError: the file cannot be written.
        """
        self.path.stat()  # the lock would create it
        with file_lock(self.path):
            text = self.path.read_text(encoding="utf-8")
            if not text.startswith(_FIRST_LINE):
                cause = "it was not created by Mindstage, and rewriting it would lose everything besides statements"
                raise InvalidArgumentError(str(self.path), cause=cause, remedy="remove the statement in an editor")
            if text != self._graph_text:
                self._reload(text)
            graph = self._knowledge.source_graph(self.path)
            before = self._quads(graph)
            self._knowledge.retract(subject, property, value)
            left = self._quads(graph)
            if len(left) == len(before):
                return False
            self._write(f"{_FIRST_LINE}\n{_turtle(_without_orphaned_blank_nodes(left), {})}")
            self._graph_text = self._known_text
            return True

    def _read(self) -> str:
        """The text of the file; empty if it does not exist."""
        try:
            return self.path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""
        except UnicodeDecodeError as error:
            raise SourceParseError(str(self.path), cause=f"it is not in UTF-8: {error}") from error

    def _reload(self, text: str) -> None:
        """Reads the statements that another process, or an earlier call, has written to the file."""
        knowledge = self._knowledge
        with knowledge.lock:
            if self.path in knowledge.sources():
                graph = knowledge.source_graph(self.path)
                try:
                    new = list(ox.parse(text, ox.RdfFormat.TURTLE, base_iri=self.path.as_uri()))
                except SyntaxError as error:
                    raise SourceParseError(str(self.path), cause=str(error)) from error
                knowledge.store.remove_graph(graph)
                knowledge.store.extend(ox.Quad(each.subject, each.predicate, each.object, graph) for each in new)
                knowledge._invalidate_all()
            elif text:
                knowledge.load((), ontologies=self.path)
        self._known_text = self._graph_text = text

    def _quads(self, graph: ox.NamedNode) -> list[ox.Quad]:
        return list(self._knowledge.store.quads_for_pattern(None, None, None, graph))

    def _write(self, text: str) -> None:
        atomic_write(self.path, text.encode())
        self._known_text = text


def _turtle(triples: list[ox.Triple], declared: Mapping[str, str]) -> str:
    """Triples as Turtle, after the standard prefixes that they use and that are not declared yet."""
    text = (ox.serialize(triples, format=ox.RdfFormat.TURTLE, prefixes=PREFIXES) or b"").decode()
    body = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("@prefix "))
    used = (name for name in PREFIXES if re.search(rf"(?<!\w){name}:", body))
    head = [f"@prefix {name}: <{PREFIXES[name]}> .\n" for name in used if declared.get(name) != PREFIXES[name]]
    return "".join([*head, "\n" if head else "", body])


def _without_orphaned_blank_nodes(quads: list[ox.Quad]) -> list[ox.Triple]:
    """Triples without those about blank nodes that nothing refers to any more."""
    while True:
        referenced = {quad.object for quad in quads}
        left = [quad for quad in quads if not isinstance(quad.subject, ox.BlankNode) or quad.subject in referenced]
        if len(left) == len(quads):
            return [quad.triple for quad in left]
        quads = left


class Triple(NamedTuple):
    """One statement; a blank node is written as `_:label`."""

    subject: Iri
    property: Iri
    value: RdfTerm


class TripleStoreView:
    """The statements of a knowledge base as triples."""

    def __init__(self, knowledge: KnowledgeBase) -> None:
        self._knowledge = knowledge
        self._store = knowledge._store

    def find(
        self, subject: str | None = None, property: str | None = None, value: RdfTerm | None = None
    ) -> Iterator[Triple]:
        """Asserted triples, each once; None matches everything.

        Raises:
            InvalidArgumentError: an argument is not a valid name.
        """
        seen = set()
        for quad in self._quads(subject, property, value):
            label = node_label(quad.subject) or Iri(str(quad.subject))
            triple = Triple(label, Iri(quad.predicate.value), term_from_node(quad.object))
            if triple not in seen:
                seen.add(triple)
                yield triple

    def find_entailed(
        self, subject: str | None = None, property: str | None = None, value: RdfTerm | None = None
    ) -> Iterator[Triple]:
        """Triples of a property, and of its subproperties and inverses; None matches everything.

        Raises:
            InvalidArgumentError: an argument is not a valid name.
        """
        if property is None:
            yield from self.find(subject, None, value)
            return
        found: dict[Triple, None] = {}
        for node, forward in self._knowledge.reasoner.properties.used_expressions(Iri(property)):
            if forward:
                triples = self.find(subject, node.value, value)
                found |= {Triple(one, Iri(property), other): None for one, _, other in triples}
            elif value is None or value.kind != "literal":
                start = None if value is None else _resource_text(value)
                triples = self.find(start, node.value, None if subject is None else _resource_term(subject))
                found |= {
                    Triple(Iri(_resource_text(other)), Iri(property), _resource_term(one)): None
                    for one, _, other in triples
                    if other.kind != "literal"
                }
        yield from found

    def add(self, subject: str, property: str, value: RdfTerm, graph: str | None = None) -> None:
        """Asserts a triple, which all later questions use.

        Raises:
            InvalidArgumentError: an argument is not a valid name.
        """
        quad = ox.Quad(
            _node(subject), _property(property), _object(value), RUNTIME_GRAPH if graph is None else _property(graph)
        )
        with self._knowledge.lock:
            self._store.add(quad)
            self._knowledge._invalidate([quad])

    def remove(
        self,
        subject: str | None = None,
        property: str | None = None,
        value: RdfTerm | None = None,
        graph: str | None = None,
    ) -> int:
        """Removes all matching triples, asserted or loaded, and returns their number; None matches everything.

        Raises:
            InvalidArgumentError: an argument is not a valid name.
        """
        with self._knowledge.lock:
            quads = list(self._quads(subject, property, value, graph))
            for quad in quads:
                self._store.remove(quad)
            if quads:
                self._knowledge._invalidate(quads)
                self._knowledge.forget_derived()
        return len(quads)

    def _quads(
        self, subject: str | None, property: str | None, value: RdfTerm | None, graph: str | None = None
    ) -> Iterator[ox.Quad]:
        subject_node = None if subject is None else _node(subject)
        predicate = None if property is None else _property(property)
        object = None if value is None else _object(value)
        yield from self._store.quads_for_pattern(
            subject_node, predicate, object, None if graph is None else _property(graph)
        )


def _resource_term(name: str) -> RdfTerm:
    return RdfTerm("blank", name[2:]) if name.startswith("_:") else RdfTerm("iri", name)


def _resource_text(term: RdfTerm) -> str:
    return f"_:{term.value}" if term.kind == "blank" else term.value


def _property(name: str) -> ox.NamedNode:
    node = _node(name)
    if isinstance(node, ox.BlankNode):
        raise InvalidArgumentError(name, cause="a property cannot be a blank node")
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
