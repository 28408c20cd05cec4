"""Dragging bodies with the mouse: converts pointer rays to target points of spring forces on the body.

The target is where the ray is nearest to the motion that the joint of the body allows: the line of a prismatic joint,
the plane of a revolute joint. A free body follows the pointer in the plane of the screen.
"""

from __future__ import annotations

import logging
from collections.abc import Hashable
from concurrent.futures import ThreadPoolExecutor
from enum import StrEnum

import msgspec
import numpy as np

from mindstage.errors import SimulationError
from mindstage.scene import AxisMotion, BodyId, Joint, Pose, Vector, World
from mindstage.scene.transforms import Array, normalize, pose_from_array, quat_conjugate, quat_rotate
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.simulation.observation import as_client

__all__ = ["DragConstraint", "DragController", "DragForce", "DragMode", "drag_target"]

_log = logging.getLogger(__name__)
_MAX_LINE_COSINE = 0.95
"""Cosine above which ray and axis are too parallel for a nearest point."""
_MIN_PLANE_COSINE = 0.15
"""Cosine below which ray and plane are too parallel for an intersection."""
_MAX_DRAG_M = 3.0
"""Maximum distance of the target from the dragged point; rays near the horizon would give huge ones."""


class DragMode(StrEnum):
    """How a body can move."""

    FREE = "free"
    PRISMATIC = "prismatic"
    REVOLUTE = "revolute"


class DragConstraint(msgspec.Struct, frozen=True):
    """The motion that the joint of a body allows."""

    mode: DragMode = DragMode.FREE
    axis: Vector = (0.0, 0.0, 1.0)
    """The axis of the joint, in the frame of the body `frame`."""
    frame: BodyId | None = None
    """The body that the axis is fixed to; None is the world."""


class DragForce(msgspec.Struct, frozen=True):
    """The force of one client on one body."""

    id: BodyId
    point: Vector
    """The point of application, in the frame of the body [m]."""
    target: Vector
    """The target of that point, in the world frame [m]."""


class DragController:
    """The drags of all clients. May be called from any thread; calls of one client must be in order."""

    def __init__(self, simulation: Simulation) -> None:
        """Creates a controller without drags.

        Args:
            simulation: the simulation that forces are applied in.
        """
        self._simulation = simulation
        self._constraints: dict[BodyId, DragConstraint] = {}
        self._drag_forces: dict[Hashable, DragForce] = {}
        self._recorder = ThreadPoolExecutor(max_workers=1, thread_name_prefix="mindstage-drags")
        self._starts: dict[Hashable, dict[BodyId, Pose]] = {}
        """The poses of all bodies before each drag, which undoing restores."""

    @property
    def drag_forces(self) -> tuple[DragForce, ...]:
        """The current drags."""
        return tuple(self._drag_forces.values())

    def set_world(self, world: World) -> None:
        """Computes the constraint of each body. The poses must be those of the description of the world."""
        self._constraints = _drag_constraints(world)

    @property
    def draggable(self) -> frozenset[BodyId]:
        """The bodies that can be dragged."""
        return frozenset(self._constraints)

    def start(self, session: Hashable, id: BodyId, world_point: Vector) -> bool:
        """Starts a drag of a client; returns False if the body cannot be dragged.

        Args:
            session: the client.
            world_point: the point of application, in the world frame [m].
        """
        pose = _pose_of(self._simulation.state, id)
        if pose is None or id not in self._constraints:
            return False
        point = _vector(quat_rotate(quat_conjugate(pose[3:]), np.asarray(world_point) - pose[:3]))
        with as_client("viewer"):
            self._simulation.pull(id, point=point, target=world_point)
        self._drag_forces[session] = DragForce(id, point, world_point)
        state = self._simulation.state
        poses = {each: pose_from_array(row) for each, row in zip(state.ids, state.poses, strict=True)}
        self._starts[session] = {each: pose for each, pose in poses.items() if each not in self._robot_ids()}
        return True

    def move(self, session: Hashable, pointer: Vector, eye: Vector) -> None:
        """Updates the drag of a client after the pointer has moved.

        Args:
            session: the client.
            pointer: a point on the pointer ray, at about the distance of the dragged point, in the world frame [m].
            eye: the origin of the ray, in the world frame [m].
        """
        force, snapshot = self._drag_forces.get(session), self._simulation.state
        if force is None:
            return
        pose = _pose_of(snapshot, force.id)
        if pose is None:
            self.release(session)
            return
        constraint = self._constraints.get(force.id, DragConstraint())
        point, axis = pose[:3] + quat_rotate(pose[3:], force.point), _world_axis(constraint, snapshot)
        target = drag_target(constraint.mode, axis, point, np.asarray(pointer), np.asarray(eye))
        self._drag_forces[session] = msgspec.structs.replace(force, target=target)
        self._simulation.pull(force.id, point=force.point, target=target)

    def release(self, session: Hashable) -> None:
        """Ends the drag of a client, if there is one."""
        force, start = self._drag_forces.pop(session, None), self._starts.pop(session, None)
        if force is not None and all(other.id != force.id for other in self._drag_forces.values()):
            with as_client("viewer"):
                self._simulation.release(force.id)
        if force is not None and start and not self._simulation.closed:
            held = {other.id for other in self._drag_forces.values()}
            before = {id: pose for id, pose in start.items() if id not in held}
            # The engine may be busy, and this is the event loop of the viewer.
            self._recorder.submit(self._record, before, f"{force.id} dragged")

    def _record(self, before: dict[BodyId, Pose], label: str) -> None:
        try:
            self._simulation.edits.record_motion(before, label=label)
        except SimulationError as error:
            _log.warning("%s: it cannot be undone: %s", label, error)

    def _robot_ids(self) -> set[BodyId]:
        """The bodies of robots, whose motions are not those of a drag."""
        return {id for robot in self._simulation.robots.values() for id in robot.body_ids}

    def release_all(self) -> None:
        """Ends all drags."""
        for session in list(self._drag_forces):
            self.release(session)


