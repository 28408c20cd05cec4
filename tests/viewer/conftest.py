"""Fixtures: a simulation without physics, a viewer of it, and a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.page_tab import PageTab, open_tabs
from tests.viewer.view_pictures import launch_browser


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    """The small kitchen, paused."""
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def viewer(simulation: Simulation) -> Iterator[Viewer]:
    """A viewer of it, at a free port."""
    with Viewer(simulation, port=0) as viewer:
        yield viewer


_NO_GPU = ["--disable-gpu"]
"""For pages without the 3D view: the emulated GPU would take half of the time to paint panels."""


@pytest.fixture(scope="session")
def playwright() -> Iterator[Any]:
    """The library that controls the browsers."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        yield playwright


@pytest.fixture(scope="session")
def browser(chromium: Path, playwright: Any) -> Iterator[Any]:
    """One headless browser for all tests of the 3D view."""
    browser = launch_browser(playwright, str(chromium))
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def panel_browser(chromium: Path, playwright: Any) -> Iterator[Any]:
    """One headless browser for all tests of pages without the 3D view."""
    browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", *_NO_GPU])
    yield browser
    browser.close()


@pytest.fixture
def open_page(request: pytest.FixtureRequest, browser: Any) -> Iterator[Callable[[Viewer], PageTab]]:
    """Opens pages in the browser, and closes them after the test."""
    with open_tabs(browser, panel_browser=lambda: request.getfixturevalue("panel_browser")) as open_page:
        yield open_page
