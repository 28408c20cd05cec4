"""Damaged files: the readable part or a clear error, never a wrong answer."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from mindstage.engines import make_engine
from mindstage.episodes import Recorder, mcap_file, recorder
from mindstage.episodes.episode import Episode
from mindstage.episodes.mcap_file import EpisodeFile, repair
from mindstage.errors import EpisodeError, EpisodeFileError, EpisodeTimeError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, Pose, World
from mindstage.scene.edits import Delete, SetPoses
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette

TRUTH: dict[float, World] = {}
"""The last world at each time."""
EARLIER: dict[float, list[World]] = {}
"""All worlds at each time: edits are recorded when they are made."""
EDITS: list[tuple[float, str]] = []
EVENTS: set[str] = set()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of many small chunks, with several bases and changes of the structure."""
    path = tmp_path_factory.mktemp("episodes") / "whole.mcap"
    with pytest.MonkeyPatch.context() as patch, Simulation(KnowledgeBase(), make_engine("mujoco")) as simulation:
        patch.setattr(recorder, "_CHUNK_FRAMES", 5)
        patch.setattr(recorder, "_BASE_S", 0.7)
        simulation.spawn(kitchenette())
        with Recorder(simulation, path, self_contained=True) as running:
            running.flush()  # attachments are at the begin of long files
            for number in range(12):
                x = 0.2 * number - 1.0
                simulation.engine.run(
                    lambda engine, x=x: engine.apply(SetPoses({BodyId("Mug"): Pose((x, -1.0, 0.6))})), edits=True
                )
                if number == 6:
                    simulation.engine.run(lambda engine: engine.apply(Delete((BodyId("FridgeHandle"),))), edits=True)
                simulation.step(0.3)
    for truth in (TRUTH, EARLIER, EDITS, EVENTS):
        truth.clear()  # of an earlier file: a process can be given tests of this module twice
    with Episode(path) as episode:
        TRUTH.update({frame.time_s: frame.world() for frame in episode.frames()})
        for frame in episode.frames():
            EARLIER.setdefault(frame.time_s, []).append(frame.world())
        EVENTS.update(event.id for event in episode.events())
        EDITS.extend((edit.time_s, edit.kind) for edit in episode.edits())
        assert len(episode._file.chunks) > 20
        assert episode.losses == ()
    return path


def check_against_truth(path: Path) -> int:
    """Every frame and every state that is given is the true one; returns the number of frames."""
    with Episode(path) as episode:
        times = sorted(TRUTH)
        frames = list(episode.frames())
        assert [frame.time_s for frame in frames] == sorted(frame.time_s for frame in frames)
        for frame in frames:
            assert frame.world() in EARLIER[frame.time_s]
        generator = random.Random(1)
        for _ in range(60):
            at = generator.uniform(0.0, times[-1])
            try:
                found = episode.frame_at(at).world()
            except (EpisodeTimeError, EpisodeFileError):
                continue
            assert found == TRUTH[max(each for each in times if each <= at)], at
        assert {(edit.time_s, edit.kind) for edit in episode.edits()} <= set(EDITS)
        if len(frames) < sum(map(len, EARLIER.values())):
            assert episode.losses
        return len(frames)


def damaged(whole: Path, folder: Path, change: Callable[[bytearray], bytes | bytearray | None]) -> Path:
    data = bytearray(whole.read_bytes())
    changed = change(data)
    path = folder / "damaged.mcap"
    path.write_bytes(data if changed is None else changed)
    return path


