"""What a picture shows: bodies with their meshes and poses, lights, ground, labels and a camera, for any renderer.

Bodies between the camera and the room are left out: walls and ceilings that turn their back to the camera, what is flat
against them, and whatever only they hold, such as the latch of a door in a wall, a lamp, a wall cabinet with its
contents. So are windows, posters and lamps where the map has no wall. What is highlighted or selected stays.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.knowledge.shape_rules import ShapeRule
from mindstage.rendering.appearance import BodyAppearance, VisiblePart, compute_appearance
from mindstage.rendering.camera import CameraPose, ground_height, initial_target
from mindstage.scene import (
    AttachedLight,
    BodyId,
    Color,
    Iri,
    Light,
    LightType,
    Pose,
    Vector,
    VisualMesh,
    World,
)
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, connected_groups, overlapping_pairs
from mindstage.scene.geometry import GeometryMap
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_multiply,
    rotation_matrix,
)

__all__ = [
    "ClassKnowledge",
    "RenderItem",
    "RenderLabel",
    "RenderLight",
    "RenderScene",
    "described_world",
    "find_culled",
    "render_scene",
]


_DOWN_COSINE = 0.7
_WALL_GAP_M = 0.1
"""Largest gap between a wall and what is mounted on it [m]."""
_PARALLEL_COSINE = 0.95
"""Least cosine between the normals of a wall and of what is flat against it."""
_LEAST_CARRIER = 0.5
"""Least ratio of the largest extents of what carries a body to that of the body."""
_CONTACT_M = 0.03
"""Largest gap between bodies that hold each other [m]."""


class ClassKnowledge(Protocol):
    """What the appearance of bodies needs of a `KnowledgeBase`."""

    def shape_rule(self, cls: Iri, /) -> ShapeRule:
        """The shape rule of a class."""

    def ancestors(self, cls: Iri, /) -> Iterable[Iri]:
        """The superclasses of a class, nearest first."""


class RenderItem(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A body in a picture."""

    id: BodyId
    visuals: tuple[VisualMesh, ...]
    """Whole meshes in the body frame; empty for bodies that enclose the scene, which no picture shows."""
    pose: Pose
    """In the world frame, with a unit quaternion."""
    size: Vector
    """Extents along the axes of the body [m]."""
    key: str = ""
    """Equal for items whose visuals are equal."""
    highlight: Color | None = None
    """The color of a highlighted body."""
    shown: bool = True
    """Whether it is drawn; False for what would block the view, for outlines and for hidden bodies."""
    is_building: bool = False
    """Whether it is part of the building: a wall, a floor, a ceiling, a door in a wall."""
    casts_shadow: bool = True
    """Whether it casts shadows; False for ceilings, which would keep the daylight out, and for schematic boxes."""
    is_marker: bool = False
    """Whether it is no body but a visualization marker, which keeps its color and opacity beside highlighted bodies."""


class RenderLight(msgspec.Struct, frozen=True, kw_only=True):
    """A light source in the world frame."""

    type: LightType
    pose: Pose
    """Spot and directional lights point along its negative z axis."""
    color: Color
    intensity: float
    """[cd] for point and spot lights, [lx] for directional lights."""


class RenderLabel(msgspec.Struct, frozen=True, kw_only=True):
    """A text at a point."""

    text: str
    point: Vector
    """The center of the body [m]."""
    id: BodyId
    """The labeled body."""
    radius: float = 0.0
    """Distance from the point to the farthest corner of the body [m]."""


