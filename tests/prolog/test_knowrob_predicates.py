"""KnowRob's predicates about objects, against numbers that are computed here from the poses of the maps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mindstage.engines import NullEngine
from mindstage.errors import PrologGoalError
from mindstage.knowledge import KnowledgeBase
from mindstage.prolog import PrologConsole
from mindstage.scene import Body, BodyId, Iri, Pose, World
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette
from tests.maps.dialect_maps import knowrob1_map, perception
from tests.maps.small_maps import knowledge_base_from

KITCHEN = "http://mindstage.org/maps/kitchen.owl#"
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"


@pytest.fixture
def world(kitchen_knowledge: KnowledgeBase) -> World:
    """The bundled kitchen."""
    return kitchen_knowledge.world()


def local(value: object) -> str:
    return str(value).rpartition("#")[2]


def values(console: PrologConsole, goal: str, *names: str) -> set[tuple[Any, ...]]:
    """The solutions as tuples of local names."""
    rows = console.solutions(goal, limit=100_000)
    return {tuple(local(row[name]) for name in names) for row in rows}


def rotation(body: Body) -> np.ndarray[Any, Any]:
    """The rotation matrix of a body by Rodrigues' formula, unlike the predicates."""
    w, *axis = np.array(body.pose.quaternion) / np.linalg.norm(body.pose.quaternion)
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * k + 2.0 * k @ k


def in_footprint(point: np.ndarray[Any, Any], body: Body) -> bool:
    """Whether a point is in the convex hull of the corners of a box, seen from above."""
    half = np.array(body.size) / 2.0
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    corners = (np.array(body.pose.position) + (signs * half) @ rotation(body).T)[:, :2]
    around = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    directions = np.stack([np.cos(around), np.sin(around)], axis=1)
    return bool((directions @ point[:2] <= (directions @ corners.T).max(axis=1) + 1e-12).all())


def expected(world: World, holds: Callable[[Body, Body], bool]) -> set[tuple[str, str]]:
    bodies = world.bodies
    return {(local(a.iri), local(b.iri)) for a in bodies for b in bodies if a is not b and holds(a, b)}


def offset(a: Body, b: Body) -> np.ndarray[Any, Any]:
    return np.array(a.pose.position) - np.array(b.pose.position)


def is_left_of(a: Body, b: Body) -> bool:
    x, y, z = offset(a, b)
    return abs(x) <= 0.30 and y >= 0.0 and abs(z) <= 0.30


def is_contained(a: Body, b: Body) -> bool:
    if a.size is None or b.size is None:
        return False
    inner, outer, apart = np.array(a.size) / 2, np.array(b.size) / 2, offset(a, b)
    return bool((apart - inner >= -outer - 0.05).all() and (apart + inner <= outer + 0.05).all())


RELATIONS: dict[str, Callable[[Body, Body], bool]] = {
    "comp_toTheLeftOf": is_left_of,
    "comp_toTheRightOf": lambda a, b: is_left_of(b, a),
    "comp_toTheSideOf": lambda a, b: is_left_of(a, b) or is_left_of(b, a),
    "comp_inCenterOf": lambda a, b: bool((np.abs(offset(a, b)) <= 0.20).all()),
    "in_ContGeneric": is_contained,
}


# -- spatial relations -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RELATIONS)
def test_spatial_relations_are_those_of_comp_spatial(name: str, kitchen: PrologConsole, world: World) -> None:
    assert values(kitchen, f"{name}(A, B)", "A", "B") == expected(world, RELATIONS[name])


def test_what_is_in_front_has_a_larger_x(kitchen: PrologConsole, world: World) -> None:
    hob = world.body("hob")
    front = {(local(each.iri),) for each in world.bodies if each is not hob and offset(each, hob)[0] >= 0.0}
    back = {(local(each.iri),) for each in world.bodies if each is not hob and offset(each, hob)[0] <= 0.0}
    assert values(kitchen, "comp_inFrontOf(X, hob)", "X") == front
    assert values(kitchen, "comp_inFrontOf(hob, X)", "X") == back


