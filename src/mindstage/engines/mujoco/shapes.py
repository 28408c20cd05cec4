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

from mindstage.engines.collision import JOINT_TOUCH_TOLERANCE_M
from mindstage.engines.solids import MEAN_SQUARES, CompiledGeometry, primitive_collision_type
from mindstage.world import Body, BodyGeometry, CollisionShape, CollisionShapeType
from mindstage.world.geometry import Array

__all__ = ["GeomOptions", "add_geom", "contact_options", "inertia_frame", "set_defaults", "unit_inertias"]

GeomOptions = dict[str, Any]
"""Options of geoms."""

_FRICTION = (0.8, 0.005, 0.0001)
_DEFAULT_CONTACT: GeomOptions = {}
_NO_CONTACT: GeomOptions = {"contype": 0, "conaffinity": 0, "friction": (1.0, 0.005, 0.0001)}
_MIN_INERTIA_SIZE_M = 0.005
"""For inertia a body is taken at least this thick, or a sheet of paper would spin without end."""
_MIN_RESTITUTION = 0.5
"""What bounces less, as all furniture does, has MuJoCo's own contacts: they hardly bounce, but come to rest."""
_CONTACT_TIME_CONSTANT_S = 0.02
"""MuJoCo's own time constant of a contact."""
_MIN_CONTACT_STEPS = 20.0
"""A bounce lasts at least so many time steps, or the solver would not see it."""
_GEOMS = {
    CollisionShapeType.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    CollisionShapeType.SPHERE: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    CollisionShapeType.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    CollisionShapeType.HULL: mujoco.mjtGeom.mjGEOM_MESH,
}


def contact_options(geometry: BodyGeometry | None, timestep_s: float, *, non_colliding: bool) -> GeomOptions:
    """How a form's surface feels to others; what it does not say is as everywhere, and a ghost feels like nothing."""
    if non_colliding:
        return _NO_CONTACT
    if geometry is None or (geometry.friction is None and geometry.restitution is None):
        return _DEFAULT_CONTACT
    sliding = _FRICTION[0] if geometry.friction is None else max(geometry.friction, 1e-5)
    priority = 0 if geometry.friction is None else 1 + round(1000 * exp(-sliding))
    bounce = min(geometry.restitution or 0.0, 0.98)
    if bounce < _MIN_RESTITUTION:
        return {"friction": (sliding, *_FRICTION[1:]), "priority": priority}
    # A damped spring of ratio z sends back the part exp(-pi z / sqrt(1 - z^2)) of the speed with which it was hit.
    damping = -log(bounce) / (pi**2 + log(bounce) ** 2) ** 0.5
    slow_enough = _MIN_CONTACT_STEPS * timestep_s / (pi * damping)
    solref = (max(_CONTACT_TIME_CONSTANT_S, slow_enough), damping)
    return {"friction": (sliding, *_FRICTION[1:]), "priority": 10_000 + round(1000 * bounce), "solref": solref}


def set_defaults(spec: Any) -> None:
    """Sets what all geoms of a spec have in common: each attribute given to `add_geom` costs as much as its rest."""
    geom = spec.default.geom
    geom.type, geom.mass, geom.margin, geom.friction = (
        mujoco.mjtGeom.mjGEOM_BOX,
        0.0,
        -JOINT_TOUCH_TOLERANCE_M,
        _FRICTION,
    )


def add_geom(
    body: Any,
    collision_shape: CollisionShape,
    pose: Sequence[float] | None,
    *,
    geom_options: GeomOptions,
    mesh: str = "",
) -> None:
    """Adds a massless solid to one of MuJoCo's bodies, of a spec with `set_defaults`.

    Args:
        body: the spec's.
        solid: what is added.
        place: of its middle on that body, seven numbers; None for the body's own pose.
        touch: how it feels, and whom.
        mesh: the name of the mesh that a hull was made into.
    """
    options: dict[str, Any] = {"meshname": mesh} if mesh else {"size": _half_extents(collision_shape)}
    if pose is not None:
        options["pos"], options["quat"] = pose[:3], pose[3:]
    if collision_shape.type is not CollisionShapeType.BOX:
        options["type"] = _GEOMS[collision_shape.type]
    body.add_geom(**options, **geom_options)


def _half_extents(collision_shape: CollisionShape) -> list[float]:
    """Half extents, as MuJoCo wants them; a cylinder is as wide as it is on average."""
    x, y, z = (extent / 2 for extent in collision_shape.size)
    return [(x + y) / 2, z, 0.0] if collision_shape.type is CollisionShapeType.CYLINDER else [x, y, z]


def unit_inertias(bodies: Iterable[Body], sizes: Array) -> Array:
    """The moments of solids that fill the bodies' sizes, for 1 kg, n x 3 [m²]."""
    factors = np.array([MEAN_SQUARES[primitive_collision_type(body)] for body in bodies]).reshape(-1, 3)
    squares = np.maximum(sizes, _MIN_INERTIA_SIZE_M) ** 2 * factors
    return np.asarray(squares.sum(axis=1, keepdims=True) - squares)


@lru_cache(maxsize=4096)
def inertia_frame(compiled: CompiledGeometry) -> tuple[Array, Array, Array]:
    """Where the mass of a form lies: its middle, the directions of its principal axes, and their moments for 1 kg.

    A body that nothing can touch has the inertia of something small. A form is worked out once, however often a model
    is built.
    """
    moments, axes = np.linalg.eigh(compiled.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, axes.reshape(9))
    return compiled.center_of_mass, turn, np.maximum(moments, _MIN_INERTIA_SIZE_M**2 / 6)
