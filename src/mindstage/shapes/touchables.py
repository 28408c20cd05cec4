"""Touchables: the convex parts of a shape while it is drawn, and how hollow things are cut into them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.shapes.sides import AxisPermutation
from mindstage.world import IDENTITY, Pose, Vector
from mindstage.world.forms import CollisionShape, CollisionShapeType
from mindstage.world.geometry import Array, quat_multiply

__all__ = ["CollisionPart", "covering_rectangles", "ring_parts"]

_SEGMENTS = 16
"""Corners of a cylinder whose ends are no circles."""
_MIN_UPRIGHT_RATIO = 0.75
"""A wall whose foot is at least so wide as its rim, as a share, is taken as upright."""
_CYLINDER_TURNS: tuple[tuple[float, float, float, float], ...] = (
    (0.5**0.5, 0.0, 0.5**0.5, 0.0),
    (0.5**0.5, -(0.5**0.5), 0.0, 0.0),
    (1.0, 0.0, 0.0, 0.0),
)
"""Which turn lays a cylinder's axis along x, y, z."""


class CollisionPart(NamedTuple):
    """A convex part, in the drawing's frame."""

    type: CollisionShapeType
    points: Array
    """Of a hull, its points; else the two corners of the box that it fills."""
    axis: int = 2
    """Of a cylinder."""
    turn_rad: float = 0.0
    """By how much it is turned about z, at `hub`, from where its points are."""
    rotation_center: tuple[float, float] = (0.0, 0.0)

    def scaled(self, scale: Array, shift: Array) -> CollisionPart:
        """The same part larger or smaller along each axis, then moved."""
        if self.turn_rad and not np.isclose(scale[0], scale[1], rtol=1e-9):
            return self._as_fixed_hull().scaled(scale, shift)
        x, y = (np.array(self.rotation_center) * scale[:2] + shift[:2]).tolist()
        return self._replace(points=self.points * scale + shift, rotation_center=(x, y))

    def clipped(self, low: Array, high: Array) -> CollisionPart:
        """The same part, kept from standing out of a box by the last digit."""
        return self if self.turn_rad else self._replace(points=np.clip(self.points, low, high))

    def to_collision_shape(self, turn: AxisPermutation) -> CollisionShape | None:
        """The part in the body's frame; None if it has no volume."""
        if self.type is CollisionShapeType.CYLINDER and not self._is_circular():
            return self._as_hull().to_collision_shape(turn)
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        if (high - low).min() <= 1e-9:
            return None
        if self.turn_rad:
            return self._rotated_shape(turn, low, high)
        points = turn.to_body(self.points)
        low, high = points.min(axis=0), points.max(axis=0)
        center = (low + high) / 2
        if self.type is CollisionShapeType.HULL:
            local = tuple(_vector(point) for point in points - center)
            return CollisionShape(type=self.type, size=_vector(high - low), pose=Pose(_vector(center)), points=local)
        if self.type is not CollisionShapeType.CYLINDER:
            return CollisionShape(type=self.type, size=_vector(high - low), pose=Pose(_vector(center)))
        axis = int(np.flatnonzero(turn.matrix[:, self.axis])[0])
        extents = high - low
        across = float(np.delete(extents, axis).min())
        quaternion = _CYLINDER_TURNS[axis] if axis != 2 else IDENTITY.quaternion
        size = (across, across, float(extents[axis]))
        return CollisionShape(type=self.type, size=size, pose=Pose(_vector(center), quaternion))

    def _rotated_shape(self, turn: AxisPermutation, low: Array, high: Array) -> CollisionShape:
        """One of several alike that stand round an axis: its own frame turns, its points stay."""
        center = (low + high) / 2
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = center[:2] - self.rotation_center
        spot = (
            self.rotation_center[0] + cosine * x - sine * y,
            self.rotation_center[1] + sine * x + cosine * y,
            center[2],
        )
        about_z = [np.cos(self.turn_rad / 2), 0.0, 0.0, np.sin(self.turn_rad / 2)]
        w, i, j, k = quat_multiply(turn.quaternion, about_z).tolist()
        pose = Pose(turn.vector_to_body(spot), (w, i, j, k))
        local = self.points - center if self.type is CollisionShapeType.HULL else ()
        return CollisionShape(type=self.type, size=_vector(high - low), pose=pose, points=tuple(map(_vector, local)))

    def _as_fixed_hull(self) -> CollisionPart:
        """The same part as a hull whose points are where it is."""
        points = self.points
        if self.type is CollisionShapeType.BOX:
            points = np.array(list(product(*points.T)))
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = points[:, 0] - self.rotation_center[0], points[:, 1] - self.rotation_center[1]
        turned = [
            self.rotation_center[0] + cosine * x - sine * y,
            self.rotation_center[1] + sine * x + cosine * y,
            points[:, 2],
        ]
        return CollisionPart(CollisionShapeType.HULL, np.stack(turned, axis=1))

    def _is_circular(self) -> bool:
        extents = np.delete(self.points[1] - self.points[0], self.axis)
        return bool(abs(extents[0] - extents[1]) <= 1e-6 * extents.max())

    def _as_hull(self) -> CollisionPart:
        low, high = self.points
        angle = np.arange(_SEGMENTS) * (2 * np.pi / _SEGMENTS)
        across = [axis for axis in range(3) if axis != self.axis]
        points = np.empty((2, _SEGMENTS, 3))
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).round(15)
        points[:, :, across] = ((low + high) / 2)[across] + circle * ((high - low) / 2)[across]
        points[0, :, self.axis], points[1, :, self.axis] = low[self.axis], high[self.axis]
        return CollisionPart(CollisionShapeType.HULL, points.reshape(-1, 3))


