"""Serves the page of a simulation from a verb; the verb `demo`, which shows the bundled kitchen."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from mindstage.cli.options import (
    LOCAL_SERVER,
    LOOPBACK,
    EngineName,
    ExitCode,
    Port,
    ServerOptions,
)
from mindstage.cli.output import print_findings, print_json, print_line, print_report, progress_spinner, warn
from mindstage.cli.setup import knowledge_base, make_engine, simulation_from_options
from mindstage.errors import InvalidArgumentError
from mindstage.ranges import WallTime

if TYPE_CHECKING:
    from mindstage.access.certificates import TlsCertificate
    from mindstage.access.limits import VisitorLimits
    from mindstage.simulation import Simulation
    from mindstage.viewer import Viewer

__all__ = [
    "LOCAL_ACCESS",
    "ServerAccess",
    "demo",
    "keep_alive",
    "open_page",
    "open_viewer",
    "print_and_serve",
    "server_access",
    "show_page",
]


BUNDLED = "bundled:kitchen"

_POLL_INTERVAL_S = 0.2
"""Interval at which the deadline and the error of the simulation are checked [s]."""


class ServerAccess(NamedTuple):
    """Who may connect to a server, and how: the values of `--host`, `--token`, `--origin`, `--tls-…` and `--limit`."""

    host: str = LOOPBACK
    token: str | None = None
    origins: Collection[str] = ()
    tls: TlsCertificate | None = None
    limits: VisitorLimits | None = None


LOCAL_ACCESS = ServerAccess()


def server_access(options: ServerOptions, *, origins: Collection[str] = ()) -> ServerAccess:
    """Checks the options before a map is read.

    Raises:
        InvalidArgumentError: the host is not local, and there is no token; a limit is unknown or no number; or there
            is a key without a certificate.
        CertificateError: the certificate cannot be used.
    """
    from mindstage.access.certificates import TlsCertificate
    from mindstage.access.visitors import is_loopback

    host, certificate, key = options.host, options.tls_cert, options.tls_key
    if not options.token and not is_loopback(host):
        remedy = "give a token with --token TOKEN, or omit --host"
        raise InvalidArgumentError(
            "--host", cause="without a token anyone in the network could change the world", remedy=remedy
        )
    if key is not None and certificate is None:
        raise InvalidArgumentError("--tls-key", cause="it requires --tls-cert", remedy="give the certificate too")
    tls = None if certificate is None else TlsCertificate(certificate=certificate, key=key)
    if tls is not None:
        tls.server_context()
    return ServerAccess(host, options.token or None, origins, tls, _visitor_limits(options.limits or ()))


def _visitor_limits(options: Sequence[str]) -> VisitorLimits:
    import msgspec

    from mindstage.access.limits import VisitorLimits

    values = {}
    for option in options:
        name, _, number = option.partition("=")
        if name not in VisitorLimits.__struct_fields__:
            remedy = f"the limits are {', '.join(VisitorLimits.__struct_fields__)}"
            raise InvalidArgumentError("--limit", cause=f"there is no limit {name!r}", remedy=remedy)
        values[name] = number
    try:
        limits = msgspec.convert(values, VisitorLimits, strict=False)
    except msgspec.ValidationError as error:
        remedy = "write NAME=NUMBER, such as connections=8"
        raise InvalidArgumentError("--limit", cause=str(error), remedy=remedy) from error
    for name in values:
        if not 0.0 < getattr(limits, name) < float("inf"):
            raise InvalidArgumentError("--limit", cause=f"{name} must be positive", remedy="give a higher number")
    return limits


def open_viewer(simulation: Simulation, *, port: int | None, access: ServerAccess = LOCAL_ACCESS) -> Viewer:
    """Serves the page; a host that is not local needs a token."""
    from mindstage.api import view

    host, token, origins, tls, limits = access
    return view(
        simulation,
        host=host,
        port=port,
        token=token,
        origins=origins,
        tls=tls,
        visitor_limits=limits,
        autosave=True,
    )


def show_page(
    simulation: Simulation,
    *,
    port: int | None,
    duration_s: float | None,
    announce: Callable[[str], None],
    quiet: bool = False,
    access: ServerAccess = LOCAL_ACCESS,
    tour: bool = False,
) -> None:
    """Serves the page and plays the simulation until Ctrl-C or the end of the duration.

    Args:
        port: the port; None is the default one, or the next free one.
        duration_s: wall time [s]; None for no limit.
        announce: called with the URL when the page is served.
        quiet: whether to print nothing.
        access: who may open the page.
        tour: whether pages offer the tour to new users.
    """
    viewer = open_viewer(simulation, port=port, access=access)
    if tour:
        viewer.offer_tour()
    try:
        announce(viewer.url)
        keep_alive(simulation, duration_s=duration_s, quiet=quiet)
    finally:
        with progress_spinner("closing the page"):
            viewer.close()


def print_and_serve(
    simulation: Simulation,
    summary: Mapping[str, object],
    *,
    port: int | None,
    access: ServerAccess = LOCAL_ACCESS,
    duration_s: float | None,
    as_json: bool,
) -> None:
    """Serves the page, after printing its URL or, with `as_json`, the summary and the URL."""

    def announce(url: str) -> None:
        if as_json:
            print_json({**summary, "url": url})
        else:
            print_line(f"The world is served at {url}")

    show_page(simulation, port=port, access=access, duration_s=duration_s, announce=announce, quiet=as_json)


def open_page(url: str, *, wanted: bool | None) -> None:
    """Opens a web browser; by default only in a terminal with a graphical display.

    Without a display, Python may start a text browser in the terminal.
    """
    has_display = sys.platform in {"darwin", "win32"} or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    if wanted if wanted is not None else (has_display and sys.stdout.isatty()):
        import webbrowser

        if not webbrowser.open(url):
            warn(f"no browser could be started; open {url} manually")


def keep_alive(simulation: Simulation, *, duration_s: float | None, quiet: bool = False) -> None:
    """Plays a simulation in real time for a duration.

    Args:
        duration_s: wall time, which does not depend on pauses [s]; None for no limit.
        quiet: whether to print nothing but errors of the simulation.
    """
    if not quiet:
        print_line("Press Ctrl-C to exit." if duration_s is None else f"Exits after {duration_s:g} s.")
    simulation.play()
    end = None if duration_s is None else time.monotonic() + duration_s
    printed = ""
    while (left_s := _POLL_INTERVAL_S if end is None else min(_POLL_INTERVAL_S, end - time.monotonic())) > 0.0:
        time.sleep(left_s)
        error = simulation.state.error
        if error and error != printed:
            warn(f"the simulation is paused: {error}; reset it on the page")
        printed = error


def demo(
    name: Annotated[str, typer.Argument(hidden=True, show_default=False)] = BUNDLED,
    *,
    engine: EngineName = "mujoco",
    port: Port = None,
    server: ServerOptions = LOCAL_SERVER,
    open_browser: Annotated[
        bool | None,
        typer.Option("--open/--no-open", help="Whether to open a browser; by default only with a graphical display."),
    ] = None,
    seconds: Annotated[
        WallTime | None,
        typer.Option(
            "--for",
            metavar="SECONDS",
            envvar="MINDSTAGE_DEMO_SECONDS",
            help="Exit after this wall time.",
        ),
    ] = None,
) -> ExitCode:
    """Show the bundled kitchen in the browser, with a tour for new users."""
    if name not in {BUNDLED, BUNDLED.partition(":")[2]}:
        remedy = f"another map is shown by: mindstage spawn {name}"
        raise InvalidArgumentError(name, cause=f"the demo shows {BUNDLED}", remedy=remedy)
    access = server_access(server)
    with progress_spinner("loading the kitchen"):
        knowledge = knowledge_base([BUNDLED])
        world = knowledge.world()
        simulation = simulation_from_options(knowledge, make_engine(engine))
    with simulation:
        with progress_spinner("spawning"):
            report = simulation.spawn(world)
        print_findings(knowledge.findings())
        print_report(report, title=world.name, verbose=False)

        def announce(url: str) -> None:
            print_line(f"The kitchen is served at {url}")
            open_page(url, wanted=open_browser)

        show_page(simulation, port=port, duration_s=seconds, announce=announce, access=access, tour=True)
    return ExitCode.OK
