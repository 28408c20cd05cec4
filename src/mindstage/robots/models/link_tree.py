"""The tree of links and joints of a robot: order, chains, subtrees, and forward kinematics of the collision shapes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from msgspec.structs import replace

from mindstage.robots.models.forward_kinematics import link_poses
from mindstage.robots.models.robot_model import ModelNote, RobotJoint, RobotLink
from mindstage.scene import CollisionShape, CollisionShapeType
from mindstage.scene.transforms import Array, normalized_pose_array, quat_rotate

__all__ = ["LinkTree", "shape_points", "sorted_tree"]

_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
"""Angles of the points of a circle [rad]."""


def sorted_tree(
    links: Sequence[RobotLink], joints: Sequence[RobotJoint]
) -> tuple[tuple[RobotLink, ...], tuple[RobotJoint, ...], list[ModelNote]]:
    """Sorts joints with parents before children, and puts the root first.

    Joints that close a loop and links that are not connected to the root are left out. The root is the link without a
    parent that has the most links below it.

    Returns:
        Links, joints, and notes on what was left out.
    """
    notes: list[ModelNote] = []
    parent_joint: dict[str, RobotJoint] = {}
    for joint in joints:
        if joint.child in parent_joint:
            text = f"it is left out, since {joint.child} is already moved by {parent_joint[joint.child].name}"
            notes.append(ModelNote(subject=joint.name, text=text, is_guess=False))
        else:
            parent_joint[joint.child] = joint
    children: dict[str, list[RobotJoint]] = {}
    for joint in parent_joint.values():
        children.setdefault(joint.parent, []).append(joint)
    roots = [link.name for link in links if link.name not in parent_joint] or [links[0].name]
    reached = max((_reached(root, children) for root in roots), key=lambda found: len(found[0]))
    names, ordered = reached
    for link in links:
        if link.name not in names:
            text = f"it is left out, since no joint connects it to {next(iter(names))}"
            notes.append(ModelNote(subject=link.name, text=text, is_guess=False))
    by_name = {link.name: link for link in links}
    kept = {joint.name for joint in ordered}
    without_masters = tuple(
        replace(joint, mimic=None) if joint.mimic is not None and joint.mimic.joint not in kept else joint
        for joint in ordered
    )
    return tuple(by_name[name] for name in names), without_masters, notes


def _reached(root: str, children: Mapping[str, Sequence[RobotJoint]]) -> tuple[dict[str, None], list[RobotJoint]]:
    """The links below a root, itself first, and their joints."""
    names, ordered = {root: None}, []
    queue = [root]
    for name in queue:
        for joint in children.get(name, ()):
            if joint.child not in names:
                names[joint.child] = None
                ordered.append(joint)
                queue.append(joint.child)
    return names, ordered


class LinkTree:
    """Look-ups in the tree of a robot."""

    def __init__(self, links: Sequence[RobotLink], joints: Sequence[RobotJoint]) -> None:
        self.links = {link.name: link for link in links}
        self.joints = {joint.name: joint for joint in joints}
        self.root = links[0].name
        self.parent_joint = {joint.child: joint for joint in joints}
        self.child_joints: dict[str, list[RobotJoint]] = {}
        for joint in joints:
            self.child_joints.setdefault(joint.parent, []).append(joint)
        self._joints_below: dict[str, list[RobotJoint]] = {}
        self._shape_points: dict[str, list[Array]] = {}

    def ancestors(self, link: str) -> Iterator[RobotJoint]:
        """The joints from a link up to the root."""
        while (joint := self.parent_joint.get(link)) is not None:
            yield joint
            link = joint.parent

    def chain(self, base: str, tip: str) -> tuple[RobotJoint, ...] | None:
        """The joints from a base link to a tip link; None if the base is no ancestor of the tip."""
        found: list[RobotJoint] = []
        link = tip
        while link != base:
            joint = self.parent_joint.get(link)
            if joint is None:
                return None
            found.append(joint)
            link = joint.parent
        return tuple(reversed(found))

    def subtree(self, link: str) -> list[str]:
        """A link and all links below it."""
        found = [link]
        for each in found:
            found += (joint.child for joint in self.child_joints.get(each, ()))
        return found

    def rigid_links(self, link: str) -> list[str]:
        """A link and the links below it that do not move relative to it."""
        found = [link]
        for each in found:
            found += (joint.child for joint in self.child_joints.get(each, ()) if not joint.is_movable)
        return found

    def neighbors(self) -> set[tuple[str, str]]:
        """Pairs of links that one movable joint, and any number of fixed ones, connect; they cannot collide."""
        cluster: dict[str, str] = {}
        members: dict[str, list[str]] = {}
        for name in self.links:  # parents come first
            joint = self.parent_joint.get(name)
            root = cluster[name] = name if joint is None or joint.is_movable else cluster[joint.parent]
            members.setdefault(root, []).append(name)
        found = set()
        for joint in self.joints.values():
            if joint.is_movable:
                above = filter(self._is_solid, members[cluster[joint.parent]])
                below = list(filter(self._is_solid, members[joint.child]))
                found |= {(min(a, b), max(a, b)) for a in above for b in below}
        return found

    def _is_solid(self, link: str) -> bool:
        geometry = self.links[link].geometry
        return geometry is not None and bool(geometry.collision_shapes)

    def depth(self, link: str) -> int:
        """The number of joints above a link."""
        return sum(1 for _ in self.ancestors(link))

    @cached_property
    def followers(self) -> Mapping[str, tuple[RobotJoint, ...]]:
        """The joints that mimic a joint, by its name."""
        found: dict[str, list[RobotJoint]] = {}
        for joint in self.joints.values():
            if joint.mimic is not None:
                found.setdefault(joint.mimic.joint, []).append(joint)
        return {name: tuple(joints) for name, joints in found.items()}

    def poses(self, positions: Mapping[str, float]) -> dict[str, Array]:
        """The frame of each link in that of the root, each an array of 7."""
        return link_poses(self.joints.values(), positions, self.root)

    def poses_below(self, link: str, positions: Mapping[str, float]) -> dict[str, Array]:
        """The frame of a link and of each link below it in that of the link, each an array of 7."""
        if link not in self._joints_below:
            self._joints_below[link] = [self.parent_joint[each] for each in self.subtree(link)[1:]]
        return link_poses(self._joints_below[link], positions, link)

    def rigid_root(self, link: str) -> str:
        """The uppermost link to which a link is fixed."""
        while (joint := self.parent_joint.get(link)) is not None and not joint.is_movable:
            link = joint.parent
        return link

    def rigid_neighbors(self, links: Sequence[str]) -> list[str]:
        """The solid links that do not move relative to some links, without these."""
        found = dict[str, None]()
        for link in links:
            rigid = self.rigid_links(self.rigid_root(link))
            found |= dict.fromkeys(each for each in rigid if self._is_solid(each) and each not in links)
        return list(found)

    def points_by_shape(self, links: Iterable[str], poses: Mapping[str, Array]) -> list[Array]:
        """As `points`, each collision shape by itself."""
        found: list[Array] = []
        for name in links:
            pose = poses[name]
            found += (quat_rotate(pose[3:], points) + pose[:3] for points in self.shape_points(name))
        return found

    def shape_points(self, link: str) -> list[Array]:
        """Points on each collision shape of a link, in its frame."""
        if link not in self._shape_points:
            geometry = self.links[link].geometry
            self._shape_points[link] = [shape_points(each) for each in geometry.collision_shapes] if geometry else []
        return self._shape_points[link]

    def points(self, links: Iterable[str], poses: Mapping[str, Array]) -> Array:
        """Points on the collision shapes of links, n x 3, in the frame of the poses."""
        return np.concatenate([np.zeros((0, 3)), *self.points_by_shape(links, poses)])


def shape_points(shape: CollisionShape) -> Array:
    """Points whose convex hull is the shape, or nearly so if it is round, n x 3, in the body frame."""
    half = np.array(shape.size) / 2
    if shape.type is CollisionShapeType.HULL:
        local = np.array(shape.points, dtype=np.float64).reshape(-1, 3)
    elif shape.type is CollisionShapeType.BOX:
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        local = signs * half
    elif shape.type is CollisionShapeType.CYLINDER:
        circle = np.stack([np.cos(_CIRCLE), np.sin(_CIRCLE), np.ones_like(_CIRCLE)], axis=1)
        local = np.concatenate([circle, circle * (1.0, 1.0, -1.0)]) * half
    else:
        down = np.linspace(0.0, np.pi, 9)
        unit = [[np.sin(d) * np.cos(a), np.sin(d) * np.sin(a), np.cos(d)] for d in down for a in _CIRCLE]
        local = np.array(unit) * half
    row = normalized_pose_array(shape.pose)
    return np.asarray(quat_rotate(row[3:], local) + row[:3])
