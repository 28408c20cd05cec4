"""Options that several verbs share, and the exit codes of all verbs.

A verb exits with 0 for success or yes, 1 for no or an incomplete world, and 2 for an error. An error of Mindstage is
one line on stderr and, with `--json`, also an object on stdout.
"""

from __future__ import annotations

import errno
import os
import re
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from contextvars import ContextVar
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import wraps
from inspect import Parameter, signature
from itertools import islice
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, Union, get_args, get_origin, get_type_hints

import typer
from msgspec import Meta
from typer.core import TyperCommand
from typer.models import ParameterInfo

from mindstage.cli.output import one_line, print_json
from mindstage.cli.termination import exit_if_terminated
from mindstage.errors import (
    AmbiguousMapError,
    InvalidArgumentError,
    MindstageError,
    SourceParseError,
    WorldError,
    without_surrogates,
)
from mindstage.ranges import Coordinate, NotNegative, Range, Time, WallTime, range_of
from mindstage.ranges import Port as PortNumber

if TYPE_CHECKING:
    from enum import Enum

    from mindstage.maps import UnitConventions
    from mindstage.maps.urdf.xacro_process import XacroRequest

__all__ = [
    "DEFAULT_MAP",
    "DEFAULT_PICTURE",
    "DEFAULT_READING",
    "DEFAULT_SHAPES",
    "DEFAULT_SPAWN",
    "LOCAL_SERVER",
    "LOOPBACK",
    "NO_EPISODES",
    "REMOTE_SCHEMES",
    "AsJson",
    "AtTime",
    "Closure",
    "Delta",
    "DuringInterval",
    "EndpointUrl",
    "EngineName",
    "EpisodeOptions",
    "ExitCode",
    "Ground",
    "MapArgument",
    "MapArguments",
    "MapChoice",
    "MapName",
    "MapOptions",
    "MapReading",
    "MapSpawning",
    "OptionGroup",
    "PictureOptions",
    "Port",
    "Running",
    "Seconds",
    "ServerOptions",
    "ShapeOptions",
    "SinceTime",
    "StoreFolder",
    "Strict",
    "UntilTime",
    "VerbCommand",
    "Verbose",
    "WithViewer",
    "close_at_end",
    "command",
    "discard_output",
    "exit_code",
    "options_given",
]


