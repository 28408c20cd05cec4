"""Making: one body's form, by what is known of its class, which way it stands and what is in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace

from mindstage.errors import ShapeRefused, ShapeUnknown
from mindstage.knowledge.shaping import BODY, ShapeRule
from mindstage.shapes.building import build, design_of
from mindstage.shapes.fitting.facing import Facing
from mindstage.shapes.fitting.insides import Inside, inside_of, let_in, levels_in, openings_in
from mindstage.shapes.fitting.setting import Around, Setting
from mindstage.shapes.kinds import DESIGNS
from mindstage.shapes.sides import Side, turn_between
from mindstage.world import Body, Form, Glow, LightKind, Pose, ShapeKind, Surface

__all__ = ["Maker"]

_PLAIN = "box"
_DOOR = "door"
"""The role, in what has doors, of these."""
_OF_SHAPE = {ShapeKind.CYLINDER: "cylinder", ShapeKind.SPHERE: "ball"}
_LET_IN = ("sink", "hob", "tub", "basket", "bin")
_IN_WALLS = ("door", "window", "frame")
_BUILDING = ("wall", "shell", "panel", "picture", "lamp")
_NO_SIZE = (0.0, 0.0, 0.0)
_ROOM_M = 1.0
"""A wall that is so thick is the box around the walls of a room."""


class Maker:
    """Makes the forms of one setting."""

    def __init__(self, setting: Setting, around: Mapping[int, Around]) -> None:
        """Makes nothing yet."""
        self._setting = setting
        self._around = around
        self._let_in = setting.of_kind(*_LET_IN)
        self._in_walls = setting.of_kind(*_IN_WALLS)
        self._in_rooms = ~setting.of_kind(*_BUILDING)

    def form(self, row: int, facing: Facing) -> tuple[Form | None, str]:
        """The form of a body, and what could not be done as told, which is mostly nothing.

        None where its size leaves no room for anything.
        """
        body, rule = self._setting.bodies[row], self._setting.rules[row]
        kind = self._kind(row)
        told, doubt = _parameters(kind, rule)
        fitted = self._fitted(row, kind, facing, told)
        try:
            return self._built(body, rule, kind, {**told, **fitted}, facing, self._closing(row)), doubt
        except ShapeUnknown as error:
            kind, doubt = _PLAIN, str(error)
        except ShapeRefused as error:
            doubt = str(error)
        try:
            return self._built(body, rule, kind, {}, facing), doubt
        except ShapeRefused as error:
            return None, str(error)

    def _kind(self, row: int) -> str:
        """What a body is built as: mostly what its class is, unless its parts or its size tell otherwise."""
        setting, kind = self._setting, str(self._setting.kinds[row])
        shape = setting.bodies[row].shape
        if kind == _PLAIN and shape is not None:
            return _OF_SHAPE.get(shape.kind, kind)
        if kind == "wall" and setting.boxes.half[row].min() * 2 > _ROOM_M:
            return "shell"
        parts = setting.kinds[setting.together_with(row)] if kind in ("table", "chair") else ()
        if kind == "table" and "leg" in parts:
            return "counter"
        if kind == "chair" and "panel" in parts:
            return "table"
        return kind

    def _fitted(self, row: int, kind: str, facing: Facing, told: Mapping[str, Any]) -> dict[str, Any]:
        """Parameters that follow from what is in a thing and around it."""
        fields = DESIGNS[kind].__struct_fields__ if kind in DESIGNS else ()
        found: dict[str, Any] = {}
        if "along" in fields:
            found["along"] = _along(self._setting, row, facing)
        around = self._around.get(row)
        if around is None:
            return found | ({"walls": _open(facing, {})} if "walls" in fields else {})
        if "free" in fields:
            found["free"] = self._free(row, kind, around, facing.up)
        inside = inside_of(self._setting, row, around)
        if "walls" in fields:
            usual = float(told.get("wall", DESIGNS[kind]().wall))  # type: ignore[attr-defined]
            found["walls"] = _open(facing, {side: inside.wall(side, usual) for side in Side})
        found |= _levels(inside, facing.up, fields)
        if "shelves" in fields and len(inside.rows) and "levels" not in found and not inside.loose.all():
            found["shelves"] = 0
        return found

    def _free(self, row: int, kind: str, around: Around, up: Side) -> tuple[Any, ...]:
        if kind in ("wall", "shell"):
            # The box around the walls of a crooked room cuts through what stands in it: there the walls are not.
            chosen = self._in_walls if kind == "wall" else self._in_rooms
            return openings_in(self._setting, row, around, chosen, ways=kind == "shell")
        return let_in(self._setting, row, around, up, self._let_in)

    def _closing(self, row: int) -> Surface | None:
        """What a door is made of because of what it closes: that of an oven is of glass."""
        if str(self._setting.kinds[row]) != "door":
            return None
        holders = (joint.holder for joint in self._setting.joints.get(row, ()) if joint.moving == row)
        made = (self._setting.rules[holder].substances.get(_DOOR) for holder in holders)
        return next((substance.surface for substance in made if substance is not None), None)

    @staticmethod
    def _built(
        body: Body,
        rule: ShapeRule,
        kind: str,
        parameters: Mapping[str, Any],
        facing: Facing,
        made_of: Surface | None = None,
    ) -> Form:
        surfaces = {role: substance.surface for role, substance in rule.substances.items()}
        surfaces[BODY] = made_of or surfaces[BODY]
        return build(
            design_of(kind, parameters),
            body.size or _NO_SIZE,
            up=facing.up,
            front=facing.front,
            surfaces=surfaces | _painted(body, surfaces[BODY]),
            glow=_glow(rule, facing),
            friction=rule.substance.friction,
            restitution=rule.substance.restitution,
            density=rule.substance.density,
            source=rule.source,
            why="; ".join(part for part in (rule.why, facing.why and f"its front is {facing.why}") if part),
        )


def _parameters(kind: str, rule: ShapeRule) -> tuple[dict[str, Any], str]:
    """Those of a rule's parameters that a kind has and that can be so, and what is wrong with another one."""
    if kind not in DESIGNS:
        return {}, ""
    told: dict[str, Any] = {}
    doubt = ""
    for name, value in rule.parameters.items():
        if name in DESIGNS[kind].__struct_fields__:
            try:
                design_of(kind, {name: value})
                told[name] = value
            except ShapeRefused as error:
                doubt = str(error)
    return told, doubt


