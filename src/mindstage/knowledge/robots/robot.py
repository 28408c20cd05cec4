"""Robot: what a description says, as plain data; names and numbers as they stand, nothing worked out yet."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from mindstage.world import Colour, Pose, Vector

__all__ = ["Geometry", "GeometryKind", "Joint", "JointType", "Link", "Oddity", "Robot"]


class GeometryKind(StrEnum):
    """The forms that a description knows."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    MESH = "mesh"


class Geometry(msgspec.Struct, frozen=True, kw_only=True):
    """One visible or solid piece of a link."""

    kind: GeometryKind
    origin: Pose
    """Of its middle, or of a mesh's own origin, in the frame of the link."""
    size: Vector | None = None
    """The extents [m]; of a mesh where its file tells them."""
    mesh: str | None = None
    """As written, `package://…` or a path."""
    colour: Colour | None = None
    material: str = ""


class Link(msgspec.Struct, frozen=True, kw_only=True):
    """One rigid piece."""

    name: str
    visuals: tuple[Geometry, ...] = ()
    collisions: tuple[Geometry, ...] = ()
    mass_kg: float | None = None
    source: str = ""
    """The text that told it."""


class JointType(StrEnum):
    """What a joint lets its child do."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"
    FLOATING = "floating"
    PLANAR = "planar"


class Joint(msgspec.Struct, frozen=True, kw_only=True):
    """What holds a link on another."""

    name: str
    type: JointType
    parent: str
    child: str
    origin: Pose
    """The joint's frame, and the child's where the joint stands at 0, in the frame of the parent."""
    axis: Vector = (1.0, 0.0, 0.0)
    """In the joint's frame; not 0."""
    range: tuple[float, float] | None = None
    """The lower limit first [m or rad]; None where there is none."""
    damping: float = 0.0
    source: str = ""


class Oddity(msgspec.Struct, frozen=True):
    """Something that cannot be taken as it stands."""

    about: str
    """The link or joint; empty for the robot itself."""
    what: str
    did: str
    missing: bool = False
    """Whether something is not there because of it."""


class Robot(msgspec.Struct, frozen=True, kw_only=True):
    """A description."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    rest: tuple[str, ...] = ()
    """The texts of all else in it: materials, transmissions, what simulators add."""
    oddities: tuple[Oddity, ...] = ()
