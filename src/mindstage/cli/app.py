"""The typer application with all verbs, and its entry point.

Modules of the command line import heavy packages inside functions only, so that help and completion are fast.
"""

from __future__ import annotations

import gc
import io
import os
import sys
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from keyword import iskeyword
from typing import Annotated

import typer

from mindstage import __version__
from mindstage.cli.options import ExitCode, VerbCommand, command, discard_output
from mindstage.cli.termination import exit_if_terminated

__all__ = ["app", "main"]

app: typer.Typer
"""The application with all verbs."""

_MODULES = {
    "demo": "viewer",
    "spawn": "simulate",
    "shot": "shot",
    "render": "render",
    "analyze": "maps",
    "validate": "maps",
    "compare": "maps",
    "check": "simulate",
    "log": "simulate",
    "serve": "serve",
    "record": "record",
    "convert": "maps",
    "place": "place",
    "evaluate": "evaluate",
    "do": "do",
    "replay": "replay",
    "ask": "ask",
    "questions": "ask",
    "prolog": "prolog",
    "sparql": "ask",
    "tell": "ask",
}
"""The module of each verb, a function of that name; a command imports that of one verb only."""
_ALIASES = {"analyse": "analyze", "furnish": "place"}
"""Former names of verbs, which are not listed in the help."""
_GROUPS = {"episode": {"info": "record", "repair": "record", "export": "export", "import": "export"}}
"""Verbs with verbs of their own, such as `mindstage episode info`, and the modules of these."""
_GROUP_HELP = {"episode": "Describe, repair, export and import recorded episodes."}


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
        if name in _GROUPS:
            app.add_typer(_make_group(name), name=name)
            continue
        verb = _ALIASES.get(name, name)
        function: Callable[..., ExitCode] = getattr(import_module(f"mindstage.cli.{_MODULES[verb]}"), verb)
        app.command(name, cls=VerbCommand, hidden=name in _ALIASES)(command(function))
    app.callback()(_options)
    return app


def _make_group(name: str) -> typer.Typer:
    group = typer.Typer(help=_GROUP_HELP[name], no_args_is_help=True, rich_markup_mode="rich")
    for verb, module in _GROUPS[name].items():
        name_in_module = f"{verb}_" if iskeyword(verb) else verb
        function: Callable[..., ExitCode] = getattr(import_module(f"mindstage.cli.{module}"), name_in_module)
        group.command(verb, cls=VerbCommand)(command(function))
    return group


def main() -> None:
    """Runs the command line and exits the process."""
    # A verb keeps most of its objects until it ends, so that frequent garbage collections find nothing.
    gc.set_threshold(50_000, 20, 50)
    # NumPy's linear algebra would start a thread for each processor; no verb has matrices that are worth it.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the shell
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # what an encoding cannot represent is no reason to fail
    try:
        verb = sys.argv[1:2]
        _make_app(verb if verb and verb[0] in _MODULES | _ALIASES | _GROUPS else [*_MODULES, *_GROUPS])(
            prog_name="mindstage"
        )
    except OSError as error:  # of the output of --help and --version; verbs handle their own
        discard_output()
        if not isinstance(error, BrokenPipeError):
            with suppress(OSError):
                print(f"mindstage: error: standard output cannot be written: {error.strerror}", file=sys.stderr)  # noqa: T201
        sys.exit(ExitCode.PIPE_CLOSED if isinstance(error, BrokenPipeError) else ExitCode.ERROR)
    except Exception:
        exit_if_terminated()
        # A bug. Python's own exit code would be 1, which means "no" here.
        traceback.print_exc()
        print("mindstage: this is a bug in Mindstage, please report it", file=sys.stderr)  # noqa: T201
        sys.exit(ExitCode.ERROR)
    finally:
        if "ompl" not in sys.modules:  # its bindings print all that is not collected at exit
            gc.freeze()  # a collection at exit would find nothing either


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
    globals()["app"] = made = _make_app([*_MODULES, *_GROUPS, *_ALIASES])
    return made
