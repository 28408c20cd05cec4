"""RayExecutor: samples on a Ray cluster, for those who outgrow one machine.

The job is put into Ray's object store once, and each worker process of the cluster unpacks it once. A few batches per
core are in flight, so that any number of samples needs the same memory here. Ray repeats a batch whose node is lost; a
batch that is lost again and again is unknown.
"""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from pathlib import Path
from typing import Any
from uuid import uuid4

from mindstage.errors import ImaginationError
from mindstage.files import home_folder
from mindstage.imagination.execution import never
from mindstage.imagination.executors import Job, SampleRunner, lost_sample
from mindstage.imagination.results import SampleResult

__all__ = ["RayExecutor"]

_BATCH = 5
"""Samples of one task: a task costs about a millisecond."""
_IN_FLIGHT = 2
"""Tasks in flight for each core."""
_MAX_RETRIES = 3
"""How often Ray repeats a task whose worker or node was lost."""
_CONNECT_TIMEOUT_S = 30.0
_CONNECT_ATTEMPTS = 3
_NO_CLIENT_SERVER = ("Starting Ray client server failed", "Initialization failure from server")
"""In the errors of a cluster that answers while its server for this client ended or was late; another may start."""


def _installed_version() -> str:
    try:
        return version("mindstage")
    except PackageNotFoundError:
        return "of a checkout"


_VERSION = _installed_version()


def _has_token() -> bool:
    """Whether there is a token for clusters that demand one, where Ray looks for it."""
    if os.environ.get("RAY_AUTH_TOKEN") or os.environ.get("RAY_AUTH_TOKEN_PATH"):
        return True
    home = home_folder()
    return home is not None and (home / ".ray" / "auth_token").is_file()


