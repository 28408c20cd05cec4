"""Page: serves the viewport and keeps the world alive until somebody has seen enough.

`mindstage demo`: the bundled kitchen, alive in the browser.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import EngineName, ExitCode, PageHost, PageToken, Port, finite
from mindstage.cli.output import print_findings, print_json, print_line, print_report, progress_spinner, warn
from mindstage.cli.setup import knowledge_base, make_engine, simulation_from_options
from mindstage.errors import InvalidArgumentError

if TYPE_CHECKING:
    from mindstage.simulation import Simulation
    from mindstage.viewer import Viewer

__all__ = [
    "LOOPBACK",
    "check_token_given",
    "demo",
    "keep_alive",
    "open_page",
    "open_viewer",
    "print_and_serve",
    "show_page",
]


LOOPBACK = "127.0.0.1"

_POLL_INTERVAL_S = 0.2
"""How often it is looked whether time is up, or the world came to a stop [s]."""


def open_viewer(
    simulation: Simulation, *, port: int, host: str = LOOPBACK, token: str | None = None, origins: Collection[str] = ()
) -> Viewer:
    """Serves the page, on this machine only unless another host is named, which takes a token."""
    from mindstage.api import view

    return view(simulation, host=host, port=port, token=token or None, origins=origins)


def check_token_given(host: str, token: str | None) -> None:
    """Looks at what was typed before a long map is read.

    Raises:
        InvalidArgumentError: anybody could come to the page.
    """
    if host != LOOPBACK and not token:
        from mindstage.bridge.server import is_loopback

        if not is_loopback(host):
            remedy = "give --token TOKEN too, or leave it out"
            raise InvalidArgumentError("--host", cause="everyone in the network could change the world", remedy=remedy)


def show_page(
    simulation: Simulation,
    *,
    port: int,
    duration_s: float | None,
    announce: Callable[[str], None],
    quiet: bool = False,
    host: str = LOOPBACK,
    token: str | None = None,
) -> None:
    """Serves the page and keeps the world alive on it.

    Args:
        stage: what is shown.
        port: where; the next one where that is taken.
        duration_s: how long [s]; for ever without.
        announce: told the address once the page is there.
        quiet: whether to keep to oneself how it ends.
        host: where to listen; others than this machine need a token.
        token: what visitors must know.
    """
    viewport = open_viewer(simulation, port=port, host=host, token=token)
    try:
        announce(viewport.url)
        keep_alive(simulation, duration_s=duration_s, quiet=quiet)
    finally:
        viewport.close()


def print_and_serve(
    simulation: Simulation,
    summary: Mapping[str, object],
    *,
    port: int,
    host: str = LOOPBACK,
    token: str | None = None,
    duration_s: float | None,
    as_json: bool,
) -> None:
    """Serves the page, and says where: as JSON together with what there is to tell, which so waits for nobody."""

    def announce(url: str) -> None:
        if as_json:
            print_json({**summary, "url": url})
        else:
            print_line(f"The world is open at {url}")

    show_page(simulation, port=port, host=host, token=token, duration_s=duration_s, announce=announce, quiet=as_json)


def open_page(url: str, *, wanted: bool | None) -> None:
    """Opens the person's browser; unasked only where a person with a screen is there.

    Without a screen Python may start a browser that takes over the terminal.
    """
    has_screen = sys.platform in {"darwin", "win32"} or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    if wanted if wanted is not None else (has_screen and sys.stdout.isatty()):
        import webbrowser

        if not webbrowser.open(url):
            warn(f"no browser could be started here; open {url} yourself")


def keep_alive(simulation: Simulation, *, duration_s: float | None, quiet: bool = False) -> None:
    """Plays in real time until the time is up; for ever without one.

    Args:
        stage: what plays.
        duration_s: real time, not simulated: somebody may pause the world on the page [s].
        quiet: whether to keep to oneself how it ends.
    """
    if not quiet:
        print_line("Ctrl-C ends it." if duration_s is None else f"It ends in {duration_s:g} s.")
    simulation.play()
    end = None if duration_s is None else time.monotonic() + duration_s
    told = ""
    while (left_s := _POLL_INTERVAL_S if end is None else min(_POLL_INTERVAL_S, end - time.monotonic())) > 0.0:
        time.sleep(left_s)
        fault = simulation.state.error
        if fault and fault != told:
            warn(f"the world stands still: {fault}; reset it on the page")
        told = fault


def demo(
    *,
    engine: EngineName = "mujoco",
    port: Port = 8080,
    host: PageHost = LOOPBACK,
    token: PageToken = None,
    open_browser: Annotated[
        bool | None,
        typer.Option("--open/--no-open", help="Whether to open the page; by default where there is a screen."),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            "--for", metavar="SECONDS", min=0.0, callback=finite, envvar="MINDSTAGE_DEMO_SECONDS", help="End by itself."
        ),
    ] = None,
) -> ExitCode:
    """Show the bundled kitchen in the browser: pull its doors and drawers open."""
    check_token_given(host, token)
    with progress_spinner("furnishing the kitchen"):
        knowledge = knowledge_base(["bundled:kitchen"], ontologies=None, bundled=True)
        world = knowledge.world()
        stage = simulation_from_options(knowledge, make_engine(engine))
    with stage:
        with progress_spinner("spawning"):
            report = stage.spawn(world)
        print_findings(knowledge.findings())
        print_report(report, title=world.name, verbose=False)

        def announce(url: str) -> None:
            print_line(f"The kitchen is open at {url}")
            open_page(url, wanted=open_browser)

        show_page(stage, port=port, duration_s=seconds, announce=announce, host=host, token=token)
    return ExitCode.OK
