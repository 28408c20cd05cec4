"""Robot: what a description says, as plain data; names and numbers as they stand, nothing worked out yet."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from mindstage.scene import Color, Pose, Vector

__all__ = ["UrdfGeometry", "UrdfGeometryType", "UrdfIssue", "UrdfJoint", "UrdfJointType", "UrdfLink", "UrdfRobot"]


class UrdfGeometryType(StrEnum):
    """The forms that a description knows."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    MESH = "mesh"


class UrdfGeometry(msgspec.Struct, frozen=True, kw_only=True):
    """One visible or solid piece of a link."""

    geometry_type: UrdfGeometryType
    origin: Pose
    """Of its middle, or of a mesh's own origin, in the frame of the link."""
    size: Vector | None = None
    """The extents [m]; of a mesh where its file tells them."""
    mesh: str | None = None
    """As written, `package://…` or a path."""
    color: Color | None = None
    material: str = ""


class UrdfLink(msgspec.Struct, frozen=True, kw_only=True):
    """One rigid piece."""

    name: str
    visuals: tuple[UrdfGeometry, ...] = ()
    collisions: tuple[UrdfGeometry, ...] = ()
    mass_kg: float | None = None
    source_xml: str = ""
    """The text that told it."""


class UrdfJointType(StrEnum):
    """What a joint lets its child do."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"
    FLOATING = "floating"
    PLANAR = "planar"


class UrdfJoint(msgspec.Struct, frozen=True, kw_only=True):
    """What holds a link on another."""

    name: str
    type: UrdfJointType
    parent: str
    child: str
    origin: Pose
    """The joint's frame, and the child's where the joint stands at 0, in the frame of the parent."""
    axis: Vector = (1.0, 0.0, 0.0)
    """In the joint's frame; not 0."""
    range: tuple[float, float] | None = None
    """The lower limit first [m or rad]; None where there is none."""
    damping: float = 0.0
    source_xml: str = ""


class UrdfIssue(msgspec.Struct, frozen=True):
    """Something that cannot be taken as it stands."""

    subject: str
    """The link or joint; empty for the robot itself."""
    problem: str
    action: str
    is_missing: bool = False
    """Whether something is not there because of it."""


class UrdfRobot(msgspec.Struct, frozen=True, kw_only=True):
    """A description."""

    name: str
    links: tuple[UrdfLink, ...]
    joints: tuple[UrdfJoint, ...]
    other_elements: tuple[str, ...] = ()
    """The texts of all else in it: materials, transmissions, what simulators add."""
    issues: tuple[UrdfIssue, ...] = ()
