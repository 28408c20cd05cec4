"""Options: what several verbs share, each said once.

Numbers: what was typed about how maps mean theirs, sorted by map.

Outcome: how a verb ends, told to the shell.

The three ends of every call are never mixed: done or yes (0), the world says no (1), trouble that lies outside of it
(2). Whatever Mindstage raises becomes one line on stderr and, with `--json`, an object on stdout.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from contextvars import ContextVar
from enum import IntEnum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, ParamSpec

import typer

from mindstage.cli.output import one_line, print_json
from mindstage.errors import AmbiguousMapError, MindstageError, WorldError

if TYPE_CHECKING:
    from enum import Enum

    from mindstage.knowledge import UnitConventions

__all__ = [
    "DEFAULT_CONVENTIONS",
    "AsJson",
    "AssetFolders",
    "Bundled",
    "Closure",
    "ConventionOptions",
    "Delta",
    "EndpointUrl",
    "EngineName",
    "ExitCode",
    "FrameNames",
    "MapArgument",
    "MapArguments",
    "MapName",
    "MapOptions",
    "Ontologies",
    "PageHost",
    "PageToken",
    "PlainBoxes",
    "Port",
    "QuaternionOrders",
    "Robots",
    "Seconds",
    "StoreFolder",
    "Strict",
    "UnitNames",
    "Verbose",
    "WithViewport",
    "close_at_end",
    "command",
    "exit_code",
    "finite",
    "options_given",
]


class ConventionOptions(NamedTuple):
    """The options `--units`, `--frame` and `--guess_quaternion_order`, each as often as it was given."""

    units: Sequence[str] | None = None
    frame: Sequence[str] | None = None
    quaternion: Sequence[str] | None = None

    def by_map(self, maps: Sequence[str]) -> list[UnitConventions]:
        """For each map, what was said of it; what was said of all maps counts where nothing was said of the one.

        Raises:
            InvalidArgumentError: there are no such units, or no such map.
        """
        from mindstage.knowledge import Handedness, LengthUnit, QuaternionOrder, UnitConventions

        units = _by_map("--units", self.units, maps, LengthUnit)
        frames = _by_map("--frame", self.frame, maps, Handedness)
        orders = _by_map("--quaternion", self.quaternion, maps, QuaternionOrder)
        return [
            UnitConventions(units=unit, frame=frame, quaternion=order)  # type: ignore[arg-type]
            for unit, frame, order in zip(units, frames, orders, strict=True)
        ]


DEFAULT_CONVENTIONS = ConventionOptions()


def _by_map(option: str, values: Sequence[str] | None, maps: Sequence[str], kind: type[Enum]) -> list[Enum | None]:
    from mindstage.errors import InvalidArgumentError

    choices = {str(choice.value): choice for choice in kind}
    known = {name: at for at, map in enumerate(maps) for name in (map, Path(map).name, Path(map).stem)}
    found: list[Enum | None] = [None] * len(maps)
    for text in sorted(values or (), key=lambda text: "=" in text):  # what is said of one map comes after, and counts
        map, equals, value = text.rpartition("=")
        if value.lower() not in choices:
            raise InvalidArgumentError(
                f"{option} {text}", cause=f"{value!r} is none of them", remedy=f"use {_choices(choices)}"
            )
        if equals and map not in known:
            raise InvalidArgumentError(
                f"{option} {text}", cause=f"no map {map!r} is loaded", remedy=f"use {_choices(known)}"
            )
        for at in [known[map]] if equals else range(len(maps)):
            found[at] = choices[value.lower()]
    return found


def _choices(names: Iterable[str]) -> str:
    return ", ".join(names)


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
        print_json({"error": {"kind": getattr(error, "code", type(error).__name__), "message": message}})
    typer.echo(f"mindstage: error: {one_line(message)}", err=True)


def finite(value: float | None) -> float | None:
    """Refuses the numbers that are none; typer's own bounds let them pass."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is no finite number")
    return value


def options_given(context: typer.Context, options: Mapping[str, str]) -> Iterator[str]:
    """Those of some options, by parameter, that stand on the command line, whatever their defaults are."""
    for name, option in options.items():
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            yield option


_MAP = "A semantic map (OWL or Turtle), or bundled:kitchen."

MapArgument = Annotated[str, typer.Argument(metavar="MAP", help=_MAP, show_default=False)]

MapArguments = Annotated[
    list[str],
    typer.Argument(metavar="MAP", help=f"{_MAP} Several are loaded into one knowledge base.", show_default=False),
]

