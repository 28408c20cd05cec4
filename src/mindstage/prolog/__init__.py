"""Prolog: every declared question as a predicate, in SWI-Prolog embedded in this process."""

from mindstage.prolog.console import PrologConsole, Solution, Solutions, solve_query
from mindstage.prolog.swipl import is_installed, load_library

__all__ = ["PrologConsole", "Solution", "Solutions", "is_installed", "load_library", "solve_query"]

__dir__ = __all__.copy
