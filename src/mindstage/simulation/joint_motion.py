"""Opening, closing and moving one joint of a running simulation, as a hand would: by a pull, with a deadline.

door = sim.joint("fridge_door")
if not door.open():
print(f"something is in the way at {door.openness:.0%}")
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TypeVar

import msgspec
import numpy as np

from mindstage.engines.base import Capability
from mindstage.errors import AmbiguousNameError, BodyNotFoundError, InvalidArgumentError, NameNotFoundError
from mindstage.scene import BodyId, World
from mindstage.scene.transforms import Array, normalized_pose_array, pose_inverse, pose_multiply
from mindstage.simulation.interaction import JointAxisState, JointHandle
from mindstage.simulation.state import EngineSession, poses_in
from mindstage.simulation.undo import SpawnRecord

__all__ = ["JointMotion", "SimulationJoint", "find_joint"]

T = TypeVar("T")

_PIECE_S = 0.05
"""The pull is aimed anew after as much simulated time [s]."""
_RAMP_S = 1.5
"""A whole range is gone through in this time at least, as a person opens a door [s]."""
_RESTS = 4
"""So many pieces in a row the joint has to be where it shall be, and almost still."""
_GAIN = 0.15
"""Share of the remaining error by which the pull is aimed farther after each piece: friction holds a joint short."""
_TOLERANCES = {True: 0.01, False: 0.02}
"""Of a slide [m] and of a hinge [rad]."""
_LEAST = 1e-6
"""A smaller range is none [m or rad]."""


class JointMotion(msgspec.Struct, frozen=True, kw_only=True):
    """The result of moving a joint; true if it arrived."""

    arrived: bool
    """Whether it came within the tolerance of the target, and rests."""
    position: float
    """Where it is [m or rad]."""
    target: float
    """Where it was to go [m or rad]."""
    duration_s: float
    """Simulated time that passed [s]; 0 where the engine has no physics and the body was put there."""

    def __bool__(self) -> bool:
        return self.arrived


class SimulationJoint:
    """A joint of a simulation: where it is, how far it is open, and the means to move it.

    Of several axes it is the first that can move, slides before hinges. Positions count from where the map has the
    joint, which is closed, in meters for a slide and in radians for a hinge.
    """

    def __init__(self, simulation: EngineSession, joint: JointHandle, world: World) -> None:
        """See `find_joint`.

        Args:
            simulation: in which the joint is.
            joint: its kinematics; it has an axis that can move.
            world: the simulation's world now.
        """
        self._simulation = simulation
        self._joint = joint
        self._axis: JointAxisState = joint.axes[0]
        self._simulates = world.body(joint.moving_body).physics.is_dynamic
        self._held = [
            BodyId(joint.moving_body),
            *(hold.child for hold in world.attachments if hold.parent == joint.moving_body),
        ]
        self._zero = self._zero_offset()

    @property
    def id(self) -> BodyId:
        """The id of the joint itself."""
        return self._joint.joint.id

    @property
    def body(self) -> BodyId:
        """The id of the body that it moves, such as a door."""
        return self._joint.moving_body

    @property
    def slides(self) -> bool:
        """Whether positions are meters, as a drawer's; else they are radians."""
        return self._axis.is_prismatic

    @property
    def position(self) -> float:
        """Where it is now, from where the map has it [m or rad].

        Raises:
            BodyNotFoundError: one of its bodies was deleted.
        """
        return self._joint.positions(self._poses())[self._axis.name] + self._zero

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and highest position [m or rad]; infinite where the map sets no limit."""
        low = -math.inf if self._axis.lower is None else self._axis.lower
        high = math.inf if self._axis.upper is None else self._axis.upper
        return low, high

    @property
    def open_position(self) -> float:
        """The end of the range that is away from what the joint hangs on, where `open` goes [m or rad].

        Raises:
            InvalidArgumentError: the range has no end.
        """
        low, high = self.range
        ends = [end for end in (low, high) if math.isfinite(end) and abs(end - self.closed_position) > _LEAST]
        if not ends:
            raise InvalidArgumentError(self.id, cause="its range has no end", remedy="use move_to")
        return max(ends, key=lambda end: (round(self._distance_at(end), 6), abs(end), end))

    @property
    def closed_position(self) -> float:
        """Where `close` goes: where the map has it, or the end of the range that is nearest to that [m or rad]."""
        low, high = self.range
        return min(max(0.0, low), high)

    @property
    def openness(self) -> float:
        """How far it is open, from 0 (closed) to 1.

        Raises:
            InvalidArgumentError: the range has no end.
        """
        low, high = self.range
        gone = self.position - self.closed_position
        whole = (high if gone > 0.0 else low) - self.closed_position
        if not math.isfinite(whole) or abs(whole) <= _LEAST:
            whole = self.open_position - self.closed_position
        return min(1.0, abs(gone / whole))

    def open(self, fraction: float = 1.0, *, timeout_s: float = 10.0) -> JointMotion:
        """Opens it, wholly or up to a fraction of its range.

        Args:
            fraction: from 0 (closed) to 1.
            timeout_s: see `move_to`.

        Raises:
            InvalidArgumentError: there is no such fraction, or the range has no end.
        """
        if not 0.0 <= fraction <= 1.0:
            raise InvalidArgumentError(self.id, cause=f"it cannot be open by {fraction}", remedy="give 0 to 1")
        closed = self.closed_position
        return self.move_to(closed + fraction * (self.open_position - closed), timeout_s=timeout_s)

    def close(self, *, timeout_s: float = 10.0) -> JointMotion:
        """Closes it: moves it to where the map has it."""
        return self.move_to(self.closed_position, timeout_s=timeout_s)

    def move_to(self, position: float, *, timeout_s: float = 10.0, tolerance: float | None = None) -> JointMotion:
        """Moves it to a position and returns when it rests there, or when the time is up.

        In an engine with joint physics the body is pulled with the force of an arm while simulated time passes, so that
        an obstacle stops it. An engine without, and a body that does not simulate, is put there at once.

        Args:
            position: within `range` [m or rad].
            timeout_s: simulated time [s].
            tolerance: how near is there [m or rad]; by default 1 cm or 0.02 rad (1.1 degrees).

        Raises:
            InvalidArgumentError: the position is out of range.
            BodyNotFoundError: one of the joint's bodies was deleted.
            PoseUnreachableError: the body cannot be put there.
        """
        low, high = self.range
        if not low - _LEAST <= position <= high + _LEAST:
            cause = f"{position:g} is out of its range"
            raise InvalidArgumentError(self.id, cause=cause, remedy=f"give {low:g} to {high:g} {self._unit}")
        near = _TOLERANCES[self.slides] if tolerance is None else tolerance
        if Capability.JOINTS in self._simulation.capabilities and self._simulates:
            duration_s = self._pull(position, timeout_s, near)
        else:
            pose = self._joint.pose_for(self._axis.name, position - self._zero, self._poses())
            self._simulation.run_on_engine(
                lambda engine: engine.set_pose(self.body, pose), label="move joint", edits=True
            )
            duration_s = 0.0
        now = self.position
        return JointMotion(arrived=abs(now - position) <= near, position=now, target=position, duration_s=duration_s)

    def __repr__(self) -> str:
        low, high = self.range
        at = f"{self.position:.3f} {self._unit} in [{low:.3f}, {high:.3f}]"
        return f"<{type(self).__name__} {self.id} of {self.body}: {at}>"

    @property
    def _unit(self) -> str:
        return "m" if self.slides else "rad"

    def _pull(self, target: float, timeout_s: float, near: float) -> float:
        """Pulls until the joint rests near the target, or the time is up; gives how long that took [s]."""
        start = before = self.position
        low, high = self.range
        whole = high - low if math.isfinite(high - low) else abs(target - start)
        speed = max(whole, abs(target - start), _LEAST) / _RAMP_S
        passed_s, extra, rests = 0.0, 0.0, 0
        try:
            while passed_s < timeout_s and rests < _RESTS:
                passed_s += _PIECE_S
                way = target - start
                aim = start + math.copysign(min(abs(way), speed * passed_s), way)
                if aim == target:
                    extra += _GAIN * (target - before)
                    extra = max(-whole, min(whole, extra))
                hold = self._joint.pull_target(self._axis.name, aim + extra - self._zero, self._poses())
                self._simulation.pull(hold.id, point=hold.point, target=hold.target)
                self._simulation.step(_PIECE_S)
                now = self.position
                is_there = abs(now - target) <= near and abs(now - before) <= near * _PIECE_S * 4
                rests, before = rests + 1 if is_there else 0, now
        finally:
            self._simulation.release(self.body)
        return passed_s

    def _poses(self) -> Mapping[BodyId, Array]:
        constraint = self._joint.joint
        frame = self._simulation.state
        poses = poses_in(frame, {constraint.parent, constraint.child})
        for id in (constraint.parent, constraint.child):
            if id not in poses:
                raise BodyNotFoundError(id, known=frame.ids)
        return poses

    def _distance_at(self, position: float) -> float:
        """How far the moving body, or its handle, is from the middle of the other body at a position [m]."""
        constraint, poses = self._joint.joint, self._poses()
        other = constraint.parent if self.body == constraint.child else constraint.child
        there = normalized_pose_array(self._joint.pose_for(self._axis.name, position - self._zero, poses))
        now = poses_in(self._simulation.state, set(self._held))
        held = now.get(self._held[-1], poses[self.body])
        moved = pose_multiply(there, pose_multiply(pose_inverse(poses[self.body]), held))
        return float(np.linalg.norm(moved[:3] - poses[other][:3]))

    def _zero_offset(self) -> float:
        """What to add where the joint was not spawned from here: its engine counts from somewhere else."""
        name = self._axis.name
        known = {joint.id for world in self._simulation.worlds for joint in world.joints}
        if self.id in known or Capability.JOINTS not in self._simulation.capabilities:
            return 0.0
        told = self._simulation.run_on_engine(lambda engine: engine.joint_positions(), label="joint positions").get(
            self.id
        )
        if told is None:
            return 0.0
        axes = ("x", "y", "z", "twist", "swing2", "swing1")
        return told[axes.index(name)] - self._joint.positions(self._poses())[name]


def find_joint(simulation: EngineSession, name: str) -> SimulationJoint:
    """The joint of that id or IRI, or the only one that moves the body of that id or IRI.

    Raises:
        NameNotFoundError: nothing movable has that name.
        AmbiguousNameError: several joints move that body.
    """
    world, spawned = simulation.snapshot(), SpawnRecord.from_worlds(simulation.worlds)
    bodies = {body.id: body for body in world.bodies}

    def movable() -> Iterator[JointHandle]:
        for constraint in world.joints:
            if constraint.parent in bodies and constraint.child in bodies:
                joint = JointHandle(constraint, bodies, spawned)
                if joint.axes:
                    yield joint

    joints = list(movable())
    found = [joint for joint in joints if name in {joint.joint.id, joint.joint.iri}]
    found = found or [joint for joint in joints if name in {joint.moving_body, bodies[joint.moving_body].iri}]
    if len(found) > 1:
        raise AmbiguousNameError(name, entity_type="joint", candidates=[joint.joint.id for joint in found])
    if not found:
        known = [id for joint in joints for id in (joint.joint.id, joint.moving_body)]
        raise NameNotFoundError(name, entity_type="joint, door or drawer", known=known)
    return SimulationJoint(simulation, found[0], world)
