"""Where a robot stands to grasp something and to move it along a path, and how it grasps it there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import atan2, cos, pi, sin
from time import monotonic
from typing import NamedTuple

import numpy as np

from mindstage.errors import UnreachableError
from mindstage.robots.collisions import CollisionChecker
from mindstage.robots.navigation import FloorMap
from mindstage.robots.skills.arm_paths import ArmPath, follow_poses, interpolated_poses
from mindstage.robots.skills.grasps import Grasp
from mindstage.robots.skills.manipulator import BasePose, Manipulator
from mindstage.robots.skills.task import SkillTask
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array, pose_multiply, quat_rotate

__all__ = ["Stance", "StanceRequest", "find_stance"]

_DISTANCES_M = (0.55, 0.7, 0.85, 0.45, 1.0)
"""Distances of the base from what is grasped, the preferred first."""
_BEARINGS_RAD = (0.0, 0.35, -0.35, 0.7, -0.7, 1.1, -1.1, 1.5, -1.5)
"""Directions in which the base stands, relative to that from which the hand comes."""
_HEADINGS_RAD = (0.0, 0.5, -0.5, 1.0, -1.0, pi / 2, -pi / 2)
"""Headings of the base, relative to that towards what is grasped."""
_BUDGET_S = 12.0
"""Limit of the wall time [s]."""
_GOOD_ENOUGH = 0.98
"""Part of the path beyond which no better stance is looked for."""
_IK_ATTEMPTS = 5
_CHECKED_EVERY = 3
"""Of the poses of a path, every third one is tested for collisions."""


class Stance(NamedTuple):
    """A place of the base, and motions of the arm from there."""

    base: BasePose
    grasp: Grasp
    start: dict[str, float]
    """Positions of the arm in front of the grasp [m or rad]."""
    reach: float
    """The part of the path that the hand can follow from there, from 0 to 1."""
    why: str
    """Why it does not reach all of it, or why nothing is grasped by friction; may be empty."""
    free: str = ""
    """Axes of the grasp frame about which it may turn on the way."""


class StanceRequest(NamedTuple):
    """What is to be done from one place."""

    target: BodyId
    """What is grasped."""
    grasps: Sequence[Grasp]
    """The grasps of it, the best first."""
    poses: Array
    """n x 7: poses of the target in the world frame, the present one first."""
    back_m: float
    """Length of the straight line on which the hand comes, and withdraws."""
    touched: Sequence[BodyId] = ()
    """Bodies that the hand may touch."""
    least: float = 0.3
    """The least part of the path that is worth it."""


def find_stance(task: SkillTask, hand: Manipulator, request: StanceRequest) -> Stance:
    """The best of the places tried: the first from which the whole path can be followed.

    Raises:
        UnreachableError: there is none.
    """
    return _Search(task, hand, request).find()


class _Search:
    def __init__(self, task: SkillTask, hand: Manipulator, request: StanceRequest) -> None:
        self.task, self.hand, self.request = task, hand, request
        robot = hand.robot
        self.here = robot.base_pose()
        self.positions = robot.joint_positions()
        self.checker = CollisionChecker(
            robot,
            joints=(*hand.arm.joints, *hand.gripper.joints),
            base_moves=hand.is_mobile,
            touch={request.target, *request.touched},
        )
        self.open = dict(zip(hand.gripper.joints, hand.gripper.open_positions, strict=True))
        self.reasons: dict[str, int] = {}
        self.deadline = monotonic() + _BUDGET_S

    def find(self) -> Stance:
        """See `find_stance`."""
        best: Stance | None = None
        for base in self._bases():
            for grasp in self.request.grasps:
                stance = self._try(base, grasp)
                if stance is not None and (best is None or stance.reach > best.reach + 0.02):
                    best = stance
                if best is not None and best.reach >= _GOOD_ENOUGH:
                    return best
            if monotonic() > self.deadline:
                break
        if best is None:
            reason = max(self.reasons, key=lambda each: self.reasons[each], default="it has no grasp")
            raise UnreachableError(self.task.robot.name, target=self.request.target, reason=reason)
        return best

    def _bases(self) -> Iterator[BasePose]:
        """Places of the base: the present one, then others around the target that can be driven to."""
        yield self.here
        if not self.hand.is_mobile or not self.request.grasps:
            return
        target = self.request.poses[0][:3]
        inward = np.mean(
            [
                quat_rotate(each.in_world(self.request.poses[0])[3:], (1.0, 0.0, 0.0))
                for each in self.request.grasps[:4]
            ],
            axis=0,
        )
        away = atan2(-inward[1], -inward[0]) if np.hypot(*inward[:2]) > 0.3 else self._bearing(target)
        floor = FloorMap(self.hand.robot)
        for distance in _DISTANCES_M:
            for bearing in _BEARINGS_RAD:
                x = target[0] + distance * cos(away + bearing)
                y = target[1] + distance * sin(away + bearing)
                if not floor.is_reachable(x, y):
                    self._count("there is no free place to stand in front of it")
                    continue
                facing = atan2(target[1] - y, target[0] - x)
                for heading in _HEADINGS_RAD:
                    yield (x, y, facing + heading)

    def _bearing(self, target: Array) -> float:
        return atan2(self.here[1] - target[1], self.here[0] - target[0])

    def _try(self, base: BasePose, grasp: Grasp) -> Stance | None:
        hand, request = self.hand, self.request
        root = hand.root_at(base)
        frame = hand.kinematics.frame_of(hand.arm)
        at = grasp.in_world(request.poses[0])
        found = hand.kinematics.solve_ik(
            frame, at, joints=hand.arm.joints, seed=self.positions, root_pose=root, attempts=_IK_ATTEMPTS
        )
        if not found:
            self._count(found.reason)
            return None
        if (hit := self._collision(found.positions, base)) is not None:
            self._count(hit)
            return None
        before = pose_multiply(at, np.array([-request.back_m, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
        approach = follow_poses(
            hand.kinematics,
            hand.arm,
            interpolated_poses(at, before),
            root=root,
            seed={**self.positions, **found.positions},
        )
        if not approach.is_complete:
            self._count(approach.reason)
            return None
        start = approach.at(-1)
        if (hit := self._collision(start, base)) is not None:
            self._count(hit)
            return None
        path = follow_poses(
            hand.kinematics,
            hand.arm,
            pose_multiply(request.poses, grasp.pose),
            root=root,
            seed={**self.positions, **found.positions},
            may_drive=hand.is_mobile,
        )
        reach = self._free_part(path, base)
        if reach < request.least:
            self._count(path.reason or "the robot would touch something on the way")
            return None
        return Stance(base, grasp, start, reach, path.reason)

    def _collision(self, positions: dict[str, float], base: BasePose) -> str | None:
        hit = self.checker.find_at({**positions, **self.open}, base if self.hand.is_mobile else None)
        return None if hit is None else str(hit)

    def _free_part(self, path: ArmPath, base: BasePose) -> float:
        """The part of a path that is followed without collisions."""
        count = len(self.request.poses)
        for row in range(0, path.reached, _CHECKED_EVERY):
            hit = self.checker.find_at(
                {**path.at(row), **self.open}, self.hand.base_of(path.roots[row]) if self.hand.is_mobile else None
            )
            if hit is not None:
                self._count(str(hit))
                return max(row - _CHECKED_EVERY, 0) / max(count - 1, 1)
        return (path.reached - 1) / max(count - 1, 1)

    def _count(self, reason: str) -> None:
        self.reasons[reason] = self.reasons.get(reason, 0) + 1
