"""Meshes: files that MuJoCo can read, and how large what is in them is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mindstage.world import Vector
from mindstage.world.geometry import Array, mesh_scale, quat_rotate

__all__ = ["TriangleMesh", "load_mesh"]

_MESH_SUFFIXES = frozenset({".obj", ".stl", ".msh"})


@dataclass(frozen=True, slots=True)
class TriangleMesh:
    """One file."""

    path: Path
    extents: Array
    """Along x, y and z, in the file's own units."""

    def scale_to(self, size: Vector | None) -> tuple[float, float, float]:
        """What makes it as large as a body; 1 where it is so already, or where nobody knows."""
        x, y, z = mesh_scale(self.extents, size).tolist()
        return x, y, z


def load_mesh(path: Path) -> TriangleMesh | None:
    """A mesh, if MuJoCo can read it."""
    if path.suffix.lower() not in _MESH_SUFFIXES:
        return None
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(path), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        model = spec.compile()
    except ValueError:  # it says what is wrong with the file; whoever asked says that it is left out
        return None
    points = quat_rotate(model.mesh_quat[0], np.asarray(model.mesh_vert, dtype=np.float64)) + model.mesh_pos[0]
    return TriangleMesh(path, np.ptp(points, axis=0))
