"""The page's life: its address, its thread, what it does when something goes wrong. No browser is needed."""

from __future__ import annotations

import logging
import socket
import urllib.request
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from msgspec.structs import replace

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.errors import BodyNotFoundError, ViewerUnavailableError
from mindstage.scene import BodyId, BodyPhysics, Pose
from mindstage.viewer import Viewer
from tests.kitchenette import kitchenette
from tests.viewer.guest import connect_page_client
from tests.viewer.waiting import wait_until

MUG = BodyId("Mug")


def shown(viewport: Viewer, id: str) -> bool:
    """Whether a body is drawn, and visitors can ask for it."""
    drawn = viewport._server.scene.get_handle_by_name(f"/bodies/{id}") is not None
    return drawn and id in viewport.views._appearances


def shown_plain(viewport: Viewer, id: str) -> viser.MeshHandle | None:
    """A body's guise in one color, where that is shown."""
    plain = viewport._server.scene.get_handle_by_name(f"/bodies/{id}/plain")
    return plain if plain is not None and plain.visible else None


@pytest.fixture
def port_taken() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        yield taken.getsockname()[1]


# -- its address -------------------------------------------------------------------------------------------------------


def test_the_page_is_served_where_its_url_says(viewport: Viewer) -> None:
    assert viewport.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(viewport.url, timeout=30) as page:
        assert b"<html" in page.read()


def test_a_port_that_is_taken_gives_way_to_the_next(stage: Simulation, port_taken: int) -> None:
    with Viewer(stage, port=port_taken) as viewport:
        port = int(viewport.url.rsplit(":", 1)[1])
        assert port_taken < port < port_taken + 200


def test_two_pages_on_one_stage_have_two_addresses(stage: Simulation, viewport: Viewer) -> None:
    with Viewer(stage, port=int(viewport.url.rsplit(":", 1)[1])) as other:
        assert other.url != viewport.url


@pytest.mark.parametrize(
    ("host", "port"), [("203.0.113.7", 8080), ("no.such.host.invalid", 8080), ("127.0.0.1", 70000)]
)
def test_an_address_that_is_not_ours_is_refused_at_once(stage: Simulation, host: str, port: int) -> None:
    with pytest.raises(ViewerUnavailableError, match="cannot be served"):
        Viewer(stage, host=host, port=port, token="swordfish")


def test_nothing_is_printed(stage: Simulation, capfd: pytest.CaptureFixture[str]) -> None:
    with Viewer(stage, port=0):
        pass
    assert capfd.readouterr() == ("", "")


def test_nobody_can_have_the_page_shared_with_the_world(viewport: Viewer) -> None:
    assert viewport._server.request_share_url() is None


# -- its end -----------------------------------------------------------------------------------------------------------


def test_closing_twice_is_harmless_and_the_stage_lives_on(stage: Simulation) -> None:
    viewport = Viewer(stage, port=0)
    viewport.close()
    viewport.close()
    assert not viewport._thread.is_alive()
    assert stage.snapshot().bodies


def test_a_closed_page_holds_nothing(stage: Simulation) -> None:
    with Viewer(stage, port=0) as viewport:
        wait_until(lambda: viewport._drag_controller.draggable, "the page knows what can be held")
        viewport._drag_controller.start("ann", MUG, (2.0, 0.0, 0.85))
    assert viewport._drag_controller.drag_forces == ()
    assert stage._perturbations == {}


# -- following the world -----------------------------------------------------------------------------------------------


def test_a_world_that_comes_later_is_shown() -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as stage, Viewer(stage, port=0) as viewport:
        wait_until(lambda: viewport._frame is not None, "the page follows the empty stage")
        assert not shown(viewport, "Mug")
        stage.spawn(kitchenette())
        wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")


