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

from mindstage.errors import QueryRefused, QueryTimedOut
from mindstage.knowledge.stores import query_process
from mindstage.knowledge.stores.query_process import MEMORY_LIMIT, REPLY_LIMIT, serve

__all__ = ["Worker", "Workers", "forked", "spawned"]

_GRACE_S = 10.0
"""How much longer than its own clock we wait for a worker, should somebody have stopped it [s]."""
_START_S = 60.0
"""How long a new process may take until it can be asked [s]."""
_KEPT = 2
"""Idle workers that are kept; several threads may ask at once."""
_LESS = "ask for less (LIMIT, or without ORDER BY and DISTINCT)"


class Worker:
    """One process, and the line to it."""

    def __init__(self, line: Connection, process: int) -> None:
        self._line = line
        self._process = process

    def ask(self, query: str, prefixes: Mapping[str, str], timeout_s: float) -> tuple[str, bytes]:
        """The kind and the bytes of the answer.

        Raises:
            QueryTimedOut: it did not end in time; the worker is of no use any more.
            QueryRefused: it took more memory than it may; the worker is of no use any more.
        """
        try:
            self._line.send((query, dict(prefixes), timeout_s))
            if not self._line.poll(timeout_s + _GRACE_S):
                raise QueryTimedOut(timeout_s=timeout_s)
            answer: tuple[str, bytes] = self._line.recv()
        except (EOFError, ConnectionError):
            if (ended := self.end()) == signal.SIGALRM:
                raise QueryTimedOut(timeout_s=timeout_s) from None
            raise QueryRefused(_fate(ended), remedy=_LESS) from None
        if answer[0] == "too large":
            raise QueryRefused(f"its answer is larger than {REPLY_LIMIT // 1024**2} MiB", remedy=_LESS)
        return answer

    def wait_until_ready(self) -> None:
        """Waits for a process that has to start first.

        Raises:
            QueryRefused: it did not start.
        """
        try:
            if self._line.poll(_START_S):
                self._line.recv()
                return
        except (EOFError, ConnectionError):
            pass
        self.end()
        raise QueryRefused("the process that answers queries did not start")

    def end(self) -> int:
        """Ends the process, whatever it does, and tells the signal that it ended by."""
        self._line.close()
        try:
            os.kill(self._process, signal.SIGKILL)  # in vain, and harmless, where it has ended by itself
            _, status = os.waitpid(self._process, 0)
        except (ChildProcessError, ProcessLookupError):
            return 0  # somebody who waits for every child was faster
        return os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0


class Workers:
    """The workers of one store, as it is now."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[Worker] = []
        self._state = 0
        weakref.finalize(self, _end_all, self._idle)

    def ask(
        self, query: str, prefixes: Mapping[str, str], timeout_s: float, *, start: Callable[[], Worker]
    ) -> tuple[str, bytes]:
        """The kind and the bytes of the answer, from a worker that knows the store as it is.

        Args:
            query: SPARQL.
            prefixes: those it need not declare.
            timeout_s: how long it may take [s].
            start: makes one more worker, where none is idle.

        Raises:
            QueryTimedOut: it did not end in time, and was stopped.
            QueryRefused: it took more memory than it may, or its answer is too large.
        """
        with self._lock:
            state = self._state
            worker = self._idle.pop() if self._idle else None
        worker = worker or start()
        try:
            answer = worker.ask(query, prefixes, timeout_s)
        except BaseException:  # Ctrl-C among them
            worker.end()
            raise
        with self._lock:
            if state == self._state and len(self._idle) < _KEPT:
                self._idle.append(worker)
                return answer
        worker.end()
        return answer

    def renew(self) -> None:
        """Ends those that know the store as it was."""
        with self._lock:
            self._state += 1
            _end_all(self._idle)


def forked(store: ox.Store) -> Worker:
    """A worker that knows a store in memory as it is at this moment; nobody may write into it meanwhile."""
    ours, theirs = Pipe()
    with warnings.catch_warnings():
        # Python warns of locks that other threads hold; the child uses none but the store's own, which nobody holds.
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if not process:
        try:
            _let_go_of_all_but(theirs.fileno())
            serve(store, theirs)
        finally:
            os._exit(0)
    theirs.close()
    return Worker(ours, process)


def spawned(folder: Path) -> Worker:
    """A worker that knows a store on disk, into which nobody writes."""
    ours, theirs = Pipe()
    os.set_inheritable(theirs.fileno(), True)
    # -P: this file's neighbours are no libraries.
    command = [sys.executable, "-P", query_process.__file__, str(folder), str(theirs.fileno())]
    process = os.posix_spawn(sys.executable, command, os.environ)
    theirs.close()
    worker = Worker(ours, process)
    worker.wait_until_ready()
    return worker


def _let_go_of_all_but(line: int) -> None:
    """A fork has its parent's open files and sockets too, which would stay open as long as it lives."""
    for name in os.listdir("/dev/fd"):
        if int(name) > 2 and int(name) != line:
            with suppress(OSError):  # that of the listing itself
                os.close(int(name))


def _end_all(workers: list[Worker]) -> None:
    while workers:
        workers.pop().end()


def _fate(ended: int) -> str:
    if ended in {signal.SIGABRT, signal.SIGKILL, signal.SIGSEGV}:
        return f"it needs more than {MEMORY_LIMIT // 1024**3} GiB of memory"
    return "the process that answered it has ended"
