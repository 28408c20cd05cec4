"""How doors and drawers are moved: by the handle, by the free edge, or by a push; and which of them a robot can open.

Every way is tested with the collision shapes of the place: first the gripper alone, at the grasp and along the path of
the part, since what it cannot grasp no place of the base mends; then the whole robot, from sampled places of the base.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from itertools import product
from math import atan2, cos, sin
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.errors import UnreachableError
from mindstage.ranges import Fraction, checked
from mindstage.robots.collisions import Collision, HandChecker, find_part_collision
from mindstage.robots.floor_poses import BasePose
from mindstage.robots.navigation import FloorMap
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import BASE_JOINTS, IkResult
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills.grasp_motion import GraspMotion, GraspMotionRequest, find_grasp_motion
from mindstage.robots.skills.grasps import Grasp, diagonal_grasps_of, edge_grasps_of, grasps_of, pushes_of, sweeps_of
from mindstage.robots.skills.manipulator import Manipulator, hands_of
from mindstage.robots.surroundings import ArticulatedPart, Surroundings
from mindstage.scene import BodyId, Pose
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_conjugate,
    quat_rotate,
)

__all__ = [
    "BACK_M",
    "OpeningReach",
    "OpeningStep",
    "PartContact",
    "PartMotion",
    "PartStop",
    "can_open",
    "find_part_motion",
    "find_stop",
]

_STEP_M = 0.02
"""Distance of the handle between neighboring poses of its path."""
_FACING, _DIAGONAL_FACING = 0.7, 0.4
"""Least cosine between the direction of approach and the inward direction of the part."""
_WIDE = 0.5
"""A handle is rather grasped where it is narrower than this part of the opening: not a bar by its two ends."""
_PANEL = 0.15
"""A part is a panel, rather than a drawer, if its thickness is less than this part of its other sides."""
_ALONG = 0.5
"""Largest cosine between the motion of a panel that slides along its front and the direction across it."""
_TOUCHING_M = 0.001
"""A handle is in front of a panel if it is farther from its middle plane."""
_LEVEL_M = 0.05
"""A handle whose height changes by less is on a door with a vertical axis."""
BACK_M = {True: 0.1, False: 0.06}
"""Distance from which a handle, or a free edge, is approached, and to which the gripper withdraws."""
_AJAR = 0.08
"""Openness from which on a door has a free edge on both sides."""
_MAX_UP = 0.5
"""Largest upward component of the direction in which a hand points that pushes."""
_CHECKED_EVERY = 2
"""Of the poses of a path, every second one is tested with the gripper alone."""
_PER_GROUP, _MAX_GRASPS = 2, 12
"""Number of grasps of one direction, and of all, that are tried."""
_APART_M, _REACH_ATTEMPTS = 0.6, 3
"""Distance of the base and attempts of the inverse kinematics for the test whether an arm reaches a grasp at all."""
_LEAST_PART = 0.15
"""The least part of a path that is worth it."""
_ENOUGH = {True: 0.5, False: 0.95}
"""A way that moves a part by so much of its path is taken without a look at the next one; a door that folds down falls
back if it is let go on the way."""
_ALL = 0.95
"""Openness that counts as open."""
_MAX_STEPS = 4
_STOP_TESTS = 26
"""Number of positions at which a part is tested against its neighbors."""
_MAX_TRIES = 3
"""How often each way is tried without success, from different places."""
_QUICK_STEPS, _LONG_STEPS = 40_000, 60_000
"""Steps of the search for a placement (`GraspMotionRequest.steps`): for each way at first, and if none was found."""


class PartContact(StrEnum):
    """How a door or drawer is moved."""

    HANDLE = "handle"
    """The fingers hold its handle."""
    EDGE = "edge"
    """The fingers hold the free edge of a door that is ajar."""
    PUSH = "push"
    """The closed gripper pushes a side of it."""


class PartMotion(NamedTuple):
    """A way to move a part, from one placement."""

    way: PartContact
    placement: GraspMotion
    body: BodyId
    """What is grasped or pushed: the handle, or the part."""
    poses: Array
    """n x 7: poses of the body along its path in the world frame, the present one first."""
    path: Array
    """n x 7: poses of the grasp frame along it."""
    positions: Array
    """n positions of the joint [m or rad]."""

    @property
    def end(self) -> float:
        """The position of the joint up to which the placement reaches [m or rad]."""
        return float(self.positions[0] + self.placement.part * (self.positions[-1] - self.positions[0]))

    @property
    def end_row(self) -> int:
        """Number of the last pose that the placement reaches."""
        return round(self.placement.part * (len(self.positions) - 1))


class OpeningStep(msgspec.Struct, frozen=True, kw_only=True):
    """One motion in which a door or drawer is opened."""

    way: PartContact
    base: BasePose
    """Where the robot stands: x, y [m] and yaw [rad]."""
    openness: float
    """How far the part is open after it, from 0 to 1."""


class OpeningReach(msgspec.Struct, frozen=True, kw_only=True):
    """Whether a robot can open a door or drawer; truthy if it can."""

    part: BodyId
    is_reachable: bool
    openness: float
    """How far it can be opened, from 0 to 1."""
    steps: tuple[OpeningStep, ...]
    """How, and from where."""
    reason: str = ""
    """Why not farther: the limit or the obstacle, with numbers; for each way."""
    obstacle: str | None = None
    """The id of the body in the way, if it is one."""

    def __bool__(self) -> bool:
        return self.is_reachable


@checked
def can_open(robot: Robot, thing: str, fraction: Fraction = 1.0) -> OpeningReach:
    """Whether a robot can open a door or drawer, without moving anything: from where, how, or why not.

    Places of the base, grasps and pushes are sampled, and tested by inverse kinematics on the robot's model and for
    collisions with the place; where one placement does not reach all the way, the next one goes on from there. What is
    not found by these samples counts as not reachable.

    Args:
        thing: the door or drawer, its handle, or a container with one.
        fraction: how far, from 0 (closed) to 1.

    Raises:
        NameNotFoundError: there is no such door or drawer.
        AmbiguousNameError: there are several.
    """
    task = SkillTask(robot)
    surroundings = task.surroundings()
    part = surroundings.articulated_part(surroundings.find(thing))
    joint = part.joint
    span = joint.open_position - joint.closed_position
    target, position = joint.position_at(fraction), joint.position
    steps: list[OpeningStep] = []
    reason, obstacle = "", None
    hand = hands_of(task)[0]
    floor: FloorMap | None = None
    stop = find_stop(robot, part, target)
    target = target if stop is None else stop.position

    def openness() -> float:
        return (position - joint.closed_position) / span

    while abs(target - position) > (1.0 - _ALL) * abs(span) and len(steps) < _MAX_STEPS:
        try:
            found = find_part_motion(hand, part, surroundings, target, start=position, floor=floor)
        except UnreachableError as error:
            reason, obstacle = error.reason, error.obstacle
            break
        position = found.end
        if hand.is_mobile:  # it goes on from where it stands then, with the part where it is then
            path = found.placement.path
            moved = _parts_at(part, surroundings, position)
            floor = FloorMap(robot, moved=moved, start=hand.base_frame.base_at(path.roots[found.end_row]))
        steps.append(OpeningStep(way=found.way, base=found.placement.base, openness=round(openness(), 3)))
        reason = found.placement.why
    is_reachable = openness() >= _ALL * fraction
    if stop is not None and not obstacle and abs(target - position) <= (1.0 - _ALL) * abs(span):
        reason, obstacle = stop.reason, stop.obstacle
    return OpeningReach(
        part=part.id,
        is_reachable=is_reachable,
        openness=round(openness(), 3),
        steps=tuple(steps),
        reason="" if is_reachable else reason,
        obstacle=None if is_reachable else obstacle,
    )


class PartStop(NamedTuple):
    """What stops a door or drawer on its way."""

    position: float
    """Up to which its joint gets [m or rad]."""
    obstacle: BodyId | None
    reason: str


def find_stop(robot: Robot, part: ArticulatedPart, target: float) -> PartStop | None:
    """What is in the way of a door or drawer, such as one beside it, between where it is and a position [m or rad]."""
    joint = part.joint
    positions = np.linspace(joint.position, target, _STOP_TESTS).tolist()
    bodies = [each for each in (part.id, part.handle) if each is not None]
    found = find_part_collision(robot, bodies, joint.id, positions)
    if found is None:
        return None
    number, hit = found
    share = (positions[number] - joint.closed_position) / (joint.open_position - joint.closed_position)
    return PartStop(positions[number - 1], hit.obstacle, f"when {part.id} is {share:.0%} open, {hit}")


def _parts_at(part: ArticulatedPart, surroundings: Surroundings, position: float) -> dict[BodyId, Pose]:
    """Where a part and its handle are at a position of its joint [m or rad]."""
    part_pose = normalized_pose_array(part.joint.pose_at(position))
    to_part = pose_inverse(surroundings.pose(part.id))
    parts = dict.fromkeys(each for each in (part.id, part.handle) if each is not None)
    poses = {id: pose_multiply(part_pose, pose_multiply(to_part, surroundings.pose(id))) for id in parts}
    return {id: pose_from_array(pose) for id, pose in poses.items()}


def find_part_motion(
    hand: Manipulator,
    part: ArticulatedPart,
    surroundings: Surroundings,
    target: float,
    *,
    start: float | None = None,
    tried: Sequence[PartMotion] = (),
    floor: FloorMap | None = None,
) -> PartMotion:
    """Where to stand and how to move a part: the first way that moves it far, otherwise the best one.

    What was tried without success is tried from other places; each way three times.

    Args:
        surroundings: the things of the world.
        target: the position that its joint is to have [m or rad].
        start: the position from which it is moved; None for the present one.
        tried: what was tried without success.
        floor: the free floor with the part at `start`, if it is known; the base is at its start.

    Raises:
        UnreachableError: there is none; with the reason for each way.
    """
    start = part.joint.position if start is None else start
    search = _PartMotionSearch(hand, part, surroundings, start, target, tried)
    best: PartMotion | None = None
    reasons: dict[PartContact, UnreachableError] = {}
    quick = _QUICK_STEPS if search.is_level else _LONG_STEPS
    for steps, way in product(dict.fromkeys((quick, _LONG_STEPS)), list(search.ways())):
        if sum(each.way is way for each in tried) >= _MAX_TRIES:
            continue
        if steps > quick and best is not None:
            break
        try:
            found = search.find(way, floor, steps)
        except UnreachableError as error:
            reasons[way] = error
            continue
        if best is None or found.placement.reach > best.placement.reach:
            best = found
        if best.placement.reach >= _ENOUGH[search.is_level]:
            break
    if best is not None:
        return best
    texts = [f"by its {way}: {error.reason}" if len(reasons) > 1 else error.reason for way, error in reasons.items()]
    raise UnreachableError(
        hand.robot.name,
        target=part.handle or part.id,
        reason="; ".join(texts) or "every way to move it was tried",
        obstacle=next((each.obstacle for each in reasons.values() if each.obstacle is not None), None),
    )


class _PartMotionSearch:
    def __init__(
        self,
        hand: Manipulator,
        part: ArticulatedPart,
        surroundings: Surroundings,
        start: float,
        target: float,
        tried: Sequence[PartMotion],
    ) -> None:
        self.hand, self.part, self.surroundings, self.tried = hand, part, surroundings, tried
        self.handle = part.handle or part.id
        joint = part.joint
        part_pose = surroundings.pose(part.id)
        self.handle_in_part = pose_multiply(pose_inverse(part_pose), surroundings.pose(self.handle))
        ends = self._handle_at(start), self._handle_at(target)
        count = max(int(np.ceil(1.2 * float(np.linalg.norm(ends[1][:3] - ends[0][:3])) / _STEP_M)), 2)
        self.positions = np.linspace(start, target, count + 1)
        self.part_poses = np.array([self._part_pose_at(float(each)) for each in self.positions])
        self.handles = np.array([pose_multiply(each, self.handle_in_part) for each in self.part_poses])
        span = joint.open_position - joint.closed_position
        step = 0.02 * span
        low, high = sorted((joint.closed_position, joint.open_position))
        near = [self._handle_at(float(np.clip(start + sign * step, low, high))) for sign in (-1.0, 1.0)]
        outward = near[1][:3] - near[0][:3]
        self.outward = outward / np.linalg.norm(outward)
        """Unit vector: where the handle moves when the part opens, at the start."""
        self.front = self._front()
        """Unit vector: from where a hand comes to the handle, out of the front of the part."""
        self.openness = (start - joint.closed_position) / span
        self.is_closing = (target - start) * span < 0.0
        self.is_level = float(np.ptp(self.handles[:, 2])) < _LEVEL_M
        """Whether it moves horizontally, and stays where it is let go."""

    def ways(self) -> Iterator[PartContact]:
        """The ways that are possible, the preferred first."""
        if self.is_closing and not self.is_level:
            yield PartContact.PUSH
        yield PartContact.HANDLE
        if not self.part.joint.is_prismatic and self.openness >= _AJAR:
            yield PartContact.EDGE
        if self.is_level and (self.is_closing or (not self.part.joint.is_prismatic and self.openness >= _AJAR)):
            yield PartContact.PUSH

    def find(self, way: PartContact, floor: FloorMap | None, steps: int) -> PartMotion:
        """The best placement of a way.

        Raises:
            UnreachableError: there is none.
        """
        part = self.part
        body, poses = (self.handle, self.handles) if way is PartContact.HANDLE else (part.id, self.part_poses)
        candidates = [(each, pose_multiply(poses, each.pose)) for each in self._candidates(way)]
        if way is PartContact.PUSH and self.is_closing and not part.joint.is_prismatic:
            candidates = [*self._sweeps(), *candidates]
        free = self._free(way, body, self._within_reach(body, candidates))
        request = GraspMotionRequest(
            body,
            [grasp for grasp, _ in free],
            poses,
            BACK_M[way is not PartContact.EDGE],
            paths=[path for _, path in free],
            joint=part.joint.id,
            joint_positions=self.positions.tolist(),
            moved=self._moved_door(),
            touched=(part.id, self.handle),
            least=_LEAST_PART,
            enough=_ENOUGH[self.is_level],
            is_closed=way is PartContact.PUSH,
            checks_path_closed=way is not PartContact.PUSH,
            steps=steps,
            avoided=[each.placement.base for each in self.tried if each.way is way],
        )
        placement = find_grasp_motion(self.hand, request, floor)
        return PartMotion(way, placement, body, poses, request.paths[placement.number], self.positions)

    def _part_pose_at(self, position: float) -> Array:
        return normalized_pose_array(self.part.joint.pose_at(position))

    def _handle_at(self, position: float) -> Array:
        return pose_multiply(self._part_pose_at(position), self.handle_in_part)

    def _front(self) -> Array:
        """Where it opens to; of a door that slides along its front, the side across it on which the handle is."""
        size = self.surroundings.body(self.part.id).size
        if not self.part.joint.is_prismatic or size is None:
            return self.outward
        thin, (thickness_m, width_m, _) = int(np.argmin(size)), sorted(size)
        across = quat_rotate(self.part_poses[0, 3:], np.eye(3)[thin])
        if thickness_m > _PANEL * width_m or max(abs(float(across @ self.outward)), abs(float(across[2]))) > _ALONG:
            return self.outward
        offset = float(self.handle_in_part[thin])
        if abs(offset) < _TOUCHING_M:  # it has no handle in front of it
            here = np.array([*self.hand.robot.base_pose()[:2], self.part_poses[0, 2]])
            offset = float((here - self.part_poses[0, :3]) @ across)
        return np.asarray(across * np.sign(offset))

    def _moved_door(self) -> dict[BodyId, Array]:
        """Where a door with a vertical axis, which may shut in the base, and its handle are on the path; else empty."""
        if self.part.joint.is_prismatic or not self.is_level:
            return {}
        return {self.part.id: self.part_poses, self.handle: self.handles}

    # -- grasps ------------------------------------------------------------------------------------------------------

    def _candidates(self, way: PartContact) -> list[Grasp]:
        """The grasps or pushes of a way, the preferred first."""
        hand, surroundings, part = self.hand, self.surroundings, self.part
        part_pose, edge = self.part_poses[0], self.handle_in_part[:3]
        outward = quat_rotate(quat_conjugate(part_pose[3:]), self.outward)
        body = surroundings.body(self.handle if way is PartContact.HANDLE else part.id)
        geometry = surroundings.geometry(body.id)
        if way is PartContact.EDGE:
            return list(edge_grasps_of(body, geometry, outward, edge, hand.gripper, hand.shape))
        if way is PartContact.PUSH:
            side = outward if self.is_closing else -outward
            pushes = pushes_of(body, geometry, side, edge, hand.shape)
            return [each for each in pushes if quat_rotate(each.in_world(part_pose)[3:], (1.0, 0.0, 0.0))[2] < _MAX_UP]
        pose = self.handles[0]

        def facing(grasp: Grasp) -> float:
            return -float(quat_rotate(grasp.in_world(pose)[3:], (1.0, 0.0, 0.0)) @ self.front)

        grasps = [each for each in grasps_of(body, geometry, pose, hand.gripper, hand.shape) if facing(each) >= _FACING]
        wide_m = _WIDE * hand.gripper.max_opening_m
        grasps.sort(
            key=lambda each: (not each.is_whole, each.width_m > wide_m, not each.is_central, -round(facing(each), 2))
        )
        diagonals = diagonal_grasps_of(body, geometry, hand.gripper, hand.shape)
        return [*grasps, *(each for each in diagonals if facing(each) >= _DIAGONAL_FACING)]

    def _sweeps(self) -> list[tuple[Grasp, Array]]:
        """Pushes of the closing door with the finger tips, with their paths."""
        id = self.part.id
        outward = quat_rotate(quat_conjugate(self.part_poses[0, 3:]), self.outward)
        body, geometry = self.surroundings.body(id), self.surroundings.geometry(id)
        return list(sweeps_of(body, geometry, outward, self.handle_in_part[:3], self.part_poses, self.hand.shape))

    def _within_reach(self, body: BodyId, candidates: Sequence[tuple[Grasp, Array]]) -> Sequence[tuple[Grasp, Array]]:
        """The grasps that an arm reaches that takes the base along, if this stands where it likes; all for other arms.

        Raises:
            UnreachableError: there is none; with the limits of the one that is missed by least.
        """
        hand = self.hand
        if not hand.needs_base or not candidates:
            return candidates
        found = list[tuple[Grasp, Array]]()
        nearest: IkResult | None = None
        seed = {**hand.robot.joint_positions(), **hand.ready_positions()}
        before = hand.kinematics.iterations
        for grasp, path in candidates:
            x, y, yaw = path[0, 0], path[0, 1], _heading(path[0])
            result = hand.kinematics.solve_ik(
                hand.kinematics.frame_of(hand.arm),
                path[0],
                joints=(*BASE_JOINTS, *hand.arm.joints),
                seed=seed,
                root_pose=hand.base_frame.root_at((x - _APART_M * cos(yaw), y - _APART_M * sin(yaw), yaw - hand.side)),
                attempts=_REACH_ATTEMPTS,
            )
            if result:
                found.append((grasp, path))
            elif nearest is None or result.position_error_m + result.rotation_error_rad < (
                nearest.position_error_m + nearest.rotation_error_rad
            ):
                nearest = result
        hand.task.limit.count(hand.kinematics.iterations - before)
        if not found and nearest is not None:
            raise UnreachableError(hand.robot.name, target=body, reason=nearest.reason, shortfall_m=nearest.shortfall_m)
        return found

    def _free(
        self, way: PartContact, body: BodyId, candidates: Sequence[tuple[Grasp, Array]]
    ) -> list[tuple[Grasp, Array]]:
        """The grasps at which the gripper alone is free, with their paths, the longest free paths first.

        Raises:
            UnreachableError: there is none.
        """
        if not candidates:
            raise UnreachableError(self.hand.robot.name, target=body, reason=self._why_no_grasp(way))
        checker = HandChecker(self.hand.robot, self.hand.gripper, touch={self.part.id, self.handle})
        free: list[tuple[float, Grasp, Array]] = []
        worst: list[Collision] = []
        for grasp, path in candidates:
            hit = self._hit_before(checker, way, grasp, path[0])
            if hit is None:
                free.append((self._free_part(checker, way, grasp, path), grasp, path))
            else:
                worst.append(hit)
        long_enough = [each for each in free if each[0] >= _LEAST_PART]
        if not long_enough:
            nearest = max(worst, key=lambda each: each.distance_m - each.least_m, default=None)
            where = "at the begin of its path" if free else f"at each of {len(candidates)} grasps of it"
            raise UnreachableError(
                self.hand.robot.name,
                target=body,
                reason=f"the gripper has no room {where}: at best {nearest}" if nearest else "the gripper has no room",
                obstacle=None if nearest is None else nearest.obstacle,
            )
        return _varied(long_enough)

    def _why_no_grasp(self, way: PartContact) -> str:
        """Why there is nothing at which the part can be grasped or pushed."""
        part = self.part
        if way is PartContact.HANDLE and part.handle is None:
            return f"it has no handle, and no edge of it is free while it is {max(self.openness, 0.0):.0%} open"
        gripper, size = self.hand.gripper, self.surroundings.body(part.handle or part.id).size or (0.0,)
        what = "its handle" if way is PartContact.HANDLE else "its edge"
        width_m, opening_m = min(size), gripper.max_opening_m
        return f"{what}, {width_m:.3f} m across, does not fit the {gripper.name}, which opens {opening_m:.3f} m"

    def _hit_before(self, checker: HandChecker, way: PartContact, grasp: Grasp, at: Array) -> Collision | None:
        """What the gripper touches at a grasp, or on the straight line to it."""
        checker.set_joint(self.part.joint.id, float(self.positions[0]))
        opening_m = 0.0 if way is PartContact.PUSH else grasp.opening_m(self.hand.gripper.max_opening_m)
        return self.hand.hit_before(checker, at, BACK_M[way is not PartContact.EDGE], opening_m)

    def _free_part(self, checker: HandChecker, way: PartContact, grasp: Grasp, path: Array) -> float:
        """The part of the path along which the gripper is free."""
        fingers = self.hand.fingers_at(0.0 if way is PartContact.PUSH else grasp.width_m)
        for row in range(0, len(path), _CHECKED_EVERY):
            checker.set_joint(self.part.joint.id, float(self.positions[row]))
            if checker.find(path[row], fingers) is not None:
                return max(row - _CHECKED_EVERY, 0) / (len(path) - 1)
        return 1.0


def _heading(pose: Array) -> float:
    """The horizontal direction in which a hand points [rad]."""
    x = quat_rotate(pose[3:], (1.0, 0.0, 0.0))
    return atan2(x[1], x[0])


def _varied(free: Sequence[tuple[float, Grasp, Array]]) -> list[tuple[Grasp, Array]]:
    """Grasps with the longest free paths, with few of each direction of approach."""
    counts: dict[tuple[float, ...], int] = {}
    found: list[tuple[Grasp, Array]] = []
    for _, grasp, path in sorted(free, key=lambda each: -round(each[0], 1)):
        direction = quat_rotate(grasp.pose[3:], (1.0, 0.0, 0.0))
        across = np.abs(quat_rotate(grasp.pose[3:], (0.0, 1.0, 0.0)))
        group = (*np.round(direction, 1).tolist(), *np.round(across, 1).tolist(), float(grasp.is_whole))
        counts[group] = counts.get(group, 0) + 1
        if counts[group] <= _PER_GROUP:
            found.append((grasp, path))
    return found[:_MAX_GRASPS]
