"""Looks: how each body is drawn, decided from what it is and where it stands.

A map knows boxes; drawn as boxes, a kitchen is a heap of blocks with everything inside them hidden. So what holds
something is drawn open on the side from which one reaches in, what encloses the whole place only as an outline, and a
wall only from the side of the room, which leaves the view from outside free.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from enum import Enum

import msgspec
import numpy as np

from mindstage.viewport.forms import Hole, Side
from mindstage.viewport.palette import Paint, Surface, paint, surface, words
from mindstage.world import Body, BodyId, Iri, ShapeKind, Vector, World
from mindstage.world.geometry import Array, pose_array, rotation_matrix, unit

__all__ = ["ASSUMED_SIZE_M", "Form", "Look", "decide_looks"]

ASSUMED_SIZE_M: Vector = (0.1, 0.1, 0.1)
"""How large a body is drawn whose size nobody told [m]."""

_SPACE_M = 2.5
"""Nothing that one puts into a room is so large along all three axes."""
_LID_SHARE = 0.5
_TOUCH_M = 0.02

_OPEN_AT_THE_TOP = frozenset("basket bin breadbasket crate drawer rack sink tray bucket".split())
_FEET = {"bowl": 0.5, "plate": 0.6, "saucer": 0.6, "dish": 0.6, "cup": 0.75, "pan": 0.85, "vase": 0.8, "mug": 0.95}
_VESSELS = frozenset("colander glass jug pitcher pot teapot drinkingvessel".split()) | _FEET.keys()
_ROUND = frozenset("bottle can carafe jar column".split())
_BALLS = frozenset("apple ball egg lemon onion orange potato tomato".split())


class Form(Enum):
    """Which mesh a body gets."""

    BOX = "box"
    OPEN_BOX = "open box"
    CYLINDER = "cylinder"
    VESSEL = "vessel"
    BALL = "ball"
    INSIDE = "inside"
    """One side of a box, seen only from where that side faces."""
    OUTLINE = "outline"


class Look(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that decides how a body is drawn, but not where."""

    form: Form
    size: Vector
    paint: Paint
    openings: tuple[Side, ...] = ()
    """The sides without a wall; of `INSIDE`, the one side that is drawn."""
    levels: tuple[float, ...] = ()
    """Heights of shelves [m, from the centre]."""
    holes: tuple[Hole, ...] = ()
    """In the top."""
    foot: float = 1.0
    """Of a vessel: the radius at its foot against the one at its rim."""


def decide_looks(
    world: World, ancestors: Callable[[Iri], Iterable[Iri]], *, shells: Iterable[BodyId] = ()
) -> dict[BodyId, Look]:
    """Decides for all bodies of a world, as it stands.

    Args:
        world: what is there, at the poses it was described with.
        ancestors: of a class, nearest first.
        shells: what the engine took for shells.
    """
    return _Onlooker(world, ancestors, frozenset(shells)).looks()


