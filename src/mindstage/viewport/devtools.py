"""DevTools: the pipe through which one browser process is told what to do.

Nobody else on the machine can reach a pipe, as they could a port. Every wait has a timeout, and a browser that is
gone is noticed at once.
"""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from mindstage.errors import BrowserBroken

__all__ = ["DevTools"]

_BECOME_BROWSER = (
    "import fcntl, os, sys\n"
    "ours = [fcntl.fcntl(int(each), fcntl.F_DUPFD, 10) for each in sys.argv[1:3]]\n"
    "os.dup2(ours[0], 3), os.dup2(ours[1], 4)\n"
    "os.execv(sys.argv[3], sys.argv[3:])\n"
)
"""A browser listens at file 3 and talks at file 4, whatever other files this process has open there."""
_END_S = 5.0
"""So long a browser has to end once it was told to."""
_PIECE = 1 << 16


class _Reply(msgspec.Struct):
    """An answer, if it has a number, or else an event, which nobody here waits for."""

    id: int = 0
    result: dict[str, Any] = {}
    error: dict[str, Any] | None = None


class DevTools:
    """A running browser."""

    def __init__(self, executable: Path, arguments: Sequence[str], *, folder: Path) -> None:
        """Starts it.

        Args:
            executable: of Chromium, or of a relative of it.
            arguments: which make it listen at its pipe.
            folder: where what it says goes, and all that it keeps.
        """
        self._log = folder / "browser.log"
        self._asked = 0
        self._heard = bytearray()
        theirs, self._to = os.pipe()
        self._from, theirs_too = os.pipe()
        command = [sys.executable, "-I", "-S", "-c", _BECOME_BROWSER, str(theirs), str(theirs_too), str(executable)]
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [*command, *arguments, f"--user-data-dir={folder}"],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=(theirs, theirs_too),
                start_new_session=True,  # so that its helpers end with it, and Ctrl-C is ours
            )
        os.close(theirs)
        os.close(theirs_too)
        self._closed = self._late = False

    @property
    def ended(self) -> bool:
        """Whether the browser is there no more."""
        return self._process.poll() is not None

    def ask(
        self, method: str, params: Mapping[str, object] | None = None, *, session: str = "", timeout_s: float
    ) -> dict[str, Any]:
        """Sends one command and gives its result.

        Args:
            method: its name in the protocol.
            params: what it takes.
            session: of the page that it is for; none where it is for the browser.
            timeout_s: how long to wait for the result [s].

        Raises:
            BrowserBroken: it refuses, does not answer in time, or is gone.
        """
        if self._closed:  # its pipes' numbers may be somebody else's by now
            raise BrowserBroken("it was closed")
        self._asked += 1
        message = {"id": self._asked, "method": method, "params": params or {}}
        try:
            os.write(self._to, msgspec.json.encode(message | ({"sessionId": session} if session else {})) + b"\0")
        except OSError as error:
            raise BrowserBroken(self._end()) from error
        reply = self._answer(time.monotonic() + timeout_s, f"it did not answer {method} within {timeout_s:g} s")
        if reply.error is not None:
            raise BrowserBroken(f"it refuses {method}: {reply.error.get('message', 'it does not say why')}")
        return reply.result

    def close(self) -> None:
        """Ends the browser; any number of times."""
        if self._closed:
            return
        if not self._late:  # what does not answer is not asked to go
            with suppress(BrowserBroken, subprocess.TimeoutExpired):
                self.ask("Browser.close", timeout_s=_END_S)
                self._process.wait(_END_S)
        self._closed = True
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)  # what is left of its helpers too
        self._process.wait(_END_S)
        os.close(self._to)
        os.close(self._from)

    def _answer(self, end: float, late: str) -> _Reply:
        while True:
            while (at := self._heard.find(b"\0")) < 0:
                self._hear(end, late)
            text = bytes(self._heard[:at])
            del self._heard[: at + 1]
            reply = msgspec.json.decode(text, type=_Reply)
            if reply.id == self._asked:
                return reply

    def _hear(self, end: float, late: str) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._from, selectors.EVENT_READ)
            if not selector.select(max(0.0, end - time.monotonic())):
                self._late = True
                raise BrowserBroken(late)
        piece = os.read(self._from, _PIECE)
        if not piece:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_S)
            raise BrowserBroken(self._end())
        self._heard += piece

    def _end(self) -> str:
        """That it is gone, and what it said last."""
        words = self._log.read_text(encoding="utf-8", errors="replace").split("\n")
        last = next((line.strip() for line in reversed(words) if line.strip()), "")
        return f"it has ended: {last}" if last else "it has ended"
