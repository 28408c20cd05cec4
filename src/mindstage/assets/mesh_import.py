"""Imports mesh files as arrays, in a separate process, with a cache."""

from __future__ import annotations

import hashlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from uuid import uuid4
from zipfile import BadZipFile

import numpy as np

from mindstage.files import atomic_write, cache_dir
from mindstage.scene import PbrMaterial, VisualMesh
from mindstage.scene.transforms import Array

__all__ = ["ImportedMesh", "MeshProgress", "import_meshes"]

_VERSION = 3
"""Version of the cached files."""
_REJECTED_SUFFIX = ".rejected"
_EXIT_TIMEOUT_S = 10.0
"""Time for a worker that has closed its output to exit [s]."""
_TIMEOUT_S = 60.0
"""Timeout for one file; convex decomposition is the slow part."""
_NO_DECOMPOSITION = "coacd is not installed (extra `pieces`)"
_MAX_WORKERS = 4
"""Number of processes, unless there are fewer cores: each may need some hundred MB."""
_FILES_PER_WORKER = 2
"""Smallest number of files for which another process is started, which takes as long as most files do."""

MeshProgress = Callable[[int, int], object]
"""Called with the number of files that are imported, and of all that have to be."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportedMesh:
    """The content of a mesh file in its own units; x forward, y left, z up."""

    path: Path
    digest: str
    """Hash of the file's content."""
    visuals: tuple[VisualMesh, ...]
    convex_parts: tuple[Array, ...]
    """Points of convex parts, k x 3 each."""
    hull_reason: str
    """Why the only part is the convex hull, although a decomposition was asked for; otherwise empty."""
    low: Array
    """Lower corner of the bounding box."""
    high: Array


def import_meshes(
    paths: Iterable[Path],
    *,
    folder: Path | None = None,
    timeout_s: float = _TIMEOUT_S,
    decompose: bool = True,
    keep_axes: bool = False,
    visuals: bool = True,
    likely_next: Iterable[Path] = (),
    progress: MeshProgress | None = None,
) -> tuple[dict[Path, ImportedMesh], dict[Path, str]]:
    """Imports files in several processes, or loads them from the cache.

    The cache remembers why a file was rejected, unless the cause may pass: a time limit that was exceeded, a worker
    that was killed, or a full disk.

    Args:
        paths: the files.
        folder: the cache directory; by default in the user's cache.
        timeout_s: timeout for each file [s].
        decompose: whether meshes are decomposed into convex parts; otherwise there is one, the convex hull.
        keep_axes: whether points keep the axes of the file, also if it states another direction than z as up.
        visuals: whether the visual meshes are loaded; otherwise there are none, and the bounds are those of the parts.
        likely_next: files that are imported to the cache as well if a process has to be started for one of the others,
            since starting it takes longer than most files do.
        progress: called after each file that is not in the cache, with their number so far and in all.

    Returns:
        The imported meshes, and the reasons why other files were rejected.
    """
    if folder is None:
        folder = cache_dir("meshes")
    else:
        with suppress(OSError):  # reported for each file
            folder.mkdir(parents=True, exist_ok=True)
    wanted = dict.fromkeys(paths)
    imported: dict[Path, ImportedMesh] = {}
    rejected: dict[Path, str] = {}
    missing: dict[Path, tuple[str, Path]] = {}
    for path in wanted:
        try:
            digest = _digest(path, decompose=decompose, keep_axes=keep_axes)
        except OSError as error:
            rejected[path] = error.strerror or str(error)
            continue
        cache_file = folder / f"{digest}.npz"
        if (mesh := _load_cached(path, digest, cache_file, visuals=visuals)) is not None:
            imported[path] = mesh
        elif reason := _rejection_reason(cache_file):
            rejected[path] = reason
        else:
            missing[path] = (digest, cache_file)
    cache_files = {path: cache_file for path, (_, cache_file) in missing.items()}
    others = dict.fromkeys(path for path in (likely_next if missing else ()) if path not in wanted)
    cache_files |= _not_imported(others, folder, decompose=decompose, keep_axes=keep_axes)
    report = progress or _report_nothing
    imports = _ImportQueue(cache_files, timeout_s, decompose=decompose, keep_axes=keep_axes)
    for done, (path, result) in enumerate(imports.results(), start=1):
        report(done, len(cache_files))
        cache_file = cache_files[path]
        is_final = result.reason != "" and not result.is_transient
        if is_final:
            with suppress(OSError):  # the cache is full, and the import is tried again
                atomic_write(cache_file.with_suffix(_REJECTED_SUFFIX), result.reason.encode())
        if path not in wanted:
            continue
        mesh = None if result.reason else _load_cached(path, *missing[path], visuals=visuals)
        if mesh is not None:
            imported[path] = mesh
            continue
        rejected[path] = result.reason or f"its import could not be read from the cache, {cache_file}"
        if not is_final:
            rejected[path] += "; it is tried again next time"
    return (
        {path: imported[path] for path in wanted if path in imported},
        {path: rejected[path] for path in wanted if path in rejected},
    )


