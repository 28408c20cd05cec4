"""What is sent to all visitors, and what is not: the server is played by lists."""

from __future__ import annotations

from dataclasses import replace as with_look
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.scene import AttachedLight, BodyGeometry, BodyId, Pose, World
from mindstage.scene.geometry import NO_GEOMETRY, GeometryMap
from mindstage.scene.transforms import pose_array
from mindstage.viewer.appearance import OCCLUDER_OPACITY, BodyAppearance, VisiblePart, compute_appearance
from mindstage.viewer.camera import CameraPose
from mindstage.viewer.scene import BATCH_SIZE, ViewerScene, moved_rows
from tests.kitchenette import kitchenette
from tests.viewer.playing import FakeNode, FakeServer

KNOWLEDGE = KnowledgeBase()
WORLD = kitchenette()
IDS = tuple(body.id for body in WORLD.bodies)
POSES = pose_array(body.pose for body in WORLD.bodies)
MUG, FRIDGE = BodyId("Mug"), BodyId("Fridge")
GREEN, RED = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)


def looks_of(world: World, forms: GeometryMap = NO_GEOMETRY) -> dict[BodyId, BodyAppearance]:
    return compute_appearance(world, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors, geometry=forms)


LOOKS = looks_of(WORLD)

Prepared = list[tuple[FakeNode, Any, bool]]


@pytest.fixture
def server() -> FakeServer:
    return FakeServer()


@pytest.fixture
def prepared() -> Prepared:
    return []


@pytest.fixture
def scene(server: FakeServer, prepared: Prepared) -> ViewerScene:
    scene = ViewerScene(server, on_node=lambda node, pick, *, holdable: prepared.append((node, pick, holdable)))  # type: ignore[arg-type, misc]
    show(scene)
    return scene


def show(scene: ViewerScene, world: World = WORLD, looks: dict[BodyId, BodyAppearance] | None = None) -> None:
    ids = tuple(body.id for body in world.bodies)
    poses = pose_array(body.pose for body in world.bodies)
    scene.show(looks_of(world) if looks is None else looks, ids, poses, holdable={"Mug", "Drawer", "Mug7"})


def crowded(count: int = BATCH_SIZE) -> World:
    """So many mugs in a row, in a kitchen."""
    mug = WORLD.body("Mug")
    mugs = [replace(mug, id=BodyId(f"Mug{n}"), pose=Pose((n, 0.0, 5.0))) for n in range(count)]
    return replace(WORLD, bodies=(*WORLD.bodies, *mugs))


def state(server: FakeServer, name: str) -> dict[str, Any]:
    return vars(server.scene.nodes[name])


def guise(server: FakeServer, id: str) -> str:
    """In which guise a body is seen."""
    (shown,) = (
        kind
        for kind in ("seen", "plain")
        if f"/bodies/{id}/{kind}" in server.scene.nodes and state(server, f"/bodies/{id}/{kind}")["visible"]
    )
    return shown


# -- bodies with a node of their own -----------------------------------------------------------------------------------


def test_rows_that_moved_are_found() -> None:
    now = POSES.copy()
    now[3, 1] += 0.001
    now[6, 4] += 0.001
    assert moved_rows(POSES, now).tolist() == [3, 6]
    assert moved_rows(POSES, POSES + 1e-7).tolist() == []
    assert moved_rows(np.zeros((0, 7)), np.zeros((0, 7))).tolist() == []


def test_every_body_is_drawn_once_where_it_is(server: FakeServer, scene: ViewerScene) -> None:
    drawn = [name for name, what in server.scene.messages if what == "add" and name.startswith("/bodies/")]
    assert sorted(drawn) == sorted(name for id in IDS for name in (f"/bodies/{id}", f"/bodies/{id}/seen"))
    for row, id in enumerate(IDS):
        assert np.allclose(state(server, f"/bodies/{id}")["position"], POSES[row, :3])


def test_everything_but_the_building_answers_to_the_mouse(scene: ViewerScene, prepared: Prepared) -> None:
    told = {pick(None): holdable for _, pick, holdable in prepared}
    assert told == {id: id in ("Mug", "Drawer") for id in IDS if id != "Floor"}


