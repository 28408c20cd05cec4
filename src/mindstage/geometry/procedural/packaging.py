"""Packaging: bottles, jars, cans, cartons and bags."""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import (
    Fraction,
    GeometryBuilder,
    MaterialRoles,
    PositiveFraction,
    ShapeTemplate,
)
from mindstage.geometry.procedural.texture_coordinates import PrintLayout
from mindstage.scene import Color
from mindstage.scene.transforms import Array
from mindstage.textures.prints import package_top, package_wrap, round_label

__all__ = ["Bag", "Bottle", "Can", "Carton", "Jar"]

_LABEL_INSET = 0.985
"""Width of a bottle under its label, as a fraction of the width."""


def _add_round_label(
    builder: GeometryBuilder, word: str, heights: tuple[float, float], *, width: float = 1.0, inner: float = 0.97
) -> None:
    """Adds a label around a bottle, a jar or a can: with a word, or plain without one."""
    low, high = [*(width * builder.low[:2]), heights[0]], [*(width * builder.high[:2]), heights[1]]
    profile = ((inner, 0.0), (1.0, 0.0), (1.0, 1.0), (inner, 1.0))
    if not word:
        builder.add_lathe("label", profile, low, high, bevel=0.0005, closed=True)
        return
    around = np.pi * float(builder.size[:2].mean()) * width

    def picture(color: Color) -> NDArray[np.uint8]:
        return round_label(word, round(around, 4), round(heights[1] - heights[0], 4), color)

    builder.add_printed_lathe("label", profile, low, high, picture, closed=True)


def _add_printed_body(builder: GeometryBuilder, word: str, high: Array, *, rounding: float, rounded: bool) -> None:
    """Adds a box from the lower corner, printed with a word: on top if it is flat, else on its four sides."""
    depth, width, height = (round(float(extent), 4) for extent in high - builder.low)
    if height < 0.5 * min(depth, width):
        layout, picture = PrintLayout.TOP, partial(package_top, word, depth, width)
    else:
        layout, picture = PrintLayout.WRAP, partial(package_wrap, word, depth, width, height)
    builder.add_printed_box("body", builder.low, high, layout, picture, rounding=rounding, rounded=rounded)


class Bottle(ShapeTemplate, frozen=True, kw_only=True):
    """A bottle: a body, shoulders, a neck and a cap; its contents are visible if it is transparent."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.CLEAR_GLASS, "contents": finishes.CLEAR_GLASS, "label": finishes.LABEL, "cap": finishes.IRON}
    )
    shoulder: PositiveFraction = 0.6
    """Height of the shoulder, as a fraction of the height."""
    neck: PositiveFraction = 0.36
    """Width of the neck, as a fraction of the width."""
    labeled: bool = True
    cap: bool = True
    word: str = ""
    """What is printed on it; nothing if empty."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        neck, edge = max(self.neck, 0.1), min(max(self.shoulder, 0.2), 0.85)
        rim = 0.93 if self.cap else 1.0
        foot = min(0.04, 0.1 * edge)
        bend = [
            (neck + (1 - neck) * 0.5 * (1 + float(np.cos(t * np.pi))), edge + t * 0.2 * (1 - edge) / 0.4)
            for t in np.linspace(0.0, 1.0, 7)
        ]
        bend = [(r, min(z, rim - 0.02)) for r, z in bend]
        profile = (
            (0, 0),
            (0.92, 0),
            (1.0, foot),
            *bend,
            (neck, rim - 0.01),
            (1.12 * neck, rim - 0.008),
            (1.12 * neck, rim),
            (0, rim),
        )
        top = float(low[2] + rim * size[2])
        scaled = [(r, z / rim) for r, z in profile]
        bare = _LABEL_INSET if self.labeled else 1.0
        builder.add_lathe("body", scaled, [*(bare * low[:2]), low[2]], [*(bare * high[:2]), top], bevel=0.0015)
        full = 0.93 * bare
        level = float(low[2] + 0.92 * edge * size[2])
        builder.add_cylinder("contents", [*(full * low[:2]), low[2] + 0.02 * size[2]], [*(full * high[:2]), level])
        if self.cap:
            wide = min(1.2 * neck, 1.0) * size[:2] / 2
            builder.add_cylinder("cap", [*-wide, top - 0.03 * size[2]], [*wide, high[2]], bevel=0.002)
        if self.labeled:
            start, end = float(low[2] + 0.35 * edge * size[2]), float(low[2] + 0.85 * edge * size[2])
            _add_round_label(builder, self.word, (start, end))
        self._add_collision_shapes(builder, neck, edge)

    @staticmethod
    def _add_collision_shapes(builder: GeometryBuilder, neck: float, edge: float) -> None:
        low, high, size = builder.low, builder.high, builder.size
        shoulder = float(low[2] + edge * size[2])
        builder.add_collision_cylinder(low, [*high[:2], shoulder])
        builder.add_collision_cylinder([*(neck * low[:2]), shoulder], [*(neck * high[:2]), high[2]])


