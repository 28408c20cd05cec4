"""Scene model of the kitchen: body types with a size, bodies with a pose, and joints between them.

All lengths are in millimeters. Bodies are aligned with the room: an orientation is a number of quarter turns to the
left, where 0 faces along the room's x axis. A body's own x axis points out of its front, y to its left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

__all__ = ["Body", "BodyType", "Frame", "Joint", "Mobility", "Motion", "Scene"]


class Mobility(Enum):
    """Mobility values of a map."""

    STATIC = "static"
    KINEMATIC = "kinematic"
    DYNAMIC = "dynamic"


class Motion(Enum):
    """Degree of freedom of a joint."""

    SLIDE = "slide"
    """Translation along x."""
    SWING = "swing"
    """Rotation about z, as of a cupboard door."""
    TILT = "tilt"
    """Rotation about y, as of an oven door."""


@dataclass(frozen=True)
class BodyType:
    """A class of bodies of one size."""

    name: str
    base: str
    """Superclass in the ontology, with its prefix."""
    size: tuple[int, int, int]
    """Depth, width, height."""
    mass_kg: float = 0.0
    """0 for static bodies."""


@dataclass(frozen=True)
class Frame:
    """A position on the floor and an orientation."""

    x: float
    y: float
    turns: int = 0

    def at(self, forward: float, left: float) -> tuple[float, float]:
        """Returns x and y in the room of a point given in this frame."""
        cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[self.turns % 4]
        return self.x + cos * forward - sin * left, self.y + sin * forward + cos * left


@dataclass(frozen=True)
class Body:
    """A body; x, y, z is its center."""

    id: str
    body_type: BodyType
    x: float
    y: float
    z: float
    turns: int = 0
    mobility: Mobility = Mobility.DYNAMIC
    parent: str | None = None
    """The body that it is attached to."""

    @property
    def bottom(self) -> float:
        """Height of its lower side."""
        return self.z - self.body_type.size[2] / 2

    @property
    def top(self) -> float:
        """Height of its upper side."""
        return self.z + self.body_type.size[2] / 2

    @property
    def frame(self) -> Frame:
        """Its center and orientation in the plane."""
        return Frame(self.x, self.y, self.turns)


@dataclass(frozen=True)
class Joint:
    """A joint between a case and a part; its x axis points out of the case, its z axis up."""

    id: str
    case: str
    part: str
    x: float
    y: float
    z: float
    turns: int
    motion: Motion
    opening: float
    """Position when fully open, relative to the closed one, negative in the negative direction [m or rad]."""
    swapped_roles: bool = False
    """Whether the part is the parent in the map, as in some real maps."""


@dataclass
class Scene:
    """All bodies and joints, in the order of their creation."""

    bodies: dict[str, Body] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)

    def body_types(self) -> list[BodyType]:
        """Returns every body type in use, in the order of its first use.

        Raises:
            ValueError: two different types have the same name.
        """
        body_types: dict[str, BodyType] = {}
        for body in self.bodies.values():
            if body_types.setdefault(body.body_type.name, body.body_type) != body.body_type:
                raise ValueError(
                    f"two body types have the name {body.body_type.name!r}; rename the type of {body.id!r}"
                )
        return list(body_types.values())

    def add(self, body: Body) -> Body:
        """Adds a body.

        Raises:
            ValueError: its id is taken.
        """
        if body.id in self.bodies:
            raise ValueError(f"two bodies have the id {body.id!r}")
        self.bodies[body.id] = body
        return body

    def build(self, id: str, body_type: BodyType, place: Frame, bottom: float, *, parent: str | None = None) -> Body:
        """Adds a static body with its center above a position on the floor."""
        return self.add(
            Body(id, body_type, place.x, place.y, bottom + body_type.size[2] / 2, place.turns, Mobility.STATIC, parent)
        )

    def fix(self, id: str, body_type: BodyType, parent: Body, forward: float, left: float, height: float) -> Body:
        """Attaches a body to the front of another one, so that it touches the given point.

        Args:
            id: its id.
            body_type: its type.
            parent: the body that it is attached to.
            forward: distance of its back from the parent's center, to the front.
            left: distance of its center from the parent's center, to the left.
            height: height of its center above the floor.
        """
        x, y = parent.frame.at(forward + body_type.size[0] / 2, left)
        return self.add(Body(id, body_type, x, y, height, parent.turns, Mobility.KINEMATIC, parent.id))

    def put(self, body_type: BodyType, on: Body, forward: float, left: float, *, level: float | None = None) -> Body:
        """Places a dynamic body on another one, or inside it at a level above its bottom; ids are numbered."""
        stem = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in body_type.name).lstrip("_")
        number = 1 + sum(body.body_type.name == body_type.name for body in self.bodies.values())
        x, y = on.frame.at(forward, left)
        z = (on.top if level is None else on.bottom + level) + body_type.size[2] / 2
        return self.add(Body(f"{stem}_{number}", body_type, x, y, z, on.turns))
