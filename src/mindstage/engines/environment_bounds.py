"""The place that a world occupies: its bounds, and bodies that leave it.

Bodies that fall far below all that is loose, with nothing below them, are stopped there, since their poses would grow
without limit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import Engine, MovedBody
from mindstage.errors import SimulationDivergedError
from mindstage.scene import BodyId, World
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.spatial import SCENERY_MIN_SIZE_M
from mindstage.scene.transforms import Array

__all__ = [
    "MAX_FALL_M",
    "MOVED_DISTANCE_M",
    "REST_CHECK_S",
    "EnvironmentBounds",
    "belongs_to_place",
    "find_bodies_that_move",
    "find_moved_bodies",
]

MAX_FALL_M = 10.0
"""Bodies that are farther below what is loose are stopped, unless something is below them [m]."""
MOVED_DISTANCE_M = 0.1
"""Bodies that move farther right after the spawn are reported [m]."""
REST_CHECK_S = 2.0
"""Simulated time for which bodies are observed after a spawn [s]."""
_REST_CHECK_STEP_S = 0.1

_MAX_PLACE_RADIUS_M = 1e3
"""Bodies that are farther from the median position are errors of the map, and do not belong to the place either."""
_LEFT_MARGIN_M = 0.5
"""A body whose center is farther outside of the bounds has left the place [m]."""


@dataclass(frozen=True, slots=True)
class EnvironmentBounds:
    """The axis-aligned bounds of a place."""

    low: Array
    """Lower corner [m]."""
    high: Array
    """Upper corner [m]."""
    fall_limit_m: float = -np.inf
    """The height below which bodies are stopped that have nothing below them [m]."""
    below: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    """Lower and upper corners of what is below this height at least partly, n x 2 x 3 [m]."""

    @classmethod
    def from_boxes(cls, boxes: OrientedBoxes, is_loose: NDArray[np.bool_] | None = None) -> EnvironmentBounds | None:
        """The bounds of all bodies that belong to the place; None without bodies.

        Args:
            boxes: a box around each body.
            is_loose: whether each is loose; by default none is. Falls are measured from the side of a fixed body that
                is next below the lowest one, such as its floor: streets and skies of a map may be hundreds of meters
                lower.
        """
        if not len(boxes.center):
            return None
        low, high = boxes.bounds()
        belongs = belongs_to_place(boxes)
        bounds = cls(low[belongs].min(axis=0), high[belongs].max(axis=0))
        loose = belongs & (False if is_loose is None else is_loose)
        fixed = belongs & ~loose
        from_m = low[loose, 2].min(initial=np.inf) if loose.any() else bounds.low[2]
        from_m = max(low[fixed & (low[:, 2] <= from_m), 2], default=from_m)
        limit_m = float(from_m) - MAX_FALL_M
        is_below = fixed & (low[:, 2] < limit_m)
        return replace(bounds, fall_limit_m=limit_m, below=np.stack([low[is_below], high[is_below]], axis=1))

    def includes(self, boxes: OrientedBoxes) -> NDArray[np.bool_]:
        """For each new body, whether it belongs to the place: neither scenery nor far away."""
        is_scenery = (2 * boxes.half_extents).max(axis=1, initial=0.0) > SCENERY_MIN_SIZE_M
        distance = np.abs(boxes.center - (self.low + self.high) / 2).max(axis=1, initial=0.0)
        return np.asarray(~is_scenery & (distance <= _MAX_PLACE_RADIUS_M))

    def extended(self, low: Array, high: Array) -> EnvironmentBounds:
        """The bounds that contain more bodies as well; their lower and upper corners are n x 3 [m]."""
        return replace(
            self,
            low=np.minimum(self.low, low.min(axis=0, initial=np.inf)),
            high=np.maximum(self.high, high.max(axis=0, initial=-np.inf)),
            fall_limit_m=min(self.fall_limit_m, float(low[:, 2].min(initial=np.inf)) - MAX_FALL_M),
        )

    def falls_for_ever(self, position: Array) -> bool:
        """Whether something at a position, 3 [m], is below the limit of falls and above nothing."""
        low, high = self.below[:, 0], self.below[:, 1]
        is_above = (position >= low).all(axis=1) & (position[:2] <= high[:, :2]).all(axis=1)
        return bool(position[2] < self.fall_limit_m) and not is_above.any()

    def is_left(self, positions: Array) -> NDArray[np.bool_]:
        """Whether positions, n x 3, are outside of the place."""
        is_outside = (positions < self.low - _LEFT_MARGIN_M) | (positions > self.high + _LEFT_MARGIN_M)
        return np.asarray(is_outside.any(axis=1))


def belongs_to_place(boxes: OrientedBoxes) -> NDArray[np.bool_]:
    """For each body, whether it belongs to the place: neither scenery nor far away from most others."""
    is_scenery: NDArray[np.bool_] = (2 * boxes.half_extents).max(axis=1, initial=0.0) > SCENERY_MIN_SIZE_M
    if is_scenery.all():
        is_scenery[:] = False
    if not len(is_scenery):
        return is_scenery
    middle = np.median(boxes.center[~is_scenery], axis=0)
    is_far = np.abs(boxes.center - middle).max(axis=1) > _MAX_PLACE_RADIUS_M
    belongs = ~is_scenery & ~is_far
    return np.asarray(belongs if belongs.any() else ~is_scenery)


def find_moved_bodies(
    ids: Sequence[BodyId], before: Array, after: Array, bounds: EnvironmentBounds | None
) -> tuple[MovedBody, ...]:
    """The bodies that did not stay, farthest first.

    Args:
        ids: the bodies.
        before: their first poses, n x 7.
        after: their later poses, n x 7.
        bounds: the bounds of the place.
    """
    distance = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
    distance = np.where(np.isfinite(distance), distance, np.inf)
    has_left = (
        np.zeros(len(ids), dtype=bool)
        if bounds is None
        else bounds.is_left(after[:, :3]) & ~bounds.is_left(before[:, :3]) & (distance > 0.0)
    )
    rows = np.flatnonzero((distance > MOVED_DISTANCE_M) | has_left)
    return tuple(
        MovedBody(id=ids[row], distance_m=float(distance[row]), left_place=bool(has_left[row]))
        for row in rows[np.argsort(-distance[rows], kind="stable")].tolist()
    )


def find_bodies_that_move(engine: Engine, worlds: Iterable[World]) -> tuple[MovedBody, ...]:
    """Steps an engine by `REST_CHECK_S`, and returns the bodies of worlds that moved away meanwhile, farthest first."""
    ids, poses = engine.poses()
    with suppress(SimulationDivergedError):  # what diverged is far away
        for _ in range(round(REST_CHECK_S / _REST_CHECK_STEP_S)):
            engine.step(_REST_CHECK_STEP_S)
    later_ids, later_poses = engine.poses()
    if ids != later_ids:
        rows = {id: row for row, id in enumerate(later_ids)}
        kept = [row for row, id in enumerate(ids) if id in rows]
        ids, poses = tuple(ids[row] for row in kept), poses[kept]
        later_poses = later_poses[[rows[id] for id in ids]]
    sizes = {body.id: body.size for world in worlds for body in world.bodies}
    extents = np.array([sizes.get(id) or (0.0, 0.0, 0.0) for id in ids], dtype=float).reshape(-1, 3)
    return find_moved_bodies(
        ids, poses, later_poses, EnvironmentBounds.from_boxes(OrientedBoxes.from_poses(poses, extents))
    )