def ring_parts(
    low: Array, high: Array, outer: tuple[float, float], inner: tuple[float, float], pieces: int
) -> list[CollisionPart]:
    """The wall of an upright round vessel as convex pieces.

    Pieces of a circle are one and the same part, turned; they are boxes where the wall is nearly upright, which engines
    like best, else hulls.

    Args:
        low: of the box that it stands in [m].
        high: its other corner.
        outer: radii outside at the bottom and at the top, as shares of the box.
        inner: those inside.
        pieces: how many.
    """
    half, middle = (high - low)[:2] / 2, (low + high)[:2] / 2
    radius, step = float(half.min()), 2 * np.pi / pieces
    hub = (float(middle[0]), float(middle[1]))
    if min(outer) >= _MIN_UPRIGHT_RATIO * max(outer):
        reach = radius * (outer[0] + outer[1]) / 2
        chord, face = 2 * reach * np.sin(step / 2), reach * np.cos(step / 2)
        wall = max(face - radius * (inner[0] + inner[1]) / 2 * np.cos(step / 2), 0.05 * reach)
        corners = np.array(
            [[hub[0] + face - wall, hub[1] - chord / 2, low[2]], [hub[0] + face, hub[1] + chord / 2, high[2]]]
        )
        one = CollisionPart(CollisionShapeType.BOX, corners, rotation_center=hub)
    else:
        angle = np.array([-step / 2, 0.0, step / 2])
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
        rows = []
        for level, outer_share, inner_share in zip((low[2], high[2]), outer, inner, strict=True):
            row = np.concatenate([circle * outer_share, circle[[0, 2]] * inner_share]) + middle
            rows.append(np.column_stack([row, np.full(len(row), level)]))
        one = CollisionPart(CollisionShapeType.HULL, np.concatenate(rows), rotation_center=hub)
    parts = [one._replace(turn_rad=number * step) for number in range(pieces)]
    if np.isclose(half[0], half[1], rtol=1e-9):
        return parts
    scale = np.array([*(half / radius), 1.0])
    return [part._as_fixed_hull().scaled(scale, np.array([*(middle * (1 - scale[:2])), 0.0])) for part in parts]


def covering_rectangles(cuts: tuple[Array, Array], kept: NDArray[np.bool_]) -> Iterator[tuple[Array, Array]]:
    """The kept cells of a plate as few rectangles, each by its two corners."""
    left = kept.copy()
    while left.any():
        row, column = (int(index) for index in np.argwhere(left)[0])
        end = column + int(np.argmin(np.append(left[row, column:], False)))
        last = row + 1
        while last < len(left) and left[last, column:end].all():
            last += 1
        left[row:last, column:end] = False
        yield np.array([cuts[0][row], cuts[1][column]]), np.array([cuts[0][last], cuts[1][end]])


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return (x, y, z)
