"""Assets: for each body whose mesh is at hand, the form that the mesh gives it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mindstage.assets.catalog import MeshIndex, MeshMatch
from mindstage.assets.levels import find_support_surfaces
from mindstage.assets.reading import ImportedMesh, import_meshes
from mindstage.world import (
    Body,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    GeometrySource,
    Pose,
    Vector,
    VisualMesh,
)
from mindstage.world.geometry import Array, mesh_scale

__all__ = ["MeshGeometries", "MeshLibrary"]

_UNIFORM_SCALE_TOLERANCE = 0.02
"""Factors that differ by less than this part are one."""
_CENTER_TOLERANCE = 0.01
"""A mesh whose middle is farther from its origin than this part of its extent is moved."""
_Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From y up to z up, x kept: many modellers' files are so, and neither OBJ nor STL says it."""
_UNSPECIFIED_UP_AXIS = frozenset({".obj", ".stl"})


class MeshGeometries(NamedTuple):
    """What the meshes gave."""

    geometry: dict[BodyId, BodyGeometry]
    notes: tuple[str, ...]
    """What was changed about a mesh to fit, and what could not be read."""


class MeshLibrary:
    """Mesh files in some folders."""

    def __init__(
        self,
        folders: Iterable[Path] = (),
        *,
        find_file: Callable[[str], Path | None] = lambda name: None,
        cache: Path | None = None,
    ) -> None:
        """Looks through the folders.

        Args:
            folders: where meshes may lie, at any depth.
            find_file: the file that a map's own name of a mesh stands for (`KnowledgeBase.find_file`).
            cache: where what was read is kept; by default in the user's cache.
        """
        self._index = MeshIndex(folders, find_file=find_file)
        self._cache = cache
        self._fit_cache: dict[tuple[str, Vector | None], tuple[BodyGeometry, str]] = {}

    def geometry_for(self, bodies: Sequence[Body]) -> MeshGeometries:
        """The forms of those bodies whose meshes are at hand and can be read; never fails because of a file."""
        found = {body.id: hit for body in bodies if (hit := self._index.find(body)) is not None}
        read, refused = import_meshes((hit.path for hit in found.values()), folder=self._cache)
        forms: dict[BodyId, BodyGeometry] = {}
        fitted: dict[str, list[BodyId]] = {}
        for body in bodies:
            hit = found.get(body.id)
            if hit is None or (mesh := read.get(hit.path)) is None:
                continue
            forms[body.id], what = self._fit(mesh, hit, body.size)
            if what:
                fitted.setdefault(what, []).append(body.id)
        notes = [*self._index.notes]
        notes += [f"the mesh {path} is left out: {why}" for path, why in refused.items()]
        notes += [f"{_join_ids(ids)}: {what}" for what, ids in fitted.items()]
        return MeshGeometries(forms, tuple(notes))

    def _fit(self, mesh: ImportedMesh, match: MeshMatch, size: Vector | None) -> tuple[BodyGeometry, str]:
        key = (mesh.digest, size)
        if key not in self._fit_cache:
            self._fit_cache[key] = _fit_mesh(mesh, match, size)
        return self._fit_cache[key]


def _fit_mesh(mesh: ImportedMesh, match: MeshMatch, size: Vector | None) -> tuple[BodyGeometry, str]:
    """A mesh as large as its body and in its middle, and what that took."""
    turn = _up_axis_rotation(mesh, size)
    corners = np.array([mesh.low, mesh.high]) @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    extents = high - low
    scale = mesh_scale(extents, size)
    # A body's origin is the middle of its size; without one, the mesh's own origin is all there is to go by.
    middle = (low + high) / 2 if size is not None else np.zeros(3)
    digest = hashlib.sha256(repr((mesh.digest, turn.tolist(), scale.tolist(), middle.tolist())).encode())
    skins = tuple(_transform_visual(skin, turn, scale, middle) for skin in mesh.visuals)
    # Pieces are cut out of a grid, and may stand out of the mesh by a part of a cell.
    solids = tuple(_hull_shape((np.clip(piece @ turn.T, low, high) - middle) * scale) for piece in mesh.convex_parts)
    form = BodyGeometry(
        key=digest.hexdigest()[:32],
        visuals=skins,
        collision_shapes=solids,
        source=GeometrySource.MESH,
        reason=f"the mesh {match.path.name}, found by its {match.matched_by}",
        shape_name="mesh",
        support_surfaces=find_support_surfaces(skins, solids),
    )
    return form, _describe_changes(mesh, turn, scale, np.abs(middle) / np.where(extents > 0.0, extents, 1.0))


def _up_axis_rotation(mesh: ImportedMesh, size: Vector | None) -> Array:
    """Whether the mesh has y up: taken so where only then it is as large as its body, all ways alike."""
    if size is None or mesh.path.suffix.lower() not in _UNSPECIFIED_UP_AXIS or not all(size):
        return np.eye(3)
    extents = mesh.high - mesh.low
    uneven = [float(np.ptp(ratio) / ratio.max()) for ratio in (extents / size, extents[[0, 2, 1]] / size)]
    return (
        _Z_UP_FROM_Y_UP
        if uneven[0] > 5 * _UNIFORM_SCALE_TOLERANCE and uneven[1] < _UNIFORM_SCALE_TOLERANCE
        else np.eye(3)
    )


def _transform_visual(visual: VisualMesh, turn: Array, scale: Array, middle: Array) -> VisualMesh:
    normals = None
    if visual.normals is not None:
        normals = visual.normals @ turn.T / scale
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(lengths > 0.0, lengths, 1.0)
    points = (visual.points @ turn.T - middle) * scale
    return VisualMesh(points, visual.faces, visual.material, normals, visual.uv, visual.image)


def _hull_shape(points: Array) -> CollisionShape:
    low, high = points.min(axis=0), points.max(axis=0)
    center = (low + high) / 2
    return CollisionShape(
        type=CollisionShapeType.HULL,
        size=_vector(high - low),
        pose=Pose(_vector(center)),
        points=tuple(map(_vector, points - center)),
    )


def _describe_changes(mesh: ImportedMesh, turn: Array, scale: Array, offset: Array) -> str:
    """What was done to a mesh, in words."""
    done = []
    if not np.array_equal(turn, np.eye(3)):
        done.append("is turned from y up to z up")
    if np.any(scale != 1.0):
        even = np.ptp(scale) / scale.max() < _UNIFORM_SCALE_TOLERANCE
        factor = f"{scale.mean():.4g}" if even else " x ".join(f"{part:.4g}" for part in scale)
        done.append(f"is scaled by {factor} to the map's size")
    if offset.max() > _CENTER_TOLERANCE:
        done.append("is moved to have its middle where the map has the body's")
    return f"the mesh {mesh.path.name} {' and '.join(done)}" if done else ""


def _join_ids(ids: Sequence[BodyId]) -> str:
    return ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
