"""The rule that ends trials errs as seldom as it promises: exact distributions of when it ends, and of what it says."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np
import pytest
from scipy.stats import binom

from mindstage.imagination import (
    IntervalKind,
    Outcome,
    Plan,
    SampleResult,
    Uncertainty,
    Wait,
    confidence_sequence,
    evaluate_plan,
    samples_to_decide,
    wilson_interval,
)
from tests.engines.scenes import body
from tests.imagination.scenes import on_table
from tests.imagination.test_verdicts import Given

Rule = Callable[[int, int], tuple[float, float]]
LOOK = 10
"""The interval is looked at after each such number of samples."""


def boundaries(rule: Rule, threshold: float, samples: int) -> list[tuple[int, int]]:
    """Of each look: below which number of successes it has failed, and from which one it has succeeded."""
    found = []
    low, high = 0, 0
    for n in range(LOOK, samples + 1, LOOK):
        low = next(each for each in count(low) if each > n or rule(each, n)[1] >= threshold)
        high = next(each for each in count(max(low, high)) if each > n or rule(each, n)[0] >= threshold)
        found.append((low, high))
    return found


def outcomes(limits: list[tuple[int, int]], p: float) -> tuple[float, float, float]:
    """The probabilities that a trial ends as succeeded, as failed, or as unknown, if each sample succeeds with p."""
    succeeded = failed = 0.0
    open_ = np.array([1.0])
    batch = binom.pmf(np.arange(LOOK + 1), LOOK, p)
    for low, high in limits:
        open_ = np.convolve(open_, batch)
        failed += open_[:low].sum()
        succeeded += open_[high:].sum()
        open_[:low] = open_[high:] = 0.0
    return succeeded, failed, float(open_.sum())


@pytest.fixture(scope="module")
def limits() -> dict[float, list[tuple[int, int]]]:
    return {threshold: boundaries(confidence_sequence, threshold, 1000) for threshold in (0.1, 0.5, 0.9, 0.99)}


def test_a_trial_is_wrong_in_at_most_one_of_forty_however_near_the_threshold(
    limits: dict[float, list[tuple[int, int]]],
) -> None:
    for threshold, of_threshold in limits.items():
        for p in (*np.linspace(0.001, 0.999, 60), threshold - 1e-4, threshold, threshold + 1e-4):
            succeeded, failed, _ = outcomes(of_threshold, p)
            assert (failed if p >= threshold else succeeded) <= 0.025, (threshold, p)


def test_the_check_notices_an_interval_for_a_fixed_number_of_samples() -> None:
    """Wilson's interval, looked at again and again, errs about ten times as often as it may."""
    wrong = outcomes(boundaries(wilson_interval, 0.9, 1000), 0.9 - 1e-4)[0]
    assert wrong > 0.1


def test_a_thousand_samples_decide_a_twentieth_from_the_threshold(limits: dict[float, list[tuple[int, int]]]) -> None:
    assert outcomes(limits[0.9], 0.95)[2] <= 0.02
    assert outcomes(limits[0.1], 0.05)[2] <= 0.02
    assert outcomes(limits[0.5], 0.6)[2] <= 0.02


def test_the_interval_has_the_bounds_of_its_definition() -> None:
    """The mixture by numerical integration on a grid, instead of by incomplete beta functions."""
    low, high = confidence_sequence(17, 20)
    q = (np.arange(2_000_000) + 0.5) / 2_000_000
    weight = q**-0.5 * (1 - q) ** -0.5
    for t, beyond in ((low, q > low), (high, q < high)):
        mixed = np.average(q[beyond] ** 17 * (1 - q[beyond]) ** 3, weights=weight[beyond])
        assert mixed / (t**17 * (1 - t) ** 3) == pytest.approx(40.0, rel=2e-3)
    assert low < wilson_interval(17, 20)[0] < wilson_interval(17, 20)[1] < high
    assert confidence_sequence(0, 0) == (0.0, 1.0)
    assert confidence_sequence(0, 30)[0] == 0.0
    assert confidence_sequence(30, 30)[1] == 1.0


def test_intervals_are_symmetric_and_finite_for_any_number_of_samples() -> None:
    for successes, samples in ((3, 10), (0, 1), (999_999, 1_000_000), (500_000, 1_000_000), (1, 10_000_000)):
        low, high = confidence_sequence(successes, samples)
        other_low, other_high = confidence_sequence(samples - successes, samples)
        assert 0.0 <= low <= successes / samples <= high <= 1.0
        assert (low, high) == pytest.approx((1.0 - other_high, 1.0 - other_low), abs=1e-12)


def test_the_number_of_samples_that_would_decide_is_that_of_going_on() -> None:
    more = samples_to_decide(92, 100, 0.9)
    assert more is not None
    enough, fewer = 100 + more, 100 + more // 2
    assert confidence_sequence(round(0.92 * enough) + 1, enough)[0] >= 0.9
    assert confidence_sequence(round(0.92 * fewer), fewer)[0] < 0.9
    assert samples_to_decide(100, 100, 0.9) == 0
    assert samples_to_decide(90, 100, 0.9) is None, "no number decides what is exactly at the threshold"
    assert samples_to_decide(0, 0, 0.9) is None
    assert samples_to_decide(60, 100, 0.9, unknown=40) is None, "unknown samples remain unknown"


def bernoulli(p: float, seed: int, samples: int) -> Given:
    succeeds = np.random.default_rng(seed).random(samples) < p
    return Given(
        *(
            SampleResult(index=index, outcome=Outcome.SUCCEEDED if each else Outcome.FAILED)
            for index, each in enumerate(succeeds.tolist())
        )
    )


def test_trials_end_by_that_rule_and_an_unknown_verdict_says_what_would_decide() -> None:
    plan = Plan(steps=(Wait(duration_s=0.1),), uncertainty=(Uncertainty(thing="box", mass=0.1),))
    with on_table(body("box", (-0.5, 0.0, 0.75), (0.2, 0.1, 0.1), "dynamic", 1.0)) as sim:
        verdicts = [evaluate_plan(sim, plan, samples=1000, workers=bernoulli(0.95, seed, 1000)) for seed in range(60)]
        assert sum(each.outcome is Outcome.SUCCEEDED for each in verdicts) >= 58
        for each in verdicts:
            assert each.interval == confidence_sequence(each.succeeded, each.samples)
            assert each.interval_kind is IntervalKind.ALWAYS_VALID
        assert any(each.samples < 200 and each.stopped == "the interval is at least 0.9" for each in verdicts)
        few = evaluate_plan(sim, plan, samples=50, workers=bernoulli(0.95, 3, 50))
        assert few.outcome is Outcome.UNKNOWN
        assert few.more_samples is not None
        assert f"it ended since all samples were run; about {few.more_samples:,} more samples" in str(few)
        fixed = evaluate_plan(sim, plan, samples=300, fixed=True, workers=bernoulli(0.95, 1, 300))
        assert (fixed.samples, fixed.interval_kind) == (300, IntervalKind.WILSON)
        assert fixed.interval == wilson_interval(fixed.succeeded, 300)
        assert "95 % interval after Wilson" in str(fixed)
