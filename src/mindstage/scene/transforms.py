"""Quaternions, poses and frame conversions, vectorized: the last axis of an array is one value.

Quaternions are w x y z (Hamilton). Functions accept quaternions of any norm unless they state otherwise; the quaternion
of a pose may be off by the rounding of its map, so `normalize` comes first where that matters.

A `FrameConversion` converts between the frames of programs. A World uses the ROS frame (REP 103): meters,
right-handed, x forward, y left, z up. Unreal uses centimeters in a left-handed frame with y to the right; Godot uses
meters with y up and -z forward. Each conversion is a signed permutation of the axes with a scale:

    unreal_pose = UNREAL_FROM_ROS.pose(ros_pose)
    ros_poses = ROS_FROM_GODOT.poses(godot_poses)       # n x 7

The axes of each body are converted as those of the world: the forward axis of a body stays its forward axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mindstage.scene.world_model import Pose, PoseLike, Vector, as_pose

__all__ = [
    "GODOT_FROM_ROS",
    "ROS_FROM_GODOT",
    "ROS_FROM_UNREAL",
    "UNREAL_FROM_ROS",
    "FrameConversion",
    "axis_displacement",
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
"""Relative tolerance within which sizes are equal: maps round."""

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: Array, b: Array) -> Array:
    """Returns the cross product along the last axis; faster than `numpy.cross` for small arrays."""
    return np.asarray(a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT])


def pose_array(poses: Iterable[Pose]) -> Array:
    """Returns poses as an n x 7 array: x y z [m], then w x y z, not normalized."""
    return np.array([(*pose.position, *pose.quaternion) for pose in poses], dtype=np.float64).reshape(-1, 7)


def normalized_pose_array(pose: PoseLike) -> Array:
    """Returns one pose as an array of 7, with a quaternion of norm 1; see `as_pose` for what is accepted."""
    pose = as_pose(pose)
    return np.array([*pose.position, *normalize(pose.quaternion).tolist()])


def pose_from_array(row: ArrayLike) -> Pose:
    """Returns the `Pose` of an array of 7: x y z, then w x y z."""
    x, y, z, *quaternion = np.asarray(row, dtype=np.float64).tolist()
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k))


def normalize(quaternion: ArrayLike) -> Array:
    """Returns the quaternions scaled to norm 1; a zero quaternion gives NaN."""
    q = np.asarray(quaternion, dtype=np.float64)
    if q.shape == (4,):
        w, x, y, z = q.tolist()
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        return np.array([w / norm, x / norm, y / norm, z / norm] if norm else [math.nan] * 4)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def axis_displacement(axis: ArrayLike, position: float, *, is_prismatic: bool) -> Array:
    """The motion along or about an axis, as a pose of seven numbers.

    Args:
        axis: its direction, three numbers of any length.
        position: the distance [m] or the angle [rad].
        is_prismatic: whether the motion is along the axis.
    """
    direction = np.asarray(axis, dtype=np.float64)
    direction = direction / np.linalg.norm(direction)
    if is_prismatic:
        return np.array([*(position * direction), 1.0, 0.0, 0.0, 0.0])
    return np.array([0.0, 0.0, 0.0, np.cos(position / 2), *(np.sin(position / 2) * direction)])


def quat_multiply(left: ArrayLike, right: ArrayLike) -> Array:
    """Returns the Hamilton product: the rotation `right` followed by `left`."""
    a, b = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
    if a.ndim == b.ndim == 1:
        return np.array(_product(a.tolist(), b.tolist()))
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def _product(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """The Hamilton product of two quaternions as numbers: a tenth of the time that arrays of four take."""
    w, x, y, z = a
    s, i, j, k = b
    return (
        w * s - (x * i + y * j + z * k),
        w * i + s * x + (y * k - z * j),
        w * j + s * y + (z * i - x * k),
        w * k + s * z + (x * j - y * i),
    )


def _rotated(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """One vector rotated by one unit quaternion, as numbers; see `_product`."""
    w, i, j, k = quaternion
    x, y, z = vector
    a, b, c = 2.0 * (j * z - k * y), 2.0 * (k * x - i * z), 2.0 * (i * y - j * x)
    return x + w * a + (j * c - k * b), y + w * b + (k * a - i * c), z + w * c + (i * b - j * a)


def quat_conjugate(quaternion: ArrayLike) -> Array:
    """Returns the conjugate, which is the inverse of unit quaternions."""
    return np.asarray(np.asarray(quaternion, dtype=np.float64) * np.array([1.0, -1.0, -1.0, -1.0]))


def quat_rotate(quaternion: ArrayLike, vector: ArrayLike) -> Array:
    """Returns vectors rotated by unit quaternions."""
    q, v = np.asarray(quaternion, dtype=np.float64), np.asarray(vector, dtype=np.float64)
    if q.ndim == v.ndim == 1:
        return np.array(_rotated(q.tolist(), v.tolist()))
    twice = 2.0 * cross(q[..., 1:], v)
    return np.asarray(v + q[..., :1] * twice + cross(q[..., 1:], twice))


def rotation_matrix(quaternion: ArrayLike) -> Array:
    """Returns the rotation matrices, ... x 3 x 3, of unit quaternions; the columns are the rotated axes."""
    q = np.asarray(quaternion, dtype=np.float64)[..., None, :]
    return np.swapaxes(quat_rotate(q, np.eye(3)), -1, -2)


def quaternion_from_matrix(rotation: Array) -> Array:
    """Returns the unit quaternion w x y z, with w >= 0, of one 3 x 3 rotation matrix.

    Computed from its largest component, which avoids division by small numbers (Shepperd 1978).
    """
    diagonal, skew, symmetric = rotation.diagonal(), rotation - rotation.T, rotation + rotation.T
    squares = 1.0 + np.array([diagonal.sum(), *(2.0 * diagonal - diagonal.sum())])  # 4 w², 4 x², …
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
    """Returns the smallest angle between rotations [rad]; q and -q are the same rotation, and norms are ignored.

    Uses the arctangent, which is accurate for small angles, where the arccosine loses half of the digits.
    """
    relative = quat_multiply(quat_conjugate(a), b)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(relative[..., 1:], axis=-1), np.abs(relative[..., 0])))


def pose_multiply(outer: ArrayLike, inner: ArrayLike) -> Array:
    """Returns the composition of poses, ... x 7, with unit quaternions.

    The frames cancel: `world_from_cup = pose_multiply(world_from_table, table_from_cup)`.
    """
    a, b = np.asarray(outer, dtype=np.float64), np.asarray(inner, dtype=np.float64)
    if a.ndim == b.ndim == 1:
        first, second = a.tolist(), b.tolist()
        x, y, z = _rotated(first[3:], second[:3])
        return np.array([first[0] + x, first[1] + y, first[2] + z, *_product(first[3:], second[3:])])
    position = a[..., :3] + quat_rotate(a[..., 3:], b[..., :3])
    return np.concatenate([position, quat_multiply(a[..., 3:], b[..., 3:])], axis=-1)


def mesh_scale(extents: Array, size: Vector | None) -> Array:
    """Returns the scale along x, y, z that fits a mesh with the given extents to the size of a body.

    1 if the two agree within 1 %, because maps round, or if either is unknown.
    """
    if size is None or not extents.all():
        return np.ones(3)
    scale = np.array(size) / extents
    return scale if scale.min() > 0.0 and np.abs(scale - 1.0).max() >= _SIZE_TOLERANCE else np.ones(3)


def pose_inverse(pose: ArrayLike) -> Array:
    """Returns the inverses of poses, ... x 7, with unit quaternions.

    `table_from_world = pose_inverse(world_from_table)`.
    """
    p = np.asarray(pose, dtype=np.float64)
    if p.ndim == 1:
        x, y, z, w, i, j, k = p.tolist()
        x, y, z = _rotated([w, -i, -j, -k], [x, y, z])
        return np.array([-x, -y, -z, w, -i, -j, -k])
    back = quat_conjugate(p[..., 3:])
    return np.concatenate([-quat_rotate(back, p[..., :3]), back], axis=-1)


class FrameConversion(msgspec.Struct, frozen=True, kw_only=True):
    """A conversion from one frame to another, for one value or for many (the last axis of an array is one value)."""

    axes: tuple[int, int, int] = (0, 1, 2)
    """For each axis of the target frame, the index of the source axis."""
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """For each axis of the target frame, 1 if it has the direction of that source axis, -1 if it is opposite."""
    length_factor: float = 1.0
    """Factor by which lengths are multiplied."""
    length_divisor: float = 1.0
    """Divisor that is applied after the factor: 0.01 is not exact in binary, 100 is."""

    @property
    def inverse(self) -> FrameConversion:
        """The inverse conversion."""
        back = (self.axes.index(0), self.axes.index(1), self.axes.index(2))
        x, y, z = back
        signs = (self.signs[x], self.signs[y], self.signs[z])
        return FrameConversion(
            axes=back, signs=signs, length_factor=self.length_divisor, length_divisor=self.length_factor
        )

    @property
    def flips_handedness(self) -> bool:
        """Whether one frame is right-handed and the other is left-handed."""
        return bool(np.linalg.det(np.eye(3)[list(self.axes)] * np.array(self.signs)) < 0.0)

    def lengths(self, lengths: ArrayLike) -> Array:
        """Converts lengths without a direction, such as the limit of a slide joint."""
        return np.asarray(np.asarray(lengths, dtype=np.float64) * self.length_factor / self.length_divisor)

    def directions(self, directions: ArrayLike) -> Array:
        """Converts directions, ... x 3, such as axes and normals: not scaled."""
        return np.asarray(np.asarray(directions, dtype=np.float64)[..., self.axes] * np.array(self.signs))

    def points(self, points: ArrayLike) -> Array:
        """Converts positions and displacements, ... x 3."""
        return self.lengths(self.directions(points))

    def sizes(self, sizes: ArrayLike) -> Array:
        """Converts extents, ... x 3, along the axes of a body: reordered and scaled, never negated."""
        return self.lengths(np.asarray(sizes, dtype=np.float64)[..., self.axes])

    def quaternions(self, quaternions: ArrayLike) -> Array:
        """Converts rotations, ... x 4, w x y z.

        The axis of rotation is converted as a direction; in a mirrored frame the angle changes its sign.
        """
        q = np.asarray(quaternions, dtype=np.float64)
        axis = self.directions(q[..., 1:])
        return np.concatenate([q[..., :1], -axis if self.flips_handedness else axis], axis=-1)

    def poses(self, poses: ArrayLike) -> Array:
        """Converts poses, ... x 7: x y z, then w x y z."""
        p = np.asarray(poses, dtype=np.float64)
        return np.concatenate([self.points(p[..., :3]), self.quaternions(p[..., 3:])], axis=-1)

    def pose(self, pose: Pose) -> Pose:
        """Converts one pose."""
        return pose_from_array(self.poses((*pose.position, *pose.quaternion)))


UNREAL_FROM_ROS = FrameConversion(signs=(1.0, -1.0, 1.0), length_factor=100.0)
"""(x, y, z) m becomes (100x, -100y, 100z) cm and the quaternion (w, x, y, z) becomes (w, -x, y, -z)."""
ROS_FROM_UNREAL = UNREAL_FROM_ROS.inverse

GODOT_FROM_ROS = FrameConversion(axes=(1, 2, 0), signs=(-1.0, 1.0, -1.0))
"""(x, y, z) becomes (-y, z, -x); the depth of a body, along x in ROS, is along z in Godot."""
ROS_FROM_GODOT = GODOT_FROM_ROS.inverse


def wxyz_from_xyzw(quaternions: ArrayLike) -> NDArray[Any]:
    """Moves the scalar part from the end, as in ROS, Unreal and Godot, to the front, as in a World."""
    return np.roll(np.asarray(quaternions), 1, axis=-1)


def xyzw_from_wxyz(quaternions: ArrayLike) -> NDArray[Any]:
    """Moves the scalar part from the front to the end."""
    return np.roll(np.asarray(quaternions), -1, axis=-1)
