"""Screenshots of the page and of the 3D view, with a real browser and a paused simulation."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.errors import BodyNotFoundError, BrowserNotFoundError, InvalidArgumentError
from mindstage.rendering.camera import CameraPose
from mindstage.rendering.screenshot import Screenshot, placed_camera
from mindstage.scene import BodyId
from mindstage.viewer import Viewer
from tests.viewer.waiting import wait_until

PATIENCE_S = 300.0
USUAL = CameraPose((3.0, -3.0, 2.0), (0.0, 0.0, 0.5), 0.6)


def pixels(picture: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


def test_highlights_and_the_clipping_plane_are_in_the_picture(
    simulation: Simulation, viewer: Viewer, chromium: Path
) -> None:
    simulation.highlight([BodyId("Fridge")], (0.0, 0.0, 1.0))
    whole = pixels(viewer.screenshot(Screenshot(size=(320, 200), browser=str(chromium), timeout_s=PATIENCE_S)))
    cut = pixels(
        viewer.screenshot(Screenshot(size=(320, 200), clip_height=0.1, browser=str(chromium), timeout_s=PATIENCE_S))
    )
    assert whole.shape == cut.shape == (200, 320, 3)
    assert blue(whole) > 300
    assert blue(cut) < blue(whole) / 2
    wait_until(lambda: not viewer.views.clients, "the browsers are disconnected")


def blue(picture: np.ndarray) -> int:
    """The number of blue pixels."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    return int(np.count_nonzero((blue > red + 60) & (blue > green + 40)))


def test_a_screenshot_of_the_whole_page_has_its_panels(viewer: Viewer, chromium: Path) -> None:
    shot = Screenshot(size=(900, 400), with_panels=True, panel="status", browser=str(chromium), timeout_s=PATIENCE_S)
    picture = pixels(viewer.screenshot(shot))
    left, middle = picture[120:380, 10:200].reshape(-1, 3), picture[120:380, 280:600].reshape(-1, 3)
    assert plainest(left) > 0.6 > plainest(middle)
    assert len(np.unique(middle, axis=0)) > 100


def plainest(colors: np.ndarray) -> float:
    """The share of the most frequent color."""
    _, counts = np.unique(colors, axis=0, return_counts=True)
    return float(counts.max() / len(colors))


def test_an_empty_page_that_needs_a_token_is_captured(chromium: Path) -> None:
    with (
        Simulation(KnowledgeBase(), NullEngine()) as simulation,
        Viewer(simulation, port=0, token="open sesame") as viewer,
    ):
        shot = Screenshot(size=(160, 100), position=(0.0, 0.0, 3.0), browser=str(chromium), timeout_s=PATIENCE_S)
        picture = pixels(viewer.screenshot(shot))
        assert picture.shape == (100, 160, 3)
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 5, "the background is a soft gradient, not one color"


def test_invalid_screenshots_are_refused(viewer: Viewer, chromium: Path) -> None:
    with pytest.raises(InvalidArgumentError, match="size 0: it must be an integer from 1 to 8192"):
        Screenshot(size=(0, 10))
    with pytest.raises(InvalidArgumentError, match="position and look_at are equal"):
        Screenshot(position=(1.0, 2.0, 3.0), look_at=(1.0, 2.0, 3.0))
    with pytest.raises(InvalidArgumentError, match="there are no panels in the picture; show the whole page"):
        Screenshot(panel="ask")
    with pytest.raises(BrowserNotFoundError, match="there is no program 'netscape'"):
        viewer.screenshot(Screenshot(browser="netscape"))
    with pytest.raises(BodyNotFoundError, match=r"Fridgee.*near: 'Fridge'"):
        viewer.screenshot(
            Screenshot(size=(64, 64), focus=(BodyId("Fridgee"),), browser=str(chromium), timeout_s=PATIENCE_S)
        )


def test_missing_camera_points_are_those_of_the_default() -> None:
    assert placed_camera(Screenshot(), USUAL) == USUAL
    assert placed_camera(Screenshot(position=(1.0, 1.0, 1.0)), USUAL) == CameraPose(
        (1.0, 1.0, 1.0), (0.0, 0.0, 0.5), 0.6
    )
    assert placed_camera(Screenshot(look_at=(10.0, 0.0, 0.5)), USUAL) == CameraPose(
        (13.0, -3.0, 2.0), (10.0, 0.0, 0.5), 0.6
    )
    both = placed_camera(Screenshot(position=(1.0, 2.0, 3.0), look_at=(4.0, 5.0, 6.0)), USUAL)
    assert both == CameraPose((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), 0.6)


def test_a_camera_straight_down_is_slightly_tilted() -> None:
    x, y, z = placed_camera(Screenshot(position=(1.0, 2.0, 5.0), look_at=(1.0, 2.0, 0.0)), USUAL).position
    assert (x, z) == (1.0, 5.0)
    assert 2.0 - y == pytest.approx(0.005)
