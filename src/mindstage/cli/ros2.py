"""The verbs `ros2 doctor` and `ros2 build-messages`: what `serve --ros2` needs of this machine."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from mindstage.cli.options import AsJson, ExitCode
from mindstage.cli.output import print_json, print_line, progress_spinner, warn
from mindstage.errors import Ros2Error

__all__ = ["build_messages", "doctor"]

_MAX_PARTICIPANTS = 33
"""Participants of one machine and domain that find each other with Fast DDS' defaults."""

Python = Annotated[
    Path | None,
    typer.Option("--ros2-python", metavar="FILE", help="The Python that has rclpy.", show_default=False, dir_okay=False),
]


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
