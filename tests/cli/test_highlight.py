"""The verb `ask` with `--highlight`."""

from __future__ import annotations

import json
import subprocess
import sys
from urllib.request import urlopen

import pytest

from tests.cli.runner import Run, WriteMap, json_output

KITCHEN = ("--map", "bundled:kitchen", "--engine", "null")
MINDSTAGE = [sys.executable, "-m", "mindstage"]


def test_the_json_lists_highlighted_bodies_and_items_without_a_body(run: Run) -> None:
    command = ("ask", "handle_of", "fridge_door", *KITCHEN, "--highlight", "red", "--no-viewer", "--json")
    result = run(*command)
    assert result.exit_code == 0
    answer = json_output(result)
    assert (answer["color"], answer["highlighted"], answer["not_highlighted"]) == ("red", ["fridge_door_handle"], [])
    assert (answer["engine"], answer["spawn"]["ok"]) == ("null", True)
    assert answer["answers"][0]["id"] == "fridge_door_handle"
    answer = json_output(
        run("ask", "storage_place", "CowsMilk", *KITCHEN, "--highlight", "1,0,0", "--no-viewer", "--json")
    )
    assert (answer["color"], answer["highlighted"]) == ("#ff0000", [])
    assert answer["not_highlighted"] == [{"id": "Refrigerator", "reason": "it is a class, which has no body"}]


def test_items_without_a_body_are_printed(run: Run) -> None:
    result = run("ask", "storage_place", "CowsMilk", *KITCHEN, "--highlight", "blue", "--no-viewer")
    assert result.exit_code == 0
    assert "Refrigerator" in result.stdout
    assert "not highlighted: Refrigerator: it is a class" in result.stderr


def test_the_question_is_about_the_running_simulation(run: Run) -> None:
    command = ("ask", "where_is", "plate_3", "on", "--map", "bundled:kitchen", "--highlight", "green", "--no-viewer")
    (answer,) = json_output(run(*command, "--json", "--why"))["answers"]
    assert (answer["id"], answer["source"]) == ("table", "mujoco")
    assert answer["why"][-1] == "as mujoco has it now"


def test_no_color_highlights_nothing(run: Run) -> None:
    answer = json_output(
        run("ask", "handle_of", "fridge_door", *KITCHEN, "--highlight", "none", "--no-viewer", "--json")
    )
    assert (answer["color"], answer["highlighted"]) == ("none", [])


def test_without_an_answer_no_page_is_served_and_the_exit_code_is_1(run: Run) -> None:
    result = run("ask", "handle_of", "fridge_door_handle", *KITCHEN, "--highlight", "red", "--json")
    assert result.exit_code == 1
    answer = json_output(result)
    assert answer["missing"]
    assert answer["highlighted"] == []
    assert "url" not in answer


def test_of_several_maps_the_one_in_the_arguments_is_spawned(run: Run, write_map: WriteMap) -> None:
    first, second = write_map("a.owl", maps=["A"], mugs={"X": "0 0 0"}), write_map("b.owl", maps=["B"])
    both = ("--map", first, "--map", second, "--engine", "null", "--highlight", "red", "--no-viewer", "--json")
    assert json_output(run("ask", "everything_in_map", "map=A", *both))["highlighted"] == ["X"]
    assert json_output(run("ask", "everything_in_map", *both, "--map-name", "B"))["highlighted"] == ["Mug1", "Mug2"]
    result = run("ask", "everything_in_map", *both)
    assert result.exit_code == 2
    assert "with --map-name" in result.stderr


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--highlight", "purple"), "no color 'purple'; there is black, red, blue, green, yellow, none, #rrggbb"),
        (("--highlight", "yelow"), "near: 'yellow'"),
        (("--highlight", "red", "--engine", "foo"), "there is no engine of that name"),
        (("--port", "0"), "--port: it requires --highlight; give --highlight COLOR too"),
        (("--engine", "null"), "--engine: it requires --highlight"),
        (("--for", "1"), "--for: it requires --highlight"),
        (("--no-viewer",), "--no-viewer: it requires --highlight"),
        (("--map-name", "kitchen"), "--map-name: it requires --highlight"),
    ],
)
def test_invalid_options_exit_2_before_the_map_is_read(args: tuple[str, ...], message: str, run: Run) -> None:
    result = run("ask", "handle_of", "--map", "nowhere.owl", *args)
    assert result.exit_code == 2
    assert message in result.stderr
    assert message in json_output(run("ask", "handle_of", "--map", "nowhere.owl", *args, "--json"))["error"]["message"]


def test_the_page_is_served_for_the_given_duration(write_map: WriteMap) -> None:
    map = ("--map", str(write_map()), "--engine", "null", "--port", "0", "--highlight", "red", "--for")
    result = subprocess.run(
        [*MINDSTAGE, "ask", "everything_in_map", *map, "0.5", "--json"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert result.returncode == 0, result.stderr
    answer = json.loads(result.stdout)
    assert answer["url"].startswith("http://127.0.0.1:")
    assert answer["highlighted"] == ["Mug1", "Mug2"]
    command = [*MINDSTAGE, "ask", "everything_in_map", *map, "20"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        url = next(line.split()[-1] for line in process.stdout if line.startswith("2 highlighted at http"))
        with urlopen(url, timeout=30) as page:
            assert b"<html" in page.read().lower()
        process.terminate()


def test_a_question_without_highlight_loads_no_engine(write_map: WriteMap) -> None:
    code = (
        "import sys; from mindstage.cli.app import app\n"
        f"try: app(['ask', 'maps', '--map', {str(write_map())!r}])\n"
        "except SystemExit as end: assert end.code == 0, end.code\n"
        "print(sorted({'mujoco', 'viser', 'websockets'} & sys.modules.keys()))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert result.stdout.splitlines()[-1] == "[]", result.stderr