def test_what_is_above_something_is_over_its_footprint(kitchen: PrologConsole, world: World) -> None:
    tops = [world.body(id) for id in ("milk_carton_1", "hob", "fridge_door_handle", "plate_3")]
    for top in tops:
        below = {
            (local(each.iri),)
            for each in world.bodies
            if each.size and top is not each and offset(top, each)[2] > 0.0
            if in_footprint(np.array(top.pose.position), each)
        }
        assert len(below) > 0
        for name in ("on_Physical", "comp_above_of"):
            assert values(kitchen, f"{name}({top.id}, X)", "X") == below
        assert values(kitchen, f"comp_below_of(X, {top.id})", "X") == below


def test_the_footprint_of_a_tilted_body_is_that_of_its_box(prolog: Path, tmp_path: Path) -> None:
    tilted = Pose((0.0, 0.0, 0.0), (np.cos(np.pi / 8), np.sin(np.pi / 8), 0.0, 0.0))
    board = _body("board", tilted, (0.2, 1.0, 0.02))
    near, far = (_body(f"ball{y}", Pose((0.0, y, 1.0)), (0.1, 0.1, 0.1)) for y in (0.35, 0.37))
    world = World(iri=Iri("http://e.org/m#map"), name="map", bodies=(board, near, far))
    with Simulation(KnowledgeBase(), NullEngine()) as simulation, PrologConsole(simulation) as console:
        simulation.spawn(world)
        # 0.5 m * cos 45° + 0.01 m * sin 45° = 0.3606 m
        assert values(console, "on_Physical(X, board)", "X") == {("ball0.35",)}


def _body(name: str, pose: Pose, size: tuple[float, float, float]) -> Body:
    iri = Iri(f"http://e.org/m#{name}")
    return Body(id=BodyId(name), iri=iri, cls=Iri(KNOWROB + "Cup"), pose=pose, size=size)


def test_either_argument_of_a_relation_may_be_bound(kitchen: PrologConsole) -> None:
    pairs = values(kitchen, "in_ContGeneric(A, B)", "A", "B")
    assert values(kitchen, "in_ContGeneric(A, fridge)", "A") == {(a,) for a, b in pairs if b == "fridge"}
    assert values(kitchen, "in_ContGeneric(kitchen:milk_carton_1, B)", "B") == {
        (b,) for a, b in pairs if a == "milk_carton_1"
    }
    assert kitchen.holds("in_ContGeneric(milk_carton_1, fridge)")
    assert not kitchen.holds("in_ContGeneric(fridge, milk_carton_1)")


def test_relations_that_are_measured_follow_where_is(kitchen: PrologConsole) -> None:
    on = values(kitchen, "where_is(_, A, on, B)", "A", "B")
    assert values(kitchen, "is_supported_by(A, B)", "A", "B") == on
    assert kitchen.holds("is_inside_of(milk_carton_1, fridge)")
    assert kitchen.holds("on_Physical(milk_carton_1, floor), \\+ is_supported_by(milk_carton_1, floor)")


# -- poses -------------------------------------------------------------------------------------------------------------


def test_poses_have_both_forms_of_knowrob(kitchen: PrologConsole, world: World) -> None:
    for body in world.bodies[::20]:
        matrix, term = (row["P"] for row in kitchen.solutions(f"current_object_pose({body.id}, P)"))
        rows = np.array(matrix).reshape(4, 4)
        assert rows[:3, :3] == pytest.approx(rotation(body), abs=1e-9)
        assert rows[:3, 3] == pytest.approx(body.pose.position)
        assert rows[3].tolist() == [0.0, 0.0, 0.0, 1.0]
        w, x, y, z = body.pose.quaternion
        assert term[:2] == ["map", body.id]
        assert term[2] == pytest.approx(body.pose.position)
        assert term[3] == pytest.approx((x, y, z, w), abs=1e-6)


