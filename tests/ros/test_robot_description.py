"""`robot_description`: valid URDF, whose kinematics are those of tf and of the joint states."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from mindstage.bridge import LocalNode, RosbridgeClient
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.sources import RosPackagePath
from mindstage.maps.urdf.parse import read_urdf
from mindstage.maps.urdf.to_world import rest_pose
from mindstage.maps.urdf.urdf_model import UrdfJointType, UrdfRobot
from mindstage.ros import RosInterface
from mindstage.ros.publishers import joint_state_message
from mindstage.ros.robot_description import _roll_pitch_yaw, place_description
from mindstage.ros.state import StateReader
from mindstage.scene import AngularLimits, AxisMotion, BodyId, LinearLimits, Pose
from mindstage.scene.joint_kinematics import axis_ranges
from mindstage.scene.transforms import normalize, normalized_pose_array, pose_multiply, quat_multiply
from mindstage.simulation import Simulation
from tests.bridge.raw_client import eventually
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.ros.ros_messages import Call, pose_message
from tests.ros.test_simulation_interfaces import ROBOT

Read = Callable[[str], UrdfRobot]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Reads a URDF with the reader of this project, which reports every irregularity."""

    def read(text: str) -> UrdfRobot:
        path = tmp_path / "place.urdf"
        path.write_text(text, encoding="utf-8")
        robot = read_urdf(path, RosPackagePath())
        assert robot.issues == ()
        assert len({link.name for link in robot.links}) == len(robot.links)
        assert len({joint.name for joint in robot.joints}) == len(robot.joints)
        return robot

    return read


def link_poses(robot: UrdfRobot, positions: dict[str, float]) -> dict[str, Any]:
    """Computes the pose of each link in the root link."""
    joints = {joint.child: joint for joint in robot.joints}
    found: dict[str, Any] = {}

    def pose_of(link: str) -> Any:
        if link not in joints:
            return normalized_pose_array(Pose())
        if link not in found:
            joint, position = joints[link], positions.get(joints[link].name, 0.0)
            axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
            motion = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
            if joint.type is UrdfJointType.PRISMATIC:
                motion[:3] = position * axis
            elif joint.type in {UrdfJointType.REVOLUTE, UrdfJointType.CONTINUOUS}:
                motion[3:] = [cos(position / 2), *(sin(position / 2) * axis)]
            frame = pose_multiply(pose_of(joint.parent), normalized_pose_array(joint.origin))
            found[link] = pose_multiply(frame, motion)
        return found[link]

    return {link.name: pose_of(link.name) for link in robot.links}


def assert_same_pose(found: Any, expected: Any, name: str) -> None:
    expected = expected.copy()
    expected[3:] = normalize(expected[3:])
    assert found[:3] == pytest.approx(expected[:3], abs=1e-5), name
    assert abs(np.dot(found[3:], expected[3:])) == pytest.approx(1.0, abs=1e-9), name


def test_the_place_is_read_back_with_every_body_at_its_pose(empty_simulation: Simulation, read: Read) -> None:
    empty_simulation.spawn()
    text = place_description(StateReader(empty_simulation))
    robot = read(text)
    state, world = empty_simulation.state, empty_simulation.snapshot()
    assert robot.name == "kitchen"
    jointed = {joint.name for joint in robot.joints if joint.type in {UrdfJointType.REVOLUTE, UrdfJointType.PRISMATIC}}
    assert {"map", *state.ids} <= {link.name for link in robot.links}
    assert jointed == {joint.id for joint in world.joints}
    poses = rest_pose(robot)
    assert poses.issues == ()
    for id, pose in zip(state.ids, state.poses, strict=True):
        assert_same_pose(poses.link_poses[id], pose, id)
    assert all(joint.range is not None for joint in robot.joints if joint.name in jointed)
    shapes = {link.name: link for link in robot.links}
    assert len(shapes["fridge"].collisions) == len(empty_simulation.geometry[BodyId("fridge")].collision_shapes)


