"""Answers that light up, by what a visitor sees in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.knowledge import save_map
from mindstage.scene import Color
from mindstage.scene.colors import COLORS
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.visiting import PageTab
from tests.viewer.waiting import wait_until

Visiting = Callable[[Viewer], PageTab]
LABEL = "handle_of individual=FridgeDoor"


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Simulation]:
    """The small kitchen as a map that is known, standing still."""
    save_map(kitchenette(), tmp_path / "kitchenette.owl")
    knowledge = KnowledgeBase()
    knowledge.load(tmp_path / "kitchenette.owl")
    with Simulation(knowledge, NullEngine()) as stage:
        stage.spawn()
        yield stage


def seen(visitor: PageTab, color: Color) -> int:
    """How many pixels of the picture are of about that hue, lit or in the shade; grays are of none."""
    pixels = visitor.pixels().astype(float)
    strength = np.linalg.norm(pixels, axis=2)
    wanted = np.array(color) / np.linalg.norm(color)
    likeness = (pixels @ wanted) / np.maximum(strength, 1.0)
    return int(np.sum((likeness > 0.97) & (strength > 60.0)))


def test_answers_light_up_with_a_legend_until_they_are_put_out(
    stage: Simulation, viewport: Viewer, visit: Visiting
) -> None:
    visitor = visit(viewport)
    assert seen(visitor, COLORS["red"]) == 0
    assert not visitor.page.locator("#legend").is_visible()
    assert stage.highlight(stage.ask("handle_of", individual="FridgeDoor"), COLORS["red"]).highlighted == (
        "FridgeHandle",
    )
    wait_until(lambda: visitor.shows_text(LABEL), "the legend says what is lit and why")
    wait_until(lambda: seen(visitor, COLORS["red"]) > 50, "the handle is red")
    stage.highlight(stage.ask("where_is", relation="on", other="Cupboard"), COLORS["blue"])
    wait_until(lambda: seen(visitor, COLORS["blue"]) > 50, "the mug is blue, and the handle still red")
    assert seen(visitor, COLORS["red"]) > 50
    visitor.page.get_by_role("button", name="Clear all").click()
    wait_until(lambda: stage.state.highlight_groups == (), "nothing is lit any more")
    wait_until(lambda: not visitor.shows_text(LABEL), "the legend is gone")
    wait_until(lambda: seen(visitor, COLORS["red"]) == 0, "nothing is red")


def test_a_late_visitor_sees_what_is_lit_even_inside_of_something(
    stage: Simulation, viewport: Viewer, visit: Visiting
) -> None:
    stage.highlight(["Drawer"], COLORS["red"], label="behind its front")
    late = visit(viewport)
    wait_until(lambda: late.shows_text("behind its front"), "the legend says what is lit")
    wait_until(lambda: seen(late, COLORS["red"]) > 50, "the drawer is seen through its cupboard")
    stage.clear()
    wait_until(lambda: not late.shows_text("behind its front"), "an empty world has no lights")
