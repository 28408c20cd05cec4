"""Markers, added by services and by messages."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from mindstage.access.limits import MARKERS
from mindstage.bridge import LocalNode
from mindstage.errors import ServiceCallError
from mindstage.ros import RosInterface
from mindstage.simulation import Marker, MarkerType, Simulation
from tests.bridge.raw_client import eventually
from tests.ros.ros_messages import TURNED, Call, diagnostic_texts, pose_message

RED = {"r": 1.0, "g": 0.0, "b": 0.0, "a": 1.0}
BLUE = {"r": 0.0, "g": 0.0, "b": 1.0, "a": 0.5}


def shown(simulation: Simulation) -> dict[str, Marker]:
    return {marker.id: marker for marker in simulation.state.markers}


@pytest.fixture
def send(ros_interface: RosInterface, local_node: LocalNode) -> Any:
    """Publishes markers."""

    def send(*markers: dict[str, Any]) -> None:
        local_node.publish("/unreal/markers", "visualization_msgs/MarkerArray", {"markers": list(markers)})

    return send


def test_a_basic_marker_is_added_replaced_and_removed(call: Call, simulation: Simulation) -> None:
    made = call("display_basic_marker", marker_type=2, pose=pose_message(1, 2, 3, TURNED), color=RED, scale=0.4)
    marker = shown(simulation)[made["marker_id"]]
    assert marker.type is MarkerType.SPHERE
    assert marker.pose.position == (1, 2, 3)
    assert marker.size == (0.4, 0.4, 0.4)
    assert marker.color == (1, 0, 0)
    again = call("display_basic_marker", marker_type=1, color=BLUE, scale=0.4, marker_id=made["marker_id"])
    assert again == made
    assert shown(simulation)[made["marker_id"]].type is MarkerType.CUBE
    assert call("remove_marker", marker_id=made["marker_id"]) == {"success": True}
    assert call("remove_marker", marker_id=made["marker_id"]) == {"success": False}
    assert not simulation.state.markers


def test_every_basic_marker_type_is_supported(call: Call, simulation: Simulation) -> None:
    made = [call("display_basic_marker", marker_type=number)["marker_id"] for number in range(6)]
    assert len(set(made)) == 6
    types = [shown(simulation)[id].type.value for id in made]
    assert types == ["sphere", "cube", "sphere", "cylinder", "cone", "arrow"]


def test_the_color_of_a_trajectory_is_interpolated_by_arc_length(call: Call, simulation: Simulation) -> None:
    points = [{"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 3.0, "z": 0.0}]
    made = call("display_trajectory", points=points, color_begin=RED, color_end={**BLUE, "a": 1.0})
    marker = shown(simulation)[made["marker_id"]]
    assert marker.type is MarkerType.LINE_STRIP
    assert marker.points == ((0, 0, 0), (1, 0, 0), (1, 3, 0))
    assert marker.colors == ((1, 0, 0), (0.75, 0, 0.25), (0, 0, 1))
    assert call("remove_marker", marker_id=made["marker_id"])["success"]


def test_markers_are_added_without_subscribers(send: Any, simulation: Simulation) -> None:
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
    eventually(lambda: "plan/7" in shown(simulation))
    marker = shown(simulation)["plan/7"]
    assert (marker.type, marker.size, marker.color) == (MarkerType.CUBE, (1, 2, 3), (1, 0, 0))
    send({"ns": "plan", "id": 7, "action": 2})
    eventually(lambda: not shown(simulation))


def test_single_markers_have_a_topic(
    local_node: LocalNode, ros_interface: RosInterface, simulation: Simulation
) -> None:
    local_node.publish(
        "/unreal/marker", "visualization_msgs/Marker", {"ns": "a", "type": 9, "text": "here", "color": RED}
    )
    eventually(lambda: "a/0" in shown(simulation))
    assert shown(simulation)["a/0"].text == "here"


def test_deleteall_removes_the_markers_of_one_namespace(send: Any, call: Call, simulation: Simulation) -> None:
    kept = call("display_basic_marker", marker_type=1)["marker_id"]
    send({"ns": "a", "id": 1, "type": 1}, {"ns": "a", "id": 2, "type": 1}, {"ns": "b", "id": 1, "type": 1})
    eventually(lambda: len(shown(simulation)) == 4)
    send({"ns": "a", "action": 3})
    eventually(lambda: set(shown(simulation)) == {kept, "b/1"})
    send({"action": 3})
    eventually(lambda: set(shown(simulation)) == {kept})


def test_a_marker_expires_while_the_simulation_is_paused(send: Any, simulation: Simulation) -> None:
    send({"ns": "a", "type": 1, "lifetime": {"sec": 0, "nanosec": 50_000_000}}, {"ns": "b", "type": 1})
    eventually(lambda: "b/0" in shown(simulation))
    eventually(lambda: set(shown(simulation)) == {"b/0"})
    assert not simulation.state.playing


def test_the_number_of_markers_is_limited(
    send: Any, call: Call, local_node: LocalNode, simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mindstage.ros.unreal_vis.MARKERS", msgspec.structs.replace(MARKERS, maximum=2))
    diagnostics: list[Any] = []
    local_node.subscribe("/mindstage/diagnostics", diagnostics.append)
    send(*({"ns": "a", "id": id, "type": 1} for id in (1, 2, 3)), {"ns": "a", "id": 2, "type": 2})
    eventually(lambda: diagnostic_texts(diagnostics) == [("a/3", "2 markers exist already; remove some first")])
    eventually(lambda: shown(simulation)["a/2"].type is MarkerType.SPHERE)
    assert set(shown(simulation)) == {"a/1", "a/2"}
    with pytest.raises(ServiceCallError, match="2 markers exist already"):
        call("display_basic_marker", marker_type=1)


def test_a_marker_can_be_in_the_frame_of_a_body(send: Any, simulation: Simulation) -> None:
    send({"header": {"frame_id": "Cupboard"}, "ns": "a", "type": 1, "pose": pose_message(0.0, 0.0, 1.0)})
    eventually(lambda: "a/0" in shown(simulation))
    assert shown(simulation)["a/0"].pose.position == pytest.approx((2.0, 0.0, 1.4))


def test_a_mesh_with_the_uri_of_a_body_is_a_copy_of_it(
    send: Any, local_node: LocalNode, simulation: Simulation
) -> None:
    diagnostics: list[Any] = []
    local_node.subscribe("/mindstage/diagnostics", diagnostics.append)
    send({"ns": "a", "type": 10, "mesh_resource": "body://Mug", "pose": pose_message(1.0, 2.0, 3.0), "color": RED})
    eventually(lambda: "a/0" in shown(simulation))
    ghost = shown(simulation)["a/0"]
    assert (ghost.type, ghost.body, ghost.pose.position) == (MarkerType.BODY_COPY, "Mug", (1.0, 2.0, 3.0))
    send({"ns": "b", "type": 10, "mesh_resource": "body://Mugg"})
    eventually(lambda: any("no body 'Mugg'; near: 'Mug'" in text for _, text in diagnostic_texts(diagnostics)))
    assert "b/0" not in shown(simulation)


def test_an_arrow_can_be_given_by_two_points(send: Any, simulation: Simulation) -> None:
    ends = [{"x": 1.0, "y": 1.0, "z": 1.0}, {"x": 1.0, "y": 1.0, "z": 3.0}]
    send({"ns": "a", "type": 0, "points": ends, "scale": {"x": 0.05, "y": 0.1, "z": 0.0}, "color": RED})
    eventually(lambda: "a/0" in shown(simulation))
    arrow = shown(simulation)["a/0"]
    assert arrow.size == pytest.approx((2.0, 0.1, 0.1))
    assert arrow.pose.position == (1, 1, 1)
    assert (arrow.points, arrow.colors) == ((), ()), "the pose and the size say it all"
    half = 0.5**0.5
    assert arrow.pose.quaternion == pytest.approx((half, 0.0, -half, 0.0))


def test_errors_of_messages_are_published_on_the_diagnostics(
    send: Any, local_node: LocalNode, simulation: Simulation
) -> None:
    diagnostics: list[Any] = []
    local_node.subscribe("/mindstage/diagnostics", diagnostics.append)
    send({"type": "cube"})
    send({"ns": "a", "type": 10, "mesh_resource": "package://x/y.stl"})
    send({"ns": "a", "type": 1, "header": {"frame_id": "nobody"}})
    local_node.publish("/unreal/highlight", "mindstage_msgs/HighlightGroup", {"ids": "Mug"})
    eventually(lambda: len(diagnostics) >= 4)
    texts = " | ".join(text for _, text in diagnostic_texts(diagnostics))
    assert "markers[0].type: expected int, got str" in texts
    assert "a MESH_RESOURCE is not supported, except for a copy of a body, with the resource body://ID" in texts
    assert "no body 'nobody'" in texts
    assert "ids: expected array, got str" in texts
    assert not shown(simulation)


def test_highlight_messages_have_labels(
    local_node: LocalNode, ros_interface: RosInterface, simulation: Simulation
) -> None:
    diagnostics: list[Any] = []
    local_node.subscribe("/mindstage/diagnostics", diagnostics.append)
    local_node.publish(
        "/unreal/highlight", "mindstage_msgs/HighlightGroup", {"ids": ["Mug", "nobody"], "color": RED, "label": "mine"}
    )
    eventually(lambda: simulation.state.highlight_groups)
    assert [(group.ids, group.color, group.label) for group in simulation.state.highlight_groups] == [
        (("Mug",), (1, 0, 0), "mine")
    ]
    eventually(lambda: [id for id, _ in diagnostic_texts(diagnostics)] == ["nobody"])
    local_node.publish("/unreal/highlight", "mindstage_msgs/HighlightGroup", {"ids": ["Mug"], "label": "mine"})
    eventually(lambda: not simulation.state.highlight_groups)
