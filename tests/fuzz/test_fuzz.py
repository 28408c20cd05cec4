"""The fuzzer itself: it finds a planted defect, keeps inputs that reach new lines, and survives hangs and crashes."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import coverage
import pytest

from mindstage.scene.colors import parse_color
from tests.fuzz.targets import TARGETS, FuzzTarget
from tests.fuzz.worker import PACKAGE, FuzzLoop

SLOW_SEEDS = ("page", "rosbridge")


class PlantedDefect(FuzzTarget):
    """Fails on inputs that contain an angle bracket, which the corruption inserts sooner or later."""

    def seeds(self) -> Iterator[bytes]:
        yield b"red"

    def process(self, data: bytes) -> None:
        parse_color("red")
        if b"<" in data:
            raise ZeroDivisionError("planted")
        if data == b"new":
            parse_color("0.1,0.2,0.3")

    def random_input(self, chooser: random.Random) -> bytes:
        return b"new"


def fuzz(target: FuzzTarget, folder: Path, inputs: int) -> tuple[FuzzLoop, list[dict[str, Any]]]:
    measurement = coverage.Coverage(data_file=None, source=[str(PACKAGE)], config_file=False)
    messages: list[dict[str, Any]] = []
    measurement.start()
    try:
        loop = FuzzLoop(target, measurement, messages.append, corpus=folder / "corpus", folder=folder, seed=1)
        loop.run(60.0, max_inputs=inputs)
    finally:
        measurement.stop()
    return loop, messages


def test_a_planted_defect_is_found_and_reported_once(tmp_path: Path) -> None:
    _, messages = fuzz(PlantedDefect(tmp_path), tmp_path, inputs=300)
    (found,) = [message for message in messages if "defect" in message]
    assert "ZeroDivisionError: planted" in found["traceback"]
    assert b"<" in bytes.fromhex(found["input"])


def test_an_input_that_reaches_new_lines_is_kept_for_the_next_run(tmp_path: Path) -> None:
    loop, _ = fuzz(PlantedDefect(tmp_path), tmp_path, inputs=100)
    assert loop.corpus[:2] == [b"red", b"new"]
    assert {path.read_bytes() for path in (tmp_path / "corpus").iterdir()} == set(loop.corpus)


@pytest.mark.parametrize("name", TARGETS)
def test_the_valid_inputs_of_a_target_are_processed(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if name == "prolog":
        request.getfixturevalue("swipl")
    target = TARGETS[name](tmp_path)
    try:
        seeds = list(target.seeds())
        assert seeds
        for data in seeds[:: 20 if name in SLOW_SEEDS else 1]:
            target.process(data)
    finally:
        target.close()
