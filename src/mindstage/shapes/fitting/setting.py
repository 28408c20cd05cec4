"""Settings: a world as arrays, and what stands where in it, as far as forms depend on it.

Of what is near each other only pairs are looked at that a sweep finds, so that the cost follows the number of bodies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mindstage.knowledge.shaping import ShapeRule
from mindstage.shapes.sides import Side
from mindstage.world import Body, Iri, World
from mindstage.world.assemblies import Assemblies, moving_end
from mindstage.world.boxes import Boxes, Indices, neighbours
from mindstage.world.geometry import Array, pose_array, rotation_matrix, unit
from mindstage.world.travel import reaches
from mindstage.world.values import Constraint

__all__ = ["Around", "Joint", "Setting"]

NEAR_M = 0.02
"""What is no farther away touches: maps leave a gap between a door and its frame."""
_CROWD = 512
"""Whoever has more neighbours is in a crowd, where nobody can tell what belongs to whom."""
_FAR_M = 10.0
"""A way without an end."""
_POINT_M = 1e-6
"""What has no size is taken for a point of so much."""


@dataclass(frozen=True, slots=True)
class Around:
    """What is near one body."""

    rows: Indices
    low: Array
    """n x 3, the lower corners in the body's own frame [m]."""
    high: Array


@dataclass(frozen=True, slots=True)
class Joint:
    """A constraint as one of its ends sees it."""

    constraint: Constraint
    moving: int
    """The row of the body that gives way."""
    holder: int


