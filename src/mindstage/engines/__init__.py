"""Engines: the `Engine` contract, its implementations, and `make_engine`, which makes one by its name."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

from mindstage.engines.base import (
    Capability,
    Engine,
    EngineStats,
    PoseArray,
    SavedState,
    SpawnFailure,
    SpawnNote,
    SpawnNoteKind,
    SpawnReport,
)
from mindstage.engines.null import NullEngine
from mindstage.errors import EngineUnavailableError

if TYPE_CHECKING:
    from mindstage.engines.godot import GodotEngine
    from mindstage.engines.mujoco.engine import MujocoEngine
    from mindstage.engines.remote.connect import connect
    from mindstage.engines.remote.engine import RemoteEngine

__all__ = [
    "Capability",
    "Engine",
    "EngineStats",
    "GodotEngine",
    "MujocoEngine",
    "NullEngine",
    "PoseArray",
    "RemoteEngine",
    "SavedState",
    "SpawnFailure",
    "SpawnNote",
    "SpawnNoteKind",
    "SpawnReport",
    "connect",
    "is_remote",
    "make_engine",
]

_REMOTE = "ros://"
_NAMES = f"choose mujoco, godot, godot:window, null, or {_REMOTE}HOST:PORT/NAMESPACE"


def __getattr__(name: str) -> object:
    # A heavy engine loads when it is first asked for.
    if name == "MujocoEngine":
        return import_module("mindstage.engines.mujoco").MujocoEngine
    if name == "GodotEngine":
        return import_module("mindstage.engines.godot").GodotEngine
    if name == "RemoteEngine":
        return import_module("mindstage.engines.remote.engine").RemoteEngine
    if name == "connect":
        return import_module("mindstage.engines.remote.connect").connect
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def make_engine(name: str, *, godot: str | os.PathLike[str] | None = None, timeout_s: float | None = None) -> Engine:
    """Makes an engine by its name; whoever makes it closes it, which a simulation that owns it does.

    Args:
        name: "mujoco", "godot", "godot:window" (shows the world in a window), "null" (no physics), or the address of an
            engine that runs elsewhere, `ros://HOST:PORT/NAMESPACE`.
        godot: the Godot program; by default the one on PATH, or in a usual place.
        timeout_s: how long a call to Godot or to a remote engine may take [s]; by default the engine's own.

    Raises:
        EngineUnavailableError: there is no such engine, it cannot be loaded or started here, or not be reached.
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
            from mindstage.engines.godot import GodotEngine

            program, window = None if godot is None else os.fspath(godot), name != "godot"
            return GodotEngine(program, window=window, timeout_s=20.0 if timeout_s is None else timeout_s)
        case _ if is_remote(name):
            from mindstage.engines.remote.connect import connect

            return connect(name, timeout_s=10.0 if timeout_s is None else timeout_s)
        case _:
            raise EngineUnavailableError(name, cause="there is no engine of that name", remedy=_NAMES)


def is_remote(name: str) -> bool:
    """Whether an engine's name is the address of one that runs elsewhere; its world outlives the connection."""
    return name.startswith(_REMOTE)
