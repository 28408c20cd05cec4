"""A home while it is built: bodies, joints, and the spaces that things can be put in; frames on the floor.

Lengths are in meters. The x axis of a piece of furniture points to its front, its y axis to the right as seen from
there, so that a handle's offset is a distance across.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from random import Random

from mindstage.homes.household import KNOWROB, MS, Household
from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    LinearLimits,
    Mobility,
    Pose,
    Vector,
)

__all__ = ["Frame", "Motion", "Rect", "Scenery", "Space", "class_iri"]

Rect = tuple[float, float, float, float]
"""Smallest x and y, largest x and y [m]."""


def class_iri(name: str) -> Iri:
    """The IRI of a class that is written with the prefix `ms:` or `knowrob:`."""
    prefix, _, local = name.partition(":")
    return Iri({"ms": MS, "knowrob": KNOWROB}[prefix] + local)


@dataclass(frozen=True, slots=True)
class Frame:
    """A position on the floor [m] and a heading in quarter turns from the x axis."""

    x: float
    y: float
    turns: float = 0.0

    def at(self, forward: float, across: float, *, turns: float = 0.0) -> Frame:
        """The frame at a distance to the front and along the y axis."""
        cos, sin = self._cos_sin()
        x, y = self.x + cos * forward - sin * across, self.y + sin * forward + cos * across
        return Frame(x, y, self.turns + turns)

    def rect(self, depth: float, width: float, *, clearance: float = 0.0) -> Rect:
        """The rectangle of a body with its center here, and of the free floor before it; turns are whole."""
        near, far = self.at(-depth / 2, -width / 2), self.at(depth / 2 + clearance, width / 2)
        return min(near.x, far.x), min(near.y, far.y), max(near.x, far.x), max(near.y, far.y)

    def pose(self, z: float) -> Pose:
        """The pose at a height [m]."""
        half = self.turns % 4 * math.pi / 4
        position = (round(self.x, 5) + 0.0, round(self.y, 5) + 0.0, round(z, 5) + 0.0)
        return Pose(position, (round(math.cos(half), 9) + 0.0, 0.0, 0.0, round(math.sin(half), 9) + 0.0))

    def _cos_sin(self) -> tuple[float, float]:
        angle = self.turns * math.pi / 2
        return round(math.cos(angle), 12), round(math.sin(angle), 12)


@dataclass(frozen=True, slots=True)
class Space:
    """A free box above a surface, in which things can stand."""

    frame: Frame
    """The center of its floor."""
    bottom: float
    depth: float
    width: float
    height: float
    classes: tuple[Iri, ...]
    """What is kept there."""


@dataclass(frozen=True, slots=True)
class Motion:
    """How a front moves: a field of `LinearLimits` or `AngularLimits`, and the travel until it is open [m or rad]."""

    axis: str
    travel: float


@dataclass
class Scenery:
    """The parts of a home in the order of their creation."""

    namespace: str
    random: Random
    household: Household
    without: frozenset[str]
    bodies: list[Body] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    spaces: list[Space] = field(default_factory=list)
    _numbers: Counter[str] = field(default_factory=Counter)

    def between(self, low: float, high: float, step: float = 0.01) -> float:
        """A random length on a grid."""
        return round(low + step * self.random.randrange(round((high - low) / step) + 1), 4)

    def add(
        self,
        cls: str,
        size: Vector,
        frame: Frame,
        bottom: float,
        *,
        mobility: Mobility = Mobility.STATIC,
        parent: Body | None = None,
    ) -> Body:
        """Adds a body that stands at a height above the floor; a child is attached to its parent."""
        iri = cls if "//" in cls else class_iri(cls)
        stem = "".join(f"_{each.lower()}" if each.isupper() else each for each in iri.rpartition("#")[2])
        stem = stem.strip("_").replace("-", "").partition("_piece_of")[0]
        self._numbers[stem] += 1
        id = BodyId(f"{stem}_{self._numbers[stem]}")
        size = (round(size[0], 4), round(size[1], 4), round(size[2], 4))
        moves = mobility is Mobility.DYNAMIC
        mass = self.household.mass(iri, size) if moves or parent else None
        body = Body(
            id=id,
            iri=Iri(self.namespace + id),
            cls=Iri(iri),
            pose=frame.pose(bottom + size[2] / 2),
            size=size,
            physics=BodyPhysics(mobility=mobility, mass_kg=mass, gravity=True, overlap_events=False),
        )
        self.bodies.append(body)
        if parent is not None:
            self.attachments.append(Attachment(parent=parent.id, child=id))
        return body

    def join(self, parent: Body, child: Body, frame: Frame, z: float, motion: Motion) -> None:
        """Adds the joint of a front; it is closed in the given pose."""
        half, middle = round(abs(motion.travel) / 2, 6), round(motion.travel / 2, 6)
        axis = {motion.axis: AxisMotion.LIMITED, f"{motion.axis}_middle": middle}
        if len(motion.axis) == 1:
            limits = {"linear": LinearLimits(limit=half, **axis)}  # type: ignore[arg-type]
        else:
            limits = {"angular": AngularLimits(**axis, **{f"{motion.axis}_limit": half})}  # type: ignore[arg-type, dict-item]
        id = BodyId(f"{child.id}_{'slide' if 'linear' in limits else 'hinge'}")
        iri = Iri(self.namespace + id)
        self.joints.append(
            Joint(id=id, iri=iri, parent=parent.id, child=child.id, pose=frame.pose(z), **limits)  # type: ignore[arg-type]
        )
