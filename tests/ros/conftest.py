"""A simulation with a small kitchen, its ROS interface at a local node, and clients; all are closed after the test."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.msgs import RosVersion
from mindstage.robots import add_robot
from mindstage.ros import RosInterface
from mindstage.scene import Pose
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient
from tests.kitchenette import kitchenette
from tests.ros.robot_client import RobotClient
from tests.ros.ros_messages import Ask, Call, question_caller

ROS_PYTHON = "/usr/bin/python3"
RunRospy = Callable[..., str]


@pytest.fixture(scope="session")
def knowledge() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        yield knowledge


@pytest.fixture(scope="session")
def real_rosbridge() -> str:
    """The address of a rosbridge that is running already, as `MINDSTAGE_ROSBRIDGE` names it."""
    return os.environ.get("MINDSTAGE_ROSBRIDGE") or pytest.skip(
        "no running rosbridge is named; name one with MINDSTAGE_ROSBRIDGE=ws://HOST:PORT"
    )


@pytest.fixture(scope="session")
def ros_version(real_rosbridge: str) -> RosVersion:
    """The version of the named rosbridge: that of the sourced ROS, otherwise 2."""
    return RosVersion(int(os.environ.get("ROS_VERSION") or RosVersion.TWO))


@pytest.fixture(scope="session")
def run_rospy(ros_version: RosVersion) -> RunRospy:
    """Runs a Python script with rospy in the sourced ROS 1, and returns what it prints."""
    if ros_version is not RosVersion.ONE or not os.environ.get("ROS_MASTER_URI"):
        pytest.skip("the named rosbridge is not of a sourced ROS 1 (ROS_VERSION=1, ROS_MASTER_URI)")

    def run(script: str, *arguments: str) -> str:
        command = [ROS_PYTHON, "-", *arguments]
        done = subprocess.run(command, input=script, capture_output=True, text=True, timeout=300.0, check=False)
        assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
        return done.stdout

    return run


@pytest.fixture
def empty_simulation(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        yield simulation


@pytest.fixture
def simulation(empty_simulation: Simulation) -> Simulation:
    assert empty_simulation.spawn(kitchenette()).ok
    return empty_simulation


@pytest.fixture
def local_node() -> Iterator[LocalNode]:
    with LocalNode() as local_node:
        yield local_node


@pytest.fixture
def server(local_node: LocalNode) -> Iterator[RosbridgeServer]:
    with RosbridgeServer(local_node, port=0) as server:
        yield server


@pytest.fixture
def ros_interface(simulation: Simulation, local_node: LocalNode) -> Iterator[RosInterface]:
    with RosInterface(simulation, local_node) as ros_interface:
        yield ros_interface


@pytest.fixture
def call(ros_interface: RosInterface, local_node: LocalNode) -> Call:
    """Calls a service in the namespace, or one with an absolute name."""

    def call(service: str, /, **args: Any) -> Any:
        place = service if service.startswith("/") else f"/unreal/{service}"
        return local_node.call_service(place, args, timeout_s=TIMEOUT_S)

    return call


@pytest.fixture
def ask(call: Call) -> Ask:
    """Calls the service of a question."""
    return question_caller(call)


@pytest.fixture
def client(server: RosbridgeServer, ros_interface: RosInterface) -> Iterator[RosbridgeClient]:
    """A client, over a socket."""
    with RosbridgeClient(server.url) as client:
        yield client.wait_connected(TIMEOUT_S)


@pytest.fixture
def make_raw_client(server: RosbridgeServer, ros_interface: RosInterface) -> Iterator[Callable[[], RawClient]]:
    """Creates raw clients."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(closing(RawClient(server.url)))


# -- a robot ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def robot_simulation() -> Iterator[Simulation]:
    """A kitchenette and a robot 2 m in front of it, which faces it."""
    with KnowledgeBase() as knowledge, Simulation(knowledge, MujocoEngine()) as simulation:
        assert simulation.spawn(kitchenette()).ok
        add_robot(simulation, "mobile_manipulator", Pose((-0.3, 0.5, 0.0)))
        yield simulation


@pytest.fixture(scope="module")
def robot_server(robot_simulation: Simulation) -> Iterator[RosbridgeServer]:
    """A rosbridge server, while the simulation plays in real time."""
    with (
        LocalNode() as node,
        RosbridgeServer(node, port=0) as server,
        RosInterface(robot_simulation, node),
    ):
        robot_simulation.play()
        yield server
        robot_simulation.pause()


@pytest.fixture
def robot_client(robot_simulation: Simulation, robot_server: RosbridgeServer) -> Iterator[RobotClient]:
    """A client of the robot as it was added."""
    robot_simulation.reset()
    client = RobotClient(robot_server.port)
    yield client
    client.close()
