"""Shapes: solids as MuJoCo's geoms, how they feel to the touch, and the inertia that goes with them.

MuJoCo gives two geoms that meet the friction and bounce of the one with the higher priority. So that wood on ice
slips and a ball bounces on wood, whatever is bouncy comes first, then what is more slippery; what nobody said
anything about comes last.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from math import exp, log, pi
from typing import Any

import mujoco
import numpy as np

from mindstage.engines.collision import GRAZE_M
from mindstage.engines.solids import SQUARES, Prepared, shape_solid
from mindstage.world import Body, Form, Solid, SolidKind
from mindstage.world.geometry import Array

__all__ = ["Touch", "add_geom", "inertia_frame", "set_defaults", "touch_of", "unit_inertias"]

Touch = dict[str, Any]
"""Options of geoms."""

_FRICTION = (0.8, 0.005, 0.0001)
_UNTOLD: Touch = {}
_GHOST: Touch = {"contype": 0, "conaffinity": 0, "friction": (1.0, 0.005, 0.0001)}
_INERTIA_M = 0.005
"""For inertia a body is taken at least this thick, or a sheet of paper would spin without end."""
_BOUNCY = 0.5
"""What bounces less, as all furniture does, has MuJoCo's own contacts: they hardly bounce, but come to rest."""
_CONTACT_S = 0.02
"""MuJoCo's own time constant of a contact."""
_STEPS = 20.0
"""A bounce lasts at least so many time steps, or the solver would not see it."""
_GEOMS = {
    SolidKind.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    SolidKind.SPHERE: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    SolidKind.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    SolidKind.HULL: mujoco.mjtGeom.mjGEOM_MESH,
}


def touch_of(form: Form | None, timestep_s: float, *, ghost: bool) -> Touch:
    """How a form's surface feels to others; what it does not say is as everywhere, and a ghost feels like nothing."""
    if ghost:
        return _GHOST
    if form is None or (form.friction is None and form.restitution is None):
        return _UNTOLD
    sliding = _FRICTION[0] if form.friction is None else max(form.friction, 1e-5)
    priority = 0 if form.friction is None else 1 + round(1000 * exp(-sliding))
    bounce = min(form.restitution or 0.0, 0.98)
    if bounce < _BOUNCY:
        return {"friction": (sliding, *_FRICTION[1:]), "priority": priority}
    # A damped spring of ratio z sends back the part exp(-pi z / sqrt(1 - z^2)) of the speed with which it was hit.
    damping = -log(bounce) / (pi**2 + log(bounce) ** 2) ** 0.5
    slow_enough = _STEPS * timestep_s / (pi * damping)
    solref = (max(_CONTACT_S, slow_enough), damping)
    return {"friction": (sliding, *_FRICTION[1:]), "priority": 10_000 + round(1000 * bounce), "solref": solref}


def set_defaults(spec: Any) -> None:
    """Sets what all geoms of a spec have in common: each attribute given to `add_geom` costs as much as its rest."""
    geom = spec.default.geom
    geom.type, geom.mass, geom.margin, geom.friction = mujoco.mjtGeom.mjGEOM_BOX, 0.0, -GRAZE_M, _FRICTION


def add_geom(body: Any, solid: Solid, place: Sequence[float] | None, *, touch: Touch, mesh: str = "") -> None:
    """Adds a massless solid to one of MuJoCo's bodies, of a spec with `set_defaults`.

    Args:
        body: the spec's.
        solid: what is added.
        place: of its middle on that body, seven numbers; None for the body's own pose.
        touch: how it feels, and whom.
        mesh: the name of the mesh that a hull was made into.
    """
    options: dict[str, Any] = {"meshname": mesh} if mesh else {"size": _extent(solid)}
    if place is not None:
        options["pos"], options["quat"] = place[:3], place[3:]
    if solid.kind is not SolidKind.BOX:
        options["type"] = _GEOMS[solid.kind]
    body.add_geom(**options, **touch)


def _extent(solid: Solid) -> list[float]:
    """Half extents, as MuJoCo wants them; a cylinder is as wide as it is on average."""
    x, y, z = (extent / 2 for extent in solid.size)
    return [(x + y) / 2, z, 0.0] if solid.kind is SolidKind.CYLINDER else [x, y, z]


def unit_inertias(bodies: Iterable[Body], sizes: Array) -> Array:
    """The moments of solids that fill the bodies' sizes, for 1 kg, n x 3 [m²]."""
    factors = np.array([SQUARES[shape_solid(body)] for body in bodies]).reshape(-1, 3)
    squares = np.maximum(sizes, _INERTIA_M) ** 2 * factors
    return np.asarray(squares.sum(axis=1, keepdims=True) - squares)


@lru_cache(maxsize=4096)
def inertia_frame(prepared: Prepared) -> tuple[Array, Array, Array]:
    """Where the mass of a form lies: its middle, the directions of its principal axes, and their moments for 1 kg.

    A body that nothing can touch has the inertia of something small. A form is worked out once, however often a model
    is built.
    """
    moments, axes = np.linalg.eigh(prepared.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, axes.reshape(9))
    return prepared.middle, turn, np.maximum(moments, _INERTIA_M**2 / 6)
