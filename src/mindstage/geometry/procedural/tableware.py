"""Tableware: plates, bowls, cups, pots and cutlery; vessels are hollow for physics too."""

from __future__ import annotations

from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import (
    BodySide,
    Fraction,
    GeometryBuilder,
    MaterialRoles,
    PositiveFraction,
    Profile,
    ShapeTemplate,
    TemplateFitError,
    Thickness,
)
from mindstage.scene.transforms import Array

__all__ = ["Bowl", "Cutlery", "DinnerPlate", "DrinkingGlass", "Lid", "Mug", "Pan", "Pot"]


_SEGMENTS = 16


class Cutlery(ShapeTemplate, frozen=True, kw_only=True):
    """A fork, a knife, a spoon, or another utensil; its working end is at the front."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.STEEL, "handle": "body"})
    tool: Literal["fork", "knife", "spoon", "ladle", "spatula", "whisk", "brush", "opener"] = "spoon"

    def _build(self, builder: GeometryBuilder) -> None:
        builder.add_collision_box(builder.low, builder.high)
        match self.tool:
            case "fork":
                self._build_fork(builder)
            case "knife":
                self._build_knife(builder)
            case "spoon" | "ladle":
                self._build_spoon(builder)
            case "spatula":
                self._build_spatula(builder)
            case "whisk":
                self._build_whisk(builder)
            case "brush":
                self._build_brush(builder)
            case "opener":
                self._build_opener(builder)

    def _add_handle(self, builder: GeometryBuilder, until: float, *, wide: float = 0.55, flat: float = 0.3) -> None:
        """Adds a handle from the back to a fraction of the length, narrower towards the working end."""
        stations = (
            (0.0, 0.75 * wide, 0.55),
            (0.04, wide, 0.5),
            (0.3, 0.75 * wide, 0.45),
            (0.7, 0.4 * wide, 0.75),
            (1.0, 0.32 * wide, 0.6),
        )
        rings = [_ring(builder, share * until, across, flat, height) for share, across, height in stations]
        builder.add_loft("handle", np.array(rings))

    def _build_spoon(self, builder: GeometryBuilder) -> None:
        deep = self.tool == "ladle"
        start = 0.62 if not deep else 0.68
        self._add_handle(builder, start + 0.05)
        angle = np.linspace(-np.pi / 2, np.pi / 2, 9)
        shares = (np.sin(angle) + 1) / 2
        rows = []
        for share, wide in zip(shares, np.cos(angle), strict=True):
            width = max(float(wide), 0.12)
            rows.append(_bowl_ring(builder, start + (1 - start) * float(share), width, 1.0 if deep else 0.75))
        builder.add_loft("body", np.array(rows))

    def _build_fork(self, builder: GeometryBuilder) -> None:
        self._add_handle(builder, 0.68)
        low, high, size = builder.low, builder.high, builder.size
        x = [float(low[0] + share * size[0]) for share in (0.64, 0.72, 0.78)]
        rings = [
            _ring(builder, (spot - float(low[0])) / float(size[0]), wide, 0.25, 0.4)
            for spot, wide in zip(x, (0.2, 0.85, 1.0), strict=True)
        ]
        builder.add_loft("body", np.array(rings))
        tine = float(size[1]) / 7
        for number in range(4):
            y = float(low[1]) + 2 * number * tine
            z = float(low[2] + 0.28 * size[2])
            builder.add_box(
                "body",
                [x[2] - 0.01 * size[0], y, z],
                [high[0], y + tine, z + 0.25 * size[2]],
                rounding=0.3 * tine,
                collides=False,
            )
        builder.add_box(
            "body",
            [low[0] + 0.72 * size[0], -0.5 * tine, low[2]],
            [low[0] + 0.74 * size[0], 0.5 * tine, low[2] + 0.5 * size[2]],
            collides=False,
        )

    def _build_knife(self, builder: GeometryBuilder) -> None:
        until = 0.45
        rings = [
            _ring(builder, share, wide, 1.0, 0.5)
            for share, wide in ((0.0, 0.6), (0.03, 0.75), (0.3, 0.65), (until, 0.7))
        ]
        builder.add_loft("handle", np.array(rings))
        low, high, size = builder.low, builder.high, builder.size
        back, thin = float(high[1]), 0.08 * float(size[2])
        shares = (until - 0.02, 0.6, 0.8, 0.92, 1.0)
        edges = (
            float(low[1]),
            float(low[1]),
            float(low[1]),
            float(low[1] + 0.25 * size[1]),
            float(high[1] - 0.12 * size[1]),
        )
        blade = []
        for share, edge in zip(shares, edges, strict=True):
            x = float(low[0] + share * size[0])
            blade.append(
                [
                    (x, edge, 0.0),
                    (x, back - 0.1 * size[1], -thin),
                    (x, back, -thin),
                    (x, back, thin),
                    (x, back - 0.1 * size[1], thin),
                ]
            )
        builder.add_loft("body", np.array(blade)[:, ::1])

    def _build_spatula(self, builder: GeometryBuilder) -> None:
        self._add_handle(builder, 0.7, wide=0.35, flat=0.5)
        low, high, size = builder.low, builder.high, builder.size
        start = float(low[0] + 0.66 * size[0])
        thin = 0.2 * float(size[2])
        z = float(low[2])
        outline = [(start, 0.35 * low[1]), (high[0], low[1]), (high[0], high[1]), (start, 0.35 * high[1])]
        builder.add_hexahedron(
            "body", np.array([[*spot, level] for level in (z, z + thin) for spot in outline]), collides=False
        )

    def _build_whisk(self, builder: GeometryBuilder) -> None:
        low, size = builder.low, builder.size
        until = 0.42
        rings = [
            _ring(builder, share, wide, wide, 0.5)
            for share, wide in ((0.0, 0.25), (0.02, 0.34), (0.2, 0.3), (until, 0.22))
        ]
        builder.add_loft("handle", np.array(rings))
        angle = np.linspace(0.0, np.pi, 13)
        for turn in np.arange(4) * np.pi / 4:
            path = []
            for a in angle:
                across = np.cos(a) * (0.15 + 0.85 * np.sin(a) ** 0.7) / 0.583  # 1 at its widest
                x = float(low[0] + (until - 0.03 + (1.0 - until + 0.02) * float(np.sin(a)) ** 0.8) * size[0])
                path.append(
                    (
                        x,
                        float(across * np.cos(turn) * size[1] / 2) * 0.97,
                        float(across * np.sin(turn) * size[2] / 2) * 0.97,
                    )
                )
            builder.add_tube("body", path, min(0.0012, 0.02 * float(size[1:].min())), segments=6)

    def _build_brush(self, builder: GeometryBuilder) -> None:
        self._add_handle(builder, 0.72, wide=0.4, flat=0.4)
        low, high, size = builder.low, builder.high, builder.size
        start, seam = float(low[0] + 0.68 * size[0]), float(low[2] + 0.6 * size[2])
        builder.add_box("handle", [start, low[1], seam], high, rounding=0.1 * builder.min_extent, collides=False)
        builder.add_box(
            "body",
            [start + 0.02 * size[0], 0.85 * low[1], low[2]],
            [high[0] - 0.02 * size[0], 0.85 * high[1], seam],
            rounding=0.002,
            collides=False,
        )

    def _build_opener(self, builder: GeometryBuilder) -> None:
        """Adds two parallel grips, and a head with a wing."""
        low, high, size = builder.low, builder.high, builder.size
        thick = 0.3 * float(size[2])
        z = float(low[2]) + thick
        for sign in (-1, 1):
            y = sign * 0.3 * float(size[1])
            builder.add_tube(
                "handle",
                [
                    (float(low[0]) + 0.3 * thick, y, z),
                    (float(low[0] + 0.55 * size[0]), y, z),
                    (float(low[0] + 0.7 * size[0]), 0.3 * y, z),
                ],
                thick,
            )
        builder.add_box(
            "body",
            [low[0] + 0.62 * size[0], low[1], z - 0.4 * thick],
            [high[0], high[1], z + 0.4 * thick],
            collides=False,
        )
        wing = 0.4 * float(size[1])
        x = float(low[0] + 0.84 * size[0])
        builder.add_cylinder(
            "body", [x - 0.2 * wing, -0.2 * wing, z], [x + 0.2 * wing, 0.2 * wing, high[2] - 0.1 * thick]
        )
        builder.add_box(
            "body", [x - 0.15 * wing, -wing, high[2] - 0.5 * thick], [x + 0.15 * wing, wing, high[2]], collides=False
        )


def _ring(builder: GeometryBuilder, share: float, wide: float, tall: float, height: float) -> Array:
    """Returns an ellipse across the length; all arguments are fractions of the size."""
    angle = np.arange(_SEGMENTS) * (2 * np.pi / _SEGMENTS)
    y = np.cos(angle) * wide * builder.size[1] / 2
    tall = min(tall, 2 * height, 2 * (1 - height))
    z = builder.low[2] + height * builder.size[2] + np.sin(angle) * tall * builder.size[2] / 2
    return np.stack([np.full(_SEGMENTS, builder.low[0] + share * builder.size[0]), y, z], axis=1)


def _bowl_ring(builder: GeometryBuilder, share: float, wide: float, deep: float) -> Array:
    """Returns a crescent across the length: the lower half of an ellipse with a hollow."""
    low, size = builder.low, builder.size
    lower = np.linspace(np.pi, 2 * np.pi, _SEGMENTS // 2 + 1)
    upper = lower[::-1][1:-1]
    rim = float(low[2] + deep * size[2])
    thin = 0.12 * float(size[2])
    y = np.concatenate([np.cos(lower), 0.9 * np.cos(upper)]) * wide * size[1] / 2
    depth = deep * float(size[2]) * wide
    z = np.concatenate([rim + np.sin(lower) * depth, rim + np.sin(upper) * max(depth - thin, 0.1 * depth)])
    return np.stack([np.full(len(y), low[0] + share * size[0]), y, z], axis=1)


_MIN_ROOM_M = 0.002
_MIN_HANDLE_FRACTION = 0.05
"""Smaller handles are omitted."""


class _RoundVessel:
    """The round body of a vessel: its bounds, wall and floor thickness."""

    def __init__(self, low: Array, high: Array, wall: float, floor: float, level: float | None = None) -> None:
        self.low, self.high = low, high
        extents = high - low
        self.radius = float(extents[:2].min()) / 2
        self.wall = min(wall, 0.15 * self.radius)
        self.floor = min(floor, 0.3 * float(extents[2]))
        rise = None if level is None else float(np.clip(level, low[2], high[2]) - low[2])
        self.filled_to = None
        """Height of contents that stand too high for the floor [m]: the vessel is solid up to there."""
        if rise is not None and rise >= 1e-4:
            if rise < 0.4 * float(extents[2]):
                self.floor = rise
            else:
                self.filled_to = float(low[2]) + rise
        self.inner_fraction = 1.0 - self.wall / self.radius
        """Inner radius as a fraction of the outer radius."""
        self.floor_fraction = self.floor / float(extents[2])
        if min(self.radius, float(extents[2]) - self.floor) < _MIN_ROOM_M:
            raise TemplateFitError("too small for its walls")

    def profile(self, outer: Profile) -> list[tuple[float, float]]:
        """Returns the closed profile for an outer profile from the foot to the rim."""
        less = 1.0 - self.inner_fraction
        inner = [
            (max(r - less, 0.02), max(z, self.floor_fraction)) for r, z in reversed(outer) if z > self.floor_fraction
        ]
        foot = float(np.interp(self.floor_fraction, [z for _, z in outer], [r for r, _ in outer])) - less
        return [(0.0, 0.0), *outer, *inner, (max(foot, 0.02), self.floor_fraction), (0.0, self.floor_fraction)]

    def add_collision_shapes(
        self, builder: GeometryBuilder, foot: float, *, pieces: int = 8, with_surface: bool = True
    ) -> None:
        """Adds the floor and the wall; `foot` is the radius of the foot as a fraction of the rim."""
        less = 1.0 - self.inner_fraction
        middle, half = ((self.low + self.high) / 2)[:2], ((self.high - self.low) / 2)[:2]
        level = float(self.low[2]) + self.floor
        if self.filled_to is not None:
            self._add_filled(builder, foot)
            return
        builder.add_collision_cylinder([*(middle - foot * half), self.low[2]], [*(middle + foot * half), level])
        start = [*self.low[:2], level]
        builder.add_collision_ring(
            start,
            self.high,
            outer=(foot, 1.0),
            inner=(max(foot - less, 0.3 * foot), self.inner_fraction),
            pieces=pieces,
        )
        if with_surface:
            reach = 0.7 * max(foot - less, 0.3 * foot) * half
            height = float(self.high[2]) - level
            builder.add_support_surface(middle - reach, middle + reach, level, clearance=height, is_inside=True)

    def _add_filled(self, builder: GeometryBuilder, foot: float) -> None:
        """Adds a solid vessel up to the height of its contents."""
        level = self.filled_to or float(self.high[2])
        middle, half = ((self.low + self.high) / 2)[:2], ((self.high - self.low) / 2)[:2]
        share = foot + (1.0 - foot) * (level - float(self.low[2])) / float(self.high[2] - self.low[2])
        angle = np.arange(12) * (np.pi / 6)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).round(15) * half
        rows = ((foot, float(self.low[2])), (share, level))
        builder.add_collision_hull(
            np.concatenate([np.column_stack([circle * r + middle, np.full(12, z)]) for r, z in rows])
        )
        builder.add_support_surface(
            middle - 0.7 * foot * half, middle + 0.7 * foot * half, level, is_inside=bool(level < self.high[2])
        )


class DinnerPlate(ShapeTemplate, frozen=True, kw_only=True):
    """A plate with a rim."""

    name = "plate"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CERAMIC})
    rim: Fraction = 0.3
    """Width of the rim, as a fraction of the radius."""
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the well."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        if builder.size[2] < 0.003:
            builder.add_cylinder("body", low, high, bevel=0.001)
            builder.add_collision_cylinder(low, high)
            builder.add_support_surface(0.6 * low, 0.6 * high, float(high[2]))
            return
        well = 1.0 - 0.8 * self.rim
        ground = 0.12 + min(0.3, 0.005 / float(size[2]))
        rise = ground if self.level is None else (min(self.level, float(high[2])) - float(low[2])) / float(size[2])
        if 0.02 < rise < 0.42:
            ground = rise
        under = min(0.12, 0.6 * ground)
        foot = ((0, under), (0.6 * well, under), (0.62 * well, 0), (0.72 * well, 0), (0.75 * well, 0.8 * under))
        outer = (*foot, (well, 0.35), (0.99, 0.94), (1.0, 1.0))
        inner = ((0.985, 1.0), (well, 0.35 + ground - under), (0.85 * well, ground), (0, ground))
        builder.add_lathe("body", outer + inner, low, high, bevel=0.0015, segments=40)
        if rise >= 0.42:
            body = _RoundVessel(low, high, 0.1, 0.1, self.level)
            body.add_collision_shapes(builder, 0.72 * well)
            return
        floor = float(low[2] + ground * size[2])
        builder.add_collision_cylinder([*(0.85 * well * low[:2]), low[2]], [*(0.85 * well * high[:2]), floor])
        start = [*low[:2], floor - 0.5 * (ground - under) * size[2]]
        builder.add_collision_ring(start, high, outer=(0.85 * well, 1.0), inner=(0.8 * well, 0.94), pieces=6)
        builder.add_support_surface(
            0.55 * well * low, 0.55 * well * high, floor, clearance=float(high[2]) - floor, is_inside=True
        )


class Bowl(ShapeTemplate, frozen=True, kw_only=True):
    """A bowl, dish, colander or basin: wider at the rim than at the foot."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CERAMIC})
    wall: Thickness = 0.005
    foot: PositiveFraction = 0.5
    """Radius of the foot, as a fraction of the rim."""
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        body = _RoundVessel(builder.low, builder.high, self.wall, 1.6 * self.wall, self.level)
        foot = max(self.foot, 0.2)
        ring = (foot, 0.0), (foot, min(0.05, 0.5 * body.floor_fraction))
        belly = [
            (foot + (1 - foot) * float(np.sin(a)) ** 0.9, 0.06 + 0.94 * (1 - float(np.cos(a))))
            for a in np.linspace(0.12, np.pi / 2, 9)
        ]
        builder.add_lathe("body", body.profile([*ring, *belly]), builder.low, builder.high, bevel=0.002, segments=40)
        body.add_collision_shapes(builder, foot)


