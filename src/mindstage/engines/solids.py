"""Solids: what of a form can be touched, made ready once for all bodies that have that form.

How large each part is and where it sits come as arrays, for deciding about many bodies at once; how the mass lies is
worked out from the volumes of the parts, as though they were of one stuff and did not overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite, pi

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.hollow import Plate
from mindstage.world import Body, Pose, ShapeKind, Solid, SolidKind, Vector
from mindstage.world.boxes import Boxes
from mindstage.world.geometry import Array, pose_array, rotation_matrix, unit
from mindstage.world.hulls import Hull, hull_round

__all__ = [
    "KINDS",
    "MOST_FACES",
    "SQUARES",
    "THINNEST_M",
    "Prepared",
    "plain_solid",
    "plate_solids",
    "prepare",
    "shape_solid",
]

MOST_FACES = 24
"""Of a hull with more faces than this, the directions of so many have to do."""
_KEPT = 4096
"""Forms that are remembered."""
THINNEST_M = 0.001
"""No engine lets thinner things collide well."""
KINDS = (SolidKind.BOX, SolidKind.SPHERE, SolidKind.CYLINDER, SolidKind.HULL)
_SAME_M = 1e-6
_OF_SHAPE = {
    ShapeKind.BOX: SolidKind.BOX,
    ShapeKind.SPHERE: SolidKind.SPHERE,
    ShapeKind.CYLINDER: SolidKind.CYLINDER,
}
_FILLS = {SolidKind.BOX: 1.0, SolidKind.SPHERE: pi / 6, SolidKind.CYLINDER: pi / 4}
"""The part of its box that a solid fills."""
SQUARES = {
    SolidKind.BOX: (1 / 12, 1 / 12, 1 / 12),
    SolidKind.SPHERE: (1 / 20, 1 / 20, 1 / 20),
    SolidKind.CYLINDER: (1 / 16, 1 / 16, 1 / 12),
}
"""The mean square along each axis of an evenly filled solid, in squares of its extents."""


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """The solids of one form."""

    solids: tuple[Solid, ...]
    """Those that can be used; hulls as points round their own middle."""
    poses: Array
    """k x 7, of the boxes round them in the body's frame, unit quaternions."""
    sizes: Array
    """k x 3, of those boxes."""
    kinds: NDArray[np.intp]
    """k numbers into `KINDS`."""
    hulls: tuple[tuple[int, Array, Array], ...]
    """Of those that are hulls: which one, its corners, and the directions its faces look in, in its box's frame."""
    bounds: tuple[Array, Array]
    """The lower and upper corner of all of them in the body's frame."""
    volume: float
    """Of all of them [m³]."""
    middle: Array
    """Their centre of mass in the body's frame."""
    inertia: Array
    """3 x 3 about that centre, for 1 kg [m²]."""
    left_out: int
    """How many solids have numbers that mean nothing."""

    def fills(self, size: Vector) -> bool:
        """Whether it is just one box of that size."""
        if len(self.solids) != 1 or self.solids[0].kind is not SolidKind.BOX:
            return False
        here = np.abs(self.poses[0] - (0, 0, 0, 1, 0, 0, 0)).max() <= _SAME_M
        return bool(here and np.abs(self.sizes[0] - size).max() <= _SAME_M)


def prepare(given: Sequence[Solid]) -> Prepared:
    """Makes solids ready, the same ones only once.

    What is too thin gets thick enough to touch, a flat hull becomes a box.
    """
    return _prepare(tuple(given))


@lru_cache(maxsize=_KEPT)
def _prepare(given: tuple[Solid, ...]) -> Prepared:
    usable = [_usable(solid) for solid in given if _sensible(solid)]
    solids = tuple(solid for solid, _ in usable)
    hulls = tuple(hull for _, hull in usable)
    poses = pose_array(solid.pose for solid in solids)
    poses[:, 3:] = unit(poses[:, 3:])
    sizes = np.array([solid.size for solid in solids], dtype=float).reshape(-1, 3)
    kinds = np.array([KINDS.index(solid.kind) for solid in solids], dtype=np.intp)
    low, high = Boxes.of(poses, sizes).bounds()
    bounds = (low.min(axis=0), high.max(axis=0)) if solids else (np.zeros(3), np.zeros(3))
    mass = _mass(solids, poses, sizes, hulls)
    faced = tuple((row, hull.points, _directions(hull.normals)) for row, hull in enumerate(hulls) if hull is not None)
    return Prepared(solids, poses, sizes, kinds, faced, bounds, *mass, left_out=len(given) - len(solids))


