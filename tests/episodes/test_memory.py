"""A folder of episodes as one memory: the index follows the files, and answers what each file answers."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest

from mindstage.engines import make_engine
from mindstage.episodes import (
    EpisodeEvent,
    EpisodeEventKind,
    EpisodeFrame,
    FrameRecording,
    Recorder,
    memory,
)
from mindstage.episodes.history import EpisodeHistory
from mindstage.episodes.memory import INDEX_NAME, EpisodeMemory
from mindstage.episodes.recorder import write_episode
from mindstage.errors import EpisodeError, EpisodeFileError, InvalidArgumentError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.history import EventFilter
from mindstage.scene import BodyId
from mindstage.scene.edits import Delete
from mindstage.scene.transforms import pose_array
from mindstage.simulation import Simulation
from tests.episodes.episodes import kitchenette_episode
from tests.kitchenette import MAP, kitchenette

KIND = EpisodeEventKind


def event(kind: EpisodeEventKind, begin_s: float, thing: str = "Mug", **fields: Any) -> EpisodeEvent:
    """An event of one second."""
    times = {"begin_s": begin_s, "end_s": begin_s + 1.0} | fields
    return EpisodeEvent(id=f"{kind.value}_{begin_s:g}", kind=kind, thing=BodyId(thing), **times)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Files contain their events as JSON; the list has the name of each one that is opened."""
    names: list[str] = []

    def open_episode(path: Path, *, name: str | None = None) -> EpisodeHistory:
        names.append(name or path.stem)
        try:
            events = msgspec.json.decode(path.read_bytes(), type=tuple[EpisodeEvent, ...])
        except msgspec.MsgspecError as error:
            raise EpisodeFileError(str(path), cause=str(error)) from error
        world = kitchenette()
        ids, poses = tuple(body.id for body in world.bodies), pose_array(body.pose for body in world.bodies)
        frames = [
            EpisodeFrame(time_s=time_s, structure=world, ids=ids, poses=np.array(poses)) for time_s in (0.0, 20.0)
        ]
        start = 1000.0 + 100.0 * len(path.stem)
        return EpisodeHistory(FrameRecording(frames, events=events, start_unix_s=start), name=name)

    monkeypatch.setattr(memory, "open_episode", open_episode)
    return names


