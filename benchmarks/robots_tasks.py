"""The environments of Gymnasium: time of resets and steps, and the success rates of a random policy and of the skills.

    python -m benchmarks robots_tasks
    python -m benchmarks.robots_tasks [--episodes 10] [--random 3] [--tasks Open Pick Place PutAway] [--robot stretch]

The second form prints a line for each episode. Random policies play as many actions as an episode has at most.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from statistics import median
from typing import Any

import gymnasium

from benchmarks import Measure
from mindstage.gym import EpisodeScore, play_randomly, play_skill

_TASKS: dict[str, dict[str, Any]] = {
    "Open": {},
    "Pick": {},
    "Place": {},
    "PutAway": {"thing": "milk_carton_1", "start_on": "counter_left"},
}
_RESETS, _ACTIONS = 9, 40


def measure() -> Iterator[Measure]:
    """Yields the time of a reset, and that of actions with rewards from questions."""
    env = gymnasium.make("mindstage/Open-v0", thing="fridge_door")
    simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
    try:
        env.reset(seed=0)
        resets = [_timed(lambda seed=seed: env.reset(seed=seed)) for seed in range(_RESETS)]
        yield Measure(what="reset of an environment", ours=1000 * median(resets), unit="ms", at_most=100.0)
        env.action_space.seed(0)
        actions = [env.action_space.sample() for _ in range(_ACTIONS)]
        with_rewards = [_timed(lambda action=action: env.step(action)) for action in actions]
        env.reset(seed=0)
        task = env.unwrapped
        without = []
        for action in actions:
            command = dict(zip(task.action_names, action.tolist(), strict=True))  # type: ignore[attr-defined]
            without.append(_timed(lambda command=command: (task._command(command), simulation.step(0.1))))  # type: ignore[attr-defined]
        yield Measure(
            what="an action of 0.1 s, with its reward from questions",
            ours=1000 * median(with_rewards),
            unit="ms",
            peer="without questions",
            theirs=1000 * median(without),
            at_most=4.0,
        )
    finally:
        env.close()


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--random", type=int, default=3)
    parser.add_argument("--tasks", nargs="*", default=list(_TASKS))
    parser.add_argument("--robot", default="mobile_manipulator")
    options = parser.parse_args()
    for task in options.tasks:
        env = gymnasium.make(f"mindstage/{task}-v0", robot=options.robot, **_TASKS[task])
        _print_scores(f"{task}, random", env, play_randomly, options.random)
        _print_scores(f"{task}, skill", env, play_skill, options.episodes)
        env.close()


def _print_scores(title: str, env: Any, play: Callable[..., EpisodeScore], episodes: int) -> None:
    successes = 0
    for seed in range(episodes):
        start = time.perf_counter()
        score = play(env, seed=seed)
        successes += score.success
        times = f"{score.duration_s:.0f} s in {time.perf_counter() - start:.0f} s"
        print(f"{title}, {seed}, {env.unwrapped.thing}: {score.success}, {times}: {score.reason}", flush=True)
    if episodes:
        print(f"== {title}: {successes} of {episodes}", flush=True)


if __name__ == "__main__":
    main()
