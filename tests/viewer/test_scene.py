"""The 3D scene, with a fake server that records messages."""

from __future__ import annotations

from dataclasses import replace as replace_appearance
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.rendering.appearance import OCCLUDER_OPACITY, BodyAppearance, VisiblePart, compute_appearance
from mindstage.rendering.camera import CameraPose
from mindstage.scene import AttachedLight, BodyGeometry, BodyId, Pose, World
from mindstage.scene.geometry import NO_GEOMETRY, GeometryMap
from mindstage.scene.transforms import pose_array
from mindstage.viewer.scene import BATCH_SIZE, ViewerScene, moved_rows
from tests.kitchenette import kitchenette
from tests.viewer.fake_server import FakeNode, FakeServer

KNOWLEDGE = KnowledgeBase()
WORLD = kitchenette()
IDS = tuple(body.id for body in WORLD.bodies)
POSES = pose_array(body.pose for body in WORLD.bodies)
MUG, FRIDGE = BodyId("Mug"), BodyId("Fridge")
GREEN, RED = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)


def appearances_of(world: World, geometry: GeometryMap = NO_GEOMETRY) -> dict[BodyId, BodyAppearance]:
    return compute_appearance(world, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors, geometry=geometry)


APPEARANCES = appearances_of(WORLD)

ClickableNodes = list[tuple[FakeNode, Any, bool]]


@pytest.fixture
def server() -> FakeServer:
    return FakeServer()


@pytest.fixture
def clickable() -> ClickableNodes:
    return []


@pytest.fixture
def scene(server: FakeServer, clickable: ClickableNodes) -> ViewerScene:
    scene = ViewerScene(server, on_node=lambda node, pick, *, draggable: clickable.append((node, pick, draggable)))  # type: ignore[arg-type, misc]
    show(scene)
    return scene


def show(scene: ViewerScene, world: World = WORLD, appearances: dict[BodyId, BodyAppearance] | None = None) -> None:
    ids = tuple(body.id for body in world.bodies)
    poses = pose_array(body.pose for body in world.bodies)
    scene.show(
        appearances_of(world) if appearances is None else appearances, ids, poses, draggable={"Mug", "Drawer", "Mug7"}
    )


def many_mugs(count: int = BATCH_SIZE) -> World:
    """The kitchen with a row of mugs."""
    mug = WORLD.body("Mug")
    mugs = [replace(mug, id=BodyId(f"Mug{n}"), pose=Pose((n, 0.0, 5.0))) for n in range(count)]
    return replace(WORLD, bodies=(*WORLD.bodies, *mugs))


def state(server: FakeServer, name: str) -> dict[str, Any]:
    return vars(server.scene.nodes[name])


def variant(server: FakeServer, id: str) -> str:
    """The visible variant of a body's node."""
    (shown,) = (
        kind
        for kind in ("textured", "plain")
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
    assert sorted(drawn) == sorted(name for id in IDS for name in (f"/bodies/{id}", f"/bodies/{id}/textured"))
    for row, id in enumerate(IDS):
        assert np.allclose(state(server, f"/bodies/{id}")["position"], POSES[row, :3])


def test_everything_but_the_building_is_clickable(scene: ViewerScene, clickable: ClickableNodes) -> None:
    registered = {pick(None): draggable for _, pick, draggable in clickable}
    assert registered == {id: id in ("Mug", "Drawer") for id in IDS if id != "Floor"}


def test_one_sided_bodies_are_not_clickable(scene: ViewerScene, clickable: ClickableNodes) -> None:
    clickable.clear()
    show(scene, appearances={**APPEARANCES, MUG: replace_appearance(APPEARANCES[MUG], part=VisiblePart.INTERIOR)})
    assert clickable == []


def test_only_what_moved_is_sent(server: FakeServer, scene: ViewerScene) -> None:
    now = POSES.copy()
    now[IDS.index(MUG), 2] += 0.5
    with server.scene.recording() as messages:
        assert scene.move(now).tolist() == [IDS.index(MUG)]
    assert {name for name, _ in messages} == {"/bodies/Mug"}
    with server.scene.recording() as messages:
        assert len(scene.move(now.copy())) == 0
    assert messages == []


def test_slow_motion_is_sent_once_it_exceeds_the_tolerance(scene: ViewerScene) -> None:
    sent = [len(scene.move(POSES + step * 1.1e-5)) for step in range(1, 13)]
    assert sum(count > 0 for count in sent) == 2


def test_quaternions_are_normalized_before_they_are_sent(server: FakeServer, scene: ViewerScene) -> None:
    off = POSES.copy()
    off[:, 3:] *= 1.01
    scene.move(off)
    quaternions = [vars(node)["wxyz"] for node in server.scene.nodes.values() if "wxyz" in vars(node)]
    assert len(quaternions) == len(IDS)
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0)


