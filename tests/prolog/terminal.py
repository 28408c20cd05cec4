"""A pseudo-terminal with a program: sends input, and waits for output."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import time
from collections.abc import Sequence
from pathlib import Path

__all__ = ["Terminal"]


class Terminal:
    """A program in a pseudo-terminal."""

    def __init__(self, command: Sequence[str], *, home: Path, timeout_s: float = 60.0) -> None:
        self.output = ""
        self._matched_end = 0
        self._timeout_s = timeout_s
        self._pid, self._screen = pty.fork()
        if self._pid == 0:
            environment = os.environ | {"TERM": "xterm", "NO_COLOR": "1", "HOME": str(home)}
            environment.pop("XDG_CONFIG_HOME", None)
            os.execvpe(command[0], list(command), environment)

    def type(self, text: str) -> None:
        os.write(self._screen, text.encode())

    def wait_for(self, pattern: str) -> None:
        """Waits until the output after the last match matches a pattern."""
        assert self._wait_match(pattern, within_s=self._timeout_s), f"no {pattern!r} in {self.output!r}"

    def _wait_match(self, pattern: str, *, within_s: float) -> bool:
        start, deadline = self._matched_end, time.monotonic() + within_s
        while not (found := re.search(pattern, self.output[start:])):
            if time.monotonic() > deadline or not self._read():
                return False
        self._matched_end = start + found.end()
        return True

    def interrupt_until_end(self) -> None:
        """Presses Ctrl-C until the program exits: SWI-Prolog may miss one while it writes."""
        deadline = time.monotonic() + self._timeout_s
        while time.monotonic() < deadline:
            self.type("\x03")
            if self._wait_closed(within_s=1.0):
                return

    def _wait_closed(self, *, within_s: float) -> bool:
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline:
            if not self._read():
                return True
        return False

    def wait_exit(self) -> int:
        """Waits for the program to exit; returns its exit code."""
        deadline = time.monotonic() + self._timeout_s
        while self._read():
            assert time.monotonic() < deadline, f"the program does not exit: {self.output!r}"
        return os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])

    def close(self) -> None:
        """Kills the program if it is running."""
        try:
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)
        except (ProcessLookupError, ChildProcessError):
            pass
        os.close(self._screen)

    def _read(self) -> bool:
        """Reads available output; False when the program has closed the terminal."""
        if not select.select([self._screen], [], [], 0.1)[0]:
            return True
        try:
            text = os.read(self._screen, 4096)
        except OSError:  # raised by Linux at the end of the terminal
            return False
        # Escape sequences of line editors are removed.
        self.output += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text.decode(errors="replace"))
        return bool(text)
