"""Requests and events of pages, with real websockets and physics, without a browser."""

from __future__ import annotations

import json
import re
import threading
import time
from base64 import b64decode
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
from msgspec.structs import replace
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.maps import bundled_kitchen, write_map
from mindstage.scene import BodyId, Iri, Mobility, Pose, World, diff
from mindstage.viewer import Viewer
from tests.kitchenette import KNOWROB, kitchenette
from tests.maps.hostile_urdf import HOSTILE, hostile_urdf
from tests.viewer.page_client import PageClient, RequestFailedError, connect_page_client
from tests.viewer.waiting import wait_until

MUG, DRAWER = BodyId("Mug"), BodyId("Drawer")
LEVEL = [1.0, 0.0, 0.0, 0.0]


@pytest.fixture
def physics_simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def page(physics_simulation: Simulation) -> Iterator[Viewer]:
    with Viewer(physics_simulation, port=0) as viewer:
        yield viewer


@pytest.fixture
def client(page: Viewer) -> Iterator[PageClient]:
    with connect_page_client(page.url) as client:
        wait_until(lambda: client.latest_value("scene_tree"), "the scene tree is received")
        yield client


def at(simulation: Simulation, id: BodyId) -> np.ndarray:
    return simulation.state.poses[simulation.state.ids.index(id)]


def names(client: PageClient) -> set[str]:
    return {row[0] for row in client.latest_value("scene_tree")["rows"]}


def eventually(client: PageClient, topic: str, value: Callable[[Any], object], what: str) -> None:
    wait_until(lambda: client.latest_value(topic) is not None and value(client.latest[topic]), what)


# -- scene tree and clock ----------------------------------------------------------------------------------------------


def test_a_page_receives_the_scene_tree_the_clock_and_the_undo_history(client: PageClient) -> None:
    eventually(client, "clock", lambda clock: clock["bodies"] == 8 and not clock["playing"], "the clock is received")
    eventually(client, "history", lambda history: not history["done"] and not history["undone"], "nothing was edited")
    assert names(client) == {body.id for body in kitchenette().bodies}
    assert client.latest_value("scene_tree")["engine"] == "mujoco"


def test_details_are_invalidated_even_if_the_scene_tree_is_unchanged(page: Viewer, client: PageClient) -> None:
    with connect_page_client(page.url) as other:
        wait_until(lambda: other.latest_value("details_changed"), "the other client is connected")
        world, before = other.latest["scene_tree"], other.latest["details_changed"]
        client.ask("set_physics", id="Mug", mass_kg=1.5)
        eventually(other, "details_changed", lambda now: now > before, "the other client is notified")
        assert other.latest["scene_tree"] == world
        assert other.ask("details", id="Mug")["mass"] == 1.5


