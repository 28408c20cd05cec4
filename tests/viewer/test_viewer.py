"""The viewer without a browser: address, closing, updates, errors."""

from __future__ import annotations

import logging
import os
import re
import socket
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from msgspec.structs import replace

import mindstage.viewer
from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.errors import BodyNotFoundError, NumberRefusedError, ViewerUnavailableError
from mindstage.scene import BodyId, BodyPhysics, Pose
from mindstage.scene.edits import Delete, SetPhysics, SetPoses, Spawn
from mindstage.textures import TextureMap
from mindstage.viewer import Viewer
from mindstage.viewer.http import texture_path
from tests.kitchenette import kitchenette
from tests.viewer.fake_page import FakePage
from tests.viewer.page_client import RequestFailedError, connect_page_client
from tests.viewer.waiting import wait_until

MUG = BodyId("Mug")


def shown(viewer: Viewer, id: str) -> bool:
    """Whether a body is drawn, and clients can select it."""
    drawn = viewer._server.scene.get_handle_by_name(f"/bodies/{id}") is not None
    return drawn and id in viewer.views._appearances


def shown_plain(viewer: Viewer, id: str) -> viser.MeshHandle | None:
    """The plain variant of a body's node, if it is visible."""
    plain = viewer._server.scene.get_handle_by_name(f"/bodies/{id}/plain")
    return plain if plain is not None and plain.visible else None


@pytest.fixture
def port_taken() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        yield taken.getsockname()[1]


# -- address -----------------------------------------------------------------------------------------------------------


def test_the_page_is_served_at_its_url(viewer: Viewer) -> None:
    assert viewer.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(viewer.url, timeout=30) as page:
        text = page.read()
    assert b"<html" in text
    assert b"<title>Mindstage</title>" in text


def test_images_of_textures_are_served_and_unknown_ones_are_not_found(viewer: Viewer) -> None:
    path = texture_path("oak_board", TextureMap.COLOR)
    assert path is not None
    with urllib.request.urlopen(viewer.url.rstrip("/") + path, timeout=60) as image:
        assert (image.status, image.headers["Content-Type"]) == (200, "image/jpeg")
        assert image.read(2) == b"\xff\xd8"
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(viewer.url.rstrip("/") + path.replace("oak", "gold"), timeout=60)


def test_a_port_that_was_given_and_is_taken_is_an_error_that_names_its_user(
    simulation: Simulation, port_taken: int
) -> None:
    with pytest.raises(ViewerUnavailableError) as raised:
        Viewer(simulation, port=port_taken)
    assert f"port {port_taken}: Address already in use" in str(raised.value)
    if sys.platform == "linux":
        assert f"by process {os.getpid()}, " in str(raised.value)


def test_the_default_port_may_be_the_next_free_one_and_that_is_said(
    simulation: Simulation, viewer: Viewer, caplog: pytest.LogCaptureFixture
) -> None:
    with Viewer(simulation) as first, Viewer(simulation) as second:
        ports = [int(each.url.rsplit(":", 1)[1]) for each in (first, second)]
    assert 8080 <= ports[0] < ports[1] < 8280
    assert f"port 8080 is in use (by process {os.getpid()}" in caplog.text or ports[0] > 8080
    assert f"the page is served at port {ports[1]}" in caplog.text


@pytest.mark.parametrize(
    ("host", "port"), [("203.0.113.7", 8080), ("no.such.host.invalid", 8080), ("127.0.0.1", 70000)]
)
def test_an_address_of_another_machine_is_refused(simulation: Simulation, host: str, port: int) -> None:
    with pytest.raises((ViewerUnavailableError, NumberRefusedError), match=r"cannot be served|port 70000: it must be"):
        Viewer(simulation, host=host, port=port, token="swordfish")


def test_nothing_is_printed(simulation: Simulation, capfd: pytest.CaptureFixture[str]) -> None:
    with Viewer(simulation, port=0):
        pass
    assert capfd.readouterr() == ("", "")


def test_viser_share_urls_are_disabled(viewer: Viewer) -> None:
    assert viewer._server.request_share_url() is None


# -- closing -----------------------------------------------------------------------------------------------------------


