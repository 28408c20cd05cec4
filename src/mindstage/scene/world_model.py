"""The world model: bodies, joints, lights and RDF statements as plain values, independent of RDF stores and engines.

Units are SI. Frames follow ROS REP 103 (right-handed, x forward, y left, z up); quaternions are w x y z. All values
are frozen and hashable, so worlds can be compared, sent, stored and used as keys. A field that is None is not stated in
the map: no value is invented here; an engine that needs one chooses it and reports it.

A `PropertyAssertion` is an RDF statement about its owner: a property and a value, which is an IRI, a literal or a blank
node described by its own statements.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum, StrEnum
from typing import Any, NewType, Protocol

import msgspec

from mindstage.errors import BodyNotFoundError, PoseRefusedError
from mindstage.ranges import Component, Coordinate, check_number, declared_range
from mindstage.scene.display import counted, html_table, short_name

__all__ = [
    "IDENTITY",
    "AngularLimits",
    "Attachment",
    "AxisMotion",
    "BlankNode",
    "Body",
    "BodyId",
    "BodyPhysics",
    "Color",
    "FactValue",
    "Iri",
    "IriRef",
    "Joint",
    "JointMimic",
    "Light",
    "LightType",
    "LinearLimits",
    "Literal",
    "Material",
    "Mobility",
    "NamedResource",
    "Pose",
    "PoseLike",
    "PrimitiveShape",
    "PrimitiveType",
    "PropertyAssertion",
    "Quaternion",
    "SoftLimit",
    "Tag",
    "Vector",
    "World",
    "as_pose",
]


Iri = NewType("Iri", str)
"""An absolute IRI, or the label of a blank node (`_:…`), which is valid only within one world."""


class IriRef(msgspec.Struct, frozen=True, tag="iri", forbid_unknown_fields=True):
    """A reference to a named resource."""

    iri: Iri


class Literal(msgspec.Struct, frozen=True, tag="literal", forbid_unknown_fields=True):
    """An RDF literal, with its lexical form exactly as in the source."""

    text: str
    datatype: Iri | None = None
    """None for a plain string."""
    language: str | None = None


class BlankNode(msgspec.Struct, frozen=True, tag="anonymous", forbid_unknown_fields=True):
    """An RDF blank node; two of them are equal if their facts are."""

    facts: tuple[PropertyAssertion, ...] = ()
    """Sorted by property, then value, so that equal nodes are equal values."""


FactValue = IriRef | Literal | BlankNode


class PropertyAssertion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One statement, whose subject is the object that holds it."""

    property: Iri
    value: FactValue


