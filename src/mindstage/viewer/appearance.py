"""Looks: how each body is drawn, decided from its form and from where it stands.

What a thing looks like is its form's matter. Here it is decided what would stand in the way: what encloses the whole
place is drawn only as an outline, and a wall or a ceiling only from inside the room, which leaves the view from
outside free.

GLB: the skins of a form as one binary glTF file for the browser, which knows metal, roughness, glow and textures.

The page's library works out normals by itself, smooth wherever triangles share a point. So points are shared here only
where a skin has normals, and every flat face has points of its own.

Palette: how a color changes when something is lit, and when it steps back behind what is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.assets.gltf import GltfWriter
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.shape_rules import ShapeRule, name_tokens, singular_forms
from mindstage.scene import (
    AttachedLight,
    Body,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    Color,
    Iri,
    PbrMaterial,
    PrimitiveType,
    Vector,
    VisualMesh,
    World,
)
from mindstage.scene.geometry import NO_GEOMETRY, GeometryMap, PbrMaterial, VisualMesh
from mindstage.scene.mesh import TriangleMesh, box, convex_hull, cylinder, sphere
from mindstage.scene.transforms import normalize, normalized_pose_array, pose_array, quat_rotate, rotation_matrix

__all__ = [
    "ASSUMED_SIZE_M",
    "HIGHLIGHT_OPACITY",
    "OCCLUDER_OPACITY",
    "BodyAppearance",
    "Paint",
    "VisiblePart",
    "compute_appearance",
    "dimmed",
    "find_outlines",
    "highlighted",
    "local_name",
    "mean_color",
    "merge_visuals",
    "visuals_to_glb",
]


_MAX_METALNESS = 0.3
"""So much of it is left in the page, where nothing is there to be mirrored: pure metal would be black."""


def merge_visuals(visuals: Iterable[VisualMesh]) -> TriangleMesh:
    """All triangles of several skins as one mesh; a single one keeps its place on its picture."""
    meshes = [_mesh(skin) for skin in visuals]
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]
    vertices = [np.zeros((0, 3)), *(mesh.points for mesh in meshes)]
    return TriangleMesh(np.concatenate(vertices), np.concatenate([np.zeros((0, 3), np.uint32), *faces]))


def _mesh(visual: VisualMesh) -> TriangleMesh:
    if visual.normals is not None:
        uv = None if visual.uv is None else visual.uv.astype(np.float64)
        return TriangleMesh(visual.points.astype(np.float64), visual.faces.astype(np.uint32), uv=uv)
    corners = visual.faces.reshape(-1)
    uv = None if visual.uv is None else visual.uv[corners].astype(np.float64)
    faces = np.arange(corners.size, dtype=np.uint32).reshape(-1, 3)
    return TriangleMesh(visual.points[corners].astype(np.float64), faces, uv=uv)


def visuals_to_glb(visuals: Iterable[VisualMesh]) -> bytes:
    """A binary glTF 2.0 file; its axes are the body's, since the page turns everything itself."""
    groups: dict[tuple[PbrMaterial, int | None], list[VisualMesh]] = {}
    for skin in visuals:
        # One draw call for all that is made of one material.
        groups.setdefault((skin.material, None if skin.image is None else id(skin)), []).append(skin)
    pictured = any(skin.image is not None for group in groups.values() for skin in group)
    joined = [_merge_by_material(surface, group, textured=pictured) for (surface, _), group in groups.items()]
    file = GltfWriter("form")
    primitives = [file.visual_primitive(skin) for skin in joined if skin.faces.size]
    file.nodes.append({"mesh": file.mesh("form", lambda: primitives)} if primitives else {})
    return file.data()


def _merge_by_material(material: PbrMaterial, visuals: list[VisualMesh], *, textured: bool) -> VisualMesh:
    """Skins of one material as one, of less metal than it is."""
    mesh = merge_visuals(visuals)
    uv = mesh.uv
    if textured and uv is None:  # the page joins all into one mesh, for which they must have the same attributes
        uv = np.zeros((len(mesh.points), 2))
    shown = replace(material, metalness=_MAX_METALNESS * material.metalness)
    return VisualMesh(mesh.points, mesh.faces, shown, uv=uv, image=visuals[0].image)


def mean_color(visuals: Iterable[VisualMesh]) -> Color:
    """Of a whole form, by the area that each color has."""
    total, weight = np.zeros(3), 1e-12
    for skin in visuals:
        first, second, third = (skin.points[skin.faces[:, corner]] for corner in range(3))
        area = float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum())
        total, weight = total + area * np.array(skin.material.color), weight + area
    red, green, blue = (total / weight).tolist()
    return red, green, blue


