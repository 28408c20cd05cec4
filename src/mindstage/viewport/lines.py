"""Lines: what a visitor asks in Prolog, where that is installed.

A visitor's line can ask the questions and join their answers, and no more: each goal in it is held against a list
before anything runs (`prolog/line_queries.pl`).
"""

from __future__ import annotations

import shutil
import threading
from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mindstage.stage import Stage

__all__ = ["answers_to_line", "has_prolog"]

_turn = threading.Lock()
"""There is one Prolog in a process; visitors take turns."""


@cache
def has_prolog() -> bool:
    """Whether SWI-Prolog and its bridge to Python are installed; nothing is started to find out."""
    return find_spec("pyswip") is not None and shutil.which("swipl") is not None


def answers_to_line(stage: Stage, line: str, *, limit: int, timeout_s: float) -> list[dict[str, Any]]:
    """What makes a line true: its variables and what they stand for.

    Raises:
        PrologUnavailable: it is not installed, or somebody else in this process has it.
        GoalRefused: it is no Prolog, or more than a question.
        GoalTimedOut: it did not end in time.
    """
    from mindstage.prolog import PrologConsole

    with _turn, PrologConsole(stage) as console:
        return console.answers(line, limit=limit, timeout_s=timeout_s)
