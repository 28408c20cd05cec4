"""How far a world reaches, and what is tallest in it."""

from __future__ import annotations

import math

import pytest

from mindstage.scene import Body, BodyId, Iri, Pose, Vector, World
from mindstage.scene.bounding_boxes import world_bounds


def world_of(**bodies: tuple[Pose, Vector | None]) -> World:
    return World(
        iri=Iri("http://e#map"),
        bodies=tuple(
            Body(id=BodyId(id), iri=Iri(f"http://e#{id}"), cls=Iri(f"http://e#{id.title()}"), pose=pose, size=size)
            for id, (pose, size) in bodies.items()
        ),
    )


def test_an_empty_world_has_no_bounds() -> None:
    assert world_bounds(world_of()) is None


def test_bounds_contain_all_rotated_bodies() -> None:
    half = math.sqrt(0.5)
    cupboard = Pose((1.0, 2.0, 1.0)), (1.0, 0.5, 2.0)
    plank = Pose((0.0, 0.0, 0.0), (half, 0.0, half, 0.0)), (3.0, 0.2, 0.1)  # upright, though long
    extent = world_bounds(world_of(cupboard=cupboard, plank=plank))
    assert extent is not None
    assert extent.low == pytest.approx((-0.05, -0.1, -1.5))
    assert extent.high == pytest.approx((1.5, 2.25, 2.0))
    assert extent.size == pytest.approx((1.55, 2.35, 3.5))
    assert (extent.tallest, extent.tallest_class) == ("plank", "http://e#Plank")
    assert extent.height_m == pytest.approx(3.0)


def test_a_body_without_a_size_is_a_point_and_quaternion_norms_are_ignored() -> None:
    extent = world_bounds(
        world_of(a=(Pose((-1.0, 0.0, 0.0), (3.0, 0.0, 0.0, 0.0)), None), b=(Pose((0.0, 4.0, 0.0)), None))
    )
    assert extent is not None
    assert (extent.size, extent.height_m) == ((1.0, 4.0, 0.0), 0.0)
