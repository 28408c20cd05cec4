"""Where a visitor stands at first."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.viewport.framing import View, first_view, ground_height
from mindstage.viewport.looks import decide_looks
from mindstage.world import Body, BodyId, Iri, Mobility, Physics, Pose, Vector, World
from tests.kitchenette import kitchenette
from tests.viewport.visiting import on_screen

PICTURE = {"x": 0.0, "y": 0.0, "width": 960.0, "height": 800.0}


def view_of(world: World) -> View:
    return first_view(world, decide_looks(world, lambda cls: ()))


def more(world: World, *bodies: Body) -> World:
    return replace(world, bodies=(*world.bodies, *bodies))


def body(id: str, cls: str, at: Vector, size: Vector, mobility: Mobility = Mobility.STATIC) -> Body:
    iri = Iri(f"http://x.org#{id}")
    return Body(
        id=BodyId(id),
        iri=iri,
        cls=Iri(f"http://x.org#{cls}"),
        pose=Pose(at),
        size=size,
        physics=Physics(mobility=mobility),
    )


def test_all_furniture_is_in_the_picture_and_fills_it() -> None:
    view = view_of(kitchenette())
    pixels = []
    for thing in kitchenette().bodies:
        if thing.id != "Floor" and thing.size is not None:
            corners = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
            pixels += [on_screen(view, tuple(thing.pose.position + corner * thing.size), PICTURE) for corner in corners]
    low, high = np.min(pixels, axis=0), np.max(pixels, axis=0)
    assert np.all(low > 0.0)
    assert np.all(high < (PICTURE["width"], PICTURE["height"]))
    assert np.max((high - low) / (PICTURE["width"], PICTURE["height"])) > 0.6


def test_fronts_face_the_visitor() -> None:
    view = view_of(kitchenette())
    assert view.position[0] < view.look_at[0], "the fronts look along -x"
    mirrored = [
        replace(thing, pose=Pose((-thing.pose.position[0], *thing.pose.position[1:]))) for thing in kitchenette().bodies
    ]
    other = view_of(replace(kitchenette(), bodies=tuple(mirrored)))
    assert other.position[0] > other.look_at[0]


def test_one_looks_down_and_across_the_corner() -> None:
    view = view_of(kitchenette())
    away = np.subtract(view.position, view.look_at)
    assert 20 < np.degrees(np.arctan2(away[2], np.hypot(*away[:2]))) < 50
    assert 10 < np.degrees(np.arctan2(away[1], away[0])) % 90 < 80


def test_the_same_world_gives_the_same_view() -> None:
    assert view_of(kitchenette()) == view_of(kitchenette())


@pytest.mark.parametrize(
    "stranger",
    [
        body("Panorama", "Panorama", (0.0, 0.0, 0.0), (177.0, 177.0, 60.0)),
        body("Wall", "Wall", (-1.0, 0.0, 1.2), (0.1, 8.0, 2.5)),
        body("Ceiling", "Ceiling", (2.0, 0.0, 2.5), (8.0, 8.0, 0.1)),
        body("Poster", "Poster", (40.0, 3.0, 1.5), (0.01, 1.0, 1.0)),
    ],
    ids=lambda stranger: stranger.id,
)
def test_the_house_round_the_furniture_does_not_change_the_view(stranger: Body) -> None:
    assert view_of(more(kitchenette(), stranger)) == view_of(kitchenette())


def test_one_lost_thing_does_not_make_the_kitchen_small() -> None:
    lost = body("Lost", "Mug", (300.0, 0.0, 0.0), (0.1, 0.1, 0.1), Mobility.DYNAMIC)
    near, far = view_of(kitchenette()), view_of(more(kitchenette(), lost))
    assert np.linalg.norm(np.subtract(far.look_at, near.look_at)) < 1.0


def test_a_place_where_nothing_moves_is_shown_whole() -> None:
    still = World(
        iri=Iri("http://x.org#m"),
        bodies=(
            body("a", "Table", (5.0, 5.0, 0.5), (1.0, 1.0, 1.0)),
            body("b", "Table", (9.0, 5.0, 0.5), (1.0, 1.0, 1.0)),
        ),
    )
    assert view_of(still).look_at == pytest.approx((7.0, 5.0, 0.5))


def test_one_tiny_thing_is_not_looked_at_from_inside() -> None:
    tiny = World(iri=Iri("http://x.org#m"), bodies=(body("a", "Mug", (0.0, 0.0, 0.0), (0.01, 0.01, 0.01)),))
    view = view_of(tiny)
    assert 0.3 < np.linalg.norm(np.subtract(view.position, view.look_at)) < 2.0


def test_an_empty_world_has_a_view() -> None:
    assert np.isfinite(view_of(World(iri=Iri("http://x.org#m"))).position).all()


def test_a_ground_lies_under_everything_unless_there_is_a_floor() -> None:
    def ground(world: World) -> float | None:
        return ground_height(world, decide_looks(world, lambda cls: ()))

    bare = replace(kitchenette(), bodies=tuple(thing for thing in kitchenette().bodies if thing.id != "Floor"))
    assert ground(kitchenette()) is None
    assert ground(bare) == pytest.approx(0.0)
    assert ground(more(bare, body("Pit", "Panorama", (0.0, 0.0, 0.0), (99.0, 99.0, 99.0)))) == pytest.approx(0.0)
    assert ground(World(iri=Iri("http://x.org#m"))) == 0.0
