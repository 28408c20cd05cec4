"""Worker process that reads untrusted maps in a sandbox; each job is a line of JSON.

`python -m tests.maps.fuzz_worker FOLDER` answers every job on stdin with one line on stdout. It has a memory limit
of 1 GB and no access to the network and other programs; attempts are reported even if the error is suppressed. Time
limits are enforced by `fuzz_supervisor`.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from mindstage.cli.app import app
from mindstage.errors import MapWriteError, MindstageError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.scene import World, diff

__all__ = ["MEMORY_LIMIT"]

MEMORY_LIMIT = 10**9
"""Limit of the address space [bytes], which exceeds the memory in use."""

_NETWORK_EVENTS = (
    "socket.",
    "urllib.",
    "http.client.",
    "ftplib.",
    "subprocess.",
    "os.system",
    "os.exec",
    "os.posix_spawn",
)
_PROTECTED_PATHS = ("/etc/passwd", "/etc/shadow", "/dev/zero", "/proc/kcore", "/proc/kmsg")


class SandboxAudit:
    """Audit hook that forbids network access and subprocesses, and records attempts."""

    def __init__(self) -> None:
        self.attempts: list[str] = []
        self.opened_files: list[str] = []
        sys.addaudithook(self)

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        if event.startswith(_NETWORK_EVENTS):
            self.attempts.append(f"{event} {args!r}"[:200])
            raise PermissionError(f"{event} is not allowed here")
        if event == "open" and args[0] in _PROTECTED_PATHS:
            self.opened_files.append(str(args[0]))


def main(folder: Path) -> None:
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # stdout is reserved for answers
    os.environ.pop("ROS_PACKAGE_PATH", None)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    audit = SandboxAudit()
    for line in sys.stdin:
        job = json.loads(line)
        audit.attempts.clear()
        audit.opened_files.clear()
        try:
            result = round_trip(Path(job["path"]), job["robots"], job["ontologies"], folder)
            result |= {"exit_code": run_command(job["path"], job["robots"], job["ontologies"], job["verb"], folder)}
        except BaseException:
            result = {"defect": traceback.format_exc()}
        result |= {"network_attempts": audit.attempts, "opened_files": audit.opened_files}
        result |= {"memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6}
        print(json.dumps(result), file=answers, flush=True)


def round_trip(path: Path, robots: Sequence[str], ontologies: Sequence[str], folder: Path) -> dict[str, Any]:
    """Loads, reads, analyzes, writes and reads again; returns counts, or the error if Mindstage refuses the file."""
    result: dict[str, Any] = {"error": "", "maps": 0, "bodies": 0, "findings": []}
    try:
        knowledge = KnowledgeBase(bundled_ontology=False)
        knowledge.load(path, urdf=robots, ontologies=ontologies)
        for map in knowledge.maps():
            world = knowledge.world(map)
            knowledge.map_statistics(map)
            for out in write_all_formats(world, folder):
                again = KnowledgeBase(bundled_ontology=False)
                again.load(out)
                if not map.startswith("_:"):  # the label of a blank node may change
                    _assert_equal(world, again.world(map))
            result["maps"] += 1
            result["bodies"] += len(world.bodies)
        result["findings"] = [str(each) for each in (*knowledge.findings(), *knowledge.assumptions())]
    except MindstageError as error:
        result["error"] = f"{type(error).__name__}: {error}"
    return result


def write_all_formats(world: World, folder: Path) -> Iterator[Path]:
    """Yields the map file in each format that can represent it."""
    for suffix in (".owl", ".ttl"):
        out = folder / f"written{suffix}"
        try:
            save_map(world, out)
        except MapWriteError:
            continue
        yield out


def _assert_equal(world: World, reread: World) -> None:
    found = diff(world, reread)
    differences = (found.only_in_a, found.only_in_b, found.changed, found.lost, found.gained)
    if any(differences):
        raise AssertionError(f"the written world differs from the one read: {differences!r}"[:4000])


def run_command(path: str, robots: Sequence[str], ontologies: Sequence[str], verb: str, folder: Path) -> int:
    """Runs a CLI command on the file and returns its exit code."""
    options = [option for robot in robots for option in ("--urdf", robot)]
    options += [option for each in ontologies for option in ("--ontology", each)]
    arguments = {
        "validate": ["validate", path],
        "validate --json": ["validate", path, "--json"],
        "analyze": ["analyze", path],
        "convert": ["convert", path, str(folder / "converted.ttl")],
    }[verb]
    result = CliRunner().invoke(app, [*arguments, *options, "--no-bundled-ontology"], prog_name="mindstage")
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    if result.exit_code not in (0, 1, 2) or "Traceback" in result.output:
        raise AssertionError(f"`mindstage {verb}` ends with {result.exit_code}: {result.output[-2000:]}")
    if "--json" in arguments:
        json.loads(result.stdout)
    return result.exit_code


if __name__ == "__main__":
    main(Path(sys.argv[1]))
