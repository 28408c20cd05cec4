"""Making: one body's form, by what is known of its class, which way it stands and what is in it.

What fitting takes and gives.

Fitting: from what is known of classes to the forms of a world's bodies, each as it stands there.

Nothing is changed in the world. Meshes come first, where somebody has them; all else is built from shapes to the very
size that the map tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from msgspec.structs import replace

from mindstage.errors import InvalidShapeError, ShapeNotFoundError
from mindstage.geometry.fit_context import (
    Cavity,
    Neighborhood,
    SceneContext,
    cavity_of,
    shelf_heights,
    wall_openings,
    worktop_cutouts,
)
from mindstage.geometry.orientation import (
    CABINET_SHAPES,
    CLOSING_SHAPES,
    FRONTED_SHAPES,
    HANDLE_SHAPES,
    Orientation,
    OrientationSolver,
)
from mindstage.geometry.procedural import SHAPE_TEMPLATES
from mindstage.geometry.procedural.build import build_geometry, template_by_name
from mindstage.geometry.procedural.builder import BodySide, turn_between
from mindstage.knowledge.shape_rules import DEFAULT_ROLE, ShapeRule
from mindstage.scene import (
    AttachedLight,
    Body,
    BodyGeometry,
    BodyId,
    GeometryMap,
    GeometrySource,
    Iri,
    LightType,
    PbrMaterial,
    Pose,
    PrimitiveType,
    World,
)

__all__ = [
    "FitNote",
    "FittedGeometry",
    "GeometryFitter",
    "MeshGeometries",
    "MeshProvider",
    "ShapeRuleProvider",
    "fit_geometry",
]


class FitNote(NamedTuple):
    """Something that had to be decided, or could not be done as told."""

    ids: tuple[BodyId, ...]
    text: str


@dataclass(frozen=True, slots=True)
class FittedGeometry:
    """The forms of a world's bodies."""

    geometry: GeometryMap
    """Of all bodies that have a size."""
    notes: tuple[FitNote, ...] = ()


class ShapeRuleProvider(Protocol):
    """Who knows how things of a class are shaped; a `KnowledgeBase` does."""

    def shape_rule(self, cls: Iri, /) -> ShapeRule:
        """How things of a class are shaped."""


class MeshGeometries(Protocol):
    """What was found in mesh files."""

    @property
    def geometry(self) -> Mapping[BodyId, BodyGeometry]:
        """Of the bodies that have one."""

    @property
    def notes(self) -> Sequence[str]:
        """What had to be decided, and which files are of no use."""


class MeshProvider(Protocol):
    """Who finds the meshes that maps name."""

    def geometry_for(self, bodies: Sequence[Body], /) -> MeshGeometries:
        """The forms of those bodies for which there are mesh files."""


_DEFAULT_SHAPE = "box"
_DOOR_SHAPE = "door"
"""The role, in what has doors, of these."""
_SHAPE_OF_PRIMITIVE = {PrimitiveType.CYLINDER: "cylinder", PrimitiveType.SPHERE: "ball"}
_WORKTOP_INSERT_SHAPES = ("sink", "hob", "tub", "basket", "bin")
_WALL_INSERT_SHAPES = ("door", "window", "frame")
_ARCHITECTURE_SHAPES = ("wall", "shell", "panel", "picture", "lamp")
_NO_SIZE = (0.0, 0.0, 0.0)
_MIN_ROOM_M = 1.0
"""A wall that is so thick is the box around the walls of a room."""


