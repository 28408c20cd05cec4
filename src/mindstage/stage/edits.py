"""Edits: what a person changes in a running world, each of which knows what undoes it.

An edit goes through the engine's contract alone. Applied, it gives the edit that takes it back, made from the world as
it was just before; applied in turn, that one gives the edit that does it again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import msgspec

from mindstage.engines.contract import Engine, State
from mindstage.errors import BodyUnknown
from mindstage.world import BodyId, Material, Physics, Pose
from mindstage.world.geometry import compose, invert, pose_from, unit_pose

__all__ = ["Attach", "Detach", "Dress", "Edit", "Hang", "Move", "Reform", "Return"]


class Edit(Protocol):
    """One change; the world is as before if it raises."""

    @property
    def what(self) -> str:
        """It in a few words, such as "mass of Mug"."""

    def apply(self, engine: Engine) -> Edit:
        """Does it, in the thread that owns the engine, and gives what takes it back.

        Raises:
            WorldError: the world does not allow it.
        """


class Move(msgspec.Struct, frozen=True):
    """Puts a body somewhere else, with all that hangs on it."""

    id: BodyId
    pose: Pose
    what: str

    def apply(self, engine: Engine) -> Move:
        """See `Edit`."""
        before = pose_of(engine, self.id)
        engine.set_pose(self.id, self.pose)
        return Move(self.id, before, self.what)


class Reform(msgspec.Struct, frozen=True):
    """Changes mobility, gravity or mass."""

    id: BodyId
    physics: Physics
    what: str

    def apply(self, engine: Engine) -> Reform:
        """See `Edit`."""
        before = engine.log().body(self.id).physics
        engine.set_physics(self.id, self.physics)
        return Reform(self.id, before, self.what)


class Dress(msgspec.Struct, frozen=True):
    """Changes the surface."""

    id: BodyId
    materials: tuple[Material, ...]
    what: str

    def apply(self, engine: Engine) -> Dress:
        """See `Edit`."""
        before = engine.log().body(self.id).materials
        engine.set_materials(self.id, self.materials)
        return Dress(self.id, before, self.what)


class Attach(msgspec.Struct, frozen=True):
    """Lets a body hang on another from now on, where both are."""

    parent: BodyId
    child: BodyId
    what: str

    def apply(self, engine: Engine) -> Edit:
        """See `Edit`."""
        before = holder_of(engine, self.child)
        back = Detach(self.child, self.what) if before is None else _hanging(engine, before, self.child, self.what)
        engine.attach(self.parent, self.child)
        return back


class Detach(msgspec.Struct, frozen=True):
    """Lets go of a body where it is."""

    child: BodyId
    what: str

    def apply(self, engine: Engine) -> Edit:
        """See `Edit`."""
        before = holder_of(engine, self.child)
        back = Detach(self.child, self.what) if before is None else _hanging(engine, before, self.child, self.what)
        engine.detach(self.child)
        return back


class Hang(msgspec.Struct, frozen=True):
    """Hangs a body where it hung before, although it may have fallen since."""

    parent: BodyId
    child: BodyId
    parent_from_child: Pose
    what: str

    def apply(self, engine: Engine) -> Edit:
        """See `Edit`."""
        holder, place = holder_of(engine, self.child), pose_of(engine, self.child)
        parent = unit_pose(pose_of(engine, self.parent))
        engine.set_pose(self.child, pose_from(compose(parent, unit_pose(self.parent_from_child))))
        try:
            engine.attach(self.parent, self.child)
        except Exception:
            engine.set_pose(self.child, place)
            raise
        if holder is None:
            return Detach(self.child, self.what)
        return Hang(holder, self.child, self.parent_from_child, self.what)


class Return(msgspec.Struct, frozen=True):
    """Brings back a saved state of everything."""

    state: State
    what: str

    def apply(self, engine: Engine) -> Return:
        """See `Edit`."""
        before = engine.save()
        engine.restore(self.state)
        return Return(before, self.what)


def pose_of(engine: Engine, id: BodyId) -> Pose:
    """Where a body is now.

    Raises:
        BodyUnknown: there is none of that id.
    """
    return poses_of(engine)[id] if id in engine.poses()[0] else _unknown(engine, id)


def poses_of(engine: Engine) -> Mapping[BodyId, Pose]:
    """Where all bodies are now; what nobody moved is exactly where it was described."""
    return {body.id: body.pose for body in engine.log().bodies}


def holder_of(engine: Engine, id: BodyId) -> BodyId | None:
    """What a body hangs on."""
    return next((hold.parent for hold in engine.log().attachments if hold.child == id), None)


def _hanging(engine: Engine, parent: BodyId, child: BodyId, what: str) -> Hang:
    poses = poses_of(engine)
    relative = compose(invert(unit_pose(poses[parent])), unit_pose(poses[child]))
    return Hang(parent, child, pose_from(relative), what)


def _unknown(engine: Engine, id: BodyId) -> Pose:
    raise BodyUnknown(id, known=engine.poses()[0])
