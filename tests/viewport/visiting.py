"""What a visitor does on the page: look, click on a thing, drag it, press a button, type a word."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from PIL import Image

from mindstage.viewport import Viewport
from mindstage.viewport.framing import View, first_view
from mindstage.viewport.looks import decide_looks
from mindstage.world import Vector, World
from tests.viewport.waiting import wait_until

SIZE = (800, 480)


def opening_view(world: World, ancestors: Callable[[Any], Any]) -> View:
    """From where a visitor sees a world that has no shells at first."""
    return first_view(world, decide_looks(world, ancestors))


def on_screen(view: View, point: Vector, box: dict[str, float]) -> tuple[float, float]:
    """Where a place [m] is in a picture that fills the box [px]; the camera stands upright."""
    eye = np.array(view.position)
    ahead = np.array(view.look_at) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    away = np.array(point) - eye
    scale = box["height"] / 2 / np.tan(view.field_of_view_rad / 2) / float(away @ ahead)
    x = box["x"] + box["width"] / 2 + scale * float(away @ right)
    y = box["y"] + box["height"] / 2 - scale * float(away @ np.cross(right, ahead))
    return x, y


class Visit:
    """One visitor's browser tab."""

    def __init__(self, page: Any, viewport: Viewport) -> None:
        self.page = page
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(f"{viewport.url}/?fixedDpr=1")
        page.wait_for_selector("canvas")
        wait_until(lambda: page.get_by_text("bodies").count(), "the page says how many bodies there are")
        wait_until(lambda: self.colours() > 50, "the picture is drawn")

    @property
    def canvas(self) -> dict[str, float]:
        """Where the view is in the window [px]."""
        return dict(self.page.locator("canvas").first.bounding_box())

    def pixels(self) -> np.ndarray:
        """The view as it is shown."""
        picture = self.page.screenshot(clip=self.canvas, timeout=60_000)
        return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))

    def colours(self) -> int:
        """How many different colours are in the view, but for its background: rows of one colour each."""
        pixels = self.pixels()
        plain = np.all(pixels == pixels[:, :1], axis=(1, 2))
        return len(np.unique(pixels[~plain].reshape(-1, 3), axis=0))

    def press(self, button: str) -> None:
        self.page.get_by_role("button", name=button, exact=True).click()

    def field(self, label: str) -> Any:
        return self.page.locator(f"xpath=//label[normalize-space()='{label}']/ancestor::div[.//input][1]//input").first

    def says(self, text: str) -> bool:
        return text in self.page.locator("body").inner_text()

    def click(self, view: View, point: Vector) -> None:
        x, y = on_screen(view, point, self.canvas)
        self.page.mouse.move(x, y)
        self.page.mouse.click(x, y)

    def grab(self, view: View, start: Vector, end: Vector) -> None:
        """Presses the button at one place and moves to another; the button stays down."""
        (x, y), (to_x, to_y) = on_screen(view, start, self.canvas), on_screen(view, end, self.canvas)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for part in np.linspace(0.0, 1.0, 12):
            self.page.mouse.move(x + (to_x - x) * part, y + (to_y - y) * part)

    def let_go(self) -> None:
        self.page.mouse.up()


@contextmanager
def visiting(browser: Any) -> Iterator[Callable[[Viewport], Visit]]:
    """Opens tabs, and closes them in the end; a tab in which a script failed fails the test."""
    visits: list[Visit] = []

    def visit(viewport: Viewport) -> Visit:
        page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        visits.append(Visit(page, viewport))
        return visits[-1]

    yield visit
    for made in visits:
        made.page.close()
        assert made.errors == []
