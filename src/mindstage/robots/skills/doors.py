"""Skills that open and close doors and drawers: by their handles, by their free edges, or with a push."""

from __future__ import annotations

import numpy as np

from mindstage.errors import CommandRefusedError, SkillFailedError, UnreachableError
from mindstage.robots.arm_paths import ArmPath
from mindstage.robots.skill_declaration import FractionOpen, SkillMotion, SkillNeed, ThingName, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills.manipulator import Manipulator, free_hand
from mindstage.robots.skills.part_motion import BACK_M, PartContact, PartMotion, find_part_motion, find_stop
from mindstage.robots.surroundings import ArticulatedPart, Surroundings
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array, normalized_pose_array, pose_inverse, pose_multiply

__all__ = ["ACCESS", "close_thing", "moving_part", "open_thing"]

ACCESS = {True: 1.0, False: 0.7}
"""How far drawers and doors are opened to get at what is in them; a door that is fully open is hard to close again."""
_NEEDS = (SkillNeed.ARM, SkillNeed.GRIPPER)
_PUSH_BACK_M = 0.1
_PRESS_M = 0.004
"""How far the gripper is ahead of the part that it pushes."""
_SLIP_M = 0.04
"""A handle that is farther from the gripper than when it was grasped has slipped."""
_REST_S = 1.0
"""Time in which a part stays where it was let go, if it is there [s]."""
_TOLERANCES = {True: 0.05, False: 0.04}
"""Permitted error of the openness when a part is opened, and when it is closed."""
_MOVED = 0.03
"""A part whose openness has changed by more since its motion was planned is not where the hand would grasp it."""
_WHOLE, _EXACT, _MISSING = 0.98, 0.02, 0.15
"""After a motion that was planned for so much of the path, a part is pulled on if it is off by more, and less."""
_REST_POSES = 5
"""Number of poses of the rest of a motion."""
_NEAR = 0.1
"""What stops a part is named if it is not farther away, as a fraction of the range."""
_SHIFT_M = 0.02
"""What has moved by less in a part, or in its container, is still in it."""
_MAX_NAMES = 3
"""Number of things that a reason names at most."""
_MAX_ROUNDS = 10
"""How often the handle is grasped anew to move the part farther."""
_LEAST_PROGRESS = 0.08
"""Change of the openness in a round below which the next one is from another place, or another way."""


@skill(name="open", needs=_NEEDS, wordings=("open {thing}", "open up {thing}"))
def open_thing(task: SkillTask, thing: ThingName, fraction: FractionOpen = 1.0) -> SkillMotion:
    """Opens a door or drawer by its handle.

    Args:
        thing: the door or drawer, or a container with one.
        fraction: how far, from 0 (closed) to 1.
    """
    surroundings = task.surroundings()
    part = surroundings.articulated_part(surroundings.find(thing))
    yield from moving_part(task, part, fraction)


