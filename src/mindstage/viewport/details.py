"""Details: all that is known of one body, as the page shows it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from mindstage.knowledge.names import local_name
from mindstage.stage import JointAxisState, JointHandle
from mindstage.world import (
    BlankNode,
    Body,
    BodyId,
    Color,
    Iri,
    IriRef,
    Literal,
    Pose,
    PropertyAssertion,
    Vector,
    World,
)
from mindstage.world.colors import hex_color
from mindstage.world.geometry import Array, normalize, pose_from_array

__all__ = [
    "BodyDetails",
    "FactRow",
    "JointDetails",
    "LiveDetails",
    "MaterialDetails",
    "StorageHint",
    "body_details",
    "live_details",
]

_MAX_FACTS = 200
_POSITION_DIGITS = 4
_ROTATION_DIGITS = 5


class JointDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A constraint that the body is part of."""

    id: BodyId
    other_body: BodyId
    """The other end."""
    moving: BodyId
    """The end that moves."""
    axes: tuple[JointAxisState, ...]


class MaterialDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A surface."""

    name: str
    color: str | None
    """#rrggbb."""


class FactRow(msgspec.Struct, frozen=True, kw_only=True):
    """A statement, in short names."""

    property: str
    value: str
    id: BodyId | None = None
    """Of the body that the value is."""


class StorageHint(msgspec.Struct, frozen=True, kw_only=True):
    """Where things of such a class are kept."""

    class_name: str
    """The class of the place."""
    ids: tuple[BodyId, ...]
    """The bodies that are such places."""


class BodyDetails(msgspec.Struct, frozen=True, kw_only=True):
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
    facts: tuple[FactRow, ...]
    storage_places: tuple[StorageHint, ...]
    geometry: str
    """What its geometry is and why, where it has one."""


class LiveDetails(msgspec.Struct, frozen=True, kw_only=True):
    """What changes all the time."""

    id: BodyId
    pose: Pose
    joints: Mapping[BodyId, Mapping[str, float]]


def body_details(
    body: Body,
    world: World,
    *,
    ancestors: Sequence[Iri],
    joints: Iterable[JointHandle],
    storage_places: Iterable[StorageHint],
    geometry: str = "",
) -> BodyDetails:
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
    return BodyDetails(
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
        materials=tuple(MaterialDetails(name=each.name, color=_hex(each.color)) for each in body.materials),
        attached_to=next((hold.parent for hold in world.attachments if hold.child == body.id), None),
        attached_bodies=tuple(hold.child for hold in world.attachments if hold.parent == body.id),
        joints=tuple(_joint(joint, body.id) for joint in joints),
        tags=tuple((tag.type, tag.key, tag.value) for tag in body.tags),
        facts=tuple(_fact_row(fact, ids) for fact in body.facts[:_MAX_FACTS]),
        storage_places=tuple(storage_places),
        geometry=geometry,
    )


def live_details(id: BodyId, poses: Mapping[BodyId, Array], joints: Iterable[JointHandle]) -> LiveDetails:
    """Where a body and its joints are, in digits that a person reads: what trembles less than that is not told.

    Args:
        id: the body.
        poses: where all are, seven numbers each.
        joints: that it is part of.
    """
    x, y, z, *turn = poses[id].tolist()
    row = [round(number, _POSITION_DIGITS) + 0.0 for number in (x, y, z)]
    row += [round(number, _ROTATION_DIGITS) + 0.0 for number in normalize(turn).tolist()]
    return LiveDetails(
        id=id,
        pose=pose_from_array(row),
        joints={
            joint.joint.id: {
                axis: round(value, _POSITION_DIGITS) + 0.0 for axis, value in joint.positions(poses).items()
            }
            for joint in joints
        },
    )


def _joint(joint: JointHandle, id: BodyId) -> JointDetails:
    ends = (joint.joint.parent, joint.joint.child)
    other = ends[1] if ends[0] == id else ends[0]
    return JointDetails(id=joint.joint.id, other_body=other, moving=joint.moving_body, axes=joint.axes)


def _fact_row(fact: PropertyAssertion, ids: Mapping[str, BodyId]) -> FactRow:
    property = local_name(fact.property)
    match fact.value:
        case IriRef(iri):
            return FactRow(property=property, value=ids.get(iri) or local_name(iri), id=ids.get(iri))
        case Literal(text):
            return FactRow(property=property, value=text)
        case BlankNode(facts):
            return FactRow(
                property=property, value=", ".join(local_name(each.property) for each in facts) or "something"
            )


def _hex(color: Color | None) -> str | None:
    return None if color is None else hex_color(color)
