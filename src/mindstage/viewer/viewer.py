"""The viewer: serves the page of one simulation and keeps its 3D scene up to date.

It reads published snapshots in a thread of its own, so that open pages neither stop nor slow the simulation.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection
from functools import wraps
from html import escape
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import viser

from mindstage.access.certificates import TlsCertificate
from mindstage.access.limits import DEFAULT_VISITOR_LIMITS, UNSEEN_BODIES, VisitorLimits
from mindstage.access.policies import EntryPoint
from mindstage.episodes.replay import EpisodeReplay
from mindstage.errors import InvalidArgumentError, MindstageError
from mindstage.ranges import Port, checked
from mindstage.rdf.graphs import local_name
from mindstage.rendering.appearance import compute_appearance, find_outlines
from mindstage.rendering.camera import FramingTarget, ground_height, initial_target
from mindstage.rendering.render_scene import described_world
from mindstage.scene import BodyId, BodyPhysics, Iri, Pose, Vector, World
from mindstage.scene.transforms import Array
from mindstage.simulation import Simulation, SpawnNoteKind, StateSnapshot
from mindstage.simulation.observation import as_client
from mindstage.viewer.ask import PrologSolver
from mindstage.viewer.client_views import ClientViews, MountCulling
from mindstage.viewer.drag import DragController
from mindstage.viewer.episodes import RecordingHandler, TimelineHandler
from mindstage.viewer.ghosts import GhostNodes
from mindstage.viewer.handlers import Handlers
from mindstage.viewer.http import texture_path
from mindstage.viewer.plans import PlanHandler
from mindstage.viewer.robots import RobotHandler
from mindstage.viewer.scene import Clickable, MarkerNodes, Pick, ViewerScene
from mindstage.viewer.server import CLIENT, RpcChannel, address, serve, shut_down

if TYPE_CHECKING:
    from mindstage.imagination import Verdict

__all__ = ["Viewer"]

_UPDATE_INTERVAL_S = 1 / 30
_TEXT_INTERVAL_S = 0.1
"""Interval at which panels are updated, longer than that of the 3D scene [s]."""
_RETRY_DELAY_S = 1.0
"""Pause after a failed update [s]."""
_PAUSED = "The simulation is paused: press Play to pull bodies."

_log = logging.getLogger(__name__)


class Viewer:
    """Serves the page for any number of clients, in a thread of its own.

    Reads the snapshots that the simulation publishes. Drags and buttons call the same methods of the simulation as
    programs do.
    """

    @checked
    def __init__(
        self,
        simulation: Simulation,
        *,
        host: str = "127.0.0.1",
        port: Port | None = None,
        token: str | None = None,
        origins: Collection[str] = (),
        tls: TlsCertificate | None = None,
        visitor_limits: VisitorLimits = DEFAULT_VISITOR_LIMITS,
        prolog: PrologSolver | None = None,
        autosave: bool = False,
    ) -> None:
        """Starts serving; the simulation may be empty.

        Args:
            simulation: the simulation that is shown; not closed together with the viewer.
            host: the address to listen on. The default is this machine only. The page gives full control of the
                simulation.
            port: the port; 0 lets the system choose. By default 8080, or the next free one.
            token: the token that clients need; required unless `host` is a loopback address.
            origins: further origins under which the page may be opened, such as `https://robot.example`.
            tls: the certificate for https://; None serves http://.
            visitor_limits: limits of each client address.
            prolog: solves Prolog queries typed on the page; without it the page offers none.
            autosave: whether edits are saved automatically, in Mindstage's cache; pages of a later process with the
                same map ask whether to restore them. A replay has nothing to save.

        Raises:
            AuthenticationError: the host is not a loopback address, and there is no token.
            CertificateError: the certificate cannot be used.
            ViewerUnavailableError: the host or port cannot be served; a port that was given is not replaced.
        """
        self._simulation = simulation
        self.channel = RpcChannel(expected_rebuild_s=lambda: simulation.state.expected_rebuild_s)
        """The RPC channel of all pages."""
        self._token = token
        self._server = serve(
            host,
            port,
            title="Mindstage",
            channel=self.channel,
            token=token,
            origins=origins,
            tls=tls,
            visitor_limits=visitor_limits,
        )
        self._drag_controller = DragController(simulation)
        self._scene = ViewerScene(self._server, on_node=self._make_clickable, texture_uri=texture_path)
        self.views = ClientViews(self._server, on_place=self._place_body, instances=self._scene.instances)
        """The views of all clients: camera, selection, labels."""
        self._markers = MarkerNodes(self._server)
        is_saved = autosave and not isinstance(simulation, EpisodeReplay)
        self._handlers = Handlers(simulation, self.channel, self.views, self._server, prolog=prolog, autosave=is_saved)
        ghosts = GhostNodes(self._server)
        self._plans = PlanHandler(simulation, self.channel, ghosts)
        self._robots = RobotHandler(simulation, self.channel, self._server, view_center=self._handlers.view_center)
        self._recording = RecordingHandler(simulation, self.channel)
        self._timeline: TimelineHandler | None = None
        if isinstance(simulation, EpisodeReplay):
            self._timeline = TimelineHandler(simulation, self.channel, self._server, ghosts, on_beside=self._frame_both)
        self._snapshot: StateSnapshot | None = None
        self._last_world: World | None = None
        self._framed_world: Iri | None = None
        """The world for which the initial camera was computed."""
        self._target: FramingTarget | None = None
        self._text_due = 0.0
        self._logged_errors: set[str] = set()
        self._closing = threading.Event()
        self._wakeup = threading.Event()
        """Set when the next update should not wait for the interval."""
        self._remove_listener = simulation.clients.on_edit(self._wakeup.set)
        self._thread = threading.Thread(target=self._run, name="mindstage-viewer", daemon=True)
        self._thread.start()
        self._server.open()

    def entry_points(self) -> tuple[EntryPoint, ...]:
        """Everything that a visitor of the page can reach."""
        return (*self._server.filter.entry_points(), *self.channel.entry_points())

    # -- public interface ----------------------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """The address of the page."""
        return address(self._server)

    def select(self, id: BodyId | None) -> None:
        """Selects a body for all clients, later ones included; None selects nothing.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self.views.select(id)

    def offer_tour(self) -> None:
        """Lets pages start the tour by themselves if their user has neither done nor skipped it."""
        self.channel.publish("tour", {"offered": True})

    def show_verdict(self, verdict: Verdict) -> tuple[Vector, ...]:
        """Shows where bodies end in the samples of a verdict, and its first failing sample, as ghosts in all views.

        Returns:
            The positions of the ghosts [m], which `views.focus_points` frames.
        """
        return self._plans.show(verdict)

    def show_path(self, id: BodyId | None) -> None:
        """Shows the path of a body over the whole recording, as a line and ghosts; None removes it.

        Raises:
            BodyNotFoundError: the recording never has that body.
            InvalidArgumentError: the body does not move, or the simulation is no replay.
        """
        if self._timeline is None:
            remedy = "view an EpisodeReplay"
            raise InvalidArgumentError("the path", cause="the simulation is no recording", remedy=remedy)
        self._timeline.show_trail(id)

    def close(self) -> None:
        """Stops serving; calling it again is harmless. The simulation stays open."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._remove_listener()
        self._wakeup.set()
        self._thread.join()
        self._handlers.close()
        self._plans.close()
        self._robots.close()
        self._recording.close()
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

    # -- updates -------------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        with as_client(CLIENT):
            self._draw_until_closed()

    def _draw_until_closed(self) -> None:
        while not self._closing.is_set():
            self._wakeup.clear()
            start = time.monotonic()
            try:
                self._update()
            except Exception as error:  # the page shows it and stays open
                self._handlers.show_error(self._report_error(error))
                self._closing.wait(_RETRY_DELAY_S)
            else:
                self._handlers.show_error("")
                elapsed = time.monotonic() - start
                # At least half of the time is left to the simulation's thread, however much moves or is edited.
                self._closing.wait(elapsed)
                self._wakeup.wait(max(0.0, _UPDATE_INTERVAL_S - 2 * elapsed))

    def _update(self) -> None:
        before, snapshot = self._snapshot, self._simulation.state
        if before is None or snapshot.revision != before.revision or snapshot.ids is not before.ids:
            self._rebuild(snapshot)
        elif snapshot is not before:
            self._move(snapshot)
        if before is None or snapshot.highlights != before.highlights:
            self._scene.set_highlights(snapshot.highlights)
            self.views.set_highlighted(snapshot.highlights)
            self._report_unseen(snapshot.highlights)
        if before is None or snapshot.markers is not before.markers or snapshot.revision != before.revision:
            self._markers.show(snapshot.markers, self._scene.appearances)
        self._snapshot = snapshot
        self._plans.update(snapshot, self._scene.appearances)
        self._robots.update()
        if self._timeline is not None:
            self._timeline.update(snapshot, self._scene.appearances)
        self._scene.hide(self.views.hidden)
        self._scene.show_enclosures(self.views.enclosures_shown)
        self.views.process_queue()
        if time.monotonic() >= self._text_due:
            self._text_due = time.monotonic() + _TEXT_INTERVAL_S
            self._handlers.publish(snapshot)
            self._robots.publish()
            self._recording.publish()
            if self._timeline is not None:
                self._timeline.publish(snapshot)

    def _report_unseen(self, highlights: Collection[BodyId]) -> None:
        """Sends the highlighted bodies to pages in whose view none is noticed; they move the camera or offer it."""
        ids = list(highlights)[: UNSEEN_BODIES.count]
        for client in self.views.clients_not_seeing(ids) if ids else ():
            if (session := self._handlers.session_of_view(client)) is not None:
                session.send_event("unseen_answers", ids)

    def _rebuild(self, snapshot: StateSnapshot) -> None:
        """Updates panels and scene after bodies were added, removed or edited."""
        world = described_world(self._simulation.snapshot(), self._simulation.worlds)
        if world == self._last_world and self._snapshot is not None and snapshot.ids is self._snapshot.ids:
            self._move(snapshot)
            return
        enclosing = {id for report in self._simulation.reports for id in report.ids_with_note(SpawnNoteKind.ENCLOSURE)}
        # Panels first, because drawing the scene takes much longer.
        outlines = find_outlines(world, geometry=self._simulation.geometry, enclosing=enclosing)
        if self._handlers.on_rebuild(world, enclosing=outlines):
            self._plans.forget()
        before = self._last_world
        if before is None or snapshot.ids is not self._scene.ids or _visible_part(world) != _visible_part(before):
            self._draw(snapshot, world, enclosing)
        else:
            self._move(snapshot)
        self._last_world = world

    def _draw(self, snapshot: StateSnapshot, world: World, enclosing: Collection[BodyId]) -> None:
        knowledge = self._simulation.knowledge
        appearances = compute_appearance(
            world, knowledge.shape_rule, knowledge.ancestors, geometry=self._simulation.geometry, enclosing=enclosing
        )
        # Bodies added after this snapshot have no pose in it; the next snapshot includes them.
        appearances = {id: appearances[id] for id in snapshot.ids if id in appearances}
        self._drag_controller.set_world(world)
        target = None
        if appearances and self._framed_world != world.iri:
            target = initial_target(world, appearances)
            self._scene.set_initial_camera(target.camera())  # before the bodies, which take long on a slow connection
        self._scene.show(appearances, snapshot.ids, snapshot.poses, draggable=self._drag_controller.draggable)
        self._scene.set_ground(ground_height(world, appearances))
        labels = {body.id: body.label or local_name(body.cls) for body in world.bodies}
        culling = MountCulling(world, appearances, snapshot.ids)
        self.views.set_bodies(appearances, labels, snapshot.ids, snapshot.poses, parts=_parts(world), culling=culling)
        if not appearances:
            self._framed_world = None
        elif target is not None:
            self._frame_target(target)
            self._framed_world = world.iri

    def _frame_target(self, target: FramingTarget) -> None:
        self._target = target
        self.views.set_target(target)

    def _frame_both(self, offset: Array) -> None:
        """Frames a second world too, which is so far from the first [m]."""
        if (target := self._target) is not None:
            points = np.concatenate([target.points, target.points + offset])
            both = msgspec.structs.replace(target, points=points)
            self._scene.set_initial_camera(both.camera())
            self._frame_target(both)

    def _move(self, snapshot: StateSnapshot) -> None:
        if len(self._scene.move(snapshot.poses)):
            self.views.update_poses(snapshot.poses)

    # -- mouse events --------------------------------------------------------------------------------------------------

    def _make_clickable(self, node: Clickable, pick: Pick, *, draggable: bool) -> None:
        """Registers the mouse callbacks of a new scene node."""
        node.on_click(self._with_toast(lambda event: self._click(pick(event.instance_index), event.client_id)))
        if draggable:
            drag = self._with_toast(lambda event: self._drag(pick(event.instance_index), event))

            # viser keeps the order of events for coroutines only.
            async def on_drag(event: viser.SceneNodeDragEvent[Any]) -> None:
                drag(event)

            node.on_drag("left")(on_drag)

    def _click(self, id: BodyId | None, client: int) -> None:
        """Reports a click to the page, which decides what it does; a view without a page selects the body."""
        if (session := self._handlers.session_of_view(client)) is not None:
            session.send_event("clicked", id)
            return
        self.views.select(None if self.views.selected(client) == id else id, client=client)

    def _place_body(self, client: int, id: BodyId, pose: Pose, *, to_surface: bool) -> None:
        """Moves the selected bodies with one that a client has moved with the gizmo."""
        try:
            with as_client(CLIENT):
                self._handlers.move_group(id, pose, self.views.selection(client), to_surface=to_surface)
        except MindstageError as error:
            self._handlers.toast(client, str(error))

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
        """Wraps a mouse callback: an error is shown to the client that caused the event."""

        @wraps(callback)
        def run(event: Any) -> None:
            try:
                with as_client(CLIENT):
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
        """Returns the text of an error, and logs it the first time that it occurs."""
        text = str(error) if isinstance(error, MindstageError) else f"{type(error).__name__}: {error}"
        if text not in self._logged_errors:
            self._logged_errors.add(text)
            _log.error("the viewer failed: %s", text, exc_info=error)
        return text


def _parts(world: World) -> dict[BodyId, tuple[BodyId, ...]]:
    """The parts of each body: what is attached or joined to it, directly or through other parts."""
    children: dict[BodyId, list[BodyId]] = {}
    links = [(link.parent, link.child) for link in world.attachments]
    for parent, child in links + [(joint.parent, joint.child) for joint in world.joints]:
        children.setdefault(parent, []).append(child)
    parts = {}
    for id in children:
        found, waiting = {id: None}, [id]
        while waiting:
            new = [child for child in children.get(waiting.pop(), ()) if child not in found]
            found.update(dict.fromkeys(new))
            waiting += new
        parts[id] = tuple(found)[1:]
    return parts


def _visible_part(world: World) -> World:
    """A copy of the world without what does not change its appearance: masses, gravity, tags and facts."""
    bodies = (
        msgspec.structs.replace(body, physics=BodyPhysics(mobility=body.physics.mobility), tags=(), facts=())
        for body in world.bodies
    )
    return msgspec.structs.replace(world, bodies=tuple(bodies), facts=())
