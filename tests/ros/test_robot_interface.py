"""The state of robots over ROS: joint states, frames, descriptions, and several robots that come and go."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import roslibpy.ros1.actionlib as actionlib

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.sources import RosPackagePath
from mindstage.maps.urdf.parse import read_urdf
from mindstage.robots import add_robot, find_robot
from mindstage.robots import edits as robot_module
from mindstage.robots.models.forward_kinematics import link_poses as model_poses
from mindstage.robots.models.reading import load_model
from mindstage.ros import RosInterface, RosVersion
from mindstage.ros.robot_controllers import controllers_of
from mindstage.ros.robot_description import description_of
from mindstage.scene import Pose
from mindstage.scene.edits import Delete
from mindstage.scene.transforms import pose_multiply
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.ros.robot_client import RobotClient, point, seconds
from tests.ros.test_robot_description import assert_same_pose, link_poses


def transforms(client: RobotClient) -> dict[str, tuple[str, Any]]:
    """The parent of each frame and its pose there, of the last messages."""
    found = {}
    client.subscribe("/tf_static")
    eventually(lambda: client.messages["/tf_static"])
    for message in (client.messages["/tf_static"][-1], client.wait_for("/tf", 2)):
        for each in message["transforms"]:
            t, r = each["transform"]["translation"], each["transform"]["rotation"]
            pose = np.array([t["x"], t["y"], t["z"], r["w"], r["x"], r["y"], r["z"]])
            found[each["child_frame_id"]] = (each["header"]["frame_id"], pose)
    return found


def pose_in(frames: dict[str, tuple[str, Any]], frame: str, root: str) -> Any:
    """The pose of a frame in one above it."""
    pose = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    while frame != root:
        frame, parent_from_frame = frames[frame]
        pose = pose_multiply(parent_from_frame, pose)
    return pose


@pytest.fixture
def node_and_server() -> Iterator[tuple[LocalNode, RosbridgeServer]]:
    with LocalNode() as node, RosbridgeServer(node, port=0) as server:
        yield node, server


@pytest.fixture
def playing() -> Iterator[Simulation]:
    """A kitchenette that plays, without a robot."""
    with KnowledgeBase() as knowledge, Simulation(knowledge, MujocoEngine()) as simulation:
        assert simulation.spawn(kitchenette()).ok
        simulation.play()
        yield simulation


def test_joint_states_have_the_positions_of_the_description(
    robot_client: RobotClient, robot_simulation: Simulation
) -> None:
    message = robot_client.wait_for("joint_states", 3)
    model = find_robot(robot_simulation).model
    assert sorted(message["name"]) == sorted(joint.name for joint in model.joints if joint.is_movable)
    assert len(message["position"]) == len(message["velocity"]) == len(message["effort"]) == len(message["name"])
    positions = dict(zip(message["name"], message["position"], strict=True))
    home = dict(model.home_positions)
    assert home["elbow_joint"] > 3.0  # not 0: positions are not relative to where the robot was added
    assert {name: positions[name] for name in home} == pytest.approx(home, abs=0.01)
    assert all(abs(value) < 0.01 for value in message["velocity"])
    assert seconds(message["header"]["stamp"]) == pytest.approx(robot_client.now(), abs=0.5)


def test_joint_states_of_the_place_are_without_the_robot(robot_client: RobotClient) -> None:
    message = robot_client.wait_for("/unreal/joint_states", type="sensor_msgs/JointState")
    assert message["name"] == ["DrawerSlide", "FridgeHinge"]


def test_frames_are_those_of_the_description_at_the_joint_states(robot_client: RobotClient, tmp_path: Path) -> None:
    goal = robot_client.follow({"lift_joint": 0.3, "elbow_joint": 2.4, "head_pan_joint": 0.3}, 1.0,
                               controller="joint_trajectory_controller")  # fmt: skip
    assert goal.wait()[0] == "SUCCEEDED"
    path = tmp_path / "robot.urdf"
    path.write_text(robot_client.wait_for("/robot_description")["data"], encoding="utf-8")
    urdf = read_urdf(path, RosPackagePath())
    robot_client.wait_for("/tf", 15)
    frames, positions = transforms(robot_client), robot_client.joints()
    expected = link_poses(urdf, positions)
    assert expected.keys() <= frames.keys()
    for link, pose in expected.items():
        found = pose_in(frames, link, "base_footprint")
        assert np.linalg.norm(found[:3] - pose[:3]) < 1e-3, link
        assert abs(found[3:] @ pose[3:]) == pytest.approx(1.0, abs=1e-5), link
    assert [frames["base_footprint"][0], frames["odom"][0]] == ["odom", "map"]
    assert_same_pose(pose_in(frames, "base_footprint", "map"), np.array([-0.3, 0.5, 0, 1, 0, 0, 0]), "base_footprint")
    assert all(not frame.endswith("_joint") for frame in frames)


def test_the_description_is_the_parameter_too_and_the_place_has_its_own(robot_client: RobotClient) -> None:
    description = robot_client.ros.get_param("/robot_description")
    assert description == robot_client.wait_for("/robot_description")["data"]
    place = robot_client.wait_for("/unreal/robot_description")["data"]
    assert 'link name="Mug"' in place
    assert "base_footprint" not in place
    assert "base_footprint" not in robot_client.ros.get_param("/unreal/robot_description")


def test_a_robot_that_is_added_while_programs_are_connected_is_offered_and_withdrawn(
    playing: Simulation, node_and_server: tuple[LocalNode, RosbridgeServer]
) -> None:
    node, server = node_and_server
    with RosInterface(playing, node):
        client = RobotClient(server.port)
        assert "/arm_controller/follow_joint_trajectory/goal" not in client.ros.get_topics()
        assert "Mug" in client.ros.get_param("/robot_description")
        pose = {"position": {"x": -0.3, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}}
        add = ("/unreal/mindstage/add_robot", "mindstage_msgs/AddRobot")
        added = client.call(*add, source="mobile_manipulator", name="rob", pose=pose)
        assert (added["success"], added["name"]) == (True, "rob")
        status, result = client.follow({"lift_joint": 0.3}, 1.0).wait()
        assert status == "SUCCEEDED", result
        assert "base_footprint" in client.ros.get_param("/robot_description")
        again = client.call(*add, source="mobile_manipulator", name="rob", pose=pose)
        assert not again["success"]
        assert "rob" in again["refusal"]["text"]
        playing.engine.run(
            lambda engine: engine.apply(Delete(tuple(find_robot(playing, "rob").body_ids))),
            edits=True,
        )
        eventually(lambda: "/arm_controller/follow_joint_trajectory/goal" not in client.ros.get_topics())
        assert "Mug" in client.ros.get_param("/robot_description")
        client.close()


def test_a_robot_that_takes_long_to_add_is_offered_when_it_is_complete(
    playing: Simulation, node_and_server: tuple[LocalNode, RosbridgeServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    drives_of = robot_module.drives_of

    def slow(*args: Any, **options: Any) -> Any:
        time.sleep(0.6)  # its bodies are published before it is a robot
        return drives_of(*args, **options)

    monkeypatch.setattr(robot_module, "drives_of", slow)
    node, server = node_and_server
    with RosInterface(playing, node):
        client = RobotClient(server.port)
        client.wait_for("/tf", 3)
        add_robot(playing, "mobile_manipulator", Pose((-0.3, 0.0, 0.0)))
        eventually(lambda: "/arm_controller/follow_joint_trajectory/goal" in client.ros.get_topics())
        eventually(lambda: transforms(client).get("lift_link", ("",))[0] == "base_link")
        client.close()


@pytest.mark.parametrize("source", ["", "../secret.urdf", "/etc/passwd", "no_such_robot"])
def test_a_robot_that_cannot_be_added_is_refused(
    playing: Simulation, node_and_server: tuple[LocalNode, RosbridgeServer], source: str
) -> None:
    node, server = node_and_server
    with RosInterface(playing, node):
        client = RobotClient(server.port)
        try:
            text = str(client.call("/unreal/mindstage/add_robot", "mindstage_msgs/AddRobot", source=source))
        except Exception as error:
            text = str(error)
        assert source in text
        assert "mobile_manipulator" in text
        assert not playing.robots
        client.close()


def test_a_second_robot_has_its_name_as_its_namespace(
    playing: Simulation, node_and_server: tuple[LocalNode, RosbridgeServer]
) -> None:
    node, server = node_and_server
    add_robot(playing, "mobile_manipulator", Pose((-0.3, 0.8, 0.0)), name="one")
    add_robot(playing, "mobile_manipulator", Pose((-0.3, -0.8, 0.0)), name="two")
    with RosInterface(playing, node):
        first, second = RobotClient(server.port), RobotClient(server.port, "/two")
        goal = second.follow({"lift_joint": 0.3}, 1.0)
        assert goal.wait()[0] == "SUCCEEDED"
        assert second.joints()["lift_joint"] == pytest.approx(0.3, abs=0.01)
        assert first.joints()["lift_joint"] == pytest.approx(0.42, abs=0.01)
        assert second.ros.get_param("/two/robot_description") == first.ros.get_param("/robot_description")
        first.wait_for("/tf", 3)
        frames = transforms(first)
        assert frames["two/lift_link"][0] == "two/base_link"
        assert (frames["two/base_footprint"][0], frames["base_footprint"][0]) == ("two/odom", "odom")
        assert pose_in(frames, "two/base_footprint", "map")[:3] == pytest.approx([-0.3, -0.8, 0.0], abs=1e-3)
        odom = second.wait_for("odom")
        assert (odom["header"]["frame_id"], odom["child_frame_id"]) == ("two/odom", "two/base_footprint")
        first.close()
        second.close()


def test_a_client_that_asks_for_robots_gets_robots_only(
    playing: Simulation, node_and_server: tuple[LocalNode, RosbridgeServer]
) -> None:
    node, server = node_and_server
    add_robot(playing, "mobile_manipulator", Pose((-0.3, 0.8, 0.0)), name="one")
    add_robot(playing, "mobile_manipulator", Pose((-0.3, -0.8, 0.0)), name="two")
    with RosInterface(playing, node):
        client = RobotClient(server.port)
        categories = {"object": 0, "robot": 1, "human": 2}  # the numbers of all releases of simulation_interfaces
        found = {
            name: client.call(
                "/unreal/get_entities",
                "simulation_interfaces/GetEntities",
                filters={"categories": [{"category": number}]},
            )["entities"]
            for name, number in categories.items()
        }
        assert found["robot"] == [find_robot(playing, name).link_ids["base_footprint"] for name in ("one", "two")]
        assert {"DrawerHandle", "FridgeHandle"} <= set(found["object"])
        assert found["human"] == []
        info = client.call("/unreal/get_entity_info", "simulation_interfaces/GetEntityInfo", entity=found["robot"][0])
        assert info["info"]["category"]["category"] == categories["robot"]
        client.close()


def test_an_interface_without_a_namespace_keeps_its_own_names(
    playing: Simulation, node_and_server: tuple[LocalNode, RosbridgeServer]
) -> None:
    node, server = node_and_server
    add_robot(playing, "mobile_manipulator", Pose((-0.3, 0.0, 0.0)), name="rob")
    with RosInterface(playing, node, namespace=""):
        client = RobotClient(server.port, "/rob")
        assert client.follow({"lift_joint": 0.3}, 1.0).wait()[0] == "SUCCEEDED"
        place = client.wait_for("/joint_states")
        assert place["name"] == ["DrawerSlide", "FridgeHinge"]
        client.close()


def test_a_client_of_ros_1_uses_the_same_names(
    playing: Simulation, node_and_server: tuple[LocalNode, RosbridgeServer]
) -> None:
    node, server = node_and_server
    add_robot(playing, "mobile_manipulator", Pose((-0.3, 0.0, 0.0)))
    with RosInterface(playing, node, ros=RosVersion.ONE):
        client = RobotClient(server.port)
        action = actionlib.ActionClient(
            client.ros, "/arm_controller/follow_joint_trajectory", "control_msgs/FollowJointTrajectoryAction"
        )
        target = client.joints()["elbow_joint"] - 0.3
        result = _ros1_goal(action, point([target], 0.6), "elbow_joint").result
        assert result == {"error_code": 0, "error_string": ""}
        assert client.joints()["elbow_joint"] == pytest.approx(target, abs=0.02)
        statuses: list[Any] = []
        refused = _ros1_goal(action, point([9.0], 0.6), "elbow_joint", statuses)
        assert refused.result["error_code"] == -1
        eventually(lambda: any(each["status"] == 5 and "elbow_joint = 9 rad" in each["text"] for each in statuses))
        controllers = client.call("/controller_manager/list_controllers", "controller_manager_msgs/ListControllers")
        arm = next(each for each in controllers["controller"] if each["name"] == "arm_controller")
        assert (arm["state"], arm["type"]) == ("running", "position_controllers/JointTrajectoryController")
        assert "elbow_joint" in arm["claimed_resources"][0]["resources"]
        state = client.wait_for("arm_controller/state", type="control_msgs/JointTrajectoryControllerState")
        assert {"header", "joint_names", "desired", "actual", "error"} == state.keys()
        client.close()


def _ros1_goal(client: Any, setpoint: dict[str, Any], joint: str, statuses: list[Any] | None = None) -> Any:
    time_s = setpoint.pop("time_from_start")
    setpoint["time_from_start"] = {"secs": time_s["sec"], "nsecs": time_s["nanosec"]}
    goal = actionlib.Goal(client, {"trajectory": {"joint_names": [joint], "points": [setpoint]}})
    if statuses is not None:
        goal.on("status", statuses.append)
    goal.send()
    goal.wait(TIMEOUT_S)
    return goal


PR2_ARM = ("shoulder_pan", "shoulder_lift", "upper_arm_roll", "elbow_flex", "forearm_roll", "wrist_flex", "wrist_roll")
TIAGO_ARM = tuple(f"arm_{number}_joint" for number in range(1, 8))


@each_case(
    ("robot", "names", "joints"),
    [
        ("pr2", {"l_arm_controller", "r_arm_controller", "torso_controller", "head_traj_controller"},
         {"r_arm_controller": tuple(f"r_{part}_joint" for part in PR2_ARM)}),
        ("tiago", {"arm_controller", "torso_controller", "head_controller"}, {"arm_controller": TIAGO_ARM}),
        ("stretch", {"stretch_controller", "arm_controller", "gripper_controller"}, {}),
        ("panda", {"panda_arm_controller", "position_joint_trajectory_controller"}, {}),
        ("ur5", {"scaled_joint_trajectory_controller", "scaled_pos_joint_traj_controller"}, {}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_a_robot_of_a_known_make_has_the_controllers_of_its_driver(
    robot: str, names: set[str], joints: dict[str, tuple[str, ...]]
) -> None:
    model = load_model(robot)
    specs = {spec.name: spec for spec in controllers_of(model)}
    assert names <= specs.keys()
    assert {name: specs[name].joints for name in joints} == joints
    for spec in specs.values():
        assert all(model.joint(name).is_actuated for name in spec.joints)
    assert set(specs["joint_trajectory_controller"].joints) == {joint.name for joint in model.actuated_joints}


MJCF = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base">
      <geom type="box" size="0.1 0.2 0.3" pos="0.01 0.02 0.03" euler="0.1 0.2 0.3"/>
      <inertial pos="0.1 0.2 0.3" mass="7" fullinertia="0.3 0.4 0.5 0.01 0.02 0.03"/>
      <body name="upper" pos="0.1 0.2 0.3" euler="0.4 0.5 0.6">
        <joint name="turn" axis="0 0.6 0.8" range="-0.5 1.5" actuatorfrcrange="-5 5" damping="0.7" frictionloss="0.3"/>
        <geom type="cylinder" size="0.05 0.2"/><geom type="sphere" size="0.06" pos="0 0 0.4"/>
        <body name="finger" pos="0 0 0.5">
          <joint name="slide" type="slide" axis="1 0 0" range="0.01 0.04"/><geom type="box" size="0.01 0.02 0.03"/>
          <body name="other" pos="0.1 0 0">
            <joint name="follow" type="slide" axis="-1 0 0" range="0 0.05"/><geom type="box" size="0.01 0.02 0.04"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="follow" joint2="slide" polycoef="0.001 0.9 0 0 0"/></equality>
</mujoco>
"""


