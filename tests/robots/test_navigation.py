"""Ways of the base: free ones are found and driven without a contact, others name what is in the way."""

from __future__ import annotations

from math import hypot, pi

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.errors import InvalidArgumentError, UnreachableError
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import BaseType, RobotModel
from mindstage.robots.navigation import FloorMap, plan_base
from mindstage.robots.robot import Robot
from mindstage.robots.standing import add_standing_robot
from mindstage.scene import Body, BodyId, Mobility
from tests.robots.rooms import box, contacts_with, reaching, robot_in


def divided_room(gap: float = 0.8) -> tuple[Body, Body]:
    """A wall along x = 1 with a gap at y = 2."""
    low, high = 2.0 - gap / 2, 2.0 + gap / 2
    return (
        box("wall_right", (1.0, (low - 3.0) / 2, 1.0), (0.1, low + 3.0, 2.0)),
        box("wall_left", (1.0, (high + 3.0) / 2, 1.0), (0.1, 3.0 - high, 2.0)),
    )


def with_base(type: BaseType) -> RobotModel:
    model = load_model("mobile_manipulator")
    return replace(model, base=replace(model.base, type=type))


def drive(robot: Robot, goal: tuple[float, float, float], obstacles: set[str]) -> list[str]:
    """Drives to a goal; returns the contacts on the way."""
    contacts = []
    motion = robot.start_driving(plan_base(robot, goal))
    while motion.result is None:
        robot.session.step(0.02)
        contacts += [f"{each.a} and {each.b}" for each in contacts_with(robot, obstacles)]
    assert motion.result, motion.result
    x, y, yaw = robot.base_pose()
    assert hypot(x - goal[0], y - goal[1]) < 0.02
    assert abs((yaw - goal[2] + pi) % (2 * pi) - pi) < 0.03
    return contacts


@pytest.mark.parametrize("type", [BaseType.PLANAR, BaseType.DIFFERENTIAL])
def test_the_base_drives_through_a_gap_without_a_contact(type: BaseType) -> None:
    with robot_in(*divided_room(), robot=with_base(type)) as robot:
        assert drive(robot, (2.0, 0.0, pi / 2), {"wall_left", "wall_right"}) == []


def test_a_free_way_is_straight() -> None:
    with robot_in(box("block", (0.0, 2.0, 0.5), (0.5, 0.5, 1.0))) as robot:
        assert plan_base(robot, (2.0, 0.5, 1.0)) == ((2.0, 0.5, 1.0),)
        assert plan_base(robot, (2.0, 0.5, 1.0), max_tests=0) == ((2.0, 0.5, 1.0),)  # nothing has to be searched


def test_a_robot_is_added_where_its_whole_body_has_room_not_only_its_base() -> None:
    corridor = (box("left", (0.0, 0.75, 1.0), (3.0, 0.7, 2.0)), box("right", (0.0, -0.75, 1.0), (3.0, 0.7, 2.0)))
    with robot_in(*corridor, floor=(8.0, 2.2), at=(-3.5, 0.0, 0.0)) as first:  # the corridor is 0.8 m wide
        robot = add_standing_robot(first.session, "mobile_manipulator", near=(0.0, 0.0))
        robot.session.step(0.1)
        assert abs(robot.base_pose()[0]) > 1.5  # its base, with a radius of 0.28 m, would fit between the blocks
        assert contacts_with(robot, {"left", "right"}) == []


def test_a_robot_turns_by_less_than_half_a_turn() -> None:
    with robot_in() as robot:
        (_, _, yaw), *_ = plan_base(robot, (1.0, 0.0, 3.0 + 4 * pi))
        assert yaw == pytest.approx(3.0)


def test_the_way_is_rounded_and_not_much_longer_than_the_shortest() -> None:
    with robot_in(*divided_room()) as robot:
        path = np.array([robot.base_pose(), *plan_base(robot, (2.0, 0.0, 0.0))])
        length = float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())
        shortest = 2 * hypot(1.0, 1.6 + 0.29)  # to the end of the wall, at the distance of the radius
        assert 0.92 * shortest < length < 1.12 * shortest
        assert len(path) > 5


def test_what_blocks_the_way_is_named() -> None:
    chair = box("chair", (1.0, 2.0, 0.4), (0.4, 0.7, 0.8), Mobility.DYNAMIC, 5.0)
    with robot_in(*divided_room(), chair) as robot:
        with pytest.raises(UnreachableError, match=r"chair in the way of its base") as caught:
            plan_base(robot, (2.0, 0.0, 0.0), max_tests=1500)
        assert caught.value.obstacle == "chair"
        floor = FloorMap(robot)
        assert floor.blockers(2.0, 0.0) == ("chair",)
        assert not floor.is_reachable(2.0, 0.0)
        assert FloorMap(robot, ignore={BodyId("chair")}).is_reachable(2.0, 0.0)


