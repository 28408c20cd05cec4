"""Markers on the page, by what a visitor sees in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import Stage
from mindstage.stage import Marker, MarkerForm
from mindstage.viewport import Viewport
from mindstage.viewport.framing import View
from mindstage.viewport.glb import mesh_of
from mindstage.world import BodyId, Colour, Pose
from mindstage.world.colours import COLOURS
from tests.kitchenette import kitchenette
from tests.viewport.viewing import Onlooker, looking
from tests.viewport.waiting import wait_until

Looking = Callable[[Viewport], Onlooker]
RED, BLUE = COLOURS["red"], COLOURS["blue"]
BEFORE_THEM = View((-1.6, -0.6, 1.7), (1.2, 0.2, 1.2), 0.7)
IN_FRONT = Pose((1.2, 0.3, 1.2))


@pytest.fixture
def look(browser: Any) -> Iterator[Looking]:
    with looking(browser) as look:
        yield look


def seen(visitor: Onlooker, colour: Colour) -> int:
    """How many pixels are of about that hue, in whatever light."""
    pixels = visitor.pixels().astype(float)
    strength = np.linalg.norm(pixels, axis=2)
    likeness = (pixels @ (np.array(colour) / np.linalg.norm(colour))) / np.maximum(strength, 1.0)
    return int(np.sum((likeness > 0.97) & (strength > 60.0)))


def test_markers_are_seen_change_move_and_go(stage: Stage, viewport: Viewport, look: Looking) -> None:
    points = ((0.0, -0.2, 0.0), (0.0, 0.2, 0.0))
    for number, form in enumerate(MarkerForm):
        pose = Pose((1.2, 0.25 * number - 0.75, 1.3))
        stage.mark(
            [Marker(id=f"a/{form.value}", form=form, pose=pose, colour=RED, points=points, text="I plan", body="Mug")]
        )
    visitor = look(viewport)
    viewport.sights.look_from(BEFORE_THEM)
    wait_until(lambda: seen(visitor, RED) > 100, "who comes late sees them")
    assert set(viewport._markers._nodes) == {f"a/{form.value}" for form in MarkerForm}
    line = Marker(id="line", form=MarkerForm.LINE, pose=IN_FRONT, size=(0.1, 0.1, 0.1), colour=BLUE, points=points)
    stage.mark([line])
    wait_until(lambda: seen(visitor, BLUE) > 100, "a line has the colour that was asked for")
    stage.mark([replace(line, pose=Pose((1.2, 0.3, 100.0)))])
    wait_until(lambda: seen(visitor, BLUE) == 0, "it is far away")
    stage.unmark([marker.id for marker in stage.frame.markers])
    wait_until(lambda: seen(visitor, RED) == 0, "all are gone")


def test_what_cannot_be_seen_is_no_fault(stage: Stage, viewport: Viewport) -> None:
    for form in MarkerForm:
        stage.mark([Marker(id=f"{form.value} of nothing", form=form, size=(0.0, 0.0, 0.0))])
        stage.mark([Marker(id=f"{form.value} of glass", form=form, opacity=0.0, points=((0.0, 0.0, 0.0),))])
    stage.mark([Marker(id="turned by nothing", form=MarkerForm.CUBE, pose=Pose((0, 0, 0), (0, 0, 0, 0)))])
    frame = stage.frame
    wait_until(lambda: viewport._frame is not None and viewport._frame.markers is frame.markers, "the page follows")
    assert not viewport._reported


def test_a_ghost_looks_like_its_body_as_long_as_that_is_there(stage: Stage, viewport: Viewport) -> None:
    def vertices() -> int:
        node = viewport._markers._nodes.get("soon")
        return len(node.vertices) if node is not None else 0

    stage.mark([Marker(id="soon", form=MarkerForm.GHOST, body="Mug", pose=IN_FRONT, colour=BLUE, opacity=0.4)])
    wait_until(vertices, "the ghost is shown")
    assert vertices() == len(mesh_of(stage.forms[BodyId("Mug")].skins).points)
    stage.call(lambda engine: engine.delete([BodyId("Mug")]), edits=True)
    wait_until(lambda: not vertices(), "it goes with its body")
    stage.spawn(replace(kitchenette(), bodies=(kitchenette().body("Mug"),), constraints=(), attachments=()))
    wait_until(vertices, "and comes back with it")
