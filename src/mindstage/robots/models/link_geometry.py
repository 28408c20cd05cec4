"""Geometry of the links of a robot description: visual meshes, and convex collision shapes.

A mesh in a `<collision>` is its convex hull, as in most planners. Visual meshes are imported when they are first drawn;
physics needs none. Meshes keep the axes of their files: RViz and the planners of ROS ignore the `up_axis` of COLLADA.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np

from mindstage.access.resources import is_inside, is_outside_request
from mindstage.assets.mesh_import import ImportedMesh, import_meshes
from mindstage.maps.io.ros_packages import RosPackagePath
from mindstage.maps.urdf.urdf_model import UrdfGeometry, UrdfGeometryType, UrdfRobot
from mindstage.robots.models.robot_model import ModelNote
from mindstage.scene import (
    BodyGeometry,
    CollisionShape,
    CollisionShapeType,
    Color,
    GeometrySource,
    PbrMaterial,
    Pose,
    VisualMesh,
)
from mindstage.scene import mesh as triangle_meshes
from mindstage.scene.mesh import TriangleMesh, convex_hull
from mindstage.scene.transforms import Array, normalized_pose_array, quat_rotate

__all__ = ["MeshPart", "PrimitivePart", "geometry_of_parts", "hull_shape", "primitive_mesh", "read_link_geometries"]

_PRIMITIVES = {
    UrdfGeometryType.BOX: CollisionShapeType.BOX,
    UrdfGeometryType.CYLINDER: CollisionShapeType.CYLINDER,
    UrdfGeometryType.SPHERE: CollisionShapeType.SPHERE,
}
_MESHES = {
    CollisionShapeType.BOX: triangle_meshes.box,
    CollisionShapeType.CYLINDER: triangle_meshes.cylinder,
    CollisionShapeType.SPHERE: triangle_meshes.sphere,
}
_DEFAULT_COLOR = (0.75, 0.75, 0.78)
"""Red, green, blue and opacity, each from 0 to 1."""
_MAX_HULL_POINTS = 96
"""Most vertices of a collision hull; the hull of a link of a real arm deviates by less than 2 mm then."""


@dataclass(frozen=True, slots=True)
class PrimitivePart:
    """A visual box, cylinder or sphere."""

    shape: CollisionShape
    color: Color | None = None


@dataclass(frozen=True, slots=True)
class MeshPart:
    """A visual mesh file."""

    path: Path
    pose: Pose
    """Pose of its origin in the link frame."""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color: Color | None = None
    """Replaces the color of a mesh without materials."""


VisualPart = PrimitivePart | MeshPart


def read_link_geometries(
    robot: UrdfRobot,
    path: Path,
    packages: RosPackagePath,
    *,
    touching: Collection[str] = (),
    divided: Collection[str] = (),
    cache: Path | None = None,
) -> tuple[dict[str, BodyGeometry], list[ModelNote]]:
    """Reads the geometry of all links.

    Args:
        robot: the robot description.
        path: its file; relative paths of meshes are relative to its folder.
        packages: where `package://` meshes are searched.
        touching: the links that have to touch things; without collision shapes, they get those of their visual meshes.
        divided: the links whose collision meshes are divided into convex parts; those of others are their hulls.
        cache: directory for imported meshes; by default in the user's cache.

    Returns:
        The geometry of the links that have any, and notes on meshes that could not be used, or are used for others.
    """
    solid_parts = {each.name: each.collisions for each in robot.links}
    bare = [each for each in robot.links if each.name in touching and each.visuals and not each.collisions]
    solid_parts |= {each.name: each.visuals for each in bare}
    files = {
        part.mesh: _mesh_file(part.mesh, path, packages)
        for link in robot.links
        for part in (*link.visuals, *link.collisions)
        if part.mesh is not None
    }
    solid = {part.mesh for parts in solid_parts.values() for part in parts if part.mesh is not None}
    in_parts = {part.mesh for name in divided for part in solid_parts[name] if part.mesh is not None}
    found = {name: file for name, file in files.items() if file is not None}
    imported, rejected = import_meshes(
        [file for name, file in found.items() if name in solid],
        folder=cache,
        decompose=False,
        keep_axes=True,
        visuals=False,
    )
    parts, _ = import_meshes(
        [file for name, file in found.items() if name in in_parts], folder=cache, keep_axes=True, visuals=False
    )
    drawn = tuple(
        dict.fromkeys(found[part.mesh] for link in robot.links for part in link.visuals if part.mesh in found)
    )
    geometries = {}
    for link in robot.links:
        meshes = imported | parts if link.name in divided else imported
        shapes = [shape for part in solid_parts[link.name] for shape in _collision_shapes(part, found, meshes)]
        visuals = [visual for part in link.visuals if (visual := _visual_part(part, found)) is not None]
        if shapes or visuals:
            geometries[link.name] = geometry_of_parts(visuals, shapes, reason=path.name, cache=cache, siblings=drawn)
    text = "it has no collision shapes, as a part of a gripper needs them: the hulls of its visual meshes are used"
    guesses = [ModelNote(subject=link.name, text=text) for link in bare]
    return geometries, [*_missing_notes(robot, found), *_rejection_notes(robot, found, rejected), *guesses]


def _mesh_file(name: str, urdf_path: Path, packages: RosPackagePath) -> Path | None:
    """Returns the file of a mesh, or None if it does not exist."""
    if name.startswith("package:"):
        try:  # some files have a third slash
            return packages.find("package://" + name.removeprefix("package:").lstrip("/"))
        except ValueError:
            return None
    parts = urlsplit(name)
    if parts.scheme not in ("", "file"):
        return None
    # Files that are included from a folder of macros are relative to the folder above it.
    folders = list(urdf_path.resolve().parents)[:2]
    candidates = ((folder / unquote(parts.path), folder) for folder in folders)
    outside = is_outside_request()
    return next((each for each, at in candidates if each.is_file() and (not outside or is_inside(each, at))), None)


def _missing_notes(robot: UrdfRobot, found: Mapping[str, Path]) -> list[ModelNote]:
    """One note for each link with meshes that were not found."""
    notes = []
    for link in robot.links:
        names = {part.mesh: None for part in (*link.visuals, *link.collisions) if part.mesh is not None}
        if missing := [name for name in names if name not in found]:
            text = f"{len(missing)} of its meshes were not found and are left out: {', '.join(missing[:3])}"
            notes.append(ModelNote(subject=link.name, text=text, is_guess=False))
    return notes


def _rejection_notes(robot: UrdfRobot, found: Mapping[str, Path], rejected: Mapping[Path, str]) -> list[ModelNote]:
    notes = []
    for link in robot.links:
        for part in link.collisions:
            file = found.get(part.mesh or "")
            if file is not None and (reason := rejected.get(file)) is not None:
                text = f"its collision mesh {part.mesh} is left out: {reason}"
                notes.append(ModelNote(subject=link.name, text=text, is_guess=False))
    return notes


def _collision_shapes(
    part: UrdfGeometry, files: Mapping[str, Path], imported: Mapping[Path, ImportedMesh]
) -> Iterator[CollisionShape]:
    if part.geometry_type is not UrdfGeometryType.MESH:
        shapes: Iterable[CollisionShape | None] = (_primitive_shape(part),)
    else:
        file = files.get(part.mesh or "")
        mesh = None if file is None else imported.get(file)
        pieces = () if mesh is None else mesh.convex_parts
        shapes = (hull_shape(_placed(points * part.mesh_scale, part.mesh_origin)) for points in pieces)
    yield from (shape for shape in shapes if shape is not None)


def _primitive_shape(part: UrdfGeometry) -> CollisionShape | None:
    if part.size is None:
        return None
    return CollisionShape(type=_PRIMITIVES[part.geometry_type], size=part.size, pose=part.origin)


def _visual_part(part: UrdfGeometry, files: Mapping[str, Path]) -> VisualPart | None:
    if part.geometry_type is UrdfGeometryType.MESH:
        file = files.get(part.mesh or "")
        return None if file is None else MeshPart(file, part.mesh_origin, part.mesh_scale, part.color)
    shape = _primitive_shape(part)
    return None if shape is None else PrimitivePart(shape, part.color)


def hull_shape(points: Array) -> CollisionShape | None:
    """Returns the convex hull of points in the link frame, with at most `_MAX_HULL_POINTS` vertices.

    A flat set of points is a box around them; None without points.
    """
    if not len(points):
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    center, size = (low + high) / 2, high - low
    pose = Pose(_vector(center))
    hull = convex_hull(points - center)
    if hull is None:
        return CollisionShape(type=CollisionShapeType.BOX, size=_vector(size), pose=pose)
    corners = _outermost(hull.points)
    return CollisionShape(
        type=CollisionShapeType.HULL, size=_vector(size), pose=pose, points=tuple(map(_vector, corners))
    )


def _outermost(points: Array) -> Array:
    """At most `_MAX_HULL_POINTS` points, each the farthest in one of evenly distributed directions."""
    if len(points) <= _MAX_HULL_POINTS:
        return points
    count = _MAX_HULL_POINTS - 6
    steps = np.arange(count) + 0.5
    down, around = np.arccos(1.0 - 2.0 * steps / count), np.pi * (1.0 + 5**0.5) * steps  # a Fibonacci lattice
    directions = np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=1)
    directions = np.concatenate([np.eye(3), -np.eye(3), directions])  # the bounding box stays the same
    stretched = points / np.maximum(np.ptp(points, axis=0), 1e-9)  # otherwise the edges of thin plates are missed
    return np.asarray(points[np.unique(np.argmax(stretched @ directions.T, axis=0))])


# -- visual meshes -----------------------------------------------------------------------------------------------------


def geometry_of_parts(
    visuals: Sequence[VisualPart],
    shapes: Iterable[CollisionShape],
    *,
    reason: str,
    cache: Path | None = None,
    siblings: tuple[Path, ...] = (),
) -> BodyGeometry:
    """Returns the geometry of a link, whose visual meshes are imported on first access.

    Args:
        reason: where it comes from, for reports.
        cache: directory for imported meshes; by default in the user's cache.
        siblings: the visual meshes of all links, which are drawn together with this one.
    """
    shapes = tuple(shapes)
    return BodyGeometry.deferred(
        _Drawing(tuple(visuals), shapes, cache, siblings),
        collision_shapes=shapes,
        source=GeometrySource.MESH,
        reason=reason,
        shape_name="mesh",
    )


@dataclass(frozen=True, slots=True)
class _Drawing:
    """Computes the visual meshes of a link; it can be pickled."""

    visuals: tuple[VisualPart, ...]
    shapes: tuple[CollisionShape, ...]
    cache: Path | None
    siblings: tuple[Path, ...]

    def __call__(self) -> tuple[str, tuple[VisualMesh, ...]]:
        files = [part.path for part in self.visuals if isinstance(part, MeshPart)]
        imported, _ = import_meshes(
            files, folder=self.cache, decompose=False, keep_axes=True, likely_next=self.siblings
        )
        meshes: list[VisualMesh] = []
        digest = hashlib.sha256(repr(self.shapes).encode())
        for part in self.visuals:
            if isinstance(part, PrimitivePart):
                digest.update(repr(part).encode())
                meshes.append(primitive_mesh(part))
            elif (mesh := imported.get(part.path)) is not None:
                digest.update(repr((mesh.digest, part.pose, part.scale, part.color)).encode())
                meshes += (_placed_visual(visual, part) for visual in mesh.visuals)
        return digest.hexdigest()[:32], tuple(meshes)


def primitive_mesh(part: PrimitivePart) -> VisualMesh:
    """Returns the visual mesh of a primitive shape or a hull, in the frame of the link."""
    if part.shape.type is CollisionShapeType.HULL:
        mesh = _hull_mesh(part.shape)
    else:
        mesh = _MESHES[part.shape.type](part.shape.size)
    pose = normalized_pose_array(part.shape.pose)
    normals = None if mesh.normals is None else quat_rotate(pose[3:], mesh.normals)
    material = PbrMaterial(color=part.color or _DEFAULT_COLOR, roughness=0.6)
    return VisualMesh(quat_rotate(pose[3:], mesh.points) + pose[:3], mesh.faces, material, normals)


def _hull_mesh(shape: CollisionShape) -> TriangleMesh:
    hull = convex_hull(np.array(shape.points))
    if hull is None:
        return triangle_meshes.box(shape.size)
    return TriangleMesh(hull.points, hull.faces.astype(np.uint32))


def _placed_visual(visual: VisualMesh, part: MeshPart) -> VisualMesh:
    rotation = normalized_pose_array(part.pose)[3:]
    scale, faces, normals = np.array(part.scale), visual.faces, visual.normals
    if np.prod(scale) < 0.0:
        faces = faces[:, ::-1]
    if normals is not None:
        normals = normals / np.where(scale == 0.0, 1.0, scale)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = quat_rotate(rotation, normals / np.where(lengths > 0.0, lengths, 1.0))
    material = visual.material
    if part.color is not None and visual.image is None:
        material = PbrMaterial(color=part.color, roughness=material.roughness, metalness=material.metalness)
    points = _placed(visual.points * scale, part.pose)
    return VisualMesh(points, faces, material, normals, visual.uv, visual.image)


def _placed(points: Array, pose: Pose) -> Array:
    row = normalized_pose_array(pose)
    return np.asarray(quat_rotate(row[3:], points) + row[:3])


def _vector(row: Array) -> tuple[float, float, float]:
    x, y, z = row.tolist()
    return x, y, z
