"""Forward and inverse kinematics of a robot on a model of its own, without the place it stands in.

Positions of joints are those of the robot's description. Poses are in the world frame if the pose of the root link is
given, otherwise in the frame of the root link. The joints of a base that drives are `base.x`, `base.y` [m] and
`base.yaw` [rad]: a displacement of the root link in its own frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from math import degrees, inf, pi, radians
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.mujoco.mujoco_kinematics import FRAME_SITE, ChainJoint, ChainJointType, compile_chain
from mindstage.errors import InvalidArgumentError, RobotLibraryError
from mindstage.ranges import Count, Finite, NotNegative, Positive, PositiveLength, check_fields, checked
from mindstage.robots.models.robot_model import Arm, BaseType, RobotJoint, RobotJointType, RobotModel
from mindstage.scene import PoseLike
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_inverse,
    pose_multiply,
    quaternion_from_matrix,
)

__all__ = ["BASE_JOINTS", "IkResult", "IkTolerance", "RobotKinematics"]

BASE_JOINTS = ("base.x", "base.y", "base.yaw")
"""The joints of a base that drives, in the order of a base pose."""

_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_ORIENTATION_COST = 0.3
"""Meters that count as much as one radian."""
_POSTURE_COST = 3e-4
"""Meters that count as much as a step of a joint away from its seed [m/rad or m/m]."""
_SLIDE_WEIGHT = 6.0
"""A slide that moves by 1 m costs as much as a hinge that turns by the square root of this [rad]."""
_DAMPING = 1e-6
"""Least regularization of a step, added to the squares of weighted derivatives; dimensionless."""
_LM_DAMPING = 1e-2
"""Levenberg-Marquardt damping of mink, a part of the squared error; dimensionless."""
_MAX_STEP = 1.0
"""Largest change of a joint in an iteration [m or rad]: beyond it the linearization is worthless."""
_MAX_ITERATIONS = 60
_STALL_ITERATIONS = 8
"""Iterations without progress after which an attempt ends."""
_PRECISION = 0.1
"""Iterations go on until the error is this part of the tolerance."""
_DESCENT_STEPS = 8
_NEAR_M = 0.095
"""Shorter distances are stated in millimeters."""
_MIN_REACH_M = 0.05
_NEARLY_WHOLE_RAD = 0.02
"""A hinge whose range is by less below a whole turn reaches every direction."""
_NEAR_LIMIT_RAD = 0.6
_AT_LIMIT = 1e-4
"""A joint nearer to its limit is at it [m or rad]."""


class IkTolerance(msgspec.Struct, frozen=True, kw_only=True):
    """The error that a solution may have."""

    position_m: PositiveLength = 0.001
    rotation_rad: Positive = radians(0.5)

    def __post_init__(self) -> None:
        check_fields(self)


class IkResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of inverse kinematics; truthy if the target is reached."""

    reached: bool
    positions: Mapping[str, float]
    """Positions of the joints that were free to move [m or rad], those of the base left out; the nearest ones found if
    the target is not reached."""
    root_pose: tuple[float, ...]
    """Pose of the root link (x y z, w x y z), in the frame of the target."""
    position_error_m: float
    rotation_error_rad: float
    iterations: int
    reason: str = ""
    """Why the target is not reached: the limits that prevent it, or the distance beyond reach."""
    limits: tuple[str, ...] = ()
    """The joints whose limits prevent it."""
    shortfall_m: float | None = None
    """By how much the target is missed, or beyond reach [m]; None if it is reached."""

    def __bool__(self) -> bool:
        return self.reached


class _Libraries(NamedTuple):
    """The libraries for inverse kinematics; they are loaded when the first chain is made."""

    mink: Any
    daqp: Any


@cache
def _libraries() -> _Libraries:
    """Loads the libraries.

    Raises:
        RobotLibraryError: one is not installed.
    """
    try:
        import daqp
        import mink
    except ImportError as error:
        raise RobotLibraryError(error.name or "mink") from error
    return _Libraries(mink, daqp)


