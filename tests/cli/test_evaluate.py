"""`mindstage evaluate`: verdicts as text, JSON and exit codes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.runner import Run, WriteMap, json_output

KITCHEN = "bundled:kitchen"
ON_TABLE = "- {do: place, thing: CoffeeMug, on: table}\n"
DROP = "- {do: move, thing: milk_carton_1, by: [0, 0, 0.3]}\n"


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    return tmp_path / "plan.yaml"


def test_a_plan_that_succeeds_exits_with_0(run: Run, plan: Path) -> None:
    plan.write_text("steps:\n" + ON_TABLE)
    expected = ["--expect", "relation=on", "--expect", "other=table"]
    result = run("evaluate", plan, KITCHEN, "--check", "where_is thing=CoffeeMug_1", *expected)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.startswith("succeeded: 1 of 1 samples succeeded")
    assert "no uncertainty is stated" in result.stderr


def test_a_plan_that_fails_exits_with_1_and_names_the_cause(run: Run, plan: Path) -> None:
    plan.write_text("steps:\n" + DROP)
    result = run(
        "evaluate", plan, KITCHEN, "--samples", 10, "--uncertainty", "milk_carton_1 mass=0.1", "--seed", 3, "--json"
    )
    assert result.exit_code == 1, result.stdout
    content = json_output(result)
    assert (content["outcome"], content["samples"], content["seed"]) == ("failed", 10, 3)
    assert content["first_failure"]["cause"]["thing"] == "milk_carton_1"
    assert content["plan"]["uncertainty"][0]["mass"] == 0.1
    again = run(
        "evaluate", plan, KITCHEN, "--samples", 10, "--uncertainty", "milk_carton_1 mass=0.1", "--seed", 3, "--json"
    )
    assert again.stdout == result.stdout


def test_a_plan_that_does_not_end_in_its_budget_exits_with_3(run: Run, plan: Path) -> None:
    plan.write_text("steps:\n- {do: wait, duration_s: 3600, deadline_s: 3600}\ndeadline_s: 3600\n")
    result = run("evaluate", plan, KITCHEN, "--budget", 1)
    assert result.exit_code == 3
    assert "the budget of 1 s was used up" in result.stdout


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("steps:\n- do: fly\n", [], r"plan.yaml:2: steps[0].do: Invalid value 'fly'"),
        ("steps:\n- do: open\n  thing: frigde_door\n", [], "plan.yaml:3: steps[0].thing: no joint, door or drawer"),
        ("steps: []\n", ["--check", "where_iss"], "no question"),
        ("steps: []\n", ["--expect", "none"], "there is no question"),
        ("steps: []\n", ["--check", "where_is table", "--expect", "nothing"], "it is no answer"),
        ("steps: []\n", ["--uncertainty", "Milk"], "it states no deviation"),
        ("steps: []\n", ["--uncertainty", "Milk height=3"], "'height=3' is no standard deviation"),
        ("steps: []\n", ["--uncertainty", "Milk mass=much"], "mass"),
        ("steps:\n- {do: wait, duration_s: 1}\n", ["--workers", "cloud"], "no executor is named 'cloud'"),
        ("steps:\n- {do: wait, duration_s: 1}\n", ["--workers", "gpu:0"], "worlds 0: it must be"),
        ("steps:\n" + ON_TABLE, ["--workers", "gpu:cpu"], "plan.yaml:2: steps[0]: place: a new body changes"),
    ],
)
def test_bad_input_exits_with_2_and_is_named(run: Run, plan: Path, text: str, options: list[str], message: str) -> None:
    plan.write_text(text)
    result = run("evaluate", plan, KITCHEN, *options)
    assert result.exit_code == 2
    assert message in result.stderr.replace("\n", " ")


def test_ctrl_c_ends_with_what_is_known(plan: Path) -> None:
    plan.write_text("steps:\n- {do: wait, duration_s: 3600, deadline_s: 3600}\ndeadline_s: 3600\n")
    command = [sys.executable, "-m", "mindstage", "evaluate", str(plan), KITCHEN, "--budget", "100", "--json"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        status = Path(f"/proc/{process.pid}/status")
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:  # until the handler of the verb is installed
            caught = next(line for line in status.read_text().splitlines() if line.startswith("SigCgt"))
            if int(caught.split()[1], 16) >> (signal.SIGINT - 1) & 1 and _is_imagining(process.pid):
                break
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60.0)
    assert process.returncode == 130, stderr
    assert '"stopped": "canceled"' in stdout


def _is_imagining(process_id: int) -> bool:
    """Whether the process has used as much time as reading and spawning take."""
    fields = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK") > 4.0


def test_a_picture_shows_where_things_end(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    maps, picture = write_map("mugs.owl", mugs={"X": "0 0 0.5"}), tmp_path / "new" / "ends.png"
    plan = "{steps: [{do: move, thing: X, by: [0, 0, 0.6]}], uncertainty: [{thing: X, position_m: 0.1}]}"
    options = ["--samples", 4, "--check", "individual_of_class cls=Mug", "--expect", "none"]
    options += ["--picture", picture]
    result = run("evaluate", plan, maps, *options, "--json")
    assert result.exit_code == 1, result.output
    content = json_output(result)
    assert (content["outcome"], content["picture"]) == ("failed", str(picture))
    red, green, _ = np.moveaxis(np.asarray(Image.open(picture).convert("RGB")).astype(int), -1, 0)
    assert np.count_nonzero(red > green + 60) > 500


def test_an_unknown_format_of_the_picture_is_an_error_before_the_map_is_read(
    run: Run, plan: Path, tmp_path: Path
) -> None:
    plan.write_text("steps:\n" + ON_TABLE)
    result = run("evaluate", plan, tmp_path / "none.owl", "--picture", tmp_path / "x.gif")
    assert result.exit_code == 2
    assert ".gif is no format of pictures" in " ".join(result.stderr.split())
    assert not result.stdout