def test_the_simulation_is_played_paused_stepped_and_reset(physics_simulation: Simulation, client: PageClient) -> None:
    client.ask("play", speed=2.0)
    eventually(
        client, "clock", lambda clock: clock["playing"] and clock["speed"] == 2.0, "the simulation runs at double speed"
    )
    client.ask("pause")
    eventually(client, "clock", lambda clock: not clock["playing"], "the simulation is paused")
    before = physics_simulation.state.time_s
    client.ask("step", duration_s=0.25)
    assert physics_simulation.state.time_s == pytest.approx(before + 0.25)
    client.ask("move", id="Mug", position=[0.0, -2.0, 0.05], quaternion=LEVEL)
    client.ask("reset")
    assert at(physics_simulation, MUG)[:3] == pytest.approx((2.0, 0.0, 0.85))
    eventually(client, "history", lambda history: history["undo"] == "reset", "the reset can be undone")


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("play", {"speed": 0}),
        ("play", {"speed": 1e9}),
        ("step", {"duration_s": 1e6}),
        ("move", {"id": "Mug", "position": [0, 0, 1e300], "quaternion": LEVEL}),
        ("move", {"id": "Mug", "position": [0, 0], "quaternion": LEVEL}),
        ("move", {"id": "Mug", "position": [0, 0, 0], "quaternion": [0, 0, 0, 0]}),
        ("set_physics", {"id": "Mug", "mass_kg": 0}),
        ("set_physics", {"id": "Mug", "mobility": "flying"}),
        ("set_material", {"id": "Mug", "color": "no color"}),
        ("move_joint", {"id": "DrawerSlide", "axis": "y", "value": 0.1}),
        ("move_joint", {"id": "DrawerSlide", "axis": "w", "value": 0.1}),
        ("move_joint", {"id": "Nothing", "axis": "x", "value": 0.1}),
        ("delete", {"ids": []}),
        ("delete", {"ids": ["Mugg"]}),
        ("attach", {"child": "Mug", "parent": "Mug"}),
        ("details", {"id": "Mugg"}),
        ("select", {"id": 5}),
        ("set_clipping_height", {"height": "high"}),
        ("set_labels", {"mode": "some"}),
        ("undo", {}),
        ("add", {"cls": "NoSuchClassAtAll"}),
        ("add", {"cls": "Cup", "size": [0.1, 0.1, -1.0]}),
        ("save", {"dialect": "klingon"}),
        ("save", {"format": "mjcf"}),
        ("save", {"format": "tscn"}),
        ("load", {"name": "x.owl"}),
    ],
)
def test_invalid_requests_are_refused_and_change_nothing(
    physics_simulation: Simulation, client: PageClient, what: str, arguments: dict[str, Any]
) -> None:
    before = physics_simulation.snapshot()
    with pytest.raises(RequestFailedError) as refused:
        client.ask(what, **arguments)
    assert refused.value.code != "Defect", str(refused.value)
    assert "there is no such method" not in str(refused.value)
    assert physics_simulation.snapshot() == before


# -- details -----------------------------------------------------------------------------------------------------------


def test_details_of_the_selected_body_include_live_pose_and_joints(
    physics_simulation: Simulation, client: PageClient
) -> None:
    details = client.ask("details", id="Drawer")
    assert (details["cls"], details["attached_bodies"]) == ("Drawer", ["DrawerHandle"])
    assert [joint["id"] for joint in details["joints"]] == ["DrawerSlide"]
    assert "ContainerArtifact" in details["ancestors"], "drawers are in the bundled ontology"
    client.ask("select", id="Drawer")
    eventually(client, "live_details", lambda live: live["id"] == "Drawer", "the pose is received")
    assert client.latest["live_details"]["joints"] == {"DrawerSlide": {"x": 0.0}}
    physics_simulation.edits.move(DRAWER, Pose((1.75, 0.0, 0.65)))
    eventually(
        client,
        "live_details",
        lambda live: live["joints"] == {"DrawerSlide": {"x": -0.2}},
        "the new joint position is received",
    )
    assert client.latest["live_details"]["pose"]["position"] == [1.75, 0.0, 0.65]
    client.ask("select", id="Mug")
    eventually(client, "live_details", lambda live: live["id"] == "Mug", "the pose of what has no joints is received")
    assert client.latest["live_details"]["joints"] == {}


