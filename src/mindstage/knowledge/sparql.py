"""SPARQL: queries straight on the store, over all sources at once, that end in time."""

from __future__ import annotations

import threading

import msgspec
import pyoxigraph as ox

from mindstage.errors import QueryRefused, QueryTimedOut
from mindstage.knowledge.reasoning.namebook import PREFIXES

__all__ = ["Table", "Term", "run_query"]


class Term(msgspec.Struct, frozen=True, omit_defaults=True):
    """One value of a solution."""

    kind: str
    """iri, blank, literal or triple."""
    value: str
    datatype: str | None = None
    language: str | None = None


class Table(msgspec.Struct, frozen=True):
    """What a query found: a truth (ASK), triples (CONSTRUCT, DESCRIBE) or solutions (SELECT)."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Term | None, ...], ...]
    truth: bool | None = None
    """The answer of ASK, and None of any other."""


def run_query(store: ox.Store, query: str, *, timeout_s: float) -> Table:
    """Runs a query in a thread of its own, which nobody waits for longer than that.

    The store offers no way to stop a query: one that ran out of time goes on unseen until the process ends, and its
    result is dropped.

    Raises:
        QueryRefused: it is no query.
        QueryTimedOut: it did not end in time.
    """
    result: list[Table | Exception] = []

    def work() -> None:
        try:
            result.append(_answered(store, query))
        except Exception as error:  # told to whoever waits
            # Without its traceback, which holds what only this thread may let go of.
            result.append(error.with_traceback(None))

    thread = threading.Thread(target=work, name="SPARQL", daemon=True)
    thread.start()
    thread.join(timeout_s)
    if not result:
        raise QueryTimedOut(timeout_s=timeout_s)
    match result[0]:
        case SyntaxError() as error:
            remedy = "it must be a SELECT, ASK, CONSTRUCT or DESCRIBE of SPARQL 1.1"
            raise QueryRefused(_cause(error), remedy=remedy) from error
        case ValueError() | OSError() | RuntimeError() as error:
            raise QueryRefused(str(error)) from error
        case Exception() as error:
            raise error
        case table:
            return table


def _answered(store: ox.Store, query: str) -> Table:
    found = store.query(query, prefixes=PREFIXES, use_default_graph_as_union=True)
    match found:
        case ox.QuerySolutions():
            names = tuple(variable.value for variable in found.variables)
            return Table(names, tuple(tuple(_term(solution[name]) for name in names) for solution in found))
        case ox.QueryTriples():
            triples = dict.fromkeys(found)
            return Table(
                ("subject", "predicate", "object"),
                tuple((_term(each.subject), _term(each.predicate), _term(each.object)) for each in triples),
            )
        case _:
            return Table((), (), bool(found))


def _cause(error: Exception) -> str:
    """What the parser says, without the hundred things that it would have taken instead."""
    place, _, expected = str(error).partition(": expected ")
    if "Prefix not found" in expected:
        return f"{place}: the prefix is not declared"
    return f"{place}: expected {expected}" if 0 < len(expected) < 40 else place


def _term(value: object) -> Term | None:
    match value:
        case None:
            return None
        case ox.NamedNode():
            return Term("iri", value.value)
        case ox.BlankNode():
            return Term("blank", value.value)
        case ox.Literal():
            return Term("literal", value.value, value.datatype.value, value.language)
        case _:
            return Term("triple", str(value))
