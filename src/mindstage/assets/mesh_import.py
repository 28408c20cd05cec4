"""Reading: mesh files become arrays, each file once, in a process that can be ended."""

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
"""Of what is kept; another one is made anew."""
_REJECTED_SUFFIX = ".refused"
_TIMEOUT_S = 60.0
"""For one file; taking it apart into convex pieces is the slow part."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportedMesh:
    """What is in a file, in its own units; x forward, y left, z up."""

    path: Path
    digest: str
    """Of the file's content."""
    visuals: tuple[VisualMesh, ...]
    convex_parts: tuple[Array, ...]
    """The corners of convex pieces, k x 3 each."""
    low: Array
    """The lower corner of the box around it."""
    high: Array


def import_meshes(
    paths: Iterable[Path], *, folder: Path | None = None, timeout_s: float = _TIMEOUT_S
) -> tuple[dict[Path, ImportedMesh], dict[Path, str]]:
    """Reads files, or takes what is kept of them.

    Args:
        paths: which.
        folder: where what was read is kept; by default in the user's cache.
        timeout_s: for each file [s].

    Returns:
        What could be read, and why the rest could not.
    """
    folder = folder or cache_dir("meshes")
    read: dict[Path, ImportedMesh] = {}
    refused: dict[Path, str] = {}
    missing: dict[Path, tuple[str, Path]] = {}
    for path in dict.fromkeys(paths):
        try:
            digest = _digest(path)
        except OSError as error:
            refused[path] = error.strerror or str(error)
            continue
        kept = folder / f"{digest}.npz"
        if (mesh := _load_cached(path, digest, kept)) is not None:
            read[path] = mesh
        elif why := _rejection_reason(kept):
            refused[path] = why
        else:
            missing[path] = (digest, kept)
    for path, why in _import_in_worker({path: kept for path, (_, kept) in missing.items()}, timeout_s):
        mesh = None if why else _load_cached(path, *missing[path])
        if mesh is None:
            refused[path] = why or "what was read of it could not be kept"
            missing[path][1].with_suffix(_REJECTED_SUFFIX).write_text(
                refused[path]
            )  # so that nobody waits for it again
        else:
            read[path] = mesh
    return read, refused


def _rejection_reason(cache_file: Path) -> str:
    try:
        return cache_file.with_suffix(_REJECTED_SUFFIX).read_text()
    except OSError:
        return ""


@cache
def _can_decompose() -> bool:
    try:
        return find_spec("coacd") is not None
    except ValueError:  # it was taken away on purpose
        return False


def _digest(path: Path) -> str:
    """Of the file, and of how it is read; what it names beside itself counts by its time."""
    hasher = hashlib.sha256(f"{_VERSION} {_can_decompose()} {path.suffix.lower()}".encode())
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            hasher.update(block)
    if path.suffix.lower() in {".gltf", ".obj", ".dae"}:
        for beside in sorted(path.parent.iterdir()):
            if beside != path and beside.is_file():
                told = beside.stat()
                hasher.update(f"{beside.name} {told.st_size} {told.st_mtime_ns}".encode())
    return hasher.hexdigest()[:32]


def _load_cached(path: Path, digest: str, cache_file: Path) -> ImportedMesh | None:
    try:
        with np.load(cache_file, allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, EOFError, KeyError, BadZipFile):
        return None
    skins = tuple(_load_visual(found, number) for number in range(sum(name.startswith("points_") for name in found)))
    pieces = tuple(found[f"piece_{number}"] for number in range(sum(name.startswith("piece_") for name in found)))
    if not (skins and pieces):
        return None
    low = np.min([skin.points.min(axis=0) for skin in skins], axis=0)
    high = np.max([skin.points.max(axis=0) for skin in skins], axis=0)
    return ImportedMesh(path, digest, skins, pieces, low, high)


def _load_visual(found: Mapping[str, Array], number: int) -> VisualMesh:
    red, green, blue, metalness, roughness, opacity = found[f"surface_{number}"].tolist()
    surface = PbrMaterial(color=(red, green, blue), metalness=metalness, roughness=roughness, opacity=opacity)
    return VisualMesh(
        points=found[f"points_{number}"],
        faces=found[f"faces_{number}"].astype(np.uint32),
        material=surface,
        normals=found.get(f"normals_{number}"),
        uv=found.get(f"uv_{number}"),
        image=None if (image := found.get(f"image_{number}")) is None else image.astype(np.uint8),
    )


def _import_in_worker(wanted: Mapping[Path, Path], timeout_s: float) -> Iterator[tuple[Path, str]]:
    """Has files read, each into the place given; a file that ends its reader costs only itself."""
    waiting = list(wanted)
    pieces = _can_decompose()
    hard: set[Path] = set()
    """What took too long to take apart: its hull must do."""
    while waiting:
        with _MeshWorker() as reader:
            while waiting:
                path = waiting[0]
                out = wanted[path].with_suffix(".part.npz")
                why = reader.read(path, out, decompose=pieces and path not in hard, timeout_s=timeout_s)
                if why is None and pieces and path not in hard:
                    hard.add(path)
                    break
                waiting.pop(0)
                if why == "":
                    out.replace(wanted[path])
                out.unlink(missing_ok=True)
                yield path, f"reading it took longer than {timeout_s:g} s, or ended the reader" if why is None else why
                if why is None:
                    break


class _MeshWorker:
    """The process, for as long as it lives."""

    def __enter__(self) -> _MeshWorker:
        # -P: nothing that lies in the working directory is taken for a library.
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
        """Why the file was refused; empty if it was not, None if the process is lost over it."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"path": str(path), "out": str(out), "pieces": decompose}) + "\n")
            self._process.stdin.flush()
            answer = self._answers.get(timeout=timeout_s)
        except (OSError, queue.Empty):
            return None
        return str(json.loads(answer)["why"]) if answer else None
