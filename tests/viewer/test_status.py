"""What the page says about the engine, its guests, and what was found and assumed about the map."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation, World
from mindstage.engines import Capability, EngineStats, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.engines.base import SpawnFailure
from mindstage.knowledge import bundled_kitchen
from mindstage.scene import NO_GEOMETRY, BodyId, GeometryMap, Iri
from mindstage.simulation import ConnectedClient
from mindstage.viewer.inspector import StatusHandler
from mindstage.viewer.server import RpcChannel
from tests.kitchenette import kitchenette
from tests.viewer.pretending import FakePage


class BusyEngine(NullEngine):
    """Nothing moves, and it says otherwise; one body it does not take."""

    busy = EngineStats(movable=7, awake=3, contacts=12, timestep_s=0.002)

    def stats(self) -> EngineStats:
        return self.busy

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        report = super().spawn(world, geometry=geometry)
        note = SpawnNote(SpawnNoteKind.HOLLOW, ("Fridge", "Mug"), "Fridge is hollow, so that Mug stands in it")
        return msgspec.structs.replace(report, notes=(note,), failed_bodies=(SpawnFailure("Ghost", "it has no size"),))


class SilentEngine(NullEngine):
    capabilities = frozenset({Capability.SAVE})


@pytest.fixture
def stage() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), BusyEngine(), shapes=False) as stage:
        stage.spawn(kitchenette())
        yield stage


@pytest.fixture
def channel() -> Iterator[RpcChannel]:
    channel = RpcChannel()
    yield channel
    channel.close()


@pytest.fixture
def desk(stage: Simulation, channel: RpcChannel) -> StatusHandler:
    return StatusHandler(stage, channel)


def test_the_engines_figures_are_told(stage: Simulation, channel: RpcChannel, desk: StatusHandler) -> None:
    desk.publish(stage.state)
    told = FakePage(channel).latest_value("status")
    assert (told["engine"], told["bodies"], told["playing"]) == ("null", len(stage.state.ids), False)
    assert told["statistics"] == {"movable": 7, "awake": 3, "contacts": 12, "timestep_s": 0.002}
    assert (told["errors"], told["warnings"]) == (1, 1)


def test_an_engine_that_says_nothing_is_not_asked(channel: RpcChannel) -> None:
    with Simulation(KnowledgeBase(), SilentEngine(), shapes=False) as stage:
        StatusHandler(stage, channel).publish(stage.state)
        assert stage.state.stats is None
    assert FakePage(channel).latest_value("status")["statistics"] is None


def test_a_fault_is_told_to_all(stage: Simulation, channel: RpcChannel, desk: StatusHandler) -> None:
    desk.publish(msgspec.structs.replace(stage.state, error="the simulation became unstable"))
    assert FakePage(channel).latest_value("status")["fault"] == "the simulation became unstable"


def test_numbers_are_told_a_few_times_a_second_and_who_came_or_went_at_once(
    stage: Simulation, channel: RpcChannel, desk: StatusHandler
) -> None:
    page = FakePage(channel)
    desk.publish(stage.state)
    before = page.latest_value("status")
    desk.publish(msgspec.structs.replace(stage.state, time_s=1000.0))
    assert page.latest_value("status") == before
    stage.run_on_engine(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    desk.publish(stage.state)
    after = page.latest_value("status")
    assert (after["bodies"], after["report"]) == (before["bodies"] - 1, before["report"])


def test_the_report_is_looked_at_again_only_when_there_is_more_to_report(
    stage: Simulation, channel: RpcChannel, desk: StatusHandler
) -> None:
    desk.publish(stage.state)
    before = FakePage(channel).latest_value("status")
    stage.spawn(World(iri=Iri("urn:more"), bodies=(msgspec.structs.replace(kitchenette().body("Mug"), id="Mug2"),)))
    desk.publish(stage.state)
    after = FakePage(channel).latest_value("status")
    assert (after["report"], after["errors"]) == (before["report"] + 1, before["errors"] + 1)


def test_who_is_connected_is_told_until_they_are_gone(stage: Simulation, channel: RpcChannel) -> None:
    farewell = stage.clients.add_client_source(
        lambda: [ConnectedClient(name="/robot", transport="ROS", activity="calls only")]
    )
    StatusHandler(stage, channel).publish(stage.state)
    assert FakePage(channel).latest_value("status")["clients"] == [
        {"name": "/robot", "transport": "ROS", "activity": "calls only"}
    ]
    farewell()
    farewell()
    assert stage.clients.clients() == ()


def test_the_report_groups_what_was_decided_the_gravest_first(channel: RpcChannel, desk: StatusHandler) -> None:
    report = FakePage(channel).ask("status.report")
    assert report["groups"] == [{"name": "not spawned", "count": 1}, {"name": "hollow", "count": 1}]
    failed, hollow = report["entries"]
    assert (failed["is_error"], failed["text"]) == (True, "Ghost: it has no size")
    assert (hollow["is_error"], hollow["ids"]) == (False, ["Fridge", "Mug"])
    assert report["total"] == 2


def test_what_was_assumed_and_found_about_a_map_is_in_the_report(channel: RpcChannel, tmp_path: Path) -> None:
    text = bundled_kitchen().read_text(encoding="utf-8")
    broken = tmp_path / "kitchen.owl"
    broken.write_text(text.replace("1.000000 0.000000 0.000000 0.000000", "upright", 1), encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load(broken)
    with Simulation(knowledge, NullEngine(), shapes=False) as stage:
        stage.spawn()
        StatusHandler(stage, channel)
        report = FakePage(channel).ask("status.report")
    assumed = [entry["text"] for entry in report["entries"] if entry["group"] == "assumption"]
    assert any("units assumed to m" in text for text in assumed)
    told = [entry for entry in report["entries"] if entry["group"] in {"map warning", "map error"}]
    assert len(told) == len(knowledge.findings()) > 0
    assert any("upright" in entry["text"] for entry in told)