def test_removed_bodies_are_removed_and_new_ones_drawn(server: FakeServer, scene: ViewerScene) -> None:
    other = replace(WORLD.body("Mug"), id=BodyId("Other"))
    bodies = (*(body for body in WORLD.bodies if body.id != MUG), other)
    with server.scene.recording() as messages:
        show(scene, replace(WORLD, bodies=bodies))
    assert ("/bodies/Mug", "remove") in messages
    assert [name for name, what in messages if what == "add"] == ["/bodies/Other", "/bodies/Other/textured"]


def test_only_bodies_of_changed_appearance_are_redrawn(server: FakeServer, scene: ViewerScene) -> None:
    with server.scene.recording() as messages:
        show(scene, appearances={**APPEARANCES, MUG: replace_appearance(APPEARANCES[MUG], key="other")})
    assert [name for name, what in messages if what == "add"] == ["/bodies/Mug", "/bodies/Mug/textured"]


def test_newly_draggable_bodies_become_clickable(scene: ViewerScene, clickable: ClickableNodes) -> None:
    clickable.clear()
    scene.show(APPEARANCES, IDS, POSES, draggable={"Mug", "Drawer", "Fridge"})
    assert [(pick(None), draggable) for _, pick, draggable in clickable] == [("Fridge", True)]


def test_a_slash_in_an_id_makes_no_child(server: FakeServer, scene: ViewerScene) -> None:
    odd = replace(WORLD.body("Mug"), id=BodyId("Mug/../a b"))
    show(scene, replace(WORLD, bodies=(*WORLD.bodies, odd)))
    assert "/bodies/Mug%2F..%2Fa%20b" in server.scene.nodes


# -- highlights --------------------------------------------------------------------------------------------------------


