"""Poses, colors and bodies as messages: round trips, and notes about what is lost or assumed."""

from __future__ import annotations

import json
from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import given
from msgspec.structs import replace

from mindstage.bridge.conversions import (
    color_code,
    color_from_code,
    color_from_message,
    color_message,
    point_from_message,
    point_message,
    pose_array_from_messages,
    pose_array_messages,
    pose_from_message,
    pose_message,
    vector_from_message,
    vector_message,
)
from mindstage.bridge.conversions_unreal import (
    body_from_box,
    body_from_message,
    iri_from_id,
    materials_from_lists,
    model_message,
    physics_from_message,
    physics_message,
    spawn_model_request,
    spawn_request,
    untranslatable_fields,
    world_from_request,
)
from mindstage.errors import MessageValidationError
from mindstage.msgs import decode, encode, world_control_msgs
from mindstage.scene import (
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Material,
    Mobility,
    Pose,
    PrimitiveShape,
    PrimitiveType,
    Tag,
    World,
)
from mindstage.scene.colors import COLORS
from mindstage.scene.transforms import pose_array
from tests.bridge.conversion_cases import ASYMMETRIC, MUG, transmittable_part
from tests.cases import each_case
from tests.kitchenette import KNOWROB, MAP
from tests.worlds import bodies, poses

# -- poses -------------------------------------------------------------------------------------------------------------


