"""Penetration depths and mass properties of collision shapes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.cases import each_case
from tests.engines.geometries import bin_geometry, box_shape, wedge_geometry

from mindstage.scene import CollisionShape, CollisionShapeType, Pose
from mindstage.scene.bounding_boxes import OrientedBoxes, penetration_depths
from mindstage.scene.collision_shapes import CollisionShapeBatch, CompiledGeometry, compile_geometry
from mindstage.scene.transforms import normalize, pose_multiply, quat_rotate

HERE = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
numbers = st.floats(-0.6, 0.6)
sizes = st.tuples(*[st.floats(0.1, 1.0)] * 3)
poses = st.tuples(numbers, numbers, numbers, *[st.floats(0.1, 1)] * 4)
kinds = st.sampled_from(CollisionShapeType)


def make_shape(type: CollisionShapeType, size: tuple[float, float, float]) -> CollisionShape:
    """A shape of a size; a hull has the corners of that box."""
    corners = tuple(
        (i * size[0] / 2, j * size[1] / 2, k * size[2] / 2) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)
    )
    return CollisionShape(type=type, size=size, points=corners if type is CollisionShapeType.HULL else ())


def depth(one: CompiledGeometry, other: CompiledGeometry, relative_pose: tuple[float, ...]) -> float:
    poses = np.array([HERE, relative_pose])
    poses[:, 3:] = normalize(poses[:, 3:])
    return float(
        CollisionShapeBatch.from_compiled(poses, [one, other]).penetration_depths(
            np.array([0]), np.array([1]), np.array([9.0])
        )[0]
    )


def at(x: float, y: float = 0.0, z: float = 0.0) -> tuple[float, ...]:
    return (x, y, z, *HERE[3:])


@each_case(
    ("one", "other", "relative_pose", "expected"),
    [
        (CollisionShapeType.BOX, CollisionShapeType.BOX, at(0.9), 0.1),
        (CollisionShapeType.SPHERE, CollisionShapeType.SPHERE, at(0.6, 0.6), 1.0 - 0.72**0.5),
        (CollisionShapeType.CYLINDER, CollisionShapeType.CYLINDER, at(0.6, 0.6), 1.0 - 0.72**0.5),
        (CollisionShapeType.CYLINDER, CollisionShapeType.CYLINDER, at(0.0, 0.0, 0.95), 0.05),
        (CollisionShapeType.SPHERE, CollisionShapeType.BOX, at(0.0, 0.0, 0.98), 0.02),
        (CollisionShapeType.HULL, CollisionShapeType.HULL, at(0.95, 0.2), 0.05),
        (CollisionShapeType.HULL, CollisionShapeType.SPHERE, at(0.0, 0.97), 0.03),
    ],
)
def test_the_depth_is_that_of_the_actual_shapes(
    one: CollisionShapeType, other: CollisionShapeType, relative_pose: tuple[float, ...], expected: float
) -> None:
    pair = compile_geometry((make_shape(one, (1, 1, 1)),)), compile_geometry((make_shape(other, (1, 1, 1)),))
    assert depth(*pair, relative_pose) == pytest.approx(expected, abs=1e-9)


def test_round_shapes_in_the_corners_of_each_others_boxes_are_separate() -> None:
    for type in (CollisionShapeType.SPHERE, CollisionShapeType.CYLINDER):
        ball = compile_geometry((make_shape(type, (1, 1, 1)),))
        assert depth(ball, ball, at(0.8, 0.8)) < 0.0


@given(kinds, sizes, kinds, sizes, poses)
def test_shapes_with_a_common_point_are_never_separate(
    type: CollisionShapeType,
    size: tuple[float, float, float],
    other: CollisionShapeType,
    other_size: tuple[float, float, float],
    relative_pose: tuple[float, ...],
) -> None:
    pose = np.array(relative_pose)
    pose[3:] = normalize(pose[3:])
    random = np.random.default_rng(1)
    points = inside(type, size, random.uniform(-0.5, 0.5, (2000, 3)) * size)
    back = compose_points(pose, points)
    if len(inside(other, other_size, back)):
        assert (
            depth(
                compile_geometry((make_shape(type, size),)),
                compile_geometry((make_shape(other, other_size),)),
                relative_pose,
            )
            >= 0.0
        )


def inside(type: CollisionShapeType, size: tuple[float, float, float], points: np.ndarray) -> np.ndarray:
    """The points inside a shape at the origin; cylinders are as wide as their narrower side."""
    part = points / np.array(size) * 2
    within = np.abs(part).max(axis=1, initial=0.0) <= 1.0
    if type is CollisionShapeType.SPHERE:
        within = np.linalg.norm(part, axis=1) <= 1.0
    if type is CollisionShapeType.CYLINDER:
        within &= np.linalg.norm(part[:, :2], axis=1) <= 1.0
    return points[within]


def compose_points(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points of a frame in its parent frame, given its pose."""
    return quat_rotate(pose[3:] * (1, -1, -1, -1), points - pose[:3])


