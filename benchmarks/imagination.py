"""Imagination: forks of a kitchen, samples of a plan, and workers, against bare MuJoCo."""

from __future__ import annotations

import copy
import gc
import resource
import time
from collections.abc import Callable, Iterator
from statistics import median
from typing import Any

import mujoco

import mindstage as ms
from benchmarks import Measure
from mindstage.engines import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.imagination import Executor, Plan, Push, Uncertainty, Wait, WorkerPoolExecutor, evaluate_plan
from mindstage.imagination.executors import Job, SampleRunner
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World
from mindstage.scene.edits import Spawn
from mindstage.simulation import Simulation, SimulationImage

_DURATION_S = 2.0
_PUSH = (0.0, 0.0, 4.0)
_ROUNDS = 15


def measure() -> Iterator[Measure]:
    with ms.open("bundled:kitchen") as sim:
        sim.step(5.0)
        yield from _forks(sim)
        yield from _samples(sim)
        yield from _workers(sim)
    yield from _gpu()


def _seconds(function: Callable[[], object]) -> float:
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def _forks(sim: Simulation) -> Iterator[Measure]:
    engine = sim.engine.run(lambda engine: engine.fork())
    engine.fork()
    times = [_seconds(engine.fork) for _ in range(50)]
    yield Measure(what="fork of the bundled kitchen, 254 bodies", ours=1000 * median(times), unit="ms", at_most=1.0)

    gc.collect()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    forks = [engine.fork() for _ in range(100)]
    for fork in forks[:100]:
        fork.step(0.002)
    grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    yield Measure(what="memory of a fork of the kitchen that was stepped", ours=grown_mb / 100, unit="MB", at_most=2.0)
    del forks

    small, large = _rows_of_crates(250), _rows_of_crates(1000)
    ratio = median(_seconds(large.fork) / _seconds(small.fork) for _ in range(30))
    yield Measure(what="fork of 1,000 bodies to one of 250 bodies", ours=ratio, unit="times", at_most=4.0)


def _rows_of_crates(count: int) -> Engine:
    """Crates on a floor, asleep."""

    def box(id: str, position: tuple[float, float, float], size: tuple[float, float, float], loose: bool) -> Body:
        physics = BodyPhysics(mobility=Mobility.DYNAMIC if loose else Mobility.STATIC, gravity=True, mass_kg=1.0)
        iri = Iri(f"http://example.org/crates#{id}")
        return Body(id=BodyId(id), iri=iri, cls=iri, pose=Pose(position), size=size, physics=physics)

    side = int(count**0.5) + 1
    crates = [box(f"c{n}", (n % side * 0.5, n // side * 0.5, 0.1), (0.2, 0.2, 0.2), True) for n in range(count)]
    floor = box("floor", (side / 4, side / 4, -0.05), (side, side, 0.1), False)
    engine = MujocoEngine()
    engine.apply(Spawn(World(iri=Iri("http://example.org/crates"), bodies=(floor, *crates))))
    engine.step(2.0)
    return engine


def _samples(sim: Simulation) -> Iterator[Measure]:
    """The same forces on the same body for the same time, as a sample and as a loop over copied `MjData`."""
    plan = Plan(
        steps=(
            Push(thing="milk_carton_1", force=_PUSH, duration_s=0.2),
            Wait(duration_s=_DURATION_S - 0.2),
        ),
        forbid=(),
    )
    image = SimulationImage.capture(sim)
    runner = SampleRunner(Job(image, plan))
    duration_s = runner.run(0).duration_s
    engine: Any = sim.engine.run(lambda engine: engine.fork())
    compiled = engine._cache.model()
    body = compiled.body_ids[BodyId("milk_carton_1")]

    def bare() -> None:
        data = copy.copy(compiled.data)
        data.xfrc_applied[body, :3] = _PUSH
        mujoco.mj_step(compiled.model, data, nstep=100)
        data.xfrc_applied[body, :3] = 0.0
        mujoco.mj_step(compiled.model, data, nstep=round(duration_s / 0.002) - 100)

    bare()
    pairs = [(_seconds(lambda: runner.run(0)), _seconds(bare)) for _ in range(_ROUNDS)]
    yield Measure(
        what=f"one sample: push a carton in the kitchen, {duration_s:.1f} s",
        ours=median(ours for ours, _ in pairs),
        peer="mj_step on copied MjData",
        theirs=median(theirs for _, theirs in pairs),
        at_most=1.2,
    )


def _gpu() -> Iterator[Measure]:
    """Samples in MuJoCo Warp, on a GPU or, without one, on the processor, and the same samples in two processes."""
    from mindstage.errors import ImaginationError
    from mindstage.imagination.warp_executor import WarpExecutor

    try:
        executor, samples = WarpExecutor(worlds=2048), 4096
    except ImaginationError:
        executor, samples = WarpExecutor(device="cpu", worlds=64), 64
    plan = Plan(
        steps=(Push(thing="c0", force=(3.0, 0.0, 0.0), duration_s=0.2), Wait(duration_s=0.3)),
        uncertainty=(Uncertainty(thing="c0", mass=0.1, friction=0.1),),
        forbid=(),
    )
    crates = _rows_of_crates(4).snapshot()
    simulation = Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, threaded=False)
    with simulation, WorkerPoolExecutor(2) as pool:
        simulation.spawn(crates, ground=False)
        simulation.step(1.0)
        runs: list[tuple[Executor, list[float]]] = [(executor, []), (pool, [])]

        def run(on: Executor, count: int) -> float:
            return _seconds(
                lambda: evaluate_plan(simulation, plan, samples=count, fixed=True, workers=on, budget_s=600.0)
            )

        for on, _ in runs:
            run(on, 2)  # compiles kernels, starts processes
        for _ in range(3):
            for on, seconds in runs:
                seconds.append(run(on, samples))
    rates = [samples / median(seconds) for _, seconds in runs]
    where = executor.name + (" (no GPU here)" if executor.name.endswith("the processor") else "")
    yield Measure(what=f"samples per second, {where}", ours=rates[0], unit="per s")
    yield Measure(what="the same samples per second, two processes", ours=rates[1], unit="per s")


def _workers(sim: Simulation) -> Iterator[Measure]:
    plan = Plan(
        steps=(Push(thing="milk_carton_1", force=_PUSH, duration_s=0.2), Wait(duration_s=_DURATION_S)),
        uncertainty=(Uncertainty(thing="milk_carton_1", mass=0.1),),
    )
    with WorkerPoolExecutor(1) as one, WorkerPoolExecutor(2) as two:
        for pool in (one, two):
            evaluate_plan(sim, plan, samples=4, workers=pool)
        pairs = [
            tuple(
                _seconds(lambda pool=pool: evaluate_plan(sim, plan, samples=60, fixed=True, workers=pool))
                for pool in (one, two)
            )
            for _ in range(3)
        ]
    yield Measure(
        what="60 samples on one worker to two workers",
        ours=median(first / second for first, second in pairs),
        unit="times",
        at_least=1.7,
    )
