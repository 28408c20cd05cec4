"""The typer application with all verbs, and its entry point.

Modules of the command line import heavy packages inside functions only, so that help and completion are fast.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Annotated, NoReturn

import typer

from mindstage import __version__
from mindstage.cli.ask import ask, questions, sparql, tell
from mindstage.cli.maps import analyze, compare, convert, validate
from mindstage.cli.options import ExitCode, VerbCommand, command, discard_output
from mindstage.cli.place import place
from mindstage.cli.prolog import prolog
from mindstage.cli.serve import serve
from mindstage.cli.shot import shot
from mindstage.cli.simulate import check, log, spawn
from mindstage.cli.viewer import demo

__all__ = ["app", "main"]

app: typer.Typer
"""The application with all verbs."""

_COMMANDS: dict[str, Callable[..., ExitCode]] = {
    function.__name__: function
    for function in (
        demo,
        spawn,
        shot,
        analyze,
        validate,
        compare,
        check,
        log,
        serve,
        convert,
        place,
        ask,
        questions,
        prolog,
        sparql,
        tell,
    )
}
_ALIASES: dict[str, Callable[..., ExitCode]] = {"analyse": analyze, "furnish": place}
"""Former names of verbs, which are not listed in the help."""


def _make_app(commands: Iterable[str]) -> typer.Typer:
    """The application with some of the verbs; inspecting the signatures of all of them is slow."""
    app = typer.Typer(
        name="mindstage",
        help="Simulates semantic maps of robots, answers questions about them, and writes them back.",
        epilog="Exit codes: 0 success, or yes; 1 no, a difference, or an incomplete world; 2 error.",
        no_args_is_help=True,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    for name in commands:
        app.command(name, cls=VerbCommand, hidden=name in _ALIASES)(command((_COMMANDS | _ALIASES)[name]))
    app.callback()(_options)
    return app


def main() -> None:
    """Runs the command line and exits the process."""
    # A verb keeps most of its objects until it ends, so that frequent garbage collections find nothing.
    gc.set_threshold(50_000, 20, 50)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the shell
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    signal.signal(signal.SIGTERM, _on_signal)
    try:
        verb = sys.argv[1:2]
        _make_app(verb if verb and verb[0] in _COMMANDS | _ALIASES else _COMMANDS)(prog_name="mindstage")
    except OSError as error:  # of the output of --help and --version; verbs handle their own
        discard_output()
        if not isinstance(error, BrokenPipeError):
            with suppress(OSError):
                print(f"mindstage: error: standard output cannot be written: {error.strerror}", file=sys.stderr)  # noqa: T201
        sys.exit(ExitCode.PIPE_CLOSED if isinstance(error, BrokenPipeError) else ExitCode.ERROR)
    except Exception:
        # A bug. Python's own exit code would be 1, which means "no" here.
        traceback.print_exc()
        print("mindstage: this is a bug in Mindstage, please report it", file=sys.stderr)  # noqa: T201
        sys.exit(ExitCode.ERROR)
    finally:
        gc.freeze()  # a collection at exit would find nothing either


def _on_signal(number: int, _: object) -> NoReturn:
    """Exits on SIGTERM, so that browsers, engines and servers are closed."""
    sys.exit(128 + number)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"mindstage {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Options of the command itself."""


def __getattr__(name: str) -> object:
    """Makes `app`, the application with all verbs, at its first use: a command needs one verb only."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()["app"] = made = _make_app([*_COMMANDS, *_ALIASES])
    return made
