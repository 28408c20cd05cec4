"""Imports mesh files as arrays, in a separate process, with a cache."""

from __future__ import annotations

import hashlib
import json
import queue
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from mindstage.files import cache_dir
from mindstage.scene import PbrMaterial, VisualMesh
from mindstage.scene.transforms import Array

__all__ = ["ImportedMesh", "import_meshes"]

_VERSION = 1
"""Version of the cached files."""
_REJECTED_SUFFIX = ".refused"
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
    low: Array
    """Lower corner of the bounding box."""
    high: Array


def import_meshes(
    paths: Iterable[Path], *, folder: Path | None = None, timeout_s: float = _TIMEOUT_S
) -> tuple[dict[Path, ImportedMesh], dict[Path, str]]:
    """Imports files, or loads them from the cache.

    Args:
        paths: the files.
        folder: the cache directory; by default in the user's cache.
        timeout_s: timeout for each file [s].

    Returns:
        The imported meshes, and the reasons why other files were rejected.
    """
    folder = folder or cache_dir("meshes")
    imported: dict[Path, ImportedMesh] = {}
    rejected: dict[Path, str] = {}
    missing: dict[Path, tuple[str, Path]] = {}
    for path in dict.fromkeys(paths):
        try:
            digest = _digest(path)
        except OSError as error:
            rejected[path] = error.strerror or str(error)
            continue
        cache_file = folder / f"{digest}.npz"
        if (mesh := _load_cached(path, digest, cache_file)) is not None:
            imported[path] = mesh
        elif reason := _rejection_reason(cache_file):
            rejected[path] = reason
        else:
            missing[path] = (digest, cache_file)
    for path, reason in _import_in_worker({path: cache_file for path, (_, cache_file) in missing.items()}, timeout_s):
        mesh = None if reason else _load_cached(path, *missing[path])
        if mesh is None:
            rejected[path] = reason or "its import could not be cached"
            # Cached as well, so that the import is not tried again.
            missing[path][1].with_suffix(_REJECTED_SUFFIX).write_text(rejected[path])
        else:
            imported[path] = mesh
    return imported, rejected


def _rejection_reason(cache_file: Path) -> str:
    try:
        return cache_file.with_suffix(_REJECTED_SUFFIX).read_text()
    except OSError:
        return ""


@cache
def _can_decompose() -> bool:
    try:
        return find_spec("coacd") is not None
    except ValueError:  # the module was disabled in `sys.modules`
        return False


def _digest(path: Path) -> str:
    """Hash of a file and of how it is imported; files beside it, which it may reference, count by size and time."""
    hasher = hashlib.sha256(f"{_VERSION} {_can_decompose()} {path.suffix.lower()}".encode())
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            hasher.update(block)
    if path.suffix.lower() in {".gltf", ".obj", ".dae"}:
        for neighbor in sorted(path.parent.iterdir()):
            if neighbor != path and neighbor.is_file():
                status = neighbor.stat()
                hasher.update(f"{neighbor.name} {status.st_size} {status.st_mtime_ns}".encode())
    return hasher.hexdigest()[:32]


def _load_cached(path: Path, digest: str, cache_file: Path) -> ImportedMesh | None:
    try:
        with np.load(cache_file, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, KeyError, BadZipFile):
        return None
    visuals = tuple(
        _load_visual(arrays, number) for number in range(sum(name.startswith("points_") for name in arrays))
    )
    convex_parts = tuple(
        arrays[f"piece_{number}"] for number in range(sum(name.startswith("piece_") for name in arrays))
    )
    if not (visuals and convex_parts):
        return None
    low = np.min([visual.points.min(axis=0) for visual in visuals], axis=0)
    high = np.max([visual.points.max(axis=0) for visual in visuals], axis=0)
    return ImportedMesh(path, digest, visuals, convex_parts, low, high)


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


def _import_in_worker(cache_files: Mapping[Path, Path], timeout_s: float) -> Iterator[tuple[Path, str]]:
    """Imports files to cache files in a worker; yields reasons for rejection, empty on success.

    A file on which the worker crashes or times out is retried without convex decomposition; other files are not
    affected.
    """
    pending = list(cache_files)
    decompose = _can_decompose()
    undecomposable: set[Path] = set()
    """Files whose decomposition takes too long; their convex hull is used."""
    while pending:
        with _MeshWorker() as worker:
            while pending:
                path = pending[0]
                out = cache_files[path].with_suffix(".part.npz")
                reason = worker.read(path, out, decompose=decompose and path not in undecomposable, timeout_s=timeout_s)
                if reason is None and decompose and path not in undecomposable:
                    undecomposable.add(path)
                    break
                pending.pop(0)
                if reason == "":
                    out.replace(cache_files[path])
                out.unlink(missing_ok=True)
                if reason is None:
                    yield path, f"importing it took longer than {timeout_s:g} s, or crashed the importer"
                    break
                yield path, reason


class _MeshWorker:
    """The worker process, as a context manager."""

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

    def read(self, path: Path, out: Path, *, decompose: bool, timeout_s: float) -> str | None:
        """The reason why a file was rejected, empty if it was not; None if the worker crashed or timed out."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"path": str(path), "out": str(out), "pieces": decompose}) + "\n")
            self._process.stdin.flush()
            response = self._answers.get(timeout=timeout_s)
        except (OSError, queue.Empty):
            return None
        return str(json.loads(response)["why"]) if response else None
