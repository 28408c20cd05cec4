"""The published state of a simulation, and the protocol by which its parts use it.

A `StateSnapshot` replaces the previous one after each tick and never changes, so reading it needs no lock.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from typing import Protocol, TypeVar

import msgspec

from mindstage.engines.base import Capability, Engine, EngineStats, PoseArray, SpawnReport
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, Color, GeometryMap, Vector, World
from mindstage.scene.transforms import Array, normalize
from mindstage.simulation.highlights import HighlightGroup, Marker

__all__ = ["EngineSession", "StateSnapshot", "poses_in"]

T = TypeVar("T")


class StateSnapshot(msgspec.Struct, frozen=True, eq=False):
    """The world at one moment; a new one replaces it, this one never changes."""

    time_s: float
    ids: tuple[BodyId, ...]
    poses: PoseArray
    """n x 7, in the order of `ids`."""
    highlights: Mapping[BodyId, Color]
    highlight_groups: tuple[HighlightGroup, ...]
    """The same bodies in groups, with the reason why each is lit; the latest last."""
    markers: tuple[Marker, ...]
    """What programs want to be seen beside the bodies; the same object until it changes."""
    revision: int
    """Counts up when bodies, materials or lights came, went or changed, not when they moved."""
    playing: bool
    speed: float
    real_time_factor: float
    stats: EngineStats | None = None
    """How busy the engine is; None where it cannot say."""
    error: str = ""
    """Why the world stands still although nobody paused it."""


class EngineSession(Protocol):
    """The part of `Simulation` that placement, undo and joint motion use."""

    knowledge: KnowledgeBase
    timeout_s: float

    @property
    def worlds(self) -> tuple[World, ...]:
        """The worlds that were spawned, as given."""

    @property
    def reports(self) -> tuple[SpawnReport, ...]:
        """The report of each spawn."""

    @property
    def state(self) -> StateSnapshot:
        """The state as last published."""

    @property
    def capabilities(self) -> frozenset[Capability]:
        """The optional operations of the engine."""

    @property
    def geometry(self) -> GeometryMap:
        """The geometry of the bodies that exist."""

    def spawn(
        self,
        world: World | str | None = None,
        *,
        geometry: GeometryMap | None = None,
        persistent: bool = True,
        timeout_s: float | None = None,
    ) -> SpawnReport:
        """Spawns a world."""

    def snapshot(self) -> World:
        """The current world as a description."""

    def step(self, duration_s: float) -> None:
        """Advances simulated time [s]."""

    def pull(self, id: BodyId, *, point: Vector, target: Vector) -> None:
        """Pulls a point of a body towards a target [m]."""

    def release(self, id: BodyId | None = None) -> None:
        """Ends the pull on one body, or all pulls."""

    def reset(self) -> None:
        """Restores the state right after the spawn."""

    def run_on_engine(
        self, function: Callable[[Engine], T], *, label: str = "", timeout_s: float | None = None, edits: bool = False
    ) -> T:
        """Runs a function on the engine, in the thread that owns it."""


def poses_in(frame: StateSnapshot, ids: Container[BodyId]) -> dict[BodyId, Array]:
    """The poses of some bodies, by id: seven numbers with a unit quaternion."""
    found = {}
    for row, id in enumerate(frame.ids):
        if id in ids:
            pose = frame.poses[row].copy()
            pose[3:] = normalize(pose[3:])
            found[id] = pose
    return found
