"""Handlers of the requests of pages: editing, files, simulation control, details, and the client's 3D view.

Edits go through `Simulation.edits`, so that they can be undone. An uploaded map is untrusted: its size is limited,
one that imports what is not loaded is refused, and no file of this machine is read for it. It is parsed before the
current world is replaced, so that an invalid map changes nothing.
"""

from __future__ import annotations

import re
import time
import weakref
from base64 import b64encode
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import msgspec
import viser

from mindstage.access.limits import MAP_CHARACTERS, NEW_BODY_TIME, STORAGE_PLACES, Duration, Speed
from mindstage.access.policies import EDIT, FILE, READ, RUN
from mindstage.access.resources import require_granted, without_paths
from mindstage.errors import (
    BodyNotFoundError,
    InvalidArgumentError,
    MapNotFoundError,
    MindstageError,
    SourceParseError,
    UnsavedEditsError,
)
from mindstage.files import atomic_write
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import MapDialect, SourceMapView, UnitConventions, write_map
from mindstage.maps.io.formats import WorldFormat, readable_suffixes
from mindstage.registry import Group, load_all
from mindstage.rendering.screenshot import LabelMode
from mindstage.saving import file_format
from mindstage.scene import Body, BodyId, Iri, Joint, Pose, Vector, World
from mindstage.simulation import JointHandle, Simulation, SpawnRecord, StateSnapshot
from mindstage.simulation.state import poses_in
from mindstage.viewer.adding import AddHandler
from mindstage.viewer.ask import AskHandler, PrologSolver
from mindstage.viewer.autosave import Autosave
from mindstage.viewer.client_views import ClientViews, GizmoMode
from mindstage.viewer.editing import EditHandler, history_message
from mindstage.viewer.inspector import (
    BodyDetails,
    StatusHandler,
    StorageHint,
    TourHandler,
    body_details,
    live_details,
    scene_tree,
)
from mindstage.viewer.outline_places import OutlinePlaces
from mindstage.viewer.server import ClientSession, EmptyRequest, RpcChannel, session_key_of
from mindstage.viewer.view_tools import PointerPicker, SessionViews, ViewToolHandler

__all__ = ["SELECTED", "ClockMessage", "FileHandler", "Handlers", "ViewHandler", "WorldHandler"]


_SUFFIXES = (".owl", ".rdf", ".xml", ".ttl", ".urdf")


class SaveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `save`."""

    format: str = "owl"
    """The name of a format that is offered to clients."""
    dialect: MapDialect | None = None
    """That of a semantic map; None is the dialect of the spawned map, if there is one."""


class LoadRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `load`: a file of the client."""

    name: Annotated[str, msgspec.Meta(max_length=300)]
    text: Annotated[str, msgspec.Meta(max_length=MAP_CHARACTERS.count)]
    discard: bool = False
    """Whether to go on although edits are not saved."""
    conventions: UnitConventions = UnitConventions()
    """Conventions of the map; what is not given is inferred."""


