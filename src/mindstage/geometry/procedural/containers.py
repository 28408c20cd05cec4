"""Containers: crates, baskets, sinks, bins and racks that are open at the top."""

from __future__ import annotations

from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import Count, GeometryBuilder, MaterialRoles, ShapeTemplate, Thickness

__all__ = ["Basket", "Bin", "Crate", "Sink", "WireRack", "floor_thickness"]


def floor_thickness(builder: GeometryBuilder, default: float, level: float | None) -> float:
    """Returns the thickness of a floor with its top at a level, if that is inside the shape, otherwise the default."""
    if level is None or not builder.low[2] + 1e-4 <= level < builder.high[2]:
        return default
    return level - float(builder.low[2])


def _add_walls(builder: GeometryBuilder, role: str, wall: float, floor: float, level: float | None) -> None:
    """Adds four walls, a floor, and the support surface on it."""
    low, high = builder.low, builder.high
    wall = min(wall, 0.15 * float(builder.size[:2].min()))
    floor = floor_thickness(builder, min(floor, 0.25 * float(builder.size[2])), level)
    level = low[2] + floor
    builder.add_box(role, [*(low[:2] + wall), low[2]], [*(high[:2] - wall), level], rounding=0.0, collides=False)
    builder.add_collision_box(low, [*high[:2], level])  # only the floor touches the ground: walls would add contacts
    for sign in (-1, 1):
        edge = sorted((sign * high[0], sign * (high[0] - wall)))
        builder.add_box(role, [edge[0], low[1], low[2]], [edge[1], high[1], high[2]], rounding=0.003, collides=False)
        builder.add_collision_box([edge[0], low[1], level], [edge[1], high[1], high[2]])
        edge = sorted((sign * high[1], sign * (high[1] - wall)))
        start, end = [low[0] + wall, edge[0]], [high[0] - wall, edge[1]]
        builder.add_box(role, [*start, low[2]], [*end, high[2]], rounding=0.003, collides=False)
        builder.add_collision_box([*start, level], [*end, high[2]])
    inside = float(builder.size[2]) - floor
    builder.add_support_surface(
        low[:2] + wall, high[:2] - wall, float(low[2]) + floor, clearance=inside, is_inside=True
    )


class Crate(ShapeTemplate, frozen=True, kw_only=True):
    """A box that is open at the top: a crate, a tray, a storage box."""

    name = "tub"
    wall: Thickness = 0.008
    floor: Thickness = 0.008
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        _add_walls(builder, "body", self.wall, self.floor, self.level)


class Basket(ShapeTemplate, frozen=True, kw_only=True):
    """A woven basket that is open at the top."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.WICKER, "rim": "body"})
    wall: Thickness = 0.012
    band: Thickness = 0.025
    """Height of a woven band [m]."""
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        wall = min(self.wall, 0.15 * float(size[:2].min()))
        floor = floor_thickness(builder, min(0.01, 0.25 * float(size[2])), self.level)
        inner = GeometryBuilder((float(size[0]), float(size[1]), float(size[2])), builder.turn)
        _add_walls(inner, "body", wall, floor, None if self.level is None else float(low[2]) + floor)
        builder.collision_parts += inner.collision_parts
        builder.support_surfaces += inner.support_surfaces
        builder.add_box(
            "body", [*(low[:2] + wall / 2), low[2]], [*(high[:2] - wall / 2), low[2] + floor], collides=False
        )
        rows = int(np.clip(size[2] / max(self.band, 1e-3), 3, 8))
        edges = np.linspace(low[2], high[2], rows + 1)
        for row, (bottom, top) in enumerate(pairwise(edges.tolist())):
            rim = row == rows - 1
            for axis in (0, 1):
                across = int(np.clip(size[1 - axis] / 0.07, 2, 8))
                for number in range(1 if rim else across):
                    inset = 0.0 if rim else 0.25 * wall * ((row + number) % 2)
                    ends = np.linspace(low[1 - axis], high[1 - axis], (1 if rim else across) + 1)[number : number + 2]
                    for sign in (-1, 1):
                        face = sorted((sign * (high[axis] - inset), sign * (high[axis] - wall + 0.25 * wall - inset)))
                        start, end = np.zeros(3), np.zeros(3)
                        start[[axis, 1 - axis, 2]], end[[axis, 1 - axis, 2]] = (
                            [face[0], ends[0], bottom],
                            [face[1], ends[1], top],
                        )
                        builder.add_box(
                            "rim" if rim else "body", start, end, rounding=0.35 * (top - bottom), collides=False
                        )


class Sink(ShapeTemplate, frozen=True, kw_only=True):
    """A sink for insertion into a countertop: a rim, one or more basins, optionally a drainer."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.STEEL, "inside": "body", "drain": finishes.IRON}
    )
    basins: Count = 1
    drainer: bool = False
    """Whether there is a drainer, to the left of the basins."""
    rim: Thickness = 0.04
    wall: Thickness = 0.004
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        count = min(max(self.basins, 1), 3)
        rim, wall = min(self.rim, 0.12 * float(size[:2].min())), min(self.wall, 0.02 * builder.min_extent)
        lip = min(0.012, 0.2 * float(size[2]))
        left = float(high[1] - (0.42 * size[1] if self.drainer else rim))
        pitch = (left - float(low[1]) - rim) / count
        spans = [
            (float(low[1]) + rim + pitch * n, float(low[1]) + rim + pitch * (n + 1) - rim * (n < count - 1))
            for n in range(count)
        ]
        back = float(low[0]) + min(1.6 * rim, 0.25 * float(size[0]))  # room for the tap
        front = float(high[0]) - rim
        x_cuts = np.array([low[0], back, front, high[0]])
        y_cuts = np.array([low[1], *(edge for span in spans for edge in span), high[1]])
        kept = np.ones((3, len(y_cuts) - 1), dtype=bool)
        kept[1, 1::2] = False
        builder.add_sheet(
            "body", (x_cuts, y_cuts), kept, (float(high[2]) - lip, float(high[2])), collision_bottom=float(low[2])
        )
        for y0, y1 in spans:
            self._add_basin(builder, (back, y0), (front, y1), wall, lip)
        if self.drainer:
            for spot in np.linspace(left + 0.2 * rim + wall, float(high[1]) - rim, 8):
                builder.add_box(
                    "body",
                    [back, spot - 0.004, high[2] - lip],
                    [front, spot + 0.004, high[2]],
                    rounding=0.002,
                    collides=False,
                )

    def _add_basin(
        self, builder: GeometryBuilder, start: tuple[float, float], end: tuple[float, float], wall: float, lip: float
    ) -> None:
        (x0, y0), (x1, y1) = start, end
        bottom, top = float(builder.low[2]), float(builder.high[2]) - 0.3 * lip
        floor = bottom + floor_thickness(builder, min(3 * wall, 0.1 * float(builder.size[2])), self.level)
        builder.add_box("inside", [x0, y0, bottom], [x1, y1, floor], rounding=0.0)
        for low, high in (
            ((x0 - wall, y0 - wall), (x0, y1 + wall)),
            ((x1, y0 - wall), (x1 + wall, y1 + wall)),
            ((x0, y0 - wall), (x1, y0)),
            ((x0, y1), (x1, y1 + wall)),
        ):
            builder.add_box("inside", [*low, bottom], [*high, top], rounding=0.0, collides=False)
        drain = min(0.045, 0.15 * (x1 - x0), 0.15 * (y1 - y0))
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        builder.add_cylinder("drain", [*(middle - drain), bottom], [*(middle + drain), floor + min(0.003, wall)])
        builder.add_support_surface(start, end, floor, clearance=float(builder.high[2]) - floor, is_inside=True)


