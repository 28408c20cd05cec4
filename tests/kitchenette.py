"""A small hand-written kitchen with a drawer, a door and a loose body, shared by the tests of several packages."""

from __future__ import annotations

from math import pi

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
    Literal,
    Mobility,
    NamedResource,
    Pose,
    PropertyAssertion,
    Tag,
    Vector,
    World,
)

__all__ = ["KNOWROB", "MAP", "RDFS", "kitchenette"]

KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
MAP = "http://example.org/maps/M.owl#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"


def kitchenette() -> World:
    """A floor, a cupboard with a drawer that slides 0.45 m, a fridge whose door turns 45 degrees, handles, a mug.

    Fronts face -x. The handles are kinematic and attached to what they open; the mug is on the cupboard.
    """
    return World(
        iri=Iri(MAP + "map"),
        name="map",
        bodies=(
            _furniture("Floor", "Floor", (2.0, 0.5, -0.05), (6.0, 6.0, 0.1), Mobility.STATIC),
            _furniture("Cupboard", "Cupboard", (2.0, 0.0, 0.4), (0.6, 0.6, 0.8), Mobility.STATIC, 40.0),
            _furniture("Drawer", "Drawer", (1.95, 0.0, 0.65), (0.5, 0.5, 0.2), Mobility.DYNAMIC, 4.0),
            _furniture("DrawerHandle", "Handle", (1.68, 0.0, 0.65), (0.04, 0.2, 0.02), Mobility.KINEMATIC, 0.2),
            _furniture("Fridge", "Refrigerator", (2.0, 1.0, 0.9), (0.6, 0.6, 1.8), Mobility.STATIC, 60.0),
            _furniture("FridgeDoor", "Door", (1.68, 1.0, 0.9), (0.04, 0.6, 1.8), Mobility.DYNAMIC, 8.0),
            _furniture("FridgeHandle", "Handle", (1.64, 0.75, 1.0), (0.04, 0.02, 0.3), Mobility.KINEMATIC, 0.2),
            _furniture("Mug", "Cup", (2.0, 0.0, 0.85), (0.08, 0.08, 0.1), Mobility.DYNAMIC, 0.3),
        ),
        joints=(
            Joint(
                id=BodyId("DrawerSlide"),
                iri=Iri(MAP + "DrawerSlide"),
                parent=BodyId("Cupboard"),
                child=BodyId("Drawer"),
                pose=Pose((1.95, 0.0, 0.65)),
                linear=LinearLimits(x=AxisMotion.LIMITED, limit=0.45),
            ),
            Joint(
                id=BodyId("FridgeHinge"),
                iri=Iri(MAP + "FridgeHinge"),
                parent=BodyId("Fridge"),
                child=BodyId("FridgeDoor"),
                pose=Pose((1.68, 1.3, 0.9)),
                angular=AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=pi / 4),
            ),
        ),
        attachments=(
            Attachment(parent=BodyId("Drawer"), child=BodyId("DrawerHandle")),
            Attachment(parent=BodyId("FridgeDoor"), child=BodyId("FridgeHandle")),
        ),
        resources=(
            NamedResource(
                Iri(KNOWROB + "Handle"), (PropertyAssertion(Iri(RDFS + "comment"), Literal("made to be held")),)
            ),
        ),
    )


def _furniture(
    id: str, cls: str, position: Vector, size: Vector, mobility: Mobility, mass_kg: float | None = None
) -> Body:
    return Body(
        id=BodyId(id),
        iri=Iri(MAP + id),
        cls=Iri(KNOWROB + cls),
        pose=Pose(position),
        size=size,
        physics=BodyPhysics(mobility=mobility, gravity=True, overlap_events=False, mass_kg=mass_kg),
        tags=(Tag(type="SemLog", key="Class", value=cls), Tag(type="SemLog", key="Id", value=id)),
    )
