"""Collisions of a robot in states in which it is not: with the place, with itself, and of what it holds.

The world is that of the moment at which a `CollisionChecker` is made: a copy in which only the robot moves. Contacts
are MuJoCo's, between the same convex shapes that the simulation has; those of an engine other than MuJoCo are computed
in a copy of its world.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np

from mindstage.engines.base import Engine
from mindstage.engines.mujoco.mujoco_kinematics import ContactModel
from mindstage.engines.mujoco.state import CompiledModel
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
_NEIGHBOR_CLEARANCE_M, _NEIGHBOR_JOINTS = -0.0005, 2
"""Links with at most so many joints between them may come so near: more than a graze would hold the arm back."""
_TOUCH_M = 0.001
"""Distance at which a gripper counts as touching something [m]."""
_MAX_TRAVEL_M, _MAX_HELD_M = 2.0, 2.0
"""The travel of a slide without limits, and the largest extent of a link with what it holds [m]."""
_START_SLACK_M = 0.001
"""A pair that is too near at the start may come nearer by this [m]."""
_AROUND_M = 0.01
"""The distance around the robot within which its surroundings are in all models [m]."""
_VICINITY_M = 1.0
"""A model is good for places that are so far apart along each axis [m]."""
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


M = TypeVar("M", bound=ContactModel)


class _Vicinities(Generic[M]):
    """A world as it was, in models of what is near some places, each compiled when it is needed first.

    What MuJoCo simulates in one model is one for all places.
    """

    def __init__(
        self,
        engine: Engine,
        source: Any,
        contacts: Callable[[CompiledModel], M],
        *,
        near: Collection[BodyId],
        box: Array,
    ) -> None:
        """Takes the present state of a world.

        Args:
            engine: the engine of the simulation; this is called in its thread.
            source: the result of `_in_mujoco`.
            contacts: makes the model of the contacts from a compiled one.
            near: bodies that are in all models.
            box: lower and upper corner of the box for the first model, 2 x 3 [m].
        """
        self._source, self._contacts, self._near = source, contacts, tuple(near)
        self._always: list[Array] = []
        """Boxes that are part of all models."""
        self._moved: dict[BodyId, float] = {}
        self._models: list[tuple[Array, M]] = []
        """With the box of each; the one that was used last is the first."""
        first = self._add(box)
        self._is_whole = len(first.ids) > len(source.poses()[0])
        if source is engine:
            self._source = None if self._is_whole else source.fork()

    @property
    def last(self) -> M:
        """The model that was used last."""
        return self._models[0][1]

    def _add(self, box: Array) -> M:
        boxes = (box, *self._always)
        found = self._contacts(self._source.compiled_near(self._near, within_m=_AROUND_M, boxes=boxes))
        for joint, position in self._moved.items():
            found.set_joint(joint, position)
        self._models.insert(0, (box, found))
        return found

    def around(self, place: Array, radius_m: float) -> M:
        """A model of all that is within a distance of a place along each axis, 3 numbers [m], and perhaps of more."""
        if self._is_whole:
            return self.last
        for number, (box, contacts) in enumerate(self._models):
            if _contains(box, np.array([place - radius_m, place + radius_m])):
                self._models.insert(0, self._models.pop(number))
                return contacts
        return self._add(_box_around(place, radius_m))

    def set_joint(self, joint: BodyId, position: float) -> None:
        """Moves a joint in all models; see `CollisionChecker.set_joint`."""
        if not self._is_whole and not all(contacts.has_joint(joint) for _, contacts in self._models):
            around = self._source.bounds([joint]) + np.array([[-_VICINITY_M], [_VICINITY_M]])
            self._always.append(around)
            last = self._models[0][0]
            self._models = [each for each in self._models if _contains(each[0], around)]
            if not _contains(last, around):
                self._add(last)
        for _, contacts in self._models:
            contacts.set_joint(joint, position)
        self._moved[joint] = position


def _contains(box: Array, other: Array) -> bool:
    """Whether a box, 2 x 3, contains another one."""
    return bool((box[0] <= other[0]).all() and (other[1] <= box[1]).all())


def _box_around(place: Array, radius_m: float) -> Array:
    """The box of a model of what is within a distance of a place, and of places near it."""
    return np.array([place - radius_m - _VICINITY_M, place + radius_m + _VICINITY_M])


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


class _RobotContacts(ContactModel):
    """Contacts of a robot with what is near it, and what their rows mean."""

    def __init__(
        self,
        compiled: CompiledModel,
        robot: Robot,
        joints: Sequence[str],
        *,
        moving: Collection[BodyId],
        ignored: Collection[BodyId],
        carried: Mapping[BodyId, BodyId],
        touch: Collection[BodyId],
        clearance_m: float,
    ) -> None:
        """See `ContactModel` and `CollisionChecker`."""
        super().__init__(compiled, moving=moving, ignored=ignored, carried=carried, clearance_m=clearance_m)
        link_ids, ids = robot.placed.link_ids, self.ids
        links = set(link_ids.values())
        held = self.moving - links
        hands = {link_ids[link] for link in _hand_links(robot.model)} | held
        self.is_own = np.array([id in links or id in held for id in ids])
        self.is_hand = np.array([id in hands for id in ids])
        self.may_be_touched = np.array([id in touch for id in ids])
        rows = {id: row for row, id in enumerate(ids)}
        self.links = [name for name, id in link_ids.items() if id in rows]
        self.own_number = np.full(len(ids), len(self.links), dtype=np.intp)
        """The number of each link in `links`; what is held has the last one."""
        self.own_number[[rows[link_ids[name]] for name in self.links]] = np.arange(len(self.links))
        self._set_joints(robot, joints)

    def _set_joints(self, robot: Robot, names: Sequence[str]) -> None:
        """Computes the map from values of joints to coordinates."""
        placed = robot.placed
        by_name = {joint.name: joint for joint in robot.model.joints}
        column = {name: number for number, name in enumerate(names)}
        addresses, columns, factors, offsets, start = [], [], [], [], []

        def add(joint: RobotJoint, source: str, factor: float, offset: float) -> None:
            address, sign = self.address(placed.joint_ids[joint.name])
            zero = placed.zero[joint.name]
            addresses.append(address)
            columns.append(column[source])
            factors.append(sign * factor)
            offsets.append(sign * (offset - zero))
            start.append(zero + sign * float(self.data.qpos[address]))

        for name in names:
            add(by_name[name], name, 1.0, 0.0)
        self.start = tuple(start)
        """The positions of the joints [m or rad]."""
        for joint in robot.model.joints:
            if joint.mimic is not None and joint.mimic.joint in column and joint.name in placed.joint_ids:
                add(joint, joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset)
        self._addresses = np.array(addresses, dtype=np.intp)
        self._columns = np.array(columns, dtype=np.intp)
        self._factors, self._offsets = np.array(factors), np.array(offsets)

    def set_values(self, values: Array | Sequence[float]) -> None:
        """Moves the joints [m or rad], and what is held."""
        self.data.qpos[self._addresses] = self._factors * np.asarray(values)[self._columns] + self._offsets
        self.update()
        self.carry()


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
        self._base_joint = robot.placed.base_joint_id if base_moves else None
        self._base_frame = robot.base_frame()
        copy = partial(self._copy, moving=moving, carried=carried, ignore=ignore, touch=touch)
        self._vicinities, self._radius_m = robot.session.engine.run(copy, label="copy for collisions")
        self.start = self._vicinities.last.start
        """The positions of `joints` when the world was copied [m or rad]."""
        self._set_self_clearance()
        self._allowed: dict[frozenset[BodyId | None], float] = {}
        """The distances of the pairs that are too near in the present state."""
        ids, nearest = self._vicinities.last.ids, dict[frozenset[BodyId | None], float]()
        for row, other, distance, _ in self._too_near():
            pair = frozenset((ids[row], ids[other]))
            nearest[pair] = min(distance, nearest.get(pair, distance))
        self._allowed = {pair: distance - _START_SLACK_M for pair, distance in nearest.items()}

    def _copy(
        self,
        engine: Engine,
        *,
        moving: Collection[BodyId],
        carried: Mapping[BodyId, BodyId],
        ignore: Collection[BodyId],
        touch: Collection[BodyId],
    ) -> tuple[_Vicinities[_RobotContacts], float]:
        """The present state of the world, and how far the robot gets from its root with its base somewhere [m]."""
        robot, clearance_m = self._robot, max(self._clearance_m, 0.0)
        source, links = _in_mujoco(engine, robot.session), robot.placed.link_ids.values()
        sizes = {body.id: body.size for body in robot.session.snapshot().bodies} if carried else {}
        contents = {
            id: holder
            for held, holder in carried.items()
            for id in _carried_by(held, source, sizes.get(held), excluded={*links, *carried})
        }
        ids = set(source.poses()[0])
        here = [id for id in (*links, *contents, *carried) if id in ids]
        root = self._base_frame.root_at(robot.base_pose())[:3]
        bounds, reach_m = source.bounds(here), _reach_m(robot.model)
        radius_m = float(np.linalg.norm(np.abs(bounds - root).max(axis=0)))
        radius_m = max(radius_m, reach_m if self.joints else 0.0) + clearance_m
        is_mobile = self._base_joint is not None
        box = _box_around(root, radius_m) if is_mobile else bounds + np.array([[-reach_m], [reach_m]])
        contacts = partial(
            _RobotContacts,
            robot=robot,
            joints=self.joints,
            moving=moving,
            ignored=ignore,
            carried={**contents, **carried},
            touch=touch,
            clearance_m=clearance_m,
        )
        return _Vicinities(engine, source, contacts, near=here, box=box), radius_m

    def _set_self_clearance(self) -> None:
        """Finds out how near the links may come to each other, by their numbers."""
        model, names = self._robot.model, self._vicinities.last.links
        depth = _joints_between(model)
        self._self_clearance = np.full((len(names) + 1, len(names) + 1), _SELF_CLEARANCE_M)
        for a, first in enumerate(names):
            for b, second in enumerate(names):
                if depth.get((first, second), _NEIGHBOR_JOINTS + 1) <= _NEIGHBOR_JOINTS:
                    self._self_clearance[a, b] = self._self_clearance[b, a] = _NEIGHBOR_CLEARANCE_M
        for gripper in model.grippers:  # its closed fingers press on each other
            hand = links_behind(model, gripper.link)
            same = [number for number, name in enumerate(names) if name in hand]
            self._self_clearance[np.ix_(same, same)] = -np.inf
        self._fit_links()

    def _fit_links(self) -> None:
        """Allows the pairs of links that are near each other in the folded pose to be so."""
        contacts = self._vicinities.last
        present = contacts.data.qpos.copy()
        rest = {
            name: at for arm in self._robot.model.arms for name, at in zip(arm.joints, arm.rest_positions, strict=False)
        }
        contacts.set_values([rest.get(name, now) for name, now in zip(self.joints, self.start, strict=True)])
        geoms, distances = contacts.near_geoms()
        rows = contacts.body_rows(geoms[distances < _SELF_CLEARANCE_M])
        first, second = contacts.own_number[rows[contacts.is_own[rows].all(axis=1)]].T
        for a, b in ((first, second), (second, first)):
            self._self_clearance[a, b] = np.minimum(self._self_clearance[a, b], _FITTED_CLEARANCE_M)
        contacts.data.qpos[:] = present
        contacts.update()

    def find(self, values: Array | Sequence[float], base: BasePose | None = None) -> Collision | None:
        """The worst collision in a state; None if it is free.

        Args:
            values: positions of `joints`, in their order [m or rad].
            base: x, y [m] and yaw [rad] of the base, as `Robot.base_pose`, if it is moved; None for where it
                was last.
        """
        self.tests += 1
        if base is not None and self._base_joint is not None:
            root = self._base_frame.root_at(base)
            contacts = self._vicinities.around(root[:3], self._radius_m)
            contacts.set_planar_pose(self._base_joint, *base_pose_of(root))
        else:
            contacts = self._vicinities.last
        contacts.set_values(values)
        found = self._too_near()
        if not found:
            return None
        row, other, distance, least = min(found, key=lambda each: each[2])
        if not contacts.is_own[row] or (contacts.is_own[other] and other < row):
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
        self._vicinities.set_joint(joint, position)

    def find_at(self, positions: Mapping[str, float], base: BasePose | None = None) -> Collision | None:
        """As `find`, with positions by joint; joints that are left out are where they were when this was made."""
        return self.find([positions.get(name, now) for name, now in zip(self.joints, self.start, strict=True)], base)

    def is_free(self, values: Array | Sequence[float]) -> bool:
        """Whether a state is free of collisions; see `find`."""
        return self.find(values) is None

    def _too_near(self) -> list[tuple[int, int, float, float]]:
        """Rows, distances and least distances of the pairs that are nearer than they may be."""
        contacts = self._vicinities.last
        geoms, distances = contacts.near_geoms()
        if not len(distances):
            return []
        rows = contacts.body_rows(geoms)
        both = contacts.is_own[rows].all(axis=1)
        own = contacts.own_number[rows]
        least = np.where(both, self._self_clearance[own[:, 0], own[:, 1]], self._clearance_m)
        touching = (contacts.is_hand[rows] & contacts.may_be_touched[rows[:, ::-1]]).any(axis=1)
        found = []
        for number in np.flatnonzero((distances < least) & ~touching).tolist():
            row, other = rows[number].tolist()
            distance = float(distances[number])
            limit = self._allowed.get(frozenset((contacts.ids[row], contacts.ids[other])))
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

        self._link = link_ids[gripper.link]
        self._grasp = normalized_pose_array(gripper.grasp_pose)

        def copy(engine: Engine) -> tuple[_Vicinities[ContactModel], float]:
            source = _in_mujoco(engine, robot.session)
            ids, poses = source.poses()
            bounds = source.bounds(id for id in self._hand if id in ids)
            place = pose_multiply(poses[ids.index(self._link)], self._grasp)[:3]
            radius_m = float(np.linalg.norm(np.abs(bounds - place).max(axis=0)))
            radius_m += gripper.max_opening_m + max(clearance_m, 0.0)
            contacts = partial(ContactModel, moving=self._hand, ignored=ignored, clearance_m=max(clearance_m, 0.0))
            box = _box_around(place, radius_m)
            return _Vicinities(engine, source, contacts, near=self._hand & set(ids), box=box), radius_m

        self._vicinities, self._radius_m = robot.session.engine.run(copy, label="copy for collisions")
        self._clearance_m, self._touch = clearance_m, frozenset(touch)
        self._joints = []
        fingers = [(name, name, 1.0, 0.0) for name in gripper.joints]
        followers = [(each.name, each.mimic) for each in model.joints if each.mimic is not None]
        fingers += [(n, m.joint, m.multiplier, m.offset) for n, m in followers if m.joint in gripper.joints]
        for name, other, factor, offset in fingers:
            self._joints.append((robot.placed.joint_ids[name], other, factor, offset - robot.placed.zero[name]))

    def set_joint(self, joint: BodyId, position: float) -> None:
        """See `CollisionChecker.set_joint`."""
        self._vicinities.set_joint(joint, position)

    def find(self, grasp_pose: PoseLike, fingers: Mapping[str, float], *, strictly: bool = False) -> Collision | None:
        """The worst collision of the gripper; None if it is free.

        Args:
            grasp_pose: pose of its grasp frame in the world frame.
            fingers: positions of its joints [m or rad].
            strictly: whether it may not touch what else it may.
        """
        grasp = normalized_pose_array(grasp_pose)
        contacts = self._vicinities.around(grasp[:3], self._radius_m)
        for joint, name, factor, offset in self._joints:
            address, sign = contacts.address(joint)
            contacts.data.qpos[address] = sign * (factor * fingers[name] + offset)
        contacts.update()
        here = pose_multiply(contacts.pose(self._link), self._grasp)
        contacts.move_rigidly(self._hand, pose_multiply(grasp, pose_inverse(here)))
        geoms, distances = contacts.near_geoms()
        if not len(distances):
            return None
        rows = contacts.body_rows(geoms)
        is_hand = np.array([[contacts.ids[row] in self._hand for row in pair] for pair in rows.tolist()])
        outside = ~is_hand.all(axis=1)
        touches = np.array([any(contacts.ids[row] in self._touch for row in pair) for pair in rows.tolist()])
        least = np.where(touches, _TOUCH_M if strictly else -np.inf, self._clearance_m)
        found = np.flatnonzero(outside & (distances < least))
        if not len(found):
            return None
        worst = int(found[np.argmin(distances[found])])
        row, other = rows[worst].tolist()
        if contacts.ids[row] not in self._hand:
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
        source = _in_mujoco(engine, robot.session)
        alone = ContactModel(source.compiled_near(part, within_m=_AROUND_M), moving=part)
        boxes = []
        for position in positions:
            alone.set_joint(joint, position)
            alone.update()
            boxes.append(alone.moving_bounds())
        return ContactModel(source.compiled_near(part, within_m=_AROUND_M, boxes=boxes), moving=part, ignored=ignored)

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
