"""Household: books, textiles, plants and people."""

from __future__ import annotations

import itertools
from functools import partial
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import (
    BodySide,
    Count,
    Fraction,
    GeometryBuilder,
    MaterialRoles,
    PositiveFraction,
    ShapeTemplate,
    Thickness,
)
from mindstage.geometry.procedural.texture_coordinates import PrintLayout
from mindstage.scene.transforms import Array
from mindstage.textures.prints import book_cover, book_spine

__all__ = ["Book", "Cushion", "PaperRoll", "Person", "Plant", "Towel"]


class Book(ShapeTemplate, frozen=True, kw_only=True):
    """A closed book: its spine is at the front, or at the left if its thin axis is from front to back."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.RED, "pages": finishes.PAPER})
    cover: Thickness = 0.003
    word: str = ""
    """The title, on an upright spine and on the cover; nothing if empty."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high = builder.low, builder.high
        thin = int(np.argmin(builder.size))
        spine = 0 if thin != 0 else 1
        cover = min(self.cover, 0.2 * builder.min_extent)
        builder.add_collision_box(low, high)
        for sign in (-1, 1):
            start, end = low.copy(), high.copy()
            start[thin], end[thin] = sorted((sign * high[thin], sign * (high[thin] - cover)))
            self._add_board(builder, start, end, thin if sign > 0 else None)
        start, end = low.copy(), high.copy()
        start[thin], end[thin] = low[thin] + cover, high[thin] - cover
        start[spine] = high[spine] - cover
        if self.word and (spine, thin) == (0, 1):
            picture = partial(book_spine, self.word, *_rounded(end - start)[1:])
            builder.add_printed_box("body", start, end, PrintLayout.FRONT, picture, rounding=0.3 * cover)
        else:
            builder.add_box("body", start, end, rounding=0.3 * cover, collides=False)
        start, end = 0.97 * low, 0.97 * high
        start[thin], end[thin] = low[thin] + cover, high[thin] - cover
        end[spine] = high[spine] - cover
        builder.add_box("pages", start, end, rounding=0.0, collides=False)
        if thin == 2:
            builder.add_support_surface(low, high, float(high[2]))

    def _add_board(self, builder: GeometryBuilder, start: Array, end: Array, front_axis: int | None) -> None:
        """Adds one side of the cover; the front has the title."""
        layout = {1: PrintLayout.LEFT, 2: PrintLayout.TOP}.get(-1 if front_axis is None else front_axis)
        rounding = 0.3 * float((end - start).min())
        if not self.word or layout is None:
            builder.add_box("body", start, end, rounding=rounding, collides=False)
            return
        depth, width, height = _rounded(end - start)
        size = (depth, height) if layout is PrintLayout.LEFT else (width, depth)
        picture = partial(book_cover, self.word, *size)
        builder.add_printed_box("body", start, end, layout, picture, rounding=rounding)


def _rounded(extents: Array) -> tuple[float, float, float]:
    depth, width, height = (round(float(extent), 4) for extent in extents)
    return depth, width, height


class Cushion(ShapeTemplate, frozen=True, kw_only=True):
    """A soft rounded box: a cushion, a sponge, a loaf, a bar of soap."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.LINEN})
    roundness: Fraction = 0.7
    """From a box (0) to an ellipsoid-like pebble (1)."""

    def _build(self, builder: GeometryBuilder) -> None:
        radius = 0.5 * builder.min_extent * max(self.roundness, 0.02)
        builder.add_box("body", builder.low, builder.high, rounding=radius, rounded=True)


class Towel(ShapeTemplate, frozen=True, kw_only=True):
    """A folded cloth: a stack of soft layers."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.LINEN, "stripe": finishes.PICTURE})
    layers: Count = 3
    stripe: bool = True

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        builder.add_collision_box(low, high)
        builder.add_support_surface(low, high, float(high[2]))
        stripe = min(0.0006, 0.1 * float(size[2])) if self.stripe else 0.0
        edges = np.linspace(low[2], high[2] - stripe, max(self.layers, 1) + 1)
        for number, (bottom, top) in enumerate(itertools.pairwise(edges)):
            inset = 0.0 if number == 0 else 0.012 * float(size[:2].min()) * number
            start, end = [low[0] + inset, low[1] + inset, bottom], [*high[:2] - [0.0, inset], top]
            builder.add_box("body", start, end, rounding=0.5 * (top - bottom), rounded=True, collides=False)
        if self.stripe:
            builder.add_box(
                "stripe",
                [low[0] + 0.2 * size[0], low[1] + 0.035 * size[1], high[2] - 2 * stripe],
                [low[0] + 0.3 * size[0], high[1] - 0.035 * size[1], high[2]],
                rounding=0.0,
                collides=False,
            )


