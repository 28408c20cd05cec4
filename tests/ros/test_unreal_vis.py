"""Markers: shown by services and by messages, for as long as they shall be, by whoever wants to be seen thinking."""

from __future__ import annotations

from typing import Any

import pytest

from mindstage.bridge import LocalNode
from mindstage.errors import ServiceCallError
from mindstage.ros import RosInterface
from mindstage.simulation import Marker, MarkerType, Simulation
from tests.bridge.talking import eventually
from tests.ros.asking import TURNED, Call, diagnostic_texts, pose_message

RED = {"r": 1.0, "g": 0.0, "b": 0.0, "a": 1.0}
BLUE = {"r": 0.0, "g": 0.0, "b": 1.0, "a": 0.5}


def shown(stage: Simulation) -> dict[str, Marker]:
    return {marker.id: marker for marker in stage.state.markers}


@pytest.fixture
def send(face: RosInterface, hub: LocalNode) -> Any:
    """Publishes markers, as a control system does that waits for nobody."""

    def send(*markers: dict[str, Any]) -> None:
        hub.publish("/unreal/markers", "visualization_msgs/MarkerArray", {"markers": list(markers)})

    return send


def test_a_basic_marker_is_shown_replaced_and_taken_away(call: Call, stage: Simulation) -> None:
    made = call("display_basic_marker", marker_type=2, pose=pose_message(1, 2, 3, TURNED), color=RED, scale=0.4)
    marker = shown(stage)[made["marker_id"]]
    assert marker.type is MarkerType.SPHERE
    assert marker.pose.position == (1, 2, 3)
    assert marker.size == (0.4, 0.4, 0.4)
    assert marker.color == (1, 0, 0)
    again = call("display_basic_marker", marker_type=1, color=BLUE, scale=0.4, marker_id=made["marker_id"])
    assert again == made
    assert shown(stage)[made["marker_id"]].type is MarkerType.CUBE
    assert call("remove_marker", marker_id=made["marker_id"]) == {"success": True}
    assert call("remove_marker", marker_id=made["marker_id"]) == {"success": False}
    assert not stage.state.markers


def test_every_basic_form_can_be_shown(call: Call, stage: Simulation) -> None:
    made = [call("display_basic_marker", marker_type=number)["marker_id"] for number in range(6)]
    assert len(set(made)) == 6
    forms = [shown(stage)[id].type.value for id in made]
    assert forms == ["sphere", "cube", "sphere", "cylinder", "cone", "arrow"]