class RenderScene(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All that a picture shows."""

    items: tuple[RenderItem, ...]
    lights: tuple[RenderLight, ...]
    """The lights of the map and of shown bodies, without the sky and the sun, which the renderer chooses."""
    ground_height: float | None
    """Height of the ground plane [m]; None if the world has a floor."""
    camera: CameraPose
    labels: tuple[RenderLabel, ...] = ()
    selected: BodyId | None = None
    """The body that is outlined."""
    clip_height: float | None = None
    """Nothing above this height is drawn [m]."""


def described_world(current: World, worlds: Iterable[World]) -> World:
    """The current bodies at the poses of the spawned worlds, which joints and enclosures are derived from.

    Args:
        current: a snapshot.
        worlds: the worlds that were spawned.
    """
    described = {body.id: body.pose for world in worlds for body in world.bodies}
    bodies = (msgspec.structs.replace(body, pose=described.get(body.id, body.pose)) for body in current.bodies)
    return msgspec.structs.replace(current, bodies=tuple(bodies))


def render_scene(
    world: World,
    geometry: GeometryMap,
    knowledge: ClassKnowledge,
    *,
    camera: CameraPose | None = None,
    aspect: float = 1.6,
    poses: Mapping[BodyId, Pose] | None = None,
    enclosing: Collection[BodyId] = (),
    highlights: Mapping[BodyId, Color] | None = None,
    selected: BodyId | None = None,
    labels: Mapping[BodyId, str] | None = None,
    hidden: Collection[BodyId] = (),
    clip_height: float | None = None,
    appearances: Mapping[BodyId, BodyAppearance] | None = None,
    ghosts: Iterable[RenderItem] = (),
) -> RenderScene:
    """Decides what a picture of a world shows.

    Args:
        world: the world, with the poses of its description, from which joints and enclosures are derived.
        geometry: the geometry of its bodies.
        knowledge: the knowledge base of the world's classes.
        camera: the camera; by default the initial one.
        aspect: the aspect ratio of the picture (width / height), for the initial camera.
        poses: the current poses of bodies that have moved.
        enclosing: bodies that the engine reported as enclosures.
        highlights: the color of each highlighted body.
        selected: the body that is outlined.
        labels: the text of each labeled body.
        hidden: bodies that are not drawn.
        clip_height: nothing above this height is drawn [m].
        appearances: the result of `compute_appearance` for this world, if it is known already.
        ghosts: further items, such as translucent copies of bodies at other poses.
    """
    drawn = appearances
    if drawn is None:
        drawn = compute_appearance(
            world, knowledge.shape_rule, knowledge.ancestors, geometry=geometry, enclosing=enclosing
        )
    camera = camera or initial_target(world, drawn).upright_camera(aspect)
    current = poses or {}
    bodies = [body for body in world.bodies if body.id in drawn]
    rows = pose_array(current.get(body.id, body.pose) for body in bodies).reshape(-1, 7)
    rows[:, 3:] = normalize(rows[:, 3:])
    colors, names = highlights or {}, labels or {}
    kept = frozenset(colors) | ({selected} if selected is not None else frozenset())
    culled = find_culled(world, drawn, camera.position, poses=current, kept=kept) | frozenset(hidden)
    items = tuple(
        RenderItem(
            id=body.id,
            visuals=drawn[body.id].whole_visuals,
            pose=pose_from_array(row),
            size=drawn[body.id].size,
            key=drawn[body.id].key,
            highlight=colors.get(body.id),
            shown=body.id not in culled and drawn[body.id].part is not VisiblePart.OUTLINE,
            is_building=drawn[body.id].is_building,
            casts_shadow=not drawn[body.id].is_schematic and not _is_overhead(drawn[body.id], row),
        )
        for body, row in zip(bodies, rows, strict=True)
    )
    return RenderScene(
        items=(*items, *ghosts),
        lights=(*map(_map_light, world.lights), *_attached_lights(items, drawn)),
        ground_height=ground_height(world, drawn),
        camera=camera,
        labels=tuple(
            RenderLabel(
                text=names[item.id], point=item.pose.position, id=item.id, radius=float(np.linalg.norm(item.size)) / 2
            )
            for item in items
            if item.id in names and item.shown
        ),
        selected=selected,
        clip_height=clip_height,
    )


def _is_overhead(appearance: BodyAppearance, pose: Array) -> bool:
    """Whether only the lower side of a body faces the room."""
    if appearance.side is None:
        return False
    axis, direction = appearance.side
    return float(rotation_matrix(pose[None, 3:])[0][2, axis]) * direction < -_DOWN_COSINE


def _map_light(light: Light) -> RenderLight:
    return RenderLight(type=light.type, pose=light.pose, color=light.color, intensity=light.intensity)


def _attached_lights(
    items: Iterable[RenderItem], appearances: Mapping[BodyId, BodyAppearance]
) -> Iterable[RenderLight]:
    """The lights of bodies, also of those that are left out: a ceiling lamp lights a room seen from above."""
    for item in items:
        for light in appearances[item.id].lights:
            yield RenderLight(
                type=light.type, pose=_in_world(item.pose, light), color=light.color, intensity=light.intensity
            )


def _in_world(pose: Pose, light: AttachedLight) -> Pose:
    return pose_from_array(pose_multiply(normalized_pose_array(pose), normalized_pose_array(light.pose)))


# -- bodies between the camera and the room ----------------------------------------------------------------------------


def find_culled(
    world: World,
    appearances: Mapping[BodyId, BodyAppearance],
    eye: Vector,
    *,
    poses: Mapping[BodyId, Pose] | None = None,
    kept: Collection[BodyId] = (),
) -> frozenset[BodyId]:
    """Finds the walls and ceilings that turn their back to the camera, and the bodies that nothing drawn holds.

    These are what is flat against such a wall, windows, posters and lamps whose wall is not drawn or not in the map,
    and whatever only they hold.

    Args:
        world: the world, with the poses of its description.
        appearances: how its bodies are drawn.
        eye: position of the camera [m].
        poses: the current poses of bodies that have moved.
        kept: bodies that are drawn in any case, together with what they are attached to.
    """
    bodies = [body for body in world.bodies if body.id in appearances]
    if not bodies:
        return frozenset()
    rows = {body.id: row for row, body in enumerate(bodies)}
    current = poses or {}
    placed = pose_array(current.get(body.id, body.pose) for body in bodies)
    placed[:, 3:] = normalize(placed[:, 3:])
    links = [(link.child, link.parent) for link in world.attachments]
    links += [(joint.child, joint.parent) for joint in world.joints]
    linked = np.array([(rows[one], rows[other]) for one, other in links if one in rows and other in rows], np.intp)
    # The latch of a door in a wall is a part of the building too, but holds nothing.
    parts = [rows[link.child] for link in world.attachments if link.child in rows]
    solver = _CullingSolver([appearances[body.id] for body in bodies], placed, linked.reshape(-1, 2), parts)
    culled = solver.culled(np.array(eye))
    keep = [rows[id] for id in kept if id in rows]
    return frozenset(bodies[row].id for row in np.flatnonzero(culled) if row not in keep)


class _CullingSolver:
    """Finds the bodies that are not drawn; masks have one value per body."""

    def __init__(
        self, drawn: Sequence[BodyAppearance], poses: Array, links: NDArray[np.intp], parts: list[int]
    ) -> None:
        """Finds what touches what.

        Args:
            drawn: how the bodies are drawn.
            poses: with unit quaternions, n x 7.
            links: the rows of bodies that are attached or joined, m x 2.
            parts: the rows of bodies that are attached to others.
        """
        self.drawn, self.links = drawn, links
        self.sizes = np.array([each.size for each in drawn], dtype=float)
        self.boxes = OrientedBoxes.from_poses(poses, self.sizes)
        self.low, self.high = self.boxes.bounds()
        self.outlines = self._mask(each.part is VisiblePart.OUTLINE for each in drawn)
        self.building = self._mask(each.is_building for each in drawn)
        self.floors = self._mask(each.is_floor for each in drawn)
        self.is_part = np.zeros(len(drawn), dtype=bool)
        self.is_part[parts] = True
        self.is_hung = self._mask(each.side is not None for each in drawn) & ~self.building
        self.is_flat = self._mask(each.mounted_axis is not None for each in drawn)
        self.is_hung_by_shape = self._mask(each.is_hung for each in drawn) & ~self.is_hung
        self.a, self.b = self._near_pairs()

    def culled(self, eye: Array) -> NDArray[np.bool_]:
        """The bodies that are not drawn from where a camera is."""
        culled = self._turned_away(eye)
        culled |= self._flat_against(culled & self.building)
        # What is left of the building holds others.
        anchors = (self.building | self.outlines) & ~culled & ~self.is_part
        culled |= self._without_wall(culled, anchors & ~self.outlines & ~self.floors)
        in_walls = self._mask(each.is_doorway for each in self.drawn)
        # A pillar that is joined to such a wall is a part of it.
        for one, other in ((0, 1), (1, 0)):
            in_walls[self.links[self.outlines[self.links[:, other]] & self.building[self.links[:, one]], one]] = True
        in_walls &= ~culled & ~self.outlines & ~self.floors
        culled |= self._in_outline(in_walls, ~culled & ~self.outlines & ~self.floors & ~in_walls)
        return culled | self._held_only_by(culled, anchors)

    def _mask(self, values: Iterable[bool]) -> NDArray[np.bool_]:
        return np.fromiter(values, dtype=bool, count=len(self.drawn))

    def _near_pairs(self) -> tuple[Indices, Indices]:
        """The rows of bodies whose bounds are at most `_WALL_GAP_M` apart, each pair in both orders."""
        everything = np.ones(len(self.drawn), dtype=bool)
        found = list(overlapping_pairs(self.boxes, everything, everything, margin=(_WALL_GAP_M,) * 3))
        a = np.concatenate([np.zeros(0, np.intp), *(one for one, _ in found)])
        b = np.concatenate([np.zeros(0, np.intp), *(other for _, other in found)])
        # What is in the middle of an outlined room is at none of its walls.
        apart = self._is_inside(a, b) | self._is_inside(b, a)
        a, b = a[~apart], b[~apart]
        return np.concatenate([a, b]), np.concatenate([b, a])

    def _is_inside(self, inner: Indices, outer: Indices) -> NDArray[np.bool_]:
        """Which bodies are inside of outlines, and do not touch them."""
        distance = np.minimum(self.low[inner] - self.low[outer], self.high[outer] - self.high[inner])
        return np.asarray(self.outlines[outer] & (distance > _CONTACT_M).all(axis=1))

    def _touching(self) -> NDArray[np.bool_]:
        """Which of the near pairs are at most `_CONTACT_M` apart."""
        gaps = np.maximum(self.low[self.a] - self.high[self.b], self.low[self.b] - self.high[self.a])
        return np.asarray((gaps <= _CONTACT_M).all(axis=1))

    def _any_near(self, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The bodies that are the first ones of some of the near pairs."""
        found = np.zeros(len(self.drawn), dtype=bool)
        found[self.a[near]] = True
        return found

    def _turned_away(self, eye: Array) -> NDArray[np.bool_]:
        """The one-sided bodies of which the camera sees the back."""
        found = np.zeros(len(self.drawn), dtype=bool)
        for row, each in enumerate(self.drawn):
            if each.side is not None:
                axis, direction = each.side
                found[row] = float((eye - self.boxes.center[row]) @ self.boxes.rotation[row][:, axis]) * direction < 0.0
        return found

    def _flat_against(self, walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The bodies that are flat against some of these walls and ceilings, also without an attachment."""
        axes = np.array([each.mounted_axis or 0 for each in self.drawn], dtype=np.intp)
        sides = np.array([0 if each.side is None else each.side[0] for each in self.drawn], dtype=np.intp)
        chosen = self.is_flat[self.a] & walls[self.b]
        flat, wall = self.a[chosen], self.b[chosen]
        normal, of_wall = self.boxes.rotation[flat, :, axes[flat]], self.boxes.rotation[wall, :, sides[wall]]
        found = np.zeros(len(self.drawn), dtype=bool)
        found[flat[np.abs(np.einsum("ni,ni->n", normal, of_wall)) > _PARALLEL_COSINE]] = True
        return found

    def _without_wall(self, culled: NDArray[np.bool_], walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which of the posters, windows and lamps touch no drawn wall: theirs is an outline, or is missing in the map.

        What seems to be one by its shape may also stand on something, or touch what is large enough to carry it.
        """
        hung = self.is_hung | self.is_hung_by_shape
        held = self._any_near(walls[self.b])
        largest, carriers = self.sizes.max(axis=1), ~hung & ~culled & ~self.outlines
        is_large = largest[self.b] > _LEAST_CARRIER * largest[self.a]
        on_top = np.abs(self.low[self.a, 2] - self.high[self.b, 2]) < _CONTACT_M
        carried = carriers[self.b] & is_large & (self.is_hung_by_shape[self.a] | on_top)
        held |= self._any_near(carried & self._touching())
        for one, other in (self.links.T, self.links[:, ::-1].T):
            held[one[carriers[other]]] = True
        held |= self.is_hung_by_shape & self._standing(culled)
        # A poster and its frame are held together.
        joined = hung[self.a] & hung[self.b] & self._touching()
        groups = connected_groups(len(self.drawn), self.a[joined], self.b[joined])
        return hung & ~np.isin(groups, groups[hung & held])

    def _in_outline(self, in_walls: NDArray[np.bool_], others: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which doors, door frames and pillars are in a wall that is drawn as an outline, and touch nothing else."""
        touching = self._touching()
        return in_walls & self._any_near(touching & self.outlines[self.b]) & ~self._any_near(touching & others[self.b])

    def _standing(self, culled: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The bodies that stand on the lowest level of what is drawn."""
        return np.asarray(self.low[:, 2] < np.min(self.low[~culled, 2], initial=np.inf) + 2 * _CONTACT_M)

    def _held_only_by(self, culled: NDArray[np.bool_], anchors: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The bodies that culled ones hold, and neither directly nor through others the ground or an anchor."""
        touching = self._touching()
        one = np.concatenate([self.a[touching], self.links[:, 0], self.links[:, 1]])
        other = np.concatenate([self.b[touching], self.links[:, 1], self.links[:, 0]])
        both = ~culled[one] & ~culled[other]
        groups = connected_groups(len(self.drawn), one[both], other[both])
        held = groups[(self._standing(culled) | anchors) & ~culled]
        return ~culled & np.isin(groups, groups[one[~culled[one] & culled[other]]]) & ~np.isin(groups, held)
