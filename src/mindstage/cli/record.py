"""The verb `record`, and `episode info` and `episode repair`: episode files are written, described and repaired."""

from __future__ import annotations

import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    DEFAULT_SPAWN,
    LOCAL_SERVER,
    AsJson,
    ExitCode,
    Ground,
    MapArguments,
    MapSpawning,
    Port,
    ServerOptions,
    Strict,
)
from mindstage.cli.output import (
    print_json,
    print_line,
    print_reasons,
    print_table,
    progress_bar,
    progress_spinner,
    step_with_progress,
)
from mindstage.cli.simulate import spawned_map
from mindstage.cli.viewer import server_access, show_page
from mindstage.errors import EpisodeFileError
from mindstage.ranges import Frequency, WallTime

if TYPE_CHECKING:
    from mindstage.episodes.mcap_file import EpisodeLoss
    from mindstage.episodes.recorder import Recorder
    from mindstage.simulation import Simulation

__all__ = ["info", "record", "repair"]

_POLL_INTERVAL_S = 0.1

OutputFile = Annotated[
    Path,
    typer.Option("--out", "-o", metavar="FILE", help="The episode to write, a new file (.mcap).", show_default=False),
]
Rate = Annotated[Frequency, typer.Option("--rate", metavar="HZ", help="Frames per simulated second.")]
SimulatedSeconds = Annotated[
    WallTime | None,
    typer.Option(
        "--for",
        metavar="SECONDS",
        help="Simulate this time as fast as possible; with --viewer, record for this wall time. Otherwise in real "
        "time until Ctrl-C.",
        show_default=False,
    ),
]
WithViewer = Annotated[bool, typer.Option("--viewer/--no-viewer", help="Serve the page while it is recorded.")]
SelfContained = Annotated[
    bool,
    typer.Option(
        "--self-contained",
        help="Write geometry and maps to the file, not to the folder `contents` that episodes have in common.",
    ),
]
EpisodePath = Annotated[Path, typer.Argument(metavar="FILE", help="An episode (.mcap).", show_default=False)]


def record(
    maps: MapArguments,
    *,
    out: OutputFile,
    seconds: SimulatedSeconds = None,
    rate: Rate = 30.0,
    options: MapSpawning = DEFAULT_SPAWN,
    strict: Strict = False,
    ground: Ground = True,
    with_viewer: WithViewer = False,
    self_contained: SelfContained = False,
    port: Port = None,
    server: ServerOptions = LOCAL_SERVER,
    as_json: AsJson = False,
) -> ExitCode:
    """Spawn a map, simulate it, and record an episode; exit 1 if anything could not be spawned or is not at rest.

    What is older than a second is in the file even if the process is killed.
    """
    from mindstage.episodes import Recorder
    from mindstage.simulation.observation import as_client

    if out.exists():  # before the map is read
        raise EpisodeFileError(str(out), cause="it exists", remedy="delete it, or choose another name")
    access = server_access(server)
    with (
        as_client("command line", trusted=True),
        spawned_map(maps, options, strict=strict, ground=ground) as spawned,
    ):
        simulation = spawned.simulation
        if not as_json:
            spawned.print()
        with ExitStack() as ending:
            with progress_spinner("preparing"):  # compiles the world, and writes its knowledge
                recorder = ending.enter_context(Recorder(simulation, out, rate_hz=rate, self_contained=self_contained))
            if with_viewer:
                show_page(
                    simulation, port=port, access=access, duration_s=seconds, announce=_announce_page, quiet=as_json
                )
            elif seconds is not None:
                step_with_progress(simulation, seconds)
            else:
                _play_until_interrupted(simulation, recorder, quiet=as_json)
            with progress_bar("writing") as done:  # the last frames, and the events that the whole recording shows
                recorder.stop(progress=done)
        seconds, frames, size = recorder.time_s, recorder.frames, out.stat().st_size
        fault = None if recorder.error is None else str(recorder.error)
        if as_json:
            written = {"file": str(out), "seconds": seconds, "frames": frames, "bytes": size, "fault": fault}
            print_json(written | spawned.to_json())
        else:
            print_line(f"{out}: {seconds:.2f} s, {frames:,} frames, {size:,} bytes")
            if fault is not None:
                print_line(f"Fault: {fault}")
            print_reasons(spawned.reasons)
    return ExitCode.NEGATIVE if spawned.reasons else ExitCode.OK


