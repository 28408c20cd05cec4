"""Intervals of time: Allen's relations between them, and the maximal intervals in which something holds.

J. F. Allen: Maintaining knowledge about temporal intervals, Communications of the ACM 26(11), 1983, defines the
thirteen relations for intervals with begin < end, of which exactly one holds between any two. An instant (begin = end)
is treated as the limit of short intervals: instants at one time are equal, and one at an end of an interval starts or
finishes it.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping
from enum import StrEnum
from typing import Generic, NamedTuple, TypeVar

__all__ = ["AllenRelation", "Interval", "MaximalIntervals", "allen_relation"]

K = TypeVar("K", bound=Hashable)


class Interval(NamedTuple):
    """A time from begin to end [s]."""

    begin: float
    end: float


class AllenRelation(StrEnum):
    """The relation of one interval to another."""

    BEFORE = "before"
    """It ends before the other one begins; `a < b`."""
    AFTER = "after"
    MEETS = "meets"
    """The other one begins when it ends."""
    MET_BY = "met_by"
    OVERLAPS = "overlaps"
    """It begins first, and ends while the other one lasts."""
    OVERLAPPED_BY = "overlapped_by"
    STARTS = "starts"
    """Both begin together, and it ends first."""
    STARTED_BY = "started_by"
    DURING = "during"
    """It begins after the other one, and ends before it."""
    CONTAINS = "contains"
    FINISHES = "finishes"
    """Both end together, and it begins last."""
    FINISHED_BY = "finished_by"
    EQUALS = "equals"

    @property
    def inverse(self) -> AllenRelation:
        """The relation of the other interval to this one."""
        return _INVERSES[self]


_PAIRS = (
    (AllenRelation.BEFORE, AllenRelation.AFTER),
    (AllenRelation.MEETS, AllenRelation.MET_BY),
    (AllenRelation.OVERLAPS, AllenRelation.OVERLAPPED_BY),
    (AllenRelation.STARTS, AllenRelation.STARTED_BY),
    (AllenRelation.DURING, AllenRelation.CONTAINS),
    (AllenRelation.FINISHES, AllenRelation.FINISHED_BY),
    (AllenRelation.EQUALS, AllenRelation.EQUALS),
)
_INVERSES = {one: other for pair in _PAIRS for one, other in (pair, pair[::-1])}


def allen_relation(a: Interval, b: Interval) -> AllenRelation:  # noqa: PLR0911 (one per relation)
    """The relation of one interval to another; times are compared exactly."""
    if a.begin == b.begin:
        if a.end == b.end:
            return AllenRelation.EQUALS
        return AllenRelation.STARTS if a.end < b.end else AllenRelation.STARTED_BY
    if a.begin > b.begin:
        return allen_relation(b, a).inverse
    if a.end == b.end:
        return AllenRelation.FINISHED_BY
    if a.end > b.end:
        return AllenRelation.CONTAINS
    if a.end < b.begin:
        return AllenRelation.BEFORE
    return AllenRelation.MEETS if a.end == b.begin else AllenRelation.OVERLAPS


class MaximalIntervals(Generic[K]):
    """Collects what holds in each of successive intervals, and gives the longest intervals in which it holds."""

    def __init__(self) -> None:
        self._begins: dict[K, float] = {}
        self._ended: dict[K, list[Interval]] = {}

    def add(self, begin: float, holding: Collection[K]) -> None:
        """Adds what holds from a time until that of the next call; times must not decrease."""
        now = frozenset(holding)
        for key in [key for key in self._begins if key not in now]:
            self._ended.setdefault(key, []).append(Interval(self._begins.pop(key), begin))
        for key in now:
            self._begins.setdefault(key, begin)

    @property
    def current(self) -> frozenset[K]:
        """What holds now."""
        return frozenset(self._begins)

    def finish(self, end: float) -> Mapping[K, tuple[Interval, ...]]:
        """Everything that held at some time, with its intervals in order; what holds now ends at this time."""
        self.add(end, ())
        return {key: tuple(intervals) for key, intervals in self._ended.items()}
