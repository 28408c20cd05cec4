"""Screenshots of the page, taken by a headless Chromium that connects as one more client.

Camera, selection and labels are set for this client only. The browser renders without a GPU, so that pictures are the
same on every machine. A picture is taken once it no longer changes, or after a while if the simulation is running.
"""

from __future__ import annotations

import base64
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self, TypeVar
from urllib.parse import urlencode

import viser

from mindstage.errors import BrowserCrashedError, BrowserNotFoundError, InvalidArgumentError
from mindstage.rendering.screenshot import DEFAULT_CAMERA, LabelMode, Screenshot, placed_camera
from mindstage.viewer.client_views import ClientViews
from mindstage.viewer.devtools import CdpPipe
from mindstage.viewer.server import address, session_key_of

__all__ = ["BROWSERS", "HeadlessBrowser", "ScreenshotTaker", "find_browser"]


BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "microsoft-edge-stable",
    "brave-browser",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
)
"""The executables that are searched for, in this order."""

_ARGUMENTS = (
    "--headless=new",
    "--remote-debugging-pipe",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--force-color-profile=srgb",
    "--hide-scrollbars",
    "--mute-audio",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--no-default-browser-check",
    "--no-first-run",
    "--no-proxy-server",
    "--password-store=basic",
    "--use-mock-keychain",
)
_WITHOUT_SANDBOX = "--no-sandbox"
"""For systems without sandboxing: root, most containers. The browser only opens pages of this server."""


def find_browser(executable: str | None = None) -> Path:
    """Finds an executable by its name or path; by default one of `BROWSERS`.

    Raises:
        BrowserNotFoundError: it is not installed.
    """
    found = next(filter(None, map(shutil.which, (executable,) if executable else BROWSERS)), None)
    if found is None:
        raise BrowserNotFoundError(
            f"there is no program {executable!r}" if executable else "none is installed", searched=BROWSERS
        )
    return Path(found)


