"""Skills that grasp, carry and put down things."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from math import cos, isfinite, pi, sin

import numpy as np

from mindstage.errors import NoFreePlacementError, SkillFailedError, UnreachableError
from mindstage.robots.collisions import Collision, HandChecker
from mindstage.robots.floor_poses import planar_pose
from mindstage.robots.models.forward_kinematics import link_poses, rest_positions
from mindstage.robots.models.link_tree import LinkTree
from mindstage.robots.models.robot_model import GripperType
from mindstage.robots.navigation import FloorMap
from mindstage.robots.skill_declaration import SkillMotion, SkillNeed, SupportName, ThingName, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills.doors import ACCESS, moving_part
from mindstage.robots.skills.grasp_motion import GraspMotion, GraspMotionRequest, find_grasp_motion
from mindstage.robots.skills.grasps import FINGER_CLEARANCE_M, Grasp, grasps_of
from mindstage.robots.skills.manipulator import Manipulator, free_hand, hand_with, hands_of
from mindstage.robots.surroundings import ArticulatedPart, Surroundings, Thing
from mindstage.scene import BodyId, Mobility, Pose
from mindstage.scene.edits import Detach
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_inverse,
    pose_multiply,
    quat_multiply,
    quat_rotate,
)

__all__ = ["find_grasp", "grasp", "pick", "pick_up", "place", "pour", "put_down", "release"]

_NEEDS = (SkillNeed.ARM, SkillNeed.GRIPPER)
_BACK_M = 0.12
"""Length of the straight line on which the hand comes to a thing, and withdraws from it."""
_LIFT_M = 0.04
"""Height to which a thing is lifted before it is moved away, and from which it is put down."""
_TILTED = 0.6
"""Vertical component of the direction of approach from which a hand does not reach into a shelf."""
_TURNED_OVER = 0.5
"""Vertical component of the direction of a hand's upper side beyond which it is upright, or upside down."""
_GAP_M = 0.006
"""Height above a surface at which what is put down still counts as free of collisions."""
_DRIFT_M = 0.025
"""A thing that has moved farther in the gripper while it was lifted is not held."""
_ATTEMPTS = 2
"""How often a thing is grasped that slips out of the gripper."""
_MAX_GRASPS = 24
"""Number of grasps that are tried."""
_NEARLY_M = 0.03
"""What is out of reach by less is tried with the finger tips."""
_FREE_PLACES = 60
"""Number of free places that are looked for."""
_PLACES = 10
"""Number of free places that are tried."""
_MAX_TOPS = 5
"""Number of bodies on which it is tried to set a thing aside."""
_MAX_STANCES = 4
"""Number of placements that are tried if the arm finds no way."""
_TURNS = 4
"""Number of ways in which a thing is turned at each place."""
_PLACE_STEPS = 25_000
"""Number of steps of the search for each; see `GraspMotionRequest.steps`."""
_CLOSE_M = 0.5
"""Places that are nearer than this to where the base can stand are equally good."""
_CARRY_DISTANCES, _CARRY_HEIGHTS = (0.08, 0.16, 0.26), (0.02, 0.2, -0.15)
"""Where things are carried, as parts of the length of the arm: in front of the base, and above the shoulder."""
_FOLDS = 13
"""Angles of a vertical hinge that are tried to take the hand near to the base."""
_ROOM_M = 0.03
"""By how much the gripper opens beyond what it held."""
_WIDE_OPEN = 0.9
"""A door or drawer that is open by more is not opened farther."""
_FARTHER = 0.05
"""Least change of the openness after which a thing behind it is looked for again."""
_MAX_NAMES = 3
"""Number of bodies that a reason names at most."""
_POUR_ANGLE_RAD, _POUR_STEPS, _POUR_GAP_M, _POUR_S = 1.9, 20, 0.06, 2.0


