"""App: all verbs under one name.

Nothing heavy is imported here or at the top of a verb's file: a verb loads the rooms it needs when it runs, so that
help and completion answer at once.
"""

from __future__ import annotations

import gc
import signal
import sys
import traceback
from collections.abc import Iterable
from typing import Annotated, NoReturn

import typer

from mindstage import __version__
from mindstage.cli.ask import ask, questions, sparql, tell
from mindstage.cli.maps import analyse, compare, convert, validate
from mindstage.cli.options import ExitCode, command
from mindstage.cli.place import furnish
from mindstage.cli.prolog import prolog
from mindstage.cli.serve import serve
from mindstage.cli.shot import shot
from mindstage.cli.simulate import check, log, spawn
from mindstage.cli.viewer import demo

__all__ = ["app", "main"]

_COMMANDS = {
    function.__name__: function
    for function in (
        demo,
        spawn,
        shot,
        analyse,
        validate,
        compare,
        check,
        log,
        serve,
        convert,
        furnish,
        ask,
        questions,
        prolog,
        sparql,
        tell,
    )
}


def _make_app(commands: Iterable[str]) -> typer.Typer:
    """The command line with some of its verbs; typer inspects the signature of each, which takes a while."""
    app = typer.Typer(
        name="mindstage",
        help="Turns what a robot knows about a place into a place it can act in.",
        epilog="Exit codes: 0 done, or yes; 1 the world says no, or a difference was found; 2 trouble.",
        no_args_is_help=True,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    for name in commands:
        app.command()(command(_COMMANDS[name]))
    app.callback()(_options)
    return app


def main() -> None:
    """Runs the command line and ends the process."""
    # A verb makes many values that it keeps until it ends: looking for garbage among them again and again finds none.
    gc.set_threshold(50_000, 20, 50)
    signal.signal(signal.SIGTERM, _on_signal)
    try:
        wanted = sys.argv[1:2]
        _make_app(wanted if wanted and wanted[0] in _COMMANDS else _COMMANDS)(prog_name="mindstage")
    except Exception:
        # A defect of ours. Python would end with 1, which here means "the world says no".
        traceback.print_exc()
        print("mindstage: this is a defect in Mindstage, please report it", file=sys.stderr)  # noqa: T201
        sys.exit(ExitCode.ERROR)
    finally:
        gc.freeze()  # nor is there anything to find when all of it goes


def _on_signal(number: int, _: object) -> NoReturn:
    """Who is told to end closes what it has opened: browsers, engines, pages."""
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
    """Options that belong to no verb."""


app = _make_app(_COMMANDS)
"""The whole command line."""
