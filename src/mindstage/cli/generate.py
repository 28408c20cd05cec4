"""The verb `generate home`: writes a map of a generated home."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mindstage.cli.options import AsJson, ExitCode
from mindstage.cli.output import print_json, print_line
from mindstage.homes.styles import HomePart, HomeStyle

__all__ = ["home"]


def home(
    *,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="OUT", help="The map to write (.owl, .rdf, .xml or .ttl).", show_default=False
        ),
    ],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Homes of different seeds differ.")] = 0,
    style: Annotated[HomeStyle, typer.Option("--style", help="The kind of place.")] = HomeStyle.KITCHEN,
    size: Annotated[float, typer.Option("--size", min=0.8, max=3.0, help="Factor of the floor areas.")] = 1.0,
    rooms: Annotated[
        int | None,
        typer.Option("--rooms", min=1, max=24, help="Number of rooms besides the corridor.", show_default="by style"),
    ] = None,
    clutter: Annotated[
        float, typer.Option("--clutter", min=0.0, max=3.0, help="How many things there are; 1 is usual.")
    ] = 1.0,
    without: Annotated[
        list[HomePart] | None, typer.Option("--without", help="What is left out; may be repeated.", show_default=False)
    ] = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Generate a furnished place whose doors and drawers open; equal options give equal files."""
    from mindstage.homes import generate_home
    from mindstage.maps import save_map

    world = generate_home(seed=seed, style=style, size=size, rooms=rooms, clutter=clutter, without=without or ())
    save_map(world, out)
    if as_json:
        counts = {"bodies": len(world.bodies), "joints": len(world.joints)}
        print_json({"map": world.iri, "out": str(out), "seed": seed, "style": style, **counts})
    else:
        print_line(f"{len(world.bodies)} bodies, {len(world.joints)} joints → {out}")
    return ExitCode.OK