class _Onlooker:
    """One world, as arrays, while it is decided about."""

    def __init__(
        self, world: World, ancestors: Callable[[Iri], Iterable[Iri]], shells: frozenset[BodyId]
    ) -> None:
        self.world = world
        self.rows = {body.id: row for row, body in enumerate(world.bodies)}
        self.ancestors = {cls: tuple(ancestors(cls)) for cls in {body.cls for body in world.bodies}}
        self.surfaces = [surface(body.cls, self.ancestors[body.cls]) for body in world.bodies]
        poses = pose_array(body.pose for body in world.bodies)
        sizes = [body.size or ASSUMED_SIZE_M for body in world.bodies]
        self.half = np.array(sizes, dtype=np.float64).reshape(-1, 3) / 2
        self.centre = poses[:, :3]
        self.turn = rotation_matrix(unit(poses[:, 3:]))
        self.is_shell = np.array([body.id in shells for body in world.bodies], dtype=bool) | self._enclosing()
        self.roots, self.groups = self._assemblies()
        self.fronts = self._fronts()

    def looks(self) -> dict[BodyId, Look]:
        return {body.id: self._look(row, body) for row, body in enumerate(self.world.bodies)}

    def _look(self, row: int, body: Body) -> Look:
        size = body.size or ASSUMED_SIZE_M
        painted = paint(body.cls, self.ancestors[body.cls], body.materials)
        if self.is_shell[row]:
            return Look(form=Form.OUTLINE, size=size, paint=painted)
        if self.surfaces[row] in (Surface.WALL, Surface.CEILING) and body.physics.simulates is False:
            return Look(form=Form.INSIDE, size=size, paint=painted, openings=(self._side_to_the_room(row),))
        form, foot = self._form(body)
        if form is Form.BOX or form is Form.OPEN_BOX:
            openings, levels = self._openings(row, wanted=form is Form.OPEN_BOX)
            form = Form.OPEN_BOX if openings else Form.BOX
            return Look(form=form, size=size, paint=painted, openings=openings, levels=levels)
        return Look(form=form, size=size, paint=painted, foot=foot)

    def _form(self, body: Body) -> tuple[Form, float]:
        names = [word for cls in (body.cls, *self.ancestors[body.cls]) for word in reversed(words(cls))]
        kind = body.shape.kind if body.shape else None
        telling = next((word for word in names if word in _VESSELS | _ROUND | _BALLS | _OPEN_AT_THE_TOP), "")
        if kind is ShapeKind.SPHERE:
            return Form.BALL, 1.0
        if telling in _VESSELS and kind is not ShapeKind.BOX:
            return Form.VESSEL, _FEET.get(telling, 1.0)
        if kind is ShapeKind.CYLINDER or (telling in _ROUND and kind is None):
            return Form.CYLINDER, 1.0
        if telling in _BALLS and kind is None:
            return Form.BALL, 1.0
        return Form.OPEN_BOX if telling in _OPEN_AT_THE_TOP else Form.BOX, 1.0

    # -- the whole place -------------------------------------------------------------------------------------

    def _enclosing(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Which bodies are spaces rather than things, whatever the engine says."""
        return np.asarray(np.all(2 * self.half > _SPACE_M, axis=1))

    def _side_to_the_room(self, row: int) -> Side:
        """The broad side of a wall or ceiling that faces most of what stands there."""
        axis = int(np.argmin(self.half[row]))
        things = ~self.is_shell & np.array([made not in _BUILDING for made in self.surfaces])
        offsets = (self.centre[things] - self.centre[row]) @ self.turn[row][:, axis]
        return axis, 1 if np.sum(np.sign(offsets)) >= 0 else -1

    def _assemblies(self) -> tuple[list[int], dict[int, list[int]]]:
        """Of each body, the body that it finally hangs on; and of each of those, all that hang on it."""
        parents = {hold.child: hold.parent for hold in self.world.attachments}
        roots = []
        for body in self.world.bodies:
            top, seen = body.id, {body.id}
            while (above := parents.get(top)) in self.rows and above is not None and above not in seen:
                top = above
                seen.add(above)
            roots.append(self.rows[top])
        groups: dict[int, list[int]] = {}
        for row, root in enumerate(roots):
            groups.setdefault(root, []).append(row)
        return roots, groups

    # -- what is open ----------------------------------------------------------------------------------------

    def _fronts(self) -> dict[int, list[list[int]]]:
        """Of each assembly, the assemblies that are hinged on it or slide in it."""
        fronts: dict[int, list[list[int]]] = {}
        for joint in self.world.constraints:
            ends = [self.roots[self.rows[end]] for end in (joint.parent, joint.child) if end in self.rows]
            if len(ends) == 2 and ends[0] != ends[1]:
                frame, front = sorted(ends, key=self._heft, reverse=True)
                fronts.setdefault(frame, []).append(self.groups[front])
        return fronts

    def _heft(self, row: int) -> tuple[bool, float]:
        return not self.world.bodies[row].physics.simulates, float(np.prod(self.half[row]))

    def _openings(self, row: int, *, wanted: bool) -> tuple[tuple[Side, ...], tuple[float, ...]]:
        """The sides of a box that are drawn open, and the shelves in it."""
        centre, half = self.centre[row], self.half[row]
        if self.surfaces[row] in _BUILDING or half.min() < 0.01:
            return (), ()
        up = self.turn[row][2]
        vertical = int(np.argmax(np.abs(up)))
        top: Side = (vertical, 1 if up[vertical] > 0 else -1)
        closed_by = (self._closes(row, front, top) for front in self.fronts.get(self.roots[row], ()))
        sides = sorted({side for side in closed_by if side is not None})
        if wanted:
            return (top,), ()
        inside = self._inside(row)
        if not (sides or inside.any()):
            return (), ()
        bottoms = ((self.centre[inside] - centre) @ self.turn[row] - self._reach(row, inside))[:, 2]
        levels = tuple(sorted({round(float(level), 2) for level in bottoms if level > 0.06 - half[2]}))
        return tuple(sides or [top]), levels if sides and vertical == 2 else ()

    def _inside(self, row: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Which loose things are in a box."""
        local = np.abs((self.centre - self.centre[row]) @ self.turn[row])
        smaller = np.prod(self.half, axis=1) < 0.5 * np.prod(self.half[row])
        loose = np.array([body.physics.simulates for body in self.world.bodies], dtype=bool)
        hinged = {member for fronts in self.fronts.values() for front in fronts for member in front}
        loose[list(hinged)] = False
        return np.asarray(np.all(local < self.half[row], axis=1) & smaller & loose)

    def _closes(self, row: int, front: list[int], top: Side) -> Side | None:
        """Which side of a box a door or drawer closes, with all that hangs on it; None if it is elsewhere."""
        half = self.half[row]
        middle = (self.centre[front] - self.centre[row]) @ self.turn[row]
        reach = self._reach(row, np.array(front))
        low, high = (middle - reach).min(axis=0), (middle + reach).max(axis=0)
        if np.any(low > half + _TOUCH_M) or np.any(high < -half - _TOUCH_M):
            return None
        gaps = {(axis, sign): float((half - high if sign > 0 else half + low)[axis]) for axis in range(3) for sign in (1, -1)}
        del gaps[(top[0], -top[1])]
        others = [axis for axis in range(3) if axis != top[0]]
        if float(np.prod((high - low)[others])) < _LID_SHARE * float(np.prod(2 * half[others])):
            del gaps[top]
        side = min(gaps, key=lambda side: gaps[side])
        across = [axis for axis in range(3) if axis != side[0]]
        centred = np.all(np.abs((low + high)[across] / 2) < half[across])
        return side if centred else None

    def _reach(self, row: int, others: Array | np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Array:
        """Half the extents of other bodies along the axes of one."""
        turn = np.abs(self.turn[row].T @ self.turn[others])
        return np.asarray(np.einsum("nij,nj->ni", turn, self.half[others]))


_BUILDING = frozenset({Surface.WALL, Surface.FLOOR, Surface.CEILING, Surface.GLASS})

