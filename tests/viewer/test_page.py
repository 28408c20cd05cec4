"""The page in a real browser, operated by mouse and keyboard; without the 3D view where it does not matter."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.scene import BodyId, Iri, Pose, World
from mindstage.scene.edits import SetPoses
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import TIMEOUT_S, wait_until

OpenPage = Callable[..., PageTab]

ON_THE_HANDLE = (1.66, 0.0, 0.65)


@pytest.fixture
def physics_simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def open_page(open_page: OpenPage) -> OpenPage:
    """Opens pages without the 3D view by default, for speed."""
    return lambda viewer, *, view=False, **more: open_page(viewer, view=view, **more)


def position(simulation: Simulation, id: str) -> np.ndarray:
    return simulation.state.poses[simulation.state.ids.index(BodyId(id))][:3]


# -- toolbar -----------------------------------------------------------------------------------------------------------


def test_the_buttons_play_pause_step_and_reset(simulation: Simulation, viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    wait_until(lambda: tab.shows_text("8 bodies") and tab.shows_text("2 joints · null"), "the toolbar shows the world")
    start = simulation.state.time_s
    tab.click_button("step")
    wait_until(lambda: simulation.state.time_s == pytest.approx(start + 0.1), "0.1 s have passed")
    tab.page.locator("[data-action=speed]").select_option("2")
    tab.click_button("play")
    wait_until(
        lambda: simulation.state.playing and simulation.state.speed == 2.0, "the simulation runs at double speed"
    )
    wait_until(lambda: tab.shows_text("playing"), "the toolbar shows the state")
    simulation.play(speed=0.5)
    speed = tab.page.locator("[data-action=speed]")
    wait_until(lambda: speed.input_value() == "0.5", "the speed on the page is updated")
    tab.click_button("play")
    wait_until(lambda: not simulation.state.playing and tab.shows_text("paused"), "the simulation is paused")
    simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug"): kitchenette().body("Fridge").pose})))
    tab.click_button("reset")
    wait_until(lambda: np.allclose(position(simulation, "Mug"), (2.0, 0.0, 0.85)), "the mug is at its initial pose")


def test_an_error_of_the_simulation_is_shown(simulation: Simulation, viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    simulation.close()
    tab.click_button("step")
    wait_until(lambda: tab.shows_text("the simulation is closed"), "the error is shown")


def test_a_lost_connection_is_shown_and_reconnects(simulation: Simulation, viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    tab.select_in_tree("Mug")
    port = int(viewer.url.rsplit(":", 1)[1])
    viewer.close()
    wait_until(lambda: tab.page.locator("#disconnected").is_visible(), "the page shows that the connection is lost")
    with Viewer(simulation, port=port) as again:
        assert again.url == viewer.url
        wait_until(lambda: not tab.page.locator("#disconnected").is_visible(), "the page is connected again")
        simulation.edits.move(BodyId("Mug"), Pose((1.0, 0.0, 0.85)))
        wait_until(
            lambda: (tab.live() or {"pose": {"position": []}})["pose"]["position"][:1] == [1.0],
            "live details are received",
        )


def test_a_request_made_without_a_connection_is_sent_when_it_is_back(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer)
    start, port = simulation.state.time_s, int(viewer.url.rsplit(":", 1)[1])
    viewer.close()
    wait_until(lambda: tab.page.locator("#disconnected").is_visible(), "the page shows that the connection is lost")
    tab.click_button("reset")
    tab.page.locator("[data-toast=error]", has_text="reset was not sent").wait_for()
    tab.click_button("step")
    with Viewer(simulation, port=port):
        wait_until(lambda: simulation.state.time_s == pytest.approx(start + 0.1), "the queued step is executed")


def test_a_server_that_stops_responding_is_reported(viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    pending = "mindstage.channel.pendingMethods"
    wait_until(lambda: not tab.page.evaluate(pending), "what the page asks for when it opens is answered")
    released = threading.Event()
    loop = viewer._server._websock_server._background_event_loop
    loop.call_soon_threadsafe(released.wait, TIMEOUT_S)
    try:
        tab.page.evaluate("void mindstage.channel.call('ask.questions')")  # older, but its panel shows its progress
        tab.click_button("step")
        banner = tab.page.locator("#disconnected", has_text="does not respond")
        wait_until(banner.is_visible, "the page shows that nothing is received")
        assert "Waiting for the server: step" in tab.page.locator("#waiting").inner_text()
    finally:
        released.set()
    wait_until(lambda: not banner.is_visible(), "the server responds again")
    wait_until(lambda: not tab.page.locator("#waiting").is_visible(), "the request is answered")


def test_what_does_not_fit_into_the_toolbar_is_in_its_menu(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, size=(390, 700))
    toolbar, menu = tab.page.locator("#toolbar"), tab.page.locator("#toolbar-menu")
    assert toolbar.evaluate("toolbar => toolbar.scrollWidth <= toolbar.clientWidth")
    assert toolbar.locator("[data-action=play]").is_visible()
    assert not menu.is_visible()
    start = simulation.state.time_s
    tab.click_button("step")
    wait_until(lambda: simulation.state.time_s > start, "a button in the menu works")
    tab.page.keyboard.press("Escape")
    assert not menu.is_visible()
    tab.page.set_viewport_size({"width": 1600, "height": 700})
    wait_until(lambda: not menu.locator(":scope > *").count(), "with more room all controls are in the toolbar again")
    assert not tab.page.locator("#toolbar-more").is_visible()
    assert toolbar.locator("[data-action=step]").is_visible()


def test_in_a_narrow_window_the_view_menu_is_below_the_toolbar_and_closed_by_escape(
    viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False, size=(1000, 700))
    tab.click_button("view-menu")
    menu, more = (tab.page.locator(each).bounding_box() for each in ("#view-menu", "#toolbar-more"))
    assert menu["y"] >= more["y"] + more["height"]
    assert menu["x"] + menu["width"] <= 1000
    tab.page.keyboard.press("Escape")
    wait_until(lambda: not tab.page.locator("#view-menu").is_visible(), "the menu is closed")


def test_in_a_narrow_window_the_add_panel_fits_into_its_sidebar(viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer, view=False, size=(1000, 700))
    tab.select_in_tree("FridgeHandle")
    tab.open_panel("add")
    for label in ("[data-role=placement]", "[data-size]:last-of-type", "[data-action=add]"):
        box = tab.page.locator(f"#panel-add {label}").first.bounding_box()
        assert box["x"] + box["width"] <= 1000 - 8, label


# -- scene tree and details --------------------------------------------------------------------------------------------


def test_a_body_is_found_selected_and_described(simulation: Simulation, viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    wait_until(lambda: tab.tree_rows() == ["Cupboard", "Floor", "Fridge"], "top-level rows are shown by class")
    tab.page.locator(".tree-row[data-id=Cupboard] .caret").click()
    assert tab.tree_rows() == ["Cupboard", "Mug", "Drawer", "Floor", "Fridge"], "the mug is on the cupboard"
    assert tab.page.locator(".tree-row[data-id=Mug]").get_by_role("img", name="on", exact=True).is_visible()
    assert tab.page.locator(".tree-row[data-id=Fridge]").inner_text().split() == ["refrigerator", "Fridge"]
    tab.page.locator("[data-role=find-body]").fill("door handle")
    wait_until(lambda: tab.shows_text("0 of 8 found"), "no body matches both words")
    tab.page.locator("[data-role=find-body]").fill("refrigerator")
    wait_until(lambda: tab.tree_rows() == ["Fridge"], "the body is found by its class")
    tab.page.locator("[data-role=find-body]").fill("handle")
    wait_until(lambda: tab.shows_text("2 of 8 found"), "two handles, with their parents")
    assert tab.tree_rows() == ["Cupboard", "Drawer", "DrawerHandle", "Fridge", "FridgeDoor", "FridgeHandle"]
    tab.select_in_tree("FridgeHandle")
    assert tab.shows_text("attached to")
    assert tab.shows_text("0.04 \N{MULTIPLICATION SIGN} 0.02 \N{MULTIPLICATION SIGN} 0.3 m")
    tab.page.locator("[data-body-link=FridgeDoor]").first.click()
    wait_until(lambda: tab.selected == "FridgeDoor" and tab.shows_text("FridgeHinge"), "a link selects its body")


def test_the_scene_tree_is_navigated_by_keyboard(viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    wait_until(lambda: tab.tree_rows() == ["Cupboard", "Floor", "Fridge"], "the tree is shown")
    tab.page.locator("[data-role=find-body]").press("ArrowDown")
    wait_until(lambda: tab.selected == "Cupboard", "the first row is selected")
    keys = ["ArrowDown", "ArrowUp", "ArrowRight", "ArrowDown", "ArrowDown", "End", "Home"]
    rows = ["Floor", "Cupboard", "Cupboard", "Mug", "Drawer", "Fridge", "Cupboard"]
    for key, expected in zip(keys, rows, strict=True):
        tab.page.keyboard.press(key)
        wait_until(lambda expected=expected: tab.selected == expected, f"{key} leads to {expected}")
    assert "Drawer" in tab.tree_rows()
    tab.page.keyboard.press("ArrowLeft")
    wait_until(lambda: "Drawer" not in tab.tree_rows(), "the row is collapsed")


def test_five_thousand_bodies_are_a_few_rows(open_page: OpenPage) -> None:
    mug = kitchenette().body("Mug")
    mugs = tuple(
        replace(mug, id=BodyId(f"Mug{n}"), iri=Iri(f"{mug.iri}{n}"), pose=Pose((n % 70 * 0.2, n // 70 * 0.2, 0.1)))
        for n in range(5000)
    )
    with Simulation(KnowledgeBase(bundled_ontology=False), NullEngine(), primitive_shapes=True) as simulation:
        simulation.spawn(World(iri=Iri("http://x#many"), bodies=mugs))
        with Viewer(simulation, port=0) as viewer:
            tab = open_page(viewer)
            state = "mindstage.outliner.state"
            wait_until(lambda: tab.page.evaluate(f"{state}.bodies") == 5000, "all rows are received")
            assert tab.page.evaluate(f"{state}.rendered") < 80
            tab.select_in_tree("Mug4321")
            assert tab.page.evaluate(f"{state}.rendered") == 1


def test_hidden_bodies_are_hidden_for_all_clients(viewer: Viewer, open_page: OpenPage) -> None:
    tab, other = open_page(viewer), open_page(viewer)
    wait_until(tab.tree_rows, "the tree is shown")
    tab.page.locator(".tree-row[data-id=Fridge]").hover()
    tab.page.locator(".tree-row[data-id=Fridge] [data-action=toggle-visibility]").click()
    hidden = {"Fridge", "FridgeDoor", "FridgeHandle"}
    wait_until(lambda: viewer.views.hidden == hidden, "the fridge is hidden with its children")
    wait_until(
        lambda: other.page.locator(".tree-row.hidden-body[data-id=Fridge]").count() == 1, "the other page is updated"
    )


def test_properties_are_edited_and_undone(simulation: Simulation, viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    page = tab.page
    tab.select_in_tree("Mug")
    page.locator("[data-field=mass]").fill("2.5")
    page.keyboard.press("Enter")
    wait_until(lambda: simulation.snapshot().body("Mug").physics.mass_kg == 2.5, "the mass is changed")
    wait_until(lambda: page.locator("[data-pose=x]").input_value() == "2", "the fields show the pose")
    page.locator("[data-pose=x]").fill("1.25")
    page.keyboard.press("Enter")
    wait_until(lambda: position(simulation, "Mug")[0] == pytest.approx(1.25), "the mug is moved")
    page.locator("[data-pose=yaw]").fill("90")
    page.keyboard.press("Enter")
    turned = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
    wait_until(lambda: simulation.snapshot().body("Mug").pose.quaternion == pytest.approx(turned), "the mug is rotated")
    page.locator("[data-field=mobility]").select_option("static")
    wait_until(lambda: simulation.snapshot().body("Mug").physics.mobility.value == "static", "the mug is static")
    page.locator("[data-field=mass]").fill("-1")
    page.keyboard.press("Enter")
    wait_until(
        lambda: tab.shows_text("The mass must be greater than 0 kg."), "an invalid value is refused with a message"
    )
    for _ in range(4):
        tab.click_button("undo")
    wait_until(lambda: not simulation.edits.history.undo, "everything is undone")
    assert simulation.snapshot().body("Mug") == kitchenette().body("Mug")


def test_a_body_is_attached_by_choosing_its_parent(simulation: Simulation, viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer)
    tab.select_in_tree("Mug")
    tab.click_button("attach")
    tab.page.locator("[data-role=find-body]").fill("drawer")
    wait_until(lambda: "Drawer" in tab.tree_rows(), "the drawer is found")
    tab.page.locator(".tree-row[data-id=Drawer] .tree-name").click()
    wait_until(
        lambda: any(each.child == "Mug" for each in simulation.snapshot().attachments),
        "the mug is attached to the drawer",
    )
    wait_until(lambda: tab.selected == "Mug" and tab.details()["attached_to"] == "Drawer", "the page shows it")
    tab.click_button("detach")
    wait_until(lambda: all(each.child != "Mug" for each in simulation.snapshot().attachments), "the mug is detached")


def test_deleting_by_key_is_seen_by_other_clients_and_undone_by_key(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab, other = open_page(viewer), open_page(viewer)
    other.select_in_tree("Mug")
    tab.select_in_tree("Mug")
    tab.page.keyboard.press("Delete")
    wait_until(lambda: "Mug" not in simulation.state.ids, "the mug is gone")
    wait_until(lambda: other.selected is None and other.shows_text("No body is selected"), "the other page is updated")
    other.page.locator("[data-role=tree]").press("Control+z")
    wait_until(lambda: "Mug" in simulation.state.ids, "the other page has undone it")


def test_a_click_counts_although_the_tree_is_drawn_again_before_the_button_is_released(
    viewer: Viewer, open_page: OpenPage
) -> None:
    tab = open_page(viewer, view=False)
    tab.page.locator(".tree-row[data-id='Fridge'] .tree-name").hover()
    tab.page.mouse.down()
    tab.page.evaluate("document.querySelector('[data-role=tree]').dispatchEvent(new Event('scroll'))")
    tab.page.mouse.up()
    wait_until(lambda: tab.selected == "Fridge", "the fridge is selected")


def test_a_slider_opens_the_drawer_and_follows_it(physics_simulation: Simulation, open_page: OpenPage) -> None:
    physics_simulation.play()
    with Viewer(physics_simulation, port=0) as viewer:
        tab = open_page(viewer)
        tab.select_in_tree("Drawer")
        slider = tab.page.locator("[data-joint=DrawerSlide]")
        slider.fill("-0.3")
        wait_until(
            lambda: position(physics_simulation, "Drawer")[0] == pytest.approx(1.65, abs=0.02), "the drawer opens"
        )
        wait_until(lambda: tab.shows_text("-0.30") or tab.shows_text("-0.29"), "the page shows the position")
        physics_simulation.reset()
        wait_until(lambda: float(slider.input_value()) == pytest.approx(0.0, abs=0.02), "the slider is updated")


# -- adding, saving, loading -------------------------------------------------------------------------------------------


def test_a_body_is_added_from_the_list(physics_simulation: Simulation, open_page: OpenPage) -> None:
    with Viewer(physics_simulation, port=0) as viewer:
        tab = open_page(viewer)
        tab.select_in_tree("Cupboard")
        tab.open_panel("add")
        tab.page.locator("[data-role=find-class]").fill("dinnerplate")
        tab.page.locator("[data-class=DinnerPlate]").click()
        assert tab.page.locator("[data-role=placement]").input_value() == "on"
        tab.click_button("add")
        wait_until(lambda: len(physics_simulation.state.ids) == 9, "the plate is added")
        new = next(id for id in physics_simulation.state.ids if "DinnerPlate" in id)
        wait_until(lambda: tab.selected == new, "the plate is selected")
        assert position(physics_simulation, new)[2] == pytest.approx(0.81, abs=0.03), "the plate is on the cupboard"


def test_the_map_is_saved_and_loaded_by_file_and_by_drop(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage, tmp_path: Path
) -> None:
    tab = open_page(viewer)
    with tab.page.expect_download() as download:
        tab.page.locator("[data-action=save]").select_option("ttl semlog")
    saved = tmp_path / download.value.suggested_filename
    download.value.save_as(saved)
    assert saved.name == "map.ttl"
    simulation.edits.delete([BodyId("Mug"), BodyId("Fridge")])
    tab.page.locator("[data-role=upload]").set_input_files(saved)
    tab.page.get_by_role("button", name="Replace without saving").click()
    wait_until(lambda: len(simulation.state.ids) == 8, "all bodies are restored")
    wait_until(lambda: tab.shows_text("map: 8 bodies, 2 joints"), "the page shows it")
    simulation.edits.delete([BodyId("Mug")])
    drop = """text => {
        const transfer = new DataTransfer();
        transfer.items.add(new File([text], "dropped.ttl"));
        const event = type => new DragEvent(type, {dataTransfer: transfer, bubbles: true, cancelable: true});
        window.dispatchEvent(event("dragenter"));
        document.getElementById("drop-target").dispatchEvent(event("drop"));
    }"""
    tab.page.evaluate(drop, saved.read_text(encoding="utf-8"))
    tab.page.get_by_role("button", name="Replace without saving").click()
    wait_until(lambda: "Mug" in simulation.state.ids, "the dropped map is loaded")
    tab.page.evaluate(drop, "this is no map")
    wait_until(lambda: tab.shows_text("dropped.ttl"), "the invalid file is reported")
    assert len(simulation.state.ids) == 8


# -- small screens -----------------------------------------------------------------------------------------------------


def test_on_a_phone_panels_are_sheets_over_the_view(viewer: Viewer, open_page: OpenPage) -> None:
    tab = open_page(viewer, size=(390, 844))
    page = tab.page
    assert not page.locator("#left-sidebar").is_visible()
    page.locator("[data-sheet=outline]").click()
    assert page.locator("#left-sidebar").is_visible()
    page.locator("[data-role=find-body]").fill("mug")  # it is on the cupboard, whose row is closed
    page.locator(".tree-row[data-id=Mug] .tree-name").click()
    page.locator("[data-sheet=details]").click()
    assert not page.locator("#left-sidebar").is_visible()
    wait_until(
        lambda: tab.shows_text("0.08 \N{MULTIPLICATION SIGN} 0.08 \N{MULTIPLICATION SIGN} 0.1 m"),
        "the mug is described",
    )
    page.locator("[data-sheet=details]").click()
    assert not page.locator("#right-sidebar").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


# -- 3D view in the page -----------------------------------------------------------------------------------------------


def test_a_click_in_the_view_selects_in_this_page_only(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage
) -> None:
    tab, other = open_page(viewer, view=True), open_page(viewer)
    tab.click_until(ON_THE_HANDLE, lambda: tab.selected == "DrawerHandle", "the handle is selected")
    row = tab.page.locator(".tree-row[aria-selected=true]")
    wait_until(lambda: row.get_attribute("data-id") == "DrawerHandle", "the tree shows the row")
    wait_until(lambda: tab.shows_text("kinematic"), "the details are shown")
    assert other.selected is None
    tab.select_in_tree("Fridge")
    (number,) = viewer.views.clients
    wait_until(lambda: viewer.views.selected(number) == "Fridge", "the view selects it, too")
