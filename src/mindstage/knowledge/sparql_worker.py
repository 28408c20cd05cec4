"""The process that evaluates SPARQL queries, so that a query can be limited in time, in memory and to the store.

It is a fork of the process that owns the store, or, for a store on disk, runs this file as a script; the file therefore
imports little beside the store. A timer in the process itself ends a query, even if the parent has died.

The store's parser, not a pattern on the text, decides whether a query has a SERVICE clause: the word is replaced by
another one wherever it occurs, in names and strings too, and a query without the clause is still valid afterwards.
The process is also denied sockets by the operating system, where it can be.
"""

from __future__ import annotations

import os
import re
import secrets
import signal
import sys
from collections.abc import Collection
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pyoxigraph as ox

from mindstage.sandbox import deny_network

if sys.platform != "win32":
    import resource

__all__ = ["MEMORY_LIMIT", "REPLY_LIMIT", "serve"]

MEMORY_LIMIT = 2 * 1024**3
"""Memory for a query in addition to that of the store [bytes]."""
REPLY_LIMIT = 256 * 1024**2
"""The maximum size of an answer [bytes]."""

_STAND_IN_LETTERS = "bcfghjkmnpqvwxz"
"""Letters that no keyword of SPARQL and no exponent of a number consists of."""
_CODE_POINT = re.compile(r"\\u([0-9a-fA-F]{4})|\\U([0-9a-fA-F]{8})")
_JSON, _TRIPLES = ox.QueryResultsFormat.JSON, ox.RdfFormat.N_TRIPLES


class _BoundedBuffer:
    """Collects the bytes of an answer, up to the size limit."""

    def __init__(self) -> None:
        self.chunks: list[bytes] = []
        self.remaining = REPLY_LIMIT

    def write(self, chunk: bytes) -> int:
        self.remaining -= len(chunk)
        if self.remaining < 0:
            raise _TooLargeError
        self.chunks.append(chunk)
        return len(chunk)

    def flush(self) -> None:
        pass


class _TooLargeError(Exception):
    pass


def serve(store: ox.Store, connection: Connection, *, network: bool = True) -> None:
    """Evaluates queries until the connection is closed.

    A request is (text, prefixes, seconds, whether SERVICE is allowed, whether to check it only, further graphs in
    N-Quads, which are not part of the union, or None). A reply is (kind, bytes): solutions or a boolean as JSON,
    triples, an error, or the clause that is not allowed; of a query that is only checked, the clauses in it that name
    other sources.

    Args:
        connection: to the process that asks.
        network: whether this process may open connections and files; a store on disk needs files.
    """
    _limit_resources()
    if not network:
        deny_network(no_new_files=True)
    apart: set[ox.NamedNode | ox.BlankNode] = set()
    while True:
        try:
            query, prefixes, timeout_s, allow_service, check_only, further = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_REAL, timeout_s)
        if further is not None:
            before = {*store.named_graphs()}
            store.load(further, ox.RdfFormat.N_QUADS)
            apart |= {*store.named_graphs()} - before
        if check_only:
            reply = _check(query, prefixes)
        else:
            reply = _answer(store, query, prefixes, allow_service=allow_service, apart=apart)
        signal.setitimer(signal.ITIMER_REAL, 0)
        connection.send(reply)


def _answer(
    store: ox.Store,
    query: str,
    prefixes: dict[str, str],
    *,
    allow_service: bool,
    apart: Collection[ox.NamedNode | ox.BlankNode],
) -> tuple[str, bytes]:
    if not allow_service and _is_written_with_escapes("SERVICE", query):
        return "service", b""
    if not allow_service and _has_clause("SERVICE", query, prefixes):
        error = _syntax_error(query, prefixes)
        return ("syntax", error.encode()) if error else ("service", b"")
    if _has_clause("FROM", query, prefixes):  # a dataset of the query's own
        return _evaluate(store, query, prefixes)
    if not apart:
        return _evaluate(store, query, prefixes, use_default_graph_as_union=True)
    graphs = (graph for graph in store.named_graphs() if graph not in apart)
    return _evaluate(store, query, prefixes, default_graph=[ox.DefaultGraph(), *graphs])


