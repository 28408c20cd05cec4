"""Workers: processes that a store's queries run in, kept between queries and renewed when the store has changed.

A store in memory is forked, which copies nothing (3 ms for a kitchen with its ontology); one on disk is opened once
more by a process of its own (60 ms). Each query after the first costs two messages.

SPARQL: what a query may ask for, and what it found.

The store of this process: statements in memory, or in a folder on disk.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NoReturn

import pyoxigraph as ox

from mindstage.errors import SparqlSyntaxError, SparqlTimeoutError, StoreError
from mindstage.knowledge import sparql_worker as query_process
from mindstage.knowledge.names import PREFIXES
from mindstage.knowledge.rdf import RdfTerm, SparqlResult
from mindstage.knowledge.sparql_worker import MEMORY_LIMIT, REPLY_LIMIT, serve

__all__ = [
    "PREFIXES",
    "OxigraphStore",
    "QueryWorker",
    "QueryWorkerPool",
    "check_query",
    "fork_worker",
    "short_syntax_error",
    "solutions_table",
    "spawn_worker",
    "term_from_node",
    "triples_table",
]


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


_GRACE_PERIOD_S = 10.0
"""How much longer than its own clock we wait for a worker, should somebody have stopped it [s]."""
_START_TIMEOUT_S = 60.0
"""How long a new process may take until it can be asked [s]."""
_MAX_IDLE = 2
"""Idle workers that are kept; several threads may ask at once."""
_LIMIT_HINT = "ask for less (LIMIT, or without ORDER BY and DISTINCT)"


class QueryWorker:
    """One process, and the line to it."""

    def __init__(self, connection: Connection, pid: int) -> None:
        self._connection = connection
        self._pid = pid

    def query(self, query: str, prefixes: Mapping[str, str], timeout_s: float) -> tuple[str, bytes]:
        """The kind and the bytes of the answer.

        Raises:
            SparqlTimeoutError: it did not end in time; the worker is of no use any more.
            SparqlSyntaxError: it took more memory than it may; the worker is of no use any more.
        """
        try:
            self._connection.send((query, dict(prefixes), timeout_s))
            if not self._connection.poll(timeout_s + _GRACE_PERIOD_S):
                raise SparqlTimeoutError(timeout_s=timeout_s)
            answer: tuple[str, bytes] = self._connection.recv()
        except (EOFError, ConnectionError):
            if (ended := self.kill()) == signal.SIGALRM:
                raise SparqlTimeoutError(timeout_s=timeout_s) from None
            raise SparqlSyntaxError(_exit_reason(ended), remedy=_LIMIT_HINT) from None
        if answer[0] == "too large":
            raise SparqlSyntaxError(f"its answer is larger than {REPLY_LIMIT // 1024**2} MiB", remedy=_LIMIT_HINT)
        return answer

    def wait_until_ready(self) -> None:
        """Waits for a process that has to start first.

        Raises:
            SparqlSyntaxError: it did not start.
        """
        try:
            if self._connection.poll(_START_TIMEOUT_S):
                self._connection.recv()
                return
        except (EOFError, ConnectionError):
            pass
        self.kill()
        raise SparqlSyntaxError("the process that answers queries did not start")

    def kill(self) -> int:
        """Ends the process, whatever it does, and tells the signal that it ended by."""
        self._connection.close()
        try:
            os.kill(self._pid, signal.SIGKILL)  # in vain, and harmless, where it has ended by itself
            _, status = os.waitpid(self._pid, 0)
        except (ChildProcessError, ProcessLookupError):
            return 0  # somebody who waits for every child was faster
        return os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0


class QueryWorkerPool:
    """The workers of one store, as it is now."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle_workers: list[QueryWorker] = []
        self._generation = 0
        weakref.finalize(self, _kill_all, self._idle_workers)

    def query(
        self, query: str, prefixes: Mapping[str, str], timeout_s: float, *, start_worker: Callable[[], QueryWorker]
    ) -> tuple[str, bytes]:
        """The kind and the bytes of the answer, from a worker that knows the store as it is.

        Args:
            query: SPARQL.
            prefixes: those it need not declare.
            timeout_s: how long it may take [s].
            start: makes one more worker, where none is idle.

        Raises:
            SparqlTimeoutError: it did not end in time, and was stopped.
            SparqlSyntaxError: it took more memory than it may, or its answer is too large.
        """
        with self._lock:
            state = self._generation
            worker = self._idle_workers.pop() if self._idle_workers else None
        worker = worker or start_worker()
        try:
            answer = worker.query(query, prefixes, timeout_s)
        except BaseException:  # Ctrl-C among them
            worker.kill()
            raise
        with self._lock:
            if state == self._generation and len(self._idle_workers) < _MAX_IDLE:
                self._idle_workers.append(worker)
                return answer
        worker.kill()
        return answer

    def discard_all(self) -> None:
        """Ends those that know the store as it was."""
        with self._lock:
            self._generation += 1
            _kill_all(self._idle_workers)


def fork_worker(store: ox.Store) -> QueryWorker:
    """A worker that knows a store in memory as it is at this moment; nobody may write into it meanwhile."""
    ours, theirs = Pipe()
    with warnings.catch_warnings():
        # Python warns of locks that other threads hold; the child uses none but the store's own, which nobody holds.
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if not process:
        try:
            _close_inherited_files(theirs.fileno())
            serve(store, theirs)
        finally:
            os._exit(0)
    theirs.close()
    return QueryWorker(ours, process)


def spawn_worker(folder: Path) -> QueryWorker:
    """A worker that knows a store on disk, into which nobody writes."""
    ours, theirs = Pipe()
    os.set_inheritable(theirs.fileno(), True)
    # -P: this file's neighbors are no libraries.
    command = [sys.executable, "-P", query_process.__file__, str(folder), str(theirs.fileno())]
    process = os.posix_spawn(sys.executable, command, os.environ)
    theirs.close()
    worker = QueryWorker(ours, process)
    worker.wait_until_ready()
    return worker


def _close_inherited_files(keep_fd: int) -> None:
    """A fork has its parent's open files and sockets too, which would stay open as long as it lives."""
    for name in os.listdir("/dev/fd"):
        if int(name) > 2 and int(name) != keep_fd:
            with suppress(OSError):  # that of the listing itself
                os.close(int(name))


def _kill_all(workers: list[QueryWorker]) -> None:
    while workers:
        workers.pop().kill()


def _exit_reason(exit_signal: int) -> str:
    if exit_signal in {signal.SIGABRT, signal.SIGKILL, signal.SIGSEGV}:
        return f"it needs more than {MEMORY_LIMIT // 1024**3} GiB of memory"
    return "the process that answered it has ended"


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
