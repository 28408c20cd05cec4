"""The MuJoCo engine, compared with MuJoCo alone: spawning, stepping and reading poses."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from statistics import median

import mujoco
import numpy as np
from msgspec.structs import replace

from benchmarks import Measure
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import Attachment, Body, BodyId, BodyPhysics, Iri, Joint, Mobility, Pose, World
from mindstage.scene.edits import Delete, Spawn

RUNS = 9


def measure() -> Iterator[Measure]:
    kitchen = kitchen_world()
    yield _spawn_against_script("the bundled kitchen", kitchen, "same model", _Script(kitchen).run)
    field = grid_world(1000)
    yield _spawn_against_script("1,000 bodies, 10 % dynamic", field, "same bodies", lambda: _hand_written(field))
    yield _step_against_bare(kitchen)
    yield _real_time_factor(kitchen)
    yield _cost_per_body()
    yield _cost_per_body_by_hand()
    yield _reading_poses()
    yield from _many_kitchens(kitchen)


def kitchen_world() -> World:
    knowledge = KnowledgeBase()
    knowledge.load([bundled_kitchen()])
    return knowledge.world()


def grid_world(count: int) -> World:
    """Boxes on a grid on a floor; every tenth is dynamic."""
    side = int(np.ceil(np.sqrt(count)))
    bodies = [_box("floor", (side / 2, side / 2, -0.05), (side + 2.0, side + 2.0, 0.1), Mobility.STATIC)]
    for i in range(count):
        x, y = divmod(i, side)
        mobility = Mobility.DYNAMIC if i % 10 == 0 else Mobility.STATIC
        bodies.append(_box(f"box{i}", (x, y, 0.25), (0.5, 0.5, 0.5), mobility))
    return World(iri=Iri("http://example.org/field.owl#map"), bodies=tuple(bodies))


def _box(name: str, position: tuple[float, float, float], size: tuple[float, float, float], mobility: Mobility) -> Body:
    iri = Iri(f"http://example.org/field.owl#{name}")
    physics = BodyPhysics(mobility=mobility, mass_kg=3.0)
    return Body(id=BodyId(name), iri=iri, cls=iri, pose=Pose(position), size=size, physics=physics)


def _spawn(world: World) -> MujocoEngine:
    engine = MujocoEngine()
    engine.apply(Spawn(world))
    engine.poses()
    engine.step(0.002)
    return engine


class _Script:
    """A hand-written MjSpec script for the same model, with all numbers given.

    It omits what the engine computes first, such as overlaps, hulls and the kinematic tree.
    """

    def __init__(self, world: World) -> None:
        model = _spawn(world)._cache.model().model
        names = [model.body(number).name for number in range(model.nbody)]
        self.bodies = [
            (names[n], int(model.body_parentid[n]), model.body_pos[n].tolist(), model.body_quat[n].tolist(),
             float(model.body_mass[n]), model.body_inertia[n].tolist(), bool(model.body_mocapid[n] >= 0))
            for n in range(1, model.nbody)
        ]  # fmt: skip
        self.geoms = [
            (int(model.geom_bodyid[n]), int(model.geom_type[n]), model.geom_size[n].tolist(),
             model.geom_pos[n].tolist(), model.geom_quat[n].tolist())
            for n in range(model.ngeom)
        ]  # fmt: skip
        self.joints = [
            (int(model.jnt_bodyid[n]), int(model.jnt_type[n]), model.jnt_pos[n].tolist(), model.jnt_axis[n].tolist(),
             bool(model.jnt_limited[n]), model.jnt_range[n].tolist(),
             float(model.dof_frictionloss[model.jnt_dofadr[n]]))
            for n in range(model.njnt)
        ]  # fmt: skip
        self.excluded_pairs = [(names[pair >> 16], names[pair & 0xFFFF]) for pair in model.exclude_signature.tolist()]

    def run(self) -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        made = [spec.worldbody]
        for name, parent, pos, quat, mass, inertia, mocap in self.bodies:
            body = made[parent].add_body(name=name, pos=pos, quat=quat, mocap=mocap)
            if mass > 0.0:
                body.explicitinertial, body.mass, body.inertia = True, mass, inertia
                body.ipos, body.iquat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
            made.append(body)
        for number, kind, size, pos, quat in self.geoms:
            made[number].add_geom(type=mujoco.mjtGeom(kind), size=size, pos=pos, quat=quat, mass=0.0)
        for number, kind, pos, axis, limited, limits, friction in self.joints:
            if kind == int(mujoco.mjtJoint.mjJNT_FREE):
                made[number].add_freejoint()
                continue
            joint = made[number].add_joint(type=mujoco.mjtJoint(kind), pos=pos, axis=axis, frictionloss=friction)
            joint.limited, joint.range = limited, limits
        for first, second in self.excluded_pairs:
            spec.add_exclude(bodyname1=first, bodyname2=second)
        model = spec.compile()
        mujoco.mj_step(model, mujoco.MjData(model))
        return model


def _hand_written(world: World) -> None:
    """A hand-written MjSpec script for independent bodies."""
    spec = mujoco.MjSpec()
    for body in world.bodies:
        half = [length / 2 for length in body.size or (0.1, 0.1, 0.1)]
        made = spec.worldbody.add_body(name=body.id, pos=body.pose.position, quat=body.pose.quaternion)
        made.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, mass=body.physics.mass_kg)
        if body.physics.is_dynamic:
            made.add_freejoint()
    model = spec.compile()
    mujoco.mj_step(model, mujoco.MjData(model))


def _timed(*actions: Callable[[], object]) -> list[float]:
    """The median time of each action [s]; they alternate, so that other load affects all equally."""
    seconds: list[list[float]] = [[] for _ in actions]
    for _ in range(RUNS):
        for action, taken in zip(actions, seconds, strict=True):
            start = time.perf_counter()
            action()
            taken.append(time.perf_counter() - start)
    return [median(taken) for taken in seconds]


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _spawn_against_script(what: str, world: World, peer: str, script: Callable[[], object]) -> Measure:
    ours, theirs = _timed(lambda: _spawn(world), script)
    return Measure(
        what=f"spawn {what}", ours=1000 * ours, unit="ms", peer=f"MjSpec script, {peer}",
        theirs=1000 * theirs, at_most=1.5, memory_mb=_memory_mb(),
    )  # fmt: skip


def _step_against_bare(world: World) -> Measure:
    """Steps of 16 ms with sleeping disabled."""
    engine = _spawn(world)
    engine.save_state()
    live = engine._cache.model()
    model, data = live.model, mujoco.MjData(live.model)
    data.qpos[:], data.qvel[:] = live.data.qpos, live.data.qvel
    for one in (engine._cache.model(), None):
        (one.model if one else model).opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)

    def ours() -> None:
        for _ in range(30):
            engine.step(0.016)

    def bare() -> None:
        for _ in range(30):
            mujoco.mj_step(model, data, nstep=8)

    mine, theirs = _timed(ours, bare)
    return Measure(
        what="step the kitchen, sleeping disabled", ours=1000 * mine / 240, unit="ms", peer="mj_step of the same model",
        theirs=1000 * theirs / 240, at_most=1.05,
    )  # fmt: skip


def _real_time_factor(world: World) -> Measure:
    def run() -> None:
        _spawn(world).step(10.0)

    (seconds,) = _timed(run)
    return Measure(
        what="real-time factor, the kitchen for 10 s", ours=10.0 / seconds, unit="s/s",
        at_least=5.0,
    )  # fmt: skip


def _cost_per_body() -> Measure:
    large, small = grid_world(10_000), grid_world(1000)
    ours, theirs = _timed(lambda: _spawn(large), lambda: _spawn(small))
    return Measure(
        what="spawn, per body of 10,000", ours=1e6 * ours / 10_000, unit="us", peer="per body of 1,000",
        theirs=1e6 * theirs / 1000, at_most=2.0, memory_mb=_memory_mb(),
    )  # fmt: skip


def _cost_per_body_by_hand() -> Measure:
    """For comparison: the cost per body of MuJoCo alone grows with the number of bodies, too."""
    many, some = grid_world(10_000), grid_world(1000)
    theirs, few = _timed(lambda: _hand_written(many), lambda: _hand_written(some))
    return Measure(
        what="the same, MjSpec script", ours=1e6 * theirs / 10_000, unit="us", peer="per body of 1,000",
        theirs=1e6 * few / 1000,
    )  # fmt: skip


def copies_of(world: World, count: int) -> World:
    """A world that many times, in a square with gaps of about 3 m; the copies of `id` are `id@1` and so on."""
    side = int(np.ceil(np.sqrt(count)))

    def renamed(id: BodyId, number: int) -> BodyId:
        return BodyId(f"{id}@{number}" if number else id)

    def moved(pose: Pose, number: int) -> Pose:
        x, y, z = pose.position
        return replace(pose, position=(x + 8.0 * (number % side), y + 8.0 * (number // side), z))

    def ends(link: Joint | Attachment, number: int) -> dict[str, BodyId]:
        return {"parent": renamed(link.parent, number), "child": renamed(link.child, number)}

    numbers = range(count)
    return replace(
        world,
        bodies=tuple(
            replace(each, id=renamed(each.id, n), pose=moved(each.pose, n)) for n in numbers for each in world.bodies
        ),
        joints=tuple(
            replace(each, id=renamed(each.id, n), pose=moved(each.pose, n), **ends(each, n))
            for n in numbers
            for each in world.joints
        ),
        attachments=tuple(replace(each, **ends(each, n)) for n in numbers for each in world.attachments),
    )


def _many_kitchens(kitchen: World) -> Iterator[Measure]:
    """Worlds of 5,080 and of 20,320 bodies: spawn and first step, an edit, and rest."""
    (one_s,) = _timed(lambda: _spawn(kitchen))
    for count, seconds in ((20, 1.0), (80, 6.0)):
        world = copies_of(kitchen, count)
        start = time.perf_counter()
        engine = _spawn(world)
        first_s = time.perf_counter() - start
        bodies = f"{len(world.bodies):,} bodies"
        yield Measure(
            what=f"spawn and first step, {bodies}", ours=first_s, unit="s", peer=f"{count} times the kitchen alone",
            theirs=count * one_s, at_most=2.0, memory_mb=_memory_mb(),
        )  # fmt: skip
        yield Measure(what=f"the same, {bodies}", ours=first_s, unit="s", at_most=seconds)
        engine.step(5.0)
        taken = []
        for number in range(RUNS):
            thing = _box(f"new{number}", (8.0 + 0.3 * number, 0.5, 1.2), (0.1, 0.1, 0.1), Mobility.DYNAMIC)
            start = time.perf_counter()
            engine.apply(Spawn(replace(world, bodies=(thing,), joints=(), attachments=())))
            engine.step(0.002)
            taken.append(time.perf_counter() - start)
        yield Measure(what=f"a new body among {bodies}", ours=1000 * median(taken), unit="ms", at_most=50.0)
        taken = []
        for number in range(RUNS):
            start = time.perf_counter()
            engine.apply(Delete((BodyId(f"new{number}"),)))
            engine.step(0.002)
            taken.append(time.perf_counter() - start)
        yield Measure(what=f"a deletion among {bodies}", ours=1000 * median(taken), unit="ms", at_most=50.0)
        engine.step(5.0)
        (forked_s,) = _timed(engine.fork)
        yield Measure(what=f"a copy of {bodies} at rest", ours=1000 * forked_s, unit="ms", at_most=20.0)
        start = time.perf_counter()
        engine.step(60.0)
        yield Measure(
            what=f"real-time factor at rest, {bodies}", ours=60.0 / (time.perf_counter() - start), unit="s/s",
            at_least=100.0,
        )  # fmt: skip


def _reading_poses() -> Measure:
    engine = _spawn(grid_world(10_000))
    data = engine._cache.model().data

    def ours() -> None:
        for _ in range(20):
            engine.poses()

    def one_by_one() -> None:
        [(data.body(number).xpos, data.body(number).xquat) for number in range(data.xpos.shape[0])]

    mine, theirs = _timed(ours, one_by_one)
    return Measure(
        what="read all poses of 10,000 bodies", ours=1000 * mine / 20, unit="ms", peer="MuJoCo, one by one",
        theirs=1000 * theirs, at_most=1.0,
    )  # fmt: skip
