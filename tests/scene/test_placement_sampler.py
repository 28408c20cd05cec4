"""Candidate poses on level support surfaces that are large enough and free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.engines.scenes import body

from mindstage.scene import Body, BodyGeometry, BodyId, CollisionShape, Pose, SupportSurface, Vector
from mindstage.scene.bounding_boxes import OrientedBoxes, penetration_depths
from mindstage.scene.placement import PlacementSampler, support_surfaces
from mindstage.scene.transforms import pose_array

CUP: Vector = (0.08, 0.08, 0.1)


def case_geometry(levels: tuple[float, ...] = (-0.2,), height: float = 0.15) -> BodyGeometry:
    """A case of 0.6 x 0.5 x 0.4 m, open in front, with shelves as support surfaces."""
    walls = [
        CollisionShape(size=(0.6, 0.02, 0.4), pose=Pose((0.0, 0.24, 0.0))),
        CollisionShape(size=(0.6, 0.02, 0.4), pose=Pose((0.0, -0.24, 0.0))),
        CollisionShape(size=(0.02, 0.5, 0.4), pose=Pose((-0.29, 0.0, 0.0))),
    ]
    floors = [CollisionShape(size=(0.6, 0.46, 0.01), pose=Pose((0.0, 0.0, level - 0.005))) for level in levels]
    surfaces = [
        SupportSurface(center=(0.01, 0.0, level), size=(0.57, 0.46), clearance=height, is_inside=True)
        for level in levels
    ]
    return BodyGeometry(
        key=f"case{levels}", visuals=(), collision_shapes=(*walls, *floors), support_surfaces=tuple(surfaces)
    )


def sampler_for(
    *bodies: Body, geometry: dict[BodyId, BodyGeometry] | None = None, ignored_ids: frozenset[str] = frozenset()
) -> PlacementSampler:
    ids = tuple(each.id for each in bodies)
    return PlacementSampler(
        {each.id: each for each in bodies}, geometry or {}, ids, pose_array(b.pose for b in bodies), ignored_ids
    )


def row(of: Body) -> np.ndarray:
    return pose_array([of.pose])[0]


def test_the_upper_side_of_a_box_is_a_support_surface() -> None:
    table = body("table", (1.0, 2.0, 0.5), (1.2, 0.8, 1.0))
    (surface,) = support_surfaces(table, None, row(table), inside=False)
    assert surface.pose[:3] == pytest.approx((1.0, 2.0, 1.0))
    assert surface.size == (1.2, 0.8)
    assert not list(support_surfaces(table, None, row(table), inside=True)), "a box has no surface inside"


def test_a_tilted_box_has_the_side_that_is_now_up() -> None:
    quarter = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    chest = body("chest", (0.0, 0.0, 0.4), (1.0, 0.8, 0.5), quaternion=quarter)
    (surface,) = support_surfaces(chest, None, row(chest), inside=False)
    assert surface.pose[2] == pytest.approx(0.8)
    assert sorted(surface.size) == [0.5, 1.0]


def test_a_slanted_body_has_no_support_surface() -> None:
    leaning = body("board", (0.0, 0.0, 1.0), (1.0, 1.0, 0.1), quaternion=(math.cos(0.2), math.sin(0.2), 0.0, 0.0))
    assert not list(support_surfaces(leaning, None, row(leaning), inside=False))


def test_surfaces_inside_and_on_top_are_distinguished() -> None:
    case = body("case", (0.0, 0.0, 1.0), (0.6, 0.5, 0.4))
    top = SupportSurface(center=(0.0, 0.0, 0.2), size=(0.6, 0.5))
    shelves = case_geometry((-0.19, 0.0))
    both = BodyGeometry(
        key="both",
        visuals=(),
        collision_shapes=shelves.collision_shapes,
        support_surfaces=(*shelves.support_surfaces, top),
    )
    assert [round(h.pose[2], 3) for h in support_surfaces(case, both, row(case), inside=True)] == [0.81, 1.0]
    assert [round(h.pose[2], 3) for h in support_surfaces(case, both, row(case), inside=False)] == [1.2]


def test_the_center_comes_first() -> None:
    table = body("table", (0.0, 0.0, 0.5), (1.0, 1.0, 1.0))
    (surface,) = support_surfaces(table, None, row(table), inside=False)
    candidates, reason = sampler_for(table).candidate_poses(body("cup", (9.0, 9.0, 9.0), CUP), None, surface)
    assert not reason
    assert candidates[0].position == pytest.approx((0.0, 0.0, 1.051))
    distances = [math.hypot(*candidate.position[:2]) for candidate in candidates]
    assert distances == pytest.approx(sorted(distances))


def test_candidates_avoid_other_bodies() -> None:
    table = body("table", (0.0, 0.0, 0.5), (0.4, 0.4, 1.0))
    vase = body("vase", (0.0, 0.0, 1.1), (0.2, 0.2, 0.2))
    (surface,) = support_surfaces(table, None, row(table), inside=False)
    cup = body("cup", (9.0, 9.0, 9.0), CUP)
    candidates, _ = sampler_for(table, vase).candidate_poses(cup, None, surface)
    assert candidates
    assert all(max(abs(x), abs(y)) >= 0.14 - 1e-9 for x, y, _ in (candidate.position for candidate in candidates))
    unobstructed, _ = sampler_for(table, vase, ignored_ids=frozenset({"vase"})).candidate_poses(cup, None, surface)
    assert unobstructed[0].position[:2] == pytest.approx((0.0, 0.0)), "an ignored body is not an obstacle"


def test_a_body_without_candidates_has_a_reason() -> None:
    case = body("case", (0.0, 0.0, 1.0), (0.6, 0.5, 0.4))
    (surface,) = support_surfaces(case, case_geometry(), row(case), inside=True)
    geometry = {case.id: case_geometry()}
    sampler = sampler_for(case, geometry=geometry)
    assert sampler.candidate_poses(body("pole", (0.0, 0.0, 9.0), (0.05, 0.05, 0.5)), None, surface)[1] == (
        "it is 0.50 m high, and the clearance is 0.15 m"
    )
    assert (
        sampler.candidate_poses(body("plank", (0.0, 0.0, 9.0), (0.9, 0.1, 0.02)), None, surface)[1]
        == "it is larger than the support surface"
    )
    block = body("block", (0.0, 0.0, 0.9), (0.5, 0.4, 0.1))
    assert sampler_for(case, block, geometry=geometry).candidate_poses(
        body("cup", (9.0, 0.0, 0.0), CUP), None, surface
    )[1] == ("other bodies occupy the space")


def test_a_long_body_is_rotated_to_fit() -> None:
    case = body("case", (0.0, 0.0, 1.0), (0.6, 0.5, 0.4))
    (surface,) = support_surfaces(case, case_geometry(), row(case), inside=True)
    ruler = body("ruler", (0.0, 0.0, 9.0), (0.05, 0.52, 0.02))
    candidates, _ = sampler_for(case, geometry={case.id: case_geometry()}).candidate_poses(ruler, None, surface)
    assert candidates
    turned = {
        round(2 * math.degrees(math.atan2(candidate.quaternion[3], candidate.quaternion[0])))
        for candidate in candidates
    }
    assert turned == {90}


@settings(max_examples=40, deadline=None)
@given(
    yaw=st.floats(-math.pi, math.pi),
    size=st.tuples(*[st.floats(0.3, 2.0)] * 2),
    cup=st.tuples(*[st.floats(0.03, 0.25)] * 3),
    others=st.lists(st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(0.05, 0.3)), max_size=6),
)
def test_every_candidate_is_on_the_surface_and_free(
    yaw: float, size: tuple[float, float], cup: Vector, others: list[tuple[float, float, float]]
) -> None:
    turned = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    table = body("table", (3.0, -2.0, 0.4), (*size, 0.8), quaternion=turned)
    obstacles = [
        body(f"other{number}", (3.0 + x, -2.0 + y, 0.8 + extent / 2), (extent,) * 3)
        for number, (x, y, extent) in enumerate(others)
    ]
    (surface,) = support_surfaces(table, None, row(table), inside=False)
    thing = body("thing", (9.0, 9.0, 9.0), cup)
    candidates, reason = sampler_for(table, *obstacles).candidate_poses(thing, None, surface)
    assert bool(candidates) is not bool(reason)
    if not candidates:
        return
    placed = pose_array(candidates[:50])
    boxes = OrientedBoxes.from_poses(placed, np.tile(cup, (len(placed), 1)))
    corners = boxes.center[:, None] + np.einsum(
        "nij,kj->nki", boxes.rotation, np.array([[x, y, -1] for x in (-1, 1) for y in (-1, 1)]) * np.array(cup) / 2
    )
    assert corners[..., 2] == pytest.approx(0.801)
    local = (corners - (3.0, -2.0, 0.0)) @ np.array(
        [[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
    assert (np.abs(local[..., :2]) <= np.array(size) / 2 + 1e-9).all()
    if obstacles:
        together = OrientedBoxes.from_poses(
            np.concatenate([placed, pose_array(other.pose for other in obstacles)]),
            np.concatenate([np.tile(cup, (len(placed), 1)), [other.size for other in obstacles]]),
        )
        mine, theirs = np.meshgrid(np.arange(len(placed)), np.arange(len(placed), len(placed) + len(obstacles)))
        assert (penetration_depths(together, mine.reshape(-1), theirs.reshape(-1)) <= 1e-9).all()
