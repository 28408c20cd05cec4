"""Mutated small maps of each dialect: each is read and written, or refused, within its limits.

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

from tests.maps.fuzz_budget import fuzz_seeds, save_case
from tests.maps.fuzz_maps import LINKED_MAP, MAPS_BY_DIALECT, MutatedMap, mutated_maps, mutated_urdfs
from tests.maps.fuzz_supervisor import VERBS, WorkerSupervisor
from tests.maps.small_urdf import KITCHEN_URDF

EXAMPLES = 10
"""Number of examples per round."""


@pytest.fixture(scope="module")
def supervisor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WorkerSupervisor]:
    with WorkerSupervisor(tmp_path_factory.mktemp("worker")) as supervisor:
        yield supervisor


def fuzz(inputs: SearchStrategy[Any], check: Callable[[Any, str], None]) -> None:
    """Checks inputs until the time is used up."""
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

    for number in fuzz_seeds():
        seed(number)(few(given(made=inputs, verb=st.sampled_from(VERBS))(once)))()


def read(supervisor: WorkerSupervisor, file: Path, verb: str, called: str, robots: Sequence[Path] = ()) -> None:
    answer = supervisor.read(file, robots=robots, verb=verb)
    if answer.defect:
        raise AssertionError(f"{save_case(file, name=called)}: {answer.defect}")


@pytest.mark.parametrize("dialect", MAPS_BY_DIALECT)
def test_a_mutated_map_is_read_or_refused(dialect: str, tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    robots = []
    if MAPS_BY_DIALECT[dialect] is LINKED_MAP:
        robots = [tmp_path / "kitchen.urdf"]
        robots[0].write_text(KITCHEN_URDF, encoding="utf-8")
    file = tmp_path / "map.ttl"

    def check(made: MutatedMap, verb: str) -> None:
        ox.serialize(made.quads, file, ox.RdfFormat.TURTLE)
        read(supervisor, file, verb, f"any {dialect}", robots)

    fuzz(mutated_maps(dialect), check)


def test_a_mutated_robot_description_is_read_or_refused(tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    file = tmp_path / "kitchen.urdf"

    def check(text: str, verb: str) -> None:
        file.write_text(text, encoding="utf-8")
        read(supervisor, file, verb, "any robot")

    fuzz(mutated_urdfs(), check)


def test_a_map_with_a_mutated_robot_description_is_read_or_refused(
    tmp_path: Path, supervisor: WorkerSupervisor
) -> None:
    file, robot = tmp_path / "linked.ttl", tmp_path / "kitchen.urdf"
    file.write_text(LINKED_MAP, encoding="utf-8")

    def check(text: str, verb: str) -> None:
        robot.write_text(text, encoding="utf-8")
        answer = supervisor.read(file, robots=[robot], verb=verb)
        if answer.defect:
            raise AssertionError(f"{save_case(robot, name='any robot beside a map')}: {answer.defect}")

    fuzz(mutated_urdfs(), check)


@pytest.mark.parametrize("dialect", MAPS_BY_DIALECT)
def test_the_maps_are_valid_before_mutation(dialect: str, tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    robot, file = tmp_path / "kitchen.urdf", tmp_path / "map.ttl"
    robot.write_text(KITCHEN_URDF, encoding="utf-8")
    file.write_text(MAPS_BY_DIALECT[dialect], encoding="utf-8")
    answer = supervisor.read(file, robots=[robot] if MAPS_BY_DIALECT[dialect] is LINKED_MAP else [])
    assert (answer.defect, answer.error, answer.maps) == ("", "", 1)
    assert answer.bodies >= 2
