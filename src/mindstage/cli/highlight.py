"""Highlight: a question asked of a world that is spawned for it, and its answers lit up there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from mindstage.cli.output import print_line, progress_spinner, warn
from mindstage.cli.page import show_page
from mindstage.cli.passing import step_with_progress
from mindstage.cli.report import print_failures, report_json
from mindstage.cli.staging import simulation_from_options

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase
    from mindstage.knowledge.questions import Answers, Question
    from mindstage.stage import HighlightResult
    from mindstage.world import Color

__all__ = ["HighlightRun"]

PrintAnswers = Callable[["Answers[Any]", dict[str, object]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class HighlightRun:
    """How answers are shown."""

    color: Color | None
    """None lights nothing."""
    engine: Engine
    """Who runs the world; closed in the end."""
    port: int | None
    """Where the page is served; None for no page."""
    duration_s: float | None
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
        print_answers: PrintAnswers,
    ) -> Answers[Any]:
        """Spawns a map, asks, lights the answers up, and shows them; without any there is nothing to show.

        Args:
            knowledge: what is known.
            question: what is asked.
            args: what it is asked about, as typed.
            map_name: which map is spawned; by default the one that the question is asked about, or the only one.
            tell: prints the answers, and for programs what there is to add.
        """
        with simulation_from_options(knowledge, self.engine) as stage:
            with progress_spinner("spawning"):
                report = stage.spawn(map_name or _map_of_question(knowledge, question, args))
                answers = stage.ask(question, **args)
                shown = stage.highlight(answers, self.color)
            print_failures(report)
            for dark in () if self.quiet else shown.unhighlighted:
                warn(f"not lit: {dark.id}: {dark.reason}")
            more = {"engine": stage.engine_name, "spawn": report_json(report)} | _highlight_json(shown, self.color)
            if answers and self.port is not None:
                announce = partial(self._announce, print_answers, answers, shown, more)
                show_page(stage, port=self.port, duration_s=self.duration_s, announce=announce, quiet=self.quiet)
            else:
                step_with_progress(stage, self.duration_s or 0.0)
                print_answers(answers, more)
        return answers

    def _announce(
        self,
        print_answers: PrintAnswers,
        answers: Answers[Any],
        result: HighlightResult,
        more: dict[str, object],
        url: str,
    ) -> None:
        print_answers(answers, more | {"url": url})  # now: whoever reads it wants to look while the world lives
        if not self.quiet:
            print_line(f"{0 if self.color is None else len(result.highlighted)} lit at {url}")


def _map_of_question(knowledge: KnowledgeBase, question: Question[Any], args: Mapping[str, str]) -> str | None:
    """The map that a question is asked about, if it is."""
    from mindstage.knowledge.reasoning import EntityType

    about_maps = [argument.name for argument in question.arguments if argument.value_type is EntityType.MAP]
    return next((knowledge.names.find(args[name], EntityType.MAP) for name in about_maps if name in args), None)


def _highlight_json(result: HighlightResult, color: Color | None) -> dict[str, object]:
    import msgspec

    from mindstage.world.colors import NO_COLOR, color_name

    return {
        "colour": NO_COLOR if color is None else color_name(color),
        "lit": [] if color is None else list(result.highlighted),
        "not_lit": msgspec.to_builtins(result.unhighlighted),
    }
