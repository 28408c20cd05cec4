"""Architecture: doors, windows, walls, and wall decoration."""

from __future__ import annotations

import itertools
from functools import partial
from types import MappingProxyType
from typing import ClassVar, Literal

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
    Thickness,
)
from mindstage.geometry.procedural.texture_coordinates import PrintLayout
from mindstage.scene.transforms import Array
from mindstage.textures.prints import clock_display, wall_picture

__all__ = ["Door", "OpeningFrame", "Picture", "RoomShell", "Wall", "Window"]

_MIN_STRIP_M = 0.05
"""Strips of the walls of a room between two openings are omitted if they are narrower."""


def _add_frame(
    builder: GeometryBuilder, role: str, width: float, x: tuple[float, float], *, rounding: float = 0.003
) -> None:
    """Adds a frame around the y and z extents, between two x coordinates; visual only."""
    (y0, z0), (y1, z1) = builder.low[1:], builder.high[1:]
    for y in ((y0, y0 + width), (y1 - width, y1)):
        builder.add_box(role, [x[0], y[0], z0], [x[1], y[1], z1], rounding=rounding, collides=False)
    for z in ((z0, z0 + width), (z1 - width, z1)):
        builder.add_box(role, [x[0], y0 + width, z[0]], [x[1], y1 - width, z[1]], rounding=rounding, collides=False)


class Door(ShapeTemplate, frozen=True, kw_only=True):
    """A door leaf; it is viewed from the front."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.LACQUER, "frame": "body", "glass": finishes.CLEAR_GLASS, "display": finishes.SCREEN}
    )
    style: Literal["plain", "framed", "glazed"] = "plain"
    frame: Thickness = 0.07
    """Width of the frame [m]."""
    panels: Count = 1
    """Number of panels, from bottom to top."""
    display: bool = False
    """Whether there is a display at the upper edge: the door covers the whole front of an oven."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        builder.add_collision_box(low, high)
        if self.style == "plain":
            proud = 0.05 * float(size[0]) if self.display else 0.0
            builder.add_box("body", low, [high[0] - proud, *high[1:]], rounding=0.003, collides=False)
            if self.display:
                self._add_display(builder, proud)
            return
        width = min(self.frame, 0.2 * float(size[1:].min()))
        _add_frame(builder, "frame", width, (float(low[0]), float(high[0])))
        count = max(self.panels, 1)
        edges = np.linspace(float(low[2]) + width, float(high[2]) - width, count + 1)
        for edge in edges[1:-1]:
            rail = min(width, 0.3 * float(edges[1] - edges[0])) / 2
            builder.add_box(
                "frame",
                [low[0], low[1] + width, edge - rail],
                [high[0], high[1] - width, edge + rail],
                rounding=0.003,
                collides=False,
            )
        inset = (0.42 if self.style == "glazed" else 0.25) * size[0]
        role = "glass" if self.style == "glazed" else "body"
        builder.add_box(
            role,
            [low[0] + inset, low[1] + 0.8 * width, low[2] + 0.8 * width],
            [high[0] - inset, high[1] - 0.8 * width, high[2] - 0.8 * width],
            rounding=0.0,
            collides=False,
        )

    @staticmethod
    def _add_display(builder: GeometryBuilder, proud: float) -> None:
        high, size = builder.high, builder.size
        tall = round(min(0.03, 0.12 * float(size[2]), 0.1 * float(size[1])), 4)
        wide = round(3.2 * tall, 4)
        top = float(high[2]) - 0.6 * tall
        builder.add_printed_box(
            "display",
            [float(high[0]) - 3 * proud, -wide / 2, top - tall],
            [float(high[0]), wide / 2, top],
            PrintLayout.FRONT,
            partial(clock_display, wide, tall),
            rounding=0.0,
        )


