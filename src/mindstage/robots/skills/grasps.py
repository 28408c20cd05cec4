"""Grasps of a parallel gripper, from the collision shapes of what is grasped.

A grasp closes the fingers across a box that is narrower than the opening of the gripper: the box around a thing, or
around one of its collision shapes, such as the bar of a handle or the wall of a bowl. The frame of a grasp is that of
`Gripper.grasp_pose`: x points out of the hand, the fingers close along y.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from math import cos, pi, sin
from typing import NamedTuple

import numpy as np

from mindstage.robots.models.robot_model import Gripper, GripperType, RobotModel
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.scene import Body
from mindstage.scene.collision_shapes import compile_geometry, fallback_collision_shape
from mindstage.scene.geometry import BodyGeometry, CollisionShape
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_inverse,
    pose_multiply,
    quat_rotate,
    quaternion_from_matrix,
    rotation_matrix,
)

__all__ = [
    "FINGER_CLEARANCE_M",
    "Grasp",
    "GripperShape",
    "approaches_of",
    "diagonal_grasps_of",
    "edge_grasps_of",
    "grasps_of",
    "pushes_of",
    "sweeps_of",
]

FINGER_CLEARANCE_M = 0.003
"""Least distance of each open finger from what is grasped."""
_ROOM_M = 0.025
"""Distance of each open finger from what it is to grasp, where the gripper opens that far."""
_TIGHT_ROOM_M = 0.008
"""The same if the neighbors of a thing are near."""
_SHIFTS = (0.0, 0.25, -0.25)
"""Grasped places along a long box, as fractions of its length."""
_LONG_M = 0.09
_TIP_GAP_M = 0.006
"""Least distance of the finger tips from what is behind a thing, such as the door behind a handle."""
_MIN_OVERLAP_M = 0.008
"""Least length of the fingers beside what is grasped."""
_SHALLOW_M, _LEAST_BACK_M = 0.035, 0.005
"""Length of the fingers beside what only their tips hold, and the least by which the hand is farther away then."""
_TIP_SAMPLES = 9
"""Number of openings of the gripper at which the finger tips are located."""
_PALM_GAP_M = 0.012
"""Least distance of the palm from what is grasped."""
_ANGLES = 12
"""Directions of approach around the axis along which the fingers close."""
_MIN_THICKNESS_M = 0.002
_APPROACH_GAP_M = 0.005
"""Distance of the finger tips from a side in front of which they stop."""
_ROD_RATIO = 2.5
"""A box that is longer than its other sides by this factor is a rod, such as the bar of a handle."""
_DIAGONALS_RAD = (pi / 4, pi / 6, pi / 3)
"""Angles between the sides of a rod and the directions in which it is grasped across its edges."""
_DIAGONAL_TIPS_M = (0.016, 0.01)
"""How far the finger tips are beyond the axis of such a rod: there is little room behind it."""
_DIAGONAL_ROOM_M = 0.007
_DIAGONAL_SHIFT_FRACTIONS = (0.0, 0.2, -0.2, 0.4, -0.4)
_EDGE_SHIFT_FRACTIONS = (0.0, 0.25, -0.25, 0.4, -0.4)
_SIDE_SHIFTS = (0.35, 0.2, 0.45)
"""Places along the edges beside the free edge, towards it."""
_EDGE_OVERLAPS_M = (0.035, 0.055, 0.02)
"""Lengths of the fingers beside an edge of a door."""
_EDGE_ROOM_M = 0.012
_TOUCH_M = 0.001
"""What is narrower than the gap between closed fingers, or wider by less than this, is not held."""
_PUSH_SHIFTS = (0.35, -0.35, 0.2, -0.2, 0.0)
"""Places along a part at which it is pushed, as fractions of its length; the handle is often in the middle."""
_PUSH_INSET_M = 0.06
_SWEEP_INSETS_M, _SWEEP_SHIFTS = (0.06, 0.12, 0.2), (0.42, -0.42, 0.3, -0.3, 0.15, -0.15, 0.0)
"""Places at which a door is pushed shut: from its free edge [m], and along it, as fractions of its length."""
_SWEEP_TURNS_RAD = (0.0, 0.7, -0.7, 1.1, -1.1)
"""Directions of the hand that pushes, relative to straight ahead."""
_PUSH_GAP_M = 0.002
_MAX_UP = 0.35
"""Largest upward component of the direction of approach: a hand does not come from below."""


class GripperShape(NamedTuple):
    """The extents of an open gripper, in its grasp frame [m]."""

    opening: float
    """Distance between the finger pads."""
    tip: float
    """How far the finger tips are in front of the grasp frame."""
    palm: float
    """How far the palm is behind the grasp frame."""
    half_width: float
    """Half of the extent of the closed fingers along y."""
    half_height: float
    """Half of their extent along z."""
    tips: tuple[float, ...] = ()
    """`tip` at equal steps from closed to open; the tips of fingers that turn move forwards when they close."""

    middles: tuple[float, ...] = ()
    """How far the middles of the fingers are in front of the grasp frame, as `tips`."""
    gaps: tuple[tuple[float, float], ...] = ()
    """Corners (x, half of the distance) of the inner sides of the closed fingers, which need not be parallel."""

    def tip_from(self, width: float) -> float:
        """How far the finger tips are in front of the grasp frame while they close on what has a width [m]."""
        if len(self.tips) < 2:
            return self.tip
        first, last = (each / self.opening for each in (width, width + 2 * _ROOM_M))
        shares = np.linspace(0.0, 1.0, len(self.tips))
        ends = np.interp((first, last), shares, self.tips)
        between = np.asarray(self.tips)[(shares > first) & (shares < last)]
        return float(max(ends.max(), between.max(initial=0.0)))

    def pads_at(self, width: float) -> float:
        """How much farther than open the pads are in front of the grasp frame when they touch what has a width [m]."""
        if len(self.middles) < 2:
            return 0.0
        shares = np.linspace(0.0, 1.0, len(self.middles))
        return float(np.interp(width / self.opening, shares, self.middles)) - self.middles[-1]

    def touches(self, x: float, width: float) -> bool:
        """Whether the fingers close on what has a width [m] at a distance x in front of the grasp frame [m]."""
        if not self.gaps:
            return True
        places, halves = np.array(self.gaps).T
        return width / 2 > float(np.interp(x, places, halves)) + _TOUCH_M

    @classmethod
    def of(cls, model: RobotModel, gripper: Gripper, kinematics: RobotKinematics) -> GripperShape:
        """The extents of a gripper, from the collision shapes of its links."""
        geometries = {link.name: link.geometry for link in model.links}

        def extents(link: str, positions: Sequence[float] | Array) -> tuple[Array, Array]:
            """The lowest and the highest coordinates of a link in the grasp frame."""
            geometry = geometries.get(link)
            if geometry is None or not geometry.collision_shapes:
                return np.zeros(3), np.zeros(3)
            placed = placed_at(link, np.vstack([_corners(each) for each in geometry.collision_shapes]), positions)
            return placed.min(axis=0), placed.max(axis=0)

        def placed_at(link: str, points: Array, positions: Sequence[float] | Array) -> Array:
            """Points of a link in the grasp frame."""
            joints = dict(zip(gripper.joints, positions, strict=True))
            local = pose_multiply(pose_inverse(kinematics.pose(gripper.name, joints)), kinematics.pose(link, joints))
            return local[:3] + quat_rotate(local[3:], points)

        closed = [extents(link, gripper.closed_positions) for link in gripper.finger_links]
        opened, shut = np.array(gripper.open_positions), np.array(gripper.closed_positions)
        sampled = [
            [extents(link, shut + share * (opened - shut)) for link in gripper.finger_links]
            for share in np.linspace(0.0, 1.0, _TIP_SAMPLES)
        ]
        tips = tuple(max((float(high[0]) for _, high in each), default=0.0) for each in sampled)
        middles = tuple(max((float(low[0] + high[0]) / 2 for low, high in each), default=0.0) for each in sampled)
        palm = -float(extents(gripper.link, gripper.open_positions)[1][0])
        sides = np.array([np.maximum(np.abs(low), np.abs(high)) for low, high in closed]).reshape(-1, 3)
        _, width, height = sides.max(axis=0, initial=0.0).tolist()
        inner = [
            placed_at(link, _corners(shape), gripper.closed_positions)
            for link in gripper.finger_links
            if (geometry := geometries.get(link)) is not None
            for shape in geometry.collision_shapes
        ]
        gaps = _lower_edge(np.vstack(inner)) if inner else ()
        return cls(gripper.max_opening_m, tips[-1], max(palm, 0.0), width, height, tips, middles, gaps)


class Grasp(NamedTuple):
    """A grasp of a body."""

    pose: Array
    """The grasp frame in the frame of the body."""
    width_m: float
    """Extent of what is between the fingers."""
    is_whole: bool
    """Whether the whole body is between the fingers, rather than a part of it."""
    is_central: bool
    """Whether it is grasped at its middle."""
    room_m: float = _ROOM_M
    """Distance of each open finger from what is grasped, where the gripper opens that far."""
    overlap_m: float = 0.0
    """Length of the fingers beside what is grasped, if it is a grasp between two of its sides."""

    def opening_m(self, largest_m: float) -> float:
        """The opening with which the gripper comes [m].

        Args:
            largest_m: the largest opening of the gripper.
        """
        return min(self.width_m + 2 * self.room_m, largest_m)

    def tight(self) -> Grasp:
        """The same with less room, for a thing whose neighbors are near."""
        return self._replace(room_m=min(self.room_m, _TIGHT_ROOM_M))

    def shallow(self) -> Grasp | None:
        """The same with the finger tips only, for a thing that is a little out of reach; None if it is not firm."""
        back_m = self.overlap_m - _SHALLOW_M
        if back_m < _LEAST_BACK_M:
            return None
        pose = pose_multiply(self.pose, np.array([-back_m, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
        return self._replace(pose=pose, overlap_m=_SHALLOW_M)

    def in_world(self, body_pose: Array) -> Array:
        """The grasp frame in the world frame."""
        return pose_multiply(body_pose, self.pose)


class _Box(NamedTuple):
    """A box in the frame of a body."""

    pose: Array
    size: Array

    def extent(self, direction: Array) -> float:
        """Its extent along a unit vector [m]."""
        return float(np.abs(rotation_matrix(self.pose[3:]).T @ direction) @ self.size)

    def end(self, direction: Array) -> float:
        """The coordinate of its last point along a unit vector [m]."""
        return float(self.pose[:3] @ direction) + self.extent(direction) / 2


def grasps_of(
    body: Body, geometry: BodyGeometry | None, body_pose: Array, gripper: Gripper, shape: GripperShape
) -> Iterator[Grasp]:
    """The grasps of a body: of the whole body before those of its parts.

    Args:
        body_pose: its pose in the world frame, seven numbers.
        shape: the extents of the gripper.
    """
    if gripper.type is not GripperType.PARALLEL:
        return
    shapes = _shapes_of(body, geometry)
    low, high = compile_geometry(shapes).bounds
    whole = _Box(np.array([*(low + high) / 2, 1.0, 0.0, 0.0, 0.0]), high - low)
    yield from _box_grasps(whole, whole, body_pose, shape, is_whole=True)
    if len(shapes) > 1:
        for each in shapes:
            part = _Box(normalized_pose_array(each.pose), np.asarray(each.size))
            yield from _box_grasps(part, whole, body_pose, shape)


def diagonal_grasps_of(
    body: Body, geometry: BodyGeometry | None, gripper: Gripper, shape: GripperShape
) -> Iterator[Grasp]:
    """Grasps of the rods of a body across their edges, for a handle with a wall or a worktop beside it.

    The hand comes between the directions of the sides, so that its palm, which is wider than its fingers, keeps away
    from both what is behind the rod and what is beside it; one finger is behind the rod and pulls it.

    Args:
        shape: the extents of the gripper.
    """
    if gripper.type is not GripperType.PARALLEL:
        return
    for each in _shapes_of(body, geometry):
        box = _Box(normalized_pose_array(each.pose), np.asarray(each.size, dtype=float))
        long = int(np.argmax(box.size))
        first, second = (axis for axis in range(3) if axis != long)
        if box.size[long] < _ROD_RATIO * max(box.size[first], box.size[second]):
            continue
        axes = rotation_matrix(box.pose[3:]).T
        for angle, turn in product(_DIAGONALS_RAD, range(4)):
            inward = cos(angle + turn * pi / 2) * axes[first] + sin(angle + turn * pi / 2) * axes[second]
            across = np.cross(axes[long], inward)
            width = box.extent(across)
            if width > shape.opening - 2 * FINGER_CLEARANCE_M:
                continue
            for beyond, shift in product(_DIAGONAL_TIPS_M, _DIAGONAL_SHIFT_FRACTIONS):
                if not shape.touches(shape.tip_from(width) - beyond, width):
                    continue  # the inner sides of the fingers diverge so much that the rod is not held
                origin = box.pose[:3] + inward * (beyond - shape.tip_from(width)) + axes[long] * shift * box.size[long]
                for sign in (1.0, -1.0):
                    pose = np.concatenate([origin, _rotation(inward, sign * across)])
                    yield Grasp(
                        pose,
                        width,
                        is_whole=False,
                        is_central=shift == 0.0,
                        room_m=_DIAGONAL_ROOM_M,
                    )


def edge_grasps_of(
    body: Body, geometry: BodyGeometry | None, normal: Array, edge: Array, gripper: Gripper, shape: GripperShape
) -> Iterator[Grasp]:
    """Grasps of a door that is ajar by its free edge, or by those beside it, with a finger on each side.

    Args:
        body: the door.
        normal: a vector in the frame of the body across the door.
        edge: a point in the frame of the body near its free edge, such as that of the handle.
        shape: the extents of the gripper.
    """
    if gripper.type is not GripperType.PARALLEL:
        return
    middle, half, axis, to_edge, along = _sides(body, geometry, normal, edge)
    width = 2 * float(half[axis])
    if width > shape.opening - 2 * _EDGE_ROOM_M:
        return
    sides = [(to_edge, along, _EDGE_SHIFT_FRACTIONS), *((sign * along, to_edge, _SIDE_SHIFTS) for sign in (1.0, -1.0))]
    for overlap, (outwards, lengthwise, shifts) in product(_EDGE_OVERLAPS_M, sides):
        length = float(np.abs(lengthwise) @ half) * 2
        end = middle + outwards * float(np.abs(outwards) @ half)
        for shift, sign in product(shifts, (1.0, -1.0)):
            origin = end + outwards * (shape.tip_from(width) - overlap) + lengthwise * shift * length
            pose = np.concatenate([origin, _rotation(-outwards, sign * np.eye(3)[axis])])
            yield Grasp(pose, width, is_whole=False, is_central=shift == 0.0, room_m=_EDGE_ROOM_M)


def approaches_of(body: Body, geometry: BodyGeometry | None, body_pose: Array, shape: GripperShape) -> Iterator[Grasp]:
    """Poses in which the finger tips are just in front of a side of a body."""
    low, high = compile_geometry(_shapes_of(body, geometry)).bounds
    middle, half = (low + high) / 2, (high - low) / 2
    for axis in (2, 0, 1):
        for sign in (1.0, -1.0):
            inward = np.zeros(3)
            inward[axis] = -sign
            if quat_rotate(body_pose[3:], inward)[2] > _MAX_UP:
                continue
            origin = middle - inward * (half[axis] + shape.tip_from(0.0) + _APPROACH_GAP_M)
            for other in (each for each in range(3) if each != axis):
                across = np.eye(3)[other]
                pose = np.concatenate([origin, _rotation(inward, across)])
                yield Grasp(pose, 0.0, is_whole=True, is_central=True)


def pushes_of(
    body: Body, geometry: BodyGeometry | None, outward: Array, edge: Array, shape: GripperShape
) -> Iterator[Grasp]:
    """Poses in which the closed fingers touch the outer side of a door or drawer, to push it.

    The finger tips point at it, or the fingers lie along it from its free edge on.

    Args:
        body: the articulated part.
        outward: a vector in the frame of the body that points to its outer side.
        edge: a point in the frame of the body near its free edge, such as that of the handle.
        shape: the extents of the gripper.
    """
    middle, half, normal_axis, to_edge, along = _sides(body, geometry, outward, edge)
    normal = np.eye(3)[normal_axis] * np.sign(outward[normal_axis])
    edge_axis, along_axis = int(np.argmax(np.abs(to_edge))), int(np.argmax(along))
    face = middle + normal * half[normal_axis]
    for shift in _PUSH_SHIFTS:
        point = face + along * shift * 2 * half[along_axis]
        lying = point + to_edge * (half[edge_axis] - max(shape.palm - _PALM_GAP_M, 0.0))
        pointing = point + to_edge * max(half[edge_axis] - _PUSH_INSET_M, 0.0)
        for sign in (1.0, -1.0):
            options = (
                (lying + normal * shape.half_width, -to_edge, sign * normal),
                (lying + normal * shape.half_height, -to_edge, sign * along),
                (pointing + normal * shape.tip_from(0.0), -normal, sign * along),
                (pointing + normal * shape.tip_from(0.0), -normal, sign * to_edge),
            )
            for origin, x, y in options:
                pose = np.concatenate([origin + normal * _PUSH_GAP_M, _rotation(x, y)])
                yield Grasp(pose, 0.0, is_whole=True, is_central=True)


def sweeps_of(
    body: Body, geometry: BodyGeometry | None, outward: Array, edge: Array, poses: Array, shape: GripperShape
) -> Iterator[tuple[Grasp, Array]]:
    """Pushes that close a door with the finger tips, while the hand keeps the direction in which it points.

    It points to where the outer side of the door is at the end. So the fingers lie along that side of a door that is
    wide open, under it if it is one that folds down, and point at it when it is nearly closed.

    Args:
        body: the door.
        outward: a vector in the frame of the body that points to its outer side.
        edge: a point in the frame of the body near its free edge, such as that of the handle.
        poses: n x 7: the poses of the door on its way.
        shape: the extents of the gripper.

    Yields:
        The push at the first pose, and the poses of the grasp frame, n x 7.
    """
    middle, half, axis, to_edge, along = _sides(body, geometry, outward, edge)
    normal = np.eye(3)[axis] * np.sign(outward[axis])
    ahead = quat_rotate(poses[-1, 3:], -normal)
    hinge = quat_rotate(poses[-1, 3:], along)
    inwards = np.array([quat_rotate(each[3:], -normal) for each in poses])
    far, length = float(np.abs(to_edge) @ half), 2 * float(np.abs(along) @ half)
    up = np.cross(ahead, hinge)
    for turn, inset, shift, sign in product(_SWEEP_TURNS_RAD, _SWEEP_INSETS_M, _SWEEP_SHIFTS, (1.0, -1.0)):
        pointing = cos(turn) * ahead + sin(turn) * hinge
        across = np.cross(up, pointing)
        point = middle + normal * half[axis] + to_edge * (far - inset) + along * shift * length
        on_side = np.array([each[:3] + quat_rotate(each[3:], point) for each in poses])
        rotation = _rotation(pointing, sign * across)
        apart = shape.half_height * np.abs(inwards @ up) + shape.half_width * np.abs(inwards @ across) + _PUSH_GAP_M
        origins = on_side - inwards * apart[:, None] - pointing * shape.tip_from(0.0)
        path = np.concatenate([origins, np.tile(rotation, (len(poses), 1))], axis=1)
        pose = pose_multiply(pose_inverse(poses[0]), path[0])
        yield Grasp(pose, 0.0, is_whole=True, is_central=True), path


def _sides(
    body: Body, geometry: BodyGeometry | None, normal: Array, edge: Array
) -> tuple[Array, Array, int, Array, Array]:
    """The middle of a part, half its size, the axis across it, and unit vectors to its free edge and along that."""
    low, high = compile_geometry(_shapes_of(body, geometry)).bounds
    middle, half = (low + high) / 2, (high - low) / 2
    normal_axis = int(np.argmax(np.abs(normal)))
    across = [axis for axis in range(3) if axis != normal_axis]
    edge_axis = max(across, key=lambda axis: abs(edge[axis] - middle[axis]) / max(float(half[axis]), 1e-6))
    along_axis = next(axis for axis in across if axis != edge_axis)
    to_edge = np.eye(3)[edge_axis] * (np.sign(edge[edge_axis] - middle[edge_axis]) or 1.0)
    return middle, half, normal_axis, to_edge, np.eye(3)[along_axis]


def _corners(shape: CollisionShape) -> Array:
    """The points of a hull, or the corners of the box around a shape, in the frame of the link."""
    half = np.asarray(shape.size) / 2
    points = np.array(shape.points or list(product(*((-each, each) for each in half.tolist()))))
    pose = normalized_pose_array(shape.pose)
    return np.asarray(pose[:3] + quat_rotate(pose[3:], points))


def _lower_edge(points: Array) -> tuple[tuple[float, float], ...]:
    """The lower side of the convex outline of some points, seen along z, in x and the distance from y = 0."""
    outline = list[tuple[float, float]]()
    for x, y in sorted((x, max(abs(y), 0.0)) for x, y, _ in points.tolist()):
        while len(outline) > 1 and (outline[-1][0] - outline[-2][0]) * (y - outline[-2][1]) <= (
            outline[-1][1] - outline[-2][1]
        ) * (x - outline[-2][0]):
            outline.pop()
        outline.append((x, y))
    return tuple(outline)


def _shapes_of(body: Body, geometry: BodyGeometry | None) -> tuple[CollisionShape, ...]:
    if geometry is not None and geometry.collision_shapes:
        return geometry.collision_shapes
    return (fallback_collision_shape(body, body.size or (0.1, 0.1, 0.1)),)


def _box_grasps(
    box: _Box, whole: _Box, body_pose: Array, shape: GripperShape, *, is_whole: bool = False
) -> Iterator[Grasp]:
    axes = rotation_matrix(box.pose[3:]).T
    for closing in range(3):
        width = float(box.size[closing])
        if not _MIN_THICKNESS_M <= width <= shape.opening - 2 * FINGER_CLEARANCE_M:
            continue
        others = [axis for axis in range(3) if axis != closing]
        for number in range(_ANGLES):
            angle = 2 * np.pi * number / _ANGLES
            inward = np.cos(angle) * axes[others[0]] + np.sin(angle) * axes[others[1]]
            if quat_rotate(body_pose[3:], inward)[2] > _MAX_UP:
                continue
            yield from _grasps_from(box, whole, closing, inward, shape, is_whole=is_whole)


def _grasps_from(
    box: _Box, whole: _Box, closing: int, inward: Array, shape: GripperShape, *, is_whole: bool
) -> Iterator[Grasp]:
    """The grasps with one direction of approach, at places along the box."""
    axes = rotation_matrix(box.pose[3:]).T
    half = box.extent(inward) / 2
    behind = whole.end(inward) - (box.end(inward) - 2 * half)  # from the near side to the far one of the whole body
    width = float(box.size[closing])
    tip = shape.tip_from(width)
    depth = min(half - shape.pads_at(width), shape.palm - _PALM_GAP_M, behind - tip - _TIP_GAP_M)
    if depth + tip < min(_MIN_OVERLAP_M, half) or shape.palm < _PALM_GAP_M:
        return
    along = np.cross(inward, axes[closing])
    length = box.extent(along)
    is_aligned = max(np.abs(axes @ inward)) > 0.99  # else a shift along the box would leave it
    for shift in _SHIFTS if length > _LONG_M and is_aligned else (0.0,):
        origin = box.pose[:3] - inward * (half - depth) + along * shift * length
        for sign in (1.0, -1.0):
            pose = np.concatenate([origin, _rotation(inward, sign * axes[closing])])
            yield Grasp(
                pose,
                width,
                is_whole=is_whole,
                is_central=shift == 0.0,
                overlap_m=depth + tip,
            )


def _rotation(x: Array, y: Array) -> Array:
    """The quaternion of the frame with these axes."""
    return normalize(quaternion_from_matrix(np.column_stack([x, y, np.cross(x, y)])))
