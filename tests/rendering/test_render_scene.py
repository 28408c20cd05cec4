"""What a picture leaves out: what is mounted on walls that are not drawn; and what stands for unknown things."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage import KnowledgeBase
from mindstage.rendering.appearance import merge_visuals
from mindstage.rendering.camera import CameraPose, ViewFrame
from mindstage.rendering.rasterizer import render_picture
from mindstage.rendering.render_scene import RenderScene, render_scene
from mindstage.scene import Attachment, Body, BodyId, BodyPhysics, Iri, Material, Mobility, Pose, Vector, World
from tests.cases import each_case
from tests.kitchenette import KNOWROB

KNOWLEDGE = KnowledgeBase()
EYE: Vector = (6.0, -6.0, 4.0)
LOW_EYE: Vector = (2.0, -2.0, 1.4)
"""Within the room."""
SIZE = (320, 240)


def body(id: str, cls: str, at: Vector, size: Vector | None, mobility: Mobility | None = Mobility.STATIC) -> Body:
    iri, kind = Iri(f"http://x.org#{id}"), Iri(cls if ":" in cls else f"{KNOWROB}{cls}")
    return Body(id=BodyId(id), iri=iri, cls=kind, pose=Pose(at), size=size, physics=BodyPhysics(mobility=mobility))


FLOOR = body("floor", "Floor", (0.0, 0.0, -0.05), (6.0, 6.0, 0.1))
TABLE = body("table", "Table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8))
WALL = body("wall", "Wall", (3.05, 0.0, 1.25), (0.1, 6.0, 2.5))
"""Between the camera and the room."""
CUPBOARD = body("cupboard", "Cupboard", (2.62, 1.5, 0.9), (0.72, 1.0, 1.8))
"""In front of the wall, 2 cm from it."""
PLATE: Vector = (0.01, 0.5, 0.3)
UNKNOWN = "http://x.org#Qwertz"


def scene_of(*bodies: Body, eye: Vector = EYE, attachments: tuple[Attachment, ...] = ()) -> RenderScene:
    world = World(iri=Iri("http://x.org#map"), bodies=bodies, attachments=attachments)
    camera = CameraPose(eye, (0.0, 0.0, 0.5), 0.8)
    return render_scene(world, {}, KNOWLEDGE, camera=camera)


def drawn(*bodies: Body, eye: Vector = EYE, attachments: tuple[Attachment, ...] = ()) -> set[str]:
    return {item.id for item in scene_of(*bodies, eye=eye, attachments=attachments).items if item.shown}


# -- what is mounted on a wall that is not drawn -----------------------------------------------------------------------


@each_case("cls", ["Picture", UNKNOWN, "Radiator"])
@each_case("mobility", [Mobility.STATIC, Mobility.KINEMATIC, None])
def test_what_is_flat_against_a_culled_wall_is_culled_with_it(cls: str, mobility: Mobility | None) -> None:
    # It touches the cupboard, which stands on the floor, and no attachment is stated.
    plate = body("plate", cls, (2.99, 0.8, 1.5), PLATE, mobility)
    assert drawn(FLOOR, TABLE, WALL, CUPBOARD, plate) == {"floor", "table", "cupboard"}
    assert drawn(FLOOR, TABLE, WALL, CUPBOARD, plate, eye=LOW_EYE) == {"floor", "table", "wall", "cupboard", "plate"}


@each_case(
    ("at", "size", "mobility", "why"),
    [
        ((2.99, 0.8, 1.5), PLATE, Mobility.DYNAMIC, "it is loose"),
        ((2.6, 0.99, 1.5), (0.5, 0.01, 0.3), Mobility.STATIC, "it is on the side of the cupboard"),
        ((2.84, 0.8, 1.5), (0.3, 0.5, 0.3), Mobility.STATIC, "it is not flat"),
    ],
)
def test_other_bodies_at_a_culled_wall_are_drawn(at: Vector, size: Vector, mobility: Mobility, why: str) -> None:
    assert "it" in drawn(FLOOR, TABLE, WALL, CUPBOARD, body("it", UNKNOWN, at, size, mobility)), why


@each_case(
    ("at", "size", "why"),
    [
        ((2.9, -1.0, 1.5), PLATE, "upright, at the side of the room"),
        ((2.9, -1.0, 1.5), (0.5, 0.01, 0.3), "whichever way it faces"),
        ((0.0, 0.0, 2.6), (0.3, 0.3, 0.03), "lying, above all furniture"),
    ],
)
def test_static_flat_bodies_do_not_hang_in_the_air_where_the_map_has_no_walls(
    at: Vector, size: Vector, why: str
) -> None:
    assert "it" not in drawn(FLOOR, TABLE, CUPBOARD, body("it", UNKNOWN, at, size)), why


@each_case(
    ("at", "size", "mobility", "why"),
    [
        ((2.9, -1.0, 1.5), PLATE, Mobility.DYNAMIC, "it is loose"),
        ((2.9, -1.0, 1.5), PLATE, None, "the map does not state that it is fixed: it may be perceived"),
        ((0.3, 0.0, 0.95), PLATE, Mobility.STATIC, "it stands on the table"),
        ((2.9, -1.0, 0.15), PLATE, Mobility.STATIC, "it stands on the floor"),
        ((2.6, 0.99, 1.5), (0.5, 0.01, 0.3), Mobility.STATIC, "it is on the side of the cupboard"),
        ((2.9, -1.0, 1.2), (0.3, 0.3, 0.03), Mobility.STATIC, "it is not above the furniture: a board"),
    ],
)
def test_other_flat_bodies_are_drawn(at: Vector, size: Vector, mobility: Mobility | None, why: str) -> None:
    assert "it" in drawn(FLOOR, TABLE, CUPBOARD, body("it", UNKNOWN, at, size, mobility)), why


def test_doors_and_drawers_without_their_cupboard_are_drawn() -> None:
    assert "front" in drawn(FLOOR, TABLE, body("front", "Drawer", (2.0, 1.0, 0.9), (0.02, 0.5, 0.3)))


def test_a_poster_and_its_frame_are_drawn_or_left_out_together() -> None:
    frame = body("frame", UNKNOWN, (-2.9, 0.0, 1.6), (0.02, 0.8, 1.0))
    poster = body("poster", UNKNOWN, (-2.9, 0.0, 1.6), (0.0, 0.75, 0.95))
    plant = body("plant", "Plant", (-2.8, 0.2, 1.2), (0.2, 0.2, 0.3))
    hung = (Attachment(parent=frame.id, child=poster.id),)
    assert not {"frame", "poster"} & drawn(FLOOR, TABLE, frame, poster, plant, attachments=hung), "a plant is at it"
    wall = replace(WALL, pose=Pose((-2.96, 0.0, 1.25)))
    assert {"frame", "poster", "wall"} <= drawn(FLOOR, TABLE, wall, frame, poster, plant, attachments=hung)


def test_what_stands_on_the_sill_of_a_window_is_left_out_with_it() -> None:
    hall = body("hall", UNKNOWN, (0.0, 0.0, 2.0), (6.2, 6.2, 4.2))
    sky = body("sky", UNKNOWN, (0.0, 0.0, 0.0), (90.0, 90.0, 90.0))
    window = body("window", "Window", (2.9, 0.0, 1.5), (0.3, 1.5, 1.2))
    plant = body("plant", "Plant", (2.7, 0.0, 1.1), (0.15, 0.15, 0.3), Mobility.KINEMATIC)
    shelf = body("shelf", "Cupboard", (-2.9, 0.0, 1.6), (0.4, 1.0, 0.5))
    shown = drawn(FLOOR, TABLE, hall, sky, window, plant, shelf)
    assert not {"window", "plant"} & shown
    assert {"table", "shelf"} <= shown, "a wall cupboard hangs on the outlined wall"


def picture(scene: RenderScene) -> NDArray[np.uint8]:
    return render_picture(replace(scene, lights=()), SIZE)


def test_nothing_that_is_not_drawn_casts_a_shadow() -> None:
    lamp = body("lamp", "CeilingLight", (0.0, 0.0, 2.6), (1.0, 1.0, 0.1))
    plate = body("plate", UNKNOWN, (2.99, -0.5, 1.5), (0.02, 2.0, 1.6))
    scene = scene_of(FLOOR, TABLE, WALL, lamp, plate)
    hidden = {item.id for item in scene.items if not item.shown}
    assert hidden == {"wall", "lamp", "plate"}
    absent = replace(scene, items=tuple(item for item in scene.items if item.shown))
    assert np.array_equal(picture(scene), picture(absent))
    casting = replace(scene, items=tuple(replace(item, shown=True) for item in scene.items))
    assert np.abs(picture(casting).astype(int) - picture(absent)).max() > 40, "what the test is to notice"


# -- unknown things ----------------------------------------------------------------------------------------------------


def schematic(cls: str = UNKNOWN, size: Vector | None = (0.4, 0.4, 0.4)) -> RenderScene:
    return scene_of(FLOOR, body("it", cls, (0.0, 0.0, 0.25), size), eye=(1.2, -0.6, 0.6))


def pixels(image: NDArray[np.uint8], scene: RenderScene, point: Vector, reach: int = 6) -> NDArray[np.float64]:
    x, y, _ = ViewFrame(scene.camera, SIZE).project(np.array([point]))[0].round().astype(int).tolist()
    return image[y - reach : y + reach + 1, x - reach : x + reach + 1].astype(float)


def test_an_unknown_class_is_a_translucent_box_with_its_name() -> None:
    scene = schematic()
    image = picture(scene)
    empty = picture(replace(scene, items=scene.items[:1]))
    label = pixels(image, scene, (0.2, 0.0, 0.25))
    assert label.max() > 200, "paper"
    assert label.min() < 120, "letters"
    beside = pixels(image, scene, (0.2, 0.0, 0.4), reach=2)
    assert np.ptp(beside, axis=(0, 1)).max() < 40, "no letters beside the label"
    behind = pixels(empty, scene, (0.2, 0.0, 0.4), reach=2)
    assert 2.0 < np.abs(beside.mean() - behind.mean()) < 80.0, "the floor is seen through the box"
    assert np.ptp(beside.mean(axis=(0, 1))) < 30.0, "it is gray"


def test_the_written_class_is_that_of_the_body() -> None:
    images = [next(each.image for each in schematic(cls).items[1].visuals if each.image is not None)
              for cls in (UNKNOWN, UNKNOWN, "http://x.org#Uiop")]  # fmt: skip
    assert images[0] is not None
    assert images[2] is not None
    assert images[0] is images[1]
    assert not np.array_equal(images[0], images[2])


def test_schematic_boxes_cast_no_shadow() -> None:
    scene = schematic()
    empty = picture(replace(scene, items=scene.items[:1]))
    shadowless = pixels(picture(scene), scene, (-0.35, 0.25, 0.0), reach=3)
    assert shadowless.mean() == pytest.approx(pixels(empty, scene, (-0.35, 0.25, 0.0), reach=3).mean(), abs=12.0)


@each_case("cls", ["Table", "Cup", "Wall", "http://x.org#BlueMug"])
def test_known_classes_and_words_are_no_schematic_boxes(cls: str) -> None:
    assert all(visual.image is None and visual.material.opacity == 1.0 for visual in schematic(cls).items[1].visuals)


def test_the_color_of_the_map_tints_the_box() -> None:
    red = replace(
        body("it", UNKNOWN, (0.0, 0.0, 0.25), (0.4, 0.4, 0.4)), materials=(Material(name="red", color=(0.9, 0.1, 0.1)),)
    )
    scene = scene_of(FLOOR, red, eye=(1.2, -0.6, 0.6))
    beside = pixels(picture(scene), scene, (0.2, 0.0, 0.4), reach=2).mean(axis=(0, 1))
    assert beside[0] > beside[1] + 15.0


@each_case("cls", [UNKNOWN, "Cup"])
def test_a_body_without_a_size_is_a_small_marker(cls: str) -> None:
    item = schematic(cls, None).items[1]
    points = merge_visuals(item.visuals).points
    assert np.ptp(points, axis=0).max() == pytest.approx(0.04)
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(0.02, rel=0.05), "a ball"
