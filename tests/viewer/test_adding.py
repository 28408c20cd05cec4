"""Adding bodies by dragging: the ghost at the pointer of a page, and what is dropped there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.errors import NoFreePlacementError
from mindstage.scene import BodyId
from mindstage.viewer.adding import AddHandler
from tests.kitchenette import kitchenette
from tests.viewer.test_view_tools import Tools

CUP = "Cup"
SIZE = (0.08, 0.08, 0.1)


class Page(str):
    """A page with the state of its session."""

    __slots__ = ("state",)

    def __init__(self, _: str) -> None:
        self.state: dict[str, Any] = {}


class Adding(Tools):
    """The requests of two pages that drag classes into the view."""

    def __init__(self, sim: Simulation) -> None:
        super().__init__(sim)
        self.pages = {name: Page(name) for name in ("first", "second", "none")}
        AddHandler(sim, cast("Any", self.channel), self.session_views, self.picker)

    def ask(self, method: str, page: str = "first", **params: Any) -> Any:
        found = super().ask(method, self.pages[page], **params)
        self.views.process_queue()
        return found

    def ghost(self, number: int) -> dict[str, Any]:
        """The ghost in a view; empty if there is none."""
        node = self.clients[number].scene.nodes.get("/ghost")
        return {} if node is None else vars(node)

    def is_free(self, number: int) -> bool:
        """Whether the ghost is green."""
        red, green, _ = self.ghost(number)["color"]
        return bool(green > red)


@pytest.fixture
def adding() -> Iterator[Adding]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        adding = Adding(sim)
        adding.look((2.0, 0.0, 6.0), (2.0, 0.0, 0.0))
        yield adding


# from 5.2 m above the cupboard, whose half picture is 2.6 m high; its upper edge is north
BESIDE_THE_MUG = {"cls": CUP, "pointer": (0.0, 0.2 / 2.6), "size": SIZE}
NOWHERE = {"cls": CUP, "pointer": (0.0, 0.0), "size": SIZE}


def test_a_ghost_is_where_the_body_would_be_put_down_in_the_views_of_its_page(adding: Adding) -> None:
    assert adding.ask("hover", **BESIDE_THE_MUG) == {"on": "Cupboard", "reason": ""}
    for number in (1, 3):
        x, y, z = adding.ghost(number)["position"]
        assert (x, y) == pytest.approx((2.0, 0.2), abs=0.03)
        assert z == pytest.approx(0.85, abs=0.01), "it stands on the cupboard"
        assert adding.is_free(number)
    assert adding.ghost(2) == {}, "the other page drags nothing"
    assert adding.ask("hover", "second", **BESIDE_THE_MUG)["on"] == "Cupboard"
    assert adding.ghost(2)
    adding.ask("end_hover")
    assert [bool(adding.ghost(number)) for number in (1, 2, 3)] == [False, True, False]


def test_what_is_dropped_is_where_the_ghost_was_and_is_undone_at_once(adding: Adding) -> None:
    adding.ask("hover", **BESIDE_THE_MUG)
    expected = np.array(adding.ghost(1)["position"])
    before = set(adding.sim.state.ids)
    id = adding.ask("drop", **BESIDE_THE_MUG)
    assert set(adding.sim.state.ids) - before == {id}
    body = adding.sim.snapshot().body(BodyId(id))
    assert body.pose.position == pytest.approx(expected, abs=0.02)
    assert (body.size, body.cls.split("#")[-1]) == (SIZE, CUP)
    assert adding.ghost(1) == {}
    adding.sim.edits.undo()
    assert set(adding.sim.state.ids) == before


def test_a_second_one_is_put_beside_the_first(adding: Adding) -> None:
    first, second = (adding.ask("drop", **BESIDE_THE_MUG) for _ in range(2))
    world = adding.sim.snapshot()
    positions = [np.array(world.body(BodyId(id)).pose.position) for id in (first, second)]
    assert first != second
    assert 0.07 < np.linalg.norm(positions[0] - positions[1]) < 0.3
    assert positions[1][2] == pytest.approx(0.85, abs=0.01)


def test_where_nothing_is_there_is_no_ghost_and_nothing_is_dropped(adding: Adding) -> None:
    adding.look((2.0, 0.0, 1.0), (2.0, -9.0, 9.0))
    assert adding.ask("hover", **NOWHERE) == {"on": None, "reason": "there is nothing at the pointer"}
    assert adding.ghost(1) == {}
    before = adding.sim.state.ids
    with pytest.raises(NoFreePlacementError, match="there is nothing"):
        adding.ask("drop", **NOWHERE)
    assert adding.sim.state.ids == before


def test_where_it_does_not_fit_the_ghost_is_red_and_the_reason_is_given(adding: Adding) -> None:
    large = {"cls": CUP, "pointer": (0.0, 0.1 / 2.6), "size": (3.0, 3.0, 0.5)}
    offer = adding.ask("hover", **large)
    assert offer["on"] is None
    assert offer["reason"]
    assert not adding.is_free(1)
    with pytest.raises(NoFreePlacementError) as caught:
        adding.ask("drop", **large)
    assert offer["reason"] in str(caught.value)
    assert adding.ask("hover", **BESIDE_THE_MUG)["on"] == "Cupboard", "another size is another ghost"
    assert adding.is_free(1)


def test_a_body_is_added_where_the_camera_of_the_page_looks(adding: Adding) -> None:
    adding.look((2.0, 0.2, 6.0), (2.0, 0.2, 0.0))
    seen = adding.ask("add", size=SIZE, cls=CUP)
    assert adding.sim.snapshot().body(BodyId(seen)).pose.position == pytest.approx((2.0, 0.2, 0.85), abs=0.03)
    adding.sim.edits.undo()
    assert seen not in adding.sim.state.ids


def test_a_body_is_added_at_a_point_or_on_a_body(adding: Adding) -> None:
    there = adding.ask("add", position=(0.5, -1.5, 2.0), size=SIZE, cls=CUP)
    assert adding.sim.snapshot().body(BodyId(there)).pose.position == pytest.approx((0.5, -1.5, 2.052))
    blind = adding.ask("add", "none", size=SIZE, cls=CUP)
    assert adding.sim.snapshot().body(BodyId(blind)).pose.position == pytest.approx((0.0, 0.0, 0.052))
    on = adding.ask("add", on="Fridge", size=SIZE, cls=CUP)
    assert adding.sim.snapshot().body(BodyId(on)).pose.position[2] == pytest.approx(1.85, abs=0.01)
    for id in (on, blind, there):
        adding.sim.edits.undo()
        assert id not in adding.sim.state.ids


def test_classes_are_found_by_words_within_a_category(adding: Adding) -> None:
    found = adding.ask("find_classes", text="cup")
    assert CUP in [each["name"] for each in found]
    titles = {each["title"] for each in adding.ask("find_classes", text="bottle")}
    assert {"Bottle", "Bottle cap", "Glass bottle"} <= titles
    everything = adding.ask("find_classes")
    assert len(everything) > len(found)
    assert all(each["size"] for each in everything)
    order = [(not each["used"], each["title"].casefold()) for each in everything]
    assert order == sorted(order), "what the world has comes first, by its title"
    categories = adding.ask("class_categories")
    assert len(categories) > 3
    assert set(categories) == {each["category"] for each in everything}
    for category in categories[:3]:
        own = adding.ask("find_classes", category=category)
        assert own == [each for each in everything if each["category"] == category]
        assert own
