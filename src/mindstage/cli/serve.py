"""The verb `serve`: a simulation with ROS services, actions and topics over rosbridge."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    DEFAULT_SPAWN,
    LOCAL_SERVER,
    AsJson,
    ExitCode,
    MapSpawning,
    ServerOptions,
    options_given,
)
from mindstage.cli.output import (
    class_lookup,
    findings_json,
    print_findings,
    print_json,
    print_line,
    print_report,
    progress_spinner,
    report_json,
    shortcomings,
    warn,
)
from mindstage.cli.ros2 import NO_ROS2, Ros2Options, ros2_commands
from mindstage.cli.setup import findings_about, knowledge_base, make_engine, simulation_from_options
from mindstage.cli.viewer import ServerAccess, open_viewer, server_access
from mindstage.errors import InvalidArgumentError
from mindstage.ranges import Port as PortNumber
from mindstage.ranges import WallTime

if TYPE_CHECKING:
    from mindstage.bridge import LocalNode, Refusal, RosbridgeClient
    from mindstage.knowledge import KnowledgeBase
    from mindstage.maps.urdf.xacro_process import XacroRequest
    from mindstage.scene import World
    from mindstage.simulation import Simulation

__all__ = ["serve"]

_POLL_INTERVAL_S = 0.2
_CONNECT_TIMEOUT_S = 5.0
"""Timeout for a rosbridge that is still starting [s]."""
_MAX_REFUSED_NAMES = 3
"""Largest number of names in a line about refused operations."""
_WRONG_ROS = re.compile(r"not a valid type string|Unknown operation: advertise_action")
"""What a rosbridge says of types and operations of the other version of ROS."""
_OWN_PACKAGES = frozenset({"mindstage_msgs", "modul_spawner_msgs", "unreal_vis_msgs", "world_control_msgs"})
"""Packages of the folder ros/."""

Maps = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[MAP]…", help="A semantic map, or bundled:kitchen; without one the world is empty.", show_default=False
    ),
]
BridgePort = Annotated[
    PortNumber | None,
    typer.Option(
        "--port",
        metavar="PORT",
        help="The port of the rosbridge server; 0 chooses a free one. By default 9090, or the next free one.",
        show_default=False,
    ),
]
Origins = Annotated[
    list[str] | None,
    typer.Option(
        "--origin",
        metavar="URL",
        help="Accept connections from pages of this origin, such as https://robot.example; may be repeated.",
        show_default=False,
    ),
]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        metavar="URL",
        help="Connect to a rosbridge (ws://HOST:PORT, wss://…) instead of serving one; reconnects if it is lost.",
        show_default=False,
    ),
]
TlsAuthorities = Annotated[
    Path | None,
    typer.Option(
        "--tls-ca",
        metavar="FILE",
        help="With --connect wss://…: certificates of authorities to trust besides those of the system (PEM).",
        show_default=False,
    ),
]
Namespace = Annotated[
    str, typer.Option("--namespace", metavar="NAME", help="The namespace of services, actions and topics.")
]
Seconds = Annotated[
    WallTime | None,
    typer.Option("--for", metavar="SECONDS", help="Exit after this wall time.", show_default=False),
]


RosOne = Annotated[
    bool, typer.Option("--ros1", help="Send messages in the format of ROS 1; both formats are received.")
]
Worlds = Annotated[
    Path | None,
    typer.Option(
        "--worlds",
        metavar="DIR",
        help="A folder of maps and robots that clients may load and spawn.",
        show_default=False,
    ),
]
Episodes = Annotated[
    Path | None,
    typer.Option(
        "--episodes",
        metavar="DIR",
        help="A folder in which clients may record episodes, with the service mindstage/record.",
        show_default=False,
    ),
]
RobotSources = Annotated[
    list[str] | None,
    typer.Option(
        "--robot",
        metavar="NAME|FILE",
        help="Add a robot, with the topics, actions and services of a real one: a known model, or a description "
        "(URDF, xacro, MJCF); may be repeated.",
        show_default=False,
    ),
]
Paused = Annotated[bool, typer.Option("--paused", help="Start paused.")]
WithViewer = Annotated[bool, typer.Option("--viewer/--no-viewer", help="Serve the page too.")]
ViewerPort = Annotated[
    PortNumber | None,
    typer.Option(
        "--viewer-port",
        metavar="PORT",
        help="The port of the page; 0 chooses a free one. By default 8080, or the next free one.",
        show_default=False,
    ),
]


def serve(
    context: typer.Context,
    maps: Maps = None,
    *,
    port: BridgePort = None,
    server: ServerOptions = LOCAL_SERVER,
    origins: Origins = None,
    connect: Connect = None,
    tls_authorities: TlsAuthorities = None,
    namespace: Namespace = "unreal",
    ros1: RosOne = False,
    worlds: Worlds = None,
    episodes: Episodes = None,
    robot: RobotSources = None,
    options: MapSpawning = DEFAULT_SPAWN,
    ros2: Ros2Options = NO_ROS2,
    paused: Paused = False,
    with_viewer: WithViewer = False,
    viewer_port: ViewerPort = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Serve a simulation to ROS clients over rosbridge, under the names of the Unreal plugin."""
    from mindstage.bridge import LocalNode
    from mindstage.ros import RosInterface, RosVersion

    _check_options(context, connect=connect, tls_authorities=tls_authorities, namespace=namespace, worlds=worlds)
    ros2.check(context, connect=connect)
    access = server_access(replace(server, token=None) if connect else server, origins=origins or [])
    running, quitting = make_engine(options.engine), threading.Event()
    knowledge, world = _load_knowledge(maps, options)
    with ExitStack() as resources:
        made = simulation_from_options(knowledge, running, options)
        simulation = resources.enter_context(made)
        refused: list[Refusal] = []  # appended on the bridge's thread
        node = resources.enter_context(
            _connect(connect, server.token, tls_authorities, refused) if connect else LocalNode()
        )
        spawned = _spawn_map(simulation, world, options, as_json=as_json)
        spawned |= _add_robots(simulation, robot or (), xacro=options.xacro_request, as_json=as_json)
        ros = RosVersion.ONE if ros1 else RosVersion.TWO
        interface = RosInterface(
            simulation, node, namespace=namespace, ros=ros, folder=worlds, episodes=episodes, on_quit=quitting.set
        )
        resources.callback(interface.close)
        ros2.start(resources, simulation, node, interface, on_refusal=refused.append)
        url = _start_server(resources, node, port, access) if isinstance(node, LocalNode) else str(connect)
        output: dict[str, object] = {
            "ros2": ros2.ros2,
            "url": url,
            "namespace": namespace,
            "engine": simulation.engine.name,
            **spawned,
        }
        if with_viewer:
            output["viewer"] = _serve_viewer(resources, simulation, viewer_port, access)
        _answer_queries(simulation, page=output.get("viewer", ""))
        _announce(output, connected=connect is not None, seconds=seconds, as_json=as_json)
        _run_until_end(simulation, quitting, url, refused, paused=paused, seconds=seconds, quiet=as_json)
    return ExitCode.OK


