"""Removal: deleting bodies so that they can come back, with their constraints and all that hung on them.

A constraint counts from where its bodies were when they were spawned. A door that was open when it was deleted is
therefore spawned shut, and then opened as far as it was; and what it belongs to may stand elsewhere by then.

Edits: what a person changes in a running world, each of which knows what undoes it.

An edit goes through the engine's contract alone. Applied, it gives the edit that takes it back, made from the world as
it was just before; applied in turn, that one gives the edit that does it again.

Editing: what people change in a running world, with a way back.

One history for all: whoever undoes takes back what was edited last, by whomever. What the physics does is no edit, and
an undone edit changes what it changed and nothing else: the world does not go back in time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Protocol

import msgspec

from mindstage.engines.base import Capability, Engine, SavedState
from mindstage.errors import (
    BodyExistsError,
    BodyNotFoundError,
    NothingToUndoError,
    PoseUnreachableError,
    RestoreError,
    WorldError,
)
from mindstage.scene import Attachment, BodyId, BodyPhysics, GeometryMap, Joint, Material, Pose, World
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_inverse, pose_multiply
from mindstage.simulation.state import EngineSession

__all__ = [
    "AttachAt",
    "AttachBodies",
    "DeleteBodies",
    "DetachBody",
    "EditCommand",
    "MoveBody",
    "RestoreState",
    "SetMaterials",
    "SetPhysics",
    "SpawnRecord",
    "UndeleteBodies",
    "UndoHistory",
    "UndoStack",
]


class EditCommand(Protocol):
    """One change; the world is as before if it raises."""

    @property
    def label(self) -> str:
        """It in a few words, such as "mass of Mug"."""

    def apply(self, engine: Engine) -> EditCommand:
        """Does it, in the thread that owns the engine, and gives what takes it back.

        Raises:
            WorldError: the world does not allow it.
        """


class MoveBody(msgspec.Struct, frozen=True):
    """Puts a body somewhere else, with all that hangs on it."""

    id: BodyId
    pose: Pose
    label: str

    def apply(self, engine: Engine) -> MoveBody:
        """See `EditCommand`."""
        before = current_pose(engine, self.id)
        engine.set_pose(self.id, self.pose)
        return MoveBody(self.id, before, self.label)


class SetPhysics(msgspec.Struct, frozen=True):
    """Changes mobility, gravity or mass."""

    id: BodyId
    physics: BodyPhysics
    label: str

    def apply(self, engine: Engine) -> SetPhysics:
        """See `EditCommand`."""
        before = engine.snapshot().body(self.id).physics
        engine.set_physics(self.id, self.physics)
        return SetPhysics(self.id, before, self.label)


class SetMaterials(msgspec.Struct, frozen=True):
    """Changes the surface."""

    id: BodyId
    materials: tuple[Material, ...]
    label: str

    def apply(self, engine: Engine) -> SetMaterials:
        """See `EditCommand`."""
        before = engine.snapshot().body(self.id).materials
        engine.set_materials(self.id, self.materials)
        return SetMaterials(self.id, before, self.label)


class AttachBodies(msgspec.Struct, frozen=True):
    """Lets a body hang on another from now on, where both are."""

    parent: BodyId
    child: BodyId
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        before = parent_of(engine, self.child)
        back = (
            DetachBody(self.child, self.label) if before is None else _attach_at(engine, before, self.child, self.label)
        )
        engine.attach(self.parent, self.child)
        return back


class DetachBody(msgspec.Struct, frozen=True):
    """Lets go of a body where it is."""

    child: BodyId
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        before = parent_of(engine, self.child)
        back = (
            DetachBody(self.child, self.label) if before is None else _attach_at(engine, before, self.child, self.label)
        )
        engine.detach(self.child)
        return back


class AttachAt(msgspec.Struct, frozen=True):
    """Hangs a body where it hung before, although it may have fallen since."""

    parent: BodyId
    child: BodyId
    parent_from_child: Pose
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        holder, place = parent_of(engine, self.child), current_pose(engine, self.child)
        parent = normalized_pose_array(current_pose(engine, self.parent))
        engine.set_pose(
            self.child, pose_from_array(pose_multiply(parent, normalized_pose_array(self.parent_from_child)))
        )
        try:
            engine.attach(self.parent, self.child)
        except Exception:
            engine.set_pose(self.child, place)
            raise
        if holder is None:
            return DetachBody(self.child, self.label)
        return AttachAt(holder, self.child, self.parent_from_child, self.label)


class RestoreState(msgspec.Struct, frozen=True):
    """Brings back a saved state of everything."""

    state: SavedState
    label: str

    def apply(self, engine: Engine) -> RestoreState:
        """See `EditCommand`."""
        before = engine.save_state()
        engine.restore_state(self.state)
        return RestoreState(before, self.label)


def current_pose(engine: Engine, id: BodyId) -> Pose:
    """Where a body is now.

    Raises:
        BodyNotFoundError: there is none of that id.
    """
    return current_poses(engine)[id] if id in engine.poses()[0] else _raise_not_found(engine, id)


def current_poses(engine: Engine) -> Mapping[BodyId, Pose]:
    """Where all bodies are now; what nobody moved is exactly where it was described."""
    return {body.id: body.pose for body in engine.snapshot().bodies}


def parent_of(engine: Engine, id: BodyId) -> BodyId | None:
    """What a body hangs on."""
    return next((hold.parent for hold in engine.snapshot().attachments if hold.child == id), None)


def _attach_at(engine: Engine, parent: BodyId, child: BodyId, label: str) -> AttachAt:
    poses = current_poses(engine)
    relative = pose_multiply(pose_inverse(normalized_pose_array(poses[parent])), normalized_pose_array(poses[child]))
    return AttachAt(parent, child, pose_from_array(relative), label)


def _raise_not_found(engine: Engine, id: BodyId) -> Pose:
    raise BodyNotFoundError(id, known=engine.poses()[0])


_Link = Joint | Attachment


class SpawnRecord(msgspec.Struct, frozen=True):
    """What was spawned, as it was given: from there constraints count."""

    poses: Mapping[BodyId, Pose]
    joints: Mapping[BodyId, Joint]

    @classmethod
    def from_worlds(cls, worlds: Iterable[World]) -> SpawnRecord:
        """That of several worlds."""
        poses: dict[BodyId, Pose] = {}
        constraints: dict[BodyId, Joint] = {}
        for world in worlds:
            poses |= {body.id: body.pose for body in world.bodies}
            constraints |= {joint.id: joint for joint in world.joints}
        return cls(poses, constraints)


class DeleteBodies(msgspec.Struct, frozen=True):
    """Deletes bodies with their constraints and attachments."""

    ids: tuple[BodyId, ...]
    spawn_record: SpawnRecord
    geometry: GeometryMap
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        before, gone = engine.snapshot(), set(self.ids)
        engine.delete(self.ids)
        return UndeleteBodies(before, tuple(sorted(gone)), self.spawn_record, self.geometry, self.label)


class UndeleteBodies(msgspec.Struct, frozen=True):
    """Spawns deleted bodies again, as they were."""

    previous_world: World
    """All that was there."""
    ids: tuple[BodyId, ...]
    """What of it was deleted."""
    spawn_record: SpawnRecord
    geometry: GeometryMap
    label: str

    def apply(self, engine: Engine) -> EditCommand:
        """See `EditCommand`."""
        there = current_poses(engine)
        gone = set(self.ids)
        if taken := gone & there.keys():
            raise BodyExistsError(min(taken))
        links = list(self._removed_links(there))
        shut, open_again = self._spawn_poses(links, there)
        stirred = [id for id in dict.fromkeys(link.child for link in links) if id not in gone]
        try:
            for id in stirred:
                engine.set_pose(id, pose_from_array(shut[id]))
            self._spawn(engine, self._world_fragment(links, shut))
        except WorldError:
            for id in stirred:
                engine.set_pose(id, there[id])
            raise
        for link in links:
            if isinstance(link, Joint) and not _same_pose(shut[link.child], open_again[link.child]):
                with suppress(PoseUnreachableError):  # then it is back at least, if not as far open
                    engine.set_pose(link.child, pose_from_array(open_again[link.child]))
        return DeleteBodies(self.ids, self.spawn_record, self.geometry, self.label)

    def _spawn(self, engine: Engine, world: World) -> None:
        """Spawns all of it or nothing.

        Raises:
            RestoreError: some of it cannot be spawned.
        """
        report = engine.spawn(world, geometry=self.geometry)
        for failure in (*report.failed_bodies, *report.failed_joints, *report.failed_attachments):
            there = set(engine.poses()[0])
            engine.delete([id for id in self.ids if id in there])
            raise RestoreError(failure.id, reason=failure.reason)

    def _removed_links(self, present: Mapping[BodyId, Pose]) -> Iterator[_Link]:
        """What joined the deleted bodies to one another and to those that are still there."""
        gone = set(self.ids)
        links: tuple[_Link, ...] = (*self.previous_world.joints, *self.previous_world.attachments)
        for link in links:
            ends = {link.parent, link.child}
            if ends & gone and ends <= gone | present.keys():
                yield link

    def _spawn_poses(
        self, links: Iterable[_Link], present: Mapping[BodyId, Pose]
    ) -> tuple[Mapping[BodyId, Array], Mapping[BodyId, Array]]:
        """Where all is to be spawned, and where it was in the end, seen from what is still there."""
        was = {body.id: normalized_pose_array(body.pose) for body in self.previous_world.bodies}
        holders = {link.child: link for link in links}
        shut: dict[BodyId, Array] = {}
        open_again: dict[BodyId, Array] = {}

        def place(id: BodyId, above: frozenset[BodyId]) -> None:
            link = holders.get(id)
            if id in shut:
                return
            if link is None or link.parent in above:  # nothing holds it; or a circle of constraints, cut here
                shut[id] = open_again[id] = was[id] if id in self.ids else normalized_pose_array(present[id])
                return
            place(link.parent, above | {id})
            open_again[id] = _moved_with(was[id], was[link.parent], open_again[link.parent])
            given = was
            if isinstance(link, Joint):
                given = {
                    end: normalized_pose_array(self.spawn_record.poses.get(end) or pose_from_array(was[end]))
                    for end in (id, link.parent)
                }
            shut[id] = _moved_with(given[id], given[link.parent], shut[link.parent])

        for id in (*self.ids, *(end for link in links for end in (link.parent, link.child))):
            place(id, frozenset())
        return shut, open_again

    def _world_fragment(self, links: Iterable[_Link], spawn_poses: Mapping[BodyId, Array]) -> World:
        def placed(id: BodyId, pose: Pose) -> Pose:
            return (
                pose if _same_pose(normalized_pose_array(pose), spawn_poses[id]) else pose_from_array(spawn_poses[id])
            )

        def moved(joint: Joint) -> Joint:
            given = self.spawn_record.joints.get(joint.id, joint)
            parent = normalized_pose_array(
                self.spawn_record.poses.get(joint.parent) or pose_from_array(spawn_poses[joint.parent])
            )
            frame = _moved_with(normalized_pose_array(given.pose), parent, spawn_poses[joint.parent])
            return (
                joint
                if _same_pose(frame, normalized_pose_array(joint.pose))
                else msgspec.structs.replace(joint, pose=pose_from_array(frame))
            )

        gone = set(self.ids)
        return World(
            iri=self.previous_world.iri,
            name=self.previous_world.name,
            bodies=tuple(
                msgspec.structs.replace(body, pose=placed(body.id, body.pose))
                for body in self.previous_world.bodies
                if body.id in gone
            ),
            joints=tuple(moved(link) for link in links if isinstance(link, Joint)),
            attachments=tuple(link for link in links if isinstance(link, Attachment)),
        )


def _moved_with(pose: Array, base_then: Array, base_now: Array) -> Array:
    """Where something is that went along with something else."""
    if _same_pose(base_then, base_now):
        return pose  # to the last digit
    return pose_multiply(base_now, pose_multiply(pose_inverse(base_then), pose))


def _same_pose(one: Array, other: Array) -> bool:
    return bool((one == other).all())


_MAX_UNDO = 200
"""So many edits can be taken back."""


class UndoHistory(msgspec.Struct, frozen=True):
    """What can be undone and done again, in a few words each, the next one first."""

    undo: tuple[str, ...] = ()
    redo: tuple[str, ...] = ()


class UndoStack:
    """Changes of a stage's world; calls may come from any thread and wait as the stage's own do."""

    def __init__(self, simulation: EngineSession) -> None:
        self._simulation = simulation
        self._undo_edits: list[EditCommand] = []
        self._redo_edits: list[EditCommand] = []
        self._lock = threading.RLock()

    @property
    def history(self) -> UndoHistory:
        """What can be undone and done again now."""
        with self._lock:
            return UndoHistory(
                tuple(edit.label for edit in self._undo_edits[::-1]),
                tuple(edit.label for edit in self._redo_edits[::-1]),
            )

    # -- edits ---------------------------------------------------------------------------------------------------------

    def move(self, id: BodyId, pose: Pose, *, continues_last: bool = False) -> None:
        """Puts a body somewhere else, at rest, with all that hangs on it.

        Args:
            id: the body.
            pose: where to.
            going_on: whether this goes on with the last edit, as one drag does, and is undone together with it.

        Raises:
            BodyNotFoundError: there is no such body.
            PoseUnreachableError: its constraint does not let it get there.
        """
        self.apply(MoveBody(id, pose, f"place of {id}"), continues_last=continues_last)

    def set_physics(self, id: BodyId, physics: BodyPhysics, *, label: str = "physics") -> None:
        """Changes mobility, gravity, mass, overlap events; `what` says which.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self.apply(SetPhysics(id, physics, f"{label} of {id}"))

    def set_materials(self, id: BodyId, materials: Iterable[Material]) -> None:
        """Changes the surface.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self.apply(SetMaterials(id, tuple(materials), f"material of {id}"))

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """Lets a body hang on another from now on.

        Raises:
            BodyNotFoundError: one of the two is not there.
            AttachmentError: it would close a circle.
        """
        self.apply(AttachBodies(parent, child, f"{child} hangs on {parent}"))

    def detach(self, child: BodyId) -> None:
        """Lets go of a body where it is.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self.apply(DetachBody(child, f"{child} hangs on nothing"))

    def delete(self, ids: Iterable[BodyId]) -> None:
        """Removes bodies, their constraints and attachments.

        Raises:
            BodyNotFoundError: for the first that is not there; nothing is deleted then.
        """
        gone = tuple(dict.fromkeys(ids))
        name = gone[0] if len(gone) == 1 else f"{len(gone)} bodies"
        self.apply(DeleteBodies(gone, self._spawn_record(), self._geometry(gone), f"{name} deleted"))

    def record_spawn(self, ids: Iterable[BodyId]) -> None:
        """Remembers bodies that were just spawned as an edit, so that they can be taken away again."""
        came = tuple(ids)
        name = came[0] if len(came) == 1 else f"{len(came)} bodies"
        self.record(DeleteBodies(came, self._spawn_record(), self._geometry(came), f"{name} added"))

    def reset(self) -> None:
        """Brings back the world as it was spawned; where the engine can save, this can be undone like any edit."""
        if Capability.SAVE not in self._simulation.capabilities:
            self._simulation.reset()
            self.clear()
            return
        before = self._simulation.run_on_engine(lambda engine: engine.save_state(), label="save")
        self._simulation.reset()
        self.record(RestoreState(before, "reset"))

    # -- the way back --------------------------------------------------------------------------------------------------

    def apply(self, edit: EditCommand, *, continues_last: bool = False) -> None:
        """Makes any edit; see `move` for `going_on`."""

        def make(engine: Engine) -> None:
            back = edit.apply(engine)
            last = self._undo_edits[-1] if self._undo_edits else None
            if not (continues_last and last is not None and type(last) is type(back) and last.label == back.label):
                self.record(back)

        self._simulation.run_on_engine(make, label=f"edit: {edit.label}", edits=True)

    def record(self, inverse: EditCommand) -> None:
        """Remembers what takes back something that was done by other ways."""
        with self._lock:
            self._undo_edits.append(inverse)
            del self._undo_edits[:-_MAX_UNDO]
            self._redo_edits.clear()

    def undo(self) -> str:
        """Takes the last edit back, and says which it was.

        Raises:
            NothingToUndoError: none is left.
            WorldError: the world does not allow it any more; that edit is forgotten then.
        """
        return self._undo_redo(self._undo_edits, self._redo_edits, again=False)

    def redo(self) -> str:
        """Makes the last undone edit again, and says which it was.

        Raises:
            NothingToUndoError: none is left.
            WorldError: the world does not allow it any more; that edit is forgotten then.
        """
        return self._undo_redo(self._redo_edits, self._undo_edits, again=True)

    def clear(self) -> None:
        """Forgets all edits: what they were made to is no longer there."""
        with self._lock:
            self._undo_edits.clear()
            self._redo_edits.clear()

    def _undo_redo(self, source: list[EditCommand], target: list[EditCommand], *, again: bool) -> str:
        def turn(engine: Engine) -> str:
            with self._lock:
                if not source:
                    raise NothingToUndoError(redo=again)
                edit = source.pop()
            back = edit.apply(engine)
            with self._lock:
                target.append(back)
            return edit.label

        return self._simulation.run_on_engine(turn, label="redo" if again else "undo", edits=True)

    def _spawn_record(self) -> SpawnRecord:
        return SpawnRecord.from_worlds(self._simulation.worlds)

    def _geometry(self, ids: Iterable[BodyId]) -> GeometryMap:
        there = self._simulation.geometry
        return {id: there[id] for id in ids if id in there}
