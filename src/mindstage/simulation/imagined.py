"""Copies of a running simulation: the record of their edits, and their images for other processes.

A copy has the engine state of its original, sleeping bodies and velocities included, if the engine can be forked.
Otherwise it is simulated by MuJoCo, from a snapshot.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, cast

import msgspec
import numpy as np

from mindstage.engines import NullEngine, make_engine
from mindstage.engines.base import Applied, AssumingEngine, Capability, DynamicsScale, Engine, PoseArray, SavedState
from mindstage.errors import CommitError, WorldError
from mindstage.scene import Body, BodyId, World
from mindstage.scene.edits import Attach, Detach, Edit, SetLabel, SetMaterials, SetPhysics, SetPoses, Spawn
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array
from mindstage.simulation.interaction import JointHandle, SpawnRecord
from mindstage.simulation.joint_motion import find_joint
from mindstage.simulation.replacing import primitives
from mindstage.simulation.state import EngineSession

__all__ = [
    "ClearWorld",
    "EditRecordingEngine",
    "ForkOrigin",
    "MoveJoint",
    "commit_edits",
    "copied_engine",
    "make_edit",
    "match_world",
    "without_bodies",
    "world_with_bodies",
]

_MAX_BEYOND_LIMIT = 0.05
"""Joint limits are soft in simulations: a joint is so far beyond its limit at most [m or rad]."""
_POSE_TOLERANCE = 1e-6
"""A body of the original that differs by more has moved meanwhile [m, and parts of a unit quaternion]."""


@dataclass(frozen=True, slots=True, eq=False)
class ForkOrigin:
    """The simulation that another one was copied from, and its state then."""

    original: EngineSession
    revision: int
    ids: tuple[BodyId, ...]
    poses: PoseArray
    notes: tuple[str, ...] = ()
    """What the copy does not have in common with its original, one sentence each."""

    def change(self) -> str:
        """What has changed in the original since then, in words; empty if nothing has."""
        state = self.original.state
        if self.original.closed:
            return "it is closed"
        if state.ids != self.ids:
            names = sorted(set(state.ids) ^ set(self.ids))
            return f"bodies were added or removed meanwhile: {', '.join(names[:3])}"
        moved = np.abs(state.poses - self.poses).max(axis=1, initial=0.0) > _POSE_TOLERANCE
        if moved.any():
            return f"{self.ids[int(np.argmax(moved))]!r} has moved meanwhile"
        if state.revision != self.revision:
            return "it was edited meanwhile"
        return ""


class MoveJoint(Edit, frozen=True):
    """Moves a joint by its drive or by pulling, while time passes; engines do not make it."""

    joint: BodyId
    position: float
    """[m or rad]."""

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or f"move joint {self.joint} to {self.position:.4g}"


class ClearWorld(Edit, frozen=True):
    """Removes everything; `Engine.clear` makes it."""


class EditRecordingEngine:
    """Passes all calls on to an engine, and lists the edits, so that they can be made in another simulation."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._edits: tuple[Edit, ...] = ()
        self._ends: tuple[Mapping[BodyId, Array], ...] = ()
        self._is_scaled = False
        self._was_restored = False

    @property
    def edits(self) -> tuple[Edit, ...]:
        """The edits since the engine was copied."""
        return self._edits

    @property
    def ends(self) -> tuple[Mapping[BodyId, Array], ...]:
        """Of each edit, the poses right after it of the bodies that it is about, if where they are is a part of it."""
        return self._ends

    @property
    def is_scaled(self) -> bool:
        """Whether masses or frictions were scaled, which is no edit."""
        return self._is_scaled

    @property
    def engine(self) -> Engine:
        """The engine."""
        return self._engine

    def as_engine(self) -> Engine:
        """This object, which passes on what it does not define."""
        return cast("Engine", self)

    @staticmethod
    def own_state(state: SavedState) -> SavedState:
        """The engine's own state in one that was saved here, or in another record."""
        return state.state if isinstance(state, _RecordedState) else state

    @property
    def was_restored(self) -> bool:
        """Whether a state was restored that is older than the copy, as `reset` does."""
        return self._was_restored

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)

    def apply(self, edit: Edit) -> Applied:
        """See `Engine`; the same holds for the methods below."""
        applied = self._engine.apply(edit)
        self._record(edit, _poses_about(edit, self._engine))
        return applied

    def clear(self) -> None:
        self._engine.clear()
        self._record(ClearWorld(), {})

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        self._engine.scale_dynamics(scales)
        self._is_scaled = True

    def _record(self, edit: Edit, end: Mapping[BodyId, Array]) -> None:
        self._edits += (edit,)
        self._ends += (end,)

    def save_state(self) -> SavedState:
        state = self._engine.save_state()
        return SavedState(_RecordedState(state, self._edits, self._ends, self._is_scaled, self._was_restored))

    def restore_state(self, state: SavedState) -> None:
        if isinstance(state, _RecordedState):
            self._engine.restore_state(state.state)
            self._edits, self._ends = state.edits, state.ends
            self._is_scaled, self._was_restored = state.is_scaled, state.was_restored
        else:
            self._engine.restore_state(state)
            self._edits, self._ends, self._is_scaled, self._was_restored = (), (), False, True

    def add_joint_motion(self, id: BodyId, position: float) -> None:
        """Records that a joint was moved to a position [m or rad] by its drive or by pulling."""
        self._record(MoveJoint(id, position), {})


