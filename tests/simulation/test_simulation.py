"""A simulation: calls from any thread, timeouts, real time, reset and closing."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from mindstage.engines import NullEngine, PoseArray
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, SimulationError, SimulationTimeoutError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, Pose, diff
from mindstage.scene.edits import Delete, SetPoses
from mindstage.simulation import Simulation
from tests.engines.scenes import body, room, world


@pytest.fixture(scope="module")
def knowledge() -> KnowledgeBase:
    return KnowledgeBase(bundled_ontology=False)


@pytest.fixture
def sim(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine(), timeout_s=60.0) as sim:
        yield sim


def wait_until(condition: object, timeout_s: float = 60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.01)


def pose_of(sim: Simulation, id: str) -> PoseArray:
    snapshot = sim.state
    return snapshot.poses[snapshot.ids.index(BodyId(id))]


def test_a_spawned_world_equals_its_snapshot_and_is_published(sim: Simulation) -> None:
    assert sim.spawn(room()).ok
    assert diff(room(), sim.snapshot()).identical(0.0)
    assert set(sim.state.ids) == {body.id for body in room().bodies}


def test_every_call_runs_in_the_engine_thread(sim: Simulation) -> None:
    names = {sim.engine.run(lambda engine: threading.current_thread().name) for _ in range(3)}
    assert names == {"mindstage-simulation"}


def test_calls_from_many_threads_are_all_executed(sim: Simulation) -> None:
    sim.spawn(room())
    sim.play()
    counts: list[int] = []
    threads = [
        threading.Thread(target=lambda: counts.append(sum(len(sim.snapshot().bodies) for _ in range(20))))
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert counts == [20 * len(room().bodies)] * 8


def test_a_call_that_takes_too_long_times_out_and_the_next_works(knowledge: KnowledgeBase) -> None:
    release = threading.Event()
    with Simulation(knowledge, NullEngine(), timeout_s=1.0) as sim:
        with pytest.raises(SimulationTimeoutError, match="slow"):
            sim.engine.run(lambda engine: release.wait(60), label="slow")
        ran: list[str] = []
        with pytest.raises(SimulationTimeoutError):
            sim.engine.run(lambda engine: ran.append("late"), label="queued behind")
        release.set()
        sim.engine.run(lambda engine: None, timeout_s=60.0)
        assert ran == [], "a canceled call was executed"


def test_what_the_engine_raises_reaches_the_caller(sim: Simulation) -> None:
    with pytest.raises(BodyNotFoundError, match="ghost"):
        sim.highlight([BodyId("ghost")], (1.0, 0.0, 0.0))


def test_a_playing_simulation_keeps_real_time_and_a_paused_one_stops(sim: Simulation) -> None:
    sim.spawn(room())
    started_s = time.monotonic()
    sim.play()
    wait_until(lambda: sim.state.time_s > 0.5)
    sim.pause()
    passed = sim.state.time_s
    assert passed < time.monotonic() - started_s + 0.1  # a busy machine may only make it slower
    time.sleep(0.1)
    assert sim.state.time_s == passed


def test_playing_faster_passes_more_time(sim: Simulation) -> None:
    sim.play(speed=5.0)
    wait_until(lambda: sim.state.time_s > 2.0)
    with pytest.raises(InvalidArgumentError, match="above 0"):
        sim.play(speed=0.0)


def test_a_pull_on_the_handle_opens_the_drawer_and_release_leaves_it_open(sim: Simulation) -> None:
    sim.spawn(room())
    start = pose_of(sim, "drawer")
    handle = pose_of(sim, "drawer_handle")
    sim.pull(BodyId("drawer_handle"), point=(0.0, 0.0, 0.0), target=tuple(np.add(handle[:3], (0.4, 0, 0)).tolist()))
    sim.step(2.0)
    sim.release()
    opened = pose_of(sim, "drawer")[0] - start[0]
    assert 0.3 < opened < 0.45
    sim.step(1.0)
    assert abs(pose_of(sim, "drawer")[0] - start[0] - opened) < 0.02


def test_a_light_body_can_be_lifted_without_oscillation(sim: Simulation) -> None:
    sim.spawn(room())
    sim.step(1.0)
    mug = pose_of(sim, "mug")
    sim.pull(BodyId("mug"), point=(0.0, 0.0, 0.0), target=tuple(np.add(mug[:3], (0, 0, 0.5)).tolist()))
    sim.step(3.0)
    assert pose_of(sim, "mug")[2] == pytest.approx(mug[2] + 0.5, abs=0.02)


def test_reset_restores_the_spawned_world(sim: Simulation) -> None:
    sim.spawn(room())
    sim.step(0.5)
    sim.engine.run(lambda engine: engine.apply(Delete((BodyId("mug"),))), edits=True)
    sim.reset()
    assert diff(room(), sim.snapshot()).identical(0.0)


def test_reset_works_for_an_engine_that_cannot_save(knowledge: KnowledgeBase) -> None:
    class EngineWithoutSave(NullEngine):
        capabilities = frozenset()

    with Simulation(knowledge, EngineWithoutSave()) as sim:
        sim.spawn(room())
        sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("mug"): Pose((9, 9, 9))})), edits=True)
        sim.reset()
        assert diff(room(), sim.snapshot()).identical(0.0)


def test_a_diverged_simulation_pauses_with_an_error_until_it_is_reset(sim: Simulation) -> None:
    sim.spawn(room())
    sim.engine.run(lambda engine: engine.apply_force(BodyId("mug"), (1e30, 0.0, 0.0)))
    sim.play()
    wait_until(lambda: sim.state.error)
    assert "mug" in sim.state.error
    wait_until(lambda: not sim.state.playing)
    sim.reset()
    assert sim.state.error == ""
    sim.step(0.1)
    assert np.isfinite(sim.state.poses).all()


def test_revisions_count_edits_and_not_motion(sim: Simulation) -> None:
    sim.spawn(room())
    before = sim.state.revision
    sim.step(0.1)
    assert sim.state.revision == before
    sim.highlight([BodyId("mug")], (1.0, 0.0, 0.0))
    assert sim.state.revision > before


def test_a_reset_is_published_as_an_edit(sim: Simulation) -> None:
    sim.spawn(room())
    sim.engine.run(lambda engine: engine.apply(Delete((BodyId("mug"),))), edits=True)
    before, notified = sim.state.revision, threading.Event()
    sim.clients.on_edit(notified.set)
    sim.reset()
    assert sim.state.revision > before, "the pages draw what was restored"
    assert notified.is_set()


def test_long_steps_report_their_progress(sim: Simulation) -> None:
    seen: list[float] = []
    sim.step(0.35, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(0.35)
    assert len(seen) > 2


def test_closing_twice_is_harmless_and_later_calls_are_rejected(knowledge: KnowledgeBase) -> None:
    before = set(threading.enumerate())  # other tests may have simulations of their own
    sim = Simulation(knowledge, NullEngine())
    sim.play()
    assert set(threading.enumerate()) > before
    sim.close()
    sim.close()
    with pytest.raises(SimulationError, match="closed"):
        sim.snapshot()
    assert set(threading.enumerate()) <= before


def test_the_pose_of_a_body_is_that_of_the_published_state(sim: Simulation) -> None:
    sim.spawn(room())
    crate = sim.body("crate")
    assert crate.pose == sim.snapshot().body("crate").pose
    assert sim.body(room().body("crate").iri).id == "crate"
    sim.step(0.1)
    assert crate.pose.position == tuple(pose_of(sim, "crate")[:3].tolist())
    assert crate.pose.position[2] < 1.0
    assert repr(crate) == f"<SimulationBody crate at (2.000, 0.000, {crate.pose.position[2]:.3f}) m>"


def test_the_pose_of_a_deleted_or_unknown_body_is_an_error(sim: Simulation) -> None:
    sim.spawn(room())
    crate = sim.body("crate")
    with pytest.raises(BodyNotFoundError, match="no body 'crat'; near: 'crate'"):
        sim.body("crat")
    sim.clear()
    assert not crate.exists
    assert repr(crate) == "<SimulationBody crate, deleted>"
    with pytest.raises(BodyNotFoundError, match="no body 'crate'"):
        _ = crate.pose


def test_the_arrays_of_a_published_state_cannot_be_written(sim: Simulation) -> None:
    sim.spawn(room())
    for _ in range(2):
        with pytest.raises(ValueError, match="read-only"):
            sim.state.poses[0, 0] = 1.0
        sim.step(0.1)
    with sim.fork(threaded=False) as copy, pytest.raises(ValueError, match="read-only"):
        copy.state.poses += 1.0


def test_a_return_to_the_start_from_an_empty_world_forgets_no_world(sim: Simulation) -> None:
    sim.spawn(room())
    later = world(body("later", (3, 3, 1), (0.2, 0.2, 0.2), "dynamic", 1.0))
    sim.spawn(later)
    sim.apply(Delete(sim.state.ids))
    sim.reset(to_start=True, keep_spawned=True)
    assert later in sim.worlds
    assert set(sim.state.ids) == {each.id for each in room().bodies}
