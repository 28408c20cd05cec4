"""Writes docs/reference/extras.md: the installed size of the dependencies of each extra; with --check only compares.

The sizes are those of the files that the distributions in this environment list in their RECORD, bytecode included, so
every extra must be installed. Versions and platforms differ a little: a check tolerates 5 % and 3 MB.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from generated import is_check, write_or_compare
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

__all__ = ["main"]

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "reference" / "extras.md"
PROJECT = ROOT / "pyproject.toml"
FOR_DEVELOPERS = {"dev", "bench", "docs"}
LIMITS_MB = {"": 440, "all": 1400}
"""Largest size of the dependencies without extras, and of those with `all`."""
TOLERANCE, TOLERANCE_MB = 0.05, 3
"""By which a size may differ from that of the page: a fraction, or megabytes."""
HEAD = """# Extras

<!-- Written by scripts/make_sizes.py: change pyproject.toml instead. -->

In a checkout, `pip install '.[robots,episodes]'` installs extras. Sizes are those of the installed files on Linux with
the pinned versions, without Mindstage itself; an extra adds what the core does not have. Most of the core is MuJoCo,
NumPy and SciPy, which computes paths and distances on floor plans, and convex hulls.

| extra | for | largest dependencies | adds [MB] | with the core [MB] |
|---|---|---|---|---|
"""


def main() -> int:
    """Writes or checks the page; returns 1 if a size has changed or is over its limit."""
    if is_check() and sys.platform != "linux":
        return 0  # the page has the sizes of Linux
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    extras = {name: each for name, each in project["optional-dependencies"].items() if name not in FOR_DEVELOPERS}
    core = dependencies(project["dependencies"], extras)
    totals = {"": total_mb(core)} | {name: total_mb(dependencies(each, extras) | core) for name, each in extras.items()}
    if over := [name or "the core" for name, limit in LIMITS_MB.items() if totals[name] > limit]:
        print(f"larger than allowed in {Path(__file__).name}: {', '.join(over)}", file=sys.stderr)
        return 1
    rows = [row("", "always installed", core, totals[""], totals[""])]
    comments = dict(re.findall(r"^(\w+) = \[.*\]  # (.*)$", PROJECT.read_text(encoding="utf-8"), re.MULTILINE))
    for name, requirements in extras.items():
        added = dependencies(requirements, extras) - core
        rows.append(row(name, comments.get(name, ""), added, total_mb(added), totals[name]))
    text = HEAD + "\n".join(rows) + "\n"
    if is_check() and PAGE.is_file() and is_similar(PAGE.read_text(encoding="utf-8"), text):
        return 0
    return write_or_compare({PAGE: text})


def dependencies(requirements: Iterable[str], extras: dict[str, list[str]]) -> frozenset[str]:
    """The names of the distributions that requirements need, directly or indirectly, here."""
    waiting, seen = [Requirement(each) for each in requirements], set[tuple[str, str]]()
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        for extra in ("", *requirement.extras):
            if (name, extra) in seen:
                continue
            seen.add((name, extra))
            if name == "mindstage":
                waiting += map(Requirement, extras.get(extra, ()))
            else:
                waiting += needed(name, extra)
    return frozenset(name for name, _ in seen if name != "mindstage")


def needed(name: str, extra: str) -> Iterator[Requirement]:
    """What a distribution requires on this platform, with one of its extras or, for "", without."""
    for text in installed(name).requires or ():
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
            yield requirement


@cache
def installed(name: str) -> Distribution:
    """A distribution; ends the program where it is not installed."""
    try:
        return distribution(name)
    except PackageNotFoundError:
        sys.exit(f"{name} is not installed: sizes are measured where all extras are installed")


@cache
def size_mb(name: str) -> float:
    """The size of the files of a distribution [MB]."""
    paths = (Path(str(each.locate())) for each in installed(name).files or ())
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def total_mb(names: Iterable[str]) -> int:
    """The size of several distributions [MB]."""
    return round(sum(map(size_mb, names)))


def row(name: str, purpose: str, names: Iterable[str], added: int, total: int) -> str:
    """A row of the table."""
    largest = [each for each in sorted(names, key=lambda each: (-size_mb(each), each)) if size_mb(each) >= 1][:3]
    return f"| {f'`{name}`' if name else '(none)'} | {purpose} | {', '.join(largest)} | {added} | {total} |"


def is_similar(before: str, now: str) -> bool:
    """Whether two pages differ in their sizes only, and in these by no more than the tolerance."""
    number = re.compile(r"(?<=\| )\d+(?= \|)")
    if number.sub("", before) != number.sub("", now):
        return False
    pairs = zip(map(int, number.findall(before)), map(int, number.findall(now)), strict=True)
    return all(abs(new - old) <= max(TOLERANCE_MB, TOLERANCE * old) for old, new in pairs)


if __name__ == "__main__":
    sys.exit(main())
