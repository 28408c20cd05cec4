"""Racks: what is made of wire."""

from __future__ import annotations

from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import MaterialRoles, ShapeTemplate, Thickness
from mindstage.shapes.draft import GeometryBuilder
from mindstage.shapes.kinds.containers import floor_thickness

__all__ = ["WireRack"]


class WireRack(ShapeTemplate, frozen=True, kw_only=True):
    """A rack of wires: a grid where it is flat, else a basket."""

    name = "rack"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CHROME})
    wire: Thickness = 0.005
    """How thick [m]."""
    mesh: Thickness = 0.045
    """From wire to wire [m]."""
    tines: bool = False
    """Whether rows of pins hold plates upright in it."""
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        wire = min(self.wire, 0.08 * builder.min_extent if size[2] > 0.03 else builder.min_extent)
        flat = size[2] < max(0.03, 0.08 * float(size[:2].min()))
        top = float(high[2]) if flat else float(low[2]) + floor_thickness(builder, wire, self.level)
        self._add_grid(builder, wire, float(low[2]) if flat else max(top - wire, float(low[2])), top)
        if flat:
            builder.add_collision_box(low, high)
            builder.add_support_surface(low, high, top)
            return
        builder.add_collision_box([*low[:2], max(top - 2 * wire, float(low[2]))], [*high[:2], top])
        builder.add_support_surface(
            low[:2] + wire, high[:2] - wire, top, clearance=float(high[2]) - top, is_inside=True
        )
        for axis in (0, 1):
            for sign in (-1, 1):
                self._add_fence(builder, axis, sign, wire)
        if self.tines:
            self._add_tines(builder, wire, top)

    def _add_grid(self, builder: GeometryBuilder, wire: float, bottom: float, top: float) -> None:
        thick = min(wire, top - bottom)
        for axis in (0, 1):
            start, end = builder.low[axis] + wire / 2, builder.high[axis] - wire / 2
            count = int(np.clip((end - start) / max(self.mesh, 1e-3), 1, 14))
            for spot in np.linspace(start, end, count + 1):
                edge = spot in (start, end)
                low, high = np.array([*builder.low[:2], bottom]), np.array([*builder.high[:2], top])
                low[axis], high[axis] = spot - wire / 2, spot + wire / 2
                if not edge:
                    high[2] = bottom + thick * (0.9 - 0.3 * axis)
                builder.add_box("body", low, high, rounding=0.35 * wire, collides=False)

    def _add_fence(self, builder: GeometryBuilder, axis: int, sign: int, wire: float) -> None:
        """One side: a rail on top, one half way up, and uprights."""
        low, high = builder.low.copy(), builder.high.copy()
        low[axis], high[axis] = sorted((sign * builder.high[axis], sign * (builder.high[axis] - wire)))
        builder.add_collision_box(low, high)
        for level in (float(high[2]), float(low[2] + 0.55 * builder.size[2]), float(low[2]) + wire):
            builder.add_box("body", [*low[:2], level - wire], [*high[:2], level], rounding=0.35 * wire, collides=False)
        other = 1 - axis
        count = int(np.clip(builder.size[other] / max(1.5 * self.mesh, 1e-3), 1, 12))
        for spot in np.linspace(builder.low[other] + wire / 2, builder.high[other] - wire / 2, count + 1):
            start, end = low.copy(), high.copy()
            start[other], end[other] = spot - 0.4 * wire, spot + 0.4 * wire
            builder.add_box("body", start, end, rounding=0.3 * wire, collides=False)

    def _add_tines(self, builder: GeometryBuilder, wire: float, floor: float) -> None:
        top = floor + 0.6 * float(builder.high[2] - floor)
        for x in np.linspace(0.6 * builder.low[0], 0.6 * builder.high[0], 8):
            for y in (0.5 * builder.low[1], 0.15 * builder.low[1], 0.15 * builder.high[1], 0.5 * builder.high[1]):
                spot = np.array([x, y])
                builder.add_box(
                    "body", [*(spot - 0.4 * wire), floor - wire / 2], [*(spot + 0.4 * wire), top], collides=False
                )