def test_the_description_of_a_robot_that_is_no_urdf_has_all_of_its_numbers(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(MJCF, encoding="utf-8")
    model = load_model(tmp_path / "arm.xml")
    (tmp_path / "arm.urdf").write_text(description_of(model), encoding="utf-8")
    found = load_model(tmp_path / "arm.urdf")
    for link, other in zip(model.links, found.links, strict=True):
        assert (link.name, link.inertia is None) == (other.name, other.inertia is None)
        assert other.inertia.mass_kg == pytest.approx(link.inertia.mass_kg)
        assert other.inertia.center == pytest.approx(link.inertia.center)
        assert other.inertia.tensor == pytest.approx(link.inertia.tensor, abs=1e-9)
        shapes = zip(link.geometry.collision_shapes, other.geometry.collision_shapes, strict=True)
        for shape, read in shapes:
            assert (read.type, read.size) == (shape.type, pytest.approx(shape.size))
            assert read.pose.position == pytest.approx(shape.pose.position)
            assert read.pose.quaternion == pytest.approx(shape.pose.quaternion)
    for joint, read in zip(model.joints, found.joints, strict=True):
        fields = ("name", "type", "parent", "child", "lower", "upper", "damping", "friction", "mimic")
        assert [getattr(read, name) for name in fields] == [getattr(joint, name) for name in fields]
        assert read.axis == pytest.approx(joint.axis)
        assert read.origin.position == pytest.approx(joint.origin.position)
        assert read.origin.quaternion == pytest.approx(joint.origin.quaternion)
    assert found.joint("turn").effort == 5.0


def test_a_robot_that_is_no_urdf_is_described_as_one(tmp_path: Path) -> None:
    model = load_model("pr2_mjcf")
    assert not model.urdf
    path = tmp_path / "robot.urdf"
    path.write_text(description_of(model), encoding="utf-8")
    urdf = read_urdf(path, RosPackagePath())
    assert urdf.issues == ()
    rng = np.random.default_rng(1)
    positions = {}
    for joint in model.actuated_joints:
        lower, upper = (-1.0 if joint.lower is None else joint.lower), (1.0 if joint.upper is None else joint.upper)
        positions[joint.name] = float(rng.uniform(lower, upper))
    positions |= {
        joint.name: joint.mimic.multiplier * positions[joint.mimic.joint] + joint.mimic.offset
        for joint in model.joints
        if joint.mimic is not None
    }
    found, expected = link_poses(urdf, positions), model_poses(model.joints, positions, model.root)
    assert found.keys() == expected.keys()
    for link, pose in expected.items():
        assert_same_pose(found[link], pose, link)
