"""MuJoCo: the embedded engine, robotics' standard physics in the same process."""

from importlib import import_module
from typing import TYPE_CHECKING

from mindstage.engines.mujoco.engine import MujocoEngine

if TYPE_CHECKING:
    from mindstage.engines.mujoco.mjcf import MjcfExport, world_to_mjcf

__all__ = ["MjcfExport", "MujocoEngine", "world_to_mjcf"]


def __getattr__(name: str) -> object:
    # Writing models needs an XML library, which running them does not.
    if name in ("MjcfExport", "world_to_mjcf"):
        return getattr(import_module("mindstage.engines.mujoco.mjcf"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
