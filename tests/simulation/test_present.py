"""The present: poses, what is on what, and joint positions after the world has changed, by questions and by SPARQL."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from mindstage import MujocoEngine, NullEngine, Simulation
from mindstage.engines import Engine
from mindstage.errors import InvalidArgumentError, SparqlSyntaxError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.endpoint import SparqlEndpoint
from mindstage.knowledge.queries import get_question, pose_of, what_is
from mindstage.knowledge.questions import StateAccess
from mindstage.maps import bundled_kitchen
from mindstage.scene import Body, BodyId, Iri, Pose, World
from mindstage.scene.edits import SetPoses
from tests.maps.dialect_maps import soma_map
from tests.maps.test_soma import located

KITCHEN = "http://mindstage.org/maps/kitchen.owl#"
MILK, FRIDGE_HINGE = BodyId("milk_carton_1"), BodyId("fridge_door_hinge")
CUP = Iri("http://knowrob.org/kb/knowrob.owl#Cup")
NEW = Pose((1.0, 2.0, 3.0), (math.sqrt(0.75), 0.0, 0.0, 0.5))
POSE = """SELECT ?at ?turned WHERE { %s { kitchen:milk_carton_1 knowrob:pose ?pose .
    ?pose knowrob:translation ?at ; knowrob:quaternion ?turned } }"""
NAMED = "GRAPH <urn:mindstage:present>"


@pytest.fixture(scope="module")
def kb() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture(scope="module")
def sim(kb: KnowledgeBase) -> Iterator[Simulation]:
    """The kitchen with the milk at another pose, and a cup that no map has."""
    with Simulation(kb, NullEngine()) as simulation:
        simulation.spawn()
        cup = Body(id=BodyId("cup"), iri=Iri("http://e.org/cup"), cls=CUP, pose=Pose())
        simulation.spawn(World(iri=Iri("http://e.org/cup"), bodies=(cup,)), persistent=False)
        simulation.engine.run(lambda engine: engine.apply(SetPoses({MILK: NEW})), label="move")
        yield simulation


def milk_of(kb: KnowledgeBase) -> Body:
    return next(body for body in kb.world().bodies if body.id == MILK)


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


# -- questions ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", [NullEngine, MujocoEngine])
def test_answers_while_things_move_are_those_of_a_new_look_at_the_world(
    kb: KnowledgeBase, engine: Callable[[], Engine]
) -> None:
    asked: tuple[tuple[str, dict[str, object]], ...] = (
        ("where_is", {}),
        ("distance", {"thing": "milk_carton_1"}),
        ("nearest", {"thing": "milk_carton_1", "count": 5}),
        ("direction_of", {"other": "milk_carton_1"}),
        ("is_between", {"one": "fridge", "other": "table"}),
        ("in_room", {}),
        ("articulated_parts", {"thing": "fridge"}),
        ("path", {"start": "fridge", "goal": "table"}),
        ("free_place", {"thing": "milk_carton_2", "support": "table"}),
    )
    rng = random.Random(4)
    with Simulation(kb, engine(), primitive_shapes=True) as sim:
        sim.spawn()
        world = sim.snapshot()
        held = {end for link in (*world.joints, *world.attachments) for end in (link.parent, link.child)}
        things = [body.id for body in world.bodies if body.physics.is_dynamic and body.id not in held]
        for number in range(25):
            moved = rng.sample(things, 2)
            places = {id: Pose((rng.uniform(-1, 3), rng.uniform(-1, 3), rng.uniform(0.1, 2))) for id in moved}
            sim.edits.move_all(places)
            if number == 3:
                sim.edits.set_label(things[0], "renamed")
                sim.edits.delete([things.pop()])
            sim.step(0.02)
            fresh = msgspec.structs.replace(sim.current_state())  # without what was derived of it
            for name, args in rng.sample(asked, 1):  # what the others need is derived of an older state
                resolved = {key: value if key == "count" else Iri(KITCHEN + str(value)) for key, value in args.items()}
                anew = get_question(name).ask(kb, resolved, present=StateAccess(kb, lambda state=fresh: state))
                assert [repr(row) for row in sim.ask(name, **args)] == [repr(row) for row in anew], name


def test_pose_of_gives_the_pose_of_the_engine_and_says_so(sim: Simulation, kb: KnowledgeBase) -> None:
    (row,) = sim.ask(pose_of, MILK)
    assert (row.position, row.quaternion, row.frame, row.source) == (NEW.position, NEW.quaternion, "map", "null")
    assert kb.explain(pose_of, row)[1] == "as null has it now"
    (row,) = kb.ask(pose_of, MILK)
    assert (row.position, row.source) == (milk_of(kb).pose.position, "map")
    assert kb.explain(pose_of, row)[1] == "as the map has it; no simulation is running"


def test_pose_of_everything_has_each_thing_once(sim: Simulation) -> None:
    world = sim.snapshot()
    expected = {entity.iri: entity.pose.position for entity in (*world.bodies, *world.joints, *world.lights)}
    rows = sim.ask("pose_of")
    assert {row.thing: row.position for row in rows} == expected
    assert len(rows) == len(expected)


def test_a_body_without_a_map_has_a_pose_too(sim: Simulation) -> None:
    (row,) = sim.ask("pose_of", "cup")
    assert (row.thing, row.source) == ("http://e.org/cup", "null")
    (row,) = sim.ask("what_is", "cup")
    assert (row.pose, row.classes, row.source) == (Pose(), (CUP,), "null")


def test_what_is_has_the_pose_of_the_engine_and_marks_it(sim: Simulation, kb: KnowledgeBase) -> None:
    (live,) = sim.ask(what_is, MILK)
    assert (live.pose, live.source) == (NEW, "null")
    (given,) = kb.ask(what_is, MILK)
    assert (given.pose, given.source) == (milk_of(kb).pose, "map")
    assert (live.size, live.facts, live.classes) == (given.size, given.facts, given.classes)


def test_what_has_no_pose_is_reported_with_the_reason(sim: Simulation) -> None:
    with Simulation(sim.knowledge, NullEngine()) as empty:
        empty.spawn(World(iri=sim.knowledge.maps()[0]))
        answers = empty.ask("pose_of", MILK)
    assert not answers
    assert (
        answers.missing[0].reason
        == "milk_carton_1 (MilkCarton) has no pose: no map or simulation that was asked places it"
    )


def test_positional_arguments_are_in_the_order_of_the_question(kb: KnowledgeBase, sim: Simulation) -> None:
    assert kb.ask("storage_place", "CowsMilk") == kb.ask("storage_place", item="CowsMilk")
    assert list(sim.ask("handle_of", None, "fridge_door_handle")) == list(
        kb.ask("handle_of", handle="fridge_door_handle")
    )
    with pytest.raises(InvalidArgumentError, match="pose_of: 3 is one argument too many; it takes thing, map"):
        kb.ask("pose_of", MILK, None, 3)
    with pytest.raises(InvalidArgumentError, match="pose_of: thing is given twice; it takes thing, map"):
        sim.ask("pose_of", MILK, thing=MILK)


# -- SPARQL ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("graph", ["<urn:mindstage:present>", "now:present"])
def test_the_same_pattern_gives_the_pose_of_the_map_or_of_the_present(graph: str, sim: Simulation) -> None:
    given = milk_of(sim.knowledge).pose.position
    prefix = "PREFIX now: <urn:mindstage:> "
    ((at, _),) = sim.sparql(POSE % "")
    assert at is not None
    assert numbers(at.value) == pytest.approx(given)
    for query in ((POSE % "").replace("WHERE", f"FROM {graph}"), POSE % f"GRAPH {graph}"):
        ((at, turned),) = sim.sparql(prefix + query)
        assert at is not None
        assert turned is not None
        assert numbers(at.value) == list(NEW.position)
        assert numbers(turned.value) == pytest.approx(NEW.quaternion)


def test_the_present_is_not_mixed_with_the_statements_of_the_map(sim: Simulation) -> None:
    count = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o %s }"
    without = sim.sparql(count % "")
    assert sim.sparql(count % f"FILTER EXISTS {{ {NAMED} {{ ?a knowrob:pose ?b }} }}") == without
    graphs = "SELECT DISTINCT ?g { GRAPH ?g { ?s ?p ?o } %s }"
    assert "urn:mindstage:present" not in {term.value for term in sim.sparql(graphs % "")["g"] if term}


def test_the_present_has_classes_places_and_where_it_comes_from(sim: Simulation) -> None:
    inside = sim.sparql(f"SELECT ?thing {{ {NAMED} {{ ?thing knowrob:in-ContGeneric kitchen:fridge ; a ?kind }} }}")
    expected = {row.thing for row in sim.ask("where_is", relation="inside", other="fridge")}
    assert expected
    assert {term.value for term in inside["thing"] if term} >= expected
    assert KITCHEN + MILK not in {term.value for term in inside["thing"] if term}
    (source,) = sim.sparql(f"SELECT ?name {{ {NAMED} {{ <urn:mindstage:present> ms:source ?name }} }}")["name"]
    assert source.value == "null"
    assert sim.sparql(f"ASK {{ {NAMED} {{ <http://e.org/cup> a knowrob:Cup ; knowrob:pose ?pose }} }}")


def test_the_present_has_the_positions_of_joints(kb: KnowledgeBase) -> None:
    mujoco = pytest.importorskip("mindstage.engines.mujoco")
    with Simulation(kb, mujoco.MujocoEngine()) as sim:
        sim.spawn()
        sim.joint(FRIDGE_HINGE).open()
        turned = sim.current_state().joint_positions
        assert turned is not None
        query = "SELECT ?axis ?at FROM <urn:mindstage:present> { kitchen:fridge_door_hinge soma:hasJointState ?state . "
        ((axis, at),) = sim.sparql(query + "?state a soma:JointState ; ms:axis ?axis ; soma:hasJointPosition ?at }")
    assert axis is not None
    assert at is not None
    assert float(at.value) == pytest.approx(turned[FRIDGE_HINGE][3 + ["twist", "swing2", "swing1"].index(axis.value)])
    assert abs(float(at.value)) > 1.0


def test_without_a_simulation_the_present_is_that_of_the_maps(kb: KnowledgeBase) -> None:
    assert kb.sparql(POSE % NAMED).rows == kb.sparql(POSE % "").rows
    assert kb.sparql(f"SELECT ?name {{ {NAMED} {{ ?g ms:source ?name }} }}").to_dicts() == [{"name": "map"}]


def test_a_map_of_knowrob_2_has_a_present_in_its_vocabulary(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(
        soma_map(located("table", "soma:Table", at="0 0 0.5"), located("cup", at="0 0 1.5")), encoding="utf-8"
    )
    kb = KnowledgeBase()
    kb.load(path)
    query = "SELECT ?at %s { <http://example.org/old.owl#cup> "
    query += "soma:hasLocalization/soma:hasSpaceRegion/knowrob:translation ?at }"
    with Simulation(kb, NullEngine()) as sim:
        sim.spawn()
        before = sim.sparql(query % "").rows
        assert before
        assert sim.sparql(query % "FROM <urn:mindstage:present>").rows == before
        sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("cup"): Pose((4.0, 5.0, 6.0))})), label="move")
        (at,) = sim.sparql(query % "FROM <urn:mindstage:present>")["at"]
        assert numbers(at.value) == [4.0, 5.0, 6.0]
        assert sim.sparql(query % "").rows == before


def test_the_present_of_a_store_in_a_folder_leaves_nothing_behind(tmp_path: Path) -> None:
    with KnowledgeBase(store=tmp_path / "store") as kb:
        kb.load(bundled_kitchen())
        with Simulation(kb, NullEngine()) as sim:
            sim.spawn()
            sim.engine.run(lambda engine: engine.apply(SetPoses({MILK: NEW})), label="move")
            ((at, _),) = sim.sparql(POSE % NAMED)
            assert at is not None
            assert numbers(at.value) == list(NEW.position)
            ((at, _),) = sim.sparql(POSE % "")
            assert at is not None
            assert numbers(at.value) != list(NEW.position)
    assert not [path.name for path in (tmp_path / "store").iterdir() if "as-asked" in path.name]


def test_an_endpoint_has_no_present() -> None:
    kb = KnowledgeBase(bundled_ontology=False, endpoint=SparqlEndpoint("http://localhost:9/query"))
    kb.maps = lambda: ()  # type: ignore[method-assign]  # nothing is fetched
    with pytest.raises(SparqlSyntaxError, match="the current state or episodes; use the questions pose_of"):
        kb.sparql("ASK { GRAPH <urn:mindstage:present> { ?s ?p ?o } }")
