"""Furniture: cabinets, drawers, tables, shelves, seats and beds."""

from __future__ import annotations

import itertools
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar, Literal

import msgspec
import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import (
    BodySide,
    Count,
    Cutout,
    GeometryBuilder,
    Length,
    MaterialRoles,
    ShapeTemplate,
    TemplateFitError,
    Thickness,
)
from mindstage.geometry.procedural.texture_coordinates import PrintLayout
from mindstage.scene.transforms import Array
from mindstage.textures.prints import clock_display

__all__ = ["Bed", "Cabinet", "Chair", "Countertop", "Drawer", "Shelf", "Sofa", "TableShape"]


_LINING_M = 0.001
_MIN_WALL_M = 1e-5
"""Thinner walls are omitted."""
_MIN_ROOM_M = 0.004
_MIN_SHELF_SPACING_M = 0.05
"""Smallest distance between two shelves."""
_DOOR_GAP_M = 0.002
_MIN_PANEL_M = 0.03
_PANEL_M = 0.012
"""Thickness of the panel above a door, at most."""
_MIN_DISPLAY_M = 0.012
_MAX_DISPLAY_M = 0.035


class Cabinet(ShapeTemplate, frozen=True, kw_only=True):
    """A cabinet that is open at the front, with shelves: a cupboard, a fridge, an oven."""

    name = "case"
    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {
            "body": finishes.LACQUER,
            "top": "body",
            "inside": "body",
            "shelf": "inside",
            "panel": "body",
            "display": finishes.SCREEN,
        }
    )
    wall: Thickness = 0.016
    """Thickness of the boards [m], at most a fifth of the size."""
    walls: tuple[tuple[BodySide, Length], ...] = ()
    """Thickness of individual sides of the body [m]; 0 leaves a side open."""
    shelves: Count = 0
    """Number of evenly spaced shelves."""
    levels: tuple[float, ...] | None = None
    """Heights at which contents stand, from the center [m], instead of `shelves`; the lowest may be the floor."""
    shelf: Thickness = 0.012
    """Thickness of a shelf [m]."""
    free: tuple[Cutout, ...] = ()
    """Openings in the boards."""
    controls: Literal["none", "top"] = "none"
    """Whether a panel with a display closes the front above the doors."""
    door_top: float | None = None
    """Height of the upper edge of the doors, from the center [m]; None if there are none."""
    knob_top: float | None = None
    """Height of the upper edge of the knobs on the panel, from the center [m]."""

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
            raise TemplateFitError("too small for its walls")
        boards = self._add_boards(builder, thick)
        levels = levels if self.levels is not None else self._even_levels(builder, low, high)
        room = self._add_shelves(builder, low, high, levels)
        for start, end in boards.get(BodySide.TOP, ()):
            builder.add_support_surface(start, end, float(builder.high[2]))
        for start, end in boards.get(BodySide.BOTTOM, ()):
            near, far = np.maximum(start, low), np.minimum(end, high)
            builder.add_support_surface(near, far, float(low[2]), clearance=room, is_inside=True)
        if self.controls == "top" and self.door_top is not None and not thick[BodySide.FRONT]:
            self._add_panel(builder, low, high, self.door_top + _DOOR_GAP_M)

    def _add_panel(self, builder: GeometryBuilder, low: Array, high: Array, bottom: float) -> None:
        """Adds a panel between a height and the top, with a display where knobs leave room."""
        if not low[2] < bottom < high[2] - _MIN_PANEL_M:
            return
        front, thick = float(builder.high[0]), min(_PANEL_M, 0.2 * float(high[0] - low[0]))
        face = front - 0.1 * thick
        builder.add_box("panel", [front - thick, low[1], bottom], [face, *high[1:]], rounding=0.0015)
        start = bottom if self.knob_top is None else max(bottom, self.knob_top)
        room = float(high[2]) - start
        tall = min(0.6 * room, _MAX_DISPLAY_M)
        wide = min(3.2 * tall, 0.5 * float(high[1] - low[1]))
        if tall < _MIN_DISPLAY_M:
            return
        middle = start + room / 2
        across, up = round(wide, 4), round(tall, 4)
        builder.add_printed_box(
            "display",
            [front - 0.5 * thick, -across / 2, middle - up / 2],
            [front, across / 2, middle + up / 2],
            PrintLayout.FRONT,
            partial(clock_display, across, up),
            rounding=0.0,
        )

    def _add_boards(
        self, builder: GeometryBuilder, thickness: dict[BodySide, float]
    ) -> dict[BodySide, list[tuple[Array, Array]]]:
        """Adds the boards, of which bottom and top extend over the full size; returns their boxes."""
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
        """Adds a board between two corners, with a lining on its inner side; returns its boxes."""
        axis = side.axis
        outer_low, outer_high, lining_low, lining_high = low.copy(), high.copy(), low.copy(), high.copy()
        lining = min(_LINING_M, float(high[axis] - low[axis]) / 4)
        if side.sign > 0:
            outer_low[axis] = lining_high[axis] = low[axis] + lining
        else:
            outer_high[axis] = lining_low[axis] = high[axis] - lining
        for other in {0, 1, 2} - {axis}:  # it ends before the bevels of the board
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
        """Adds the shelves; returns the free height below the lowest one [m]."""
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
    """A drawer: a box that is open at the top, with a front panel; a tall one has several trays."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.OAK, "front": finishes.LACQUER, "inside": "body"}
    )
    wall: Thickness = 0.012
    """Thickness of the sides [m]."""
    panel: Thickness = 0.018
    """Thickness of the front panel [m]."""
    floor: Thickness = 0.008
    gap: Length = 0.006
    """Distance between the sides and the edges of the front panel [m], the room for slides and neighbors."""
    levels: tuple[float, ...] = ()
    """Heights at which contents stand, from the center [m]; the lowest is the floor, others are trays."""
    trays: Count | None = None
    """Number of trays, from bottom to top, if contents do not give them; None derives it from the height."""

    def _build(self, builder: GeometryBuilder) -> None:
        depth, width, height = builder.size.tolist()
        low, high = builder.low, builder.high
        panel, wall = min(self.panel, depth / 5), min(self.wall, depth / 8, width / 8)
        gap = min(self.gap, width / 10, height / 10)
        start, end = low + np.array([0.0, gap, gap]), high - [panel, gap, gap]
        floor = float(start[2]) + min(self.floor, height / 6)
        levels = [level for level in sorted(self.levels) if low[2] + 1e-4 < level < end[2] - _MIN_ROOM_M]
        if levels:
            floor = levels[0]
            start[2] = max(float(low[2]), min(float(start[2]), floor - min(self.floor, height / 6)))
        if min(end[0] - start[0], end[1] - start[1]) - 2 * wall < _MIN_ROOM_M or end[2] - floor < _MIN_ROOM_M:
            raise TemplateFitError("too small for its walls")
        builder.add_box("front", [high[0] - panel, low[1], low[2]], high, rounding=0.003)
        count = self.trays if self.trays is not None else int(height / 0.45) if height > 2 * width else 1
        step = (float(end[2]) - floor) / max(count, 1)
        bottoms = levels if len(levels) > 1 else [floor + number * step for number in range(max(count, 1))]
        builder.add_box(
            "body",
            start,
            [start[0] + wall, end[1], end[2]] if len(bottoms) > 1 else [start[0] + wall, *end[1:]],
            rounding=0.002,
        )
        rooms = [above - bottom for bottom, above in pairwise([*bottoms, float(end[2])])]
        board = min(self.floor, min(rooms) / 4)
        for bottom, room in zip(bottoms, rooms, strict=True):
            side = min(0.09, 0.4 * room) if len(bottoms) > 1 else room
            under = float(start[2]) if bottom == floor else bottom - board
            self._add_tray(builder, start, end, wall, (under, bottom, bottom + side, bottom + room - board))

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


def _extended_cutouts(cutouts: tuple[Cutout, ...], builder: GeometryBuilder) -> tuple[Cutout, ...]:
    """Returns the cutouts, extended through the whole height."""
    reach = np.abs(builder.turn.vector_to_body((0.0, 0.0, float(builder.size[2]))))
    return tuple(
        msgspec.structs.replace(
            cutout,
            low=tuple((np.array(cutout.low) - reach).tolist()),
            high=tuple((np.array(cutout.high) + reach).tolist()),
        )
        for cutout in cutouts
    )


class Countertop(ShapeTemplate, frozen=True, kw_only=True):
    """A countertop, on a closed block with a plinth if it is high; with cutouts for inserted bodies."""

    name = "counter"
    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.STONE, "front": finishes.LACQUER, "plinth": finishes.IRON}
    )
    top: Thickness = 0.04
    """Thickness of the countertop [m]."""
    overhang: Length = 0.02
    """Overhang at the front [m]."""
    plinth: Length = 0.1
    """Height of the plinth [m]."""
    free: tuple[Cutout, ...] = ()
    """Cutouts, through the whole height."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        cutouts = _extended_cutouts(self.free, builder)
        if size[2] < 3 * self.top:
            self._add_top(builder, float(low[2]), cutouts)
            return
        under = float(high[2]) - self.top
        plinth = min(self.plinth, 0.2 * float(size[2]))
        over = min(self.overhang, 0.1 * float(size[0]))
        recess = over + min(0.05, 0.1 * float(size[0]))
        self._add_top(builder, under, cutouts)
        builder.add_plate(
            "front", [low[0], low[1], low[2] + plinth], [high[0] - over, high[1], under], cutouts, thin_axis=2
        )
        builder.add_plate(
            "plinth", low, [high[0] - recess, high[1], low[2] + plinth], cutouts, thin_axis=2, rounding=0.0
        )

    @staticmethod
    def _add_top(builder: GeometryBuilder, under: float, cutouts: tuple[Cutout, ...]) -> None:
        for low, high in builder.add_plate(
            "body", [*builder.low[:2], under], builder.high, cutouts, thin_axis=2, rounding=0.003
        ):
            builder.add_support_surface(low, high, float(high[2]))