@dataclass(frozen=True, slots=True, eq=False)
class _RecordedState:
    state: SavedState
    edits: tuple[Edit, ...] = field(repr=False)
    ends: tuple[Mapping[BodyId, Array], ...] = field(repr=False)
    is_scaled: bool
    was_restored: bool


def _poses_about(edit: Edit, engine: Engine) -> Mapping[BodyId, Array]:
    """The poses of what an edit places, attaches or detaches; other edits are the same wherever their bodies are."""
    if not any(isinstance(each, Spawn | SetPoses | Attach | Detach) for each in primitives(edit)):
        return {}
    ids, poses = engine.poses()
    rows = {id: row for row, id in enumerate(ids)}
    return {id: poses[rows[id]] for id in edit.ids if id in rows}


def world_with_bodies(world: World, ids: Container[BodyId], others: Container[BodyId]) -> World:
    """The part of a world with only these bodies, and what connects them with one another and with others."""

    def exists(id: BodyId) -> bool:
        return id in ids or id in others

    return msgspec.structs.replace(
        world,
        bodies=tuple(body for body in world.bodies if body.id in ids),
        joints=tuple(each for each in world.joints if exists(each.parent) and exists(each.child)),
        attachments=tuple(each for each in world.attachments if exists(each.parent) and exists(each.child)),
    )


def without_bodies(world: World, ids: Collection[BodyId]) -> World:
    """The part of a world without these bodies."""
    return world_with_bodies(world, {body.id for body in world.bodies}.difference(ids), ()) if ids else world


def commit_edits(
    engine: Engine, origin: ForkOrigin | None, joints: Mapping[BodyId, Sequence[float]]
) -> tuple[str, ...]:
    """Makes the edits of a copy in its original, all or none; see `Simulation.commit`.

    Joints that were pulled before an edit is refused stay there if the engine cannot save states; the error lists them.

    Args:
        engine: the engine of the copy.
        origin: the original.
        joints: the positions of the joints in the copy [m or rad].
    """
    if origin is None or not isinstance(engine, EditRecordingEngine):
        raise CommitError(reason="this simulation is not a copy; use `with sim.fork() as copy`")
    if engine.was_restored:
        raise CommitError(reason="the copy was reset to a state before it was made; call `reset` of the original")
    if engine.is_scaled:
        raise CommitError(reason="masses or frictions were scaled in the copy, as for a sample, which is no edit")
    if change := origin.change():
        raise CommitError(reason=f"{change}; make another copy")
    original, can_save = origin.original, Capability.SAVE in origin.original.engine.capabilities
    before = original.engine.run(lambda engine: engine.save_state() if can_save else None, label="save")
    done: list[Applied] = []
    lasting: list[str] = []
    try:
        for edit, end in zip(engine.edits, engine.ends, strict=True):
            if before is None and isinstance(edit, MoveJoint | ClearWorld):  # these have no inverse
                lasting.append(edit.label)
            try:
                done += make_edit(original, edit)
            except WorldError as error:
                raise CommitError(reason=f"{edit.label}: {error}") from error
            _check_end(original, edit, end)
        _check_joints(original, engine.edits, joints)
    except CommitError as error:
        for applied in reversed(done):
            original.apply(applied.inverse)
        if before is not None:
            original.engine.run(lambda engine: engine.restore_state(before), label="restore", edits=True)
        what = f"what cannot be undone was: {', '.join(lasting)}" if lasting else "nothing was done"
        raise CommitError(reason=f"{error.reason} ({what})") from error
    return tuple(edit.label for edit in engine.edits)


