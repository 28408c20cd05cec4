"""How long fuzzing lasts, what it begins with, and where a file goes that it found."""

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
"""Tests that share the time."""
_MIN_ROUNDS = 3
"""Rounds of each, however slow the machine is."""


def fuzz_seeds() -> Iterator[int]:
    """Numbers to make inputs from, the same ones every time, until this test's share of the time is over.

    `MINDSTAGE_FUZZ_S` is the time of all tests together [s]; `MINDSTAGE_FUZZ_SEED` begins with another number.
    """
    share = float(os.environ.get("MINDSTAGE_FUZZ_S", "110")) / _TEST_COUNT
    first = int(os.environ.get("MINDSTAGE_FUZZ_SEED", "1"))
    end = time.monotonic() + share
    for number in count(first):
        if number - first >= _MIN_ROUNDS and time.monotonic() > end:
            return
        yield number


def save_case(file: Path, *, name: str) -> Path:
    """Keeps what was found, under a name that says how it was made."""
    FINDINGS_FOLDER.mkdir(parents=True, exist_ok=True)
    kept = FINDINGS_FOLDER / f"{''.join(letter if letter.isalnum() else '-' for letter in name)}{file.suffix}"
    kept.write_bytes(file.read_bytes())
    return kept
