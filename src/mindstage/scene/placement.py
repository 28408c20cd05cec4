"""Free poses of a body on the level support surfaces of other bodies.

Candidate poses are sampled on a grid over a surface, nearest to its center first, and tested in one batch against the
collision shapes of all bodies nearby. A body without geometry is a box, whose upper side is its only surface.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, permutations
from typing import NamedTuple

import numpy as np

from mindstage.scene.bounding_boxes import OrientedBoxes, footprints, polygon_gaps, polygon_overlap_areas
from mindstage.scene.collision_shapes import (
    CollisionShapeBatch,
    CompiledGeometry,
    compile_geometry,
    fallback_collision_shape,
)
from mindstage.scene.geometry import BodyGeometry, CollisionShape, GeometryMap, SupportSurface
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_multiply,
    quat_multiply,
    quat_rotate,
    rotation_matrix,
)
from mindstage.scene.world_model import Body, BodyId, Pose, Vector

__all__ = ["MIN_UP_COSINE", "FreePlace", "PlacementSampler", "PlacementSurface", "spread_places", "support_surfaces"]


MIN_UP_COSINE = 0.985
"""Cosine of the maximal slope of a support surface, ten degrees."""
_DROP_HEIGHT_M = 0.001
"""Distance above the support surface from which a body is dropped."""
_MARGIN_M = 0.004
"""Distance from the edges of the support surface."""
_MIN_GRID_STEP_M = 0.02
_NEAR_OFFSETS_M = np.arange(-6, 7) * 0.02
"""The finer grid around a point that a body is to be placed near."""
_MAX_CANDIDATES = 625
"""Approximate limit of the candidates for each orientation on one surface."""
_CLEARANCES_M = (0.05, 0.02, 0.01, 0.004, 0.001)
"""Between bodies that are placed together, and to edges: the largest one with which they fit is taken."""
_MAX_ORDERS = 24
"""Number of orders in which bodies are placed together."""
_MAX_TRIES = 60
"""Number of places that are tried for one order."""
_GRID_LINES = 9
"""Along each side of a surface, besides places that are flush with something."""
_ASSUMED_SIZE_M: Vector = (0.1, 0.1, 0.1)


@dataclass(frozen=True, slots=True)
class PlacementSurface:
    """A level support surface at its current pose."""

    body_id: BodyId
    surface: SupportSurface
    pose: Array
    """The pose of its center in the world frame, seven numbers: z is up, x and y are along its sides."""
    size: tuple[float, float]
    """Extents along x and y [m]."""

    def distance(self, point: Vector) -> float:
        """The distance of a point of the world from the rectangle of the surface [m]."""
        offset = quat_rotate(self.pose[3:] * np.array([1.0, -1.0, -1.0, -1.0]), np.asarray(point) - self.pose[:3])
        beside = np.maximum(np.abs(offset[:2]) - np.array(self.size) / 2, 0.0)
        return float(np.linalg.norm([*beside, offset[2]]))


def support_surfaces(
    body: Body, geometry: BodyGeometry | None, pose: Array, *, inside: bool
) -> Iterator[PlacementSurface]:
    """Yields the support surfaces of a body that are level at its current pose.

    Args:
        geometry: its geometry. Without one, or if none of its surfaces on the body is level, such as those of a panel
            that lies flat, the body is a box, with the upper side as the only surface.
        pose: its pose in the world frame, seven numbers.
        inside: whether surfaces in it are yielded, such as shelves, or surfaces on it.
    """
    body_pose = np.concatenate([pose[:3], normalize(pose[3:])])
    known = geometry.support_surfaces if geometry is not None else ()
    surfaces = [surface for surface in known if surface.is_inside is inside]
    level = [each for each in surfaces if quat_rotate(body_pose[3:], each.normal)[2] >= MIN_UP_COSINE]
    if not inside and not level and (surfaces or not known):
        sides = _box_surfaces(body)
        level = [each for each in sides if quat_rotate(body_pose[3:], each.normal)[2] >= MIN_UP_COSINE]
    for surface in level:
        yield _placement_surface(body.id, surface, body_pose)


def _box_surfaces(body: Body) -> Iterator[SupportSurface]:
    """The six sides of a box."""
    size = body.size or _ASSUMED_SIZE_M
    for axis in range(3):
        across = [other for other in range(3) if other != axis]
        for sign in (1.0, -1.0):
            up, center = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
            up[axis], center[axis] = sign, sign * size[axis] / 2
            extent = (size[across[0]], size[across[1]])
            yield SupportSurface(center=(center[0], center[1], center[2]), size=extent, normal=(up[0], up[1], up[2]))


def _placement_surface(id: BodyId, surface: SupportSurface, body_pose: Array) -> PlacementSurface:
    along = np.eye(3)[next(axis for axis in range(3) if axis != np.argmax(np.abs(surface.normal)))]
    x = quat_rotate(body_pose[3:], along)
    yaw = float(np.arctan2(x[1], x[0]))
    middle = body_pose[:3] + quat_rotate(body_pose[3:], surface.center)
    frame = np.array([*middle, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    return PlacementSurface(id, surface, frame, surface.size)


class PlacementSampler:
    """Samples collision-free poses among the bodies of a world."""

    def __init__(
        self,
        bodies: Mapping[BodyId, Body],
        geometry: GeometryMap,
        ids: Sequence[BodyId],
        poses: Array,
        ignored_ids: frozenset[str],
    ) -> None:
        """Prepares the collision shapes of the obstacles.

        Args:
            bodies: the bodies by id.
            ids: the bodies that exist.
            poses: their poses, n x 7, in the order of `ids`.
            ignored_ids: bodies that are not obstacles.
        """
        rows = [row for row, id in enumerate(ids) if id in bodies and id not in ignored_ids]
        self._poses = (
            np.concatenate([poses[rows, :3], normalize(poses[rows, 3:])], axis=1) if rows else np.zeros((0, 7))
        )
        self._ids = [ids[row] for row in rows]
        cache: dict[object, CompiledGeometry] = {}
        self._compiled = [_compiled_geometry(bodies[ids[row]], geometry.get(ids[row]), cache) for row in rows]
        corners = [each.bounds for each in self._compiled]
        low, high = (np.array([pair[end] for pair in corners]).reshape(-1, 3) for end in (0, 1))
        middles = self._poses.copy()
        if rows:
            middles[:, :3] += quat_rotate(self._poses[:, 3:], (low + high) / 2)
        self._low, self._high = OrientedBoxes.from_poses(middles, high - low).bounds()

    def penetration_depths(self, body: Body, geometry: BodyGeometry | None) -> dict[BodyId, float]:
        """How deep the collision shapes of a body, at its pose, are in the obstacles that they penetrate [m]."""
        compiled, pose = _compiled_geometry(body, geometry, {}), normalized_pose_array(body.pose)
        reach = float(np.linalg.norm(np.maximum(np.abs(compiled.bounds[0]), np.abs(compiled.bounds[1]))))
        near = np.flatnonzero(np.all((self._low <= pose[:3] + reach) & (self._high >= pose[:3] - reach), axis=1))
        if not len(near):
            return {}
        parts = CollisionShapeBatch.from_compiled(
            np.concatenate([pose[None], self._poses[near]]), [compiled, *(self._compiled[row] for row in near)]
        )
        others = np.arange(1, len(near) + 1)
        depths = parts.penetration_depths(np.zeros_like(others), others, np.full(len(near), np.inf))
        found = zip(near.tolist(), depths.tolist(), strict=True)
        return {self._ids[row]: depth for row, depth in found if depth > 0.0}

    def is_free(self, body: Body, geometry: BodyGeometry | None) -> bool:
        """Whether the bounding box of a body, in its frame, penetrates nothing at its pose."""
        bounds = _compiled_geometry(body, geometry, {}).bounds
        return bool(self._is_free(_bounding_geometry(*bounds), normalized_pose_array(body.pose)[None])[0])

    def candidate_poses(
        self,
        body: Body,
        geometry: BodyGeometry | None,
        surface: PlacementSurface,
        *,
        max_tested: int | None = None,
        near: Vector | None = None,
    ) -> tuple[list[Pose], str]:
        """The free poses of a body on a surface, nearest to the center first; if there are none, also the reason.

        Args:
            max_tested: how many of the poses are tested, spread evenly over them; None for all.
            near: a point that replaces the center, in the world frame [m].
        """
        low, high = _compiled_geometry(body, geometry, {}).bounds
        if surface.surface.clearance is not None and high[2] - low[2] > surface.surface.clearance:
            return [], f"it is {high[2] - low[2]:.2f} m high, and the clearance is {surface.surface.clearance:.2f} m"
        candidates = np.concatenate([_grid_poses(surface, low, high, quarter, near=near) for quarter in (0, 1)])
        if not len(candidates):
            return [], "it is larger than the support surface"
        center = surface.pose[:2] if near is None else np.asarray(near)[:2]
        order = np.argsort(np.linalg.norm(candidates[:, :2] - center, axis=1).round(6), kind="stable")
        if max_tested is not None:
            order = order[np.unique(np.linspace(0, len(order) - 1, max_tested).astype(int))]
        candidates = candidates[order]
        free = self._is_free(_bounding_geometry(low, high), candidates)
        reason = "" if free.any() else "other bodies occupy the space"
        return [pose_from_array(row) for row in candidates[free]], reason

    def packings(
        self, items: Sequence[tuple[Body, BodyGeometry | None]], surfaces: Sequence[PlacementSurface]
    ) -> Iterator[list[tuple[PlacementSurface, Pose]]]:
        """Arrangements of several bodies on some surfaces, each with less clearance than the one before.

        Bodies are placed one after the other, in all orders for a few of them, flush with edges and with one another,
        or on a grid: what fits off-center or in one order only is found, unless it takes more than some thousand tries.

        Args:
            items: the bodies, whose poses are ignored, with their geometry.
            surfaces: the surfaces, the preferred one first.

        Yields:
            The surface and the pose of each body, in the order of the items.
        """
        bounds = [_compiled_geometry(body, geometry, {}).bounds for body, geometry in items]
        areas = [-float(np.prod((high - low)[:2])) for low, high in bounds]
        largest_first = sorted(range(len(items)), key=areas.__getitem__)
        for clearance_m in _CLEARANCES_M:
            search = _Packing(bounds, surfaces, clearance_m, self._is_free)
            orders = islice(permutations(largest_first), _MAX_ORDERS) if search.is_possible else ()
            found = (search.arrange(order, axis) for order in orders for axis in (1, 0))
            arranged = next((each for each in found if each is not None), None)
            if arranged is not None:
                yield [arranged[number] for number in range(len(items))]

    def free_places(
        self, body: Body, geometry: BodyGeometry | None, surface: PlacementSurface
    ) -> tuple[list[FreePlace], str]:
        """The free poses of a body on a surface with their margins, the largest margin first, then the nearest.

        Without any, also the reason. Arguments are those of `candidate_poses`.
        """
        poses, reason = self.candidate_poses(body, geometry, surface)
        if not poses:
            return [], reason
        low, high = _compiled_geometry(body, geometry, {}).bounds
        placed = pose_array(poses)
        centers = placed.copy()
        centers[:, :3] += quat_rotate(placed[:, 3:], (low + high) / 2)
        boxes = OrientedBoxes.from_poses(centers, np.tile(high - low, (len(poses), 1)))
        margins = self._obstacle_margins(boxes, self._edge_margins(boxes, surface))
        order = np.argsort(-margins.round(6), kind="stable")
        return [FreePlace(poses[at], float(margins[at])) for at in order.tolist()], ""

    @staticmethod
    def _edge_margins(boxes: OrientedBoxes, surface: PlacementSurface) -> Array:
        """The distance of each box to the nearest edge of the surface."""
        turn = rotation_matrix(surface.pose[3:])
        offset = np.abs((boxes.center - surface.pose[:3]) @ turn)[:, :2]
        reach = np.einsum("nij,nj->ni", np.abs(turn.T @ boxes.rotation), boxes.half_extents)[:, :2]
        return np.asarray((np.array(surface.size) / 2 - offset - reach).min(axis=1).clip(0.0))

    def _obstacle_margins(self, boxes: OrientedBoxes, margins: Array) -> Array:
        """The horizontal distance of each box to the nearest collision shape at its height, if less than its margin."""
        low, high = boxes.bounds()
        poses, sizes = [np.zeros((0, 7))], [np.zeros((0, 3))]
        reach = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
        near = np.all((self._low <= high.max(axis=0) + reach) & (self._high >= low.min(axis=0) - reach), axis=1)
        for row in np.flatnonzero(near).tolist():
            compiled = self._compiled[row]
            poses.append(pose_multiply(np.tile(self._poses[row], (len(compiled.poses), 1)), compiled.poses))
            sizes.append(compiled.sizes)
        obstacles = np.concatenate(poses)
        obstacles[:, 3:] = normalize(obstacles[:, 3:])
        shapes = OrientedBoxes.from_poses(obstacles, np.concatenate(sizes))
        shape_low, shape_high = shapes.bounds()
        # the boxes float at one height above their surface, which is no obstacle itself
        bottom, top = float(low[:, 2].min()), float(high[:, 2].max())
        at_height = np.flatnonzero((shape_high[:, 2] > bottom) & (shape_low[:, 2] < top))
        if not len(at_height):
            return margins
        shape_low, shape_high = shape_low[at_height, :2], shape_high[at_height, :2]
        apart = np.maximum(shape_low - high[:, None, :2], low[:, None, :2] - shape_high).clip(0.0)
        a, b = np.nonzero(np.linalg.norm(apart, axis=2) < margins[:, None])
        polygons = np.concatenate([footprints(boxes), footprints(shapes)[at_height]])
        gaps = polygon_gaps(polygons, a, b + len(low))
        meets = np.all(apart[a, b] <= 0.0, axis=1)
        gaps[meets] = np.where(polygon_overlap_areas(polygons, a[meets], b[meets] + len(low)) > 0.0, 0.0, gaps[meets])
        found = margins.copy()
        np.minimum.at(found, a, gaps)
        return found

    def _is_free(self, compiled: CompiledGeometry, candidates: Array) -> Array:
        reach = float(np.linalg.norm(np.maximum(np.abs(compiled.bounds[0]), np.abs(compiled.bounds[1]))))
        low, high = candidates[:, :3].min(axis=0) - reach, candidates[:, :3].max(axis=0) + reach
        near = np.flatnonzero(np.all((self._low <= high) & (self._high >= low), axis=1))
        count = len(candidates)
        if not len(near):
            return np.ones(count, dtype=bool)
        parts = CollisionShapeBatch.from_compiled(
            np.concatenate([candidates, self._poses[near]]), [compiled] * count + [self._compiled[row] for row in near]
        )
        center = candidates[:, None, :3]
        overlap = np.all((center - reach <= self._high[near]) & (self._low[near] <= center + reach), axis=2)
        a, b = np.nonzero(overlap)
        penetrates = parts.penetration_depths(a, b + count, np.full(len(a), np.inf)) > 0.0
        return np.asarray(np.bincount(a[penetrates], minlength=count) == 0)


class _Spot(NamedTuple):
    """A place of one body: the rectangle that it takes on a surface."""

    surface: int
    low: Array
    """Its least corner in the frame of the surface [m]."""
    high: Array
    pose: Array


class _Packing:
    """The search for one arrangement with a given clearance."""

    def __init__(
        self,
        bounds: Sequence[tuple[Array, Array]],
        surfaces: Sequence[PlacementSurface],
        clearance_m: float,
        is_free: Callable[[CompiledGeometry, Array], Array],
    ) -> None:
        self._bounds, self._surfaces, self._clearance_m, self._is_free = bounds, surfaces, clearance_m, is_free
        self._tries, self._axis = 0, 0

    @property
    def is_possible(self) -> bool:
        """Whether the surfaces have at least the area of all bodies."""
        gap = self._clearance_m
        needed = sum(float(np.prod((high - low)[:2] + gap)) for low, high in self._bounds)
        return needed <= sum(max(each.size[0] - gap, 0.0) * max(each.size[1] - gap, 0.0) for each in self._surfaces)

    def arrange(self, order: Sequence[int], axis: int) -> dict[int, tuple[PlacementSurface, Pose]] | None:
        """Places bodies in an order, in rows that follow one another along an axis; None if that does not succeed."""
        self._tries, self._axis = _MAX_TRIES, axis
        spots = self._complete(order, [])
        if spots is None:
            return None
        placed = zip(order, spots, strict=True)
        return {number: (self._surfaces[spot.surface], pose_from_array(spot.pose)) for number, spot in placed}

    def _complete(self, order: Sequence[int], placed: list[_Spot]) -> list[_Spot] | None:
        if len(placed) == len(order):
            return placed
        for spot in self._spots(order[len(placed)], placed):
            self._tries -= 1
            if self._tries < 0:
                return None
            if (found := self._complete(order, [*placed, spot])) is not None:
                return found
        return None

    def _spots(self, number: int, placed: Sequence[_Spot]) -> Iterator[_Spot]:
        """The free places of a body beside those that are placed."""
        low, high = self._bounds[number]
        for at, surface in enumerate(self._surfaces):
            if surface.surface.clearance is not None and high[2] - low[2] > surface.surface.clearance:
                continue
            others = [each for each in placed if each.surface == at]
            for quarter in (0, 1):
                extent = (high - low)[:2] if quarter == 0 else (high - low)[1::-1]
                corners = self._corners(surface, extent, others)
                if not len(corners):
                    continue
                poses = _poses_on(surface, low, high, quarter, corners + extent / 2)
                free = self._is_free(_bounding_geometry(low, high), poses)
                for corner, pose in zip(corners[free], poses[free], strict=True):
                    yield _Spot(at, corner, corner + extent, pose)

    def _corners(self, surface: PlacementSurface, extent: Array, others: Sequence[_Spot]) -> Array:
        """Least corners of where a rectangle is on the surface, apart from others: flush ones, then those of a grid."""
        gap, half = self._clearance_m, np.array(surface.size) / 2 - self._clearance_m
        if np.any(2 * half < extent):
            return np.zeros((0, 2))
        flush = np.array([-half, half - extent, -extent / 2])
        beside = [corner for each in others for corner in (each.high + gap, each.low - gap - extent)]
        grid = np.linspace(-half, half - extent, _GRID_LINES)
        lines = (np.concatenate([flush, np.reshape(beside, (-1, 2))]), grid)
        corners = np.concatenate(
            [np.stack(np.meshgrid(*each.T, indexing="ij"), axis=-1).reshape(-1, 2) for each in lines]
        )
        ends = corners + extent
        fits = np.all((corners >= -half - 1e-9) & (ends <= half + 1e-9), axis=1)
        for each in others:
            fits &= np.any((corners >= each.high + gap - 1e-9) | (ends <= each.low - gap + 1e-9), axis=1)
        corners = corners[fits]
        return np.asarray(corners[np.lexsort((corners[:, 1 - self._axis], corners[:, self._axis]))])


def _compiled_geometry(
    body: Body, geometry: BodyGeometry | None, cache: dict[object, CompiledGeometry]
) -> CompiledGeometry:
    key: object = geometry.key if geometry is not None else (body.shape, body.size)
    if key not in cache:
        cache[key] = compile_geometry(
            geometry.collision_shapes
            if geometry is not None
            else (fallback_collision_shape(body, body.size or _ASSUMED_SIZE_M),)
        )
    return cache[key]


def _bounding_geometry(low: Array, high: Array) -> CompiledGeometry:
    """The bounding box of a body as its collision shape, which also reserves the space inside its concavities."""
    (x, y, z), (a, b, c) = ((low + high) / 2).tolist(), (high - low).tolist()
    return compile_geometry((CollisionShape(size=(a, b, c), pose=Pose((x, y, z))),))


def _grid_poses(
    surface: PlacementSurface, low: Array, high: Array, quarter: int, *, near: Vector | None = None
) -> Array:
    """Poses on a grid over a surface, rotated about z by quarter turns, for a body with the bounds low and high [m].

    With a point, also poses on a finer grid around what is nearest to it.
    """
    turn = np.array([np.cos(quarter * np.pi / 4), 0.0, 0.0, np.sin(quarter * np.pi / 4)])
    corners = quat_rotate(turn, np.array([low, high]))
    least, most = corners.min(axis=0), corners.max(axis=0)
    room = np.array(surface.size) - (most - least)[:2] - 2 * _MARGIN_M
    if (room < 0.0).any():
        return np.zeros((0, 7))
    finest = max(_MIN_GRID_STEP_M, float(np.sqrt(room.prod() / _MAX_CANDIDATES)))
    steps = [np.linspace(-extent / 2, extent / 2, 2 * int(extent / finest / 2) + 1) for extent in room]
    middles = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    if near is not None:
        inverse = surface.pose[3:] * np.array([1.0, -1.0, -1.0, -1.0])
        target = quat_rotate(inverse, np.asarray(near) - surface.pose[:3])[:2]
        around = np.stack(np.meshgrid(_NEAR_OFFSETS_M, _NEAR_OFFSETS_M, indexing="ij"), axis=-1).reshape(-1, 2)
        middles = np.concatenate([np.unique(np.clip(target + around, -room / 2, room / 2), axis=0), middles])
    return _poses_on(surface, low, high, quarter, middles)


def _poses_on(surface: PlacementSurface, low: Array, high: Array, quarter: int, middles: Array) -> Array:
    """Poses of a body with some bounds whose box has its middle, seen from above, at points of a surface, n x 2 [m]."""
    turn = np.array([np.cos(quarter * np.pi / 4), 0.0, 0.0, np.sin(quarter * np.pi / 4)])
    corners = quat_rotate(turn, np.array([low, high]))
    least, most = corners.min(axis=0), corners.max(axis=0)
    local = np.zeros((len(middles), 7))
    local[:, :2] = middles - (least + most)[:2] / 2
    local[:, 2] = _DROP_HEIGHT_M - least[2]
    local[:, 3:] = turn
    placed = pose_multiply(np.tile(surface.pose, (len(local), 1)), local)
    placed[:, 3:] = normalize(quat_multiply(surface.pose[3:], local[:, 3:]))
    return placed


@dataclass(frozen=True, slots=True)
class FreePlace:
    """A free pose on a surface."""

    pose: Pose
    margin: float
    """The horizontal distance of the body's box to the nearest obstacle at its height or edge of the surface [m]."""


def spread_places(places: Sequence[FreePlace], size: Vector, count: int) -> list[int]:
    """Returns the indices of the first places, up to a count, at which bodies of one size do not meet."""
    kept: list[int] = []
    diagonal = float(np.linalg.norm(size[:2]))
    positions = np.array([place.pose.position for place in places]).reshape(-1, 3)
    usable = np.ones(len(places), dtype=bool)
    while len(kept) < count and usable.any():
        at = int(np.argmax(usable))
        kept.append(at)
        offset = np.abs(positions - positions[at])
        usable &= (np.linalg.norm(offset[:, :2], axis=1) > diagonal) | (offset[:, 2] > size[2])
    return kept
