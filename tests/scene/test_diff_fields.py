"""Every field of every part of a world is compared: each is changed once and must be reported."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import Enum
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace
from tests.cases import each_case

from mindstage.scene import (
    AngularLimits,
    Attachment,
    AxisMotion,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    JointMimic,
    Light,
    LightType,
    LinearLimits,
    Literal,
    Material,
    Mobility,
    NamedResource,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    PropertyAssertion,
    SoftLimit,
    Tag,
    World,
    diff,
)
from mindstage.scene.world_diff import BODY_FIELDS, JOINT_FIELDS, LIGHT_FIELDS, MEASURED_KINDS, WORLD_FIELDS, ChangeKind

STATEMENTS: Mapping[str, Any] = {
    "tags": (Tag(type="SemLog", key="Id", value="x"),),
    "facts": (PropertyAssertion(Iri("urn:p"), Literal("1")),),
}
POSE = Pose((1.0, 2.0, 3.0), (0.5, 0.5, -0.5, 0.5))
SOFT = SoftLimit(enabled=False, stiffness=10.0, damping=1.0)
BODY = Body(
    id=BodyId("body"),
    iri=Iri("urn:body"),
    cls=Iri("urn:Cup"),
    label="a cup",
    pose=POSE,
    size=(0.1, 0.2, 0.3),
    mesh="Cup",
    shape=PrimitiveShape(type=PrimitiveType.CYLINDER),
    physics=BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True, overlap_events=False, mass_kg=2.0),
    materials=(Material(name="Clay"),),
    **STATEMENTS,
)
JOINT = Joint(
    id=BodyId("joint"),
    iri=Iri("urn:joint"),
    parent=BodyId("body"),
    child=BodyId("other"),
    pose=POSE,
    linear=LinearLimits(limit=0.5, soft_limit=SOFT),
    angular=AngularLimits(
        swing1_limit=0.1, swing2_limit=0.2, twist_limit=0.3, swing_soft_limit=SOFT, twist_soft_limit=SOFT
    ),
    disable_collision=True,
    mimic=JointMimic(joint=BodyId("master"), multiplier=2.0, offset=0.1),
    **STATEMENTS,
)
LIGHT = Light(
    id=BodyId("light"), iri=Iri("urn:light"), type=LightType.SPOT, pose=POSE, color=(0.5, 0.5, 0.5), **STATEMENTS
)
WORLD = World(
    iri=Iri("urn:map"),
    name="a map",
    bodies=(BODY,),
    joints=(JOINT,),
    attachments=(Attachment(parent=BodyId("other"), child=BodyId("body")),),
    lights=(LIGHT,),
    facts=STATEMENTS["facts"],
    resources=(NamedResource(Iri("urn:resource"), STATEMENTS["facts"]),),
)

PARTS = (
    ("bodies", BODY, BODY_FIELDS),
    ("joints", JOINT, JOINT_FIELDS),
    ("lights", LIGHT, LIGHT_FIELDS),
)
OPTIONAL = {
    *("label", "size", "mesh", "shape", "disable_collision", "mimic"),
    *("physics.mobility", "physics.gravity", "physics.overlap_events", "physics.mass_kg"),
}
NOT_IN_A_COLUMN = {"id", "tags", "facts", "materials", "bodies", "joints", "attachments", "lights", "resources"}
NOT_IN_A_COLUMN |= {"assumed", "physics.assumed"}


def leaves(value: msgspec.Struct, prefix: str = "") -> Iterator[str]:
    for field in msgspec.structs.fields(value):
        inner = getattr(value, field.name)
        if isinstance(inner, msgspec.Struct) and not isinstance(inner, PrimitiveShape | JointMimic):
            yield from leaves(inner, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name


def other_than(value: Any) -> Any:
    match value:
        case AxisMotion():
            return AxisMotion((value + 1) % 3)
        case Enum():
            return next(member for member in type(value) if member is not value)
        case PrimitiveShape():
            return PrimitiveShape(type=PrimitiveType.SPHERE)
        case JointMimic():
            return JointMimic(joint=BodyId("another"))
        case bool():
            return not value
        case float() | int():
            return value + 0.25
        case str():
            return value + "x"
        case (w, x, y, z):
            return (w, x, -y, z)
        case (x, y, z):
            return (x, y, z + 0.25)
    raise AssertionError(f"nothing else than {value!r}")


def with_field(part: msgspec.Struct, field: str, value: Any) -> Any:
    head, _, tail = field.partition(".")
    return replace(part, **{head: with_field(getattr(part, head), tail, value) if tail else value})


def in_world(collection: str, part: Any) -> World:
    return replace(WORLD, **{collection: (part,)})


@pytest.mark.parametrize(("value", "fields"), [(WORLD, WORLD_FIELDS), *((part, fields) for _, part, fields in PARTS)])
def test_every_field_is_compared(value: msgspec.Struct, fields: Mapping[str, ChangeKind]) -> None:
    assert set(leaves(value)) - NOT_IN_A_COLUMN == set(fields)


@each_case(
    ("collection", "part", "field", "kind"),
    [
        pytest.param(collection, part, field, kind, id=f"{part.id}: {field}")
        for collection, part, fields in PARTS
        for field, kind in fields.items()
    ],
)
def test_a_changed_field_is_named_and_measured(collection: str, part: Any, field: str, kind: ChangeKind) -> None:
    before = _get(part, field)
    after = other_than(before)
    (change,) = diff(WORLD, in_world(collection, with_field(part, field, after))).changed
    assert (change.id, change.field, change.kind, change.a, change.b) == (part.id, field, kind, before, after)
    expected = None if kind not in MEASURED_KINDS else math.pi / 1.5 if kind is ChangeKind.ROTATION else 0.25
    assert change.error == (expected if expected is None else pytest.approx(expected))


@each_case("field", sorted(OPTIONAL - {"disable_collision", "mimic"}))
def test_a_field_against_none_is_a_change_without_a_number(field: str) -> None:
    without = in_world("bodies", with_field(BODY, field, None))
    for found in (diff(WORLD, without), diff(without, WORLD)):
        assert [(change.field, change.error) for change in found.changed] == [(field, None)]
    assert diff(without, without).identical()


@pytest.mark.parametrize("field", ["disable_collision", "mimic"])
def test_an_unstated_field_of_a_joint_is_a_change(field: str) -> None:
    without = in_world("joints", replace(JOINT, **{field: None}))
    assert [change.field for change in diff(WORLD, without).changed] == [field]


@pytest.mark.parametrize("field", WORLD_FIELDS)
def test_fields_of_the_world_are_compared(field: str) -> None:
    changed = replace(WORLD, **{field: other_than(getattr(WORLD, field))})
    assert [(change.id, change.field) for change in diff(WORLD, changed).changed] == [("urn:map", field)]


@each_case(("collection", "part"), [(collection, part) for collection, part, _ in PARTS], ids=str)
@each_case("field", STATEMENTS)
def test_facts_and_tags_of_each_object_are_compared(collection: str, part: Any, field: str) -> None:
    found = diff(WORLD, in_world(collection, replace(part, **{field: ()})))
    assert [(change.id, change.field, change.kind) for change in found.changed] == [(part.id, field, field)]
    assert found.changed[0].a == STATEMENTS[field]
    assert found.lost_facts == 1
    assert found.lost[0].id == part.id
    assert found.lost[0].assertion == STATEMENTS[field][0]


def test_facts_of_the_world_are_compared() -> None:
    found = diff(WORLD, replace(WORLD, facts=()))
    assert [(change.id, change.field) for change in found.changed] == [("urn:map", "facts")]
    assert found.lost_facts == 1


def test_facts_of_resources_are_compared() -> None:
    without_facts = replace(WORLD, resources=(NamedResource(Iri("urn:resource")),))
    found = diff(WORLD, without_facts)
    assert [(change.id, change.field) for change in found.changed] == [("urn:resource", "facts")]
    assert found.lost_facts == 1
    without_resource = replace(WORLD, resources=())
    found = diff(WORLD, without_resource)
    assert [(change.id, change.field, change.b) for change in found.changed] == [("urn:resource", "resource", None)]
    assert found.lost_facts == 1
    assert [change.field for change in diff(without_facts, without_resource).changed] == ["resource"]
    assert diff(without_resource, WORLD).gained_facts == 1


def _get(part: Any, field: str) -> Any:
    for name in field.split("."):
        part = getattr(part, name)
    return part
