"""SIGTERM ends the command with 143, after browsers, engines and servers are closed."""

from __future__ import annotations

import os
import signal
import sys
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

__all__ = ["exit_if_terminated", "terminable"]

_DELAY_S = 0.01
"""The time until the exception is raised again [s]."""


class _TerminatedError(SystemExit):
    """SIGTERM was received; ends the process after everything is closed."""


class _Termination:
    """Whether SIGTERM was received, and whether the exception that it raises may be raised again."""

    received = False
    running = False


@contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM during the `with` block ends it by an exception, and the process exits with 143.

    The exception is raised again if it was swallowed: by a destructor, or by an extension module while it is imported.
    """
    _Termination.running = True
    signal.signal(signal.SIGTERM, _on_signal)
    try:
        yield
    finally:
        _Termination.running = False
        exit_if_terminated()


def exit_if_terminated() -> None:
    """Exits if SIGTERM was received: another error was made of the exception, and would be reported instead."""
    if _Termination.received:
        sys.exit(128 + signal.SIGTERM)


def _on_signal(number: int, _: object) -> NoReturn:
    _Termination.received = True
    raise _make_error(number)  # no variable has it, since its traceback has this frame: a cycle would keep it alive


def _make_error(number: int) -> _TerminatedError:
    error = _TerminatedError(128 + number)
    weakref.finalize(error, _on_end_of_exception, number).atexit = False
    return error


def _on_end_of_exception(number: int) -> None:
    if _Termination.running:  # from a thread, since what is raised in this callback would be swallowed, too
        timer = threading.Timer(_DELAY_S, os.kill, (os.getpid(), number))
        timer.daemon = True
        timer.start()
