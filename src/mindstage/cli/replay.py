"""The verb `replay`: shows a recorded episode on the page, publishes it to ROS, or writes the map of a moment."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    DEFAULT_READING,
    LOCAL_SERVER,
    AsJson,
    ExitCode,
    MapReading,
    Port,
    Seconds,
    ServerOptions,
    close_at_end,
)
from mindstage.cli.output import print_json, print_line, progress_spinner, warn
from mindstage.cli.setup import knowledge_base
from mindstage.cli.viewer import ServerAccess, open_page, open_viewer, server_access
from mindstage.errors import EpisodeFileError, InvalidArgumentError
from mindstage.ranges import Port as PortNumber
from mindstage.ranges import Time

if TYPE_CHECKING:
    from mindstage.episodes import Recording
    from mindstage.episodes.replay import EpisodeReplay
    from mindstage.episodes.transform_recording import TransformRecording
    from mindstage.knowledge import KnowledgeBase
    from mindstage.scene import World

__all__ = ["replay"]

_POLL_INTERVAL_S = 0.1
_BAG_SUFFIXES = frozenset({".bag", ".db3"})

Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="EPISODE [EPISODE]",
        help="The recorded episode, a NEEM, or with --map a bag of ROS; a second one is shown beside it, on the same "
        "timeline.",
        show_default=False,
    ),
]
RecordedMap = Annotated[
    str | None,
    typer.Option(
        "--map",
        metavar="MAP",
        help="The map that was recorded in bags of ROS 1 or 2, such as those of a real robot.",
        show_default=False,
    ),
]
At = Annotated[
    Time | None,
    typer.Option(
        "--at",
        metavar="SECONDS",
        help="The time to begin at; with -o, the time of the map. By default the begin.",
        show_default=False,
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="Write the world at the time of --at instead of showing the page; the suffix gives the format, as "
        "for convert.",
        show_default=False,
    ),
]
Speed = Annotated[float, typer.Option("--speed", metavar="FACTOR", min=0.01, max=1000.0, help="Speed of the replay.")]
Paused = Annotated[bool, typer.Option("--paused", help="Start paused.")]
OpenBrowser = Annotated[
    bool | None,
    typer.Option("--open/--no-open", help="Whether to open a browser; by default only with a graphical display."),
]
WithViewer = Annotated[bool, typer.Option(" /--no-viewer", help="Do not serve the page.", show_default=False)]
WithRos = Annotated[
    bool,
    typer.Option("--ros", help="Publish /tf, /clock, joint states and markers over rosbridge, at the speed of replay."),
]
RosPort = Annotated[
    PortNumber | None,
    typer.Option(
        "--ros-port",
        metavar="PORT",
        help="The port of the rosbridge server; 0 chooses a free one. By default 9090, or the next free one.",
        show_default=False,
    ),
]
Namespace = Annotated[str, typer.Option("--namespace", metavar="NAME", help="The namespace of services and topics.")]
RosOne = Annotated[bool, typer.Option("--ros1", help="Send messages in the format of ROS 1.")]
Repeat = Annotated[bool, typer.Option("--loop", help="Begin again at the end.")]


def replay(
    files: Files,
    *,
    at: At = None,
    out: Output = None,
    recorded_map: RecordedMap = None,
    reading: MapReading = DEFAULT_READING,
    speed: Speed = 1.0,
    paused: Paused = False,
    loop: Repeat = False,
    with_viewer: WithViewer = True,
    port: Port = None,
    server: ServerOptions = LOCAL_SERVER,
    open_browser: OpenBrowser = None,
    with_ros: WithRos = False,
    ros_port: RosPort = None,
    namespace: Namespace = "unreal",
    ros1: RosOne = False,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Replay a recorded episode: on the page with a timeline, over ROS, or one moment of it as a map.

    Without a page, the replay exits at its end.
    """
    from mindstage.episodes.replay import EpisodeReplay

    _check_options(files, out=out, with_viewer=with_viewer, with_ros=with_ros)
    access = server_access(server)
    with ExitStack() as resources:
        with progress_spinner("reading"):
            knowledge = None if recorded_map is None else knowledge_base([recorded_map], reading)
            world = None if knowledge is None else knowledge.world()
            recordings = [_open(resources, file, world) for file in files]
            first, second = recordings[0], recordings[1] if len(recordings) > 1 else None
            knowledge = knowledge or _knowledge(first)
            shown = EpisodeReplay(first, knowledge, at_s=at, beside=second)
        resources.enter_context(shown)
        if out is not None:
            return _write(shown, out, as_json=as_json)
        output: dict[str, object] = {
            "episode": first.name,
            "begin_s": shown.begin_s,
            "end_s": shown.end_s,
            "at_s": shown.state.time_s,
        }
        if with_ros:
            output["url"] = _serve_ros(resources, shown, ros_port, access, namespace=namespace, ros1=ros1)
        if with_viewer:
            viewer = open_viewer(shown, port=port, access=access)
            resources.callback(viewer.close)
            output["viewer"] = viewer.url
        _announce(output, seconds=seconds, as_json=as_json)
        if with_viewer and not as_json:
            open_page(str(output["viewer"]), wanted=open_browser)
        if not paused:
            shown.play(speed=speed)
        _wait(shown, speed=speed, loop=loop, ends=not (with_viewer or paused), seconds=seconds)
    return ExitCode.OK


