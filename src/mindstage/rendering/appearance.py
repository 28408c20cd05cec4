"""The appearance of bodies in the viewer: visual meshes, colors, highlights, and which parts would block the view.

Bodies that enclose the scene are drawn as outlines, and walls and ceilings only on the side that faces the room, so
that the room can be seen from outside. Meshes are sent as binary glTF; three.js computes smooth normals wherever
triangles share a vertex, so only meshes with normals share vertices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache, lru_cache
from hashlib import blake2b
from itertools import takewhile
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.assets import gltf
from mindstage.assets.cache import cached_glb
from mindstage.assets.gltf import GltfWriter
from mindstage.geometry.orientation import CLOSING_SHAPES, HANDLE_SHAPES
from mindstage.knowledge.shape_rules import ShapeRule, name_tokens, singular_forms
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import URDF_LINK
from mindstage.scene import (
    AttachedLight,
    Body,
    BodyGeometry,
    BodyId,
    CollisionShape,
    CollisionShapeType,
    Color,
    GeometrySource,
    Iri,
    Mobility,
    PbrMaterial,
    PrimitiveType,
    Vector,
    VisualMesh,
    World,
)
from mindstage.scene.geometry import NO_GEOMETRY, GeometryMap
from mindstage.scene.mesh import TriangleMesh, box, convex_hull, cylinder, face_cross_products, sphere
from mindstage.scene.transforms import Array, normalize, normalized_pose_array, pose_array, quat_rotate, rotation_matrix
from mindstage.textures.catalog import texture_info
from mindstage.textures.images import TextureMap, TextureUri
from mindstage.textures.prints import name_label

__all__ = [
    "ASSUMED_SIZE_M",
    "HIGHLIGHT_OPACITY",
    "OCCLUDER_OPACITY",
    "TEXTURE_PREFIX",
    "BodyAppearance",
    "Paint",
    "VisiblePart",
    "cached_visuals_to_glb",
    "compute_appearance",
    "dimmed",
    "find_outlines",
    "highlighted",
    "mean_color",
    "merge_visuals",
    "visuals_to_glb",
]


TEXTURE_PREFIX = "texture:"
"""Begins the name of a material with a procedural texture in the files for the page."""
_MAX_METALNESS = 0.3
"""Factor of the metalness: without an environment map, pure metal would be black."""


def merge_visuals(visuals: Iterable[VisualMesh]) -> TriangleMesh:
    """Joins the triangles of several visual meshes; texture coordinates are kept if all of them have some."""
    meshes = [_mesh(visual) for visual in visuals]
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]
    vertices = [np.zeros((0, 3)), *(mesh.points for mesh in meshes)]
    uv = [mesh.uv for mesh in meshes if mesh.uv is not None]
    return TriangleMesh(
        np.concatenate(vertices),
        np.concatenate([np.zeros((0, 3), np.uint32), *faces]),
        uv=np.concatenate(uv) if meshes and len(uv) == len(meshes) else None,
    )


def _mesh(visual: VisualMesh) -> TriangleMesh:
    if visual.normals is not None:
        uv = None if visual.uv is None else visual.uv.astype(np.float64)
        return TriangleMesh(visual.points.astype(np.float64), visual.faces.astype(np.uint32), uv=uv)
    corners = visual.faces.reshape(-1)
    uv = None if visual.uv is None else visual.uv[corners].astype(np.float64)
    faces = np.arange(corners.size, dtype=np.uint32).reshape(-1, 3)
    return TriangleMesh(visual.points[corners].astype(np.float64), faces, uv=uv)


def visuals_to_glb(visuals: Iterable[VisualMesh], *, texture_uri: TextureUri | None = None) -> bytes:
    """Converts visual meshes to a binary glTF 2.0 file in the frame of the body (z up).

    The file does not refer to images of procedural textures, since three.js would load them for each body anew. The
    name of the material has the address of the color image instead, from which a page loads each image once.

    Args:
        visuals: the meshes.
        texture_uri: where the images of procedural textures are; None to leave them out. Plain textures always are.
    """
    groups: dict[tuple[PbrMaterial, int | None], list[VisualMesh]] = {}
    for visual in visuals:
        if visual.image is None and (texture_uri is None or not _has_pattern(visual)):
            visual = _without_uv(visual)
        # One draw call for each material.
        groups.setdefault((visual.material, None if visual.image is None else id(visual)), []).append(visual)
    textured = any(visual.uv is not None for group in groups.values() for visual in group)
    merged = [
        _merge_by_material(_with_address(material, texture_uri), group, textured=textured)
        for (material, _), group in groups.items()
    ]
    file = GltfWriter("form")
    primitives = [file.visual_primitive(visual) for visual in merged if visual.faces.size]
    file.nodes.append({"mesh": file.mesh("form", lambda: primitives)} if primitives else {})
    return file.data()


def cached_visuals_to_glb(visuals: Sequence[VisualMesh], *, texture_uri: TextureUri | None = None) -> bytes:
    """As `visuals_to_glb`; files are kept on the disk for later runs, by their content and the version of the code."""
    digest = blake2b(_code_version(), digest_size=20)
    for visual in visuals:
        addresses: tuple[str | None, ...] = ()
        if texture_uri is not None and visual.material.texture:
            addresses = (texture_uri(visual.material.texture, TextureMap.COLOR),)
        digest.update(repr((visual.material, addresses)).encode())
        for array in (visual.points, visual.faces, visual.normals, visual.uv, visual.image):
            if array is not None:
                digest.update(repr((array.shape, array.dtype.str)).encode())
                digest.update(np.ascontiguousarray(array).data)
            digest.update(b";")
    return cached_glb(digest.hexdigest(), lambda: visuals_to_glb(visuals, texture_uri=texture_uri))


@cache
def _code_version() -> bytes:
    """A hash of the code that writes the files."""
    return blake2b(b"".join(Path(file).read_bytes() for file in (__file__, gltf.__file__))).digest()


def _with_address(material: PbrMaterial, texture_uri: TextureUri | None) -> PbrMaterial:
    """A material whose name has the address of its texture."""
    address = texture_uri(material.texture, TextureMap.COLOR) if texture_uri is not None and material.texture else None
    return replace(material, texture="", name=material.name if address is None else f"{TEXTURE_PREFIX}{address}")


def _has_pattern(visual: VisualMesh) -> bool:
    """Whether a mesh has a texture with a visible pattern."""
    texture = visual.material.texture
    return bool(texture) and visual.uv is not None and not texture_info(texture).is_plain


def _without_uv(visual: VisualMesh) -> VisualMesh:
    """A mesh without a texture; vertices that differ in their texture coordinates only become one."""
    material = replace(visual.material, texture="")
    if visual.uv is None or visual.normals is None:
        return VisualMesh(visual.points, visual.faces, material, visual.normals)
    vertices = np.column_stack([visual.points, visual.normals])
    kept, number = np.unique(vertices, axis=0, return_inverse=True)
    return VisualMesh(kept[:, :3], number.reshape(-1)[visual.faces].astype(np.uint32), material, kept[:, 3:])


def _merge_by_material(material: PbrMaterial, visuals: list[VisualMesh], *, textured: bool) -> VisualMesh:
    """Joins meshes of one material, with a reduced metalness."""
    mesh = merge_visuals(visuals)
    uv = mesh.uv
    if textured and uv is None:  # three.js merges the primitives, which must have the same attributes
        uv = np.zeros((len(mesh.points), 2))
    reduced = replace(material, metalness=_MAX_METALNESS * material.metalness)
    return VisualMesh(mesh.points, mesh.faces, reduced, uv=uv, image=visuals[0].image)


def mean_color(visuals: Iterable[VisualMesh]) -> Color:
    """The mean color of visual meshes, weighted by area."""
    total, weight = np.zeros(3), 1e-12
    for visual in visuals:
        area = float(np.linalg.norm(face_cross_products(visual.points, visual.faces), axis=1).sum())
        total, weight = total + area * np.array(visual.material.color), weight + area
    red, green, blue = (total / weight).tolist()
    return red, green, blue


HIGHLIGHT_OPACITY = 0.85
"""Minimum opacity of a highlighted body."""
OCCLUDER_OPACITY = 0.25
"""Maximum opacity of a body that occludes a highlighted one, such as the cupboard that it is in."""
_DIM_GRAY, _DIM_AMOUNT = 0.82, 0.72
"""The gray value that dimmed colors are blended with, and the weight of it."""


class Paint(msgspec.Struct, frozen=True):
    """A uniform color and opacity."""

    color: Color
    opacity: float = 1.0


def highlighted(paint: Paint, color: Color) -> Paint:
    """The paint of a highlighted body."""
    return Paint(color, max(paint.opacity, HIGHLIGHT_OPACITY))


def dimmed(paint: Paint, *, as_occluder: bool = False) -> Paint:
    """The paint of a body that is not highlighted; an occluder is transparent too."""
    red, green, blue = (part + (_DIM_GRAY - part) * _DIM_AMOUNT for part in paint.color)
    return Paint((red, green, blue), min(paint.opacity, OCCLUDER_OPACITY) if as_occluder else paint.opacity)


ASSUMED_SIZE_M: Vector = (0.04, 0.04, 0.04)
"""Size of the marker of a body without a size [m]."""
_SCHEMATIC = PbrMaterial(color=(0.52, 0.56, 0.61), roughness=0.6, opacity=0.4)
"""The material of a box that stands for a body of an unknown class."""
_LABEL = PbrMaterial(color=(1.0, 1.0, 1.0), roughness=0.9)
_LABEL_SHARE, _LABEL_ASPECT = 0.8, 2.0
"""The part of the width of a side that a label covers, and its width by its height."""
_LABEL_GAP_M = 1e-3
_MIN_LABEL_M, _MAX_LABEL_M = 0.01, 0.3
_LABELED_SIDES = ((1, 0, 1, 2), (-1, 0, 1, 2), (1, 1, 0, 2), (-1, 1, 0, 2), (1, 2, 0, 1))
"""The direction and the axis of each side with a label, and the axes of its width and height."""
_MAX_FURNITURE_M = 2.5
"""Smallest extent above which a body encloses the scene: no furniture is larger along all three axes."""
_MAX_THIN_RATIO = 0.35
"""Maximum ratio of the smallest to the second smallest extent of a thin body."""
_MIN_PANEL_M = 0.15
_MAX_MOUNTED_M = 0.15
"""Maximum thickness of what is flat against a wall."""
_MAX_UPRIGHT_SINE = 0.3
"""Maximum sine of the slope of the normal of what is upright."""
_OPERATED_SHAPES = frozenset((*CLOSING_SHAPES, *HANDLE_SHAPES))
"""Shapes of what is mounted on furniture, which the map may lack."""
_MIN_FACING_COSINE = 0.9
"""Minimum cosine between the normals of a triangle and the side that it faces."""
_SOLID_OPACITY = 0.6

Side = tuple[int, int]
"""A side of a box: the axis, and 1 or -1 for its direction."""

_WALL_NOUNS, _FLOOR_NOUNS, _CEILING_NOUNS = (
    ["wall", "pillar", "column", "building"],
    ["floor", "ground"],
    ["ceiling", "roof"],
)
_WALL_MOUNTED = ["window", "pane", "poster", "picture", "curtain", "mirror", "blackboard", "whiteboard", "clock"]
_DOORWAY_NOUNS = ["door", "doorway", "frame"]
_MIN_DOORWAY_M = 1.7
_MIN_OBJECTS_BESIDE = 0.9
"""Smallest part of the objects of a place that is on one side of a plate that counts as its wall."""
_PRIMITIVE_OF_COLLISION_TYPE = {
    CollisionShapeType.SPHERE: PrimitiveType.SPHERE,
    CollisionShapeType.CYLINDER: PrimitiveType.CYLINDER,
}


class VisiblePart(StrEnum):
    """Which part of a body is drawn."""

    WHOLE = "whole"
    INTERIOR = "interior"
    """The side that faces the room; invisible from behind."""
    OUTLINE = "outline"


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyAppearance:
    """How a body is drawn, without its pose."""

    key: str
    """Equal for bodies that are drawn alike."""
    size: Vector
    part: VisiblePart = VisiblePart.WHOLE
    is_schematic: bool = field(default=False, compare=False)
    """Whether a labeled translucent box stands for the body, since the shape of its class is not known."""
    is_building: bool = False
    """Whether the body is part of the building: walls, floors, ceilings, doors in walls."""
    is_floor: bool = False
    is_doorway: bool = field(default=False, compare=False)
    """Whether it is a door or a door frame that stands upright and is as tall as a person."""
    visuals: tuple[VisualMesh, ...] = field(default=(), compare=False, repr=False)
    """The meshes of the visible part."""
    whole_visuals: tuple[VisualMesh, ...] = field(default=(), compare=False, repr=False)
    """The meshes of the whole body."""
    side: Side | None = field(default=None, compare=False)
    """The side that faces the room, of a body of which only the interior is drawn."""
    mounted_axis: int | None = field(default=None, compare=False)
    """The axis across which a fixed body is flat, if it can be mounted on a wall or a ceiling; None for others."""
    is_hung: bool = field(default=False, compare=False)
    """Whether such a body is stated to be static: a part of the place that hangs where it does not stand."""
    lights: tuple[AttachedLight, ...] = field(default=(), compare=False, repr=False)
    color: Color = field(default=(0.8, 0.8, 0.8), compare=False)
    """The mean color."""
    is_opaque: bool = field(default=True, compare=False)


def compute_appearance(
    world: World,
    rule_of: Callable[[Iri], ShapeRule],
    ancestors: Callable[[Iri], Iterable[Iri]] = lambda cls: (),
    *,
    geometry: GeometryMap = NO_GEOMETRY,
    enclosing: Iterable[BodyId] = (),
) -> dict[BodyId, BodyAppearance]:
    """Computes the appearance of all bodies of a world.

    Args:
        world: the world, with the poses of its description.
        rule_of: returns the shape rule of a class.
        ancestors: returns the superclasses of a class, nearest first.
        geometry: the geometry of the bodies; a body without is drawn as its primitive shape.
        enclosing: bodies that the engine reported as enclosures.
    """
    return _AppearanceSolver(world, rule_of, ancestors, geometry, frozenset(enclosing)).appearances()


def find_outlines(
    world: World, *, geometry: GeometryMap = NO_GEOMETRY, enclosing: Iterable[BodyId] = ()
) -> frozenset[BodyId]:
    """Finds the bodies that are drawn as outlines because they enclose the scene.

    Args:
        geometry: the geometry of the bodies.
        enclosing: bodies that the engine reported as enclosures.
    """
    reported = frozenset(enclosing)
    return frozenset(body.id for body in world.bodies if body.id in reported or _encloses(body, geometry.get(body.id)))


class _AppearanceSolver:
    """Computes the appearances of one world; arrays have one row per body."""

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
        self.is_door = self._has_noun(_DOORWAY_NOUNS)
        self.is_lamp = np.array([self.rules[body.cls].shape_type == "lamp" for body in world.bodies], dtype=bool)
        poses = pose_array(body.pose for body in world.bodies)
        self.center, self.rotation = poses[:, :3], rotation_matrix(normalize(poses[:, 3:]))
        self.half = np.array([body.size or ASSUMED_SIZE_M for body in world.bodies], dtype=float).reshape(-1, 3) / 2
        self.volume = np.prod(2 * self.half, axis=1)
        outlines = find_outlines(world, geometry=geometry, enclosing=enclosing)
        self.is_shell = np.array([body.id in outlines for body in world.bodies], dtype=bool)
        plates = self._link_walls()
        self.is_wall, self.is_enclosing = self.is_wall | plates, self.is_enclosing | plates
        self.is_building |= plates
        self.is_object = ~self.is_shell & ~self.is_building
        heights = self.center[self.is_object & ~self.is_lamp, 2]
        self.overhead_height = float(np.quantile(heights, 0.9)) if heights.size else np.inf
        tops = self.center[:, 2] + np.einsum("ni,ni->n", np.abs(self.rotation[:, 2]), self.half)
        tops = tops[self.is_object & ~self.is_lamp]
        self.furniture_top = float(np.quantile(tops, 0.9)) if tops.size else np.inf
        self.roots = self._roots({link.child: link.parent for link in world.attachments})
        self.moving = {self.rows[joint.child] for joint in world.joints if joint.child in self.rows}
        self.mean_colors: dict[str, Color] = {}
        """The mean colors by the key of the appearance."""
        self.wall_door_roots = set(self._doors_in_walls([(joint.parent, joint.child) for joint in world.joints]))

    def appearances(self) -> dict[BodyId, BodyAppearance]:
        """The appearances by body."""
        return {body.id: self._appearance(row, body) for row, body in enumerate(self.bodies)}

    def _appearance(self, row: int, body: Body) -> BodyAppearance:
        building = bool(self.is_building[row]) or self.roots[row] in self.wall_door_roots
        floor, size = bool(self.is_floor[row]), body.size or ASSUMED_SIZE_M
        if self.is_shell[row]:
            return BodyAppearance(
                key=f"outline of {size}", size=size, part=VisiblePart.OUTLINE, is_building=True, is_floor=floor
            )
        schematic = not building and self._is_schematic(body)
        key, visuals, lights = _schematic_visuals(body) if schematic else self._visuals(body, size)
        part, whole = VisiblePart.WHOLE, visuals
        if (side := self._single_side(row)) is not None:
            key, part = f"{key} from {side}", VisiblePart.INTERIOR
            visuals = tuple(_triangles_facing(visuals, side))
        mounted = None if building or not self.moving.isdisjoint((row, self.roots[row])) else self._mounted_axis(row)
        if key not in self.mean_colors:
            self.mean_colors[key] = mean_color(visuals)
        return BodyAppearance(
            key=key,
            size=size,
            part=part,
            is_schematic=schematic,
            is_building=building,
            is_floor=floor,
            is_doorway=bool(self.is_door[row]) and self._is_tall_panel(row),
            visuals=visuals,
            whole_visuals=whole,
            side=side,
            mounted_axis=mounted,
            is_hung=mounted is not None and body.physics.mobility is Mobility.STATIC,
            lights=lights,
            color=self.mean_colors[key],
            is_opaque=min((visual.material.opacity for visual in visuals), default=0.0) > _SOLID_OPACITY,
        )

    def _visuals(self, body: Body, size: Vector) -> tuple[str, tuple[VisualMesh, ...], tuple[AttachedLight, ...]]:
        """The key, visual meshes and lights of a body, in the color of its materials."""
        geometry = self.geometry.get(body.id)
        color = body.color
        if geometry is not None and geometry.visuals:
            tinted = geometry.visuals if color is None else _tinted(geometry.visuals, color)
            return f"{geometry.key} {color}", tinted, geometry.lights
        material = self.rules[body.cls].default_material.pbr_material
        material = material if color is None else replace(material, color=color)
        if geometry is not None and geometry.collision_shapes:
            return (
                f"{geometry.key} {material}",
                tuple(_collision_visual(shape, material) for shape in geometry.collision_shapes),
                geometry.lights,
            )
        kind = body.shape.type if body.shape else PrimitiveType.BOX if body.size else PrimitiveType.SPHERE
        return f"{kind} {size} {material}", (_primitive_visual(PrimitiveType(kind), size, material),), ()

    def _is_schematic(self, body: Body) -> bool:
        """Whether neither the map nor an ontology gives the shape of a body, but a size."""
        rule, geometry = self.rules[body.cls], self.geometry.get(body.id)
        is_known = rule.source is not GeometrySource.MAP or body.cls == URDF_LINK or body.shape is not None
        return body.size is not None and not is_known and (geometry is None or geometry.source is GeometrySource.MAP)

    # -- bodies that would block the view ------------------------------------------------------------------------------

    def _link_walls(self) -> NDArray[np.bool_]:
        """The links of a robot description that bound the place: they have no class that could say what they are.

        Each is a fixed, upright plate, as tall as a doorway and wider than furniture; nearly everything is on one side.
        """
        found = np.zeros(len(self.bodies), dtype=bool)
        for row, body in enumerate(self.bodies):
            if body.cls == URDF_LINK and not body.physics.is_dynamic and self._is_tall_panel(row):
                found[row] = self._is_upright(row) and 2 * self.half[row].max() > _MAX_FURNITURE_M
        centers = self.center[~(self.is_shell | self.is_building | found)]
        for row in np.flatnonzero(found).tolist():
            normal = self.rotation[row][:, np.argmin(self.half[row])]
            is_beyond = (centers - self.center[row]) @ normal > 0.0
            share = float(is_beyond.mean()) if len(is_beyond) else 0.5
            found[row] = max(share, 1.0 - share) >= _MIN_OBJECTS_BESIDE
        return found

    def _has_noun(self, nouns: Iterable[str]) -> NDArray[np.bool_]:
        """A mask of the bodies whose class, or a superclass of it, is named by one of the nouns."""
        wanted = frozenset(nouns)
        return np.array([bool(self.nouns[body.cls] & wanted) for body in self.bodies], dtype=bool)

    def _single_side(self, row: int) -> Side | None:
        """The only side that is drawn of a body that would hide the room: walls, doors in them, ceilings, lamps."""
        in_wall = self.roots[row] in self.wall_door_roots
        if self.bodies[row].physics.is_dynamic and not in_wall:
            return None
        thinnest, next_thinnest = np.sort(self.half[row])[:2]
        is_thin = thinnest < _MAX_THIN_RATIO * next_thinnest and next_thinnest > _MIN_PANEL_M
        if is_thin and (in_wall or self.is_enclosing[row]):
            return self._room_side(row)
        if self.is_lamp[row] and self.center[row, 2] > self.overhead_height:
            return self._bottom_side(row)
        return None

    def _mounted_axis(self, row: int) -> int | None:
        """The axis across which a body is flat, if it is fixed and upright, or above the furniture."""
        thinnest, next_thinnest = np.sort(self.half[row])[:2]
        is_flat = thinnest < min(_MAX_THIN_RATIO * next_thinnest, _MAX_MOUNTED_M / 2)
        shape = self.rules[self.bodies[row].cls].shape_type
        if not is_flat or self.bodies[row].physics.is_dynamic or shape in _OPERATED_SHAPES:
            return None
        is_mounted = self._is_upright(row) or self.center[row, 2] > self.furniture_top
        return int(np.argmin(self.half[row])) if is_mounted else None

    def _is_upright(self, row: int) -> bool:
        """Whether the axis across which a body is thinnest is horizontal."""
        return abs(float(self.rotation[row][2, np.argmin(self.half[row])])) < _MAX_UPRIGHT_SINE

    def _is_tall_panel(self, row: int) -> bool:
        height = 2 * float(np.abs(self.rotation[row][2]) @ self.half[row])
        thinnest, next_thinnest = np.sort(self.half[row])[:2]
        return height > _MIN_DOORWAY_M and thinnest < _MAX_THIN_RATIO * next_thinnest

    def _room_side(self, row: int) -> Side:
        axis = int(np.argmin(self.half[row]))
        offsets = (self.center[self.is_object] - self.center[row]) @ self.rotation[row][:, axis]
        return axis, 1 if np.sum(np.sign(offsets)) >= 0 else -1

    def _bottom_side(self, row: int) -> Side:
        """The side of a box that faces down."""
        up = self.rotation[row][2]
        axis = int(np.argmax(np.abs(up)))
        return axis, -1 if up[axis] > 0 else 1

    def _roots(self, parents: dict[BodyId, BodyId]) -> list[int]:
        """The row of the topmost body that each body is attached to, directly or through others."""
        roots = []
        for body in self.bodies:
            top, seen = body.id, {body.id}
            while (above := parents.get(top, body.id)) in self.rows and above not in seen:
                seen.add(above)
                top = above
            roots.append(self.rows[top])
        return roots

    def _doors_in_walls(self, joints: list[tuple[BodyId, BodyId]]) -> Iterator[int]:
        """The bodies that are joined to a wall."""
        walls = set(np.flatnonzero(self.is_wall).tolist())
        for parent, child in joints:
            ends = {self.roots[self.rows[end]] for end in (parent, child) if end in self.rows}
            if len(ends) == 2:
                door, frame = sorted(ends, key=lambda row: (not self.bodies[row].physics.is_dynamic, self.volume[row]))
                if frame in walls:
                    yield door


def _encloses(body: Body, geometry: BodyGeometry | None) -> bool:
    return (geometry is not None and geometry.shape_name == "shell") or min(
        body.size or ASSUMED_SIZE_M
    ) > _MAX_FURNITURE_M


_PREPOSITIONS = frozenset({"of", "in", "on", "at", "for", "with", "from", "to", "by"})


def _class_nouns(cls: Iri, ancestors: tuple[Iri, ...]) -> Iterator[str]:
    """The nouns of a class: the last words of its name and of those of its superclasses, in the singular."""
    for name in (cls, *ancestors):
        parts = name_tokens(name)
        # A WallOfAConstruction is a wall, a WallClock is not, and a ShelfInABuilding is no building.
        ends = [*takewhile(lambda part: part not in _PREPOSITIONS, parts)]
        for word in ends[-1:]:
            yield from singular_forms(word)


def takes_body_color(visual: VisualMesh) -> bool:
    """Whether a color of the body replaces that of the mesh: not if it is transparent or has a picture."""
    return visual.image is None and visual.material.opacity > _SOLID_OPACITY


def _tinted(visuals: Iterable[VisualMesh], color: Color) -> tuple[VisualMesh, ...]:
    """The same meshes in another color, except transparent ones and those with a picture."""
    return tuple(
        VisualMesh(visual.points, visual.faces, replace(visual.material, color=color), visual.normals, visual.uv)
        if takes_body_color(visual)
        else visual
        for visual in visuals
    )


def _triangles_facing(visuals: Iterable[VisualMesh], side: Side) -> Iterator[VisualMesh]:
    """The triangles that face a side; they are invisible from behind."""
    axis, direction = side
    for visual in visuals:
        normal = face_cross_products(visual.points, visual.faces)
        facing = normal[:, axis] * direction > _MIN_FACING_COSINE * np.linalg.norm(normal, axis=1)
        if facing.any():
            yield VisualMesh(
                visual.points, visual.faces[facing], visual.material, visual.normals, visual.uv, visual.image
            )


def _collision_visual(shape: CollisionShape, material: PbrMaterial) -> VisualMesh:
    """A mesh of a collision shape, for bodies without visual meshes."""
    pose = normalized_pose_array(shape.pose)
    if shape.type is CollisionShapeType.HULL and (hull := convex_hull(np.array(shape.points))) is not None:
        return VisualMesh(quat_rotate(pose[3:], hull.points) + pose[:3], hull.faces.astype(np.uint32), material)
    primitive = _primitive_visual(_PRIMITIVE_OF_COLLISION_TYPE.get(shape.type, PrimitiveType.BOX), shape.size, material)
    assert primitive.normals is not None
    return VisualMesh(
        quat_rotate(pose[3:], primitive.points) + pose[:3],
        primitive.faces,
        material,
        quat_rotate(pose[3:], primitive.normals),
    )


def _schematic_visuals(body: Body) -> tuple[str, tuple[VisualMesh, ...], tuple[AttachedLight, ...]]:
    """The key and visual meshes of a translucent box with the class of a body on five of its sides."""
    size, name = body.size or ASSUMED_SIZE_M, local_name(body.cls)
    material = _SCHEMATIC if body.color is None else replace(_SCHEMATIC, color=body.color)
    return f"{name} {size} {material}", (_primitive_visual(PrimitiveType.BOX, size, material), *_labels(size, name)), ()


@lru_cache(maxsize=1024)
def _labels(size: Vector, name: str) -> tuple[VisualMesh, ...]:
    """The labels on the sides of a box, one mesh for each axis."""
    found: dict[tuple[int, float], list[Array]] = {}
    for sign, normal, right, up in _LABELED_SIDES:
        width = min(_LABEL_SHARE * size[right], _MAX_LABEL_M)
        height = min(_LABEL_SHARE * size[up], width / _LABEL_ASPECT)
        if min(width, height) < _MIN_LABEL_M:
            continue
        corner = np.zeros((4, 3))
        corner[:, normal] = sign * (size[normal] / 2 + _LABEL_GAP_M)
        # Seen from outside, the text runs to the right.
        direction = sign if (right - normal) % 3 == 1 else -sign
        corner[:, right] = direction * width * (_UNIT_SQUARE[:, 0] - 0.5)
        corner[:, up] = height * (_UNIT_SQUARE[:, 1] - 0.5)
        found.setdefault((normal, round(width / height, 2)), []).append(corner)
    return tuple(
        VisualMesh(
            np.concatenate(corners),
            np.concatenate([_SQUARE_FACES + np.uint32(4 * number) for number in range(len(corners))]),
            _LABEL,
            uv=np.tile(_UNIT_SQUARE, (len(corners), 1)),
            image=name_label(name, aspect),
        )
        for (_, aspect), corners in found.items()
    )


_UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)


@lru_cache(maxsize=4096)
def _primitive_visual(type: PrimitiveType, size: Vector, material: PbrMaterial) -> VisualMesh:
    """A mesh of a primitive shape, in the size of the body."""
    make = {PrimitiveType.CYLINDER: cylinder, PrimitiveType.SPHERE: sphere}.get(type, box)
    mesh = make(size)
    return VisualMesh(mesh.points, mesh.faces, material, mesh.normals)
