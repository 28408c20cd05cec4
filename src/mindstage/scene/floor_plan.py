"""Floor plans: the free space of a disc-shaped robot on the floor, paths in it, what blocks it, and rooms within walls.

The obstacles are the footprints of all collision shapes between the height of a step and the height of the robot. Their
exact distances are computed at the centers of square cells. A cell is free if its center is at least

    sqrt(radius^2 + cell^2 / 2)

from every footprint: then no straight move between two neighboring free cells, which is at most sqrt(2) cell long,
comes nearer than the radius to a convex footprint (the squared distance along a segment of length L is at least
min(d1, d2)^2 - L^2 / 4). Paths are shortest on the grid with eight neighbors (Dijkstra), then shortened by straight
lines that keep the same clearance exactly.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import ceil, hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.bounding_boxes import Indices, footprints, polygon_areas
from mindstage.scene.geometry import GeometryMap
from mindstage.scene.joint_kinematics import RigidGroups
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.ray_casting import ShapeScene
from mindstage.scene.spatial import SpatialRelations
from mindstage.scene.transforms import Array
from mindstage.scene.world_model import World

__all__ = ["FloorPath", "FloorPlan", "WallRooms", "find_floor", "free_floor_place", "wall_rooms"]

CELL_M = 0.05
"""Extent of a cell; larger on floors of more than `_MAX_CELLS`."""
_MAX_CELLS = 200_000
STEP_HEIGHT_M = 0.03
"""A robot drives over lower things, such as carpets and thresholds."""
_MARGIN_M = 1.0
"""Free space around everything, where there is no floor body."""
_MIN_FLOOR_AREA_M2, _MAX_FLOOR_THICKNESS_M = 4.0, 0.5
_SAME_LEVEL_M = 0.03
_MOVABLE_PENALTY, _FIXED_PENALTY = 100.0, 10_000.0
"""Cost of a blocked cell in cells, for the question which bodies are in the way: movable ones first."""
_PAIRS_AT_ONCE = 1 << 18
"""Number of pairs of cell and polygon per chunk, which bounds the memory."""
_NEIGHBORS = ((1, 0), (0, 1), (1, 1), (1, -1))
"""Offsets of half of the neighbors of a cell, in cells."""


def find_floor(bodies: BodyBoxes, *, below: float | None = None) -> tuple[float, tuple[int, ...]]:
    """Returns the height of the floor [m], and the rows of the bodies that it is made of.

    A floor is a level slab of at least 4 m² and at most 0.5 m thick. Of several the highest one below a height is
    used; without any, the floor is the plane at the lowest point of all bodies.

    Args:
        bodies: the boxes of all bodies.
        below: the height of what stands on the floor [m]; None for the lowest floor.
    """
    if not bodies.bodies:
        return 0.0, ()
    extent = bodies.high - bodies.low
    area = polygon_areas(footprints(bodies.boxes))
    slab = (extent[:, 2] <= _MAX_FLOOR_THICKNESS_M) & (area >= _MIN_FLOOR_AREA_M2)
    slab &= extent[:, 2] < np.minimum(extent[:, 0], extent[:, 1])
    top = bodies.high[:, 2]
    if below is not None:
        slab &= top <= below + _SAME_LEVEL_M
    rows = np.flatnonzero(slab)
    if not len(rows):
        return float(bodies.low[:, 2].min()), ()
    level = float(top[rows].min() if below is None else top[rows].max())
    return level, tuple(rows[np.abs(top[rows] - level) <= _SAME_LEVEL_M].tolist())


class _Grid:
    """Square cells; an index is flat, and y runs fastest."""

    def __init__(self, origin: Array, cell: float, shape: tuple[int, int]) -> None:
        """Stores the center of the first cell [m], the extent of a cell [m], and the number of cells along x and y."""
        self.origin, self.cell, self.shape = origin, cell, shape

    @property
    def count(self) -> int:
        """The number of cells."""
        return self.shape[0] * self.shape[1]

    def centers(self, cells: Indices) -> Array:
        """The centers of cells, n x 2 [m]."""
        return np.asarray(self.origin + np.stack(np.unravel_index(cells, self.shape), axis=1) * self.cell)

    def cell_at(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """The column and row of the cell of each point, n x 2, and whether the point is on the grid."""
        at = np.round((points - self.origin) / self.cell).astype(int)
        return at, np.all((at >= 0) & (at < self.shape), axis=-1)

    def near(
        self, polygons: Array, reach: float, *, used: NDArray[np.bool_] | None = None
    ) -> Iterator[tuple[Indices, Indices]]:
        """Yields pairs of a cell whose center is within a distance of a convex polygon, and the polygon, in chunks.

        Args:
            polygons: n x 6 x 2 [m].
            reach: the distance, inclusive [m].
            used: for each cell, whether it may be in a pair; None for all.
        """
        windows = _Windows(self, polygons, reach)
        for rows in windows.chunks(np.arange(len(polygons))):
            yield windows.near(rows, used)

    def covered(self, polygons: Array, reach: float) -> NDArray[np.bool_]:
        """Whether the center of each cell is within a distance of one of some polygons, of the grid's shape."""
        found = np.zeros(self.count, dtype=bool)
        windows = _Windows(self, polygons, reach)
        pending = np.arange(len(polygons))
        while len(pending):
            rows = next(windows.chunks(pending))
            found[windows.near(rows, None)[0]] = True
            pending = pending[len(rows) :]
            if len(pending) and len(rows) < _CROWDED_CHUNK:  # large windows are covered by a few polygons
                pending = pending[windows.any_open(pending, found)]
        return found.reshape(self.shape)


