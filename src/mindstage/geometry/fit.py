"""Fits geometry to the bodies of a world: mesh files where they exist, otherwise shape templates.

The template of a body follows from the shape rule of its class, its orientation from joints, handles and neighbors, and
its parameters from its contents. Geometry fits the size in the map exactly; the world is not changed.
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
    MAX_NEIGHBORS,
    Cavity,
    Neighborhood,
    SceneContext,
    cavity_of,
    shelf_heights,
    tray_heights,
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
from mindstage.geometry.procedural.builder import BodySide
from mindstage.knowledge.shape_rules import DEFAULT_ROLE, ShapeRule
from mindstage.scene import (
    AttachedLight,
    Body,
    BodyGeometry,
    BodyId,
    GeometryMap,
    GeometrySource,
    Iri,
    PbrMaterial,
    PrimitiveType,
    World,
)

__all__ = [
    "FitNote",
    "FittedGeometry",
    "GeometryFitter",
    "MeshLoadResult",
    "MeshProvider",
    "ShapeRuleProvider",
    "fit_geometry",
]


class FitNote(NamedTuple):
    """A remark on the geometry of bodies: a guess, or a shape rule that cannot be applied."""

    ids: tuple[BodyId, ...]
    text: str


@dataclass(frozen=True, slots=True)
class FittedGeometry:
    """The geometry of the bodies of a world."""

    geometry: GeometryMap
    """Geometry by id, for all bodies with a nonzero size."""
    notes: tuple[FitNote, ...] = ()


class ShapeRuleProvider(Protocol):
    """A source of shape rules, such as a `KnowledgeBase`."""

    def shape_rule(self, cls: Iri, /) -> ShapeRule:
        """Returns the shape rule of a class."""


class MeshLoadResult(Protocol):
    """The geometry that was loaded from mesh files."""

    @property
    def geometry(self) -> Mapping[BodyId, BodyGeometry]:
        """Geometry by id, for bodies with a mesh file."""

    @property
    def notes(self) -> Sequence[str]:
        """Remarks on meshes that were modified, and on unusable files."""


class MeshProvider(Protocol):
    """A loader of the mesh files that bodies refer to."""

    def geometry_for(self, bodies: Sequence[Body], /) -> MeshLoadResult:
        """Returns the geometry of the bodies with mesh files."""


_DEFAULT_SHAPE = "box"
_DOOR_SHAPE = "door"
"""The shape of doors, and their material role in the rules of what they close."""
_MIN_PANEL_ROOM_M = 0.05
"""A panel above a door, with the board above it, has at least this height."""
_SHAPE_OF_PRIMITIVE = {PrimitiveType.CYLINDER: "cylinder", PrimitiveType.SPHERE: "ball"}
_WORKTOP_INSERT_SHAPES = ("sink", "hob", "tub", "basket", "bin")
_WALL_INSERT_SHAPES = ("door", "window", "frame")
_ARCHITECTURE_SHAPES = ("wall", "shell", "panel", "picture", "lamp")
_NO_SIZE = (0.0, 0.0, 0.0)
"""[m]."""
_MIN_ROOM_M = 1.0
"""A wall of at least this thickness is the bounding box of the walls of a room."""


class GeometryFitter:
    """Builds the geometry of the bodies of one scene."""

    def __init__(self, context: SceneContext, neighborhoods: Mapping[int, Neighborhood]) -> None:
        """Stores the scene; geometry is built by `geometry`."""
        self._context = context
        self._neighborhoods = neighborhoods
        self._is_worktop_insert = context.has_shape(*_WORKTOP_INSERT_SHAPES)
        self._is_wall_insert = context.has_shape(*_WALL_INSERT_SHAPES)
        self._is_room_insert = ~context.has_shape(*_ARCHITECTURE_SHAPES)

    def geometry(self, row: int, orientation: Orientation) -> tuple[BodyGeometry | None, str]:
        """Returns the geometry of a body, and the part of its shape rule that cannot be applied, usually "".

        The geometry is None if the size is out of range.
        """
        body, rule = self._context.bodies[row], self._context.rules[row]
        shape_name = self._shape_name(row)
        parameters, issue = _valid_parameters(shape_name, rule)
        fitted = self._fitted_parameters(row, shape_name, orientation, parameters)
        material = self._closing_material(row)
        try:
            return self._build(body, rule, shape_name, {**parameters, **fitted}, orientation, material), issue
        except ShapeNotFoundError as error:
            shape_name, issue = _DEFAULT_SHAPE, str(error)
        except InvalidShapeError as error:
            issue = str(error)
        try:
            return self._build(body, rule, shape_name, {}, orientation), issue
        except InvalidShapeError as error:
            return None, str(error)

    def _shape_name(self, row: int) -> str:
        """Returns the shape of a body: that of its class, adapted to its parts and its size."""
        context, name = self._context, str(self._context.shape_names[row])
        primitive = context.bodies[row].shape
        if name == _DEFAULT_SHAPE and primitive is not None:
            return _SHAPE_OF_PRIMITIVE.get(primitive.type, name)
        if name == "wall" and context.boxes.half_extents[row].min() * 2 > _MIN_ROOM_M:
            return "shell"
        parts = context.shape_names[context.group_mates(row)] if name in ("table", "chair") else ()
        if name == "table" and "leg" in parts:
            return "counter"
        if name == "chair" and "panel" in parts:
            return "table"
        return name

    def _fitted_parameters(
        self, row: int, shape_name: str, orientation: Orientation, parameters: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Returns the parameters that follow from the contents and the neighbors of a body."""
        fields = SHAPE_TEMPLATES[shape_name].__struct_fields__ if shape_name in SHAPE_TEMPLATES else ()
        found: dict[str, Any] = {}
        if "word" in fields and "word" not in parameters:
            found["word"] = self._context.rules[row].word
        if "along" in fields:
            found["along"] = _cylinder_axis(self._context, row, orientation)
        if shape_name == _DOOR_SHAPE and self._needs_display(row):
            found["display"] = True
        neighborhood = self._neighborhoods.get(row)
        if neighborhood is None:
            return found | ({"walls": _open_walls(orientation, {})} if "walls" in fields else {})
        if parameters.get("controls") == "top" and "door_top" in fields:
            found |= self._panel_parameters(row, neighborhood, orientation.up)
        if "free" in fields:
            found["free"] = self._cutouts(row, shape_name, neighborhood, orientation.up)
        cavity = cavity_of(self._context, row, neighborhood)
        if "walls" in fields:
            default = float(parameters.get("wall", SHAPE_TEMPLATES[shape_name]().wall))  # type: ignore[attr-defined]
            found["walls"] = _open_walls(orientation, {side: cavity.wall_thickness(side, default) for side in BodySide})
        found |= _level_parameters(cavity, orientation.up, fields)
        if "shelves" in fields and len(cavity.rows) and "levels" not in found and not cavity.is_free.all():
            found["shelves"] = 0
        return found

    def _panel_parameters(self, row: int, neighborhood: Neighborhood, up: BodySide) -> dict[str, float]:
        """Returns the upper edges of the doors and of the knobs in front of a case with a panel."""
        half = self._context.boxes.half_extents[row]
        inside = np.abs((neighborhood.low + neighborhood.high) / 2) < half
        names = self._context.shape_names[neighborhood.rows]
        tops = neighborhood.high[:, up.axis] if up.sign > 0 else -neighborhood.low[:, up.axis]
        found = {}
        for parameter, shape_name in (("door_top", _DOOR_SHAPE), ("knob_top", "knob")):
            # The third axis is that of the front, where the center is outside.
            chosen = (names == shape_name) & (np.count_nonzero(inside, axis=1) >= 2) & inside[:, up.axis]
            if chosen.any():
                found[parameter] = float(tops[chosen].max())
        return found

    def _needs_display(self, row: int) -> bool:
        """Whether a door covers the front of a case up to the top, so that its panel has no room."""
        for joint in self._context.joints.get(row, ()):
            holder, neighborhood = joint.fixed_row, self._neighborhoods.get(joint.fixed_row)
            if joint.moving_row != row or neighborhood is None:
                continue
            up = self._context.up_side(holder)
            top = self._panel_parameters(holder, neighborhood, up).get("door_top")
            has_panel = self._context.rules[holder].parameters.get("controls") == "top"
            if has_panel and top is not None:
                return float(self._context.boxes.half_extents[holder, up.axis]) - top < _MIN_PANEL_ROOM_M
        return False

    def _cutouts(self, row: int, shape_name: str, neighborhood: Neighborhood, up: BodySide) -> tuple[Any, ...]:
        if shape_name in ("wall", "shell"):
            # The bounding box of a non-rectangular room intersects its furniture: there the shell has openings.
            chosen = self._is_wall_insert if shape_name == "wall" else self._is_room_insert
            return wall_openings(self._context, row, neighborhood, chosen, include_motion=shape_name == "shell")
        return worktop_cutouts(self._context, row, neighborhood, up, self._is_worktop_insert)

    def _closing_material(self, row: int) -> PbrMaterial | None:
        """Returns the material that the rule of a cabinet defines for its doors: that of an oven is glass."""
        if str(self._context.shape_names[row]) != _DOOR_SHAPE:
            return None
        holders = (joint.fixed_row for joint in self._context.joints.get(row, ()) if joint.moving_row == row)
        materials = (self._context.rules[holder].materials.get(_DOOR_SHAPE) for holder in holders)
        return next((material.pbr_material for material in materials if material is not None), None)

    @staticmethod
    def _build(
        body: Body,
        rule: ShapeRule,
        shape_name: str,
        parameters: Mapping[str, Any],
        orientation: Orientation,
        body_material: PbrMaterial | None = None,
    ) -> BodyGeometry:
        materials = {role: material.pbr_material for role, material in rule.materials.items()}
        materials[DEFAULT_ROLE] = body_material or materials[DEFAULT_ROLE]
        return build_geometry(
            template_by_name(shape_name, parameters),
            body.size or _NO_SIZE,
            up=orientation.up,
            front=orientation.front,
            materials=materials | _map_color(body, materials[DEFAULT_ROLE]),
            light=_attached_light(rule),
            friction=rule.default_material.friction,
            restitution=rule.default_material.restitution,
            density=rule.default_material.density,
            source=rule.source,
            reason="; ".join(
                part for part in (rule.reason, orientation.reason and f"its front is {orientation.reason}") if part
            ),
        )