def _report_nothing(done: int, total: int) -> None:
    """The default of `progress`."""


def _not_imported(paths: Iterable[Path], folder: Path, *, decompose: bool, keep_axes: bool) -> dict[Path, Path]:
    """The cache files of those files that have not been imported or rejected."""
    found = {}
    for path in paths:
        with suppress(OSError):  # reported when the file is wanted
            cache_file = folder / f"{_digest(path, decompose=decompose, keep_axes=keep_axes)}.npz"
            if not cache_file.exists() and not _rejection_reason(cache_file):
                found[path] = cache_file
    return found


def _rejection_reason(cache_file: Path) -> str:
    try:
        return cache_file.with_suffix(_REJECTED_SUFFIX).read_text(encoding="utf-8")
    except OSError:
        return ""


@cache
def _can_decompose() -> bool:
    try:
        return find_spec("coacd") is not None
    except ValueError:  # the module was disabled in `sys.modules`
        return False


def _digest(path: Path, *, decompose: bool, keep_axes: bool) -> str:
    """Hash of a file and of how it is imported; files beside it, which it may reference, count by size and time."""
    axes = " keep_axes" if keep_axes else ""
    hasher = hashlib.sha256(f"{_VERSION} {decompose and _can_decompose()} {path.suffix.lower()}{axes}".encode())
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            hasher.update(block)
    if path.suffix.lower() in {".gltf", ".obj", ".dae"}:
        for neighbor in sorted(path.parent.iterdir()):
            if neighbor != path and neighbor.is_file():
                status = neighbor.stat()
                hasher.update(os.fsencode(neighbor.name) + f" {status.st_size} {status.st_mtime_ns}".encode())
    return hasher.hexdigest()[:32]


def _load_cached(path: Path, digest: str, cache_file: Path, *, visuals: bool) -> ImportedMesh | None:
    try:
        with np.load(cache_file, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files if visuals or name.startswith("piece_")}
            has_visuals = "points_0" in file.files
            hull_reason = str(file["hull_reason"]) if "hull_reason" in file.files else ""
    except (OSError, ValueError, EOFError, KeyError, BadZipFile):
        return None
    loaded = tuple(_load_visual(arrays, number) for number in range(sum(name.startswith("points_") for name in arrays)))
    convex_parts = tuple(
        arrays[f"piece_{number}"] for number in range(sum(name.startswith("piece_") for name in arrays))
    )
    if not (has_visuals and convex_parts):
        return None
    bounded = [visual.points for visual in loaded] or convex_parts
    low = np.min([points.min(axis=0) for points in bounded], axis=0)
    high = np.max([points.max(axis=0) for points in bounded], axis=0)
    return ImportedMesh(path, digest, loaded, convex_parts, hull_reason, low, high)


def _load_visual(arrays: Mapping[str, Array], number: int) -> VisualMesh:
    red, green, blue, metalness, roughness, opacity = arrays[f"surface_{number}"].tolist()
    surface = PbrMaterial(color=(red, green, blue), metalness=metalness, roughness=roughness, opacity=opacity)
    return VisualMesh(
        points=arrays[f"points_{number}"],
        faces=arrays[f"faces_{number}"].astype(np.uint32),
        material=surface,
        normals=arrays.get(f"normals_{number}"),
        uv=arrays.get(f"uv_{number}"),
        image=None if (image := arrays.get(f"image_{number}")) is None else image.astype(np.uint8),
    )


@dataclass(frozen=True, slots=True)
class _Result:
    """The result of an import."""

    reason: str
    """Why the file was rejected; empty if it was not."""
    is_transient: bool = False
    """Whether the cause may pass."""


_CRASH_SIGNALS = frozenset(
    getattr(signal, name).value
    for name in ("SIGSEGV", "SIGABRT", "SIGBUS", "SIGILL", "SIGFPE", "SIGTRAP")
    if hasattr(signal, name)
)
"""Signals by which a reader ends that crashes on the content of a file; others, such as SIGKILL, come from outside."""


