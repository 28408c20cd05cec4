"""Joints: how far the joints of a running world are open, seen from where its bodies are, and what opens them farther.

It takes nothing but the poses of a frame, so looking at a joint costs the engine nothing.

Grip: a spring between a point on a body and a point in the air, as a hand or a mouse pulls.

The force is what a person would use on furniture, so a door opens and a wall does not. Spring and damper follow the
mass that is pulled: one that suits a fridge door would shake a teaspoon to pieces.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from mindstage.engines.base import Engine, PoseArray
from mindstage.engines.kinematic_tree import AXIS_NAMES, joint_coordinates, movable_axes, pose_from_joint_coordinates
from mindstage.scene import Body, BodyId, Joint, Pose, Vector, World
from mindstage.scene.kinematics import axis_ranges
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_rotate,
)
from mindstage.simulation.undo import SpawnRecord

__all__ = ["JointAxisState", "JointHandle", "Perturbations", "PullTarget", "SpringPerturbation"]


_SUBSTEP_S = 0.004
"""The force is computed anew this often [s]; spring and damper below are stable at this pace."""
_MAX_STIFFNESS = 400.0  # [N/m]
_STIFFNESS_PER_KG = 1500.0  # [N/(m kg)], by which gravity makes a held thing sag 7 mm


@dataclass(slots=True, kw_only=True)
class SpringPerturbation:
    """One hold on one body."""

    id: BodyId
    point: Vector
    """Where it is held, in the body's own frame [m]."""
    target: Vector
    """Where that point shall go, in the world [m]."""
    mass_kg: float = 1.0
    """Of what is pulled."""
    max_force: float = 150.0
    """[N]: about what one arm can pull."""
    _previous_position: Array | None = None

    def force(self, pose: PoseArray, duration_s: float) -> tuple[Vector, Vector]:
        """The force [N] and where it acts [m], both in the world.

        Args:
            pose: the body's present pose, seven numbers.
            duration_s: time since the last call, to know the point's speed.
        """
        held = pose[:3] + quat_rotate(normalize(pose[3:]), np.asarray(self.point))
        velocity = (
            np.zeros(3) if self._previous_position is None else (held - self._previous_position) / max(duration_s, 1e-6)
        )
        self._previous_position = held
        stiffness = min(_MAX_STIFFNESS, _STIFFNESS_PER_KG * self.mass_kg)
        damping = 1.4 * (stiffness * self.mass_kg) ** 0.5
        force = stiffness * (np.asarray(self.target) - held) - damping * velocity
        size = float(np.linalg.norm(force))
        if size > self.max_force:
            force *= self.max_force / size
        return _vector(force), _vector(held)


class Perturbations(dict[BodyId, SpringPerturbation]):
    """All holds, by body."""

    def pull(self, id: BodyId, *, point: Vector, target: Vector, worlds: Iterable[World]) -> None:
        """Takes hold of a body, or moves the hand that holds it there already."""
        held = self.get(id)
        if held is None or held.point != point:
            self[id] = SpringPerturbation(id=id, point=point, target=target, mass_kg=_effective_mass(id, worlds))
        else:
            held.target = target

    def release(self, id: BodyId | None = None) -> None:
        """Lets go of one body, or of all."""
        if id is None:
            self.clear()
        else:
            self.pop(id, None)

    def step(self, engine: Engine, duration_s: float) -> None:
        """Lets time pass [s], and pulls meanwhile."""
        left_s = duration_s
        while self and left_s > _SUBSTEP_S:
            self._apply_forces(engine, _SUBSTEP_S)
            engine.step(_SUBSTEP_S)
            left_s -= _SUBSTEP_S
        engine.step(left_s)

    def _apply_forces(self, engine: Engine, duration_s: float) -> None:
        ids, poses = engine.poses()
        rows = {id: row for row, id in enumerate(ids) if id in self}
        for id, grip in list(self.items()):
            if id in rows:
                engine.apply_force(id, *grip.force(poses[rows[id]], duration_s))


