"""The page by the rules of WCAG 2 A and AA (axe-core), and its size on a phone, in light and dark, at three sizes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from mindstage import Simulation
from mindstage.scene import BodyId
from mindstage.viewer import Viewer
from tests.conftest import ROOT
from tests.viewer.waiting import TIMEOUT_S, wait_until

AXE = ROOT / "build" / "node" / "node_modules" / "axe-core" / "axe.min.js"
SIZES = {"desktop": (1280, 800), "tablet": (1000, 700), "phone": (390, 844)}
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]
MIN_TARGET_PX = 40.0
TARGETS = "button, select, input:not([type=checkbox], [type=file]), textarea, summary, label:has(> [type=checkbox])"
PANELS = ("outline", "details", "add", "ask", "plan", "status", "robot")

Page = Any
OpenPage = Any


@pytest.fixture(scope="module")
def axe() -> str:
    if not AXE.exists():
        pytest.skip("axe-core is not installed: run scripts/install_node.sh")
    return AXE.read_text(encoding="utf-8")


@pytest.fixture
def open_page(panel_browser: Any) -> Iterator[OpenPage]:
    contexts = []

    def open_page(viewer: Viewer, size: str) -> Page:
        width, height = SIZES[size]
        context = panel_browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme="light",
            has_touch=size == "phone",
            is_mobile=size == "phone",
            reduced_motion="reduce",
            bypass_csp=True,  # for the script of axe
        )
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_S * 1000)
        page.route("**/view/**", lambda route: route.fulfill(body="<title>3D view</title>", content_type="text/html"))
        page.goto(viewer.url)
        wait_until(lambda: page.evaluate("document.body.dataset.connected === 'true'"), "the page is connected")
        wait_until(lambda: page.evaluate("mindstage.outliner.state.bodies") == 8, "the bodies are listed")
        return page

    yield open_page
    for context in contexts:
        context.close()


def violations(page: Page, *, rules: Sequence[str] = RULES) -> list[str]:
    """What axe finds, with the elements. Only that is sent from the page: all results are some megabytes."""
    found, applied = page.evaluate(
        """async (runOnly) => {
            const options = {runOnly, iframes: false, preload: false, resultTypes: ["violations"]};
            const {violations, passes, incomplete} = await axe.run(document, options);
            const lines = violations.flatMap(({id, nodes}) =>
                nodes.map(({target, failureSummary}) => `${id}: ${target[0]}: ${failureSummary}`));
            return [lines, passes.length + violations.length + incomplete.length];
        }""",
        list(rules),
    )
    assert applied > (10 if rules == RULES else 0), "the rules were applied"
    return list(found)


def small_targets(page: Page) -> list[str]:
    """Controls that are hard to hit with a finger; links within text are exempt."""
    return list(
        page.evaluate(
            """([targets, least]) => [...document.querySelectorAll(targets)]
            .filter((each) => each.checkVisibility({opacityProperty: true}) && !each.matches(".body-link"))
            .map((each) => [each, each.getBoundingClientRect()])
            .filter(([, box]) => box.width && (box.height < least - 0.5 || box.width < least - 0.5))
            .map(([each, box]) => `${each.outerHTML.slice(0, 120)}: ${box.width} x ${box.height}`)""",
            [TARGETS, MIN_TARGET_PX],
        )
    )


def states(page: Page, simulation: Simulation) -> Iterator[str]:
    """Brings the page into each of its states, and names it."""
    page.evaluate("mindstage.selection.select('FridgeDoor')")
    wait_until(lambda: page.evaluate("mindstage.detailsPanel.details?.id") == "FridgeDoor", "a body is selected")
    for panel in PANELS:
        page.evaluate("panel => mindstage.panels.show(panel)", panel)
        if panel == "add":
            page.locator("[data-class]").first.click()
        if panel == "ask":
            page.locator("[data-role=more-questions]").click()
            page.locator("[data-role=question]").select_option("where_is")
            page.locator("#panel-ask form [data-action=ask]").click()
            page.locator("#panel-ask td [data-action=explain]").first.click()
            page.locator(".explanation-row").wait_for()
            yield "answers"
            page.locator("[data-role=question]").select_option("storage_place")
            page.locator("#panel-ask form [data-action=ask]").click()
            page.locator("#panel-ask [data-answers], #panel-ask [data-role=error]").wait_for()
        yield panel
    for mode in ("sparql", "question"):
        page.evaluate("mindstage.panels.show('ask')")
        page.locator(f"[data-mode={mode}]").click()
        yield mode
    page.evaluate("mindstage.panels.closeSheets()")
    simulation.highlight([BodyId("Mug")], color="green", label="a mug")
    page.locator("#legend li").wait_for()
    page.evaluate("mindstage.channel.call('details', {id: 'nobody'}).catch(() => {})")
    page.evaluate("mindstage.tour.start()")
    yield "tour and highlighted bodies"
    page.locator("[data-action=tour-close]").click()
    for menu in ("help", "toolbar-more"):
        if page.locator(f"#{menu}").is_visible():
            page.locator(f"#{menu}").click()
            yield f"menu {menu}"
            page.keyboard.press("Escape")


@pytest.mark.parametrize(
    "size", [pytest.param(size, marks=pytest.mark.slow if size == "tablet" else []) for size in SIZES]
)
def test_no_state_of_the_page_violates_wcag(
    simulation: Simulation, viewer: Viewer, open_page: OpenPage, axe: str, size: str
) -> None:
    page = open_page(viewer, size)
    page.evaluate(axe)
    found: dict[str, list[str]] = {}
    for state in states(page, simulation):
        problems = violations(page)
        if size == "phone":
            problems += [f"small target: {each}" for each in small_targets(page)]
        sideways = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        if sideways > 0:
            problems.append(f"the page scrolls sideways by {sideways} px")
        problems += [f"dark: {each}" for each in violations_in_dark(page)]
        if problems:
            found[state] = problems
    viewer.close()
    page.locator("#disconnected").wait_for()
    assert not violations(page)
    assert not violations_in_dark(page)
    assert not found, "\n".join(f"{state}: {each}" for state, each_state in found.items() for each in each_state)


def violations_in_dark(page: Page) -> list[str]:
    """What axe finds in the dark theme, which differs from the light one only in its colors."""
    background = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(background)
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(background) != light
    found = violations(page, rules=["color-contrast"])
    page.emulate_media(color_scheme="light")
    return found


def test_axe_notices_a_button_without_a_name(viewer: Viewer, open_page: OpenPage, axe: str) -> None:
    page = open_page(viewer, "desktop")
    page.evaluate(axe)
    page.evaluate("document.getElementById('toolbar').append(document.createElement('button'))")
    assert [each.partition(":")[0] for each in violations(page)] == ["button-name"]


def test_the_controls_are_reached_by_tab_in_reading_order_with_a_visible_focus(
    viewer: Viewer, open_page: OpenPage
) -> None:
    page = open_page(viewer, "desktop")
    seen: list[str] = []
    for _ in range(40):
        page.keyboard.press("Tab")
        where, outline = page.evaluate(
            """() => [document.activeElement.closest('#toolbar, #left-sidebar, #center, #right-sidebar')?.id ?? '',
            getComputedStyle(document.activeElement).outlineStyle]"""
        )
        if where and seen[-1:] != [where]:
            seen.append(where)
        assert where in {"", "center"} or outline != "none", "the focus is visible"
        if where == "right-sidebar":
            break
    assert seen == ["toolbar", "left-sidebar", "center", "right-sidebar"]


def test_the_sign_in_page_has_no_violations(simulation: Simulation, panel_browser: Any, axe: str) -> None:
    with Viewer(simulation, port=0, token="sesame") as viewer:
        context = panel_browser.new_context(bypass_csp=True, color_scheme="dark")
        page = context.new_page()
        page.goto(viewer.url)
        page.evaluate(axe)
        assert not violations(page)
        context.close()


def test_nothing_moves_if_the_user_wants_no_motion() -> None:
    folder = Path(str(ROOT), "src", "mindstage", "viewer", "web")
    for path in folder.glob("*.css"):
        text = path.read_text(encoding="utf-8")
        free = text.partition("prefers-reduced-motion")[0]
        assert "animation:" not in free, path.name
        assert "transition:" not in free, path.name
