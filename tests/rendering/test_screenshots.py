"""The camera and the labels of a picture, by what it is asked to show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase
from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.rendering.appearance import compute_appearance
from mindstage.rendering.camera import CameraPose, ViewFrame, initial_target
from mindstage.rendering.screenshot import LabelMode, Screenshot, label_texts, placed_camera, screenshot_camera
from mindstage.scene import BodyId, Pose, Vector, World
from tests.kitchenette import kitchenette

KNOWLEDGE = KnowledgeBase()
WORLD = kitchenette()
APPEARANCES = compute_appearance(WORLD, KNOWLEDGE.shape_rule, KNOWLEDGE.ancestors)
POSES: Mapping[BodyId, Pose] = {body.id: body.pose for body in WORLD.bodies}
TARGET = initial_target(WORLD, APPEARANCES)
MUG, FRIDGE = BodyId("Mug"), BodyId("Fridge")


def camera(poses: Mapping[BodyId, Pose] = POSES, **shown: Any) -> CameraPose:
    return screenshot_camera(Screenshot(**shown), WORLD, APPEARANCES, poses)


def seen(view: CameraPose, point: Vector) -> np.ndarray:
    """Where a point is in the picture, from -1 to 1 to the right and up, and its distance."""
    x, y, depth = ViewFrame(view, (1280, 800)).project(np.array([point]))[0]
    return np.array([x / 640 - 1, 1 - y / 400, depth])


def test_focused_bodies_are_in_the_middle_where_they_are_now() -> None:
    home = TARGET.camera(1.6)
    view = camera(focus=(MUG,))
    assert np.abs(seen(view, WORLD.body("Mug").pose.position)[:2]).max() < 0.2
    direction, before = np.subtract(view.position, view.look_at), np.subtract(home.position, home.look_at)
    assert direction @ before == pytest.approx(np.linalg.norm(direction) * np.linalg.norm(before), rel=1e-3)
    moved = camera({**POSES, MUG: Pose((0.0, -2.0, 0.05))}, focus=(MUG,))
    assert np.abs(seen(moved, (0.0, -2.0, 0.05))[:2]).max() < 0.2
    both = camera(focus=(MUG, FRIDGE))
    assert seen(both, WORLD.body("Fridge").pose.position)[2] > seen(view, WORLD.body("Mug").pose.position)[2]
    for id in (MUG, FRIDGE):
        assert np.abs(seen(both, WORLD.body(id).pose.position)[:2]).max() < 1.0
    with pytest.raises(BodyNotFoundError, match="'Mugg' in 'map'; near: 'Mug'"):
        camera(focus=(MUG, BodyId("Mugg")))


def test_focused_points_are_in_the_picture() -> None:
    points = ((0.0, 0.0, 0.0), (0.0, 2.0, 1.0))
    view = camera(focus_points=points)
    assert all(np.abs(seen(view, point)[:2]).max() < 1.0 for point in points)
    assert view.look_at == pytest.approx((0.0, 1.0, 0.5), abs=0.4)


def test_other_views_are_from_above_as_given_or_the_first_one() -> None:
    assert camera(from_above=True) == TARGET.top_camera(1.6)
    assert camera() == TARGET.upright_camera(1.6)
    assert camera(size=(400, 800)) == TARGET.upright_camera(0.5)
    given = camera(position=(5.0, 6.0, 7.0), look_at=(1.0, 2.0, 3.0))
    assert (given.position, given.look_at) == ((5.0, 6.0, 7.0), (1.0, 2.0, 3.0))
    empty = screenshot_camera(Screenshot(position=(5.0, 6.0, 7.0)), World(iri=WORLD.iri), {}, {})
    assert empty.position == (5.0, 6.0, 7.0)


DEFAULT = CameraPose((1.0, 2.0, 3.0), (4.0, 2.0, 1.0), 0.5)


@pytest.mark.parametrize(
    ("position", "look_at", "expected"),
    [
        (None, None, ((1.0, 2.0, 3.0), (4.0, 2.0, 1.0))),
        ((0.0, 0.0, 5.0), None, ((0.0, 0.0, 5.0), (4.0, 2.0, 1.0))),
        # the camera moves with the point that it looks at
        (None, (5.0, 3.0, 2.0), ((2.0, 3.0, 4.0), (5.0, 3.0, 2.0))),
        ((0.0, 0.0, 5.0), (5.0, 3.0, 2.0), ((0.0, 0.0, 5.0), (5.0, 3.0, 2.0))),
    ],
)
def test_a_missing_point_is_that_of_the_default(
    position: Vector | None, look_at: Vector | None, expected: tuple[Vector, Vector]
) -> None:
    found = placed_camera(Screenshot(position=position, look_at=look_at), DEFAULT)
    assert (found.position, found.look_at) == expected
    assert found.field_of_view_rad == 0.5


def test_a_camera_straight_above_is_moved_a_little_so_that_it_has_an_upper_edge() -> None:
    found = placed_camera(Screenshot(position=(1.0, 1.0, 11.0), look_at=(1.0, 1.0, 1.0)), DEFAULT)
    x, y, z = found.position
    assert (x, z) == (1.0, 11.0)
    assert -0.2 < y - 1.0 < 0.0


@pytest.mark.parametrize(
    ("shown", "message"),
    [
        ({"size": (0, 100)}, "size 0: it must be an integer from 1 to 8192"),
        ({"size": (100, 99_999)}, "size 99999: it must be an integer from 1 to 8192"),
        ({"position": (1.0, 2.0, 3.0), "look_at": (1.0, 2.0, 3.0)}, "position and look_at are equal"),
    ],
)
def test_an_impossible_picture_is_refused(shown: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        Screenshot(**shown)


def test_labels_are_those_of_the_mode() -> None:
    world = replace(
        WORLD, bodies=tuple(replace(each, label="My mug") if each.id == MUG else each for each in WORLD.bodies)
    )

    def texts(mode: LabelMode, selected: BodyId | None = None) -> dict[BodyId, str]:
        return label_texts(Screenshot(labels=mode, selected=selected), world, APPEARANCES)

    every = texts(LabelMode.ALL)
    assert every.keys() == POSES.keys()
    assert (every[MUG], every[FRIDGE]) == ("My mug", "Refrigerator")
    assert list(every)[:2] == ["Floor", FRIDGE], "the largest ones first"
    handle = BodyId("DrawerHandle")
    assert texts(LabelMode.SELECTED, MUG) == {MUG: "My mug"}
    assert texts(LabelMode.CLASS, handle) == {handle: "Handle", "FridgeHandle": "Handle"}
    assert texts(LabelMode.SELECTED) == texts(LabelMode.CLASS) == texts(LabelMode.NONE, MUG) == {}
    assert texts(LabelMode.SELECTED, BodyId("gone")) == {}
