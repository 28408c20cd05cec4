"""`mindstage serve`: a stage for a robot's programs, over rosbridge."""

from __future__ import annotations

import re
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    EngineName,
    ExitCode,
    MapName,
    Ontologies,
    PlainBoxes,
    Robots,
    finite,
    options_given,
)
from mindstage.cli.output import (
    findings_json,
    is_complete,
    print_findings,
    print_json,
    print_line,
    print_report,
    progress_spinner,
    report_json,
    warn,
)
from mindstage.cli.setup import findings_about, knowledge_base, make_engine, simulation_from_options
from mindstage.cli.viewer import open_viewer
from mindstage.errors import InvalidArgumentError

if TYPE_CHECKING:
    from mindstage.bridge import Node
    from mindstage.knowledge import KnowledgeBase
    from mindstage.scene import World
    from mindstage.simulation import Simulation

__all__ = ["serve"]

_POLL_INTERVAL_S = 0.2
_CONNECT_TIMEOUT_S = 5.0
"""A rosbridge that is just being started gets so long [s]."""
_LOOPBACK = "127.0.0.1"

Maps = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[MAP]…", help="A semantic map, or bundled:kitchen; without one the stage is empty.", show_default=False
    ),
]
BridgePort = Annotated[
    int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="Where clients connect; 0 takes any free port.")
]
Host = Annotated[
    str, typer.Option("--host", metavar="HOST", help="Where to listen; others than this machine need a token.")
]
Token = Annotated[
    str | None,
    typer.Option(
        "--token", metavar="TOKEN", envvar="MINDSTAGE_TOKEN", help="What clients must know.", show_default=False
    ),
]
Origins = Annotated[
    list[str] | None,
    typer.Option(
        "--origin",
        metavar="URL",
        help="Let a page from there come in too, such as https://robot.example; may be repeated.",
        show_default=False,
    ),
]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        metavar="URL",
        help="Join the rosbridge there (ws://HOST:PORT) instead of serving one; it is joined again after a loss.",
        show_default=False,
    ),
]
Namespace = Annotated[
    str, typer.Option("--namespace", metavar="NAME", help="What the names of services and topics begin with.")
]
Seconds = Annotated[
    float | None,
    typer.Option("--for", metavar="SECONDS", min=0.0, callback=finite, help="End by itself.", show_default=False),
]


RosOne = Annotated[bool, typer.Option("--ros1", help="Write messages as ROS 1 has them; both are read.")]
Worlds = Annotated[
    Path | None,
    typer.Option(
        "--worlds", metavar="DIR", help="Maps and robots in it may be loaded and spawned.", show_default=False
    ),
]
Paused = Annotated[bool, typer.Option("--paused", help="Let no time pass until somebody says so.")]
WithPage = Annotated[bool, typer.Option("--viewport/--no-viewport", help="Show the world in the browser too.")]
PagePort = Annotated[
    int, typer.Option("--page-port", metavar="PORT", min=0, max=65535, help="Where the page is served.")
]