MapOptions = Annotated[
    list[str] | None,
    typer.Option("--map", metavar="MAP", help=f"{_MAP} May be repeated.", show_default=False),
]

MapName = Annotated[
    str | None,
    typer.Option("--map-name", metavar="NAME", help="Which map, where several are loaded.", show_default=False),
]

Ontologies = Annotated[
    list[str] | None,
    typer.Option(
        "--ontology",
        metavar="PATH",
        help="An ontology file, a folder of ROS packages, or package://…; may be repeated. "
        "The folders of ROS_PACKAGE_PATH are searched too.",
        show_default=False,
    ),
]

Robots = Annotated[
    list[str] | None,
    typer.Option(
        "--urdf",
        metavar="FILE",
        help="A robot's description (URDF or xacro) that holds the places and joints of maps that only name links; "
        "may be repeated.",
        show_default=False,
    ),
]

Bundled = Annotated[
    bool,
    typer.Option(
        " /--no-bundled-ontology",
        help="Leave out the household ontology that comes with Mindstage.",
        show_default=False,
    ),
]

AssetFolders = Annotated[
    list[Path] | None,
    typer.Option(
        "--assets",
        metavar="DIR",
        help="A folder of mesh files (.glb, .gltf, .obj, .dae, .stl), found by path, name or class; may be repeated.",
        show_default=False,
    ),
]

PageHost = Annotated[
    str, typer.Option("--host", metavar="HOST", help="Where the page listens; others than this machine need a token.")
]

PageToken = Annotated[
    str | None,
    typer.Option(
        "--token",
        metavar="TOKEN",
        envvar="MINDSTAGE_TOKEN",
        help="What visitors of the page must know.",
        show_default=False,
    ),
]

PlainBoxes = Annotated[
    bool,
    typer.Option(
        "--plain-boxes", help="Every body is just the box that the map says, without the shapes that knowledge gives."
    ),
]

_PER_MAP = "MAP= before it, with a map's file name, says it of that one only; may be repeated."

UnitNames = Annotated[
    list[str] | None,
    typer.Option(
        "--units",
        metavar="[MAP=]UNITS",
        help=f"What lengths are counted in: m, cm or mm, instead of what the map makes likely. {_PER_MAP}",
        show_default=False,
    ),
]

FrameNames = Annotated[
    list[str] | None,
    typer.Option(
        "--frame",
        metavar="[MAP=]FRAME",
        help="Which way axes point: ros (right-handed, y left) or unreal (left-handed, y right).",
        show_default=False,
    ),
]

QuaternionOrders = Annotated[
    list[str] | None,
    typer.Option(
        "--quaternion", metavar="[MAP=]ORDER", help="Where rotations have w: wxyz or xyzw.", show_default=False
    ),
]

Strict = Annotated[bool, typer.Option("--strict", help="Refuse a map about which anything is odd, and end with 2.")]

StoreFolder = Annotated[
    Path | None,
    typer.Option(
        "--store",
        metavar="DIR",
        help="A folder that keeps what is loaded and told; once filled, it does without the sources.",
        show_default=False,
    ),
]

EndpointUrl = Annotated[
    str | None,
    typer.Option("--endpoint", metavar="URL", help="A SPARQL server that knows more.", show_default=False),
]

EngineName = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="ENGINE",
        help="mujoco (physics), godot (physics, in a Godot that is started for it; godot:window shows it), "
        "null (everything stands still), or ros://HOST:PORT/NAMESPACE (one far away).",
    ),
]

Delta = Annotated[
    float,
    typer.Option("--delta", min=0.0, callback=finite, help="How much a number may differ, in its unit (m, rad, kg …)."),
]

Port = Annotated[
    int,
    typer.Option("--port", metavar="PORT", min=0, max=65535, help="Where the page is served; 0 takes any free port."),
]

Seconds = Annotated[
    float | None,
    typer.Option(
        "--for",
        metavar="SECONDS",
        min=0.0,
        callback=finite,
        help="How long the world lives: simulated seconds, or real ones where the viewport shows it.",
        show_default=False,
    ),
]

WithViewport = Annotated[
    bool, typer.Option(" /--no-viewport", help="Do not show the world in the browser.", show_default=False)
]

Closure = Annotated[
    bool,
    typer.Option("--closure", help="First derive all that follows by the rules of OWL 2 RL (extra `closure`)."),
]

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for other programs.")]

Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="List every assumption, not only how many there are.")]
