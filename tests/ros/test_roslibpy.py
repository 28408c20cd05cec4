"""roslibpy as a client of a simulation: services, topics and actions."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import roslibpy
import roslibpy.ros1.actionlib as actionlib

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.bridge.conversions_unreal import spawn_request
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import encode
from mindstage.ros import RosInterface, RosVersion
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.ros.ros_messages import TURNED, pose_message, position_of

FOR_EVER = 10**9
Reach = Callable[..., Any]


@pytest.fixture
def ros(server: RosbridgeServer) -> Iterator[roslibpy.Ros]:
    connection = roslibpy.Ros("127.0.0.1", server.port, transport="asyncio")
    connection.run(TIMEOUT_S)
    yield connection
    connection.close()


def call(ros: roslibpy.Ros, name: str, type: str, /, **args: Any) -> dict[str, Any]:
    service = roslibpy.Service(ros, name, type)
    return dict(service.call(roslibpy.ServiceRequest(args), timeout=TIMEOUT_S))


def test_roslibpy_uses_every_service(
    ros: roslibpy.Ros, empty_simulation: Simulation, local_node: LocalNode, knowledge: KnowledgeBase
) -> None:
    def world(name: str, /, **args: Any) -> dict[str, Any]:
        return call(ros, f"/unreal/{name}", f"world_control_msgs/{name}", **args)

    with RosInterface(empty_simulation, local_node):
        assert world("spawn_semantic_map", **encode(spawn_request(knowledge.world())))["success"]
        pose = pose_message(1, 2, 3, TURNED)
        assert world("spawn_model", name="Cup", id="cup", pose=pose)["success"]
        assert world("spawn_pro_mesh", id="box", pose=pose_message(5, 5, 5), width=1.0, height=1.0, depth=1.0)[
            "success"
        ]
        details = {"id_first_model": "box", "id_second_model": "cup"}
        joint = {"id": "joint", "constraint_details": details, "pose": pose}
        assert world("spawn_physics_constraint", constraint_description=joint)["success"]
        assert world("attach_model_to_parent", parent_id="fridge", child_id="milk_carton_1")["success"]
        assert world("get_model_pose", id="cup") == {"pose": pose, "success": True}
        assert world("set_model_pose", id="milk_carton_1", pose=pose_message(4, 4, 4))["success"]
        assert position_of(world("get_model_socket_pose", id="fridge", socket="milk_carton_1")["pose"]) == (4, 4, 4)
        assert world("move_object", Name="cup", pose=pose_message(6, 6, 6))["success"]
        assert world("object_to_object_state", source_object_id="cup", other_object_id="fridge")["state"] == "apart"
        assert world("set_physics_properties", id="cup", physics_properties={"mobility": 2, "mass": 0.2})["success"]
        assert world("change_material", id="cup", material_names=["Oak"], material_paths=[""])["success"]
        assert world("highlight_models", id="cup", color=5)["success"]
        assert world("checkpoint", command="save", args="a")["success"]
        assert world("delete_model", id="box")["success"]
        assert world("checkpoint", command="restore", args="a")["success"]
        assert world("delete_all", type_to_delete="None", key_to_delete="", ignore_value=True)["success"]
        assert world("reset_level", id="")["success"]
        made = call(ros, "/unreal/display_basic_marker", "unreal_vis_msgs/DisplayBasicMarker", marker_type=2)
        assert call(ros, "/unreal/remove_marker", "unreal_vis_msgs/RemoveMarker", **made) == {"success": True}
        points = [{"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 0.0, "z": 0.0}]
        assert call(ros, "/unreal/display_trajectory", "unreal_vis_msgs/DisplayTrajectory", points=points)["marker_id"]
        robot = (
            "<robot name='r'><link name='l'><visual><geometry><box size='1 1 1'/></geometry></visual></link></robot>"
        )
        assert call(ros, "/unreal/spawn_robot", "modul_spawner_msgs/SpawnRobot", name=robot, id="r")["success"]
        answers = call(ros, "/mindstage/storage_place", "mindstage_msgs/Ask", args='{"item": "CowsMilk"}')["answers"]
        assert json.loads(answers)["answers"][0]["id"] == "Refrigerator"


def test_roslibpy_lists_the_graph(ros: roslibpy.Ros, ros_interface: RosInterface) -> None:
    assert "/unreal/spawn_model" in ros.get_services()
    assert "/tf" in ros.get_topics()
    assert ros.get_topic_type("/tf") == "tf2_msgs/msg/TFMessage"
    assert ros.get_service_type("/unreal/spawn_model") == "world_control_msgs/srv/SpawnModel"
    assert "/mindstage" in ros.get_nodes()


def test_roslibpy_uses_parameters(ros: roslibpy.Ros, ros_interface: RosInterface) -> None:
    assert ros.get_param("/nothing") is None
    for value in (7, 1.5, "text", True, [1, 2], {"a": {"b": None}}):
        ros.set_param("/robot/value", value)
        assert ros.get_param("/robot/value") == value
    assert "/robot/value/a/b" in ros.get_params()
    parameter = roslibpy.Param(ros, "/robot/value")
    parameter.delete(timeout=TIMEOUT_S)
    assert parameter.get(timeout=TIMEOUT_S) is None
    ros.delete_param("/robot/value")
    received: list[Any] = []
    parameter.get(received.append)
    eventually(lambda: received == [None])


def test_roslibpy_distinguishes_success_rejection_and_failure(ros: roslibpy.Ros, ros_interface: RosInterface) -> None:
    type = "world_control_msgs/GetModelPose"
    assert call(ros, "/unreal/get_model_pose", type, id="Mug")["success"] is True
    assert call(ros, "/unreal/get_model_pose", type, id="nobody")["success"] is False
    with pytest.raises(roslibpy.core.ServiceException, match="id: expected str, got int"):
        call(ros, "/unreal/get_model_pose", type, id=7)
    with pytest.raises(roslibpy.core.ServiceException, match="does not exist"):
        call(ros, "/unreal/nothing", type)


def test_roslibpy_subscribes_and_publishes(
    ros: roslibpy.Ros, ros_interface: RosInterface, simulation: Simulation
) -> None:
    received: list[Any] = []
    static: list[Any] = []
    roslibpy.Topic(ros, "/tf", "tf2_msgs/TFMessage").subscribe(received.append)
    roslibpy.Topic(ros, "/tf_static", "tf2_msgs/TFMessage").subscribe(static.append)
    simulation.play()
    eventually(lambda: len(received) >= 5 and static)
    frames = {each["child_frame_id"] for message in (received[-1], static[-1]) for each in message["transforms"]}
    assert frames == {*simulation.state.ids, "DrawerSlide", "FridgeHinge", "world"}
    highlight = roslibpy.Topic(ros, "/unreal/highlight", "mindstage_msgs/HighlightGroup")
    highlight.publish(roslibpy.Message({"ids": ["Mug"], "color": {"r": 1.0, "g": 0.0, "b": 0.0, "a": 1.0}}))
    eventually(lambda: "Mug" in simulation.state.highlights)


def test_roslibpy_cancels_a_ros_2_goal(ros: roslibpy.Ros, ros_interface: RosInterface) -> None:
    client = roslibpy.ActionClient(ros, "/unreal/simulate_steps", "simulation_interfaces/SimulateSteps")
    results: list[Any] = []
    feedback_values = threading.Event()
    goal = client.send_goal(
        roslibpy.Goal({"steps": FOR_EVER}), results.append, lambda _: feedback_values.set(), results.append
    )
    assert feedback_values.wait(TIMEOUT_S)
    client.cancel_goal(goal)
    client.wait_goal(goal, TIMEOUT_S)
    assert results[0]["status"] is roslibpy.GoalStatus.CANCELED


def test_roslibpy_cancels_a_ros_1_goal(ros: roslibpy.Ros, simulation: Simulation, local_node: LocalNode) -> None:
    with RosInterface(simulation, local_node, ros=RosVersion.ONE):
        client = actionlib.ActionClient(
            ros, "/unreal/simulate_steps", "simulation_interfaces/SimulateStepsAction", timeout=TIMEOUT_S
        )
        reached = actionlib.Goal(client, roslibpy.Message({"steps": 50}))
        reached.send()
        assert reached.wait(TIMEOUT_S)["result"]["result"] == 1
        feedback_values = threading.Event()
        goal = actionlib.Goal(client, roslibpy.Message({"steps": FOR_EVER}))
        goal.on("feedback", lambda _: feedback_values.set())
        goal.send()
        assert feedback_values.wait(TIMEOUT_S)
        goal.cancel()
        assert goal.wait(TIMEOUT_S)["result"]["error_message"] == "it was canceled"
        client.dispose()
