"""Looks: how each body is drawn, decided from its form and from where it stands.

What a thing looks like is its form's matter. Here it is decided what would stand in the way: what encloses the whole
place is drawn only as an outline, and a wall or a ceiling only from inside the room, which leaves the view from
outside free.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.knowledge.shaping import ShapeRule
from mindstage.knowledge.shaping.words import singulars, words
from mindstage.viewport.glb import mean_colour
from mindstage.world import (
    Body,
    BodyId,
    Colour,
    Form,
    Glow,
    Iri,
    ShapeKind,
    Skin,
    Solid,
    SolidKind,
    Surface,
    Vector,
    World,
)
from mindstage.world.forms import NO_FORMS, Forms
from mindstage.world.geometry import pose_array, rotate, rotation_matrix, unit, unit_pose
from mindstage.world.hulls import hull_round
from mindstage.world.meshes import box, cylinder, sphere

__all__ = ["ASSUMED_SIZE_M", "Look", "Part", "decide_looks", "find_outlines"]

ASSUMED_SIZE_M: Vector = (0.1, 0.1, 0.1)
"""How large a body is drawn whose size nobody told [m]."""
_SPACE_M = 2.5
"""Nothing that one puts into a room is so large along all three axes."""
_THIN = 0.35
"""Of its next larger extent, at most, is the smallest of what hangs on a wall."""
_BROAD_M = 0.15
_FACING = 0.9
"""Cosine from which on a triangle looks towards a side."""
_SOLID_OPACITY = 0.6

Side = tuple[int, int]
"""A side of a box: the axis, and 1 or -1 for its direction."""

_WALL, _FLOOR, _CEILING = ["wall", "pillar", "column", "building"], ["floor", "ground"], ["ceiling", "roof"]
_HANGING = ["window", "pane", "poster", "picture", "curtain", "mirror", "blackboard", "whiteboard", "clock"]
_SHAPES = {SolidKind.SPHERE: ShapeKind.SPHERE, SolidKind.CYLINDER: ShapeKind.CYLINDER}


class Part(StrEnum):
    """How much of a body is drawn."""

    WHOLE = "whole"
    INSIDE = "inside"
    """What looks towards the room, and only seen from there."""
    OUTLINE = "outline"


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """Everything that decides how a body is drawn, but not where."""

    key: str
    """Looks of one key are the same."""
    size: Vector
    part: Part = Part.WHOLE
    building: bool = False
    """Whether it belongs to the house rather than to what is in it or hangs on its walls."""
    floor: bool = False
    skins: tuple[Skin, ...] = field(default=(), compare=False, repr=False)
    glows: tuple[Glow, ...] = field(default=(), compare=False, repr=False)
    colour: Colour = field(default=(0.8, 0.8, 0.8), compare=False)
    """Of all of it, seen from far away."""
    opaque: bool = field(default=True, compare=False)


def decide_looks(
    world: World,
    rule_of: Callable[[Iri], ShapeRule],
    ancestors: Callable[[Iri], Iterable[Iri]] = lambda cls: (),
    *,
    forms: Forms = NO_FORMS,
    shells: Iterable[BodyId] = (),
) -> dict[BodyId, Look]:
    """Decides for all bodies of a world, as it is described.

    Args:
        world: what is there.
        rule_of: what is known of the form of a class's things.
        ancestors: of a class, nearest first.
        forms: of the bodies; one without a form is its shape, in its size.
        shells: what the engine took for shells.
    """
    return _Onlooker(world, rule_of, ancestors, forms, frozenset(shells)).looks()


def find_outlines(world: World, *, forms: Forms = NO_FORMS, shells: Iterable[BodyId] = ()) -> frozenset[BodyId]:
    """The bodies of which only an outline is drawn, since they enclose the place; for the rest as in `decide_looks`."""
    told = frozenset(shells)
    return frozenset(body.id for body in world.bodies if body.id in told or _encloses(body, forms.get(body.id)))


class _Onlooker:
    """One world, as arrays, while it is decided about."""

    def __init__(
        self,
        world: World,
        rule_of: Callable[[Iri], ShapeRule],
        ancestors: Callable[[Iri], Iterable[Iri]],
        forms: Forms,
        shells: frozenset[BodyId],
    ) -> None:
        self.bodies, self.forms = world.bodies, forms
        self.rows = {body.id: row for row, body in enumerate(world.bodies)}
        classes = {body.cls for body in world.bodies}
        self.rules = {cls: rule_of(cls) for cls in classes}
        self.notions = {cls: frozenset(_nouns(cls, tuple(ancestors(cls)))) for cls in classes}
        self.is_house = self._named(_WALL + _FLOOR + _CEILING)
        self.is_wall, self.is_floor = self._named(_WALL), self._named(_FLOOR)
        self.is_around = self._named(_WALL + _CEILING + _HANGING)
        self.is_lamp = np.array([self.rules[body.cls].kind == "lamp" for body in world.bodies], dtype=bool)
        poses = pose_array(body.pose for body in world.bodies)
        self.centre, self.turn = poses[:, :3], rotation_matrix(unit(poses[:, 3:]))
        self.half = np.array([body.size or ASSUMED_SIZE_M for body in world.bodies], dtype=float).reshape(-1, 3) / 2
        self.volume = np.prod(2 * self.half, axis=1)
        outlines = find_outlines(world, forms=forms, shells=shells)
        self.is_shell = np.array([body.id in outlines for body in world.bodies], dtype=bool)
        self.is_thing = ~self.is_shell & ~self.is_house
        heights = self.centre[self.is_thing & ~self.is_lamp, 2]
        self.overhead = float(np.quantile(heights, 0.9)) if heights.size else np.inf
        self.roots = self._roots({hold.child: hold.parent for hold in world.attachments})
        self.in_walls = set(self._doors_in_walls([(joint.parent, joint.child) for joint in world.constraints]))

    def looks(self) -> dict[BodyId, Look]:
        """Of all bodies, by id."""
        return {body.id: self._look(row, body) for row, body in enumerate(self.bodies)}

    def _look(self, row: int, body: Body) -> Look:
        building = bool(self.is_house[row]) or self.roots[row] in self.in_walls
        floor, size = bool(self.is_floor[row]), body.size or ASSUMED_SIZE_M
        if self.is_shell[row]:
            return Look(key=f"outline of {size}", size=size, part=Part.OUTLINE, building=True, floor=floor)
        base, skins, glows = self._skins(body, size)
        part = Part.WHOLE
        if (side := self._only_side(row)) is not None:
            base, skins, part = f"{base} from {side}", tuple(_facing(skins, side)), Part.INSIDE
        return Look(
            key=base,
            size=size,
            part=part,
            building=building,
            floor=floor,
            skins=skins,
            glows=glows,
            colour=mean_colour(skins),
            opaque=min((skin.surface.opacity for skin in skins), default=0.0) > _SOLID_OPACITY,
        )

    def _skins(self, body: Body, size: Vector) -> tuple[str, tuple[Skin, ...], tuple[Glow, ...]]:
        """What is seen of a body, under a name of its own: its form, painted as its materials say."""
        form = self.forms.get(body.id)
        colour = next((material.colour for material in body.materials if material.colour is not None), None)
        if form is not None and form.skins:
            tinted = form.skins if colour is None else _tinted(form.skins, colour)
            return f"{form.key} {colour}", tinted, form.glows
        surface = self.rules[body.cls].substance.surface
        surface = surface if colour is None else replace(surface, colour=colour)
        if form is not None and form.solids:
            return f"{form.key} {surface}", tuple(_skin(solid, surface) for solid in form.solids), form.glows
        kind = body.shape.kind if body.shape else ShapeKind.BOX
        return f"{kind} {size} {surface}", (_plain(ShapeKind(kind), size, surface),), ()

    # -- what would stand in the way -----------------------------------------------------------------------------------

    def _named(self, nouns: Iterable[str]) -> NDArray[np.bool_]:
        """Of which bodies the class, or a class above it, has such a name."""
        wanted = frozenset(nouns)
        return np.array([bool(self.notions[body.cls] & wanted) for body in self.bodies], dtype=bool)

    def _only_side(self, row: int) -> Side | None:
        """The one side that is drawn of what would hide the room: walls and doors in them, ceilings, lamps there."""
        in_wall = self.roots[row] in self.in_walls
        if self.bodies[row].physics.simulates and not in_wall:
            return None
        thinnest, next_thinnest = np.sort(self.half[row])[:2]
        is_thin = thinnest < _THIN * next_thinnest and next_thinnest > _BROAD_M
        if is_thin and (in_wall or self.is_around[row]):
            return self._side_to_the_room(row)
        if self.is_lamp[row] and self.centre[row, 2] > self.overhead:
            return self._bottom(row)
        return None

    def _side_to_the_room(self, row: int) -> Side:
        axis = int(np.argmin(self.half[row]))
        offsets = (self.centre[self.is_thing] - self.centre[row]) @ self.turn[row][:, axis]
        return axis, 1 if np.sum(np.sign(offsets)) >= 0 else -1

    def _bottom(self, row: int) -> Side:
        """The side of a box that looks down."""
        up = self.turn[row][2]
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
                front, frame = sorted(ends, key=lambda row: (not self.bodies[row].physics.simulates, self.volume[row]))
                if frame in walls:
                    yield front


def _encloses(body: Body, form: Form | None) -> bool:
    return (form is not None and form.kind == "shell") or min(body.size or ASSUMED_SIZE_M) > _SPACE_M


def _nouns(cls: Iri, ancestors: tuple[Iri, ...]) -> Iterator[str]:
    """What things of a class are, in a word each: what its name, and those of the classes above, end with."""
    for name in (cls, *ancestors):
        parts = words(name)
        # A WallOfAConstruction is a wall, a WallClock is none.
        ends = parts[: parts.index("of")] if "of" in parts else parts
        for word in ends[-1:]:
            yield from singulars(word)


def _tinted(skins: Iterable[Skin], colour: Colour) -> tuple[Skin, ...]:
    """The same in another colour, but for what one sees through and what has a picture on it."""
    return tuple(
        skin
        if skin.image is not None or skin.surface.opacity <= _SOLID_OPACITY
        else Skin(skin.points, skin.faces, replace(skin.surface, colour=colour), skin.normals)
        for skin in skins
    )


def _facing(skins: Iterable[Skin], side: Side) -> Iterator[Skin]:
    """The triangles that look towards a side; from behind, they are not there."""
    axis, direction = side
    for skin in skins:
        first, second, third = (skin.points[skin.faces[:, corner]] for corner in range(3))
        normal = np.cross(second - first, third - first)
        towards = normal[:, axis] * direction > _FACING * np.linalg.norm(normal, axis=1)
        if towards.any():
            yield Skin(skin.points, skin.faces[towards], skin.surface, skin.normals, skin.uv, skin.image)


def _skin(solid: Solid, surface: Surface) -> Skin:
    """What can be touched, where nobody told what is seen."""
    place = unit_pose(solid.pose)
    if solid.kind is SolidKind.HULL and (hull := hull_round(np.array(solid.points))) is not None:
        return Skin(rotate(place[3:], hull.points) + place[:3], hull.faces.astype(np.uint32), surface)
    made = _plain(_SHAPES.get(solid.kind, ShapeKind.BOX), solid.size, surface)
    assert made.normals is not None
    return Skin(rotate(place[3:], made.points) + place[:3], made.faces, surface, rotate(place[3:], made.normals))


@lru_cache(maxsize=4096)
def _plain(kind: ShapeKind, size: Vector, surface: Surface) -> Skin:
    """A body of which nothing is known but its shape, with edges slightly rounded."""
    make = {ShapeKind.CYLINDER: cylinder, ShapeKind.SPHERE: sphere}.get(kind, box)
    mesh = make(size)
    return Skin(mesh.points, mesh.faces, surface, mesh.normals)
