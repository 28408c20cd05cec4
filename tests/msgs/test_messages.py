"""Every message type: lookup by name, round trips of random values, and definitions as in rosapi."""

from __future__ import annotations

import json
from functools import cache
from itertools import chain, product
from math import inf, nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from mindstage.errors import MessageValidationError, TypeNotFoundError
from mindstage.msgs import (
    Message,
    RosVersion,
    action_type,
    action_types,
    builtin_interfaces,
    decode,
    decode_arguments,
    definition_text,
    diagnostic_msgs,
    encode,
    geometry_msgs,
    message_type,
    message_types,
    sensor_msgs,
    service_type,
    service_types,
    simulation_interfaces,
    std_msgs,
    type_definitions,
    type_name,
    visualization_msgs,
    world_control_msgs,
)
from mindstage.msgs.schema.base import FieldInfo, fields_of, struct_of
from tests.cases import each_case

EVERY_TYPE = [*message_types().values(), *chain(*service_types().values()), *chain(*action_types().values())]

# -- random messages ---------------------------------------------------------------------------------------------------

FLOAT32_MAX = 3.4028234663852886e38
VALUES: dict[str, SearchStrategy[Any]] = {
    "bool": st.booleans(),
    "string": st.text(max_size=8),
    "float32": st.floats(-FLOAT32_MAX, FLOAT32_MAX),
    "float64": st.floats(allow_nan=False, allow_infinity=False),
    **{f"int{bits}": st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": st.integers(0, 2**bits - 1) for bits in (8, 16, 32)},
    "uint64": st.integers(0, 2**63 - 1),
}


@cache
def any_of(cls: Any) -> SearchStrategy[Message]:
    return st.builds(struct_of(cls), **{field.name: any_value(field) for field in fields_of(cls)})


def any_value(field: FieldInfo) -> SearchStrategy[Any]:
    if field.primitive == "uint8" and field.length == 0:
        return st.binary(max_size=8)
    if field.message:
        one = any_of(field.message)
    else:
        one = st.sampled_from(field.enum) if field.enum else VALUES[field.primitive]
    if field.length is None:
        return one
    size = {"min_size": field.length, "max_size": field.length} if field.length else {"max_size": 3}
    return st.lists(one, **size).map(tuple)


def test_any_message_survives_a_round_trip(subtests: pytest.Subtests) -> None:
    for cls in EVERY_TYPE:
        with subtests.test(type_name(cls)):
            check_round_trips(cls)


def check_round_trips(cls: Any) -> None:
    @settings(max_examples=5)
    @given(any_of(cls))
    def check(message: Message) -> None:
        for ros in RosVersion:
            written = json.loads(json.dumps(encode(message, ros=ros), allow_nan=False))
            back = decode(cls, written, strict=True)
            # A field of the other version of ROS is not sent; all others are.
            assert encode(back, ros=ros) == encode(message, ros=ros)
            assert back == message or any(type(part).only_in for part in parts_of(message))

    check()


def parts_of(message: Message) -> list[Message]:
    found = [message]
    for name in message.__struct_fields__:
        value = getattr(message, name)
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, Message):
                found += parts_of(part)
    return found


def test_an_empty_object_is_a_message_of_defaults(subtests: pytest.Subtests) -> None:
    for cls in EVERY_TYPE:
        with subtests.test(type_name(cls)):
            given = {fields_of(cls)[-1].name: {}} if hasattr(cls, "__args__") else {}  # the goal is required
            message = decode(cls, given)
            assert hash(message) == hash(decode(cls, given))


def test_wrong_types_and_unknown_fields_are_rejected_with_the_path(subtests: pytest.Subtests) -> None:
    for cls in EVERY_TYPE:
        with subtests.test(type_name(cls)):
            with pytest.raises(MessageValidationError, match="no such field") as unknown:
                decode(cls, {"no such field": 1})
            assert unknown.value.path == "no such field"
            for field in fields_of(cls):
                with pytest.raises(MessageValidationError) as refused:
                    decode(cls, {field.name: None})
                assert refused.value.path == field.name


# -- names -------------------------------------------------------------------------------------------------------------


def test_a_type_is_found_by_its_ros_1_and_ros_2_name() -> None:
    assert message_type("geometry_msgs/Pose") is message_type("geometry_msgs/msg/Pose") is geometry_msgs.Pose
    spawn = service_type("world_control_msgs/srv/SpawnModel")
    assert spawn == service_type("world_control_msgs/SpawnModel")
    assert spawn.request is world_control_msgs.SpawnModel.Request
    assert spawn.response is world_control_msgs.SpawnModel.Response
    steps = action_type("simulation_interfaces/action/SimulateSteps")
    assert steps == action_type("simulation_interfaces/SimulateSteps")
    assert steps.feedback is simulation_interfaces.SimulateSteps.Feedback


def test_rosapi_is_found_under_both_package_names() -> None:
    assert service_type("rosapi_msgs/srv/Topics") == service_type("rosapi/Topics")