_CROWDED_CHUNK = 1024
"""Polygons of a chunk below which it is worth while to look for windows that are covered already."""


class _Windows:
    """The rectangles of cells around polygons."""

    def __init__(self, grid: _Grid, polygons: Array, reach: float) -> None:
        self._grid, self._polygons, self._reach = grid, polygons, reach
        shape = np.array(grid.shape)
        low = (polygons.min(axis=1) - reach - grid.origin) / grid.cell
        high = (polygons.max(axis=1) + reach - grid.origin) / grid.cell
        self._first = np.clip(np.ceil(low - 1e-6), 0, shape).astype(np.intp)
        self._span = np.maximum(np.clip(np.floor(high + 1e-6) + 1, 0, shape).astype(np.intp) - self._first, 0)
        self._count = self._span.prod(axis=1)
        self._center = polygons.mean(axis=1)
        away = polygons - self._center[:, None]
        self._outer = np.sqrt(np.sum(away * away, axis=2).max(axis=1, initial=0.0))
        side = np.roll(polygons, -1, axis=1) - polygons
        length = np.sqrt(np.sum(side * side, axis=2))
        height = np.abs(side[..., 0] * away[..., 1] - side[..., 1] * away[..., 0])
        self._has_area = polygon_areas(polygons) > 1e-12
        inner = np.divide(height, length, out=np.full(length.shape, np.inf), where=length > 1e-9).min(axis=1)
        self._inner = np.where(self._has_area, inner, 0.0)

    def chunks(self, rows: Indices) -> Iterator[Indices]:
        """Consecutive parts of the rows, of few pairs each."""
        ends = np.cumsum(self._count[rows])
        start = 0
        while start < len(rows):
            done = int(ends[start - 1]) if start else 0
            end = max(start + 1, int(np.searchsorted(ends, done + _PAIRS_AT_ONCE, side="right")))
            yield rows[start:end]
            start = end

    def near(self, rows: Indices, used: NDArray[np.bool_] | None) -> tuple[Indices, Indices]:
        """The pairs of some polygons, as in `_Grid.near`."""
        counts = self._count[rows]
        which = np.repeat(rows, counts)
        at = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        across = np.repeat(self._span[rows, 1], counts)
        column = at // np.maximum(across, 1)
        row = at - column * across + np.repeat(self._first[rows, 1], counts)
        column += np.repeat(self._first[rows, 0], counts)
        cells = column * self._grid.shape[1] + row
        if used is not None:
            kept = np.flatnonzero(used[cells])
            which, column, row, cells = which[kept], column[kept], row[kept], cells[kept]
        x, y = self._grid.origin[0] + column * self._grid.cell, self._grid.origin[1] + row * self._grid.cell
        away_x, away_y = x - self._center[which, 0], y - self._center[which, 1]
        apart = away_x * away_x + away_y * away_y
        is_near = apart <= (self._reach + self._inner * (1.0 - 1e-9))[which] ** 2
        unsure = np.flatnonzero(~is_near & (apart <= ((self._reach + self._outer) * (1.0 + 1e-9))[which] ** 2))
        exact = which[unsure]
        distance = _distances(x[unsure], y[unsure], self._polygons[exact], self._has_area[exact])
        is_near[unsure] = distance <= self._reach
        return cells[is_near], which[is_near]

    def any_open(self, rows: Indices, covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether each window has a cell that is not covered, from a summed area table (Crow 1984)."""
        total = np.zeros(np.add(self._grid.shape, 1), dtype=np.intp)
        total[1:, 1:] = (~covered.reshape(self._grid.shape)).cumsum(axis=0).cumsum(axis=1)
        (x, y), (end_x, end_y) = self._first[rows].T, (self._first + self._span)[rows].T
        return np.asarray(total[end_x, end_y] - total[x, end_y] - total[end_x, y] + total[x, y] > 0)


@dataclass(frozen=True, slots=True, eq=False)
class FloorPath:
    """A shortest path of a robot's center on the floor."""

    points: Array
    """k x 2 [m]; one point if the start is the goal."""
    length: float
    """[m]."""
    clearance: float
    """The smallest distance between the path and a footprint, less the radius of the robot [m]; infinite without
    any."""


class FloorPlan:
    """The free space of a robot on the floor."""

    def __init__(
        self,
        groups: RigidGroups,
        scene: ShapeScene,
        *,
        radius: float,
        height: float,
        level: float,
        floor: Collection[int] = (),
        ignored: Collection[int] = (),
    ) -> None:
        """Computes the grid.

        Args:
            groups: the rigid groups of the bodies.
            scene: their shapes, in the same order.
            radius: radius of the robot [m].
            height: height of the robot [m]: it passes below what is higher.
            level: height of the floor [m].
            floor: rows of the bodies that are the floor; the robot stays above them. Without any it may go anywhere.
            ignored: rows of bodies that are no obstacles, such as the robot and the walls that enclose everything.
        """
        self.radius, self.level = radius, level
        boxes = scene.shape_boxes
        low, high = boxes.bounds()
        skipped = np.isin(scene.owner, [*ignored, *floor])
        tall = (high[:, 2] > level + STEP_HEIGHT_M) & (low[:, 2] < level + height)
        rows = np.flatnonzero(tall & ~skipped)
        self._owner = scene.owner[rows]
        prints = footprints(boxes)
        self._polygons = prints[rows]
        self._low, self._high = self._polygons.min(axis=1), self._polygons.max(axis=1)
        slabs = prints[np.isin(scene.owner, list(floor))]
        everything = (slabs if len(slabs) else self._polygons).reshape(-1, 2)
        edge = 0.0 if len(slabs) else _MARGIN_M + 2 * radius
        first, last = (
            (everything.min(axis=0) - edge, everything.max(axis=0) + edge)
            if len(everything)
            else (np.full(2, -_MARGIN_M), np.full(2, _MARGIN_M))
        )
        self.cell = max(CELL_M, sqrt(float(np.prod(last - first)) / _MAX_CELLS))
        shape = [max(1, ceil(extent / self.cell)) for extent in (last - first).tolist()]
        self._grid = _Grid(first + self.cell / 2, self.cell, (shape[0], shape[1]))
        self.shape = self._grid.shape
        self._required = sqrt(radius * radius + self.cell * self.cell / 2)
        self.is_floor = self._grid.covered(slabs, 0.0) if len(slabs) else np.ones(self.shape, dtype=bool)
        self.is_free = self.is_floor & ~self._grid.covered(self._polygons, np.nextafter(self._required, 0.0))
        self._is_movable = (groups.is_dynamic | groups.is_jointed)[self._owner]

    # -- cells ---------------------------------------------------------------------------------------------------------

    def centers(self, cells: Indices) -> Array:
        """The centers of cells, n x 2 [m]; cells are indices into the flat grid."""
        return self._grid.centers(cells)

    def cells_near(self, polygons: Array, reach: float, *, free: bool = True) -> Indices:
        """The cells of the floor whose centers are within a distance of some polygons [m]; only free ones, or all."""
        used = (self.is_free if free else self.is_floor).reshape(-1)
        found = [cells for cells, _ in self._grid.near(polygons, reach, used=used)]
        return np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.intp)

    def nearest_cell(self, point: Array, *, free: bool) -> int | None:
        """The cell nearest to a point, or the nearest free one within the radius and two cells; None without one."""
        if not free:
            at, inside = self._grid.cell_at(point)
            return int(at[0] * self.shape[1] + at[1]) if inside else None
        cells = self.cells_near(np.tile(point, (1, 6, 1)), self.radius + 2 * self.cell)
        if not len(cells):
            return None
        return int(cells[np.argmin(np.linalg.norm(self.centers(cells) - point, axis=1))])

    # -- paths ---------------------------------------------------------------------------------------------------------

    def lengths_to(self, starts: Indices, polygons: Array, reach: float) -> Array:
        """The length of the shortest path from some cells to within a distance of each polygon [m].

        Args:
            starts: free cells.
            polygons: n x 6 x 2 [m].
            reach: the largest distance of the end of a path from the polygon [m].

        Returns:
            n lengths on the grid [m]; infinite without a path.
        """
        length = self.lengths(starts)
        found = np.full(len(polygons), np.inf)
        for cells, rows in self._grid.near(polygons, reach, used=np.isfinite(length)):
            np.minimum.at(found, rows, length[cells])
        return found

    def lengths(self, starts: Indices) -> Array:
        """The length of the shortest path from some cells to each cell of the flat grid [m]; infinite without one."""
        return np.asarray(self._search(starts)[0])

    def path(self, starts: Indices, goals: Indices) -> FloorPath | None:
        """The shortest path from one of some free cells to one of others; None if there is none."""
        if not len(starts) or not len(goals):
            return None
        length, previous = self._search(starts)
        goal = int(goals[np.argmin(length[goals])])
        if not np.isfinite(length[goal]):
            return None
        points = self._shortened(self.centers(_trace(previous, goal)))
        steps = np.diff(points, axis=0)
        distance = _segment_polygon_distances(points, self._polygons).min(initial=np.inf)
        return FloorPath(points, float(np.hypot(steps[:, 0], steps[:, 1]).sum()), float(distance) - self.radius)

    def blockers(self, starts: Indices, goals: Indices) -> tuple[int, ...]:
        """Rows of the bodies on the easiest way from one cell to another: movable ones are easier than fixed ones.

        Empty if not even the removal of all obstacles would open a way.
        """
        penalty = np.zeros(self.shape)
        strictly = np.nextafter(self._required, 0.0)
        is_fixed = self._grid.covered(self._polygons[~self._is_movable], strictly)
        blocked = ~self.is_free
        penalty[blocked] = np.where(is_fixed[blocked], _FIXED_PENALTY, _MOVABLE_PENALTY) * self.cell
        length, previous = self._search(starts, passable=self.is_floor, penalty=penalty)
        if not len(goals) or not np.isfinite(length[goals]).any():
            return ()
        cells = _trace(previous, int(goals[np.argmin(length[goals])]))
        crossed = cells[blocked.reshape(-1)[cells]]
        place = np.full(self._grid.count, -1, dtype=np.intp)
        place[crossed] = np.arange(len(crossed))
        pairs = [np.zeros((0, 2), dtype=np.intp)]
        for near, rows in self._grid.near(self._polygons, strictly, used=place >= 0):
            pairs.append(np.stack([place[near], rows], axis=1))
        found = np.concatenate(pairs)
        order = np.lexsort((found[:, 1], found[:, 0]))
        return tuple(dict.fromkeys(self._owner[found[order, 1]].tolist()))

    def _search(
        self, starts: Indices, *, passable: NDArray[np.bool_] | None = None, penalty: Array | None = None
    ) -> tuple[Array, Indices]:
        """Dijkstra's algorithm from several cells at once: lengths and predecessors of all cells, flat."""
        allowed = self.is_free if passable is None else passable
        count = self._grid.count
        number = np.arange(count).reshape(self.shape)
        sources, targets, weights = [], [], []
        for dx, dy in _NEIGHBORS:
            here = (slice(0, self.shape[0] - dx), slice(max(0, -dy), self.shape[1] - max(0, dy)))
            there = (slice(dx, self.shape[0]), slice(max(0, dy), self.shape[1] - max(0, -dy)))
            open_ = allowed[here] & allowed[there]
            a, b = number[here][open_], number[there][open_]
            weight = np.full(len(a), hypot(dx, dy) * self.cell)
            if penalty is not None:
                weight = weight + (penalty[here][open_] + penalty[there][open_]) / 2
            sources.append(a)
            targets.append(b)
            weights.append(weight)
        from scipy.sparse import csr_matrix  # here, since questions that need no path are to start fast
        from scipy.sparse.csgraph import dijkstra

        graph = csr_matrix(
            (np.concatenate(weights), (np.concatenate(sources), np.concatenate(targets))), (count, count)
        )
        if not len(starts):
            return np.full(count, np.inf), np.full(count, -9999, dtype=np.intp)
        length, previous, _ = dijkstra(graph, directed=False, indices=starts, return_predecessors=True, min_only=True)
        return length, previous

    def _shortened(self, points: Array) -> Array:
        """A path with straight lines in place of detours, as far as they keep the clearance and stay on the floor."""
        kept, at = [0], 0
        corners = [0, *_corner_indices(points), len(points) - 1]
        while at < len(points) - 1:
            ahead = [corner for corner in corners if corner > at]
            low, high = 0, len(ahead) - 1
            while low < high:  # the farthest of the corners that can be seen, assuming that nearer ones can be, too
                middle = (low + high + 1) // 2
                low, high = (middle, high) if self._is_clear(points[at], points[ahead[middle]]) else (low, middle - 1)
            at = ahead[low]
            kept.append(at)
        return points[kept] if len(points) > 1 else points

    def _is_clear(self, a: Array, b: Array) -> bool:
        reach = self.radius + self.cell
        near = np.all((self._low <= np.maximum(a, b) + reach) & (self._high >= np.minimum(a, b) - reach), axis=1)
        distance = _segment_polygon_distances(np.stack([a, b]), self._polygons[near]).min(initial=np.inf)
        if distance < self.radius:
            return False
        count = max(2, ceil(float(np.linalg.norm(b - a)) / (self.cell / 4)))
        at, _ = self._grid.cell_at(np.linspace(a, b, count))
        return bool(self.is_floor[at[:, 0], at[:, 1]].all())


