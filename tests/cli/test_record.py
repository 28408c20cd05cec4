"""The verbs `record`, `episode info` and `episode repair`."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.episodes.episode import Episode
from tests.cli.runner import Run, WriteMap, json_output


@pytest.fixture
def recorded(run: Run, write_map: WriteMap, tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    result = run("record", write_map(), "-o", path, "--for", 2, "--json")
    assert result.exit_code == 0, result.output
    output = json_output(result)
    assert output["seconds"] == pytest.approx(2.0, abs=0.005)
    assert output["bytes"] == path.stat().st_size
    return path


def test_a_recorded_map_is_an_episode(recorded: Path) -> None:
    with Episode(recorded) as episode:
        assert len(list(episode.frames())) == pytest.approx(61, abs=2)
        assert {body.id for body in episode.spawned[0].bodies} == {"Mug1", "Mug2"}


def test_the_rate_is_that_of_the_option(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    assert run("record", write_map(), "-o", tmp_path / "run.mcap", "--for", 2, "--rate", 5).exit_code == 0
    with Episode(tmp_path / "run.mcap") as episode:
        assert len(list(episode.frames())) == pytest.approx(11, abs=2)


def test_info_describes_a_whole_file_with_exit_code_0(run: Run, recorded: Path) -> None:
    result = run("episode", "info", recorded)
    assert result.exit_code == 0
    assert "Everything in it is readable" in result.stdout
    described = json_output(run("episode", "info", recorded, "--json"))
    assert described["bodies"] == 2
    assert described["losses"] == []
    assert described["end_s"] == pytest.approx(2.0, abs=0.005)


def test_a_damaged_file_has_exit_code_1_and_is_repaired(run: Run, recorded: Path, tmp_path: Path) -> None:
    whole, damaged = recorded.read_bytes(), tmp_path / "damaged.mcap"
    damaged.write_bytes(whole[:-200])  # only a part of the index, which can be read from the chunks
    result = run("episode", "info", damaged)
    assert (result.exit_code, "Everything in it is readable" in result.stdout) == (0, True)
    damaged.write_bytes(whole[: len(whole) * 3 // 5])
    result = run("episode", "info", damaged)
    assert result.exit_code == 1
    assert "lost after" in result.stdout
    repaired = run("episode", "repair", damaged)
    assert repaired.exit_code == 1
    assert (tmp_path / "damaged-repaired.mcap").is_file()
    with Episode(tmp_path / "damaged-repaired.mcap") as after, Episode(recorded) as before:
        assert 0 < len(list(after.frames())) <= len(list(before.frames()))
    assert run("episode", "repair", damaged).exit_code == 2  # it exists
    assert run("episode", "repair", recorded, "-o", tmp_path / "again.mcap").exit_code == 0


def test_bad_arguments_have_exit_code_2(run: Run, write_map: WriteMap, recorded: Path, tmp_path: Path) -> None:
    room = write_map()
    for arguments, cause in (
        (("record", room, "-o", recorded, "--for", 1), "it exists"),
        (("record", room, "-o", tmp_path / "run.bag", "--for", 1), "ends with .mcap"),
        (("record", room, "-o", tmp_path / "b.mcap", "--for", 1, "--rate", 0), "Hz"),
        (("episode", "info", room), "not an MCAP file"),
        (("episode", "info", tmp_path / "missing.mcap"), "No such file"),
    ):
        result = run(*arguments)
        assert result.exit_code == 2, arguments
        assert cause in result.stderr.replace("\n", " ")
