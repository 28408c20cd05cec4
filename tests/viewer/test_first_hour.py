"""The tour in a real browser, as a new user does it: at three sizes, without a console error or warning."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.maps import bundled_kitchen
from mindstage.viewer import Viewer
from tests.viewer.waiting import TIMEOUT_S, wait_until

SIZES = {"desktop": (1280, 800), "tablet": (1000, 700), "phone": (390, 844)}
STEPS = ("Look around", "Open the fridge", "Ask where milk is kept", "Add a mug", "Save the map")

FREE_POINT = """(() => {
  const { x, y, width, height } = document.getElementById("view").getBoundingClientRect();
  for (let part = 0.9; part > 0; part -= 0.1) {
    const point = [x + width / 2, y + height * part];
    if (document.elementFromPoint(...point)?.id === "view") return point;
  }
  throw new Error("something covers the view");
})()"""
"""The lowest point in the middle of the view that nothing covers [px]."""

Page = Any


@pytest.fixture(scope="module")
def knowledge() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        yield knowledge


@pytest.fixture
def kitchen(knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, MujocoEngine()) as simulation:
        simulation.spawn()
        simulation.play()
        yield simulation


def open_demo(browser: Any, viewer: Viewer, size: str) -> tuple[Page, list[str]]:
    """The page of a new user, and the list to which its console's errors and warnings are added."""
    width, height = SIZES[size]
    phone = size == "phone"
    context = browser.new_context(
        viewport={"width": width, "height": height}, has_touch=phone, is_mobile=phone, accept_downloads=True
    )
    page, complaints = context.new_page(), []
    page.set_default_timeout(TIMEOUT_S * 1000)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on(
        "console",
        lambda line: line.type in {"error", "warning"} and complaints.append(f"{line.type}: {line.text}"),
    )
    page.goto(f"{viewer.url}/?fixedDpr=0.25")  # few pixels, for speed
    wait_until(lambda: page.evaluate("document.body.dataset.connected === 'true'"), "the page is connected")
    return page, complaints


def title(page: Page) -> str | None:
    return page.evaluate("mindstage.tour.state.title")  # type: ignore[no-any-return]


def show_me(page: Page) -> None:
    page.locator("[data-action=tour-show]").click()


def look(page: Page, viewer: Viewer) -> None:
    wait_until(lambda: any(client.camera.update_timestamp for client in views(viewer)), "the view is connected")
    page.mouse.move(*page.evaluate(FREE_POINT))

    def zoomed() -> bool:
        page.mouse.wheel(0, -240)
        page.wait_for_timeout(700)
        return title(page) != STEPS[0]

    wait_until(zoomed, "the camera has moved, and the page has noticed")


def views(viewer: Viewer) -> list[Any]:
    return list(viewer._server.get_clients().values())


def open_the_fridge(page: Page, kitchen: Simulation) -> None:
    show_me(page)
    slider = page.locator("#panel-details [data-section=joints] input[type=range]").first
    slider.focus()
    low, high = (float(slider.get_attribute(name)) for name in ("min", "max"))
    slider.press("Home" if abs(low) > abs(high) else "End")
    wait_until(lambda: kitchen.joint("fridge_door").openness > 0.15, "the door is open in the simulation")


def ask_where_milk_is_kept(page: Page) -> None:
    show_me(page)
    page.locator("[data-action=ask-sentence]").click()
    page.locator("#panel-ask tr[data-id=fridge]").wait_for()


def add_a_mug(page: Page, kitchen: Simulation) -> None:
    before = len(kitchen.state.ids)
    page.evaluate("mindstage.selection.select('table')")
    show_me(page)
    page.locator("[data-class=CoffeeMug]").first.click()
    page.locator("#panel-add [data-action=add]").click()
    wait_until(lambda: len(kitchen.state.ids) == before + 1, "the mug is in the simulation")


def save_the_map(page: Page, folder: Path) -> Path:
    show_me(page)
    with page.expect_download() as download:
        page.locator("[data-action=save]").select_option("ttl semlog")
    download.value.save_as(folder / "kitchen.ttl")
    return folder / "kitchen.ttl"


@pytest.mark.parametrize(
    "size", [pytest.param(size, marks=[] if size == "phone" else pytest.mark.slow) for size in SIZES]
)
def test_a_new_user_is_led_through_the_tour(kitchen: Simulation, browser: Any, tmp_path: Path, size: str) -> None:
    with Viewer(kitchen, port=0) as viewer:
        viewer.offer_tour()
        page, complaints = open_demo(browser, viewer, size)
        wait_until(lambda: title(page) == STEPS[0], "the tour starts by itself")
        look(page, viewer)
        wait_until(lambda: title(page) == STEPS[1], "the second step is shown")
        open_the_fridge(page, kitchen)
        wait_until(lambda: title(page) == STEPS[2], "the third step is shown")
        ask_where_milk_is_kept(page)
        wait_until(lambda: title(page) == STEPS[3], "the fourth step is shown")
        add_a_mug(page, kitchen)
        wait_until(lambda: title(page) == STEPS[4], "the last step is shown")
        saved = save_the_map(page, tmp_path)
        wait_until(lambda: page.locator("[data-action=tour-end]").is_visible(), "the tour is finished")
        page.locator("[data-action=tour-end]").click()
        assert not page.locator("#tour").is_visible()
        page.context.close()
    assert "CoffeeMug_1" in saved.read_text(encoding="utf-8")
    assert complaints == []


@pytest.fixture
def blind_page(viewer: Viewer, panel_browser: Any) -> Iterator[Page]:
    """A page without the 3D view, for speed; tests may advance its clock."""
    viewer.offer_tour()
    page = panel_browser.new_page()
    page.clock.install()
    page.set_default_timeout(TIMEOUT_S * 1000)
    page.route("**/view/**", lambda route: route.fulfill(body="", content_type="text/html"))
    page.goto(viewer.url)
    wait_until(lambda: title(page) == STEPS[0], "the tour starts by itself")
    yield page
    page.close()


def test_a_tour_that_was_skipped_is_not_offered_again_but_started_from_the_menu(blind_page: Page) -> None:
    page = blind_page
    page.locator("[data-action=tour-close]").click()
    page.reload()
    wait_until(lambda: page.evaluate("mindstage.outliner.state.bodies") == 8, "the page is loaded")
    assert not page.locator("#tour").is_visible()
    page.locator("#help").click()
    page.locator("[data-action=start-tour]").click()
    wait_until(lambda: title(page) == STEPS[0], "the tour starts again")
    assert page.evaluate("document.activeElement.id") == "tour-title", "the focus is in the tour"
    page.keyboard.press("Escape")
    assert not page.locator("#tour").is_visible()
    assert page.evaluate("document.activeElement.id") == "help", "the focus is back at the menu"


def test_each_step_of_the_tour_can_be_skipped(blind_page: Page) -> None:
    seen = []
    while blind_page.locator("[data-action=tour-skip]").is_visible():
        seen.append(title(blind_page))
        blind_page.locator("[data-action=tour-skip]").click()
    assert tuple(seen) == STEPS
    assert blind_page.evaluate("mindstage.tour.state.stored") == "done"


def test_a_step_is_not_done_by_something_else(blind_page: Page) -> None:
    for _ in range(2):
        blind_page.locator("[data-action=tour-skip]").click()
    blind_page.evaluate("mindstage.channel.call('ask', {question: 'where_is', args: {thing: 'Mug'}})")
    blind_page.clock.run_for(2500)
    assert title(blind_page) == STEPS[2], "another question does not finish the step"