class FileHandler:
    """Handles `save` and `load`: downloads of the world as a map, and uploads of maps."""

    def __init__(
        self, simulation: Simulation, channel: RpcChannel, *, on_saved: Callable[[], None] = lambda: None
    ) -> None:
        """Registers the requests.

        Args:
            channel: the channel of the pages.
            on_saved: called when a page has got the world as a map.
        """
        self._simulation, self._channel, self._on_saved = simulation, channel, on_saved
        self._saved_version = simulation.edits.version
        """The history whose last state is in a file."""
        self._loaded: list[KnowledgeBase] = []
        channel.register("save", SaveRequest, self._save, FILE, queue="files")
        channel.register("formats", EmptyRequest, self._formats, READ)
        channel.register("load", LoadRequest, self._load, FILE, queue="files")

    @property
    def is_unsaved(self) -> bool:
        """Whether there are edits that are in no file: neither saved as a semantic map, nor those of a loaded one."""
        return self._simulation.edits.version != self._saved_version

    def _save(self, _: ClientSession, request: SaveRequest) -> dict[str, str]:
        version = self._simulation.edits.version
        world = self._simulation.snapshot()
        format = file_format("", request.format, dialect=request.dialect)[1]
        name = f"{_safe_filename(world.name) or 'map'}{format.suffixes[0]}"
        file = {"name": name, "type": format.media_type}
        if format.syntax is None:
            with TemporaryDirectory(prefix="mindstage-") as folder:
                self._simulation.save(Path(folder, name), format=request.format)
                return file | {"base64": b64encode(Path(folder, name).read_bytes()).decode()}
        source_view = self._source_view(world) if request.dialect is None else None
        dialect = request.dialect or MapDialect.SEMLOG
        text = write_map(world, format=format.syntax, dialect=dialect, source_view=source_view)
        self._saved_version = version
        self._on_saved()
        return file | {"text": text}

    def _formats(self, _: ClientSession, __: EmptyRequest) -> list[dict[str, str]]:
        """The formats in which the world can be saved, besides semantic maps."""
        known = load_all(Group.FORMATS, WorldFormat).items()
        return [{"name": name, "title": each.title} for name, each in known if each.write is not None]

    def _source_view(self, world: World) -> SourceMapView | None:
        try:
            return self._simulation.knowledge.source_view(world.iri)
        except MapNotFoundError:
            return None  # the world was not read from a map

    def _load(self, session: ClientSession, request: LoadRequest) -> dict[str, object]:
        knowledge, world = self._read(request)  # nobody is asked about a file that cannot be loaded
        if self.is_unsaved and not request.discard:
            knowledge.close()
            done = self._simulation.edits.history.undo
            edits = "1 edit is" if len(done) == 1 else f"{len(done)} edits are"
            raise UnsavedEditsError(edits, last=done[0] if done else "an undo")
        playing, speed = self._simulation.state.playing, self._simulation.state.speed
        self._loaded.append(knowledge)
        report = self._simulation.replace_world(world, knowledge=knowledge)
        self._saved_version = self._simulation.edits.version
        in_use = {id(each) for each in (self._simulation.knowledge, *self._simulation.edits.knowledge_bases)}
        for each in self._loaded:
            if id(each) not in in_use:
                each.close()
        self._loaded = [each for each in self._loaded if id(each) in in_use]
        if playing:
            self._simulation.play(speed=speed)
        failed = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
        self._channel.tell_others(session, f"loaded {request.name}; Undo brings back the world before")
        return {
            "name": world.name,
            "bodies": report.bodies,
            "joints": report.joints,
            "failed": [{"id": each.id, "reason": each.reason} for each in failed[:50]],
            "findings": len(knowledge.findings()),
        }

    def _read(self, request: LoadRequest) -> tuple[KnowledgeBase, World]:
        """Parses an uploaded map into a new knowledge base with the current ontologies.

        Raises:
            InvalidArgumentError: the suffix is not that of a map, or it has no bodies.
            ReferenceRefusedError: it imports something that is not loaded.
            ResourceRefusedError: the file refers to files of this machine.
            KnowledgeError: the file cannot be parsed, or contains no map.
        """
        suffix = Path(request.name).suffix.lower()
        if suffix not in (known := (*_SUFFIXES, *readable_suffixes())):
            raise InvalidArgumentError(request.name, cause=f"a map ends in {', '.join(known)}")
        knowledge = self._simulation.knowledge.ontologies_only()
        folder = TemporaryDirectory(prefix="mindstage-")
        # Saving in the dialect of the source reads the file again, so it is kept as long as the knowledge base.
        weakref.finalize(knowledge, folder.cleanup)
        try:
            path = Path(folder.name, f"{_safe_filename(Path(request.name).stem) or 'map'}{suffix}")
            atomic_write(path, request.text.encode())
            try:
                knowledge.load(path, conventions=request.conventions, xacro=False, untrusted=True)
            except SourceParseError as error:  # without the path on this machine
                raise type(error)(request.name, cause=error.cause, line=error.line) from error
            world = knowledge.world()
            if not world.bodies:
                raise InvalidArgumentError(request.name, cause="no bodies were found in it; is it a semantic map?")
            require_granted(body.mesh for body in world.bodies)  # before the present world is replaced
            return knowledge, world
        except BaseException:
            knowledge.close()
            raise


def _safe_filename(name: str) -> str:
    """A file name of ASCII letters, digits and `._-` only, at most 80 characters."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.")[:80]


SELECTED = "selected"
"""Key of the selected body in the `state` of a session."""
_NEW_BODY_POLL_S = 0.03
_STORAGE_QUESTION = "storage_place_in_environment"


class PlayRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `play`."""

    speed: Speed = 1.0


class StepRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `step`."""

    duration_s: Duration = 0.1


class DetailsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `details`."""

    id: BodyId


class ClockMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The state of the clock; the topic `clock`."""

    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    """Simulated seconds per second of real time."""
    bodies: int
    fault: str
    expected_rebuild_s: float
    """How long the engine is expected to rebuild its model, after edits; 0 if it does not have to."""


class WorldHandler:
    """Publishes the scene tree, clock and live details; handles `play`, `pause`, `step`, `reset` and `details`."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Registers the requests.

        Args:
            channel: the channel of the pages.
        """
        self._simulation, self._channel = simulation, channel
        self._world: World | None = None
        self._bodies: Mapping[BodyId, Body] = {}
        self._joints_by_body: Mapping[BodyId, Sequence[Joint]] = {}
        self._joint_handles: dict[BodyId, JointHandle] = {}
        self._spawn_record = SpawnRecord({}, {})
        self._revisions = 0
        self._replacements = 0
        """How often all worlds were replaced."""
        self._first_world: World | None = None
        channel.register("play", PlayRequest, lambda _, request: simulation.play(speed=request.speed), EDIT)
        channel.register("pause", EmptyRequest, lambda _, __: simulation.pause(), EDIT)
        channel.register("step", StepRequest, self._step, RUN)
        channel.register("reset", EmptyRequest, self._reset, EDIT)
        channel.register("details", DetailsRequest, self._details, READ, queue="details")

    # -- for the drawing thread ----------------------------------------------------------------------------------------

    def on_rebuild(self, world: World, *, enclosing: Container[BodyId]) -> bool:
        """Publishes a world in which bodies were added, removed or edited.

        Args:
            enclosing: bodies that are drawn as outlines.

        Returns:
            Whether all worlds were replaced, as by a file or by the undo of that.
        """
        first = next(iter(self._simulation.worlds), None)
        is_replaced = self._first_world is not None and first is not self._first_world
        self._first_world = first
        self._replacements += is_replaced
        self._channel.publish("world", {"number": self._replacements})
        joints: dict[BodyId, list[Joint]] = {}
        for joint in world.joints:
            for end in (joint.parent, joint.child):
                joints.setdefault(end, []).append(joint)
        self._bodies = {body.id: body for body in world.bodies}
        self._joints_by_body, self._joint_handles = joints, {}
        self._spawn_record = SpawnRecord.from_worlds(self._simulation.worlds)
        self._world = world
        tree = scene_tree(
            world,
            engine=self._simulation.engine.name,
            enclosing=enclosing,
            sources=self._simulation.knowledge.sources(),
        )
        self._channel.publish("scene_tree", tree)
        # The tree may be unchanged, for example if only a mass was edited, but open details have to be updated.
        self._revisions += 1
        self._channel.publish("details_changed", self._revisions)
        return is_replaced

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the clock, the undo history, and the live details of selected bodies."""
        self._channel.publish("clock", _clock_message(snapshot))
        self._channel.publish("history", history_message(self._simulation))
        details: dict[BodyId, object] = {}
        for session in self._channel.sessions:
            id = session.state.get(SELECTED)
            if id is not None and id in self._bodies:
                if id not in details:
                    details[id] = self._live(id, snapshot)
                if details[id] is not None:
                    session.publish_to("live_details", details[id])

    def joint(self, id: BodyId) -> JointHandle:
        """The handle of a joint.

        Raises:
            BodyNotFoundError: there is no joint with that id.
        """
        joint = next((each for each in (self._world.joints if self._world else ()) if each.id == id), None)
        if joint is None:
            raise BodyNotFoundError(id, known=[each.id for each in self._world.joints] if self._world else ())
        return self._joint_handle(joint)

    # -- requests ------------------------------------------------------------------------------------------------------

    def _step(self, _: ClientSession, request: StepRequest) -> None:
        self._simulation.pause()
        self._simulation.step(request.duration_s)

    def _reset(self, session: ClientSession, _: EmptyRequest) -> None:
        self._simulation.edits.reset()
        self._channel.tell_others(session, "restored the spawned state; Undo brings back the state before")

    def _details(self, _: ClientSession, request: DetailsRequest) -> BodyDetails:
        body, world = self._described_body(request.id)
        geometry = self._simulation.geometry.get(body.id)
        return body_details(
            body,
            world,
            ancestors=self._simulation.knowledge.ancestors(body.cls),
            joints=self._joints_of(body.id),
            storage_places=self._storage_places(body.cls),
            geometry="" if geometry is None else ": ".join(filter(None, (geometry.shape_name, geometry.reason))),
        )

    def _described_body(self, id: BodyId) -> tuple[Body, World]:
        """A body and its world; waits for a body that was added after the last `on_rebuild`.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        end = time.monotonic() + NEW_BODY_TIME.maximum
        while id not in self._bodies and id in self._simulation.state.ids and time.monotonic() < end:
            time.sleep(_NEW_BODY_POLL_S)
        world, body = self._world, self._bodies.get(id)
        if world is None or body is None:
            raise BodyNotFoundError(id, known=self._bodies, world=world.name if world else "")
        return body, world

    def _storage_places(self, cls: Iri) -> Iterator[StorageHint]:
        """The storage places of a class in this world."""
        ids = {body.iri: body.id for body in self._bodies.values()}
        places: dict[str, list[BodyId]] = {}
        try:
            rows = list(self._simulation.ask(_STORAGE_QUESTION, item=cls))
        except MindstageError:
            return  # a class that no ontology declares
        for row in rows[: STORAGE_PLACES.count]:
            if row.individual in ids:
                places.setdefault(row.place, []).append(ids[row.individual])
        for place, bodies in places.items():
            yield StorageHint(class_name=place.rpartition("#")[2], ids=tuple(dict.fromkeys(bodies)))

    # -- joints --------------------------------------------------------------------------------------------------------

    def _live(self, id: BodyId, snapshot: StateSnapshot) -> object:
        bodies = {id, *(end for each in self._joints_by_body.get(id, ()) for end in (each.parent, each.child))}
        poses = poses_in(snapshot, bodies)
        return live_details(id, poses, self._joints_of(id)) if bodies <= poses.keys() else None

    def _joints_of(self, id: BodyId) -> list[JointHandle]:
        handles = [
            self._joint_handle(each)
            for each in self._joints_by_body.get(id, ())
            if {each.parent, each.child} <= self._bodies.keys()
        ]
        return [handle for handle in handles if handle.axes]

    def _joint_handle(self, joint: Joint) -> JointHandle:
        if joint.id not in self._joint_handles:
            self._joint_handles[joint.id] = JointHandle(joint, self._bodies, self._spawn_record)
        return self._joint_handles[joint.id]


def _clock_message(snapshot: StateSnapshot) -> ClockMessage:
    return ClockMessage(
        time_s=round(snapshot.time_s, 2),
        playing=snapshot.playing,
        speed=snapshot.speed,
        real_time_factor=round(snapshot.real_time_factor, 2),
        bodies=len(snapshot.ids),
        fault=without_paths(snapshot.error),
        expected_rebuild_s=round(snapshot.expected_rebuild_s, 6),
    )


class SelectRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `select`: selects a body or nothing, and optionally moves the camera to it."""

    id: BodyId | None = None
    """The body whose details are shown."""
    further: Annotated[tuple[BodyId, ...], msgspec.Meta(max_length=10_000)] = ()
    """The other selected bodies."""
    focus: bool = False


class FocusRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `focus`: moves the camera to bodies; without any, to the home view."""

    ids: tuple[BodyId, ...] = ()


class ClipPlaneRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_clipping_height`: clips everything above a height [m]; None clips nothing."""

    height: Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)] | None = None


class LabelRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_labels`."""

    mode: LabelMode


class GizmoRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_gizmo`."""

    mode: GizmoMode | None = None


class SetVisibilityRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_visible`: hides bodies for all clients, or shows them again."""

    ids: tuple[BodyId, ...]
    shown: bool


class ShowEnclosuresRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `show_enclosures`: shows or hides the outlines of enclosing bodies, for all clients."""

    shown: bool


class ViewHandler:
    """Handles requests about the 3D view of a page; page and view are associated by the session key."""

    def __init__(
        self,
        views: ClientViews,
        channel: RpcChannel,
        server: viser.ViserServer,
        *,
        exists: Callable[[BodyId], bool],
    ) -> None:
        """Registers the requests.

        Args:
            views: the views of all clients.
            channel: the channel of the pages.
            server: the server of both.
            exists: whether a body is in the simulation, and drawn soon if it is not drawn yet.
        """
        self._views, self._channel, self._server, self._exists = views, channel, server, exists
        channel.register("select", SelectRequest, self._select, READ, queue="view")
        channel.register(
            "focus",
            FocusRequest,
            self._view_handler(lambda view, request: views.focus(request.ids, client=view)),
            READ,
            queue="view",
        )
        channel.register(
            "reset_camera",
            EmptyRequest,
            self._view_handler(lambda view, _: views.go_home(client=view)),
            READ,
            queue="view",
        )
        channel.register(
            "view_from_top",
            EmptyRequest,
            self._view_handler(lambda view, _: views.go_top(client=view)),
            READ,
            queue="view",
        )
        clip = self._view_handler(lambda view, request: views.set_clip_height(request.height, client=view))
        channel.register("set_clipping_height", ClipPlaneRequest, clip, READ, queue="view")
        channel.register(
            "set_labels",
            LabelRequest,
            self._view_handler(lambda view, request: views.set_labels(request.mode, client=view)),
            READ,
            queue="view",
        )
        channel.register(
            "set_gizmo",
            GizmoRequest,
            self._view_handler(lambda view, request: views.set_gizmo(request.mode, client=view)),
            READ,
            queue="view",
        )
        channel.register("set_visible", SetVisibilityRequest, self._show_bodies, READ, queue="view")
        channel.register("show_enclosures", ShowEnclosuresRequest, self._show_enclosures, READ, queue="view")
        views.on_change(self._on_view_selection)
        self.publish()

    def session_of_view(self, view: int) -> ClientSession | None:
        """The session of the page that contains a view."""
        return self._channel.session(self._key_of(view))

    def view_center(self, session: ClientSession) -> Vector | None:
        """The point that the camera of a session looks at [m]; None if its view is not connected."""
        camera = self.camera(session)
        return None if camera is None else camera[1]

    def camera(self, session: ClientSession) -> tuple[Vector, Vector] | None:
        """Where the camera of a session is and what it looks at [m]; None if its view is not connected."""
        for view in self.views_of(session):
            client = self._server.get_clients().get(view)
            if client is not None:
                x, y, z = client.camera.position.tolist()
                looks_at = client.camera.look_at.tolist()
                return (x, y, z), (looks_at[0], looks_at[1], looks_at[2])
        return None

    def _key_of(self, view: int) -> str | None:
        client = self._server.get_clients().get(view)
        return session_key_of(client, self._server) if client is not None else None

    def forget(self) -> None:
        """Selects nothing, and hides nothing."""
        for session in self._channel.sessions:
            session.state.pop(SELECTED, None)
        self._views.select(None)
        self._views.show_bodies(tuple(self._views.hidden), True)

    def publish(self) -> None:
        """Publishes which bodies are hidden."""
        hidden = tuple(sorted(self._views.hidden))
        self._channel.publish("visibility", {"hidden": hidden, "enclosures": self._views.enclosures_shown})

    # -- requests ------------------------------------------------------------------------------------------------------

    def views_of(self, session: ClientSession) -> list[int]:
        """The views of a page; usually one."""
        return [view for view in self._views.clients if self._key_of(view) == session.key]

    def _view_handler(self, action: Callable[[int, Any], None]) -> Callable[[ClientSession, Any], None]:
        def handle(session: ClientSession, request: Any) -> None:
            for view in self.views_of(session):
                action(view, request)

        return handle

    def _select(self, session: ClientSession, request: SelectRequest) -> None:
        """Selects a body; waits for one that was added after the last `on_rebuild`."""
        before, session.state[SELECTED] = session.state.get(SELECTED), request.id
        end = time.monotonic() + NEW_BODY_TIME.maximum
        while True:
            try:
                self._select_in_views(session, request)
                return
            except BodyNotFoundError:
                if request.id is None or not self._exists(request.id) or time.monotonic() > end:
                    session.state[SELECTED] = before
                    raise
            time.sleep(_NEW_BODY_POLL_S)

    def _select_in_views(self, session: ClientSession, request: SelectRequest) -> None:
        for view in self.views_of(session):
            ids = () if request.id is None else (*request.further, request.id)
            self._views.select_several(ids, client=view)
            if request.focus and request.id is not None:
                self._views.focus(ids, client=view)

    def _show_bodies(self, _: ClientSession, request: SetVisibilityRequest) -> None:
        self._views.show_bodies(request.ids, request.shown)
        self.publish()

    def _show_enclosures(self, _: ClientSession, request: ShowEnclosuresRequest) -> None:
        self._views.show_enclosures(request.shown)
        self.publish()

    # -- selection in the view -----------------------------------------------------------------------------------------

    def _on_view_selection(self, view: int) -> None:
        session, selected = self.session_of_view(view), self._views.selected(view)
        # Not sent if the page itself has selected the body.
        if session is not None and session.state.get(SELECTED) != selected:
            session.state[SELECTED] = selected
            session.send_event("selected", self._views.selection(view))


class Handlers:
    """All handlers of a viewer."""

    def __init__(
        self,
        simulation: Simulation,
        channel: RpcChannel,
        views: ClientViews,
        server: viser.ViserServer,
        *,
        prolog: PrologSolver | None = None,
        autosave: bool = False,
    ) -> None:
        """Registers all requests.

        Args:
            channel: the channel of the pages.
            views: the views of all clients.
            server: the server of both.
            prolog: solves Prolog queries; without it they are refused.
            autosave: whether edits are saved automatically.
        """
        self._channel = channel
        channel.on_connect(lambda session: session.publish_to("window", session.name))
        self._world = WorldHandler(simulation, channel)
        self._views = ViewHandler(views, channel, server, exists=lambda body: body in simulation.state.ids)
        self._edits = EditHandler(simulation, channel, find_joint=self._world.joint)
        session_views = SessionViews(views, server, views_of=self._views.views_of)
        self._picker = PointerPicker(simulation, views)
        self._adding = AddHandler(simulation, channel, session_views, self._picker)
        self._tools = ViewToolHandler(simulation, channel, session_views, self._picker)
        self._files = FileHandler(simulation, channel, on_saved=self._on_saved)
        self._autosave: Autosave | None = None
        if autosave:
            self._autosave = Autosave(simulation, channel, is_unsaved=lambda: self._files.is_unsaved)
        self._ask = AskHandler(simulation, channel, prolog=prolog)
        self._places = OutlinePlaces(simulation, channel)
        self._status = StatusHandler(simulation, channel)
        self._tour = TourHandler(simulation, channel, camera=self._views.camera)

    def close(self) -> None:
        """Ends what runs in threads."""
        self._places.close()
        if self._autosave is not None:
            self._autosave.close()

    def _on_saved(self) -> None:
        if self._autosave is not None:
            self._autosave.forget()

    def session_of_view(self, view: int) -> ClientSession | None:
        """The session of the page that contains a view; None if the view was opened without the page."""
        return self._views.session_of_view(view)

    def view_center(self, session: ClientSession) -> Vector | None:
        """The point that the camera of a session looks at [m]; None if its view is not connected."""
        return self._views.view_center(session)

    def move_group(self, id: BodyId, pose: Pose, selection: Collection[BodyId], *, to_surface: bool) -> None:
        """Moves a body, and the other selected ones rigidly with it, as one edit.

        Args:
            pose: its new pose.
            selection: the selected bodies.
            to_surface: whether to put the body down on what is below it.
        """
        self._edits.move_group(id, pose, selection, below=self._picker.below if to_surface else None)

    def toast(self, view: int, text: str, *, kind: str = "error") -> None:
        """Shows a message to the client of a view."""
        if (session := self.session_of_view(view)) is not None:
            session.send_event("toast", {"text": without_paths(text), "kind": kind})

    # -- for the drawing thread ----------------------------------------------------------------------------------------

    def on_rebuild(self, world: World, *, enclosing: Container[BodyId]) -> bool:
        """Publishes a world in which bodies were added, removed or edited.

        Args:
            enclosing: bodies that are drawn as outlines.

        Returns:
            Whether all worlds were replaced; nothing is selected or hidden then.
        """
        if is_replaced := self._world.on_rebuild(world, enclosing=enclosing):
            self._views.forget()
        self._views.publish()
        return is_replaced

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes everything that changes with the state of the simulation; called several times a second."""
        self._world.publish(snapshot)
        self._edits.publish(snapshot)
        self._ask.publish(snapshot)
        self._status.publish(snapshot)

    def show_error(self, text: str) -> None:
        """Publishes an error of the viewer; an empty text clears it."""
        self._channel.publish("viewer_error", without_paths(text))