class Mug(ShapeTemplate, frozen=True, kw_only=True):
    """A mug or a cup; its handle points along the longer extent, otherwise to a corner."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CERAMIC, "handle": "body"})
    wall: Thickness = 0.004
    foot: PositiveFraction = 0.94
    """Radius of the foot, as a fraction of the rim."""
    handle: Fraction = 0.42
    """Depth of the handle, as a fraction of the diameter; 0 is a beaker."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        wide, turn = _handle_split(float(size[0]), float(size[1]), self.handle)
        start = np.array([low[0], high[1] - wide[1], low[2]])
        end = np.array([low[0] + wide[0], high[1], high[2]])
        if turn == 0.0 or self.handle < _MIN_HANDLE_FRACTION:
            start[1], end[1] = low[1], high[1]
        elif turn == np.pi / 2:
            start[0], end[0] = low[0], high[0]
        body = _RoundVessel(start, end, self.wall, 1.3 * self.wall)
        foot = max(self.foot, 0.3)
        outer = (
            ((0.93 * foot, 0), (foot, 0.05), (1.0, 0.7), (1.0, 1.0))
            if foot > 0.8
            else ((foot, 0), (foot, 0.03), (0.85 * 1.0, 0.35), (0.98, 0.8), (1.0, 1.0))
        )
        builder.add_lathe("body", body.profile(outer), start, end, bevel=0.0015, segments=36)
        body.add_collision_shapes(builder, foot)
        if self.handle >= _MIN_HANDLE_FRACTION:
            self._add_handle(builder, start, end, turn)

    def _add_handle(self, builder: GeometryBuilder, start: Array, end: Array, turn: float) -> None:
        """Adds a loop from below the rim to above the foot, in a vertical plane."""
        middle, tall = (start + end) / 2, float(end[2] - start[2])
        way = np.array([np.cos(turn), -np.sin(turn), 0.0])
        inner = float(min(end[0] - start[0], end[1] - start[1])) / 2
        reach = 2 * inner * self.handle
        thick = 0.13 * reach + 0.02 * inner
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 11)
        center = inner * 0.93
        path = [
            middle
            + way * (center + (reach + inner - center - thick) * float(np.cos(a)) ** 0.7)
            + [0, 0, 0.02 * tall + 0.31 * tall * float(np.sin(a))]
            for a in angle
        ]
        builder.add_tube("handle", path, thick, segments=12)
        side = np.array([np.sin(turn), np.cos(turn), 0.0])
        near, far = inner, inner + 0.95 * reach
        ends = [
            middle + way * out + side * across + [0, 0, up]
            for out, rise in ((near, 0.3), (far, 0.22))
            for across in (-0.8 * thick, 0.8 * thick)
            for up in (-rise * tall, rise * tall)
        ]
        builder.add_collision_hull(np.clip(ends, builder.low, builder.high))


