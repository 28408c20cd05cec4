"""Guessed masses and frictions: how far they vary, against mechanics, and against the masses of generated homes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from math import log

import msgspec
import numpy as np
import pytest
from scipy.stats import binom, norm

from mindstage.cli.evaluate import PlanTrial
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError, PlanError
from mindstage.homes import generate_home, true_frictions, write_home
from mindstage.imagination import Outcome, Plan, Push, Uncertainty, Wait, evaluate_plan, load_plan
from mindstage.imagination.guesses import Guess, Guesses, GuessKind
from mindstage.imagination.trials import parse_uncertainty
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Body, BodyId, World
from mindstage.simulation import Simulation
from tests.engines.scenes import body
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table

BOX_Z = TABLE_HEIGHT_M + 0.05
HEAVY = body("box", (-0.2, 0.0, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)
UNKNOWN = msgspec.structs.replace(HEAVY, physics=msgspec.structs.replace(HEAVY.physics, mass_kg=None))
GRAVITY, FRICTION = 9.81, 0.8
"""Of the earth [m/s²], and the coefficient of bodies whose material is not known."""


def pushed(box: Body, force_n: float, **options: object) -> tuple[float, object]:
    """The share of samples in which a long push along y moves a box, and the verdict."""
    plan = Plan(
        steps=(Push(thing="box", force=(0.0, force_n, 0.0), duration_s=0.4), Wait(duration_s=0.1)),
        uncertainty="guesses",
        forbid=(),
        **options,  # type: ignore[arg-type]
    )
    with on_table(box) as sim:
        sim.step(0.5)
        verdict = evaluate_plan(sim, plan, samples=120, fixed=True)
    return float(np.mean(verdict.end_poses("box")[:, 1] > 0.01)), verdict


def test_a_guessed_friction_decides_a_push_as_often_as_it_is_smaller() -> None:
    """The box slides if the push exceeds friction; much more than 1 cm within 0.4 s, but next to the limit."""
    for force_n in (4.0, 7.0):
        expected = norm.cdf(log(force_n / (FRICTION * GRAVITY)) / Guess(GuessKind.FRICTION).spread)
        share, _ = pushed(HEAVY, force_n)
        low, high = binom.ppf([0.0005, 0.9995], 120, expected) / 120
        assert low - 0.04 <= share <= high, force_n


def test_the_guess_that_matters_most_is_named_and_the_others_are_not() -> None:
    falls = Plan(
        steps=(Push(thing="box", force=(0.0, 7.0, 0.0), duration_s=1.2), Wait(duration_s=0.5)), uncertainty="guesses"
    )
    other = body("other", (-0.8, 0.3, BOX_Z), (0.1, 0.1, 0.1), "dynamic")
    with on_table(HEAVY, other) as sim:
        verdict = evaluate_plan(sim, falls, samples=60, fixed=True)
        again = evaluate_plan(sim, falls, samples=60, fixed=True, workers=2)
    assert 0 < verdict.succeeded < 60
    assert verdict.sensitivity.startswith("the friction matters most of what is guessed: without its spread, ")
    assert verdict.sensitivity in str(verdict)
    assert verdict.to_json() == again.to_json()


def test_no_guess_matters_if_all_samples_end_alike() -> None:
    with on_table(UNKNOWN) as sim:
        verdict = evaluate_plan(sim, Plan(steps=(Wait(duration_s=0.2),)), uncertainty="guesses", samples=20, fixed=True)
    assert verdict.outcome is Outcome.UNKNOWN or verdict.outcome is Outcome.SUCCEEDED
    assert verdict.sensitivity == "no guess matters: all 20 samples ended alike"


def test_guesses_are_assumptions_of_every_verdict() -> None:
    with on_table(UNKNOWN) as sim:
        verdict = evaluate_plan(sim, Plan(steps=(Push(thing="box", force=(0.1, 0.0, 0.0)),)))
        assert "the mass of box is a guess: estimated from the volume" in verdict.assumptions
        assert any(each.startswith("the friction of box and 2 bodies is a guess") for each in verdict.assumptions)
        assert verdict.assumptions[-1].startswith("no uncertainty is stated: guesses are taken as true")
    with on_table(HEAVY) as sim:
        stated = evaluate_plan(sim, Plan(steps=(Push(thing="box", force=(0.1, 0.0, 0.0)),)))
        assert not any(each.startswith("the mass of") for each in stated.assumptions)


def test_answers_about_forces_name_guesses(answering: Simulation) -> None:
    row = answering.ask("would_tip", "box", 200.0, heading_deg=90.0)[0]
    assert "the mass of box is a guess" in row.why
    assert "the friction of box" in row.why
    varied = answering.ask("would_tip", "box", 200.0, heading_deg=90.0, uncertainty="guesses", samples=5)[0]
    assert varied.tried == 5


@pytest.fixture
def answering() -> Simulation:
    simulation = on_table(UNKNOWN)
    simulation.step(0.2)
    return simulation


def test_guesses_are_given_as_a_word_wherever_uncertainty_is() -> None:
    for text in (
        "steps: [{do: wait, duration_s: 1}]\nuncertainty: guesses\n",
        "steps: [{do: wait, duration_s: 1}]\nuncertainty: [guesses]\n",
        "steps: [{do: wait, duration_s: 1}]\nguesses: true\n",
    ):
        assert load_plan(text).plan.guesses
    mixed = load_plan("steps: [{do: wait, duration_s: 1}]\nuncertainty: [guesses, {thing: box, mass: 0.1}]\n").plan
    assert mixed.guesses
    assert mixed.uncertainty == (Uncertainty(thing="box", mass=0.1),)
    with pytest.raises(PlanError, match="uncertainty"):
        load_plan("steps: [{do: wait, duration_s: 1}]\nuncertainty: gueses\n")
    with on_table(HEAVY) as sim, pytest.raises(PlanError, match="'gueses'"):
        evaluate_plan(sim, Plan(steps=(Wait(duration_s=0.1),)), uncertainty="gueses")  # type: ignore[arg-type]


def test_words_of_an_uncertainty_are_divided_by_spaces_or_commas_and_numbers_by_commas() -> None:
    stated = Uncertainty(thing="box", position_m=(0.01, 0.02, 0.0), mass=0.1)
    for text in ("position_m=0.01,0.02,0 mass=0.1", "mass=0.1, position_m=0.01,0.02,0"):
        assert parse_uncertainty("box", text) == (stated,)
        assert parse_uncertainty("box", f"{text},guesses") == ("guesses", stated)
    assert PlanTrial(uncertainty=["box position_m=0.01,0.02,0 mass=0.1", "guesses"]).arguments()["uncertainty"] == [
        stated,
        "guesses",
    ]
    for text in ("position_m=0.01,0.02", "position_m=0.01,,2", "mass=0.1,0.2", "mass=nan", "0.1"):
        with pytest.raises(InvalidArgumentError, match="uncertainty"):
            parse_uncertainty("box", text)


def test_a_mass_that_is_stated_as_uncertain_is_no_guess() -> None:
    plan = Plan(steps=(Wait(duration_s=0.1),), uncertainty=("guesses", Uncertainty(thing="box", mass=0.01)))
    with on_table(UNKNOWN) as sim:
        evaluate_plan(sim, plan, samples=3, fixed=True)
        assert Guesses.of(sim).masses == (BodyId("box"),)


def test_nine_of_ten_true_values_of_generated_homes_are_within_the_spreads() -> None:
    errors: dict[str, list[bool]] = {}
    for seed, style in enumerate(("kitchen", "office", "flat", "kitchen", "lab", "shop"), start=11):
        home = generate_home(seed=seed, style=style, rooms=1 if style == "flat" else None)
        for what, guess, error in guess_errors(home):
            is_within = abs(error) <= norm.ppf(0.95) * guess.spread
            errors.setdefault(what, []).append(is_within)
    assert {what: len(values) > 60 for what, values in errors.items()} == dict.fromkeys(
        ("mass", "friction", "slide", "hinge"), True
    )
    for what, values in errors.items():
        assert np.mean(values) >= 0.9, what


def guess_errors(home: World) -> Iterator[tuple[str, Guess, float]]:
    """The logarithms of true values relative to those of an engine that gets neither masses nor frictions."""
    things, joints = true_frictions(home)
    bare = tuple(
        msgspec.structs.replace(each, physics=msgspec.structs.replace(each.physics, mass_kg=None))
        for each in home.bodies
    )
    with Simulation(KnowledgeBase(), MujocoEngine(), threaded=False) as sim:
        sim.spawn(msgspec.structs.replace(home, bodies=bare))
        sim.step(0.01)
        guesses = {(each.kind, each.body): each for each in Guesses.of(sim).all()}
        cache = sim.engine.run(lambda engine: engine._cache)  # type: ignore[attr-defined]
        models = [region.compiled for region in cache.regions]
        for body in home.bodies:
            if body.id in things:
                mass = cache.builder.mass_properties.mass(body.id, is_dynamic=True)
                yield "mass", guesses[GuessKind.MASS, body.id], log((body.physics.mass_kg or 0.0) / mass)
                geometry = sim.geometry.get(body.id)
                friction = 0.8 if geometry is None or geometry.friction is None else geometry.friction
                yield "friction", guesses[GuessKind.FRICTION, None], log(things[body.id].coefficient / friction)
        for joint in home.joints:
            (guessed,) = (
                float(each.model.dof_frictionloss[each.joints[joint.id].dof_address])
                for each in models
                if joint.id in each.joints
            )
            guess = guesses[GuessKind.JOINT_FRICTION, joint.child]
            yield "hinge" if guess.is_hinge else "slide", guess, log(joints[joint.id] / guessed)


def test_true_frictions_are_those_of_the_truth_file_and_differ_by_seed() -> None:
    home, other = generate_home(seed=11), generate_home(seed=12)
    things, joints = true_frictions(home)
    truth = json.loads(write_home(home, dialect="semlog").truth)
    stated = {each["id"]: (each["material"], each["friction"]) for each in truth["bodies"].values()}
    assert {id: each for id, each in stated.items() if each[1] is not None} == {
        id: (each.material, each.coefficient) for id, each in things.items()
    }
    assert {each["id"]: each["friction"] for each in truth["joints"].values()} == joints
    assert true_frictions(home) == true_frictions(generate_home(seed=11))
    assert len({each.coefficient for each in things.values()}) > 0.8 * len(things)
    again = true_frictions(other)[0]
    same = things.keys() & again.keys()
    assert sum(things[id] == again[id] for id in same) < 0.2 * len(same)
    assert all(0.18 <= each.coefficient <= 0.75 for each in things.values())
    assert {each.material for each in things.values()} >= {"metal", "ceramics", "paper", "plastic"}
