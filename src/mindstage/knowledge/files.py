"""Files: from a path to bytes that are safe to parse, and an error with line and cause where that fails.

What the parser itself lets pass is checked here: a file that was cut off, another encoding, entities that blow up.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

import pyoxigraph as ox

from mindstage.errors import SourceUnreadable

__all__ = ["SourceFile", "read_file"]

XML, TURTLE, N_TRIPLES = ox.RdfFormat.RDF_XML, ox.RdfFormat.TURTLE, ox.RdfFormat.N_TRIPLES
SUFFIXES = {".owl": XML, ".rdf": XML, ".xml": XML, ".ttl": TURTLE, ".nt": N_TRIPLES}

ENTITY_LIMIT = 64 * 1024
"""Bytes that one entity may stand for; namespaces, which they are there for, need a hundred."""
EXPANSION_LIMIT = 8 * 1024 * 1024
"""Bytes that all uses of a file's entities may come to; the XML parser expat draws the same line."""
HARMLESS_ENTITY = 256
"""Bytes below which an entity cannot make a file a hundred times as long, as its use takes three."""

_BOMS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_DECLARED_ENCODING = re.compile(rb"""^\s*<\?xml[^>]*?\sencoding\s*=\s*["']([A-Za-z][\w.-]*)["']""")
_ENTITY = re.compile(rb"""(<!ENTITY\s+([^\s%"'>]+)\s*)(?:("[^"]*"|'[^']*')|(?:SYSTEM|PUBLIC)\b)""")
_ENTITY_USE = re.compile(rb"&([^\s&;#]+);")
_FIRST_TAG = re.compile(rb"<([A-Za-z_][^\s/>]*)")
_TURTLE_START = re.compile(rb"(?:\s|#[^\n]*\n)*(?:@prefix|@base|PREFIX|BASE)\s", re.IGNORECASE)
_STATEMENT_START = re.compile(rb"(?:\s|#[^\n]*\n)*(?:<[^<>\"{}|^`\\\s]+>|_:\S+)\s+(?:<[^<>\"{}|^`\\\s]+>|a)\s")


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A file that parses."""

    path: Path
    data: bytes
    """UTF-8."""
    format: ox.RdfFormat

    @property
    def iri(self) -> str:
        """What relative names in it are relative to, and what its graph is called."""
        return self.path.as_uri()

    def unreadable(self, error: SyntaxError) -> SourceUnreadable:
        """What is to be said where the parser gave up on this file."""
        if self.format == XML:
            return _unreadable_xml(self, str(error))
        return SourceUnreadable(str(self.path), cause=_without_place(str(error)), line=error.lineno)


def read_file(path: Path) -> SourceFile:
    """Reads a file and makes sure that parsing it is harmless; whether it parses shows only then.

    Raises:
        SourceUnreadable: it is missing, of no known format, cut off, or dangerous.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise SourceUnreadable(str(path), cause="there is no such file") from error
    except IsADirectoryError as error:
        cause = "it is a folder; name the map's file in it, or give a folder of ROS packages as an ontology"
        raise SourceUnreadable(str(path), cause=cause) from error
    except OSError as error:
        raise SourceUnreadable(str(path), cause=error.strerror or str(error)) from error
    data = _as_utf8(path, data)
    format = _format(path, data)
    if format != XML:
        return SourceFile(path, data, format)
    data = _with_harmless_entities(path, data)
    _check_complete(path, data)
    return SourceFile(path, data, format)


def _as_utf8(path: Path, data: bytes) -> bytes:
    encoding = next((name for mark, name in _BOMS if data.startswith(mark)), None)
    declared = _DECLARED_ENCODING.match(data)
    if encoding is None and declared:
        encoding = declared[1].decode("ascii")
    if encoding is None or encoding.lower() in {"utf-8", "utf8", "us-ascii"}:
        return data.removeprefix(b"\xef\xbb\xbf")
    try:
        text = data.decode(encoding)
    except (LookupError, UnicodeError) as error:
        raise SourceUnreadable(str(path), cause=f"it is not in the encoding {encoding!r} that it names") from error
    # The declaration would now be wrong; UTF-8 is what XML takes where none is given.
    return re.sub(r"^\s*<\?xml.*?\?>", "", text, count=1, flags=re.DOTALL).encode("utf-8", "surrogatepass")


def _format(path: Path, data: bytes) -> ox.RdfFormat:
    told = SUFFIXES.get(path.suffix.lower())
    if _TURTLE_START.match(data):
        return TURTLE  # Protégé calls its files .owl whatever is in them
    if told is not None:
        return told
    if data.lstrip()[:1] == b"<" and re.match(rb"\s*<(\?xml|!|[\w.-]+:RDF\b)", data):
        return XML
    if _STATEMENT_START.match(data):
        return TURTLE  # N-Triples is a part of it
    known = ", ".join(SUFFIXES)
    cause = f"neither its suffix {path.suffix!r} nor its beginning tell a format; known are {known}"
    raise SourceUnreadable(str(path), cause=cause)


