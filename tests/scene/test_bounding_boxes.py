"""Oriented bounding boxes: face coverage and overlapping pairs."""

from __future__ import annotations

import numpy as np
import pytest
from tests.cases import each_case

from mindstage.scene.bounding_boxes import OrientedBoxes, face_coverage, overlapping_pairs

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def boxes_of(*rows: tuple[float, ...]) -> OrientedBoxes:
    """Returns boxes of rows x y z, three extents."""
    table = np.array(rows, dtype=float)
    poses = np.concatenate([table[:, :3], np.tile(UPRIGHT, (len(table), 1))], axis=1)
    return OrientedBoxes.from_poses(poses, table[:, 3:])


@each_case(
    ("door", "fraction"),
    [
        ((0.32, 0, 1, 0.04, 0.6, 2.0), 1.0),
        ((0.32, 0, 0.5, 0.04, 0.6, 1.0), 0.5),
        ((0.32, 0.15, 0.5, 0.04, 0.3, 1.0), 0.25),
        ((0.3249, 0, 1, 0.04, 0.6, 2.0), 1.0),
        ((0.3251, 0, 1, 0.04, 0.6, 2.0), 0.0),
        ((0, 0, 2.02, 0.6, 0.6, 0.04), 1.0),
    ],
)
def test_face_coverage_is_the_fraction_of_the_face_that_a_door_covers(door: tuple[float, ...], fraction: float) -> None:
    assert face_coverage(boxes_of(door, (0, 0, 1, 0.6, 0.6, 2)), 0, np.array([1])) == pytest.approx([fraction])


def test_boxes_with_a_gap_within_the_margin_overlap() -> None:
    boxes, every = boxes_of((0, 0, 0, 1, 1, 1), (1.3, 0, 0, 1, 1, 1), (0, 0, 3.5, 1, 1, 1)), np.ones(3, dtype=bool)

    def pairs(**margin: tuple[float, float, float]) -> set[frozenset[int]]:
        return {
            frozenset(pair)
            for a, b in overlapping_pairs(boxes, every, every, **margin)
            for pair in zip(a, b, strict=True)
        }

    assert pairs() == set()
    assert pairs(margin=(0.31, 0.0, 0.0)) == {frozenset({0, 1})}
    assert pairs(margin=(0.0, 0.0, 2.51)) == {frozenset({0, 2})}
    assert pairs(margin=(0.31, 0.0, 2.51)) == {frozenset({0, 1}), frozenset({0, 2}), frozenset({1, 2})}
