"""The page in a real browser, by what a person does there. Where the picture does not matter it is left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.scene import BodyId, Iri, Pose, World
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.visiting import PageTab
from tests.viewer.waiting import wait_until

Visiting = Callable[..., PageTab]

ON_THE_HANDLE = (1.66, 0.0, 0.65)


@pytest.fixture
def alive() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as stage:
        stage.spawn(kitchenette())
        yield stage


@pytest.fixture
def visit(visit: Visiting) -> Visiting:
    """Without the picture, unless it is wanted."""
    return lambda viewport, *, view=False, **more: visit(viewport, view=view, **more)


def position(stage: Simulation, id: str) -> np.ndarray:
    return stage.state.poses[stage.state.ids.index(BodyId(id))][:3]


# -- the bar -----------------------------------------------------------------------------------------------------------


def test_the_buttons_play_pause_step_and_reset(stage: Simulation, viewport: Viewer, visit: Visiting) -> None:
    visitor = visit(viewport)
    wait_until(
        lambda: visitor.shows_text("8 bodies") and visitor.shows_text("2 joints · null"), "the page says what is there"
    )
    start = stage.state.time_s
    visitor.click_button("step")
    wait_until(lambda: stage.state.time_s == pytest.approx(start + 0.1), "a tenth of a second has passed")
    visitor.page.locator("[data-action=speed]").select_option("2")
    visitor.click_button("play")
    wait_until(lambda: stage.state.playing and stage.state.speed == 2.0, "time passes twice as fast")
    wait_until(lambda: visitor.shows_text("playing"), "the page says that it plays")
    stage.play(speed=0.5)
    speed = visitor.page.locator("[data-action=speed]")
    wait_until(lambda: speed.input_value() == "0.5", "the page follows the stage")
    visitor.click_button("play")
    wait_until(lambda: not stage.state.playing and visitor.shows_text("paused"), "time stands still")
    stage.run_on_engine(lambda engine: engine.set_pose(BodyId("Mug"), kitchenette().body("Fridge").pose))
    visitor.click_button("reset")
    wait_until(lambda: np.allclose(position(stage, "Mug"), (2.0, 0.0, 0.85)), "the mug is back in its place")


def test_what_the_stage_refuses_is_said_to_the_visitor(stage: Simulation, viewport: Viewer, visit: Visiting) -> None:
    visitor = visit(viewport)
    stage.close()
    visitor.click_button("step")
    wait_until(lambda: visitor.shows_text("the simulation is closed"), "the page says why nothing happens")


def test_a_lost_connection_is_said_and_comes_back_by_itself(
    stage: Simulation, viewport: Viewer, visit: Visiting
) -> None:
    visitor = visit(viewport)
    visitor.select_in_tree("Mug")
    port = int(viewport.url.rsplit(":", 1)[1])
    viewport.close()
    wait_until(lambda: visitor.page.locator("#disconnected").is_visible(), "the page says that the connection is lost")
    with Viewer(stage, port=port) as again:
        assert again.url == viewport.url
        wait_until(lambda: not visitor.page.locator("#disconnected").is_visible(), "it is there again")
        stage.undo_stack.move(BodyId("Mug"), Pose((1.0, 0.0, 0.85)))
        wait_until(lambda: (visitor.live() or {"pose": {"position": []}})["pose"]["position"][:1] == [1.0], "and tells")


# -- the outline and the details ---------------------------------------------------------------------------------------


def test_a_thing_is_found_selected_and_described(stage: Simulation, viewport: Viewer, visit: Visiting) -> None:
    visitor = visit(viewport)
    wait_until(lambda: visitor.tree_rows() == ["Cupboard", "Floor", "Fridge", "Mug"], "only what is above is open")
    visitor.page.locator(".tree-row[data-id=Cupboard] .caret").click()
    assert visitor.tree_rows() == ["Cupboard", "Drawer", "Floor", "Fridge", "Mug"]
    visitor.page.locator("[data-role=find-body]").fill("door handle")
    wait_until(lambda: visitor.shows_text("0 of 8 found"), "no door is a handle")
    visitor.page.locator("[data-role=find-body]").fill("refrigerator")
    wait_until(lambda: visitor.tree_rows() == ["Fridge"], "it is found by its class")
    visitor.page.locator("[data-role=find-body]").fill("handle")
    wait_until(lambda: visitor.shows_text("2 of 8 found"), "two handles, with what they hang on")
    assert visitor.tree_rows() == ["Cupboard", "Drawer", "DrawerHandle", "Fridge", "FridgeDoor", "FridgeHandle"]
    visitor.select_in_tree("FridgeHandle")
    assert visitor.shows_text("attached to")
    assert visitor.shows_text("0.04 \N{MULTIPLICATION SIGN} 0.02 \N{MULTIPLICATION SIGN} 0.3 m")
    visitor.page.locator("[data-body-link=FridgeDoor]").first.click()
    wait_until(lambda: visitor.selected == "FridgeDoor" and visitor.shows_text("FridgeHinge"), "a link leads on")


def test_the_outline_is_walked_by_keyboard(viewport: Viewer, visit: Visiting) -> None:
    visitor = visit(viewport)
    wait_until(lambda: len(visitor.tree_rows()) == 4, "the tree is there")
    visitor.page.locator("[data-role=find-body]").press("ArrowDown")
    wait_until(lambda: visitor.selected == "Cupboard", "the first row")
    keys = {"ArrowRight": "Cupboard", "ArrowDown": "Drawer", "End": "Mug", "Home": "Cupboard"}
    for key, expected in keys.items():
        visitor.page.keyboard.press(key)
        wait_until(lambda expected=expected: visitor.selected == expected, f"{key} leads to {expected}")
    assert "Drawer" in visitor.tree_rows()
    visitor.page.keyboard.press("ArrowLeft")
    wait_until(lambda: "Drawer" not in visitor.tree_rows(), "it is shut again")


def test_five_thousand_bodies_are_a_few_rows(visit: Visiting) -> None:
    mug = kitchenette().body("Mug")
    mugs = tuple(
        replace(mug, id=BodyId(f"Mug{n}"), iri=Iri(f"{mug.iri}{n}"), pose=Pose((n % 70 * 0.2, n // 70 * 0.2, 0.1)))
        for n in range(5000)
    )
    with Simulation(KnowledgeBase(bundled_ontology=False), NullEngine(), shapes=False) as stage:
        stage.spawn(World(iri=Iri("http://x#many"), bodies=mugs))
        with Viewer(stage, port=0) as viewport:
            visitor = visit(viewport)
            state = "mindstage.outliner.state"
            wait_until(lambda: visitor.page.evaluate(f"{state}.bodies") == 5000, "all are known")
            assert visitor.page.evaluate(f"{state}.rendered") < 80
            visitor.select_in_tree("Mug4321")
            assert visitor.page.evaluate(f"{state}.rendered") == 1


def test_what_is_hidden_is_hidden_for_all(viewport: Viewer, visit: Visiting) -> None:
    visitor, other = visit(viewport), visit(viewport)
    wait_until(visitor.tree_rows, "the tree is there")
    visitor.page.locator(".tree-row[data-id=Fridge]").hover()
    visitor.page.locator(".tree-row[data-id=Fridge] [data-action=toggle-visibility]").click()
    hidden = {"Fridge", "FridgeDoor", "FridgeHandle"}
    wait_until(lambda: viewport.views.hidden == hidden, "the fridge is hidden with all that belongs to it")
    wait_until(
        lambda: other.page.locator(".tree-row.hidden-body[data-id=Fridge]").count() == 1, "the other one sees it"
    )


def test_values_are_typed_in_and_undone(stage: Simulation, viewport: Viewer, visit: Visiting) -> None:
    visitor = visit(viewport)
    page = visitor.page
    visitor.select_in_tree("Mug")
    page.locator("[data-field=mass]").fill("2.5")
    page.keyboard.press("Enter")
    wait_until(lambda: stage.snapshot().body("Mug").physics.mass_kg == 2.5, "the mug has another mass")
    wait_until(lambda: page.locator("[data-pose=x]").input_value() == "2", "where it is stands in the fields")
    page.locator("[data-pose=x]").fill("1.25")
    page.keyboard.press("Enter")
    wait_until(lambda: position(stage, "Mug")[0] == pytest.approx(1.25), "the mug is somewhere else")
    page.locator("[data-pose=yaw]").fill("90")
    page.keyboard.press("Enter")
    turned = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
    wait_until(lambda: stage.snapshot().body("Mug").pose.quaternion == pytest.approx(turned), "and turned")
    page.locator("[data-field=mobility]").select_option("static")
    wait_until(lambda: stage.snapshot().body("Mug").physics.mobility.value == "static", "and static")
    page.locator("[data-field=mass]").fill("-1")
    page.keyboard.press("Enter")
    wait_until(lambda: visitor.shows_text("The mass must be greater than 0 kg."), "nonsense is refused in words")
    for _ in range(4):
        visitor.click_button("undo")
    wait_until(lambda: not stage.undo_stack.history.undo, "all is undone")
    assert stage.snapshot().body("Mug") == kitchenette().body("Mug")


def test_a_body_is_attached_by_choosing_its_holder(stage: Simulation, viewport: Viewer, visit: Visiting) -> None:
    visitor = visit(viewport)
    visitor.select_in_tree("Mug")
    visitor.click_button("attach")
    visitor.page.locator("[data-role=find-body]").fill("drawer")
    wait_until(lambda: "Drawer" in visitor.tree_rows(), "the drawer is found")
    visitor.page.locator(".tree-row[data-id=Drawer] .tree-name").click()
    wait_until(lambda: any(hold.child == "Mug" for hold in stage.snapshot().attachments), "the mug hangs on the drawer")
    wait_until(
        lambda: visitor.selected == "Mug" and visitor.details()["attached_to"] == "Drawer", "and the page says so"
    )
    visitor.click_button("detach")
    wait_until(lambda: all(hold.child != "Mug" for hold in stage.snapshot().attachments), "it is loose again")


def test_deleting_by_key_is_seen_by_the_other_visitor_and_undone_by_key(
    stage: Simulation, viewport: Viewer, visit: Visiting
) -> None:
    visitor, other = visit(viewport), visit(viewport)
    other.select_in_tree("Mug")
    visitor.select_in_tree("Mug")
    visitor.page.keyboard.press("Delete")
    wait_until(lambda: "Mug" not in stage.state.ids, "the mug is gone")
    wait_until(lambda: other.selected is None and other.shows_text("No body is selected"), "the other one sees it")
    other.page.locator("[data-role=tree]").press("Control+z")
    wait_until(lambda: "Mug" in stage.state.ids, "the other one brings it back")


def test_a_slider_opens_the_drawer_and_follows_it(alive: Simulation, visit: Visiting) -> None:
    alive.play()
    with Viewer(alive, port=0) as viewport:
        visitor = visit(viewport)
        visitor.select_in_tree("Drawer")
        slider = visitor.page.locator("[data-joint=DrawerSlide]")
        slider.fill("-0.3")
        wait_until(lambda: position(alive, "Drawer")[0] == pytest.approx(1.65, abs=0.02), "the drawer comes out")
        wait_until(lambda: visitor.shows_text("-0.30") or visitor.shows_text("-0.29"), "and the page says how far")
        alive.reset()
        wait_until(lambda: float(slider.input_value()) == pytest.approx(0.0, abs=0.02), "the slider follows")


# -- adding, saving, loading -------------------------------------------------------------------------------------------


def test_a_thing_is_added_from_the_list(alive: Simulation, visit: Visiting) -> None:
    with Viewer(alive, port=0) as viewport:
        visitor = visit(viewport)
        visitor.select_in_tree("Cupboard")
        visitor.open_panel("add")
        visitor.page.locator("[data-role=find-class]").fill("dinnerplate")
        visitor.page.locator("[data-class=DinnerPlate]").click()
        assert visitor.page.locator("[data-role=placement]").input_value() == "on"
        visitor.click_button("add")
        wait_until(lambda: len(alive.state.ids) == 9, "there is a plate")
        new = next(id for id in alive.state.ids if "DinnerPlate" in id)
        wait_until(lambda: visitor.selected == new, "the plate is selected")
        assert position(alive, new)[2] == pytest.approx(0.81, abs=0.03), "it lies on the cupboard"


def test_the_map_is_saved_and_loaded_by_file_and_by_drop(
    stage: Simulation, viewport: Viewer, visit: Visiting, tmp_path: Path
) -> None:
    visitor = visit(viewport)
    with visitor.page.expect_download() as download:
        visitor.page.locator("[data-action=save]").select_option("turtle semlog")
    saved = tmp_path / download.value.suggested_filename
    download.value.save_as(saved)
    assert saved.name == "map.ttl"
    stage.undo_stack.delete([BodyId("Mug"), BodyId("Fridge")])
    visitor.page.locator("[data-role=upload]").set_input_files(saved)
    wait_until(lambda: len(stage.state.ids) == 8, "all is back")
    wait_until(lambda: visitor.shows_text("map: 8 bodies, 2 joints"), "and the page says so")
    stage.undo_stack.delete([BodyId("Mug")])
    drop = """text => {
        const transfer = new DataTransfer();
        transfer.items.add(new File([text], "dropped.ttl"));
        const event = type => new DragEvent(type, {dataTransfer: transfer, bubbles: true, cancelable: true});
        window.dispatchEvent(event("dragenter"));
        document.getElementById("drop-target").dispatchEvent(event("drop"));
    }"""
    visitor.page.evaluate(drop, saved.read_text(encoding="utf-8"))
    wait_until(lambda: "Mug" in stage.state.ids, "a dropped map is loaded too")
    visitor.page.evaluate(drop, "this is no map")
    wait_until(lambda: visitor.shows_text("dropped.ttl"), "what is no map is said")
    assert len(stage.state.ids) == 8


# -- small screens -----------------------------------------------------------------------------------------------------


def test_on_a_phone_panels_are_sheets_over_the_view(viewport: Viewer, visit: Visiting) -> None:
    visitor = visit(viewport, size=(390, 844))
    page = visitor.page
    assert not page.locator("#left-sidebar").is_visible()
    page.locator("[data-sheet=outline]").click()
    assert page.locator("#left-sidebar").is_visible()
    page.locator(".tree-row[data-id=Mug] .tree-name").click()
    page.locator("[data-sheet=details]").click()
    assert not page.locator("#left-sidebar").is_visible()
    wait_until(
        lambda: visitor.shows_text("0.08 \N{MULTIPLICATION SIGN} 0.08 \N{MULTIPLICATION SIGN} 0.1 m"),
        "the mug is described",
    )
    page.locator("[data-sheet=details]").click()
    assert not page.locator("#right-sidebar").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


# -- the picture in the page -------------------------------------------------------------------------------------------


def test_what_is_clicked_in_the_picture_is_selected_in_this_page_only(
    stage: Simulation, viewport: Viewer, visit: Visiting
) -> None:
    visitor, other = visit(viewport, view=True), visit(viewport)
    visitor.click_until(ON_THE_HANDLE, lambda: visitor.selected == "DrawerHandle", "the handle is selected")
    row = visitor.page.locator(".tree-row[aria-selected=true]")
    wait_until(lambda: row.get_attribute("data-id") == "DrawerHandle", "the outline has opened there")
    wait_until(lambda: visitor.shows_text("kinematic"), "the details name it")
    assert other.selected is None
    visitor.select_in_tree("Fridge")
    (number,) = viewport.views.clients
    wait_until(lambda: viewport.views.selected(number) == "Fridge", "and the view follows the outline")
