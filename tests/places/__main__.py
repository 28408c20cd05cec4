"""Skills of robots in generated homes: `python -m tests.places --cells 600` (`make places`).

Cells are drawn by the seed of the day. Each result is a line of a file, which a further call with the same seed
continues; with `--page` the rates are written to docs/reference/places.md (`--cells 0`: of the file as it is).
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import msgspec

from tests.places.cells import Cell, CellResult, Verdict, try_drawn

__all__ = ["day_seed", "table", "wilson"]

ROOT = Path(__file__).resolve().parent.parent.parent
PAGE = ROOT / "docs" / "reference" / "places.md"
CELLS = 600
Z = 1.959964
"""Of the standard normal distribution, for intervals of 95 %."""
HEAD = """# Skills in generated homes

<!-- Written by `{command}`. -->

What robots do in homes that no program was built for, as a [referee](#the-referee) saw it that shares no code with the
skills. {count} cells with the seed {seeds} were drawn: a home of a random style, written in a random
[dialect](../how-to/homes.md#write-a-home-in-another-dialect) and read back, a robot, a skill (open, close, pick or
place) and a kind of thing, then one of that kind in the home. The robot begins at the free place of the floor that is
nearest to the thing. Nothing is left out because it is hard: many are out of reach of the robot, or behind something.
This table was made by

    {command}

and `make places` makes another one, with the seed of the day. Ranges are Wilson's intervals of 95 %.{too_few}

"""
ENOUGH = 300
TOO_FEW = f' These are fewer\nthan the {ENOUGH} cells that a statement such as "no false successes" needs.'
FOOT = """A cell in which more than a tenth of the things fall, the robot finds no place to stand, or the front does not
open before it is to be closed, is not begun and not counted ({not_begun} cells). Of the assisted successes, {said} are
said to be so by an assumption of the skill. After {misread} successes of "open" the front is open as the map was read,
and not along its true axis or over its true range.

## The referee

`tests/referee.py` imports MuJoCo and NumPy only, and sees each time step.

- A **true success** is one after which the front or the thing is in the state that the skill promises, in the model:
  open to 95 %, closed to 4 %, lifted by 2 cm or off everything with the robot at most 3 mm from it, at rest on its
  support without the robot.
- An **assisted success** also needed something else than gravity, contacts, and the limits, the friction and the
  damping of joints: an equality constraint, `xfrc_applied`, `qfrc_applied`, an actuator, a spring, adhesion, a mocap
  body, a thing that became a part of the robot, a position that changed by more than 1 µm beyond its velocity, a
  velocity that was set; or a part of the robot was inside something by more than 5 mm, whatever pairs the contact
  filter excludes.
- A **false success** is not in the state that the skill promises.
- A **false reason** is contradicted by the geometry. Judged are the openness that it states, that the robot was
  pressed into something that it was never within 2 cm of, that what it has touched is out of its reach, and an
  obstacle that is more than 5 cm from all that the front sweeps (if the front would hit it), or farther from it than
  the robot is long. Other reasons are not judged, so that the number is a lower limit.
"""


def wilson(count: int, total: int) -> tuple[float, float]:
    """Wilson's interval of 95 % of a share (Wilson 1927)."""
    if not total:
        return 0.0, 1.0
    share, square = count / total, Z * Z / total
    middle = (share + square / 2) / (1 + square)
    half = Z / (1 + square) * math.sqrt(share * (1 - share) / total + square / (4 * total))
    return max(0.0, middle - half), min(1.0, middle + half)


def day_seed() -> int:
    """Such as 20261128, of UTC."""
    return int(datetime.now(UTC).strftime("%Y%m%d"))


def table(results: Sequence[CellResult], column: str, of: Callable[[Cell], str]) -> str:
    """The rates of verdicts by something of a cell, in Markdown."""
    judged = [each for each in results if each.verdict is not Verdict.NOT_BEGUN]
    names = sorted({of(each.cell) for each in judged})
    lines = [
        f"| {column} | cells | true | assisted | false | failures | of these with a false reason | exceptions |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in [*names, "all"]:
        rows = [each for each in judged if name in ("all", of(each.cell))]
        counts = {verdict: sum(each.verdict is verdict for each in rows) for verdict in Verdict}
        failures = counts[Verdict.FAILED] + counts[Verdict.FALSE_REASON]
        cells = [
            *(_share(counts[each], len(rows)) for each in (Verdict.TRUE, Verdict.ASSISTED, Verdict.FALSE)),
            str(failures),
            _share(counts[Verdict.FALSE_REASON], failures),
            str(counts[Verdict.ERROR]),
        ]
        lines.append(f"| {name} | {len(rows)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _share(count: int, total: int) -> str:
    low, high = wilson(count, total)
    return f"{count} ({low:.0%} to {high:.0%})".replace("%", " %") if total else "0"


def page(results: Sequence[CellResult], command: str) -> str:
    """The page of the documentation."""
    seeds = ", ".join(map(str, sorted({each.cell.seed for each in results})))
    too_few = TOO_FEW if len(results) < ENOUGH else ""
    parts = [HEAD.format(command=command, count=len(results), seeds=seeds, too_few=too_few)]
    for title, of in (("kind", _kind), ("robot", _robot), ("skill", _skill), ("dialect", _dialect), ("style", _style)):
        parts.append(f"## By {title}\n\n{table(results, title, of)}\n")
    assisted = [each for each in results if each.verdict is Verdict.ASSISTED]
    parts.append(
        FOOT.format(
            not_begun=sum(each.verdict is Verdict.NOT_BEGUN for each in results),
            said=f"{sum(bool(each.assumptions) for each in assisted)} of {len(assisted)}",
            misread=sum(bool(each.misread) for each in results),
        )
    )
    return "".join(parts)


def _kind(cell: Cell) -> str:
    return cell.kind


def _robot(cell: Cell) -> str:
    return f"`{cell.robot}`"


def _skill(cell: Cell) -> str:
    return cell.skill


def _dialect(cell: Cell) -> str:
    return f"`{cell.dialect}`"


def _style(cell: Cell) -> str:
    return cell.style


def run(seed: int, numbers: Iterable[int], workers: int) -> Iterator[CellResult]:
    """The results of cells, as they end."""
    with get_context("spawn").Pool(workers, maxtasksperchild=10) as pool:
        yield from pool.imap_unordered(partial(try_drawn, seed), numbers)


def read(path: Path) -> list[CellResult]:
    """The results of a file, of which the last line may be cut off."""
    if not path.is_file():
        return []
    lines = path.read_bytes().split(b"\n")[:-1]
    return [msgspec.json.decode(line, type=CellResult) for line in lines]


def before_first_missing(results: Iterable[CellResult]) -> list[CellResult]:
    """The cells up to the first one without a result: after an interruption, those that take long are not left out."""
    ordered = sorted(results, key=lambda each: each.cell.number)
    return [
        each
        for number, each in enumerate(ordered, ordered[0].cell.number if ordered else 0)
        if each.cell.number == number
    ]


def main() -> int:
    """Tries the cells; the exit code is 1 after a false success or an exception."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=day_seed(), help="by default the date")
    parser.add_argument("--cells", type=int, default=CELLS, help="number of cells")
    parser.add_argument("--first", type=int, default=0, help="number of the first cell")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    parser.add_argument("--out", type=Path, help="the file of the results; by default build/places-SEED.jsonl")
    parser.add_argument("--page", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    options = parser.parse_args()
    out = options.out or ROOT / "build" / f"places-{options.seed}.jsonl"
    out.parent.mkdir(parents=True, exist_ok=True)
    results = [each for each in read(out) if each.cell.seed == options.seed]
    known = {each.cell.number for each in results}
    numbers = [each for each in range(options.first, options.first + options.cells) if each not in known]
    with out.open("ab") as file:
        for result in run(options.seed, numbers, options.workers):
            file.write(msgspec.json.encode(result) + b"\n")
            file.flush()
            results.append(result)
            print(f"{result.verdict}: {result.cell} ({result.cpu_s:.0f} s) {result.reason}", flush=True)
            for each in (*result.referee, result.misread):
                print(f"    {each}" if each else "", end="\n" if each else "", flush=True)
    results = before_first_missing(results)
    print(table(results, "kind", _kind))
    if options.page:
        command = shlex.join(
            ["python", "-m", "tests.places", "--seed", str(options.seed), "--cells", str(len(results))]
        )
        PAGE.write_text(page(results, command), encoding="utf-8")
    return int(any(each.verdict in (Verdict.FALSE, Verdict.ERROR) for each in results))


if __name__ == "__main__":
    sys.exit(main())
