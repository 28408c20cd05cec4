"""A real ROS 1 with rosbridge_suite on the loopback, as `../shared/rosbridge/start.sh` starts it.

The packages of `ros/` are built with genpy beside the original packages, so that the rosbridge can load their types.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from tests.bridge.raw_client import eventually

__all__ = ["ROS_PYTHON", "PrepareError", "RealRosbridge", "build_defined_packages", "build_ros1_packages"]

ROOT = Path(__file__).resolve().parent.parent.parent
ROS_PYTHON = "/usr/bin/python3"
GENPY = Path("/usr/lib/genpy")
GENACTION = Path("/usr/lib/actionlib_msgs/genaction.py")
PREPARE_TIMEOUT_S = 400.0
"""Time for the installation of Debian's packages of ROS [s]."""
START_TIMEOUT_S = 60.0
SHIPPED = {path.name: path for path in sorted((ROOT / "ros").glob("*")) + sorted((ROOT / "ros" / "ros1").glob("*"))}
SHIPPED = {name: path for name, path in SHIPPED.items() if (path / "package.xml").is_file()}


def build_ros1_packages(names: list[str], generated: Path, sources: Path) -> None:
    """Builds packages of `ros/` with genpy, as catkin does, and copies their sources to where ROS looks for them."""
    for name in names:
        source = sources / name
        shutil.copytree(SHIPPED[name], source, dirs_exist_ok=True)
        for action in sorted(source.glob("action/*.action")):
            _run(ROS_PYTHON, GENACTION, action, "-o", source / "msg")
    for name in names:
        source, target = sources / name, generated / name
        target.mkdir(parents=True, exist_ok=True)
        (target / "__init__.py").touch()
        includes = [f"-I{each}:/usr/share/{each}/msg" for each in ("std_msgs", "geometry_msgs", "actionlib_msgs")]
        includes += [f"-I{each}:{sources / each}/msg" for each in SHIPPED]
        for kind in ("msg", "srv"):
            files = sorted(source.glob(f"{kind}/*.{kind}"))
            if files:
                (target / kind).mkdir(exist_ok=True)
                _run(ROS_PYTHON, GENPY / f"gen{kind}_py.py", "-p", name, "-o", target / kind, *includes, *files)
                _run(ROS_PYTHON, GENPY / "genmsg_py.py", "--initpy", "-p", name, "-o", target / kind)


DEFINED = ("trajectory_msgs", "nav_msgs", "control_msgs", "controller_manager_msgs", "move_base_msgs")
"""Packages that a robot needs; Debian has the Python of the first two only."""