class PaperRoll(ShapeTemplate, frozen=True, kw_only=True):
    """An upright roll of paper with a hollow core."""

    name = "roll"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.PAPER, "core": finishes.WICKER})
    core: PositiveFraction = 0.3
    """Width of the core, as a fraction of the width."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high = builder.low, builder.high
        core = min(max(self.core, 0.05), 0.9)
        builder.add_lathe("body", ((core, 0), (1, 0), (1, 1), (core, 1)), low, high, closed=True)
        loop = ((0.9 * core, 0.005), (core, 0.005), (core, 0.995), (0.9 * core, 0.995))
        scaled = [(r / core, z) for r, z in loop]
        builder.add_lathe(
            "core", scaled, [*(core * low[:2]), low[2]], [*(core * high[:2]), high[2]], closed=True, bevel=0.0005
        )
        builder.add_collision_cylinder(low, high)


class Plant(ShapeTemplate, frozen=True, kw_only=True):
    """A plant, in a pot or without one."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.TERRACOTTA, "leaves": finishes.LEAF, "soil": finishes.SOIL, "flowers": finishes.RED}
    )
    pot: Fraction = 0.4
    """Height of the pot, as a fraction of the height."""
    flowers: bool = False

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        rim = float(low[2] + self.pot * size[2])
        if self.pot > 0.05:
            wide = 0.36 * size[:2]
            profile = ((0, 0), (0.72, 0), (0.92, 0.8), (1, 0.8), (1, 1), (0.9, 1), (0.88, 0.88), (0, 0.88))
            builder.add_lathe("body", profile, [*-wide, low[2]], [*wide, rim])
            soil = low[2] + 0.9 * self.pot * size[2]
            builder.add_cylinder("soil", [*(-0.88 * wide), soil - 0.02 * size[2]], [*(0.88 * wide), soil])
            builder.add_collision_cylinder([*-wide, low[2]], [*wide, rim])
        builder.add_collision_sphere([*(0.9 * low[:2]), rim], [*(0.9 * high[:2]), high[2]])
        self._add_leaves(builder, rim - 0.06 * float(size[2]))

    def _add_leaves(self, builder: GeometryBuilder, root: float) -> None:
        """Adds three whorls of curved leaves; lower ones reach farther out."""
        high = builder.high
        tall = float(high[2]) - root
        for whorl, (count, out, up) in enumerate(((8, 1.0, 0.55), (7, 0.75, 0.85), (5, 0.4, 1.0))):
            for number in range(count):
                turn = 2 * np.pi * (number + 0.37 * whorl) / count
                direction = np.array([np.cos(turn) * high[0], np.sin(turn) * high[1], 0.0]) * out
                side = np.array([-np.sin(turn), np.cos(turn), 0.0]) * 0.16 * float(high[:2].min())
                rings = []
                for share in np.linspace(0.0, 1.0, 7):
                    middle = direction * share + [0, 0, root + tall * up * float(np.sin(share * 0.62 * np.pi))]
                    wide = side * max(float(np.sin(np.pi * share**0.8)), 0.06)
                    lift = np.array([0, 0, 0.03 * float(high[:2].min())])
                    rings.append([middle - wide + lift, middle - 0.2 * lift, middle + wide + lift, middle + 0.6 * lift])
                builder.add_loft("leaves", np.array(rings))
                if self.flowers and whorl:
                    tip = direction * 0.85 + [0, 0, root + tall * up * 0.95]
                    reach = 0.12 * float(high[:2].min())
                    ball = [
                        (float(np.cos(a)), (float(np.sin(a)) + 1) / 2) for a in np.linspace(-np.pi / 2, np.pi / 2, 7)
                    ]
                    low = np.maximum(tip - reach, builder.low)
                    builder.add_lathe("flowers", ball, low, np.minimum(low + 2 * reach, builder.high), segments=12)


class Person(ShapeTemplate, frozen=True, kw_only=True):
    """A standing person: legs, a trunk, arms and a head; it faces the front."""

    name = "figure"
    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.PICTURE, "legs": finishes.DARK_PLASTIC, "head": finishes.BAMBOO}
    )

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        hips, neck = (float(low[2] + share * size[2]) for share in (0.48, 0.84))
        arm = 0.17 * float(size[1])
        for sign in (-1, 1):
            y = sorted((sign * 0.03 * size[1], sign * 0.27 * size[1]))
            builder.add_box(
                "legs", [0.6 * low[0], y[0], low[2]], [0.6 * high[0], y[1], hips], rounding=0.05, rounded=True
            )
            builder.add_box(
                "legs",
                [0.6 * low[0], y[0], low[2]],
                [high[0], y[1], low[2] + 0.05 * size[2]],
                rounding=0.03,
                rounded=True,
            )
            y = sorted((sign * high[1], sign * (high[1] - arm)))
            builder.add_box(
                "body",
                [0.5 * low[0], y[0], hips - 0.02 * size[2]],
                [0.5 * high[0], y[1], neck - 0.02 * size[2]],
                rounding=0.05,
                rounded=True,
            )
        builder.add_box(
            "body",
            [low[0], low[1] + 0.95 * arm, hips - 0.03 * size[2]],
            [0.8 * high[0], high[1] - 0.95 * arm, neck],
            rounding=0.07,
            rounded=True,
        )
        wide = min(0.07 * float(size[2]), 0.45 * float(size[0]), 0.3 * float(size[1]))
        ball = [(float(np.cos(a)), (float(np.sin(a)) + 1) / 2) for a in np.linspace(-np.pi / 2, np.pi / 2, 13)]
        builder.add_cylinder(
            "head",
            [-0.45 * wide, -0.45 * wide, neck - 0.02 * size[2]],
            [0.45 * wide, 0.45 * wide, neck + 0.04 * size[2]],
            along=BodySide.TOP,
        )
        builder.add_lathe("head", ball, [-wide, -wide, neck + 0.015 * size[2]], [wide, wide, high[2]])
        builder.add_collision_sphere([-wide, -wide, neck + 0.015 * size[2]], [wide, wide, high[2]])
