"""The types of other packages have the checksums by which ROS 1 compares types: the same fields in the same order."""

from __future__ import annotations

import hashlib
from typing import Any

import pytest

from mindstage.msgs import RosVersion, message_type, service_type
from mindstage.msgs.schema.base import constants_of, fields_of, struct_of, type_name
from tests.cases import each_case

# As `rosmsg md5` and `rossrv md5` print them in ROS Noetic.
CHECKSUMS = {
    "std_msgs/Header": "2176decaecbce78abc3b96ef049fabed",
    "geometry_msgs/PoseStamped": "d3812c3cbc69362b77dc0b19b345f8f5",
    "geometry_msgs/TwistWithCovariance": "1fe8a28e6890a4cc3ae4c3ca5c7d82e6",
    "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    "trajectory_msgs/JointTrajectoryPoint": "f3cd1e1c4d320c79d6985c904ae5dcd3",
    "trajectory_msgs/JointTrajectory": "65b4f94a94d1ed67169da35a02f33d3f",
    "trajectory_msgs/MultiDOFJointTrajectoryPoint": "3ebe08d1abd5b65862d50e09430db776",
    "trajectory_msgs/MultiDOFJointTrajectory": "ef145a45a5f47b77b7f5cdde4b16c942",
    "control_msgs/JointTolerance": "f544fe9c16cf04547e135dd6063ff5be",
    "control_msgs/GripperCommand": "680acaff79486f017132a7f198d40f08",
    "control_msgs/JointTrajectoryControllerState": "10817c60c2486ef6b33e97dcd87f4474",
    "controller_manager_msgs/ControllerState": "aeb6b261d97793ab74099a3740245272",
    "controller_manager_msgs/HardwareInterfaceResources": "f25b55cbf1d1f76e82e5ec9e83f76258",
}
ACTIONS = {
    "control_msgs/FollowJointTrajectory": "bc4f9b743838566551c0390c65f1a248",
    "control_msgs/GripperCommand": "950b2a6ebe831f5d4f4ceaba3d8be01e",
    "control_msgs/PointHead": "7252920f1243de1b741f14f214125371",
    "move_base_msgs/MoveBase": "70b6aca7c7f7746d8d1609ad94c80bb8",
}
SERVICES = {"controller_manager_msgs/ListControllers": "1341feb2e63fa791f855565d0da950d8"}
TIMES = {"builtin_interfaces/Time": "time", "builtin_interfaces/Duration": "duration"}


def _text(cls: Any) -> str:
    """The text of which ROS 1 computes the checksum: constants, then fields, with the checksum of each message."""
    struct = struct_of(cls)
    lines = [f"{_primitive(cls, name)} {name}={value}" for name, value in constants_of(cls)]
    for field in fields_of(cls):
        if struct.only_in.get(field.name, RosVersion.ONE) is not RosVersion.ONE:
            continue
        name = struct.ros1_names.get(field.name, field.name)
        time = TIMES.get(type_name(field.message)) if field.message else ""
        array = "" if field.length is None else f"[{field.length or ''}]"
        lines.append(f"{_checksum(field.message)} {name}" if field.message and not time else
                     f"{field.primitive or time}{array} {name}")  # fmt: skip
    return "\n".join(lines)


def _primitive(cls: Any, name: str) -> str:
    for field in fields_of(cls):
        if field.enum and name in field.enum.__members__:
            return field.primitive
    return "uint8"


def _checksum(cls: Any) -> str:
    return hashlib.md5(_text(cls).encode()).hexdigest()


@each_case("name", CHECKSUMS)
def test_a_message_has_the_checksum_of_its_package(name: str) -> None:
    assert _checksum(message_type(name)) == CHECKSUMS[name]


@pytest.mark.parametrize("name", ACTIONS)
def test_an_action_has_the_checksum_of_its_package(name: str) -> None:
    package, _, action = name.partition("/")
    parts = [_checksum(message_type(f"{package}/{action}Action{part}")) for part in ("Goal", "Result", "Feedback")]
    text = "\n".join(f"{sum} action_{part}" for sum, part in zip(parts, ("goal", "result", "feedback"), strict=True))
    assert hashlib.md5(text.encode()).hexdigest() == ACTIONS[name]


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_has_the_checksum_of_its_package(name: str) -> None:
    request, response = service_type(name)
    assert hashlib.md5((_text(request) + _text(response)).encode()).hexdigest() == SERVICES[name]