def build_defined_packages(generated: Path, sources: Path) -> None:
    """Builds the packages of robots' messages from the definitions of this project, where Debian has none."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        interface_text = importlib.import_module("make_ros_packages").interface_text
    includes = [f"-I{each}:/usr/share/{each}/msg" for each in ("std_msgs", "geometry_msgs", "actionlib_msgs")]
    for name in DEFINED:
        includes.append(f"-I{name}:{sources / name}/msg")
        (sources / name / "msg").mkdir(parents=True, exist_ok=True)
        manifest = f'<package format="2"><name>{name}</name><version>1.0.0</version>'
        manifest += '<description>of definitions</description><maintainer email="a@b.example">x</maintainer>'
        manifest += "<license>BSD</license></package>"
        (sources / name / "package.xml").write_text(manifest, encoding="utf-8")
        for path in sorted((ROOT / "src" / "mindstage" / "msgs" / "definitions" / name).glob("*/*.*")):
            target = sources / name / path.parent.name / path.name
            target.parent.mkdir(exist_ok=True)
            target.write_text(interface_text(path, ros=1), encoding="utf-8")
        for action in sorted(sources.glob(f"{name}/action/*.action")):
            _run(ROS_PYTHON, GENACTION, action, "-o", sources / name / "msg")
    for name in DEFINED[2:]:
        (generated / name).mkdir(parents=True, exist_ok=True)
        (generated / name / "__init__.py").touch()
        for kind in ("msg", "srv"):
            if files := sorted(sources.glob(f"{name}/{kind}/*.{kind}")):
                out = generated / name / kind
                out.mkdir(exist_ok=True)
                _run(ROS_PYTHON, GENPY / f"gen{kind}_py.py", "-p", name, "-o", out, *includes, *files)
                _run(ROS_PYTHON, GENPY / "genmsg_py.py", "--initpy", "-p", name, "-o", out)


def _run(*command: str | Path) -> None:
    done = subprocess.run([str(each) for each in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command[1]} failed: {done.stdout}\n{done.stderr}"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class PrepareError(Exception):
    """ROS cannot be installed on this machine."""


class RealRosbridge:
    """The running rosbridge, its master and rosapi."""

    def __init__(self, script: Path, folder: Path) -> None:
        self.script = script
        self.folder = folder
        self.port, self.master_port = free_port(), free_port()
        self.url = f"ws://127.0.0.1:{self.port}"
        self._process: subprocess.Popen[str] | None = None
        self._starts = 0

    @property
    def log(self) -> str:
        """What the rosbridge has logged since its last start."""
        return (self.folder / "rosbridge.log").read_text(encoding="utf-8", errors="replace")

    @property
    def log_errors(self) -> list[str]:
        """Errors in the log, and the last lines of tracebacks.

        A message for a client that has just left is an error of the websocket library, which no client can prevent.
        """
        blocks = re.split(r"\n(?=\S)", self.log)  # the lines of a traceback are indented, but for the last one
        errors = [
            block
            for block in blocks
            if "[ERROR]" in block or re.match(r"[\w.]+(Error|Exception|Disconnected): ", block)
        ]
        return [each for each in errors if "Attempt to send on a closed protocol" not in each]

    def prepare(self) -> None:
        """Installs ROS from Debian, and generates all messages."""
        command = ["bash", str(self.script), str(self.folder), "--prepare"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PREPARE_TIMEOUT_S, check=False)
        if done.returncode != 0:
            raise PrepareError(f"{self.script} --prepare failed: {done.stderr or done.stdout}")
        names = [name for name in SHIPPED if not (self.folder / "src" / name).exists()]
        build_ros1_packages(names, self.folder / "generated", self.folder / "src")

    def start(self) -> None:
        """Starts it, and waits until it accepts connections."""
        command = ["bash", str(self.script), str(self.folder), str(self.port), str(self.master_port)]
        output = self.folder / "start.log"
        with output.open("w") as file:
            self._process = subprocess.Popen(command, stdout=file, stderr=file, text=True, start_new_session=True)
        process = self._process
        eventually(lambda: "ready" in output.read_text() or process.poll() is not None, timeout_s=START_TIMEOUT_S)
        assert process.poll() is None, output.read_text()

    def kill(self) -> None:
        """Kills the rosbridge, the master and rosapi, without any goodbye."""
        assert self._process is not None
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(10.0)
        self._process = None

    def stop(self) -> None:
        """Ends all."""
        if self._process is not None:
            os.killpg(self._process.pid, signal.SIGTERM)
            try:
                self._process.wait(5.0)
            except subprocess.TimeoutExpired:
                self.kill()

    def run(self, script: str, *arguments: str, timeout_s: float = 60.0) -> str:
        """Runs a Python script with rospy, and returns what it prints."""
        done = subprocess.run(
            [ROS_PYTHON, "-", *arguments],
            input=script,
            env=self.environment(),
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
        return done.stdout

    def environment(self) -> dict[str, str]:
        """The environment of `env.sh`."""
        return {
            "PATH": "/usr/bin:/bin",
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.master_port}",
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(self.folder / "home"),
            "ROS_LOG_DIR": str(self.folder / "log"),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONPATH": f"{self.folder}/generated:/usr/lib/python3/dist-packages",
            "ROS_PACKAGE_PATH": f"{self.folder}/src:/usr/share",
        }
