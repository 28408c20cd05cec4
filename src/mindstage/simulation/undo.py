"""Undo and redo of the edits of a running simulation.

There is one history for all clients. Motion by physics is not an edit. An edit after which nothing else has happened is
undone exactly, with velocities and sleep, by the saved state of the engine; otherwise its inverse reverts only what it
has changed, wherever that is now.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import msgspec

from mindstage.access.limits import Timeout
from mindstage.engines.base import Applied, Capability, Engine, SavedState
from mindstage.engines.editing import is_moved
from mindstage.errors import (
    EngineError,
    HistoryChangedError,
    InvalidArgumentError,
    NothingToUndoError,
    SimulationError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.ranges import Index, checked
from mindstage.scene import BodyId, BodyPhysics, Material, Pose, PoseLike, World, as_pose
from mindstage.scene.edits import (
    Attach,
    Delete,
    Detach,
    Edit,
    SetLabel,
    SetMaterials,
    SetPhysics,
    SetPoses,
    counted_ids,
)
from mindstage.simulation.body_groups import find_dependents
from mindstage.simulation.replacing import KeptWorld, ReplaceWorld, edit_timeout_s
from mindstage.simulation.state import EngineSession

__all__ = ["Edits", "StartState", "UndoHistory"]

_MOVED_M, _TURNED_RAD = 0.001, 0.009
"""A body that moved and turned by less counts as not moved."""
_MAX_UNDO = 200
"""Length of the undo history."""
_MAX_EXACT = 20
"""The last edits that can be undone exactly; each keeps a state of the engine."""

_MAX_REPLACED = 3
"""The last replacements of all worlds that can be undone; each keeps a knowledge base and a state of the engine."""


@dataclass(slots=True)
class _Step:
    """An edit that can be undone or redone."""

    label: str
    edit: Edit | None
    """What was done; None for what only a state reverts, such as the motions of a robot."""
    inverse: Edit | None
    """What is to be done; None to restore the state."""
    state: SavedState | None = None
    """The state before; None if it is not known any more."""
    key: object = None
    """`Engine.state_key` of the state after."""

    @property
    def replaced(self) -> KeptWorld | None:
        """What is restored, if all worlds were replaced."""
        return self.inverse.world if isinstance(self.inverse, ReplaceWorld) else None


class UndoHistory(msgspec.Struct, frozen=True):
    """Labels of the edits that can be undone and redone, the next one first."""

    undo: tuple[str, ...] = ()
    redo: tuple[str, ...] = ()


class Edits:
    """Applies edits to a simulation, and undoes and redoes them; may be called from any thread."""

    def __init__(self, simulation: EngineSession) -> None:
        self._simulation = simulation
        self._done: list[_Step] = []
        self._undone: list[_Step] = []
        self._version = 0
        self._end = ""
        """Why the history does not begin earlier."""
        self._lock = threading.RLock()

    @property
    def history(self) -> UndoHistory:
        """The current undo and redo history."""
        with self._lock:
            return UndoHistory(
                tuple(step.label for step in self._done[::-1]), tuple(step.label for step in self._undone[::-1])
            )

    @property
    def knowledge_bases(self) -> tuple[KnowledgeBase, ...]:
        """Those that undo or redo can bring back, which must stay open; see `Simulation.replace_world`."""
        with self._lock:
            steps = (*self._done, *self._undone)
        return tuple(world.knowledge for step in steps if (world := step.replaced) is not None)

    # -- edits ---------------------------------------------------------------------------------------------------------

    @checked
    def apply(self, edit: Edit, *, continues_last: bool = False, timeout_s: Timeout | None = None) -> Applied:
        """Makes an edit as a step of the history; see `Simulation.apply`.

        Args:
            edit: the edit.
            continues_last: whether to merge with the last step of the same label, as during a drag, so that both are
                undone together.
            timeout_s: by default that of the simulation, plus 50 ms for each body and joint that is added [s].
        """

        def apply(engine: Engine) -> Applied:
            last = self._done[-1] if self._done else None
            continues = continues_last and last is not None and last.label == edit.label and last.edit is not None
            state = None if continues else _saved(engine, edit)
            applied = self._simulation.apply(edit, engine=engine)
            if continues and last is not None:
                last.edit, last.key = edit, engine.state_key
            else:
                self._record(_Step(edit.label, edit, applied.inverse, state, engine.state_key))
            return applied

        label = f"edit: {edit.label}"
        limit_s = edit_timeout_s(edit, self._simulation.timeout_s) if timeout_s is None else timeout_s
        return self._simulation.engine.run(apply, label=label, timeout_s=limit_s, edits=True)

    def move(self, id: BodyId, pose: PoseLike, *, continues_last: bool = False) -> None:
        """Sets the pose of a body, at rest; attached bodies move with it.

        Args:
            id: the body.
            pose: its new pose in the world frame.
            continues_last: see `apply`.

        Raises:
            BodyNotFoundError: no body has that id.
            PoseUnreachableError: a joint does not allow the pose.
        """
        self.apply(SetPoses({id: as_pose(pose)}), continues_last=continues_last)

    def move_all(self, poses: Mapping[BodyId, PoseLike], *, label: str = "", continues_last: bool = False) -> None:
        """Sets the poses of several bodies as one edit; bodies that are attached to others of them move with those.

        Args:
            poses: the new poses in the world frame, by body.
            label: the name of the edit.
            continues_last: see `apply`.

        Raises:
            BodyNotFoundError: one of the bodies does not exist; nothing is moved then.
            PoseUnreachableError: a joint does not allow a pose; nothing is moved then.
        """
        self.apply(
            SetPoses({id: as_pose(each) for id, each in poses.items()}, title=label), continues_last=continues_last
        )

    def set_physics(self, id: BodyId, physics: BodyPhysics, *, label: str = "physics") -> None:
        """Sets mobility, gravity, mass and overlap events; `label` names what changes.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(SetPhysics(id, physics, title=f"{label} of {id}"))

    def set_materials(self, id: BodyId, materials: Iterable[Material]) -> None:
        """Sets the materials of a body.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(SetMaterials(id, tuple(materials)))

    def set_label(self, id: BodyId, label: str) -> None:
        """Sets the label of a body, which people see instead of its id; an empty one removes it. The id stays.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(SetLabel(id, label.strip()))

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """Attaches a body to another at its current relative pose.

        Raises:
            BodyNotFoundError: one of the two does not exist.
            AttachmentError: the attachment would be cyclic.
        """
        self.apply(Attach(parent, child))

    def detach(self, child: BodyId) -> None:
        """Detaches a body from its parent.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        self.apply(Detach(child))

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
        more = f" with {len(deleted) - len(chosen)} more" if len(deleted) > len(chosen) else ""
        title = f"{counted_ids(chosen)}{more} deleted"
        self.apply(Delete(deleted, title=title))
        return deleted

    def record(self, inverse: Edit) -> None:
        """Records the inverse of what was done elsewhere, with its label."""
        self._record(_Step(inverse.label, None, inverse))

    def _record(self, step: _Step) -> None:
        with self._lock:
            self._version += 1
            self._done.append(step)
            del self._done[:-_MAX_UNDO]
            self._forget_worlds()
            _forget_states(self._done)
            self._undone.clear()

    def _forget_worlds(self) -> None:
        """Removes the steps up to the last replacement of all worlds that cannot be undone."""
        replaced = [(index, step.replaced) for index, step in enumerate(self._done) if step.replaced is not None]
        too_old = [index for index, _ in replaced[:-_MAX_REPLACED]]
        not_saved = [index for index, world in replaced if world.state is None]
        if too_old:
            self._end = f"only the last {_MAX_REPLACED} replacements of the world can be undone, such as loaded maps"
        if not_saved:
            self._end = "the world was replaced, and the engine cannot save its state"
        if forgotten := (*too_old, *not_saved):
            del self._done[: max(forgotten) + 1]

    def record_motion(self, before: Mapping[BodyId, Pose], *, label: str) -> bool:
        """Records what has moved since some poses as one edit, such as a drag by hand; False if nothing has.

        Args:
            before: the poses that undoing restores; of bodies that are attached to others, those are enough.
            label: the name of the edit.
        """

        def record(engine: Engine) -> bool:
            world = engine.snapshot()
            now = {body.id: body.pose for body in world.bodies}
            parents = {each.child: each.parent for each in world.attachments}
            moved = {id for id, pose in before.items() if id in now and _has_moved(pose, now[id])}
            poses = {id: before[id] for id in moved if parents.get(id) not in moved}
            if poses:
                self.record(SetPoses(poses, {}, title=label))
            return bool(poses)

        return self._simulation.engine.run(record, label=label)

    @contextmanager
    def one_step(self, label: str) -> Iterator[None]:
        """Makes all that happens in the context one edit, such as what a robot does; nothing if nothing has changed.

        Undoing it restores the state of the engine before, its clock included. An engine that cannot save its state
        only moves the bodies back.

        Args:
            label: the name of the edit.
        """
        with self._lock:
            earlier = list(self._done)
        can_save = Capability.SAVE in self._simulation.engine.capabilities

        def look(engine: Engine) -> tuple[SavedState | None, World]:
            return engine.save_state() if can_save else None, engine.snapshot()

        state, before = self._simulation.engine.run(look, label="save")
        try:
            yield
        finally:
            with suppress(EngineError, SimulationError):  # it was closed, or its engine lost
                if not _is_unchanged(before, self._simulation.snapshot()):
                    with self._lock:
                        self._done[:] = [step for step in self._done if any(step is each for each in earlier)]
                    if state is not None:
                        self._record(_Step(label, None, None, state))
                    else:
                        self.record_motion({body.id: body.pose for body in before.bodies}, label=label)

    def reset(self) -> None:
        """Resets the simulation; can be undone if the engine can save its state, otherwise clears the history."""
        if Capability.SAVE not in self._simulation.engine.capabilities:
            self._simulation.reset()
            self.clear()
            return
        before = self._simulation.engine.run(lambda engine: engine.save_state(), label="save")
        self._simulation.reset()
        self._record(_Step("reset", None, None, before))

    # -- undo and redo -------------------------------------------------------------------------------------------------

    def undo(self) -> str:
        """Undoes the last edit and returns its label.

        Raises:
            NothingToUndoError: the history is empty.
            WorldError: the world no longer allows it; the edit is then removed from the history.
        """
        return self._undo_redo(self._done, self._undone, redo=False)

    def redo(self) -> str:
        """Redoes the last undone edit and returns its label.

        Raises:
            NothingToUndoError: no undone edit is left.
            WorldError: the world no longer allows it; the edit is then removed from the history.
        """
        return self._undo_redo(self._undone, self._done, redo=True)

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
                done, count = len(self._done), len(self._done) + len(self._undone)
                if version is not None and version != self._version:
                    raise HistoryChangedError
            if not 0 <= position <= count:
                raise InvalidArgumentError(str(position), cause=f"the history has {count} steps")
            for _ in range(abs(position - done)):
                if position < done:
                    self._step(engine, self._done, self._undone)
                else:
                    self._step(engine, self._undone, self._done)

        self._simulation.engine.run(go, label="go to a step of the history", edits=True)

    @property
    def version(self) -> int:
        """A number that changes whenever the history does."""
        return self._version

    def clear(self) -> None:
        """Removes all edits from the history."""
        with self._lock:
            self._version += 1
            self._end = ""
            self._done.clear()
            self._undone.clear()

    def _undo_redo(self, source: list[_Step], target: list[_Step], *, redo: bool) -> str:
        def undo_redo(engine: Engine) -> str:
            if not source:
                raise NothingToUndoError(redo=redo, reason="" if redo else self._end)
            return self._step(engine, source, target)

        return self._simulation.engine.run(undo_redo, label="redo" if redo else "undo", edits=True)

    def _step(self, engine: Engine, source: list[_Step], target: list[_Step]) -> str:
        """Reverts the last step of a list and appends what reverts that to the other; in the engine thread."""
        with self._lock:
            step = source.pop()
            self._version += 1
        if step.inverse is None:
            assert step.state is not None
            reverted = _Step(step.label, None, None, engine.save_state())
            engine.restore_state(step.state)
        else:
            state = _saved(engine, step.inverse)
            is_exact = step.state is not None and engine.state_key is step.key
            applied = self._simulation.apply(step.inverse, engine=engine, leads_to=step.state if is_exact else None)
            inverse = step.edit if is_exact else applied.inverse
            reverted = _Step(step.label, step.inverse, inverse, state, engine.state_key)
        with self._lock:
            target.append(reverted)
            _forget_states(target)
        return step.label


def _saved(engine: Engine, edit: Edit) -> SavedState | None:
    """The state of an engine that can tell when it is in that state again; a world that is replaced has its own."""
    return None if engine.state_key is None or isinstance(edit, ReplaceWorld) else engine.save_state()


def _forget_states(steps: list[_Step]) -> None:
    for step in steps[:-_MAX_EXACT]:
        if step.inverse is not None:
            step.state = None


def _has_moved(before: Pose, now: Pose) -> bool:
    """Whether poses differ visibly."""
    return is_moved(before, now, tolerance_m=_MOVED_M, tolerance_rad=_TURNED_RAD)


def _is_unchanged(before: World, now: World) -> bool:
    """Whether two worlds have the same bodies and attachments, and no body has moved."""
    poses = {body.id: body.pose for body in before.bodies}
    if poses.keys() != {body.id for body in now.bodies} or set(before.attachments) != set(now.attachments):
        return False
    return not any(_has_moved(poses[body.id], body.pose) for body in now.bodies)


class StartState(msgspec.Struct, frozen=True, eq=False):
    """What `Simulation.reset` restores."""

    worlds: tuple[World, ...] = ()
    temporary_worlds: tuple[World, ...] = ()
    report_count: int = 0
    state: SavedState | None = None
    """None if the engine cannot save its state; the worlds are then spawned again."""
