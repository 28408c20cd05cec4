"""Mesh files: surfaces that others have modelled, as large as their bodies are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mindstage.exports.solids import Triangles
from mindstage.world import Vector
from mindstage.world.geometry import fitting_scale

__all__ = ["fitted", "load_triangles"]

_SUFFIXES = frozenset({".obj", ".stl", ".ply", ".off", ".glb"})


def load_triangles(path: Path) -> Triangles | None:
    """The surface in a file; None where it is of another format, or broken."""
    import trimesh

    if path.suffix.lower() not in _SUFFIXES:
        return None
    try:
        mesh = trimesh.load_mesh(path, process=False, skip_materials=True)
        points = np.asarray(mesh.vertices, dtype=np.float64)
        faces = np.asarray(mesh.faces, dtype=np.uint32)
    except Exception:  # its readers of broken files raise whatever they stumble over
        return None
    whole = len(faces) and points.ndim == 2 and points.shape[1] == 3 and np.isfinite(points).all()
    return Triangles(points, faces) if whole and int(faces.max()) < len(points) else None


def fitted(triangles: Triangles, size: Vector | None) -> Triangles:
    """The surface as large as a body, if that is known and differs."""
    extents = np.ptp(triangles.points, axis=0)
    return triangles._replace(points=triangles.points * fitting_scale(extents, size))
