"""Data model of a robot description: names and numbers as given in the file, with no kinematics computed."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from mindstage.scene import Color, Pose, Vector

__all__ = [
    "UrdfGeometry",
    "UrdfGeometryType",
    "UrdfIssue",
    "UrdfJoint",
    "UrdfJointType",
    "UrdfLink",
    "UrdfMimic",
    "UrdfRobot",
]


class UrdfGeometryType(StrEnum):
    """Geometry elements of URDF."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    MESH = "mesh"


class UrdfGeometry(msgspec.Struct, frozen=True, kw_only=True):
    """A `<visual>` or `<collision>` element of a link."""

    geometry_type: UrdfGeometryType
    origin: Pose
    """Pose of the center, or of the origin of a mesh whose size is unknown, in the link frame."""
    size: Vector | None = None
    """Extents [m]; for a mesh, those of its bounding box if its file can be measured."""
    mesh: str | None = None
    """File name as given: a `package://` URI or a path."""
    color: Color | None = None
    material: str = ""


class UrdfLink(msgspec.Struct, frozen=True, kw_only=True):
    """A rigid body of the robot."""

    name: str
    visuals: tuple[UrdfGeometry, ...] = ()
    collisions: tuple[UrdfGeometry, ...] = ()
    mass_kg: float | None = None
    source_xml: str = ""
    """The XML of the element."""


class UrdfJointType(StrEnum):
    """Joint types of URDF."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"
    FLOATING = "floating"
    PLANAR = "planar"


class UrdfMimic(msgspec.Struct, frozen=True, kw_only=True):
    """A `<mimic>` element: the joint's position is `multiplier` times that of another joint, plus `offset`."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0
    """[m] or [rad]."""


class UrdfJoint(msgspec.Struct, frozen=True, kw_only=True):
    """A joint between two links."""

    name: str
    type: UrdfJointType
    parent: str
    child: str
    origin: Pose
    """Joint frame in the frame of the parent; the child frame coincides with it at joint position 0."""
    axis: Vector = (1.0, 0.0, 0.0)
    """Unit or other nonzero vector in the joint frame."""
    range: tuple[float, float] | None = None
    """Lower and upper limit [m or rad]; None for no limits."""
    damping: float = 0.0
    mimic: UrdfMimic | None = None
    source_xml: str = ""


class UrdfIssue(msgspec.Struct, frozen=True):
    """A problem in a robot description, and its remedy."""

    subject: str
    """Name of the link or joint; empty for the robot."""
    problem: str
    action: str
    is_missing: bool = False
    """Whether an element was omitted because of it."""


class UrdfRobot(msgspec.Struct, frozen=True, kw_only=True):
    """A parsed robot description."""

    name: str
    links: tuple[UrdfLink, ...]
    joints: tuple[UrdfJoint, ...]
    other_elements: tuple[str, ...] = ()
    """The XML of all other elements: materials, transmissions, simulator extensions."""
    issues: tuple[UrdfIssue, ...] = ()
