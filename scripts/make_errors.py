"""Writes docs/reference/python/errors.md with the tree of errors; with --check only compares."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from generated import write_or_compare

from mindstage import errors
from mindstage.errors import MindstageError

__all__ = ["main"]

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "python" / "errors.md"
HEAD = """# mindstage.errors

<!-- Written by scripts/make_errors.py: change src/mindstage/errors.py instead. -->

Every exception that Mindstage raises. [Outcomes and errors](../../explanation/outcomes.md) explains what is an error
and what is a report.

"""


def main() -> int:
    """Writes or checks the page; returns 0 if it is up to date, otherwise 1."""
    return write_or_compare({PAGE: HEAD + "\n".join(tree(MindstageError)) + "\n\n::: mindstage.errors\n"})


def tree(cls: type[MindstageError], depth: int = 0) -> Iterator[str]:
    """A class and its subclasses as a nested list, each with the first sentence of its docstring."""
    yield f"{'    ' * depth}- `{cls.__name__}`: {(cls.__doc__ or '').splitlines()[0]}"
    for each in cls.__subclasses__():
        if each.__module__ == errors.__name__:
            yield from tree(each, depth + 1)


if __name__ == "__main__":
    sys.exit(main())
