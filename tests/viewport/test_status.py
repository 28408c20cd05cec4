"""What the page says about the engine, its guests, and what was found and assumed about the map."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from mindstage import KnowledgeBase, NullEngine, Stage, World
from mindstage.engines import Ability, Note, NoteKind, SpawnReport, Statistics
from mindstage.engines.contract import Failure
from mindstage.knowledge import bundled_kitchen
from mindstage.stage import Guest
from mindstage.viewport.channel import Channel
from mindstage.viewport.status import StatusDesk
from mindstage.world import NO_FORMS, BodyId, Forms, Iri
from tests.kitchenette import kitchenette
from tests.viewport.pretending import PretendedPage


class BusyEngine(NullEngine):
    """Nothing moves, and it says otherwise; one body it does not take."""

    busy = Statistics(movable=7, awake=3, contacts=12, timestep_s=0.002)

    def statistics(self) -> Statistics:
        return self.busy

    def spawn(self, world: World, *, forms: Forms = NO_FORMS) -> SpawnReport:
        report = super().spawn(world, forms=forms)
        note = Note(NoteKind.HOLLOW, ("Fridge", "Mug"), "Fridge is hollow, so that Mug stands in it")
        return msgspec.structs.replace(report, notes=(note,), failed_bodies=(Failure("Ghost", "it has no size"),))


class SilentEngine(NullEngine):
    abilities = frozenset({Ability.SAVE})


@pytest.fixture
def stage() -> Iterator[Stage]:
    with Stage(KnowledgeBase(), BusyEngine(), shapes=False) as stage:
        stage.spawn(kitchenette())
        yield stage


@pytest.fixture
def channel() -> Iterator[Channel]:
    channel = Channel()
    yield channel
    channel.close()


@pytest.fixture
def desk(stage: Stage, channel: Channel) -> StatusDesk:
    return StatusDesk(stage, channel)


def test_the_engines_figures_are_told(stage: Stage, channel: Channel, desk: StatusDesk) -> None:
    desk.tell(stage.frame)
    told = PretendedPage(channel).sees("status")
    assert (told["engine"], told["bodies"], told["playing"]) == ("null", len(stage.frame.ids), False)
    assert told["statistics"] == {"movable": 7, "awake": 3, "contacts": 12, "timestep_s": 0.002}
    assert (told["errors"], told["warnings"]) == (1, 1)


def test_an_engine_that_says_nothing_is_not_asked(channel: Channel) -> None:
    with Stage(KnowledgeBase(), SilentEngine(), shapes=False) as stage:
        StatusDesk(stage, channel).tell(stage.frame)
        assert stage.frame.statistics is None
    assert PretendedPage(channel).sees("status")["statistics"] is None


def test_a_fault_is_told_to_all(stage: Stage, channel: Channel, desk: StatusDesk) -> None:
    desk.tell(msgspec.structs.replace(stage.frame, fault="the simulation became unstable"))
    assert PretendedPage(channel).sees("status")["fault"] == "the simulation became unstable"


def test_numbers_are_told_a_few_times_a_second_and_who_came_or_went_at_once(
    stage: Stage, channel: Channel, desk: StatusDesk
) -> None:
    page = PretendedPage(channel)
    desk.tell(stage.frame)
    before = page.sees("status")
    desk.tell(msgspec.structs.replace(stage.frame, time_s=1000.0))
    assert page.sees("status") == before
    stage.call(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    desk.tell(stage.frame)
    after = page.sees("status")
    assert (after["bodies"], after["report"]) == (before["bodies"] - 1, before["report"])


def test_the_report_is_looked_at_again_only_when_there_is_more_to_report(
    stage: Stage, channel: Channel, desk: StatusDesk
) -> None:
    desk.tell(stage.frame)
    before = PretendedPage(channel).sees("status")
    stage.spawn(World(iri=Iri("urn:more"), bodies=(msgspec.structs.replace(kitchenette().body("Mug"), id="Mug2"),)))
    desk.tell(stage.frame)
    after = PretendedPage(channel).sees("status")
    assert (after["report"], after["errors"]) == (before["report"] + 1, before["errors"] + 1)


def test_who_is_connected_is_told_until_they_are_gone(stage: Stage, channel: Channel) -> None:
    farewell = stage.company.introduce(lambda: [Guest(name="/robot", transport="ROS", activity="calls only")])
    StatusDesk(stage, channel).tell(stage.frame)
    assert PretendedPage(channel).sees("status")["clients"] == [
        {"name": "/robot", "transport": "ROS", "activity": "calls only"}
    ]
    farewell()
    farewell()
    assert stage.company.guests() == ()


def test_the_report_groups_what_was_decided_the_gravest_first(channel: Channel, desk: StatusDesk) -> None:
    report = PretendedPage(channel).ask("status.report")
    assert report["groups"] == [{"name": "not spawned", "count": 1}, {"name": "hollow", "count": 1}]
    failed, hollow = report["entries"]
    assert (failed["is_error"], failed["text"]) == (True, "Ghost: it has no size")
    assert (hollow["is_error"], hollow["ids"]) == (False, ["Fridge", "Mug"])
    assert report["total"] == 2


def test_what_was_assumed_and_found_about_a_map_is_in_the_report(channel: Channel, tmp_path: Path) -> None:
    text = bundled_kitchen().read_text(encoding="utf-8")
    broken = tmp_path / "kitchen.owl"
    broken.write_text(text.replace("1.000000 0.000000 0.000000 0.000000", "upright", 1), encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load(broken)
    with Stage(knowledge, NullEngine(), shapes=False) as stage:
        stage.spawn()
        StatusDesk(stage, channel)
        report = PretendedPage(channel).ask("status.report")
    assumed = [entry["text"] for entry in report["entries"] if entry["group"] == "assumption"]
    assert any("units assumed to m" in text for text in assumed)
    told = [entry for entry in report["entries"] if entry["group"] in {"map warning", "map error"}]
    assert len(told) == len(knowledge.findings()) > 0
    assert any("upright" in entry["text"] for entry in told)
