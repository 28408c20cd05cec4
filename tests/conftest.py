"""What all tests share: the sample maps, the outside programs, their distribution, and how hard hypothesis tries.

A program that is missing skips the tests that need it, with the reason; where CI is set, which promises that
`make test` has installed all of them, it fails them instead. What a clone cannot have is named by a variable, and its
absence is a skip everywhere: sample maps by `MINDSTAGE_DATA`, a running rosbridge by `MINDSTAGE_ROSBRIDGE`.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parent.parent

OUTSIDE_PROGRAMS = frozenset({"browser", "panel_browser", "chromium", "open_page", "godot", "cluster", "roslibjs"})
"""Fixtures of programs that are not ours and whose speed is not in our hands."""
OUTSIDE_MODULES = (
    "imagination/test_ray.py",
    "ros/test_real_rosbridge.py",
    "ros/test_real_robot.py",
)


LONG_MODULES = (
    "cli/test_environments.py",
    "engines/test_kitchens.py",
    "episodes/test_detection.py",
    "fuzz/test_running_server.py",
    "imagination/test_verdicts.py",
    "imagination/test_warp.py",
    "maps/test_fuzz_hostile.py",
    "maps/test_fuzz_structure.py",
    "places/test_places.py",
    "prolog/test_cli.py",
    "rendering/test_photographs.py",
    "robots/test_skills.py",
    "simulation/test_question_pool.py",
    "simulation/test_soak.py",
    "tests/test_corpus.py",
    "tests/test_documents.py",
    "tests/test_examples.py",
    "tests/test_wheel.py",
)
"""Modules with tests of more than ten seconds."""

WORKERS_PER_CORE = 2
"""While a test waits for a browser, Godot, a socket or a process, which is 60 % of the time, others compute."""
BYTES_PER_WORKER = 1_500_000_000
"""Memory of a worker with its browser [B]."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """The number of workers for `-n auto`, which memory may limit to that of the cores."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 0
    return max(cores, min(WORKERS_PER_CORE * cores, memory // BYTES_PER_WORKER))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Repeats a failed test of an outside program once, which the summary lists as RERUN, and orders the items.

    On a busy machine a browser, a Ray cluster or a rosbridge may take longer than any sensible timeout. A test that is
    listed often has a defect, which has to be found.
    """
    for item in items:
        if _needs_outside_program(item):
            item.add_marker(pytest.mark.flaky(reruns=1))
    if workers := int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "0")):
        items[:] = _long_first(items, workers)


def _needs_outside_program(item: pytest.Item) -> bool:
    outside = OUTSIDE_PROGRAMS.intersection(getattr(item, "fixturenames", ()))
    return bool(outside) or item.path.as_posix().endswith(OUTSIDE_MODULES)


def _long_first(items: Sequence[pytest.Item], workers: int) -> list[pytest.Item]:
    """Deals the modules to as many lists as there are workers, the long ones first, and joins the lists.

    With `--dist worksteal` each worker begins with one of equal parts, and takes the last items of others when it has
    none left: all begin with what takes long, and share short items at the end, so that none is left alone.
    """
    modules: dict[Path, list[pytest.Item]] = {}
    for item in items:
        modules.setdefault(item.path, []).append(item)

    def is_short(path: Path) -> bool:
        return not path.as_posix().endswith(LONG_MODULES) and not any(map(_needs_outside_program, modules[path]))

    ordered = [modules[path] for path in sorted(modules, key=is_short)]
    return [item for first in range(workers) for module in ordered[first::workers] for item in module]


settings.register_profile("ci", derandomize=True, deadline=None, max_examples=60, print_blob=True)
settings.register_profile("random", derandomize=False, database=None, deadline=None, max_examples=60, print_blob=True)
settings.register_profile("quick", deadline=None, max_examples=20)
settings.register_profile(
    "thorough",
    deadline=None,
    max_examples=500,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
# `make test-slow` sets HYPOTHESIS_PROFILE=thorough.
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The sample maps and ontologies of other systems, which are not part of this project."""
    named = os.environ.get("MINDSTAGE_DATA")
    folder = Path(named or ROOT.parent / "shared" / "data")
    if (folder / "maps").is_dir():
        return folder
    if named:
        pytest.fail(f"MINDSTAGE_DATA names {folder}, which has no folder maps")
    pytest.skip(f"no sample maps in {folder}; name their folder with MINDSTAGE_DATA")


@pytest.fixture(scope="session")
def swipl() -> Path:
    """SWI-Prolog's executable."""
    return _program("swipl", package="swi-prolog-nox")


@pytest.fixture(scope="session")
def chromium() -> Path:
    """A headless browser's executable."""
    return _program("chromium", "chromium-browser", "google-chrome", package="chromium")


@pytest.fixture(scope="session")
def oxigraph() -> Path:
    """A SPARQL server's executable."""
    beside_python = Path(sys.executable).with_name("oxigraph")
    return beside_python if beside_python.is_file() else _program("oxigraph", package="none; PyPI's is oxigraph")


@pytest.fixture(scope="session")
def godot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A Godot that is new enough: the one that GODOT names, or one on PATH, or in a usual place.

    From now on caches are the tests' own; those that run beside one another share them, since a project takes a while
    to prepare.
    """
    from mindstage.engines.remote.godot_process import find_godot
    from mindstage.errors import EngineUnavailableError

    try:
        program = find_godot(os.environ.get("GODOT")).path
    except EngineUnavailableError as error:
        missing(str(error))
    beside = "PYTEST_XDIST_WORKER" in os.environ
    folder = tmp_path_factory.getbasetemp().parent if beside else tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield program


@pytest.fixture(scope="session")
def node() -> Path:
    """Node's executable."""
    return _program("node", "nodejs", package="nodejs")


@pytest.fixture(scope="session")
def roslibjs() -> Path:
    """The module of roslib, the ROS client of web pages."""
    module = ROOT / "build" / "node" / "node_modules" / "roslib" / "dist" / "RosLib.js"
    return module if module.is_file() else missing("roslib is not installed (scripts/install_node.sh does it)")


def _program(*names: str, package: str) -> Path:
    found = next(filter(None, map(shutil.which, names)), None)
    return Path(found) if found else missing(f"{names[0]} is not installed (Debian's package {package})")


def missing(reason: str) -> NoReturn:
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)
