"""The Ask and Status panels in a real browser, by what a person does there; the 3D view is left out for speed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.knowledge import bundled_kitchen
from mindstage.simulation import ConnectedClient
from mindstage.viewer import Viewer
from tests.viewer.pretending import FakePage
from tests.viewer.waiting import wait_until

PATIENCE_MS = 60_000


@pytest.fixture
def stage() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, NullEngine(), shapes=False) as stage:
        stage.spawn()
        yield stage


@pytest.fixture
def page(viewport: Viewer, browser: Any) -> Iterator[Any]:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.route("**/view/**", lambda route: route.fulfill(body="", content_type="text/html"))
    page.set_default_timeout(PATIENCE_MS)
    page.goto(viewport.url)
    yield page
    page.close()
    assert errors == []


def test_a_question_is_asked_by_keyboard_explained_and_lit(page: Any, stage: Simulation) -> None:
    page.click("[data-tab=ask]")
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
    assert set(stage.state.highlights) == {"fridge"}
    assert "item=CowsMilk" in page.locator("#legend").inner_text()
    page.locator("#legend button").first.click()
    wait_until(lambda: not stage.state.highlights, "nothing is lit any more")
    page.locator("#legend").wait_for(state="hidden")


def test_what_is_missing_is_told_and_then_known(page: Any, stage: Simulation) -> None:
    page.click("[data-tab=ask]")
    page.locator("[data-role=question]").select_option("storage_place")
    page.get_by_role("combobox", name="item").fill("Door")
    page.locator("[data-action=ask]").click()
    lack = page.locator(".missing-fact")
    lack.wait_for()
    assert "Door has no container" in lack.inner_text()
    assert page.locator("[data-statement=value]").input_value() == "knowrob:Door"
    page.locator("[data-statement=subject]").fill("ToolBox")
    page.locator("[data-action=tell]").click()
    page.locator("#panel-ask td", has_text="ToolBox").wait_for()
    assert [row.place for row in stage.ask("storage_place", item="Door")] == ["http://mindstage.org/ontology#ToolBox"]


def test_a_query_and_a_wrong_one_are_answered_in_place(page: Any, viewport: Viewer) -> None:
    page.click("[data-tab=ask]")
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


def test_the_status_is_shown_searched_and_a_fault_is_said_aloud(page: Any, stage: Simulation, viewport: Viewer) -> None:
    stage.clients.add_client_source(
        lambda: [ConnectedClient(name="/robot", transport="ROS", activity="2 topics heard")]
    )
    page.click("[data-tab=status]")
    page.locator("[data-statistic=engine]", has_text="null").wait_for()
    assert page.locator("[data-statistic=bodies]").inner_text().startswith(str(len(stage.state.ids)))
    page.locator("[data-client='/robot']").wait_for()
    entries = page.locator("[data-entry]")
    entries.first.wait_for()
    before = entries.count()
    assert before >= 3
    page.get_by_role("searchbox", name="Search the report").fill("quaternion wxyz")
    wait_until(lambda: entries.count() == 1, "one remark is about that")
    now = FakePage(viewport.channel).latest_value("status")
    viewport.channel.publish("status", now | {"fault": "the physics blew up"})
    page.locator("[data-toast=error]", has_text="The simulation has stopped: the physics blew up").wait_for()
