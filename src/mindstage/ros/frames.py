"""Frames of tf: their names, and the tree along attachments and joints.

The root is `map`; `world` is the same frame. An attached body is a child of the body that it is attached to. A body
that a joint moves is a child of the frame of the joint, which has the id of the joint and is a child of the body that
holds it. All other bodies are children of the root. Composing the transforms from the root gives the poses of the
bodies.

The links of a robot have the names of its description, and are children of one another without frames of joints, as a
`robot_state_publisher` makes them; the root link of a robot that drives is a child of `odom`. The frames of further
robots begin with their name: `NAME/base_link`.

Transforms that change by motion only are those of joints and of loose bodies; all others are static.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.engines import PoseArray
from mindstage.scene import Body, BodyId, Joint, Mobility, World
from mindstage.scene.joint_kinematics import joint_reach, moving_body
from mindstage.scene.transforms import Array, normalize, normalized_pose_array, pose_inverse, pose_multiply

__all__ = [
    "ROOT_FRAME",
    "WORLD_FRAMES",
    "FrameNames",
    "FrameTransforms",
    "FrameTree",
    "JointFrame",
    "RobotFrames",
    "joint_frames",
]

ROOT_FRAME = "map"
"""Frame id of the root."""
WORLD_FRAMES = frozenset({"", ROOT_FRAME, "world"})
"""Frame ids that mean the frame of the world."""
_TOLERANCE = 1e-6
"""Difference up to which transforms are equal [m], and of the parts of their quaternions."""
_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


class FrameNames:
    """Frame ids of bodies and joints; each keeps its frame id, unless it becomes part of a robot.

    May be used from any thread.

    A frame id is the id itself, if it consists of letters, digits, `_`, `.`, `-` and `/` and does not begin with a
    slash (which tf2 rejects); other characters become `_`, and a frame id that is taken gets a number.
    """

    def __init__(self) -> None:
        self._frame_by_id: dict[str, str] = {}
        self._id_by_frame: dict[str, str] = dict.fromkeys(WORLD_FRAMES, "")
        self._lock = Lock()

    def assign(self, ids: Iterable[str]) -> list[str]:
        """Returns the frame ids of bodies or joints, in their order."""
        given = list(ids)
        with self._lock:
            new = [id for id in dict.fromkeys(given) if id not in self._frame_by_id]
            # Ids that are valid come first, so that none of them is taken by a changed one.
            for id in sorted(new, key=lambda each: _valid_frame(each) != each):
                frame = self._free(_valid_frame(id))
                self._frame_by_id[id], self._id_by_frame[frame] = frame, id
            return [self._frame_by_id[id] for id in given]

    def prefer(self, frame_by_id: Mapping[str, str]) -> None:
        """Gives bodies certain frame ids, where these are free; a body that has another one loses it."""
        with self._lock:
            for id, frame in frame_by_id.items():
                if self._frame_by_id.get(id) != frame and frame not in self._id_by_frame:
                    self._id_by_frame.pop(self._frame_by_id.pop(id, ""), None)
                    self._frame_by_id[id], self._id_by_frame[frame] = frame, id

    def id_of(self, frame: str) -> str | None:
        """Returns the id with a frame id; None for an unknown one."""
        with self._lock:
            return self._id_by_frame.get(frame)

    def _free(self, frame: str) -> str:
        if frame not in self._id_by_frame:
            return frame
        number = 2
        while f"{frame}_{number}" in self._id_by_frame:
            number += 1
        return f"{frame}_{number}"


def _valid_frame(id: str) -> str:
    return re.sub(r"[^A-Za-z0-9_./-]", "_", id).lstrip("/") or "_"


class JointFrame(NamedTuple):
    """The frame of a joint, which is fixed to the body that the joint moves."""

    joint: Joint
    moving: BodyId
    fixed: BodyId
    moving_from_joint: Array
    """The pose of the joint frame in the frame of the moving body, seven numbers."""
    fixed_from_joint: Array
    """The pose of the joint frame in the frame of the body that holds it, at joint position 0."""


def joint_frames(world: World, spawned: Iterable[World]) -> Iterator[JointFrame]:
    """Yields the frames of the joints of a world that allow a motion.

    Args:
        world: the current world.
        spawned: the worlds as they were spawned, which have the poses of bodies and joints at that time.
    """
    bodies = {body.id: body for body in world.bodies}
    first_poses = {body.id: body.pose for each in spawned for body in each.bodies}
    first_frames = {joint.id: joint.pose for each in spawned for joint in each.joints}
    for joint in world.joints:
        if joint.parent in bodies and joint.child in bodies and any(reach != 0.0 for reach in joint_reach(joint)):
            moving, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
            moving_from_joint, fixed_from_joint = (
                pose_multiply(
                    pose_inverse(normalized_pose_array(first_poses.get(body.id, body.pose))),
                    normalized_pose_array(first_frames.get(joint.id, joint.pose)),
                )
                for body in (moving, holder)
            )
            yield JointFrame(joint, moving.id, holder.id, moving_from_joint, fixed_from_joint)


class RobotFrames(NamedTuple):
    """The frames of the links of a robot."""

    frames: Mapping[str, str]
    """The frame id of each link, by the id of its body."""
    parents: Mapping[BodyId, BodyId]
    """The parent of each link but the root."""
    moving: frozenset[BodyId]
    """The links that move relative to their parent."""
    joints: frozenset[BodyId]
    """The joints of the robot, which have no frames."""


class FrameTransforms(NamedTuple):
    """Transforms from parent to child frames."""

    parents: tuple[str, ...]
    children: tuple[str, ...]
    poses: PoseArray
    """n x 7: the pose of each child in the frame of its parent."""

    def equals(self, other: FrameTransforms) -> bool:
        """Whether transforms are equal within the rounding of a simulation."""
        return (self.parents, self.children) == (other.parents, other.children) and bool(
            np.allclose(self.poses, other.poses, rtol=0.0, atol=_TOLERANCE)
        )


class FrameTree:
    """The tree of the frames of a world, for all of its states."""

    def __init__(
        self, world: World, spawned: Iterable[World], names: FrameNames, robots: Iterable[RobotFrames] = ()
    ) -> None:
        """Computes the tree.

        Args:
            spawned: the worlds as they were spawned.
            names: the frame ids.
            robots: the frames of the robots in the world.
        """
        bodies = {body.id: body for body in world.bodies}
        robots = tuple(robots)
        of_robots = frozenset[BodyId]().union(*(robot.joints for robot in robots))
        joints = {each.moving: each for each in joint_frames(world, spawned) if each.joint.id not in of_robots}
        parents = _parents(world, bodies, joints)
        moving_links: set[BodyId] = set()
        for robot in robots:
            names.prefer(robot.frames)
            parents |= {child: parent for child, parent in robot.parents.items() if {child, parent} <= bodies.keys()}
            moving_links |= robot.moving
        used = [each for id, each in joints.items() if parents.get(id) == _node_id(each.joint, bodies)]
        self.ids: tuple[BodyId, ...] = tuple(bodies)
        """The bodies in the tree."""
        joint_ids = [_node_id(each.joint, bodies) for each in used]
        nodes: list[str] = [*bodies, *joint_ids]
        rows = {id: row for row, id in enumerate(nodes)}
        self._names = tuple(names.assign(nodes))
        self.joints: Mapping[str, JointFrame] = dict(zip(self._names[len(bodies) :], used, strict=True))
        """The joints in the tree, by their frame ids."""
        self._bodies_of_joints = np.array([rows[each.moving] for each in used], dtype=np.intp)
        self._offsets = np.array([each.moving_from_joint for each in used], dtype=np.float64).reshape(-1, 7)
        parent_rows = [rows.get(parents.get(id, ""), -1) for id in bodies] + [rows[each.fixed] for each in used]
        self._parent_rows = np.array(parent_rows, dtype=np.intp)
        is_loose = [
            id in moving_links or (id not in parents and body.physics.mobility in _LOOSE) for id, body in bodies.items()
        ]
        self._moves = np.array(is_loose + [True] * len(used), dtype=bool)

    def transforms(self, ids: Sequence[BodyId], poses: PoseArray) -> tuple[FrameTransforms, FrameTransforms]:
        """Returns the moving and the static transforms of a state.

        Bodies that were added since the tree was computed are left out; of one that was removed, the children are
        children of the root.

        Args:
            ids: the bodies that exist.
            poses: their poses in the world frame, n x 7, in the same order.
        """
        world_from_body = poses.copy()
        world_from_body[:, 3:] = normalize(poses[:, 3:])
        if tuple(ids) != self.ids:
            return self._partial_transforms(ids, world_from_body)
        return self._split(world_from_body, np.ones(len(self.ids), dtype=bool))

    def _partial_transforms(self, ids: Sequence[BodyId], poses: Array) -> tuple[FrameTransforms, FrameTransforms]:
        rows = {id: row for row, id in enumerate(ids)}
        found = np.array([rows.get(id, -1) for id in self.ids], dtype=np.intp)
        world_from_body = np.tile(_IDENTITY, (len(self.ids), 1))
        world_from_body[found >= 0] = poses[found[found >= 0]]
        return self._split(world_from_body, found >= 0)

    def _split(self, world_from_body: Array, is_present: NDArray[np.bool_]) -> tuple[FrameTransforms, FrameTransforms]:
        exists = np.concatenate([is_present, is_present[self._bodies_of_joints]])
        parents = np.where((self._parent_rows >= 0) & exists[self._parent_rows], self._parent_rows, -1)
        joints = pose_multiply(world_from_body[self._bodies_of_joints], self._offsets)
        nodes = np.concatenate([world_from_body, joints.reshape(-1, 7)])
        relative, held = nodes.copy(), parents >= 0
        relative[held] = pose_multiply(pose_inverse(nodes[parents[held]]), nodes[held])
        return self._selected(relative, parents, exists & self._moves), self._selected(
            relative, parents, exists & ~self._moves
        )

    def _selected(self, relative: Array, parents: NDArray[np.intp], which: NDArray[np.bool_]) -> FrameTransforms:
        rows = np.flatnonzero(which)
        return FrameTransforms(
            tuple(self._names[row] if row >= 0 else ROOT_FRAME for row in parents[rows].tolist()),
            tuple(self._names[row] for row in rows.tolist()),
            relative[rows],
        )


def _node_id(joint: Joint, bodies: Container[BodyId]) -> str:
    return joint.id if joint.id not in bodies else f"{joint.id}/joint"


_LOOSE = frozenset({Mobility.DYNAMIC, Mobility.KINEMATIC})


def _parents(world: World, bodies: Mapping[BodyId, Body], joints: Mapping[BodyId, JointFrame]) -> dict[BodyId, str]:
    """Returns the id of the parent body or joint of each body that has one, without cycles."""
    parents: dict[BodyId, str] = {}
    bodies_above: dict[BodyId, BodyId] = {}

    def hold(child: BodyId, holder: BodyId, frame: str) -> None:
        above: BodyId | None = holder
        while above is not None and above != child:
            above = bodies_above.get(above)
        if above is None and child not in parents:
            parents[child], bodies_above[child] = frame, holder

    for attachment in world.attachments:
        if attachment.parent in bodies and attachment.child in bodies:
            hold(attachment.child, attachment.parent, attachment.parent)
    for moving, each in joints.items():
        hold(moving, each.fixed, _node_id(each.joint, bodies))
    for joint in world.joints:  # those without motion hold a body rigidly
        if joint.parent in bodies and joint.child in bodies and not any(reach != 0.0 for reach in joint_reach(joint)):
            moving, holder = (body.id for body in moving_body(joint, bodies[joint.parent], bodies[joint.child]))
            hold(moving, holder, holder)
    return parents
