"""Options: what several verbs share, each said once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "AsJson",
    "AssetFolders",
    "Bundled",
    "Closure",
    "Delta",
    "EndpointUrl",
    "EngineName",
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
    "finite",
    "options_given",
]


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
