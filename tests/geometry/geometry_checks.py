"""Independent checks of geometry, computed from its numbers only."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations, product

import numpy as np

from mindstage.scene import BodyGeometry, CollisionShape, CollisionShapeType, Pose, Vector, VisualMesh
from mindstage.scene.transforms import Array, rotation_matrix

__all__ = ["is_closed", "is_convex", "is_inside", "shape_bounds", "visual_bounds", "volume"]


def visual_bounds(geometry: BodyGeometry) -> tuple[Array, Array]:
    """Returns the bounds of all visual meshes."""
    points = np.concatenate([visual.points for visual in geometry.visuals])
    return points.min(axis=0), points.max(axis=0)


def is_closed(visual: VisualMesh) -> bool:
    """Returns whether each edge is used equally often in each direction.

    Vertices at one place count as one: they are duplicated where texture coordinates are discontinuous.
    """
    _, number = np.unique(visual.points, axis=0, return_inverse=True)
    edges = number.reshape(-1)[visual.faces][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    edges = edges[edges[:, 0] != edges[:, 1]]
    there = edges[:, 0] * len(visual.points) + edges[:, 1]
    back = edges[:, 1] * len(visual.points) + edges[:, 0]
    return np.array_equal(np.sort(there), np.sort(back))


def volume(visual: VisualMesh) -> float:
    """Returns the volume of a closed mesh [m³]; negative if its faces point inwards."""
    a, b, c = (visual.points[visual.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def shape_bounds(shape: CollisionShape) -> tuple[Array, Array]:
    """Returns the bounds of a collision shape in the body frame."""
    corners = _in_body(shape, _corners(shape))
    return corners.min(axis=0), corners.max(axis=0)


def is_convex(shape: CollisionShape) -> bool:
    """Returns whether each point of a hull is a vertex of it; other types are convex by definition."""
    if shape.type is not CollisionShapeType.HULL:
        return not shape.points and min(shape.size) > 0.0
    points = np.array(shape.points)
    normals, offsets = _facets(shape.points)
    distance = points @ normals.T - offsets
    return bool(np.all(np.max(distance, axis=1) > -1e-7 * np.ptp(points)))


def is_inside(shape: CollisionShape, point: Array, *, margin: float = 0.0) -> bool:
    """Returns whether a point in the body frame is inside a shape by at least a margin [m]."""
    local = _turn(shape.pose).T @ (point - np.array(shape.pose.position))
    half = np.array(shape.size) / 2 - margin
    match shape.type:
        case CollisionShapeType.BOX:
            return bool(np.all(np.abs(local) < half))
        case CollisionShapeType.SPHERE:
            return bool(np.all(half > 0.0) and np.sum((local / half) ** 2) < 1.0)
        case CollisionShapeType.CYLINDER:
            return bool(np.all(half > 0.0) and abs(local[2]) < half[2] and np.sum((local[:2] / half[:2]) ** 2) < 1.0)
        case CollisionShapeType.HULL:
            normals, offsets = _facets(shape.points)
            return bool(np.all(normals @ local < offsets - margin))


@lru_cache(maxsize=64)
def _facets(corners: tuple[Vector, ...]) -> tuple[Array, Array]:
    """Returns the facet planes of a hull with few points, by testing every three of them."""
    points = np.array(corners)
    chosen = points[np.array(list(combinations(range(len(points)), 3)))]
    normals = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    wide = lengths > 1e-9 * np.ptp(points) ** 2
    normals, chosen = normals[wide] / lengths[wide, None], chosen[wide]
    offsets = np.einsum("ij,ij->i", normals, chosen[:, 0])
    slack = 1e-9 * np.ptp(points)
    distance = points @ normals.T - offsets
    below, above = np.all(distance < slack, axis=0), np.all(distance > -slack, axis=0)
    return np.concatenate([normals[below], -normals[above]]), np.concatenate([offsets[below], -offsets[above]])


def _corners(shape: CollisionShape) -> Array:
    if shape.type is CollisionShapeType.HULL:
        return np.array(shape.points)
    return np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size


def _in_body(shape: CollisionShape, local: Array) -> Array:
    return np.asarray(local @ _turn(shape.pose).T + shape.pose.position)


def _turn(pose: Pose) -> Array:
    return np.asarray(rotation_matrix(np.array(pose.quaternion)))