_MAX_DIFFERENCE = 1e-3
"""A body that differs by more is elsewhere than it was in the copy [m, and parts of a unit quaternion]."""
_MAX_JOINT_DIFFERENCE = 0.02
"""The same for joints that are pulled again [m or rad]."""


def _check_end(original: EngineSession, edit: Edit, end: Mapping[BodyId, Array]) -> None:
    """Checks that an edit has placed, attached or detached bodies where it did in the copy.

    Raises:
        CommitError: time that passed in the copy has moved them, or other things.
    """
    ids, poses = original.engine.run(lambda engine: engine.poses()) if end else ((), np.empty((0, 7)))
    rows = {id: row for row, id in enumerate(ids)}
    for id, pose in end.items():
        if id not in rows or np.abs(poses[rows[id]] - pose).max() > _MAX_DIFFERENCE:
            where = "does not exist" if id not in rows else "is not where it was in the copy"
            raise CommitError(reason=f"{edit.label}: {id!r} {where}, since time that passed there is not repeated")


def _check_joints(original: EngineSession, edits: Iterable[Edit], joints: Mapping[BodyId, Sequence[float]]) -> None:
    """Checks that joints that were pulled again are where they are in the copy.

    Raises:
        CommitError: one is not.
    """
    moved = {each.joint: each for each in edits if isinstance(each, MoveJoint)}
    now = original.engine.run(lambda engine: engine.joint_positions()) if moved else {}
    for id in moved.keys() & now.keys() & joints.keys():
        difference = float(np.abs(np.subtract(now[id], joints[id])).max())
        if difference > _MAX_JOINT_DIFFERENCE:
            reason = f"{moved[id].label}: it comes to another position than in the copy, by {difference:.3f} m or rad"
            raise CommitError(reason=reason)


def make_edit(session: EngineSession, edit: Edit) -> tuple[Applied, ...]:
    """Makes an edit of a copy, or of a recording, in a simulation; a joint is moved there by pulling again.

    Returns:
        What was applied; nothing for a pull, and for the removal of everything.
    """
    if isinstance(edit, MoveJoint):
        find_joint(session, edit.joint).move_to(edit.position)
    elif isinstance(edit, ClearWorld):
        session.engine.run(lambda engine: engine.clear(), label="clear", edits=True)
    else:
        return (session.apply(edit),)
    return ()


def copied_engine(
    engine: Engine,
    *,
    worlds: Iterable[World],
    spawn: Callable[[World], Spawn],
    physics: bool = False,
) -> tuple[Engine, tuple[str, ...]]:
    """An engine in the state of another one, and notes on what it does not have in common with it.

    Args:
        engine: the engine, called in the thread that owns it.
        worlds: the worlds that were spawned in it.
        spawn: the edit that spawned a world, or a part of one.
        physics: whether an engine without physics is copied to MuJoCo.
    """
    has_physics = engine.name != NullEngine.name
    if Capability.FORK in engine.capabilities and (has_physics or not physics):
        return engine.fork(), ()
    copied = make_engine("mujoco")
    present = engine.snapshot()
    current = {body.id: body for body in present.bodies}
    spawned: set[BodyId] = set()
    for world in (*worlds, present):
        bodies = tuple(each for each in world.bodies if each.id in current and each.id not in spawned)
        spawned |= {body.id for body in bodies}
        ends = [each for each in world.joints if each.parent in spawned and each.child in spawned]
        known = set(copied.joint_positions())
        attachments = [each for each in world.attachments if each.parent in spawned and each.child in spawned]
        joints = tuple(each for each in ends if each.id not in known)
        part = msgspec.structs.replace(
            world, bodies=bodies, joints=joints, attachments=() if world is present else tuple(attachments)
        )
        copied.apply(spawn(part))
    cause = "cannot be forked" if has_physics else "has no physics"
    notes = [f"{engine.name} {cause}: the copy is simulated by {copied.name}, from a snapshot at rest"]
    _match_attachments(copied, present)
    notes += _match_bodies(copied, present, SpawnRecord.from_worlds((present, *worlds)))
    _include_touching_pairs(copied)
    return copied, tuple(notes)


def _include_touching_pairs(engine: Engine) -> None:
    """Lets what touches in a snapshot collide, though it began inside each other when it was spawned."""
    if isinstance(engine, AssumingEngine):
        engine.include_touching_pairs()