def test_details_are_shown_during_a_long_step(
    physics_simulation: Simulation, client: PageClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, may_end, timeouts = threading.Event(), threading.Event(), list[float]()

    def step(duration_s: float, **_: Any) -> None:
        begun.set()
        if not may_end.wait(60.0):
            timeouts.append(duration_s)

    monkeypatch.setattr(physics_simulation, "step", step)
    client.socket.send(json.dumps({"id": 1000, "method": "step", "params": {"duration_s": 1.0}}))
    assert begun.wait(20.0)
    assert client.ask("details", id="Drawer")["cls"] == "Drawer"
    may_end.set()
    client.ask("pause")
    assert not timeouts, "the details came after the step"


def test_a_body_is_added_where_the_camera_of_its_page_looks(page: Viewer, physics_simulation: Simulation) -> None:
    camera = {
        "type": "ViewerCameraMessage", "wxyz": LEVEL, "position": [0, -9, 5], "fov": 0.8, "near": 0.1, "far": 99.0,
        "image_height": 300, "image_width": 400, "look_at": [-1.0, -1.5, 0.0], "up_direction": [0, 0, 1],
    }  # fmt: skip
    key, protocol = "0123456789abcdef", Subprotocol(f"viser-v{viser.__version__}")
    address = f"{page.url.replace('http', 'ws', 1)}/view/{key}"
    with (
        connect_page_client(page.url, key=key) as client,
        connect_page_client(page.url) as other,
        connect(address, subprotocols=[protocol], max_size=None) as view,
    ):
        view.send(msgspec.msgpack.encode(camera))
        wait_until(lambda: page.views.clients, "the view is connected, and shows the whole kitchen")
        (shown,) = page._server.get_clients().values()

        def is_turned() -> bool:
            for wrong in ({"position": "x"}, {"look_at": [1, 2]}, {"position": [float("nan"), 0, 0]}, {"fov": {}}):
                view.send(msgspec.msgpack.encode(camera | wrong))  # is dropped
            view.send(b"no message")
            view.send(msgspec.msgpack.encode(camera))  # again, since the viewer sets the first view meanwhile
            return bool(shown.camera.look_at.tolist() == [-1.0, -1.5, 0.0])

        wait_until(is_turned, "the camera is turned")
        seen = client.ask("add", **{"cls": "Cup", "size": [0.1, 0.1, 0.1]})
        assert at(physics_simulation, seen)[:2] == pytest.approx((-1.0, -1.5))
        elsewhere = other.ask("add", **{"cls": "Cup", "size": [0.1, 0.1, 0.1]})
        assert at(physics_simulation, elsewhere)[:2] == pytest.approx((0.0, 0.0)), "that page has no view"


def test_details_include_storage_places_from_the_ontology() -> None:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, MujocoEngine(), primitive_shapes=True, timeout_s=60.0) as simulation:
        simulation.spawn()
        milk = next(body.id for body in simulation.snapshot().bodies if "Milk" in body.cls)
        with Viewer(simulation, port=0) as viewer, connect_page_client(viewer.url) as client:
            eventually(client, "scene_tree", lambda world: len(world["rows"]) > 200, "the scene tree is received")
            kept = client.ask("details", id=milk)["storage_places"]
            assert any("fridge" in id for place in kept for id in place["ids"])


# -- edits -------------------------------------------------------------------------------------------------------------


def test_properties_are_changed_in_the_engine_and_undone(physics_simulation: Simulation, client: PageClient) -> None:
    before = physics_simulation.snapshot()
    client.ask("set_physics", id="Mug", mass_kg=2.5)
    assert physics_simulation.snapshot().body("Mug").physics.mass_kg == 2.5
    eventually(client, "history", lambda history: history["undo"] == "mass of Mug", "the edit can be undone")
    client.ask("set_physics", id="Fridge", mobility="dynamic", gravity=False)
    physics = physics_simulation.snapshot().body("Fridge").physics
    assert (physics.mobility, physics.gravity, physics.mass_kg) == (Mobility.DYNAMIC, False, 60.0)
    client.ask("set_material", id="Mug", name="gold", color="#ffcc00")
    assert [material.name for material in physics_simulation.snapshot().body("Mug").materials] == ["gold"]
    client.ask("set_material", id="Mug")
    assert physics_simulation.snapshot().body("Mug").materials == ()
    client.ask("attach", child="DrawerHandle")
    assert all(each.child != "DrawerHandle" for each in physics_simulation.snapshot().attachments)
    client.ask("attach", child="Mug", parent="Drawer")
    assert any(each.child == "Mug" for each in physics_simulation.snapshot().attachments)
    for _ in range(6):
        client.ask("undo")
    assert diff(before, physics_simulation.snapshot()).identical(1e-9)
    client.ask("redo")
    assert physics_simulation.snapshot().body("Mug").physics.mass_kg == 2.5