def _handle_split(depth: float, width: float, share: float) -> tuple[tuple[float, float], float]:
    """Returns the extents of a round body with a handle in a rectangle, and the direction of the handle [rad].

    In a square, the handle points to a corner, and the body is at the opposite corner.
    """
    if share < _MIN_HANDLE_FRACTION:
        return (depth, width), 0.0
    if depth >= width * (1 + 0.8 * share):
        return (
            depth / (1 + share) if depth < width * (1 + share) else min(width * 1.0, depth / (1 + share)),
            width,
        ), 0.0
    if width >= depth * (1 + 0.8 * share):
        return (depth, min(depth, width / (1 + share))), np.pi / 2
    # Body and handle touch the sides: (depth - d/2)^2 + (width - d/2)^2 = ((1/2 + share) d)^2 for the diameter d.
    a = 0.5 - (0.5 + share) ** 2
    b = -(depth + width)
    c = depth**2 + width**2
    root = np.sqrt(b * b - 4 * a * c)
    solutions = [value for value in ((-b - root) / (2 * a), (-b + root) / (2 * a)) if value > 0]
    across = float(min(solutions))
    return (across, across), float(np.arctan2(width - across / 2, depth - across / 2))


class DrinkingGlass(ShapeTemplate, frozen=True, kw_only=True):
    """A drinking glass; with a stem, a wine glass."""

    name = "glass"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CLEAR_GLASS})
    wall: Thickness = 0.0025
    foot: PositiveFraction = 0.8
    stem: bool = False

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        if not self.stem:
            body = _RoundVessel(low, high, self.wall, 3 * self.wall)
            builder.add_lathe("body", body.profile(((self.foot, 0), (1.0, 1.0))), low, high, bevel=0.001, segments=36)
            body.add_collision_shapes(builder, self.foot)
            return
        cup = float(low[2] + 0.45 * size[2])
        body = _RoundVessel(np.array([*low[:2], cup]), high, self.wall, self.wall)
        outer = ((0.1, 0.45), (0.6, 0.51), (0.92, 0.63), (1.0, 0.74), (0.95, 0.88), (0.85, 1.0))
        thin = 1.0 - body.inner_fraction
        inner = [(max(r - thin, 0.04), z if z > 0.5 else 0.47) for r, z in reversed(outer)]
        foot = ((0, 0), (0.85, 0), (0.85, 0.012), (0.3, 0.035), (0.09, 0.08), (0.07, 0.25), (0.08, 0.42))
        builder.add_lathe("body", (*foot, *outer, *inner, (0, 0.47)), low, high, bevel=0.0008, segments=36)
        builder.add_collision_cylinder([*(0.85 * low[:2]), low[2]], [*(0.85 * high[:2]), low[2] + 0.03 * size[2]])
        builder.add_collision_cylinder([*(0.1 * low[:2]), low[2] + 0.03 * size[2]], [*(0.1 * high[:2]), cup])
        builder.add_collision_cylinder([*(0.6 * low[:2]), cup], [*(0.6 * high[:2]), cup + 0.05 * size[2]])
        builder.add_collision_ring(
            [*low[:2], cup + 0.05 * size[2]], high, outer=(0.6, 1.0), inner=(0.5, body.inner_fraction), pieces=6
        )


