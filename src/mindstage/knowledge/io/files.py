"""Files: from a path to bytes that are safe to parse, and an error with line and cause where that fails.

A file that is wrong only in ways that SWI-Prolog forgives is repaired (see `xml_repair`), and tells what was done.

The files that come with Mindstage: a household ontology and a furnished kitchen.

Sources: what was read from one place, as statements in the store and, where a world is made of it, as exact text.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import SourceParseError
from mindstage.knowledge.io.xml import (
    DEPTH_LIMIT,
    UnsafeXmlEntity,
    expand_safe_entities,
    find_xml_error,
    first_tag,
    has_conflicting_entities,
    is_complete,
    is_too_deep,
)
from mindstage.knowledge.io.xml_repair import XmlNotRepairable, XmlRepair, repair_xml
from mindstage.knowledge.rdf import Finding, ObjectNode, QuadSource, Severity
from mindstage.knowledge.rdf_mapping.properties import SIZE
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, IMPORTS, ON_PROPERTY, RDF, SEMANTIC_MAP, TYPE
from mindstage.scene import Iri

__all__ = [
    "BUNDLED_KITCHEN",
    "SUFFIXES",
    "Source",
    "SourceFile",
    "bundled_kitchen",
    "bundled_ontology",
    "map_path",
    "read_file",
]


BUNDLED_KITCHEN = "bundled:kitchen"
"""The name under which `KnowledgeBase.load` and every command of the shell take the bundled kitchen."""


def map_path(name: str | os.PathLike[str]) -> str:
    """The path of a map: that of the bundled kitchen for its name, any other as it is."""
    path = os.fspath(name)
    return os.fspath(bundled_kitchen()) if path == BUNDLED_KITCHEN else path


def bundled_kitchen() -> Path:
    """A kitchen to play with: a map of dialect 1."""
    return _bundled_path("kitchen.owl")


def bundled_ontology() -> Path:
    """What a household holds, as classes that maps and questions share; every `KnowledgeBase` knows it unless told."""
    return _bundled_path("household.ttl")


def _bundled_path(name: str) -> Path:
    # Wheels are always unpacked, so that a resource of ours is a file.
    return Path(__file__).parents[1] / "bundled" / name


RDF_XML, TURTLE, N_TRIPLES = ox.RdfFormat.RDF_XML, ox.RdfFormat.TURTLE, ox.RdfFormat.N_TRIPLES
SUFFIXES = {".owl": RDF_XML, ".rdf": RDF_XML, ".xml": RDF_XML, ".ttl": TURTLE, ".nt": N_TRIPLES}

MAX_REPORTED_REPAIRS = 100
"""More repairs of one file than this are counted, but not told one by one."""

_BOMS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_DECLARED_ENCODING = re.compile(rb"""^\s*<\?xml[^>]*?\sencoding\s*=\s*["']([A-Za-z][\w.-]*)["']""")
_WIDE_ENCODINGS = re.compile(r"utf-?(16|32)|ucs-?[24]", re.IGNORECASE)
_DECLARATION = re.compile(r"^\s*<\?xml.*?\?>", re.DOTALL)
_XML_START = re.compile(rb"\s*<(\?xml|!|[\w.-]+:RDF\b)")
_LATE_START = re.compile(rb"<(\?xml\s|!DOCTYPE\s|[\w.-]*:RDF[\s>])")
_TURTLE_START = re.compile(rb"(?:\s|#[^\n]*\n)*(?:@prefix|@base|PREFIX|BASE)\s", re.IGNORECASE)
_STATEMENT_START = re.compile(rb"(?:\s|#[^\n]*\n)*(?:<[^<>\"{}|^`\\\s]+>|_:\S+)\s+(?:<[^<>\"{}|^`\\\s]+>|a)\s")


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A file that parses, or is said to be `parse_error` by whoever finds that it does not."""

    path: Path
    data: bytes
    """UTF-8."""
    format: ox.RdfFormat
    repairs: tuple[XmlRepair, ...] = ()
    """What was changed in it so that it can be parsed."""

    @property
    def iri(self) -> str:
        """What relative names in it are relative to, and what its graph is called."""
        return self.path.as_uri()

    def findings(self) -> list[Finding]:
        """What is to be told about its repairs."""
        told = [self._finding(f"line {line}: {what}", did) for line, what, did in self.repairs[:MAX_REPORTED_REPAIRS]]
        if more := len(self.repairs) - len(told):
            told.append(self._finding(f"{more:,} more places like these", "they are read alike"))
        return told

    def repair(self, error: SyntaxError) -> SourceFile:
        """The file as SWI-Prolog would read it, after the parser gave up on it as it stands.

        Raises:
            SourceParseError: there is no way to read it.
        """
        is_rdf = RDF.encode() in self.data or _LATE_START.search(self.data)
        if self.format != RDF_XML or not is_rdf:
            raise self.parse_error(error) from error
        return _repair(self)

    def parse_error(self, error: SyntaxError) -> SourceParseError:
        """What is to be said where the parser gave up on this file."""
        if self.format == RDF_XML:
            return _xml_error(self, str(error))
        return SourceParseError(str(self.path), cause=_without_position(str(error)), line=error.lineno)

    def _finding(self, problem: str, action: str) -> Finding:
        return Finding(Severity.WARNING, str(self.path), "", problem, action)


def read_file(path: Path) -> SourceFile:
    """Reads a file and makes sure that parsing it is harmless; whether it parses shows only then.

    Raises:
        SourceParseError: it is missing, of no known format, cut off, or dangerous.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise SourceParseError(str(path), cause="there is no such file") from error
    except IsADirectoryError as error:
        cause = "it is a folder; name the map's file in it, or give a folder of ROS packages as an ontology"
        raise SourceParseError(str(path), cause=cause) from error
    except OSError as error:
        raise SourceParseError(str(path), cause=error.strerror or str(error)) from error
    data, repairs = _as_utf8(data)
    format = _format(path, data)
    if format != RDF_XML:
        return SourceFile(path, data, format, repairs)
    data, late = _strip_leading_text(data)
    if is_too_deep(data):
        cause = f"its elements stand in one another more than {DEPTH_LIMIT:,} deep"
        raise SourceParseError(str(path), cause=cause)
    file = SourceFile(path, _make_safe(path, data), RDF_XML, (*repairs, *late))
    if has_conflicting_entities(file.data) or (not is_complete(file.data) and find_xml_error(file.data)):
        return _repair(file)
    return file


# -- letters -----------------------------------------------------------------------------------------------------------


def _as_utf8(data: bytes) -> tuple[bytes, tuple[XmlRepair, ...]]:
    """The file in the one encoding that the parser takes, and what was wrong with its own."""
    mark = next((name for mark, name in _BOMS if data.startswith(mark)), None)
    declared = _DECLARED_ENCODING.match(data)
    encoding = mark or (declared[1].decode("ascii") if declared else "utf-8")
    if encoding.lower() in {"utf-8", "utf8", "us-ascii"}:
        data = data.removeprefix(b"\xef\xbb\xbf")
        return (data, ()) if data.isascii() else _utf8_or_latin(data)
    try:
        if mark is None and _WIDE_ENCODINGS.match(encoding):
            raise UnicodeError("a declaration that can be read as ASCII is in no encoding of wider letters")
        text = data.decode(encoding)
        repairs: tuple[XmlRepair, ...] = ()
    except (LookupError, UnicodeError):
        data, others = _utf8_or_latin(data)
        text = data.decode()
        what = f"it names the encoding {encoding!r}, which it is not in"
        repairs = (XmlRepair(1, what, "it is read as UTF-8"), *others)
    # The declaration would now be wrong; UTF-8 is what XML takes where none is given.
    head, _, rest = text.partition("\n")
    return f"{_DECLARATION.sub('', head, count=1)}\n{rest}".encode("utf-8", "surrogatepass"), repairs


def _utf8_or_latin(data: bytes) -> tuple[bytes, tuple[XmlRepair, ...]]:
    try:
        data.decode()
    except UnicodeDecodeError as error:
        if b"\0" in data[:4096]:
            return data.decode("utf-8", "replace").encode(), ()  # no text at all, as will be said
        line = data.count(b"\n", 0, error.start) + 1
        what = f"the byte {data[error.start]:#04x} is no UTF-8"
        # In Windows' code page every byte but five is a letter, and ISO 8859-1 is a part of it.
        repair = XmlRepair(line, what, "the file is read in Windows' code page 1252")
        return data.decode("cp1252", "replace").encode(), (repair,)
    return data, ()


# -- formats -----------------------------------------------------------------------------------------------------------


def _format(path: Path, data: bytes) -> ox.RdfFormat:
    told = SUFFIXES.get(path.suffix.lower())
    if _TURTLE_START.match(data):
        return TURTLE  # Protégé calls its files .owl whatever is in them
    if told is not None:
        return told
    if _XML_START.match(data):
        return RDF_XML
    if _STATEMENT_START.match(data):
        return TURTLE  # N-Triples is a part of it
    known = ", ".join(SUFFIXES)
    cause = f"neither its suffix {path.suffix!r} nor its beginning tell a format; known are {known}"
    raise SourceParseError(str(path), cause=cause)


# -- XML ---------------------------------------------------------------------------------------------------------------


def _make_safe(path: Path, data: bytes) -> bytes:
    try:
        return expand_safe_entities(data)
    except UnsafeXmlEntity as error:
        raise SourceParseError(str(path), cause=str(error), line=error.line) from error


def _strip_leading_text(data: bytes) -> tuple[bytes, tuple[XmlRepair, ...]]:
    """The document without what stands before it, but for line breaks."""
    start = data.lstrip()
    if start.startswith((b"<?xml", b"<!", b"<")):
        # Blanks before a declaration are forbidden, and the only thing that ever comes of that is an error.
        return data, ()
    found = _LATE_START.search(data)
    if found is None:
        return data, ()
    before = data[: found.start()]
    shown = " ".join(before.decode("utf-8", "replace").split())[:40]
    line = data.count(b"\n", 0, len(data) - len(start)) + 1
    repair = XmlRepair(line, f"the text {shown!r} stands before the document", "it is ignored")
    return b"\n" * before.count(b"\n") + data[found.start() :], (repair,)


def _repair(file: SourceFile) -> SourceFile:
    path = str(file.path)
    try:
        text, repairs = repair_xml(file.data.decode("utf-8", "surrogatepass"))
    except XmlNotRepairable as error:
        # What a strict parser stumbled over first may be one of the things that could have been repaired.
        first = None if error.is_truncated else find_xml_error(file.data)
        cause, line = first or (error.cause, error.line)
        raise SourceParseError(path, cause=cause, line=line) from error
    data = _make_safe(file.path, text.encode("utf-8", "surrogatepass"))
    return replace(file, data=data, repairs=(*file.repairs, *repairs))


def _xml_error(file: SourceFile, cause: str) -> SourceParseError:
    if not file.repairs and (problem := find_xml_error(file.data)):
        return SourceParseError(str(file.path), cause=problem[0], line=problem[1])
    root = first_tag(file.data)
    name = root[1].decode("utf-8", "replace") if root else ""
    if "XML namespaces are required" in cause and root and not name.endswith("RDF"):
        hint = "OWL/XML; save it as RDF/XML or Turtle" if name == "Ontology" else "some other XML"
        line = file.data.count(b"\n", 0, root.start()) + 1
        cause = f"its root element is <{name}>: not RDF/XML but {hint}"
        return SourceParseError(str(file.path), cause=cause, line=line)
    return SourceParseError(str(file.path), cause=cause, line=_failing_line(file))


class _LineReader(io.BytesIO):
    """Hands out one line at a time, so that the parser's stop tells the line."""

    line = 0

    def read(self, size: int | None = -1) -> bytes:
        line = self.readline()
        self.line += bool(line)
        return line


def _failing_line(file: SourceFile) -> int | None:
    lines = _LineReader(file.data)
    try:
        for _ in ox.parse(input=lines, format=file.format, base_iri=file.iri):
            pass
    except SyntaxError:
        return lines.line
    return None


def _without_position(message: str) -> str:
    return re.sub(r"^Parser error at line \d+[^:]*: | \(line \d+\)$", "", message)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One file, or one graph of an endpoint."""

    name: str
    """Its path, or the graph's name."""
    graph: ox.NamedNode | ox.DefaultGraph
    store: QuadSource
    load_text: Callable[[], SourceFile]
    """Gives its text, which may have to be fetched from where it is kept."""
    is_map: bool
    """Whether it was named as a map, and not only imported or given as an ontology."""
    is_explicit: bool
    """Whether it was named at all, and not only imported."""

    @property
    def path(self) -> Path:
        """Where it lies, if it is a file."""
        return Path(self.name)

    def quads(self) -> Iterator[ox.Quad]:
        """What it says, to the letter: the store itself writes numbers its own way."""
        file = self.load_text()
        base = self.graph.value if isinstance(self.graph, ox.NamedNode) else None
        return ox.parse(file.data, file.format, base_iri=base)

    def imported_iris(self) -> list[str]:
        """What it names as its imports, in one order."""
        return sorted(
            quad.object.value for quad in self._quads_with_predicate(IMPORTS) if isinstance(quad.object, ox.NamedNode)
        )

    def maps(self) -> frozenset[Iri]:
        """The maps that it tells of, or of something in them; a label stands for one without a name."""
        nodes: set[object] = {quad.subject for quad in self._quads_with_predicate(TYPE, SEMANTIC_MAP)}
        nodes.update(quad.object for quad in self._quads_with_predicate(DESCRIBED_IN_MAP))
        named = {Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode)}
        return frozenset(named | {Iri(f"_:{node.value}") for node in nodes if isinstance(node, ox.BlankNode)})

    def has_maps(self) -> bool:
        """Whether it tells of a map or of something in one."""
        return any(True for _ in self._quads_with_predicate(DESCRIBED_IN_MAP)) or any(
            True for _ in self._quads_with_predicate(TYPE, SEMANTIC_MAP)
        )

    def has_class_sizes(self) -> bool:
        """Whether it tells how large the things of some class are."""
        return any(True for word in SIZE for _ in self._quads_with_predicate(ON_PROPERTY, word.property))

    def _quads_with_predicate(self, property: Iri, value: Iri | None = None) -> Iterator[ox.Quad]:
        node: ObjectNode | None = None if value is None else ox.NamedNode(value)
        return self.store.quads_for_pattern(None, ox.NamedNode(property), node, self.graph)