_CLEARANCES_M = (0.8, 0.5, 0.3, 0.15, 0.05)
"""Distances from everything else at which a free place is searched, one after the other [m]."""


def free_floor_place(
    world: World,
    geometry: GeometryMap,
    *,
    radius: float,
    height: float,
    near: tuple[float, float] | None = None,
) -> tuple[float, float, float] | None:
    """A place on the floor where something fits, in the middle of the floor and away from everything else.

    Args:
        world: the bodies.
        geometry: their shapes.
        radius: radius of what is to stand there [m].
        height: its height [m].
        near: x, y [m] of a point; the place is then the nearest one to it where it fits.

    Returns:
        x, y and the height of the floor [m]; None if it fits nowhere.
    """
    bodies = BodyBoxes.from_bodies(world.bodies)
    level, floor = find_floor(bodies)
    slabs = {bodies.bodies[row].id for row in floor}
    enclosing = set(SpatialRelations(world).enclosing_bodies)
    groups, scene = RigidGroups.from_world(world), ShapeScene(world.bodies, geometry)
    for clearance in _CLEARANCES_M if near is None else _CLEARANCES_M[-1:]:
        plan = FloorPlan(
            groups,
            scene,
            radius=radius + clearance,
            height=height,
            level=level,
            floor=[row for row, body in enumerate(world.bodies) if body.id in slabs],
            ignored=[row for row, body in enumerate(world.bodies) if body.id in enclosing],
        )
        cells = np.flatnonzero(plan.is_free & (_edge_distances(plan.is_floor) * plan.cell >= radius))
        if len(cells):
            centers = plan.centers(cells)
            middle = centers.mean(axis=0) if near is None else np.array(near)
            x, y = centers[np.argmin(np.linalg.norm(centers - middle, axis=1))].tolist()
            return x, y, level
    return None


