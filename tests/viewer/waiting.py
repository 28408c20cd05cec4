"""Waits for what happens in another thread: as long as it must, and not for ever."""

from __future__ import annotations

import time
from collections.abc import Callable

TIMEOUT_S = 150.0
"""A browser without a GPU on a busy machine is slow; a test that passes never waits so long."""


def wait_until(condition: Callable[[], object], label: str, *, timeout_s: float = TIMEOUT_S) -> None:
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, f"after {timeout_s:g} s it is still not so: {label}"
        time.sleep(0.02)


def becomes_true(condition: Callable[[], object], *, timeout_s: float = 8.0) -> bool:
    """Whether something happens soon; for what is tried again where it does not."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True
