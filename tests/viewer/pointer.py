"""The mouse over the view, led to places in the world."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mindstage.scene import Vector
from tests.viewer.waiting import becomes_true, wait_until

__all__ = ["PagePointer"]

_TWO_PICTURES = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


class PagePointer:
    """Somebody with a browser tab who knows where places are in its window."""

    page: Any

    def to_window(self, point: Vector) -> tuple[float, float]:
        """Where a place in the world [m] is in the window [px]."""
        raise NotImplementedError

    def point_at(self, point: Vector) -> None:
        """Moves the mouse to a place, and waits until the page has seen what is there: it appearances once a picture."""
        self.page.mouse.move(*self.to_window(point))
        self.page.evaluate(_TWO_PICTURES)

    def click(self, point: Vector) -> None:
        self.point_at(point)
        self.page.mouse.click(*self.to_window(point))

    def click_until(self, point: Vector, condition: Callable[[], object], label: str) -> None:
        """Clicks, and again where a slow browser did not hear it or stood elsewhere by then."""

        def done() -> bool:
            self.click(point)
            return becomes_true(condition)

        wait_until(done, label)

    def press_and_move(self, start: Vector, end: Vector) -> None:
        """Presses the button at one place and moves to another; the button stays down."""
        (x, y), (to_x, to_y) = self.to_window(start), self.to_window(end)
        self.point_at(start)
        self.page.mouse.down()
        for part in np.linspace(0.0, 1.0, 12):
            self.page.mouse.move(x + (to_x - x) * part, y + (to_y - y) * part)

    def release(self) -> None:
        self.page.mouse.up()
