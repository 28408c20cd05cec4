"""GodotEngine: a world in a Godot of its own.

It is started for this engine, joins a bridge that only it can join, is told what was decided here, and ends with the
engine. Godot's numbers have single precision: a pose that nothing moved comes back as it was given, others are rounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mindstage.bridge.description import point_message
from mindstage.engines.godot.line import GodotBridge, GodotServiceClient
from mindstage.engines.godot.process import GodotProcess
from mindstage.engines.godot.program import find_godot
from mindstage.engines.godot.project import prepare_project
from mindstage.engines.remote.planned import CompiledRemoteEngine
from mindstage.exports import cache_geometry_glb, geometry_cache_dir
from mindstage.msgs import mindstage_msgs as wire
from mindstage.world import Vector

__all__ = ["GodotEngine"]

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
