"""Racks: what is made of wire."""

from __future__ import annotations

from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import Design, Roles, Thickness
from mindstage.shapes.draft import Draft
from mindstage.shapes.kinds.containers import floor_thickness

__all__ = ["Rack"]


class Rack(Design, frozen=True, kw_only=True):
    """A rack of wires: a grid where it is flat, else a basket."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.CHROME})
    wire: Thickness = 0.005
    """How thick [m]."""
    mesh: Thickness = 0.045
    """From wire to wire [m]."""
    tines: bool = False
    """Whether rows of pins hold plates upright in it."""
    level: float | None = None
    """Where things stand in it, upwards from the middle [m]; else on its floor."""

    def _draw(self, draft: Draft) -> None:
        low, high, size = draft.low, draft.high, draft.size
        wire = min(self.wire, 0.08 * draft.least if size[2] > 0.03 else draft.least)
        flat = size[2] < max(0.03, 0.08 * float(size[:2].min()))
        top = float(high[2]) if flat else float(low[2]) + floor_thickness(draft, wire, self.level)
        self._grid(draft, wire, float(low[2]) if flat else max(top - wire, float(low[2])), top)
        if flat:
            draft.touch_box(low, high)
            draft.place(low, high, top)
            return
        draft.touch_box([*low[:2], max(top - 2 * wire, float(low[2]))], [*high[:2], top])
        draft.place(low[:2] + wire, high[:2] - wire, top, height=float(high[2]) - top, inside=True)
        for axis in (0, 1):
            for sign in (-1, 1):
                self._fence(draft, axis, sign, wire)
        if self.tines:
            self._pins(draft, wire, top)

    def _grid(self, draft: Draft, wire: float, bottom: float, top: float) -> None:
        thick = min(wire, top - bottom)
        for axis in (0, 1):
            start, end = draft.low[axis] + wire / 2, draft.high[axis] - wire / 2
            count = int(np.clip((end - start) / max(self.mesh, 1e-3), 1, 14))
            for spot in np.linspace(start, end, count + 1):
                edge = spot in (start, end)
                low, high = np.array([*draft.low[:2], bottom]), np.array([*draft.high[:2], top])
                low[axis], high[axis] = spot - wire / 2, spot + wire / 2
                if not edge:
                    high[2] = bottom + thick * (0.9 - 0.3 * axis)
                draft.box("body", low, high, rounding=0.35 * wire, solid=False)

    def _fence(self, draft: Draft, axis: int, sign: int, wire: float) -> None:
        """One side: a rail on top, one half way up, and uprights."""
        low, high = draft.low.copy(), draft.high.copy()
        low[axis], high[axis] = sorted((sign * draft.high[axis], sign * (draft.high[axis] - wire)))
        draft.touch_box(low, high)
        for level in (float(high[2]), float(low[2] + 0.55 * draft.size[2]), float(low[2]) + wire):
            draft.box("body", [*low[:2], level - wire], [*high[:2], level], rounding=0.35 * wire, solid=False)
        other = 1 - axis
        count = int(np.clip(draft.size[other] / max(1.5 * self.mesh, 1e-3), 1, 12))
        for spot in np.linspace(draft.low[other] + wire / 2, draft.high[other] - wire / 2, count + 1):
            start, end = low.copy(), high.copy()
            start[other], end[other] = spot - 0.4 * wire, spot + 0.4 * wire
            draft.box("body", start, end, rounding=0.3 * wire, solid=False)

    def _pins(self, draft: Draft, wire: float, floor: float) -> None:
        top = floor + 0.6 * float(draft.high[2] - floor)
        for x in np.linspace(0.6 * draft.low[0], 0.6 * draft.high[0], 8):
            for y in (0.5 * draft.low[1], 0.15 * draft.low[1], 0.15 * draft.high[1], 0.5 * draft.high[1]):
                spot = np.array([x, y])
                draft.box("body", [*(spot - 0.4 * wire), floor - wire / 2], [*(spot + 0.4 * wire), top], solid=False)
