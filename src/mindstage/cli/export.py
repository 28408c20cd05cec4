"""The verbs `episode export` and `episode import`: episodes in the formats of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import DEFAULT_MAP, AsJson, ExitCode, MapChoice, close_at_end
from mindstage.cli.output import print_json, print_line, progress_spinner, warn
from mindstage.cli.setup import knowledge_base
from mindstage.errors import InvalidArgumentError
from mindstage.ranges import Frequency

if TYPE_CHECKING:
    from mindstage.episodes.recording import Recording
    from mindstage.episodes.transform_recording import TransformRecording
    from mindstage.knowledge import KnowledgeBase
    from mindstage.scene import BodyId

__all__ = ["ExportFormat", "export", "import_"]


class ExportFormat(StrEnum):
    """The formats that episodes are exported to."""

    NEEM = "neem"
    """KnowRob 2: a folder with OWL, poses and the map."""
    SEMLOG = "semlog"
    """The events as OWL, as USemLog writes them."""
    HTML = "html"
    """One page that plays by itself."""
    CSV = "csv"
    """Poses, and events in a second file."""
    LEROBOT = "lerobot"
    """A dataset for LeRobot, version 3.0."""


_SUFFIXES = {
    ".neem": ExportFormat.NEEM,
    ".owl": ExportFormat.SEMLOG,
    ".ttl": ExportFormat.SEMLOG,
    ".html": ExportFormat.HTML,
    ".csv": ExportFormat.CSV,
}

Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...",
        help="The episode (.mcap), or a NEEM; several only for a dataset of LeRobot.",
        show_default=False,
    ),
]
Output = Annotated[
    Path,
    typer.Option(
        "--out",
        "-o",
        metavar="PATH",
        help="What is written: .neem, .owl or .ttl (SemLog), .html, .csv; with --format any name.",
        show_default=False,
    ),
]
Format = Annotated[
    ExportFormat | None,
    typer.Option("--format", help="The format; by default that of the suffix.", show_default=False),
]
Rate = Annotated[
    Frequency,
    typer.Option("--rate", metavar="HZ", help="Frames per second of a page and of a dataset."),
]
Bag = Annotated[
    Path,
    typer.Argument(
        metavar="BAG",
        help="A bag (.bag, .mcap, .db3, or a folder of rosbag2), or the folder of a NEEM.",
        show_default=False,
    ),
]
Map = Annotated[
    list[str] | None,
    typer.Option(
        "--map", metavar="MAP", help="The map that was recorded; a NEEM may have its own.", show_default=False
    ),
]
EpisodeOutput = Annotated[
    Path,
    typer.Option("--out", "-o", metavar="FILE", help="The episode to write, a new file (.mcap).", show_default=False),
]
BodyOfFrame = Annotated[
    list[str] | None,
    typer.Option(
        "--body",
        metavar="FRAME=ID",
        help="The body that a frame is, where its name does not show it; may be repeated.",
        show_default=False,
    ),
]
MapFrame = Annotated[
    str | None,
    typer.Option(
        "--map-frame",
        metavar="FRAME",
        help="The frame in which the poses of the map are; by default map, world, or the only root.",
        show_default=False,
    ),
]
Relative = Annotated[
    bool,
    typer.Option(
        "--relative",
        help="Move each body from its pose in the map as its frame moves, whose origin may be another one.",
    ),
]


def export(files: Files, *, out: Output, format: Format = None, rate: Rate = 30.0, as_json: AsJson = False) -> ExitCode:
    """Write an episode for another program: KnowRob, a browser, LeRobot, or a table.

    What the format cannot express is listed.
    """
    chosen = format or _SUFFIXES.get(out.suffix.lower())
    if chosen is None:
        raise InvalidArgumentError(
            str(out), cause="its suffix is that of no format", remedy=f"use {', '.join(_SUFFIXES)} or --format"
        )
    if len(files) > 1 and chosen is not ExportFormat.LEROBOT:
        raise InvalidArgumentError(
            str(files[1]), cause=f"{chosen} has one episode", remedy="export them one by one, or to lerobot"
        )
    if rate <= 0.0:
        raise InvalidArgumentError("--rate", cause=f"{rate:g} Hz is not above 0", remedy="30 is the default")
    recordings = [_open(file) for file in files]
    with progress_spinner(f"writing {out}"):
        written, losses = _write(recordings, out, chosen, rate)
    if as_json:
        print_json({"files": [str(path) for path in written], "format": chosen.value, "losses": list(losses)})
    else:
        for path in written:
            print_line(f"{path} was written.")
        for loss in losses:
            warn(f"not in it: {loss}")
    return ExitCode.OK


def _open(path: Path) -> Recording:
    from mindstage.episodes.episode import Episode
    from mindstage.episodes.neem import read_neem

    if path.is_dir():
        return read_neem(path)
    episode = Episode(path)
    close_at_end(episode.close)
    return episode


def _write(
    recordings: Sequence[Recording], out: Path, format: ExportFormat, rate: float
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Writes the file; returns all files that were written, and what is not in them."""
    from mindstage.episodes.exports import write_csv, write_lerobot
    from mindstage.episodes.neem import write_neem
    from mindstage.episodes.semlog import write_semlog

    recording = recordings[0]
    match format:
        case ExportFormat.NEEM:
            return (out,), write_neem(recording, out)
        case ExportFormat.SEMLOG:
            return (out,), write_semlog(recording, out)
        case ExportFormat.HTML:
            from mindstage.viewer.html_export import write_html

            write_html(recording, out, rate_hz=rate)
        case ExportFormat.CSV:
            return write_csv(recording, out), ()
        case ExportFormat.LEROBOT:
            if rate != int(rate):
                cause = f"LeRobot counts whole frames per second, {rate:g} is none"
                raise InvalidArgumentError("--rate", cause=cause, remedy=f"use {round(rate)}")
            write_lerobot(recordings, out, fps=int(rate))
    return (out,), ()


