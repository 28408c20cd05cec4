"""Facing: which side of each thing is its front, by where it stands and how it moves.

A drawer's front is where it is pulled to, a door's where its handle is, a cupboard's where its doors and drawers are, a
handle's away from what it is on. What nothing tells looks to the middle of the place, and that is a guess.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mindstage.shapes.fitting.setting import Around, Joint, Setting
from mindstage.shapes.sides import Side
from mindstage.world.geometry import Array, rotate, unit
from mindstage.world.travel import axis_ranges, reaches

__all__ = ["CASES", "CLOSING", "GRIPS", "LOOKING", "Faces", "Facing"]

GRIPS = ("handle", "knob", "lever")
CLOSING = ("door", "drawer")
"""What tells by itself where the thing that it closes is open."""
SLIDING = ("rack", "tub", "basket", "panel", "shelf")
"""What tells it where it slides."""
CASES = ("case", "shelf")
_FLAT = ("door", "window", "picture", "screen", "clock", "radiator", "frame", "panel")
"""Their front is across their thinnest side."""
LOOKING = ("case", "shelf", "sofa", "bed", "screen", "appliance", "brewer", "radiator", "hood", "picture", "clock")
"""They stand or hang with their backs to a wall."""
_LEVEL = ("counter", "table", "wall", "shell", "sink", "bin", "lamp", "leg")
"""Of them it is only told that they stand upright."""
_OPENED = (*CASES, *CLOSING, *GRIPS, "chair")
"""They have their front where they are used, even if they can be carried away."""
_MADE_FOR_A_PLACE = frozenset((*_OPENED, *SLIDING, *LOOKING, *_LEVEL, "tap", "hob", "window", "frame"))
"""All else can be put anywhere."""
_TABLES = ("table", "counter")
_WALLS = ("wall",)
_SEATED_M = 2.0
"""A chair that is farther from any table belongs to none."""
_LEANS_M = 0.06
"""So far from a wall, something still has its back to it."""
_COVERED = 0.5
"""So much of a back is against a wall."""
_LID_SHARE = 0.5
"""So much of the top a lid covers."""
_STICKS_OUT = 0.3
"""A handle so far from the middle, as a share of the half, is on that side."""


class Facing(NamedTuple):
    """Which way a body stands."""

    up: Side
    front: Side
    openings: tuple[Side, ...] = ()
    """All sides that doors or drawers close, the front first; of cases only."""
    why: str = ""
    guessed: bool = False


class Faces:
    """All bodies of a setting; each is decided when somebody asks."""

    def __init__(self, setting: Setting, around: Mapping[int, Around]) -> None:
        """Decides nothing yet.

        Args:
            setting: what stands where.
            around: of cases, doors and drawers at least, what is near.
        """
        self._setting = setting
        self._around = around
        self._grips = setting.of_kind(*GRIPS)
        self._closing = setting.of_kind(*CLOSING)
        self._slides = setting.of_kind(*SLIDING)
        self._known: dict[int, Facing] = {}

    def of(self, row: int) -> Facing:
        """Which way a body stands."""
        if row not in self._known:
            self._known[row] = self._decide(row)
        return self._known[row]

    def _decide(self, row: int) -> Facing:
        kind = str(self._setting.kinds[row])
        if kind not in _MADE_FOR_A_PLACE or (self._setting.loose[row] and kind not in _OPENED):
            return Facing(Side.TOP, Side.FRONT)  # it is as its own axes say, wherever it is put
        up = self._setting.up(row)
        if kind in CLOSING or (kind in SLIDING and self._slide(row)):
            return self._closer(row, kind, up)
        return self._deciders.get(kind, self._guess)(row, up)

    @cached_property
    def _deciders(self) -> Mapping[str, Callable[[int, Side], Facing]]:
        upright = dict.fromkeys(_LEVEL, lambda row, up: Facing(up, _apart(Side.FRONT, up)))
        grips, cases = dict.fromkeys(GRIPS, self._grip), dict.fromkeys(CASES, self._case)
        return {**upright, **grips, **cases, "tap": self._tap, "chair": self._chair}

    # -- doors and drawers ---------------------------------------------------------------------------------------------

    def _closer(self, row: int, kind: str, up: Side) -> Facing:
        """Of what is pulled: where it slides, or across its thinnest side, to where its handle or its frame is not."""
        setting = self._setting
        slide = self._slide(row)
        axis: int | None = None
        if slide is not None:
            axis = setting.side_towards(row, slide[0], without=[up.axis]).axis
        elif kind == "door":
            axis = int(np.argmin(setting.boxes.half[row]))
        if (gripped := self._gripped(row, axis, up)) is not None:
            return Facing(_apart(up, gripped), gripped, why="where its handle is")
        if slide is not None and slide[1] != 0.0:
            side = setting.side_towards(row, slide[0] * slide[1], without=[up.axis])
            return Facing(up, side, why="where it is pulled to")
        if (outwards := self._outwards(row, axis, up)) is not None:
            return Facing(_apart(up, outwards), outwards, why="away from what it closes")
        return self._guess(row, up, axis)

    def _slide(self, row: int) -> tuple[Array, float] | None:
        """The way in the world along which a body slides most, and which way along it; 0 where it goes either way."""
        for joint in self._setting.joints.get(row, ()):
            if joint.moving == row and (found := _sliding(self._setting, joint)) is not None:
                return found
        return None

    def _gripped(self, row: int, axis: int | None, up: Side) -> Side | None:
        """The side on which a body has its handle."""
        rows = [other for other in self._setting.together_with(row) if self._grips[other]] or self._near_grips(row)
        if not rows:
            return None
        half = self._setting.boxes.half[row]
        low, high = self._within(row, rows)
        out = ((low + high) / 2).mean(axis=0) / half
        axes = [axis] if axis is not None else [each for each in range(3) if each != up.axis]
        best = max(axes, key=lambda each: abs(out[each]))
        return Side.of(best, 1 if out[best] > 0 else -1) if abs(out[best]) > _STICKS_OUT else None

    def _near_grips(self, row: int) -> list[int]:
        """Handles that are told to hang on nothing, and are at this body."""
        around = self._around.get(row)
        if around is None:
            return []
        alone = (other for other in around.rows.tolist() if self._grips[other] and other not in self._setting.parents)
        return [other for other in alone if self._setting.volume[other] < self._setting.volume[row]]

    def _outwards(self, row: int, axis: int | None, up: Side) -> Side | None:
        """The side that looks away from what a body closes, where that is told or plain to see."""
        setting = self._setting
        held = [joint.holder for joint in setting.joints.get(row, ()) if joint.moving == row]
        around = self._around.get(row)
        near = [] if held or around is None else [other for other in around.rows.tolist() if self._is_case(other)]
        for other in held or near:
            low, high = self._within(other, [row])
            half = setting.boxes.half[other]
            middle = ((low + high) / 2)[0]
            axes = [each for each in range(3) if each != setting.up(other).axis]
            best = min(axes, key=lambda each: float(half[each] - abs(middle[each]) - (high - low)[0][each] / 2))
            outwards = np.zeros(3)
            outwards[best] = np.sign(middle[best]) or 1.0
            without = [each for each in range(3) if axis is not None and each != axis]
            return setting.side_towards(row, setting.boxes.rotation[other] @ outwards, without=without or [up.axis])
        return None

    def _is_case(self, row: int) -> bool:
        return str(self._setting.kinds[row]) in CASES

    # -- cases ---------------------------------------------------------------------------------------------------------

    def _case(self, row: int, up: Side) -> Facing:
        """Of what is closed by doors and drawers: where most of them are."""
        area: dict[Side, float] = {}
        names: dict[Side, str] = {}
        for closer in self._closers(row):
            side = self._closed(row, closer, up)
            if side is not None:
                covers = float(np.prod(np.delete(self._extents(row, closer), side.axis)))
                area[side] = area.get(side, 0.0) + covers
                names.setdefault(side, self._setting.named(closer))
        upright = sorted((side for side in area if side.axis != up.axis), key=lambda side: -area[side])
        if upright:
            lids = [side for side in area if side == up]
            return Facing(up, upright[0], (*upright, *lids), why=f"where {names[upright[0]]} is")
        if area:
            return Facing(up, self._guess(row, up).front, (up,), why=f"open where {names[up]} is")
        guess = self._guess(row, up)
        return guess._replace(openings=(guess.front,))

    def _closers(self, row: int) -> Iterator[int]:
        """Doors, drawers and racks that are held by a body or what it hangs on, and those at it that nothing holds."""
        setting = self._setting
        for joint in setting.assembly_joints.get(int(setting.assemblies.number[row]), ()):
            if self._closing[joint.moving] or (self._slides[joint.moving] and self._slide(joint.moving)):
                yield joint.moving
        around = self._around.get(row)
        if around is not None:
            for other in around.rows.tolist():
                if self._closing[other] and not any(joint.moving == other for joint in setting.joints.get(other, ())):
                    yield other

    def _closed(self, row: int, closer: int, up: Side) -> Side | None:
        """Which side of a body something closes; None if it is elsewhere."""
        setting = self._setting
        half = setting.boxes.half[row]
        (low,), (high,) = self._within(row, [closer])
        if np.any(low > half + 2 * _touch(half)) or np.any(high < -half - 2 * _touch(half)):
            return None
        side = setting.side_towards(row, setting.direction(closer, self.of(closer).front))
        across = [axis for axis in range(3) if axis != side.axis]
        if np.any(np.abs(low + high)[across] / 2 >= half[across]) or side == up.opposite:
            return None
        if side == up and np.prod((high - low)[across]) < _LID_SHARE * np.prod(2 * half[across]):
            return None
        return side

    def _extents(self, row: int, other: int) -> Array:
        (low,), (high,) = self._within(row, [other])
        return np.asarray(high - low)

    def _within(self, row: int, others: Iterable[int]) -> tuple[Array, Array]:
        rows = np.fromiter(others, dtype=np.intp)
        return self._setting.within(np.full(len(rows), row, dtype=np.intp), rows)

    # -- the rest ------------------------------------------------------------------------------------------------------

    def _grip(self, row: int, up: Side) -> Facing:
        """Of a handle: away from what it is on."""
        setting = self._setting
        on = setting.parents.get(row)
        around = self._around.get(row)
        if on is None and around is not None:
            larger = [each for each in around.rows.tolist() if setting.volume[each] > setting.volume[row]]
            on = min(larger, key=lambda each: (not self._closing[each], float(setting.volume[each])), default=None)
        if on is None:
            return self._guess(row, up)
        (low,), (high,) = self._within(on, [row])
        out = (low + high) / 2 / setting.boxes.half[on]
        direction = np.zeros(3)
        best = int(np.argmax(np.abs(out)))
        direction[best] = np.sign(out[best])
        front = setting.side_towards(row, setting.boxes.rotation[on] @ direction)
        return Facing(_apart(up, front), front, why=f"away from {setting.named(on)}")

    def _tap(self, row: int, up: Side) -> Facing:
        """Of a tap: to where the nearest sink is."""
        way = self._way_to(row, "sink")
        if way is None:
            return self._guess(row, up)
        return Facing(up, self._setting.side_towards(row, way, without=[up.axis]), why="towards the sink")

    def _chair(self, row: int, up: Side) -> Facing:
        """Of a chair: away from its back, else to the nearest table."""
        setting = self._setting
        back = next((each for each in setting.together_with(row) if setting.kinds[each] == "panel"), None)
        if back is not None:
            way = setting.boxes.centre[row] - setting.boxes.centre[back]
            return Facing(up, setting.side_towards(row, way, without=[up.axis]), why="away from its back")
        to_table = self._way_to(row, *_TABLES)
        if to_table is None or np.linalg.norm(to_table[:2]) > _SEATED_M:
            return self._guess(row, up)._replace(why="towards the middle of the place", guessed=True)
        return Facing(up, setting.side_towards(row, to_table, without=[up.axis]), why="towards the table")

    def _way_to(self, row: int, *kinds: str) -> Array | None:
        """From a body to the nearest one of such a kind."""
        setting = self._setting
        rows = np.flatnonzero(setting.of_kind(*kinds))
        if not len(rows):
            return None
        ways = setting.boxes.centre[rows] - setting.boxes.centre[row]
        return np.asarray(ways[int(np.argmin(np.linalg.norm(ways, axis=1)))])

    def _guess(self, row: int, up: Side, axis: int | None = None) -> Facing:
        """Away from the wall that something has its back to, else to the middle of the place, across what is thin.

        Args:
            row: the body.
            up: its side that looks up.
            axis: the only one along which it can have its front; None for any that is level.
        """
        kind, half = str(self._setting.kinds[row]), self._setting.boxes.half[row]
        flat = [each for each in range(3) if each != up.axis]
        if axis is None and kind in _FLAT:
            axis = int(np.argmin(half))
        if axis == up.axis:  # it lies
            return Facing(_apart(up, up), up)
        axes = flat if axis is None else [axis]
        backs = self._backs(row, axes)
        fronts = [side.opposite for side in backs if side.opposite not in backs]
        sides = fronts or [Side.of(each, sign) for each in axes for sign in (1, -1)]
        way = (self._setting.middle - self._setting.boxes.centre[row]) @ self._setting.boxes.rotation[row]
        length = max(float(np.linalg.norm(way[flat])), 1e-9)

        def share(side: Side) -> float:
            return side.sign * float(way[side.axis]) / length - 0.5 * float(half[side.axis] > half[flat].min())

        front = max(sides, key=share)
        if fronts:
            return Facing(up, front, why="away from the wall")
        guessed = kind in LOOKING or kind in CLOSING
        return Facing(up, front, why="towards the middle of the place" if guessed else "", guessed=guessed)

    def _backs(self, row: int, axes: Sequence[int]) -> list[Side]:
        """The sides of a body that are against a wall."""
        around, half = self._around.get(row), self._setting.boxes.half[row]
        if around is None or str(self._setting.kinds[row]) not in LOOKING:
            return []
        walls = np.array([kind in _WALLS for kind in self._setting.kinds[around.rows]], dtype=bool)
        low, high = around.low[walls], around.high[walls]
        found = []
        for side in (Side.of(axis, sign) for axis in axes for sign in (1, -1)):
            near = (low[:, side.axis] if side.sign > 0 else -high[:, side.axis]) - half[side.axis]
            across = [axis for axis in range(3) if axis != side.axis]
            both = np.minimum(high, half)[:, across] - np.maximum(low, -half)[:, across]
            covered = np.prod(both.clip(0.0) / (2 * half[across]), axis=1)
            if np.any((np.abs(near) < _LEANS_M) & (covered > _COVERED)):
                found.append(side)
        return found


def _sliding(setting: Setting, joint: Joint) -> tuple[Array, float] | None:
    """The way in the world along which a constraint lets its body slide most, and which way along it."""
    ways = reaches(joint.constraint)[:3]
    lengths = [np.inf if way is None else way for way in ways]
    axis = int(np.argmax(lengths))
    if lengths[axis] <= 0.0:
        return None
    own = np.zeros(3)
    own[axis] = 1.0
    way = rotate(unit(joint.constraint.pose.quaternion), own)
    middle = axis_ranges(joint.constraint)[axis].middle
    child_moves = setting.bodies[joint.moving].id == joint.constraint.child
    return way, float(np.sign(middle)) * (1 if child_moves else -1)


def _touch(half: Array) -> float:
    return min(0.02, 0.2 * float(half.max()))


def _apart(up: Side, front: Side) -> Side:
    """A side to be up, where the one that is would be the front as well."""
    return up if up.axis != front.axis else Side.of((front.axis + 1) % 3, 1)
