"""Materialization of everything that follows by the rules of OWL 2 RL, with the library `reasonable`.

The inferred statements are kept in a named graph, so that they can be dropped. SPARQL queries include them. Questions,
which have their own inference for classes, parts and poses, use them for what they could not infer otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import import_module
from typing import Any

import pyoxigraph as ox

from mindstage.errors import ReasonerUnavailableError
from mindstage.rdf.graphs import ObjectNode, QuadSource, SubjectNode
from mindstage.rdf.vocabulary import OWL, RDF, RDFS, THING, XSD

__all__ = ["INFERRED_GRAPH", "InferredTriples", "materialize_owl_rl"]

INFERRED_GRAPH = ox.NamedNode("http://mindstage.org/derived")
"""The graph of the materialized statements."""

_BUILT_IN = (OWL, RDF, RDFS, XSD)


class AssertedTriples:
    """A store without the materialized statements."""

    def __init__(self, store: QuadSource) -> None:
        self._store = store

    def quads_for_pattern(
        self,
        subject: SubjectNode | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: ObjectNode | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All matching statements; None matches everything."""
        quads = self._store.quads_for_pattern(subject, predicate, object, graph_name)
        return (quad for quad in quads if quad.graph_name != INFERRED_GRAPH)


class InferredTriples:
    """The materialized statements of a store."""

    def __init__(self, store: QuadSource) -> None:
        self._store = store
        self._has_inferred = next(iter(store.quads_for_pattern(None, None, None, INFERRED_GRAPH)), None) is not None

    def __bool__(self) -> bool:
        """Whether there are any."""
        return self._has_inferred

    def asserted(self) -> QuadSource:
        """The store without the materialized statements."""
        return AssertedTriples(self._store) if self._has_inferred else self._store

    def quads_for_pattern(
        self, subject: SubjectNode | ox.Triple | None, predicate: ox.NamedNode | None, object: ObjectNode | None, /
    ) -> Iterable[ox.Quad]:
        """All matching materialized statements; None matches everything."""
        return self._store.quads_for_pattern(subject, predicate, object, INFERRED_GRAPH) if self._has_inferred else ()


def materialize_owl_rl(quads: Iterable[ox.Quad]) -> Iterator[ox.Quad]:
    """The statements that follow from others, without these and without tautologies.

    Raises:
        ReasonerUnavailableError: `reasonable` is not installed.
    """
    try:
        reasonable, rdflib = import_module("reasonable"), import_module("rdflib")
    except ImportError as error:
        raise ReasonerUnavailableError(cause=str(error)) from error
    asserted = {quad.triple for quad in quads}
    reasoner = reasonable.PyReasoner()
    reasoner.from_graph([triple for each in asserted if (triple := _to_rdflib(each, rdflib))])
    for triple in reasoner.reason():
        subject, predicate, value = (_from_rdflib(term, rdflib) for term in triple)
        if isinstance(subject, ox.Literal) or not isinstance(predicate, ox.NamedNode):
            continue
        found = ox.Triple(subject, predicate, value)
        if found not in asserted and not _is_trivial(found):
            yield ox.Quad(subject, predicate, value, INFERRED_GRAPH)


def _is_trivial(triple: ox.Triple) -> bool:
    """Whether a statement is true in every ontology."""
    subject, value = triple.subject, triple.object
    is_built_in = isinstance(subject, ox.NamedNode) and subject.value.startswith(_BUILT_IN)
    return is_built_in or subject == value or value == ox.NamedNode(THING)


def _to_rdflib(triple: ox.Triple, rdflib: Any) -> tuple[Any, Any, Any] | None:
    """A statement as rdflib terms; None for a statement about a statement."""
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
