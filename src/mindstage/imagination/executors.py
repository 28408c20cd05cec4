"""Executors run the samples of a plan: in this process, or in a pool of worker processes.

All that simulate with MuJoCo give the same results for the same job, since a sample depends on the job and its index
only. A sample that did not end (its worker was lost, the deadline passed, or it was canceled) is unknown, never failed.
"""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, BinaryIO, Protocol, cast
from uuid import uuid4

from mindstage.errors import ImaginationError, MindstageError
from mindstage.imagination.execution import PlanRunner, never, stopping
from mindstage.imagination.guesses import Guess
from mindstage.imagination.plans import Plan
from mindstage.imagination.results import EventKind, ImaginedEvent, Outcome, SampleResult
from mindstage.ranges import Workers, checked
from mindstage.simulation import SimulationImage

__all__ = ["Executor", "InProcessExecutor", "Job", "SampleRunner", "WorkerPoolExecutor", "lost_sample", "run_worker"]


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """All that determines a sample, except its index."""

    image: SimulationImage
    """The state in which all samples begin."""
    plan: Plan
    seed: int = 0
    fixed_guesses: tuple[Guess, ...] = ()
    """Guesses that are kept at their value in a plan whose guesses vary."""


class Executor(Protocol):
    """Runs samples. It can be used for many jobs, one after another, and is closed by who created it."""

    @property
    def name(self) -> str:
        """A short name for reports, such as "2 processes"."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What distinguishes its samples from those in this process, one sentence each; they are in the verdict."""

    def run(
        self, job: Job, indices: Iterable[int], *, deadline_s: float, cancel: Callable[[], bool] = never
    ) -> Iterator[SampleResult]:
        """Yields the result of each sample that was begun, in any order.

        Args:
            job: the plan and the state.
            indices: the samples to run, taken as they are begun.
            deadline_s: value of `time.monotonic` after which nothing runs; samples that have not ended are unknown.
            cancel: asked at least every 0.2 s; the iterator ends when it returns true, as at the deadline.

        Raises:
            ImaginationError: no samples can be run.
        """

    def close(self) -> None:
        """Ends all processes and connections; closing it again has no effect."""


def lost_sample(index: int, reason: str, *, is_interrupted: bool = False) -> SampleResult:
    """The result of a sample that did not end."""
    cause = ImaginedEvent(kind=EventKind.LOST, text=reason)
    return SampleResult(index=index, outcome=Outcome.UNKNOWN, cause=cause, is_interrupted=is_interrupted)


class SampleRunner:
    """Runs the samples of one job in this process."""

    def __init__(self, job: Job) -> None:
        """Prepares what all samples have in common."""
        self._image = job.image
        with job.image.restore() as first:
            self._runner = PlanRunner(first, job.plan, seed=job.seed, fixed_guesses=job.fixed_guesses)

    def run(self, index: int, *, stop: Callable[[], bool] = never, **options: Any) -> SampleResult:
        """Runs one sample; see `PlanRunner.run`."""
        with self._image.restore() as simulation, stopping(stop):
            return self._runner.run(simulation, index, stop=stop, **options)


class InProcessExecutor:
    """Runs one sample after another in the calling thread."""

    name = "1 process"
    notes: tuple[str, ...] = ()

    def run(
        self, job: Job, indices: Iterable[int], *, deadline_s: float, cancel: Callable[[], bool] = never
    ) -> Iterator[SampleResult]:
        """See `Executor`."""
        runner = SampleRunner(job)

        def stop() -> bool:
            return time.monotonic() >= deadline_s or cancel()

        for index in indices:
            if stop():
                return
            yield runner.run(index, stop=stop)

    def close(self) -> None:
        """Does nothing."""


# -- worker processes --------------------------------------------------------------------------------------------------

_HEADER = struct.Struct("<Q")
_MAX_QUEUED = 4
"""Limit of the samples that a worker has been given and that have not ended; with one it would wait for the next."""
_STOP_GRACE_S = 0.3
"""A worker that has not stopped its sample after this time is killed [s]."""
_MAX_FAILED_STARTS = 3
"""The pool gives up if so many workers in a row end before their first result."""
_START_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class _Request:
    """To a worker: a job (once per job), samples to run, or, without either, to stop the current samples."""

    job_id: str
    job: bytes = b""
    indices: tuple[int, ...] = ()
    stop: bool = False


@dataclass(frozen=True, slots=True)
class _Reply:
    """From a worker: that it has started, a result, or an error that concerns all samples of a job."""

    job_id: str = ""
    result: SampleResult | None = None
    error: str = ""


