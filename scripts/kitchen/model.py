"""What a kitchen is made of before it becomes a map: kinds with a size, things with a place, joints between them.

All lengths are millimetres. Things stand square to the room: a direction is a number of quarter turns to the left,
0 looks along the room's x axis. A thing's own x axis points out of its front, y to its left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

__all__ = ["Frame", "Joint", "Kind", "Mobility", "Motion", "Scene", "Thing"]


class Mobility(Enum):
    """Who may move a thing, in the words of a map."""

    STATIC = "static"
    KINEMATIC = "kinematic"
    DYNAMIC = "dynamic"


class Motion(Enum):
    """What a joint lets its part do."""

    SLIDE = "slide"
    """Along x."""
    SWING = "swing"
    """About z, like a cupboard door."""
    TILT = "tilt"
    """About y, like an oven door."""


@dataclass(frozen=True)
class Kind:
    """A class of things that are all of one size."""

    name: str
    base: str
    """The class of the ontology that it belongs to, with its prefix."""
    size: tuple[int, int, int]
    """Depth, width, height."""
    mass_kg: float = 0.0
    """0 for what never moves."""


@dataclass(frozen=True)
class Frame:
    """A place on the floor and a direction."""

    x: float
    y: float
    turns: int = 0

    def at(self, forward: float, left: float) -> tuple[float, float]:
        """The room's x and y of a point before and beside this place."""
        cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[self.turns % 4]
        return self.x + cos * forward - sin * left, self.y + sin * forward + cos * left


@dataclass(frozen=True)
class Thing:
    """One individual; x, y, z is its middle."""

    id: str
    kind: Kind
    x: float
    y: float
    z: float
    turns: int = 0
    mobility: Mobility = Mobility.DYNAMIC
    parent: str | None = None
    """What it is attached to."""

    @property
    def bottom(self) -> float:
        """The height of its underside."""
        return self.z - self.kind.size[2] / 2

    @property
    def top(self) -> float:
        """The height of its upper side."""
        return self.z + self.kind.size[2] / 2

    @property
    def frame(self) -> Frame:
        """Its middle, seen from above."""
        return Frame(self.x, self.y, self.turns)


@dataclass(frozen=True)
class Joint:
    """Holds a part on a case; its x axis points out of the case, its z axis up."""

    id: str
    case: str
    part: str
    x: float
    y: float
    z: float
    turns: int
    motion: Motion
    limit: float
    """[m] or [rad], either way."""
    upside_down: bool = False
    """Whether the map calls the part the parent, as some maps do."""


@dataclass
class Scene:
    """All of a kitchen, in the order in which it was built."""

    things: dict[str, Thing] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)

    def kinds(self) -> list[Kind]:
        """Every kind in use, in the order of its first use.

        Raises:
            ValueError: two different kinds have one name.
        """
        kinds: dict[str, Kind] = {}
        for thing in self.things.values():
            if kinds.setdefault(thing.kind.name, thing.kind) != thing.kind:
                raise ValueError(f"two kinds are called {thing.kind.name!r}; give {thing.id!r} another one")
        return list(kinds.values())

    def add(self, thing: Thing) -> Thing:
        """Puts a thing where it says.

        Raises:
            ValueError: its id is taken.
        """
        if thing.id in self.things:
            raise ValueError(f"there are two things called {thing.id!r}; number them")
        self.things[thing.id] = thing
        return thing

    def build(self, id: str, kind: Kind, place: Frame, bottom: float, *, parent: str | None = None) -> Thing:
        """A static thing whose middle, seen from above, is at a place."""
        return self.add(
            Thing(id, kind, place.x, place.y, bottom + kind.size[2] / 2, place.turns, Mobility.STATIC, parent)
        )

    def fix(self, id: str, kind: Kind, parent: Thing, forward: float, left: float, height: float) -> Thing:
        """A thing on the front of another that goes where that one goes; it touches it at the given point.

        Args:
            id: its name.
            kind: its kind.
            parent: what it is fixed to.
            forward: how far in front of the parent's middle its own back is.
            left: how far to the left of the parent's middle its middle is.
            height: of its middle, above the floor.
        """
        x, y = parent.frame.at(forward + kind.size[0] / 2, left)
        return self.add(Thing(id, kind, x, y, height, parent.turns, Mobility.KINEMATIC, parent.id))

    def put(self, kind: Kind, on: Thing, forward: float, left: float, *, level: float | None = None) -> Thing:
        """A loose thing on top of another, or, with a level above its bottom, inside it; ids are counted up."""
        stem = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in kind.name).lstrip("_")
        number = 1 + sum(thing.kind.name == kind.name for thing in self.things.values())
        x, y = on.frame.at(forward, left)
        z = (on.top if level is None else on.bottom + level) + kind.size[2] / 2
        return self.add(Thing(f"{stem}_{number}", kind, x, y, z, on.turns))
