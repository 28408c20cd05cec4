"""Installations of ROS 2: the Python that imports rclpy, and the variables that its processes need.

An installation is the wheels `ros-jazzy-*` in a virtual environment, a sourced `/opt/ros/DISTRO`, or any Python that is
named. Wheels find their libraries by LD_LIBRARY_PATH only, which is set for the child process, not for this one.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from mindstage.errors import Ros2Error
from mindstage.files import cache_dir

__all__ = ["TESTED_DISTRIBUTIONS", "Ros2Environment", "cache_folder", "find_environment", "udp_participants"]

TESTED_DISTRIBUTIONS = ("jazzy",)
"""Distributions that the tests run with; others are tried as well."""
_PROBE_TIME_S = 60.0
"""Longest time in which an interpreter imports rclpy [s]."""
_PROBE = """
import json, sys, os, sysconfig
import rclpy, numpy
from rclpy.utilities import get_rmw_implementation_identifier
print(json.dumps({"python": sys.version.split()[0], "rclpy": os.path.dirname(rclpy.__file__),
    "rmw": get_rmw_implementation_identifier(), "numpy": numpy.__version__}))
"""


def cache_folder() -> Path:
    """The folder in the cache directory for everything about ROS 2."""
    return cache_dir("ros2")


@dataclass(frozen=True)
class Ros2Environment:
    """An installation of ROS 2."""

    python: Path
    """The interpreter."""
    prefixes: tuple[Path, ...]
    """Folders with `share/PACKAGE`, the first one wins."""
    distribution: str
    base: Mapping[str, str] = field(default_factory=lambda: dict(os.environ), repr=False, hash=False)
    """The variables that those of the installation are added to."""

    @property
    def identity(self) -> tuple[str, ...]:
        """What message packages that are built for it depend on."""
        wheels = sorted(
            each.name
            for prefix in self.prefixes
            for each in (prefix / "lib").glob("python3.*/site-packages/ros_*.dist-info")
        )
        where = wheels or [f"{prefix}:{(prefix / 'share').stat().st_mtime_ns}" for prefix in self.prefixes]
        return (self.distribution, self.facts["python"].rpartition(".")[0], *where)

    def has_package(self, name: str) -> bool:
        """Whether a package is installed."""
        return any((prefix / "share" / name / "package.xml").exists() for prefix in self.prefixes)

    def variables(self, *in_front: Path) -> dict[str, str]:
        """Returns all variables of a process; packages in the folders `in_front` are found first."""
        variables = dict(self.base)
        prefixes = (*in_front, *self.prefixes)
        libraries = [str(prefix / "lib") for prefix in prefixes]
        pythons: list[str] = []
        for prefix in in_front:
            pythons += map(str, sorted((prefix / "lib").glob("python3.*/site-packages")))
        for packages in sorted((self.prefixes[-1] / "lib").glob("python3.*/site-packages")):
            libraries += map(str, sorted(packages.glob("ros_*.libs")))

        def joined(name: str, folders: list[str]) -> str:
            return os.pathsep.join(dict.fromkeys((*folders, *filter(None, variables.get(name, "").split(os.pathsep)))))

        return variables | {
            "AMENT_PREFIX_PATH": joined("AMENT_PREFIX_PATH", list(map(str, prefixes))),
            "LD_LIBRARY_PATH": joined("LD_LIBRARY_PATH", libraries),
            "PYTHONPATH": joined("PYTHONPATH", pythons),
            "PATH": joined("PATH", [str(self.python.parent)]),
            "ROS_VERSION": "2",
            "ROS_DISTRO": self.distribution,
        }

    @cached_property
    def facts(self) -> dict[str, str]:
        """Versions of Python, numpy and the middleware, by importing rclpy once.

        Raises:
            Ros2Error: rclpy cannot be imported.
        """
        try:
            done = subprocess.run(
                (str(self.python), "-c", _PROBE),
                env=self.variables(),
                capture_output=True,
                text=True,
                timeout=_PROBE_TIME_S,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise Ros2Error(f"{self.python} cannot import rclpy: {error}") from None
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise Ros2Error(f"{self.python} cannot import rclpy and numpy: {reason}")
        found: dict[str, str] = json.loads(done.stdout.strip().splitlines()[-1])
        return found


def find_environment(python: Path | str | None = None) -> Ros2Environment:
    """Returns an installation of ROS 2.

    Args:
        python: its interpreter. None for, in this order: `MINDSTAGE_ROS2_PYTHON`, `/usr/bin/python3` of a sourced
            installation, this interpreter, if it has the wheels, and `/opt/ros/DISTRO`.

    Raises:
        Ros2Error: there is none; the message has how to get it.
    """
    sourced = tuple(Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if each)
    named = python or os.environ.get("MINDSTAGE_ROS2_PYTHON")
    candidates = [Path(named)] if named else [*([Path("/usr/bin/python3")] if sourced else []), Path(sys.executable)]
    for candidate in candidates:
        prefix = candidate.absolute().parent.parent
        if any((prefix / "share").glob("rclpy/package.xml")):  # a virtual environment with the wheels
            return Ros2Environment(candidate.absolute(), (prefix,), _distribution(prefix))
        if sourced:
            return Ros2Environment(candidate, sourced, os.environ.get("ROS_DISTRO", "unknown"))
    if named is None or Path(named) == Path("/usr/bin/python3"):
        for prefix in sorted(Path("/opt/ros").glob("*/share/rclpy/package.xml"), reverse=True):
            folder = prefix.parents[2]
            packages = sorted(map(str, (folder / "lib").glob("python3.*/site-packages")))
            base = dict(os.environ) | {
                "PYTHONPATH": os.pathsep.join((*packages, *filter(None, (os.environ.get("PYTHONPATH"),))))
            }
            return Ros2Environment(Path("/usr/bin/python3"), (folder,), folder.name, base)
    where = f"{named} has no rclpy" if named else "it is neither sourced, nor in /opt/ros, nor installed as wheels"
    remedy = (
        "source /opt/ros/DISTRO/setup.bash, or make an environment of its own with `pip install ros-jazzy-rclpy "
        "ros-jazzy-rmw-fastrtps-cpp ros-jazzy-common-interfaces numpy` and name its Python with --ros2-python"
    )
    raise Ros2Error(where, remedy=remedy)


def _distribution(prefix: Path) -> str:
    for packages in (prefix / "lib").glob("python3.*/site-packages"):
        for each in packages.glob("ros_*_rclpy-*.dist-info"):
            return each.name.split("_")[1]
    return "jazzy"


def udp_participants(domain: int) -> int:
    """Returns how many participants of a domain listen on this machine, by their ports (RTPS 2.5, 9.6.2).

    Zero where `/proc/net/udp` does not exist.
    """
    first = 7400 + 250 * domain
    try:
        lines = Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]
    except OSError:
        return 0
    ports = {int(line.split()[1].rpartition(":")[2], 16) for line in lines}
    return sum(first + 10 <= port < first + 250 and (port - first) % 2 == 0 for port in ports)
