"""A stage without physics, a page on it, and a browser to look at it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.visiting import PageTab, open_tabs


@pytest.fixture
def stage() -> Iterator[Simulation]:
    """The small kitchen, standing still."""
    with Simulation(KnowledgeBase(), NullEngine()) as stage:
        stage.spawn(kitchenette())
        yield stage


@pytest.fixture
def viewport(stage: Simulation) -> Iterator[Viewer]:
    """A page on it, at a port that nobody else has."""
    with Viewer(stage, port=0) as viewport:
        yield viewport


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
def visit(browser: Any) -> Iterator[Callable[[Viewer], PageTab]]:
    """Opens a page in the browser, and closes it in the end."""
    with open_tabs(browser) as visit:
        yield visit