def test_edits_of_one_client_are_seen_by_others(page: Viewer, client: PageClient) -> None:
    with connect_page_client(page.url) as other:
        wait_until(lambda: other.latest_value("scene_tree"), "the other client has the scene tree")
        client.ask("delete", ids=["Mug"])
        wait_until(lambda: "Mug" not in names(other) and "Mug" not in names(client), "the mug is removed on both pages")
        eventually(other, "history", lambda history: history["undo"] == "Mug deleted", "the edit can be undone")
        other.ask("undo")
        wait_until(lambda: "Mug" in names(other) and "Mug" in names(client), "the mug is back on both pages")


def test_a_slider_opens_a_drawer_by_a_force_which_can_be_undone(
    physics_simulation: Simulation, client: PageClient
) -> None:
    physics_simulation.play()
    for value in (-0.05, -0.1, -0.2):
        client.ask("move_joint", id="DrawerSlide", axis="x", value=value, done=False)
    client.ask("move_joint", id="DrawerSlide", axis="x", value=-0.3)
    wait_until(
        lambda: at(physics_simulation, DRAWER)[0] == pytest.approx(1.65, abs=0.02), "the drawer is open by 30 cm"
    )
    wait_until(lambda: not physics_simulation._perturbations, "the drawer is released")
    assert at(physics_simulation, DRAWER)[1:3] == pytest.approx((0.0, 0.65), abs=1e-3)
    physics_simulation.pause()
    client.ask("undo")
    assert at(physics_simulation, DRAWER)[0] == pytest.approx(1.95, abs=1e-3)


def test_a_slider_in_a_paused_simulation_moves_the_drawer_in_one_edit(
    physics_simulation: Simulation, client: PageClient
) -> None:
    for value in (-0.1, -0.2):
        client.ask("move_joint", id="DrawerSlide", axis="x", value=value, done=False)
    client.ask("move_joint", id="DrawerSlide", axis="x", value=-0.3)
    assert at(physics_simulation, DRAWER)[0] == pytest.approx(1.65)
    assert physics_simulation.edits.history.undo == ("pose of Drawer",)
    client.ask("undo")
    assert at(physics_simulation, DRAWER)[0] == pytest.approx(1.95)


def test_a_slider_in_a_paused_simulation_stops_the_drawer_at_what_is_in_its_way(
    physics_simulation: Simulation, client: PageClient
) -> None:
    solid = kitchenette().body("Floor")
    block = replace(solid, id=BodyId("Block"), iri=Iri(f"{solid.iri}Block"), size=(0.2, 0.6, 0.8))
    physics_simulation.spawn(World(iri=Iri("http://x#block"), bodies=(replace(block, pose=Pose((1.3, 0.0, 0.4))),)))
    wait_until(lambda: "Block" in names(client), "the block is on the page")
    reply = client.ask("move_joint", id="DrawerSlide", axis="x", value=-0.4)
    assert reply["blocked_by"] == "Block"
    assert reply["value"] == pytest.approx(-0.26, abs=0.02), "the handle touches the block"
    assert at(physics_simulation, DRAWER)[0] == pytest.approx(1.95 + reply["value"])
    assert client.ask("move_joint", id="DrawerSlide", axis="x", value=-0.1) == {"value": -0.1, "blocked_by": None}


