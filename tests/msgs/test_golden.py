"""The golden messages: decoding, encoding and errors."""

from __future__ import annotations

import json
from math import cos, radians, sin
from typing import Any

import pytest

from mindstage.errors import MessageValidationError
from mindstage.msgs import (
    RosVersion,
    action_types,
    decode,
    encode,
    geometry_msgs,
    service_types,
    std_msgs,
    world_control_msgs,
)
from tests.msgs.golden import case_name, cases, part_type


def as_json(value: object) -> Any:
    return json.loads(json.dumps(value))


def test_a_golden_message_survives_a_round_trip(subtests: pytest.Subtests) -> None:
    for case in cases():
        with subtests.test(case_name(case)):
            message = decode(part_type(case), case["json"], strict=True)
            assert as_json(encode(message)) == case["json"]


def test_every_format_is_decoded_to_the_same_message(subtests: pytest.Subtests) -> None:
    for case in cases():
        with subtests.test(case_name(case)):
            cls = part_type(case)
            message = decode(cls, case["json"])
            for other in [case.get("ros1", case["json"]), *case.get("also_read", [])]:
                assert decode(cls, other, strict=True) == message
            ros1 = case.get("ros1_less") or case.get("ros1", case["json"])
            assert as_json(encode(message, ros=RosVersion.ONE)) == ros1
            decode(cls, ros1, strict=True)


def test_invalid_messages_are_rejected_with_the_path(subtests: pytest.Subtests) -> None:
    for case in cases(refused=True):
        with subtests.test(case_name(case)):
            with pytest.raises(MessageValidationError) as refused:
                decode(part_type(case), case["json"], strict=case["mode"] == "strict")
            assert refused.value.path == case["path"]
            assert refused.value.cause.startswith(case["cause"])
            assert f"{case['path']}: {case['cause']}".removeprefix(": ") in str(refused.value)


def test_missing_fields_are_rejected_in_strict_mode_only(subtests: pytest.Subtests) -> None:
    for case in cases(refused=True):
        with subtests.test(case_name(case)):
            if case["mode"] == "strict":
                decode(part_type(case), case["json"])
            else:
                with pytest.raises(MessageValidationError):
                    decode(part_type(case), case["json"], strict=True)


def test_every_request_and_response_has_a_golden_message() -> None:
    shown = {(case["type"], case["part"]) for case in cases()}
    packages = (
        "world_control_msgs",
        "unreal_vis_msgs",
        "modul_spawner_msgs",
        "simulation_interfaces",
        "mindstage_msgs",
    )
    services = [name for name in service_types() if name.startswith(packages)]
    assert len(services) == 17 + 3 + 1 + 22 + 32
    missing = {(name, part) for name in services for part in ("request", "response")} - shown
    assert not missing
    assert {(name, part) for name in action_types() for part in ("goal", "result", "feedback")} <= shown


# -- expected values ---------------------------------------------------------------------------------------------------


def test_the_golden_pose_has_the_expected_values() -> None:
    (case,) = (case for case in cases() if case["name"] == "an asymmetric pose")
    assert decode(geometry_msgs.Pose, case["json"]) == geometry_msgs.Pose(
        position=geometry_msgs.Point(x=1.0, y=2.0, z=3.0),
        orientation=geometry_msgs.Quaternion(x=0.0, y=0.0, z=sin(radians(15.0)), w=cos(radians(15.0))),
    )


def test_the_golden_mug_has_the_expected_values() -> None:
    (case,) = (case for case in cases() if case["name"] == "a mug")
    request = decode(world_control_msgs.SpawnModel.Request, case["json"], strict=True)
    assert request.id == "mug"
    assert request.tags == (
        world_control_msgs.Tag(type="SemLog", key="Class", value="Cup"),
        world_control_msgs.Tag(type="SemLog", key="Id", value="mug"),
    )
    assert request.physics_properties == world_control_msgs.PhysicsProperties(
        mobility=world_control_msgs.MobilityCode.DYNAMIC, gravity=True, generate_overlap_events=False, mass=0.3
    )
    assert (request.material_names, request.material_paths) == (("Blue",), ("/Game/Materials",))
    assert request.spawn_collision_check
    assert not request.parent_id


def test_missing_fields_have_the_defaults_of_ros() -> None:
    request = decode(world_control_msgs.SpawnModel.Request, {"id": "mug"})
    assert request == world_control_msgs.SpawnModel.Request(id="mug")
    assert request.pose.orientation == geometry_msgs.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    assert decode(std_msgs.Header, {}) == std_msgs.Header()


def test_every_field_is_encoded() -> None:
    assert set(encode(world_control_msgs.SpawnModel.Request())) == set(
        world_control_msgs.SpawnModel.Request.__struct_fields__
    )
    assert encode(std_msgs.Header(seq=7)) == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert encode(std_msgs.Header(seq=7), ros=RosVersion.ONE) == {
        "seq": 7,
        "stamp": {"secs": 0, "nsecs": 0},
        "frame_id": "",
    }
