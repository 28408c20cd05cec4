"""Editing: what people change in a running world, with a way back.

One history for all: whoever undoes takes back what was edited last, by whomever. What the physics does is no edit, and
an undone edit changes what it changed and nothing else: the world does not go back in time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import TYPE_CHECKING

import msgspec

from mindstage.engines.contract import Capability, Engine
from mindstage.errors import NothingToUndoError
from mindstage.stage.edits import (
    AttachBodies,
    DetachBody,
    EditCommand,
    MoveBody,
    RestoreState,
    SetMaterials,
    SetPhysics,
)
from mindstage.stage.removal import DeleteBodies, SpawnRecord
from mindstage.world import BodyId, BodyPhysics, GeometryMap, Material, Pose

if TYPE_CHECKING:
    from mindstage.stage.stage import Simulation

__all__ = ["UndoHistory", "UndoStack"]

_MAX_UNDO = 200
"""So many edits can be taken back."""


class UndoHistory(msgspec.Struct, frozen=True):
    """What can be undone and done again, in a few words each, the next one first."""

    undo: tuple[str, ...] = ()
    redo: tuple[str, ...] = ()


class UndoStack:
    """Changes of a stage's world; calls may come from any thread and wait as the stage's own do."""

    def __init__(self, simulation: Simulation) -> None:
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
