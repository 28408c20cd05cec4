"""A browser tab with the 3D view alone, without the page around it."""

from __future__ import annotations

import io
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mindstage import Simulation
from mindstage.rendering.camera import CameraPose
from mindstage.scene import Vector
from mindstage.viewer import Viewer
from tests.viewer.page_tab import to_picture
from tests.viewer.pointer import PagePointer
from tests.viewer.waiting import becomes_true, wait_until

__all__ = ["ViewTab", "open_views"]

SIZE = {"width": 640, "height": 420}
_OPEN_TIMEOUT_S = 180.0
"""The page has some megabytes, and the browser has no GPU [s]."""
_DRAWN = "name => (window.__viserMutable?.nodeRefFromName[name]?.children.length ?? 0) > 0"


class ViewTab(PagePointer):
    """A browser tab with the 3D view alone."""

    def __init__(self, page: Any, viewer: Viewer) -> None:
        self.page, self.viewer = page, viewer
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        before = set(viewer.views.clients)
        page.goto(f"{viewer.url}/view/{secrets.token_hex(8)}/?fixedDpr=1", timeout=1000 * _OPEN_TIMEOUT_S)
        wait_until(lambda: set(viewer.views.clients) - before, "the client is connected", timeout_s=_OPEN_TIMEOUT_S)
        self.number = max(set(viewer.views.clients) - before)

    @property
    def camera_position(self) -> CameraPose:
        """The current camera."""
        camera = self.viewer._server.get_clients()[self.number].camera
        position, look_at = (tuple(map(float, point)) for point in (camera.position, camera.look_at))
        return CameraPose(position, look_at, float(camera.fov))  # type: ignore[arg-type]

    def is_drawn(self, name: str) -> bool:
        """Whether a node of that name exists and has content."""
        return bool(self.page.evaluate(_DRAWN, name))

    def has_node(self, name: str) -> bool:
        """Whether a node of that name exists."""
        return bool(self.page.evaluate("name => !!window.__viserSceneTree?.getState()[name]?.message", name))

    def labels(self) -> list[str]:
        """The texts of the labels that are drawn."""
        return list(
            self.page.evaluate(
                "[...document.querySelectorAll('.mindstage-label:not([hidden]) b')].map((each) => each.textContent)"
            )
        )

    def wait_for(self, name: str) -> None:
        wait_until(lambda: self.is_drawn(name), f"{name} is drawn")
        wait_until(self._is_still, "the camera is at its initial pose")

    def _is_still(self) -> bool:
        if self.number not in self.viewer._server.get_clients():
            return True  # a client that reconnects has another number
        before = self.camera_position
        self.page.wait_for_timeout(250)
        return self.camera_position == before

    def move_camera(self, camera: CameraPose) -> None:
        """Moves the camera, and waits until it has moved."""
        self.viewer.views.set_camera(camera, client=self.number)
        wait_until(
            lambda: self.camera_position.position == pytest.approx(camera.position, abs=1e-3), "the camera has moved"
        )

    def to_window(self, point: Vector) -> tuple[float, float]:
        """Projects a point of the world [m] to the window [px]."""
        return to_picture(self.camera_position, point, {"x": 0.0, "y": 0.0, **SIZE})

    def pixels(self) -> np.ndarray:
        picture = self.page.screenshot(timeout=60_000)
        return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))

    def drag_until(self, start: Callable[[], Vector], end: Vector, condition: Callable[[], object], label: str) -> None:
        """Drags from one point, which may have moved since the last try, to another; repeated if it had no effect.

        A slow browser may have moved the camera instead, which is then moved back.
        """
        camera = self.camera_position

        def done() -> bool:
            self.press_and_move(start(), end)
            if becomes_true(lambda: self.viewer._drag_controller.drag_forces) and becomes_true(condition):
                return True
            self.release()
            self.move_camera(camera)
            return False

        wait_until(done, label)


@contextmanager
def open_views(browser: Any) -> Iterator[Callable[[Viewer], ViewTab]]:
    """Opens views and closes them at the end; a script error in one of them fails the test."""
    made: list[ViewTab] = []

    def open_view(viewer: Viewer) -> ViewTab:
        made.append(ViewTab(browser.new_page(viewport=SIZE), viewer))
        return made[-1]

    yield open_view
    for tab in made:
        tab.page.close()
        assert tab.errors == []


def position(simulation: Simulation, id: str) -> np.ndarray:
    """The current position of a body [m]."""
    return simulation.state.poses[[str(each) for each in simulation.state.ids].index(id)][:3]