def test_a_goal_without_room_names_the_obstacle() -> None:
    with robot_in(box("block", (2.0, 0.0, 0.5), (0.5, 0.5, 1.0))) as robot:
        with pytest.raises(UnreachableError, match=r"mm inside block") as caught:
            plan_base(robot, (2.0, 0.2, 0.0))
        assert caught.value.obstacle == "block"


def test_a_goal_beyond_the_floor_is_refused() -> None:
    with robot_in() as robot, pytest.raises(UnreachableError, match=r"\(9\.00, 0\.00, 0\.00\): there is no floor"):
        plan_base(robot, (9.0, 0.0, 0.0), max_tests=1500)


def test_an_arm_that_sticks_out_needs_another_way() -> None:
    """The outstretched arm does not fit through the gap along the way of the disc, but turned forward it does."""
    with robot_in(*divided_room(0.75)) as robot:
        assert robot.run(robot.moving_to(reaching(robot, 0.7, 0.0, 0.9)))
        walls = {"wall_left", "wall_right"}
        assert robot.run(robot.driving([(0.0, 2.0, pi / 2)]))
        assert drive(robot, (2.0, 2.0, pi / 2), walls) == []


def test_lengths_of_ways_are_those_of_the_grid() -> None:
    with robot_in(*divided_room()) as robot:
        floor = FloorMap(robot)
        assert floor.length_to(0.0, 0.0) == pytest.approx(0.0, abs=0.1)
        assert floor.length_to(0.0, 1.0) == pytest.approx(1.0, abs=0.1)
        length = floor.length_to(2.0, 0.0)
        assert length is not None
        assert 2 * hypot(1.0, 1.89) < length < 1.15 * 2 * hypot(1.0, 1.89)  # a grid with eight neighbors
        assert floor.length_to(1.0, 0.0) is None


def test_ways_begin_where_the_disc_around_the_base_has_no_room() -> None:
    walls = [box(f"wall_{side}", (-1.325, 0.45 * side, 1.0), (3.35, 0.1, 2.0)) for side in (-1, 1)]
    model = load_model("mobile_manipulator")
    wide = replace(model, base=replace(model.base, radius_m=0.6))
    with robot_in(*walls, robot=wide) as robot:
        floor = FloorMap(robot)
        assert floor.plan.nearest_cell(np.zeros(2), free=True) is None
        assert floor.length_to(2.0, 0.0) is not None
        assert floor.length_to(-2.5, 0.0) is None
        assert drive(robot, (2.0, 0.0, 1.0), {"wall_-1", "wall_1"}) == []


def test_a_table_is_an_obstacle_for_the_body_above_the_base() -> None:
    table = box("table", (1.0, 0.0, 0.75), (0.6, 5.0, 0.05))
    with robot_in(table, floor=(6.0, 4.0)) as robot:
        with pytest.raises(UnreachableError) as caught:
            plan_base(robot, (2.0, 0.0, 0.0), max_tests=1500)
        assert caught.value.obstacle == "table"


def test_a_fixed_base_cannot_drive() -> None:
    with robot_in(robot=with_base(BaseType.FIXED)) as robot, pytest.raises(InvalidArgumentError, match="fixed"):
        plan_base(robot, (1.0, 0.0, 0.0))


def test_the_robot_itself_is_no_obstacle() -> None:
    with robot_in(box("block", (2.0, 2.0, 0.5), (0.5, 0.5, 1.0))) as robot:
        floor = FloorMap(robot)
        assert floor.is_reachable(*robot.base_pose()[:2])
        assert floor.radius_m == robot.model.base.radius_m
        assert 1.2 < floor.height_m < 2.0


def test_a_way_out_of_a_narrow_place_keeps_less_distance() -> None:
    def niche(exit_m: float) -> list[Body]:
        """Walls 12 mm beside the base, which has a radius of 0.28 m, that are nearer to it at the exit."""
        walls = [("beside", 0.0, 0.012), ("exit", 0.6, exit_m)]
        return [
            box("wall_back", (-0.4, 0.0, 0.5), (0.1, 1.0, 1.0)),
            *(
                box(f"wall_{name}_{side}", (x, side * (0.28 + gap + 0.05), 0.5), (0.6, 0.1, 1.0))
                for name, x, gap in walls
                for side in (-1, 1)
            ),
        ]

    with robot_in(*niche(0.006)) as robot:
        assert not FloorMap(robot).is_reachable(0.0, 0.0), "the disc has no room"
        assert drive(robot, (2.0, 0.0, 0.0), {"wall_exit_-1", "wall_exit_1"}) == []
    with robot_in(*niche(0.001)) as robot, pytest.raises(UnreachableError, match="wall_"):
        plan_base(robot, (2.0, 0.0, 0.0))