def import_(
    bag: Bag,
    *,
    out: EpisodeOutput,
    maps: Map = None,
    body: BodyOfFrame = None,
    map_frame: MapFrame = None,
    relative: Relative = False,
    reading: MapChoice = DEFAULT_MAP,
    as_json: AsJson = False,
) -> ExitCode:
    """Write a bag of ROS, or a NEEM, as an episode of a map, which can be asked and replayed.

    Exit 1 if no frame and no joint in it is one of the map.
    """
    from mindstage.episodes.recorder import write_episode

    bodies = _bodies(body or ())
    with progress_spinner(f"reading {bag}"):
        knowledge = knowledge_base(_maps(bag, maps), reading)
        recording, immovable = _read(bag, knowledge, reading.map_name, bodies, map_frame, relative)
        is_empty = not recording.matched and not recording.matched_joints
        if not is_empty:
            write_episode(recording, out, knowledge=knowledge, immovable=immovable, source=bag.name)
    findings = recording.findings
    if as_json:
        print_json(
            {
                "file": None if is_empty else str(out),
                "duration_s": recording.end_s,
                "bodies": dict(recording.matched),
                "joints": dict(recording.matched_joints),
                "unmatched_frames": list(recording.unmatched_frames),
                "unmatched_joints": list(recording.unmatched_joints),
                "unmatched_bodies": list(recording.unmatched_bodies),
                "findings": list(findings),
            }
        )
    else:
        for finding in findings:
            warn(finding)
        if is_empty:
            print_line("No frame and no joint is one of the map, so nothing was written; use --body FRAME=ID.")
        else:
            count = len(recording.matched) + len(recording.matched_joints)
            print_line(f"{out} was written: {recording.end_s:.1f} s, {count} frames and joints of the map.")
    return ExitCode.NEGATIVE if is_empty else ExitCode.OK


def _bodies(texts: Sequence[str]) -> dict[str, BodyId]:
    from mindstage.scene import BodyId

    found: dict[str, BodyId] = {}
    for text in texts:
        frame, equals, id = text.partition("=")
        if not (frame and equals and id):
            raise InvalidArgumentError(f"--body {text}", cause="it is not FRAME=ID", remedy="such as cup_link=Mug_1")
        found[frame] = BodyId(id)
    return found


def _read(
    bag: Path,
    knowledge: KnowledgeBase,
    map_name: str | None,
    bodies: dict[str, BodyId],
    map_frame: str | None,
    relative: bool,
) -> tuple[TransformRecording, frozenset[BodyId]]:
    """The recording for the map, and the bodies of the map that cannot move."""
    from mindstage.engines import NullEngine
    from mindstage.episodes.bags import RosBag
    from mindstage.episodes.neem import read_neem
    from mindstage.simulation import Simulation

    world = knowledge.world(map_name)
    with Simulation(knowledge, NullEngine()) as simulation:
        simulation.spawn(world)
        geometry, immovable = simulation.geometry, simulation.immovable
    if _is_neem(bag):
        return read_neem(bag, world, bodies=bodies, map_frame=map_frame, geometry=geometry), immovable
    recording = RosBag(bag, world, bodies=bodies, map_frame=map_frame, relative=relative, geometry=geometry)
    return recording, immovable


def _is_neem(path: Path) -> bool:
    return path.is_dir() and not (path / "metadata.yaml").is_file()


def _maps(bag: Path, maps: list[str] | None) -> list[str]:
    """The maps that are loaded: those that are given, else that of a NEEM."""
    if maps:
        return maps
    if _is_neem(bag) and (bag / "map.owl").is_file():
        return [str(bag / "map.owl")]
    raise InvalidArgumentError(
        str(bag), cause="it has no map", remedy="give the one that was recorded: --map kitchen.owl"
    )