HIGHLIGHT_OPACITY = 0.85
"""Of a lit body that is see-through otherwise: a highlight must be seen."""
OCCLUDER_OPACITY = 0.25
"""Of what stands before something lit: what is lit in a cupboard must be seen too."""
_DIM_GRAY, _DIM_AMOUNT = 0.82, 0.72
"""The gray that dimmed colors go towards, and how far."""


class Paint(msgspec.Struct, frozen=True):
    """A color, and how much of what is behind stays hidden."""

    color: Color
    opacity: float = 1.0


def highlighted(paint: Paint, color: Color) -> Paint:
    """The same surface with a highlight."""
    return Paint(color, max(paint.opacity, HIGHLIGHT_OPACITY))


def dimmed(paint: Paint, *, as_occluder: bool = False) -> Paint:
    """The same surface stepping back behind what is lit; as a veil it also lets that be seen through it."""
    red, green, blue = (part + (_DIM_GRAY - part) * _DIM_AMOUNT for part in paint.color)
    return Paint((red, green, blue), min(paint.opacity, OCCLUDER_OPACITY) if as_occluder else paint.opacity)


ASSUMED_SIZE_M: Vector = (0.1, 0.1, 0.1)
"""How large a body is drawn whose size nobody told [m]."""
_MAX_FURNITURE_M = 2.5
"""Nothing that one puts into a room is so large along all three axes."""
_MAX_THIN_RATIO = 0.35
"""Of its next larger extent, at most, is the smallest of what hangs on a wall."""
_MIN_PANEL_M = 0.15
_MIN_FACING_COSINE = 0.9
"""Cosine from which on a triangle looks towards a side."""
_SOLID_OPACITY = 0.6

Side = tuple[int, int]
"""A side of a box: the axis, and 1 or -1 for its direction."""

_WALL_NOUNS, _FLOOR_NOUNS, _CEILING_NOUNS = (
    ["wall", "pillar", "column", "building"],
    ["floor", "ground"],
    ["ceiling", "roof"],
)
_WALL_MOUNTED = ["window", "pane", "poster", "picture", "curtain", "mirror", "blackboard", "whiteboard", "clock"]
_PRIMITIVE_OF_COLLISION_TYPE = {
    CollisionShapeType.SPHERE: PrimitiveType.SPHERE,
    CollisionShapeType.CYLINDER: PrimitiveType.CYLINDER,
}


class VisiblePart(StrEnum):
    """How much of a body is drawn."""

    WHOLE = "whole"
    INTERIOR = "inside"
    """What looks towards the room, and only seen from there."""
    OUTLINE = "outline"


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyAppearance:
    """Everything that decides how a body is drawn, but not where."""

    key: str
    """Looks of one key are the same."""
    size: Vector
    part: VisiblePart = VisiblePart.WHOLE
    is_building: bool = False
    """Whether it belongs to the house rather than to what is in it or hangs on its walls."""
    is_floor: bool = False
    visuals: tuple[VisualMesh, ...] = field(default=(), compare=False, repr=False)
    lights: tuple[AttachedLight, ...] = field(default=(), compare=False, repr=False)
    color: Color = field(default=(0.8, 0.8, 0.8), compare=False)
    """Of all of it, seen from far away."""
    is_opaque: bool = field(default=True, compare=False)


def compute_appearance(
    world: World,
    rule_of: Callable[[Iri], ShapeRule],
    ancestors: Callable[[Iri], Iterable[Iri]] = lambda cls: (),
    *,
    geometry: GeometryMap = NO_GEOMETRY,
    enclosing: Iterable[BodyId] = (),
) -> dict[BodyId, BodyAppearance]:
    """Decides for all bodies of a world, as it is described.

    Args:
        world: what is there.
        rule_of: what is known of the form of a class's things.
        ancestors: of a class, nearest first.
        forms: of the bodies; one without a form is its shape, in its size.
        shells: what the engine took for shells.
    """
    return _AppearanceSolver(world, rule_of, ancestors, geometry, frozenset(enclosing)).appearances()


def find_outlines(
    world: World, *, geometry: GeometryMap = NO_GEOMETRY, enclosing: Iterable[BodyId] = ()
) -> frozenset[BodyId]:
    """The bodies of which only an outline is drawn, since they enclose the place; for the rest as in `compute_appearance`."""
    told = frozenset(enclosing)
    return frozenset(body.id for body in world.bodies if body.id in told or _encloses(body, geometry.get(body.id)))


