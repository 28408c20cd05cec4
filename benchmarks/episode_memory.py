"""Memories of episodes: time to index files, and to ask 1,000 episodes, against SQLite scanning the same events."""

from __future__ import annotations

import os
import random
import sqlite3
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from unittest.mock import patch

import mindstage as ms
from benchmarks import Measure
from mindstage.episodes import EpisodeEvent, EpisodeEventKind, EpisodeFrame, FrameRecording, Recorder, memory
from mindstage.episodes.history import EpisodeHistory
from mindstage.episodes.memory import INDEX_NAME, EpisodeMemory
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import World
from mindstage.scene.transforms import pose_array

_EPISODES = int(os.environ.get("MINDSTAGE_EPISODES", "1000"))
_EVENTS = 100
_DURATION_S = 60.0
_FILES = 10
_REPETITIONS = 5


def measure() -> Iterator[Measure]:
    with TemporaryDirectory() as folder:
        yield from _indexing(Path(folder))
    with TemporaryDirectory() as folder:
        yield from _asking(Path(folder))


def _indexing(folder: Path) -> Iterator[Measure]:
    """Files of a minute of the kitchen, in which a drawer and a door are opened."""
    with ms.open("bundled:kitchen") as simulation, Recorder(simulation, folder / "run_0.mcap"):
        for name in ("fridge_door", "drawer_left_1"):
            simulation.joint(name).open()
        simulation.step(max(0.1, _DURATION_S - simulation.state.time_s))
    for number in range(1, _FILES):
        os.link(folder / "run_0.mcap", folder / f"run_{number}.mcap")
    start = time.perf_counter()
    EpisodeMemory(folder).close()
    taken_s = (time.perf_counter() - start) / _FILES
    yield Measure(what="index an episode of a minute of the kitchen", ours=taken_s)


def _asking(folder: Path) -> Iterator[Measure]:
    world = KnowledgeBase()
    world.load(ms.knowledge.bundled_kitchen())
    recordings = _recordings(world.world())
    for number in range(_EPISODES):
        (folder / f"run_{number:04}.mcap").write_bytes(number.to_bytes(4, "big"))
    with patch.object(memory, "open_episode", lambda path, name=None: EpisodeHistory(next(recordings), name=name)):
        EpisodeMemory(folder).close()

    def ask_all() -> None:
        with KnowledgeBase() as knowledge, EpisodeMemory(folder) as runs:
            knowledge.add_episode(runs)
            assert knowledge.ask("occurs", "PickingUp")

    what = f"open {_EPISODES:,} episodes, and ask occurs PickingUp"
    yield Measure(what=what, ours=_median_s(ask_all), at_most=1.0)
    with KnowledgeBase() as knowledge, EpisodeMemory(folder) as runs:
        knowledge.add_episode(runs)
        thing = runs.find_individual("milk_carton_1")
        ours = _median_s(lambda: knowledge.ask("occurs", "PickingUp", thing))
    database = sqlite3.connect(folder / INDEX_NAME)
    scan = "select * from events not indexed where +kind = 'PickingUp' and +thing = ?"
    theirs = _median_s(lambda: database.execute(scan, (thing,)).fetchall())
    database.close()
    peer = f"SQLite {sqlite3.sqlite_version}, a scan"
    yield Measure(what="ask occurs PickingUp of one thing", ours=ours, peer=peer, theirs=theirs, at_most=1.0)


def _recordings(world: World) -> Iterator[FrameRecording]:
    """Episodes of a minute with events at random times."""
    numbers = random.Random(1)
    kinds = list(EpisodeEventKind)
    ids, poses = tuple(body.id for body in world.bodies), pose_array(body.pose for body in world.bodies)
    frames = [EpisodeFrame(time_s=time_s, structure=world, ids=ids, poses=poses) for time_s in (0.0, _DURATION_S)]
    while True:
        events = []
        for number in range(_EVENTS):
            kind, begin_s = numbers.choice(kinds), numbers.uniform(0.0, _DURATION_S - 1.0)
            thing, other = numbers.sample(ids, 2)
            event = EpisodeEvent(
                id=f"{kind.value}_{number}", kind=kind, begin_s=begin_s, end_s=begin_s + 1.0, thing=thing, other=other
            )
            events.append(event)
        yield FrameRecording(frames, events=tuple(events))


def _median_s(function: Callable[[], object]) -> float:
    times = []
    for _ in range(_REPETITIONS):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return median(times)
