"""The Foxglove server, as a client of its protocol sees it: scene, transforms, events, parameters and services."""

from __future__ import annotations

import builtins
import socket
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.errors import FoxgloveUnavailableError
from mindstage.knowledge import KnowledgeBase
from mindstage.ros.foxglove import FoxgloveServer
from mindstage.scene import Body, BodyId, Iri, Pose, PrimitiveShape, PrimitiveType, World
from mindstage.scene.transforms import pose_multiply
from mindstage.simulation import Marker, MarkerType, Simulation
from tests.ros.foxglove_client import FoxgloveClient

pytest.importorskip("foxglove", reason="the extra foxglove is not installed")


@pytest.fixture
def server(simulation: Simulation) -> Iterator[FoxgloveServer]:
    with FoxgloveServer(simulation, port=0) as server:
        yield server


@pytest.fixture
def client(server: FoxgloveServer) -> Iterator[FoxgloveClient]:
    client = FoxgloveClient(server.url)
    yield client
    client.close()


def entities(messages: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Applies the updates of a scene, as the app does; returns the entities by their id."""
    there: dict[str, dict[str, Any]] = {}
    for message in messages:
        for deletion in message["deletions"]:
            if deletion.get("type", 0) == 1:
                there.clear()
            else:
                there.pop(deletion["id"], None)
        there |= {each["id"]: each for each in message["entities"]}
    return there


def test_the_server_advertises_its_topics_and_capabilities(client: FoxgloveClient) -> None:
    info, channels = client.operations[0], {
        each["topic"]: each["schemaName"] for operation in client.operations for each in operation.get("channels", ())
    }  # fmt: skip
    assert (info["op"], info["name"]) == ("serverInfo", "mindstage")
    assert {"parameters", "parametersSubscribe", "services", "time"} <= set(info["capabilities"])
    assert channels == {
        "/scene": "foxglove.SceneUpdate", "/tf": "foxglove.FrameTransforms", "/events": "foxglove.Log",
    }  # fmt: skip


def test_the_scene_has_every_body_of_the_kitchen(knowledge: KnowledgeBase, empty_simulation: Simulation) -> None:
    empty_simulation.spawn()
    with FoxgloveServer(empty_simulation, port=0) as server:
        client = FoxgloveClient(server.url)
        scene = client.subscribe("/scene")
        client.wait(lambda: scene)
        client.close()
    there = entities(scene)
    assert set(there) == {f"body/{body.id}" for body in knowledge.world().bodies}
    assert {id.removeprefix("body/") for id in there} == {each["frame_id"] for each in there.values()}
    assert all(each["frame_locked"] for each in there.values())
    assert all(each["triangles"] for each in there.values())
    fridge = there["body/fridge"]
    assert {pair["key"]: pair["value"] for pair in fridge["metadata"]}["class"].endswith("#FridgeW60H140")
    corners = np.array([
        [point.get(axis, 0.0) for axis in "xyz"] for part in fridge["triangles"] for point in part["points"]
    ])  # fmt: skip
    size = np.array(knowledge.world().body("fridge").size)
    assert np.ptp(corners, axis=0) == pytest.approx(size, abs=0.02)
    drawn = empty_simulation.geometry[BodyId("fridge")].visuals
    assert sum(len(part["indices"]) for part in fridge["triangles"]) == sum(visual.faces.size for visual in drawn)
    assert fridge["triangles"][0]["color"]["r"] == pytest.approx(drawn[0].material.color[0])


def test_only_what_changes_is_published_again(client: FoxgloveClient, simulation: Simulation) -> None:
    scene = client.subscribe("/scene")
    client.wait(lambda: scene)
    simulation.highlight(["Mug"], (1.0, 0.0, 0.0))
    client.wait(lambda: len(scene) == 2)
    assert [each["id"] for each in scene[1]["entities"]] == ["body/Mug"]
    assert all(part["color"]["r"] == 1.0 and "g" not in part["color"] for part in scene[1]["entities"][0]["triangles"])
    simulation.run_on_engine(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    client.wait(lambda: len(scene) == 3)
    assert ([each["id"] for each in scene[2]["deletions"]], scene[2]["entities"]) == (["body/Mug"], [])
    simulation.clear_highlights()
    simulation.add_markers([Marker(id="a", type=MarkerType.TEXT, text="here", pose=Pose((1.0, 2.0, 3.0)))])
    client.wait(lambda: "marker/a" in entities(scene))
    marker = entities(scene)["marker/a"]
    assert (marker["frame_id"], marker["texts"][0]["text"]) == ("map", "here")
    simulation.remove_markers(["a"])
    client.wait(lambda: "marker/a" not in entities(scene))


@pytest.mark.parametrize("type", list(MarkerType))
def test_every_type_of_marker_is_drawn(client: FoxgloveClient, simulation: Simulation, type: MarkerType) -> None:
    scene = client.subscribe("/scene")
    points = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    pose = Pose((1.0, 2.0, 3.0))
    simulation.add_markers([
        Marker(id="a", type=type, points=points, text="t", body="Mug", pose=pose, opacity=0.5)
    ])  # fmt: skip
    client.wait(lambda: "marker/a" in entities(scene))
    marker = entities(scene)["marker/a"]
    drawn = {key for key in ("arrows", "cubes", "spheres", "cylinders", "lines", "texts", "triangles") if marker[key]}
    assert drawn == {
        MarkerType.CUBE: {"cubes"}, MarkerType.SPHERE: {"spheres"}, MarkerType.CYLINDER: {"cylinders"},
        MarkerType.CONE: {"cylinders"}, MarkerType.ARROW: {"arrows"}, MarkerType.TEXT: {"texts"},
        MarkerType.LINE_STRIP: {"lines"}, MarkerType.LINE_LIST: {"lines"}, MarkerType.POINTS: {"spheres"},
        MarkerType.BODY_COPY: {"triangles"},
    }[type]  # fmt: skip
    if type is MarkerType.BODY_COPY:
        assert marker["triangles"][0]["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 3.0}
        assert {part["color"]["a"] for part in marker["triangles"]} == {0.5}
    if type is MarkerType.POINTS:
        places = [part["pose"]["position"] for part in marker["spheres"]]
        assert places == [{"x": 1.0, "y": 2.0, "z": 3.0}, {"x": 2.0, "y": 2.0, "z": 3.0}]


def test_bodies_without_geometry_are_primitives(knowledge: KnowledgeBase) -> None:
    from mindstage.engines import NullEngine

    def body(id: str, shape: PrimitiveType | None) -> Body:
        kind = None if shape is None else PrimitiveShape(type=shape)
        return Body(id=BodyId(id), iri=Iri(f"#{id}"), cls=Iri("#T"), pose=Pose(), size=(1.0, 2.0, 3.0), shape=kind)

    bodies = (body("a", None), body("b", PrimitiveType.SPHERE), body("c", PrimitiveType.CYLINDER))
    with Simulation(knowledge, NullEngine(), shapes=False) as simulation:
        simulation.spawn(World(iri=Iri("#m"), bodies=bodies))
        with FoxgloveServer(simulation, port=0) as server:
            client = FoxgloveClient(server.url)
            scene = client.subscribe("/scene")
            client.wait(lambda: scene)
            client.close()
    there = entities(scene)
    assert there["body/a"]["cubes"][0]["size"] == {"x": 1.0, "y": 2.0, "z": 3.0}
    assert there["body/b"]["spheres"][0]["size"] == {"x": 1.0, "y": 2.0, "z": 3.0}
    cylinder = there["body/c"]["cylinders"][0]
    assert (cylinder["bottom_scale"], cylinder["top_scale"]) == (1.0, 1.0)


def test_the_composed_transforms_are_the_poses(client: FoxgloveClient, simulation: Simulation) -> None:
    messages = client.subscribe("/tf")
    client.wait(lambda: messages)
    simulation.run_on_engine(lambda engine: engine.apply_force(BodyId("Drawer"), (-40.0, 0.0, 0.0)))
    simulation.step(0.3)

    def pose_of(frame: str) -> Any:
        if frame == "map":
            return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        edge = next(
            each for message in reversed(messages) for each in message["transforms"] if each["child_frame_id"] == frame
        )
        shift, turn = edge["translation"], edge["rotation"]
        local = [shift.get(axis, 0.0) for axis in "xyz"] + [turn.get(axis, 0.0) for axis in "wxyz"]
        return pose_multiply(pose_of(edge["parent_frame_id"]), np.array(local))

    expected = dict(zip(simulation.state.ids, simulation.state.poses, strict=True))
    assert expected["Drawer"][0] < 1.9
    client.wait(lambda: all(np.allclose(pose_of(id), pose, atol=1e-5) for id, pose in expected.items()))
    stamp = messages[-1]["transforms"][0]["timestamp"]
    assert stamp.get("seconds", 0) + stamp.get("nanos", 0) / 1e9 == pytest.approx(simulation.state.time_s)
    assert messages[-1]["log_time_s"] == pytest.approx(simulation.state.time_s)


def test_a_parameter_pauses_and_plays_the_simulation(client: FoxgloveClient, simulation: Simulation) -> None:
    assert client.parameters() == {
        "paused": True, "speed": 1.0, "engine": "mujoco", "map": simulation.worlds[0].iri, "bodies": 8,
    }  # fmt: skip
    assert client.parameters(speed=2.0, paused=False)["paused"] is False
    assert (simulation.state.playing, simulation.state.speed) == (True, 2.0)
    client.wait(lambda: len(client.times_s) > 3 and client.times_s[-1] > 0.0)
    assert client.parameters(paused=True)["paused"] is True
    assert not simulation.state.playing
    time_s = simulation.state.time_s
    client.wait(lambda: client.times_s[-1] == pytest.approx(time_s))


def test_parameters_that_cannot_be_set_are_refused_with_the_reason(
    client: FoxgloveClient, simulation: Simulation
) -> None:
    for name, value, reason in (
        ("engine", "other", "it cannot be set"),
        ("paused", "yes", "is not true or false"),
        ("speed", -1.0, "is not a number above 0"),
        ("speed", True, "is not a number above 0"),
    ):
        before = len(client.operations)
        assert client.parameters(**{name: value})["engine"] == "mujoco"
        client.wait(lambda before=before, reason=reason: any(
            each["op"] == "status" and reason in each["message"] for each in client.operations[before:]
        ))  # fmt: skip
    assert (simulation.state.playing, simulation.state.speed) == (False, 1.0)


def test_subscribed_parameters_are_published_when_they_change(client: FoxgloveClient, simulation: Simulation) -> None:
    client.send(op="subscribeParameterUpdates", parameterNames=["paused"])
    client.parameters()  # the subscription has been handled
    simulation.play()
    client.wait(lambda: {"name": "paused", "value": False} in [
        parameter for each in client.operations for parameter in each.get("parameters", ())
    ])  # fmt: skip


def test_events_are_logged(client: FoxgloveClient, simulation: Simulation) -> None:
    events = client.subscribe("/events")
    client.parameters()  # the subscription has been handled

    def texts() -> list[tuple[int, str]]:
        return [(each["level"], each["message"]) for each in events]

    simulation.highlight(["Mug"], "red", label="where is the mug?")
    client.wait(lambda: (2, "highlighted Mug: where is the mug?") in texts())
    simulation.run_on_engine(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    client.wait(lambda: (2, "1 body removed: Mug") in texts())
    floor = simulation.worlds[0].bodies[0]
    simulation.spawn(World(iri=Iri("#m"), bodies=(floor, replace(floor, id=BodyId("Second"), pose=Pose((0, 0, -9))))))
    client.wait(lambda: (2, "1 body added: Second") in texts())
    client.wait(lambda: any(level == 3 and "Floor was not spawned" in text for level, text in texts()))
    simulation.step(0.1)
    simulation.play(speed=2.0)
    client.wait(lambda: (2, "playing at speed 2") in texts())
    simulation.pause()
    client.wait(lambda: (2, "paused") in texts())
    simulation.reset_to_start()
    client.wait(lambda: (2, "the time was reset to 0 s") in texts())


def test_services_ask_place_highlight_and_reset(client: FoxgloveClient, simulation: Simulation) -> None:
    before = set(simulation.state.ids)
    placed = client.call("/mindstage/place", {"item": "Cup", "on": "Cupboard"})
    assert placed["holder"] == "Cupboard"
    assert set(simulation.state.ids) == {*before, placed["id"]}
    answers = client.call("/mindstage/ask", {"question": "where_is", "args": {"thing": placed["id"]}})["answers"]
    assert any(row["other"].endswith("#Cupboard") for row in answers), answers
    answers = client.call("/mindstage/ask", {"question": "storage_place", "args": {"item": "CowsMilk"}})["answers"]
    assert answers[0]["id"] == "Refrigerator"
    client.call("/mindstage/highlight", {"ids": [placed["id"]], "color": "green"})
    assert set(simulation.state.highlights) == {placed["id"]}
    assert client.call("/mindstage/reset", {}) == {}
    assert set(simulation.state.ids) == before
    assert "no question" in client.call("/mindstage/ask", {"question": "nothing"})
    assert "Cupboardd" in client.call("/mindstage/place", {"item": "Cup", "on": "Cupboardd"})
    assert "unknown field" in client.call("/mindstage/place", {"thing": 1})
    assert "/mindstage/place" in client.call("/mindstage/place", b"\xff{")


def test_a_late_client_receives_the_whole_scene_and_is_listed(
    client: FoxgloveClient, server: FoxgloveServer, simulation: Simulation
) -> None:
    first = client.subscribe("/scene")
    client.wait(lambda: first)
    assert [(each.transport, each.activity) for each in simulation.clients.clients()] == [("Foxglove", "/scene")]
    late = FoxgloveClient(server.url)
    scene, transforms = late.subscribe("/scene"), late.subscribe("/tf")
    late.wait(lambda: scene and transforms)
    assert set(entities(scene)) == {f"body/{id}" for id in simulation.state.ids}
    assert {each["child_frame_id"] for each in transforms[0]["transforms"]} >= set(simulation.state.ids)
    late.close()
    client.wait(lambda: len(simulation.clients.clients()) == 1)


def test_closing_disconnects_and_leaves_no_thread_and_no_port(simulation: Simulation) -> None:
    server = FoxgloveServer(simulation, port=0)
    client = FoxgloveClient(server.url)
    client.subscribe("/tf")
    simulation.play()
    server.close()
    server.close()
    client.close()
    assert "mindstage-foxglove" not in {thread.name for thread in threading.enumerate()}
    assert simulation.clients.clients() == ()
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", int(server.url.rpartition(":")[2]))) != 0
    FoxgloveServer(simulation, port=0).close()


def test_a_port_in_use_and_a_missing_sdk_are_errors(
    server: FoxgloveServer, simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(FoxgloveUnavailableError, match="or another port"):
        FoxgloveServer(simulation, port=server.port)
    real = builtins.__import__

    def fail(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("foxglove"):
            raise ImportError("No module named 'foxglove'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", fail)
    with pytest.raises(FoxgloveUnavailableError, match=r"pip install 'mindstage\[foxglove\]'"):
        FoxgloveServer(simulation, port=0)