class TableShape(ShapeTemplate, frozen=True, kw_only=True):
    """A table: a top, legs, and an apron; only the top if it is too low for legs."""

    name = "table"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.OAK, "top": "body", "legs": "body"})
    top: Thickness = 0.03
    legs: Count = 4
    """Number of legs: 0, 1 (a column with a foot), otherwise four."""
    leg: Thickness = 0.06
    """Thickness of a leg [m]."""
    inset: Length = 0.03
    """Distance of the legs from the edge of the top [m]."""
    apron: Length = 0.07
    round: bool = False

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        builder.add_support_surface(
            low * (0.7 if self.round else 1.0), high * (0.7 if self.round else 1.0), float(high[2])
        )
        legs = self.legs
        if legs and size[2] < 4 * self.top:
            builder.add_note("too low for legs: only the top")
            legs = 0
        under = float(high[2]) - self.top if legs else float(low[2])
        if self.round:
            builder.add_cylinder("top", [*low[:2], under], high)
            builder.add_collision_cylinder([*low[:2], under], high)
        else:
            builder.add_box("top", [*low[:2], under], high, rounding=0.006)
        if legs == 1:
            self._add_column(builder, under)
        elif legs:
            self._add_legs(builder, under)

    def _add_column(self, builder: GeometryBuilder, under: float) -> None:
        low, size = builder.low, builder.size
        wide = min(self.leg, 0.15 * float(size[:2].min()))
        foot = 0.3 * size[:2]
        rise = min(0.03, 0.1 * float(size[2]))
        profile = ((0, 0), (1, 0), (1, 0.3), (0.3, 1), (0, 1))
        builder.add_lathe("legs", profile, [*-foot, low[2]], [*foot, low[2] + rise])
        builder.add_cylinder("legs", [-wide, -wide, low[2] + 0.8 * rise], [wide, wide, under])
        builder.add_collision_cylinder([*-foot, low[2]], [*foot, low[2] + rise])
        builder.add_collision_cylinder([-wide, -wide, low[2] + rise], [wide, wide, under])

    def _add_legs(self, builder: GeometryBuilder, under: float) -> None:
        least = float(builder.size[:2].min())
        leg = min(self.leg, 0.2 * least)
        inset = min(self.inset, 0.1 * least)
        if self.round:
            inset = 0.15 * least
        start, end = builder.low[:2] + inset, builder.high[:2] - inset
        _add_posts(builder, "legs", start, end, leg, (float(builder.low[2]), under))
        apron = min(self.apron, 0.15 * float(builder.size[2]))
        board = min(0.02, 0.4 * leg)
        for axis in (0, 1):
            for edge in (start[axis] + 0.2 * leg, end[axis] - 0.2 * leg - board):
                low, high = np.empty(3), np.empty(3)
                low[[axis, 1 - axis, 2]] = [edge, start[1 - axis] + leg, under - apron]
                high[[axis, 1 - axis, 2]] = [edge + board, end[1 - axis] - leg, under]
                builder.add_box("body", low, high, rounding=0.003, collides=False)


