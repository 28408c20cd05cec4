"""Geometry of bodies from mesh files.

Maps name meshes in many ways: by a path in some package, by the name of an Unreal asset with or without its `SM_`, or
not at all. `MeshIndex` finds a body's file by path, then by name, then by the name of its class, ignoring case and
prefix. `MeshLibrary` fits the meshes to the sizes of bodies. `find_support_surfaces` finds flat faces that look up, on
which objects can be placed.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import unquote

import numpy as np

from mindstage.assets.mesh_import import ImportedMesh, MeshProgress, import_meshes
from mindstage.scene import (
    IDENTITY,
    Body,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    GeometrySource,
    Iri,
    Pose,
    SupportSurface,
    Vector,
    VisualMesh,
)
from mindstage.scene.transforms import Array, mesh_scale

__all__ = ["SUFFIXES", "MeshIndex", "MeshLibrary", "MeshLibraryResult", "MeshMatch", "find_support_surfaces"]


SUFFIXES = (".glb", ".gltf", ".obj", ".dae", ".stl")
"""Supported formats; of several files with one name the first format is used, which has the best materials."""
_MAX_FILES = 200_000
"""Maximum number of files in a folder; the rest is ignored."""


class MeshMatch(NamedTuple):
    """The mesh file of a body, and whether its path, its name or the body's class matched."""

    path: Path
    matched_by: str


class MeshIndex:
    """Index of the mesh files in some folders."""

    def __init__(self, folders: Iterable[Path], *, find_file: Callable[[str], Path | None] = lambda name: None) -> None:
        """Indexes the folders.

        Args:
            folders: searched recursively; files in earlier folders take precedence.
            find_file: resolves a name in a map, such as `package://…`, to a path, or returns None.
        """
        self.notes: list[str] = []
        self._find_file = find_file
        self._by_path: dict[str, Path] = {}
        self._by_name: dict[str, list[Path]] = {}
        for folder in folders:
            self._index_folder(folder)

    def find(self, body: Body) -> MeshMatch | None:
        """The mesh file of a body, or None."""
        if body.mesh:
            resolved = self._find_file(body.mesh)
            if resolved is not None and resolved.suffix.lower() in SUFFIXES:
                return MeshMatch(resolved, "path")
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
                self.notes.append(f"{folder} has more than {_MAX_FILES} files; the others are ignored")
                return
            if path.suffix.lower() in SUFFIXES:
                self._by_path.setdefault(path.relative_to(folder).as_posix().lower(), path)
                self._by_name.setdefault(_normalized_name(path.name), []).append(path)

    def _find_by_path(self, name: str) -> Path | None:
        """The file whose path has the longest common suffix with a name such as `package://a/merged_meshes/b.dae`."""
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
    """All files below a folder in a fixed order; links to folders are not followed."""
    for parent, folders, files in os.walk(folder):
        folders.sort()
        for file in sorted(files):
            yield Path(parent, file)


def _normalized_name(name: str) -> str:
    """A file or class name in lower case, without suffix and `SM_` prefix."""
    normalized = name.lower()
    for suffix in SUFFIXES:
        normalized = normalized.removesuffix(suffix)
    return normalized.removeprefix("sm_")


_MIN_UP_COSINE = 0.985
"""Cosine of the steepest slope on which objects stay."""
_SAME_LEVEL_M = 0.005
"""Faces whose heights differ by less are on one level."""
_MIN_AREA_FRACTION = 0.2
"""Minimum area of a level, as a part of the mesh's horizontal bounding box."""
_MAX_HULL_BULGE = 1 / 30
"""Convex parts come from a voxel grid; they protrude by at most this part of the largest extent."""
_MIN_CLEARANCE_M = 0.01
"""Minimum clearance above a level for it to be used."""


def find_support_surfaces(
    visuals: Sequence[VisualMesh], collision_shapes: Sequence[CollisionShape] = ()
) -> tuple[SupportSurface, ...]:
    """Support surfaces of a mesh: its highest level, and lower levels with enough clearance above.

    Each surface is the rectangle around its faces, which may be larger than the faces: only an engine can determine
    whether an object stays where it is put. The highest surface is on the mesh, the others are inside.

    Args:
        visuals: the visual meshes.
        collision_shapes: the collision shapes, which may protrude slightly above a level.
    """
    faces = np.concatenate([visual.points[visual.faces.astype(np.intp)] for visual in visuals])
    low, high = faces.min(axis=(0, 1)), faces.max(axis=(0, 1))
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    up = normals[:, 2] > _MIN_UP_COSINE * doubled_areas
    found = _flat_levels(faces[up], doubled_areas[up] / 2, _MIN_AREA_FRACTION * float(np.prod((high - low)[:2])))
    contact_points = np.array(
        [np.add(point, each.pose.position) for each in collision_shapes for point in each.points]
    ).reshape(-1, 3)
    surfaces = []
    above: float | None = None
    for first, last in found:
        level = _contact_height(first, last, contact_points, _MAX_HULL_BULGE * float((high - low).max()))
        if above is None or above - level > _MIN_CLEARANCE_M:
            center = (first + last) / 2
            surfaces.append(
                SupportSurface(
                    center=(float(center[0]), float(center[1]), level),
                    size=(float(last[0] - first[0]), float(last[1] - first[1])),
                    clearance=None if above is None else above - level,
                    is_inside=above is not None,
                )
            )
            above = level
    return tuple(surfaces)


