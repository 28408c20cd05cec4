"""Joint coordinates and poses are converted without loss; rigid groups have the mass of all of their bodies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.engines.entity_registry import EntityRegistry
from mindstage.engines.kinematic_tree import (
    JointAxis,
    build_kinematic_forest,
    joint_coordinates,
    pose_from_joint_coordinates,
)
from mindstage.scene import BodyId, SoftLimit
from tests.engines.scenes import attachment, body, revolute_joint, world

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


def masses(registry: EntityRegistry) -> dict[BodyId, float]:
    return {body.id: body.physics.mass_kg or 0.0 for body in registry.bodies.values()}


def test_the_mass_of_a_rigid_group_is_the_sum_of_its_bodies() -> None:
    registry = EntityRegistry()
    registry.add(
        world(
            body("tray", (0, 0, 1), (1, 1, 0.1), "dynamic", 2.0),
            body("jug", (0, 0, 1.1), (0.1, 0.1, 0.1), "dynamic", 1.5),
            body("lid", (0, 0, 1.2), (0.1, 0.1, 0.02), "dynamic", 0.25),
            attachment("tray", "jug"),
            attachment("jug", "lid"),
        )
    )
    forest = build_kinematic_forest(registry, masses(registry))
    assert {root: group.mass_kg for root, group in forest.groups.items()} == {"tray": 3.75}


def test_the_heavier_of_two_joined_groups_carries_the_lighter_one() -> None:
    """The group is heavier, its root alone is not."""
    registry = EntityRegistry()
    registry.add(
        world(
            body("plank", (0, 0, 1), (1, 1, 0.1), "dynamic", 2.0),
            body("arm", (1, 0, 1), (1, 0.1, 0.1), "dynamic", 1.0),
            body("weight", (1, 0, 1.2), (0.1, 0.1, 0.1), "dynamic", 5.0),
            attachment("arm", "weight"),
            revolute_joint("hinge", "plank", "arm", (0.5, 0, 1)),
        )
    )
    forest = build_kinematic_forest(registry, masses(registry))
    assert list(forest.groups) == ["arm", "plank"]
    assert set(forest.tree_joints) == {"plank"}