def write(path: Path, *events: EpisodeEvent) -> None:
    """A file of such a kind, with another time of modification than before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.stat().st_mtime_ns if path.exists() else 0
    path.write_bytes(msgspec.json.encode(events))
    os.utime(path, ns=(before + 10**9, before + 10**9))


@pytest.fixture
def folder(tmp_path: Path, opened: list[str]) -> Path:
    runs = tmp_path / "runs"
    write(runs / "a.mcap", event(KIND.PICK_UP, 1.0, agent="hand"), event(KIND.FALL, 3.0))
    write(runs / "day2" / "b.mcap", event(KIND.PICK_UP, 2.0, thing="Drawer"), event(KIND.CONTACT, 5.0, other="Floor"))
    return runs


@pytest.fixture
def knowledge() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        yield knowledge


def test_all_episodes_are_asked_as_one(folder: Path, knowledge: KnowledgeBase) -> None:
    with EpisodeMemory(folder) as runs:
        assert knowledge.add_episode(runs) == ""
        assert list(runs.names()) == ["a", "day2/b"]
        rows = knowledge.ask("occurs", "PickingUp")
        assert [(row.episode, row.thing, row.begin, row.end) for row in rows] == [
            ("a", MAP + "Mug", 1.0, 2.0),
            ("day2/b", MAP + "Drawer", 2.0, 3.0),
        ]
        assert [row.episode for row in knowledge.ask("occurs", episode="day2/b")] == ["day2/b"] * 2
        assert [row.name for row in knowledge.ask("occurs", since=4.5)] == ["Contact_5"]
        assert [row.name for row in knowledge.ask("occurs", at=3.5)] == ["Falling_3"]
        (moved,) = knowledge.ask("who_moved", "Mug")
        assert (moved.agent, moved.how, moved.episode) == ("hand", "PickingUp", "a")


def test_a_class_of_things_stands_for_those_in_the_index(folder: Path, knowledge: KnowledgeBase) -> None:
    with EpisodeMemory(folder) as runs:
        knowledge.add_episode(runs)
        assert [row.thing for row in knowledge.ask("occurs", "PickingUp", "Cup")] == [MAP + "Mug"]
        assert [row.thing for row in knowledge.ask("occurs", "PickingUp", "Drawer")] == [MAP + "Drawer"]
        answers = knowledge.ask("occurs", "PickingUp", "Fridge")
        assert answers.missing[0].reason == "no PickingUp of Fridge happened in 2 episodes"


def test_a_class_of_events_stands_for_its_subclasses(folder: Path, knowledge: KnowledgeBase) -> None:
    with EpisodeMemory(folder) as runs:
        knowledge.add_episode(runs)

        def kinds(cls: str) -> list[str]:
            return sorted({row.kind.rpartition("#")[2] for row in knowledge.ask("occurs", cls)})

        assert kinds("Event") == ["Contact", "Falling", "PickingUp"]
        assert kinds("knowrob:TransportationEvent") == kinds("Action") == ["PickingUp"]
        assert kinds("MotionEvent") == ["Falling"]


def test_nothing_is_opened_for_events_once_it_is_indexed(folder: Path, opened: list[str]) -> None:
    EpisodeMemory(folder).close()
    assert opened == ["a", "day2/b"]
    with EpisodeMemory(folder) as runs, KnowledgeBase() as knowledge:
        knowledge.add_episode(runs)
        assert len(knowledge.ask("occurs")) == 4
        assert opened == ["a", "day2/b"]
        assert len(knowledge.ask("where_is", "Mug", "on", at=1.0, episode="a")) == 1
        assert opened == ["a", "day2/b", "a"]


def test_the_states_of_a_time_span_are_those_of_the_file(tmp_path: Path) -> None:
    write_episode(kitchenette_episode(), tmp_path / "run.mcap", knowledge=KnowledgeBase())
    with EpisodeMemory(tmp_path) as runs:

        def times(begin_s: float | None, end_s: float | None) -> list[float]:
            return [time_s for time_s, _ in runs.history("run").states(begin_s, end_s)]

        every = times(None, None)
        assert len(every) > 5
        assert times(0.31, 0.6) == [0.31, *(time_s for time_s in every if 0.31 < time_s <= 0.6)] != [0.31]
        assert times(None, 0.3) == [time_s for time_s in every if time_s <= 0.3]


def test_a_changed_file_is_indexed_again_and_a_touched_one_is_not(folder: Path, opened: list[str]) -> None:
    with EpisodeMemory(folder) as runs:
        opened.clear()
        write(folder / "a.mcap", event(KIND.OPEN, 7.0))
        os.utime(folder / "day2" / "b.mcap", (time.time(), time.time()))
        assert runs.update() == 1
        assert opened == ["a"]
        assert [each.kind for each in runs.history("a").events()] == ["Opening"]
        assert runs.update() == 0


def test_a_file_with_the_same_size_and_other_content_is_indexed_again(folder: Path, opened: list[str]) -> None:
    with EpisodeMemory(folder) as runs:
        size = (folder / "a.mcap").stat().st_size
        write(folder / "a.mcap", event(KIND.PICK_UP, 4.0, agent="hand"), event(KIND.FALL, 3.0))
        assert (folder / "a.mcap").stat().st_size == size
        assert runs.update() == 1
        assert [each.begin_s for each in runs.history("a").events()] == [3.0, 4.0]


def test_removed_and_added_files_are_followed(folder: Path) -> None:
    with EpisodeMemory(folder) as runs:
        (folder / "a.mcap").unlink()
        write(folder / "ccc.mcap", event(KIND.TIP_OVER, 0.5))
        runs.update()
        assert list(runs.names()) == ["day2/b", "ccc"]
        with pytest.raises(EpisodeError, match="has no episode 'a'"):
            runs.history("a")


def test_a_damaged_file_is_listed_and_the_others_are_read(folder: Path, opened: list[str]) -> None:
    (folder / "bad.mcap").write_bytes(b"MCAP?")
    with EpisodeMemory(folder) as runs:
        assert list(runs.names()) == ["a", "day2/b"]
        ((path, cause),) = runs.problems
        assert path == folder / "bad.mcap"
        assert "bad.mcap" in cause
        opened.clear()
        assert runs.update() == 0
        assert opened == []
        write(folder / "bad.mcap", event(KIND.CLOSE, 1.0))
        assert runs.update() == 1
        assert runs.problems == ()


def test_an_index_of_another_version_is_made_again(folder: Path, opened: list[str]) -> None:
    EpisodeMemory(folder).close()
    with sqlite3.connect(folder / INDEX_NAME) as database:
        database.execute("pragma user_version = 99")
    opened.clear()
    with EpisodeMemory(folder) as runs:
        assert len(opened) == len(runs.names()) == 2


@pytest.mark.parametrize("content", [b"not a database, but text that is long enough to be one" * 20, None])
def test_a_file_in_the_place_of_the_index_that_is_something_else_is_kept(folder: Path, content: bytes | None) -> None:
    index = folder / INDEX_NAME
    if content is None:
        with sqlite3.connect(index) as database:
            database.execute("create table receipts (total integer)")
    else:
        index.write_bytes(content)
    before = index.read_bytes()
    with pytest.raises(EpisodeFileError, match=r"no index|something else"):
        EpisodeMemory(folder)
    assert index.read_bytes() == before


def test_a_folder_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgumentError, match="no folder"):
        EpisodeMemory(tmp_path / "nowhere")


def test_closing_twice_is_harmless(folder: Path) -> None:
    runs = EpisodeMemory(folder)
    runs.close()
    runs.close()


def test_recorded_files_answer_as_each_of_them_does(tmp_path: Path) -> None:
    with KnowledgeBase() as knowledge, Simulation(knowledge, make_engine("null")) as simulation:
        simulation.spawn(kitchenette())
        with Recorder(simulation, tmp_path / "one.mcap"):
            simulation.step(0.2)
            simulation.engine.run(lambda engine: engine.apply(Delete((BodyId("Mug"),))), edits=True)
            simulation.step(0.5)
        shutil.copy(tmp_path / "one.mcap", tmp_path / "two.mcap")
        (tmp_path / "three.mcap").write_bytes((tmp_path / "one.mcap").read_bytes()[:40])
        with EpisodeMemory(tmp_path) as runs:
            assert set(runs.names()) == {"one", "two"}
            assert [problem.path.name for problem in runs.problems] == ["three.mcap"]
            knowledge.add_episode(runs)
            rows = knowledge.ask("changed")
            assert {(row.episode, row.thing, row.change.value) for row in rows} == {
                ("one", MAP + "Mug", "disappeared"),
                ("two", MAP + "Mug", "disappeared"),
            }
            assert {row.episode for row in knowledge.ask("last_seen", "Mug")} == {"one", "two"}


def test_a_file_whose_cause_has_passed_is_read_when_the_memory_is_opened_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = folder / "a.content"

    def read(path: Path, *, name: str | None = None) -> EpisodeHistory:
        if path.stem == "a" and not elsewhere.exists():
            raise EpisodeFileError(str(path), cause="its contents are missing")
        return opens(path, name=name)

    opens = memory.open_episode
    monkeypatch.setattr(memory, "open_episode", read)
    with EpisodeMemory(folder) as runs:
        assert [problem.path.stem for problem in runs.problems] == ["a"]
    elsewhere.touch()
    with EpisodeMemory(folder) as runs:
        assert not runs.problems
        assert list(runs.names()) == ["a", "day2/b"]


_OPEN_AT_ONCE = """
import sys
from mindstage.episodes.memory import EpisodeMemory
from mindstage.knowledge.history import EventFilter
print("ready", flush=True)
sys.stdin.readline()
with EpisodeMemory(sys.argv[1]) as runs:
    print(len(runs.names()), len(list(runs.find_events(EventFilter()))))
