"""Openings in a plate: what is left of it, and what is not worth leaving."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mindstage.geometry.procedural.builder import Hole, grid_cells, merge_narrow_strips

LOW, HIGH = np.array([0.0, 0.0]), np.array([4.0, 3.0])
LEAST_M = 0.05


def hole(x0: float, y0: float, x1: float, y1: float) -> Hole:
    return np.array([x0, y0]), np.array([x1, y1])


@st.composite
def holes(draw: st.DrawFn) -> list[Hole]:
    found = []
    for _ in range(draw(st.integers(1, 6))):
        (x0, x1), (y0, y1) = (sorted(draw(st.tuples(*[st.floats(0, end)] * 2))) for end in (4.0, 3.0))
        found.append(hole(x0, y0, x1 + 0.01, y1 + 0.01))
    return found


def left(openings: list[Hole]) -> float:
    """The area that is left of the plate."""
    cuts, kept = grid_cells(LOW, HIGH, openings)
    return float((np.outer(*(np.diff(cut) for cut in cuts)) * kept).sum())


@given(holes())
def test_merged_holes_cover_the_original_holes(openings: list[Hole]) -> None:
    fewer = merge_narrow_strips(LOW, HIGH, openings, LEAST_M)
    assert len(fewer) <= len(openings)
    for low, high in openings:
        assert left([*fewer, (low, high)]) <= left(fewer) + 1e-6
        inside = [np.all(low >= start - 1e-9) and np.all(np.minimum(high, HIGH) <= end + 1e-9) for start, end in fewer]
        assert any(inside)


def test_a_single_hole_keeps_its_size() -> None:
    window = hole(1.0, 1.0, 2.0, 2.2)
    ((low, high),) = merge_narrow_strips(LOW, HIGH, [window], LEAST_M)
    assert low.tolist() == [1.0, 1.0]
    assert high.tolist() == [2.0, 2.2]


def test_adjacent_holes_leave_no_strips_between_them() -> None:
    row = [hole(0.5, 0.1, 1.1, 0.9), hole(1.11, 0.1, 1.7, 0.88), hole(1.7, 0.12, 2.3, 0.9)]
    ((low, high),) = merge_narrow_strips(LOW, HIGH, row, LEAST_M)
    assert low.tolist() == [0.5, 0.1]
    assert high.tolist() == [2.3, 0.9]


def test_distant_holes_stay_separate() -> None:
    pair = [hole(0.5, 0.1, 1.0, 0.9), hole(1.5, 0.1, 2.0, 2.0)]
    assert len(merge_narrow_strips(LOW, HIGH, pair, LEAST_M)) == 2


def test_a_narrow_strip_at_the_edge_of_the_plate_is_removed() -> None:
    ((low, high),) = merge_narrow_strips(LOW, HIGH, [hole(0.02, 0.03, 1.0, 2.98)], LEAST_M)
    assert low.tolist() == [0.0, 0.0]
    assert high.tolist() == [1.0, 3.0]