@given(quaternion=arrays(np.float64, 4, elements=st.floats(-1.0, 1.0)).filter(lambda q: float(q @ q) > 1e-3))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@example(quaternion=np.array([0.0, 1.0, 0.0, 0.0]))
@example(quaternion=np.array([0.0, 0.0, 0.0, -1.0]))
@example(quaternion=np.array([1e-9, 0.0, 1.0, 0.0]))
def test_a_pose_is_the_same_after_a_matrix(quaternion: np.ndarray[Any, Any], kitchen: PrologConsole) -> None:
    unit = (quaternion / np.linalg.norm(quaternion)).tolist()
    module = "mindstage_knowrob_objects"
    (row,) = kitchen.solutions(f"{module}:matrix([1, 2, 3], {unit}, M), {module}:matrix_pose(M, P, Q)")
    assert row["P"] == [1, 2, 3]
    assert abs(np.dot(row["Q"], unit)) == pytest.approx(1.0, abs=1e-9)
    assert np.linalg.norm(row["Q"]) == pytest.approx(1.0, abs=1e-9)


def test_joints_have_poses(kitchen: PrologConsole, world: World) -> None:
    joint = world.joints[0]
    (row,) = kitchen.solutions(f"current_object_pose({joint.id}, [_, _, Position, _])")
    assert row["Position"] == pytest.approx(joint.pose.position)


def test_the_present_is_that_of_the_simulation(console: PrologConsole, simulation: Simulation) -> None:
    assert console.holds("spawn_semantic_map(_)")
    moved = Pose((0.5, -0.25, 3.0), (0.0, 0.0, 0.0, 1.0))
    simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("milk_carton_1"): moved})), edits=True)
    (row,) = console.solutions("is_at(milk_carton_1, [map, Position, Quaternion])")
    assert row["Position"] == [0.5, -0.25, 3.0]
    assert row["Quaternion"] == pytest.approx([0.0, 0.0, 1.0, 0.0])
    assert not console.holds("in_ContGeneric(milk_carton_1, fridge)")
    assert not console.holds("holds(in_ContGeneric(milk_carton_1, fridge), _)")
    assert console.holds("holds(on_Physical(milk_carton_1, floor), _)")


def test_earlier_states_that_were_observed_can_be_asked(console: PrologConsole, simulation: Simulation) -> None:
    (row,) = console.solutions("spawn_semantic_map(_), get_timepoint(T)")
    before = f"'{row['T']}'"
    (row,) = console.solutions("tell(is_at(milk_carton_1, [map, [0, 0, 5], [0, 0, 0, 1]])), get_timepoint(T)")
    after = f"'{row['T']}'"
    (row,) = console.solutions(f"object_pose_at_time(milk_carton_1, {before}, P, _)")
    assert row["P"] == pytest.approx(simulation.knowledge.world().body("milk_carton_1").pose.position)
    assert console.holds(f"holds(in_ContGeneric(milk_carton_1, fridge), {before})")
    assert not console.holds(f"holds(in_ContGeneric(milk_carton_1, fridge), {after})")
    assert console.holds(f"holds(milk_carton_1, knowrob:'in-ContGeneric', kitchen:fridge, {before})")
    (row,) = console.solutions(f"object_pose_at_time(milk_carton_1, {after}, [map, _, P, _])")
    assert row["P"] == [0.0, 0.0, 5.0]


