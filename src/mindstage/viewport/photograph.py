"""Photograph: pictures of the page, taken by a browser that comes as one more visitor.

What it wants to see, nobody else has to see. A picture is finished when nothing in it changes any more; where the
world itself moves, it is what is seen a while after everything has arrived.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar
from urllib.parse import urlencode

import viser

from mindstage.errors import ArgumentRefused, BrowserBroken
from mindstage.viewport.browser import Browser, find_browser
from mindstage.viewport.framing import View
from mindstage.viewport.server import address, key_of
from mindstage.viewport.sights import Labels, Sights
from mindstage.world import BodyId, Vector

__all__ = ["Photographer", "Shot"]

T = TypeVar("T")

_MOST_PX = 8192
"""Of a side: what a browser can draw."""
_STILL_S = 1.2
"""A picture that has not changed for so long is finished."""
_RESTLESS_S = 15.0
"""One that still changes after so long shows something that moves."""
_LOOK_S = 0.2
_SKETCHED = 0.25
"""So much coarser the view is drawn until everything has come: without a GPU the time goes with the points drawn."""
_FINE = 1.0
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
_NOWHERE = View((2.5, -2.5, 2.0), (0.0, 0.0, 0.5), 0.63)
"""How one looks at an empty place."""
_UPRIGHT = 1e-3
"""Straight down no side would be up, so one looks a hair aslant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """What shall be in a picture, and how it is taken."""

    size: tuple[int, int] = (1280, 800)
    """Width and height [px]."""
    position: Vector | None = None
    """Where the eye is [m]; as visitors stand at first, if neither this nor `look_at` is given."""
    look_at: Vector | None = None
    """What is in the middle [m]."""
    top: bool = False
    """Whether one looks straight down, as on a plan."""
    focus: tuple[BodyId, ...] = ()
    """Bodies that shall fill the picture."""
    section: float | None = None
    """A height above which nothing is drawn [m]."""
    select: BodyId | None = None
    """A body with a frame round it, which the page's panel describes."""
    labels: Labels = Labels.NONE
    panels: bool = False
    """Whether the whole page is in the picture, or the world alone."""
    panel: str = ""
    """Which of the page's panels is in front, such as "ask"; by default the one that opens first."""
    browser: str | None = None
    """The executable; by default one that is found."""
    timeout_s: float = 180.0
    """How long all of it may take: without a GPU a large world is drawn slowly [s]."""

    def __post_init__(self) -> None:
        """Refuses what no browser can draw."""
        if not all(0 < side <= _MOST_PX for side in self.size):
            cause = f"{self.size[0]} x {self.size[1]} cannot be drawn"
            raise ArgumentRefused("a picture's size", cause=cause, remedy=f"each side is 1 to {_MOST_PX} px")
        if self.position is not None and self.position == self.look_at:
            raise ArgumentRefused("a picture's view", cause="it is from and to one point", remedy="give two points")
        if self.panel and not self.panels:
            raise ArgumentRefused(self.panel, cause="there are no panels in the picture", remedy="show the whole page")


