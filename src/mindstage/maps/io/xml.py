"""Safety checks of XML documents before they are parsed, and the cause of XML errors.

The RDF parser expands entities without a limit and accepts a document that ends in the middle of an element.
"""

from __future__ import annotations

import re
from xml.parsers import expat

__all__ = [
    "DEPTH_LIMIT",
    "ENTITY_LIMIT",
    "EXPANSION_LIMIT",
    "UnsafeXmlError",
    "expand_safe_entities",
    "external_reference",
    "find_xml_error",
    "first_tag",
    "has_conflicting_entities",
    "is_complete",
    "is_too_deep",
]

DEPTH_LIMIT = 10_000
"""Maximum depth of elements: the parser's time is quadratic in it, and real files have less than a hundred."""
ENTITY_LIMIT = 64 * 1024
"""Maximum size of an expanded entity [bytes]; namespaces, the usual entities, need about a hundred."""
EXPANSION_LIMIT = 8 * 1024 * 1024
"""Maximum size of all expanded entities of a file [bytes]; the limit of expat is the same."""
MAX_SAFE_ENTITY = 256
"""Size [bytes] below which entities cannot make a file a hundred times longer, as each use takes three."""

_CHUNK_BYTES = 64 * 1024
_ENTITY = re.compile(rb"""(<!(?i:ENTITY)\s*(%\s+)?([^\s%"'>]+)\s*)(?:("[^"]*"|'[^']*')|(?i:SYSTEM|PUBLIC)\b)""")
_ENTITY_USE = re.compile(rb"&([^\s&;#]+);")
_EXTERNAL_SUBSET = re.compile(
    rb"""\s*(?:<\?.*?\?>\s*|<!--.*?-->\s*)*<!DOCTYPE\s+[^\s>\[]+\s+(?:SYSTEM|PUBLIC\s*(?:"[^"]*"|'[^']*'))\s*"""
    rb"""("[^"]*"|'[^']*')""",
    re.DOTALL,
)
_XINCLUDE = re.compile(rb"""=\s*["']http://www\.w3\.org/200[13]/XInclude["']""")
_FIRST_TAG = re.compile(rb"<([^\W\d][^\s/<>]*)")


class UnsafeXmlError(ValueError):
    """An entity that is external or expands to too much."""

    def __init__(self, cause: str, line: int | None = None) -> None:
        self.line = line
        super().__init__(cause)


def expand_safe_entities(data: bytes) -> bytes:
    """Checks the entities of a document, and quotes their values as the RDF parser requires.

    Raises:
        UnsafeXmlError: an entity refers to another file, or the entities expand to too much.
    """
    if b"<!ENTITY" not in data and b"<!entity" not in data:
        return data
    lengths: dict[bytes, int] = {}
    needs_quotes = False
    for entity in _ENTITY.finditer(data):
        name, quoted = entity[3], entity[4]
        shown = name.decode("utf-8", "replace")
        if quoted is None:
            cause = f"the entity {shown!r} refers to another file; external entities are never fetched"
            raise UnsafeXmlError(cause, _line_of(data, entity))
        length = len(quoted) - 2 + sum(lengths.get(used, 0) for used in _ENTITY_USE.findall(quoted))
        lengths[name] = max(length, lengths.get(name, 0))  # of two declarations, the parser may use either
        if length > ENTITY_LIMIT:
            cause = f"the entity {shown!r} would expand to {length:,} bytes; {ENTITY_LIMIT:,} are allowed"
            raise UnsafeXmlError(cause, _line_of(data, entity))
        needs_quotes = needs_quotes or quoted.startswith(b"'")
    if max(lengths.values(), default=0) > MAX_SAFE_ENTITY:
        grown = sum(length * data.count(b"&" + name + b";") for name, length in lengths.items())
        if grown > max(EXPANSION_LIMIT, 100 * len(data)):
            raise UnsafeXmlError(f"its entities would expand to {grown:,} bytes")
    return _ENTITY.sub(_double_quoted, data) if needs_quotes else data


def external_reference(data: bytes) -> str:
    """Says which other document an XML document refers to by its type or by XInclude; empty if to none.

    Neither is ever read. External entities are refused by `expand_safe_entities`.
    """
    if subset := _EXTERNAL_SUBSET.match(data):
        return f"has the document type {subset[1][1:-1].decode('utf-8', 'replace')}"
    if data.lstrip().startswith(b"<") and _XINCLUDE.search(data):
        return "includes other documents (XInclude)"
    return ""


def has_conflicting_entities(data: bytes) -> bool:
    """Whether an entity is declared twice with different values: XML uses the first, the RDF parser does not."""
    meanings: dict[bytes, bytes] = {}
    return any(meanings.setdefault(entity[3], entity[4][1:-1]) != entity[4][1:-1] for entity in _ENTITY.finditer(data))


def _line_of(data: bytes, entity: re.Match[bytes]) -> int:
    return data.count(b"\n", 0, entity.start()) + 1


def _double_quoted(entity: re.Match[bytes]) -> bytes:
    """Quotes an entity's value with double quotes; the RDF parser does not accept single ones."""
    if not entity[4].startswith(b"'"):
        return entity[0]
    return entity[1] + b'"' + entity[4][1:-1].replace(b'"', b"&#34;") + b'"'


def first_tag(data: bytes) -> re.Match[bytes] | None:
    """Matches the start of the root element; group 1 is its name."""
    return _FIRST_TAG.search(data)


def is_complete(data: bytes) -> bool:
    """Whether the last bytes show that the document is complete; if not, it has to be parsed to find out."""
    root = first_tag(data)
    if root is None:
        return False
    end = data[-4096:].rstrip()
    while end.endswith(b"-->"):
        end = end[: max(end.rfind(b"<!--"), 0)].rstrip()
    # If no other element has the root's name, its end tag ends the document.
    return end.endswith(b"</" + root[1] + b">") and data.count(b"<" + root[1]) == 1


def is_too_deep(data: bytes) -> bool:
    """Whether elements are nested too deep, estimated from the numbers of tags, which is fast."""
    depth = 0
    for start in range(0, len(data), _CHUNK_BYTES):
        chunk = data[start : start + _CHUNK_BYTES]
        ends, others = chunk.count(b"</"), chunk.count(b"<!") + chunk.count(b"<?")
        depth += chunk.count(b"<") - 2 * ends - others - chunk.count(b"/>")
        if depth > DEPTH_LIMIT:
            return True
    return False


def find_xml_error(data: bytes) -> tuple[str, int] | None:
    """Returns the cause and the line of the first XML error, or None if the document is well-formed."""
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
        return "it is truncated: the file ends before its root element does"
    return f"it is not well-formed XML: {expat.ErrorString(error.code)}"
