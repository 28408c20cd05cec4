"""Where a robot stands so that an arm reaches poses, and which points an arm reaches from where it stands.

Places around the targets are sampled. Those that the base can drive to are tested: inverse kinematics for each target,
and collisions of the whole robot in the positions found, and with the arm at rest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from math import atan2, ceil, cos, hypot, inf, pi, sin
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.errors import InvalidArgumentError, UnreachableError
from mindstage.ranges import Count, Length, WallTime, checked
from mindstage.robots.collisions import CLEARANCE_M, CollisionChecker
from mindstage.robots.floor_poses import BasePose, wrapped
from mindstage.robots.models.robot_model import Arm, BaseType
from mindstage.robots.navigation import FloorMap
from mindstage.robots.planning import ArmTask, find_arm
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import BASE_JOINTS, RobotKinematics
from mindstage.robots.search_limits import CPU_S, SearchLimit
from mindstage.scene import BodyId, PoseLike
from mindstage.scene.transforms import Array, normalized_pose_array

__all__ = ["BasePlacement", "find_base_placements", "reachable_region"]

_DISTANCE_STEP_M = 0.1
_BEARING_COUNT = 16
_HEADINGS_RAD = (0.0, 0.4, -0.4, 0.9, -0.9)
"""Headings relative to that towards the targets, the preferred first."""
_IK_ATTEMPTS = 4
_SAMPLES = 600
"""Number of random positions of an arm by which its reach is estimated."""
_ONE_SIDED_M = 0.15
"""An arm whose grasp frame is so far from the base on average reaches to one side [m]."""
_MAX_ADJUSTMENT_M = 0.35
_DRIVE_WEIGHT = 0.05
"""Loss of score for a way of 1 m; the score is at most 1."""
_MOVE_COST = 0.1
"""Loss of score for any way at all."""
_HEADING_WEIGHT = 0.1
"""Loss of score for each radian by which the base faces aside."""
_TRIALS_PER_ANSWER = 12
"""Number of places that are tried for each one that is asked for, before the search ends."""
_REGION_ATTEMPTS = 3


class BasePlacement(msgspec.Struct, frozen=True, kw_only=True):
    """A place of the base from which an arm reaches all targets."""

    base: BasePose
    """x, y [m] and yaw [rad] of the base in the world frame."""
    positions: tuple[Mapping[str, float], ...]
    """Positions of the arm's joints for each target [m or rad]."""
    score: float
    """Higher is better: the smallest distance of a joint from its limits as part of half its range, less what a long
    way there costs."""
    drive_m: float
    """Length of the way there [m]; 0 if the base is there."""


class _Reason(NamedTuple):
    text: str
    obstacle: BodyId | None = None


