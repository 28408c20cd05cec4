"""Page: serves the viewport and keeps the world alive until somebody has seen enough."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from mindstage.cli.output import say, warn

if TYPE_CHECKING:
    from mindstage.stage import Stage
    from mindstage.viewport import Viewport

__all__ = ["keep_alive", "open_page", "open_viewport", "show_page"]

_LOOK_S = 0.2
"""How often it is looked whether time is up, or the world came to a stop [s]."""


def open_viewport(stage: Stage, *, port: int) -> Viewport:
    """Serves the page on this machine only."""
    from mindstage.viewport import Viewport

    return Viewport(stage, host="127.0.0.1", port=port)


def show_page(
    stage: Stage, *, port: int, duration_s: float | None, announce: Callable[[str], None], quiet: bool = False
) -> None:
    """Serves the page and keeps the world alive on it.

    Args:
        stage: what is shown.
        port: where; the next one where that is taken.
        duration_s: how long [s]; for ever without.
        announce: told the address once the page is there.
        quiet: whether to keep to oneself how it ends.
    """
    viewport = open_viewport(stage, port=port)
    try:
        announce(viewport.url)
        keep_alive(stage, duration_s=duration_s, quiet=quiet)
    finally:
        viewport.close()


def open_page(url: str, *, wanted: bool | None) -> None:
    """Opens the person's browser; unasked only where a person with a screen is there.

    Without a screen Python may start a browser that takes over the terminal.
    """
    has_screen = sys.platform in {"darwin", "win32"} or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    if wanted if wanted is not None else (has_screen and sys.stdout.isatty()):
        import webbrowser

        if not webbrowser.open(url):
            warn(f"no browser could be started here; open {url} yourself")


def keep_alive(stage: Stage, *, duration_s: float | None, quiet: bool = False) -> None:
    """Plays in real time until the time is up; for ever without one.

    Args:
        stage: what plays.
        duration_s: real time, not simulated: somebody may pause the world on the page [s].
        quiet: whether to keep to oneself how it ends.
    """
    if not quiet:
        say("Ctrl-C ends it." if duration_s is None else f"It ends in {duration_s:g} s.")
    stage.play()
    end = None if duration_s is None else time.monotonic() + duration_s
    told = ""
    while (left_s := _LOOK_S if end is None else min(_LOOK_S, end - time.monotonic())) > 0.0:
        time.sleep(left_s)
        fault = stage.frame.fault
        if fault and fault != told:
            warn(f"the world stands still: {fault}; reset it on the page")
        told = fault
