"""The state of a simulation, read from any thread without waiting for it; and ids and IRIs for objects without one.

Poses come from the last published snapshot, which is never older than the last call that ended, so that thousands of
requests a second do not slow the simulation down.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Container, Iterable
from itertools import count
from typing import TYPE_CHECKING

from mindstage.engines import PoseArray
from mindstage.errors import BodyNotFoundError
from mindstage.robots import robots_of
from mindstage.ros.frames import WORLD_FRAMES, FrameNames, FrameTree, RobotFrames
from mindstage.scene import Body, BodyId, Iri, Pose, World
from mindstage.scene.transforms import normalized_pose_array, pose_from_array, pose_multiply
from mindstage.simulation import Simulation, StateSnapshot

if TYPE_CHECKING:  # it is loaded with the first robot
    from mindstage.robots.robot import Robot

__all__ = ["StateReader", "frame_in_namespace", "free_id", "map_iri", "name_in_ros", "odom_id", "robot_frames"]

_TREE_INTERVAL_S = 0.25
"""Least time between two computations of the frame tree, which reads the world from the engine [s]."""


def map_iri(name: str) -> Iri:
    """Returns the IRI of a map that has none."""
    return Iri(f"http://mindstage.org/maps/{name}.owl#map")


def free_id(stem: str, *taken: Container[str]) -> BodyId:
    """Returns an id that is in none of several containers."""
    ids = (f"{stem}_{number}" for number in count(1))
    return next(BodyId(id) for id in ids if not any(id in each for each in taken))


def name_in_ros(name: str) -> str:
    """Returns a name in the characters of names in ROS, of which the first is a letter."""
    valid = re.sub(r"[^A-Za-z0-9_]", "_", name) or "_"
    return valid if valid[0].isalpha() else f"robot_{valid}"


def frame_in_namespace(namespace: str, frame: str) -> str:
    """Returns the frame id of a link, or of `odom`, of the robot with a namespace."""
    return f"{namespace}/{frame}" if namespace else frame


def odom_id(robot: Robot) -> BodyId | None:
    """Returns the body at the place where a robot was added, which is its frame `odom`; None for a fixed robot."""
    base = robot.placed.base_joint_id
    return next((joint.parent for joint in robot.placed.world.joints if joint.id == base), None)


def robot_frames(robot: Robot, namespace: str) -> RobotFrames:
    """Returns the frames of the links of a robot.

    Args:
        namespace: the namespace of its names in ROS; empty for none.
    """
    model, ids = robot.model, robot.link_ids
    frames: dict[str, str] = {id: frame_in_namespace(namespace, link) for link, id in ids.items()}
    parents = {ids[joint.child]: ids[joint.parent] for joint in model.joints}
    moving = {ids[joint.child] for joint in model.joints if joint.is_movable}
    joints = set(robot.joint_ids.values())
    if (odom := odom_id(robot)) is not None:
        frames[odom] = frame_in_namespace(namespace, "odom")
        parents[ids[model.root]] = odom
        moving.add(ids[model.root])
        joints |= {joint.id for joint in robot.placed.world.joints if joint.parent == odom}
    return RobotFrames(frames, parents, frozenset(moving), frozenset(joints))


class StateReader:
    """Reads the state of a simulation, from any thread."""

    def __init__(self, simulation: Simulation, *, has_root: bool = True) -> None:
        """Reads nothing yet.

        Args:
            has_root: whether one robot may have names without a namespace; the place itself has such names otherwise.
        """
        self.simulation = simulation
        self._has_root = has_root
        self._rows: tuple[tuple[BodyId, ...], dict[BodyId, int]] = ((), {})
        self._world: tuple[int, World | None, dict[BodyId, Body]] = (-1, None, {})
        self._lock = threading.Lock()
        self.frame_names = FrameNames()
        """The frame ids of bodies and joints."""
        self._tree: tuple[tuple[int, tuple[str, ...]], float, FrameTree] | None = None
        self._namespaces: dict[str, str] = {}

    def state(self) -> StateSnapshot:
        """Returns the last snapshot of the state.

        Raises:
            EngineError: the engine has failed, and its state is unknown.
        """
        if self.simulation.engine.error is not None:
            raise self.simulation.engine.error
        return self.simulation.state

    def robot_bases(self) -> frozenset[BodyId]:
        """Returns the bodies of the root links of all robots."""
        return frozenset(each.link_ids[each.model.root] for each in robots_of(self.simulation).values())

    def row_by_id(self, snapshot: StateSnapshot) -> dict[BodyId, int]:
        """Returns the row of each body in the poses of a snapshot."""
        ids, rows = self._rows
        if ids is not snapshot.ids:
            start = len(ids) if snapshot.ids[: len(ids)] == ids else 0  # bodies were only added
            rows = dict(rows) if start else {}
            rows.update(zip(snapshot.ids[start:], range(start, len(snapshot.ids)), strict=True))
            self._rows = snapshot.ids, rows
        return rows

    def pose(self, id: str) -> PoseArray:
        """Returns the pose of a body: x y z [m], then quaternion w x y z.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        snapshot = self.state()
        row = self.row_by_id(snapshot).get(BodyId(id))
        if row is None:
            raise self.not_found_error(id, snapshot.ids)
        pose: PoseArray = snapshot.poses[row]
        return pose

    def require(self, ids: Iterable[str]) -> None:
        """Checks that bodies exist.

        Raises:
            BodyNotFoundError: for the first that does not.
        """
        snapshot = self.state()
        rows = self.row_by_id(snapshot)
        for id in ids:
            if id not in rows:
                raise self.not_found_error(id, snapshot.ids)

    def world(self) -> World:
        """Returns the world with its bodies as they are described; their current poses are in `state`."""
        return self._refresh_world()[1] or self.simulation.snapshot()

    def body(self, id: str) -> Body:
        """Returns the description of a body.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        bodies = self._refresh_world()[2]
        body = bodies.get(BodyId(id))
        if body is None:
            raise self.not_found_error(id, bodies)
        return body

    def to_world_frame(self, pose: Pose, frame_id: str) -> Pose:
        """Transforms a pose from the frame of a body, or of the world, to the frame of the world.

        The frame is the id of a body, or its frame id in tf.

        Raises:
            BodyNotFoundError: the frame is neither a body nor the world.
        """
        name = frame_id.lstrip("/")
        if name in WORLD_FRAMES:
            return pose
        if name not in self.row_by_id(self.state()):
            self.frame_names.assign(self.state().ids)
            name = self.frame_names.id_of(name) or name
        world_from_frame = normalized_pose_array(pose_from_array(self.pose(name)))
        return pose_from_array(pose_multiply(world_from_frame, normalized_pose_array(pose)))

    def version(self) -> tuple[int, tuple[str, ...]]:
        """Returns a value that differs after each edit: the revision, and the robots, which exist a little later."""
        return self.simulation.state.revision, tuple(self.simulation.robots)

    def robot_namespaces(self) -> dict[str, str]:
        """Returns the namespace of each robot: none for the first one, so that its names are those of a real robot.

        A further robot has its name as its namespace, and keeps it when others are removed.
        """
        robots = self.simulation.robots
        with self._lock:
            kept = {name: namespace for name, namespace in self._namespaces.items() if name in robots}
            for name in robots:
                if name not in kept:
                    kept[name] = "" if self._has_root and "" not in kept.values() else name_in_ros(name)
            self._namespaces = kept
            return dict(kept)

    def robot_joints(self) -> dict[str, frozenset[BodyId]]:
        """Returns the joints of each robot, which have topics of their own."""
        robots = robots_of(self.simulation).items()
        return {name: frozenset(joint.id for joint in robot.placed.world.joints) for name, robot in robots}

    def frame_tree(self, *, now_s: float | None = None) -> FrameTree:
        """Returns the tree of the frames; after an edit it is up to 0.25 s old.

        Args:
            now_s: time of a monotonic clock [s]; None computes the tree of the current world in any case.
        """
        self.state()  # raises the error of an engine that has failed
        version, tree = self.version(), self._tree
        if tree is None or (tree[0] != version and (now_s is None or now_s - tree[1] >= _TREE_INTERVAL_S)):
            namespaces, robots = self.robot_namespaces(), robots_of(self.simulation)
            frames = [robot_frames(robots[name], space) for name, space in namespaces.items() if name in robots]
            computed = FrameTree(self.world(), self.simulation.worlds, self.frame_names, frames)
            self._tree = tree = (version, now_s or 0.0, computed)
        return tree[2]

    def not_found_error(self, id: str, known: Iterable[str]) -> BodyNotFoundError:
        """Returns the error for an unknown id."""
        worlds = self.simulation.worlds
        return BodyNotFoundError(id, known=known, world=worlds[-1].name if worlds else "")

    def _refresh_world(self) -> tuple[int, World | None, dict[BodyId, Body]]:
        """Reads the world from the engine if it has changed since the last call."""
        revision = self.state().revision
        if self._world[0] != revision:
            with self._lock:
                if self._world[0] != revision:
                    world = self.simulation.snapshot()
                    self._world = revision, world, {body.id: body for body in world.bodies}
        return self._world
