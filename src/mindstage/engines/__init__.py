"""Engines: who can run a world, and what they all promise."""

from importlib import import_module
from typing import TYPE_CHECKING

from mindstage.engines.contract import Ability, Engine, Failure, Note, NoteKind, Poses, SpawnReport, State
from mindstage.engines.null import NullEngine

if TYPE_CHECKING:
    from mindstage.engines.mujoco import MujocoEngine
    from mindstage.engines.remote import RemoteEngine

__all__ = [
    "Ability",
    "Engine",
    "Failure",
    "MujocoEngine",
    "Note",
    "NoteKind",
    "NullEngine",
    "Poses",
    "RemoteEngine",
    "SpawnReport",
    "State",
]


def __getattr__(name: str) -> object:
    # A heavy engine loads when it is first asked for.
    if name == "MujocoEngine":
        return import_module("mindstage.engines.mujoco").MujocoEngine
    if name == "RemoteEngine":
        return import_module("mindstage.engines.remote").RemoteEngine
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
