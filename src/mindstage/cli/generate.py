"""The verb `generate home`: writes a map of a generated home."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import AsJson, ExitCode
from mindstage.cli.output import print_json, print_line
from mindstage.homes.styles import HomeDialect, HomePart, HomeStyle

if TYPE_CHECKING:
    from mindstage.scene import World

__all__ = ["home"]

_XML_SUFFIXES = (".owl", ".rdf", ".xml")


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
    dialect: Annotated[
        HomeDialect | None,
        typer.Option(
            "--dialect",
            help="The dialect of an older program, with its habits, as RDF/XML.",
            show_default="Mindstage's",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            "--truth",
            metavar="FILE",
            help="JSON of what the dialect hides: boxes, pivots, joints, frictions.",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Generate a furnished place whose doors and drawers open; equal options give equal files."""
    from mindstage.homes import generate_home

    _check_files(out, dialect, truth)
    world = generate_home(seed=seed, style=style, size=size, rooms=rooms, clutter=clutter, without=without or ())
    _write(world, out, dialect, truth)
    if as_json:
        counts = {"bodies": len(world.bodies), "joints": len(world.joints)}
        print_json({"map": world.iri, "out": str(out), "seed": seed, "style": style, **counts})
    else:
        print_line(f"{len(world.bodies)} bodies, {len(world.joints)} joints → {out}")
    return ExitCode.OK


def _check_files(out: Path, dialect: HomeDialect | None, truth: Path | None) -> None:
    """Raises an error if a file cannot be written.

    Raises:
        InvalidArgumentError: there is a truth without a dialect, or the name of the map is not one of RDF/XML.
    """
    from mindstage.errors import InvalidArgumentError

    if truth is not None and dialect is None:
        cause = "it is written beside a map of another dialect"
        raise InvalidArgumentError("--truth", cause=cause, remedy="omit it, or name a --dialect")
    if dialect is not None and out.suffix not in _XML_SUFFIXES:
        remedy = f"end its name with {', '.join(_XML_SUFFIXES)}"
        raise InvalidArgumentError("--out", cause=f"{out.name} cannot be in this dialect", remedy=remedy)


def _write(world: World, out: Path, dialect: HomeDialect | None, truth: Path | None) -> None:
    from mindstage.files import atomic_write
    from mindstage.homes import write_home
    from mindstage.maps import save_map

    if dialect is None:
        save_map(world, out)
        return
    written = write_home(world, dialect=dialect)
    atomic_write(out, written.text.encode())
    if written.urdf:
        atomic_write(out.with_suffix(".urdf"), written.urdf.encode())
    if truth is not None:
        atomic_write(truth, written.truth.encode())
