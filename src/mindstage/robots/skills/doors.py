"""Skills that open and close doors and drawers by their handles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mindstage.errors import CommandRefusedError, SkillFailedError, UnreachableError
from mindstage.robots.skills.declaration import FractionOpen, SkillMotion, SkillNeed, ThingName, skill
from mindstage.robots.skills.grasps import Grasp, grasps_of, pushes_of
from mindstage.robots.skills.manipulator import Manipulator, free_hand
from mindstage.robots.skills.stances import Stance, StanceRequest, find_stance
from mindstage.robots.skills.surroundings import Opening, Surroundings
from mindstage.robots.skills.task import SkillTask
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

__all__ = ["ACCESS", "close_thing", "moving_front", "open_thing"]

ACCESS = {True: 1.0, False: 0.7}
"""How far drawers and doors are opened to get at what is in them; a door that is fully open is hard to close again."""
_NEEDS = (SkillNeed.ARM, SkillNeed.GRIPPER)
_STEP_M = 0.02
"""Distance of the handle between neighboring poses of its path."""
_FACING = 0.7
"""Least cosine between the direction of approach and the outward direction of the front."""
_LEVEL_M = 0.05
"""A handle whose height changes by less is on a door with a vertical axis."""
_WHOLE_GRASPS, _PART_GRASPS = 6, 6
_BACK_M = 0.1
"""Distance from which a handle is approached, and to which the gripper withdraws."""
_LET_GO_M = 0.05
"""By how much the gripper opens to let go of a handle."""
_PUSH_BACK_M = 0.1
_PRESS_M = 0.004
"""How far the gripper is ahead of the front that it pushes."""
_MAX_UP = 0.5
"""Largest upward component of the direction in which a hand points that pushes."""
_SLIP_M = {False: 0.04, True: 0.07}
"""A handle that is farther from the gripper than when it was grasped has slipped; held by friction, and by a spring."""
_LEAD_RATE, _MAX_LEAD_M = 16.0, 0.3
"""How fast the target of the spring moves ahead by the distance of the handle from the gripper [1/s], and how far."""
_TOLERANCES = {True: 0.07, False: 0.04}
"""Permitted error of the openness when a front is opened, and when it is closed."""
_MAX_ROUNDS = 4
"""How often the handle is grasped anew to move the front farther."""
_LEAST_PROGRESS = 0.08
"""Change of the openness in a round below which no other one is tried."""


@skill(name="open", needs=_NEEDS)
def open_thing(task: SkillTask, thing: ThingName, fraction: FractionOpen = 1.0) -> SkillMotion:
    """Opens a door or drawer by its handle.

    Args:
        task: this performance of the skill.
        thing: the door or drawer, or a container with one.
        fraction: how far, from 0 (closed) to 1.
    """
    surroundings = task.surroundings()
    opening = surroundings.opening(surroundings.find(thing))
    yield from moving_front(task, opening, fraction)


@skill(name="close", needs=_NEEDS)
def close_thing(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Closes a door or drawer.

    Args:
        task: this performance of the skill.
        thing: the door or drawer, or a container with one; of a container everything that is open.
    """
    surroundings = task.surroundings()
    id = surroundings.find(thing)
    openings = surroundings.openings_of(id)
    if not openings:
        surroundings.opening(id)  # raises, with what can be closed
    for opening in openings:
        if opening.openness > _TOLERANCES[False] or len(openings) == 1:
            yield from moving_front(task, opening, 0.0)


class _FrontPath(NamedTuple):
    """How a handle moves with its front."""

    positions: Array
    """n positions of the joint [m or rad], the present one first."""
    handles: Array
    """n x 7: poses of the handle in the world frame."""
    outward: Array
    """Unit vector: where the handle moves when the front opens, at the first position."""


