"""What is sent to the visitors, and what is not: the server is played by a list."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.viewport.framing import View
from mindstage.viewport.looks import Form, Look, decide_looks
from mindstage.viewport.palette import DIMMED_OPACITY, Paint
from mindstage.viewport.scene import Scene, moved
from mindstage.world import BodyId, World
from mindstage.world.geometry import pose_array
from tests.kitchenette import kitchenette

WORLD = kitchenette()
IDS = tuple(body.id for body in WORLD.bodies)
POSES = pose_array(body.pose for body in WORLD.bodies)
LOOKS = decide_looks(WORLD, lambda cls: ())


class Node:
    """A node that tells what becomes of it."""

    def __init__(self, told: list[tuple[str, str]], name: str) -> None:
        vars(self).update(told=told, name=name)

    def __setattr__(self, attribute: str, value: Any) -> None:
        self.told.append((self.name, attribute))
        vars(self)[attribute] = value

    def remove(self) -> None:
        self.told.append((self.name, "remove"))


class Server:
    """A server without visitors: `told` is what it would have sent, `nodes` what is there."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str]] = []
        self.nodes: dict[str, Node] = {}
        self.scene, self.initial_camera, self.world_axes = self, Node(self.told, "camera"), Node([], "axes")
        self.atomic = nullcontext

    def add(self, name: str, **properties: Any) -> Node:
        self.told.append((name, "add"))
        self.nodes[name] = Node(self.told, name)
        vars(self.nodes[name]).update(properties)
        return self.nodes[name]

    def add_mesh_simple(self, name: str, vertices: Any, faces: Any, **properties: Any) -> Node:
        return self.add(name, **properties)

    def add_line_segments(self, name: str, points: Any, colors: Any, **properties: Any) -> Node:
        return self.add(name, points=points, **properties)

    def add_grid(self, name: str, **properties: Any) -> Node:
        return self.add(name, **properties)

    def add_light_hemisphere(self, name: str, **properties: Any) -> Node:
        return self.add(name, **properties)

    add_light_directional = add_light_hemisphere

    def get_handle_by_name(self, name: str) -> Node | None:
        return self.nodes.get(name)

    def get_clients(self) -> dict[int, Any]:
        return {}

    def configure_default_lights(self, **_: Any) -> None: ...
    def configure_environment_map(self, *_: Any) -> None: ...
    def set_background_image(self, *_: Any, **__: Any) -> None: ...

    @contextmanager
    def listening(self) -> Iterator[list[tuple[str, str]]]:
        """What is sent in the meantime."""
        heard: list[tuple[str, str]] = []
        start = len(self.told)
        yield heard
        heard += self.told[start:]


@pytest.fixture
def server() -> Server:
    return Server()


@pytest.fixture
def prepared() -> list[tuple[str, bool]]:
    return []


@pytest.fixture
def scene(server: Server, prepared: list[tuple[str, bool]]) -> Scene:
    def prepare(id: BodyId, node: Any, *, holdable: bool) -> None:
        prepared.append((id, holdable))

    scene = Scene(server, prepare=prepare)  # type: ignore[arg-type]
    show(scene)
    return scene


def show(scene: Scene, world: World = WORLD, looks: dict[BodyId, Look] | None = None) -> None:
    ids = tuple(body.id for body in world.bodies)
    looks = decide_looks(world, lambda cls: ()) if looks is None else looks
    scene.show(looks, ids, pose_array(body.pose for body in world.bodies), holdable={"Mug", "Drawer"})


def test_rows_that_moved_are_found() -> None:
    now = POSES.copy()
    now[3, 1] += 0.001
    now[6, 4] += 0.001
    assert moved(POSES, now).tolist() == [3, 6]
    assert moved(POSES, POSES + 1e-7).tolist() == []
    assert moved(np.zeros((0, 7)), np.zeros((0, 7))).tolist() == []


def test_every_body_is_drawn_once_where_it_is(server: Server, scene: Scene) -> None:
    drawn = [name for name, what in server.told if what == "add" and name.startswith("/bodies/")]
    assert sorted(drawn) == sorted(f"/bodies/{id}" for id in IDS)
    for row, id in enumerate(IDS):
        assert np.allclose(vars(server.nodes[f"/bodies/{id}"])["position"], POSES[row, :3])


def test_everything_but_the_building_answers_to_the_mouse(scene: Scene, prepared: list[tuple[str, bool]]) -> None:
    assert dict(prepared) == {id: id in ("Mug", "Drawer") for id in IDS if id != "Floor"}


def test_what_is_drawn_from_one_side_only_does_not_catch_the_mouse(
    scene: Scene, prepared: list[tuple[str, bool]]
) -> None:
    prepared.clear()
    one_sided = replace(LOOKS[BodyId("Mug")], form=Form.INSIDE, openings=((0, 1),))
    show(scene, looks={**LOOKS, BodyId("Mug"): one_sided})
    assert prepared == []


def test_only_what_moved_is_sent(server: Server, scene: Scene) -> None:
    now = POSES.copy()
    now[IDS.index(BodyId("Mug")), 2] += 0.5
    with server.listening() as heard:
        assert scene.move(now) == 1
    assert {name for name, _ in heard} == {"/bodies/Mug"}
    with server.listening() as heard:
        assert scene.move(now.copy()) == 0
    assert heard == []


def test_creeping_is_sent_once_it_can_be_seen(scene: Scene) -> None:
    sent = [scene.move(POSES + step * 1.1e-5) for step in range(1, 13)]
    assert sum(count > 0 for count in sent) == 2