def _add_posts(
    builder: GeometryBuilder, role: str, start: Array, end: Array, thickness: float, heights: tuple[float, float]
) -> None:
    """Adds four legs at the corners of a rectangle."""
    for x in (float(start[0]), float(end[0]) - thickness):
        for y in (float(start[1]), float(end[1]) - thickness):
            builder.add_box(role, [x, y, heights[0]], [x + thickness, y + thickness, heights[1]], rounding=0.005)


class Shelf(ShapeTemplate, frozen=True, kw_only=True):
    """A board on a wall, on brackets if it is high enough; a shelving unit if it is tall."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.OAK, "metal": finishes.IRON, "top": "body", "inside": "body", "shelf": "body"}
    )
    board: Thickness = 0.03
    shelf_spacing: Thickness = 0.34
    """Distance between the shelves of a tall unit [m]."""
    levels: tuple[float, ...] | None = None
    """Heights at which contents of a tall unit stand, from the center [m], instead of evenly spaced shelves."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        if size[2] > max(self.shelf_spacing, 1.2 * float(size[0])):
            count = min(round(float(size[2]) / self.shelf_spacing) - 1, 12)
            wall = min(self.board, 0.1 * builder.min_extent)
            Cabinet(wall=wall, shelf=self.board, shelves=count, levels=self.levels).build(builder)
            return
        builder.add_support_surface(low, high, float(high[2]))
        if size[2] < 2.5 * self.board:
            builder.add_box("body", low, high, rounding=0.004)
            return
        under = float(high[2]) - self.board
        builder.add_box("body", [*low[:2], under], high, rounding=0.004)
        thick = min(0.02, 0.1 * float(size[1]))
        for share in (0.2, 0.8):
            y = float(low[1] + share * size[1])
            back = float(low[0] + min(0.3 * thick, 0.1 * size[0]))
            builder.add_box("metal", [low[0], y - thick / 2, low[2]], [back + thick / 2, y + thick / 2, under])
            path = [(back, y, low[2] + thick), (float(high[0] - 0.15 * size[0]), y, under - thick / 3)]
            builder.add_tube("metal", path, thick / 3)


