"""Occluders of highlighted bodies."""

from __future__ import annotations

import numpy as np
import pytest

from mindstage.rendering.camera import find_occluders
from mindstage.scene import Pose
from mindstage.scene.transforms import pose_array
from tests.cases import each_case

EYE = np.array([0.0, 0.0, 1.0])
LIT = np.array([0])


@each_case(
    ("position", "size", "hides"),
    [
        pytest.param((2.0, 0.0, 1.0), (0.1, 1.0, 1.0), True, id="before it"),
        pytest.param((4.0, 0.0, 1.0), (1.0, 1.0, 1.0), True, id="round it"),
        pytest.param((6.0, 0.0, 1.0), (0.1, 3.0, 3.0), False, id="behind it"),
        pytest.param((-2.0, 0.0, 1.0), (0.1, 3.0, 3.0), False, id="behind the eye"),
        pytest.param((2.0, 1.5, 1.0), (0.1, 1.0, 1.0), False, id="beside it"),
        pytest.param((3.7, 0.0, 1.15), (0.1, 0.6, 0.05), True, id="before an edge of it alone"),
    ],
)
def test_bodies_in_front_of_or_around_a_body_occlude_it(
    position: tuple[float, float, float], size: tuple[float, float, float], hides: bool
) -> None:
    poses = pose_array([Pose((4.0, 0.0, 1.0)), Pose(position)])
    sizes = np.array([(0.4, 0.4, 0.4), size])
    assert find_occluders(EYE, poses, sizes, LIT).tolist() == ([1] if hides else [])


def test_the_rotation_of_occluders_matters() -> None:
    half = np.sqrt(0.5)
    board = np.array([(0.4, 0.4, 0.4), (0.02, 3.0, 3.0)])
    across = pose_array([Pose((4.0, 0.0, 1.0)), Pose((2.0, 0.5, 1.0))])
    along = pose_array([Pose((4.0, 0.0, 1.0)), Pose((2.0, 0.5, 1.0), (half, 0.0, 0.0, half))])
    assert find_occluders(EYE, across, board, LIT).tolist() == [1]
    assert find_occluders(EYE, along, board, LIT).tolist() == []


def test_highlighted_bodies_are_no_occluders() -> None:
    poses = pose_array([Pose((4.0, 0.0, 1.0)), Pose((2.0, 0.0, 1.0))])
    assert find_occluders(EYE, poses, np.full((2, 3), 0.4), np.array([0, 1])).tolist() == []
