"""Hardware: handles, knobs, levers, taps and hobs."""

from __future__ import annotations

from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.builder import (
    BodySide,
    Count,
    GeometryBuilder,
    MaterialRoles,
    ShapeTemplate,
    Thickness,
)
from mindstage.scene.transforms import Array

__all__ = ["DoorLever", "Handle", "Hob", "Knob", "Tap"]


class Handle(ShapeTemplate, frozen=True, kw_only=True):
    """A bar on standoffs; its back is at the door."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.STEEL, "standoff": "body"})
    standoffs: Count = 2
    bar: Thickness = 0.014
    """Thickness of the bar from front to back [m], at most half of the depth."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        axis = 1 if size[1] >= size[2] else 2
        bar = min(self.bar, 0.5 * float(size[0]))
        behind = float(high[0]) - bar
        builder.add_cylinder("body", [behind, *low[1:]], high, along=BodySide.from_axis(axis, 1), bevel=0.25 * bar)
        builder.add_collision_box([behind, *low[1:]], high)
        count = max(self.standoffs, 1)
        across = 3 - axis
        post = min(0.8 * bar, 0.8 * float(size[across]), 0.2 * float(size[axis])) / 2
        spots = np.linspace(-0.5, 0.5, count) * 0.78 * size[axis] if count > 1 else [0.0]
        for spot in spots:
            start, end = np.array([low[0], -post, -post]), np.array([behind + 0.5 * bar, post, post])
            start[axis], end[axis] = spot - post, spot + post
            builder.add_cylinder("standoff", start, end, along=BodySide.FRONT, bevel=0.2 * post)
            end[0] = behind
            builder.add_collision_box(start, end)


class Knob(ShapeTemplate, frozen=True, kw_only=True):
    """A knob for turning or pulling; its back is at the door."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.IRON, "mark": finishes.CREAM})
    mark: bool = True
    """Whether a line marks its position."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        profile = ((0, 0), (0.92, 0), (1, 0.06), (1, 0.16), (0.72, 0.26), (0.86, 0.6), (0.86, 0.9), (0, 0.9))
        face = float(high[0] - 0.04 * size[0]) if self.mark else float(high[0])
        builder.add_lathe(
            "body", (*profile[:-2], (0.84, 1), (0, 1)), low, [face, *high[1:]], along=BodySide.FRONT, bevel=0.002
        )
        builder.add_collision_cylinder(low, high, along=BodySide.FRONT)
        if self.mark:
            wide = 0.06 * float(size[1:].min())
            builder.add_box(
                "mark",
                [face - 0.02 * size[0], -wide, 0.1 * size[2]],
                [high[0], wide, 0.36 * size[2]],
                rounding=0.001,
                collides=False,
            )


class DoorLever(ShapeTemplate, frozen=True, kw_only=True):
    """A door lever on a rosette; its back is at the door."""

    name = "lever"
    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.STEEL})
    towards: BodySide = BodySide.LEFT
    """Direction of the lever from its rosette, in the template frame: +y, -y, +z or -z."""

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        axis = self.towards.axis or (1 if size[1] >= size[2] else 2)
        other = 3 - axis
        wide = float(min(size[other], 0.5 * size[axis]))
        hub = self.towards.sign * -0.5 * (float(size[axis]) - wide)
        rosette = float(low[0] + 0.18 * size[0])
        start, end = np.array([low[0], *low[1:]]), np.array([rosette, *high[1:]])
        start[axis], end[axis] = hub - wide / 2, hub + wide / 2
        builder.add_cylinder("body", start, end, along=BodySide.FRONT, bevel=0.002)
        builder.add_collision_box(start, end)
        grip = min(0.4 * float(size[0]), wide) / 2
        bend, tip = np.zeros(3), np.zeros(3)
        bend[axis], tip[axis] = hub, self.towards.sign * (0.5 * float(size[axis]) - 0.3 * grip)
        bend[0] = tip[0] = float(high[0]) - grip
        root = bend.copy()
        root[0] = rosette - 0.3 * grip
        corner = bend.copy()
        corner[0] -= 0.6 * grip
        after = bend.copy()
        after[axis] += 0.6 * grip * self.towards.sign
        builder.add_tube("body", [root, corner, after, tip], grip)
        start, end = bend - grip, bend + grip
        start[axis], end[axis] = sorted(
            (hub - self.towards.sign * grip, float(tip[axis] + self.towards.sign * 0.3 * grip))
        )
        builder.add_collision_box(start, end)


