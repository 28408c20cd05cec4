"""Confidence intervals of the probability with which samples succeed, for a fixed and for an open number of samples.

An interval for a fixed number of samples errs more often than it says if it is looked at after each sample, and decides
when they end. `confidence_sequence` holds at all numbers of samples at once: the probability that any of its intervals
ever misses the true value is at most 5 %, 2.5 % on each side, whatever the value and the rule for ending.
"""

from __future__ import annotations

from math import inf, log, sqrt

import numpy as np
from scipy.special import betaincc, betaln

from mindstage.ranges import Fraction, Index, checked

__all__ = ["MAX_ESTIMATE", "confidence_sequence", "samples_to_decide", "wilson_interval"]

_Z = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""
_LOG_BOUND = log(1 / 0.025)
"""By Ville's inequality, a test martingale ever exceeds 40 with a probability of at most 2.5 %."""
_PRIOR = 0.5
"""Both parameters of Jeffreys' beta distribution, over which the likelihood is mixed."""
_BISECTIONS = 60
MAX_ESTIMATE = 10_000_000
"""A larger number of samples is not estimated."""


@checked
def wilson_interval(successes: Index, samples: Index) -> tuple[float, float]:
    """The 95 % confidence interval of a probability after Wilson (1927), the score interval without correction.

    It holds for a number of samples that was fixed before the first one.

    Args:
        successes: number of samples that succeeded.
        samples: number of all samples; without any, the interval is 0 to 1.
    """
    if samples == 0:
        return 0.0, 1.0
    p, square = successes / samples, _Z * _Z
    middle = (p + square / (2 * samples)) / (1 + square / samples)
    half = _Z * sqrt(p * (1 - p) / samples + square / (4 * samples * samples)) / (1 + square / samples)
    low = 0.0 if successes == 0 else max(0.0, middle - half)
    return low, 1.0 if successes == samples else min(1.0, middle + half)


@checked
def confidence_sequence(successes: Index, samples: Index) -> tuple[float, float]:
    """The 95 % interval of a probability that holds at all numbers of samples at once, at 2.5 % on each side.

    Each bound is where a test of "the probability is at most (at least) t" has just been decided. The test statistic
    is the likelihood, mixed over Jeffreys' distribution beyond t, divided by that of t: a nonnegative supermartingale
    under the hypothesis, which exceeds 40 at any time with a probability of at most 1/40 (Ville 1939). The mixture is
    that of Robbins, Statistical methods related to the law of the iterated logarithm, Ann. Math. Stat. 41 (1970), for
    binomial samples as in Howard, Ramdas, McAuliffe and Sekhon, Time-uniform, nonparametric, nonasymptotic confidence
    sequences, Ann. Stat. 49 (2021).

    Args:
        successes: number of samples that succeeded.
        samples: number of all samples; without any, the interval is 0 to 1.
    """
    return _lower_bound(successes, samples - successes), 1.0 - _lower_bound(samples - successes, successes)


@checked
def samples_to_decide(successes: Index, samples: Index, threshold: Fraction, *, unknown: Index = 0) -> int | None:
    """About how many more samples place `confidence_sequence` on one side of a threshold, if they go on as before.

    Args:
        successes: number of samples that succeeded.
        samples: number of all samples.
        threshold: the probability that is compared.
        unknown: number of samples whose outcome is not known, which extend the interval at both ends.

    Returns:
        0 if it is decided; None if `MAX_ESTIMATE` samples would not suffice.
    """

    def is_decided(total: float) -> bool:
        low = _lower_bound(total * successes / samples, total * (samples - successes) / samples)
        failed = total * (samples - successes - unknown) / samples
        return low >= threshold or 1.0 - _lower_bound(failed, total - failed) < threshold

    if samples == 0 or not is_decided(MAX_ESTIMATE):
        return None
    few, many = samples, samples
    while not is_decided(many):
        few, many = many, 2 * many
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (few, middle) if is_decided(middle) else (middle, many)
    return many - samples


def _lower_bound(successes: float, failures: float) -> float:
    """The largest probability t for which "at most t" is refuted."""
    if successes == 0:
        return 0.0
    refuted, possible = 0.0, successes / (successes + failures)
    for _ in range(_BISECTIONS):
        middle = (refuted + possible) / 2
        if _log_evidence(successes, failures, middle) >= _LOG_BOUND:
            refuted = middle
        else:
            possible = middle
    return refuted


def _log_evidence(successes: float, failures: float, most: float) -> float:
    """The logarithm of the test martingale against "the probability is at most `most`"."""
    if most <= 0.0:
        return inf
    beyond = betaincc([successes + _PRIOR, _PRIOR], [failures + _PRIOR, _PRIOR], most)
    if beyond[0] <= 0.0 or beyond[1] <= 0.0:  # too small for a number: far from refuted
        return -inf
    mixed = betaln(successes + _PRIOR, failures + _PRIOR) - betaln(_PRIOR, _PRIOR) + np.log(beyond[0] / beyond[1])
    return float(mixed - successes * np.log(most) - (failures * np.log1p(-most) if failures else 0.0))
