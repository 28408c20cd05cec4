"""The scene as arrays: neighbors, joints and contents of bodies, as far as their geometry depends on them.

Neighbors are found by a sweep over bounding boxes, so the cost grows with the number of bodies, not with its square.
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
from mindstage.scene.joint_kinematics import RigidGroups, joint_reach, moving_body
from mindstage.scene.transforms import Array, normalize, pose_array, rotation_matrix
from mindstage.scene.world_model import Joint

__all__ = [
    "MAX_NEIGHBORS",
    "Cavity",
    "JointView",
    "Neighborhood",
    "SceneContext",
    "cavity_of",
    "shelf_heights",
    "tray_heights",
    "wall_openings",
    "worktop_cutouts",
]


CONTACT_TOLERANCE_M = 0.02
"""Bodies with a smaller gap are in contact: maps leave a gap between a door and its frame."""
MAX_NEIGHBORS = 512
"""The neighborhood of a body with more neighbors is not evaluated."""
_UNLIMITED_TRAVEL_M = 10.0
"""Travel of an unlimited joint."""
_MIN_SIZE_M = 1e-6
"""Extent of bodies without a size."""


@dataclass(frozen=True, slots=True)
class Neighborhood:
    """The bodies near one body."""

    rows: Indices
    low: Array
    """n x 3, lower corners of their bounds in the frame of that body [m]."""
    high: Array
    """n x 3, upper corners [m]."""


@dataclass(frozen=True, slots=True)
class JointView:
    """A joint with the roles of its bodies."""

    joint: Joint
    moving_row: int
    """Row of the body that the joint moves."""
    fixed_row: int
    """Row of the other body."""


class SceneContext:
    """A world with shape rules, as arrays; rows are indices into `World.bodies`."""

    def __init__(self, world: World, rules: Mapping[Iri, ShapeRule]) -> None:
        """Computes the arrays that are always needed; all else is computed on first access."""
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
        """For each body, whether it is dynamic and not held by a joint."""

    def has_shape(self, *shape_names: str) -> NDArray[np.bool_]:
        """Returns, for each body, whether it has one of these shapes."""
        wanted = frozenset(shape_names)
        return np.array([name in wanted for name in self.shape_names], dtype=bool)

    def label(self, row: int) -> str:
        """Returns the description of a body in reports: "the drawer X"."""
        return f"the {self.shape_names[row]} {self.bodies[row].id}"

    # -- directions ----------------------------------------------------------------------------------------------------

    def up_side(self, row: int) -> BodySide:
        """Returns the side of a body that faces up; the top of the body frame if it is free."""
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
        """Returns the side of a body whose normal is closest to a direction in the world."""
        shares = direction @ self.boxes.rotation[row]
        shares[list(excluded_axes)] = 0.0
        axis = int(np.argmax(np.abs(shares)))
        if axis in excluded_axes:
            axis = next(each for each in range(3) if each not in excluded_axes)
        return BodySide.from_axis(axis, 1 if shares[axis] >= 0 else -1)

    def direction(self, row: int, side: BodySide) -> Array:
        """Returns the normal of a side of a body, in the world frame."""
        return np.asarray(side.sign * self.boxes.rotation[row][:, side.axis])

    @cached_property
    def center(self) -> Array:
        """The center of the scene: the median position of small bodies [m]."""
        small = self.boxes.half_extents.max(axis=1) < 1.5
        centers = np.sort(self.boxes.center[small] if small.any() else self.boxes.center, axis=0)
        half = len(centers) // 2
        # The median, without the import of numpy.ma by numpy.median.
        return np.asarray(centers[half] if len(centers) % 2 else (centers[half - 1] + centers[half]) / 2)

    # -- joints and attachments ----------------------------------------------------------------------------------------

    @cached_property
    def joints(self) -> dict[int, list[JointView]]:
        """Joints by the rows of both of their bodies."""
        found: dict[int, list[JointView]] = {}
        for joint in self.world.joints:
            if joint.parent in self.rows and joint.child in self.rows:
                ends = [self.bodies[self.rows[end]] for end in (joint.parent, joint.child)]
                moving, holder = (self.rows[body.id] for body in moving_body(joint, *ends))
                for row in {moving, holder}:
                    found.setdefault(row, []).append(JointView(joint, moving, holder))
        return found

    @cached_property
    def joints_by_holder_group(self) -> dict[int, list[JointView]]:
        """Joints by the rigid group that holds them."""
        found: dict[int, list[JointView]] = {}
        for row, joints in self.joints.items():
            for joint in joints:
                if joint.fixed_row == row:
                    found.setdefault(int(self.groups.root_row[row]), []).append(joint)
        return found

    def sweep_bounds(self, row: int, low: Array, high: Array, host: int) -> tuple[Array, Array]:
        """Returns the bounds of a body in the frame of the host, extended by the range of the joints that move it."""
        for joint in self.joints_by_moving_group.get(int(self.groups.root_row[row]), ()):
            reach = joint_reach(joint.joint)
            turn = self.boxes.rotation[host].T @ rotation_matrix(normalize(joint.joint.pose.quaternion))
            travel = np.abs(turn) @ np.array(
                [min(each, _UNLIMITED_TRAVEL_M) if each is not None else _UNLIMITED_TRAVEL_M for each in reach[:3]]
            )
            if any(each is None or each > 0.0 for each in reach[3:]):
                travel = travel + 2.0 * float(self.boxes.half_extents[joint.moving_row].max())
            low, high = low - travel, high + travel
        return low, high

    @cached_property
    def joints_by_moving_group(self) -> dict[int, list[JointView]]:
        """Joints by the rigid group that they move."""
        found: dict[int, list[JointView]] = {}
        for row, joints in self.joints.items():
            for joint in joints:
                if joint.moving_row == row:
                    found.setdefault(int(self.groups.root_row[row]), []).append(joint)
        return found

    @cached_property
    def parents(self) -> dict[int, int]:
        """Rows of the parents of attached bodies, by the row of the child."""
        ends = ((attachment.child, attachment.parent) for attachment in self.world.attachments)
        return {self.rows[child]: self.rows[parent] for child, parent in ends if {child, parent} <= self.rows.keys()}

    @cached_property
    def group_members(self) -> dict[int, list[int]]:
        """Rows of the bodies of each rigid group."""
        found: dict[int, list[int]] = {}
        for row, root in enumerate(self.groups.root_row.tolist()):
            found.setdefault(root, []).append(row)
        return found

    def group_mates(self, row: int) -> list[int]:
        """Returns the other bodies of the rigid group of a body."""
        return [other for other in self.group_members[int(self.groups.root_row[row])] if other != row]

    # -- neighborhoods -------------------------------------------------------------------------------------------------

    def neighborhoods(self, hosts: NDArray[np.bool_]) -> tuple[dict[int, Neighborhood], list[int]]:
        """Returns the neighborhoods of the hosts, and the hosts that have too many neighbors for one."""
        if len(self.bodies) == 1:
            none = np.zeros((0, 3))
            alone = Neighborhood(np.zeros(0, dtype=np.intp), none, none)
            return dict.fromkeys(np.flatnonzero(hosts).tolist(), alone), []
        count = np.zeros(len(self.bodies), dtype=np.intp)
        everything = np.ones(len(self.bodies), dtype=bool)
        for a, b in overlapping_pairs(self.boxes, hosts, everything, margin=(CONTACT_TOLERANCE_M,) * 3):
            count += np.bincount(a, minlength=len(count)) + np.bincount(b, minlength=len(count))
        crowded = hosts & (count > MAX_NEIGHBORS)
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
        """Returns, for each pair, the bounds of the other body in the frame of the host."""
        turn = np.swapaxes(self.boxes.rotation[host], 1, 2)
        reach = np.einsum("nij,nj->ni", np.abs(turn @ self.boxes.rotation[other]), self.boxes.half_extents[other])
        middle = np.einsum("nij,nj->ni", turn, self.boxes.center[other] - self.boxes.center[host])
        return middle - reach, middle + reach


_CLEARANCE_M = 0.0005
"""Gap between a wall and its neighbor."""
_MIN_WALL_M = 0.0005
_SAME_LEVEL_M = 0.004
"""Contents whose undersides differ by less share a level."""
_MAX_STACK_GAP_M = 0.03
"""In a drawer, contents that are this near above others stand on these, not on a tray."""
_MIN_TRAY_SPACING_M = 0.1
_MIN_INSERT_DEPTH_M = 0.002
"""Bodies with a smaller overlap are in contact, but not inserted."""
_MAX_CONTENT_FRACTION = 0.5
"""Largest volume of free contents, as a fraction of the volume of the container."""


class Cavity:
    """The contents of one body, in its frame."""

    def __init__(self, rows: Indices, low: Array, high: Array, is_free: NDArray[np.bool_], half: Array) -> None:
        self.rows = rows
        self.low, self.high = low, high
        self.is_free = is_free
        self.half = half

    def wall_thickness(self, side: BodySide, default: float) -> float:
        """Returns the thickness of a wall that leaves room for the contents [m], at most the default."""
        axis = side.axis
        reach = self.high[:, axis] if side.sign > 0 else -self.low[:, axis]
        room = float(self.half[axis] - reach.max(initial=-np.inf)) - _CLEARANCE_M
        return float(np.clip(room, min(_MIN_WALL_M, default), default))


def cavity_of(context: SceneContext, row: int, neighborhood: Neighborhood) -> Cavity:
    """Returns the contents of a body: free bodies, and bodies that are held inside of it.

    What is in a drawer of the body is not among its contents: no shelf of the body carries it.
    """
    half = context.boxes.half_extents[row]
    middle = (neighborhood.low + neighborhood.high) / 2
    moving = [joint.moving_row for joint in context.joints.get(row, ()) if joint.fixed_row == row]
    parts = np.isin(neighborhood.rows, moving)
    low, high = neighborhood.low[parts], neighborhood.high[parts]
    in_part = np.any(np.all((middle[:, None] > low) & (middle[:, None] < high), axis=2), axis=1) & ~parts
    is_inside = np.all(np.abs(middle) < half, axis=1)
    free = (
        is_inside
        & ~in_part
        & context.is_free[neighborhood.rows]
        & (context.volume[neighborhood.rows] < _MAX_CONTENT_FRACTION * context.volume[row])
    )
    held = (
        is_inside
        & ~context.is_free[neighborhood.rows]
        & np.all((neighborhood.low > -half) & (neighborhood.high < half), axis=1)
    )
    kept = free | held
    return Cavity(neighborhood.rows[kept], neighborhood.low[kept], neighborhood.high[kept], free[kept], half)


def shelf_heights(cavity: Cavity, up: BodySide) -> tuple[float, ...]:
    """Returns the heights at which contents stand, from the center [m], ascending; stacked contents are ignored."""
    bottoms, _, stacked = _standing(cavity, up, _SAME_LEVEL_M)
    levels: list[float] = []
    for level in sorted(bottoms[~stacked].tolist()):
        if not (levels and level - levels[-1] < _SAME_LEVEL_M):
            levels.append(level)
    return tuple(levels)


def tray_heights(cavity: Cavity, up: BodySide) -> tuple[float, ...]:
    """Returns the heights of the trays of a drawer, from the center [m], ascending; the lowest is its floor.

    A tray is where contents stand far above the one below, have nothing under them, and nothing passes through it.
    """
    bottoms, tops, stacked = _standing(cavity, up, _MAX_STACK_GAP_M)
    levels = list(shelf_heights(cavity, up)[:1])
    for level in sorted(bottoms[~stacked].tolist()):
        passes = (bottoms < level - _SAME_LEVEL_M) & (tops > level + _SAME_LEVEL_M)
        if levels and level - levels[-1] >= _MIN_TRAY_SPACING_M and not passes.any():
            levels.append(level)
    return tuple(levels)


def _standing(cavity: Cavity, up: BodySide, max_gap_m: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The heights of the undersides and tops of free contents, and whether each has another one under it."""
    low, high = cavity.low[cavity.is_free], cavity.high[cavity.is_free]
    axis = up.axis
    flat = [each for each in range(3) if each != axis]
    bottoms, tops = (low[:, axis], high[:, axis]) if up.sign > 0 else (-high[:, axis], -low[:, axis])
    beneath = np.abs(tops - bottoms[:, None]) < max_gap_m
    beside = np.all((low[:, flat] < high[:, None, flat]) & (low[:, None, flat] < high[:, flat]), axis=2)
    return bottoms, tops, np.any(beneath & beside & ~np.eye(len(low), dtype=bool), axis=1)


