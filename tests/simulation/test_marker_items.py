"""Markers in pictures: every kind is drawn, where it is and in its color."""

from __future__ import annotations

import numpy as np
import pytest

import mindstage as ms
from mindstage.rendering import Screenshot
from mindstage.rendering.camera import corners
from mindstage.rendering.render_scene import RenderItem
from mindstage.scene import BodyId, Pose, VisualMesh
from mindstage.scene.transforms import normalized_pose_array, pose_array, quat_rotate
from mindstage.simulation import Marker, MarkerType
from mindstage.simulation.marker_items import marker_items, marker_labels
from tests.kitchenette import kitchenette

QUARTER = Pose((1.0, 2.0, 3.0), (0.5**0.5, 0.0, 0.0, 0.5**0.5))
"""Turned by 90 degrees about z."""
WITHOUT_TEXT = [type for type in MarkerType if type is not MarkerType.TEXT]


def copied() -> dict[BodyId, tuple[VisualMesh, ...]]:
    (cube,) = marker_items([Marker(id="cube", type=MarkerType.CUBE, size=(0.4, 0.2, 0.1))], {})
    return {BodyId("Mug"): cube.visuals}


def item_of(type: MarkerType, **fields: object) -> RenderItem:
    marker = {"id": "m", "type": type, "size": (0.4, 0.2, 0.1), "color": (1.0, 0.0, 0.0), "body": "Mug"} | fields
    (item,) = marker_items([Marker(**marker)], copied())
    return item


def extents(item: RenderItem) -> np.ndarray:
    """The lower and the upper corner in the world frame."""
    pose = normalized_pose_array(item.pose)
    points = np.concatenate([quat_rotate(pose[3:], each.points) + pose[:3] for each in item.visuals])
    return np.array([points.min(axis=0), points.max(axis=0)])


@pytest.mark.parametrize("type", [MarkerType.CUBE, MarkerType.SPHERE, MarkerType.BODY_COPY])
def test_shapes_have_the_size_and_the_pose_of_the_marker(type: MarkerType) -> None:
    expected = np.array([[0.9, 1.8, 2.95], [1.1, 2.2, 3.05]])
    np.testing.assert_allclose(extents(item_of(type, pose=QUARTER)), expected, atol=1e-3)


def test_an_arrow_begins_at_its_origin() -> None:
    np.testing.assert_allclose(extents(item_of(MarkerType.ARROW, pose=QUARTER))[:, 1], [2.0, 2.4], atol=1e-3)


@pytest.mark.parametrize("type", [MarkerType.LINE_STRIP, MarkerType.LINE_LIST, MarkerType.POINTS])
def test_lines_and_points_are_in_the_frame_of_the_marker(type: MarkerType) -> None:
    item = item_of(type, pose=QUARTER, size=(0.02, 0.0, 0.0), points=((1.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    np.testing.assert_allclose(extents(item), [[1.0, 3.0, 3.0], [1.0, 4.0, 3.0]], atol=0.011)
    boxes = corners(pose_array([item.pose]), np.array([item.size]))
    np.testing.assert_allclose([boxes.min(axis=0), boxes.max(axis=0)], extents(item), atol=1e-9)


def test_a_strip_joins_all_points_and_a_list_each_pair() -> None:
    points = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (2.0, 1.0, 0.0))
    bars = [len(item_of(type, points=points).visuals[0].faces) // 12 for type in (MarkerType.LINE_STRIP, "line_list")]
    assert bars == [3, 2]


def test_points_have_their_own_colors() -> None:
    colors = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    item = item_of(MarkerType.POINTS, points=((0.0, 0.0, 0.0),) * 3, colors=colors)
    assert {mesh.material.color: len(mesh.faces) // 8 for mesh in item.visuals} == {colors[0]: 2, colors[1]: 1}


def test_what_is_invisible_is_left_out() -> None:
    invisible = [
        Marker(id="0", type=MarkerType.CUBE, opacity=0.0),
        Marker(id="1", type=MarkerType.LINE_STRIP, points=((0.0, 0.0, 0.0),)),
        Marker(id="2", type=MarkerType.POINTS),
        Marker(id="3", type=MarkerType.BODY_COPY, body="nothing"),
        Marker(id="4", type=MarkerType.TEXT),
        Marker(id="5", type=MarkerType.TEXT, text="seen", opacity=0.0),
    ]
    assert not [*marker_items(invisible, {}), *marker_labels(invisible)]


@pytest.mark.parametrize("type", MarkerType)
def test_a_picture_shows_every_kind_of_marker(type: MarkerType) -> None:
    line = ((-0.2, 0.0, 0.0), (0.2, 0.0, 0.0))
    marker = Marker(
        id="m",
        type=type,
        pose=Pose((0.0, 0.0, 1.0)),
        size=(0.3, 0.3, 0.3) if type not in {"line_strip", "line_list", "points"} else (0.05, 0.0, 0.0),
        color=(1.0, 0.0, 1.0),
        points=line,
        text="marker",
        body="Mug",
    )
    view = Screenshot(size=(160, 100), position=(0.0, -2.0, 1.5), look_at=(0.0, 0.0, 1.0))
    with ms.open((), engine="null") as sim:
        sim.spawn(kitchenette())
        before = ms.shot(sim, screenshot=view)
        sim.markers.add([marker])
        after = ms.shot(sim, screenshot=view)
        changed = np.any(before != after, axis=2)
        sim.markers.remove(["m"])
        assert np.array_equal(ms.shot(sim, screenshot=view), before)
    assert changed[30:70, 50:110].sum() > 10, "it is in the middle"
    if type is not MarkerType.TEXT:
        red, green, blue = after[changed].astype(float).mean(axis=0)
        assert min(red, blue) > green + 20
