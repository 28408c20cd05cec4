"""What each visitor sees for himself: visitors and their browsers are played by lists."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.errors import BodyNotFoundError
from mindstage.scene import BodyId, Pose, World
from mindstage.scene.transforms import pose_array
from mindstage.viewer import camera as sight_module
from mindstage.viewer.appearance import compute_appearance
from mindstage.viewer.camera import CameraPose, ClientViews, GizmoMode, LabelMode, initial_target
from tests.kitchenette import kitchenette
from tests.viewer.playing import FakeClient, FakeServer

KNOWLEDGE = KnowledgeBase()
WORLD = kitchenette()
IDS = tuple(body.id for body in WORLD.bodies)
POSES = pose_array(body.pose for body in WORLD.bodies)
MUG, DRAWER = BodyId("Mug"), BodyId("Drawer")
AFAR = CameraPose((9.0, 9.0, 9.0), (0.0, 0.0, 0.0), 0.5)


class Place:
    """Remembers who put what where."""

    def __init__(self) -> None:
        self.puts: list[tuple[int, BodyId, Pose]] = []

    def __call__(self, visitor: int, id: BodyId, pose: Pose) -> None:
        self.puts.append((visitor, id, pose))


@pytest.fixture
def server() -> FakeServer:
    return FakeServer()


@pytest.fixture
def place() -> Place:
    return Place()


@pytest.fixture
def sights(server: FakeServer, place: Place) -> ClientViews:
    sights = ClientViews(server, on_place=place)  # type: ignore[arg-type]
    know(sights, WORLD)
    return sights


@pytest.fixture
def ann(server: FakeServer, sights: ClientViews) -> FakeClient:
    return come(server, sights, FakeClient(1))


def come(server: FakeServer, sights: ClientViews, client: FakeClient) -> FakeClient:
    server.connect(client)
    sights.process_queue()
    return client


def know(sights: ClientViews, world: World) -> None:
    looks = compute_appearance(world, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
    names = {body.id: body.cls.split("#")[-1] for body in world.bodies}
    sights.set_bodies(
        looks, names, tuple(body.id for body in world.bodies), pose_array(body.pose for body in world.bodies)
    )


def labels(client: FakeClient) -> set[str]:
    return {name.removeprefix("/labels/") for name in client.scene.nodes if name.startswith("/labels/")}


def state(client: FakeClient, name: str) -> dict[str, Any]:
    return vars(client.scene.nodes[name])


# -- who selects what --------------------------------------------------------------------------------------------------


def test_each_visitor_selects_for_himself(server: FakeServer, sights: ClientViews, ann: FakeClient) -> None:
    bob = come(server, sights, FakeClient(2))
    sights.select(MUG, client=1)
    sights.process_queue()
    assert (sights.selected(1), sights.selected(2), sights.selected(3)) == (MUG, None, None)
    assert "/selected" in ann.scene.nodes
    assert "/selected" not in bob.scene.nodes
    assert server.scene.messages == [], "nothing of it is sent to all"


def test_nothing_happens_before_the_drawing_threads_turn(sights: ClientViews, ann: FakeClient) -> None:
    sights.select(MUG)
    assert sights.selected(1) is None
    sights.process_queue()
    assert sights.selected(1) == MUG


def test_what_is_selected_for_all_is_selected_for_who_comes_later(server: FakeServer, sights: ClientViews) -> None:
    sights.select(MUG)
    sights.process_queue()
    ann = come(server, sights, FakeClient(1))
    assert sights.selected(1) == MUG
    assert "/selected" in ann.scene.nodes


def test_a_selection_that_changes_is_told_once(sights: ClientViews, ann: FakeClient) -> None:
    heard: list[int] = []
    sights.on_change(heard.append)
    for _ in range(2):
        sights.select(MUG, client=1)
    sights.process_queue()
    assert heard == [1]
    know(sights, replace(WORLD, bodies=tuple(body for body in WORLD.bodies if body.id != MUG)))
    assert heard == [1, 1]
    assert sights.selected(1) is None
    assert "/selected" not in ann.scene.nodes


def test_who_cannot_be_told_keeps_nobody_from_being_told(
    sights: ClientViews, ann: FakeClient, caplog: pytest.LogCaptureFixture
) -> None:
    heard: list[int] = []

    def break_down(visitor: int) -> None:
        raise KeyError(visitor)

    sights.on_change(break_down)
    sights.on_change(heard.append)
    sights.select(MUG)
    sights.process_queue()
    assert heard == [1]
    assert "nobody could be told" in caplog.text


def test_what_is_not_there_is_refused_at_once(sights: ClientViews) -> None:
    for ask in (
        lambda: sights.select(BodyId("Mugg")),
        lambda: sights.focus([MUG, BodyId("Mugg")]),
        lambda: sights.show_preview(BodyId("Mugg"), None),
        lambda: sights.show_bodies([BodyId("Mugg")], False),
    ):
        with pytest.raises(BodyNotFoundError, match="near: 'Mug'"):
            ask()


def test_a_tab_that_was_closed_is_asked_for_nothing(server: FakeServer, sights: ClientViews, ann: FakeClient) -> None:
    server.disconnect(ann)
    sights.select(MUG, client=1)
    sights.go_home(client=1)
    sights.process_queue()
    assert sights.clients == ()


# -- marks -------------------------------------------------------------------------------------------------------------


def test_the_frame_and_the_label_go_with_the_body(sights: ClientViews, ann: FakeClient) -> None:
    sights.select(MUG)
    sights.set_labels(LabelMode.SELECTED)
    sights.process_queue()
    assert state(ann, "/selected")["position"] == pytest.approx([2.0, 0.0, 0.85])
    poses = POSES.copy()
    poses[IDS.index(MUG), :3] = 1.0, 2.0, 3.0
    sights.update_poses(poses)
    assert state(ann, "/selected")["position"] == pytest.approx([1.0, 2.0, 3.0])
    assert state(ann, "/labels/Mug")["position"] == pytest.approx([1.0, 2.0, 3.07])


def test_labels_are_those_that_were_asked_for(sights: ClientViews, ann: FakeClient) -> None:
    def written(mode: LabelMode) -> set[str]:
        sights.set_labels(mode)
        sights.process_queue()
        return labels(ann)

    assert written(LabelMode.ALL) == set(IDS)
    assert written(LabelMode.CLASS) == set()
    sights.select(BodyId("DrawerHandle"))
    assert written(LabelMode.CLASS) == {"DrawerHandle", "FridgeHandle"}
    assert written(LabelMode.SELECTED) == {"DrawerHandle"}
    assert written(LabelMode.NONE) == set()


def test_labels_of_thousands_are_those_of_the_largest(sights: ClientViews, ann: FakeClient) -> None:
    mug = WORLD.body("Mug")
    crowd = [replace(mug, id=BodyId(f"Mug{n}")) for n in range(400)]
    know(sights, replace(WORLD, bodies=(*crowd, *WORLD.bodies)))
    sights.set_labels(LabelMode.ALL)
    sights.process_queue()
    assert len(labels(ann)) == 300
    assert {"Floor", "Fridge", "Cupboard"} <= labels(ann)


def test_a_ghost_comes_moves_and_goes(sights: ClientViews, ann: FakeClient) -> None:
    sights.show_preview(MUG, Pose((1.0, 0.0, 0.0)))
    sights.process_queue()
    sights.show_preview(MUG, Pose((2.0, 0.0, 0.0)))
    with ann.scene.recording() as heard:
        sights.process_queue()
    assert "add" not in [what for _, what in heard]
    assert state(ann, "/ghosts/Mug")["position"] == pytest.approx([2.0, 0.0, 0.0])
    assert 0.0 < state(ann, "/ghosts/Mug")["opacity"] < 0.6
    sights.show_preview(MUG, None)
    sights.process_queue()
    assert "/ghosts/Mug" not in ann.scene.nodes


def test_a_gizmo_shows_a_ghost_and_puts_the_body_where_it_is_let_go(
    sights: ClientViews, ann: FakeClient, place: Place
) -> None:
    sights.select(MUG)
    sights.set_gizmo(GizmoMode.MOVE)
    sights.process_queue()
    handles = ann.scene.nodes["/gizmo"]
    assert (vars(handles)["disable_rotations"], vars(handles)["disable_axes"]) == (True, False)

    def drag(phase: str, *place: float) -> None:
        vars(handles).update(position=np.array(place), wxyz=np.array([1.0, 0.0, 0.0, 0.0]))
        vars(handles)["update"](SimpleNamespace(phase=phase, target=handles))
        sights.process_queue()

    drag("start", 2.0, 0.0, 0.85)
    drag("update", 2.0, 0.0, 1.5)
    assert state(ann, "/ghosts/Mug")["position"] == pytest.approx([2.0, 0.0, 1.5])
    sights.update_poses(POSES)
    assert vars(handles)["position"] == pytest.approx([2.0, 0.0, 1.5]), "whoever drags is not disturbed"
    assert place.puts == []
    drag("end", 2.0, 0.0, 1.5)
    assert place.puts == [(1, MUG, Pose((2.0, 0.0, 1.5)))]
    assert "/ghosts/Mug" not in ann.scene.nodes


def test_the_gizmo_goes_to_what_is_selected(sights: ClientViews, ann: FakeClient) -> None:
    sights.set_gizmo(GizmoMode.TURN)
    sights.process_queue()
    assert "/gizmo" not in ann.scene.nodes
    sights.select(DRAWER)
    sights.process_queue()
    assert state(ann, "/gizmo")["position"] == pytest.approx([1.95, 0.0, 0.65])
    assert state(ann, "/gizmo")["disable_rotations"] is False
    sights.set_gizmo(None)
    sights.process_queue()
    assert "/gizmo" not in ann.scene.nodes


def test_what_is_hidden_is_hidden_for_all_until_it_is_gone(sights: ClientViews) -> None:
    sights.show_bodies([MUG, DRAWER], False)
    sights.show_bodies([DRAWER], True)
    assert sights.hidden == {MUG}
    know(sights, replace(WORLD, bodies=tuple(body for body in WORLD.bodies if body.id != MUG)))
    assert sights.hidden == set()


# -- the camera --------------------------------------------------------------------------------------------------------


def eye(client: FakeClient) -> np.ndarray:
    return np.array(vars(client.camera)["position"])


def land(sights: ClientViews, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the time of a flight pass."""
    now = time.monotonic()
    monkeypatch.setattr(sight_module.time, "monotonic", lambda: now + 60.0)
    sights.process_queue()
    monkeypatch.undo()