def test_a_highlight_paints_its_body_and_dims_all_others(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_highlights({MUG: GREEN})
    assert (variant(server, "Mug"), variant(server, "Fridge")) == ("plain", "plain")
    assert state(server, "/bodies/Mug/plain")["color"] == (0, 255, 0)
    assert state(server, "/bodies/Mug/plain")["opacity"] is None
    assert max(state(server, "/bodies/Fridge/plain")["color"]) < 255
    with server.scene.recording() as messages:
        scene.set_highlights({MUG: GREEN})
    assert messages == []
    with server.scene.recording() as messages:
        scene.set_highlights({MUG: GREEN, FRIDGE: RED})
    assert {name for name, _ in messages} <= {"/bodies/Fridge/plain", "/bodies/Fridge/textured"}
    assert state(server, "/bodies/Fridge/plain")["color"] == (255, 0, 0)
    scene.set_highlights({})
    assert {variant(server, id) for id in IDS} == {"textured"}


def test_bodies_drawn_during_a_highlight_are_dimmed(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_highlights({MUG: GREEN})
    show(scene, appearances={**APPEARANCES, FRIDGE: replace_appearance(APPEARANCES[FRIDGE], key="other")})
    assert variant(server, "Fridge") == "plain"


def test_occluders_of_highlighted_bodies_are_transparent(server: FakeServer, scene: ViewerScene) -> None:
    x, y, z = WORLD.body("Drawer").pose.position
    scene.set_initial_camera(CameraPose((x - 4.0, y, z), (x, y, z), 0.6))
    scene.set_highlights({BodyId("Drawer"): GREEN})
    assert state(server, "/bodies/Cupboard/plain")["opacity"] == OCCLUDER_OPACITY, "it contains the drawer"
    assert state(server, "/bodies/DrawerHandle/plain")["opacity"] == OCCLUDER_OPACITY, "it is in front of the drawer"
    assert state(server, "/bodies/Fridge/plain")["opacity"] is None
    scene.set_highlights({FRIDGE: GREEN})
    assert state(server, "/bodies/Cupboard/plain")["opacity"] is None, "it occludes nothing"


def test_a_redrawn_body_keeps_its_highlight(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_highlights({MUG: GREEN})
    show(scene, appearances={**APPEARANCES, MUG: replace_appearance(APPEARANCES[MUG], key="other")})
    assert state(server, "/bodies/Mug/plain")["color"] == (0, 255, 0)


def test_the_node_of_a_highlighted_body_is_clickable(scene: ViewerScene, clickable: ClickableNodes) -> None:
    clickable.clear()
    scene.set_highlights({MUG: GREEN})
    assert "/bodies/Mug/plain" in [node.name for node, _, _ in clickable]


# -- batches -----------------------------------------------------------------------------------------------------------


def test_many_bodies_of_equal_appearance_share_a_batch(
    server: FakeServer, scene: ViewerScene, clickable: ClickableNodes
) -> None:
    clickable.clear()
    with server.scene.recording() as messages:
        show(scene, many_mugs())
    assert [name for name, what in messages if what == "add"].count("/batches/1/textured") == 1
    assert not any("Mug1" in name for name in server.scene.nodes)
    # The draggable mug is no member: all members of a batch are draggable, or none.
    assert len(state(server, "/batches/1/textured")["batched_positions"]) == BATCH_SIZE - 1
    (node, pick, draggable), *_ = clickable
    assert (node.name, draggable) == ("/batches/1/textured", False)
    assert [pick(0), pick(6), pick(99), pick(None)] == ["Mug0", "Mug6", None, None]


def test_few_bodies_of_equal_appearance_do_not(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, many_mugs(BATCH_SIZE - 2))
    assert "/bodies/Mug1/textured" in server.scene.nodes


def test_the_size_of_batches_is_limited(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, many_mugs(300))
    sizes = [len(state(server, f"/batches/{n}/textured")["batched_positions"]) for n in (1, 2, 3)]
    assert sum(sizes) == 299
    assert max(sizes) == 128


def test_a_moving_body_updates_only_its_batch(server: FakeServer, scene: ViewerScene) -> None:
    world = many_mugs(300)
    show(scene, world)
    poses = pose_array(body.pose for body in world.bodies)
    row = [body.id for body in world.bodies].index(BodyId("Mug3"))
    poses[row, 2] = 9.0
    with server.scene.recording() as messages:
        scene.move(poses)
    assert {name for name, _ in messages} == {"/batches/1/textured"}
    assert state(server, "/batches/1/textured")["batched_positions"][3].tolist() == [3.0, 0.0, 9.0]


def test_a_highlight_in_a_batch_dims_its_other_members(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, many_mugs())
    scene.set_highlights({BodyId("Mug3"): GREEN})
    plain = state(server, "/batches/1/plain")
    assert state(server, "/batches/1/textured")["visible"] is False
    assert plain["batched_colors"][3].tolist() == [0, 255, 0]
    assert all(max(color) < 255 for color in np.delete(plain["batched_colors"], 3, axis=0).tolist())
    scene.set_highlights({})
    assert state(server, "/batches/1/textured")["visible"] is True
    assert len(state(server, "/batches/1/textured")["batched_positions"]) == BATCH_SIZE - 1
    assert plain["visible"] is False
    # The hidden node keeps its instances: the page cannot draw one without any.
    assert 0 < len(plain["batched_positions"]) == len(plain["batched_colors"]) == len(plain["batched_opacities"])


def test_a_body_that_comes_back_after_its_highlight_ended_is_not_highlighted(
    server: FakeServer, scene: ViewerScene
) -> None:
    world = many_mugs()
    show(scene, world)
    scene.set_highlights({MUG: GREEN})
    assert variant(server, "Mug") == "plain"
    scene.set_highlights({})
    show(scene, replace(world, bodies=tuple(body for body in world.bodies if body.id != MUG)))
    show(scene, world)
    assert variant(server, "Mug") == "textured"


def test_removing_a_member_keeps_the_rest_of_the_batch(
    server: FakeServer, scene: ViewerScene, clickable: ClickableNodes
) -> None:
    clickable.clear()
    world = many_mugs()
    show(scene, world)
    _, pick, _ = clickable[0]
    show(scene, replace(world, bodies=tuple(body for body in world.bodies if body.id != "Mug0")))
    assert state(server, "/batches/1/textured")["batched_positions"][0].tolist() == [1.0, 0.0, 5.0]
    assert pick(0) == "Mug1"
    show(scene)
    assert not any(name.startswith("/batches/") for name in server.scene.nodes)


def test_bodies_are_found_in_their_nodes_and_batches(scene: ViewerScene) -> None:
    show(scene, many_mugs())
    wanted = [MUG, BodyId("Mug2"), BodyId("Mug4"), BodyId("nobody")]
    assert scene.instances(wanted) == {"/bodies/Mug": [], "/batches/1/textured": [2, 4]}
    scene.set_highlights({BodyId("Mug4"): GREEN})
    assert scene.instances(wanted) == {"/bodies/Mug": [], "/batches/1/plain": [2, 4]}
    scene.hide(frozenset({BodyId("Mug0")}))
    assert scene.instances(wanted[1:2]) == {"/batches/1/plain": [1]}


# -- hidden bodies -----------------------------------------------------------------------------------------------------


def test_hidden_bodies_stay_hidden_until_they_are_shown(server: FakeServer, scene: ViewerScene) -> None:
    show(scene, many_mugs())
    scene.hide(frozenset({MUG, BodyId("Mug3")}))
    assert state(server, "/bodies/Mug")["visible"] is False
    assert len(state(server, "/batches/1/textured")["batched_positions"]) == BATCH_SIZE - 2
    show(
        scene,
        many_mugs(),
        appearances=appearances_of(many_mugs()) | {MUG: replace_appearance(APPEARANCES[MUG], key="other")},
    )
    assert state(server, "/bodies/Mug")["visible"] is False, "a redrawn body stays hidden"
    scene.hide(frozenset())
    assert state(server, "/bodies/Mug")["visible"] is True
    assert len(state(server, "/batches/1/textured")["batched_positions"]) == BATCH_SIZE - 1


def test_enclosures_are_lines_that_can_be_hidden(server: FakeServer, scene: ViewerScene) -> None:
    shell = replace(WORLD.body("Cupboard"), id=BodyId("Hall"), size=(30.0, 30.0, 9.0))
    show(scene, replace(WORLD, bodies=(*WORLD.bodies, shell)))
    lines, _ = state(server, "/bodies/Hall/outline")["content"]
    assert len(lines) == 12
    scene.show_enclosures(False)
    assert state(server, "/bodies/Hall")["visible"] is False
    scene.show_enclosures(True)
    assert state(server, "/bodies/Hall")["visible"] is True


# -- surroundings ------------------------------------------------------------------------------------------------------


def test_the_ground_is_shown_and_removed(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_ground(-0.5)
    ground = state(server, "/ground")
    assert ground["position"] == pytest.approx((0.0, 0.0, -0.5), abs=0.01)
    assert ground["position"][2] < -0.5, "below the bodies, or their lower sides would flicker"
    assert (ground["cell_thickness"], ground["section_thickness"]) == (0.0, 0.0), "no lines"
    assert ground["shadow_opacity"] > 0.0
    scene.set_ground(None)
    assert server.scene.messages[-1] == ("/ground", "remove")


def test_the_sun_is_behind_the_camera(server: FakeServer, scene: ViewerScene) -> None:
    scene.set_initial_camera(CameraPose((5.0, 1.0, 3.0), (0.0, 0.0, 0.0), 0.7))
    x, _, z = state(server, "/sun")["position"]
    assert x > 0.0
    assert z > 0.0
    assert vars(server.initial_camera)["position"] == (5.0, 1.0, 3.0)


def test_an_attached_light_moves_with_its_body(server: FakeServer, scene: ViewerScene) -> None:
    visuals = APPEARANCES[MUG].visuals
    glowing = BodyGeometry(
        "glowing", visuals, (), lights=(AttachedLight(pose=Pose((0.0, 0.0, -0.1)), color=(1.0, 0.5, 0.0)),)
    )
    show(scene, appearances=appearances_of(WORLD, {MUG: glowing}))
    light = state(server, "/lights/Mug")
    assert light["color"] == (255, 128, 0)
    assert light["position"] == pytest.approx([2.0, 0.0, 0.75])
    poses = POSES.copy()
    poses[IDS.index(MUG), 2] += 1.0
    scene.move(poses)
    assert light["position"] == pytest.approx([2.0, 0.0, 1.75])
    show(scene)
    assert "/lights/Mug" not in server.scene.nodes


def test_only_the_brightest_lights_are_created(server: FakeServer, scene: ViewerScene) -> None:
    visuals = APPEARANCES[MUG].visuals
    world = many_mugs()
    geometry = {
        BodyId(f"Mug{n}"): BodyGeometry(f"{n}", visuals, (), lights=(AttachedLight(intensity=float(n)),))
        for n in range(BATCH_SIZE)
    }
    show(scene, world, appearances=appearances_of(world, geometry))
    lights = [name for name in server.scene.nodes if name.startswith("/lights/")]
    assert sorted(lights) == sorted(f"/lights/Mug{n}" for n in range(BATCH_SIZE - 3, BATCH_SIZE))
