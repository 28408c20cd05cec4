"""Storage: furniture that one opens and reaches into."""

from __future__ import annotations

from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import Count, Length, MaterialRoles, ShapeTemplate, Thickness
from mindstage.shapes.draft import GeometryBuilder, TemplateDoesNotFit
from mindstage.shapes.sides import BodySide, Cutout
from mindstage.world.geometry import Array

__all__ = ["Cabinet", "Drawer"]

_LINING_M = 0.001
_MIN_WALL_M = 1e-5
"""A wall that is thinner is none."""
_MIN_ROOM_M = 0.004
_MIN_SHELF_SPACING_M = 0.05
"""Between two shelves."""


class Cabinet(ShapeTemplate, frozen=True, kw_only=True):
    """A case that is open to the front, with shelves: a cupboard, a fridge, an oven."""

    name = "case"
    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.LACQUER, "top": "body", "inside": "body", "shelf": "inside"}
    )
    wall: Thickness = 0.016
    """How thick its boards are [m], at most a fifth of the size."""
    walls: tuple[tuple[BodySide, Length], ...] = ()
    """Other thicknesses for some sides of the body; 0 leaves that side open."""
    shelves: Count = 0
    """How many, evenly spread."""
    levels: tuple[float, ...] | None = None
    """Instead of that: where things stand, upwards from the middle [m]. The lowest may be the floor's."""
    shelf: Thickness = 0.012
    """How thick a shelf is [m]."""
    free: tuple[Cutout, ...] = ()
    """What boards must leave open."""

    def _build(self, builder: GeometryBuilder) -> None:
        thick = {side: min(self.wall, 0.2 * float(builder.size[side.axis])) for side in BodySide}
        thick[BodySide.FRONT] = 0.0
        thick |= {
            builder.turn.template_side(side): min(wall, float(builder.size[side.axis]) / 2) for side, wall in self.walls
        }
        levels = sorted(self.levels or ())
        floor = float(builder.low[2]) + thick[BodySide.BOTTOM]
        if levels and builder.low[2] + 1e-4 < levels[0] < floor + self.shelf:
            thick[BodySide.BOTTOM] = levels.pop(0) - float(builder.low[2])
        low = builder.low + np.array([thick[BodySide.BACK], thick[BodySide.RIGHT], thick[BodySide.BOTTOM]])
        high = builder.high - [thick[BodySide.FRONT], thick[BodySide.LEFT], thick[BodySide.TOP]]
        if (high - low).min() < _MIN_ROOM_M:
            raise TemplateDoesNotFit("too small for its walls")
        boards = self._add_boards(builder, thick)
        levels = levels if self.levels is not None else self._even_levels(builder, low, high)
        room = self._add_shelves(builder, low, high, levels)
        for start, end in boards.get(BodySide.TOP, ()):
            builder.add_support_surface(start, end, float(builder.high[2]))
        for start, end in boards.get(BodySide.BOTTOM, ()):
            near, far = np.maximum(start, low), np.minimum(end, high)
            builder.add_support_surface(near, far, float(low[2]), clearance=room, is_inside=True)

    def _add_boards(
        self, builder: GeometryBuilder, thickness: dict[BodySide, float]
    ) -> dict[BodySide, list[tuple[Array, Array]]]:
        """Bottom and top go all the way, the others stand between them; what each consists of."""
        boards = {}
        low, high = builder.low.copy(), builder.high.copy()
        for side in (BodySide.BOTTOM, BodySide.TOP, BodySide.LEFT, BodySide.RIGHT, BodySide.BACK, BodySide.FRONT):
            wall, axis = thickness[side], side.axis
            if wall < _MIN_WALL_M:
                continue
            start, end = low.copy(), high.copy()
            if side.sign > 0:
                start[axis] = high[axis] = float(end[axis]) - wall
            else:
                end[axis] = low[axis] = float(start[axis]) + wall
            boards[side] = self._add_board(builder, side, start, end)
        return boards

    def _add_board(
        self, builder: GeometryBuilder, side: BodySide, low: Array, high: Array
    ) -> list[tuple[Array, Array]]:
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
        role = "top" if side is BodySide.TOP else "body"
        parts = builder.add_plate(
            role, outer_low, outer_high, self.free, thin_axis=axis, rounding=0.002, collides=False
        )
        builder.add_plate("inside", lining_low, lining_high, self.free, thin_axis=axis, rounding=0.0, collides=False)
        for start, end in parts:
            start[axis], end[axis] = low[axis], high[axis]
            builder.add_collision_box(start, end)
        return parts

    def _even_levels(self, builder: GeometryBuilder, low: Array, high: Array) -> list[float]:
        room = float(high[2] - low[2])
        count = min(self.shelves, max(int(room / _MIN_SHELF_SPACING_M) - 1, 0))
        if count < self.shelves:
            builder.add_note(f"room for {count} of {self.shelves} shelves")
        return [float(low[2]) + room * (number + 1) / (count + 1) for number in range(count)]

    def _add_shelves(self, builder: GeometryBuilder, low: Array, high: Array, levels: list[float]) -> float:
        """Draws them, and says how much room there is below the lowest one."""
        shelf = min(self.shelf, 0.2 * float(high[2] - low[2]))
        front = float(high[0]) - min(0.01, 0.1 * float(high[0] - low[0]))
        kept = [float(low[2])]
        for level in levels:
            if level - shelf < kept[-1] + 1e-4 or level > high[2] - 1e-3:
                builder.add_note(f"no room for a shelf at {level:+.3f} m")
                continue
            kept.append(level)
            builder.add_box("shelf", [low[0], low[1], level - shelf], [front, high[1], level], rounding=0.002)
        for level, above in pairwise([*kept[1:], float(high[2]) + shelf]):
            builder.add_support_surface(low, [front, high[1]], level, clearance=above - shelf - level, is_inside=True)
        return (kept[1] - shelf if len(kept) > 1 else float(high[2])) - kept[0]


