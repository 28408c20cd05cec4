"""Containers: boxes, baskets and basins that are open to the top."""

from __future__ import annotations

from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import Count, Design, Roles, Thickness
from mindstage.shapes.draft import Draft

__all__ = ["Basket", "Bin", "Sink", "Tub", "floor_thickness"]


def floor_thickness(draft: Draft, usual: float, level: float | None) -> float:
    """How thick a floor is whose top is at a level, if it can be."""
    if level is None or not draft.low[2] + 1e-4 <= level < draft.high[2]:
        return usual
    return level - float(draft.low[2])


def _walled(draft: Draft, role: str, wall: float, floor: float, level: float | None) -> None:
    """Four walls and a floor, and the place in them."""
    low, high = draft.low, draft.high
    wall = min(wall, 0.15 * float(draft.size[:2].min()))
    floor = floor_thickness(draft, min(floor, 0.25 * float(draft.size[2])), level)
    level = low[2] + floor
    draft.box(role, [*(low[:2] + wall), low[2]], [*(high[:2] - wall), level], rounding=0.0, solid=False)
    draft.touch_box(low, [*high[:2], level])  # it stands on its floor alone: walls beside it would only add contacts
    for sign in (-1, 1):
        edge = sorted((sign * high[0], sign * (high[0] - wall)))
        draft.box(role, [edge[0], low[1], low[2]], [edge[1], high[1], high[2]], rounding=0.003, solid=False)
        draft.touch_box([edge[0], low[1], level], [edge[1], high[1], high[2]])
        edge = sorted((sign * high[1], sign * (high[1] - wall)))
        start, end = [low[0] + wall, edge[0]], [high[0] - wall, edge[1]]
        draft.box(role, [*start, low[2]], [*end, high[2]], rounding=0.003, solid=False)
        draft.touch_box([*start, level], [*end, high[2]])
    inside = float(draft.size[2]) - floor
    draft.place(low[:2] + wall, high[:2] - wall, float(low[2]) + floor, height=inside, inside=True)


class Tub(Design, frozen=True, kw_only=True):
    """A box that is open to the top: a crate, a tray, a box for storage."""

    wall: Thickness = 0.008
    floor: Thickness = 0.008
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""

    def _draw(self, draft: Draft) -> None:
        _walled(draft, "body", self.wall, self.floor, self.level)


