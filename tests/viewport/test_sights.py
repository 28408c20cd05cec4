"""What each visitor sees for himself: visitors and their browsers are played by lists."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.errors import BodyUnknown
from mindstage.viewport import sight as sight_module
from mindstage.viewport.framing import View, first_outlook
from mindstage.viewport.looks import decide_looks
from mindstage.viewport.sights import GizmoMode, Labels, Sights
from mindstage.world import BodyId, Pose, World
from mindstage.world.geometry import pose_array
from tests.kitchenette import kitchenette
from tests.viewport.playing import Client, Server

KNOWLEDGE = KnowledgeBase()
WORLD = kitchenette()
IDS = tuple(body.id for body in WORLD.bodies)
POSES = pose_array(body.pose for body in WORLD.bodies)
MUG, DRAWER = BodyId("Mug"), BodyId("Drawer")
AFAR = View((9.0, 9.0, 9.0), (0.0, 0.0, 0.0), 0.5)


class Place:
    """Remembers who put what where."""

    def __init__(self) -> None:
        self.puts: list[tuple[int, BodyId, Pose]] = []

    def __call__(self, visitor: int, id: BodyId, pose: Pose) -> None:
        self.puts.append((visitor, id, pose))


@pytest.fixture
def server() -> Server:
    return Server()


@pytest.fixture
def place() -> Place:
    return Place()


@pytest.fixture
def sights(server: Server, place: Place) -> Sights:
    sights = Sights(server, place=place)  # type: ignore[arg-type]
    know(sights, WORLD)
    return sights


@pytest.fixture
def ann(server: Server, sights: Sights) -> Client:
    return come(server, sights, Client(1))


def come(server: Server, sights: Sights, client: Client) -> Client:
    server.welcome(client)
    sights.turn()
    return client


def know(sights: Sights, world: World) -> None:
    looks = decide_looks(world, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
    names = {body.id: body.cls.split("#")[-1] for body in world.bodies}
    sights.know(looks, names, tuple(body.id for body in world.bodies), pose_array(body.pose for body in world.bodies))


def labels(client: Client) -> set[str]:
    return {name.removeprefix("/labels/") for name in client.scene.nodes if name.startswith("/labels/")}


def state(client: Client, name: str) -> dict[str, Any]:
    return vars(client.scene.nodes[name])


# -- who selects what --------------------------------------------------------------------------------------------------


def test_each_visitor_selects_for_himself(server: Server, sights: Sights, ann: Client) -> None:
    bob = come(server, sights, Client(2))
    sights.select(MUG, visitor=1)
    sights.turn()
    assert (sights.selected(1), sights.selected(2), sights.selected(3)) == (MUG, None, None)
    assert "/selected" in ann.scene.nodes
    assert "/selected" not in bob.scene.nodes
    assert server.scene.told == [], "nothing of it is sent to all"


def test_nothing_happens_before_the_drawing_threads_turn(sights: Sights, ann: Client) -> None:
    sights.select(MUG)
    assert sights.selected(1) is None
    sights.turn()
    assert sights.selected(1) == MUG


def test_what_is_selected_for_all_is_selected_for_who_comes_later(server: Server, sights: Sights) -> None:
    sights.select(MUG)
    sights.turn()
    ann = come(server, sights, Client(1))
    assert sights.selected(1) == MUG
    assert "/selected" in ann.scene.nodes


def test_a_selection_that_changes_is_told_once(sights: Sights, ann: Client) -> None:
    heard: list[int] = []
    sights.on_change(heard.append)
    for _ in range(2):
        sights.select(MUG, visitor=1)
    sights.turn()
    assert heard == [1]
    know(sights, replace(WORLD, bodies=tuple(body for body in WORLD.bodies if body.id != MUG)))
    assert heard == [1, 1]
    assert sights.selected(1) is None
    assert "/selected" not in ann.scene.nodes


def test_who_cannot_be_told_keeps_nobody_from_being_told(
    sights: Sights, ann: Client, caplog: pytest.LogCaptureFixture
) -> None:
    heard: list[int] = []

    def break_down(visitor: int) -> None:
        raise KeyError(visitor)

    sights.on_change(break_down)
    sights.on_change(heard.append)
    sights.select(MUG)
    sights.turn()
    assert heard == [1]
    assert "nobody could be told" in caplog.text


def test_what_is_not_there_is_refused_at_once(sights: Sights) -> None:
    for ask in (
        lambda: sights.select(BodyId("Mugg")),
        lambda: sights.focus([MUG, BodyId("Mugg")]),
        lambda: sights.ghost(BodyId("Mugg"), None),
        lambda: sights.show_bodies([BodyId("Mugg")], False),
    ):
        with pytest.raises(BodyUnknown, match="near: 'Mug'"):
            ask()


def test_a_tab_that_was_closed_is_asked_for_nothing(server: Server, sights: Sights, ann: Client) -> None:
    server.see_off(ann)
    sights.select(MUG, visitor=1)
    sights.home(visitor=1)
    sights.turn()
    assert sights.visitors == ()


# -- marks -------------------------------------------------------------------------------------------------------------


def test_the_frame_and_the_label_go_with_the_body(sights: Sights, ann: Client) -> None:
    sights.select(MUG)
    sights.label(Labels.SELECTED)
    sights.turn()
    assert state(ann, "/selected")["position"] == pytest.approx([2.0, 0.0, 0.85])
    poses = POSES.copy()
    poses[IDS.index(MUG), :3] = 1.0, 2.0, 3.0
    sights.follow(poses)
    assert state(ann, "/selected")["position"] == pytest.approx([1.0, 2.0, 3.0])
    assert state(ann, "/labels/Mug")["position"] == pytest.approx([1.0, 2.0, 3.07])


def test_labels_are_those_that_were_asked_for(sights: Sights, ann: Client) -> None:
    def written(mode: Labels) -> set[str]:
        sights.label(mode)
        sights.turn()
        return labels(ann)

    assert written(Labels.ALL) == set(IDS)
    assert written(Labels.CLASS) == set()
    sights.select(BodyId("DrawerHandle"))
    assert written(Labels.CLASS) == {"DrawerHandle", "FridgeHandle"}
    assert written(Labels.SELECTED) == {"DrawerHandle"}
    assert written(Labels.NONE) == set()


def test_labels_of_thousands_are_those_of_the_largest(sights: Sights, ann: Client) -> None:
    mug = WORLD.body("Mug")
    crowd = [replace(mug, id=BodyId(f"Mug{n}")) for n in range(400)]
    know(sights, replace(WORLD, bodies=(*crowd, *WORLD.bodies)))
    sights.label(Labels.ALL)
    sights.turn()
    assert len(labels(ann)) == 300
    assert {"Floor", "Fridge", "Cupboard"} <= labels(ann)


def test_a_ghost_comes_moves_and_goes(sights: Sights, ann: Client) -> None:
    sights.ghost(MUG, Pose((1.0, 0.0, 0.0)))
    sights.turn()
    sights.ghost(MUG, Pose((2.0, 0.0, 0.0)))
    with ann.scene.listening() as heard:
        sights.turn()
    assert "add" not in [what for _, what in heard]
    assert state(ann, "/ghosts/Mug")["position"] == pytest.approx([2.0, 0.0, 0.0])
    assert 0.0 < state(ann, "/ghosts/Mug")["opacity"] < 0.6
    sights.ghost(MUG, None)
    sights.turn()
    assert "/ghosts/Mug" not in ann.scene.nodes


def test_a_gizmo_shows_a_ghost_and_puts_the_body_where_it_is_let_go(sights: Sights, ann: Client, place: Place) -> None:
    sights.select(MUG)
    sights.gizmo(GizmoMode.MOVE)
    sights.turn()
    handles = ann.scene.nodes["/gizmo"]
    assert (vars(handles)["disable_rotations"], vars(handles)["disable_axes"]) == (True, False)

    def drag(phase: str, *place: float) -> None:
        vars(handles).update(position=np.array(place), wxyz=np.array([1.0, 0.0, 0.0, 0.0]))
        vars(handles)["update"](SimpleNamespace(phase=phase, target=handles))
        sights.turn()

    drag("start", 2.0, 0.0, 0.85)
    drag("update", 2.0, 0.0, 1.5)
    assert state(ann, "/ghosts/Mug")["position"] == pytest.approx([2.0, 0.0, 1.5])
    sights.follow(POSES)
    assert vars(handles)["position"] == pytest.approx([2.0, 0.0, 1.5]), "whoever drags is not disturbed"
    assert place.puts == []
    drag("end", 2.0, 0.0, 1.5)
    assert place.puts == [(1, MUG, Pose((2.0, 0.0, 1.5)))]
    assert "/ghosts/Mug" not in ann.scene.nodes


def test_the_gizmo_goes_to_what_is_selected(sights: Sights, ann: Client) -> None:
    sights.gizmo(GizmoMode.TURN)
    sights.turn()
    assert "/gizmo" not in ann.scene.nodes
    sights.select(DRAWER)
    sights.turn()
    assert state(ann, "/gizmo")["position"] == pytest.approx([1.95, 0.0, 0.65])
    assert state(ann, "/gizmo")["disable_rotations"] is False
    sights.gizmo(None)
    sights.turn()
    assert "/gizmo" not in ann.scene.nodes


def test_what_is_hidden_is_hidden_for_all_until_it_is_gone(sights: Sights) -> None:
    sights.show_bodies([MUG, DRAWER], False)
    sights.show_bodies([DRAWER], True)
    assert sights.hidden == {MUG}
    know(sights, replace(WORLD, bodies=tuple(body for body in WORLD.bodies if body.id != MUG)))
    assert sights.hidden == set()


# -- the camera --------------------------------------------------------------------------------------------------------


def eye(client: Client) -> np.ndarray:
    return np.array(vars(client.camera)["position"])


def land(sights: Sights, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the time of a flight pass."""
    now = time.monotonic()
    monkeypatch.setattr(sight_module.time, "monotonic", lambda: now + 60.0)
    sights.turn()
    monkeypatch.undo()


