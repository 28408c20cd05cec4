"""Data model of a robot description: names and numbers as given in the file, with no kinematics computed."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from mindstage.scene import IDENTITY, Color, Pose, Vector

__all__ = [
    "UrdfGeometry",
    "UrdfGeometryType",
    "UrdfInertial",
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
    mesh_scale: Vector = (1.0, 1.0, 1.0)
    """Factors along the axes of the mesh."""
    mesh_origin: Pose = IDENTITY
    """Pose of the origin of a mesh in the link frame."""
    color: Color | None = None
    material: str = ""


class UrdfInertial(msgspec.Struct, frozen=True, kw_only=True):
    """An `<inertial>` element of a link, whose mass is positive."""

    mass_kg: float
    origin: Pose = IDENTITY
    """Center of mass, and the axes of the moments, in the link frame."""
    tensor: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """xx, yy, zz, xy, xz, yz about the center of mass, along the axes of `origin` [kg m²]."""


class UrdfLink(msgspec.Struct, frozen=True, kw_only=True):
    """A rigid body of the robot."""

    name: str
    visuals: tuple[UrdfGeometry, ...] = ()
    collisions: tuple[UrdfGeometry, ...] = ()
    mass_kg: float | None = None
    inertial: UrdfInertial | None = None
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
    velocity: float | None = None
    """Largest speed [m/s or rad/s]."""
    effort: float | None = None
    """Largest force [N] or moment [Nm]."""
    damping: float = 0.0
    friction: float = 0.0
    """[N] or [Nm]."""
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
    source_xml: str = ""
    """The whole document, with macros of xacro expanded; empty for an element that was parsed alone."""
