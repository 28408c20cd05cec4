"""`mindstage demo`: the bundled kitchen, alive in the browser."""

from __future__ import annotations

from typing import Annotated

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.options import EngineName, PageHost, PageToken, Port, finite
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import print_findings, print_line, progress_spinner
from mindstage.cli.page import LOOPBACK, check_token_given, open_page, show_page
from mindstage.cli.report import print_report
from mindstage.cli.sources import knowledge_base
from mindstage.cli.staging import simulation_from_options

__all__ = ["demo"]


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
