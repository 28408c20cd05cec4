"""Mesh sizes: the box around a mesh, where its file is at hand and of a plain format (STL, OBJ)."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

import numpy as np

from mindstage.knowledge.sources.packages import RosPackagePath
from mindstage.world.geometry import Array

__all__ = ["MeshBounds", "mesh_bounds"]

_LENGTH_LIMIT = 256 * 1024 * 1024


class MeshBounds(NamedTuple):
    """A box in the frame of the mesh, in the mesh's own units."""

    center: Array
    size: Array


def mesh_bounds(name: str, urdf_path: Path, packages: RosPackagePath) -> MeshBounds | None:
    """The box around a mesh; None where the file is not there, or is none that can be measured."""
    try:
        path = _mesh_path(name, urdf_path, packages)
        measure = None if path is None else _FORMATS.get(path.suffix.lower())
        # What is no plain file, a pipe or a device, may have no end.
        if path is None or measure is None or not path.is_file() or path.stat().st_size > _LENGTH_LIMIT:
            return None
        data = path.read_bytes()
    except (OSError, ValueError):
        return None
    points = measure(data)
    if points is None or not len(points) or not np.isfinite(points).all():
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    return MeshBounds((low + high) / 2, high - low)


def _mesh_path(name: str, urdf_path: Path, packages: RosPackagePath) -> Path | None:
    if name.startswith("package:"):
        try:
            return packages.find(name)
        except ValueError:
            return None
    parts = urlsplit(name)
    if parts.scheme not in ("", "file"):
        return None
    return urdf_path.parent / unquote(parts.path)


def _stl_vertices(data: bytes) -> Array | None:
    if len(data) >= 84:
        (count,) = struct.unpack_from("<I", data, 80)
        if len(data) == 84 + 50 * count:
            kind = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("rest", "<u2")])
            facets = np.frombuffer(data, kind, count, 84)
            return np.asarray(facets["points"].reshape(-1, 3), dtype=np.float64)
    return _vertex_lines(data, b"vertex")


def _obj_vertices(data: bytes) -> Array | None:
    return _vertex_lines(data, b"v")


def _vertex_lines(data: bytes, word: bytes) -> Array | None:
    rows = [parts[1:4] for line in data.splitlines() if (parts := line.split())[:1] == [word]]
    try:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError:
        return None


_FORMATS = {".obj": _obj_vertices, ".stl": _stl_vertices}
