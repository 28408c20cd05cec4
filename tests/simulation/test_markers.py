"""Markers of a simulation, and the detection of an engine that does not respond."""

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
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(bundled_ontology=False), NullEngine()) as sim:
        sim.spawn(room())
        yield sim


def cube(id: str) -> Marker:
    return Marker(id=id, type=MarkerType.CUBE)


def test_markers_are_published_until_they_are_removed(sim: Simulation) -> None:
    sim.markers.add([cube("a"), cube("b")])
    before = sim.state
    assert [marker.id for marker in before.markers] == ["a", "b"]
    sim.markers.add([Marker(id="a", type=MarkerType.CUBE, pose=Pose((1, 2, 3)))])
    assert sim.state.markers[0].pose.position == (1, 2, 3)
    assert sim.markers.remove(["b", "nobody"]) == ("b",)
    assert [marker.id for marker in sim.state.markers] == ["a"]
    assert len(before.markers) == 2


def test_markers_are_not_part_of_the_world(sim: Simulation) -> None:
    world = sim.snapshot()
    revision = sim.state.revision
    sim.markers.add([cube("a")])
    assert sim.snapshot() == world
    assert sim.state.revision == revision
    sim.clear()
    assert [marker.id for marker in sim.state.markers] == ["a"]


def test_a_marker_expires_in_a_playing_and_in_a_paused_simulation(sim: Simulation) -> None:
    for play in (False, True):
        if play:
            sim.play()
        sim.markers.add([cube("short")], lifetime_s=0.05)
        sim.markers.add([cube("long")])
        end = time.monotonic() + 60.0
        while len(sim.state.markers) > 1:
            assert time.monotonic() < end
            time.sleep(0.005)
        assert sim.state.markers[0].id == "long"


def test_the_next_expiry_is_that_of_the_shortest_lifetime() -> None:
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


def test_a_lost_engine_raises_and_is_published(sim: Simulation) -> None:
    assert sim.engine.ping() < 10.0
    assert sim.engine.error is None
    sim.play()
    sim._engine.close()
    with pytest.raises(EngineClosedError):
        sim.engine.ping()
    assert isinstance(sim.engine.error, EngineClosedError)
    assert "is closed" in sim.state.error
    assert not sim.state.playing
    with pytest.raises(EngineClosedError):
        sim.engine.ping()  # the engine thread still runs


def test_a_busy_engine_is_not_a_lost_engine(sim: Simulation) -> None:
    busy, go_on = threading.Event(), threading.Event()

    def work(_: object) -> None:
        busy.set()
        go_on.wait(10.0)

    worker = threading.Thread(target=lambda: sim.engine.run(work))
    worker.start()
    assert busy.wait(10.0)
    with pytest.raises(SimulationTimeoutError):
        sim.engine.ping(timeout_s=0.05)
    assert sim.engine.error is None
    go_on.set()
    worker.join()
    assert sim.engine.ping() >= 0.0


def test_a_closed_simulation_cannot_play(sim: Simulation) -> None:
    sim.close()
    with pytest.raises(SimulationError, match="closed"):
        sim.play()
