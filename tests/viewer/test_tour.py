"""A complete session with the bundled kitchen in a real browser, from opening the page to loading a saved map.

Each step is checked in the engine or on the page; pictures of the steps are written to `build/tour`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.maps import bundled_kitchen
from mindstage.scene import BodyId, Vector
from mindstage.viewer import Viewer
from tests.conftest import ROOT
from tests.viewer.page_tab import PageTab, open_tabs
from tests.viewer.waiting import wait_until

WINDOW = (900, 480)
"""Small, because rendering the kitchen without a GPU is slow."""
PICTURES = ROOT / "build" / "tour"
HANDLE = BodyId("fridge_door_handle")
HINGE = "fridge_door_hinge"
MUG = BodyId("coffee_mug_4")
OPENED_RAD = np.radians(15.0)


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, MujocoEngine()) as simulation:
        simulation.spawn()
        yield simulation


def test_a_complete_session_from_opening_the_page_to_loading_a_map(
    kitchen: Simulation, browser: Any, tmp_path: Path
) -> None:
    with Viewer(kitchen, port=0) as viewer, open_tabs(browser) as open_page:
        tab = open_page(viewer, size=WINDOW)
        picture(tab, "opened")
        wait_until(lambda: is_drawn(tab, "fridge") is True, "the fridge is drawn")
        wait_until(lambda: is_drawn(tab, "radiator") is False, "nothing floats where a wall is not drawn")
        find_the_fridge(tab)
        picture(tab, "selected")
        pull_its_door_open(tab, kitchen)
        picture(tab, "pulled")
        ask_where_milk_is_kept(tab, kitchen)
        picture(tab, "asked")
        change_the_mass_of_a_mug(tab, kitchen)
        plate = add_a_plate_to_the_table(tab, kitchen)
        picture(tab, "laid")
        saved = save_the_map(tab, tmp_path)
        load_it_again(tab, kitchen, saved, plate)
        picture(tab, "loaded")


def find_the_fridge(tab: PageTab) -> None:
    wait_until(lambda: tab.shows_text("254 bodies"), "the tree is shown")
    tab.page.locator("[data-role=find-body]").fill("fridge")
    wait_until(lambda: "fridge_door_handle" in tab.tree_rows(), "matching bodies and their children are found")
    assert "coffee_mug_1" not in tab.tree_rows()
    tab.page.locator(".tree-row[data-id=fridge] .tree-name").click()
    wait_until(lambda: tab.details() is not None, "the details are received")
    assert tab.selected == "fridge"
    details = tab.details()
    assert details is not None
    wait_until(lambda: tab.shows_text("FridgeW60H140"), "the details are shown")
    assert details["cls"] == "FridgeW60H140"
    assert "Refrigerator" in details["ancestors"], "superclasses are listed"
    wait_until(lambda: tab.viewer.views.clients, "the view is drawn")
    (view,) = tab.viewer.views.clients
    wait_until(lambda: tab.viewer.views.selected(view) == "fridge", "the view selects it, too")


def pull_its_door_open(tab: PageTab, kitchen: Simulation) -> None:
    tab.click_button("focus")
    tab.select_in_tree("fridge_door")
    wait_for_camera(tab)
    tab.click_button("play")
    wait_until(lambda: kitchen.state.playing, "the simulation runs")
    x, y, z = position_of(kitchen, HANDLE)

    def door_opens() -> bool:
        tab.press_and_move((x, y, z), (x - 0.1, y - 0.45, z))
        try:
            wait_until(lambda: abs(opened(kitchen)) > OPENED_RAD, "the door opens", timeout_s=8.0)
        except AssertionError:
            tab.release()  # a slow browser may have moved the camera instead
            return False
        return True

    wait_until(door_opens, "the door is open")
    wait_until(lambda: abs(shown(tab)) > OPENED_RAD, "the joint position on the page is updated")
    tab.release()
    wait_until(lambda: not tab.viewer._drag_controller.drag_forces, "the drag has ended")
    tab.click_button("play")
    wait_until(lambda: not kitchen.state.playing, "the simulation is paused")
    wait_until(lambda: shown(tab) == pytest.approx(opened(kitchen), abs=1e-3), "engine and page agree")


def ask_where_milk_is_kept(tab: PageTab, kitchen: Simulation) -> None:
    page = tab.page
    tab.open_panel("ask")
    tab.page.locator("[data-role=more-questions]").click()
    page.get_by_role("combobox", name="item").fill("CowsMilk")
    tab.click_button("ask")
    page.locator("#panel-ask tr[data-id=fridge]").wait_for()
    tab.click_button("highlight-all")
    page.wait_for_selector("#legend li[data-highlighted='1']")
    assert set(kitchen.state.highlights) == {"fridge"}
    wait_until(lambda: blue(tab) > 200, "the fridge is blue in the view")


def change_the_mass_of_a_mug(tab: PageTab, kitchen: Simulation) -> None:
    page = tab.page
    page.locator("#legend button").first.click()
    wait_until(lambda: not kitchen.state.highlights, "nothing is highlighted")
    tab.select_in_tree(MUG)
    tab.open_panel("details")
    page.locator("[data-field=mass]").fill("0.75")
    page.keyboard.press("Enter")
    wait_until(lambda: kitchen.snapshot().body(MUG).physics.mass_kg == 0.75, "the mass in the engine is changed")
    wait_until(lambda: (tab.details() or {}).get("mass") == 0.75, "the mass on the page is changed")


def add_a_plate_to_the_table(tab: PageTab, kitchen: Simulation) -> BodyId:
    before = set(kitchen.state.ids)
    tab.select_in_tree("table")
    tab.open_panel("add")
    tab.page.locator("[data-role=find-class]").fill("dinnerplate")
    tab.page.locator("[data-class=DinnerPlate]").click()
    assert tab.page.locator("[data-role=placement]").input_value() == "on"
    tab.click_button("add")
    wait_until(lambda: len(kitchen.state.ids) == len(before) + 1, "a body is added")
    (plate,) = set(kitchen.state.ids) - before
    wait_until(lambda: tab.selected == plate, "the plate is selected")
    table, size = position_of(kitchen, BodyId("table")), kitchen.snapshot().body(BodyId("table")).size
    assert size is not None
    assert position_of(kitchen, plate)[2] == pytest.approx(table[2] + size[2] / 2, abs=0.03), (
        "the plate is on the table"
    )
    return plate


def save_the_map(tab: PageTab, folder: Path) -> Path:
    with tab.page.expect_download() as download:
        tab.page.locator("[data-action=save]").select_option("ttl semlog")
    saved = folder / download.value.suggested_filename
    download.value.save_as(saved)
    return saved


def load_it_again(tab: PageTab, kitchen: Simulation, saved: Path, plate: BodyId) -> None:
    door = position_of(kitchen, BodyId("fridge_door"))
    kitchen.clear()
    wait_until(lambda: tab.shows_text("0 bodies"), "the world is empty")
    tab.page.locator("[data-role=upload]").set_input_files(saved)
    tab.page.locator("[data-choice=discard]").click()  # that all was removed is an edit, which is not saved
    wait_until(lambda: len(kitchen.state.ids) == 255, "all bodies are restored, including the plate")
    wait_until(lambda: tab.shows_text("255 bodies"), "the page shows it")
    loaded = kitchen.snapshot()
    assert loaded.body(plate).cls.endswith("#DinnerPlate")
    assert loaded.body(MUG).physics.mass_kg == 0.75
    assert position_of(kitchen, BodyId("fridge_door")) == pytest.approx(door, abs=1e-3), "the door is where it was"
    assert abs(door[1] - 1.183) > 0.02, "the door is open"


# -- how ---------------------------------------------------------------------------------------------------------------


def position_of(kitchen: Simulation, id: BodyId) -> Vector:
    x, y, z = kitchen.state.poses[kitchen.state.ids.index(id)][:3].tolist()
    return x, y, z


def opened(kitchen: Simulation) -> float:
    """The position of the door joint in the engine [rad]."""
    positions = kitchen.engine.run(lambda engine: engine.joint_positions())
    return max(positions[BodyId(HINGE)], key=abs)


def shown(tab: PageTab) -> float:
    """The position of the door joint on the page [rad]."""
    return max((tab.live() or {"joints": {}})["joints"].get(HINGE, {"": 0.0}).values(), key=abs)


def wait_for_camera(tab: PageTab) -> None:
    """Waits for the end of the camera animation."""
    count_pixels: list[object] = []

    def still() -> bool:
        tab.page.wait_for_timeout(150)
        count_pixels.append(tab.camera)
        return count_pixels[-3:].count(count_pixels[-1]) == 3

    wait_until(still, "the camera has stopped")


def is_drawn(tab: PageTab, id: str) -> bool | None:
    """Whether the node of a body is visible; None before there is one."""
    nodes = "document.getElementById('view').contentWindow.__viserMutable.nodeRefFromName"
    visible: bool | None = tab.page.evaluate(f"{nodes}['/bodies/{id}']?.visible ?? null")
    return visible


def blue(tab: PageTab) -> int:
    """The number of pixels in the color of highlighted answers."""
    red, green, blue = np.moveaxis(tab.pixels().astype(int), 2, 0)
    return int(np.sum((blue > 100) & (blue > red + 60) & (blue > green + 40)))


def picture(tab: PageTab, name: str) -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    tab.page.screenshot(path=PICTURES / f"{name}.png", timeout=60_000)
