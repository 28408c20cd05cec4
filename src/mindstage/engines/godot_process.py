"""Project: the Godot project that speaks with Mindstage, ready to be run.

What is installed may be read-only, and Godot writes beside a project what it has worked out of it. So a copy lies in
the cache, for each version of the project and of Godot one, and is made whole or not at all.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from mindstage.engines.godot.program import GodotExecutable
from mindstage.errors import EngineUnavailableError
from mindstage.files import cache_dir

__all__ = ["bundled_project", "isolated_environment", "prepare_project"]

_IMPORT_TIMEOUT_S = 180.0
_EXCLUDED = shutil.ignore_patterns(".godot", "tests", "*.uid")
_PROJECT_FILE = "project.godot"
_HOME_DIR = "home"
_KEPT_COPIES = 2
"""So many copies are kept beside the one that is used, however old they are."""
_MAX_UNUSED_S = 24 * 3600.0


def bundled_project() -> Path:
    """The project as it comes with Mindstage: in the wheel, or beside `src` in a checkout.

    Raises:
        EngineUnavailableError: it did not come along.
    """
    package = Path(__file__).resolve().parents[2]
    places = (package / "godot_project", package.parents[1] / "godot")
    found = next((place for place in places if (place / _PROJECT_FILE).is_file()), None)
    if found is None:
        cause = f"its project is missing; it should be in {' or '.join(map(str, places))}"
        raise EngineUnavailableError("godot", cause=cause, remedy="reinstall mindstage")
    return found


def prepare_project(godot: GodotExecutable) -> Path:
    """A copy that this Godot has prepared; made when it is first needed.

    Raises:
        EngineUnavailableError: it cannot be made.
    """
    shipped = bundled_project()
    ready = cache_dir("godot") / _digest(shipped, godot)
    if ready.is_dir():
        with suppress(OSError):
            os.utime(ready)  # so that it is seen when it was used last
        return ready
    try:
        with tempfile.TemporaryDirectory(dir=ready.parent, prefix=".making-", ignore_cleanup_errors=True) as folder:
            copy = Path(folder) / "project"
            shutil.copytree(shipped, copy, ignore=_EXCLUDED)
            _prepare(godot, copy)
            copy.rename(ready)
    except OSError as error:
        if not ready.is_dir():  # somebody else was quicker with the same
            cause = f"its project cannot be copied to {ready}: {error.strerror or error}"
            raise EngineUnavailableError(
                "godot", cause=cause, remedy="make room, or name another XDG_CACHE_HOME"
            ) from error
    _delete_old(ready)
    return ready


def isolated_environment() -> dict[str, str]:
    """What to tell a Godot by its environment, so that it writes nothing into its user's home."""
    folder = cache_dir(f"godot/{_HOME_DIR}")
    return {"XDG_DATA_HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "XDG_CACHE_HOME": str(folder)}


def _prepare(godot: GodotExecutable, project: Path) -> None:
    """Has Godot learn the names of the project's classes."""
    try:
        done = subprocess.run(
            [godot.path, "--headless", "--path", project, "--import"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
            timeout=_IMPORT_TIMEOUT_S, check=False, env=os.environ | isolated_environment(),
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        cause = f"{godot.path} did not prepare its project within {_IMPORT_TIMEOUT_S:g} s"
        raise EngineUnavailableError("godot", cause=cause) from error
    if done.returncode != 0:
        said = " / ".join(done.stdout.strip().splitlines()[-3:]) or "it says nothing"
        raise EngineUnavailableError(
            "godot", cause=f"it cannot prepare its project (exit code {done.returncode}): {said}"
        )


def _delete_old(ready: Path) -> None:
    """Removes copies that nobody has started for a day, but for the latest. One that still runs has read all of its."""
    others = [each for each in ready.parent.iterdir() if each not in {ready, ready.parent / _HOME_DIR}]
    used_s = {each: each.stat().st_mtime for each in others if each.exists()}
    for old in sorted(used_s, key=lambda each: used_s[each], reverse=True)[_KEPT_COPIES:]:
        if time.time() - used_s[old] > _MAX_UNUSED_S:
            shutil.rmtree(old, ignore_errors=True)


def _digest(project: Path, godot: GodotExecutable) -> str:
    """A name for what the project and Godot are."""
    digest = hashlib.sha256(f"{godot.path}\0{godot.version}".encode())
    for path in _files(project):
        digest.update(f"\0{path.relative_to(project).as_posix()}\0".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _files(project: Path) -> Iterator[Path]:
    for path in sorted(project.rglob("*")):
        parts = path.relative_to(project).parts
        if path.is_file() and path.suffix != ".uid" and not {".godot", "tests"}.intersection(parts):
            yield path