class _AppearanceSolver:
    """One world, as arrays, while it is decided about."""

    def __init__(
        self,
        world: World,
        rule_of: Callable[[Iri], ShapeRule],
        ancestors: Callable[[Iri], Iterable[Iri]],
        geometry: GeometryMap,
        enclosing: frozenset[BodyId],
    ) -> None:
        self.bodies, self.geometry = world.bodies, geometry
        self.rows = {body.id: row for row, body in enumerate(world.bodies)}
        classes = {body.cls for body in world.bodies}
        self.rules = {cls: rule_of(cls) for cls in classes}
        self.nouns = {cls: frozenset(_class_nouns(cls, tuple(ancestors(cls)))) for cls in classes}
        self.is_building = self._has_noun(_WALL_NOUNS + _FLOOR_NOUNS + _CEILING_NOUNS)
        self.is_wall, self.is_floor = self._has_noun(_WALL_NOUNS), self._has_noun(_FLOOR_NOUNS)
        self.is_enclosing = self._has_noun(_WALL_NOUNS + _CEILING_NOUNS + _WALL_MOUNTED)
        self.is_lamp = np.array([self.rules[body.cls].shape_type == "lamp" for body in world.bodies], dtype=bool)
        poses = pose_array(body.pose for body in world.bodies)
        self.center, self.rotation = poses[:, :3], rotation_matrix(normalize(poses[:, 3:]))
        self.half = np.array([body.size or ASSUMED_SIZE_M for body in world.bodies], dtype=float).reshape(-1, 3) / 2
        self.volume = np.prod(2 * self.half, axis=1)
        outlines = find_outlines(world, geometry=geometry, enclosing=enclosing)
        self.is_shell = np.array([body.id in outlines for body in world.bodies], dtype=bool)
        self.is_object = ~self.is_shell & ~self.is_building
        heights = self.center[self.is_object & ~self.is_lamp, 2]
        self.is_overhead = float(np.quantile(heights, 0.9)) if heights.size else np.inf
        self.roots = self._roots({hold.child: hold.parent for hold in world.attachments})
        self.is_in_wall = set(self._doors_in_walls([(joint.parent, joint.child) for joint in world.joints]))

    def appearances(self) -> dict[BodyId, BodyAppearance]:
        """Of all bodies, by id."""
        return {body.id: self._appearance(row, body) for row, body in enumerate(self.bodies)}

    def _appearance(self, row: int, body: Body) -> BodyAppearance:
        building = bool(self.is_building[row]) or self.roots[row] in self.is_in_wall
        floor, size = bool(self.is_floor[row]), body.size or ASSUMED_SIZE_M
        if self.is_shell[row]:
            return BodyAppearance(
                key=f"outline of {size}", size=size, part=VisiblePart.OUTLINE, is_building=True, is_floor=floor
            )
        base, skins, glows = self._visuals(body, size)
        part = VisiblePart.WHOLE
        if (side := self._single_side(row)) is not None:
            base, skins, part = f"{base} from {side}", tuple(_triangles_facing(skins, side)), VisiblePart.INTERIOR
        return BodyAppearance(
            key=base,
            size=size,
            part=part,
            is_building=building,
            is_floor=floor,
            visuals=skins,
            lights=glows,
            color=mean_color(skins),
            is_opaque=min((skin.material.opacity for skin in skins), default=0.0) > _SOLID_OPACITY,
        )

    def _visuals(self, body: Body, size: Vector) -> tuple[str, tuple[VisualMesh, ...], tuple[AttachedLight, ...]]:
        """What is seen of a body, under a name of its own: its form, painted as its materials say."""
        form = self.geometry.get(body.id)
        color = next((material.color for material in body.materials if material.color is not None), None)
        if form is not None and form.visuals:
            tinted = form.visuals if color is None else _tinted(form.visuals, color)
            return f"{form.key} {color}", tinted, form.lights
        surface = self.rules[body.cls].default_material.pbr_material
        surface = surface if color is None else replace(surface, color=color)
        if form is not None and form.collision_shapes:
            return (
                f"{form.key} {surface}",
                tuple(_collision_visual(solid, surface) for solid in form.collision_shapes),
                form.lights,
            )
        kind = body.shape.type if body.shape else PrimitiveType.BOX
        return f"{kind} {size} {surface}", (_primitive_visual(PrimitiveType(kind), size, surface),), ()

    # -- what would stand in the way -----------------------------------------------------------------------------------

    def _has_noun(self, nouns: Iterable[str]) -> NDArray[np.bool_]:
        """Of which bodies the class, or a class above it, has such a name."""
        wanted = frozenset(nouns)
        return np.array([bool(self.nouns[body.cls] & wanted) for body in self.bodies], dtype=bool)

    def _single_side(self, row: int) -> Side | None:
        """The one side that is drawn of what would hide the room: walls and doors in them, ceilings, lamps there."""
        in_wall = self.roots[row] in self.is_in_wall
        if self.bodies[row].physics.is_dynamic and not in_wall:
            return None
        thinnest, next_thinnest = np.sort(self.half[row])[:2]
        is_thin = thinnest < _MAX_THIN_RATIO * next_thinnest and next_thinnest > _MIN_PANEL_M
        if is_thin and (in_wall or self.is_enclosing[row]):
            return self._room_side(row)
        if self.is_lamp[row] and self.center[row, 2] > self.is_overhead:
            return self._bottom_side(row)
        return None

    def _room_side(self, row: int) -> Side:
        axis = int(np.argmin(self.half[row]))
        offsets = (self.center[self.is_object] - self.center[row]) @ self.rotation[row][:, axis]
        return axis, 1 if np.sum(np.sign(offsets)) >= 0 else -1

    def _bottom_side(self, row: int) -> Side:
        """The side of a box that looks down."""
        up = self.rotation[row][2]
        axis = int(np.argmax(np.abs(up)))
        return axis, -1 if up[axis] > 0 else 1

    def _roots(self, parents: dict[BodyId, BodyId]) -> list[int]:
        """Of each body, the body that it finally hangs on."""
        roots = []
        for body in self.bodies:
            top, seen = body.id, {body.id}
            while (above := parents.get(top, body.id)) in self.rows and above not in seen:
                seen.add(above)
                top = above
            roots.append(self.rows[top])
        return roots

    def _doors_in_walls(self, joints: list[tuple[BodyId, BodyId]]) -> Iterator[int]:
        """What is hinged on a wall or slides in one."""
        walls = set(np.flatnonzero(self.is_wall).tolist())
        for parent, child in joints:
            ends = {self.roots[self.rows[end]] for end in (parent, child) if end in self.rows}
            if len(ends) == 2:
                front, frame = sorted(ends, key=lambda row: (not self.bodies[row].physics.is_dynamic, self.volume[row]))
                if frame in walls:
                    yield front


