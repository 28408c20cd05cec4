"""Edit desk: what visitors change in the world, through the stage's editing, so that it can be undone.

File desk: a world goes to the visitor as a map, and a visitor's map becomes the world.

What comes from a page is a stranger's: it has a limit, no other file is read whatever it imports, and nothing in it is
run. It is read before anything is cleared, so that a map that cannot be read changes nothing.

World desk: what is there, how time runs, and what is known of what a visitor has selected.

View desk: what a visitor wants to see, told by the page, done in the view that the page holds.

Desks: everything that pages ask for, and are told, in one place.
"""

from __future__ import annotations

import re
import time
import weakref
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal
from urllib.parse import unquote, urlsplit

import msgspec
import viser

from mindstage.errors import BodyNotFoundError, InvalidArgumentError, MapNotFoundError, MindstageError
from mindstage.knowledge import KnowledgeBase, MapDialect, MapFormat, SourceMapView, write_map
from mindstage.knowledge.names import EntityType
from mindstage.knowledge.rdf import local_name
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Joint, Material, Mobility, Pose, Quaternion, Vector, World
from mindstage.scene.colors import parse_color
from mindstage.scene.transforms import pose_from_array
from mindstage.simulation import JointHandle, Simulation, SpawnRecord, StateSnapshot
from mindstage.simulation.placement import make_body
from mindstage.simulation.state import poses_in
from mindstage.simulation.undo import MoveBody
from mindstage.viewer.ask import AskHandler
from mindstage.viewer.camera import ClientViews, GizmoMode, LabelMode
from mindstage.viewer.inspector import BodyDetails, StatusHandler, StorageHint, body_details, live_details, scene_tree
from mindstage.viewer.server import ClientSession, EmptyRequest, RpcChannel, session_key_of

__all__ = ["SELECTED", "ClockMessage", "EditHandler", "FileHandler", "Handlers", "ViewHandler", "WorldHandler"]


_SUFFIXES = (".owl", ".rdf", ".xml", ".ttl", ".urdf")
_MAX_TEXT_LENGTH = 20_000_000
_TYPES = {MapFormat.RDF_XML: (".owl", "application/rdf+xml"), MapFormat.TURTLE: (".ttl", "text/turtle")}


class SaveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asks for the world as a map."""

    format: MapFormat = MapFormat.RDF_XML
    dialect: MapDialect | None = None
    """None is that of the map that was spawned, where there is one."""


class LoadRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A map from a visitor's disk."""

    name: Annotated[str, msgspec.Meta(max_length=300)]
    text: Annotated[str, msgspec.Meta(max_length=_MAX_TEXT_LENGTH)]


class FileHandler:
    """Writes maps for visitors, and reads theirs."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Offers what it does."""
        self._simulation, self._channel = simulation, channel
        self._loaded: KnowledgeBase | None = None
        channel.register("save", SaveRequest, self._save, queue="files")
        channel.register("load", LoadRequest, self._load, queue="files")

    def _save(self, _: ClientSession, request: SaveRequest) -> dict[str, str]:
        world = self._simulation.snapshot()
        origin = self._origin(world) if request.dialect is None else None
        dialect = request.dialect or MapDialect.SEMLOG
        text = write_map(world, format=request.format, dialect=dialect, source_view=origin)
        suffix, kind = _TYPES[request.format]
        return {"name": f"{_safe_filename(world.name) or 'map'}{suffix}", "type": kind, "text": text}

    def _origin(self, world: World) -> SourceMapView | None:
        try:
            return self._simulation.knowledge.source_view(world.iri)
        except MapNotFoundError:
            return None  # it was never a map: it is written in our own words

    def _load(self, _: ClientSession, request: LoadRequest) -> dict[str, object]:
        knowledge, world = self._read(request)
        playing, speed = self._simulation.state.playing, self._simulation.state.speed
        self._simulation.set_knowledge(knowledge)
        before, self._loaded = self._loaded, knowledge
        report = self._simulation.spawn(world)
        if before is not None:
            before.close()
        if playing:
            self._simulation.play(speed=speed)
        failed = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
        return {
            "name": world.name,
            "bodies": report.bodies,
            "joints": report.joints,
            "failed": [{"id": each.id, "reason": each.reason} for each in failed[:50]],
            "findings": len(knowledge.findings()),
        }

    def _read(self, request: LoadRequest) -> tuple[KnowledgeBase, World]:
        """What a text says, beside what is known of classes.

        Raises:
            InvalidArgumentError: it is no map by its name, or wants other files to be read.
            KnowledgeError: it cannot be read, or no map is in it.
        """
        suffix = Path(request.name).suffix.lower()
        if suffix not in _SUFFIXES:
            raise InvalidArgumentError(request.name, cause=f"a map ends in {', '.join(_SUFFIXES)}")
        if "xacro" in request.text:
            raise InvalidArgumentError(request.name, cause="xacro reads other files; expand it first")
        knowledge = self._simulation.knowledge.ontologies_only()
        folder = TemporaryDirectory(prefix="mindstage-")
        # The text is read again when the map is written in its own words, so it stays as long as what is known of it.
        weakref.finalize(knowledge, folder.cleanup)
        try:
            path = Path(folder.name, f"{_safe_filename(Path(request.name).stem) or 'map'}{suffix}")
            path.write_text(request.text, encoding="utf-8")
            knowledge.load(path, follow_imports=False)
            world = knowledge.world()
            for body in world.bodies:
                if body.mesh and _is_outside_path(body.mesh):
                    cause = f"the mesh of {body.id!r} is named by its place on a disk, and a page may read no disk"
                    raise InvalidArgumentError(
                        request.name, cause=cause, remedy="spawn such a map from the command line"
                    )
            return knowledge, world
        except BaseException:
            knowledge.close()
            raise