def test_a_trajectory_runs_from_one_color_to_the_other_by_its_length(call: Call, stage: Simulation) -> None:
    points = [{"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 3.0, "z": 0.0}]
    made = call("display_trajectory", points=points, color_begin=RED, color_end={**BLUE, "a": 1.0})
    marker = shown(stage)[made["marker_id"]]
    assert marker.type is MarkerType.LINE_STRIP
    assert marker.points == ((0, 0, 0), (1, 0, 0), (1, 3, 0))
    assert marker.colors == ((1, 0, 0), (0.75, 0, 0.25), (0, 0, 1))
    assert call("remove_marker", marker_id=made["marker_id"])["success"]


def test_messages_are_acted_on_although_nobody_listens(send: Any, stage: Simulation) -> None:
    send(
        {
            "ns": "plan",
            "id": 7,
            "type": 1,
            "pose": pose_message(1, 2, 3),
            "scale": {"x": 1.0, "y": 2.0, "z": 3.0},
            "color": RED,
        }
    )
    eventually(lambda: "plan/7" in shown(stage))
    marker = shown(stage)["plan/7"]
    assert (marker.type, marker.size, marker.color) == (MarkerType.CUBE, (1, 2, 3), (1, 0, 0))
    send({"ns": "plan", "id": 7, "action": 2})
    eventually(lambda: not shown(stage))


def test_a_single_marker_has_a_topic_too(hub: LocalNode, face: RosInterface, stage: Simulation) -> None:
    hub.publish("/unreal/marker", "visualization_msgs/Marker", {"ns": "a", "type": 9, "text": "here", "color": RED})
    eventually(lambda: "a/0" in shown(stage))
    assert shown(stage)["a/0"].text == "here"


def test_deleting_all_of_one_namespace_leaves_the_others_and_those_of_services(
    send: Any, call: Call, stage: Simulation
) -> None:
    kept = call("display_basic_marker", marker_type=1)["marker_id"]
    send({"ns": "a", "id": 1, "type": 1}, {"ns": "a", "id": 2, "type": 1}, {"ns": "b", "id": 1, "type": 1})
    eventually(lambda: len(shown(stage)) == 4)
    send({"ns": "a", "action": 3})
    eventually(lambda: set(shown(stage)) == {kept, "b/1"})
    send({"action": 3})
    eventually(lambda: set(shown(stage)) == {kept})


def test_a_marker_goes_when_its_time_is_up_although_the_world_is_paused(send: Any, stage: Simulation) -> None:
    send({"ns": "a", "type": 1, "lifetime": {"sec": 0, "nanosec": 50_000_000}}, {"ns": "b", "type": 1})
    eventually(lambda: "b/0" in shown(stage))
    eventually(lambda: set(shown(stage)) == {"b/0"})
    assert not stage.state.playing


def test_there_are_only_so_many_markers(
    send: Any, call: Call, hub: LocalNode, stage: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mindstage.ros.unreal_vis._MAX_MARKERS", 2)
    told: list[Any] = []
    hub.subscribe("/mindstage/diagnostics", told.append)
    send(*({"ns": "a", "id": id, "type": 1} for id in (1, 2, 3)), {"ns": "a", "id": 2, "type": 2})
    eventually(lambda: diagnostic_texts(told) == [("a/3", "2 markers exist already; remove some first")])
    eventually(lambda: shown(stage)["a/2"].type is MarkerType.SPHERE)
    assert set(shown(stage)) == {"a/1", "a/2"}
    with pytest.raises(ServiceCallError, match="2 markers exist already"):
        call("display_basic_marker", marker_type=1)


def test_a_marker_may_be_told_in_the_frame_of_a_body(send: Any, stage: Simulation) -> None:
    send({"header": {"frame_id": "Cupboard"}, "ns": "a", "type": 1, "pose": pose_message(0.0, 0.0, 1.0)})
    eventually(lambda: "a/0" in shown(stage))
    assert shown(stage)["a/0"].pose.position == pytest.approx((2.0, 0.0, 1.4))


def test_a_mesh_that_names_a_body_is_its_ghost(send: Any, hub: LocalNode, stage: Simulation) -> None:
    told: list[Any] = []
    hub.subscribe("/mindstage/diagnostics", told.append)
    send({"ns": "a", "type": 10, "mesh_resource": "body://Mug", "pose": pose_message(1.0, 2.0, 3.0), "color": RED})
    eventually(lambda: "a/0" in shown(stage))
    ghost = shown(stage)["a/0"]
    assert (ghost.type, ghost.body, ghost.pose.position) == (MarkerType.BODY_COPY, "Mug", (1.0, 2.0, 3.0))
    send({"ns": "b", "type": 10, "mesh_resource": "body://Mugg"})
    eventually(lambda: any("no body 'Mugg'; near: 'Mug'" in text for _, text in diagnostic_texts(told)))
    assert "b/0" not in shown(stage)


def test_an_arrow_told_by_its_ends_points_from_one_to_the_other(send: Any, stage: Simulation) -> None:
    ends = [{"x": 1.0, "y": 1.0, "z": 1.0}, {"x": 1.0, "y": 1.0, "z": 3.0}]
    send({"ns": "a", "type": 0, "points": ends, "scale": {"x": 0.05, "y": 0.1, "z": 0.0}, "color": RED})
    eventually(lambda: "a/0" in shown(stage))
    arrow = shown(stage)["a/0"]
    assert arrow.size == pytest.approx((2.0, 0.1, 0.1))
    assert arrow.pose.position == (1, 1, 1)
    half = 0.5**0.5
    assert arrow.pose.quaternion == pytest.approx((half, 0.0, -half, 0.0))


def test_what_is_wrong_with_a_message_is_told_on_the_diagnostics(send: Any, hub: LocalNode, stage: Simulation) -> None:
    told: list[Any] = []
    hub.subscribe("/mindstage/diagnostics", told.append)
    send({"type": "cube"})
    send({"ns": "a", "type": 10, "mesh_resource": "package://x/y.stl"})
    send({"ns": "a", "type": 1, "header": {"frame_id": "nobody"}})
    hub.publish("/unreal/highlight", "mindstage_msgs/LitBodies", {"ids": "Mug"})
    eventually(lambda: len(told) >= 4)
    texts = " | ".join(text for _, text in diagnostic_texts(told))
    assert "markers[0].type: expected int, got str" in texts
    assert "a MESH_RESOURCE is not supported, except for a copy of a body, with the resource body://ID" in texts
    assert "no body 'nobody'" in texts
    assert "ids: expected array, got str" in texts
    assert not shown(stage)


def test_highlights_come_as_messages_and_say_why(hub: LocalNode, face: RosInterface, stage: Simulation) -> None:
    told: list[Any] = []
    hub.subscribe("/mindstage/diagnostics", told.append)
    hub.publish(
        "/unreal/highlight", "mindstage_msgs/LitBodies", {"ids": ["Mug", "nobody"], "color": RED, "label": "mine"}
    )
    eventually(lambda: stage.state.highlight_groups)
    assert [(group.ids, group.color, group.label) for group in stage.state.highlight_groups] == [
        (("Mug",), (1, 0, 0), "mine")
    ]
    eventually(lambda: [id for id, _ in diagnostic_texts(told)] == ["nobody"])
    hub.publish("/unreal/highlight", "mindstage_msgs/LitBodies", {"ids": ["Mug"], "label": "mine"})
    eventually(lambda: not stage.state.highlight_groups)
