"""Facing: which side of each thing is its front, by where it stands and how it moves.

A drawer's front is where it is pulled to, a door's where its handle is, a cupboard's where its doors and drawers are, a
handle's away from what it is on. What nothing tells looks to the middle of the place, and that is a guess.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mindstage.geometry.fit_context import JointView, Neighborhood, SceneContext
from mindstage.geometry.procedural.builder import BodySide
from mindstage.scene.kinematics import axis_ranges, joint_reach
from mindstage.scene.transforms import Array, normalize, quat_rotate

__all__ = ["CABINET_SHAPES", "CLOSING_SHAPES", "FRONTED_SHAPES", "HANDLE_SHAPES", "Orientation", "OrientationSolver"]

HANDLE_SHAPES = ("handle", "knob", "lever")
CLOSING_SHAPES = ("door", "drawer")
"""What tells by itself where the thing that it closes is open."""
SLIDING_SHAPES = ("rack", "tub", "basket", "panel", "shelf")
"""What tells it where it slides."""
CABINET_SHAPES = ("case", "shelf")
_FLAT_SHAPES = ("door", "window", "picture", "screen", "clock", "radiator", "frame", "panel")
"""Their front is across their thinnest side."""
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
"""They stand or hang with their backs to a wall."""
_UPRIGHT_SHAPES = ("counter", "table", "wall", "shell", "sink", "bin", "lamp", "leg")
"""Of them it is only told that they stand upright."""
_OPERABLE_SHAPES = (*CABINET_SHAPES, *CLOSING_SHAPES, *HANDLE_SHAPES, "chair")
"""They have their front where they are used, even if they can be carried away."""
_ORIENTED_SHAPES = frozenset(
    (*_OPERABLE_SHAPES, *SLIDING_SHAPES, *FRONTED_SHAPES, *_UPRIGHT_SHAPES, "tap", "hob", "window", "frame")
)
"""All else can be put anywhere."""
_TABLE_SHAPES = ("table", "counter")
_WALL_SHAPES = ("wall",)
_MAX_CHAIR_DISTANCE_M = 2.0
"""A chair that is farther from any table belongs to none."""
_MAX_WALL_DISTANCE_M = 0.06
"""So far from a wall, something still has its back to it."""
_MIN_BACK_COVERAGE = 0.5
"""So much of a back is against a wall."""
_MIN_LID_COVERAGE = 0.5
"""So much of the top a lid covers."""
_MIN_HANDLE_OFFSET = 0.3
"""A handle so far from the middle, as a share of the half, is on that side."""


class Orientation(NamedTuple):
    """Which way a body stands."""

    up: BodySide
    front: BodySide
    openings: tuple[BodySide, ...] = ()
    """All sides that doors or drawers close, the front first; of cases only."""
    reason: str = ""
    is_guess: bool = False


class OrientationSolver:
    """All bodies of a setting; each is decided when somebody asks."""

    def __init__(self, context: SceneContext, neighborhoods: Mapping[int, Neighborhood]) -> None:
        """Decides nothing yet.

        Args:
            setting: what stands where.
            around: of cases, doors and drawers at least, what is near.
        """
        self._context = context
        self._neighborhoods = neighborhoods
        self._is_handle = context.has_shape(*HANDLE_SHAPES)
        self._is_closing = context.has_shape(*CLOSING_SHAPES)
        self._is_sliding = context.has_shape(*SLIDING_SHAPES)
        self._cache: dict[int, Orientation] = {}

    def orientation_of(self, row: int) -> Orientation:
        """Which way a body stands."""
        if row not in self._cache:
            self._cache[row] = self._solve(row)
        return self._cache[row]

    def _solve(self, row: int) -> Orientation:
        kind = str(self._context.shape_names[row])
        if kind not in _ORIENTED_SHAPES or (self._context.is_free[row] and kind not in _OPERABLE_SHAPES):
            return Orientation(BodySide.TOP, BodySide.FRONT)  # it is as its own axes say, wherever it is put
        up = self._context.up_side(row)
        if kind in CLOSING_SHAPES or (kind in SLIDING_SHAPES and self._slide_direction(row)):
            return self._solve_closing(row, kind, up)
        return self._solvers.get(kind, self._guess)(row, up)

    @cached_property
    def _solvers(self) -> Mapping[str, Callable[[int, BodySide], Orientation]]:
        upright = dict.fromkeys(
            _UPRIGHT_SHAPES, lambda row, up: Orientation(up, _perpendicular_side(BodySide.FRONT, up))
        )
        grips, cases = (
            dict.fromkeys(HANDLE_SHAPES, self._solve_handle),
            dict.fromkeys(CABINET_SHAPES, self._solve_cabinet),
        )
        return {**upright, **grips, **cases, "tap": self._solve_tap, "chair": self._solve_chair}

    # -- doors and drawers ---------------------------------------------------------------------------------------------

    def _solve_closing(self, row: int, shape_name: str, up: BodySide) -> Orientation:
        """Of what is pulled: where it slides, or across its thinnest side, to where its handle or its frame is not."""
        setting = self._context
        slide = self._slide_direction(row)
        axis: int | None = None
        if slide is not None:
            axis = setting.side_towards(row, slide[0], excluded_axes=[up.axis]).axis
        elif shape_name == "door":
            axis = int(np.argmin(setting.boxes.half_extents[row]))
        if (gripped := self._handle_side(row, axis, up)) is not None:
            return Orientation(_perpendicular_side(up, gripped), gripped, reason="where its handle is")
        if slide is not None and slide[1] != 0.0:
            side = setting.side_towards(row, slide[0] * slide[1], excluded_axes=[up.axis])
            return Orientation(up, side, reason="where it is pulled to")
        if (outwards := self._outward_side(row, axis, up)) is not None:
            return Orientation(_perpendicular_side(up, outwards), outwards, reason="away from what it closes")
        return self._guess(row, up, axis)

    def _slide_direction(self, row: int) -> tuple[Array, float] | None:
        """The way in the world along which a body slides most, and which way along it; 0 where it goes either way."""
        for joint in self._context.joints.get(row, ()):
            if joint.moving_row == row and (found := _slide_axis(self._context, joint)) is not None:
                return found
        return None

    def _handle_side(self, row: int, axis: int | None, up: BodySide) -> BodySide | None:
        """The side on which a body has its handle."""
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
        """Handles that are told to hang on nothing, and are at this body."""
        around = self._neighborhoods.get(row)
        if around is None:
            return []
        alone = (
            other for other in around.rows.tolist() if self._is_handle[other] and other not in self._context.parents
        )
        return [other for other in alone if self._context.volume[other] < self._context.volume[row]]

    def _outward_side(self, row: int, axis: int | None, up: BodySide) -> BodySide | None:
        """The side that looks away from what a body closes, where that is told or plain to see."""
        setting = self._context
        held = [joint.holder_row for joint in setting.joints.get(row, ()) if joint.moving_row == row]
        around = self._neighborhoods.get(row)
        near = [] if held or around is None else [other for other in around.rows.tolist() if self._is_cabinet(other)]
        for other in held or near:
            low, high = self._local_bounds(other, [row])
            half = setting.boxes.half_extents[other]
            middle = ((low + high) / 2)[0]
            axes = [each for each in range(3) if each != setting.up_side(other).axis]
            best = min(axes, key=lambda each: float(half[each] - abs(middle[each]) - (high - low)[0][each] / 2))
            outwards = np.zeros(3)
            outwards[best] = np.sign(middle[best]) or 1.0
            without = [each for each in range(3) if axis is not None and each != axis]
            return setting.side_towards(
                row, setting.boxes.rotation[other] @ outwards, excluded_axes=without or [up.axis]
            )
        return None

    def _is_cabinet(self, row: int) -> bool:
        return str(self._context.shape_names[row]) in CABINET_SHAPES

    # -- cases ---------------------------------------------------------------------------------------------------------

    def _solve_cabinet(self, row: int, up: BodySide) -> Orientation:
        """Of what is closed by doors and drawers: where most of them are."""
        area: dict[BodySide, float] = {}
        names: dict[BodySide, str] = {}
        for closer in self._closing_bodies(row):
            side = self._closed_side(row, closer, up)
            if side is not None:
                covers = float(np.prod(np.delete(self._extents(row, closer), side.axis)))
                area[side] = area.get(side, 0.0) + covers
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
        """Doors, drawers and racks that are held by a body or what it hangs on, and those at it that nothing holds."""
        setting = self._context
        for joint in setting.joints_by_holder_group.get(int(setting.groups.root_row[row]), ()):
            if self._is_closing[joint.moving_row] or (
                self._is_sliding[joint.moving_row] and self._slide_direction(joint.moving_row)
            ):
                yield joint.moving_row
        around = self._neighborhoods.get(row)
        if around is not None:
            for other in around.rows.tolist():
                if self._is_closing[other] and not any(
                    joint.moving_row == other for joint in setting.joints.get(other, ())
                ):
                    yield other

    def _closed_side(self, row: int, closer: int, up: BodySide) -> BodySide | None:
        """Which side of a body something closes; None if it is elsewhere."""
        setting = self._context
        half = setting.boxes.half_extents[row]
        (low,), (high,) = self._local_bounds(row, [closer])
        if np.any(low > half + 2 * _touch_tolerance(half)) or np.any(high < -half - 2 * _touch_tolerance(half)):
            return None
        side = setting.side_towards(row, setting.direction(closer, self.orientation_of(closer).front))
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

    # -- the rest ------------------------------------------------------------------------------------------------------

    def _solve_handle(self, row: int, up: BodySide) -> Orientation:
        """Of a handle: away from what it is on."""
        setting = self._context
        on = setting.parents.get(row)
        around = self._neighborhoods.get(row)
        if on is None and around is not None:
            larger = [each for each in around.rows.tolist() if setting.volume[each] > setting.volume[row]]
            on = min(larger, key=lambda each: (not self._is_closing[each], float(setting.volume[each])), default=None)
        if on is None:
            return self._guess(row, up)
        (low,), (high,) = self._local_bounds(on, [row])
        out = (low + high) / 2 / setting.boxes.half_extents[on]
        direction = np.zeros(3)
        best = int(np.argmax(np.abs(out)))
        direction[best] = np.sign(out[best])
        front = setting.side_towards(row, setting.boxes.rotation[on] @ direction)
        return Orientation(_perpendicular_side(up, front), front, reason=f"away from {setting.label(on)}")

    def _solve_tap(self, row: int, up: BodySide) -> Orientation:
        """Of a tap: to where the nearest sink is."""
        way = self._direction_to(row, "sink")
        if way is None:
            return self._guess(row, up)
        return Orientation(up, self._context.side_towards(row, way, excluded_axes=[up.axis]), reason="towards the sink")

    def _solve_chair(self, row: int, up: BodySide) -> Orientation:
        """Of a chair: away from its back, else to the nearest table."""
        setting = self._context
        back = next((each for each in setting.group_mates(row) if setting.shape_names[each] == "panel"), None)
        if back is not None:
            way = setting.boxes.center[row] - setting.boxes.center[back]
            return Orientation(up, setting.side_towards(row, way, excluded_axes=[up.axis]), reason="away from its back")
        to_table = self._direction_to(row, *_TABLE_SHAPES)
        if to_table is None or np.linalg.norm(to_table[:2]) > _MAX_CHAIR_DISTANCE_M:
            return self._guess(row, up)._replace(reason="towards the middle of the place", is_guess=True)
        return Orientation(up, setting.side_towards(row, to_table, excluded_axes=[up.axis]), reason="towards the table")

    def _direction_to(self, row: int, *shape_names: str) -> Array | None:
        """From a body to the nearest one of such a kind."""
        setting = self._context
        rows = np.flatnonzero(setting.has_shape(*shape_names))
        if not len(rows):
            return None
        ways = setting.boxes.center[rows] - setting.boxes.center[row]
        return np.asarray(ways[int(np.argmin(np.linalg.norm(ways, axis=1)))])

    def _guess(self, row: int, up: BodySide, axis: int | None = None) -> Orientation:
        """Away from the wall that something has its back to, else to the middle of the place, across what is thin.

        Args:
            row: the body.
            up: its side that looks up.
            axis: the only one along which it can have its front; None for any that is level.
        """
        kind, half = str(self._context.shape_names[row]), self._context.boxes.half_extents[row]
        flat = [each for each in range(3) if each != up.axis]
        if axis is None and kind in _FLAT_SHAPES:
            axis = int(np.argmin(half))
        if axis == up.axis:  # it lies
            return Orientation(_perpendicular_side(up, up), up)
        axes = flat if axis is None else [axis]
        backs = self._sides_against_walls(row, axes)
        fronts = [side.opposite for side in backs if side.opposite not in backs]
        sides = fronts or [BodySide.from_axis(each, sign) for each in axes for sign in (1, -1)]
        way = (self._context.center - self._context.boxes.center[row]) @ self._context.boxes.rotation[row]
        length = max(float(np.linalg.norm(way[flat])), 1e-9)

        def share(side: BodySide) -> float:
            return side.sign * float(way[side.axis]) / length - 0.5 * float(half[side.axis] > half[flat].min())

        front = max(sides, key=share)
        if fronts:
            return Orientation(up, front, reason="away from the wall")
        guessed = kind in FRONTED_SHAPES or kind in CLOSING_SHAPES
        return Orientation(up, front, reason="towards the middle of the place" if guessed else "", is_guess=guessed)

    def _sides_against_walls(self, row: int, axes: Sequence[int]) -> list[BodySide]:
        """The sides of a body that are against a wall."""
        around, half = self._neighborhoods.get(row), self._context.boxes.half_extents[row]
        if around is None or str(self._context.shape_names[row]) not in FRONTED_SHAPES:
            return []
        walls = np.array([kind in _WALL_SHAPES for kind in self._context.shape_names[around.rows]], dtype=bool)
        low, high = around.low[walls], around.high[walls]
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
    """The way in the world along which a constraint lets its body slide most, and which way along it."""
    ways = joint_reach(joint.joint)[:3]
    lengths = [np.inf if way is None else way for way in ways]
    axis = int(np.argmax(lengths))
    if lengths[axis] <= 0.0:
        return None
    own = np.zeros(3)
    own[axis] = 1.0
    way = quat_rotate(normalize(joint.joint.pose.quaternion), own)
    middle = axis_ranges(joint.joint)[axis].middle
    child_moves = context.bodies[joint.moving_row].id == joint.joint.child
    return way, float(np.sign(middle)) * (1 if child_moves else -1)


def _touch_tolerance(half: Array) -> float:
    return min(0.02, 0.2 * float(half.max()))


def _perpendicular_side(up: BodySide, front: BodySide) -> BodySide:
    """A side to be up, where the one that is would be the front as well."""
    return up if up.axis != front.axis else BodySide.from_axis((front.axis + 1) % 3, 1)
