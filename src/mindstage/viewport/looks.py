"""Looks: how each body is drawn, decided from what it is and where it stands.

A map knows boxes; drawn as boxes, a kitchen is a heap of blocks with everything inside them hidden. So what holds
something is drawn open on the side from which one reaches in, what encloses the whole place only as an outline, and a
wall or a ceiling only from inside the room, which leaves the view from outside free.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import Enum

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.viewport.forms import Hole, Side
from mindstage.viewport.palette import Paint, Surface, nouns, paint, surface
from mindstage.world import Body, BodyId, Iri, ShapeKind, Vector, World
from mindstage.world.geometry import Array, pose_array, rotation_matrix, unit

__all__ = ["ASSUMED_SIZE_M", "Form", "Look", "decide_looks"]

ASSUMED_SIZE_M: Vector = (0.1, 0.1, 0.1)
"""How large a body is drawn whose size nobody told [m]."""
_SPACE_M = 2.5
"""Nothing that one puts into a room is so large along all three axes."""
_LID_SHARE = 0.5
"""So much of the top a lid covers."""
_DEPTH_COUNTS = 0.02
"""Of two sides that a front is equally close to, it closes the one across which it is thin."""
_TOUCH_M = 0.02
_BROAD_M = 0.15
_SMALLEST_BOX_M = 0.08
"""Nobody reaches into anything smaller."""

_OPEN_AT_THE_TOP = {"basket", "bin", "breadbasket", "bucket", "crate", "drawer", "rack", "sink", "tray", "washbasin"}
_FEET = {"bowl": 0.5, "cup": 0.75, "dish": 0.6, "mug": 0.95, "pan": 0.85, "plate": 0.6, "saucer": 0.6, "vase": 0.8}
_VESSELS = {"casserole", "colander", "glass", "jug", "pitcher", "saucepan", "tumbler", "vessel"} | _FEET.keys()
_ROUND = {"bottle", "can", "carafe", "column", "jar", "mill", "papertowel", "shaker", "tin"}
_BALLS = {"apple", "ball", "egg", "lemon", "lettuce", "onion", "orange", "plant", "potato", "tomato"}
_TELLING = _OPEN_AT_THE_TOP | _VESSELS | _ROUND | _BALLS
_BUILDING = frozenset({Surface.WALL, Surface.FLOOR, Surface.CEILING})

_AROUND = frozenset({Surface.WALL, Surface.CEILING, Surface.GLASS, Surface.PAPER})
"""What stands round a room or hangs on its walls, where it is thin and nobody can take it away."""


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
    building: bool = False
    """Whether it belongs to the house rather than to what is in it or hangs on its walls."""
    floor: bool = False


def decide_looks(
    world: World, ancestors: Callable[[Iri], Iterable[Iri]], *, shells: Iterable[BodyId] = ()
) -> dict[BodyId, Look]:
    """Decides for all bodies of a world, as it is described.

    Args:
        world: what is there.
        ancestors: of a class, nearest first.
        shells: what the engine took for shells.
    """
    return _Onlooker(world, ancestors, frozenset(shells)).looks()


class _Onlooker:
    """One world, as arrays, while it is decided about."""

    def __init__(self, world: World, ancestors: Callable[[Iri], Iterable[Iri]], shells: frozenset[BodyId]) -> None:
        self.bodies = world.bodies
        self.rows = {body.id: row for row, body in enumerate(world.bodies)}
        self.ancestors = {cls: tuple(ancestors(cls)) for cls in {body.cls for body in world.bodies}}
        self.surfaces = [surface(body.cls, self.ancestors[body.cls]) for body in world.bodies]
        poses = pose_array(body.pose for body in world.bodies)
        self.centre, self.turn = poses[:, :3], rotation_matrix(unit(poses[:, 3:]))
        self.half = np.array([body.size or ASSUMED_SIZE_M for body in world.bodies], dtype=float).reshape(-1, 3) / 2
        self.volume = np.prod(2 * self.half, axis=1)
        named = np.array([body.id in shells for body in world.bodies], dtype=bool)
        self.is_shell = named | np.all(2 * self.half > _SPACE_M, axis=1)
        self.is_thing = ~self.is_shell & np.array([made not in _BUILDING for made in self.surfaces], dtype=bool)
        lamps = np.array([made is Surface.LAMP for made in self.surfaces], dtype=bool)
        heights = self.centre[self.is_thing & ~lamps, 2]
        self.overhead = float(np.quantile(heights, 0.9)) if heights.size else np.inf
        self.roots = self._roots({hold.child: hold.parent for hold in world.attachments})
        self.fronts = self._fronts([(joint.parent, joint.child) for joint in world.constraints])
        walls = {row for row, made in enumerate(self.surfaces) if made is Surface.WALL}
        self.in_walls = {int(front[0]) for frame in walls for front in self.fronts.get(frame, ())}
        self.is_loose = self._loose()
        self.loose = np.flatnonzero(self.is_loose)
        self.forms = [self._form(body) for body in world.bodies]
        self.sunk = [row for row, form in enumerate(self.forms) if form is Form.OPEN_BOX and not self.is_loose[row]]

    def looks(self) -> dict[BodyId, Look]:
        """Of all bodies, by id."""
        return {body.id: self._look(row, body) for row, body in enumerate(self.bodies)}

    def _look(self, row: int, body: Body) -> Look:
        size, made_of, form = body.size or ASSUMED_SIZE_M, self.surfaces[row], self.forms[row]
        painted = paint(body.cls, self.ancestors[body.cls], body.materials)
        building = made_of in _BUILDING or self.roots[row] in self.in_walls
        look = Look(form=form, size=size, paint=painted, building=building, floor=made_of is Surface.FLOOR)
        if self.is_shell[row]:
            return replace(look, form=Form.OUTLINE, building=True)
        if (side := self._only_side(row)) is not None:
            return replace(look, form=Form.INSIDE, openings=(side,))
        if form not in (Form.BOX, Form.OPEN_BOX):
            return replace(look, foot=next((_FEET[noun] for noun in self._nouns(body) if noun in _FEET), 1.0))
        openings, levels = self._openings(row)
        form = Form.OPEN_BOX if openings else Form.BOX
        holes = () if (2, 1) in openings else self._holes(row)
        return replace(look, form=form, openings=openings, levels=levels, holes=holes)

    # -- what it is ------------------------------------------------------------------------------------------

    def _nouns(self, body: Body) -> tuple[str, ...]:
        return nouns(body.cls, self.ancestors[body.cls])

    def _form(self, body: Body) -> Form:
        kind = body.shape.kind if body.shape else None
        noun = next((noun for noun in self._nouns(body) if noun in _TELLING), "")
        if noun in _VESSELS and kind in (None, ShapeKind.CYLINDER):
            return Form.VESSEL
        if kind is ShapeKind.CYLINDER or (noun in _ROUND and kind is None):
            return Form.CYLINDER
        if kind is ShapeKind.SPHERE or (noun in _BALLS and kind is None):
            return Form.BALL
        return Form.OPEN_BOX if noun in _OPEN_AT_THE_TOP else Form.BOX

    def _only_side(self, row: int) -> Side | None:
        """The one side that is drawn of what would hide the room: walls and doors in them, ceilings, lamps there."""
        in_wall = self.roots[row] in self.in_walls
        if self.bodies[row].physics.simulates and not in_wall:
            return None
        thinnest, next_thinnest = np.sort(self.half[row])[:2]
        is_thin = thinnest < 0.35 * next_thinnest and next_thinnest > _BROAD_M
        if is_thin and (in_wall or self.surfaces[row] in _AROUND):
            return self._side_to_the_room(row)
        if self.surfaces[row] is Surface.LAMP and self.centre[row, 2] > self.overhead:
            axis, direction = self._top(row)
            return axis, -direction
        return None

    def _side_to_the_room(self, row: int) -> Side:
        axis = int(np.argmin(self.half[row]))
        offsets = (self.centre[self.is_thing] - self.centre[row]) @ self.turn[row][:, axis]
        return axis, 1 if np.sum(np.sign(offsets)) >= 0 else -1

    def _top(self, row: int) -> Side:
        """The side of a box that looks up."""
        up = self.turn[row][2]
        axis = int(np.argmax(np.abs(up)))
        return axis, 1 if up[axis] > 0 else -1

    # -- what hangs together ---------------------------------------------------------------------------------

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

    def _fronts(self, joints: list[tuple[BodyId, BodyId]]) -> dict[int, list[NDArray[np.intp]]]:
        """Of each assembly, what is hinged on it or slides in it, with all that hangs on that."""
        groups: dict[int, list[int]] = {}
        for row, root in enumerate(self.roots):
            groups.setdefault(root, []).append(row)
        fronts: dict[int, list[NDArray[np.intp]]] = {}
        for parent, child in joints:
            ends = {self.roots[self.rows[end]] for end in (parent, child) if end in self.rows}
            if len(ends) == 2:
                front, frame = sorted(ends, key=lambda row: (not self.bodies[row].physics.simulates, self.volume[row]))
                # The front itself comes first, what hangs on it after.
                fronts.setdefault(frame, []).append(np.array(sorted(groups[front], key=lambda row: row != front)))
        return fronts

    def _loose(self) -> NDArray[np.bool_]:
        """What stands somewhere and could be taken away."""
        loose = np.array([body.physics.simulates for body in self.bodies], dtype=bool)
        for front in (front for fronts in self.fronts.values() for front in fronts):
            loose[front] = False
        return loose

    # -- what is open ----------------------------------------------------------------------------------------

    def _openings(self, row: int) -> tuple[tuple[Side, ...], tuple[float, ...]]:
        """The sides of a box that are drawn open, and the heights of the shelves in it."""
        half, top = self.half[row], self._top(row)
        if self.surfaces[row] in _BUILDING or self.surfaces[row] is Surface.GLASS or half.min() < 0.005:
            return (), ()
        if self.forms[row] is Form.OPEN_BOX:
            return (top,), ()
        if half.min() < _SMALLEST_BOX_M / 2:
            return (), ()
        closed = (self._closes(row, front, top) for front in self.fronts.get(self.roots[row], ()))
        sides = tuple(sorted({side for side in closed if side is not None}))
        low, high = self._within(row, self.loose)
        inside = np.all(np.abs(low + high) / 2 < half, axis=1) & (self.volume[self.loose] < 0.5 * self.volume[row])
        if not (sides or inside.any()):
            return (), ()
        levels = {round(float(level), 2) for level in low[inside, 2] if level > 0.06 - half[2]}
        return sides or (top,), tuple(sorted(levels)) if sides and top == (2, 1) else ()

    def _closes(self, row: int, front: NDArray[np.intp], top: Side) -> Side | None:
        """Which side of a box a door or a drawer closes; None if it is elsewhere."""
        half = self.half[row]
        lows, highs = self._within(row, front)
        handles = np.array([self.surfaces[other] is Surface.DARK_METAL for other in front], dtype=bool)
        handles[0] = False
        low, high = lows[~handles].min(axis=0), highs[~handles].max(axis=0)
        if np.any(low > half + _TOUCH_M) or np.any(high < -half - _TOUCH_M):
            return None
        if handles.any():
            # Where the handle sticks out is where one pulls.
            out = ((lows + highs)[handles].mean(axis=0) - (lows + highs)[0]) / np.maximum((highs - lows)[0], 1e-6)
            axis = int(np.argmax(np.abs(out)))
            side = (axis, 1 if out[axis] > 0 else -1)
        else:
            side = self._nearest_side(row, low, high, top)
        across = [axis for axis in range(3) if axis != side[0]]
        return side if np.all(np.abs(low + high)[across] / 2 < half[across]) else None

    def _nearest_side(self, row: int, low: Array, high: Array, top: Side) -> Side:
        """The side of a box to which something in its frame comes closest; the top only if it covers that."""
        half = self.half[row]
        gaps = {(axis, 1): float(half[axis] - high[axis]) for axis in range(3)}
        gaps |= {(axis, -1): float(half[axis] + low[axis]) for axis in range(3)}
        del gaps[top[0], -top[1]]
        flat = [axis for axis in range(3) if axis != top[0]]
        if np.prod((high - low)[flat]) < _LID_SHARE * np.prod(2 * half[flat]):
            del gaps[top]
        return min(gaps, key=lambda side: gaps[side] + _DEPTH_COUNTS * float((high - low)[side[0]]))

    def _holes(self, row: int) -> tuple[Hole, ...]:
        """Where sinks and the like are let into the top of a box."""
        if self._top(row) != (2, 1) or self.is_loose[row]:
            return ()
        rows = np.array([other for other in self.sunk if other != row], dtype=np.intp)
        low, high = self._within(row, rows)
        half = self.half[row]
        let_in = np.all((low[:, :2] > -half[:2]) & (high[:, :2] < half[:2]), axis=1)
        let_in &= (low[:, 2] < half[2] - _TOUCH_M) & (high[:, 2] > half[2] - _TOUCH_M)
        ranges = np.stack([low[let_in, :2], high[let_in, :2]], axis=2).reshape(-1, 4)
        return tuple((a, b, c, d) for a, b, c, d in ranges.tolist())

    def _within(self, row: int, others: NDArray[np.intp]) -> tuple[Array, Array]:
        """Lower and upper corners of other bodies, in the frame of one."""
        turn = np.abs(self.turn[row].T @ self.turn[others])
        reach = np.einsum("nij,nj->ni", turn, self.half[others])
        middle = (self.centre[others] - self.centre[row]) @ self.turn[row]
        return middle - reach, middle + reach
