"""Questions about the past of a recording whose events were written by hand, with their reasons without an answer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from mindstage import KnowledgeBase
from mindstage.episodes.history import EpisodeHistory
from tests.episodes.kitchenette_recording import EVENTS, kitchenette_recording
from tests.episodes.test_questions_over_time import knowledge_of_kitchenette
from tests.kitchenette import MAP

RUN = "kitchenette.mcap"
MUG, DRAWER, FLOOR, CUPBOARD = (MAP + name for name in ("Mug", "Drawer", "Floor", "Cupboard"))


@pytest.fixture(scope="module")
def knowledge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KnowledgeBase]:
    with knowledge_of_kitchenette(tmp_path_factory.mktemp("map")) as knowledge:
        assert knowledge.add_episode(kitchenette_recording()) == RUN
        yield knowledge


def reasons(answers: Any) -> list[str]:
    assert not answers
    return [each.reason for each in answers.missing]


def test_events_are_answers_with_the_names_of_their_participants(knowledge: KnowledgeBase) -> None:
    iris = {None: None} | {name: MAP + name for name in ("Drawer", "DrawerSlide", "Mug")}
    for event, row in zip(EVENTS, knowledge.ask("occurs"), strict=True):
        assert (row.name, row.kind.rpartition("#")[2], row.episode) == (event.id, event.kind.value, RUN)
        assert (row.begin, row.end, row.amount) == (event.begin_s, event.end_s, event.amount)
        found = (row.thing, row.other, row.agent, row.joint)
        assert found == tuple(iris[each] for each in (event.thing, event.other, event.agent, event.joint))
    assert [row.name for row in knowledge.ask("occurs", "Falling")] == ["Falling_1"]
    assert [row.name for row in knowledge.ask("occurs", thing="Drawer")] == ["Opening_1"]


def test_events_are_related_by_their_names_and_by_their_kinds(knowledge: KnowledgeBase) -> None:
    pairs = {(row.first_event, row.relation, row.second_event) for row in knowledge.ask("allen")}
    assert pairs == {
        ("Opening_1", "before", "Grasping_1"), ("Opening_1", "before", "Falling_1"),
        ("Grasping_1", "meets", "Falling_1"), ("Grasping_1", "after", "Opening_1"),
        ("Falling_1", "after", "Opening_1"), ("Falling_1", "met_by", "Grasping_1"),
    }  # fmt: skip
    (row,) = knowledge.ask("allen", "Opening_1", "before", "Falling")
    assert (row.first, row.second, row.first_event, row.second_event) == (
        "Opening_1",
        "Falling",
        "Opening_1",
        "Falling_1",
    )
    assert [row.second_event for row in knowledge.ask("allen", "Opening", "before")] == ["Grasping_1", "Falling_1"]
    expected = f"no Falling is before another Opening in {RUN}"
    assert reasons(knowledge.ask("allen", "Falling", "before", "Opening")) == [expected]
    assert reasons(knowledge.ask("allen", "Sliding_7")) == [f"no Sliding_7 is related to another event in {RUN}"]


def test_a_thing_is_where_it_was_last_seen_and_has_a_trajectory(knowledge: KnowledgeBase) -> None:
    (row,) = knowledge.ask("last_seen", "Mug")
    assert (row.time, row.place, row.unix_time, row.episode) == (4.0, FLOOR, 1.8e9 + 4.0, RUN)
    assert row.position == pytest.approx((1.0, 0.0, 0.05), abs=0.002)
    assert 3.5 < row.moved < 4.0
    times = [row.time for row in knowledge.ask("trajectory", "Mug")]
    assert times[0] == 0.0
    assert times == sorted(times)
    assert knowledge.ask("trajectory", "Mug")[0].position == (2.0, 0.0, 0.85)
    for question in ("last_seen", "trajectory"):
        assert reasons(knowledge.ask(question, "map")) == [f"map has no body in {RUN}"]
        assert reasons(knowledge.ask(question)) == ["give thing: the things are not listed one after the other"]


def test_what_changed_between_two_times_the_farthest_first(knowledge: KnowledgeBase) -> None:
    moved = [(row.thing, row.was, row.now) for row in knowledge.ask("changed") if row.change == "moved"]
    assert moved == [(MUG, CUPBOARD, FLOOR), (DRAWER, CUPBOARD, None), (DRAWER + "Handle", None, None)]
    first = knowledge.ask("changed")[0]
    assert first.distance == pytest.approx((1.0**2 + 0.8**2) ** 0.5, abs=0.002)
    assert (first.since, first.until) == (0.0, 4.0)
    assert [row.change.value for row in knowledge.ask("changed", since=2.5)] == ["moved", "detached"]
    later = {(row.thing, row.change.value, row.was, row.now) for row in knowledge.ask("changed", since=2.5)}
    assert later == {(MUG, "moved", None, FLOOR), (MUG, "detached", DRAWER, None)}
    attached = {
        (row.thing, row.change.value, row.was, row.now) for row in knowledge.ask("changed", since=1.5, until=2.5)
    }
    assert (MUG, "attached", None, DRAWER) in attached


def test_who_moved_a_thing_and_how(knowledge: KnowledgeBase) -> None:
    (row,) = knowledge.ask("who_moved", "Mug")
    assert (row.agent, row.how, row.begin, row.end, row.episode) == (DRAWER, "Grasping", 2.0, 3.0, RUN)
    assert (MUG, DRAWER, "Grasping", 2.0) in {
        (each.thing, each.agent, each.how, each.begin) for each in knowledge.ask("who_moved")
    }
    assert reasons(knowledge.ask("who_moved", "Fridge")) == [f"nothing is recorded to have moved Fridge in {RUN}"]
    assert reasons(knowledge.ask("who_moved", "map")) == [f"map has no body in {RUN}"]


def test_a_history_gets_another_name_with_its_recording(knowledge: KnowledgeBase) -> None:
    history = EpisodeHistory(kitchenette_recording(), name="first")
    assert knowledge.add_episode(history, name="second") == "second"
    try:
        rows = knowledge.ask("occurs", episode="second")
        assert [(row.name, row.episode) for row in rows] == [(event.id, "second") for event in EVENTS]
    finally:
        knowledge.remove_episode("second")


def test_relations_hold_in_intervals(knowledge: KnowledgeBase) -> None:
    rows = [(row.a, row.b, row.begin) for row in knowledge.ask("holds", "on", "Mug")]
    assert rows == [(MUG, CUPBOARD, 0.0), (MUG, FLOOR, pytest.approx(3.55, abs=0.1))]
    first, second = knowledge.ask("holds", "on", "Mug")
    assert (first.end, second.end) == (2.0, 4.0)
    assert reasons(knowledge.ask("holds", "inside", "Mug", "Fridge")) == [f"inside never held between them in {RUN}"]
    assert f"map has no body in {RUN}" in reasons(knowledge.ask("holds", "on", "map"))