def _valid_parameters(shape_name: str, rule: ShapeRule) -> tuple[dict[str, Any], str]:
    """Returns the valid parameters of a rule that a shape has, and the error of the last invalid one."""
    if shape_name not in SHAPE_TEMPLATES:
        return {}, ""
    valid: dict[str, Any] = {}
    issue = ""
    for name, value in rule.parameters.items():
        if name in SHAPE_TEMPLATES[shape_name].__struct_fields__:
            try:
                template_by_name(shape_name, {name: value})
                valid[name] = value
            except InvalidShapeError as error:
                issue = str(error)
    return valid, issue


def _open_walls(orientation: Orientation, walls: Mapping[BodySide, float]) -> tuple[tuple[BodySide, float], ...]:
    """Returns the thickness of the walls on the sides of a case, 0 on open sides."""
    open_sides = orientation.openings or (orientation.front,)
    return tuple(sorted({**walls, **dict.fromkeys(open_sides, 0.0)}.items(), key=lambda wall: wall[0].value))


def _level_parameters(cavity: Cavity, up: BodySide, fields: tuple[str, ...]) -> dict[str, Any]:
    levels = (tray_heights if "trays" in fields else shelf_heights)(cavity, up)
    if not levels:
        return {}
    if "levels" in fields:
        return {"levels": levels}
    if "level" in fields:
        return {"level": levels[0]}
    if "wall" in fields and "free" not in fields:  # a vessel; the walls of a room keep their thickness
        return {"wall": min(cavity.wall_thickness(side, 0.008) for side in BodySide if side.axis != up.axis)}
    return {}


