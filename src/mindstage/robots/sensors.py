"""Sensors of robots: what one measures at a link in the present state of the world, without noise.

print(measure(robot, "laser_scanner", "base_link").ranges)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.errors import InvalidArgumentError, suggestion
from mindstage.registry import Group, extensions
from mindstage.robots.robot import Robot
from mindstage.scene.ray_casting import ShapeScene
from mindstage.scene.transforms import quat_rotate

__all__ = ["LASER_SCANNER", "ODOMETRY", "LaserScan", "Sensor", "measure", "sensor_names"]

_RAYS = 360
"""The number of directions of a scan."""
_RANGE_M = 10.0


class Sensor(NamedTuple):
    """A kind of sensor; the entry points `mindstage.sensors` name these."""

    summary: str
    """What it measures, with units."""
    measure: Callable[[Robot, str], object]
    """Returns what it measures now at a link of a robot, as what msgspec encodes as JSON."""


class LaserScan(msgspec.Struct, frozen=True, kw_only=True):
    """Distances in the plane of the x and y axes of a link, counterclockwise from its -x axis."""

    angle_increment_rad: float
    range_max_m: float
    ranges: tuple[float | None, ...]
    """To the nearest collision shape that is not of the robot [m]; None if there is none in range."""


def sensor_names() -> tuple[str, ...]:
    """The names of all sensors; for the request of a client of a port those that are offered."""
    return tuple(extensions(Group.SENSORS))


def measure(robot: Robot, sensor: str, link: str = "") -> object:
    """What a sensor measures now at a link of a robot.

    Args:
        sensor: the name of the kind of sensor, such as "laser_scanner".
        link: the link; by default that of the first sensor of this type in the description, or that of the base.

    Raises:
        InvalidArgumentError: there is no such sensor, or no such link.
        ExtensionError: the package that adds the sensor cannot be imported, or fails.
    """
    known = extensions(Group.SENSORS)
    if sensor not in known:
        cause = f"there is no sensor {sensor!r}"
        raise InvalidArgumentError("a sensor", cause=cause, remedy=suggestion(sensor, known))
    if link and link not in robot.link_ids:
        raise InvalidArgumentError(
            "a sensor", cause=f"{robot.name} has no link {link!r}", remedy=suggestion(link, robot.link_ids)
        )
    described = (each.link for each in robot.model.sensors if each.type.value.replace(" ", "_") == sensor)
    with known[sensor].failing():
        return known[sensor].load(Sensor).measure(robot, link or next(described, robot.model.base.link))


def _scan(robot: Robot, link: str) -> LaserScan:
    world, pose = robot.session.snapshot(), robot.link_pose(link)
    scene = ShapeScene(world.bodies, robot.session.geometry)
    angles = np.linspace(-math.pi, math.pi, _RAYS, endpoint=False)
    directions = quat_rotate(pose[None, 3:], np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_RAYS)]))
    own = np.array([body.id in robot.body_ids for body in scene.bodies])
    distances, _ = scene.first_hits(pose[:3], directions, np.full(_RAYS, _RANGE_M), own)
    ranges = tuple(float(each) if each <= _RANGE_M else None for each in distances)
    return LaserScan(angle_increment_rad=2 * math.pi / _RAYS, range_max_m=_RANGE_M, ranges=ranges)


LASER_SCANNER = Sensor("distances in a plane [m], a degree apart", _scan)
ODOMETRY = Sensor("motion of the base since it was added [m, rad]", lambda robot, link: robot.odometry())
