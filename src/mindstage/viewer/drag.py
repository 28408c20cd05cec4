"""Hands: what a visitor does with the mouse, told to the stage as a grip.

A mouse moves on a plane and a drawer along a line, so the pointer is taken for a ray and the place is sought where
it meets what the held thing can do: the line that a drawer slides on, the plane that a door turns in. What is loose
follows the pointer in the plane of the picture.
"""

from __future__ import annotations

from collections.abc import Hashable
from enum import StrEnum

import msgspec
import numpy as np

from mindstage.scene import AxisMotion, BodyId, Joint, Pose, Vector, World
from mindstage.scene.transforms import Array, normalize, quat_conjugate, quat_rotate
from mindstage.simulation import Simulation, StateSnapshot

__all__ = ["DragConstraint", "DragController", "DragForce", "DragMode", "drag_target"]

_MAX_LINE_COSINE = 0.95
"""Cosine above which a ray runs so much along a line that where they meet says nothing."""
_MIN_PLANE_COSINE = 0.15
"""Cosine below which a ray runs so much along a plane that where they meet says nothing."""
_MAX_DRAG_M = 3.0
"""Nobody pulls farther than that in one go; it is how far a slip near the horizon may throw the hand."""


class DragMode(StrEnum):
    """How a held thing can move."""

    FREE = "free"
    PRISMATIC = "slides"
    REVOLUTE = "turns"


class DragConstraint(msgspec.Struct, frozen=True):
    """What the joint of a thing leaves it."""

    mode: DragMode = DragMode.FREE
    axis: Vector = (0.0, 0.0, 1.0)
    """To slide along or to turn about, in the frame's body."""
    frame: BodyId | None = None
    """The body that the axis is fixed to; None for the world."""


class DragForce(msgspec.Struct, frozen=True):
    """One hand on one body."""

    id: BodyId
    point: Vector
    """Where it is held, in the body's frame [m]."""
    target: Vector
    """Where that point shall go, in the world [m]."""


class DragController:
    """All hands of all visitors; calls may come from any thread, one visitor's in their order."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._constraints: dict[BodyId, DragConstraint] = {}
        self._drag_forces: dict[Hashable, DragForce] = {}

    @property
    def drag_forces(self) -> tuple[DragForce, ...]:
        """What is held right now."""
        return tuple(self._drag_forces.values())

    def set_world(self, world: World) -> None:
        """Finds out what of a world can be pulled, and how; the poses must be those it was described with."""
        self._constraints = _drag_constraints(world)

    @property
    def draggable(self) -> frozenset[BodyId]:
        """The bodies that move when they are pulled."""
        return frozenset(self._constraints)

    def start(self, session: Hashable, id: BodyId, world_point: Vector) -> bool:
        """A visitor takes hold of a body at a point in the world [m]; False if there is nothing to hold."""
        pose = _pose_of(self._simulation.state, id)
        if pose is None or id not in self._constraints:
            return False
        point = _vector(quat_rotate(quat_conjugate(pose[3:]), np.asarray(world_point) - pose[:3]))
        self._drag_forces[session] = DragForce(id, point, world_point)
        self._simulation.pull(id, point=point, target=world_point)
        return True

    def move(self, session: Hashable, pointer: Vector, eye: Vector) -> None:
        """The visitor moves the pointer.

        Args:
            visitor: who took hold before.
            pointer: any point on the ray of the pointer; best at the distance of what is held [m].
            eye: where the ray starts [m].
        """
        pull, frame = self._drag_forces.get(session), self._simulation.state
        if pull is None:
            return
        pose = _pose_of(frame, pull.id)
        if pose is None:
            self.release(session)
            return
        freedom = self._constraints.get(pull.id, DragConstraint())
        held = pose[:3] + quat_rotate(pose[3:], pull.point)
        target = drag_target(freedom.mode, _world_axis(freedom, frame), held, np.asarray(pointer), np.asarray(eye))
        self._drag_forces[session] = msgspec.structs.replace(pull, target=target)
        self._simulation.pull(pull.id, point=pull.point, target=target)

    def release(self, session: Hashable) -> None:
        """The visitor opens the hand; nothing happens if it was empty."""
        pull = self._drag_forces.pop(session, None)
        if pull is not None and all(other.id != pull.id for other in self._drag_forces.values()):
            self._simulation.release(pull.id)

    def release_all(self) -> None:
        """Every visitor opens the hand."""
        for visitor in list(self._drag_forces):
            self.release(visitor)


def drag_target(mode: DragMode, axis: Array, held_point: Array, pointer: Array, eye: Array) -> Vector:
    """Where a hand goes that holds something, for a ray from the eye through the pointer.

    Args:
        way: what the held thing can do.
        axis: to slide along or to turn about, in the world; of length 1.
        held: the held point [m].
        pointer: a point on the ray, at about the distance of the held one [m].
        eye: where the ray starts [m].
    """
    ray = pointer - eye
    ray = ray / max(float(np.linalg.norm(ray)), 1e-9)
    along, target = float(ray @ axis), pointer
    if mode is DragMode.PRISMATIC and abs(along) < _MAX_LINE_COSINE:
        to_held = held_point - eye
        # The point of the line that is nearest to the ray.
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
    parents = {hold.child: hold.parent for hold in world.attachments}
    joints: dict[BodyId, DragConstraint] = {}
    for joint in world.joints:
        if joint.parent in bodies and joint.child in bodies:
            ends = (joint.child, joint.parent)
            # The map may have the roles upside down: it is the moving side that one pulls.
            moving, frame = ends if bodies[joint.child].physics.is_dynamic else ends[::-1]
            joints.setdefault(moving, _drag_constraint(joint, frame, bodies[frame].pose))
    found = {}
    for id, body in bodies.items():
        held: BodyId | None = id
        seen: set[BodyId] = set()
        while held is not None and held not in seen and not bodies[held].physics.is_dynamic:
            seen.add(held)
            held = parents.get(held) if parents.get(held) in bodies else None
        if held is not None and bodies[held].physics.is_dynamic:
            found[body.id] = joints.get(held, DragConstraint())
    return found


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


def _world_axis(constraint: DragConstraint, frame: StateSnapshot) -> Array:
    pose = None if constraint.frame is None else _pose_of(frame, constraint.frame)
    return np.asarray(constraint.axis) if pose is None else quat_rotate(pose[3:], constraint.axis)


def _pose_of(frame: StateSnapshot, id: BodyId) -> Array | None:
    try:
        pose: Array = frame.poses[frame.ids.index(id)].copy()
    except ValueError:
        return None
    pose[3:] = normalize(pose[3:])
    return pose


def _vector(array: Array) -> Vector:
    x, y, z = np.asarray(array).tolist()
    return x, y, z