def worktop_cutouts(
    context: SceneContext, row: int, neighborhood: Neighborhood, up: BodySide, insert_mask: NDArray[np.bool_]
) -> tuple[Cutout, ...]:
    """Returns the cutouts for sinks and other bodies that are inserted into the top of a body."""
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
    """Returns the openings of a wall for the bodies in it.

    Args:
        row: the wall.
        neighborhood: the neighbors of the wall.
        opening_mask: for each body, whether it needs an opening.
        include_motion: whether openings include the range of motion of these bodies.
    """
    half = context.boxes.half_extents[row]
    chosen = opening_mask[neighborhood.rows] & np.all((neighborhood.low < half) & (neighborhood.high > -half), axis=1)
    if not include_motion:
        return _cutouts(neighborhood, chosen)
    low, high = neighborhood.low.copy(), neighborhood.high.copy()
    for index in np.flatnonzero(chosen).tolist():
        low[index], high[index] = context.sweep_bounds(int(neighborhood.rows[index]), low[index], high[index], row)
    return _cutouts(Neighborhood(neighborhood.rows, low, high), chosen)


def _cutouts(neighborhood: Neighborhood, chosen: NDArray[np.bool_]) -> tuple[Cutout, ...]:
    low = neighborhood.low[chosen] - _CLEARANCE_M
    high = neighborhood.high[chosen] + _CLEARANCE_M
    return tuple(
        Cutout(low=(a[0], a[1], a[2]), high=(b[0], b[1], b[2]))
        for a, b in zip(low.tolist(), high.tolist(), strict=True)
    )
