"""Appliances: electrical devices, radiators and wall clocks."""

from __future__ import annotations

import itertools
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import (
    BodySide,
    Count,
    GeometryBuilder,
    MaterialRoles,
    ShapeTemplate,
    Thickness,
)

__all__ = ["Appliance", "CoffeeMaker", "CookerHood", "Kettle", "Radiator", "Screen", "WallClock"]


class Screen(ShapeTemplate, frozen=True, kw_only=True):
    """A screen on a stand, or for mounting on a wall."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.DARK_PLASTIC, "glass": finishes.SCREEN})
    stand: bool = False
    frame: Thickness = 0.012

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        bottom, back, front = float(low[2]), float(low[0]), float(high[0])
        if self.stand:
            bottom += 0.16 * float(size[2])
            front = min(0.02, 0.25 * float(size[0]))
            back = -front
            wide = 0.22 * float(size[1])
            foot = float(low[2]) + min(0.015, 0.03 * float(size[2]))
            builder.add_box("body", [low[0], -wide, low[2]], [high[0], wide, foot])
            builder.add_box("body", [back, -0.15 * wide, foot], [0.0, 0.15 * wide, bottom])
        frame = min(self.frame, 0.1 * float(size[1:].min()))
        pane = front - 0.05 * (front - back)
        builder.add_box("body", [back, low[1], bottom], [pane, *high[1:]], rounding=0.004, collides=False)
        builder.add_collision_box([back, low[1], bottom], [front, *high[1:]])
        low_corner = [pane - 0.05 * (front - back), low[1] + frame, bottom + 1.5 * frame]
        builder.add_box("glass", low_corner, [front, *(high[1:] - frame)], rounding=0.0, collides=False)


class Radiator(ShapeTemplate, frozen=True, kw_only=True):
    """A radiator of vertical columns; its back is at the wall."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CREAM})
    column: Thickness = 0.05
    """Width of a column [m]."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        builder.add_collision_box(low, high)
        count = int(np.clip(size[1] / max(self.column, 1e-3), 2, 40))
        edges = np.linspace(low[1], high[1], count + 1)
        gap = 0.14 * float(edges[1] - edges[0])
        for number, (y0, y1) in enumerate(itertools.pairwise(edges)):
            start = y0 + (gap if number else 0.0)
            end = y1 - (gap if number < count - 1 else 0.0)
            builder.add_box(
                "body", [low[0], start, low[2]], [high[0], end, high[2]], rounding=0.4 * gap, collides=False
            )
        bar = 0.06 * float(size[2])
        for z in (float(low[2]) + 0.1 * float(size[2]), float(high[2]) - 0.1 * float(size[2]) - bar):
            inset = 0.12 * float(size[0])
            builder.add_box(
                "body", [low[0] + inset, low[1] + gap, z], [high[0] - inset, high[1] - gap, z + bar], collides=False
            )


class CookerHood(ShapeTemplate, frozen=True, kw_only=True):
    """A cooker hood: a wide inlet, and a chimney at the back."""

    name = "hood"
    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.STEEL, "filter": finishes.IRON, "bulb": finishes.GLOWING}
    )

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        rim = float(low[2] + min(0.14 * size[2], 0.07))
        waist = float(low[2] + 0.5 * size[2])
        half = 0.22 * float(size[1])
        deep = float(low[0] + 0.5 * size[0])
        builder.add_box(
            "body", [*low[:2], low[2] + 0.1 * (rim - low[2])], [*high[:2], rim], rounding=0.003, collides=False
        )
        builder.add_collision_box(low, [*high[:2], rim])
        builder.add_frustum("body", ([*low[:2], rim], [*high[:2], rim]), ([low[0], -half, waist], [deep, half, waist]))
        builder.add_box("body", [low[0], -half, waist], [deep, half, high[2]], rounding=0.003)
        builder.add_box(
            "filter", [*(0.85 * low[:2]), low[2]], [*(0.85 * high[:2]), rim], rounding=0.001, collides=False
        )
        builder.light = np.array([0.0, 0.0, low[2]])


class Appliance(ShapeTemplate, frozen=True, kw_only=True):
    """A closed appliance with a window or controls in front, or slots on top: a microwave, a toaster."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {
            "body": finishes.STEEL,
            "front": "body",
            "glass": finishes.BLACK_GLASS,
            "controls": finishes.DARK_PLASTIC,
            "handle": finishes.CHROME,
        }
    )
    window: Literal["none", "square", "round"] = "none"
    controls: Literal["none", "left", "top"] = "none"
    """Position on the front: at its left side (on the right for the viewer), or along the top."""
    knobs: Count = 2
    slots: Count = 0
    """Number of slots in the top."""
    handle: bool = False

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        builder.add_collision_box(low, high)
        proud = min(0.012, 0.06 * float(size[0]))
        face = float(high[0]) - (proud if self._has_front() else 0.0)
        builder.add_support_surface([low[0], low[1]], [face, high[1]], float(high[2]))
        soft = 0.08 * builder.min_extent if self.slots else 0.006
        top = float(high[2] - (0.004 * size[2] if self.slots else 0.0))
        builder.add_box("body", low, [face, high[1], top], rounding=soft, rounded=bool(self.slots), collides=False)
        left = float(high[1] - (0.24 * size[1] if self.controls == "left" else 0.03 * size[1]))
        top = float(high[2] - (0.16 * size[2] if self.controls == "top" else 0.03 * size[2]))
        right, bottom = float(low[1] + 0.03 * size[1]), float(low[2] + 0.03 * size[2])
        if self.window == "square":
            builder.add_box(
                "front", [face, right, bottom], [face + 0.5 * proud, left, top], rounding=0.004, collides=False
            )
            edge = 0.1 * min(left - right, top - bottom)
            reach = [face + 0.7 * proud, left - edge, top - edge]
            builder.add_box("glass", [face, right + edge, bottom + edge], reach, rounding=0.002, collides=False)
        if self.window == "round":
            self._add_porthole(builder, (right, left), (bottom, top), face, proud)
        if self.controls != "none":
            self._add_controls(builder, (left, top), face, proud)
        if self.handle:
            y = left - 0.06 * (left - right)
            grip = 0.3 * (top - bottom)
            builder.add_tube(
                "handle",
                [(float(high[0]) - 0.3 * proud, y, -grip), (float(high[0]) - 0.3 * proud, y, grip)],
                0.3 * proud,
            )
        self._add_slots(builder)

    def _has_front(self) -> bool:
        return self.window != "none" or self.controls != "none" or self.handle

    def _add_porthole(
        self, builder: GeometryBuilder, y: tuple[float, float], z: tuple[float, float], face: float, proud: float
    ) -> None:
        middle = np.array([sum(y) / 2, sum(z) / 2])
        reach = 0.4 * min(y[1] - y[0], z[1] - z[0])
        ring = ((0.78, 0), (1, 0), (0.95, 1), (0.8, 1))
        builder.add_lathe(
            "handle",
            ring,
            [face, *(middle - reach)],
            [face + proud, *(middle + reach)],
            along=BodySide.FRONT,
            closed=True,
        )
        dome = tuple((float(np.cos(a)), float(np.sin(a))) for a in np.linspace(0.0, np.pi / 2, 7))
        reach *= 0.8
        builder.add_lathe(
            "glass",
            ((0, 0), *dome),
            [face, *(middle - reach)],
            [face + 0.8 * proud, *(middle + reach)],
            along=BodySide.FRONT,
        )

    def _add_controls(self, builder: GeometryBuilder, corner: tuple[float, float], face: float, proud: float) -> None:
        low, high, size = builder.low, builder.high, builder.size
        across = self.controls == "left"
        start = (
            [corner[0] + 0.02 * size[1], low[2] + 0.03 * size[2]]
            if across
            else [low[1] + 0.03 * size[1], corner[1] + 0.02 * size[2]]
        )
        end = [float(high[1] - 0.03 * size[1]), float(high[2] - 0.03 * size[2])]
        builder.add_box("controls", [face, *start], [face + 0.4 * proud, *end], rounding=0.002, collides=False)
        middle, extents = (np.array(start) + end) / 2, np.array(end) - start
        axis = 1 if across else 0
        reach = min(0.36 * extents[1 - axis], 0.4 * extents[axis] / max(self.knobs, 1))
        for share in np.linspace(-0.3, 0.3, self.knobs) if self.knobs > 1 else [0.0] * self.knobs:
            spot = middle.copy()
            spot[axis] += share * extents[axis]
            builder.add_cylinder("handle", [face, *(spot - reach)], [high[0], *(spot + reach)], along=BodySide.FRONT)

    def _add_slots(self, builder: GeometryBuilder) -> None:
        size, top = builder.size, float(builder.high[2])
        for number in range(self.slots):
            x = float(size[0]) * ((number + 0.5) / self.slots - 0.5) * 0.7
            wide, long = 0.08 * float(size[0]), 0.36 * float(size[1])
            builder.add_box(
                "controls",
                [x - wide, -long, top - 0.03 * size[2]],
                [x + wide, long, top],
                rounding=0.001,
                collides=False,
            )


