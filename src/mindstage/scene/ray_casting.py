"""Ray casting over collision shapes: what is visible from a point, what hides it, and how much liquid a shape retains.

Boxes, ellipsoids, cylinders and convex hulls are intersected exactly. Rays from one origin are directions on a
sphere, on which each shape covers a cap; a KD-tree over the directions gives the few rays that can meet a shape, so
the cost grows with the number of rays that meet shapes' bounding spheres, not with rays times shapes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.bounding_boxes import Indices, OrientedBoxes
from mindstage.scene.collision_shapes import (
    MIN_THICKNESS_M,
    SHAPE_TYPES,
    CompiledGeometry,
    compile_geometry,
    primitive_collision_type,
)
from mindstage.scene.geometry import GeometryMap
from mindstage.scene.mesh import convex_hull
from mindstage.scene.model import Body
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.transforms import Array, normalize, pose_array, pose_multiply, rotation_matrix

__all__ = ["ShapeScene", "Visibility", "retained_volume"]

_BOX, _SPHERE, _CYLINDER, _HULL = range(4)
_SAMPLE_COUNT = 96
"""Sample points on the surface of a body; each of its shapes has at least one."""
_PULL_IN = 1.0 - 1e-4
"""Sample points are inside their shape by so much, that rays to them meet it."""
_DEPTH_TOLERANCE_M = 1e-6
_CHUNK_SIZE = 1 << 18
"""Number of pairs of ray and shape per chunk."""


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """How much of a body is seen."""

    row: int
    """The body."""
    share: float
    """The fraction of the sample points on its surface that no other body hides, 0 to 1."""
    hidden_by: tuple[int, ...]
    """The bodies that hide the others, those that hide most first."""


@dataclass(frozen=True, slots=True, eq=False)
class _HullPlanes:
    normals: Array
    offsets: Array


class ShapeScene:
    """The collision shapes of bodies at their poses in the world."""

    def __init__(self, bodies: Sequence[Body], geometry: GeometryMap) -> None:
        """Computes the shapes; a body without geometry has the primitive shape of its size, one without size none.

        Args:
            bodies: the bodies; rows are indices into them. Those with numbers that are not finite have no shapes.
            geometry: their geometry, in their frames.
        """
        self.bodies = tuple(bodies)
        kept = BodyBoxes.from_bodies(self.bodies).bodies
        body_poses = pose_array(body.pose for body in kept)
        body_poses[:, 3:] = normalize(body_poses[:, 3:])
        rows = {body.id: row for row, body in enumerate(self.bodies)}
        simple = [at for at, body in enumerate(kept) if body.id not in geometry and body.size is not None]
        extents = np.array([kept[at].size for at in simple], dtype=np.float64).reshape(-1, 3)
        poses, sizes = [body_poses[simple]], [np.maximum(extents, MIN_THICKNESS_M)]
        types = [SHAPE_TYPES.index(primitive_collision_type(kept[at])) for at in simple]
        owners, hulls = [rows[kept[at].id] for at in simple], dict[int, _HullPlanes]()
        planes = dict[tuple[CompiledGeometry, int], _HullPlanes | None]()
        for body, pose in zip(kept, body_poses, strict=True):
            own = geometry.get(body.id)
            compiled = compile_geometry(own.collision_shapes) if own is not None else None
            if compiled is None or not len(compiled.shapes):
                continue
            for at, points, _ in compiled.hulls:
                key = (compiled, at)
                if key not in planes:
                    planes[key] = _hull_planes(points)
                if (found := planes[key]) is not None:
                    hulls[len(owners) + at] = found
            poses.append(pose_multiply(np.tile(pose, (len(compiled.shapes), 1)), compiled.poses))
            sizes.append(compiled.sizes)
            types += compiled.types.tolist()
            owners += [rows[body.id]] * len(compiled.shapes)
        order = np.argsort(owners, kind="stable")
        placed, count = np.concatenate(poses)[order], len(owners)
        self.owner: Indices = np.array(owners, dtype=np.intp)[order]
        self._center = placed[:, :3]
        self._rotation = rotation_matrix(normalize(placed[:, 3:])) if count else np.zeros((0, 3, 3))
        self._half = np.concatenate(sizes)[order] / 2
        self._type = np.array(types, dtype=np.intp)[order]
        at_new = {old: new for new, old in enumerate(order.tolist())}
        self._hulls = {at_new[at]: each for at, each in hulls.items()}
        is_round = self._type == _SPHERE
        self._reach = np.where(is_round, self._half.max(axis=1, initial=0.0), np.linalg.norm(self._half, axis=1))

    @property
    def shape_boxes(self) -> OrientedBoxes:
        """The bounding boxes of all shapes, in the order of `owner`."""
        return OrientedBoxes(self._center, self._rotation, self._half)

    # -- rays ----------------------------------------------------------------------------------------------------------

    def first_hits(
        self, origin: Array, directions: Array, limits: Array, skipped: NDArray[np.bool_]
    ) -> tuple[Array, Indices]:
        """Returns the first body that each ray meets.

        Args:
            origin: where all rays start [m].
            directions: n x 3 unit vectors.
            limits: n, the length of each ray [m].
            skipped: for each body, whether rays pass through it.

        Returns:
            The distance [m] (infinite if nothing is met), and the row of the body (-1), each of length n.
        """
        distance, body = np.full(len(directions), np.inf), np.full(len(directions), -1, dtype=np.intp)
        for rays, hits, shapes in self._hits(origin, directions, limits, ~skipped[self.owner]):
            order = np.lexsort((self.owner[shapes], hits))[::-1]
            rays, hits, shapes = rays[order], hits[order], shapes[order]
            first = np.full(len(directions), np.inf)
            owner = np.full(len(directions), -1, dtype=np.intp)
            first[rays], owner[rays] = hits, self.owner[shapes]  # the last assignment, which is the nearest, wins
            nearer = first < distance
            distance[nearer], body[nearer] = first[nearer], owner[nearer]
        return distance, body

    def _hits(
        self, origin: Array, directions: Array, limits: Array, used: NDArray[np.bool_]
    ) -> Iterator[tuple[Indices, Array, Indices]]:
        """Yields rays, distances and shapes of intersections, in chunks."""
        rays, shapes = self._candidates(origin, directions, limits, used)
        for start in range(0, len(rays), _CHUNK_SIZE):
            ray, shape = rays[start : start + _CHUNK_SIZE], shapes[start : start + _CHUNK_SIZE]
            near, far = self._intersections(origin, directions[ray], shape)
            entry = np.maximum(near, 0.0)
            met = (near <= far) & (far >= 0.0) & (entry <= limits[ray])
            yield ray[met], entry[met], shape[met]

    def _candidates(
        self, origin: Array, directions: Array, limits: Array, used: NDArray[np.bool_]
    ) -> tuple[Indices, Indices]:
        """Pairs of rays and shapes whose bounding spheres they can meet."""
        offset = self._center - origin
        apart = np.linalg.norm(offset, axis=1)
        rows = np.flatnonzero(used & (apart - self._reach <= limits.max(initial=0.0)))
        if not len(rows) or not len(directions):
            return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
        around = apart[rows] <= self._reach[rows] + _DEPTH_TOLERANCE_M
        angle = np.arcsin(np.clip(self._reach[rows] / np.maximum(apart[rows], 1e-12), 0.0, 1.0))
        chord = np.where(around, 2.1, 2 * np.sin(angle / 2) + 1e-6)
        center = offset[rows] / np.maximum(apart[rows], 1e-12)[:, None]
        from scipy.spatial import cKDTree  # here, since the import takes 0.1 s

        found = cKDTree(directions).query_ball_point(center, chord)
        counts = np.array([len(each) for each in found])
        rays = np.concatenate([np.asarray(each, dtype=np.intp) for each in found]) if counts.sum() else np.zeros(0, int)
        return rays.astype(np.intp), np.repeat(rows, counts)

    def _intersections(self, origin: Array, directions: Array, shapes: Indices) -> tuple[Array, Array]:
        """Entry and exit distances of each pair of ray and shape; entry > exit where they miss."""
        start = np.einsum("nji,nj->ni", self._rotation[shapes], origin - self._center[shapes])
        along = np.einsum("nji,nj->ni", self._rotation[shapes], directions)
        half = self._half[shapes]
        types = self._type[shapes]
        near, far = _slabs(start, along, half)
        for kind, axes in ((_SPHERE, 3), (_CYLINDER, 2)):
            rows = np.flatnonzero(types == kind)
            if len(rows):
                enter, leave = _quadric(start[rows, :axes] / half[rows, :axes], along[rows, :axes] / half[rows, :axes])
                near[rows], far[rows] = np.maximum(near[rows], enter), np.minimum(far[rows], leave)
        hull_pairs = np.flatnonzero(types == _HULL)
        for shape in np.unique(shapes[hull_pairs]).tolist():
            planes = self._hulls.get(shape)
            if planes is not None:
                rows = hull_pairs[shapes[hull_pairs] == shape]
                enter, leave = _half_spaces(start[rows], along[rows], planes)
                near[rows], far[rows] = np.maximum(near[rows], enter), np.minimum(far[rows], leave)
        return near, far

    # -- visibility ----------------------------------------------------------------------------------------------------

    def visibility(self, origin: Array, targets: Sequence[int], skipped: NDArray[np.bool_]) -> list[Visibility]:
        """Returns how much of each target is seen from a point; targets without shapes are left out.

        Args:
            origin: the point [m].
            targets: rows of bodies.
            skipped: for each body, whether it hides nothing, such as the viewer itself.
        """
        points, owners = self.sample_points(targets)
        if not len(points):
            return []
        offset = points - origin
        length = np.linalg.norm(offset, axis=1)
        directions = offset / np.maximum(length, 1e-12)[:, None]
        own_hit = length.copy()
        hides, hit = np.full(len(points), -1, dtype=np.intp), np.full(len(points), np.inf)
        for rays, distances, shapes in self._hits(origin, directions, length, np.ones(len(self.owner), dtype=bool)):
            own = self.owner[shapes] == owners[rays]
            np.minimum.at(own_hit, rays[own], distances[own])
            other = ~own & ~skipped[self.owner[shapes]]
            ray, far, owner = rays[other], distances[other], self.owner[shapes][other]
            order = np.lexsort((owner, far))[::-1]
            nearest, first = np.full(len(points), np.inf), np.full(len(points), -1, dtype=np.intp)
            nearest[ray[order]], first[ray[order]] = far[order], owner[order]
            nearer = nearest < hit
            hit[nearer], hides[nearer] = nearest[nearer], first[nearer]
        seen = hit > own_hit - _DEPTH_TOLERANCE_M
        bounds = [0, *(np.flatnonzero(np.diff(owners)) + 1).tolist(), len(owners)]
        return [self._summary(int(owners[start]), seen[start:end], hides[start:end]) for start, end in pairwise(bounds)]

    @staticmethod
    def _summary(target: int, seen: NDArray[np.bool_], hides: Indices) -> Visibility:
        rows, counts = np.unique(hides[~seen], return_counts=True)
        order = np.lexsort((rows, -counts))
        return Visibility(target, float(seen.mean()), tuple(rows[order].tolist()))

    def sample_points(self, targets: Sequence[int]) -> tuple[Array, Indices]:
        """Returns points on the surfaces of bodies, n x 3 [m], in proportion to the areas of shapes, and their rows."""
        points, owners = [np.zeros((0, 3))], [np.zeros(0, dtype=np.intp)]
        starts, ends = (
            np.searchsorted(self.owner, targets, side="left"),
            np.searchsorted(self.owner, targets, side="right"),
        )
        for target, start, end in zip(targets, starts.tolist(), ends.tolist(), strict=True):
            x, y, z = self._half[start:end].T
            area = x * y + y * z + x * z
            share = area / max(float(area.sum()), 1e-12)
            for shape, count in zip(
                range(start, end), np.maximum(1, np.round(share * _SAMPLE_COUNT)).tolist(), strict=True
            ):
                local = self._surface_points(shape, int(count)) * _PULL_IN
                points.append(self._center[shape] + local @ self._rotation[shape].T)
                owners.append(np.full(len(local), target, dtype=np.intp))
        return np.concatenate(points), np.concatenate(owners)

    def _surface_points(self, shape: int, count: int) -> Array:
        """Points on the surface of a shape about its center, in directions of a Fibonacci lattice (Gonzalez 2010)."""
        half, unit = self._half[shape], _fibonacci_sphere(count)
        match int(self._type[shape]):
            case _ if (planes := self._hulls.get(shape)) is not None:
                across = unit @ planes.normals.T
                reach = np.where(across > 1e-12, planes.offsets / np.maximum(across, 1e-12), np.inf).min(axis=1)
                return np.asarray(unit * reach[:, None])
            case 1:
                return np.asarray(unit * half)
            case 2:
                radial = np.linalg.norm(unit[:, :2], axis=1)
                return np.asarray(unit / np.maximum(radial, np.abs(unit[:, 2]))[:, None] * half)
            case _:
                return np.asarray(unit / np.abs(unit).max(axis=1)[:, None] * half)

    # -- heights -------------------------------------------------------------------------------------------------------

    def top_heights(self, row: int, x: Array, y: Array) -> Array:
        """Returns the height of the top of one body at points of the ground [m]; -inf beside it."""
        shapes = np.flatnonzero(self.owner == row)
        height = np.full(len(x), -np.inf)
        if not len(shapes):
            return height
        top = float((self._center[shapes, 2] + self._reach[shapes]).max()) + 1.0
        down = np.array([0.0, 0.0, -1.0])
        for shape in shapes.tolist():
            rotation = self._rotation[shape]
            origins = np.stack([x, y, np.full(len(x), top)], axis=1)
            start = (origins - self._center[shape]) @ rotation
            along = np.tile(down @ rotation, (len(x), 1))
            half = np.tile(self._half[shape], (len(x), 1))
            near, far = _slabs(start, along, half)
            kind = int(self._type[shape])
            if kind in {_SPHERE, _CYLINDER}:
                axes = 3 if kind == _SPHERE else 2
                enter, leave = _quadric(start[:, :axes] / half[:, :axes], along[:, :axes] / half[:, :axes])
                near, far = np.maximum(near, enter), np.minimum(far, leave)
            elif (planes := self._hulls.get(shape)) is not None:
                enter, leave = _half_spaces(start, along, planes)
                near, far = np.maximum(near, enter), np.minimum(far, leave)
            met = near <= far
            height[met] = np.maximum(height[met], top - near[met])
        return height


def _hull_planes(points: Array) -> _HullPlanes | None:
    hull = convex_hull(points)
    if hull is None:
        return None
    return _HullPlanes(hull.normals, (hull.normals * hull.points[hull.faces[:, 0]]).sum(axis=1))


def _slabs(start: Array, along: Array, half: Array) -> tuple[Array, Array]:
    """Entry and exit of rays through boxes about the origin (Kay and Kajiya 1986)."""
    parallel = np.abs(along) < 1e-12
    safe = np.where(parallel, 1.0, along)
    one, other = (-half - start) / safe, (half - start) / safe
    outside = parallel & (np.abs(start) > half)
    near = np.where(parallel, np.where(outside, np.inf, -np.inf), np.minimum(one, other))
    far = np.where(parallel, np.where(outside, -np.inf, np.inf), np.maximum(one, other))
    return near.max(axis=1), far.min(axis=1)


def _quadric(start: Array, along: Array) -> tuple[Array, Array]:
    """Entry and exit of rays through the unit sphere or, in two dimensions, the unit circle."""
    a, b, c = np.sum(along * along, axis=1), np.sum(start * along, axis=1), np.sum(start * start, axis=1) - 1.0
    still = a < 1e-18
    root = b * b - a * c
    width = np.sqrt(np.maximum(root, 0.0))
    safe = np.where(still, 1.0, a)
    misses = np.where(still, c > 0.0, root < 0.0)
    near = np.where(misses, np.inf, np.where(still, -np.inf, (-b - width) / safe))
    far = np.where(misses, -np.inf, np.where(still, np.inf, (-b + width) / safe))
    return near, far


def _half_spaces(start: Array, along: Array, planes: _HullPlanes) -> tuple[Array, Array]:
    """Entry and exit of rays through a convex polyhedron (Cyrus and Beck 1978)."""
    speed, room = along @ planes.normals.T, planes.offsets - start @ planes.normals.T
    parallel = np.abs(speed) < 1e-12
    crossing = room / np.where(parallel, 1.0, speed)
    near = np.where(~parallel & (speed < 0.0), crossing, -np.inf).max(axis=1)
    far = np.where(~parallel & (speed > 0.0), crossing, np.inf).min(axis=1)
    missed = np.any(parallel & (room < 0.0), axis=1)
    return np.where(missed, np.inf, near), np.where(missed, -np.inf, far)


def _fibonacci_sphere(count: int) -> Array:
    """Evenly spread unit vectors, count x 3."""
    at = np.arange(count) + 0.5
    z = 1.0 - 2.0 * at / count
    turn = np.pi * (1.0 + 5.0**0.5) * at
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


# -- liquids ---------------------------------------------------------------------------------------------------------

_HEIGHT_GRID = 48


def retained_volume(scene: ShapeScene, row: int, low: Array, high: Array) -> float:
    """Returns the volume of the depressions of a body, seen from above at its current pose [m³].

    The heights of its collision shapes are sampled on a grid; liquid flows over the lowest rim of a depression, and
    through each cell without a shape: depressions are filled as in hydrology (Barnes, Lehman and Mulla 2014).

    Args:
        scene: the shapes.
        row: the body.
        low: the lower corner of its bounds [m].
        high: the upper corner [m].
    """
    if np.count_nonzero(scene.owner == row) < 2 or np.any(high[:2] - low[:2] <= 0.0):
        return 0.0  # a convex shape retains nothing
    step = (high[:2] - low[:2]) / _HEIGHT_GRID
    x, y = (low[axis] + (np.arange(_HEIGHT_GRID) + 0.5) * step[axis] for axis in (0, 1))
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    height = scene.top_heights(row, grid_x.reshape(-1), grid_y.reshape(-1)).reshape(_HEIGHT_GRID, _HEIGHT_GRID)
    level = _filled(np.pad(height, 1, constant_values=-np.inf))[1:-1, 1:-1]
    solid = np.isfinite(height)
    return float((level[solid] - height[solid]).sum() * step.prod())


def _filled(height: Array) -> Array:
    """The heights with all depressions filled; cells of minus infinity, as all around, are outlets.

    The least fixed point of "a level is the height, or the lowest level of a neighbor if that is higher".
    """
    level = np.where(np.isfinite(height), np.inf, -np.inf)
    while True:
        lowest = level.copy()
        for axis in (0, 1):
            for step in (1, -1):
                np.minimum(lowest, np.roll(level, step, axis=axis), out=lowest)
        lowest = np.maximum(lowest, height)
        if np.array_equal(lowest, level):
            return level
        level = lowest
