"""Markers on the page, by what a visitor sees in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import Simulation
from mindstage.scene import BodyId, Color, Pose
from mindstage.scene.colors import COLORS
from mindstage.simulation import Marker, MarkerType
from mindstage.viewer import Viewer
from mindstage.viewer.appearance import merge_visuals
from mindstage.viewer.camera import CameraPose
from tests.kitchenette import kitchenette
from tests.viewer.viewing import ViewTab, open_views
from tests.viewer.waiting import wait_until

Looking = Callable[[Viewer], ViewTab]
RED, BLUE = COLORS["red"], COLORS["blue"]
BEFORE_THEM = CameraPose((-1.6, -0.6, 1.7), (1.2, 0.2, 1.2), 0.7)
IN_FRONT = Pose((1.2, 0.3, 1.2))


@pytest.fixture
def look(browser: Any) -> Iterator[Looking]:
    with open_views(browser) as look:
        yield look


def seen(visitor: ViewTab, color: Color) -> int:
    """How many pixels are of about that hue, in whatever light."""
    pixels = visitor.pixels().astype(float)
    strength = np.linalg.norm(pixels, axis=2)
    likeness = (pixels @ (np.array(color) / np.linalg.norm(color))) / np.maximum(strength, 1.0)
    return int(np.sum((likeness > 0.97) & (strength > 60.0)))


def test_markers_are_seen_change_move_and_go(stage: Simulation, viewport: Viewer, look: Looking) -> None:
    points = ((0.0, -0.2, 0.0), (0.0, 0.2, 0.0))
    for number, form in enumerate(MarkerType):
        pose = Pose((1.2, 0.25 * number - 0.75, 1.3))
        stage.add_markers(
            [Marker(id=f"a/{form.value}", type=form, pose=pose, color=RED, points=points, text="I plan", body="Mug")]
        )
    visitor = look(viewport)
    viewport.views.set_camera(BEFORE_THEM)
    wait_until(lambda: seen(visitor, RED) > 100, "who comes late sees them")
    assert set(viewport._markers._nodes) == {f"a/{form.value}" for form in MarkerType}
    line = Marker(id="line", type=MarkerType.LINE_STRIP, pose=IN_FRONT, size=(0.1, 0.1, 0.1), color=BLUE, points=points)
    stage.add_markers([line])
    wait_until(lambda: seen(visitor, BLUE) > 100, "a line has the colour that was asked for")
    stage.add_markers([replace(line, pose=Pose((1.2, 0.3, 100.0)))])
    wait_until(lambda: seen(visitor, BLUE) == 0, "it is far away")
    stage.remove_markers([marker.id for marker in stage.state.markers])
    wait_until(lambda: seen(visitor, RED) == 0, "all are gone")


def test_what_cannot_be_seen_is_no_fault(stage: Simulation, viewport: Viewer) -> None:
    for form in MarkerType:
        stage.add_markers([Marker(id=f"{form.value} of nothing", type=form, size=(0.0, 0.0, 0.0))])
        stage.add_markers([Marker(id=f"{form.value} of glass", type=form, opacity=0.0, points=((0.0, 0.0, 0.0),))])
    stage.add_markers([Marker(id="turned by nothing", type=MarkerType.CUBE, pose=Pose((0, 0, 0), (0, 0, 0, 0)))])
    frame = stage.state
    wait_until(lambda: viewport._frame is not None and viewport._frame.markers is frame.markers, "the page follows")
    assert not viewport._last_error


def test_a_ghost_looks_like_its_body_as_long_as_that_is_there(stage: Simulation, viewport: Viewer) -> None:
    def vertices() -> int:
        node = viewport._markers._nodes.get("soon")
        return len(node.vertices) if node is not None else 0

    stage.add_markers(
        [Marker(id="soon", type=MarkerType.BODY_COPY, body="Mug", pose=IN_FRONT, color=BLUE, opacity=0.4)]
    )
    wait_until(vertices, "the ghost is shown")
    assert vertices() == len(merge_visuals(stage.geometry[BodyId("Mug")].visuals).points)
    stage.run_on_engine(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    wait_until(lambda: not vertices(), "it goes with its body")
    stage.spawn(replace(kitchenette(), bodies=(kitchenette().body("Mug"),), joints=(), attachments=()))
    wait_until(vertices, "and comes back with it")