class _Placing(ArmTask):
    """The task of finding a place."""

    def __init__(
        self,
        robot: Robot,
        arm: Arm | str,
        targets: Iterable[PoseLike],
        *,
        free: str,
        ignore: Collection[BodyId],
        touch: Collection[BodyId],
        clearance_m: float,
    ) -> None:
        here = robot.base_pose()
        super().__init__(
            robot, arm, start=None, ignore=ignore, touch=touch, clearance_m=clearance_m, speed=1.0, base=here
        )
        self.free, self.here = free, here
        self.targets = np.array([normalized_pose_array(each) for each in targets])
        if not len(self.targets):
            raise InvalidArgumentError("targets", cause="there are none", remedy="give at least one pose")
        self.rest = dict(zip(self.arm.joints, self.arm.rest_positions, strict=False))
        self.base_frame = robot.base_frame()
        self.floor = FloorMap(robot, ignore=ignore)
        self.reasons: Counter[_Reason] = Counter()
        self.is_limited = np.isfinite(self.upper - self.lower)
        low, high = _ranges(self.kinematics, self.arm)
        self.middle, self.half = (low + high) / 2, (high - low) / 2
        points = _sampled_points(self.kinematics, self.arm, self.positions, self.base_frame.root_at((0.0, 0.0, 0.0)))
        x, y = points.mean(axis=0).tolist()
        self.reach_m = float(np.hypot(*points.T).max())
        """The largest horizontal distance of the grasp frame from the base [m]."""
        self.side = atan2(y, x) if hypot(x, y) > _ONE_SIDED_M else 0.0
        """Its mean direction from there [rad]."""

    def candidates(self, max_distance_m: float | None) -> Iterator[tuple[BasePose, float]]:
        """Places that the base can drive to with a part of their score, in an order that covers all sides early."""
        middle, reach_m = self.targets[:, :2].mean(axis=0), max_distance_m or self.reach_m
        x, y, yaw = self.here
        yield (x, y, yaw), 0.0
        away = atan2(y - middle[1], x - middle[0])
        distances = np.arange(0.3, reach_m + 1e-9, _DISTANCE_STEP_M).tolist()
        order = sorted(distances, key=lambda each: abs(each - 0.6 * reach_m))
        found: list[tuple[float, BasePose, float]] = []
        for ring, distance in enumerate(order):
            for number in range(_BEARING_COUNT):
                bearing = away + 2 * pi * (number + 0.5 * (ring % 2)) / _BEARING_COUNT
                px, py = float(middle[0] + distance * cos(bearing)), float(middle[1] + distance * sin(bearing))
                length = self.floor.length_to(px, py)
                if length is None:
                    continue
                for offset in _HEADINGS_RAD:
                    cost = _DRIVE_WEIGHT * length + _HEADING_WEIGHT * abs(offset)
                    found.append((cost + 0.02 * ring, (px, py, wrapped(bearing + pi - self.side + offset)), length))
        for _, base, length in sorted(found, key=lambda each: each[0]):
            yield base, length

    def placement(self, base: BasePose, drive_m: float) -> BasePlacement | None:
        """A place with positions for all targets; None if one is not reached, or there is a collision.

        Where the arm alone does not reach the first target, as one with few joints, the base is moved a little.
        """
        first = self._reaching(self.targets[0], self.positions, base)
        if isinstance(first, _Reason) and first.obstacle is None and (near := self._adjusted(base)) is not None:
            base = near
            length = self.floor.length_to(base[0], base[1])
            if length is None:
                return None
            drive_m, first = length, self._reaching(self.targets[0], self.positions, base)
        if isinstance(first, _Reason):
            self.reasons[first] += 1
            return None
        parked = self.checker.find_at({**self.positions, **self.rest}, base)
        if parked is not None:
            self.reasons[_Reason(f"the base has no room: {parked}", parked.obstacle)] += 1
            return None
        found = [first]
        for target in self.targets[1:]:
            seed = {**self.positions, **dict(zip(self.arm.joints, found[-1].tolist(), strict=True))}
            values = self._reaching(target, seed, base)
            if isinstance(values, _Reason):
                self.reasons[values] += 1
                return None
            found.append(values)
        away = np.where(self.is_limited, 1.0 - np.abs(np.array(found) - self.middle) / self.half, 1.0)
        heading = abs(wrapped(base[2] + self.side - self._facing(base)))
        moving = _MOVE_COST if base != self.here else 0.0
        score = float(away.min()) - moving - _DRIVE_WEIGHT * drive_m - _HEADING_WEIGHT * heading
        positions = tuple(dict(zip(self.arm.joints, values.tolist(), strict=True)) for values in found)
        return BasePlacement(base=base, positions=positions, score=score, drive_m=drive_m)

    def _adjusted(self, base: BasePose) -> BasePose | None:
        """A place near another one from which the arm reaches the first target."""
        result = self.kinematics.solve_ik(
            self.frame,
            self.targets[0],
            joints=(*self.arm.joints, *BASE_JOINTS),
            seed={**self.positions, **dict(zip(self.arm.joints, self.middle.tolist(), strict=True))},
            root_pose=self.base_frame.root_at(base),
            free=self.free,
            attempts=1,
        )
        if not result:
            return None
        near = self.base_frame.base_at(np.array(result.root_pose))
        return near if hypot(near[0] - base[0], near[1] - base[1]) < _MAX_ADJUSTMENT_M else None

    def _facing(self, base: BasePose) -> float:
        middle = self.targets[:, :2].mean(axis=0)
        return atan2(middle[1] - base[1], middle[0] - base[0])

    def _reaching(self, target: Array, seed: Mapping[str, float], base: BasePose) -> Array | _Reason:
        """Positions of the arm without collisions for a target, or why there are none."""
        root = self.base_frame.root_at(base)
        solutions = self.kinematics.solutions(
            self.frame,
            target,
            joints=self.arm.joints,
            seed=seed,
            root_pose=root,
            free=self.free,
            attempts=_IK_ATTEMPTS,
        )
        blocked: _Reason | None = None
        for each in solutions:
            values = np.array([each.positions[joint] for joint in self.arm.joints])
            if (collision := self.checker.find(values, base)) is None:
                return values
            blocked = blocked or _Reason(f"there {collision}", collision.obstacle)
        if blocked is None:
            result = self.kinematics.solve_ik(
                self.frame, target, joints=self.arm.joints, seed=seed, root_pose=root, free=self.free, attempts=1
            )
            limits = f"limits of {', '.join(result.limits)}" if result.limits else "it is out of reach of the arm"
            return _Reason(limits)
        return blocked


