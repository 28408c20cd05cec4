"""Events from relations that begin and cease: short ones are dropped, short gaps do not divide them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.episodes import EpisodeEventKind
from mindstage.episodes.event_log import EventLog, RelationLog
from mindstage.scene import BodyId
from tests.cases import each_case

MIN_S = 0.5
Found = list[tuple[str, float, float | None]]


def relations() -> tuple[EventLog, RelationLog[str]]:
    log = EventLog()

    def describe(key: str) -> dict[str, object]:
        return {"thing": BodyId(key), "other": BodyId(f"{key} table")}

    return log, RelationLog(log, EpisodeEventKind.CONTACT, min_duration_s=MIN_S, describe=describe)


def found_in(log: EventLog) -> Found:
    assert all(event.kind is EpisodeEventKind.CONTACT for event in log.events)
    assert all(event.other == f"{event.thing} table" for event in log.events)
    return [(event.thing, event.begin_s, event.end_s) for event in log.events]


@each_case(
    ("changes", "expected"),
    [
        # a sign is the begin, and the time without one the end
        ([(1.0, True), (2.0, False)], [("a", 1.0, 2.0)]),
        ([(1.0, True)], [("a", 1.0, None)]),
        ([(1.0, True), (1.4, False)], []),
        ([(1.0, True), (1.5, False)], [("a", 1.0, 1.5)]),
        # a gap below the least duration does not divide it
        ([(1.0, True), (2.0, False), (2.4, True), (3.0, False)], [("a", 1.0, 3.0)]),
        ([(1.0, True), (2.0, False), (2.5, True), (3.0, False)], [("a", 1.0, 2.0), ("a", 2.5, 3.0)]),
        ([(1.0, True), (1.2, False), (1.4, True), (1.6, False)], [("a", 1.0, 1.6)]),
        ([(1.0, True), (2.0, False), (2.3, True)], [("a", 1.0, None)]),
        ([(1.0, True), (1.2, True), (2.0, False), (2.2, False)], [("a", 1.0, 2.0)]),
        ([(2.0, False)], []),
    ],
)
@each_case("settled", [False, True])
def test_begins_and_ends_of_one_relation(changes: list[tuple[float, bool]], expected: Found, settled: bool) -> None:
    log, found = relations()
    for time_s, holds in changes:
        if settled:
            found.settle(time_s)
        (found.begin if holds else found.cease)("a", time_s)
        assert found.holds("a") is holds
        if holds:
            assert found.begin_s("a") <= time_s
    if settled or (expected and expected[-1][2] is None):
        found.settle(4.0)
    found.finish()
    assert found_in(log) == expected


def test_what_is_put_elsewhere_does_not_go_on_after_a_gap() -> None:
    log, found = relations()
    found.begin("a", 1.0)
    found.cease("a", 2.0, at_once=True)
    found.begin("a", 2.1)
    found.cease("a", 3.0)
    found.finish()
    assert found_in(log) == [("a", 1.0, 2.0), ("a", 2.1, 3.0)]


def test_an_event_does_not_end_before_it_began() -> None:
    log = EventLog()
    id = log.add(EpisodeEventKind.FALL, 2.0, thing=BodyId("a"))
    log.end(id, 1.0, amount=3.0)
    (event,) = log.events
    assert (event.begin_s, event.end_s, event.amount) == (2.0, 2.0, 3.0)


def test_changes_are_taken_once_and_each_as_it_is_then() -> None:
    log = EventLog()
    first = log.add(EpisodeEventKind.FALL, 2.0, thing=BodyId("a"))
    second = log.add(EpisodeEventKind.FALL, 1.0, thing=BodyId("b"))
    other = log.add(EpisodeEventKind.GRASP, 1.5, thing=BodyId("c"))
    assert (first, second, other) == ("Falling_1", "Falling_2", "Grasping_1")
    log.end(first, 3.0)
    assert [(each.id, each.end_s) for each in log.take_changed()] == [
        (first, 3.0),
        (second, None),
        (other, None),
    ]
    assert log.take_changed() == ()
    log.end(other, 2.5)
    assert [(each.id, each.end_s) for each in log.take_changed()] == [(other, 2.5)]
    assert [each.id for each in log.events] == [second, other, first], "in the order of their begin"


@given(st.lists(st.frozensets(st.sampled_from("abc")), min_size=1, max_size=25))
def test_events_are_the_merged_intervals_that_are_long_enough(samples: list[frozenset[str]]) -> None:
    """A sample each 0.2 s: gaps of one or two samples are bridged, and what lasts 0.5 s or longer is an event."""
    log, found = relations()
    for number, holding in enumerate([*samples, *[frozenset[str]()] * 4]):
        time_s = number / 5
        for key in "abc":
            (found.begin if key in holding else found.cease)(key, time_s)
        found.settle(time_s)
    found.finish()
    expected = []
    for key in "abc":
        runs: list[list[int]] = []
        for number, holding in enumerate(samples):
            if key not in holding:
                continue
            if runs and number - runs[-1][1] <= 2:
                runs[-1][1] = number + 1
            else:
                runs.append([number, number + 1])
        expected += [(key, begin / 5, end / 5) for begin, end in runs if end - begin >= 3]
    assert sorted(found_in(log)) == [(key, pytest.approx(begin), pytest.approx(end)) for key, begin, end in expected]
