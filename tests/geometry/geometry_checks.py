"""Judging forms: what is true of every form, worked out anew from its numbers alone."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations, product

import numpy as np

from mindstage.scene import BodyGeometry, CollisionShape, CollisionShapeType, Pose, Vector, VisualMesh
from mindstage.scene.transforms import Array, rotation_matrix

__all__ = ["is_closed", "is_convex", "is_inside", "shape_bounds", "visual_bounds", "volume"]


def visual_bounds(geometry: BodyGeometry) -> tuple[Array, Array]:
    """The corners of the box round all skins."""
    points = np.concatenate([skin.points for skin in geometry.visuals])
    return points.min(axis=0), points.max(axis=0)


def is_closed(visual: VisualMesh) -> bool:
    """Whether each edge runs just once each way."""
    edges = visual.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    there = edges[:, 0] * len(visual.points) + edges[:, 1]
    back = edges[:, 1] * len(visual.points) + edges[:, 0]
    return len(np.unique(there)) == len(there) and np.array_equal(np.sort(there), np.sort(back))


def volume(visual: VisualMesh) -> float:
    """What a closed skin encloses [m³]; negative if it looks inwards."""
    a, b, c = (visual.points[visual.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def shape_bounds(shape: CollisionShape) -> tuple[Array, Array]:
    """The corners of the box round a solid, in the body's frame."""
    corners = _in_body(shape, _corners(shape))
    return corners.min(axis=0), corners.max(axis=0)


def is_convex(shape: CollisionShape) -> bool:
    """Whether each point of a hull is a corner of it; what is no hull is convex by its kind."""
    if shape.type is not CollisionShapeType.HULL:
        return not shape.points and min(shape.size) > 0.0
    points = np.array(shape.points)
    normals, offsets = _facets(shape.points)
    distance = points @ normals.T - offsets
    return bool(np.all(np.max(distance, axis=1) > -1e-7 * np.ptp(points)))


def is_inside(shape: CollisionShape, point: Array, *, margin: float = 0.0) -> bool:
    """Whether a point of the body's frame is in a solid, at least by a margin [m]."""
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
    """The planes of a hull with few points: every three of them are tried."""
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


def _corners(solid: CollisionShape) -> Array:
    if solid.type is CollisionShapeType.HULL:
        return np.array(solid.points)
    return np.array(list(product((-0.5, 0.5), repeat=3))) * solid.size


def _in_body(solid: CollisionShape, local: Array) -> Array:
    return np.asarray(local @ _turn(solid.pose).T + solid.pose.position)


def _turn(pose: Pose) -> Array:
    return np.asarray(rotation_matrix(np.array(pose.quaternion)))
