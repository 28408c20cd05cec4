"""Settings: a world as arrays, and what stands where in it, as far as forms depend on it.

Of what is near each other only pairs are looked at that a sweep finds, so that the cost follows the number of bodies.

Insides: how thick walls may be, where shelves are and what must be left free, by what stands in a thing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mindstage.geometry.procedural.builder import BodySide, Cutout
from mindstage.knowledge.shape_rules import ShapeRule
from mindstage.scene import Body, Iri, World
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, overlapping_pairs
from mindstage.scene.kinematics import RigidGroups, joint_reach, moving_body
from mindstage.scene.model import Joint
from mindstage.scene.transforms import Array, normalize, pose_array, rotation_matrix

__all__ = [
    "Cavity",
    "JointView",
    "Neighborhood",
    "SceneContext",
    "cavity_of",
    "shelf_heights",
    "wall_openings",
    "worktop_cutouts",
]


CONTACT_TOLERANCE_M = 0.02
"""What is no farther away touches: maps leave a gap between a door and its frame."""
_MAX_NEIGHBORS = 512
"""Whoever has more neighbors is in a crowd, where nobody can tell what belongs to whom."""
_UNLIMITED_TRAVEL_M = 10.0
"""A way without an end."""
_MIN_SIZE_M = 1e-6
"""What has no size is taken for a point of so much."""


@dataclass(frozen=True, slots=True)
class Neighborhood:
    """What is near one body."""

    rows: Indices
    low: Array
    """n x 3, the lower corners in the body's own frame [m]."""
    high: Array


@dataclass(frozen=True, slots=True)
class JointView:
    """A constraint as one of its ends sees it."""

    joint: Joint
    moving_row: int
    """The row of the body that gives way."""
    holder_row: int