def test_one_name_may_be_a_message_and_a_service() -> None:
    message = message_type("simulation_interfaces/SpawnEntity")
    assert message is not service_type("simulation_interfaces/SpawnEntity").request
    assert message_type("std_msgs/Empty") is not service_type("std_srvs/Empty").request


def test_every_type_is_found_by_its_name() -> None:
    for name, cls in message_types().items():
        assert type_name(cls) == name
        topic = type_name(cls, RosVersion.TWO)
        assert topic.startswith(f"{name.partition('/')[0]}/")
        assert topic.count("/") == 2
    assert type_name(world_control_msgs.SpawnModel) == "world_control_msgs/SpawnModel"
    assert type_name(world_control_msgs.SpawnModel, RosVersion.TWO) == "world_control_msgs/srv/SpawnModel"
    assert type_name(world_control_msgs.SpawnModel.Request) == "world_control_msgs/SpawnModelRequest"
    assert (
        type_name(world_control_msgs.SpawnModel.Request, RosVersion.TWO) == "world_control_msgs/srv/SpawnModel_Request"
    )
    assert (
        type_name(simulation_interfaces.SimulateSteps, RosVersion.TWO) == "simulation_interfaces/action/SimulateSteps"
    )
    assert type_name(geometry_msgs.Pose, RosVersion.TWO) == "geometry_msgs/msg/Pose"


@each_case(
    "name",
    ["geometry_msgs/Poze", "geometry_msgs/srv/Pose", "Pose", "", "geometry_msgs/msg/x/Pose", "/", "std_srvs/Empty"],
)
def test_an_unknown_message_is_an_error_with_similar_names(name: str) -> None:
    with pytest.raises(TypeNotFoundError, match="no message type") as unknown:
        message_type(name)
    assert ("near" in str(unknown.value)) == bool(unknown.value.suggestions)


def test_an_unknown_service_or_action_is_an_error() -> None:
    with pytest.raises(TypeNotFoundError, match="near: 'world_control_msgs/SpawnModel'"):
        service_type("world_control_msgs/SpawnModell")
    with pytest.raises(TypeNotFoundError, match="no action type"):
        action_type("geometry_msgs/Pose")


# -- invalid values ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [nan, inf, -inf])
def test_numbers_that_are_not_finite_are_rejected(number: float) -> None:
    pose = geometry_msgs.Pose(position=geometry_msgs.Point(y=number))
    with pytest.raises(MessageValidationError, match=r"geometry_msgs/Pose: position\.y: expected a finite float64"):
        encode(pose)
    with pytest.raises(MessageValidationError, match=r"position\.y: expected a finite float64"):
        decode(geometry_msgs.Pose, {"position": {"y": number}})


def test_encoding_checks_the_types() -> None:
    with pytest.raises(MessageValidationError, match=r"name\[1\]: expected str, got int"):
        encode(sensor_msgs.JointState(name=("a", 7)))  # type: ignore[arg-type]
    goal = message_type("simulation_interfaces/SimulateStepsActionGoal")
    steps = simulation_interfaces.SimulateSteps.Goal(steps=-1)
    with pytest.raises(MessageValidationError, match=r"SimulateStepsActionGoal: goal\.steps: expected int >= 0"):
        encode(struct_of(goal)(goal=steps))


def test_numpy_numbers_are_encoded_and_other_objects_rejected() -> None:
    written = encode(geometry_msgs.Point(x=np.float64(1.5), y=np.float32(0.25), z=np.int64(2)))
    assert written == {"x": 1.5, "y": 0.25, "z": 2}
    assert [type(number) for number in written.values()] == [float, float, int]
    with pytest.raises(MessageValidationError, match="geometry_msgs/Point: object cannot be written"):
        encode(geometry_msgs.Point(x=object()))  # type: ignore[arg-type]


def test_a_key_that_is_not_a_string_is_rejected() -> None:
    with pytest.raises(MessageValidationError, match="a key is not a string"):
        decode(std_msgs.Bool, {7: True})


def test_byte_strings_are_base64_or_bytes() -> None:
    mesh = visualization_msgs.MeshFile(filename="cup.obj", data=b"v 0 0 0\n")
    assert encode(mesh)["data"] == "diAwIDAgMAo="
    assert decode(visualization_msgs.MeshFile, {"filename": "cup.obj", "data": b"v 0 0 0\n"}) == mesh


# -- arguments of a call -----------------------------------------------------------------------------------------------


def test_arguments_are_an_object_a_list_or_nothing() -> None:
    cls = world_control_msgs.AttachModelToParent.Request
    both = cls(parent_id="door", child_id="handle")
    assert decode_arguments(cls, {"parent_id": "door", "child_id": "handle"}) == both
    assert decode_arguments(cls, ["door", "handle"], strict=True) == both
    assert decode_arguments(cls, ["door"]) == cls(parent_id="door")
    assert decode_arguments(cls, None) == decode_arguments(cls, []) == cls()


