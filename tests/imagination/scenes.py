"""Small worlds in which plans are tried."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from mindstage.engines import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Attachment, Body, BodyId, GeometryMap, Joint
from mindstage.simulation import Simulation
from tests.engines.geometries import box_shape, geometry
from tests.engines.scenes import body, world

__all__ = ["TABLE_HEIGHT_M", "on_table", "simulate", "slope"]

TABLE_HEIGHT_M = 0.7


def simulate(
    *parts: Body | Joint | Attachment, geometry: GeometryMap | None = None, engine: Engine | None = None
) -> Simulation:
    """A simulation of some boxes, without a thread of its own."""
    simulation = Simulation(KnowledgeBase(), engine or MujocoEngine(), primitive_shapes=True, threaded=False)
    simulation.spawn(world(*parts), geometry=geometry or {}, ground=False)
    return simulation


def on_table(*boxes: Body | Joint | Attachment, engine: Engine | None = None) -> Simulation:
    """A table whose right edge is at x = 0, on a floor, and boxes."""
    table = body("table", (-0.5, 0.0, TABLE_HEIGHT_M / 2), (1.0, 1.0, TABLE_HEIGHT_M))
    floor = body("floor", (0.0, 0.0, -0.05), (6.0, 6.0, 0.1))
    return simulate(floor, table, *boxes, engine=engine)


def slope(angle_rad: float, *, base_m: float, height_m: float, friction: float) -> Simulation:
    """A box on a slope that descends towards x; its base is along x."""
    half = angle_rad / 2
    turned = (cos(half), 0.0, sin(half), 0.0)
    normal = np.array([sin(angle_rad), 0.0, cos(angle_rad)])
    x, y, z = (-0.05 * normal).tolist()
    ramp = body("ramp", (x, y, z), (6.0, 6.0, 0.1), quaternion=turned)
    x, y, z = ((height_m / 2 + 1e-4) * normal).tolist()
    size = (base_m, 0.15, height_m)
    box = body("box", (x, y, z), size, "dynamic", 1.0, quaternion=turned)
    corners = [tuple(sign * extent / 2 for extent in size) for sign in (-1, 1)]
    shapes = {
        BodyId("ramp"): geometry(box_shape((-3.0, -3.0, -0.05), (3.0, 3.0, 0.05)), friction=friction),
        BodyId("box"): geometry(box_shape(*corners), friction=friction),  # type: ignore[arg-type]
    }
    return simulate(ramp, box, geometry=shapes)
