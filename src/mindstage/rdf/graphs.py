"""RDF data: graphs and triple stores, IRIs and local names, results of SPARQL queries, and findings about sources.

A `Graph` keeps the text of every literal. Maps are read from graphs, since pyoxigraph's store rounds typed numbers
(177.512833 becomes 177.51283). The reasoner and the questions read patterns from a `TripleStore`, which may be in
memory, in a folder or on a server.
"""

from __future__ import annotations

import gc
import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from functools import cache
from itertools import count
from typing import Any, Protocol, overload

import msgspec
import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError
from mindstage.rdf.vocabulary import DUL, KNOWROB, MS, OWL, RDF, RDFS, SOMA, XSD
from mindstage.scene import BodyId, FactValue, Iri, IriRef, Literal, PropertyAssertion

__all__ = [
    "BUNDLED_GRAPHS",
    "FILE_GRAPHS",
    "PREFIXES",
    "PRESENT_GRAPH",
    "Finding",
    "FindingGroup",
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
    "findings_to_builtins",
    "gc_paused",
    "graph_from_quads",
    "group_findings",
    "group_name",
    "is_generated_label",
    "is_part_name",
    "local_name",
    "merge_graphs",
    "namespace_of",
    "node_from_label",
    "node_to_look_up",
    "part_name",
    "read_named_graph",
    "remove_forbidden_characters",
    "xml_local_name",
]

PREFIXES = {
    "knowrob": KNOWROB,
    "ms": MS,
    "owl": OWL,
    "rdf": RDF,
    "rdfs": RDFS,
    "xsd": XSD,
    "dul": DUL,
    "soma": SOMA,
}
"""The prefixes that names may have, with their namespaces."""
_LAST_SEPARATOR = re.compile(r".*#|.*/|.*:", re.DOTALL)
SubjectNode = ox.NamedNode | ox.BlankNode
ObjectNode = ox.NamedNode | ox.BlankNode | ox.Literal | ox.Triple
_START = (
    "A-Z_a-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c-\u200d\u2070-\u218f"
    "\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_PLAIN_LAST_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9.-]*\Z")
Graph = Mapping[Iri, Sequence[PropertyAssertion]]
"""Subjects and their assertions, both in the order of the source. Blank nodes are labels (`_:x`)."""
_DETAIL = re.compile(
    r"""'[^']*'|"[^"]*"|<[^<>]*>|\b[a-z][a-z0-9+.-]*:[^\s,;]+"""  # quotations and IRIs
    r"""|[^\s,;:()→]*[\d#/_][^\s,;:()→]*|\S+(?: → \S+)+"""  # names with digits or separators, numbers, circles
)
"""The parts of a finding's text that are specific to one individual."""
STRING = XSD + "string"
BUNDLED_GRAPHS, FILE_GRAPHS = "urn:mindstage:bundled:", "urn:mindstage:file:"
"""The names of the graphs of bundled files, and of files that declare no ontology, are these and the file name."""
PRESENT_GRAPH = ox.NamedNode("urn:mindstage:present")
"""The graph of the current state, which exists only in a query that names it."""
is_generated_label = re.compile(r"_:[a-f][0-9a-f]{19,31}").fullmatch
"""Matches the random labels that the parser gives to blank nodes without a label in the source."""


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pauses Python's garbage collection while many small objects without cycles are made.

    The collector visits all live objects whenever their number has grown by a quarter, which takes a third of the time
    of making a world of 10,000 bodies.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class Severity(StrEnum):
    """How much a problem in a source affects the world."""

    WARNING = "warning"
    """Something was assumed or ignored; the entity exists."""
    ERROR = "error"
    """The entity is not in the world. Its statements are kept."""


class Finding(msgspec.Struct, frozen=True):
    """A problem in a source, and how it was handled; all statements are kept."""

    severity: Severity
    individual: str
    """The IRI of the individual, or the file."""
    property: str
    """The IRI of the wrong or missing property; empty if the problem does not concern a single property."""
    problem: str
    action: str

    def __str__(self) -> str:
        about = ", ".join(part for part in (self.individual, self.property) if part)
        return f"{self.severity.value}: {about}: {self.problem}; {self.action}"


class FindingGroup(msgspec.Struct, frozen=True, kw_only=True):
    """Findings of one severity about the same property, which differ in the names and numbers of individuals only."""

    name: str
    """See `group_name`."""
    findings: tuple[Finding, ...]


def group_name(finding: Finding) -> str:
    """The text of a finding without the names and numbers of the individual; like findings have the same."""
    property = local_name(finding.property) or "-"
    return _DETAIL.sub("…", f"{finding.severity.value}: {property}: {finding.problem}; {finding.action}")


