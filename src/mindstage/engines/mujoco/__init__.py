"""MuJoCo: the embedded engine, robotics' standard physics in the same process."""

from mindstage.engines.mujoco.engine import MujocoEngine
from mindstage.engines.mujoco.export import Mjcf, mjcf

__all__ = ["Mjcf", "MujocoEngine", "mjcf"]
