"""Random edits of running worlds: each undo restores the world, and each redo what the edit had made of it.

The number of edits is fixed, and takes about 20 s on two cores; `MINDSTAGE_SOAK_SEED=7` runs others. What fails is
printed as a call of `random_edits.run`, with the shortest list of edits that was found. `make fuzz` runs them for as
long as wanted.
"""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from mindstage.scene.edits import SetLabel
from tests.simulation.random_edits import STARTS, RandomEdits, Step, random_steps, run, shrunk

SEED = int(os.environ.get("MINDSTAGE_SOAK_SEED", "20"))
RUNS = {
    "kitchenette": (range(8), 30),
    "kitchenette with a robot": (range(7, 12), 20),  # of the first twelve, those that execute the most lines
    "loose kitchenette": (range(5), 20),
    "kitchen": (range(2), 8),
}
"""Numbers of runs, and edits in each, by what they begin with."""


def soak(start: str, seed: int, edits: int, folder: Path) -> None:
    steps = random_steps(random.Random(f"{start} {seed}"), edits)
    try:
        run(start, steps, folder)
    except AssertionError:
        run(start, shrunk(start, steps, folder), folder)  # fails again, with fewer edits
        raise


@pytest.mark.parametrize(("start", "number"), [(start, each) for start, (runs, _) in RUNS.items() for each in runs])
def test_random_edits_can_be_undone(start: str, number: int, tmp_path: Path) -> None:
    soak(start, 1000 * SEED + number, RUNS[start][1], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("start", STARTS)
def test_many_random_edits_can_be_undone(start: str, tmp_path: Path) -> None:
    runs, edits = RUNS[start]
    for number in range(len(runs) * 25):
        soak(start, 1000 * SEED + 500 + number, edits, tmp_path)


def test_a_planted_defect_is_found_and_its_edits_are_reduced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forgets(self: RandomEdits, rng: random.Random) -> object:
        body = self._body(rng)
        self.sim.edits.set_label(body.id, f"label {rng.random()}")
        other = next(each for each in self.sim.snapshot().bodies if each.id != body.id)
        self.sim.engine.run(lambda engine: engine.apply(SetLabel(other.id, "not recorded")), edits=True)
        return "planted"

    monkeypatch.setattr(RandomEdits, "edit_rename", forgets)
    steps = (*(Step("move", seed) for seed in range(6)), *(Step("rename", seed) for seed in range(4)))
    with pytest.raises(AssertionError, match="undo of rename"):
        run("kitchenette", steps, tmp_path)
    assert {step.name for step in shrunk("kitchenette", steps, tmp_path)} == {"rename"}
