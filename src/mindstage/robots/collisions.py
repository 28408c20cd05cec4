"""Collisions of a robot in states in which it is not: with the place, with itself, and of what it holds.

The world is that of the moment at which a `CollisionChecker` is made: a copy in which only the robot moves. Contacts
are MuJoCo's, between the same convex shapes that the simulation has; those of an engine other than MuJoCo are computed
in a copy of its world.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any

import msgspec
import numpy as np

from mindstage.engines.base import Engine
from mindstage.engines.mujoco.mujoco_kinematics import ContactModel
from mindstage.robots.drives import links_moved_by
from mindstage.robots.floor_poses import BasePose, base_pose_of
from mindstage.robots.models.robot_model import Gripper, RobotJoint, RobotModel
from mindstage.robots.robot import Robot
from mindstage.scene import BodyId, PoseLike, Vector
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import Array, normalized_pose_array, pose_inverse, pose_multiply
from mindstage.simulation.imagined import copied_engine
from mindstage.simulation.simulation import Simulation

__all__ = ["Collision", "CollisionChecker", "HandChecker", "find_part_collision", "links_behind"]

CLEARANCE_M = 0.005
"""Distance that planned motions keep from the place [m]."""
_SELF_CLEARANCE_M = 0.0015
"""Distance that a robot's own links keep from each other [m]; a graze would hold the arm back."""
_FITTED_CLEARANCE_M = -0.0005
"""Links that are nearer than that in the folded pose, such as those of a telescope, may come so near."""
_NEIGHBOR_CLEARANCE_M, _NEIGHBOR_JOINTS = -0.003, 2
"""Links with at most so many joints between them may come so near: their hulls overlap a little where their meshes do
not."""
_TOUCH_M = 0.001
"""Distance at which a gripper counts as touching something [m]."""
_MAX_TRAVEL_M, _MAX_HELD_M = 2.0, 2.0
"""The travel of a slide without limits, and the largest extent of a link with what it holds [m]."""
_START_SLACK_M = 0.001
"""A pair that is too near at the start may come nearer by this [m]."""
_PART_OVERLAP_M = 0.005
"""A door or drawer may get so much deeper into others than it is: neighboring fronts are flush."""


class Collision(msgspec.Struct, frozen=True, kw_only=True):
    """Two bodies that touch, or come nearer than the clearance."""

    part: BodyId
    """The link of the robot, or what it holds."""
    obstacle: BodyId | None
    """None for a ground plane that the engine has added."""
    distance_m: float
    """Negative if they penetrate [m]."""
    least_m: float = 0.0
    """The distance that they may have [m]."""

    def __str__(self) -> str:
        other = "the ground" if self.obstacle is None else self.obstacle
        distance = abs(self.distance_m) * 1000
        text = f"{distance:.0f}" if distance >= 10.0 else f"{distance:.2g}"
        return f"{self.part} is {text} mm {'inside' if self.distance_m < 0.0 else 'from'} {other}"


def _collision(contacts: ContactModel, row: int, other: int, distance_m: float, least_m: float) -> Collision:
    part = contacts.ids[row]
    assert part is not None  # the ground is not a part of a robot
    return Collision(part=part, obstacle=contacts.ids[other], distance_m=distance_m, least_m=least_m)


def _in_mujoco(engine: Engine, session: Simulation) -> Any:
    """The world of an engine in MuJoCo: a copy if it is another one."""
    if engine.name == "mujoco":
        return engine
    spawn = partial(Spawn, geometry=session.geometry, immovable=session.immovable)
    return copied_engine(engine, worlds=session.worlds, spawn=spawn, physics=True)[0]


def _carried_by(
    holder: BodyId, engine: Engine, size: Vector | None, *, excluded: Collection[BodyId]
) -> frozenset[BodyId]:
    """What lies in or on a body, and moves with it: what touches it, or what does, and is within its extents.

    Args:
        size: its extents; None if they are unknown.
        excluded: other bodies.
    """
    found, last = {holder}, set[BodyId]()
    contacts = engine.contacts()
    ids, poses = engine.poses()
    rows = {id: row for row, id in enumerate(ids)}
    to_holder = pose_inverse(poses[rows[holder]])
    while found != last:
        last = set(found)
        for a, b in ((each.a, each.b) for each in contacts if each.b is not None):
            for one, other in ((a, b), (b, a)):
                if one in found and other not in found and other not in excluded and size is not None:
                    local = pose_multiply(to_holder, poses[rows[other]])[:3]
                    if bool((np.abs(local[:2]) < np.asarray(size)[:2] / 2).all()):
                        found.add(other)
    return frozenset(found - {holder})


