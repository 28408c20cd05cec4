"""Turns of clients that wait."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from mindstage.access.fair_queue import FairQueue
from mindstage.access.limits import CLIENT_QUESTIONS, QUESTIONS
from mindstage.errors import RequestLimitError


def queue(*items: str, per_client: int = 10, total: int = 20) -> FairQueue[str]:
    """A queue of items whose first letter is the client."""
    made: FairQueue[str] = FairQueue(
        per_client=replace(CLIENT_QUESTIONS, maximum=per_client), total=replace(QUESTIONS, maximum=total)
    )
    for item in items:
        made.put(item[0], item, subject="a question")
    return made


def taken(waiting: FairQueue[str]) -> list[str]:
    found = []
    while (item := waiting.pop()) is not None:
        found.append(item)
    return found


def test_clients_take_turns_and_keep_their_order() -> None:
    assert taken(queue("a1", "a2", "a3", "b1", "c1", "c2")) == ["a1", "b1", "c1", "a2", "c2", "a3"]


def test_a_client_that_comes_later_waits_one_round_only() -> None:
    waiting = queue(*(f"a{number}" for number in range(9)))
    assert [waiting.pop(), waiting.pop()] == ["a0", "a1"]
    waiting.put("b", "b1", subject="a question")
    assert [waiting.pop(), waiting.pop()] == ["a2", "b1"]


def test_the_place_of_an_item_is_the_number_of_items_until_it_is_taken() -> None:
    items = ("a1", "a2", "a3", "b1", "c1", "c2", "c3", "c4")
    order = taken(queue(*items))
    waiting = queue(*items)
    assert [waiting.place(item) for item in order] == list(range(1, 9))
    assert waiting.place("d1") is None
    for done, item in enumerate(order):
        assert waiting.place(item) == 1, done
        assert waiting.pop() == item
        assert waiting.place(item) is None


def test_too_many_items_are_refused_with_the_limit() -> None:
    waiting = queue("a1", "a2", per_client=2, total=3)
    with pytest.raises(RequestLimitError, match=r"a question.* 2 requests of this client wait already, and at most 2"):
        waiting.put("a", "a3", subject="a question")
    waiting.put("b", "b1", subject="a question")
    with pytest.raises(RequestLimitError, match="3 requests wait already, and at most 3 may"):
        waiting.put("c", "c1", subject="a question")
    waiting.pop()
    waiting.put("c", "c1", subject="a question")
    assert taken(waiting) == ["b1", "a2", "c1"]


def test_items_that_are_removed_are_not_taken() -> None:
    waiting = queue("a1", "a2", "b1", "c1")
    assert waiting.remove_if(lambda item: item in {"a1", "b1"}) == ["a1", "b1"]
    assert len(waiting) == 2
    assert list(waiting) == ["a2", "c1"]
    assert taken(waiting) == ["a2", "c1"]
    assert len(waiting) == 0
