"""The `Engine` protocol: what every physics or game engine that runs a world implements.

An engine is single-threaded and is owned by its creator (usually a `Simulation`), which also closes it. An edit leaves
the rest of the running world unchanged: poses, velocities, contacts and sleep. Poses are given and returned in the
world frame (x forward, y left, z up), positions in meters, unit quaternions w x y z; each engine converts axes and
units internally.

A call ends in one of three ways: it succeeds; it raises a `WorldError` because its arguments are invalid for the
current world, which is then unchanged; or it raises an `EngineError` because the engine failed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import NamedTuple, NewType, Protocol, runtime_checkable

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.access.limits import Duration
from mindstage.ranges import Factor, Finite, ForceVector, NotNegative, Point, check_fields
from mindstage.scene import BodyId, Color, Vector, World
from mindstage.scene.display import counted, html_table
from mindstage.scene.edits import Edit

__all__ = [
    "Actuator",
    "ActuatorMode",
    "ActuatorState",
    "Applied",
    "AssumingEngine",
    "Capability",
    "Contact",
    "DynamicsScale",
    "Engine",
    "EngineFactory",
    "EngineSettings",
    "EngineStats",
    "InterruptibleEngine",
    "MovedBody",
    "PoseArray",
    "RebuildTime",
    "RebuildingEngine",
    "SavedState",
    "SpawnFailure",
    "SpawnNote",
    "SpawnNoteKind",
    "SpawnReport",
]

PoseArray = NDArray[np.float64]
"""Poses of n bodies, shape (n, 7): x y z [m], then w x y z."""

SavedState = NewType("SavedState", object)
"""The opaque result of `save_state`; only the engine that made it can restore it."""


class Capability(StrEnum):
    """An optional part of the `Engine` protocol; check `engine.capabilities` before calling."""

    SAVE = "save"
    """`save_state` and `restore_state`."""
    FORK = "fork"
    """`fork`."""
    CONTACTS = "contacts"
    """`contacts`."""
    SCALE_DYNAMICS = "scale dynamics"
    """`scale_dynamics`."""
    JOINTS = "joints"
    """`joint_positions`."""
    STATISTICS = "statistics"
    """`stats`."""
    KINEMATIC_VELOCITIES = "kinematic velocities"
    """A kinematic body whose pose is set again and again has a velocity, and carries what lies on it. In an engine
    without it each pose is a teleport, under which the load stays behind."""
    ACTUATORS = "actuators"
    """`SetActuators`, `set_commands` and `actuator_states`."""


class ActuatorMode(StrEnum):
    """What the command of an actuator means."""

    POSITION = "position"
    """A position [m or rad], relative to the spawned pose as in `joint_positions`."""
    VELOCITY = "velocity"
    """A velocity [m/s or rad/s]."""
    EFFORT = "effort"
    """A force [N] or moment [Nm]."""


class Actuator(msgspec.Struct, frozen=True, kw_only=True):
    """The drive of one axis of a joint.

    In the modes POSITION and VELOCITY it is a servo: effort = stiffness * (command - position) - damping * velocity, or
    damping * (command - velocity), limited to `effort_limit`.
    """

    name: str
    """Unique in the engine."""
    joint: BodyId
    axis: str = ""
    """Of "x", "y", "z" (translations), "twist", "swing2", "swing1" (rotations about x, y, z of the joint frame); empty
    for the first axis that is not locked."""
    mode: ActuatorMode = ActuatorMode.POSITION
    effort_limit: NotNegative
    """[N] or [Nm]."""
    stiffness: NotNegative = 0.0
    """[N/m] or [Nm/rad]; only for POSITION."""
    damping: NotNegative = 0.0
    """[Ns/m] or [Nms/rad]; for POSITION and VELOCITY."""
    armature: NotNegative = 0.0
    """Inertia of the drive, as seen at the joint [kg] or [kg m²]."""
    friction: NotNegative = 0.0
    """Dry friction of the joint, in place of that of a joint without a drive [N] or [Nm]."""

    def __post_init__(self) -> None:
        check_fields(self)


class ActuatorState(msgspec.Struct, frozen=True, kw_only=True):
    """The state of an actuator and its joint."""

    position: float
    """[m] or [rad], relative to the spawned pose; full turns are counted. 0 while the joint holds bodies that are
    attached to each other or do not move."""
    velocity: float
    """[m/s] or [rad/s]."""
    effort: float
    """Exerted by the actuator [N] or [Nm], without what compensates gravity."""
    command: float


class EngineStats(msgspec.Struct, frozen=True, kw_only=True):
    """Activity of an engine at the current time."""

    movable: int
    """Number of bodies that can move: dynamic ones and those attached to them."""
    awake: int
    """Number of movable bodies that are not asleep."""
    contacts: int
    """Number of contact points of the awake bodies."""
    timestep_s: float | None = None
    """Time step of the physics [s]; None for an engine without one."""


class Contact(msgspec.Struct, frozen=True, kw_only=True):
    """All contact points of two bodies, or of a body and the ground, merged to one."""

    a: BodyId
    b: BodyId | None
    """None for a ground that the engine has added."""
    position: Vector
    """Mean of the contact points, weighted by force, in the world frame [m]."""
    normal: Vector
    """Unit vector from `a` to `b`."""
    force_n: float
    """Sum of the normal forces [N]."""
    depth_m: float
    """The deepest penetration [m]; negative for a gap."""


class DynamicsScale(msgspec.Struct, frozen=True, kw_only=True):
    """Factors for the dynamics of a body, relative to its description."""

    mass: Factor = 1.0
    """Factor of the mass and the moments of inertia."""
    friction: Factor = 1.0
    """Factor of the sliding friction; it has no effect against a body that is more slippery by its description."""
    joint_friction: Factor = 1.0
    """Factor of the friction and the damping of the joint that moves the body."""

    def __post_init__(self) -> None:
        check_fields(self)


class SpawnFailure(msgspec.Struct, frozen=True):
    """A body, joint or attachment that could not be spawned."""

    id: str
    reason: str


class SpawnNoteKind(StrEnum):
    """The kinds of decisions and assumptions an engine makes during a spawn."""

    MASS_ESTIMATED = "mass estimated"
    SIZE_ASSUMED = "size assumed"
    MOBILITY_ASSUMED = "mobility assumed"
    ENCLOSURE = "enclosure"
    """The body encloses much of the world, so it collides with nothing."""
    HOLLOW = "hollow"
    """Other bodies rest inside the body, so its collision shape is made of wall panels."""
    SHAPE = "shape"
    """The geometry is a guess, or part of it could not be used."""
    OVERLAP = "overlap"
    """The first body overlaps each of the others, so their collisions are disabled."""
    EMBEDDED = "embedded"
    """The first body slightly penetrates each of the others; the physics pushes it out."""
    SETTLED = "settled"
    """The first body overlapped the others, and was moved out of them before the simulation starts."""
    IMMOVABLE = "immovable"
    """Bodies that the map describes as dynamic are static by their class."""
    GROUND = "ground"
    """The map has nothing below these bodies, or they may fall past what is below them, so a ground was added."""
    CLAMPED = "clamped"
    """A number of the body is outside of the range that can be simulated; the nearest one is used."""
    STOPPED = "stopped"
    """The body fell far below the place, and was made static there."""
    FAST = "fast"
    """The body is so fast that it may pass through thin bodies."""
    JOINT = "joint"
    """A joint is not simulated exactly as described."""
    ATTACHMENT = "attachment"
    """An attachment is not simulated exactly as described."""
    SOLVER = "solver"
    """The physics engine warned that it left something out."""
    UNSTATED = "unstated"
    """The protocol of a remote engine has no field for a property, so it was not sent."""


class SpawnNote(msgspec.Struct, frozen=True):
    """One decision or assumption of an engine about bodies or joints that the world leaves open."""

    kind: SpawnNoteKind
    ids: tuple[str, ...]
    text: str


class MovedBody(msgspec.Struct, frozen=True, kw_only=True):
    """A body that did not stay where it was spawned."""

    id: BodyId
    distance_m: float
    """Distance from the pose at which it was spawned [m]."""
    left_place: bool = False
    """Whether it left the bounds of all bodies at the spawn, or fell far below them."""


class SpawnReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result of spawning a world: counts, failures and notes."""

    bodies: int = 0
    """Number of spawned bodies."""
    joints: int = 0
    attachments: int = 0
    failed_bodies: tuple[SpawnFailure, ...] = ()
    failed_joints: tuple[SpawnFailure, ...] = ()
    failed_attachments: tuple[SpawnFailure, ...] = ()
    """Each failure's `id` is the id of the child."""
    notes: tuple[SpawnNote, ...] = ()
    """Decisions and assumptions made during the spawn."""
    moved: tuple[MovedBody, ...] = ()
    """Bodies that moved by more than 0.1 m within `rest_checked_s`, or left the place, farthest first."""
    rest_checked_s: float = 0.0
    """Simulated time for which the bodies were observed [s]; 0 if they were not."""
    expected_rebuild_s: float = 0.0
    """How long the engine is expected to rebuild its model before time goes on [s]; of reports of simulations."""

    def ids_with_note(self, kind: SpawnNoteKind) -> frozenset[BodyId]:
        """The ids of bodies and joints that the notes of one kind are about."""
        return frozenset(BodyId(id) for note in self.notes if note.kind is kind for id in note.ids)

    @property
    def ok(self) -> bool:
        """Whether everything was spawned; notes do not count as failures."""
        return not self.failures

    @property
    def is_at_rest(self) -> bool:
        """Whether no body is known to have moved away; always true if `rest_checked_s` is 0."""
        return not self.moved

    @property
    def failures(self) -> tuple[SpawnFailure, ...]:
        """What could not be spawned: bodies first, then joints, then attachments."""
        return (*self.failed_bodies, *self.failed_joints, *self.failed_attachments)

    def __repr__(self) -> str:
        spawned = (self.bodies, "body"), (self.joints, "joint"), (self.attachments, "attachment")
        counts = ", ".join(counted(number, noun) for number, noun in spawned)
        failed = f"{len(self.failures):,} failed" if self.failures else "nothing failed"
        return f"<{type(self).__name__}: {counts}, {failed}, {counted(len(self.notes), 'note')}>"

    def _repr_html_(self) -> str:
        """Failures and notes as an HTML table, for notebooks."""
        rows = [("failed", each.id, each.reason) for each in self.failures]
        rows += [("moved", each.id, f"{each.distance_m:.3g} m") for each in self.moved]
        rows += [(note.kind.value, ", ".join(note.ids), note.text) for note in self.notes]
        return html_table(repr(self), ("kind", "about", "text"), rows)