def test_the_description_is_a_map_for_this_project(simulation: Simulation, read: Read, tmp_path: Path) -> None:
    read(place_description(StateReader(simulation)))
    with KnowledgeBase() as other:
        other.load(tmp_path / "place.urdf")
        again = other.world()
    world = simulation.snapshot()
    assert set(simulation.state.ids) <= {body.id for body in again.bodies}
    floor = world.body("Floor")
    assert (again.body("Floor").pose.position, again.body("Floor").size) == (floor.pose.position, floor.size)
    limited = [AxisMotion.LIMITED in {axis.motion for axis in axis_ranges(joint)} for joint in again.joints]
    assert sum(limited) == len(world.joints)


@pytest.mark.parametrize("is_swapped", [False, True])
@pytest.mark.parametrize(
    "angular",
    [
        AngularLimits(swing1=AxisMotion.LIMITED, swing1_limit=0.5, swing1_middle=-0.4),
        AngularLimits(swing1=AxisMotion.FREE),
    ],
)
def test_the_positions_of_joint_states_give_the_poses_of_tf(
    empty_simulation: Simulation, read: Read, is_swapped: bool, angular: AngularLimits
) -> None:
    world = kitchenette()
    slide, hinge = world.joints
    slide = replace(slide, linear=replace(slide.linear, x_middle=-0.3))
    hinge = replace(hinge, angular=angular)
    if is_swapped:  # maps use parent and child either way
        slide, hinge = (replace(joint, parent=joint.child, child=joint.parent) for joint in (slide, hinge))
    assert empty_simulation.spawn(replace(world, joints=(slide, hinge))).ok
    for id, force in (("Drawer", (-40.0, 0.0, 0.0)), ("FridgeDoor", (-60.0, 0.0, 0.0))):
        empty_simulation.engine.run(lambda engine, name=id, force=force: engine.apply_force(BodyId(name), force))
    empty_simulation.step(0.3)
    robot = read(place_description(StateReader(empty_simulation)))
    state = empty_simulation.state
    positions = empty_simulation.engine.run(lambda engine: dict(engine.joint_positions()))
    message = joint_state_message(state, (slide, hinge), positions)
    assert min(abs(position) for position in message.position) > 0.05
    found = link_poses(robot, dict(zip(message.name, message.position, strict=True)))
    for id, pose in zip(state.ids, state.poses, strict=True):
        assert_same_pose(found[id], pose, id)
    limits = {joint.name: (joint.type, joint.range) for joint in robot.joints}
    assert limits["DrawerSlide"][1] == pytest.approx((-0.75, 0.15))
    if angular.swing1 is AxisMotion.FREE:
        assert limits["FridgeHinge"] == (UrdfJointType.CONTINUOUS, None)
    else:
        assert limits["FridgeHinge"][0] is UrdfJointType.REVOLUTE
        assert limits["FridgeHinge"][1] == pytest.approx((-0.9, 0.1))


def test_other_joints_and_strange_names_are_valid_too(empty_simulation: Simulation, read: Read) -> None:
    world = kitchenette()
    slide, hinge = world.joints
    slide = replace(slide, linear=LinearLimits(x=AxisMotion.FREE))
    hinge = replace(hinge, angular=AngularLimits(swing1=AxisMotion.FREE, twist=AxisMotion.FREE))
    mug = replace(world.bodies[-1], id=BodyId('a "mug" <&>'))
    assert empty_simulation.spawn(replace(world, joints=(slide, hinge), bodies=(*world.bodies[:-1], mug))).ok
    robot = read(place_description(StateReader(empty_simulation)))
    types = {joint.name: joint.type for joint in robot.joints}
    assert types["DrawerSlide"] is UrdfJointType.PRISMATIC
    assert types["FridgeHinge"] is UrdfJointType.FLOATING
    assert types["a__mug______floating"] is UrdfJointType.FLOATING
    drawer = next(link for link in robot.links if link.name == "Drawer")
    assert drawer.mass_kg == pytest.approx(4.0)


