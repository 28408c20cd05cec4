"""Posture: where each link stands, and what it hangs on, with every joint at 0 or as near to it as its limits allow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mindstage.knowledge.robots.robot import UrdfIssue, UrdfJoint, UrdfJointType, UrdfRobot
from mindstage.world import IDENTITY
from mindstage.world.geometry import Array, normalized_pose_array, pose_multiply

__all__ = ["RestPose", "rest_pose"]


class RestPose(NamedTuple):
    """A robot at rest."""

    link_poses: Mapping[str, Array]
    """By link, its frame in the world."""
    joint_states: Mapping[str, tuple[UrdfJoint, Array, float]]
    """By child: the joint that holds it, the joint's frame in the world, and where the joint stands [m or rad]."""
    movable_links: frozenset[str]
    """Links that a joint lets move, or that hang on such."""
    issues: tuple[UrdfIssue, ...]


def rest_pose(robot: UrdfRobot) -> RestPose:
    """Goes from the roots to the tips; a joint that would close a circle is left out."""
    holders: dict[str, UrdfJoint] = {}
    oddities: list[UrdfIssue] = []
    for joint in robot.joints:
        if joint.child in holders:
            what = f"{joint.child} already hangs on {holders[joint.child].parent} by {holders[joint.child].name}"
            oddities.append(UrdfIssue(joint.name, what, "it is left out", is_missing=True))
        else:
            holders[joint.child] = joint
    for joint in _loop_joints(holders):
        what = f"{joint.child} would hang on itself, by way of {joint.parent}"
        oddities.append(UrdfIssue(joint.name, what, "it is left out", is_missing=True))
        del holders[joint.child]
    roots = [link.name for link in robot.links if link.name not in holders]
    if len(roots) > 1:
        oddities.append(
            UrdfIssue("", f"{len(roots)} links hang on nothing: {', '.join(roots[:5])}", "all are at 0 0 0")
        )
    links: dict[str, Array] = {root: normalized_pose_array(IDENTITY) for root in roots}
    frames: dict[str, tuple[UrdfJoint, Array, float]] = {}
    moving: set[str] = set()
    children: dict[str, list[UrdfJoint]] = {}
    for joint in holders.values():
        children.setdefault(joint.parent, []).append(joint)
    waiting = list(roots)
    for parent in waiting:
        for joint in children.get(parent, ()):
            frame = pose_multiply(links[parent], normalized_pose_array(joint.origin))
            at = _rest_position(joint)
            frames[joint.child] = joint, frame, at
            links[joint.child] = pose_multiply(frame, _joint_transform(joint, at))
            if joint.type is not UrdfJointType.FIXED or parent in moving:
                moving.add(joint.child)
            waiting.append(joint.child)
    return RestPose(links, frames, frozenset(moving), tuple(oddities))


def _loop_joints(parent_joints: Mapping[str, UrdfJoint]) -> list[UrdfJoint]:
    """One joint of each circle: the one that holds the link which was told first."""
    closing, done = [], set[str]()
    for start in parent_joints:
        way: dict[str, None] = {}
        link = start
        while link in parent_joints and link not in way and link not in done:
            way[link] = None
            link = parent_joints[link].parent
        if link in way:
            closing.append(parent_joints[link])
        done.update(way)
    return closing


def _rest_position(joint: UrdfJoint) -> float:
    if joint.range is None or joint.range[0] <= 0.0 <= joint.range[1]:
        return 0.0
    return min(joint.range, key=abs)


def _joint_transform(joint: UrdfJoint, position: float) -> Array:
    """The child's frame in that of the joint."""
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
    if joint.type is UrdfJointType.PRISMATIC:
        return np.array([*(position * axis), 1.0, 0.0, 0.0, 0.0])
    return np.array([0.0, 0.0, 0.0, np.cos(position / 2), *(np.sin(position / 2) * axis)])