@skill(needs=_NEEDS, wordings=("grasp {thing}", "grip {thing}"))
def grasp(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Grasps a thing where it is, from where the robot stands.

    Args:
        thing: what to grasp.
    """
    surroundings = task.surroundings()
    id = surroundings.find(thing)
    if hand_with(task, id) is None:
        hand = free_hand(task, f"to grasp {id}")
        _check_loose(task, surroundings, id)
        yield from _grasping(task, hand, id, upright=None, stays=True)


@skill(needs=_NEEDS, wordings=("let go",))
def release(task: SkillTask) -> SkillMotion:
    """Opens the gripper and moves it away from what it held."""
    hand = hand_with(task)
    if hand is None:
        yield from free_hand(task, "").opening()
        return
    held = hand.held
    yield from _letting_go(task, hand)
    if held is not None:
        task.moved[held] = None


@skill(
    needs=_NEEDS,
    wordings=("pick up {thing}", "pick {thing} up", "take {thing}", "grab {thing}", "lift {thing}", "lift up {thing}"),
)
def pick(task: SkillTask, thing: ThingName) -> SkillMotion:
    """Drives to a thing, grasps it and lifts it; opens what it is in.

    Args:
        thing: what to pick up.
    """
    yield from pick_up(task, task.surroundings().find(thing))


@skill(
    needs=_NEEDS,
    alternatives=(("on",), ("into",)),
    wordings=tuple(
        f"{verb} {{thing}} {words}"
        for verb in ("put", "place", "set", "lay")
        for words in ("on {on}", "onto {on}", "on top of {on}", "in {into}", "into {into}", "inside {into}")
    ),
)
def place(
    task: SkillTask, thing: ThingName, on: SupportName | None = None, into: SupportName | None = None
) -> SkillMotion:
    """Puts a thing at a free place on or in another one; picks it up first if it is not held.

    Args:
        thing: what to put down.
        on: what to put it on.
        into: what to put it into; opened first if it is closed.
    """
    surroundings = task.surroundings()
    id, holder = surroundings.find(thing), surroundings.find(on or into or "")
    yield from put_down(task, id, holder, inside=on is None)


@skill(needs=_NEEDS, wordings=("pour {thing} into {into}", "pour from {thing} into {into}"))
def pour(task: SkillTask, thing: ThingName, into: SupportName) -> SkillMotion:
    """Tilts a thing over a container so that what is in it falls out; picks it up first if it is not held.

    Args:
        thing: the container to pour from.
        into: the container to pour into.
    """
    surroundings = task.surroundings()
    id, target = surroundings.find(thing), surroundings.find(into)
    contents = [each for each in surroundings.bodies() if id in surroundings.containers_of(each)]
    yield from pick_up(task, id)
    hand = hand_with(task, id)
    if hand is None:
        raise task.failure(f"{id} is not held any more", "pick it up again")
    yield from _tilting(task, hand, id, target)
    if not contents:
        text = f"liquids are not simulated: {id} was tilted over {target}, and whether it was full is not known"
        raise task.failure(text, f"put bodies into {id}, if it is to be seen what falls out", is_known=False)
    later = task.surroundings()
    spilled = [each for each in contents if target not in later.containers_of(each)]
    task.moved.update(dict.fromkeys(contents))
    count = f"{len(contents) - len(spilled)} of {len(contents)} things in {id} fell into {target}"
    if spilled:
        where = ", ".join(f"{each} is {later.support_of(each)}" for each in spilled[:_MAX_NAMES])
        raise task.failure(f"{count}: {where}", f"pour closer to {target}, or into something wider")
    with task.step("count", count):
        pass


# -- picking up --------------------------------------------------------------------------------------------------------


def pick_up(task: SkillTask, id: BodyId, *, upright: bool | None = None) -> SkillMotion:
    """Drives to a thing, opens what it is in, grasps it, lifts it and takes it in front of the robot.

    Args:
        id: the thing.
        upright: whether the hand comes from the side rather than from above, as where the thing is put down later; None
            if either will do.
    """
    if hand_with(task, id) is not None:
        return
    hand = free_hand(task, f"to pick up {id}")
    surroundings = task.surroundings()
    _check_loose(task, surroundings, id)
    for part in surroundings.closed_in_front_of(id):
        yield from moving_part(task, part, ACCESS[part.joint.is_prismatic], at_least=True)
    yield from hand.parking()
    for attempt in range(_ATTEMPTS):
        try:
            placement = yield from _grasping(task, hand, id, upright=upright)
        except SkillFailedError:
            if attempt == _ATTEMPTS - 1:
                raise
            yield from _letting_go(task, hand)
            yield from hand.parking()
            continue
        yield from carrying(task, hand, placement.back_m)
        return


def _check_loose(task: SkillTask, surroundings: Surroundings, id: BodyId) -> None:
    """Checks that a thing can be moved at all.

    Raises:
        SkillFailedError: it is simulated as fixed.
    """
    mobility = surroundings.body(id).physics.mobility
    if id in task.session.immovable or mobility is not Mobility.DYNAMIC:
        why = "its mobility is not given" if mobility is None else f"its mobility is {mobility.value}"
        why = "what has its class and size cannot be loose" if id in task.session.immovable else why
        raise task.failure(f"{id} is fixed: {why}", "pick up something loose, or give it a mobility in the map")


def _grasping(
    task: SkillTask,
    hand: Manipulator,
    id: BodyId,
    *,
    upright: bool | None,
    stays: bool = False,
) -> Generator[float, None, GraspMotion]:
    """Grasps a thing between the fingers, and lifts it.

    Args:
        id: the thing.
        upright: see `pick_up`.
        stays: whether the base stays where it is.

    Raises:
        SkillFailedError: the fingers closed on nothing, or it slipped out of them while it was lifted.
    """
    with task.step("grasp", f"grasp {id}"):
        task.moved[id] = None
        placement = yield from _hand_before(task, hand, id, upright=upright, stays=stays)
        surroundings = task.surroundings()
        yield from hand.moving_straight(placement.grasp.in_world(surroundings.pose(id)), why=f"to {id}", may_touch=True)
        yield from hand.closing_on(id)
        relative = pose_multiply(pose_inverse(hand.grasp_pose), surroundings.pose(id))
        up = hand.grasp_pose + np.array([0.0, 0.0, _LIFT_M, 0.0, 0.0, 0.0, 0.0])
        yield from hand.moving_straight(up, why=f"up with {id}", speed=0.2, may_touch=True)
        drift = pose_multiply(pose_inverse(hand.grasp_pose), surroundings.pose(id))[:3] - relative[:3]
        if np.linalg.norm(drift) > _DRIFT_M:
            raise task.failure(f"{id} slipped out of the gripper while it was lifted", "grasp it again")
    return placement


def _standing_before(
    hand: Manipulator, placement: GraspMotion, request: GraspMotionRequest
) -> Generator[float, None, GraspMotion]:
    """Drives to where a thing is grasped, and takes the open hand in front of it, by the first grasp with a way."""
    for _ in range(_MAX_STANCES):
        if not request.stays:
            yield from hand.driving_to(placement.base, why=f"to reach {request.target}")
        yield from hand.opening(placement.grasp.opening_m(hand.gripper.max_opening_m))
        try:
            yield from hand.moving_to(placement.start, why=f"in front of {request.target}", touch=(request.target,))
        except UnreachableError:
            others = [each for each in request.grasps if each.pose is not placement.grasp.pose]
            request = request._replace(grasps=others)
            placement = find_grasp_motion(hand, request)
            continue
        return placement
    raise UnreachableError(hand.robot.name, target=request.target, reason="the arm has no way to any of its grasps")


def _hand_before(
    task: SkillTask, hand: Manipulator, id: BodyId, *, upright: bool | None, stays: bool
) -> Generator[float, None, GraspMotion]:
    """Takes the open hand in front of a thing.

    What is in front of the thing is opened farther if there is no placement, or no way of the base or the arm.
    """
    parts = iter([] if stays else task.surroundings().in_front_of(id))
    while True:
        thing, floor = task.surroundings().thing(id), FloorMap(hand.robot) if hand.is_mobile and not stays else None
        try:
            found = _find_grasp(hand, thing, floor, upright=upright, stays=stays)
            return (yield from _standing_before(hand, *found))
        except UnreachableError as error:
            cause = error
        part = next((each for each in parts if each.openness <= _WIDE_OPEN), None)
        if part is None:
            raise cause
        before = part.openness
        try:
            yield from moving_part(task, part, 1.0)
            yield from hand.parking()
        except (SkillFailedError, UnreachableError) as error:
            if part.openness < before + _FARTHER:
                text = f"{part.id} is {part.openness:.0%} open and cannot be opened farther: {error.reason}"
                reason = f"{cause.reason}; {text}"
                raise UnreachableError(
                    cause.robot, target=cause.target, reason=reason, obstacle=cause.obstacle
                ) from None


def find_grasp(hand: Manipulator, thing: Thing, floor: FloorMap | None = None, *, stays: bool = False) -> GraspMotion:
    """How a hand gets in front of a thing to grasp it.

    Args:
        floor: the free floor, if the base may drive.
        stays: whether the base stays where it is.

    Raises:
        UnreachableError: it does not.
    """
    return _find_grasp(hand, thing, floor, upright=None, stays=stays)[0]


_Found = tuple[GraspMotion, GraspMotionRequest]


def _find_grasp(
    hand: Manipulator, thing: Thing, floor: FloorMap | None, *, upright: bool | None, stays: bool
) -> _Found:
    """A motion for a grasp, the one that comes from the preferred direction if possible.

    Raises:
        UnreachableError: there is none.
    """
    pose = thing.pose
    is_tall = (thing.body.size or (0.0, 0.0, 0.0))[2] > 0.09
    from_side = is_tall if upright is None else upright
    towards = _from_floor(hand, pose, floor)

    def cost(each: Grasp) -> tuple[float, ...]:
        at = each.in_world(pose)
        x = quat_rotate(at[3:], (1.0, 0.0, 0.0))
        steep = abs(x[2]) if from_side else 1.0 + x[2]
        low = max(0.0, thing.low[2] + 0.05 - at[2]) if from_side else 0.0
        aside = round(1.0 - float(x[:2] @ towards), 1)
        turned_over = hand.up * quat_rotate(at[3:], (0.0, 0.0, 1.0))[2] < -_TURNED_OVER
        return (
            not each.is_whole,
            round(float(steep), 1),
            aside,
            round(float(low), 2),
            not each.is_central,
            turned_over,
        )

    grasps = sorted(grasps_of(thing.body, thing.geometry, pose, hand.gripper, hand.shape), key=cost)
    if not grasps:
        raise UnreachableError(hand.robot.name, target=thing.id, reason=_why_no_grasp(hand, thing))
    if upright:
        level = [each for each in grasps if abs(quat_rotate(each.in_world(pose)[3:], (1.0, 0.0, 0.0))[2]) < _TILTED]
        grasps = level or grasps
    grasps = _in_many_directions(_free_grasps(hand, thing, grasps), pose)
    up = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    lifted = np.array([pose + height * up for height in np.linspace(0.0, _LIFT_M, 3)])
    request = GraspMotionRequest(thing.id, grasps, lifted, _BACK_M, container=thing.container, least=0.9, stays=stays)
    try:
        return find_grasp_motion(hand, request, floor), request
    except UnreachableError as error:
        shallow = [tips for each in grasps if (tips := each.shallow()) is not None]
        if not shallow or (error.shortfall_m or np.inf) > _NEARLY_M:
            raise
        request = request._replace(grasps=shallow)
        try:
            return find_grasp_motion(hand, request, floor), request
        except UnreachableError:
            raise error from None


def _free_grasps(hand: Manipulator, thing: Thing, grasps: Sequence[Grasp]) -> list[Grasp]:
    """The grasps at which the gripper alone is free, wherever the robot stands, perhaps with less room.

    Raises:
        UnreachableError: there is none.
    """
    checker = HandChecker(hand.robot, hand.gripper, touch={thing.id})
    largest_m = hand.gripper.max_opening_m
    found, hits = list[Grasp](), list[Collision]()
    for each in grasps:
        openings = dict.fromkeys((each.opening_m(largest_m), each.tight().opening_m(largest_m)))
        for opening_m in openings:
            hit = hand.hit_before(checker, each.in_world(thing.pose), _BACK_M, opening_m)
            if hit is None:
                found.append(each)
                break
            hits.append(hit)
    if not found:
        nearest = max(hits, key=lambda each: each.distance_m - each.least_m)
        reason = f"the gripper has no room at each of {len(grasps)} grasps of it: at best {nearest}"
        raise UnreachableError(hand.robot.name, target=thing.id, reason=reason, obstacle=nearest.obstacle)
    return found


def _why_no_grasp(hand: Manipulator, thing: Thing) -> str:
    """Why a thing does not fit between the fingers."""
    gripper = hand.gripper
    if gripper.type is not GripperType.PARALLEL:
        return f"the {gripper.name} has no fingers that close on each other"
    narrowest_m, opening_m = min(thing.body.size or (0.0,)), gripper.max_opening_m
    text = f"no part of it fits the {gripper.name}: it is {narrowest_m:.3f} m across, the opening is {opening_m:.3f} m"
    return f"{text}, with {FINGER_CLEARANCE_M * 1000:.0f} mm of room for each finger"


def _from_floor(hand: Manipulator, pose: Array, floor: FloorMap | None) -> Array:
    """The horizontal direction, of length 1, from where the base can stand to a pose; from the base if it stays."""
    start = np.array(hand.robot.base_pose()[:2])
    if floor is not None:
        standing = floor.plan.centers(np.flatnonzero(np.isfinite(floor.lengths)))
        if len(standing):
            start = standing[np.argmin(np.hypot(*(standing - pose[:2]).T))]
    towards: Array = (pose[:2] - start) / max(float(np.hypot(*(pose[:2] - start))), 1e-9)
    return towards


def _in_many_directions(grasps: Sequence[Grasp], pose: Array) -> list[Grasp]:
    """The best grasps, at most three of each direction of approach, in turns."""
    groups: dict[tuple[float, ...], list[Grasp]] = {}
    for each in grasps:
        x = quat_rotate(each.in_world(pose)[3:], (1.0, 0.0, 0.0))
        groups.setdefault(tuple(np.round(x, 1).tolist()), []).append(each)
    found = [group[turn] for turn in range(2) for group in groups.values() if turn < len(group)]
    order = {id(each): number for number, each in enumerate(grasps)}
    return sorted(found[:_MAX_GRASPS], key=lambda each: order[id(each)])


def carrying(task: SkillTask, hand: Manipulator, back_m: float) -> SkillMotion:
    """Takes what is held close in front of the robot, with the inclination that it has; the arm stays if it cannot."""
    held = hand.held
    if held is None:
        raise task.failure("nothing is held after the grasp", "grasp it again")
    yield from hand.withdrawing(back_m)
    for target in _folded_poses(hand) if hand.needs_base else _carry_poses(hand):
        try:
            yield from hand.moving_to(target, why=f"to carry {held}")
        except (UnreachableError, SkillFailedError):
            continue
        break
    if hand.held is None:
        raise task.failure(f"{held} slipped out of the gripper while it was carried", "pick it up again")


def _carry_poses(hand: Manipulator) -> Iterator[dict[str, float]]:
    """Positions of the arm in which the hand is near to the base, with its present inclination."""
    root, here = hand.root_pose, hand.grasp_pose
    base = planar_pose(hand.robot.base_pose())
    x = quat_rotate(here[3:], (1.0, 0.0, 0.0))
    heading = float(np.arctan2(x[1], x[0])) if np.hypot(x[0], x[1]) > 0.3 else 0.0
    yaw = hand.robot.base_pose()[2]
    shoulder, length = _shoulder(hand)
    for height in (shoulder + part * length for part in _CARRY_HEIGHTS):
        for distance in (hand.robot.model.base.radius_m + part * length for part in _CARRY_DISTANCES):
            for turn in (0.0, 0.5, -0.5, 1.0, -1.0, pi / 2, -pi / 2):
                spin = planar_pose((0.0, 0.0, yaw + turn - heading))[3:]
                point = pose_multiply(base, np.array([distance, 0.0, height, 1.0, 0.0, 0.0, 0.0]))[:3]
                target = np.concatenate([point, quat_multiply(spin, here[3:])])
                found = hand.kinematics.solve_ik(
                    hand.kinematics.frame_of(hand.arm),
                    target,
                    joints=hand.arm.joints,
                    seed=hand.robot.joint_positions(),
                    root_pose=root,
                    attempts=3,
                )
                if found:
                    yield dict(found.positions)
                    break


def _shoulder(hand: Manipulator) -> tuple[float, float]:
    """The height of an arm's first joint that turns, with its slides in the middle, and its length from there [m]."""
    model, arm = hand.robot.model, hand.arm
    joints = [model.joint(name) for name in arm.joints]
    middle = {each.name: sum(each.limits) / 2 for each in joints if each.is_prismatic and isfinite(sum(each.limits))}
    frames = link_poses(model.joints, rest_positions(model.joints, middle), model.root)
    first = next((each for each in joints if not each.is_prismatic), joints[0])
    chain = LinkTree(model.links, model.joints).chain(first.child, arm.tip_link) or ()
    points = np.array([frames[first.child][:3], *(frames[each.child][:3] for each in chain)])
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return float(points[0, 2]) + model.base.height_m, length


def _folded_poses(hand: Manipulator) -> list[dict[str, float]]:
    """Positions in which the hand is near to the base with its inclination, for arms that do not reach every pose.

    Slides and hinges with a vertical axis keep the inclination: the horizontal slides take their rest positions.
    """
    now, middle = hand.robot.joint_positions(), np.array(hand.robot.base_pose()[:2])
    frame, root = hand.kinematics.frame_of(hand.arm), hand.root_pose
    rest = dict(zip(hand.arm.joints, hand.arm.rest_positions, strict=False))
    drawn = {name: rest[name] for name in hand.level_slides() if name in rest}
    turning = hand.turning_joints()
    found = list[tuple[float, dict[str, float]]]()
    for share in np.linspace(0.0, 1.0, _FOLDS) if turning else (0.0,):
        angles = {name: float(np.interp(share, (0.0, 1.0), hand.kinematics.limits(name))) for name in turning}
        positions = {name: now[name] for name in hand.arm.joints} | drawn | angles
        at = hand.kinematics.pose(frame, {**now, **positions}, root_pose=root)
        found.append((float(np.hypot(*(at[:2] - middle))), positions))
    return [positions for _, positions in sorted(found, key=lambda each: each[0])]


# -- putting down ------------------------------------------------------------------------------------------------------


def put_down(task: SkillTask, id: BodyId, holder: BodyId, *, inside: bool) -> SkillMotion:
    """Puts a thing on or into a holder; picks it up first if it is not held, after it opened the holder.

    Raises:
        NoFreePlacementError: there is no free place.
        SkillFailedError: it did not get there.
    """
    surroundings = task.surroundings()
    support, doors = _support(surroundings, id, holder, inside=inside)
    if doors:
        if hand_with(task, id) is None:
            _check_reach(task, surroundings, id)
        hand = hand_with(task, id)
        if hand is not None and all(each.held is not None for each in hands_of(task)):
            yield from _setting_aside(task, hand, id, why=f"{doors[0].id} is closed, and no other hand is free")
        for door in doors:
            yield from moving_part(task, door, ACCESS[door.joint.is_prismatic], at_least=True)
    is_drawer = any(each.id == support for each in surroundings.articulated_parts())
    yield from pick_up(task, id, upright=None if not inside else not is_drawer)
    hand = hand_with(task, id)
    if hand is None:
        raise task.failure(f"{id} is not held any more", "pick it up again")
    word = "into" if inside else "on"
    with task.step("place", f"place {id} {word} {support}"):
        yield from _placing(task, hand, id, support, inside=inside)


def _setting_aside(task: SkillTask, hand: Manipulator, id: BodyId, *, why: str) -> SkillMotion:
    """Puts what is held on the nearest top where it has room, so that the hand is free.

    Args:
        hand: the hand that holds it.
        id: the thing.
        why: what the hand is needed for, for the report.

    Raises:
        SkillFailedError: there is no such place.
    """
    reason = "nothing near has a free top"
    for support in task.surroundings().tops_near(hand.grasp_pose[:3])[:_MAX_TOPS]:
        try:
            with task.step("set aside", f"set {id} aside on {support}"):
                yield from _placing(task, hand, id, support, inside=False)
        except (NoFreePlacementError, UnreachableError) as error:
            reason = str(error)
            continue
        return
    raise task.failure(f"{why}: {id} cannot be set aside: {reason}", f"place {id} somewhere else first")


def _check_reach(task: SkillTask, surroundings: Surroundings, id: BodyId) -> None:
    """Checks that a thing can be grasped, before anything is opened for it.

    Raises:
        UnreachableError: it cannot, and nothing that could be opened is in front of it.
    """
    if surroundings.in_front_of(id):
        return
    hand = free_hand(task, f"to pick up {id}")
    find_grasp(hand, surroundings.thing(id), FloorMap(hand.robot) if hand.is_mobile else None)


def _support(
    surroundings: Surroundings, id: BodyId, holder: BodyId, *, inside: bool
) -> tuple[BodyId, list[ArticulatedPart]]:
    """The body with the surfaces, which may be a drawer of the holder, and what has to be opened to get there."""
    if not inside:
        return holder, []
    candidates = [holder]
    candidates += [each.id for each in surroundings.articulated_parts_of(holder) if each.joint.is_prismatic]
    for support in dict.fromkeys(candidates):
        places = surroundings.free_places(id, support, inside=True, count=1)
        if places:
            return support, surroundings.closed_on(support, np.asarray(places[0].position))
    raise NoFreePlacementError(id, f"into {holder}", reason=surroundings.why_no_place(id, holder, inside=True))


def _placing(task: SkillTask, hand: Manipulator, id: BodyId, support: BodyId, *, inside: bool) -> SkillMotion:
    """Takes what is held to a free place, releases it and withdraws."""
    task.moved[id] = None
    surroundings = task.surroundings()
    places = surroundings.free_places(id, support, inside=inside, count=_FREE_PLACES)
    if not places:
        reason = surroundings.why_no_place(id, support, inside=inside)
        raise NoFreePlacementError(id, f"{'into' if inside else 'on'} {support}", reason=reason)
    in_hand = pose_multiply(pose_inverse(surroundings.pose(id)), hand.grasp_pose)
    placement = yield from _standing_for(
        hand, id, support, places, in_hand, surroundings.box(support) if inside else None
    )
    at = placement.grasp.pose - np.array([0.0, 0.0, _GAP_M, 0.0, 0.0, 0.0, 0.0])
    above = at + np.array([0.0, 0.0, _LIFT_M + _GAP_M, 0.0, 0.0, 0.0, 0.0])
    yield from hand.moving_straight(above, why=f"over {support}", speed=0.25)
    yield from hand.moving_straight(at, why=f"down on {support}", speed=0.15, may_touch=True)
    yield from _letting_go(task, hand, back_m=placement.back_m)
    yield from hand.parking(touch=(id,))
    yield 0.3
    where = task.surroundings()
    expected = where.containers_of(id) if inside else where.supports_of(id)
    if support not in expected:
        reason = f"{id} is {where.support_of(id)} instead of {'in' if inside else 'on'} {support}"
        raise task.failure(reason, "pick it up and try again")


def _standing_for(
    hand: Manipulator,
    id: BodyId,
    support: BodyId,
    places: Sequence[Pose],
    in_hand: Array,
    container: tuple[Array, Array] | None,
) -> Generator[float, None, GraspMotion]:
    """Drives to where one of the places is in reach, and takes what is held in front of it."""
    lifts = np.array([[0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0] for height in np.linspace(0.0, _LIFT_M, 3)])
    raised = np.array([0.0, 0.0, _GAP_M, 0.0, 0.0, 0.0, 0.0])
    floor = FloorMap(hand.robot) if hand.is_mobile else None
    error: UnreachableError | None = None
    for pose in _nearest_to_floor([normalized_pose_array(each) for each in places], floor)[:_PLACES]:
        options = _options(hand, pose + raised, in_hand, floor)
        request = GraspMotionRequest(
            id,
            options,
            lifts,
            _BACK_M,
            container=container,
            lift_m=_LIFT_M,
            least=0.9,
            steps=_PLACE_STEPS,
        )
        try:
            placement = find_grasp_motion(hand, request, floor)
            yield from hand.driving_to(placement.base, why=f"to reach {support}")
            yield from hand.moving_to(placement.start, why=f"in front of {support}")
        except UnreachableError as found:
            error = found
            continue
        return placement
    raise UnreachableError(
        hand.robot.name,
        target=f"a free place at {support} with {id}",
        reason=error.reason if error else "there is none",
        obstacle=error.obstacle if error else None,
    )


def _options(hand: Manipulator, pose: Array, in_hand: Array, floor: FloorMap | None) -> list[Grasp]:
    """The grasp with which a thing is held, at a place and turned there, those that come from the free floor first."""
    found = [pose_multiply(_spun(pose, pi / 4 * number), in_hand) for number in range(8)]
    if floor is not None:
        towards = _from_floor(hand, pose, floor)
        found.sort(key=lambda at: -round(float(quat_rotate(at[3:], (1.0, 0.0, 0.0))[:2] @ towards), 2))
    return [Grasp(at, 0.0, is_whole=True, is_central=True) for at in found[:_TURNS]]


def _nearest_to_floor(poses: Sequence[Array], floor: FloorMap | None) -> list[Array]:
    """Poses by their distance from where the base can stand, in steps of 0.1 m, those of different heights in turns."""
    if floor is None:
        return list(poses)
    lengths = floor.lengths
    standing = floor.plan.centers(np.flatnonzero(np.isfinite(lengths)))

    def distance(pose: Array) -> float:
        return float(np.hypot(*(standing - pose[:2]).T).min(initial=np.inf))

    ordered = sorted(poses, key=lambda pose: max(round(distance(pose), 1), _CLOSE_M))
    levels: dict[float, list[Array]] = {}
    for pose in ordered:
        levels.setdefault(round(float(pose[2]), 1), []).append(pose)
    most = max((len(each) for each in levels.values()), default=0)
    return [level[turn] for turn in range(most) for level in levels.values() if turn < len(level)]


def _spun(pose: Array, turn: float) -> Array:
    """A pose that is turned about the vertical axis through its origin."""
    return np.concatenate([pose[:3], quat_multiply(planar_pose((0.0, 0.0, turn))[3:], pose[3:])])


def _letting_go(task: SkillTask, hand: Manipulator, *, back_m: float = _BACK_M) -> SkillMotion:
    """Releases what is held, and withdraws the hand."""
    held = hand.held
    opening = hand.robot.opening(hand.gripper.name)
    if held is not None and _is_fixed(task, held):
        task.session.apply(Detach(held))
    yield from hand.opening(min(opening + 2 * _ROOM_M, hand.gripper.max_opening_m))
    yield from hand.withdrawing(back_m, touch=() if held is None else (held,))


def _is_fixed(task: SkillTask, id: BodyId) -> bool:
    own = task.robot_bodies()
    return any(each.child == id and each.parent in own for each in task.session.snapshot().attachments)


# -- pouring -----------------------------------------------------------------------------------------------------------


def _tilting(task: SkillTask, hand: Manipulator, id: BodyId, target: BodyId) -> SkillMotion:
    """Holds a thing over a container and tilts it about the axis along which the hand points."""
    surroundings = task.surroundings()
    low, high = surroundings.box(target)
    own_low, own_high = surroundings.box(id)
    now = surroundings.pose(id)
    half_height, half_width = (own_high - own_low)[2] / 2, max((own_high - own_low)[:2]) / 2
    x, y = (quat_rotate(hand.grasp_pose[3:], each) for each in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    level = x if np.hypot(x[0], x[1]) >= np.hypot(y[0], y[1]) else y  # a hand from above tilts it about the fingers
    axis = np.array([level[0], level[1], 0.0]) / max(float(np.hypot(level[0], level[1])), 1e-6)
    side = np.cross(axis, (0.0, 0.0, 1.0))
    in_hand = pose_multiply(pose_inverse(now), hand.grasp_pose)
    up = np.array([0.0, 0.0, half_height])
    options = []
    for sign in (1.0, -1.0):
        tilted = list[Array]()
        for angle in np.linspace(0.0, sign * _POUR_ANGLE_RAD, _POUR_STEPS):
            spin = np.array([cos(angle / 2), *(sin(angle / 2) * axis)])
            corners = [quat_rotate(spin, a * side * half_width + b * up) for a in (1.0, -1.0) for b in (1.0, -1.0)]
            lip = quat_rotate(spin, sign * side * half_width + up)  # where it flows out: over the middle of the target
            lowest = min(float(each[2]) for each in corners)
            at = [*(((low + high) / 2)[:2] - lip[:2]), high[2] + _POUR_GAP_M - lowest]
            tilted.append(np.concatenate([at, quat_multiply(spin, now[3:])]))
        options.append(np.array(tilted))
    placement, poses = _pour_placement(hand, id, options, in_hand)
    with task.step("pour", f"pour {id} into {target}"):
        yield from hand.driving_to(placement.base, why=f"to reach {target}")
        yield from hand.moving_to(placement.start, why=f"beside {target}")
        yield from hand.moving_straight(pose_multiply(poses[0], in_hand), why=f"over {target}", speed=0.2)
        motion = hand.path(pose_multiply(poses, in_hand))
        if not motion.is_complete:
            raise task.failure(f"{id} cannot be tilted over {target}: {motion.reason}", "stand elsewhere")
        yield from hand.following(motion, speed=0.4)
        yield _POUR_S
        yield from hand.following(hand.path(pose_multiply(poses[::-1], in_hand)), speed=0.4)


def _pour_placement(
    hand: Manipulator, id: BodyId, options: Sequence[Array], in_hand: Array
) -> tuple[GraspMotion, Array]:
    error: UnreachableError | None = None
    for poses in options:
        grasp = Grasp(in_hand, 0.0, is_whole=True, is_central=True)
        try:
            return find_grasp_motion(hand, GraspMotionRequest(id, [grasp], poses, _BACK_M, least=0.95)), poses
        except UnreachableError as found:
            error = found
    assert error is not None
    raise error