def match_world(engine: Engine, present: World, *, worlds: Iterable[World]) -> tuple[str, ...]:
    """Gives the bodies of an engine the poses, physics, materials and attachments that they have in a world.

    Args:
        engine: an engine with the same bodies and joints.
        present: the world, with the poses of an engine: bodies that were moved out of overlaps are where they were
            moved to.
        worlds: the worlds that were spawned, to which joint positions are relative.

    Returns:
        What is different, one sentence each.
    """
    spawn_record = SpawnRecord.from_worlds((present, *worlds))
    _match_attachments(engine, present)
    _match_bodies(engine, present, spawn_record, tolerance=0.0)
    notes = _match_bodies(engine, present, spawn_record, tolerance=0.0)  # again: parents have moved since
    _include_touching_pairs(engine)
    before = {body.id: body for body in engine.snapshot().bodies}
    for body in present.bodies:
        if body.id in before and before[body.id].materials != body.materials:
            engine.apply(SetMaterials(body.id, body.materials))
        if body.id in before and before[body.id].label != body.label:
            engine.apply(SetLabel(body.id, body.label or ""))
    return tuple(notes)


def _match_attachments(copied: Engine, present: World) -> None:
    known = set(copied.poses()[0])
    wanted = {each.child: each.parent for each in present.attachments if {each.child, each.parent} <= known}
    now = {each.child: each.parent for each in copied.snapshot().attachments}
    for child, parent in now.items():
        if wanted.get(child) != parent:
            copied.apply(Detach(child))
    poses = {body.id: body.pose for body in present.bodies}
    for child, parent in wanted.items():
        if now.get(child) != parent:
            copied.apply(SetPoses({parent: poses[parent]}))
            copied.apply(SetPoses({child: poses[child]}))
            copied.apply(Attach(parent, child))


def _match_bodies(
    copied: Engine, present: World, spawn_record: SpawnRecord, *, tolerance: float = _POSE_TOLERANCE
) -> list[str]:
    """Gives bodies their current pose and physics; parents come before what is attached to them."""
    notes = []
    parents = {each.child: each.parent for each in present.attachments}

    def depth(id: BodyId) -> int:
        count, visited = 0, {id}
        while (parent := parents.get(id)) is not None and parent not in visited:
            id, count = parent, count + 1
            visited.add(id)
        return count

    before = {body.id: body for body in copied.snapshot().bodies}
    rows = {id: row for row, id in enumerate(copied.poses()[0])}
    for body in sorted(present.bodies, key=lambda each: depth(each.id)):
        if body.id not in before:
            notes.append(f"{body.id!r} is not in the copy: it cannot be spawned")
            continue
        if before[body.id].physics != body.physics:
            copied.apply(SetPhysics(body.id, body.physics))
        pose = copied.poses()[1][rows[body.id]]
        if np.abs(pose - normalized_pose_array(body.pose)).max() > tolerance:
            try:
                copied.apply(SetPoses({body.id: body.pose}))
            except WorldError as error:
                notes += _move_near(copied, present, body, spawn_record, error)
    return notes


def _move_near(
    copied: Engine, present: World, body: Body, spawn_record: SpawnRecord, refusal: WorldError
) -> tuple[str, ...]:
    """Moves a body that physics had pushed beyond a limit of its joint to that limit; returns notes."""
    bodies = {each.id: each for each in present.bodies}
    for joint in present.joints:
        if body.id not in {joint.parent, joint.child} or not {joint.parent, joint.child} <= bodies.keys():
            continue
        handle = JointHandle(joint, bodies, spawn_record)
        poses = {end: normalized_pose_array(bodies[end].pose) for end in (joint.parent, joint.child)}
        if handle.moving_body != body.id or not handle.axes:
            continue
        positions, beyond = handle.positions(poses), 0.0
        for axis in handle.axes:
            low = -np.inf if axis.lower is None else axis.lower
            high = np.inf if axis.upper is None else axis.upper
            allowed = float(np.clip(positions[axis.name], low, high))
            beyond = max(beyond, abs(positions[axis.name] - allowed))
            poses[body.id] = normalized_pose_array(handle.pose_for(axis.name, allowed, poses))
        if beyond <= _MAX_BEYOND_LIMIT:
            with suppress(WorldError):
                copied.apply(SetPoses({body.id: pose_from_array(poses[body.id])}))
                return ()
    return (f"{body.id!r} has another pose in the copy: {refusal}",)