def _directions(normals: Array) -> Array:
    """The directions that a hull's faces look in, each once, at most `MOST_FACES` of them."""
    once = {tuple(row): None for row in normals.round(6).tolist()}
    kept = np.array(list(once))
    return kept if len(kept) <= MOST_FACES else kept[np.linspace(0, len(kept) - 1, MOST_FACES).astype(np.intp)]


def shape_solid(body: Body) -> SolidKind:
    """Which solid a body without a form is."""
    return _OF_SHAPE[body.shape.kind] if body.shape else SolidKind.BOX


def plain_solid(body: Body, size: Vector) -> Solid:
    """What a body without a form can be touched as."""
    return Solid(kind=shape_solid(body), size=_thick(size))


def plate_solids(plates: tuple[Plate, ...]) -> tuple[Solid, ...]:
    """What a body that was made hollow can be touched as."""
    return tuple(Solid(size=_thick(plate.size), pose=Pose(plate.centre)) for plate in plates)


def _thick(size: Vector) -> Vector:
    x, y, z = size
    return max(x, THINNEST_M), max(y, THINNEST_M), max(z, THINNEST_M)


def _sensible(solid: Solid) -> bool:
    points = [number for point in solid.points for number in point]
    finite = all(map(isfinite, (*solid.size, *solid.pose.position, *solid.pose.quaternion, *points)))
    return finite and any(solid.pose.quaternion) and min(solid.size) >= 0.0


def _usable(solid: Solid) -> tuple[Solid, Hull | None]:
    """A solid round its own middle, thick enough, and the hull that it may be."""
    if solid.kind is not SolidKind.HULL:
        return Solid(kind=solid.kind, size=_thick(solid.size), pose=solid.pose), None
    points = np.array(solid.points, dtype=float).reshape(-1, 3)
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3), np.zeros(3))
    turn = rotation_matrix(unit(solid.pose.quaternion))
    centre = np.array(solid.pose.position) + turn @ ((low + high) / 2)
    x, y, z = np.maximum(high - low, THINNEST_M).tolist()
    pose = Pose((float(centre[0]), float(centre[1]), float(centre[2])), solid.pose.quaternion)
    hull = hull_round(points - (low + high) / 2) if (high - low).min() >= THINNEST_M else None
    if hull is None:
        return Solid(size=(x, y, z), pose=pose), None
    corners = tuple((px, py, pz) for px, py, pz in hull.points[np.unique(hull.faces)].tolist())
    return Solid(kind=SolidKind.HULL, size=(x, y, z), pose=pose, points=corners), hull


def _mass(
    solids: tuple[Solid, ...], poses: Array, sizes: Array, hulls: tuple[Hull | None, ...]
) -> tuple[float, Array, Array]:
    """Volume, centre of mass, and inertia for 1 kg, of all solids together."""
    if not solids:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    turns = rotation_matrix(poses[:, 3:])
    volumes, centres, seconds = np.zeros(len(solids)), poses[:, :3].copy(), np.zeros((len(solids), 3, 3))
    for row, (solid, hull) in enumerate(zip(solids, hulls, strict=True)):
        if hull is None:
            volumes[row] = _FILLS[solid.kind] * float(sizes[row].prod())
            seconds[row] = volumes[row] * np.diag(sizes[row] ** 2 * SQUARES[solid.kind])
        else:
            volumes[row], middle, seconds[row] = hull.moments()
            centres[row] += turns[row] @ middle
    volume = float(volumes.sum())
    middle = volumes @ centres / volume
    away = centres - middle
    second = (turns @ seconds @ np.swapaxes(turns, 1, 2)).sum(axis=0) + (volumes * away.T) @ away
    return volume, middle, (np.trace(second) * np.eye(3) - second) / volume
