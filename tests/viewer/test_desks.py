"""What pages ask for and are told, with real sockets and physics, and without a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.knowledge import bundled_kitchen, write_map
from mindstage.scene import BodyId, Mobility, Pose, World, diff
from mindstage.viewer import Viewer
from tests.kitchenette import KNOWROB, kitchenette
from tests.viewer.guest import PageClient, RequestFailed, connect_page_client
from tests.viewer.waiting import wait_until

MUG, DRAWER = BodyId("Mug"), BodyId("Drawer")
LEVEL = [1.0, 0.0, 0.0, 0.0]


@pytest.fixture
def alive() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as stage:
        stage.spawn(kitchenette())
        yield stage


@pytest.fixture
def page(alive: Simulation) -> Iterator[Viewer]:
    with Viewer(alive, port=0) as viewport:
        yield viewport


@pytest.fixture
def guest(page: Viewer) -> Iterator[PageClient]:
    with connect_page_client(page.url) as guest:
        wait_until(lambda: guest.latest_value("scene_tree"), "the world is told")
        yield guest


def at(stage: Simulation, id: BodyId) -> np.ndarray:
    return stage.state.poses[stage.state.ids.index(id)]


def names(guest: PageClient) -> set[str]:
    return {row[0] for row in guest.latest_value("scene_tree")["rows"]}


def eventually(guest: PageClient, topic: str, value: Callable[[Any], object], what: str) -> None:
    wait_until(lambda: guest.latest_value(topic) is not None and value(guest.latest[topic]), what)


# -- the world and its time --------------------------------------------------------------------------------------------


def test_a_page_is_told_of_the_world_its_time_and_what_can_be_undone(guest: PageClient) -> None:
    eventually(guest, "clock", lambda clock: clock["bodies"] == 8 and not clock["playing"], "the clock is told")
    eventually(guest, "history", lambda history: history == {"undo": None, "redo": None}, "nothing was edited")
    assert names(guest) == {body.id for body in kitchenette().bodies}
    assert guest.latest_value("scene_tree")["engine"] == "mujoco"


def test_all_are_told_to_look_again_even_where_the_outline_stays_the_same(page: Viewer, guest: PageClient) -> None:
    with connect_page_client(page.url) as other:
        wait_until(lambda: other.latest_value("details_changed"), "the other one is there")
        world, before = other.latest["scene_tree"], other.latest["details_changed"]
        guest.ask("set_physics", id="Mug", mass_kg=1.5)
        eventually(
            other, "details_changed", lambda now: now > before, "the other one is told that something has changed"
        )
        assert other.latest["scene_tree"] == world
        assert other.ask("details", id="Mug")["mass"] == 1.5


def test_time_is_played_paused_stepped_and_reset(alive: Simulation, guest: PageClient) -> None:
    guest.ask("play", speed=2.0)
    eventually(guest, "clock", lambda clock: clock["playing"] and clock["speed"] == 2.0, "time passes twice as fast")
    guest.ask("pause")
    eventually(guest, "clock", lambda clock: not clock["playing"], "time stands still")
    before = alive.state.time_s
    guest.ask("step", duration_s=0.25)
    assert alive.state.time_s == pytest.approx(before + 0.25)
    guest.ask("move", id="Mug", position=[0.0, -2.0, 0.05], quaternion=LEVEL)
    guest.ask("reset")
    assert at(alive, MUG)[:3] == pytest.approx((2.0, 0.0, 0.85))
    eventually(guest, "history", lambda history: history["undo"] == "reset", "even that can be undone")


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
        ("add", {"class": "NoSuchClassAtAll"}),
        ("add", {"class": "Cup", "size": [0.1, 0.1, -1.0]}),
        ("save", {"dialect": "klingon"}),
        ("load", {"name": "x.owl"}),
    ],
)
def test_what_cannot_be_done_is_said_and_changes_nothing(
    alive: Simulation, guest: PageClient, what: str, arguments: dict[str, Any]
) -> None:
    before = alive.snapshot()
    with pytest.raises(RequestFailed) as no:
        guest.ask(what, **arguments)
    assert no.value.type != "Defect", str(no.value)
    assert alive.snapshot() == before


# -- what is selected --------------------------------------------------------------------------------------------------


def test_what_is_selected_is_told_with_its_pose_and_joints_as_they_are(alive: Simulation, guest: PageClient) -> None:
    details = guest.ask("details", id="Drawer")
    assert (details["cls"], details["attached_bodies"]) == ("Drawer", ["DrawerHandle"])
    assert [joint["id"] for joint in details["joints"]] == ["DrawerSlide"]
    assert "ContainerArtifact" in details["ancestors"], "the bundled ontology knows drawers"
    guest.ask("select", id="Drawer")
    eventually(guest, "live_details", lambda live: live["id"] == "Drawer", "where it is is told")
    assert guest.latest["live_details"]["joints"] == {"DrawerSlide": {"x": 0.0}}
    alive.undo_stack.move(DRAWER, Pose((1.75, 0.0, 0.65)))
    eventually(
        guest, "live_details", lambda live: live["joints"] == {"DrawerSlide": {"x": -0.2}}, "and where it is now"
    )
    assert guest.latest["live_details"]["pose"]["position"] == [1.75, 0.0, 0.65]


def test_where_things_are_kept_is_known_of_what_the_ontology_knows() -> None:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, MujocoEngine(), shapes=False, timeout_s=60.0) as stage:
        stage.spawn()
        milk = next(body.id for body in stage.snapshot().bodies if "Milk" in body.cls)
        with Viewer(stage, port=0) as viewport, connect_page_client(viewport.url) as guest:
            eventually(guest, "scene_tree", lambda world: len(world["rows"]) > 200, "the kitchen is told")
            kept = guest.ask("details", id=milk)["storage_places"]
            assert any("fridge" in id for place in kept for id in place["ids"])


# -- edits -------------------------------------------------------------------------------------------------------------


def test_values_are_changed_through_the_engine_and_undone(alive: Simulation, guest: PageClient) -> None:
    before = alive.snapshot()
    guest.ask("set_physics", id="Mug", mass_kg=2.5)
    assert alive.snapshot().body("Mug").physics.mass_kg == 2.5
    eventually(guest, "history", lambda history: history["undo"] == "mass of Mug", "that can be undone")
    guest.ask("set_physics", id="Fridge", mobility="dynamic", gravity=False)
    physics = alive.snapshot().body("Fridge").physics
    assert (physics.mobility, physics.gravity, physics.mass_kg) == (Mobility.DYNAMIC, False, 60.0)
    guest.ask("set_material", id="Mug", name="gold", color="#ffcc00")
    assert [material.name for material in alive.snapshot().body("Mug").materials] == ["gold"]
    guest.ask("set_material", id="Mug")
    assert alive.snapshot().body("Mug").materials == ()
    guest.ask("attach", child="DrawerHandle")
    assert all(hold.child != "DrawerHandle" for hold in alive.snapshot().attachments)
    guest.ask("attach", child="Mug", parent="Drawer")
    assert any(hold.child == "Mug" for hold in alive.snapshot().attachments)
    for _ in range(6):
        guest.ask("undo")
    assert diff(before, alive.snapshot()).identical(1e-9)
    guest.ask("redo")
    assert alive.snapshot().body("Mug").physics.mass_kg == 2.5


def test_two_visitors_see_what_one_of_them_edits(page: Viewer, guest: PageClient) -> None:
    with connect_page_client(page.url) as other:
        wait_until(lambda: other.latest_value("scene_tree"), "the other one sees the world")
        guest.ask("delete", ids=["Mug"])
        wait_until(lambda: "Mug" not in names(other) and "Mug" not in names(guest), "both see that the mug is gone")
        eventually(other, "history", lambda history: history["undo"] == "Mug deleted", "and that it can be undone")
        other.ask("undo")
        wait_until(lambda: "Mug" in names(other) and "Mug" in names(guest), "both see that it is back")


def test_a_slider_opens_a_drawer_in_physics_and_that_can_be_undone(alive: Simulation, guest: PageClient) -> None:
    alive.play()
    for value in (-0.05, -0.1, -0.2):
        guest.ask("move_joint", id="DrawerSlide", axis="x", value=value, done=False)
    guest.ask("move_joint", id="DrawerSlide", axis="x", value=-0.3)
    wait_until(lambda: at(alive, DRAWER)[0] == pytest.approx(1.65, abs=0.02), "the drawer came out by 30 cm")
    wait_until(lambda: not alive._perturbations, "the hand lets go by itself")
    assert at(alive, DRAWER)[1:3] == pytest.approx((0.0, 0.65), abs=1e-3)
    alive.pause()
    guest.ask("undo")
    assert at(alive, DRAWER)[0] == pytest.approx(1.95, abs=1e-3)


def test_a_slider_in_a_paused_world_puts_the_drawer_there_in_one_edit(alive: Simulation, guest: PageClient) -> None:
    for value in (-0.1, -0.2):
        guest.ask("move_joint", id="DrawerSlide", axis="x", value=value, done=False)
    guest.ask("move_joint", id="DrawerSlide", axis="x", value=-0.3)
    assert at(alive, DRAWER)[0] == pytest.approx(1.65)
    assert alive.undo_stack.history.undo == ("pose of Drawer",)
    guest.ask("undo")
    assert at(alive, DRAWER)[0] == pytest.approx(1.95)


def test_a_visitor_who_leaves_lets_go_of_the_slider(alive: Simulation, page: Viewer) -> None:
    alive.play()
    with connect_page_client(page.url) as guest:
        wait_until(lambda: guest.latest_value("scene_tree"), "the world is told")
        guest.ask("move_joint", id="DrawerSlide", axis="x", value=-0.3, done=False)
        assert alive._perturbations
    wait_until(lambda: not alive._perturbations, "nothing is held any more")


def test_a_class_is_found_by_a_part_of_its_name_and_what_is_meant_most_likely_comes_first(guest: PageClient) -> None:
    found = [each["name"] for each in guest.ask("find_classes", text="cup")]
    assert found[0] == "Cup"
    assert all("cup" in name.lower() for name in found)
    assert "DinnerPlate" in {each["name"] for each in guest.ask("find_classes", text="plate")}
    assert guest.ask("find_classes", text="no class is called so") == []
    assert len(guest.ask("find_classes")) > 20


def test_a_new_thing_is_dropped_in_and_taken_away_again(alive: Simulation, guest: PageClient) -> None:
    id = guest.ask("add", **{"class": f"{KNOWROB}Cup", "at": [0.5, -1.0, 0.0], "size": [0.08, 0.08, 0.1]})
    cup = alive.snapshot().body(id)
    assert (cup.size, cup.physics.mobility) == ((0.08, 0.08, 0.1), Mobility.DYNAMIC)
    assert cup.pose.position == pytest.approx((0.5, -1.0, 0.052))
    assert guest.ask("details", id=id)["cls"] == "Cup", "what has just come is described at once"
    wait_until(lambda: id in names(guest), "the page sees it")
    guest.ask("undo")
    assert id not in alive.state.ids
    guest.ask("redo")
    assert id in alive.state.ids


def test_a_new_thing_is_put_on_what_is_named(alive: Simulation, guest: PageClient) -> None:
    id = guest.ask("add", **{"class": "Cup", "on": "Cupboard", "size": [0.08, 0.08, 0.1]})
    assert at(alive, id)[2] == pytest.approx(0.85, abs=0.01)
    guest.ask("undo")
    assert id not in alive.state.ids


def test_pulling_in_a_paused_world_says_why_nothing_moves(
    alive: Simulation, page: Viewer, guest: PageClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    (visitor,) = page.channel.sessions
    monkeypatch.setattr(page._handlers, "visitor", lambda view: visitor)
    event: Any = SimpleNamespace(phase="start", client_id=0, start_position=(2.0, 0.0, 0.85))
    page._drag(MUG, event)
    eventually(guest, "toast", lambda toast: "press Play" in toast["text"] and toast["kind"] == "info", "it says why")
    page._with_toast(lambda event: page.views.select(BodyId("Mugg")))(SimpleNamespace(client=event))
    eventually(
        guest, "toast", lambda toast: "Mugg" in toast["text"] and toast["kind"] == "error", "and what is not there"
    )


# -- maps --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "way", [{}, {"format": "turtle"}, {"dialect": "soma"}, {"format": "turtle", "dialect": "semlog"}]
)
def test_a_saved_map_is_loaded_again_and_nothing_is_lost(
    alive: Simulation, guest: PageClient, way: dict[str, str]
) -> None:
    before = alive.snapshot()
    saved = guest.ask("save", **way)
    assert saved["name"] == ("map.ttl" if "format" in way else "map.owl")
    guest.ask("delete", ids=["Fridge", "Mug"])
    told = guest.ask("load", name=saved["name"], text=saved["text"])
    assert (told["bodies"], told["joints"], told["failed"]) == (8, 2, [])
    lost = diff(before, alive.snapshot())
    assert (lost.only_in_a, lost.only_in_b) == ((), ())
    assert lost.identical(1e-6) or way.get("dialect") == "soma"
    wait_until(lambda: len(names(guest)) == 8, "the page sees it")
    assert alive.undo_stack.history.undo == ()
    assert guest.ask("save", **way)["text"], "what was loaded can be saved again"


def test_a_world_that_plays_goes_on_playing_when_a_map_comes(alive: Simulation, guest: PageClient) -> None:
    saved = guest.ask("save")
    alive.play(speed=0.5)
    guest.ask("load", name="again.owl", text=saved["text"])
    assert (alive.state.playing, alive.state.speed) == (True, 0.5)


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
        (
            "robot.urdf",
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="/etc/passwd"/></robot>',
        ),
    ],
)
def test_what_is_no_map_is_refused_and_changes_nothing(
    alive: Simulation, guest: PageClient, name: str, text: str
) -> None:
    before, knowledge = alive.snapshot(), alive.knowledge
    with pytest.raises(RequestFailed) as no:
        guest.ask("load", name=name, text=text)
    assert no.value.type != "Defect", str(no.value)
    assert "root:" not in str(no.value)
    assert alive.snapshot() == before
    assert alive.knowledge is knowledge


def test_a_map_of_a_stranger_imports_no_file(alive: Simulation, guest: PageClient, tmp_path: Any) -> None:
    secret = tmp_path / "secret.owl"
    text = guest.ask("save")["text"]
    secret.write_text(text.replace("Mug", "Secret"), encoding="utf-8")
    imports = (
        f'<owl:Ontology rdf:about="http://x#"><owl:imports rdf:resource="{secret.as_uri()}"/></owl:Ontology></rdf:RDF>'
    )
    guest.ask("load", name="map.owl", text=text.replace("</rdf:RDF>", imports))
    assert secret not in alive.knowledge.sources()
    assert "Secret" not in alive.state.ids


def test_a_map_of_a_stranger_names_no_mesh_by_its_place_on_a_disk(alive: Simulation, guest: PageClient) -> None:
    before = alive.snapshot()
    world = _with_mesh(before, "file:///home/somebody/face.stl")
    with pytest.raises(RequestFailed, match=r"ArgumentRefused.*mesh of 'Mug'"):
        guest.ask("load", name="map.owl", text=write_map(world))
    assert alive.snapshot() == before
    told = guest.ask("load", name="map.owl", text=write_map(_with_mesh(before, "package://kitchen/mug.stl")))
    assert told["bodies"] == 8


def _with_mesh(world: World, mesh: str) -> World:
    bodies = tuple(replace(body, mesh=mesh) if body.id == "Mug" else body for body in world.bodies)
    return replace(world, bodies=bodies)