def test_what_is_drawn_from_one_side_only_does_not_catch_the_mouse(scene: ViewerScene, prepared: Prepared) -> None:
    prepared.clear()
    show(scene, looks={**LOOKS, MUG: with_look(LOOKS[MUG], part=VisiblePart.INTERIOR)})
    assert prepared == []


def test_only_what_moved_is_sent(server: FakeServer, scene: ViewerScene) -> None:
    now = POSES.copy()
    now[IDS.index(MUG), 2] += 0.5
    with server.scene.recording() as heard:
        assert scene.move(now).tolist() == [IDS.index(MUG)]
    assert {name for name, _ in heard} == {"/bodies/Mug"}
    with server.scene.recording() as heard:
        assert len(scene.move(now.copy())) == 0
    assert heard == []


def test_creeping_is_sent_once_it_can_be_seen(scene: ViewerScene) -> None:
    sent = [len(scene.move(POSES + step * 1.1e-5)) for step in range(1, 13)]
    assert sum(count > 0 for count in sent) == 2


def test_a_quaternion_that_is_a_little_off_is_sent_as_a_rotation(server: FakeServer, scene: ViewerScene) -> None:
    off = POSES.copy()
    off[:, 3:] *= 1.01
    scene.move(off)
    turns = [vars(node)["wxyz"] for node in server.scene.nodes.values() if "wxyz" in vars(node)]
    assert len(turns) == len(IDS)
    assert np.linalg.norm(turns, axis=1) == pytest.approx(1.0)


def test_a_body_that_went_is_removed_and_one_that_came_is_drawn(server: FakeServer, scene: ViewerScene) -> None:
    other = replace(WORLD.body("Mug"), id=BodyId("Other"))
    bodies = (*(body for body in WORLD.bodies if body.id != MUG), other)
    with server.scene.recording() as heard:
        show(scene, replace(WORLD, bodies=bodies))
    assert ("/bodies/Mug", "remove") in heard
    assert [name for name, what in heard if what == "add"] == ["/bodies/Other", "/bodies/Other/seen"]


def test_a_body_that_looks_different_is_drawn_anew_and_no_other(server: FakeServer, scene: ViewerScene) -> None:
    with server.scene.recording() as heard:
        show(scene, looks={**LOOKS, MUG: with_look(LOOKS[MUG], key="other")})
    assert [name for name, what in heard if what == "add"] == ["/bodies/Mug", "/bodies/Mug/seen"]


def test_what_can_be_held_from_now_on_answers_to_the_mouse(scene: ViewerScene, prepared: Prepared) -> None:
    prepared.clear()
    scene.show(LOOKS, IDS, POSES, holdable={"Mug", "Drawer", "Fridge"})
    assert [(pick(None), holdable) for _, pick, holdable in prepared] == [("Fridge", True)]


def test_a_slash_in_an_id_makes_no_child(server: FakeServer, scene: ViewerScene) -> None:
    odd = replace(WORLD.body("Mug"), id=BodyId("Mug/../a b"))
    show(scene, replace(WORLD, bodies=(*WORLD.bodies, odd)))
    assert "/bodies/Mug%2F..%2Fa%20b" in server.scene.nodes


# -- highlights --------------------------------------------------------------------------------------------------------