def moving_front(task: SkillTask, opening: Opening, fraction: float) -> SkillMotion:
    """Moves a door or drawer to a fraction of its range, in several rounds if the arm does not reach all the way.

    Raises:
        SkillFailedError: it did not get there, with how far it is open.
    """
    task.opened[opening.front] = None
    verb = "close" if fraction < opening.openness else "open"
    tolerance = _TOLERANCES[verb == "open"]
    last: SkillFailedError | UnreachableError | CommandRefusedError | None = None
    is_fixed = False
    for _ in range(_MAX_ROUNDS):
        before = opening.openness
        if abs(before - fraction) <= tolerance:
            return
        try:
            yield from _moving_once(task, opening, fraction, is_fixed=is_fixed)
        except (SkillFailedError, UnreachableError, CommandRefusedError) as error:
            last = error
        if abs(opening.openness - before) < _LEAST_PROGRESS:
            if is_fixed or not isinstance(last, SkillFailedError):
                break
            is_fixed = True  # the fingers do not hold this handle
    if abs(opening.openness - fraction) > tolerance:
        reason = getattr(last, "reason", "") or str(last or "the handle cannot be moved farther")
        raise task.failure(
            f"{opening.front} is {opening.openness:.0%} open instead of {fraction:.0%}: {reason}",
            getattr(last, "suggestion", "") or f"{verb} it from somewhere else, or only as far as needed",
        )


def _moving_once(task: SkillTask, opening: Opening, fraction: float, *, is_fixed: bool) -> SkillMotion:
    """Grasps the handle, moves it as far as possible from one stance, and releases it.

    Args:
        task: the skill.
        opening: the door or drawer.
        fraction: where to, from 0 to 1.
        is_fixed: whether the handle is fixed to the gripper by a spring, instead of being held by friction.
    """
    hand = free_hand(task, f"to move {opening.front}")
    surroundings = task.surroundings()
    handle = opening.handle or opening.front
    path = _front_path(opening, surroundings, handle, opening.joint.position_at(fraction))
    yield from hand.parking(touch=(handle, opening.front))
    try:
        stance = _find_stance(hand, opening, handle, path, surroundings)
    except UnreachableError as error:
        if fraction > opening.openness and (opening.joint.is_prismatic or opening.is_closed):
            raise
        yield from _pushing(task, hand, opening, handle, path, error)
        return
    yield from hand.driving_to(stance.base, why=f"to reach {handle}")
    yield from hand.opening(stance.grasp.opening_m(hand.gripper.max_opening_m))
    yield from hand.moving_to(stance.start, why=f"in front of {handle}")
    grasp = stance.grasp.in_world(surroundings.pose(handle))
    yield from hand.moving_straight(grasp, why=f"to {handle}", may_touch=True)
    try:
        is_between = yield from hand.closing()
        if is_fixed:
            task.assume(f"{handle} was fixed to the {hand.gripper.name} by a spring: the fingers do not hold it")
        elif not is_between:
            raise task.failure(f"the gripper closed without {handle} between its fingers", "approach it again")
        word = "close" if fraction < opening.openness else "open"
        with task.step(word, f"{word} {opening.front} to {fraction:.0%}"):
            yield from _moving_handle(task, hand, opening, handle, path, is_fixed=is_fixed)
    except (SkillFailedError, UnreachableError, CommandRefusedError):
        yield from _letting_go(hand, handle)
        raise
    finally:
        task.session.release(opening.front)
    yield from _letting_go(hand, handle)


