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
from collections.abc import Iterable, Iterator, Mapping
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

__all__ = ["ImportedMesh", "import_meshes"]

_VERSION = 2
"""Version of the cached files."""
_REJECTED_SUFFIX = ".rejected"
_EXIT_TIMEOUT_S = 10.0
"""Time for a worker that has closed its output to exit [s]."""
_TIMEOUT_S = 60.0
"""Timeout for one file; convex decomposition is the slow part."""


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
) -> tuple[dict[Path, ImportedMesh], dict[Path, str]]:
    """Imports files, or loads them from the cache.

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
    for path, result in _import_in_worker(cache_files, timeout_s, decompose=decompose, keep_axes=keep_axes):
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
    return imported, rejected


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


def _import_in_worker(
    cache_files: Mapping[Path, Path], timeout_s: float, *, decompose: bool, keep_axes: bool
) -> Iterator[tuple[Path, _Result]]:
    """Imports files to cache files in a worker.

    A file on which the worker crashes or times out is retried without convex decomposition, and the cached import
    says why; other files are not affected.
    """
    pending = list(cache_files)
    missing = "" if not decompose or _can_decompose() else "coacd is not installed (extra `pieces`)"
    hull_reasons: dict[Path, str] = {}
    """Why files are not decomposed after all; their convex hulls are used."""
    while pending:
        with _MeshWorker() as worker:
            while pending:
                path = pending[0]
                # A name of its own: another process may import the same file at the same time.
                out = cache_files[path].with_name(f".{uuid4().hex}.part.npz")
                reason = missing or hull_reasons.get(path, "")
                parts = decompose and not reason
                result = worker.read(
                    path, out, decompose=parts, hull_reason=reason, keep_axes=keep_axes, timeout_s=timeout_s
                )
                if worker.is_lost and parts:
                    again = f"remove {cache_files[path]} to try it again"
                    hull_reasons[path] = f"its convex decomposition failed: {result.reason}; {again}"
                    break
                pending.pop(0)
                try:
                    if not result.reason:
                        out.replace(cache_files[path])
                    out.unlink(missing_ok=True)
                except OSError as error:
                    result = _Result(_cache_problem(out.parent, error.strerror or str(error)), is_transient=True)
                yield path, result
                if worker.is_lost:
                    break


def _cache_problem(folder: Path, cause: str) -> str:
    return f"the cache {folder} cannot be written: {cause}; free space, or set MINDSTAGE_CACHE to another folder"


class _MeshWorker:
    """The worker process, as a context manager."""

    def __init__(self) -> None:
        self.is_lost = False
        """Whether it has crashed or exceeded the time limit, and cannot be used again."""

    def __enter__(self) -> _MeshWorker:
        # -P: modules in the working directory must not be imported
        command = [sys.executable, "-P", "-m", "mindstage.assets.mesh_worker"]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self._answers: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, name="mindstage-meshes", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
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