def test_clients_share_one_history(physics_simulation: Simulation, page: Viewer, client: PageClient) -> None:
    with connect_page_client(page.url) as other:
        client.ask("set_physics", id="Mug", mass_kg=0.7)
        other.ask("set_physics", id="Mug", gravity=False)
        steps = ["mass of Mug", "gravity of Mug"]
        for each in (client, other):
            eventually(each, "history", lambda history: history["done"] == steps, "both see both steps")
        client.ask("undo")
        mug = physics_simulation.snapshot().body("Mug").physics
        assert (mug.gravity, mug.mass_kg) == (True, 0.7), "the last step is undone, whoever made it"
        eventually(other, "history", lambda history: history["undone"] == ["gravity of Mug"], "the other page shows it")
        other.ask("set_physics", id="Mug", mass_kg=0.9)
        eventually(client, "history", lambda history: history["undone"] == [], "a new step ends what can be redone")
        other.ask("undo")
        other.ask("undo")
        assert physics_simulation.snapshot().body("Mug") == kitchenette().body("Mug")


def test_a_disconnected_client_releases_its_slider(physics_simulation: Simulation, page: Viewer) -> None:
    physics_simulation.play()
    with connect_page_client(page.url) as client:
        wait_until(lambda: client.latest_value("scene_tree"), "the scene tree is received")
        client.ask("move_joint", id="DrawerSlide", axis="x", value=-0.3, done=False)
        assert physics_simulation._perturbations
    wait_until(lambda: not physics_simulation._perturbations, "everything is released")


def test_what_a_disconnected_client_moved_is_a_step_of_its_own(
    physics_simulation: Simulation, page: Viewer, client: PageClient
) -> None:
    with connect_page_client(page.url) as other:
        wait_until(lambda: other.latest_value("scene_tree"), "the scene tree is received")
        other.ask("move_joint", id="DrawerSlide", axis="x", value=-0.1, done=False)
    wait_until(lambda: len(page.channel.sessions) == 1, "the other client is gone")
    client.ask("move_joint", id="DrawerSlide", axis="x", value=-0.2, done=False)
    client.ask("move_joint", id="DrawerSlide", axis="x", value=-0.3)
    assert at(physics_simulation, DRAWER)[0] == pytest.approx(1.65)
    client.ask("undo")
    assert at(physics_simulation, DRAWER)[0] == pytest.approx(1.85), "where the other client has left it"
    client.ask("undo")
    assert at(physics_simulation, DRAWER)[0] == pytest.approx(1.95)


def test_classes_are_found_by_a_part_of_the_name_best_match_first(client: PageClient) -> None:
    found = [each["name"] for each in client.ask("find_classes", text="cup")]
    assert found[0] == "Cup"
    assert all("cup" in name.lower() for name in found)
    assert "DinnerPlate" in {each["name"] for each in client.ask("find_classes", text="plate")}
    assert client.ask("find_classes", text="no class has this name") == []
    assert len(client.ask("find_classes")) > 20


def test_a_body_is_added_and_the_addition_undone(physics_simulation: Simulation, client: PageClient) -> None:
    id = client.ask("add", **{"cls": f"{KNOWROB}Cup", "position": [0.5, -1.0, 0.0], "size": [0.08, 0.08, 0.1]})
    cup = physics_simulation.snapshot().body(id)
    assert (cup.size, cup.physics.mobility) == ((0.08, 0.08, 0.1), Mobility.DYNAMIC)
    assert cup.pose.position == pytest.approx((0.5, -1.0, 0.052))
    assert client.ask("details", id=id)["cls"] == "Cup", "details of new bodies are available at once"
    wait_until(lambda: id in names(client), "the page is updated")
    client.ask("undo")
    assert id not in physics_simulation.state.ids
    client.ask("redo")
    assert id in physics_simulation.state.ids


def test_a_body_is_added_on_another_one(physics_simulation: Simulation, client: PageClient) -> None:
    id = client.ask("add", **{"cls": "Cup", "on": "Cupboard", "size": [0.08, 0.08, 0.1]})
    assert at(physics_simulation, id)[2] == pytest.approx(0.85, abs=0.01)
    client.ask("undo")
    assert id not in physics_simulation.state.ids


