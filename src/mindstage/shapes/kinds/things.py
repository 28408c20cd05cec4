"""Things: books, cloth, plants, and those who live here."""

from __future__ import annotations

import itertools
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import Count, Design, Part, Roles, Share, Thickness
from mindstage.shapes.draft import Draft
from mindstage.shapes.sides import Side

__all__ = ["Book", "Cushion", "Figure", "Plant", "Roll", "Towel"]


class Book(Design, frozen=True, kw_only=True):
    """A book, closed: its spine is to the front, or to the left where it is thin from front to back."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.RED, "pages": finishes.PAPER})
    cover: Thickness = 0.003

    def _draw(self, draft: Draft) -> None:
        low, high = draft.low, draft.high
        thin = int(np.argmin(draft.size))
        spine = 0 if thin != 0 else 1
        cover = min(self.cover, 0.2 * draft.least)
        draft.touch_box(low, high)
        for sign in (-1, 1):
            start, end = low.copy(), high.copy()
            start[thin], end[thin] = sorted((sign * high[thin], sign * (high[thin] - cover)))
            draft.box("body", start, end, rounding=0.3 * cover, solid=False)
        start, end = low.copy(), high.copy()
        start[thin], end[thin] = low[thin] + cover, high[thin] - cover
        start[spine] = high[spine] - cover
        draft.box("body", start, end, rounding=0.3 * cover, solid=False)
        start, end = 0.97 * low, 0.97 * high
        start[thin], end[thin] = low[thin] + cover, high[thin] - cover
        end[spine] = high[spine] - cover
        draft.box("pages", start, end, rounding=0.0, solid=False)
        if thin == 2:
            draft.place(low, high, float(high[2]))


class Cushion(Design, frozen=True, kw_only=True):
    """Something soft without corners: a cushion, a sponge, a loaf, a bar of soap."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.LINEN})
    roundness: Share = 0.7
    """From a box (0) to a pebble (1)."""

    def _draw(self, draft: Draft) -> None:
        radius = 0.5 * draft.least * max(self.roundness, 0.02)
        draft.box("body", draft.low, draft.high, rounding=radius, soft=True)


class Towel(Design, frozen=True, kw_only=True):
    """Folded cloth: a stack of soft layers."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.LINEN, "stripe": finishes.PICTURE})
    layers: Count = 3
    stripe: bool = True

    def _draw(self, draft: Draft) -> None:
        low, high, size = draft.low, draft.high, draft.size
        draft.touch_box(low, high)
        draft.place(low, high, float(high[2]))
        skin = min(0.0006, 0.1 * float(size[2])) if self.stripe else 0.0
        edges = np.linspace(low[2], high[2] - skin, max(self.layers, 1) + 1)
        for number, (bottom, top) in enumerate(itertools.pairwise(edges)):
            inset = 0.0 if number == 0 else 0.012 * float(size[:2].min()) * number
            start, end = [low[0] + inset, low[1] + inset, bottom], [*high[:2] - [0.0, inset], top]
            draft.box("body", start, end, rounding=0.5 * (top - bottom), soft=True, solid=False)
        if self.stripe:
            draft.box(
                "stripe",
                [low[0] + 0.2 * size[0], low[1] + 0.035 * size[1], high[2] - 2 * skin],
                [low[0] + 0.3 * size[0], high[1] - 0.035 * size[1], high[2]],
                rounding=0.0,
                solid=False,
            )


class Roll(Design, frozen=True, kw_only=True):
    """A roll of paper, upright, hollow in the middle."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.PAPER, "core": finishes.WICKER})
    core: Part = 0.3
    """How wide the core is, as a share."""

    def _draw(self, draft: Draft) -> None:
        low, high = draft.low, draft.high
        core = min(max(self.core, 0.05), 0.9)
        draft.round("body", ((core, 0), (1, 0), (1, 1), (core, 1)), low, high, closed=True)
        loop = ((0.9 * core, 0.005), (core, 0.005), (core, 0.995), (0.9 * core, 0.995))
        scaled = [(r / core, z) for r, z in loop]
        draft.round(
            "core", scaled, [*(core * low[:2]), low[2]], [*(core * high[:2]), high[2]], closed=True, bevel=0.0005
        )
        draft.touch_round(low, high)


