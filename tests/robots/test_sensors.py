"""Sensors of robots: distances of a laser scanner, and what is refused."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from mindstage.access.policies import Access
from mindstage.access.resources import from_outside
from mindstage.errors import ExtensionError, InvalidArgumentError
from mindstage.registry import Group, added
from mindstage.robots.robot import Robot
from mindstage.robots.sensors import LaserScan, Sensor, measure, sensor_names
from tests.robots.rooms import box, robot_in


def test_a_laser_scanner_measures_distances_to_what_is_around_the_robot() -> None:
    with robot_in(box("wall", (2.0, 0.0, 0.5), (0.2, 4.0, 1.0)), at=(0.0, 0.0, 0.0)) as robot:
        poses = {link: robot.link_pose(link) for link in robot.link_ids}
        link, (x, *_) = next(
            (link, pose) for link, pose in poses.items() if 0.1 < pose[2] < 0.9 and abs(pose[3]) > 0.999999
        )
        scan = measure(robot, "laser_scanner", link)
        assert isinstance(scan, LaserScan)
        ahead = len(scan.ranges) // 2
        assert scan.ranges[ahead] == pytest.approx(1.9 - x, abs=1e-3)
        assert scan.ranges[ahead + 30] == pytest.approx((1.9 - x) / 0.8660254, abs=1e-3)
        assert scan.ranges[0] is None, "there is nothing behind it"


def test_odometry_is_a_sensor() -> None:
    with robot_in() as robot:
        robot.set_base_pose(0.5, 0.0, 0.0)
        assert measure(robot, "odometry") == robot.odometry()


def test_an_unknown_sensor_or_link_is_refused_with_what_there_is() -> None:
    with robot_in() as robot:
        with pytest.raises(InvalidArgumentError, match="near: 'laser_scanner'"):
            measure(robot, "laser_scaner")
        with pytest.raises(InvalidArgumentError, match="has no link 'nose'"):
            measure(robot, "odometry", "nose")


class Reading(NamedTuple):
    link: str


def test_a_sensor_of_a_program_is_offered_to_clients_if_it_only_reads() -> None:
    sensor = Sensor("the name of the link", lambda robot, link: Reading(link))
    with robot_in() as robot, added(Group.SENSORS, "nameplate", sensor):
        assert measure(robot, "nameplate") == Reading(robot.model.base.link)
        with from_outside():
            assert "nameplate" not in sensor_names()
            with pytest.raises(InvalidArgumentError, match="there is no sensor 'nameplate'"):
                measure(robot, "nameplate")
            with added(Group.SENSORS, "nameplate", sensor, access=Access.READ):
                assert measure(robot, "nameplate") == Reading(robot.model.base.link)


def test_the_failure_of_a_sensor_names_it_and_its_package() -> None:
    def fail(robot: Robot, link: str) -> object:
        raise ZeroDivisionError("no light")

    with (
        robot_in() as robot,
        added(Group.SENSORS, "eye", Sensor("light", fail)),
        pytest.raises(ExtensionError, match=r"eye, an entry point mindstage.sensors of this program.*no light"),
    ):
        measure(robot, "eye")
