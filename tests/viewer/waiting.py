"""Waiting for conditions that other threads or processes make true, with a timeout."""

from __future__ import annotations

import time
from collections.abc import Callable

TIMEOUT_S = 150.0
"""Long, because a browser without a GPU on a busy machine is slow [s]."""


def wait_until(condition: Callable[[], object], label: str, *, timeout_s: float = TIMEOUT_S) -> None:
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, f"after {timeout_s:g} s not yet: {label}"
        time.sleep(0.02)


def becomes_true(condition: Callable[[], object], *, timeout_s: float = 8.0) -> bool:
    """Whether a condition becomes true in time, for actions that are repeated if it does not."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True