class RayExecutor:
    """Runs samples as tasks of a Ray cluster."""

    def __init__(self, address: str = "ray", *, cores: int | None = None) -> None:
        """Connects to a cluster, or starts one on this machine.

        Args:
            address: "ray" for a cluster on this machine, which ends with the executor, or for the one that this process
                is connected to already; "ray://HOST:PORT" for the Ray client server of a running cluster, whose nodes
                have the same versions of Mindstage, Ray and Python.
            cores: number of cores of a cluster that is started here; None for all.

        Raises:
            ImaginationError: Ray is not installed, or the cluster does not answer.
        """
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        if address != "ray" and _has_token():  # `ray start` then demands it, and its client does not send it
            os.environ.setdefault("RAY_AUTH_MODE", "token")
        try:
            import ray
        except ImportError as error:
            cause = f"Ray is not installed ({error}); install mindstage[ray]"
            raise ImaginationError(cause) from error
        self._ray = ray
        self._address = address
        self._is_own = not ray.is_initialized()
        self._closed = False
        if self._is_own:
            self._connect(cores)
        self._cores = max(
            1,
            int(ray.cluster_resources().get("CPU", 1)),  # type: ignore[no-untyped-call]
        )

    @property
    def name(self) -> str:
        """See `Executor`."""
        return f"a Ray cluster of {self._cores} core{'' if self._cores == 1 else 's'}"

    @property
    def notes(self) -> tuple[str, ...]:
        """See `Executor`."""
        return ()

    def run(
        self, job: Job, indices: Iterable[int], *, deadline_s: float, cancel: Callable[[], bool] = never
    ) -> Iterator[SampleResult]:
        """See `Executor`; deadlines are those of this machine, with a second for a batch to end."""
        ray, source = self._ray, iter(indices)
        job_id, data = uuid4().hex, ray.put(pickle.dumps(job, protocol=pickle.HIGHEST_PROTOCOL))
        run_batch = ray.remote(max_retries=_MAX_RETRIES, num_cpus=1)(_run_batch)
        tasks: dict[Any, tuple[int, ...]] = {}
        is_exhausted = False
        try:
            while True:
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0 or cancel():
                    yield from self._stop(tasks, "it was canceled" if left_s > 0.0 else "the time was over")
                    return
                while not is_exhausted and len(tasks) < _IN_FLIGHT * self._cores:
                    batch = tuple(islice(source, _BATCH))
                    if batch:
                        tasks[run_batch.remote(data, job_id, batch, left_s, _VERSION)] = batch
                    is_exhausted = len(batch) < _BATCH
                if not tasks:
                    return
                done, _ = ray.wait(list(tasks), num_returns=1, timeout=min(0.1, left_s))
                for task in done:
                    yield from self._results(task, tasks.pop(task))
        finally:
            self._cancel(tasks)

    def close(self) -> None:
        """Ends the cluster if it was started here, otherwise disconnects; closing it again has no effect."""
        if self._is_own and not self._closed:
            self._closed = True
            self._ray.shutdown()

    def __enter__(self) -> RayExecutor:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _connect(self, cores: int | None) -> None:
        options: dict[str, Any] = {"log_to_driver": False, "configure_logging": False}
        if self._address == "ray":
            search_path = os.pathsep.join(filter(None, (_package_folder(), os.environ.get("PYTHONPATH", ""))))
            environment = {"PYTHONPATH": search_path, "OMP_NUM_THREADS": "1"}
            options |= {"include_dashboard": False, "num_cpus": cores, "_node_ip_address": "127.0.0.1"}
            options |= {"address": "local", "runtime_env": {"env_vars": environment}}
        else:
            os.environ.setdefault("RAY_CLIENT_CONNECT_TIMEOUT", str(_CONNECT_TIMEOUT_S))
            options |= {"address": self._address}
        for attempts_left in reversed(range(_CONNECT_ATTEMPTS)):
            try:
                self._ray.init(**options)
            except Exception as error:  # Ray raises errors of many kinds, such as those of gRPC
                if attempts_left and any(each in str(error) for each in _NO_CLIENT_SERVER):
                    continue
                raise self._connection_error(error) from error
            return

    def _connection_error(self, error: Exception) -> ImaginationError:
        if self._address == "ray":
            return ImaginationError(f"the Ray cluster cannot be started: {error}")
        cause = f"the Ray cluster at {self._address} does not answer: {error}"
        if not _has_token():
            cause += "; if it demands a token, give it in RAY_AUTH_TOKEN or in ~/.ray/auth_token"
        return ImaginationError(cause)

    def _results(self, task: Any, batch: tuple[int, ...]) -> Iterator[SampleResult]:
        try:
            results, error = pickle.loads(self._ray.get(task))
        except self._ray.exceptions.RayError as lost:
            reason = f"its worker was lost: {type(lost).__name__}"
            yield from (lost_sample(index, reason) for index in batch)
            return
        if error:
            raise ImaginationError(error)
        yield from results

    def _stop(self, tasks: dict[Any, tuple[int, ...]], reason: str) -> Iterator[SampleResult]:
        """The results of tasks that end at once; samples of the others are unknown."""
        done, _ = self._ray.wait(list(tasks), num_returns=len(tasks), timeout=0.2) if tasks else ([], [])
        for task in done:
            yield from self._results(task, tasks.pop(task))
        for batch in tasks.values():
            yield from (lost_sample(index, reason, is_interrupted=True) for index in batch)

    def _cancel(self, tasks: dict[Any, tuple[int, ...]]) -> None:
        for task in tasks:
            self._ray.cancel(task, force=True)
        tasks.clear()


def _package_folder() -> str:
    return str(Path(__file__).resolve().parents[2])


_RUNNERS: dict[str, SampleRunner] = {}
"""The runner of the last job of this worker process, by its id."""


def _run_batch(job: bytes, job_id: str, indices: tuple[int, ...], left_s: float, wanted: str) -> bytes:
    """Runs samples in a worker of the cluster; returns the pickled results, and an error that concerns all samples."""
    deadline_s = time.monotonic() + left_s
    if wanted != _VERSION:
        error = f"the node has Mindstage {_VERSION}, and this machine has {wanted}; install the same version"
        return pickle.dumps(([], error))
    try:
        if job_id not in _RUNNERS:
            _RUNNERS.clear()
            _RUNNERS[job_id] = SampleRunner(pickle.loads(job))
        runner = _RUNNERS[job_id]
        return pickle.dumps(([runner.run(index, stop=lambda: time.monotonic() > deadline_s) for index in indices], ""))
    except Exception as error:
        return pickle.dumps(([], f"{type(error).__name__}: {error}"))
