"""What a tab does on the page: open_view, click on a thing, drag it, press a button, type a word."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from PIL import Image

from mindstage.scene import Vector
from mindstage.viewer import Viewer
from mindstage.viewer.camera import CameraPose
from mindstage.viewer.server import session_key_of
from tests.viewer.pointer import PagePointer
from tests.viewer.waiting import TIMEOUT_S, wait_until

SIZE = (1280, 800)
SMALL = (800, 420)
"""With the view in it: without a GPU each picture takes its time."""


def to_picture(view: CameraPose, point: Vector, box: dict[str, float]) -> tuple[float, float]:
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


class PageTab(PagePointer):
    """One tab's browser tab: our page, with the view in it or, for speed, without."""

    def __init__(self, page: Any, viewer: Viewer, *, view: bool) -> None:
        self.page, self.viewer = page, viewer
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda line: "Content Security" in line.text and self.errors.append(line.text))
        page.set_default_timeout(TIMEOUT_S * 1000)
        if not view:
            page.route("**/view/**", lambda route: route.fulfill(body="", content_type="text/html"))
        page.goto(f"{viewer.url}/?fixedDpr=1")
        wait_until(lambda: page.evaluate("document.body.dataset.connected === 'true'"), "the page is connected")
        if view:
            wait_until(lambda: self.camera is not None, "the view is there")
            wait_until(lambda: self.colors() > 50, "the picture is drawn")

    @property
    def key(self) -> str:
        return str(self.page.evaluate("mindstage.clientKey"))

    @property
    def camera(self) -> CameraPose | None:
        """Where the view's camera is."""
        server = self.viewer._server
        for client in server.get_clients().values():
            if session_key_of(client, server) == self.key:
                camera = client.camera
                position, look_at = (tuple(map(float, place)) for place in (camera.position, camera.look_at))
                return CameraPose(position, look_at, float(camera.fov))  # type: ignore[arg-type]
        return None

    @property
    def canvas(self) -> dict[str, float]:
        """Where the view is in the window [px]."""
        return dict(self.page.locator("#view").bounding_box())

    def pixels(self) -> np.ndarray:
        """The view as it is shown."""
        picture = self.page.screenshot(clip=self.canvas, timeout=60_000)
        return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))

    def colors(self) -> int:
        """How many different colors are in the view, but for its background: rows of one color each."""
        pixels = self.pixels()
        plain = np.all(pixels == pixels[:, :1], axis=(1, 2))
        return len(np.unique(pixels[~plain].reshape(-1, 3), axis=0))

    # -- the panels ----------------------------------------------------------------------------------------------------

    def click_button(self, label: str) -> None:
        """Presses the button that does something."""
        self.page.locator(f"[data-action={label}]:visible").first.click()

    def open_panel(self, panel: str) -> None:
        """Brings a panel to the front."""
        self.page.locator(f"[data-tab={panel}]").click()

    def shows_text(self, text: str) -> bool:
        """Whether that is written anywhere on the page."""
        return text in self.page.locator("body").inner_text()

    def tree_rows(self) -> list[str]:
        """The ids in the outline, from top to bottom."""
        return list(self.page.evaluate("mindstage.outliner.state.rows"))

    @property
    def selected(self) -> str | None:
        return self.page.evaluate("mindstage.selection.id")  # type: ignore[no-any-return]

    def select_in_tree(self, id: str) -> None:
        """Selects a body in the outline."""
        self.page.locator("[data-role=find-body]").fill(id)
        wait_until(lambda: id in self.tree_rows(), f"the outline shows {id}")
        self.page.locator(f".tree-row[data-id='{id}'] .tree-name").click()
        wait_until(lambda: self.details() is not None and self.details()["id"] == id, f"{id} is described")

    def details(self) -> dict[str, Any] | None:
        """What the page knows of the selected."""
        return self.page.evaluate("mindstage.detailsPanel.details")  # type: ignore[no-any-return]

    def live(self) -> dict[str, Any] | None:
        """What of it changes all the time."""
        return self.page.evaluate("mindstage.detailsPanel.live")  # type: ignore[no-any-return]

    # -- the mouse in the view -----------------------------------------------------------------------------------------

    def to_window(self, point: Vector) -> tuple[float, float]:
        """Where a place in the world [m] is in the window [px]."""
        camera = self.camera
        assert camera is not None
        return to_picture(camera, point, self.canvas)


@contextmanager
def open_tabs(browser: Any) -> Iterator[Callable[..., PageTab]]:
    """Opens tabs, and closes them in the end; a tab in which a script failed fails the test."""
    tabs: list[PageTab] = []

    def open_page(viewer: Viewer, *, view: bool = True, size: tuple[int, int] | None = None) -> PageTab:
        size = size or (SMALL if view else SIZE)
        page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        tabs.append(PageTab(page, viewer, view=view))
        return tabs[-1]

    yield open_page
    for made in tabs:
        made.page.close()
        assert made.errors == []
