"""The verb `do`: a robot performs a skill, a designated action or a plan in a map."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mindstage.access.limits import Deadline as DeadlineNumber
from mindstage.cli.attach import open_running, running_target
from mindstage.cli.evaluate import DEFAULT_TRIAL, PlanTrial, interruptible
from mindstage.cli.options import (
    DEFAULT_SPAWN,
    AsJson,
    ExitCode,
    MapSpawning,
    Running,
    Strict,
    Verbose,
)
from mindstage.cli.output import console, print_json, print_line, progress_spinner, warn
from mindstage.cli.simulate import spawned_map
from mindstage.ranges import WallTime

if TYPE_CHECKING:
    from mindstage.cli.simulate import SpawnedMap
    from mindstage.imagination import Perform, Plan, PlanFile, SampleResult, TryFirstResult
    from mindstage.maps.urdf.xacro_process import XacroRequest
    from mindstage.robots.models.robot_model import RobotModel
    from mindstage.robots.robot import Robot
    from mindstage.robots.skill_declaration import SkillStep
    from mindstage.simulation import Simulation

__all__ = ["do"]

Command = Annotated[
    str | None,
    typer.Argument(
        metavar="[COMMAND]",
        help="A sentence, as in 'put the vase on the table', or a skill with its arguments, as in 'go_to x=1 y=0'; "
        "several are separated by ';'. Or a plan (a file, or JSON), or a designator as JSON.",
        show_default=False,
    ),
]
OptionalMaps = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="MAP…",
        help="A semantic map (OWL or Turtle), or bundled:kitchen. Several are loaded into one knowledge base.",
        show_default=False,
    ),
]
RobotName = Annotated[
    str,
    typer.Option("--robot", metavar="NAME|FILE", help="A known model, or a description (URDF, xacro, MJCF)."),
]
SelfModelFile = Annotated[
    Path | None,
    typer.Option(
        "--self-model",
        metavar="FILE",
        help="What an ontology states about the robot, in the terms of SRDL (OWL).",
        show_default=False,
    ),
]
BasePose = Annotated[
    str | None,
    typer.Option(
        "--pose",
        metavar="X,Y[,YAW]",
        help="Where the robot stands at the start [m, rad]; by default at a free place in the middle of the floor.",
        show_default=False,
    ),
]
PlanOption = Annotated[
    str | None,
    typer.Option(
        "--plan", metavar="FILE", help="A plan instead of a command, as JSON or YAML; or text.", show_default=False
    ),
]
TryFirst = Annotated[
    float | None,
    typer.Option(
        "--try-first",
        metavar="P",
        min=0.0,
        max=1.0,
        help="Try it in copies of the world, and do it only if its probability is at least P.",
        show_default=False,
    ),
]
Deadline = Annotated[
    DeadlineNumber,
    typer.Option("--deadline", metavar="SECONDS", help="Limit of the simulated time of each skill."),
]
RecordFile = Annotated[
    Path | None,
    typer.Option("--record", metavar="FILE", help="Record an episode, a new file (.mcap).", show_default=False),
]
OutFile = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="OUT",
        help="Write the world afterwards as a map (.owl, .rdf, .xml or .ttl), without the robot.",
        show_default=False,
    ),
]
SettleSeconds = Annotated[
    WallTime,
    typer.Option("--settle", metavar="SECONDS", help="Simulated time before it begins."),
]


def do(
    context: typer.Context,
    command: Command = None,
    maps: OptionalMaps = None,
    *,
    running: Running = None,
    robot: RobotName = "mobile_manipulator",
    self_model: SelfModelFile = None,
    pose: BasePose = None,
    plan: PlanOption = None,
    try_first: TryFirst = None,
    trial: PlanTrial = DEFAULT_TRIAL,
    deadline: Deadline = 300.0,
    settle: SettleSeconds = 0.5,
    record: RecordFile = None,
    out: OutFile = None,
    options: MapSpawning = DEFAULT_SPAWN,
    strict: Strict = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Let a robot do something in a map; exit 0 if it succeeds, 1 if it fails or is not done, 3 if that is unknown."""
    allowed = {"command", "running", "deadline", "as_json"}
    if (target := running_target(context, running, maps, allowed=allowed)) is not None:
        return _do_running(target, command or "", deadline_s=deadline, as_json=as_json)
    task, sources = _arguments(command, plan, maps or [])
    wanted = _Wanted(
        task=task,
        pose=None if pose is None else _pose(pose),
        at_least=try_first,
        deadline_s=deadline,
        settle_s=settle,
        record=_new_file(record),
        out=out,
        trial=trial.arguments(),
    )
    model = _model(robot, self_model, xacro=options.xacro_request)
    with spawned_map(sources, options, strict=strict) as spawned:
        return _do_in(spawned, model, wanted, verbose=verbose, as_json=as_json)


