"""Worlds rest after the spawn: walls are not loose, overlaps are resolved, and there is always something below."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from math import dist
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.api import load_knowledge
from mindstage.engines import SpawnNoteKind, SpawnReport
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import UnitConventions, bundled_kitchen
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Joint, Mobility, Pose, World, diff
from mindstage.simulation import Simulation
from tests.engines.scenes import body, revolute_joint, world
from tests.geometry import fit_scenes
from tests.geometry.fit_scenes import make_body, slide_joint
from tests.maps.logged_maps import LoggedBody, logged_map
from tests.semlog_maps import Actor, semlog_map

MAPS = ("ameva-task-two", "iai-kitchen-original", "iai-kitchen-spawned", "knowrob1-ccrl", "soma-iai-room")

ROOM = (
    Actor("floor", "IAILabFloor", (0, 0, -0.05), (8, 8, 0.1)),
    Actor("north", "LabWall", (0, 4, 1.25), (8, 0.2, 2.5)),
    Actor("south", "LabWall", (0, -4, 1.25), (8, 0.2, 2.5)),
    Actor("pane", "WindowTypASmallR", (0, 3.9, 1.5), (1.0, 0.1, 0.9)),
    Actor("tube", "CeilingLightNeonTube", (0, 0, 2.5), (1.2, 0.1, 0.1)),
    Actor("sky", "SkySphere", (0, 0, 0), (200, 200, 200)),
    Actor("outlet", "PowerOutlet", (1.0, 3.88, 0.3), (0.1, 0.04, 0.1)),
)
"""A room whose parts overlap, as logged: everything says dynamic."""
FURNITURE = (
    Actor("table", "DiningTable", (0, 0, 0.1), (1.6, 0.9, 0.74)),
    *(Actor(f"chair{i}", "DiningChair", (x, y, 0.2), (0.45, 0.45, 0.9)) for i, (x, y) in enumerate(((2, 0), (-2, 0)))),
)
"""Half below the floor, since their poses are at their feet."""
TABLEWARE = (
    Actor("cup", "Mug", (0.2, 0.1, 0.51), (0.08, 0.08, 0.1)),
    Actor("cereal", "LionCereal", (-0.3, 0.1, 0.59), (0.2, 0.06, 0.26)),
)

LoadMap = Callable[..., tuple[KnowledgeBase, Simulation]]


@pytest.fixture
def load_map(tmp_path: Path) -> Iterator[LoadMap]:
    """Loads a map of some actors, with further ontologies, into a simulation."""
    simulations: list[Simulation] = []

    def load(*actors: Actor, ontology: str = "") -> tuple[KnowledgeBase, Simulation]:
        path = semlog_map(tmp_path / "lab.owl", actors)
        (tmp_path / "own.ttl").write_text(ontology, encoding="utf-8")
        knowledge = load_knowledge([path], ontologies=[tmp_path / "own.ttl"] if ontology else [])
        simulations.append(Simulation(knowledge, MujocoEngine()))
        return knowledge, simulations[-1]

    yield load
    for simulation in simulations:
        simulation.close()


def notes_of(report: SpawnReport, kind: SpawnNoteKind) -> list[str]:
    return [note.text for note in report.notes if note.kind is kind]


def drift(simulation: Simulation, duration_s: float) -> dict[str, float]:
    """How far each body moves from now on [m]."""
    before = simulation.state.poses
    simulation.step(duration_s)
    distances = np.linalg.norm(simulation.state.poses[:, :3] - before[:, :3], axis=1)
    return dict(zip(simulation.state.ids, distances.tolist(), strict=True))


# -- what is immovable


def test_a_map_in_which_every_actor_is_dynamic_rests_and_is_returned_unchanged(load_map: LoadMap) -> None:
    knowledge, simulation = load_map(*ROOM, *FURNITURE, *TABLEWARE)
    report = simulation.spawn(check_rest=True)
    assert (report.ok, report.moved, report.rest_checked_s) == (True, (), 2.0)
    assert diff(knowledge.world(), simulation.snapshot()).identical(0.0)
    assert max(drift(simulation, 3.0).values()) < 1e-3
    assert {body.physics.mobility for body in simulation.snapshot().bodies} == {Mobility.DYNAMIC}


def test_what_is_fixed_by_class_is_reported_in_one_note(load_map: LoadMap) -> None:
    _, simulation = load_map(*ROOM, *TABLEWARE)
    report = simulation.spawn()
    (fixed,) = (text for text in notes_of(report, SpawnNoteKind.IMMOVABLE) if "fixed by class" in text)
    assert fixed.startswith("7 bodies are dynamic in the map")
    assert '"sky sphere" in its name' in fixed
    assert report.ids_with_note(SpawnNoteKind.IMMOVABLE).isdisjoint({"cup", "cereal"})


def test_loose_furniture_stays_loose_in_a_map_whose_walls_are_static(load_map: LoadMap) -> None:
    walls = [actor._replace(mobility="Static") for actor in ROOM]
    _, simulation = load_map(*walls, *FURNITURE, *TABLEWARE)
    report = simulation.spawn(check_rest=True)
    assert not notes_of(report, SpawnNoteKind.IMMOVABLE)
    assert not report.moved
    simulation.engine.run(lambda engine: engine.apply_force(BodyId("chair0"), (0.0, 0.0, 2000.0)))
    simulation.step(0.1)
    heights = dict(zip(simulation.state.ids, simulation.state.poses[:, 2].tolist(), strict=True))
    assert heights["chair0"] > 0.47


def test_a_users_ontology_says_what_is_immovable_and_what_is_not(load_map: LoadMap) -> None:
    ontology = """
        @prefix ms: <http://mindstage.org/ontology#> . @prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
        knowrob:Podium a owl:Class ; ms:mounting "fixed" .
        knowrob:SmallPodium a owl:Class ; rdfs:subClassOf knowrob:Podium .
        knowrob:FoldingWall a owl:Class ; rdfs:subClassOf knowrob:WallOfAConstruction ; ms:mounting "portable" .
        knowrob:Odd a owl:Class ; ms:mounting "welded" .
    """
    _, simulation = load_map(
        ROOM[0]._replace(mobility="Static"),
        Actor("podium", "SmallPodium", (0, 0, 1.0), (0.5, 0.5, 0.5)),
        Actor("screen", "FoldingWall", (2, 0, 1.0), (0.5, 0.5, 0.5)),
        Actor("odd", "Odd", (-2, 0, 0.25), (0.5, 0.5, 0.5)),
        ontology=ontology,
    )
    report = simulation.spawn(check_rest=True)
    assert report.ids_with_note(SpawnNoteKind.IMMOVABLE) == {"podium"}
    assert [moved.id for moved in report.moved] == ["screen"]
    assert any('"welded"; expected one of fixed' in note.text for note in report.notes)


@pytest.mark.parametrize(
    ("cls", "size", "is_immovable"),
    [
        ("SkyBox", (4, 4, 4), True),
        ("WindowTypBSecure", (1.4, 0.1, 1.2), True),
        ("FloorCleaner", (0.1, 0.1, 0.3), False),
        ("KitchenRoll", (0.12, 0.12, 0.25), False),
        ("Himmel", (40, 40, 40), True),
        ("Ding", (0.3, 0.3, 0.3), False),
    ],
)
def test_names_and_sizes_decide_where_no_ontology_does(
    load_map: LoadMap, cls: str, size: tuple[float, float, float], is_immovable: bool
) -> None:
    _, simulation = load_map(ROOM[0]._replace(mobility="Static"), Actor("it", cls, (0, 0, size[2] / 2), size))
    assert ("it" in simulation.spawn().ids_with_note(SpawnNoteKind.IMMOVABLE)) is is_immovable


def test_a_deleted_wall_is_still_immovable_after_undo(load_map: LoadMap) -> None:
    _, simulation = load_map(*ROOM, *TABLEWARE)
    simulation.spawn()
    simulation.edits.delete([BodyId("tube")])
    simulation.edits.undo()
    assert drift(simulation, 0.5)["tube"] < 1e-6


def test_the_thesis_kitchen_with_everything_dynamic_rests(shared_data: Path) -> None:
    knowledge = load_knowledge([shared_data / "maps" / "iai-kitchen-original.owl"])
    world = everything_dynamic(knowledge.world())
    with closing(Simulation(knowledge, MujocoEngine())) as simulation:
        report = simulation.spawn(world, check_rest=True)
        assert not report.moved
        assert simulation.state.stats is not None
        assert simulation.state.stats.movable < 40


def test_each_spawn_keeps_its_report(load_map: LoadMap) -> None:
    _, simulation = load_map(*ROOM, *FURNITURE, *TABLEWARE)
    simulation.spawn()
    mast = Body(
        id=BodyId("mast"),
        iri=Iri("http://a/mast"),
        cls=Iri("http://a/Mast"),
        pose=Pose((0.0, 0.0, 4.0)),
        size=(0.1, 0.1, 0.1),
        physics=BodyPhysics(mobility=Mobility.DYNAMIC),
    )
    simulation.spawn(World(iri=Iri("http://a/map"), bodies=(mast,)), check_rest=True)
    first, second = simulation.reports
    assert (first.rest_checked_s, second.rest_checked_s) == (0.0, 2.0)
    assert (first.bodies > 1, second.bodies, [each.id for each in second.moved]) == (True, 1, ["mast"])


def everything_dynamic(world: World) -> World:
    """The world as loggers of 2018 would have described it: dynamic actors, without attachments."""

    def dynamic(body: object) -> object:
        return msgspec.structs.replace(
            body,
            physics=msgspec.structs.replace(body.physics, mobility=Mobility.DYNAMIC),  # type: ignore[attr-defined]
        )

    return msgspec.structs.replace(world, bodies=tuple(map(dynamic, world.bodies)), attachments=())  # type: ignore[arg-type]


# -- overlaps


def test_tables_and_chairs_that_reach_into_the_floor_stand_on_it(load_map: LoadMap) -> None:
    walls = [actor._replace(mobility="Static") for actor in ROOM[:3]]
    _, simulation = load_map(*walls, *FURNITURE, *TABLEWARE)
    report = simulation.spawn(check_rest=True)
    assert not report.moved
    assert {ids[0] for ids in (note.ids for note in report.notes if note.kind is SpawnNoteKind.SETTLED)} >= {
        "table",
        "chair0",
        "chair1",
    }
    heights = dict(zip(simulation.state.ids, simulation.state.poses[:, 2].tolist(), strict=True))
    assert heights["table"] == pytest.approx(0.37, abs=0.003)
    assert heights["chair0"] == pytest.approx(0.45, abs=0.003)
    assert heights["cup"] == pytest.approx(0.79, abs=0.005)


# -- the ground


def test_a_map_without_a_floor_gets_a_ground_unless_it_is_refused(load_map: LoadMap) -> None:
    chairs = [actor._replace(position=(*actor.position[:2], 0.45)) for actor in FURNITURE[1:]]
    knowledge, simulation = load_map(*chairs)
    report = simulation.spawn(check_rest=True)
    assert notes_of(report, SpawnNoteKind.GROUND) == [
        "nothing is below 2 loose bodies: a ground is assumed at a height of 0.000 m"
    ]
    assert not report.moved
    assert diff(knowledge.world(), simulation.snapshot()).identical(0.0)
    simulation.clear()
    report = simulation.spawn(ground=False, check_rest=True)
    assert not notes_of(report, SpawnNoteKind.GROUND)
    assert [(moved.id, moved.left_place) for moved in report.moved] == [("chair0", True), ("chair1", True)]
    assert report.moved[0].distance_m > 10.0


def test_checking_the_rest_leaves_the_world_as_it_was(load_map: LoadMap) -> None:
    _, simulation = load_map(*FURNITURE)
    simulation.spawn(ground=False, check_rest=True)
    assert simulation.state.time_s == 0.0
    before = simulation.state.poses
    assert simulation.check_rest()
    assert np.array_equal(simulation.state.poses, before)
    assert simulation.engine.notes == ()


def test_what_falls_out_of_the_place_is_stopped_and_reported_once(load_map: LoadMap) -> None:
    _, simulation = load_map(ROOM[0]._replace(mobility="Static"), Actor("ball", "Ball", (20, 0, 1), (0.2, 0.2, 0.2)))
    simulation.spawn(ground=False)
    simulation.step(4.0)
    assert [note.kind for note in simulation.engine.notes] == [SpawnNoteKind.STOPPED]
    assert drift(simulation, 1.0)["ball"] < 1e-9


# -- real maps


CAUSES_OF_MOTION = {
    SpawnNoteKind.GROUND,
    SpawnNoteKind.SETTLED,
    SpawnNoteKind.EMBEDDED,
    SpawnNoteKind.STOPPED,
    SpawnNoteKind.OVERLAP,
}


# -- what furniture holds and contains


@pytest.fixture
def run_world() -> Iterator[Callable[..., tuple[Simulation, SpawnReport, dict[str, float]]]]:
    """Spawns a world of bundled classes, and simulates three seconds; returns how far each body moved [m]."""
    simulations: list[Simulation] = []

    def run(world: World) -> tuple[Simulation, SpawnReport, dict[str, float]]:
        simulation = Simulation(KnowledgeBase(), MujocoEngine(), threaded=False)
        simulations.append(simulation)
        report = simulation.spawn(world)
        return simulation, report, drift(simulation, 3.0)

    yield run
    for simulation in simulations:
        simulation.close()


RunWorld = Callable[..., tuple[Simulation, SpawnReport, dict[str, float]]]


def door_joint(parent: str, child: str, at: tuple[float, float, float]) -> Joint:
    """Opens outwards, which is +x, by at most a right angle."""
    joint = revolute_joint(f"{child}_hinge", parent, child, at)
    return replace(joint, angular=replace(joint.angular, swing1_middle=-joint.angular.swing1_limit))


def fridge(*contents: Body, joints: bool = True) -> World:
    """A fridge with a thick door, in which there is a shelf, as in maps of game engines: their boxes overlap."""
    bodies = (
        make_body("floor", "Floor", (0, 0, -0.05), (4, 4, 0.1)),
        make_body("case", "Refrigerator", (0, 0, 0.75), (0.6, 0.6, 1.5)),
        make_body("door", "Door", (0.27, 0, 0.75), (0.06, 0.58, 1.4), is_free=True),
        make_body("shelf", "Tray", (0.25, 0, 1.0), (0.12, 0.46, 0.08), is_free=True),
        *contents,
    )
    return fit_scenes.world(
        bodies, [door_joint("case", "door", (0.3, -0.3, 0.75))] if joints else [], [("door", "shelf")]
    )


def test_what_stands_in_the_shelf_of_a_door_stays_there_and_moves_with_it(run_world: RunWorld) -> None:
    bottle = make_body("bottle", "Bottle", (0.25, 0, 1.11), (0.07, 0.07, 0.28), is_free=True)
    simulation, report, moved = run_world(fridge(bottle))
    assert not report.ids_with_note(SpawnNoteKind.SETTLED)
    assert max(moved.values()) < 0.01
    simulation.joint("door").open()
    simulation.step(2.0)
    x, _, z = simulation.state.poses[simulation.state.ids.index(BodyId("bottle")), :3]
    assert (x > 0.4, z) == (True, pytest.approx(1.11, abs=0.02))


def test_what_is_stuck_in_a_closed_door_does_not_push_it_open(run_world: RunWorld) -> None:
    """A carton that is too high above the shelf to stand in it, and in the door."""
    bodies = (
        make_body("block", "IAIFridgeArea", (-0.692, -0.714, 0.7545), (0.58, 0.6, 1.499)),
        make_body("case", "Refrigerator", (-0.7075, -0.7205, 0.963), (0.493, 0.551, 0.886)),
        make_body("door", "Door", (-0.4557, -0.7177, 0.9619), (0.0614, 0.5757, 0.8634), is_free=True),
        make_body("shelf", "IAIFridgeDoorShelfBig", (-0.4816, -0.7173, 0.6024), (0.1194, 0.4754, 0.1101), is_free=True),
        make_body("carton", "CardboardBox", (-0.4696, -0.6189, 0.7181), (0.0762, 0.0777, 0.2296), is_free=True),
    )
    hinge = revolute_joint("door_hinge", "block", "door", (-0.4375, -0.4494, 0.9765))
    hinge = replace(hinge, angular=replace(hinge.angular, swing1_middle=hinge.angular.swing1_limit))
    _, report, moved = run_world(fit_scenes.world(bodies, [hinge], [("door", "shelf")]))
    assert "carton" in report.ids_with_note(SpawnNoteKind.SETTLED)
    assert max(moved.values()) < 0.01


@pytest.mark.parametrize(("part", "is_held"), [("Drawer", True), ("DiningChair", False)])
def test_a_part_without_a_joint_is_held_by_the_furniture_that_it_meets(
    run_world: RunWorld, part: str, is_held: bool
) -> None:
    bodies = (
        make_body("floor", "Floor", (0, 0, -0.05), (4, 4, 0.1)),
        make_body("cupboard", "Cupboard", (0, 0, 1.0), (0.6, 0.6, 0.4)),
        make_body("part", part, (0.305, 0, 1.0), (0.02, 0.4, 0.3), is_free=True),
        make_body("far", part, (1.5, 0, 1.0), (0.5, 0.4, 0.2), is_free=True),
    )
    _, report, moved = run_world(fit_scenes.world(bodies))
    assert ("part" in report.ids_with_note(SpawnNoteKind.IMMOVABLE)) is is_held
    assert (moved["part"] < 1e-3) is is_held
    assert moved["far"] > 0.5


def test_utensils_stand_in_their_holder(run_world: RunWorld) -> None:
    bodies = (
        make_body("floor", "Floor", (0, 0, -0.05), (4, 4, 0.1)),
        make_body("holder", "CookingUtensilsHolder", (0, 0, 0.08), (0.12, 0.12, 0.16), is_free=True),
        make_body("spoon", "WoodenSpoon", (0, 0, 0.17), (0.02, 0.04, 0.3), is_free=True),
    )
    _, report, moved = run_world(fit_scenes.world(bodies))
    assert not report.ids_with_note(SpawnNoteKind.SETTLED)
    assert max(moved.values()) < 0.05


def test_a_drawer_has_trays_under_contents_that_stand_high_in_it(run_world: RunWorld) -> None:
    bodies = (
        make_body("case", "Cupboard", (0, 0, 0.8), (0.6, 0.4, 1.6)),
        make_body("drawer", "Drawer", (0.02, 0, 0.8), (0.52, 0.3, 1.32), is_free=True),
        make_body("low", "CardboardBox", (0, 0, 0.24), (0.1, 0.1, 0.16), is_free=True),
        make_body("middle", "CardboardBox", (0.1, 0, 0.58), (0.1, 0.1, 0.2), is_free=True),
        make_body("on_it", "CardboardBox", (0.1, 0, 0.74), (0.1, 0.1, 0.1), is_free=True),
    )
    simulation, _, moved = run_world(fit_scenes.world(bodies, [slide_joint("case", "drawer", middle=0.2)]))
    assert max(moved.values()) < 0.015
    surfaces = simulation.geometry[BodyId("drawer")].support_surfaces
    assert len(surfaces) == 2


def moved_by_m(before: Pose, after: Pose) -> float:
    """The distance between two positions, computed here and not by what is tested [m]."""
    return dist(before.position, after.position)


def maps_at_hand(folder: Path) -> list[Path]:
    return [bundled_kitchen(), *sorted((folder / "maps").glob("*.owl"))]


def test_at_most_one_body_in_a_hundred_moves_in_any_map_and_each_is_named(shared_data: Path) -> None:
    """Each that moves by more than 10 cm in 10 s is in a note on a cause of that."""
    paths = maps_at_hand(shared_data)
    assert {path.stem for path in paths} >= {*MAPS, "kitchen"}
    for path in paths:
        knowledge = load_knowledge([path])
        for map in knowledge.maps():
            with closing(Simulation(knowledge, MujocoEngine(), threaded=False)) as simulation:
                described = {body.id: body.pose for body in knowledge.world(map).bodies}
                report = simulation.spawn(map)
                simulation.step(10.0)
                present = {body.id: body.pose for body in simulation.snapshot().bodies}
                moved = {id for id, pose in described.items() if moved_by_m(pose, present[id]) > 0.1}
                causes = (note for note in (*report.notes, *simulation.engine.notes) if note.kind in CAUSES_OF_MOTION)
                named = {id for note in causes for id in note.ids}
                assert len(moved) <= len(described) / 100, (path.name, moved)
                assert moved <= named, path.name


@pytest.mark.parametrize("name", MAPS)
def test_nothing_moves_in_the_sample_maps_for_ten_seconds(name: str, shared_data: Path) -> None:
    knowledge = load_knowledge([shared_data / "maps" / f"{name}.owl"])
    with closing(Simulation(knowledge, MujocoEngine())) as simulation:
        report = simulation.spawn()
        assert diff(knowledge.world(), simulation.snapshot()).identical(0.0)
        assert not report.ids_with_note(SpawnNoteKind.SETTLED)
        assert max(drift(simulation, 10.0).values()) < 1e-3


def test_the_ground_is_not_below_bodies_whose_mesh_may_have_its_origin_elsewhere(tmp_path: Path) -> None:
    """Both sides of the wide handles fit equally well, which is a finding; else the ground would be below them."""
    rows = [(f"door{n}", f"handle{n}", n - 1.5) for n in range(4)]
    doors = [LoggedBody(door, "Door", (0.004, 0.6, 0.9), (0.0, y, 1.0)) for door, _, y in rows]
    handles = [LoggedBody(id, "Handle", (0.4, 0.2, 0.03), (0.0, y, 0.5), parent=door) for door, id, y in rows]
    plate = LoggedBody("plate", "BasePlate", (0.3, 0.3, 0.1), (0.0, 3.0, 0.7))
    (tmp_path / "doors.ttl").write_text(logged_map([*doors, *handles, plate]), encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load(tmp_path / "doors.ttl", conventions=UnitConventions(sizes=None))
    crate = body("crate", (0.9, 0.0, 1.5), (0.2, 0.2, 0.2), "dynamic", 1.0)
    with closing(Simulation(knowledge, MujocoEngine())) as simulation:
        simulation.spawn()
        assert any("equally well" in each.problem for each in knowledge.findings())
        (note,) = [each for each in simulation.spawn(world(crate)).notes if each.kind is SpawnNoteKind.GROUND]
        assert "0.650 m" in note.text
        simulation.step(2.0)
        assert float(simulation.state.poses[-1][2]) == pytest.approx(0.75, abs=1e-3)
