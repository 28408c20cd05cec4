"""Published topics: clock, transforms, joint states, markers, highlights and health, at their rates."""

from __future__ import annotations

import json
import threading
from typing import Any

import msgspec
import numpy as np
import pytest

from mindstage.bridge import LocalNode, RosbridgeClient
from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import EngineError
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import RosVersion, decode, encode, message_type
from mindstage.ros import PublishRates, RosInterface
from mindstage.ros.publishers import tf_message, tf_static_message, world_marker_array
from mindstage.ros.state import StateReader
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import Attach, Delete, SetPoses
from mindstage.scene.transforms import pose_multiply
from mindstage.simulation import Simulation
from tests.bridge.raw_client import eventually
from tests.kitchenette import kitchenette

TYPES = {
    "/clock": "rosgraph_msgs/Clock",
    "/tf": "tf2_msgs/TFMessage",
    "/tf_static": "tf2_msgs/TFMessage",
    "/unreal/joint_states": "sensor_msgs/JointState",
    "/unreal/world": "visualization_msgs/MarkerArray",
    "/unreal/highlights": "mindstage_msgs/HighlightGroups",
    "/mindstage/health": "diagnostic_msgs/DiagnosticArray",
}


def subscribed_messages(client: RosbridgeClient | LocalNode, topic: str) -> list[Any]:
    received: list[Any] = []
    client.subscribe(topic, received.append)
    return received


def status_values(message: Any) -> dict[str, str]:
    return {each["key"]: each["value"] for each in message["status"][0]["values"]}


def test_every_topic_has_messages_of_its_type(client: RosbridgeClient, simulation: Simulation) -> None:
    received = {topic: subscribed_messages(client, topic) for topic in TYPES}
    simulation.play()
    simulation.highlight([BodyId("Mug")], (1.0, 0.0, 0.0))
    for topic, type in TYPES.items():
        eventually(lambda topic=topic: received[topic])
        assert decode(message_type(type), received[topic][-1], strict=True), topic


def test_the_clock_advances_while_playing(client: RosbridgeClient, simulation: Simulation) -> None:
    received = subscribed_messages(client, "/clock")
    simulation.play()
    eventually(lambda: len(received) >= 5)
    times = [each["clock"]["sec"] + each["clock"]["nanosec"] / 1e9 for each in received]
    assert times == sorted(times)
    assert times[-1] > times[0]


def composed_positions(*messages: Any) -> dict[str, Any]:
    """Composes the transforms of messages from the root `map`, as tf2 does; returns the poses by frame id."""
    edges = {each["child_frame_id"]: each for message in messages for each in message["transforms"]}
    poses: dict[str, Any] = {"map": np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])}

    def pose_of(frame: str) -> Any:
        if frame not in poses:
            edge = edges[frame]
            shift, turn = edge["transform"]["translation"], edge["transform"]["rotation"]
            local = np.array([shift["x"], shift["y"], shift["z"], turn["w"], turn["x"], turn["y"], turn["z"]])
            poses[frame] = pose_multiply(pose_of(edge["header"]["frame_id"]), local)
        return poses[frame]

    return {frame: pose_of(frame) for frame in edges}


def test_only_moving_transforms_are_in_tf_and_the_others_are_static(
    client: RosbridgeClient, simulation: Simulation
) -> None:
    moving, static = subscribed_messages(client, "/tf"), subscribed_messages(client, "/tf_static")
    eventually(lambda: moving and static)
    edges = {each["child_frame_id"]: each["header"]["frame_id"] for each in moving[-1]["transforms"]}
    assert edges == {"DrawerSlide": "Cupboard", "FridgeHinge": "Fridge", "Mug": "map"}
    edges = {each["child_frame_id"]: each["header"]["frame_id"] for each in static[-1]["transforms"]}
    assert edges == {
        "world": "map", "Floor": "map", "Cupboard": "map", "Fridge": "map",
        "Drawer": "DrawerSlide", "DrawerHandle": "Drawer", "FridgeDoor": "FridgeHinge", "FridgeHandle": "FridgeDoor",
    }  # fmt: skip


def test_composed_transforms_are_the_poses_of_the_bodies(client: RosbridgeClient, simulation: Simulation) -> None:
    moving, static = subscribed_messages(client, "/tf"), subscribed_messages(client, "/tf_static")
    eventually(lambda: moving and static)
    count = len(static)
    simulation.engine.run(lambda engine: engine.apply_force(BodyId("Drawer"), (-40.0, 0.0, 0.0)))
    simulation.engine.run(lambda engine: engine.apply_force(BodyId("FridgeDoor"), (-60.0, 0.0, 0.0)))
    simulation.step(0.3)

    def positions() -> dict[str, Any]:
        there = composed_positions(static[-1], moving[-1])
        return {id: there[id] for id in simulation.state.ids}

    expected = dict(zip(simulation.state.ids, simulation.state.poses, strict=True))
    assert expected["Drawer"][0] < 1.9
    assert abs(expected["FridgeHandle"][4:]).max() > 0.05
    eventually(lambda: all(np.allclose(positions()[id], pose, atol=1e-5) for id, pose in expected.items()))
    assert len(static) == count, "static transforms are published when they change only"


