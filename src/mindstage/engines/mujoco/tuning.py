"""Tuning: how joints resist, set in a compiled model, where the inertia behind each joint is known."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

from mindstage.engines.mujoco.live import ModelJoint

__all__ = ["set_joint_friction", "set_soft_limits"]

_SLIDE_FRICTION = 1.0
"""A slide holds against what would accelerate it by this [m/s²]: 5 N for a drawer of 5 kg."""
_HINGE_FRICTION = 2.0
"""The same for hinges [rad/s²]."""
_DAMPING = 1.0
"""Of the speed along a joint, this part is lost in a second [1/s]."""


def set_soft_limits(model: Any, joints: Iterable[ModelJoint]) -> None:
    """Soft limits as springs and dampers of their true strength.

    A MuJoCo constraint of impedance d lets through 1 - d of every other force and adds d of its own, whose stiffness
    and damping are told for a unit of inertia and divided by d inside MuJoCo. With a small d that is the
    spring asked for; a spring too stiff for the time step gets a larger one, which is softer than asked but stable.
    """
    for joint in joints:
        limitable = [axis for axis in joint.axes if axis.is_prismatic or not joint.is_ball]
        for offset, axis in enumerate(limitable):
            if axis.soft_limit.enabled and axis.limit is not None and axis.soft_limit.stiffness > 0.0:
                dof = joint.dof_address + offset
                number = int(model.dof_jntid[dof])
                weight = model.dof_invweight0[dof]
                impedance = float(np.clip(10 * axis.soft_limit.stiffness * weight * model.opt.timestep**2, 0.01, 0.95))
                damping = max(axis.soft_limit.damping, 1e-6)
                model.jnt_solref[number] = (-axis.soft_limit.stiffness * weight, -damping * weight)
                model.jnt_solimp[number] = (impedance, impedance, 0.001, 0.5, 2)


def set_joint_friction(model: Any, data: Any, joints: Iterable[ModelJoint]) -> None:
    """Gives every joint so much friction that it stays where it was put, gravity or not."""
    for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_passive):
        stage(model, data)  # of all that `mj_forward` does, only what gravity needs
    weight = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 0, weight)
    gravity = np.abs(weight - data.qfrc_passive)
    inertia = 1.0 / np.maximum(model.dof_invweight0, 1e-9)
    for joint in joints:
        for offset in range(len(joint.axes)):
            dof = joint.dof_address + offset
            slides = offset < sum(axis.is_prismatic for axis in joint.axes)
            holding = _SLIDE_FRICTION if slides else _HINGE_FRICTION
            model.dof_frictionloss[dof] = holding * inertia[dof] + 1.25 * gravity[dof]
            model.dof_damping[dof] = _DAMPING * inertia[dof]
            model.dof_solref[dof] = (0.005, 1.0)
            model.dof_solimp[dof] = (0.99, 0.999, 0.001, 0.5, 2)