def _effective_mass(id: BodyId, worlds: Iterable[World]) -> float:
    """What one pulls when one pulls that body: its own mass and that of all it hangs on [kg]."""
    masses: dict[BodyId, float] = {}
    parents: dict[BodyId, BodyId] = {}
    for world in worlds:
        masses |= {body.id: body.physics.mass_kg or 0.0 for body in world.bodies}
        parents |= {hold.child: hold.parent for hold in world.attachments}
    mass, above = 0.0, set[BodyId]()
    while id in masses and id not in above:
        mass += masses[id]
        above.add(id)
        id = parents.get(id, BodyId(""))
    return mass or 1.0


def _vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


class JointAxisState(msgspec.Struct, frozen=True, kw_only=True):
    """One axis of a joint that can move."""

    name: str
    """x, y, z, twist, swing2 or swing1."""
    is_prismatic: bool
    """Whether its numbers are meters; else they are radians."""
    lower: float | None
    """How far it goes either way; None without a limit."""
    upper: float | None


class PullTarget(msgspec.Struct, frozen=True):
    """Where to take hold, and where to pull to."""

    id: BodyId
    point: Vector
    """In the body's frame [m]."""
    target: Vector
    """In the world [m]."""


class JointHandle:
    """A constraint between two bodies that are there."""

    def __init__(self, joint: Joint, bodies: Mapping[BodyId, Body], spawn_record: SpawnRecord) -> None:
        """Looks at it.

        Args:
            constraint: as the engine describes it now.
            bodies: both ends are among them.
            spawned: what was given, from where it counts.
        """
        parent, child = joint.parent, joint.child
        given = spawn_record.joints.get(joint.id, joint)
        frame = normalized_pose_array(given.pose)
        self.joint = joint
        self.moving_body = (
            child if bodies[child].physics.is_dynamic or not bodies[parent].physics.is_dynamic else parent
        )
        """The end that one pulls: the map may have the roles upside down."""
        self._movable_axes = movable_axes(joint)
        self._size = bodies[self.moving_body].size or (0.0, 0.0, 0.0)
        self._parent_from_joint = pose_multiply(pose_inverse(_spawn_pose(spawn_record, bodies, parent)), frame)
        self._child_from_joint = pose_multiply(pose_inverse(_spawn_pose(spawn_record, bodies, child)), frame)

    @property
    def axes(self) -> tuple[JointAxisState, ...]:
        """What can move, slides first."""
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
        """How far it is on each axis that can move, from where it was spawned [m or rad].

        Args:
            poses: where both ends are, seven numbers with a unit quaternion.
        """
        places = joint_coordinates(self._relative_joint_frame(poses), self._movable_axes)
        return {AXIS_NAMES[axis.index]: float(places[axis.index]) for axis in self._movable_axes}

    def pose_for(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> Pose:
        """Where the moving end is when one axis is there, and the others are as they are."""
        return pose_from_array(self._pose_array_at(axis, value, poses))

    def pull_target(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> PullTarget:
        """How to pull the moving end so that one axis goes there: far from a hinge, in the middle of a slide."""
        there = self._pose_array_at(axis, value, poses)
        point = np.zeros(3) if AXIS_NAMES.index(axis) < 3 else self._farthest_side(AXIS_NAMES.index(axis) % 3)
        return PullTarget(self.moving_body, _vector(point), _vector(there[:3] + quat_rotate(there[3:], point)))

    def _relative_joint_frame(self, poses: Mapping[BodyId, Array]) -> Array:
        """The child's joint frame seen from the parent's."""
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
        """The middle of the side that is farthest from a hinge, in the moving end's frame."""
        joint = self._child_from_joint if self.moving_body == self.joint.child else self._parent_from_joint
        axis = quat_rotate(joint[3:], np.eye(3)[direction])
        half = np.asarray(self._size) / 2
        sides = [sign * half[side] * np.eye(3)[side] for side in range(3) for sign in (-1.0, 1.0)]
        arms = [float(np.linalg.norm(np.cross(side - joint[:3], axis))) for side in sides]
        farthest: Array = sides[int(np.argmax(arms))]
        return farthest


def _spawn_pose(spawn_record: SpawnRecord, bodies: Mapping[BodyId, Body], id: BodyId) -> Array:
    return normalized_pose_array(spawn_record.poses[id] if id in spawn_record.poses else bodies[id].pose)
