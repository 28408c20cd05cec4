"""Input files of a knowledge base: encoding, format detection, safety checks, repair, and the bundled files.

`read_file` returns bytes that are safe to parse, or raises an error with line and cause. XML errors that SWI-Prolog
tolerates are repaired (see `repair_xml`) and reported. A `Source` is one loaded file or endpoint graph.
"""

from __future__ import annotations

import codecs
import io
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from urllib.parse import quote, unquote

import pyoxigraph as ox

from mindstage.errors import SourceParseError, closest_names
from mindstage.maps.io.xml import (
    DEPTH_LIMIT,
    UnsafeXmlError,
    expand_safe_entities,
    find_xml_error,
    first_tag,
    has_conflicting_entities,
    is_complete,
    is_too_deep,
)
from mindstage.maps.io.xml_repair import XmlRepair, XmlRepairError, repair_xml
from mindstage.maps.rdf_mapping.properties import BOUNDING_BOX, MESH, SIZE
from mindstage.rdf.graphs import Finding, Graph, ObjectNode, QuadSource, Severity, graph_from_quads
from mindstage.rdf.vocabulary import DESCRIBED_IN_MAP, IMPORTS, ON_PROPERTY, ONTOLOGY, RDF, SEMANTIC_MAP, TYPE
from mindstage.scene import Iri

__all__ = [
    "BUNDLED_KITCHEN",
    "SUFFIXES",
    "Source",
    "SourceFile",
    "SourceHeader",
    "bundled_kitchen",
    "bundled_ontology",
    "event_ontology",
    "is_bundled",
    "map_path",
    "old_name",
    "read_file",
    "read_header",
    "read_statements",
    "robot_ontology",
    "soma_alignment",
]


BUNDLED_KITCHEN = "bundled:kitchen"
"""Name under which `KnowledgeBase.load` and all commands of the CLI accept the bundled kitchen."""


