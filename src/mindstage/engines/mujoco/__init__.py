"""MuJoCo: the embedded engine, robotics' standard physics in the same process."""

from mindstage.engines.mujoco.engine import MujocoEngine

__all__ = ["MujocoEngine"]
