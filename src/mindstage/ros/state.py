"""The state of a simulation, read from any thread without waiting for it; and ids and IRIs for objects without one.

Poses come from the last published snapshot, which is never older than the last call that ended, so that thousands of
requests a second do not slow the simulation down.
"""

from __future__ import annotations

import threading
from collections.abc import Container, Iterable
from itertools import count

from mindstage.engines import PoseArray
from mindstage.errors import BodyNotFoundError
from mindstage.scene import Body, BodyId, Iri, Pose, World
from mindstage.scene.transforms import normalized_pose_array, pose_from_array, pose_multiply
from mindstage.simulation import Simulation, StateSnapshot

__all__ = ["WORLD_FRAMES", "StateReader", "free_id", "map_iri"]

WORLD_FRAMES = frozenset({"", "map", "world"})
"""Frame ids that mean the frame of the world."""


def map_iri(name: str) -> Iri:
    """Returns the IRI of a map that has none."""
    return Iri(f"http://mindstage.org/maps/{name}.owl#map")


def free_id(stem: str, taken: Container[str]) -> BodyId:
    """Returns an id that is not taken."""
    return next(BodyId(id) for number in count(1) if (id := f"{stem}_{number}") not in taken)


class StateReader:
    """Reads the state of a simulation, from any thread."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._rows: tuple[tuple[BodyId, ...], dict[BodyId, int]] = ((), {})
        self._world: tuple[int, World | None, dict[BodyId, Body]] = (-1, None, {})
        self._lock = threading.Lock()

    def state(self) -> StateSnapshot:
        """Returns the last snapshot of the state.

        Raises:
            EngineError: the engine has failed, and its state is unknown.
        """
        if self.simulation.engine_error is not None:
            raise self.simulation.engine_error
        return self.simulation.state

    def row_by_id(self, snapshot: StateSnapshot) -> dict[BodyId, int]:
        """Returns the row of each body in the poses of a snapshot."""
        ids, rows = self._rows
        if ids is not snapshot.ids:
            start = len(ids) if snapshot.ids[: len(ids)] == ids else 0  # bodies were only added
            rows = dict(rows) if start else {}
            rows.update(zip(snapshot.ids[start:], range(start, len(snapshot.ids)), strict=True))
            self._rows = snapshot.ids, rows
        return rows

    def pose(self, id: str) -> PoseArray:
        """Returns the pose of a body: x y z [m], then quaternion w x y z.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        snapshot = self.state()
        row = self.row_by_id(snapshot).get(BodyId(id))
        if row is None:
            raise self.not_found_error(id, snapshot.ids)
        pose: PoseArray = snapshot.poses[row]
        return pose

    def require(self, ids: Iterable[str]) -> None:
        """Checks that bodies exist.

        Raises:
            BodyNotFoundError: for the first that does not.
        """
        snapshot = self.state()
        rows = self.row_by_id(snapshot)
        for id in ids:
            if id not in rows:
                raise self.not_found_error(id, snapshot.ids)

    def world(self) -> World:
        """Returns the world with its bodies as they are described; their current poses are in `state`."""
        return self._refresh_world()[1] or self.simulation.snapshot()

    def body(self, id: str) -> Body:
        """Returns the description of a body.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        bodies = self._refresh_world()[2]
        body = bodies.get(BodyId(id))
        if body is None:
            raise self.not_found_error(id, bodies)
        return body

    def to_world_frame(self, pose: Pose, frame_id: str) -> Pose:
        """Transforms a pose from the frame of a body, or of the world, to the frame of the world.

        Raises:
            BodyNotFoundError: the frame is neither a body nor the world.
        """
        name = frame_id.lstrip("/")
        return (
            pose
            if name in WORLD_FRAMES
            else pose_from_array(
                pose_multiply(normalized_pose_array(pose_from_array(self.pose(name))), normalized_pose_array(pose))
            )
        )

    def not_found_error(self, id: str, known: Iterable[str]) -> BodyNotFoundError:
        """Returns the error for an unknown id."""
        worlds = self.simulation.worlds
        return BodyNotFoundError(id, known=known, world=worlds[-1].name if worlds else "")

    def _refresh_world(self) -> tuple[int, World | None, dict[BodyId, Body]]:
        """Reads the world from the engine if it has changed since the last call."""
        revision = self.state().revision
        if self._world[0] != revision:
            with self._lock:
                if self._world[0] != revision:
                    world = self.simulation.snapshot()
                    self._world = revision, world, {body.id: body for body in world.bodies}
        return self._world
