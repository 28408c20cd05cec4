"""What every engine promises: a world goes in, lives, and comes back out with nothing lost.

An engine is single-threaded and owned by whoever made it (usually a `Simulation`). All edits keep the rest of the running
world as it was: poses, velocities, contacts, sleep. Poses enter and leave in the world frame [m, w x y z]; each
engine changes axes and units on its own side.

A call ends in one of three ways: it succeeds; it raises a `WorldError`, because the world does not allow it, and the
world is unchanged; or it raises an `EngineError`, because the engine broke.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import NewType, Protocol, runtime_checkable

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.scene import NO_GEOMETRY, BodyId, BodyPhysics, Color, GeometryMap, Material, Pose, Vector, World
from mindstage.scene.display import counted, html_table

__all__ = [
    "Capability",
    "Engine",
    "EngineStats",
    "PoseArray",
    "SavedState",
    "SpawnFailure",
    "SpawnNote",
    "SpawnNoteKind",
    "SpawnReport",
]

PoseArray = NDArray[np.float64]
"""n x 7: x y z [m], then w x y z."""

SavedState = NewType("SavedState", object)
"""What `save` returns; only the engine that made it can read it."""


class Capability(StrEnum):
    """What only some engines can do; ask `engine.capabilities` before calling."""

    SAVE = "save"
    """`save` and `restore_state`."""
    JOINTS = "joints"
    """`joint_positions`."""
    STATISTICS = "statistics"
    """`stats`."""


class EngineStats(msgspec.Struct, frozen=True, kw_only=True):
    """How busy an engine is just now."""

    movable: int
    """Bodies that can move, by themselves or with what they hang on."""
    awake: int
    """Those of them that are not at rest."""
    contacts: int
    """Places where those that are awake touch something."""
    timestep_s: float | None = None
    """Of the physics; None where it has none of its own [s]."""


class SpawnFailure(msgspec.Struct, frozen=True):
    """Something that could not be spawned."""

    id: str
    reason: str


class SpawnNoteKind(StrEnum):
    """What an engine had to decide by itself; each kind can be counted and filtered."""

    MASS_ESTIMATED = "mass estimated"
    SIZE_ASSUMED = "size assumed"
    MOBILITY_ASSUMED = "mobility assumed"
    ENCLOSURE = "shell"
    """Encloses much of the world; nothing collides with it."""
    HOLLOW = "hollow"
    """Has something inside that must rest on it, so it got an inside."""
    SHAPE = "shape"
    """A form is a guess, or not all of it could be used."""
    OVERLAP = "overlap"
    """The first body and each of the others stand in one another, so they do not collide."""
    PENETRATION = "sunk"
    """The first body stands a little in each of the others, and is pushed out by the physics."""
    JOINT = "constraint"
    """A constraint is not taken literally."""
    ATTACHMENT = "attachment"
    """An attachment is not taken literally."""
    SOLVER = "solver"
    """The physics warned that it left something out."""
    NOT_TRANSFERRED = "untold"
    """There is no word for it on the way to a far engine, so that engine does not know of it."""


class SpawnNote(msgspec.Struct, frozen=True):
    """One decision that the map did not make, in words."""

    kind: SpawnNoteKind
    ids: tuple[str, ...]
    text: str


class SpawnReport(
    msgspec.Struct, frozen=True, kw_only=True, rename={"joints": "constraints", "failed_joints": "failed_constraints"}
):
    """What became of a world that was to be spawned."""

    bodies: int = 0
    """Spawned bodies."""
    joints: int = 0
    attachments: int = 0
    failed_bodies: tuple[SpawnFailure, ...] = ()
    failed_joints: tuple[SpawnFailure, ...] = ()
    failed_attachments: tuple[SpawnFailure, ...] = ()
    """The child's id."""
    notes: tuple[SpawnNote, ...] = ()
    """What was assumed."""

    def ids_with_note(self, kind: SpawnNoteKind) -> frozenset[BodyId]:
        """What the notes of a kind are about."""
        return frozenset(BodyId(id) for note in self.notes if note.kind is kind for id in note.ids)

    @property
    def ok(self) -> bool:
        """Whether everything was spawned; assumptions do not count against it."""
        return not self._failures

    @property
    def _failures(self) -> tuple[SpawnFailure, ...]:
        return (*self.failed_bodies, *self.failed_joints, *self.failed_attachments)

    def __repr__(self) -> str:
        spawned = (self.bodies, "body"), (self.joints, "joint"), (self.attachments, "attachment")
        counts = ", ".join(counted(number, noun) for number, noun in spawned)
        failed = f"{len(self._failures):,} failed" if self._failures else "nothing failed"
        return f"<{type(self).__name__}: {counts}, {failed}, {counted(len(self.notes), 'note')}>"

    def _repr_html_(self) -> str:
        """What failed and what was assumed, as a table for notebooks."""
        rows = [("failed", each.id, each.reason) for each in self._failures]
        rows += [(note.kind.value, ", ".join(note.ids), note.text) for note in self.notes]
        return html_table(repr(self), ("kind", "about", "text"), rows)