def test_before_the_first_observation_the_perceptions_of_the_map_count(prolog: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.ttl"
    turned = {"m00": 0.0, "m01": -1.0, "m10": 1.0, "m11": 0.0}
    cup = ":cup a k:Cup ; k:describedInMap :old ."
    path.write_text(
        knowrob1_map(cup, perception("cup", "100", 1, 0, 1), perception("cup", "200", 2, 0, 1, **turned)),
        encoding="utf-8",
    )
    knowledge = knowledge_base_from(path, bundled_ontology=True)
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        assert len(console.solutions("object_detection(cup, _, D)")) == 2
        assert len(console.solutions("object_detection(cup, 150, D)")) == 1
        assert console.solutions("object_pose_at_time(cup, 99, P, _)") == []
        (row,) = console.solutions("object_pose_at_time(cup, 150, P, Q)")
        assert (row["P"], row["Q"]) == ([1.0, 0.0, 1.0], pytest.approx([1.0, 0.0, 0.0, 0.0]))
        (row,) = console.solutions(f"object_pose_at_time(cup, '{KNOWROB}timepoint_250', P, Q)")
        assert (row["P"], row["Q"]) == ([2.0, 0.0, 1.0], pytest.approx([0.5**0.5, 0.0, 0.0, 0.5**0.5]))
        intervals = [row["I"] for row in console.solutions("occurs(E, I)")]
        assert sorted(begin for begin, _ in intervals) == [100, 200]
        assert console.holds("occurs(E, 150)")
        assert not console.holds("occurs(E, 50)")


def test_poses_are_given_in_frames_of_other_objects(kitchen: PrologConsole, world: World) -> None:
    door, handle = world.body("fridge_door"), world.body("fridge_door_handle")
    (row,) = kitchen.solutions("is_at(fridge_door_handle, [fridge_door, P, _])")
    assert row["P"] == pytest.approx(rotation(door).T @ offset(handle, door))
    apart = float(np.linalg.norm(offset(handle, door)))
    (row,) = kitchen.solutions("object_distance(fridge_door, fridge_door_handle, X)")
    assert row["X"] == pytest.approx(apart)


def test_time_points_are_differences_from_now(kitchen: PrologConsole) -> None:
    goal = "get_timepoint(A), get_timepoint('-2m', B), get_timepoint('+1h', C)"
    (row,) = kitchen.solutions(goal)
    now, before, after = (float(row[name].rpartition("_")[2]) for name in "ABC")
    assert now - before == pytest.approx(120.0, abs=5.0)
    assert after - now == pytest.approx(3600.0, abs=5.0)
    with pytest.raises(PrologGoalError, match="time_difference"):
        kitchen.holds("get_timepoint('-2 weeks', _)")


# -- maps and objects --------------------------------------------------------------------------------------------------


def test_sizes_are_those_of_the_world(kitchen: PrologConsole, world: World) -> None:
    rows = kitchen.solutions("object_dimensions(X, D, W, H)")
    found = {local(row["X"]): (row["D"], row["W"], row["H"]) for row in rows}
    assert found == {local(body.iri): body.size for body in world.bodies if body.size}
    depth, width, height = world.body("fridge").size or ()
    assert kitchen.solutions("map_object_dimensions(fridge, W, D, H)") == [{"W": width, "D": depth, "H": height}]


def test_object_info_lists_everything_with_a_size(kitchen: PrologConsole, world: World) -> None:
    rows = kitchen.solutions("map_object_info([X, Class, Pose, Size])")
    assert {local(row["X"]) for row in rows} == {local(body.iri) for body in world.bodies if body.size}
    (fridge,) = (row for row in rows if local(row["X"]) == "fridge")
    assert local(fridge["Class"]) == local(world.body("fridge").cls)
    assert [fridge["Pose"][at] for at in (3, 7, 11)] == pytest.approx(world.body("fridge").pose.position)
    assert tuple(fridge["Size"]) == world.body("fridge").size


def test_connections_follow_the_joints_of_the_map(kitchen: PrologConsole, world: World) -> None:
    names = values(kitchen, "map_joint_name(P, C, J)", "P", "C", "J")
    bodies = {body.id: local(body.iri) for body in world.bodies}
    assert {(frozenset((p, c)), j) for p, c, j in names} == {
        (frozenset((bodies[each.parent], bodies[each.child])), local(each.iri)) for each in world.joints
    }
    assert kitchen.solutions("map_connection_type(fridge, fridge_door, X)") == [{"X": "HingedJoint"}]
    assert kitchen.solutions("map_connection_type(_, drawer_south_1, X)") == [{"X": "PrismaticJoint"}]
    assert kitchen.solutions("map_connection_type(fridge_door, fridge_door_handle, X)") == [{"X": "Fixed"}]


def test_parts_and_roots_of_a_map(kitchen: PrologConsole, world: World) -> None:
    assert values(kitchen, "map_child_object(fridge_door, X)", "X") == {("fridge_door_handle",)}
    joints = {local(joint.iri) for joint in world.joints}
    assert not joints & {child for (child,) in values(kitchen, "map_child_object(_, X)", "X")}
    (row,) = kitchen.solutions("map_root_objects(_, Objects)")
    assert len(row["Objects"]) == len(world.bodies) + len(joints)


def test_storage_places_are_found_for_classes_and_individuals(kitchen: PrologConsole) -> None:
    fridge = {("fridge", "Perishable")}
    for item in ("knowrob:'CowsMilk'", "'CowsMilk'", "milk_carton_1", "kitchen:milk_carton_1"):
        assert values(kitchen, f"storagePlaceForBecause(S, {item}, B)", "S", "B") == fridge
    assert values(kitchen, "storagePlaceFor(S, knowrob:'CowsMilk')", "S") == {("fridge",)}
    everything = values(kitchen, "storagePlaceFor(fridge, X)", "X")
    assert {("CowsMilk",), ("milk_carton_1",), ("butter_pack_1",)} <= everything


def test_stated_colors_meshes_and_affordances(console: PrologConsole) -> None:
    assert console.solutions("object_color(fridge, X)") == [{"X": [0.5, 0.5, 0.5, 1.0]}]
    assert console.holds("rdf_assert(kitchen:fridge, knowrob:mainColorOfObject, literal('0.1 0.2 0.3'))")
    assert console.solutions("object_color(fridge, X)") == [{"X": [0.1, 0.2, 0.3, 1.0]}]
    assert console.solutions("object_affordance(fridge, X)") == []
    assert console.holds("rdf_assert(kitchen:fridge, knowrob:hasAffordance, kitchen:cooling)")
    assert values(console, "object_affordance(X, A)", "X", "A") == {("fridge", "cooling")}
    assert console.holds("rdf_assert(kitchen:knob_1, knowrob:radius, literal(type(xsd:float, '0.02')))")
    assert console.solutions("object_dimensions(kitchen:knob_1, D, W, H)") == [{"D": 0.03, "W": 0.04, "H": 0.04}]


def test_meshes_of_a_map(prolog: Path, shared_data: Path) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(shared_data / "maps" / "iai-kitchen-original.owl")
    world = knowledge.world()
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        found = {(row["X"], row["P"]) for row in console.solutions("object_mesh_path(X, P)")}
        assert found == {(body.iri, body.mesh) for body in world.bodies if body.mesh}
        for name in ("comp_toTheLeftOf", "in_ContGeneric"):
            assert values(console, f"{name}(A, B)", "A", "B") == expected(world, RELATIONS[name])


@pytest.mark.parametrize("name", ["knowrob1-ccrl", "soma-iai-room", "ameva-task-two"])
def test_maps_of_other_generations_answer(name: str, prolog: Path, shared_data: Path) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(shared_data / "maps" / f"{name}.owl")
    world = knowledge.world()
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        poses = console.solutions("is_at(X, [map, P, _])", limit=10_000)
        bodies = {body.iri: body for body in world.bodies}
        assert bodies.keys() <= {row["X"] for row in poses}
        for row in poses:
            if row["X"] in bodies:
                assert row["P"] == pytest.approx(bodies[row["X"]].pose.position)
        left = expected(world, is_left_of)
        assert left
        assert values(console, "comp_toTheLeftOf(A, B)", "A", "B") == left
        parts = values(console, "has_part(A, B)", "A", "B")
        assert parts
        assert values(console, "map_child_object(A, B)", "A", "B") <= parts


def test_a_soma_map_answers_in_both_vocabularies(prolog: Path, shared_data: Path) -> None:
    knowledge = KnowledgeBase()
    knowledge.load(shared_data / "maps" / "soma-iai-room.owl")
    bodies = knowledge.world().bodies
    handles = {(local(each.iri),) for each in bodies if each.cls.endswith("#DesignedHandle") and "#" in each.iri}
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        for goal in ("entity(X, [an, object, [type, handle]])", "has_type(X, knowrob:'Handle'), is_at(X, _)"):
            assert values(console, goal, "X") == handles
        assert len(handles) > 10
        assert console.solutions("object_color(drawer_sinkblock_upper_handle, X)") == [{"X": [0.2, 0.2, 0.2, 1.0]}]
        assert values(console, "object_affordance(drawer_sinkblock_upper_handle, X)", "X") == {("Graspability",)}
        assert values(console, "storagePlaceFor(X, knowrob:'CowsMilk')", "X")


def test_a_map_that_is_spawned_in_part_keeps_the_poses_of_the_rest(
    console: PrologConsole, simulation: Simulation
) -> None:
    assert console.holds("spawn_models(kitchen, [fridge])")
    assert console.holds("is_at(milk_carton_1, [map, [X, _, _], _]), X < -1.5, in_ContGeneric(milk_carton_1, fridge)")


def test_bodies_that_only_the_simulation_has_are_objects(prolog: Path) -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation, PrologConsole(simulation) as console:
        simulation.spawn(kitchenette())
        (row,) = console.solutions("is_at('Mug', [map, P, _])")
        assert row["P"] == [2.0, 0.0, 0.85]
        assert console.holds("on_Physical('Mug', 'Cupboard')")


def test_an_unknown_object_fails_with_close_names(kitchen: PrologConsole, capfd: pytest.CaptureFixture[str]) -> None:
    assert not kitchen.holds("current_object_pose(milk_cartoon_1, _)")
    assert "milk_carton_1" in capfd.readouterr().err


# -- computed properties -----------------------------------------------------------------------------------------------


def test_relations_are_properties(kitchen: PrologConsole) -> None:
    inside = values(kitchen, "in_ContGeneric(X, fridge)", "X")
    assert values(kitchen, "rdf_has(X, knowrob:'in-ContGeneric', kitchen:fridge)", "X") == inside
    assert values(kitchen, "rdf_triple(knowrob:'in-ContGeneric', X, kitchen:fridge)", "X") == inside
    assert values(kitchen, "holds(X, knowrob:'in-ContGeneric', kitchen:fridge)", "X") == inside
    assert values(kitchen, "holds(knowrob:'in-ContGeneric'(X, fridge))", "X") == inside
    goal = f"clause(mindstage_semweb:computable('{KNOWROB}in-ContGeneric', X, fridge), G), call(G)"
    assert values(kitchen, goal, "X") == inside


def test_stated_properties_hold_at_all_times(kitchen: PrologConsole) -> None:
    stated = "literal(type(_, '1.05'))"
    for goal in ("holds(milk_carton_1, mass, X)", "holds(kitchen:milk_carton_1, knowrob:mass, X, 0)"):
        assert kitchen.holds(f"{goal}, X = {stated}")
    assert kitchen.holds(f"holds(knowrob:mass(milk_carton_1, {stated}), T), nonvar(T)")


def test_visitors_may_ask_what_reads_and_nothing_that_changes(kitchen: PrologConsole) -> None:
    for goal in (
        "comp_toTheLeftOf(A, B)",
        "holds(on_Physical(milk_carton_1, B), T)",
        "entity(X, [an, object, [type, milk]])",
        "subclass_of(knowrob:'CowsMilk', X)",
        "is_at(milk_carton_1, P)",
        "storagePlaceFor(S, knowrob:'CowsMilk')",
    ):
        assert kitchen.answers(goal, limit=1)
    for goal in ("ask(halt)", "tell(is_at(fridge, P))", "show(fridge)", "marker(cube(a), M)", "spawn_constraint([])"):
        with pytest.raises(PrologGoalError, match="cannot be asked here"):
            kitchen.answers(goal)


@pytest.mark.parametrize("pairs_per_page", [1, 5000, 1 << 16])
@pytest.mark.parametrize("relation", ["comp_toTheLeftOf", "comp_inCenterOf", "on_Physical", "in_ContGeneric"])
def test_all_pairs_are_those_of_each_body(
    relation: str, pairs_per_page: int, kitchen: PrologConsole, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mindstage.prolog.object_predicates._PAIRS_PER_PAGE", pairs_per_page)
    every = f"findall(A-B, {relation}(A, B), Pairs), length(Pairs, N), sort(Pairs, Sorted), length(Sorted, N)"
    each = f"findall(A-B, ( object_dimensions(A, _, _, _), {relation}(A, B) ), Each), sort(Each, Other), Other = Sorted"
    assert kitchen.solutions(f"{every}, {each}, N > 10")[0]["N"] > 10
    assert not kitchen.holds(f"{relation}(A, A)")
