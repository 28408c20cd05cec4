"""Pictures of the page and of its 3D view, taken by a browser once they no longer change."""

from __future__ import annotations

import secrets
import shutil
import time
from typing import Any

from mindstage.viewer import Viewer
from tests.viewer.waiting import wait_until

__all__ = ["launch_browser", "page_picture", "view_picture"]

TIMEOUT_S = 300.0
"""Large worlds are drawn slowly without a GPU [s]."""
_STABLE_S = 1.5
"""Time without changes after which a picture is finished [s]."""
_IS_LOADED = """(() => {
  const view = (document.getElementById("view")?.contentWindow ?? window).mindstageView;
  return view?.loadedBodies?.() > 0 && !view.pendingTextures?.();
})()"""


def launch_browser(playwright: Any, executable: str | None = None) -> Any:
    """Starts a headless Chromium that draws without a GPU, so that pictures are the same on every machine."""
    return playwright.chromium.launch(
        executable_path=executable or shutil.which("chromium"),
        args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
    )


def page_picture(browser: Any, viewer: Viewer, size: tuple[int, int], *, panel: str = "") -> bytes:
    """A picture of the whole page as a PNG file, with one of its panels opened."""
    page = _opened(browser, viewer, "/", size)
    if panel:
        page.locator(f"[data-tab={panel}]").click()
    return _settled_picture(page)


def view_picture(browser: Any, viewer: Viewer, size: tuple[int, int]) -> bytes:
    """A picture of the 3D view alone as a PNG file."""
    return _settled_picture(_opened(browser, viewer, f"/view/{secrets.token_hex(8)}/", size))


def _opened(browser: Any, viewer: Viewer, path: str, size: tuple[int, int]) -> Any:
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.set_default_timeout(1000 * TIMEOUT_S)
    page.goto(f"{viewer.url}{path}?fixedDpr=1")
    return page


def _settled_picture(page: Any) -> bytes:
    """Waits until all meshes and textures are loaded and two pictures are equal, and closes the page."""
    wait_until(lambda: page.evaluate(_IS_LOADED), "meshes and textures are loaded", timeout_s=TIMEOUT_S)
    picture, since = b"", time.monotonic()
    end = since + TIMEOUT_S
    while time.monotonic() < min(end, since + _STABLE_S):
        page.wait_for_timeout(200)
        if (newer := page.screenshot(timeout=1000 * TIMEOUT_S)) != picture:
            picture, since = newer, time.monotonic()
    page.close()
    return picture
