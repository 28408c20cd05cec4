"""Editing: what people change in a running world, with a way back.

One history for all: whoever undoes takes back what was edited last, by whomever. What the physics does is no edit, and
an undone edit changes what it changed and nothing else: the world does not go back in time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import TYPE_CHECKING

import msgspec

from mindstage.engines.contract import Ability, Engine
from mindstage.errors import NothingToUndo
from mindstage.stage.edits import Attach, Detach, Dress, Edit, Move, Reform, Return
from mindstage.stage.removal import Remove, Spawned
from mindstage.world import BodyId, Forms, Material, Physics, Pose

if TYPE_CHECKING:
    from mindstage.stage.stage import Stage

__all__ = ["Editing", "History"]

_MOST = 200
"""So many edits can be taken back."""


class History(msgspec.Struct, frozen=True):
    """What can be undone and done again, in a few words each, the next one first."""

    undo: tuple[str, ...] = ()
    redo: tuple[str, ...] = ()


class Editing:
    """Changes of a stage's world; calls may come from any thread and wait as the stage's own do."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._done: list[Edit] = []
        self._undone: list[Edit] = []
        self._lock = threading.RLock()

    @property
    def history(self) -> History:
        """What can be undone and done again now."""
        with self._lock:
            return History(
                tuple(edit.what for edit in self._done[::-1]), tuple(edit.what for edit in self._undone[::-1])
            )

    # -- edits ---------------------------------------------------------------------------------------------------------

    def move(self, id: BodyId, pose: Pose, *, going_on: bool = False) -> None:
        """Puts a body somewhere else, at rest, with all that hangs on it.

        Args:
            id: the body.
            pose: where to.
            going_on: whether this goes on with the last edit, as one drag does, and is undone together with it.

        Raises:
            BodyUnknown: there is no such body.
            PoseUnreachable: its constraint does not let it get there.
        """
        self.apply(Move(id, pose, f"place of {id}"), going_on=going_on)

    def set_physics(self, id: BodyId, physics: Physics, *, what: str = "physics") -> None:
        """Changes mobility, gravity, mass, overlap events; `what` says which.

        Raises:
            BodyUnknown: there is no such body.
        """
        self.apply(Reform(id, physics, f"{what} of {id}"))

    def set_materials(self, id: BodyId, materials: Iterable[Material]) -> None:
        """Changes the surface.

        Raises:
            BodyUnknown: there is no such body.
        """
        self.apply(Dress(id, tuple(materials), f"material of {id}"))

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """Lets a body hang on another from now on.

        Raises:
            BodyUnknown: one of the two is not there.
            AttachmentRefused: it would close a circle.
        """
        self.apply(Attach(parent, child, f"{child} hangs on {parent}"))

    def detach(self, child: BodyId) -> None:
        """Lets go of a body where it is.

        Raises:
            BodyUnknown: there is no such body.
        """
        self.apply(Detach(child, f"{child} hangs on nothing"))

    def delete(self, ids: Iterable[BodyId]) -> None:
        """Removes bodies, their constraints and attachments.

        Raises:
            BodyUnknown: for the first that is not there; nothing is deleted then.
        """
        gone = tuple(dict.fromkeys(ids))
        name = gone[0] if len(gone) == 1 else f"{len(gone)} bodies"
        self.apply(Remove(gone, self._spawned(), self._forms(gone), f"{name} deleted"))

    def added(self, ids: Iterable[BodyId]) -> None:
        """Remembers bodies that were just spawned as an edit, so that they can be taken away again."""
        came = tuple(ids)
        name = came[0] if len(came) == 1 else f"{len(came)} bodies"
        self.record(Remove(came, self._spawned(), self._forms(came), f"{name} added"))

    def reset(self) -> None:
        """Brings back the world as it was spawned; where the engine can save, this can be undone like any edit."""
        if Ability.SAVE not in self._stage.abilities:
            self._stage.reset()
            self.forget()
            return
        before = self._stage.call(lambda engine: engine.save(), what="save")
        self._stage.reset()
        self.record(Return(before, "reset"))

    # -- the way back --------------------------------------------------------------------------------------------------

    def apply(self, edit: Edit, *, going_on: bool = False) -> None:
        """Makes any edit; see `move` for `going_on`."""

        def make(engine: Engine) -> None:
            back = edit.apply(engine)
            last = self._done[-1] if self._done else None
            if not (going_on and last is not None and type(last) is type(back) and last.what == back.what):
                self.record(back)

        self._stage.call(make, what=f"edit: {edit.what}", edits=True)

    def record(self, back: Edit) -> None:
        """Remembers what takes back something that was done by other ways."""
        with self._lock:
            self._done.append(back)
            del self._done[:-_MOST]
            self._undone.clear()

    def undo(self) -> str:
        """Takes the last edit back, and says which it was.

        Raises:
            NothingToUndo: none is left.
            WorldError: the world does not allow it any more; that edit is forgotten then.
        """
        return self._turn(self._done, self._undone, again=False)

    def redo(self) -> str:
        """Makes the last undone edit again, and says which it was.

        Raises:
            NothingToUndo: none is left.
            WorldError: the world does not allow it any more; that edit is forgotten then.
        """
        return self._turn(self._undone, self._done, again=True)

    def forget(self) -> None:
        """Forgets all edits: what they were made to is no longer there."""
        with self._lock:
            self._done.clear()
            self._undone.clear()

    def _turn(self, taken: list[Edit], given: list[Edit], *, again: bool) -> str:
        def turn(engine: Engine) -> str:
            with self._lock:
                if not taken:
                    raise NothingToUndo(again=again)
                edit = taken.pop()
            back = edit.apply(engine)
            with self._lock:
                given.append(back)
            return edit.what

        return self._stage.call(turn, what="redo" if again else "undo", edits=True)

    def _spawned(self) -> Spawned:
        return Spawned.of(self._stage.worlds)

    def _forms(self, ids: Iterable[BodyId]) -> Forms:
        there = self._stage.forms
        return {id: there[id] for id in ids if id in there}
