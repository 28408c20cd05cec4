"""Derivation: all that follows by the rules of OWL 2 RL, worked out by `reasonable` when somebody asks for it.

What follows stands in a graph of its own, so that it can be dropped again. SPARQL sees it as it is. Questions, which
have their own ways for classes, parts and places, only look there for what they could not know without it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import import_module
from typing import Any

import pyoxigraph as ox

from mindstage.errors import ReasonerUnavailable
from mindstage.knowledge.stores.triplestore import Object, Readable, Subject
from mindstage.knowledge.vocabulary import OWL, RDF, RDFS, THING, XSD

__all__ = ["DERIVED", "Derived", "derived_quads"]

DERIVED = ox.NamedNode("http://mindstage.org/derived")
"""The graph of what was derived."""

_BUILT_IN = (OWL, RDF, RDFS, XSD)


class Told:
    """A store without what was derived from it."""

    def __init__(self, store: Readable) -> None:
        self._store = store

    def quads_for_pattern(
        self,
        subject: Subject | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: Object | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All statements that fit; None fits everything."""
        quads = self._store.quads_for_pattern(subject, predicate, object, graph_name)
        return (quad for quad in quads if quad.graph_name != DERIVED)


class Derived:
    """What was derived, apart from what was told."""

    def __init__(self, store: Readable) -> None:
        self._store = store
        self._exists = next(iter(store.quads_for_pattern(None, None, None, DERIVED)), None) is not None

    def __bool__(self) -> bool:
        """Whether there is anything."""
        return self._exists

    def told(self) -> Readable:
        """The store without it."""
        return Told(self._store) if self._exists else self._store

    def quads_for_pattern(
        self, subject: Subject | ox.Triple | None, predicate: ox.NamedNode | None, object: Object | None, /
    ) -> Iterable[ox.Quad]:
        """All derived statements that fit; None fits everything."""
        return self._store.quads_for_pattern(subject, predicate, object, DERIVED) if self._exists else ()


def derived_quads(quads: Iterable[ox.Quad]) -> Iterator[ox.Quad]:
    """What follows from these statements and is not among them; what is true of everything is left out.

    Raises:
        ReasonerUnavailable: `reasonable` is not installed.
    """
    try:
        reasonable, rdflib = import_module("reasonable"), import_module("rdflib")
    except ImportError as error:
        raise ReasonerUnavailable(cause=str(error)) from error
    told = {quad.triple for quad in quads}
    reasoner = reasonable.PyReasoner()
    reasoner.from_graph([triple for each in told if (triple := _to_rdflib(each, rdflib))])
    for triple in reasoner.reason():
        subject, predicate, value = (_from_rdflib(term, rdflib) for term in triple)
        if isinstance(subject, ox.Literal) or not isinstance(predicate, ox.NamedNode):
            continue
        found = ox.Triple(subject, predicate, value)
        if found not in told and not _says_nothing(found):
            yield ox.Quad(subject, predicate, value, DERIVED)


def _says_nothing(triple: ox.Triple) -> bool:
    """Whether it is true whatever anybody told."""
    subject, value = triple.subject, triple.object
    about_words = isinstance(subject, ox.NamedNode) and subject.value.startswith(_BUILT_IN)
    return about_words or subject == value or value == ox.NamedNode(THING)


def _to_rdflib(triple: ox.Triple, rdflib: Any) -> tuple[Any, Any, Any] | None:
    """A statement in the terms that the reasoner reads; None for a statement about a statement."""
    terms = [_term(node, rdflib) for node in triple]
    return None if None in terms else (terms[0], terms[1], terms[2])


def _term(node: object, rdflib: Any) -> Any:
    match node:
        case ox.NamedNode():
            return rdflib.URIRef(node.value)
        case ox.BlankNode():
            return rdflib.BNode(node.value)
        case ox.Literal() if node.language:
            return rdflib.Literal(node.value, lang=node.language)
        case ox.Literal():
            datatype = rdflib.URIRef(node.datatype.value)
            return rdflib.Literal(node.value, datatype=datatype, normalize=False)
        case _:
            return None


def _from_rdflib(term: Any, rdflib: Any) -> ox.NamedNode | ox.BlankNode | ox.Literal:
    if isinstance(term, rdflib.URIRef):
        return ox.NamedNode(str(term))
    if isinstance(term, rdflib.BNode):
        return ox.BlankNode(str(term))
    if term.language:
        return ox.Literal(str(term), language=term.language)
    return ox.Literal(str(term), datatype=ox.NamedNode(str(term.datatype)) if term.datatype else None)
