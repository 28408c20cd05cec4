"""Cases of one test, as subtests instead of items.

An item costs its setup, and its part of the collection in every worker, some milliseconds in all: more than a test of
one expression takes.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pytest

__all__ = ["each_case"]

Test = Callable[..., None]


def each_case(
    names: str | Sequence[str], cases: Iterable[Any], *, ids: Callable[[Any], object] | Iterable[object] = str
) -> Callable[[Test], Test]:
    """Runs a test for each case; all cases run, and a failure has the case in its name.

    The arguments are those of `pytest.mark.parametrize`, and several decorators make all combinations, too. Fixtures
    are made once for all cases: for a test that changes them, use `pytest.mark.parametrize`.
    """
    names = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    own = [_named(names, case, ids) for case in cases] if callable(ids) else []
    if not callable(ids):
        own = [(str(id), _named(names, case, str)[1]) for id, case in zip(ids, cases, strict=True)]

    def decorate(test: Test) -> Test:
        inner, previous = getattr(test, "test_and_cases", (test, [("", {})]))
        combined = [
            (", ".join(filter(None, (name, other_name))), {**values, **other})
            for name, values in own
            for other_name, other in previous
        ]
        signature = inspect.signature(test)
        assert {*names} <= {*signature.parameters}, f"{test.__name__} has not all parameters of {names}"

        @functools.wraps(inner)
        def run(subtests: pytest.Subtests, **fixtures: Any) -> None:
            for name, values in combined:
                with subtests.test(name):
                    inner(**values, **fixtures)

        fixtures = [each for name, each in signature.parameters.items() if name not in {*names, "subtests"}]
        subtests = inspect.Parameter("subtests", inspect.Parameter.KEYWORD_ONLY)
        run.__signature__ = signature.replace(parameters=[*fixtures, subtests])  # type: ignore[attr-defined]
        run.test_and_cases = (inner, combined)  # type: ignore[attr-defined]
        return run

    return decorate


def _named(names: Sequence[str], case: Any, ids: Callable[[Any], object]) -> tuple[str, dict[str, Any]]:
    """The name of a case, and its values by parameter."""
    given = case if isinstance(case, type(pytest.param())) else None
    values = given.values if given else (case,) if len(names) == 1 else tuple(case)
    name = str(given.id) if given and given.id is not None else "-".join(str(ids(value)) for value in values)
    name = name.encode("utf-8", "backslashreplace").decode()  # xdist sends it as UTF-8
    return name, dict(zip(names, values, strict=True))