class GeometryFitter:
    """Makes the forms of one setting."""

    def __init__(self, context: SceneContext, neighborhoods: Mapping[int, Neighborhood]) -> None:
        """Makes nothing yet."""
        self._context = context
        self._neighborhoods = neighborhoods
        self._is_worktop_insert = context.has_shape(*_WORKTOP_INSERT_SHAPES)
        self._is_wall_insert = context.has_shape(*_WALL_INSERT_SHAPES)
        self._is_room_insert = ~context.has_shape(*_ARCHITECTURE_SHAPES)

    def geometry(self, row: int, orientation: Orientation) -> tuple[BodyGeometry | None, str]:
        """The form of a body, and what could not be done as told, which is mostly nothing.

        None where its size leaves no room for anything.
        """
        body, rule = self._context.bodies[row], self._context.rules[row]
        kind = self._shape_name(row)
        told, doubt = _valid_parameters(kind, rule)
        fitted = self._fitted_parameters(row, kind, orientation, told)
        try:
            return self._build(body, rule, kind, {**told, **fitted}, orientation, self._closing_material(row)), doubt
        except ShapeNotFoundError as error:
            kind, doubt = _DEFAULT_SHAPE, str(error)
        except InvalidShapeError as error:
            doubt = str(error)
        try:
            return self._build(body, rule, kind, {}, orientation), doubt
        except InvalidShapeError as error:
            return None, str(error)

    def _shape_name(self, row: int) -> str:
        """What a body is built as: mostly what its class is, unless its parts or its size tell otherwise."""
        setting, kind = self._context, str(self._context.shape_names[row])
        shape = setting.bodies[row].shape
        if kind == _DEFAULT_SHAPE and shape is not None:
            return _SHAPE_OF_PRIMITIVE.get(shape.type, kind)
        if kind == "wall" and setting.boxes.half_extents[row].min() * 2 > _MIN_ROOM_M:
            return "shell"
        parts = setting.shape_names[setting.group_mates(row)] if kind in ("table", "chair") else ()
        if kind == "table" and "leg" in parts:
            return "counter"
        if kind == "chair" and "panel" in parts:
            return "table"
        return kind

    def _fitted_parameters(
        self, row: int, shape_name: str, orientation: Orientation, parameters: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Parameters that follow from what is in a thing and around it."""
        fields = SHAPE_TEMPLATES[shape_name].__struct_fields__ if shape_name in SHAPE_TEMPLATES else ()
        found: dict[str, Any] = {}
        if "along" in fields:
            found["along"] = _cylinder_axis(self._context, row, orientation)
        around = self._neighborhoods.get(row)
        if around is None:
            return found | ({"walls": _open_walls(orientation, {})} if "walls" in fields else {})
        if "free" in fields:
            found["free"] = self._cutouts(row, shape_name, around, orientation.up)
        inside = cavity_of(self._context, row, around)
        if "walls" in fields:
            usual = float(parameters.get("wall", SHAPE_TEMPLATES[shape_name]().wall))  # type: ignore[attr-defined]
            found["walls"] = _open_walls(orientation, {side: inside.wall_thickness(side, usual) for side in BodySide})
        found |= _level_parameters(inside, orientation.up, fields)
        if "shelves" in fields and len(inside.rows) and "levels" not in found and not inside.is_free.all():
            found["shelves"] = 0
        return found

    def _cutouts(self, row: int, shape_name: str, neighborhood: Neighborhood, up: BodySide) -> tuple[Any, ...]:
        if shape_name in ("wall", "shell"):
            # The box around the walls of a crooked room cuts through what stands in it: there the walls are not.
            chosen = self._is_wall_insert if shape_name == "wall" else self._is_room_insert
            return wall_openings(self._context, row, neighborhood, chosen, include_motion=shape_name == "shell")
        return worktop_cutouts(self._context, row, neighborhood, up, self._is_worktop_insert)

    def _closing_material(self, row: int) -> PbrMaterial | None:
        """What a door is made of because of what it closes: that of an oven is of glass."""
        if str(self._context.shape_names[row]) != "door":
            return None
        holders = (joint.holder_row for joint in self._context.joints.get(row, ()) if joint.moving_row == row)
        made = (self._context.rules[holder].materials.get(_DOOR_SHAPE) for holder in holders)
        return next((substance.pbr_material for substance in made if substance is not None), None)

    @staticmethod
    def _build(
        body: Body,
        rule: ShapeRule,
        shape_name: str,
        parameters: Mapping[str, Any],
        orientation: Orientation,
        body_material: PbrMaterial | None = None,
    ) -> BodyGeometry:
        surfaces = {role: substance.pbr_material for role, substance in rule.materials.items()}
        surfaces[DEFAULT_ROLE] = body_material or surfaces[DEFAULT_ROLE]
        return build_geometry(
            template_by_name(shape_name, parameters),
            body.size or _NO_SIZE,
            up=orientation.up,
            front=orientation.front,
            materials=surfaces | _map_colors(body, surfaces[DEFAULT_ROLE]),
            light=_attached_light(rule, orientation),
            friction=rule.default_material.friction,
            restitution=rule.default_material.restitution,
            density=rule.default_material.density,
            source=rule.source,
            reason="; ".join(
                part for part in (rule.reason, orientation.reason and f"its front is {orientation.reason}") if part
            ),
        )


def _valid_parameters(shape_name: str, rule: ShapeRule) -> tuple[dict[str, Any], str]:
    """Those of a rule's parameters that a kind has and that can be so, and what is wrong with another one."""
    if shape_name not in SHAPE_TEMPLATES:
        return {}, ""
    told: dict[str, Any] = {}
    doubt = ""
    for name, value in rule.parameters.items():
        if name in SHAPE_TEMPLATES[shape_name].__struct_fields__:
            try:
                template_by_name(shape_name, {name: value})
                told[name] = value
            except InvalidShapeError as error:
                doubt = str(error)
    return told, doubt


def _open_walls(orientation: Orientation, walls: Mapping[BodySide, float]) -> tuple[tuple[BodySide, float], ...]:
    """The thickness of walls on the sides of a case: none where it is open."""
    open_sides = orientation.openings or (orientation.front,)
    return tuple(sorted({**walls, **dict.fromkeys(open_sides, 0.0)}.items(), key=lambda wall: wall[0].value))


def _level_parameters(cavity: Cavity, up: BodySide, fields: tuple[str, ...]) -> dict[str, Any]:
    levels = shelf_heights(cavity, up)
    if not levels:
        return {}
    if "levels" in fields:
        return {"levels": levels}
    if "level" in fields:
        return {"level": levels[0]}
    found: dict[str, Any] = {}
    if "floor" in fields:
        found["floor"] = max(levels[0] + float(cavity.half[up.axis]), 0.0005)
    if "wall" in fields:
        found["wall"] = min(cavity.wall_thickness(side, 0.008) for side in BodySide if side.axis != up.axis)
    return found


def _cylinder_axis(context: SceneContext, row: int, orientation: Orientation) -> BodySide:
    """Along which axis of its drawing a cylinder lies: the one whose two others are most alike."""
    shape = context.bodies[row].shape
    if shape is not None and shape.type is PrimitiveType.CYLINDER:
        axis = 2
    else:
        size = context.boxes.half_extents[row]
        gaps = [abs(float(np.log(size[(each + 1) % 3] / size[(each + 2) % 3]))) for each in range(3)]
        gaps[orientation.up.axis] -= 1e-3  # of two alike it stands
        axis = int(np.argmin(gaps))
    if axis == orientation.up.axis:
        return BodySide.TOP
    return BodySide.FRONT if axis == orientation.front.axis else BodySide.LEFT


def _map_colors(body: Body, surface: PbrMaterial) -> dict[str, PbrMaterial]:
    """The color that a map gives to a body, before any that its class has."""
    color = next((material.color for material in body.materials if material.color is not None), None)
    return {} if color is None else {DEFAULT_ROLE: replace(surface, color=color)}


def _attached_light(rule: ShapeRule, orientation: Orientation) -> AttachedLight | None:
    light = rule.light
    if light is None:
        return None
    turned = light.light_type is not LightType.POINT and orientation.up is not BodySide.TOP
    pose = Pose(quaternion=turn_between(orientation.front, orientation.up).quaternion) if turned else Pose()
    return AttachedLight(type=light.light_type, pose=pose, color=light.color, intensity=light.intensity)


_NEIGHBORHOOD_SHAPES = (
    *CABINET_SHAPES,
    *CLOSING_SHAPES,
    *FRONTED_SHAPES,
    "tub",
    "basket",
    "bin",
    "bowl",
    "pot",
    "pan",
    "sink",
    "rack",
    "counter",
    "wall",
    "shell",
)
"""What is near them tells how they are open."""


def fit_geometry(world: World, knowledge: ShapeRuleProvider, *, meshes: MeshProvider | None = None) -> FittedGeometry:
    """The forms of all bodies of a world that have a size.

    Args:
        world: what is to be shown.
        knowledge: who knows how classes are shaped.
        meshes: who finds mesh files, which come before all else.
    """
    forms: dict[BodyId, BodyGeometry] = {}
    notes = _Notes()
    if meshes is not None:
        found = meshes.geometry_for(world.bodies)
        forms |= found.geometry
        notes.notes += [FitNote((), text) for text in found.notes]
    rules = {cls: knowledge.shape_rule(cls) for cls in dict.fromkeys(body.cls for body in world.bodies)}
    if world.bodies:
        _fit(SceneContext(world, rules), forms, notes)
    notes.add_class_notes(world, rules, forms)
    return FittedGeometry(
        MappingProxyType({body.id: forms[body.id] for body in world.bodies if body.id in forms}), notes.to_tuple()
    )


def _fit(context: SceneContext, geometry: dict[BodyId, BodyGeometry], notes: _Notes) -> None:
    """Adds the forms of all bodies that have none yet."""
    alone = np.ones(len(context.bodies), dtype=bool)
    alone[list(context.parents)] = False
    around, crowded = context.neighborhoods(
        context.has_shape(*_NEIGHBORHOOD_SHAPES) | (context.has_shape(*HANDLE_SHAPES) & alone)
    )
    faces, maker = OrientationSolver(context, around), GeometryFitter(context, around)
    for row, body in enumerate(context.bodies):
        if body.id in geometry or body.size is None:
            continue
        facing = faces.orientation_of(row)
        if min(body.size) <= 0.0:
            notes.add("has no extent along one of its axes, so it stays as the map has it", body.id)
            continue
        form, doubt = maker.geometry(row, facing)
        if doubt:
            notes.add(f"cannot be built as told: {doubt}", body.id)
        if form is not None:
            geometry[body.id] = form
            if facing.is_guess and form.shape_name != "box":
                notes.add(
                    f"is a {form.shape_name}, and nothing tells where its front is: it looks to the middle", body.id
                )
    for row in crowded:
        notes.add("stands in a crowd, so nobody looked at what is in it", context.bodies[row].id)


class _Notes:
    """Remarks, those of one text together."""

    def __init__(self) -> None:
        self.notes: list[FitNote] = []
        self._ids: dict[str, list[BodyId]] = {}

    def add(self, text: str, id: BodyId) -> None:
        self._ids.setdefault(text, []).append(id)

    def add_class_notes(self, world: World, rules: Mapping[Iri, ShapeRule], fitted_ids: Iterable[BodyId]) -> None:
        """What was guessed by names, and what was told that cannot be."""
        shown = set(fitted_ids)
        for body in world.bodies:
            rule = rules[body.cls]
            if body.id in shown and rule.source is GeometrySource.CLASS_NAME:
                self.add(f"is shaped as a {rule.shape_type} by a guess: {rule.reason}", body.id)
            for doubt in rule.issues:
                self.add(doubt, body.id)

    def to_tuple(self) -> tuple[FitNote, ...]:
        told = (FitNote(tuple(ids), f"{_join_ids(ids)}: {text}") for text, ids in self._ids.items())
        return (*self.notes, *told)


def _join_ids(ids: list[BodyId]) -> str:
    return ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")