class Jar(ShapeTemplate, frozen=True, kw_only=True):
    """A glass jar with a lid and visible contents."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.CLEAR_GLASS, "contents": finishes.FOOD, "lid": finishes.STEEL, "label": finishes.LABEL}
    )
    lid: PositiveFraction = 0.14
    """Height of the lid, as a fraction of the height."""
    labeled: bool = True
    filled: Fraction = 0.85
    word: str = ""
    """What is printed on it; nothing if empty."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        rim = float(high[2] - max(self.lid, 0.05) * size[2])
        profile = ((0, 0), (0.92, 0), (1, 0.05), (1, 0.86), (0.85, 0.97), (0.85, 1), (0, 1))
        bare = _LABEL_INSET if self.labeled else 1.0
        builder.add_lathe("body", profile, [*(bare * low[:2]), low[2]], [*(bare * high[:2]), rim], bevel=0.002)
        builder.add_cylinder("lid", [*(0.9 * low[:2]), rim - 0.01 * size[2]], [*(0.9 * high[:2]), high[2]], bevel=0.003)
        if self.filled > 0.05:
            level = float(low[2]) + 0.04 * float(size[2]) + (0.86 * self.filled) * (rim - float(low[2]))
            builder.add_cylinder("contents", [*(0.93 * low[:2]), low[2] + 0.03 * size[2]], [*(0.93 * high[:2]), level])
        if self.labeled:
            start, end = (float(low[2]) + share * (rim - float(low[2])) for share in (0.22, 0.72))
            _add_round_label(builder, self.word, (start, end))
        builder.add_collision_cylinder(low, high)
        builder.add_support_surface(0.6 * low, 0.6 * high, float(high[2]))


class Can(ShapeTemplate, frozen=True, kw_only=True):
    """A can, with or without a paper label."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.STEEL, "label": finishes.RED})
    labeled: bool = True
    word: str = ""
    """What is printed on it; nothing if empty."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        bead = min(0.04, 0.003 / float(size[2]) + 0.01)
        profile = (
            (0, bead),
            (0.93, bead),
            (0.95, 0),
            (1, 0),
            (1, bead),
            (0.97, 1.5 * bead),
            (0.97, 1 - 1.5 * bead),
            (1, 1 - bead),
            (1, 1),
            (0.95, 1),
            (0.93, 1 - bead),
            (0, 1 - bead),
        )
        builder.add_lathe("body", profile, low, high, bevel=0.001)
        if self.labeled:
            start, end = float(low[2] + 0.1 * size[2]), float(high[2] - 0.1 * size[2])
            _add_round_label(builder, self.word, (start, end), width=0.985 * 0.985, inner=0.9)
        builder.add_collision_cylinder(low, high)
        builder.add_support_surface(0.6 * low, 0.6 * high, float(high[2]))