def _edge_distances(is_floor: NDArray[np.bool_]) -> Array:
    """The distance of each cell from the nearest one that is not floor, in cells."""
    from scipy.ndimage import distance_transform_edt  # see above

    distances: Array = distance_transform_edt(np.pad(is_floor, 1))
    return distances[1:-1, 1:-1]


def _trace(previous: Indices, goal: int) -> Indices:
    cells = [goal]
    while previous[cells[-1]] >= 0:
        cells.append(int(previous[cells[-1]]))
    return np.array(cells[::-1])


def _corner_indices(points: Array) -> list[int]:
    """Where the direction of a path changes."""
    steps = np.diff(points, axis=0).round(9)
    return (np.flatnonzero(np.any(steps[1:] != steps[:-1], axis=1)) + 1).tolist()


def _distances(x: Array, y: Array, polygons: Array, has_area: NDArray[np.bool_]) -> Array:
    """The distance of each point to its convex polygon [m]; 0 inside.

    Args:
        x: of each point [m], of any shape that `polygons` without its last two axes broadcasts with.
        y: of each point [m].
        polygons: ... x k x 2 corners, counterclockwise [m].
        has_area: for each polygon, whether it has an inside.
    """
    squared: float | Array = np.inf
    inside: NDArray[np.bool_] = np.broadcast_to(has_area, np.broadcast_shapes(x.shape, polygons.shape[:-2])).copy()
    corners = polygons.shape[-2]
    for at in range(corners):
        start, end = polygons[..., at, :], polygons[..., (at + 1) % corners, :]
        side_x, side_y = end[..., 0] - start[..., 0], end[..., 1] - start[..., 1]
        length = side_x * side_x + side_y * side_y
        extended = length > 1e-18
        away_x, away_y = x - start[..., 0], y - start[..., 1]
        share = (away_x * side_x + away_y * side_y) / np.where(extended, length, 1.0)
        share = np.where(extended, np.clip(share, 0.0, 1.0), 0.0)
        inside &= (side_x * away_y - side_y * away_x >= 0.0) | ~extended
        away_x = away_x - share * side_x
        away_y = away_y - share * side_y
        squared = np.minimum(squared, away_x * away_x + away_y * away_y)
    return np.asarray(np.where(inside, 0.0, np.sqrt(squared)))