RDF_XML, TURTLE, N_TRIPLES = ox.RdfFormat.RDF_XML, ox.RdfFormat.TURTLE, ox.RdfFormat.N_TRIPLES
SUFFIXES = {".owl": RDF_XML, ".rdf": RDF_XML, ".xml": RDF_XML, ".ttl": TURTLE, ".nt": N_TRIPLES}
MAX_REPORTED_REPAIRS = 100
"""Maximum number of repairs of one file that are reported individually; others are counted."""
_MAX_HEADER_STATEMENTS = 50_000
"""The number of statements among which an ontology and the prefixes are looked for."""
_PREFIX_DECLARATION = re.compile(rb"^[ \t]*@?prefix\s", re.IGNORECASE | re.MULTILINE)
_BOMS = (
    *((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe\0\0", "utf-32"), (b"\0\0\xfe\xff", "utf-32")),
    *((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")),
)
_EBCDIC = "cp037"
"""The code page of the declaration: all of EBCDIC have its characters in common."""
_FIRST_CHARACTERS = tuple(
    (re.compile(pattern), name)
    for pattern, name in (
        *((rb"[^\0]\0\0\0[^\0]\0\0\0", "utf-32-le"), (rb"\0\0\0[^\0]\0\0\0[^\0]", "utf-32-be")),
        *((rb"[^\0]\0[^\0]\0", "utf-16-le"), (rb"\0[^\0]\0[^\0]", "utf-16-be")),
        (re.escape("<?xml".encode(_EBCDIC)), _EBCDIC),
    )
)
_HEAD_BYTES = 1000
"""The length of what an XML declaration is looked for in."""
_NOT_OF_DOCUMENTS = frozenset({"idna", "punycode", "unicode_escape", "raw_unicode_escape", "undefined", "utf-7"})
"""Python's codecs of other texts; some of them are slow or drop characters."""
_DECLARED_ENCODING = re.compile(rb"""^\s*<\?xml[^>]*?\sencoding\s*=\s*["']([A-Za-z][\w.-]*)["']""")
_WIDE_ENCODINGS = re.compile(r"utf-?(16|32)|ucs-?[24]", re.IGNORECASE)
_DECLARATION = re.compile(r"^\s*<\?xml.*?\?>", re.DOTALL)
_OLD_NAMESPACE = re.compile(rb"http://ias\.cs\.tum\.edu/kb/(knowrob|srdl2(?:-[a-z]+)?)\.owl(?![^#\"'<>\s])")
_CURRENT_NAMESPACE = re.compile(rb"http://knowrob\.org/kb/(knowrob|srdl2(?:-[a-z]+)?)\.owl(?![^#\"'<>\s])")
_RENAMED = "Names of http://ias.cs.tum.edu/kb are replaced by those of http://knowrob.org/kb, except:"
_RENAMED_NOTE = re.compile(rf"(?:<!--|#) {re.escape(_RENAMED)} (.*?) \.(?: -->)?\n".encode())
_EMPTY_BASE = re.compile(rb"""(<[^<>!?]*)\sxml:base\s*=\s*(?:""|'')""")
_XML_START = re.compile(rb"\s*<(\?xml|!|[\w.-]+:RDF\b)")
_LATE_START = re.compile(rb"<(\?xml\s|!DOCTYPE\s|[\w.-]*:RDF[\s>])")
_TURTLE_START = re.compile(rb"(?:\s|#[^\n]*\n)*(?:@prefix|@base|PREFIX|BASE)\s", re.IGNORECASE)
_STATEMENT_START = re.compile(rb"(?:\s|#[^\n]*\n)*(?:<[^<>\"{}|^`\\\s]+>|_:\S+)\s+(?:<[^<>\"{}|^`\\\s]+>|a)\s")


def map_path(name: str | os.PathLike[str]) -> str:
    """Returns the path of a map; the name of the bundled kitchen is replaced by its path.

    Raises:
        SourceParseError: no map of that name is bundled.
    """
    path = os.fspath(name)
    if path == BUNDLED_KITCHEN:
        return os.fspath(bundled_kitchen())
    if path.lower().startswith("bundled:") and not Path(path).exists():
        meant = closest_names(path, (BUNDLED_KITCHEN,))
        hint = f"did you mean {meant[0]}?" if meant else f"there is {BUNDLED_KITCHEN}"
        raise SourceParseError(path, cause=f"no map of that name is bundled; {hint}")
    return path


def _bundled_hint(path: Path) -> str:
    """What to write instead of a missing file whose name is similar to that of the bundled kitchen."""
    name = path.name.removesuffix(".owl").lower()
    meant = closest_names(name, (BUNDLED_KITCHEN.partition(":")[2],))
    return f"; did you mean {BUNDLED_KITCHEN}?" if meant else ""


def bundled_kitchen() -> Path:
    """Returns the path of the bundled kitchen, a map of dialect 1."""
    return _bundled_path("kitchen.owl")


def bundled_ontology() -> Path:
    """Returns the path of the bundled household ontology, which every `KnowledgeBase` loads by default."""
    return _bundled_path("household.ttl")


def soma_alignment() -> Path:
    """Returns the path of the bundled alignment of SOMA's and DUL's terms with those of the household ontology."""
    return _bundled_path("soma.ttl")


def event_ontology() -> Path:
    """Returns the path of the bundled classes of events, which a knowledge base loads with its first episode."""
    return _bundled_path("events.ttl")


def robot_ontology() -> Path:
    """Returns the path of the bundled components and capabilities of robots, which questions about abilities read."""
    return _bundled_path("robots.ttl")


def is_bundled(path: Path, bundled: Path) -> bool:
    """Whether a path is that of a bundled file, in this installation or in the one that wrote a store folder."""
    return path == bundled or (path.name, path.parent.name) == (bundled.name, bundled.parent.name)


def _bundled_path(name: str) -> Path:
    # Wheels are always unpacked, so package data are files.
    return Path(__file__).parents[1] / "bundled" / name


def _unpickled_file(path: Path, data: bytes, media_type: str, repairs: tuple[XmlRepair, ...]) -> SourceFile:
    format = ox.RdfFormat.from_media_type(media_type)
    assert format is not None
    return SourceFile(path, data, format, repairs)


def same_file(file: SourceFile) -> SourceFile:
    """Returns the file; with `partial` it is a `Source.load_text` that can be pickled."""
    return file


@dataclass(frozen=True, slots=True)
class SourceFile:
    """The contents of a file in UTF-8; whether it parses is not known until it is parsed."""

    path: Path
    data: bytes
    """Contents, in UTF-8."""
    format: ox.RdfFormat
    repairs: tuple[XmlRepair, ...] = ()
    """Changes that were made to the contents so that they parse."""

    def __reduce__(self) -> tuple[Callable[..., SourceFile], tuple[object, ...]]:
        return _unpickled_file, (self.path, self.data, self.format.media_type, self.repairs)

    @property
    def iri(self) -> str:
        """Base IRI of the file."""
        return self.path.as_uri()

    def findings(self) -> list[Finding]:
        """Returns the findings about its repairs."""
        findings = [
            self._finding(f"line {line}: {problem}", action)
            for line, problem, action in self.repairs[:MAX_REPORTED_REPAIRS]
        ]
        if more := len(self.repairs) - len(findings):
            findings.append(self._finding(f"{more:,} more places like these", "they are read in the same way"))
        return findings

    def repair(self, error: SyntaxError) -> SourceFile:
        """Returns the file repaired as SWI-Prolog would read it.

        Args:
            error: the parser's error about the file as it is.

        Raises:
            SourceParseError: it cannot be repaired.
        """
        is_rdf = RDF.encode() in self.data or _LATE_START.search(self.data)
        if self.format != RDF_XML or not is_rdf:
            raise self.parse_error(error) from error
        return _repair(self)

    def parse_error(self, error: SyntaxError) -> SourceParseError:
        """Converts a parser's error about this file to a `SourceParseError` with line and cause."""
        if self.format == RDF_XML:
            return _xml_error(self, str(error))
        return SourceParseError(str(self.path), cause=_without_position(str(error)), line=error.lineno)

    def _finding(self, problem: str, action: str) -> Finding:
        return Finding(Severity.WARNING, str(self.path), "", problem, action)


def read_file(path: Path) -> SourceFile:
    """Reads a file and checks that it is safe to parse.

    Raises:
        SourceParseError: it does not exist, is truncated or unsafe, or its format is unknown.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise SourceParseError(str(path), cause=f"there is no such file{_bundled_hint(path)}") from error
    except IsADirectoryError as error:
        cause = "it is a folder; give the map file in it, or give a folder of ROS packages as an ontology"
        raise SourceParseError(str(path), cause=cause) from error
    except OSError as error:
        raise SourceParseError(str(path), cause=error.strerror or str(error)) from error
    data, repairs = _as_utf8(data)
    format = _format(path, data)
    data, old = _with_current_namespaces(path, data, format)
    repairs = (*repairs, *old)
    if format != RDF_XML:
        return SourceFile(path, data, format, repairs)
    data, late = _strip_leading_text(data)
    data = _EMPTY_BASE.sub(rb"\1", data) if b"xml:base" in data else data
    if is_too_deep(data):
        cause = f"its elements are nested more than {DEPTH_LIMIT:,} deep"
        raise SourceParseError(str(path), cause=cause)
    file = SourceFile(path, _make_safe(path, data), RDF_XML, (*repairs, *late))
    if has_conflicting_entities(file.data) or (not is_complete(file.data) and find_xml_error(file.data)):
        return _repair(file)
    return file


def read_statements(path: Path) -> Graph:
    """Returns the statements of one file of RDF/XML, Turtle or N-Triples, without what it imports.

    Raises:
        SourceParseError: it does not exist, cannot be parsed, or has a statement about a statement (RDF 1.2).
    """
    file = read_file(path.absolute())
    try:
        quads = list(ox.parse(file.data, file.format, base_iri=file.iri))
    except SyntaxError as error:
        file = file.repair(error)
        try:
            quads = list(ox.parse(file.data, file.format, base_iri=file.iri))
        except SyntaxError as again:
            raise file.parse_error(again) from again
    try:
        return graph_from_quads(quads, set())
    except ValueError as error:
        raise SourceParseError(str(path), cause=str(error)) from error


@dataclass(frozen=True, slots=True)
class SourceHeader:
    """What a file declares about itself."""

    ontology: str = ""
    """The IRI of the first ontology that it declares; empty without one, or if that is relative to the file."""
    prefixes: Mapping[str, str] = field(default_factory=dict)


def read_header(file: SourceFile) -> SourceHeader:
    """Returns the ontology and the prefixes that a file declares among its first statements."""
    with_ontology = b"Ontology" in file.data
    data = file.data
    if with_ontology and file.format == N_TRIPLES:
        data = _ontology_line(data)  # it may be anywhere
    expected_prefixes = 0 if file.format == RDF_XML else len(_PREFIX_DECLARATION.findall(data))
    parser = ox.parse(data, file.format, base_iri=file.iri)
    ontology = ""
    try:
        for quad in islice(parser, _MAX_HEADER_STATEMENTS):
            if not ontology and quad.predicate.value == TYPE and quad.object == ox.NamedNode(ONTOLOGY):
                ontology = quad.subject.value if isinstance(quad.subject, ox.NamedNode) else ""
            if (ontology or not with_ontology) and len(parser.prefixes) >= expected_prefixes:
                break
    except (SyntaxError, ValueError, MemoryError):
        pass  # loading the file reports the error
    return SourceHeader("" if ontology.startswith("file:") else ontology, parser.prefixes)


def _ontology_line(data: bytes) -> bytes:
    """The line of N-Triples that declares an ontology; all of the data if there is none."""
    at = data.find(f"<{ONTOLOGY}>".encode())
    return data if at < 0 else data[data.rfind(b"\n", 0, at) + 1 : data.find(b"\n", at) + 1 or len(data)]


# -- encodings ---------------------------------------------------------------------------------------------------------


def _as_utf8(data: bytes) -> tuple[bytes, tuple[XmlRepair, ...]]:
    """Converts a file to UTF-8, and returns repairs of a wrong encoding.

    The encoding is that of the byte order mark, or of the pattern that the first characters of a document have in it
    (XML 1.0, appendix F), or else the declared one, of those that Python has.
    """
    found = next((name for mark, name in _BOMS if data.startswith(mark)), None)
    found = found or next((name for start, name in _FIRST_CHARACTERS if start.match(data)), None)
    is_ebcdic = found == _EBCDIC
    declared = _DECLARED_ENCODING.match(data[:_HEAD_BYTES].decode(_EBCDIC).encode() if is_ebcdic else data)
    name = declared[1].decode("ascii") if declared else ""
    encoding = name if is_ebcdic and name else found or name or "utf-8"
    if _codec_name(encoding) == "utf-8":
        data = data.removeprefix(b"\xef\xbb\xbf")
        data, repairs = (data, ()) if data.isascii() else _utf8_or_latin(data)
        return (data if name.lower() in {"", "utf-8"} else _without_declaration(data.decode()).encode()), repairs
    try:
        if found is None and _WIDE_ENCODINGS.match(encoding):
            raise UnicodeError("the declaration is readable as ASCII, so the file is not in a wide encoding")
        if is_ebcdic and not _codec_name(encoding):
            text = data.decode(_EBCDIC)
            problem = f"its encoding {encoding!r} is not known"
            repairs = (XmlRepair(1, problem, f"it is read as {_EBCDIC}"),)
        else:
            text, repairs = data.decode(_codec_name(encoding) or encoding), ()
    except (LookupError, UnicodeError):
        data, others = _utf8_or_latin(data)
        text = data.decode()
        problem = f"it declares the encoding {encoding!r}, but is not in that encoding"
        repairs = (XmlRepair(1, problem, "it is read as UTF-8"), *others) if name else others
    if is_ebcdic:
        text = text.replace("\x85", "\n")  # its line feed, which is not white space in XML
    return _without_declaration(text).encode("utf-8", "surrogatepass"), repairs


def _codec_name(encoding: str) -> str:
    """The name of Python's codec of an encoding of documents; empty if it has none."""
    try:
        name = codecs.lookup(encoding).name
    except (LookupError, ValueError):
        return ""
    return "" if name in _NOT_OF_DOCUMENTS else name


def _without_declaration(text: str) -> str:
    """The text without its XML declaration, whose encoding is wrong after a conversion; UTF-8 is the default of XML."""
    return _DECLARATION.sub(lambda found: "\n" * found[0].count("\n"), text, count=1)


def _utf8_or_latin(data: bytes) -> tuple[bytes, tuple[XmlRepair, ...]]:
    try:
        data.decode()
    except UnicodeDecodeError as error:
        if b"\0" in data[:4096]:
            return data.decode("utf-8", "replace").encode(), ()  # binary; the parser reports it
        line = data.count(b"\n", 0, error.start) + 1
        problem = f"the byte {data[error.start]:#04x} is not valid UTF-8"
        # Code page 1252 contains ISO 8859-1 and defines all bytes but five.
        repair = XmlRepair(line, problem, "the file is read as code page 1252")
        return data.decode("cp1252", "replace").encode(), (repair,)
    return data, ()


# -- namespaces --------------------------------------------------------------------------------------------------------


def _with_current_namespaces(path: Path, data: bytes, format: ox.RdfFormat) -> tuple[bytes, tuple[XmlRepair, ...]]:
    """Replaces the namespaces of KnowRob until 2013 by those of today, which have the same terms.

    A comment at the end says so, by which `Source.current_names` finds how the names were written.
    """
    first = _OLD_NAMESPACE.search(data)
    if first is None:
        return data, ()
    replaced = _OLD_NAMESPACE.sub(rb"http://knowrob.org/kb/\1.owl", data)
    current: set[str] = set()
    if _CURRENT_NAMESPACE.search(data):  # both are used: those names stay as they are
        try:
            current = set(_names_in(_CURRENT_NAMESPACE, ox.parse(data, format, base_iri=path.as_uri())))
        except (SyntaxError, ValueError):
            current = set()
    kept = " ".join(quote(name, safe="#/:").replace("--", "-%2D") for name in sorted(current))
    note = f"{_RENAMED} {kept} ."
    comment = f"\n<!-- {note} -->\n" if format == RDF_XML else f"\n# {note}\n"
    line = data.count(b"\n", 0, first.start()) + 1
    problem = f"it uses the namespace {first[0].decode()}#, which KnowRob had until 2013"
    repair = XmlRepair(line, problem, "its terms are read as those of http://knowrob.org, and written as they were")
    return replaced + comment.encode(), (repair,)


def _names_in(namespace: re.Pattern[bytes], quads: Iterable[ox.Quad]) -> Iterator[str]:
    for quad in quads:
        for node in quad.triple:
            if isinstance(node, ox.NamedNode) and namespace.match(node.value.encode()):
                yield node.value


def old_name(name: str) -> str:
    """The IRI that a term of KnowRob, or its ontology, had until 2013; other IRIs stay as they are."""
    found = _CURRENT_NAMESPACE.match(name.encode())
    return f"http://ias.cs.tum.edu/kb/{found[1].decode()}.owl{name[found.end() :]}" if found else name


# -- formats -----------------------------------------------------------------------------------------------------------


def _format(path: Path, data: bytes) -> ox.RdfFormat:
    suffix_format = SUFFIXES.get(path.suffix.lower())
    if _TURTLE_START.match(data):
        return TURTLE  # Protégé uses .owl for every format
    if suffix_format is not None:
        return suffix_format
    if _XML_START.match(data):
        return RDF_XML
    if _STATEMENT_START.match(data):
        return TURTLE  # N-Triples is a subset of it
    known = ", ".join(SUFFIXES)
    cause = f"neither its suffix {path.suffix!r} nor its contents indicate a format; known suffixes: {known}"
    raise SourceParseError(str(path), cause=cause)


# -- XML ---------------------------------------------------------------------------------------------------------------


def _make_safe(path: Path, data: bytes) -> bytes:
    try:
        return expand_safe_entities(data)
    except UnsafeXmlError as error:
        raise SourceParseError(str(path), cause=str(error), line=error.line) from error


def _strip_leading_text(data: bytes) -> tuple[bytes, tuple[XmlRepair, ...]]:
    """Removes text before the document, keeping line breaks."""
    start = data.lstrip()
    if start.startswith((b"<?xml", b"<!", b"<")):
        # XML forbids white space before the declaration; the parser reports it.
        return data, ()
    found = _LATE_START.search(data)
    if found is None:
        return data, ()
    before = data[: found.start()]
    shown = " ".join(before.decode("utf-8", "replace").split())[:40]
    line = data.count(b"\n", 0, len(data) - len(start)) + 1
    repair = XmlRepair(line, f"there is text before the document: {shown!r}", "it is ignored")
    return b"\n" * before.count(b"\n") + data[found.start() :], (repair,)


def _repair(file: SourceFile) -> SourceFile:
    path = str(file.path)
    try:
        text, repairs = repair_xml(file.data.decode("utf-8", "surrogatepass"))
    except XmlRepairError as error:
        # The strict parser's first error may be one that can be repaired.
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
        hint = "OWL/XML; save it as RDF/XML or Turtle" if name == "Ontology" else "another XML format"
        line = file.data.count(b"\n", 0, root.start()) + 1
        cause = f"its root element is <{name}>: not RDF/XML but {hint}"
        return SourceParseError(str(file.path), cause=cause, line=line)
    return SourceParseError(str(file.path), cause=cause, line=_failing_line(file))


class _LineReader(io.BytesIO):
    """Returns one line per read, so that `line` is the line of a parser's error."""

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
    """A loaded file, or a graph of a SPARQL endpoint."""

    name: str
    """Path of the file, or IRI of the graph."""
    graph: ox.NamedNode | ox.DefaultGraph
    store: QuadSource
    load_text: Callable[[], SourceFile]
    """Returns the text, which may be read from a store folder."""
    is_map: bool
    """Whether it was given as a map, not as an ontology or by an import."""
    is_explicit: bool
    """Whether it was given by the user, not by an import."""
    header: SourceHeader = SourceHeader()

    def __reduce__(self) -> tuple[type[Source], tuple[object, ...]]:
        """The text is part of a pickled source, also if it is in a store folder."""
        text = partial(same_file, self.load_text())
        return Source, (self.name, self.graph, self.store, text, self.is_map, self.is_explicit, self.header)

    @property
    def path(self) -> Path:
        """Path of the file; meaningless for a graph of an endpoint."""
        return Path(self.name)

    def quads(self) -> Iterator[ox.Quad]:
        """Yields its statements with literals as written: the store normalizes numbers."""
        file = self.load_text()
        return ox.parse(file.data, file.format, base_iri=file.iri if file.path.is_absolute() else None)

    def imported_iris(self) -> list[str]:
        """Returns the IRIs that it imports, sorted."""
        return sorted(
            quad.object.value for quad in self._quads_with_predicate(IMPORTS) if isinstance(quad.object, ox.NamedNode)
        )

    def import_names(self) -> set[str]:
        """Returns what it imports, also if that is stated as a text instead of an IRI."""
        named = (quad.object for quad in self._quads_with_predicate(IMPORTS))
        return {name.value for name in named if isinstance(name, ox.NamedNode | ox.Literal)}

    def maps(self) -> frozenset[Iri]:
        """Returns the maps that it describes or has members of; an unnamed map is given by its blank node label."""
        nodes: set[object] = {quad.subject for quad in self._quads_with_predicate(TYPE, SEMANTIC_MAP)}
        nodes.update(quad.object for quad in self._quads_with_predicate(DESCRIBED_IN_MAP))
        named = {Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode)}
        return frozenset(named | {Iri(f"_:{node.value}") for node in nodes if isinstance(node, ox.BlankNode)})

    def current_names(self) -> frozenset[str] | None:
        """Returns the names that are written in today's namespaces of KnowRob, if all others are in the old ones."""
        data = self.load_text().data
        found = _RENAMED_NOTE.search(data) if _RENAMED.encode() in data else None
        return None if found is None else frozenset(map(unquote, found[1].decode().split()))

    def has_maps(self) -> bool:
        """Whether it describes a map or a member of one."""
        return any(True for _ in self._quads_with_predicate(DESCRIBED_IN_MAP)) or any(
            True for _ in self._quads_with_predicate(TYPE, SEMANTIC_MAP)
        )

    def has_class_geometry(self) -> bool:
        """Whether it gives sizes or meshes for all members of a class."""
        of_members = (*SIZE, BOUNDING_BOX, MESH)
        return any(
            True for codec in of_members for _ in self._quads_with_predicate(ON_PROPERTY, codec.property)
        ) or any(True for codec in of_members for _ in self._quads_with_predicate(codec.property))

    def terms_of(self, namespaces: tuple[str, ...]) -> list[Iri]:
        """Returns the classes of its individuals in these namespaces, or else the first other name there; sorted."""
        classes = {
            quad.object.value for quad in self._quads_with_predicate(TYPE) if isinstance(quad.object, ox.NamedNode)
        }
        if found := sorted(Iri(name) for name in classes if name.startswith(namespaces)):
            return found
        quads = self.store.quads_for_pattern(None, None, None, self.graph)
        names = (node.value for quad in quads for node in quad.triple if isinstance(node, ox.NamedNode))
        return [Iri(name) for name in islice((name for name in names if name.startswith(namespaces)), 1)]

    def _quads_with_predicate(self, property: Iri, value: Iri | None = None) -> Iterator[ox.Quad]:
        node: ObjectNode | None = None if value is None else ox.NamedNode(value)
        return self.store.quads_for_pattern(None, ox.NamedNode(property), node, self.graph)