class _ImportQueue:
    """Files that are imported to cache files by several worker processes, each served by a thread."""

    def __init__(self, cache_files: Mapping[Path, Path], timeout_s: float, *, decompose: bool, keep_axes: bool) -> None:
        """Starts no process yet."""
        self._files, self._count = iter(cache_files.items()), len(cache_files)
        self._timeout_s, self._decompose, self._keep_axes = timeout_s, decompose, keep_axes
        self._results: queue.SimpleQueue[tuple[Path, _Result] | Exception | None] = queue.SimpleQueue()
        self._workers: set[_MeshWorker] = set()
        self._is_stopped = False
        self._lock = threading.Lock()

    def results(self) -> Iterator[tuple[Path, _Result]]:
        """Imports the files; yields the results in the order in which they are ready."""
        count = max(min(_MAX_WORKERS, os.cpu_count() or 1, self._count // _FILES_PER_WORKER), min(self._count, 1))
        for _ in range(count):
            threading.Thread(target=self._serve, name="mindstage-mesh-import", daemon=True).start()
        try:
            while count:
                match self._results.get():
                    case None:
                        count -= 1
                    case Exception() as error:
                        raise error
                    case result:
                        yield result
        finally:
            with self._lock:
                self._is_stopped = True
                workers = list(self._workers)
            for worker in workers:
                worker.stop()

    def _serve(self) -> None:
        worker: _MeshWorker | None = None
        try:
            while (file := self._next()) is not None:
                hull_reason = "" if not self._decompose or _can_decompose() else _NO_DECOMPOSITION
                result = None
                while result is None:
                    worker = self._running(worker)
                    result, hull_reason = self._import(worker, *file, hull_reason)
                self._results.put((file[0], result))
        except Exception as error:  # raised where the results are used
            self._results.put(error)
        finally:
            if worker is not None:
                worker.stop()
            self._results.put(None)

    def _next(self) -> tuple[Path, Path] | None:
        with self._lock:
            return None if self._is_stopped else next(self._files, None)

    def _running(self, worker: _MeshWorker | None) -> _MeshWorker:
        """The same worker, or another one if that was lost."""
        if worker is not None and not worker.is_lost:
            return worker
        with self._lock:
            if worker is not None:
                worker.stop()
                self._workers.discard(worker)
                if self._is_stopped:
                    return worker
            worker = _MeshWorker()
            self._workers.add(worker)
        return worker

    def _import(
        self, worker: _MeshWorker, path: Path, cache_file: Path, hull_reason: str
    ) -> tuple[_Result | None, str]:
        """Imports one file.

        If the worker crashes or times out, the file is retried without convex decomposition: there is no result then,
        but a reason, which the cached import states.
        """
        # A name of its own: another process may import the same file at the same time.
        out = cache_file.with_name(f".{uuid4().hex}.part.npz")
        parts = self._decompose and not hull_reason
        result = worker.read(
            path, out, decompose=parts, hull_reason=hull_reason, keep_axes=self._keep_axes, timeout_s=self._timeout_s
        )
        if worker.is_lost and parts:
            again = f"remove {cache_file} to try it again"
            return None, f"its convex decomposition failed: {result.reason}; {again}"
        try:
            if not result.reason:
                out.replace(cache_file)
            out.unlink(missing_ok=True)
        except OSError as error:
            result = _Result(_cache_problem(out.parent, error.strerror or str(error)), is_transient=True)
        return result, hull_reason


def _cache_problem(folder: Path, cause: str) -> str:
    return f"the cache {folder} cannot be written: {cause}; free space, or set MINDSTAGE_CACHE to another folder"


class _MeshWorker:
    """A worker process."""

    def __init__(self) -> None:
        """Starts the process."""
        self.is_lost = False
        """Whether it has crashed or exceeded the time limit, and cannot be used again."""
        # -P: modules in the working directory must not be imported
        command = [sys.executable, "-P", "-m", "mindstage.assets.mesh_worker"]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self._answers: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, name="mindstage-meshes", daemon=True).start()

    def stop(self) -> None:
        """Ends the process, also while it reads a file."""
        self._process.kill()
        self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout:
            for line in self._process.stdout:
                self._answers.put(line)
        self._answers.put("")

    def read(
        self, path: Path, out: Path, *, decompose: bool, hull_reason: str, keep_axes: bool, timeout_s: float
    ) -> _Result:
        """Imports one file; `hull_reason` is written with it."""
        assert self._process.stdin is not None
        request = {
            "path": str(path),
            "out": str(out),
            "pieces": decompose,
            "hull_reason": hull_reason,
            "keep_axes": keep_axes,
        }
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            response = self._answers.get(timeout=timeout_s)
        except queue.Empty:
            self.is_lost = True
            return _Result(f"importing it took longer than {timeout_s:g} s", is_transient=True)
        except OSError:
            response = ""
        if not response:
            self.is_lost = True
            return self._exit_result()
        answer = json.loads(response)
        match answer["kind"]:
            case "cache":
                return _Result(_cache_problem(out.parent, str(answer["why"])), is_transient=True)
            case kind:
                return _Result(str(answer["why"]), is_transient=kind == "transient")

    def _exit_result(self) -> _Result:
        """Why the process has ended."""
        try:
            status = self._process.wait(_EXIT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            return _Result("the importer does not respond", is_transient=True)
        if -status in _CRASH_SIGNALS:
            return _Result(f"it crashes the importer ({signal.Signals(-status).name})")
        cause = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"exited with {status}"
        return _Result(f"the importer {cause}", is_transient=True)