def test_a_file_cut_off_anywhere_is_read_up_to_there(whole: Path, tmp_path: Path) -> None:
    size = whole.stat().st_size
    with Episode(whole) as episode:
        ends = [chunk.end for chunk in episode._file.chunks]
    readable = []
    for length in (*range(1, size, size // 40), ends[3], ends[3] - 1, size - 1, size - 9):
        path = damaged(whole, tmp_path, lambda data, length=length: data[:length])
        if length < ends[0]:
            with pytest.raises(EpisodeFileError, match=r"damaged\.mcap"):
                Episode(path)
        else:
            readable.append((length, check_against_truth(path)))
    counts = [count for _, count in sorted(readable)]
    assert counts == sorted(counts)
    assert counts[-1] == len(list_frames(whole))


def list_frames(path: Path) -> list[float]:
    with Episode(path) as episode:
        return [frame.time_s for frame in episode.frames()]


@pytest.mark.parametrize("seed", range(60))
def test_a_file_with_flipped_bits_gives_true_states_or_an_error(whole: Path, tmp_path: Path, seed: int) -> None:
    generator = random.Random(seed)

    def flip(data: bytearray) -> None:
        for _ in range(generator.choice((1, 1, 3, 20))):
            data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)

    path = damaged(whole, tmp_path, flip)
    with suppress(EpisodeError):  # any other exception is a failure
        check_against_truth(path)


def check_losses(path: Path) -> float:
    """What is listed as lost is not readable, and all else is, and true; returns the time that is lost [s]."""
    with Episode(path) as episode:
        times = sorted(TRUTH)
        intervals = [
            (0.0 if loss.begin_s is None else loss.begin_s, times[-1] if loss.end_s is None else loss.end_s)
            for loss in episode.losses
            if (loss.begin_s, loss.end_s) != (None, None)
        ]
        assert intervals == sorted(intervals)
        for at in np.arange(0.0, times[-1], 0.011).tolist():
            if any(at == begin for begin, _ in intervals):  # later frames of the same time may be lost
                continue
            is_lost = any(begin < at < end for begin, end in intervals) or at < episode.begin_s
            try:
                found = episode.frame_at(at).world()
            except (EpisodeTimeError, EpisodeFileError):
                assert is_lost, (at, intervals)
            else:
                assert not is_lost, (at, intervals)
                assert found == TRUTH[max(each for each in times if each <= at)], at
        causes = " ".join(loss.cause for loss in episode.losses)
        for name, read in (("knowledge", episode.knowledge), ("geometry", lambda: episode.geometry)):
            if name not in causes:
                read()
        assert not {event.id for event in episode.events()} - EVENTS
        return sum(end - begin for begin, end in intervals)


@pytest.mark.parametrize("seed", range(60))
def test_a_flipped_bit_loses_one_chunk_at_most_and_says_exactly_which(whole: Path, tmp_path: Path, seed: int) -> None:
    generator = random.Random(1000 + seed)

    def flip(data: bytearray) -> None:
        data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)

    path = damaged(whole, tmp_path, flip)
    with Episode(whole) as episode:
        ends = [episode.frame_at(chunk.end_ns / 1e9).time_s for chunk in episode._file.chunks]
    longest = max(np.diff([0.0, *ends])) + 2 / 30
    assert check_losses(path) <= longest


