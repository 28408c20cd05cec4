"""Markup in names, labels and messages is shown as text in a real browser; nothing of it becomes an element or runs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, NullEngine, Simulation
from mindstage.episodes import EpisodeEvent, EpisodeEventKind, EpisodeFrame, FrameRecording
from mindstage.episodes.replay import EpisodeReplay
from mindstage.maps import MapFormat, write_map
from mindstage.robots import add_robot
from mindstage.scene import BodyId, Iri, Literal, Pose, PropertyAssertion, Tag, World
from mindstage.simulation import ConnectedClient
from mindstage.viewer import Viewer
from mindstage.viewer.html_export import write_html
from tests.kitchenette import KNOWROB, MAP, kitchenette
from tests.viewer.fake_page import FakePage
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

RUN = "top.hacked=(top.hacked||0)+1"
ELEMENTS = "img[src=x], svg[onload], b.planted, iframe[srcdoc]"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
OpenPage = Callable[..., PageTab]


def markup(word: str) -> str:
    """A text with a word, and all of the markup that a browser would execute or draw."""
    return (
        f"{word} </script></title></textarea><script>{RUN}</script><img src=x onerror={RUN}><svg onload={RUN}>"
        f"<b class=planted>&lt;'\"`${{{RUN}}}{{{{{RUN}}}}}"
    )


def assert_harmless(page: Any) -> None:
    """Asserts that in none of the frames of a page anything was executed, or became an element."""
    for frame in page.frames:
        assert frame.evaluate("top.hacked") is None
        assert frame.locator(ELEMENTS).count() == 0
        assert frame.evaluate("[...document.scripts].filter(each => each.text.startsWith('top.hacked')).length") == 0


def assert_shown(page: Any, *words: str) -> None:
    """Asserts that the markup after each of some words is visible as text."""
    for word in words:
        text = markup(word)
        script = "text => document.body.innerText.includes(text) || [...document.querySelectorAll('input, textarea')]"
        shows = partial(page.evaluate, f"{script}.some(each => each.value.includes(text))", text)
        wait_until(shows, f"the markup of {word} is shown")
    assert_harmless(page)


ID = BodyId(markup("thing"))
ENCODED = "Jug%3Cimg%20src%3Dx%20onerror%3Dtop.hacked%3D1%3E%3C%2Fscript%3E"
"""The local name of an IRI, in which such characters are encoded."""


def hostile_map(path: Path) -> Path:
    """A map with markup in the name of a body, its label, comment, texts, tags and class."""
    kitchen = kitchenette()
    facts = (
        PropertyAssertion(Iri(f"{RDFS}comment"), Literal(markup("comment"))),
        PropertyAssertion(Iri(f"{MAP}says"), Literal(markup("text"))),
    )
    tags = (Tag(type=markup("type"), key=markup("key"), value=markup("value")),)
    mug = replace(
        kitchen.body("Mug"),
        id=BodyId(ENCODED), iri=Iri(MAP + ENCODED), label=markup("label"), tags=tags, facts=facts,
        cls=Iri(f"{MAP}Vessel"),
    )  # fmt: skip
    others = tuple(each for each in kitchen.bodies if each.id != "Mug")
    text = write_map(replace(kitchen, bodies=(*others, mug)), format=MapFormat.TURTLE)
    for property, word in (("label", "class"), ("comment", "meaning")):
        text += f"<{MAP}Vessel> <{RDFS}{property}> {json.dumps(markup(word))} .\n"
    text += f"<{MAP}Drawer> <{KNOWROB}depthOfObject> {json.dumps(markup('number'))} .\n"  # a finding
    text += f"<{MAP}Vessel> <{RDFS}subClassOf> <{KNOWROB}Cup> .\n"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def simulation(tmp_path: Path) -> Iterator[Simulation]:
    """A place from such a map, with a body whose id and a title that a client has chosen."""
    knowledge = KnowledgeBase()
    knowledge.load(hostile_map(tmp_path / "file <img src=x onerror=top.hacked=1>.ttl"))
    with Simulation(knowledge, NullEngine(), primitive_shapes=True) as simulation:
        mug = replace(kitchenette().body("Mug"), id=ID, pose=Pose((2.0, 0.0, 2.0)))
        simulation.spawn(World(iri=Iri(f"{MAP}spawned"), name=markup("world"), bodies=(mug,)))
        simulation.spawn()
        yield simulation


@pytest.fixture
def tab(viewer: Viewer, open_page: OpenPage) -> PageTab:
    return open_page(viewer, view=False)


def select(tab: PageTab, id: str) -> None:
    """Selects a body, and opens all parts of its details."""
    tab.page.evaluate("id => mindstage.selection.select(id)", id)
    wait_until(lambda: (tab.details() or {}).get("id") == id, "the body is described")
    tab.page.evaluate("document.querySelectorAll('#right-sidebar details').forEach(each => { each.open = true; })")


def test_a_world_and_its_bodies(tab: PageTab) -> None:
    assert_shown(tab.page, "world", "thing")  # the other body is in the first, and hidden until it is selected
    select(tab, ENCODED)
    assert_shown(tab.page, "label", "comment", "text", "type", "key", "value")
    assert ENCODED in tab.page.locator("[data-role=id]").inner_text()
    select(tab, ID)
    assert_shown(tab.page, "thing")
    assert tab.page.locator("[data-role=id]").inner_text() == ID


def test_answers_and_what_is_wrong_with_a_question(tab: PageTab) -> None:
    page = tab.page
    tab.open_panel("ask")
    tab.page.locator("[data-role=more-questions]").click()
    page.locator("[data-mode=sparql]").click()
    query = page.get_by_role("textbox", name="SPARQL query")
    query.fill("SELECT ?text ?thing WHERE { ?thing rdfs:label|rdfs:comment ?text FILTER(CONTAINS(?text, '<img')) }")
    query.press("Control+Enter")
    page.locator("#panel-ask td").first.wait_for()
    assert_shown(page, "class", "meaning", "comment")
    query.fill(f"SELECT <img src=x onerror={RUN}> WHERE {{}}")
    query.press("Control+Enter")
    page.locator("[data-role=error]").wait_for()
    assert_harmless(page)
    page.locator("[data-mode=question]").click()
    page.locator("[data-role=question]").select_option("storage_place")
    page.get_by_role("combobox", name="item").fill(markup("item"))
    page.keyboard.press("Enter")
    page.locator("[data-role=error]", has_text="<img src=x").wait_for()
    assert_harmless(page)


def test_highlights_the_history_and_messages(tab: PageTab, simulation: Simulation, viewer: Viewer) -> None:
    simulation.highlight([ID], "red", label=markup("reason"))
    assert_shown(tab.page, "reason")
    tab.page.evaluate("id => mindstage.selection.select(id)", ID)
    wait_until(lambda: (tab.details() or {}).get("id") == ID, "the body is described")
    tab.page.keyboard.press("Delete")
    wait_until(lambda: ID not in simulation.state.ids, "it is deleted")
    tab.open_panel("history")
    assert_shown(tab.page, "thing")
    viewer.channel.publish("toast", {"text": markup("toast"), "kind": "info"})
    viewer.channel.publish("error", {"message": markup("failure")})
    assert_shown(tab.page, "toast", "failure")


def test_clients_findings_and_faults(tab: PageTab, simulation: Simulation, viewer: Viewer) -> None:
    client = ConnectedClient(name=markup("client"), transport=markup("transport"), activity=markup("activity"))
    simulation.clients.add_client_source(lambda: [client])
    tab.open_panel("status")
    assert_shown(tab.page, "client", "transport", "activity")
    quoted = f"depthOfObject: {repr(markup('number'))[:120]}"  # a long value is cut
    report = tab.page.locator("[data-role=report-entries]")
    wait_until(lambda: quoted in report.inner_text(), "the finding is shown")
    now = FakePage(viewer.channel).latest_value("status")
    viewer.channel.publish("status", now | {"fault": markup("fault")})
    tab.page.locator("[data-toast=error]").wait_for()
    assert_shown(tab.page, "fault")


def test_an_uploaded_map_that_is_refused(tab: PageTab) -> None:
    name = "bad <img src=x onerror=top.hacked=1>.ttl"
    file = {"name": name, "mimeType": "text/turtle", "buffer": b"<a> <b> <img src=x onerror=top.hacked=1>"}
    tab.page.locator("input[type=file]").first.set_input_files(file)
    tab.page.locator("[data-toast=error]").first.wait_for()
    assert_harmless(tab.page)


def test_names_of_robots(open_page: OpenPage) -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        add_robot(simulation, "mobile_manipulator", Pose((0.0, -1.2, 0.0)), name=markup("robot"))
        with Viewer(simulation, port=0) as viewer:
            tab = open_page(viewer, view=False)
            tab.open_panel("robot")
            assert_shown(tab.page, "robot")


def hostile_recording() -> FrameRecording:
    """A short episode of a mug with markup in all names."""
    kitchen = kitchenette()
    bodies = tuple(replace(body, id=ID) if body.id == "Mug" else body for body in kitchen.bodies)
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True) as simulation:
        simulation.spawn(replace(kitchen, bodies=bodies))
        spawned, state = simulation.worlds, simulation.state
    event = EpisodeEvent(
        id=markup("event"), kind=EpisodeEventKind.GRASP, begin_s=0.1, end_s=0.9, thing=ID,
        agent=markup("agent"), evidence=(markup("evidence"),),
    )  # fmt: skip
    frames = [
        EpisodeFrame(time_s=time_s, structure=spawned[0], ids=state.ids, poses=state.poses) for time_s in (0.0, 1.0)
    ]
    return FrameRecording(frames, name=markup("episode"), spawned=spawned, events=(event,))


def test_an_episode_and_its_events(open_page: OpenPage) -> None:
    with EpisodeReplay(hostile_recording(), KnowledgeBase()) as replay, Viewer(replay, port=0) as viewer:
        tab = open_page(viewer, view=False)
        bar = tab.page.locator("[data-event]")
        bar.first.wait_for()
        bar.first.click()
        assert_shown(tab.page, "event", "agent", "evidence", "thing")
        assert markup("episode") in str(tab.page.locator("#timeline").get_attribute("aria-label"))


def test_an_episode_as_an_html_file(browser: Any, tmp_path: Path) -> None:
    write_html(hostile_recording(), tmp_path / "run.html")
    text = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert "<img src=x" not in text
    assert RUN not in text
    page = browser.new_page(viewport={"width": 320, "height": 240})
    try:
        page.goto((tmp_path / "run.html").as_uri())
        page.wait_for_selector("canvas", timeout=150_000)
        wait_until(lambda: page.locator("input").count() > 0, "it plays")
        assert_harmless(page)
    finally:
        page.close()
