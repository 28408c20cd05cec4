"""Orientation of bodies: which side is the front, from joints, handles, attachments and neighbors.

The front of a drawer is where it is pulled to, that of a door where its handle is, that of a cupboard where its doors
and drawers are; a handle faces away from the body that it is on. Without such evidence a body faces the center of the
scene, which is marked as a guess.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mindstage.geometry.fit_context import JointView, Neighborhood, SceneContext
from mindstage.geometry.procedural.builder import BodySide
from mindstage.scene.joint_kinematics import axis_ranges, joint_reach
from mindstage.scene.transforms import Array, normalize, quat_rotate

__all__ = ["CABINET_SHAPES", "CLOSING_SHAPES", "FRONTED_SHAPES", "HANDLE_SHAPES", "Orientation", "OrientationSolver"]

HANDLE_SHAPES = ("handle", "knob", "lever")
CLOSING_SHAPES = ("door", "drawer")
"""Shapes that close an opening of a cabinet."""
SLIDING_SHAPES = ("rack", "tub", "basket", "panel", "shelf")
"""Shapes that mark an opening of a cabinet if a joint lets them slide."""
CABINET_SHAPES = ("case", "shelf")
_FLAT_SHAPES = ("door", "window", "picture", "screen", "clock", "radiator", "frame", "panel")
"""Their front is along their smallest extent."""
FRONTED_SHAPES = (
    "case",
    "shelf",
    "sofa",
    "bed",
    "screen",
    "appliance",
    "brewer",
    "radiator",
    "hood",
    "picture",
    "clock",
)
"""Their back is against a wall."""
_UPRIGHT_SHAPES = ("counter", "table", "wall", "shell", "sink", "bin", "lamp", "leg")
"""Only their upward side matters."""
_OPERABLE_SHAPES = (*CABINET_SHAPES, *CLOSING_SHAPES, *HANDLE_SHAPES, "chair")
"""Their front is determined even if they are free."""
_ORIENTED_SHAPES = frozenset(
    (*_OPERABLE_SHAPES, *SLIDING_SHAPES, *FRONTED_SHAPES, *_UPRIGHT_SHAPES, "tap", "hob", "window", "frame")
)
"""All other shapes keep the axes of their body."""
_TABLE_SHAPES = ("table", "counter")
_WALL_SHAPES = ("wall",)
_MAX_CHAIR_DISTANCE_M = 2.0
"""Largest distance of a chair to its table."""
_MAX_WALL_DISTANCE_M = 0.06
"""Largest gap between a back and a wall."""
_MIN_BACK_COVERAGE = 0.5
"""Smallest fraction of a back that is at a wall."""
_MIN_LID_COVERAGE = 0.5
"""Smallest fraction of the top that a lid covers."""
_MIN_HANDLE_OFFSET = 0.3
"""Smallest offset of a handle from the center, as a fraction of the half extent, that determines its side."""


class Orientation(NamedTuple):
    """The sides of a body that face up and to the front."""

    up: BodySide
    front: BodySide
    openings: tuple[BodySide, ...] = ()
    """Open sides of cabinets, the front first; empty for other shapes."""
    reason: str = ""
    """Evidence for the front, for reports."""
    is_guess: bool = False


class OrientationSolver:
    """Determines the orientation of the bodies of a scene, each on first request."""

    def __init__(self, context: SceneContext, neighborhoods: Mapping[int, Neighborhood]) -> None:
        """Stores the scene.

        Args:
            neighborhoods: neighbors by row, at least of cabinets, doors and drawers.
        """
        self._context = context
        self._neighborhoods = neighborhoods
        self._is_handle = context.has_shape(*HANDLE_SHAPES)
        self._is_closing = context.has_shape(*CLOSING_SHAPES)
        self._is_sliding = context.has_shape(*SLIDING_SHAPES)
        self._cache: dict[int, Orientation] = {}

    def orientation_of(self, row: int) -> Orientation:
        """Returns the orientation of a body."""
        if row not in self._cache:
            self._cache[row] = self._solve(row)
        return self._cache[row]

    def _solve(self, row: int) -> Orientation:
        shape_name = str(self._context.shape_names[row])
        if shape_name not in _ORIENTED_SHAPES or (self._context.is_free[row] and shape_name not in _OPERABLE_SHAPES):
            return Orientation(BodySide.TOP, BodySide.FRONT)  # its orientation follows from its pose
        up = self._context.up_side(row)
        if shape_name in CLOSING_SHAPES or (shape_name in SLIDING_SHAPES and self._slide_direction(row)):
            return self._solve_closing(row, shape_name, up)
        return self._solvers.get(shape_name, self._guess)(row, up)

    @cached_property
    def _solvers(self) -> Mapping[str, Callable[[int, BodySide], Orientation]]:
        upright = dict.fromkeys(
            _UPRIGHT_SHAPES, lambda row, up: Orientation(up, _perpendicular_side(BodySide.FRONT, up))
        )
        handles, cabinets = (
            dict.fromkeys(HANDLE_SHAPES, self._solve_handle),
            dict.fromkeys(CABINET_SHAPES, self._solve_cabinet),
        )
        return {**upright, **handles, **cabinets, "tap": self._solve_tap, "chair": self._solve_chair}

    # -- doors and drawers ---------------------------------------------------------------------------------------------

    def _solve_closing(self, row: int, shape_name: str, up: BodySide) -> Orientation:
        """Doors and drawers: along the slide or the smallest extent, towards the handle or away from the cabinet."""
        context = self._context
        slide = self._slide_direction(row)
        axis: int | None = None
        if slide is not None:
            axis = context.side_towards(row, slide[0], excluded_axes=[up.axis]).axis
        elif shape_name == "door":
            axis = int(np.argmin(context.boxes.half_extents[row]))
        if (handle_side := self._handle_side(row, axis, up)) is not None:
            return Orientation(_perpendicular_side(up, handle_side), handle_side, reason="where its handle is")
        if slide is not None and slide[1] != 0.0:
            side = context.side_towards(row, slide[0] * slide[1], excluded_axes=[up.axis])
            return Orientation(up, side, reason="where it is pulled to")
        if (outwards := self._outward_side(row, axis, up)) is not None:
            return Orientation(_perpendicular_side(up, outwards), outwards, reason="away from what it closes")
        return self._guess(row, up, axis)

    def _slide_direction(self, row: int) -> tuple[Array, float] | None:
        """Returns the axis in the world along which a body slides most, and the sign of the opening direction or 0."""
        for joint in self._context.joints.get(row, ()):
            if joint.moving_row == row and (found := _slide_axis(self._context, joint)) is not None:
                return found
        return None

    def _handle_side(self, row: int, axis: int | None, up: BodySide) -> BodySide | None:
        """Returns the side of a body with its handle."""
        rows = [other for other in self._context.group_mates(row) if self._is_handle[other]] or self._nearby_handles(
            row
        )
        if not rows:
            return None
        half = self._context.boxes.half_extents[row]
        low, high = self._local_bounds(row, rows)
        out = ((low + high) / 2).mean(axis=0) / half
        axes = [axis] if axis is not None else [each for each in range(3) if each != up.axis]
        best = max(axes, key=lambda each: abs(out[each]))
        return BodySide.from_axis(best, 1 if out[best] > 0 else -1) if abs(out[best]) > _MIN_HANDLE_OFFSET else None

    def _nearby_handles(self, row: int) -> list[int]:
        """Returns handles near a body that are attached to nothing."""
        neighborhood = self._neighborhoods.get(row)
        if neighborhood is None:
            return []
        detached = (
            other
            for other in neighborhood.rows.tolist()
            if self._is_handle[other] and other not in self._context.parents
        )
        return [other for other in detached if self._context.volume[other] < self._context.volume[row]]

    def _outward_side(self, row: int, axis: int | None, up: BodySide) -> BodySide | None:
        """Returns the side that faces away from the cabinet that a body closes, by its joint or by its position."""
        context = self._context
        held = [joint.fixed_row for joint in context.joints.get(row, ()) if joint.moving_row == row]
        neighborhood = self._neighborhoods.get(row)
        near = (
            []
            if held or neighborhood is None
            else [other for other in neighborhood.rows.tolist() if self._is_cabinet(other)]
        )
        for other in held or near:
            low, high = self._local_bounds(other, [row])
            half = context.boxes.half_extents[other]
            middle = ((low + high) / 2)[0]
            axes = [each for each in range(3) if each != context.up_side(other).axis]
            best = min(axes, key=lambda each: float(half[each] - abs(middle[each]) - (high - low)[0][each] / 2))
            outwards = np.zeros(3)
            outwards[best] = np.sign(middle[best]) or 1.0
            without = [each for each in range(3) if axis is not None and each != axis]
            return context.side_towards(
                row, context.boxes.rotation[other] @ outwards, excluded_axes=without or [up.axis]
            )
        return None

    def _is_cabinet(self, row: int) -> bool:
        return str(self._context.shape_names[row]) in CABINET_SHAPES

    # -- cabinets ------------------------------------------------------------------------------------------------------

    def _solve_cabinet(self, row: int, up: BodySide) -> Orientation:
        """Cabinets: the side with the largest area of doors and drawers."""
        area: dict[BodySide, float] = {}
        names: dict[BodySide, str] = {}
        for closer in self._closing_bodies(row):
            side = self._closed_side(row, closer, up)
            if side is not None:
                closed_area = float(np.prod(np.delete(self._extents(row, closer), side.axis)))
                area[side] = area.get(side, 0.0) + closed_area
                names.setdefault(side, self._context.label(closer))
        upright = sorted((side for side in area if side.axis != up.axis), key=lambda side: -area[side])
        if upright:
            lids = [side for side in area if side == up]
            return Orientation(up, upright[0], (*upright, *lids), reason=f"where {names[upright[0]]} is")
        if area:
            return Orientation(up, self._guess(row, up).front, (up,), reason=f"open where {names[up]} is")
        guess = self._guess(row, up)
        return guess._replace(openings=(guess.front,))

    def _closing_bodies(self, row: int) -> Iterator[int]:
        """Yields doors, drawers and racks that the rigid group of a body holds, and nearby ones without a joint."""
        context = self._context
        for joint in context.joints_by_holder_group.get(int(context.groups.root_row[row]), ()):
            if self._is_closing[joint.moving_row] or (
                self._is_sliding[joint.moving_row] and self._slide_direction(joint.moving_row)
            ):
                yield joint.moving_row
        neighborhood = self._neighborhoods.get(row)
        if neighborhood is not None:
            for other in neighborhood.rows.tolist():
                if self._is_closing[other] and not any(
                    joint.moving_row == other for joint in context.joints.get(other, ())
                ):
                    yield other

    def _closed_side(self, row: int, closer: int, up: BodySide) -> BodySide | None:
        """Returns the side of a body that a door or drawer closes; None if it is elsewhere."""
        context = self._context
        half = context.boxes.half_extents[row]
        (low,), (high,) = self._local_bounds(row, [closer])
        if np.any(low > half + 2 * _touch_tolerance(half)) or np.any(high < -half - 2 * _touch_tolerance(half)):
            return None
        side = context.side_towards(row, context.direction(closer, self.orientation_of(closer).front))
        across = [axis for axis in range(3) if axis != side.axis]
        if np.any(np.abs(low + high)[across] / 2 >= half[across]) or side == up.opposite:
            return None
        if side == up and np.prod((high - low)[across]) < _MIN_LID_COVERAGE * np.prod(2 * half[across]):
            return None
        return side

    def _extents(self, row: int, other: int) -> Array:
        (low,), (high,) = self._local_bounds(row, [other])
        return np.asarray(high - low)

    def _local_bounds(self, row: int, others: Iterable[int]) -> tuple[Array, Array]:
        rows = np.fromiter(others, dtype=np.intp)
        return self._context.local_bounds(np.full(len(rows), row, dtype=np.intp), rows)

    # -- other shapes --------------------------------------------------------------------------------------------------

    def _solve_handle(self, row: int, up: BodySide) -> Orientation:
        """Handles: away from the body that they are on."""
        context = self._context
        on = context.parents.get(row)
        neighborhood = self._neighborhoods.get(row)
        if on is None and neighborhood is not None:
            larger = [each for each in neighborhood.rows.tolist() if context.volume[each] > context.volume[row]]
            on = min(larger, key=lambda each: (not self._is_closing[each], float(context.volume[each])), default=None)
        if on is None:
            return self._guess(row, up)
        (low,), (high,) = self._local_bounds(on, [row])
        out = (low + high) / 2 / context.boxes.half_extents[on]
        direction = np.zeros(3)
        best = int(np.argmax(np.abs(out)))
        direction[best] = np.sign(out[best])
        front = context.side_towards(row, context.boxes.rotation[on] @ direction)
        return Orientation(_perpendicular_side(up, front), front, reason=f"away from {context.label(on)}")

    def _solve_tap(self, row: int, up: BodySide) -> Orientation:
        """Taps: towards the nearest sink."""
        direction = self._direction_to(row, "sink")
        if direction is None:
            return self._guess(row, up)
        return Orientation(
            up, self._context.side_towards(row, direction, excluded_axes=[up.axis]), reason="towards the sink"
        )

    def _solve_chair(self, row: int, up: BodySide) -> Orientation:
        """Chairs: away from the backrest, otherwise towards the nearest table."""
        context = self._context
        backrest = next((each for each in context.group_mates(row) if context.shape_names[each] == "panel"), None)
        if backrest is not None:
            direction = context.boxes.center[row] - context.boxes.center[backrest]
            return Orientation(
                up, context.side_towards(row, direction, excluded_axes=[up.axis]), reason="away from its backrest"
            )
        to_table = self._direction_to(row, *_TABLE_SHAPES)
        if to_table is None or np.linalg.norm(to_table[:2]) > _MAX_CHAIR_DISTANCE_M:
            return self._guess(row, up)._replace(reason="towards the center of the scene", is_guess=True)
        return Orientation(up, context.side_towards(row, to_table, excluded_axes=[up.axis]), reason="towards the table")

    def _direction_to(self, row: int, *shape_names: str) -> Array | None:
        """Returns the vector from a body to the nearest one with such a shape [m]."""
        context = self._context
        rows = np.flatnonzero(context.has_shape(*shape_names))
        if not len(rows):
            return None
        directions = context.boxes.center[rows] - context.boxes.center[row]
        return np.asarray(directions[int(np.argmin(np.linalg.norm(directions, axis=1)))])

    def _guess(self, row: int, up: BodySide, axis: int | None = None) -> Orientation:
        """Away from the wall at the back, otherwise towards the center of the scene, along small extents.

        Args:
            row: the body.
            up: its side that faces up.
            axis: the axis of the front, if known; None for any horizontal one.
        """
        shape_name, half = str(self._context.shape_names[row]), self._context.boxes.half_extents[row]
        flat = [each for each in range(3) if each != up.axis]
        if axis is None and shape_name in _FLAT_SHAPES:
            axis = int(np.argmin(half))
        if axis == up.axis:  # it lies flat
            return Orientation(_perpendicular_side(up, up), up)
        axes = flat if axis is None else [axis]
        backs = self._sides_against_walls(row, axes)
        fronts = [side.opposite for side in backs if side.opposite not in backs]
        sides = fronts or [BodySide.from_axis(each, sign) for each in axes for sign in (1, -1)]
        direction = (self._context.center - self._context.boxes.center[row]) @ self._context.boxes.rotation[row]
        length = max(float(np.linalg.norm(direction[flat])), 1e-9)

        def share(side: BodySide) -> float:
            return side.sign * float(direction[side.axis]) / length - 0.5 * float(half[side.axis] > half[flat].min())

        front = max(sides, key=share)
        if fronts:
            return Orientation(up, front, reason="away from the wall")
        guessed = shape_name in FRONTED_SHAPES or shape_name in CLOSING_SHAPES
        return Orientation(up, front, reason="towards the center of the scene" if guessed else "", is_guess=guessed)

    def _sides_against_walls(self, row: int, axes: Sequence[int]) -> list[BodySide]:
        """Returns the sides of a body that are at a wall."""
        neighborhood, half = self._neighborhoods.get(row), self._context.boxes.half_extents[row]
        if neighborhood is None or str(self._context.shape_names[row]) not in FRONTED_SHAPES:
            return []
        walls = np.array(
            [shape_name in _WALL_SHAPES for shape_name in self._context.shape_names[neighborhood.rows]], dtype=bool
        )
        low, high = neighborhood.low[walls], neighborhood.high[walls]
        found = []
        for side in (BodySide.from_axis(axis, sign) for axis in axes for sign in (1, -1)):
            near = (low[:, side.axis] if side.sign > 0 else -high[:, side.axis]) - half[side.axis]
            across = [axis for axis in range(3) if axis != side.axis]
            both = np.minimum(high, half)[:, across] - np.maximum(low, -half)[:, across]
            covered = np.prod(both.clip(0.0) / (2 * half[across]), axis=1)
            if np.any((np.abs(near) < _MAX_WALL_DISTANCE_M) & (covered > _MIN_BACK_COVERAGE)):
                found.append(side)
        return found


def _slide_axis(context: SceneContext, joint: JointView) -> tuple[Array, float] | None:
    """Returns the axis in the world along which a joint slides most, and the sign of its opening direction or 0."""
    lengths = [np.inf if reach is None else reach for reach in joint_reach(joint.joint)[:3]]
    axis = int(np.argmax(lengths))
    if lengths[axis] <= 0.0:
        return None
    direction = quat_rotate(normalize(joint.joint.pose.quaternion), np.eye(3)[axis])
    middle = axis_ranges(joint.joint)[axis].middle
    child_moves = context.bodies[joint.moving_row].id == joint.joint.child
    return direction, float(np.sign(middle)) * (1 if child_moves else -1)


def _touch_tolerance(half: Array) -> float:
    return min(0.02, 0.2 * float(half.max()))


def _perpendicular_side(up: BodySide, front: BodySide) -> BodySide:
    """Returns `up`, or a side of another axis if `up` and `front` are on one axis."""
    return up if up.axis != front.axis else BodySide.from_axis((front.axis + 1) % 3, 1)
