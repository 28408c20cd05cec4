"""Program: which Godot there is on this machine, and whether it is new enough."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mindstage.errors import EngineUnavailable

__all__ = ["OLDEST", "Godot", "find_godot"]

OLDEST = (4, 4)
"""The first Godot that has Jolt inside."""
_NAMES = ("godot", "godot4", "godot-4")
_USUAL = {
    "linux": ("/usr/bin/godot", "/usr/games/godot", "/usr/local/bin/godot", "/opt/godot/godot", "/snap/bin/godot-4"),
    "darwin": ("/Applications/Godot.app/Contents/MacOS/Godot",),
    "win32": (r"C:\Program Files\Godot\Godot.exe",),
}
_INSTALLED = "build/godot/bin/godot"
"""Where scripts/install_godot.sh puts it."""
_ASKING_S = 60.0
_GET = (
    "install Godot 4.4 or later and have it on PATH, or name its program with GODOT"
    " (in a checkout, scripts/install_godot.sh gets one)"
)


class Godot(NamedTuple):
    """A Godot that can run worlds."""

    path: Path
    version: str
    """As it tells it: "4.6.3.stable"."""


def find_godot(named: str | Path | None = None) -> Godot:
    """The Godot to use: the one that is named, else the first on PATH, else one in a usual place.

    Raises:
        EngineUnavailable: there is none, it is too old, or it does not run.
    """
    if named:
        program = shutil.which(str(named))
        if program is None:
            raise EngineUnavailable("godot", cause=f"there is no program {str(named)!r}", remedy=_GET)
        return _asked(Path(program))
    found = next(_candidates(), None)
    if found is None:
        raise EngineUnavailable("godot", cause="there is no Godot on this machine", remedy=_GET)
    return _asked(found)


def _candidates() -> Iterator[Path]:
    checkout = Path(__file__).resolve().parents[4]
    on_path = (found for name in _NAMES if (found := shutil.which(name)))
    home = Path.home()
    more = (home / ".local/bin/godot", home / "Applications/Godot.app/Contents/MacOS/Godot", checkout / _INSTALLED)
    for place in map(str, (*on_path, *_USUAL.get(sys.platform, ()), *more)):
        if shutil.which(place):
            yield Path(place)


def _asked(path: Path) -> Godot:
    """What the program itself says."""
    try:
        told = subprocess.run(
            [path, "--headless", "--version"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=_ASKING_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        cause = f"{path} does not say its version within {_ASKING_S:g} s"
        raise EngineUnavailable("godot", cause=cause, remedy=_GET) from error
    except OSError as error:
        raise EngineUnavailable("godot", cause=f"{path} does not run: {error.strerror}", remedy=_GET) from error
    found = re.search(r"^(\d+)\.(\d+)\S*", told.stdout, re.MULTILINE)
    if told.returncode != 0 or found is None:
        said = (told.stderr or told.stdout).strip().splitlines()[-1:] or [f"it ended with {told.returncode}"]
        raise EngineUnavailable("godot", cause=f"{path} does not say its version: {said[0]}", remedy=_GET)
    if (int(found[1]), int(found[2])) < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        cause = f"{path} is Godot {found[0]}, and {oldest} or later is needed"
        raise EngineUnavailable("godot", cause=cause, remedy=_GET)
    return Godot(path, found[0])
