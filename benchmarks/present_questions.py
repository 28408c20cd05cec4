"""Questions about the present of large worlds: the same thing again, and after another thing has moved."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from statistics import median

from msgspec.structs import replace

from benchmarks import Measure
from benchmarks.mujoco import copies_of, kitchen_world
from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.scene import Iri, Pose, World

RUNS = 7
KITCHENS = (1, 20, 80)
"""254, 5,080 and 20,320 bodies."""
LOCAL: Mapping[str, Mapping[str, object]] = {
    "where_is": {"thing": "milk_carton_1"},
    "distance": {"thing": "milk_carton_1", "other": "fridge"},
    "nearest": {"thing": "milk_carton_1", "count": 3},
    "articulated_parts": {"thing": "fridge"},
}
PATH = {"start": "fridge", "goal": "table"}


def measure() -> Iterator[Measure]:
    local: dict[tuple[str, int, bool], float] = {}
    for count in KITCHENS:
        with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as simulation:
            simulation.spawn(_kitchens(count))
            simulation.step(1.0)  # all is at rest
            for name, args in LOCAL.items():
                for moves in (False, True):
                    local[name, count, moves] = _asked_s(simulation, name, args, moves=moves)
            path_s = _asked_s(simulation, "path", PATH, moves=True)
        yield Measure(
            what=f"path among {254 * count:,} bodies, one of which has moved",
            ours=1000 * path_s,
            unit="ms",
            at_most=200.0,
        )
    for name in LOCAL:
        for moves in (False, True):
            many, some = (1000 * local[name, count, moves] for count in (KITCHENS[-1], KITCHENS[0]))
            what = f"{name} among 20,320 bodies" + (", one of which has moved" if moves else ", again")
            yield Measure(
                what=what, ours=many, unit="ms", peer="among 254", theirs=some, at_most=None if moves else 10.0
            )


def _kitchens(count: int) -> World:
    """Copies of the kitchen, each individual with an IRI of its own."""
    world = copies_of(kitchen_world(), count)
    bodies = tuple(replace(body, iri=Iri(f"http://example.org/kitchens.owl#{body.id}")) for body in world.bodies)
    return replace(world, bodies=bodies)


def _asked_s(simulation: Simulation, question: str, args: Mapping[str, object], *, moves: bool) -> float:
    taken = []
    simulation.ask(question, **args)
    for number in range(RUNS):
        if moves:
            simulation.edits.move("yogurt_cup_1", Pose((1.0 + 0.01 * number, 1.0, 1.2)))
        start = time.perf_counter()
        simulation.ask(question, **args)
        taken.append(time.perf_counter() - start)
    return median(taken)
