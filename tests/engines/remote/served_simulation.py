"""A Mindstage server in this process, reached through a real socket; it can be restarted at the same port."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation

__all__ = ["ServedSimulation"]


class ServedSimulation:
    """A simulation with a rosbridge server, like `mindstage serve`."""

    def __init__(self, make: Callable[[], Engine] = MujocoEngine, **server: Any) -> None:
        """Configures the server without starting it.

        Args:
            make: creates the engine at each start.
            server: options of `RosbridgeServer`.
        """
        self._make_engine = make
        self._options = {"port": 0, **server}
        self._open = ExitStack()

    @property
    def address(self) -> str:
        return f"ros://127.0.0.1:{self._options['port']}/unreal"

    def start(self) -> ServedSimulation:
        self.knowledge = self._open.enter_context(KnowledgeBase())
        self.simulation = self._open.enter_context(Simulation(self.knowledge, self._make_engine()))
        self.hub = self._open.enter_context(LocalNode())
        self._open.enter_context(RosInterface(self.simulation, self.hub))
        self.server = self._open.enter_context(RosbridgeServer(self.hub, **self._options))
        self._options["port"] = self.server.port
        return self

    def stop(self) -> None:
        self._open.close()

    def __enter__(self) -> ServedSimulation:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()