@dataclass(frozen=True, kw_only=True)
class _Wanted:
    """What is to be done, and how."""

    task: str
    pose: tuple[float, float, float] | None
    at_least: float | None
    """The probability with which it is tried first; None if it is not tried."""
    deadline_s: float
    settle_s: float
    record: Path | None
    out: Path | None
    trial: dict[str, Any]
    """Further arguments of `try_first`."""


def _do_in(spawned: SpawnedMap, model: RobotModel, wanted: _Wanted, *, verbose: bool, as_json: bool) -> ExitCode:
    from mindstage.robots.standing import add_standing_robot

    simulation = spawned.simulation
    if not as_json and verbose:
        spawned.print()
    with progress_spinner("adding the robot"):
        robot = add_standing_robot(simulation, model, wanted.pose)
    plan, notes = _task(wanted.task, simulation, deadline_s=wanted.deadline_s)
    if not as_json:
        x, y, yaw = robot.base_pose()
        print_line(f"{robot.name} stands at ({x:.2f}, {y:.2f}), facing {math.degrees(yaw):.0f}°")
        for note in notes:
            warn(note)
    simulation.step(wanted.settle_s)
    with ExitStack() as stack:
        if wanted.record is not None:
            from mindstage.episodes import Recorder

            stack.enter_context(Recorder(simulation, wanted.record))
        interrupted = stack.enter_context(interruptible())
        show = stack.enter_context(_steps_shown(quiet=as_json))
        result, tried = _perform(simulation, plan, wanted, cancel=interrupted.is_set, on_step=show)
    if wanted.out is not None:
        simulation.save(wanted.out)
    if as_json:
        print_json(_as_json(robot, result, tried, notes, wanted) | spawned.to_json())
    else:
        _print_result(result, tried, verbose=verbose)
        for what, path in (("episode", wanted.record), ("world", wanted.out)):
            if path is not None:
                print_line(f"{what} → {path}")
    if interrupted.is_set():
        return ExitCode.INTERRUPTED
    codes = {None: ExitCode.NEGATIVE, "succeeded": ExitCode.OK, "failed": ExitCode.NEGATIVE}
    return codes.get(None if result is None else result.outcome.value, ExitCode.UNKNOWN)


# -- in a running simulation -------------------------------------------------------------------------------------------


def _do_running(target: str, command: str, *, deadline_s: float, as_json: bool) -> ExitCode:
    """Lets the robot of a running simulation perform skills; a failed one is the last.

    Raises:
        InvalidArgumentError: the command is no list of skills.
    """
    from mindstage.errors import InvalidArgumentError

    if not command or command.startswith(("{", "[")) or Path(command).suffix in {".yaml", ".yml", ".json"}:
        remedy = "give a skill with its arguments, as in 'park'; plans and designators need a map"
        raise InvalidArgumentError("do", cause="a running simulation performs skills only", remedy=remedy)
    results: list[dict[str, Any]] = []
    with interruptible() as interrupted, open_running(target) as simulation:
        for step in _commands(command, None, deadline_s=deadline_s)[0]:
            found = simulation.perform(
                step.skill,
                step.args,
                deadline_s=deadline_s,
                on_step=print_line if not as_json else lambda step: None,
                cancel=interrupted.is_set,
            )
            results.append(found)
            if not as_json:
                reason = f": {found['reason']}" if found["reason"] else ""
                print_line(f"{step.skill} {found['outcome']} after {found['duration_s']:.1f} s{reason}")
                for text in found["assumptions"]:
                    warn(f"assumed: {text}")
                if found["suggestion"]:
                    print_line(f"to try: {found['suggestion']}")
            if not found["success"] or interrupted.is_set():
                break
        if as_json:
            print_json({"running": simulation.address, "skills": results})
    if interrupted.is_set():
        return ExitCode.INTERRUPTED
    codes = {"succeeded": ExitCode.OK, "failed": ExitCode.NEGATIVE}
    return codes.get(results[-1]["outcome"], ExitCode.UNKNOWN)


# -- what is to be done ------------------------------------------------------------------------------------------------


