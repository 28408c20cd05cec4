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

from mindstage.stage import Frame, Stage
from mindstage.world import BodyId, Constraint, Motion, Pose, Vector, World
from mindstage.world.geometry import Array, conjugate, rotate, unit

__all__ = ["Freedom", "Hands", "Pull", "Way", "reach"]

_STEEPEST = 0.95
"""Cosine above which a ray runs so much along a line that where they meet says nothing."""
_FLATTEST = 0.15
"""Cosine below which a ray runs so much along a plane that where they meet says nothing."""
_FARTHEST_M = 3.0
"""Nobody pulls farther than that in one go; it is how far a slip near the horizon may throw the hand."""


class Way(StrEnum):
    """How a held thing can move."""

    FREE = "free"
    SLIDES = "slides"
    TURNS = "turns"


class Freedom(msgspec.Struct, frozen=True):
    """What the joint of a thing leaves it."""

    way: Way = Way.FREE
    axis: Vector = (0.0, 0.0, 1.0)
    """To slide along or to turn about, in the frame's body."""
    frame: BodyId | None = None
    """The body that the axis is fixed to; None for the world."""


class Pull(msgspec.Struct, frozen=True):
    """One hand on one body."""

    id: BodyId
    point: Vector
    """Where it is held, in the body's frame [m]."""
    target: Vector
    """Where that point shall go, in the world [m]."""


class Hands:
    """All hands of all visitors; calls may come from any thread, one visitor's in their order."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._freedoms: dict[BodyId, Freedom] = {}
        self._pulls: dict[Hashable, Pull] = {}

    @property
    def pulls(self) -> tuple[Pull, ...]:
        """What is held right now."""
        return tuple(self._pulls.values())

    def learn(self, world: World) -> None:
        """Finds out what of a world can be pulled, and how; the poses must be those it was described with."""
        self._freedoms = _freedoms(world)

    @property
    def holdable(self) -> frozenset[BodyId]:
        """The bodies that move when they are pulled."""
        return frozenset(self._freedoms)

    def take(self, visitor: Hashable, id: BodyId, at: Vector) -> bool:
        """A visitor takes hold of a body at a point in the world [m]; False if there is nothing to hold."""
        pose = _pose_of(self._stage.frame, id)
        if pose is None or id not in self._freedoms:
            return False
        point = _vector(rotate(conjugate(pose[3:]), np.asarray(at) - pose[:3]))
        self._pulls[visitor] = Pull(id, point, at)
        self._stage.grip(id, point=point, target=at)
        return True

    def pull(self, visitor: Hashable, pointer: Vector, eye: Vector) -> None:
        """The visitor moves the pointer.

        Args:
            visitor: who took hold before.
            pointer: any point on the ray of the pointer; best at the distance of what is held [m].
            eye: where the ray starts [m].
        """
        pull, frame = self._pulls.get(visitor), self._stage.frame
        if pull is None:
            return
        pose = _pose_of(frame, pull.id)
        if pose is None:
            self.let_go(visitor)
            return
        freedom = self._freedoms.get(pull.id, Freedom())
        held = pose[:3] + rotate(pose[3:], pull.point)
        target = reach(freedom.way, _axis_now(freedom, frame), held, np.asarray(pointer), np.asarray(eye))
        self._pulls[visitor] = msgspec.structs.replace(pull, target=target)
        self._stage.grip(pull.id, point=pull.point, target=target)

    def let_go(self, visitor: Hashable) -> None:
        """The visitor opens the hand; nothing happens if it was empty."""
        pull = self._pulls.pop(visitor, None)
        if pull is not None and all(other.id != pull.id for other in self._pulls.values()):
            self._stage.release(pull.id)

    def let_go_of_all(self) -> None:
        """Every visitor opens the hand."""
        for visitor in list(self._pulls):
            self.let_go(visitor)


def reach(way: Way, axis: Array, held: Array, pointer: Array, eye: Array) -> Vector:
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
    if way is Way.SLIDES and abs(along) < _STEEPEST:
        to_held = held - eye
        # The point of the line that is nearest to the ray.
        travel = (along * float(ray @ to_held) - float(axis @ to_held)) / (1.0 - along * along)
        target = held + travel * axis
    elif way is Way.TURNS and abs(along) > _FLATTEST:
        distance = float((held - eye) @ axis) / along
        target = eye + distance * ray if distance > 0.0 else pointer
    step = target - held
    length = float(np.linalg.norm(step))
    return _vector(held + step * min(1.0, _FARTHEST_M / max(length, 1e-9)))


def _freedoms(world: World) -> dict[BodyId, Freedom]:
    bodies = {body.id: body for body in world.bodies}
    parents = {hold.child: hold.parent for hold in world.attachments}
    joints: dict[BodyId, Freedom] = {}
    for joint in world.constraints:
        if joint.parent in bodies and joint.child in bodies:
            ends = (joint.child, joint.parent)
            # The map may have the roles upside down: it is the moving side that one pulls.
            moving, frame = ends if bodies[joint.child].physics.simulates else ends[::-1]
            joints.setdefault(moving, _freedom(joint, frame, bodies[frame].pose))
    found = {}
    for id, body in bodies.items():
        held: BodyId | None = id
        seen: set[BodyId] = set()
        while held is not None and held not in seen and not bodies[held].physics.simulates:
            seen.add(held)
            held = parents.get(held) if parents.get(held) in bodies else None
        if held is not None and bodies[held].physics.simulates:
            found[body.id] = joints.get(held, Freedom())
    return found


def _freedom(joint: Constraint, frame: BodyId, frame_pose: Pose) -> Freedom:
    linear, angular = joint.linear, joint.angular
    slides = [axis for axis, motion in enumerate((linear.x, linear.y, linear.z)) if motion is not Motion.LOCKED]
    turns = [
        axis
        for axis, motion in enumerate((angular.twist, angular.swing2, angular.swing1))
        if motion is not Motion.LOCKED
    ]
    if len(slides) + len(turns) != 1:
        return Freedom()
    in_joint = np.eye(3)[(slides or turns)[0]]
    in_world = rotate(unit(joint.pose.quaternion), in_joint)
    in_frame = rotate(conjugate(unit(frame_pose.quaternion)), in_world)
    return Freedom(Way.SLIDES if slides else Way.TURNS, _vector(in_frame), frame)


def _axis_now(freedom: Freedom, frame: Frame) -> Array:
    pose = None if freedom.frame is None else _pose_of(frame, freedom.frame)
    return np.asarray(freedom.axis) if pose is None else rotate(pose[3:], freedom.axis)


def _pose_of(frame: Frame, id: BodyId) -> Array | None:
    try:
        pose: Array = frame.poses[frame.ids.index(id)].copy()
    except ValueError:
        return None
    pose[3:] = unit(pose[3:])
    return pose


def _vector(array: Array) -> Vector:
    x, y, z = np.asarray(array).tolist()
    return x, y, z
