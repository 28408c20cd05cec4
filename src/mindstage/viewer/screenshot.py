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
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar
from urllib.parse import urlencode

import viser

from mindstage.errors import BrowserCrashedError, BrowserNotFoundError, InvalidArgumentError
from mindstage.scene import BodyId, Vector
from mindstage.viewer.camera import CameraPose, ClientViews, LabelMode
from mindstage.viewer.devtools import CdpPipe
from mindstage.viewer.server import address, session_key_of

__all__ = ["BROWSERS", "HeadlessBrowser", "Screenshot", "ScreenshotTaker", "find_browser"]


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

_MAX_SIZE_PX = 8192
"""Maximum width and height that browsers can render."""
_STABLE_S = 1.2
"""Time without changes after which a picture is finished [s]."""
_MAX_WAIT_S = 15.0
"""Time after which a picture is taken although it still changes [s]."""
_POLL_INTERVAL_S = 0.2
_DRAFT_RESOLUTION = 0.25
"""Device pixel ratio until the scene has loaded: without a GPU, time is proportional to the number of pixels."""
_FINAL_RESOLUTION = 1.0
"""Device pixel ratio of the picture."""
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
_DEFAULT_CAMERA = CameraPose((2.5, -2.5, 2.0), (0.0, 0.0, 0.5), 0.63)
"""The camera for an empty scene."""
_MIN_HORIZONTAL_M = 1e-3
"""Minimum horizontal part of a view direction: straight down, the up direction would be undefined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Screenshot:
    """What a screenshot shows, and how it is taken."""

    size: tuple[int, int] = (1280, 800)
    """Width and height [px]."""
    position: Vector | None = None
    """Position of the camera [m]; without this and `look_at`, the home view."""
    look_at: Vector | None = None
    """Point in the center of the picture [m]."""
    from_above: bool = False
    """Whether the camera looks straight down, as on a floor plan."""
    focus: tuple[BodyId, ...] = ()
    """Bodies that the camera frames."""
    focus_points: tuple[Vector, ...] = ()
    """Points that the camera frames [m]."""
    clip_height: float | None = None
    """Height of the clipping plane: nothing above it is drawn [m]."""
    selected: BodyId | None = None
    """The selected body, whose details are in the panel."""
    labels: LabelMode = LabelMode.NONE
    with_panels: bool = False
    """Whether the picture shows the whole page, or the 3D view alone."""
    panel: str = ""
    """The panel to open, such as "ask"; by default the one that is open initially."""
    browser: str | None = None
    """The executable; by default the one of `find_browser`."""
    timeout_s: float = 180.0
    """Time limit of everything; large worlds are rendered slowly without a GPU [s]."""

    def __post_init__(self) -> None:
        """Checks size, view and panel.

        Raises:
            InvalidArgumentError: one of them is invalid.
        """
        if not all(0 < side <= _MAX_SIZE_PX for side in self.size):
            cause = f"{self.size[0]} x {self.size[1]} cannot be rendered"
            raise InvalidArgumentError("a picture's size", cause=cause, remedy=f"each side is 1 to {_MAX_SIZE_PX} px")
        if self.position is not None and self.position == self.look_at:
            raise InvalidArgumentError(
                "a picture's view", cause="position and look_at are equal", remedy="give two different points"
            )
        if self.panel and not self.with_panels:
            raise InvalidArgumentError(
                self.panel, cause="there are no panels in the picture", remedy="show the whole page"
            )


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
            client = _wait_for(lambda: self._client(key), end, "the view did not open")
            self._prepare(screenshot, client.client_id)
            if not self._views.wait_idle(timeout_s=max(0.0, end - time.monotonic())):
                raise BrowserCrashedError("the view was not updated in time")
            _wait_received(client, end)
            _wait_stable(browser, end)
            browser.evaluate(_DRAW % _FINAL_RESOLUTION)
            return browser.screenshot()

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
            default = target.camera(screenshot.size[0] / screenshot.size[1]) if target else _DEFAULT_CAMERA
            views.set_camera(_camera_for(screenshot, default), client=view)


def _show_panel(browser: HeadlessBrowser, panel: str) -> None:
    """Opens a panel of the page."""
    known = browser.evaluate("[...document.querySelectorAll('[data-tab]')].map((tab) => tab.dataset.tab)")
    if panel and panel not in known:
        raise InvalidArgumentError(panel, cause="the page has no such panel", remedy=f"there is {', '.join(known)}")
    if panel:
        browser.evaluate(f"document.querySelector('[data-tab={panel}]').click()")


def _camera_for(screenshot: Screenshot, default: CameraPose) -> CameraPose:
    """The camera of a screenshot; a missing point is that of the default, moved with the other one."""
    x, y, z = default.position
    (to_x, to_y, to_z) = default.look_at
    if screenshot.position is None and screenshot.look_at is not None:
        to_x, to_y, to_z, x, y, z = (
            *screenshot.look_at,
            *(
                end + eye - middle
                for end, eye, middle in zip(screenshot.look_at, default.position, default.look_at, strict=True)
            ),
        )
    elif screenshot.position is not None:
        x, y, z = screenshot.position
        to_x, to_y, to_z = screenshot.look_at or default.look_at
    height = abs(z - to_z)
    if abs(x - to_x) + abs(y - to_y) < _MIN_HORIZONTAL_M * height:
        y -= _MIN_HORIZONTAL_M * height
    return CameraPose((x, y, z), (to_x, to_y, to_z), default.field_of_view_rad)


def _wait_received(client: viser.ClientHandle, end: float) -> None:
    """Waits until the client has received everything sent so far: it answers a render request after it."""
    try:
        client.get_render(8, 8, timeout=max(0.1, end - time.monotonic()))
    except TimeoutError as error:
        raise BrowserCrashedError("the view was not rendered in time") from error
    except RuntimeError as error:
        raise BrowserCrashedError(f"the connection to the view was lost: {error}") from error


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
    """Waits until the picture no longer changes, or for `_MAX_WAIT_S`."""
    picture = browser.screenshot()
    start = since = time.monotonic()
    while time.monotonic() < min(end, start + _MAX_WAIT_S) and time.monotonic() - since <= _STABLE_S:
        time.sleep(_POLL_INTERVAL_S)
        if (newer := browser.screenshot()) != picture:
            picture, since = newer, time.monotonic()
