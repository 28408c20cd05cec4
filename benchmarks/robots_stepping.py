"""Stepping the bundled kitchen with the bundled robot, whose joints follow commands, compared with MuJoCo alone."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterator
from statistics import median

import mujoco

from benchmarks import Measure
from benchmarks.mujoco import kitchen_world
from mindstage.engines import MujocoEngine, SpawnOptions
from mindstage.robots.drives import drives_of
from mindstage.robots.models.reading import load_model
from mindstage.robots.world import robot_world
from mindstage.scene import Pose

RUNS = 25
_PERIOD_S = 0.01
"""Time between two commands."""
_PERIODS = 50


def measure() -> Iterator[Measure]:
    engine, names = _kitchen_with_robot()
    yield _step_against_bare(engine, names, "step the kitchen with a robot, 100 commands/s")
    compiled = engine.compiled()
    alone = MujocoEngine()
    alone.spawn(kitchen_world())
    alone.step(0.5)
    with_robot, without = _timed(
        lambda: _run_bare(compiled.model, compiled.data, len(names)),
        lambda: _run_bare(alone.compiled().model, alone.compiled().data, 0),
    )
    yield Measure(
        what="mj_step of it", ours=1000 * with_robot / _steps(), unit="ms", peer="without the robot",
        theirs=1000 * without / _steps(),
    )  # fmt: skip


def _kitchen_with_robot() -> tuple[MujocoEngine, list[str]]:
    engine, model = MujocoEngine(), load_model("mobile_manipulator")
    kitchen = kitchen_world()
    engine.spawn(kitchen)
    placed = robot_world(model, Pose((0.0, 0.0, 0.0)), name="robot", taken={each.id for each in kitchen.bodies})
    engine.spawn(placed.world, geometry=placed.geometry, options=SpawnOptions(settle=False))
    drives = drives_of(model, placed, name="robot")
    drives.add_to(engine)
    engine.step(0.5)
    return engine, [each.actuator for each in drives.joints.values()]


def _steps() -> int:
    return round(_PERIODS * _PERIOD_S / 0.002)


def _timed(*actions: Callable[[], object]) -> list[float]:
    """The median of the processor time of each action [s]; they alternate, so that other load affects all equally."""
    seconds: list[list[float]] = [[] for _ in actions]
    for _ in range(RUNS):
        for action, taken in zip(actions, seconds, strict=True):
            start = time.thread_time()
            action()
            taken.append(time.thread_time() - start)
    return [median(taken) for taken in seconds]


def _run_bare(model: mujoco.MjModel, data: mujoco.MjData, commands: int) -> None:
    start = data.ctrl[-commands:].copy() if commands else data.ctrl[:0].copy()
    for period in range(_PERIODS):
        if commands:
            data.ctrl[-commands:] = start + 0.002 * math.sin(period / 8)
        mujoco.mj_step(model, data, nstep=round(_PERIOD_S / 0.002))


def _step_against_bare(engine: MujocoEngine, names: list[str], what: str) -> Measure:
    live = engine.compiled()
    model, data = live.model, copy.copy(live.data)
    commands = {name: state.command for name, state in engine.actuator_states().items() if name in names}

    def ours() -> None:
        for period in range(_PERIODS):
            engine.set_commands({name: at + 0.002 * math.sin(period / 8) for name, at in commands.items()})
            engine.step(_PERIOD_S)
            engine.actuator_states()

    mine, theirs = _timed(ours, lambda: _run_bare(model, data, len(names)))
    return Measure(
        what=what, ours=1000 * mine / _steps(), unit="ms", peer="mj_step of the same model",
        theirs=1000 * theirs / _steps(), at_most=1.1,
    )  # fmt: skip
