"""Floor plans: rooms in two rows along a corridor, walls with doors and windows, and places along walls.

A room is a rectangle. What stands in it has a footprint and, before it, free floor; footprints overlap nothing, free
floor may be shared. Widths and heights of openings follow DIN 18040-2 (doors: 0.80 m or 0.90 m of free width) and
DIN 18101 (door leaves of 1.985 m); thickness of walls DIN 4172 (11.5, 24 and 36.5 cm).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

from mindstage.homes.fronts import FRONT_GAP_M, QUARTER_TURN_RAD
from mindstage.homes.scenery import Frame, Motion, Rect, Scenery
from mindstage.scene import Mobility

__all__ = ["Room", "RoomKind", "Side", "build_rooms"]

PARTITION_M = 0.115
CORRIDOR_M = 1.5
"""Width of a corridor (DIN 18040-2: at least 1.20 m, 1.50 m where wheelchairs turn)."""
LEAF_M = 0.04
_DOOR_HEIGHT_M = 2.0
_JAMB_M = 0.004
_FLOOR_M = 0.1
_STEP_M = 0.05


class RoomKind(StrEnum):
    """The uses of rooms."""

    KITCHEN = "kitchen"
    LIVING = "living"
    BED = "bed"
    BATH = "bath"
    OFFICE = "office"
    LAB = "lab"
    SHOP = "shop"
    HALL = "hall"


@dataclass(frozen=True, slots=True)
class Side:
    """A wall as seen from the room: its frame is at the middle of its foot and faces the room."""

    frame: Frame
    length: float
    windows: tuple[tuple[float, float, float], ...] = ()
    """From and to along the wall, height of the sill [m]."""


@dataclass
class Room:
    """A room, its sides, and what floor is taken."""

    kind: RoomKind
    rect: Rect
    height: float
    sides: list[Side] = field(default_factory=list)
    taken: list[Rect] = field(default_factory=list)
    kept_free: list[Rect] = field(default_factory=list)

    def along(
        self, scenery: Scenery, size: tuple[float, float, float], clearance: float, *, gap: float = 0.005
    ) -> Frame | None:
        """Takes a place with its back to a wall, the first that is free on a random side; None if there is none."""
        depth, width, height = size
        order = list(range(len(self.sides)))
        scenery.random.shuffle(order)
        for side in (self.sides[number] for number in order):
            for step in range(int((side.length - width - 2 * gap) / _STEP_M) + 1):
                across = -side.length / 2 + gap + width / 2 + step * _STEP_M
                blocked = any(
                    height > sill and across - width / 2 < end and across + width / 2 > start
                    for start, end, sill in side.windows
                )
                frame = side.frame.at(gap + depth / 2, across)
                if not blocked and self.take(frame, depth, width, clearance):
                    return frame
        return None

    def in_the_middle(self, scenery: Scenery, depth: float, width: float, clearance: float) -> Frame | None:
        """Takes a place away from the walls, with free floor on all sides; None if there is none."""
        x0, y0, x1, y1 = self.rect
        for _ in range(40):
            frame = Frame(
                round(scenery.random.uniform(x0, x1), 2),
                round(scenery.random.uniform(y0, y1), 2),
                scenery.random.randrange(4),
            )
            around = frame.rect(depth + 2 * clearance, width + 2 * clearance)
            if self._contains(around) and self.take(frame, depth, width, 0.0, around=around):
                return frame
        return None

    def take(self, frame: Frame, depth: float, width: float, clearance: float, *, around: Rect | None = None) -> bool:
        """Takes a footprint and the free floor before it, if both are free; returns whether they were."""
        rect, free = frame.rect(depth, width), around or frame.rect(depth, width, clearance=clearance)
        if not self._contains(rect) or any(_overlap(rect, other) for other in (*self.taken, *self.kept_free)):
            return False
        if any(_overlap(free, other) for other in self.taken) or not self._contains(free):
            return False
        self.taken.append(rect)
        self.kept_free.append(free)
        return True

    def _contains(self, rect: Rect) -> bool:
        x0, y0, x1, y1 = self.rect
        return rect[0] >= x0 - 1e-6 and rect[1] >= y0 - 1e-6 and rect[2] <= x1 + 1e-6 and rect[3] <= y1 + 1e-6


def _overlap(first: Rect, second: Rect) -> bool:
    slack = 1e-6
    return all(first[axis] < second[axis + 2] - slack and second[axis] < first[axis + 2] - slack for axis in (0, 1))


@dataclass(frozen=True, slots=True)
class _Opening:
    across: float
    width: float
    bottom: float
    top: float
    is_door: bool


def build_rooms(scenery: Scenery, kinds: list[RoomKind], areas: list[float]) -> list[Room]:
    """Adds floor, walls, doors and windows of a home; returns its rooms.

    Args:
        scenery: the home.
        kinds: the uses of its rooms.
        areas: their floor areas [m2].
    """
    height, outer = scenery.between(2.4, 2.8, 0.05), scenery.random.choice((0.24, 0.365))
    rows = [list(range(0, len(kinds), 2)), list(range(1, len(kinds), 2))]
    depth = [_row_depth(scenery, [areas[index] for index in row]) for row in rows]
    sizes = [_widths(areas, row, depth[number]) for number, row in enumerate(rows)]
    length = max(sum(widths) + PARTITION_M * (len(widths) - 1) for widths in sizes)
    rooms = []
    for number, row in enumerate(rows):
        if not row:
            continue
        y0 = 0.0 if number == 0 else -CORRIDOR_M - 2 * PARTITION_M - depth[1]
        widths = sizes[number]
        widths[-1] += length - sum(widths) - PARTITION_M * (len(row) - 1)
        x = 0.0
        for place, index in enumerate(row):
            rect = (round(x, 3), round(y0, 3), round(x + widths[place], 3), round(y0 + depth[number], 3))
            room = Room(kinds[index], rect, height)
            _enclose(scenery, room, outer, door_side=0 if number == 0 else 2, is_last=place == len(row) - 1)
            rooms.append(room)
            x += widths[place] + PARTITION_M
    if len(kinds) > 1:
        rooms.append(_corridor(scenery, rooms, height, outer))
    x0, y0 = min(room.rect[0] for room in rooms) - outer, min(room.rect[1] for room in rooms) - outer
    x1, y1 = max(room.rect[2] for room in rooms) + outer, max(room.rect[3] for room in rooms) + outer
    floor = Frame((x0 + x1) / 2, (y0 + y1) / 2)
    scenery.add("knowrob:Floor", (x1 - x0, y1 - y0, _FLOOR_M), floor, -_FLOOR_M)
    return rooms


def _row_depth(scenery: Scenery, areas: list[float]) -> float:
    mean = sum(areas) / len(areas) if areas else 0.0
    return round(math.sqrt(mean) * scenery.between(0.85, 1.1), 2)


def _widths(areas: list[float], row: list[int], depth: float) -> list[float]:
    return [max(round(areas[index] / depth, 2), 2.2) for index in row]


def _sides(rect: Rect) -> list[tuple[Frame, float]]:
    """South, east, north and west, each facing the room."""
    x0, y0, x1, y1 = rect
    x, y, wide, deep = (x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0
    return [(Frame(x, y0, 1), wide), (Frame(x1, y, 2), deep), (Frame(x, y1, 3), wide), (Frame(x0, y, 0), deep)]


def _enclose(scenery: Scenery, room: Room, outer: float, *, door_side: int, is_last: bool) -> None:
    """Adds the walls of a room: its door is on one side, its window opposite; a partition is built once."""
    is_first = room.rect[0] == 0.0
    for number, (frame, length) in enumerate(_sides(room.rect)):
        thickness = PARTITION_M
        openings: list[_Opening] = []
        if number == door_side:
            width = scenery.random.choice((0.86, 0.985))
            across = (length / 2 - width / 2 - 0.15) * (1 if scenery.random.random() < 0.5 else -1)
            openings = [_Opening(round(across, 3), width, 0.0, _DOOR_HEIGHT_M + 0.01, True)]
        elif number == (door_side + 2) % 4:
            thickness = outer
            width = min(scenery.between(0.8, 1.6, 0.1), length - 0.6)
            sill = scenery.between(0.9, 1.2, 0.05)
            if "windows" not in scenery.without:
                openings = [_Opening(0.0, width, sill, 2.15, False)]
        elif (number == 3 and is_first) or (number == 1 and is_last):
            thickness = outer
        windows = tuple(
            (each.across - each.width / 2, each.across + each.width / 2, each.bottom)
            for each in openings
            if not each.is_door
        )
        room.sides.append(Side(frame, length, windows))
        if number == 3 and not is_first:
            continue
        ends = (0.0, 0.0)
        if number % 2 == 0:  # these include the corners
            ends = _ends(number, is_first=is_first, is_last=is_last, outer=outer)
        _wall(scenery, room, frame, length, thickness, ends, openings)


def _ends(number: int, *, is_first: bool, is_last: bool, outer: float) -> tuple[float, float]:
    """How far a wall extends beyond its room, at its ends in the direction of its y axis."""
    west, east = outer if is_first else 0.0, outer if is_last else PARTITION_M
    return (east, west) if number == 0 else (west, east)  # the y axis of a wall in the south points west


def _wall(
    scenery: Scenery,
    room: Room,
    frame: Frame,
    length: float,
    thickness: float,
    ends: tuple[float, float],
    openings: list[_Opening],
) -> None:
    """Adds the pieces of a wall around its openings, and what closes them."""
    start, stop = -length / 2 - ends[0], length / 2 + ends[1]
    pieces = []
    for each in openings:
        near, far = each.across - each.width / 2, each.across + each.width / 2
        pieces += [(start, near, 0.0, room.height), (near, far, each.top, room.height)]
        if each.bottom:
            pieces.append((near, far, 0.0, each.bottom))
        start = far
    pieces.append((start, stop, 0.0, room.height))
    walls = []
    for near, far, bottom, top in pieces:
        if "walls" not in scenery.without and far - near > 0.001:
            size = (thickness, far - near, top - bottom)
            at = frame.at(-thickness / 2, (near + far) / 2)
            walls.append(scenery.add("knowrob:WallOfAConstruction", size, at, bottom))
    for each in openings:
        if not each.is_door:
            size = (0.06, each.width, each.top - each.bottom)
            scenery.add("knowrob:Window", size, frame.at(-thickness / 2, each.across), each.bottom)
            continue
        leaf = each.width - 2 * _JAMB_M
        room.take(frame.at(leaf / 2 + 0.15, each.across), leaf + 0.3, each.width + 0.1, 0.0)
        room.taken.pop()  # free floor, not a footprint
        if walls and "doors" not in scenery.without:
            at = frame.at(-LEAF_M / 2, each.across)
            size = (LEAF_M, leaf, _DOOR_HEIGHT_M - _JAMB_M)
            door = scenery.add("ms:RoomDoor", size, at, 2 * FRONT_GAP_M, mobility=Mobility.DYNAMIC)
            if "handles" not in scenery.without:
                latch = (0.05, 0.12, 0.02)
                place = at.at(LEAF_M / 2 + latch[0] / 2, leaf / 2 - 0.1)
                scenery.add("ms:DoorLatch", latch, place, 1.04, mobility=Mobility.KINEMATIC, parent=door)
            hinge = at.at(LEAF_M / 2, -leaf / 2)
            scenery.join(walls[0], door, hinge, 1.0, Motion("swing1", -QUARTER_TURN_RAD))


def _corridor(scenery: Scenery, rooms: list[Room], height: float, outer: float) -> Room:
    """Adds the ends of the corridor, one with a door; its long sides are those of the rooms."""
    x1 = max(room.rect[2] for room in rooms)
    rect = (0.0, -PARTITION_M - CORRIDOR_M, x1, -PARTITION_M)
    room = Room(RoomKind.HALL, rect, height)
    for number, (frame, length) in enumerate(_sides(rect)):
        room.sides.append(Side(frame, length))
        if number == 1:
            _wall(scenery, room, frame, length, outer, (0.0, 0.0), [])
        elif number == 3:
            door = _Opening(0.0, 0.985, 0.0, _DOOR_HEIGHT_M + 0.01, True)
            _wall(scenery, room, frame, length, outer, (0.0, 0.0), [door])
    return room