class Drawer(ShapeTemplate, frozen=True, kw_only=True):
    """A box that is open to the top, with a panel in front; a tall one carries trays."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.OAK, "front": finishes.LACQUER, "inside": "body"}
    )
    wall: Thickness = 0.012
    """How thick its sides are [m]."""
    panel: Thickness = 0.018
    """How thick its front is [m]."""
    floor: Thickness = 0.008
    gap: Length = 0.006
    """Between its sides and the edges of its front [m], where rails and neighbors are."""
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""
    trays: Count | None = None
    """How many, one above the other; None decides by the height."""

    def _build(self, builder: GeometryBuilder) -> None:
        depth, width, height = builder.size.tolist()
        low, high = builder.low, builder.high
        panel, wall = min(self.panel, depth / 5), min(self.wall, depth / 8, width / 8)
        gap = min(self.gap, width / 10, height / 10)
        start, end = low + np.array([0.0, gap, gap]), high - [panel, gap, gap]
        floor = float(start[2]) + min(self.floor, height / 6)
        if self.level is not None and low[2] + 1e-4 < self.level < high[2]:
            floor = self.level
            start[2] = max(float(low[2]), min(float(start[2]), floor - min(self.floor, height / 6)))
        if min(end[0] - start[0], end[1] - start[1]) - 2 * wall < _MIN_ROOM_M or end[2] - floor < _MIN_ROOM_M:
            raise TemplateDoesNotFit("too small for its walls")
        builder.add_box("front", [high[0] - panel, low[1], low[2]], high, rounding=0.003)
        trays = self.trays if self.trays is not None else int(height / 0.45) if height > 2 * width else 1
        step = (float(end[2]) - floor) / max(trays, 1)
        builder.add_box(
            "body",
            start,
            [start[0] + wall, end[1], end[2]] if trays > 1 else [start[0] + wall, *end[1:]],
            rounding=0.002,
        )
        for number in range(max(trays, 1)):
            bottom = floor + number * step
            side = min(0.09, 0.4 * step) if trays > 1 else float(end[2]) - bottom
            thickness = bottom - float(start[2]) if number == 0 else min(self.floor, step / 4)
            self._add_tray(
                builder,
                start,
                end,
                wall,
                (bottom - thickness, bottom, bottom + side, bottom + step - min(self.floor, step / 4)),
            )

    def _add_tray(
        self, builder: GeometryBuilder, start: Array, end: Array, wall: float, levels: tuple[float, float, float, float]
    ) -> None:
        under, level, rim, above = levels
        back = float(start[0]) + wall
        builder.add_box("inside", [back, start[1] + wall, under], [end[0], end[1] - wall, level], rounding=0.0)
        builder.add_box("body", [back, start[1], under], [end[0], start[1] + wall, rim], rounding=0.002)
        builder.add_box("body", [back, end[1] - wall, under], [end[0], end[1], rim], rounding=0.002)
        room = max(above, rim) - level
        builder.add_support_surface(
            [back, start[1] + wall], [end[0], end[1] - wall], level, clearance=room, is_inside=True
        )