class Photographer:
    """Takes pictures of one page."""

    def __init__(self, server: viser.ViserServer, sights: Sights, *, token: str | None = None) -> None:
        """Starts nothing yet.

        Args:
            server: of the page.
            sights: what its visitors see.
            token: that its visitors need, if they do.
        """
        self._server, self._sights, self._token = server, sights, token

    def take(self, shot: Shot) -> bytes:
        """Takes one, as PNG.

        Raises:
            BrowserUnavailable: no browser is found, or it does not start.
            BrowserBroken: it ended, or the picture was not finished in time.
            BodyUnknown: a body that shall be seen is not there.
            ArgumentRefused: the page has no such panel.
        """
        end = time.monotonic() + shot.timeout_s
        with Browser(find_browser(shot.browser), size=shot.size, timeout_s=shot.timeout_s) as browser:
            _until(lambda: self._sights.drawn, end, "nothing was drawn")
            key = secrets.token_hex(8)
            if self._token:  # which the page turns into a cookie
                browser.go(f"{address(self._server)}/?{urlencode({'token': self._token})}")
            browser.go(self._address(key, shot))
            if shot.panels:
                key = _until(
                    lambda: browser.evaluate("window.mindstage?.clientKey ?? ''"), end, "the page did not open"
                )
                _bring_forward(browser, shot.panel)
            client = _until(lambda: self._client(key), end, "the view did not open")
            self._prepare(shot, client.client_id)
            if not self._sights.settled(timeout_s=max(0.0, end - time.monotonic())):
                raise BrowserBroken("the page's own thread did not come to it in time")
            _arrive(client, end)
            _come_to_rest(browser, end)
            browser.evaluate(_DRAW % _FINE)
            return browser.picture()

    def _address(self, key: str, shot: Shot) -> str:
        place = "/" if shot.panels else f"/view/{key}/"
        return f"{address(self._server)}{place}?{urlencode({'fixedDpr': _SKETCHED})}"

    def _client(self, key: str) -> viser.ClientHandle | None:
        """The visitor, once it is welcomed."""
        there = self._sights.visitors
        clients = self._server.get_clients().values()
        return next((each for each in clients if each.client_id in there and key_of(each, self._server) == key), None)

    def _prepare(self, shot: Shot, visitor: int) -> None:
        sights, outlook = self._sights, self._sights.outlook
        if shot.section is not None:
            sights.section(shot.section, visitor=visitor)
        if shot.select is not None:
            sights.select(shot.select, visitor=visitor)
        if shot.labels is not Labels.NONE:
            sights.label(shot.labels, visitor=visitor)
        if shot.focus:
            sights.focus(shot.focus, visitor=visitor)
        elif shot.top:
            sights.top(visitor=visitor)
        elif shot.position is not None or shot.look_at is not None:
            usual = outlook.view(shot.size[0] / shot.size[1]) if outlook else _NOWHERE
            sights.look_from(_view(shot, usual), visitor=visitor)


def _bring_forward(browser: Browser, panel: str) -> None:
    """Shows one of the page's panels."""
    known = browser.evaluate("[...document.querySelectorAll('[data-tab]')].map((tab) => tab.dataset.tab)")
    if panel and panel not in known:
        raise ArgumentRefused(panel, cause="the page has no such panel", remedy=f"there is {', '.join(known)}")
    if panel:
        browser.evaluate(f"document.querySelector('[data-tab={panel}]').click()")


def _view(shot: Shot, usual: View) -> View:
    """The view from one point to another; the one that is not given is as usual, as far as it can be."""
    x, y, z = usual.position
    (to_x, to_y, to_z) = usual.look_at
    if shot.position is None and shot.look_at is not None:
        to_x, to_y, to_z, x, y, z = (
            *shot.look_at,
            *(end + eye - middle for end, eye, middle in zip(shot.look_at, usual.position, usual.look_at, strict=True)),
        )
    elif shot.position is not None:
        x, y, z = shot.position
        to_x, to_y, to_z = shot.look_at or usual.look_at
    height = abs(z - to_z)
    if abs(x - to_x) + abs(y - to_y) < _UPRIGHT * height:
        y -= _UPRIGHT * height
    return View((x, y, z), (to_x, to_y, to_z), usual.field_of_view_rad)


def _arrive(client: viser.ClientHandle, end: float) -> None:
    """Waits until the visitor has everything that was sent so far: requests for pictures keep their place among it."""
    try:
        client.get_render(8, 8, timeout=max(0.1, end - time.monotonic()))
    except TimeoutError as error:
        raise BrowserBroken("the view was not drawn in time") from error
    except RuntimeError as error:
        raise BrowserBroken(f"the view was lost: {error}") from error


def _until(look: Callable[[], T | None], end: float, what: str) -> T:
    """What is there at last.

    Raises:
        BrowserBroken: it did not come in time.
    """
    while not (found := look()):
        if time.monotonic() > end:
            raise BrowserBroken(f"{what} in time")
        time.sleep(_LOOK_S / 2)
    return found


def _come_to_rest(browser: Browser, end: float) -> None:
    """Waits until nothing in the picture changes any more, or for a while where the world itself moves."""
    picture = browser.picture()
    start = since = time.monotonic()
    while time.monotonic() < min(end, start + _RESTLESS_S) and time.monotonic() - since <= _STILL_S:
        time.sleep(_LOOK_S)
        if (newer := browser.picture()) != picture:
            picture, since = newer, time.monotonic()
