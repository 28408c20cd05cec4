"""The outline groups bodies by room and by what they are in or on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

import mindstage as ms
from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.scene import Body, BodyId, Iri, Literal, Mobility, Pose, PropertyAssertion, World
from mindstage.viewer import Viewer
from mindstage.viewer.inspector import world_title
from mindstage.viewer.outline_places import find_places
from tests.kitchenette import kitchenette
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

OpenPage = Callable[..., PageTab]
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"


def test_things_are_in_or_on_the_closest_thing_but_not_on_the_floor() -> None:
    with ms.open("bundled:kitchen") as kitchen:
        places = find_places(kitchen)
    assert places.holders[BodyId("milk_carton_1")] == ("fridge", "in")
    assert places.holders[BodyId("coffee_mug_4")] == ("table", "on")
    assert places.holders[BodyId("coffee_mug_1")] == ("drawer_right_1", "in"), "not in the unit of the drawer"
    assert BodyId("base_cupboard") not in places.holders, "all furniture stands on the floor"
    assert places.rooms == {}, "one room groups nothing"


def _box(id: str, cls: str, position: tuple[float, float, float], size: tuple[float, float, float]) -> Body:
    body = kitchenette().body("Mug")
    physics = replace(body.physics, mobility=Mobility.STATIC)
    iri, cls_iri = Iri(f"http://x#{id}"), Iri(KNOWROB + cls)
    return replace(body, id=BodyId(id), iri=iri, cls=cls_iri, pose=Pose(position), size=size, physics=physics)


def two_rooms() -> World:
    room = (4.0, 4.0, 2.5)
    return World(
        iri=Iri("http://x#flat"),
        bodies=(
            _box("kitchen", "RoomInAConstruction", (0.0, 0.0, 1.25), room),
            _box("hall", "RoomInAConstruction", (5.0, 0.0, 1.25), room),
            _box("counter", "Table", (0.0, 0.0, 0.4), (1.0, 1.0, 0.8)),
            _box("cup_1", "Cup", (0.0, 0.0, 0.85), (0.1, 0.1, 0.1)),
            _box("bench", "Chair-PieceOfFurniture", (5.0, 0.0, 0.4), (1.0, 1.0, 0.8)),
        ),
    )


def test_the_outline_has_a_group_for_each_room(open_page: OpenPage) -> None:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as simulation:
        simulation.spawn(two_rooms())
        with Viewer(simulation, port=0) as viewer:
            tab = open_page(viewer, view=False)
            tree = tab.page.get_by_role("tree", name="Bodies of the world")
            kitchen = tree.get_by_role("treeitem").filter(has_text="kitchen").first
            wait_until(lambda: "room kitchen" in tab.tree_rows(), "the rooms are shown")
            rows = tab.tree_rows()
            assert rows.index("room kitchen") < rows.index("counter") or rows.index("bench") < rows.index(
                "room kitchen"
            )
            assert "cup_1" not in rows, "it is below the counter"
            kitchen.wait_for()
            tab.page.locator(".tree-row[data-id='room kitchen']").click()
            wait_until(lambda: "counter" not in tab.tree_rows(), "a click on a room closes it")
            assert tab.selected is None
            simulation.edits.move(BodyId("counter"), Pose((5.0, 1.2, 0.4)))
            tab.page.get_by_role("searchbox").fill("table")
            wait_until(lambda: tab.tree_rows() == ["room hall", "counter"], "what has moved is in the other room")


@pytest.mark.parametrize(
    ("name", "label", "title"),
    [
        ("kitchen", None, "kitchen"),
        ("map", None, "my-flat"),
        ("SemanticEnvironmentMap_gTmo", None, "my-flat"),
        ("room_x8Tq3Z", None, "my-flat"),
        ("map", "The lab", "The lab"),
        ("iai-kitchen", None, "iai-kitchen"),
    ],
)
def test_the_title_of_a_map_is_for_people(name: str, label: str | None, title: str) -> None:
    rdfs = Iri("http://www.w3.org/2000/01/rdf-schema#label")
    facts: Any = () if label is None else (PropertyAssertion(rdfs, Literal(label)),)
    assert world_title(World(iri=Iri("http://x#y"), name=name, facts=facts), [Path("my-flat.owl")]) == title
