"""How far constraints let things go."""

from __future__ import annotations

import pytest
from tests.engines.scenes import hinge, slide, weld

from mindstage.world import AngularMotion, Constraint, LinearMotion, Motion
from mindstage.world.travel import reaches, travel

DRAWER = slide("slide", "cabinet", "drawer", (0, 0, 0), limit=0.4)
DOOR = hinge("hinge", "case", "door", (0, 0, 0), limit=1.5)
ASTRIDE = Constraint(
    **{name: getattr(DRAWER, name) for name in ("id", "iri", "parent", "child", "pose")},
    linear=LinearMotion(x=Motion.LIMITED, limit=0.2, x_middle=0.2),
    angular=AngularMotion(swing1=Motion.FREE),
)
"""It slides out by 0.4 m, not in, and turns without an end."""


def test_reaches_are_told_for_each_axis() -> None:
    assert reaches(DRAWER) == (0.4, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert reaches(DOOR) == (0.0, 0.0, 0.0, 0.0, 0.0, 1.5)
    assert reaches(ASTRIDE) == (0.4, 0.0, 0.0, 0.0, 0.0, None)
    assert reaches(weld("weld", "a", "b", (0, 0, 0))) == (0.0,) * 6


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
def test_the_way_that_was_gone_farthest_counts(
    joint: Constraint, positions: tuple[float, ...], expected: tuple[float, bool, float | None]
) -> None:
    assert travel(joint, positions) == pytest.approx(expected)


def test_what_is_locked_goes_nowhere() -> None:
    assert travel(weld("weld", "a", "b", (0, 0, 0)), (0.0,) * 6) is None
