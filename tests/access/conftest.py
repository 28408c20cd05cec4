"""A simulation that is served at all ports at once, and the fixtures of the bridge."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import NamedTuple

import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.access.limits import VisitorLimits
from mindstage.access.policies import EntryPoint
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.episodes.replay import EpisodeReplay
from mindstage.robots import add_robot
from mindstage.ros import RosInterface
from mindstage.ros.queries import QueryServer
from mindstage.viewer import Viewer
from tests.bridge.conftest import local_node, make_raw_client, server
from tests.episodes.kitchenette_recording import kitchenette_recording
from tests.kitchenette import kitchenette
from tests.prolog.conftest import prolog

__all__ = ["TOKEN", "Served", "local_node", "make_raw_client", "prolog", "server"]

TOKEN = "sesame"


class Served(NamedTuple):
    """A simulation with a robot, and its servers; all of them need the token."""

    simulation: Simulation
    node: LocalNode
    rosbridge: RosbridgeServer
    viewer: Viewer
    replay: Viewer
    shell: QueryServer

    def entry_points(self) -> tuple[EntryPoint, ...]:
        """Everything that a client can reach now, at any port."""
        pages = (*self.viewer.entry_points(), *self.replay.entry_points())
        return (*self.node.entry_points(), *self.shell.entry_points(), *pages)


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    limits = VisitorLimits(queries_per_second=0.001)  # of addresses that are not this machine
    with ExitStack() as stack:
        simulation = stack.enter_context(Simulation(KnowledgeBase(), MujocoEngine()))
        simulation.spawn(kitchenette())
        add_robot(simulation, "mobile_manipulator")
        node = stack.enter_context(LocalNode())
        stack.enter_context(RosInterface(simulation, node))
        rosbridge = stack.enter_context(RosbridgeServer(node, port=0, token=TOKEN, visitor_limits=limits))
        viewer = stack.enter_context(Viewer(simulation, port=0, token=TOKEN, visitor_limits=limits))
        episode = stack.enter_context(EpisodeReplay(kitchenette_recording(), KnowledgeBase()))
        replay = stack.enter_context(Viewer(episode, port=0, token=TOKEN, visitor_limits=limits))
        shell = QueryServer(simulation)
        stack.callback(shell.close)
        yield Served(simulation, node, rosbridge, viewer, replay, shell)
