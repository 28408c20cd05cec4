"""What all generators share: they write their files or, with --check, compare them."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

__all__ = ["is_check", "write_or_compare"]


def is_check() -> bool:
    """Whether the script was called with --check; ends the program where it was called with anything else."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a file is not up to date")
    return bool(parser.parse_args().check)


def write_or_compare(files: Mapping[Path, str], *, existing: Iterable[Path] = ()) -> int:
    """Writes generated files or, with --check, compares them; prints those that differ.

    Args:
        files: the text of each file.
        existing: files that were generated before; those that `files` does not have are deleted.

    Returns:
        The exit code: 1 if a compared file differs, otherwise 0.
    """
    check = is_check()
    stale = [path for path in sorted({*files, *existing}) if _text(path) != files.get(path)]
    for path in stale:
        print(os.path.relpath(path))
        if check:
            continue
        if path in files:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(files[path], encoding="utf-8", newline="\n")
        else:
            path.unlink()
    if check and stale:
        print(f"these files are out of date: run {Path(sys.argv[0]).name}", file=sys.stderr)
    return int(check and bool(stale))


def _text(path: Path) -> str | None:
    return path.read_bytes().decode() if path.is_file() else None