class _Chain:
    """The joints from the root to a frame, as a model."""

    def __init__(self, robot: RobotModel, link: str, offset: Array) -> None:
        by_child = {joint.child: joint for joint in robot.joints}
        path: list[RobotJoint] = []
        while link in by_child:
            path.insert(0, by_child[link])
            link = by_child[link].parent
        joints, pending = [], _IDENTITY
        if robot.base.type is not BaseType.FIXED:
            axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
            kinds = (ChainJointType.SLIDE, ChainJointType.SLIDE, ChainJointType.HINGE)
            joints += [ChainJoint(*each) for each in zip(BASE_JOINTS, kinds, [_IDENTITY] * 3, axes, strict=True)]
        for joint in path:
            pending = pose_multiply(pending, normalized_pose_array(joint.origin))
            if joint.is_movable:
                is_slide = joint.is_prismatic
                kind = ChainJointType.SLIDE if is_slide else ChainJointType.HINGE
                joints.append(ChainJoint(joint.name, kind, pending, joint.axis, _range(joint)))
                pending = _IDENTITY
        self.movable = tuple(joint for joint in path if joint.is_movable)
        self.names = tuple(joint.name for joint in joints)
        self.index = {name: number for number, name in enumerate(self.names)}
        self.model: Any = compile_chain(joints, pose_multiply(pending, offset))
        self.configuration: Any = _libraries().mink.Configuration(self.model)
        self.is_limited = np.asarray(self.model.jnt_limited, dtype=bool)
        self.lower = np.where(self.is_limited, self.model.jnt_range[:, 0], -inf)
        self.upper = np.where(self.is_limited, self.model.jnt_range[:, 1], inf)
        self.is_hinge = np.array([joint.type is ChainJointType.HINGE for joint in joints], dtype=bool)

    def coordinates(self, positions: Mapping[str, float]) -> Array:
        """The coordinates for some positions; others are 0, or the limit nearest to it."""
        q = np.clip(np.zeros(len(self.names)), self.lower, self.upper)
        for number, name in enumerate(self.names):
            if name in positions:
                q[number] = positions[name]
        for joint in self.movable:
            if joint.mimic is not None:
                master = joint.mimic.joint
                value = q[self.index[master]] if master in self.index else positions.get(master, 0.0)
                q[self.index[joint.name]] = joint.mimic.multiplier * value + joint.mimic.offset
        return q

    def spread(self, joints: Sequence[str]) -> Array:
        """The change of the coordinates by a change of some joints, n x k; followers move with their masters."""
        columns = np.zeros((len(self.names), len(joints)))
        for column, name in enumerate(joints):
            columns[self.index[name], column] = 1.0
        for joint in self.movable:
            if joint.mimic is not None and joint.mimic.joint in self.index:
                columns[self.index[joint.name]] = joint.mimic.multiplier * columns[self.index[joint.mimic.joint]]
        return columns

    def pose(self, q: Array) -> Array:
        """The pose of the frame in the frame of the root at base position 0."""
        self.configuration.update(q)
        data = self.configuration.data
        found = np.empty(7)
        found[:3] = data.site_xpos[0]
        found[3:] = quaternion_from_matrix(data.site_xmat[0].reshape(3, 3))
        return found


def _range(joint: RobotJoint) -> tuple[float, float] | None:
    """Both limits of a joint; None without any."""
    if joint.type is RobotJointType.CONTINUOUS or (joint.lower is None and joint.upper is None):
        return None
    far = 1e3
    return (-far if joint.lower is None else joint.lower, far if joint.upper is None else joint.upper)


class _Problem(NamedTuple):
    """One problem of inverse kinematics, with what all attempts have in common."""

    chain: _Chain
    joints: tuple[str, ...]
    columns: Array
    """See `_Chain.spread`."""
    rows: NDArray[np.intp]
    """The coordinates of `joints`."""
    target: Array
    """In the frame of the root at base position 0."""
    frame_task: Any
    is_fixed: NDArray[np.bool_]
    """Which of the three rotations about the axes of the frame matter."""
    tolerance: IkTolerance
    start: Array
    """The given coordinates."""


class _Attempt(NamedTuple):
    q: Array
    position_error: float
    rotation_error: float
    iterations: int

    def reached(self, tolerance: IkTolerance) -> bool:
        return self.position_error <= tolerance.position_m and self.rotation_error <= tolerance.rotation_rad

    @property
    def cost(self) -> float:
        return self.position_error + _ORIENTATION_COST * self.rotation_error


