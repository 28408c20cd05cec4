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


@pytest.fixture(scope="session")
def browser(chromium: Path) -> Iterator[Any]:
    """One headless browser for all tests."""
    from playwright.sync_api import sync_playwright

    arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    # Without a GPU the panels are painted much faster directly than by the emulated GPU, which the 3D view needs.
    arguments += ["--disable-gpu-compositing", "--disable-gpu-rasterization"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[[Viewer], PageTab]]:
    """Opens pages in the browser, and closes them after the test."""
    with open_tabs(browser) as open_page:
        yield open_page
