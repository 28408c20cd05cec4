"""Prolog: a console where every question is a predicate."""

from mindstage.prolog.console import PrologConsole, Solution
from mindstage.prolog.swipl import load_library

__all__ = ["PrologConsole", "Solution", "load_library"]
