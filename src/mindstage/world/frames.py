"""Frames: how other programs lay out space, and the way there and back.

A World is in ROS's frame (REP 103): meters, right-handed, x forward, y left, z up. Unreal counts centimetres in a
left-handed frame, y to the right; Godot counts meters with y up and -z forward. All of them name the same axes in
another order and direction, so one `FrameConversion`, a signed permutation with a scale, says all of it:

    unreal_pose = UNREAL_FROM_ROS.pose(ros_pose)
    ros_poses = ROS_FROM_GODOT.poses(godot_poses)       # n x 7

The axes of each body change with those of the world: what was its forward is forward there too.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mindstage.world.geometry import pose_from_array
from mindstage.world.values import Pose

__all__ = [
    "GODOT_FROM_ROS",
    "ROS_FROM_GODOT",
    "ROS_FROM_UNREAL",
    "UNREAL_FROM_ROS",
    "FrameConversion",
    "wxyz_from_xyzw",
    "xyzw_from_wxyz",
]

Array = NDArray[np.float64]


class FrameConversion(msgspec.Struct, frozen=True, kw_only=True):
    """From one frame to another, for one value or for many (the last axis of an array is the value)."""

    axes: tuple[int, int, int] = (0, 1, 2)
    """For each axis of the target, the axis of the source that it takes its number from."""
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """For each axis of the target, 1 if it points as that axis of the source does, -1 if against it."""
    length_factor: float = 1.0
    """What a length is multiplied by."""
    length_divisor: float = 1.0
    """What a length is divided by after that: 0.01 is no exact number, 100 is."""

    @property
    def inverse(self) -> FrameConversion:
        """The way back."""
        back = (self.axes.index(0), self.axes.index(1), self.axes.index(2))
        x, y, z = back
        signs = (self.signs[x], self.signs[y], self.signs[z])
        return FrameConversion(
            axes=back, signs=signs, length_factor=self.length_divisor, length_divisor=self.length_factor
        )

    @property
    def flips_handedness(self) -> bool:
        """Whether one frame is right-handed and the other left-handed."""
        return bool(np.linalg.det(np.eye(3)[list(self.axes)] * np.array(self.signs)) < 0.0)

    def lengths(self, lengths: ArrayLike) -> Array:
        """Lengths without a direction, such as the limit of a slide."""
        return np.asarray(np.asarray(lengths, dtype=np.float64) * self.length_factor / self.length_divisor)

    def directions(self, directions: ArrayLike) -> Array:
        """Vectors ... x 3 whose length has nothing to do with meters: axes, normals."""
        return np.asarray(np.asarray(directions, dtype=np.float64)[..., self.axes] * np.array(self.signs))

    def points(self, points: ArrayLike) -> Array:
        """Positions and ways ... x 3."""
        return self.lengths(self.directions(points))

    def sizes(self, sizes: ArrayLike) -> Array:
        """Extents ... x 3 along the body's own axes: reordered, never negative."""
        return self.lengths(np.asarray(sizes, dtype=np.float64)[..., self.axes])

    def quaternions(self, quaternions: ArrayLike) -> Array:
        """Rotations ... x 4, w x y z.

        A rotation's axis turns with the frame. In a mirrored frame the same turn runs the other way about it, which
        the minus says.
        """
        q = np.asarray(quaternions, dtype=np.float64)
        axis = self.directions(q[..., 1:])
        return np.concatenate([q[..., :1], -axis if self.flips_handedness else axis], axis=-1)

    def poses(self, poses: ArrayLike) -> Array:
        """Poses ... x 7: x y z, then w x y z."""
        p = np.asarray(poses, dtype=np.float64)
        return np.concatenate([self.points(p[..., :3]), self.quaternions(p[..., 3:])], axis=-1)

    def pose(self, pose: Pose) -> Pose:
        """One pose."""
        return pose_from_array(self.poses((*pose.position, *pose.quaternion)))


UNREAL_FROM_ROS = FrameConversion(signs=(1.0, -1.0, 1.0), length_factor=100.0)
"""(x, y, z) m becomes (100x, -100y, 100z) cm and the quaternion (w, x, y, z) becomes (w, -x, y, -z)."""
ROS_FROM_UNREAL = UNREAL_FROM_ROS.inverse

GODOT_FROM_ROS = FrameConversion(axes=(1, 2, 0), signs=(-1.0, 1.0, -1.0))
"""(x, y, z) becomes (-y, z, -x); a body's depth, which ROS has along x, lies along Godot's z."""
ROS_FROM_GODOT = GODOT_FROM_ROS.inverse


def wxyz_from_xyzw(quaternions: ArrayLike) -> NDArray[Any]:
    """The scalar from the end, where ROS, Unreal and Godot have it, to the front, where a World has it."""
    return np.roll(np.asarray(quaternions), 1, axis=-1)


def xyzw_from_wxyz(quaternions: ArrayLike) -> NDArray[Any]:
    """The scalar from the front to the end."""
    return np.roll(np.asarray(quaternions), -1, axis=-1)
