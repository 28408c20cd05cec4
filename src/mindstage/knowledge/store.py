"""The triple store of this process, in memory or in a folder, and the worker processes that run its SPARQL queries.

A store in memory is forked, which copies nothing (3 ms for a kitchen with its ontology); a store on disk is opened by a
new process (60 ms). Workers are kept between queries, each of which then costs two messages, and are replaced when the
store has changed.
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
from itertools import chain, count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NoReturn

import pyoxigraph as ox

from mindstage.errors import SparqlSyntaxError, SparqlTimeoutError, StoreError
from mindstage.rdf.graphs import PREFIXES, RdfTerm, SparqlResult

if TYPE_CHECKING:  # programs that ask only questions start no worker
    from multiprocessing.connection import Connection

__all__ = [
    "OxigraphStore",
    "QueryWorker",
    "QueryWorkerPool",
    "check_text",
    "fork_worker",
    "short_syntax_error",
    "solutions_table",
    "spawn_worker",
    "term_from_node",
    "triples_table",
]


# -- syntax ------------------------------------------------------------------------------------------------------------

_STRING_LITERALS = re.compile(
    r'''\\.|"""(?:[^"\\]|\\.|"(?!""))*"""|\'\'\'(?:[^'\\]|\\.|'(?!''))*\'\'\''''
    r"""|"(?:[^"\\\n\r]|\\.)*"|'(?:[^'\\\n\r]|\\.)*'|<[^<>"{}|^`\\\x00-\x20]*>|\#[^\n\r]*""",
    re.DOTALL,
)
"""Escapes, strings, IRIs and comments, which may contain keywords."""
_NAMES = re.compile(r"[?$@][\w-]+|(?<![\w.-])(?!service\b)[\w.-]*:[\w.:%-]*", re.IGNORECASE)
_SERVICE = re.compile(r"(?<!\w)SERVICE(?!\w)", re.IGNORECASE)
_UPDATE = re.compile(
    r"(?:\s|\b(?:BASE|PREFIX)\b)*(INSERT|DELETE|LOAD|CLEAR|CREATE|DROP|COPY|MOVE|ADD|WITH)\b", re.IGNORECASE
)
_CODE_POINT = re.compile(r"\\u([0-9a-fA-F]{4})|\\U000([0-9a-fA-F]{5})")

_GRACE_PERIOD_S = 10.0
"""How long to wait for a worker after the time limit, for example if it was suspended [s]."""
_START_TIMEOUT_S = 60.0
"""The time limit for starting a new process [s]."""
_MAX_IDLE = 2
"""The maximum number of idle workers; several threads may run queries at once."""
_LIMIT_HINT = "ask for less (LIMIT, or without ORDER BY and DISTINCT)"
_MIN_BULK_SIZE = 4 * 1024 * 1024
"""The size from which a document is written as files of its own, which is then faster than through the log [bytes]."""
_MAX_STAGED_SIZE = 256 * 1024 * 1024
"""The size of the small documents that are held in memory before they are written together [bytes]."""
_MAX_TIMEOUT_S = 1e6
"""The longest time limit; the timer of a process has no infinity [s]."""


def check_text(query: str, *, allow_service: bool) -> None:
    """Refuses a query in whose text the keyword SERVICE occurs outside of names, strings, IRIs and comments.

    For queries that another server parses, whose parser may differ from the store's. In doubt a word counts as SERVICE,
    for example a prefix of that name.

    Raises:
        SparqlSyntaxError: it uses another server.
    """
    if not allow_service and any(_SERVICE.search(_keywords(text)) for text in (query, _without_escapes(query))):
        raise _service_error()


def _service_error() -> SparqlSyntaxError:
    remedy = "allow it with --allow-service (in Python: allow_service=True)"
    return SparqlSyntaxError("it asks another server (SERVICE), and nothing is fetched unasked", remedy=remedy)


def _invalid_query_error(query: str, message: str) -> SparqlSyntaxError:
    """The error about a query that the parser rejects; names an update as such."""
    if update := _UPDATE.match(_keywords(_without_escapes(query))):
        cause = f"it is an update ({update[1].upper()}), and queries only read"
        return SparqlSyntaxError(cause, remedy="statements are added and removed with tell and retract")
    remedy = "it must be a SELECT, ASK, CONSTRUCT or DESCRIBE of SPARQL 1.1"
    return SparqlSyntaxError(short_syntax_error(message), remedy=remedy)


def _keywords(query: str) -> str:
    """The text without strings, IRIs, comments and names."""
    return _NAMES.sub(" ", _STRING_LITERALS.sub(" ", query))


def _without_escapes(query: str) -> str:
    return _CODE_POINT.sub(lambda code: chr(int(code[1] or code[2], 16)), query)


def short_syntax_error(message: str) -> str:
    """Shortens the parser's message, which may list a hundred expected tokens."""
    place, _, expected = message.partition(": expected ")
    if "Prefix not found" in expected:
        return f"{place}: the prefix is not declared"
    return f"{place}: expected {expected}" if 0 < len(expected) < 40 and expected != "[_]" else place


# -- results -----------------------------------------------------------------------------------------------------------


def solutions_table(json: bytes) -> SparqlResult:
    """The result of SELECT or ASK from SPARQL's JSON format.

    Raises:
        SyntaxError: it is not in that format.
    """
    found = ox.parse_query_results(json, ox.QueryResultsFormat.JSON)
    if isinstance(found, ox.QueryBoolean):
        return SparqlResult((), (), bool(found))
    names = tuple(variable.value for variable in found.variables)
    rows = ([solution[name] for name in names] for solution in found)
    return SparqlResult(
        names, tuple(tuple(None if term is None else term_from_node(term) for term in row) for row in rows)
    )


def triples_table(triples: Iterable[ox.Quad]) -> SparqlResult:
    """The result of CONSTRUCT or DESCRIBE, each triple once."""
    rows = tuple(
        (term_from_node(each.subject), term_from_node(each.predicate), term_from_node(each.object))
        for each in dict.fromkeys(triples)
    )
    return SparqlResult(("subject", "predicate", "object"), rows)


def term_from_node(value: object) -> RdfTerm:
    """A node of a store as plain data."""
    match value:
        case ox.NamedNode():
            return RdfTerm("iri", value.value)
        case ox.BlankNode():
            return RdfTerm("blank", value.value)
        case ox.Literal():
            return RdfTerm("literal", value.value, value.datatype.value, value.language)
        case _:
            return RdfTerm("triple", str(value))


class QueryWorker:
    """A worker process and the connection to it."""

    def __init__(self, connection: Connection, pid: int) -> None:
        self._connection = connection
        self._pid = pid

    def query(
        self,
        query: str,
        timeout_s: float,
        *,
        allow_service: bool = False,
        check_only: bool = False,
        prefixes: Mapping[str, str] = PREFIXES,
        present: bytes | None = None,
    ) -> tuple[str, bytes]:
        """Runs a query, and returns the kind and the bytes of the reply.

        Args:
            query: a SPARQL query.
            timeout_s: time limit [s].
            allow_service: whether it may use other servers, which a worker without network cannot reach either way.
            check_only: whether it is parsed and not evaluated.
            prefixes: the prefixes that it need not declare.
            present: further graphs in N-Quads, which a worker keeps from then on.

        Raises:
            SparqlTimeoutError: the time limit was exceeded; the worker has ended.
            SparqlSyntaxError: the query needs too much memory or its answer is too large; the worker has ended.
        """
        try:
            self._connection.send((query, dict(prefixes), timeout_s, allow_service, check_only, present))
            if not self._connection.poll(timeout_s + _GRACE_PERIOD_S):
                raise SparqlTimeoutError(timeout_s=timeout_s)
            answer: tuple[str, bytes] = self._connection.recv()
        except (EOFError, ConnectionError):
            if (ended := self.kill()) == signal.SIGALRM:
                raise SparqlTimeoutError(timeout_s=timeout_s) from None
            raise SparqlSyntaxError(_exit_reason(ended), remedy=_LIMIT_HINT) from None
        if answer[0] == "too large":
            from mindstage.knowledge.sparql_worker import REPLY_LIMIT

            raise SparqlSyntaxError(f"its answer is larger than {REPLY_LIMIT // 1024**2} MiB", remedy=_LIMIT_HINT)
        return answer

    def wait_until_ready(self) -> None:
        """Waits until a new process is ready.

        Raises:
            SparqlSyntaxError: the process did not start.
        """
        try:
            if self._connection.poll(_START_TIMEOUT_S):
                self._connection.recv()
                return
        except (EOFError, ConnectionError):
            pass
        self.kill()
        raise SparqlSyntaxError("the query process did not start")

    def kill(self) -> int:
        """Ends the process, and returns the signal that it ended by, or 0."""
        self._connection.close()
        try:
            os.kill(self._pid, signal.SIGKILL)  # has no effect if the process has ended already
            _, status = os.waitpid(self._pid, 0)
        except (ChildProcessError, ProcessLookupError):
            return 0  # the process was waited for elsewhere
        return os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0


class QueryWorkerPool:
    """The workers of one store in its current state."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle_workers: list[QueryWorker] = []
        self._generation = 0
        weakref.finalize(self, _kill_all, self._idle_workers)

    def query(
        self,
        query: str,
        timeout_s: float,
        *,
        check_only: bool,
        start_worker: Callable[[], QueryWorker],
        prefixes: Mapping[str, str] = PREFIXES,
    ) -> tuple[str, bytes]:
        """Runs a query in a worker, and returns the kind and the bytes of the reply.

        Args:
            query: a SPARQL query.
            timeout_s: time limit [s].
            check_only: whether it is parsed and not evaluated.
            start_worker: starts a worker if none is idle.
            prefixes: the prefixes that it need not declare.

        Raises:
            SparqlTimeoutError: the time limit was exceeded.
            SparqlSyntaxError: the query needs too much memory, or its answer is too large.
        """
        with self._lock:
            state = self._generation
            worker = self._idle_workers.pop() if self._idle_workers else None
        worker = worker or start_worker()
        try:
            answer = worker.query(query, timeout_s, check_only=check_only, prefixes=prefixes)
        except BaseException:  # including KeyboardInterrupt
            worker.kill()
            raise
        with self._lock:
            if state == self._generation and len(self._idle_workers) < _MAX_IDLE:
                self._idle_workers.append(worker)
                return answer
        worker.kill()
        return answer

    def discard_all(self) -> None:
        """Ends the idle workers, which have the previous state of the store."""
        with self._lock:
            self._generation += 1
            _kill_all(self._idle_workers)


def fork_worker(store: ox.Store, *, network: bool = False) -> QueryWorker:
    """Starts a worker with a copy of a store in memory; the store must not be written meanwhile.

    Args:
        network: whether the worker may open connections, where the operating system can deny it.
    """
    from multiprocessing import Pipe

    from mindstage.knowledge.sparql_worker import serve

    ours, theirs = Pipe()
    with warnings.catch_warnings():
        # Python warns about locks of other threads; the child uses the locks of the store only, which are free.
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if not process:
        try:
            _close_inherited_files(theirs.fileno())
            serve(store, theirs, network=network)
        finally:
            os._exit(0)
    theirs.close()
    return QueryWorker(ours, process)


def spawn_worker(folder: Path, *, network: bool = False, is_copy: bool = False) -> QueryWorker:
    """Starts a worker that opens a store on disk, which must not be written meanwhile.

    Args:
        folder: the folder of the store.
        is_copy: whether the worker may write to it.
        network: whether the worker may open connections, where the operating system can deny it.
    """
    from multiprocessing import Pipe

    from mindstage.knowledge import sparql_worker

    ours, theirs = Pipe()
    os.set_inheritable(theirs.fileno(), True)
    # -P: the directory of this file must not be on the module path.
    access = "allowed" if network else "denied"
    mode = "write" if is_copy else "read"
    command = [sys.executable, "-P", sparql_worker.__file__, str(folder), str(theirs.fileno()), access, mode]
    process = os.posix_spawn(sys.executable, command, os.environ)
    theirs.close()
    worker = QueryWorker(ours, process)
    worker.wait_until_ready()
    return worker


def _close_inherited_files(keep_fd: int) -> None:
    """Closes the files and sockets inherited from the parent, which would stay open for the life of the fork."""
    for name in os.listdir("/dev/fd"):
        if int(name) > 2 and int(name) != keep_fd:
            with suppress(OSError):  # the descriptor of the listing itself
                os.close(int(name))


def _kill_all(workers: list[QueryWorker]) -> None:
    while workers:
        workers.pop().kill()


def _exit_reason(exit_signal: int) -> str:
    from mindstage.knowledge.sparql_worker import MEMORY_LIMIT

    if exit_signal in {signal.SIGABRT, signal.SIGKILL, signal.SIGSEGV}:
        return f"it needs more than {MEMORY_LIMIT // 1024**3} GiB of memory"
    return "the query process has ended unexpectedly"


def _do_nothing() -> None:
    pass


class OxigraphStore:
    """A `TripleStore` of pyoxigraph. Reads use pyoxigraph directly; writes and queries are serialized here."""

    def __init__(self, folder: Path | None = None, *, read_only: bool = False) -> None:
        """Opens or creates a store.

        Args:
            folder: the folder of the store; None keeps it in memory.
            read_only: whether to open an existing folder without write access.

        Raises:
            OSError: the folder is not a store, or is used by another process.
        """
        if read_only and folder:
            self._store = ox.Store.read_only(str(folder))
        else:
            self._store = ox.Store() if folder is None else ox.Store(folder)
        self._folder = folder
        self._read_only = read_only
        self._closed = False
        self._write_lock = threading.RLock()
        self.before_write: Callable[[], None] = _do_nothing
        """Called before each change."""
        self._snapshot_numbers = count()
        self._snapshot: Path | None = None
        self._workers = QueryWorkerPool()
        self._staging: ox.Store | None = None
        self._staged_size = 0
        # Called very often, so without a method in between.
        self.quads_for_pattern: Callable[..., Iterator[ox.Quad]] = self._store.quads_for_pattern

    def __len__(self) -> int:
        return len(self._store)

    def __iter__(self) -> Iterator[ox.Quad]:
        return iter(self._store)

    def dump(self) -> bytes:
        """All statements as N-Quads."""
        return self._store.dump(format=ox.RdfFormat.N_QUADS) or b""

    def __getstate__(self) -> bytes:
        """All statements; those of a store on disk are restored in memory, where they can be changed."""
        return self.dump()

    def __setstate__(self, state: bytes) -> None:
        OxigraphStore.__init__(self)
        self._store.extend(ox.parse(state, ox.RdfFormat.N_QUADS))  # keeps the labels of blank nodes

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement; has no effect if it exists."""
        with self._exclusive_write():
            self._store.add(quad)

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements with common blank nodes."""
        with self._exclusive_write():
            self._store.extend(quads)

    def remove(self, quad: ox.Quad, /) -> None:
        """Removes a statement, if it exists."""
        with self._exclusive_write():
            self._store.remove(quad)

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a document into a graph.

        Raises:
            SyntaxError: the document is not in that format; nothing was added.
        """
        with self._exclusive_write():
            if self._staging is not None and len(data) < _MIN_BULK_SIZE:
                self._staging.load(data, format, base_iri=base_iri, to_graph=to_graph)
                self._staged_size += len(data)
                if self._staged_size > _MAX_STAGED_SIZE:
                    self._write_staged()
                return
            if self._folder is None or len(data) < _MIN_BULK_SIZE:
                self._store.load(data, format, base_iri=base_iri, to_graph=to_graph)
                return
            try:
                self._store.bulk_load(data, format, base_iri=base_iri, to_graph=to_graph)
            except SyntaxError:
                self._store.remove_graph(to_graph)  # the statements before the error were added
                raise

    def remove_graph(self, graph: ox.NamedNode | ox.DefaultGraph, /) -> None:
        """Removes all statements of a graph."""
        with self._exclusive_write():
            self._store.remove_graph(graph)
            if self._staging is not None:
                self._staging.remove_graph(graph)

    @contextmanager
    def bulk(self) -> Iterator[None]:
        """Holds the documents that are loaded inside in memory, and writes them together at the end.

        To a store on disk, many documents are then written in a fraction of the time. They can be read at once with
        `quads_for_pattern`, but not queried.
        """
        if self._folder is None or self._read_only or self._staging is not None:
            yield
            return
        staging = self._staging = ox.Store()
        read = self.quads_for_pattern
        self.quads_for_pattern = lambda *pattern: chain(
            self._store.quads_for_pattern(*pattern), staging.quads_for_pattern(*pattern)
        )
        try:
            yield
            if len(staging):
                with self._exclusive_write():
                    self._write_staged()
        finally:
            self._staging, self._staged_size, self.quads_for_pattern = None, 0, read

    def _write_staged(self) -> None:
        staging = self._staging
        if staging is None or self._folder is None or not len(staging):
            return
        with TemporaryDirectory(prefix=f"{self._folder.name}-staged-", dir=self._folder.parent) as folder:
            file = Path(folder, "staged.nq")
            staging.dump(file, ox.RdfFormat.N_QUADS)
            self._store.bulk_load(path=file, format=ox.RdfFormat.N_QUADS, lenient=True)  # it was checked before
        staging.clear()
        self._staged_size = 0

    def query(
        self,
        query: str,
        *,
        timeout_s: float,
        allow_service: bool = False,
        prefixes: Mapping[str, str] = PREFIXES,
        present: bytes | None = None,
    ) -> SparqlResult:
        """Evaluates a SPARQL query in a separate process, which ends at the time limit.

        FROM and FROM NAMED select graphs of this store, and nothing is fetched for them; without them, the default
        graph is the union of all graphs but those that exist for this query only.

        Args:
            timeout_s: the time limit [s].
            allow_service: whether it may use other servers.
            prefixes: the prefixes that it need not declare.
            present: further graphs in N-Quads, which exist for this query only: the state, and the events of episodes.

        Raises:
            SparqlSyntaxError: the query is not valid, not allowed, or its answer too large.
            SparqlTimeoutError: the time limit was exceeded.
        """
        kind, reply = self._ask_worker(
            query, timeout_s, allow_service=allow_service, prefixes=prefixes, present=present
        )
        match kind:
            case "solutions":
                return solutions_table(reply)
            case "triples":
                return triples_table(ox.parse(reply, ox.RdfFormat.N_TRIPLES))
            case "service":
                raise _service_error()
            case "syntax":
                raise _invalid_query_error(query, reply.decode())
            case _:
                raise SparqlSyntaxError(reply.decode())

    def clauses(self, query: str, *, timeout_s: float) -> frozenset[str]:
        """The clauses of a query that name sources of data, SERVICE and FROM; parses it without evaluating it.

        Raises:
            SparqlSyntaxError: the query is not valid.
            SparqlTimeoutError: the time limit was exceeded.
        """
        kind, reply = self._ask_worker(query, timeout_s, check_only=True)
        if kind == "clauses":
            return frozenset(reply.decode().split())
        raise _invalid_query_error(query, reply.decode())

    def _ask_worker(
        self,
        query: str,
        timeout_s: float,
        *,
        allow_service: bool = False,
        check_only: bool = False,
        prefixes: Mapping[str, str] = PREFIXES,
        present: bytes | None = None,
    ) -> tuple[str, bytes]:
        if self._closed:
            self._raise_closed()
        if not timeout_s > 0:
            raise SparqlTimeoutError(timeout_s=timeout_s)
        limit_s = min(timeout_s, _MAX_TIMEOUT_S)
        if not allow_service and present is None:
            return self._workers.query(
                query, limit_s, check_only=check_only, prefixes=prefixes, start_worker=self._start_worker
            )
        with self._own_worker(network=allow_service, writes=present is not None) as worker:
            return worker.query(
                query,
                limit_s,
                allow_service=allow_service,
                check_only=check_only,
                prefixes=prefixes,
                present=present,
            )

    @contextmanager
    def _own_worker(self, *, network: bool, writes: bool) -> Iterator[QueryWorker]:
        """A worker for one query; if it writes, it has a copy of the store."""
        if self._folder is None or not writes:
            worker = self._start_worker(network=network)
            try:
                yield worker
            finally:
                worker.kill()
            return
        # Beside the store, its files are linked and not copied.
        with TemporaryDirectory(
            prefix=f"{self._folder.name}-as-asked-", dir=None if self._read_only else self._folder.parent
        ) as folder:
            copy = Path(folder, "triples")
            with self._write_lock:
                self._store.backup(copy)
            worker = spawn_worker(copy, network=network, is_copy=True)
            try:
                yield worker
            finally:
                worker.kill()

    def flush(self) -> None:
        """Writes everything to disk, so that it survives a power failure."""
        if self._folder and not self._read_only and not self._closed:
            self._store.flush()

    def close(self) -> None:
        """Ends the query processes, and closes the folder once no iterator reads from it."""
        with self._write_lock:
            self._discard_workers()
            self._closed = True
            self._store = ox.Store()
            self.quads_for_pattern = self._raise_closed

    @contextmanager
    def _exclusive_write(self) -> Iterator[None]:
        """Excludes other writers, and discards the workers that have the previous state of the store."""
        if self._read_only or self._closed:
            self._raise_closed()
        with self._write_lock:
            self.before_write()
            try:
                yield
            finally:
                self._discard_workers()

    def _raise_closed(self, *_: object) -> NoReturn:
        where = str(self._folder.parent) if self._folder else "in memory"
        if self._closed:
            raise StoreError(where, cause="it is closed", remedy="open it again")
        raise StoreError(where, cause="it is read-only", remedy="copy it, and use the copy")

    def _discard_workers(self) -> None:
        self._workers.discard_all()
        if self._snapshot:
            shutil.rmtree(self._snapshot, ignore_errors=True)
            self._snapshot = None

    def _start_worker(self, *, network: bool = False) -> QueryWorker:
        with self._write_lock:
            if self._folder is None:
                return fork_worker(self._store, network=network)
            if self._read_only:
                return spawn_worker(self._folder, network=network)
            if self._snapshot is None:
                copy = self._folder.with_name(f"{self._folder.name}-as-asked-{next(self._snapshot_numbers)}")
                self._store.backup(copy)  # hard links, so nothing is copied
                self._snapshot = copy
            return spawn_worker(self._snapshot, network=network)
