"""Tries all maps of a folder as a user would, and prints a table of what happened to each.

Usage: try_maps.py FOLDER… [--steps validate,analyze,spawn,check,shot] [--seconds 10] [--timeout 300] [--out DIR]
                   [-- OPTIONS FOR EVERY VERB]

Each step is a `mindstage` command in a process of its own: `validate`, `analyze`, `spawn` (which also simulates for
some seconds), `check` and `shot`. A step that fails, hangs or crashes is a cell of the table and does not stop the
others. The results are written to DIR as `maps.md` and `maps.json`, and the pictures beside them. The exit code is 1 if
a step of a map crashed or timed out, or if statements of a map were lost.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

__all__ = ["STEPS", "MapResult", "StepResult", "find_maps", "main", "to_markdown", "try_map", "try_maps"]

STEPS = ("validate", "analyze", "spawn", "check", "shot")
_SUFFIXES = frozenset({".owl", ".rdf", ".ttl", ".urdf", ".xacro"})
_SIMULATED_S = 10.0
_TIMEOUT_S = 300.0
_MAX_ERROR_LENGTH = 200


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """The result of one command about one map."""

    code: int | None
    """Its exit code; None if it was ended at the timeout."""
    seconds: float
    """Wall time of the process [s]."""
    output: dict[str, Any] = field(default_factory=dict)
    """Its JSON."""
    error: str = ""
    """The error, or the last line of a traceback."""

    @property
    def is_crash(self) -> bool:
        """Whether the command neither succeeded nor refused the map with an error message."""
        return self.code not in (0, 1, 2) or "this is a bug in Mindstage" in self.error


@dataclass(frozen=True, kw_only=True)
class MapResult:
    """One row of the table."""

    map: str
    """The path, relative to its folder."""
    steps: dict[str, StepResult]
    """The results of the steps, in their order."""

    def to_json(self) -> dict[str, Any]:
        """The row as a JSON object, with the exit code, wall time and error of each step."""
        steps = {
            name: {"code": step.code, "seconds": round(step.seconds, 3), "error": step.error}
            for name, step in self.steps.items()
        }
        return {"map": self.map} | self.row() | {"ok": self.ok, "steps": steps}

    @property
    def ok(self) -> bool:
        """Whether no step crashed or timed out, and no statement was lost."""
        return not any(step.is_crash for step in self.steps.values()) and not self.row()["lost"]

    def row(self) -> dict[str, Any]:
        """The columns of the table; None for what is not known."""
        validate, spawn, check = (self._output(name) for name in ("validate", "spawn", "check"))
        moved = spawn.get("moved")
        spawned_s = spawn.get("seconds", {}).get("spawn")
        factor, simulated_s = spawn.get("real_time_factor"), spawn.get("simulated_s")
        lived_s = None if not factor or spawned_s is None else spawned_s + simulated_s / factor
        counts = validate.get("counts", {})
        return {
            "bodies": spawn.get("spawn", {}).get("bodies"),
            "errors": counts.get("error"),
            "warnings": counts.get("warning"),
            "moved": None if moved is None else len(moved),
            "fell": None if moved is None else sum(body["left_place"] for body in moved),
            "identical": check.get("identical"),
            "verdict": check.get("verdict"),
            "lost": check.get("lost_facts"),
            "seconds": round(sum(step.seconds for step in self.steps.values()), 1),
            "spawn_s": None if spawned_s is None else round(spawned_s, 2),
            "real_time_factor": None if factor is None else round(factor, 1),
            "real_time_factor_with_spawn": None if not lived_s else round(simulated_s / lived_s, 2),
            "failed": ", ".join(f"{name}: {_outcome(step)}" for name, step in self.steps.items() if _outcome(step)),
        }

    def _output(self, step: str) -> dict[str, Any]:
        return self.steps[step].output if step in self.steps else {}


def _outcome(step: StepResult) -> str:
    """What went wrong with a step; empty for exit codes 0 and 1."""
    if step.code is None:
        return "timeout"
    if step.is_crash:
        return f"crash ({step.error})"
    return step.error if step.code == 2 else ""


def find_maps(folders: Iterable[Path]) -> list[tuple[Path, Path]]:
    """The files below some folders that may be maps, sorted, each with its folder; a file stands for itself."""
    found: list[tuple[Path, Path]] = []
    for folder in folders:
        if folder.is_file():
            found.append((folder, folder.parent))
            continue
        paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _SUFFIXES and path.is_file())
        found += ((path, folder) for path in paths)
    return found


def try_maps(
    folders: Iterable[Path],
    *,
    steps: Sequence[str] = STEPS,
    seconds: float = _SIMULATED_S,
    timeout_s: float = _TIMEOUT_S,
    pictures: Path | None = None,
    options: Sequence[str] = (),
) -> Iterator[MapResult]:
    """Tries each map, and yields its row; progress is printed on stderr.

    Args:
        folders: folders of maps, or maps.
        steps: some of `STEPS`.
        seconds: the simulated time of `spawn` [s].
        timeout_s: after this wall time a step is ended [s].
        pictures: the folder for the pictures of `shot`; None for a folder that is removed.
        options: options of the command line that are passed to every step.
    """
    maps = find_maps(folders)
    for number, (path, folder) in enumerate(maps, start=1):
        name = path.relative_to(folder).as_posix()
        _show(f"[{number}/{len(maps)}] {name}")
        yield try_map(
            path, name=name, steps=steps, seconds=seconds, timeout_s=timeout_s, pictures=pictures, options=options
        )


def try_map(
    path: Path,
    *,
    name: str = "",
    steps: Sequence[str] = STEPS,
    seconds: float = _SIMULATED_S,
    timeout_s: float = _TIMEOUT_S,
    pictures: Path | None = None,
    options: Sequence[str] = (),
) -> MapResult:
    """Runs the steps for one map; see `try_maps`."""
    stem = re.sub(r"[^\w.-]+", "_", name or path.name)
    picture = Path(os.devnull) if pictures is None else pictures / f"{stem}.png"
    arguments = {
        "spawn": ("--no-viewer", "--for", f"{seconds:g}"),
        "shot": ("--output", str(picture)),
    }
    results: dict[str, StepResult] = {}
    for step in steps:
        _show(f"    {step} …")
        command = [sys.executable, "-m", "mindstage", step, str(path), *arguments.get(step, ()), "--json", *options]
        results[step] = _run(command, timeout_s)
        _show(f"    {step}: {_outcome(results[step]) or results[step].code}, {results[step].seconds:.1f} s")
    return MapResult(map=name or path.name, steps=results)


def _run(command: Sequence[str], timeout_s: float) -> StepResult:
    """Runs one command; it is ended at the timeout with all processes that it has started."""
    start = time.perf_counter()
    with TemporaryFile() as stdout, TemporaryFile() as stderr:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr, start_new_session=True
        )
        try:
            code: int | None = process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            if process.poll() is None:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        texts = []
        for stream in (stdout, stderr):
            stream.seek(0)
            texts.append(stream.read().decode("utf-8", "replace"))
    elapsed_s = time.perf_counter() - start
    output = _parse(texts[0])
    error = output.get("error", {}).get("message", "")
    if code not in (0, 1) and not error:
        lines = [line for line in texts[1].strip().splitlines() if line.strip()]
        error = " / ".join(lines[-2:])
    return StepResult(code=code, seconds=elapsed_s, output=output, error=" ".join(error.split())[:_MAX_ERROR_LENGTH])


def _parse(text: str) -> dict[str, Any]:
    """The JSON of a command; of a list (`analyze` of several maps) the first; empty if there is none."""
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    found = found[0] if isinstance(found, list) and found else found
    return found if isinstance(found, dict) else {}


def _show(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


_COLUMNS = {
    "map": "map",
    "bodies": "bodies",
    "errors": "errors",
    "warnings": "warnings",
    "moved": "moved > 10 cm",
    "fell": "fell",
    "identical": "identical",
    "verdict": "verdict",
    "lost": "lost",
    "seconds": "seconds",
    "real_time_factor": "real time",
    "real_time_factor_with_spawn": "with spawn",
    "failed": "failed",
}


def to_markdown(results: Iterable[MapResult]) -> str:
    """The table, aligned so that it is readable as text too."""
    rows = [list(_COLUMNS.values())]
    for result in results:
        cells = {"map": result.map} | result.row()
        rows.append([_cell(cells[column]) for column in _COLUMNS])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    rows.insert(1, ["-" * width for width in widths])
    lines = (
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in rows
    )
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else str(value).replace("|", "\\|")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the script; returns its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    end = given.index("--") if "--" in given else len(given)
    options, given = given[end + 1 :], given[:end]
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="a folder of maps, or a map")
    parser.add_argument("--steps", default=",".join(STEPS), help=f"some of {','.join(STEPS)}")
    parser.add_argument("--seconds", type=float, default=_SIMULATED_S, help="simulated time of spawn [s]")
    parser.add_argument("--timeout", type=float, default=_TIMEOUT_S, help="the timeout of each step [s]")
    parser.add_argument("--out", type=Path, default=Path("build/corpus"), help="the folder of the results")
    parsed = parser.parse_args(given)
    steps = [step for step in parsed.steps.split(",") if step]
    if unknown := set(steps) - set(STEPS):
        parser.error(f"no step {', '.join(sorted(unknown))}; there is {', '.join(STEPS)}")
    if missing := [str(folder) for folder in parsed.folders if not folder.exists()]:
        parser.error(f"there is no {', '.join(missing)}")
    parsed.out.mkdir(parents=True, exist_ok=True)
    results: list[MapResult] = []
    for result in try_maps(
        parsed.folders,
        steps=steps,
        seconds=parsed.seconds,
        timeout_s=parsed.timeout,
        pictures=parsed.out,
        options=options,
    ):
        results.append(result)  # written after each map, so that an interrupted run leaves its results
        (parsed.out / "maps.md").write_text(to_markdown(results), encoding="utf-8")
        content = json.dumps([each.to_json() for each in results], indent=2, ensure_ascii=False)
        (parsed.out / "maps.json").write_text(content + "\n", encoding="utf-8")
    print(to_markdown(results), end="")
    if not results:
        print("no maps found", file=sys.stderr)
    return 0 if results and all(result.ok for result in results) else 1


if __name__ == "__main__":
    sys.exit(main())