def _check_options(
    context: typer.Context,
    *,
    connect: str | None,
    tls_authorities: Path | None,
    namespace: str,
    worlds: Path | None,
) -> None:
    """Checks options before anything is started.

    Raises:
        InvalidArgumentError: options are mutually exclusive, or not a ROS name or a folder.
    """
    served = {"port": "--port", "host": "--host", "origins": "--origin", "tls_cert": "--tls-cert"}
    served |= {"tls_key": "--tls-key", "limits": "--limit"}
    for option in options_given(context, served) if connect is not None else ():
        raise InvalidArgumentError(option, cause="with --connect no server is started", remedy="omit one of them")
    if tls_authorities is not None and connect is None:
        raise InvalidArgumentError("--tls-ca", cause="it requires --connect", remedy="omit it")
    if not re.fullmatch(r"/?([A-Za-z]\w*(/[A-Za-z]\w*)*)?/?", namespace, re.ASCII):
        remedy = "use letters, digits, _ and /"
        raise InvalidArgumentError("--namespace", cause=f"{namespace!r} is not a valid ROS name", remedy=remedy)
    if worlds is not None and not worlds.is_dir():
        raise InvalidArgumentError("--worlds", cause=f"{worlds} is not a folder")


def _load_knowledge(maps: list[str] | None, options: MapSpawning) -> tuple[KnowledgeBase, World | None]:
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps or [], options)
        return knowledge, knowledge.world(options.map_name) if maps else None


def _start_server(resources: ExitStack, node: LocalNode, port: int | None, access: ServerAccess) -> str:
    """Opens the port, after the services exist, so that a client never finds one without the other."""
    from mindstage.access.limits import VisitorLimits
    from mindstage.bridge import RosbridgeServer

    host, token, origins, tls, limits = access
    server = RosbridgeServer(
        node, host=host, port=port, token=token, origins=origins, tls=tls, visitor_limits=limits or VisitorLimits()
    )
    return resources.enter_context(server).url


def _serve_viewer(resources: ExitStack, simulation: Simulation, port: int | None, access: ServerAccess) -> str:
    viewer = open_viewer(simulation, port=port, access=access)
    resources.callback(viewer.close)
    return viewer.url


def _answer_queries(simulation: Simulation, *, page: object) -> None:
    """Makes the simulation answer the queries of `--running`."""
    from mindstage.ros.queries import QueryServer

    QueryServer.start(simulation, page=str(page))


