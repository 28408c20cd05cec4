"""Posture: where each link stands, and what it hangs on, with every joint at 0 or as near to it as its limits allow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mindstage.knowledge.robots.robot import Joint, JointType, Oddity, Robot
from mindstage.world import IDENTITY
from mindstage.world.geometry import Array, compose, unit_pose

__all__ = ["Posture", "posture_of"]


class Posture(NamedTuple):
    """A robot at rest."""

    links: Mapping[str, Array]
    """By link, its frame in the world."""
    joints: Mapping[str, tuple[Joint, Array, float]]
    """By child: the joint that holds it, the joint's frame in the world, and where the joint stands [m or rad]."""
    moving: frozenset[str]
    """Links that a joint lets move, or that hang on such."""
    oddities: tuple[Oddity, ...]


def posture_of(robot: Robot) -> Posture:
    """Goes from the roots to the tips; a joint that would close a circle is left out."""
    holders: dict[str, Joint] = {}
    oddities: list[Oddity] = []
    for joint in robot.joints:
        if joint.child in holders:
            what = f"{joint.child} already hangs on {holders[joint.child].parent} by {holders[joint.child].name}"
            oddities.append(Oddity(joint.name, what, "it is left out", missing=True))
        else:
            holders[joint.child] = joint
    for joint in _closing(holders):
        what = f"{joint.child} would hang on itself, by way of {joint.parent}"
        oddities.append(Oddity(joint.name, what, "it is left out", missing=True))
        del holders[joint.child]
    roots = [link.name for link in robot.links if link.name not in holders]
    if len(roots) > 1:
        oddities.append(Oddity("", f"{len(roots)} links hang on nothing: {', '.join(roots[:5])}", "all are at 0 0 0"))
    links: dict[str, Array] = {root: unit_pose(IDENTITY) for root in roots}
    frames: dict[str, tuple[Joint, Array, float]] = {}
    moving: set[str] = set()
    children: dict[str, list[Joint]] = {}
    for joint in holders.values():
        children.setdefault(joint.parent, []).append(joint)
    waiting = list(roots)
    for parent in waiting:
        for joint in children.get(parent, ()):
            frame = compose(links[parent], unit_pose(joint.origin))
            at = _position(joint)
            frames[joint.child] = joint, frame, at
            links[joint.child] = compose(frame, _moved(joint, at))
            if joint.type is not JointType.FIXED or parent in moving:
                moving.add(joint.child)
            waiting.append(joint.child)
    return Posture(links, frames, frozenset(moving), tuple(oddities))


def _closing(holders: Mapping[str, Joint]) -> list[Joint]:
    """One joint of each circle: the one that holds the link which was told first."""
    closing, done = [], set[str]()
    for start in holders:
        way: dict[str, None] = {}
        link = start
        while link in holders and link not in way and link not in done:
            way[link] = None
            link = holders[link].parent
        if link in way:
            closing.append(holders[link])
        done.update(way)
    return closing


def _position(joint: Joint) -> float:
    if joint.range is None or joint.range[0] <= 0.0 <= joint.range[1]:
        return 0.0
    return min(joint.range, key=abs)


def _moved(joint: Joint, at: float) -> Array:
    """The child's frame in that of the joint."""
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
    if joint.type is JointType.PRISMATIC:
        return np.array([*(at * axis), 1.0, 0.0, 0.0, 0.0])
    return np.array([0.0, 0.0, 0.0, np.cos(at / 2), *(np.sin(at / 2) * axis)])
