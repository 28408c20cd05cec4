"""Corrupted real files: each is read or refused within its time and memory limits, and without a traceback.

The damage comes from the number of a round, so a finding can be made again; its file is kept under `build/fuzz`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.maps import bundled_kitchen
from tests.maps.corruption import corrupted
from tests.maps.fuzz_budget import fuzz_seeds, save_case
from tests.maps.fuzz_maps import LINKED_MAP
from tests.maps.fuzz_supervisor import VERBS, WorkerSupervisor
from tests.maps.small_urdf import KITCHEN_URDF

SAMPLES = ("ameva-task-two", "iai-kitchen-original", "iai-kitchen-spawned", "knowrob1-ccrl", "soma-iai-room")


@pytest.fixture(scope="module")
def supervisor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WorkerSupervisor]:
    with WorkerSupervisor(tmp_path_factory.mktemp("worker")) as supervisor:
        yield supervisor


def fuzz(name: str, data: bytes, file: Path, supervisor: WorkerSupervisor, *, robots: tuple[Path, ...] = ()) -> None:
    """Reads a file unchanged, then with one corruption after the other."""
    file.write_bytes(data)
    whole = supervisor.read(file, robots=robots)
    assert (whole.defect, whole.error) == ("", ""), f"the undamaged {name}"
    assert whole.bodies
    outcomes: Counter[bool] = Counter()
    for number in fuzz_seeds():
        file.write_bytes(corrupted(data, number))
        answer = supervisor.read(file, robots=robots, verb=VERBS[number % len(VERBS)])
        if answer.defect:
            pytest.fail(f"{save_case(file, name=f'{name} {number}')}: {answer.defect}")
        outcomes[bool(answer.maps)] += 1
    assert outcomes[True], "all of it was refused: the damage is too great to find anything"


@pytest.mark.parametrize("name", SAMPLES)
def test_a_corrupted_sample_is_read_or_refused(
    name: str, shared_data: Path, tmp_path: Path, supervisor: WorkerSupervisor
) -> None:
    fuzz(name, (shared_data / "maps" / f"{name}.owl").read_bytes(), tmp_path / "map.owl", supervisor)


def test_a_corrupted_bundled_kitchen_is_read_or_refused(tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    fuzz("kitchen", bundled_kitchen().read_bytes(), tmp_path / "map.owl", supervisor)


def test_a_corrupted_robot_description_is_read_or_refused(tmp_path: Path, supervisor: WorkerSupervisor) -> None:
    fuzz("robot", KITCHEN_URDF.encode(), tmp_path / "kitchen.urdf", supervisor)


def test_a_corrupted_map_with_a_robot_description_is_read_or_refused(
    tmp_path: Path, supervisor: WorkerSupervisor
) -> None:
    robot = tmp_path / "kitchen.urdf"
    robot.write_text(KITCHEN_URDF, encoding="utf-8")
    fuzz("linked", LINKED_MAP.encode(), tmp_path / "linked.ttl", supervisor, robots=(robot,))


def test_the_same_seed_gives_the_same_corruption() -> None:
    data = KITCHEN_URDF.encode()
    assert [corrupted(data, number) for number in range(20)] == [corrupted(data, number) for number in range(20)]
    assert corrupted(data, 0) == data
    assert len({corrupted(data, number) for number in range(1, 20)}) > 15
