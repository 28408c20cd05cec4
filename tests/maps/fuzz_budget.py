"""Time budget and seeds of fuzzing, and storage of the files that fail."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from tests.conftest import ROOT

__all__ = ["FINDINGS_FOLDER", "fuzz_seeds", "save_case"]

FINDINGS_FOLDER = ROOT / "build" / "fuzz"
_TEST_COUNT = 16
"""Number of tests that share the time."""
_MIN_ROUNDS = 3
"""Minimum number of rounds of each test."""


def fuzz_seeds() -> Iterator[int]:
    """Yields consecutive seeds until this test's share of the time is used up.

    `MINDSTAGE_FUZZ_S` is the total time of all tests [s], `MINDSTAGE_FUZZ_SEED` the first seed.
    """
    share = float(os.environ.get("MINDSTAGE_FUZZ_S", "16")) / _TEST_COUNT
    first = int(os.environ.get("MINDSTAGE_FUZZ_SEED", "1"))
    end = time.monotonic() + share
    for number in count(first):
        if number - first >= _MIN_ROUNDS and time.monotonic() > end:
            return
        yield number


def save_case(file: Path, *, name: str) -> Path:
    """Saves a failing input under a name that describes how it was made."""
    FINDINGS_FOLDER.mkdir(parents=True, exist_ok=True)
    kept = FINDINGS_FOLDER / f"{''.join(letter if letter.isalnum() else '-' for letter in name)}{file.suffix}"
    kept.write_bytes(file.read_bytes())
    return kept
