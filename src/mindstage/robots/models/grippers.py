"""What a gripper can do, from its geometry: how far it opens, where it grasps, and which way it is closed.

Fingers are links that the gripper's joints move; an only finger closes on what carries it. All is measured by moving
the collision shapes, since these are what touches things in a simulation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from itertools import product
from typing import NamedTuple

import numpy as np

from mindstage.robots.models.forward_kinematics import rest_positions
from mindstage.robots.models.link_tree import LinkTree
from mindstage.robots.models.robot_model import Gripper, GripperType, ModelNote, RobotJoint
from mindstage.scene.mesh import convex_hull
from mindstage.scene.transforms import (
    Array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_rotate,
    quaternion_from_matrix,
    rotation_matrix,
)

__all__ = ["analyze_gripper"]

_TOOL_WORDS = ("grasp", "tool_frame", "tcp", "tool0", "tool_center")
"""Words in the names of frames between the finger tips."""
_TIP_MARGIN_M = 0.02
"""Distance of the grasp frame from the ends of the fingers, if no frame of the description says where it is."""
_MAX_TOOL_OFFSET_M = 0.04
"""Distance from the plane between the fingers up to which a named frame is taken as the grasp frame."""
_DEFAULT_FORCE_N = 40.0
_FORCE_RANGE_N = (5.0, 80.0)
"""Some descriptions state the effort of a motor before its gear, or an arbitrary large number."""
_SNAP_COSINE = 0.995
"""Directions that are nearer to an axis of the palm than this angle are along it."""
_HAND_DRIVES = 3
"""A gripper with as many drives is a hand: its fingers bend by themselves."""
_MIN_TRAVEL_M = 0.01
_PAD_M = 0.025
"""Shapes of a finger that end nearer to its tip touch what is grasped."""
_MAX_PAD_M = 0.06
"""Shapes of other links at the tip, as exchangeable finger tips, that begin nearer to it are pads."""
_JAW_MARGIN = 0.3
"""Distance of the grasp frame from the tip of an only finger, as a fraction of its length: it turns away from there."""
_WINDOW_M = tuple(product((-0.008, 0.0, 0.008), (-0.004, 0.0, 0.004)))
"""Where the opening is measured, outwards and sideways of the grasp frame."""
_SHARES = np.linspace(0.0, 1.0, 41)
"""The parts of the way from open to closed at which an only finger is measured."""
_PARALLEL = 1e-9
"""Sine of the angle up to which a line is parallel to a face."""
_SPRING = re.compile(r"spring|passive|complian", re.IGNORECASE)


def analyze_gripper(
    tree: LinkTree, name: str, link: str, joints: Sequence[RobotJoint], notes: list[ModelNote]
) -> Gripper | None:
    """Computes a gripper from its joints; None if none of them moves a link with a collision shape.

    Args:
        name: the name of the gripper.
        link: the link that carries the fingers.
        joints: the movable joints of the fingers, followers included.
        notes: guesses, and what it cannot do, are appended.
    """
    joints = _without_springs(joints, notes)
    fingers = _finger_links(tree, joints)
    drives = [joint for joint in joints if joint.is_actuated]
    if not fingers or not drives:
        return None
    found = [_measured(_Positions(tree, link, fingers, joints), opens_by) for opens_by in _OpensBy]
    best = max((each for each in found if each is not None), key=lambda each: each.opening_m, default=None)
    if best is None or best.opening_m <= _MIN_TRAVEL_M:
        reason = "its fingers do not close on each other"
        if best is not None:
            reason = (
                f"its fingers are at most {max(1000 * best.opening_m, 0.0):.0f} mm apart, by their collision shapes"
            )
        notes.append(ModelNote(subject=name, text=f"{reason}, so it is no parallel gripper", is_guess=False))
        return _other(tree, name, link, joints, fingers)
    sides, opening = best.positions, f"{best.opening_m:.3f} m away"
    if sides.is_one_jaw:
        notes.append(ModelNote(subject=name, text=f"its only finger closes on {sides.branches[1][0]}, {opening}"))
    elif sides.is_hand:
        text = f"it is used as a gripper: one finger closes on the {len(sides.branches) - 1} others, {opening}"
        notes.append(ModelNote(subject=name, text=text))
    if best.rest_m > _MIN_TRAVEL_M:
        text = f"its fingers are still {1000 * best.rest_m:.0f} mm apart when it is closed, and hold nothing thinner"
        notes.append(ModelNote(subject=name, text=text, is_guess=False))
    touching = {each for branch in sides.branches for each in branch}
    links = dict.fromkeys(each for each in tree.links if each in touching) | sides.pad_links
    return Gripper(
        name=name,
        type=GripperType.PARALLEL,
        link=link,
        joints=tuple(joint.name for joint in drives),
        finger_links=tuple(links),
        grasp_pose=pose_from_array(best.frame),
        open_positions=tuple(best.opened[joint.name] for joint in drives),
        closed_positions=tuple(best.closed[joint.name] for joint in drives),
        max_opening_m=round(best.opening_m, 4),
        max_force_n=_force(tree, drives, best.frame, link),
    )


class _Measured(NamedTuple):
    """What a gripper does between two positions of its drives."""

    positions: _Positions
    opened: Mapping[str, float]
    closed: Mapping[str, float]
    frame: Array
    """The grasp frame in the frame of the palm."""
    opening_m: float
    rest_m: float
    """The distance of the fingers when it is closed."""


class _OpensBy(StrEnum):
    """What is larger the farther a gripper is open."""

    SPREAD = "the distances of its fingers from each other"
    REACH = "the distances of its fingers from the palm, which those of a hand bend to"


def _measured(positions: _Positions, opens_by: _OpensBy) -> _Measured | None:
    """Moves a gripper from closed to open; None if that measure is not for it, or its fingers do not close."""
    if len(positions.branches) < 2 or (opens_by is _OpensBy.REACH and not positions.is_hand):
        return None
    measure = positions.measure(opens_by)
    opened, closed = positions.limits(measure)
    if not positions.is_one_jaw:
        positions.drop_still(opened, closed)
        positions.keep_tips(opened, closed)
        opened, closed = positions.limits(measure)
    frame = positions.jaw_frame(opened, closed) if positions.is_one_jaw else positions.grasp_frame(opened, closed)
    if frame is None:
        return None
    if positions.is_one_jaw:
        opened = positions.widest(opened, closed, frame)
        frame = positions.centered(opened, frame)
    gap = positions.gap(opened, frame)
    closed, rest = positions.touching(opened, closed, frame)
    return _Measured(positions, opened, closed, frame, gap, rest)


def _without_springs(joints: Sequence[RobotJoint], notes: list[ModelNote]) -> list[RobotJoint]:
    """The joints without those of springs, which give way and close nothing."""
    springs = {joint.name for joint in joints if joint.is_actuated and _SPRING.search(joint.name)}
    for name in springs:
        notes.append(ModelNote(subject=name, text="it gives way by a spring, by its name, and closes no gripper"))
    is_spring = {
        joint.name: joint.name in springs or (joint.mimic is not None and joint.mimic.joint in springs)
        for joint in joints
    }
    return [joint for joint in joints if not is_spring[joint.name]]


def _other(
    tree: LinkTree,
    name: str,
    link: str,
    joints: Sequence[RobotJoint],
    fingers: Sequence[str],
) -> Gripper:
    """An end effector whose fingers do not close along one axis: its grasp frame is at the middle of the tips."""
    positions = _Positions(tree, link, fingers, joints)
    opened, closed = positions.limits(positions.measure(_OpensBy.REACH))
    poses = tree.poses(rest_positions(tree.joints.values(), opened))
    to_link = pose_inverse(poses[link])
    tips = tree.points(fingers, poses)
    center = quat_rotate(to_link[3:], tips.mean(axis=0)) + to_link[:3]
    rotation = _rotation(center, np.array([0.0, 1.0, 0.0]))
    return Gripper(
        name=name,
        type=GripperType.OTHER,
        link=link,
        joints=tuple(joint.name for joint in positions.drives),
        finger_links=tuple(fingers),
        grasp_pose=pose_from_array([*center, *rotation]),
        open_positions=tuple(opened[joint.name] for joint in positions.drives),
        closed_positions=tuple(closed[joint.name] for joint in positions.drives),
        max_opening_m=0.0,
        max_force_n=_DEFAULT_FORCE_N,
    )


def _finger_links(tree: LinkTree, joints: Sequence[RobotJoint]) -> list[str]:
    """The last moved links with collision shapes: of several that are fixed to each other, the farthest one."""
    moved = {joint.child for joint in joints}
    poses = tree.poses(rest_positions(tree.joints.values()))
    found: dict[str, None] = {}
    for joint in joints:
        solid = [each for each in tree.rigid_links(joint.child) if _is_solid(tree, each)]
        below = {each for each in tree.subtree(joint.child) if each in moved and each != joint.child}
        if solid and not any(_is_solid(tree, each) for link in below for each in tree.rigid_links(link)):
            hinge = poses[joint.parent][:3]
            reach = {each: float(np.linalg.norm(tree.points([each], poses) - hinge, axis=1).max()) for each in solid}
            found[max(reach, key=lambda each: reach[each])] = None
    return list(found)


def _is_solid(tree: LinkTree, link: str) -> bool:
    geometry = tree.links[link].geometry
    return geometry is not None and bool(geometry.collision_shapes)


class _Positions:
    """Positions of the finger joints, and the distances of the fingers at them."""

    def __init__(self, tree: LinkTree, link: str, fingers: Sequence[str], joints: Sequence[RobotJoint]) -> None:
        self.tree, self.link = tree, link
        self.drives = [joint for joint in joints if joint.is_actuated]
        self.top = tree.rigid_root(link)
        names = {joint.name for joint in joints}
        branches: dict[str, list[str]] = {}
        for finger in fingers:
            first = [joint.name for joint in tree.ancestors(finger) if joint.name in names][-1]
            branches.setdefault(first, []).append(finger)
        self.pad_links: dict[str, None] = {}
        """Links with pads at the tips, beside those of the fingers; known after `pads`."""
        self.branches = list(branches.values())
        """The fingers, each as the links of one branch below the palm; of an only finger also what it closes on."""
        self.is_one_jaw = len(self.branches) == 1
        if self.is_one_jaw:
            self.jaw_joint = tree.joints[next(iter(branches))]
            fixed = [each for each in tree.rigid_links(self.top) if _is_solid(tree, each)]
            self.branches += [fixed] if fixed else []
        self._planes: dict[str, list[tuple[Array, Array]]] = {}

    def fingers(self, drives: Mapping[str, float]) -> list[Array]:
        """Points on each finger, in the frame of the palm."""
        poses = self._poses(drives)
        return [self.tree.points(branch, poses) for branch in self.branches]

    def _poses(self, drives: Mapping[str, float]) -> dict[str, Array]:
        """The frames of the palm, of what is fixed to it and of the links below, in that of the palm."""
        poses = self.tree.poses_below(self.top, rest_positions(self.tree.joints.values(), drives))
        if self.top == self.link:
            return poses
        to_palm = pose_inverse(poses[self.link])
        return {name: pose_multiply(to_palm, pose) for name, pose in poses.items()}

    @property
    def is_hand(self) -> bool:
        """Whether its fingers bend by themselves."""
        return len(self.drives) >= _HAND_DRIVES

    # -- open and closed -----------------------------------------------------------------------------------------------

    def measure(self, opens_by: _OpensBy) -> Callable[[Mapping[str, float]], float]:
        """A function of the positions of the drives that is larger the farther the gripper is open [m]."""
        if self.is_one_jaw and len(self.branches) == 2:
            return self._tip_distance
        return self._reach if opens_by is _OpensBy.REACH else self._spread

    def _spread(self, drives: Mapping[str, float]) -> float:
        """The sum of the distances of the fingers' centers from their common center [m]."""
        centers = np.array([points.mean(axis=0) for points in self.fingers(drives)])
        return float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).sum())

    def _reach(self, drives: Mapping[str, float]) -> float:
        """The sum of the distances of the fingers' centers from the palm, which the fingers of a hand bend to [m]."""
        return sum(float(np.linalg.norm(points.mean(axis=0))) for points in self.fingers(drives))

    def _tip_distance(self, drives: Mapping[str, float]) -> float:
        """The distance of the tip of an only finger from the shapes that it closes on, about [m]."""
        tip, poses = self._jaw(drives)[0], self._poses(drives)
        local = ((link, _local(poses[link], tip)) for link in self.branches[1])
        return min(
            float((normals @ at - ends).max()) for link, at in local for normals, ends in self._half_spaces(link)
        )

    def limits(self, measure: Callable[[Mapping[str, float]], float]) -> tuple[dict[str, float], dict[str, float]]:
        """The positions of the drives when the gripper is open, and when it is closed."""
        middle = {joint.name: rest_positions([joint])[joint.name] for joint in self.drives}
        opened, closed = dict(middle), dict(middle)
        for joint in self.drives:
            lower = joint.lower if joint.lower is not None else -np.pi / 2
            upper = joint.upper if joint.upper is not None else np.pi / 2
            low, high = (measure({**middle, joint.name: limit}) for limit in (lower, upper))
            opened[joint.name], closed[joint.name] = (lower, upper) if low > high else (upper, lower)
        return opened, closed

    def drop_still(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> None:
        """Drops the links that are where they were when the gripper has closed, unless that are all but one.

        Such links are the motors of a hand whose fingers follow them.
        """
        links = [link for branch in self.branches for link in branch]
        centers = []
        for drives in (opened, closed):
            poses = self._poses(drives)
            centers.append(np.array([self.tree.points([each], poses).mean(axis=0) for each in links]))
        travels = np.linalg.norm(centers[0] - centers[1], axis=1)
        still = {link for link, travel in zip(links, travels.tolist(), strict=True) if travel < _MIN_TRAVEL_M / 2}
        if len(still) <= len(links) - 2:
            kept = ([link for link in branch if link not in still] for branch in self.branches)
            self.branches = [branch for branch in kept if branch]

    def keep_tips(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> None:
        """Keeps the farthest branch of each side of a gripper whose fingers have several links on parallel cranks.

        Such fingers close loops, which a tree of links describes as branches that follow one drive. Hands, with several
        fingers against one thumb, stay as they are.
        """
        if len(self.branches) < 4 or len(self.drives) > 2:
            return
        points = self.fingers(opened)
        centers = np.array([each.mean(axis=0) for each in points])
        moved = np.array([each.mean(axis=0) for each in self.fingers(closed)]) - centers
        axis = np.linalg.svd(moved - moved.mean(axis=0))[2][0]
        along, sides = (moved - moved.mean(axis=0)) @ axis, (centers - centers.mean(axis=0)) @ axis
        on_one_side = sides > 0.0
        if (along * sides >= 0.0).any() or 2 * int(on_one_side.sum()) != len(self.branches):
            return  # not all of them move towards the middle, or they are no pairs
        reach = np.array([float(np.linalg.norm(each, axis=1).max()) for each in points])
        kept = [int(np.argmax(np.where(side, reach, -1.0))) for side in (on_one_side, ~on_one_side)]
        self.branches = [self.branches[row] for row in kept]

    # -- two fingers or more -------------------------------------------------------------------------------------------

    def pads(self, drives: Mapping[str, float], outward: Array) -> list[Array]:
        """Points on the shapes of each finger that reach to near its tip, in the frame of the palm.

        A finger may have other shapes, such as the bracket that carries it, which pass beside the other finger.
        """
        poses = self._poses(drives)

        def depths(link: str) -> list[tuple[Array, float, float]]:
            """The points of each shape of a link, and how far in front of the palm they begin and end."""
            found = ((points, points @ outward) for points in self.tree.points_by_shape([link], poses))
            return [(points, float(depth.min()), float(depth.max())) for points, depth in found]

        found = []
        for branch in self.branches:
            shapes = [each for link in branch for each in depths(link)]
            tip = max(high for _, _, high in shapes)
            pads = [points for points, _, high in shapes if tip - high < _PAD_M]
            for link in self.tree.rigid_neighbors(branch):
                own = [points for points, low, high in depths(link) if tip - high < _PAD_M and tip - low < _MAX_PAD_M]
                pads += own
                if own:
                    self.pad_links[link] = None
            found.append(np.concatenate(pads))
        return found

    def _closing_axis(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> Array | None:
        """Unit vector in the frame of the palm, from the second finger to the first, along which they close."""
        centers = [np.array([points.mean(axis=0) for points in self.fingers(each)]) for each in (opened, closed)]
        if len(self.branches) > 2:  # the thumb is the one that is farthest from the others
            total = centers[0].sum(axis=0)
            apart = [np.linalg.norm(at - (total - at) / (len(self.branches) - 1)) for at in centers[0]]
            order = np.argsort(-np.array(apart), kind="stable")
            self.branches = [self.branches[row] for row in order]
            centers = [each[order] for each in centers]
        moved = centers[0] - centers[1]
        relative = moved[0] - moved[1:].mean(axis=0)
        length = float(np.linalg.norm(relative))
        if length < _MIN_TRAVEL_M / 2:
            return None
        between = centers[0][0] - centers[0][1:].mean(axis=0)
        # Fingers on hinges move on arcs: the line between them is a better direction than their displacement.
        direction = between if float(np.linalg.norm(between)) > 0.01 else relative
        direction = np.asarray(direction / np.linalg.norm(direction))
        largest = int(np.argmax(np.abs(direction)))
        if abs(direction[largest]) > _SNAP_COSINE:
            direction = np.eye(3)[largest] * np.sign(direction[largest])
        if direction[largest] < 0.0 and len(self.branches) == 2:  # along an axis of the palm rather than against it
            self.branches.reverse()
            direction = -direction
        return np.asarray(direction)

    def grasp_frame(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> Array | None:
        """The grasp frame of two fingers or more, in the frame of the palm; None if they do not close."""
        axis = self._closing_axis(opened, closed)
        if axis is None:
            return None
        everything = np.concatenate(self.fingers(opened))
        outward = _outward(axis, everything.mean(axis=0))
        depth = everything @ outward
        first, *rest = self.pads(opened, outward)
        others = np.concatenate(rest)
        middle = (float((first @ axis).min()) + float((others @ axis).max())) / 2
        side = np.cross(outward, axis)
        sideways = everything @ side
        tip = float(min(each.max() for each in (first @ outward, others @ outward)))
        along = max(tip - _TIP_MARGIN_M, float((depth.min() + tip) / 2))
        origin = outward * along + axis * middle + side * (sideways.min() + sideways.max()) / 2
        named = _named_frame(self.tree, self.link)
        if named is not None:
            offset = named - origin
            if max(abs(float(offset @ axis)), abs(float(offset @ side))) < _MAX_TOOL_OFFSET_M and (
                depth.min() - 0.01 <= float(named @ outward) <= tip + 0.01
            ):
                origin = origin + outward * float(offset @ outward) + side * float(offset @ side)
        return _frame(origin, outward, axis)

    # -- an only finger ------------------------------------------------------------------------------------------------

    def _jaw(self, drives: Mapping[str, float]) -> tuple[Array, Array, Array]:
        """The tip of an only finger, the origin of its joint and the joint's axis, in the frame of the palm."""
        poses = self._poses(drives)
        joint = poses[self.jaw_joint.child]
        points = self.tree.points(self.branches[0], poses)
        axis = quat_rotate(joint[3:], np.array(self.jaw_joint.axis))
        if self.jaw_joint.is_prismatic:
            across = points - np.outer(points @ axis, axis)
            return points[int(np.argmax(np.linalg.norm(across, axis=1)))], joint[:3], axis
        return points[int(np.argmax(np.linalg.norm(points - joint[:3], axis=1)))], joint[:3], axis

    def jaw_frame(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> Array | None:
        """The grasp frame of an only finger where it is closed, in the frame of the palm."""
        tip, hinge, axis = self._jaw(closed)
        lever = tip - hinge
        lever = lever - axis * float(lever @ axis)
        length = float(np.linalg.norm(lever))
        if length < _MIN_TRAVEL_M:
            return None
        if self.jaw_joint.is_prismatic:
            across = axis * np.sign(float((self._jaw(opened)[0] - tip) @ axis) or 1.0)
            outward = _outward(across, lever)
        else:
            outward = _outward(axis, lever)
            across = np.cross(axis, outward)
            ahead = {name: closed[name] + 0.1 * (opened[name] - closed[name]) for name in closed}
            across = across * np.sign(float((self._jaw(ahead)[0] - tip) @ across) or 1.0)
        side = np.cross(outward, across)
        pad = self.fingers(closed)[0]
        margin = max(_TIP_MARGIN_M, _JAW_MARGIN * length)
        end = min(float((points @ outward).max()) for points in self.fingers(closed))
        near = pad[pad @ outward > end - 2 * margin] @ side
        origin = outward * (end - margin) + across * float(tip @ across)
        origin = origin + side * ((near.min() + near.max()) / 2 if len(near) else float(tip @ side))
        return _frame(origin, outward, across)

    def widest(self, opened: Mapping[str, float], closed: Mapping[str, float], frame: Array) -> dict[str, float]:
        """The positions at which an only finger is farthest from the other jaw, and still faces it."""
        gaps = [(self._line_gap(_between(opened, closed, share), frame), float(share)) for share in _SHARES]
        known = [(gap[0], share) for gap, share in gaps if gap is not None]
        return _between(opened, closed, max(known)[1]) if known else dict(opened)

    def centered(self, opened: Mapping[str, float], frame: Array) -> Array:
        """The frame between an only finger and the other jaw."""
        found = self._line_gap(opened, frame)
        shift = 0.0 if found is None else found[1]
        return pose_multiply(frame, [0.0, shift, 0.0, 1.0, 0.0, 0.0, 0.0])

    # -- distances -----------------------------------------------------------------------------------------------------

    def gap(self, drives: Mapping[str, float], frame: Array) -> float:
        """The distance of the fingers along the y axis of the grasp frame [m]: that of the pads of their tips.

        An only finger turns away from the other jaw, so that its distance is measured where it grasps.
        """
        if self.is_one_jaw:
            found = self._line_gap(drives, frame)
            return 0.0 if found is None else found[0]
        outward, axis, _ = rotation_matrix(frame[3:]).T
        first, *rest = self.pads(drives, outward)
        return float((first @ axis).min() - (np.concatenate(rest) @ axis).max())

    def _line_gap(self, drives: Mapping[str, float], frame: Array) -> tuple[float, float] | None:
        """The least free length of lines along y through the grasp frame, and its middle; None if they miss a jaw."""
        poses = self._poses(drives)
        outward, axis, side = rotation_matrix(frame[3:]).T
        starts = frame[:3] + np.array([u * outward + v * side for u, v in _WINDOW_M])
        jaw, other = self.branches
        begin, _ = self._crossings(jaw, poses, starts, axis)
        _, end = self._crossings(other, poses, starts, axis)
        hit = np.isfinite(begin) & np.isfinite(end)
        if not hit.any():
            return None
        low, high = float(end[hit].max()), float(begin[hit].min())
        return high - low, (low + high) / 2

    def _crossings(
        self, links: Iterable[str], poses: Mapping[str, Array], starts: Array, axis: Array
    ) -> tuple[Array, Array]:
        """Where parallel lines enter and leave the shapes of links, along them; infinite for those that miss all."""
        low, high = np.full(len(starts), np.inf), np.full(len(starts), -np.inf)
        for link in links:
            local = np.array([_local(poses[link], start) for start in starts])
            along = quat_rotate(pose_inverse(poses[link])[3:], axis)
            for normals, ends in self._half_spaces(link):
                slope, room = normals @ along, ends - local @ normals.T
                with np.errstate(divide="ignore", invalid="ignore"):
                    at = room / slope
                enter = np.where(slope < -_PARALLEL, at, -np.inf).max(axis=1)
                leave = np.where(slope > _PARALLEL, at, np.inf).min(axis=1)
                is_hit = (enter <= leave) & (np.where(np.abs(slope) <= _PARALLEL, room, 0.0) >= 0.0).all(axis=1)
                low = np.where(is_hit, np.minimum(low, enter), low)
                high = np.where(is_hit, np.maximum(high, leave), high)
        return low, high

    def _half_spaces(self, link: str) -> list[tuple[Array, Array]]:
        """The outward normals of the faces of each shape of a link, and their distances from its origin."""
        if link not in self._planes:
            hulls = map(convex_hull, self.tree.shape_points(link))
            self._planes[link] = [
                (hull.normals, (hull.normals * hull.points[hull.faces[:, 0]]).sum(axis=1))
                for hull in hulls
                if hull is not None
            ]
        return self._planes[link]

    def touching(
        self, opened: Mapping[str, float], closed: Mapping[str, float], frame: Array
    ) -> tuple[dict[str, float], float]:
        """The closed positions, or those on the way to them at which the fingers touch, and their distance there."""
        last = self.gap(closed, frame)
        if last >= 0.0 or self.gap(opened, frame) <= 0.0:
            return dict(closed), max(last, 0.0)
        low, high = 0.0, 1.0
        for _ in range(20):
            middle = (low + high) / 2
            is_apart = self.gap(_between(opened, closed, middle), frame) > 0.0
            low, high = (middle, high) if is_apart else (low, middle)
        return {name: round(position, 5) for name, position in _between(opened, closed, high).items()}, 0.0


def _between(opened: Mapping[str, float], closed: Mapping[str, float], share: float) -> dict[str, float]:
    """The positions at a part of the way from open to closed."""
    return {name: opened[name] + share * (closed[name] - opened[name]) for name in opened}


def _local(pose: Array, point: Array) -> Array:
    """A point in the frame of a pose."""
    inverse = pose_inverse(pose)
    return np.asarray(quat_rotate(inverse[3:], point) + inverse[:3])


def _frame(origin: Array, outward: Array, axis: Array) -> Array:
    rotation = quaternion_from_matrix(np.stack([outward, axis, np.cross(outward, axis)], axis=1))
    return np.array([*origin, *rotation])


def _outward(axis: Array, center: Array) -> Array:
    """The direction out of the hand: from the palm to the fingers, along the palm's axis that is nearest to it."""
    toward = center - axis * float(center @ axis)
    length = float(np.linalg.norm(toward))
    direction = toward / length if length > 1e-3 else np.array([1.0, 0.0, 0.0])
    nearest = np.zeros(3)
    nearest[int(np.argmax(np.abs(direction)))] = np.sign(direction[int(np.argmax(np.abs(direction)))])
    nearest -= axis * float(nearest @ axis)
    if float(np.linalg.norm(nearest)) > 0.9:
        nearest /= np.linalg.norm(nearest)
        if float(nearest @ direction) > 0.9:
            return nearest
    return direction


def _named_frame(tree: LinkTree, link: str) -> Array | None:
    """The origin of a frame whose name says that it is between the finger tips, in the frame of the palm."""
    poses = tree.poses(rest_positions(tree.joints.values()))
    rigid = [each for each in tree.rigid_links(link) if each != link]
    for word in _TOOL_WORDS:
        for each in rigid:
            if word in each.lower():
                return np.asarray(pose_multiply(pose_inverse(poses[link]), poses[each])[:3])
    return None


def _rotation(outward: Array, axis: Array) -> Array:
    direction = outward / max(float(np.linalg.norm(outward)), 1e-9)
    if abs(float(direction @ axis)) > 0.9:
        axis = np.array([1.0, 0.0, 0.0])
    axis = axis - direction * float(axis @ direction)
    axis /= np.linalg.norm(axis)
    return quaternion_from_matrix(np.stack([direction, axis, np.cross(direction, axis)], axis=1))


def _force(tree: LinkTree, drives: Sequence[RobotJoint], frame: Array, link: str) -> float:
    """The force of a finger at the grasp frame, from the effort of the weakest drive."""
    poses = tree.poses(rest_positions(tree.joints.values()))
    grasp = pose_multiply(poses[link], frame)[:3]
    forces = []
    for joint in drives:
        if joint.effort is None or joint.effort <= 0.0:
            continue
        followers = 1 + len(tree.followers.get(joint.name, ()))
        if joint.type.value == "prismatic":
            forces.append(joint.effort / followers)
        else:
            arm = max(float(np.linalg.norm(poses[joint.child][:3] - grasp)), 0.02)
            forces.append(joint.effort / arm / followers)
    lowest, highest = _FORCE_RANGE_N
    return round(min(max(min(forces), lowest), highest), 1) if forces else _DEFAULT_FORCE_N
