"""Sight: what can be told of the stage without waiting for it, and what stands there as it was described.

Poses come from the frame that the stage has published last, which is never older than the last call that ended; so a
thousand questions in a second cost the running world nothing.

Names: ids and IRIs for what came over the wire without one.
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

__all__ = ["WORLD_FRAMES", "StateReader", "free_id", "iri_namespace", "map_iri"]


def map_iri(name: str) -> Iri:
    """The IRI of a map that nobody gave one."""
    return Iri(f"http://mindstage.org/maps/{name}.owl#map")


def iri_namespace(map: str) -> str:
    """What the IRIs of a map's things begin with."""
    return map.rpartition("#")[0] + "#" if "#" in map else f"{map}#"


def free_id(stem: str, taken: Container[str]) -> BodyId:
    """An id that nobody has yet."""
    return next(BodyId(id) for number in count(1) if (id := f"{stem}_{number}") not in taken)


WORLD_FRAMES = frozenset({"", "map", "world"})
"""Names under which the world's own frame is meant; the first that has letters is the one that is told."""


class StateReader:
    """Looks at one stage, from any thread."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._rows: tuple[tuple[BodyId, ...], dict[BodyId, int]] = ((), {})
        self._world: tuple[int, World | None, dict[BodyId, Body]] = (-1, None, {})
        self._lock = threading.Lock()

    def state(self) -> StateSnapshot:
        """The world at the last moment.

        Raises:
            EngineError: the engine is lost, and nobody knows how it is now.
        """
        if self.simulation.engine_error is not None:
            raise self.simulation.engine_error
        return self.simulation.state

    def row_by_id(self, frame: StateSnapshot) -> dict[BodyId, int]:
        """Where in a frame each body has its pose."""
        ids, rows = self._rows
        if ids is not frame.ids:
            rows = {id: row for row, id in enumerate(frame.ids)}
            self._rows = frame.ids, rows
        return rows

    def pose(self, id: str) -> PoseArray:
        """A body's pose, seven numbers.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        frame = self.state()
        row = self.row_by_id(frame).get(BodyId(id))
        if row is None:
            raise self.not_found_error(id, frame.ids)
        pose: PoseArray = frame.poses[row]
        return pose

    def require(self, ids: Iterable[str]) -> None:
        """Makes sure that bodies are there.

        Raises:
            BodyNotFoundError: for the first that is not.
        """
        frame = self.state()
        rows = self.row_by_id(frame)
        for id in ids:
            if id not in rows:
                raise self.not_found_error(id, frame.ids)

    def world(self) -> World:
        """What stands there; where it stands now, the frame tells."""
        return self._refresh_world()[1] or self.simulation.snapshot()

    def body(self, id: str) -> Body:
        """A body as it is described.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        bodies = self._refresh_world()[2]
        body = bodies.get(BodyId(id))
        if body is None:
            raise self.not_found_error(id, bodies)
        return body

    def to_world_frame(self, pose: Pose, frame_id: str) -> Pose:
        """A pose that is told in the frame of a body, or in the world's, in the world.

        Raises:
            BodyNotFoundError: no body is called like the frame.
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
        """The error that says so."""
        worlds = self.simulation.worlds
        return BodyNotFoundError(id, known=known, world=worlds[-1].name if worlds else "")

    def _refresh_world(self) -> tuple[int, World | None, dict[BodyId, Body]]:
        """Asks the engine for its log if anything came, went or changed since it was asked."""
        edition = self.state().revision
        if self._world[0] != edition:
            with self._lock:
                if self._world[0] != edition:
                    world = self.simulation.snapshot()
                    self._world = edition, world, {body.id: body for body in world.bodies}
        return self._world
