"""Detection of events: the cost of a frame, against the engine's step of the same length."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from statistics import median

import mindstage as ms
from benchmarks import Measure
from mindstage.engines import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.episodes import EpisodeFrame, EventDetector
from mindstage.scene import NO_GEOMETRY, Body, BodyId, BodyPhysics, GeometryMap, Iri, Mobility, Pose, World
from mindstage.scene.edits import Spawn

_RATE_HZ = 30
_FRAMES = 120


def measure() -> Iterator[Measure]:
    with ms.open("bundled:kitchen") as simulation:
        simulation.step(3.0)
        engine = simulation.engine.run(lambda engine: engine.fork())
        geometry = simulation.geometry
    things = [BodyId(id) for id in ("plate_3", "plate_4", "coffee_mug_4", "fridge_door", "drawer_left_4")]
    yield from _against_engine(
        engine, geometry, things, "the bundled kitchen, 254 bodies, 5 of them pushed", at_most=2.0
    )

    engine = _crates(10_000, loose=400)
    moved = [BodyId(f"c{number}") for number in range(50)]
    yield from _against_engine(engine, NO_GEOMETRY, moved, "10,000 crates, 50 pushed", at_most=1.0)


def _against_engine(
    engine: Engine, geometry: GeometryMap, pushed: list[BodyId], name: str, *, at_most: float
) -> Iterator[Measure]:
    """Detects events while bodies are pushed, as a recorder does."""
    detector, structure = EventDetector(geometry=geometry), engine.snapshot()
    steps, updates = [], []
    gc.collect()
    for number in range(_FRAMES):
        force = 6.0 if number % 40 < 20 else -6.0

        def step(force: float = force) -> None:
            for id in pushed:
                engine.apply_force(id, (0.0, force, 0.0))
            engine.step(1 / _RATE_HZ)

        steps.append(_seconds(step))
        ids, poses = engine.poses()
        frame = EpisodeFrame(
            time_s=engine.time_s, structure=structure, ids=ids, poses=poses, contacts=engine.contacts()
        )
        updates.append(_seconds(lambda frame=frame: detector.update(frame)))
    detector.finish()
    engine.close()
    yield Measure(what=f"first frames, {name}", ours=sum(updates[:3]), unit="s")
    yield Measure(what=f"detection in a frame, {name}", ours=1000 * median(updates[5:]), unit="ms", at_most=10.0)
    yield Measure(
        what="the same, against the engine's step",
        ours=1000 * median(updates[5:]),
        unit="ms",
        peer=f"MuJoCo, 1/{_RATE_HZ} s",
        theirs=1000 * median(steps[5:]),
        at_most=at_most,
    )


def _crates(count: int, *, loose: int) -> Engine:
    """Crates on a floor, the first ones loose."""

    def box(
        id: str, position: tuple[float, float, float], size: tuple[float, float, float], mobility: Mobility
    ) -> Body:
        physics = BodyPhysics(mobility=mobility, gravity=True, mass_kg=1.0)
        iri = Iri(f"http://example.org/crates#{id}")
        return Body(id=BodyId(id), iri=iri, cls=iri, pose=Pose(position), size=size, physics=physics)

    side = int(count**0.5) + 1
    crates = [
        box(
            f"c{number}",
            (number % side * 0.5, number // side * 0.5, 0.1),
            (0.2, 0.2, 0.2),
            Mobility.DYNAMIC if number < loose else Mobility.STATIC,
        )
        for number in range(count)
    ]
    floor = box("floor", (side / 4, side / 4, -0.05), (side, side, 0.1), Mobility.STATIC)
    engine = MujocoEngine()
    engine.apply(Spawn(World(iri=Iri("http://example.org/crates"), bodies=(floor, *crates))))
    engine.step(2.0)
    return engine


def _seconds(function: Callable[[], object]) -> float:
    """The processor time of a call, which other processes do not disturb [s]."""
    begin = time.process_time()
    function()
    return time.process_time() - begin
