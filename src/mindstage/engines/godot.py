"""Line: the way to a Godot of ours: a bridge in this process, which nobody but that Godot can join.

GodotEngine: a world in a Godot of its own.

It is started for this engine, joins a bridge that only it can join, is told what was decided here, and ends with the
engine. Godot's numbers have single precision: a pose that nothing moved comes back as it was given, others are rounded.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from secrets import token_urlsafe
from typing import Any

from mindstage.assets.cache import cache_geometry_glb, geometry_cache_dir
from mindstage.bridge import BridgeLimits, LocalNode, RosbridgeServer
from mindstage.bridge.conversions import point_message
from mindstage.engines.godot_process import GodotProcess, find_godot, prepare_project
from mindstage.engines.remote.client import RemoteUrl, ServiceClient
from mindstage.engines.remote.compiled import CompiledRemoteEngine
from mindstage.errors import BridgeError, ConnectionLostError, EngineError, EngineUnavailableError
from mindstage.msgs import engine_service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.scene import Vector

__all__ = ["GodotBridge", "GodotEngine", "GodotServiceClient"]


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


_NAMESPACE = "godot"


class GodotEngine(CompiledRemoteEngine):
    """The contract, kept by Godot 4 and its Jolt."""

    precision = 2e-6
    """So much of a number is lost in single precision and on the way through other axes, relative to its size."""

    def __init__(
        self,
        program: str | Path | None = None,
        *,
        window: bool = False,
        options: Sequence[str] = (),
        timeout_s: float = 20.0,
        start_timeout_s: float = 60.0,
    ) -> None:
        """Starts Godot, and waits until it can be used.

        Args:
            program: which Godot; by default the one on PATH, or in a usual place.
            window: whether it shows the world in a window.
            options: more of Godot's own options, such as how to draw.
            timeout_s: how long a call may take; larger worlds have more [s].
            start_s: how long it may take to start [s].

        Raises:
            EngineUnavailableError: there is none, it is too old, or it does not start.
        """
        godot = find_godot(program)
        project, forms = prepare_project(godot), geometry_cache_dir()
        line = GodotBridge()
        try:
            line.process = GodotProcess(
                godot, project, url=line.server.url, token=line.token, namespace=_NAMESPACE, mesh_dir=forms,
                window=window, options=options,
            )  # fmt: skip
            line.wait_services(_NAMESPACE, start_timeout_s)
            super().__init__(
                GodotServiceClient(line, namespace=_NAMESPACE, timeout_s=timeout_s), export_mesh=cache_geometry_glb
            )
        except BaseException:
            line.close()
            raise
        self.version = godot.version
        """Of Godot."""
        self.pid = line.process.pid
        """Of its process."""

    def save_scene(self, path: str | Path) -> None:
        """Writes what stands there as a scene of Godot's (.tscn), which its editor opens.

        Raises:
            WorldError: it cannot be written there.
        """
        self._call(wire.SaveScene, wire.SaveScene.Request(path=str(Path(path).absolute())))

    def screenshot(
        self,
        path: str | Path,
        *,
        eye: Vector,
        target: Vector,
        size: tuple[int, int] = (1280, 720),
        fov_deg: float = 50.0,
    ) -> None:
        """Writes a picture of what stands there to a PNG file; for this it must have been started with a window.

        Args:
            path: the file.
            eye: from where [m].
            target: what is in the middle [m].
            size: of the picture [pixels].
            fov_deg: from its upper to its lower edge.

        Raises:
            WorldError: nothing is drawn, or it cannot be written there.
        """
        request = wire.Photograph.Request(
            path=str(Path(path).absolute()), width=size[0], height=size[1], eye=point_message(eye),
            target=point_message(target), fov_deg=fov_deg,
        )  # fmt: skip
        self._call(wire.Photograph, request)
