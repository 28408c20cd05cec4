"""The view by itself, without the page round it, in a real browser: what is drawn, and what the mouse does in it."""

from __future__ import annotations

import io
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from PIL import Image

from mindstage import Simulation
from mindstage.scene import Vector
from mindstage.viewer import Viewer
from mindstage.viewer.camera import CameraPose
from tests.viewer.page_tab import to_picture
from tests.viewer.pointer import PagePointer
from tests.viewer.waiting import becomes_true, wait_until

__all__ = ["ViewTab", "open_views"]

SIZE = {"width": 640, "height": 420}
_OPEN_TIMEOUT_S = 180.0
"""A page of some megabytes in a browser without a GPU, on a machine that has much else to do."""
_DRAWN = "name => (window.__viserMutable?.nodeRefFromName[name]?.children.length ?? 0) > 0"


class ViewTab(PagePointer):
    """One tab's browser tab with nothing but the view."""

    def __init__(self, page: Any, viewer: Viewer) -> None:
        self.page, self.viewer = page, viewer
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        before = set(viewer.views.clients)
        page.goto(f"{viewer.url}/view/{secrets.token_hex(8)}/?fixedDpr=1", timeout=1000 * _OPEN_TIMEOUT_S)
        wait_until(lambda: set(viewer.views.clients) - before, "the tab is known", timeout_s=_OPEN_TIMEOUT_S)
        self.number = max(set(viewer.views.clients) - before)

    @property
    def camera_position(self) -> CameraPose:
        """Where the camera is."""
        camera = self.viewer._server.get_clients()[self.number].camera
        position, look_at = (tuple(map(float, place)) for place in (camera.position, camera.look_at))
        return CameraPose(position, look_at, float(camera.fov))  # type: ignore[arg-type]

    def is_drawn(self, name: str) -> bool:
        """Whether a node of that name is there, and something in it."""
        return bool(self.page.evaluate(_DRAWN, name))

    def has_node(self, name: str) -> bool:
        """Whether a node of that name is there."""
        return bool(self.page.evaluate("name => !!window.__viserSceneTree?.getState()[name]?.message", name))

    def wait_for(self, name: str) -> None:
        wait_until(lambda: self.is_drawn(name), f"{name} is drawn")
        wait_until(self._is_still, "the camera is where it begins")

    def _is_still(self) -> bool:
        if self.number not in self.viewer._server.get_clients():
            return True  # who was cut off is somebody else when he is back
        before = self.camera_position
        self.page.wait_for_timeout(250)
        return self.camera_position == before

    def to_window(self, point: Vector) -> tuple[float, float]:
        """Where a place in the world [m] is in the window [px]."""
        return to_picture(self.camera_position, point, {"x": 0.0, "y": 0.0, **SIZE})

    def pixels(self) -> np.ndarray:
        picture = self.page.screenshot(timeout=60_000)
        return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))

    def drag_until(self, start: Vector, end: Vector, condition: Callable[[], object], label: str) -> None:
        """Pulls what is at one place to another; again where a slow browser took it for a open_view round."""

        def done() -> bool:
            self.press_and_move(start, end)
            if becomes_true(lambda: self.viewer._drag_controller.drag_forces) and becomes_true(condition):
                return True
            self.release()
            return False

        wait_until(done, label)


@contextmanager
def open_views(browser: Any) -> Iterator[Callable[[Viewer], ViewTab]]:
    """Opens views, and closes them in the end; one in which a script failed fails the test."""
    made: list[ViewTab] = []

    def open_view(viewer: Viewer) -> ViewTab:
        made.append(ViewTab(browser.new_page(viewer=SIZE), viewer))
        return made[-1]

    yield open_view
    for onlooker in made:
        onlooker.page.close()
        assert onlooker.errors == []


def position(simulation: Simulation, id: str) -> np.ndarray:
    """Where a body is now."""
    return simulation.state.poses[[str(each) for each in simulation.state.ids].index(id)][:3]
