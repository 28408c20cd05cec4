"""The verb `shot`: renders a picture of a map with OpenGL.

Doors and drawers can be opened and bodies highlighted first. The simulation is paused while the picture is taken, so
that the same map gives the same picture.
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
    DEFAULT_PICTURE,
    DEFAULT_SPAWN,
    AsJson,
    ExitCode,
    MapArguments,
    MapSpawning,
    PictureOptions,
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
    from mindstage.imagination import PlanFile, Verdict
    from mindstage.rendering import LabelMode, Screenshot
    from mindstage.scene import BodyId, Color, Vector, World
    from mindstage.simulation import HighlightResult, Simulation

__all__ = [
    "HighlightTarget",
    "highlight_targets",
    "parse_numbers",
    "parse_point",
    "parse_size",
    "pull_open",
    "shot",
    "take_picture",
]


_MAX_PULL_M = 0.6
_PULL_DURATION_S = 3.0
_SETTLE_S = 0.5


def pull_open(simulation: Simulation, world: World, ids: Iterable[str]) -> None:
    """Pulls bodies open, one after the other, by a handle if they have one, and simulates until they rest.

    Raises:
        BodyNotFoundError: one of the bodies does not exist.
    """
    from mindstage.scene import BodyId

    opened = [world.body(BodyId(id)).id for id in ids]
    cases = {joint.child: joint.parent for joint in world.joints}
    cases |= {joint.parent: joint.child for joint in world.joints if joint.parent in opened}
    for id in opened:
        front, case = world.body(id).pose.position, world.body(cases.get(id, id)).pose.position
        handle = next((each.child for each in world.attachments if each.parent == id), id)
        target = _pull_target(world.body(handle).pose.position, front, case)
        simulation.pull(handle, point=(0.0, 0.0, 0.0), target=target)
        simulation.step(_PULL_DURATION_S)
        simulation.release(handle)
    if opened:
        simulation.step(_SETTLE_S)


def _pull_target(point: Vector, front: Vector, case: Vector) -> Vector:
    """The point moved horizontally, along the main axis from the center of the case to the front [m]."""
    x, y = front[0] - case[0], front[1] - case[1]
    if abs(x) < abs(y):
        x = 0.0
    else:
        y = 0.0
    scale = _MAX_PULL_M / max(abs(x) + abs(y), 1e-9)
    return point[0] + scale * x, point[1] + scale * y, point[2]


@dataclass(frozen=True, slots=True)
class HighlightTarget:
    """A value of `--highlight`, and its color."""

    terms: tuple[str, ...]
    """A question and its arguments, or else ids of bodies and names of classes."""
    color: Color | None

    def apply(self, simulation: Simulation) -> HighlightResult:
        """Highlights the bodies.

        Raises:
            NameNotFoundError: a term is neither a question, the id of a body nor a class.
            InvalidArgumentError: an argument of the question is invalid.
        """
        from mindstage.knowledge.queries import get_question, list_questions

        first = self.terms[0].replace("-", "_")
        if first in {question.name for question in list_questions()}:
            question = get_question(first)
            answers = simulation.ask(question, **named_args(question, list(self.terms[1:])))
            return simulation.highlight(answers, self.color)
        world = simulation.snapshot()
        ids = dict.fromkeys(id for term in self.terms for id in _matching_bodies(simulation, world, term))
        return simulation.highlight(ids, self.color, label=" ".join(self.terms))


def _matching_bodies(simulation: Simulation, world: World, term: str) -> Iterator[BodyId]:
    """The body of that id, or all bodies of that class."""
    from mindstage.knowledge.names import EntityType

    ids = {body.id for body in world.bodies}
    if term in ids:
        yield from (id for id in ids if id == term)
        return
    knowledge = simulation.knowledge
    try:
        cls = knowledge.names.find(term, EntityType.CLASS)
    except NameNotFoundError as error:
        kind = "question, body or class"
        raise NameNotFoundError(term, entity_type=kind, known=(*ids, *knowledge.names.short_names())) from error
    yield from (body.id for body in world.bodies if knowledge.is_a(body.cls, cls))


class _CameraOptions(TypedDict):
    """The fields of `Screenshot` that define the camera."""

    position: Vector | None
    look_at: Vector | None
    focus: tuple[BodyId, ...]
    from_above: bool


_COLORS = ("blue", "green", "yellow", "red", "black")
"""Default colors of `--highlight`, in turn."""

Output = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="FILE", help="The file to write: .png, .jpg or .webp.", show_default=False),
]
Opened = Annotated[
    list[str] | None,
    typer.Option("--open", metavar="ID", help="Open a door or drawer first; may be repeated.", show_default=False),
]
Selected = Annotated[str | None, typer.Option("--select", metavar="ID", help="A body to select.", show_default=False)]
LabelsOf = Annotated[
    str, typer.Option("--labels", metavar="WHICH", help="Labels of bodies: none, selected, class or all.")
]
TriedPlan = Annotated[
    str | None,
    typer.Option(
        "--plan",
        metavar="PLAN",
        help="Try a plan (a JSON or YAML file, or text in braces), and draw where things end in its samples.",
        show_default=False,
    ),
]


def shot(
    maps: MapArguments,
    *,
    output: Output,
    view: PictureOptions = DEFAULT_PICTURE,
    opened: Opened = None,
    select: Selected = None,
    labels: LabelsOf = "none",
    plan: TriedPlan = None,
    options: MapSpawning = DEFAULT_SPAWN,
    as_json: AsJson = False,
) -> ExitCode:
    """Render a picture of a map; no display, GPU or browser is needed."""
    from mindstage.pictures import picture_format
    from mindstage.rendering import Screenshot

    picture_format(output)  # an unknown suffix fails before the map is read
    screenshot = Screenshot(
        size=parse_size(view.size),
        clip_height=view.section,
        selected=_parse_id(select),
        labels=_parse_labels(labels),
        **_camera_options(view.position, view.look_at, top=view.top),
    )
    loaded = None if plan is None else _load_plan(plan)
    targets, running = highlight_targets(view.highlights or [], view.colors or []), make_engine(options.engine)
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, options)
        world = knowledge.world(options.map_name)
    moves = bool(opened) or plan is not None or view.simulated_s > 0.0
    with simulation_from_options(knowledge, running, options, decompose=moves) as sim, exclusive(sim):
        with progress_spinner("spawning"):
            report = sim.spawn(world)
        print_failures(report)
        pull_open(sim, world, opened or [])
        step_with_progress(sim, view.simulated_s)
        results, verdict = [target.apply(sim) for target in targets], None if loaded is None else _try_plan(sim, loaded)
        take_picture(sim, screenshot, output, verdict=verdict)
    summary = {"map": world.iri, "picture": str(output), "size": screenshot.size, "engine": sim.engine.name}
    tried = {} if verdict is None else {"verdict": str(verdict)}
    _print_result({**summary, **tried, "spawn": report_json(report)}, results, as_json=as_json)
    return ExitCode.OK


def take_picture(
    simulation: Simulation, screenshot: Screenshot, output: Path, *, verdict: Verdict | None = None
) -> None:
    """Writes a picture, with the outcome of a plan if there is a verdict; the camera then frames it by default.

    Raises:
        RendererUnavailableError: there is no OpenGL library.
    """
    from mindstage.pictures import shot as render

    with progress_spinner("rendering"):
        render(simulation, output, screenshot, verdict=verdict)


def _load_plan(text: str) -> PlanFile:
    from mindstage.imagination import load_plan

    return load_plan(text)


def _try_plan(simulation: Simulation, plan: PlanFile) -> Verdict:
    from mindstage.imagination import evaluate_plan

    with progress_spinner("imagining"):
        return evaluate_plan(simulation, plan, fixed=True)


def _print_result(summary: dict[str, object], results: Sequence[HighlightResult], *, as_json: bool) -> None:
    if as_json:
        groups = [
            {
                "highlighted": list(result.highlighted),
                "not_highlighted": {item.id: item.reason for item in result.unhighlighted},
            }
            for result in results
        ]
        print_json(summary | {"highlights": groups})
        return
    for result in results:
        for item in result.unhighlighted:
            warn(f"not highlighted: {item.id}: {item.reason}")
    if "verdict" in summary:
        print_line(str(summary["verdict"]))
    print_line(f"picture → {summary['picture']}")


def _camera_options(position: str | None, look_at: str | None, *, top: bool) -> _CameraOptions:
    """The camera from `--from`, `--to` and `--top`.

    Raises:
        InvalidArgumentError: a value is invalid, or options are mutually exclusive.
    """
    from mindstage.scene import BodyId

    if top and (position or look_at):
        raise InvalidArgumentError("--top", cause="it defines the camera", remedy="omit --from and --to")
    point = None if look_at is None else parse_numbers(look_at)
    focus = () if look_at is None or point is not None else (BodyId(look_at),)
    if focus and position:
        cause = f"{look_at!r} is not a point, and --from requires one"
        raise InvalidArgumentError("--to", cause=cause, remedy="give X,Y,Z, or omit --from")
    camera = None if position is None else parse_point("--from", position)
    return {"position": camera, "look_at": point, "focus": focus, "from_above": top}


def _parse_id(text: str | None) -> BodyId | None:
    from mindstage.scene import BodyId

    return None if text is None else BodyId(text)


def _parse_labels(text: str) -> LabelMode:
    from mindstage.rendering import LabelMode

    try:
        return LabelMode(text)
    except ValueError:
        remedy = f"there is {', '.join(each.value for each in LabelMode)}"
        raise InvalidArgumentError("--labels", cause=f"{text!r} is not a valid value", remedy=remedy) from None


def parse_size(text: str) -> tuple[int, int]:
    """Reads the value of `--size`, such as 1280x800.

    Raises:
        InvalidArgumentError: it is no size.
    """
    if sides := re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", text):
        return int(sides[1]), int(sides[2])
    raise InvalidArgumentError(
        "--size", cause=f"{text!r} is not a size", remedy="give width and height, such as 1280x800"
    )


def parse_point(option: str, text: str) -> Vector:
    """Reads three numbers, separated by commas.

    Raises:
        InvalidArgumentError: they are not three finite numbers.
    """
    if (numbers := parse_numbers(text)) is None:
        raise InvalidArgumentError(
            option, cause=f"{text!r} is not a point", remedy="give three numbers, such as 2,-1.5,1.8"
        )
    return numbers


def parse_numbers(text: str) -> Vector | None:
    """Reads three numbers, separated by commas; None if the text is anything else."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        return None
    return (x, y, z) if all(map(math.isfinite, (x, y, z))) else None


def highlight_targets(texts: Sequence[str], colors: Sequence[str]) -> list[HighlightTarget]:
    """The values of `--highlight` with their colors.

    Raises:
        InvalidArgumentError: there are more colors than highlights, or a highlight is empty.
        InvalidColorError: a color is invalid.
    """
    from mindstage.scene.colors import parse_color

    if len(colors) > len(texts):
        remedy = "give at most one for each --highlight"
        raise InvalidArgumentError(
            "--color", cause=f"there are {len(colors)} for {len(texts)} --highlight", remedy=remedy
        )
    defaults = [_COLORS[at % len(_COLORS)] for at in range(len(texts))]
    chosen = [*colors, *defaults[len(colors) :]]
    return [HighlightTarget(_split_terms(text), parse_color(color)) for text, color in zip(texts, chosen, strict=True)]


def _split_terms(text: str) -> tuple[str, ...]:
    try:
        terms = tuple(shlex.split(text))
    except ValueError as error:
        raise InvalidArgumentError("--highlight", cause=f"{text!r} cannot be read: {error}") from error
    if not terms:
        raise InvalidArgumentError("--highlight", cause="it is empty", remedy="give a question, ids, or a class")
    return terms
