"""Topics: time, poses, joints, forms, lights and health, told as often as wanted and only if anyone listens."""

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
from tests.bridge.talking import eventually
from tests.kitchenette import kitchenette
from tests.ros.asking import position_of

TYPES = {
    "/clock": "rosgraph_msgs/Clock",
    "/tf": "tf2_msgs/TFMessage",
    "/unreal/joint_states": "sensor_msgs/JointState",
    "/unreal/world": "visualization_msgs/MarkerArray",
    "/unreal/highlights": "mindstage_msgs/LitGroups",
    "/mindstage/health": "diagnostic_msgs/DiagnosticArray",
}


def listen(client: RosbridgeClient | LocalNode, topic: str) -> list[Any]:
    heard: list[Any] = []
    client.subscribe(topic, heard.append)
    return heard


def test_every_topic_speaks_its_type_to_the_letter(client: RosbridgeClient, stage: Simulation) -> None:
    heard = {topic: listen(client, topic) for topic in TYPES}
    stage.play()
    stage.highlight([BodyId("Mug")], (1.0, 0.0, 0.0))
    for topic, type in TYPES.items():
        eventually(lambda topic=topic: heard[topic])
        assert decode(message_type(type), heard[topic][-1], strict=True), topic


def test_time_goes_on_while_it_plays(client: RosbridgeClient, stage: Simulation) -> None:
    heard = listen(client, "/clock")
    stage.play()
    eventually(lambda: len(heard) >= 5)
    times = [each["clock"]["sec"] + each["clock"]["nanosec"] / 1e9 for each in heard]
    assert times == sorted(times)
    assert times[-1] > times[0]


def test_every_body_has_a_transform_from_the_world(client: RosbridgeClient, stage: Simulation) -> None:
    heard = listen(client, "/tf")
    eventually(lambda: heard)
    there = {each["child_frame_id"]: each for each in heard[-1]["transforms"]}
    assert set(there) == set(stage.state.ids)
    assert {each["header"]["frame_id"] for each in there.values()} == {"world"}
    mug = there["Mug"]["transform"]
    assert position_of({"position": mug["translation"]}) == (2.0, 0.0, 0.85)
    assert mug["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def test_joints_are_told_by_the_names_of_their_constraints(client: RosbridgeClient, stage: Simulation) -> None:
    heard = listen(client, "/unreal/joint_states")
    eventually(lambda: heard)
    assert heard[-1]["name"] == ["DrawerSlide", "FridgeHinge"]
    stage.run_on_engine(lambda engine: engine.apply_force(BodyId("Drawer"), (-40.0, 0.0, 0.0)))
    stage.run_on_engine(lambda engine: engine.step(0.2))
    eventually(lambda: heard[-1]["position"][0] < -0.05)


def test_bodies_are_forms_in_their_size_and_light(client: RosbridgeClient, stage: Simulation) -> None:
    heard = listen(client, "/unreal/world")
    stage.highlight([BodyId("Mug")], (0.0, 1.0, 0.0))
    stage.run_on_engine(lambda engine: engine.delete([BodyId("Floor")]), edits=True)
    eventually(lambda: heard and len(heard[-1]["markers"]) == 8)
    first, *forms = heard[-1]["markers"]
    assert first["action"] == 3
    mug = next(form for form in forms if form["text"] == "Mug")
    assert mug["scale"] == {"x": 0.08, "y": 0.08, "z": 0.1}
    assert mug["color"] == {"r": 0.0, "g": 1.0, "b": 0.0, "a": 1.0}


def test_what_is_lit_is_told_at_once_and_to_who_comes_late(
    client: RosbridgeClient, hub: LocalNode, stage: Simulation
) -> None:
    heard = listen(client, "/unreal/highlights")
    stage.highlight(["Mug"], (1.0, 0.0, 0.0), label="because")
    eventually(lambda: heard and heard[-1]["groups"])
    expected = [{"ids": ["Mug"], "color": {"r": 1.0, "g": 0.0, "b": 0.0, "a": 1.0}, "label": "because"}]
    assert heard[-1]["groups"] == expected
    late = listen(hub, "/unreal/highlights")
    eventually(lambda: late)
    assert late[-1]["groups"] == expected


def test_nothing_is_made_that_nobody_hears(stage: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    for name in ("tf_message", "joint_state_message", "world_marker_array"):
        monkeypatch.setattr(f"mindstage.ros.publishers.{name}", lambda *_, name=name, **__: made.append(name) or {})
    with LocalNode() as hub, RosInterface(stage, hub):
        stage.play()
        heard = listen(hub, "/clock")
        eventually(lambda: len(heard) >= 10)
        assert not made
        hub.subscribe("/tf", lambda _: None)
        eventually(lambda: made)
        assert set(made) == {"tf_message"}


def test_a_world_that_stands_still_is_told_more_rarely(stage: Simulation) -> None:
    with LocalNode() as hub, RosInterface(stage, hub, rates=PublishRates(tf=100.0, health=4.0)):
        tf, health = listen(hub, "/tf"), listen(hub, "/mindstage/health")
        eventually(lambda: len(health) >= 6)
        assert 1 <= len(tf) <= 10
        stage.play()
        count = len(tf)
        eventually(lambda: len(tf) - count >= 30)


def test_rates_can_be_set_and_put_to_nothing(stage: Simulation) -> None:
    with LocalNode() as hub, RosInterface(stage, hub, rates=PublishRates(clock=100.0, tf=0.0)):
        clock, tf = listen(hub, "/clock"), listen(hub, "/tf")
        stage.play()
        eventually(lambda: len(clock) >= 20)
        assert not tf


def test_the_heart_beats_and_tells_when_the_engine_is_lost(knowledge: KnowledgeBase) -> None:
    engine = NullEngine()
    with (
        Simulation(knowledge, engine) as stage,
        LocalNode() as hub,
        RosInterface(stage, hub, rates=PublishRates(health=20.0)),
    ):
        heard = listen(hub, "/mindstage/health")
        eventually(lambda: heard and heard[-1]["status"][0]["level"] == 0)
        assert heard[-1]["status"][0]["name"] == "mindstage: engine null"
        engine.close()
        eventually(lambda: heard[-1]["status"][0]["level"] == 2)
        assert "is closed" in heard[-1]["status"][0]["message"]
        assert stage.engine_error is not None


@pytest.mark.parametrize("ros", list(RosVersion))
def test_what_is_written_for_speed_is_what_the_types_would_write(knowledge: KnowledgeBase, ros: RosVersion) -> None:
    with Simulation(knowledge, MujocoEngine()) as stage:
        stage.spawn(kitchenette())
        for type, written in (
            ("tf2_msgs/TFMessage", tf_message(stage.state, ros=ros)),
            ("visualization_msgs/MarkerArray", world_marker_array(stage.state, stage.snapshot().bodies, ros=ros)),
        ):
            sent = json.loads(json.dumps(written))
            again = encode(decode(message_type(type), sent, strict=True), ros=ros)
            assert json.loads(json.dumps(again)) == sent


def test_places_that_are_no_numbers_are_never_told(stage: Simulation) -> None:
    broken = msgspec.structs.replace(stage.state, poses=stage.state.poses * float("nan"))
    with pytest.raises(EngineError, match="not finite"):
        tf_message(broken, ros=RosVersion.TWO)