def _is_outside_path(name: str) -> bool:
    """Whether a mesh's name is a path of its own, not one in a package or in a folder that somebody opened."""
    parts = urlsplit(unquote(name).replace("\\", "/"))
    return (
        parts.scheme == "file"
        or (parts.path.startswith("/") and parts.scheme != "package")
        or ".." in parts.path.split("/")
    )


def _safe_filename(name: str) -> str:
    """A file's name with nothing in it but letters and digits."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.")[:80]


SELECTED = "selected"
"""What a visitor has selected, in the visitor's `state`."""
_MAX_STEP_S = 10.0
_DETAILS_LIFETIME_S = 5.0
_DETAILS_INTERVAL_S = 0.03
_STORAGE_QUESTION = "storage_place_in_environment"
_MAX_STORAGE_PLACES = 12


class PlayRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lets time pass."""

    speed: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 1.0


class StepRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lets some time pass, and no more."""

    duration_s: Annotated[float, msgspec.Meta(gt=0.0, le=_MAX_STEP_S)] = 0.1


class DetailsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A body."""

    id: BodyId


class ClockMessage(msgspec.Struct, frozen=True, kw_only=True):
    """How time runs."""

    time_s: float
    playing: bool
    speed: float
    real_time_factor: float
    """Simulated seconds in a second."""
    bodies: int
    fault: str


class WorldHandler:
    """Tells all pages of the world, and does what their buttons of time say."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Offers what it does.

        Args:
            stage: whose world it is.
            channel: to the pages.
        """
        self._simulation, self._channel = simulation, channel
        self._world: World | None = None
        self._bodies: Mapping[BodyId, Body] = {}
        self._joint_by_id: Mapping[BodyId, Sequence[Joint]] = {}
        self._joints: dict[BodyId, JointHandle] = {}
        self._spawn_record = SpawnRecord({}, {})
        self._revisions = 0
        channel.register("play", PlayRequest, lambda _, wish: simulation.play(speed=wish.speed))
        channel.register("pause", EmptyRequest, lambda _, wish: simulation.pause())
        channel.register("step", StepRequest, self._step)
        channel.register("reset", EmptyRequest, lambda _, wish: simulation.undo_stack.reset())
        channel.register("details", DetailsRequest, self._details, queue="details")

    # -- for the thread that follows the world -------------------------------------------------------------------------

    def on_rebuild(self, world: World, *, enclosing: Container[BodyId]) -> None:
        """Something came, went or changed."""
        constraints: dict[BodyId, list[Joint]] = {}
        for joint in world.joints:
            for end in (joint.parent, joint.child):
                constraints.setdefault(end, []).append(joint)
        self._bodies = {body.id: body for body in world.bodies}
        self._joint_by_id, self._joints = constraints, {}
        self._spawn_record = SpawnRecord.from_worlds(self._simulation.worlds)
        self._world = world
        self._channel.publish("scene_tree", scene_tree(world, engine=self._simulation.engine_name, enclosing=enclosing))
        # The outline is the same where only a mass has changed; whoever reads the details has to look again.
        self._revisions += 1
        self._channel.publish("details_changed", self._revisions)

    def publish(self, frame: StateSnapshot) -> None:
        """Tells what changes all the time; called some times in a second."""
        self._channel.publish("clock", _clock_message(frame))
        self._channel.publish("history", _undo_labels(self._simulation))
        told: dict[BodyId, object] = {}
        for visitor in self._channel.sessions:
            id = visitor.state.get(SELECTED)
            if id is not None and id in self._bodies:
                if id not in told:
                    told[id] = self._live(id, frame)
                if told[id] is not None:
                    visitor.publish_to("live_details", told[id])

    def joint(self, id: BodyId) -> JointHandle:
        """A constraint of the world.

        Raises:
            BodyNotFoundError: there is none of that id.
        """
        constraint = next((each for each in (self._world.joints if self._world else ()) if each.id == id), None)
        if constraint is None:
            raise BodyNotFoundError(id, known=[each.id for each in self._world.joints] if self._world else ())
        return self._joint_handle(constraint)

    # -- what is asked -------------------------------------------------------------------------------------------------

    def _step(self, _: ClientSession, request: StepRequest) -> None:
        self._simulation.pause()
        self._simulation.step(request.duration_s)

    def _details(self, _: ClientSession, request: DetailsRequest) -> BodyDetails:
        body, world = self._described_body(request.id)
        form = self._simulation.geometry.get(body.id)
        return body_details(
            body,
            world,
            ancestors=self._simulation.knowledge.ancestors(body.cls),
            joints=self._joints_of(body.id),
            storage_places=self._storage_places(body.cls),
            geometry="" if form is None else f"{form.shape_name}: {form.reason}" if form.reason else form.shape_name,
        )

    def _described_body(self, id: BodyId) -> tuple[Body, World]:
        """A body as it is described; what has just come is there a moment before it was looked at.

        Raises:
            BodyNotFoundError: there is none of that id.
        """
        end = time.monotonic() + _DETAILS_LIFETIME_S
        while id not in self._bodies and id in self._simulation.state.ids and time.monotonic() < end:
            time.sleep(_DETAILS_INTERVAL_S)
        world, body = self._world, self._bodies.get(id)
        if world is None or body is None:
            raise BodyNotFoundError(id, known=self._bodies, world=world.name if world else "")
        return body, world

    def _storage_places(self, cls: Iri) -> Iterator[StorageHint]:
        """Where such things are kept, as far as it is known."""
        ids = {body.iri: body.id for body in self._bodies.values()}
        places: dict[str, list[BodyId]] = {}
        try:
            rows = list(self._simulation.ask(_STORAGE_QUESTION, item=cls))
        except MindstageError:
            return  # a class that only the map names, of which nothing is known: no answer is no error here
        for row in rows[:_MAX_STORAGE_PLACES]:
            if row.individual in ids:
                places.setdefault(row.place, []).append(ids[row.individual])
        for place, found in places.items():
            yield StorageHint(class_name=place.rpartition("#")[2], ids=tuple(dict.fromkeys(found)))

    # -- joints --------------------------------------------------------------------------------------------------------

    def _live(self, id: BodyId, frame: StateSnapshot) -> object:
        wanted = {id, *(end for each in self._joint_by_id.get(id, ()) for end in (each.parent, each.child))}
        poses = poses_in(frame, wanted)
        return live_details(id, poses, self._joints_of(id)) if wanted <= poses.keys() else None

    def _joints_of(self, id: BodyId) -> list[JointHandle]:
        found = [
            self._joint_handle(each)
            for each in self._joint_by_id.get(id, ())
            if {each.parent, each.child} <= self._bodies.keys()
        ]
        return [joint for joint in found if joint.axes]

    def _joint_handle(self, joint: Joint) -> JointHandle:
        if joint.id not in self._joints:
            self._joints[joint.id] = JointHandle(joint, self._bodies, self._spawn_record)
        return self._joints[joint.id]


def _clock_message(frame: StateSnapshot) -> ClockMessage:
    return ClockMessage(
        time_s=round(frame.time_s, 2),
        playing=frame.playing,
        speed=frame.speed,
        real_time_factor=round(frame.real_time_factor, 2),
        bodies=len(frame.ids),
        fault=frame.error,
    )


def _undo_labels(simulation: Simulation) -> dict[str, str | None]:
    """What the two buttons would do."""
    history = simulation.undo_stack.history
    return {"undo": next(iter(history.undo), None), "redo": next(iter(history.redo), None)}


class SelectRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Selects a body, or nothing, and flies to it if asked."""

    id: BodyId | None = None
    focus: bool = False


class FocusRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Flies to bodies; to the whole place without any."""

    ids: tuple[BodyId, ...] = ()


class ClipPlaneRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hides what is above a height."""

    height: Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)] | None = None


class LabelRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Writes names beside bodies."""

    mode: LabelMode


class GizmoRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gives the selected body handles."""

    mode: GizmoMode | None = None


class SetVisibilityRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hides bodies, or shows them again, for all visitors."""

    ids: tuple[BodyId, ...]
    shown: bool


class ShowEnclosuresRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Draws the outlines of what encloses the place, or not, for all visitors."""

    shown: bool


class ViewHandler:
    """Brings each page and the view in it together; they find one another by the visitor's key."""

    def __init__(self, views: ClientViews, channel: RpcChannel, server: viser.ViserServer) -> None:
        """Offers what it does.

        Args:
            sights: all views.
            channel: to the pages.
            server: that serves both.
        """
        self._views, self._channel, self._server = views, channel, server
        channel.register("select", SelectRequest, self._select, queue="look")
        channel.register(
            "focus",
            FocusRequest,
            self._view_handler(lambda view, wish: views.focus(wish.ids, client=view)),
            queue="look",
        )
        channel.register(
            "reset_camera",
            EmptyRequest,
            self._view_handler(lambda view, wish: views.go_home(client=view)),
            queue="look",
        )
        channel.register(
            "view_from_top",
            EmptyRequest,
            self._view_handler(lambda view, wish: views.go_top(client=view)),
            queue="look",
        )
        section = self._view_handler(lambda view, wish: views.set_clip_height(wish.height, client=view))
        channel.register("set_clipping_height", ClipPlaneRequest, section, queue="look")
        channel.register(
            "set_labels",
            LabelRequest,
            self._view_handler(lambda view, wish: views.set_labels(wish.mode, client=view)),
            queue="look",
        )
        channel.register(
            "set_gizmo",
            GizmoRequest,
            self._view_handler(lambda view, wish: views.set_gizmo(wish.mode, client=view)),
            queue="look",
        )
        channel.register("set_visible", SetVisibilityRequest, self._show_bodies, queue="look")
        channel.register("show_enclosures", ShowEnclosuresRequest, self._show_enclosures, queue="look")
        views.on_change(self._on_view_selection)
        self.publish()

    def session_of_view(self, view: int) -> ClientSession | None:
        """Who sees a view."""
        return self._channel.session(self._key_of(view))

    def view_center(self, session: ClientSession) -> Vector | None:
        """What a visitor looks at; None where the view is not there yet."""
        for view in self._view_of(session):
            client = self._server.get_clients().get(view)
            if client is not None:
                x, y, z = client.camera.look_at.tolist()
                return x, y, z
        return None

    def _key_of(self, view: int) -> str | None:
        client = self._server.get_clients().get(view)
        return session_key_of(client, self._server) if client is not None else None

    def publish(self) -> None:
        """Tells all what nobody sees."""
        hidden = tuple(sorted(self._views.hidden))
        self._channel.publish("visibility", {"hidden": hidden, "enclosures": self._views.enclosures_shown})

    # -- what the page asks --------------------------------------------------------------------------------------------

    def _view_of(self, visitor: ClientSession) -> list[int]:
        return [view for view in self._views.clients if self._key_of(view) == visitor.key]

    def _view_handler(self, action: Callable[[int, Any], None]) -> Callable[[ClientSession, Any], None]:
        def handle(visitor: ClientSession, wish: Any) -> None:
            for view in self._view_of(visitor):
                action(view, wish)

        return handle

    def _select(self, session: ClientSession, request: SelectRequest) -> None:
        before, session.state[SELECTED] = session.state.get(SELECTED), request.id
        try:
            for view in self._view_of(session):
                self._views.select(request.id, client=view)
                if request.focus and request.id is not None:
                    self._views.focus([request.id], client=view)
        except BodyNotFoundError:
            session.state[SELECTED] = before
            raise

    def _show_bodies(self, _: ClientSession, request: SetVisibilityRequest) -> None:
        self._views.show_bodies(request.ids, request.shown)
        self.publish()

    def _show_enclosures(self, _: ClientSession, request: ShowEnclosuresRequest) -> None:
        self._views.show_enclosures(request.shown)
        self.publish()

    # -- what happens in the view --------------------------------------------------------------------------------------

    def _on_view_selection(self, view: int) -> None:
        visitor, chosen = self.session_of_view(view), self._views.selected(view)
        # What the page itself selected it knows already.
        if visitor is not None and visitor.state.get(SELECTED) != chosen:
            visitor.state[SELECTED] = chosen
            visitor.send_event("selected", chosen)


