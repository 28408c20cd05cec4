"""Edits of a running simulation, with undo and redo.

Applying an edit command returns its inverse, made from the state just before. There is one history for all clients.
Motion by physics is not an edit, and undoing an edit reverts only what that edit changed.

Joint positions are relative to the spawned poses. A deleted door that was open is therefore restored closed, at the
current pose of what it is attached to, and then opened again.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Protocol, cast

import msgspec
import numpy as np

from mindstage.engines.base import BodySavingEngine, Capability, Engine, SavedBodies, SavedState, SpawnOptions
from mindstage.errors import (
    BodyExistsError,
    BodyNotFoundError,
    EngineError,
    HistoryChangedError,
    InvalidArgumentError,
    NothingToUndoError,
    PoseUnreachableError,
    RestoreError,
    SimulationError,
    WorldError,
)
from mindstage.ranges import Index, checked
from mindstage.scene import Attachment, Body, BodyId, BodyPhysics, GeometryMap, Joint, Material, Pose, World
from mindstage.scene.joint_kinematics import handles_by_body, moving_body, outward_joints
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_angle,
)
from mindstage.simulation.body_groups import find_dependents
from mindstage.simulation.state import EngineSession

__all__ = [
    "AttachAt",
    "AttachBodies",
    "DeleteBodies",
    "DetachBody",
    "EditCommand",
    "MoveBodies",
    "MoveBody",
    "RestoreState",
    "SetLabel",
    "SetMaterials",
    "SetPhysics",
    "SpawnRecord",
    "StartState",
    "UndeleteBodies",
    "UndoHistory",
    "UndoStack",
]


class EditCommand(Protocol):
    """An edit that can be undone; if it raises, the world is unchanged."""

    @property
    def label(self) -> str:
        """A short description, such as "mass of Mug"."""

    def apply(self, engine: Engine) -> EditCommand:
        """Applies the edit, in the engine thread, and returns its inverse.

        Raises:
            WorldError: the world does not allow the edit.
        """


_Holders = Mapping[BodyId, tuple[BodyId, Pose]]


class MoveBody(msgspec.Struct, frozen=True):
    """Sets the pose of a body; attached bodies move with it."""

    id: BodyId
    pose: Pose
    label: str
    holders: _Holders | None = None
    """See `MoveBodies`."""

    def apply(self, engine: Engine) -> MoveBody:
        """See `EditCommand`."""
        before = current_pose(engine, self.id)
        holders = _holders(engine, (self.id,))
        _set_pose(engine, self.id, self.pose, self.holders)
        return MoveBody(self.id, before, self.label, _resting(engine, holders))


class MoveBodies(msgspec.Struct, frozen=True):
    """Sets the poses of several bodies at once, or of none."""

    poses: Mapping[BodyId, Pose]
    label: str
    holders: _Holders | None = None
    """What bodies were attached to, or on joints of, when they had these poses, and the poses of that: they are
    restored relative to it. None for a new motion, which is neither relative nor beyond a limit."""

    def apply(self, engine: Engine) -> MoveBodies:
        """See `EditCommand`."""
        present = current_poses(engine)
        if unknown := [id for id in self.poses if id not in present]:
            raise BodyNotFoundError(unknown[0], known=present)
        before, holders = {id: present[id] for id in self.poses}, _holders(engine, self.poses)
        move_one_another = len(self.poses) > 1 and _are_connected(engine, self.poses)
        steps: list[MoveBody] = []
        try:
            for id, pose in self.poses.items():
                if move_one_another:
                    steps.append(MoveBody(id, pose, self.label, self.holders).apply(engine))
                else:
                    _set_pose(engine, id, pose, self.holders)
        except WorldError:
            _set_back(engine, before)
            raise
        if not move_one_another:
            return MoveBodies(before, self.label, _resting(engine, holders))
        undone = {step.id: step for step in reversed(steps)}
        restored = {id: held for step in undone.values() for id, held in (step.holders or {}).items()}
        return MoveBodies({id: step.pose for id, step in undone.items()}, self.label, restored)


def _set_pose(engine: Engine, id: BodyId, pose: Pose, holders: _Holders | None) -> None:
    """Sets a new pose; or with `holders`, restores one."""
    if holders is None:
        engine.set_pose(id, pose)
        return
    if id in holders:
        holder, then = holders[id]
        now = current_poses(engine).get(holder, then)
        if now != then:
            arrays = (normalized_pose_array(each) for each in (pose, then, now))
            pose = pose_from_array(_moved_with(*arrays))
    if Capability.SAVE_BODIES in engine.capabilities:
        cast("BodySavingEngine", engine).restore_pose(id, pose)
    else:
        engine.set_pose(id, pose)


def _set_back(engine: Engine, poses: Mapping[BodyId, Pose]) -> None:
    """Sets poses that bodies had before; as some may move others of them, until all have them."""
    for _ in poses:
        now = current_poses(engine)
        wrong = [id for id, pose in poses.items() if _is_moved(pose, now[id], tolerance=_ROUNDING)]
        for id in wrong:
            _set_pose(engine, id, poses[id], {})
        if not wrong:
            break


def _resting(engine: Engine, holders: _Holders) -> _Holders:
    """Those of the holders that an edit has not moved along."""
    now = current_poses(engine)
    return {
        id: (holder, pose)
        for id, (holder, pose) in holders.items()
        if not _is_moved(pose, now[holder], tolerance=_ROUNDING)
    }


def _holders(engine: Engine, ids: Iterable[BodyId]) -> _Holders:
    """What bodies are attached to or on joints of, and the poses of that."""
    world = engine.snapshot()
    found, poses = _holder_of(engine, world), {body.id: body.pose for body in world.bodies}
    return {id: (found[id], poses[found[id]]) for id in ids if id in found}


def _holder_of(engine: Engine, world: World) -> Mapping[BodyId, BodyId]:
    """What each body is attached to or on a joint of."""
    bodies = {body.id: body for body in world.bodies}
    found: dict[BodyId, BodyId] = {}
    if Capability.JOINTS in engine.capabilities:  # otherwise a body does not move with what holds it by a joint
        for joint in world.joints:
            moving, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
            found.setdefault(moving.id, holder.id)
    return found | {each.child: each.parent for each in world.attachments}


def _are_connected(engine: Engine, ids: Collection[BodyId]) -> bool:
    """Whether attachments and joints connect some of the bodies, so that one of them moves another."""
    holder_of = _holder_of(engine, engine.snapshot())

    def root(id: BodyId) -> BodyId:
        visited = {id}
        while (holder := holder_of.get(id)) is not None and holder not in visited:
            id = holder
            visited.add(id)
        return id

    return len({root(id) for id in ids}) < len(ids)


class SetPhysics(msgspec.Struct, frozen=True):
    """Sets the physics properties of a body, such as mobility, gravity or mass."""

    id: BodyId
    physics: BodyPhysics
    label: str

    def apply(self, engine: Engine) -> SetPhysics:
        """See `EditCommand`."""
        before = engine.snapshot().body(self.id).physics
        engine.set_physics(self.id, self.physics)
        return SetPhysics(self.id, before, self.label)


class SetMaterials(msgspec.Struct, frozen=True):
    """Sets the materials of a body."""

    id: BodyId
    materials: tuple[Material, ...]
    label: str

    def apply(self, engine: Engine) -> SetMaterials:
        """See `EditCommand`."""
        before = engine.snapshot().body(self.id).materials
        engine.set_materials(self.id, self.materials)
        return SetMaterials(self.id, before, self.label)


class SetLabel(msgspec.Struct, frozen=True):
    """Sets the label of a body; an empty one removes it."""

    id: BodyId
    text: str
    label: str

    def apply(self, engine: Engine) -> SetLabel:
        """See `EditCommand`."""
        before = engine.snapshot().body(self.id).label
        engine.set_label(self.id, self.text)
        return SetLabel(self.id, before or "", self.label)


class AttachBodies(msgspec.Struct, frozen=True):
    """Attaches a body to another at its current relative pose."""

    parent: BodyId
    child: BodyId
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        inverse = _restore_parent(engine, self.child, self.label)
        engine.attach(self.parent, self.child)
        return inverse


class DetachBody(msgspec.Struct, frozen=True):
    """Detaches a body from its parent; its pose is unchanged."""

    child: BodyId
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        inverse = _restore_parent(engine, self.child, self.label)
        engine.detach(self.child)
        return inverse


class AttachAt(msgspec.Struct, frozen=True):
    """Attaches a body at a relative pose, moving it there first."""

    parent: BodyId
    child: BodyId
    parent_from_child: Pose
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        inverse, pose = _restore_parent(engine, self.child, self.label), current_pose(engine, self.child)
        parent = normalized_pose_array(current_pose(engine, self.parent))
        target = pose_from_array(pose_multiply(parent, normalized_pose_array(self.parent_from_child)))
        is_moved = _is_moved(pose, target, tolerance=_ROUNDING)
        if is_moved:
            with suppress(PoseUnreachableError):  # a joint holds it, too: it is attached where it is
                _set_pose(engine, self.child, target, {})
        try:
            engine.attach(self.parent, self.child)
        except Exception:
            if is_moved:
                _set_pose(engine, self.child, pose, {})
            raise
        return inverse


class RestoreState(msgspec.Struct, frozen=True):
    """Restores a saved state of the engine."""

    state: SavedState
    label: str

    def apply(self, engine: Engine) -> RestoreState:
        """See `EditCommand`."""
        before = engine.save_state()
        engine.restore_state(self.state)
        return RestoreState(before, self.label)


def current_pose(engine: Engine, id: BodyId) -> Pose:
    """The current pose of a body.

    Raises:
        BodyNotFoundError: no body has that id.
    """
    ids = engine.poses()[0]
    if id not in ids:
        raise BodyNotFoundError(id, known=ids)
    return current_poses(engine)[id]


def current_poses(engine: Engine) -> Mapping[BodyId, Pose]:
    """The current poses of all bodies; those of unmoved bodies equal the spawned ones exactly."""
    return {body.id: body.pose for body in engine.snapshot().bodies}


def parent_of(engine: Engine, id: BodyId) -> BodyId | None:
    """The body that a body is attached to; None if it is not attached."""
    attachments = engine.snapshot().attachments
    return next((attachment.parent for attachment in attachments if attachment.child == id), None)


def _restore_parent(engine: Engine, child: BodyId, label: str) -> DetachBody | AttachAt:
    """The edit that restores the current attachment of a body."""
    parent = parent_of(engine, child)
    if parent is None:
        return DetachBody(child, label)
    poses = current_poses(engine)
    relative = pose_multiply(pose_inverse(normalized_pose_array(poses[parent])), normalized_pose_array(poses[child]))
    return AttachAt(parent, child, pose_from_array(relative), label)


_Link = Joint | Attachment


class SpawnRecord(msgspec.Struct, frozen=True):
    """The spawned poses of bodies and joints, to which joint positions are relative."""

    poses: Mapping[BodyId, Pose]
    """By body."""
    joints: Mapping[BodyId, Joint]
    """By id."""
    outward_joints: Mapping[BodyId, Joint] = {}
    """The joints that engines limit to the outward direction, with these limits, by id."""

    @classmethod
    def from_worlds(cls, worlds: Iterable[World]) -> SpawnRecord:
        """The record of several worlds."""
        poses: dict[BodyId, Pose] = {}
        joints: dict[BodyId, Joint] = {}
        bodies: dict[BodyId, Body] = {}
        parents: dict[BodyId, BodyId] = {}
        for world in worlds:
            bodies |= {body.id: body for body in world.bodies}
            poses |= {body.id: body.pose for body in world.bodies}
            joints |= {joint.id: joint for joint in world.joints}
            parents |= {attachment.child: attachment.parent for attachment in world.attachments}
        limited = outward_joints(tuple(joints.values()), bodies, handles_by_body(bodies, parents))
        return cls(poses, joints, {id: each.joint for id, each in limited.items()})


class DeleteBodies(msgspec.Struct, frozen=True):
    """Deletes bodies with their joints and attachments."""

    ids: tuple[BodyId, ...]
    spawn_record: SpawnRecord
    geometry: GeometryMap
    label: str
    immovable: frozenset[BodyId] = frozenset()
    """Bodies that were spawned as static ones, whatever their mobility."""

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        before, saved = engine.snapshot(), _save_bodies(engine)
        engine.delete(self.ids)
        ids = tuple(sorted(set(self.ids)))
        return UndeleteBodies(before, ids, self.spawn_record, self.geometry, self.label, self.immovable, saved)


class UndeleteBodies(msgspec.Struct, frozen=True):
    """Spawns deleted bodies again, in their last state."""

    previous_world: World
    """The whole world before the deletion."""
    ids: tuple[BodyId, ...]
    """The deleted bodies."""
    spawn_record: SpawnRecord
    geometry: GeometryMap
    label: str
    immovable: frozenset[BodyId] = frozenset()
    """Bodies that were spawned as static ones, whatever their mobility."""
    saved: _SavedBodies | None = None
    """How the engine simulated them; None if it cannot save that."""

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        present = current_poses(engine)
        deleted = set(self.ids)
        if taken := deleted & present.keys():
            raise BodyExistsError(min(taken))
        links = list(self._removed_links(present))
        displaced = [id for id in dict.fromkeys(self._ends(link)[0] for link in links) if id not in deleted]
        if self.saved is not None:
            self._restore(cast("BodySavingEngine", engine), self.saved, links, displaced)
        else:
            self._spawn_again(engine, links, displaced, present)
        return DeleteBodies(self.ids, self.spawn_record, self.geometry, self.label, self.immovable)

    def _restore(
        self, engine: BodySavingEngine, saved: _SavedBodies, links: Iterable[_Link], displaced: Iterable[BodyId]
    ) -> None:
        """Restores the bodies exactly as they were simulated, relative to those that exist."""
        present = _simulated_poses(engine)
        _, poses = self._poses(links, present, saved.poses)
        moved = {id: poses[id] for id in displaced if not _same_pose(poses[id], present[id])}
        engine.restore_bodies(saved.bodies, {id: poses[id] for id in self.ids}, displaced=moved)

    def _spawn_again(
        self, engine: Engine, links: Sequence[_Link], displaced: Iterable[BodyId], present: Mapping[BodyId, Pose]
    ) -> None:
        """Spawns the bodies at position 0 of their joints, which are then moved."""
        previous = {body.id: normalized_pose_array(body.pose) for body in self.previous_world.bodies}
        now = {id: normalized_pose_array(pose) for id, pose in present.items()}
        spawn_poses, final_poses = self._poses(links, now, previous)
        try:
            for id in displaced:
                engine.set_pose(id, pose_from_array(spawn_poses[id]))
            self._spawn(engine, self._world_fragment(links, spawn_poses))
        except WorldError:
            for id in displaced:
                engine.set_pose(id, present[id])
            raise
        for link in links:
            moving, _ = self._ends(link)
            if isinstance(link, Joint) and not _same_pose(spawn_poses[moving], final_poses[moving]):
                with suppress(PoseUnreachableError):  # the body then stays at the joint's zero position
                    engine.set_pose(moving, pose_from_array(final_poses[moving]))

    def _spawn(self, engine: Engine, world: World) -> None:
        """Spawns the whole world or nothing.

        Raises:
            RestoreError: a part of it cannot be spawned.
        """
        report = engine.spawn(world, geometry=self.geometry, options=SpawnOptions(immovable=self.immovable))
        for failure in (*report.failed_bodies, *report.failed_joints, *report.failed_attachments):
            present = set(engine.poses()[0])
            engine.delete([id for id in self.ids if id in present])
            raise RestoreError(failure.id, reason=failure.reason)

    def _removed_links(self, present: Mapping[BodyId, Pose]) -> Iterator[_Link]:
        """The joints and attachments of the deleted bodies, among themselves and to bodies that still exist."""
        deleted = set(self.ids)
        links: tuple[_Link, ...] = (*self.previous_world.joints, *self.previous_world.attachments)
        for link in links:
            ends = {link.parent, link.child}
            if ends & deleted and ends <= deleted | present.keys():
                yield link

    def _ends(self, link: _Link) -> tuple[BodyId, BodyId]:
        """The body that moves with the other one, or relative to it, and that other one."""
        if isinstance(link, Attachment):
            return link.child, link.parent
        moving, holder = moving_body(link, self.previous_world.body(link.parent), self.previous_world.body(link.child))
        return moving.id, holder.id

    def _poses(
        self, links: Iterable[_Link], present: Mapping[BodyId, Array], previous: Mapping[BodyId, Array]
    ) -> tuple[Mapping[BodyId, Array], Mapping[BodyId, Array]]:
        """The poses with joints at zero, and the final poses, both relative to the bodies that exist.

        Args:
            links: what connects the deleted bodies.
            present: the poses of the bodies that exist.
            previous: the poses of all bodies before the deletion.
        """
        links = tuple(links)
        link_of = {self._ends(link)[0]: link for link in links}
        spawn_poses: dict[BodyId, Array] = {}
        final_poses: dict[BodyId, Array] = {}

        def compute(id: BodyId, descendants: frozenset[BodyId]) -> None:
            if id in spawn_poses:
                return
            link = link_of.get(id)
            holder = id if link is None else self._ends(link)[1]
            if link is None or holder in descendants:  # a root, or a kinematic loop, which is cut here
                spawn_poses[id] = final_poses[id] = previous[id] if id in self.ids else present[id]
                return
            compute(holder, descendants | {id})
            final_poses[id] = _moved_with(previous[id], previous[holder], final_poses[holder])
            zero = previous
            if isinstance(link, Joint):
                spawned = self.spawn_record.poses
                zero = {
                    end: normalized_pose_array(spawned[end]) if end in spawned else previous[end]
                    for end in (id, holder)
                }
            spawn_poses[id] = _moved_with(zero[id], zero[holder], spawn_poses[holder])

        for id in (*self.ids, *(end for link in links for end in (link.parent, link.child))):
            compute(id, frozenset())
        return spawn_poses, final_poses

    def _world_fragment(self, links: Iterable[_Link], spawn_poses: Mapping[BodyId, Array]) -> World:
        def placed(id: BodyId, pose: Pose) -> Pose:
            return (
                pose if _same_pose(normalized_pose_array(pose), spawn_poses[id]) else pose_from_array(spawn_poses[id])
            )

        def moved(joint: Joint) -> Joint:
            spawned = self.spawn_record.joints.get(joint.id, joint)
            parent = normalized_pose_array(
                self.spawn_record.poses.get(joint.parent) or pose_from_array(spawn_poses[joint.parent])
            )
            frame = _moved_with(normalized_pose_array(spawned.pose), parent, spawn_poses[joint.parent])
            return (
                joint
                if _same_pose(frame, normalized_pose_array(joint.pose))
                else msgspec.structs.replace(joint, pose=pose_from_array(frame))
            )

        deleted = set(self.ids)
        return World(
            iri=self.previous_world.iri,
            name=self.previous_world.name,
            bodies=tuple(
                msgspec.structs.replace(body, pose=placed(body.id, body.pose))
                for body in self.previous_world.bodies
                if body.id in deleted
            ),
            joints=tuple(moved(link) for link in links if isinstance(link, Joint)),
            attachments=tuple(link for link in links if isinstance(link, Attachment)),
        )


class _SavedBodies(msgspec.Struct, frozen=True, eq=False):
    """How an engine simulated all bodies before some of them were deleted."""

    bodies: SavedBodies
    poses: Mapping[BodyId, Array]


def _save_bodies(engine: Engine) -> _SavedBodies | None:
    if Capability.SAVE_BODIES not in engine.capabilities:
        return None
    return _SavedBodies(cast("BodySavingEngine", engine).save_bodies(), _simulated_poses(engine))


def _simulated_poses(engine: Engine) -> Mapping[BodyId, Array]:
    """The poses in the engine, where a snapshot has the described pose of a body that was moved out of others."""
    ids, poses = engine.poses()
    return dict(zip(ids, poses, strict=True))


def _moved_with(pose: Array, base_then: Array, base_now: Array) -> Array:
    """The pose after moving rigidly with a base."""
    if _same_pose(base_then, base_now):
        return pose  # exactly, without rounding
    return pose_multiply(base_now, pose_multiply(pose_inverse(base_then), pose))


def _same_pose(one: Array, other: Array) -> bool:
    return bool((one == other).all())


def _is_moved(before: Pose, now: Pose, *, tolerance: float | None = None) -> bool:
    """Whether poses differ visibly, or by more than a tolerance [m, rad]."""
    one, other = normalized_pose_array(before), normalized_pose_array(now)
    distance = np.linalg.norm(one[:3] - other[:3])
    if tolerance is not None:
        return bool(distance > tolerance or quat_angle(one[3:], other[3:]) > tolerance)
    return bool(distance > _MOVED_M or abs(one[3:] @ other[3:]) < _UNTURNED_COSINE)


def _is_unchanged(before: World, now: World) -> bool:
    """Whether two worlds have the same bodies and attachments, and no body has moved."""
    poses = {body.id: body.pose for body in before.bodies}
    if poses.keys() != {body.id for body in now.bodies} or set(before.attachments) != set(now.attachments):
        return False
    return not any(_is_moved(poses[body.id], body.pose) for body in now.bodies)


_MOVED_M, _UNTURNED_COSINE = 0.001, 0.99999
"""A body that moved by less, and turned by less than half a degree, counts as not moved."""
_ROUNDING = 1e-9
"""Poses that differ by less are equal [m, rad]."""
_MAX_UNDO = 200
"""Length of the undo history."""


class UndoHistory(msgspec.Struct, frozen=True):
    """Labels of the edits that can be undone and redone, the next one first."""

    undo: tuple[str, ...] = ()
    redo: tuple[str, ...] = ()


class UndoStack:
    """Applies edits to a simulation, and undoes and redoes them; may be called from any thread."""

    def __init__(self, simulation: EngineSession) -> None:
        self._simulation = simulation
        self._undo_edits: list[EditCommand] = []
        self._redo_edits: list[EditCommand] = []
        self._version = 0
        self._lock = threading.RLock()

    @property
    def history(self) -> UndoHistory:
        """The current undo and redo history."""
        with self._lock:
            return UndoHistory(
                tuple(edit.label for edit in self._undo_edits[::-1]),
                tuple(edit.label for edit in self._redo_edits[::-1]),
            )

    # -- edits ---------------------------------------------------------------------------------------------------------

    def move(self, id: BodyId, pose: Pose, *, continues_last: bool = False) -> None:
        """Sets the pose of a body, at rest; attached bodies move with it.

        Args:
            id: the body.
            pose: its new pose in the world frame.
            continues_last: whether to merge with the last edit, as during a drag, so that both are undone together.

        Raises:
            BodyNotFoundError: no body has that id.
            PoseUnreachableError: a joint does not allow the pose.
        """
        self.apply(MoveBody(id, pose, f"pose of {id}"), continues_last=continues_last)

    def move_all(self, poses: Mapping[BodyId, Pose], *, label: str = "", continues_last: bool = False) -> None:
        """Sets the poses of several bodies as one edit; bodies that are attached to others of them move with those.

        Args:
            poses: the new poses in the world frame, by body.
            label: the name of the edit.
            continues_last: see `move`.

        Raises:
            BodyNotFoundError: one of the bodies does not exist; nothing is moved then.
            PoseUnreachableError: a joint does not allow a pose; nothing is moved then.
        """
        name = next(iter(poses), "") if len(poses) == 1 else f"{len(poses)} bodies"
        self.apply(MoveBodies(dict(poses), label or f"pose of {name}"), continues_last=continues_last)

    def set_physics(self, id: BodyId, physics: BodyPhysics, *, label: str = "physics") -> None:
        """Sets mobility, gravity, mass and overlap events; `label` names what changes.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(SetPhysics(id, physics, f"{label} of {id}"))

    def set_materials(self, id: BodyId, materials: Iterable[Material]) -> None:
        """Sets the materials of a body.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(SetMaterials(id, tuple(materials), f"material of {id}"))

    def rename(self, id: BodyId, label: str) -> None:
        """Sets the label of a body, which people see instead of its id; an empty one removes it. The id stays.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(SetLabel(id, label.strip(), f"label of {id}"))

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """Attaches a body to another at its current relative pose.

        Raises:
            BodyNotFoundError: one of the two does not exist.
            AttachmentError: the attachment would be cyclic.
        """
        self.apply(AttachBodies(parent, child, f"{child} attached to {parent}"))

    def detach(self, child: BodyId) -> None:
        """Detaches a body from its parent.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(DetachBody(child, f"{child} detached"))

    def delete(self, ids: Iterable[BodyId], *, parts: bool = False, contents: bool = False) -> tuple[BodyId, ...]:
        """Deletes bodies with their joints and attachments: `delete(["fridge"], parts=True, contents=True)`.

        Args:
            ids: the bodies.
            parts: whether to delete their parts, too, which otherwise stay where they are; see `find_dependents`.
            contents: whether to delete the loose bodies on or in them, too.

        Returns:
            The deleted bodies.

        Raises:
            BodyNotFoundError: for the first id that does not exist; nothing is deleted then.
        """
        chosen = tuple(dict.fromkeys(ids))
        deleted = chosen
        if parts or contents:
            found = find_dependents(self._simulation.snapshot(), chosen)
            deleted += (*(found.parts if parts else ()), *(found.contents if contents else ()))
        name = chosen[0] if len(chosen) == 1 else f"{len(chosen)} bodies"
        more = f" with {len(deleted) - len(chosen)} more" if len(deleted) > len(chosen) else ""
        self.apply(self._deletion(deleted, f"{name}{more} deleted"))
        return deleted

    def record_spawn(self, ids: Iterable[BodyId], *, verb: str = "added") -> None:
        """Records the spawn of bodies as an edit, so that it can be undone; `verb` names it."""
        spawned = tuple(ids)
        name = spawned[0] if len(spawned) == 1 else f"{len(spawned)} bodies"
        self.record(self._deletion(spawned, f"{name} {verb}"))

    def record_motion(self, before: Mapping[BodyId, Pose], *, label: str) -> bool:
        """Records what has moved since some poses as one edit, such as a drag by hand; False if nothing has.

        Args:
            before: the poses that undoing restores; of bodies that are attached to others, those are enough.
            label: the name of the edit.
        """

        def record(engine: Engine) -> bool:
            now = current_poses(engine)
            parents = {each.child: each.parent for each in engine.snapshot().attachments}
            moved = {id for id, pose in before.items() if id in now and _is_moved(pose, now[id])}
            poses = {id: before[id] for id in moved if parents.get(id) not in moved}
            if poses:
                self.record(MoveBodies(poses, label, {}))
            return bool(poses)

        return self._simulation.run_on_engine(record, label=label)

    @contextmanager
    def one_step(self, label: str) -> Iterator[None]:
        """Makes all that happens in the context one edit, such as what a robot does; nothing if nothing has changed.

        Undoing it restores the state of the engine before, its clock included. An engine that cannot save its state
        only moves the bodies back.

        Args:
            label: the name of the edit.
        """
        with self._lock:
            earlier = list(self._undo_edits)
        can_save = Capability.SAVE in self._simulation.capabilities

        def look(engine: Engine) -> tuple[SavedState | None, World]:
            return engine.save_state() if can_save else None, engine.snapshot()

        state, before = self._simulation.run_on_engine(look, label="save")
        try:
            yield
        finally:
            with suppress(EngineError, SimulationError):  # it was closed, or its engine lost
                if not _is_unchanged(before, self._simulation.snapshot()):
                    with self._lock:
                        self._undo_edits[:] = [
                            edit for edit in self._undo_edits if any(edit is each for each in earlier)
                        ]
                    if state is not None:
                        self.record(RestoreState(state, label))
                    else:
                        self.record_motion({body.id: body.pose for body in before.bodies}, label=label)

    def reset(self) -> None:
        """Resets the simulation; can be undone if the engine can save its state, otherwise clears the history."""
        if Capability.SAVE not in self._simulation.capabilities:
            self._simulation.reset()
            self.clear()
            return
        before = self._simulation.run_on_engine(lambda engine: engine.save_state(), label="save")
        self._simulation.reset()
        self.record(RestoreState(before, "reset"))

    # -- undo and redo -------------------------------------------------------------------------------------------------

    def apply(self, edit: EditCommand, *, continues_last: bool = False) -> None:
        """Applies an edit; see `move` for `continues_last`."""

        def apply(engine: Engine) -> None:
            inverse = edit.apply(engine)
            last = self._undo_edits[-1] if self._undo_edits else None
            continues = last is not None and type(last) is type(inverse) and last.label == inverse.label
            if not (continues_last and continues):
                self.record(inverse)

        self._simulation.run_on_engine(apply, label=f"edit: {edit.label}", edits=True)

    def record(self, inverse: EditCommand) -> None:
        """Records the inverse of an edit that was applied elsewhere."""
        with self._lock:
            self._version += 1
            self._undo_edits.append(inverse)
            del self._undo_edits[:-_MAX_UNDO]
            self._redo_edits.clear()

    def undo(self) -> str:
        """Undoes the last edit and returns its label.

        Raises:
            NothingToUndoError: the history is empty.
            WorldError: the world no longer allows it; the edit is then removed from the history.
        """
        return self._undo_redo(self._undo_edits, self._redo_edits, redo=False)

    def redo(self) -> str:
        """Redoes the last undone edit and returns its label.

        Raises:
            NothingToUndoError: no undone edit is left.
            WorldError: the world no longer allows it; the edit is then removed from the history.
        """
        return self._undo_redo(self._redo_edits, self._undo_edits, redo=True)

    @checked
    def go_to(self, position: Index, *, version: Index | None = None) -> None:
        """Undoes or redoes edits, in one call of the engine, until so many are done.

        Args:
            position: how many edits of the history are done then; 0 undoes all.
            version: the `version` of the history that the position is from; None for the current one.

        Raises:
            HistoryChangedError: the history has another version.
            InvalidArgumentError: the history is shorter.
            WorldError: the world no longer allows an edit, which is then removed; those before it stay.
        """

        def go(engine: Engine) -> None:
            with self._lock:
                done, count = len(self._undo_edits), len(self._undo_edits) + len(self._redo_edits)
                if version is not None and version != self._version:
                    raise HistoryChangedError
            if not 0 <= position <= count:
                raise InvalidArgumentError(str(position), cause=f"the history has {count} steps")
            for _ in range(abs(position - done)):
                if position < done:
                    self._step(engine, self._undo_edits, self._redo_edits)
                else:
                    self._step(engine, self._redo_edits, self._undo_edits)

        self._simulation.run_on_engine(go, label="go to a step of the history", edits=True)

    @property
    def version(self) -> int:
        """A number that changes whenever the history does."""
        return self._version

    def clear(self) -> None:
        """Removes all edits from the history."""
        with self._lock:
            self._version += 1
            self._undo_edits.clear()
            self._redo_edits.clear()

    def _undo_redo(self, source: list[EditCommand], target: list[EditCommand], *, redo: bool) -> str:
        def undo_redo(engine: Engine) -> str:
            if not source:
                raise NothingToUndoError(redo=redo)
            return self._step(engine, source, target)

        return self._simulation.run_on_engine(undo_redo, label="redo" if redo else "undo", edits=True)

    def _step(self, engine: Engine, source: list[EditCommand], target: list[EditCommand]) -> str:
        """Applies the last edit of a list and appends its inverse to the other; in the engine thread."""
        with self._lock:
            edit = source.pop()
            self._version += 1
        inverse = edit.apply(engine)
        with self._lock:
            target.append(inverse)
        return edit.label

    def _spawn_record(self) -> SpawnRecord:
        return SpawnRecord.from_worlds(self._simulation.worlds)

    def _deletion(self, ids: tuple[BodyId, ...], label: str) -> DeleteBodies:
        known, immovable = self._simulation.geometry, self._simulation.immovable
        geometry = {id: known[id] for id in ids if id in known}
        return DeleteBodies(ids, self._spawn_record(), geometry, label, immovable.intersection(ids))


class StartState(msgspec.Struct, frozen=True, eq=False):
    """What `Simulation.reset_to_start` restores."""

    worlds: tuple[World, ...] = ()
    temporary_worlds: tuple[World, ...] = ()
    report_count: int = 0
    state: SavedState | None = None
    """None if the engine cannot save its state; the worlds are then spawned again."""
