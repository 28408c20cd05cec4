"""Program: which Godot there is on this machine, and whether it is new enough."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mindstage.errors import EngineUnavailableError

__all__ = ["MIN_VERSION", "GodotExecutable", "find_godot"]

MIN_VERSION = (4, 4)
"""The first Godot that has Jolt inside."""
_PROGRAM_NAMES = ("godot", "godot4", "godot-4")
_COMMON_PATHS = {
    "linux": ("/usr/bin/godot", "/usr/games/godot", "/usr/local/bin/godot", "/opt/godot/godot", "/snap/bin/godot-4"),
    "darwin": ("/Applications/Godot.app/Contents/MacOS/Godot",),
    "win32": (r"C:\Program Files\Godot\Godot.exe",),
}
_INSTALLED_PATH = "build/godot/bin/godot"
"""Where scripts/install_godot.sh puts it."""
_VERSION_TIMEOUT_S = 60.0
_INSTALL_HINT = (
    "install Godot 4.4 or later and have it on PATH, or name its program with GODOT"
    " (in a checkout, scripts/install_godot.sh gets one)"
)


class GodotExecutable(NamedTuple):
    """A Godot that can run worlds."""

    path: Path
    version: str
    """As it tells it: "4.6.3.stable"."""


def find_godot(program_name: str | Path | None = None) -> GodotExecutable:
    """The Godot to use: the one that is named, else the first on PATH, else one in a usual place.

    Raises:
        EngineUnavailableError: there is none, it is too old, or it does not run.
    """
    if program_name:
        program = shutil.which(str(program_name))
        if program is None:
            raise EngineUnavailableError(
                "godot", cause=f"there is no program {str(program_name)!r}", remedy=_INSTALL_HINT
            )
        return _query_version(Path(program))
    found = next(_candidates(), None)
    if found is None:
        raise EngineUnavailableError("godot", cause="there is no Godot on this machine", remedy=_INSTALL_HINT)
    return _query_version(found)


def _candidates() -> Iterator[Path]:
    checkout = Path(__file__).resolve().parents[4]
    on_path = (found for name in _PROGRAM_NAMES if (found := shutil.which(name)))
    home = Path.home()
    more = (home / ".local/bin/godot", home / "Applications/Godot.app/Contents/MacOS/Godot", checkout / _INSTALLED_PATH)
    for place in map(str, (*on_path, *_COMMON_PATHS.get(sys.platform, ()), *more)):
        if shutil.which(place):
            yield Path(place)


def _query_version(path: Path) -> GodotExecutable:
    """What the program itself says."""
    try:
        told = subprocess.run(
            [path, "--headless", "--version"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=_VERSION_TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        cause = f"{path} does not say its version within {_VERSION_TIMEOUT_S:g} s"
        raise EngineUnavailableError("godot", cause=cause, remedy=_INSTALL_HINT) from error
    except OSError as error:
        raise EngineUnavailableError(
            "godot", cause=f"{path} does not run: {error.strerror}", remedy=_INSTALL_HINT
        ) from error
    found = re.search(r"^(\d+)\.(\d+)\S*", told.stdout, re.MULTILINE)
    if told.returncode != 0 or found is None:
        said = (told.stderr or told.stdout).strip().splitlines()[-1:] or [f"it ended with {told.returncode}"]
        raise EngineUnavailableError("godot", cause=f"{path} does not say its version: {said[0]}", remedy=_INSTALL_HINT)
    if (int(found[1]), int(found[2])) < MIN_VERSION:
        oldest = ".".join(map(str, MIN_VERSION))
        cause = f"{path} is Godot {found[0]}, and {oldest} or later is needed"
        raise EngineUnavailableError("godot", cause=cause, remedy=_INSTALL_HINT)
    return GodotExecutable(path, found[0])
