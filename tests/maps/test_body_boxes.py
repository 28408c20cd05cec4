"""Boxes of bodies in maps of Unreal's loggers: sizes of classes measured along the world's axes, poses of pivots."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import Phase, assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mindstage.assets import MeshLibrary
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import SizeFrame, UnitConventions, lost_statements, save_map
from mindstage.maps.dialects.body_boxes import boxes_with_bounds
from mindstage.scene import Body, Pose, World, diff
from mindstage.scene.transforms import normalize, rotation_matrix
from tests.cases import each_case
from tests.maps.logged_maps import LoggedBody, individual_id, logged_map, world_bounds_of, yaw
from tests.maps.small_maps import assert_worlds_equal, knowledge_base_from, knowrob_iri

ReadLogged = Callable[..., KnowledgeBase]

FRONT = LoggedBody("front", "FridgeDoorPanel", (0.02, 0.6, 0.96), (0.31, 0.0, 1.0))
HANDLE = LoggedBody(
    "handle", "HandleW86", (0.06, 0.855, 0.015), (0.35, -0.25, 1.0), (0.707107, 0.707107, 0.0, 0.0), parent="front"
)
FRAME = LoggedBody("frame", "PosterFrame", (0.01, 0.8, 1.0), (0.0, -3.0, 2.0))
POSTER = LoggedBody("poster", "Poster", (0.8, 0.005, 1.0), (0.0, -3.0, 2.0), yaw(90))
DOOR = LoggedBody("door", "LabDoor", (0.153, 1.17, 2.14), (3.0, 3.0, 1.08), yaw(100))


@pytest.fixture
def read_logged(tmp_path: Path) -> ReadLogged:
    """Reads a logged map, with a choice of the frame of its sizes."""

    def read(text: str, sizes: SizeFrame | None = None) -> KnowledgeBase:
        path = tmp_path / "logged.ttl"
        path.write_text(text, encoding="utf-8")
        knowledge = KnowledgeBase(bundled_ontology=False)
        knowledge.load(path, conventions=UnitConventions(sizes=sizes))
        return knowledge

    return read


def assumed(knowledge: KnowledgeBase, topic: str) -> str | None:
    knowledge.world()
    return next((each.value for each in knowledge.assumptions() if each.topic == topic), None)


def body_of(knowledge: KnowledgeBase, logged: LoggedBody, *, with_ids: bool = True) -> Body:
    return knowledge.world().body(individual_id(logged.name) if with_ids else logged.name)


def assert_box(body: Body, box: tuple[float, ...], tolerance: float = 5e-5) -> None:
    assert body.size is not None
    assert np.allclose(body.size, box, atol=tolerance), (body, body.size, box)


# -- sizes -------------------------------------------------------------------------------------------------------------


def test_a_handle_that_was_logged_turned_lies_along_its_door(read_logged: ReadLogged) -> None:
    knowledge = read_logged(logged_map([FRONT, HANDLE]))
    assert_box(body_of(knowledge, HANDLE), HANDLE.box)
    assert_box(body_of(knowledge, FRONT), FRONT.box)


def test_two_boxes_that_fit_equally_well_are_a_finding(read_logged: ReadLogged) -> None:
    """Nothing shows which of two bins was measured: the first one counts."""
    bins = [LoggedBody(f"bin{n}", "WasteBin", (0.3, 0.5, 0.4), (4 * n, 0.0, 0.2), yaw(90 * n)) for n in (0, 1)]
    knowledge = read_logged(logged_map(bins), SizeFrame.WORLD)
    assert_box(body_of(knowledge, bins[0]), bins[0].box)
    texts = [each.problem for each in knowledge.findings() if each.individual.endswith("WasteBin")]
    assert [text for text in texts if "0.3 x 0.5 x 0.4 m and 0.5 x 0.3 x 0.4 m" in text], texts


def test_a_poster_is_in_the_plane_of_its_frame(read_logged: ReadLogged) -> None:
    knowledge = read_logged(logged_map([FRAME, POSTER]))
    assert_box(body_of(knowledge, POSTER), POSTER.box)


def test_a_door_that_stands_ajar_gets_its_thickness_back(read_logged: ReadLogged) -> None:
    knowledge = read_logged(logged_map([FRAME, DOOR]))
    assert_box(body_of(knowledge, DOOR), DOOR.box)
    assert assumed(knowledge, "sizes") == "world"


def test_the_decision_is_an_assumption_with_its_evidence(read_logged: ReadLogged) -> None:
    knowledge = read_logged(logged_map([FRONT, HANDLE, DOOR]))
    knowledge.world()
    (assumption,) = [each for each in knowledge.assumptions() if each.topic == "sizes"]
    assert "bodies of 1 class would lie across their neighbors (HandleW86)" in assumption.evidence
    assert "LabDoor 1.18 x 0.354 x 2.14 to 0.153 x 1.17 x 2.14 m" in assumption.evidence
    assert not assumption.overridden


@pytest.mark.parametrize("with_ids", [True, False])
def test_newer_maps_are_not_changed(read_logged: ReadLogged, with_ids: bool) -> None:
    bodies = [FRONT, HANDLE, FRAME, POSTER, DOOR]
    knowledge = read_logged(logged_map(bodies, in_body_frame=True, with_ids=with_ids))
    for body in bodies:
        assert_box(body_of(knowledge, body, with_ids=with_ids), body.box)
    assert assumed(knowledge, "sizes") == "body"


@pytest.mark.parametrize(("date", "frame"), [("2021-06-14", "world"), ("2021-06-15", "body"), ("2022.01.31", "body")])
def test_the_date_in_the_header_decides(read_logged: ReadLogged, date: str, frame: str) -> None:
    knowledge = read_logged(logged_map([DOOR], f':room rdfs:comment "logged {date} 12:00" .'))
    assert assumed(knowledge, "sizes") == frame


def test_a_map_of_another_origin_needs_more_evidence(read_logged: ReadLogged) -> None:
    assert assumed(read_logged(logged_map([FRONT, DOOR], with_ids=False)), "sizes") == "body"


def test_maps_in_which_nothing_is_turned_have_no_assumption(read_logged: ReadLogged) -> None:
    assert assumed(read_logged(logged_map([FRONT, FRAME])), "sizes") is None


@pytest.mark.parametrize("frame", SizeFrame)
def test_the_user_decides(read_logged: ReadLogged, tmp_path: Path, frame: SizeFrame) -> None:
    opposite = {"body": [FRONT, HANDLE, POSTER, FRAME], "world": [FRONT, DOOR]}[frame.value]
    knowledge = read_logged(logged_map(opposite, with_ids=frame is SizeFrame.BODY), frame)
    assert assumed(knowledge, "sizes") == frame.value
    (assumption,) = [each for each in knowledge.assumptions() if each.topic == "sizes"]
    assert assumption.overridden
    turned = opposite[1]
    expected = world_bounds_of(turned) if frame is SizeFrame.BODY else turned.box
    assert_box(body_of(knowledge, turned, with_ids=frame is SizeFrame.BODY), tuple(expected))
    for source_view in (None, knowledge.source_view()):
        save_map(knowledge.world(), tmp_path / "out.ttl", source_view=source_view)
        assert_worlds_equal(knowledge.world(), knowledge_base_from(tmp_path / "out.ttl").world())


@pytest.mark.parametrize("frame", SizeFrame)
def test_a_map_may_declare_its_frame(read_logged: ReadLogged, tmp_path: Path, frame: SizeFrame) -> None:
    knowledge = read_logged(logged_map([FRONT, HANDLE], f':room ms:sizes "{frame.value}" .'))
    expected = HANDLE.box if frame is SizeFrame.WORLD else tuple(world_bounds_of(HANDLE))
    assert_box(body_of(knowledge, HANDLE), expected)
    save_map(knowledge.world(), tmp_path / "out.ttl", source_view=knowledge.source_view())
    back = knowledge_base_from(tmp_path / "out.ttl")
    assert_worlds_equal(knowledge.world(), back.world())
    assert lost_statements(knowledge.source_view(), back.source_view()) == ()


def test_an_invalid_declaration_is_reported(read_logged: ReadLogged) -> None:
    knowledge = read_logged(logged_map([FRONT, HANDLE], ':room ms:sizes "mesh" .'))
    assert_box(body_of(knowledge, HANDLE), HANDLE.box)
    assert any("'mesh' is not one of body, world" in finding.problem for finding in knowledge.findings())


def test_numbers_that_no_box_has_are_kept_and_reported(read_logged: ReadLogged) -> None:
    flat = LoggedBody("flat", "Tray", (0.4, 0.01, 0.02), (1.0, 1.0, 1.0), yaw(30))
    text = logged_map([flat], in_body_frame=True)
    knowledge = read_logged(text, SizeFrame.WORLD)
    assert_box(body_of(knowledge, flat), flat.box)
    (finding,) = knowledge.findings()
    assert finding.individual == knowrob_iri("Tray")
    assert "no box has the world-aligned bounds 0.4 x 0.01 x 0.02 m" in finding.problem


def test_the_neighbors_choose_among_individuals(read_logged: ReadLogged) -> None:
    """The first handle in the map is not the one that gave the class its size."""
    side = LoggedBody("side", "SidePanel", (0.02, 0.6, 0.9), (1.0, 0.3, 1.0), yaw(90))
    lying = LoggedBody("lying", "Handle", (0.06, 0.5, 0.015), (0.35, 0.0, 1.2), parent="front")
    turned = LoggedBody("turned", "Handle", lying.box, (1.0, 0.35, 1.0), yaw(90), parent="side")
    text = logged_map([turned, FRONT, side, lying])
    first, second = (individual_id(name) for name in ("turned", "lying"))
    for old, new in ((first, "TMP"), (second, first), ("TMP", second)):  # the individuals change places
        text = text.replace(old, new)
    knowledge = read_logged(text.replace(f"k:parent :{individual_id('front')}", "k:parent :X"))
    assert knowledge.world().body(first).size == pytest.approx(lying.box, abs=1e-6)


def test_without_neighbors_the_first_individual_counts(read_logged: ReadLogged) -> None:
    first = LoggedBody("first", "Crate", (0.9, 0.4, 0.5), (0.0, 0.0, 1.0), yaw(90))
    second = LoggedBody("second", "Crate", (0.9, 0.4, 0.5), (9.0, 0.0, 1.0))
    knowledge = read_logged(logged_map([first, second]))
    assert_box(body_of(knowledge, second), first.box)


@pytest.mark.parametrize(
    ("cls", "box"), [("WallPoster", (0.8, 0.01, 1.0)), ("Cup", (0.08, 0.08, 0.1))], ids=["a pane", "a cup"]
)
def test_a_turn_by_45_degrees_is_resolved_by_the_kind_of_thing(
    read_logged: ReadLogged, cls: str, box: tuple[float, float, float]
) -> None:
    tilted = LoggedBody("tilted", cls, box, (0.0, 0.0, 1.0), yaw(45))
    knowledge = read_logged(logged_map([tilted, HANDLE, FRONT]), SizeFrame.WORLD)
    size = body_of(knowledge, tilted).size
    assert size is not None
    assert sorted(size) == pytest.approx(sorted(box), abs=1e-4)


def test_a_turn_by_45_degrees_is_resolved_by_the_frame_that_a_poster_hangs_in(read_logged: ReadLogged) -> None:
    frame = LoggedBody("frame45", "Holder", (0.02, 0.85, 1.0), (0.0, 0.0, 1.0), yaw(135))
    poster = LoggedBody("poster45", "Sheet", (0.8, 0.01, 1.0), (0.0, 0.0, 1.0), yaw(45))
    other = LoggedBody("holder", "Holder", (0.02, 0.85, 1.0), (5.0, 0.0, 1.0))
    knowledge = read_logged(logged_map([other, frame, poster, HANDLE, FRONT]))
    assert_box(body_of(knowledge, poster), poster.box)


# -- synthetic loggers -------------------------------------------------------------------------------------------------

EXTENT = st.floats(0.005, 2.0)
COMPONENT = st.floats(-1.0, 1.0)
QUATERNION = st.tuples(COMPONENT, COMPONENT, COMPONENT, COMPONENT).filter(lambda q: np.linalg.norm(q) > 0.1)


@settings(max_examples=150, deadline=None)
@given(box=st.tuples(EXTENT, EXTENT, EXTENT), quaternion=QUATERNION)
def test_the_boxes_found_have_the_bounds_that_were_logged(
    box: tuple[float, float, float], quaternion: tuple[float, ...]
) -> None:
    absolute = np.abs(rotation_matrix(normalize(quaternion)))
    bounds = absolute @ np.array(box)
    found = boxes_with_bounds(absolute, bounds)
    assert len(found)
    assert np.all(found >= 0.0)
    assert np.allclose(found @ absolute.T, bounds, atol=1e-2 * max(box))
    if np.linalg.svd(absolute, compute_uv=False)[2] > 0.01:  # otherwise there are several boxes
        assert np.allclose(found[0], box, atol=1e-6)


@each_case("rotation", Rotation.create_group("O").as_matrix(), ids=str)
def test_turns_by_right_angles_permute_the_extents(rotation: np.ndarray) -> None:
    box = np.array([0.06, 0.855, 0.015])
    absolute = np.rint(np.abs(rotation))
    assert boxes_with_bounds(absolute, absolute @ box).tolist() == [box.tolist()]


@pytest.mark.parametrize("seed", range(3))
def test_cutlery_on_tables_is_not_read_as_bricks(read_logged: ReadLogged, seed: int) -> None:
    random = np.random.default_rng(seed)
    kinds = {"Spoon": (0.18, 0.03, 0.02), "Knife": (0.21, 0.02, 0.01), "Tray": (0.4, 0.3, 0.02), "Box": (0.2, 0.1, 0.3)}
    bodies = [
        LoggedBody(f"{cls}{n}", cls, box, (float(n), float(at), 1.0), yaw(float(random.uniform(10, 80))))
        for at, (cls, box) in enumerate(kinds.items())
        for n in range(2)
    ]
    knowledge = read_logged(logged_map(bodies, *(f':{individual_id(b.name)} k:maskColor "FF" .' for b in bodies)))
    wrong = [body for body in bodies if not np.allclose(body_of(knowledge, body).size, body.box, atol=1e-4)]
    assert wrong == []


@settings(max_examples=15, deadline=None)
@given(
    boxes=st.lists(st.tuples(st.tuples(EXTENT, EXTENT, EXTENT), QUATERNION, QUATERNION), min_size=1, max_size=4),
)
def test_what_an_old_logger_wrote_gives_its_bodies_back(
    boxes: list[tuple[tuple[float, float, float], tuple[float, ...], tuple[float, ...]]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    bodies: list[LoggedBody] = []
    for number, (box, first, second) in enumerate(boxes):
        assume(np.linalg.svd(np.abs(rotation_matrix(normalize(first))), compute_uv=False)[2] > 0.02)
        for name, quaternion in ((f"a{number}", normalize(first)), (f"b{number}", normalize(second))):
            at = (10.0 * len(bodies), 0.0, 5.0)  # without neighbors
            bodies.append(LoggedBody(name, f"Thing{number}", box, at, tuple(quaternion.tolist())))
    folder = tmp_path_factory.mktemp("logged")
    (folder / "map.ttl").write_text(logged_map(bodies), encoding="utf-8")
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(folder / "map.ttl", conventions=UnitConventions(sizes=SizeFrame.WORLD))
    for body in bodies:
        assert_box(body_of(knowledge, body), body.box, tolerance=1e-3 * max(body.box))
    save_map(knowledge.world(), folder / "out.ttl", source_view=knowledge.source_view())
    back = knowledge_base_from(folder / "out.ttl")
    assert_worlds_equal(knowledge.world(), back.world())
    assert lost_statements(knowledge.source_view(), back.source_view()) == ()


# -- pivots ------------------------------------------------------------------------------------------------------------

FLOOR = LoggedBody("floor", "LabFloor", (6.0, 6.0, 0.2), (0.0, 0.0, -0.1), pivot=(0.0, 0.0, 0.1))
CUPBOARDS = [LoggedBody(f"cupboard{n}", "Cupboard", (0.6, 0.6, 0.9), (n - 2.0, 2.0, 0.45)) for n in range(3)]
WALLS = [
    LoggedBody("wall0", "LabWall", (0.2, 6.0, 2.5), (-3.0, 0.0, 1.25), pivot=(0.0, 0.0, -1.25)),
    LoggedBody("wall1", "LabWall", (0.2, 6.0, 2.5), (0.0, 3.0, 1.25), yaw(90), pivot=(0.0, 0.0, -1.25)),
]
CUPS = [
    LoggedBody(f"cup{n}", "Cup", (0.08, 0.08, 0.1), (n - 2.0, 2.1, 0.95), yaw(20.0 * n), pivot=(0.0, 0.0, -0.05))
    for n in range(3)
]
ROOM = [FLOOR, *CUPBOARDS, *WALLS, *CUPS]


def test_poses_of_pivots_become_those_of_centers(read_logged: ReadLogged) -> None:
    knowledge = read_logged(logged_map(ROOM))
    for body in ROOM:
        assert body_of(knowledge, body).pose.position == pytest.approx(body.position, abs=1e-6)
    assert assumed(knowledge, "pivots") == "top of LabFloor, bottom of LabWall, bottom of Cup; center of all others"
    (assumption,) = [each for each in knowledge.assumptions() if each.topic == "pivots"]
    assert "LabFloor (1 body): what is around it is then held better, margin " in assumption.evidence
    assert "LabWall (2 bodies): it is then held better, margin " in assumption.evidence
    assert "Cup (3 bodies): it is then held better, margin " in assumption.evidence


def test_poses_of_centers_stay(read_logged: ReadLogged) -> None:
    bodies = [centered(body) for body in ROOM]
    knowledge = read_logged(logged_map(bodies))
    for body in bodies:
        assert body_of(knowledge, body).pose.position == pytest.approx(body.position, abs=1e-6)
    assert assumed(knowledge, "pivots") is None


def centered(body: LoggedBody) -> LoggedBody:
    """The same body with the pivot at its center."""
    return LoggedBody(body.name, body.cls, body.box, body.position, body.quaternion)


def test_the_poses_written_are_those_of_the_source(read_logged: ReadLogged, tmp_path: Path) -> None:
    knowledge = read_logged(logged_map(ROOM))
    for number, source_view in enumerate((knowledge.source_view(), None)):
        out = tmp_path / f"out{number}.ttl"
        save_map(knowledge.world(), out, source_view=source_view)
        back = knowledge_base_from(out)
        assert_worlds_equal(knowledge.world(), back.world())
        assert lost_statements(knowledge.source_view(), back.source_view()) == ()
    assert "mindstage" not in (tmp_path / "out0.ttl").read_text(encoding="utf-8")


@settings(max_examples=8, deadline=None, phases=[Phase.explicit, Phase.generate])
@example(position=(0.1, -29.65, -22.4), quaternion=(0.02, 0.0, 0.1, 0.0), units="")
@example(position=(1e-123, 0.3, -1e-9), quaternion=(0.0, 0.0, 0.0, 1.0), units="")
@given(
    position=st.tuples(*[st.floats(-30.0, 30.0)] * 3),
    quaternion=QUATERNION,
    units=st.sampled_from(["", ':room ms:units "cm" ; ms:frame "unreal" ; ms:quaternionOrder "xyzw" .']),
)
def test_moved_bodies_return_exactly(
    position: tuple[float, float, float],
    quaternion: tuple[float, float, float, float],
    units: str,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = tmp_path_factory.mktemp("moved")
    text = logged_map(ROOM, units)
    if units:
        text = text.replace('"1.000000 0.000000 0.000000 0.000000"', '"0.000000 0.000000 0.000000 1.000000"')
    (folder / "map.ttl").write_text(text, encoding="utf-8")
    knowledge = knowledge_base_from(folder / "map.ttl")
    world = moved(knowledge.world(), individual_id("wall0"), Pose(position, quaternion))
    for source_view in (knowledge.source_view(), None):
        save_map(world, folder / "out.ttl", source_view=source_view)
        found = diff(world, knowledge_base_from(folder / "out.ttl").world())
        assert found.only_in_a == found.only_in_b == ()
        assert [change for change in found.changed if change.field != "facts"] == []


def moved(world: World, id: str, pose: Pose) -> World:
    bodies = (msgspec.structs.replace(body, pose=pose) if body.id == id else body for body in world.bodies)
    return msgspec.structs.replace(world, bodies=tuple(bodies))


# -- meshes ------------------------------------------------------------------------------------------------------------


def write_box(path: Path, low: tuple[float, float, float], high: tuple[float, float, float]) -> None:
    """Writes a box as a Wavefront file."""
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    faces = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {' '.join(map(str, face))}" for face in faces]
    path.write_text("\n".join(lines), encoding="utf-8")


@pytest.fixture
def with_meshes(tmp_path: Path) -> Callable[[str], KnowledgeBase]:
    """Reads a logged map with the meshes of a folder."""

    def read(text: str) -> KnowledgeBase:
        path = tmp_path / "logged.ttl"
        path.write_text(text, encoding="utf-8")
        (tmp_path / "cache").mkdir()
        knowledge = KnowledgeBase(bundled_ontology=False)
        knowledge.load(path)
        knowledge.use_meshes(MeshLibrary([tmp_path], cache=tmp_path / "cache").bounds)
        return knowledge

    return read


def test_a_mesh_resolves_a_turn_by_45_degrees(with_meshes: Callable[[str], KnowledgeBase], tmp_path: Path) -> None:
    plank = LoggedBody("plank", "Plank", (0.3, 0.1, 0.02), (0.0, 0.0, 1.0), yaw(45))
    write_box(tmp_path / "Plank.obj", (-15.0, -5.0, -1.0), (15.0, 5.0, 1.0))
    knowledge = with_meshes(logged_map([plank]))
    assert_box(body_of(knowledge, plank), plank.box)
    assert "have the proportions of their meshes" in knowledge.assumptions()[-1].evidence


def test_a_mesh_shows_that_a_map_is_newer(with_meshes: Callable[[str], KnowledgeBase], tmp_path: Path) -> None:
    write_box(tmp_path / "LabDoor.obj", (-0.0765, -0.585, -1.07), (0.0765, 0.585, 1.07))
    knowledge = with_meshes(logged_map([DOOR], in_body_frame=True))
    assert_box(body_of(knowledge, DOOR), DOOR.box)


def test_a_mesh_gives_the_pivot(with_meshes: Callable[[str], KnowledgeBase], tmp_path: Path) -> None:
    hinged = LoggedBody("hinged", "Shutter", (0.02, 0.6, 0.9), (1.0, 2.0, 1.5), yaw(30), pivot=(0.0, 0.3, 0.0))
    write_box(tmp_path / "Shutter.obj", (-0.01, -0.6, -0.45), (0.01, 0.0, 0.45))
    knowledge = with_meshes(logged_map([hinged]))
    assert_box(body_of(knowledge, hinged), hinged.box)
    assert body_of(knowledge, hinged).pose.position == pytest.approx(hinged.position, abs=1e-5)
    assert assumed(knowledge, "pivots") == "left of Shutter; center of all others"
    save_map(knowledge.world(), tmp_path / "out.ttl", source_view=knowledge.source_view())
    assert_worlds_equal(knowledge.world(), knowledge_base_from(tmp_path / "out.ttl").world())


# -- public maps -------------------------------------------------------------------------------------------------------


def local(body: Body) -> str:
    return body.cls.rpartition("#")[2]


def rotation_of(body: Body) -> np.ndarray:
    return rotation_matrix(normalize(body.pose.quaternion))


@pytest.fixture(params=["iai-kitchen-original", "iai-kitchen-spawned"])
def thesis_world(request: pytest.FixtureRequest, shared_data: Path) -> World:
    return knowledge_base_from(shared_data / "maps" / f"{request.param}.owl").world()


def test_every_handle_is_along_its_front_and_within_6_cm(thesis_world: World) -> None:
    bodies = {body.id: body for body in thesis_world.bodies}
    pairs = [
        (bodies[each.child], bodies[each.parent])
        for each in thesis_world.attachments
        if "Handle" in local(bodies[each.child])
    ]
    assert len(pairs) > 15
    for handle, front in pairs:
        size, outer = np.array(handle.size), np.array(front.size)
        relative = rotation_of(front).T @ rotation_of(handle)
        offset = rotation_of(front).T @ np.subtract(handle.pose.position, front.pose.position)
        normal = 0  # drawers and doors of this kitchen open along their x axis
        assert abs(relative[normal, np.argmax(size)]) < 1e-3, local(handle)
        half = np.abs(relative) @ size / 2
        assert np.all((np.abs(offset) + half)[1:] <= outer[1:] / 2 + 1e-3), local(handle)
        gap = abs(offset[normal]) - half[normal] - outer[normal] / 2
        assert -0.06 <= gap <= 0.06, (local(handle), gap)


def test_each_poster_is_in_the_plane_of_its_frame(thesis_world: World) -> None:
    bodies = {local(body).lower(): body for body in thesis_world.bodies}
    names = [name.removesuffix("frame") for name in bodies if name.endswith("frame")]
    posters = [(bodies[name], bodies[f"{name}frame"]) for name in names if name in bodies]
    assert len(posters) == 4
    for poster, frame in posters:
        normals = [rotation_of(each)[:, np.argmin(each.size)] for each in (poster, frame)]
        assert abs(normals[0] @ normals[1]) > 0.9999
        assert abs(normals[0] @ np.subtract(poster.pose.position, frame.pose.position)) < 0.01
        heights = [np.abs(rotation_of(each)) @ np.array(each.size) for each in (poster, frame)]
        assert np.all(heights[0] <= heights[1] + 0.01)


@pytest.mark.parametrize("name", ["iai-kitchen-original", "iai-kitchen-spawned", "ameva-task-two"])
def test_the_bounds_of_one_body_of_each_class_are_the_numbers_of_the_map(shared_data: Path, name: str) -> None:
    path = shared_data / "maps" / f"{name}.owl"
    knowledge = KnowledgeBase(bundled_ontology=False)
    knowledge.load(path, conventions=UnitConventions(sizes=SizeFrame.BODY))
    stated = {body.cls: np.array(body.size) for body in knowledge.world().bodies if body.size}
    errors: dict[str, list[float]] = defaultdict(list)
    for body in knowledge_base_from(path).world().bodies:
        if body.size:
            bounds = np.abs(rotation_of(body)) @ np.array(body.size)
            errors[body.cls].append(float(np.abs(bounds - stated[body.cls]).max()))
    assert errors
    assert max(min(each) for each in errors.values()) < 1e-3


def test_walls_and_door_frames_stand_on_the_floor(thesis_world: World) -> None:
    standing = [body for body in thesis_world.bodies if local(body) in ("LabWallDoorFrame", "IAILabWalls")]
    assert len(standing) == 4
    for body in standing:
        assert body.size is not None
        assert 0.0 <= body.pose.position[2] - body.size[2] / 2 <= 0.02
    (floor,) = [body for body in thesis_world.bodies if local(body) == "IAILabFloor"]
    assert floor.size is not None
    assert floor.pose.position[2] + floor.size[2] / 2 == pytest.approx(0.01)
