"""How engines in this process apply edits, and compute the inverse of each from the state before."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from msgspec.structs import replace

from mindstage.engines.base import Applied, Capability, Engine, SpawnReport
from mindstage.engines.edits import PoseRow, RestoreBodies, SetActuators, SimulatedBodies
from mindstage.engines.entity_registry import EntityRegistry
from mindstage.errors import (
    PoseUnreachableError,
    SpawnRefusedError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.scene import Attachment, Body, BodyGeometry, BodyId, Joint, Pose, World
from mindstage.scene.edits import Attach, BodyEdit, Delete, Detach, Edit, EditGroup, SetPhysics, SetPoses, Spawn
from mindstage.scene.joint_kinematics import moving_body
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_angle,
)

__all__ = ["EditingEngine", "Performed", "apply_parts", "is_moved", "links_of", "pose_row", "unsupported_edit"]

_ROUNDING = 1e-9
"""Poses that differ by less are equal [m, rad]."""
_KNOWN = (Spawn, RestoreBodies, Delete, SetPoses, Attach, Detach, BodyEdit, SetActuators)
_NO_REPORT = SpawnReport()
_Holders = Mapping[BodyId, tuple[BodyId, Pose]]
_InverseMaker = Callable[["Performed"], Edit]


@dataclass(frozen=True, slots=True)
class Performed:
    """The result of an edit that an engine has made."""

    report: SpawnReport = _NO_REPORT
    moved: Mapping[BodyId, Array] = field(default_factory=dict)
    """The bodies that a spawn has moved out of others, and their new poses."""
    before: Mapping[BodyId, Array] = field(default_factory=dict)
    """Those of them that existed, and the poses that they had."""


class EditingEngine(ABC):
    """An engine with a registry of its bodies: `apply` for all edits, of which it makes each with `_perform`."""

    name: str

    @abstractmethod
    def _entities(self) -> EntityRegistry:
        """The bodies, joints and attachments as they were described."""

    @abstractmethod
    def _perform(self, edit: Edit) -> Performed:
        """Makes an edit that neither has parts, nor sets poses, nor restores bodies; or raises and changes nothing."""

    @abstractmethod
    def _restore(self, edit: RestoreBodies, displaced: Mapping[BodyId, Array]) -> None:
        """Adds deleted bodies at the poses of the edit, after others were moved, with all that is connected to them."""

    @abstractmethod
    def _set_pose(self, id: BodyId, pose: Pose, *, restores: bool) -> None:
        """Sets the pose of a body that exists; with `restores` also one beyond a limit, where physics had moved it."""

    @abstractmethod
    def _decisions(self, ids: Collection[BodyId]) -> tuple[SimulatedBodies, Mapping[BodyId, BodyGeometry]]:
        """How some bodies are simulated, and their geometry."""

    def _actuators_inverse(self, edit: SetActuators) -> SetActuators:
        """The edit that restores the actuators."""
        raise unsupported_edit(self.name, edit)

    @property
    def _engine(self) -> Engine:
        """This object, with the rest of the protocol, which a subclass has."""
        return cast("Engine", self)

    # -- edits ---------------------------------------------------------------------------------------------------------

    def apply(self, edit: Edit) -> Applied:
        """See `Engine`."""
        entities = self._entities()
        if parts := edit.parts():
            return apply_parts(self._engine, edit, parts)
        if not isinstance(edit, _KNOWN):
            raise unsupported_edit(self.name, edit)
        if isinstance(edit, SetPoses):
            return Applied(edit=edit, inverse=self._set_poses(edit))
        if isinstance(edit, Attach) and edit.pose is not None:
            return self._attach_at(edit, edit.pose)
        make_inverse = self._inverse_maker(edit, entities)
        if isinstance(edit, RestoreBodies):
            self._restore(*_relative(edit, entities, self._rows()))
            performed = Performed()
        else:
            performed = self._perform(edit)
            if isinstance(edit, Spawn) and edit.whole and not performed.report.ok:
                self.apply(make_inverse(performed))
                first = performed.report.failures[0]
                raise SpawnRefusedError(first.id, reason=first.reason)
        return Applied(edit=edit, inverse=make_inverse(performed), report=performed.report)

    def _inverse_maker(self, edit: Edit, entities: EntityRegistry) -> _InverseMaker:
        """Reads what an edit changes, before it is made; returns a function of its result that returns the inverse."""
        inverse: Edit
        match edit:
            case Spawn():
                return self._spawn_inverse(edit)
            case RestoreBodies():
                entities.require_free(edit.ids)
                inverse = Delete(edit.ids)
            case Delete():
                inverse = self._deletion_inverse(edit, entities)
            case Attach() | Detach():
                inverse = self._attachment_inverse(edit.child, entities)
            case SetPhysics():
                immovable = edit.id in entities.immovable
                inverse = replace(edit.inverse(entities.body(edit.id)), immovable=immovable)
            case BodyEdit():
                inverse = edit.inverse(entities.body(edit.id))
            case SetActuators():
                inverse = self._actuators_inverse(edit)
            case _:
                raise unsupported_edit(self.name, edit)
        return lambda _: inverse

    def _spawn_inverse(self, edit: Spawn) -> _InverseMaker:
        bodies = self._entities().bodies
        before = {id for id in edit.ids if id in bodies}

        def inverse(performed: Performed) -> Edit:
            present = self._entities().bodies.keys()
            deletion = Delete(tuple(id for id in dict.fromkeys(edit.ids) if id in present and id not in before))
            moved = {id: pose_from_array(row) for id, row in performed.before.items()}
            return EditGroup((deletion, SetPoses(moved, {}))) if moved else deletion

        return inverse

    def _deletion_inverse(self, edit: Delete, entities: EntityRegistry) -> RestoreBodies:
        world = entities.fragment(edit.bodies)
        ends = {end for link in links_of(world) for end in (link.parent, link.child)}
        kept = {*edit.bodies, *ends}
        decisions, geometry = self._decisions(edit.bodies)
        ids, rows = self._engine.poses()
        poses = {id: pose_row(rows[row]) for row, id in enumerate(ids) if id in kept}
        return RestoreBodies(world, poses, decisions, geometry=geometry)

    def _attachment_inverse(self, child: BodyId, entities: EntityRegistry) -> Edit:
        """The edit that restores the current attachment of a body."""
        entities.body(child)
        parent = entities.parents.get(child)
        if parent is None:
            return Detach(child)
        poses = self._described_poses()
        to_parent = pose_inverse(normalized_pose_array(poses[parent]))
        relative = pose_multiply(to_parent, normalized_pose_array(poses[child]))
        return Attach(parent, child, pose_from_array(relative))

    def _attach_at(self, edit: Attach, pose: Pose) -> Applied:
        """Attaches a body at a pose relative to its parent; where it is, if a joint does not allow that."""
        entities = self._entities()
        inverse = self._attachment_inverse(edit.child, entities)
        entities.body(edit.parent)
        poses = self._described_poses()
        before, parent = poses[edit.child], normalized_pose_array(poses[edit.parent])
        target = pose_from_array(pose_multiply(parent, normalized_pose_array(pose)))
        moves = is_moved(before, target)
        if moves:
            with suppress(PoseUnreachableError):
                self._set_pose(edit.child, target, restores=True)
        try:
            self._perform(edit)
        except WorldError:
            if moves:
                self._set_pose(edit.child, before, restores=True)
            raise
        return Applied(edit=edit, inverse=inverse)

    # -- poses ---------------------------------------------------------------------------------------------------------

    def _rows(self) -> dict[BodyId, Array]:
        return dict(zip(*self._engine.poses(), strict=True))

    def _set_poses(self, edit: SetPoses) -> SetPoses:
        """Sets poses; returns the inverse."""
        present, holder_of = self._described_poses(), self._holder_of()
        for id in edit.poses:
            self._entities().body(id)
        connected = _connected(holder_of, edit.poses)
        undone: dict[BodyId, Pose] = {}
        holders: dict[BodyId, tuple[BodyId, Pose]] = {}
        alone: dict[BodyId, tuple[BodyId, Pose]] = {}
        """Those of the bodies that no other body of the edit moves: whether they rest is found at once, at the end."""
        try:
            for id, pose in edit.poses.items():
                now = self._described_poses() if id in connected else present
                held = {id: (holder_of[id], now[holder_of[id]])} if id in holder_of else {}
                undone[id] = now[id]
                self._set_pose(id, self._relative_pose(id, pose, edit.holders, now), restores=edit.holders is not None)
                if id in connected:
                    holders |= self._resting(held)
                else:
                    alone |= held
        except WorldError:
            self._set_back({id: present[id] for id in edit.poses})
            raise
        undone = {id: undone[id] for id in reversed(undone)}
        return SetPoses(undone, holders | self._resting(alone))

    def _described_poses(self) -> dict[BodyId, Pose]:
        """The current poses; those of unmoved bodies equal the spawned ones exactly."""
        return {body.id: body.pose for body in self._engine.snapshot().bodies}

    @staticmethod
    def _relative_pose(id: BodyId, pose: Pose, holders: _Holders | None, present: Mapping[BodyId, Pose]) -> Pose:
        """A pose that is restored, after what held the body has moved."""
        if holders is None or id not in holders:
            return pose
        holder, then = holders[id]
        now = present.get(holder, then)
        if now == then:
            return pose
        arrays = (normalized_pose_array(each) for each in (pose, then, now))
        return pose_from_array(_moved_with(*arrays))

    def _set_back(self, poses: Mapping[BodyId, Pose]) -> None:
        """Sets poses that bodies had before; as some may move others of them, until all have them."""
        for _ in poses:
            now = self._described_poses()
            wrong = [id for id, pose in poses.items() if is_moved(pose, now[id])]
            for id in wrong:
                self._set_pose(id, poses[id], restores=True)
            if not wrong:
                break

    def _resting(self, holders: _Holders) -> dict[BodyId, tuple[BodyId, Pose]]:
        """Those of the holders that an edit has not moved along."""
        if not holders:
            return {}
        now = self._described_poses()
        return {id: (holder, pose) for id, (holder, pose) in holders.items() if not is_moved(pose, now[holder])}

    def _holder_of(self) -> dict[BodyId, BodyId]:
        """What each body is attached to or on a joint of."""
        entities, found = self._entities(), dict[BodyId, BodyId]()
        # Without this capability, a body does not move with what holds it by a joint.
        if Capability.JOINTS in self._engine.capabilities:
            for joint in entities.joints.values():
                moving, holder = moving_body(joint, entities.bodies[joint.parent], entities.bodies[joint.child])
                found.setdefault(moving.id, holder.id)
        return found | entities.parents


def apply_parts(engine: Engine, edit: Edit, parts: Iterable[Edit]) -> Applied:
    """Makes an edit that consists of others, or nothing of it."""
    done: list[Applied] = []
    try:
        for part in parts:
            done.append(engine.apply(part))
    except Exception:
        for each in reversed(done):
            engine.apply(each.inverse)
        raise
    report = next((each.report for each in done if each.report != _NO_REPORT), _NO_REPORT)
    inverses = tuple(each.inverse for each in reversed(done))
    return Applied(edit=edit, inverse=edit.inverse_of_parts(inverses), report=report)


def unsupported_edit(engine: str, edit: Edit) -> UnsupportedByEngineError:
    """The error of an edit of a kind that an engine does not know."""
    return UnsupportedByEngineError(engine, what=edit.kind, remedy="use mujoco")


def links_of(world: World) -> tuple[Joint | Attachment, ...]:
    """The joints and attachments of a world."""
    return (*world.joints, *world.attachments)


def pose_row(array: Array) -> PoseRow:
    """A pose as a tuple, exactly."""
    x, y, z, w, i, j, k = array.tolist()
    return x, y, z, w, i, j, k


def is_moved(before: Pose, now: Pose, *, tolerance_m: float = _ROUNDING, tolerance_rad: float = _ROUNDING) -> bool:
    """Whether poses differ by more than rounding, or than tolerances [m, rad]."""
    if before == now:
        return False
    one, other = normalized_pose_array(before), normalized_pose_array(now)
    distance = np.linalg.norm(one[:3] - other[:3])
    return bool(distance > tolerance_m or quat_angle(one[3:], other[3:]) > tolerance_rad)


def _connected(holder_of: Mapping[BodyId, BodyId], ids: Collection[BodyId]) -> set[BodyId]:
    """Those of the bodies that attachments and joints connect with others of them, so that one may move another."""

    def root(id: BodyId) -> BodyId:
        visited = {id}
        while (holder := holder_of.get(id)) is not None and holder not in visited:
            id = holder
            visited.add(id)
        return id

    roots = {id: root(id) for id in ids}
    counts = Counter(roots.values())
    return {id for id in ids if counts[roots[id]] > 1}


# -- deleted bodies ----------------------------------------------------------------------------------------------------


def _relative(
    edit: RestoreBodies, entities: EntityRegistry, present: Mapping[BodyId, Array]
) -> tuple[RestoreBodies, dict[BodyId, Array]]:
    """The edit with poses relative to the bodies that exist, and the poses of those that return to a restored one."""
    restored = set(edit.ids)
    bodies = entities.bodies | {body.id: body for body in edit.world.bodies}
    links = [link for link in links_of(edit.world) if {link.parent, link.child} <= restored | present.keys()]
    ends = [_ends(link, bodies) for link in links]
    holder_of = dict(ends)
    then = {id: np.array(row) for id, row in edit.poses.items()}
    now: dict[BodyId, Array] = {}

    def compute(id: BodyId, descendants: frozenset[BodyId]) -> None:
        if id in now:
            return
        holder = holder_of.get(id)
        if holder is None or holder in descendants:  # a root, or a kinematic loop, which is cut here
            now[id] = then[id] if id in restored else present[id]
            return
        compute(holder, descendants | {id})
        now[id] = _moved_with(then[id], then[holder], now[holder])

    for id in (*restored, *(end for pair in ends for end in pair)):
        compute(id, frozenset())
    displaced = {id: now[id] for id, _ in ends if id not in restored and not np.array_equal(now[id], present[id])}
    return replace(edit, poses={id: pose_row(now[id]) for id in edit.ids}), displaced


def _ends(link: Joint | Attachment, bodies: Mapping[BodyId, Body]) -> tuple[BodyId, BodyId]:
    """The body that moves with the other one, or relative to it, and that other one."""
    if isinstance(link, Attachment):
        return link.child, link.parent
    moving, holder = moving_body(link, bodies[link.parent], bodies[link.child])
    return moving.id, holder.id


def _moved_with(pose: Array, base_then: Array, base_now: Array) -> Array:
    """The pose after moving rigidly with a base."""
    if np.array_equal(base_then, base_now):
        return pose  # exactly, without rounding
    return pose_multiply(base_now, pose_multiply(pose_inverse(base_then), pose))
