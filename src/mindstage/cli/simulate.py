"""The verbs `spawn`, `log` and `check`: a map is spawned, then simulated, logged or compared with its snapshot.

They share `spawned_map`, which reads a map and spawns it, and `SpawnedMap`, which prints the result and its exit code.
"""

from __future__ import annotations

import gc
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    DEFAULT_SPAWN,
    LOCAL_SERVER,
    AsJson,
    Delta,
    ExitCode,
    Ground,
    MapArguments,
    MapReading,
    MapSpawning,
    Port,
    Seconds,
    ServerOptions,
    Strict,
    Verbose,
    WithViewer,
    close_at_end,
)
from mindstage.cli.output import (
    Shortcoming,
    Timings,
    class_lookup,
    diff_json,
    difference_summary,
    findings_json,
    import_summary,
    losses_json,
    notes_json,
    print_diff,
    print_findings,
    print_import_summary,
    print_json,
    print_line,
    print_losses,
    print_notes,
    print_reasons,
    print_report,
    print_table,
    progress_spinner,
    reasons_json,
    report_json,
    shortcomings,
    show_mesh_progress,
    step_with_progress,
)
from mindstage.cli.setup import (
    exclusive,
    findings_about,
    is_remote_engine,
    knowledge_base,
    make_engine,
    simulation_from_options,
)
from mindstage.cli.viewer import print_and_serve, server_access
from mindstage.errors import InvalidArgumentError
from mindstage.ranges import WallTime

if TYPE_CHECKING:
    from mindstage.engines import Engine, SpawnReport
    from mindstage.engines.base import MovedBody
    from mindstage.knowledge import KnowledgeBase
    from mindstage.maps import SourceMapView
    from mindstage.rdf import Finding
    from mindstage.scene import Body, BodyId, Joint, Light, Statement, World, WorldDiff
    from mindstage.scene.transforms import Array
    from mindstage.simulation import Simulation

