"""Chrome DevTools Protocol over a pipe (`--remote-debugging-pipe`) to a browser process of our own.

JSON messages end with a null byte. Unlike a port, a pipe cannot be reached by other users of the machine. Every call
has a timeout, for what it writes as for what it reads, and ends at once when the browser exits. A library would be
larger than what is needed here: Playwright downloads browsers of its own, of over 100 MB.
"""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec

from mindstage.errors import BrowserCrashedError

__all__ = ["CdpPipe"]

_BECOME_BROWSER = (
    "import fcntl, os, sys\n"
    "ours = [fcntl.fcntl(int(each), fcntl.F_DUPFD, 10) for each in sys.argv[1:3]]\n"
    "os.dup2(ours[0], 3), os.dup2(ours[1], 4)\n"
    "os.execv(sys.argv[3], sys.argv[3:])\n"
)
"""A browser reads from file descriptor 3 and writes to 4, whatever this process has open under these numbers."""
_CLOSE_TIMEOUT_S = 5.0
"""Time for a browser to exit after `HeadlessBrowser.close`."""
_READ_SIZE = 1 << 16


@contextmanager
def _deferred_signals() -> Iterator[None]:
    """Handles signals that end the program at the end of the context, so that its handlers raise nothing inside."""
    if threading.current_thread() is not threading.main_thread():  # Python handles signals in the main thread only
        yield
        return
    received: list[int] = []
    before = {
        each: signal.signal(each, lambda number, _: received.append(number)) for each in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
        for number in received:
            os.kill(os.getpid(), number)


class _Reply(msgspec.Struct):
    """A reply, or without an id an event, which is ignored."""

    id: int = 0
    result: dict[str, Any] = {}
    error: dict[str, Any] | None = None


class CdpPipe:
    """A browser process and the pipe to it."""

    def __init__(self, executable: Path, arguments: Sequence[str], *, folder: Path) -> None:
        """Prepares the process; `start` starts it.

        Args:
            executable: Chromium or a browser derived from it.
            arguments: command-line arguments, `--remote-debugging-pipe` among them.
            folder: its user data directory, which also gets its log.
        """
        self._command = [str(executable), *arguments, f"--user-data-dir={folder}"]
        self._log = folder / "browser.log"
        self._pending = 0
        self._buffer = bytearray()
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = self._timed_out = False

    def start(self) -> None:
        """Starts the process; a signal that arrives meanwhile is handled when `close` can end the process.

        Raises:
            OSError: the process cannot be started.
        """
        theirs, self._input = os.pipe()
        self._output, theirs_too = os.pipe()
        os.set_blocking(self._input, False)
        command = [sys.executable, "-I", "-S", "-c", _BECOME_BROWSER, str(theirs), str(theirs_too), *self._command]
        try:
            with self._log.open("wb") as log, _deferred_signals():
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    pass_fds=(theirs, theirs_too),
                    start_new_session=True,  # so that its helpers end with it, and Ctrl-C is ours
                )
        except OSError:
            os.close(self._input)
            os.close(self._output)
            raise
        finally:
            os.close(theirs)
            os.close(theirs_too)

    @property
    def has_exited(self) -> bool:
        """Whether the process has exited."""
        return self._process is not None and self._process.poll() is not None

    def send(
        self, method: str, params: Mapping[str, object] | None = None, *, session: str = "", timeout_s: float
    ) -> dict[str, Any]:
        """Sends one command and returns its result.

        Args:
            method: its name in the protocol.
            params: its parameters.
            session: id of the page's session; empty for commands to the browser.
            timeout_s: time to send the command and to receive the result [s].

        Raises:
            BrowserCrashedError: an error or an invalid reply, no reply in time, or the process has exited.
        """
        if self._closed:  # the file descriptors may have been reused
            raise BrowserCrashedError("it was closed")
        self._pending += 1
        message = {"id": self._pending, "method": method, "params": params or {}}
        data = msgspec.json.encode(message | ({"sessionId": session} if session else {})) + b"\0"
        end, late = time.monotonic() + timeout_s, f"it did not answer {method} within {timeout_s:g} s"
        self._send(data, end, late)
        reply = self._wait_reply(end, late)
        if reply.error is not None:
            raise BrowserCrashedError(f"it refuses {method}: {reply.error.get('message', 'no reason given')}")
        return reply.result

    def close(self) -> None:
        """Ends the browser; calling it again is harmless."""
        if self._closed or self._process is None:
            return
        if not self._timed_out:  # a process that does not reply is killed without asking
            with suppress(BrowserCrashedError, subprocess.TimeoutExpired):
                self.send("Browser.close", timeout_s=_CLOSE_TIMEOUT_S)
                self._process.wait(_CLOSE_TIMEOUT_S)
        self._closed = True
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)  # what is left of its helpers too
        self._process.wait(_CLOSE_TIMEOUT_S)
        os.close(self._input)
        os.close(self._output)

    def _send(self, data: bytes, end: float, late: str) -> None:
        left = memoryview(data)
        while left:
            self._wait(self._input, selectors.EVENT_WRITE, end, late)
            try:
                left = left[os.write(self._input, left) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise BrowserCrashedError(self._exit_error()) from error

    def _wait_reply(self, end: float, late: str) -> _Reply:
        while True:
            while (at := self._buffer.find(b"\0")) < 0:
                self._read_messages(end, late)
            text = bytes(self._buffer[:at])
            del self._buffer[: at + 1]
            try:
                reply = msgspec.json.decode(text, type=_Reply)
            except msgspec.MsgspecError as error:
                raise BrowserCrashedError(f"its reply is not valid ({error})") from error
            if reply.id == self._pending:
                return reply

    def _read_messages(self, end: float, late: str) -> None:
        self._wait(self._output, selectors.EVENT_READ, end, late)
        piece = os.read(self._output, _READ_SIZE)
        if not piece:
            raise BrowserCrashedError(self._exit_error())
        self._buffer += piece

    def _wait(self, pipe: int, event: int, end: float, late: str) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(pipe, event)
            if not selector.select(max(0.0, end - time.monotonic())):
                self._timed_out = True
                raise BrowserCrashedError(late)

    def _exit_error(self) -> str:
        """That the process has exited, and the last line of its log."""
        with suppress(subprocess.TimeoutExpired):
            if self._process is not None:
                self._process.wait(_CLOSE_TIMEOUT_S)
        words = self._log.read_text(encoding="utf-8", errors="replace").split("\n")
        last = next((line.strip() for line in reversed(words) if line.strip()), "")
        return f"it has ended: {last}" if last else "it has ended"
