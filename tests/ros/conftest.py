"""A simulation with a small kitchen, its ROS interface at a local node, and clients; all are closed after the test."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.engines import MujocoEngine
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.ros import RosInterface
from mindstage.scene import Pose
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient
from tests.conftest import ROOT, missing
from tests.kitchenette import kitchenette
from tests.ros.real_rosbridge import PrepareError, RealRosbridge
from tests.ros.robot_client import RobotClient
from tests.ros.ros_messages import Ask, Call, question_caller


@pytest.fixture(scope="session")
def knowledge() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        yield knowledge


@pytest.fixture(scope="session")
def real_rosbridge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealRosbridge]:
    """A real ROS 1 with rosbridge_suite; one for each process of pytest-xdist, prepared once for all of them."""
    with _started_rosbridge(tmp_path_factory) as rosbridge:
        yield rosbridge


@pytest.fixture(scope="module")
def own_rosbridge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealRosbridge]:
    """One for the tests of a module, since it keeps the services of closed connections."""
    with _started_rosbridge(tmp_path_factory) as rosbridge:
        yield rosbridge


@contextmanager
def _started_rosbridge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealRosbridge]:
    script = Path(os.environ.get("MINDSTAGE_DATA") or ROOT.parent / "shared" / "data").parent / "rosbridge" / "start.sh"
    if not script.is_file():
        missing(f"no rosbridge for tests at {script}; name the folder beside it with MINDSTAGE_DATA")
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "rosbridge"
    shared.mkdir(exist_ok=True)
    with (shared / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            RealRosbridge(script, shared).prepare()
        except PrepareError as error:
            missing(str(error))
    folder = tmp_path_factory.mktemp("ros1")
    for name in ("src", "generated"):
        shutil.copytree(shared / name, folder / name, dirs_exist_ok=True)
    rosbridge = RealRosbridge(script, folder)
    try:
        rosbridge.start()
        yield rosbridge
    finally:
        rosbridge.stop()


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
        simulation.add_robot("mobile_manipulator", Pose((-0.3, 0.5, 0.0)))
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
