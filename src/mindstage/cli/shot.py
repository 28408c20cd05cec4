"""`mindstage shot`: a picture of a map's world.

The world stands still while it is taken, so that the same map gives the same picture.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from mindstage.cli.engine import alone_in, make_engine
from mindstage.cli.opening import open_up
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    EngineName,
    MapName,
    Maps,
    Ontologies,
    PlainBoxes,
    Robots,
    finite,
)
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import print_json, say, warn, working
from mindstage.cli.passing import let_pass
from mindstage.cli.pointing import Pointer
from mindstage.cli.report import report_json, warn_of_failures
from mindstage.cli.sources import knowledge_base
from mindstage.cli.staging import stage_for
from mindstage.errors import ArgumentRefused

if TYPE_CHECKING:
    from mindstage.stage import Shown, Stage
    from mindstage.viewport import Labels, Shot
    from mindstage.world import BodyId, Vector

__all__ = ["shot"]


class _Eye(TypedDict):
    """Those fields of a `Shot`."""

    position: Vector | None
    look_at: Vector | None
    focus: tuple[BodyId, ...]
    top: bool


_COLOURS = ("blue", "green", "yellow", "red", "black")
"""In turn, where nobody says which."""

Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE.png", help="Where the picture goes.", show_default=False)
]
From = Annotated[
    str | None, typer.Option("--from", metavar="X,Y,Z", help="Where the eye is, in metres.", show_default=False)
]
To = Annotated[
    str | None,
    typer.Option(
        "--to", metavar="X,Y,Z|ID", help="What is in the middle: a point, in metres, or a body that fills the picture."
    ),
]
Top = Annotated[bool, typer.Option("--top", help="Look straight down, as on a plan.")]
Section = Annotated[
    float | None,
    typer.Option(
        "--section",
        metavar="HEIGHT",
        callback=finite,
        help="Leave out all above a height, in metres, to see into rooms.",
        show_default=False,
    ),
]
Highlights = Annotated[
    list[str] | None,
    typer.Option(
        "--highlight",
        metavar="WHAT",
        help="Light up the answers to a question ('storage_place_in_environment item=CowsMilk'), bodies by their ids, "
        "or all of a class; may be repeated.",
        show_default=False,
    ),
]
Colours = Annotated[
    list[str] | None,
    typer.Option("--colour", metavar="COLOUR", help="Of each --highlight, in their order.", show_default=False),
]
Opened = Annotated[
    list[str] | None,
    typer.Option("--open", metavar="ID", help="Pull a door or drawer open first; may be repeated.", show_default=False),
]
Selected = Annotated[
    str | None, typer.Option("--select", metavar="ID", help="A body to draw a frame round.", show_default=False)
]
LabelsOf = Annotated[
    str, typer.Option("--labels", metavar="WHICH", help="Names beside bodies: none, selected, class or all.")
]
Size = Annotated[str, typer.Option("--size", metavar="WIDTHxHEIGHT", help="Of the picture, in pixels.")]
WholePage = Annotated[bool, typer.Option("--page", help="Show the whole page with its panels, not the world alone.")]
Panel = Annotated[
    str,
    typer.Option("--panel", metavar="NAME", help="The same with this panel in front: outliner, details, add, ask …"),
]
BrowserPath = Annotated[
    str | None,
    typer.Option(
        "--browser",
        metavar="PROGRAM",
        envvar=["MINDSTAGE_BROWSER", "BROWSER_PATH", "CHROMIUM"],
        help="Chromium, Chrome or a relative; by default one that is found.",
        show_default=False,
    ),
]
Seconds = Annotated[
    float, typer.Option("--for", metavar="SECONDS", min=0.0, callback=finite, help="Let so much time pass first.")
]
Timeout = Annotated[
    float, typer.Option("--timeout", metavar="SECONDS", min=1.0, callback=finite, help="How long taking it may last.")
]


def shot(
    maps: Maps,
    *,
    output: Output,
    position: From = None,
    look_at: To = None,
    top: Top = False,
    section: Section = None,
    highlights: Highlights = None,
    colours: Colours = None,
    opened: Opened = None,
    select: Selected = None,
    labels: LabelsOf = "none",
    size: Size = "1280x800",
    whole_page: WholePage = False,
    panel: Panel = "",
    browser: BrowserPath = None,
    seconds: Seconds = 0.0,
    timeout_s: Timeout = 180.0,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    robots: Robots = None,
    assets: AssetFolders = None,
    plain_boxes: PlainBoxes = False,
    engine: EngineName = "mujoco",
    as_json: AsJson = False,
) -> Outcome:
    """Take a picture of a map's world, without a screen or a GPU, by a browser that is installed here."""
    from mindstage.viewport import Shot
    from mindstage.viewport.browser import find_browser

    wish = Shot(
        size=_size(size),
        section=section,
        select=_id(select),
        labels=_labels(labels),
        panels=whole_page or bool(panel),
        panel=panel,
        browser=browser,
        timeout_s=timeout_s,
        **_eye(position, look_at, top=top),
    )
    pointers, running = _pointers(highlights or [], colours or []), make_engine(engine)
    find_browser(browser)  # before a long map is read in vain
    with working("reading"):
        knowledge = knowledge_base(maps, ontologies=ontologies, bundled=bundled, robots=robots)
        world = knowledge.world(map_name)
    with stage_for(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage, alone_in(stage):
        with working("spawning"):
            report = stage.spawn(world)
        warn_of_failures(report)
        open_up(stage, world, opened or [])
        let_pass(stage, seconds)
        lit = [pointer.show(stage) for pointer in pointers]
        _take(stage, wish, output)
    told = {"map": world.iri, "picture": str(output), "size": wish.size, "engine": stage.engine_name}
    _tell(told | {"spawn": report_json(report)}, lit, as_json=as_json)
    return Outcome.DONE


def _take(stage: Stage, wish: Shot, output: Path) -> None:
    from mindstage.viewport import Viewport

    with working("taking the picture"), Viewport(stage, port=0) as viewport:
        picture = viewport.shot(wish)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(picture)


def _tell(told: dict[str, object], lit: Sequence[Shown], *, as_json: bool) -> None:
    if as_json:
        groups = [
            {"lit": list(shown.lit), "not_lit": {dark.id: dark.reason for dark in shown.not_lit}} for shown in lit
        ]
        print_json(told | {"highlights": groups})
        return
    for shown in lit:
        for dark in shown.not_lit:
            warn(f"not lit: {dark.id}: {dark.reason}")
    say(f"The picture is in {told['picture']}")


def _eye(position: str | None, look_at: str | None, *, top: bool) -> _Eye:
    """Where the eye is, and what it looks at.

    Raises:
        ArgumentRefused: some of what was typed says nothing, or excludes other things.
    """
    from mindstage.world import BodyId

    if top and (position or look_at):
        raise ArgumentRefused("--top", cause="it says by itself where the eye is", remedy="leave --from and --to out")
    point = None if look_at is None else _numbers(look_at)
    focus = () if look_at is None or point is not None else (BodyId(look_at),)
    if focus and position:
        cause = f"{look_at!r} is no point, and a body fills the picture from the usual side"
        raise ArgumentRefused("--to", cause=cause, remedy="give X,Y,Z, or leave --from out")
    eye = None if position is None else _point("--from", position)
    return {"position": eye, "look_at": point, "focus": focus, "top": top}


def _id(text: str | None) -> BodyId | None:
    from mindstage.world import BodyId

    return None if text is None else BodyId(text)


def _labels(text: str) -> Labels:
    from mindstage.viewport import Labels

    try:
        return Labels(text)
    except ValueError:
        remedy = f"there is {', '.join(each.value for each in Labels)}"
        raise ArgumentRefused("--labels", cause=f"{text!r} is none", remedy=remedy) from None


def _size(text: str) -> tuple[int, int]:
    if sides := re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", text):
        return int(sides[1]), int(sides[2])
    raise ArgumentRefused("--size", cause=f"{text!r} is no size", remedy="give width and height, such as 1280x800")


def _point(option: str, text: str) -> Vector:
    if (numbers := _numbers(text)) is None:
        raise ArgumentRefused(option, cause=f"{text!r} is no point", remedy="give three numbers, such as 2,-1.5,1.8")
    return numbers


def _numbers(text: str) -> Vector | None:
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        return None
    return (x, y, z) if all(map(math.isfinite, (x, y, z))) else None


def _pointers(texts: Sequence[str], colours: Sequence[str]) -> list[Pointer]:
    """What is to be lit, each with its colour.

    Raises:
        ArgumentRefused: there are more colours than things, or nothing is said.
        ColourUnknown: a colour is none.
    """
    from mindstage.world.colours import colour_from

    if len(colours) > len(texts):
        remedy = "give as many --highlight, in their order"
        raise ArgumentRefused("--colour", cause=f"there are {len(colours)} for {len(texts)} --highlight", remedy=remedy)
    usual = [_COLOURS[at % len(_COLOURS)] for at in range(len(texts))]
    chosen = [*colours, *usual[len(colours) :]]
    return [Pointer(_words(text), colour_from(colour)) for text, colour in zip(texts, chosen, strict=True)]


def _words(text: str) -> tuple[str, ...]:
    try:
        words = tuple(shlex.split(text))
    except ValueError as error:
        raise ArgumentRefused("--highlight", cause=f"{text!r} cannot be read: {error}") from error
    if not words:
        raise ArgumentRefused("--highlight", cause="it says nothing", remedy="give a question, ids, or a class")
    return words
