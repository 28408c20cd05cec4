"""Ray casting over collision shapes: what is visible from a point, what hides it, and how much liquid a shape retains.

Boxes, ellipsoids, cylinders and convex hulls are intersected exactly. Rays from one origin are directions on a
sphere, on which each shape covers a cap. The rays to one body form a bundle, which covers a cap, too. Shapes are tried
from near to far with the bundles whose caps they meet, and a ray ends at the first shape that begins behind what the
ray has met. So the cost grows with what can be seen, not with rays times shapes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

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
from mindstage.scene.proximity import BodyBoxes, box_point_gaps
from mindstage.scene.transforms import Array, normalize, pose_array, pose_multiply, rotation_matrix
from mindstage.scene.world_model import Body

__all__ = ["Depressions", "ShapeScene", "Visibility", "find_depressions", "retained_volume"]

_BOX, _SPHERE, _CYLINDER, _HULL = range(4)
_SAMPLE_COUNT = 96
"""Sample points on the surface of a body; each of its shapes has at least one."""
_PULL_IN = 1.0 - 1e-4
"""Sample points are inside their shape by so much, that rays to them meet it."""
_DEPTH_TOLERANCE_M = 1e-6
_PAIRS_AT_ONCE = 1 << 16
"""Number of pairs of ray and shape per chunk: their arrays fit in a cache."""
_MAX_STEPS = 8
"""Number of shapes that a ray is tested with at once, while few rays are left."""
_CAPS_AT_ONCE = 1 << 20
"""Number of pairs of bundle and body per batch of bodies."""
_WIDE_BUNDLE = 4.0
"""Bundles that are wider than the median by this factor are split into single rays."""
_PARALLEL = 1e-12
"""A ray with a smaller component of its direction is parallel to a plane; a fraction."""


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


@dataclass(frozen=True, slots=True, eq=False)
class _Caps:
    """Caps of the unit sphere."""

    center: Array
    """n x 3 unit vectors."""
    radius: Array
    """n [rad], at most pi."""

    @classmethod
    def around_shapes(cls, offset: Array, reach: Array) -> _Caps:
        """The directions to spheres about offsets from the origin, n x 3 [m], of a radius [m]."""
        apart = np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
        radius = np.arcsin(np.clip(reach / apart, 0.0, 1.0))
        return cls(offset / apart[:, None], np.where(apart <= reach + _DEPTH_TOLERANCE_M, np.pi, radius))

    def terms(self, *, is_first: bool) -> Array:
        """Five numbers for each cap: two caps overlap if the product of those of a first and a second is not negative.

        It is the cosine between the centers, less the cosine of the sum of the radii. A cap of more than a hemisphere
        overlaps everything.
        """
        cosine, sine = np.cos(self.radius + 1e-6), np.sin(self.radius + 1e-6)
        found = np.column_stack([self.center, -cosine if is_first else cosine, sine])
        found[self.radius + 1e-6 >= np.pi / 2] = (0.0, 0.0, 0.0, 0.0, 1.0)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _ShapeGroups:
    """The shapes of each body that has some, with bounds around them."""

    owner: Indices
    """n, the rows of the bodies."""
    begin: Indices
    """n, the first shape of each."""
    count: Indices
    """n, the number of shapes of each."""
    middle: Array
    """n x 3, the centers of axis-aligned bounding boxes [m]."""
    half: Array
    """n x 3, half of their extents [m]."""
    center: Array
    """n x 3, the centers of bounding spheres [m]."""
    reach: Array
    """n, their radii [m]."""

    @classmethod
    def around(cls, owner: Indices, boxes: OrientedBoxes, reach: Array) -> _ShapeGroups:
        """Groups shapes, which are sorted by their owner; `reach` is the radius of a sphere around each [m]."""
        owners, begin, count = np.unique(owner, return_index=True, return_counts=True)
        if not len(owners):
            none = np.zeros((0, 3))
            return cls(owners, begin, count, none, none, none, np.zeros(0))
        low, high = boxes.bounds()
        low, high = np.minimum.reduceat(low, begin, axis=0), np.maximum.reduceat(high, begin, axis=0)
        middle = (low + high) / 2
        center = np.where((count == 1)[:, None], boxes.center[begin], middle)
        apart = np.linalg.norm(boxes.center - np.repeat(center, count, axis=0), axis=1)
        radius = np.maximum.reduceat(apart + reach, begin)
        return cls(owners, begin, count, middle, (high - low) / 2 * (1.0 + 1e-9) + 1e-9, center, radius)


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """Rays from one origin, and what they have met so far."""

    directions: Array
    """n x 3 unit vectors."""
    targets: Indices
    """n, the body at which each ray ends; -1 for none."""
    own: Array
    """n, the distance at which each ray ends: that of its target, or its limit [m]."""
    distance: Array
    """n, the distance of the first other body [m]; infinite without one."""
    body: Indices
    """n, that body; -1 without one."""
    at: Indices
    """n, the next body of each ray in a list of bodies."""
    end: Indices
    """n, the end of its part of the list."""

    @classmethod
    def begin(cls, directions: Array, limits: Array, targets: Indices) -> _Rays:
        """Rays that have met nothing."""
        count = len(directions)
        at, end, body = np.zeros((3, count), dtype=np.intp)
        body -= 1
        return cls(directions, targets, limits.astype(np.float64), np.full(count, np.inf), body, at, end)

    def reach(self, rays: Indices) -> Array:
        """How far some rays go [m]."""
        return np.asarray(np.minimum(self.distance[rays], self.own[rays]))


def _bundles(directions: Array, targets: Indices) -> tuple[_Caps, Indices, Indices]:
    """Bundles consecutive rays to one target, or single rays: their caps, the first ray of each and the counts."""
    alone = targets < 0
    while True:
        starts = np.flatnonzero((np.diff(targets, prepend=-2) != 0) | alone)
        counts = np.diff([*starts, len(targets)])
        center = np.add.reduceat(directions, starts, axis=0)
        center /= np.maximum(np.linalg.norm(center, axis=1), 1e-12)[:, None]
        bundle = np.repeat(np.arange(len(starts)), counts)
        chord = np.maximum.reduceat(np.linalg.norm(directions - center[bundle], axis=1), starts)
        radius = 2 * np.arcsin(np.minimum(chord / 2, 1.0))
        several = counts > 1
        wide = several & (radius > _WIDE_BUNDLE * np.median(radius[several])) if several.any() else several
        if alone.any() or not wide.any():
            return _Caps(center, radius), starts, counts
        alone = wide[bundle]


def _ranges(first: Indices, counts: Indices) -> Indices:
    """The numbers of several ranges, one after another."""
    return np.asarray(np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(counts.sum()))


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
        body_pose, own_poses = list[int](), [np.zeros((0, 7))]
        for at_body, body in enumerate(kept):
            own = geometry.get(body.id)
            compiled = compile_geometry(own.collision_shapes) if own is not None else None
            if compiled is None or not len(compiled.shapes):
                continue
            for number, (at, *_) in enumerate(compiled.hulls):
                if (found := _hull_planes(compiled, number)) is not None:
                    hulls[len(owners) + at] = found
            body_pose += [at_body] * len(compiled.shapes)
            own_poses.append(compiled.poses)
            sizes.append(compiled.sizes)
            types += compiled.types.tolist()
            owners += [rows[body.id]] * len(compiled.shapes)
        poses.append(pose_multiply(body_poses[body_pose], np.concatenate(own_poses)))
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
        self._groups = _ShapeGroups.around(self.owner, self.shape_boxes, self._reach)

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
        none = np.full(len(directions), -1, dtype=np.intp)
        distance, body, _ = self._trace(origin, directions, limits, none, skipped)
        return distance, body

    def _trace(
        self, origin: Array, directions: Array, limits: Array, targets: Indices, skipped: NDArray[np.bool_]
    ) -> tuple[Array, Indices, Array]:
        """Finds the first body that each ray meets besides its target.

        Args:
            origin: where all rays start [m].
            directions: n x 3 unit vectors.
            limits: n, the length of each ray [m].
            targets: n, the row of the body at which each ray ends; -1 for none.
            skipped: for each body, whether rays pass through it, unless it is their target.

        Returns:
            The distance [m] and the row of the first other body, as far as it is before the target, else infinite and
            -1; of several at one distance the lowest row. Then the distance of the target, at most the limit [m].
        """
        rays = _Rays.begin(directions, limits, targets)
        if not len(directions) or not len(self.owner):
            return rays.distance, rays.body, rays.own
        bodies = self._groups
        gaps = np.maximum(box_point_gaps(self.shape_boxes, origin), 0.0) * (1.0 - 1e-9)
        bound = np.minimum.reduceat(gaps, bodies.begin)
        rows = np.flatnonzero((~skipped[bodies.owner] | np.isin(bodies.owner, targets)) & (bound <= limits.max()))
        rows = rows[np.argsort(bound[rows], kind="stable")]
        body_terms = _Caps.around_shapes(bodies.center[rows] - origin, bodies.reach[rows]).terms(is_first=False)
        bundles, first_ray, ray_count = _bundles(directions, targets)
        terms = bundles.terms(is_first=True)
        start = np.einsum("nji,nj->ni", self._rotation, origin - self._center)
        farthest = np.maximum.reduceat(rays.own, first_ray)
        done = 0
        while done < len(rows):
            open_ = np.flatnonzero(farthest >= bound[rows[done]])
            if not len(open_):
                break
            batch = slice(done, done + max(1, _CAPS_AT_ONCE // len(open_)))
            done = batch.stop
            met = np.flatnonzero(terms[open_] @ body_terms[batch].T >= -1e-12)  # by bundle, then by the bound
            which, listed = np.divmod(met, len(rows[batch]))
            which, listed = open_[which], rows[batch][listed]
            kept = bound[listed] <= farthest[which]
            which, listed = which[kept], listed[kept]
            touched, first, length = np.unique(which, return_index=True, return_counts=True)
            if len(touched):
                active = _ranges(first_ray[touched], ray_count[touched])
                rays.at[active] = np.repeat(first, ray_count[touched])
                rays.end[active] = np.repeat(first + length, ray_count[touched])
                self._advance(rays, active, listed, origin, start, bound, skipped)
                ends = np.cumsum(ray_count[touched]) - ray_count[touched]
                farthest[touched] = np.maximum.reduceat(rays.reach(active), ends)
        return rays.distance, rays.body, rays.own

    def _advance(
        self,
        rays: _Rays,
        active: Indices,
        listed: Indices,
        origin: Array,
        start: Array,
        bound: Array,
        skipped: NDArray[np.bool_],
    ) -> None:
        """Tests rays with their parts of a list of bodies, from near to far.

        Args:
            rays: the rays; `at` and `end` are their parts of the list.
            active: rows of the rays to test; each has a body.
            listed: the list of rows of `self._groups`.
            origin: where all rays start [m].
            start: the origin in the frame of each shape [m].
            bound: for each body, a lower bound of its distance [m]; the parts are sorted by it.
            skipped: for each body of the scene, whether it hides nothing.
        """
        bodies = self._groups
        while len(active):
            active = active[bound[listed[rays.at[active]]] <= rays.reach(active)]
            steps = max(1, min(_MAX_STEPS, _PAIRS_AT_ONCE // max(len(active), 1)))
            for first in range(0, len(active), _PAIRS_AT_ONCE):
                ray = active[first : first + _PAIRS_AT_ONCE]
                entry = rays.at[ray]
                if steps > 1:
                    ray = np.repeat(ray, steps)
                    entry = np.repeat(entry, steps) + np.arange(len(ray)) % steps
                    kept = np.flatnonzero(entry < rays.end[ray])
                    ray, entry = ray[kept], entry[kept]
                body = listed[entry]
                near, far = _slabs(origin - bodies.middle[body], rays.directions[ray], bodies.half[body])
                kept = np.flatnonzero((near <= far) & (far >= 0.0) & (near <= rays.reach(ray)))
                ray, body = ray[kept], body[kept]
                shape = _ranges(bodies.begin[body], bodies.count[body])
                ray = np.repeat(ray, bodies.count[body])
                near, far = self._intersections(start[shape], rays.directions[ray], shape)
                hit = np.maximum(near, 0.0)
                hits = np.flatnonzero((near <= far) & (far >= 0.0) & (hit <= rays.reach(ray)))
                ray, hit, owner = ray[hits], hit[hits], self.owner[shape[hits]]
                is_own = owner == rays.targets[ray]
                np.minimum.at(rays.own, ray[is_own], hit[is_own])
                other = np.flatnonzero(~is_own & ~skipped[owner])
                ray, hit, owner = ray[other], hit[other], owner[other]
                order = np.lexsort((owner, hit))[::-1]
                ray, hit, owner = ray[order], hit[order], owner[order]
                nearer = (hit < rays.distance[ray]) | (owner < rays.body[ray])
                # Of several assignments to one ray the last wins, which is the nearest.
                rays.distance[ray[nearer]], rays.body[ray[nearer]] = hit[nearer], owner[nearer]
            rays.at[active] += steps
            active = active[rays.at[active] < rays.end[active]]

    def _intersections(self, start: Array, directions: Array, shapes: Indices) -> tuple[Array, Array]:
        """Entry and exit distances of each pair of ray and shape; entry > exit where they miss.

        Args:
            start: the origin in the frame of each shape, n x 3 [m].
            directions: n x 3.
            shapes: n rows.
        """
        along = np.einsum("nji,nj->ni", self._rotation[shapes], directions)
        half = self._half[shapes]
        near, far = _slabs(start, along, half)
        types = self._type[shapes]
        if not types.any():
            return near, far
        for kind, axes in ((_SPHERE, 3), (_CYLINDER, 2)):
            rows = np.flatnonzero(types == kind)
            if len(rows):
                enter, leave = _quadric(start[rows, :axes] / half[rows, :axes], along[rows, :axes] / half[rows, :axes])
                near[rows], far[rows] = np.maximum(near[rows], enter), np.minimum(far[rows], leave)
        hull_pairs = np.flatnonzero(types == _HULL)
        hull_pairs = hull_pairs[np.argsort(shapes[hull_pairs], kind="stable")]
        for rows in np.split(hull_pairs, np.flatnonzero(np.diff(shapes[hull_pairs])) + 1):
            planes = self._hulls.get(int(shapes[rows[0]])) if len(rows) else None
            if planes is not None:
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
        hit, hides, own_hit = self._trace(origin, directions, length, owners, skipped)
        seen = hit > own_hit - _DEPTH_TOLERANCE_M
        begin = np.flatnonzero(np.diff(owners, prepend=-1))
        share = np.add.reduceat(seen.astype(np.intp), begin) / np.diff([*begin, len(owners)])
        number = np.cumsum(np.diff(owners, prepend=-1) != 0) - 1
        pairs, counts = np.unique((number * len(self.bodies) + hides)[~seen], return_counts=True)
        target, hider = np.divmod(pairs, len(self.bodies))
        order = np.lexsort((hider, -counts, target))
        first = np.searchsorted(target[order], np.arange(len(begin) + 1)).tolist()
        hidden_by = hider[order].tolist()
        return [
            Visibility(row, each, tuple(hidden_by[first[at] : first[at + 1]]))
            for at, (row, each) in enumerate(zip(owners[begin].tolist(), share.tolist(), strict=True))
        ]

    def sample_points(self, targets: Sequence[int]) -> tuple[Array, Indices]:
        """Returns points on the surfaces of bodies, n x 3 [m], in proportion to the areas of shapes, and their rows."""
        rows = np.asarray(targets, dtype=np.intp)
        begin, end = (np.searchsorted(self.owner, rows, side=side) for side in ("left", "right"))
        counts = end - begin
        shapes = _ranges(begin, counts)
        if not len(shapes):
            return np.zeros((0, 3)), np.zeros(0, dtype=np.intp)
        x, y, z = self._half[shapes].T
        area = x * y + y * z + x * z
        of_target = np.repeat(np.arange(len(rows)), counts)
        total = np.bincount(of_target, area, len(rows))
        samples = np.maximum(1, np.round(area / np.maximum(total, 1e-12)[of_target] * _SAMPLE_COUNT)).astype(np.intp)
        points = np.zeros((samples.sum(), 3))
        begin = np.cumsum(samples) - samples
        kinds = np.where([shape in self._hulls for shape in shapes.tolist()], -1 - shapes, self._type[shapes])
        order = np.lexsort((kinds, samples))
        changes = np.flatnonzero(np.diff(kinds[order]) | np.diff(samples[order])) + 1
        for alike in np.split(order, changes):
            count = int(samples[alike[0]])
            local = self._surface_points(shapes[alike], count) * _PULL_IN
            placed = self._center[shapes[alike], None] + np.einsum("nij,nkj->nki", self._rotation[shapes[alike]], local)
            points[begin[alike][:, None] + np.arange(count)] = placed
        return points, np.repeat(rows[of_target], samples)

    def _surface_points(self, shapes: Indices, count: int) -> Array:
        """Points on the surfaces of shapes of one type, or of one hull, about their centers, n x count x 3 [m].

        They are in the directions of a Fibonacci lattice (Gonzalez 2010), scaled by the extents of the shape.
        """
        half, unit = self._half[shapes][:, None], _fibonacci_sphere(count)
        if (planes := self._hulls.get(int(shapes[0]))) is not None:
            across = unit @ planes.normals.T
            reach = np.where(across > 1e-12, planes.offsets / np.maximum(across, 1e-12), np.inf).min(axis=1)
            return np.asarray(unit * reach[:, None])[None]
        match int(self._type[shapes[0]]):
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


@lru_cache(maxsize=4096)
def _hull_planes(geometry: CompiledGeometry, number: int) -> _HullPlanes | None:
    hull = convex_hull(geometry.hulls[number][1])
    if hull is None:
        return None
    return _HullPlanes(hull.normals, (hull.normals * hull.points[hull.faces[:, 0]]).sum(axis=1))


def _slabs(start: Array, along: Array, half: Array) -> tuple[Array, Array]:
    """Entry and exit of rays through boxes about the origin (Kay and Kajiya 1986)."""
    near, far = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    for axis in range(start.shape[1]):
        # A parallel ray gets a slope that is too small to matter, so that it meets its slab always or very far away.
        slope = np.where(np.abs(along[:, axis]) < _PARALLEL, _PARALLEL, along[:, axis])
        to, width = -start[:, axis] / slope, half[:, axis] / np.abs(slope)
        np.maximum(near, to - width, out=near)
        np.minimum(far, to + width, out=far)
    return near, far


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

_GRID_CELLS = 48


@dataclass(frozen=True, slots=True, eq=False)
class Depressions:
    """The depressions of a body at its pose, seen from above on a grid."""

    height: Array
    """The top of the body in each cell [m]; -inf beside it."""
    level: Array
    """The surface of the liquid in each cell if the depressions are full [m]."""
    cell: tuple[float, float]
    """The extents of a cell along x and y [m]."""

    @property
    def volume(self) -> float:
        """What the depressions retain [m³]."""
        return self.volume_below(math.inf)

    def volume_below(self, surface: float) -> float:
        """The volume of the liquid below a horizontal surface [m³]."""
        solid = np.isfinite(self.height)
        depth = np.minimum(self.level[solid], surface) - self.height[solid]
        return float(np.maximum(depth, 0.0).sum() * self.cell[0] * self.cell[1])

    def tilted_volume(self, tilt_rad: float, heading_rad: float) -> float:
        """What is retained if the body is tilted towards a horizontal direction [m³].

        The columns of the grid stay fixed to the body, so that a leaning wall hides nothing; the level of the liquid is
        a horizontal plane, and so an inclined one in the frame of the columns. Exact for a vessel without overhangs.
        """
        if math.cos(tilt_rad) < 1e-6:
            return 0.0
        x, y = np.indices(self.height.shape) * np.reshape(self.cell, (2, 1, 1))
        along = x * math.cos(heading_rad) + y * math.sin(heading_rad)
        height = self.height * math.cos(tilt_rad) - along * math.sin(tilt_rad)
        level = _filled(np.pad(height, 1, constant_values=-np.inf))[1:-1, 1:-1]
        solid = np.isfinite(height)
        depth = (level[solid] - height[solid]) / math.cos(tilt_rad)
        return float(depth.sum() * self.cell[0] * self.cell[1])

    def surface_of(self, volume: float) -> float:
        """The height of the surface of a volume [m³], if it fills the deepest parts first [m]."""
        wet = np.isfinite(self.height) & (self.level > self.height)
        if not wet.any():
            return math.nan
        low, high = float(self.height[wet].min()), float(self.level[wet].max())
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (low, middle) if self.volume_below(middle) >= volume else (middle, high)
        return high


def find_depressions(scene: ShapeScene, row: int, low: Array, high: Array) -> Depressions | None:
    """Finds the depressions of a body, seen from above at its current pose; None for a convex shape, which has none.

    The heights of its collision shapes are sampled on a grid; liquid flows over the lowest rim of a depression, and
    through each cell without a shape: depressions are filled as in hydrology (Barnes, Lehman and Mulla 2014).

    Args:
        row: the body.
        low: the lower corner of its bounds [m].
        high: the upper corner [m].
    """
    if np.count_nonzero(scene.owner == row) < 2 or np.any(high[:2] - low[:2] <= 0.0):
        return None
    step = (high[:2] - low[:2]) / _GRID_CELLS
    x, y = (low[axis] + (np.arange(_GRID_CELLS) + 0.5) * step[axis] for axis in (0, 1))
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    height = scene.top_heights(row, grid_x.reshape(-1), grid_y.reshape(-1)).reshape(_GRID_CELLS, _GRID_CELLS)
    level = _filled(np.pad(height, 1, constant_values=-np.inf))[1:-1, 1:-1]
    return Depressions(height, level, (float(step[0]), float(step[1])))


def retained_volume(scene: ShapeScene, row: int, low: Array, high: Array) -> float:
    """Returns the volume of the depressions of a body at its current pose [m³]; see `find_depressions`."""
    found = find_depressions(scene, row, low, high)
    return 0.0 if found is None else found.volume


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
