"""Markers and signs of life: what a stage shows beside the world, and how it tells that the engine is lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from mindstage.engines import NullEngine
from mindstage.errors import EngineClosed, StageError, StageTimedOut
from mindstage.knowledge import KnowledgeBase
from mindstage.stage import Marker, MarkerForm, Stage
from mindstage.stage.markers import Markers
from mindstage.world import Pose
from tests.engines.scenes import room


@pytest.fixture
def stage() -> Iterator[Stage]:
    with Stage(KnowledgeBase(bundled_ontology=False), NullEngine()) as stage:
        stage.spawn(room())
        yield stage


def cube(id: str) -> Marker:
    return Marker(id=id, form=MarkerForm.CUBE)


def test_markers_are_seen_by_all_who_watch_until_they_are_taken_away(stage: Stage) -> None:
    stage.mark([cube("a"), cube("b")])
    before = stage.frame
    assert [marker.id for marker in before.markers] == ["a", "b"]
    stage.mark([Marker(id="a", form=MarkerForm.CUBE, pose=Pose((1, 2, 3)))])
    assert stage.frame.markers[0].pose.position == (1, 2, 3)
    assert stage.unmark(["b", "nobody"]) == ("b",)
    assert [marker.id for marker in stage.frame.markers] == ["a"]
    assert len(before.markers) == 2


def test_markers_are_no_part_of_the_world(stage: Stage) -> None:
    world = stage.log()
    edition = stage.frame.edition
    stage.mark([cube("a")])
    assert stage.log() == world
    assert stage.frame.edition == edition
    stage.clear()
    assert [marker.id for marker in stage.frame.markers] == ["a"]


def test_a_marker_goes_by_itself_whether_the_world_plays_or_not(stage: Stage) -> None:
    for play in (False, True):
        if play:
            stage.play()
        stage.mark([cube("short")], lifetime_s=0.05)
        stage.mark([cube("long")])
        end = time.monotonic() + 10.0
        while len(stage.frame.markers) > 1:
            assert time.monotonic() < end
            time.sleep(0.005)
        assert stage.frame.markers[0].id == "long"


def test_the_next_one_to_go_is_the_one_that_is_waited_for() -> None:
    now = 100.0
    markers = Markers(now=lambda: now)
    assert markers.due_s() is None
    markers.show([cube("a")], lifetime_s=5.0)
    markers.show([cube("b")], lifetime_s=2.0)
    markers.show([cube("c")])
    assert markers.due_s() == 2.0
    now = 102.0
    assert markers.expire()
    assert not markers.expire()
    assert [marker.id for marker in markers.all] == ["a", "c"]
    markers.show([cube("a")])
    assert markers.due_s() is None


def test_a_lost_engine_is_noticed_by_whoever_asks_it_and_told_to_all(stage: Stage) -> None:
    assert stage.ping() < 10.0
    assert stage.lost is None
    stage.play()
    stage._engine.close()
    with pytest.raises(EngineClosed):
        stage.ping()
    assert isinstance(stage.lost, EngineClosed)
    assert "is closed" in stage.frame.fault
    assert not stage.frame.playing
    with pytest.raises(EngineClosed):
        stage.ping()  # the stage's own thread lives on


def test_a_busy_stage_is_not_a_lost_engine(stage: Stage) -> None:
    busy, go_on = threading.Event(), threading.Event()

    def work(_: object) -> None:
        busy.set()
        go_on.wait(10.0)

    worker = threading.Thread(target=lambda: stage.call(work))
    worker.start()
    assert busy.wait(10.0)
    with pytest.raises(StageTimedOut):
        stage.ping(timeout_s=0.05)
    assert stage.lost is None
    go_on.set()
    worker.join()
    assert stage.ping() >= 0.0


def test_nothing_plays_on_a_closed_stage(stage: Stage) -> None:
    stage.close()
    with pytest.raises(StageError, match="closed"):
        stage.play()
