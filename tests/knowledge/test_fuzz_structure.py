"""Small maps of each dialect with statements that make no sense: read and written in time, and nothing is made up.

Hypothesis makes them in rounds of a few, each from its number, and cuts a finding down to the statements that matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pyoxigraph as ox
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from tests.knowledge.fuzz_budget import keep, rounds
from tests.knowledge.fuzz_maps import LINKED, MAPS, Spoilt, spoilt, spoilt_robots
from tests.knowledge.fuzz_watch import VERBS, Watch
from tests.knowledge.small_robot import KITCHEN

EXAMPLES = 10
"""Of one round."""


@pytest.fixture(scope="module")
def watch(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watch]:
    with Watch(tmp_path_factory.mktemp("worker")) as watch:
        yield watch


def fuzz(inputs: SearchStrategy[Any], check: Callable[[Any, str], None]) -> None:
    """Checks as many inputs as there is time for."""
    few = settings(
        max_examples=EXAMPLES,
        database=None,
        print_blob=False,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
    )

    def once(made: Any, verb: str) -> None:
        check(made, verb)

    for number in rounds():
        seed(number)(few(given(made=inputs, verb=st.sampled_from(VERBS))(once)))()


def read(watch: Watch, file: Path, verb: str, called: str, robots: Sequence[Path] = ()) -> None:
    answer = watch.read(file, robots=robots, verb=verb)
    if answer.defect:
        raise AssertionError(f"{keep(file, called=called)}: {answer.defect}")


@pytest.mark.parametrize("dialect", MAPS)
def test_a_map_of_any_statements_is_read_or_refused(dialect: str, tmp_path: Path, watch: Watch) -> None:
    robots = []
    if MAPS[dialect] is LINKED:
        robots = [tmp_path / "kitchen.urdf"]
        robots[0].write_text(KITCHEN, encoding="utf-8")
    file = tmp_path / "map.ttl"

    def check(made: Spoilt, verb: str) -> None:
        ox.serialize(made.quads, file, ox.RdfFormat.TURTLE)
        read(watch, file, verb, f"any {dialect}", robots)

    fuzz(spoilt(dialect), check)


def test_a_description_of_any_elements_is_read_or_refused(tmp_path: Path, watch: Watch) -> None:
    file = tmp_path / "kitchen.urdf"

    def check(text: str, verb: str) -> None:
        file.write_text(text, encoding="utf-8")
        read(watch, file, verb, "any robot")

    fuzz(spoilt_robots(), check)


def test_a_map_finds_any_description_beside_it(tmp_path: Path, watch: Watch) -> None:
    file, robot = tmp_path / "linked.ttl", tmp_path / "kitchen.urdf"
    file.write_text(LINKED, encoding="utf-8")

    def check(text: str, verb: str) -> None:
        robot.write_text(text, encoding="utf-8")
        answer = watch.read(file, robots=[robot], verb=verb)
        if answer.defect:
            raise AssertionError(f"{keep(robot, called='any robot beside a map')}: {answer.defect}")

    fuzz(spoilt_robots(), check)


@pytest.mark.parametrize("dialect", MAPS)
def test_what_is_spoilt_here_was_good(dialect: str, tmp_path: Path, watch: Watch) -> None:
    robot, file = tmp_path / "kitchen.urdf", tmp_path / "map.ttl"
    robot.write_text(KITCHEN, encoding="utf-8")
    file.write_text(MAPS[dialect], encoding="utf-8")
    answer = watch.read(file, robots=[robot] if MAPS[dialect] is LINKED else [])
    assert (answer.defect, answer.refused, answer.maps) == ("", "", 1)
    assert answer.bodies >= 2
