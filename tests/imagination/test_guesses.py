"""Guessed masses and frictions: how far they vary, against mechanics, and against the masses of generated homes."""

from __future__ import annotations

from math import log

import msgspec
import numpy as np
import pytest
from scipy.stats import binom, norm

from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import PlanError
from mindstage.homes import generate_home
from mindstage.imagination import Outcome, Plan, Push, Uncertainty, Wait, evaluate_plan, load_plan
from mindstage.imagination.guesses import Guesses, GuessKind
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Body, BodyId
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
        expected = norm.cdf(log(force_n / (FRICTION * GRAVITY)) / GuessKind.FRICTION.spread)
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


def test_a_mass_that_is_stated_as_uncertain_is_no_guess() -> None:
    plan = Plan(steps=(Wait(duration_s=0.1),), uncertainty=("guesses", Uncertainty(thing="box", mass=0.01)))
    with on_table(UNKNOWN) as sim:
        evaluate_plan(sim, plan, samples=3, fixed=True)
        assert Guesses.of(sim).masses == (BodyId("box"),)


@pytest.mark.parametrize("style", ["kitchen", "office", "flat"])
def test_nine_of_ten_true_masses_of_a_generated_home_are_within_the_spread(style: str) -> None:
    home = generate_home(seed=11, style=style)
    truth = {each.id: each.physics.mass_kg for each in home.bodies if each.physics.is_dynamic and each.physics.mass_kg}
    bare = tuple(
        msgspec.structs.replace(each, physics=msgspec.structs.replace(each.physics, mass_kg=None))
        for each in home.bodies
    )
    with Simulation(KnowledgeBase(), MujocoEngine(), threaded=False) as sim:
        sim.spawn(msgspec.structs.replace(home, bodies=bare))
        builder = sim.engine.run(lambda engine: engine._cache.builder)  # type: ignore[attr-defined]
        guessed = {id: builder.mass_properties.mass(id, is_dynamic=True) for id in truth}
        assert set(truth) <= set(Guesses.of(sim).masses)
    errors = np.array([log(mass / guessed[id]) for id, mass in truth.items()])
    assert np.mean(np.abs(errors) <= norm.ppf(0.95) * GuessKind.MASS.spread) >= 0.9
