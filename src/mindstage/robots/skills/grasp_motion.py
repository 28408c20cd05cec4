"""Where a robot stands to grasp something and to move it along a path, and how it grasps it there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import product
from math import atan2, cos, hypot, pi, sin
from typing import NamedTuple

import numpy as np

from mindstage.errors import UnreachableError
from mindstage.robots.arm_paths import LINE_STEP_M, POSE_JOINTS, ArmPath, follow_poses, interpolated_poses
from mindstage.robots.collisions import Collision, CollisionChecker, links_behind
from mindstage.robots.floor_poses import BasePose, wrapped
from mindstage.robots.navigation import FloorMap, plan_base
from mindstage.robots.planning import plan_arm
from mindstage.robots.robot_kinematics import BASE_JOINTS
from mindstage.robots.search_limits import SearchLimit
from mindstage.robots.skills.grasps import Grasp
from mindstage.robots.skills.manipulator import Manipulator, is_near
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array, pose_from_array, pose_multiply, quat_rotate

__all__ = ["GraspMotion", "GraspMotionRequest", "find_grasp_motion"]

_DISTANCES_M = (0.55, 0.7, 0.85, 0.45, 1.0, 1.15)
"""Distances of the base from what is grasped, the preferred first."""
_BEARINGS_RAD = (0.0, 0.35, -0.35, 0.7, -0.7, 1.1, -1.1, 1.5, -1.5, 1.9, -1.9)
"""Directions in which the base stands, relative to that from which the hand comes."""
_HEADINGS_RAD = (0.0, 0.5, -0.5, 1.0, -1.0, pi / 2, -pi / 2)
"""Headings of the base, relative to that towards what is grasped."""
_FINE_DISTANCES_M = (0.9, 0.925, 0.95, 0.975)
"""Further distances, for what is nearly out of reach: the base may stand nearer than where its grid is free."""
_OTHER_DISTANCE_M, _OTHER_PLACES, _APART_M = 0.75, 16, 0.12
"""The preferred distance of further places, their number, and the least distance between two of them."""
_OTHER_HEADINGS_RAD = (0.0, 0.5, -0.5)
_STEPS = 60_000
"""Number of iterations of inverse kinematics and tests for collisions after which a search ends."""
_WAY_TESTS = 30_000
"""Number of poses that the search for a way to a place tests."""
_ARM_TESTS = 6_000
"""Number of states that the search for a way of the arm to the begin of a path tests."""
_NEAR_M = 1.0
"""Up to this distance from where it is, a place is free if the robot has room there, even if its disc has none [m]."""
_SHUT_IN = 0.3
"""Weight of a path at whose end the hand does not come off, or the base is shut in, as between a door and a wall."""
_EXITS = 8
"""Number of places on a path from which the way back is looked for."""
_GOOD_ENOUGH = 0.98
"""Part of the path beyond which no better placement is looked for."""
_IK_ATTEMPTS, _ADJUSTED_IK_ATTEMPTS = 5, 3
"""Attempts of the inverse kinematics, without and with the pose of the base among its unknowns."""
_LONG_PATH = 10
"""Number of poses from which on a path is long."""
_RANDOM_SEEDS = 2
"""Number of random positions of an arm from which the inverse kinematics starts if nothing else led to a placement."""
_MISSES = 4
"""Number of places from which the inverse kinematics fails before a grasp is given up."""
_OUTSIDE_M = 0.1
"""Distance from a container at which the straight line into it begins."""
_MAX_WAY_M = 0.45
_TOUCH_M = 0.001
"""Distance at which the hand counts as touching its target."""
_CHECKED_EVERY = 3
"""Of the poses of a path, every third one is tested for collisions."""
_AVOIDED_M, _AVOIDED_RAD = 0.1, 0.3
"""A place that is nearer to an avoided one, with a similar heading, is not another one."""
_MAX_NAMES = 3
"""Number of bodies that a reason names at most."""
_MAX_GRASPS = 12
"""Number of grasps that are tried at each place."""


class GraspMotion(NamedTuple):
    """A place of the base, and motions of the arm from there."""

    base: BasePose
    grasp: Grasp
    number: int
    """Which one of the grasps that were asked for."""
    start: dict[str, float]
    """Positions of the arm in front of the grasp [m or rad]."""
    reach: float
    """The part of the path that the hand can follow from there, from 0 to 1."""
    back_m: float
    """Length of the straight line on which the hand comes, and withdraws."""
    why: str
    """Why it does not reach all of it; may be empty."""
    path: ArmPath
    """The motion along it, as it was tested."""
    part: float
    """As `reach`, which is less where the robot has no way back at the end."""
    stop: int
    """Number of poses of the path after which the motion is to end: the robot still has a way back there."""


class GraspMotionRequest(NamedTuple):
    """What is to be done from one place."""

    target: BodyId
    """What is grasped, or put down."""
    grasps: Sequence[Grasp]
    """The grasps of it, the best first."""
    poses: Array
    """n x 7: poses of the target in the world frame, the one of the grasp first."""
    back_m: float
    """Least length of the straight line on which the hand comes, and withdraws."""
    paths: Sequence[Array] = ()
    """For each grasp the poses of the grasp frame, n x 7, where the hand does not move rigidly with the target."""
    container: tuple[Array, Array] | None = None
    """The lowest and the highest corner of what the target is in: the line begins in front of it, if possible."""
    lift_m: float = 0.0
    """The height of this line above the grasp."""
    joint: BodyId | None = None
    """The joint of a door or drawer that moves with the target."""
    joint_positions: Sequence[float] = ()
    """Its positions along the path [m or rad]."""
    moved: Mapping[BodyId, Array] = {}
    """Where a door that may shut in the base, and its parts, are along the path: n x 7 poses in the world frame."""
    touched: Sequence[BodyId] = ()
    """Bodies that the hand, or what it holds, may touch."""
    least: float = 0.3
    """The least part of the path that is worth it."""
    enough: float = 0.3
    """The part of the path from which on other configurations of the arm are not tried."""
    is_closed: bool = False
    """Whether the gripper is closed when it comes, rather than open."""
    stays: bool = False
    """Whether the base must stay where it is."""
    checks_path_closed: bool = False
    """Whether the fingers are closed on what they grasp while it is moved, rather than as open as before."""
    steps: int = _STEPS
    """Number of iterations of inverse kinematics and tests for collisions after which the search ends."""
    avoided: Sequence[BasePose] = ()
    """Places from which it was tried without success: others are tried."""


def find_grasp_motion(hand: Manipulator, request: GraspMotionRequest, floor: FloorMap | None = None) -> GraspMotion:
    """The best of the places tried: the first from which the whole path can be followed.

    Args:
        request: what is to be done.
        floor: the free floor, if it is known; the base is at its start.

    Raises:
        UnreachableError: there is none.
    """
    return _Search(hand, request, floor).find()


class _Start(NamedTuple):
    """From where the hand comes on a straight line."""

    positions: dict[str, float]
    back_m: float
    base: BasePose


class _Search:
    def __init__(self, hand: Manipulator, request: GraspMotionRequest, floor: FloorMap | None) -> None:
        self.hand, self.request, self.floor = hand, request, floor
        robot = hand.robot
        self.later: dict[int, FloorMap] = {}
        """The free floor when the door or drawer has been moved, by the pose of the path."""
        self.here = robot.base_pose() if floor is None else floor.start
        self.positions = robot.joint_positions()
        self.holds = hand.held is not None
        self.moves_base = hand.is_mobile and not request.stays
        self.adjusts = hand.needs_base and self.moves_base
        """Whether the pose of the base is among the unknowns of the inverse kinematics."""
        self.checker = CollisionChecker(
            robot,
            joints=(*hand.arm.joints, *hand.gripper.joints),
            base_moves=self.moves_base,
            touch={request.target, *request.touched},
        )
        self.strict = CollisionChecker(
            robot,
            joints=(*hand.arm.joints, *hand.gripper.joints),
            base_moves=self.moves_base,
            clearance_m=_TOUCH_M,
        )
        """For the way to the target, on which the hand touches nothing either."""
        self.pivot = 0
        """See `_pivots`."""
        self.fingers: dict[str, float] = {}
        self.last_hit: Collision | None = None
        """Of the attempt that is being made."""
        self.reasons: Counter[str] = Counter()
        self.shortfalls: dict[str, float] = {}
        """By how much the hand does not get to a grasp [m], by reason; reasons without it are of better places."""
        self.obstacles: dict[str, BodyId] = {}
        """What was touched, by reason."""
        links = robot.placed.link_ids
        hand_links = links_behind(robot.model, hand.gripper.link)
        self.hand_bodies = {links[link] for link in hand_links if link in links}
        self.own_bodies = set(links.values())
        self.unproven: GraspMotion | None = None
        """The first one to which the short search found no way of the arm; a longer one may."""
        self.hopeless: set[tuple[int, float]] = set()
        """Numbers and rooms of the grasps that fail wherever the base stands."""
        self.missed: Counter[tuple[int, int]] = Counter()
        """How often the inverse kinematics failed, with the pose of the base among its unknowns, by grasp and pivot."""
        self.blocked = 0
        """Number of places that are not free."""
        self.counted = hand.kinematics.iterations
        """The iterations and tests that the limit has counted, or that were before the search."""
        self.limit = SearchLimit(request.steps, part_of=hand.task.limit)

    def find(self) -> GraspMotion:
        """See `find_grasp_motion`."""
        best: GraspMotion | None = None
        for seed, pivot in self._begins():
            self.pivot = pivot
            best = self._find_from(seed, best)
            if self._is_over() or (best is not None and best.reach >= self.request.enough):
                break
        best = best or self.unproven
        if best is None:
            raise self._failure()
        if self.limit.ended_by_time:
            self.hand.task.assume(f"no better placement to reach {self.request.target} was found {self.limit}")
        return best

    def _begins(self) -> Iterator[tuple[dict[str, float], int]]:
        """Positions of the arm and numbers of poses of the path from which inverse kinematics starts.

        Where an arm cannot be folded, it may be in front of what it has moved before, and only move it back: so the
        first pose is solved from how the arm is.
        """
        if self.adjusts and not self.hand.is_folded:
            yield self.positions, 0
        yield from product(self._seeds(), self._pivots())

    def _pivots(self) -> Sequence[int]:
        """The poses of the path for which inverse kinematics is solved first.

        An arm that takes the base along follows a long path farther in both directions from the middle of it, where
        the positions of its joints are those that it can leave in every direction.
        """
        count = len(self.request.poses)
        return (count // 2, 0) if self.adjusts and count >= _LONG_PATH else (0,)

    def _seeds(self) -> Iterator[dict[str, float]]:
        """Positions from which inverse kinematics starts: an arm with more joints than it needs has many solutions.

        The present ones come first, since the solution should be near to them.
        """
        arm = self.hand.arm.joints
        if not self.adjusts:
            yield self.positions
        yield {**self.positions, **self.hand.ready_positions()}
        if len(arm) <= POSE_JOINTS:
            return
        limits = np.array([self.hand.kinematics.limits(name) for name in arm])
        low, high = np.clip(limits, -pi, pi).T
        chance = np.random.default_rng(self.hand.task.seed)
        for _ in range(_RANDOM_SEEDS):
            yield {**self.positions, **dict(zip(arm, chance.uniform(low, high).tolist(), strict=True))}

    def _find_from(self, seed: Mapping[str, float], best: GraspMotion | None) -> GraspMotion | None:
        """The best placement, or the best of those before, with arms near to some positions."""
        stays = self.adjusts and seed is self.positions  # they belong to the place where the base is
        for base in (self.here,) if stays else self._bases():
            if self._is_avoided(base):
                continue
            for number, grasp in self._possible_grasps():
                placement = self._try(base, grasp, number, seed)
                if placement is None or (best is not None and placement.reach <= best.reach + 0.02):
                    continue
                if not self._can_drive_to(placement.base):
                    break
                if self.adjusts and self.request.joint is not None and not self._finds_arm_way(placement):
                    self.unproven = self.unproven or placement
                    continue
                best = placement
                if best.reach >= _GOOD_ENOUGH:
                    return best
            if self._is_over():
                break
        return best

    def _is_avoided(self, base: BasePose) -> bool:
        """Whether it was tried from there."""
        return any(
            hypot(base[0] - x, base[1] - y) < _AVOIDED_M and abs(wrapped(base[2] - yaw)) < _AVOIDED_RAD
            for x, y, yaw in self.request.avoided
        )

    def _possible_grasps(self) -> list[tuple[int, Grasp]]:
        """The grasps that are tried at a place, with their numbers; with a gripper just wide enough if need be."""
        found = list[tuple[int, Grasp]]()
        for number, grasp in enumerate(self.request.grasps):
            if self.missed[number, self.pivot] >= _MISSES:  # its height and inclination are out of reach of the arm
                continue
            options = (grasp, grasp.tight())
            possible = next((each for each in options if (number, each.room_m) not in self.hopeless), None)
            if possible is not None:
                found.append((number, possible))
        return found[:_MAX_GRASPS]

    def _is_over(self) -> bool:
        """Whether the search has used up its steps."""
        done = self.hand.kinematics.iterations + self.checker.tests + self.strict.tests
        self.limit.count(done - self.counted)
        self.counted = done
        return self.limit.is_over

    def _failure(self) -> UnreachableError:
        """The error: the commonest reason of the attempts that got farthest, and what stands in the way."""
        robot, target = self.hand.robot.name, self.request.target
        if not self.request.grasps:
            return UnreachableError(robot, target=target, reason="no grasp of it fits the gripper")
        near = Counter({each: count for each, count in self.reasons.items() if each not in self.shortfalls})
        shortfall_m = min(self.shortfalls.values(), default=None)
        if near:
            reason = near.most_common(1)[0][0]
            obstacle = self.obstacles.get(reason)
            return UnreachableError(
                robot, target=target, reason=self._ended(reason), obstacle=obstacle, shortfall_m=shortfall_m
            )
        reasons = sorted(self.shortfalls, key=self.shortfalls.__getitem__)[:1]
        names: tuple[BodyId, ...] = ()
        if self.blocked and self.floor is not None:
            at = self.request.grasps[0].in_world(self.request.poses[0])[:2].tolist()
            names = tuple(each for each in self.floor.blockers(*at) if each != target)[:_MAX_NAMES]
            text = f"{self.blocked} places to stand nearer are not free"
            reasons.append(f"{text}: in the way of the base are {', '.join(names)}" if names else text)
        return UnreachableError(
            robot,
            target=target,
            reason=self._ended("; ".join(reasons) or f"no placement was found {self.limit}"),
            obstacle=next(iter(names), None),
            shortfall_m=shortfall_m,
        )

    def _ended(self, reason: str) -> str:
        """A reason, with what has ended the search if another machine may find more."""
        return f"{reason}; no other placement was found {self.limit}" if self.limit.ended_by_time else reason

    def _can_drive_to(self, base: BasePose) -> bool:
        if not self.moves_base or is_near(base, self.here):
            return True
        try:
            plan_base(
                self.hand.robot,
                base,
                max_tests=_WAY_TESTS,
                part_of=self.limit,
                floor=self.floor,
                joints=self._joint_at(0),
            )
        except UnreachableError as error:
            self._count(error.reason, error.shortfall_m)
            return False
        return True

    def _finds_arm_way(self, placement: GraspMotion) -> bool:
        """Whether the arm, as it is now, finds its way to the begin of the path from where the base will be."""
        hand = self.hand
        try:
            plan_arm(
                hand.robot,
                hand.arm,
                placement.start,
                start=self._fingers(placement.grasp),
                max_tests=_ARM_TESTS,
                part_of=self.hand.task.limit,
                base=placement.base if self.moves_base else None,
                joints=self._joint_at(0),
                seed=hand.task.seed + 1,
            )
        except UnreachableError as error:
            self._count(f"in front of it {error.reason}")
            return False
        return True

    def _bases(self) -> Iterator[BasePose]:
        """Places of the base: the present one, then others around the target that can be driven to."""
        yield self.here
        if not self.moves_base or not self.request.grasps:
            return
        first = self.request.grasps[0].in_world(self.request.poses[0])
        target = first[:3]
        inward = quat_rotate(first[3:], (1.0, 0.0, 0.0))
        away = atan2(-inward[1], -inward[0])
        if np.hypot(*inward[:2]) < 0.3:
            away = atan2(self.here[1] - target[1], self.here[0] - target[0])
        if self.floor is None:
            self.floor = FloorMap(self.hand.robot)
        floor = self.floor
        yield from self._around(target, away, _DISTANCES_M, _HEADINGS_RAD)
        yield from self._other_bases(target, floor)
        yield from self._around(target, away, _FINE_DISTANCES_M, _OTHER_HEADINGS_RAD)

    def _around(
        self, target: Array, away: float, distances: Sequence[float], headings: Sequence[float]
    ) -> Iterator[BasePose]:
        """Free places at distances from the target, first in a direction from it."""
        assert self.floor is not None
        for distance, bearing in product(distances, _BEARINGS_RAD):
            x = float(target[0] + distance * cos(away + bearing))
            y = float(target[1] + distance * sin(away + bearing))
            facing = atan2(target[1] - y, target[0] - x) - self.hand.side
            bases = [(x, y, facing + heading) for heading in headings]
            self._move_joint(0)
            free = [each for each in bases if self._may_stand(each, self.positions)]
            self.blocked += not free
            yield from free

    def _other_bases(self, target: Array, floor: FloorMap) -> Iterator[BasePose]:
        """Places anywhere on the free floor around the target, for where most of it is taken."""
        points = floor.plan.centers(np.flatnonzero(np.isfinite(floor.lengths)))
        distances = np.hypot(*(points - target[:2]).T)
        near = (distances >= min(_DISTANCES_M)) & (distances <= max(_DISTANCES_M))
        points = points[near][np.argsort(np.abs(distances[near] - _OTHER_DISTANCE_M))]
        chosen = list[Array]()
        while len(points) and len(chosen) < _OTHER_PLACES:
            chosen.append(points[0])
            points = points[np.hypot(*(points - points[0]).T) >= _APART_M]
        for x, y in chosen:
            facing = atan2(target[1] - y, target[0] - x) - self.hand.side
            for heading in _OTHER_HEADINGS_RAD:
                yield (float(x), float(y), facing + heading)

    def _try(self, base: BasePose, grasp: Grasp, number: int, seed: Mapping[str, float]) -> GraspMotion | None:
        hand, request = self.hand, self.request
        self.fingers, self.last_hit = self._fingers(grasp), None
        poses = request.paths[number] if request.paths else pose_multiply(request.poses, grasp.pose)
        pivot, adjusts = self.pivot, self.adjusts
        along = poses[pivot] - poses[0]
        found = hand.kinematics.solve_ik(
            hand.kinematics.frame_of(hand.arm),
            poses[pivot],
            joints=(*(BASE_JOINTS if adjusts else ()), *hand.arm.joints),  # any place is driven to before
            seed=seed,
            root_pose=hand.base_frame.root_at((base[0] + float(along[0]), base[1] + float(along[1]), base[2])),
            attempts=_ADJUSTED_IK_ATTEMPTS if adjusts else _IK_ATTEMPTS,
        )
        if not found:
            self._count(found.reason, found.shortfall_m)
            self.missed[number, pivot] += adjusts
            return None
        root = np.array(found.root_pose)
        at_pivot = {**self.positions, **found.positions}
        self._move_joint(pivot)
        if adjusts and not self._may_stand(hand.base_frame.base_at(root), at_pivot):
            self.blocked += 1
            return None
        before = self._follow(poses[pivot::-1], root, at_pivot) if pivot else None
        if before is not None and before.reached <= pivot:
            self._count(before.reason, before.shortfall_m)
            return None
        self._move_joint(0)
        if before is None:
            start = self._start(poses[0], root, at_pivot)
        else:
            start = self._start(poses[0], before.roots[-1], {**self.positions, **before.at(-1)})
        if start is None:
            self._exclude(number, grasp)
            return None
        path = self._follow(poses[pivot:], root, at_pivot)
        path = path if before is None else before.backwards().joined(path)
        if request.checks_path_closed:
            self.fingers = hand.fingers_at(grasp.width_m)
        reach = self._free_part(path)
        if reach < request.least:
            self._exclude(number, grasp)
            if self.last_hit is None:  # else it was counted
                self._count(path.reason, path.shortfall_m)
            return None
        count = len(request.poses)
        placement = GraspMotion(
            start.base, grasp, number, start.positions, reach, start.back_m, path.reason, path, reach, count
        )
        return self._with_exit(placement, poses) if request.joint is not None else placement

    def _with_exit(self, placement: GraspMotion, poses: Array) -> GraspMotion:
        """A placement whose path ends where the robot can still get away from what it has moved, if there is one.

        Args:
            poses: n x 7: poses of the grasp frame along the path.
        """
        count = len(poses)
        last = round(placement.reach * (count - 1))
        rows = range(last, -1, -max(last // _EXITS, 1))
        # The motion may end a little earlier, so that there has to be a way back from there, too.
        has_exit = cache(lambda row: self._has_exit(placement, poses[row], row))
        row = next((row for row in rows if has_exit(row) and has_exit(max(row - 1, 0))), 0)
        cut = row / max(count - 1, 1)
        if row == last:
            return placement
        if placement.reach >= _GOOD_ENOUGH or cut < max(_SHUT_IN * placement.reach, self.request.least):
            return placement._replace(reach=_SHUT_IN * placement.reach)
        why = "the robot would be shut in farther on, or its hand would not come off"
        return placement._replace(reach=cut, part=cut, why=why, stop=row + 1)

    def _has_exit(self, placement: GraspMotion, at: Array, row: int) -> bool:
        """Whether the hand comes off, and the base can drive away, when the path is followed up to one of its poses.

        Args:
            at: that pose of the grasp frame.
            row: its number.
        """
        hand, root = self.hand, placement.path.roots[row]
        if self.adjusts:  # other arms take their hands back nearly everywhere
            self._move_joint(row)
            back = interpolated_poses(at, pose_multiply(at, np.array([-self.request.back_m, 0, 0, 1.0, 0, 0, 0])))
            seed = {**self.positions, **placement.path.at(row)}
            ways = (self._follow(back, root, seed, free=free) for free in hand.withdrawing_free)
            way = next((each for each in ways if self._comes_off(each, self._fingers(placement.grasp))), None)
            if way is None:
                return False
            root = way.roots[-1]
        if not self.moves_base or not self.request.moved:
            return True
        if row not in self.later:
            moved = {id: pose_from_array(each[row]) for id, each in self.request.moved.items()}
            self.later[row] = FloorMap(hand.robot, moved=moved, start=self.here)
        x, y, _ = hand.base_frame.base_at(root)
        return self.later[row].is_reachable(x, y)

    def _comes_off(self, way: ArmPath, fingers: Mapping[str, float]) -> bool:
        """Whether the hand can withdraw on a way, with its fingers open."""

        def is_free(row: int) -> bool:
            base = self.hand.base_frame.base_at(way.roots[row]) if self.moves_base else None
            return self.checker.find_at({**way.at(row), **fingers}, base) is None

        return way.is_complete and all(is_free(row) for row in range(1, way.reached))

    def _follow(self, poses: Array, root: Array, seed: Mapping[str, float], *, free: str = "") -> ArmPath:
        hand, drives = self.hand, self.moves_base
        return follow_poses(hand.kinematics, hand.arm, poses, root=root, seed=seed, free=free, may_drive=drives)

    def _fingers(self, grasp: Grasp) -> dict[str, float]:
        """Positions of the fingers on the way to a grasp; those of now if something is held."""
        gripper = self.hand.gripper
        if self.holds:
            return {name: self.positions[name] for name in gripper.joints}
        return self.hand.fingers_at(0.0 if self.request.is_closed else grasp.opening_m(gripper.max_opening_m))

    def _may_stand(self, base: BasePose, positions: Mapping[str, float]) -> bool:
        """Whether the base may get to a place: the disc around it does, or it is near, and the robot has room there.

        A robot may stand where the disc has no room, as between an open drawer and a chair; how it gets from there to
        another place is searched with its own shapes (see `plan_base`).
        """
        if self.floor is None:
            self.floor = FloorMap(self.hand.robot)
        if self.floor.is_reachable(base[0], base[1]):
            return True
        if hypot(base[0] - self.here[0], base[1] - self.here[1]) > _NEAR_M:
            return False
        return self.checker.find_at(positions, base) is None

    def _start(self, at: Array, root: Array, seed: dict[str, float]) -> _Start | None:
        """From where the hand comes on a straight line."""
        request = self.request
        above = at + np.array([0.0, 0.0, request.lift_m, 0.0, 0.0, 0.0, 0.0])
        wanted = max(request.back_m, _way_out(above, request.container))
        line = interpolated_poses(above, pose_multiply(above, np.array([-wanted, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])))
        rise = interpolated_poses(at, above)[:-1] if request.lift_m else line[:0]
        approach = follow_poses(
            self.hand.kinematics,
            self.hand.arm,
            np.concatenate([rise, line]),
            root=root,
            seed=seed,
            may_drive=self.hand.needs_base and self.moves_base,
        )
        last = -1
        for row in range(approach.reached):
            if row % 2 and row < approach.reached - 1:
                continue
            if self._hits(approach.at(row), self.hand.base_frame.base_at(approach.roots[row]), strictly=True):
                break
            last = row
        length = wanted * max(last - len(rise), 0) / max(len(line) - 1, 1)
        if last < len(rise) or length < min(request.back_m, self.hand.distance_before(above) - LINE_STEP_M) - 1e-6:
            if last == approach.reached - 1:  # else the collision was counted
                self._count(approach.reason or "the hand has no straight way to it", approach.shortfall_m)
            return None
        return _Start(approach.at(last), length, self.hand.base_frame.base_at(approach.roots[last]))

    def _hits(self, positions: dict[str, float], base: BasePose, *, strictly: bool = False) -> bool:
        """Whether the robot would touch something there; strictly if its hand may not touch the target either."""
        state, place = {**positions, **self.fingers}, base if self.moves_base else None
        hit = self.checker.find_at(state, place)
        if hit is None and strictly and not self.holds:
            hit = self.strict.find_at(state, place)
        if hit is not None:
            self._count(f"there {hit}")
            self.last_hit = hit
            if hit.obstacle is not None and hit.obstacle not in self.own_bodies:
                self.obstacles[f"there {hit}"] = hit.obstacle
        return hit is not None

    def _exclude(self, number: int, grasp: Grasp) -> None:
        """Tries a grasp nowhere else if the hand was stopped: its poses are the same wherever the base stands."""
        hit = self.last_hit
        if hit is not None and hit.part in self.hand_bodies and hit.obstacle not in self.own_bodies:
            self.hopeless.add((number, grasp.room_m))

    def _free_part(self, path: ArmPath) -> float:
        """The part of a path that is followed without collisions."""
        count = len(self.request.poses)
        free = 0
        for row in (*range(0, path.reached - 1, _CHECKED_EVERY), path.reached - 1):
            self._move_joint(row)
            if self._hits(path.at(row), self.hand.base_frame.base_at(path.roots[row])):
                return free / max(count - 1, 1)
            free = row
        return 1.0 if count == 1 and path.reached else (path.reached - 1) / max(count - 1, 1)

    def _joint_at(self, row: int) -> dict[BodyId, float]:
        """The position of the joint that moves with the target at a pose of the path; empty without one."""
        return {} if self.request.joint is None else {self.request.joint: self.request.joint_positions[row]}

    def _move_joint(self, row: int) -> None:
        for joint, position in self._joint_at(row).items():
            for checker in (self.checker, self.strict) if row == 0 else (self.checker,):
                checker.set_joint(joint, position)

    def _count(self, reason: str, shortfall_m: float | None = None) -> None:
        self.reasons[reason] += 1
        if shortfall_m is not None:
            self.shortfalls[reason] = shortfall_m


def _way_out(at: Array, container: tuple[Array, Array] | None) -> float:
    """How far a hand has to withdraw until the grasp frame is outside of a box, with some room [m]; 0 without one."""
    if container is None:
        return 0.0
    backwards = -quat_rotate(at[3:], (1.0, 0.0, 0.0))
    with np.errstate(divide="ignore"):
        ends = np.where(backwards > 0.0, container[1] - at[:3], container[0] - at[:3]) / backwards
    way = float(np.min(np.where(np.abs(backwards) > 1e-6, ends, np.inf)))
    return min(max(way, 0.0) + _OUTSIDE_M, _MAX_WAY_M)