@runtime_checkable
class Engine(Protocol):
    """A running world. Every method but `close` raises `EngineClosedError` after `close`."""

    @property
    def name(self) -> str:
        """A short name for reports, such as "mujoco"."""

    @property
    def capabilities(self) -> frozenset[Capability]:
        """What this engine can do beyond the rest of this contract."""

    @property
    def time_s(self) -> float:
        """Simulated time since the engine was made [s]."""

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        """Adds a world to what is there: bodies first, then constraints, then attachments.

        What cannot be spawned is listed in the report with the reason; the rest is spawned.

        Args:
            world: what comes.
            forms: what its bodies are made of; a body without one is its shape, in its size. They are not logged.
        """

    def delete(self, ids: Iterable[BodyId]) -> None:
        """Removes bodies, their constraints and attachments; what hung on them stays where it is.

        Raises:
            BodyNotFoundError: for the first id that is not there; nothing is deleted then.
        """

    def clear(self) -> None:
        """Removes everything; time goes on."""

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """From now on the child goes rigidly where the parent goes; both stay where they are now.

        Raises:
            BodyNotFoundError: one of the two is not there.
            AttachmentError: it would close a circle. A child that hung elsewhere is detached first.
        """

    def detach(self, child: BodyId) -> None:
        """Lets go of a child where it is, with the velocity that it has; nothing happens if it hangs nowhere.

        Raises:
            BodyNotFoundError: there is no such body.
        """

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        """Puts a body somewhere else, at rest, and all that hangs on it with it.

        Raises:
            BodyNotFoundError: there is no such body.
            PoseUnreachableError: its constraint does not let it get there, or the pose is not finite.
        """

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        """Changes mobility, gravity, mass, overlap events.

        Raises:
            BodyNotFoundError: there is no such body.
        """

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        """Changes the surface.

        Raises:
            BodyNotFoundError: there is no such body.
        """

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        """Lights bodies up in a color; None puts them out.

        Raises:
            BodyNotFoundError: for the first id that is not there; nothing changes then.
        """

    def highlights(self) -> Mapping[BodyId, Color]:
        """Which bodies are lit, and how."""

    def apply_force(self, id: BodyId, force: Vector, point: Vector | None = None) -> None:
        """Applies a force [N, world frame] throughout the next `step`, at a point [m, world frame].

        Without a point it acts on the center of mass. Pushes on one body add up; static and kinematic bodies
        do not feel them.

        Raises:
            BodyNotFoundError: there is no such body.
        """

    def step(self, duration_s: float) -> None:
        """Lets time pass. What is less than a time step of the engine is kept for the next call.

        Raises:
            SimulationDivergedError: the numbers stopped making sense; the engine is still usable (delete, restore).
        """

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        """All bodies' ids and poses at once, in one order; the array is the caller's to keep.

        The tuple of ids is the same object until a body comes or goes.
        """

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        """How far each constraint has moved from where it was spawned (ability JOINTS).

        Six numbers for each constraint that can move: x, y, z [m], twist, swing2, swing1 [rad].
        """

    def stats(self) -> EngineStats:
        """How busy it is, at next to no cost: it may be asked after each tick (ability STATISTICS)."""

    def snapshot(self) -> World:
        """Everything as it is now. What was not moved comes back exactly as it was given."""

    def save_state(self) -> SavedState:
        """The whole state, bodies included (ability SAVE)."""

    def restore_state(self, state: SavedState) -> None:
        """Brings a saved state back, exactly (ability SAVE)."""

    def close(self) -> None:
        """Ends the engine; any number of times."""
