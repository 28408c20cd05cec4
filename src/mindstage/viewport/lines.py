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
    from mindstage.stage import Simulation

__all__ = ["has_prolog", "solve_line"]

_prolog_lock = threading.Lock()
"""There is one Prolog in a process; visitors take turns."""


@cache
def has_prolog() -> bool:
    """Whether SWI-Prolog and its bridge to Python are installed; nothing is started to find out."""
    return find_spec("pyswip") is not None and shutil.which("swipl") is not None


def solve_line(simulation: Simulation, line: str, *, limit: int, timeout_s: float) -> list[dict[str, Any]]:
    """What makes a line true: its variables and what they stand for.

    Raises:
        PrologUnavailableError: it is not installed, or somebody else in this process has it.
        PrologGoalError: it is no Prolog, or more than a question.
        PrologTimeoutError: it did not end in time.
    """
    from mindstage.prolog import PrologConsole

    with _prolog_lock, PrologConsole(simulation) as console:
        return console.answers(line, limit=limit, timeout_s=timeout_s)
