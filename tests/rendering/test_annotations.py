"""Outlines and labels in pictures, and where a camera sees points: truths by hand, on pictures of one gray."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mindstage.rendering.annotations import Outline, annotate
from mindstage.rendering.camera import CameraPose, ViewFrame
from mindstage.rendering.render_scene import RenderLabel, RenderScene
from mindstage.scene import BodyId, Vector
from tests.cases import each_case

WIDTH, HEIGHT = 160, 120
CAMERA = CameraPose((0.0, -10.0, 1.0), (0.0, 0.0, 1.0), math.radians(60))
"""It looks along y; x is to the right, z up. At a distance of 10 m the picture is 2 * 10 * tan(30 degrees) high."""
VIEW = ViewFrame(CAMERA, (WIDTH, HEIGHT))
FAR = np.full((HEIGHT, WIDTH), 100.0)
PX_PER_M = HEIGHT / (20 * math.tan(math.radians(30)))
"""At a distance of 10 m."""
GRAY = np.full((HEIGHT, WIDTH, 3), 100, dtype=np.uint8)


def scene(*labels: RenderLabel) -> RenderScene:
    return RenderScene(items=(), lights=(), ground_height=None, camera=CAMERA, labels=labels)


def label(text: str, point: Vector, radius: float = 0.1) -> RenderLabel:
    return RenderLabel(text=text, point=point, id=BodyId(text), radius=radius)


def boxes(picture: NDArray[np.uint8]) -> list[tuple[int, int, int, int]]:
    """The extents of what is almost white, one below the other: left, upper, right, lower."""
    rows, columns = np.nonzero((picture > 200).all(axis=2))
    found = []
    for group in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1):
        if len(group):
            found.append((columns[group].min(), rows[group].min(), columns[group].max(), rows[group].max()))
    return [(int(a), int(b), int(c), int(d)) for a, b, c, d in found]


def mask(left: int, upper: int, right: int, lower: int) -> NDArray[np.bool_]:
    found = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    found[upper:lower, left:right] = True
    return found


# -- the camera --------------------------------------------------------------------------------------------------------


@each_case(
    ("camera", "point", "expected"),
    [
        (CAMERA, (0.0, 0.0, 1.0), (80.0, 60.0, 10.0)),
        (CAMERA, (1.0, 0.0, 1.0), (80.0 + PX_PER_M, 60.0, 10.0)),
        (CAMERA, (0.0, 0.0, 2.0), (80.0, 60.0 - PX_PER_M, 10.0)),
        (CAMERA, (0.0, 10.0, 2.0), (80.0, 60.0 - PX_PER_M / 2, 20.0)),
        (CAMERA, (0.0, -12.0, 1.0), (80.0, 60.0, -2.0)),
        # from above: the upper edge is north, and x is to the right
        (CameraPose((0.0, 0.0, 11.0), (0.0, 0.0, 0.0), math.radians(60)), (1.0, 0.0, 1.0), (80 + PX_PER_M, 60, 10)),
        (CameraPose((0.0, 0.0, 11.0), (0.0, 0.0, 0.0), math.radians(60)), (0.0, 1.0, 1.0), (80, 60 - PX_PER_M, 10)),
        # from the other side, x is to the left
        (CameraPose((0.0, 10.0, 1.0), (0.0, 0.0, 1.0), math.radians(60)), (1.0, 0.0, 1.0), (80 - PX_PER_M, 60, 10)),
    ],
)
def test_points_are_where_the_camera_sees_them(
    camera: CameraPose, point: Vector, expected: tuple[float, float, float]
) -> None:
    view = ViewFrame(camera, (WIDTH, HEIGHT))
    assert view.project(np.array([point]))[0] == pytest.approx(expected)
    # OpenGL's projection puts them at the same pixels, at depths from -1 to 1
    clip = view.clip_from_world(1.0, 50.0) @ (*point, 1.0)
    if expected[2] > 0.0:
        x, y, depth = clip[:3] / clip[3]
        assert ((x + 1) / 2 * WIDTH, (1 - y) / 2 * HEIGHT) == pytest.approx(expected[:2])
        assert clip[3] == pytest.approx(expected[2])
        assert depth == pytest.approx((51 - 100 / expected[2]) / 49)
    # and its ray goes there
    if expected[2] > 0.0:
        right, up, forward = view.ray_axes().T
        low, high = view.rise
        a, b = expected[0] / WIDTH * 2 - 1, high - expected[1] / HEIGHT * (high - low)
        assert view.eye + expected[2] * (a * right + b * up + forward) == pytest.approx(np.array(point))


def test_a_shifted_lens_moves_the_picture_and_keeps_its_height() -> None:
    shifted = ViewFrame(CameraPose(CAMERA.position, CAMERA.look_at, CAMERA.field_of_view_rad, 0.25), (WIDTH, HEIGHT))
    before, after = (view.project(np.array([(0.0, 0.0, 1.0), (1.0, 0.0, 2.0)])) for view in (VIEW, shifted))
    assert np.diff(after, axis=0) == pytest.approx(np.diff(before, axis=0))
    assert (after - before)[:, 0] == pytest.approx([0.0, 0.0])
    assert abs((after - before)[0, 1]) == pytest.approx(0.25 * HEIGHT)


# -- outlines ----------------------------------------------------------------------------------------------------------


def test_a_highlighted_body_is_tinted_outlined_and_all_others_are_dimmed() -> None:
    whole = mask(40, 40, 80, 80)
    visible = whole & mask(0, 0, 60, HEIGHT)
    green = annotate(GRAY, scene(), VIEW, FAR, [Outline(color=(0.0, 1.0, 0.0), visible=visible, whole=whole)])
    seen, hidden, other = (green[60, column].astype(int) for column in (50, 70, 120))
    assert seen[1] - seen[0] > 80, "what is seen has its color"
    assert 20 < hidden[1] - hidden[0] < seen[1] - seen[0], "what is hidden has less of it"
    assert np.ptp(other) == 0
    assert 100 < other[0] < 220, "gray gets brighter"
    for row, column in ((40, 60), (79, 60), (60, 40), (60, 79)):
        red, bright, blue = green[row, column].astype(int)
        assert bright > 200 > red + 60, "a line of its color around the whole"
        assert red == blue
    assert green[30, 60].tolist() == other.tolist(), "which is thin"


def test_a_selected_body_is_outlined_in_orange_and_nothing_is_dimmed() -> None:
    whole = mask(40, 40, 80, 80)
    picture = annotate(GRAY, scene(), VIEW, FAR, [Outline(color=None, visible=whole, whole=whole)])
    assert picture[60, 60].tolist() == picture[10, 10].tolist() == [100, 100, 100]
    red, green, blue = picture[40, 60].astype(int)
    assert red > 180 > green > blue
    both = Outline(color=(0.0, 1.0, 0.0), visible=whole, whole=whole, selected=True)
    red, green, blue = annotate(GRAY, scene(), VIEW, FAR, [both])[40, 60].astype(int)
    assert red > 180 > green > blue, "also if it is highlighted"


def test_all_of_several_bodies_are_outlined_each_in_its_color() -> None:
    areas = [mask(10, 40, 30, 80), mask(60, 40, 80, 80), mask(120, 40, 140, 80)]
    colors = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    outlines = [Outline(color=color, visible=area, whole=area) for area, color in zip(areas, colors, strict=True)]
    picture = annotate(GRAY, scene(), VIEW, FAR, outlines)
    for column, part in ((20, 0), (70, 1), (130, 2)):
        assert int(np.argmax(picture[60, column])) == int(np.argmax(picture[40, column])) == part


def test_a_body_at_the_edge_of_the_picture_is_outlined_there() -> None:
    whole = mask(0, 0, 20, 20)
    picture = annotate(GRAY, scene(), VIEW, FAR, [Outline(color=None, visible=whole, whole=whole)])
    assert picture.shape == GRAY.shape
    assert (picture[0, 5] != GRAY[0, 5]).any()
    assert picture[60, 60].tolist() == [100, 100, 100]


# -- labels ------------------------------------------------------------------------------------------------------------


def test_a_label_is_centered_at_its_body() -> None:
    picture = annotate(GRAY, scene(label("cup", (1.0, 0.0, 1.0))), VIEW, FAR, ())
    ((left, upper, right, lower),) = boxes(picture)
    assert (left + right) / 2 == pytest.approx(80 + PX_PER_M, abs=1.5)
    assert (upper + lower) / 2 == pytest.approx(60, abs=1.5)
    assert 16 <= lower - upper <= 22
    assert (picture[upper:lower, left:right] < 80).any(), "the text is dark"


def test_labels_at_one_point_cover_no_other_and_the_nearest_is_there() -> None:
    labels = [label("far", (0.0, 5.0, 1.0)), label("near", (0.0, -5.0, 1.0)), label("middle", (0.0, 0.0, 1.0))]
    ((left, upper, right, lower),) = boxes(annotate(GRAY, scene(*labels), VIEW, FAR, ()))
    ((a, first, b, last),) = boxes(annotate(GRAY, scene(labels[1]), VIEW, FAR, ()))
    height = last - first
    # the nearest one is at its point, and the two others are directly above and below
    assert (first - upper, lower - last) == pytest.approx((height, height), abs=3)
    assert left <= a < b <= right
    middle = annotate(GRAY, scene(labels[2]), VIEW, FAR, ())
    ((_, _, wide, _),) = boxes(middle)
    assert right == wide, "the word that is longest"


@each_case(
    ("point", "depth", "is_shown"),
    [
        ((0.0, 0.0, 1.0), 100.0, True),
        ((0.0, 0.0, 1.0), 9.9, True),  # its own front, 0.1 m before its center
        ((0.0, 0.0, 1.0), 9.8, False),  # something in front of it
        ((0.0, -12.0, 1.0), 100.0, False),  # behind the camera
        ((8.0, 0.0, 1.0), 100.0, False),  # to the right of the picture
        ((-8.0, 0.0, 1.0), 100.0, False),
        ((0.0, 0.0, 7.0), 100.0, False),  # above
        ((0.0, 0.0, -5.0), 100.0, False),  # below
    ],
)
def test_only_what_is_seen_is_labeled(point: Vector, depth: float, is_shown: bool) -> None:
    picture = annotate(GRAY, scene(label("cup", point)), VIEW, np.full((HEIGHT, WIDTH), depth), ())
    assert bool(boxes(picture)) == is_shown
    assert is_shown or (picture == GRAY).all()


@pytest.mark.parametrize("point", [(7.6, 0.0, 1.0), (-7.6, 0.0, 1.0)])
def test_a_label_at_the_edge_is_moved_into_the_picture(point: Vector) -> None:
    ((left, _, right, _),) = boxes(annotate(GRAY, scene(label("a long label", point)), VIEW, FAR, ()))
    assert left >= 1
    assert right <= WIDTH - 1
    assert right - left > 60


def test_more_labels_than_fit_are_left_out() -> None:
    labels = [label(f"cup {number}", (0.0, 0.1 * number, 1.0)) for number in range(12)]
    ((_, upper, _, lower),) = boxes(annotate(GRAY, scene(*labels), VIEW, FAR, ()))
    assert lower - upper == pytest.approx(5 * 20, abs=3), "120 px have room for five, of 20 px each"