def _announce_page(url: str) -> None:
    print_line(f"The world is served at {url}")


def _play_until_interrupted(simulation: Simulation, recorder: Recorder, *, quiet: bool) -> None:
    """Plays in real time; Ctrl-C is the normal end."""
    if not quiet:
        print_line(f"Recording to {recorder.path}. Press Ctrl-C to stop.")
    simulation.play()
    try:
        while recorder.recording and simulation.state.playing:
            time.sleep(_POLL_INTERVAL_S)
    except KeyboardInterrupt:
        pass
    simulation.pause()


def info(file: EpisodePath, *, as_json: AsJson = False) -> ExitCode:
    """Describe an episode, and check all of it; exit 1 if a part of it cannot be read."""
    from mindstage.episodes.episode import Episode

    with progress_spinner("reading"), Episode(file) as episode:
        losses = episode.losses
        edits, events = Counter(edit.kind for edit in episode.edits()), Counter(each.kind for each in episode.events())
        frame = episode.frame_at(episode.end_s)
        frames = sum(1 for _ in episode.frames())
        summary: dict[str, object] = {
            "file": str(file),
            "bytes": episode.size_bytes,
            "begin_s": episode.begin_s,
            "end_s": episode.end_s,
            "start_unix_s": episode.start_unix_s,
            "engine": episode.header.engine,
            "rate_hz": episode.header.rate_hz,
            "frames": frames,
            "bodies": len(frame.ids),
            "maps": [world.iri for world in episode.spawned],
            "edits": dict(edits),
            "events": {kind.value: count for kind, count in events.items()},
            "faults": list(episode.faults()),
            "losses": _losses_json(losses),
        }
    if as_json:
        print_json(summary)
    else:
        _print_info(summary, losses)
    return ExitCode.NEGATIVE if losses else ExitCode.OK


def _print_info(summary: dict[str, object], losses: tuple[EpisodeLoss, ...]) -> None:
    rows: list[tuple[str, str]] = []
    for name, value in summary.items():
        match value:
            case dict():
                text = ", ".join(f"{count} x {kind}" for kind, count in value.items()) or "none"
            case list():
                text = ", ".join(map(str, value))
            case float():
                text = f"{value:.6g}" if name != "start_unix_s" else _wall_time(value)
            case _:
                text = str(value)
        if name not in {"file", "losses"}:
            rows.append((name, text))
    print_table(str(summary["file"]), ("property", "value"), rows)
    _print_losses(losses)


def _wall_time(unix_s: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(unix_s))


def _losses_json(losses: tuple[EpisodeLoss, ...]) -> list[dict[str, object]]:
    return [{"begin_s": each.begin_s, "end_s": each.end_s, "cause": each.cause} for each in losses]


def _print_losses(losses: tuple[EpisodeLoss, ...]) -> None:
    for loss in losses:
        begin = "" if loss.begin_s is None else f" after {loss.begin_s:.3f} s"
        end = "" if loss.end_s is None else f" until {loss.end_s:.3f} s"
        print_line(f"lost{begin}{end}: {loss.cause}")
    if not losses:
        print_line("Everything in it is readable.")


RepairedFile = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="The file to write; by default FILE-repaired.mcap, beside the damaged one.",
        show_default=False,
    ),
]


def repair(file: EpisodePath, *, out: RepairedFile = None, as_json: AsJson = False) -> ExitCode:
    """Write a whole episode with everything that is readable in a damaged one; exit 1 if anything was lost."""
    from mindstage.episodes.mcap_file import repair as repair_file

    written = out or file.with_name(f"{file.stem}-repaired.mcap")
    with progress_spinner("repairing"):
        losses = repair_file(file, written)
    if as_json:
        print_json({"file": str(written), "losses": _losses_json(losses)})
    else:
        print_line(f"{written} was written.")
        _print_losses(losses)
    return ExitCode.NEGATIVE if losses else ExitCode.OK
