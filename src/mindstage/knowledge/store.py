"""Workers: processes that a store's queries run in, kept between queries and renewed when the store has changed.

A store in memory is forked, which copies nothing (3 ms for a kitchen with its ontology); one on disk is opened once
more by a process of its own (60 ms). Each query after the first costs two messages.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import SparqlSyntaxError, SparqlTimeoutError
from mindstage.knowledge.stores import query_process
from mindstage.knowledge.stores.query_process import MEMORY_LIMIT, REPLY_LIMIT, serve

__all__ = ["QueryWorker", "QueryWorkerPool", "fork_worker", "spawn_worker"]

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