class Basket(Design, frozen=True, kw_only=True):
    """A woven basket, open to the top."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.WICKER, "rim": "body"})
    wall: Thickness = 0.012
    band: Thickness = 0.025
    """How high a woven band is [m]."""
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""

    def _draw(self, draft: Draft) -> None:
        low, high, size = draft.low, draft.high, draft.size
        wall = min(self.wall, 0.15 * float(size[:2].min()))
        floor = floor_thickness(draft, min(0.01, 0.25 * float(size[2])), self.level)
        inner = Draft((float(size[0]), float(size[1]), float(size[2])), draft.turn)
        _walled(inner, "body", wall, floor, None if self.level is None else float(low[2]) + floor)
        draft.touchables += inner.touchables
        draft.spots += inner.spots
        draft.box("body", [*(low[:2] + wall / 2), low[2]], [*(high[:2] - wall / 2), low[2] + floor], solid=False)
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
                        draft.box("rim" if rim else "body", start, end, rounding=0.35 * (top - bottom), solid=False)


class Sink(Design, frozen=True, kw_only=True):
    """A sink to be let into a worktop: a rim, one basin or two, perhaps a side to drain dishes on."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.STEEL, "inside": "body", "drain": finishes.IRON})
    basins: Count = 1
    drainer: bool = False
    """To the left of the basins."""
    rim: Thickness = 0.04
    wall: Thickness = 0.004
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""

    def _draw(self, draft: Draft) -> None:
        low, high, size = draft.low, draft.high, draft.size
        count = min(max(self.basins, 1), 3)
        rim, wall = min(self.rim, 0.12 * float(size[:2].min())), min(self.wall, 0.02 * draft.least)
        lip = min(0.012, 0.2 * float(size[2]))
        left = float(high[1] - (0.42 * size[1] if self.drainer else rim))
        pitch = (left - float(low[1]) - rim) / count
        spans = [
            (float(low[1]) + rim + pitch * n, float(low[1]) + rim + pitch * (n + 1) - rim * (n < count - 1))
            for n in range(count)
        ]
        back = float(low[0]) + min(1.6 * rim, 0.25 * float(size[0]))  # where the tap stands
        front = float(high[0]) - rim
        x_cuts = np.array([low[0], back, front, high[0]])
        y_cuts = np.array([low[1], *(edge for span in spans for edge in span), high[1]])
        kept = np.ones((3, len(y_cuts) - 1), dtype=bool)
        kept[1, 1::2] = False
        draft.sheet("body", (x_cuts, y_cuts), kept, (float(high[2]) - lip, float(high[2])), down_to=float(low[2]))
        for y0, y1 in spans:
            self._basin(draft, (back, y0), (front, y1), wall, lip)
        if self.drainer:
            for spot in np.linspace(left + 0.2 * rim + wall, float(high[1]) - rim, 8):
                draft.box(
                    "body",
                    [back, spot - 0.004, high[2] - lip],
                    [front, spot + 0.004, high[2]],
                    rounding=0.002,
                    solid=False,
                )

    def _basin(
        self, draft: Draft, start: tuple[float, float], end: tuple[float, float], wall: float, lip: float
    ) -> None:
        (x0, y0), (x1, y1) = start, end
        bottom, top = float(draft.low[2]), float(draft.high[2]) - 0.3 * lip
        floor = bottom + floor_thickness(draft, min(3 * wall, 0.1 * float(draft.size[2])), self.level)
        draft.box("inside", [x0, y0, bottom], [x1, y1, floor], rounding=0.0)
        for low, high in (
            ((x0 - wall, y0 - wall), (x0, y1 + wall)),
            ((x1, y0 - wall), (x1 + wall, y1 + wall)),
            ((x0, y0 - wall), (x1, y0)),
            ((x0, y1), (x1, y1 + wall)),
        ):
            draft.box("inside", [*low, bottom], [*high, top], rounding=0.0, solid=False)
        drain = min(0.045, 0.15 * (x1 - x0), 0.15 * (y1 - y0))
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        draft.disc("drain", [*(middle - drain), bottom], [*(middle + drain), floor + min(0.003, wall)])
        draft.place(start, end, floor, height=float(draft.high[2]) - floor, inside=True)


class Bin(Design, frozen=True, kw_only=True):
    """A bin: round or square, with a lid or open."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.STEEL, "lid": finishes.DARK_PLASTIC, "inside": "body"})
    round: bool = True
    lid: bool = True
    wall: Thickness = 0.006
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""

    def _draw(self, draft: Draft) -> None:
        low, high, size = draft.low, draft.high, draft.size
        if not self.lid:
            self._open(draft)
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
                draft.round(role, profile, start, end)
            else:
                draft.box(role, start, end, rounding=0.02, solid=False)
        draft.box(
            "lid", [*(low[:2] * 0.9), seam - 0.01 * size[2]], [*(high[:2] * 0.9), seam + 0.01 * size[2]], solid=False
        ) if not self.round else draft.disc(
            "lid", [*(low[:2] * 0.9), seam - 0.01 * size[2]], [*(high[:2] * 0.9), seam + 0.01 * size[2]]
        )
        if self.round:
            draft.touch_round(low, high)
        else:
            draft.touch_box(low, high)

    def _open(self, draft: Draft) -> None:
        low, high = draft.low, draft.high
        if not self.round:
            _walled(draft, "body", self.wall, self.wall, self.level)
            return
        share = 1.0 - min(self.wall, 0.1 * float(draft.size[:2].min())) / float(draft.size[:2].min()) * 2
        floor = floor_thickness(draft, min(self.wall, 0.2 * float(draft.size[2])), self.level)
        rise = floor / float(draft.size[2])
        draft.round("body", ((0, 0), (0.85, 0), (1, 1), (share, 1), (0.85 * share, rise), (0, rise)), low, high)
        draft.touch_round([*(low[:2] * 0.85), low[2]], [*(high[:2] * 0.85), low[2] + floor])
        draft.touch_ring([*low[:2], low[2]], high, outer=(0.85, 1.0), inner=(0.85 * share, share))
        reach = 0.6 * share
        draft.place(low * reach, high * reach, float(low[2]) + floor, height=float(draft.size[2]) - floor, inside=True)