class Window(ShapeTemplate, frozen=True, kw_only=True):
    """A window: a frame, and casements with panes of glass."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.CREAM, "frame": "body", "glass": finishes.SKY_GLASS, "metal": finishes.CHROME}
    )
    frame: Thickness = 0.06
    columns: Count = 2
    rows: Count = 1

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        builder.add_collision_box(low, high)
        width = min(self.frame, 0.12 * float(size[1:].min()))
        _add_frame(builder, "frame", width, (float(low[0]), float(high[0])))
        columns, rows = max(self.columns, 1), max(self.rows, 1)
        middle, depth = 0.0, min(0.4 * float(size[0]), 0.05)
        ys = np.linspace(float(low[1]) + width, float(high[1]) - width, columns + 1)
        zs = np.linspace(float(low[2]) + width, float(high[2]) - width, rows + 1)
        bar = min(0.7 * width, 0.12 * float(ys[1] - ys[0]), 0.12 * float(zs[1] - zs[0]))
        for y0, y1 in itertools.pairwise(ys):
            for z0, z1 in itertools.pairwise(zs):
                self._add_casement(builder, ((float(y0), float(z0)), (float(y1), float(z1))), (middle, depth), bar)
        if columns > 1:
            y = float(ys[1])
            grip = min(0.06, 0.1 * float(size[2])), min(0.008, 0.4 * bar)
            builder.add_box(
                "metal",
                [middle + depth / 2, y - grip[1], -grip[0]],
                [min(middle + depth / 2 + 0.02, high[0]), y + grip[1], grip[0]],
                collides=False,
            )

    def _add_casement(
        self,
        builder: GeometryBuilder,
        field: tuple[tuple[float, float], tuple[float, float]],
        depths: tuple[float, float],
        bar: float,
    ) -> None:
        ((y0, z0), (y1, z1)), (middle, depth) = field, depths
        x0, x1 = middle - depth / 2, middle + depth / 2
        for y in ((y0, y0 + bar), (y1 - bar, y1)):
            builder.add_box("body", [x0, y[0], z0], [x1, y[1], z1], rounding=0.003, collides=False)
        for z in ((z0, z0 + bar), (z1 - bar, z1)):
            builder.add_box("body", [x0, y0 + bar, z[0]], [x1, y1 - bar, z[1]], rounding=0.003, collides=False)
        pane = min(0.006, depth / 3)
        builder.add_box(
            "glass",
            [middle - pane / 2, y0 + 0.9 * bar, z0 + 0.9 * bar],
            [middle + pane / 2, y1 - 0.9 * bar, z1 - 0.9 * bar],
            rounding=0.0,
            collides=False,
        )


class OpeningFrame(ShapeTemplate, frozen=True, kw_only=True):
    """An open frame: around a doorway, a window, a picture."""

    name = "frame"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.LACQUER})
    frame: Thickness = 0.06
    """Width of the frame [m]."""
    sill: bool = True
    """Whether the frame includes the bottom side; that of a doorway does not."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high = builder.low, builder.high
        width = min(self.frame, 0.2 * float(builder.size[1:].min()))
        builder.add_box("body", [low[0], low[1], high[2] - width], high, rounding=0.003)
        bottom = float(low[2])
        if self.sill:
            bottom += width
            builder.add_box("body", low, [*high[:2], bottom], rounding=0.003)
        for y in (float(low[1]), float(high[1]) - width):
            builder.add_box("body", [low[0], y, bottom], [high[0], y + width, high[2] - width], rounding=0.003)


class Wall(ShapeTemplate, frozen=True, kw_only=True):
    """A wall, a floor or a ceiling, with openings."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.PLASTER})
    free: tuple[Cutout, ...] = ()
    """Openings along the thin axis."""

    def _build(self, builder: GeometryBuilder) -> None:
        thin = int(np.argmin(builder.size))
        for low, high in builder.add_plate("body", builder.low, builder.high, self.free, thin_axis=thin, rounding=0.0):
            if thin == 2:
                builder.add_support_surface(low, high, float(high[2]))


class RoomShell(ShapeTemplate, frozen=True, kw_only=True):
    """The walls of a room, with openings; optionally its floor and ceiling."""

    name = "shell"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.PLASTER, "floor": "body"})
    wall: Thickness = 0.1
    floor: bool = False
    ceiling: bool = False
    free: tuple[Cutout, ...] = ()

    def _build(self, builder: GeometryBuilder) -> None:
        low, high = builder.low.copy(), builder.high.copy()
        wall = min(self.wall, 0.2 * float(builder.size.min()))
        sides = [BodySide.LEFT, BodySide.RIGHT, BodySide.FRONT, BodySide.BACK]
        sides = [BodySide.BOTTOM] * self.floor + [BodySide.TOP] * self.ceiling + sides
        floors: list[tuple[Array, Array]] = []
        for side in sides:
            start, end = low.copy(), high.copy()
            if side.sign > 0:
                start[side.axis] = high[side.axis] = end[side.axis] - wall
            else:
                end[side.axis] = low[side.axis] = start[side.axis] + wall
            role = "floor" if side is BodySide.BOTTOM else "body"
            parts = builder.add_plate(
                role, start, end, self.free, thin_axis=side.axis, rounding=0.0, min_strip_width=_MIN_STRIP_M
            )
            if side is BodySide.BOTTOM:
                floors = parts
        height = float(builder.high[2] - wall * (1 + self.ceiling) - builder.low[2])
        for start, end in floors:
            near, far = np.maximum(start, low), np.minimum(end, high)  # between the walls
            builder.add_support_surface(near, far, float(builder.low[2]) + wall, clearance=height, is_inside=True)


class Picture(ShapeTemplate, frozen=True, kw_only=True):
    """A picture or a poster; it is viewed from the front."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.PAPER, "frame": finishes.IRON, "picture": finishes.PICTURE}
    )
    frame: Length = 0.0
    """Width of the frame [m]; 0 for a poster."""
    printed: bool = True
    """Whether it shows a landscape; a mirror has a plain surface."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        builder.add_collision_box(low, high)
        width = min(self.frame, 0.15 * float(size[1:].min())) if self.frame >= 1e-3 else 0.0
        sheet = float(high[0] - (0.3 if width else 0.1) * size[0])
        if width:
            _add_frame(builder, "frame", width, (float(low[0]), float(high[0])), rounding=0.002)
        builder.add_box(
            "body", [low[0], *(low[1:] + width)], [sheet, *(high[1:] - width)], rounding=0.0, collides=False
        )
        edge = width + 0.1 * float(size[1:].min())
        face = sheet + (0.1 if width else 1.0) * (float(high[0]) - sheet)
        start, end = np.array([sheet, *(low[1:] + edge)]), np.array([face, *(high[1:] - edge)])
        if not self.printed:
            builder.add_box("picture", start, end, rounding=0.0, collides=False)
            return
        across, tall = (round(float(extent), 4) for extent in (end - start)[1:])
        picture = partial(wall_picture, across, tall)
        builder.add_printed_box("picture", start, end, PrintLayout.FRONT, picture, rounding=0.0)
