"""Where something can stand: on level places that are large enough, and clear of all that stands there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.scene import Body, BodyGeometry, BodyId, CollisionShape, Pose, SupportSurface, Vector
from mindstage.scene.bounding_boxes import OrientedBoxes, penetration_depths
from mindstage.scene.transforms import pose_array
from mindstage.simulation.placement import PlacementSampler, support_surfaces
from tests.engines.scenes import body

CUP: Vector = (0.08, 0.08, 0.1)


def tray(levels: tuple[float, ...] = (-0.2,), height: float = 0.15) -> BodyGeometry:
    """A case of 0.6 x 0.5 x 0.4 m, open in front, with floors on which things can be put."""
    walls = [
        CollisionShape(size=(0.6, 0.02, 0.4), pose=Pose((0.0, 0.24, 0.0))),
        CollisionShape(size=(0.6, 0.02, 0.4), pose=Pose((0.0, -0.24, 0.0))),
        CollisionShape(size=(0.02, 0.5, 0.4), pose=Pose((-0.29, 0.0, 0.0))),
    ]
    floors = [CollisionShape(size=(0.6, 0.46, 0.01), pose=Pose((0.0, 0.0, level - 0.005))) for level in levels]
    places = [
        SupportSurface(center=(0.01, 0.0, level), size=(0.57, 0.46), clearance=height, is_inside=True)
        for level in levels
    ]
    return BodyGeometry(
        key=f"tray{levels}", visuals=(), collision_shapes=(*walls, *floors), support_surfaces=tuple(places)
    )


def crowd(
    *bodies: Body, forms: dict[BodyId, BodyGeometry] | None = None, ghosts: frozenset[str] = frozenset()
) -> PlacementSampler:
    ids = tuple(each.id for each in bodies)
    return PlacementSampler(
        {each.id: each for each in bodies}, forms or {}, ids, pose_array(b.pose for b in bodies), ghosts
    )


def row(of: Body) -> np.ndarray:
    return pose_array([of.pose])[0]


def test_a_box_offers_the_side_that_looks_up() -> None:
    table = body("table", (1.0, 2.0, 0.5), (1.2, 0.8, 1.0))
    (holder,) = support_surfaces(table, None, row(table), inside=False)
    assert holder.pose[:3] == pytest.approx((1.0, 2.0, 1.0))
    assert holder.size == (1.2, 0.8)
    assert not list(support_surfaces(table, None, row(table), inside=True)), "nobody knows of room in a plain box"


def test_what_lies_on_its_side_offers_the_side_that_now_looks_up() -> None:
    quarter = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    chest = body("chest", (0.0, 0.0, 0.4), (1.0, 0.8, 0.5), quaternion=quarter)
    (holder,) = support_surfaces(chest, None, row(chest), inside=False)
    assert holder.pose[2] == pytest.approx(0.8)
    assert sorted(holder.size) == [0.5, 1.0]


def test_what_leans_offers_nothing() -> None:
    leaning = body("board", (0.0, 0.0, 1.0), (1.0, 1.0, 0.1), quaternion=(math.cos(0.2), math.sin(0.2), 0.0, 0.0))
    assert not list(support_surfaces(leaning, None, row(leaning), inside=False))


def test_a_form_tells_its_places_apart() -> None:
    case = body("case", (0.0, 0.0, 1.0), (0.6, 0.5, 0.4))
    top = SupportSurface(center=(0.0, 0.0, 0.2), size=(0.6, 0.5))
    form = tray((-0.19, 0.0))
    both = BodyGeometry(
        key="both", visuals=(), collision_shapes=form.collision_shapes, support_surfaces=(*form.support_surfaces, top)
    )
    assert [round(h.pose[2], 3) for h in support_surfaces(case, both, row(case), inside=True)] == [0.81, 1.0]
    assert [round(h.pose[2], 3) for h in support_surfaces(case, both, row(case), inside=False)] == [1.2]


def test_the_middle_comes_first() -> None:
    table = body("table", (0.0, 0.0, 0.5), (1.0, 1.0, 1.0))
    (holder,) = support_surfaces(table, None, row(table), inside=False)
    spots, why = crowd(table).candidate_poses(body("cup", (9.0, 9.0, 9.0), CUP), None, holder)
    assert not why
    assert spots[0].position == pytest.approx((0.0, 0.0, 1.051))
    distances = [math.hypot(*spot.position[:2]) for spot in spots]
    assert distances == pytest.approx(sorted(distances))


def test_what_stands_there_already_is_left_alone() -> None:
    table = body("table", (0.0, 0.0, 0.5), (0.4, 0.4, 1.0))
    vase = body("vase", (0.0, 0.0, 1.1), (0.2, 0.2, 0.2))
    (holder,) = support_surfaces(table, None, row(table), inside=False)
    cup = body("cup", (9.0, 9.0, 9.0), CUP)
    spots, _ = crowd(table, vase).candidate_poses(cup, None, holder)
    assert spots
    assert all(max(abs(x), abs(y)) >= 0.14 - 1e-9 for x, y, _ in (spot.position for spot in spots))
    through, _ = crowd(table, vase, ghosts=frozenset({"vase"})).candidate_poses(cup, None, holder)
    assert through[0].position[:2] == pytest.approx((0.0, 0.0)), "what collides with nothing is in nobody's way"


def test_reasons_are_told() -> None:
    case = body("case", (0.0, 0.0, 1.0), (0.6, 0.5, 0.4))
    (holder,) = support_surfaces(case, tray(), row(case), inside=True)
    of_trays = {case.id: tray()}
    there = crowd(case, forms=of_trays)
    assert there.candidate_poses(body("pole", (0.0, 0.0, 9.0), (0.05, 0.05, 0.5)), None, holder)[1] == (
        "it is 0.50 m high, and there is room for 0.15 m"
    )
    assert (
        there.candidate_poses(body("plank", (0.0, 0.0, 9.0), (0.9, 0.1, 0.02)), None, holder)[1]
        == "it is larger than the place"
    )
    block = body("block", (0.0, 0.0, 0.9), (0.5, 0.4, 0.1))
    assert crowd(case, block, forms=of_trays).candidate_poses(body("cup", (9.0, 0.0, 0.0), CUP), None, holder)[1] == (
        "something stands there already"
    )


def test_what_is_long_is_put_the_way_that_it_fits() -> None:
    case = body("case", (0.0, 0.0, 1.0), (0.6, 0.5, 0.4))
    (holder,) = support_surfaces(case, tray(), row(case), inside=True)
    ruler = body("ruler", (0.0, 0.0, 9.0), (0.05, 0.52, 0.02))
    spots, _ = crowd(case, forms={case.id: tray()}).candidate_poses(ruler, None, holder)
    assert spots
    turned = {round(2 * math.degrees(math.atan2(spot.quaternion[3], spot.quaternion[0]))) for spot in spots}
    assert turned == {90}


@settings(max_examples=40, deadline=None)
@given(
    yaw=st.floats(-math.pi, math.pi),
    size=st.tuples(*[st.floats(0.3, 2.0)] * 2),
    cup=st.tuples(*[st.floats(0.03, 0.25)] * 3),
    others=st.lists(st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(0.05, 0.3)), max_size=6),
)
def test_every_spot_is_on_the_place_and_free(
    yaw: float, size: tuple[float, float], cup: Vector, others: list[tuple[float, float, float]]
) -> None:
    turned = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    table = body("table", (3.0, -2.0, 0.4), (*size, 0.8), quaternion=turned)
    there = [
        body(f"other{number}", (3.0 + x, -2.0 + y, 0.8 + extent / 2), (extent,) * 3)
        for number, (x, y, extent) in enumerate(others)
    ]
    (holder,) = support_surfaces(table, None, row(table), inside=False)
    thing = body("thing", (9.0, 9.0, 9.0), cup)
    spots, why = crowd(table, *there).candidate_poses(thing, None, holder)
    assert bool(spots) is not bool(why)
    if not spots:
        return
    placed = pose_array(spots[:50])
    boxes = OrientedBoxes.from_poses(placed, np.tile(cup, (len(placed), 1)))
    corners = boxes.center[:, None] + np.einsum(
        "nij,kj->nki", boxes.rotation, np.array([[x, y, -1] for x in (-1, 1) for y in (-1, 1)]) * np.array(cup) / 2
    )
    assert corners[..., 2] == pytest.approx(0.801)
    local = (corners - (3.0, -2.0, 0.0)) @ np.array(
        [[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
    assert (np.abs(local[..., :2]) <= np.array(size) / 2 + 1e-9).all()
    if there:
        together = OrientedBoxes.from_poses(
            np.concatenate([placed, pose_array(other.pose for other in there)]),
            np.concatenate([np.tile(cup, (len(placed), 1)), [other.size for other in there]]),
        )
        mine, theirs = np.meshgrid(np.arange(len(placed)), np.arange(len(placed), len(placed) + len(there)))
        assert (penetration_depths(together, mine.reshape(-1), theirs.reshape(-1)) <= 1e-9).all()
