"""Another Mindstage, in this process and yet behind a real socket; it can be ended and started anew at its port."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines import Engine, MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation

__all__ = ["ServedSimulation"]


class ServedSimulation:
    """A stage that is served, as `mindstage serve` does it."""

    def __init__(self, make: Callable[[], Engine] = MujocoEngine, **server: Any) -> None:
        """Nothing is served yet.

        Args:
            make: the engine, anew at each start.
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
        self.stage = self._open.enter_context(Simulation(self.knowledge, self._make_engine()))
        self.hub = self._open.enter_context(LocalNode())
        self._open.enter_context(RosInterface(self.stage, self.hub))
        self.server = self._open.enter_context(RosbridgeServer(self.hub, **self._options))
        self._options["port"] = self.server.port
        return self

    def stop(self) -> None:
        self._open.close()

    def __enter__(self) -> ServedSimulation:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()
