"""Primitives: boxes, panels, spheres, cylinders and table legs."""

from __future__ import annotations

from types import MappingProxyType
from typing import Annotated, ClassVar

import msgspec
import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import BodySide, GeometryBuilder, Length, MaterialRoles, ShapeTemplate

__all__ = ["BoxShape", "Cylinder", "Panel", "Sphere", "TableLeg"]


class BoxShape(ShapeTemplate, frozen=True, kw_only=True):
    """A box with beveled edges."""

    name = "box"
    rounding: Length = 0.006
    """Bevel of the edges [m]."""

    def _build(self, builder: GeometryBuilder) -> None:
        builder.add_box("body", builder.low, builder.high, rounding=self.rounding)
        builder.add_support_surface(builder.low, builder.high, float(builder.high[2]))


class Panel(ShapeTemplate, frozen=True, kw_only=True):
    """A board in any orientation, optionally with a raised frame."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.LACQUER, "frame": "body"})
    frame: Length = 0.0
    """Width of the frame [m]; 0 is a plain board."""
    rounding: Length = 0.003

    def _build(self, builder: GeometryBuilder) -> None:
        thin = int(np.argmin(builder.size))
        across = [axis for axis in range(3) if axis != thin]
        frame = min(self.frame, 0.25 * float(builder.size[across].min())) if self.frame >= 1e-3 else 0.0
        builder.add_collision_box(builder.low, builder.high)
        builder.add_support_surface(builder.low, builder.high, float(builder.high[2]))
        if frame <= 0.0:
            builder.add_box("body", builder.low, builder.high, rounding=self.rounding, collides=False)
            return
        groove = 0.15 * builder.size[thin]
        low, high = builder.low.copy(), builder.high.copy()
        low[thin], high[thin] = low[thin] + groove, high[thin] - groove
        low[across], high[across] = low[across] + frame / 2, high[across] - frame / 2
        builder.add_box("body", low, high, rounding=self.rounding, collides=False)
        for axis, other in (across, across[::-1]):
            for sign in (-1, 1):
                low, high = builder.low.copy(), builder.high.copy()
                if axis == across[0]:  # these are between the other two
                    low[other], high[other] = low[other] + frame, high[other] - frame
                low[axis] = builder.high[axis] - frame if sign > 0 else low[axis]
                high[axis] = builder.low[axis] + frame if sign < 0 else high[axis]
                builder.add_box("frame", low, high, rounding=self.rounding, collides=False)


class Sphere(ShapeTemplate, frozen=True, kw_only=True):
    """A sphere or an ellipsoid; with a stem, a fruit."""

    name = "ball"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.FOOD, "stem": finishes.SOIL})
    stem: bool = False

    def _build(self, builder: GeometryBuilder) -> None:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
        height = (np.sin(angle) + 1) / 2
        if self.stem:
            height -= np.where(angle > 1.0, 0.5 * (angle - 1.0) ** 2, 0.0)  # a dimple on top
        radius = np.cos(angle).round(15)
        builder.add_collision_sphere(builder.low, builder.high)
        if not self.stem:
            builder.add_lathe("body", list(zip(radius, height, strict=True)), builder.low, builder.high)
            return
        top = float(builder.low[2] + 0.93 * builder.size[2])
        high = np.array([*builder.high[:2], top])
        builder.add_lathe("body", list(zip(radius, height / height.max(), strict=True)), builder.low, high)
        thick = 0.03 * builder.size[:2]
        builder.add_cylinder("stem", [*-thick, top - 0.12 * builder.size[2]], [*thick, builder.high[2]])


class Cylinder(ShapeTemplate, frozen=True, kw_only=True):
    """A cylinder along an axis of the template frame, by default upright."""

    along: BodySide = BodySide.TOP
    """Direction of the axis in the template frame: +z is the top, +x the front."""

    def _build(self, builder: GeometryBuilder) -> None:
        builder.add_cylinder("body", builder.low, builder.high, along=self.along)
        builder.add_collision_cylinder(builder.low, builder.high, along=self.along)
        if self.along.axis == 2:
            builder.add_support_surface(0.7 * builder.low, 0.7 * builder.high, float(builder.high[2]))


class TableLeg(ShapeTemplate, frozen=True, kw_only=True):
    """A table leg: a post that tapers towards the ground."""

    name = "leg"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.OAK})
    taper: Annotated[float, msgspec.Meta(ge=0.0, le=0.9)] = 0.3
    """Reduction of the width at the ground, as a fraction."""
    round: bool = False

    def _build(self, builder: GeometryBuilder) -> None:
        low, high = builder.low, builder.high
        foot = 1.0 - self.taper
        if self.round:
            builder.add_lathe("body", ((0, 0), (foot, 0), (1, 1), (0, 1)), low, high)
            builder.add_collision_cylinder([*(low[:2] * foot), low[2]], [*(high[:2] * foot), high[2]])
            return
        shoulder = float(high[2] - min(0.15 * builder.size[2], 0.12))
        builder.add_box("body", [*low[:2], shoulder], high, rounding=0.003)
        builder.add_frustum(
            "body",
            ([*(low[:2] * foot), low[2]], [*(high[:2] * foot), low[2]]),
            ([*low[:2], shoulder], [*high[:2], shoulder]),
        )
