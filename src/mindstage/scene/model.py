"""World: a place as plain data, with no RDF and no engine in it.

Units are SI, frames are ROS's (right-handed, x forward, y left, z up), quaternions are w x y z. Every value is
frozen and hashable, so worlds can be compared, sent, stored and used as keys. A field that is None was not told:
nothing is made up here, and an engine that needs a value chooses one and reports it.

Facts: what is known of a thing beyond the fields that a world has for it, kept word for word.

This is the shape of an RDF statement without RDF's machinery: a property and a value, where a value is a name, a
literal, or a thing that has no name and is known only by its own facts.
"""

from __future__ import annotations

from enum import IntEnum, StrEnum
from typing import NewType

import msgspec

from mindstage.errors import BodyNotFoundError
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
    "Light",
    "LightType",
    "LinearLimits",
    "Literal",
    "Material",
    "Mobility",
    "NamedResource",
    "Pose",
    "PrimitiveShape",
    "PrimitiveType",
    "PropertyAssertion",
    "Quaternion",
    "SoftLimit",
    "Tag",
    "Vector",
    "World",
]


Iri = NewType("Iri", str)
"""An absolute IRI; a name that starts with `_:` is a label which means something only inside one world."""


class IriRef(msgspec.Struct, frozen=True, tag="iri", forbid_unknown_fields=True):
    """A named thing."""

    iri: Iri


class Literal(msgspec.Struct, frozen=True, tag="literal", forbid_unknown_fields=True):
    """A value with its text exactly as the source has it."""

    text: str
    datatype: Iri | None = None
    """None for a plain string."""
    language: str | None = None


class BlankNode(msgspec.Struct, frozen=True, tag="anonymous", forbid_unknown_fields=True):
    """A thing without a name; two of them are the same when their facts are."""

    facts: tuple[PropertyAssertion, ...] = ()
    """Sorted by property, then value, so that equal things are equal values."""


FactValue = IriRef | Literal | BlankNode


class PropertyAssertion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One statement about the thing that holds it."""

    property: Iri
    value: FactValue


class NamedResource(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A named thing that is neither a body nor a constraint, and what is said about it."""

    iri: Iri
    facts: tuple[PropertyAssertion, ...] = ()


BodyId = NewType("BodyId", str)
"""The local name of an individual, unique in its world; constraints and lights have ids of the same kind."""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Color = tuple[float, float, float]
"""Red, green, blue, each 0 to 1."""


