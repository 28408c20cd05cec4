"""Touchables: the convex parts of a shape while it is drawn, and how hollow things are cut into them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.shapes.sides import Turn
from mindstage.world import IDENTITY, Pose, Vector
from mindstage.world.forms import Solid, SolidKind
from mindstage.world.geometry import Array, multiply

__all__ = ["Touchable", "ring", "strips"]

_AROUND = 16
"""Corners of a cylinder whose ends are no circles."""
_UPRIGHT = 0.75
"""A wall whose foot is at least so wide as its rim, as a share, is taken as upright."""
_CYLINDER_TURNS: tuple[tuple[float, float, float, float], ...] = (
    (0.5**0.5, 0.0, 0.5**0.5, 0.0),
    (0.5**0.5, -(0.5**0.5), 0.0, 0.0),
    (1.0, 0.0, 0.0, 0.0),
)
"""Which turn lays a cylinder's axis along x, y, z."""


class Touchable(NamedTuple):
    """A convex part, in the drawing's frame."""

    kind: SolidKind
    points: Array
    """Of a hull, its points; else the two corners of the box that it fills."""
    axis: int = 2
    """Of a cylinder."""
    turn_rad: float = 0.0
    """By how much it is turned about z, at `hub`, from where its points are."""
    hub: tuple[float, float] = (0.0, 0.0)

    def stretched(self, scale: Array, shift: Array) -> Touchable:
        """The same part larger or smaller along each axis, then moved."""
        if self.turn_rad and not np.isclose(scale[0], scale[1], rtol=1e-9):
            return self._unturned().stretched(scale, shift)
        x, y = (np.array(self.hub) * scale[:2] + shift[:2]).tolist()
        return self._replace(points=self.points * scale + shift, hub=(x, y))

    def within(self, low: Array, high: Array) -> Touchable:
        """The same part, kept from standing out of a box by the last digit."""
        return self if self.turn_rad else self._replace(points=np.clip(self.points, low, high))

    def solid(self, turn: Turn) -> Solid | None:
        """The part in the body's frame; None if it has no volume."""
        if self.kind is SolidKind.CYLINDER and not self._is_circular():
            return self._as_hull().solid(turn)
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        if (high - low).min() <= 1e-9:
            return None
        if self.turn_rad:
            return self._turned(turn, low, high)
        points = turn.points(self.points)
        low, high = points.min(axis=0), points.max(axis=0)
        centre = (low + high) / 2
        if self.kind is SolidKind.HULL:
            local = tuple(_vector(point) for point in points - centre)
            return Solid(kind=self.kind, size=_vector(high - low), pose=Pose(_vector(centre)), points=local)
        if self.kind is not SolidKind.CYLINDER:
            return Solid(kind=self.kind, size=_vector(high - low), pose=Pose(_vector(centre)))
        axis = int(np.flatnonzero(turn.matrix[:, self.axis])[0])
        extents = high - low
        across = float(np.delete(extents, axis).min())
        quaternion = _CYLINDER_TURNS[axis] if axis != 2 else IDENTITY.quaternion
        size = (across, across, float(extents[axis]))
        return Solid(kind=self.kind, size=size, pose=Pose(_vector(centre), quaternion))

    def _turned(self, turn: Turn, low: Array, high: Array) -> Solid:
        """One of several alike that stand round an axis: its own frame turns, its points stay."""
        centre = (low + high) / 2
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = centre[:2] - self.hub
        spot = (self.hub[0] + cosine * x - sine * y, self.hub[1] + sine * x + cosine * y, centre[2])
        about_z = [np.cos(self.turn_rad / 2), 0.0, 0.0, np.sin(self.turn_rad / 2)]
        w, i, j, k = multiply(turn.quaternion, about_z).tolist()
        pose = Pose(turn.vector(spot), (w, i, j, k))
        local = self.points - centre if self.kind is SolidKind.HULL else ()
        return Solid(kind=self.kind, size=_vector(high - low), pose=pose, points=tuple(map(_vector, local)))

    def _unturned(self) -> Touchable:
        """The same part as a hull whose points are where it is."""
        points = self.points
        if self.kind is SolidKind.BOX:
            points = np.array(list(product(*points.T)))
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = points[:, 0] - self.hub[0], points[:, 1] - self.hub[1]
        turned = [self.hub[0] + cosine * x - sine * y, self.hub[1] + sine * x + cosine * y, points[:, 2]]
        return Touchable(SolidKind.HULL, np.stack(turned, axis=1))

    def _is_circular(self) -> bool:
        extents = np.delete(self.points[1] - self.points[0], self.axis)
        return bool(abs(extents[0] - extents[1]) <= 1e-6 * extents.max())

    def _as_hull(self) -> Touchable:
        low, high = self.points
        angle = np.arange(_AROUND) * (2 * np.pi / _AROUND)
        across = [axis for axis in range(3) if axis != self.axis]
        points = np.empty((2, _AROUND, 3))
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).round(15)
        points[:, :, across] = ((low + high) / 2)[across] + circle * ((high - low) / 2)[across]
        points[0, :, self.axis], points[1, :, self.axis] = low[self.axis], high[self.axis]
        return Touchable(SolidKind.HULL, points.reshape(-1, 3))


def ring(
    low: Array, high: Array, outer: tuple[float, float], inner: tuple[float, float], pieces: int
) -> list[Touchable]:
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
    if min(outer) >= _UPRIGHT * max(outer):
        reach = radius * (outer[0] + outer[1]) / 2
        chord, face = 2 * reach * np.sin(step / 2), reach * np.cos(step / 2)
        wall = max(face - radius * (inner[0] + inner[1]) / 2 * np.cos(step / 2), 0.05 * reach)
        corners = np.array(
            [[hub[0] + face - wall, hub[1] - chord / 2, low[2]], [hub[0] + face, hub[1] + chord / 2, high[2]]]
        )
        one = Touchable(SolidKind.BOX, corners, hub=hub)
    else:
        angle = np.array([-step / 2, 0.0, step / 2])
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
        rows = []
        for level, outer_share, inner_share in zip((low[2], high[2]), outer, inner, strict=True):
            row = np.concatenate([circle * outer_share, circle[[0, 2]] * inner_share]) + middle
            rows.append(np.column_stack([row, np.full(len(row), level)]))
        one = Touchable(SolidKind.HULL, np.concatenate(rows), hub=hub)
    parts = [one._replace(turn_rad=number * step) for number in range(pieces)]
    if np.isclose(half[0], half[1], rtol=1e-9):
        return parts
    scale = np.array([*(half / radius), 1.0])
    return [part._unturned().stretched(scale, np.array([*(middle * (1 - scale[:2])), 0.0])) for part in parts]


def strips(cuts: tuple[Array, Array], kept: NDArray[np.bool_]) -> Iterator[tuple[Array, Array]]:
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
