"""Prefixes: short forms of names, and the check that a name is one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import count

import pyoxigraph as ox

from mindstage.errors import MapWriteError
from mindstage.knowledge.names import namespace_of
from mindstage.knowledge.vocabulary import KNOWROB, MS, OWL, RDF, RDFS, XSD
from mindstage.knowledge.wording.blocks import DocumentSection
from mindstage.knowledge.wording.letters import xml_local_name
from mindstage.world import BlankNode, Iri, IriRef, Literal, PropertyAssertion

__all__ = ["PrefixTable", "is_plain_name"]

is_plain_name = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*").fullmatch
"""Matches what may follow a prefix, or be a label, in XML and Turtle alike."""

_XMLNS = "http://www.w3.org/2000/xmlns/"
"""The one namespace that no prefix may stand for."""


class PrefixTable:
    """All names of a file: each checked once, with a short form where there is one."""

    def __init__(self, map: Iri, sections: Iterable[DocumentSection]) -> None:
        """Gathers the names.

        Raises:
            MapWriteError: one is not an IRI.
        """
        self.prefixes = {OWL: "owl", XSD: "xsd", KNOWROB: "knowrob", RDFS: "rdfs", RDF: "rdf"}
        self.blank_node_labels: dict[Iri, str] = {}
        iris, labels = {map: None}, {}  # type: dict[Iri, None], dict[Iri, None]
        self._properties: dict[Iri, tuple[str, str] | None] = {}
        languages: set[str] = set()
        datatypes: set[Iri] = set()
        for fact in _all_facts(sections, iris):
            self._properties[fact.property] = None
            if isinstance(fact.value, IriRef):
                iris[fact.value.iri] = None
            elif isinstance(fact.value, Literal):
                if fact.value.language:
                    languages.add(fact.value.language)
                elif fact.value.datatype:
                    datatypes.add(fact.value.datatype)
        for iri in iris:
            if iri.startswith("_:"):
                labels[iri] = None
            else:
                _check_iri(iri)
        for iri in (*self._properties, *datatypes):
            _check_iri(iri)
        for language in languages:
            _check_language(language)
        self._assign_labels(labels)
        self._assign_prefixes(map)
        for property in self._properties:
            match = xml_local_name(property)
            if match and match.start() and property[: match.start()] != _XMLNS:
                self._properties[property] = property[: match.start()], match[0]
                self._assign_prefix(property[: match.start()])

    def split(self, property: Iri) -> tuple[str, str] | None:
        """Prefix and name of a property; None where no name can be split off."""
        parts = self._properties[property]
        return None if parts is None else (self.prefixes[parts[0]], parts[1])

    def _assign_labels(self, labels: Iterable[Iri]) -> None:
        fits = {label: label[2:] for label in labels if is_plain_name(label[2:])}
        taken = set(fits.values())
        free = (name for number in count(1) if (name := f"b{number}") not in taken)
        self.blank_node_labels = {label: fits.get(label) or next(free) for label in labels}

    def _assign_prefixes(self, map: Iri) -> None:
        if (namespace := namespace_of(map)) and not map.startswith("_:"):
            self._assign_prefix(namespace)

    def _assign_prefix(self, namespace: str) -> None:
        if namespace in self.prefixes:
            return
        last = re.split(r"[/:]", namespace.rstrip("#/:"))[-1].lower()
        name = "ms" if namespace == MS else re.sub(r"\.\w+$", "", last)
        if not is_plain_name(name) or name.startswith(("_", "xml")):
            name = "ns"
        taken = set(self.prefixes.values())
        candidates = (f"{name}{number}" for number in count(2))
        self.prefixes[namespace] = name if name not in taken else next(new for new in candidates if new not in taken)


def _all_facts(sections: Iterable[DocumentSection], subjects: dict[Iri, None]) -> Iterator[PropertyAssertion]:
    for section in sections:
        for block in section.blocks:
            subjects[block.subject] = None
            waiting = list(block.facts)
            while waiting:
                fact = waiting.pop()
                yield fact
                if isinstance(fact.value, BlankNode):
                    waiting.extend(fact.value.facts)


def _check_iri(iri: str) -> None:
    try:
        ox.NamedNode(iri)
    except ValueError as error:
        raise MapWriteError(f"<{iri}>", cause=f"it is not an IRI: {error}") from error


def _check_language(language: str) -> None:
    try:
        ox.Literal("", language=language)
    except ValueError as error:
        raise MapWriteError(f"a text in the language {language!r}", cause=str(error)) from error
