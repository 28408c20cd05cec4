"""Assets: for each body whose mesh is at hand, the form that the mesh gives it.

Catalog: which mesh file is meant, among all those in some folders.

Maps name meshes as their makers did: by a path in somebody's package, by the name of an Unreal asset with or without
its `SM_`, or not at all. So a file is looked for by path, then by name, then by the name of the class; neither case
nor prefix counts.

Levels: where a mesh is flat and looks up, so that things can be put on it or into it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import unquote

import numpy as np

from mindstage.assets.mesh_import import ImportedMesh, import_meshes
from mindstage.scene import (
    Body,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    GeometrySource,
    Pose,
    SupportSurface,
    Vector,
    VisualMesh,
)
from mindstage.scene.transforms import Array, mesh_scale

__all__ = ["SUFFIXES", "MeshGeometries", "MeshIndex", "MeshLibrary", "MeshMatch", "find_support_surfaces"]


SUFFIXES = (".glb", ".gltf", ".obj", ".dae", ".stl")
"""What can be read; of several files of one name the earliest of these, since it says most about looks."""
_MAX_FILES = 200_000
"""A folder with more is no folder of meshes."""


class MeshMatch(NamedTuple):
    """A file, and by what it was found."""

    path: Path
    matched_by: str


class MeshIndex:
    """The mesh files in some folders."""

    def __init__(self, folders: Iterable[Path], *, find_file: Callable[[str], Path | None] = lambda name: None) -> None:
        """Looks through the folders, once.

        Args:
            folders: searched with all that is below them; what an earlier one has comes first.
            find_file: the file that a map's own name stands for, such as `package://…`.
        """
        self.notes: list[str] = []
        self._find_file = find_file
        self._by_path: dict[str, Path] = {}
        self._by_name: dict[str, list[Path]] = {}
        for folder in folders:
            self._index_folder(folder)

    def find(self, body: Body) -> MeshMatch | None:
        """The file for a body, if there is one."""
        if body.mesh:
            told = self._find_file(body.mesh)
            if told is not None and told.suffix.lower() in SUFFIXES:
                return MeshMatch(told, "path")
            if (path := self._find_by_path(body.mesh)) is not None:
                return MeshMatch(path, "path")
            if (path := self._find_by_name(PurePosixPath(body.mesh.replace("\\", "/")).name)) is not None:
                return MeshMatch(path, "name")
        local = body.cls.rpartition("#")[2].rpartition("/")[2]
        path = self._find_by_name(local)
        return None if path is None else MeshMatch(path, "class")

    def _index_folder(self, folder: Path) -> None:
        for count, path in enumerate(_files(folder)):
            if count == _MAX_FILES:
                self.notes.append(f"{folder} has more than {_MAX_FILES} files: only so many were looked at")
                return
            if path.suffix.lower() in SUFFIXES:
                self._by_path.setdefault(path.relative_to(folder).as_posix().lower(), path)
                self._by_name.setdefault(_normalized_name(path.name), []).append(path)

    def _find_by_path(self, name: str) -> Path | None:
        """The file whose path ends as the name does: of `package://a/merged_meshes/b.dae` first all, then `b.dae`'s folder."""
        parts = [
            part for part in unquote(name.partition("://")[2] or name).replace("\\", "/").lower().split("/") if part
        ]
        for start in range(len(parts) - 1):
            if (path := self._by_path.get("/".join(parts[start:]))) is not None:
                return path
        return None

    def _find_by_name(self, name: str) -> Path | None:
        paths = self._by_name.get(_normalized_name(name))
        if not paths:
            return None
        return min(paths, key=lambda path: SUFFIXES.index(path.suffix.lower()))


def _files(folder: Path) -> Iterator[Path]:
    """All files below a folder, in an order that is the same everywhere; links to folders are not followed."""
    for where, below, files in os.walk(folder):
        below.sort()
        for file in sorted(files):
            yield Path(where, file)


def _normalized_name(name: str) -> str:
    """A name without what makers of meshes put before and behind it."""
    plain = name.lower()
    for suffix in SUFFIXES:
        plain = plain.removesuffix(suffix)
    return plain.removeprefix("sm_")


_MIN_UP_COSINE = 0.985
"""Cosine of the steepest slope on which things stay."""
_SAME_LEVEL_M = 0.005
"""Faces whose heights differ by less are of one level."""
_MIN_AREA_FRACTION = 0.2
"""A level is at least so much of what its mesh covers of the ground."""
_MAX_HULL_BULGE = 1 / 30
"""Convex pieces are cut out of a grid; they stand out by so much of the largest extent at most."""
_MIN_CLEARANCE_M = 0.01
"""With less room above it nothing can be put on a level."""


def find_support_surfaces(
    visuals: Sequence[VisualMesh], collision_shapes: Sequence[CollisionShape] = ()
) -> tuple[SupportSurface, ...]:
    """The highest level of a mesh as a place on it, and those that are lower and have room above them as places in it.

    Each is the rectangle round its faces, which may be more than they fill: whether something stays where it is put is
    for an engine to find out.

    Args:
        skins: what is seen of it.
        solids: what can be touched of it, which may bulge a little over a level.
    """
    faces = np.concatenate([skin.points[skin.faces.astype(np.intp)] for skin in visuals])
    low, high = faces.min(axis=(0, 1)), faces.max(axis=(0, 1))
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    twice = np.linalg.norm(normals, axis=1)
    up = normals[:, 2] > _MIN_UP_COSINE * twice
    found = _flat_levels(faces[up], twice[up] / 2, _MIN_AREA_FRACTION * float(np.prod((high - low)[:2])))
    touched = np.array(
        [np.add(point, each.pose.position) for each in collision_shapes for point in each.points]
    ).reshape(-1, 3)
    places = []
    above: float | None = None
    for first, last in found:
        level = _contact_height(first, last, touched, _MAX_HULL_BULGE * float((high - low).max()))
        if above is None or above - level > _MIN_CLEARANCE_M:
            middle = (first + last) / 2
            places.append(
                SupportSurface(
                    center=(float(middle[0]), float(middle[1]), level),
                    size=(float(last[0] - first[0]), float(last[1] - first[1])),
                    clearance=None if above is None else above - level,
                    is_inside=above is not None,
                )
            )
            above = level
    return tuple(places)


def _flat_levels(faces: Array, areas: Array, min_area: float) -> list[tuple[Array, Array]]:
    """The corners round the faces of each level that is large enough, the highest first."""
    heights = faces[:, :, 2].mean(axis=1) if len(faces) else np.zeros(0)
    order = np.argsort(-heights, kind="stable")
    starts = np.flatnonzero(np.diff(heights[order], prepend=np.inf) < -_SAME_LEVEL_M)
    return [
        (faces[rows].min(axis=(0, 1)), faces[rows].max(axis=(0, 1)))
        for rows in np.split(order, starts[1:] if len(starts) else [])
        if len(rows) and areas[rows].sum() >= min_area
    ]


def _contact_height(first: Array, last: Array, collision_points: Array, max_bulge: float) -> float:
    """The height at which something stands on a level: that of its faces, or of what bulges over them."""
    level = float(last[2])
    over = np.all(
        (collision_points[:, :2] >= first[:2] - max_bulge) & (collision_points[:, :2] <= last[:2] + max_bulge), axis=1
    )
    bulges = collision_points[
        over & (collision_points[:, 2] > level) & (collision_points[:, 2] <= level + max_bulge), 2
    ]
    return float(bulges.max(initial=level))


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
