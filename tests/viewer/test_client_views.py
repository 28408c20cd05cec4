"""The views of clients, with a fake server that records messages."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.errors import BodyNotFoundError
from mindstage.rendering.appearance import compute_appearance
from mindstage.rendering.camera import CameraPose, initial_target
from mindstage.rendering.screenshot import LabelMode
from mindstage.scene import Body, BodyId, Iri, Pose, Vector, World
from mindstage.scene.transforms import pose_array
from mindstage.viewer import client_views as camera_module
from mindstage.viewer.client_views import ClientViews, Ghost, GizmoMode, MountCulling, Snapping, aspect_ratio
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.viewer.fake_server import FakeClient, FakeServer

KNOWLEDGE = KnowledgeBase()
WORLD = kitchenette()
IDS = tuple(body.id for body in WORLD.bodies)
POSES = pose_array(body.pose for body in WORLD.bodies)
MUG, DRAWER = BodyId("Mug"), BodyId("Drawer")
AFAR = CameraPose((9.0, 9.0, 9.0), (0.0, 0.0, 0.0), 0.5)


class RecordedMoves:
    """Records the bodies that clients have moved."""

    def __init__(self) -> None:
        self.moves: list[tuple[int, BodyId, Pose]] = []

    def __call__(self, client: int, id: BodyId, pose: Pose, *, to_surface: bool) -> None:
        assert not to_surface
        self.moves.append((client, id, pose))


@pytest.fixture
def server() -> FakeServer:
    return FakeServer()


@pytest.fixture
def on_place() -> RecordedMoves:
    return RecordedMoves()


@pytest.fixture
def views(server: FakeServer, on_place: RecordedMoves) -> ClientViews:
    views = ClientViews(server, on_place=on_place)  # type: ignore[arg-type]
    set_world(views, WORLD)
    return views


@pytest.fixture
def ann(server: FakeServer, views: ClientViews) -> FakeClient:
    return connect(server, views, FakeClient(1))


def connect(server: FakeServer, views: ClientViews, client: FakeClient) -> FakeClient:
    server.connect(client)
    views.process_queue()
    return client


def set_world(views: ClientViews, world: World, *, is_culling: bool = False) -> None:
    appearances = compute_appearance(world, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
    names = {body.id: body.cls.split("#")[-1] for body in world.bodies}
    ids = tuple(body.id for body in world.bodies)
    culling = MountCulling(world, appearances, ids) if is_culling else None
    views.set_bodies(appearances, names, ids, pose_array(body.pose for body in world.bodies), culling=culling)


def labels(client: FakeClient) -> set[str]:
    return set(client.scene.data.get("labels", {"ids": ()})["ids"])


def state(client: FakeClient, name: str) -> dict[str, Any]:
    return vars(client.scene.nodes[name])


# -- selection ---------------------------------------------------------------------------------------------------------


def test_each_client_has_its_own_selection(server: FakeServer, views: ClientViews, ann: FakeClient) -> None:
    bob = connect(server, views, FakeClient(2))
    views.select(MUG, client=1)
    views.process_queue()
    assert (views.selected(1), views.selected(2), views.selected(3)) == (MUG, None, None)
    assert "/selected" in ann.scene.nodes
    assert "/selected" not in bob.scene.nodes
    assert server.scene.messages == [], "nothing is sent to all clients"


def test_actions_wait_for_the_drawing_thread(views: ClientViews, ann: FakeClient) -> None:
    views.select(MUG)
    assert views.selected(1) is None
    views.process_queue()
    assert views.selected(1) == MUG


def test_a_selection_for_all_applies_to_later_clients(server: FakeServer, views: ClientViews) -> None:
    views.select(MUG)
    views.process_queue()
    ann = connect(server, views, FakeClient(1))
    assert views.selected(1) == MUG
    assert "/selected" in ann.scene.nodes


def test_a_changed_selection_is_notified_once(views: ClientViews, ann: FakeClient) -> None:
    notified: list[int] = []
    views.on_change(notified.append)
    for _ in range(2):
        views.select(MUG, client=1)
    views.process_queue()
    assert notified == [1]
    set_world(views, replace(WORLD, bodies=tuple(body for body in WORLD.bodies if body.id != MUG)))
    assert notified == [1, 1]
    assert views.selected(1) is None
    assert "/selected" not in ann.scene.nodes


def test_a_failing_callback_does_not_affect_others(
    views: ClientViews, ann: FakeClient, caplog: pytest.LogCaptureFixture
) -> None:
    notified: list[int] = []

    def fail(client: int) -> None:
        raise KeyError(client)

    views.on_change(fail)
    views.on_change(notified.append)
    views.select(MUG)
    views.process_queue()
    assert notified == [1]
    assert "a selection callback failed" in caplog.text


def test_unknown_bodies_are_refused_at_once(views: ClientViews) -> None:
    for request in (
        lambda: views.select(BodyId("Mugg")),
        lambda: views.focus([MUG, BodyId("Mugg")]),
        lambda: views.show_preview(BodyId("Mugg"), None),
        lambda: views.show_bodies([BodyId("Mugg")], False),
    ):
        with pytest.raises(BodyNotFoundError, match="near: 'Mug'"):
            request()


def test_requests_for_disconnected_clients_are_ignored(server: FakeServer, views: ClientViews, ann: FakeClient) -> None:
    server.disconnect(ann)
    views.select(MUG, client=1)
    views.go_home(client=1)
    views.process_queue()
    assert views.clients == ()


def test_clients_differ_in_what_each_has_set_and_share_what_was_set_for_all(
    server: FakeServer, views: ClientViews, ann: FakeClient
) -> None:
    bob = connect(server, views, FakeClient(2))
    views.set_labels(LabelMode.ALL)
    views.set_labels(LabelMode.NONE, client=1)
    views.set_clip_height(1.5)
    views.set_clip_height(None, client=2)
    views.set_camera(AFAR, client=2)
    views.select(MUG)
    views.select(DRAWER, client=1)
    views.show_preview(DRAWER, Pose((1.0, 0.0, 0.0)), client=1)
    views.process_queue()
    cleo = connect(server, views, FakeClient(3))
    assert [labels(each) for each in (ann, bob, cleo)] == [set(), set(IDS), set(IDS)]
    assert [views.clip_height(each) for each in (1, 2, 3, 4)] == [1.5, None, 1.5, None]
    assert [views.selected(each) for each in (1, 2, 3)] == [DRAWER, MUG, MUG]
    assert ["/previews/Drawer" in each.scene.nodes for each in (ann, bob, cleo)] == [True, False, False]
    assert [eye(each).tolist() for each in (ann, bob, cleo)] == [[9, 0, 9], [9, 9, 9], [9, 0, 9]]
    server.disconnect(bob)
    views.process_queue()
    assert views.clients == (1, 3), "of several clients the one that left is forgotten"
    views.select(None)
    views.process_queue()
    dan = connect(server, views, FakeClient(2))
    assert views.selection(2) == ()
    assert "/selected" not in dan.scene.nodes


# -- nodes of one client -----------------------------------------------------------------------------------------------


def middles(client: FakeClient) -> list[list[float]]:
    """The centers of the outlined boxes."""
    node = state(client, "/selected")
    lines = np.asarray(node.get("points", node["content"][0]))
    return [each.mean(axis=(0, 1)).round(4).tolist() for each in lines.reshape(-1, 12, 2, 3)]


def test_selection_box_and_label_move_with_the_body(views: ClientViews, ann: FakeClient) -> None:
    views.select(MUG)
    views.set_labels(LabelMode.SELECTED)
    views.process_queue()
    assert middles(ann) == [pytest.approx([2.0, 0.0, 0.85])]
    assert np.asarray(state(ann, "/selected")["content"][0]).shape == (12, 2, 3), "the ends of twelve edges"
    poses = POSES.copy()
    poses[IDS.index(MUG), :3] = 1.0, 2.0, 3.0
    views.update_poses(poses)
    assert middles(ann) == [pytest.approx([1.0, 2.0, 3.0])]
    assert ann.scene.data["labels"]["positions"].tolist() == [pytest.approx([1.0, 2.0, 3.07])]
    with ann.scene.recording() as messages:
        views.update_poses(poses.copy())
    assert messages == [], "nothing has moved"


def test_several_bodies_are_selected_and_the_last_has_the_gizmo(views: ClientViews, ann: FakeClient) -> None:
    notified: list[int] = []
    views.on_change(notified.append)
    views.set_gizmo(GizmoMode.MOVE)
    views.select_several([MUG, DRAWER, MUG])
    views.set_labels(LabelMode.SELECTED)
    views.process_queue()
    assert (views.selection(1), views.selected(1), notified) == ((MUG, DRAWER), DRAWER, [1])
    assert middles(ann) == [pytest.approx([2.0, 0.0, 0.85]), pytest.approx([1.95, 0.0, 0.65])]
    assert state(ann, "/gizmo")["position"] == pytest.approx([1.95, 0.0, 0.65])
    assert labels(ann) == {MUG, DRAWER}
    set_world(views, replace(WORLD, bodies=tuple(body for body in WORLD.bodies if body.id != DRAWER)))
    assert (views.selection(1), views.selected(1), notified) == ((MUG,), MUG, [1, 1])
    views.select(None)
    views.process_queue()
    assert views.selection(1) == ()
    assert "/selected" not in ann.scene.nodes
    assert "/selected_behind" not in ann.scene.nodes


def test_parts_are_outlined_with_their_body(views: ClientViews, ann: FakeClient) -> None:
    appearances = compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
    views.set_bodies(appearances, {}, IDS, POSES, parts={DRAWER: (BodyId("DrawerHandle"),)})
    views.select(DRAWER)
    views.process_queue()
    colors = np.asarray(state(ann, "/selected")["content"][1]).reshape(-1, 12, 2, 3)[:, 0, 0].tolist()
    assert len(middles(ann)) == 2
    assert min(colors[1]) > min(colors[0]), "the part is fainter"


def test_labels_follow_the_label_mode(views: ClientViews, ann: FakeClient) -> None:
    def labels_in(mode: LabelMode) -> set[str]:
        views.set_labels(mode)
        views.process_queue()
        return labels(ann)

    assert labels_in(LabelMode.ALL) == set(IDS)
    assert labels_in(LabelMode.CLASS) == set()
    views.select(BodyId("DrawerHandle"))
    assert labels_in(LabelMode.CLASS) == {"DrawerHandle", "FridgeHandle"}
    assert labels_in(LabelMode.SELECTED) == {"DrawerHandle"}
    assert labels_in(LabelMode.NONE) == set()


def test_of_many_bodies_the_largest_are_labeled(views: ClientViews, ann: FakeClient) -> None:
    mug = WORLD.body("Mug")
    mugs = [replace(mug, id=BodyId(f"Mug{n}")) for n in range(1100)]
    set_world(views, replace(WORLD, bodies=(*mugs, *WORLD.bodies)))
    views.set_labels(LabelMode.ALL)
    views.process_queue()
    assert len(labels(ann)) == 1000
    assert {"Floor", "Fridge", "Cupboard"} <= labels(ann)


def test_a_preview_is_shown_moved_and_removed(views: ClientViews, ann: FakeClient) -> None:
    views.show_preview(MUG, Pose((1.0, 0.0, 0.0)))
    views.process_queue()
    views.show_preview(MUG, Pose((2.0, 0.0, 0.0)))
    with ann.scene.recording() as messages:
        views.process_queue()
    assert "add" not in [what for _, what in messages]
    assert state(ann, "/previews/Mug")["position"] == pytest.approx([2.0, 0.0, 0.0])
    assert 0.0 < state(ann, "/previews/Mug")["opacity"] < 0.6
    views.show_preview(MUG, None)
    views.process_queue()
    assert "/previews/Mug" not in ann.scene.nodes


def test_a_gizmo_shows_a_preview_and_moves_the_body_when_released(
    views: ClientViews, ann: FakeClient, on_place: RecordedMoves
) -> None:
    views.select(MUG)
    views.set_gizmo(GizmoMode.MOVE)
    views.process_queue()
    handles = ann.scene.nodes["/gizmo"]
    assert (vars(handles)["disable_rotations"], vars(handles)["disable_axes"]) == (True, False)

    def drag(phase: str, *position: float) -> None:
        vars(handles).update(position=np.array(position), wxyz=np.array([1.0, 0.0, 0.0, 0.0]))
        vars(handles)["update"](SimpleNamespace(phase=phase, target=handles))
        views.process_queue()

    drag("start", 2.0, 0.0, 0.85)
    drag("update", 2.0, 0.0, 1.5)
    assert state(ann, "/previews/Mug")["position"] == pytest.approx([2.0, 0.0, 1.5])
    views.update_poses(POSES)
    assert vars(handles)["position"] == pytest.approx([2.0, 0.0, 1.5]), "updates do not interrupt a drag"
    assert on_place.moves == []
    drag("end", 2.0, 0.0, 1.5)
    assert on_place.moves == [(1, MUG, Pose((2.0, 0.0, 1.5)))]
    assert "/previews/Mug" not in ann.scene.nodes


def test_the_gizmo_follows_the_selection(views: ClientViews, ann: FakeClient) -> None:
    views.set_gizmo(GizmoMode.TURN)
    views.process_queue()
    assert "/gizmo" not in ann.scene.nodes
    views.select(DRAWER)
    views.process_queue()
    assert state(ann, "/gizmo")["position"] == pytest.approx([1.95, 0.0, 0.65])
    assert state(ann, "/gizmo")["disable_rotations"] is False
    views.set_gizmo(None)
    views.process_queue()
    assert "/gizmo" not in ann.scene.nodes


def turned(degrees: float, axis: tuple[float, float, float], position: Vector = (0.0, 0.0, 0.0)) -> Pose:
    half = np.radians(degrees) / 2
    x, y, z = (float(np.sin(half)) * each for each in axis)
    return Pose(position, (float(np.cos(half)), x, y, z))


Z = (0.0, 0.0, 1.0)


@each_case(
    ("snapping", "start", "moved", "expected"),
    [
        (Snapping(), Pose((0.1, 0.2, 0.3)), Pose((0.123, 0.2, 0.9)), Pose((0.123, 0.2, 0.9))),
        # multiples of the step in the world, only along the axes that were moved
        (Snapping(step_m=0.25), Pose((0.1, 0.2, 0.3)), Pose((0.7, 0.2, 0.3)), Pose((0.75, 0.2, 0.3))),
        (Snapping(step_m=0.25), Pose((0.1, 0.2, 0.3)), Pose((-0.4, 0.2, 1.1)), Pose((-0.5, 0.2, 1.0))),
        (Snapping(step_m=0.25), Pose(), turned(37.0, Z), turned(37.0, Z)),
        # multiples of the angle from the start, about the same axis, the shorter way
        (Snapping(step_deg=15.0), Pose(), turned(37.0, Z), turned(30.0, Z)),
        (Snapping(step_deg=15.0), Pose(), turned(-38.0, Z), turned(-45.0, Z)),
        (Snapping(step_deg=15.0), turned(10.0, Z), turned(47.0, Z), turned(40.0, Z)),
        (Snapping(step_deg=15.0), Pose(), turned(330.0, Z), turned(-30.0, Z)),
        (Snapping(step_deg=90.0), Pose(), turned(100.0, (0.0, 1.0, 0.0)), turned(90.0, (0.0, 1.0, 0.0))),
        (Snapping(step_deg=15.0), Pose(), Pose((0.11, 0.0, 0.0)), Pose((0.11, 0.0, 0.0))),
        # a tenth of the motion, not rounded
        (Snapping(precise=True), Pose((1.0, 0.0, 0.0)), Pose((2.0, 0.0, -1.0)), Pose((1.1, 0.0, -0.1))),
        (Snapping(precise=True, step_m=0.5, step_deg=45.0), Pose(), turned(50.0, Z, (1.0, 0.0, 0.0)),
         turned(5.0, Z, (0.1, 0.0, 0.0))),
    ],
)  # fmt: skip
def test_motions_of_the_gizmo_are_rounded(snapping: Snapping, start: Pose, moved: Pose, expected: Pose) -> None:
    found = snapping.apply(start, moved)
    assert found.position == pytest.approx(expected.position, abs=1e-9)
    same = np.dot(found.quaternion, expected.quaternion)
    assert abs(same) == pytest.approx(1.0, abs=1e-9)


def test_the_gizmo_moves_all_selected_bodies_rigidly_and_rounds_the_motion(
    views: ClientViews, ann: FakeClient, on_place: RecordedMoves
) -> None:
    views.set_snapping(Snapping(step_m=0.5, step_deg=90.0), client=1)
    views.select_several([DRAWER, MUG])
    views.set_gizmo(GizmoMode.MOVE)
    views.process_queue()
    handles = ann.scene.nodes["/gizmo"]

    def drag(phase: str, pose: Pose) -> None:
        vars(handles).update(position=np.array(pose.position), wxyz=np.array(pose.quaternion))
        vars(handles)["update"](SimpleNamespace(phase=phase, target=handles))
        views.process_queue()

    drag("start", Pose((2.0, 0.0, 0.85)))
    drag("update", turned(80.0, Z, (3.1, 0.0, 0.85)))
    assert state(ann, "/previews/Mug")["position"] == pytest.approx([3.0, 0.0, 0.85])
    # the drawer is 0.05 m beside the mug in -x, so it turns to -y
    assert state(ann, "/previews/Drawer")["position"] == pytest.approx([3.0, -0.05, 0.65])
    drag("end", turned(80.0, Z, (3.1, 0.0, 0.85)))
    ((client, id, pose),) = on_place.moves
    assert (client, id) == (1, MUG)
    assert pose.position == pytest.approx((3.0, 0.0, 0.85))
    assert pose.quaternion == pytest.approx(turned(90.0, Z).quaternion)
    assert not [name for name in ann.scene.nodes if name.startswith("/previews/")]
    assert state(ann, "/gizmo")["position"] == pytest.approx([2.0, 0.0, 0.85]), "it is back at the body"


def test_a_ghost_changes_its_color_where_it_is_blocked(views: ClientViews, ann: FakeClient) -> None:
    visuals = compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)[MUG].visuals

    def shown(ghost: Ghost | None) -> dict[str, Any]:
        views.show_ghost(ghost, client=1)
        views.process_queue()
        return state(ann, "/ghost") if "/ghost" in ann.scene.nodes else {}

    free = Ghost(key="cup", visuals=visuals, pose=turned(90.0, Z, (1.0, 2.0, 3.0)), is_free=True)
    node = shown(free)
    assert node["position"] == pytest.approx([1.0, 2.0, 3.0])
    assert node["wxyz"] == pytest.approx(turned(90.0, Z).quaternion)
    red, green, _ = node["color"]
    assert green > red
    assert 0.0 < node["opacity"] < 1.0
    with ann.scene.recording() as messages:
        assert shown(replace(free, pose=Pose((4.0, 2.0, 3.0))))["position"] == pytest.approx([4.0, 2.0, 3.0])
    assert ("/ghost", "add") not in messages, "it is moved, not drawn again"
    red, green, _ = shown(replace(free, is_free=False))["color"]
    assert red > green
    assert shown(None) == {}
    assert shown(None) == {}


def test_a_measurement_has_its_points_a_line_and_a_label_in_the_middle(views: ClientViews, ann: FakeClient) -> None:
    def shown(*points: Vector) -> dict[str, Any]:
        views.show_measurement(points, "2.00 m", client=1)
        views.process_queue()
        return {name: vars(node) for name, node in ann.scene.nodes.items() if name.startswith("/measurement")}

    (one,) = shown((1.0, 2.0, 3.0)).values()
    assert one["position"] == (1.0, 2.0, 3.0)
    both = shown((1.0, 2.0, 3.0), (1.0, 4.0, 3.0))
    points = [both[f"/measurement/{number}"]["position"] for number in (0, 1)]
    assert points == [(1.0, 2.0, 3.0), (1.0, 4.0, 3.0)]
    assert np.asarray(both["/measurement/line"]["content"][0]).tolist() == [[[1, 2, 3], [1, 4, 3]]]
    assert (both["/measurement/label"]["content"], both["/measurement/label"]["position"]) == (
        ("2.00 m",),
        (1.0, 3.0, 3.0),
    )
    assert shown() == {}


def test_bodies_are_hidden_until_they_are_removed(views: ClientViews) -> None:
    views.show_bodies([MUG, DRAWER], False)
    views.show_bodies([DRAWER], True)
    assert views.hidden == {MUG}
    set_world(views, replace(WORLD, bodies=tuple(body for body in WORLD.bodies if body.id != MUG)))
    assert views.hidden == set()


# -- the camera --------------------------------------------------------------------------------------------------------


def eye(client: FakeClient) -> np.ndarray:
    return np.array(vars(client.camera)["position"])


def finish_camera_move(views: ClientViews, monkeypatch: pytest.MonkeyPatch) -> None:
    """Advances the clock to the end of the animation."""
    now = time.monotonic()
    monkeypatch.setattr(camera_module.time, "monotonic", lambda: now + 60.0)
    views.process_queue()
    monkeypatch.undo()


def test_a_view_without_a_height_is_taken_for_a_square() -> None:
    class Hidden:
        @property
        def aspect(self) -> float:
            return 300 / 0

    hidden: Any = Hidden()
    assert aspect_ratio(hidden) == 1.0


def test_the_home_view_depends_on_the_aspect_ratio(server: FakeServer, views: ClientViews) -> None:
    target = initial_target(WORLD, compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors))
    views.set_target(target)
    phone, desktop = (connect(server, views, FakeClient(n, aspect=aspect)) for n, aspect in enumerate([0.5, 1.6]))
    assert eye(phone) == pytest.approx(target.camera(0.5).position)
    assert eye(desktop) == pytest.approx(target.camera(1.6).position)


def test_without_a_scene_the_home_view_is_where_the_camera_is(server: FakeServer, on_place: RecordedMoves) -> None:
    views = ClientViews(server, on_place=on_place)  # type: ignore[arg-type]
    ann = connect(server, views, FakeClient(1))
    for request in (views.go_home, views.go_top, views.focus):
        request()
        views.process_queue()
    assert eye(ann).tolist() == [9.0, 0.0, 9.0]
    assert not views.is_drawn
    assert views.target is None


def test_the_camera_is_animated(views: ClientViews, ann: FakeClient, monkeypatch: pytest.MonkeyPatch) -> None:
    views.set_camera(AFAR)
    views.process_queue()
    views.focus([MUG], client=1)
    views.process_queue()
    assert np.linalg.norm(eye(ann) - AFAR.position) < 2.0, "the animation has only begun"
    finish_camera_move(views, monkeypatch)
    assert vars(ann.camera)["look_at"] == pytest.approx([2.0, 0.0, 0.85], abs=0.05)
    assert 0.3 < np.linalg.norm(eye(ann) - (2.0, 0.0, 0.85)) < 2.0


def test_home_view_top_view_and_focus_are_animated(
    views: ClientViews, ann: FakeClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = initial_target(WORLD, compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors))
    views.set_target(target)
    for request, view in (
        (views.go_top, target.top_camera(1.5)),
        (views.go_home, target.camera(1.5)),
        (views.focus, target.camera(1.5)),
    ):
        views.set_camera(AFAR)
        request()
        views.process_queue()
        finish_camera_move(views, monkeypatch)
        assert eye(ann) == pytest.approx(view.position)


@pytest.mark.parametrize(
    ("position", "look_at", "is_seen"),
    [
        ((2.0, -2.0, 0.85), (2.0, 0.0, 0.85), True),
        ((2.0, -2.0, 0.85), (2.0, -4.0, 0.85), False),  # behind the camera
        ((2.0, -2.0, 0.85), (3.0, -2.0, 0.85), False),  # beside the picture
        ((2.0, -2.0, 0.85), (3.0, 0.0, 0.85), True),  # 26.6 degrees to the side, of 28.7
        ((2.0, -2.0, 0.85), (3.3, 0.0, 0.85), False),  # 33 degrees to the side
        ((2.0, -2.0, 0.85), (2.0, 0.0, 1.45), True),  # 16.7 degrees below the middle, of 20
        ((2.0, -2.0, 0.85), (2.0, 0.0, 1.75), False),  # 24 degrees below
        ((2.0, -2.0, 0.85), (2.0, 0.0, -0.05), False),  # 24 degrees above
        ((2.0, -20.0, 0.85), (2.0, 0.0, 0.85), False),  # 0.1 m of a picture that is 14.6 m high
        ((2.0, 0.0, 3.0), (2.0, 0.0, 0.0), True),  # from above, where no direction is to the right
    ],
)
def test_a_highlighted_body_is_noticed_in_the_middle_of_the_picture(
    views: ClientViews, ann: FakeClient, position: Vector, look_at: Vector, is_seen: bool
) -> None:
    views.set_camera(CameraPose(position, look_at, 0.7), client=1)
    views.process_queue()
    assert views.clients_not_seeing([MUG]) == (() if is_seen else (1,))


def test_one_visible_body_of_many_is_enough_and_each_client_is_asked(
    server: FakeServer, views: ClientViews, ann: FakeClient
) -> None:
    connect(server, views, FakeClient(2))
    views.set_camera(CameraPose((2.0, -2.0, 0.85), (2.0, 0.0, 0.85), 0.7), client=1)
    views.set_camera(CameraPose((2.0, -2.0, 0.85), (2.0, -4.0, 0.85), 0.7), client=2)
    views.process_queue()
    assert views.clients_not_seeing([BodyId("Floor"), MUG]) == (2,)
    assert views.clients_not_seeing([BodyId("gone"), MUG]) == (2,)
    assert views.clients_not_seeing([BodyId("gone")]) == ()


def test_the_camera_shows_points_from_where_it_is(
    views: ClientViews, ann: FakeClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    views.set_camera(CameraPose((5.0, 0.0, 1.0), (2.0, 0.0, 1.0), 0.7))
    views.focus_points([(0.0, 0.0, 1.0), (0.0, 1.0, 1.0)], client=1)
    views.process_queue()
    finish_camera_move(views, monkeypatch)
    assert vars(ann.camera)["look_at"] == pytest.approx([0.0, 0.5, 1.0], abs=0.05)
    x, y, z = eye(ann)
    assert 0.5 < x < 5.0, "nearer, and on the same side"
    views.focus_points([], client=1)
    views.process_queue()
    finish_camera_move(views, monkeypatch)
    assert eye(ann).tolist() == [x, y, z]


def test_the_clipping_height_is_a_node_of_the_scene(views: ClientViews, ann: FakeClient) -> None:
    views.set_clip_height(1.2, client=1)
    views.process_queue()
    assert state(ann, "/clipping_plane")["position"] == (0.0, 0.0, 1.2)
    views.set_clip_height(None, client=1)
    views.process_queue()
    assert "/clipping_plane" not in ann.scene.nodes


# -- what is mounted on walls ------------------------------------------------------------------------------------------


def walled_kitchen() -> World:
    """The kitchenette with a wall behind the camera at x = 9 and a radiator mounted on it, above the floor."""
    fridge = WORLD.body("Fridge")

    def built(id: str, cls: str, position: Vector, size: Vector) -> Body:
        iri, kind = Iri(f"{fridge.iri}{id}"), Iri(fridge.cls.replace("Refrigerator", cls))
        return replace(fridge, id=BodyId(id), iri=iri, cls=kind, pose=Pose(position), size=size)

    wall = built("Wall", "Wall", (6.0, 0.0, 1.25), (0.1, 6.0, 2.5))
    radiator = built("Radiator", "Radiator", (5.9, 1.0, 0.5), (0.1, 0.8, 0.6))
    return replace(WORLD, bodies=(*WORLD.bodies, wall, radiator))


def test_what_is_mounted_on_a_wall_is_hidden_where_the_wall_is(server: FakeServer, on_place: RecordedMoves) -> None:
    views = ClientViews(server, on_place=on_place, instances=lambda ids: {f"/bodies/{id}": [] for id in ids})  # type: ignore[arg-type]
    set_world(views, walled_kitchen(), is_culling=True)
    outside, inside = FakeClient(1), FakeClient(2)
    inside.camera.position = np.array([4.0, -2.0, 1.5])
    for client in (outside, inside):
        server.connect(client)
    views.set_labels(LabelMode.ALL)
    views.process_queue()
    assert outside.scene.data["culled"] == {"names": ["/bodies/Radiator"], "instances": [[]]}
    assert "Radiator" not in labels(outside)
    assert "culled" not in inside.scene.data
    assert {"Radiator", "Wall"} <= labels(inside)
    assert views.culled(1) == {"Radiator"}
    views.select(BodyId("Radiator"), client=1)
    views.process_queue()
    assert not outside.scene.data["culled"]["names"], "a selected body is drawn in any case"
    views.select(None, client=1)
    views.set_highlighted([BodyId("Radiator")])
    views.process_queue()
    assert not outside.scene.data["culled"]["names"], "and so is a highlighted one"
    views.set_highlighted([])
    outside.camera.position = np.array([4.0, 2.0, 1.5])
    views.process_queue()
    assert not views.culled(1), "the camera has moved into the room"


def test_what_has_left_its_wall_is_drawn(server: FakeServer, on_place: RecordedMoves) -> None:
    views = ClientViews(server, on_place=on_place)  # type: ignore[arg-type]
    world = walled_kitchen()
    set_world(views, world, is_culling=True)
    connect(server, views, FakeClient(1))
    assert views.culled(1) == {"Radiator"}
    poses = pose_array(body.pose for body in world.bodies)
    poses[-1, :3] = (2.0, -1.5, 0.3)
    views.update_poses(poses)
    views.process_queue()
    assert not views.culled(1), "it stands on the floor"