class FrozenStruct(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What all parts of a world are: frozen, hashable, made by keyword."""


class Pose(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where something is: a position [m] and a rotation, in the frame of the world unless said otherwise."""

    position: Vector = (0.0, 0.0, 0.0)
    """x, y, z [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """w, x, y, z as given: it may be normalized only to the digits that a map writes."""


IDENTITY = Pose()


class Mobility(StrEnum):
    """Who may move a body."""

    STATIC = "static"
    """Nobody: it is part of the building."""
    STATIONARY = "stationary"
    """Nobody: a light that may change its color, but not its place."""
    DYNAMIC = "dynamic"
    """The physics."""
    KINEMATIC = "kinematic"
    """A program; it pushes dynamic bodies and is never pushed."""


class BodyPhysics(FrozenStruct, frozen=True, kw_only=True):
    """How a body takes part in the physics; None means that the map does not say."""

    mobility: Mobility | None = None
    """None is taken as static."""
    gravity: bool | None = None
    """None is taken as true."""
    overlap_events: bool | None = None
    """Whether touching is announced; None is taken as false."""
    mass_kg: float | None = None
    """[kg]. None or 0 is not a mass; an engine that needs one estimates it from the size and says so."""

    @property
    def is_dynamic(self) -> bool:
        """Whether the physics moves the body."""
        return self.mobility is Mobility.DYNAMIC


class Tag(FrozenStruct, frozen=True, kw_only=True):
    """One key and value that an engine keeps with a body ("UTag")."""

    type: str
    key: str
    value: str


class Material(FrozenStruct, frozen=True, kw_only=True, rename={"color": "colour"}):
    """A named surface; the path says where an engine finds it, the color how to paint it without."""

    name: str
    path: str = ""
    color: Color | None = None


class PrimitiveType(StrEnum):
    """The forms that a body without a mesh can have."""

    BOX = "box"
    SPHERE = "sphere"
    CYLINDER = "cylinder"
    """Upright: its axis is z."""


class PrimitiveShape(FrozenStruct, frozen=True, kw_only=True, rename={"type": "kind"}):
    """The form of a body inside its size; a mesh, where it is found, is what one sees instead."""

    type: PrimitiveType = PrimitiveType.BOX


class Body(FrozenStruct, frozen=True, kw_only=True):
    """One individual that has a place."""

    id: BodyId
    iri: Iri
    cls: Iri
    """Its most telling class; further types are facts."""
    pose: Pose
    label: str | None = None
    size: Vector | None = None
    """Depth, width, height: the extents along its own x, y, z [m]."""
    mesh: str | None = None
    """A path (`package://…`) or a name."""
    shape: PrimitiveShape | None = None
    """None is taken as a box."""
    physics: BodyPhysics = BodyPhysics()
    materials: tuple[Material, ...] = ()
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()
    """Every other statement about the individual."""

    def __repr__(self) -> str:
        at = ", ".join(f"{part:.3f}" for part in self.pose.position)
        return f"<{type(self).__name__} {self.id} ({short_name(self.cls)}) at ({at}) m>"


class AxisMotion(IntEnum):
    """What one axis of a constraint allows; the numbers are those of maps and of the wire."""

    FREE = 0
    LIMITED = 1
    LOCKED = 2


class SoftLimit(FrozenStruct, frozen=True, kw_only=True):
    """A limit as a spring instead of a wall, where `enabled`."""

    enabled: bool = False
    stiffness: float = 0.0
    """[N/m] or [Nm/rad]."""
    damping: float = 0.0
    """[Ns/m] or [Nms/rad]."""


class LinearLimits(FrozenStruct, frozen=True, kw_only=True, rename={"soft_limit": "soft"}):
    """How far the child may slide along the axes of the joint frame, either way from the middle of its range.

    The middle is where it was spawned, unless it may go farther one way than the other: a drawer that is shut and
    opens by 0.4 m has its middle, and its limit, at 0.2 m.
    """

    x: AxisMotion = AxisMotion.LOCKED
    y: AxisMotion = AxisMotion.LOCKED
    z: AxisMotion = AxisMotion.LOCKED
    limit: float = 0.0
    """[m], for every limited axis."""
    x_middle: float = 0.0
    """Of the range along x, from where the child was spawned [m]; of no meaning where x is not limited."""
    y_middle: float = 0.0
    z_middle: float = 0.0
    soft_limit: SoftLimit = SoftLimit()


class AngularLimits(
    FrozenStruct, frozen=True, kw_only=True, rename={"swing_soft_limit": "swing_soft", "twist_soft_limit": "twist_soft"}
):
    """How far the child may turn about the axes of the joint frame, either way from the middle of its range."""

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
    """Of the range about z, from where the child was spawned [rad]; see `LinearLimits`."""
    swing2_middle: float = 0.0
    twist_middle: float = 0.0
    swing_soft_limit: SoftLimit = SoftLimit()
    twist_soft_limit: SoftLimit = SoftLimit()


class Joint(FrozenStruct, frozen=True, kw_only=True):
    """A joint with up to six degrees of freedom between two bodies (PhysX calls it D6)."""

    id: BodyId
    iri: Iri
    parent: BodyId
    child: BodyId
    """Roles as the map has them; the heavier side may well be the child."""
    pose: Pose
    """The joint's frame when spawned, in the world."""
    linear: LinearLimits = LinearLimits()
    angular: AngularLimits = AngularLimits()
    disable_collision: bool | None = None
    """Between the two bodies; None is taken as true."""
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id}: {self.parent} -> {self.child}>"


class Attachment(FrozenStruct, frozen=True, kw_only=True):
    """The child goes where the parent goes, and never the other way round."""

    parent: BodyId
    child: BodyId


class LightType(StrEnum):
    """How a light shines."""

    POINT = "point"
    SPOT = "spot"
    """Along the negative z axis of its pose."""
    DIRECTIONAL = "directional"


class Light(FrozenStruct, frozen=True, kw_only=True, rename={"type": "kind", "color": "colour"}):
    """A source of light."""

    id: BodyId
    iri: Iri
    type: LightType
    pose: Pose
    color: Color = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """[cd] for point and spot, [lx] for directional, as glTF's KHR_lights_punctual has it."""
    tags: tuple[Tag, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()


class World(FrozenStruct, frozen=True, kw_only=True, rename={"joints": "constraints"}):
    """A whole place. Order carries no meaning; ids are unique across bodies, constraints and lights."""

    iri: Iri
    """The map's individual."""
    name: str = ""
    bodies: tuple[Body, ...] = ()
    joints: tuple[Joint, ...] = ()
    attachments: tuple[Attachment, ...] = ()
    lights: tuple[Light, ...] = ()
    facts: tuple[PropertyAssertion, ...] = ()
    """What is said about the map itself."""
    resources: tuple[NamedResource, ...] = ()
    """What the map's source says about anything else: its classes, its properties, the ontology it is part of."""
    format_version: int = 1

    def __repr__(self) -> str:
        counts = (counted(len(self.bodies), "body"), counted(len(self.joints), "joint"))
        return f"<{type(self).__name__} {self.name or short_name(self.iri)}: {', '.join(counts)}>"

    def _repr_html_(self) -> str:
        """The bodies as a table for notebooks."""
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
        """The body of that id; made for tests and consoles, since it looks through all of them.

        Raises:
            BodyNotFoundError: no body has that id.
        """
        for body in self.bodies:
            if body.id == id:
                return body
        raise BodyNotFoundError(id, known=[body.id for body in self.bodies], world=self.name)