class RobotKinematics:
    """Forward and inverse kinematics of a robot; not thread-safe."""

    def __init__(self, model: RobotModel) -> None:
        """Stores the model; the chain to a frame is compiled when it is first used."""
        self.model = model
        self.iterations = 0
        """Number of iterations of inverse kinematics so far, as a measure of work."""
        self._chains: dict[str, _Chain] = {}
        self._joints = {joint.name: joint for joint in model.joints}

    # -- forward -------------------------------------------------------------------------------------------------------

    @checked
    def pose(self, frame: str, positions: Mapping[str, Finite], *, root_pose: PoseLike | None = None) -> Array:
        """The pose of a frame, seven numbers.

        Args:
            frame: the name of a gripper, for its grasp frame, or of a link.
            positions: positions of joints [m or rad]; others are 0, or the limit nearest to it.
            root_pose: pose of the root link; None for the origin.

        Raises:
            InvalidArgumentError: there is no such gripper or link.
        """
        chain = self._chain(frame)
        pose = chain.pose(chain.coordinates(positions))
        return pose if root_pose is None else pose_multiply(normalized_pose_array(root_pose), pose)

    def joints_of(self, frame: str) -> tuple[str, ...]:
        """The joints with drives between the root and a frame, those of the base left out.

        Raises:
            InvalidArgumentError: there is no such gripper or link.
        """
        return tuple(joint.name for joint in self._chain(frame).movable if joint.is_actuated)

    def frame_of(self, arm: Arm) -> str:
        """The frame that an arm moves: its gripper, or its last link."""
        return arm.gripper or arm.tip_link

    def limits(self, joint: str) -> tuple[float, float]:
        """Both limits of a joint [m or rad]; infinite without any.

        Raises:
            InvalidArgumentError: there is no such joint.
        """
        if joint in BASE_JOINTS:
            return -inf, inf
        if joint not in self._joints:
            cause = "there is no such joint"
            raise InvalidArgumentError(joint, cause=cause, remedy=f"give one of {', '.join(self._joints)}")
        return _range(self._joints[joint]) or (-inf, inf)

    # -- inverse -------------------------------------------------------------------------------------------------------

    @checked
    def solve_ik(
        self,
        frame: str,
        target: PoseLike,
        *,
        joints: Sequence[str] | None = None,
        seed: Mapping[str, Finite] | None = None,
        root_pose: PoseLike | None = None,
        free: str = "",
        tolerance: IkTolerance | None = None,
        attempts: Count = 16,
    ) -> IkResult:
        """Finds positions of joints in which a frame has a pose.

        Each iteration is a quadratic program: the error of the frame by mink, a small pull towards the seed, damping,
        and the limits of the joints. Further attempts start from the rest positions, the middle of the ranges, and
        random positions, always the same.

        Args:
            frame: the name of a gripper, for its grasp frame, or of a link.
            target: the pose that the frame is to have.
            joints: the joints that may move, `BASE_JOINTS` among them; None for those of the arm to this frame.
            seed: current positions of joints, also of those that may not move [m or rad].
            root_pose: pose of the root link; None if the target is in the frame of the root.
            free: the axes of the frame about which it may turn, such as "z"; "xyz" if its rotation does not matter.
            tolerance: the permitted error; 1 mm and 0.5 degrees by default.
            attempts: the largest number of attempts.

        Returns:
            The first solution; without one the attempt that came nearest, with the reason.

        Raises:
            InvalidArgumentError: a frame or joint does not exist, or no joint moves the frame.
        """
        problem = self._problem(frame, target, joints, seed or {}, root_pose, free, tolerance or IkTolerance())
        best: _Attempt | None = None
        iterations = 0
        for start in self._seeds(problem, attempts):
            attempt = _iterate(problem, start)
            iterations += attempt.iterations
            self.iterations += attempt.iterations
            if best is None or attempt.cost < best.cost:
                best = attempt
            if attempt.reached(problem.tolerance):
                break
            if best.position_error > 2 * problem.tolerance.position_m and self._beyond_reach(problem)[0] > 0.0:
                break
        assert best is not None
        return self._result(problem, best._replace(iterations=iterations), root_pose)

    @checked
    def solutions(
        self,
        frame: str,
        target: PoseLike,
        *,
        joints: Sequence[str] | None = None,
        seed: Mapping[str, Finite] | None = None,
        root_pose: PoseLike | None = None,
        free: str = "",
        tolerance: IkTolerance | None = None,
        attempts: Count = 24,
        apart: NotNegative = 0.2,
    ) -> Iterator[IkResult]:
        """Yields different solutions, as they are found; see `solve_ik`.

        Args:
            frame: see `solve_ik`; the same holds for the others.
            joints: the joints that may move.
            seed: current positions.
            root_pose: pose of the root link.
            free: the axes about which the frame may turn.
            tolerance: the permitted error.
            attempts: the largest number of attempts.
            apart: the difference of at least one joint to each earlier solution [m or rad].

        Raises:
            InvalidArgumentError: see `solve_ik`.
        """
        problem = self._problem(frame, target, joints, seed or {}, root_pose, free, tolerance or IkTolerance())
        found: list[Array] = []
        for number, start in enumerate(self._seeds(problem, attempts)):
            attempt = _iterate(problem, start)
            self.iterations += attempt.iterations
            if not attempt.reached(problem.tolerance):
                if number == 0 and self._beyond_reach(problem)[0] > 0.0:
                    return
                continue
            if all(np.abs(attempt.q - other).max() > apart for other in found):
                found.append(attempt.q)
                yield self._result(problem, attempt, root_pose)

    # -- parts ---------------------------------------------------------------------------------------------------------

    def _chain(self, frame: str) -> _Chain:
        if frame not in self._chains:
            gripper = next((each for each in self.model.grippers if each.name == frame), None)
            links = {link.name for link in self.model.links}
            if gripper is None and frame not in links:
                known = ", ".join([*(each.name for each in self.model.grippers), *sorted(links)])
                cause = f"{self.model.name} has no such gripper or link"
                raise InvalidArgumentError(frame, cause=cause, remedy=f"give one of {known}")
            link = frame if gripper is None else gripper.link
            offset = _IDENTITY if gripper is None else normalized_pose_array(gripper.grasp_pose)
            self._chains[frame] = _Chain(self.model, link, offset)
        return self._chains[frame]

    def _problem(
        self,
        frame: str,
        target: PoseLike,
        joints: Sequence[str] | None,
        seed: Mapping[str, float],
        root_pose: PoseLike | None,
        free: str,
        tolerance: IkTolerance,
    ) -> _Problem:
        chain = self._chain(frame)
        if joints is None:
            arm = next((each for each in self.model.arms if frame in {each.gripper, each.tip_link}), None)
            joints = self.joints_of(frame) if arm is None else arm.joints
        moving = tuple(name for name in joints if name in chain.index)
        if unknown := [name for name in joints if name not in self._joints and name not in BASE_JOINTS]:
            remedy = f"give some of {', '.join(self.joints_of(frame))}"
            raise InvalidArgumentError(unknown[0], cause="there is no such joint", remedy=remedy)
        if not moving:
            remedy = f"give some of {', '.join(chain.names)}"
            raise InvalidArgumentError(frame, cause="none of the joints moves it", remedy=remedy)
        goal = normalized_pose_array(target)
        if root_pose is not None:
            goal = pose_multiply(pose_inverse(normalized_pose_array(root_pose)), goal)
        is_fixed = np.array([axis not in free for axis in "xyz"])
        mink = _libraries().mink
        task = mink.FrameTask(FRAME_SITE, "site", 1.0, _ORIENTATION_COST * is_fixed, lm_damping=_LM_DAMPING)
        task.set_target(mink.SE3(wxyz_xyz=np.concatenate([goal[3:], goal[:3]])))
        q = chain.coordinates(seed)
        rows = np.array([chain.index[name] for name in moving], dtype=np.intp)
        return _Problem(chain, moving, chain.spread(moving), rows, goal, task, is_fixed, tolerance, q)

    def _seeds(self, problem: _Problem, attempts: int) -> Iterator[Array]:
        """Coordinates from which attempts start; joints that may not move keep theirs."""
        chain, rows, q = problem.chain, problem.rows, problem.start
        lower, upper = _bounds(chain, rows, q)

        def moved(values: Array) -> Array:
            positions = dict(zip(chain.names, q.tolist(), strict=True))
            positions.update(zip(problem.joints, np.clip(values, lower, upper).tolist(), strict=True))
            return chain.coordinates(positions)

        yield moved(q[rows])
        arms = [arm for arm in self.model.arms if arm.rest_positions and set(arm.joints) & set(problem.joints)]
        starts = []
        if (turned := _turned(problem)) is not None:
            starts.append(turned)
        for arm in arms:
            rest = dict(zip(arm.joints, arm.rest_positions, strict=True))
            starts.append(np.array([rest.get(name, q[chain.index[name]]) for name in problem.joints]))
        starts.append((lower + upper) / 2)
        generator = np.random.default_rng(0)
        for number in range(attempts - 1):
            if number < len(starts):
                yield moved(starts[number])
            else:
                yield moved(generator.uniform(lower, upper))

    def _beyond_reach(self, problem: _Problem) -> tuple[float, float]:
        """How far the target is beyond an upper bound of the reach, and that bound [m]; 0 if it is not."""
        chain = problem.chain
        if set(problem.joints) & set(BASE_JOINTS):
            return 0.0, inf
        first = next((number for number in problem.rows if chain.is_hinge[number]), None)
        if first is None:
            return 0.0, inf
        reach = _upper_reach(chain, first, problem.start)
        distance = _distance_to_sweep(problem, first)
        return max(0.0, distance - reach), reach

    def _result(self, problem: _Problem, attempt: _Attempt, root_pose: PoseLike | None) -> IkResult:
        chain, q = problem.chain, attempt.q
        positions = {name: float(q[chain.index[name]]) for name in problem.joints if name not in BASE_JOINTS}
        root = _IDENTITY if root_pose is None else normalized_pose_array(root_pose)
        if BASE_JOINTS[0] in chain.index:
            x, y, yaw = q[:3].tolist()
            root = pose_multiply(root, np.array([x, y, 0.0, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]))
        reached = attempt.reached(problem.tolerance)
        reason, limits, shortfall_m = ("", (), None) if reached else self._why(problem, attempt)
        return IkResult(
            reached=reached,
            positions=positions,
            root_pose=tuple(root.tolist()),
            position_error_m=attempt.position_error,
            rotation_error_rad=attempt.rotation_error,
            iterations=attempt.iterations,
            reason=reason,
            limits=limits,
            shortfall_m=shortfall_m,
        )

    def _why(self, problem: _Problem, attempt: _Attempt) -> tuple[str, tuple[str, ...], float]:
        """Why a target is not reached, the joints whose limits prevent it, and by how much it is missed [m]."""
        beyond, reach = self._beyond_reach(problem)
        if beyond > 0.0:
            text = f"the reach of {reach:.3g} m" if reach > _MIN_REACH_M else "reach"
            distance = f"{beyond:.3g} m" if beyond >= _NEAR_M else f"{beyond * 1000:.2g} mm"
            return f"the target is {distance} beyond {text}", (), beyond
        chain, limits, texts = problem.chain, [], []
        chain.configuration.update(attempt.q)
        jacobian, error, _ = problem.frame_task.compute_qp_residual(chain.configuration)
        wanted = (jacobian @ problem.columns).T @ error
        for name, row, direction in zip(problem.joints, problem.rows.tolist(), wanted.tolist(), strict=True):
            for limit, side, sign in ((chain.lower[row], "lower", -1.0), (chain.upper[row], "upper", 1.0)):
                if abs(attempt.q[row] - limit) < _AT_LIMIT and sign * direction > 1e-9:
                    limits.append(name)
                    texts.append(f"{name} is at its {side} limit {limit:.4g} {'rad' if chain.is_hinge[row] else 'm'}")
        missed = f"{attempt.position_error * 1000:.3g} mm and {degrees(attempt.rotation_error):.3g} degrees are missing"
        why = "; ".join(texts) or "no joint is at a limit, the arm cannot take that direction there"
        return f"{missed}: {why}", tuple(limits), attempt.position_error


