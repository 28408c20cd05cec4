"""The options of `ask`, `sparql` and `prolog` about episodes."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.cli.options import ExitCode
from mindstage.engines import make_engine
from mindstage.episodes import Recorder
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation
from tests.cli.runner import Run, json_output
from tests.kitchenette import MAP, kitchenette


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded episode: the mug is on the cupboard, and from 0.5 s on on the fridge."""
    folder = tmp_path_factory.mktemp("episodes")
    path = folder / "kitchenette.owl"
    path.write_text(write_map(kitchenette()))
    runs = folder / "runs"
    runs.mkdir()
    with KnowledgeBase() as knowledge, Simulation(knowledge, make_engine("null")) as simulation:
        knowledge.load(path)
        simulation.spawn()
        with Recorder(simulation, runs / "run.mcap"):
            simulation.step(0.5)
            pose = Pose((2.0, 1.0, 1.85))
            simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): pose})), edits=True)
            simulation.step(0.5)
    return folder


@pytest.fixture
def episode(folder: Path) -> tuple[str, str]:
    return ("--episode", str(folder / "runs" / "run.mcap"))


def places(run: Run, *args: str) -> list[str]:
    return [each["other"].rpartition("#")[2] for each in json_output(run("ask", *args, "--json"))["answers"]]


def test_a_question_is_about_a_time_with_the_maps_of_the_episode(run: Run, episode: tuple[str, str]) -> None:
    question = ("where_is", "Mug", "on", *episode)
    assert places(run, *question, "--at", "0.2") == ["Cupboard"]
    assert places(run, *question, "--at", "0.8") == ["Fridge"]
    assert places(run, *question) == ["Fridge"]
    assert places(run, "where is the mug?", *episode, "--at", "0.2") != []


def test_other_maps_can_be_given(run: Run, episode: tuple[str, str], folder: Path) -> None:
    own = ("--map", str(folder / "kitchenette.owl"))
    assert places(run, "where_is", "Mug", "on", *episode, *own, "--at", "0.2") == ["Cupboard"]


def test_answers_in_an_interval_have_their_own_interval(run: Run, episode: tuple[str, str]) -> None:
    result = run("ask", "where_is", "Mug", "on", *episode, "--during", "0.2..0.9", "--json")
    rows = [(each["other"], each["begin"], each["end"]) for each in json_output(result)["answers"]]
    assert rows == [(MAP + "Cupboard", 0.2, 0.5), (MAP + "Fridge", 0.5, 0.9)]
    since = run("ask", "where_is", "Mug", "on", *episode, "--since", "0.6")
    assert "Fridge" in since.stdout
    assert "Cupboard" not in since.stdout


def test_a_folder_is_asked_as_one(run: Run, folder: Path) -> None:
    runs = ("--episodes", str(folder / "runs"))
    (row,) = json_output(run("ask", "changed", *runs, "--json"))["answers"]
    assert (row["thing"], row["change"], row["episode"]) == (MAP + "Mug", "moved", "run")
    assert places(run, "where_is", f"{MAP}Mug", "on", *runs, "--episode", "run", "--at", "0.2") == ["Cupboard"]
    (folder / "runs" / "bad.mcap").write_bytes(b"x" * 100)
    try:
        result = run("ask", "changed", *runs)
        assert result.exit_code == ExitCode.OK
        assert "left out: " in result.output
        assert "bad.mcap" in result.output
    finally:
        (folder / "runs" / "bad.mcap").unlink()


def test_sparql_has_the_events_and_the_state_of_a_time(run: Run, episode: tuple[str, str]) -> None:
    query = f"SELECT ?on FROM <urn:mindstage:present> {{ <{MAP}Mug> knowrob:on-Physical ?on }}"
    for at, place in (("0.2", "Cupboard"), ("0.8", "Fridge")):
        (row,) = json_output(run("sparql", query, *episode, "--at", at, "--json"))["rows"]
        assert row["on"]["value"] == MAP + place
    result = run("sparql", "ASK { GRAPH <urn:mindstage:episode:run> { ?e a soma:Episode } }", *episode)
    assert result.exit_code == ExitCode.OK


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("--at", "9"), "it lasts from 0 to 1 s"),
        (("--during", "1"), "no interval"),
        (("--at", "0.5", "--since", "0.2"), "together with an interval"),
        (("--at", "0.5", "--highlight", "red"), "--highlight"),
    ],
)
def test_wrong_times_are_refused(run: Run, episode: tuple[str, str], args: tuple[str, ...], words: str) -> None:
    result = run("ask", "where_is", "Mug", *episode, *args)
    assert result.exit_code == ExitCode.ERROR
    assert words in result.output


def test_a_time_without_an_episode_is_refused(run: Run) -> None:
    result = run("ask", "where_is", "--at", "1", "--map", "bundled:kitchen")
    assert result.exit_code == ExitCode.ERROR
    assert "there is no episode to ask about" in result.output


def test_a_file_that_is_no_episode_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "notes.mcap").write_text("milk, bread")
    result = run("ask", "changed", "--episode", str(tmp_path / "notes.mcap"))
    assert result.exit_code == ExitCode.ERROR
    assert "notes.mcap" in result.output
    assert run("ask", "changed", "--episodes", str(tmp_path / "none")).exit_code == ExitCode.ERROR
