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

from mindstage.errors import QueryRefused, QueryTimedOut, StoreUnusable
from mindstage.knowledge.stores.query_workers import Worker, Workers, forked, spawned
from mindstage.knowledge.stores.sparql import PREFIXES, Table, check_query, solutions_table, syntax_cause, triples_table

__all__ = ["LocalStore"]

_BULK = 4 * 1024 * 1024
"""Bytes from which on a text goes to disk faster as files of its own than through the log."""
_LONGEST_S = 1e6
"""What "for ever" means to a process's clock [s]."""


class LocalStore:
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
        self._writing = threading.RLock()
        self._copies = count()
        self._copy: Path | None = None
        self._workers = Workers()
        # Asked a million times, so without a step between.
        self.quads_for_pattern: Callable[..., Iterator[ox.Quad]] = self._store.quads_for_pattern

    def __len__(self) -> int:
        return len(self._store)

    def __iter__(self) -> Iterator[ox.Quad]:
        return iter(self._store)

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement; adding it twice is adding it once."""
        with self._changing():
            self._store.add(quad)

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements that share their things without a name."""
        with self._changing():
            self._store.extend(quads)

    def remove(self, quad: ox.Quad, /) -> None:
        """Takes a statement away, if it is there."""
        with self._changing():
            self._store.remove(quad)

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a text into a graph.

        Raises:
            SyntaxError: it is not in that format; nothing was added.
        """
        with self._changing():
            if self._folder is None or len(data) < _BULK:
                self._store.load(data, format, base_iri=base_iri, to_graph=to_graph)
                return
            try:
                self._store.bulk_load(data, format, base_iri=base_iri, to_graph=to_graph)
            except SyntaxError:
                self._store.remove_graph(to_graph)  # what came before the mistake is there already
                raise

    def remove_graph(self, graph: ox.NamedNode, /) -> None:
        """Takes all statements of a graph away."""
        with self._changing():
            self._store.remove_graph(graph)

    def query(self, query: str, *, timeout_s: float, allow_service: bool = False) -> Table:
        """Answers a SPARQL query in a process of its own, which ends when its time is over.

        Raises:
            QueryRefused: it is no query, asks for what it may not, or for more than can be had.
            QueryTimedOut: it did not end in time.
        """
        if self._closed:
            self._refuse()
        check_query(query, allow_service=allow_service)
        if not timeout_s > 0:
            raise QueryTimedOut(timeout_s=timeout_s)
        kind, told = self._workers.ask(query, PREFIXES, min(timeout_s, _LONGEST_S), start=self._worker)
        match kind:
            case "solutions":
                return solutions_table(told)
            case "triples":
                return triples_table(ox.parse(told, ox.RdfFormat.N_TRIPLES))
            case "syntax":
                remedy = "it must be a SELECT, ASK, CONSTRUCT or DESCRIBE of SPARQL 1.1"
                raise QueryRefused(syntax_cause(told.decode()), remedy=remedy)
            case _:
                raise QueryRefused(told.decode())

    def flush(self) -> None:
        """Makes sure that what was written outlives the machine's power."""
        if self._folder and not self._read_only and not self._closed:
            self._store.flush()

    def close(self) -> None:
        """Ends the processes of queries, and lets go of the folder once nobody reads from it any more."""
        with self._writing:
            self._renew()
            self._closed = True
            self._store = ox.Store()
            self.quads_for_pattern = self._refuse

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """Nobody else writes meanwhile, and no query is answered by who knows the store as it was before."""
        if self._read_only or self._closed:
            self._refuse()
        with self._writing:
            try:
                yield
            finally:
                self._renew()

    def _refuse(self, *_: object) -> NoReturn:
        where = str(self._folder.parent) if self._folder else "in memory"
        if self._closed:
            raise StoreUnusable(where, cause="it is closed", remedy="open it again")
        raise StoreUnusable(where, cause="it can only be read", remedy="copy it, and use the copy")

    def _renew(self) -> None:
        self._workers.renew()
        if self._copy:
            shutil.rmtree(self._copy, ignore_errors=True)
            self._copy = None

    def _worker(self) -> Worker:
        with self._writing:
            if self._folder is None:
                return forked(self._store)
            if self._read_only:
                return spawned(self._folder)
            if self._copy is None:
                copy = self._folder.with_name(f"{self._folder.name}-as-asked-{next(self._copies)}")
                self._store.backup(copy)  # as links: nothing is copied
                self._copy = copy
            return spawned(self._copy)
