"""Engines that run a world: the `Engine` protocol, its implementations, and `make_engine` to create one by name."""

from __future__ import annotations

import os
from operator import attrgetter

from mindstage.access.limits import Timeout
from mindstage.engines.base import (
    Actuator,
    ActuatorMode,
    ActuatorState,
    Applied,
    Capability,
    Contact,
    DynamicsScale,
    Engine,
    EngineFactory,
    EngineSettings,
    EngineStats,
    MovedBody,
    PoseArray,
    SavedState,
    SpawnFailure,
    SpawnNote,
    SpawnNoteKind,
    SpawnReport,
)
from mindstage.engines.null import NullEngine
from mindstage.errors import EngineUnavailableError, ExtensionError
from mindstage.ranges import checked
from mindstage.registry import Group, catalog, extensions

__all__ = [
    "Actuator",
    "ActuatorMode",
    "ActuatorState",
    "Applied",
    "Capability",
    "Contact",
    "DynamicsScale",
    "Engine",
    "EngineFactory",
    "EngineSettings",
    "EngineStats",
    "MovedBody",
    "NullEngine",
    "PoseArray",
    "SavedState",
    "SpawnFailure",
    "SpawnNote",
    "SpawnNoteKind",
    "SpawnReport",
    "is_remote",
    "make_engine",
]

__dir__ = [*__all__, "edits"].copy

_REMOTE_SCHEMES = ("ros://", "ros+tls://")


@checked
def make_engine(name: str, *, godot: str | os.PathLike[str] | None = None, timeout_s: Timeout | None = None) -> Engine:
    """Creates an engine by name; the caller closes it, or passes it to a simulation that does.

    Args:
        name: "mujoco", "godot", "godot:window" (shows the world in a window), "null" (no physics), the address of a
            remote engine, `ros://HOST:PORT/NAMESPACE`, or `ros+tls://…` over TLS, or that of an installed package.
        godot: path of the Godot executable; by default the one on PATH, or in a common location.
        timeout_s: timeout of a call to Godot or to a remote engine [s]; by default the engine's own.

    Raises:
        EngineUnavailableError: the name is unknown, or the engine cannot be loaded, started or reached.
    """
    chosen = extensions(Group.ENGINES).get(name.partition(":")[0])
    try:
        factory = None if chosen is None else chosen.load(EngineFactory)
    except ExtensionError as error:
        raise EngineUnavailableError(name, cause=str(error), remedy="install what it needs, or use null") from error
    if factory is None or not any(_is_named(name, form) for form in factory.forms):
        forms = catalog(Group.ENGINES, EngineFactory, attrgetter("geometries"), tuple[str, ...]).values()
        remedy = f"choose {', '.join(form for each in forms for form in each)}"
        raise EngineUnavailableError(name, cause="there is no engine of that name", remedy=remedy)
    return factory.make(name, EngineSettings(None if godot is None else os.fspath(godot), timeout_s))


def _is_named(name: str, form: str) -> bool:
    scheme, is_address, _ = form.partition("://")
    return name.startswith(f"{scheme}://") if is_address else name == form


def is_remote(name: str) -> bool:
    """Whether a name is the address of a remote engine, whose world continues to run after it is disconnected."""
    return name.startswith(_REMOTE_SCHEMES)
