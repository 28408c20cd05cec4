"""Motions of an arm that avoid collisions, as joint trajectories within the limits of velocity and acceleration.

`plan_arm` finds a path with OMPL (RRT-Connect, then shortcuts), and `plan_path` moves the gripper straight from pose to
pose, such as along the arc of a door's handle. Both begin where the robot is, unless a start is
given, and see the world as it is when they are called.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from math import ceil, pi
from typing import Any

import numpy as np

from mindstage.errors import InvalidArgumentError, RobotLibraryError, UnreachableError
from mindstage.ranges import Count, Finite, Fraction, Length, Point, Positive, Seed, WallTime, checked
from mindstage.robots.arm_paths import follow_poses, interpolated_poses
from mindstage.robots.collisions import CLEARANCE_M, Collision, CollisionChecker
from mindstage.robots.floor_poses import BasePose
from mindstage.robots.models.robot_model import Arm, RobotJointType
from mindstage.robots.retiming import MotionLimits, resting_path, retimed, rounded_polyline, spline_path
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.robots.search_limits import CPU_S, SearchLimit
from mindstage.robots.trajectories import JointTrajectory, spline_of
from mindstage.scene import BodyId, PoseLike, as_pose
from mindstage.scene.transforms import Array, normalized_pose_array

__all__ = ["ArmTask", "find_arm", "load_ompl", "plan_arm", "plan_path", "termination"]

_STEP = 0.05
"""Distance between two states that are checked [rad]."""
_SLIDE_SCALE = 0.4
"""Displacement of a prismatic joint that counts as much as one radian [m]."""
_TRIALS = 3
_MORE_TESTS = 3000
"""Number of states that a repeated search may test at least."""
_TEST_PERIOD_S = 0.004
_TEST_STEP = 0.015
"""Distance between two states of a finished trajectory that are tested [rad]."""
_TEST_SLACK_M = 0.001
"""How much nearer they may be than the states of the path [m]."""
_MAX_GOALS = 6
"""Number of configurations at a target that are looked for."""
_FREQUENT = 0.2
"""Obstacles that were met by less than this part of the most frequent one are not named."""
_SHORTCUT_TESTS = 1500
"""Number of states that are tested for shortcuts after a path was found."""
_RANGE = 0.8
"""Length of a step of the tree [rad]."""
_LINE_STEP_M = 0.01
"""Distance of two poses of a line; where an arm is nearly stretched, its joints move far between them."""


@cache
def _ompl() -> Any:
    try:
        import ompl.base
        import ompl.geometric
        import ompl.util
    except ImportError as error:
        raise RobotLibraryError(error.name or "ompl") from error
    ompl.util.setLogLevel(ompl.util.LOG_NONE)
    return ompl


def load_ompl(seed: int) -> Any:
    """The library for path planning, silent, with a seed of its random numbers.

    Raises:
        RobotLibraryError: it is not installed.
    """
    ompl = _ompl()
    ompl.util.RNG.setSeed(seed)
    return ompl


def find_arm(robot: Robot, arm: Arm | str = "") -> Arm:
    """The arm of a name; the first one if the name is empty.

    Raises:
        InvalidArgumentError: there is no such arm.
    """
    if isinstance(arm, Arm):
        return arm
    arms = {each.name: each for each in robot.model.arms}
    if not arms or (arm and arm not in arms):
        remedy = f"give one of {', '.join(arms)}" if arms else "use a robot with an arm"
        raise InvalidArgumentError(arm or "arm", cause=f"{robot.name} has no such arm", remedy=remedy)
    return arms[arm] if arm else next(iter(arms.values()))


def termination(limit: SearchLimit, last: int | None = None) -> Any:
    """OMPL's condition at which a search ends: its limit, or a step before it.

    Each evaluation counts as a step, since a planner may go on without testing a state.

    Args:
        last: the number of the last step; None for that of the limit.
    """

    def is_over() -> bool:
        limit.count()
        return limit.is_over or (last is not None and limit.done >= last)

    return _ompl().base.PlannerTerminationCondition(is_over)


class ArmTask:
    """One arm, where it is, and what is in its way."""

    def __init__(
        self,
        robot: Robot,
        arm: Arm | str,
        *,
        start: Mapping[str, float] | None,
        ignore: Collection[BodyId],
        touch: Collection[BodyId],
        clearance_m: float,
        speed: float,
        base: BasePose | None = None,
        joints: Mapping[BodyId, float] | None = None,
    ) -> None:
        self.robot, self.arm, self.base = robot, find_arm(robot, arm), base
        self.kinematics = RobotKinematics(robot.model)
        self.frame = self.kinematics.frame_of(self.arm)
        by_name = {joint.name: joint for joint in robot.model.joints}
        self.joints = [by_name[name] for name in self.arm.joints]
        self.limits = MotionLimits.of(self.joints, speed=speed)
        self.positions = {**robot.joint_positions(), **(start or {})}
        self.scale = np.array([_SLIDE_SCALE if j.is_prismatic else 1.0 for j in self.joints])
        bounds = np.array([self.kinematics.limits(joint.name) for joint in self.joints])
        self.lower, self.upper = bounds[:, 0], bounds[:, 1]
        self.start = np.array([self.positions[joint.name] for joint in self.joints])
        self.start = np.clip(self.start, self.lower, self.upper)  # limits are soft in simulations
        self.root_pose = robot.base_frame().root_at(robot.base_pose() if base is None else base)
        others = {name: at for name, at in (start or {}).items() if name not in self.arm.joints}
        self.others = np.array(list(others.values()))
        """Positions of joints that are not those of the arm, such as fingers, and stay where they are to be."""
        self.checker = CollisionChecker(
            robot,
            joints=(*self.arm.joints, *others),
            base_moves=base is not None,
            ignore=ignore,
            touch=touch,
            clearance_m=clearance_m,
        )
        for joint, position in (joints or {}).items():
            self.checker.set_joint(joint, position)
        self.step = _STEP
        self.hits: Counter[BodyId | None] = Counter()
        """How often each obstacle was met."""

    def test(self, values: Array) -> Collision | None:
        """See `CollisionChecker.find`."""
        return self.checker.find(np.concatenate([values, self.others]), self.base)

    def collision(self, values: Array) -> Collision | None:
        """As `test`; obstacles are counted."""
        found = self.test(values)
        if found is not None:
            self.hits[found.obstacle] += 1
        return found

    def is_free(self, values: Array) -> bool:
        """Whether a state has no collision; see `collision`."""
        return self.collision(values) is None

    def first_collision(self, a: Array, b: Array) -> Collision | None:
        """The first collision on the straight line between two states in joint space."""
        count = max(1, ceil(float(np.linalg.norm((b - a) / self.scale)) / self.step))
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            if (found := self.collision(a + share * (b - a))) is not None:
                return found
        return None

    def keeps_away(self, trajectory: JointTrajectory) -> bool:
        """Whether a trajectory, as it is executed, keeps nearly the distances that its states have."""
        joints = {joint.name: joint for joint in self.joints}
        state = dict(zip(self.arm.joints, trajectory.points[0].positions, strict=True))
        spline = spline_of(trajectory, robot=self.robot.name, limits=joints, state=state)
        last: Array | None = None
        for t in np.arange(0.0, spline.duration_s, _TEST_PERIOD_S).tolist():
            values, _ = spline.sample(t)
            if last is not None and np.linalg.norm((values - last) / self.scale) < _TEST_STEP:
                continue
            last, found = values, self.test(values)
            if found is not None and found.distance_m < found.least_m - _TEST_SLACK_M:
                return False
        return True

    def unreachable(self, target: str, reason: str, obstacle: BodyId | None = None) -> UnreachableError:
        """The error of this robot."""
        return UnreachableError(self.robot.name, target=target, reason=reason, obstacle=obstacle)

    def nearest_turn(self, values: Array) -> Array:
        """The same state, with continuous joints turned at most half a turn from the start."""
        turns = np.array([joint.type is RobotJointType.CONTINUOUS for joint in self.joints])
        away = (values - self.start + pi) % (2 * pi) - pi
        return np.where(turns, self.start + away, values)


@checked
def plan_arm(
    robot: Robot,
    arm: Arm | str,
    target: Mapping[str, Finite] | PoseLike,
    *,
    free: str = "",
    start: Mapping[str, Finite] | None = None,
    ignore: Collection[BodyId] = (),
    touch: Collection[BodyId] = (),
    clearance_m: Length = CLEARANCE_M,
    speed: Fraction = 0.6,
    max_tests: Count = 40_000,
    cpu_s: WallTime = CPU_S,
    part_of: SearchLimit | None = None,
    base: Point | None = None,
    joints: Mapping[BodyId, Finite] | None = None,
    seed: Seed = 1,
) -> JointTrajectory:
    """Plans a motion of an arm to positions of its joints, or to a pose of its gripper, around all obstacles.

    Args:
        arm: its arm, or the name; empty for the first one.
        target: positions by joint [m or rad], of which those that are left out do not change, a continuous joint less
            than one turn from where it is; or the pose of the grasp frame of the gripper (of the last link of an arm
            without one) in the world frame.
        free: the axes of the grasp frame about which it may turn at the target; see `RobotKinematics.solve_ik`.
        start: positions of joints from which the motion starts, and of others, such as fingers, that stay there; by
            default where they are.
        ignore: bodies that are no obstacles.
        touch: bodies that the gripper may touch.
        clearance_m: the distance to keep from obstacles [m].
        speed: the part of the velocity limits that is used.
        max_tests: number of states that are tested for collisions, after which the search ends.
        cpu_s: processor time after which it ends in any case [s].
        part_of: the limit of a larger search, in which the tests count, too.
        base: where the base is to be: x, y [m] and yaw [rad] in the world frame; None for where it is now.
        joints: positions of joints of the place that are to be somewhere else than now; see
            `CollisionChecker.set_joint`.
        seed: of the random numbers; the same one gives the same path.

    Raises:
        InvalidArgumentError: there is no such arm or joint, or the speed is out of range.
        UnreachableError: the target is beyond a limit or in a collision, or no path was found; with the limit, or the
            obstacle that was met most often.
    """
    limit = SearchLimit(max_tests, cpu_s=cpu_s, part_of=part_of)
    task = ArmTask(
        robot,
        arm,
        start=start,
        ignore=ignore,
        touch=touch,
        clearance_m=clearance_m,
        speed=speed,
        base=base,
        joints=joints,
    )
    goals = _goals(task, target, free)
    for goal in goals[:2]:  # often nothing is in the way
        if task.first_collision(task.start, goal) is None:
            trajectory = _timed(task, np.array([task.start, goal]))
            if task.keeps_away(trajectory):
                return trajectory
    limit.count(task.kinematics.iterations + task.checker.tests)
    for number in range(_TRIALS):
        trajectory = _timed(task, _search(task, goals, _target_text(target), limit, seed + number))
        if task.keeps_away(trajectory):
            break
        task.step /= 2  # it grazes something between two states that were tested
        limit.extend(_MORE_TESTS)
    return trajectory


@checked
def plan_path(
    robot: Robot,
    arm: Arm | str,
    poses: Iterable[PoseLike],
    *,
    free: str = "",
    start: Mapping[str, Finite] | None = None,
    ignore: Collection[BodyId] = (),
    touch: Collection[BodyId] = (),
    clearance_m: Length = CLEARANCE_M,
    speed: Fraction = 0.6,
    max_velocity: Positive = 0.15,
) -> JointTrajectory:
    """Plans a motion of a gripper through poses, such as those of a handle while its door opens, or straight to one.

    Args:
        arm: its arm, or the name; empty for the first one.
        poses: poses of the grasp frame in the world frame; between two of them it moves straight.
        free: the axes of the grasp frame about which it may turn, such as that of a bar that it holds loosely.
        start: positions of joints from which the motion starts; by default where they are.
        ignore: bodies that are no obstacles, such as the door.
        touch: bodies that the gripper may touch.
        clearance_m: the distance to keep from obstacles [m].
        speed: the part of the velocity limits of the joints that is used.
        max_velocity: of the grasp frame [m/s].

    Raises:
        InvalidArgumentError: there is no such arm, or there are no poses.
        UnreachableError: a pose on the way is beyond a limit or in a collision.
    """
    corners = [normalized_pose_array(each) for each in poses]
    if not corners:
        raise InvalidArgumentError("poses", cause="there are none", remedy="give at least one")
    task = ArmTask(robot, arm, start=start, ignore=ignore, touch=touch, clearance_m=clearance_m, speed=speed)
    here = task.kinematics.pose(task.frame, task.positions, root_pose=task.root_pose)
    line = np.concatenate([interpolated_poses(a, b, step_m=_LINE_STEP_M)[1:] for a, b in pairwise([here, *corners])])
    found = follow_poses(
        task.kinematics, task.arm, line, root=task.root_pose, seed=task.positions, free=free, from_seed=True
    )
    for pose, values in zip(line, found.positions, strict=False):
        if (collision := task.collision(values)) is not None:
            raise task.unreachable(_target_text(pose), f"on the line there, {collision}", collision.obstacle)
    if not found.is_complete:
        raise task.unreachable(_target_text(line[found.reached]), f"on the line there, {found.reason}")
    path = spline_path(np.vstack([task.start, found.positions]), task.scale)
    speeds = _speed_limits(task, path.positions, path.parameter, max_velocity)
    return retimed(task.arm.joints, [path], task.limits, speed_limits=[speeds])


# -- parts -------------------------------------------------------------------------------------------------------------


def _target_text(target: Mapping[str, float] | PoseLike) -> str:
    if isinstance(target, Mapping):
        return ", ".join(f"{joint} = {value:.3g}" for joint, value in target.items())
    x, y, z = as_pose(target).position
    return f"({x:.3g}, {y:.3g}, {z:.3g})"


def _goals(task: ArmTask, target: Mapping[str, float] | PoseLike, free: str) -> list[Array]:
    """States without collisions that reach a target, the nearest one first."""
    text = _target_text(target)
    if isinstance(target, Mapping):
        return [_joint_goal(task, target, text)]
    pose = normalized_pose_array(target)
    goals: list[Array] = []
    blocked: Collision | None = None
    solutions = task.kinematics.solutions(
        task.frame, pose, joints=task.arm.joints, seed=task.positions, root_pose=task.root_pose, free=free, attempts=32
    )
    found = 0
    for each in solutions:
        found += 1
        values = task.nearest_turn(np.array([each.positions[name] for name in task.arm.joints]))
        if (collision := task.test(values)) is None:
            goals.append(values)
        elif blocked is None or collision.distance_m > blocked.distance_m:
            blocked = collision
        if len(goals) >= _MAX_GOALS:
            break
    if not found:
        result = task.kinematics.solve_ik(
            task.frame, pose, joints=task.arm.joints, seed=task.positions, root_pose=task.root_pose, free=free
        )
        raise task.unreachable(text, result.reason)
    if not goals:
        assert blocked is not None
        raise task.unreachable(text, f"there {blocked}, in all of {found} configurations", blocked.obstacle)
    return sorted(goals, key=lambda values: float(np.linalg.norm((values - task.start) / task.scale)))


def _joint_goal(task: ArmTask, target: Mapping[str, float], text: str) -> Array:
    """The state with some joints at given positions.

    Raises:
        InvalidArgumentError: a joint is not one of the arm.
        UnreachableError: a position is beyond a limit, or the state is in a collision.
    """
    names = list(task.arm.joints)
    goal = task.start.copy()
    for name, value in target.items():
        if name not in names:
            cause = f"the arm {task.arm.name!r} of {task.robot.name} has no such joint"
            raise InvalidArgumentError(name, cause=cause, remedy=f"give some of {', '.join(names)}")
        row = names.index(name)
        low, high = float(task.lower[row]), float(task.upper[row])
        if not low - 1e-4 <= value <= high + 1e-4:
            side = "lower" if value < low else "upper"
            limit = low if value < low else high
            raise task.unreachable(text, f"the {side} limit of {name} is {limit:.4g} {task.joints[row].unit}")
        if task.joints[row].type is RobotJointType.CONTINUOUS and abs(value - task.start[row]) > 2 * pi:
            raise task.unreachable(text, f"{name} turns without limits, and a plan turns it by at most half a turn")
        goal[row] = np.clip(value, low, high)
    if (collision := task.test(task.nearest_turn(goal))) is not None:
        raise task.unreachable(text, f"there {collision}", collision.obstacle)
    return task.nearest_turn(goal)


def _search(task: ArmTask, goals: Sequence[Array], text: str, limit: SearchLimit, seed: int) -> Array:
    """A path of straight segments in joint space, found by RRT-Connect and shortened.

    Raises:
        UnreachableError: none was found within the limit.
    """
    ompl = load_ompl(seed)
    count = len(task.joints)
    space = ompl.base.RealVectorStateSpace(count)
    bounds = ompl.base.RealVectorBounds(count)
    for row in range(count):
        low, high = task.lower[row], task.upper[row]
        bounds.setLow(row, float(max(low, task.start[row] - pi) if np.isinf(low) else low) / task.scale[row])
        bounds.setHigh(row, float(min(high, task.start[row] + pi) if np.isinf(high) else high) / task.scale[row])
    space.setBounds(bounds)
    setup = ompl.geometric.SimpleSetup(space)

    def values_of(state: Any) -> Array:
        return np.asarray(np.array([state[row] for row in range(count)]) * task.scale)

    def is_valid(state: Any) -> bool:
        limit.count()
        return task.is_free(values_of(state))

    setup.setStateValidityChecker(is_valid)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(task.step / space.getMaximumExtent())
    setup.setStartState(_state(space, task.start / task.scale))
    goal_states = ompl.base.GoalStates(information)
    for goal in goals:
        goal_states.addState(_state(space, goal / task.scale))
    setup.setGoal(goal_states)
    planner = ompl.geometric.RRTConnect(information)
    planner.setRange(_RANGE)
    setup.setPlanner(planner)
    setup.solve(termination(limit))
    if not setup.haveExactSolutionPath():
        raise _not_found(task, text, len(goals), limit)
    limit.extend(_SHORTCUT_TESTS)
    setup.simplifySolution(termination(limit, limit.done + _SHORTCUT_TESTS))
    path = setup.getSolutionPath()
    return np.array([values_of(path.getState(row)) for row in range(path.getStateCount())])


def _state(space: Any, values: Array) -> Any:
    state = space.allocState()
    for row, value in enumerate(values.tolist()):
        state[row] = value
    return state


def _not_found(task: ArmTask, text: str, goals: int, limit: SearchLimit) -> UnreachableError:
    own = set(task.robot.placed.link_ids.values())
    hits = {obstacle: count for obstacle, count in task.hits.most_common() if obstacle is not None}
    most = max(hits.values(), default=0)
    frequent = [obstacle for obstacle, count in hits.items() if count > _FREQUENT * most]
    others = [obstacle for obstacle in frequent if obstacle not in own]
    names = ", ".join(others[:3]) or ", ".join(f"its own {obstacle}" for obstacle in frequent[:3])
    where = f" to any of {goals} configurations there" if goals > 1 else ""
    blocked = f"; {names} in the way" if names else ""
    obstacle = next(iter(others or frequent), None)
    return task.unreachable(text, f"no way was found {limit}{where}{blocked}", obstacle)


def _timed(task: ArmTask, points: Array) -> JointTrajectory:
    """A trajectory along straight segments in joint space, with rounded corners."""
    pieces = rounded_polyline(points, task.scale, task.is_free) or [resting_path(points[0])]
    return retimed(task.arm.joints, pieces, task.limits)


def _speed_limits(task: ArmTask, positions: Array, parameter: Array, max_velocity: float) -> Array:
    """For each sample of a path, how quickly its parameter may change so that the grasp frame is not too quick."""
    places = np.array(
        [
            task.kinematics.pose(task.frame, {**task.positions, **dict(zip(task.arm.joints, row, strict=True))})[:3]
            for row in positions.tolist()
        ]
    )
    slopes = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(parameter)
    steepest = np.maximum(np.concatenate([slopes[:1], slopes]), np.concatenate([slopes, slopes[-1:]]))
    return np.asarray(max_velocity / np.maximum(steepest, 1e-9), dtype=np.float64)
