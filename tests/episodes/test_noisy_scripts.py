"""Actions in recordings with noise: what is detected, against the actions of random scripts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import pytest

from mindstage.episodes import EpisodeEvent, EpisodeFrame, FrameRecording, detect_events
from mindstage.episodes.smoothing import estimate_noise
from tests.episodes.noisy_scripts import Action, noisy, script

SEEDS = (0, 1)
KINDS = {"Grasping", "PickingUp", "PuttingDown", "Transporting", "Sliding", "Falling", "TippingOver"}


@cache
def acted(seed: int) -> tuple[list[EpisodeFrame], list[Action]]:
    return script(seed)


def matches(action: Action, event: EpisodeEvent, last_s: float) -> bool:
    """Whether begin and end are within 0.3 s, or a fifth of the duration."""
    tolerance_s = max(0.3, 0.2 * (action.end_s - action.begin_s))
    end_s = last_s if event.end_s is None else event.end_s
    return (
        (action.kind, action.thing) == (event.kind, event.thing)
        and abs(action.begin_s - event.begin_s) <= tolerance_s
        and abs(action.end_s - end_s) <= tolerance_s
    )


def score(frames: list[EpisodeFrame], actions: Sequence[Action], *, noise_m: float | None = None) -> tuple[int, int]:
    """The numbers of false events and of missed actions."""
    events = [event for event in detect_events(FrameRecording(frames), noise_m=noise_m) if event.kind in KINDS]
    missed, false = list(actions), 0
    for event in events:
        match = next((action for action in missed if matches(action, event, frames[-1].time_s)), None)
        if match is None:
            false += 1
        else:
            missed.remove(match)
    return false, len(missed)


@pytest.mark.parametrize("noise_m", [0.0, 0.003])
def test_actions_are_found_and_no_others_with_noise_on_every_position(noise_m: float) -> None:
    false, missed, count = 0, 0, 0
    for seed in SEEDS:
        frames, actions = acted(seed)
        found = score(noisy(frames, seed=seed, noise_m=noise_m), actions)
        false, missed, count = false + found[0], missed + found[1], count + len(actions)
    assert count >= 40
    assert (false, missed) <= ((0, 0) if noise_m == 0.0 else (2, 2))


def test_without_smoothing_the_same_noise_gives_many_false_actions() -> None:
    frames, actions = acted(SEEDS[0])
    false, _ = score(noisy(frames, seed=0, noise_m=0.003), actions, noise_m=0.0)
    assert false > 5


@pytest.mark.parametrize("noise_m", [0.001, 0.005])
def test_noise_is_estimated_within_a_tenth(noise_m: float) -> None:
    frames, _ = acted(SEEDS[0])
    estimate_m, step_s = estimate_noise(FrameRecording(noisy(frames, seed=3, noise_m=noise_m)))
    assert estimate_m == pytest.approx(noise_m, rel=0.1)
    assert step_s == pytest.approx(0.032)


def test_a_recording_of_an_engine_has_no_noise() -> None:
    assert estimate_noise(FrameRecording(noisy(acted(SEEDS[0])[0], seed=0, noise_m=0.0)))[0] == 0.0
