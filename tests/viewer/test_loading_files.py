"""Loading a file asks, tells all windows and can be undone; nothing of the old world stays."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.maps import write_map
from mindstage.scene import BodyId, World, diff
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.page_client import PageClient, RequestFailedError, connect_page_client
from tests.viewer.page_tab import PageTab
from tests.viewer.waiting import wait_until

OpenPage = Callable[..., PageTab]
EMPTY_MAP = """
@prefix : <http://example.org/room.owl#> . @prefix k: <http://knowrob.org/kb/knowrob.owl#> .
:room a k:SemanticEnvironmentMap .
"""


@pytest.fixture
def world() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        yield simulation


@pytest.fixture
def viewer(world: Simulation) -> Iterator[Viewer]:
    with Viewer(world, port=0) as viewer:
        yield viewer


@pytest.fixture
def other_map(tmp_path: Path) -> Path:
    """the mug alone, as a map."""
    whole = kitchenette()
    path = tmp_path / "other.owl"
    bodies = tuple(body for body in whole.bodies if body.id == "Mug")
    path.write_text(write_map(World(iri=whole.iri + "2", name="other room", bodies=bodies)), encoding="utf-8")
    return path


def test_a_file_without_bodies_is_refused(viewer: Viewer, world: Simulation) -> None:
    before = world.snapshot()
    with connect_page_client(viewer.url) as client:
        with pytest.raises(RequestFailedError, match="no bodies were found in it; is it a semantic map"):
            client.ask("load", name="empty.ttl", text=EMPTY_MAP)
        assert world.snapshot() == before
        assert world.edits.history.undo == ()


def test_edits_that_are_not_saved_are_kept_unless_they_are_discarded(
    viewer: Viewer, world: Simulation, other_map: Path
) -> None:
    text = other_map.read_text(encoding="utf-8")
    with connect_page_client(viewer.url) as client:
        client.ask("delete", ids=["Mug"])
        with pytest.raises(
            RequestFailedError, match="UnsavedEditsError: 1 edit is not saved, the last one: Mug deleted"
        ):
            client.ask("load", name="other.owl", text=text)
        assert "Mug" not in world.state.ids
        client.ask("save", format="glb")
        with pytest.raises(RequestFailedError, match="UnsavedEditsError"):
            client.ask("load", name="other.owl", text=text)
        client.ask("save")
        client.ask("load", name="other.owl", text=text)
        assert world.state.ids == ("Mug",)
        client.ask("load", name="other.owl", text=text)
        client.ask("undo")
        with pytest.raises(RequestFailedError, match="UnsavedEditsError"):
            client.ask("load", name="other.owl", text=text)


def toasts(client: PageClient) -> list[str]:
    client.receive()
    return [value["text"] for topic, value in client.events if topic == "toast"]


def test_every_other_window_is_told_who_did_what(viewer: Viewer, other_map: Path) -> None:
    with connect_page_client(viewer.url) as first, connect_page_client(viewer.url) as second:
        wait_until(lambda: second.latest_value("window") == "Window 2", "the second window has its name")
        second.ask("delete", ids=["Mug"])
        second.ask("load", name="other.owl", text=other_map.read_text(encoding="utf-8"), discard=True)
        second.ask("undo")
        second.ask("reset")
        told = [
            "Window 2 deleted Mug.",
            "Window 2 loaded other.owl; Undo brings back the world before.",
            "Window 2 undid: other room loaded.",
            "Window 2 restored the spawned state; Undo brings back the state before.",
        ]
        wait_until(lambda: toasts(first) == told, "the first window shows them")
        assert toasts(second) == []


def test_two_windows_and_a_load_lose_nothing(
    viewer: Viewer, world: Simulation, other_map: Path, open_page: OpenPage
) -> None:
    first, second = open_page(viewer, view=False), open_page(viewer, view=False)
    first.select_in_tree("Fridge")
    second.select_in_tree("Mug")
    second.page.keyboard.press("Escape")
    first.page.evaluate("mindstage.selection.select('Fridge')")
    world.edits.set_label(BodyId("Fridge"), "my fridge")
    edited = world.snapshot()

    second.page.locator("[data-role=upload]").set_input_files(other_map)
    dialog = second.page.get_by_role("dialog")
    dialog.get_by_text("1 edit is not saved, the last one: label of Fridge").wait_for()
    dialog.get_by_role("button", name="Cancel").click()
    assert world.snapshot() == edited, "nothing happens without an answer"

    second.page.locator("[data-role=upload]").set_input_files(other_map)
    with second.page.expect_download() as download:
        dialog.get_by_role("button", name="Save the map first").click()
    assert "my fridge" in Path(download.value.path()).read_text(encoding="utf-8")
    first.page.get_by_text("Window 2 loaded other.owl; Undo brings back the world before.").wait_for()
    for tab in (first, second):
        wait_until(lambda tab=tab: tab.tree_rows() == ["Mug"], "the tree shows the new world")
        assert tab.page.locator("[data-role=find-body]").input_value() == "", "the search was about the old world"
        assert tab.selected is None

    first.page.keyboard.press("Control+z")
    second.page.get_by_text("Window 1 undid: other room loaded.").wait_for()
    assert diff(edited, world.snapshot()).identical(0.0)
    for tab in (first, second):
        wait_until(lambda tab=tab: "Fridge" in tab.tree_rows(), "the tree shows the old world")