def _point_polygon_distances(points: Array, polygons: Array) -> Array:
    """The distance of each point to each convex polygon, n x m [m]; 0 inside."""
    return _distances(points[:, :1], points[:, 1:], polygons[None], polygon_areas(polygons) > 1e-12)


def _segment_polygon_distances(points: Array, polygons: Array) -> Array:
    """The distance of each segment of a path to each convex polygon, k-1 x m [m]; of a single point, 1 x m."""
    if not len(polygons):
        return np.full((1, 1), np.inf)
    if len(points) < 2:
        return _point_polygon_distances(points, polygons)
    ends = _point_polygon_distances(points, polygons)
    found = np.minimum(ends[:-1], ends[1:])
    corners = polygons.reshape(-1, 2)
    for row, (a, b) in enumerate(itertools.pairwise(points)):
        along = b - a
        squared = max(float(along @ along), 1e-300)
        share = np.clip(((corners - a) @ along) / squared, 0.0, 1.0)
        off = corners - a - share[:, None] * along
        near = np.sqrt(np.sum(off * off, axis=1)).reshape(polygons.shape[:2]).min(axis=1)
        side = along[0] * (polygons[..., 1] - a[1]) - along[1] * (polygons[..., 0] - a[0])
        found[row] = np.where(_crosses(a, b, polygons, side), 0.0, np.minimum(found[row], near))
    return found


