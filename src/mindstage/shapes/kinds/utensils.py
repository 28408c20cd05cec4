"""Utensils: what one eats, stirs and cuts with; each lies with its working end to the front."""

from __future__ import annotations

from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import MaterialRoles, ShapeTemplate
from mindstage.shapes.draft import GeometryBuilder
from mindstage.world.geometry import Array

__all__ = ["Cutlery"]

_SEGMENTS = 16


class Cutlery(ShapeTemplate, frozen=True, kw_only=True):
    """A fork, a knife, a spoon, or another tool with a handle."""

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
        """From the back to a share of the length, narrower towards the working end, in a gentle bow."""
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
        """Two grips side by side, a head with a wing to turn."""
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
    """An ellipse across the length: extents as shares of the size, its middle at a share of the height."""
    angle = np.arange(_SEGMENTS) * (2 * np.pi / _SEGMENTS)
    y = np.cos(angle) * wide * builder.size[1] / 2
    tall = min(tall, 2 * height, 2 * (1 - height))
    z = builder.low[2] + height * builder.size[2] + np.sin(angle) * tall * builder.size[2] / 2
    return np.stack([np.full(_SEGMENTS, builder.low[0] + share * builder.size[0]), y, z], axis=1)


def _bowl_ring(builder: GeometryBuilder, share: float, wide: float, deep: float) -> Array:
    """A crescent across the length: the lower half of an ellipse, and a hollow in it."""
    low, size = builder.low, builder.size
    lower = np.linspace(np.pi, 2 * np.pi, _SEGMENTS // 2 + 1)
    upper = lower[::-1][1:-1]
    rim = float(low[2] + deep * size[2])
    thin = 0.12 * float(size[2])
    y = np.concatenate([np.cos(lower), 0.9 * np.cos(upper)]) * wide * size[1] / 2
    depth = deep * float(size[2]) * wide
    z = np.concatenate([rim + np.sin(lower) * depth, rim + np.sin(upper) * max(depth - thin, 0.1 * depth)])
    return np.stack([np.full(len(y), low[0] + share * size[0]), y, z], axis=1)