class Bin(ShapeTemplate, frozen=True, kw_only=True):
    """A bin: round or square, open or with a lid."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.STEEL, "lid": finishes.DARK_PLASTIC, "inside": "body"}
    )
    round: bool = True
    lid: bool = True
    wall: Thickness = 0.006
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        if not self.lid:
            self._add_open_bin(builder)
            return
        seam = float(high[2] - min(0.12 * size[2], 0.08))
        parts = (("body", low, [*high[:2], seam - 0.004 * size[2]]), ("lid", [*(low[:2] * 0.99), seam], high))
        for role, start, end in parts:
            if self.round:
                profile = (
                    ((0, 0), (0.96, 0), (1, 0.06), (1, 1), (0, 1))
                    if role == "body"
                    else ((0, 0), (1, 0), (1, 0.35), (0.8, 0.85), (0, 1))
                )
                builder.add_lathe(role, profile, start, end)
            else:
                builder.add_box(role, start, end, rounding=0.02, collides=False)
        builder.add_box(
            "lid", [*(low[:2] * 0.9), seam - 0.01 * size[2]], [*(high[:2] * 0.9), seam + 0.01 * size[2]], collides=False
        ) if not self.round else builder.add_cylinder(
            "lid", [*(low[:2] * 0.9), seam - 0.01 * size[2]], [*(high[:2] * 0.9), seam + 0.01 * size[2]]
        )
        if self.round:
            builder.add_collision_cylinder(low, high)
        else:
            builder.add_collision_box(low, high)

    def _add_open_bin(self, builder: GeometryBuilder) -> None:
        low, high = builder.low, builder.high
        if not self.round:
            _add_walls(builder, "body", self.wall, self.wall, self.level)
            return
        share = 1.0 - min(self.wall, 0.1 * float(builder.size[:2].min())) / float(builder.size[:2].min()) * 2
        floor = floor_thickness(builder, min(self.wall, 0.2 * float(builder.size[2])), self.level)
        rise = floor / float(builder.size[2])
        builder.add_lathe("body", ((0, 0), (0.85, 0), (1, 1), (share, 1), (0.85 * share, rise), (0, rise)), low, high)
        builder.add_collision_cylinder([*(low[:2] * 0.85), low[2]], [*(high[:2] * 0.85), low[2] + floor])
        builder.add_collision_ring([*low[:2], low[2]], high, outer=(0.85, 1.0), inner=(0.85 * share, share))
        reach = 0.6 * share
        builder.add_support_surface(
            low * reach, high * reach, float(low[2]) + floor, clearance=float(builder.size[2]) - floor, is_inside=True
        )


class WireRack(ShapeTemplate, frozen=True, kw_only=True):
    """A wire rack: a grid if it is flat, otherwise a basket."""

    name = "rack"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CHROME})
    wire: Thickness = 0.005
    """Thickness of a wire [m]."""
    mesh: Thickness = 0.045
    """Distance between wires [m]."""
    tines: bool = False
    """Whether rows of tines hold plates upright."""
    level: float | None = None
    """Height at which contents stand, from the center [m]; None for the floor."""

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
        """Adds one side: three horizontal rails, and vertical wires."""
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
