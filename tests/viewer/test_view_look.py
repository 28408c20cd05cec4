"""How the 3D view looks in a real browser: quality, theme, labels, the camera that follows answers, touch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mindstage import Simulation
from mindstage.viewer import Viewer
from mindstage.viewer.client_views import LabelMode
from tests.rendering.photographs import MAPS, by_page, photographed, reference_path
from tests.rendering.similarity import picture_similarity, read_picture
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

_IN_VIEW = "(code) => document.getElementById('view').contentWindow.eval(code)"
GL_MESSAGE = "GL Driver Message"
"""Chromium reports slow read-backs, which screenshots cause, as warnings."""


def in_view(tab: PageTab, code: str) -> Any:
    """Evaluates an expression in the frame of the 3D view."""
    return tab.page.evaluate(_IN_VIEW, code)


def console_of(tab: PageTab) -> list[str]:
    """What the console gets from now on, without what viser says about its connection."""
    lines: list[str] = []
    tab.page.on("console", lambda line: lines.append(line.text) if line.type != "log" else None)
    return lines


def corner(tab: PageTab) -> np.ndarray:
    """The mean color of the upper left corner of the view."""
    return np.asarray(tab.pixels()[:12, :12].mean(axis=(0, 1)))


@pytest.mark.parametrize("name", MAPS)
def test_pictures_of_the_page_are_as_the_references(name: str, request: pytest.FixtureRequest, browser: Any) -> None:
    samples = request.getfixturevalue("shared_data") if MAPS[name].startswith("maps/") else None
    with photographed(name, samples) as sim:
        picture = by_page(sim, browser)
    assert picture_similarity(picture, read_picture(reference_path(name, "page"))) > 0.9


def test_the_view_follows_theme_and_quality(viewer: Viewer, open_page: Any) -> None:
    tab = open_page(viewer, size=(700, 320))
    console = console_of(tab)
    assert "plain quality (chosen automatically)" in in_view(tab, "mindstageView.quality.description"), (
        "there is no GPU"
    )
    assert in_view(tab, "__viserMutable.scene.environment") is None
    plain = tab.pixels()
    assert corner(tab).min() > 200

    tab.page.emulate_media(color_scheme="dark")
    wait_until(lambda: corner(tab).max() < 90, "the background is dark")
    tab.page.emulate_media(color_scheme="light")
    wait_until(lambda: corner(tab).min() > 200, "the background is light again")

    tab.click_button("view-menu")
    tab.page.locator("[data-action=quality]").select_option("high")
    wait_until(lambda: in_view(tab, "!!__viserMutable.scene.environment"), "there is an environment light")
    tab.page.keyboard.press("Escape")
    wait_until(lambda: np.abs(tab.pixels().astype(int) - plain).mean() > 3.0, "the picture has changed")
    assert tab.colors() > 50
    tab.page.reload()
    wait_until(lambda: in_view(tab, "window.mindstageView?.quality?.name") == "high", "the choice is kept")
    tab.page.evaluate("localStorage.removeItem('mindstage.quality')")
    in_view(tab, "mindstageView.quality.update()")
    wait_until(lambda: in_view(tab, "__viserMutable.scene?.environment === null"), "the environment light is off")
    assert [line for line in console if GL_MESSAGE not in line] == []


def test_labels_do_not_overlap_and_unseen_answers_are_framed(
    simulation: Simulation, viewer: Viewer, open_page: Any
) -> None:
    tab = open_page(viewer, size=(1000, 420))
    (client,) = viewer.views.clients
    viewer.views.set_labels(LabelMode.ALL, client=client)
    view = tab.page.frame_locator("#view")
    labels = view.locator(".mindstage-label:not([hidden])")
    wait_until(lambda: labels.count() >= 2, "labels are drawn", timeout_s=40.0)
    boxes = [box for label in labels.all() if (box := label.bounding_box()) is not None]
    for number, one in enumerate(boxes):
        for other in boxes[:number]:
            is_beside = one["x"] >= other["x"] + other["width"] or other["x"] >= one["x"] + one["width"]
            is_above = one["y"] >= other["y"] + other["height"] or other["y"] >= one["y"] + one["height"]
            assert is_beside or is_above

    eye = tab.camera
    assert eye is not None
    simulation.highlight(["Fridge"], (0.0, 1.0, 0.0), label="seen")
    wait_until(lambda: viewer._scene._highlights.keys() == {"Fridge"}, "it is highlighted")
    simulation.clear_highlights()
    assert not tab.shows_text("out of the picture"), "the fridge is in the picture"
    behind = tuple(2 * np.array(eye.position) - np.array(eye.look_at))
    viewer.views.set_camera(type(eye)(eye.position, behind, eye.field_of_view_rad), client=client)
    wait_until(lambda: np.allclose(tab.camera.look_at, behind, atol=0.05), "the camera looks away")
    simulation.highlight(["Mug"], (0.0, 1.0, 0.0), label="unseen")
    wait_until(lambda: tab.shows_text("out of the picture"), "the page says so")
    mug = simulation.state.poses[[str(id) for id in simulation.state.ids].index("Mug")][:3]
    wait_until(lambda: np.allclose(tab.camera.look_at, mug, atol=0.3), "the camera shows the mug")


def test_a_finger_turns_the_view(viewer: Viewer, browser: Any) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 420}, has_touch=True)
    try:
        tab = PageTab(context.new_page(), viewer, view=True)
        before, box = tab.camera, tab.canvas
        assert before is not None
        session = context.new_cdp_session(tab.page)
        x, y = box["x"] + 0.5 * box["width"], box["y"] + 20.0

        def touch(type: str, *points: dict[str, float]) -> None:
            session.send("Input.dispatchTouchEvent", {"type": type, "touchPoints": list(points)})

        touch("touchStart", {"x": x, "y": y})
        for step in range(1, 9):
            touch("touchMove", {"x": x + 12.0 * step, "y": y})
        touch("touchEnd")
        wait_until(lambda: tab.camera != before, "the camera has turned")
        assert np.linalg.norm(np.subtract(tab.camera.position, before.position)) > 0.2  # type: ignore[union-attr]
        assert tab.camera.look_at == before.look_at  # type: ignore[union-attr]
        assert tab.errors == []
    finally:
        context.close()
