"""Rotations and poses in bulk: every function takes one or many, as arrays whose last axis is the value.

Quaternions are w x y z (Hamilton). None of these needs unit quaternions unless it says so; a pose's quaternion may
be off by the digits that a map writes, so `normalize` comes first wherever that matters.

Frames: how other programs lay out space, and the way there and back.

A World is in ROS's frame (REP 103): meters, right-handed, x forward, y left, z up. Unreal counts centimetres in a
left-handed frame, y to the right; Godot counts meters with y up and -z forward. All of them name the same axes in
another order and direction, so one `FrameConversion`, a signed permutation with a scale, says all of it:

    unreal_pose = UNREAL_FROM_ROS.pose(ros_pose)
    ros_poses = ROS_FROM_GODOT.poses(godot_poses)       # n x 7

The axes of each body change with those of the world: what was its forward is forward there too.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mindstage.scene.model import Pose, Vector

__all__ = [
    "GODOT_FROM_ROS",
    "ROS_FROM_GODOT",
    "ROS_FROM_UNREAL",
    "UNREAL_FROM_ROS",
    "FrameConversion",
    "cross",
    "mesh_scale",
    "normalize",
    "normalized_pose_array",
    "pose_array",
    "pose_from_array",
    "pose_inverse",
    "pose_multiply",
    "quat_angle",
    "quat_conjugate",
    "quat_multiply",
    "quat_rotate",
    "quaternion_from_matrix",
    "rotation_matrix",
    "wxyz_from_xyzw",
    "xyzw_from_wxyz",
]


Array = NDArray[np.float64]


_SIZE_TOLERANCE = 0.01
"""Sizes that differ by less than this part are the same: maps round."""

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: Array, b: Array) -> Array:
    """The cross product; NumPy's own spends most of its time on finding out that the axes are the last ones."""
    return np.asarray(a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT])


def pose_array(poses: Iterable[Pose]) -> Array:
    """Poses as an array n x 7: x y z, then w x y z, digits as given."""
    return np.array([(*pose.position, *pose.quaternion) for pose in poses], dtype=np.float64).reshape(-1, 7)


def normalized_pose_array(pose: Pose) -> Array:
    """One pose as seven numbers whose quaternion has norm 1."""
    row = pose_array([pose])[0]
    return np.concatenate([row[:3], normalize(row[3:])])


def pose_from_array(row: ArrayLike) -> Pose:
    """One row of seven numbers as a `Pose`."""
    x, y, z, *quaternion = np.asarray(row, dtype=np.float64).tolist()
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k))


def normalize(quaternion: ArrayLike) -> Array:
    """The same rotations with norm 1; a quaternion of zeros gives NaN."""
    q = np.asarray(quaternion, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def quat_multiply(left: ArrayLike, right: ArrayLike) -> Array:
    """The Hamilton product: first `right` turns, then `left`."""
    a, b = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def quat_conjugate(quaternion: ArrayLike) -> Array:
    """The inverse of unit quaternions."""
    return np.asarray(np.asarray(quaternion, dtype=np.float64) * np.array([1.0, -1.0, -1.0, -1.0]))


def quat_rotate(quaternion: ArrayLike, vector: ArrayLike) -> Array:
    """Vectors turned by unit quaternions."""
    q, v = np.asarray(quaternion, dtype=np.float64), np.asarray(vector, dtype=np.float64)
    twice = 2.0 * cross(q[..., 1:], v)
    return np.asarray(v + q[..., :1] * twice + cross(q[..., 1:], twice))


def rotation_matrix(quaternion: ArrayLike) -> Array:
    """Matrices ... x 3 x 3 of unit quaternions; their columns are the turned axes."""
    q = np.asarray(quaternion, dtype=np.float64)[..., None, :]
    return np.swapaxes(quat_rotate(q, np.eye(3)), -1, -2)


def quaternion_from_matrix(rotation: Array) -> Array:
    """The unit quaternion w x y z, w not negative, of one 3 x 3 rotation matrix.

    It is computed from the largest of its four parts, so that nothing is divided by a small number.
    """
    diagonal, skew, symmetric = rotation.diagonal(), rotation - rotation.T, rotation + rotation.T
    squares = 1.0 + np.array([diagonal.sum(), *(2.0 * diagonal - diagonal.sum())])  # four times each one's
    products = np.array(
        [
            [squares[0], skew[2, 1], skew[0, 2], skew[1, 0]],
            [skew[2, 1], squares[1], symmetric[0, 1], symmetric[0, 2]],
            [skew[0, 2], symmetric[0, 1], squares[2], symmetric[1, 2]],
            [skew[1, 0], symmetric[0, 2], symmetric[1, 2], squares[3]],
        ]
    )
    quaternion = products[int(np.argmax(squares))]
    quaternion = quaternion / np.linalg.norm(quaternion)
    return np.asarray(quaternion if quaternion[0] >= 0.0 else -quaternion)


def quat_angle(a: ArrayLike, b: ArrayLike) -> Array:
    """The smallest angle between rotations [rad]: q and -q are one, and lengths do not count.

    The sine and cosine halves go into one arctangent, which stays exact for tiny angles where an arccosine loses
    half its digits.
    """
    relative = quat_multiply(quat_conjugate(a), b)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(relative[..., 1:], axis=-1), np.abs(relative[..., 0])))


def pose_multiply(outer: ArrayLike, inner: ArrayLike) -> Array:
    """The inner pose seen from where the outer one is told; poses are ... x 7, their quaternions unit ones.

    So written, the frames cancel: `world_from_cup = pose_multiply(world_from_table, table_from_cup)`.
    """
    a, b = np.asarray(outer, dtype=np.float64), np.asarray(inner, dtype=np.float64)
    position = a[..., :3] + quat_rotate(a[..., 3:], b[..., :3])
    return np.concatenate([position, quat_multiply(a[..., 3:], b[..., 3:])], axis=-1)


def mesh_scale(extents: Array, size: Vector | None) -> Array:
    """What makes a mesh of such extents as large as a body, along x, y, z.

    1 where the two are alike but for a hundredth, because maps round, or where one of them is not known.
    """
    if size is None or not extents.all():
        return np.ones(3)
    scale = np.array(size) / extents
    return scale if scale.min() > 0.0 and np.abs(scale - 1.0).max() >= _SIZE_TOLERANCE else np.ones(3)


def pose_inverse(pose: ArrayLike) -> Array:
    """The same told from the other end; poses are ... x 7, their quaternions unit ones.

    So `table_from_world = pose_inverse(world_from_table)`.
    """
    p = np.asarray(pose, dtype=np.float64)
    back = quat_conjugate(p[..., 3:])
    return np.concatenate([-quat_rotate(back, p[..., :3]), back], axis=-1)


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
