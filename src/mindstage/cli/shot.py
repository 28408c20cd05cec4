"""`mindstage shot`: a picture of a map's world.

The world stands still while it is taken, so that the same map gives the same picture.

Opening: doors and drawers pulled open, one after the other, as a hand would.

Pointing: what somebody means by a question, by ids or by a class, lit up on a stage.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from mindstage.cli.ask import named_args
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    EngineName,
    ExitCode,
    MapArguments,
    MapName,
    Ontologies,
    PlainBoxes,
    Robots,
    finite,
)
from mindstage.cli.output import (
    print_failures,
    print_json,
    print_line,
    progress_spinner,
    report_json,
    step_with_progress,
    warn,
)
from mindstage.cli.setup import exclusive, knowledge_base, make_engine, simulation_from_options
from mindstage.errors import InvalidArgumentError, NameNotFoundError

if TYPE_CHECKING:
    from mindstage.scene import BodyId, Color, Vector, World
    from mindstage.simulation import HighlightResult, Simulation
    from mindstage.viewer import LabelMode, Screenshot

__all__ = ["HighlightTarget", "pull_open", "shot"]


_MAX_PULL_M = 0.6
_PULL_DURATION_S = 3.0
_SETTLE_S = 0.5


def pull_open(simulation: Simulation, world: World, ids: Iterable[str]) -> None:
    """Pulls each by its handle, if it has one, and lets everything come to rest.

    Raises:
        BodyNotFoundError: one of them is not there.
    """
    from mindstage.scene import BodyId

    wanted = [world.body(BodyId(id)).id for id in ids]
    frames = {joint.child: joint.parent for joint in world.joints}
    frames |= {joint.parent: joint.child for joint in world.joints if joint.parent in wanted}
    for id in wanted:
        front, frame = world.body(id).pose.position, world.body(frames.get(id, id)).pose.position
        grip = next((hold.child for hold in world.attachments if hold.parent == id), id)
        simulation.pull(grip, point=(0.0, 0.0, 0.0), target=_pull_target(world.body(grip).pose.position, front, frame))
        simulation.step(_PULL_DURATION_S)
        simulation.release(grip)
    if wanted:
        simulation.step(_SETTLE_S)


def _pull_target(point: Vector, front: Vector, frame: Vector) -> Vector:
    """Level, from the middle of a piece of furniture to its front, as far as a hand reaches."""
    x, y = front[0] - frame[0], front[1] - frame[1]
    if abs(x) < abs(y):
        x = 0.0
    else:
        y = 0.0
    scale = _MAX_PULL_M / max(abs(x) + abs(y), 1e-9)
    return point[0] + scale * x, point[1] + scale * y, point[2]


@dataclass(frozen=True, slots=True)
class HighlightTarget:
    """Something to be lit in a color."""

    terms: tuple[str, ...]
    """A question and what it is asked about, or else ids and names of classes."""
    color: Color | None

    def apply(self, simulation: Simulation) -> HighlightResult:
        """Lights it up.

        Raises:
            NameNotFoundError: a word is neither a question, a body's id nor a class.
            InvalidArgumentError: the question is not asked about that.
        """
        from mindstage.knowledge.queries import get_question, list_questions

        first = self.terms[0].replace("-", "_")
        if first in {question.name for question in list_questions()}:
            question = get_question(first)
            answers = simulation.ask(question, **named_args(question, list(self.terms[1:])))
            return simulation.highlight(answers, self.color)
        world = simulation.snapshot()
        ids = dict.fromkeys(id for word in self.terms for id in _matching_bodies(simulation, world, word))
        return simulation.highlight(ids, self.color, label=" ".join(self.terms))


def _matching_bodies(simulation: Simulation, world: World, word: str) -> Iterator[BodyId]:
    """The body of that id, or all of that class."""
    from mindstage.knowledge.names import EntityType

    ids = {body.id for body in world.bodies}
    if word in ids:
        yield from (id for id in ids if id == word)
        return
    knowledge = simulation.knowledge
    try:
        cls = knowledge.names.find(word, EntityType.CLASS)
    except NameNotFoundError as error:
        kind = "question, body or class"
        raise NameNotFoundError(word, entity_type=kind, known=(*ids, *knowledge.names.short_names())) from error
    yield from (body.id for body in world.bodies if knowledge.is_a(body.cls, cls))


class _CameraOptions(TypedDict):
    """Those fields of a `Screenshot`."""

    position: Vector | None
    look_at: Vector | None
    focus: tuple[BodyId, ...]
    from_above: bool


_COLORS = ("blue", "green", "yellow", "red", "black")
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
Colors = Annotated[
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
    maps: MapArguments,
    *,
    output: Output,
    position: From = None,
    look_at: To = None,
    top: Top = False,
    section: Section = None,
    highlights: Highlights = None,
    colors: Colors = None,
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
) -> ExitCode:
    """Take a picture of a map's world, without a screen or a GPU, by a browser that is installed here."""
    from mindstage.viewer import Screenshot
    from mindstage.viewer.screenshot import find_browser

    wish = Screenshot(
        size=_parse_size(size),
        clip_height=section,
        selected=_parse_id(select),
        labels=_parse_labels(labels),
        with_panels=whole_page or bool(panel),
        panel=panel,
        browser=browser,
        timeout_s=timeout_s,
        **_camera_options(position, look_at, top=top),
    )
    pointers, running = _highlight_targets(highlights or [], colors or []), make_engine(engine)
    find_browser(browser)  # before a long map is read in vain
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, ontologies=ontologies, bundled=bundled, robots=robots)
        world = knowledge.world(map_name)
    with simulation_from_options(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage, exclusive(stage):
        with progress_spinner("spawning"):
            report = stage.spawn(world)
        print_failures(report)
        pull_open(stage, world, opened or [])
        step_with_progress(stage, seconds)
        lit = [pointer.apply(stage) for pointer in pointers]
        _take_screenshot(stage, wish, output)
    told = {"map": world.iri, "picture": str(output), "size": wish.size, "engine": stage.engine_name}
    _print_result(told | {"spawn": report_json(report)}, lit, as_json=as_json)
    return ExitCode.OK


def _take_screenshot(simulation: Simulation, screenshot: Screenshot, output: Path) -> None:
    from mindstage.api import view

    with progress_spinner("taking the picture"), view(simulation, port=0) as viewport:
        picture = viewport.screenshot(screenshot)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(picture)


def _print_result(summary: dict[str, object], highlights: Sequence[HighlightResult], *, as_json: bool) -> None:
    if as_json:
        groups = [
            {"lit": list(shown.highlighted), "not_lit": {dark.id: dark.reason for dark in shown.unhighlighted}}
            for shown in highlights
        ]
        print_json(summary | {"highlights": groups})
        return
    for shown in highlights:
        for dark in shown.unhighlighted:
            warn(f"not lit: {dark.id}: {dark.reason}")
    print_line(f"The picture is in {summary['picture']}")


def _camera_options(position: str | None, look_at: str | None, *, top: bool) -> _CameraOptions:
    """Where the eye is, and what it looks at.

    Raises:
        InvalidArgumentError: some of what was typed says nothing, or excludes other things.
    """
    from mindstage.scene import BodyId

    if top and (position or look_at):
        raise InvalidArgumentError(
            "--top", cause="it says by itself where the eye is", remedy="leave --from and --to out"
        )
    point = None if look_at is None else _parse_numbers(look_at)
    focus = () if look_at is None or point is not None else (BodyId(look_at),)
    if focus and position:
        cause = f"{look_at!r} is no point, and a body fills the picture from the usual side"
        raise InvalidArgumentError("--to", cause=cause, remedy="give X,Y,Z, or leave --from out")
    eye = None if position is None else _parse_point("--from", position)
    return {"position": eye, "look_at": point, "focus": focus, "from_above": top}


def _parse_id(text: str | None) -> BodyId | None:
    from mindstage.scene import BodyId

    return None if text is None else BodyId(text)


def _parse_labels(text: str) -> LabelMode:
    from mindstage.viewer import LabelMode

    try:
        return LabelMode(text)
    except ValueError:
        remedy = f"there is {', '.join(each.value for each in LabelMode)}"
        raise InvalidArgumentError("--labels", cause=f"{text!r} is none", remedy=remedy) from None


def _parse_size(text: str) -> tuple[int, int]:
    if sides := re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", text):
        return int(sides[1]), int(sides[2])
    raise InvalidArgumentError("--size", cause=f"{text!r} is no size", remedy="give width and height, such as 1280x800")


def _parse_point(option: str, text: str) -> Vector:
    if (numbers := _parse_numbers(text)) is None:
        raise InvalidArgumentError(
            option, cause=f"{text!r} is no point", remedy="give three numbers, such as 2,-1.5,1.8"
        )
    return numbers


def _parse_numbers(text: str) -> Vector | None:
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        return None
    return (x, y, z) if all(map(math.isfinite, (x, y, z))) else None


def _highlight_targets(texts: Sequence[str], colors: Sequence[str]) -> list[HighlightTarget]:
    """What is to be lit, each with its color.

    Raises:
        InvalidArgumentError: there are more colors than things, or nothing is said.
        InvalidColorError: a color is none.
    """
    from mindstage.scene.colors import parse_color

    if len(colors) > len(texts):
        remedy = "give as many --highlight, in their order"
        raise InvalidArgumentError(
            "--colour", cause=f"there are {len(colors)} for {len(texts)} --highlight", remedy=remedy
        )
    usual = [_COLORS[at % len(_COLORS)] for at in range(len(texts))]
    chosen = [*colors, *usual[len(colors) :]]
    return [HighlightTarget(_split_terms(text), parse_color(color)) for text, color in zip(texts, chosen, strict=True)]


def _split_terms(text: str) -> tuple[str, ...]:
    try:
        words = tuple(shlex.split(text))
    except ValueError as error:
        raise InvalidArgumentError("--highlight", cause=f"{text!r} cannot be read: {error}") from error
    if not words:
        raise InvalidArgumentError("--highlight", cause="it says nothing", remedy="give a question, ids, or a class")
    return words
