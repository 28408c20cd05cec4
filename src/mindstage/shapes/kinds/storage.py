"""Storage: furniture that one opens and reaches into."""

from __future__ import annotations

from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import Count, Design, Length, Roles, Thickness
from mindstage.shapes.draft import Draft, TooSmall
from mindstage.shapes.sides import Gap, Side
from mindstage.world.geometry import Array

__all__ = ["Case", "Drawer"]

_LINING_M = 0.001
_OPEN_M = 1e-5
"""A wall that is thinner is none."""
_LEAST_ROOM_M = 0.004
_LEAST_SHELF_M = 0.05
"""Between two shelves."""


class Case(Design, frozen=True, kw_only=True):
    """A case that is open to the front, with shelves: a cupboard, a fridge, an oven."""

    roles: ClassVar[Roles] = MappingProxyType(
        {"body": finishes.LACQUER, "top": "body", "inside": "body", "shelf": "inside"}
    )
    wall: Thickness = 0.016
    """How thick its boards are [m], at most a fifth of the size."""
    walls: tuple[tuple[Side, Length], ...] = ()
    """Other thicknesses for some sides of the body; 0 leaves that side open."""
    shelves: Count = 0
    """How many, evenly spread."""
    levels: tuple[float, ...] | None = None
    """Instead of that: where things stand, upwards from the middle [m]. The lowest may be the floor's."""
    shelf: Thickness = 0.012
    """How thick a shelf is [m]."""
    free: tuple[Gap, ...] = ()
    """What boards must leave open."""

    def _draw(self, draft: Draft) -> None:
        thick = {side: min(self.wall, 0.2 * float(draft.size[side.axis])) for side in Side}
        thick[Side.FRONT] = 0.0
        thick |= {draft.turn.drawn_side(side): min(wall, float(draft.size[side.axis]) / 2) for side, wall in self.walls}
        levels = sorted(self.levels or ())
        floor = float(draft.low[2]) + thick[Side.BOTTOM]
        if levels and draft.low[2] + 1e-4 < levels[0] < floor + self.shelf:
            thick[Side.BOTTOM] = levels.pop(0) - float(draft.low[2])
        low = draft.low + np.array([thick[Side.BACK], thick[Side.RIGHT], thick[Side.BOTTOM]])
        high = draft.high - [thick[Side.FRONT], thick[Side.LEFT], thick[Side.TOP]]
        if (high - low).min() < _LEAST_ROOM_M:
            raise TooSmall("too small for its walls")
        boards = self._boards(draft, thick)
        levels = levels if self.levels is not None else self._spread(draft, low, high)
        room = self._shelves(draft, low, high, levels)
        for start, end in boards.get(Side.TOP, ()):
            draft.place(start, end, float(draft.high[2]))
        for start, end in boards.get(Side.BOTTOM, ()):
            near, far = np.maximum(start, low), np.minimum(end, high)
            draft.place(near, far, float(low[2]), height=room, inside=True)

    def _boards(self, draft: Draft, thick: dict[Side, float]) -> dict[Side, list[tuple[Array, Array]]]:
        """Bottom and top go all the way, the others stand between them; what each consists of."""
        boards = {}
        low, high = draft.low.copy(), draft.high.copy()
        for side in (Side.BOTTOM, Side.TOP, Side.LEFT, Side.RIGHT, Side.BACK, Side.FRONT):
            wall, axis = thick[side], side.axis
            if wall < _OPEN_M:
                continue
            start, end = low.copy(), high.copy()
            if side.sign > 0:
                start[axis] = high[axis] = float(end[axis]) - wall
            else:
                end[axis] = low[axis] = float(start[axis]) + wall
            boards[side] = self._board(draft, side, start, end)
        return boards

    def _board(self, draft: Draft, side: Side, low: Array, high: Array) -> list[tuple[Array, Array]]:
        """A board between two corners, of which the innermost part is the lining."""
        axis = side.axis
        outer_low, outer_high, lining_low, lining_high = low.copy(), high.copy(), low.copy(), high.copy()
        lining = min(_LINING_M, float(high[axis] - low[axis]) / 4)
        if side.sign > 0:
            outer_low[axis] = lining_high[axis] = low[axis] + lining
        else:
            outer_high[axis] = lining_low[axis] = high[axis] - lining
        for other in {0, 1, 2} - {axis}:  # it ends before the bevels of the board begin
            lining_low[other], lining_high[other] = low[other] + 2 * lining, high[other] - 2 * lining
        role = "top" if side is Side.TOP else "body"
        parts = draft.plate(role, outer_low, outer_high, self.free, thin=axis, rounding=0.002, solid=False)
        draft.plate("inside", lining_low, lining_high, self.free, thin=axis, rounding=0.0, solid=False)
        for start, end in parts:
            start[axis], end[axis] = low[axis], high[axis]
            draft.touch_box(start, end)
        return parts

    def _spread(self, draft: Draft, low: Array, high: Array) -> list[float]:
        room = float(high[2] - low[2])
        count = min(self.shelves, max(int(room / _LEAST_SHELF_M) - 1, 0))
        if count < self.shelves:
            draft.note(f"room for {count} of {self.shelves} shelves")
        return [float(low[2]) + room * (number + 1) / (count + 1) for number in range(count)]

    def _shelves(self, draft: Draft, low: Array, high: Array, levels: list[float]) -> float:
        """Draws them, and says how much room there is below the lowest one."""
        shelf = min(self.shelf, 0.2 * float(high[2] - low[2]))
        front = float(high[0]) - min(0.01, 0.1 * float(high[0] - low[0]))
        kept = [float(low[2])]
        for level in levels:
            if level - shelf < kept[-1] + 1e-4 or level > high[2] - 1e-3:
                draft.note(f"no room for a shelf at {level:+.3f} m")
                continue
            kept.append(level)
            draft.box("shelf", [low[0], low[1], level - shelf], [front, high[1], level], rounding=0.002)
        for level, above in pairwise([*kept[1:], float(high[2]) + shelf]):
            draft.place(low, [front, high[1]], level, height=above - shelf - level, inside=True)
        return (kept[1] - shelf if len(kept) > 1 else float(high[2])) - kept[0]


