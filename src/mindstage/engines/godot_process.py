"""Project: the Godot project that speaks with Mindstage, ready to be run.

What is installed may be read-only, and Godot writes beside a project what it has worked out of it. So a copy lies in
the cache, for each version of the project and of Godot one, and is made whole or not at all.

Program: which Godot there is on this machine, and whether it is new enough.

Process: one running Godot, and what it said last.

It is told by its environment where to join and what the token is. It ends when it is ended here; should this process
die without a word, Godot sees its connection break and ends by itself.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, NamedTuple
from weakref import finalize

from mindstage.errors import EngineUnavailableError
from mindstage.files import cache_dir

__all__ = [
    "MIN_VERSION",
    "GodotExecutable",
    "GodotProcess",
    "bundled_project",
    "find_godot",
    "isolated_environment",
    "prepare_project",
]


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
    checkout = Path(__file__).resolve().parents[3]
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
    package = Path(__file__).resolve().parents[1]
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


_TERMINATE_TIMEOUT_S = 3.0
"""How long it may take to end when it is asked to; then it is ended [s]."""
_LOG_TAIL_LINES = 8
_LOG_TAIL_BYTES = 8192


class GodotProcess:
    """Runs from when it is made until `end`."""

    def __init__(
        self,
        godot: GodotExecutable,
        project: Path,
        *,
        url: str,
        token: str,
        namespace: str,
        mesh_dir: Path,
        window: bool = False,
        options: Sequence[str] = (),
    ) -> None:
        """Starts it, and does not wait.

        Args:
            godot: which.
            project: what it runs.
            url: of the bridge that it joins.
            token: which lets it in; others on this machine cannot read it there.
            namespace: below which it offers its services.
            forms: the folder of mesh files.
            window: whether it opens a window.
            options: more of Godot's own options.

        Raises:
            EngineUnavailableError: it does not start.
        """
        command = [str(godot.path), *([] if window else ["--headless"]), *options, "--path", str(project), "--"]
        command += [f"--mindstage-url={url}", f"--mindstage-namespace={namespace}", "--mindstage-quit-when-lost"]
        told = {"MINDSTAGE_TOKEN": token, "MINDSTAGE_FORMS": str(mesh_dir)}
        self._output: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - it is closed with the process
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=self._output, stderr=subprocess.STDOUT,
                env=os.environ | isolated_environment() | told, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            self._output.close()
            cause = f"{godot.path} does not start: {error.strerror or error}"
            raise EngineUnavailableError("godot", cause=cause) from error
        self.terminate = finalize(self, _terminate, self._process, self._output)
        """Ends it; any number of times."""

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether it is still there."""
        return self._process.poll() is None

    def exits_within(self, timeout_s: float) -> bool:
        """Whether it ends within a while."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        return not self.is_running

    def exit_message(self) -> str:
        """How it ended, and its last words."""
        code = self._process.poll()
        if code is None:
            how = "it still runs"
        elif code < 0:
            how = f"it was ended by {_signal_name(-code)}"
        else:
            how = f"it ended with exit code {code}"
        said = self.log_tail()
        return f"{how}; its last words: {said}" if said else f"{how} and said nothing"

    def log_tail(self) -> str:
        """The last lines that it wrote."""
        if self._output.closed:
            return ""
        descriptor = self._output.fileno()
        length = os.fstat(descriptor).st_size
        text = os.pread(descriptor, _LOG_TAIL_BYTES, max(0, length - _LOG_TAIL_BYTES)).decode("utf-8", "replace")
        return " / ".join([line.strip() for line in text.splitlines() if line.strip()][-_LOG_TAIL_LINES:])


def _terminate(process: subprocess.Popen[bytes], output: IO[bytes]) -> None:
    if process.poll() is None:
        _send_signal(process, signal.SIGTERM)
        try:
            process.wait(_TERMINATE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            _send_signal(process, signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_TERMINATE_TIMEOUT_S)
    output.close()


def _send_signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """Sends a signal to it and to whatever it started itself."""
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)


def _signal_name(number: int) -> str:
    with suppress(ValueError):
        return signal.Signals(number).name
    return f"signal {number}"