def _pushing(
    task: SkillTask, hand: Manipulator, opening: Opening, handle: BodyId, path: _FrontPath, cause: UnreachableError
) -> SkillMotion:
    """Moves a front whose handle is out of reach by pushing a side with the closed gripper.

    It is closed by its outer side; a door that is open a little is opened farther by its inner one.

    Raises:
        UnreachableError: that side is out of reach, too; with the reason for the handle.
    """
    surroundings = task.surroundings()
    front = surroundings.pose(opening.front)
    body, geometry = surroundings.body(opening.front), surroundings.geometry(opening.front)
    is_closing = abs(path.positions[-1] - opening.joint.closed_position) < abs(
        path.positions[0] - opening.joint.closed_position
    )
    outward = quat_rotate(quat_conjugate(front[3:]), path.outward if is_closing else -path.outward)
    edge = pose_multiply(pose_inverse(front), surroundings.pose(handle))[:3]
    pushes = [
        each
        for each in pushes_of(body, geometry, outward, edge, hand.shape)
        if quat_rotate(each.in_world(front)[3:], (1.0, 0.0, 0.0))[2] < _MAX_UP
    ]
    fronts = np.array([normalized_pose_array(opening.joint.pose_at(float(each))) for each in path.positions])
    request = StanceRequest(
        opening.front,
        pushes,
        fronts,
        _PUSH_BACK_M,
        joint=opening.joint.id,
        joint_positions=path.positions.tolist(),
        is_closed=True,
    )
    try:
        stance = find_stance(hand, request)
    except UnreachableError:
        raise cause from None
    yield from hand.driving_to(stance.base, why=f"to reach {opening.front}")
    yield from hand.closing()
    yield from hand.moving_to(stance.start, why=f"beside {opening.front}")
    yield from hand.moving_straight(stance.grasp.in_world(front), why=f"to {opening.front}", may_touch=True)
    with task.step("push", f"push {opening.front}"):
        at = pose_multiply(fronts, stance.grasp.pose)
        pressed = at.copy()
        pressed[:, :3] += _PRESS_M * np.linspace(1.0, 0.0, len(at))[:, None] * _directions(at[:, :3])
        motion = hand.path(pressed, may_drive=hand.is_mobile)
        if motion.reached >= 2:
            yield from hand.following(motion, speed=0.4, cartesian_speed=0.15)
    yield from hand.withdrawing(pose_multiply(hand.grasp_pose, np.array([-_PUSH_BACK_M, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])))


def _directions(points: Array) -> Array:
    """The direction of a path at each of its points."""
    steps = np.gradient(points, axis=0)
    directions: Array = steps / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
    return directions


def _moving_handle(
    task: SkillTask, hand: Manipulator, opening: Opening, handle: BodyId, path: _FrontPath, *, is_fixed: bool
) -> SkillMotion:
    """Moves the grasped handle along its path."""
    surroundings = task.surroundings()
    from_handle = pose_multiply(pose_inverse(surroundings.pose(handle)), hand.grasp_pose)
    motion = hand.path(pose_multiply(path.handles, from_handle), may_drive=hand.is_mobile)
    if motion.reached < 2:
        raise task.failure(f"{handle} cannot be moved: {motion.reason}", "stand elsewhere")

    spring = _Spring(task, opening, handle, surroundings, from_handle) if is_fixed else None

    def check() -> None:
        if spring is not None:
            spring.pull_to(hand.grasp_pose)
        slipped = pose_multiply(pose_inverse(surroundings.pose(handle)), hand.grasp_pose)[:3] - from_handle[:3]
        if np.linalg.norm(slipped) > _SLIP_M[is_fixed]:
            raise task.failure(f"{handle} slipped out of the gripper", "grasp it again, or move it with less speed")

    result = yield from hand.following(motion, speed=0.4, cartesian_speed=0.08, on_tick=check)
    if not result:
        raise task.failure(result.reason, "move what is in the way")


class _Spring:
    """Pulls a handle to where the gripper holds it, with the force of an arm.

    The pull's spring alone gives way by several centimeters to the friction of a loaded drawer, so that its target
    moves ahead of the gripper as long as the handle stays behind.
    """

    def __init__(
        self, task: SkillTask, opening: Opening, handle: BodyId, surroundings: Surroundings, offset: Array
    ) -> None:
        self.task, self.front, self.handle, self.surroundings = task, opening.front, handle, surroundings
        self.to_handle = pose_inverse(offset)
        point = pose_multiply(pose_inverse(surroundings.pose(self.front)), surroundings.pose(handle))[:3]
        self.point = _vector(point)
        self.lead, self.last_s = np.zeros(3), task.time_s

    def pull_to(self, grasp_pose: Array) -> None:
        """Pulls to the present pose of the grasp frame, seven numbers."""
        wanted = pose_multiply(grasp_pose, self.to_handle)[:3]
        behind = wanted - self.surroundings.pose(self.handle)[:3]
        now_s = self.task.time_s
        self.lead += _LEAD_RATE * (now_s - self.last_s) * behind
        self.lead *= min(1.0, _MAX_LEAD_M / max(float(np.linalg.norm(self.lead)), 1e-9))
        self.last_s = now_s
        self.task.session.pull(self.front, point=self.point, target=_vector(wanted + self.lead))