def test_errors_in_a_list_of_arguments_have_field_names() -> None:
    cls = world_control_msgs.AttachModelToParent.Request
    with pytest.raises(MessageValidationError, match="child_id: expected str, got int"):
        decode_arguments(cls, ["door", 7])
    with pytest.raises(MessageValidationError, match="child_id: it is missing"):
        decode_arguments(cls, ["door"], strict=True)
    with pytest.raises(MessageValidationError, match="3 arguments, and it has 2 fields"):
        decode_arguments(cls, ["door", "handle", "x"])
    with pytest.raises(MessageValidationError, match="expected object, got str"):
        decode_arguments(cls, "door")


# -- time --------------------------------------------------------------------------------------------------------------


def test_a_time_is_seconds_and_nanoseconds() -> None:
    assert builtin_interfaces.Time.at(12.5) == builtin_interfaces.Time(sec=12, nanosec=500_000_000)
    assert builtin_interfaces.Time.at(-0.25) == builtin_interfaces.Time(sec=-1, nanosec=750_000_000)
    assert builtin_interfaces.Time.at(0.9999999999) == builtin_interfaces.Time(sec=1, nanosec=0)
    assert builtin_interfaces.Time.at(12.5).seconds == 12.5
    assert builtin_interfaces.Duration(sec=2, nanosec=250_000_000).seconds == 2.25


def test_a_ros_1_duration_can_be_negative_in_both_parts() -> None:
    assert decode(builtin_interfaces.Duration, {"secs": -1, "nsecs": -500_000_000}).seconds == -1.5


# -- definitions -------------------------------------------------------------------------------------------------------


def test_a_definition_has_fields_lengths_and_constants() -> None:
    first, *parts = type_definitions(visualization_msgs.Marker)
    definitions = dict(zip(first.fieldnames, zip(first.fieldtypes, first.fieldarraylen, strict=True), strict=True))
    assert first.type == "visualization_msgs/Marker"
    assert definitions["type"] == ("int32", -1)
    assert definitions["points"] == ("geometry_msgs/Point", 0)
    assert definitions["lifetime"] == ("builtin_interfaces/Duration", -1)
    assert dict(zip(first.constnames, first.constvalues, strict=True))["TRIANGLE_LIST"] == "11"
    assert "MODIFY" in first.constnames
    names = [part.type for part in parts]
    assert len(names) == len(set(names))
    assert {"std_msgs/Header", "geometry_msgs/Quaternion", "visualization_msgs/UVCoordinate"} <= set(names)
    assert type_definitions(geometry_msgs.PoseWithCovariance)[0].fieldarraylen == (-1, 36)


def test_ros_1_definitions_have_ros_1_fields() -> None:
    header, time = type_definitions(std_msgs.Header, ros=RosVersion.ONE)
    assert header.fieldnames == ("seq", "stamp", "frame_id")
    assert header.fieldtypes == ("uint32", "time", "string")
    assert (time.type, time.fieldnames) == ("time", ("secs", "nsecs"))
    assert "texture" not in type_definitions(visualization_msgs.Marker, ros=RosVersion.ONE)[0].fieldnames


def test_the_parts_of_a_service_have_definitions() -> None:
    request = type_definitions(world_control_msgs.HighlightModel.Request)[0]
    assert request.type == "world_control_msgs/HighlightModel_Request"
    assert dict(zip(request.constnames, request.constvalues, strict=True))["YELLOW"] == "5"
    assert type_definitions(simulation_interfaces.Result)[0].constnames[1] == "RESULT_OK"


def test_a_definition_as_text_has_the_format_of_msg_files() -> None:
    rule = "=" * 80
    assert definition_text(diagnostic_msgs.DiagnosticStatus) == (
        "uint8 OK=0\nuint8 WARN=1\nuint8 ERROR=2\nuint8 STALE=3\n"
        "uint8 level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n"
        f"{rule}\nMSG: diagnostic_msgs/KeyValue\nstring key\nstring value\n"
    )
    assert definition_text(std_msgs.Header, ros=RosVersion.ONE) == "uint32 seq\ntime stamp\nstring frame_id\n"
    assert "float64[36] covariance\n" in definition_text(geometry_msgs.PoseWithCovariance)


def test_every_type_has_a_definition(subtests: pytest.Subtests) -> None:
    for cls, ros in product(EVERY_TYPE, RosVersion):
        with subtests.test(type_name(cls), ros=ros):
            definitions = type_definitions(cls, ros=ros)
            for definition in definitions:
                assert len(definition.fieldnames) == len(definition.fieldtypes) == len(definition.examples)
                assert decode(type(definition), encode(definition), strict=True) == definition
            inside = {name for definition in definitions for name in definition.fieldtypes}
            assert inside <= {*(definition.type for definition in definitions), *VALUES}
            assert definition_text(cls, ros=ros).count("MSG: ") <= len(definitions) - 1
