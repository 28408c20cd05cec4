"""The Status panel: engine statistics, connected clients, and the report about the map."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation, World
from mindstage.engines import (
    Capability,
    EngineStats,
    SpawnNote,
    SpawnNoteKind,
)
from mindstage.engines.base import Applied, SpawnFailure
from mindstage.maps import bundled_kitchen
from mindstage.scene import BodyId, Iri
from mindstage.scene.edits import Delete, Edit
from mindstage.simulation import ConnectedClient
from mindstage.viewer.inspector import StatusHandler
from mindstage.viewer.server import RpcChannel
from tests.kitchenette import kitchenette
from tests.viewer.fake_page import FakePage


class BusyEngine(NullEngine):
    """Reports made-up statistics, and a body that could not be spawned."""

    busy = EngineStats(movable=7, awake=3, contacts=12, timestep_s=0.002)

    def stats(self) -> EngineStats:
        return self.busy

    def apply(self, edit: Edit) -> Applied:
        applied = super().apply(edit)
        note = SpawnNote(SpawnNoteKind.HOLLOW, ("Fridge", "Mug"), "Fridge is hollow, so that Mug stands in it")
        failed = (SpawnFailure("Ghost", "it has no size"),)
        report = msgspec.structs.replace(applied.report, notes=(note,), failed_bodies=failed)
        return msgspec.structs.replace(applied, report=report)


class SilentEngine(NullEngine):
    capabilities = frozenset({Capability.SAVE})


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), BusyEngine(), primitive_shapes=True) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def channel() -> Iterator[RpcChannel]:
    channel = RpcChannel()
    yield channel
    channel.close()


@pytest.fixture
def handler(simulation: Simulation, channel: RpcChannel) -> StatusHandler:
    return StatusHandler(simulation, channel)


def test_the_status_contains_the_statistics_of_the_engine(
    simulation: Simulation, channel: RpcChannel, handler: StatusHandler
) -> None:
    handler.publish(simulation.state)
    status = FakePage(channel).latest_value("status")
    assert (status["engine"], status["bodies"], status["playing"]) == ("null", len(simulation.state.ids), False)
    assert status["statistics"] == {"movable": 7, "awake": 3, "contacts": 12, "timestep_s": 0.002}
    assert (status["errors"], status["warnings"]) == (1, 1)


def test_an_engine_without_statistics_is_not_queried(channel: RpcChannel) -> None:
    with Simulation(KnowledgeBase(), SilentEngine(), primitive_shapes=True) as simulation:
        StatusHandler(simulation, channel).publish(simulation.state)
        assert simulation.state.stats is None
    assert FakePage(channel).latest_value("status")["statistics"] is None


def test_a_failure_is_published(simulation: Simulation, channel: RpcChannel, handler: StatusHandler) -> None:
    handler.publish(msgspec.structs.replace(simulation.state, error="the simulation became unstable"))
    assert FakePage(channel).latest_value("status")["fault"] == "the simulation became unstable"


def test_the_status_is_throttled_except_for_added_or_removed_bodies(
    simulation: Simulation, channel: RpcChannel, handler: StatusHandler
) -> None:
    page = FakePage(channel)
    handler.publish(simulation.state)
    before = page.latest_value("status")
    handler.publish(msgspec.structs.replace(simulation.state, time_s=1000.0))
    assert page.latest_value("status") == before
    simulation.engine.run(lambda engine: engine.apply(Delete((BodyId("Mug"),))), edits=True)
    handler.publish(simulation.state)
    after = page.latest_value("status")
    assert (after["bodies"], after["report"]) == (before["bodies"] - 1, before["report"])


def test_the_report_is_recomputed_only_after_changes(
    simulation: Simulation, channel: RpcChannel, handler: StatusHandler
) -> None:
    handler.publish(simulation.state)
    before = FakePage(channel).latest_value("status")
    simulation.spawn(
        World(iri=Iri("urn:more"), bodies=(msgspec.structs.replace(kitchenette().body("Mug"), id="Mug2"),))
    )
    handler.publish(simulation.state)
    after = FakePage(channel).latest_value("status")
    assert (after["report"], after["errors"]) == (before["report"] + 1, before["errors"] + 1)


def test_connected_clients_are_listed_until_removed(simulation: Simulation, channel: RpcChannel) -> None:
    remove_source = simulation.clients.add_client_source(
        lambda: [ConnectedClient(name="/robot", transport="ROS", activity="calls only")]
    )
    StatusHandler(simulation, channel).publish(simulation.state)
    assert FakePage(channel).latest_value("status")["clients"] == [
        {"name": "/robot", "transport": "ROS", "activity": "calls only"}
    ]
    remove_source()
    remove_source()
    assert simulation.clients.clients() == ()


def test_the_report_is_grouped_errors_first(channel: RpcChannel, handler: StatusHandler) -> None:
    report = FakePage(channel).ask("status.report")
    assert report["groups"] == [{"name": "not spawned", "count": 1}, {"name": "hollow", "count": 1}]
    failed, hollow = report["entries"]
    assert (failed["is_error"], failed["text"]) == (True, "Ghost: it has no size")
    assert (hollow["is_error"], hollow["ids"]) == (False, ["Fridge", "Mug"])
    assert report["total"] == 2


def test_the_report_contains_assumptions_and_findings_about_maps(channel: RpcChannel, tmp_path: Path) -> None:
    text = bundled_kitchen().read_text(encoding="utf-8")
    broken = tmp_path / "kitchen.owl"
    broken.write_text(text.replace("1.000000 0.000000 0.000000 0.000000", "upright", 1), encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load(broken)
    with Simulation(knowledge, NullEngine(), primitive_shapes=True) as simulation:
        simulation.spawn()
        StatusHandler(simulation, channel)
        report = FakePage(channel).ask("status.report")
    assumed = [entry["text"] for entry in report["entries"] if entry["group"] == "assumption"]
    assert any("units assumed to m" in text for text in assumed)
    status = [entry for entry in report["entries"] if entry["group"] in {"map warning", "map error"}]
    assert len(status) == len(knowledge.findings()) > 0
    assert any("upright" in entry["text"] for entry in status)
