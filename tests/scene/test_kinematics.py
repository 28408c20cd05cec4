"""How far constraints let things go."""

from __future__ import annotations

import pytest
from tests.engines.scenes import fixed_joint, prismatic_joint, revolute_joint

from mindstage.scene import AngularLimits, AxisMotion, Joint, LinearLimits
from mindstage.scene.kinematics import joint_displacement, joint_reach

DRAWER = prismatic_joint("slide", "cabinet", "drawer", (0, 0, 0), limit=0.4)
DOOR = revolute_joint("hinge", "case", "door", (0, 0, 0), limit=1.5)
ASTRIDE = Joint(
    **{name: getattr(DRAWER, name) for name in ("id", "iri", "parent", "child", "pose")},
    linear=LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=0.2),
    angular=AngularLimits(swing1=AxisMotion.FREE),
)
"""It slides out by 0.4 m, not in, and turns without an end."""


def test_joint_reach_is_returned_for_each_axis() -> None:
    assert joint_reach(DRAWER) == (0.4, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert joint_reach(DOOR) == (0.0, 0.0, 0.0, 0.0, 0.0, 1.5)
    assert joint_reach(ASTRIDE) == (0.4, 0.0, 0.0, 0.0, 0.0, None)
    assert joint_reach(fixed_joint("weld", "a", "b", (0, 0, 0))) == (0.0,) * 6


@pytest.mark.parametrize(
    ("joint", "positions", "expected"),
    [
        (DRAWER, (0.1, 0, 0, 0, 0, 0), (0.1, True, 0.25)),
        (DRAWER, (-0.1, 0, 0, 0, 0, 0), (0.1, True, 0.25)),
        (DRAWER, (0.41, 0, 0, 0, 0, 0), (0.41, True, 1.0)),
        (DOOR, (0, 0, 0, 0, 0, -0.75), (0.75, False, 0.5)),
        (ASTRIDE, (0.3, 0, 0, 0, 0, 0.1), (0.3, True, 0.75)),
        (ASTRIDE, (0.01, 0, 0, 0, 0, 2.0), (2.0, False, None)),
    ],
)
def test_displacement_is_that_of_the_farthest_axis(
    joint: Joint, positions: tuple[float, ...], expected: tuple[float, bool, float | None]
) -> None:
    assert joint_displacement(joint, positions) == pytest.approx(expected)


def test_a_locked_joint_has_no_displacement() -> None:
    assert joint_displacement(fixed_joint("weld", "a", "b", (0, 0, 0)), (0.0,) * 6) is None