def _open(facing: Facing, walls: Mapping[Side, float]) -> tuple[tuple[Side, float], ...]:
    """The thickness of walls on the sides of a case: none where it is open."""
    open_sides = facing.openings or (facing.front,)
    return tuple(sorted({**walls, **dict.fromkeys(open_sides, 0.0)}.items(), key=lambda wall: wall[0].value))


def _levels(inside: Inside, up: Side, fields: tuple[str, ...]) -> dict[str, Any]:
    levels = levels_in(inside, up)
    if not levels:
        return {}
    if "levels" in fields:
        return {"levels": levels}
    if "level" in fields:
        return {"level": levels[0]}
    found: dict[str, Any] = {}
    if "floor" in fields:
        found["floor"] = max(levels[0] + float(inside.half[up.axis]), 0.0005)
    if "wall" in fields:
        found["wall"] = min(inside.wall(side, 0.008) for side in Side if side.axis != up.axis)
    return found


def _along(setting: Setting, row: int, facing: Facing) -> Side:
    """Along which axis of its drawing a cylinder lies: the one whose two others are most alike."""
    shape = setting.bodies[row].shape
    if shape is not None and shape.kind is ShapeKind.CYLINDER:
        axis = 2
    else:
        size = setting.boxes.half[row]
        gaps = [abs(float(np.log(size[(each + 1) % 3] / size[(each + 2) % 3]))) for each in range(3)]
        gaps[facing.up.axis] -= 1e-3  # of two alike it stands
        axis = int(np.argmin(gaps))
    if axis == facing.up.axis:
        return Side.TOP
    return Side.FRONT if axis == facing.front.axis else Side.LEFT


def _painted(body: Body, surface: Surface) -> dict[str, Surface]:
    """The colour that a map gives to a body, before any that its class has."""
    colour = next((material.colour for material in body.materials if material.colour is not None), None)
    return {} if colour is None else {BODY: replace(surface, colour=colour)}


def _glow(rule: ShapeRule, facing: Facing) -> Glow | None:
    light = rule.light
    if light is None:
        return None
    turned = light.kind is not LightKind.POINT and facing.up is not Side.TOP
    pose = Pose(quaternion=turn_between(facing.front, facing.up).quaternion) if turned else Pose()
    return Glow(kind=light.kind, pose=pose, colour=light.colour, intensity=light.intensity)
