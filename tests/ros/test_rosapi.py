"""Rosapi: topics, services, nodes and types as introspection tools read them."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.bridge import LocalNode
from mindstage.errors import ServiceCallError
from mindstage.ros import RosInterface, RosVersion
from mindstage.ros.rosapi import ParameterServer
from mindstage.simulation import Simulation
from tests.ros.ros_messages import Call


def test_topics_services_and_actions_are_listed_with_their_types(call: Call) -> None:
    topics = call("/rosapi/topics")
    types = dict(zip(topics["topics"], topics["types"], strict=True))
    assert types["/tf"] == "tf2_msgs/msg/TFMessage"
    assert types["/unreal/markers"] == "visualization_msgs/msg/MarkerArray"
    assert call("/rosapi/topic_type", topic="tf") == {"type": "tf2_msgs/msg/TFMessage"}
    assert call("/rosapi/topic_type", topic="/nobody") == {"type": ""}
    assert call("/rosapi/topics_for_type", type="tf2_msgs/TFMessage") == {"topics": ["/tf", "/tf_static"]}
    assert "/unreal/spawn_model" in call("/rosapi/services")["services"]
    assert call("/rosapi/service_type", service="/unreal/spawn_model") == {"type": "world_control_msgs/srv/SpawnModel"}
    assert call("/rosapi/services_for_type", type="world_control_msgs/SpawnModel") == {
        "services": ["/unreal/spawn_model"]
    }
    assert "/unreal/simulate_steps" in call("/rosapi/action_servers")["action_servers"]
    action = call("/rosapi/action_type", action="/unreal/simulate_steps")
    assert action == {"type": "simulation_interfaces/action/SimulateSteps"}


def test_publishers_and_subscribers_are_listed(call: Call, local_node: LocalNode) -> None:
    local_node.subscribe("/tf", lambda _: None)
    assert call("/rosapi/nodes") == {"nodes": ["/mindstage"]}
    assert call("/rosapi/publishers", topic="/tf") == {"publishers": ["/mindstage"]}
    assert call("/rosapi/subscribers", topic="/tf") == {"subscribers": ["/mindstage"]}
    assert call("/rosapi/subscribers", topic="/clock") == {"subscribers": []}
    assert call("/rosapi/service_node", service="/unreal/spawn_model") == {"node": "/mindstage"}
    assert call("/rosapi/service_providers", service="world_control_msgs/SpawnModel") == {"providers": ["/mindstage"]}
    details = call("/rosapi/node_details", node="mindstage")
    assert "/tf" in details["subscribing"]
    assert "/clock" in details["publishing"]
    assert "/unreal/spawn_model" in details["services"]


def test_type_definitions_are_complete(call: Call) -> None:
    first, *parts = call("/rosapi/message_details", type="geometry_msgs/Pose")["typedefs"]
    assert (first["type"], first["fieldnames"]) == ("geometry_msgs/Pose", ["position", "orientation"])
    assert {part["type"] for part in parts} == {"geometry_msgs/Point", "geometry_msgs/Quaternion"}
    for kind in ("service_request", "service_response"):
        assert call(f"/rosapi/{kind}_details", type="world_control_msgs/SpawnModel")["typedefs"]
    for kind in ("goal", "result", "feedback"):
        assert call(f"/rosapi/action_{kind}_details", type="simulation_interfaces/SimulateSteps")["typedefs"]
    with pytest.raises(ServiceCallError, match="geometry_msgs/Pos"):
        call("/rosapi/message_details", type="geometry_msgs/Pos")


def test_topics_and_raw_types_are_returned_together(call: Call, local_node: LocalNode) -> None:
    local_node.advertise("/theirs", "their_msgs/Thing")
    response = call("/rosapi/topics_and_raw_types")
    texts = dict(zip(response["topics"], response["typedefs_full_text"], strict=True))
    assert "geometry_msgs/TransformStamped[] transforms" in texts["/tf"]
    assert "MSG: geometry_msgs/Vector3" in texts["/tf"]
    assert texts["/theirs"] == ""


def test_the_other_services_respond(call: Call, ros_interface: RosInterface) -> None:
    assert call("/rosapi/get_time")["time"] == {"sec": 0, "nanosec": 0}
    ros_interface.simulation.step(1.5)
    assert call("/rosapi/get_time")["time"] == {"sec": 1, "nanosec": 500_000_000}
    assert call("/rosapi/get_ros_version")["version"] == 2
    assert "geometry_msgs/Pose" in call("/rosapi/interfaces")["interfaces"]


def test_parameters_are_set_read_and_deleted_as_json(call: Call) -> None:
    def get(name: str, default: str = "") -> tuple[object, bool]:
        reply = call("/rosapi/get_param", name=name, default=default)
        return json.loads(reply["value"]), reply["successful"]

    assert call("/rosapi/has_param", name="x") == {"exists": False}
    assert get("x") == (None, False)
    assert (get("x", "7"), get("x", '{"a": [1]}'), get("x", "text")) == ((7, True), ({"a": [1]}, True), ("text", True))
    assert call("/rosapi/set_param", name="/robot/arm", value='{"length": 1.5, "tags": ["a"]}')["successful"]
    assert call("/rosapi/set_param", name="robot/name", value='"pr2"')["successful"]
    assert get("/robot") == ({"arm": {"length": 1.5, "tags": ["a"]}, "name": "pr2"}, True)
    assert get("/robot/arm/length", "7") == (1.5, True)
    assert get("/robot/name/length") == (None, False)
    names = set(call("/rosapi/get_param_names")["names"])
    assert {"/robot/arm/length", "/robot/arm/tags", "/robot/name", "/use_sim_time"} <= names
    assert call("/rosapi/has_param", name="/robot/arm") == {"exists": True}
    assert call("/rosapi/delete_param", name="/robot/arm")["successful"]
    assert not call("/rosapi/delete_param", name="/robot/arm")["successful"]
    assert get("/robot") == ({"name": "pr2"}, True)
    assert get("/use_sim_time") == (True, True)
    for name, value, reason in (("x", "text", "JSON"), ("", "7", "it is empty"), ("x", "NaN", "JSON")):
        with pytest.raises(ServiceCallError, match=reason):
            call("/rosapi/set_param", name=name, value=value)


def test_parameters_are_searched_upwards_in_ros_1(simulation: Simulation) -> None:
    with LocalNode() as node, RosInterface(simulation, node, ros=RosVersion.ONE) as interface:
        interface.parameters.set("/robot/gripper", 1)
        interface.parameters.set("/gripper", 2)
        for name, expected in (
            ("/robot/arm/gripper", "/robot/gripper"), ("/gripper", "/gripper"), ("/robot/hand", ""),
        ):  # fmt: skip
            assert node.call_service("/rosapi/search_param", {"name": name}) == {"global_name": expected}
        assert node.call_service("/rosapi/set_param", {"name": "x", "value": "1"}) == {}


names = st.lists(st.sampled_from("abc"), min_size=1, max_size=4).map("/".join)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.sampled_from("abc"), inner, min_size=1, max_size=2),
    max_leaves=4,
)


@given(st.lists(st.tuples(names, json_values), max_size=8), names)
def test_a_parameter_has_the_value_that_was_set_last(changes: list[tuple[str, object]], deleted: str) -> None:
    server = ParameterServer()
    for name, value in changes:
        server.set(name, value)
        assert server.get(name) == value
        assert all(server.has(each) for each in server.names())
    existed = server.has(deleted)
    assert server.delete(deleted) is existed
    assert not server.has(deleted)
