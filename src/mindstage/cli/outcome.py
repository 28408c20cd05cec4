"""Outcome: how a verb ends, told to the shell.

The three ends of every call are never mixed: done or yes (0), the world says no (1), trouble that lies outside of it
(2). Whatever Mindstage raises becomes one line on stderr and, with `--json`, an object on stdout.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from contextvars import ContextVar
from enum import IntEnum
from functools import wraps
from typing import ParamSpec

import typer

from mindstage.cli.output import one_line, print_json
from mindstage.errors import AmbiguousMapError, MindstageError, WorldError

__all__ = ["ExitCode", "close_at_end", "command", "exit_code"]

P = ParamSpec("P")

_CLOSE_CALLBACKS: ContextVar[ExitStack | None] = ContextVar("_ENDS", default=None)
"""What the verb that is running must let go of."""


class ExitCode(IntEnum):
    """The exit codes."""

    OK = 0
    """It worked; where the verb asks something, the answer is yes."""
    NEGATIVE = 1
    """It worked, and the answer is no: maps differ, or something could not be spawned."""
    ERROR = 2
    """It did not work: a file, an engine, the command line itself."""
    INTERRUPTED = 130
    """Ctrl-C."""
    PIPE_CLOSED = 141
    """Whoever read the output had enough."""


def exit_code(error: MindstageError) -> ExitCode:
    """How an error ends the process."""
    return ExitCode.NEGATIVE if isinstance(error, WorldError) else ExitCode.ERROR


def close_at_end(close: Callable[[], None]) -> None:
    """Has something closed when the verb ends, however it does."""
    if ends := _CLOSE_CALLBACKS.get():
        ends.callback(close)


def command(function: Callable[P, ExitCode]) -> Callable[P, None]:
    """Makes a function a verb: what it returns or raises becomes the process's end.

    Args:
        function: its parameter `as_json`, if it has one, decides how errors are told.
    """

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        as_json = bool(kwargs.get("as_json"))
        try:
            with ExitStack() as ends:
                _CLOSE_CALLBACKS.set(ends)
                outcome = function(*args, **kwargs)
            sys.stdout.flush()  # a closed pipe shall show here, not while Python shuts down
        except MindstageError as error:
            outcome = exit_code(error)
            _print_error(error, _error_text(error), as_json=as_json)
        except BrokenPipeError:
            outcome = ExitCode.PIPE_CLOSED
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except OSError as error:
            outcome = ExitCode.ERROR
            _print_error(
                error, f"{error.filename}: {error.strerror}" if error.filename else str(error), as_json=as_json
            )
        except KeyboardInterrupt:
            outcome = ExitCode.INTERRUPTED
        raise typer.Exit(outcome)

    return run


def _error_text(error: MindstageError) -> str:
    hint = " with --map-name" if isinstance(error, AmbiguousMapError) else ""
    return f"{error}{hint}"


def _print_error(error: Exception, message: str, *, as_json: bool) -> None:
    if as_json:
        print_json({"error": {"kind": type(error).__name__, "message": message}})
    typer.echo(f"mindstage: error: {one_line(message)}", err=True)
