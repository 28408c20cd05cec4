"""One arm with its gripper and the base that carries it, as skills move them.

Every method that takes time is a generator of simulated times [s]; it fails with what stopped the robot and what to
try.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from functools import cached_property
from itertools import product
from math import atan2, cos, hypot, inf, isfinite, pi, sin

import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import Capability, Engine
from mindstage.errors import UnreachableError
from mindstage.robots.arm_paths import POSE_JOINTS, ArmPath, follow_poses, interpolated_poses, timed
from mindstage.robots.collisions import CLEARANCE_M, Collision, CollisionChecker, HandChecker
from mindstage.robots.control import MotionFailure, MotionOutcome, MotionResult
from mindstage.robots.floor_poses import BaseFrame, BasePose, wrapped
from mindstage.robots.models.link_tree import LinkTree
from mindstage.robots.models.robot_model import Arm, BaseType, Gripper, RobotModel
from mindstage.robots.navigation import FloorMap, plan_base
from mindstage.robots.planning import plan_arm
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.robots.search_limits import SearchLimit
from mindstage.robots.skill_declaration import SkillMotion
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills.grasps import GripperShape
from mindstage.robots.trajectories import JointTrajectory
from mindstage.scene import BodyId
from mindstage.scene.transforms import (
    Array,
    pose_inverse,
    pose_multiply,
    quat_angle,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
)

__all__ = [
    "Manipulator",
    "free_hand",
    "guarded",
    "hand_with",
    "hands_of",
    "is_near",
    "with_lift",
]

_BASE_GAIN = 3.0
"""Velocity of the base by its error [1/s]."""
_TICK_S = 0.04
"""The interval at which the base is commanded while it moves with the arm [s]."""
_PLANNING_TESTS = 120_000
"""Number of states that are tested for one plan of an arm."""
_OPENING_TOLERANCE_M = 0.03
"""An opening that is smaller than wanted by less is enough: what is grasped has room."""
_SPEED, _HELD_SPEED = 0.6, 0.3
"""Fractions of the velocity limits of the joints, without and with a thing in the hand."""
_HELD_SPEED_FACTOR = 0.5
"""Factor of all speeds with a thing in the hand."""
_HELD_CLEARANCE_M = 0.015
"""Distance that what is held keeps from the place if there is room [m]."""
_ONE_SIDED_M = 0.15
"""An arm whose hand is so far from the middle of the base reaches to one side [m]."""
_PROBE = 0.02
"""Motion of a joint by which its effect on the hand is found [m or rad]."""
_LEVEL_RAD = 0.1
"""Inclination up to which a direction counts as level, or an axis as vertical."""
_CHECKED_EVERY = 2
"""Of the poses of a path, every second one is tested for collisions."""
_WITHDRAWING_MPS = 0.12
"""Speed of a hand that withdraws [m/s]: a door that its fingers drag along may come against the base."""
_WITHDRAWING_FREE = {True: ("", "z", "yz"), False: ("",)}
"""Axes of the grasp frame about which a hand may turn that withdraws, if its arm needs the base, and if not: none, else
the bar that was between its fingers, else also the direction in which they close."""
_FOLLOWING_SPEED = 0.15
"""Fraction of its velocity limits with which a base moves along with an arm."""
_EMPTY_M = 0.003
"""A closed gripper with a smaller opening has nothing between its fingers, where contacts are not known."""
_GUARD_S = 0.012
"""Simulated time between two looks at the contacts [s]."""
_GRIP_FORCES = (1.0, 0.7, 0.5)
"""Fractions of the force with which the fingers close, until they are not pressed too deep; the last one has to do."""
_FOLDED = 0.02
"""An arm whose joints are all nearer to their rest positions is folded [m or rad]."""
_ON_LINE_M, _ON_LINE_RAD = 0.01, 0.1
"""A hand that is nearer to the straight line to a grasp is on it."""
_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])
_MAX_DEPTH_M = 0.003
"""A motion ends when a part of the robot is pressed deeper than this into something."""
_DEEPER_M = 0.0005
"""What was pressed before a motion may be so much deeper during it."""
_PARKING_TESTS = 50_000
"""The same for a way of the arm to its rest position, before the base moves."""
_ROOMS_M = (0.35, 0.5, 0.2)
"""How far the base drives away to give an arm room."""
_ROOM_TESTS = 10_000
"""Number of poses that are tested for ways there."""
_NEAR_M, _NEAR_RAD = 0.02, 0.04
"""A base that is nearer to where it is to stand does not drive."""


def is_near(base: BasePose, here: BasePose) -> bool:
    """Whether a place is so near to where the base is that it does not drive there."""
    turn = abs(wrapped(base[2] - here[2]))
    return hypot(base[0] - here[0], base[1] - here[1]) < _NEAR_M and turn < _NEAR_RAD


def _pressed(task: SkillTask, own: frozenset[BodyId]) -> dict[tuple[BodyId, BodyId | None], float]:
    """The contacts of a robot's links that are too deep, with their depths [m], the deepest first."""

    def read(engine: Engine) -> dict[tuple[BodyId, BodyId | None], float]:
        if Capability.CONTACTS not in engine.capabilities:
            return {}
        deep = [each for each in engine.contacts() if each.depth_m > _MAX_DEPTH_M and (each.a in own or each.b in own)]
        return {
            (each.a, each.b) if each.a in own or each.b is None else (each.b, each.a): each.depth_m
            for each in sorted(deep, key=lambda each: -each.depth_m)
        }

    return task.session.engine.run(read, label="contacts")


