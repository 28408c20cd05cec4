"""Opens, closes and moves one joint of a running simulation by pulling its body, with a timeout.

door = sim.joint("fridge_door")
if not door.open():
print(f"blocked at {door.openness:.0%}")
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import TypeVar

import msgspec
import numpy as np

from mindstage.access.limits import MotionTimeout
from mindstage.engines.base import Capability
from mindstage.engines.kinematic_tree import AXIS_NAMES
from mindstage.errors import AmbiguousNameError, BodyNotFoundError, InvalidArgumentError, NameNotFoundError
from mindstage.ranges import Finite, Fraction, NotNegative, checked
from mindstage.scene import BodyId, Pose, World
from mindstage.scene.edits import SetPoses
from mindstage.scene.placement import PlacementSampler
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_inverse, pose_multiply
from mindstage.simulation.body_groups import find_dependents
from mindstage.simulation.interaction import JointAxisState, JointHandle, SpawnRecord
from mindstage.simulation.placement import enclosing_body_ids
from mindstage.simulation.state import EngineSession, poses_in

__all__ = ["JointClearance", "JointMotion", "SimulationJoint", "find_joint"]

T = TypeVar("T")

_CONTROL_STEP_S = 0.05
"""Interval at which the target of the pull is updated, in simulated time [s]."""
_RAMP_S = 1.5
"""Duration of the target's motion through the whole range [s]."""
_REST_STEPS = 4
"""Number of consecutive control steps for which the joint must be at the target, almost at rest."""
_INTEGRAL_GAIN = 0.15
"""Share of the remaining error that is added to the target in each control step, against friction."""
_TOLERANCES = {True: 0.01, False: 0.02}
"""Default tolerance of a prismatic [m] and of a revolute joint [rad]."""
_MIN_RANGE = 1e-6
"""A smaller range counts as empty [m or rad]."""


class JointMotion(msgspec.Struct, frozen=True, kw_only=True):
    """The result of moving a joint; truthy if it arrived."""

    arrived: bool
    """Whether the position is within the tolerance of the target."""
    position: float
    """The final position [m or rad]."""
    target: float
    """The requested position [m or rad]."""
    duration_s: float
    """Simulated time of the motion [s]; 0 if the pose of the body was set."""

    def __bool__(self) -> bool:
        return self.arrived


