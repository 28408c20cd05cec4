"""Edits survive the end of the process that made them, and are restored with a question."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.episodes.saved_sessions import SavedSession
from mindstage.files import cache_dir
from mindstage.scene import Body, BodyId, Pose, World, diff
from mindstage.scene.edits import SetLabel
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.page_client import PageClient, RequestFailedError, connect_page_client
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import TIMEOUT_S, wait_until

OpenPage = Callable[..., PageTab]
MUG = BodyId("Mug")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def folders() -> list[Path]:
    return list(cache_dir("autosave").iterdir())


@pytest.fixture
def world() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


def label(simulation: Simulation) -> str | None:
    return simulation.snapshot().body(MUG).label


def offer(client: PageClient) -> Any:
    wait_until(lambda: (client.latest_value("autosave") or {}).get("offer"), "the edits are offered")
    return client.latest["autosave"]["offer"]


def edit_and_stop(edit: Callable[[Simulation], None]) -> Simulation:
    """What a process has left, whose world this is, closed: nothing is asked when a viewer is closed."""
    simulation = Simulation(KnowledgeBase(), MujocoEngine())
    simulation.spawn(kitchenette())
    with Viewer(simulation, port=0, autosave=True):
        edit(simulation)
    return simulation


def many_edits(simulation: Simulation) -> None:
    simulation.edits.set_label(MUG, "first")
    wait_until(lambda: bool(folders()), "a snapshot is written")
    body: Body = simulation.make_body("Cup")
    simulation.spawn(World(iri=body.iri, bodies=(body,)))
    simulation.edits.delete([BodyId("Fridge")])
    simulation.edits.move(MUG, Pose((0.5, 0.25, 1.5)))
    simulation.edits.set_label(MUG, "last")


def test_all_kinds_of_edits_are_restored_and_restoring_can_be_undone(world: Simulation) -> None:
    with edit_and_stop(many_edits) as former, Viewer(world, port=0, autosave=True) as viewer:
        wanted, before = former.snapshot(), world.snapshot()
        with connect_page_client(viewer.url) as client, connect_page_client(viewer.url) as other:
            offered = offer(client)
            assert (offered["last"], offer(other)) == ("label of Mug", offered)
            assert client.ask("autosave.restore")["notes"] == []
            assert diff(wanted, world.snapshot()).identical(1e-6)
            wait_until(lambda: other.latest_value("autosave")["offer"] is None, "nobody else is asked any more")
            toast = next(value for topic, value in other.events if topic == "toast")
            assert toast["text"].startswith("Window 1 restored the unsaved edits")
            with pytest.raises(RequestFailedError, match="another window"):
                other.ask("autosave.restore")
            client.ask("undo")
            assert diff(before, world.snapshot()).identical(0.0)


def test_discarded_edits_are_not_offered_again(world: Simulation) -> None:
    edit_and_stop(lambda simulation: simulation.edits.set_label(MUG, "x")).close()
    with Viewer(world, port=0, autosave=True) as viewer, connect_page_client(viewer.url) as client:
        offer(client)
        client.ask("autosave.discard")
        assert label(world) is None
    assert folders() == []


def test_what_was_saved_as_a_map_is_not_offered() -> None:
    def edit(simulation: Simulation) -> None:
        simulation.edits.set_label(MUG, "x")

    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        with Viewer(simulation, port=0, autosave=True) as viewer, connect_page_client(viewer.url) as client:
            edit(simulation)
            wait_until(lambda: bool(folders()), "a snapshot is written")
            client.ask("save")
            assert folders() == []
            edit(simulation)
            client.ask("save", format="glb")
            wait_until(lambda: bool(folders()), "a picture of the world is no map that could be loaded again")
            client.ask("save")
        assert folders() == []


def test_without_edits_nothing_is_written(world: Simulation) -> None:
    with Viewer(world, port=0, autosave=True):
        world.step(0.5)
    assert folders() == []


def test_a_disk_that_fails_is_reported_and_the_edits_are_written_later(
    world: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mindstage.episodes import saved_sessions
    from mindstage.viewer import autosave

    full = [True]
    write = saved_sessions.atomic_write

    def fail(*args: Any, **options: Any) -> None:
        if full:
            raise OSError(28, "No space left on device")
        write(*args, **options)

    monkeypatch.setattr(saved_sessions, "atomic_write", fail)
    monkeypatch.setattr(autosave, "_RETRY_S", 0.0)
    with Viewer(world, port=0, autosave=True) as viewer, connect_page_client(viewer.url) as client:
        world.edits.set_label(MUG, "kept")
        wait_until(lambda: "No space" in client.latest_value("autosave")["error"], "the page says it")
        full.clear()
        wait_until(lambda: client.latest_value("autosave")["error"] == "", "it works again")
    (folder,) = folders()
    assert SavedSession(folder).present.body(MUG).label == "kept"


def saved_number(folder: Path, id: BodyId = MUG) -> int:
    """The last label of a body in a folder."""
    session = SavedSession(folder)
    text = session.present.body(id).label or "-1"
    for edit in session.edits:
        if isinstance(edit, SetLabel):
            text = edit.text
    return int(text)


def killed_number(
    cache: Path, *, after_s: float, interval_s: float, motion: str
) -> tuple[list[tuple[float, int]], int]:
    """The edits of a process that is killed [s], with their wall times, and the last one that is saved."""
    environment = os.environ | {"MINDSTAGE_CACHE": str(cache)}
    command = [sys.executable, "-m", "tests.viewer.edit_until_killed", str(interval_s), motion]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        first = process.stdout.readline()
        time.sleep(after_s)  # the moment of the kill is what is tried here
    finally:
        process.kill()
    lines = [first, *process.stdout.read().splitlines()]
    process.wait(timeout=TIMEOUT_S)
    made = [(float(line.split()[0]), int(line.split()[1])) for line in lines if len(line.split()) == 2]
    (folder,) = (cache / "autosave").iterdir()
    return made, saved_number(folder, BodyId("Fridge"))


MAX_LOSS_S = 10.0


@pytest.mark.parametrize("motion", ["still", "moving"])
@pytest.mark.parametrize("count", [2, pytest.param(25, marks=pytest.mark.slow)])
def test_a_killed_process_loses_at_most_ten_seconds(cache: Path, count: int, motion: str) -> None:
    times = random.Random(count)
    for number in range(count):
        after_s, interval_s = times.uniform(1.0, 6.0), times.choice([0.0, 0.02, 0.3])
        made, saved = killed_number(cache / str(number), after_s=after_s, interval_s=interval_s, motion=motion)
        assert saved >= 0
        lost = [at_s for at_s, edit in made if edit > saved]
        assert not lost or made[-1][0] - lost[0] <= MAX_LOSS_S, f"{len(lost)} of {len(made)} edits are lost"


def test_a_line_that_was_not_written_completely_ends_the_journal_and_the_snapshot_before_is_kept() -> None:
    def edit(simulation: Simulation) -> None:
        simulation.edits.set_label(MUG, "1")
        wait_until(lambda: bool(folders()) and any(folders()[0].glob("snapshot-*")), "a snapshot is written")
        for text in ("2", "3"):
            simulation.edits.set_label(MUG, text)

    edit_and_stop(edit).close()
    (folder,) = folders()
    assert saved_number(folder) == 3
    (journal,) = folder.glob("journal-*")
    journal.write_bytes(journal.read_bytes()[:-5])
    assert saved_number(folder) == 2
    newest = folder / "snapshot-9.zst"
    newest.write_bytes(b"half of a snapsh")
    assert saved_number(folder) == 2


def test_the_page_asks_and_restores(world: Simulation, open_page: OpenPage) -> None:
    edit_and_stop(lambda simulation: simulation.edits.set_label(MUG, "my mug")).close()
    with Viewer(world, port=0, autosave=True) as viewer:
        tab = open_page(viewer, view=False)
        dialog = tab.page.get_by_role("dialog")
        dialog.get_by_text("before they were saved: 1 edit (label of Mug)").wait_for()
        dialog.get_by_role("button", name="Restore").click()
        tab.page.get_by_text("Restored 1 edit (label of Mug). Undo brings back the world before.").wait_for()
        assert label(world) == "my mug"
