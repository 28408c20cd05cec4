"""The verbs `episode export` and `episode import`."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.episodes.episode import Episode
from mindstage.episodes.neem import write_neem
from mindstage.episodes.semlog import read_semlog
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from tests.cli.runner import Run, json_output
from tests.episodes.bag_files import Transform, matrix, write_bag
from tests.episodes.episodes import EVENTS, kitchenette_episode
from tests.episodes.test_neem import write_knowrob_neem
from tests.kitchenette import kitchenette


@pytest.fixture
def kitchen_map(tmp_path: Path) -> Path:
    save_map(kitchenette(), tmp_path / "map.owl")
    return tmp_path / "map.owl"


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    messages = [Transform(step / 10, "map", "Mug", matrix([2.0, 0.01 * step, 0.85])) for step in range(11)]
    messages += [Transform(step / 10, "map", "cup_2", matrix([0.0, 0.0, 0.0])) for step in range(11)]
    return write_bag(tmp_path, "ros1", messages, start_s=100.0)


@pytest.fixture
def episode(run: Run, bag: Path, kitchen_map: Path, tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    result = run("episode", "import", bag, "--map", kitchen_map, "-o", path)
    assert result.exit_code == 0, result.output
    return path


def test_a_bag_becomes_an_episode_of_the_map(run: Run, bag: Path, kitchen_map: Path, tmp_path: Path) -> None:
    result = run("episode", "import", bag, "--map", kitchen_map, "-o", tmp_path / "run.mcap", "--json")
    assert result.exit_code == 0
    output = json_output(result)
    assert output["bodies"] == {"Mug": "Mug"}
    assert output["unmatched_frames"] == ["cup_2"]
    assert output["duration_s"] == pytest.approx(1.0)
    with Episode(tmp_path / "run.mcap") as episode:
        assert episode.frame_at(1.0).world().body("Mug").pose.position == pytest.approx((2.0, 0.1, 0.85))
        assert set(episode.geometry) >= {"Mug", "Fridge"}


def test_what_is_no_body_of_the_map_is_printed(run: Run, bag: Path, kitchen_map: Path, tmp_path: Path) -> None:
    result = run("episode", "import", bag, "--map", kitchen_map, "-o", tmp_path / "run.mcap")
    assert "cup_2: no body of the map" in result.stderr
    assert "1.0 s" in result.stdout


def test_a_frame_is_the_body_that_the_option_names(run: Run, bag: Path, kitchen_map: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    result = run("episode", "import", bag, "--map", kitchen_map, "-o", out, "--body", "cup_2=Drawer", "--json")
    assert json_output(result)["bodies"] == {"Mug": "Mug", "cup_2": "Drawer"}
    result = run("episode", "import", bag, "--map", kitchen_map, "-o", out, "--body", "cup_2")
    assert (result.exit_code, "FRAME=ID" in result.stderr) == (2, True)


def test_a_bag_of_something_else_has_exit_code_1(run: Run, kitchen_map: Path, tmp_path: Path) -> None:
    other = write_bag(tmp_path, "mcap", [Transform(0.0, "map", "rover", matrix([0, 0, 0]))], name="other")
    result = run("episode", "import", other, "--map", kitchen_map, "-o", tmp_path / "run.mcap")
    assert result.exit_code == 1
    assert "nothing was written" in result.stdout
    assert not (tmp_path / "run.mcap").exists()


def test_a_bag_without_a_map_is_an_error(run: Run, bag: Path, tmp_path: Path) -> None:
    result = run("episode", "import", bag, "-o", tmp_path / "run.mcap")
    assert (result.exit_code, "--map" in result.stderr) == (2, True)


def test_an_episode_is_exported_and_imported_as_a_neem(run: Run, episode: Path, tmp_path: Path) -> None:
    assert run("episode", "export", episode, "-o", tmp_path / "run.neem").exit_code == 0
    assert {path.name for path in (tmp_path / "run.neem").iterdir()} == {"ontology.ttl", "tf.json", "map.owl"}
    again = tmp_path / "again.mcap"
    assert run("episode", "import", tmp_path / "run.neem", "-o", again).exit_code == 0
    with Episode(episode) as one, Episode(again) as other:
        assert other.end_s == pytest.approx(one.end_s)
        for time in (0.0, 0.45, 1.0):
            assert other.frame_at(time).poses == pytest.approx(one.frame_at(time).poses, abs=1e-9)


@pytest.mark.parametrize("name", ["run.owl", "run.csv", "run.html"])
def test_the_suffix_is_the_format(name: str, run: Run, episode: Path, tmp_path: Path) -> None:
    result = run("episode", "export", episode, "-o", tmp_path / name, "--json")
    assert result.exit_code == 0
    files = json_output(result)["files"]
    assert files[0] == str(tmp_path / name)
    assert all(Path(file).stat().st_size for file in files)


def test_events_are_exported_to_semlog(run: Run, episode: Path, tmp_path: Path) -> None:
    run("episode", "export", episode, "-o", tmp_path / "run_ED.owl")
    with Episode(episode) as recorded:
        kinds = {event.kind for event in recorded.events()}
    assert {event.kind for event in read_semlog(tmp_path / "run_ED.owl").events} <= kinds


def test_a_suffix_of_no_format_is_an_error(run: Run, episode: Path, tmp_path: Path) -> None:
    result = run("episode", "export", episode, "-o", tmp_path / "run.docx")
    assert result.exit_code == 2
    assert ".neem" in result.stderr


def test_only_a_dataset_has_several_episodes(run: Run, episode: Path, tmp_path: Path) -> None:
    result = run("episode", "export", episode, episode, "-o", tmp_path / "run.csv")
    assert (result.exit_code, "one episode" in result.stderr) == (2, True)


def test_the_events_of_a_neem_are_those_of_the_episode(run: Run, tmp_path: Path) -> None:
    write_neem(kitchenette_episode(), tmp_path / "run.neem")
    assert run("episode", "import", tmp_path / "run.neem", "-o", tmp_path / "run.mcap").exit_code == 0
    with Episode(tmp_path / "run.mcap") as episode:
        assert [(each.id, each.kind, each.thing, each.agent) for each in episode.events()] == [
            (each.id, each.kind, each.thing, each.agent) for each in EVENTS
        ]


def test_a_dump_of_knowrobs_database_is_asked_and_replayed_on_its_map(
    run: Run, kitchen_map: Path, tmp_path: Path
) -> None:
    dump = tmp_path / "dump"
    write_knowrob_neem(dump, ending=".bson")
    result = run("episode", "import", dump, "-o", tmp_path / "run.mcap")
    assert (result.exit_code, "--map" in result.stderr) == (2, True)
    assert run("episode", "import", dump, "--map", kitchen_map, "-o", tmp_path / "run.mcap").exit_code == 0
    asked = run("ask", "occurs", "--episode", tmp_path / "run.mcap", "--json")
    (row,) = json_output(asked)["answers"]
    assert (row["kind"].rpartition("#")[2], row["thing"].rpartition("#")[2]) == ("PickingUp", "Mug")
    result = run("replay", dump, "--map", kitchen_map, "--at", 2, "-o", tmp_path / "at2.owl")
    assert result.exit_code == 0
    with KnowledgeBase() as knowledge:
        knowledge.load(tmp_path / "at2.owl")
        assert knowledge.world().body("Mug").pose.position == pytest.approx((1.7, 0.0, 2.0))