class Drawer(Design, frozen=True, kw_only=True):
    """A box that is open to the top, with a panel in front; a tall one carries trays."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.OAK, "front": finishes.LACQUER, "inside": "body"})
    wall: Thickness = 0.012
    """How thick its sides are [m]."""
    panel: Thickness = 0.018
    """How thick its front is [m]."""
    floor: Thickness = 0.008
    gap: Length = 0.006
    """Between its sides and the edges of its front [m], where rails and neighbours are."""
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""
    trays: Count | None = None
    """How many, one above the other; None decides by the height."""

    def _draw(self, draft: Draft) -> None:
        depth, width, height = draft.size.tolist()
        low, high = draft.low, draft.high
        panel, wall = min(self.panel, depth / 5), min(self.wall, depth / 8, width / 8)
        gap = min(self.gap, width / 10, height / 10)
        start, end = low + np.array([0.0, gap, gap]), high - [panel, gap, gap]
        floor = float(start[2]) + min(self.floor, height / 6)
        if self.level is not None and low[2] + 1e-4 < self.level < high[2]:
            floor = self.level
            start[2] = max(float(low[2]), min(float(start[2]), floor - min(self.floor, height / 6)))
        if min(end[0] - start[0], end[1] - start[1]) - 2 * wall < _LEAST_ROOM_M or end[2] - floor < _LEAST_ROOM_M:
            raise TooSmall("too small for its walls")
        draft.box("front", [high[0] - panel, low[1], low[2]], high, rounding=0.003)
        trays = self.trays if self.trays is not None else int(height / 0.45) if height > 2 * width else 1
        step = (float(end[2]) - floor) / max(trays, 1)
        draft.box(
            "body",
            start,
            [start[0] + wall, end[1], end[2]] if trays > 1 else [start[0] + wall, *end[1:]],
            rounding=0.002,
        )
        for number in range(max(trays, 1)):
            bottom = floor + number * step
            side = min(0.09, 0.4 * step) if trays > 1 else float(end[2]) - bottom
            thickness = bottom - float(start[2]) if number == 0 else min(self.floor, step / 4)
            self._tray(
                draft,
                start,
                end,
                wall,
                (bottom - thickness, bottom, bottom + side, bottom + step - min(self.floor, step / 4)),
            )

    def _tray(
        self, draft: Draft, start: Array, end: Array, wall: float, levels: tuple[float, float, float, float]
    ) -> None:
        under, level, rim, above = levels
        back = float(start[0]) + wall
        draft.box("inside", [back, start[1] + wall, under], [end[0], end[1] - wall, level], rounding=0.0)
        draft.box("body", [back, start[1], under], [end[0], start[1] + wall, rim], rounding=0.002)
        draft.box("body", [back, end[1] - wall, under], [end[0], end[1], rim], rounding=0.002)
        room = max(above, rim) - level
        draft.place([back, start[1] + wall], [end[0], end[1] - wall], level, height=room, inside=True)