_Meters = Annotated[float, msgspec.Meta(ge=-10_000.0, le=10_000.0)]
_Extent = Annotated[float, msgspec.Meta(ge=0.001, le=1000.0)]
_SLIDER_SETTLE_S = 2.0
"""After a slider was let go the hand holds on until the joint is there, or so long."""
_JOINT_TOLERANCE = 0.004
_MAX_CLASSES = 60
_CLEARANCE_M = 0.002


class MoveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Puts a body somewhere else."""

    id: BodyId
    position: tuple[_Meters, _Meters, _Meters]
    quaternion: Quaternion


class SetPhysicsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Changes what is given of a body's physics."""

    id: BodyId
    mobility: Mobility | msgspec.UnsetType = msgspec.UNSET
    gravity: bool | msgspec.UnsetType = msgspec.UNSET
    mass_kg: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | msgspec.UnsetType = msgspec.UNSET


class SetMaterialRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gives a body one surface instead of those that it has; none, where nothing is named."""

    id: BodyId
    name: Annotated[str, msgspec.Meta(max_length=200)] = ""
    color: str | None = None


class MoveJointRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Opens or shuts a joint, by hand where time passes."""

    id: BodyId
    axis: Literal["x", "y", "z", "twist", "swing2", "swing1"]
    value: _Meters
    done: bool = True
    """Whether the hand is opened then; False while a slider is dragged."""


class AttachRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Attaches a body to another one; to none, detaches it."""

    child: BodyId
    parent: BodyId | None = None


class DeleteRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Removes bodies."""

    ids: Annotated[tuple[BodyId, ...], msgspec.Meta(min_length=1, max_length=10_000)]


class FindClassesRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Looks for classes by a part of their names."""

    text: Annotated[str, msgspec.Meta(max_length=200)] = ""


class AddRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"cls": "class"}):
    """Drops in a new thing."""

    cls: Annotated[str, msgspec.Meta(min_length=1, max_length=2000)]
    on: BodyId | None = None
    """What it comes to stand on."""
    into: BodyId | None = None
    at: tuple[_Meters, _Meters, _Meters] | None = None
    """Where its lower side comes to be, if it is put on nothing; without it, where the visitor looks."""
    size: tuple[_Extent, _Extent, _Extent] | None = None


class EditHandler:
    """Does what pages ask to have changed; each edit is undone by anybody."""

    def __init__(
        self,
        simulation: Simulation,
        channel: RpcChannel,
        world_handler: WorldHandler,
        *,
        view_center: Callable[[ClientSession], Vector | None],
    ) -> None:
        """Offers what it does.

        Args:
            stage: whose world is changed.
            channel: to the pages.
            worlds: knows the joints.
            aim: tells what a visitor looks at.
        """
        self._simulation, self._world_handler, self._view_center = simulation, world_handler, view_center
        self._joint_drags: dict[BodyId, _JointDrag] = {}
        editing = simulation.undo_stack
        channel.register("move", MoveRequest, self._move)
        channel.register("set_physics", SetPhysicsRequest, self._set_physics)
        channel.register("set_material", SetMaterialRequest, self._set_material)
        channel.register("move_joint", MoveJointRequest, self._move_joint)
        channel.register("attach", AttachRequest, self._attach)
        channel.register("delete", DeleteRequest, lambda _, wish: editing.delete(wish.ids))
        channel.register("undo", EmptyRequest, lambda _, wish: editing.undo())
        channel.register("redo", EmptyRequest, lambda _, wish: editing.redo())
        channel.register("find_classes", FindClassesRequest, self._find_classes, queue="look")
        channel.register("add", AddRequest, self._add)
        channel.on_disconnect(self._release)

    def publish(self, frame: StateSnapshot) -> None:
        """Opens the hands whose joints have arrived; called some times in a second."""
        for id, slide in list(self._joint_drags.items()):
            if slide.release_time is None:
                continue
            try:
                joint = self._world_handler.joint(slide.joint)
                poses = poses_in(frame, {joint.joint.parent, joint.joint.child})
                there = abs(joint.positions(poses)[slide.axis] - slide.value) < _JOINT_TOLERANCE
            except (BodyNotFoundError, KeyError):  # it was deleted meanwhile
                there = True
            if there or time.monotonic() > slide.release_time or not frame.playing:
                self._joint_drags.pop(id, None)
                self._simulation.release(id)

    # -- what a body is ------------------------------------------------------------------------------------------------

    def _move(self, _: ClientSession, request: MoveRequest) -> None:
        if not any(request.quaternion):
            raise InvalidArgumentError("quaternion", cause="four zeros are no rotation")
        self._simulation.undo_stack.move(request.id, Pose(request.position, request.quaternion))

    def _set_physics(self, _: ClientSession, request: SetPhysicsRequest) -> None:
        changes = {
            name: value
            for name in ("mobility", "gravity", "mass_kg")
            if (value := getattr(request, name)) is not msgspec.UNSET
        }
        physics: BodyPhysics = msgspec.structs.replace(self._body(request.id).physics, **changes)
        self._simulation.undo_stack.set_physics(
            request.id, physics, label=" and ".join(changes).replace("_kg", "") or "physics"
        )

    def _set_material(self, _: ClientSession, request: SetMaterialRequest) -> None:
        if not request.name and request.color is None:
            self._simulation.undo_stack.set_materials(request.id, ())
            return
        known = next((each for each in self._body(request.id).materials if each.name == request.name), None)
        color = None if request.color is None else parse_color(request.color)
        material = Material(name=request.name or "paint", path=known.path if known else "", color=color)
        self._simulation.undo_stack.set_materials(request.id, (material,))

    def _attach(self, _: ClientSession, request: AttachRequest) -> None:
        if request.parent is None:
            self._simulation.undo_stack.detach(request.child)
        else:
            self._simulation.undo_stack.attach(request.parent, request.child)

    def _body(self, id: BodyId) -> Body:
        return self._simulation.snapshot().body(id)

    # -- joints --------------------------------------------------------------------------------------------------------

    def _move_joint(self, session: ClientSession, request: MoveJointRequest) -> None:
        """Pulls while time passes, so that what is in the way stops it; puts it there while time stands still."""
        joint, frame = self._world_handler.joint(request.id), self._simulation.state
        if request.axis not in {axis.name for axis in joint.axes}:
            raise InvalidArgumentError(request.axis, cause=f"{request.id!r} does not move so")
        poses = poses_in(frame, {joint.joint.parent, joint.joint.child})
        going_on = self._joint_drags.get(joint.moving_body)
        before = going_on.start_pose if going_on is not None else pose_from_array(poses[joint.moving_body])
        ends = time.monotonic() + _SLIDER_SETTLE_S if request.done else None
        self._joint_drags[joint.moving_body] = _JointDrag(
            request.id, request.axis, request.value, session.key, before, ends
        )
        if not frame.playing:
            pose = joint.pose_for(request.axis, request.value, poses)
            self._simulation.undo_stack.move(joint.moving_body, pose, continues_last=going_on is not None)
            return
        pull = joint.pull_target(request.axis, request.value, poses)
        self._simulation.pull(pull.id, point=pull.point, target=pull.target)
        if request.done:
            self._simulation.undo_stack.record(MoveBody(joint.moving_body, before, f"pose of {joint.moving_body}"))

    def _release(self, session: ClientSession) -> None:
        for id, slide in list(self._joint_drags.items()):
            if slide.session == session.key:
                self._joint_drags.pop(id, None)
                self._simulation.release(id)

    # -- new things ----------------------------------------------------------------------------------------------------

    def _find_classes(self, _: ClientSession, request: FindClassesRequest) -> list[dict[str, object]]:
        knowledge, text = self._simulation.knowledge, request.text.strip().casefold()
        with knowledge.lock:
            known = {iri: local_name(iri) for iri in knowledge.reasoner.declared_classes() if not iri.startswith("_:")}
            here = {body.cls for world in self._simulation.worlds for body in world.bodies}
            known |= {cls: local_name(cls) for cls in here}
            matching = [iri for iri, name in known.items() if text in name.casefold()]
            matching.sort(key=lambda iri: _search_rank(known[iri], text, is_here=iri in here))
            return [
                {"class": iri, "name": known[iri], "size": getattr(knowledge.shape_rule(iri), "size", None)}
                for iri in matching[:_MAX_CLASSES]
            ]

    def _add(self, session: ClientSession, request: AddRequest) -> BodyId:
        knowledge = self._simulation.knowledge
        with knowledge.lock:
            cls = knowledge.names.find(request.cls, EntityType.CLASS)
        body = self._make_body(cls, request.size)
        if request.on is not None or request.into is not None:
            put = self._simulation.place(body, on=request.on, into=request.into)
            self._simulation.undo_stack.record_spawn([put.id])
            return put.id
        x, y, z = request.at or self._view_center(session) or (0.0, 0.0, 0.0)
        height = body.size[2] if body.size else 0.0
        placed = msgspec.structs.replace(body, pose=Pose((x, y, z + height / 2 + _CLEARANCE_M)))
        self._spawn(placed)
        return placed.id

    def _make_body(self, cls: Iri, size: Vector | None) -> Body:
        return make_body(self._simulation, cls, size=size)

    def _spawn(self, body: Body) -> None:
        first = next(iter(self._simulation.worlds), None)
        iri, name = (first.iri, first.name) if first else (Iri("http://mindstage.org/maps/new.owl#map"), "new")
        report = self._simulation.spawn(World(iri=iri, name=name, bodies=(body,)), persistent=False)
        for failure in report.failed_bodies:
            raise InvalidArgumentError(failure.id, cause=failure.reason)
        self._simulation.undo_stack.record_spawn([body.id])


class _JointDrag(msgspec.Struct, frozen=True):
    """A joint that somebody moves by its slider."""

    joint: BodyId
    axis: str
    value: float
    session: str
    start_pose: Pose
    """Where the moving end was at first."""
    release_time: float | None
    """When the hand opens at the latest; None while the slider is held [s of the monotonic clock]."""


def _search_rank(name: str, text: str, *, is_here: bool) -> tuple[bool, bool, bool, int, str]:
    """What is meant most likely comes first: the very name, what begins so, what the place has already."""
    small = name.casefold()
    return small != text, not small.startswith(text), not is_here, len(name), name


class Handlers:
    """One desk for each kind of request."""

    def __init__(
        self, simulation: Simulation, channel: RpcChannel, views: ClientViews, server: viser.ViserServer
    ) -> None:
        """Offers all that a page can ask for.

        Args:
            stage: whose world it is about.
            channel: to the pages.
            sights: the views in them.
            server: that serves both.
        """
        self._channel = channel
        self._world = WorldHandler(simulation, channel)
        self._views = ViewHandler(views, channel, server)
        self._edits = EditHandler(simulation, channel, self._world, view_center=self._views.view_center)
        self._files = FileHandler(simulation, channel)
        self._asking = AskHandler(simulation, channel)
        self._status = StatusHandler(simulation, channel)

    def session_of_view(self, view: int) -> ClientSession | None:
        """Who sees a view; None where somebody opened a view by itself."""
        return self._views.session_of_view(view)

    def toast(self, view: int, text: str, *, kind: str = "error") -> None:
        """Shows a sentence to the visitor of a view."""
        if (visitor := self.session_of_view(view)) is not None:
            visitor.send_event("toast", {"text": text, "kind": kind})

    # -- for the thread that follows the world -------------------------------------------------------------------------

    def on_rebuild(self, world: World, *, enclosing: Container[BodyId]) -> None:
        """Something came, went or changed."""
        self._world.on_rebuild(world, enclosing=enclosing)
        self._views.publish()

    def publish(self, frame: StateSnapshot) -> None:
        """Tells what changes all the time; called some times in a second."""
        self._world.publish(frame)
        self._edits.publish(frame)
        self._asking.publish(frame)
        self._status.publish(frame)

    def show_error(self, text: str) -> None:
        """Says what is wrong with the page itself; nothing, where all is well again."""
        self._channel.publish("viewer_error", text)