class SimulationJoint:
    """A joint of a simulation: its position, range and openness, and methods to move it.

    Of several axes it is the first one that is not locked, prismatic before revolute. Positions are in meters for a
    prismatic and in radians for a revolute axis; zero is the position in the map, which counts as closed. A joint that
    mimics another one is moved by moving that one.
    """

    def __init__(
        self,
        simulation: EngineSession,
        joint: JointHandle,
        world: World,
        *,
        master: SimulationJoint | None = None,
        on_pull: Callable[[BodyId, float], object] | None = None,
    ) -> None:
        """See `find_joint`.

        Args:
            simulation: the simulation of the joint.
            joint: its kinematics, with at least one axis that is not locked.
            world: a current snapshot of the simulation.
            master: the joint that it mimics, if any.
            on_pull: called with the id and the target [m or rad] when it is pulled.
        """
        self._on_pull = on_pull
        self._master = master
        self._simulation = simulation
        self._joint = joint
        self._axis: JointAxisState = joint.axes[0]
        self._simulates = world.body(joint.moving_body).physics.is_dynamic
        self._attached_ids = [
            BodyId(joint.moving_body),
            *(attachment.child for attachment in world.attachments if attachment.parent == joint.moving_body),
        ]
        self._zero = self._zero_offset()

    @property
    def id(self) -> BodyId:
        """The id of the joint."""
        return self._joint.joint.id

    @property
    def body(self) -> BodyId:
        """The id of the body that the joint moves, such as a door."""
        return self._joint.moving_body

    @property
    def is_prismatic(self) -> bool:
        """Whether positions are in meters, as of a drawer; otherwise in radians."""
        return self._axis.is_prismatic

    @property
    def position(self) -> float:
        """The current position, relative to the map [m or rad].

        Raises:
            BodyNotFoundError: one of its bodies was deleted.
        """
        return self._joint.positions(self._poses())[self._axis.name] + self._zero

    @checked
    def pose_at(self, position: Finite) -> Pose:
        """The pose of `body` at a position [m or rad]."""
        return self._joint.pose_for(self._axis.name, position - self._zero, self._poses())

    @property
    def range(self) -> tuple[float, float]:
        """The lower and upper limit [m or rad]; infinite where the map sets none."""
        low = -math.inf if self._axis.lower is None else self._axis.lower
        high = math.inf if self._axis.upper is None else self._axis.upper
        return low, high

    @property
    def open_position(self) -> float:
        """The limit at which the body is farthest from the other body, where `open` moves it [m or rad].

        Raises:
            InvalidArgumentError: the joint has no limits.
        """
        low, high = self.range
        ends = [end for end in (low, high) if math.isfinite(end) and abs(end - self.closed_position) > _MIN_RANGE]
        if not ends:
            raise InvalidArgumentError(self.id, cause="it has no limits", remedy="use move_to")
        return max(ends, key=lambda end: (round(self._distance_at(end), 6), abs(end), end))

    @property
    def closed_position(self) -> float:
        """The position in the map, or the limit nearest to it, where `close` moves it [m or rad]."""
        low, high = self.range
        return min(max(0.0, low), high)

    @property
    def openness(self) -> float:
        """The fraction by which it is open, from 0 (closed) to 1.

        Raises:
            InvalidArgumentError: the joint has no limits.
        """
        low, high = self.range
        offset = self.position - self.closed_position
        whole = (high if offset > 0.0 else low) - self.closed_position
        if not math.isfinite(whole) or abs(whole) <= _MIN_RANGE:
            whole = self.open_position - self.closed_position
        return min(1.0, abs(offset / whole))

    @checked
    def position_at(self, fraction: Fraction) -> float:
        """The position in which it is open by a fraction, from 0 (closed) to 1 [m or rad].

        Raises:
            InvalidArgumentError: the fraction is out of range, or the joint has no limits.
        """
        closed = self.closed_position
        return closed + fraction * (self.open_position - closed)

    @checked
    def open(self, fraction: Fraction = 1.0, *, timeout_s: MotionTimeout = 10.0) -> JointMotion:
        """Opens it, fully or to a fraction of its range.

        Args:
            fraction: from 0 (closed) to 1.
            timeout_s: see `move_to`.

        Raises:
            InvalidArgumentError: the fraction is out of range, or the joint has no limits.
        """
        return self.move_to(self.position_at(fraction), timeout_s=timeout_s)

    @checked
    def close(self, *, timeout_s: MotionTimeout = 10.0) -> JointMotion:
        """Moves it to `closed_position`; see `move_to`."""
        return self.move_to(self.closed_position, timeout_s=timeout_s)

    @checked
    def move_to(
        self, position: Finite, *, timeout_s: MotionTimeout = 10.0, tolerance: NotNegative | None = None
    ) -> JointMotion:
        """Moves it to a position; returns when it is at rest there, or after the timeout.

        In an engine that simulates joints, a dynamic body is pulled with the force of an arm while simulated time
        advances, so that an obstacle stops it. Otherwise the pose of the body is set.

        Args:
            position: within `range` [m or rad].
            timeout_s: limit of the simulated time [s].
            tolerance: permitted error [m or rad]; by default 0.01 m or 0.02 rad (1.1 degrees).

        Raises:
            InvalidArgumentError: the position is out of range.
            BodyNotFoundError: one of the joint's bodies was deleted.
            PoseUnreachableError: the body cannot take that pose.
        """
        motion = self.moving_to(position, timeout_s=timeout_s, tolerance=tolerance)
        while True:
            try:
                duration_s = next(motion)
            except StopIteration as end:
                moved: JointMotion = end.value
                return moved
            self._simulation.step(duration_s)

    @checked
    def moving_to(
        self, position: Finite, *, timeout_s: MotionTimeout = 10.0, tolerance: NotNegative | None = None
    ) -> Generator[float, None, JointMotion]:
        """`move_to` for callers that step the simulation themselves: yields the times [s] by which they have to."""
        low, high = self.range
        if not low - _MIN_RANGE <= position <= high + _MIN_RANGE:
            cause = f"the position {position:g} is out of range"
            raise InvalidArgumentError(self.id, cause=cause, remedy=f"give {low:g} to {high:g} {self._unit}")
        limit = _TOLERANCES[self.is_prismatic] if tolerance is None else tolerance
        if self._master is not None:
            duration_s = yield from self._move_master(self._master, position, timeout_s, limit)
        elif Capability.JOINTS in self._simulation.engine.capabilities and self._simulates:
            duration_s = yield from self._pull(position, timeout_s, limit)
        else:
            pose = self._joint.pose_for(self._axis.name, position - self._zero, self._poses())
            self._simulation.apply(SetPoses({self.body: pose}))
            duration_s = 0.0
        now = self.position
        return JointMotion(arrived=abs(now - position) <= limit, position=now, target=position, duration_s=duration_s)

    def __repr__(self) -> str:
        low, high = self.range
        at = f"{self.position:.3f} {self._unit} in [{low:.3f}, {high:.3f}]"
        return f"<{type(self).__name__} {self.id} of {self.body}: {at}>"

    @property
    def _unit(self) -> str:
        return "m" if self.is_prismatic else "rad"

    def _move_master(
        self, master: SimulationJoint, position: float, timeout_s: float, tolerance: float
    ) -> Generator[float, None, float]:
        """Moves the mimicked joint to where it puts this one; returns the simulated time [s].

        Raises:
            InvalidArgumentError: the multiplier is 0, or that position of the master is out of its range.
        """
        mimic = self._joint.joint.mimic
        assert mimic is not None
        if mimic.multiplier == 0.0:
            raise InvalidArgumentError(
                self.id, cause=f"it does not move with {master.id}, which it mimics", remedy=f"move {master.id}"
            )
        target = (position - mimic.offset) / mimic.multiplier
        low, high = master.range
        # The ranges may differ by rounding.
        slack = 1e-3 * max(1.0, abs(target))
        if low - slack <= target <= high + slack:
            target = min(max(target, low), high)
        accuracy = min(tolerance / abs(mimic.multiplier), _TOLERANCES[master.is_prismatic])
        moved = yield from master.moving_to(target, timeout_s=timeout_s, tolerance=accuracy)
        return moved.duration_s

    def _pull(self, target: float, timeout_s: float, tolerance: float) -> Generator[float, None, float]:
        """Pulls until the joint is at rest at the target, or until the timeout; returns the simulated time [s]."""
        start = before = self.position
        low, high = self.range
        whole = high - low if math.isfinite(high - low) else abs(target - start)
        speed = max(whole, abs(target - start), _MIN_RANGE) / _RAMP_S
        elapsed_s, extra, rests = 0.0, 0.0, 0
        if self._on_pull is not None:
            self._on_pull(self.id, target)
        try:
            while elapsed_s < timeout_s and rests < _REST_STEPS:
                elapsed_s += _CONTROL_STEP_S
                distance = target - start
                setpoint = start + math.copysign(min(abs(distance), speed * elapsed_s), distance)
                if setpoint == target:
                    extra += _INTEGRAL_GAIN * (target - before)
                    extra = max(-whole, min(whole, extra))
                pull = self._joint.pull_target(self._axis.name, setpoint + extra - self._zero, self._poses())
                self._simulation.pull(pull.id, point=pull.point, target=pull.target)
                yield _CONTROL_STEP_S
                now = self.position
                is_at_rest = abs(now - before) <= tolerance * _CONTROL_STEP_S * 4
                rests = rests + 1 if is_at_rest and abs(now - target) <= tolerance else 0
                before = now
        finally:
            self._simulation.release(self.body)
        return elapsed_s

    def _poses(self) -> Mapping[BodyId, Array]:
        joint, snapshot = self._joint.joint, self._simulation.state
        poses = poses_in(snapshot, {joint.parent, joint.child})
        for id in (joint.parent, joint.child):
            if id not in poses:
                raise BodyNotFoundError(id, known=snapshot.ids)
        return poses

    def _distance_at(self, position: float) -> float:
        """The distance of the moving body, or of its handle, from the center of the other body at a position [m]."""
        joint, poses = self._joint.joint, self._poses()
        other = joint.parent if self.body == joint.child else joint.child
        goal = normalized_pose_array(self._joint.pose_for(self._axis.name, position - self._zero, poses))
        now = poses_in(self._simulation.state, set(self._attached_ids))
        attached = now.get(self._attached_ids[-1], poses[self.body])
        moved = pose_multiply(goal, pose_multiply(pose_inverse(poses[self.body]), attached))
        return float(np.linalg.norm(moved[:3] - poses[other][:3]))

    def _zero_offset(self) -> float:
        """The position that the joint had when this simulation connected to its engine, else 0 [m or rad]."""
        name = self._axis.name
        known = {joint.id for world in self._simulation.worlds for joint in world.joints}
        if self.id in known or Capability.JOINTS not in self._simulation.engine.capabilities:
            return 0.0
        positions = self._simulation.engine.run(lambda engine: engine.joint_positions(), label="joint positions")
        if self.id not in positions:
            return 0.0
        return positions[self.id][AXIS_NAMES.index(name)] - self._joint.positions(self._poses())[name]