def _moved_links(model: RobotModel, joints: Iterable[str]) -> frozenset[str]:
    """The links that some joints move, with those of joints that mimic them."""
    names = set(joints)
    drives = [
        each for each in model.joints if each.name in names or (each.mimic is not None and each.mimic.joint in names)
    ]
    return frozenset(link for each in drives for link in links_moved_by(model, each))


def _reach_m(model: RobotModel) -> float:
    """How far anything of a robot whose base stands still can be from its present box, at most [m]."""
    far: dict[str, float] = {}
    for joint in model.joints:  # parents come first
        travel = max(map(abs, joint.limits)) if joint.is_prismatic else 0.0
        length = float(np.linalg.norm(joint.origin.position)) + (travel if isfinite(travel) else _MAX_TRAVEL_M)
        far[joint.child] = far.get(joint.parent, 0.0) + length
    return max(far.values(), default=0.0) + _MAX_HELD_M


def _joints_between(model: RobotModel) -> dict[tuple[str, str], int]:
    """For each link and those before it, the number of movable joints between them."""
    found: dict[tuple[str, str], int] = {(link.name, link.name): 0 for link in model.links}
    before: dict[str, list[str]] = {link.name: [link.name] for link in model.links}
    for joint in model.joints:  # parents come first
        for ancestor in before[joint.parent]:
            found[joint.child, ancestor] = found[joint.parent, ancestor] + joint.is_movable
        before[joint.child] = [*before[joint.parent], joint.child]
    return found


def _hand_links(model: RobotModel) -> frozenset[str]:
    """The links of the grippers: those that carry the fingers, and all behind them."""
    return frozenset().union(*(links_behind(model, each.link) for each in model.grippers))


def links_behind(model: RobotModel, link: str) -> frozenset[str]:
    """A link and all behind it."""
    found = {link}
    for joint in model.joints:  # parents come first
        if joint.parent in found:
            found.add(joint.child)
    return frozenset(found)


