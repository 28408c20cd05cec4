"""Shapes: MuJoCo's primitives for our bodies, and the inertia that goes with them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

from mindstage.world import Body, ShapeKind
from mindstage.world.geometry import Array

__all__ = ["THINNEST_M", "add_geom", "primitive", "unit_inertias"]

THINNEST_M = 0.001
_FRICTION = (0.8, 0.005, 0.0001)
_INERTIA_M = 0.005
"""For inertia a body is taken at least this thick, or a sheet of paper would spin without end."""


def add_geom(body: Any, kind: Any, extent: list[float], position: Array, quaternion: Array, ghost: bool) -> None:
    """Adds a massless primitive to one of MuJoCo's bodies; a ghost collides with nothing."""
    if ghost:
        body.add_geom(type=kind, size=extent, pos=position, quat=quaternion, mass=0.0, contype=0, conaffinity=0)
    else:
        body.add_geom(type=kind, size=extent, pos=position, quat=quaternion, mass=0.0, friction=_FRICTION)


def primitive(body: Body, half: list[float]) -> tuple[Any, list[float]]:
    """MuJoCo's primitive and its half extents; one that is not round any more becomes an ellipsoid."""
    if body.shape is None or body.shape.kind is ShapeKind.BOX:
        return mujoco.mjtGeom.mjGEOM_BOX, half
    if body.shape.kind is ShapeKind.SPHERE:
        return mujoco.mjtGeom.mjGEOM_ELLIPSOID, half
    return mujoco.mjtGeom.mjGEOM_CYLINDER, [(half[0] + half[1]) / 2, half[2], 0.0]


_INERTIA_OF_SQUARES = {
    ShapeKind.BOX: (1 / 12, 1 / 12, 1 / 12),
    ShapeKind.SPHERE: (1 / 20, 1 / 20, 1 / 20),
    ShapeKind.CYLINDER: (1 / 16, 1 / 16, 1 / 12),
}


def unit_inertias(bodies: Iterable[Body], sizes: Array) -> Array:
    """The diagonals of the inertia tensors of solids of even density and 1 kg, n x 3 [m²]."""
    kinds = (body.shape.kind if body.shape is not None else ShapeKind.BOX for body in bodies)
    factors = np.array([_INERTIA_OF_SQUARES[kind] for kind in kinds]).reshape(-1, 3)
    squares = np.maximum(sizes, _INERTIA_M) ** 2 * factors
    return np.asarray(squares.sum(axis=1, keepdims=True) - squares)
