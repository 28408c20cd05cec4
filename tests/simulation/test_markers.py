"""Markers and signs of life: what a stage shows beside the world, and how it tells that the engine is lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from mindstage.engines import NullEngine
from mindstage.errors import EngineClosedError, SimulationError, SimulationTimeoutError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Pose
from mindstage.simulation import Marker, MarkerType, Simulation
from mindstage.simulation.highlights import MarkerStore
from tests.engines.scenes import room


@pytest.fixture
def stage() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(bundled_ontology=False), NullEngine()) as stage:
        stage.spawn(room())
        yield stage


def cube(id: str) -> Marker:
    return Marker(id=id, type=MarkerType.CUBE)


def test_markers_are_seen_by_all_who_watch_until_they_are_taken_away(stage: Simulation) -> None:
    stage.add_markers([cube("a"), cube("b")])
    before = stage.state
    assert [marker.id for marker in before.markers] == ["a", "b"]
    stage.add_markers([Marker(id="a", type=MarkerType.CUBE, pose=Pose((1, 2, 3)))])
    assert stage.state.markers[0].pose.position == (1, 2, 3)
    assert stage.remove_markers(["b", "nobody"]) == ("b",)
    assert [marker.id for marker in stage.state.markers] == ["a"]
    assert len(before.markers) == 2


def test_markers_are_no_part_of_the_world(stage: Simulation) -> None:
    world = stage.snapshot()
    edition = stage.state.revision
    stage.add_markers([cube("a")])
    assert stage.snapshot() == world
    assert stage.state.revision == edition
    stage.clear()
    assert [marker.id for marker in stage.state.markers] == ["a"]


def test_a_marker_goes_by_itself_whether_the_world_plays_or_not(stage: Simulation) -> None:
    for play in (False, True):
        if play:
            stage.play()
        stage.add_markers([cube("short")], lifetime_s=0.05)
        stage.add_markers([cube("long")])
        end = time.monotonic() + 10.0
        while len(stage.state.markers) > 1:
            assert time.monotonic() < end
            time.sleep(0.005)
        assert stage.state.markers[0].id == "long"


def test_the_next_one_to_go_is_the_one_that_is_waited_for() -> None:
    now = 100.0
    markers = MarkerStore(now=lambda: now)
    assert markers.next_expiry_s() is None
    markers.add([cube("a")], lifetime_s=5.0)
    markers.add([cube("b")], lifetime_s=2.0)
    markers.add([cube("c")])
    assert markers.next_expiry_s() == 2.0
    now = 102.0
    assert markers.expire()
    assert not markers.expire()
    assert [marker.id for marker in markers.markers] == ["a", "c"]
    markers.add([cube("a")])
    assert markers.next_expiry_s() is None


def test_a_lost_engine_is_noticed_by_whoever_asks_it_and_told_to_all(stage: Simulation) -> None:
    assert stage.ping() < 10.0
    assert stage.engine_error is None
    stage.play()
    stage._engine.close()
    with pytest.raises(EngineClosedError):
        stage.ping()
    assert isinstance(stage.engine_error, EngineClosedError)
    assert "is closed" in stage.frame.fault
    assert not stage.frame.playing
    with pytest.raises(EngineClosedError):
        stage.ping()  # the stage's own thread lives on


def test_a_busy_stage_is_not_a_lost_engine(stage: Simulation) -> None:
    busy, go_on = threading.Event(), threading.Event()

    def work(_: object) -> None:
        busy.set()
        go_on.wait(10.0)

    worker = threading.Thread(target=lambda: stage.run_on_engine(work))
    worker.start()
    assert busy.wait(10.0)
    with pytest.raises(SimulationTimeoutError):
        stage.ping(timeout_s=0.05)
    assert stage.engine_error is None
    go_on.set()
    worker.join()
    assert stage.ping() >= 0.0


def test_nothing_plays_on_a_closed_stage(stage: Simulation) -> None:
    stage.close()
    with pytest.raises(SimulationError, match="closed"):
        stage.play()
