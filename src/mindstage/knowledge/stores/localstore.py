"""The store of this process: statements in memory, or in a folder on disk."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import NoReturn

import pyoxigraph as ox

from mindstage.errors import SparqlSyntaxError, SparqlTimeoutError, StoreError
from mindstage.knowledge.stores.query_workers import QueryWorker, QueryWorkerPool, fork_worker, spawn_worker
from mindstage.knowledge.stores.sparql import (
    PREFIXES,
    SparqlResult,
    check_query,
    short_syntax_error,
    solutions_table,
    triples_table,
)

__all__ = ["OxigraphStore"]

_MAX_FORK_SIZE = 4 * 1024 * 1024
"""Bytes from which on a text goes to disk faster as files of its own than through the log."""
_MAX_TIMEOUT_S = 1e6
"""What "for ever" means to a process's clock [s]."""


class OxigraphStore:
    """A `TripleStore` of pyoxigraph; reading goes to it directly, writing and queries through here."""

    def __init__(self, folder: Path | None = None, *, read_only: bool = False) -> None:
        """Opens the store in a folder, or makes one; None keeps it in memory.

        Raises:
            OSError: the folder holds no such store, or another process holds it.
        """
        if read_only and folder:
            self._store = ox.Store.read_only(str(folder))
        else:
            self._store = ox.Store() if folder is None else ox.Store(folder)
        self._folder = folder
        self._read_only = read_only
        self._closed = False
        self._write_lock = threading.RLock()
        self._snapshot_folder = count()
        self._snapshot: Path | None = None
        self._workers = QueryWorkerPool()
        # Asked a million times, so without a step between.
        self.quads_for_pattern: Callable[..., Iterator[ox.Quad]] = self._store.quads_for_pattern

    def __len__(self) -> int:
        return len(self._store)

    def __iter__(self) -> Iterator[ox.Quad]:
        return iter(self._store)

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement; adding it twice is adding it once."""
        with self._exclusive_write():
            self._store.add(quad)

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements that share their things without a name."""
        with self._exclusive_write():
            self._store.extend(quads)

    def remove(self, quad: ox.Quad, /) -> None:
        """Takes a statement away, if it is there."""
        with self._exclusive_write():
            self._store.remove(quad)

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a text into a graph.

        Raises:
            SyntaxError: it is not in that format; nothing was added.
        """
        with self._exclusive_write():
            if self._folder is None or len(data) < _MAX_FORK_SIZE:
                self._store.load(data, format, base_iri=base_iri, to_graph=to_graph)
                return
            try:
                self._store.bulk_load(data, format, base_iri=base_iri, to_graph=to_graph)
            except SyntaxError:
                self._store.remove_graph(to_graph)  # what came before the mistake is there already
                raise

    def remove_graph(self, graph: ox.NamedNode, /) -> None:
        """Takes all statements of a graph away."""
        with self._exclusive_write():
            self._store.remove_graph(graph)

    def query(self, query: str, *, timeout_s: float, allow_service: bool = False) -> SparqlResult:
        """Answers a SPARQL query in a process of its own, which ends when its time is over.

        Raises:
            SparqlSyntaxError: it is no query, asks for what it may not, or for more than can be had.
            SparqlTimeoutError: it did not end in time.
        """
        if self._closed:
            self._raise_closed()
        check_query(query, allow_service=allow_service)
        if not timeout_s > 0:
            raise SparqlTimeoutError(timeout_s=timeout_s)
        kind, told = self._workers.query(
            query, PREFIXES, min(timeout_s, _MAX_TIMEOUT_S), start_worker=self._start_worker
        )
        match kind:
            case "solutions":
                return solutions_table(told)
            case "triples":
                return triples_table(ox.parse(told, ox.RdfFormat.N_TRIPLES))
            case "syntax":
                remedy = "it must be a SELECT, ASK, CONSTRUCT or DESCRIBE of SPARQL 1.1"
                raise SparqlSyntaxError(short_syntax_error(told.decode()), remedy=remedy)
            case _:
                raise SparqlSyntaxError(told.decode())

    def flush(self) -> None:
        """Makes sure that what was written outlives the machine's power."""
        if self._folder and not self._read_only and not self._closed:
            self._store.flush()

    def close(self) -> None:
        """Ends the processes of queries, and lets go of the folder once nobody reads from it any more."""
        with self._write_lock:
            self._discard_workers()
            self._closed = True
            self._store = ox.Store()
            self.quads_for_pattern = self._raise_closed

    @contextmanager
    def _exclusive_write(self) -> Iterator[None]:
        """Nobody else writes meanwhile, and no query is answered by who knows the store as it was before."""
        if self._read_only or self._closed:
            self._raise_closed()
        with self._write_lock:
            try:
                yield
            finally:
                self._discard_workers()

    def _raise_closed(self, *_: object) -> NoReturn:
        where = str(self._folder.parent) if self._folder else "in memory"
        if self._closed:
            raise StoreError(where, cause="it is closed", remedy="open it again")
        raise StoreError(where, cause="it can only be read", remedy="copy it, and use the copy")

    def _discard_workers(self) -> None:
        self._workers.discard_all()
        if self._snapshot:
            shutil.rmtree(self._snapshot, ignore_errors=True)
            self._snapshot = None

    def _start_worker(self) -> QueryWorker:
        with self._write_lock:
            if self._folder is None:
                return fork_worker(self._store)
            if self._read_only:
                return spawn_worker(self._folder)
            if self._snapshot is None:
                copy = self._folder.with_name(f"{self._folder.name}-as-asked-{next(self._snapshot_folder)}")
                self._store.backup(copy)  # as links: nothing is copied
                self._snapshot = copy
            return spawn_worker(self._snapshot)
