"""Joints: how far the joints of a running world are open, seen from where its bodies are, and what opens them farther.

It takes nothing but the poses of a frame, so looking at a joint costs the engine nothing.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

import msgspec
import numpy as np

from mindstage.engines.joints import AXES, axes_of, place_from, place_of
from mindstage.stage.frame import Frame
from mindstage.stage.removal import Spawned
from mindstage.world import Body, BodyId, Constraint, Pose, Vector
from mindstage.world.geometry import Array, compose, invert, pose_from, rotate, unit, unit_pose
from mindstage.world.travel import axis_ranges

__all__ = ["Joint", "JointAxis", "Pull", "poses_in"]


class JointAxis(msgspec.Struct, frozen=True, kw_only=True):
    """One axis of a joint that can move."""

    name: str
    """x, y, z, twist, swing2 or swing1."""
    slides: bool
    """Whether its numbers are metres; else they are radians."""
    low: float | None
    """How far it goes either way; None without a limit."""
    high: float | None


class Pull(msgspec.Struct, frozen=True):
    """Where to take hold, and where to pull to."""

    id: BodyId
    point: Vector
    """In the body's frame [m]."""
    target: Vector
    """In the world [m]."""


class Joint:
    """A constraint between two bodies that are there."""

    def __init__(self, constraint: Constraint, bodies: Mapping[BodyId, Body], spawned: Spawned) -> None:
        """Looks at it.

        Args:
            constraint: as the engine describes it now.
            bodies: both ends are among them.
            spawned: what was given, from where it counts.
        """
        parent, child = constraint.parent, constraint.child
        given = spawned.constraints.get(constraint.id, constraint)
        frame = unit_pose(given.pose)
        self.constraint = constraint
        self.moving = child if bodies[child].physics.simulates or not bodies[parent].physics.simulates else parent
        """The end that one pulls: the map may have the roles upside down."""
        self._movable = axes_of(constraint)
        self._size = bodies[self.moving].size or (0.0, 0.0, 0.0)
        self._parent_from_joint = compose(invert(_given(spawned, bodies, parent)), frame)
        self._child_from_joint = compose(invert(_given(spawned, bodies, child)), frame)

    @property
    def axes(self) -> tuple[JointAxis, ...]:
        """What can move, slides first."""
        ranges = axis_ranges(self.constraint)
        return tuple(
            JointAxis(
                name=AXES[axis.index],
                slides=axis.slides,
                low=None if axis.limit is None else ranges[axis.index].middle - axis.limit,
                high=None if axis.limit is None else ranges[axis.index].middle + axis.limit,
            )
            for axis in self._movable
        )

    def positions(self, poses: Mapping[BodyId, Array]) -> dict[str, float]:
        """How far it is on each axis that can move, from where it was spawned [m or rad].

        Args:
            poses: where both ends are, seven numbers with a unit quaternion.
        """
        places = place_of(self._joint_in_joint(poses), self._movable)
        return {AXES[axis.index]: float(places[axis.index]) for axis in self._movable}

    def pose_at(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> Pose:
        """Where the moving end is when one axis is there, and the others are as they are."""
        return pose_from(self._place_at(axis, value, poses))

    def pull_to(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> Pull:
        """How to pull the moving end so that one axis goes there: far from a hinge, in the middle of a slide."""
        there = self._place_at(axis, value, poses)
        point = np.zeros(3) if AXES.index(axis) < 3 else self._far_from(AXES.index(axis) % 3)
        return Pull(self.moving, _vector(point), _vector(there[:3] + rotate(there[3:], point)))

    def _joint_in_joint(self, poses: Mapping[BodyId, Array]) -> Array:
        """The child's joint frame seen from the parent's."""
        parent, child = poses[self.constraint.parent], poses[self.constraint.child]
        return compose(invert(compose(parent, self._parent_from_joint)), compose(child, self._child_from_joint))

    def _place_at(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> Array:
        coordinates = place_of(self._joint_in_joint(poses), self._movable).tolist()
        coordinates[AXES.index(axis)] = value
        moved = place_from(coordinates)
        if self.moving == self.constraint.child:
            joint = compose(poses[self.constraint.parent], self._parent_from_joint)
            return compose(compose(joint, moved), invert(self._child_from_joint))
        joint = compose(poses[self.constraint.child], self._child_from_joint)
        return compose(compose(joint, invert(moved)), invert(self._parent_from_joint))

    def _far_from(self, direction: int) -> Array:
        """The middle of the side that is farthest from a hinge, in the moving end's frame."""
        joint = self._child_from_joint if self.moving == self.constraint.child else self._parent_from_joint
        axis = rotate(joint[3:], np.eye(3)[direction])
        half = np.asarray(self._size) / 2
        sides = [sign * half[side] * np.eye(3)[side] for side in range(3) for sign in (-1.0, 1.0)]
        arms = [float(np.linalg.norm(np.cross(side - joint[:3], axis))) for side in sides]
        farthest: Array = sides[int(np.argmax(arms))]
        return farthest


def poses_in(frame: Frame, ids: Container[BodyId]) -> dict[BodyId, Array]:
    """The poses of some bodies, by id: seven numbers with a unit quaternion."""
    found = {}
    for row, id in enumerate(frame.ids):
        if id in ids:
            pose = frame.poses[row].copy()
            pose[3:] = unit(pose[3:])
            found[id] = pose
    return found


def _given(spawned: Spawned, bodies: Mapping[BodyId, Body], id: BodyId) -> Array:
    return unit_pose(spawned.poses[id] if id in spawned.poses else bodies[id].pose)


def _vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