def find_joint(
    simulation: EngineSession, name: str, *, on_pull: Callable[[BodyId, float], object] | None = None
) -> SimulationJoint:
    """Finds the joint of that id or IRI, or the only one that moves the body of that id or IRI.

    Args:
        simulation: the simulation.
        name: the id or IRI of a joint or body.
        on_pull: called with the id and the target [m or rad] when a joint is pulled.

    Raises:
        NameNotFoundError: no movable joint or body has that name.
        AmbiguousNameError: several joints move that body.
    """
    world, spawn_record = simulation.snapshot(), SpawnRecord.from_worlds(simulation.worlds)
    bodies = {body.id: body for body in world.bodies}

    def movable() -> Iterator[JointHandle]:
        for joint in world.joints:
            if joint.parent in bodies and joint.child in bodies:
                handle = JointHandle(joint, bodies, spawn_record)
                if handle.axes:
                    yield handle

    handles = list(movable())
    found = [handle for handle in handles if name in {handle.joint.id, handle.joint.iri}]
    found = found or [handle for handle in handles if name in {handle.moving_body, bodies[handle.moving_body].iri}]
    if len(found) > 1:
        raise AmbiguousNameError(name, entity_type="joint", candidates=[handle.joint.id for handle in found])
    if not found:
        known = [id for handle in handles for id in (handle.joint.id, handle.moving_body)]
        raise NameNotFoundError(name, entity_type="joint, door or drawer", known=known)
    by_id = {handle.joint.id: handle for handle in handles}

    def with_master(handle: JointHandle, followers: frozenset[str]) -> SimulationJoint:
        mimic = handle.joint.mimic
        master = None
        if mimic is not None and mimic.joint in by_id and mimic.joint not in followers:
            master = with_master(by_id[mimic.joint], followers | {mimic.joint})
        return SimulationJoint(simulation, handle, world, master=master, on_pull=on_pull)

    return with_master(found[0], frozenset({found[0].joint.id}))


