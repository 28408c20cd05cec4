"""Browser: a headless Chromium of this machine with one page, to take pictures of.

It draws without a GPU, so that the same page gives the same picture everywhere, and keeps nothing once it is closed.
"""

from __future__ import annotations

import base64
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from mindstage.errors import BrowserCrashedError, BrowserNotFoundError
from mindstage.viewport.devtools import CdpPipe

__all__ = ["BROWSERS", "HeadlessBrowser", "find_browser"]

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