def _bounds(chain: _Chain, rows: NDArray[np.intp], q: Array) -> tuple[Array, Array]:
    """Finite bounds of coordinates for samples: a turn for hinges without limits, a step of 1 m for a base."""
    lower, upper = chain.lower[rows].copy(), chain.upper[rows].copy()
    spread = np.where(chain.is_hinge[rows], pi, 1.0)
    lower = np.where(np.isfinite(lower), lower, q[rows] - spread)
    upper = np.where(np.isfinite(upper), upper, q[rows] + spread)
    return lower, upper


def _iterate(problem: _Problem, start: Array) -> _Attempt:
    """One attempt: Gauss-Newton steps within the limits until the error is small or does not decrease any more."""
    chain, configuration, task = problem.chain, problem.chain.configuration, problem.frame_task
    columns, rows = problem.columns, problem.rows
    lower, upper = chain.lower[rows], chain.upper[rows]
    weights = np.where(chain.is_hinge[rows], 1.0, _SLIDE_WEIGHT)
    q, best, best_cost, best_at = start, start, inf, 0
    for number in range(_MAX_ITERATIONS + 1):
        configuration.update(q)
        jacobian, error, damping = task.compute_qp_residual(configuration)
        cost = float(np.linalg.norm(error))
        best_at = number if cost < best_cost * 0.99 else best_at
        best, best_cost = (q, cost) if cost < best_cost else (best, best_cost)
        if _is_small(error, problem, _PRECISION) or number in {_MAX_ITERATIONS, best_at + _STALL_ITERATIONS}:
            break
        weighted = jacobian @ columns
        hessian = weighted.T @ weighted
        hessian.flat[:: len(rows) + 1] += (_DAMPING + damping + _POSTURE_COST**2) * weights
        gradient = -(error @ weighted) + _POSTURE_COST**2 * weights * (q[rows] - start[rows])
        least, most = np.maximum(lower - q[rows], -_MAX_STEP), np.minimum(upper - q[rows], _MAX_STEP)
        step = _bounded_step(hessian, gradient, np.minimum(least, 0.0), np.maximum(most, 0.0))
        q = q + columns @ step
        q[rows] = np.minimum(np.maximum(q[rows], lower), upper)
    configuration.update(best)
    error = task.compute_error(configuration)
    distance = float(np.linalg.norm(configuration.data.site_xpos[0] - problem.target[:3]))
    return _Attempt(best, distance, float(np.linalg.norm(error[3:] * problem.is_fixed)), number)