def _connect(url: str, token: str | None, authorities: Path | None, refused: list[Refusal]) -> RosbridgeClient:
    """Connects to a rosbridge; the caller closes the client."""
    from mindstage.bridge import ConnectionState, RosbridgeClient

    def warn_if_lost(state: ConnectionState) -> None:
        if state is ConnectionState.LOST:
            warn(f"the connection to {url} is lost; reconnecting")

    client = RosbridgeClient(
        url, token=token or None, tls_authorities=authorities, on_state=warn_if_lost, on_refusal=refused.append
    )
    try:
        with progress_spinner(f"connecting to {url}"):
            return client.wait_connected(_CONNECT_TIMEOUT_S)
    except BaseException:
        client.close()
        raise


def _spawn_map(
    simulation: Simulation, world: World | None, options: MapSpawning, *, as_json: bool
) -> dict[str, object]:
    if world is None:
        return {"map": None}
    findings = findings_about(world, simulation.knowledge, options=options)
    with progress_spinner("spawning"):
        report = simulation.spawn(world)
    if not as_json:
        print_findings(findings, classes=class_lookup(simulation.knowledge))
        print_report(report, title=world.name, verbose=False)
    if reasons := shortcomings(report, findings):
        causes = "; ".join(reason.text for reason in reasons)
        warn(f"the map was not spawned completely, the simulation is served nevertheless: {causes}")
    return {"map": world.iri, "spawn": report_json(report), "findings": findings_json(findings)}


def _add_robots(
    simulation: Simulation, sources: Sequence[str], *, xacro: XacroRequest, as_json: bool
) -> dict[str, object]:
    """Adds robots at free places on the floor."""
    from mindstage.robots.standing import add_standing_robot

    names: list[str] = []
    for source in sources:
        with progress_spinner(f"adding {source}"):
            robot = add_standing_robot(simulation, source, xacro=xacro)
        names.append(robot.name)
        if not as_json:
            x, y, yaw = robot.base_pose()
            print_line(f"{robot.name} stands at ({x:.2f}, {y:.2f}), facing {math.degrees(yaw):.0f}°")
    return {"robots": names} if names else {}


def _announce(summary: dict[str, object], *, connected: bool, seconds: float | None, as_json: bool) -> None:
    if as_json:
        print_json(summary)
        return
    if "viewer" in summary:
        print_line(f"The world is served at {summary['viewer']}")
    verb = "Connected to" if connected else "Listening at"
    print_line(f"{verb} {summary['url']}; services are below /{summary['namespace']}")
    if summary["ros2"]:
        space = "/".join(("", *filter(None, str(summary["namespace"]).split("/"))))
        print_line("In ROS 2, try:")
        for command in ros2_commands(space):
            print_line(f"  {command}")
    print_line("Press Ctrl-C to exit." if seconds is None else f"Exits after {seconds:g} s.")


def _print_refusals(url: str, refusals: Sequence[Refusal]) -> None:
    """Prints what the rosbridge refused, one line for each remedy or cause."""
    groups: dict[str, list[Refusal]] = {}
    for refusal in refusals:
        groups.setdefault(_remedy(refusal) or refusal.cause, []).append(refusal)
    for reason, group in groups.items():
        names = ", ".join(f"{each.operation} {each.name}" for each in group[:_MAX_REFUSED_NAMES])
        more = f" and {len(group) - _MAX_REFUSED_NAMES} more" if len(group) > _MAX_REFUSED_NAMES else ""
        cause = group[0].cause.removeprefix(f"{group[0].operation}: ")
        warn(f"{url} refused {names}{more}: {cause}{'' if reason == group[0].cause else f'; {reason}'}")


def _remedy(refusal: Refusal) -> str:
    """How the rosbridge would accept what it refused; empty if that is not known."""
    if _WRONG_ROS.search(refusal.cause):
        return "omit --ros1 for ROS 2, give it for ROS 1"
    if not (package := refusal.package):
        return ""
    if package in _OWN_PACKAGES:
        remedy = "build the packages of the folder ros/ in the workspace of that rosbridge"
    else:
        remedy = f"install its package {package} there (Debian: ros-DISTRO-{package.replace('_', '-')})"
        if package == "simulation_interfaces":
            remedy += "; for ROS 1, build ros/ros1/simulation_interfaces"
    return f"what needs {package} is left out; {remedy}"


def _run_until_end(
    simulation: Simulation,
    quit_requested: threading.Event,
    url: str,
    refused: list[Refusal],
    *,
    paused: bool,
    seconds: float | None,
    quiet: bool,
) -> None:
    """Plays, waits for a quit request or the end of the duration, and prints errors of the simulation and refusals."""
    if not paused:
        simulation.play()
    end = None if seconds is None else time.monotonic() + seconds
    printed = ""
    while (left_s := _POLL_INTERVAL_S if end is None else min(_POLL_INTERVAL_S, end - time.monotonic())) > 0.0:
        if quit_requested.wait(left_s):
            return
        if refused:
            _print_refusals(url, [refused.pop(0) for _ in range(len(refused))])
        error = simulation.state.error
        if error and error != printed and not quiet:
            warn(f"the simulation is paused: {error}")
        printed = error
