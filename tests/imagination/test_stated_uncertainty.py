"""Uncertainty that maps and ontologies state is used by verdicts and questions, and reported."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.imagination import Outcome, Plan, Push, Uncertainty, Wait, evaluate_plan
from mindstage.imagination.stated_uncertainty import stated_uncertainty
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World
from mindstage.simulation import Simulation

MAP = "http://example.org/edge.owl#"
PREFIXES = f"""
@prefix : <{MAP}> . @prefix ms: <http://mindstage.org/ontology#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix knowrob: <http://knowrob.org/kb/knowrob.owl#> . @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
:Carton rdfs:subClassOf knowrob:Box .
"""


def simulate(folder: Path, statements: str) -> Simulation:
    """A box at the edge of a table, and another one in its middle; the edge is at x = 0."""
    path = folder / "stated.ttl"
    path.write_text(PREFIXES + statements, encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load(path)

    def body(id: str, cls: str, x: float, size: tuple[float, float, float], z: float, *, fixed: bool = False) -> Body:
        physics = BodyPhysics(mobility=Mobility.STATIC if fixed else Mobility.DYNAMIC, mass_kg=1.0)
        return Body(id=BodyId(id), iri=Iri(MAP + id), cls=Iri(cls), pose=Pose((x, 0.0, z)), size=size, physics=physics)

    table = body("table", MAP + "Table", -0.5, (1.0, 1.0, 0.7), 0.35, fixed=True)
    edge = body("edge_box", MAP + "Carton", -0.005, (0.1, 0.1, 0.1), 0.75)
    middle = body("middle_box", MAP + "Other", -0.5, (0.1, 0.1, 0.1), 0.75)
    simulation = Simulation(knowledge, MujocoEngine(), primitive_shapes=True, threaded=False)
    simulation.spawn(World(iri=Iri(MAP + "map"), bodies=(table, edge, middle)), ground=True)
    return simulation


@pytest.fixture
def uncertain(tmp_path: Path) -> Iterator[Simulation]:
    with simulate(tmp_path, ":edge_box ms:positionDeviation 0.02 .") as simulation:
        yield simulation


def test_a_stated_deviation_makes_samples_differ_and_is_an_assumption_of_the_verdict(uncertain: Simulation) -> None:
    verdict = evaluate_plan(uncertain, Plan(steps=(Wait(duration_s=1.0),)), samples=60, seed=2, fixed=True)
    assert verdict.outcome is Outcome.FAILED
    assert verdict.samples == 60
    assert 0.4 < (verdict.probability or 0.0) < 0.8  # 0.6: it falls if it is displaced by a quarter of 0.02 m
    assert any("edge_box: position_m 0.02" in each for each in verdict.assumptions)


def test_questions_use_it_and_say_so(uncertain: Simulation) -> None:
    (row,) = uncertain.ask("stays", "edge_box", min_probability=0, samples=20)
    assert 0.0 < row.probability < 1.0
    assert "stated in the loaded maps or ontologies, of edge_box" in row.why


def test_the_plan_precedes_the_map(uncertain: Simulation) -> None:
    plan = Plan(steps=(Wait(duration_s=0.2),), uncertainty=(Uncertainty(thing="edge_box", position_m=1e-6),))
    assert evaluate_plan(uncertain, plan, samples=20).probability == 1.0


def test_a_body_precedes_its_class(tmp_path: Path) -> None:
    statements = (
        "knowrob:Box ms:positionDeviation 0.5 ; ms:massDeviation 0.2 . :edge_box ms:positionDeviation '0 0.1 0'."
    )
    with simulate(tmp_path, statements) as simulation:
        of_class, of_body = stated_uncertainty(simulation).uncertainty
    assert (of_class.position_m, of_class.mass) == (0.5, 0.2)
    assert (of_body.thing, of_body.position_m) == (MAP + "edge_box", (0.0, 0.1, 0.0))


def test_a_class_without_bodies_is_not_uncertain(tmp_path: Path) -> None:
    with simulate(tmp_path, ":Fridge a owl:Class ; ms:positionDeviation 0.5 .") as simulation:
        assert stated_uncertainty(simulation).uncertainty == ()
        assert evaluate_plan(simulation, Plan(steps=(Wait(duration_s=0.1),)), samples=9).samples == 1


@pytest.mark.parametrize("text", ["'far'", "'-0.1'", "'0.1 0.2'", "'nan'", "'inf'", ":Carton"])
def test_what_is_no_deviation_is_ignored_and_reported(tmp_path: Path, text: str) -> None:
    with simulate(tmp_path, f":edge_box ms:positionDeviation {text} .") as simulation:
        verdict = evaluate_plan(simulation, Plan(steps=(Wait(duration_s=0.1),)), samples=9)
    assert verdict.samples == 1
    assert any("positionDeviation of edge_box is ignored" in each for each in verdict.assumptions)


def test_a_thing_that_is_stated_as_a_deviation_is_named(tmp_path: Path) -> None:
    with simulate(tmp_path, ":edge_box ms:positionDeviation :Carton .") as simulation:
        found = stated_uncertainty(simulation)
    assert found.uncertainty == ()
    cause = f"'{MAP}Carton' is no standard deviation"
    assert found.notes == (f"ms:positionDeviation of edge_box is ignored: {cause}",)


def test_the_covariance_of_the_best_perception_of_knowrob_is_used(tmp_path: Path) -> None:
    def perception(name: str, variance: float) -> str:
        elements = f"knowrob:m00 {variance} ; knowrob:m11 {4 * variance} ; knowrob:m22 0.0 ; knowrob:m55 0.01"
        return f""":{name} knowrob:objectActedOn :edge_box ; knowrob:covariance :of_{name} .
            :of_{name} a knowrob:CovarianceMatrix ; {elements} ."""

    with simulate(tmp_path, perception("first", 0.09) + perception("second", 0.0001)) as simulation:
        (stated,) = stated_uncertainty(simulation).uncertainty
    assert stated.position_m == pytest.approx((0.01, 0.02, 0.0))
    assert stated.yaw_rad == pytest.approx(0.1)


def test_friction_and_mass_vary_how_far_a_push_goes(tmp_path: Path) -> None:
    with simulate(tmp_path, ":middle_box ms:massDeviation 0.3 ; ms:frictionDeviation 0.3 .") as simulation:
        plan = Plan(steps=(Push(thing="middle_box", force=(0.0, 9.0, 0.0), duration_s=0.2), Wait(duration_s=0.5)))
        verdict = evaluate_plan(simulation, plan, samples=12, fixed=True)
    assert verdict.end_poses("middle_box")[:, 1].std() > 0.005
