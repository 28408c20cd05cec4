"""The 3D view in a real browser, operated by the mouse."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.rendering.camera import CameraPose
from mindstage.rendering.screenshot import LabelMode
from mindstage.scene import BodyId, Pose, Vector
from mindstage.scene.edits import Delete, SetPoses
from mindstage.viewer import Viewer
from mindstage.viewer.client_views import GizmoMode, Snapping
from mindstage.viewer.view_data import send_view_data
from tests.kitchenette import kitchenette
from tests.viewer.view_tab import ViewTab, open_views, position
from tests.viewer.waiting import wait_until

OpenView = Callable[[Viewer], ViewTab]

MUG = BodyId("Mug")
ON_THE_HANDLE = (1.66, 0.0, 0.65)
PULLED_OUT = (1.36, 0.0, 0.65)
BESIDE_THE_MUG = CameraPose((0.2, -1.6, 1.6), (2.0, 0.0, 0.9), 0.6)
ON_THE_FRIDGE = (1.66, 1.1, 1.5)


def beside(simulation: Simulation, id: str, point: Vector) -> Callable[[], Vector]:
    """A point that moves as the body does, by its current position [m]."""
    offset = np.array(point) - position(simulation, id)

    def now() -> Vector:
        x, y, z = position(simulation, id) + offset
        return float(x), float(y), float(z)

    return now


@pytest.fixture
def open_view(browser: Any) -> Iterator[OpenView]:
    with open_views(browser) as open_view:
        yield open_view


@pytest.fixture
def physics_simulation() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        simulation.play()
        yield simulation


def test_a_click_selects_a_body_for_this_client_only(viewer: Viewer, open_view: OpenView) -> None:
    ann, bob = open_view(viewer), open_view(viewer)
    complaints: list[str] = []
    ann.page.on("console", lambda line: line.type == "error" and complaints.append(line.text))
    ann.wait_for("/bodies/DrawerHandle/textured")
    ann.click_until(ON_THE_HANDLE, lambda: viewer.views.selected(ann.number) == "DrawerHandle", "it is selected")
    ann.wait_for("/selected")
    assert viewer.views.selected(bob.number) is None
    viewer.views.set_labels(LabelMode.SELECTED, client=ann.number)
    wait_until(lambda: ann.labels() == ["Handle"], "the label is shown")
    assert bob.labels() == []
    ann.click_until(ON_THE_HANDLE, lambda: viewer.views.selected(ann.number) is None, "nothing is selected")
    assert complaints == []


def test_clipped_bodies_are_neither_drawn_nor_clickable(viewer: Viewer, open_view: OpenView) -> None:
    ann = open_view(viewer)
    ann.wait_for("/bodies/FridgeDoor/textured")
    wait_until(lambda: np.array_equal(ann.pixels(), ann.pixels()), "the picture is stable")
    x, y = (round(part) for part in ann.to_window(ON_THE_FRIDGE))
    whole = ann.pixels()
    viewer.views.set_clip_height(1.0, client=ann.number)
    wait_until(lambda: not np.array_equal(whole[y, x], ann.pixels()[y, x]), "the upper part of the fridge is clipped")
    ann.click(ON_THE_FRIDGE)
    ann.click_until(
        ON_THE_HANDLE,
        lambda: viewer.views.selected(ann.number) == "DrawerHandle",
        "bodies below the plane are clickable",
    )
    viewer.views.set_clip_height(None, client=ann.number)
    wait_until(lambda: np.array_equal(whole[y, x], ann.pixels()[y, x]), "the fridge is shown again")
    ann.click_until(
        ON_THE_FRIDGE, lambda: viewer.views.selected(ann.number) == "FridgeDoor", "the fridge is clickable again"
    )


def test_a_drawer_is_pulled_and_a_mug_is_lifted_with_the_mouse(
    physics_simulation: Simulation, open_view: OpenView
) -> None:
    with Viewer(physics_simulation, port=0) as viewer:
        ann = open_view(viewer)
        ann.wait_for("/bodies/DrawerHandle/textured")
        ann.drag_until(
            beside(physics_simulation, "DrawerHandle", ON_THE_HANDLE),
            PULLED_OUT,
            lambda: position(physics_simulation, "Drawer")[0] < 1.75,
            "the drawer is open by 20 cm",
        )
        assert [pull.id for pull in viewer._drag_controller.drag_forces] == ["DrawerHandle"]
        ann.release()
        wait_until(lambda: not viewer._drag_controller.drag_forces, "the drag has ended")
        _, y, z = position(physics_simulation, "Drawer")
        assert (y, z) == pytest.approx((0.0, 0.65), abs=2e-3)
        ann.move_camera(BESIDE_THE_MUG)
        wait_until(lambda: np.array_equal(ann.pixels(), ann.pixels()), "the picture is stable")
        start = position(physics_simulation, "Mug")
        on_the_mug = (float(start[0]), float(start[1]), float(start[2]) + 0.01)
        in_the_air = (on_the_mug[0], on_the_mug[1], on_the_mug[2] + 0.35)
        ann.drag_until(
            beside(physics_simulation, "Mug", on_the_mug),
            in_the_air,
            lambda: position(physics_simulation, "Mug")[2] > start[2] + 0.2,
            "the mug is in the air",
        )
        ann.release()
        wait_until(lambda: position(physics_simulation, "Mug")[2] < start[2] + 0.1, "the mug has fallen")


def test_the_initial_camera_of_the_server_does_not_replace_one_that_was_set(
    viewer: Viewer, open_view: OpenView
) -> None:
    ann = open_view(viewer)
    viewer.views.set_camera(BESIDE_THE_MUG, client=ann.number)
    wait_until(lambda: np.allclose(ann.camera_position.position, BESIDE_THE_MUG.position, atol=1e-3), "it is set")
    initial = viewer._server.initial_camera
    camera = viewer._server.get_clients()[ann.number].camera
    camera.position, camera.look_at = initial.position, initial.look_at  # as a client does that applies it late
    wait_until(lambda: np.allclose(ann.camera_position.position, BESIDE_THE_MUG.position, atol=1e-3), "it is set again")


def test_a_disconnected_client_releases_its_body(physics_simulation: Simulation, open_view: OpenView) -> None:
    with Viewer(physics_simulation, port=0) as viewer:
        ann = open_view(viewer)
        ann.wait_for("/bodies/DrawerHandle/textured")
        ann.drag_until(
            beside(physics_simulation, "DrawerHandle", ON_THE_HANDLE),
            PULLED_OUT,
            lambda: viewer._drag_controller.drag_forces,
            "the handle is being dragged",
        )
        ann.page.close()
        wait_until(lambda: not viewer._drag_controller.drag_forces, "everything is released")
        time_s = physics_simulation.state.time_s
        wait_until(lambda: physics_simulation.state.time_s > time_s + 0.5, "the simulation goes on")


def test_a_member_of_a_batch_is_clicked_highlighted_moved_and_removed(
    simulation: Simulation, viewer: Viewer, open_view: OpenView
) -> None:
    mug = kitchenette().body("Mug")
    mugs = [
        replace(mug, id=BodyId(f"Mug{n}"), size=(0.2, 0.2, 0.25), pose=Pose((1.2, -1.0 + 0.5 * n, 1.4)))
        for n in range(9)
    ]
    simulation.spawn(replace(kitchenette(), bodies=tuple(mugs), joints=(), attachments=()))
    ann = open_view(viewer)
    ann.wait_for("/batches/1/textured")

    def clicked(point: tuple[float, float, float]) -> BodyId | None:
        viewer.views.select(None, client=ann.number)
        wait_until(lambda: viewer.views.selected(ann.number) is None, "nothing is selected")
        for _ in range(5):  # a slow browser may not be ready for the first click
            ann.click(point)
            with suppress(AssertionError):
                wait_until(lambda: viewer.views.selected(ann.number), "something is selected", timeout_s=8.0)
                break
        return viewer.views.selected(ann.number)

    assert clicked((1.12, 0.5, 1.4)) == "Mug3"
    simulation.highlight([BodyId("Mug3")], (0.0, 0.8, 0.0))
    ann.wait_for("/batches/1/plain")
    x, y = (round(part) for part in ann.to_window((1.12, 0.5, 1.4)))

    def green() -> bool:
        red, green_, blue = ann.pixels()[y, x].astype(int)
        return bool(green_ > red + 40 and green_ > blue + 40)

    wait_until(green, "the clicked body is green")
    simulation.clear_highlights()
    wait_until(lambda: not green(), "the highlight is cleared")
    simulation.engine.run(lambda engine: engine.apply(Delete((BodyId("Mug2"),))), edits=True)
    simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Mug4"): Pose((1.2, 0.0, 1.4))})))
    wait_until(lambda: viewer._scene.appearances.keys() == set(simulation.state.ids), "the page is updated")
    wait_until(lambda: clicked((1.12, 0.0, 1.4)) == "Mug4", "the moved body is clickable")
    assert clicked((1.12, 0.5, 1.4)) == "Mug3"
    for instances in ([[0, 2]], [[2]]):
        client = viewer._server.get_clients()[ann.number]
        send_view_data(client.scene, "culled", {"names": ["/batches/1/textured"], "instances": instances})
        wait_until(lambda instances=instances: culled_instances(ann) == instances[0], "instances are hidden")


def culled_instances(tab: ViewTab) -> list[int]:
    """The invisible instances of the batch."""
    return list(
        tab.page.evaluate(
            """() => {
                const meshes = [];
                window.__viserMutable.nodeRefFromName["/batches/1/textured"].traverse((node) => meshes.push(node));
                const mesh = meshes.find((each) => each.getVisibilityAt);
                return [...Array(mesh.instancesCount).keys()].filter((row) => !mesh.getVisibilityAt(row));
            }"""
        )
    )


def test_late_and_reconnecting_clients_see_the_current_state(
    simulation: Simulation, viewer: Viewer, open_view: OpenView
) -> None:
    ann = open_view(viewer)
    ann.wait_for("/bodies/Mug/textured")
    simulation.engine.run(lambda engine: engine.apply(Delete((MUG,))), edits=True)
    viewer.select(BodyId("Fridge"))
    late = open_view(viewer)
    late.wait_for("/bodies/Fridge/textured")
    late.wait_for("/selected")
    assert not late.is_drawn("/bodies/Mug/textured")
    cut_off = viewer.views.clients
    for connection in list(viewer._server._websock_server._live_connections.values()):
        asyncio.run_coroutine_threadsafe(connection.close(), viewer._server.get_event_loop()).result(30)
    simulation.highlight([BodyId("Fridge")], (1.0, 0.0, 0.0))
    wait_until(lambda: len(set(viewer.views.clients) - set(cut_off)) == 2, "both clients are connected again")
    for tab in (ann, late):
        tab.wait_for("/bodies/Fridge/plain")
        tab.wait_for("/selected")
        assert not tab.is_drawn("/bodies/Mug/textured")


def test_a_gizmo_moves_the_selected_body_in_steps_and_puts_it_down(
    simulation: Simulation, viewer: Viewer, open_view: OpenView
) -> None:
    simulation.engine.run(lambda engine: engine.apply(SetPoses({BodyId("Fridge"): Pose((2.0, 1.0, 1.1))})))
    ann = open_view(viewer)
    ann.wait_for("/bodies/Fridge/textured")
    viewer.views.select(BodyId("Fridge"), client=ann.number)
    viewer.views.set_snapping(Snapping(step_m=0.25, to_surface=True), client=ann.number)
    viewer.views.set_gizmo(GizmoMode.MOVE, client=ann.number)
    ann.wait_for("/gizmo")
    start = position(simulation, "Fridge").copy()
    along = (float(start[0]), float(start[1]) + 0.8, float(start[2]))
    beyond = (along[0], along[1] + 0.5, along[2])

    def preview_appears() -> bool:
        ann.press_and_move(along, beyond)
        try:
            wait_until(lambda: ann.is_drawn("/previews/Fridge"), "the preview is shown", timeout_s=5.0)
        except AssertionError:
            ann.release()  # a slow browser may have moved the camera instead
            viewer.views.go_home(client=ann.number)
            return False
        return True

    wait_until(preview_appears, "the preview is shown")
    assert np.array_equal(position(simulation, "Fridge"), start), "the body stays until the gizmo is released"
    ann.release()
    wait_until(lambda: position(simulation, "Fridge")[1] > start[1] + 0.2, "the body is where the preview was")
    y, z = position(simulation, "Fridge")[1:].tolist()
    assert y / 0.25 == pytest.approx(round(y / 0.25)), "it is moved by steps"
    assert z == pytest.approx(0.9, abs=0.005), "it is put down on the floor"
    wait_until(lambda: not ann.is_drawn("/previews/Fridge"), "the preview is removed")
    simulation.edits.undo()
    assert position(simulation, "Fridge") == pytest.approx(start)