def test_visitors_stand_where_all_is_seen_in_windows_of_their_shape(server: FakeServer, sights: ClientViews) -> None:
    outlook = initial_target(WORLD, compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors))
    sights.set_target(outlook)
    phone, desk = (come(server, sights, FakeClient(n, aspect=aspect)) for n, aspect in enumerate([0.5, 1.6]))
    assert eye(phone) == pytest.approx(outlook.camera(0.5).position)
    assert eye(desk) == pytest.approx(outlook.camera(1.6).position)


def test_a_camera_flies_there(sights: ClientViews, ann: FakeClient, monkeypatch: pytest.MonkeyPatch) -> None:
    sights.set_camera(AFAR)
    sights.process_queue()
    sights.focus([MUG], client=1)
    sights.process_queue()
    assert np.linalg.norm(eye(ann) - AFAR.position) < 2.0, "it has only set off"
    land(sights, monkeypatch)
    assert vars(ann.camera)["look_at"] == pytest.approx([2.0, 0.0, 0.85], abs=0.05)
    assert 0.3 < np.linalg.norm(eye(ann) - (2.0, 0.0, 0.85)) < 2.0


def test_one_flies_home_and_above_it_all(sights: ClientViews, ann: FakeClient, monkeypatch: pytest.MonkeyPatch) -> None:
    outlook = initial_target(WORLD, compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors))
    sights.set_target(outlook)
    for ask, view in (
        (sights.go_top, outlook.top_camera(1.5)),
        (sights.go_home, outlook.camera(1.5)),
        (sights.focus, outlook.camera(1.5)),
    ):
        sights.set_camera(AFAR)
        ask()
        sights.process_queue()
        land(sights, monkeypatch)
        assert eye(ann) == pytest.approx(view.position)


def test_a_section_is_a_place_that_the_page_looks_at(sights: ClientViews, ann: FakeClient) -> None:
    sights.set_clip_height(1.2, client=1)
    sights.process_queue()
    assert state(ann, "/clipping_plane")["position"] == (0.0, 0.0, 1.2)
    sights.set_clip_height(None, client=1)
    sights.process_queue()
    assert "/clipping_plane" not in ann.scene.nodes
