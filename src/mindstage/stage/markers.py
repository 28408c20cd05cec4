"""Markers: forms that a program wants to be seen beside the bodies: where it looks, where it goes, what it means.

They are no part of the world: nothing collides with them, no log holds them, and clearing the world leaves them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from enum import StrEnum

import msgspec

from mindstage.world import IDENTITY, Color, Pose, Vector

__all__ = ["Marker", "MarkerStore", "MarkerType"]


class MarkerType(StrEnum):
    """What a marker looks like."""

    CUBE = "cube"
    SPHERE = "sphere"
    CYLINDER = "cylinder"
    """Upright: its axis is z."""
    CONE = "cone"
    """Upright, the tip at the top."""
    ARROW = "arrow"
    """From its place along x, as long as its size says."""
    LINE_STRIP = "line"
    """From each of its points to the next."""
    LINE_LIST = "lines"
    """From its first point to the second, from the third to the fourth."""
    POINTS = "points"
    """A dot at each of its points."""
    TEXT = "text"
    BODY_COPY = "ghost"
    """A body a second time, as it looks, in the marker's color; where that body is not there, nothing."""


class Marker(msgspec.Struct, frozen=True, kw_only=True):
    """One of them."""

    id: str
    """Another one of that id replaces it."""
    type: MarkerType
    pose: Pose = IDENTITY
    """In the world; the points are seen from it."""
    size: Vector = (0.1, 0.1, 0.1)
    """Extents along its own axes [m]; of lines, the first is how wide they are."""
    color: Color = (1.0, 1.0, 1.0)
    opacity: float = 1.0
    points: tuple[Vector, ...] = ()
    colors: tuple[Color, ...] = ()
    """One for each point, or none; along a line they run into one another."""
    text: str = ""
    body: str = ""
    """Of a ghost: the id of the body."""


class MarkerStore:
    """All of them; only the thread that owns the engine may call it."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        """None yet.

        Args:
            now: the clock by which they go [s].
        """
        self.markers: tuple[Marker, ...] = ()
        """In the order in which they came."""
        self._by_id: dict[str, Marker] = {}
        self._expiry_times: dict[str, float] = {}
        self._now = now

    def add(self, markers: Iterable[Marker], *, lifetime_s: float | None = None) -> None:
        """Shows them, in the place of those that have the same ids."""
        for marker in markers:
            self._by_id[marker.id] = marker
            self._expiry_times.pop(marker.id, None)
            if lifetime_s is not None:
                self._expiry_times[marker.id] = self._now() + lifetime_s
        self.markers = tuple(self._by_id.values())

    def remove(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Takes them away; gives those that were there."""
        gone = tuple(id for id in ids if self._by_id.pop(id, None) is not None)
        for id in gone:
            self._expiry_times.pop(id, None)
        if gone:
            self.markers = tuple(self._by_id.values())
        return gone

    def expire(self) -> bool:
        """Takes away those whose time is up; tells whether there were any."""
        now = self._now()
        return bool(self.remove([id for id, until in self._expiry_times.items() if until <= now]))

    def next_expiry_s(self) -> float | None:
        """When the next one goes [s from now]; None where none goes by itself."""
        return max(0.0, min(self._expiry_times.values()) - self._now()) if self._expiry_times else None
