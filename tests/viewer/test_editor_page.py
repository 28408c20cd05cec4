"""Editing on the page in a real browser: commands, history, several bodies, and the Add panel with its drags."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.scene import BodyId, Pose
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

OpenPage = Callable[..., PageTab]
MUG = BodyId("Mug")


@pytest.fixture
def physics_simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


def selected(tab: PageTab) -> list[str]:
    return list(tab.page.evaluate("mindstage.selection.ids"))


def history(tab: PageTab) -> list[str]:
    return list(tab.page.locator("[data-role=history] li").all_inner_texts())


def blur(tab: PageTab) -> None:
    tab.page.evaluate("document.activeElement.blur()")


def test_the_palette_runs_commands_and_selects_bodies(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False)
    wait_until(lambda: len(tab.tree_rows()) >= 3, "the tree is shown")
    tab.page.keyboard.press("Control+k")
    tab.page.keyboard.type("mug")
    wait_until(lambda: tab.page.locator("#palette [data-entry='Select Mug']").is_visible(), "bodies are found")
    tab.page.keyboard.press("Enter")
    wait_until(lambda: tab.selected == "Mug", "the body is selected")
    tab.page.keyboard.press("Control+k")
    tab.page.keyboard.type("duplic")
    tab.page.keyboard.press("Enter")
    wait_until(lambda: selected(tab) == ["Mug_1"], "the copy is selected")
    assert "Mug_1" in simulation.state.ids
    tab.page.keyboard.press("Control+z")
    wait_until(lambda: "Mug_1" not in simulation.state.ids, "the copy is removed")
    tab.page.keyboard.press("Control+Shift+z")
    wait_until(lambda: "Mug_1" in simulation.state.ids, "the copy is there again")


_CLOSE_AND_PRESS_SPACE = """() => {
  document.getElementById("keyboard-help").close();
  document.activeElement.dispatchEvent(new KeyboardEvent("keydown", {key: " ", code: "Space", bubbles: true}));
}"""
"""The next key may be pressed before the browser takes the focus from the closed dialog."""


def test_keys_work_outside_of_fields_and_the_help_lists_them(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False)
    wait_until(lambda: len(tab.tree_rows()) >= 3, "the tree is shown")
    tab.page.locator("[data-role=find-body]").fill("?")
    tab.page.locator("[data-role=find-body]").press("Space")
    assert not tab.page.locator("#keyboard-help").is_visible(), "a key typed into a field is text"
    assert not simulation.state.playing
    tab.page.locator("[data-role=find-body]").fill("")
    blur(tab)
    tab.page.keyboard.press("?")
    tab.page.locator("#keyboard-help").wait_for()
    text = tab.page.locator("#keyboard-help").inner_text()
    for key in ("Ctrl+K", "Space", "Ctrl+Z", "Esc", "Del", "Home"):
        assert key in text
    tab.page.evaluate(_CLOSE_AND_PRESS_SPACE)
    wait_until(lambda: simulation.state.playing and tab.shows_text("playing at"), "Space plays, and the page shows it")
    tab.page.keyboard.press("Space")
    wait_until(lambda: not simulation.state.playing, "Space pauses")
    tab.page.keyboard.press("?")
    tab.page.keyboard.press("Escape")
    assert not tab.page.locator("#keyboard-help").is_visible(), "Escape closes the help"
    tab.select_in_tree("Mug")
    blur(tab)
    tab.page.keyboard.press("Escape")
    wait_until(lambda: tab.selected is None, "Escape selects nothing")


def test_a_body_is_renamed_and_the_name_undone(simulation: Simulation, viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer, view=False)
    wait_until(lambda: len(tab.tree_rows()) >= 3, "the tree is shown")
    tab.select_in_tree("Mug")
    blur(tab)
    tab.page.keyboard.press("F2")
    tab.page.keyboard.type("Ann's cup")
    tab.page.keyboard.press("Enter")
    title, row = tab.page.locator("[data-role=title]"), tab.page.locator(".tree-row[data-id=Mug] .tree-name")
    wait_until(lambda: title.inner_text() == "Ann's cup" and "Ann's cup" in row.inner_text(), "the name is shown")
    assert simulation.snapshot().body("Mug").label == "Ann's cup"
    blur(tab)
    tab.page.keyboard.press("Control+z")
    wait_until(lambda: title.inner_text() == "Cup" and "Ann's cup" not in row.inner_text(), "it has no name again")
    tab.page.keyboard.press("Control+y")
    wait_until(lambda: title.inner_text() == "Ann's cup", "it is renamed again")


def test_a_copy_that_is_undone_before_it_is_selected_causes_no_error(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False)
    tab.select_in_tree("Mug")
    # The undo is handled first, and the selection is already another one when the details are refused.
    tab.page.evaluate("mindstage.selection.select('Mug_1'); mindstage.selection.select(null)")
    tab.page.evaluate("mindstage.channel.call('details', { id: 'Mug_1' }).catch(() => {})")
    assert tab.selected is None
    assert tab.page.locator(".toast").count() == 0


def test_deleting_asks_about_parts_and_the_history_goes_back(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False)
    tab.select_in_tree("Fridge")
    blur(tab)
    tab.page.keyboard.press("Delete")
    tab.page.locator("dialog.choice").wait_for()
    assert "its 2 parts" in tab.page.locator("dialog.choice").inner_text()
    tab.page.keyboard.press("Escape")
    wait_until(lambda: not tab.page.locator("dialog.choice").count(), "nothing is deleted")
    assert BodyId("Fridge") in simulation.state.ids
    tab.page.keyboard.press("Delete")
    tab.page.locator("[data-choice=all]").click()
    wait_until(lambda: len(simulation.state.ids) == 5, "the fridge is deleted with its door and handle")
    simulation.edits.move(MUG, Pose((1.0, 0.0, 0.85)))
    tab.open_panel("history")
    wait_until(lambda: history(tab) == ["Start", "Fridge with 2 more deleted", "pose of Mug"], "both steps are listed")
    tab.page.locator("[data-step='0']").click()
    wait_until(lambda: len(simulation.state.ids) == 8, "everything is undone")
    wait_until(lambda: tab.page.locator("[data-step='2'].undone").count() == 1, "undone steps stay in the list")
    tab.page.locator("[data-step='1']").click()
    wait_until(lambda: len(simulation.state.ids) == 5, "one step is redone")


def test_several_bodies_are_selected_hidden_and_deleted(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False)
    wait_until(lambda: tab.tree_rows() == ["Cupboard", "Floor", "Fridge"], "the tree is shown")
    tab.page.locator(".tree-row[data-id=Cupboard] .caret").click()
    tab.page.locator(".tree-row[data-id=Fridge] .tree-name").click()
    tab.page.locator(".tree-row[data-id=Mug] .tree-name").click(modifiers=["Control"])
    wait_until(lambda: selected(tab) == ["Fridge", "Mug"], "two bodies are selected")
    assert tab.page.locator(".tree-row[aria-selected=true]").count() == 2
    wait_until(lambda: tab.page.locator("[data-role=others]").is_visible(), "the details say so")
    blur(tab)
    tab.page.keyboard.press("h")
    wait_until(lambda: viewer.views.hidden == {"Fridge", "Mug"}, "both are hidden")
    wait_until(lambda: tab.page.locator(".tree-row.hidden-body").count() >= 2, "the page shows it")
    tab.page.keyboard.press("Control+h")
    wait_until(lambda: not viewer.views.hidden, "all are shown again")
    tab.page.keyboard.press("Shift+h")
    wait_until(lambda: {"Floor", "Cupboard"} <= viewer.views.hidden, "the others are hidden")
    assert viewer.views.hidden.isdisjoint({"Fridge", "FridgeDoor", "FridgeHandle", "Mug"})
    tab.page.locator(".tree-row[data-id=Fridge] .tree-name").click(modifiers=["Control"])
    wait_until(lambda: selected(tab) == ["Mug"], "one is removed from the selection")


def test_copied_bodies_are_pasted_as_text_in_another_tab(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab, other = open_page(viewer, view=False), open_page(viewer, view=False)
    tab.select_in_tree("Mug")
    text = tab.page.evaluate("mindstage.channel.call('copy', { ids: mindstage.selection.ids })")
    paste = """text => {
        const data = new DataTransfer();
        data.setData("text/plain", text);
        document.body.dispatchEvent(new ClipboardEvent("paste", { clipboardData: data, bubbles: true }));
    }"""
    other.page.evaluate(paste, text)
    wait_until(lambda: selected(other) == ["Mug_1"], "the copy is selected in the other tab")
    assert selected(tab) == ["Mug"]
    other.page.evaluate(paste, "something else")
    wait_until(lambda: other.shows_text("not a copied group of bodies"), "other text is refused")


def test_classes_are_found_by_category_and_synonym_with_pictures(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False)
    tab.open_panel("add")
    tab.page.locator("[data-category=Tableware]").click()
    wait_until(lambda: tab.page.locator("[data-class=DinnerPlate]").count() == 1, "plates are tableware")
    wait_until(lambda: not tab.page.locator("[data-class=Refrigerator]").count(), "other categories are not listed")
    tab.page.locator("[data-category=All]").click()
    tab.page.locator("[data-role=find-class]").fill("fridge")
    wait_until(lambda: tab.page.locator("[data-class=Refrigerator]").count() == 1, "a synonym is found")
    wait_until(lambda: tab.page.locator("[data-class=Refrigerator] img.thumbnail").count() == 1, "it has a picture")
    width = "document.querySelector('[data-class=Refrigerator] img').naturalWidth"
    wait_until(lambda: tab.page.evaluate(width) == 96, "the picture is loaded")


def test_objects_are_added_to_the_body_that_was_selected_last(
    physics_simulation: Simulation, open_page: OpenPage
) -> None:
    with Viewer(physics_simulation, port=0) as viewer:
        tab = open_page(viewer, view=False)
        tab.select_in_tree("Cupboard")
        tab.open_panel("add")
        tab.page.locator("[data-role=find-class]").fill("cup")
        tab.page.locator("[data-class=Cup]").click()
        for size in tab.page.locator("[data-size]").all():
            size.fill("0.08")
        for number in (1, 2):
            tab.click_button("add")
            wait_until(lambda number=number: tab.selected == f"Cup_{number}", f"cup {number} is selected")
            assert physics_simulation.snapshot().body(BodyId(f"Cup_{number}")).pose.position[2] > 0.5
        assert tab.page.locator(".toast.error").count() == 0
        tab.page.close()


def test_an_object_is_dragged_into_the_view_onto_a_surface(physics_simulation: Simulation, open_page: OpenPage) -> None:
    with Viewer(physics_simulation, port=0) as viewer:
        tab = open_page(viewer, size=(1000, 560))
        tab.open_panel("add")
        tab.page.locator("[data-role=find-class]").fill("bowl")
        tile = tab.page.locator("[data-class=Bowl]")
        tile.wait_for()
        box = tile.bounding_box()
        body = physics_simulation.snapshot().body(BodyId("Cupboard"))
        assert body.size is not None
        x, y, z = body.pose.position
        to_x, to_y = tab.to_window((x, y, z + body.size[2] / 2))
        tab.page.mouse.move(box["x"] + 20, box["y"] + 20)
        tab.page.mouse.down()
        tab.page.mouse.move(box["x"] - 30, box["y"] + 30, steps=3)
        tab.page.mouse.move(to_x, to_y, steps=4)
        wait_until(lambda: tab.page.locator(".drag-hint").inner_text() == "on Cupboard", "the place is named")
        tab.page.mouse.up()
        wait_until(lambda: BodyId("Bowl_1") in physics_simulation.state.ids, "the bowl is added")
        at = physics_simulation.snapshot().body(BodyId("Bowl_1")).pose.position
        assert at[2] == pytest.approx(z + body.size[2] / 2, abs=0.2)
        assert at[2] > z + body.size[2] / 2 - 0.01, "it is on top"
        assert at[:2] == pytest.approx((x, y), abs=0.25)
        assert viewer.views.clients


def test_a_finger_scrolls_the_objects_and_drags_the_one_that_it_has_held(
    physics_simulation: Simulation, browser: Any
) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 700}, has_touch=True, is_mobile=True)
    with Viewer(physics_simulation, port=0) as viewer, closing(context):
        tab = PageTab(context.new_page(), viewer, view=True)
        page, session = tab.page, context.new_cdp_session(tab.page)

        def touch(type: str, *points: tuple[float, float]) -> None:
            session.send(
                "Input.dispatchTouchEvent", {"type": type, "touchPoints": [{"x": x, "y": y} for x, y in points]}
            )

        page.locator("[data-sheet=add]").tap()
        tiles = page.locator(".classes > [role=option]")
        tiles.nth(5).wait_for()
        add = page.locator("[data-action=add]")
        assert add.bounding_box()["y"] + add.bounding_box()["height"] <= page.locator("#sheet-bar").bounding_box()["y"]
        box = tiles.nth(1).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        touch("touchStart", (x, y))
        for step in range(1, 7):
            touch("touchMove", (x, y - 15.0 * step))
        touch("touchEnd")
        wait_until(lambda: page.locator(".classes").evaluate("list => list.scrollTop") > 20, "the list has scrolled")
        assert page.locator(".drag-image").is_hidden()

        page.locator("[data-role=find-class]").fill("bowl")
        tile = page.locator("[data-class=Bowl]")
        wait_until(lambda: "bowl" in tiles.first.inner_text().lower(), "bowls are found")
        tile.scroll_into_view_if_needed()
        box = tile.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        body = physics_simulation.snapshot().body(BodyId("Cupboard"))
        assert body.size is not None
        at = body.pose.position
        to = tab.to_window((at[0], at[1], at[2] + body.size[2] / 2))
        assert y < page.locator("[data-action=add]").bounding_box()["y"]
        touch("touchStart", (x, y))
        wait_until(lambda: tile.get_attribute("aria-selected") == "true", "it has been held")
        for step in range(1, 6):
            touch("touchMove", (x + (to[0] - x) * step / 5, y + (to[1] - y) * step / 5))
        wait_until(lambda: page.locator(".drag-hint").inner_text() == "on Cupboard", "the place is named")
        touch("touchEnd")
        wait_until(lambda: BodyId("Bowl_1") in physics_simulation.state.ids, "the bowl is added")
        assert tab.errors == []


def test_bodies_are_selected_by_a_rectangle_and_distances_measured(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer)
    wait_until(lambda: viewer.views.clients, "the view is drawn")
    x, y, z = simulation.snapshot().body(MUG).pose.position
    at_x, at_y = tab.to_window((x, y, z))
    blur(tab)
    tab.page.keyboard.press("b")
    tab.page.mouse.move(at_x - 12, at_y - 12)
    tab.page.mouse.down()
    tab.page.mouse.move(at_x + 12, at_y + 12, steps=3)
    assert tab.page.locator(".selection-rectangle").is_visible()
    tab.page.mouse.up()
    wait_until(lambda: selected(tab) == ["Mug"], "what is in the rectangle is selected")
    assert tab.page.evaluate("mindstage.viewTools.active") is None
    tab.page.keyboard.press("m")
    fridge = simulation.snapshot().body(BodyId("Fridge")).pose.position
    readout = tab.page.locator("#measurement")
    tab.click((x, y, z))
    wait_until(lambda: "Click the second point" in readout.inner_text(), "the first point is picked")
    tab.click((fridge[0], fridge[1], 1.8))
    wait_until(lambda: tab.page.locator("[data-measured=distance]").count() == 1, "the distance is shown")
    shown = float(tab.page.locator("[data-measured=distance]").inner_text().split()[0])
    assert shown == pytest.approx(((fridge[1] - y) ** 2 + (1.8 - z) ** 2) ** 0.5, abs=0.4)
    tab.page.keyboard.press("Escape")
    wait_until(lambda: not readout.is_visible(), "the measurement is removed")
