"""What a picture shows: bodies with their meshes and poses, lights, ground, labels and a camera, for any renderer.

Bodies between the camera and the room are left out: walls and ceilings that turn their back to the camera, and whatever
only they hold, such as the latch of a door in a wall, a poster, a lamp, a wall cabinet with its contents. Highlighted
and selected bodies are never left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.knowledge.shape_rules import ShapeRule
from mindstage.rendering.appearance import BodyAppearance, VisiblePart, compute_appearance
from mindstage.rendering.camera import CameraPose, corners, ground_height, initial_target
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
_MAX_FRAME_RATIO = 1.5
"""Largest ratio of the extents of a frame to those of its poster."""
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
    """Whether it casts shadows; False for ceilings, which would keep the daylight out."""
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
            casts_shadow=not _is_overhead(drawn[body.id], row),
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
    """Finds the walls and ceilings that turn their back to the camera, and the bodies that only they hold.

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
    drawn = [appearances[body.id] for body in bodies]
    current = poses or {}
    boxes = pose_array(current.get(body.id, body.pose) for body in bodies)
    rotations = rotation_matrix(normalize(boxes[:, 3:]))
    culled = np.zeros(len(bodies), dtype=bool)
    for row, each in enumerate(drawn):
        if each.side is not None:
            axis, direction = each.side
            culled[row] = float((np.array(eye) - boxes[row, :3]) @ rotations[row][:, axis]) * direction < 0.0
    links = [(link.child, link.parent) for link in world.attachments]
    links += [(joint.child, joint.parent) for joint in world.joints]
    pairs = [(rows[one], rows[other]) for one, other in links if one in rows and other in rows]
    box_corners = corners(boxes, np.array([each.size for each in drawn], dtype=float)).reshape(-1, 8, 3)
    outlines = np.array([each.part is VisiblePart.OUTLINE for each in drawn], dtype=bool)
    is_anchor = (np.array([each.is_building for each in drawn], dtype=bool) | outlines) & ~culled
    # The latch of a door in a wall is a part of the building too, but holds nothing.
    is_anchor[[rows[link.child] for link in world.attachments if link.child in rows]] = False
    low, high = box_corners.min(axis=1), box_corners.max(axis=1)
    hung = [row for row, each in enumerate(drawn) if each.side is not None and not each.is_building]
    culled |= _without_wall(hung, is_anchor & ~outlines, low, high)
    floors = np.array([each.is_floor for each in drawn], dtype=bool)
    in_walls = np.array([each.is_doorway for each in drawn], dtype=bool)
    # A pillar that is joined to such a wall is a part of it.
    in_walls[
        [one for pair in pairs for one, other in (pair, pair[::-1]) if outlines[other] and drawn[one].is_building]
    ] = True
    in_walls &= ~culled & ~outlines & ~floors
    culled |= _in_outline(in_walls, outlines, ~culled & ~outlines & ~floors & ~in_walls, low, high)
    falling = _held_only_by(culled, is_anchor, low, high, pairs)
    keep = [rows[id] for id in kept if id in rows]
    return frozenset(bodies[row].id for row in np.flatnonzero(culled | falling) if row not in keep)


def _without_wall(hung: Iterable[int], walls: NDArray[np.bool_], low: Array, high: Array) -> NDArray[np.bool_]:
    """Which of the posters, windows and lamps touch no drawn wall: theirs is an outline, or is missing in the map."""
    found = np.zeros(len(walls), dtype=bool)
    for row in hung:
        touching = np.all((low <= high[row] + _WALL_GAP_M) & (high >= low[row] - _WALL_GAP_M), axis=1) & walls
        touching[row] = False
        if not touching.any():
            # The frame of a poster is at the same place.
            shift = np.abs((low + high) / 2 - (low[row] + high[row]) / 2).max(axis=1)
            larger = (high - low).max(axis=1) > _MAX_FRAME_RATIO * (high[row] - low[row]).max()
            found |= (shift < _WALL_GAP_M) & ~larger & ~walls
    return found


def _in_outline(
    in_walls: NDArray[np.bool_], outlines: NDArray[np.bool_], others: NDArray[np.bool_], low: Array, high: Array
) -> NDArray[np.bool_]:
    """Which doors, door frames and pillars are in a wall that is drawn as an outline, and touch nothing else."""
    found = np.zeros(len(in_walls), dtype=bool)
    for row in np.flatnonzero(in_walls):
        touching = np.all((low <= high[row] + _CONTACT_M) & (high >= low[row] - _CONTACT_M), axis=1)
        found[row] = bool((touching & outlines).any()) and not (touching & others).any()
    return found


def _held_only_by(
    culled: NDArray[np.bool_],
    is_anchor: NDArray[np.bool_],
    low: Array,
    high: Array,
    links: Iterable[tuple[int, int]],
) -> NDArray[np.bool_]:
    """The bodies that are held by culled ones, and neither directly nor through others by the ground or an anchor.

    Args:
        culled: the bodies that are left out.
        is_anchor: the bodies of the building that are drawn; they hold others.
        low: the lower corners of axis-aligned bounding boxes, n x 3 [m].
        high: the upper corners.
        links: pairs of bodies that are attached or joined.
    """
    standing = low[:, 2] < np.min(low[~culled, 2], initial=np.inf) + 2 * _CONTACT_M
    linked: dict[int, set[int]] = {}
    for one, other in links:
        linked.setdefault(one, set()).add(other)
        linked.setdefault(other, set()).add(one)

    def neighbors(row: int) -> NDArray[np.intp]:
        touching = np.all((low <= high[row] + _CONTACT_M) & (high >= low[row] - _CONTACT_M), axis=1)
        touching[list(linked.get(row, ()))] = True
        return np.flatnonzero(touching & ~culled)

    falling, checked = np.zeros(len(culled), dtype=bool), np.zeros(len(culled), dtype=bool)
    for wall in np.flatnonzero(culled):
        for start in neighbors(int(wall)):
            if checked[start] or is_anchor[start]:
                continue
            group, queue, held = {int(start)}, [int(start)], False
            while queue and not held:
                row = queue.pop()
                held = bool(standing[row] or is_anchor[row])
                found = [int(each) for each in neighbors(row) if int(each) not in group]
                group.update(found)
                queue += found
            members = list(group)
            checked[start] = True
            if not held:
                falling[members] = checked[members] = True
    return falling
