"""Process: one running Godot, and what it said last.

It is told by its environment where to join and what the token is. It ends when it is ended here; should this process
die without a word, Godot sees its connection break and ends by itself.
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO
from weakref import finalize

from mindstage.engines.godot.program import GodotExecutable
from mindstage.engines.godot.project import isolated_environment
from mindstage.errors import EngineUnavailableError

__all__ = ["GodotProcess"]

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
