"""Interaction with bodies and joints: spring-damper perturbations, and joint positions computed from body poses.

A perturbation pulls a point of a body towards a target, with a stiffness and damping that follow the pulled mass and a
force limited to that of an arm. Joint positions need only the poses of a snapshot, not the engine.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import Engine, PoseArray
from mindstage.engines.kinematic_tree import AXIS_NAMES, joint_coordinates, movable_axes, pose_from_joint_coordinates
from mindstage.ranges import Finite, checked
from mindstage.scene import Body, BodyId, Joint, Pose, Vector, World
from mindstage.scene.joint_kinematics import axis_ranges, handles_by_body, moving_body, outward_joints
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_rotate,
)

__all__ = ["JointAxisState", "JointHandle", "Perturbations", "PullTarget", "SpawnRecord", "SpringPerturbation"]


_SUBSTEP_S = 0.004
"""The interval at which the force is computed [s]; the spring and damper below are stable at it."""
_MAX_STIFFNESS_N_M = 400.0
_STIFFNESS_PER_KG = 1500.0  # [N/(m kg)]; a held body sags by 7 mm under gravity


@dataclass(slots=True, kw_only=True)
class SpringPerturbation:
    """A spring and damper between a point of a body and a target in the world."""

    id: BodyId
    point: Vector
    """Where the force acts, in the body frame [m]."""
    target: Vector
    """Where the point is pulled to, in the world frame [m]."""
    mass_kg: float = 1.0
    """The mass that is pulled."""
    max_force: float = 150.0
    """Limit of the force [N]; the default is about the force of an arm."""
    held: Array | None = None
    """Where the point was at the last call of `force`, in the world frame [m]."""

    def force(self, pose: PoseArray, duration_s: float) -> tuple[Vector, Vector]:
        """Returns the force [N] and the point at which it acts [m], both in the world frame.

        Args:
            pose: the current pose of the body, seven numbers.
            duration_s: time since the last call [s], for the velocity of the point.
        """
        held = pose[:3] + quat_rotate(normalize(pose[3:]), np.asarray(self.point))
        return _vector(spring_forces([self], held[None], duration_s)[0]), _vector(held)


def spring_forces(springs: Sequence[SpringPerturbation], held: Array, duration_s: float | Array) -> Array:
    """The forces of springs and dampers, k x 3 [N].

    Args:
        springs: the springs, k; they remember where they are held.
        held: the current position of the point of each one in the world, k x 3 [m].
        duration_s: time since the last call [s], for the velocity of the points; one number, or k x 1.
    """
    previous = np.array([now if each.held is None else each.held for each, now in zip(springs, held, strict=True)])
    for each, now in zip(springs, held, strict=True):
        each.held = now
    mass = np.array([[each.mass_kg] for each in springs])
    stiffness = np.minimum(_MAX_STIFFNESS_N_M, _STIFFNESS_PER_KG * mass)
    damping = 1.4 * np.sqrt(stiffness * mass)
    stretch = np.array([each.target for each in springs]) - held
    force = stiffness * stretch - damping * (held - previous) / np.maximum(duration_s, 1e-6)
    size = np.sqrt((force * force).sum(axis=1, keepdims=True))
    limit = np.array([[each.max_force] for each in springs])
    return np.asarray(force * np.minimum(1.0, limit / np.maximum(size, 1e-12)))


class Perturbations(dict[BodyId, SpringPerturbation]):
    """The active perturbations, by body."""

    def pull(self, id: BodyId, *, point: Vector, target: Vector, worlds: Iterable[World]) -> None:
        """Starts to pull a point of a body, or moves the target of an active pull at that point."""
        held = self.get(id)
        if held is None or held.point != point:
            self[id] = SpringPerturbation(id=id, point=point, target=target, mass_kg=_effective_mass(id, worlds))
        else:
            held.target = target

    def release(self, id: BodyId | None = None) -> None:
        """Ends the pull on one body, or all pulls."""
        if id is None:
            self.clear()
        else:
            self.pop(id, None)

    def substeps(self, engine: Engine, duration_s: float) -> Iterator[float]:
        """Applies the forces for a time [s], and yields the parts by which the caller has to step the engine [s]."""
        left_s = duration_s
        while self and left_s > _SUBSTEP_S:
            self.apply_forces(engine, _SUBSTEP_S)
            yield _SUBSTEP_S
            left_s -= _SUBSTEP_S
        yield left_s

    def apply_forces(self, engine: Engine, duration_s: float) -> None:
        """Applies the forces for the next step of the engine [s]."""
        ids, poses = engine.poses()
        rows = {id: row for row, id in enumerate(ids) if id in self}
        for id, perturbation in list(self.items()):
            if id in rows:
                engine.apply_force(id, *perturbation.force(poses[rows[id]], duration_s))


def _effective_mass(id: BodyId, worlds: Iterable[World]) -> float:
    """The mass of a body and of all its parents in the attachment tree [kg]; 1 if unknown."""
    masses: dict[BodyId, float] = {}
    parents: dict[BodyId, BodyId] = {}
    for world in worlds:
        masses |= {body.id: body.physics.mass_kg or 0.0 for body in world.bodies}
        parents |= {attachment.child: attachment.parent for attachment in world.attachments}
    mass, visited = 0.0, set[BodyId]()
    while id in masses and id not in visited:
        mass += masses[id]
        visited.add(id)
        id = parents.get(id, BodyId(""))
    return mass or 1.0


def _vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


class JointAxisState(msgspec.Struct, frozen=True, kw_only=True):
    """A free or limited axis of a joint."""

    name: str
    """x, y, z, twist, swing2 or swing1."""
    is_prismatic: bool
    """Whether positions are in meters; otherwise in radians."""
    lower: float | None
    """Lower limit [m or rad]; None without a limit."""
    upper: float | None
    """Upper limit [m or rad]; None without a limit."""


class PullTarget(msgspec.Struct, frozen=True):
    """A point of a body, and the target that it is to be pulled to."""

    id: BodyId
    point: Vector
    """In the body frame [m]."""
    target: Vector
    """In the world frame [m]."""


class SpawnRecord(msgspec.Struct, frozen=True):
    """The spawned poses of bodies and joints, to which joint positions are relative."""

    poses: Mapping[BodyId, Pose]
    """By body."""
    joints: Mapping[BodyId, Joint]
    """By id."""
    outward_joints: Mapping[BodyId, Joint] = {}
    """The joints that engines limit to the outward direction, with these limits, by id."""

    @classmethod
    def from_worlds(cls, worlds: Iterable[World]) -> SpawnRecord:
        """The record of several worlds."""
        poses: dict[BodyId, Pose] = {}
        joints: dict[BodyId, Joint] = {}
        bodies: dict[BodyId, Body] = {}
        parents: dict[BodyId, BodyId] = {}
        for world in worlds:
            bodies |= {body.id: body for body in world.bodies}
            poses |= {body.id: body.pose for body in world.bodies}
            joints |= {joint.id: joint for joint in world.joints}
            parents |= {attachment.child: attachment.parent for attachment in world.attachments}
        limited = outward_joints(tuple(joints.values()), bodies, handles_by_body(bodies, parents))
        return cls(poses, joints, {id: each.joint for id, each in limited.items()})


class JointHandle:
    """Kinematics of a joint between two existing bodies, relative to where they were spawned."""

    def __init__(self, joint: Joint, bodies: Mapping[BodyId, Body], spawn_record: SpawnRecord) -> None:
        """Computes the joint frames of both bodies.

        Args:
            joint: the joint, as in the current snapshot of the engine.
            bodies: the current bodies by id, including both ends.
            spawn_record: the spawned poses, which define the zero position.
        """
        parent, child = joint.parent, joint.child
        spawned = spawn_record.joints.get(joint.id, joint)
        frame = normalized_pose_array(spawned.pose)
        limited = spawn_record.outward_joints.get(joint.id)
        if limited is not None and limited.parent == joint.parent:
            joint = replace(joint, linear=limited.linear, angular=limited.angular)
        self.joint = joint
        self.moving_body = moving_body(joint, bodies[parent], bodies[child])[0].id
        """The end that is pulled; in some maps it is the parent."""
        self._movable_axes = movable_axes(joint)
        self._size = bodies[self.moving_body].size or (0.0, 0.0, 0.0)
        self._held_points: dict[str, Array] = {}
        """Where the moving body is held in `pull_target`, by axis."""
        self._parent_from_joint = pose_multiply(pose_inverse(_spawn_pose(spawn_record, bodies, parent)), frame)
        self._child_from_joint = pose_multiply(pose_inverse(_spawn_pose(spawn_record, bodies, child)), frame)

    @property
    def axes(self) -> tuple[JointAxisState, ...]:
        """The axes that are not locked, prismatic before revolute."""
        ranges = axis_ranges(self.joint)
        return tuple(
            JointAxisState(
                name=AXIS_NAMES[axis.index],
                is_prismatic=axis.is_prismatic,
                lower=None if axis.limit is None else ranges[axis.index].middle - axis.limit,
                upper=None if axis.limit is None else ranges[axis.index].middle + axis.limit,
            )
            for axis in self._movable_axes
        )

    def positions(self, poses: Mapping[BodyId, Array]) -> dict[str, float]:
        """The position on each axis that is not locked, relative to the spawned pose [m or rad].

        Args:
            poses: the poses of both ends, seven numbers with a unit quaternion.
        """
        coordinates = joint_coordinates(self._relative_joint_frame(poses), self._movable_axes)
        return {AXIS_NAMES[axis.index]: float(coordinates[axis.index]) for axis in self._movable_axes}

    @checked
    def pose_for(self, axis: str, value: Finite, poses: Mapping[BodyId, Array]) -> Pose:
        """The pose of the moving body with one axis at a value [m or rad], and the others unchanged."""
        return pose_from_array(self._pose_array_at(axis, value, poses))

    @checked
    def pull_target(self, axis: str, value: Finite, poses: Mapping[BodyId, Array]) -> PullTarget:
        """The pull that moves one axis to a value [m or rad], at the side far from a hinge, or at the center."""
        goal = self._pose_array_at(axis, value, poses)
        if axis not in self._held_points:
            index = AXIS_NAMES.index(axis)
            self._held_points[axis] = np.zeros(3) if index < 3 else self._farthest_side(index % 3)
        point = self._held_points[axis]
        return PullTarget(self.moving_body, _vector(point), _vector(goal[:3] + quat_rotate(goal[3:], point)))

    def _relative_joint_frame(self, poses: Mapping[BodyId, Array]) -> Array:
        """The pose of the child's joint frame in the parent's joint frame."""
        parent, child = poses[self.joint.parent], poses[self.joint.child]
        return pose_multiply(
            pose_inverse(pose_multiply(parent, self._parent_from_joint)), pose_multiply(child, self._child_from_joint)
        )

    def _pose_array_at(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> Array:
        coordinates = joint_coordinates(self._relative_joint_frame(poses), self._movable_axes).tolist()
        coordinates[AXIS_NAMES.index(axis)] = value
        moved = pose_from_joint_coordinates(coordinates)
        if self.moving_body == self.joint.child:
            joint = pose_multiply(poses[self.joint.parent], self._parent_from_joint)
            return pose_multiply(pose_multiply(joint, moved), pose_inverse(self._child_from_joint))
        joint = pose_multiply(poses[self.joint.child], self._child_from_joint)
        return pose_multiply(pose_multiply(joint, pose_inverse(moved)), pose_inverse(self._parent_from_joint))

    def _farthest_side(self, direction: int) -> Array:
        """The center of the side that is farthest from a hinge, in the frame of the moving body [m]."""
        joint = self._child_from_joint if self.moving_body == self.joint.child else self._parent_from_joint
        axis = quat_rotate(joint[3:], np.eye(3)[direction])
        half = np.asarray(self._size) / 2
        sides = [sign * half[side] * np.eye(3)[side] for side in range(3) for sign in (-1.0, 1.0)]
        arms = [float(np.linalg.norm(np.cross(side - joint[:3], axis))) for side in sides]
        farthest: Array = sides[int(np.argmax(arms))]
        return farthest


def _spawn_pose(spawn_record: SpawnRecord, bodies: Mapping[BodyId, Body], id: BodyId) -> Array:
    return normalized_pose_array(spawn_record.poses[id] if id in spawn_record.poses else bodies[id].pose)