def _send(stream: BinaryIO, value: object) -> None:
    data = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(_HEADER.pack(len(data)) + data)
    stream.flush()


def _receive(stream: BinaryIO) -> Any:
    """The next value of a stream; None at its end."""
    header = stream.read(_HEADER.size)
    if len(header) < _HEADER.size:
        return None
    (size,) = _HEADER.unpack(header)
    data = stream.read(size)
    return pickle.loads(data) if len(data) == size else None


class _WorkerProcess:
    """A process that runs samples. It ends when its standard input is closed, thus also when this process dies."""

    def __init__(self, events: SimpleQueue[tuple[_WorkerProcess, _Reply | None]]) -> None:
        package_folder = str(Path(__file__).resolve().parents[2])
        search_path = os.pathsep.join(filter(None, (package_folder, os.environ.get("PYTHONPATH", ""))))
        self._process = subprocess.Popen(
            [sys.executable, "-c", "from mindstage.imagination.executors import run_worker; run_worker()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": search_path, "OMP_NUM_THREADS": "1"},
            start_new_session=True,  # Ctrl-C is handled by the parent
        )
        self.has_started = False
        self.jobs: set[str] = set()
        """The jobs that it has."""
        self.queue: deque[int] = deque()
        """The samples that it was given, in order: the first one runs."""
        self.started_s = time.monotonic()
        self._lock = threading.Lock()
        threading.Thread(target=self._read, args=(events,), name="mindstage-samples", daemon=True).start()

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def _read(self, events: SimpleQueue[tuple[_WorkerProcess, _Reply | None]]) -> None:
        stream = cast("BinaryIO", self._process.stdout)
        with suppress(OSError, EOFError, pickle.UnpicklingError, ValueError):
            while (reply := _receive(stream)) is not None:
                events.put((self, reply))
        events.put((self, None))

    def send(self, request: _Request) -> None:
        """Sends a request; a worker that has ended is noticed by the reading thread."""
        with suppress(OSError, ValueError), self._lock:
            _send(cast("BinaryIO", self._process.stdin), request)

    def exit_status(self) -> str:
        """How the process ended, in words."""
        code = self._process.wait(timeout=5.0)
        return f"ended by signal {-code}" if code < 0 else f"ended with exit code {code}"

    def kill(self) -> None:
        """Ends the process, and waits until it has ended."""
        with suppress(OSError):
            self._process.kill()
        with suppress(OSError, ValueError):
            cast("BinaryIO", self._process.stdin).close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5.0)


