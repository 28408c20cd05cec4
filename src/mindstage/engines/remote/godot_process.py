"""Godot as a process: finding the executable, preparing the project, and running it.

The installed project may be read-only, and Godot writes imported files beside a project. Therefore a copy is prepared
in the cache for each version of project and executable, atomically.

A `GodotProcess` receives address and token by environment variables. It ends with the engine; if this process dies,
Godot exits as soon as its connection is lost.
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
from mindstage.files import cache_dir, home_folder

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
"""The first version of Godot with Jolt physics included."""
_PROGRAM_NAMES = ("godot", "godot4", "godot-4")
_COMMON_PATHS = {
    "linux": ("/usr/bin/godot", "/usr/games/godot", "/usr/local/bin/godot", "/opt/godot/godot", "/snap/bin/godot-4"),
    "darwin": ("/Applications/Godot.app/Contents/MacOS/Godot",),
    "win32": (r"C:\Program Files\Godot\Godot.exe",),
}
_INSTALLED_PATH = "build/godot/bin/godot"
"""Where scripts/install_godot.sh installs it."""
_VERSION_TIMEOUT_S = 60.0
_INSTALL_HINT = (
    "install Godot 4.4 or later and have it on PATH, or set GODOT to its path"
    " (in a checkout, scripts/install_godot.sh gets one)"
)


class GodotExecutable(NamedTuple):
    """A Godot executable that is recent enough."""

    path: Path
    version: str
    """As reported, such as "4.6.3.stable"."""


def find_godot(program_name: str | Path | None = None) -> GodotExecutable:
    """Finds Godot: the named executable, or the first on PATH or in a common location.

    Raises:
        EngineUnavailableError: Godot was not found, is too old, or does not run.
    """
    if program_name:
        program = shutil.which(str(program_name))
        if program is None:
            raise EngineUnavailableError(
                "godot", cause=f"there is no executable {str(program_name)!r}", remedy=_INSTALL_HINT
            )
        return _query_version(Path(program))
    found = next(_candidates(), None)
    if found is None:
        raise EngineUnavailableError("godot", cause="Godot was not found on this machine", remedy=_INSTALL_HINT)
    return _query_version(found)


def _candidates() -> Iterator[Path]:
    checkout = Path(__file__).resolve().parents[4]
    on_path = (found for name in _PROGRAM_NAMES if (found := shutil.which(name)))
    home = home_folder()
    at_home = () if home is None else (home / ".local/bin/godot", home / "Applications/Godot.app/Contents/MacOS/Godot")
    for path in map(str, (*on_path, *_COMMON_PATHS.get(sys.platform, ()), *at_home, checkout / _INSTALLED_PATH)):
        if shutil.which(path):
            yield Path(path)


def _query_version(path: Path) -> GodotExecutable:
    """Runs the executable to get its version."""
    try:
        result = subprocess.run(
            [path, "--headless", "--version"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=_VERSION_TIMEOUT_S,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        cause = f"{path} did not report its version within {_VERSION_TIMEOUT_S:g} s"
        raise EngineUnavailableError("godot", cause=cause, remedy=_INSTALL_HINT) from error
    except OSError as error:
        raise EngineUnavailableError(
            "godot", cause=f"{path} does not run: {error.strerror}", remedy=_INSTALL_HINT
        ) from error
    found = re.search(r"^(\d+)\.(\d+)\S*", result.stdout, re.MULTILINE)
    if result.returncode != 0 or found is None:
        output = (result.stderr or result.stdout).strip().splitlines()[-1:] or [f"exit code {result.returncode}"]
        raise EngineUnavailableError(
            "godot", cause=f"{path} does not report its version: {output[0]}", remedy=_INSTALL_HINT
        )
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
"""Unused copies that are kept however old they are."""
_MAX_UNUSED_S = 24 * 3600.0


def bundled_project() -> Path:
    """The project that comes with Mindstage: in the wheel, or beside `src` in a checkout.

    Raises:
        EngineUnavailableError: the project is not installed.
    """
    package = Path(__file__).resolve().parents[2]
    candidates = (package / "godot_project", package.parents[1] / "godot")
    found = next((candidate for candidate in candidates if (candidate / _PROJECT_FILE).is_file()), None)
    if found is None:
        cause = f"its project is missing; it should be in {' or '.join(map(str, candidates))}"
        raise EngineUnavailableError("godot", cause=cause, remedy="reinstall mindstage")
    return found


def prepare_project(godot: GodotExecutable) -> Path:
    """A copy of the project, prepared for this executable on first use.

    Raises:
        EngineUnavailableError: the copy cannot be created.
    """
    source = bundled_project()
    prepared = cache_dir("godot") / _digest(source, godot)
    if prepared.is_dir():
        with suppress(OSError):
            os.utime(prepared)  # time of the last use
        return prepared
    try:
        with tempfile.TemporaryDirectory(dir=prepared.parent, prefix=".making-", ignore_cleanup_errors=True) as folder:
            copy = Path(folder) / "project"
            shutil.copytree(source, copy, ignore=_EXCLUDED)
            _prepare(godot, copy)
            copy.rename(prepared)
    except OSError as error:
        if not prepared.is_dir():  # another process may have created it
            cause = f"its project cannot be copied to {prepared}: {error.strerror or error}"
            raise EngineUnavailableError(
                "godot", cause=cause, remedy="free disk space, or set another XDG_CACHE_HOME"
            ) from error
    _delete_old(prepared)
    return prepared


def isolated_environment() -> dict[str, str]:
    """Environment variables that keep Godot from writing to the user's home directory."""
    folder = cache_dir(f"godot/{_HOME_DIR}")
    return {"XDG_DATA_HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "XDG_CACHE_HOME": str(folder)}


def _prepare(godot: GodotExecutable, project: Path) -> None:
    """Lets Godot import the project, so that class names are registered."""
    try:
        result = subprocess.run(
            [godot.path, "--headless", "--path", project, "--import"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
            timeout=_IMPORT_TIMEOUT_S, check=False, env=os.environ | isolated_environment(),
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        cause = f"{godot.path} did not prepare its project within {_IMPORT_TIMEOUT_S:g} s"
        raise EngineUnavailableError("godot", cause=cause) from error
    if result.returncode != 0:
        output = " / ".join(result.stdout.strip().splitlines()[-3:]) or "no output"
        raise EngineUnavailableError(
            "godot", cause=f"it cannot prepare its project (exit code {result.returncode}): {output}"
        )


def _delete_old(prepared: Path) -> None:
    """Deletes copies that were not used for a day, except the latest. A running Godot has loaded all of its files."""
    others = [each for each in prepared.parent.iterdir() if each not in {prepared, prepared.parent / _HOME_DIR}]
    last_used_s = {each: each.stat().st_mtime for each in others if each.exists()}
    for unused in sorted(last_used_s, key=lambda each: last_used_s[each], reverse=True)[_KEPT_COPIES:]:
        if time.time() - last_used_s[unused] > _MAX_UNUSED_S:
            shutil.rmtree(unused, ignore_errors=True)


def _digest(project: Path, godot: GodotExecutable) -> str:
    """A hash of the project's content and the executable."""
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
"""How long it may take to exit after SIGTERM, before it is killed [s]."""
_LOG_TAIL_LINES = 8
_LOG_TAIL_BYTES = 8192


class GodotProcess:
    """A running Godot, from creation until `terminate`."""

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
        """Starts Godot without waiting for it.

        Args:
            godot: the executable.
            project: the prepared project.
            url: address of the rosbridge server.
            token: token for the server, passed in a variable that other users cannot read.
            namespace: namespace of its services.
            mesh_dir: directory of mesh files.
            window: whether to open a window.
            options: additional command-line options.

        Raises:
            EngineUnavailableError: the process cannot be started.
        """
        command = [str(godot.path), *([] if window else ["--headless"]), *options, "--path", str(project), "--"]
        command += [f"--mindstage-url={url}", f"--mindstage-namespace={namespace}", "--mindstage-quit-when-lost"]
        environment = {"MINDSTAGE_TOKEN": token, "MINDSTAGE_FORMS": str(mesh_dir)}
        self._output: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - it is closed with the process
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=self._output, stderr=subprocess.STDOUT,
                env=os.environ | isolated_environment() | environment, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            self._output.close()
            cause = f"{godot.path} does not start: {error.strerror or error}"
            raise EngineUnavailableError("godot", cause=cause) from error
        self.terminate = finalize(self, _terminate, self._process, self._output)
        """Ends the process; calling it again has no effect."""

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def exits_within(self, timeout_s: float) -> bool:
        """Whether the process exits within a timeout."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        return not self.is_running

    def exit_message(self) -> str:
        """How the process ended, with its last output."""
        code = self._process.poll()
        if code is None:
            state = "it is running"
        elif code < 0:
            state = f"it was terminated by {_signal_name(-code)}"
        else:
            state = f"it exited with code {code}"
        output = self.log_tail()
        return f"{state}; last output: {output}" if output else f"{state} without output"

    def log_tail(self) -> str:
        """The last lines of output."""
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
    """Sends a signal to the process and its children."""
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)


def _signal_name(number: int) -> str:
    with suppress(ValueError):
        return signal.Signals(number).name
    return f"signal {number}"
