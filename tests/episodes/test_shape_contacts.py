"""Gaps and containment of shapes: truths by hand for boxes in every arrangement, and all pairs against each other."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.episodes import EpisodeFrame
from mindstage.episodes.shape_contacts import GapPairs, ShapeContacts
from mindstage.episodes.tracking import BodyTable
from mindstage.scene import NO_GEOMETRY, Body, BodyId, BodyPhysics, Iri, Mobility, Pose, Vector, World
from tests.cases import each_case

MARGIN_M, MAX_DEPTH_M = 0.01, 0.02
Box = tuple[Vector, Vector | None]
"""Center and size [m], which may be unknown."""


class Boxes:
    """Boxes named a, b, c… and their contacts."""

    def __init__(self, *boxes: Box) -> None:
        iri = Iri("http://example.org/m#Thing")
        bodies = tuple(
            Body(
                id=BodyId(chr(ord("a") + number)),
                iri=iri,
                cls=iri,
                pose=Pose(center),
                size=size,
                physics=BodyPhysics(mobility=Mobility.DYNAMIC),
            )
            for number, (center, size) in enumerate(boxes)
        )
        ids = tuple(body.id for body in bodies)
        self.poses = np.array([(*body.pose.position, *body.pose.quaternion) for body in bodies])
        world = World(iri=iri, bodies=bodies)
        table = BodyTable.from_frame(EpisodeFrame(time_s=0.0, structure=world, ids=ids, poses=self.poses))
        self.contacts = ShapeContacts(NO_GEOMETRY, margin_m=MARGIN_M, max_depth_m=MAX_DEPTH_M)
        self.contacts.set_bodies(table, self.poses)

    def gaps(self, *pairs: tuple[int, int], deeper: float = 0.0) -> GapPairs:
        a, b = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        return self.contacts.gaps(a, b, deeper=np.full(len(self.poses), deeper))

    def near(self, *rows: int) -> set[tuple[int, int]]:
        """The near pairs of some bodies, each in order; none may be there twice."""
        a, b = self.contacts.near(np.array(rows, dtype=np.intp))
        found = [(min(pair), max(pair)) for pair in zip(a.tolist(), b.tolist(), strict=True)]
        assert len(set(found)) == len(found)
        return set(found)


UNIT = (1.0, 1.0, 1.0)
BASE: Box = ((0.0, 0.0, 0.0), UNIT)


@each_case("axis", [0, 1, 2])
@each_case("sign", [1.0, -1.0])
@each_case("gap", [0.005, 0.0, -0.015])
def test_the_normal_of_a_pair_points_from_the_first_to_the_second(axis: int, sign: float, gap: float) -> None:
    center = np.zeros(3)
    center[axis] = sign * (1.0 + gap)
    boxes = Boxes(BASE, (tuple(center.tolist()), UNIT))
    direction = np.zeros(3)
    direction[axis] = sign
    forward, back = boxes.gaps((0, 1)), boxes.gaps((1, 0))
    assert forward.gap == pytest.approx([gap], abs=1e-9)
    assert forward.normal[0] == pytest.approx(direction, abs=1e-9)
    assert back.normal[0] == pytest.approx(-direction, abs=1e-9)
    upwards = direction[2]
    assert (forward.a_below[0], forward.b_below[0]) == pytest.approx((upwards, -upwards), abs=1e-9)
    assert (back.a_below[0], back.b_below[0]) == pytest.approx((-upwards, upwards), abs=1e-9)


@each_case(
    ("gap", "deeper", "is_found"),
    [
        (0.0099, 0.0, True),
        (0.0101, 0.0, False),
        (-0.0199, 0.0, True),
        (-0.0201, 0.0, False),
        (-0.0399, 0.01, True),  # both may be deeper by 1 cm
        (-0.0401, 0.01, False),
    ],
)
def test_pairs_are_found_from_the_margin_to_the_greatest_depth(gap: float, deeper: float, is_found: bool) -> None:
    boxes = Boxes(BASE, ((0.0, 0.0, 1.0 + gap), UNIT))
    found = boxes.gaps((0, 1), deeper=deeper)
    assert len(found.gap) == is_found
    assert found.a.tolist() == [0] * is_found
    assert found.b.tolist() == [1] * is_found


def test_of_many_pairs_each_has_its_own_gap() -> None:
    boxes = Boxes(BASE, ((0.0, 0.0, 1.004), UNIT), ((1.002, 0.0, 0.0), UNIT), ((9.0, 0.0, 0.0), UNIT))
    found = boxes.gaps((0, 1), (0, 3), (2, 0), (1, 2))
    assert list(zip(found.a.tolist(), found.b.tolist(), strict=True)) == [(0, 1), (2, 0), (1, 2)]
    assert found.gap[:2] == pytest.approx([0.004, 0.002], abs=1e-9)
    assert found.normal[0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert found.normal[1] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)
    assert boxes.gaps().gap.tolist() == []


coordinates = st.integers(-12, 12).map(lambda value: value / 10)
arrangements = st.lists(
    st.tuples(st.tuples(coordinates, coordinates, coordinates), st.sampled_from([UNIT, (0.2, 0.4, 0.6)])),
    min_size=2,
    max_size=6,
)


def bounds_are_near(a: Box, b: Box) -> bool:
    gaps = np.abs(np.subtract(a[0], b[0])) - np.add(a[1] or UNIT, b[1] or UNIT) / 2
    return bool(gaps.max() <= MARGIN_M)


@given(boxes=arrangements, moves=arrangements, rows=st.sets(st.integers(0, 5), min_size=1))
@settings(max_examples=60)
def test_every_near_pair_of_moved_bodies_is_found_and_no_other(
    boxes: list[Box], moves: list[Box], rows: set[int]
) -> None:
    found = Boxes(*boxes)
    chosen = sorted(row for row in rows if row < len(boxes))
    places = list(boxes)

    def expected() -> set[tuple[int, int]]:
        return {
            (a, b)
            for a, b in combinations(range(len(boxes)), 2)
            if (a in chosen or b in chosen) and bounds_are_near(places[a], places[b])
        }

    assert found.near(*chosen) == expected()
    for row, (center, _) in zip(chosen, moves, strict=False):
        places[row] = (center, boxes[row][1])
        found.poses[row, :3] = center
    found.contacts.move(np.array(chosen, dtype=np.intp), found.poses)
    assert found.near(*chosen) == expected()


@pytest.mark.parametrize("count", [2, 600])
def test_neighbors_are_the_same_for_few_and_for_many_bodies(count: int) -> None:
    row = [((1.005 * number, 0.0, 0.0), UNIT) for number in range(count)]
    found = Boxes(*row)
    assert found.near(*range(count)) == {(number, number + 1) for number in range(count - 1)}


@each_case(
    ("inner", "is_inside"),
    [
        (((0.0, 0.0, 0.0), (0.4, 0.4, 0.4)), True),
        (((0.35, 0.0, 0.0), (0.4, 0.4, 0.4)), True),  # 87.5 % of it
        (((0.45, 0.0, 0.0), (0.4, 0.4, 0.4)), False),  # 62.5 %
        (((0.0, 0.0, 2.0), (0.4, 0.4, 0.4)), False),
        (((0.0, 0.0, 0.0), UNIT), False),  # as large
    ],
)
def test_the_larger_one_contains_the_smaller_one_in_either_order(inner: Box, is_inside: bool) -> None:
    for boxes, outer in (((BASE, inner), 0), ((inner, BASE), 1)):
        found = Boxes(*boxes)
        for pair in ((0, 1), (1, 0)):
            a, b = np.array([pair[0]]), np.array([pair[1]])
            holders, contents = found.contacts.contained(a, b, min_fraction=0.8)
            assert holders.tolist() == [outer] * is_inside
            assert contents.tolist() == [1 - outer] * is_inside


def test_a_body_without_a_size_touches_and_contains_nothing() -> None:
    found = Boxes(BASE, ((0.0, 0.0, 1.0), UNIT), ((0.0, 0.0, 0.5), None))
    assert found.contacts.has_shapes(0, 1)
    assert not found.contacts.has_shapes(0, 2)
    gaps = found.gaps((0, 1), (0, 2), (2, 1))
    assert (gaps.a.tolist(), gaps.b.tolist()) == ([0], [1])
    assert len(found.contacts.contained(np.array([0]), np.array([2]), min_fraction=0.8)[0]) == 0
