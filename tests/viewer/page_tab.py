"""A browser tab with the page: panels, buttons and the 3D view."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from PIL import Image

from mindstage.rendering.camera import CameraPose
from mindstage.scene import Vector
from mindstage.viewer import Viewer
from mindstage.viewer.server import session_key_of
from tests.viewer.pointer import PagePointer
from tests.viewer.waiting import TIMEOUT_S, wait_until

SIZE = (1280, 800)
SMALL = (800, 420)
"""For pages with the 3D view: rendering without a GPU is slow."""
_HAS_BODIES = "document.getElementById('view').contentWindow.mindstageView?.loadedBodies?.() > 0"


def to_picture(view: CameraPose, point: Vector, box: dict[str, float]) -> tuple[float, float]:
    """Projects a point [m] to a picture that fills a box [px]; the camera is upright."""
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
    """A browser tab with the page, with the 3D view or, for speed, without."""

    def __init__(self, page: Any, viewer: Viewer, *, view: bool, is_drawn: bool = True) -> None:
        """Opens the page.

        Args:
            page: the empty tab.
            viewer: the server.
            view: whether the page has the 3D view.
            is_drawn: whether to wait until the view is drawn.
        """
        self.page, self.viewer = page, viewer
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda line: "Content Security" in line.text and self.errors.append(line.text))
        page.set_default_timeout(TIMEOUT_S * 1000)
        if not view:
            page.route("**/view/**", lambda route: route.fulfill(body="", content_type="text/html"))
        page.goto(f"{viewer.url}/?fixedDpr=1")
        wait_until(lambda: page.evaluate("document.body.dataset.connected === 'true'"), "the page is connected")
        if view and is_drawn:
            wait_until(lambda: self.camera is not None, "the view is connected")
            wait_until(lambda: page.evaluate(_HAS_BODIES), "bodies are loaded")  # a picture of nothing is slow, too
            wait_until(lambda: self.colors() > 50, "the scene is drawn")

    @property
    def key(self) -> str:
        return str(self.page.evaluate("mindstage.clientKey"))

    @property
    def camera(self) -> CameraPose | None:
        """The camera of the view."""
        server = self.viewer._server
        for client in server.get_clients().values():
            if session_key_of(client, server) == self.key:
                camera = client.camera
                position, look_at = (tuple(map(float, point)) for point in (camera.position, camera.look_at))
                return CameraPose(position, look_at, float(camera.fov))  # type: ignore[arg-type]
        return None

    @property
    def canvas(self) -> dict[str, float]:
        """The bounding box of the view in the window [px]."""
        return dict(self.page.locator("#view").bounding_box())

    def pixels(self) -> np.ndarray:
        """A picture of the view."""
        picture = self.page.screenshot(clip=self.canvas, timeout=60_000)
        return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))

    def colors(self) -> int:
        """The number of colors in the view without the background, whose rows have one color each."""
        pixels = self.pixels()
        plain = np.all(pixels == pixels[:, :1], axis=(1, 2))
        return len(np.unique(pixels[~plain].reshape(-1, 3), axis=0))

    # -- panels --------------------------------------------------------------------------------------------------------

    def click_button(self, label: str) -> None:
        """Clicks the button of an action; in a narrow window, in the menu of the toolbar."""
        if self.page.locator(f"#toolbar-menu [data-action={label}]").count():
            self.page.locator("#toolbar-more").click()
        self.page.locator(f"[data-action={label}]:visible").first.click()

    def open_panel(self, panel: str) -> None:
        """Opens a panel."""
        self.page.locator(f"[data-tab={panel}]").click()

    def shows_text(self, text: str) -> bool:
        """Whether a text is visible on the page."""
        return text in self.page.locator("body").inner_text()

    def _tree_filter(self) -> str:
        return str(self.page.evaluate("mindstage.outliner.state.filter"))

    def tree_rows(self) -> list[str]:
        """The ids in the scene tree, from top to bottom."""
        return list(self.page.evaluate("mindstage.outliner.state.rows"))

    @property
    def selected(self) -> str | None:
        return self.page.evaluate("mindstage.selection.id")  # type: ignore[no-any-return]

    def select_in_tree(self, id: str) -> None:
        """Selects a body in the scene tree."""
        self.page.locator("[data-role=find-body]").fill(id)
        wait_until(lambda: self._tree_filter() == id.lower() and id in self.tree_rows(), f"the tree shows {id}")
        self.page.locator(f".tree-row[data-id='{id}'] .tree-name").click()
        wait_until(lambda: self.details() is not None and self.details()["id"] == id, f"{id} is described")

    def details(self) -> dict[str, Any] | None:
        """The details of the selected body."""
        return self.page.evaluate("mindstage.detailsPanel.details")  # type: ignore[no-any-return]

    def live(self) -> dict[str, Any] | None:
        """The live details of the selected body."""
        return self.page.evaluate("mindstage.detailsPanel.live")  # type: ignore[no-any-return]

    # -- mouse in the 3D view ------------------------------------------------------------------------------------------

    def to_window(self, point: Vector) -> tuple[float, float]:
        """Projects a point of the world [m] to the window [px]."""
        camera = self.camera
        assert camera is not None
        return to_picture(camera, point, self.canvas)


@contextmanager
def open_tabs(browser: Any, *, panel_browser: Callable[[], Any] | None = None) -> Iterator[Callable[..., PageTab]]:
    """Opens tabs and closes them at the end; a script error in one of them fails the test.

    Args:
        browser: the browser.
        panel_browser: returns the browser of pages without the 3D view; by default the same.
    """
    tabs: list[PageTab] = []

    def open_page(viewer: Viewer, *, view: bool = True, size: tuple[int, int] | None = None) -> PageTab:
        size = size or (SMALL if view else SIZE)
        program = browser if view or panel_browser is None else panel_browser()
        page = program.new_page(viewport={"width": size[0], "height": size[1]})
        tabs.append(PageTab(page, viewer, view=view))
        return tabs[-1]

    yield open_page
    for tab in tabs:
        tab.page.close()
        assert tab.errors == []