class Carton(ShapeTemplate, frozen=True, kw_only=True):
    """A cardboard box with a printed front; with a gable and a cap for milk."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.PAPER, "label": finishes.PICTURE, "cap": finishes.RED}
    )
    gable: bool = False
    labeled: bool = True
    word: str = ""
    """What is printed on it; nothing if empty."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        shoulder = float(high[2])
        if self.gable:
            shoulder -= min(0.22 * float(size[2]), 0.8 * float(size[0]))
        is_printed = self.labeled and bool(self.word)
        label_depth = min(0.0006, 0.02 * float(size[0])) if self.labeled and not is_printed else 0.0
        front = float(high[0]) - label_depth
        if is_printed:
            _add_printed_body(builder, self.word, np.array([*high[:2], shoulder]), rounding=0.0015, rounded=False)
        else:
            builder.add_box("body", low, [front, high[1], shoulder], rounding=0.0015, collides=False)
        if label_depth:
            edge = [0.08 * float(size[1]), 0.1 * (shoulder - float(low[2]))]
            builder.add_box(
                "label",
                [front - label_depth, low[1] + edge[0], low[2] + 1.5 * edge[1]],
                [high[0], high[1] - edge[0], shoulder - edge[1]],
                rounding=0.0,
                collides=False,
            )
        builder.add_collision_box(low, [*high[:2], shoulder])
        if not self.gable:
            builder.add_support_surface(low, high, shoulder)
            return
        ridge = float(high[2]) - 0.35 * (float(high[2]) - shoulder)
        thin = 0.05 * float(size[0])
        builder.add_frustum(
            "body", ([*low[:2], shoulder], [front, high[1], shoulder]), ([-thin, low[1], ridge], [thin, high[1], ridge])
        )
        builder.add_box("body", [-0.6 * thin, low[1], ridge], [0.6 * thin, *high[1:]], rounding=0.001, collides=False)
        cap = 0.16 * float(size[:2].min())
        x, z = 0.25 * float(size[0]), shoulder + 0.45 * (ridge - shoulder)
        builder.add_tube("cap", [(x, 0.0, z - 0.3 * cap), (x + 0.55 * cap, 0.0, z + 0.55 * cap)], cap)


class Bag(ShapeTemplate, frozen=True, kw_only=True):
    """A bag of paper or plastic, folded at the top."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.PAPER, "label": finishes.PICTURE})
    labeled: bool = True
    word: str = ""
    """What is printed on it; nothing if empty."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        tall = size[2] > 0.8 * size[:2].min()
        seam = float(high[2] - 0.16 * size[2]) if tall else float(high[2])
        is_printed = self.labeled and bool(self.word)
        label_depth = 0.01 * float(size[0]) if self.labeled and not is_printed else 0.0
        front, rounding = float(high[0]) - label_depth, 0.22 * builder.min_extent
        if is_printed:
            _add_printed_body(builder, self.word, np.array([*high[:2], seam]), rounding=rounding, rounded=True)
        else:
            builder.add_box("body", low, [front, high[1], seam], rounding=rounding, rounded=True, collides=False)
        builder.add_collision_box(low, [*high[:2], seam])
        if tall:
            fold = 0.2 * float(size[0])
            below = ([*(0.7 * low[:2]), seam - 0.1 * size[2]], [*(0.7 * high[:2]), seam - 0.1 * size[2]])
            builder.add_frustum("body", below, ([-fold / 2, 0.7 * low[1], high[2]], [fold / 2, 0.7 * high[1], high[2]]))
        if label_depth:
            reach = np.array([0.3 * size[1], 0.25 * (seam - low[2])])
            middle = float(low[2] + seam) / 2
            builder.add_box(
                "label",
                [high[0] - label_depth, -reach[0], middle - reach[1]],
                [high[0], reach[0], middle + reach[1]],
                rounding=0.0,
                collides=False,
            )
