"""Engines that run a world: the `Engine` protocol, its implementations, and `make_engine` to create one by name."""

from __future__ import annotations

import os

from mindstage.access.limits import Timeout
from mindstage.engines.base import (
    DEFAULT_SPAWN_OPTIONS,
    Actuator,
    ActuatorMode,
    ActuatorState,
    Capability,
    Contact,
    DynamicsScale,
    Engine,
    EngineStats,
    MovedBody,
    PoseArray,
    SavedState,
    SpawnFailure,
    SpawnNote,
    SpawnNoteKind,
    SpawnOptions,
    SpawnReport,
)
from mindstage.engines.null import NullEngine
from mindstage.errors import EngineUnavailableError
from mindstage.ranges import checked

__all__ = [
    "DEFAULT_SPAWN_OPTIONS",
    "Actuator",
    "ActuatorMode",
    "ActuatorState",
    "Capability",
    "Contact",
    "DynamicsScale",
    "Engine",
    "EngineStats",
    "MovedBody",
    "NullEngine",
    "PoseArray",
    "SavedState",
    "SpawnFailure",
    "SpawnNote",
    "SpawnNoteKind",
    "SpawnOptions",
    "SpawnReport",
    "is_remote",
    "make_engine",
]

__dir__ = __all__.copy

_REMOTE_SCHEMES = ("ros://", "ros+tls://")
_NAMES = f"choose mujoco, godot, godot:window, null, or {_REMOTE_SCHEMES[0]}HOST:PORT/NAMESPACE"


@checked
def make_engine(name: str, *, godot: str | os.PathLike[str] | None = None, timeout_s: Timeout | None = None) -> Engine:
    """Creates an engine by name; the caller closes it, or passes it to a simulation that does.

    Args:
        name: "mujoco", "godot", "godot:window" (shows the world in a window), "null" (no physics), or the address of a
            remote engine, `ros://HOST:PORT/NAMESPACE`, or `ros+tls://…` over TLS.
        godot: path of the Godot executable; by default the one on PATH, or in a common location.
        timeout_s: timeout of a call to Godot or to a remote engine [s]; by default the engine's own.

    Raises:
        EngineUnavailableError: the name is unknown, or the engine cannot be loaded, started or reached.
    """
    match name:
        case "null":
            return NullEngine()
        case "mujoco":
            try:
                from mindstage.engines.mujoco.engine import MujocoEngine

                return MujocoEngine()
            except ImportError as error:
                raise EngineUnavailableError(
                    name, cause=str(error), remedy="reinstall mindstage, or use null"
                ) from error
        case "godot" | "godot:window":
            from mindstage.engines.remote.godot import GodotEngine

            program, window = None if godot is None else os.fspath(godot), name != "godot"
            return GodotEngine(program, window=window, timeout_s=20.0 if timeout_s is None else timeout_s)
        case _ if is_remote(name):
            from mindstage.engines.remote import connect

            return connect(name, timeout_s=10.0 if timeout_s is None else timeout_s)
        case _:
            raise EngineUnavailableError(name, cause="there is no engine of that name", remedy=_NAMES)


def is_remote(name: str) -> bool:
    """Whether a name is the address of a remote engine, whose world continues to run after it is disconnected."""
    return name.startswith(_REMOTE_SCHEMES)