class CoffeeMaker(ShapeTemplate, frozen=True, kw_only=True):
    """A coffee maker: a tower at the back, a head above a jug."""

    name = "brewer"
    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {
            "body": finishes.DARK_PLASTIC,
            "metal": finishes.STEEL,
            "glass": finishes.CLEAR_GLASS,
            "contents": finishes.SOIL,
        }
    )

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        back = float(low[0] + 0.36 * size[0])
        base, head = float(low[2] + 0.1 * size[2]), float(low[2] + 0.68 * size[2])
        builder.add_box("body", low, [*high[:2], base], rounding=0.012)
        builder.add_box("body", [low[0], low[1], base], [back, high[1], head], rounding=0.008)
        builder.add_box("body", [low[0], low[1], head], high, rounding=0.02)
        reach = 0.42 * min(float(size[1]), float(high[0]) - back)
        middle = np.array([back + 0.52 * (float(high[0]) - back), 0.0])
        jug = ((0, 0), (0.9, 0), (1, 0.35), (0.72, 0.85), (0.75, 1), (0, 1))
        rim = base + 0.9 * (head - base)
        builder.add_cylinder(
            "metal", [*(middle - 1.05 * reach), base], [*(middle + 1.05 * reach), base + 0.02 * size[2]]
        )
        builder.add_lathe("glass", jug, [*(middle - reach), base + 0.02 * size[2]], [*(middle + reach), rim])
        filled = ((0, 0), (0.9, 0), (0.97, 0.6), (0.9, 1), (0, 1))
        builder.add_lathe(
            "contents",
            filled,
            [*(middle - 0.93 * reach), base + 0.03 * size[2]],
            [*(middle + 0.93 * reach), base + 0.5 * (rim - base)],
        )
        builder.add_collision_cylinder([*(middle - 0.9 * reach), base], [*(middle + 0.9 * reach), rim])
        builder.add_tube(
            "body",
            [
                (middle[0] + 0.6 * reach, 0, rim - 0.1 * reach),
                (high[0] - 0.1 * reach, 0, rim - 0.2 * reach),
                (high[0] - 0.1 * reach, 0, base + 0.7 * reach),
            ],
            0.09 * reach,
        )
        builder.add_support_surface([low[0], low[1]], high, float(high[2]))


