"""Photograph: pictures of the page, taken by a browser that comes as one more visitor.

What it wants to see, nobody else has to see. A picture is finished when nothing in it changes any more; where the
world itself moves, it is what is seen a while after everything has arrived.

Browser: a headless Chromium of this machine with one page, to take pictures of.

It draws without a GPU, so that the same page gives the same picture everywhere, and keeps nothing once it is closed.
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
"""The executables that are looked for; the first that is there is taken."""

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
"""Where the system does not let a browser have one: as root, and in most containers. It sees pages of ours only."""


def find_browser(executable: str | None = None) -> Path:
    """The executable that was named, or else one of those that are usual.

    Raises:
        BrowserNotFoundError: there is none.
    """
    found = next(filter(None, map(shutil.which, (executable,) if executable else BROWSERS)), None)
    if found is None:
        raise BrowserNotFoundError(
            f"there is no program {executable!r}" if executable else "none is installed", searched=BROWSERS
        )
    return Path(found)


class HeadlessBrowser:
    """A browser with one page; leaving its context ends it."""

    def __init__(
        self, executable: Path | None = None, *, size: tuple[int, int] = (1280, 800), timeout_s: float = 60.0
    ) -> None:
        """Starts it.

        Args:
            executable: of Chromium, Chrome, or a relative of theirs; by default one that is found.
            size: of the page, width and height [px].
            timeout_s: how long it may take to start, and for each thing that it is asked for [s].

        Raises:
            BrowserNotFoundError: none is found, or it does not start.
        """
        if os.name != "posix":
            raise BrowserNotFoundError("it can be driven on Linux and macOS only")
        self._timeout_s = timeout_s
        found = executable or find_browser()
        self._folder = Path(tempfile.mkdtemp(prefix="mindstage-browser-"))
        try:
            try:
                self._start(found, (), size)
            except BrowserCrashedError:
                if not self._tools.has_exited:
                    raise
                self._tools.close()
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
        """Opens an address in the page.

        Raises:
            BrowserCrashedError: nobody answers there, or the browser broke.
        """
        if trouble := self._send_command("Page.navigate", {"url": url}).get("errorText"):
            raise BrowserCrashedError(f"it cannot open the page: {trouble}")

    def evaluate(self, expression: str) -> Any:
        """What an expression in JavaScript is worth on the page.

        Raises:
            BrowserCrashedError: the expression fails, or the browser broke.
        """
        told = self._send_command(
            "Runtime.evaluate", {"expression": expression, "returnByValue": True, "awaitPromise": True}
        )
        if (fault := told.get("exceptionDetails")) is not None:
            raise BrowserCrashedError(
                f"the page has a fault: {fault.get('exception', fault).get('description', fault)}"
            )
        return told["result"].get("value")

    def screenshot(self) -> bytes:
        """The page as it is now, as PNG.

        Raises:
            BrowserCrashedError: it is gone, or too slow.
        """
        return base64.b64decode(self._send_command("Page.captureScreenshot", {"format": "png"})["data"])

    def close(self) -> None:
        """Ends it; any number of times."""
        if tools := self.__dict__.get("_tools"):
            tools.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _start(self, executable: Path, more: tuple[str, ...], size: tuple[int, int]) -> None:
        width, height = size
        window = f"--window-size={width},{height}"
        self._tools = CdpPipe(executable, (*_ARGUMENTS, window, *more), folder=self._folder)
        self._session = ""
        target = self._send_command("Target.createTarget", {"url": "about:blank"})["targetId"]
        self._session = self._send_command("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._send_command("Emulation.setDeviceMetricsOverride", metrics)

    def _send_command(self, method: str, params: Mapping[str, object] | None = None) -> dict[str, Any]:
        return self._tools.send(method, params, session=self._session, timeout_s=self._timeout_s)


T = TypeVar("T")

_MAX_SIZE_PX = 8192
"""Of a side: what a browser can draw."""
_STABLE_S = 1.2
"""A picture that has not changed for so long is finished."""
_MAX_WAIT_S = 15.0
"""One that still changes after so long shows something that moves."""
_POLL_INTERVAL_S = 0.2
_DRAFT_RESOLUTION = 0.25
"""So much coarser the view is drawn until everything has come: without a GPU the time goes with the points drawn."""
_FINAL_RESOLUTION = 1.0
"""So fine it is drawn in the end; edges are smoothed by the browser."""
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
"""Draws the view once as fine as that, and no more."""
_DEFAULT_CAMERA = CameraPose((2.5, -2.5, 2.0), (0.0, 0.0, 0.5), 0.63)
"""How one looks at an empty place."""
_MIN_HORIZONTAL_M = 1e-3
"""Straight down no side would be up, so one looks a hair aslant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Screenshot:
    """What shall be in a picture, and how it is taken."""

    size: tuple[int, int] = (1280, 800)
    """Width and height [px]."""
    position: Vector | None = None
    """Where the eye is [m]; as visitors stand at first, if neither this nor `look_at` is given."""
    look_at: Vector | None = None
    """What is in the middle [m]."""
    from_above: bool = False
    """Whether one looks straight down, as on a plan."""
    focus: tuple[BodyId, ...] = ()
    """Bodies that shall fill the picture."""
    clip_height: float | None = None
    """A height above which nothing is drawn [m]."""
    selected: BodyId | None = None
    """A body with a frame round it, which the page's panel describes."""
    labels: LabelMode = LabelMode.NONE
    with_panels: bool = False
    """Whether the whole page is in the picture, or the world alone."""
    panel: str = ""
    """Which of the page's panels is in front, such as "ask"; by default the one that opens first."""
    browser: str | None = None
    """The executable; by default one that is found."""
    timeout_s: float = 180.0
    """How long all of it may take: without a GPU a large world is drawn slowly [s]."""

    def __post_init__(self) -> None:
        """Refuses what no browser can draw."""
        if not all(0 < side <= _MAX_SIZE_PX for side in self.size):
            cause = f"{self.size[0]} x {self.size[1]} cannot be drawn"
            raise InvalidArgumentError("a picture's size", cause=cause, remedy=f"each side is 1 to {_MAX_SIZE_PX} px")
        if self.position is not None and self.position == self.look_at:
            raise InvalidArgumentError(
                "a picture's view", cause="it is from and to one point", remedy="give two points"
            )
        if self.panel and not self.with_panels:
            raise InvalidArgumentError(
                self.panel, cause="there are no panels in the picture", remedy="show the whole page"
            )


