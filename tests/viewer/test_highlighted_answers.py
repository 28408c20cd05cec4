"""Highlighted answers in a real browser, tested by the pixels of the view."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.maps import save_map
from mindstage.scene import Color
from mindstage.scene.colors import COLORS
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

OpenPage = Callable[[Viewer], PageTab]
LABEL = "handle_of individual=FridgeDoor"


@pytest.fixture
def simulation(tmp_path: Path) -> Iterator[Simulation]:
    """The small kitchen, loaded from a map, paused."""
    save_map(kitchenette(), tmp_path / "kitchenette.owl")
    knowledge = KnowledgeBase()
    knowledge.load(tmp_path / "kitchenette.owl")
    with Simulation(knowledge, NullEngine()) as simulation:
        simulation.spawn()
        yield simulation


def count_pixels(tab: PageTab, color: Color) -> int:
    """The number of pixels of about that hue, in light or shade."""
    pixels = tab.pixels().astype(float)
    strength = np.linalg.norm(pixels, axis=2)
    wanted = np.array(color) / np.linalg.norm(color)
    likeness = (pixels @ wanted) / np.maximum(strength, 1.0)
    return int(np.sum((likeness > 0.97) & (strength > 60.0)))


def test_answers_are_highlighted_with_a_legend_until_cleared(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer)
    assert count_pixels(tab, COLORS["red"]) == 0
    assert not tab.page.locator("#legend").is_visible()
    assert simulation.highlight(simulation.ask("handle_of", individual="FridgeDoor"), COLORS["red"]).highlighted == (
        "FridgeHandle",
    )
    wait_until(lambda: tab.shows_text(LABEL), "the legend shows the highlight")
    wait_until(lambda: count_pixels(tab, COLORS["red"]) > 50, "the handle is red")
    simulation.highlight(simulation.ask("where_is", relation="on", other="Cupboard"), COLORS["blue"])
    wait_until(lambda: count_pixels(tab, COLORS["blue"]) > 50, "the mug is blue and the handle red")
    assert count_pixels(tab, COLORS["red"]) > 50
    tab.page.get_by_role("button", name="Clear all").click()
    wait_until(lambda: simulation.state.highlight_groups == (), "nothing is highlighted")
    wait_until(lambda: not tab.shows_text(LABEL), "the legend is hidden")
    wait_until(lambda: count_pixels(tab, COLORS["red"]) == 0, "nothing is red")


def test_a_later_client_sees_highlighted_bodies_inside_others(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    simulation.highlight(["Drawer"], COLORS["red"], label="behind its front")
    late = open_page(viewer)
    wait_until(lambda: late.shows_text("behind its front"), "the legend shows the highlight")
    wait_until(lambda: count_pixels(late, COLORS["red"]) > 50, "the drawer is visible through its cupboard")
    simulation.clear()
    wait_until(lambda: not late.shows_text("behind its front"), "an empty world has no highlights")
