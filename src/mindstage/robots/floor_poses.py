"""Poses of a base on the floor: x, y [m] and yaw [rad], and what they are in space."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from mindstage.scene.transforms import Array, pose_inverse, pose_multiply

__all__ = [
    "BaseFrame",
    "BasePose",
    "base_pose_of",
    "planar_inverse",
    "planar_multiply",
    "planar_pose",
    "wrapped",
    "yaw_of",
]

BasePose = tuple[float, float, float]
"""x, y [m] and yaw [rad], in the world frame unless stated otherwise."""


class BaseFrame:
    """Where the root link of a robot is for a pose of its base, and the reverse: the two do not move relatively."""

    def __init__(self, base: BasePose, root: Array) -> None:
        """Takes both poses at one time.

        Args:
            base: the pose of the base.
            root: that of the root link in the world frame, seven numbers.
        """
        self._root_in_base = pose_multiply(pose_inverse(planar_pose(base)), root)

    @cached_property
    def _base_in_root(self) -> Array:
        return pose_inverse(self._root_in_base)

    def root_at(self, base: BasePose) -> Array:
        """The pose of the root link with the base somewhere, seven numbers."""
        return pose_multiply(planar_pose(base), self._root_in_base)

    def base_at(self, root: Array) -> BasePose:
        """The pose of the base with the root link somewhere, seven numbers."""
        return base_pose_of(pose_multiply(root, self._base_in_root))


def wrapped(angle: float) -> float:
    """An angle within [-pi, pi) [rad]."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def yaw_of(quaternion: Array) -> float:
    """The rotation about the vertical axis of a unit quaternion w x y z [rad]."""
    w, x, y, z = quaternion.tolist()
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def base_pose_of(pose: Array) -> BasePose:
    """The part of a pose, seven numbers, that is on the floor."""
    return float(pose[0]), float(pose[1]), yaw_of(pose[3:])


def planar_pose(base: BasePose) -> Array:
    """A pose on the floor, seven numbers."""
    x, y, yaw = base
    return np.array([x, y, 0.0, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])


def planar_multiply(first: BasePose, second: BasePose) -> BasePose:
    """The product of two planar poses."""
    c, s = math.cos(first[2]), math.sin(first[2])
    x, y = first[0] + c * second[0] - s * second[1], first[1] + s * second[0] + c * second[1]
    return x, y, wrapped(first[2] + second[2])


def planar_inverse(pose: BasePose) -> BasePose:
    """The inverse of a planar pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return -c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]
