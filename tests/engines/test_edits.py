"""Random sequences of edits: afterwards MuJoCo has the same description as the engine without physics."""

from __future__ import annotations

import contextlib

import msgspec
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mindstage.engines import Engine, NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import SimulationDivergedError, WorldError
from mindstage.scene import BodyId, BodyPhysics, Mobility, Pose, World, diff
from mindstage.scene.edits import Attach, Delete, Detach, SetPhysics, SetPoses, Spawn
from tests.engines.scenes import FLOOR, body, room, world
from tests.worlds import poses, worlds

names = st.integers(0, 9)
edits = st.lists(
    st.one_of(
        st.tuples(st.just("delete"), names),
        st.tuples(st.just("attach"), names, names),
        st.tuples(st.just("detach"), names),
        st.tuples(st.just("set_pose"), names, poses()),
        st.tuples(st.just("set_mobility"), names, st.sampled_from(Mobility)),
        st.tuples(st.just("spawn"), names),
        st.tuples(st.just("save and restore")),
        st.tuples(st.just("look")),
    ),
    max_size=12,
)


def apply(engine: Engine, described: World, edit: tuple[object, ...]) -> str:
    """Applies an edit; returns the error message, or an empty string."""
    ids = engine.poses()[0]
    operation, *rest = edit
    chosen = [ids[n % len(ids)] if isinstance(n, int) and ids else n for n in rest]
    if not ids and operation not in {"spawn", "save and restore", "look"}:
        return ""
    try:
        if operation == "delete":
            engine.apply(Delete((BodyId(str(chosen[0])),)))
        elif operation == "attach":
            engine.apply(Attach(BodyId(str(chosen[0])), BodyId(str(chosen[1]))))
        elif operation == "detach":
            engine.apply(Detach(BodyId(str(chosen[0]))))
        elif operation == "set_pose" and isinstance(chosen[1], Pose):
            engine.apply(SetPoses({BodyId(str(chosen[0])): chosen[1]}))
        elif operation == "set_mobility" and isinstance(chosen[1], Mobility):
            engine.apply(SetPhysics(BodyId(str(chosen[0])), BodyPhysics(mobility=chosen[1], mass_kg=2.0)))
        elif operation == "spawn" and described.bodies:
            engine.apply(Spawn(msgspec.structs.replace(described, resources=(), facts=())))
        elif operation == "save and restore":
            engine.restore_state(engine.save_state())
    except WorldError as error:
        return type(error).__name__
    return ""


@given(described=worlds(max_bodies=5), todo=edits)
def test_edits_leave_the_same_description_in_mujoco_and_in_the_null_engine(
    described: World, todo: list[tuple[object, ...]]
) -> None:
    loose = msgspec.structs.replace(described, joints=(), lights=())
    simulated, null = MujocoEngine(), NullEngine()
    simulated.apply(Spawn(loose))
    null.apply(Spawn(loose))
    for edit in todo:
        assert apply(simulated, loose, edit) == apply(null, loose, edit)
        if edit[0] == "look":
            simulated._cache.model()
    found = diff(null.snapshot(), simulated.snapshot())
    assert found.identical(1e-6), found


@given(todo=edits, pauses=st.integers(0, 3))
def test_a_running_room_survives_any_edits(todo: list[tuple[object, ...]], pauses: int) -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(room()))
    engine.step(0.05)
    for number, edit in enumerate(todo):
        apply(engine, room(), edit)
        if number % (pauses + 1) == 0:
            with contextlib.suppress(SimulationDivergedError):  # a body moved a kilometer into another may well diverge
                engine.step(0.01)
    snapshot = engine.snapshot()
    assert {body.id for body in snapshot.bodies} == set(engine.poses()[0])
    fixed = [body.id for body in room().bodies if body.id == "floor" and body.id in engine.poses()[0]]
    assert not fixed or np.isfinite(engine.poses()[1][engine.poses()[0].index(fixed[0])]).all()


def test_what_is_on_a_shelf_stays_there_when_something_is_put_below_it() -> None:
    """The box of the fridge is hollow for the milk; for the jam it gets a second floor, and keeps the first."""
    fridge = body("fridge", (0, 0, 0.9), (0.6, 0.6, 1.8))
    milk = body("milk", (0, 0, 1.2), (0.08, 0.08, 0.24), "dynamic", 1.0)
    jam = body("jam", (0.1, 0.1, 0.4), (0.06, 0.06, 0.1), "dynamic", 0.4)
    engine = MujocoEngine()
    engine.apply(Spawn(world(FLOOR, fridge, milk)))
    engine.step(0.5)
    engine.apply(Spawn(world(jam)))
    engine.apply(SetPoses({milk.id: Pose((0, 0, 1.21))}))  # which wakes it up
    engine.step(2.0)
    poses = dict(zip(*engine.poses(), strict=True))
    for thing in (milk, jam):
        np.testing.assert_allclose(poses[thing.id][:3], thing.pose.position, atol=1e-3)
