"""Options: what several verbs share, each said once."""

from __future__ import annotations

import math
from typing import Annotated

import typer

__all__ = [
    "AsJson",
    "Bundled",
    "Delta",
    "EngineName",
    "MapName",
    "MapOptions",
    "Maps",
    "OneMap",
    "Ontologies",
    "Port",
    "Seconds",
    "Verbose",
    "finite",
]


def finite(value: float | None) -> float | None:
    """Refuses the numbers that are none; typer's own bounds let them pass."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is no finite number")
    return value


_MAP = "A semantic map (OWL or Turtle), or bundled:kitchen."

OneMap = Annotated[str, typer.Argument(metavar="MAP", help=_MAP, show_default=False)]

Maps = Annotated[
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

Bundled = Annotated[
    bool,
    typer.Option(
        " /--no-bundled-ontology",
        help="Leave out the household ontology that comes with Mindstage.",
        show_default=False,
    ),
]

EngineName = Annotated[
    str,
    typer.Option("--engine", metavar="ENGINE", help="mujoco (physics), or null (everything stands still)."),
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

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for other programs.")]

Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="List every assumption, not only how many there are.")]
