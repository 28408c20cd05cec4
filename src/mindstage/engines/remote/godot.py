"""GodotEngine: a world simulated by a Godot process of its own.

The process is started for the engine, connects to a rosbridge server in this process that accepts no other client,
receives a compiled physics model, and ends with the engine. Godot uses single precision: poses of unmoved bodies are
returned as given, others are rounded.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from secrets import token_urlsafe
from typing import Any

from mindstage.access.limits import BridgeLimits, Timeout
from mindstage.assets.cache import cache_geometry_glb, geometry_cache_dir
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.bridge.conversions import point_message
from mindstage.engines.base import EngineFactory, EngineSettings
from mindstage.engines.remote.client import RemoteUrl, ServiceClient
from mindstage.engines.remote.compiled import CompiledRemoteEngine
from mindstage.engines.remote.godot_process import GodotProcess, find_godot, prepare_project
from mindstage.errors import BridgeError, ConnectionLostError, EngineError, EngineUnavailableError
from mindstage.msgs import engine_service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ranges import Degrees, PictureSize, Point, checked

__all__ = ["GODOT_ENGINE", "GodotBridge", "GodotEngine", "GodotServiceClient"]


_LIMITS = BridgeLimits(
    message_bytes=256 << 20, waiting_bytes=256 << 20, connections=2, call_timeout_s=60.0
)  # a whole world may come in one message
_POLL_INTERVAL_S = 0.02
_EXIT_GRACE_S = 2.0
"""How long a process may take to exit after its connection is lost [s]."""
_REQUIRED_SERVICES = (
    wire.Describe, wire.SpawnWorld, wire.LogWorld, wire.Delete, wire.Clear, wire.Attach, wire.Detach, wire.SetPose,
    wire.SetPhysics, wire.SetMaterials, wire.SetLabel, wire.Highlight, wire.GetHighlights, wire.Step, wire.SetSpeed,
    wire.GetPoses,
)  # fmt: skip


class GodotBridge(LocalNode):
    """A rosbridge server at a free port, and the Godot process that is its only client."""

    def __init__(self) -> None:
        """Starts the server; `process` is set by the caller."""
        super().__init__(limits=_LIMITS)
        self.token = token_urlsafe(24)
        self.process: GodotProcess | None = None
        try:
            self.server = RosbridgeServer(self, port=0, token=self.token, ping_interval_s=None).start()
        except BridgeError as error:
            super().close()
            cause = f"the server cannot listen on a local port: {error}"
            raise EngineUnavailableError("godot", cause=cause) from error

    @property
    def connected(self) -> bool:
        """Whether the process runs and is connected."""
        return self.process is not None and self.process.is_running and self.server.client_count > 0

    @checked
    def wait_connected(self, timeout_s: Timeout) -> None:
        """Checks the connection; Godot never reconnects.

        Raises:
            ConnectionLostError: the connection is lost.
        """
        if not self.connected:
            raise ConnectionLostError(self.server.url, cause="Godot has exited")

    @checked
    def wait_services(self, namespace: str, timeout_s: Timeout) -> None:
        """Waits until Godot offers all services that the engine needs.

        Raises:
            EngineUnavailableError: Godot exited, or took too long.
        """
        assert self.process is not None
        needed = {engine_service(service, namespace) for service in _REQUIRED_SERVICES}
        deadline_s = time.monotonic() + timeout_s
        while missing := needed - self._service_names():
            if not self.process.is_running:
                raise EngineUnavailableError("godot", cause=f"it did not start: {self.process.exit_message()}")
            if time.monotonic() > deadline_s:
                offered = "no service" if len(missing) == len(needed) else f"no {', '.join(sorted(missing))}"
                output = self.process.log_tail() or "nothing"
                cause = f"after {timeout_s:g} s it offers {offered}; its last output: {output}"
                raise EngineUnavailableError("godot", cause=cause, remedy="increase the timeout")
            time.sleep(_POLL_INTERVAL_S)

    def close(self) -> None:
        """Ends the process and the server; closing again has no effect."""
        if self.process is not None:
            self.process.terminate()
        with suppress(BridgeError):
            self.server.close()
        super().close()

    def _service_names(self) -> set[str]:
        return {listing.name for listing in self.graph_info().services}


class GodotServiceClient(ServiceClient):
    """A service client that reports why the process exited."""

    def __init__(self, bridge: GodotBridge, *, namespace: str, timeout_s: float) -> None:
        address = RemoteUrl(host="127.0.0.1", port=bridge.server.port, namespace=namespace)
        super().__init__(address, timeout_s=timeout_s, transport=bridge)
        self.name = "godot"
        self._bridge = bridge

    def wait_ready(self) -> None:
        """See `ServiceClient`."""
        self._explaining_exit(super().wait_ready)

    def call_each(self, *args: Any, **options: Any) -> Iterator[Any]:
        """See `ServiceClient`."""
        responses = iter(super().call_each(*args, **options))
        while True:
            try:
                yield self._explaining_exit(lambda: next(responses))
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
            raise EngineUnavailableError(self.name, cause=cause, remedy="create a new engine") from error


_NAMESPACE = "godot"


class GodotEngine(CompiledRemoteEngine):
    """An engine that simulates with Godot 4 and its Jolt physics."""

    precision = 2e-6
    """Relative rounding error of single precision and axis conversion."""

    @checked
    def __init__(
        self,
        program: str | Path | None = None,
        *,
        window: bool = False,
        options: Sequence[str] = (),
        timeout_s: Timeout = 20.0,
        start_timeout_s: Timeout = 60.0,
    ) -> None:
        """Starts Godot and waits until it is ready.

        Args:
            program: the Godot executable; by default the one on PATH, or in a common location.
            window: whether to show the world in a window.
            options: additional command-line options of Godot, such as rendering options.
            timeout_s: timeout of a call; larger worlds have more time [s].
            start_timeout_s: timeout of the start [s].

        Raises:
            EngineUnavailableError: Godot was not found, is too old, or did not start.
        """
        godot = find_godot(program)
        project, mesh_dir = prepare_project(godot), geometry_cache_dir()
        bridge = GodotBridge()
        try:
            bridge.process = GodotProcess(
                godot, project, url=bridge.server.url, token=bridge.token, namespace=_NAMESPACE, mesh_dir=mesh_dir,
                window=window, options=options,
            )  # fmt: skip
            bridge.wait_services(_NAMESPACE, start_timeout_s)
            super().__init__(
                GodotServiceClient(bridge, namespace=_NAMESPACE, timeout_s=timeout_s), export_mesh=cache_geometry_glb
            )
        except BaseException:
            bridge.close()
            raise
        self.version = godot.version
        """Version of Godot."""
        self.pid = bridge.process.pid
        """Process id of Godot."""

    def save_scene(self, path: str | Path) -> None:
        """Saves the running world as a Godot scene (.tscn), for the editor.

        Raises:
            WorldError: the file cannot be written.
        """
        self._call(wire.SaveScene, wire.SaveScene.Request(path=str(Path(path).absolute())))

    @checked
    def screenshot(
        self,
        path: str | Path,
        *,
        eye: Point,
        target: Point,
        size: PictureSize = (1280, 720),
        fov_deg: Degrees = 50.0,
    ) -> None:
        """Saves an image of the running world as PNG; requires a window.

        Args:
            path: the file to write.
            eye: camera position [m].
            target: point in the center of the image [m].
            size: image size [pixels].
            fov_deg: vertical field of view [degrees].

        Raises:
            WorldError: nothing is rendered, or the file cannot be written.
        """
        request = wire.Photograph.Request(
            path=str(Path(path).absolute()), width=size[0], height=size[1], eye=point_message(eye),
            target=point_message(target), fov_deg=fov_deg,
        )  # fmt: skip
        self._call(wire.Photograph, request)


def _make_godot(name: str, settings: EngineSettings) -> GodotEngine:
    timeout_s = 20.0 if settings.timeout_s is None else settings.timeout_s
    return GodotEngine(settings.godot, window=name != "godot", timeout_s=timeout_s)


GODOT_ENGINE = EngineFactory(("godot", "godot:window"), _make_godot)
