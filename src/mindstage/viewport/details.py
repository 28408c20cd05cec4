"""Details: all that is known of one body, as the page shows it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.stage import Joint, JointAxis
from mindstage.world import Anonymous, Body, BodyId, Colour, Fact, Iri, Literal, Pose, Reference, Vector, World
from mindstage.world.colours import hex_text
from mindstage.world.geometry import Array, pose_from, unit

__all__ = ["Details", "FactLine", "JointDetails", "Kept", "Live", "MaterialDetails", "details_of", "live_of"]

_MOST_FACTS = 200
_MILLIMETRE_TENTHS = 4
_TURN_DIGITS = 5


class JointDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A constraint that the body is part of."""

    id: BodyId
    other_body: BodyId
    """The other end."""
    moving: BodyId
    """The end that moves."""
    axes: tuple[JointAxis, ...]


class MaterialDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A surface."""

    name: str
    color: str | None
    """#rrggbb."""


class FactLine(msgspec.Struct, frozen=True, kw_only=True):
    """A statement, in short names."""

    property: str
    value: str
    id: BodyId | None = None
    """Of the body that the value is."""


class Kept(msgspec.Struct, frozen=True, kw_only=True):
    """Where things of such a class are kept."""

    class_name: str
    """The class of the place."""
    ids: tuple[BodyId, ...]
    """The bodies that are such places."""


class Details(msgspec.Struct, frozen=True, kw_only=True):
    """What does not change while the physics goes on."""

    id: BodyId
    iri: Iri
    label: str
    cls: str
    ancestors: tuple[str, ...]
    size: Vector | None
    mass: float | None
    mobility: str | None
    gravity: bool | None
    overlap_events: bool | None
    materials: tuple[MaterialDetails, ...]
    attached_to: BodyId | None
    attached_bodies: tuple[BodyId, ...]
    joints: tuple[JointDetails, ...]
    tags: tuple[tuple[str, str, str], ...]
    facts: tuple[FactLine, ...]
    storage_places: tuple[Kept, ...]
    geometry: str
    """What its geometry is and why, where it has one."""


class Live(msgspec.Struct, frozen=True, kw_only=True):
    """What changes all the time."""

    id: BodyId
    pose: Pose
    joints: Mapping[BodyId, Mapping[str, float]]


def details_of(
    body: Body,
    world: World,
    *,
    ancestors: Sequence[Iri],
    joints: Iterable[Joint],
    storage_places: Iterable[Kept],
    geometry: str = "",
) -> Details:
    """What there is to know about a body.

    Args:
        body: as it is described.
        world: that it is in.
        ancestors: of its class, nearest first.
        joints: that it is part of.
        storage_places: where its kind is kept.
        geometry: what its geometry is and why.
    """
    ids = {str(other.iri): other.id for other in world.bodies}
    physics = body.physics
    return Details(
        id=body.id,
        iri=body.iri,
        label=body.label or "",
        cls=local_name(body.cls),
        ancestors=tuple(map(local_name, ancestors)),
        size=body.size,
        mass=physics.mass_kg,
        mobility=physics.mobility.value if physics.mobility else None,
        gravity=physics.gravity,
        overlap_events=physics.overlap_events,
        materials=tuple(MaterialDetails(name=each.name, color=_hex(each.colour)) for each in body.materials),
        attached_to=next((hold.parent for hold in world.attachments if hold.child == body.id), None),
        attached_bodies=tuple(hold.child for hold in world.attachments if hold.parent == body.id),
        joints=tuple(_joint(joint, body.id) for joint in joints),
        tags=tuple((tag.type, tag.key, tag.value) for tag in body.tags),
        facts=tuple(_line(fact, ids) for fact in body.facts[:_MOST_FACTS]),
        storage_places=tuple(storage_places),
        geometry=geometry,
    )


def live_of(id: BodyId, poses: Mapping[BodyId, Array], joints: Iterable[Joint]) -> Live:
    """Where a body and its joints are, in digits that a person reads: what trembles less than that is not told.

    Args:
        id: the body.
        poses: where all are, seven numbers each.
        joints: that it is part of.
    """
    x, y, z, *turn = poses[id].tolist()
    row = [round(number, _MILLIMETRE_TENTHS) + 0.0 for number in (x, y, z)]
    row += [round(number, _TURN_DIGITS) + 0.0 for number in unit(turn).tolist()]
    return Live(
        id=id,
        pose=pose_from(row),
        joints={
            joint.constraint.id: {
                axis: round(value, _MILLIMETRE_TENTHS) + 0.0 for axis, value in joint.positions(poses).items()
            }
            for joint in joints
        },
    )


def _joint(joint: Joint, id: BodyId) -> JointDetails:
    ends = (joint.constraint.parent, joint.constraint.child)
    other = ends[1] if ends[0] == id else ends[0]
    return JointDetails(id=joint.constraint.id, other_body=other, moving=joint.moving, axes=joint.axes)


def _line(fact: Fact, ids: Mapping[str, BodyId]) -> FactLine:
    property = local_name(fact.property)
    match fact.value:
        case Reference(iri):
            return FactLine(property=property, value=ids.get(iri) or local_name(iri), id=ids.get(iri))
        case Literal(text):
            return FactLine(property=property, value=text)
        case Anonymous(facts):
            return FactLine(
                property=property, value=", ".join(local_name(each.property) for each in facts) or "something"
            )


def _hex(colour: Colour | None) -> str | None:
    return None if colour is None else hex_text(colour)
