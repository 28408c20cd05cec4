"""Far and small bodies in the 3D view are drawn with fewer triangles, and those smaller than a pixel not at all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.rendering.camera import CameraPose
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World
from mindstage.viewer import Viewer
from mindstage.viewer.scene import BATCH_SIZE
from tests.viewer.view_tab import ViewTab, open_views
from tests.viewer.waiting import wait_until

_BOWL_M = 0.2
_DRAW = """(() => {
  const state = __viserMutable.scene.__r3f.root.getState();
  state.advance(performance.now());
  return [state.camera.position.length(), state.gl.info.render.triangles];
})()"""
"""Draws a frame; returns the distance of its camera, and its number of triangles, with those of shadows if drawn."""


def _bowls(sizes: list[float]) -> World:
    """Bowls in a row across the view."""
    bodies = [
        Body(
            id=BodyId(f"bowl{number}"),
            iri=Iri(f"http://example.org/bowls.owl#bowl{number}"),
            cls=Iri("http://knowrob.org/kb/knowrob.owl#Bowl"),
            pose=Pose((0.0, 0.3 * (number - (len(sizes) - 1) / 2), 0.0)),
            size=(size, size, size),
            physics=BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=0.3),
        )
        for number, size in enumerate(sizes)
    ]
    return World(iri=Iri("http://example.org/bowls.owl#map"), bodies=tuple(bodies))


@pytest.fixture(params=["one batch", "own nodes"])
def bowls(request: pytest.FixtureRequest, browser: Any) -> Iterator[ViewTab]:
    """A view of bowls that are drawn in a batch, or with a node of their own."""
    is_batch = request.param == "one batch"
    sizes = [_BOWL_M + (0.0 if is_batch else 0.001 * number) for number in range(BATCH_SIZE)]
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(_bowls(sizes))
        with Viewer(simulation, port=0) as viewer, open_views(browser) as open_view:
            wait_until(lambda: viewer.views.is_drawn, "the scene is sent")
            tab = open_view(viewer)
            wait_until(
                lambda: tab.page.evaluate("mindstageView.loadedBodies()") >= BATCH_SIZE, "all bowls have their meshes"
            )
            yield tab


def test_far_bowls_have_fewer_triangles_and_look_the_same(bowls: ViewTab) -> None:
    def move_away(distance: float, *, triangles: tuple[float, float]) -> None:
        bowls.move_camera(CameraPose((distance, 0.0, 0.0), (0.0, 0.0, 0.0), 0.8))

        def is_drawn() -> bool:  # levels are built over some frames
            eye, count = bowls.page.evaluate(_DRAW)
            return eye == pytest.approx(distance) and triangles[0] <= count <= triangles[1]

        wait_until(is_drawn, f"from {distance} m there are so many triangles")

    full = sum(len(each.faces) for form in bowls.viewer._scene.appearances.values() for each in form.visuals)
    move_away(3.0, triangles=(full, np.inf))
    move_away(40.0, triangles=(BATCH_SIZE * 10, full / 4))
    drawn = bowls.pixels().astype(int)
    assert (np.abs(drawn - drawn[:, :1]).max(axis=2) > 8).sum() >= BATCH_SIZE * 4, "they are still seen"
    move_away(500.0, triangles=(0, BATCH_SIZE))
    move_away(3.0, triangles=(full, np.inf))
