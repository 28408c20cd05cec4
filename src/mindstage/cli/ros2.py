"""The verbs `ros2 doctor` and `ros2 build-messages`: what `serve --ros2` needs of this machine."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.access.ports import Discovery
from mindstage.cli.options import AsJson, ExitCode, OptionGroup, options_given
from mindstage.cli.output import print_json, print_line, progress_spinner, warn
from mindstage.errors import InvalidArgumentError, Ros2Error
from mindstage.ranges import DomainId

if TYPE_CHECKING:
    from mindstage.bridge import Node, Refusal
    from mindstage.ros import RosInterface
    from mindstage.simulation import Simulation

__all__ = ["NO_ROS2", "Ros2Options", "build_messages", "doctor", "ros2_commands"]

_MAX_PARTICIPANTS = 33
"""Participants of one machine and domain that find each other with Fast DDS' defaults."""

Python = Annotated[
    Path | None,
    typer.Option(
        "--ros2-python", metavar="FILE", help="The Python that has rclpy.", show_default=False, dir_okay=False
    ),
]

Enabled = Annotated[
    bool,
    typer.Option("--ros2", help="Be a node of ROS 2 too, on this machine's ROS 2 or its wheels; see `ros2 doctor`."),
]
ServedPython = Annotated[
    Path | None,
    typer.Option(
        "--ros2-python",
        metavar="FILE",
        help="With --ros2: the Python that has rclpy.",
        show_default=False,
        dir_okay=False,
    ),
]
Domain = Annotated[
    DomainId | None,
    typer.Option(
        "--ros2-domain",
        metavar="ID",
        help="With --ros2: the domain. By default that of ROS_DOMAIN_ID, or 0.",
        show_default=False,
    ),
]
DiscoveryRange = Annotated[
    Discovery, typer.Option("--ros2-discovery", help="With --ros2: how far the node can be seen; see --allow-network.")
]
AllowNetwork = Annotated[
    bool, typer.Option("--allow-network", help="With --ros2: other machines may see and control the simulation.")
]
RosArguments = Annotated[
    str,
    typer.Option(
        "--ros-args",
        metavar="TEXT",
        help="With --ros2: arguments of the node, such as '-r /tf:=/sim/tf'.",
        show_default=False,
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2Options(OptionGroup):
    """The options of `serve` that make the simulation a node of ROS 2."""

    ros2: Enabled = False
    ros2_python: ServedPython = None
    ros2_domain: Domain = None
    ros2_discovery: DiscoveryRange = Discovery.LOCALHOST
    allow_network: AllowNetwork = False
    ros_args: RosArguments = ""

    def check(self, context: typer.Context, *, connect: str | None) -> None:
        """Checks the options before anything is started.

        Raises:
            InvalidArgumentError: they need `--ros2`, or open the network without saying so.
        """
        names = {"ros2_python": "--ros2-python", "ros2_domain": "--ros2-domain", "ros2_discovery": "--ros2-discovery"}
        names |= {"allow_network": "--allow-network", "ros_args": "--ros-args"}
        for option in options_given(context, names) if not self.ros2 else ():
            raise InvalidArgumentError(option, cause="it requires --ros2", remedy="add that, or omit it")
        if not self.ros2:
            return
        if connect is not None:
            cause = "with --connect another rosbridge is served"
            raise InvalidArgumentError("--ros2", cause=cause, remedy="omit one of them")
        chosen = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
        is_open = chosen not in {"LOCALHOST", "OFF"} if chosen else self.ros2_discovery is not Discovery.LOCALHOST
        if is_open and not self.allow_network:
            what = f"ROS_AUTOMATIC_DISCOVERY_RANGE={chosen}" if chosen else f"--ros2-discovery {self.ros2_discovery}"
            cause = f"with {what} every machine of the network can control the simulation; DDS asks for no token"
            raise InvalidArgumentError("--ros2", cause=cause, remedy="add --allow-network, or choose localhost")
        if is_open:
            warn("every machine of the network can see and control this simulation over ROS 2; DDS asks for no token")

    def start(
        self,
        resources: ExitStack,
        simulation: Simulation,
        node: Node,
        interface: RosInterface,
        *,
        on_refusal: Callable[[Refusal], object],
    ) -> None:
        """Starts the node with `--ros2`; its end is printed.

        Raises:
            Ros2Error: there is no ROS 2, or its process does not start.
        """
        from mindstage.bridge import LocalNode
        from mindstage.ros2 import find_environment
        from mindstage.ros2.served_simulation import serve_simulation

        if not self.ros2 or not isinstance(node, LocalNode):
            return
        with progress_spinner("starting the node of ROS 2; its message packages are built once, which takes minutes"):
            served = serve_simulation(
                simulation,
                local_node=node,
                interface=interface,
                environment=find_environment(self.ros2_python),
                domain=self.ros2_domain,
                discovery=self.ros2_discovery,
                ros_args=shlex.split(self.ros_args),
                on_refusal=on_refusal,
                on_end=lambda reason: warn(f"ROS 2: {reason}; start `mindstage serve --ros2` again"),
            )
        resources.enter_context(served)


NO_ROS2 = Ros2Options()


def ros2_commands(space: str) -> tuple[str, ...]:
    """Five commands of ROS 2 that show the simulation in a namespace such as `/unreal`."""
    return (
        "ros2 topic list",
        "ros2 topic echo --once /clock",
        f"ros2 service call {space}/get_entities simulation_interfaces/srv/GetEntities",
        "ros2 param set /mindstage paused true",
        f"ros2 action send_goal {space}/simulate_steps simulation_interfaces/action/SimulateSteps '{{steps: 100}}'",
    )


def doctor(*, python: Python = None, as_json: AsJson = False) -> ExitCode:
    """Show which ROS 2 is found, whether it works, and which message packages are to be built."""
    from mindstage.ros2 import find_environment
    from mindstage.ros2.environment import TESTED_DISTRIBUTIONS, udp_participants
    from mindstage.ros2.message_packages import package_folders

    environment = find_environment(python)
    facts = environment.facts
    folders = package_folders(environment)
    unbuilt = [name for name, folder in folders.items() if not folder.exists()]
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    participants = udp_participants(int(domain) if domain.isdecimal() else 0)
    result = {
        "distribution": environment.distribution,
        "tested": environment.distribution in TESTED_DISTRIBUTIONS,
        "python": str(environment.python),
        **{f"{name}_version" if name in {"python", "numpy"} else name: value for name, value in facts.items()},
        "missing_packages": list(folders),
        "unbuilt_packages": unbuilt,
        "domain": domain,
        "discovery": os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
        "participants": participants,
    }
    if as_json:
        print_json(result)
        return ExitCode.OK
    print_line(f"ROS 2 {environment.distribution}: {environment.python} (Python {facts['python']}, {facts['rmw']})")
    if not result["tested"]:
        warn(f"the tests run with {', '.join(TESTED_DISTRIBUTIONS)}, not with {environment.distribution}")
    if folders:
        how = f"; {', '.join(unbuilt)} will be built by the first `serve --ros2`, or by `ros2 build-messages`"
        print_line(f"message packages that it lacks: {', '.join(folders)}{how if unbuilt else '; they are built'}")
    print_line(f"domain {domain}, with {participants} participants on this machine; discovery {result['discovery']}")
    if participants >= _MAX_PARTICIPANTS:
        warn(f"beyond about {_MAX_PARTICIPANTS} participants of a domain, later ones do not find each other")
    return ExitCode.OK


def build_messages(
    *,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="DIR", help="Where to install them.", show_default="the cache", file_okay=False
        ),
    ] = None,
    python: Python = None,
    package: Annotated[
        list[str] | None,
        typer.Option(
            "--package", metavar="NAME", help="Build this one too, such as rosapi; may be repeated.", show_default=False
        ),
    ] = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Build the message packages that Mindstage uses and ROS 2 lacks: for C and Python, once, in some minutes."""
    from mindstage.msgs.message_registry import packages
    from mindstage.ros2 import build_message_packages, find_environment
    from mindstage.ros2.message_packages import USED_PACKAGES

    for name in package or ():
        if name not in packages():
            raise Ros2Error(f"Mindstage has no package {name}", remedy=f"there is {', '.join(packages())}")
    with progress_spinner("building message packages"):
        built = build_message_packages(
            find_environment(python), out, packages=dict.fromkeys((*USED_PACKAGES, *(package or ())))
        )
    if as_json:
        print_json({"packages": {name: str(folder) for name, folder in built.items()}})
    elif built:
        for name, folder in built.items():
            print_line(f"{name}: {folder}")
        print_line("Put these folders in front of AMENT_PREFIX_PATH, their lib in front of LD_LIBRARY_PATH,")
        print_line("and their lib/python3.*/site-packages in front of PYTHONPATH.")
    else:
        print_line("all packages are installed; nothing was built")
    return ExitCode.OK