def _vector(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _letting_go(hand: Manipulator, handle: BodyId) -> SkillMotion:
    """Opens the gripper and withdraws it."""
    yield from hand.opening(hand.robot.opening(hand.gripper.name) + _LET_GO_M)
    back = pose_multiply(hand.grasp_pose, np.array([-_BACK_M, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    with hand.task.step("move", f"move the gripper away from {handle}"):
        yield from hand.withdrawing(back)


def _front_path(opening: Opening, surroundings: Surroundings, handle: BodyId, target: float) -> _FrontPath:
    joint = opening.joint
    start = joint.position
    front = surroundings.pose(opening.front)
    from_front = pose_multiply(pose_inverse(front), surroundings.pose(handle))

    def handle_at(position: float) -> Array:
        return pose_multiply(normalized_pose_array(joint.pose_at(position)), from_front)

    ends = handle_at(start), handle_at(target)
    arm = float(np.linalg.norm(ends[1][:3] - ends[0][:3]))
    count = max(int(np.ceil(1.2 * arm / _STEP_M)), 2)
    positions = np.linspace(start, target, count + 1)
    step = 0.02 * (joint.open_position - joint.closed_position)
    low, high = sorted((joint.closed_position, joint.open_position))
    near = handle_at(float(np.clip(start - step, low, high))), handle_at(float(np.clip(start + step, low, high)))
    outward = near[1][:3] - near[0][:3]
    return _FrontPath(
        positions, np.array([handle_at(float(each)) for each in positions]), outward / np.linalg.norm(outward)
    )


def _with_parts(grasps: list[Grasp]) -> list[Grasp]:
    """Grasps of a handle, with some of its parts among the first: the bar may be too near to a wall, its end not."""
    whole = [each for each in grasps if each.is_whole]
    parts = [each for each in grasps if not each.is_whole]
    return [*whole[:_WHOLE_GRASPS], *parts[:_PART_GRASPS], *whole[_WHOLE_GRASPS:]]


def _moved_door(opening: Opening, handle: BodyId, path: _FrontPath) -> dict[BodyId, Pose]:
    """Where a door with a vertical axis, which may shut in the base, and its handle are at the end; else empty."""
    is_level = float(np.ptp(path.handles[:, 2])) < _LEVEL_M
    if opening.joint.is_prismatic or not is_level:
        return {}
    return {opening.front: opening.joint.pose_at(float(path.positions[-1])), handle: pose_from_array(path.handles[-1])}


def _find_stance(
    hand: Manipulator,
    opening: Opening,
    handle: BodyId,
    path: _FrontPath,
    surroundings: Surroundings,
) -> Stance:
    """Where to stand, and how to grasp the handle."""
    body, pose = surroundings.body(handle), surroundings.pose(handle)
    geometry = surroundings.geometry(handle)

    def facing(grasp: Grasp) -> float:
        return -float(quat_rotate(grasp.in_world(pose)[3:], (1.0, 0.0, 0.0)) @ path.outward)

    grasps = [each for each in grasps_of(body, geometry, pose, hand.gripper, hand.shape) if facing(each) >= _FACING]
    grasps.sort(key=lambda each: (not each.is_whole, not each.is_central, -round(facing(each), 2)))
    request = StanceRequest(
        handle,
        _with_parts(grasps),
        path.handles,
        _BACK_M,
        joint=opening.joint.id,
        joint_positions=path.positions.tolist(),
        moved=_moved_door(opening, handle, path),
        touched=(opening.front,),
    )
    return find_stance(hand, request)