def _cylinder_axis(context: SceneContext, row: int, orientation: Orientation) -> BodySide:
    """Returns the axis of a cylinder in the template frame: the one across the two most similar extents."""
    shape = context.bodies[row].shape
    if shape is not None and shape.type is PrimitiveType.CYLINDER:
        axis = 2
    else:
        size = context.boxes.half_extents[row]
        gaps = [abs(float(np.log(size[(each + 1) % 3] / size[(each + 2) % 3]))) for each in range(3)]
        gaps[orientation.up.axis] -= 1e-3  # upright if ambiguous
        axis = int(np.argmin(gaps))
    if axis == orientation.up.axis:
        return BodySide.TOP
    return BodySide.FRONT if axis == orientation.front.axis else BodySide.LEFT


def _map_color(body: Body, material: PbrMaterial) -> dict[str, PbrMaterial]:
    """Returns the material with the color that the map states for a body, which overrides that of its class."""
    return {} if body.color is None else {DEFAULT_ROLE: replace(material, color=body.color)}


def _attached_light(rule: ShapeRule) -> AttachedLight | None:
    light = rule.light
    if light is None:
        return None
    return AttachedLight(type=light.light_type, color=light.color, intensity=light.intensity)


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
"""Shapes whose openings, levels or cutouts depend on their neighbors."""


