"""MuJoCo: the embedded engine, robotics' standard physics in the same process."""

from importlib import import_module
from typing import TYPE_CHECKING

from mindstage.engines.mujoco.engine import MujocoEngine, whole_steps
from mindstage.engines.mujoco.state import (
    CompiledModel,
    CompiledState,
    ContactPoints,
    MergedContacts,
    contact_points,
    ground_last,
    merge_contacts,
)

if TYPE_CHECKING:
    from mindstage.engines.mujoco.mjcf import MjcfExport, world_to_mjcf

__all__ = [
    "CompiledModel",
    "CompiledState",
    "ContactPoints",
    "MergedContacts",
    "MjcfExport",
    "MujocoEngine",
    "contact_points",
    "ground_last",
    "merge_contacts",
    "whole_steps",
    "world_to_mjcf",
]


def __getattr__(name: str) -> object:
    # Writing models needs an XML library, which running them does not.
    if name in ("MjcfExport", "world_to_mjcf"):
        return getattr(import_module("mindstage.engines.mujoco.mjcf"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