def _arguments(command: str | None, plan: str | None, maps: Sequence[str]) -> tuple[str, list[str]]:
    """What is to be done, and the maps; with `--plan` the first argument is a map, too.

    Raises:
        InvalidArgumentError: there is nothing to do, or no map.
    """
    from mindstage.errors import InvalidArgumentError

    sources = list(maps)
    if plan is not None:
        sources, command = [*([command] if command is not None else []), *sources], plan
    if command is None:
        raise InvalidArgumentError("do", cause="there is nothing to do", remedy="give a command, or --plan FILE")
    if not sources:
        raise InvalidArgumentError("do", cause="there is no map", remedy=f"as in: do {command!r} bundled:kitchen")
    return command, sources


def _task(text: str, simulation: Simulation, *, deadline_s: float) -> tuple[Plan | PlanFile, list[str]]:
    """The plan of a command, a plan or a designator, and notes on how it was understood.

    Raises:
        InvalidArgumentError: it is none, or its arguments are not valid.
        PlanError: it is no valid plan.
    """
    from mindstage.imagination import Plan, load_plan

    path = Path(text)
    if path.suffix in {".yaml", ".yml"} or "\n" in text:
        return load_plan(text), []
    is_file = path.suffix == ".json"
    content = path.read_text(encoding="utf-8") if is_file else text.strip()
    if not content.lstrip().startswith(("{", "[")):
        steps, notes = _commands(text, simulation, deadline_s=deadline_s)
        return Plan(steps=tuple(steps), name=text), notes
    try:
        value = json.loads(content)
    except ValueError:
        return load_plan(text if is_file else f"{content}\n"), []  # the error names the line
    if (isinstance(value, dict) and not {"steps", "do"} & value.keys()) or _is_lisp(value):
        return _designated(value, simulation, deadline_s=deadline_s)
    if is_file:
        return load_plan(path), []
    from mindstage.imagination.trials import plan_from_text

    return plan_from_text(content), []


def _is_lisp(value: object) -> bool:
    """Whether it is a designator as a list, such as ["an", "action", …], rather than a list of steps."""
    return isinstance(value, list) and bool(value) and isinstance(value[0], str)


def _commands(text: str, simulation: Simulation | None, *, deadline_s: float) -> tuple[list[Perform], list[str]]:
    """The commands, separated by semicolons, and how sentences were understood.

    Args:
        text: skills with their arguments, or sentences.
        simulation: has the names of sentences; None if sentences cannot be understood.
        deadline_s: see `Perform`.

    Raises:
        InvalidArgumentError: there is no such skill, or its arguments are not valid.
        SentenceNotUnderstoodError: a sentence is no command, or not all of it is understood.
        AmbiguousSentenceError: a sentence may mean several commands.
    """
    from mindstage.errors import InvalidArgumentError, suggestion
    from mindstage.imagination import Perform
    from mindstage.robots.skill_declaration import skill_specs, split_command

    known, steps, notes = skill_specs(), list[Perform](), list[str]()
    for part in filter(None, map(str.strip, text.split(";"))):
        name, words = split_command(part)
        name = name.replace("-", "_")
        failure: InvalidArgumentError | None = None
        if name in known:
            try:
                steps.append(Perform(skill=name, args=known[name].parse(words), deadline_s=deadline_s))
            except InvalidArgumentError as error:
                failure = error  # it may be a sentence: open the fridge
            else:
                continue
        if simulation is None or not words or any("=" in word for word in words):
            remedy = suggestion(name, known)
            raise failure or InvalidArgumentError("do", cause=f"there is no skill {name!r}", remedy=remedy)
        step, note = _understood(part, simulation, deadline_s=deadline_s)
        steps.append(step)
        notes.append(note)
    return steps, notes


def _understood(sentence: str, simulation: Simulation, *, deadline_s: float) -> tuple[Perform, str]:
    """The step that a sentence commands, and how it was understood.

    Raises:
        InvalidArgumentError: it asks what would happen.
    """
    from mindstage.errors import InvalidArgumentError
    from mindstage.imagination import Perform
    from mindstage.knowledge.questions import StateAccess
    from mindstage.robots.commands import understand_command

    present = StateAccess(simulation.knowledge, simulation.current_state, simulation=simulation)
    found = understand_command(simulation.knowledge, sentence, present=present)
    if found.is_hypothetical:
        cause = "it asks what would happen, and nothing is done for that"
        raise InvalidArgumentError("do", cause=cause, remedy=f"'{found}' with --try-first 0.9 is tried first")
    return Perform(skill=found.skill, args=dict(found.args), deadline_s=deadline_s), f"understood: {found}"


