"""The mouse in the 3D view, moved to points of the world."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mindstage.scene import Vector
from tests.viewer.waiting import becomes_true, wait_until

__all__ = ["PagePointer"]

_TWO_PICTURES = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


class PagePointer:
    """A browser tab in which points of the world can be clicked and dragged."""

    page: Any

    def to_window(self, point: Vector) -> tuple[float, float]:
        """Projects a point of the world [m] to the window [px]."""
        raise NotImplementedError

    def point_at(self, point: Vector) -> None:
        """Moves the mouse to a point, and waits for the page to pick the body there, which it does once a frame."""
        self.page.mouse.move(*self.to_window(point))
        self.page.evaluate(_TWO_PICTURES)

    def click(self, point: Vector) -> None:
        self.point_at(point)
        self.page.mouse.click(*self.to_window(point))

    def click_until(self, point: Vector, condition: Callable[[], object], label: str) -> None:
        """Clicks until a condition is true: a slow browser may miss a click."""

        def done() -> bool:
            self.click(point)
            return becomes_true(condition)

        wait_until(done, label)

    def press_and_move(self, start: Vector, end: Vector) -> None:
        """Presses the button at one point and moves to another; the button stays down."""
        (x, y), (to_x, to_y) = self.to_window(start), self.to_window(end)
        self.point_at(start)
        self.page.mouse.down()
        for part in np.linspace(0.0, 1.0, 12):
            self.page.mouse.move(x + (to_x - x) * part, y + (to_y - y) * part)

    def release(self) -> None:
        self.page.mouse.up()
