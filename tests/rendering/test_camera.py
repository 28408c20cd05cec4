"""The initial camera: what it frames, and from which direction."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.rendering.appearance import BodyAppearance, compute_appearance
from mindstage.rendering.camera import (
    CameraPose,
    FramingTarget,
    ViewFrame,
    corners,
    focus_camera,
    ground_height,
    initial_camera,
    initial_target,
)
from mindstage.rendering.render_scene import find_culled
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, Vector, World
from mindstage.scene.transforms import pose_array
from tests.cases import each_case
from tests.kitchenette import kitchenette
from tests.viewer.page_tab import to_picture

KNOWLEDGE = KnowledgeBase()


def appearances_of(world: World) -> dict[BodyId, BodyAppearance]:
    return compute_appearance(world, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)


def view_of(world: World, aspect: float = 1.2) -> CameraPose:
    return initial_camera(world, appearances_of(world), aspect=aspect)


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
        physics=BodyPhysics(mobility=mobility),
    )


def in_picture(view: CameraPose, points: np.ndarray, aspect: float) -> np.ndarray:
    """Positions of points in the picture, from -1 to 1 to the right and up."""
    box = {"x": -aspect, "y": -1.0, "width": 2 * aspect, "height": 2.0}
    return np.array([to_picture(view, tuple(point), box) for point in points.tolist()]) / (aspect, 1.0)


def furniture() -> np.ndarray:
    bodies = [body_ for body_ in kitchenette().bodies if body_.id != "Floor"]
    return corners(pose_array(body_.pose for body_ in bodies), np.array([body_.size for body_ in bodies]))


@each_case("aspect", [0.46, 0.75, 1.0, 1.33, 1.78, 2.4])
def test_the_furniture_fills_windows_of_any_aspect_ratio(aspect: float) -> None:
    seen = in_picture(view_of(kitchenette(), aspect), furniture(), aspect)
    assert np.abs(seen).max() < 1.0
    assert np.max(np.ptp(seen, axis=0)) > 1.5
    assert np.abs(seen.max(axis=0) + seen.min(axis=0)).min() < 0.02, "the furniture is centered"


def test_the_top_view_looks_straight_down() -> None:
    view = initial_target(kitchenette(), appearances_of(kitchenette())).top_camera(1.2)
    away = np.subtract(view.position, view.look_at)
    assert away[2] > 0.99 * np.linalg.norm(away)
    assert np.abs(in_picture(view, furniture(), 1.2)).max() < 1.0


@pytest.mark.parametrize("aspect", [0.5, 1.2])
def test_in_the_top_view_walls_are_parallel_to_the_window(aspect: float) -> None:
    view = initial_target(kitchenette(), appearances_of(kitchenette())).top_camera(aspect)
    x, y, _ = np.subtract(view.position, view.look_at)
    assert min(abs(x), abs(y)) < 0.01 * max(abs(x), abs(y))


@pytest.mark.parametrize("azimuth", [0.4, 2.0, -2.5])
def test_the_top_view_of_a_turned_room_is_turned_like_it(azimuth: float) -> None:
    yaw = 0.3
    along_x = furniture()[:, [1, 0, 2]]
    turned = along_x @ np.array([[np.cos(yaw), np.sin(yaw), 0.0], [-np.sin(yaw), np.cos(yaw), 0.0], [0, 0, 1.0]])
    view = FramingTarget(turned, azimuth, alignment_rad=yaw).top_camera(1.2)
    x, y, _ = np.subtract(view.position, view.look_at)
    beside = (np.arctan2(y, x) - yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4
    assert beside == pytest.approx(0.0, abs=0.01), "the walls are parallel to the window"
    assert abs((np.arctan2(y, x) - azimuth + np.pi) % (2 * np.pi) - np.pi) <= np.pi / 2, "on the side of the other view"


@pytest.mark.parametrize("eye", [(0.0, -4.0, 2.0), (2.0, 0.0, 9.0), (1.0, 0.0, 0.7)])
def test_focused_bodies_fill_the_picture_from_the_same_direction(eye: Vector) -> None:
    mug = kitchenette().body("Mug")
    points = corners(pose_array([mug.pose]), np.array([[0.3, 0.3, 0.3]]))
    view = focus_camera(points, eye, mug.pose.position, 1.5)
    assert np.ptp(in_picture(view, points, 1.5), axis=0).max() > 0.6
    before, now = np.subtract(eye, mug.pose.position), np.subtract(view.position, view.look_at)
    assert before @ now > 0.99 * np.linalg.norm(before) * np.linalg.norm(now)


def test_focusing_works_from_inside_the_focused_body() -> None:
    assert np.isfinite(focus_camera(np.zeros((1, 3)), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).position).all()


def test_fronts_face_the_camera() -> None:
    view = view_of(kitchenette())
    assert view.position[0] < view.look_at[0], "the fronts face -x"
    mirrored = [
        replace(body_, pose=Pose((-body_.pose.position[0], *body_.pose.position[1:]))) for body_ in kitchenette().bodies
    ]
    other = view_of(replace(kitchenette(), bodies=tuple(mirrored)))
    assert other.position[0] > other.look_at[0]


def test_the_initial_camera_looks_down_and_diagonally() -> None:
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
def test_the_building_does_not_change_the_initial_camera(stranger: Body) -> None:
    assert view_of(more(kitchenette(), stranger)) == view_of(kitchenette())


def test_outliers_do_not_change_the_initial_camera() -> None:
    lost = body("Lost", "Mug", (300.0, 0.0, 0.0), (0.1, 0.1, 0.1), Mobility.DYNAMIC)
    near, far = view_of(kitchenette()), view_of(more(kitchenette(), lost))
    assert np.linalg.norm(np.subtract(far.look_at, near.look_at)) < 1.0


def test_a_static_world_is_shown_completely() -> None:
    world = World(
        iri=Iri("http://x.org#m"),
        bodies=(
            body("a", "Table", (5.0, 5.0, 0.5), (1.0, 1.0, 1.0)),
            body("b", "Table", (9.0, 5.0, 0.5), (1.0, 1.0, 1.0)),
        ),
    )
    points = corners(pose_array(body_.pose for body_ in world.bodies), np.ones((2, 3)))
    seen = in_picture(view_of(world), points, 1.2)
    assert np.abs(seen).max() < 1.0
    assert np.ptp(seen[:, 0]) > 1.5


def test_a_small_room_is_shown_completely() -> None:
    """Most bodies are parts of one cupboard; the table is static."""
    parts = [
        body(f"part{at}", "Door", (-1.2 + 0.1 * at, 0.0, 0.5), (0.1, 0.5, 0.8), Mobility.DYNAMIC) for at in range(3)
    ]
    cup = body("Cup", "Cup", (0.8, 0.9, 0.77), (0.1, 0.1, 0.1), Mobility.DYNAMIC)
    table = body("Table", "Table", (0.8, 0.9, 0.36), (0.8, 1.2, 0.72))
    floor = body("Floor", "Floor", (0.0, 0.0, -0.05), (3.0, 4.0, 0.1))
    world = World(iri=Iri("http://x.org#m"), bodies=(*parts, cup, table, floor))
    shown = (*parts, cup, table)
    points = corners(pose_array(each.pose for each in shown), np.array([each.size for each in shown]))
    assert np.abs(in_picture(view_of(world), points, 1.2)).max() < 0.95


def test_the_camera_keeps_a_minimum_distance() -> None:
    tiny = World(iri=Iri("http://x.org#m"), bodies=(body("a", "Mug", (0.0, 0.0, 0.0), (0.01, 0.01, 0.01)),))
    view = view_of(tiny)
    assert 0.3 < np.linalg.norm(np.subtract(view.position, view.look_at)) < 2.0


def test_an_empty_world_has_an_initial_camera() -> None:
    assert np.isfinite(view_of(World(iri=Iri("http://x.org#m"))).position).all()


def test_the_ground_is_below_all_bodies_unless_there_is_a_floor() -> None:
    def ground(world: World) -> float | None:
        return ground_height(world, appearances_of(world))

    bare = replace(kitchenette(), bodies=tuple(body_ for body_ in kitchenette().bodies if body_.id != "Floor"))
    assert ground(kitchenette()) is None
    assert ground(bare) == pytest.approx(0.0)
    assert ground(more(bare, body("Pit", "Panorama", (0.0, 0.0, 0.0), (99.0, 99.0, 99.0)))) == pytest.approx(0.0)
    assert ground(World(iri=Iri("http://x.org#m"))) == 0.0


# -- the first view of pictures ----------------------------------------------------------------------------------------


def projected(view: CameraPose, points: np.ndarray, aspect: float) -> np.ndarray:
    """Positions of points in a picture of that height 1, from 0 to aspect and from 0 to 1."""
    return ViewFrame(view, (round(1000 * aspect), 1000)).project(points)[:, :2] / 1000


def beside_a_wall(x: float) -> World:
    return more(kitchenette(), body("Wall", "Wall", (x, 0.5, 1.25), (0.1, 8.0, 2.5)))


@pytest.mark.parametrize("aspect", [1.0, 1.6])
def test_the_wall_behind_the_furniture_is_not_cut_above_it(aspect: float) -> None:
    world = beside_a_wall(2.3)
    target = initial_target(world, appearances_of(world))
    assert target.surroundings is not None
    view = target.upright_camera(aspect)
    seen = projected(view, np.concatenate([target.points, target.surroundings]), aspect)
    assert seen.min() > 0
    assert np.all(seen.max(axis=0) < (aspect, 1.0))
    assert np.ptp(target.surroundings[:, 1]) < 4.0, "only the part of the wall near the furniture is framed"


def test_a_wall_that_turns_its_back_to_the_camera_is_not_framed() -> None:
    world = beside_a_wall(1.35)
    target = initial_target(world, appearances_of(world))
    assert np.cos(target.azimuth_rad) < 0, "the camera is behind the wall"
    assert target.surroundings is None


def in_an_outline(*others: Body) -> World:
    """A hall whose walls are one body, which is drawn as an outline, with a door in one of them."""
    hall = body("Hall", "Room", (0.0, 0.0, 2.0), (8.0, 8.0, 4.0))
    frame = body("Frame", "DoorFrame", (4.0, 1.0, 1.05), (0.14, 1.2, 2.1))
    return more(kitchenette(), hall, frame, *others)


def culled_of(world: World) -> set[str]:
    return set(find_culled(world, appearances_of(world), (6.0, -6.0, 4.0)))


def test_a_door_frame_does_not_stand_alone_where_its_wall_is_an_outline() -> None:
    assert "Frame" in culled_of(in_an_outline())
    wall = body("Wall", "Wall", (-4.0, 1.0, 2.0), (0.1, 8.0, 4.0))
    moved = in_an_outline(wall)
    at_wall = [replace(each, pose=Pose((-4.0, 1.0, 1.05))) if each.id == "Frame" else each for each in moved.bodies]
    assert "Frame" not in culled_of(replace(moved, bodies=tuple(at_wall)))


def test_doors_of_furniture_are_drawn_in_an_outline_too() -> None:
    wardrobe = body("Wardrobe", "Cupboard", (3.6, -2.0, 1.0), (0.6, 1.0, 2.0))
    door = body("WardrobeDoor", "Door", (3.29, -2.0, 1.0), (0.02, 1.0, 2.0))
    assert not {"Wardrobe", "WardrobeDoor"} & culled_of(in_an_outline(wardrobe, door))


def test_a_door_frame_is_drawn_where_there_are_no_walls_at_all() -> None:
    world = more(kitchenette(), body("Frame", "DoorFrame", (4.0, 1.0, 1.05), (0.14, 1.2, 2.1)))
    assert "Frame" not in culled_of(world)