class CollisionChecker:
    """Whether states of a robot are free of collisions; for one thread.

    Pairs that are too near in the present state may stay so, but not come nearer.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        joints: Sequence[str] | None = None,
        base_moves: bool = False,
        ignore: Collection[BodyId] = (),
        touch: Collection[BodyId] = (),
        clearance_m: float = CLEARANCE_M,
    ) -> None:
        """Copies the present state of the world.

        Args:
            joints: the joints that states have values for, in this order; None for all that have drives.
            base_moves: whether the base is moved, too.
            ignore: bodies that are no obstacles.
            touch: bodies that the grippers may touch, such as a handle, and the rest of the robot may not.
            clearance_m: the distance to keep from the place [m].

        Raises:
            KeyError: there is no such joint.
        """
        model, link_ids = robot.model, robot.placed.link_ids
        self.joints = tuple(each.name for each in model.actuated_joints) if joints is None else tuple(joints)
        self._robot, self._clearance_m = robot, clearance_m
        self.tests = 0
        """Number of states that were tested so far, as a measure of work."""
        links = {link.name for link in model.links} if base_moves else _moved_links(model, self.joints)
        held = robot.held
        carried = {
            held[each.name]: link_ids[each.link] for each in model.grippers if each.name in held and each.link in links
        }
        moving = {link_ids[link] for link in links if link in link_ids}
        sizes = {body.id: body.size for body in robot.session.snapshot().bodies} if carried else {}

        def copy(engine: Engine) -> ContactModel:
            source = _in_mujoco(engine, robot.session)
            contents = {
                id: carried[holder]
                for holder in carried
                for id in _carried_by(holder, source, sizes.get(holder), excluded={*link_ids.values(), *carried})
            }
            links_here = [id for id in link_ids.values() if id in source.poses()[0]]
            return ContactModel(
                source.compiled() if base_moves else source.compiled_near(links_here, within_m=_reach_m(model)),
                moving=moving,
                ignored=ignore,
                carried=contents | carried,
                clearance_m=max(clearance_m, 0.0),
            )

        self._contacts = robot.session.engine.run(copy, label="copy for collisions")
        self._set_joints()
        self._base_joint = robot.placed.base_joint_id if base_moves else None
        self._base_frame = robot.base_frame()
        self._classify(touch)
        self._fit_links()
        nearest: dict[tuple[int, int], float] = {}
        for row, other, distance, _ in self._too_near({}):
            key = (min(row, other), max(row, other))
            nearest[key] = min(distance, nearest.get(key, distance))
        self._allowed = {key: distance - _START_SLACK_M for key, distance in nearest.items()}
        """The distances of the pairs that are too near in the present state."""

    def _classify(self, touch: Collection[BodyId]) -> None:
        """Finds out which bodies are parts of the robot, of its hands, or may be touched by them."""
        link_ids, ids = self._robot.placed.link_ids, self._contacts.ids
        links = set(link_ids.values())
        held = self._contacts.moving - links
        hands = {link_ids[link] for link in _hand_links(self._robot.model)} | held
        self._is_own = np.array([id in links or id in held for id in ids])
        self._is_hand = np.array([id in hands for id in ids])
        self._may_be_touched = np.array([id in touch for id in ids])
        depth = _joints_between(self._robot.model)
        names = [name for name, id in link_ids.items() if id in ids]
        self._own_number = np.full(len(ids), len(names), dtype=np.intp)  # what is held has the last number
        rows = {id: row for row, id in enumerate(ids)}
        for number, name in enumerate(names):
            self._own_number[rows[link_ids[name]]] = number
        self._self_clearance = np.full((len(names) + 1, len(names) + 1), _SELF_CLEARANCE_M)
        for a, first in enumerate(names):
            for b, second in enumerate(names):
                if depth.get((first, second), _NEIGHBOR_JOINTS + 1) <= _NEIGHBOR_JOINTS:
                    self._self_clearance[a, b] = self._self_clearance[b, a] = _NEIGHBOR_CLEARANCE_M
        for gripper in self._robot.model.grippers:  # its closed fingers press on each other
            hand = links_behind(self._robot.model, gripper.link)
            same = [number for number, name in enumerate(names) if name in hand]
            self._self_clearance[np.ix_(same, same)] = -np.inf

    def _fit_links(self) -> None:
        """Allows the pairs of links that are near each other in the folded pose to be so."""
        data = self._contacts.data
        present = data.qpos.copy()
        rest = {
            name: at for arm in self._robot.model.arms for name, at in zip(arm.joints, arm.rest_positions, strict=False)
        }
        self._set_values([rest.get(name, now) for name, now in zip(self.joints, self.start, strict=True)])
        geoms, distances = self._contacts.near_geoms()
        rows = self._contacts.body_rows(geoms[distances < _SELF_CLEARANCE_M])
        first, second = self._own_number[rows[self._is_own[rows].all(axis=1)]].T
        for a, b in ((first, second), (second, first)):
            self._self_clearance[a, b] = np.minimum(self._self_clearance[a, b], _FITTED_CLEARANCE_M)
        data.qpos[:] = present
        self._contacts.update()

    def _set_values(self, values: Array | Sequence[float]) -> None:
        contacts = self._contacts
        contacts.data.qpos[self._addresses] = self._factors * np.asarray(values)[self._columns] + self._offsets
        contacts.update()
        contacts.carry()

    def _set_joints(self) -> None:
        """Computes the map from values of `joints` to coordinates."""
        placed = self._robot.placed
        by_name = {joint.name: joint for joint in self._robot.model.joints}
        column = {name: number for number, name in enumerate(self.joints)}
        addresses, columns, factors, offsets, start = [], [], [], [], []

        def add(joint: RobotJoint, source: str, factor: float, offset: float) -> None:
            address, sign = self._contacts.address(placed.joint_ids[joint.name])
            zero = placed.zero[joint.name]
            addresses.append(address)
            columns.append(column[source])
            factors.append(sign * factor)
            offsets.append(sign * (offset - zero))
            start.append(zero + sign * float(self._contacts.data.qpos[address]))

        for name in self.joints:
            add(by_name[name], name, 1.0, 0.0)
        self.start = tuple(start)
        """The positions of `joints` when the world was copied [m or rad]."""
        for joint in self._robot.model.joints:
            if joint.mimic is not None and joint.mimic.joint in column and joint.name in placed.joint_ids:
                add(joint, joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset)
        self._addresses = np.array(addresses, dtype=np.intp)
        self._columns = np.array(columns, dtype=np.intp)
        self._factors, self._offsets = np.array(factors), np.array(offsets)

    def find(self, values: Array | Sequence[float], base: BasePose | None = None) -> Collision | None:
        """The worst collision in a state; None if it is free.

        Args:
            values: positions of `joints`, in their order [m or rad].
            base: x, y [m] and yaw [rad] of the base, as `Robot.base_pose`, if it is moved; None for where it
                was last.
        """
        self.tests += 1
        contacts = self._contacts
        if base is not None and self._base_joint is not None:
            contacts.set_planar_pose(self._base_joint, *base_pose_of(self._base_frame.root_at(base)))
        self._set_values(values)
        found = self._too_near(self._allowed)
        if not found:
            return None
        row, other, distance, least = min(found, key=lambda each: each[2])
        if not self._is_own[row] or (self._is_own[other] and other < row):
            row, other = other, row
        return _collision(contacts, row, other, distance, least)

    def set_joint(self, joint: BodyId, position: float) -> None:
        """Moves a joint of the place, such as that of a drawer, for all states that are tested from now on.

        Loose bodies that rest on what it moves, such as the contents of the drawer, are moved with it.

        Args:
            joint: the joint; it has one axis.
            position: relative to its spawned position [m or rad].

        Raises:
            KeyError: the joint is not simulated.
        """
        self._contacts.set_joint(joint, position)

    def find_at(self, positions: Mapping[str, float], base: BasePose | None = None) -> Collision | None:
        """As `find`, with positions by joint; joints that are left out are where they were when this was made."""
        return self.find([positions.get(name, now) for name, now in zip(self.joints, self.start, strict=True)], base)

    def is_free(self, values: Array | Sequence[float]) -> bool:
        """Whether a state is free of collisions; see `find`."""
        return self.find(values) is None

    def _too_near(self, allowed: Mapping[tuple[int, int], float]) -> list[tuple[int, int, float, float]]:
        """Rows, distances and least distances of the pairs that are nearer than they may be."""
        geoms, distances = self._contacts.near_geoms()
        if not len(distances):
            return []
        rows = self._contacts.body_rows(geoms)
        both = self._is_own[rows].all(axis=1)
        own = self._own_number[rows]
        least = np.where(both, self._self_clearance[own[:, 0], own[:, 1]], self._clearance_m)
        touching = (self._is_hand[rows] & self._may_be_touched[rows[:, ::-1]]).any(axis=1)
        found = []
        for number in np.flatnonzero((distances < least) & ~touching).tolist():
            row, other = rows[number].tolist()
            distance = float(distances[number])
            limit = allowed.get((min(row, other), max(row, other)))
            if limit is None or distance < limit:
                found.append((row, other, distance, float(least[number])))
        return found


class HandChecker:
    """Collisions of a gripper alone, wherever its arm would be: what it cannot grasp, no place of the base mends."""

    def __init__(
        self,
        robot: Robot,
        gripper: Gripper,
        *,
        touch: Collection[BodyId] = (),
        clearance_m: float = CLEARANCE_M,
    ) -> None:
        """Copies the present state of the world.

        Args:
            touch: bodies that it may touch.
            clearance_m: the distance to keep from the place [m].
        """
        model, link_ids = robot.model, robot.placed.link_ids
        hand = links_behind(model, gripper.link)
        self._hand = frozenset(link_ids[link] for link in hand if link in link_ids)
        others = [id for id in link_ids.values() if id not in self._hand]
        ignored = {*others, *robot.held.values()}

        def copy(engine: Engine) -> ContactModel:
            return ContactModel(
                _in_mujoco(engine, robot.session).compiled(),
                moving=self._hand,
                ignored=ignored,
                clearance_m=max(clearance_m, 0.0),
            )

        self._contacts = robot.session.engine.run(copy, label="copy for collisions")
        self._clearance_m = clearance_m
        self._link = link_ids[gripper.link]
        self._grasp = normalized_pose_array(gripper.grasp_pose)
        self._is_hand = np.array([id in self._hand for id in self._contacts.ids])
        self._may_be_touched = np.array([id in touch for id in self._contacts.ids])
        self._joints = []
        fingers = [(name, name, 1.0, 0.0) for name in gripper.joints]
        followers = [(each.name, each.mimic) for each in model.joints if each.mimic is not None]
        fingers += [(n, m.joint, m.multiplier, m.offset) for n, m in followers if m.joint in gripper.joints]
        for name, other, factor, offset in fingers:
            address, sign = self._contacts.address(robot.placed.joint_ids[name])
            self._joints.append((address, sign, other, factor, offset - robot.placed.zero[name]))

    def set_joint(self, joint: BodyId, position: float) -> None:
        """See `CollisionChecker.set_joint`."""
        self._contacts.set_joint(joint, position)

    def find(self, grasp_pose: PoseLike, fingers: Mapping[str, float], *, strictly: bool = False) -> Collision | None:
        """The worst collision of the gripper; None if it is free.

        Args:
            grasp_pose: pose of its grasp frame in the world frame.
            fingers: positions of its joints [m or rad].
            strictly: whether it may not touch what else it may.
        """
        contacts = self._contacts
        for address, sign, name, factor, offset in self._joints:
            contacts.data.qpos[address] = sign * (factor * fingers[name] + offset)
        contacts.update()
        here = pose_multiply(contacts.pose(self._link), self._grasp)
        contacts.move_rigidly(self._hand, pose_multiply(normalized_pose_array(grasp_pose), pose_inverse(here)))
        geoms, distances = contacts.near_geoms()
        if not len(distances):
            return None
        rows = contacts.body_rows(geoms)
        outside = ~self._is_hand[rows].all(axis=1)
        touches = self._may_be_touched[rows].any(axis=1)
        least = np.where(touches, _TOUCH_M if strictly else -np.inf, self._clearance_m)
        found = np.flatnonzero(outside & (distances < least))
        if not len(found):
            return None
        worst = int(found[np.argmin(distances[found])])
        row, other = rows[worst].tolist()
        if not self._is_hand[row]:
            row, other = other, row
        return _collision(contacts, row, other, float(distances[worst]), float(least[worst]))


def find_part_collision(
    robot: Robot, part: Collection[BodyId], joint: BodyId, positions: Sequence[float]
) -> tuple[int, Collision] | None:
    """The first position at which a door or drawer would be inside something that does not give way.

    The robot and loose bodies give way; what lies in a drawer moves with it.

    Args:
        part: the door or drawer, and its handle.
        joint: its joint, with one axis.
        positions: of the joint, relative to the spawned one, the present one first [m or rad].

    Returns:
        The number of the position and the deepest collision there; None if the way is free.
    """
    ignored = {*robot.link_ids.values(), *robot.held.values()}

    def copy(engine: Engine) -> ContactModel:
        return ContactModel(_in_mujoco(engine, robot.session).compiled(), moving=part, ignored=ignored)

    contacts = robot.session.engine.run(copy, label="copy for collisions")
    is_part = np.array([id in contacts.moving for id in contacts.ids])
    is_loose = np.array([id in contacts.loose for id in contacts.ids])
    before: dict[tuple[int, int], float] = {}
    for number, position in enumerate(positions):
        contacts.set_joint(joint, position)
        contacts.update()
        geoms, distances = contacts.near_geoms()
        worst: tuple[float, int, int] | None = None
        for (row, other), distance in zip(contacts.body_rows(geoms).tolist(), distances.tolist(), strict=True):
            if is_part[row] == is_part[other] or is_loose[row] or is_loose[other]:
                continue
            pair = (row, other) if is_part[row] else (other, row)
            if number == 0:
                before[pair] = min(distance, before.get(pair, 0.0))
            elif distance < before.get(pair, 0.0) - _PART_OVERLAP_M and (worst is None or distance < worst[0]):
                worst = (distance, *pair)
        if worst is not None:
            return number, _collision(contacts, worst[1], worst[2], worst[0], -_PART_OVERLAP_M)
    return None