"""


def test_processes_that_open_a_new_memory_at_once_have_the_same_index(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    with KnowledgeBase() as knowledge:
        write_episode(kitchenette_episode(), runs / "0.mcap", knowledge=knowledge)
    for number in (1, 2):
        shutil.copy(runs / "0.mcap", runs / f"{number}.mcap")
    command = [sys.executable, "-c", _OPEN_AT_ONCE, str(runs)]
    pipe = subprocess.PIPE
    processes = [subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) for _ in range(4)]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    answers = {process.communicate(timeout=60.0)[0] for process in processes}
    assert [process.returncode for process in processes] == [0] * 4
    with EpisodeMemory(runs) as alone:
        events = len(list(alone.find_events(EventFilter())))
    assert answers == {f"3 {events}\n"}


@pytest.mark.parametrize("damaged_from", [100, 4096])
def test_a_damaged_index_is_refused_with_what_to_do(folder: Path, damaged_from: int) -> None:
    with EpisodeMemory(folder):
        pass
    index = folder / INDEX_NAME
    content = index.read_bytes()
    index.write_bytes(content[:damaged_from] + b"\xff" * (len(content) - damaged_from))
    refused = pytest.raises(EpisodeFileError, match=f"{INDEX_NAME}.*remove it: it will be made again")
    with refused, EpisodeMemory(folder) as runs:
        runs.names()
    index.unlink()
    with EpisodeMemory(folder) as runs:
        assert list(runs.names()) == ["a", "day2/b"]


def test_a_flipped_bit_of_the_index_changes_no_answer(folder: Path) -> None:
    def answers() -> tuple[object, ...]:
        with EpisodeMemory(folder) as runs:
            things = [sorted(runs.history(name).individuals().items()) for name in runs.names()]
            episodes = [
                (each.name, each.begin_s, each.end_s, each.start_unix_s) for each in map(runs.history, runs.names())
            ]
            return tuple(runs.find_events(EventFilter())), things, episodes, runs.problems

    expected = answers()
    index = folder / INDEX_NAME
    content = index.read_bytes()
    positions = [at for at, byte in enumerate(content) if byte]
    random = Random(35)
    messages = set[str]()
    for _ in range(300):
        at, bit = random.choice(positions), random.randrange(8)
        damaged = bytearray(content)
        damaged[at] ^= 1 << bit
        index.write_bytes(damaged)
        try:
            assert answers() == expected, f"bit {bit} of byte {at}"
        except EpisodeFileError as error:
            messages.add(str(error))
    assert any("rows of episode" in each for each in messages)
    assert all(INDEX_NAME in each and "\n" not in each for each in messages)


@pytest.mark.parametrize(
    "sql",
    [
        "update events set end_s = begin_s + 7 where kind = 'Falling'",
        "update events set thing = other where kind = 'Contact'",
        "update episodes set start_unix_s = start_unix_s + 1 where name = 'a'",
        "update things set class = iri where id = 'Mug'",
        "delete from events where kind = 'Falling'",
        "delete from presence where thing = (select max(thing) from presence)",
    ],
)
def test_a_changed_row_of_the_index_is_refused_with_the_episode(folder: Path, sql: str) -> None:
    with EpisodeMemory(folder):
        pass
    with closing(sqlite3.connect(folder / INDEX_NAME)) as database:
        assert database.execute(sql).rowcount
        database.commit()
    with pytest.raises(EpisodeFileError, match=r"rows of episode '(a|day2/b)'.*remove it: it will be made again"):
        EpisodeMemory(folder)