class Chair(ShapeTemplate, frozen=True, kw_only=True):
    """A chair, or a stool without a backrest; it faces the front."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.OAK, "seat": "body", "legs": "body"})
    seat: Length = 0.45
    """Height of the seat [m]; at most 0.6 of the height of a chair with a backrest."""
    back: bool = True
    arms: bool = False
    leg: Thickness = 0.036
    board: Thickness = 0.03

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        leg = min(self.leg, 0.15 * float(size[:2].min()))
        level = float(high[2])
        if self.back:
            level = float(low[2]) + float(np.clip(self.seat, 0.2 * size[2], 0.6 * size[2]))
        board = min(self.board, 0.2 * (level - float(low[2])))
        builder.add_box("seat", [*low[:2], level - board], [*high[:2], level], rounding=0.012)
        _add_posts(builder, "legs", low[:2] + 0.25 * leg, high[:2] - 0.25 * leg, leg, (float(low[2]), level - board))
        rail = float(low[2]) + 0.35 * (level - float(low[2]))
        for sign in (-1, 1):
            y = sorted((sign * (high[1] - 0.5 * leg), sign * (high[1] - leg)))
            builder.add_box("legs", [low[0] + leg, y[0], rail], [high[0] - leg, y[1], rail + 0.7 * leg], collides=False)
        front = float(low[0])
        if self.back:
            front += 0.8 * leg
            self._add_back(builder, leg, level)
        builder.add_support_surface([front, low[1]], high, level, clearance=None)
        if self.arms and self.back:
            self._add_arms(builder, leg, level)

    def _add_back(self, builder: GeometryBuilder, leg: float, level: float) -> None:
        low, high = builder.low, builder.high
        builder.add_collision_box([low[0], low[1], level], [low[0] + 0.8 * leg, *high[1:]])
        for sign in (-1, 1):
            y = sorted((sign * high[1], sign * (high[1] - leg)))
            builder.add_box(
                "body", [low[0], y[0], level], [low[0] + 0.8 * leg, y[1], high[2]], rounding=0.005, collides=False
            )
        tall = float(high[2]) - level
        for share, width in ((0.78, 0.22), (0.48, 0.12), (0.22, 0.12)):
            z = level + share * tall
            builder.add_box(
                "body",
                [low[0] + 0.1 * leg, low[1] + leg, z],
                [low[0] + 0.6 * leg, high[1] - leg, z + width * tall],
                rounding=0.004,
                collides=False,
            )

    def _add_arms(self, builder: GeometryBuilder, leg: float, level: float) -> None:
        low, high = builder.low, builder.high
        rest = level + 0.45 * (float(high[2]) - level)
        for sign in (-1, 1):
            y = sorted((sign * high[1], sign * (high[1] - leg)))
            builder.add_box("body", [low[0] + 0.8 * leg, y[0], rest - leg], [high[0] - leg, y[1], rest])
            builder.add_box(
                "body", [high[0] - 2.2 * leg, y[0], level], [high[0] - 1.2 * leg, y[1], rest - leg], collides=False
            )


class Bed(ShapeTemplate, frozen=True, kw_only=True):
    """A bed; its head is at the back."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.OAK, "mattress": finishes.LINEN, "blanket": finishes.PICTURE}
    )
    mattress: Thickness = 0.18
    people: Count = 1
    """Number of pillows."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        board = min(0.04, 0.1 * float(size[0]))
        top = float(high[2] - 0.35 * size[2])
        mattress = min(self.mattress, 0.4 * (top - float(low[2])))
        frame = top - 0.7 * mattress
        foot = 0.4 * (frame - float(low[2]))
        builder.add_box("body", low, [low[0] + board, *high[1:]], rounding=0.01)
        builder.add_box("body", [low[0] + board, low[1], low[2] + foot], [*high[:2], frame], rounding=0.008)
        leg = min(0.07, 0.1 * float(size[:2].min()))
        for y in (float(low[1]), float(high[1]) - leg):
            builder.add_box("body", [high[0] - leg, y, low[2]], [high[0], y + leg, low[2] + foot])
        rim = min(0.02, 0.05 * float(size[1]))
        start, end = [low[0] + board, low[1] + rim, frame], [high[0] - rim, high[1] - rim, top]
        builder.add_box("mattress", start, end, rounding=0.05, rounded=True)
        head = float(low[0]) + board
        span = min(0.45, 0.25 * float(size[0]))
        builder.add_box(
            "blanket",
            [head + span, low[1] + rim / 3, frame],
            [high[0] - rim / 3, high[1] - rim / 3, top + 0.2 * mattress],
            rounding=0.06,
            rounded=True,
            collides=False,
        )
        count = max(self.people, 1)
        each = (float(size[1]) - 2 * rim) / count
        for number in range(count):
            y = float(low[1]) + rim + each * number
            high_z = min(top + 0.45 * mattress, float(high[2]))
            builder.add_box(
                "mattress",
                [head + 0.05 * span, y + 0.06 * each, top - 0.1 * mattress],
                [head + 0.9 * span, y + 0.94 * each, high_z],
                rounding=0.08,
                rounded=True,
                collides=False,
            )
        builder.add_support_surface([head + span, low[1] + rim], [high[0] - rim, high[1] - rim], top)


class Sofa(ShapeTemplate, frozen=True, kw_only=True):
    """A sofa or an armchair; it faces the front."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.LINEN, "cushions": "body", "legs": finishes.OAK}
    )
    seats: Count = 2

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        foot = float(low[2] + 0.1 * size[2])
        back = float(low[0]) + min(0.25, 0.28 * float(size[0]))
        arm = min(0.2, 0.16 * float(size[1]))
        level = float(low[2] + 0.5 * size[2])
        base = float(low[2] + 0.32 * size[2])
        rest = float(low[2] + 0.7 * size[2])
        soft = 0.05
        builder.add_box("body", [low[0], low[1], foot], [back, *high[1:]], rounding=soft, rounded=True)
        for sign in (-1, 1):
            y = sorted((sign * high[1], sign * (high[1] - arm)))
            builder.add_box("body", [back, y[0], foot], [high[0], y[1], rest], rounding=soft, rounded=True)
        builder.add_box(
            "body", [back, low[1] + arm, foot], [high[0] - 0.01 * size[0], high[1] - arm, base], rounding=0.01
        )
        builder.add_collision_box([back, low[1] + arm, base], [high[0], high[1] - arm, level])
        count = max(self.seats, 1)
        edges = np.linspace(float(low[1]) + arm, float(high[1]) - arm, count + 1)
        for y0, y1 in itertools.pairwise(edges):
            builder.add_box(
                "cushions", [back - 0.02, y0, base], [high[0], y1, level], rounding=soft, rounded=True, collides=False
            )
            builder.add_box(
                "cushions",
                [back - 0.04, y0, level - 0.02],
                [back + 0.14 * size[0], y1, high[2] - 0.03 * size[2]],
                rounding=soft,
                rounded=True,
                collides=False,
            )
        leg = min(0.05, 0.4 * arm)
        _add_posts(builder, "legs", low[:2] + leg / 2, high[:2] - leg / 2, leg, (float(low[2]), foot))
        builder.add_support_surface([back + 0.14 * size[0], low[1] + arm], [high[0], high[1] - arm], level)
