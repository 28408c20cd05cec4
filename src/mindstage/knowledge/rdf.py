"""Graphs: what a source says, exactly, as facts by subject.

The store of pyoxigraph rounds typed numbers (177.512833 becomes 177.51283), so a map is not read from it but from
here, where every literal keeps its text.

Bulk work: many small values at once, without Python looking for garbage among them again and again.

Findings: what a source says that could not be taken as it stands, and what was done instead.

Names: the ids that individuals have in a world, and the names that their parts get where nobody gave one.

Triple stores: where statements are kept, whoever keeps them.

The index and the questions read patterns and know nothing else; whether they come from memory, from a folder or from a
server is the store's own affair.

Letters: what XML has no room for, and where a name begins.

Nearly all texts and names are plain ASCII. The patterns for the rest take milliseconds to make, more than all else
that is done when this room is first imported, so they are made when something needs them.
"""

from __future__ import annotations

import gc
import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from functools import cache
from itertools import count
from typing import Protocol

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.vocabulary import XSD
from mindstage.scene import BodyId, FactValue, Iri, IriRef, Literal, PropertyAssertion

__all__ = [
    "Finding",
    "FindingSink",
    "Graph",
    "ObjectNode",
    "QuadSource",
    "RdfTerm",
    "Severity",
    "SparqlResult",
    "SubjectNode",
    "TripleStore",
    "assign_ids",
    "find_forbidden_character",
    "gc_paused",
    "graph_from_quads",
    "is_generated_label",
    "is_part_name",
    "local_name",
    "merge_graphs",
    "namespace_of",
    "part_name",
    "remove_forbidden_characters",
    "xml_local_name",
]


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pauses the search for circular garbage, of which plain data has none.

    The search goes through all that is alive whenever that has grown by a quarter; while a world of 10,000 bodies is
    made, that is a third of the whole time.
    """
    searching = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if searching:
            gc.enable()


class Severity(StrEnum):
    """How much of what was meant is missing in the world."""

    WARNING = "warning"
    """Something had to be chosen or ignored; the thing itself is there."""
    ERROR = "error"
    """A thing is not there. What is said about it is kept all the same."""


class Finding(msgspec.Struct, frozen=True, rename={"problem": "what", "action": "did"}):
    """One oddity of a source, and how it was met; none of them loses a statement."""

    severity: Severity
    individual: str
    """The IRI that it is about, or the file."""
    property: str
    """The IRI of the property that is odd or missing; empty where it is about the whole."""
    problem: str
    action: str

    def __str__(self) -> str:
        about = ", ".join(part for part in (self.individual, self.property) if part)
        return f"{self.severity.value}: {about}: {self.problem}; {self.action}"


class FindingSink(Protocol):
    """Where findings go while a source is read."""

    def __call__(self, severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        """Keeps one finding."""


_LAST_SEPARATOR = re.compile(r".*#|.*/|.*:", re.DOTALL)


def namespace_of(iri: str) -> str:
    """All of an IRI before its local name."""
    match = _LAST_SEPARATOR.match(iri)
    return match[0] if match and match.end() < len(iri) else ""


def local_name(iri: str) -> str:
    """What comes after the last "#", or else "/", or else ":"; the whole IRI where nothing comes after it."""
    return iri[len(namespace_of(iri)) :]


def assign_ids(explicit: Mapping[Iri, str], iris: Iterable[Iri]) -> dict[Iri, BodyId]:
    """Ids that differ from one another.

    Args:
        explicit: ids that were told; all different.
        iris: the others, which are called by their local name, with a number behind it from the second on.
    """
    ids = {iri: BodyId(id) for iri, id in explicit.items()}
    taken = set(explicit.values())
    numbers: dict[str, Iterator[int]] = {}
    for iri in iris:
        id = name = local_name(iri)
        if name in taken:
            further = numbers.setdefault(name, count(2))
            id = next(candidate for number in further if (candidate := f"{name}-{number}") not in taken)
        taken.add(id)
        ids[iri] = BodyId(id)
    return ids


def part_name(owner: Iri, suffix: str, used_names: Container[str]) -> Iri:
    """The name of an individual's part, such as "cup-pose"."""
    name = f"{owner}-{suffix}"
    if name not in used_names:
        return Iri(name)
    return next(Iri(other) for number in count(2) if (other := f"{name}-{number}") not in used_names)


def is_part_name(name: str, owner: Iri, suffix: str) -> bool:
    """Whether `part_name` may have given this name."""
    start = f"{owner}-{suffix}"
    return name.startswith(start) and re.fullmatch(r"(-\d+)?", name[len(start) :]) is not None


SubjectNode = ox.NamedNode | ox.BlankNode
ObjectNode = ox.NamedNode | ox.BlankNode | ox.Literal | ox.Triple


class QuadSource(Protocol):
    """What the index reads from."""

    def quads_for_pattern(
        self,
        subject: SubjectNode | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: ObjectNode | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All statements that fit, of one graph or of all; None fits everything."""


class RdfTerm(msgspec.Struct, frozen=True, omit_defaults=True):
    """One value of a solution."""

    kind: str
    """iri, blank, literal or triple."""
    value: str
    datatype: str | None = None
    language: str | None = None


class SparqlResult(msgspec.Struct, frozen=True):
    """What a query found: a truth (ASK), triples (CONSTRUCT, DESCRIBE) or solutions (SELECT)."""

    columns: tuple[str, ...]
    rows: tuple[tuple[RdfTerm | None, ...], ...]
    boolean: bool | None = None
    """The answer of ASK, and None of any other."""


class TripleStore(QuadSource, Protocol):
    """What a knowledge base keeps its statements in.

    Each call is done whole or not at all. Reading is safe from several threads, writing from one at a time.
    """

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement; adding it twice is adding it once."""

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements that share their things without a name."""

    def remove(self, quad: ox.Quad, /) -> None:
        """Takes a statement away, if it is there."""

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a text into a graph.

        Raises:
            SyntaxError: it is not in that format; nothing was added.
        """

    def remove_graph(self, graph: ox.NamedNode, /) -> None:
        """Takes all statements of a graph away."""

    def query(self, query: str, *, timeout_s: float, allow_service: bool = False) -> SparqlResult:
        """Answers a SPARQL query, or stops it when its time is over.

        Raises:
            SparqlSyntaxError: it is no query, asks for what it may not, or for more than can be had.
            SparqlTimeoutError: it did not end in time.
        """

    def close(self) -> None:
        """Lets go of files, processes and connections; any number of times."""


_START = (
    "A-Z_a-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c-\u200d\u2070-\u218f"
    "\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_PLAIN_LAST_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9.-]*\Z")


def find_forbidden_character(text: str) -> re.Match[str] | None:
    """The first letter that no XML file can hold, not even escaped."""
    return None if text.isascii() and text.isprintable() else _forbidden_pattern().search(text)


def remove_forbidden_characters(text: str) -> str:
    """The text without letters that no XML file can hold."""
    return text if text.isascii() and text.isprintable() else _forbidden_pattern().sub("", text)


def xml_local_name(iri: str) -> re.Match[str] | None:
    """The longest end of an IRI that is a name in XML."""
    return (_PLAIN_LAST_NAME if iri.isascii() else _local_name_pattern()).search(iri)


@cache
def _forbidden_pattern() -> re.Pattern[str]:
    return re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@cache
def _local_name_pattern() -> re.Pattern[str]:
    return re.compile(rf"[{_START}][{_START}0-9.\u00b7\u0300-\u036f\u203f-\u2040-]*\Z")


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
