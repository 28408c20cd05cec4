"""The published state of a simulation, and the protocol through which its parts use it.

A `StateSnapshot` is immutable and replaced after each tick and call, so it can be read without a lock.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any, Protocol

import msgspec

from mindstage.engines.base import Applied, Engine, EngineStats, PoseArray, SavedState, SpawnReport
from mindstage.errors import BodyNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Body, BodyGeometry, BodyId, Color, GeometryMap, Pose, Vector, World
from mindstage.scene.edits import Edit
from mindstage.scene.transforms import Array, normalize, pose_from_array
from mindstage.simulation.engine_thread import EngineAccess
from mindstage.simulation.highlights import HighlightGroup, Marker

__all__ = ["EngineSession", "SessionEdit", "SimulationBody", "StateSnapshot", "WorldSession", "find_body", "poses_in"]


class StateSnapshot(msgspec.Struct, frozen=True, eq=False):
    """The state of a simulation at one time."""

    time_s: float
    """Simulated time [s]."""
    ids: tuple[BodyId, ...]
    """The bodies that exist."""
    poses: PoseArray
    """n x 7: position [m] and quaternion (w, x, y, z) in the world frame, in the order of `ids`; read-only."""
    highlights: Mapping[BodyId, Color]
    """The color of each highlighted body."""
    highlight_groups: tuple[HighlightGroup, ...]
    """The highlighted bodies in groups, with the label of each; the latest group last."""
    markers: tuple[Marker, ...]
    """The visualization markers; the same object until they change."""
    revision: int
    """Incremented when bodies, materials or highlights are added, removed or changed; not by motion."""
    playing: bool
    """Whether simulated time advances in real time."""
    speed: float
    """Requested simulated time per wall time."""
    real_time_factor: float
    """Measured simulated time per wall time; 0 while paused."""
    stats: EngineStats | None = None
    """Statistics of the engine; None if it has none."""
    error: str = ""
    """The error that paused the simulation; empty if there is none."""
    expected_rebuild_s: float = 0.0
    """How long the engine is expected to rebuild its model before the next step, after edits [s]; 0 if it does not."""


class SessionEdit(Edit, frozen=True, kw_only=True):
    """The base class of edits of which an engine makes only the parts; the rest is about the simulation."""

    def complete(self, session: Any, engine: Engine) -> None:
        """Makes the rest in a `Simulation`, after the parts were made; called in the engine thread."""
        raise NotImplementedError


class WorldSession(Protocol):
    """The part of `Simulation` through which a world is read and changed, but not stepped."""

    knowledge: KnowledgeBase

    @property
    def worlds(self) -> tuple[World, ...]:
        """The worlds that were spawned."""

    @property
    def state(self) -> StateSnapshot:
        """The latest published state."""

    @property
    def engine(self) -> EngineAccess:
        """Its engine."""

    def snapshot(self) -> World:
        """The current state as a world."""

    def pull(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        """Pulls a point of a body towards a target [m]."""

    def release(self, id: BodyId | None = None) -> None:
        """Ends the pull on one body, or all pulls."""

    def apply(
        self,
        edit: Edit,
        *,
        engine: Engine | None = None,
        leads_to: SavedState | None = None,
        timeout_s: float | None = None,
    ) -> Applied:
        """Makes an edit."""


class SimulationBody:
    """A body of a simulation; made by `Simulation.body`. It reads the latest published state, without waiting."""

    def __init__(self, session: WorldSession, id: BodyId) -> None:
        """Reads nothing yet.

        Args:
            session: the simulation.
            id: the id of the body.
        """
        self.id = id
        self._session = session

    @property
    def exists(self) -> bool:
        """Whether it is in the simulation."""
        return self.id in self._session.state.ids

    @property
    def pose(self) -> Pose:
        """Its pose in the world frame.

        Raises:
            BodyNotFoundError: it was deleted.
        """
        state = self._session.state
        if self.id not in state.ids:
            raise BodyNotFoundError(self.id, known=state.ids)
        return pose_from_array(state.poses[state.ids.index(self.id)])

    def __repr__(self) -> str:
        at = ", ".join(f"{part:.3f}" for part in self.pose.position) if self.exists else ""
        return f"<{type(self).__name__} {self.id}{f' at ({at}) m' if at else ', deleted'}>"


class EngineSession(WorldSession, Protocol):
    """The part of `Simulation` that placement, undo and joint motion use."""

    timeout_s: float
    edits: Any

    @property
    def reports(self) -> tuple[SpawnReport, ...]:
        """The report of each spawn."""

    @property
    def geometry(self) -> GeometryMap:
        """The geometry of the bodies that exist."""

    def fit_geometry(self, body: Body) -> BodyGeometry | None:
        """The geometry that a body would have, without fitting it to other bodies."""

    @property
    def immovable(self) -> frozenset[BodyId]:
        """Dynamic bodies that were spawned as static ones, since they cannot be loose."""

    def spawn(
        self,
        world: World | str | None = None,
        *,
        geometry: GeometryMap | None = None,
        persistent: bool = True,
        title: str = "",
        timeout_s: float | None = None,
    ) -> SpawnReport:
        """Spawns a world."""

    def step(self, duration_s: float) -> None:
        """Advances simulated time [s]."""

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""

    def reset(self) -> None:
        """Restores the state after the last persistent spawn."""


def find_body(simulation: WorldSession, name: str) -> BodyId | None:
    """The id of the body with that id or IRI; None if there is none."""
    ids = simulation.state.ids
    if name in ids:
        return BodyId(name)
    named = (body.id for world in simulation.worlds for body in world.bodies if body.iri == name)
    return next((id for id in named if id in ids), None)


def poses_in(snapshot: StateSnapshot, ids: Container[BodyId]) -> dict[BodyId, Array]:
    """The poses of the given bodies in a snapshot, by id: position [m] and unit quaternion (w, x, y, z)."""
    found = {}
    for row, id in enumerate(snapshot.ids):
        if id in ids:
            pose = snapshot.poses[row].copy()
            pose[3:] = normalize(pose[3:])
            found[id] = pose
    return found
