"""Where a robot that is added stands: at a given place of the floor, or at a free one in its middle."""

from __future__ import annotations

import math
import os

import numpy as np

from mindstage.errors import CommandRefusedError
from mindstage.maps.urdf.xacro_process import XacroRequest
from mindstage.ranges import Coordinate, checked
from mindstage.robots.edits import add_robot
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import RobotModel
from mindstage.robots.robot import Robot
from mindstage.robots.world import robot_world
from mindstage.scene import IDENTITY, Pose
from mindstage.scene.floor_plan import find_floor, free_floor_place
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.ray_casting import ShapeScene
from mindstage.simulation.simulation import Simulation

__all__ = ["add_standing_robot"]

_HEIGHT_M = 2.0
"""A robot does not begin below lower things, such as wall cupboards [m]."""


@checked
def add_standing_robot(
    session: Simulation,
    source: str | os.PathLike[str] | RobotModel,
    place: tuple[Coordinate, Coordinate, Coordinate] | None = None,
    *,
    near: tuple[Coordinate, Coordinate] | None = None,
    name: str = "",
    xacro: XacroRequest = False,
) -> Robot:
    """Adds a robot that stands on the floor, where the whole robot has room with its arms as they are at the start.

    Args:
        source: the name of a known model, the path of a description, or a model.
        place: x, y [m] and yaw [rad] in the world frame; by default a free place in the middle of the floor, away from
            everything else.
        near: x, y [m] of a point; the free place is then the nearest one to it.
        name: its name; by default that of the model.
        xacro: see `add_robot`; by default nothing is expanded.

    Raises:
        RobotNotFoundError: no model has that name.
        RobotModelError: the description cannot be read, or not all of it can be spawned.
        CommandRefusedError: the robot fits nowhere.
    """
    model = source if isinstance(source, RobotModel) else load_model(os.fspath(source), xacro=xacro, divide=True)
    world = session.snapshot()
    if place is not None:
        (x, y, yaw), level = place, find_floor(BodyBoxes.from_bodies(world.bodies))[0]
    else:
        radius = _radius(model)
        found = free_floor_place(world, session.geometry, radius=radius, height=_HEIGHT_M, near=near)
        if found is None:
            cause = f"nowhere on the floor is room for a radius of {radius:.2f} m"
            raise CommandRefusedError(name or model.name, command="to stand", cause=cause, remedy="name a place")
        (x, y, level), yaw = found, 0.0
    pose = Pose((x, y, level), (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)))
    return add_robot(session, model, pose, name=name)


def _radius(model: RobotModel) -> float:
    """The distance of the farthest point of a robot from the axis of its root link, as it is added [m]."""
    placed = robot_world(model, IDENTITY, name=model.name)
    low, high = ShapeScene(placed.world.bodies, placed.geometry).shape_boxes.bounds()
    far = np.maximum(np.abs(low[:, :2]), np.abs(high[:, :2]))
    return float(np.hypot(far[:, 0], far[:, 1]).max(initial=model.base.radius_m))
