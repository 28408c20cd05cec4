"""The verb `prolog`: a Prolog console in which each question is a predicate."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage import __version__
from mindstage.access.limits import Deadline
from mindstage.cli.attach import open_running, print_running_solutions, prolog_lines, running_target, warn_of_limit
from mindstage.cli.options import (
    DEFAULT_READING,
    NO_EPISODES,
    EndpointUrl,
    EngineName,
    EpisodeOptions,
    ExitCode,
    MapReading,
    Port,
    Running,
    StoreFolder,
)
from mindstage.cli.output import (
    class_lookup,
    findings_json,
    print_findings,
    print_json,
    print_line,
    progress_spinner,
)
from mindstage.cli.setup import knowledge_with_episodes, make_engine, simulation_from_options
from mindstage.cli.viewer import open_viewer
from mindstage.ranges import Count

if TYPE_CHECKING:
    from mindstage.prolog import PrologConsole, Solutions
    from mindstage.rdf import Finding
    from mindstage.simulation import Simulation

__all__ = ["prolog"]


_SomeMaps = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[MAP]…",
        help="Semantic maps (OWL or Turtle), or bundled:kitchen, loaded into one knowledge base.",
        show_default=False,
    ),
]
_Goal = Annotated[
    str | None,
    typer.Option("--goal", "-g", help="Run this goal once and exit: 0 true, 1 false, 2 error.", show_default=False),
]
_Consult = Annotated[
    list[str] | None,
    typer.Option(
        "--consult",
        metavar="FILE",
        help="Facts and rules to load first; may be repeated.",
        show_default=False,
    ),
]
_Timeout = Annotated[Deadline, typer.Option("--timeout", metavar="SECONDS", help="The timeout of --goal.")]
_Limit = Annotated[
    Count, typer.Option("--limit", metavar="NUMBER", help="The maximum number of solutions that --json prints.")
]
_WithViewer = Annotated[bool, typer.Option("--viewer/--no-viewer", help="Serve the page of the simulation.")]
_AllAsJson = Annotated[bool, typer.Option("--json", help="With --goal: find all solutions, and print them as JSON.")]


def prolog(
    context: typer.Context,
    maps: _SomeMaps = None,
    *,
    running: Running = None,
    goal: _Goal = None,
    consult: _Consult = None,
    timeout_s: _Timeout = 30.0,
    limit: _Limit = 1_000_000,
    store: StoreFolder = None,
    endpoint: EndpointUrl = None,
    reading: MapReading = DEFAULT_READING,
    recorded: EpisodeOptions = NO_EPISODES,
    engine: EngineName = "mujoco",
    with_viewer: _WithViewer = False,
    port: Port = None,
    as_json: _AllAsJson = False,
) -> ExitCode:
    """Start SWI-Prolog with each question as a predicate, or run one goal.

    With --running, queries of questions and their combinations are answered by a running simulation. With --episode,
    occurs/2, holds/4 and object_pose_at_time/3 answer about that episode.
    """
    from mindstage.prolog import PrologConsole, load_library

    if as_json and goal is None:
        raise typer.BadParameter("it requires --goal", param_hint="--json")
    allowed = {"running", "goal", "timeout_s", "limit", "as_json"}
    if (target := running_target(context, running, maps, allowed=allowed)) is not None:
        return _solve_running(target, goal, timeout_s=timeout_s, limit=limit, as_json=as_json)
    load_library()  # before the map is read, so that a missing SWI-Prolog fails at once
    chosen = make_engine(engine)
    with progress_spinner("reading"):
        knowledge = knowledge_with_episodes(maps or [], reading, recorded, store=store, endpoint=endpoint)
    if not as_json:
        print_findings(knowledge.findings(), classes=class_lookup(knowledge))
    with ExitStack() as closing:
        closing.callback(knowledge.close)
        simulation = closing.enter_context(simulation_from_options(knowledge, chosen))
        console = closing.enter_context(PrologConsole(simulation, at_halt=closing.close))
        if with_viewer:
            _open_viewer(simulation, closing, port=port)
        _consult(console, consult or [], strict=goal is not None)
        if goal is not None:
            if not as_json:
                return ExitCode.OK if console.holds(goal, timeout_s=timeout_s) else ExitCode.NEGATIVE
            solutions = console.solutions(goal, limit=limit, timeout_s=timeout_s)
            return _print_solutions(goal, solutions, findings=knowledge.findings())
        _print_banner(simulation)
        console.toplevel()
    return ExitCode.OK


def _solve_running(target: str, goal: str | None, *, timeout_s: float, limit: int, as_json: bool) -> ExitCode:
    """Solves one goal, or those on standard input, in a running simulation."""
    with open_running(target) as simulation:
        if goal is None:
            return prolog_lines(simulation, timeout_s=timeout_s, limit=limit)
        wanted = limit if as_json else 1
        result = simulation.query("prolog", goal, timeout_s=timeout_s, limit=wanted)
        if as_json:
            print_running_solutions(simulation, result)
    return ExitCode.OK if result["solutions"] else ExitCode.NEGATIVE


def _print_solutions(goal: str, solutions: Solutions, *, findings: Sequence[Finding]) -> ExitCode:
    """Prints solutions as JSON; if the search stopped at the limit, that is a warning too."""
    output = {"goal": goal, "solutions": solutions, "complete": solutions.complete}
    print_json(output | {"findings": findings_json(findings)})
    if not solutions.complete:
        warn_of_limit(solutions)
    return ExitCode.OK if solutions else ExitCode.NEGATIVE


def _open_viewer(simulation: Simulation, closing: ExitStack, *, port: int | None) -> None:
    viewer = open_viewer(simulation, port=port)
    closing.callback(viewer.close)
    simulation.play()
    typer.echo(f"The world is served at {viewer.url}", err=True)  # stdout is used by Prolog


def _consult(console: PrologConsole, files: list[str], *, strict: bool) -> None:
    """Loads the files of the user.

    Raises:
        SourceParseError: a file does not exist, or, with `strict`, has errors.
    """
    from mindstage.errors import SourceParseError

    for file in files:
        errors = console.consult(file)
        if errors and strict:
            raise SourceParseError(file, cause=f"{errors} error{'s' if errors > 1 else ''} in it, printed above")


def _print_banner(simulation: Simulation) -> None:
    if sys.stdin.isatty() and sys.stdout.isatty():
        maps = ", ".join(re.split("[#/]", map)[-1] for map in simulation.knowledge.maps()) or "no map"
        print_line(f"Mindstage {__version__} in SWI-Prolog with {maps}. Each question is a predicate:")
        print_line("questions. lists them, handle_of(Map, Thing, Handle). calls one, halt. or Ctrl-D exits.")
