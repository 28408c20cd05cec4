"""`mindstage demo`: the bundled kitchen, alive in the browser."""

from __future__ import annotations

from typing import Annotated

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.options import EngineName, PageHost, PageToken, Port, finite
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import print_findings, say, working
from mindstage.cli.page import LOOPBACK, open_page, refuse_open_doors, show_page
from mindstage.cli.report import print_report
from mindstage.cli.sources import knowledge_base
from mindstage.cli.staging import stage_for

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
) -> Outcome:
    """Show the bundled kitchen in the browser: pull its doors and drawers open."""
    refuse_open_doors(host, token)
    with working("furnishing the kitchen"):
        knowledge = knowledge_base(["bundled:kitchen"], ontologies=None, bundled=True)
        world = knowledge.world()
        stage = stage_for(knowledge, make_engine(engine))
    with stage:
        with working("spawning"):
            report = stage.spawn(world)
        print_findings(knowledge.findings())
        print_report(report, title=world.name, verbose=False)

        def announce(url: str) -> None:
            say(f"The kitchen is open at {url}")
            open_page(url, wanted=open_browser)

        show_page(stage, port=port, duration_s=seconds, announce=announce, host=host, token=token)
    return Outcome.DONE
