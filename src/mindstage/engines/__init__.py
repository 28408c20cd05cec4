"""Engines: who can run a world, and what they all promise."""

from importlib import import_module
from typing import TYPE_CHECKING

from mindstage.engines.contract import Ability, Engine, Failure, Note, NoteKind, Poses, SpawnReport, State, Statistics
from mindstage.engines.null import NullEngine

if TYPE_CHECKING:
    from mindstage.engines.godot import GodotEngine
    from mindstage.engines.mujoco import MujocoEngine
    from mindstage.engines.remote import RemoteEngine

__all__ = [
    "Ability",
    "Engine",
    "Failure",
    "GodotEngine",
    "MujocoEngine",
    "Note",
    "NoteKind",
    "NullEngine",
    "Poses",
    "RemoteEngine",
    "SpawnReport",
    "State",
    "Statistics",
]


def __getattr__(name: str) -> object:
    # A heavy engine loads when it is first asked for.
    if name == "MujocoEngine":
        return import_module("mindstage.engines.mujoco").MujocoEngine
    if name == "GodotEngine":
        return import_module("mindstage.engines.godot").GodotEngine
    if name == "RemoteEngine":
        return import_module("mindstage.engines.remote").RemoteEngine
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