def _check(query: str, prefixes: dict[str, str]) -> tuple[str, bytes]:
    words = ("SERVICE", "FROM")
    clauses = [word for word in words if _is_written_with_escapes(word, query) or _has_clause(word, query, prefixes)]
    error = _syntax_error(query, prefixes)
    return ("syntax", error.encode()) if error else ("clauses", " ".join(clauses).encode())


def _has_clause(keyword: str, query: str, prefixes: dict[str, str]) -> bool:
    """Whether a query has a clause that begins with a keyword, or is not valid.

    Without the keyword as such, every occurrence of the word is a part of a name, a string, an IRI or a comment, and
    the query stays valid if all of them are renamed alike.
    """
    stand_in = "".join(secrets.choice(_STAND_IN_LETTERS) for _ in keyword)
    renamed, found = _word(keyword).subn(stand_in, query)
    return bool(found) and bool(_syntax_error(renamed, prefixes))


def _is_written_with_escapes(keyword: str, query: str) -> bool:
    """Whether the word occurs in a spelling with escapes; SPARQL 1.1 allows them everywhere, this store in strings."""
    word, decoded = _word(keyword), _CODE_POINT.sub(_character, query)
    return len(word.findall(decoded)) > len(word.findall(query))


def _word(keyword: str) -> re.Pattern[str]:
    return re.compile(keyword, re.IGNORECASE | re.ASCII)


def _character(escape: re.Match[str]) -> str:
    number = int(escape[1] or escape[2], 16)
    return chr(number) if number <= sys.maxunicode else escape[0]


def _syntax_error(query: str, prefixes: dict[str, str]) -> str:
    """The parser's message; empty if the query is valid. Evaluates nothing.

    The store refuses to substitute a variable that the query does not select, after parsing and before evaluating it.
    """
    unused = ox.Variable(f"unused{secrets.token_hex(8)}")
    try:
        ox.Store().query(query, prefixes=prefixes, substitutions={unused: ox.Literal("")})
    except SyntaxError as error:
        return str(error) or "error"
    except (ValueError, OSError, RuntimeError):
        pass
    return ""


def _evaluate(store: ox.Store, query: str, prefixes: dict[str, str], **dataset: Any) -> tuple[str, bytes]:
    reply: Any = _BoundedBuffer()
    try:
        found = store.query(query, prefixes=prefixes, **dataset)
        if isinstance(found, ox.QueryTriples):
            found.serialize(reply, format=_TRIPLES)
            return "triples", b"".join(reply.chunks)
        found.serialize(reply, format=_JSON)
        return "solutions", b"".join(reply.chunks)
    except _TooLargeError:
        return "too large", b""
    except SyntaxError as error:
        return "syntax", str(error).encode()
    except (ValueError, OSError, RuntimeError) as error:
        return "refused", str(error).encode()


# -- limits ------------------------------------------------------------------------------------------------------------


def _limit_resources() -> None:
    """Sets the memory limit and the signal handlers, and closes the standard streams; Ctrl-C is left to the parent."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    null_device = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(null_device, stream)
    if sys.platform == "linux":  # other systems do not enforce the limit
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        limit = pages * resource.getpagesize() + MEMORY_LIMIT
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        if hard == resource.RLIM_INFINITY or limit < hard:
            resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def _main(folder: str, connection_fd: str, network: str, mode: str) -> None:
    connection = Connection(int(connection_fd))
    if network == "denied":
        deny_network(no_new_files=False)  # the store opens its files when it reads them
    store = ox.Store(folder) if mode == "write" else ox.Store.read_only(folder)
    connection.send(None)  # ready
    serve(store, connection)


if __name__ == "__main__":
    _main(*sys.argv[1:])