def _designated(value: Any, simulation: Simulation, *, deadline_s: float) -> tuple[Plan, list[str]]:
    from mindstage.imagination import Perform, Plan
    from mindstage.robots.skills.designators import read_designator

    found = read_designator(value, simulation)
    words = " ".join([found.skill, *(f"{name}={each}" for name, each in found.args.items())])
    notes = [f"the designator is {words}"]
    notes += [f"{each.key}: {each.chosen} was taken, {', '.join(each.others)} would fit too" for each in found.choices]
    notes += [f"{key} is not used" for key in found.ignored]
    return Plan(steps=(Perform(skill=found.skill, args=found.args, deadline_s=deadline_s),), name=words), notes


def _new_file(record: Path | None) -> Path | None:
    from mindstage.errors import EpisodeFileError

    if record is not None and record.exists():
        raise EpisodeFileError(str(record), cause="it exists", remedy="delete it, or choose another name")
    return record


# -- the robot ---------------------------------------------------------------------------------------------------------


def _model(name: str, self_model: Path | None, *, xacro: XacroRequest) -> RobotModel:
    from mindstage.robots.models.reading import load_model

    with progress_spinner("reading the robot"):
        model = load_model(name, xacro=xacro, divide=True)
        if self_model is not None:
            from mindstage.robots.self_models import add_self_model, read_self_model

            model = add_self_model(model, read_self_model(self_model))
    return model


def _pose(text: str) -> tuple[float, float, float]:
    """A place on the floor from "X,Y" or "X,Y,YAW".

    Raises:
        InvalidArgumentError: it is none.
    """
    from mindstage.errors import InvalidArgumentError

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in {2, 3} or not all(map(math.isfinite, numbers)):
        raise InvalidArgumentError(
            f"--pose {text}", cause="it is no place", remedy="give X,Y or X,Y,YAW, as in 1.0,0.5"
        )
    return numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0


# -- doing it ----------------------------------------------------------------------------------------------------------


def _perform(
    simulation: Simulation,
    plan: Plan | PlanFile,
    wanted: _Wanted,
    *,
    cancel: Callable[[], bool],
    on_step: Callable[[SkillStep], object],
) -> tuple[SampleResult | None, TryFirstResult | None]:
    """What happened, None if nothing was done; and the trial before, if there was one."""
    from mindstage.imagination import act, try_first

    if wanted.at_least is None:
        return act(simulation, plan, seed=wanted.trial["seed"], stop=cancel, on_step=on_step), None
    tried = try_first(simulation, plan, at_least=wanted.at_least, cancel=cancel, on_step=on_step, **wanted.trial)
    return tried.result, tried


@contextmanager
def _steps_shown(*, quiet: bool) -> Iterator[Callable[[SkillStep], object]]:
    """Prints each step of a skill when it ends, unless it is quiet, and the running one on a terminal."""
    terminal = console(stderr=True)
    with ExitStack() as stack:
        status = stack.enter_context(terminal.status("")) if terminal.is_terminal else None

        def show(step: SkillStep) -> None:
            if step.end_s is None:
                if status is not None:
                    status.update(f"{step.name}: {step.text}")
                return
            if quiet:
                return
            took = f"{step.end_s - step.start_s:.1f} s"
            failed = "" if step.succeeded else " failed"
            print_line(f"{'  ' * step.depth}{step.name}: {step.text}{failed} ({took})")

        yield show


def _as_json(
    robot: Robot,
    result: SampleResult | None,
    tried: TryFirstResult | None,
    notes: list[str],
    wanted: _Wanted,
) -> dict[str, Any]:
    import msgspec

    found: dict[str, Any] = {
        "robot": {"name": robot.name, "model": robot.model.name},
        "done": result is not None,
        "outcome": None if result is None else result.outcome.value,
        "result": msgspec.to_builtins(result),
        "notes": notes,
    }
    if tried is not None:
        found |= {"try_first": tried.to_dict()}
    written = {"record": wanted.record, "out": wanted.out}
    return found | {name: str(path) for name, path in written.items() if path is not None}


def _print_result(result: SampleResult | None, tried: TryFirstResult | None, *, verbose: bool) -> None:
    if tried is not None:
        print_line(f"tried: {tried.verdict}")
    if result is None:
        print_line(str(tried))
        return
    for event in result.events if verbose else ():
        print_line(f"at {event.time_s:.1f} s: {event.text}")
    cause = f": {result.cause.text}" if result.cause is not None else ""
    print_line(f"{result.outcome.value} after {result.duration_s:.1f} s{cause}")
    for done in result.skills:
        if done.suggestion:
            print_line(f"to try: {done.suggestion}")
        for text in done.assumptions:
            warn(f"assumed: {text}")
    if result.skills and result.cause is None:
        print_line(result.skills[-1].state.text)