class ScreenshotTaker:
    """Takes pictures of one page."""

    def __init__(self, server: viser.ViserServer, views: ClientViews, *, token: str | None = None) -> None:
        """Starts nothing yet.

        Args:
            server: of the page.
            sights: what its visitors see.
            token: that its visitors need, if they do.
        """
        self._server, self._views, self._token = server, views, token

    def take(self, screenshot: Screenshot) -> bytes:
        """Takes one, as PNG.

        Raises:
            BrowserNotFoundError: no browser is found, or it does not start.
            BrowserCrashedError: it ended, or the picture was not finished in time.
            BodyNotFoundError: a body that shall be seen is not there.
            InvalidArgumentError: the page has no such panel.
        """
        end = time.monotonic() + screenshot.timeout_s
        with HeadlessBrowser(
            find_browser(screenshot.browser), size=screenshot.size, timeout_s=screenshot.timeout_s
        ) as browser:
            _wait_for(lambda: self._views.is_drawn, end, "nothing was drawn")
            key = secrets.token_hex(8)
            if self._token:  # which the page turns into a cookie
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
                raise BrowserCrashedError("the page's own thread did not come to it in time")
            _wait_received(client, end)
            _wait_stable(browser, end)
            browser.evaluate(_DRAW % _FINAL_RESOLUTION)
            return browser.screenshot()

    def _address(self, key: str, screenshot: Screenshot) -> str:
        place = "/" if screenshot.with_panels else f"/view/{key}/"
        return f"{address(self._server)}{place}?{urlencode({'fixedDpr': _DRAFT_RESOLUTION})}"

    def _client(self, key: str) -> viser.ClientHandle | None:
        """The visitor, once it is welcomed."""
        there = self._views.clients
        clients = self._server.get_clients().values()
        return next(
            (each for each in clients if each.client_id in there and session_key_of(each, self._server) == key), None
        )

    def _prepare(self, screenshot: Screenshot, view: int) -> None:
        sights, outlook = self._views, self._views.target
        if screenshot.clip_height is not None:
            sights.set_clip_height(screenshot.clip_height, client=view)
        if screenshot.selected is not None:
            sights.select(screenshot.selected, client=view)
        if screenshot.labels is not LabelMode.NONE:
            sights.set_labels(screenshot.labels, client=view)
        if screenshot.focus:
            sights.focus(screenshot.focus, client=view)
        elif screenshot.from_above:
            sights.go_top(client=view)
        elif screenshot.position is not None or screenshot.look_at is not None:
            usual = outlook.camera(screenshot.size[0] / screenshot.size[1]) if outlook else _DEFAULT_CAMERA
            sights.set_camera(_camera_for(screenshot, usual), client=view)


def _show_panel(browser: HeadlessBrowser, panel: str) -> None:
    """Shows one of the page's panels."""
    known = browser.evaluate("[...document.querySelectorAll('[data-tab]')].map((tab) => tab.dataset.tab)")
    if panel and panel not in known:
        raise InvalidArgumentError(panel, cause="the page has no such panel", remedy=f"there is {', '.join(known)}")
    if panel:
        browser.evaluate(f"document.querySelector('[data-tab={panel}]').click()")


def _camera_for(screenshot: Screenshot, default: CameraPose) -> CameraPose:
    """The view from one point to another; the one that is not given is as usual, as far as it can be."""
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
    """Waits until the visitor has everything that was sent so far: requests for pictures keep their place among it."""
    try:
        client.get_render(8, 8, timeout=max(0.1, end - time.monotonic()))
    except TimeoutError as error:
        raise BrowserCrashedError("the view was not drawn in time") from error
    except RuntimeError as error:
        raise BrowserCrashedError(f"the view was lost: {error}") from error


def _wait_for(condition: Callable[[], T | None], end: float, label: str) -> T:
    """What is there at last.

    Raises:
        BrowserCrashedError: it did not come in time.
    """
    while not (found := condition()):
        if time.monotonic() > end:
            raise BrowserCrashedError(f"{label} in time")
        time.sleep(_POLL_INTERVAL_S / 2)
    return found


def _wait_stable(browser: HeadlessBrowser, end: float) -> None:
    """Waits until nothing in the picture changes any more, or for a while where the world itself moves."""
    picture = browser.screenshot()
    start = since = time.monotonic()
    while time.monotonic() < min(end, start + _MAX_WAIT_S) and time.monotonic() - since <= _STABLE_S:
        time.sleep(_POLL_INTERVAL_S)
        if (newer := browser.screenshot()) != picture:
            picture, since = newer, time.monotonic()
