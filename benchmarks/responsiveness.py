"""How soon requests are executed while the simulation is as busy as it can be, and after random requests."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from msgspec.structs import replace
from tests.fuzz.running_server import RunningServer, ServerFuzzer

from benchmarks import Measure
from benchmarks.mujoco import kitchen_world
from mindstage.access.limits import SPEED
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, Iri, Pose, World
from mindstage.scene.edits import SetLabel, SetPhysics
from mindstage.simulation import Simulation

RUNS = 50
AIM_S = 0.2
KITCHENS = 10
FUZZ_S = 60.0
AFTER_FUZZ_AIM_S = 1.0


def measure() -> Iterator[Measure]:
    for count in (1, KITCHENS):
        world = _kitchens(count)
        with Simulation(KnowledgeBase(), MujocoEngine(), timeout_s=120.0) as simulation:
            simulation.spawn(world)
            simulation.step(0.002)
            name = f"{len(world.bodies):,} bodies"
            yield _longest(f"pause at speed {SPEED.maximum:g}, {name}", simulation, lambda: None)
            yield _longest(f"pause while an edit compiles, {name}", simulation, lambda: _edit(simulation), runs=10)
            simulation.step(0.002)
            with _stepping(simulation):
                yield _longest(f"pause while others step, {name}", simulation, lambda: None)
                yield Measure(what=f"edit while others step, {name}", ours=_longest_edit_s(simulation), at_most=AIM_S)
    yield from _after_random_requests()


def _after_random_requests() -> Iterator[Measure]:
    """How long a new client of `mindstage serve` waits after random requests to all of its ports."""
    with TemporaryDirectory() as folder:
        server = RunningServer(Path(folder))
        try:
            with closing(ServerFuzzer(server, random.random())) as fuzzer:
                fuzzer.run(FUZZ_S)
            times = server.measure()
        finally:
            server.stop()
    for method in ("pause", "step", "undo", "save", "ask"):
        what = f"{method} after {FUZZ_S:g} s of random requests to all ports"
        yield Measure(what=what, ours=times[method], at_most=AFTER_FUZZ_AIM_S)


def _kitchens(count: int) -> World:
    """The bundled kitchen several times, in a row."""
    kitchen = kitchen_world()
    bodies, joints, attachments = [], [], []
    for number in range(count):

        def moved(pose: Pose, number: int = number) -> Pose:
            x, y, z = pose.position
            return replace(pose, position=(x + 8.0 * number, y, z))

        def renamed(id: str, number: int = number) -> BodyId:
            return BodyId(f"{id}_{number}")

        for body in kitchen.bodies:
            bodies.append(replace(body, id=renamed(body.id), iri=Iri(renamed(body.iri)), pose=moved(body.pose)))
        for joint in kitchen.joints:
            ends = {"parent": renamed(joint.parent), "child": renamed(joint.child)}
            joints.append(replace(joint, id=renamed(joint.id), pose=moved(joint.pose), **ends))
        for each in kitchen.attachments:
            attachments.append(replace(each, parent=renamed(each.parent), child=renamed(each.child)))
    return replace(kitchen, bodies=tuple(bodies), joints=tuple(joints), attachments=tuple(attachments))


def _edit(simulation: Simulation) -> None:
    body = simulation.worlds[0].bodies[0]
    simulation.engine.run(lambda engine: engine.apply(SetPhysics(body.id, body.physics)), label="edit", edits=True)


def _longest(what: str, simulation: Simulation, before: Callable[[], None], *, runs: int = RUNS) -> Measure:
    """The longest time of a pause at the largest speed, at random moments."""
    taken_s = []
    for _ in range(runs):
        simulation.play(speed=SPEED.maximum)
        before()
        time.sleep(random.uniform(0.02, 0.08))
        start_s = time.perf_counter()
        simulation.pause()
        taken_s.append(time.perf_counter() - start_s)
    return Measure(what=what, ours=max(taken_s), at_most=AIM_S)


def _longest_edit_s(simulation: Simulation) -> float:
    id, taken_s = simulation.state.ids[0], []
    for _ in range(RUNS):
        start_s = time.perf_counter()
        simulation.engine.run(lambda engine: engine.apply(SetLabel(id, "edited")), label="set label", edits=True)
        taken_s.append(time.perf_counter() - start_s)
    return max(taken_s)


@contextmanager
def _stepping(simulation: Simulation) -> Iterator[None]:
    """In the context, another thread steps the simulation, 60 s at a time."""
    has_ended = threading.Event()

    def report(_: float) -> None:
        if has_ended.is_set():
            raise InterruptedError

    def step() -> None:
        try:
            while not has_ended.is_set():
                simulation.step(60.0, progress=report)
        except InterruptedError:
            pass

    thread = threading.Thread(target=step)
    thread.start()
    try:
        yield
    finally:
        has_ended.set()
        thread.join()