class Pot(ShapeTemplate, frozen=True, kw_only=True):
    """A pot with two lugs, along its longer extent or at opposite corners."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.STEEL, "handle": finishes.IRON})
    wall: Thickness = 0.003
    lugs: bool = True
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        depth, width = float(size[0]), float(size[1])
        inset, way = np.zeros(2), np.array([0.0, 0.0])
        if self.lugs:
            lug = 0.12 * min(depth, width)
            if max(depth, width) > 1.15 * min(depth, width):
                axis = 0 if depth > width else 1
                inset[axis], way = lug, np.eye(2)[axis]
            else:
                inset[:] = 0.02 * min(depth, width)
                way = np.array([0.5**0.5, 0.5**0.5])
        start, end = np.array([*(low[:2] + inset), low[2]]), np.array([*(high[:2] - inset), high[2]])
        body = _RoundVessel(start, end, self.wall, 1.5 * self.wall, self.level)
        builder.add_lathe(
            "body",
            body.profile(((0.94, 0), (1.0, 0.05), (1.0, 0.95), (1.0, 1.0))),
            start,
            end,
            bevel=0.0015,
            segments=40,
        )
        body.add_collision_shapes(builder, 0.96)
        if self.lugs:
            for sign in (-1, 1):
                self._add_lug(builder, sign * way, (end - start)[:2] / 2, float(low[2] + 0.8 * size[2]))

    @staticmethod
    def _add_lug(builder: GeometryBuilder, direction: Array, radius: Array, level: float) -> None:
        side = np.array([-direction[1], direction[0]])
        inner = direction * radius * 0.97
        outer = np.clip(direction * radius + direction * 0.24 * radius.min(), builder.low[:2], builder.high[:2])
        wide, thick = 0.3 * float(radius.min()), 0.04 * float(radius.min())
        outer -= direction * thick
        path = [
            [*(inner + side * wide), level],
            [*(outer + side * 0.8 * wide), level],
            [*(outer - side * 0.8 * wide), level],
            [*(inner - side * wide), level],
        ]
        builder.add_tube("handle", path, thick)
        corners = [
            [*(spot + side * across), level + up]
            for spot in (inner, outer)
            for across in (-wide, wide)
            for up in (-thick, thick)
        ]
        builder.add_collision_hull(np.clip(corners, builder.low, builder.high))


class Pan(ShapeTemplate, frozen=True, kw_only=True):
    """A pan or saucepan, with a handle along its longer extent if there is room."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.IRON, "handle": finishes.DARK_PLASTIC})
    wall: Thickness = 0.003
    foot: PositiveFraction = 0.82
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        axis = 0 if size[0] >= size[1] else 1
        wide, long = float(size[1 - axis]), float(size[axis])
        start, end = low.copy(), high.copy()
        handle = long > 1.25 * wide
        if handle:
            start[axis], end[axis] = high[axis] - wide, high[axis]  # the handle points to the back
        else:
            builder.add_note("no room for its handle")
        body = _RoundVessel(start, end, self.wall, 1.5 * self.wall, self.level)
        builder.add_lathe(
            "body", body.profile(((self.foot, 0), (0.97, 0.7), (1.0, 1.0))), start, end, bevel=0.0015, segments=40
        )
        body.add_collision_shapes(builder, self.foot)
        if handle:
            thick = min(0.07 * wide, 0.3 * float(size[2]))
            middle, unit = (start + end) / 2, np.eye(3)[axis]
            level = float(high[2]) - thick
            root, tip = middle - unit * 0.97 * wide / 2, unit * (float(low[axis]) + 0.3 * thick)
            builder.add_tube(
                "handle",
                [[*root[:2], level - 0.1 * size[2]], [*(0.7 * root + 0.3 * tip)[:2], level], [*tip[:2], level]],
                thick,
            )
            side = np.ones(3) - unit
            builder.add_collision_box(
                np.maximum(
                    tip * [1, 1, 0] - 0.3 * thick * unit - side * [thick, thick, 0] + [0, 0, level - thick], low
                ),
                np.minimum(root * [1, 1, 0] + side * [thick, thick, 0] + [0, 0, level + thick], high),
            )


class Lid(ShapeTemplate, frozen=True, kw_only=True):
    """A lid with a knob."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.STEEL, "handle": finishes.IRON})

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        dome = float(low[2] + 0.5 * size[2])
        profile = ((0, 0), (0.96, 0), (1, 0.12), (1, 0.25), (0.8, 0.62), (0.45, 0.9), (0, 1))
        builder.add_lathe("body", profile, low, [*high[:2], dome], bevel=0.001)
        grip = 0.14 * size[:2]
        builder.add_lathe(
            "handle",
            ((0, 0), (0.5, 0), (0.5, 0.4), (1, 0.6), (1, 0.85), (0, 1)),
            [*-grip, dome - 0.1 * size[2]],
            [*grip, high[2]],
        )
        builder.add_collision_cylinder(low, [*high[:2], low[2] + 0.15 * size[2]], along=BodySide.TOP)
        builder.add_collision_cylinder([*(0.7 * low[:2]), low[2] + 0.15 * size[2]], [*(0.7 * high[:2]), dome])
        builder.add_collision_cylinder([*-grip, dome], [*grip, high[2]])