def _flat_levels(faces: Array, areas: Array, min_area: float) -> list[tuple[Array, Array]]:
    """Lower and upper corner of the faces of each level that is large enough, highest first."""
    heights = faces[:, :, 2].mean(axis=1) if len(faces) else np.zeros(0)
    order = np.argsort(-heights, kind="stable")
    starts = np.flatnonzero(np.diff(heights[order], prepend=np.inf) < -_SAME_LEVEL_M)
    return [
        (faces[rows].min(axis=(0, 1)), faces[rows].max(axis=(0, 1)))
        for rows in np.split(order, starts[1:] if len(starts) else [])
        if len(rows) and areas[rows].sum() >= min_area
    ]


def _contact_height(first: Array, last: Array, collision_points: Array, max_bulge: float) -> float:
    """Height at which objects rest on a level: that of its faces, or of collision shapes that protrude above."""
    level = float(last[2])
    over = np.all(
        (collision_points[:, :2] >= first[:2] - max_bulge) & (collision_points[:, :2] <= last[:2] + max_bulge), axis=1
    )
    bulges = collision_points[
        over & (collision_points[:, 2] > level) & (collision_points[:, 2] <= level + max_bulge), 2
    ]
    return float(bulges.max(initial=level))


_UNIFORM_SCALE_TOLERANCE = 0.02
"""Scale factors whose relative differences are smaller count as uniform."""
_CENTER_TOLERANCE = 0.01
"""Offset of a mesh's center from its origin, relative to its extent, up to which it is not reported."""
_Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From y up to z up, x kept; many OBJ and STL files have y up, without stating it."""
_UNSPECIFIED_UP_AXIS = frozenset({".obj", ".stl"})


class MeshLibraryResult(NamedTuple):
    """Geometry from mesh files."""

    geometry: dict[BodyId, BodyGeometry]
    notes: tuple[str, ...]
    """How meshes were changed to fit, and which files could not be read."""


class MeshLibrary:
    """The mesh files in some folders."""

    def __init__(
        self,
        folders: Iterable[Path] = (),
        *,
        find_file: Callable[[str], Path | None] = lambda name: None,
        cache: Path | None = None,
        progress: MeshProgress | None = None,
        decompose: bool = True,
    ) -> None:
        """Indexes the folders.

        Args:
            folders: searched recursively.
            find_file: resolves the name of a mesh in a map to a path (`KnowledgeBase.find_file`).
            cache: directory for imported meshes; by default in the user's cache.
            progress: called with the number of files that are imported, and of all that have to be.
            decompose: whether collision shapes are convex parts, which take nearly all of the time of an import;
                otherwise they are convex hulls, which suffice where nothing moves.
        """
        self._index = MeshIndex(folders, find_file=find_file)
        self._cache, self._progress, self._decompose = cache, progress, decompose
        self._fit_cache: dict[tuple[str, Vector | None], tuple[BodyGeometry, str]] = {}

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_progress": None}  # which belongs to this process

    def geometry_for(self, bodies: Sequence[Body]) -> MeshLibraryResult:
        """Geometry of the bodies with a readable mesh file; errors in files become notes."""
        found = {body.id: match for body in bodies if (match := self._index.find(body)) is not None}
        paths = (match.path for match in found.values())
        imported, rejected = import_meshes(
            paths, folder=self._cache, decompose=self._decompose, progress=self._progress
        )
        geometry: dict[BodyId, BodyGeometry] = {}
        changes: dict[str, list[BodyId]] = {}
        for body in bodies:
            match = found.get(body.id)
            if match is None or (mesh := imported.get(match.path)) is None:
                continue
            geometry[body.id], change = self._fit(mesh, match, body.size)
            if change:
                changes.setdefault(change, []).append(body.id)
        notes = [*self._index.notes]
        notes += [f"the mesh {path.name} is left out: {reason}" for path, reason in rejected.items()]
        hulls: dict[str, list[str]] = {}
        for path, mesh in imported.items():
            if mesh.hull_reason:
                hulls.setdefault(mesh.hull_reason, []).append(path.name)
        notes += [
            f"nothing fits into hollows of {_join_ids(names)}, whose collision shape is the convex hull: {reason}"
            for reason, names in hulls.items()
        ]
        notes += [f"{_join_ids(ids)}: {change}" for change, ids in changes.items()]
        return MeshLibraryResult(geometry, tuple(notes))

    def bounds(self, meshes: Sequence[tuple[str | None, Iri]]) -> list[tuple[Vector, Vector] | None]:
        """Lower and upper corners of mesh files in their own frames; None without a readable file.

        Args:
            meshes: the name of the mesh in the map, if it has one, and the class of a body.
        """
        bodies = (Body(id=BodyId(cls), iri=cls, cls=cls, pose=IDENTITY, mesh=mesh) for mesh, cls in meshes)
        found = [self._index.find(body) for body in bodies]
        paths = (match.path for match in found if match is not None)
        imported, _ = import_meshes(paths, folder=self._cache, decompose=self._decompose, progress=self._progress)
        known = (None if match is None else imported.get(match.path) for match in found)
        return [None if mesh is None else (_vector(mesh.low), _vector(mesh.high)) for mesh in known]

    def _fit(self, mesh: ImportedMesh, match: MeshMatch, size: Vector | None) -> tuple[BodyGeometry, str]:
        key = (mesh.digest, size)
        if key not in self._fit_cache:
            self._fit_cache[key] = _fit_mesh(mesh, match, size)
        return self._fit_cache[key]


def _fit_mesh(mesh: ImportedMesh, match: MeshMatch, size: Vector | None) -> tuple[BodyGeometry, str]:
    """The mesh scaled to the size of a body and centered, and a description of these changes."""
    rotation = _up_axis_rotation(mesh, size)
    corners = np.array([mesh.low, mesh.high]) @ rotation.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    extents = high - low
    scale = mesh_scale(extents, size)
    # A body's origin is the center of its size; without a size, the mesh keeps its own origin.
    center = (low + high) / 2 if size is not None else np.zeros(3)
    digest = hashlib.sha256(repr((mesh.digest, rotation.tolist(), scale.tolist(), center.tolist())).encode())
    visuals = tuple(_transform_visual(visual, rotation, scale, center) for visual in mesh.visuals)
    # Convex parts come from a grid, and may protrude from the mesh by a part of a cell.
    collision_shapes = tuple(
        _hull_shape((np.clip(part @ rotation.T, low, high) - center) * scale) for part in mesh.convex_parts
    )
    geometry = BodyGeometry(
        key=digest.hexdigest()[:32],
        visuals=visuals,
        collision_shapes=collision_shapes,
        source=GeometrySource.MESH,
        reason=f"the mesh {match.path.name}, found by its {match.matched_by}",
        shape_name="mesh",
        support_surfaces=find_support_surfaces(visuals, collision_shapes),
    )
    return geometry, _describe_changes(mesh, rotation, scale, np.abs(center) / np.where(extents > 0.0, extents, 1.0))


def _up_axis_rotation(mesh: ImportedMesh, size: Vector | None) -> Array:
    """The rotation to z up. OBJ and STL files are taken as y up if only then their proportions match the size."""
    if size is None or mesh.path.suffix.lower() not in _UNSPECIFIED_UP_AXIS or not all(size):
        return np.eye(3)
    extents = mesh.high - mesh.low
    unevenness = [float(np.ptp(ratio) / ratio.max()) for ratio in (extents / size, extents[[0, 2, 1]] / size)]
    return (
        _Z_UP_FROM_Y_UP
        if unevenness[0] > 5 * _UNIFORM_SCALE_TOLERANCE and unevenness[1] < _UNIFORM_SCALE_TOLERANCE
        else np.eye(3)
    )


def _transform_visual(visual: VisualMesh, rotation: Array, scale: Array, center: Array) -> VisualMesh:
    normals = None
    if visual.normals is not None:
        normals = visual.normals @ rotation.T / scale
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(lengths > 0.0, lengths, 1.0)
    points = (visual.points @ rotation.T - center) * scale
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


def _describe_changes(mesh: ImportedMesh, rotation: Array, scale: Array, offset: Array) -> str:
    """The changes to a mesh, in words."""
    changes = []
    if not np.array_equal(rotation, np.eye(3)):
        changes.append("is rotated from y up to z up")
    if np.any(scale != 1.0):
        is_uniform = np.ptp(scale) / scale.max() < _UNIFORM_SCALE_TOLERANCE
        factor = f"{scale.mean():.4g}" if is_uniform else " x ".join(f"{part:.4g}" for part in scale)
        changes.append(f"is scaled by {factor} to the map's size")
    if offset.max() > _CENTER_TOLERANCE:
        changes.append("is moved to center it at the body's pose")
    return f"the mesh {mesh.path.name} {' and '.join(changes)}" if changes else ""


def _join_ids(ids: Sequence[str]) -> str:
    return ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
