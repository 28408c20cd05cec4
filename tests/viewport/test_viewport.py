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

from mindstage import KnowledgeBase, NullEngine, Stage
from mindstage.errors import BodyUnknown, ViewportUnavailable
from mindstage.viewport import Viewport
from mindstage.world import BodyId, Physics, Pose
from tests.kitchenette import kitchenette
from tests.viewport.guest import guest_at
from tests.viewport.waiting import wait_until

MUG = BodyId("Mug")


def shown(viewport: Viewport, id: str) -> bool:
    """Whether a body is drawn, and visitors can ask for it."""
    drawn = viewport._server.scene.get_handle_by_name(f"/bodies/{id}") is not None
    return drawn and id in viewport.sights._looks


def shown_plain(viewport: Viewport, id: str) -> viser.MeshHandle | None:
    """A body's guise in one colour, where that is shown."""
    plain = viewport._server.scene.get_handle_by_name(f"/bodies/{id}/plain")
    return plain if plain is not None and plain.visible else None


@pytest.fixture
def port_taken() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        yield taken.getsockname()[1]


# -- its address -------------------------------------------------------------------------------------------------------


def test_the_page_is_served_where_its_url_says(viewport: Viewport) -> None:
    assert viewport.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(viewport.url, timeout=30) as page:
        assert b"<html" in page.read()


def test_a_port_that_is_taken_gives_way_to_the_next(stage: Stage, port_taken: int) -> None:
    with Viewport(stage, port=port_taken) as viewport:
        port = int(viewport.url.rsplit(":", 1)[1])
        assert port_taken < port < port_taken + 200


def test_two_pages_on_one_stage_have_two_addresses(stage: Stage, viewport: Viewport) -> None:
    with Viewport(stage, port=int(viewport.url.rsplit(":", 1)[1])) as other:
        assert other.url != viewport.url


@pytest.mark.parametrize(
    ("host", "port"), [("203.0.113.7", 8080), ("no.such.host.invalid", 8080), ("127.0.0.1", 70000)]
)
def test_an_address_that_is_not_ours_is_refused_at_once(stage: Stage, host: str, port: int) -> None:
    with pytest.raises(ViewportUnavailable, match="cannot be served"):
        Viewport(stage, host=host, port=port, token="swordfish")


def test_nothing_is_printed(stage: Stage, capfd: pytest.CaptureFixture[str]) -> None:
    with Viewport(stage, port=0):
        pass
    assert capfd.readouterr() == ("", "")


def test_nobody_can_have_the_page_shared_with_the_world(viewport: Viewport) -> None:
    assert viewport._server.request_share_url() is None


# -- its end -----------------------------------------------------------------------------------------------------------


def test_closing_twice_is_harmless_and_the_stage_lives_on(stage: Stage) -> None:
    viewport = Viewport(stage, port=0)
    viewport.close()
    viewport.close()
    assert not viewport._thread.is_alive()
    assert stage.log().bodies


def test_a_closed_page_holds_nothing(stage: Stage) -> None:
    with Viewport(stage, port=0) as viewport:
        wait_until(lambda: viewport._hands.holdable, "the page knows what can be held")
        viewport._hands.take("ann", MUG, (2.0, 0.0, 0.85))
    assert viewport._hands.pulls == ()
    assert stage._grips == {}


# -- following the world -----------------------------------------------------------------------------------------------


def test_a_world_that_comes_later_is_shown() -> None:
    with Stage(KnowledgeBase(), NullEngine()) as stage, Viewport(stage, port=0) as viewport:
        wait_until(lambda: viewport._frame is not None, "the page follows the empty stage")
        assert not shown(viewport, "Mug")
        stage.spawn(kitchenette())
        wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")