__all__ = ["SpawnedMap", "check", "log", "spawn", "spawned_map"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpawnedMap:
    """A map that was read and spawned."""

    simulation: Simulation
    knowledge: KnowledgeBase
    world: World
    """The world as the map describes it."""
    findings: Sequence[Finding]
    """The findings of the knowledge base."""
    report: SpawnReport
    timings: Timings
    """Wall time of the parts `load` and `spawn`."""

    @property
    def reasons(self) -> list[Shortcoming]:
        """Why the verb exits with 1: what was not read, was not spawned, or did not stay; often empty."""
        return shortcomings(self.report, self.findings)

    def to_json(self, *, reasons: Sequence[Shortcoming] | None = None) -> dict[str, object]:
        """The report, the findings and the assumptions as they appear in JSON.

        Args:
            reasons: those of the exit code; by default those of an incomplete world.
        """
        chosen = self.reasons if reasons is None else reasons
        spawned = {"spawn": report_json(self.report), "findings": findings_json(self.findings)}
        return spawned | {"reasons": reasons_json(chosen)} | import_summary(self.world, self.knowledge)

    def print(self, *, verbose: bool = False) -> None:
        """Prints the findings, the assumptions and the report."""
        print_findings(self.findings, all=verbose, classes=class_lookup(self.knowledge))
        print_import_summary(self.world, self.knowledge, verbose=verbose)
        print_report(self.report, title=self.world.name, verbose=verbose)


@contextmanager
def spawned_map(
    maps: Sequence[str],
    options: MapSpawning,
    *,
    strict: bool,
    ground: bool = True,
    check_rest: bool = True,
    in_empty_world: bool = False,
) -> Iterator[SpawnedMap]:
    """Reads a map and spawns it; the simulation is closed at the end of the `with` block.

    Args:
        maps: the sources, loaded into one knowledge base.
        options: how they are read, and which map is spawned how.
        strict: whether a map with findings is rejected.
        ground: see `Simulation.spawn`.
        check_rest: see `Simulation.spawn`.
        in_empty_world: whether a remote world must be empty, and is cleared at the end; see `exclusive`.
    """
    engine = make_engine(options.engine)  # before the map is read, so that a wrong name fails at once
    timings = Timings()
    with progress_spinner("reading"), timings.measure("load"):
        knowledge = knowledge_base(maps, options)
        if not options.primitive_shapes:
            from mindstage.saving import mesh_assets

            knowledge.use_meshes(mesh_assets(options.asset_folders(), knowledge, progress=show_mesh_progress).bounds)
        world = knowledge.world(options.map_name)
    findings = findings_about(world, knowledge, strict=strict, options=options)
    with ExitStack() as stack:
        simulation = stack.enter_context(simulation_from_options(knowledge, engine, options))
        if in_empty_world:
            stack.enter_context(exclusive(simulation))
        with progress_spinner("spawning"), timings.measure("spawn"):
            report = simulation.spawn(world, ground=ground, check_rest=check_rest)
        yield SpawnedMap(
            simulation=simulation, knowledge=knowledge, world=world, findings=findings, report=report, timings=timings
        )


# -- spawn -------------------------------------------------------------------------------------------------------------


def spawn(
    maps: MapArguments,
    *,
    options: MapSpawning = DEFAULT_SPAWN,
    strict: Strict = False,
    ground: Ground = True,
    with_viewer: WithViewer = True,
    port: Port = None,
    server: ServerOptions = LOCAL_SERVER,
    seconds: Seconds = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Spawn a map, print a report, and simulate it; exit 1 if anything could not be spawned or is not at rest.

    Bodies that move by more than 0.1 m within the first two simulated seconds are not at rest.
    """
    access = server_access(server)
    with spawned_map(maps, options, strict=strict, ground=ground) as spawned:
        output: dict[str, object] = {"map": spawned.world.iri, "engine": spawned.simulation.engine.name}
        output |= {"seconds": spawned.timings.seconds} | spawned.to_json()
        if not as_json:
            spawned.print(verbose=verbose)
        if with_viewer:
            print_and_serve(spawned.simulation, output, port=port, access=access, duration_s=seconds, as_json=as_json)
        else:
            _run(spawned.simulation, output, seconds=seconds or 0.0, as_json=as_json)
    if not as_json:
        print_reasons(spawned.reasons)
    return ExitCode.NEGATIVE if spawned.reasons else ExitCode.OK


def _run(simulation: Simulation, output: dict[str, object], *, seconds: float, as_json: bool) -> None:
    import msgspec

    from mindstage.engines.environment_bounds import MOVED_DISTANCE_M

    with progress_spinner("preparing"):  # compiles the world
        before = simulation.engine.run(lambda engine: engine.poses(), label="poses")
    wall_s = step_with_progress(simulation, seconds)
    factor = seconds / wall_s if seconds else None
    moved = _moved_bodies(simulation, *before)
    if as_json:
        output |= {"simulated_s": seconds, "real_time_factor": factor, "moved": msgspec.to_builtins(moved)}
        print_json(output | {"notes": notes_json(simulation.engine.notes)})
        return
    print_notes(simulation.engine.notes)
    if moved:
        fallen = sum(body.left_place for body in moved)
        left = f", {fallen} of them left the place" if fallen else ""
        print_line(f"{len(moved)} bodies moved by more than {MOVED_DISTANCE_M:g} m{left}: {_moved_text(moved)}")
    if factor:
        print_line(f"{seconds:g} s simulated in {wall_s:.2f} s: {factor:.1f} times real time")


def _moved_bodies(simulation: Simulation, ids: tuple[BodyId, ...], before: Array) -> tuple[MovedBody, ...]:
    """The bodies that are not where they were, farthest first."""
    import numpy as np

    from mindstage.engines.environment_bounds import EnvironmentBounds, find_moved_bodies
    from mindstage.scene.bounding_boxes import OrientedBoxes

    sizes = {body.id: body.size for world in simulation.worlds for body in world.bodies}
    boxes = OrientedBoxes.from_poses(before, np.array([sizes.get(id) or (0.0, 0.0, 0.0) for id in ids]).reshape(-1, 3))
    _, after = simulation.engine.run(lambda engine: engine.poses(), label="poses")
    return find_moved_bodies(ids, before, after, EnvironmentBounds.from_boxes(boxes))


_MAX_MOVED = 3
"""Limit of the bodies that the line about a simulation names."""


def _moved_text(moved: Sequence[MovedBody]) -> str:
    named = [f"{body.id} by {body.distance_m:.3g} m" for body in moved[:_MAX_MOVED]]
    return ", ".join(named) + (" …" if len(moved) > _MAX_MOVED else "")


# -- log ---------------------------------------------------------------------------------------------------------------


OptionalMaps = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[MAP]…",
        help="A semantic map, or bundled:kitchen; without one, the world of a remote engine is logged.",
        show_default=False,
    ),
]


def log(
    maps: OptionalMaps = None,
    *,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="OUT", help="The map to write: .owl, .rdf, .xml or .ttl.", show_default=False
        ),
    ],
    options: MapSpawning = DEFAULT_SPAWN,
    strict: Strict = False,
    ground: Ground = True,
    seconds: Annotated[
        WallTime,
        typer.Option("--for", metavar="SECONDS", help="Simulated time before logging."),
    ] = 0.0,
    as_json: AsJson = False,
) -> ExitCode:
    """Spawn a map, simulate it, and write the world; exit 1 if anything could not be spawned or is not at rest.

    Without a map, the world of a remote engine is written.
    """
    if not maps:
        return _log_remote(make_engine(options.engine), out, seconds=seconds, as_json=as_json)
    with spawned_map(maps, options, strict=strict, ground=ground) as spawned:
        written = _write(spawned.simulation, out, seconds=seconds)
        notes = spawned.simulation.engine.notes
    if as_json:
        print_json(written | spawned.to_json())
    else:
        spawned.print()
        print_notes(notes)
        _print_summary(written)
        print_reasons(spawned.reasons)
    return ExitCode.NEGATIVE if spawned.reasons else ExitCode.OK


def _log_remote(engine: Engine, out: Path, *, seconds: float, as_json: bool) -> ExitCode:
    """Writes the world of a remote engine.

    Raises:
        InvalidArgumentError: the engine is a local one, whose world is empty.
    """
    from mindstage.knowledge import KnowledgeBase
    from mindstage.simulation import Simulation

    if not is_remote_engine(engine.name):
        remedy = "name a map, or --engine ros://HOST:PORT/NAMESPACE"
        raise InvalidArgumentError("MAP", cause=f"the world of the engine {engine.name!r} is empty", remedy=remedy)
    with Simulation(KnowledgeBase(), engine) as simulation:
        written = _write(simulation, out, seconds=seconds)
    if as_json:
        print_json(written)
    else:
        _print_summary(written)
    return ExitCode.OK


def _write(simulation: Simulation, out: Path, *, seconds: float) -> dict[str, object]:
    """Simulates, writes the world, and returns a summary of what was written."""
    from mindstage.maps import save_map

    step_with_progress(simulation, seconds)
    with progress_spinner("logging"):
        logged = simulation.snapshot()
        save_map(logged, out)
    return {
        "notes": notes_json(simulation.engine.notes),
        "map": logged.iri,
        "engine": simulation.engine.name,
        "simulated_s": seconds,
        "out": str(out),
        "bodies": len(logged.bodies),
        "joints": len(logged.joints),
    }


def _print_summary(summary: dict[str, object]) -> None:
    print_line(f"{summary['bodies']} bodies, {summary['joints']} joints → {summary['out']}")


# -- check -------------------------------------------------------------------------------------------------------------

_NON_XML_SUFFIXES = frozenset({".ttl", ".nt", ".n3", ".trig", ".nq"})
"""Formats whose names and characters RDF/XML cannot always express."""


def check(
    maps: MapArguments,
    *,
    options: MapSpawning = DEFAULT_SPAWN,
    strict: Strict = False,
    ground: Ground = True,
    delta: Delta = 0.0,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Spawn a map, log it, write it, read it again, and compare; exit 0 only if nothing was lost or moved away.

    The round trip is: map, engine, snapshot, OWL file in the dialect of the map, map. The worlds and all statements of
    the map are compared.
    """
    if gc.isenabled():  # this verb creates no reference cycles, and keeps nearly all objects until its end
        gc.disable()
        close_at_end(gc.enable)
    opened = spawned_map(maps, options, strict=strict, ground=ground, check_rest=False, in_empty_world=True)
    with opened as spawned, ThreadPoolExecutor(1) as second_thread:
        simulation, world, timings = spawned.simulation, spawned.world, spawned.timings
        engine_name = simulation.engine.name
        with progress_spinner("logging"), timings.measure("log"):
            logged = simulation.snapshot()
        checked = second_thread.submit(simulation.with_rest, spawned.report)  # MuJoCo steps without Python's lock
        with progress_spinner("writing and reading back"), timings.measure("file"):
            origin = spawned.knowledge.source_view(world.iri)
            needs_turtle = any(Path(map).suffix.lower() in _NON_XML_SUFFIXES for map in maps)
            name = "logged.ttl" if needs_turtle else "logged.owl"
            written = _file_round_trip(name, logged, origin, options)
            written.world(world.iri)
        with progress_spinner("comparing"), timings.measure("compare"):
            by_engine, found, lost = _compare_round_trip(world, logged, written, origin, delta)
        with progress_spinner("simulating"), timings.measure("rest"):
            spawned = replace(spawned, report=checked.result())
    identical = by_engine.identical(delta) and found.identical(delta) and not lost
    # A difference caused by the engine is in the file too; it is printed once.
    difference = found if by_engine.identical(delta) else by_engine
    reasons = [*_check_reasons(difference, lost, delta), *spawned.reasons]
    if as_json:
        output = diff_json(found, delta) | losses_json(found, lost) | {"identical": identical, "engine": engine_name}
        output |= {"identical_before_file": by_engine.identical(delta), "dialect": origin.dialect}
        output |= {"verdict": _verdict(identical=identical, reasons=reasons)}
        print_json(output | {"map": world.iri, "seconds": timings.seconds} | spawned.to_json(reasons=reasons))
    else:
        spawned.print(verbose=verbose)
        print_table("Seconds", tuple(timings.seconds), [[round(spent, 3) for spent in timings.seconds.values()]])
        others = [reason for reason in reasons if reason.kind != "different"]
        print_diff(difference, delta, about=world, summary=not others)
        print_losses(lost)
        but = "but" if difference.identical(delta) else "and"
        print_reasons(others, start=f"{difference_summary(difference, delta).rstrip('.')}, {but}")
    return ExitCode.NEGATIVE if reasons else ExitCode.OK


def _check_reasons(difference: WorldDiff, lost: Sequence[Statement], delta: float) -> Iterator[Shortcoming]:
    """Why the worlds are not identical; nothing if they are."""
    if not difference.identical(delta):
        count = len(difference.only_in_a) + len(difference.only_in_b) + len(difference.exceeding(delta))
        count += len(difference.lost) + len(difference.gained)
        yield Shortcoming("different", count, difference_summary(difference, delta).rstrip("."))
    if lost:
        plural = "s of the map are" if len(lost) > 1 else " of the map is"
        yield Shortcoming("lost", len(lost), f"{len(lost):,} statement{plural} lost")


def _verdict(*, identical: bool, reasons: Sequence[Shortcoming]) -> str:
    """The result in one word: ok, incomplete (identical, but not all of the map was spawned), or different."""
    if not identical:
        return "different"
    return "incomplete" if reasons else "ok"


def _file_round_trip(name: str, world: World, origin: SourceMapView, reading: MapReading) -> KnowledgeBase:
    from mindstage.maps import save_map

    with TemporaryDirectory(prefix="mindstage-") as folder:
        path = Path(folder, name)
        save_map(world, path, source_view=origin)
        # The written map must state what it was read with, so it is read without robots and conventions.
        return knowledge_base([str(path)], MapReading(ontologies=reading.ontologies, bundled=reading.bundled))


def _compare_round_trip(
    world: World, logged: World, written: KnowledgeBase, origin: SourceMapView, delta: float
) -> tuple[WorldDiff, WorldDiff, tuple[Statement, ...]]:
    """The differences caused by the engine, those after reading the file, and the statements that the file lacks."""
    from mindstage.maps import lost_statements
    from mindstage.scene import diff

    by_engine, found = diff(world, logged), diff(world, written.world(world.iri))
    items: Iterable[Body | Joint | Light] = chain(world.bodies, world.joints, world.lights)
    rounded = {change.id for change in by_engine.changed} - {change.id for change in by_engine.exceeding(delta)}
    moved = {item.iri for item in items if item.id in rounded}
    return by_engine, found, lost_statements(origin, written.source_view(world.iri), moved=moved)