def guarded(task: SkillTask, motion: Generator[float, None, MotionResult]) -> Generator[float, None, MotionResult]:
    """A motion of the robot that is halted when a part of it is pressed into something."""
    own = frozenset(task.robot.link_ids.values())
    before = _pressed(task, own)
    try:
        while True:
            try:
                duration_s = next(motion)
            except StopIteration as end:
                result: MotionResult = end.value
                return result
            while duration_s > 0.0:  # in the least steps in which drives are commanded nothing gets deep
                yield min(duration_s, _GUARD_S)
                duration_s -= _GUARD_S
                now = _pressed(task, own)
                deeper = [pair for pair, depth_m in now.items() if depth_m > before.get(pair, 0.0) + _DEEPER_M]
                if deeper:
                    task.robot.halt()
                    a, b = deeper[0]
                    reason = f"{a} is pressed {now[deeper[0]] * 1000:.1f} mm into {b}"
                    obstacles = () if b is None else (b,)
                    return MotionResult(
                        outcome=MotionOutcome.FAILED, reason=reason, failure=MotionFailure.BLOCKED, obstacles=obstacles
                    )
    finally:
        motion.close()


class Manipulator:
    """One arm, its gripper and the base."""

    def __init__(self, task: SkillTask, arm: Arm, kinematics: RobotKinematics) -> None:
        """Moves nothing.

        Args:
            arm: an arm with a gripper.
        """
        self.task = task
        self.robot = task.robot
        self.arm = arm
        self.kinematics = kinematics
        self.gripper: Gripper = next(each for each in self.robot.model.grippers if each.name == arm.gripper)
        self.shape = GripperShape.of(self.robot.model, self.gripper, kinematics)
        self._joints = {joint.name: joint for joint in self.robot.model.joints}

    # -- state -------------------------------------------------------------------------------------------------------

    @property
    def is_mobile(self) -> bool:
        """Whether the robot has a base that drives."""
        return self.robot.model.base.type is not BaseType.FIXED

    @property
    def needs_base(self) -> bool:
        """Whether the arm has too few joints to take its hand to any pose without the base."""
        return self.is_mobile and len(self.arm.joints) < POSE_JOINTS

    @property
    def withdrawing_free(self) -> tuple[str, ...]:
        """Axes of the grasp frame about which the hand may turn when it withdraws, the preferred ones first.

        An arm with few joints does not keep the direction of its hand everywhere, as when its slides are drawn in.
        """
        return _WITHDRAWING_FREE[self.needs_base]

    def is_slide(self, joint: str) -> bool:
        """Whether a joint is prismatic."""
        return self._joints[joint].is_prismatic

    def ready_positions(self) -> dict[str, float]:
        """Positions of the arm in which it can move in every direction: slides at half their range, hinges near 0.

        With a thing in the hand the hinges that incline it are where they are now.
        """
        found, now = {}, self.robot.joint_positions() if self.held is not None else {}
        turning = self.turning_joints() if now else ()
        for name in self.arm.joints:
            low, high = self.kinematics.limits(name)
            if self.is_slide(name) and high - low < inf:
                found[name] = (low + high) / 2
            else:
                found[name] = min(max(0.0 if name in turning else now.get(name, 0.0), low), high)
        return found

    def turning_joints(self) -> tuple[str, ...]:
        """The hinges of the arm that turn its hand about a vertical axis, without inclining it."""
        now, here = self.robot.joint_positions(), self.grasp_pose
        found = list[str]()
        for name in self.arm.joints:
            if not self.is_slide(name):
                moved = self._moved_by(name, now)
                turn = quat_multiply(moved[3:], quat_conjugate(here[3:]))
                if float(np.hypot(turn[1], turn[2])) < _LEVEL_RAD * _PROBE:
                    found.append(name)
        return tuple(found)

    def level_slides(self) -> tuple[str, ...]:
        """The slides of the arm that do not lift its hand."""
        now, height = self.robot.joint_positions(), self.grasp_pose[2]
        slides = (name for name in self.arm.joints if self.is_slide(name))
        return tuple(name for name in slides if abs(self._moved_by(name, now)[2] - height) < _LEVEL_RAD * _PROBE)

    def _moved_by(self, joint: str, now: Mapping[str, float]) -> Array:
        """The pose of the grasp frame after a small motion of a joint."""
        moved = {**now, joint: now[joint] + _PROBE}
        return self.kinematics.pose(self.kinematics.frame_of(self.arm), moved, root_pose=self.root_pose)

    @cached_property
    def side(self) -> float:
        """The direction in which an arm reaches that needs the base, relative to the base's own [rad]; else 0."""
        if not self.needs_base:
            return 0.0
        root = self.base_frame.root_at((0.0, 0.0, 0.0))
        x, y = self.kinematics.pose(self.kinematics.frame_of(self.arm), self.ready_positions(), root_pose=root)[:2]
        return atan2(y, x) if hypot(x, y) > _ONE_SIDED_M else 0.0

    @cached_property
    def up(self) -> float:
        """The vertical component of the z axis of the hand of an arm that needs the base, before it turns; else 0."""
        if not self.needs_base:
            return 0.0
        pose = self.kinematics.pose(
            self.kinematics.frame_of(self.arm), self.ready_positions(), root_pose=self.root_pose
        )
        return float(quat_rotate(pose[3:], (0.0, 0.0, 1.0))[2])

    @property
    def root_pose(self) -> Array:
        """The present pose of the root link in the world frame."""
        return self.robot.link_pose(self.robot.model.root)

    @property
    def grasp_pose(self) -> Array:
        """The present pose of the grasp frame in the world frame."""
        return self.robot.grasp_pose(self.gripper.name)

    @property
    def rest_positions(self) -> dict[str, float]:
        """The positions of the folded arm [m or rad]; empty if it has none."""
        return dict(zip(self.arm.joints, self.arm.rest_positions, strict=False))

    @property
    def is_folded(self) -> bool:
        """Whether the arm is folded, or cannot be."""
        now = self.robot.joint_positions()
        return all(abs(now[name] - position) < _FOLDED for name, position in self.rest_positions.items())

    def distance_before(self, at: Array) -> float:
        """How far the hand is in front of a grasp if it is on the straight line to it [m]; infinite if it is not.

        It may be in front of a handle that it has moved before, where it has no room to withdraw any farther.

        Args:
            at: the pose of the grasp frame at the grasp, in the world frame.
        """
        offset = pose_multiply(pose_inverse(at), self.grasp_pose)
        turn = float(quat_angle(offset[3:], _NO_TURN))
        if offset[0] > _ON_LINE_M or np.hypot(*offset[1:3]) > _ON_LINE_M or turn > _ON_LINE_RAD:
            return inf
        return max(-float(offset[0]), 0.0)

    def hit_before(self, checker: HandChecker, at: Array, back_m: float, opening_m: float) -> Collision | None:
        """What the gripper alone touches at a grasp, or on the straight line to it; None if it is free.

        Args:
            checker: of this gripper.
            at: the pose of the grasp frame at the grasp, in the world frame.
            back_m: length of the line [m]; less if the hand is on it already.
            opening_m: how far the gripper is open [m].
        """
        length_m = min(back_m, self.distance_before(at))
        fingers = self.fingers_at(opening_m)
        for part in (0.0, 0.5, 1.0):
            place = pose_multiply(at, np.array([-part * length_m, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
            if (hit := checker.find(place, fingers, strictly=True)) is not None:
                return hit
        return None

    @property
    def held(self) -> BodyId | None:
        """What the gripper holds."""
        return self.robot.held.get(self.gripper.name)

    def fingers_at(self, opening_m: float) -> dict[str, float]:
        """The positions of the fingers at an opening of the gripper [m or rad]."""
        share = min(max(opening_m / self.gripper.max_opening_m, 0.0), 1.0)
        closed, opened = np.array(self.gripper.closed_positions), np.array(self.gripper.open_positions)
        return dict(zip(self.gripper.joints, (closed + share * (opened - closed)).tolist(), strict=True))

    @cached_property
    def base_frame(self) -> BaseFrame:
        """Where the root link is for a pose of the base: read once, since it hardly changes."""
        return self.robot.base_frame()

    # -- base --------------------------------------------------------------------------------------------------------

    def driving_to(self, base: BasePose, *, why: str, ignore: Collection[BodyId] = ()) -> SkillMotion:
        """Drives on a free path; does nothing if it is there.

        Args:
            base: where to.
            why: what for, for the report.
            ignore: bodies that are no obstacles.
        """
        if is_near(base, self.robot.base_pose()):
            return
        with self.task.step("drive", f"drive to ({base[0]:.2f}, {base[1]:.2f}) {why}"):
            path = plan_base(self.robot, base, ignore=ignore, part_of=self.task.limit)
            speed = 1.0 if self.held is None else _HELD_SPEED_FACTOR
            result = yield from guarded(self.task, self.robot.driving(path, speed=speed))
            self._require(result, "let the robot start from somewhere else, or move what is in its way")

    # -- arm ---------------------------------------------------------------------------------------------------------

    def moving_to(
        self,
        target: Mapping[str, float] | Array,
        *,
        why: str,
        touch: Collection[BodyId] = (),
        free: str = "",
        max_tests: int = _PLANNING_TESTS,
    ) -> SkillMotion:
        """Moves the arm on a collision-free path to positions of its joints, or to a pose of the grasp frame.

        Args:
            target: the positions [m or rad], or the pose in the world frame.
            why: what for, for the report.
            touch: bodies that the gripper, or what it holds, may touch.
            free: axes of the grasp frame about which it may turn at the end.
            max_tests: number of states that the search tests before it ends.
        """
        with self.task.step("move", f"move the arm {why}"):
            trajectory = self._plan(target, touch, free, max_tests)
            result = yield from guarded(self.task, self.robot.following(trajectory))
            self._require(result, "move what is in the way of the arm")

    def _plan(
        self, target: Mapping[str, float] | Array, touch: Collection[BodyId], free: str, max_tests: int
    ) -> JointTrajectory:
        """A way of the arm; with a thing in the hand, which may swing, slowly and with more clearance if possible."""
        holds = self.held is not None
        for clearance_m in (_HELD_CLEARANCE_M, CLEARANCE_M) if holds else (CLEARANCE_M,):
            try:
                return plan_arm(
                    self.robot,
                    self.arm,
                    target,
                    free=free,
                    touch=touch,
                    clearance_m=clearance_m,
                    speed=_HELD_SPEED if holds else _SPEED,
                    max_tests=max_tests,
                    part_of=self.task.limit,
                    seed=self.task.seed + 1,
                )
            except UnreachableError:
                if clearance_m == CLEARANCE_M:
                    raise
        raise AssertionError("the last attempt returns or raises")

    def moving_straight(self, target: Array, *, why: str, speed: float = 0.3, may_touch: bool = False) -> SkillMotion:
        """Moves the grasp frame on a straight line, without a test for collisions.

        Args:
            target: its pose at the end, in the world frame.
            why: what for, for the report.
            speed: fraction of the velocity limits.
            may_touch: whether it is enough to be stopped by a contact on the way.
        """
        with self.task.step("move", f"move the gripper {why}"):
            path = self.path(interpolated_poses(self.grasp_pose, target), may_drive=self.is_mobile)
            if not path.is_complete:
                raise self.task.failure(f"the gripper cannot move straight {why}: {path.reason}", "stand elsewhere")
            result = yield from self.following(path, speed=speed)
            if not (may_touch and result.failure is MotionFailure.BLOCKED):
                self._require(result, "approach it from another side")

    def withdrawing(self, length_m: float, *, touch: Collection[BodyId] = ()) -> SkillMotion:
        """Moves the grasp frame straight back, as far as the arm and the base follow, or until a contact.

        A hand that cannot keep its direction turns about what was between its fingers.

        Args:
            length_m: how far, against its x axis.
            touch: bodies that the gripper may touch.
        """
        target = pose_multiply(self.grasp_pose, np.array([-length_m, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
        poses = interpolated_poses(self.grasp_pose, target)
        path: ArmPath | None = None
        for free in self.withdrawing_free:
            found = self.free_part(self.path(poses, free=free, may_drive=self.is_mobile), touch=touch)
            path = found if path is None else max(path, found, key=lambda each: each.reached)
            if path.reached == len(poses):
                break
        assert path is not None
        if path.reached >= 2:
            yield from self.following(path, speed=0.3, cartesian_speed=_WITHDRAWING_MPS)

    def free_part(
        self,
        path: ArmPath,
        *,
        touch: Collection[BodyId],
        joint: BodyId | None = None,
        joint_positions: Sequence[float] = (),
    ) -> ArmPath:
        """The first part of a path from the present state, up to a collision.

        Args:
            touch: bodies that the gripper may touch.
            joint: of a door or drawer that moves along; None for none.
            joint_positions: for each pose of the path, its position [m or rad].
        """
        checker = CollisionChecker(self.robot, joints=self.arm.joints, base_moves=self.is_mobile, touch=touch)
        for row in range(1, path.reached):
            if row % _CHECKED_EVERY and row < path.reached - 1:
                continue
            if joint is not None:
                checker.set_joint(joint, joint_positions[row])
            hit = checker.find_at(path.at(row), self.base_frame.base_at(path.roots[row]) if self.is_mobile else None)
            if hit is not None:
                return path.cut(max(row - _CHECKED_EVERY, 1), f"there {hit}")
        return path

    def path(self, poses: Array, *, free: str = "", may_drive: bool = False, guide: ArmPath | None = None) -> ArmPath:
        """The motion of the arm from its present state along poses of the grasp frame, n x 7; see `follow_poses`."""
        now = self.robot.joint_positions()
        found = follow_poses(
            self.kinematics,
            self.arm,
            poses,
            root=self.root_pose,
            seed=now,
            free=free,
            may_drive=may_drive,
            from_seed=True,
            guide=guide,
        )
        if found.reached:
            # Its first pose is the present one; a load may press a joint a little beyond its limit, which is refused.
            limits = np.array([self.kinematics.limits(name) for name in found.joints])
            found.positions[0] = np.clip([now[name] for name in found.joints], *limits.T)
        return found

    def following(
        self,
        path: ArmPath,
        *,
        speed: float = 0.3,
        on_tick: Callable[[], object] | None = None,
        cartesian_speed: float = 0.25,
    ) -> Generator[float, None, MotionResult]:
        """Moves the arm along a path, and the base with it.

        Args:
            path: the path, from the present state.
            speed: fraction of the velocity limits of the joints.
            on_tick: called in each control interval; it may raise to end the motion.
            cartesian_speed: largest speed of the grasp frame [m/s].
        """
        if len(path.positions) < 2:
            return MotionResult(outcome=MotionOutcome.SUCCEEDED)
        least = self._least_durations(path, cartesian_speed)
        trajectory = timed(path, self._joints, speed=speed, least_s=least)
        times = np.array([point.time_s for point in trajectory.points])
        bases = np.array([self.base_frame.base_at(root) for root in path.roots])
        bases[:, 2] = np.unwrap(bases[:, 2])
        motion = guarded(self.task, self.robot.following(trajectory))
        start_s = self.task.time_s
        try:
            while True:
                try:
                    duration_s = next(motion)
                except StopIteration as end:
                    result: MotionResult = end.value
                    return result
                if path.moves_base:
                    duration_s = min(duration_s, _TICK_S)
                    self._steer(self.task.time_s - start_s, times, bases)
                yield duration_s
                if on_tick is not None:
                    on_tick()
        finally:
            motion.close()
            if path.moves_base:
                self.robot.drive(0.0, 0.0, 0.0)

    def _least_durations(self, path: ArmPath, cartesian_speed: float) -> Array:
        frame = self.kinematics.frame_of(self.arm)
        tips = np.array(
            [self.kinematics.pose(frame, path.at(row), root_pose=root)[:3] for row, root in enumerate(path.roots)]
        )
        least = np.linalg.norm(np.diff(tips, axis=0), axis=1) / cartesian_speed
        if path.moves_base:
            base = self.robot.model.base
            bases = np.array([self.base_frame.base_at(root) for root in path.roots])
            steps = np.diff(bases, axis=0)
            turns = np.abs(np.diff(np.unwrap(bases[:, 2])))
            drive = np.hypot(steps[:, 0], steps[:, 1]) / (_FOLLOWING_SPEED * base.velocity)
            least = np.maximum(least, np.maximum(drive, turns / (_FOLLOWING_SPEED * base.turn_velocity)))
        return np.asarray(least)

    def _steer(self, at_s: float, times: Array, bases: Array) -> None:
        """Commands the velocity of the base that follows a path of it."""
        ahead_s = min(at_s + _TICK_S, float(times[-1]))
        goal, later = (np.array([np.interp(t, times, column) for column in bases.T]) for t in (at_s, ahead_s))
        here = np.array(self.robot.base_pose())
        error = goal - here
        error[2] = wrapped(error[2])
        velocity = (later - goal) / _TICK_S + _BASE_GAIN * error
        c, s = cos(here[2]), sin(here[2])
        forward, left = c * velocity[0] + s * velocity[1], -s * velocity[0] + c * velocity[1]
        base = self.robot.model.base
        if base.type is BaseType.DIFFERENTIAL:
            left = 0.0
        scale = max(1.0, hypot(forward, left) / base.velocity, abs(velocity[2]) / base.turn_velocity)
        self.robot.drive(float(forward / scale), float(left / scale), float(velocity[2] / scale))

    # -- gripper -----------------------------------------------------------------------------------------------------

    def opening(self, opening_m: float | None = None) -> SkillMotion:
        """Opens the gripper, fully or by an opening [m]."""
        wanted = self.gripper.max_opening_m if opening_m is None else min(opening_m, self.gripper.max_opening_m)
        with self.task.step("open gripper", f"open the gripper by {wanted * 100:.1f} cm"):
            result = yield from guarded(self.task, self.robot.gripping(self.gripper.name, wanted))
            if self.robot.opening(self.gripper.name) < wanted - _OPENING_TOLERANCE_M:
                self._require(result, "give the fingers room")

    def closing_on(self, *things: BodyId) -> SkillMotion:
        """Closes the gripper on a thing.

        Args:
            things: the thing, and bodies that belong to it.

        Raises:
            SkillFailedError: the fingers do not touch any of them from both sides.
        """
        yield from self.closing()
        if self.task.session.engine.run(_reads_contacts, label="capabilities"):
            is_between = self.held in things
        else:
            is_between = self.robot.opening(self.gripper.name) > _EMPTY_M
        if not is_between:
            raise self.task.failure(f"the gripper closed without {things[0]} between its fingers", "approach it again")

    def closing(self) -> SkillMotion:
        """Closes the gripper with the largest force that presses the fingers nowhere too deep."""
        with self.task.step("close gripper", "close the gripper"):
            for part in _GRIP_FORCES:
                force_n = part * self.gripper.max_force_n
                motion = self.robot.gripping(self.gripper.name, 0.0, max_force_n=force_n)
                result = yield from (motion if part == _GRIP_FORCES[-1] else guarded(self.task, motion))
                if result.failure is not MotionFailure.BLOCKED:
                    break

    def parking(self, *, touch: Collection[BodyId] = ()) -> SkillMotion:
        """Folds the arm."""
        if self.is_folded:
            return
        rest = self.rest_positions
        try:
            yield from self.moving_to(rest, why="to its rest position", touch=touch, max_tests=_PARKING_TESTS)
        except UnreachableError:
            if not self.is_mobile:
                raise
            yield from self._making_room(rest)
            yield from self.moving_to(rest, why="to its rest position", touch=touch)

    def _making_room(self, rest: Mapping[str, float]) -> SkillMotion:
        """Drives a little away from what is in front of the robot, to where the arm can be folded.

        Args:
            rest: positions of the folded arm [m or rad].

        Raises:
            UnreachableError: there is no room.
        """
        x, y, yaw = self.robot.base_pose()
        error: UnreachableError | None = None
        checker = CollisionChecker(self.robot, joints=self.arm.joints, base_moves=True)
        floor = FloorMap(self.robot)
        turns = (pi, 0.75 * pi, -0.75 * pi, pi / 2, -pi / 2)
        places = [
            (x + distance * cos(yaw + turn), y + distance * sin(yaw + turn), yaw)
            for distance, turn in product(_ROOMS_M, turns)
        ]
        limit = SearchLimit(_ROOM_TESTS, part_of=self.task.limit)
        for max_tests, away in product((0, _ROOM_TESTS), places):  # nothing is searched if a straight way is free
            try:
                if (hit := checker.find_at(rest, away)) is not None:
                    raise UnreachableError(self.robot.name, target="its rest position", reason=f"there {hit}")
                path = plan_base(self.robot, away, max_tests=max_tests, part_of=limit, floor=floor)
            except UnreachableError as found:
                error = found
                continue
            distance = hypot(away[0] - x, away[1] - y)
            with self.task.step("drive", f"drive {distance:.2g} m away to give the arm room"):
                self._require((yield from guarded(self.task, self.robot.driving(path))), "move what is in its way")
            return
        assert error is not None
        raise error

    def _require(self, result: MotionResult, suggestion: str) -> None:
        """Raises if a motion did not succeed."""
        if not result:
            raise self.task.failure(result.reason or str(result.outcome), suggestion)


def _reads_contacts(engine: Engine) -> bool:
    return Capability.CONTACTS in engine.capabilities


def hands_of(task: SkillTask) -> list[Manipulator]:
    """The arms with grippers."""
    model = task.robot.model
    return [Manipulator(task, with_lift(model, arm), task.kinematics) for arm in model.arms if arm.gripper is not None]


def with_lift(model: RobotModel, arm: Arm) -> Arm:
    """An arm with the lifts below it that it shares with other arms, as the torso of PR2.

    In a model they are part of no arm, so that arms are moved independently; a skill moves one at a time. A folded arm
    leaves them where they are, since they are slow.
    """
    below = LinkTree(model.links, model.joints).ancestors(arm.base_link)
    lifts = [each.name for each in below if each.is_actuated and each.is_prismatic and isfinite(sum(each.limits))]
    return replace(arm, joints=(*arm.joints, *(name for name in lifts if name not in arm.joints)))


def free_hand(task: SkillTask, why: str) -> Manipulator:
    """An arm whose gripper holds nothing.

    Raises:
        SkillFailedError: all grippers hold something.
    """
    hands = hands_of(task)
    for hand in hands:
        if hand.held is None:
            return hand
    held = ", ".join(str(hand.held) for hand in hands)
    raise task.failure(f"no gripper is free {why}: held is {held}", f"place {held} first")


def hand_with(task: SkillTask, thing: BodyId | None = None) -> Manipulator | None:
    """The arm whose gripper holds a thing, or anything; None if none does."""
    return next((hand for hand in hands_of(task) if hand.held is not None and thing in {None, hand.held}), None)
