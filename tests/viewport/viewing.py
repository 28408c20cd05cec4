"""The view by itself, without the page round it, in a real browser: what is drawn, and what the mouse does in it."""

from __future__ import annotations

import io
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from PIL import Image

from mindstage import Stage
from mindstage.viewport import Viewport
from mindstage.viewport.framing import View
from mindstage.world import Vector
from tests.viewport.pointing import Pointing
from tests.viewport.visiting import on_screen
from tests.viewport.waiting import came_true, wait_until

__all__ = ["Onlooker", "looking"]

SIZE = {"width": 640, "height": 420}
_OPENING_S = 180.0
"""A page of some megabytes in a browser without a GPU, on a machine that has much else to do."""
_DRAWN = "name => (window.__viserMutable?.nodeRefFromName[name]?.children.length ?? 0) > 0"


class Onlooker(Pointing):
    """One visitor's browser tab with nothing but the view."""

    def __init__(self, page: Any, viewport: Viewport) -> None:
        self.page, self.viewport = page, viewport
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        before = set(viewport.sights.visitors)
        page.goto(f"{viewport.url}/view/{secrets.token_hex(8)}/?fixedDpr=1", timeout=1000 * _OPENING_S)
        wait_until(lambda: set(viewport.sights.visitors) - before, "the visitor is known", patience_s=_OPENING_S)
        self.number = max(set(viewport.sights.visitors) - before)

    @property
    def eye(self) -> View:
        """Where the camera is."""
        camera = self.viewport._server.get_clients()[self.number].camera
        position, look_at = (tuple(map(float, place)) for place in (camera.position, camera.look_at))
        return View(position, look_at, float(camera.fov))  # type: ignore[arg-type]

    def draws(self, name: str) -> bool:
        """Whether a node of that name is there, and something in it."""
        return bool(self.page.evaluate(_DRAWN, name))

    def knows(self, name: str) -> bool:
        """Whether a node of that name is there."""
        return bool(self.page.evaluate("name => !!window.__viserSceneTree?.getState()[name]?.message", name))

    def wait_for(self, name: str) -> None:
        wait_until(lambda: self.draws(name), f"{name} is drawn")
        wait_until(self._stands, "the camera is where it begins")

    def _stands(self) -> bool:
        if self.number not in self.viewport._server.get_clients():
            return True  # who was cut off is somebody else when he is back
        before = self.eye
        self.page.wait_for_timeout(250)
        return self.eye == before

    def place(self, point: Vector) -> tuple[float, float]:
        """Where a place in the world [m] is in the window [px]."""
        return on_screen(self.eye, point, {"x": 0.0, "y": 0.0, **SIZE})

    def pixels(self) -> np.ndarray:
        picture = self.page.screenshot(timeout=60_000)
        return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))

    def pull(self, start: Vector, end: Vector, condition: Callable[[], object], what: str) -> None:
        """Pulls what is at one place to another; again where a slow browser took it for a look round."""

        def done() -> bool:
            self.grab(start, end)
            if came_true(lambda: self.viewport._hands.pulls) and came_true(condition):
                return True
            self.let_go()
            return False

        wait_until(done, what)


@contextmanager
def looking(browser: Any) -> Iterator[Callable[[Viewport], Onlooker]]:
    """Opens views, and closes them in the end; one in which a script failed fails the test."""
    made: list[Onlooker] = []

    def look(viewport: Viewport) -> Onlooker:
        made.append(Onlooker(browser.new_page(viewport=SIZE), viewport))
        return made[-1]

    yield look
    for onlooker in made:
        onlooker.page.close()
        assert onlooker.errors == []


def position(stage: Stage, id: str) -> np.ndarray:
    """Where a body is now."""
    return stage.frame.poses[[str(each) for each in stage.frame.ids].index(id)][:3]
