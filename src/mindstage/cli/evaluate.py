"""The verb `evaluate`: tries a plan many times in copies of a world."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from mindstage.access.limits import Samples as SamplesNumber
from mindstage.access.limits import Timeout
from mindstage.cli.ask import named_args
from mindstage.cli.options import (
    DEFAULT_SPAWN,
    AsJson,
    ExitCode,
    MapArguments,
    MapSpawning,
    OptionGroup,
    Strict,
    Verbose,
)
from mindstage.cli.output import (
    class_lookup,
    console,
    print_failures,
    print_findings,
    print_json,
    print_line,
    print_table,
    progress_spinner,
    warn,
)
from mindstage.cli.setup import findings_about, knowledge_base, make_engine, simulation_from_options
from mindstage.cli.shot import take_picture
from mindstage.ranges import Fraction, WallTime
from mindstage.ranges import Seed as SeedNumber

if TYPE_CHECKING:
    from mindstage.imagination import Check, Progress, Uncertainty, Verdict
    from mindstage.simulation import Simulation

__all__ = ["DEFAULT_TRIAL", "PlanTrial", "evaluate", "interruptible"]

PlanArgument = Annotated[
    str, typer.Argument(metavar="PLAN", help="The plan: a JSON or YAML file, or text in braces.", show_default=False)
]
Samples = Annotated[SamplesNumber, typer.Option("--samples", metavar="N", help="The largest number of samples.")]
Seed = Annotated[SeedNumber, typer.Option("--seed", metavar="N", help="Determines the random numbers.")]
Budget = Annotated[
    Timeout, typer.Option("--budget", metavar="SECONDS", help="Limit of the wall time; 60 s by default.")
]
Threshold = Annotated[
    Fraction, typer.Option("--threshold", metavar="P", help="The probability that the plan must have.")
]
Fixed = Annotated[
    bool,
    typer.Option("--fixed", help="Run exactly as many samples, with the interval of Wilson, instead of until decided."),
]
Workers = Annotated[
    str,
    typer.Option(
        "--workers",
        metavar="N|NAME",
        help="Number of processes; ray or ray://HOST:PORT for a Ray cluster; gpu or gpu:WORLDS for MuJoCo Warp.",
    ),
]
CheckText = Annotated[
    str | None,
    typer.Option(
        "--check",
        metavar="QUESTION",
        help="A question at the end with its arguments, instead of the plan's: 'where_is thing=milk_carton_1'.",
        show_default=False,
    ),
]
Expected = Annotated[
    list[str] | None,
    typer.Option(
        "--expect",
        metavar="ANSWER",
        help="The answer to --check with which a sample succeeds: any, none, or COLUMN=VALUE, which may be repeated.",
        show_default=False,
    ),
]
Uncertainties = Annotated[
    list[str] | None,
    typer.Option(
        "--uncertainty",
        metavar="TEXT",
        help="A body or class and standard deviations, besides the plan's: 'Milk position_m=0.01 yaw_rad=0.1 mass=0.2 "
        "friction=0.2 joint_friction=0.2', or guesses for masses and frictions that no map states; may be repeated.",
        show_default=False,
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanTrial(OptionGroup):
    """The options of every verb that tries a plan in copies of a world."""

    samples: Samples = 100
    seed: Seed = 0
    budget: Budget = 60.0
    workers: Workers = "1"
    uncertainty: Uncertainties = None

    def arguments(self) -> dict[str, Any]:
        """The arguments of `mindstage.imagination.evaluate_plan`.

        Raises:
            InvalidArgumentError: an uncertainty has no standard deviations, an unknown one, or one that is no number.
        """
        from mindstage.errors import InvalidArgumentError
        from mindstage.imagination.plans import GUESSES
        from mindstage.imagination.trials import parse_uncertainty

        deviations: list[Uncertainty | Literal["guesses"]] = []
        for text in self.uncertainty or ():
            thing, *words = text.split(maxsplit=1)
            if not words and thing != GUESSES:
                cause = "it states no deviation"
                raise InvalidArgumentError(f"--uncertainty {text!r}", cause=cause, remedy="add position_m=0.01")
            deviations += parse_uncertainty(thing, words[0] if words else GUESSES)
        numbers = {"samples": self.samples, "seed": self.seed, "budget_s": self.budget, "workers": self.workers}
        return {"uncertainty": deviations, **numbers}


DEFAULT_TRIAL = PlanTrial()

SettleTime = Annotated[
    WallTime,
    typer.Option("--settle", metavar="SECONDS", help="Simulated time before the samples begin."),
]

Picture = Annotated[
    Path | None,
    typer.Option(
        "--picture",
        metavar="FILE.png",
        help="Write a picture of where things end in the samples (green succeeded, red failed, yellow unknown), with "
        "the first failing sample over time: .png, .jpg or .webp.",
        show_default=False,
    ),
]


def evaluate(
    plan: PlanArgument,
    maps: MapArguments,
    *,
    trial: PlanTrial = DEFAULT_TRIAL,
    threshold: Threshold = 0.9,
    fixed: Fixed = False,
    check: CheckText = None,
    expect: Expected = None,
    settle: SettleTime = 0.0,
    picture: Picture = None,
    options: MapSpawning = DEFAULT_SPAWN,
    strict: Strict = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Try a plan many times in copies of a world; exit 0 if it succeeds, 1 if it fails, 3 if that is unknown."""
    from mindstage.imagination import evaluate_plan, load_plan
    from mindstage.pictures import picture_format

    file = load_plan(plan)
    tried = trial.arguments()
    asked = _check(check, expect or [])
    if picture is not None:
        picture_format(picture)  # before the map is read, so that a wrong suffix fails at once
    running = make_engine(options.engine)  # before the map is read, so that a wrong name fails at once
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, options)
        world = knowledge.world(options.map_name)
    findings = findings_about(world, knowledge, strict=strict, options=options)
    with simulation_from_options(knowledge, running, options) as simulation:
        with progress_spinner("spawning"):
            report = simulation.spawn(world)
            simulation.step(settle)
        if not as_json:
            print_findings(findings, all=verbose, classes=class_lookup(knowledge))
            print_failures(report)
        tried |= {"check": asked, "threshold": threshold, "fixed": fixed}
        with interruptible() as interrupted, _progress_bar(trial.samples) as progress:
            verdict = evaluate_plan(simulation, file, **tried, progress=progress, cancel=interrupted.is_set)
        if as_json:
            drawn = {} if picture is None else {"picture": str(picture)}
            print_json({"map": world.iri, "engine": simulation.engine.name, **verdict.to_dict(), **drawn})
        else:
            _print_verdict(verdict, verbose=verbose)
        if picture is not None and not interrupted.is_set():
            _draw(simulation, verdict, picture, as_json=as_json)
    if interrupted.is_set():
        return ExitCode.INTERRUPTED
    codes = {"succeeded": ExitCode.OK, "failed": ExitCode.NEGATIVE}
    return codes.get(verdict.outcome.value, ExitCode.UNKNOWN)