def test_static_transforms_are_latched_and_published_again_when_they_change(
    client: RosbridgeClient, local_node: LocalNode, simulation: Simulation
) -> None:
    static = subscribed_messages(client, "/tf_static")
    eventually(lambda: static)
    late = subscribed_messages(local_node, "/tf_static")
    eventually(lambda: late)
    assert late[0] == static[-1]
    simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("FridgeHandle"): Pose((1.6, 0.75, 1.2))})))
    eventually(lambda: len(static) >= 2)
    assert composed_positions(static[-1], {"transforms": [
        {"header": {"frame_id": "map"}, "child_frame_id": "FridgeHinge", "transform": {
            "translation": {"x": 1.68, "y": 1.3, "z": 0.9}, "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}},
        {"header": {"frame_id": "map"}, "child_frame_id": "DrawerSlide", "transform": {
            "translation": {"x": 1.95, "y": 0.0, "z": 0.65}, "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}},
    ]})["FridgeHandle"][:3].tolist() == pytest.approx([1.6, 0.75, 1.2])  # fmt: skip
    # An attachment changes the tree: the mug moves with the drawer, which is static to it.
    simulation.engine.run(lambda engine: engine.apply(Attach(BodyId("Drawer"), BodyId("Mug"))), edits=True)
    eventually(lambda: ("Drawer", "Mug") in {
        (each["header"]["frame_id"], each["child_frame_id"]) for each in static[-1]["transforms"]
    })  # fmt: skip


def test_joint_states_have_the_names_of_the_joints(client: RosbridgeClient, simulation: Simulation) -> None:
    received = subscribed_messages(client, "/unreal/joint_states")
    eventually(lambda: received)
    assert received[-1]["name"] == ["DrawerSlide", "FridgeHinge"]
    simulation.engine.run(lambda engine: engine.apply_force(BodyId("Drawer"), (-40.0, 0.0, 0.0)))
    simulation.engine.run(lambda engine: engine.step(0.2))
    eventually(lambda: received[-1]["position"][0] < -0.05)


def test_markers_have_the_size_and_the_highlight_of_the_bodies(client: RosbridgeClient, simulation: Simulation) -> None:
    received = subscribed_messages(client, "/unreal/world")
    simulation.highlight([BodyId("Mug")], (0.0, 1.0, 0.0))
    simulation.engine.run(lambda engine: engine.apply(Delete((BodyId("Floor"),))), edits=True)
    eventually(lambda: received and len(received[-1]["markers"]) == 8)
    first, *markers = received[-1]["markers"]
    assert first["action"] == 3
    mug = next(marker for marker in markers if marker["text"] == "Mug")
    assert mug["scale"] == {"x": 0.08, "y": 0.08, "z": 0.1}
    assert mug["color"] == {"r": 0.0, "g": 1.0, "b": 0.0, "a": 1.0}


def test_highlights_are_published_at_once_and_latched(
    client: RosbridgeClient, local_node: LocalNode, simulation: Simulation
) -> None:
    received = subscribed_messages(client, "/unreal/highlights")
    simulation.highlight(["Mug"], (1.0, 0.0, 0.0), label="because")
    eventually(lambda: received and received[-1]["groups"])
    expected = [{"ids": ["Mug"], "color": {"r": 1.0, "g": 0.0, "b": 0.0, "a": 1.0}, "label": "because"}]
    assert received[-1]["groups"] == expected
    late = subscribed_messages(local_node, "/unreal/highlights")
    eventually(lambda: late)
    assert late[-1]["groups"] == expected


def test_a_message_highlights_bodies_and_the_diagnostics_name_those_that_do_not_exist(
    client: RosbridgeClient, local_node: LocalNode, simulation: Simulation
) -> None:
    diagnostics = subscribed_messages(local_node, "/mindstage/diagnostics")
    client.advertise("/unreal/highlight", "mindstage_msgs/HighlightGroup")
    color = {"r": 0.0, "g": 0.0, "b": 1.0, "a": 1.0}
    client.publish(
        "/unreal/highlight",
        "mindstage_msgs/HighlightGroup",
        {"ids": ["Mug", "Cupp"], "color": color, "label": "because"},
    )
    eventually(lambda: "Cupp" in str(diagnostics))
    (status,) = (each for array in diagnostics for each in array["status"] if "Cupp" in str(each))
    assert (status["name"], status["hardware_id"]) == ("mindstage: highlight", "Cupp")
    assert dict(simulation.state.highlights) == {"Mug": (0.0, 0.0, 1.0)}
    client.publish("/unreal/highlight", "mindstage_msgs/HighlightGroup", {"ids": ["Mug"]})
    eventually(lambda: not simulation.state.highlights)


def test_messages_without_subscribers_are_not_created(simulation: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    for name in ("tf_message", "tf_static_message", "joint_state_message", "world_marker_array"):
        monkeypatch.setattr(f"mindstage.ros.publishers.{name}", lambda *_, name=name, **__: made.append(name) or {})
    with LocalNode() as local_node, RosInterface(simulation, local_node):
        simulation.play()
        received = subscribed_messages(local_node, "/clock")
        eventually(lambda: len(received) >= 10)
        assert not made
        subscription = local_node.subscribe("/tf", lambda _: None)
        eventually(lambda: made)
        assert set(made) == {"tf_message"}
        subscription.close()
        local_node.subscribe("/tf_static", lambda _: None)
        eventually(lambda: "tf_static_message" in made)


def test_an_unchanged_world_is_published_less_often(simulation: Simulation) -> None:
    with LocalNode() as local_node, RosInterface(simulation, local_node, rates=PublishRates(tf=100.0, health=4.0)):
        tf, health = subscribed_messages(local_node, "/tf"), subscribed_messages(local_node, "/mindstage/health")
        eventually(lambda: len(health) >= 6)
        assert 1 <= len(tf) <= 10
        simulation.play()
        count = len(tf)
        eventually(lambda: len(tf) - count >= 30)


def test_rates_can_be_set_and_disabled(simulation: Simulation) -> None:
    with LocalNode() as local_node, RosInterface(simulation, local_node, rates=PublishRates(clock=100.0, tf=0.0)):
        clock, tf = subscribed_messages(local_node, "/clock"), subscribed_messages(local_node, "/tf")
        simulation.play()
        eventually(lambda: len(clock) >= 20)
        assert not tf


def test_health_is_published_and_reports_a_failed_engine(knowledge: KnowledgeBase) -> None:
    engine = NullEngine()
    with (
        Simulation(knowledge, engine) as simulation,
        LocalNode() as local_node,
        RosInterface(simulation, local_node, rates=PublishRates(health=20.0)),
    ):
        received = subscribed_messages(local_node, "/mindstage/health")
        eventually(lambda: received and received[-1]["status"][0]["level"] == 0)
        assert received[-1]["status"][0]["name"] == "mindstage: engine null"
        values = status_values(received[-1])
        assert values["bodies"] == "0"
        assert 0.0 <= float(values["answered_in_s"]) < 2.0, "a ping is given up after 2 s"
        count, may_go_on = len(received), threading.Event()
        blocker = threading.Thread(target=simulation.engine.run, args=(lambda _: may_go_on.wait(20.0),))
        blocker.start()
        eventually(lambda: any(each["status"][0]["level"] == 2 for each in received[count:]))
        late = next(each for each in received[count:] if each["status"][0]["level"] == 2)
        assert "2 s" in late["status"][0]["message"]
        assert status_values(late)["answered_in_s"] == "", "there was no answer"
        may_go_on.set()
        blocker.join(20.0)
        eventually(lambda: received[-1]["status"][0]["level"] == 0)
        engine.close()
        eventually(lambda: received[-1]["status"][0]["level"] == 2)
        assert "is closed" in received[-1]["status"][0]["message"]
        assert simulation.engine.error is not None


@pytest.mark.parametrize("ros", list(RosVersion))
def test_directly_encoded_messages_equal_those_of_the_types(knowledge: KnowledgeBase, ros: RosVersion) -> None:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        transforms, _ = StateReader(simulation).frame_tree().transforms(simulation.state.ids, simulation.state.poses)
        for type, written in (
            ("tf2_msgs/TFMessage", tf_message(transforms, time_s=1.5, ros=ros)),
            ("tf2_msgs/TFMessage", tf_static_message(transforms, time_s=1.5, ros=ros)),
            (
                "visualization_msgs/MarkerArray",
                world_marker_array(simulation.state, simulation.snapshot().bodies, ros=ros),
            ),
        ):
            sent = json.loads(json.dumps(written))
            again = encode(decode(message_type(type), sent, strict=True), ros=ros)
            assert json.loads(json.dumps(again)) == sent


def test_poses_that_are_not_finite_are_not_published(simulation: Simulation) -> None:
    state = simulation.state
    broken, _ = StateReader(simulation).frame_tree().transforms(state.ids, state.poses * float("nan"))
    with pytest.raises(EngineError, match="not finite"):
        tf_message(broken, time_s=0.0, ros=RosVersion.TWO)
    markers = msgspec.structs.replace(state, poses=state.poses * float("nan"))
    with pytest.raises(EngineError, match="not finite"):
        world_marker_array(markers, (), ros=RosVersion.TWO)