class Tap(ShapeTemplate, frozen=True, kw_only=True):
    """A tap: upright with an arch to the front, or mounted on the wall at its back if it is low."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.CHROME, "lever": "body"})
    lever: bool = True

    def _build(self, builder: GeometryBuilder) -> None:
        if builder.size[2] < 0.6 * builder.size[0]:
            self._build_wall_mounted(builder)
        else:
            self._build_standing(builder)

    def _build_standing(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        pipe = 0.09 * float(min(size[0], 0.6 * size[2], 2.2 * size[1]))
        foot = 1.9 * pipe
        x = float(low[0]) + foot
        out = float(high[0]) - 1.15 * pipe
        bow = min((out - x) / 2, 0.4 * float(size[2]))
        top = float(high[2]) - pipe - bow
        angle = np.linspace(np.pi, 0.0, 13)
        arch = [(x + (out - x) / 2 * (1 + float(np.cos(a))), 0.0, top + bow * float(np.sin(a))) for a in angle]
        mouth = max(top - 0.25 * bow, float(low[2]) + 2 * pipe)
        builder.add_tube("body", [(x, 0, low[2]), *arch, (out, 0, mouth)], pipe)
        builder.add_cylinder(
            "body",
            [out - 1.15 * pipe, -1.15 * pipe, mouth - pipe],
            [out + 1.15 * pipe, 1.15 * pipe, mouth + 0.5 * pipe],
        )
        base = float(low[2] + 0.16 * size[2])
        builder.add_lathe(
            "body",
            ((0, 0), (1, 0), (1, 0.1), (0.7, 0.2), (0.7, 0.9), (0.5, 1), (0, 1)),
            [x - foot, -foot, low[2]],
            [x + foot, foot, base],
        )
        builder.add_collision_box([x - foot, -foot, low[2]], [x + foot, foot, base])
        builder.add_collision_box([x - pipe, -pipe, base], [x + pipe, pipe, top])
        builder.add_collision_box([x - pipe, -pipe, top], [out + pipe, pipe, high[2]])
        builder.add_collision_box([out - pipe, -pipe, mouth - pipe], [out + pipe, pipe, top])
        side = float(high[1])
        if self.lever:
            knob = 0.7 * (base - float(low[2])) + float(low[2])
            builder.add_tube(
                "lever",
                [(x, 0, knob), (x, 0.75 * side, knob), (x + 0.6 * foot, side - 0.5 * pipe, knob + 2 * pipe)],
                0.5 * pipe,
            )
        builder.add_cylinder(
            "body",
            [x - 1.2 * foot if foot < side else x - foot, -side, low[2]],
            [x + foot, side, low[2] + 0.25 * pipe],
            bevel=0.001,
        )

    def _build_wall_mounted(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        flange = 0.12 * float(size[0])
        profile = ((0, 0), (1, 0), (1, 0.3), (0.55, 1), (0, 1))
        builder.add_lathe("body", profile, low, [low[0] + flange, *high[1:]], along=BodySide.FRONT, bevel=0.002)
        pipe = 0.26 * float(size[1:].min())
        z = float(high[2]) - 1.1 * pipe
        out = float(high[0]) - 1.2 * pipe
        mouth = float(low[2]) + 0.5 * pipe
        path = [
            (low[0] + 0.3 * flange, 0, 0.4 * z),
            (low[0] + 2 * flange, 0, z),
            (out - 1.5 * pipe, 0, z),
            (out - 0.4 * pipe, 0, z - 0.4 * pipe),
            (out, 0, z - 1.5 * pipe),
            (out, 0, mouth),
        ]
        builder.add_tube("body", path, pipe)
        builder.add_cylinder(
            "body", [out - 1.2 * pipe, -1.2 * pipe, low[2]], [out + 1.2 * pipe, 1.2 * pipe, mouth + pipe], bevel=0.002
        )
        builder.add_collision_box(low, [low[0] + flange, *high[1:]])
        builder.add_collision_box([low[0] + flange, -pipe, z - pipe], [out + pipe, pipe, min(z + pipe, high[2])])
        builder.add_collision_box([out - pipe, -pipe, low[2]], [out + pipe, pipe, z - pipe])


class Hob(ShapeTemplate, frozen=True, kw_only=True):
    """A hob: a plate with cooking zones, and controls at the front."""

    roles: ClassVar[MaterialRoles] = MappingProxyType(
        {"body": finishes.BLACK_GLASS, "plates": finishes.IRON, "controls": finishes.STEEL}
    )
    plates: Count = 4
    controls: bool = True

    def _build(self, builder: GeometryBuilder) -> None:
        low, high, size = builder.low, builder.high, builder.size
        raised = min(0.0015, 0.3 * float(size[2]))
        top = float(high[2]) - raised
        builder.add_box("body", low, [*high[:2], top], rounding=0.003, collides=False)
        builder.add_collision_box(low, high)
        strip = 0.14 * float(size[0]) if self.controls else 0.0
        count = max(self.plates, 1)
        rows = 1 if count < 3 else 2
        columns = -(-count // rows)
        field = np.array([(size[0] - strip) / rows, size[1] / columns])
        for number in range(count):
            row, column = divmod(number, columns)
            middle = np.array([float(low[0]) + field[0] * (row + 0.5), float(low[1]) + field[1] * (column + 0.5)])
            if rows == 2 and row and count % 2:
                middle[1] += field[1] / 2
            reach = float(field.min()) * (0.42 if (row + column) % 2 else 0.34)
            self._add_ring(builder, middle - reach, middle + reach, (top, float(high[2])))
            builder.add_support_surface(middle - 0.7 * reach, middle + 0.7 * reach, float(high[2]))
        if self.controls:
            for spot in np.linspace(-0.25, 0.25, count) * size[1] if count > 1 else [0.0]:
                reach = 0.2 * strip
                middle = np.array([float(high[0]) - 0.5 * strip, spot])
                builder.add_cylinder(
                    "controls", [*(middle - reach), top - raised], [*(middle + reach), high[2]], segments=16
                )

    @staticmethod
    def _add_ring(builder: GeometryBuilder, low: Array, high: Array, heights: tuple[float, float]) -> None:
        bottom, top = heights
        middle = bottom + 0.5 * (top - bottom)
        builder.add_cylinder("plates", [*low, bottom - (top - bottom)], [*high, middle])
        ring = ((0.93, 0), (1, 0), (1, 1), (0.93, 1))
        builder.add_lathe("controls", ring, [*low, bottom - (top - bottom)], [*high, top], bevel=0.0005, closed=True)