@skill(name="close", needs=_NEEDS, wordings=("close {thing}", "shut {thing}"))
def close_thing(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Closes a door or drawer.

    Args:
        thing: the door or drawer, or a container with one; of a container everything that is open.
    """
    surroundings = task.surroundings()
    id = surroundings.find(thing)
    parts = surroundings.articulated_parts_of(id)
    if not parts:
        surroundings.articulated_part(id)  # raises, with what can be closed
    for part in parts:
        if part.openness > _TOLERANCES[False] or len(parts) == 1:
            yield from moving_part(task, part, 0.0)


def moving_part(task: SkillTask, part: ArticulatedPart, fraction: float, *, at_least: bool = False) -> SkillMotion:
    """Moves a door or drawer to a fraction of its range, in several rounds if the arm does not reach all the way.

    Args:
        part: the door or drawer.
        fraction: from 0 to 1.
        at_least: whether it may be open by more, as where it is opened to get at what is behind it.

    Raises:
        SkillFailedError: it did not get there, with how far it is open; or what was inside is not any more.
    """
    surroundings = task.surroundings()
    contents = surroundings.contents_of(part)
    before = {id: _seen_from(surroundings, part, id) for id in contents}
    yield from _moving_rounds(task, part, fraction, at_least=at_least)
    later = task.surroundings()
    inside = later.contents_of(part)
    lost = [each for each in contents if each not in inside and later.exists(each)]
    lost = [
        each for each in lost if np.min(np.abs(_seen_from(later, part, each) - before[each]).max(axis=1)) > _SHIFT_M
    ]
    if lost:
        where = ", ".join(f"{each} is {later.support_of(each)}" for each in lost[:_MAX_NAMES])
        reason = f"{part.id} is {part.openness:.0%} open, but what was inside did not stay there: {where}"
        raise task.failure(reason, "put it back, or move the part with less speed")


def _seen_from(surroundings: Surroundings, part: ArticulatedPart, id: BodyId) -> Array:
    """Where a thing is in the frames of a part and of its container, 2 x 3 [m]."""
    pose = surroundings.pose(id)
    frames = (surroundings.pose(each) for each in (part.id, part.container))
    return np.array([pose_multiply(pose_inverse(frame), pose)[:3] for frame in frames])


def _moving_rounds(task: SkillTask, part: ArticulatedPart, fraction: float, *, at_least: bool) -> SkillMotion:
    """See `moving_part`."""

    def missing() -> float:
        return fraction - part.openness if at_least else abs(fraction - part.openness)

    task.opened[part.id] = None
    verb = "close" if fraction < part.openness else "open"
    tolerance = _TOLERANCES[verb == "open"]
    errors: list[SkillFailedError | UnreachableError | CommandRefusedError] = []
    tried: list[PartMotion] = []
    for round_number in range(_MAX_ROUNDS):
        if missing() <= tolerance and round_number:
            yield _REST_S
        before = part.openness
        if missing() <= tolerance:
            return
        if task.limit.is_over:
            state = f"{part.id} is {before:.0%} open instead of {fraction:.0%}"
            raise task.failure(f"{state}: no way to move it was found {task.limit}", "move what is near it away")
        hand = free_hand(task, f"to move {part.id}")
        target = part.joint.position_at(fraction)
        try:
            yield from hand.parking()
        except SkillFailedError as error:
            errors.append(error)
            continue  # it is planned anew from where the arm was stopped
        except UnreachableError as error:
            errors.append(error)  # there is no room for it: it goes on with the arm as it is
        if missing() <= tolerance:
            continue  # it has moved on when the hand let it go
        try:
            motion = find_part_motion(hand, part, task.surroundings(), target, tried=tried)
        except UnreachableError as error:
            errors.append(error)
            break
        try:
            yield from _moving_once(task, hand, part, motion, verb, fraction)
        except (SkillFailedError, UnreachableError, CommandRefusedError) as error:
            errors.append(error)
        if abs(part.openness - before) < _LEAST_PROGRESS:
            tried.append(motion)
    if missing() > tolerance:
        reasons = dict.fromkeys(getattr(each, "reason", "") or str(each) for each in errors)
        last = errors[-1] if errors else None
        stop = find_stop(task.robot, part, part.joint.position_at(fraction))
        if stop is not None and abs(stop.position - part.joint.position) <= _NEAR * abs(
            part.joint.position_at(1.0) - part.joint.closed_position
        ):
            reasons = {stop.reason: None} | reasons
        raise task.failure(
            f"{part.id} is {part.openness:.0%} open instead of {fraction:.0%}: "
            + ("; then ".join(reasons) or "it cannot be moved farther"),
            getattr(last, "suggestion", "") or f"{verb} it from somewhere else, or only as far as needed",
        )


def _moving_once(
    task: SkillTask,
    hand: Manipulator,
    part: ArticulatedPart,
    motion: PartMotion,
    verb: str,
    fraction: float,
) -> SkillMotion:
    """Grasps a handle or an edge, or touches a side, moves it as far as possible from one placement, and releases it.

    Args:
        motion: the placement and the path.
        verb: "open" or "close".
        fraction: where to, from 0 to 1.
    """
    body, placement, planned = motion.body, motion.placement, part.openness
    yield from hand.driving_to(placement.base, why=f"to reach {body}")
    if motion.way is PartContact.PUSH:
        yield from hand.closing()
    else:
        yield from hand.opening(placement.grasp.opening_m(hand.gripper.max_opening_m))
    yield from hand.moving_to(placement.start, why=f"in front of {body}")
    if abs(part.openness - planned) > _MOVED:
        return  # it has fallen, or was pushed on the way; the next round is planned for where it is now
    grasp = placement.grasp.in_world(task.surroundings().pose(body))
    yield from hand.moving_straight(grasp, why=f"to {body}", may_touch=True)
    if motion.way is PartContact.PUSH:
        yield from _pushing(task, hand, part, motion)
        return
    try:
        yield from hand.closing_on(body, *_parts(part))
        with task.step(verb, f"{verb} {part.id} to {fraction:.0%}"):
            yield from _moving_grasped(task, hand, part, motion)
            missing = abs(part.openness - fraction)
            if motion.placement.reach >= _WHOLE and _EXACT < missing <= _MISSING:
                rest = _rest_of_motion(task, part, motion)
                yield from _moving_grasped(task, hand, part, rest)
    except (SkillFailedError, UnreachableError, CommandRefusedError):
        yield from _letting_go(hand, part, motion)
        raise
    yield from _letting_go(hand, part, motion)


def _pushing(task: SkillTask, hand: Manipulator, part: ArticulatedPart, motion: PartMotion) -> SkillMotion:
    """Pushes a part along its path with the closed gripper, which touches it."""
    with task.step("push", f"push {part.id}"):
        pressed = motion.path.copy()
        ahead = _PRESS_M * np.linspace(1.0, 0.0, len(pressed))[:, None]
        pressed[:, :3] += ahead * _directions(pressed[:, :3])
        pressed = pressed[: motion.placement.stop]
        path = _free_path(hand, part, motion, hand.path(pressed, may_drive=hand.is_mobile))
        if path.reached >= 2:
            yield from hand.following(path, speed=0.4, cartesian_speed=0.15)
    yield from hand.withdrawing(_PUSH_BACK_M, touch=_parts(part))
    if path.reached < 2:
        raise task.failure(f"{motion.body} cannot be pushed: {path.reason}", "stand elsewhere")


def _directions(points: Array) -> Array:
    """The direction of a path at each of its points."""
    steps = np.gradient(points, axis=0)
    directions: Array = steps / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
    return directions


def _moving_grasped(task: SkillTask, hand: Manipulator, part: ArticulatedPart, motion: PartMotion) -> SkillMotion:
    """Moves the grasped handle or edge along its path."""
    surroundings, body = task.surroundings(), motion.body
    in_hand = pose_multiply(pose_inverse(surroundings.pose(body)), hand.grasp_pose)
    poses = pose_multiply(motion.poses[: motion.placement.stop], in_hand)
    path = _free_path(hand, part, motion, hand.path(poses, may_drive=hand.is_mobile, guide=motion.placement.path))
    if not path.is_complete:
        other = _free_path(hand, part, motion, hand.path(poses, may_drive=hand.is_mobile))
        path = max(path, other, key=lambda each: each.reached)
    if path.reached < 2:
        raise task.failure(f"{body} cannot be moved: {path.reason}", "stand elsewhere")

    def check() -> None:
        slipped = pose_multiply(pose_inverse(surroundings.pose(body)), hand.grasp_pose)[:3] - in_hand[:3]
        if np.linalg.norm(slipped) > _SLIP_M:
            raise task.failure(f"{body} slipped out of the gripper", "grasp it again, or move it with less speed")

    result = yield from hand.following(path, speed=0.4, cartesian_speed=0.08, on_tick=check)
    if not result:
        raise task.failure(result.reason, "move what is in the way")


def _rest_of_motion(task: SkillTask, part: ArticulatedPart, motion: PartMotion) -> PartMotion:
    """From where a part is to the end of its motion: it was left behind by what the handle has slid in the fingers."""
    part_pose, body = (task.surroundings().pose(each) for each in (part.id, motion.body))
    in_part = pose_multiply(pose_inverse(part_pose), body)
    positions = np.linspace(part.joint.position, motion.positions[-1], _REST_POSES)
    part_poses = [normalized_pose_array(part.joint.pose_at(each)) for each in positions.tolist()]
    poses = np.array([pose_multiply(each, in_part) for each in part_poses])
    placement = motion.placement._replace(path=motion.placement.path._replace(reached=0), stop=len(poses))
    return motion._replace(poses=poses, positions=positions, placement=placement)


def _free_path(hand: Manipulator, part: ArticulatedPart, motion: PartMotion, path: ArmPath) -> ArmPath:
    """The first part of a path, up to where the robot would touch something else than the part.

    The path that was tested for the placement began at the exact grasp, and ended at a collision, too.
    """
    return hand.free_part(path, touch=_parts(part), joint=part.joint.id, joint_positions=motion.positions.tolist())


def _parts(part: ArticulatedPart) -> set[BodyId]:
    """A part and its handle."""
    return {part.id, part.handle or part.id}


def _letting_go(hand: Manipulator, part: ArticulatedPart, motion: PartMotion) -> SkillMotion:
    """Opens the gripper and withdraws it."""
    yield from hand.opening(hand.robot.opening(hand.gripper.name) + 2 * motion.placement.grasp.room_m)
    with hand.task.step("move", f"move the gripper away from {motion.body}"):
        yield from hand.withdrawing(BACK_M[motion.way is not PartContact.EDGE], touch=_parts(part))
