"""The process that evaluates SPARQL queries, so that a query can be limited in time and memory.

It is a fork of the process that owns the store, or, for a store on disk, runs this file as a script; the file therefore
imports nothing but the store. A timer in the process itself ends a query, even if the parent has died.
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
"""Memory for a query in addition to that of the store [bytes]."""
REPLY_LIMIT = 256 * 1024**2
"""The maximum size of an answer [bytes]."""

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


def serve(store: ox.Store, connection: Connection) -> None:
    """Evaluates queries until the connection is closed.

    A query is (text, prefixes, seconds). A reply is (kind, bytes): solutions or a boolean as JSON, triples, an error.
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


def _main(folder: str, connection_fd: str) -> None:
    connection = Connection(int(connection_fd))
    store = ox.Store.read_only(folder)
    connection.send(None)  # ready
    serve(store, connection)


if __name__ == "__main__":
    _main(*sys.argv[1:])