def test_dragging_in_a_paused_simulation_shows_a_message(
    physics_simulation: Simulation, page: Viewer, client: PageClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    (session,) = page.channel.sessions
    monkeypatch.setattr(page._handlers, "session_of_view", lambda view: session)
    event: Any = SimpleNamespace(phase="start", client_id=0, start_position=(2.0, 0.0, 0.85))
    page._drag(MUG, event)
    eventually(
        client, "toast", lambda toast: "press Play" in toast["text"] and toast["kind"] == "info", "a message is shown"
    )
    page._with_toast(lambda event: page.views.select(BodyId("Mugg")))(SimpleNamespace(client=event))
    eventually(
        client, "toast", lambda toast: "Mugg" in toast["text"] and toast["kind"] == "error", "the error is shown"
    )


# -- maps --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options", [{}, {"format": "ttl"}, {"dialect": "soma"}, {"format": "ttl", "dialect": "semlog"}]
)
def test_a_saved_map_can_be_loaded_without_loss(
    physics_simulation: Simulation, client: PageClient, options: dict[str, str]
) -> None:
    before = physics_simulation.snapshot()
    saved = client.ask("save", **options)
    assert saved["name"] == ("map.ttl" if "format" in options else "map.owl")
    client.ask("delete", ids=["Fridge", "Mug"])
    loaded = client.ask("load", name=saved["name"], text=saved["text"], discard=True)
    assert (loaded["bodies"], loaded["joints"], loaded["failed"]) == (8, 2, [])
    lost = diff(before, physics_simulation.snapshot())
    assert (lost.only_in_a, lost.only_in_b) == ((), ())
    assert lost.identical(1e-6) or options.get("dialect") == "soma"
    wait_until(lambda: len(names(client)) == 8, "the page is updated")
    assert client.ask("save", **options)["text"], "a loaded map can be saved"
    again = client.ask("load", name=saved["name"], text=saved["text"])
    assert physics_simulation.edits.history.undo[::2] == (f"{again['name']} loaded", "2 bodies deleted")
    client.ask("undo")
    assert client.ask("save", **options)["text"], "and after an undo, with the knowledge base of the first load"
    client.ask("undo")
    assert len(physics_simulation.state.ids) == 6


def test_the_world_is_saved_in_the_other_formats_that_are_offered(
    physics_simulation: Simulation, client: PageClient
) -> None:
    assert client.ask("formats") == [{"name": "glb", "title": "glTF scene"}]
    saved = client.ask("save", format="glb")
    assert saved["name"] == "map.glb"
    assert b64decode(saved["base64"]).startswith(b"glTF")


def test_a_running_simulation_keeps_running_when_a_map_is_loaded(
    physics_simulation: Simulation, client: PageClient
) -> None:
    saved = client.ask("save")
    physics_simulation.play(speed=0.5)
    client.ask("load", name="again.owl", text=saved["text"])
    assert (physics_simulation.state.playing, physics_simulation.state.speed) == (True, 0.5)


CENTIMETERS = """
@prefix : <http://example.org/room.owl#> . @prefix k: <http://knowrob.org/kb/knowrob.owl#> .
:room a k:SemanticEnvironmentMap .
:table a k:Table ; k:describedInMap :room ; k:mobility "static" ;
    k:pose [ a k:Pose ; k:translation "100.0 200.0 40.0" ; k:quaternion "0.0 0.0 0.70710678 0.70710678" ] .
"""


def test_a_page_gives_the_conventions_of_a_map_that_it_loads(
    physics_simulation: Simulation, client: PageClient
) -> None:
    client.ask(
        "load", name="room.ttl", text=CENTIMETERS, conventions={"units": "cm", "frame": "ros", "quaternion": "xyzw"}
    )
    (table,) = physics_simulation.snapshot().bodies
    assert table.pose.position == pytest.approx((1.0, 2.0, 0.4))
    assert table.pose.quaternion == pytest.approx((0.70710678, 0.0, 0.0, 0.70710678))


