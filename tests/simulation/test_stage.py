"""Stage: one thread owns the engine, everyone gets a turn, nobody waits for ever."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from mindstage.engines import MujocoEngine, NullEngine, PoseArray
from mindstage.errors import BodyNotFoundError, SimulationError, SimulationTimeoutError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, Pose, diff
from mindstage.simulation import Simulation
from tests.engines.scenes import room


@pytest.fixture(scope="module")
def knowledge() -> KnowledgeBase:
    return KnowledgeBase(bundled_ontology=False)


@pytest.fixture
def stage(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine(), timeout_s=5.0) as stage:
        yield stage


def wait_until(condition: object, timeout_s: float = 10.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.01)


def pose_of(stage: Simulation, id: str) -> PoseArray:
    frame = stage.state
    return frame.poses[frame.ids.index(BodyId(id))]


def test_a_spawned_world_comes_back_and_is_published(stage: Simulation) -> None:
    assert stage.spawn(room()).ok
    assert diff(room(), stage.snapshot()).identical(0.0)
    assert set(stage.state.ids) == {body.id for body in room().bodies}


def test_every_call_runs_in_the_one_thread_that_owns_the_engine(stage: Simulation) -> None:
    names = {stage.run_on_engine(lambda engine: threading.current_thread().name) for _ in range(3)}
    assert names == {"mindstage-simulation"}


def test_calls_from_many_threads_all_get_their_turn(stage: Simulation) -> None:
    stage.spawn(room())
    stage.play()
    counts: list[int] = []
    threads = [
        threading.Thread(target=lambda: counts.append(sum(len(stage.snapshot().bodies) for _ in range(20))))
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert counts == [20 * len(room().bodies)] * 8


def test_a_call_that_takes_too_long_times_out_and_the_next_works(knowledge: KnowledgeBase) -> None:
    release = threading.Event()
    with Simulation(knowledge, NullEngine(), timeout_s=0.2) as stage:
        with pytest.raises(SimulationTimeoutError, match="slow"):
            stage.run_on_engine(lambda engine: release.wait(5), label="slow")
        ran: list[str] = []
        with pytest.raises(SimulationTimeoutError):
            stage.run_on_engine(lambda engine: ran.append("late"), label="queued behind")
        release.set()
        stage.run_on_engine(lambda engine: None, timeout_s=5.0)
        assert ran == [], "a call that was given up ran after all"


def test_what_the_engine_raises_reaches_the_caller(stage: Simulation) -> None:
    with pytest.raises(BodyNotFoundError, match="ghost"):
        stage.highlight([BodyId("ghost")], (1.0, 0.0, 0.0))


def test_a_playing_world_keeps_real_time_and_a_paused_one_stands(stage: Simulation) -> None:
    stage.spawn(room())
    stage.play()
    time.sleep(1.0)
    stage.pause()
    passed = stage.state.time_s
    assert 0.5 < passed < 1.5
    time.sleep(0.1)
    assert stage.state.time_s == passed


def test_playing_faster_passes_more_time(stage: Simulation) -> None:
    stage.play(speed=5.0)
    wait_until(lambda: stage.state.time_s > 2.0)
    with pytest.raises(ValueError, match="above 0"):
        stage.play(speed=0.0)


def test_a_grip_on_the_handle_opens_the_drawer_and_letting_go_leaves_it_open(stage: Simulation) -> None:
    stage.spawn(room())
    start = pose_of(stage, "drawer")
    handle = pose_of(stage, "drawer_handle")
    stage.pull(BodyId("drawer_handle"), point=(0.0, 0.0, 0.0), target=tuple(np.add(handle[:3], (0.4, 0, 0)).tolist()))
    stage.step(2.0)
    stage.release()
    opened = pose_of(stage, "drawer")[0] - start[0]
    assert 0.3 < opened < 0.45
    stage.step(1.0)
    assert abs(pose_of(stage, "drawer")[0] - start[0] - opened) < 0.02


def test_a_light_thing_can_be_lifted_without_shaking(stage: Simulation) -> None:
    stage.spawn(room())
    stage.step(1.0)
    mug = pose_of(stage, "mug")
    stage.pull(BodyId("mug"), point=(0.0, 0.0, 0.0), target=tuple(np.add(mug[:3], (0, 0, 0.5)).tolist()))
    stage.step(3.0)
    assert pose_of(stage, "mug")[2] == pytest.approx(mug[2] + 0.5, abs=0.02)


def test_reset_brings_the_spawned_world_back(stage: Simulation) -> None:
    stage.spawn(room())
    stage.step(0.5)
    stage.run_on_engine(lambda engine: engine.delete([BodyId("mug")]), edits=True)
    stage.reset()
    assert diff(room(), stage.snapshot()).identical(0.0)


def test_reset_works_for_an_engine_that_cannot_save(knowledge: KnowledgeBase) -> None:
    class Forgetful(NullEngine):
        capabilities = frozenset()

    with Simulation(knowledge, Forgetful()) as stage:
        stage.spawn(room())
        stage.run_on_engine(lambda engine: engine.set_pose(BodyId("mug"), Pose((9, 9, 9))), edits=True)
        stage.reset()
        assert diff(room(), stage.snapshot()).identical(0.0)


def test_an_unstable_world_stops_and_says_why_until_it_is_reset(stage: Simulation) -> None:
    stage.spawn(room())
    stage.run_on_engine(lambda engine: engine.apply_force(BodyId("mug"), (1e30, 0.0, 0.0)))
    stage.play()
    wait_until(lambda: stage.state.error)
    assert "mug" in stage.state.error
    wait_until(lambda: not stage.state.playing)
    stage.reset()
    assert stage.state.error == ""
    stage.step(0.1)
    assert np.isfinite(stage.state.poses).all()


def test_editions_count_edits_and_not_movements(stage: Simulation) -> None:
    stage.spawn(room())
    before = stage.state.revision
    stage.step(0.1)
    assert stage.state.revision == before
    stage.highlight([BodyId("mug")], (1.0, 0.0, 0.0))
    assert stage.state.revision > before


def test_long_steps_report_their_progress(stage: Simulation) -> None:
    seen: list[float] = []
    stage.step(0.35, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(0.35)
    assert len(seen) > 2


def test_closing_twice_is_harmless_and_calls_after_it_are_refused(knowledge: KnowledgeBase) -> None:
    before = set(threading.enumerate())  # other tests may have stages of their own
    stage = Simulation(knowledge, NullEngine())
    stage.play()
    assert set(threading.enumerate()) > before
    stage.close()
    stage.close()
    with pytest.raises(SimulationError, match="closed"):
        stage.snapshot()
    assert set(threading.enumerate()) <= before
