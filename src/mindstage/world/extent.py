"""Extent: how far a world reaches, and what stands tallest in it.

It is the quickest way to see that a map was misread: a kitchen is not 400 m wide, and a fridge is not 2 cm high.
"""

from __future__ import annotations

import msgspec
import numpy as np

from mindstage.world.boxes import OrientedBoxes
from mindstage.world.facts import Iri
from mindstage.world.geometry import normalize, pose_array
from mindstage.world.values import BodyId, Vector, World

__all__ = ["Bounds", "world_bounds"]


class Bounds(msgspec.Struct, frozen=True, kw_only=True):
    """The upright box around all bodies."""

    low: Vector
    """The corner where x, y and z are least [m]."""
    high: Vector
    """The corner where they are greatest [m]."""
    tallest: BodyId
    tallest_class: Iri
    height_m: float
    """Of the tallest body, from its lowest to its highest point [m]."""

    @property
    def size(self) -> Vector:
        """Along x, y and z [m]."""
        (x, y, z), (left, back, bottom) = self.high, self.low
        return x - left, y - back, z - bottom


def world_bounds(world: World) -> Bounds | None:
    """The extent of a world; None where it has no bodies. What has no size is a point."""
    if not world.bodies:
        return None
    poses = pose_array(body.pose for body in world.bodies)
    poses[:, 3:] = normalize(poses[:, 3:])
    sizes = np.array([body.size or (0.0, 0.0, 0.0) for body in world.bodies])
    low, high = OrientedBoxes.from_poses(poses, sizes).bounds()
    heights = high[:, 2] - low[:, 2]
    tallest = world.bodies[int(np.argmax(heights))]
    left, back, bottom = low.min(axis=0).tolist()
    right, front, top = high.max(axis=0).tolist()
    return Bounds(
        low=(left, back, bottom),
        high=(right, front, top),
        tallest=tallest.id,
        tallest_class=tallest.cls,
        height_m=float(heights.max()),
    )
