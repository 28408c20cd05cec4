"""Viewport: the page on which one sees a stage's world and reaches into it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable
from functools import wraps
from html import escape
from typing import Any

import msgspec
import viser

from mindstage.errors import MindstageError
from mindstage.knowledge.rdf import local_name
from mindstage.scene import BodyId, BodyPhysics, Iri, Pose, World
from mindstage.simulation import Simulation, SpawnNoteKind, StateSnapshot
from mindstage.viewer.appearance import compute_appearance, find_outlines
from mindstage.viewer.camera import ClientViews, ground_height, initial_target
from mindstage.viewer.drag import DragController
from mindstage.viewer.handlers import Handlers
from mindstage.viewer.scene import Clickable, MarkerNodes, Pick, ViewerScene
from mindstage.viewer.screenshot import Screenshot, ScreenshotTaker
from mindstage.viewer.server import RpcChannel, address, serve, shut_down

__all__ = ["Viewer"]

_UPDATE_INTERVAL_S = 1 / 30
_TEXT_INTERVAL_S = 0.1
"""Words change more slowly than things: nobody can read faster."""
_RETRY_DELAY_S = 1.0
"""After a fault the page waits so long before it tries again."""
_PAUSED = "The simulation is paused: press Play to pull bodies."

_log = logging.getLogger(__name__)


class Viewer:
    """Serves a page for any number of visitors, in a thread of its own.

    It only reads the frames that the stage publishes, so that visitors neither stop nor slow the world. The bodies
    that they pull, and the buttons they press, go to the stage like anybody's calls.
    """

    def __init__(
        self,
        simulation: Simulation,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        token: str | None = None,
        origins: Collection[str] = (),
    ) -> None:
        """Opens the page at once, whether or not the stage has a world yet.

        Args:
            stage: what is shown; not closed together with the viewport.
            host: 127.0.0.1 is this machine only. Whoever reaches the page may do all that it offers.
            port: where that one is taken, the next free one is used; 0 lets the system choose.
            token: what visitors must know; others than this machine's own need one.
            origins: addresses under which the page may be opened beside its own, such as `https://robot.example`.

        Raises:
            AuthenticationError: others could reach it, and there is no token.
            ViewerUnavailableError: nothing can be served there.
        """
        self._simulation = simulation
        self.channel = RpcChannel()
        """What the page and we tell one another."""
        self._token = token
        self._server = serve(host, port, title="Mindstage", channel=self.channel, token=token, origins=origins)
        self._drag_controller = DragController(simulation)
        self._scene = ViewerScene(self._server, on_node=self._make_clickable)
        self.views = ClientViews(self._server, on_place=self._place_body)
        """What each visitor sees, and wants to see."""
        self._markers = MarkerNodes(self._server)
        self._handlers = Handlers(simulation, self.channel, self.views, self._server)
        self._frame: StateSnapshot | None = None
        self._last_world: World | None = None
        self._has_camera: Iri | None = None
        """The world that visitors' first view was chosen for."""
        self._text_due = 0.0
        self._last_error: set[str] = set()
        self._closing = threading.Event()
        self._wakeup = threading.Event()
        """Set where it is worth looking at once, not only at the next picture."""
        self._remove_listener = simulation.clients.on_edit(self._wakeup.set)
        self._thread = threading.Thread(target=self._run, name="mindstage-viewport", daemon=True)
        self._thread.start()

    # -- for whoever opened it -------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """What to type into a browser."""
        return address(self._server)

    def select(self, id: BodyId | None) -> None:
        """Draws a frame round a body for all visitors, also for those who come later; None round none.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self.views.select(id)

    def screenshot(self, screenshot: Screenshot | None = None) -> bytes:
        """A picture of the page or of the world alone, as PNG: `viewport.shot(Screenshot(size=(800, 600), section=1.8))`.

        Raises:
            BrowserNotFoundError: no browser is found here, or it does not start.
            BrowserCrashedError: it ended, or the picture was not finished in time.
            BodyNotFoundError: a body that shall be seen is not there.
        """
        return ScreenshotTaker(self._server, self.views, token=self._token).take(screenshot or Screenshot())

    def close(self) -> None:
        """Ends the page; any number of times. The stage lives on."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._remove_listener()
        self._wakeup.set()
        self._thread.join()
        self._drag_controller.release_all()
        shut_down(self._server)
        self.channel.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {'closed' if self._closing.is_set() else self.url}>"

    def _repr_html_(self) -> str:
        """A link for notebooks."""
        address = escape("" if self._closing.is_set() else self.url, quote=True)
        return f'<a href="{address}" target="_blank">{address}</a>' if address else escape(repr(self))

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- following the world ---------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._closing.is_set():
            self._wakeup.clear()
            start = time.monotonic()
            try:
                self._update()
            except Exception as error:  # whatever it is, the page goes on and says so
                self._handlers.show_error(self._report_error(error))
                self._closing.wait(_RETRY_DELAY_S)
            else:
                self._handlers.show_error("")
                took = time.monotonic() - start
                # At least half of the time is left to the world's own thread, however much moves or is edited.
                self._closing.wait(took)
                self._wakeup.wait(max(0.0, _UPDATE_INTERVAL_S - 2 * took))

    def _update(self) -> None:
        before, frame = self._frame, self._simulation.state
        if before is None or frame.revision != before.revision or frame.ids is not before.ids:
            self._rebuild(frame)
        elif frame is not before:
            self._move(frame)
        if before is None or frame.highlights != before.highlights:
            self._scene.set_highlights(frame.highlights)
        if before is None or frame.markers is not before.markers or frame.revision != before.revision:
            self._markers.show(frame.markers, self._scene.appearances)
        self._frame = frame
        self._scene.hide(self.views.hidden)
        self._scene.show_enclosures(self.views.enclosures_shown)
        self.views.process_queue()
        if time.monotonic() >= self._text_due:
            self._text_due = time.monotonic() + _TEXT_INTERVAL_S
            self._handlers.publish(frame)

    def _rebuild(self, frame: StateSnapshot) -> None:
        """Something came, went or changed."""
        described = _with_described_poses(self._simulation.snapshot(), self._simulation.worlds)
        if described == self._last_world and self._frame is not None and frame.ids is self._frame.ids:
            self._move(frame)
            return
        shells = {id for report in self._simulation.reports for id in report.ids_with_note(SpawnNoteKind.ENCLOSURE)}
        # Words first: they are there long before the picture is drawn.
        self._handlers.on_rebuild(
            described, enclosing=find_outlines(described, geometry=self._simulation.geometry, enclosing=shells)
        )
        before = self._last_world
        if before is None or frame.ids is not self._scene.ids or _visible_part(described) != _visible_part(before):
            self._draw(frame, described, shells)
        else:
            self._move(frame)
        self._last_world = described

    def _draw(self, frame: StateSnapshot, world: World, enclosing: Collection[BodyId]) -> None:
        """Shows a world that looks other than before."""
        knowledge = self._simulation.knowledge
        looks = compute_appearance(
            world, knowledge.shape_rule, knowledge.ancestors, geometry=self._simulation.geometry, enclosing=enclosing
        )
        # What came after this frame has no pose in it yet; the next frame will bring it.
        looks = {id: looks[id] for id in frame.ids if id in looks}
        self._drag_controller.set_world(world)
        self._scene.show(looks, frame.ids, frame.poses, holdable=self._drag_controller.draggable)
        self._scene.set_ground(ground_height(world, looks))
        names = {body.id: body.label or local_name(body.cls) for body in world.bodies}
        self.views.set_bodies(looks, names, frame.ids, frame.poses)
        if not looks:
            self._has_camera = None
        elif self._has_camera != world.iri:
            outlook = initial_target(world, looks)
            self._scene.set_initial_camera(outlook.camera())
            self.views.set_target(outlook)
            self._has_camera = world.iri

    def _move(self, frame: StateSnapshot) -> None:
        if len(self._scene.move(frame.poses)):
            self.views.update_poses(frame.poses)

    # -- following the visitors ------------------------------------------------------------------------------

    def _make_clickable(self, node: Clickable, pick: Pick, *, holdable: bool) -> None:
        """Makes a node that was just drawn answer to the mouse."""
        node.on_click(self._with_toast(lambda event: self._click(pick(event.instance_index), event.client_id)))
        if holdable:
            drag = self._with_toast(lambda event: self._drag(pick(event.instance_index), event))

            # viser keeps the order of what happened for coroutines only.
            async def on_drag(event: viser.SceneNodeDragEvent[Any]) -> None:
                drag(event)

            node.on_drag("left")(on_drag)

    def _click(self, id: BodyId | None, client: int) -> None:
        """Who clicks on what is selected selects nothing."""
        self.views.select(None if self.views.selected(client) == id else id, client=client)

    def _place_body(self, visitor: int, id: BodyId, pose: Pose) -> None:
        """A visitor has put a body somewhere."""
        try:
            self._simulation.undo_stack.move(id, pose)
        except MindstageError as error:
            self._handlers.toast(visitor, str(error))

    def _drag(self, id: BodyId | None, event: viser.SceneNodeDragEvent[Any]) -> None:
        match event.phase:
            case "start" if id is not None:
                self._drag_controller.start(event.client_id, id, event.start_position)
                if not self._simulation.state.playing:
                    self._handlers.toast(event.client_id, _PAUSED, kind="info")
            case "update":
                x, y, z = event.client.camera.position.tolist()
                self._drag_controller.move(event.client_id, event.end_position, (x, y, z))
            case "end":
                self._drag_controller.release(event.client_id)

    def _with_toast(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Tells the visitor why what they did did not work."""

        @wraps(callback)
        def run(event: Any) -> None:
            try:
                callback(event)
            except MindstageError as error:
                text = str(error)
            except Exception as error:
                text = self._report_error(error)
            else:
                return
            if event.client is not None:
                self._handlers.toast(event.client.client_id, text)

        return run

    def _report_error(self, error: Exception) -> str:
        """Says once on stderr what is wrong, and gives it in words."""
        text = str(error) if isinstance(error, MindstageError) else f"{type(error).__name__}: {error}"
        if text not in self._last_error:
            self._last_error.add(text)
            _log.error("the viewport has a fault: %s", text, exc_info=error)
        return text


def _visible_part(world: World) -> World:
    """The same without what nobody sees: weights, gravity, and why anything is so."""
    bodies = (
        msgspec.structs.replace(body, physics=BodyPhysics(mobility=body.physics.mobility), tags=(), facts=())
        for body in world.bodies
    )
    return msgspec.structs.replace(world, bodies=tuple(bodies), facts=())


def _with_described_poses(now: World, worlds: Iterable[World]) -> World:
    """The world that is there, with the poses that it was described with: an open drawer is still in its cupboard."""
    given = {body.id: body.pose for world in worlds for body in world.bodies}
    bodies = (msgspec.structs.replace(body, pose=given.get(body.id, body.pose)) for body in now.bodies)
    return msgspec.structs.replace(now, bodies=tuple(bodies))