class Applied(msgspec.Struct, frozen=True, kw_only=True):
    """An edit that was made."""

    edit: Edit
    inverse: Edit
    """The edit that reverts it: it restores what this one has changed, wherever that has moved to since then."""
    report: SpawnReport = SpawnReport()
    """Of what was spawned, if anything was."""


@runtime_checkable
class Engine(Protocol):
    """A running world. Every method except `close` raises `EngineClosedError` after `close`."""

    @property
    def name(self) -> str:
        """Short name for reports and error messages, such as "mujoco"."""

    @property
    def capabilities(self) -> frozenset[Capability]:
        """The optional parts of this protocol that the engine implements."""

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        """Decisions and warnings that are in no report, since edits or the physics caused them."""

    @property
    def time_s(self) -> float:
        """Simulated time since the engine was created [s]."""

    @property
    def state_key(self) -> object:
        """The same object as long as the state is the same, apart from highlights; None if that is not known.

        A restored state has the key that it had when it was saved.
        """

    def apply(self, edit: Edit) -> Applied:
        """Makes an edit, and computes the one that reverts it from the state before.

        Args:
            edit: the edit; an engine may leave out kinds that its `capabilities` do not have.

        Raises:
            WorldError: the world does not allow it, as stated at the class of the edit; nothing changes then.
            UnsupportedByEngineError: the engine does not know edits of this kind.
        """

    def clear(self) -> None:
        """Removes everything; `time_s` is 0 again, unless the engine has a clock that cannot be set."""

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        """Highlights bodies in a color, or removes their highlights.

        Args:
            ids: the bodies.
            color: the highlight color; None removes it.

        Raises:
            BodyNotFoundError: for the first unknown id; nothing changes then.
        """

    def highlights(self) -> Mapping[BodyId, Color]:
        """The highlighted bodies and their colors."""

    def apply_force(self, id: BodyId, force: ForceVector, point: Point | None = None) -> None:
        """Applies a force to a body throughout the next `step`.

        Forces on one body add up. Static and kinematic bodies are not affected.

        Args:
            id: the body.
            force: force vector in the world frame [N].
            point: point of application in the world frame [m]; None for the center of mass.

        Raises:
            BodyNotFoundError: the body is unknown.
        """

    def step(self, duration_s: Duration) -> None:
        """Advances the simulation.

        Args:
            duration_s: simulated time to advance [s]. A remainder shorter than the engine's time step is carried over
                to the next call.

        Raises:
            SimulationDivergedError: the state is no longer finite; the engine stays usable (`delete`, `restore_state`).
        """

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        """The ids and poses of all bodies, in the same order; the array is a copy.

        The tuple of ids is the same object until a body is added or removed.
        """

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        """Displacement of each movable joint since it was spawned (capability JOINTS).

        Six numbers for each joint: x, y, z [m], twist, swing2, swing1 [rad].
        """

    def stats(self) -> EngineStats:
        """Current activity; cheap enough to call after every step (capability STATISTICS)."""

    def snapshot(self) -> World:
        """The current world. Bodies that have not moved are returned exactly as they were spawned.

        A joint is at its place on the body that holds it, and moves with that one.
        """

    def save_state(self) -> SavedState:
        """Saves the complete state, including which bodies exist (capability SAVE)."""

    def restore_state(self, state: SavedState) -> None:
        """Restores a saved state exactly (capability SAVE).

        Raises:
            TypeError: the state was not made by this kind of engine.
        """

    def fork(self) -> Engine:
        """Returns another engine in exactly the same state, sleeping bodies included (capability FORK).

        Both continue independently: edits and steps of one have no effect on the other. Neither closes the other.
        """

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        """Scales masses and frictions, without a change of the world (capability SCALE_DYNAMICS).

        A snapshot has the described values, and later edits keep the factors. A second call replaces the factors of the
        bodies that it names. The bodies wake up.

        Raises:
            BodyNotFoundError: for the first unknown id; nothing changes then.
        """

    def set_commands(self, commands: Mapping[str, Finite]) -> None:
        """Sets the commands of actuators by name (capability ACTUATORS); quick, and without a rebuild.

        Raises:
            KeyError: there is no such actuator; nothing changes then.
            NumberRefusedError: a command is not finite; nothing changes then.
        """

    def actuator_states(self) -> Mapping[str, ActuatorState]:
        """The state of each actuator by name (capability ACTUATORS)."""

    def contacts(self) -> tuple[Contact, ...]:
        """The contacts of awake bodies at the last step, in the order of the ids (capability CONTACTS)."""

    def close(self) -> None:
        """Closes the engine; closing it again has no effect."""