def _crosses(a: Array, b: Array, polygons: Array, side: Array) -> NDArray[np.bool_]:
    """Whether a segment crosses a side of each polygon; `side` is the side of the line on which each corner is."""
    start, end = polygons, np.roll(polygons, -1, axis=1)
    edge = end - start
    from_a = edge[..., 0] * (a[1] - start[..., 1]) - edge[..., 1] * (a[0] - start[..., 0])
    from_b = edge[..., 0] * (b[1] - start[..., 1]) - edge[..., 1] * (b[0] - start[..., 0])
    other_side = np.roll(side, -1, axis=1)
    return np.asarray(np.any((side * other_side < 0.0) & (from_a * from_b < 0.0), axis=1))


# -- rooms -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class WallRooms:
    """Rooms as regions of the floor that walls surround."""

    origin: Array
    cell: float
    number: NDArray[np.intp]
    """For each cell, the number of its room, from 1 in decreasing order of areas; 0 outside of rooms."""
    areas: tuple[float, ...]
    """[m²]."""
    walls: tuple[tuple[int, ...], ...]
    """For each room, the walls around it, as rows of the given footprints."""

    def room_at(self, points: Array) -> Indices:
        """The number of the room at each point, n x 2 [m]; 0 outside of rooms."""
        at = np.round((points - self.origin) / self.cell).astype(int)
        inside = np.all((at >= 0) & (at < self.number.shape), axis=1)
        clipped = np.clip(at, 0, np.array(self.number.shape) - 1)
        return np.asarray(np.where(inside, self.number[clipped[:, 0], clipped[:, 1]], 0))