# -- XML ---------------------------------------------------------------------------------------------------------------


def _with_harmless_entities(path: Path, data: bytes) -> bytes:
    """Entities are expanded by the parser without any limit, so their lengths are reckoned first."""
    if b"<!ENTITY" not in data:
        return data
    lengths: dict[bytes, int] = {}
    needs_quotes = False
    for entity in _ENTITY.finditer(data):
        line = data.count(b"\n", 0, entity.start()) + 1
        name, quoted = entity[2], entity[3]
        if quoted is None:
            cause = f"the entity {_text(name)!r} stands in another file; nothing outside is ever fetched"
            raise SourceUnreadable(str(path), cause=cause, line=line)
        length = len(quoted) - 2 + sum(lengths.get(used, 0) for used in _ENTITY_USE.findall(quoted))
        lengths[name] = max(length, lengths.get(name, 0))  # whichever of two the parser takes
        if length > ENTITY_LIMIT:
            cause = f"the entity {_text(name)!r} would grow to {length:,} bytes; {ENTITY_LIMIT:,} are allowed"
            raise SourceUnreadable(str(path), cause=cause, line=line)
        needs_quotes = needs_quotes or quoted.startswith(b"'")
    if max(lengths.values(), default=0) > HARMLESS_ENTITY:
        grown = sum(length * data.count(b"&" + name + b";") for name, length in lengths.items())
        if grown > max(EXPANSION_LIMIT, 100 * len(data)):
            raise SourceUnreadable(str(path), cause=f"its entities would grow to {grown:,} bytes")
    return _ENTITY.sub(_double_quoted, data) if needs_quotes else data


def _double_quoted(entity: re.Match[bytes]) -> bytes:
    """XML allows both quotes, the parser only one."""
    if not entity[3].startswith(b"'"):
        return entity[0]
    return entity[1] + b'"' + entity[3][1:-1].replace(b'"', b"&#34;") + b'"'


def _check_complete(path: Path, data: bytes) -> None:
    """The parser takes the end of a file for the end of a document, wherever it comes."""
    if root := _FIRST_TAG.search(data):
        end = data[-4096:].rstrip()
        while end.endswith(b"-->"):
            end = end[: max(end.rfind(b"<!--"), 0)].rstrip()
        # Where no other element has the name of the outermost one, its end tag is the document's end.
        if end.endswith(b"</" + root[1] + b">") and data.count(b"<" + root[1]) == 1:
            return
    if problem := _ill_formed(data):
        raise SourceUnreadable(str(path), cause=problem[0], line=problem[1])


def _ill_formed(data: bytes) -> tuple[str, int] | None:
    parser = expat.ParserCreate()
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        return _plain_cause(data, error), error.lineno
    return None


def _plain_cause(data: bytes, error: expat.ExpatError) -> str:
    codes = expat.errors.codes
    if not data.strip():
        return "it is empty"
    if not _FIRST_TAG.search(data):
        return "it is not XML"
    if error.code in {codes[expat.errors.XML_ERROR_NO_ELEMENTS], codes[expat.errors.XML_ERROR_UNCLOSED_TOKEN]}:
        return "it is cut off: the file ends before its outermost element does"
    return f"it is not well-formed XML: {expat.ErrorString(error.code)}"


def _unreadable_xml(file: SourceFile, cause: str) -> SourceUnreadable:
    if problem := _ill_formed(file.data):
        return SourceUnreadable(str(file.path), cause=problem[0], line=problem[1])
    root = _FIRST_TAG.search(file.data)
    name = _text(root[1]) if root else ""
    if "XML namespaces are required" in cause and name:
        hint = "OWL/XML; save it as RDF/XML or Turtle" if name == "Ontology" else "some other XML"
        line = file.data.count(b"\n", 0, root.start()) + 1 if root else None
        return SourceUnreadable(
            str(file.path), cause=f"its root element is <{name}>: not RDF/XML but {hint}", line=line
        )
    return SourceUnreadable(str(file.path), cause=cause, line=_line_of_failure(file))


class _LineByLine(io.BytesIO):
    """Hands out one line at a time, so that the parser's stop tells the line."""

    line = 0

    def read(self, size: int | None = -1) -> bytes:
        line = self.readline()
        self.line += bool(line)
        return line


def _line_of_failure(file: SourceFile) -> int | None:
    lines = _LineByLine(file.data)
    try:
        for _ in ox.parse(input=lines, format=file.format, base_iri=file.iri):
            pass
    except SyntaxError:
        return lines.line
    return None


def _without_place(message: str) -> str:
    return re.sub(r"^Parser error at line \d+[^:]*: | \(line \d+\)$", "", message)


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace")