def test_a_pose_message_has_the_same_frame_and_numbers_as_the_pose() -> None:
    message = pose_message(ASYMMETRIC)
    assert encode(message) == {
        "position": {"x": 1.0, "y": 2.0, "z": 3.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": sin(radians(15.0)), "w": cos(radians(15.0))},
    }
    assert pose_from_message(message) == ASYMMETRIC


@given(pose=poses())
def test_any_pose_survives_a_round_trip_exactly(pose: Pose) -> None:
    assert pose_from_message(pose_message(pose)) == pose
    assert point_from_message(point_message(pose.position)) == pose.position
    assert vector_from_message(vector_message(pose.position)) == pose.position


def test_an_array_of_poses_is_converted() -> None:
    rows = pose_array([ASYMMETRIC, Pose((4.0, 5.0, 6.0))])
    messages = pose_array_messages(rows)
    assert messages == (pose_message(ASYMMETRIC), pose_message(Pose((4.0, 5.0, 6.0))))
    np.testing.assert_array_equal(pose_array_from_messages(messages), rows)
    assert pose_array_from_messages(()).shape == (0, 7)


# -- colors ------------------------------------------------------------------------------------------------------------


def test_five_colors_have_codes_and_none_removes_the_highlight() -> None:
    for number, name in enumerate(("black", "red", "blue", "green", "yellow"), start=1):
        assert world_control_msgs.ColorCode(number).name == name.upper()
        assert color_from_code(world_control_msgs.ColorCode(number)) == COLORS[name]
        assert color_code(COLORS[name]) == number
    assert color_from_code(world_control_msgs.ColorCode.NONE) is None
    assert color_code(None) is world_control_msgs.ColorCode.NONE


def test_any_other_color_has_the_code_of_the_nearest() -> None:
    assert color_code((0.9, 0.1, 0.1)) is world_control_msgs.ColorCode.RED
    assert color_code((1.0, 0.8, 0.0)) is world_control_msgs.ColorCode.YELLOW
    assert color_from_message(color_message((0.1, 0.2, 0.3))) == (0.1, 0.2, 0.3)


# -- bodies ------------------------------------------------------------------------------------------------------------


@given(body=bodies(wild_tags=True))
def test_any_body_survives_a_round_trip_but_for_the_noted_fields(body: Body) -> None:
    model = decode(
        world_control_msgs.ModelDescription, json.loads(json.dumps(encode(model_message(body)))), strict=True
    )
    back, notes = body_from_message(model, namespace=MAP)
    assert back == transmittable_part(body)
    assert notes == ()
    named = {note.field for note in untranslatable_fields(World(iri=Iri(MAP + "map"), bodies=(body,)))}
    assert ("facts" in named) == bool(body.facts)
    assert ("materials" in named) == any(material.color is not None for material in body.materials)


def test_tags_of_a_body_are_not_confused_with_generated_tags() -> None:
    lookalike = tuple(Tag(type="Mindstage", key=key, value="x") for key in ("Shape", "Size", "Untold"))
    body = replace(MUG, tags=(*lookalike, Tag(type="SemLog", key="Id", value="mug"), *lookalike))
    assert body_from_message(model_message(body), namespace=MAP)[0] == body


@each_case(
    ("mesh", "name", "path"),
    [
        (None, "Cup", ""),
        ("package://maps/Mug/Mug.dae", "Mug", ""),
        ("SM_Mug", "Mug", ""),
        ("/Game/Models/Kitchen/SM_Mug.uasset", "Mug", "/Game/Models/Kitchen"),
        ("meshes/mug.v2.obj", "mug.v2", ""),
    ],
)
def test_a_model_is_named_after_its_mesh_or_its_class(mesh: str | None, name: str, path: str) -> None:
    model = model_message(replace(MUG, mesh=mesh))
    assert (model.name, model.path) == (name, path)


def test_missing_physics_properties_have_defaults() -> None:
    message = physics_message(BodyPhysics())
    assert message == world_control_msgs.PhysicsProperties(
        mobility=world_control_msgs.MobilityCode.STATIC, gravity=True, generate_overlap_events=False, mass=0.0
    )
    assert physics_from_message(message) == BodyPhysics(
        mobility=Mobility.STATIC, gravity=True, overlap_events=False, mass_kg=0.0
    )
    for mobility in Mobility:
        assert physics_from_message(physics_message(BodyPhysics(mobility=mobility))).mobility is mobility


def test_a_spawn_request_can_have_a_parent() -> None:
    request = spawn_model_request(MUG, parent="cupboard", spawn_collision_check=True)
    assert (request.id, request.parent_id, request.spawn_collision_check) == ("mug", "cupboard", True)
    assert body_from_message(request, namespace=MAP)[0] == MUG


def test_assumptions_about_a_foreign_model_are_noted() -> None:
    model = world_control_msgs.ModelDescription(
        name="IAIFridge",
        id="fridge_1",
        tags=(world_control_msgs.Tag(type="SemLog", key="Class", value="Refrigerator"),),
        path="/Game/Models/",
        material_names=("Steel", "Glass"),
        material_paths=("/Game/M",),
    )
    body, notes = body_from_message(model, namespace=MAP)
    assert (body.iri, body.cls) == (MAP + "fridge_1", KNOWROB + "Refrigerator")
    assert (body.mesh, body.label, body.size) == ("/Game/Models/IAIFridge", None, None)
    assert body.materials == (Material(name="Steel", path="/Game/M"), Material(name="Glass"))
    assert {note.field for note in notes} == {"size", "class", "materials"}
    assert body_from_message(replace(model, tags=()), namespace=MAP)[0].cls == KNOWROB + "IAIFridge"
    assert body_from_message(replace(model, id="http://knowrob.org/kb/shop.owl#P_1"), namespace=MAP)[0].iri.endswith(
        "#P_1"
    )


def test_invalid_generated_tags_are_rejected_with_the_path() -> None:
    request = spawn_request(World(iri=Iri(MAP + "map"), bodies=(replace(MUG, size=(1.0, 2.0, 3.0)),)))
    (model,) = request.models
    tags = tuple(replace(tag, value="1 2") if tag.key == "Size" else tag for tag in model.tags)
    broken = replace(request, models=(replace(model, tags=tags),))
    with pytest.raises(MessageValidationError, match="a tag of the type Mindstage is invalid") as refused:
        world_from_request(broken, iri=Iri(MAP + "map"))
    assert refused.value.path == "models[0].tags"


def test_a_box_request_becomes_a_body_of_that_size() -> None:
    request = world_control_msgs.SpawnProMesh.Request(
        height=0.8, width=0.6, depth=0.4, pose=pose_message(ASYMMETRIC), actor_label="crate"
    )
    body = body_from_box(request, id="box_1", namespace=MAP)
    assert (body.id, body.size, body.shape, body.pose) == (
        "box_1",
        (0.4, 0.6, 0.8),
        PrimitiveShape(type=PrimitiveType.BOX),
        ASYMMETRIC,
    )
    assert body.label == "crate"


def test_missing_elements_of_parallel_material_lists_are_empty() -> None:
    assert materials_from_lists((), ("/Game/M",)) == (Material(name="", path="/Game/M"),)
    assert materials_from_lists((), ()) == ()


@pytest.mark.parametrize(
    ("id", "iri"),
    [
        ("Mug_1", "http://example.org/map#Mug_1"),
        ("http://example.org/other#Mug_1", "http://example.org/other#Mug_1"),
    ],
)
def test_an_id_without_a_namespace_is_in_that_of_the_map(id: str, iri: str) -> None:
    assert iri_from_id(id, "http://example.org/map#") == iri


@pytest.mark.parametrize(
    ("cls", "name"),
    [("http://e.org/a#Mug", "Mug"), ("http://e.org/a#b#Mug", "Mug"), ("http://e.org/a/Mug", "Mug")],
)
def test_the_mesh_of_a_class_is_its_local_name(cls: str, name: str) -> None:
    body = Body(id=BodyId("b"), iri=Iri("http://e.org/a#b"), cls=Iri(cls), pose=Pose())
    assert model_message(body).name == name