def wall_rooms(walls: Array, *, opening: float = 1.3, min_area: float = 1.0) -> WallRooms:
    """Finds the rooms within walls, by morphological segmentation (Bormann et al. 2016, "Room segmentation").

    Free space narrower than `opening` is a door and separates rooms; the remaining regions that do not reach the
    outside are rooms. Each other free cell belongs to the room with the nearest such cell.

    Args:
        walls: the footprints of walls, closed doors and windows, n x 6 x 2 [m].
        opening: the largest width of a door [m].
        min_area: the smallest area of a room [m²].
    """
    if not len(walls):
        return WallRooms(np.zeros(2), CELL_M, np.zeros((1, 1), dtype=np.intp), (), ())
    low, high = walls.reshape(-1, 2).min(axis=0) - opening, walls.reshape(-1, 2).max(axis=0) + opening
    cell = max(CELL_M, sqrt(float(np.prod(high - low)) / _MAX_CELLS))
    shape = [ceil(extent / cell) + 1 for extent in (high - low).tolist()]
    grid = _Grid(low, cell, (shape[0], shape[1]))
    covered = [np.stack(pair) for pair in grid.near(walls, cell * 0.71)]
    cells, owners = np.concatenate(covered, axis=1)
    is_wall = np.zeros(shape, dtype=bool)
    is_wall.reshape(-1)[cells] = True
    from scipy.ndimage import distance_transform_edt, label  # see above

    space = distance_transform_edt(~is_wall) * cell
    cores, count = label(space > opening / 2, structure=np.ones((3, 3)))
    outside = set(np.concatenate([cores[0], cores[-1], cores[:, 0], cores[:, -1]]).tolist())
    _, nearest = distance_transform_edt(cores == 0, return_indices=True)
    grown = np.where(is_wall, 0, cores[nearest[0], nearest[1]])
    sizes = np.bincount(grown.reshape(-1), minlength=count + 1) * cell * cell
    kept = [each for each in range(1, count + 1) if each not in outside and sizes[each] >= min_area]
    kept.sort(key=lambda each: (-sizes[each], each))
    numbers = np.zeros(count + 1, dtype=np.intp)
    numbers[kept] = np.arange(1, len(kept) + 1)
    number = numbers[grown]
    return WallRooms(
        low, cell, number, tuple(float(sizes[each]) for each in kept), _walls_around(number, cells, owners, len(kept))
    )


def _walls_around(number: NDArray[np.intp], cells: Indices, owners: Indices, count: int) -> tuple[tuple[int, ...], ...]:
    """The walls with a cell next to each room, from the cells of walls and the wall of each."""
    padded = np.pad(number, 1)
    x, y = np.unravel_index(cells, number.shape)
    pairs = {
        pair
        for dx, dy in itertools.product(range(3), repeat=2)
        for pair in zip(padded[x + dx, y + dy].tolist(), owners.tolist(), strict=True)
    }
    found: list[list[int]] = [[] for _ in range(count)]
    for room, wall in sorted(pairs):
        if room:
            found[room - 1].append(wall)
    return tuple(map(tuple, found))