class WorkerPoolExecutor:
    """Runs samples in worker processes on this machine, which are started once and get each world once.

    A worker that dies is replaced; the sample that it was running is unknown, and those that it had not begun are given
    to others. A worker that does not stop at the deadline is killed.
    """

    @checked
    def __init__(self, workers: Workers | None = None) -> None:
        """Starts no process yet.

        Args:
            workers: number of processes; None for one per CPU core.
        """
        self._size = workers or os.cpu_count() or 1
        self._workers: list[_WorkerProcess] = []
        self._events: SimpleQueue[tuple[_WorkerProcess, _Reply | None]] = SimpleQueue()
        self._failed_starts = 0

    @property
    def name(self) -> str:
        """See `Executor`."""
        return f"{self._size} process{'' if self._size == 1 else 'es'}"

    @property
    def notes(self) -> tuple[str, ...]:
        """See `Executor`."""
        return ()

    @property
    def process_ids(self) -> tuple[int, ...]:
        """The ids of the processes that run."""
        return tuple(worker.pid for worker in self._workers)

    def run(
        self, job: Job, indices: Iterable[int], *, deadline_s: float, cancel: Callable[[], bool] = never
    ) -> Iterator[SampleResult]:
        """See `Executor`."""
        job_id = uuid4().hex
        data = pickle.dumps(job, protocol=pickle.HIGHEST_PROTOCOL)
        waiting: deque[int] = deque()
        source = iter(indices)
        try:
            while True:
                if time.monotonic() >= deadline_s or cancel():
                    yield from self._stop(job_id, "the time was over" if not cancel() else "it was canceled")
                    return
                self._start_workers()
                if not self._give(job_id, data, waiting, source):
                    return
                yield from self._next_results(job_id, waiting, min(0.1, max(deadline_s - time.monotonic(), 0.0)))
        finally:
            for _ in self._stop(job_id, "it was not needed any more"):
                pass

    def close(self) -> None:
        """Ends all processes; closing it again has no effect."""
        while self._workers:
            self._workers.pop().kill()

    def __enter__(self) -> WorkerPoolExecutor:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _start_workers(self) -> None:
        while len(self._workers) < self._size:
            self._workers.append(_WorkerProcess(self._events))
        for worker in self._workers:
            if not worker.has_started and time.monotonic() - worker.started_s > _START_TIMEOUT_S:
                worker.kill()  # its reading thread reports the end

    def _give(self, job_id: str, data: bytes, waiting: deque[int], source: Iterator[int]) -> bool:
        """Gives samples to workers, evenly; false if all samples have ended."""
        for _ in range(_MAX_QUEUED):
            for worker in sorted(self._workers, key=lambda each: len(each.queue)):
                if len(worker.queue) >= _MAX_QUEUED or (worker.queue and not worker.has_started):
                    continue
                index = waiting.popleft() if waiting else next(source, None)
                if index is None:
                    return any(each.queue for each in self._workers)
                worker.queue.append(index)
                worker.send(_Request(job_id, job=b"" if job_id in worker.jobs else data, indices=(index,)))
                worker.jobs.add(job_id)
        return True

    def _next_results(self, job_id: str, waiting: deque[int], timeout_s: float) -> Iterator[SampleResult]:
        """Waits for the next reply [s], and handles all that are there."""
        with suppress(Empty):
            worker, reply = self._events.get(timeout=timeout_s)
            while True:
                if reply is None:
                    yield from self._replace(worker, waiting)
                else:
                    worker.has_started = True
                    if reply.job_id == job_id and reply.error:
                        raise ImaginationError(reply.error)
                    if reply.job_id == job_id and reply.result is not None:
                        self._failed_starts = 0
                        with suppress(ValueError):
                            worker.queue.remove(reply.result.index)
                            yield reply.result
                worker, reply = self._events.get_nowait()

    def _replace(self, worker: _WorkerProcess, waiting: deque[int]) -> Iterator[SampleResult]:
        """Removes a worker that has ended."""
        if worker not in self._workers:
            return
        self._workers.remove(worker)
        status = worker.exit_status()
        if not worker.has_started:
            self._failed_starts += 1
            waiting.extendleft(reversed(worker.queue))
            if self._failed_starts >= _MAX_FAILED_STARTS:
                raise ImaginationError(f"worker processes cannot be started: each one {status} at once")
        elif worker.queue:
            yield lost_sample(worker.queue.popleft(), f"its worker process {status}")
            waiting.extendleft(reversed(worker.queue))
        worker.queue.clear()

    def _stop(self, job_id: str, reason: str) -> Iterator[SampleResult]:
        """Stops all samples; yields the results of those that have begun."""
        for worker in self._workers:
            if worker.queue:
                worker.send(_Request(job_id, stop=True))
        end_s = time.monotonic() + _STOP_GRACE_S
        unbegun: deque[int] = deque()
        while any(worker.queue for worker in self._workers) and (left_s := end_s - time.monotonic()) > 0.0:
            for worker in self._workers:  # only the first one has begun
                while len(worker.queue) > 1:
                    worker.queue.pop()
            yield from self._next_results(job_id, unbegun, left_s)
        for worker in [each for each in self._workers if each.queue]:
            self._workers.remove(worker)
            worker.kill()
            yield lost_sample(worker.queue.popleft(), reason, is_interrupted=True)
            worker.queue.clear()


def run_worker() -> None:
    """Runs samples as requested on standard input, until it is closed; the main function of a worker process."""
    requests, replies = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not become part of a reply
    stopped: set[str] = set()
    tasks: SimpleQueue[_Request] = SimpleQueue()

    def read() -> None:
        while (request := _receive(requests)) is not None:
            if request.stop:
                stopped.add(request.job_id)
            else:
                tasks.put(request)
        os._exit(0)  # the parent has closed the pipe, or has died

    threading.Thread(target=read, daemon=True).start()
    _send(replies, _Reply())
    runner: SampleRunner | None = None
    while True:
        request = tasks.get()
        if request.job_id in stopped:
            continue
        try:
            if request.job:
                runner = None
                runner = SampleRunner(pickle.loads(request.job))
            assert runner is not None
            for index in request.indices:
                result = runner.run(index, stop=partial(stopped.__contains__, request.job_id))
                _send(replies, _Reply(request.job_id, result=result))
        except MindstageError as error:
            _send(replies, _Reply(request.job_id, error=str(error)))