RDF = '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("kitchen.exe", "MZ"),
        ("kitchen", ""),
        ("kitchen.owl", "this is no XML"),
        ("kitchen.owl", ""),
        ("kitchen.owl", f"{RDF}</rdf:RDF>"),
        ("kitchen.ttl", "<a> <b> ."),
        ("../../etc/passwd", "x"),
        ("kitchen.owl", f'<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>{RDF}&e;</rdf:RDF>'),
        ("robot.urdf.xacro", '<robot name="r"><link name="base"/></robot>'),
    ],
)
def test_invalid_maps_are_refused_and_change_nothing(
    physics_simulation: Simulation, client: PageClient, name: str, text: str
) -> None:
    before, knowledge = physics_simulation.snapshot(), physics_simulation.knowledge
    with pytest.raises(RequestFailedError) as refused:
        client.ask("load", name=name, text=text)
    assert refused.value.code != "Defect", str(refused.value)
    assert "root:" not in str(refused.value)
    assert physics_simulation.snapshot() == before
    assert physics_simulation.knowledge is knowledge


@pytest.mark.parametrize("kind", HOSTILE)
def test_nothing_runs_in_a_description_that_a_page_loads(
    physics_simulation: Simulation, client: PageClient, tmp_path: Path, kind: str
) -> None:
    before = physics_simulation.snapshot()
    with pytest.raises(RequestFailedError, match=r"robot\.urdf: .* is written in xacro") as refused:
        client.ask("load", name="robot.urdf", text=hostile_urdf(kind, tmp_path / "marker"))
    assert refused.value.code == "XacroRefusedError"
    assert "/tmp" not in str(refused.value).replace(str(tmp_path), "")
    assert not (tmp_path / "marker").exists()
    assert physics_simulation.snapshot() == before


def test_a_plain_description_with_a_dollar_is_loaded(physics_simulation: Simulation, client: PageClient) -> None:
    text = "<robot name='r'><link name='base'/><gazebo><plugin>xacro costs ${5}</plugin></gazebo></robot>"
    assert client.ask("load", name="robot.urdf", text=text)["bodies"] == 1


@pytest.mark.parametrize("dialect", ["owl", "ttl"])
@pytest.mark.parametrize("name", [None, "http://x.org/onto.owl", "package://other/owl/other.owl"])
def test_uploaded_maps_that_import_something_are_refused_with_its_name(
    physics_simulation: Simulation, client: PageClient, tmp_path: Any, name: str | None, dialect: str
) -> None:
    before, knowledge = physics_simulation.snapshot(), physics_simulation.knowledge
    if name is None:
        secret = tmp_path / "secret.owl"
        secret.write_text(client.ask("save")["text"].replace("Mug", "Secret"), encoding="utf-8")
        name = secret.as_uri()
    if dialect == "ttl":
        text = f"{client.ask('save', format='ttl')['text']}\n<> <http://www.w3.org/2002/07/owl#imports> <{name}> ."
    else:
        imports = f'<owl:Ontology rdf:about="http://x#"><owl:imports rdf:resource="{name}"/></owl:Ontology></rdf:RDF>'
        text = client.ask("save")["text"].replace("</rdf:RDF>", imports)
    with pytest.raises(RequestFailedError, match=f"ReferenceRefusedError.*imports {re.escape(name)}"):
        client.ask("load", name=f"map.{dialect}", text=text)
    assert physics_simulation.snapshot() == before
    assert physics_simulation.knowledge is knowledge


def test_uploaded_maps_must_not_refer_to_meshes_by_absolute_paths(
    physics_simulation: Simulation, client: PageClient
) -> None:
    before = physics_simulation.snapshot()
    world = _with_mesh(before, "file:///home/somebody/face.stl")
    with pytest.raises(RequestFailedError, match=r"ResourceRefusedError.*is not granted"):
        client.ask("load", name="map.owl", text=write_map(world))
    assert physics_simulation.snapshot() == before
    loaded = client.ask("load", name="map.owl", text=write_map(_with_mesh(before, "package://kitchen/mug.stl")))
    assert loaded["bodies"] == 8