def _check_options(files: list[Path], *, out: Path | None, with_viewer: bool, with_ros: bool) -> None:
    """Checks options before a file is read.

    Raises:
        InvalidArgumentError: there are more than two episodes, or nothing would be shown.
    """
    if len(files) > 2:
        raise InvalidArgumentError("EPISODE", cause=f"{len(files)} are given", remedy="give one or two")
    if out is not None and len(files) > 1:
        raise InvalidArgumentError("--out", cause="a map is that of one episode", remedy="give one episode")
    if out is None and not with_viewer and not with_ros:
        remedy = "omit it, or give --ros or --out"
        raise InvalidArgumentError("--no-viewer", cause="nothing would be shown", remedy=remedy)


def _open(resources: ExitStack, path: Path, world: World | None) -> Recording:
    """Opens an episode, a NEEM or a bag, and warns of what cannot be read in it.

    Args:
        resources: closes the file.
        path: the file or folder.
        world: the map that was recorded, which only a bag needs.

    Raises:
        InvalidArgumentError: it is a bag, and there is no map.
        EpisodeFileError: it cannot be read.
    """
    is_bag = path.suffix in _BAG_SUFFIXES or (path / "metadata.yaml").is_file()
    if is_bag and world is None:
        remedy = "give the map with --map MAP"
        raise InvalidArgumentError(str(path), cause="a bag of ROS does not contain its map", remedy=remedy)
    if path.is_dir() and not is_bag:
        from mindstage.episodes.neem import read_neem

        return _with_findings(read_neem(path, world), path)
    if world is not None:
        from mindstage.episodes.bags import RosBag
        from mindstage.episodes.detection import detect_events

        return _with_findings(RosBag(path, world, events=detect_events), path)
    from mindstage.episodes.episode import Episode

    episode = resources.enter_context(Episode(path))
    for loss in episode.losses:
        warn(f"{path}: {loss}")
    return episode


def _with_findings(recording: TransformRecording, path: Path) -> Recording:
    for finding in recording.findings:
        warn(f"{path}: {finding}")
    return recording


def _knowledge(recording: Recording) -> KnowledgeBase:
    """The recorded knowledge base, or if it is lost, one with the recorded worlds; closed when the verb ends."""
    from mindstage.episodes.replay import knowledge_of

    try:
        knowledge = knowledge_of(recording)
    except EpisodeFileError as error:
        warn(f"{error}; questions are answered from the recorded worlds and the bundled ontology")
        knowledge = knowledge_of(recording, worlds_only=True)
    close_at_end(knowledge.close)
    return knowledge


def _write(shown: EpisodeReplay, out: Path, *, as_json: bool) -> ExitCode:
    """Writes the world of the shown moment."""
    with progress_spinner("writing"):
        notes = shown.save(out)
    world, time_s = shown.snapshot(), shown.state.time_s
    if as_json:
        summary = {"episode": shown.recording.name, "at_s": time_s, "out": str(out), "bodies": len(world.bodies)}
        print_json(summary | {"map": world.iri, "notes": list(notes)})
    else:
        for note in notes:
            warn(note)
        print_line(f"{shown.recording.name} at {time_s:g} s: {len(world.bodies)} bodies → {out}")
    return ExitCode.OK


def _serve_ros(
    resources: ExitStack, shown: EpisodeReplay, port: int | None, access: ServerAccess, *, namespace: str, ros1: bool
) -> str:
    """Serves the replay over rosbridge; returns the URL."""
    from mindstage.access.limits import VisitorLimits
    from mindstage.bridge import LocalNode, RosbridgeServer
    from mindstage.msgs import RosVersion
    from mindstage.ros import RosInterface

    node = resources.enter_context(LocalNode())
    interface = RosInterface(shown, node, namespace=namespace, ros=RosVersion.ONE if ros1 else RosVersion.TWO)
    resources.callback(interface.close)
    limits = access.limits or VisitorLimits()
    server = RosbridgeServer(
        node, host=access.host, port=port, token=access.token, tls=access.tls, visitor_limits=limits
    )
    return resources.enter_context(server).url


def _announce(output: dict[str, object], *, seconds: float | None, as_json: bool) -> None:
    if as_json:
        print_json(output)
        return
    if "viewer" in output:
        print_line(f"The replay is served at {output['viewer']}")
    if "url" in output:
        print_line(f"ROS clients connect to {output['url']}")
    print_line("Press Ctrl-C to exit." if seconds is None else f"Exits after {seconds:g} s.")


def _wait(shown: EpisodeReplay, *, speed: float, loop: bool, ends: bool, seconds: float | None) -> None:
    """Waits for Ctrl-C, for the end of a duration [s], or, with `ends`, for the end of the recording."""
    end = None if seconds is None else time.monotonic() + seconds
    was_playing = False
    while end is None or time.monotonic() < end:
        state = shown.state
        is_over = was_playing and not state.playing and state.time_s >= shown.end_s and shown.resumed_at_s is None
        if is_over and loop:
            shown.play(speed=speed)
        elif is_over and ends:
            return
        was_playing = state.playing
        time.sleep(_POLL_INTERVAL_S if end is None else max(0.0, min(_POLL_INTERVAL_S, end - time.monotonic())))
