"""The Ask and Status panels in a real browser; the 3D view is left out for speed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.maps import bundled_kitchen
from mindstage.simulation import ConnectedClient
from mindstage.viewer import Viewer
from tests.knowledge.test_inverse_restrictions import lids_ontology
from tests.viewer.fake_page import FakePage
from tests.viewer.waiting import wait_until

PATIENCE_MS = 60_000


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, NullEngine(), primitive_shapes=True) as simulation:
        simulation.spawn()
        yield simulation


@pytest.fixture
def page(viewer: Viewer, panel_browser: Any) -> Iterator[Any]:
    page = panel_browser.new_page(viewport={"width": 1280, "height": 800})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.route("**/view/**", lambda route: route.fulfill(body="", content_type="text/html"))
    page.set_default_timeout(PATIENCE_MS)
    page.goto(viewer.url)
    yield page
    page.close()
    assert errors == []


def test_a_question_is_asked_by_keyboard_explained_and_highlighted(page: Any, simulation: Simulation) -> None:
    page.click("[data-tab=ask]")
    page.locator("[data-role=more-questions]").click()
    page.get_by_role("combobox", name="item").fill("cowsm")
    page.wait_for_selector("li[data-name=CowsMilk]")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    assert page.get_by_role("combobox", name="item").input_value() == "CowsMilk"
    page.keyboard.press("Enter")
    row = page.locator("#panel-ask tr[data-id=fridge]")
    row.wait_for()
    page.get_by_role("button", name="why").click()
    lines = page.locator("#panel-ask .explanation li")
    lines.first.wait_for()
    assert "CowsMilk" in " ".join(lines.all_inner_texts())
    page.get_by_role("button", name="Highlight", exact=True).click()
    page.wait_for_selector("#legend li[data-highlighted='1']")
    assert set(simulation.state.highlights) == {"fridge"}
    assert "item=CowsMilk" in page.locator("#legend").inner_text()
    page.locator("#legend button").first.click()
    wait_until(lambda: not simulation.state.highlights, "nothing is highlighted")
    page.locator("#legend").wait_for(state="hidden")


def test_a_restriction_on_an_inverse_is_shown_and_asked_for(page: Any, simulation: Simulation, tmp_path: Path) -> None:
    simulation.knowledge.load(lids_ontology(tmp_path))
    page.click("[data-tab=ask]")
    page.locator("[data-role=more-questions]").click()
    page.locator("[data-role=question]").select_option("class_properties")
    page.get_by_role("combobox", name="cls").fill("http://example.org/o#Lid")
    for wanted, values in (("", {"Crate", "Screw"}), ("true", {"Crate"}), ("false", {"Screw"})):
        page.get_by_label("inverse", exact=True).select_option(wanted)
        page.locator("[data-action=ask]").click()
        rows = page.locator("#panel-ask tbody tr")
        wait_until(lambda: rows.count() == len(values), f"the answers are {values}")  # noqa: B023
        shown = " ".join(rows.all_inner_texts())
        assert {each for each in ("Crate", "Screw") if each in shown} == values


def test_a_missing_fact_is_asserted_and_then_answers_the_question(page: Any, simulation: Simulation) -> None:
    page.click("[data-tab=ask]")
    page.locator("[data-role=more-questions]").click()
    page.locator("[data-role=question]").select_option("storage_place")
    page.get_by_role("combobox", name="item").fill("Door")
    page.locator("[data-action=ask]").click()
    fact = page.locator(".missing-fact")
    fact.wait_for()
    assert "Door has no storage place" in fact.inner_text()
    assert page.locator("[data-statement=value]").input_value() == "knowrob:Door"
    page.locator("[data-statement=subject]").fill("ToolBox")
    page.locator("[data-action=tell]").click()
    page.locator("#panel-ask td", has_text="ToolBox").wait_for()
    assert [row.place for row in simulation.ask("storage_place", item="Door")] == [
        "http://mindstage.org/ontology#ToolBox"
    ]


def test_a_query_and_an_invalid_one_are_answered_in_the_panel(page: Any, viewer: Viewer) -> None:
    page.click("[data-tab=ask]")
    page.locator("[data-role=more-questions]").click()
    page.locator("[data-mode=sparql]").click()
    text = page.get_by_role("textbox", name="SPARQL query")
    text.fill("SELECT ?x WHERE { ?x a ms:FridgeW60H140 }")
    text.press("Control+Enter")
    page.locator("#panel-ask tr[data-id=fridge]").wait_for()
    text.fill("DROP ALL")
    text.press("Control+Enter")
    page.locator("[data-role=error]", has_text="queries only read").wait_for()
    text.fill('SELECT ("<img src=x onerror=alert(1)>" AS ?x) {}')
    text.press("Control+Enter")
    page.locator("#panel-ask td", has_text="<img src=x").wait_for()
    assert page.locator("#panel-ask img").count() == 0


def test_the_status_is_shown_searched_and_a_failure_is_announced(
    page: Any, simulation: Simulation, viewer: Viewer
) -> None:
    simulation.clients.add_client_source(
        lambda: [ConnectedClient(name="/robot", transport="ROS", activity="2 topics messages")]
    )
    page.click("[data-tab=status]")
    page.locator("[data-statistic=engine]", has_text="null").wait_for()
    assert page.locator("[data-statistic=bodies]").inner_text().startswith(str(len(simulation.state.ids)))
    page.locator("[data-client='/robot']").wait_for()
    entries = page.locator("[data-entry]")
    entries.first.wait_for()
    before = entries.count()
    assert before >= 3
    page.get_by_role("searchbox", name="Search the report").fill("quaternion wxyz")
    wait_until(lambda: entries.count() == 1, "one entry matches")
    now = FakePage(viewer.channel).latest_value("status")
    viewer.channel.publish("status", now | {"fault": "the physics blew up"})
    page.locator("[data-toast=error]", has_text="The simulation has stopped: the physics blew up").wait_for()