@pytest.mark.parametrize(
    "numbers", [[0], [1], [0, 1], [5, 6], [8, 9, 10], [-1], [-2, -1], list(range(0, 20, 2))], ids=str
)
def test_what_depends_on_lost_chunks_is_listed_too(whole: Path, tmp_path: Path, numbers: list[int]) -> None:
    ranges = chunk_ranges(whole)

    def flip(data: bytearray) -> None:
        for number in numbers:
            data[sum(ranges[number]) // 2] ^= 1

    path = damaged(whole, tmp_path, flip)
    check_losses(path)
    with Episode(path) as episode:
        assert any("lost" in loss.cause for loss in episode.losses)


@pytest.mark.parametrize("seed", range(30))
def test_a_shuffled_file_gives_true_states_or_an_error(whole: Path, tmp_path: Path, seed: int) -> None:
    generator = random.Random(seed)

    def shuffle(data: bytearray) -> bytes:
        count = generator.choice((2, 5, 30))
        cuts = sorted(generator.randrange(len(data)) for _ in range(count))
        parts = [bytes(data[a:b]) for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]
        generator.shuffle(parts)
        return b"".join(parts)

    path = damaged(whole, tmp_path, shuffle)
    with suppress(EpisodeError):  # any other exception is a failure
        check_against_truth(path)


def chunk_ranges(path: Path) -> list[tuple[int, int]]:
    file = EpisodeFile(path)
    try:
        return [(chunk.offset, chunk.end) for chunk in file.chunks]
    finally:
        file.close()


def test_chunks_in_another_order_are_put_in_order(whole: Path, tmp_path: Path) -> None:
    ranges = chunk_ranges(whole)

    def reverse(data: bytearray) -> bytes:
        chunks = [bytes(data[a:b]) for a, b in ranges]
        return bytes(data[: ranges[0][0]]) + b"".join([chunks[0], *reversed(chunks[1:])])

    path = damaged(whole, tmp_path, reverse)
    assert check_against_truth(path) == len(list_frames(whole))


def test_a_damaged_chunk_costs_its_own_frames_and_is_reported(whole: Path, tmp_path: Path) -> None:
    ranges = chunk_ranges(whole)
    number = next(
        number for number in range(4, len(ranges)) if not is_base(whole, number) and not is_base(whole, number + 1)
    )

    def flip(data: bytearray) -> None:
        data[(ranges[number][0] + ranges[number][1]) // 2] ^= 0x10

    path = damaged(whole, tmp_path, flip)
    with Episode(whole) as episode:
        lost = [frame.time_s for frame in episode._read(number).frames]
        before = episode._read(number - 1).times[-1]
        after = episode._read(number + 1).times[0]
    with Episode(path) as episode:
        (loss,) = episode.losses
        assert loss.begin_s == before
        assert loss.cause == "a chunk is lost"
        assert {frame.time_s for frame in episode.frames()} == set(TRUTH) - (set(lost) - {before, after})
        with pytest.raises(EpisodeFileError, match="is lost"):
            episode.frame_at((lost[1] + lost[2]) / 2)
        assert episode.frame_at(after).world() == TRUTH[after]


def is_base(path: Path, number: int) -> bool:
    file = EpisodeFile(path)
    try:
        return file.read(number)[0].base == number
    finally:
        file.close()


def test_chunks_of_another_episode_are_not_mixed_in(whole: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    with Simulation(KnowledgeBase(), make_engine("mujoco")) as simulation:
        simulation.spawn(kitchenette())
        with Recorder(simulation, other):
            simulation.step(1.0)
    path = tmp_path / "damaged.mcap"
    path.write_bytes(whole.read_bytes() + other.read_bytes())
    assert check_against_truth(path) == len(list_frames(whole))
    with Episode(path) as episode:
        assert any("another episode" in loss.cause for loss in episode.losses)


def test_a_damaged_attachment_is_reported_and_never_used(whole: Path, tmp_path: Path) -> None:
    with Episode(whole) as episode:
        copies = episode._file._attachments["knowledge.msgpack.zst"]
        knowledge = episode.knowledge().to_bytes()
    assert len(copies) > 1

    def flip(data: bytearray, count: int) -> None:
        for offset, end in copies[:count]:
            data[(offset + end) // 2] ^= 1

    path = damaged(whole, tmp_path, lambda data: flip(data, 1))
    with Episode(path) as episode:
        assert episode.losses == ()
        assert episode.knowledge().to_bytes() == knowledge
    path = damaged(whole, tmp_path, lambda data: flip(data, len(copies)))
    check_against_truth(path)
    with Episode(path) as episode:
        with pytest.raises(EpisodeFileError, match="knowledge"):
            episode.knowledge()
        assert any("attachment" in loss.cause for loss in episode.losses)


def test_a_repaired_file_is_whole_and_keeps_its_gaps(whole: Path, tmp_path: Path) -> None:
    ranges = chunk_ranges(whole)

    def damage(data: bytearray) -> bytes:
        data[(ranges[8][0] + ranges[8][1]) // 2] ^= 0x10
        return data[: ranges[-3][1] + 5]

    path = damaged(whole, tmp_path, damage)
    losses = repair(path, tmp_path / "repaired.mcap")
    assert len(losses) >= 2
    readable = list_frames(path)
    assert list_frames(tmp_path / "repaired.mcap") == readable
    check_against_truth(tmp_path / "repaired.mcap")
    with Episode(path) as before, Episode(tmp_path / "repaired.mcap") as after:
        assert not after._file.is_scanned
        assert after.losses == losses
        assert after.map_at_begin == before.map_at_begin
        assert after.geometry.keys() == before.geometry.keys()
        assert [edit.kind for edit in after.edits()] == [edit.kind for edit in before.edits()]
    with pytest.raises(EpisodeFileError, match="it exists"):
        repair(path, tmp_path / "repaired.mcap")


def test_repairing_a_whole_file_changes_nothing(whole: Path, tmp_path: Path) -> None:
    assert repair(whole, tmp_path / "repaired.mcap") == ()
    assert list_frames(tmp_path / "repaired.mcap") == list_frames(whole)
    check_against_truth(tmp_path / "repaired.mcap")


def test_other_files_are_refused_with_their_cause(tmp_path: Path) -> None:
    empty, text, foreign = tmp_path / "empty.mcap", tmp_path / "text.mcap", tmp_path / "foreign.mcap"
    empty.write_bytes(b"")
    text.write_text("not a recording " * 50)
    with foreign.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(channel, 0, b"\0\1\0\0" + struct.pack("<I", 3) + b"hi\0", 0)
        writer.finish()
    for path, cause in ((empty, "empty"), (text, "not an MCAP file"), (foreign, "no episode")):
        with pytest.raises(EpisodeFileError, match=cause):
            Episode(path)
    with pytest.raises(EpisodeFileError, match="No such file"):
        Episode(tmp_path / "missing.mcap")
    with pytest.raises(EpisodeFileError, match="directory"):
        Episode(tmp_path)


def test_seeking_reads_two_chunks_whatever_the_length(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Episode(whole) as episode:
        reads: list[int] = []
        read = mcap_file.EpisodeFile.read

        def counted(self: EpisodeFile, number: int) -> object:
            reads.append(number)
            return read(self, number)

        monkeypatch.setattr(mcap_file.EpisodeFile, "read", counted)
        state = episode.frame_at(episode.end_s * 0.8)
        assert np.isfinite(state.poses).all()
        assert len(set(reads)) <= 8
