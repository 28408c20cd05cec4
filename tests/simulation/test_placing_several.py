"""Several things are placed where all of them fit: truth is a rectangle that was cut into the things."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from mindstage.errors import InvalidArgumentError, NoFreePlacementError
from mindstage.imagination import Outcome, Place, Plan, Wait, evaluate_plan
from mindstage.scene import Body, BodyId
from mindstage.simulation import Simulation
from tests.engines.scenes import body
from tests.imagination.scenes import simulate

TRAY_M = 0.5
"""Height of the tray."""


def world(width: float, depth: float, *sizes: tuple[float, float], extra: tuple[Body, ...] = ()) -> Simulation:
    """A tray of a size, and boxes of some sizes that lie beside it on the floor."""
    floor = body("floor", (0.0, 0.0, -0.05), (8.0, 8.0, 0.1))
    tray = body("tray", (0.0, 0.0, TRAY_M / 2), (width, depth, TRAY_M))
    boxes = [
        body(f"box{number}", (2.0, 0.6 * number - 1.0, 0.05), (x, y, 0.1), "dynamic", 0.3)
        for number, (x, y) in enumerate(sizes)
    ]
    return simulate(floor, tray, *boxes, *extra)


def check_apart(sim: Simulation, width: float, depth: float, count: int) -> None:
    """Checks that the boxes are upright on the tray, and that no two of them overlap, by their corners."""
    spans = []
    for number in range(count):
        found = sim.snapshot().body(f"box{number}")
        w, _, _, z = found.pose.quaternion
        assert abs(abs(w) - 1.0) < 1e-3 or abs(abs(z) - abs(w)) < 1e-2, "turned by quarters only"
        x, y = found.size[:2] if abs(abs(w) - 1.0) < 1e-3 else found.size[1::-1]  # type: ignore[index]
        middle, half = np.array(found.pose.position[:2]), np.array([x, y]) / 2
        assert np.all(np.abs(middle) + half <= np.array([width, depth]) / 2 + 1e-3)
        assert found.pose.position[2] == pytest.approx(TRAY_M + 0.05, abs=2e-3)
        spans.append((middle - half, middle + half))
    for (low, high), (other_low, other_high) in combinations(spans, 2):
        assert np.any(low >= other_high - 1e-3) or np.any(high <= other_low + 1e-3)


@pytest.mark.parametrize(
    ("width", "depth", "sizes"),
    [
        (0.43, 0.2, ((0.2, 0.15), (0.2, 0.15))),  # the first one in the middle leaves no room
        (0.405, 0.2, ((0.2, 0.15), (0.2, 0.15))),  # 5 mm to spare
        (0.42, 0.2, ((0.1, 0.15), (0.3, 0.15))),
        (0.32, 0.22, ((0.1, 0.3), (0.3, 0.1))),  # one has to be turned
        (0.62, 0.42, ((0.3, 0.2), (0.3, 0.2), (0.2, 0.2), (0.2, 0.2), (0.2, 0.2))),
        (0.42, 0.42, ((0.2, 0.1), (0.1, 0.3), (0.3, 0.1), (0.1, 0.2))),
    ],
)
def test_things_that_fit_off_center_only_are_placed_together(
    width: float, depth: float, sizes: tuple[tuple[float, float], ...]
) -> None:
    ids = [f"box{number}" for number in range(len(sizes))]
    with world(width, depth, *sizes) as sim:
        placed = sim.place(ids, on="tray")
        assert [each.id for each in placed] == ids
        assert {each.support_id for each in placed} == {"tray"}
        sim.step(1.0)
        check_apart(sim, width, depth, len(sizes))
    with world(width, depth, *sizes) as sim:
        steps = (*(Place(thing=id, on="tray") for id in ids), Wait(duration_s=1.0))
        one_by_one = evaluate_plan(sim, Plan(steps=steps))
        assert one_by_one.outcome is Outcome.SUCCEEDED, "each step leaves room for the next ones"
        assert evaluate_plan(sim, Plan(steps=(Place(thing=tuple(ids), on="tray"), Wait(duration_s=1.0))))


def cut(rng: np.random.Generator, width: float, depth: float, count: int) -> list[tuple[float, float]]:
    """A rectangle that is cut into a number of rectangles, one straight cut after the other."""
    pieces = [(width, depth)]
    while len(pieces) < count:
        pieces.sort(key=lambda each: -each[0] * each[1])
        x, y = pieces.pop(0)
        share = float(rng.uniform(0.35, 0.65))
        pieces += [(x * share, y), (x * (1 - share), y)] if x > y else [(x, y * share), (x, y * (1 - share))]
    return pieces


def test_pieces_of_a_rectangle_fit_on_it_again() -> None:
    """With 12 mm of room for each piece; the searching order is not that of the cuts."""
    found = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        pieces = [(x - 0.012, y - 0.012) for x, y in cut(rng, 0.6, 0.4, 3 + seed % 2)]
        rng.shuffle(pieces)
        with world(0.6, 0.4, *pieces) as sim:
            sim.place([f"box{number}" for number in range(len(pieces))], on="tray")
            check_apart(sim, 0.6, 0.4, len(pieces))
            found += 1
    assert found == 12


def test_what_does_not_fit_together_is_refused_and_nothing_moves() -> None:
    with world(0.395, 0.2, (0.2, 0.15), (0.2, 0.15)) as sim:
        before = sim.state.poses.copy()
        with pytest.raises(NoFreePlacementError, match=r"box0, box1 cannot be placed on tray: no arrangement"):
            sim.place(["box0", "box1"], on="tray")
        assert np.array_equal(sim.state.poses, before)
        verdict = evaluate_plan(sim, Plan(steps=(Place(thing=("box0", "box1"), on="tray"),)))
        assert verdict.outcome is Outcome.FAILED
        assert "no arrangement" in str(verdict)


def test_other_things_on_the_tray_are_left_where_they_are() -> None:
    cup = body("cup", (0.0, 0.0, TRAY_M + 0.05), (0.1, 0.2, 0.1), "dynamic", 0.3)
    with world(0.6, 0.2, (0.2, 0.15), (0.2, 0.15), extra=(cup,)) as sim:
        sim.step(0.5)
        sim.place(["box0", "box1"], on="tray")
        assert sim.snapshot().body("cup").pose.position[0] == pytest.approx(0.0, abs=1e-3)
        check_apart(sim, 0.6, 0.2, 2)


def test_what_makes_no_sense_is_refused() -> None:
    with world(0.6, 0.4, (0.1, 0.1)) as sim:
        with pytest.raises(InvalidArgumentError, match="given twice"):
            sim.place(["box0", "box0"], on="tray")
        with pytest.raises(NoFreePlacementError, match="on itself"):
            sim.place(["box0", "tray"], on="tray")
        with pytest.raises(InvalidArgumentError, match="near a point"):
            sim.place(["box0"], on="tray", near=(0.0, 0.0, 0.0))  # type: ignore[call-overload]
        assert sim.place(["box0"], on="tray")[0].id == BodyId("box0")