def test_a_highlight_paints_the_lit_and_dims_the_rest(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_highlights({MUG: GREEN})
    assert (guise(server, "Mug"), guise(server, "Fridge")) == ("plain", "plain")
    assert state(server, "/bodies/Mug/plain")["color"] == (0, 255, 0)
    assert state(server, "/bodies/Mug/plain")["opacity"] is None
    assert max(state(server, "/bodies/Fridge/plain")["color"]) < 255
    with server.scene.recording() as heard:
        scene.set_highlights({MUG: GREEN})
    assert heard == []
    with server.scene.recording() as heard:
        scene.set_highlights({MUG: GREEN, FRIDGE: RED})
    assert {name for name, _ in heard} <= {"/bodies/Fridge/plain", "/bodies/Fridge/seen"}
    assert state(server, "/bodies/Fridge/plain")["color"] == (255, 0, 0)
    scene.set_highlights({})
    assert {guise(server, id) for id in IDS} == {"seen"}


def test_what_is_drawn_while_something_is_lit_is_dimmed_too(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_highlights({MUG: GREEN})
    show(scene, looks={**LOOKS, FRIDGE: with_look(LOOKS[FRIDGE], key="other")})
    assert guise(server, "Fridge") == "plain"


def test_what_something_lit_is_in_or_behind_is_seen_through(server: FakeServer, scene: ViewerScene) -> None:
    x, y, z = WORLD.body("Drawer").pose.position
    scene.set_initial_camera(CameraPose((x - 4.0, y, z), (x, y, z), 0.6))
    scene.set_highlights({BodyId("Drawer"): GREEN})
    assert state(server, "/bodies/Cupboard/plain")["opacity"] == OCCLUDER_OPACITY, "it is in there"
    assert state(server, "/bodies/DrawerHandle/plain")["opacity"] == OCCLUDER_OPACITY, "it is behind that"
    assert state(server, "/bodies/Fridge/plain")["opacity"] is None
    scene.set_highlights({FRIDGE: GREEN})
    assert state(server, "/bodies/Cupboard/plain")["opacity"] is None, "nothing is in there any more"


def test_a_lit_body_that_is_drawn_anew_stays_lit(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_highlights({MUG: GREEN})
    show(scene, looks={**LOOKS, MUG: with_look(LOOKS[MUG], key="other")})
    assert state(server, "/bodies/Mug/plain")["color"] == (0, 255, 0)


def test_the_node_that_lights_a_body_answers_to_the_mouse_too(scene: ViewerScene, prepared: Prepared) -> None:
    prepared.clear()
    scene.set_highlights({MUG: GREEN})
    assert "/bodies/Mug/plain" in [node.name for node, _, _ in prepared]


# -- crowds ------------------------------------------------------------------------------------------------------------


def test_many_that_look_alike_are_drawn_at_once(server: FakeServer, scene: ViewerScene, prepared: Prepared) -> None:
    prepared.clear()
    with server.scene.recording() as heard:
        show(scene, crowded())
    assert [name for name, what in heard if what == "add"].count("/crowds/1/seen") == 1
    assert not any("Mug1" in name for name in server.scene.nodes)
    # The one that can be held is no member: a crowd either can be held or it cannot.
    assert len(state(server, "/crowds/1/seen")["batched_positions"]) == BATCH_SIZE - 1
    (node, pick, holdable), *_ = prepared
    assert (node.name, holdable) == ("/crowds/1/seen", False)
    assert [pick(0), pick(6), pick(99), pick(None)] == ["Mug0", "Mug6", None, None]


def test_few_that_look_alike_are_not(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, crowded(BATCH_SIZE - 2))
    assert "/bodies/Mug1/seen" in server.scene.nodes


def test_a_crowd_is_cut_into_groups(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, crowded(300))
    sizes = [len(state(server, f"/crowds/{n}/seen")["batched_positions"]) for n in (1, 2, 3)]
    assert sum(sizes) == 299
    assert max(sizes) == 128


def test_one_of_a_crowd_moves_and_only_its_group_is_sent(server: FakeServer, scene: ViewerScene) -> None:
    world = crowded(300)
    show(scene, world)
    poses = pose_array(body.pose for body in world.bodies)
    row = [body.id for body in world.bodies].index(BodyId("Mug3"))
    poses[row, 2] = 9.0
    with server.scene.recording() as heard:
        scene.move(poses)
    assert {name for name, _ in heard} == {"/crowds/1/seen"}
    assert state(server, "/crowds/1/seen")["batched_positions"][3].tolist() == [3.0, 0.0, 9.0]


def test_one_of_a_crowd_is_lit_and_the_others_step_back(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, crowded())
    scene.set_highlights({BodyId("Mug3"): GREEN})
    plain = state(server, "/crowds/1/plain")
    assert state(server, "/crowds/1/seen")["visible"] is False
    assert plain["batched_colors"][3].tolist() == [0, 255, 0]
    assert all(max(color) < 255 for color in np.delete(plain["batched_colors"], 3, axis=0).tolist())
    scene.set_highlights({})
    assert state(server, "/crowds/1/seen")["visible"] is True
    assert len(state(server, "/crowds/1/seen")["batched_positions"]) == BATCH_SIZE - 1
    assert plain["visible"] is False


def test_who_leaves_a_crowd_is_missed_by_nobody_else(
    server: FakeServer, scene: ViewerScene, prepared: Prepared
) -> None:
    prepared.clear()
    world = crowded()
    show(scene, world)
    _, pick, _ = prepared[0]
    show(scene, replace(world, bodies=tuple(body for body in world.bodies if body.id != "Mug0")))
    assert state(server, "/crowds/1/seen")["batched_positions"][0].tolist() == [1.0, 0.0, 5.0]
    assert pick(0) == "Mug1"
    show(scene)
    assert not any(name.startswith("/crowds/") for name in server.scene.nodes)


# -- what is not to be seen --------------------------------------------------------------------------------------------


def test_what_is_hidden_is_not_drawn_until_it_is_shown_again(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, crowded())
    scene.hide(frozenset({MUG, BodyId("Mug3")}))
    assert state(server, "/bodies/Mug")["visible"] is False
    assert len(state(server, "/crowds/1/seen")["batched_positions"]) == BATCH_SIZE - 2
    show(scene, crowded(), looks=looks_of(crowded()) | {MUG: with_look(LOOKS[MUG], key="other")})
    assert state(server, "/bodies/Mug")["visible"] is False, "it is drawn anew, and hidden as before"
    scene.hide(frozenset())
    assert state(server, "/bodies/Mug")["visible"] is True
    assert len(state(server, "/crowds/1/seen")["batched_positions"]) == BATCH_SIZE - 1


def test_shells_are_lines_that_can_be_hidden(server: FakeServer, scene: ViewerScene) -> None:
    shell = replace(WORLD.body("Cupboard"), id=BodyId("Hall"), size=(30.0, 30.0, 9.0))
    show(scene, replace(WORLD, bodies=(*WORLD.bodies, shell)))
    lines, _ = state(server, "/bodies/Hall/outline")["content"]
    assert len(lines) == 12
    scene.show_enclosures(False)
    assert state(server, "/bodies/Hall")["visible"] is False
    scene.show_enclosures(True)
    assert state(server, "/bodies/Hall")["visible"] is True


# -- the place ---------------------------------------------------------------------------------------------------------


def test_the_ground_comes_and_goes(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_ground(-0.5)
    assert state(server, "/ground")["position"] == (0.0, 0.0, -0.5)
    scene.set_ground(None)
    assert server.scene.messages[-1] == ("/ground", "remove")


def test_the_sun_stands_behind_the_visitor(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_initial_camera(CameraPose((5.0, 1.0, 3.0), (0.0, 0.0, 0.0), 0.7))
    x, _, z = state(server, "/sun")["position"]
    assert x > 0.0
    assert z > 0.0
    assert vars(server.initial_camera)["position"] == (5.0, 1.0, 3.0)


def test_a_lamp_shines_where_it_is_and_goes_with_it(server: FakeServer, scene: ViewerScene) -> None:
    skins = LOOKS[MUG].visuals
    glowing = BodyGeometry(
        "glowing", skins, (), lights=(AttachedLight(pose=Pose((0.0, 0.0, -0.1)), color=(1.0, 0.5, 0.0)),)
    )
    show(scene, looks=looks_of(WORLD, {MUG: glowing}))
    lamp = state(server, "/lamps/Mug")
    assert lamp["color"] == (255, 128, 0)
    assert lamp["position"] == pytest.approx([2.0, 0.0, 0.75])
    poses = POSES.copy()
    poses[IDS.index(MUG), 2] += 1.0
    scene.move(poses)
    assert lamp["position"] == pytest.approx([2.0, 0.0, 1.75])
    show(scene)
    assert "/lamps/Mug" not in server.scene.nodes


def test_of_many_lamps_the_brightest_are_lit(server: FakeServer, scene: ViewerScene) -> None:
    skins = LOOKS[MUG].visuals
    world = crowded()
    forms = {
        BodyId(f"Mug{n}"): BodyGeometry(f"{n}", skins, (), lights=(AttachedLight(intensity=float(n)),))
        for n in range(BATCH_SIZE)
    }
    show(scene, world, looks=looks_of(world, forms))
    lamps = [name for name in server.scene.nodes if name.startswith("/lamps/")]
    assert sorted(lamps) == sorted(f"/lamps/Mug{n}" for n in range(BATCH_SIZE - 3, BATCH_SIZE))
