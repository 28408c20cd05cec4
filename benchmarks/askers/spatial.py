"""Times spatial questions over 10,000 bodies, and peers that do a part of the same work.

Relations of KnowRob's comp_spatial in the bundled kitchen are compared with the same definitions in plain Prolog, over
facts with the poses. Prints a line for each: what is measured, our median time [s], the peer, its median time [s].
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import version
from statistics import median

import mujoco
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import path, reachable, visible_from
from mindstage.knowledge.questions import Question, StateAccess, WorldState
from mindstage.maps import bundled_kitchen
from mindstage.prolog import PrologConsole
from mindstage.scene import NO_GEOMETRY, Body, BodyId, Iri, Pose, Vector, World
from mindstage.scene.ray_casting import ShapeScene
from mindstage.scene.transforms import Array
from mindstage.simulation import Simulation

BODIES = 10_000
EXTENT_M, CELL_M = 70.0, 0.1565
EYE = np.array([0.0, 0.0, 1.6])
TARGETS = 200
REPEATS = 3
START = "-34.5 -34.5"
FACTS = """forall(( is_at(Body, [map, [X, Y, Z], _]), map_object_type(Body, _), object_dimensions(Body, _, _, _) ),
               assertz(body_at(Body, X, Y, Z)))"""
PAIR = "body_at(A, X, Y, Z), body_at(B, U, V, W), A \\== B"
DEFINITIONS = {
    "comp_toTheLeftOf": f"( {PAIR}, abs(X - U) =< 0.3, Y >= V, abs(Z - W) =< 0.3 )",
    "comp_inFrontOf": f"( {PAIR}, X >= U )",
    "comp_inCenterOf": f"( {PAIR}, abs(X - U) =< 0.2, abs(Y - V) =< 0.2, abs(Z - W) =< 0.2 )",
}
"""KnowRob's definitions."""


def cluttered_hall() -> World:
    """A floor with boxes of different sizes, turned about z, from the floor up to 2 m."""
    random = np.random.default_rng(1)
    bodies = [_body(0, (0.0, 0.0, -0.05), 0.0, (EXTENT_M, EXTENT_M, 0.1))]
    for number in range(1, BODIES):
        size, yaw = random.uniform(0.05, 0.4, 3), random.uniform(0.0, np.pi)
        x, y = random.uniform(-EXTENT_M / 2 + 1, EXTENT_M / 2 - 1, 2).tolist()
        z = float(size[2] / 2 + random.choice([0.0, 0.0, 0.9, 2.0]))
        bodies.append(_body(number, (x, y, z), yaw, (float(size[0]), float(size[1]), float(size[2]))))
    return World(iri=Iri("http://example.org/hall.owl#map"), bodies=tuple(bodies))


def _body(number: int, position: Vector, yaw: float, size: Vector) -> Body:
    turn = (float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2)))
    iri = Iri(f"http://example.org/hall.owl#b{number}")
    return Body(id=BodyId(f"b{number}"), iri=iri, cls=Iri("http://example.org/hall.owl#Box"),
                pose=Pose(position, turn), size=size)  # fmt: skip


def timed(call: Callable[[], object]) -> float:
    """The median of several times of a call [s]."""
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return median(seconds)


def measure() -> Iterator[tuple[str, float, str, float]]:
    world, kb = cluttered_hall(), KnowledgeBase(bundled_ontology=False)
    state = WorldState(world=world, spawned=(world,))

    def ask(question: Question, **arguments: object) -> int:
        return len(question.ask(kb, arguments, present=StateAccess(kb, lambda: state)))

    ask(path, start_position=START, goal="b1", radius=0.2)  # the first one imports SciPy
    peer, theirs = f"SciPy {version('scipy')}: dijkstra on a free grid of that size", timed(_dijkstra)
    yield "path", timed(lambda: ask(path, start_position=START, goal=f"b{BODIES - 1}", radius=0.2)), peer, theirs
    yield "path, blocked", timed(lambda: ask(path, start_position=START, goal="b1", radius=3.0)), peer, theirs
    yield "reachable, all", timed(lambda: ask(reachable, start_position=START, radius=0.2)), peer, theirs
    scene = ShapeScene(world.bodies, NO_GEOMETRY)
    targets, skipped = np.sort(np.random.default_rng(2).choice(BODIES, TARGETS, False)), np.zeros(BODIES, dtype=bool)
    rays = _Rays(world)
    points, _ = scene.sample_points(targets.tolist())
    ours = timed(lambda: scene.visibility(EYE, targets.tolist(), skipped))
    yield f"visibility of {TARGETS}", ours, f"MuJoCo {version('mujoco')}: mj_multiRay", timed(lambda: rays.cast(points))
    pose = " ".join(map(str, EYE))
    everything = rays.cast(points) * BODIES / TARGETS
    yield "visible_from, all", timed(lambda: ask(visible_from, viewer_pose=pose)), "mj_multiRay, scaled up", everything


def measure_prolog() -> Iterator[tuple[str, float, str, float]]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        console.holds(FACTS)
        for relation, definition in DEFINITIONS.items():
            ours, theirs = (f"aggregate_all(count, {goal}, N)" for goal in (f"{relation}(A, B)", definition))
            counts = [console.solutions(goal)[0]["N"] for goal in (ours, theirs)]
            if counts[0] != counts[1]:
                raise AssertionError(f"{relation}: {counts[0]} pairs, and {counts[1]} in plain Prolog")
            times = [timed(partial(console.holds, goal)) for goal in (ours, theirs)]
            yield f"{relation}, all pairs", times[0], "plain Prolog over facts", times[1]


def _dijkstra() -> None:
    """The shortest paths on a grid of the hall with eight neighbors."""
    side = round(EXTENT_M / CELL_M)
    number = np.arange(side * side).reshape(side, side)
    pairs = [
        (number[:-1], number[1:]),
        (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[1:, :-1], number[:-1, 1:]),
    ]
    sources, ends = (np.concatenate([pair[side].reshape(-1) for pair in pairs]) for side in (0, 1))
    lengths = (1, 1, 2**0.5, 2**0.5)
    weights = np.concatenate([np.full(a.size, length) for (a, _), length in zip(pairs, lengths, strict=True)])
    dijkstra(csr_matrix((weights, (sources, ends)), (side * side,) * 2), directed=False, indices=0)


class _Rays:
    """The same world in MuJoCo."""

    def __init__(self, world: World) -> None:
        spec = mujoco.MjSpec()
        for body in world.bodies:
            assert body.size is not None
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[extent / 2 for extent in body.size],
                pos=list(body.pose.position),
                quat=list(body.pose.quaternion),
            )
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)

    def cast(self, points: Array) -> float:
        """Casts a ray to each point, and returns the time [s]."""
        away = points - EYE
        length = np.linalg.norm(away, axis=1)
        geoms, distances = np.zeros(len(points), dtype=np.int32), np.zeros(len(points))
        start = time.perf_counter()
        mujoco.mj_multiRay(self._model, self._data, EYE, (away / length[:, None]).reshape(-1), None, 1, -1, geoms,
                           distances, None, len(points), mujoco.mjMAXVAL)  # fmt: skip
        return time.perf_counter() - start


if __name__ == "__main__":
    for what, ours, peer, theirs in (*measure(), *measure_prolog()):
        print(what, ours, peer, theirs, sep="\t", flush=True)
