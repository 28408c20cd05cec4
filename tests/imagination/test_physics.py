"""Verdicts agree with mechanics: boxes that overhang an edge, and boxes on a slope that tip or slide."""

from __future__ import annotations

from math import atan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.imagination import EventKind, Move, Outcome, Plan, Uncertainty, Wait, evaluate_plan
from mindstage.scene import Pose
from tests.engines.scenes import body
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table, slope


@pytest.mark.parametrize(("depth_m", "height_m"), [(0.2, 0.1), (0.3, 0.02), (0.12, 0.15)])
def test_a_box_falls_off_an_edge_with_a_probability_of_a_half_when_half_of_it_overhangs(
    depth_m: float, height_m: float
) -> None:
    """Positions deviate by 1 mm, so that the probability goes from nearly 0 to nearly 1 within 2 mm on both sides."""
    z = TABLE_HEIGHT_M + height_m / 2
    box = body("box", (-0.5, 0.0, z), (depth_m, 0.1, height_m), "dynamic", 1.0)
    with on_table(box) as simulation:
        falls = []
        for overhang_m in (-0.004, -0.002, 0.002):  # beyond half of the depth
            steps = (Move(thing="box", to=Pose((overhang_m, 0.0, z))), Wait(duration_s=2.0))
            plan = Plan(steps=steps, uncertainty=(Uncertainty(thing="box", position_m=(0.001, 0.0, 0.0)),))
            verdict = evaluate_plan(simulation, plan, samples=10, fixed=True)
            assert verdict.unknown == 0
            falls.append(verdict.failed / verdict.samples)
            for result in verdict.results:
                assert (result.cause is None) is (result.outcome is Outcome.SUCCEEDED)
                if result.cause is not None:
                    assert (result.cause.kind, result.cause.thing) in {
                        (EventKind.FELL, "box"),
                        (EventKind.TIPPED, "box"),
                    }
        assert falls[0] == 0.0
        assert falls[1] < 0.5
        assert falls[2] > 0.5


@given(base_m=st.floats(0.08, 0.25), slenderness=st.floats(0.8, 2.5))
@settings(max_examples=8, deadline=None)
def test_a_box_tips_over_at_the_angle_whose_tangent_is_its_base_by_its_height(
    base_m: float, slenderness: float
) -> None:
    """Contacts are soft, so a more slender box tips earlier: by 3 % if it is five times as high as wide."""
    height_m = base_m * slenderness
    critical_rad = atan(base_m / height_m)
    for factor, stands in ((0.98, True), (1.02, False)):
        with slope(critical_rad * factor, base_m=base_m, height_m=height_m, friction=5.0) as simulation:
            verdict = evaluate_plan(simulation, Plan(steps=(Wait(duration_s=3.0),)))
            assert bool(verdict) is stands, factor
            if not stands:
                assert verdict.first_failure is not None
                assert {event.kind for event in verdict.first_failure.events} & {EventKind.TIPPED, EventKind.FELL}


@given(friction=st.floats(0.2, 0.9), base_m=st.floats(0.2, 0.4))
@settings(max_examples=8, deadline=None)
def test_a_box_slides_at_the_angle_whose_tangent_is_the_friction(friction: float, base_m: float) -> None:
    for factor, slides in ((0.98, False), (1.02, True)):
        with slope(atan(friction) * factor, base_m=base_m, height_m=0.05, friction=friction) as simulation:
            before = simulation.state.poses[1, :3]
            verdict = evaluate_plan(simulation, Plan(steps=(Wait(duration_s=2.0),), forbid=()))
            poses = verdict.end_poses("box")
            moved_m = float(np.linalg.norm(poses[0, :3] - before)) if len(poses) else 0.0
            assert (moved_m > 0.05) is slides, (factor, moved_m)


def test_a_random_friction_decides_whether_a_box_slides() -> None:
    """At the angle of the nominal friction, about half of the samples have less."""
    with slope(atan(0.5), base_m=0.3, height_m=0.05, friction=0.5) as simulation:
        plan = Plan(
            steps=(Wait(duration_s=1.0),), uncertainty=(Uncertainty(thing="box", friction=0.2, mass=0.3),), forbid=()
        )
        verdict = evaluate_plan(simulation, plan, samples=60, fixed=True)
        slid = sum("box" in each.end_poses and each.end_poses["box"].position[0] > 0.05 for each in verdict.results)
        assert 15 < slid < 45
