"""Reach and displacement of joints."""

from __future__ import annotations

import pytest
from tests.cases import each_case
from tests.engines.scenes import body, fixed_joint, prismatic_joint, revolute_joint

from mindstage.scene import AngularLimits, AxisMotion, Body, Joint, LinearLimits, Mobility, Tag
from mindstage.scene.joint_kinematics import joint_displacement, joint_reach, moving_body

DRAWER = prismatic_joint("slide", "cabinet", "drawer", (0, 0, 0), limit=0.4)
DOOR = revolute_joint("hinge", "case", "door", (0, 0, 0), limit=1.5)
ASYMMETRIC = Joint(
    **{name: getattr(DRAWER, name) for name in ("id", "iri", "parent", "child", "pose")},
    linear=LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=0.2),
    angular=AngularLimits(swing1=AxisMotion.FREE),
)
"""A joint that slides by 0 to 0.4 m and rotates without a limit."""


def test_joint_reach_is_returned_for_each_axis() -> None:
    assert joint_reach(DRAWER) == (0.4, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert joint_reach(DOOR) == (0.0, 0.0, 0.0, 0.0, 0.0, 1.5)
    assert joint_reach(ASYMMETRIC) == (0.4, 0.0, 0.0, 0.0, 0.0, None)
    assert joint_reach(fixed_joint("weld", "a", "b", (0, 0, 0))) == (0.0,) * 6


@each_case(
    ("joint", "positions", "expected"),
    [
        (DRAWER, (0.1, 0, 0, 0, 0, 0), (0.1, True, 0.25)),
        (DRAWER, (-0.1, 0, 0, 0, 0, 0), (0.1, True, 0.25)),
        (DRAWER, (0.41, 0, 0, 0, 0, 0), (0.41, True, 1.0)),
        (DOOR, (0, 0, 0, 0, 0, -0.75), (0.75, False, 0.5)),
        (ASYMMETRIC, (0.3, 0, 0, 0, 0, 0.1), (0.3, True, 0.75)),
        (ASYMMETRIC, (0.01, 0, 0, 0, 0, 2.0), (2.0, False, None)),
    ],
)
def test_displacement_is_that_of_the_farthest_axis(
    joint: Joint, positions: tuple[float, ...], expected: tuple[float, bool, float | None]
) -> None:
    assert joint_displacement(joint, positions) == pytest.approx(expected)


def test_a_locked_joint_has_no_displacement() -> None:
    assert joint_displacement(fixed_joint("weld", "a", "b", (0, 0, 0)), (0.0,) * 6) is None


def link(name: str, edge_m: float, mobility: Mobility, *, of_robot: bool) -> Body:
    tags = (Tag(type="robot", key="name", value="arm"),) if of_robot else ()
    return body(name, (0, 0, 0), (edge_m,) * 3, mobility, tags=tags)


@each_case(
    ("parent", "child", "of_robot", "moving"),
    [
        ((0.1, Mobility.DYNAMIC), (0.3, Mobility.DYNAMIC), True, "child"),  # the forearm is larger than the elbow
        ((0.3, Mobility.DYNAMIC), (0.1, Mobility.DYNAMIC), True, "child"),
        ((0.0, Mobility.STATIC), (0.3, Mobility.DYNAMIC), True, "child"),  # the base relative to the floor
        ((0.1, Mobility.DYNAMIC), (0.3, Mobility.DYNAMIC), False, "parent"),  # a map that swaps door and cabinet
        ((0.3, Mobility.DYNAMIC), (0.1, Mobility.DYNAMIC), False, "child"),
        ((0.1, Mobility.STATIC), (0.3, Mobility.DYNAMIC), False, "child"),
        ((0.3, Mobility.DYNAMIC), (0.1, Mobility.STATIC), False, "parent"),
    ],
)
def test_the_moving_body_of_a_robot_is_the_child_and_that_of_furniture_the_smaller_one(
    parent: tuple[float, Mobility], child: tuple[float, Mobility], of_robot: bool, moving: str
) -> None:
    bodies = {name: link(name, *each, of_robot=of_robot) for name, each in (("parent", parent), ("child", child))}
    joint = revolute_joint("hinge", "parent", "child", (0, 0, 0), limit=1.0)
    found, holder = moving_body(joint, bodies["parent"], bodies["child"])
    assert (found.id, holder.id) == (moving, "parent" if moving == "child" else "child")
