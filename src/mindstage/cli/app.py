"""The typer application with all verbs, and its entry point.

Modules of the command line import heavy packages inside functions only, so that help and completion are fast.
"""

from __future__ import annotations

import gc
import io
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from types import FunctionType
from typing import Annotated

import typer

from mindstage import __version__
from mindstage.cli.options import ExitCode, VerbCommand, command, discard_output
from mindstage.cli.termination import exit_if_terminated
from mindstage.errors import ExtensionError
from mindstage.registry import Group, extensions, reporting

__all__ = ["app", "main"]

app: typer.Typer
"""The application with all verbs."""

_ALIASES = {"analyse": "analyze", "furnish": "place"}
"""Former names of verbs, which are not listed in the help."""
_GROUP_HELP = {
    "episode": "Describe, repair, export and import recorded episodes.",
    "generate": "Generate maps of places that exist nowhere.",
    "ros2": "Check ROS 2 on this machine, and build the message packages that it lacks.",
}
"""Help texts of verbs with verbs of their own, such as `mindstage episode info`."""


def _make_app(verb: str | None = None) -> typer.Typer:
    """The application with all verbs, or with one of them: inspecting the signatures of all of them is slow.

    Raises:
        ExtensionError: the package that adds this verb cannot be imported.
    """
    app = typer.Typer(
        name="mindstage",
        help="Simulates semantic maps of robots, answers questions about them, and writes them back.",
        epilog="Exit codes: 0 success, or yes; 1 no, a difference, or an incomplete world; 2 error.",
        no_args_is_help=True,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    groups: dict[str, typer.Typer] = {}
    for name, each in extensions(Group.VERBS).items():
        group, _, last = name.rpartition(".")
        if verb is not None and _ALIASES.get(verb, verb) not in {name, group}:
            continue
        with nullcontext() if verb == name else reporting(), each.failing():
            function = command(each.load(FunctionType))
            parent = groups.setdefault(group, _make_group(group)) if group else app
            parent.command(last, cls=VerbCommand)(function)
            for alias in (alias for alias, meant in _ALIASES.items() if meant == name):
                app.command(alias, cls=VerbCommand, hidden=True)(function)
    for name, made in groups.items():
        app.add_typer(made, name=name)
    app.callback()(_options)
    return app


def _make_group(name: str) -> typer.Typer:
    return typer.Typer(help=_GROUP_HELP.get(name, ""), no_args_is_help=True, rich_markup_mode="rich")


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
        _make_app(_verb_of(sys.argv))(prog_name="mindstage")
    except ExtensionError as error:
        print(f"mindstage: error: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(ExitCode.ERROR)
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


def _verb_of(argv: Sequence[str]) -> str | None:
    """The verb of a command; None if it has none, or no known one, so that the help lists all."""
    known = extensions(Group.VERBS)
    first = argv[1] if len(argv) > 1 else ""
    return first if first in _ALIASES or any(first in {name, name.rpartition(".")[0]} for name in known) else None


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
    globals()["app"] = made = _make_app()
    return made
