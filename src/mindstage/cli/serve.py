"""`mindstage serve`: a stage for a robot's programs, over rosbridge."""

from __future__ import annotations

import re
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    EngineName,
    MapName,
    Ontologies,
    PlainBoxes,
    Robots,
    finite,
    typed,
)
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, say, warn, working
from mindstage.cli.page import open_viewport
from mindstage.cli.report import everything_stands, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import stage_for
from mindstage.errors import ArgumentRefused

if TYPE_CHECKING:
    from mindstage.bridge import Participant
    from mindstage.knowledge import KnowledgeBase
    from mindstage.stage import Stage
    from mindstage.world import World

__all__ = ["serve"]

_LOOK_S = 0.2
_JOIN_S = 5.0
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
) -> Outcome:
    """Serve a stage to a robot's programs over rosbridge, under the names that Unreal's plugin has."""
    from mindstage.msgs import RosVersion
    from mindstage.ros import RosFace

    _refuse_what_makes_no_sense(context, connect=connect, namespace=namespace, worlds=worlds)
    running = make_engine(engine)
    knowledge, world = _known(maps, map_name, ontologies=ontologies, bundled=bundled, robots=robots)
    quitting = threading.Event()
    with ExitStack() as open_things:
        stage = open_things.enter_context(stage_for(knowledge, running, assets=assets, plain_boxes=plain_boxes))
        participant, url = (
            _join(open_things, connect, token) if connect else _listen(open_things, host, port, token, origins or [])
        )
        told: dict[str, object] = {"url": url, "namespace": namespace, "engine": stage.engine_name}
        told |= _spawned(stage, world, as_json=as_json)
        ros = RosVersion.ONE if ros1 else RosVersion.TWO
        face = RosFace(stage, participant, namespace=namespace, ros=ros, folder=worlds, on_quit=quitting.set)
        open_things.callback(face.close)
        if with_viewport:
            if connect:  # the host and the token are those of the rosbridge there
                viewport = open_viewport(stage, port=page_port)
            else:
                viewport = open_viewport(stage, port=page_port, host=host, token=token, origins=origins or [])
            open_things.callback(viewport.close)
            told["page"] = viewport.url
        _announce(told, joined=connect is not None, seconds=seconds, as_json=as_json)
        if not paused:
            stage.play()
        _live(stage, quitting, seconds=seconds, quiet=as_json)
    return Outcome.DONE


def _refuse_what_makes_no_sense(
    context: typer.Context, *, connect: str | None, namespace: str, worlds: Path | None
) -> None:
    """Looks at what was typed before anything is begun.

    Raises:
        ArgumentRefused: some of it excludes other things, or is no name or folder.
    """
    served = {"port": "--port", "host": "--host", "origins": "--origin"}
    for option in typed(context, served) if connect is not None else ():
        raise ArgumentRefused(option, cause="with --connect nothing is served here", remedy="leave one out")
    if not re.fullmatch(r"/?([A-Za-z]\w*(/[A-Za-z]\w*)*)?/?", namespace, re.ASCII):
        remedy = "use letters, digits, _ and /"
        raise ArgumentRefused("--namespace", cause=f"{namespace!r} is no name in ROS", remedy=remedy)
    if worlds is not None and not worlds.is_dir():
        raise ArgumentRefused("--worlds", cause=f"{worlds} is no folder")


def _known(
    maps: list[str] | None,
    map_name: str | None,
    *,
    ontologies: list[str] | None,
    bundled: bool,
    robots: list[str] | None,
) -> tuple[KnowledgeBase, World | None]:
    with working("reading"):
        knowledge = knowledge_base(maps or [], ontologies=ontologies, bundled=bundled, robots=robots)
        return knowledge, knowledge.world(map_name) if maps else None


def _listen(
    open_things: ExitStack, host: str, port: int, token: str | None, origins: list[str]
) -> tuple[Participant, str]:
    from mindstage.bridge import Hub, Server

    hub = open_things.enter_context(Hub())
    server = open_things.enter_context(Server(hub, host=host, port=port, token=token or None, origins=origins))
    return hub, server.url


def _join(open_things: ExitStack, url: str, token: str | None) -> tuple[Participant, str]:
    from mindstage.bridge import Client, LinkState

    def tell(state: LinkState) -> None:
        if state is LinkState.LOST:
            warn(f"the connection to {url} is lost; trying again")

    client = open_things.enter_context(Client(url, token=token or None, on_state=tell))
    with working(f"joining {url}"):
        return client.wait_connected(_JOIN_S), url


def _spawned(stage: Stage, world: World | None, *, as_json: bool) -> dict[str, object]:
    if world is None:
        return {"map": None}
    findings = findings_about(world, stage.knowledge)
    with working("spawning"):
        report = stage.spawn(world)
    if not as_json:
        print_findings(findings)
        print_report(report, title=world.name, verbose=False)
    if not everything_stands(report, findings):
        warn("not everything of the map stands on the stage; it is served as it is")
    return {"map": world.iri, "spawn": report_json(report), "findings": findings_json(findings)}


def _announce(told: dict[str, object], *, joined: bool, seconds: float | None, as_json: bool) -> None:
    if as_json:
        print_json(told)
        return
    if "page" in told:
        say(f"The world is open at {told['page']}")
    say(f"{'Joined' if joined else 'Listening at'} {told['url']}; services are below /{told['namespace']}")
    say("Ctrl-C ends it." if seconds is None else f"It ends in {seconds:g} s.")


def _live(stage: Stage, quitting: threading.Event, *, seconds: float | None, quiet: bool) -> None:
    """Waits until somebody ends it, and says when the world comes to a stop by itself."""
    end = None if seconds is None else time.monotonic() + seconds
    told = ""
    while (left_s := _LOOK_S if end is None else min(_LOOK_S, end - time.monotonic())) > 0.0:
        if quitting.wait(left_s):
            return
        fault = stage.frame.fault
        if fault and fault != told and not quiet:
            warn(f"the world stands still: {fault}")
        told = fault
