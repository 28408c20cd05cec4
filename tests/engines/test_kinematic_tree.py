"""Joint coordinates and poses are converted without loss."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.engines.kinematic_tree import JointAxis, joint_coordinates, pose_from_joint_coordinates
from mindstage.scene import SoftLimit

SIX = tuple(JointAxis(index, None, SoftLimit()) for index in (0, 1, 2, 5, 4, 3))
lengths, wide, narrow = st.floats(-3, 3), st.floats(-3.1, 3.1), st.floats(-1.5, 1.5)


@given(st.tuples(lengths, lengths, lengths, wide, narrow, wide))
def test_coordinates_of_six_axes_are_recovered_from_the_pose(place: tuple[float, ...]) -> None:
    np.testing.assert_allclose(joint_coordinates(pose_from_joint_coordinates(place), SIX), place, atol=1e-6)


@pytest.mark.parametrize("index", [3, 4, 5])
@given(angle=wide)
def test_a_single_hinge_turns_fully(index: int, angle: float) -> None:
    place = np.zeros(6)
    place[index] = angle
    np.testing.assert_allclose(
        joint_coordinates(pose_from_joint_coordinates(place.tolist()), (JointAxis(index, None, SoftLimit()),)),
        place,
        atol=1e-9,
    )
