"""The `mindstage` command. Each verb parses its options, calls the library and prints the result."""

from __future__ import annotations

import signal
import sys
import weakref
from typing import NoReturn

__all__ = ["exit_if_terminated", "main"]


class _TerminatedError(SystemExit):
    """SIGTERM was received; ends the process after everything is closed."""


class _Termination:
    """Whether SIGTERM was received, and whether the exception that it raises may be raised again."""

    received = False
    running = False


def main() -> None:
    """Runs the command line and exits the process, with 143 if SIGTERM is received at any time."""
    _Termination.running = True
    signal.signal(signal.SIGTERM, _on_signal)  # before the imports, which take most of the time of some verbs
    try:
        from mindstage.cli.app import main as run

        run()
    finally:
        _Termination.running = False
        exit_if_terminated()


def exit_if_terminated() -> None:
    """Exits if SIGTERM was received, and an import or a library has made another error of the exception."""
    if _Termination.received:
        sys.exit(128 + signal.SIGTERM)


def _on_signal(number: int, _: object) -> NoReturn:
    _Termination.received = True
    error = _TerminatedError(128 + number)
    weakref.finalize(error, _on_swallowed, number).atexit = False
    raise error


def _on_swallowed(number: int) -> None:
    """Raises the exception again if it was swallowed: by a destructor, or by an extension module during its import."""
    if _Termination.running:
        signal.raise_signal(number)
