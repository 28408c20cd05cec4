"""Forward kinematics of a `RobotModel`, in plain NumPy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

import numpy as np

from mindstage.robots.models.robot_model import RobotJoint, RobotJointType
from mindstage.scene import Pose
from mindstage.scene.transforms import Array, axis_displacement, normalized_pose_array, pose_multiply

__all__ = ["joint_motion", "link_poses", "rest_positions"]

_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def rest_positions(joints: Iterable[RobotJoint], given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Positions of all movable joints [m or rad]: given ones, otherwise 0 or the limit nearest to it.

    Joints that mimic another one are where it puts them; other given positions are clamped to the limits.

    Args:
        joints: the joints, in any order.
        given: positions by joint; unknown names are ignored.
    """
    by_name = {joint.name: joint for joint in joints}
    positions: dict[str, float] = {}
    for joint in by_name.values():
        if joint.is_movable:
            positions[joint.name] = _position(joint, by_name, given or {}, frozenset())
    return positions


def _position(
    joint: RobotJoint, joints: Mapping[str, RobotJoint], given: Mapping[str, float], visited: frozenset[str]
) -> float:
    mimic = joint.mimic
    if mimic is not None and mimic.joint in joints and mimic.joint not in visited:
        master = _position(joints[mimic.joint], joints, given, visited | {joint.name})
        return mimic.multiplier * master + mimic.offset
    position = given.get(joint.name, 0.0)
    if joint.lower is not None:
        position = max(position, joint.lower)
    return position if joint.upper is None else min(position, joint.upper)


def joint_motion(joint: RobotJoint, position: float) -> Array:
    """Returns the frame of the child in the joint frame at a position [m or rad], an array of 7."""
    if joint.type is RobotJointType.FIXED:
        return _IDENTITY
    return axis_displacement(joint.axis, position, is_prismatic=joint.is_prismatic)


def link_poses(joints: Iterable[RobotJoint], positions: Mapping[str, float], root: str) -> dict[str, Array]:
    """Returns the frame of each link in that of the root, each an array of 7.

    Args:
        joints: parents before children.
        positions: of the movable joints [m or rad], those that mimic others included.
        root: the name of the root link.
    """
    poses = {root: _IDENTITY}
    for joint in joints:
        frame = pose_multiply(poses[joint.parent], _origin(joint.origin))
        poses[joint.child] = (
            frame
            if joint.type is RobotJointType.FIXED
            else pose_multiply(frame, joint_motion(joint, positions.get(joint.name, 0.0)))
        )
    return poses


@lru_cache(maxsize=4096)
def _origin(pose: Pose) -> Array:
    row = normalized_pose_array(pose)
    row.flags.writeable = False
    return row