def test_closing_twice_is_harmless_and_the_simulation_stays_open(simulation: Simulation) -> None:
    viewer = Viewer(simulation, port=0)
    viewer.close()
    viewer.close()
    assert not viewer._thread.is_alive()
    assert simulation.snapshot().bodies


def test_closing_ends_all_drags(simulation: Simulation) -> None:
    with Viewer(simulation, port=0) as viewer:
        wait_until(lambda: viewer._drag_controller.draggable, "draggable bodies are known")
        viewer._drag_controller.start("ann", MUG, (2.0, 0.0, 0.85))
    assert viewer._drag_controller.drag_forces == ()
    assert simulation._perturbations == {}


# -- updates -----------------------------------------------------------------------------------------------------------


def test_a_world_spawned_later_is_shown() -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation, Viewer(simulation, port=0) as viewer:
        wait_until(lambda: viewer._snapshot is not None, "the viewer has read the empty simulation")
        assert not shown(viewer, "Mug")
        simulation.spawn(kitchenette())
        wait_until(lambda: shown(viewer, "Mug"), "the mug is shown")


def test_added_and_removed_bodies_are_shown_on_the_page(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the mug is shown")
    simulation.engine.run(lambda engine: engine.apply(Delete((MUG,))), edits=True)
    wait_until(lambda: not shown(viewer, "Mug"), "the mug is gone")
    other = replace(kitchenette().body("Mug"), id=BodyId("Other"))
    simulation.engine.run(
        lambda engine: engine.apply(Spawn(replace(kitchenette(), bodies=(other,), joints=(), attachments=()))).report
    )
    wait_until(lambda: shown(viewer, "Other"), "an unannounced edit is shown, too")


def test_moving_bodies_move_on_the_page(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the mug is shown")
    pose = replace(kitchenette().body("Mug").pose, position=(1.0, 2.0, 3.0))
    simulation.engine.run(lambda engine: engine.apply(SetPoses({MUG: pose})))
    nodes = viewer._scene._bodies
    assert nodes._blocks is not None
    rows = nodes._blocks._rows
    wait_until(lambda: np.allclose(rows[nodes._rows[MUG], :3], (1.0, 2.0, 3.0)), "the mug has moved")


def test_a_highlight_is_shown_and_cleared(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the mug is shown")
    assert shown_plain(viewer, "Mug") is None
    simulation.highlight([MUG], (1.0, 0.0, 0.0))
    wait_until(lambda: shown_plain(viewer, "Mug"), "the mug is in one color")
    assert shown_plain(viewer, "Mug").color == (255, 0, 0)
    simulation.highlight([MUG], None)
    wait_until(lambda: shown_plain(viewer, "Mug") is None, "the mug is textured again")


def test_bodies_are_drawn_with_the_geometry_of_the_simulation(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the kitchen is shown")
    appearance = viewer._scene.appearances[MUG]
    assert [visual.material for visual in appearance.visuals] == [
        visual.material for visual in simulation.geometry[MUG].visuals
    ]
    assert len(simulation.geometry[MUG].visuals) > 0


def test_bodies_that_become_dynamic_are_draggable(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: viewer._drag_controller.draggable, "draggable bodies are known")
    assert "Fridge" not in viewer._drag_controller.draggable
    dynamic = kitchenette().body("Mug").physics
    assert isinstance(dynamic, BodyPhysics)
    simulation.engine.run(lambda engine: engine.apply(SetPhysics(BodyId("Fridge"), dynamic)), edits=True)
    wait_until(lambda: "Fridge" in viewer._drag_controller.draggable, "the fridge is draggable")


def test_highlighting_redraws_no_bodies(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the kitchen is shown")
    cupboard = viewer._server.scene.get_handle_by_name("/bodies/Cupboard/textured")
    away = replace(kitchenette().body("Drawer").pose, position=(0.0, 3.0, 0.0))
    simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Drawer"): away})))
    simulation.highlight([MUG], (1.0, 0.0, 0.0))
    wait_until(lambda: shown_plain(viewer, "Mug"), "the page is updated")
    assert viewer._server.scene.get_handle_by_name("/bodies/Cupboard/textured") is cupboard


def test_an_idle_viewer_makes_no_calls_into_the_simulation(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the kitchen is shown")
    snapshot, due = simulation.state, viewer._text_due
    wait_until(lambda: viewer._text_due > due + 0.5, "the viewer keeps updating")
    assert simulation.state is snapshot, "each call into the simulation would have published a new snapshot"


# -- selection ---------------------------------------------------------------------------------------------------------


def test_unknown_bodies_cannot_be_selected(viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the kitchen is shown")
    with pytest.raises(BodyNotFoundError, match="Cupp"):
        viewer.select(BodyId("Cupp"))


def test_a_body_moved_with_the_gizmo_can_be_moved_back_by_undo(simulation: Simulation, viewer: Viewer) -> None:
    viewer._place_body(0, MUG, Pose((1.0, 0.0, 0.85)), to_surface=False)
    assert simulation.snapshot().body("Mug").pose.position == (1.0, 0.0, 0.85)
    simulation.edits.undo()
    assert simulation.snapshot().body("Mug").pose == kitchenette().body("Mug").pose


# -- errors ------------------------------------------------------------------------------------------------------------


def test_a_failed_update_is_shown_logged_once_and_retried(
    simulation: Simulation, viewer: Viewer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the kitchen is shown")
    calls: list[int] = []

    def fail() -> None:
        calls.append(1)
        raise RuntimeError("no snapshot today")

    with caplog.at_level(logging.ERROR), connect_page_client(viewer.url) as client:
        with monkeypatch.context() as broken:
            broken.setattr(simulation, "snapshot", fail)
            simulation.engine.run(lambda engine: None, edits=True)
            wait_until(
                lambda: "no snapshot today" in (client.latest_value("viewer_error") or ""),
                "the error is shown",
            )
            wait_until(lambda: len(calls) >= 2, "the update is retried")
        wait_until(lambda: client.latest_value("viewer_error") == "", "the error is cleared")
    records = [record for record in caplog.records if "no snapshot today" in record.getMessage()]
    assert len(records) == 1
    assert records[0].exc_info is not None


def test_an_exception_in_a_mouse_callback_is_shown_and_logged_once(
    viewer: Viewer, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    toasts: list[tuple[int, str]] = []
    monkeypatch.setattr(viewer._handlers, "toast", lambda view, text: toasts.append((view, text)))

    def fail(event: object) -> None:
        raise KeyError("Cupp")

    with caplog.at_level(logging.ERROR):
        for _ in range(2):
            viewer._with_toast(fail)(SimpleNamespace(client=SimpleNamespace(client_id=7)))
    assert toasts == [(7, "KeyError: 'Cupp'")] * 2
    assert len(caplog.records) == 1


def test_the_page_stays_open_after_the_simulation_is_closed(simulation: Simulation, viewer: Viewer) -> None:
    wait_until(lambda: shown(viewer, "Mug"), "the kitchen is shown")
    simulation.close()
    viewer.select(MUG)
    wait_until(lambda: viewer.views._defaults, "requests are still accepted")
    assert viewer._thread.is_alive()
    assert shown(viewer, "Mug")


def test_the_scripts_of_the_page_call_every_method_and_no_others(viewer: Viewer) -> None:
    methods = {each.name for each in viewer.channel.entry_points()}
    folder = Path(mindstage.viewer.__file__).parent
    scripts = "\n".join(path.read_text(encoding="utf-8") for path in folder.rglob("*.js"))
    words = set(re.findall(r"""["'`]([a-z_.]+)["'`]""", scripts))
    assert methods <= words | {f"robots.{each}" for each in words}
    assert set(re.findall(r'channel\.call\("([a-z_.]+)"', scripts)) <= methods


def test_every_method_of_the_page_is_admitted_and_answered(viewer: Viewer) -> None:
    methods = [each.name for each in viewer.channel.entry_points()]
    assert {"select", "undo", "standard_view", "ask"} <= set(methods)
    with connect_page_client(viewer.url) as page:
        for name in methods:
            with pytest.raises(RequestFailedError, match=r"^InvalidRequestError: .*no_such_field"):
                page.ask(name, no_such_field=1)


def test_a_duplicate_is_named_in_the_history(simulation: Simulation, viewer: Viewer) -> None:
    (copy,) = FakePage(viewer.channel).ask("duplicate", ids=["Mug"])
    assert simulation.edits.history.undo[0] == f"{copy} duplicated"
    simulation.edits.undo()
    assert copy not in simulation.state.ids
