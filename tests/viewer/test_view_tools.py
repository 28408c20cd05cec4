"""The tools of the 3D view: what a page gets for a point of its picture, distances, and cameras along the axes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.rendering.appearance import compute_appearance
from mindstage.rendering.camera import CameraPose, initial_target
from mindstage.scene import Body, BodyId, Iri, Pose, Vector
from mindstage.scene.transforms import pose_array, quaternion_from_matrix
from mindstage.viewer import client_views as camera_module
from mindstage.viewer.client_views import ClientViews, GizmoMode
from mindstage.viewer.view_tools import PointerPicker, SessionViews, ViewToolHandler
from tests.kitchenette import kitchenette
from tests.viewer.fake_server import FakeClient, FakeServer

MUG, CUPBOARD, DRAWER, FRIDGE = BodyId("Mug"), BodyId("Cupboard"), BodyId("Drawer"), BodyId("Fridge")
ASPECT, FIELD = 1.5, 2 * math.atan(0.5)
"""The picture is as high as the distance from the camera, and 1.5 times as wide."""


class Tools:
    """The requests of two pages, the first of which has the views 1 and 3, and the second 2."""

    def __init__(self, sim: Simulation) -> None:
        self.sim, self.server = sim, FakeServer()
        self.views = ClientViews(self.server, on_place=lambda *_, **__: None)  # type: ignore[arg-type]
        self.clients = {number: FakeClient(number, aspect=ASPECT) for number in (1, 2, 3)}
        server = SimpleNamespace(get_clients=lambda: self.clients)
        pages = {"first": [1, 3], "second": [2], "none": [9]}
        views_of = lambda page: pages[str(page)]  # noqa: E731
        self.session_views = SessionViews(self.views, cast("Any", server), views_of=views_of)
        self._handlers: dict[str, tuple[type, Callable[..., Any]]] = {}
        self.channel = SimpleNamespace(register=self._register)
        self.picker = PointerPicker(sim, self.views)
        ViewToolHandler(sim, cast("Any", self.channel), self.session_views, self.picker)
        self.draw()
        for client in self.clients.values():
            self.server.connect(client)
        self.views.process_queue()

    def _register(self, name: str, type: type, handler: Callable[..., Any], *_: Any, queue: str = "") -> None:
        self._handlers[name] = type, handler

    def draw(self) -> None:
        """What the drawing thread does with the current state."""
        world = self.sim.snapshot()
        appearances = compute_appearance(world, self.sim.knowledge.shape_rule, self.sim.knowledge.ancestors)
        ids = tuple(body.id for body in world.bodies)
        self.views.set_bodies(appearances, {}, ids, pose_array(body.pose for body in world.bodies))
        self.views.set_target(initial_target(world, appearances))

    def ask(self, method: str, page: str = "first", **params: Any) -> Any:
        """The response to a request of a page, as it is sent."""
        type, handler = self._handlers[method]
        return msgspec.to_builtins(handler(page, msgspec.convert(params, type)))

    def look(self, eye: Vector, at: Vector, *numbers: int) -> None:
        """Puts the cameras of views to a point."""
        ahead = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right = right / np.linalg.norm(right) if right.any() else np.array([1.0, 0.0, 0.0])
        axes = np.stack([right, -np.cross(right, ahead), ahead], axis=1)
        for number in numbers or (1, 2, 3):
            vars(self.clients[number].camera).update(
                position=np.array(eye), look_at=np.array(at), fov=FIELD, wxyz=quaternion_from_matrix(axes)
            )

    def finish_moves(self, monkeypatch: pytest.MonkeyPatch) -> dict[int, CameraPose]:
        """The cameras at the end of their animations."""
        self.views.process_queue()
        now = time.monotonic()
        monkeypatch.setattr(camera_module.time, "monotonic", lambda: now + 60.0)
        self.views.process_queue()
        monkeypatch.undo()
        cameras = {number: vars(client.camera) for number, client in self.clients.items()}
        return {
            number: CameraPose(tuple(each["position"]), tuple(each["look_at"]), each["fov"])
            for number, each in cameras.items()
        }


@pytest.fixture
def tools() -> Iterator[Tools]:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        yield Tools(sim)


# -- what a point of the picture shows ---------------------------------------------------------------------------------


def test_a_page_gets_the_body_and_the_point_that_its_own_camera_sees(tools: Tools) -> None:
    tools.look((-1.0, 0.0, 0.85), (2.0, 0.0, 0.85), 1)
    tools.look((-1.0, 1.05, 1.5), (2.0, 1.05, 1.5), 2)
    found = tools.ask("pick", pointer=(0.0, 0.0), corners=False)
    assert (found["id"], found["is_corner"]) == (MUG, False)
    assert found["point"] == pytest.approx((1.96, 0.0, 0.85), abs=1e-6), "the front of the mug"
    other = tools.ask("pick", "second", pointer=(0.0, 0.0), corners=False)
    assert (other["id"], other["point"]) == ("FridgeDoor", pytest.approx((1.66, 1.05, 1.5), abs=1e-6))
    # the handle is 0.2 m lower at a distance of 2.66 m, where half the picture is 1.33 m high
    found = tools.ask("pick", pointer=(0.0, -0.2 / 1.33), corners=False)
    assert (found["id"], found["point"]) == ("DrawerHandle", pytest.approx((1.66, 0.0, 0.65), abs=1e-6))
    # the fridge's door is to the left, as it is seen along x
    found = tools.ask("pick", pointer=(-0.9 / (1.33 * ASPECT), 0.0), corners=False)
    assert (found["id"], found["point"]) == ("FridgeDoor", pytest.approx((1.66, 0.9, 0.85), abs=1e-6))
    assert tools.ask("pick", pointer=(0.0, 0.9)) is None
    with pytest.raises(InvalidArgumentError, match=r"3D view.*not connected"):
        tools.ask("pick", "none", pointer=(0.0, 0.0))


def test_a_corner_near_the_point_is_taken_if_it_is_asked_for(tools: Tools) -> None:
    tools.look((-1.0, 0.0, 0.85), (2.0, 0.0, 0.85), 1)
    # 1 cm beside the upper corner of the mug's front, which is 0.04 m to the right
    pointer = (0.03 / (1.48 * ASPECT), 0.04 / 1.48)
    found = tools.ask("pick", pointer=pointer)
    assert (found["id"], found["is_corner"]) == (MUG, True)
    assert found["point"] == pytest.approx((1.96, -0.04, 0.9))
    assert not tools.ask("pick", pointer=pointer, corners=False)["is_corner"]
    tools.look((1.5, 0.0, 0.85), (2.0, 0.0, 0.85), 1)
    assert not tools.ask("pick", pointer=(0.0, 0.0))["is_corner"], "from near, the middle of the front is no corner"


def test_what_is_hidden_clipped_or_moved_away_is_not_met(tools: Tools) -> None:
    tools.look((2.0, 0.01, 5.0), (2.0, 0.01, 0.0), 1)
    below = {"pointer": (0.0, 0.0), "corners": False}
    assert tools.ask("pick", **below)["id"] == MUG
    tools.views.show_bodies([MUG], False)
    assert tools.ask("pick", **below)["id"] == CUPBOARD
    tools.views.show_bodies([MUG], True)
    tools.views.set_clip_height(0.6, client=3)
    tools.views.process_queue()
    found = tools.ask("pick", **below)
    assert (found["id"], found["point"][2]) == (CUPBOARD, pytest.approx(0.6)), "any view of the page counts"
    tools.look((2.0, 0.01, 5.0), (2.0, 0.01, 0.0), 2)
    assert tools.ask("pick", "second", **below)["id"] == MUG
    tools.look((2.0, 0.0, 5.0), (2.0, 3.0, 6.0), 1)
    assert tools.ask("pick", **below) is None, "it looks up, and everything above is clipped"
    tools.views.set_clip_height(None, client=3)
    tools.sim.edits.move(MUG, Pose((3.0, 0.0, 0.85)))
    tools.draw()
    tools.views.process_queue()
    tools.look((3.0, 0.0, 5.0), (3.0, 0.0, 0.0), 1)
    assert tools.ask("pick", **below)["id"] == MUG, "where it is now"


def test_what_is_below_a_point(tools: Tools) -> None:
    found = tools.picker.below((2.0, 0.2, 3.0))
    assert found is not None
    assert (found.id, found.point) == (CUPBOARD, pytest.approx((2.0, 0.2, 0.8)))
    assert tools.picker.below((30.0, 0.0, 1.0)) is None


def test_walls_are_met_only_from_the_room() -> None:
    world = kitchenette()
    cls = Iri(world.body("Fridge").cls.replace("Refrigerator", "Wall"))
    iri = Iri(world.body("Fridge").iri + "Wall")
    wall = Body(id=BodyId("Wall"), iri=iri, cls=cls, pose=Pose((5.0, 0.0, 1.25)), size=(0.1, 6.0, 2.5))
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as sim:
        sim.spawn(replace(world, bodies=(*world.bodies, wall)))
        tools = Tools(sim)
        tools.look((4.0, 0.0, 1.0), (6.0, 0.0, 1.0), 1)
        assert tools.ask("pick", pointer=(0.0, 0.0), corners=False)["id"] == "Wall"
        tools.look((9.0, 0.0, 0.85), (2.0, 0.0, 0.85), 1)
        assert tools.ask("pick", pointer=(0.0, 0.0), corners=False)["id"] == MUG, "through the wall"


# -- several bodies ----------------------------------------------------------------------------------------------------


def test_a_rectangle_selects_all_bodies_with_their_centers_in_it(tools: Tools) -> None:
    tools.look((-1.0, 0.0, 0.85), (2.0, 0.0, 0.85))
    everything = {"first": (-1.5, -1.5), "second": (1.5, 1.5)}
    assert set(tools.ask("bodies_in_box", **everything)) == {body.id for body in kitchenette().bodies} - {"Floor"}
    right = {"first": (0.2, 1.0), "second": (-0.2, -1.0)}
    found = {"Mug", "Drawer", "DrawerHandle", "Cupboard"}
    assert set(tools.ask("bodies_in_box", **right)) == found, "corners in any order"
    assert tools.ask("bodies_in_box", first=(-0.01, 0.01), second=(0.01, -0.01)) == [MUG]
    # Half the height of the picture is 1.5 m at the mug; the center of the cupboard is 0.45 m lower.
    just = {"first": (-0.01, -0.29), "second": (0.01, -0.31)}
    assert set(tools.ask("bodies_in_box", **just)) == {CUPBOARD}
    tools.views.show_bodies([MUG], False)
    assert set(tools.ask("bodies_in_box", **right)) == found - {MUG}
    tools.views.set_clip_height(0.64, client=1)
    tools.views.process_queue()
    assert tools.ask("bodies_in_box", **right) == [CUPBOARD]
    tools.look((-1.0, 0.0, 0.85), (-5.0, 0.0, 0.85))
    assert tools.ask("bodies_in_box", **everything) == [], "they are behind the camera"
    tools.sim.clear()
    assert tools.ask("bodies_in_box", **everything) == []


# -- measuring ---------------------------------------------------------------------------------------------------------


def test_a_measurement_is_drawn_in_the_views_of_its_page(tools: Tools) -> None:
    found = tools.ask("measure", points=((1.0, 2.0, 3.0), (1.0, 5.0, -1.0)))
    assert found == {"distance": 5.0, "offset": (0.0, 3.0, -4.0)}
    tools.views.process_queue()
    texts = {
        number: [vars(node)["content"] for name, node in client.scene.nodes.items() if name == "/measurement/label"]
        for number, client in tools.clients.items()
    }
    assert texts == {1: [("5.000 m",)], 2: [], 3: [("5.000 m",)]}
    assert tools.ask("measure", points=((0.0, 0.0, 0.0), (0.0, 0.0, 0.123))) is not None
    tools.views.process_queue()
    assert vars(tools.clients[1].scene.nodes["/measurement/label"])["content"] == ("12.3 cm",)
    assert tools.ask("measure", points=((0.0, 0.0, 0.0),)) is None
    assert tools.ask("measure") is None
    tools.views.process_queue()
    assert not [name for name in tools.clients[1].scene.nodes if name.startswith("/measurement")]


def test_the_gap_between_two_bodies_is_that_of_their_boxes(tools: Tools) -> None:
    found = tools.ask("measure_gap", first=MUG, second=FRIDGE)
    # from y = 0.04 to y = 0.7; the mug is within the fridge's extents along x and z
    assert found["distance"] == pytest.approx(0.66)
    assert found["offset"] == pytest.approx((0.0, 1.0, 0.05))
    assert tools.ask("measure_gap", first=CUPBOARD, second=DRAWER)["distance"] == 0.0, "one is in the other"
    with pytest.raises(BodyNotFoundError, match="Mugg"):
        tools.ask("measure_gap", first="Mugg", second=FRIDGE)


# -- the camera --------------------------------------------------------------------------------------------------------


def test_a_page_moves_its_own_cameras_only(tools: Tools, monkeypatch: pytest.MonkeyPatch) -> None:
    tools.look((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))
    camera = tools.ask("camera", "second")
    assert (camera["position"], camera["look_at"]) == ((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))
    assert camera["field_of_view_rad"] == pytest.approx(FIELD)
    tools.ask("set_camera", "second", position=(5.0, 6.0, 7.0), look_at=(1.0, 1.0, 1.0), field_of_view_rad=0.5)
    found = tools.finish_moves(monkeypatch)
    assert found[2] == CameraPose((5.0, 6.0, 7.0), (1.0, 1.0, 1.0), 0.5)
    for number in (1, 3):
        assert found[number].position == pytest.approx((1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("view", "direction"),
    [
        ("front", (1.0, 0.0, 0.0)),
        ("back", (-1.0, 0.0, 0.0)),
        ("left", (0.0, 1.0, 0.0)),
        ("right", (0.0, -1.0, 0.0)),
        ("top", (0.0, 0.0, 1.0)),
    ],
)
def test_standard_views_look_along_the_axes_of_the_world(
    tools: Tools, monkeypatch: pytest.MonkeyPatch, view: str, direction: Vector
) -> None:
    tools.look((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))
    tools.ask("standard_view", view=view, ids=(MUG, FRIDGE))
    found = tools.finish_moves(monkeypatch)
    middle = (2.0, 0.63, 0.9)  # of y from -0.04 to 1.3, and of z from 0 to 1.8
    for number in (1, 3):
        assert found[number].look_at == pytest.approx(middle, abs=0.3)
        away = np.subtract(found[number].position, found[number].look_at)
        assert away / np.linalg.norm(away) == pytest.approx(np.array(direction), abs=0.02)
        assert 1.0 < np.linalg.norm(away) < 6.0
    assert found[2].position == pytest.approx((1.0, 2.0, 3.0))
    tools.ask("standard_view", view=view)
    whole = tools.finish_moves(monkeypatch)[1]
    away = np.subtract(whole.position, whole.look_at)
    assert away / np.linalg.norm(away) == pytest.approx(np.array(direction), abs=0.02)
    assert whole.look_at != found[1].look_at, "of everything"
    with pytest.raises(BodyNotFoundError, match="Mugg"):
        tools.ask("standard_view", view=view, ids=(MUG, "Mugg"))


def test_a_page_sets_the_rounding_of_its_gizmo_only(tools: Tools) -> None:
    tools.ask("set_snapping", "second", step_m=0.5, to_surface=True)
    tools.views.select(MUG)
    tools.views.set_gizmo(GizmoMode.MOVE)
    tools.views.process_queue()
    for number, x in ((1, 2.3), (2, 2.5)):
        handles = tools.clients[number].scene.nodes["/gizmo"]
        vars(handles).update(position=np.array((2.3, 0.0, 0.85)), wxyz=np.array((1.0, 0.0, 0.0, 0.0)))
        vars(handles)["update"](SimpleNamespace(phase="update", target=handles))
        tools.views.process_queue()
        preview = vars(tools.clients[number].scene.nodes["/previews/Mug"])
        assert preview["position"] == pytest.approx([x, 0.0, 0.85])