def drag_target(mode: DragMode, axis: Array, held_point: Array, pointer: Array, eye: Array) -> Vector:
    """Computes the target of a dragged point for the ray from the eye through the pointer, all in the world frame.

    Args:
        mode: how the body can move.
        axis: unit vector of the axis of the joint.
        held_point: the dragged point [m].
        pointer: a point on the ray, at about the distance of the dragged point [m].
        eye: the origin of the ray [m].
    """
    ray = pointer - eye
    ray = ray / max(float(np.linalg.norm(ray)), 1e-9)
    along, target = float(ray @ axis), pointer
    if mode is DragMode.PRISMATIC and abs(along) < _MAX_LINE_COSINE:
        to_held = held_point - eye
        # The point of the axis line that is nearest to the ray.
        travel = (along * float(ray @ to_held) - float(axis @ to_held)) / (1.0 - along * along)
        target = held_point + travel * axis
    elif mode is DragMode.REVOLUTE and abs(along) > _MIN_PLANE_COSINE:
        distance = float((held_point - eye) @ axis) / along
        target = eye + distance * ray if distance > 0.0 else pointer
    step = target - held_point
    length = float(np.linalg.norm(step))
    return _vector(held_point + step * min(1.0, _MAX_DRAG_M / max(length, 1e-9)))


def _drag_constraints(world: World) -> dict[BodyId, DragConstraint]:
    bodies = {body.id: body for body in world.bodies}
    parents = {link.child: link.parent for link in world.attachments}
    joints: dict[BodyId, DragConstraint] = {}
    for joint in world.joints:
        if joint.parent in bodies and joint.child in bodies:
            ends = (joint.child, joint.parent)
            # Parent and child may be swapped in the map; the dynamic end is dragged.
            moving, frame = ends if bodies[joint.child].physics.is_dynamic else ends[::-1]
            joints.setdefault(moving, _drag_constraint(joint, frame, bodies[frame].pose))
    constraints = {}
    for id, body in bodies.items():
        top: BodyId | None = id
        seen: set[BodyId] = set()
        while top is not None and top not in seen and not bodies[top].physics.is_dynamic:
            seen.add(top)
            top = parents.get(top) if parents.get(top) in bodies else None
        if top is not None and bodies[top].physics.is_dynamic:
            constraints[body.id] = joints.get(top, DragConstraint())
    return constraints


def _drag_constraint(joint: Joint, frame: BodyId, frame_pose: Pose) -> DragConstraint:
    linear, angular = joint.linear, joint.angular
    slides = [axis for axis, motion in enumerate((linear.x, linear.y, linear.z)) if motion is not AxisMotion.LOCKED]
    turns = [
        axis
        for axis, motion in enumerate((angular.twist, angular.swing2, angular.swing1))
        if motion is not AxisMotion.LOCKED
    ]
    if len(slides) + len(turns) != 1:
        return DragConstraint()
    in_joint = np.eye(3)[(slides or turns)[0]]
    in_world = quat_rotate(normalize(joint.pose.quaternion), in_joint)
    in_frame = quat_rotate(quat_conjugate(normalize(frame_pose.quaternion)), in_world)
    return DragConstraint(DragMode.PRISMATIC if slides else DragMode.REVOLUTE, _vector(in_frame), frame)


def _world_axis(constraint: DragConstraint, snapshot: StateSnapshot) -> Array:
    pose = None if constraint.frame is None else _pose_of(snapshot, constraint.frame)
    return np.asarray(constraint.axis) if pose is None else quat_rotate(pose[3:], constraint.axis)


def _pose_of(snapshot: StateSnapshot, id: BodyId) -> Array | None:
    try:
        pose: Array = snapshot.poses[snapshot.ids.index(id)].copy()
    except ValueError:
        return None
    pose[3:] = normalize(pose[3:])
    return pose


def _vector(array: Array) -> Vector:
    x, y, z = np.asarray(array).tolist()
    return x, y, z
