"""A process that answers SPARQL queries, so that one that does not end can be ended.

It is a fork of the process whose store is asked, or, for a store on disk, runs this very file, which therefore loads
nothing but the store. Its own clock ends it: nobody has to be alive to stop a query.
"""

from __future__ import annotations

import os
import signal
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pyoxigraph as ox

if sys.platform == "linux":
    import resource

__all__ = ["MEMORY_LIMIT", "REPLY_LIMIT", "serve"]

MEMORY_LIMIT = 2 * 1024**3
"""Bytes that a query may take beyond what its store does."""
REPLY_LIMIT = 256 * 1024**2
"""Bytes that an answer may have."""

_JSON, _TRIPLES = ox.QueryResultsFormat.JSON, ox.RdfFormat.N_TRIPLES


class _BoundedBuffer:
    """The bytes of an answer, as they are written."""

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


def serve(store: ox.Store, connection: Connection) -> None:
    """Answers query after query until nobody is there any more.

    A query is (text, prefixes, seconds); the answer (kind, bytes): solutions and truth as JSON, triples, or why not.
    """
    _limit_resources()
    while True:
        try:
            query, prefixes, timeout_s = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_REAL, timeout_s)
        answer = _evaluate(store, query, prefixes)
        signal.setitimer(signal.ITIMER_REAL, 0)
        connection.send(answer)


def _evaluate(store: ox.Store, query: str, prefixes: dict[str, str]) -> tuple[str, bytes]:
    reply: Any = _BoundedBuffer()
    try:
        found = store.query(query, prefixes=prefixes, use_default_graph_as_union=True)
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


def _limit_resources() -> None:
    """Silent, bounded, and ended by the clock; whoever is asked to stop by Ctrl-C is the process that waits."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    if sys.platform == "linux":  # other systems do not hold anybody to it
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * resource.getpagesize() + MEMORY_LIMIT
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        if hard == resource.RLIM_INFINITY or most < hard:
            resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def _main(folder: str, line: str) -> None:
    connection = Connection(int(line))
    store = ox.Store.read_only(folder)
    connection.send(None)  # ready
    serve(store, connection)


if __name__ == "__main__":
    _main(*sys.argv[1:])
