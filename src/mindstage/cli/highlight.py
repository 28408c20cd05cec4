"""Highlight: a question asked of a world that is spawned for it, and its answers lit up there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from mindstage.cli.output import say, warn, working
from mindstage.cli.page import show_page
from mindstage.cli.passing import let_pass
from mindstage.cli.report import report_json, warn_of_failures
from mindstage.cli.staging import stage_for

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase
    from mindstage.knowledge.questions import Answers, Question
    from mindstage.stage import Shown
    from mindstage.world import Colour

__all__ = ["Highlight"]

Tell = Callable[["Answers[Any]", dict[str, object]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Highlight:
    """How answers are shown."""

    colour: Colour | None
    """None lights nothing."""
    engine: Engine
    """Who runs the world; closed in the end."""
    port: int | None
    """Where the page is served; None for no page."""
    seconds: float | None
    """How long the world lives [s]."""
    quiet: bool
    """Whether nothing but the answers is printed."""

    def ask(
        self,
        knowledge: KnowledgeBase,
        question: Question[Any],
        args: Mapping[str, str],
        *,
        map_name: str | None,
        tell: Tell,
    ) -> Answers[Any]:
        """Spawns a map, asks, lights the answers up, and shows them; without any there is nothing to show.

        Args:
            knowledge: what is known.
            question: what is asked.
            args: what it is asked about, as typed.
            map_name: which map is spawned; by default the one that the question is asked about, or the only one.
            tell: prints the answers, and for programs what there is to add.
        """
        with stage_for(knowledge, self.engine) as stage:
            with working("spawning"):
                report = stage.spawn(map_name or _asked_about(knowledge, question, args))
                answers = stage.ask(question, **args)
                shown = stage.highlight(answers, self.colour)
            warn_of_failures(report)
            for dark in () if self.quiet else shown.not_lit:
                warn(f"not lit: {dark.id}: {dark.reason}")
            more = {"engine": stage.engine_name, "spawn": report_json(report)} | _shown_json(shown, self.colour)
            if answers and self.port is not None:
                announce = partial(self._announce, tell, answers, shown, more)
                show_page(stage, port=self.port, duration_s=self.seconds, announce=announce, quiet=self.quiet)
            else:
                let_pass(stage, self.seconds or 0.0)
                tell(answers, more)
        return answers

    def _announce(self, tell: Tell, answers: Answers[Any], shown: Shown, more: dict[str, object], url: str) -> None:
        tell(answers, more | {"url": url})  # now: whoever reads it wants to look while the world lives
        if not self.quiet:
            say(f"{0 if self.colour is None else len(shown.lit)} lit at {url}")


def _asked_about(knowledge: KnowledgeBase, question: Question[Any], args: Mapping[str, str]) -> str | None:
    """The map that a question is asked about, if it is."""
    from mindstage.knowledge.reasoning import NameKind

    about_maps = [argument.name for argument in question.arguments if argument.kind is NameKind.MAP]
    return next((knowledge.names.find(args[name], NameKind.MAP) for name in about_maps if name in args), None)


def _shown_json(shown: Shown, colour: Colour | None) -> dict[str, object]:
    import msgspec

    from mindstage.world.colours import NO_COLOUR, colour_text

    return {
        "colour": NO_COLOUR if colour is None else colour_text(colour),
        "lit": [] if colour is None else list(shown.lit),
        "not_lit": msgspec.to_builtins(shown.not_lit),
    }
