"""Skills that move the robot, but nothing else."""

from __future__ import annotations

from math import atan2, cos, pi, sin

import numpy as np

from mindstage.errors import UnreachableError
from mindstage.robots.floor_poses import BasePose
from mindstage.robots.models.robot_model import Head
from mindstage.robots.navigation import FloorMap, plan_base
from mindstage.robots.skill_declaration import AngleRad, LengthM, SkillMotion, SkillNeed, ThingName, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills.grasp_motion import GraspMotionRequest, find_grasp_motion
from mindstage.robots.skills.grasps import approaches_of
from mindstage.robots.skills.handling import find_grasp
from mindstage.robots.skills.manipulator import guarded, hands_of
from mindstage.robots.surroundings import Surroundings
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array, quat_rotate

__all__ = ["drive_to", "go_to", "look_at", "park", "reach"]

_DISTANCES_M = (0.65, 0.8, 1.0, 0.5, 1.3)
"""Distances of the base from the nearest side of a thing, the preferred first."""
_BEARING_COUNT = 16
_BACK_M = 0.12
"""How far the hand stops in front of what it cannot grasp."""
_HEAD_STEPS = 40
_WAY_TESTS = 8000
"""Number of poses that the search for a way to each place tests."""


@skill(
    needs=(SkillNeed.MOBILE_BASE,),
    alternatives=(("thing",), ("x", "y", "yaw")),
    wordings=("go to {thing}", "drive to {thing}", "move to {thing}"),
)
def go_to(
    task: SkillTask,
    thing: ThingName | None = None,
    x: LengthM | None = None,
    y: LengthM | None = None,
    yaw: AngleRad = 0.0,
) -> SkillMotion:
    """Drives to a thing, and faces it, or to a place on the floor.

    Args:
        thing: where to drive to.
        x: of the place [m].
        y: of the place [m].
        yaw: the direction in which the robot faces there [rad].
    """
    yield from _parking_empty_hands(task)
    if thing is None:
        yield from drive_to(task, (float(x or 0.0), float(y or 0.0), yaw))
        return
    surroundings = task.surroundings()
    id = surroundings.find(thing)
    yield from drive_to(task, _place_near(task, surroundings, id))


def drive_to(task: SkillTask, base: BasePose) -> SkillMotion:
    """Drives to a pose of the base.

    Raises:
        UnreachableError: there is no way.
        SkillFailedError: something was in the way.
    """
    with task.step("drive", f"drive to ({base[0]:.2f}, {base[1]:.2f})"):
        result = yield from guarded(task, task.robot.driving(plan_base(task.robot, base, part_of=task.limit)))
        if not result:
            raise task.failure(result.reason, "move what is in the way, or drive to another place")


def _place_near(task: SkillTask, surroundings: Surroundings, id: BodyId) -> BasePose:
    """The nearest place beside a thing to which there is a way.

    Raises:
        UnreachableError: there is none.
    """
    floor = FloorMap(task.robot)
    low, high = surroundings.box(id)
    middle = (low + high)[:2] / 2
    reason = "no place beside it is free"
    for distance in _DISTANCES_M:
        places = []
        for number in range(_BEARING_COUNT):
            bearing = 2 * pi * number / _BEARING_COUNT
            x, y = middle + _on_border((high - low)[:2] / 2 + distance, bearing)
            length = floor.length_to(x, y)
            if length is not None:
                places.append((length, (float(x), float(y), atan2(middle[1] - y, middle[0] - x))))
        for _, base in sorted(places):
            try:
                plan_base(task.robot, base, max_tests=_WAY_TESTS, part_of=task.limit, floor=floor)
            except UnreachableError as error:
                reason = error.reason
                continue
            return base
    raise UnreachableError(task.robot.name, target=id, reason=reason)


def _on_border(half: Array, bearing: float) -> Array:
    """The point of a rectangle's border in a direction from its center."""
    direction = np.array([cos(bearing), sin(bearing)])
    return direction * float(np.min(half / np.maximum(np.abs(direction), 1e-9)))


def _parking_empty_hands(task: SkillTask) -> SkillMotion:
    for hand in hands_of(task):
        if hand.held is None:
            yield from hand.parking()


