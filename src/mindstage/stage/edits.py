"""Edits: what a person changes in a running world, each of which knows what undoes it.

An edit goes through the engine's contract alone. Applied, it gives the edit that takes it back, made from the world as
it was just before; applied in turn, that one gives the edit that does it again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import msgspec

from mindstage.engines.contract import Engine, SavedState
from mindstage.errors import BodyNotFoundError
from mindstage.world import BodyId, BodyPhysics, Material, Pose
from mindstage.world.geometry import normalized_pose_array, pose_from_array, pose_inverse, pose_multiply

__all__ = [
    "AttachAt",
    "AttachBodies",
    "DetachBody",
    "EditCommand",
    "MoveBody",
    "RestoreState",
    "SetMaterials",
    "SetPhysics",
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