def _bounded_step(hessian: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """The minimum of a quadratic function within bounds."""
    step = -np.linalg.solve(hessian, gradient)
    if np.all(step >= lower) and np.all(step <= upper):
        return np.asarray(step)
    count = len(gradient)
    found, _, status, _ = _libraries().daqp.solve(
        hessian, gradient, np.zeros((0, count)), upper, lower, np.zeros(count, dtype=np.int32)
    )
    return np.asarray(found) if status > 0 else np.clip(step, lower, upper)


def _is_small(weighted_error: Array, problem: _Problem, part: float) -> bool:
    tolerance = problem.tolerance
    position, rotation = np.linalg.norm(weighted_error[:3]), np.linalg.norm(weighted_error[3:])
    is_near = position <= part * tolerance.position_m
    return bool(is_near and rotation <= part * tolerance.rotation_rad * _ORIENTATION_COST)


def _turned(problem: _Problem) -> Array | None:
    """The start with joints that turn all the way taken from near one limit to near the other; None without any."""
    chain, rows, q = problem.chain, problem.rows, problem.start[problem.rows]
    lower, upper = chain.lower[rows], chain.upper[rows]
    is_whole = chain.is_hinge[rows] & np.isfinite(upper - lower) & (upper - lower >= 2 * pi - _NEARLY_WHOLE_RAD)
    is_low, is_high = is_whole & (q - lower < _NEAR_LIMIT_RAD), is_whole & (upper - q < _NEAR_LIMIT_RAD)
    if not (is_low | is_high).any():
        return None
    return np.asarray(q + 2 * pi * is_low - 2 * pi * is_high)


def _upper_reach(chain: _Chain, first: int, q: Array) -> float:
    """An upper bound of the distance between the first hinge that moves and the frame [m].

    Args:
        first: the hinge.
        q: any coordinates.
    """
    chain.configuration.update(q)
    data = chain.configuration.data
    points = [*np.array(data.xanchor[first:]), np.array(data.site_xpos[0])]
    length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(points))
    slides = first + np.flatnonzero(~chain.is_hinge[first:])
    return length + float(np.maximum(np.abs(chain.upper - q), np.abs(chain.lower - q))[slides].sum())


def _distance_to_sweep(problem: _Problem, first: int) -> float:
    """The distance of the target from where the slides before the first hinge that moves can put its anchor [m]."""
    chain, q = problem.chain, problem.start
    chain.configuration.update(q)
    data = chain.configuration.data
    slides = np.flatnonzero(~chain.is_hinge[:first])
    directions = np.array(data.xaxis[slides]).T @ problem.columns[slides]
    moving = np.flatnonzero(np.linalg.norm(directions, axis=0) > 0.0)
    away, moved = problem.target[:3] - data.xanchor[first], np.zeros(len(problem.rows))
    for _ in range(_DESCENT_STEPS):  # coordinate descent: the slides need not be orthogonal
        for column in moving.tolist():
            direction, row = directions[:, column], int(problem.rows[column])
            best = moved[column] + float(direction @ away) / float(direction @ direction)
            best = float(np.clip(best, chain.lower[row] - q[row], chain.upper[row] - q[row]))
            away = away - (best - moved[column]) * direction
            moved[column] = best
    return float(np.linalg.norm(away))
