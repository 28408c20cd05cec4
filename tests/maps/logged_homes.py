"""Generated homes as Unreal's loggers wrote them: each class of meshes has its own pivot, which is known here.

A room has a floor, walls, cupboards with doors and handles, hung cupboards, a hood, lamps, posters, a table with chairs
and things on it. What a thing rests on, or hangs at, follows from its construction.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from mindstage.scene.transforms import normalize, quat_multiply, quat_rotate
from tests.maps.logged_maps import LoggedBody, yaw

__all__ = ["Home", "generated_home"]

Box = tuple[float, float, float]


@dataclass
class Home:
    """A home, as a list of actors in a frame whose z axis points up and whose floor is at z = 0."""

    rng: np.random.Generator
    bodies: list[LoggedBody] = field(default_factory=list)

    def uniform(self, low: float, high: float) -> float:
        return round(float(self.rng.uniform(low, high)), 3)

    def chance(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    def add(self, cls: str, box: Box, at: Iterable[float], *, degrees: float = 0.0, parent: str = "") -> str:
        """Adds an actor by the middle of its lower side, and returns its name."""
        x, y, z = at
        name = f"{cls}{len(self.bodies)}"
        center = (float(x), float(y), float(z) + box[2] / 2)
        self.bodies.append(LoggedBody(name, cls, box, center, yaw(degrees), parent))
        return name


def _room(home: Home) -> tuple[float, float, float]:
    """A floor, and walls on or around it; returns the half extents of the room and its height."""
    width, depth, height = home.uniform(2.0, 3.5), home.uniform(1.8, 3.0), home.uniform(2.4, 3.1)
    slab, wall = home.uniform(0.02, 0.3), home.uniform(0.08, 0.25)
    home.add("RoomFloor", (2 * width + 2 * wall, 2 * depth + 2 * wall, slab), (0.0, 0.0, -slab))
    kind = home.rng.integers(4)
    if kind == 0:  # one mesh for all walls
        home.add("RoomWalls", (2 * width + 2 * wall, 2 * depth + 2 * wall, height), (0.0, 0.0, 0.0))
    elif kind < 3:
        for side in (-1, 1):
            home.add("LongWall", (2 * width + 2 * wall, wall, height), (0.0, side * (depth + wall / 2), 0.0))
            home.add("ShortWall", (wall, 2 * depth, height), (side * (width + wall / 2), 0.0, 0.0))
    if home.chance(0.5):
        top = (2 * width + 2 * wall, 2 * depth + 2 * wall, home.uniform(0.05, 0.3))
        home.add("RoomCeiling", top, (0.0, 0.0, height))
    return width, depth, height


def _kitchen_row(home: Home, width: float, depth: float, height: float) -> None:
    """Cupboards along the wall at the largest y, with fronts and handles, a worktop and things on it."""
    deep, wide, high = home.uniform(0.5, 0.7), home.uniform(0.4, 0.8), home.uniform(0.75, 0.95)
    count = int(min(home.rng.integers(2, 5), 2 * width / wide))
    y, thick = depth - deep / 2, home.uniform(0.018, 0.03)
    front = depth - deep - thick / 2
    for number in range(count):
        x = -width + wide * (number + 0.5)
        case = home.add("BaseCupboard", (wide, deep, high), (x, y, 0.0))
        leaf = home.add("CupboardDoor", (wide - 0.01, thick, high - 0.1), (x, front, 0.08), parent=case)
        grip = (home.rng.choice([0.1, 0.3]), 0.03, 0.02)
        home.add("DoorHandle", (0.2, 0.035, 0.018), (x, front - thick / 2 - 0.0175, high - 0.12), parent=leaf)
        del grip
    top = home.uniform(0.02, 0.05)
    home.add("Worktop", (count * wide, deep, top), (-width + count * wide / 2, y, high))
    for number in range(int(home.rng.integers(1, 4))):
        at = (-width + home.uniform(0.1, count * wide - 0.1), y + home.uniform(-0.1, 0.1), high + top)
        home.add("Bottle", (0.08, 0.08, 0.28), at, degrees=home.uniform(-180, 180))
        del number
    if home.chance(0.7):
        hung = (wide, 0.35, home.uniform(0.5, 0.8))
        for number in range(count):
            home.add("HungCupboard", hung, (-width + wide * (number + 0.5), depth - hung[1] / 2, 1.45))
    elif home.chance(0.8):
        home.add("Hood", (0.6, 0.5, home.uniform(0.3, 0.9)), (-width + wide, depth - 0.25, 1.6))
    if home.chance(0.6):
        tall = (0.6, 0.6, home.uniform(1.5, 2.1))
        home.add("Fridge", tall, (width - 0.3, depth - 0.3, 0.0))


def _dining_place(home: Home, width: float, depth: float) -> None:
    """A table with chairs, plates, cups and cutlery."""
    long, wide, high = home.uniform(1.0, 1.8), home.uniform(0.7, 1.0), home.uniform(0.7, 0.78)
    x, y, turn = home.uniform(-0.5, 0.5), -depth / 3 + home.uniform(-0.2, 0.2), home.uniform(-20, 20)
    home.add("DiningTable", (long, wide, high), (x, y, 0.0), degrees=turn)
    for side in (-1, 1):
        for along in (-0.3, 0.3):
            at = (along * long, side * (wide / 2 + 0.3), 0.0)
            home.add(
                "Chair",
                (0.45, 0.44, 0.9),
                _turned((x, y, 0.0), at, turn),
                degrees=turn + 90 * side + home.uniform(-9, 9),
            )
            at = (along * long, side * (wide / 2 - 0.17), high)
            place = _turned((x, y, 0.0), at, turn)
            home.add("Plate", (0.24, 0.24, 0.02), place, degrees=home.uniform(-180, 180))
            if home.chance(0.5):
                home.add("Bowl", (0.15, 0.15, 0.06), (*place[:2], high + 0.02), degrees=home.uniform(-180, 180))
            at = (along * long + 0.17, side * (wide / 2 - 0.17), high)
            home.add("Knife", (0.2, 0.02, 0.01), _turned((x, y, 0.0), at, turn), degrees=turn + 90 * side)
            at = (along * long - 0.2, side * (wide / 2 - 0.1), high)
            home.add("Cup", (0.12, 0.09, 0.1), _turned((x, y, 0.0), at, turn), degrees=home.uniform(-180, 180))


def _turned(origin: Box, offset: Iterable[float], degrees: float) -> tuple[float, ...]:
    return tuple((np.array(origin) + quat_rotate(np.array(yaw(degrees)), np.array(list(offset)))).tolist())


def _fittings(home: Home, width: float, depth: float, height: float) -> None:
    """Things at walls and the ceiling, and furniture that stands free."""
    has_walls = any(body.cls.endswith("Wall") for body in home.bodies)
    has_ceiling = any(body.cls == "RoomCeiling" for body in home.bodies)
    if has_ceiling:
        long = home.uniform(0.2, 0.9)
        for number in range(int(home.rng.integers(1, 4))):
            home.add("CeilingLamp", (0.3, 0.3, long), (number - 1.0, home.uniform(-1, 1), height - long))
    if has_walls and home.chance(0.7):
        home.add("Poster", (0.01, home.uniform(0.5, 1.0), 0.7), (-width + 0.005, home.uniform(-0.5, 0.5), 1.3))
    if home.chance(0.6):
        box = (home.uniform(0.8, 1.4), home.uniform(0.3, 0.45), home.uniform(1.0, 2.0))
        home.add("Shelf", box, (-width + box[1] / 2, -depth + box[0] / 2 + 0.05, 0.0), degrees=90)
        for number in range(3):
            at = (-width + box[1] / 2, -depth + 0.2 + 0.25 * number, box[2])
            home.add("Carton", (0.2, 0.15, 0.25), at, degrees=90 + home.uniform(-5, 5))
    if home.chance(0.5):
        home.add("Rug", (1.4, 0.9, 0.015), (width / 2, 0.3, 0.0), degrees=home.uniform(-20, 20))
    if home.chance(0.4):
        home.add("FloorLamp", (0.35, 0.35, 1.6), (width - 0.4, -depth + 0.4, 0.0))


def generated_home(seed: int) -> list[LoggedBody]:
    """Returns the actors of a home; those of a class share a pivot, which is often not the center of the mesh."""
    home = Home(np.random.default_rng([seed, 33]))
    width, depth, height = _room(home)
    _kitchen_row(home, width, depth, height)
    _dining_place(home, width, depth)
    _fittings(home, width, depth, height)
    turn = float(home.rng.choice([0.0, 0.0, 90.0, home.uniform(-180, 180)]))
    shift = np.array([home.uniform(-5, 5), home.uniform(-5, 5), home.uniform(-0.5, 0.5)])
    pivots: dict[str, Box] = {}
    for body in home.bodies:
        if body.cls not in pivots:
            level = home.rng.choice([-0.5, 0.0, 0.5], p=[0.45, 0.4, 0.15])
            beside = home.rng.choice([-0.5, 0.0, 0.5], p=[0.1, 0.8, 0.1], size=2)
            pivots[body.cls] = tuple((np.array([*beside, level]) * body.box).tolist())  # type: ignore[assignment]
    whole = np.array(yaw(turn))
    return [
        replace(
            body,
            position=tuple((quat_rotate(whole, np.array(body.position)) + shift).tolist()),
            quaternion=tuple(normalize(quat_multiply(whole, np.array(body.quaternion))).tolist()),
            pivot=pivots[body.cls],
        )
        for body in home.bodies
    ]
