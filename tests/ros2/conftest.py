"""Real ROS 2: an environment for the test session, a served simulation, and rclpy clients in processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest

from mindstage.bridge import LocalNode
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.ros import RosInterface
from mindstage.ros2.environment import Ros2Environment, find_environment
from mindstage.ros2.message_packages import build_message_packages
from mindstage.ros2.served_simulation import ServedSimulation, serve_simulation
from mindstage.simulation import Simulation
from tests.conftest import ROOT, missing
from tests.kitchenette import kitchenette

CLIENT_TIME_S = 120.0
"""Longest time of a client, on a busy machine [s]."""

HEAD = """
import json, os, sys, time
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

rclpy.init()
node = Node("client")
found = {}

def until(condition, timeout_s=30.0):
    end_s = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=0.05)
    return bool(condition())

def wait(future, timeout_s=30.0):
    assert until(future.done, timeout_s), "no answer"
    return future.result()

def client(type, name):
    made = node.create_client(type, name)
    assert made.wait_for_service(30.0), name
    return made

def call(type, name, **fields):
    return wait(client(type, name).call_async(type.Request(**fields)))

def action(type, name):
    made = ActionClient(node, type, name)
    assert made.wait_for_server(30.0), name
    return made

def say(**values):
    print(json.dumps(values), flush=True)
"""


class RunClient:
    """Runs rclpy programs in a domain; each prints JSON objects."""

    def __init__(self, environment: Ros2Environment, domain: int) -> None:
        self.domain = domain
        self._python = environment.python
        folders = dict.fromkeys(build_message_packages(environment).values())
        self.variables = environment.variables(*folders) | {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }

    def start(self, program: str) -> subprocess.Popen[str]:
        """Starts a program; the caller reads its lines and waits for its end."""
        command = (str(self._python), "-u", "-c", HEAD + program)
        return subprocess.Popen(
            command,
            env=self.variables,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.PIPE,
            text=True,
        )

    def __call__(self, program: str) -> dict[str, Any]:
        """Runs a program and returns the union of what it says."""
        process = self.start(program)
        try:
            out, errors = process.communicate(timeout=CLIENT_TIME_S)
        except subprocess.TimeoutExpired:
            process.kill()
            out, errors = process.communicate()
            pytest.fail(f"the client did not end: {out}\n{errors}")
        assert process.returncode == 0, f"{out}\n{errors}"
        said: dict[str, Any] = {}
        for line in out.splitlines():
            said |= json.loads(line)
        return said


@pytest.fixture(scope="session")
def environment() -> Ros2Environment:
    """The ROS 2 of `scripts/ros2_for_tests.sh`, which installs it once."""
    if named := os.environ.get("MINDSTAGE_ROS2_PYTHON"):
        return find_environment(named)
    done = subprocess.run((str(ROOT / "scripts" / "ros2_for_tests.sh"),), capture_output=True, text=True, check=False)
    if done.returncode or not done.stdout.strip():
        missing(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "ROS 2 cannot be installed")
    return find_environment(done.stdout.strip().splitlines()[-1])


@pytest.fixture(scope="session")
def domain() -> int:
    """A domain that other test processes of this machine hardly have."""
    return 1 + os.getpid() % 230


@pytest.fixture(scope="session")
def run_client(environment: Ros2Environment, domain: int) -> RunClient:
    return RunClient(environment, domain)


class Served:
    """A simulation that is a node of ROS 2."""

    def __init__(self, simulation: Simulation, local_node: LocalNode, served: ServedSimulation) -> None:
        self.simulation = simulation
        self.local_node = local_node
        self.node = served.node


@pytest.fixture(scope="module")
def served(environment: Ros2Environment, domain: int) -> Iterator[Served]:
    with (
        Simulation(KnowledgeBase(), MujocoEngine()) as simulation,
        LocalNode() as local_node,
    ):
        simulation.spawn(kitchenette())
        with (
            RosInterface(simulation, local_node) as interface,
            serve_simulation(
                simulation, local_node=local_node, interface=interface, environment=environment, domain=domain
            ) as node,
        ):
            yield Served(simulation, local_node, node)