def _draw(simulation: Simulation, verdict: Verdict, path: Path, *, as_json: bool) -> None:
    from mindstage.rendering import Screenshot

    take_picture(simulation, Screenshot(), path, verdict=verdict)
    if not as_json:
        print_line(f"picture → {path}")


def _check(text: str | None, expected: list[str]) -> Check | None:
    """The check of a question and the expected answer.

    Raises:
        InvalidArgumentError: there is an expected answer without a question, or it is not understood.
    """
    from mindstage.errors import InvalidArgumentError
    from mindstage.imagination import Check
    from mindstage.knowledge.queries import get_question

    if text is None:
        if expected:
            raise InvalidArgumentError("--expect", cause="there is no question", remedy="give --check")
        return None
    name, *arguments = text.split()
    question = get_question(name.replace("-", "_"))
    columns: dict[str, str | float | bool] = {}
    for each in expected:
        column, equals, value = each.partition("=")
        if not equals and (each not in {"any", "none"} or len(expected) > 1):
            raise InvalidArgumentError(f"--expect {each}", cause="it is no answer", remedy="any, none or COLUMN=VALUE")
        if equals:
            columns[column] = _plain_value(value)
    expect: Any = columns or (expected[0] if expected else "any")
    return Check(question=question.name, args=dict(named_args(question, arguments)), expect=expect)


def _plain_value(text: str) -> str | float | bool:
    if text in {"true", "false"}:
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets in the context, instead of raising an exception; a second Ctrl-C raises."""
    interrupted = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield interrupted
        return

    def interrupt(number: int, frame: object) -> None:
        if interrupted.is_set():
            raise KeyboardInterrupt
        interrupted.set()

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield interrupted
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _progress_bar(samples: int) -> Iterator[Callable[[Progress], None]]:
    """A progress bar on stderr after the first second, if stderr is a terminal."""
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("imagining"), BarColumn(), TextColumn("{task.completed} of {task.total}, {task.description}"))
    start = time.perf_counter()
    with Bar(*columns, TimeRemainingColumn(), console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=samples, visible=False)

        def update(progress: Progress) -> None:
            low, high = progress.interval
            visible = bar.console.is_terminal and time.perf_counter() - start > 1.0
            text = f"{progress.succeeded} succeeded ({low:.2f} to {high:.2f})"
            bar.update(task, completed=progress.done, total=progress.samples, description=text, visible=visible)

        yield update


def _print_verdict(verdict: Verdict, *, verbose: bool) -> None:
    print_line(str(verdict))
    if verdict.causes:
        rows = [[each.count, each.kind.value, each.thing or "", each.other or ""] for each in verdict.causes]
        print_table("Causes", ("samples", "what", "thing", "other"), rows)
    if verbose:
        print_line(f"Ended since {verdict.stopped}; seed {verdict.seed}")
    for note in verdict.assumptions:
        warn(note)