@given(st.tuples(*(st.floats(-1.0, 1.0),) * 4).filter(lambda parts: sum(part * part for part in parts) > 1e-2))
def test_roll_pitch_and_yaw_are_those_of_the_quaternion(parts: tuple[float, float, float, float]) -> None:
    w, x, y, z = normalize(np.array(parts)).tolist()
    check_angles((w, x, y, z))


@each_case("sign", [1.0, -1.0])
@each_case("yaw", [0.0, 0.7, -2.0])
def test_a_vertical_link_has_valid_angles(sign: float, yaw: float) -> None:
    w, x, y, z = quat_multiply([cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)], [0.5**0.5, 0.0, sign * 0.5**0.5, 0.0]).tolist()
    check_angles((w, x, y, z))


def check_angles(quaternion: tuple[float, float, float, float]) -> None:
    roll, pitch, yaw = _roll_pitch_yaw(quaternion)
    turns = ([cos(yaw / 2), 0, 0, sin(yaw / 2)], [cos(pitch / 2), 0, sin(pitch / 2), 0],
             [cos(roll / 2), sin(roll / 2), 0, 0])  # fmt: skip
    found = quat_multiply(quat_multiply(turns[0], turns[1]), turns[2])
    assert abs(np.dot(found, quaternion)) == pytest.approx(1.0, abs=1e-7)


def test_the_description_is_a_latched_topic_and_a_parameter(
    call: Call, local_node: LocalNode, client: RosbridgeClient, simulation: Simulation, read: Read
) -> None:
    received: list[Any] = []
    local_node.subscribe("/unreal/robot_description", received.append)
    eventually(lambda: received)
    assert {"map", *simulation.state.ids} <= {link.name for link in read(received[0]["data"]).links}
    late: list[Any] = []
    client.subscribe("/unreal/robot_description", late.append)
    eventually(lambda: late == received)
    call("delete_model", id="Mug")
    eventually(lambda: len(received) == 2)
    assert "Mug" not in {link.name for link in read(received[1]["data"]).links}
    for name in ("/robot_description", "/unreal/robot_description"):
        value = json.loads(call("/rosapi/get_param", name=name)["value"])
        assert value == received[1]["data"]
        assert name in call("/rosapi/get_param_names")["names"]


def test_a_spawned_robot_has_its_own_description(
    call: Call, local_node: LocalNode, ros_interface: RosInterface, read: Read
) -> None:
    initial = {"pose": pose_message(0, 9, 1)}
    for name in ("cart", "2nd-cart"):
        assert call(
            "spawn_entity", name=name, entity_namespace="lab", entity_resource={"resource_string": ROBOT},
            initial_pose=initial,
        )["result"]["result"] == 1  # fmt: skip
        initial = {"pose": pose_message(0, 12, 1)}
    received: list[Any] = []
    local_node.subscribe("/lab/cart/robot_description", received.append)
    eventually(lambda: received)
    robot = read(received[0]["data"])
    assert {link.name for link in robot.links} == {"lab/cart", "lab/cart/arm", "lab/cart/shoulder"}
    (joint,) = (joint for joint in robot.joints if joint.type is UrdfJointType.REVOLUTE)
    assert (joint.name, joint.parent, joint.range) == ("lab/cart/shoulder", "lab/cart", (-1.0, 1.0))
    assert rest_pose(robot).link_poses["lab/cart/arm"][:3] == pytest.approx([0.0, 0.0, 0.75])
    other = json.loads(call("/rosapi/get_param", name="/lab/entity_2nd_cart/robot_description")["value"])
    assert {link.name for link in read(other).links} >= {"lab/2nd-cart", "lab/2nd-cart/arm"}
    call("delete_entity", entity="lab/cart")
    eventually(lambda: "/lab/cart/robot_description" not in call("/rosapi/get_param_names")["names"])
    assert "/lab/cart/robot_description" not in {
        topic.name for topic in local_node.graph_info().topics if topic.publishers
    }
