"""Allen's relations against their definitions, and maximal intervals against what was added."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from mindstage.episodes.intervals import AllenRelation, Interval, MaximalIntervals, allen_relation

R = AllenRelation
DEFINITIONS: dict[AllenRelation, Callable[[Interval, Interval], bool]] = {
    R.BEFORE: lambda a, b: a.end < b.begin,
    R.AFTER: lambda a, b: b.end < a.begin,
    R.MEETS: lambda a, b: a.end == b.begin,
    R.MET_BY: lambda a, b: b.end == a.begin,
    R.OVERLAPS: lambda a, b: a.begin < b.begin < a.end < b.end,
    R.OVERLAPPED_BY: lambda a, b: b.begin < a.begin < b.end < a.end,
    R.STARTS: lambda a, b: a.begin == b.begin and a.end < b.end,
    R.STARTED_BY: lambda a, b: a.begin == b.begin and b.end < a.end,
    R.DURING: lambda a, b: b.begin < a.begin and a.end < b.end,
    R.CONTAINS: lambda a, b: a.begin < b.begin and b.end < a.end,
    R.FINISHES: lambda a, b: a.end == b.end and b.begin < a.begin,
    R.FINISHED_BY: lambda a, b: a.end == b.end and a.begin < b.begin,
    R.EQUALS: lambda a, b: a == b,
}
"""Figure 2 of Allen (1983), for intervals that are longer than an instant."""
times = st.integers(0, 6).map(float)
intervals = st.tuples(times, times).filter(lambda ends: ends[0] != ends[1]).map(lambda ends: Interval(*sorted(ends)))
instants = times.map(lambda time: Interval(time, time))


def test_there_are_thirteen_relations() -> None:
    assert len(AllenRelation) == 13 == len(DEFINITIONS)


@given(intervals, intervals)
def test_exactly_the_relation_whose_definition_is_met_is_found(a: Interval, b: Interval) -> None:
    assert [each for each in AllenRelation if DEFINITIONS[each](a, b)] == [allen_relation(a, b)]


@given(intervals | instants, intervals | instants)
def test_the_relation_in_the_other_direction_is_the_inverse(a: Interval, b: Interval) -> None:
    assert allen_relation(b, a) is allen_relation(a, b).inverse
    assert allen_relation(a, b).inverse.inverse is allen_relation(a, b)


@given(intervals, intervals)
def test_an_instant_has_the_relation_of_a_short_interval_within_the_same_bounds(a: Interval, b: Interval) -> None:
    instant = Interval(b.begin, b.begin)
    if a.begin not in instant and a.end not in instant:
        short = Interval(b.begin - 0.25, b.begin + 0.25)
        assert allen_relation(instant, a) is allen_relation(short, a)


@given(st.lists(st.frozensets(st.sampled_from("abc")), min_size=1, max_size=12))
def test_maximal_intervals_cover_exactly_the_times_at_which_something_held(states: list[frozenset[str]]) -> None:
    recorder = MaximalIntervals[str]()
    for time, holding in enumerate(states):
        recorder.add(float(time), holding)
    found = recorder.finish(float(len(states)))
    for key in "abc":
        own = found.get(key, ())
        held = [any(each.begin <= time < each.end for each in own) for time in range(len(states))]
        assert held == [key in each for each in states]
        assert all(first.end < second.begin for first, second in pairwise(own))
