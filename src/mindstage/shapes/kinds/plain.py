"""Plain shapes: what has no parts."""

from __future__ import annotations

from types import MappingProxyType
from typing import Annotated, ClassVar

import msgspec
import numpy as np

from mindstage.shapes import finishes
from mindstage.shapes.design import Design, Length, Roles
from mindstage.shapes.draft import Draft
from mindstage.shapes.sides import Side

__all__ = ["Ball", "Box", "Cylinder", "Leg", "Panel"]


class Box(Design, frozen=True, kw_only=True):
    """A box with bevelled edges."""

    rounding: Length = 0.006
    """How much of its edges is taken off [m]."""

    def _draw(self, draft: Draft) -> None:
        draft.box("body", draft.low, draft.high, rounding=self.rounding)
        draft.place(draft.low, draft.high, float(draft.high[2]))


class Panel(Design, frozen=True, kw_only=True):
    """A board, upright or lying, with a groove round its middle where it has a frame."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.LACQUER, "frame": "body"})
    frame: Length = 0.0
    """How wide [m]; 0 is a plain board."""
    rounding: Length = 0.003

    def _draw(self, draft: Draft) -> None:
        thin = int(np.argmin(draft.size))
        across = [axis for axis in range(3) if axis != thin]
        frame = min(self.frame, 0.25 * float(draft.size[across].min())) if self.frame >= 1e-3 else 0.0
        draft.touch_box(draft.low, draft.high)
        draft.place(draft.low, draft.high, float(draft.high[2]))
        if frame <= 0.0:
            draft.box("body", draft.low, draft.high, rounding=self.rounding, solid=False)
            return
        groove = 0.15 * draft.size[thin]
        low, high = draft.low.copy(), draft.high.copy()
        low[thin], high[thin] = low[thin] + groove, high[thin] - groove
        low[across], high[across] = low[across] + frame / 2, high[across] - frame / 2
        draft.box("body", low, high, rounding=self.rounding, solid=False)
        for axis, other in (across, across[::-1]):
            for sign in (-1, 1):
                low, high = draft.low.copy(), draft.high.copy()
                if axis == across[0]:  # these stand between the other two
                    low[other], high[other] = low[other] + frame, high[other] - frame
                low[axis] = draft.high[axis] - frame if sign > 0 else low[axis]
                high[axis] = draft.low[axis] + frame if sign < 0 else high[axis]
                draft.box("frame", low, high, rounding=self.rounding, solid=False)


class Ball(Design, frozen=True, kw_only=True):
    """A ball, or an ellipsoid; a fruit where it has a stem."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.FOOD, "stem": finishes.SOIL})
    stem: bool = False

    def _draw(self, draft: Draft) -> None:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
        height = (np.sin(angle) + 1) / 2
        if self.stem:
            height -= np.where(angle > 1.0, 0.5 * (angle - 1.0) ** 2, 0.0)  # a dimple on top
        radius = np.cos(angle).round(15)
        draft.touch_ball(draft.low, draft.high)
        if not self.stem:
            draft.round("body", list(zip(radius, height, strict=True)), draft.low, draft.high)
            return
        top = float(draft.low[2] + 0.93 * draft.size[2])
        high = np.array([*draft.high[:2], top])
        draft.round("body", list(zip(radius, height / height.max(), strict=True)), draft.low, high)
        thick = 0.03 * draft.size[:2]
        draft.disc("stem", [*-thick, top - 0.12 * draft.size[2]], [*thick, draft.high[2]])


class Cylinder(Design, frozen=True, kw_only=True):
    """A cylinder along one axis of the drawing, upright unless told otherwise."""

    along: Side = Side.TOP
    """In the frame of the shape: +z is where its top is, +x its front."""

    def _draw(self, draft: Draft) -> None:
        draft.disc("body", draft.low, draft.high, along=self.along)
        draft.touch_round(draft.low, draft.high, along=self.along)
        if self.along.axis == 2:
            draft.place(0.7 * draft.low, 0.7 * draft.high, float(draft.high[2]))


class Leg(Design, frozen=True, kw_only=True):
    """A leg of a table: a post that tapers towards the ground."""

    roles: ClassVar[Roles] = MappingProxyType({"body": finishes.OAK})
    taper: Annotated[float, msgspec.Meta(ge=0.0, le=0.9)] = 0.3
    """How much thinner it is at the ground, as a share."""
    round: bool = False

    def _draw(self, draft: Draft) -> None:
        low, high = draft.low, draft.high
        foot = 1.0 - self.taper
        if self.round:
            draft.round("body", ((0, 0), (foot, 0), (1, 1), (0, 1)), low, high)
            draft.touch_round([*(low[:2] * foot), low[2]], [*(high[:2] * foot), high[2]])
            return
        shoulder = float(high[2] - min(0.15 * draft.size[2], 0.12))
        draft.box("body", [*low[:2], shoulder], high, rounding=0.003)
        draft.frustum(
            "body",
            ([*(low[:2] * foot), low[2]], [*(high[:2] * foot), low[2]]),
            ([*low[:2], shoulder], [*high[:2], shoulder]),
        )