def test_visitors_stand_where_all_is_seen_in_windows_of_their_shape(server: Server, sights: Sights) -> None:
    outlook = first_outlook(WORLD, decide_looks(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors))
    sights.open_on(outlook)
    phone, desk = (come(server, sights, Client(n, aspect=aspect)) for n, aspect in enumerate([0.5, 1.6]))
    assert eye(phone) == pytest.approx(outlook.view(0.5).position)
    assert eye(desk) == pytest.approx(outlook.view(1.6).position)


def test_a_camera_flies_there(sights: Sights, ann: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    sights.look_from(AFAR)
    sights.turn()
    sights.focus([MUG], visitor=1)
    sights.turn()
    assert np.linalg.norm(eye(ann) - AFAR.position) < 2.0, "it has only set off"
    land(sights, monkeypatch)
    assert vars(ann.camera)["look_at"] == pytest.approx([2.0, 0.0, 0.85], abs=0.05)
    assert 0.3 < np.linalg.norm(eye(ann) - (2.0, 0.0, 0.85)) < 2.0


def test_one_flies_home_and_above_it_all(sights: Sights, ann: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    outlook = first_outlook(WORLD, decide_looks(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors))
    sights.open_on(outlook)
    for ask, view in (
        (sights.top, outlook.top(1.5)),
        (sights.home, outlook.view(1.5)),
        (sights.focus, outlook.view(1.5)),
    ):
        sights.look_from(AFAR)
        ask()
        sights.turn()
        land(sights, monkeypatch)
        assert eye(ann) == pytest.approx(view.position)


def test_a_section_is_a_place_that_the_page_looks_at(sights: Sights, ann: Client) -> None:
    sights.section(1.2, visitor=1)
    sights.turn()
    assert state(ann, "/clipping_plane")["position"] == (0.0, 0.0, 1.2)
    sights.section(None, visitor=1)
    sights.turn()
    assert "/clipping_plane" not in ann.scene.nodes