def _with_mesh(world: World, mesh: str) -> World:
    bodies = tuple(replace(body, mesh=mesh) if body.id == "Mug" else body for body in world.bodies)
    return replace(world, bodies=bodies)


# -- the largest speed, and errors -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "arguments", "text"),
    [
        ("play", {"speed": 1e308}, "Expected `float` <= 1000.0 - at `$.speed`"),
        ("play", {"speed": -1.0}, "Expected `float` >= 0.0 - at `$.speed`"),
        ("step", {"duration_s": 1e308}, "Expected `float` <= 3600.0 - at `$.duration_s`"),
        ("step", {"duration_s": -0.1}, "Expected `float` >= 0.0 - at `$.duration_s`"),
    ],
)
def test_a_page_gets_the_range_of_a_refused_number(
    client: PageClient, physics_simulation: Simulation, method: str, arguments: dict[str, float], text: str
) -> None:
    with pytest.raises(RequestFailedError, match=re.escape(text)):
        client.ask(method, **arguments)
    assert (physics_simulation.state.playing, physics_simulation.state.time_s) == (False, 0.0)


def test_a_page_pauses_soon_at_the_largest_speed(client: PageClient, physics_simulation: Simulation) -> None:
    for _ in range(3):
        client.ask("play", speed=1000.0)
        eventually(client, "clock", lambda clock: clock["playing"] and clock["speed"] == 1000.0, "it plays")
        start_s = time.monotonic()
        client.ask("set_material", id="Mug", color="red")
        client.ask("pause")
        assert time.monotonic() - start_s < 3.0
        assert not physics_simulation.state.playing
        eventually(client, "clock", lambda clock: not clock["playing"], "the page is informed")


def test_a_page_shows_which_controller_raised_and_plays_on(client: PageClient, physics_simulation: Simulation) -> None:
    def fail(engine: object, time_s: float) -> None:
        raise KeyError("elbow")

    physics_simulation.add_controller("arm", SimpleNamespace(period_s=0.01, is_active=True, update=fail))
    client.ask("play", speed=1.0)
    text = "the controller 'arm' raised KeyError: 'elbow'"
    eventually(client, "clock", lambda clock: text in clock["fault"] and not clock["playing"], "the error is shown")
    client.ask("move", id="Mug", position=[0.0, -2.0, 0.05], quaternion=LEVEL)
    client.ask("play", speed=1.0)
    eventually(client, "clock", lambda clock: clock["playing"] and not clock["fault"], "it plays on")


def test_the_clock_of_a_page_has_the_expected_time_of_a_rebuild(client: PageClient) -> None:
    client.ask("step", duration_s=0.1)
    eventually(client, "clock", lambda clock: clock["expected_rebuild_s"] == 0.0, "nothing is to be rebuilt")
    client.ask("set_physics", id="Mug", mass_kg=500.0)
    eventually(client, "clock", lambda clock: clock["expected_rebuild_s"] > 0.0, "the time is received")


def test_the_answer_to_an_edit_has_the_expected_time_of_a_rebuild(
    client: PageClient, physics_simulation: Simulation
) -> None:
    assert client.answer("step", duration_s=0.1)["expected_rebuild_s"] == 0.0
    assert client.answer("rename", id="Mug", label="My mug")["expected_rebuild_s"] == 0.0
    answer = client.answer("set_physics", id="Mug", mass_kg=500.0)
    assert answer["expected_rebuild_s"] == round(physics_simulation.state.expected_rebuild_s, 6) > 0.0
    assert client.answer("delete", ids=["Mug"])["expected_rebuild_s"] > 0.0
    assert client.answer("undo")["expected_rebuild_s"] > 0.0
    assert "expected_rebuild_s" not in client.answer("dependents", ids=["Mug"])