def _by_map(option: str, values: Sequence[str] | None, maps: Sequence[str], kind: type[Enum]) -> list[Enum | None]:
    choices = {str(choice.value): choice for choice in kind}
    known = {name: at for at, map in enumerate(maps) for name in (map, Path(map).name, Path(map).stem)}
    found: list[Enum | None] = [None] * len(maps)
    for text in sorted(values or (), key=lambda text: "=" in text):  # values for one map override
        map, equals, value = text.rpartition("=")
        if value.lower() not in choices:
            raise InvalidArgumentError(
                f"{option} {text}", cause=f"{value!r} is not a valid value", remedy=f"use {_choices(choices)}"
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

_CLOSE_CALLBACKS: ContextVar[ExitStack | None] = ContextVar("_CLOSE_CALLBACKS", default=None)
"""The callbacks that close the resources of the running verb."""


class ExitCode(IntEnum):
    """The exit codes of all verbs."""

    OK = 0
    """Success; of a question, the answer is yes."""
    NEGATIVE = 1
    """The answer is no, maps differ, or something could not be spawned."""
    ERROR = 2
    """An error of a file, an engine or the command line."""
    UNKNOWN = 3
    """It is not known whether a plan succeeds, or has succeeded."""
    INTERRUPTED = 130
    """Ctrl-C."""
    PIPE_CLOSED = 141
    """The reader of the output closed the pipe."""
    TERMINATED = 143
    """SIGTERM."""


def exit_code(error: MindstageError) -> ExitCode:
    """The exit code of an error."""
    return ExitCode.NEGATIVE if isinstance(error, WorldError) else ExitCode.ERROR


def close_at_end(close: Callable[[], None]) -> None:
    """Registers a callback that runs when the verb ends, normally or by an error."""
    if callbacks := _CLOSE_CALLBACKS.get():
        callbacks.callback(close)


def command(function: Callable[P, ExitCode]) -> Callable[P, None]:
    """Makes a function a verb: its result or error becomes the exit code.

    Args:
        function: its parameter `as_json`, if it has one, determines whether errors are printed as JSON too. A parameter
            of a class of options, such as `MapReading`, is replaced by the options of that class.
    """
    hints = get_type_hints(function, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if _is_group(hint)}
    ranges: dict[str, tuple[str, Range]] = {}

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        as_json = bool(kwargs.get("as_json"))
        given: dict[str, Any] = kwargs
        for name, (option, range) in ranges.items():
            if given.get(name) is not None and given[name] not in range:
                raise typer.BadParameter(f"{given[name]} is not {range.text}", param_hint=f"'{option}'")
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        try:
            with ExitStack() as callbacks:
                _CLOSE_CALLBACKS.set(callbacks)
                code = function(*args, **kwargs)
            sys.stdout.flush()  # raises BrokenPipeError here instead of at exit
        except MindstageError as error:
            code = exit_code(error)
            _print_error(error, _error_text(error), as_json=as_json)
        except BrokenPipeError:
            code = ExitCode.PIPE_CLOSED
            discard_output()
        except OSError as error:
            code = ExitCode.ERROR
            message = f"{error.filename}: {error.strerror}" if error.filename else str(error)
            if error.filename is None and error.errno in _OUTPUT_ERRORS:
                message = f"standard output cannot be written: {error.strerror}"
                discard_output()
            _print_error(error, message, as_json=as_json)
        except KeyboardInterrupt:
            code = ExitCode.INTERRUPTED
        raise typer.Exit(code)

    _replace_groups(run, function, hints)
    for name, annotation in run.__annotations__.items():
        option = next((each for each in get_args(annotation) if isinstance(each, ParameterInfo)), None)
        if option is not None and (range := _option_range(annotation, option)) is not None:
            names = (each for each in (option.default, *(option.param_decls or ())) if isinstance(each, str))
            ranges[name] = next((each for each in names if each.startswith("--")), name), range
    return run


def _option_range(annotation: object, option: ParameterInfo) -> Range | None:
    """The range of a number on the command line: that of its type, else the bounds of the option."""
    if (range := range_of(annotation)) is not None:
        option.min = range.low if abs(range.low) < sys.float_info.max else None  # shown by --help
        option.max = range.high if abs(range.high) < sys.float_info.max else None
        return range
    types = {*get_args(annotation), *(each for part in get_args(annotation) for each in get_args(part))}
    if types & {int, float}:
        return Range.of(Meta(ge=option.min, le=option.max), integer=int in types)
    return None


_NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|-inf|-nan", re.ASCII)


class VerbCommand(TyperCommand):
    """A verb whose arguments may be negative numbers, and whose option `--running` has an optional value.

    click takes each argument that begins with - for an option, and knows no option with an optional value beside flags.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parses the arguments, in which the options are moved before the positional ones if these have numbers."""
        options, positional = self._sorted_arguments(args)
        if any(_NEGATIVE_NUMBER.fullmatch(each) for each in positional):
            return super().parse_args(ctx, [*options, "--", *positional])
        return super().parse_args(ctx, _with_running_value(args))

    def _sorted_arguments(self, args: Sequence[str]) -> tuple[list[str], list[str]]:
        """The options with their values, and the positional arguments."""
        options: list[str] = []
        positional: list[str] = []
        remaining = iter(_with_running_value(args))
        for arg in remaining:
            if arg == "--":
                positional += remaining
            elif not arg.startswith("-") or arg == "-" or _NEGATIVE_NUMBER.fullmatch(arg):
                positional.append(arg)
            else:
                options.append(arg)
                for value in islice(remaining, self._value_count(arg)):
                    options.append(value)
        return options, positional

    def _value_count(self, arg: str) -> int:
        """The number of following arguments that are values of an option."""
        for parameter in self.params:
            if arg in (*parameter.opts, *parameter.secondary_opts) and parameter.param_type_name == "option":
                return 0 if getattr(parameter, "is_flag", False) or getattr(parameter, "count", False) else 1
        return 0


def _with_running_value(args: Sequence[str]) -> list[str]:
    """The arguments, in which `--running` has a value: the address after it, or an empty text."""
    given: list[str] = []
    remaining = deque(args)
    while remaining:
        arg = remaining.popleft()
        if arg == "--":
            return [*given, arg, *remaining]
        if arg == "--running":
            has_address = remaining and remaining[0].startswith(REMOTE_SCHEMES)
            arg = f"--running={remaining.popleft() if has_address else ''}"
        given.append(arg)
    return given


class OptionGroup:
    """Base of dataclasses whose fields are options: a parameter of such a type adds all of them to a verb.

    A field is a parameter of the verb, with its option and its default value; `command` makes the object of them.
    """

    __slots__ = ()


def _is_group(hint: object) -> bool:
    return isinstance(hint, type) and issubclass(hint, OptionGroup)


def _replace_groups(run: Callable[..., None], function: Callable[..., object], hints: Mapping[str, Any]) -> None:
    """Gives a verb the signature of its function, with the options of each group instead of a parameter for them."""
    parameters: list[Parameter] = []
    for parameter in signature(function).parameters.values():
        group = hints[parameter.name]
        if _is_group(group):
            options = get_type_hints(group, include_extras=True)
            parameters += (
                Parameter(field.name, Parameter.KEYWORD_ONLY, default=field.default, annotation=options[field.name])
                for field in fields(group)
            )
        else:
            parameters.append(parameter.replace(annotation=group))
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    parameters = [each.replace(annotation=_without_range(each.annotation)) for each in parameters]
    run.__signature__ = signature(function).replace(parameters=parameters, return_annotation=None)  # type: ignore[attr-defined]


def _without_range(hint: Any) -> Any:
    """A type of an option without the range of the number, which typer does not understand in an optional type."""
    metadata = getattr(hint, "__metadata__", ())
    if metadata:
        kept = tuple(each for each in metadata if not isinstance(each, Meta))
        plain = _without_range(get_args(hint)[0])
        return Annotated[(plain, *kept)] if kept else plain
    if get_origin(hint) in {Union, UnionType}:
        return Union[tuple(_without_range(each) for each in get_args(hint))]  # noqa: UP007
    return hint


def _error_text(error: MindstageError) -> str:
    hint = " with --map-name" if isinstance(error, AmbiguousMapError) else ""
    return f"{error}{hint}"


_OUTPUT_ERRORS = frozenset(
    getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO", "EBADF") if hasattr(errno, name)
)
"""Errors of writing; those of a file have its name, those of standard output have none."""


def discard_output() -> None:
    """Discards what is printed from now on: writing to standard output failed, and would fail again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_error(error: Exception, message: str, *, as_json: bool) -> None:
    exit_if_terminated()
    try:
        if as_json:
            print_json({"error": {"code": getattr(error, "code", type(error).__name__), "message": message}})
    except OSError:
        discard_output()
    with suppress(OSError):  # nothing more can be reported
        typer.echo(f"mindstage: error: {one_line(message)}", err=True)


def options_given(context: typer.Context, options: Mapping[str, str]) -> Iterator[str]:
    """Those of the options, given by parameter name, that appear on the command line."""
    for name, option in options.items():
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            yield option


REMOTE_SCHEMES = ("ros://", "ros+tls://")
"""What the address of a simulation at a rosbridge begins with."""

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
    typer.Option("--map-name", metavar="NAME", help="The map to use, if several are loaded.", show_default=False),
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

UrdfFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--urdf",
        metavar="FILE",
        help="A robot description (URDF or xacro) that defines the links which the maps refer to; may be repeated.",
        show_default=False,
    ),
]

ExpandXacro = Annotated[
    bool,
    typer.Option(
        "--xacro",
        help="Expand xacro in the robot descriptions that are named here (MAP, --urdf, --robot); those that end in "
        ".xacro are expanded in any case.",
    ),
]

XacroArguments = Annotated[
    list[str] | None,
    typer.Option(
        "--xacro-arg",
        metavar="NAME:=VALUE",
        help="The value of an argument (xacro:arg) of the robot descriptions that are named here, which are expanded "
        "then; may be repeated.",
        show_default=False,
    ),
]

Bundled = Annotated[
    bool,
    typer.Option(
        " /--no-bundled-ontology",
        help="Do not load the bundled household ontology.",
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

LOOPBACK = "127.0.0.1"
"""The address of this machine, at which servers listen by default."""

Host = Annotated[
    str, typer.Option("--host", metavar="HOST", help="The address to listen at; one that is not local needs a token.")
]

Token = Annotated[
    str | None,
    typer.Option(
        "--token",
        metavar="TOKEN",
        envvar="MINDSTAGE_TOKEN",
        help="The token that clients must present.",
        show_default=False,
    ),
]

TlsCertificateFile = Annotated[
    Path | None,
    typer.Option(
        "--tls-cert",
        metavar="FILE",
        help="Serve over TLS (https://, wss://), with the certificate in this PEM file.",
        show_default=False,
    ),
]

TlsKeyFile = Annotated[
    Path | None,
    typer.Option(
        "--tls-key",
        metavar="FILE",
        help="The private key of --tls-cert; by default in the same file.",
        show_default=False,
    ),
]

VisitorLimitOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="NAME=NUMBER",
        help="A limit of each client address, such as connections=8 or messages_per_second=500; may be repeated.",
        show_default=False,
    ),
]

PrimitiveShapes = Annotated[
    bool,
    typer.Option(
        "--primitive-shapes",
        help="Use only the primitive shape of the map for each body, without meshes and shape rules.",
    ),
]

Ground = Annotated[
    bool,
    typer.Option("--ground/--no-ground", help="Assume a ground where the map has nothing below loose bodies."),
]

EpisodeFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--episode",
        metavar="FILE",
        help="Ask about a recorded episode, with the maps that it was recorded with; may be repeated. With --episodes, "
        "the name of one of them.",
        show_default=False,
    ),
]

EpisodeFolder = Annotated[
    Path | None,
    typer.Option(
        "--episodes",
        metavar="DIR",
        help="Ask about all episodes in a folder, which gets an index of their events.",
        show_default=False,
    ),
]

EngineName = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="ENGINE",
        help="mujoco (physics), godot (physics, in a Godot process; godot:window shows its window), "
        "null (no physics), or ros://HOST:PORT/NAMESPACE (a remote engine; ros+tls:// over TLS).",
    ),
]

_PER_MAP = "Prefix MAP= (a file name) for one map only; may be repeated."

UnitNames = Annotated[
    list[str] | None,
    typer.Option(
        "--units",
        metavar="[MAP=]UNITS",
        help=f"The unit of length: m, cm or mm; by default inferred from the map. {_PER_MAP}",
        show_default=False,
    ),
]

FrameNames = Annotated[
    list[str] | None,
    typer.Option(
        "--frame",
        metavar="[MAP=]FRAME",
        help="The coordinate frame: ros (right-handed, y left) or unreal (left-handed, y right).",
        show_default=False,
    ),
]

QuaternionOrders = Annotated[
    list[str] | None,
    typer.Option(
        "--quaternion", metavar="[MAP=]ORDER", help="The order of quaternions: wxyz or xyzw.", show_default=False
    ),
]

SizeFrames = Annotated[
    list[str] | None,
    typer.Option(
        "--sizes",
        metavar="[MAP=]FRAME",
        help="The axes that sizes of classes are measured along: body, or world (Unreal's loggers until June 2021).",
        show_default=False,
    ),
]

UnstatedMobilities = Annotated[
    list[str] | None,
    typer.Option(
        "--mobility",
        metavar="[MAP=]WHICH",
        help="Bodies without a mobility: by-class (what people carry and has something below it is loose) or static.",
        show_default=False,
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class MapReading(OptionGroup):
    """The options of every verb that reads maps."""

    ontologies: Ontologies = None
    bundled: Bundled = True
    urdf: UrdfFiles = None
    xacro: ExpandXacro = False
    xacro_arguments: XacroArguments = None
    units: UnitNames = None
    frame: FrameNames = None
    quaternion: QuaternionOrders = None
    sizes: SizeFrames = None
    mobility: UnstatedMobilities = None

    @property
    def xacro_request(self) -> XacroRequest:
        """Whether the descriptions that are named are expanded; None for those whose name ends in .xacro.

        Raises:
            InvalidArgumentError: an argument is not NAME:=VALUE, or is given twice.
        """
        if not self.xacro_arguments:
            return self.xacro or None
        arguments: dict[str, str] = {}
        for given in self.xacro_arguments:
            name, separator, value = given.partition(":=")
            if not separator or not name or name in arguments:
                cause = f"{given!r} is not NAME:=VALUE" if name not in arguments else f"{name} is given twice"
                raise InvalidArgumentError("--xacro-arg", cause=cause, remedy="write --xacro-arg size:=0.4")
            arguments[name] = value
        return arguments

    def conventions(self, maps: Sequence[str]) -> list[UnitConventions]:
        """The conventions of each map; a value for one map overrides a value for all maps.

        Raises:
            InvalidArgumentError: a value is invalid, or refers to a map that is not loaded.
        """
        from msgspec.structs import fields as struct_fields

        from mindstage.maps import UnitConventions

        kinds = {field.name: get_args(field.type)[0] for field in struct_fields(UnitConventions)}
        given = {name: _by_map(f"--{name}", getattr(self, name), maps, kind) for name, kind in kinds.items()}
        return [UnitConventions(**{name: given[name][at] for name in kinds}) for at in range(len(maps))]  # type: ignore[arg-type]


DEFAULT_READING = MapReading()
"""The options where none is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapChoice(MapReading):
    """The options of every verb that reads one of several maps."""

    map_name: MapName = None


DEFAULT_MAP = MapChoice()


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeOptions(MapChoice):
    """The options of every verb that reads a map and uses the shapes of its bodies."""

    assets: AssetFolders = None
    primitive_shapes: PrimitiveShapes = False

    def asset_folders(self) -> list[Path]:
        """The folders of `--assets`; none with `--primitive-shapes`, whose shapes need no files.

        Raises:
            SourceParseError: one of them does not exist.
        """
        for folder in self.assets or ():
            if not folder.is_dir():
                cause = "there is no such folder; --assets takes folders of mesh files"
                raise SourceParseError(str(folder), cause=cause)
        return [] if self.primitive_shapes else self.assets or []


DEFAULT_SHAPES = ShapeOptions()


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSpawning(ShapeOptions):
    """The options of every verb that reads and spawns a map."""

    engine: EngineName = "mujoco"


DEFAULT_SPAWN = MapSpawning()


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeOptions(OptionGroup):
    """The options of every verb that asks about recorded episodes."""

    episode: EpisodeFiles = None
    episodes: EpisodeFolder = None

    def named(self) -> dict[str, str]:
        """The episode that is asked about, as an argument; empty if there are several, or none.

        Raises:
            InvalidArgumentError: several names are given together with a folder.
        """
        names = self.episode or []
        if self.episodes is None:
            return {"episode": without_surrogates(Path(names[0]).stem)} if len(names) == 1 else {}
        if len(names) > 1:
            cause = f"{len(names)} names are given with --episodes"
            raise InvalidArgumentError("--episode", cause=cause, remedy="give one name, or none for all episodes")
        return {"episode": names[0]} if names else {}


NO_EPISODES = EpisodeOptions()


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerOptions(OptionGroup):
    """The options of every verb that opens a port."""

    host: Host = LOOPBACK
    token: Token = None
    tls_cert: TlsCertificateFile = None
    tls_key: TlsKeyFile = None
    limits: VisitorLimitOptions = None


LOCAL_SERVER = ServerOptions()

CameraPosition = Annotated[
    str | None,
    typer.Option("--from", metavar="X,Y,Z", help="The position of the camera, in meters.", show_default=False),
]
CameraTarget = Annotated[
    str | None,
    typer.Option(
        "--to", metavar="X,Y,Z|ID", help="The center of the picture: a point, in meters, or a body that fills it."
    ),
]
FromTop = Annotated[bool, typer.Option("--top", help="View from above.")]
SectionHeight = Annotated[
    Coordinate | None,
    typer.Option(
        "--section",
        metavar="HEIGHT",
        help="Clip everything above this height, in meters.",
        show_default=False,
    ),
]
Highlights = Annotated[
    list[str] | None,
    typer.Option(
        "--highlight",
        metavar="WHAT",
        help="Highlight the answers to a question ('storage_place_in_environment item=CowsMilk'), bodies by id, or all "
        "bodies of a class; may be repeated.",
        show_default=False,
    ),
]
HighlightColors = Annotated[
    list[str] | None,
    typer.Option("--color", metavar="COLOR", help="The color of each --highlight, in order.", show_default=False),
]
PictureSize = Annotated[str, typer.Option("--size", metavar="WIDTHxHEIGHT", help="The size of the picture, in pixels.")]
SecondsBefore = Annotated[WallTime, typer.Option("--for", metavar="SECONDS", help="Simulated time before the picture.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureOptions(OptionGroup):
    """The options of the verbs that make pictures."""

    position: CameraPosition = None
    look_at: CameraTarget = None
    top: FromTop = False
    section: SectionHeight = None
    highlights: Highlights = None
    colors: HighlightColors = None
    size: PictureSize = "1280x800"
    simulated_s: SecondsBefore = 0.0


DEFAULT_PICTURE = PictureOptions()

Running = Annotated[
    str | None,
    typer.Option(
        "--running",
        metavar="[ros://…]",
        help="Ask a simulation that is running: the one on this machine, one of several by --running=PID or =MAP, or "
        "that at ros://HOST:PORT. The address can also be given instead of a map.",
        show_default=False,
    ),
]

AtTime = Annotated[
    Time | None,
    typer.Option(
        "--at",
        metavar="SECONDS",
        help="The time in the episode that is asked about, since its begin; by default its end.",
        show_default=False,
    ),
]

DuringInterval = Annotated[
    str | None,
    typer.Option(
        "--during",
        metavar="BEGIN..END",
        help="The interval in the episode that is asked about; each answer gets the intervals in which it is one.",
        show_default=False,
    ),
]

SinceTime = Annotated[
    Time | None,
    typer.Option("--since", metavar="SECONDS", help="The begin of that interval.", show_default=False),
]

UntilTime = Annotated[
    Time | None,
    typer.Option("--until", metavar="SECONDS", help="The end of that interval.", show_default=False),
]

Strict = Annotated[bool, typer.Option("--strict", help="Reject a map with findings, and exit with 2.")]

StoreFolder = Annotated[
    Path | None,
    typer.Option(
        "--store",
        metavar="DIR",
        help="The folder of a persistent knowledge base; once filled, the sources are not needed.",
        show_default=False,
    ),
]

EndpointUrl = Annotated[
    str | None,
    typer.Option("--endpoint", metavar="URL", help="A SPARQL endpoint that is queried too.", show_default=False),
]

Delta = Annotated[
    NotNegative,
    typer.Option("--delta", help="Permitted difference of numbers, in their unit (m, rad, kg …)."),
]

Port = Annotated[
    PortNumber | None,
    typer.Option(
        "--port",
        metavar="PORT",
        help="The port of the page; 0 chooses a free one. By default 8080, or the next free one.",
        show_default=False,
    ),
]

Seconds = Annotated[
    WallTime | None,
    typer.Option(
        "--for",
        metavar="SECONDS",
        help="Duration: simulated time, or wall time if the page is shown.",
        show_default=False,
    ),
]

WithViewer = Annotated[bool, typer.Option(" /--no-viewer", help="Do not serve the page.", show_default=False)]

Closure = Annotated[
    bool,
    typer.Option("--closure", help="Derive the OWL 2 RL closure first (extra `closure`)."),
]

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]

Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="List each finding and assumption instead of counts.")]