@checked
def find_base_placements(
    robot: Robot,
    arm: Arm | str,
    targets: Iterable[PoseLike],
    *,
    free: str = "",
    ignore: Collection[BodyId] = (),
    touch: Collection[BodyId] = (),
    clearance_m: Length = CLEARANCE_M,
    max_distance_m: Length | None = None,
    count: Count = 5,
    max_places: Count = 400,
    cpu_s: WallTime = CPU_S,
) -> tuple[BasePlacement, ...]:
    """Finds places of the base from which an arm reaches all of some poses, the best first.

    Args:
        arm: its arm, or the name; empty for the first one.
        targets: poses of the grasp frame of the gripper (of the last link of an arm without one) in the world frame.
        free: the axes of the grasp frame about which it may turn; see `RobotKinematics.solve_ik`.
        ignore: bodies that are no obstacles.
        touch: bodies that the gripper may touch.
        clearance_m: the distance that the robot keeps from obstacles [m].
        max_distance_m: the largest horizontal distance between base and targets [m]; by default the arm's reach.
        count: the largest number of places.
        max_places: the largest number of places that are tried.
        cpu_s: processor time after which the search ends in any case [s].

    Raises:
        InvalidArgumentError: there is no such arm, or no target, or the base is fixed.
        UnreachableError: no place was found; with the most frequent reason.
    """
    if robot.model.base.type is BaseType.FIXED:
        cause, remedy = f"the base of {robot.name} is fixed", "use a robot that drives"
        raise InvalidArgumentError("robot", cause=cause, remedy=remedy)
    limit = SearchLimit(max_places, cpu_s=cpu_s)
    placing = _Placing(robot, arm, targets, free=free, ignore=ignore, touch=touch, clearance_m=clearance_m)
    found: list[BasePlacement] = []
    for base, length in placing.candidates(max_distance_m):
        placement = placing.placement(base, length)
        limit.count()
        if placement is not None:
            found.append(placement)
        if limit.is_over or (len(found) >= count and limit.done > _TRIALS_PER_ANSWER * count):
            break
    if not found:
        reason, _ = placing.reasons.most_common(1)[0]
        x, y, z = placing.targets[:, :3].mean(axis=0).tolist()
        where = f"none of {limit.done} places" if limit.done > 1 else "the base can drive to no place near it"
        text = f"{where}; mostly, {reason.text}"
        if limit.ended_by_time:
            text += f"; none was found {limit}"
        raise UnreachableError(robot.name, target=f"({x:.2f}, {y:.2f}, {z:.2f})", reason=text, obstacle=reason.obstacle)
    return tuple(sorted(found, key=lambda each: -each.score)[:count])


