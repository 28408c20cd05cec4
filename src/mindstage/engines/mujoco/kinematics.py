"""Models for kinematic queries: chains of joints without geometry.

A chain has one body for each of its links and a site at the frame of interest. It has neither shapes nor forces, so
that forward kinematics and Jacobians cost microseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mindstage.scene.transforms import Array

__all__ = ["FRAME_SITE", "ChainJoint", "ChainJointType", "compile_chain"]

FRAME_SITE = "frame"
"""The name of the site at the end of a chain."""


class ChainJointType(StrEnum):
    """The types of the joints of a chain."""

    HINGE = "hinge"
    SLIDE = "slide"


class ChainJoint(NamedTuple):
    """A joint of a chain, and the link that it moves."""

    name: str
    type: ChainJointType
    origin: Array
    """The joint frame in the link before, seven numbers; that of the link at position 0."""
    axis: tuple[float, float, float]
    """In the joint frame."""
    range: tuple[float, float] | None = None
    """[m or rad]."""


def compile_chain(joints: Sequence[ChainJoint], frame: Array) -> Any:
    """Compiles a chain, whose coordinates are the positions of the joints in their order.

    Args:
        joints: the joints from the base to the tip.
        frame: the frame of interest in the last link, seven numbers.

    Returns:
        An `MjModel` with the site `FRAME_SITE`.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    body = spec.worldbody
    for joint in joints:
        body = body.add_body(pos=joint.origin[:3], quat=joint.origin[3:])
        body.explicitinertial, body.mass, body.inertia = True, 1.0, np.ones(3)
        kind = mujoco.mjtJoint.mjJNT_HINGE if joint.type is ChainJointType.HINGE else mujoco.mjtJoint.mjJNT_SLIDE
        added = body.add_joint(name=joint.name, type=kind, axis=joint.axis)
        if joint.range is not None:
            added.limited, added.range = True, joint.range
    body.add_site(name=FRAME_SITE, pos=frame[:3], quat=frame[3:])
    return spec.compile()
