"""Sight: what can be told of the stage without waiting for it, and what stands there as it was described.

Poses come from the frame that the stage has published last, which is never older than the last call that ended; so a
thousand questions in a second cost the running world nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable

from mindstage.engines import Poses
from mindstage.errors import BodyUnknown
from mindstage.stage import Frame, Stage
from mindstage.world import Body, BodyId, Pose, World
from mindstage.world.geometry import compose, pose_from, unit_pose

__all__ = ["WORLD_FRAMES", "Sight"]

WORLD_FRAMES = frozenset({"", "map", "world"})
"""Names under which the world's own frame is meant; the first that has letters is the one that is told."""


class Sight:
    """Looks at one stage, from any thread."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self._rows: tuple[tuple[BodyId, ...], dict[BodyId, int]] = ((), {})
        self._described: tuple[int, World | None, dict[BodyId, Body]] = (-1, None, {})
        self._describing = threading.Lock()

    def frame(self) -> Frame:
        """The world at the last moment.

        Raises:
            EngineError: the engine is lost, and nobody knows how it is now.
        """
        if self.stage.lost is not None:
            raise self.stage.lost
        return self.stage.frame

    def rows(self, frame: Frame) -> dict[BodyId, int]:
        """Where in a frame each body has its pose."""
        ids, rows = self._rows
        if ids is not frame.ids:
            rows = {id: row for row, id in enumerate(frame.ids)}
            self._rows = frame.ids, rows
        return rows

    def row(self, id: str) -> Poses:
        """A body's pose, seven numbers.

        Raises:
            BodyUnknown: there is no such body.
        """
        frame = self.frame()
        row = self.rows(frame).get(BodyId(id))
        if row is None:
            raise self.unknown(id, frame.ids)
        pose: Poses = frame.poses[row]
        return pose

    def require(self, ids: Iterable[str]) -> None:
        """Makes sure that bodies are there.

        Raises:
            BodyUnknown: for the first that is not.
        """
        frame = self.frame()
        rows = self.rows(frame)
        for id in ids:
            if id not in rows:
                raise self.unknown(id, frame.ids)

    def world(self) -> World:
        """What stands there; where it stands now, the frame tells."""
        return self._look()[1] or self.stage.log()

    def body(self, id: str) -> Body:
        """A body as it is described.

        Raises:
            BodyUnknown: there is no such body.
        """
        bodies = self._look()[2]
        body = bodies.get(BodyId(id))
        if body is None:
            raise self.unknown(id, bodies)
        return body

    def in_world(self, pose: Pose, frame_id: str) -> Pose:
        """A pose that is told in the frame of a body, or in the world's, in the world.

        Raises:
            BodyUnknown: no body is called like the frame.
        """
        name = frame_id.lstrip("/")
        return (
            pose if name in WORLD_FRAMES else pose_from(compose(unit_pose(pose_from(self.row(name))), unit_pose(pose)))
        )

    def unknown(self, id: str, known: Iterable[str]) -> BodyUnknown:
        """The error that says so."""
        worlds = self.stage.worlds
        return BodyUnknown(id, known=known, world=worlds[-1].name if worlds else "")

    def _look(self) -> tuple[int, World | None, dict[BodyId, Body]]:
        """Asks the engine for its log if anything came, went or changed since it was asked."""
        edition = self.frame().edition
        if self._described[0] != edition:
            with self._describing:
                if self._described[0] != edition:
                    world = self.stage.log()
                    self._described = edition, world, {body.id: body for body in world.bodies}
        return self._described
