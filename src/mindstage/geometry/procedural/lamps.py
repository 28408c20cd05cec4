"""Lamps: lamps of all styles, each with the position of its light source."""

from __future__ import annotations

from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import BodySide, GeometryBuilder, MaterialRoles, ShapeTemplate

__all__ = ["Lamp"]

_BALL_PROFILE = tuple((float(np.cos(a)), (float(np.sin(a)) + 1) / 2) for a in np.linspace(-np.pi / 2, np.pi / 2, 11))
_SHADE_PROFILE = ((1.0, 0.0), (0.55, 1.0), (0.5, 1.0), (0.95, 0.0))
"""The cross-section of a shade: a loop that does not touch the axis."""


class Lamp(ShapeTemplate, frozen=True, kw_only=True):
    """A lamp, by its mounting."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.STEEL, "shade": finishes.LINEN, "bulb": finishes.GLOWING}
    )
    style: Literal["ceiling", "pendant", "floor", "table", "bulb", "tube", "candle", "torch"] = "ceiling"

    def _build(self, builder: GeometryBuilder) -> None:
        match self.style:
            case "ceiling":
                self._build_ceiling(builder)
            case "pendant":
                self._build_pendant(builder)
            case "floor" | "table":
                self._build_standing(builder)
            case "bulb":
                self._build_bulb(builder)
            case "candle":
                self._build_candle(builder)
            case "tube" | "torch":
                self._build_tube(builder)

    def _build_ceiling(self, builder: GeometryBuilder) -> None:
        """Adds a base at the ceiling with a luminous cover: round if depth and width are similar, otherwise a box."""
        low, high, size = builder.low, builder.high, builder.size
        seam = float(high[2] - 0.35 * size[2])
        builder.light = np.array([0.0, 0.0, low[2] + 0.1 * size[2]])
        if max(size[:2]) < 1.3 * min(size[:2]):
            builder.add_cylinder("body", [*low[:2], seam], high)
            cover = tuple((0.94 * float(np.cos(a)), 1 + float(np.sin(a))) for a in np.linspace(-np.pi / 2, 0.0, 8))
            builder.add_lathe("bulb", (*cover, (0, 1)), [*(0.94 * low[:2]), low[2]], [*(0.94 * high[:2]), seam])
            builder.add_collision_cylinder([*low[:2], seam], high)
            builder.add_collision_cylinder([*(0.8 * low[:2]), low[2]], [*(0.8 * high[:2]), seam])
            return
        builder.add_box("body", [*low[:2], seam], high, collides=False)
        builder.add_box(
            "bulb", [*(0.9 * low[:2]), low[2]], [*(0.9 * high[:2]), seam], rounding=0.02, rounded=True, collides=False
        )
        builder.add_collision_box(low, high)

    def _build_pendant(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        top = float(low[2] + min(0.7 * size[2], 0.75 * size[:2].min()))
        builder.add_lathe("shade", _SHADE_PROFILE, low, [*high[:2], top], closed=True, bevel=0.002)
        cap = 0.53 * size[:2] / 2
        builder.add_cylinder("body", [*-cap, top - 0.05 * size[2]], [*cap, top])
        cord = min(0.004, 0.02 * float(size[:2].min()))
        builder.add_cylinder("body", [-cord, -cord, top], [cord, cord, high[2]])
        builder.add_cylinder("body", [*(-0.35 * cap), high[2] - 0.05 * size[2]], [*(0.35 * cap), high[2]])
        bulb = 0.16 * float(size[:2].min())
        center = float(low[2]) + 0.45 * (top - float(low[2]))
        builder.add_lathe(
            "bulb", _BALL_PROFILE, [-bulb, -bulb, center - bulb], [bulb, bulb, center + bulb], segments=16
        )
        builder.light = np.array([0.0, 0.0, low[2] + 0.1 * (top - low[2])])
        _add_collision_cone(builder, float(low[2]), top)
        builder.add_collision_box([-2 * cord, -2 * cord, top], [2 * cord, 2 * cord, high[2]])

    def _build_standing(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        shade = float(high[2]) - min(0.4 * float(size[2]), 0.8 * float(size[:2].min()))
        foot = 0.75 * size[:2] / 2
        rise = 0.02 * float(size[2])
        builder.add_lathe(
            "body", ((0, 0), (1, 0), (1, 0.4), (0.2, 1), (0, 1)), [*-foot, low[2]], [*foot, low[2] + rise]
        )
        pole = min(0.012, 0.06 * float(size[:2].min()))
        builder.add_cylinder("body", [-pole, -pole, low[2] + 0.5 * rise], [pole, pole, shade + 0.5 * (high[2] - shade)])
        builder.add_lathe("shade", _SHADE_PROFILE, [*low[:2], shade], high, closed=True, bevel=0.002)
        bulb = 0.15 * float(size[:2].min())
        center = 0.5 * (shade + float(high[2]))
        builder.add_lathe(
            "bulb", _BALL_PROFILE, [-bulb, -bulb, center - bulb], [bulb, bulb, center + bulb], segments=16
        )
        builder.light = np.array([0.0, 0.0, center])
        builder.add_collision_cylinder([*-foot, low[2]], [*foot, low[2] + rise])
        builder.add_collision_cylinder([-pole, -pole, low[2] + rise], [pole, pole, shade])
        _add_collision_cone(builder, shade, float(high[2]))

    def _build_bulb(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        neck = float(low[2] + 0.35 * size[2])
        thread = 0.45 * size[:2] / 2
        builder.add_cylinder("body", [*-thread, low[2]], [*thread, neck])
        glass = ((0, 0), (0.45, 0), (0.6, 0.2), (0.95, 0.5), (1, 0.65), (0.85, 0.85), (0.5, 0.97), (0, 1))
        builder.add_lathe("bulb", glass, [*low[:2], neck], high)
        builder.light = np.array([0.0, 0.0, (neck + high[2]) / 2])
        builder.add_collision_cylinder([*-thread, low[2]], [*thread, neck])
        builder.add_collision_cylinder([*low[:2], neck], high)

    def _build_candle(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        wax = float(high[2]) - min(0.03, 0.25 * float(size[2]))
        builder.add_lathe("shade", ((0, 0), (1, 0), (1, 1), (0.8, 0.98), (0, 0.97)), low, [*high[:2], wax])
        wick = min(0.0015, 0.1 * float(size[:2].min()))
        builder.add_cylinder("body", [-wick, -wick, wax - 0.05 * size[2]], [wick, wick, wax + 0.4 * (high[2] - wax)])
        flame = ((0, 0), (0.8, 0.25), (1, 0.4), (0.5, 0.75), (0, 1))
        wide = 0.2 * float(size[:2].min())
        builder.add_lathe(
            "bulb", flame, [-wide, -wide, wax + 0.1 * (high[2] - wax)], [wide, wide, high[2]], segments=16
        )
        builder.light = np.array([0.0, 0.0, high[2]])
        builder.add_collision_cylinder(low, [*high[:2], wax])

    def _build_tube(self, builder: GeometryBuilder) -> None:
        """Adds a tube between two caps, or a torch with its glass at one end, along the longest extent."""
        low, high, size = builder.low, builder.high, builder.size
        axis = int(np.argmax(size))
        along = BodySide.from_axis(axis, 1)
        along_it = np.arange(3) == axis
        start, end = np.where(along_it, 0.92 * low, low), np.where(along_it, 0.92 * high, high)
        if self.style == "tube":
            builder.light = np.array([0.0, 0.0, low[2]])  # below: inside, the tube would shade it
            builder.add_cylinder(
                "bulb", np.where(along_it, start, 0.9 * start), np.where(along_it, end, 0.9 * end), along=along
            )
            for near, far in ((low, start), (end, high)):
                first, last = low.copy(), high.copy()
                first[axis], last[axis] = near[axis], far[axis]
                builder.add_cylinder("body", first, last, along=along)
        else:
            profile = ((0, 0), (0.7, 0), (0.7, 0.65), (1, 0.8), (1, 1), (0.9, 1), (0.86, 0.98), (0, 0.98))
            builder.add_lathe("body", profile, low, high, along=along, bevel=0.001)
            glass_low, glass_high = 0.85 * low, 0.85 * high
            glass_low[axis], glass_high[axis] = high[axis] - 0.02 * size[axis], high[axis]
            builder.add_cylinder("bulb", glass_low, glass_high, along=along)
            builder.light = high * along_it
        builder.add_collision_cylinder(low, high, along=along)


def _add_collision_cone(builder: GeometryBuilder, bottom: float, top: float) -> None:
    """Adds the hull of a shade as a collision part."""
    angle = np.arange(12) * (np.pi / 6)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1).round(15) * builder.size[:2] / 2
    builder.add_collision_hull(
        np.concatenate([np.column_stack([ring * share, np.full(12, z)]) for share, z in ((1.0, bottom), (0.55, top))])
    )