class SceneContext:
    """n bodies as a map describes them."""

    def __init__(self, world: World, rules: Mapping[Iri, ShapeRule]) -> None:
        """Looks at everything once."""
        self.world = world
        self.bodies: Sequence[Body] = world.bodies
        self.rows = {body.id: row for row, body in enumerate(world.bodies)}
        self.rules = [rules[body.cls] for body in world.bodies]
        self.shape_names = np.array([rule.shape_type for rule in self.rules], dtype=object)
        poses = pose_array(body.pose for body in world.bodies)
        poses[:, 3:] = normalize(poses[:, 3:])
        sizes = np.array([body.size or (_MIN_SIZE_M,) * 3 for body in world.bodies], dtype=float).reshape(-1, 3)
        self.boxes = OrientedBoxes.from_poses(poses, np.maximum(sizes, _MIN_SIZE_M))
        self.volume = np.prod(2 * self.boxes.half_extents, axis=1)
        self.groups = RigidGroups.from_world(world)
        self.is_free = self.groups.is_dynamic & ~self.groups.is_jointed
        """For each body, whether it stands somewhere and could be taken away."""

    def has_shape(self, *shape_names: str) -> NDArray[np.bool_]:
        """For each body, whether it is of one of these kinds."""
        wanted = frozenset(shape_names)
        return np.array([kind in wanted for kind in self.shape_names], dtype=bool)

    def label(self, row: int) -> str:
        """A body in a report: "the drawer X"."""
        return f"the {self.shape_names[row]} {self.bodies[row].id}"

    # -- directions ----------------------------------------------------------------------------------------------------

    def up_side(self, row: int) -> BodySide:
        """The side of a body that looks up, or that of its own z where it can be carried about."""
        return BodySide.TOP if self.is_free[row] else self._up_sides[row]

    @cached_property
    def _up_sides(self) -> list[BodySide]:
        height = self.boxes.rotation[:, 2, :]
        axes = np.argmax(np.abs(height), axis=1)
        signs = np.take_along_axis(height, axes[:, None], axis=1)[:, 0]
        return [
            BodySide.from_axis(axis, 1 if sign >= 0 else -1)
            for axis, sign in zip(axes.tolist(), signs.tolist(), strict=True)
        ]

    def side_towards(self, row: int, direction: Array, *, excluded_axes: Sequence[int] = ()) -> BodySide:
        """The side of a body that looks most in a direction of the world; axes can be left out."""
        shares = direction @ self.boxes.rotation[row]
        shares[list(excluded_axes)] = 0.0
        axis = int(np.argmax(np.abs(shares)))
        if axis in excluded_axes:
            axis = next(each for each in range(3) if each not in excluded_axes)
        return BodySide.from_axis(axis, 1 if shares[axis] >= 0 else -1)

    def direction(self, row: int, side: BodySide) -> Array:
        """Where a side of a body looks, in the world."""
        return np.asarray(side.sign * self.boxes.rotation[row][:, side.axis])

    @cached_property
    def center(self) -> Array:
        """The middle of the place: half of its things stand on either side."""
        small = self.boxes.half_extents.max(axis=1) < 1.5
        centers = np.sort(self.boxes.center[small] if small.any() else self.boxes.center, axis=0)
        half = len(centers) // 2
        # The median; numpy's own would import numpy.ma.
        return np.asarray(centers[half] if len(centers) % 2 else (centers[half - 1] + centers[half]) / 2)

    # -- what belongs together -----------------------------------------------------------------------------------------

    @cached_property
    def joints(self) -> dict[int, list[JointView]]:
        """By body, the constraints that let it move, or that hold something by it."""
        found: dict[int, list[JointView]] = {}
        for constraint in self.world.joints:
            if constraint.parent in self.rows and constraint.child in self.rows:
                ends = [self.bodies[self.rows[end]] for end in (constraint.parent, constraint.child)]
                moving, holder = (self.rows[body.id] for body in moving_body(constraint, *ends))
                for row in {moving, holder}:
                    found.setdefault(row, []).append(JointView(constraint, moving, holder))
        return found

    @cached_property
    def joints_by_holder_group(self) -> dict[int, list[JointView]]:
        """By assembly, the constraints that hold something by any of its bodies."""
        found: dict[int, list[JointView]] = {}
        for row, joints in self.joints.items():
            for joint in joints:
                if joint.holder_row == row:
                    found.setdefault(int(self.groups.root_row[row]), []).append(joint)
        return found

    def sweep_bounds(self, row: int, low: Array, high: Array, host: int) -> tuple[Array, Array]:
        """The corners of a body in the frame of another one, so far apart that all of its way lies between them."""
        number = self.groups.root_row
        for joint in self.joints_by_moving_group.get(int(number[row]), ()):
            ways = joint_reach(joint.joint)
            turn = self.boxes.rotation[host].T @ rotation_matrix(normalize(joint.joint.pose.quaternion))
            far = np.abs(turn) @ np.array(
                [min(way, _UNLIMITED_TRAVEL_M) if way is not None else _UNLIMITED_TRAVEL_M for way in ways[:3]]
            )
            if any(way is None or way > 0.0 for way in ways[3:]):
                far = far + 2.0 * float(self.boxes.half_extents[joint.moving_row].max())
            low, high = low - far, high + far
        return low, high

    @cached_property
    def joints_by_moving_group(self) -> dict[int, list[JointView]]:
        """By assembly, the constraints that let it move."""
        found: dict[int, list[JointView]] = {}
        for row, joints in self.joints.items():
            for joint in joints:
                if joint.moving_row == row:
                    found.setdefault(int(self.groups.root_row[row]), []).append(joint)
        return found

    @cached_property
    def parents(self) -> dict[int, int]:
        """By body, the one that it hangs on."""
        ends = ((hold.child, hold.parent) for hold in self.world.attachments)
        return {self.rows[child]: self.rows[parent] for child, parent in ends if {child, parent} <= self.rows.keys()}

    @cached_property
    def group_members(self) -> dict[int, list[int]]:
        """By assembly, its bodies."""
        found: dict[int, list[int]] = {}
        for row, number in enumerate(self.groups.root_row.tolist()):
            found.setdefault(number, []).append(row)
        return found

    def group_mates(self, row: int) -> list[int]:
        """The other bodies of a body's assembly."""
        return [other for other in self.group_members[int(self.groups.root_row[row])] if other != row]

    # -- what is near --------------------------------------------------------------------------------------------------

    def neighborhoods(self, hosts: NDArray[np.bool_]) -> tuple[dict[int, Neighborhood], list[int]]:
        """What is in or at each of these bodies, and which of them stand in a crowd, where that is not told."""
        count = np.zeros(len(self.bodies), dtype=np.intp)
        everything = np.ones(len(self.bodies), dtype=bool)
        for pairs in (overlapping_pairs(self.boxes, hosts, everything, margin=(CONTACT_TOLERANCE_M,) * 3),):
            for a, b in pairs:
                count += np.bincount(a, minlength=len(count)) + np.bincount(b, minlength=len(count))
        crowded = hosts & (count > _MAX_NEIGHBORS)
        host, other = self._pairs(hosts & ~crowded, everything)
        low, high = self.local_bounds(host, other)
        order = np.argsort(host, kind="stable")
        host, other, low, high = host[order], other[order], low[order], high[order]
        starts = np.searchsorted(host, np.flatnonzero(hosts & ~crowded))
        ends = np.searchsorted(host, np.flatnonzero(hosts & ~crowded), side="right")
        wanted = np.flatnonzero(hosts & ~crowded).tolist()
        found = {
            row: Neighborhood(other[start:end], low[start:end], high[start:end])
            for row, start, end in zip(wanted, starts.tolist(), ends.tolist(), strict=True)
        }
        return found, np.flatnonzero(crowded).tolist()

    def _pairs(self, hosts: NDArray[np.bool_], everything: NDArray[np.bool_]) -> tuple[Indices, Indices]:
        none = np.zeros(0, dtype=np.intp)
        hosting, others = [none], [none]
        for a, b in overlapping_pairs(self.boxes, hosts, everything, margin=(CONTACT_TOLERANCE_M,) * 3):
            for one, other in ((a, b), (b, a)):
                hosting.append(one[hosts[one]])
                others.append(other[hosts[one]])
        return np.concatenate(hosting), np.concatenate(others)

    def local_bounds(self, host: Indices, other: Indices) -> tuple[Array, Array]:
        """Lower and upper corners of bodies in the frames of others, pair by pair."""
        turn = np.swapaxes(self.boxes.rotation[host], 1, 2)
        reach = np.einsum("nij,nj->ni", np.abs(turn @ self.boxes.rotation[other]), self.boxes.half_extents[other])
        middle = np.einsum("nij,nj->ni", turn, self.boxes.center[other] - self.boxes.center[host])
        return middle - reach, middle + reach


