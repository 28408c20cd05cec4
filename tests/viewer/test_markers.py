"""Markers in a real browser, tested by the pixels of the view."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import Simulation
from mindstage.rendering.appearance import merge_visuals
from mindstage.rendering.camera import CameraPose
from mindstage.scene import BodyId, Color, Pose
from mindstage.scene.colors import COLORS
from mindstage.scene.edits import Delete
from mindstage.simulation import Marker, MarkerType
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.view_tab import ViewTab, open_views
from tests.viewer.waiting import wait_until

OpenView = Callable[[Viewer], ViewTab]
RED, BLUE = COLORS["red"], COLORS["blue"]
BEFORE_THEM = CameraPose((-1.6, -0.6, 1.7), (1.2, 0.2, 1.2), 0.7)
IN_FRONT = Pose((1.2, 0.3, 1.2))


@pytest.fixture
def open_view(browser: Any) -> Iterator[OpenView]:
    with open_views(browser) as open_view:
        yield open_view


def count_pixels(tab: ViewTab, color: Color) -> int:
    """The number of pixels of about that hue, in light or shade."""
    pixels = tab.pixels().astype(float)
    strength = np.linalg.norm(pixels, axis=2)
    likeness = (pixels @ (np.array(color) / np.linalg.norm(color))) / np.maximum(strength, 1.0)
    return int(np.sum((likeness > 0.97) & (strength > 60.0)))


def test_markers_are_drawn_changed_moved_and_removed(
    simulation: Simulation, viewer: Viewer, open_view: OpenView
) -> None:
    points = ((0.0, -0.2, 0.0), (0.0, 0.2, 0.0))
    for number, form in enumerate(MarkerType):
        pose = Pose((1.2, 0.25 * number - 0.75, 1.3))
        simulation.markers.add(
            [Marker(id=f"a/{form.value}", type=form, pose=pose, color=RED, points=points, text="I plan", body="Mug")]
        )
    tab = open_view(viewer)
    viewer.views.set_camera(BEFORE_THEM)
    wait_until(lambda: count_pixels(tab, RED) > 100, "a later client sees them")
    assert set(viewer._markers._nodes) == {f"a/{form.value}" for form in MarkerType}
    line = Marker(id="line", type=MarkerType.LINE_STRIP, pose=IN_FRONT, size=(0.1, 0.1, 0.1), color=BLUE, points=points)
    simulation.markers.add([line])
    wait_until(lambda: count_pixels(tab, BLUE) > 100, "the line has its color")
    simulation.markers.add([replace(line, pose=Pose((1.2, 0.3, 100.0)))])
    wait_until(lambda: count_pixels(tab, BLUE) == 0, "the line is out of view")
    simulation.markers.remove([marker.id for marker in simulation.state.markers])
    wait_until(lambda: count_pixels(tab, RED) == 0, "all markers are removed")


def test_invisible_markers_are_no_error(simulation: Simulation, viewer: Viewer) -> None:
    for form in MarkerType:
        simulation.markers.add([Marker(id=f"{form.value} of nothing", type=form, size=(0.0, 0.0, 0.0))])
        simulation.markers.add([Marker(id=f"{form.value} of glass", type=form, opacity=0.0, points=((0.0, 0.0, 0.0),))])
    simulation.markers.add([Marker(id="turned by nothing", type=MarkerType.CUBE, pose=Pose((0, 0, 0), (0, 0, 0, 0)))])
    frame = simulation.state
    wait_until(
        lambda: viewer._snapshot is not None and viewer._snapshot.markers is frame.markers, "the page is updated"
    )
    assert not viewer._logged_errors


def test_a_body_copy_looks_like_its_body_while_that_exists(simulation: Simulation, viewer: Viewer) -> None:
    def vertices() -> int:
        node = viewer._markers._nodes.get("soon")
        return len(node.vertices) if node is not None else 0

    simulation.markers.add(
        [Marker(id="soon", type=MarkerType.BODY_COPY, body="Mug", pose=IN_FRONT, color=BLUE, opacity=0.4)]
    )
    wait_until(vertices, "the copy is shown")
    assert vertices() == len(merge_visuals(simulation.geometry[BodyId("Mug")].visuals).points)
    simulation.engine.run(lambda engine: engine.apply(Delete((BodyId("Mug"),))), edits=True)
    wait_until(lambda: not vertices(), "the copy is removed with its body")
    simulation.spawn(replace(kitchenette(), bodies=(kitchenette().body("Mug"),), joints=(), attachments=()))
    wait_until(vertices, "the copy is shown again")


def test_lines_points_and_boxes_have_the_sizes_places_and_colors_of_their_markers(
    simulation: Simulation, viewer: Viewer
) -> None:
    quarter = Pose((1.0, 2.0, 3.0), (0.5**0.5, 0.0, 0.0, 0.5**0.5))
    points = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0))
    shared = {"pose": quarter, "color": RED, "points": points}
    simulation.markers.add(
        [
            Marker(id="strip", type=MarkerType.LINE_STRIP, size=(0.03, 0.0, 0.0), **shared),
            Marker(id="cloud", type=MarkerType.POINTS, size=(0.05, 0.05, 0.0), **shared),
            Marker(id="cube", type=MarkerType.CUBE, size=(0.1, 0.2, 0.3), pose=quarter, color=RED, opacity=0.5),
        ]
    )

    def node(id: str) -> Any:
        return viewer._server.scene.get_handle_by_name(f"/markers/{id}")

    wait_until(lambda: node("cube") and node("cloud") and node("strip"), "they are drawn")
    for id in ("strip", "cloud", "cube"):
        np.testing.assert_allclose(node(id).position, quarter.position)
        np.testing.assert_allclose(node(id).wxyz, quarter.quaternion)
    assert (node("strip").thickness, node("strip").thickness_units) == (pytest.approx(0.03), "world")
    np.testing.assert_allclose(node("strip").points, [points[:2], points[1:]])
    assert (node("cloud").point_size, len(node("cloud").points)) == (pytest.approx(0.05), 3)
    np.testing.assert_allclose(np.ptp(node("cube").vertices, axis=0), (0.1, 0.2, 0.3), atol=1e-6)
    assert node("cube").opacity == pytest.approx(0.5)
    for id in ("strip", "cloud"):
        red, green, blue = np.asarray(node(id).colors).reshape(-1, 3)[0].tolist()
        assert red > 150 > 100 > max(green, blue)