class NamedResource(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A named resource that is no body, joint or light, and the statements about it."""

    iri: Iri
    facts: tuple[PropertyAssertion, ...] = ()


BodyId = NewType("BodyId", str)
"""The local name of an individual, unique in its world; ids of joints and lights share this namespace."""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Color = tuple[float, float, float]
"""Red, green and blue (sRGB), each 0 to 1."""


class FrozenStruct(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Base class of the parts of a world: frozen, hashable, with keyword-only fields."""


class Pose(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A position [m] and an orientation, in the world frame unless stated otherwise."""

    position: Vector = (0.0, 0.0, 0.0)
    """x, y, z [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """w, x, y, z as given: the norm may differ from 1 by the rounding of the map."""


IDENTITY = Pose()


class ArrayLike(Protocol):
    """An array of NumPy, which is not imported here."""

    def tolist(self) -> Any:
        """Its numbers in nested lists."""


PoseLike = Pose | Sequence[float] | Sequence[Sequence[float]] | ArrayLike
"""What is accepted as a pose; see `as_pose`."""


def as_pose(value: PoseLike, name: str = "pose") -> Pose:
    """The pose that was given as a `Pose` or as numbers in a tuple, a list or an array.

    Args:
        value: a pose; or x, y, z [m], without a rotation; or these three and a quaternion w, x, y, z of any norm, as
            seven numbers or as a pair.
        name: the name of the argument, for errors.

    Raises:
        PoseRefusedError: the value has another shape, or the quaternion is 0.
        NumberRefusedError: a number is not finite, or too large.
    """
    if isinstance(value, Pose):
        return value
    numbers = _plain(value)
    if isinstance(numbers, list) and [len(each) if isinstance(each, list) else 0 for each in numbers] == [3, 4]:
        numbers = [*numbers[0], *numbers[1]]
    if not isinstance(numbers, list) or len(numbers) not in {3, 7} or any(isinstance(each, list) for each in numbers):
        raise PoseRefusedError(
            name,
            cause=f"{' '.join(repr(value).split())[:80]} is no pose",
            remedy="give x, y, z [m], or x, y, z and the quaternion w, x, y, z, or a Pose",
        )
    for number in numbers[:3]:
        check_number(number, _COORDINATE, name)
    for number in numbers[3:]:
        check_number(number, _COMPONENT, name)
    x, y, z, *quaternion = map(float, numbers)
    if not quaternion:
        return Pose((x, y, z))
    if not any(quaternion):
        raise PoseRefusedError(name, cause="its quaternion is all zeros", remedy="give 1, 0, 0, 0 for no rotation")
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k))


_COORDINATE, _COMPONENT = declared_range(Coordinate), declared_range(Component)


def _plain(value: Any) -> Any:
    """Nested tuples and arrays as nested lists."""
    listed = value.tolist() if hasattr(value, "tolist") else value
    return [_plain(each) for each in listed] if isinstance(listed, list | tuple) else listed


class PosedStruct(FrozenStruct, frozen=True, kw_only=True):
    """Base class of parts with a field `pose`, which is converted by `as_pose`."""

    def __post_init__(self) -> None:
        if self.pose.__class__ is not Pose:  # type: ignore[attr-defined]
            msgspec.structs.force_setattr(self, "pose", as_pose(self.pose))  # type: ignore[attr-defined]


class Mobility(StrEnum):
    """How a body can move."""

    STATIC = "static"
    """It never moves: a part of the building."""
    STATIONARY = "stationary"
    """It never moves; a stationary light may change its color."""
    DYNAMIC = "dynamic"
    """It is moved by the physics simulation."""
    KINEMATIC = "kinematic"
    """It is moved by commands; it pushes dynamic bodies and is never pushed."""


class BodyPhysics(FrozenStruct, frozen=True, kw_only=True):
    """Physical properties of a body; None where the map does not state one."""

    mobility: Mobility | None = None
    """None is treated as static."""
    gravity: bool | None = None
    """None is treated as true."""
    overlap_events: bool | None = None
    """Whether contacts are reported; None is treated as false."""
    mass_kg: float | None = None
    """[kg]. None or 0 is no mass; an engine that needs one estimates it from the size and reports it."""
    assumed: tuple[str, ...] = ()
    """Names of the fields that the map does not state, and its reader assumed: `mobility`."""

    @property
    def stated_mobility(self) -> Mobility | None:
        """The mobility that the map states; None if it states none, also if one is assumed."""
        return None if "mobility" in self.assumed else self.mobility

    @property
    def is_dynamic(self) -> bool:
        """Whether the physics simulation moves the body."""
        return self.mobility is Mobility.DYNAMIC


class Tag(FrozenStruct, frozen=True, kw_only=True):
    """A key and a value that are attached to a body, joint or light ("UTag" in Unreal Engine)."""

    type: str
    key: str
    value: str


class Material(FrozenStruct, frozen=True, kw_only=True):
    """A named material: the path of an engine asset, and the color that is used without that asset."""

    name: str
    path: str = ""
    color: Color | None = None


class PrimitiveType(StrEnum):
    """The shapes that a body without a mesh can have."""

    BOX = "box"
    SPHERE = "sphere"
    CYLINDER = "cylinder"
    """Its axis is z."""


class PrimitiveShape(FrozenStruct, frozen=True, kw_only=True):
    """The primitive shape that fills the size of a body; a mesh, where one is found, replaces it."""

    type: PrimitiveType = PrimitiveType.BOX


class Body(PosedStruct, frozen=True, kw_only=True):
    """An individual with a pose."""

    id: BodyId
    iri: Iri
    cls: Iri
    """Its most specific class; further types are facts."""
    pose: Pose
    label: str | None = None
    size: Vector | None = None
    """Depth, width, height: the extents along the x, y and z axes of the body [m]."""
    mesh: str | None = None
    """A path (`package://…`) or a name."""
    shape: PrimitiveShape | None = None
    """None is treated as a box."""
    physics: BodyPhysics = BodyPhysics()
    materials: tuple[Material, ...] = ()
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()
    """All other statements about the individual."""

    @property
    def color(self) -> Color | None:
        """The color of the first material that states one; None if none does."""
        return next((material.color for material in self.materials if material.color is not None), None)

    def __repr__(self) -> str:
        at = ", ".join(f"{part:.3f}" for part in self.pose.position)
        return f"<{type(self).__name__} {self.id} ({short_name(self.cls)}) at ({at}) m>"


class AxisMotion(IntEnum):
    """The motion that one axis of a joint allows; maps and messages use the same numbers."""

    FREE = 0
    LIMITED = 1
    LOCKED = 2


class SoftLimit(FrozenStruct, frozen=True, kw_only=True):
    """A limit that acts as a spring and damper instead of a hard stop, if `enabled`."""

    enabled: bool = False
    stiffness: float = 0.0
    """[N/m] or [Nm/rad]."""
    damping: float = 0.0
    """[Ns/m] or [Nms/rad]."""


class LinearLimits(FrozenStruct, frozen=True, kw_only=True):
    """The translational limits of a joint along the axes of its frame, relative to the middle of the range.

    The middle is the spawn position, unless the range is asymmetric: a drawer that is closed when spawned and opens by
    0.4 m has its middle at 0.2 m and a limit of 0.2 m.
    """

    x: AxisMotion = AxisMotion.LOCKED
    y: AxisMotion = AxisMotion.LOCKED
    z: AxisMotion = AxisMotion.LOCKED
    limit: float = 0.0
    """Half of the range of each limited axis [m]."""
    x_middle: float = 0.0
    """Middle of the range along x, relative to the spawn position [m]; ignored unless x is limited."""
    y_middle: float = 0.0
    z_middle: float = 0.0
    soft_limit: SoftLimit = SoftLimit()


class AngularLimits(FrozenStruct, frozen=True, kw_only=True):
    """The rotational limits of a joint about the axes of its frame, relative to the middle of the range."""

    swing1: AxisMotion = AxisMotion.LOCKED
    """About z."""
    swing2: AxisMotion = AxisMotion.LOCKED
    """About y."""
    twist: AxisMotion = AxisMotion.LOCKED
    """About x."""
    swing1_limit: float = 0.0
    """[rad]."""
    swing2_limit: float = 0.0
    """[rad]."""
    twist_limit: float = 0.0
    """[rad]."""
    swing1_middle: float = 0.0
    """Middle of the range about z, relative to the spawn orientation [rad]; see `LinearLimits`."""
    swing2_middle: float = 0.0
    twist_middle: float = 0.0
    swing_soft_limit: SoftLimit = SoftLimit()
    twist_soft_limit: SoftLimit = SoftLimit()


class JointMimic(FrozenStruct, frozen=True, kw_only=True):
    """A joint follows another one, its master, as the second finger of a gripper follows the first ("mimic" in URDF).

    Its position is `multiplier` times that of the master, plus `offset`. Positions are relative to the spawned pose,
    on the first axis of each joint that is not locked, in the order x, y, z, twist, swing2, swing1.
    """

    joint: BodyId
    """The id of the master."""
    multiplier: float = 1.0
    """In units of the follower per unit of the master [m/m, m/rad, rad/m or rad/rad]."""
    offset: float = 0.0
    """[m] or [rad]."""


class Joint(PosedStruct, frozen=True, kw_only=True):
    """A joint with up to six degrees of freedom between two bodies (a D6 joint in PhysX)."""

    id: BodyId
    iri: Iri
    parent: BodyId
    child: BodyId
    """Parent and child are as in the map; the child may be the heavier body (see `joint_kinematics.moving_body`)."""
    pose: Pose
    """The joint frame when spawned, in the world frame."""
    linear: LinearLimits = LinearLimits()
    angular: AngularLimits = AngularLimits()
    disable_collision: bool | None = None
    """Whether the two bodies do not collide with each other; None is treated as true, unless the joint is floating."""
    mimic: JointMimic | None = None
    """The joint that it follows, if any."""
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()
    assumed: tuple[str, ...] = ()
    """Names of what the map does not state, and its reader assumed: `parent`, `limits`, `axis`…"""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id}: {self.parent} -> {self.child}>"