@given(sizes, sizes, poses)
def test_boxes_have_the_same_depth_as_in_the_box_test(
    size: tuple[float, float, float], other: tuple[float, float, float], relative_pose: tuple[float, ...]
) -> None:
    poses = np.array([HERE, relative_pose])
    poses[:, 3:] = normalize(poses[:, 3:])
    exact = penetration_depths(OrientedBoxes.from_poses(poses, np.array([size, other])), np.array([0]), np.array([1]))[
        0
    ]
    found = depth(
        compile_geometry((make_shape(CollisionShapeType.BOX, size),)),
        compile_geometry((make_shape(CollisionShapeType.BOX, other),)),
        relative_pose,
    )
    assert found == pytest.approx(exact) if found > -np.inf else exact <= 0.0


def test_a_body_in_a_bin_touches_its_floor_and_walls_only() -> None:
    crate, mug = (
        compile_geometry(bin_geometry((0.5, 0.5, 0.3)).collision_shapes),
        compile_geometry((make_shape(CollisionShapeType.BOX, (0.1, 0.1, 0.1)),)),
    )
    assert depth(crate, mug, at(0.0, 0.0, 0.0)) < 0.0
    assert depth(crate, mug, at(0.0, 0.0, -0.085)) == pytest.approx(0.005)
    assert depth(crate, mug, at(0.23, 0.0, 0.0)) == pytest.approx(0.05, abs=1e-9)


def test_pairs_with_too_many_shapes_use_the_fallback() -> None:
    comb = compile_geometry(tuple(box_shape((0.01 * i, 0, 0), (0.01 * i + 0.005, 1, 1)) for i in range(600)))
    assert depth(comb, comb, at(0.0, 0.0, 5.0)) == 9.0


def test_the_center_of_mass_of_a_compound_is_that_of_its_parts() -> None:
    two = compile_geometry(
        (
            make_shape(CollisionShapeType.BOX, (1, 1, 1)),
            CollisionShape(size=(1, 1, 1), pose=Pose((4.0, 0, 0))),
        )
    )
    assert two.volume == pytest.approx(2.0)
    np.testing.assert_allclose(two.center_of_mass, (2, 0, 0), atol=1e-12)
    np.testing.assert_allclose(np.diag(two.inertia), (1 / 6, 1 / 6 + 4, 1 / 6 + 4), atol=1e-12)


@pytest.mark.parametrize("turn", [(1.0, 0, 0, 0), (0.6, 0.8, 0, 0), (0.5, 0.5, 0.5, 0.5)])
def test_a_rotated_shape_has_rotated_moments(turn: tuple[float, float, float, float]) -> None:
    size = (0.2, 0.3, 0.5)
    directions = {}
    for type in (CollisionShapeType.BOX, CollisionShapeType.HULL):
        directions[type] = compile_geometry(
            (CollisionShape(type=type, size=size, pose=Pose((1, 2, 3), turn), points=make_shape(type, size).points),)
        )
    box, hull = directions.values()
    np.testing.assert_allclose(box.center_of_mass, (1, 2, 3))
    np.testing.assert_allclose(hull.center_of_mass, box.center_of_mass, atol=1e-9)
    np.testing.assert_allclose(hull.inertia, box.inertia, atol=1e-9)
    assert np.linalg.eigvalsh(box.inertia)[0] == pytest.approx((0.2**2 + 0.3**2) / 12)


def test_thin_shapes_are_enlarged_and_flat_hulls_become_boxes() -> None:
    flat = CollisionShape(
        type=CollisionShapeType.HULL, size=(1, 1, 0), points=((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0))
    )
    made = compile_geometry((flat, CollisionShape(size=(1, 0.0, 1))))
    assert [shape.type for shape in made.shapes] == [CollisionShapeType.BOX, CollisionShapeType.BOX]
    assert made.sizes.min() == pytest.approx(0.001)
    np.testing.assert_allclose(made.poses[0, :3], (0.5, 0.5, 0.0))


def test_a_hull_away_from_its_origin_keeps_its_points() -> None:
    wedge = wedge_geometry((0.6, 0.4, 0.3)).collision_shapes[0]
    shifted = tuple((x + 5, y, z) for x, y, z in wedge.points)
    made = compile_geometry(
        (CollisionShape(type=CollisionShapeType.HULL, size=wedge.size, points=shifted, pose=Pose((-5, 0, 0))),)
    )
    np.testing.assert_allclose(made.poses[0], pose_multiply(HERE, HERE), atol=1e-12)
    np.testing.assert_allclose(made.center_of_mass, (0.1, 0, -0.05), atol=1e-9)


@pytest.mark.parametrize(
    "broken",
    [
        CollisionShape(size=(float("inf"), 1, 1)),
        CollisionShape(size=(-1.0, 1, 1)),
        CollisionShape(size=(1, 1, 1), pose=Pose((0, 0, 0), (0.0, 0, 0, 0))),
        CollisionShape(type=CollisionShapeType.HULL, size=(1, 1, 1), points=((0, 0, float("nan")),)),
    ],
)
def test_invalid_shapes_are_left_out_and_counted(broken: CollisionShape) -> None:
    made = compile_geometry((broken, make_shape(CollisionShapeType.BOX, (1, 1, 1))))
    assert (len(made.shapes), made.invalid_count) == (1, 1)
