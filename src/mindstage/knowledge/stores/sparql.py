"""SPARQL: what a query may ask for, and what it found."""

from __future__ import annotations

import re
from collections.abc import Iterable

import msgspec
import pyoxigraph as ox

from mindstage.errors import SparqlSyntaxError
from mindstage.knowledge.reasoning.namebook import PREFIXES

__all__ = [
    "PREFIXES",
    "RdfTerm",
    "SparqlResult",
    "check_query",
    "short_syntax_error",
    "solutions_table",
    "term_from_node",
    "triples_table",
]


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


# -- what may be asked -------------------------------------------------------------------------------------------------

_STRING_LITERALS = re.compile(
    r'''\\.|"""(?:[^"\\]|\\.|"(?!""))*"""|\'\'\'(?:[^'\\]|\\.|'(?!''))*\'\'\''''
    r"""|"(?:[^"\\\n\r]|\\.)*"|'(?:[^'\\\n\r]|\\.)*'|<[^<>"{}|^`\\\x00-\x20]*>|\#[^\n\r]*""",
    re.DOTALL,
)
"""Escapes, strings, IRIs and comments, in which a word means nothing."""
_NAMES = re.compile(r"[?$@][\w-]+|(?<![\w.-])(?!service\b)[\w.-]*:[\w.:%-]*", re.IGNORECASE)
_SERVICE = re.compile(r"(?<!\w)SERVICE(?!\w)", re.IGNORECASE)
_UPDATE = re.compile(
    r"(?:\s|\b(?:BASE|PREFIX)\b)*(INSERT|DELETE|LOAD|CLEAR|CREATE|DROP|COPY|MOVE|ADD|WITH)\b", re.IGNORECASE
)
_CODE_POINT = re.compile(r"\\u([0-9a-fA-F]{4})|\\U000([0-9a-fA-F]{5})")


def check_query(query: str, *, allow_service: bool) -> None:
    """Refuses what changes the store, and what asks other servers where nobody allowed it.

    In doubt it takes a word for SERVICE: a prefix of that name, say.

    Raises:
        SparqlSyntaxError: it is an update, or asks another server.
    """
    for text in {query, _CODE_POINT.sub(lambda code: chr(int(code[1] or code[2], 16)), query)}:
        words = _NAMES.sub(" ", _STRING_LITERALS.sub(" ", text))
        if update := _UPDATE.match(words):
            cause = f"it is an update ({update[1].upper()}), and queries only read"
            raise SparqlSyntaxError(cause, remedy="statements are added and taken back with tell and retract")
        if _SERVICE.search(words) and not allow_service:
            remedy = "allow it with --allow-service (in Python: allow_service=True)"
            raise SparqlSyntaxError("it asks another server (SERVICE), and nothing is fetched unasked", remedy=remedy)


def short_syntax_error(message: str) -> str:
    """What the parser says, without the hundred things that it would have taken instead."""
    place, _, expected = message.partition(": expected ")
    if "Prefix not found" in expected:
        return f"{place}: the prefix is not declared"
    return f"{place}: expected {expected}" if 0 < len(expected) < 40 and expected != "[_]" else place


# -- what was found ----------------------------------------------------------------------------------------------------


def solutions_table(json: bytes) -> SparqlResult:
    """What SELECT or ASK found, from SPARQL's own JSON.

    Raises:
        SyntaxError: it is none.
    """
    found = ox.parse_query_results(json, ox.QueryResultsFormat.JSON)
    if isinstance(found, ox.QueryBoolean):
        return SparqlResult((), (), bool(found))
    names = tuple(variable.value for variable in found.variables)
    return SparqlResult(names, tuple(tuple(_parse_binding(solution[name]) for name in names) for solution in found))


def triples_table(triples: Iterable[ox.Quad]) -> SparqlResult:
    """What CONSTRUCT or DESCRIBE found, each triple once."""
    rows = tuple(
        (term_from_node(each.subject), term_from_node(each.predicate), term_from_node(each.object))
        for each in dict.fromkeys(triples)
    )
    return SparqlResult(("subject", "predicate", "object"), rows)


def _parse_binding(value: object) -> RdfTerm | None:
    return None if value is None else term_from_node(value)


def term_from_node(value: object) -> RdfTerm:
    """A node of the store as plain data."""
    match value:
        case ox.NamedNode():
            return RdfTerm("iri", value.value)
        case ox.BlankNode():
            return RdfTerm("blank", value.value)
        case ox.Literal():
            return RdfTerm("literal", value.value, value.datatype.value, value.language)
        case _:
            return RdfTerm("triple", str(value))