class Kettle(ShapeTemplate, frozen=True, kw_only=True):
    """A kettle: the spout points to the front and the handle to the back if it is longer than wide."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.STEEL, "handle": finishes.DARK_PLASTIC, "lid": "handle"}
    )

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        axis = 0 if size[0] >= size[1] else 1
        across = float(size[1 - axis])
        wide = min(across, 0.75 * float(size[axis]))
        unit = np.eye(3)[axis]
        middle = unit * (float(high[axis]) - 0.55 * wide)
        base, shoulder = float(low[2] + 0.08 * size[2]), float(low[2] + 0.9 * size[2])
        reach = np.array([wide / 2, wide / 2, 0.0])
        reach[1 - axis] = across / 2
        flat = np.array([1.0, 1.0, 0.0])
        builder.add_cylinder(
            "handle", middle * flat - 0.95 * reach + [0, 0, low[2]], middle * flat + 0.95 * reach + [0, 0, base]
        )
        profile = ((0, 0), (1, 0), (0.99, 0.25), (0.88, 0.7), (0.72, 1), (0, 1))
        builder.add_lathe("body", profile, middle - reach + [0, 0, base], middle + reach + [0, 0, shoulder])
        builder.add_lathe(
            "lid",
            ((0, 0), (1, 0), (0.9, 0.35), (0.25, 0.5), (0.25, 1), (0, 1)),
            middle - 0.7 * reach + [0, 0, shoulder],
            middle + 0.7 * reach + [0, 0, high[2]],
        )
        lip = middle + unit * 0.78 * wide / 2
        tip = unit * float(high[axis] - 0.06 * wide)
        rise = np.array([0.0, 0.0, 1.0])
        z, body = shoulder - 0.12 * float(size[2]), shoulder - base
        builder.add_tube("body", [lip + rise * (z - 0.12 * size[2]), tip + rise * (z + 0.06 * size[2])], 0.06 * wide)
        thick = 0.055 * wide
        outer = unit * (float(low[axis]) + thick)
        root, lower = middle - unit * 0.6 * wide / 2, middle - unit * 0.85 * wide / 2
        heights = (shoulder - thick, shoulder - thick, base + 0.4 * body, base + 0.25 * body)
        path = [spot + rise * height for spot, height in zip((root, outer, outer, lower), heights, strict=True)]
        builder.add_tube("handle", path, thick)
        builder.add_collision_cylinder(middle - reach + [0, 0, low[2]], middle + reach + [0, 0, shoulder])
        side = np.ones(3) - unit
        grip_low, grip_high = outer - thick * unit - thick * side * flat, root + thick * side * flat
        builder.add_collision_box(
            grip_low * flat + [0, 0, base + 0.3 * (shoulder - base)], grip_high * flat + [0, 0, shoulder]
        )


class WallClock(ShapeTemplate, frozen=True, kw_only=True):
    """A clock on the wall; one looks at its front."""

    name = "clock"
    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.IRON, "face": finishes.PAPER, "hands": finishes.DARK_PLASTIC}
    )

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        radius = size[1:] / 2
        x0, face = float(low[0]), float(low[0] + 0.6 * size[0])
        builder.add_lathe(
            "body",
            ((0.9, 0), (1, 0), (1, 0.8), (0.97, 1), (0.92, 1), (0.9, 0.9)),
            low,
            high,
            along=BodySide.FRONT,
            closed=True,
            bevel=0.002,
        )
        builder.add_cylinder("face", [x0, *(-0.91 * radius)], [face, *(0.91 * radius)], along=BodySide.FRONT, bevel=0.0)
        builder.add_collision_cylinder(low, high, along=BodySide.FRONT)
        mark = face + 0.1 * float(size[0])
        for hour in range(12):
            turn = hour * np.pi / 6
            inner, outer = (np.array([np.sin(turn), np.cos(turn)]) * radius * share for share in (0.72, 0.82))
            builder.add_tube("hands", [(face, *inner), (face, *outer)], 0.02 * float(radius.min()), segments=8)
        for turn, reach, thick in ((-1.05, 0.48, 0.03), (1.05, 0.68, 0.02)):
            tip = np.array([np.sin(turn), np.cos(turn)]) * radius * reach
            builder.add_tube("hands", [(mark, 0.0, 0.0), (mark, *tip)], thick * float(radius.min()), segments=8)