_MIN_DEPTH_M = 0.004
"""How much deeper a moved body may be in another one than at the start."""
_CLEARANCE_STEPS = 12
_BISECTIONS = 7


class JointClearance:
    """How far a joint can be moved until its body enters another one that cannot give way.

    Loose bodies are no obstacles, since most of them move with what they are in.
    """

    def __init__(self, simulation: EngineSession, joint: JointHandle) -> None:
        """Reads the current state.

        Args:
            simulation: the simulation.
            joint: the joint.
        """
        world = simulation.snapshot()
        self._joint, self._geometry = joint, simulation.geometry
        moving = joint.moving_body
        self._family = {moving, *find_dependents(world, [moving]).parts}
        self._bodies = {body.id: body for body in world.bodies}
        self._start = normalized_pose_array(self._bodies[moving].pose)
        jointed = {end for each in world.joints for end in (each.parent, each.child)}
        held = {each.child for each in world.attachments}
        loose = {id for id, body in self._bodies.items() if body.physics.is_dynamic and id not in jointed | held}
        ignored = self._family | loose | enclosing_body_ids(simulation)
        state = simulation.state
        self._sampler = PlacementSampler(
            self._bodies, self._geometry, state.ids, state.poses, frozenset(str(id) for id in ignored)
        )

    def limit(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> tuple[float, BodyId | None]:
        """The position nearest to a wanted one that is reached freely [m or rad], and the body in the way, if any.

        Args:
            axis: the axis of the joint.
            value: the wanted position [m or rad].
            poses: the current poses of both ends of the joint.
        """
        at = self._joint.positions(poses)[axis]
        start = self._depths(axis, at, poses)
        free, blocker = at, None
        for step in np.linspace(at, value, _CLEARANCE_STEPS + 1)[1:].tolist():
            blocker = self._blocker(start, axis, step, poses)
            if blocker is not None:
                low, high = free, step
                for _ in range(_BISECTIONS):
                    middle = (low + high) / 2
                    found = self._blocker(start, axis, middle, poses)
                    low, high = (middle, high) if found is None else (low, middle)
                return low, blocker
            free = step
        return value, None

    def _blocker(
        self, start: Mapping[BodyId, float], axis: str, value: float, poses: Mapping[BodyId, Array]
    ) -> BodyId | None:
        """The body that is entered deepest at a position, beyond how deep it was entered at the start."""
        more = {id: depth - start.get(id, 0.0) for id, depth in self._depths(axis, value, poses).items()}
        deepest = max(more, key=more.__getitem__, default=None)
        return deepest if deepest is not None and more[deepest] > _MIN_DEPTH_M else None

    def _depths(self, axis: str, value: float, poses: Mapping[BodyId, Array]) -> dict[BodyId, float]:
        target = normalized_pose_array(self._joint.pose_for(axis, value, poses))
        change = pose_multiply(target, pose_inverse(self._start))
        depths: dict[BodyId, float] = {}
        for id in self._family:
            pose = pose_from_array(pose_multiply(change, normalized_pose_array(self._bodies[id].pose)))
            body = msgspec.structs.replace(self._bodies[id], pose=pose)
            for other, depth in self._sampler.penetration_depths(body, self._geometry.get(id)).items():
                depths[other] = max(depth, depths.get(other, 0.0))
        return depths