class Plant(Design, frozen=True, kw_only=True):
    """A plant in a pot, or in none."""

    roles: ClassVar[Roles] = MappingProxyType(
        {"body": finishes.TERRACOTTA, "leaves": finishes.LEAF, "soil": finishes.SOIL, "flowers": finishes.RED}
    )
    pot: Share = 0.4
    """How much of the height it takes."""
    flowers: bool = False

    def _draw(self, draft: Draft) -> None:
        low, high, size = draft.low, draft.high, draft.size
        rim = float(low[2] + self.pot * size[2])
        if self.pot > 0.05:
            wide = 0.36 * size[:2]
            profile = ((0, 0), (0.72, 0), (0.92, 0.8), (1, 0.8), (1, 1), (0.9, 1), (0.88, 0.88), (0, 0.88))
            draft.round("body", profile, [*-wide, low[2]], [*wide, rim])
            soil = low[2] + 0.9 * self.pot * size[2]
            draft.disc("soil", [*(-0.88 * wide), soil - 0.02 * size[2]], [*(0.88 * wide), soil])
            draft.touch_round([*-wide, low[2]], [*wide, rim])
        draft.touch_ball([*(0.9 * low[:2]), rim], [*(0.9 * high[:2]), high[2]])
        self._leaves(draft, rim - 0.06 * float(size[2]))

    def _leaves(self, draft: Draft, root: float) -> None:
        """Three whorls of leaves: the lower, the farther out; each bows over its own tip."""
        high = draft.high
        tall = float(high[2]) - root
        for whorl, (count, out, up) in enumerate(((8, 1.0, 0.55), (7, 0.75, 0.85), (5, 0.4, 1.0))):
            for number in range(count):
                turn = 2 * np.pi * (number + 0.37 * whorl) / count
                way = np.array([np.cos(turn) * high[0], np.sin(turn) * high[1], 0.0]) * out
                side = np.array([-np.sin(turn), np.cos(turn), 0.0]) * 0.16 * float(high[:2].min())
                rings = []
                for share in np.linspace(0.0, 1.0, 7):
                    middle = way * share + [0, 0, root + tall * up * float(np.sin(share * 0.62 * np.pi))]
                    wide = side * max(float(np.sin(np.pi * share**0.8)), 0.06)
                    lift = np.array([0, 0, 0.03 * float(high[:2].min())])
                    rings.append([middle - wide + lift, middle - 0.2 * lift, middle + wide + lift, middle + 0.6 * lift])
                draft.skin("leaves", np.array(rings))
                if self.flowers and whorl:
                    tip = way * 0.85 + [0, 0, root + tall * up * 0.95]
                    reach = 0.12 * float(high[:2].min())
                    ball = [
                        (float(np.cos(a)), (float(np.sin(a)) + 1) / 2) for a in np.linspace(-np.pi / 2, np.pi / 2, 7)
                    ]
                    low = np.maximum(tip - reach, draft.low)
                    draft.round("flowers", ball, low, np.minimum(low + 2 * reach, draft.high), around=12)


class Figure(Design, frozen=True, kw_only=True):
    """Somebody who stands: legs, a trunk, arms and a head; who it is looks to the front."""

    roles: ClassVar[Roles] = MappingProxyType(
        {"body": finishes.PICTURE, "legs": finishes.DARK_PLASTIC, "head": finishes.BAMBOO}
    )

    def _draw(self, draft: Draft) -> None:
        low, high, size = draft.low, draft.high, draft.size
        hips, neck = (float(low[2] + share * size[2]) for share in (0.48, 0.84))
        arm = 0.17 * float(size[1])
        for sign in (-1, 1):
            y = sorted((sign * 0.03 * size[1], sign * 0.27 * size[1]))
            draft.box("legs", [0.6 * low[0], y[0], low[2]], [0.6 * high[0], y[1], hips], rounding=0.05, soft=True)
            draft.box(
                "legs", [0.6 * low[0], y[0], low[2]], [high[0], y[1], low[2] + 0.05 * size[2]], rounding=0.03, soft=True
            )
            y = sorted((sign * high[1], sign * (high[1] - arm)))
            draft.box(
                "body",
                [0.5 * low[0], y[0], hips - 0.02 * size[2]],
                [0.5 * high[0], y[1], neck - 0.02 * size[2]],
                rounding=0.05,
                soft=True,
            )
        draft.box(
            "body",
            [low[0], low[1] + 0.95 * arm, hips - 0.03 * size[2]],
            [0.8 * high[0], high[1] - 0.95 * arm, neck],
            rounding=0.07,
            soft=True,
        )
        wide = min(0.07 * float(size[2]), 0.45 * float(size[0]), 0.3 * float(size[1]))
        ball = [(float(np.cos(a)), (float(np.sin(a)) + 1) / 2) for a in np.linspace(-np.pi / 2, np.pi / 2, 13)]
        draft.disc(
            "head",
            [-0.45 * wide, -0.45 * wide, neck - 0.02 * size[2]],
            [0.45 * wide, 0.45 * wide, neck + 0.04 * size[2]],
            along=Side.TOP,
        )
        draft.round("head", ball, [-wide, -wide, neck + 0.015 * size[2]], [wide, wide, high[2]])
        draft.touch_ball([-wide, -wide, neck + 0.015 * size[2]], [wide, wide, high[2]])