def test_bodies_come_and_go_on_the_page(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")
    stage.call(lambda engine: engine.delete([MUG]), edits=True)
    wait_until(lambda: not shown(viewport, "Mug"), "the mug is gone")
    other = replace(kitchenette().body("Mug"), id=BodyId("Other"))
    stage.call(lambda engine: engine.spawn(replace(kitchenette(), bodies=(other,), constraints=(), attachments=())))
    wait_until(lambda: shown(viewport, "Other"), "an edit that nobody announced is seen too")


def test_what_moves_moves_on_the_page(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")
    pose = replace(kitchenette().body("Mug").pose, position=(1.0, 2.0, 3.0))
    stage.call(lambda engine: engine.set_pose(MUG, pose))
    mug = viewport._server.scene.get_handle_by_name("/bodies/Mug")
    wait_until(lambda: np.allclose(mug.position, (1.0, 2.0, 3.0)), "the mug has moved")


def test_a_highlight_is_seen_and_put_out(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the mug is shown")
    assert shown_plain(viewport, "Mug") is None
    stage.highlight([MUG], (1.0, 0.0, 0.0))
    wait_until(lambda: shown_plain(viewport, "Mug"), "the mug is in one colour")
    assert shown_plain(viewport, "Mug").color == (255, 0, 0)
    stage.highlight([MUG], None)
    wait_until(lambda: shown_plain(viewport, "Mug") is None, "the mug is as it was")


def test_bodies_are_drawn_with_the_forms_that_they_were_spawned_with(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    look = viewport._scene.looks[MUG]
    assert [skin.surface for skin in look.skins] == [skin.surface for skin in stage.forms[MUG].skins]
    assert len(stage.forms[MUG].skins) > 0


def test_what_becomes_movable_can_be_held(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: viewport._hands.holdable, "the page knows what can be held")
    assert "Fridge" not in viewport._hands.holdable
    dynamic = kitchenette().body("Mug").physics
    assert isinstance(dynamic, Physics)
    stage.call(lambda engine: engine.set_physics(BodyId("Fridge"), dynamic), edits=True)
    wait_until(lambda: "Fridge" in viewport._hands.holdable, "the fridge can be pulled")


def test_what_is_lit_is_not_drawn_anew(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    cupboard = viewport._server.scene.get_handle_by_name("/bodies/Cupboard/seen")
    away = replace(kitchenette().body("Drawer").pose, position=(0.0, 3.0, 0.0))
    stage.call(lambda engine: engine.set_pose(BodyId("Drawer"), away))
    stage.highlight([MUG], (1.0, 0.0, 0.0))
    wait_until(lambda: shown_plain(viewport, "Mug"), "the page has looked again")
    assert viewport._server.scene.get_handle_by_name("/bodies/Cupboard/seen") is cupboard


def test_a_page_without_visitors_makes_no_calls_into_the_stage(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    frame, told = stage.frame, viewport._words_due
    wait_until(lambda: viewport._words_due > told + 0.5, "the page goes on following")
    assert stage.frame is frame, "each call into the stage would have published a new frame"


# -- selection ---------------------------------------------------------------------------------------------------------


def test_what_is_not_there_cannot_be_selected(viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    with pytest.raises(BodyUnknown, match="Cupp"):
        viewport.select(BodyId("Cupp"))


def test_what_a_visitor_puts_somewhere_is_put_there_and_can_be_undone(stage: Stage, viewport: Viewport) -> None:
    viewport._put(0, MUG, Pose((1.0, 0.0, 0.85)))
    assert stage.log().body("Mug").pose.position == (1.0, 0.0, 0.85)
    stage.editing.undo()
    assert stage.log().body("Mug").pose == kitchenette().body("Mug").pose


# -- trouble -----------------------------------------------------------------------------------------------------------


def test_a_fault_is_said_on_the_page_and_once_on_stderr_and_is_got_over(
    stage: Stage, viewport: Viewport, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    calls: list[int] = []

    def fail() -> None:
        calls.append(1)
        raise RuntimeError("the log is on fire")

    with caplog.at_level(logging.ERROR), guest_at(viewport.url) as guest:
        with monkeypatch.context() as broken:
            broken.setattr(stage, "log", fail)
            stage.call(lambda engine: None, edits=True)
            wait_until(
                lambda: "the log is on fire" in (guest.sees("viewer_error") or ""), "the page says what is wrong"
            )
            wait_until(lambda: len(calls) >= 2, "the page tries again")
        wait_until(lambda: guest.sees("viewer_error") == "", "the page has got over it")
    told = [record for record in caplog.records if "the log is on fire" in record.getMessage()]
    assert len(told) == 1
    assert told[0].exc_info is not None


def test_a_defect_in_a_reaction_is_told_to_the_visitor_and_once_on_stderr(
    viewport: Viewport, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    toasts: list[tuple[int, str]] = []
    monkeypatch.setattr(viewport._desks, "toast", lambda view, text: toasts.append((view, text)))

    def break_down(event: object) -> None:
        raise KeyError("Cupp")

    with caplog.at_level(logging.ERROR):
        for _ in range(2):
            viewport._guarded(break_down)(SimpleNamespace(client=SimpleNamespace(client_id=7)))
    assert toasts == [(7, "KeyError: 'Cupp'")] * 2
    assert len(caplog.records) == 1


def test_a_stage_that_closes_first_leaves_the_page_open(stage: Stage, viewport: Viewport) -> None:
    wait_until(lambda: shown(viewport, "Mug"), "the kitchen is shown")
    stage.close()
    viewport.select(MUG)
    wait_until(lambda: viewport.sights._for_all, "it still listens")
    assert viewport._thread.is_alive()
    assert shown(viewport, "Mug")
