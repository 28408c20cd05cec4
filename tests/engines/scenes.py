"""Small worlds for tests of physics."""

from __future__ import annotations

from typing import Any

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
    World,
)

BASE = "http://example.org/maps/scene.owl#"
LIMIT_M = 0.45
LIMIT_RAD = 0.7853981633974483


def body(
    id: str, position: Vector, size: Vector, mobility: str = "static", mass: float | None = None, **more: Any
) -> Body:
    """A box; `more` is passed to `Body`, `quaternion` to its pose, `gravity` to its physics."""
    pose = Pose(position, more.pop("quaternion", (1.0, 0.0, 0.0, 0.0)))
    physics = BodyPhysics(mobility=Mobility(mobility), mass_kg=mass, gravity=more.pop("gravity", True))
    return Body(
        id=BodyId(id), iri=Iri(BASE + id), cls=Iri(BASE + "Thing"), pose=pose, size=size, physics=physics, **more
    )


def prismatic_joint(id: str, parent: str, child: str, at: Vector, limit: float = LIMIT_M, **more: Any) -> Joint:
    """The joint of a drawer: along x, in both directions."""
    pose = Pose(at, more.pop("quaternion", (1.0, 0.0, 0.0, 0.0)))
    return Joint(
        id=BodyId(id),
        iri=Iri(BASE + id),
        parent=BodyId(parent),
        child=BodyId(child),
        pose=pose,
        linear=LinearLimits(x=AxisMotion.LIMITED, limit=limit),
        **more,
    )


def revolute_joint(id: str, parent: str, child: str, at: Vector, limit: float = LIMIT_RAD, **more: Any) -> Joint:
    """The joint of a door: about z, in both directions."""
    return Joint(
        id=BodyId(id),
        iri=Iri(BASE + id),
        parent=BodyId(parent),
        child=BodyId(child),
        pose=Pose(at),
        angular=AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=limit),
        **more,
    )


def fixed_joint(id: str, parent: str, child: str, at: Vector) -> Joint:
    """A joint with all axes locked."""
    return Joint(id=BodyId(id), iri=Iri(BASE + id), parent=BodyId(parent), child=BodyId(child), pose=Pose(at))


def attachment(parent: str, child: str) -> Attachment:
    return Attachment(parent=BodyId(parent), child=BodyId(child))


def world(*parts: Body | Joint | Attachment) -> World:
    return World(
        iri=Iri(BASE + "scene"),
        name="scene",
        bodies=tuple(part for part in parts if isinstance(part, Body)),
        joints=tuple(part for part in parts if isinstance(part, Joint)),
        attachments=tuple(part for part in parts if isinstance(part, Attachment)),
    )


FLOOR = body("floor", (0, 0, -0.05), (20, 20, 0.1))


def room() -> World:
    """A floor, a cabinet with a mug in its drawer, a fridge with a door and a handle, and a crate in the air."""
    return world(
        FLOOR,
        body("cabinet", (0, 0, 0.5), (0.6, 0.6, 1.0)),
        body("drawer", (0, 0, 0.3), (0.58, 0.55, 0.2), "dynamic", 5.0),
        body("drawer_handle", (0.32, 0, 0.3), (0.05, 0.3, 0.02), "kinematic", 0.2),
        body("mug", (0.05, 0.1, 0.27), (0.08, 0.08, 0.1), "dynamic", 0.3),
        body("fridge", (0, 2, 0.9), (0.6, 0.6, 1.8)),
        body("door", (0.322, 2, 0.9), (0.04, 0.6, 1.8), "dynamic", 8.0),
        body("door_handle", (0.362, 1.75, 0.9), (0.04, 0.03, 0.4), "kinematic", 0.3),
        body("crate", (2, 0, 1), (0.3, 0.3, 0.3), "dynamic", 2.0),
        prismatic_joint("drawer_slide", "cabinet", "drawer", (0.29, 0, 0.3)),
        revolute_joint("door_hinge", "fridge", "door", (0.302, 2.3, 0.9)),
        attachment("drawer", "drawer_handle"),
        attachment("door", "door_handle"),
    )