def reachable_region(
    robot: Robot,
    arm: Arm | str = "",
    height_m: float = 1.0,
    *,
    step_m: float = 0.08,
    collisions: bool = True,
    max_points: int = 2500,
    cpu_s: float = 5.0,
) -> Array:
    """The points of a horizontal grid that the gripper of an arm reaches from where the robot stands.

    Args:
        arm: its arm, or the name; empty for the first one.
        height_m: height of the grid in the world frame [m].
        step_m: distance of two points [m].
        collisions: whether points are left out that are only reached with collisions.
        max_points: the largest number of points that are tried, those near the gripper first.
        cpu_s: processor time after which the search ends in any case [s].

    Returns:
        n x 3 in the world frame [m].

    Raises:
        InvalidArgumentError: there is no such arm, or the step is not positive.
    """
    if not 0.0 < step_m < inf:
        raise InvalidArgumentError("step_m", cause=f"{step_m:g} is no distance", remedy="give above 0")
    limit = SearchLimit(max_points, cpu_s=cpu_s)
    used, kinematics = find_arm(robot, arm), RobotKinematics(robot.model)
    frame, root = kinematics.frame_of(used), robot.link_pose(robot.model.root)
    now = robot.joint_positions()
    checker = CollisionChecker(robot, joints=used.joints, clearance_m=0.0) if collisions else None
    here = kinematics.pose(frame, now, root_pose=root)
    points = _sampled_points(kinematics, used, {}, root)
    low, high = points.min(axis=0) - 0.1, points.max(axis=0) + 0.1
    shape = [max(1, ceil((b - a) / step_m)) for a, b in zip(low.tolist(), high.tolist(), strict=True)]
    tried: dict[tuple[int, int], Mapping[str, float] | None] = {}
    x, y = ((here[:2] - low) / step_m).tolist()
    cells = [(column, row) for column in range(shape[0]) for row in range(shape[1])]
    for cell in sorted(cells, key=lambda each: hypot(each[0] - x, each[1] - y)):
        if limit.is_over:
            break
        limit.count()
        target = np.array([low[0] + cell[0] * step_m, low[1] + cell[1] * step_m, height_m, *here[3:]])
        near = [(cell[0] + dx, cell[1] + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        seeds = [seed for each in near if (seed := tried.get(each)) is not None]
        solutions = kinematics.solutions(
            frame,
            target,
            joints=used.joints,
            seed={**now, **(seeds[0] if seeds else {})},
            root_pose=root,
            free="xyz",
            attempts=_REGION_ATTEMPTS,
        )
        tried[cell] = next(
            (
                each.positions
                for each in solutions
                if checker is None or checker.is_free([each.positions[joint] for joint in used.joints])
            ),
            None,
        )
    reached = np.array([cell for cell, found in tried.items() if found is not None], dtype=float).reshape(-1, 2)
    return np.column_stack([low + reached * step_m, np.full(len(reached), height_m)])


def _ranges(kinematics: RobotKinematics, arm: Arm) -> tuple[Array, Array]:
    """The limits of the joints of an arm [m or rad]; a turn for those without."""
    limits = np.array([kinematics.limits(joint) for joint in arm.joints])
    low, high = np.where(np.isfinite(limits).all(axis=1)[:, None], limits, [-pi, pi]).T
    return low, high


def _sampled_points(kinematics: RobotKinematics, arm: Arm, now: Mapping[str, float], root: Array) -> Array:
    """Where the grasp frame is in random positions of the arm, n x 2: x and y [m]."""
    rows = np.random.default_rng(0).uniform(*_ranges(kinematics, arm), (_SAMPLES, len(arm.joints)))
    states = ({**now, **dict(zip(arm.joints, row, strict=True))} for row in rows.tolist())
    return np.array([kinematics.pose(kinematics.frame_of(arm), each, root_pose=root)[:2] for each in states])