def serve(
    context: typer.Context,
    maps: Maps = None,
    *,
    port: BridgePort = 9090,
    host: Host = _LOOPBACK,
    token: Token = None,
    origins: Origins = None,
    connect: Connect = None,
    namespace: Namespace = "unreal",
    ros1: RosOne = False,
    worlds: Worlds = None,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    robots: Robots = None,
    assets: AssetFolders = None,
    plain_boxes: PlainBoxes = False,
    engine: EngineName = "mujoco",
    paused: Paused = False,
    with_viewport: WithPage = False,
    page_port: PagePort = 8080,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Serve a stage to a robot's programs over rosbridge, under the names that Unreal's plugin has."""
    from mindstage.msgs import RosVersion
    from mindstage.ros import RosInterface

    _check_options(context, connect=connect, namespace=namespace, worlds=worlds)
    running = make_engine(engine)
    knowledge, world = _load_knowledge(maps, map_name, ontologies=ontologies, bundled=bundled, robots=robots)
    quitting = threading.Event()
    with ExitStack() as open_things:
        stage = open_things.enter_context(
            simulation_from_options(knowledge, running, assets=assets, plain_boxes=plain_boxes)
        )
        participant, url = (
            _connect(open_things, connect, token)
            if connect
            else _start_server(open_things, host, port, token, origins or [])
        )
        told: dict[str, object] = {"url": url, "namespace": namespace, "engine": stage.engine_name}
        told |= _spawn(stage, world, as_json=as_json)
        ros = RosVersion.ONE if ros1 else RosVersion.TWO
        face = RosInterface(stage, participant, namespace=namespace, ros=ros, folder=worlds, on_quit=quitting.set)
        open_things.callback(face.close)
        if with_viewport:
            if connect:  # the host and the token are those of the rosbridge there
                viewport = open_viewer(stage, port=page_port)
            else:
                viewport = open_viewer(stage, port=page_port, host=host, token=token, origins=origins or [])
            open_things.callback(viewport.close)
            told["page"] = viewport.url
        _announce(told, url=connect is not None, seconds=seconds, as_json=as_json)
        if not paused:
            stage.play()
        _run_until_end(stage, quitting, seconds=seconds, quiet=as_json)
    return ExitCode.OK


def _check_options(context: typer.Context, *, connect: str | None, namespace: str, worlds: Path | None) -> None:
    """Looks at what was typed before anything is begun.

    Raises:
        InvalidArgumentError: some of it excludes other things, or is no name or folder.
    """
    served = {"port": "--port", "host": "--host", "origins": "--origin"}
    for option in options_given(context, served) if connect is not None else ():
        raise InvalidArgumentError(option, cause="with --connect nothing is served here", remedy="leave one out")
    if not re.fullmatch(r"/?([A-Za-z]\w*(/[A-Za-z]\w*)*)?/?", namespace, re.ASCII):
        remedy = "use letters, digits, _ and /"
        raise InvalidArgumentError("--namespace", cause=f"{namespace!r} is no name in ROS", remedy=remedy)
    if worlds is not None and not worlds.is_dir():
        raise InvalidArgumentError("--worlds", cause=f"{worlds} is no folder")


def _load_knowledge(
    maps: list[str] | None,
    map_name: str | None,
    *,
    ontologies: list[str] | None,
    bundled: bool,
    robots: list[str] | None,
) -> tuple[KnowledgeBase, World | None]:
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps or [], ontologies=ontologies, bundled=bundled, robots=robots)
        return knowledge, knowledge.world(map_name) if maps else None


def _start_server(
    resources: ExitStack, host: str, port: int, token: str | None, origins: list[str]
) -> tuple[Node, str]:
    from mindstage.bridge import LocalNode, RosbridgeServer

    hub = resources.enter_context(LocalNode())
    server = resources.enter_context(RosbridgeServer(hub, host=host, port=port, token=token or None, origins=origins))
    return hub, server.url


def _connect(resources: ExitStack, url: str, token: str | None) -> tuple[Node, str]:
    from mindstage.bridge import ConnectionState, RosbridgeClient

    def tell(state: ConnectionState) -> None:
        if state is ConnectionState.LOST:
            warn(f"the connection to {url} is lost; trying again")

    client = resources.enter_context(RosbridgeClient(url, token=token or None, on_state=tell))
    with progress_spinner(f"joining {url}"):
        return client.wait_connected(_CONNECT_TIMEOUT_S), url


def _spawn(simulation: Simulation, world: World | None, *, as_json: bool) -> dict[str, object]:
    if world is None:
        return {"map": None}
    findings = findings_about(world, simulation.knowledge)
    with progress_spinner("spawning"):
        report = simulation.spawn(world)
    if not as_json:
        print_findings(findings)
        print_report(report, title=world.name, verbose=False)
    if not is_complete(report, findings):
        warn("not everything of the map stands on the stage; it is served as it is")
    return {"map": world.iri, "spawn": report_json(report), "findings": findings_json(findings)}


def _announce(summary: dict[str, object], *, url: bool, seconds: float | None, as_json: bool) -> None:
    if as_json:
        print_json(summary)
        return
    if "page" in summary:
        print_line(f"The world is open at {summary['page']}")
    print_line(f"{'Joined' if url else 'Listening at'} {summary['url']}; services are below /{summary['namespace']}")
    print_line("Ctrl-C ends it." if seconds is None else f"It ends in {seconds:g} s.")


def _run_until_end(
    simulation: Simulation, quit_requested: threading.Event, *, seconds: float | None, quiet: bool
) -> None:
    """Waits until somebody ends it, and says when the world comes to a stop by itself."""
    end = None if seconds is None else time.monotonic() + seconds
    told = ""
    while (left_s := _POLL_INTERVAL_S if end is None else min(_POLL_INTERVAL_S, end - time.monotonic())) > 0.0:
        if quit_requested.wait(left_s):
            return
        fault = simulation.state.error
        if fault and fault != told and not quiet:
            warn(f"the world stands still: {fault}")
        told = fault