class HeadlessBrowser:
    """A browser process with one page; a context manager that closes it."""

    def __init__(
        self, executable: Path | None = None, *, size: tuple[int, int] = (1280, 800), timeout_s: float = 60.0
    ) -> None:
        """Starts the browser.

        Args:
            executable: Chromium or a browser derived from it; by default the one of `find_browser`.
            size: width and height of the page [px].
            timeout_s: time limit of the start and of each command [s].

        Raises:
            BrowserNotFoundError: no browser is installed, or it does not start.
        """
        if os.name != "posix":
            raise BrowserNotFoundError("it can be controlled on Linux and macOS only")
        self._timeout_s = timeout_s
        found = executable or find_browser()
        self._folder = Path(tempfile.mkdtemp(prefix="mindstage-browser-"))
        try:
            try:
                self._start(found, (), size)
            except BrowserCrashedError:
                if not self._pipe.has_exited:
                    raise
                self._pipe.close()
                self._start(found, (_WITHOUT_SANDBOX,), size)
        except (BrowserCrashedError, OSError) as error:
            self.close()
            raise BrowserNotFoundError(f"{found} does not start: {error}") from error
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def navigate(self, url: str) -> None:
        """Opens an address.

        Raises:
            BrowserCrashedError: the address cannot be opened, or the browser has crashed.
        """
        if cause := self._send_command("Page.navigate", {"url": url}).get("errorText"):
            raise BrowserCrashedError(f"it cannot open the page: {cause}")

    def accept_own_certificate(self) -> None:
        """Opens pages with any certificate: that of this server may have a name other than the loopback address."""
        self._send_command("Security.setIgnoreCertificateErrors", {"ignore": True})

    def evaluate(self, expression: str) -> Any:
        """Evaluates a JavaScript expression; promises are awaited.

        Raises:
            BrowserCrashedError: the expression throws, or the browser has crashed.
        """
        reply = self._send_command(
            "Runtime.evaluate", {"expression": expression, "returnByValue": True, "awaitPromise": True}
        )
        if (details := reply.get("exceptionDetails")) is not None:
            raise BrowserCrashedError(
                f"an error on the page: {details.get('exception', details).get('description', details)}"
            )
        return reply["result"].get("value")

    def screenshot(self) -> bytes:
        """Takes a picture of the page.

        Returns:
            The bytes of a PNG file.

        Raises:
            BrowserCrashedError: the browser has crashed, or did not answer in time.
        """
        return base64.b64decode(self._send_command("Page.captureScreenshot", {"format": "png"})["data"])

    def close(self) -> None:
        """Ends the browser; calling it again is harmless."""
        if pipe := self.__dict__.get("_pipe"):
            pipe.close()
        for _ in range(20):  # processes of the browser that still end may write again
            shutil.rmtree(self._folder, ignore_errors=True)
            if not self._folder.exists():
                return
            time.sleep(0.05)

    def _start(self, executable: Path, arguments: tuple[str, ...], size: tuple[int, int]) -> None:
        width, height = size
        window = f"--window-size={width},{height}"
        self._pipe = CdpPipe(executable, (*_ARGUMENTS, window, *arguments), folder=self._folder)
        self._pipe.start()
        self._session = ""
        target = self._send_command("Target.createTarget", {"url": "about:blank"})["targetId"]
        self._session = self._send_command("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._send_command("Emulation.setDeviceMetricsOverride", metrics)

    def _send_command(self, method: str, params: Mapping[str, object] | None = None) -> dict[str, Any]:
        return self._pipe.send(method, params, session=self._session, timeout_s=self._timeout_s)


T = TypeVar("T")

_STABLE_S = 1.2
"""Time without changes after which a picture is finished [s]."""
_MAX_WAIT_S = 15.0
"""Time after which a picture is taken although it still changes [s]."""
_POLL_INTERVAL_S = 0.2
_DRAFT_RESOLUTION = 0.25
"""Device pixel ratio until the scene has loaded: without a GPU, time is proportional to the number of pixels."""
_FINAL_RESOLUTION = 1.0
"""Device pixel ratio of the picture."""
_PENDING_TEXTURES = "(document.getElementById('view')?.contentWindow ?? window).mindstageView?.pendingTextures?.() ?? 0"
"""The number of images of textures that the view has requested and not received."""
_DRAW = """new Promise((drawn) => {
  const window_ = document.getElementById("view")?.contentWindow ?? window;
  const view = window_.__viserMutable;
  const three = view.scene.__r3f.root.getState();
  three.setDpr(%s);
  view.requestRender();
  window_.requestAnimationFrame(() => window_.requestAnimationFrame(() => {
    three.setFrameloop("never");
    drawn(true);
  }));
})"""
"""Renders one frame at a device pixel ratio, and stops rendering."""


class ScreenshotTaker:
    """Takes screenshots of one page."""

    def __init__(self, server: viser.ViserServer, views: ClientViews, *, token: str | None = None) -> None:
        """Starts no browser yet.

        Args:
            server: the server of the page.
            views: the views of its clients.
            token: the token that clients need, if any.
        """
        self._server, self._views, self._token = server, views, token

    def take(self, screenshot: Screenshot) -> bytes:
        """Takes a screenshot.

        Args:
            screenshot: what to show.

        Returns:
            The bytes of a PNG file.

        Raises:
            BrowserNotFoundError: no browser is installed, or it does not start.
            BrowserCrashedError: the browser has crashed, or the picture was not finished in time.
            BodyNotFoundError: a body of the screenshot does not exist.
            InvalidArgumentError: the page has no such panel.
        """
        end = time.monotonic() + screenshot.timeout_s
        with HeadlessBrowser(
            find_browser(screenshot.browser), size=screenshot.size, timeout_s=screenshot.timeout_s
        ) as browser:
            _wait_for(lambda: self._views.is_drawn, end, "nothing was drawn")
            key = secrets.token_hex(8)
            if address(self._server).startswith("https:"):
                browser.accept_own_certificate()
            if self._token:  # exchanged for a cookie
                browser.navigate(f"{address(self._server)}/?{urlencode({'token': self._token})}")
            browser.navigate(self._address(key, screenshot))
            if screenshot.with_panels:
                key = _wait_for(
                    lambda: browser.evaluate("window.mindstage?.clientKey ?? ''"), end, "the page did not open"
                )
                _show_panel(browser, screenshot.panel)
            while not self._is_received(screenshot, key, end):
                time.sleep(_POLL_INTERVAL_S)
            _wait_stable(browser, end)
            browser.evaluate(_DRAW % _FINAL_RESOLUTION)
            return browser.screenshot()

    def _is_received(self, screenshot: Screenshot, key: str, end: float) -> bool:
        """Prepares the view and waits until the browser has everything; False if it lost its connection meanwhile.

        A browser that is busy with a large map may answer too late to keep its connection; it then connects anew.
        """
        client = _wait_for(lambda: self._client(key), end, "the view did not open")
        self._prepare(screenshot, client.client_id)
        if not self._views.wait_idle(timeout_s=max(0.0, end - time.monotonic())):
            raise BrowserCrashedError("the view was not updated in time")
        try:
            client.get_render(8, 8, timeout=max(0.1, end - time.monotonic()))  # answered after all earlier messages
        except TimeoutError as error:
            raise BrowserCrashedError("the view was not rendered in time") from error
        except RuntimeError as error:
            if time.monotonic() > end:
                raise BrowserCrashedError(f"the connection to the view was lost: {error}") from error
            return False
        return True

    def _address(self, key: str, screenshot: Screenshot) -> str:
        path = "/" if screenshot.with_panels else f"/view/{key}/"
        return f"{address(self._server)}{path}?{urlencode({'fixedDpr': _DRAFT_RESOLUTION})}"

    def _client(self, key: str) -> viser.ClientHandle | None:
        """The connection of the browser, once its view exists."""
        known = self._views.clients
        clients = self._server.get_clients().values()
        return next(
            (each for each in clients if each.client_id in known and session_key_of(each, self._server) == key), None
        )

    def _prepare(self, screenshot: Screenshot, view: int) -> None:
        views, target = self._views, self._views.target
        if screenshot.clip_height is not None:
            views.set_clip_height(screenshot.clip_height, client=view)
        if screenshot.selected is not None:
            views.select(screenshot.selected, client=view)
        if screenshot.labels is not LabelMode.NONE:
            views.set_labels(screenshot.labels, client=view)
        if screenshot.focus:
            views.focus(screenshot.focus, client=view)
        elif screenshot.focus_points:
            views.focus_points(screenshot.focus_points, client=view)
        elif screenshot.from_above:
            views.go_top(client=view)
        elif screenshot.position is not None or screenshot.look_at is not None:
            default = target.camera(screenshot.aspect) if target else DEFAULT_CAMERA
            views.set_camera(placed_camera(screenshot, default), client=view)


def _show_panel(browser: HeadlessBrowser, panel: str) -> None:
    """Opens a panel of the page."""
    known = browser.evaluate("[...document.querySelectorAll('[data-tab]')].map((tab) => tab.dataset.tab)")
    if panel and panel not in known:
        raise InvalidArgumentError(panel, cause="the page has no such panel", remedy=f"there is {', '.join(known)}")
    if panel:
        browser.evaluate(f"document.querySelector('[data-tab={panel}]').click()")


def _wait_for(condition: Callable[[], T | None], end: float, label: str) -> T:
    """Polls a condition until it is true, and returns its value.

    Raises:
        BrowserCrashedError: it did not become true in time.
    """
    while not (found := condition()):
        if time.monotonic() > end:
            raise BrowserCrashedError(f"{label} in time")
        time.sleep(_POLL_INTERVAL_S / 2)
    return found


def _wait_stable(browser: HeadlessBrowser, end: float) -> None:
    """Waits until all textures are loaded, then until the picture no longer changes, or for `_MAX_WAIT_S`."""
    while time.monotonic() < end and browser.evaluate(_PENDING_TEXTURES):
        time.sleep(_POLL_INTERVAL_S)
    picture = browser.screenshot()
    start = since = time.monotonic()
    while time.monotonic() < min(end, start + _MAX_WAIT_S) and time.monotonic() - since <= _STABLE_S:
        time.sleep(_POLL_INTERVAL_S)
        if browser.evaluate(_PENDING_TEXTURES):
            start = since = time.monotonic()
        if (newer := browser.screenshot()) != picture:
            picture, since = newer, time.monotonic()