def fit_geometry(world: World, knowledge: ShapeRuleProvider, *, meshes: MeshProvider | None = None) -> FittedGeometry:
    """Returns the geometry of all bodies of a world that have a size.

    Args:
        world: the scene.
        knowledge: the shape rules of classes.
        meshes: loader of mesh files, which take precedence over shape rules.
    """
    geometry: dict[BodyId, BodyGeometry] = {}
    notes = _Notes()
    if meshes is not None:
        loaded = meshes.geometry_for(world.bodies)
        geometry |= loaded.geometry
        notes.notes += [FitNote((), text) for text in loaded.notes]
    rules = {cls: knowledge.shape_rule(cls) for cls in dict.fromkeys(body.cls for body in world.bodies)}
    if world.bodies:
        _fit(SceneContext(world, rules), geometry, notes)
    notes.add_class_notes(world, rules, geometry)
    return FittedGeometry(
        MappingProxyType({body.id: geometry[body.id] for body in world.bodies if body.id in geometry}), notes.to_tuple()
    )


def _fit(context: SceneContext, geometry: dict[BodyId, BodyGeometry], notes: _Notes) -> None:
    """Adds the geometry of all bodies that have none yet."""
    detached = np.ones(len(context.bodies), dtype=bool)
    detached[list(context.parents)] = False
    neighborhoods, crowded = context.neighborhoods(
        context.has_shape(*_NEIGHBORHOOD_SHAPES) | (context.has_shape(*HANDLE_SHAPES) & detached)
    )
    solver, fitter = OrientationSolver(context, neighborhoods), GeometryFitter(context, neighborhoods)
    for row, body in enumerate(context.bodies):
        if body.id in geometry or body.size is None:
            continue
        orientation = solver.orientation_of(row)
        if min(body.size) <= 0.0:
            notes.add("has no extent along one of its axes, so it keeps the shape of the map", body.id)
            continue
        fitted, issue = fitter.geometry(row, orientation)
        if issue:
            notes.add(f"cannot be built as defined: {issue}", body.id)
        if fitted is not None:
            geometry[body.id] = fitted
            if orientation.is_guess and fitted.shape_name != "box":
                notes.add(f"is a {fitted.shape_name} with an unknown front: it faces the center of the scene", body.id)
    for row in crowded:
        notes.add(f"has over {MAX_NEIGHBORS} neighbors, so its contents are ignored", context.bodies[row].id)


class _Notes:
    """Collects notes; those with the same text become one note."""

    def __init__(self) -> None:
        self.notes: list[FitNote] = []
        self._ids: dict[str, list[BodyId]] = {}

    def add(self, text: str, id: BodyId) -> None:
        self._ids.setdefault(text, []).append(id)

    def add_class_notes(self, world: World, rules: Mapping[Iri, ShapeRule], fitted_ids: Iterable[BodyId]) -> None:
        """Adds notes on shapes that were guessed from class names, and on invalid shape rules."""
        fitted = set(fitted_ids)
        for body in world.bodies:
            rule = rules[body.cls]
            if body.id in fitted and rule.source is GeometrySource.CLASS_NAME:
                self.add(f"is shaped as a {rule.shape_type} by a guess: {rule.reason}", body.id)
            for issue in rule.issues:
                self.add(issue, body.id)

    def to_tuple(self) -> tuple[FitNote, ...]:
        notes = (FitNote(tuple(ids), f"{_join_ids(ids)}: {text}") for text, ids in self._ids.items())
        return (*self.notes, *notes)


def _join_ids(ids: list[BodyId]) -> str:
    return ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")