class EngineSettings(NamedTuple):
    """How an engine is made."""

    godot: str | None = None
    """Path of the Godot executable; by default the one on PATH, or in a common location."""
    timeout_s: float | None = None
    """Timeout of a call to another process [s]; by default the engine's own."""


class EngineFactory(NamedTuple):
    """Makes engines; the entry points `mindstage.engines` name these, by what precedes the first colon of a name."""

    names: tuple[str, ...]
    """The names, such as "godot" and "godot:window"; one with "://" stands for all addresses of its scheme."""
    make: Callable[[str, EngineSettings], Engine]
    """Returns a new engine for a name.

    Raises:
        EngineUnavailableError: it cannot be loaded, started or reached.
    """


@runtime_checkable
class AssumingEngine(Protocol):
    """An engine that completes the world with assumptions, on which the results of its physics rest."""

    @property
    def assumptions(self) -> tuple[str, ...]:
        """The present ones, one sentence each; a function of the state."""

    def include_touching_pairs(self) -> None:
        """Lets pairs collide that began inside each other, unless they overlap by more than 1 mm now.

        For a state that was set and not reached by time: whether they were apart before is not known then.
        """


@runtime_checkable
class RebuildingEngine(Protocol):
    """An engine that rebuilds its model after edits, at the next step: one rebuild for all edits before it."""

    @property
    def rebuild_pending(self) -> bool:
        """Whether the next step rebuilds the model."""

    @property
    def expected_rebuild_s(self) -> float:
        """How long the pending rebuild is expected to take [s], from the time that the last one took; 0 without one."""

    @property
    def last_rebuild(self) -> RebuildTime | None:
        """When the last rebuild began and ended; may be read from any thread."""

    def rebuild(self) -> None:
        """Rebuilds the model now, if that is pending, so that the next step does not have to."""


class RebuildTime(msgspec.Struct, frozen=True, kw_only=True):
    """When a rebuild of a model began and ended, by `time.monotonic`."""

    began_s: float
    ended_s: float | None = None
    """None while it is running."""


@runtime_checkable
class InterruptibleEngine(Protocol):
    """An engine whose steps can be divided by wall time, so that the thread that steps it can do something else."""

    def step_for(self, duration_s: Duration, *, wall_s: float) -> float:
        """Like `Engine.step`, but stops after a wall time [s], though not before one time step.

        Returns:
            The simulated time that is left [s]; forces act until that was stepped, too.
        """