@skill(needs=(SkillNeed.HEAD,), wordings=("look at {thing}",))
def look_at(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Turns the head towards a thing.

    Args:
        thing: what to look at.
    """
    surroundings = task.surroundings()
    id = surroundings.find(thing)
    head = task.robot.model.head
    assert head is not None
    low, high = surroundings.box(id)
    positions, off = _head_positions(task, head, (low + high) / 2)
    with task.step("look", f"look at {id}"):
        result = yield from task.robot.moving_to(positions)
        if not result:
            raise task.failure(result.reason, "move what is in the way of the head")
    if off > 0.1:
        raise task.failure(
            f"the head cannot turn far enough: {id} is {off:.2f} rad beside its direction", "turn the robot first"
        )


def _head_positions(task: SkillTask, head: Head, point: Array) -> tuple[dict[str, float], float]:
    """Positions of the head's joints in which its camera points at a point, and the angle that is left [rad]."""
    robot, kinematics = task.robot, task.kinematics
    sensors = [each for each in robot.model.sensors if each.type.value.endswith("camera")]
    frame, axis = head.link, np.array([1.0, 0.0, 0.0])
    for each in sensors:
        if set(head.joints) <= set(kinematics.joints_of(each.link)):
            frame, axis = each.link, np.array([0.0, 0.0, 1.0]) if each.is_optical else axis
            break
    root, now = robot.link_pose(robot.model.root), robot.joint_positions()
    limits = [kinematics.limits(name) for name in head.joints]

    def off(values: Array) -> float:
        pose = kinematics.pose(frame, {**now, **dict(zip(head.joints, values.tolist(), strict=True))}, root_pose=root)
        towards = point - pose[:3]
        cosine = quat_rotate(pose[3:], axis) @ towards / max(float(np.linalg.norm(towards)), 1e-9)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    low, high = (np.array([max(min(limit[end], pi), -pi) for limit in limits]) for end in (0, 1))
    best = np.clip(np.array([now[name] for name in head.joints]), low, high)
    step = 0.8
    for _ in range(_HEAD_STEPS):  # coordinate descent: the angle has one minimum within a turn
        moves = [best + sign * step * np.eye(len(best))[row] for row in range(len(best)) for sign in (1.0, -1.0)]
        options = [np.clip(each, low, high) for each in moves]
        better = min(options, key=off)
        if off(better) < off(best) - 1e-6:
            best = better
        else:
            step /= 2
    return dict(zip(head.joints, best.tolist(), strict=True)), off(best)


@skill(needs=(SkillNeed.ARM,), alternatives=(("thing",), ("x", "y", "z")), wordings=("reach for {thing}",))
def reach(
    task: SkillTask,
    thing: ThingName | None = None,
    x: LengthM | None = None,
    y: LengthM | None = None,
    z: LengthM | None = None,
) -> SkillMotion:
    """Moves the gripper in front of a thing, or to a point; the base stays where it is.

    Args:
        thing: the gripper stops in front of it, where it can be grasped from, if it can be grasped.
        x: of the point [m].
        y: of the point [m].
        z: of the point [m].
    """
    hand = hands_of(task)[0]
    if thing is None:
        point = np.array([float(x or 0.0), float(y or 0.0), float(z or 0.0), *hand.grasp_pose[3:]])
        yield from hand.moving_to(point, why=f"to ({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})", free="xyz")
        return
    surroundings = task.surroundings()
    id = surroundings.find(thing)
    target = surroundings.thing(id)
    try:
        placement = find_grasp(hand, target, stays=True)
    except UnreachableError as error:
        approaches = list(approaches_of(target.body, target.geometry, target.pose, hand.shape))
        request = GraspMotionRequest(id, approaches, target.pose[None], _BACK_M, stays=True)
        try:
            placement = find_grasp_motion(hand, request)
        except UnreachableError:
            raise error from None
    yield from hand.opening(placement.grasp.opening_m(hand.gripper.max_opening_m))
    yield from hand.moving_to(placement.start, why=f"in front of {id}")


@skill(needs=(SkillNeed.ARM,))
def park(task: SkillTask) -> SkillMotion:
    """Folds the arms, so that they are out of the way."""
    for hand in hands_of(task):
        yield from hand.parking()
