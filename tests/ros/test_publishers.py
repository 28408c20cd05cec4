"""Published topics: clock, transforms, joint states, markers, highlights and health, at their rates."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest

from mindstage.bridge import LocalNode, RosbridgeClient
from mindstage.engines import MujocoEngine, NullEngine
from mindstage.errors import EngineError
from mindstage.knowledge import KnowledgeBase
from mindstage.msgs import RosVersion, decode, encode, message_type
from mindstage.ros import PublishRates, RosInterface
from mindstage.ros.publishers import tf_message, world_marker_array
from mindstage.scene import BodyId
from mindstage.simulation import Simulation
from tests.bridge.raw_client import eventually
from tests.kitchenette import kitchenette
from tests.ros.ros_messages import position_of

TYPES = {
    "/clock": "rosgraph_msgs/Clock",
    "/tf": "tf2_msgs/TFMessage",
    "/unreal/joint_states": "sensor_msgs/JointState",
    "/unreal/world": "visualization_msgs/MarkerArray",
    "/unreal/highlights": "mindstage_msgs/LitGroups",
    "/mindstage/health": "diagnostic_msgs/DiagnosticArray",
}


def subscribed_messages(client: RosbridgeClient | LocalNode, topic: str) -> list[Any]:
    received: list[Any] = []
    client.subscribe(topic, received.append)
    return received


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


def test_every_body_has_a_transform_from_the_world(client: RosbridgeClient, simulation: Simulation) -> None:
    received = subscribed_messages(client, "/tf")
    eventually(lambda: received)
    there = {each["child_frame_id"]: each for each in received[-1]["transforms"]}
    assert set(there) == set(simulation.state.ids)
    assert {each["header"]["frame_id"] for each in there.values()} == {"world"}
    mug = there["Mug"]["transform"]
    assert position_of({"position": mug["translation"]}) == (2.0, 0.0, 0.85)
    assert mug["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def test_joint_states_have_the_names_of_the_joints(client: RosbridgeClient, simulation: Simulation) -> None:
    received = subscribed_messages(client, "/unreal/joint_states")
    eventually(lambda: received)
    assert received[-1]["name"] == ["DrawerSlide", "FridgeHinge"]
    simulation.run_on_engine(lambda engine: engine.apply_force(BodyId("Drawer"), (-40.0, 0.0, 0.0)))
    simulation.run_on_engine(lambda engine: engine.step(0.2))
    eventually(lambda: received[-1]["position"][0] < -0.05)


def test_markers_have_the_size_and_the_highlight_of_the_bodies(client: RosbridgeClient, simulation: Simulation) -> None:
    received = subscribed_messages(client, "/unreal/world")
    simulation.highlight([BodyId("Mug")], (0.0, 1.0, 0.0))
    simulation.run_on_engine(lambda engine: engine.delete([BodyId("Floor")]), edits=True)
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


def test_messages_without_subscribers_are_not_created(simulation: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    for name in ("tf_message", "joint_state_message", "world_marker_array"):
        monkeypatch.setattr(f"mindstage.ros.publishers.{name}", lambda *_, name=name, **__: made.append(name) or {})
    with LocalNode() as local_node, RosInterface(simulation, local_node):
        simulation.play()
        received = subscribed_messages(local_node, "/clock")
        eventually(lambda: len(received) >= 10)
        assert not made
        local_node.subscribe("/tf", lambda _: None)
        eventually(lambda: made)
        assert set(made) == {"tf_message"}


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
        engine.close()
        eventually(lambda: received[-1]["status"][0]["level"] == 2)
        assert "is closed" in received[-1]["status"][0]["message"]
        assert simulation.engine_error is not None


@pytest.mark.parametrize("ros", list(RosVersion))
def test_directly_encoded_messages_equal_those_of_the_types(knowledge: KnowledgeBase, ros: RosVersion) -> None:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        for type, written in (
            ("tf2_msgs/TFMessage", tf_message(simulation.state, ros=ros)),
            (
                "visualization_msgs/MarkerArray",
                world_marker_array(simulation.state, simulation.snapshot().bodies, ros=ros),
            ),
        ):
            sent = json.loads(json.dumps(written))
            again = encode(decode(message_type(type), sent, strict=True), ros=ros)
            assert json.loads(json.dumps(again)) == sent


def test_poses_that_are_not_finite_are_not_published(simulation: Simulation) -> None:
    broken = msgspec.structs.replace(simulation.state, poses=simulation.state.poses * float("nan"))
    with pytest.raises(EngineError, match="not finite"):
        tf_message(broken, ros=RosVersion.TWO)