def test_a_quaternion_that_is_a_little_off_is_sent_as_a_rotation(server: Server, scene: Scene) -> None:
    off = POSES.copy()
    off[:, 3:] *= 1.01
    scene.move(off)
    for node in server.nodes.values():
        if "wxyz" in vars(node):
            assert np.linalg.norm(vars(node)["wxyz"]) == pytest.approx(1.0)


def test_a_body_that_went_is_removed_and_one_that_came_is_drawn(server: Server, scene: Scene) -> None:
    mug = WORLD.body("Mug")
    other = replace(mug, id=BodyId("Other"))
    bodies = (*(body for body in WORLD.bodies if body is not mug), other)
    with server.listening() as heard:
        show(scene, replace(WORLD, bodies=bodies))
    assert ("/bodies/Mug", "remove") in heard
    assert ("/bodies/Other", "add") in heard
    assert [name for name, what in heard if what == "add"] == ["/bodies/Other"]


def test_a_body_that_looks_different_is_drawn_anew_and_no_other(server: Server, scene: Scene) -> None:
    painted = replace(LOOKS[BodyId("Mug")], paint=Paint((1.0, 0.0, 0.0)))
    with server.listening() as heard:
        show(scene, looks={**LOOKS, BodyId("Mug"): painted})
    assert [name for name, what in heard if what == "add"] == ["/bodies/Mug"]
    assert vars(server.nodes["/bodies/Mug"])["color"] == (255, 0, 0)


def test_what_can_be_held_from_now_on_answers_to_the_mouse(scene: Scene, prepared: list[tuple[str, bool]]) -> None:
    prepared.clear()
    scene.show(LOOKS, IDS, POSES, holdable={"Mug", "Drawer", "Fridge"})
    assert prepared == [("Fridge", True)]


def test_a_highlight_paints_the_lit_and_dims_the_rest(server: Server, scene: Scene) -> None:
    def painted(id: str) -> tuple[object, object]:
        return vars(server.nodes[f"/bodies/{id}"])["color"], vars(server.nodes[f"/bodies/{id}"])["opacity"]

    mug, fridge = painted("Mug"), painted("Fridge")
    scene.light_up({BodyId("Mug"): (0.0, 1.0, 0.0)})
    assert painted("Mug") == ((0, 255, 0), None)
    assert painted("Fridge")[1] == DIMMED_OPACITY
    with server.listening() as heard:
        scene.light_up({BodyId("Mug"): (0.0, 1.0, 0.0)})
    assert heard == []
    with server.listening() as heard:
        scene.light_up({BodyId("Mug"): (0.0, 1.0, 0.0), BodyId("Fridge"): (1.0, 0.0, 0.0)})
    assert {name for name, _ in heard} == {"/bodies/Fridge"}
    scene.light_up({})
    assert (painted("Mug"), painted("Fridge")) == (mug, fridge)


def test_what_is_drawn_while_something_is_lit_is_dimmed_too(server: Server, scene: Scene) -> None:
    scene.light_up({BodyId("Mug"): (0.0, 1.0, 0.0)})
    show(scene, looks={**LOOKS, BodyId("Fridge"): replace(LOOKS[BodyId("Fridge")], size=(0.2, 0.2, 0.2))})
    assert vars(server.nodes["/bodies/Fridge"])["opacity"] == DIMMED_OPACITY


def test_a_lit_body_that_is_drawn_anew_stays_lit(server: Server, scene: Scene) -> None:
    scene.light_up({BodyId("Mug"): (0.0, 1.0, 0.0)})
    show(scene, looks={**LOOKS, BodyId("Mug"): replace(LOOKS[BodyId("Mug")], size=(0.2, 0.2, 0.2))})
    assert vars(server.nodes["/bodies/Mug"])["color"] == (0, 255, 0)


def test_the_frame_of_the_selected_goes_with_it(server: Server, scene: Scene) -> None:
    scene.select(BodyId("Mug"))
    assert "/bodies/Mug/selected" in server.nodes, "a child of the body moves with the body"
    with server.listening() as heard:
        scene.select(BodyId("Mug"))
    assert heard == []
    scene.select(BodyId("Drawer"))
    assert ("/bodies/Mug/selected", "remove") in server.told
    scene.select(None)
    assert ("/bodies/Drawer/selected", "remove") in server.told


def test_a_slash_in_an_id_makes_no_child(server: Server, scene: Scene) -> None:
    odd = replace(WORLD.body("Mug"), id=BodyId("Mug/../a b"))
    show(scene, replace(WORLD, bodies=(*WORLD.bodies, odd)))
    assert "/bodies/Mug%2F..%2Fa%20b" in server.nodes


def test_shells_are_lines_that_can_be_hidden(server: Server, scene: Scene) -> None:
    shell = replace(WORLD.body("Cupboard"), id=BodyId("Hall"), size=(30.0, 30.0, 9.0))
    show(scene, replace(WORLD, bodies=(*WORLD.bodies, shell)))
    hall = server.nodes["/bodies/Hall"]
    assert len(vars(hall)["points"]) == 12
    scene.show_shells(False)
    assert vars(hall)["visible"] is False
    scene.show_shells(True)
    assert vars(hall)["visible"] is True


def test_the_ground_comes_and_goes(server: Server, scene: Scene) -> None:
    scene.lay_ground(-0.5)
    assert vars(server.nodes["/ground"])["position"] == (0.0, 0.0, -0.5)
    scene.lay_ground(None)
    assert server.told[-1] == ("/ground", "remove")


def test_the_sun_stands_behind_the_visitor(server: Server, scene: Scene) -> None:
    scene.look_from(View((5.0, 1.0, 3.0), (0.0, 0.0, 0.0), 0.7))
    x, _, z = vars(server.nodes["/sun"])["position"]
    assert x > 0.0
    assert z > 0.0
    assert vars(server.initial_camera)["position"] == (5.0, 1.0, 3.0)
