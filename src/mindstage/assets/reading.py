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

from mindstage.files import cache_folder
from mindstage.world import Skin, Surface
from mindstage.world.geometry import Array

__all__ = ["MeshFile", "read_meshes"]

_VERSION = 1
"""Of what is kept; another one is made anew."""
_REFUSED = ".refused"
_PATIENCE_S = 60.0
"""For one file; taking it apart into convex pieces is the slow part."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshFile:
    """What is in a file, in its own units; x forward, y left, z up."""

    path: Path
    digest: str
    """Of the file's content."""
    skins: tuple[Skin, ...]
    pieces: tuple[Array, ...]
    """The corners of convex pieces, k x 3 each."""
    low: Array
    """The lower corner of the box around it."""
    high: Array


def read_meshes(
    paths: Iterable[Path], *, folder: Path | None = None, timeout_s: float = _PATIENCE_S
) -> tuple[dict[Path, MeshFile], dict[Path, str]]:
    """Reads files, or takes what is kept of them.

    Args:
        paths: which.
        folder: where what was read is kept; by default in the user's cache.
        timeout_s: for each file [s].

    Returns:
        What could be read, and why the rest could not.
    """
    folder = folder or cache_folder("meshes")
    read: dict[Path, MeshFile] = {}
    refused: dict[Path, str] = {}
    missing: dict[Path, tuple[str, Path]] = {}
    for path in dict.fromkeys(paths):
        try:
            digest = _digest(path)
        except OSError as error:
            refused[path] = error.strerror or str(error)
            continue
        kept = folder / f"{digest}.npz"
        if (mesh := _kept(path, digest, kept)) is not None:
            read[path] = mesh
        elif why := _refusal(kept):
            refused[path] = why
        else:
            missing[path] = (digest, kept)
    for path, why in _read({path: kept for path, (_, kept) in missing.items()}, timeout_s):
        mesh = None if why else _kept(path, *missing[path])
        if mesh is None:
            refused[path] = why or "what was read of it could not be kept"
            missing[path][1].with_suffix(_REFUSED).write_text(refused[path])  # so that nobody waits for it again
        else:
            read[path] = mesh
    return read, refused


def _refusal(kept: Path) -> str:
    try:
        return kept.with_suffix(_REFUSED).read_text()
    except OSError:
        return ""


@cache
def _with_pieces() -> bool:
    try:
        return find_spec("coacd") is not None
    except ValueError:  # it was taken away on purpose
        return False


def _digest(path: Path) -> str:
    """Of the file, and of how it is read; what it names beside itself counts by its time."""
    hasher = hashlib.sha256(f"{_VERSION} {_with_pieces()} {path.suffix.lower()}".encode())
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            hasher.update(block)
    if path.suffix.lower() in {".gltf", ".obj", ".dae"}:
        for beside in sorted(path.parent.iterdir()):
            if beside != path and beside.is_file():
                told = beside.stat()
                hasher.update(f"{beside.name} {told.st_size} {told.st_mtime_ns}".encode())
    return hasher.hexdigest()[:32]


def _kept(path: Path, digest: str, kept: Path) -> MeshFile | None:
    try:
        with np.load(kept, allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, EOFError, KeyError, BadZipFile):
        return None
    skins = tuple(_skin(found, number) for number in range(sum(name.startswith("points_") for name in found)))
    pieces = tuple(found[f"piece_{number}"] for number in range(sum(name.startswith("piece_") for name in found)))
    if not (skins and pieces):
        return None
    low = np.min([skin.points.min(axis=0) for skin in skins], axis=0)
    high = np.max([skin.points.max(axis=0) for skin in skins], axis=0)
    return MeshFile(path, digest, skins, pieces, low, high)


def _skin(found: Mapping[str, Array], number: int) -> Skin:
    red, green, blue, metalness, roughness, opacity = found[f"surface_{number}"].tolist()
    surface = Surface(colour=(red, green, blue), metalness=metalness, roughness=roughness, opacity=opacity)
    return Skin(
        points=found[f"points_{number}"],
        faces=found[f"faces_{number}"].astype(np.uint32),
        surface=surface,
        normals=found.get(f"normals_{number}"),
        uv=found.get(f"uv_{number}"),
        image=None if (image := found.get(f"image_{number}")) is None else image.astype(np.uint8),
    )


def _read(wanted: Mapping[Path, Path], timeout_s: float) -> Iterator[tuple[Path, str]]:
    """Has files read, each into the place given; a file that ends its reader costs only itself."""
    waiting = list(wanted)
    pieces = _with_pieces()
    hard: set[Path] = set()
    """What took too long to take apart: its hull must do."""
    while waiting:
        with _Reader() as reader:
            while waiting:
                path = waiting[0]
                out = wanted[path].with_suffix(".part.npz")
                why = reader.read(path, out, pieces=pieces and path not in hard, timeout_s=timeout_s)
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


class _Reader:
    """The process, for as long as it lives."""

    def __enter__(self) -> _Reader:
        # -P: nothing that lies in the working directory is taken for a library.
        command = [sys.executable, "-P", "-m", "mindstage.assets.reading_process"]
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

    def read(self, path: Path, out: Path, *, pieces: bool, timeout_s: float) -> str | None:
        """Why the file was refused; empty if it was not, None if the process is lost over it."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"path": str(path), "out": str(out), "pieces": pieces}) + "\n")
            self._process.stdin.flush()
            answer = self._answers.get(timeout=timeout_s)
        except (OSError, queue.Empty):
            return None
        return str(json.loads(answer)["why"]) if answer else None
