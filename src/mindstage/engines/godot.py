"""Line: the way to a Godot of ours: a bridge in this process, which nobody but that Godot can join."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from secrets import token_urlsafe
from typing import Any

from mindstage.bridge import BridgeLimits, LocalNode, RosbridgeServer
from mindstage.engines.godot.process import GodotProcess
from mindstage.engines.remote import RemoteUrl
from mindstage.engines.remote.link import ServiceClient
from mindstage.errors import BridgeError, ConnectionLostError, EngineError, EngineUnavailableError
from mindstage.msgs import engine_service
from mindstage.msgs import mindstage_msgs as wire

__all__ = ["GodotBridge", "GodotServiceClient"]

_LIMITS = BridgeLimits(
    message_bytes=256 << 20, waiting_bytes=256 << 20, connections=2, call_timeout_s=60.0
)  # a whole world may come in one message
_POLL_INTERVAL_S = 0.02
_EXIT_GRACE_S = 2.0
"""How long after its connection broke a process may take to be gone [s]."""
_REQUIRED_SERVICES = (
    wire.Describe, wire.SpawnWorld, wire.LogWorld, wire.Delete, wire.Clear, wire.Attach, wire.Detach, wire.SetPose,
    wire.SetPhysics, wire.SetMaterials, wire.Highlight, wire.GetHighlights, wire.Step, wire.SetSpeed, wire.GetPoses,
)  # fmt: skip


class GodotBridge(LocalNode):
    """A hub with a server of its own at a free port, and the one process that joins it."""

    def __init__(self) -> None:
        """Lets a Godot in from now on; `process` is it, once there is one."""
        super().__init__(limits=_LIMITS)
        self.token = token_urlsafe(24)
        self.process: GodotProcess | None = None
        try:
            self.server = RosbridgeServer(self, port=0, token=self.token, ping_interval_s=None).start()
        except BridgeError as error:
            super().close()
            cause = f"no port of this machine can be listened at: {error}"
            raise EngineUnavailableError("godot", cause=cause) from error

    @property
    def connected(self) -> bool:
        """Whether it runs and is here."""
        return self.process is not None and self.process.is_running and self.server.client_count > 0

    def wait_connected(self, timeout_s: float) -> None:
        """Nobody comes back who is gone.

        Raises:
            ConnectionLostError: it is gone.
        """
        if not self.connected:
            raise ConnectionLostError(self.server.url, cause="Godot is gone")

    def wait_services(self, namespace: str, timeout_s: float) -> None:
        """Waits until all that an engine needs is offered.

        Raises:
            EngineUnavailableError: it ended before, or took too long.
        """
        assert self.process is not None
        needed = {engine_service(service, namespace) for service in _REQUIRED_SERVICES}
        until_s = time.monotonic() + timeout_s
        while missing := needed - self._service_names():
            if not self.process.is_running:
                raise EngineUnavailableError("godot", cause=f"it did not start: {self.process.exit_message()}")
            if time.monotonic() > until_s:
                what = "no service" if len(missing) == len(needed) else f"no {', '.join(sorted(missing))}"
                said = self.process.log_tail() or "nothing"
                cause = f"after {timeout_s:g} s it offers {what}; it said: {said}"
                raise EngineUnavailableError("godot", cause=cause, remedy="give it more time")
            time.sleep(_POLL_INTERVAL_S)

    def close(self) -> None:
        """Ends the process and the bridge; any number of times."""
        if self.process is not None:
            self.process.terminate()
        with suppress(BridgeError):
            self.server.close()
        super().close()

    def _service_names(self) -> set[str]:
        return {listing.name for listing in self.graph_info().services}


class GodotServiceClient(ServiceClient):
    """A link that knows why nobody answers any more."""

    def __init__(self, bridge: GodotBridge, *, namespace: str, timeout_s: float) -> None:
        address = RemoteUrl(host="127.0.0.1", port=bridge.server.port, namespace=namespace)
        super().__init__(address, timeout_s=timeout_s, transport=bridge)
        self.name = "godot"
        self._bridge = bridge

    def wait_ready(self) -> None:
        """See `ServiceClient`; nobody comes back who is gone."""
        self._explaining_exit(super().wait_ready)

    def call_each(self, *args: Any, **options: Any) -> Iterator[Any]:
        """See `ServiceClient`."""
        answers = iter(super().call_each(*args, **options))
        while True:
            try:
                yield self._explaining_exit(lambda: next(answers))
            except StopIteration:
                return

    def _explaining_exit(self, function: Callable[[], Any]) -> Any:
        try:
            return function()
        except EngineError as error:
            process = self._bridge.process
            if (
                process is None
                or (self._bridge.server.client_count and process.is_running)
                or not process.exits_within(_EXIT_GRACE_S)
            ):
                raise
            cause = process.exit_message()
            raise EngineUnavailableError(self.name, cause=cause, remedy="start a new one") from error
