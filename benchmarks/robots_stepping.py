"""Stepping the bundled kitchen with the bundled robot, whose joints follow commands, compared with MuJoCo alone."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterator, Sequence
from statistics import median

import mujoco
import numpy as np

from benchmarks import Measure
from benchmarks.mujoco import kitchen_world
from mindstage.engines.mujoco import MujocoEngine
from mindstage.robots.drives import drives_of
from mindstage.robots.models.reading import load_model
from mindstage.robots.world import robot_world
from mindstage.scene import Pose
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import Array

RUNS = 25
_PERIOD_S = 0.01
"""Time between two commands."""
_PERIODS = 50


def measure() -> Iterator[Measure]:
    engine, names = _kitchen_with_robot()
    yield _step_against_bare(engine, names, "step the kitchen with a robot, 100 commands/s", reads=False)
    yield _step_against_bare(engine, names, "the same, its joints are read 100 times/s", reads=True)
    compiled = engine.compiled()
    alone = MujocoEngine()
    alone.spawn(kitchen_world())
    alone.step(0.5)
    with_robot, without = _timed(
        lambda: _run_bare(compiled.model, compiled.data, compiled.data.ctrl.copy()),
        lambda: _run_bare(alone.compiled().model, alone.compiled().data, None),
    )
    yield Measure(
        what="mj_step of it", ours=1000 * with_robot / _steps(), unit="ms", peer="without the robot",
        theirs=1000 * without / _steps(),
    )  # fmt: skip


def _kitchen_with_robot() -> tuple[MujocoEngine, list[str]]:
    engine, model = MujocoEngine(), load_model("mobile_manipulator")
    kitchen = kitchen_world()
    engine.apply(Spawn(kitchen))
    placed = robot_world(model, Pose((0.0, 0.0, 0.0)), name="robot", taken={each.id for each in kitchen.bodies})
    engine.apply(Spawn(placed.world, geometry=placed.geometry, settle=False))
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


def _run_bare(
    model: mujoco.MjModel, data: mujoco.MjData, commands: Array | None, joints: Sequence[int] | None = None
) -> None:
    """Steps a model.

    Args:
        model: the model.
        data: its data.
        commands: the controls that move; None if none does.
        joints: the joints whose positions, velocities and efforts are read after each period.
    """
    for period in range(_PERIODS):
        if commands is not None:
            data.ctrl[-len(commands) :] = commands + 0.002 * math.sin(period / 8)
        mujoco.mj_step(model, data, nstep=round(_PERIOD_S / 0.002))
        if joints is not None:
            data.qpos[model.jnt_qposadr[joints]], data.qvel[model.jnt_dofadr[joints]], data.actuator_force.copy()


def _step_against_bare(engine: MujocoEngine, names: list[str], what: str, *, reads: bool) -> Measure:
    live = engine.compiled()
    model, data = live.model, copy.copy(live.data)
    joints = model.actuator_trnid[:, 0].tolist() if reads else None
    commands = {name: state.command for name, state in engine.actuator_states().items() if name in names}
    controls = np.array([commands[name] for name in live.actuators.names[-len(names) :]])

    def ours() -> None:
        for period in range(_PERIODS):
            engine.set_commands({name: at + 0.002 * math.sin(period / 8) for name, at in commands.items()})
            engine.step(_PERIOD_S)
            if reads:
                engine.actuator_states()

    mine, theirs = _timed(ours, lambda: _run_bare(model, data, controls, joints))
    return Measure(
        what=what, ours=1000 * mine / _steps(), unit="ms", peer="mj_step of the same model",
        theirs=1000 * theirs / _steps(), at_most=1.1,
    )  # fmt: skip
