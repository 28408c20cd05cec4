"""A simulation without physics, a page on it, and a browser to open_view at it."""

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
    """The small kitchen, standing still."""
    with Simulation(KnowledgeBase(), NullEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def viewer(simulation: Simulation) -> Iterator[Viewer]:
    """A page on it, at a port that nobody else has."""
    with Viewer(simulation, port=0) as viewer:
        yield viewer


@pytest.fixture(scope="session")
def browser(chromium: Path) -> Iterator[Any]:
    """One headless browser for all tests."""
    from playwright.sync_api import sync_playwright

    arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[[Viewer], PageTab]]:
    """Opens a page in the browser, and closes it in the end."""
    with open_tabs(browser) as open_page:
        yield open_page
