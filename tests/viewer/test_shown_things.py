"""What the 3D view of the page shows in a real browser: labeled boxes, nothing in mid air, shadows of what is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from mindstage import KnowledgeBase, Simulation
from mindstage.engines import NullEngine
from mindstage.rendering.camera import CameraPose
from mindstage.scene import World
from mindstage.viewer import Viewer
from tests.rendering.test_render_scene import FLOOR, PLATE, UNKNOWN, body
from tests.viewer.view_tab import ViewTab, open_views
from tests.viewer.waiting import wait_until

TALL = body("tall", "Pillar", (0.0, 0.0, 0.8), (0.4, 0.4, 1.6))
BOX = body("box", UNKNOWN, (0.0, -1.2, 0.3), (0.6, 0.6, 0.6))
POSTER = body("poster", UNKNOWN, (-2.5, 0.0, 1.5), PLATE)
ABOVE = CameraPose((0.01, 0.0, 7.0), (0.0, 0.0, 0.0), 0.7)
FRONT = CameraPose((0.4, -3.6, 0.9), (0.0, -1.2, 0.3), 0.5)


@pytest.fixture
def tab(browser: Any) -> Iterator[tuple[Viewer, ViewTab]]:
    """A page of a world without walls, and the viewer."""
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(World(iri=FLOOR.iri, name="map", bodies=(FLOOR, TALL, BOX, POSTER)))
        with Viewer(simulation, port=0) as viewer, open_views(browser) as open_view:
            tab = open_view(viewer)
            for id in ("tall", "box", "poster"):
                tab.wait_for(f"/bodies/{id}/textured")
            yield viewer, tab


def stable(tab: ViewTab) -> np.ndarray:
    wait_until(lambda: np.array_equal(tab.pixels(), tab.pixels()), "the picture is stable")
    return tab.pixels().astype(float)


def test_an_unknown_thing_is_labeled_and_a_poster_without_a_wall_is_not_drawn(tab: tuple[Viewer, ViewTab]) -> None:
    _, view = tab
    visible = "name => window.__viserMutable.nodeRefFromName[name].visible"
    wait_until(lambda: not view.page.evaluate(visible, "/bodies/poster"), "the poster is left out")
    assert view.page.evaluate(visible, "/bodies/box")
    view.move_camera(FRONT)
    picture = stable(view)
    x, y = (round(part) for part in view.to_window((0.0, -1.5, 0.3)))
    label = picture[y - 5 : y + 6, x - 12 : x + 13].mean(axis=2)
    assert label.max() > 180.0, "paper"
    assert label.min() < 130.0, "letters"


def test_what_is_clipped_casts_no_shadow(tab: tuple[Viewer, ViewTab]) -> None:
    viewer, view = tab
    view.move_camera(ABOVE)

    def shadow() -> int:
        """The number of dark pixels of the floor around the tall body, without its own sides."""
        picture = stable(view).mean(axis=2)
        x, y = (round(part) for part in view.to_window((0.0, 0.0, 0.0)))
        reach = round(view.to_window((0.0, 1.4, 0.0))[0] - x) or round(view.to_window((1.4, 0.0, 0.0))[0] - x)
        around = picture[y - abs(reach) : y + abs(reach), x - abs(reach) : x + abs(reach)]
        return int((around < 0.8 * np.median(around)).sum())

    whole = shadow()
    assert whole > 100
    viewer.views.set_clip_height(0.1, client=view.number)
    wait_until(lambda: shadow() < 0.3 * whole, "the shadow is that of what is drawn")
    viewer.views.set_clip_height(None, client=view.number)
    wait_until(lambda: shadow() > 0.9 * whole, "the shadow is there again")