class Setting:
    """n bodies as a map describes them."""

    def __init__(self, world: World, rules: Mapping[Iri, ShapeRule]) -> None:
        """Looks at everything once."""
        self.world = world
        self.bodies: Sequence[Body] = world.bodies
        self.rows = {body.id: row for row, body in enumerate(world.bodies)}
        self.rules = [rules[body.cls] for body in world.bodies]
        self.kinds = np.array([rule.kind for rule in self.rules], dtype=object)
        poses = pose_array(body.pose for body in world.bodies)
        poses[:, 3:] = unit(poses[:, 3:])
        sizes = np.array([body.size or (_POINT_M,) * 3 for body in world.bodies], dtype=float).reshape(-1, 3)
        self.boxes = Boxes.of(poses, np.maximum(sizes, _POINT_M))
        self.volume = np.prod(2 * self.boxes.half, axis=1)
        self.assemblies = Assemblies.of(world)
        self.loose = self.assemblies.moves & ~self.assemblies.hung
        """For each body, whether it stands somewhere and could be taken away."""

    def of_kind(self, *kinds: str) -> NDArray[np.bool_]:
        """For each body, whether it is of one of these kinds."""
        wanted = frozenset(kinds)
        return np.array([kind in wanted for kind in self.kinds], dtype=bool)

    def named(self, row: int) -> str:
        """A body in a report: "the drawer X"."""
        return f"the {self.kinds[row]} {self.bodies[row].id}"

    # -- directions ----------------------------------------------------------------------------------------------------

    def up(self, row: int) -> Side:
        """The side of a body that looks up, or that of its own z where it can be carried about."""
        return Side.TOP if self.loose[row] else self._ups[row]

    @cached_property
    def _ups(self) -> list[Side]:
        height = self.boxes.rotation[:, 2, :]
        axes = np.argmax(np.abs(height), axis=1)
        signs = np.take_along_axis(height, axes[:, None], axis=1)[:, 0]
        return [Side.of(axis, 1 if sign >= 0 else -1) for axis, sign in zip(axes.tolist(), signs.tolist(), strict=True)]

    def side_towards(self, row: int, direction: Array, *, without: Sequence[int] = ()) -> Side:
        """The side of a body that looks most in a direction of the world; axes can be left out."""
        shares = direction @ self.boxes.rotation[row]
        shares[list(without)] = 0.0
        axis = int(np.argmax(np.abs(shares)))
        if axis in without:
            axis = next(each for each in range(3) if each not in without)
        return Side.of(axis, 1 if shares[axis] >= 0 else -1)

    def direction(self, row: int, side: Side) -> Array:
        """Where a side of a body looks, in the world."""
        return np.asarray(side.sign * self.boxes.rotation[row][:, side.axis])

    @cached_property
    def middle(self) -> Array:
        """The middle of the place: half of its things stand on either side."""
        small = self.boxes.half.max(axis=1) < 1.5
        centres = np.sort(self.boxes.centre[small] if small.any() else self.boxes.centre, axis=0)
        half = len(centres) // 2
        # The median; numpy's own would import numpy.ma.
        return np.asarray(centres[half] if len(centres) % 2 else (centres[half - 1] + centres[half]) / 2)

    # -- what belongs together -----------------------------------------------------------------------------------------

    @cached_property
    def joints(self) -> dict[int, list[Joint]]:
        """By body, the constraints that let it move, or that hold something by it."""
        found: dict[int, list[Joint]] = {}
        for constraint in self.world.constraints:
            if constraint.parent in self.rows and constraint.child in self.rows:
                ends = [self.bodies[self.rows[end]] for end in (constraint.parent, constraint.child)]
                moving, holder = (self.rows[body.id] for body in moving_end(constraint, *ends))
                for row in {moving, holder}:
                    found.setdefault(row, []).append(Joint(constraint, moving, holder))
        return found

    @cached_property
    def assembly_joints(self) -> dict[int, list[Joint]]:
        """By assembly, the constraints that hold something by any of its bodies."""
        found: dict[int, list[Joint]] = {}
        for row, joints in self.joints.items():
            for joint in joints:
                if joint.holder == row:
                    found.setdefault(int(self.assemblies.number[row]), []).append(joint)
        return found

    def swept(self, row: int, low: Array, high: Array, host: int) -> tuple[Array, Array]:
        """The corners of a body in the frame of another one, so far apart that all of its way lies between them."""
        number = self.assemblies.number
        for joint in self.joints_of_assembly.get(int(number[row]), ()):
            ways = reaches(joint.constraint)
            turn = self.boxes.rotation[host].T @ rotation_matrix(unit(joint.constraint.pose.quaternion))
            far = np.abs(turn) @ np.array([min(way, _FAR_M) if way is not None else _FAR_M for way in ways[:3]])
            if any(way is None or way > 0.0 for way in ways[3:]):
                far = far + 2.0 * float(self.boxes.half[joint.moving].max())
            low, high = low - far, high + far
        return low, high

    @cached_property
    def joints_of_assembly(self) -> dict[int, list[Joint]]:
        """By assembly, the constraints that let it move."""
        found: dict[int, list[Joint]] = {}
        for row, joints in self.joints.items():
            for joint in joints:
                if joint.moving == row:
                    found.setdefault(int(self.assemblies.number[row]), []).append(joint)
        return found

    @cached_property
    def parents(self) -> dict[int, int]:
        """By body, the one that it hangs on."""
        ends = ((hold.child, hold.parent) for hold in self.world.attachments)
        return {self.rows[child]: self.rows[parent] for child, parent in ends if {child, parent} <= self.rows.keys()}

    @cached_property
    def members(self) -> dict[int, list[int]]:
        """By assembly, its bodies."""
        found: dict[int, list[int]] = {}
        for row, number in enumerate(self.assemblies.number.tolist()):
            found.setdefault(number, []).append(row)
        return found

    def together_with(self, row: int) -> list[int]:
        """The other bodies of a body's assembly."""
        return [other for other in self.members[int(self.assemblies.number[row])] if other != row]

    # -- what is near --------------------------------------------------------------------------------------------------

    def around(self, hosts: NDArray[np.bool_]) -> tuple[dict[int, Around], list[int]]:
        """What is in or at each of these bodies, and which of them stand in a crowd, where that is not told."""
        count = np.zeros(len(self.bodies), dtype=np.intp)
        everything = np.ones(len(self.bodies), dtype=bool)
        for pairs in (neighbours(self.boxes, hosts, everything, within=(NEAR_M,) * 3),):
            for a, b in pairs:
                count += np.bincount(a, minlength=len(count)) + np.bincount(b, minlength=len(count))
        crowded = hosts & (count > _CROWD)
        host, other = self._pairs(hosts & ~crowded, everything)
        low, high = self.within(host, other)
        order = np.argsort(host, kind="stable")
        host, other, low, high = host[order], other[order], low[order], high[order]
        starts = np.searchsorted(host, np.flatnonzero(hosts & ~crowded))
        ends = np.searchsorted(host, np.flatnonzero(hosts & ~crowded), side="right")
        wanted = np.flatnonzero(hosts & ~crowded).tolist()
        found = {
            row: Around(other[start:end], low[start:end], high[start:end])
            for row, start, end in zip(wanted, starts.tolist(), ends.tolist(), strict=True)
        }
        return found, np.flatnonzero(crowded).tolist()

    def _pairs(self, hosts: NDArray[np.bool_], everything: NDArray[np.bool_]) -> tuple[Indices, Indices]:
        none = np.zeros(0, dtype=np.intp)
        hosting, others = [none], [none]
        for a, b in neighbours(self.boxes, hosts, everything, within=(NEAR_M,) * 3):
            for one, other in ((a, b), (b, a)):
                hosting.append(one[hosts[one]])
                others.append(other[hosts[one]])
        return np.concatenate(hosting), np.concatenate(others)

    def within(self, host: Indices, other: Indices) -> tuple[Array, Array]:
        """Lower and upper corners of bodies in the frames of others, pair by pair."""
        turn = np.swapaxes(self.boxes.rotation[host], 1, 2)
        reach = np.einsum("nij,nj->ni", np.abs(turn @ self.boxes.rotation[other]), self.boxes.half[other])
        middle = np.einsum("nij,nj->ni", turn, self.boxes.centre[other] - self.boxes.centre[host])
        return middle - reach, middle + reach
