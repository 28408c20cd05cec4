"""The Godot engine, compared with a bare Godot scene and with MuJoCo: spawning, stepping, reading poses."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks import Measure
from benchmarks.mujoco import grid_world, kitchen_world
from mindstage.engines import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.remote.godot import GodotEngine
from mindstage.engines.remote.godot_process import find_godot, isolated_environment, prepare_project
from mindstage.errors import EngineUnavailableError
from mindstage.scene import World
from mindstage.scene.edits import Spawn

COUNTS = (136, 1000, 5000)
TICK_S = 1 / 240
TICKS = 240
RUNS = 5
BARE = Path(__file__).with_name("bare_boxes.gd")


class Times(NamedTuple):
    """Times of operations [ms]."""

    spawn: float
    tick: float
    """A step of 1/240 s."""
    read: float
    """Reading all poses."""


def measure() -> Iterator[Measure]:
    try:
        godot = find_godot(os.environ.get("GODOT"))
    except EngineUnavailableError as error:
        print(f"skipped: {error}")
        return
    with closing(GodotEngine(godot.path, timeout_s=120.0)) as engine:
        yield from _kitchens(engine)
        for count in COUNTS:
            yield from _fields(engine, count)
        yield _apply_force(engine)


def _kitchens(engine: GodotEngine) -> Iterator[Measure]:
    kitchen = kitchen_world()
    ours, mujoco = _times(lambda: engine, kitchen), _times(MujocoEngine, kitchen)
    for what, mine, theirs in zip(Times._fields, ours, mujoco, strict=True):
        yield Measure(what=f"{what}, the bundled kitchen", ours=mine, unit="ms", peer="MuJoCo", theirs=theirs)


def _fields(engine: GodotEngine, count: int) -> Iterator[Measure]:
    world, bare = grid_world(count), _bare(count)
    ours, mujoco = _times(lambda: engine, world), _times(MujocoEngine, world)
    for what, mine, by_hand, theirs in zip(Times._fields, ours, bare, mujoco, strict=True):
        name = f"{what}, {count:,} bodies, 10 % dynamic"
        aim = 3.0 if what == "tick" else None
        yield Measure(what=name, ours=mine, unit="ms", peer="bare Godot scene", theirs=by_hand, at_most=aim)
        yield Measure(what=name, ours=mine, unit="ms", peer="MuJoCo", theirs=theirs)


def _times(make: Callable[[], Engine], world: World) -> Times:
    """The medians, in a world where the bodies were just spawned and still move."""
    spawns, ticks, reads = [], [], []
    for _ in range(RUNS):
        engine = make()
        engine.clear()
        start = time.perf_counter()
        engine.apply(Spawn(world))
        engine.poses()
        spawns.append(time.perf_counter() - start)
        engine.step(TICK_S)
        start = time.perf_counter()
        engine.step(TICKS * TICK_S)
        ticks.append((time.perf_counter() - start) / TICKS)
        start = time.perf_counter()
        engine.poses()
        reads.append(time.perf_counter() - start)
    return Times(*(1000 * median(taken) for taken in (spawns, ticks, reads)))


def _bare(count: int) -> Times:
    godot = find_godot(os.environ.get("GODOT"))
    done = subprocess.run(
        [godot.path, "--headless", "--path", prepare_project(godot), "--script", BARE, "--", str(count), str(TICKS)],
        capture_output=True, text=True, timeout=300, check=True, env=os.environ | isolated_environment(),
    )  # fmt: skip
    output = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
    return Times(output["build_ms"], output["tick_ms"], output["read_ms"])


def _apply_force(engine: GodotEngine) -> Measure:
    """Applies a force, steps and reads the poses repeatedly, as during a drag."""
    kitchen = kitchen_world()
    engine.clear()
    engine.apply(Spawn(kitchen))
    body = next(each.id for each in kitchen.bodies if each.physics.is_dynamic)
    engine.poses()
    start = time.perf_counter()
    for _ in range(100):
        engine.apply_force(body, (1.0, 0.0, 0.0))
        engine.step(0.004)
        engine.poses()
    ours = (time.perf_counter() - start) / 100
    return Measure(what="apply force, step 4 ms, read poses", ours=1000 * ours, unit="ms", at_most=4.0)
