"""Line: the way to a Godot of ours: a bridge in this process, which nobody but that Godot can join."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from secrets import token_urlsafe
from typing import Any

from mindstage.bridge import Hub, Limits, Server
from mindstage.engines.godot.process import GodotProcess
from mindstage.engines.remote import Address
from mindstage.engines.remote.link import Link
from mindstage.errors import BridgeError, ConnectionLost, EngineError, EngineUnavailable
from mindstage.msgs import engine_service
from mindstage.msgs import mindstage_msgs as wire

__all__ = ["GodotLine", "GodotLink"]

_LIMITS = Limits(
    message_bytes=256 << 20, waiting_bytes=256 << 20, connections=2, call_s=60.0
)  # a whole world may come in one message
_LOOK_S = 0.02
_DYING_S = 2.0
"""How long after its connection broke a process may take to be gone [s]."""
_NEEDED = (
    wire.Describe, wire.SpawnWorld, wire.LogWorld, wire.Delete, wire.Clear, wire.Attach, wire.Detach, wire.SetPose,
    wire.SetPhysics, wire.SetMaterials, wire.Highlight, wire.GetHighlights, wire.Step, wire.SetSpeed, wire.GetPoses,
)  # fmt: skip


class GodotLine(Hub):
    """A hub with a server of its own at a free port, and the one process that joins it."""

    def __init__(self) -> None:
        """Lets a Godot in from now on; `process` is it, once there is one."""
        super().__init__(limits=_LIMITS)
        self.token = token_urlsafe(24)
        self.process: GodotProcess | None = None
        try:
            self.server = Server(self, port=0, token=self.token, ping_s=None).start()
        except BridgeError as error:
            super().close()
            cause = f"no port of this machine can be listened at: {error}"
            raise EngineUnavailable("godot", cause=cause) from error

    @property
    def connected(self) -> bool:
        """Whether it runs and is here."""
        return self.process is not None and self.process.runs and self.server.clients > 0

    def wait_connected(self, timeout_s: float) -> None:
        """Nobody comes back who is gone.

        Raises:
            ConnectionLost: it is gone.
        """
        if not self.connected:
            raise ConnectionLost(self.server.url, cause="Godot is gone")

    def wait_offered(self, namespace: str, timeout_s: float) -> None:
        """Waits until all that an engine needs is offered.

        Raises:
            EngineUnavailable: it ended before, or took too long.
        """
        assert self.process is not None
        needed = {engine_service(service, namespace) for service in _NEEDED}
        until_s = time.monotonic() + timeout_s
        while missing := needed - self._offered():
            if not self.process.runs:
                raise EngineUnavailable("godot", cause=f"it did not start: {self.process.obituary()}")
            if time.monotonic() > until_s:
                what = "no service" if len(missing) == len(needed) else f"no {', '.join(sorted(missing))}"
                said = self.process.last_words() or "nothing"
                cause = f"after {timeout_s:g} s it offers {what}; it said: {said}"
                raise EngineUnavailable("godot", cause=cause, remedy="give it more time")
            time.sleep(_LOOK_S)

    def close(self) -> None:
        """Ends the process and the bridge; any number of times."""
        if self.process is not None:
            self.process.end()
        with suppress(BridgeError):
            self.server.close()
        super().close()

    def _offered(self) -> set[str]:
        return {listing.name for listing in self.directory().services}


class GodotLink(Link):
    """A link that knows why nobody answers any more."""

    def __init__(self, line: GodotLine, *, namespace: str, timeout_s: float) -> None:
        address = Address(host="127.0.0.1", port=line.server.port, namespace=namespace)
        super().__init__(address, timeout_s=timeout_s, line=line)
        self.name = "godot"
        self._line = line

    def be_ready(self) -> None:
        """See `Link`; nobody comes back who is gone."""
        self._telling_of_death(super().be_ready)

    def call_each(self, *args: Any, **options: Any) -> Iterator[Any]:
        """See `Link`."""
        answers = iter(super().call_each(*args, **options))
        while True:
            try:
                yield self._telling_of_death(lambda: next(answers))
            except StopIteration:
                return

    def _telling_of_death(self, ask: Callable[[], Any]) -> Any:
        try:
            return ask()
        except EngineError as error:
            process = self._line.process
            if process is None or (self._line.server.clients and process.runs) or not process.ended(_DYING_S):
                raise
            cause = process.obituary()
            raise EngineUnavailable(self.name, cause=cause, remedy="start a new one") from error