class Attachment(FrozenStruct, frozen=True, kw_only=True):
    """A rigid attachment: the child moves with the parent, not vice versa."""

    parent: BodyId
    child: BodyId


class LightType(StrEnum):
    """The type of a light source."""

    POINT = "point"
    SPOT = "spot"
    """It points along the negative z axis of its pose."""
    DIRECTIONAL = "directional"


class Light(PosedStruct, frozen=True, kw_only=True):
    """A light source."""

    id: BodyId
    iri: Iri
    type: LightType
    pose: Pose
    color: Color = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """[cd] for point and spot lights, [lx] for directional lights, as in glTF's KHR_lights_punctual."""
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()


class World(FrozenStruct, frozen=True, kw_only=True):
    """A complete scene. The order of its parts has no meaning; ids are unique across bodies, joints and lights."""

    iri: Iri
    """The IRI of the map's individual."""
    name: str = ""
    bodies: tuple[Body, ...] = ()
    joints: tuple[Joint, ...] = ()
    attachments: tuple[Attachment, ...] = ()
    lights: tuple[Light, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()
    """The statements about the map itself."""
    resources: tuple[NamedResource, ...] = ()
    """Other resources that the source of the map describes: classes, properties, the ontology that it is part of."""
    format_version: int = 2

    def __repr__(self) -> str:
        counts = (counted(len(self.bodies), "body"), counted(len(self.joints), "joint"))
        return f"<{type(self).__name__} {self.name or short_name(self.iri)}: {', '.join(counts)}>"

    def _repr_html_(self) -> str:
        """Returns the bodies as an HTML table for notebooks."""
        rows = [
            (
                body.id,
                short_name(body.cls),
                " ".join(f"{part:.3f}" for part in body.pose.position),
                " ".join(f"{part:.3f}" for part in body.size or ()),
                body.physics.mobility,
            )
            for body in self.bodies
        ]
        return html_table(repr(self), ("id", "class", "position [m]", "size [m]", "mobility"), rows)

    def body(self, id: str) -> Body:
        """Returns the body with an id. A linear search: meant for tests and interactive use.

        Raises:
            BodyNotFoundError: no body has this id.
        """
        for body in self.bodies:
            if body.id == id:
                return body
        raise BodyNotFoundError(id, known=[body.id for body in self.bodies], world=self.name)