def test_bodies_come_and_go_on_the_page(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")
    stage.run_on_engine(lambda engine: engine.delete([MUG]), edits=True)
    wait_until(lambda: not shown(viewport, "Mug"), "the mug is gone")
    other = replace(kitchenette().body("Mug"), id=BodyId("Other"))
    stage.run_on_engine(lambda engine: engine.spawn(replace(kitchenette(), bodies=(other,), joints=(), attachments=())))
    wait_until(lambda: shown(viewport, "Other"), "an edit that nobody announced is seen too")


def test_what_moves_moves_on_the_page(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")
    pose = replace(kitchenette().body("Mug").pose, position=(1.0, 2.0, 3.0))
    stage.run_on_engine(lambda engine: engine.set_pose(MUG, pose))
    mug = viewport._server.scene.get_handle_by_name("/bodies/Mug")
    wait_until(lambda: np.allclose(mug.position, (1.0, 2.0, 3.0)), "the mug has moved")


def test_a_highlight_is_seen_and_put_out(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")
    assert shown_plain(viewport, "Mug") is None
    stage.highlight([MUG], (1.0, 0.0, 0.0))
    wait_until(lambda: shown_plain(viewport, "Mug"), "the mug is in one colour")
    assert shown_plain(viewport, "Mug").color == (255, 0, 0)
    stage.highlight([MUG], None)
    wait_until(lambda: shown_plain(viewport, "Mug") is None, "the mug is as it was")


def test_bodies_are_drawn_with_the_forms_that_they_were_spawned_with(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    look = viewport._scene.appearances[MUG]
    assert [skin.material for skin in look.visuals] == [skin.material for skin in stage.geometry[MUG].visuals]
    assert len(stage.geometry[MUG].visuals) > 0


def test_what_becomes_movable_can_be_held(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: viewport._drag_controller.draggable, "the page knows what can be held")
    assert "Fridge" not in viewport._drag_controller.draggable
    dynamic = kitchenette().body("Mug").physics
    assert isinstance(dynamic, BodyPhysics)
    stage.run_on_engine(lambda engine: engine.set_physics(BodyId("Fridge"), dynamic), edits=True)
    wait_until(lambda: "Fridge" in viewport._drag_controller.draggable, "the fridge can be pulled")


def test_what_is_lit_is_not_drawn_anew(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    cupboard = viewport._server.scene.get_handle_by_name("/bodies/Cupboard/seen")
    away = replace(kitchenette().body("Drawer").pose, position=(0.0, 3.0, 0.0))
    stage.run_on_engine(lambda engine: engine.set_pose(BodyId("Drawer"), away))
    stage.highlight([MUG], (1.0, 0.0, 0.0))
    wait_until(lambda: shown_plain(viewport, "Mug"), "the page has looked again")
    assert viewport._server.scene.get_handle_by_name("/bodies/Cupboard/seen") is cupboard


def test_a_page_without_visitors_makes_no_calls_into_the_stage(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    frame, told = stage.state, viewport._text_due
    wait_until(lambda: viewport._text_due > told + 0.5, "the page goes on following")
    assert stage.state is frame, "each call into the stage would have published a new frame"


# -- selection ---------------------------------------------------------------------------------------------------------


def test_what_is_not_there_cannot_be_selected(viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    with pytest.raises(BodyNotFoundError, match="Cupp"):
        viewport.select(BodyId("Cupp"))


def test_what_a_visitor_puts_somewhere_is_put_there_and_can_be_undone(stage: Simulation, viewport: Viewer) -> None:
    viewport._place_body(0, MUG, Pose((1.0, 0.0, 0.85)))
    assert stage.snapshot().body("Mug").pose.position == (1.0, 0.0, 0.85)
    stage.undo_stack.undo()
    assert stage.snapshot().body("Mug").pose == kitchenette().body("Mug").pose


# -- trouble -----------------------------------------------------------------------------------------------------------


def test_a_fault_is_said_on_the_page_and_once_on_stderr_and_is_got_over(
    stage: Simulation, viewport: Viewer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    calls: list[int] = []

    def fail() -> None:
        calls.append(1)
        raise RuntimeError("the log is on fire")

    with caplog.at_level(logging.ERROR), connect_page_client(viewport.url) as guest:
        with monkeypatch.context() as broken:
            broken.setattr(stage, "log", fail)
            stage.run_on_engine(lambda engine: None, edits=True)
            wait_until(
                lambda: "the log is on fire" in (guest.latest_value("viewer_error") or ""),
                "the page says what is wrong",
            )
            wait_until(lambda: len(calls) >= 2, "the page tries again")
        wait_until(lambda: guest.latest_value("viewer_error") == "", "the page has got over it")
    told = [record for record in caplog.records if "the log is on fire" in record.getMessage()]
    assert len(told) == 1
    assert told[0].exc_info is not None


def test_a_defect_in_a_reaction_is_told_to_the_visitor_and_once_on_stderr(
    viewport: Viewer, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    toasts: list[tuple[int, str]] = []
    monkeypatch.setattr(viewport._handlers, "toast", lambda view, text: toasts.append((view, text)))

    def break_down(event: object) -> None:
        raise KeyError("Cupp")

    with caplog.at_level(logging.ERROR):
        for _ in range(2):
            viewport._with_toast(break_down)(SimpleNamespace(client=SimpleNamespace(client_id=7)))
    assert toasts == [(7, "KeyError: 'Cupp'")] * 2
    assert len(caplog.records) == 1


def test_a_stage_that_closes_first_leaves_the_page_open(stage: Simulation, viewport: Viewer) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    stage.close()
    viewport.select(MUG)
    wait_until(lambda: viewport.views._defaults, "it still listens")
    assert viewport._thread.is_alive()
    assert shown(viewport, "Mug")