_CLEARANCE_M = 0.0005
"""Between a wall and what is next to it."""
_MIN_WALL_M = 0.0005
_SAME_LEVEL_M = 0.004
"""Contents whose undersides differ by less stand on one level."""
_MIN_INSERT_DEPTH_M = 0.002
"""What stands in something by no more only touches it."""
_MAX_CONTENT_FRACTION = 0.5
"""Of the volume of what it is in, nothing loose is larger."""


class Cavity:
    """What is inside one body, in its own frame."""

    def __init__(self, rows: Indices, low: Array, high: Array, is_free: NDArray[np.bool_], half: Array) -> None:
        self.rows = rows
        self.low, self.high = low, high
        self.is_free = is_free
        self.half = half

    def wall_thickness(self, side: BodySide, default: float) -> float:
        """How thick the wall at one side may be [m], at most the usual."""
        axis = side.axis
        reach = self.high[:, axis] if side.sign > 0 else -self.low[:, axis]
        room = float(self.half[axis] - reach.max(initial=-np.inf)) - _CLEARANCE_M
        return float(np.clip(room, min(_MIN_WALL_M, default), default))


def cavity_of(context: SceneContext, row: int, neighborhood: Neighborhood) -> Cavity:
    """What is in a body: loose things, and what slides or hangs in it."""
    half = context.boxes.half_extents[row]
    middle = (neighborhood.low + neighborhood.high) / 2
    within = np.all(np.abs(middle) < half, axis=1)
    loose = (
        within
        & context.is_free[neighborhood.rows]
        & (context.volume[neighborhood.rows] < _MAX_CONTENT_FRACTION * context.volume[row])
    )
    held = (
        within
        & ~context.is_free[neighborhood.rows]
        & np.all((neighborhood.low > -half) & (neighborhood.high < half), axis=1)
    )
    kept = loose | held
    return Cavity(neighborhood.rows[kept], neighborhood.low[kept], neighborhood.high[kept], loose[kept], half)


