"""What a gripper can do, from its geometry: how far it opens, where it grasps, and which way it is closed.

Fingers are links that the gripper's joints move. All is computed from the convex collision shapes, since these are what
touches things in a simulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mindstage.robots.models.forward_kinematics import rest_positions
from mindstage.robots.models.link_tree import LinkTree
from mindstage.robots.models.robot_model import Gripper, GripperType, ModelNote, RobotJoint
from mindstage.scene.transforms import (
    Array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_rotate,
    quaternion_from_matrix,
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


def analyze_gripper(
    tree: LinkTree, name: str, link: str, joints: Sequence[RobotJoint], notes: list[ModelNote]
) -> Gripper | None:
    """Computes a gripper from its joints; None if none of them moves a link with a collision shape.

    Args:
        name: the name of the gripper.
        link: the link that carries the fingers.
        joints: the movable joints of the fingers, followers included.
        notes: guesses are appended.
    """
    fingers = _finger_links(tree, joints)
    drives = [joint for joint in joints if joint.is_actuated]
    if not fingers or not drives:
        return None
    positions = _Positions(tree, link, fingers, joints)
    opened, closed = positions.limits()
    if still := positions.without_travel(opened, closed):  # as the motors of a hand whose fingers follow them
        fingers = [finger for finger in fingers if finger not in still]
        positions = _Positions(tree, link, fingers, joints)
        opened, closed = positions.limits()
    if positions.keep_tips(opened, closed):
        fingers = [finger for branch in positions.branches for finger in branch]
        opened, closed = positions.limits()
    between = positions.closing_frame(opened, closed)
    if between is None or len(fingers) < 2:
        notes.append(
            ModelNote(subject=name, text="its fingers do not close on each other, so it is no parallel gripper")
        )
        return _other(tree, name, link, drives, fingers, opened, closed)
    frame, gap, closed = _grasp_frame(tree, link, positions, opened, closed, between)
    is_parallel = gap > _MIN_TRAVEL_M
    fingers += [pad for pad in positions.pad_links if pad not in fingers]
    if is_parallel and positions.is_hand:
        text = (
            f"it is used as a gripper: one finger closes on the {len(positions.branches) - 1} others, {gap:.3f} m away"
        )
        notes.append(ModelNote(subject=name, text=text))
    return Gripper(
        name=name,
        type=GripperType.PARALLEL if is_parallel else GripperType.OTHER,
        link=link,
        joints=tuple(joint.name for joint in drives),
        finger_links=tuple(fingers),
        grasp_pose=pose_from_array(frame),
        open_positions=tuple(opened[joint.name] for joint in drives),
        closed_positions=tuple(closed[joint.name] for joint in drives),
        max_opening_m=round(float(gap), 4),
        max_force_n=_force(tree, drives, frame, link),
    )


def _other(
    tree: LinkTree,
    name: str,
    link: str,
    drives: Sequence[RobotJoint],
    fingers: Sequence[str],
    opened: Mapping[str, float],
    closed: Mapping[str, float],
) -> Gripper:
    """An end effector whose fingers do not close along one axis: its grasp frame is at the middle of the tips."""
    poses = tree.poses(rest_positions(tree.joints.values(), opened))
    to_link = pose_inverse(poses[link])
    tips = tree.points(fingers, poses)
    center = quat_rotate(to_link[3:], tips.mean(axis=0)) + to_link[:3]
    rotation = _rotation(center, np.array([0.0, 1.0, 0.0]))
    return Gripper(
        name=name,
        type=GripperType.OTHER,
        link=link,
        joints=tuple(joint.name for joint in drives),
        finger_links=tuple(fingers),
        grasp_pose=pose_from_array([*center, *rotation]),
        open_positions=tuple(opened[joint.name] for joint in drives),
        closed_positions=tuple(closed[joint.name] for joint in drives),
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
        names = {joint.name for joint in joints}
        branches: dict[str, list[str]] = {}
        for finger in fingers:
            first = [joint.name for joint in tree.ancestors(finger) if joint.name in names][-1]
            branches.setdefault(first, []).append(finger)
        self.pad_links: dict[str, None] = {}
        """Links with pads at the tips, beside those of the fingers; known after `pads`."""
        self.branches = list(branches.values())
        """The fingers, each as the links of one branch below the palm."""

    def fingers(self, drives: Mapping[str, float]) -> list[Array]:
        """Points on each finger, in the frame of the palm."""
        poses = self._poses(drives)
        return [self.tree.points(branch, poses) for branch in self.branches]

    def _poses(self, drives: Mapping[str, float]) -> dict[str, Array]:
        """The frames of the links below the palm, in its own."""
        return self.tree.poses_below(self.link, rest_positions(self.tree.joints.values(), drives))

    def spread(self, drives: Mapping[str, float]) -> float:
        """The sum of the distances of the fingers' centers from their common center [m]."""
        centers = np.array([points.mean(axis=0) for points in self.fingers(drives)])
        return float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).sum())

    @property
    def is_hand(self) -> bool:
        """Whether its fingers bend by themselves."""
        return len(self.drives) >= _HAND_DRIVES

    def reach(self, drives: Mapping[str, float]) -> float:
        """The sum of the distances of the fingers' centers from the palm, which the fingers of a hand bend to [m]."""
        return sum(float(np.linalg.norm(points.mean(axis=0))) for points in self.fingers(drives))

    def limits(self) -> tuple[dict[str, float], dict[str, float]]:
        """The positions of the drives when the gripper is open, and when it is closed."""
        middle = {joint.name: rest_positions([joint])[joint.name] for joint in self.drives}
        opened, closed = dict(middle), dict(middle)
        for joint in self.drives:
            lower = joint.lower if joint.lower is not None else -np.pi / 2
            upper = joint.upper if joint.upper is not None else np.pi / 2
            measure = self.reach if self.is_hand else self.spread
            low, high = (measure({**middle, joint.name: limit}) for limit in (lower, upper))
            opened[joint.name], closed[joint.name] = (lower, upper) if low > high else (upper, lower)
        return opened, closed

    def without_travel(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> set[str]:
        """The finger links that are where they were when the gripper has closed; none if that are all but one."""
        links = [link for branch in self.branches for link in branch]
        centers = []
        for drives in (opened, closed):
            poses = self._poses(drives)
            centers.append(np.array([self.tree.points([each], poses).mean(axis=0) for each in links]))
        travels = np.linalg.norm(centers[0] - centers[1], axis=1)
        still = {link for link, travel in zip(links, travels.tolist(), strict=True) if travel < _MIN_TRAVEL_M / 2}
        return still if len(still) <= len(links) - 2 else set()

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

    def keep_tips(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> bool:
        """Keeps the farthest branch of each side of a gripper whose fingers have several links on parallel cranks.

        Such fingers close loops, which a tree of links describes as branches that follow one drive. Hands, with several
        fingers against one thumb, stay as they are.
        """
        if len(self.branches) < 4 or len(self.drives) > 2:
            return False
        points = self.fingers(opened)
        centers = np.array([each.mean(axis=0) for each in points])
        moved = np.array([each.mean(axis=0) for each in self.fingers(closed)]) - centers
        axis = np.linalg.svd(moved - moved.mean(axis=0))[2][0]
        along, sides = (moved - moved.mean(axis=0)) @ axis, (centers - centers.mean(axis=0)) @ axis
        on_one_side = sides > 0.0
        if (along * sides >= 0.0).any() or 2 * int(on_one_side.sum()) != len(self.branches):
            return False  # not all of them move towards the middle, or they are no pairs
        reach = np.array([float(np.linalg.norm(each, axis=1).max()) for each in points])
        kept = [int(np.argmax(np.where(side, reach, -1.0))) for side in (on_one_side, ~on_one_side)]
        self.branches = [self.branches[row] for row in kept]
        return True

    def closing_frame(self, opened: Mapping[str, float], closed: Mapping[str, float]) -> Array | None:
        """Unit vector in the frame of the palm, from the second finger to the first, along which they close."""
        centers = [np.array([points.mean(axis=0) for points in self.fingers(each)]) for each in (opened, closed)]
        if len(centers[0]) < 2:
            return None
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


def _grasp_frame(
    tree: LinkTree,
    link: str,
    positions: _Positions,
    opened: Mapping[str, float],
    closed: Mapping[str, float],
    axis: Array,
) -> tuple[Array, float, dict[str, float]]:
    """The grasp frame in the frame of the palm, the distance of the fingers, and the positions at which they touch."""
    everything = np.concatenate(positions.fingers(opened))
    outward = _outward(axis, everything.mean(axis=0))
    depth = everything @ outward
    first, *rest = positions.pads(opened, outward)
    others = np.concatenate(rest)
    gap = _gap(first, others, axis)
    middle = (float((first @ axis).min()) + float((others @ axis).max())) / 2
    side = np.cross(outward, axis)
    sideways = everything @ side
    tip = float(min(each.max() for each in (first @ outward, others @ outward)))
    along = max(tip - _TIP_MARGIN_M, float((depth.min() + tip) / 2))
    origin = outward * along + axis * middle + side * (sideways.min() + sideways.max()) / 2
    named = _named_frame(tree, link)
    if named is not None:
        offset = named - origin
        if max(abs(float(offset @ axis)), abs(float(offset @ side))) < _MAX_TOOL_OFFSET_M and (
            depth.min() - 0.01 <= float(named @ outward) <= tip + 0.01
        ):
            origin = origin + outward * float(offset @ outward) + side * float(offset @ side)
    rotation = quaternion_from_matrix(np.stack([outward, axis, np.cross(outward, axis)], axis=1))
    return np.array([*origin, *rotation]), gap, _touching(positions, opened, closed, axis, outward)


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


def _gap(first: Array, others: Array, axis: Array) -> float:
    return float((first @ axis).min() - (others @ axis).max())


def _touching(
    positions: _Positions, opened: Mapping[str, float], closed: Mapping[str, float], axis: Array, outward: Array
) -> dict[str, float]:
    """The closed positions, or those on the way to them at which the fingers touch each other."""

    def at(share: float) -> dict[str, float]:
        return {name: opened[name] + share * (closed[name] - opened[name]) for name in opened}

    def gap(share: float) -> float:
        first, *rest = positions.pads(at(share), outward)
        return _gap(first, np.concatenate(rest), axis)

    if gap(1.0) >= 0.0 or gap(0.0) <= 0.0:
        return dict(closed)
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if gap(middle) > 0.0 else (low, middle)
    return {name: round(position, 5) for name, position in at(high).items()}


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
