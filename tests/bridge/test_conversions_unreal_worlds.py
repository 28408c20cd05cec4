"""Joints and worlds as messages: round trips, and notes about what is lost or assumed."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from msgspec.structs import replace

from mindstage.bridge.conversions import ConversionNote
from mindstage.bridge.conversions_unreal import (
    joint_from_message,
    joint_message,
    spawn_request,
    untranslatable_fields,
    world_from_request,
)
from mindstage.msgs import encode, geometry_msgs, world_control_msgs
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    BodyId,
    Iri,
    Joint,
    LinearLimits,
    Literal,
    PropertyAssertion,
    SoftLimit,
    World,
)
from tests.bridge.conversion_cases import ASYMMETRIC, MUG, json_round_trip, transmittable_part
from tests.kitchenette import KNOWROB, MAP, kitchenette
from tests.worlds import joints, worlds

# -- constraints -------------------------------------------------------------------------------------------------------

DOOR = Joint(
    id=BodyId("hinge"),
    iri=Iri(MAP + "hinge"),
    parent=BodyId("case"),
    child=BodyId("door"),
    pose=ASYMMETRIC,
    linear=LinearLimits(
        x=AxisMotion.FREE,
        y=AxisMotion.LIMITED,
        limit=0.3,
        soft_limit=SoftLimit(enabled=True, stiffness=1.0, damping=2.0),
    ),
    angular=AngularLimits(
        swing1=AxisMotion.LIMITED,
        swing2=AxisMotion.FREE,
        swing1_limit=0.1,
        swing2_limit=0.2,
        twist_limit=0.3,
        swing_soft_limit=SoftLimit(enabled=True, stiffness=3.0, damping=4.0),
        twist_soft_limit=SoftLimit(stiffness=5.0, damping=6.0),
    ),
    disable_collision=False,
)


def test_a_joint_message_has_each_number_in_its_field() -> None:
    message = joint_message(DOOR)
    details = message.constraint_details
    assert (details.id_first_model, details.id_second_model, details.disable_collision) == ("case", "door", False)
    assert encode(details.linear_limits) == {
        "x_motion": 0, "y_motion": 1, "z_motion": 2, "limit": 0.3,
        "use_advanced": True, "soft_constraint": True, "stiffness": 1.0, "damping": 2.0,
    }  # fmt: skip
    assert encode(details.angular_limits) == {
        "swing_1_motion": 1, "swing_2_motion": 0, "twist_motion": 2,
        "swing_1_limit_angle": 0.1, "swing_2_limit_angle": 0.2, "twist_limit_angle": 0.3,
        "angular_roation_offset": {"x": 0.0, "y": 0.0, "z": 0.0}, "use_advanced": True,
        "swing_soft_constraint": True, "swing_stiffness": 3.0, "swing_damping": 4.0,
        "twist_soft_constraint": False, "twist_stiffness": 5.0, "twist_damping": 6.0,
    }  # fmt: skip
    assert joint_from_message(message, namespace=MAP) == (DOOR, ())


def with_symmetric_ranges(joint: Joint) -> Joint:
    linear, angular = joint.linear, joint.angular
    sliding = {axis: getattr(linear, f"{axis}_middle") for axis in "xyz" if getattr(linear, axis) is AxisMotion.LIMITED}
    turning = {
        f"{axis}_limit": getattr(angular, f"{axis}_limit")
        + (abs(getattr(angular, f"{axis}_middle")) if getattr(angular, axis) is AxisMotion.LIMITED else 0.0)
        for axis in ("swing1", "swing2", "twist")
    }
    return replace(
        joint,
        linear=replace(
            linear,
            x_middle=0.0,
            y_middle=0.0,
            z_middle=0.0,
            limit=linear.limit + max(map(abs, sliding.values()), default=0.0),
        ),
        angular=replace(angular, swing1_middle=0.0, swing2_middle=0.0, twist_middle=0.0, **turning),
    )


@given(joint=joints(BodyId("hinge"), BodyId("case"), BodyId("door")))
def test_any_joint_survives_a_round_trip_but_for_the_noted_fields(joint: Joint) -> None:
    back, notes = joint_from_message(joint_message(joint), namespace=MAP)
    assert notes == ()
    kept = replace(with_symmetric_ranges(joint), facts=(), tags=())
    assert back == replace(kept, disable_collision=joint.disable_collision is not False)
    named = {note.field for note in untranslatable_fields(World(iri=Iri(MAP + "map"), joints=(joint,)))}
    assert ("facts" in named) == bool(joint.facts)
    assert ("tags" in named) == bool(joint.tags)
    assert ("disable_collision" in named) == (joint.disable_collision is None)


def test_an_asymmetric_range_is_widened() -> None:
    drawer = replace(DOOR, linear=LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=-0.2))
    assert joint_message(drawer).constraint_details.linear_limits.limit == 0.4
    notes = untranslatable_fields(World(iri=Iri(MAP + "map"), joints=(drawer,)))
    assert [note.field for note in notes] == ["middle"]


def test_ignored_fields_of_a_foreign_joint_are_noted() -> None:
    message = joint_message(DOOR)
    limits = message.constraint_details
    foreign = replace(
        message,
        constraint_details=replace(
            limits,
            enable_projection=True,
            parent_dominates=True,
            linear_limits=replace(limits.linear_limits, use_advanced=False),
            angular_limits=replace(
                limits.angular_limits, use_advanced=False, angular_roation_offset=geometry_msgs.Vector3(z=0.5)
            ),
        ),
    )
    joint, notes = joint_from_message(foreign, namespace=MAP)
    assert not joint.linear.soft_limit.enabled
    assert not joint.angular.swing_soft_limit.enabled
    fields = [note.field for note in notes]
    assert fields == ["soft", "soft", "angular_roation_offset", "enable_projection", "parent_dominates"]


def test_motion_codes_equal_those_of_maps() -> None:
    assert [AxisMotion(code) for code in world_control_msgs.MotionCode] == [
        AxisMotion.FREE,
        AxisMotion.LIMITED,
        AxisMotion.LOCKED,
    ]


# -- worlds ------------------------------------------------------------------------------------------------------------


def test_the_kitchenette_survives_a_round_trip_but_for_the_noted_fields() -> None:
    world = kitchenette()
    back, notes = world_from_request(json_round_trip(spawn_request(world)), iri=world.iri, name="map")
    assert notes == ()
    assert {note.field for note in untranslatable_fields(world)} == {"disable_collision", "facts"}
    expected_joints = tuple(replace(joint, disable_collision=True) for joint in world.joints)
    assert back == replace(world, joints=expected_joints, resources=())


@given(world=worlds(wild_tags=True))
def test_any_world_survives_a_round_trip_but_for_the_noted_fields(world: World) -> None:
    back, notes = world_from_request(json_round_trip(spawn_request(world)), iri=world.iri, name=world.name)
    assert notes == ()
    assert back.attachments == world.attachments
    assert back.bodies == tuple(map(transmittable_part, world.bodies))
    named = {(note.field, id) for note in untranslatable_fields(world) for id in note.ids}
    assert {id for field, id in named if field == "lights"} == {light.id for light in world.lights}
    assert (("facts", world.iri) in named) == bool(world.facts or world.resources)
    if not named:
        assert back == world


def test_objects_without_an_id_get_a_new_one() -> None:
    request = world_control_msgs.SpawnSemanticMap.Request(
        models=(
            world_control_msgs.ModelDescription(name="Cup"),
            world_control_msgs.ModelDescription(name="Cup"),
            world_control_msgs.ModelDescription(name="Cup", id="Cup_1"),
        ),
        constraints=(world_control_msgs.ConstraintDescription(),),
    )
    world, notes = world_from_request(request, iri=Iri(MAP + "map"), taken={"Cup_2"})
    assert [body.id for body in world.bodies] == ["Cup_3", "Cup_4", "Cup_1"]
    assert world.joints[0].id == "Constraint_1"
    assert ConversionNote("id", ("Cup_3", "Cup_4", "Constraint_1"), "it has no id; this one was generated") in notes


def test_notes_with_the_same_text_are_merged() -> None:
    fact = PropertyAssertion(Iri(KNOWROB + "note"), Literal("x"))
    world = World(
        iri=Iri(MAP + "map"),
        bodies=tuple(replace(MUG, id=BodyId(id), facts=(fact,)) for id in ("a", "b", "c")),
    )
    assert untranslatable_fields(world) == (ConversionNote("facts", ("a", "b", "c"), "a model has no field for facts"),)


def test_the_thesis_map_survives_a_round_trip_but_for_the_noted_fields(shared_data: Path) -> None:
    from mindstage.knowledge import KnowledgeBase

    kb = KnowledgeBase()
    kb.load(shared_data / "maps" / "iai-kitchen-original.owl")
    world = kb.world()
    request = json_round_trip(spawn_request(world))
    assert (len(request.models), len(request.constraints), len(request.relations)) == (114, 22, 33)
    back, notes = world_from_request(request, iri=world.iri, name=world.name)
    assert notes == ()
    assert back.bodies == tuple(map(transmittable_part, world.bodies))
    assert back.attachments == world.attachments
    for joint, other in zip(world.joints, back.joints, strict=True):
        assert other == replace(joint, facts=(), tags=(), iri=other.iri, disable_collision=other.disable_collision)
    named = {(note.field, id) for note in untranslatable_fields(world) for id in note.ids}
    assert {("facts", body.id) for body in world.bodies if body.facts} <= named
    assert {
        ("iri", each.id) for each, other in zip(world.joints, back.joints, strict=True) if each.iri != other.iri
    } <= named
