"""Sides: which way a shape looks, and how it is turned into a body's own axes.

Every shape is drawn once, with x to its front, y to its left and z up. A body may have its front at any of its six
sides and up at any that is not opposite; between the two lies a turn by right angles, which loses no digit.
"""

from __future__ import annotations

from enum import StrEnum
from functools import cache

import numpy as np

from mindstage.errors import InvalidShapeError
from mindstage.world import Quaternion, Vector
from mindstage.world.geometry import Array, quaternion_from_matrix
from mindstage.world.values import FrozenStruct

__all__ = ["AxisPermutation", "BodySide", "Cutout", "turn_between"]


class BodySide(StrEnum):
    """One of the six sides of a body, by its own axes."""

    FRONT = "+x"
    BACK = "-x"
    LEFT = "+y"
    RIGHT = "-y"
    TOP = "+z"
    BOTTOM = "-z"

    @classmethod
    def from_axis(cls, axis: int, sign: int) -> BodySide:
        """The side at one end of an axis (0, 1, 2 for x, y, z)."""
        return cls(f"{'+' if sign > 0 else '-'}{'xyz'[axis]}")

    @property
    def axis(self) -> int:
        """0, 1, 2 for x, y, z."""
        return "xyz".index(self.value[1])

    @property
    def sign(self) -> int:
        """1 where the axis points, else -1."""
        return 1 if self.value[0] == "+" else -1

    @property
    def opposite(self) -> BodySide:
        """The side across."""
        return BodySide.from_axis(self.axis, -self.sign)

    @property
    def vector(self) -> Vector:
        """Where it looks, of length 1."""
        x, y, z = (float(self.sign) if axis == self.axis else 0.0 for axis in range(3))
        return (x, y, z)


class Cutout(FrozenStruct, frozen=True, kw_only=True):
    """A box that must stay free: a door's opening in a wall, a sink's in a worktop."""

    low: Vector
    """The corner with the smallest coordinates, in the body's frame."""
    high: Vector


class AxisPermutation:
    """From the frame in which shapes are drawn into a body's own."""

    def __init__(self, front: BodySide, up: BodySide) -> None:
        if front.axis == up.axis:
            raise InvalidShapeError("any", reason=f"its front {front.value} and its top {up.value} lie on one axis")
        left = np.cross(up.vector, front.vector)
        self.matrix: Array = np.stack([front.vector, left, up.vector], axis=1)
        w, x, y, z = quaternion_from_matrix(self.matrix).tolist()
        self.quaternion: Quaternion = (w, x, y, z)
        self._axes = [int(np.flatnonzero(row)[0]) for row in self.matrix]
        self.is_identity = bool(np.array_equal(self.matrix, np.eye(3)))
        """Whether both frames are the same."""

    def template_size(self, size: Vector) -> Vector:
        """A body's extents along the drawn axes."""
        x, y, z = (float(value) for value in np.abs(self.matrix.T) @ np.array(size))
        return (x, y, z)

    def body_size(self, template_size: Vector) -> Vector:
        """Drawn extents along the body's axes."""
        x, y, z = (template_size[axis] for axis in self._axes)
        return (x, y, z)

    def to_body(self, template_points: Array) -> Array:
        """Points or directions, n x 3, in the body's frame."""
        return template_points if self.is_identity else template_points @ self.matrix.T

    def vector_to_body(self, template_vector: Vector) -> Vector:
        """One point or direction in the body's frame."""
        x, y, z = (self.matrix @ np.array(template_vector)).tolist()
        return (x, y, z)

    def template_side(self, side: BodySide) -> BodySide:
        """A side of the body as the drawing calls it."""
        drawn = self.matrix.T @ np.array(side.vector)
        axis = int(np.flatnonzero(drawn)[0])
        return BodySide.from_axis(axis, int(drawn[axis]))

    def template_cutout(self, cutout: Cutout) -> tuple[Array, Array]:
        """The two corners of a gap in the drawing."""
        corners = np.array([cutout.low, cutout.high]) @ self.matrix
        return corners.min(axis=0), corners.max(axis=0)


@cache
def turn_between(front: BodySide, up: BodySide) -> AxisPermutation:
    """The turn of these two sides; there are only 24, so each is computed once. Its arrays must not be written to."""
    return AxisPermutation(front, up)