def findings_to_builtins(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """The findings as JSON objects; like findings have the same `group`."""
    return [msgspec.to_builtins(finding) | {"group": group_name(finding)} for finding in findings]


def group_findings(findings: Iterable[Finding]) -> tuple[FindingGroup, ...]:
    """Groups like findings: those of errors first, then in the order of the first finding of each group."""
    groups: dict[str, list[Finding]] = {}
    for finding in findings:
        groups.setdefault(group_name(finding), []).append(finding)
    found = (FindingGroup(name=name, findings=tuple(each)) for name, each in groups.items())
    return tuple(sorted(found, key=lambda group: group.findings[0].severity is not Severity.ERROR))


class FindingSink(Protocol):
    """Collects findings while a source is read."""

    def __call__(self, severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
        """Adds a finding."""


def namespace_of(iri: str) -> str:
    """The part of an IRI before its local name."""
    match = _LAST_SEPARATOR.match(iri)
    return match[0] if match and match.end() < len(iri) else ""


def local_name(iri: str) -> str:
    """The part of an IRI after the last "#", or else "/", or else ":"; the whole IRI if that is empty."""
    return iri[len(namespace_of(iri)) :]


def assign_ids(explicit: Mapping[Iri, str], iris: Iterable[Iri]) -> dict[Iri, BodyId]:
    """Assigns unique ids to individuals.

    Args:
        explicit: the ids that the source states, all different.
        iris: the other individuals, whose ids are their local names, numbered from the second on.
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
    """An unused IRI for a part of an individual, such as "cup-pose"."""
    name = f"{owner}-{suffix}"
    if name not in used_names:
        return Iri(name)
    return next(Iri(other) for number in count(2) if (other := f"{name}-{number}") not in used_names)


def is_part_name(name: str, owner: Iri, suffix: str) -> bool:
    """Whether `part_name` may have generated this name."""
    start = f"{owner}-{suffix}"
    return name.startswith(start) and re.fullmatch(r"(-\d+)?", name[len(start) :]) is not None


class QuadSource(Protocol):
    """Read access to statements."""

    def quads_for_pattern(
        self,
        subject: SubjectNode | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: ObjectNode | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All matching statements of one graph, or of all graphs; None matches everything."""


class RdfTerm(msgspec.Struct, frozen=True, omit_defaults=True):
    """An RDF term as plain data."""

    kind: str
    """iri, blank, literal or triple."""
    value: str
    datatype: str | None = None
    language: str | None = None


SparqlRow = tuple[RdfTerm | None, ...]


class SparqlResult(msgspec.Struct, frozen=True):
    """The result of a query: a boolean (ASK), triples (CONSTRUCT, DESCRIBE) or solutions (SELECT).

    It is a sequence of its rows; `result["name"]` is the column of a variable. The result of ASK has no rows, and is
    true or false as such.

    >>> from mindstage.knowledge import KnowledgeBase
    >>> result = KnowledgeBase().sparql("SELECT ?n ?twice { VALUES ?n { 1 2 } BIND(2 * ?n AS ?twice) }")
    >>> [(n.value, twice.value) for n, twice in result], len(result), [term.value for term in result["twice"]]
    ([('1', '2'), ('2', '4')], 2, ['2', '4'])
    """

    columns: tuple[str, ...]
    rows: tuple[SparqlRow, ...]
    boolean: bool | None = None
    """The result of ASK; None for other queries."""

    def __iter__(self) -> Iterator[SparqlRow]:
        """The rows."""
        return iter(self.rows)

    def __len__(self) -> int:
        """The number of rows."""
        return len(self.rows)

    def __bool__(self) -> bool:
        """The result of ASK; for other queries, whether there are rows."""
        return bool(self.rows) if self.boolean is None else self.boolean

    @overload
    def __getitem__(self, at: int) -> SparqlRow: ...
    @overload
    def __getitem__(self, at: slice | str) -> tuple[Any, ...]: ...
    def __getitem__(self, at: int | slice | str) -> tuple[Any, ...]:
        """One row, several rows, or the column of a variable.

        Raises:
            InvalidArgumentError: the result has no such column.
            IndexError: it has no such row.
        """
        if not isinstance(at, str):
            return self.rows[at]
        if at not in self.columns:
            there = ", ".join(self.columns) or "none"
            raise InvalidArgumentError(f"column {at!r}", cause="the result has none", remedy=f"there is {there}")
        place = self.columns.index(at)
        return tuple(row[place] for row in self.rows)

    def with_columns(self, columns: Sequence[str]) -> SparqlResult:
        """The same result with its columns in another order."""
        if tuple(columns) == self.columns:
            return self
        places = [self.columns.index(column) for column in columns]
        rows = tuple(tuple(row[place] for place in places) for row in self.rows)
        return SparqlResult(tuple(columns), rows, self.boolean)

    def to_dicts(self) -> list[dict[str, str | None]]:
        """The values of the rows by column, as text: `pandas.DataFrame(result.to_dicts())`."""
        return [
            {name: None if term is None else term.value for name, term in zip(self.columns, row, strict=True)}
            for row in self.rows
        ]


class TripleStore(QuadSource, Protocol):
    """Read and write access to statements.

    Every call is atomic. Reads may come from several threads, writes from one at a time.
    """

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement; has no effect if it exists."""

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements with common blank nodes."""

    def remove(self, quad: ox.Quad, /) -> None:
        """Removes a statement, if it exists."""

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a document into a graph.

        Raises:
            SyntaxError: the document is not in that format; nothing was added.
        """

    def remove_graph(self, graph: ox.NamedNode | ox.DefaultGraph, /) -> None:
        """Removes all statements of a graph."""

    def query(
        self,
        query: str,
        *,
        timeout_s: float,
        allow_service: bool = False,
        prefixes: Mapping[str, str] = PREFIXES,
        present: bytes | None = None,
    ) -> SparqlResult:
        """Evaluates a SPARQL query, and stops it at the time limit.

        Args:
            timeout_s: the time limit [s].
            allow_service: whether it may use other servers.
            prefixes: the prefixes that it need not declare.
            present: further graphs in N-Quads, which exist for this query only: the state, and the events of episodes.

        Raises:
            SparqlSyntaxError: the query is not valid, not allowed, or its answer too large.
            SparqlTimeoutError: the time limit was exceeded.
        """

    def close(self) -> None:
        """Closes files, processes and connections. May be called repeatedly."""


def find_forbidden_character(text: str) -> re.Match[str] | None:
    """The first character that XML cannot contain, not even escaped."""
    return None if text.isascii() and text.isprintable() else _forbidden_pattern().search(text)


def remove_forbidden_characters(text: str) -> str:
    """The text without the characters that XML cannot contain."""
    return text if text.isascii() and text.isprintable() else _forbidden_pattern().sub("", text)


def xml_local_name(iri: str) -> re.Match[str] | None:
    """The longest suffix of an IRI that is a name in XML."""
    return (_PLAIN_LAST_NAME if iri.isascii() else _local_name_pattern()).search(iri)


@cache  # compiled at first use: it takes milliseconds, and most text is ASCII
def _forbidden_pattern() -> re.Pattern[str]:
    return re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@cache  # as above
def _local_name_pattern() -> re.Pattern[str]:
    return re.compile(rf"[{_START}][{_START}0-9.\u00b7\u0300-\u036f\u203f-\u2040-]*\Z")


def graph_from_quads(quads: Iterable[ox.Quad], used_labels: set[str]) -> Graph:
    """Collects parsed statements by subject, each once.

    Args:
        quads: the parsed statements.
        used_labels: blank node labels of other sources, which are not used again; those of this source are added.

    Raises:
        ValueError: a statement is about a statement (RDF 1.2), which assertions cannot represent.
    """
    labels = _BlankNodeLabels(used_labels)
    graph: dict[Iri, list[PropertyAssertion]] = {}
    same: dict[str, Iri] = {}  # interns names, so that each is hashed and stored once
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


def has_blank_node(quad: ox.Quad) -> bool:
    """Whether a statement is about a blank node, or refers to one."""
    return isinstance(quad.subject, ox.BlankNode) or isinstance(quad.object, ox.BlankNode)


def quads_with_property(source: QuadSource, property: str) -> Iterator[ox.Quad]:
    """All statements with a property."""
    return source.quads_for_pattern(None, ox.NamedNode(property), None)


def read_named_graph(source: QuadSource, name: Iri) -> Graph:
    """The statements of a named graph of a store."""
    return graph_from_quads(source.quads_for_pattern(None, None, None, ox.NamedNode(name)), set())


def merge_graphs(graphs: Sequence[Graph]) -> Graph:
    """The union of several graphs, each statement once."""
    if len(graphs) == 1:
        return graphs[0]
    merged: dict[Iri, dict[PropertyAssertion, None]] = {}
    for graph in graphs:
        for subject, facts in graph.items():
            merged.setdefault(subject, {}).update(dict.fromkeys(facts))
    return {subject: list(facts) for subject, facts in merged.items()}


def node_from_label(name: Iri) -> ox.NamedNode | ox.BlankNode:
    """The node of an IRI or of a blank node label (`_:label`).

    Raises:
        ValueError: it is not a valid one.
    """
    return ox.BlankNode(name[2:]) if name.startswith("_:") else ox.NamedNode(name)


def node_to_look_up(name: Iri) -> ox.NamedNode | ox.BlankNode:
    """The same; a node of no statement for a text that is not a valid IRI, as the class or id of a body may be."""
    try:
        return node_from_label(name)
    except ValueError:
        return ox.BlankNode()


class _BlankNodeLabels:
    """The blank node labels of one source, made unique across sources."""

    def __init__(self, used: set[str]) -> None:
        self._used = used
        self.assigned: dict[str, Iri] = {}

    def name(self, term: object) -> Iri:
        if isinstance(term, ox.NamedNode):
            return Iri(term.value)
        if not isinstance(term, ox.BlankNode):
            raise ValueError("a statement about a statement (RDF 1.2) cannot be part of a world")
        label = self.assigned.get(term.value)
        if label is None:
            label = self.assigned[term.value] = self._unused(Iri(f"_:{term.value}"))
        return label

    def _unused(self, label: Iri) -> Iri:
        if label not in self._used:
            return label
        return next(other for n in count(2) if (other := Iri(f"{label}-{n}")) not in self._used)