def shelf_heights(cavity: Cavity, up: BodySide) -> tuple[float, ...]:
    """Where contents stand, upwards from the middle [m], the lowest first; what is on other contents tells nothing."""
    low, high = cavity.low[cavity.is_free], cavity.high[cavity.is_free]
    if not len(low):
        return ()
    axis = up.axis
    flat = [each for each in range(3) if each != axis]
    bottoms, tops = (low[:, axis], high[:, axis]) if up.sign > 0 else (-high[:, axis], -low[:, axis])
    beneath = np.abs(tops - bottoms[:, None]) < _SAME_LEVEL_M
    beside = np.all((low[:, flat] < high[:, None, flat]) & (low[:, None, flat] < high[:, flat]), axis=2)
    stacked = np.any(beneath & beside & ~np.eye(len(low), dtype=bool), axis=1)
    levels: list[float] = []
    for level in sorted(bottoms[~stacked].tolist()):
        if not (levels and level - levels[-1] < _SAME_LEVEL_M):
            levels.append(level)
    return tuple(levels)


def worktop_cutouts(
    context: SceneContext, row: int, neighborhood: Neighborhood, up: BodySide, insert_mask: NDArray[np.bool_]
) -> tuple[Cutout, ...]:
    """What must be left free for sinks and the like that are let into the top of a body."""
    half = context.boxes.half_extents[row]
    axis = up.axis
    flat = [each for each in range(3) if each != axis]
    bottom, top = (neighborhood.low, neighborhood.high) if up.sign > 0 else (-neighborhood.high, -neighborhood.low)
    through = (bottom[:, axis] < half[axis] - _MIN_INSERT_DEPTH_M) & (top[:, axis] > half[axis] - _MIN_INSERT_DEPTH_M)
    framed = np.all((neighborhood.low[:, flat] > -half[flat]) & (neighborhood.high[:, flat] < half[flat]), axis=1)
    return _cutouts(neighborhood, insert_mask[neighborhood.rows] & through & framed)


def wall_openings(
    context: SceneContext,
    row: int,
    neighborhood: Neighborhood,
    opening_mask: NDArray[np.bool_],
    *,
    include_motion: bool = False,
) -> tuple[Cutout, ...]:
    """What a wall must leave free for what stands in it.

    Args:
        setting: the place.
        row: the wall.
        around: what is near it.
        kinds: for each body, whether it may stand in a wall.
        ways: whether the ways on which it moves are left free as well.
    """
    half = context.boxes.half_extents[row]
    chosen = opening_mask[neighborhood.rows] & np.all((neighborhood.low < half) & (neighborhood.high > -half), axis=1)
    if not include_motion:
        return _cutouts(neighborhood, chosen)
    low, high = neighborhood.low.copy(), neighborhood.high.copy()
    for at in np.flatnonzero(chosen).tolist():
        low[at], high[at] = context.sweep_bounds(int(neighborhood.rows[at]), low[at], high[at], row)
    return _cutouts(Neighborhood(neighborhood.rows, low, high), chosen)


def _cutouts(neighborhood: Neighborhood, chosen: NDArray[np.bool_]) -> tuple[Cutout, ...]:
    low = neighborhood.low[chosen] - _CLEARANCE_M
    high = neighborhood.high[chosen] + _CLEARANCE_M
    return tuple(
        Cutout(low=(a[0], a[1], a[2]), high=(b[0], b[1], b[2]))
        for a, b in zip(low.tolist(), high.tolist(), strict=True)
    )
