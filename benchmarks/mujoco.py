"""The MuJoCo engine against MuJoCo alone: what spawning, stepping and looking cost on top of it."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from statistics import median

import mujoco
import numpy as np

from benchmarks import Measure
from mindstage.engines import MujocoEngine
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.world import Body, BodyId, Constraint, Iri, Mobility, Physics, Pose, World

RUNS = 9


def measure() -> Iterator[Measure]:
    kitchen = _kitchen()
    yield _spawn_against_script("the bundled kitchen", kitchen)
    yield _spawn_against_script("1,000 bodies, a tenth dynamic", _field(1000))
    yield _step_against_bare(kitchen)
    yield _faster_than_life(kitchen)
    yield _cost_per_body()
    yield _cost_per_body_by_hand()
    yield _reading_poses()


def _kitchen() -> World:
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    return knowledge.world()


def _field(count: int) -> World:
    """Boxes on a grid, one in ten of them dynamic, on a floor."""
    side = int(np.ceil(np.sqrt(count)))
    bodies = [_box("floor", (side / 2, side / 2, -0.05), (side + 2.0, side + 2.0, 0.1), Mobility.STATIC)]
    for i in range(count):
        x, y = divmod(i, side)
        mobility = Mobility.DYNAMIC if i % 10 == 0 else Mobility.STATIC
        bodies.append(_box(f"box{i}", (x, y, 0.25), (0.5, 0.5, 0.5), mobility))
    return World(iri=Iri("http://example.org/field.owl#map"), bodies=tuple(bodies))


def _box(name: str, position: tuple[float, float, float], size: tuple[float, float, float], mobility: Mobility) -> Body:
    iri = Iri(f"http://example.org/field.owl#{name}")
    physics = Physics(mobility=mobility, mass_kg=3.0)
    return Body(id=BodyId(name), iri=iri, cls=iri, pose=Pose(position), size=size, physics=physics)


def _spawn(world: World) -> MujocoEngine:
    engine = MujocoEngine()
    engine.spawn(world)
    engine.poses()
    engine.step(0.002)
    return engine


def _script(world: World) -> mujoco.MjModel:
    """What one writes by hand for the same bodies: attached ones nested, joints, joined pairs kept apart.

    It leaves out what the engine also does: finding overlaps, hollow containers, friction that holds, reports.
    """
    spec = mujoco.MjSpec()
    bodies = {body.id: body for body in world.bodies}
    holders = {hold.child: hold.parent for hold in world.attachments}
    joints = {}
    for constraint in world.constraints:
        free = next(end for end in (constraint.child, constraint.parent) if bodies[end].physics.simulates)
        holders[free] = constraint.parent if free == constraint.child else constraint.child
        joints[free] = constraint
        spec.add_exclude(bodyname1=constraint.parent, bodyname2=constraint.child)
    made: dict[str, mujoco.MjsBody] = {}
    for name in bodies:
        _add_by_hand(spec, name, bodies, holders, joints, made)
    model = spec.compile()
    mujoco.mj_step(model, mujoco.MjData(model))
    return model


def _add_by_hand(
    spec: mujoco.MjSpec,
    name: BodyId,
    bodies: dict[BodyId, Body],
    holders: dict[BodyId, BodyId],
    joints: dict[BodyId, Constraint],
    made: dict[str, mujoco.MjsBody],
) -> mujoco.MjsBody:
    if name in made:
        return made[name]
    body, parent, origin = bodies[name], spec.worldbody, np.zeros(3)
    if name in holders:
        parent = _add_by_hand(spec, holders[name], bodies, holders, joints, made)
        origin = np.array(bodies[holders[name]].pose.position)
    place = np.array(body.pose.position) - origin
    made[name] = parent.add_body(name=name, pos=place, quat=body.pose.quaternion)
    half = [max(length, 0.001) / 2 for length in body.size or (0.1, 0.1, 0.1)]
    made[name].add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, mass=body.physics.mass_kg or 1.0)
    if name in joints:
        slides = joints[name].linear.limit > 0
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        at = np.array(joints[name].pose.position) - np.array(body.pose.position)
        made[name].add_joint(type=kind, pos=at, axis=[1, 0, 0] if slides else [0, 0, 1], limited=True, range=[-1, 1])
    elif body.physics.simulates and name not in holders:
        made[name].add_freejoint()
    return made[name]


def _timed(*actions: Callable[[], object]) -> list[float]:
    """The median of each [s]; they take turns, so that a busy machine slows all alike."""
    seconds: list[list[float]] = [[] for _ in actions]
    for _ in range(RUNS):
        for action, taken in zip(actions, seconds, strict=True):
            start = time.perf_counter()
            action()
            taken.append(time.perf_counter() - start)
    return [median(taken) for taken in seconds]


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _spawn_against_script(what: str, world: World) -> Measure:
    ours, theirs = _timed(lambda: _spawn(world), lambda: _script(world))
    return Measure(
        what=f"spawn {what}", ours=1000 * ours, unit="ms", peer="a hand-written MjSpec script of the same bodies",
        theirs=1000 * theirs, at_most=1.5, memory_mb=_memory_mb(),
    )  # fmt: skip


def _step_against_bare(world: World) -> Measure:
    """A sixtieth of a second at a time with one body kept moving, so that not everything is asleep."""
    engine = _spawn(world)
    engine.save()
    live = engine._keeper.live()
    model, data = live.model, mujoco.MjData(live.model)
    data.qpos[:], data.qvel[:] = live.data.qpos, live.data.qvel
    for one in (engine._keeper.live(), None):
        (one.model if one else model).opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)

    def ours() -> None:
        for _ in range(30):
            engine.step(0.016)

    def bare() -> None:
        for _ in range(30):
            mujoco.mj_step(model, data, nstep=8)

    mine, theirs = _timed(ours, bare)
    return Measure(
        what="step the kitchen, nothing asleep", ours=1000 * mine / 240, unit="ms", peer="mj_step of the same model",
        theirs=1000 * theirs / 240, at_most=1.05,
    )  # fmt: skip


def _faster_than_life(world: World) -> Measure:
    def run() -> None:
        _spawn(world).step(10.0)

    (seconds,) = _timed(run)
    return Measure(
        what="simulated seconds a second, the kitchen left alone for 10 s", ours=10.0 / seconds, unit="s/s",
        at_least=5.0,
    )  # fmt: skip


def _cost_per_body() -> Measure:
    large, small = _field(10_000), _field(1000)
    ours, theirs = _timed(lambda: _spawn(large), lambda: _spawn(small))
    return Measure(
        what="spawn cost of one body of 10,000", ours=1e6 * ours / 10_000, unit="us", peer="of one of 1,000",
        theirs=1e6 * theirs / 1000, at_most=2.0, memory_mb=_memory_mb(),
    )  # fmt: skip


def _cost_per_body_by_hand() -> Measure:
    """For comparison: MuJoCo's own cost of a body grows with their number."""
    large, small = _field(10_000), _field(1000)
    theirs, few = _timed(lambda: _script(large), lambda: _script(small))
    return Measure(
        what="the same by the hand-written script", ours=1e6 * theirs / 10_000, unit="us", peer="of one of 1,000",
        theirs=1e6 * few / 1000,
    )  # fmt: skip


def _reading_poses() -> Measure:
    engine = _spawn(_field(10_000))
    data = engine._keeper.live().data

    def ours() -> None:
        for _ in range(20):
            engine.poses()

    def one_by_one() -> None:
        [(data.body(number).xpos, data.body(number).xquat) for number in range(data.xpos.shape[0])]

    mine, theirs = _timed(ours, one_by_one)
    return Measure(
        what="read all poses of 10,000 bodies", ours=1000 * mine / 20, unit="ms", peer="MuJoCo's 1,001, one by one",
        theirs=1000 * theirs, at_most=1.0,
    )  # fmt: skip
