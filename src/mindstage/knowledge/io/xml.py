"""XML: what has to be known of a document before a parser may have it, and why one cannot be parsed.

The parser expands entities without any limit and takes the end of a file for the end of a document, wherever it comes.
"""

from __future__ import annotations

import re
from xml.parsers import expat

__all__ = [
    "DEPTH_LIMIT",
    "ENTITY_LIMIT",
    "EXPANSION_LIMIT",
    "UnsafeXmlEntity",
    "expand_safe_entities",
    "find_xml_error",
    "first_tag",
    "has_conflicting_entities",
    "is_complete",
    "is_too_deep",
]

DEPTH_LIMIT = 10_000
"""Elements inside elements; the parser's time grows with the square of it, and nobody nests a hundred."""
ENTITY_LIMIT = 64 * 1024
"""Bytes that one entity may stand for; namespaces, which they are there for, need a hundred."""
EXPANSION_LIMIT = 8 * 1024 * 1024
"""Bytes that all uses of a file's entities may come to; the XML parser expat draws the same line."""
MAX_SAFE_ENTITY = 256
"""Bytes below which an entity cannot make a file a hundred times as long, as its use takes three."""

_CHUNK = 64 * 1024
_ENTITY = re.compile(rb"""(<!(?i:ENTITY)\s*(%\s+)?([^\s%"'>]+)\s*)(?:("[^"]*"|'[^']*')|(?i:SYSTEM|PUBLIC)\b)""")
_ENTITY_USE = re.compile(rb"&([^\s&;#]+);")
_FIRST_TAG = re.compile(rb"<([^\W\d][^\s/<>]*)")


class UnsafeXmlEntity(ValueError):
    """An entity that must not be expanded."""

    def __init__(self, cause: str, line: int | None = None) -> None:
        self.line = line
        super().__init__(cause)


def expand_safe_entities(data: bytes) -> bytes:
    """The document, in which every entity is short and written as the parser wants it.

    Raises:
        UnsafeXmlEntity: one of them stands in another file, or they would grow beyond all measure.
    """
    if b"<!ENTITY" not in data and b"<!entity" not in data:
        return data
    lengths: dict[bytes, int] = {}
    needs_quotes = False
    for entity in _ENTITY.finditer(data):
        name, quoted = entity[3], entity[4]
        shown = name.decode("utf-8", "replace")
        if quoted is None:
            cause = f"the entity {shown!r} stands in another file; nothing outside is ever fetched"
            raise UnsafeXmlEntity(cause, _line_of(data, entity))
        length = len(quoted) - 2 + sum(lengths.get(used, 0) for used in _ENTITY_USE.findall(quoted))
        lengths[name] = max(length, lengths.get(name, 0))  # whichever of two the parser takes
        if length > ENTITY_LIMIT:
            cause = f"the entity {shown!r} would grow to {length:,} bytes; {ENTITY_LIMIT:,} are allowed"
            raise UnsafeXmlEntity(cause, _line_of(data, entity))
        needs_quotes = needs_quotes or quoted.startswith(b"'")
    if max(lengths.values(), default=0) > MAX_SAFE_ENTITY:
        grown = sum(length * data.count(b"&" + name + b";") for name, length in lengths.items())
        if grown > max(EXPANSION_LIMIT, 100 * len(data)):
            raise UnsafeXmlEntity(f"its entities would grow to {grown:,} bytes")
    return _ENTITY.sub(_double_quoted, data) if needs_quotes else data


def has_conflicting_entities(data: bytes) -> bool:
    """Whether an entity is declared twice, differently: the first counts, but not for the parser."""
    meanings: dict[bytes, bytes] = {}
    return any(meanings.setdefault(entity[3], entity[4][1:-1]) != entity[4][1:-1] for entity in _ENTITY.finditer(data))


def _line_of(data: bytes, entity: re.Match[bytes]) -> int:
    return data.count(b"\n", 0, entity.start()) + 1


def _double_quoted(entity: re.Match[bytes]) -> bytes:
    """XML allows both quotes, the parser only one."""
    if not entity[4].startswith(b"'"):
        return entity[0]
    return entity[1] + b'"' + entity[4][1:-1].replace(b'"', b"&#34;") + b'"'


def first_tag(data: bytes) -> re.Match[bytes] | None:
    """The outermost element's start; its first group is the name."""
    return _FIRST_TAG.search(data)


def is_complete(data: bytes) -> bool:
    """Whether a look at the end tells that the document ends there; if not, only a parser can say."""
    root = first_tag(data)
    if root is None:
        return False
    end = data[-4096:].rstrip()
    while end.endswith(b"-->"):
        end = end[: max(end.rfind(b"<!--"), 0)].rstrip()
    # Where no other element has the name of the outermost one, its end tag is the document's end.
    return end.endswith(b"</" + root[1] + b">") and data.count(b"<" + root[1]) == 1


def is_too_deep(data: bytes) -> bool:
    """Whether far too many elements stand in one another, as counts of tags tell that cost next to no time."""
    depth = 0
    for start in range(0, len(data), _CHUNK):
        piece = data[start : start + _CHUNK]
        ends, others = piece.count(b"</"), piece.count(b"<!") + piece.count(b"<?")
        depth += piece.count(b"<") - 2 * ends - others - piece.count(b"/>")
        if depth > DEPTH_LIMIT:
            return True
    return False


def find_xml_error(data: bytes) -> tuple[str, int] | None:
    """Why it is no XML document, and the line; None where it is one."""
    parser = expat.ParserCreate()
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        return _xml_error_cause(data, error), error.lineno
    return None


def _xml_error_cause(data: bytes, error: expat.ExpatError) -> str:
    codes = expat.errors.codes
    if not data.strip():
        return "it is empty"
    if not first_tag(data):
        return "it is not XML"
    if error.code in {codes[expat.errors.XML_ERROR_NO_ELEMENTS], codes[expat.errors.XML_ERROR_UNCLOSED_TOKEN]}:
        return "it is cut off: the file ends before its outermost element does"
    return f"it is not well-formed XML: {expat.ErrorString(error.code)}"