def _encloses(body: Body, geometry: BodyGeometry | None) -> bool:
    return (geometry is not None and geometry.shape_name == "shell") or min(
        body.size or ASSUMED_SIZE_M
    ) > _MAX_FURNITURE_M


def _class_nouns(cls: Iri, ancestors: tuple[Iri, ...]) -> Iterator[str]:
    """What things of a class are, in a word each: what its name, and those of the classes above, end with."""
    for name in (cls, *ancestors):
        parts = name_tokens(name)
        # A WallOfAConstruction is a wall, a WallClock is none.
        ends = parts[: parts.index("of")] if "of" in parts else parts
        for word in ends[-1:]:
            yield from singular_forms(word)


def _tinted(visuals: Iterable[VisualMesh], color: Color) -> tuple[VisualMesh, ...]:
    """The same in another color, but for what one sees through and what has a picture on it."""
    return tuple(
        skin
        if skin.image is not None or skin.material.opacity <= _SOLID_OPACITY
        else VisualMesh(skin.points, skin.faces, replace(skin.material, color=color), skin.normals)
        for skin in visuals
    )


def _triangles_facing(visuals: Iterable[VisualMesh], side: Side) -> Iterator[VisualMesh]:
    """The triangles that look towards a side; from behind, they are not there."""
    axis, direction = side
    for skin in visuals:
        first, second, third = (skin.points[skin.faces[:, corner]] for corner in range(3))
        normal = np.cross(second - first, third - first)
        towards = normal[:, axis] * direction > _MIN_FACING_COSINE * np.linalg.norm(normal, axis=1)
        if towards.any():
            yield VisualMesh(skin.points, skin.faces[towards], skin.material, skin.normals, skin.uv, skin.image)


def _collision_visual(shape: CollisionShape, material: PbrMaterial) -> VisualMesh:
    """What can be touched, where nobody told what is seen."""
    place = normalized_pose_array(shape.pose)
    if shape.type is CollisionShapeType.HULL and (hull := convex_hull(np.array(shape.points))) is not None:
        return VisualMesh(quat_rotate(place[3:], hull.points) + place[:3], hull.faces.astype(np.uint32), material)
    made = _primitive_visual(_PRIMITIVE_OF_COLLISION_TYPE.get(shape.type, PrimitiveType.BOX), shape.size, material)
    assert made.normals is not None
    return VisualMesh(
        quat_rotate(place[3:], made.points) + place[:3], made.faces, material, quat_rotate(place[3:], made.normals)
    )


@lru_cache(maxsize=4096)
def _primitive_visual(type: PrimitiveType, size: Vector, material: PbrMaterial) -> VisualMesh:
    """A body of which nothing is known but its shape, with edges slightly rounded."""
    make = {PrimitiveType.CYLINDER: cylinder, PrimitiveType.SPHERE: sphere}.get(type, box)
    mesh = make(size)
    return VisualMesh(mesh.points, mesh.faces, material, mesh.normals)
