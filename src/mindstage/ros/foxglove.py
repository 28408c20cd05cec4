"""A Foxglove WebSocket server: scene, transforms, events, parameters and services of a simulation.

It takes the extra `foxglove`, whose SDK runs the connections; one thread of this module publishes.

- `/scene` (foxglove.SceneUpdate): an entity for each body and each marker, in the frame of the body. What changed is
  published; a new subscriber causes a complete update.
- `/tf` (foxglove.FrameTransforms): the tree of `mindstage.ros.frames`.
- `/events` (foxglove.Log): bodies that were added or removed, highlights with their labels, errors, play and pause.
- Parameters: `paused` and `speed` can be set; `engine`, `map` and `bodies` cannot.
- Services with JSON: `/mindstage/ask`, `/mindstage/place`, `/mindstage/highlight`, `/mindstage/reset`.

Time stamps are simulated time, which is also the time of the server.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import StrEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
from msgspec.structs import replace

from mindstage.errors import FoxgloveUnavailableError, InvalidArgumentError, MindstageError
from mindstage.knowledge.queries import answers_to_builtins
from mindstage.ros.frames import ROOT_FRAME, FrameTransforms
from mindstage.ros.state import StateReader
from mindstage.scene import Body, BodyGeometry, BodyId, Color, Pose, PrimitiveType, Vector
from mindstage.scene.display import counted
from mindstage.scene.transforms import normalized_pose_array, pose_multiply
from mindstage.simulation import ConnectedClient, Marker, MarkerType, Simulation, StateSnapshot

if TYPE_CHECKING:
    from foxglove import Parameter, Service, ServiceRequest
    from foxglove.websocket import ChannelView, Client

__all__ = ["FoxgloveServer"]

_PERIOD_S = 1 / 30
"""Interval of publication [s]."""
_IDLE_PERIOD_S = 1.0
"""Interval at which unchanged transforms and the time are published again [s]."""
_SCENE_PERIOD_S = 0.1
"""Least interval between two updates of the scene [s]."""
_JOIN_TIMEOUT_S = 10.0
_DEFAULT_SIZE_M: Vector = (0.05, 0.05, 0.05)
_GRAY: Color = (0.7, 0.7, 0.7)
_HIGHLIGHT_OPACITY = 0.85
_SCENE, _TF, _EVENTS = "/scene", "/tf", "/events"
_JSON = "json"
_MAX_LISTED = 10
"""Ids that are listed in the text of an event."""
_log = logging.getLogger("mindstage.ros")


def _import_sdk() -> Any:
    """Imports the SDK.

    Raises:
        FoxgloveUnavailableError: it is not installed.
    """
    try:
        import foxglove
        import foxglove.channels
        import foxglove.messages
        import foxglove.websocket
    except ImportError as error:
        remedy = "install the extra: pip install 'mindstage[foxglove]'"
        raise FoxgloveUnavailableError(str(error), remedy=remedy) from error
    return foxglove


class FoxgloveServer:
    """Serves a simulation to the Foxglove app until `close`; the simulation is not closed.

    The SDK accepts every client that can reach the port and does not check tokens or origins.
    """

    def __init__(self, simulation: Simulation, *, port: int = 8765, host: str = "127.0.0.1") -> None:
        """Starts the server.

        Args:
            simulation: the simulation.
            port: the port; 0 chooses a free one.
            host: the address to listen at.

        Raises:
            FoxgloveUnavailableError: the SDK is not installed, or it cannot listen at this address.
        """
        self._sdk = sdk = _import_sdk()
        self._simulation = simulation
        self._state_reader = StateReader(simulation)
        self._parameters = _Parameters(sdk, simulation)
        self._listener = _Listener(self._parameters)
        self._context = sdk.Context()
        self._scene = sdk.channels.SceneUpdateChannel(_SCENE, context=self._context)
        self._tf = sdk.channels.FrameTransformsChannel(_TF, context=self._context)
        self._events = sdk.channels.LogChannel(_EVENTS, context=self._context)
        self.host = host
        capability = sdk.websocket.Capability
        try:
            self._server = sdk.start_server(
                name="mindstage",
                host=host,
                port=port,
                context=self._context,
                capabilities=[capability.Parameters, capability.Services, capability.Time],
                supported_encodings=[_JSON],
                services=list(_services(sdk, simulation)),
                server_listener=self._listener,
            )
        except (RuntimeError, ValueError, OSError, OverflowError) as error:
            cause = f"{host}, port {port}: {error}"
            raise FoxgloveUnavailableError(cause, remedy="try 127.0.0.1 or another port") from error
        self._publisher = _ScenePublisher(sdk, self._state_reader)
        self._remove_client_source = simulation.clients.add_client_source(self._listener.clients)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mindstage-foxglove", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port at which it listens."""
        return int(self._server.port)

    @property
    def url(self) -> str:
        """The address of the server."""
        return f"ws://{self.host}:{self._server.port}"

    def close(self) -> None:
        """Stops publishing and disconnects all clients; calling it again is harmless."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._remove_client_source()
        self._thread.join(_JOIN_TIMEOUT_S)
        self._server.stop()
        for channel in (self._scene, self._tf, self._events):
            channel.close()

    def __enter__(self) -> FoxgloveServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- publication ---------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        tasks = _Tasks(self)
        while not self._closing.wait(_PERIOD_S):
            try:
                tasks.publish(self._simulation.state, self._listener.take_new_topics(), time.monotonic())
            except MindstageError as error:
                _log.debug("not published: %s", error)  # the state has the error, which is published as an event
            except Exception:
                _log.exception("a message to Foxglove could not be published")


class _Tasks:
    """What is published periodically; used by one thread."""

    def __init__(self, server: FoxgloveServer) -> None:
        self._server = server
        self._events = _EventLog(server._simulation)
        self._last_tf: tuple[object, float] = (None, 0.0)
        self._last_static: FrameTransforms | None = None
        self._last_time: tuple[float, float] = (-1.0, 0.0)
        self._last_scene: tuple[object, float] = (None, 0.0)

    def publish(self, snapshot: StateSnapshot, new_topics: frozenset[str], now_s: float) -> None:
        """Publishes what has changed, and what new subscribers lack.

        Args:
            snapshot: the state.
            new_topics: topics with a new subscriber.
            now_s: time of a monotonic clock [s].
        """
        server, time_ns = self._server, round(snapshot.time_s * 1e9)
        last_time_s, last_published_s = self._last_time
        if snapshot.time_s != last_time_s or now_s - last_published_s >= _IDLE_PERIOD_S:
            server._server.broadcast_time(time_ns)
            self._last_time = snapshot.time_s, now_s
        for level, text in self._events.new_entries(snapshot):
            stamp = _timestamp(server._sdk, snapshot.time_s)
            kind = getattr(server._sdk.messages.LogLevel, level.value)
            log = server._sdk.messages.Log(timestamp=stamp, level=kind, message=text, name="mindstage")
            server._events.log(log, log_time=time_ns)
        if changed := server._parameters.changed():
            server._server.publish_parameter_values(changed)
        for text in server._parameters.take_refusals():
            server._server.publish_status(text, server._sdk.StatusLevel.Warning)
        if server._tf.has_sinks():
            self._publish_tf(snapshot, _TF in new_topics, now_s)
        if server._scene.has_sinks():
            self._publish_scene(snapshot, _SCENE in new_topics, now_s)

    def _publish_tf(self, snapshot: StateSnapshot, complete: bool, now_s: float) -> None:
        last, published_s = self._last_tf
        if last is snapshot.poses and not complete and now_s - published_s < _IDLE_PERIOD_S:
            return
        tree = self._server._state_reader.frame_tree(now_s=now_s)
        moving, static = tree.transforms(snapshot.ids, snapshot.poses)
        transforms = list(self._transforms(moving, snapshot.time_s))
        is_idle = now_s - published_s >= _IDLE_PERIOD_S
        if complete or is_idle or self._last_static is None or not static.equals(self._last_static):
            transforms += self._transforms(static, snapshot.time_s)
            self._last_static = static
        message = self._server._sdk.messages.FrameTransforms(transforms=transforms)
        self._server._tf.log(message, log_time=round(snapshot.time_s * 1e9))
        self._last_tf = snapshot.poses, now_s

    def _transforms(self, transforms: FrameTransforms, time_s: float) -> Iterator[Any]:
        messages, stamp = self._server._sdk.messages, _timestamp(self._server._sdk, time_s)
        for parent, child, row in zip(transforms.parents, transforms.children, transforms.poses.tolist(), strict=True):
            x, y, z, w, i, j, k = row
            yield messages.FrameTransform(
                timestamp=stamp,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=messages.Vector3(x=x, y=y, z=z),
                rotation=messages.Quaternion(x=i, y=j, z=k, w=w),
            )

    def _publish_scene(self, snapshot: StateSnapshot, complete: bool, now_s: float) -> None:
        key, (last, published_s) = (snapshot.revision, snapshot.markers), self._last_scene
        if not complete and (key == last or now_s - published_s < _SCENE_PERIOD_S):
            return
        update = self._server._publisher.update(snapshot, complete=complete)
        if update is not None:
            self._server._scene.log(update, log_time=round(snapshot.time_s * 1e9))
        self._last_scene = key, now_s


def _timestamp(sdk: Any, time_s: float) -> Any:
    seconds, nanoseconds = divmod(round(time_s * 1e9), 1_000_000_000)
    return sdk.messages.Timestamp(sec=seconds, nsec=nanoseconds)


# -- scene -------------------------------------------------------------------------------------------------------------


class _Content(NamedTuple):
    """What an entity of the scene shows."""

    frame: str
    shown: Body | Marker
    geometry: BodyGeometry | None
    highlight: Color | None


class _Drawing(NamedTuple):
    """Visual meshes in a color."""

    geometry: BodyGeometry
    color: Color | None
    highlight: Color | None
    pose: Pose = Pose()
    opacity: float | None = None
    """None for that of the material, at least 0.85 in the color of a highlight."""


class _ScenePublisher:
    """Converts bodies and markers to scene entities, and finds those that changed; used by one thread."""

    def __init__(self, sdk: Any, state_reader: StateReader) -> None:
        self._sdk = sdk
        self._messages = sdk.messages
        self._state_reader = state_reader
        self._published: dict[str, _Content] = {}
        """What the published entities show, by their id."""
        self._triangles = lru_cache(maxsize=512)(self._make_triangles)

    def update(self, snapshot: StateSnapshot, *, complete: bool) -> Any:
        """Returns the update to a state; None if nothing has changed.

        Args:
            snapshot: the state.
            complete: whether all entities are published, after the deletion of all.
        """
        stamp = _timestamp(self._sdk, snapshot.time_s)
        contents = dict(self._contents(snapshot))
        before = {} if complete else self._published
        deletion = self._messages.SceneEntityDeletion
        kind = self._messages.SceneEntityDeletionType
        deletions = [deletion(timestamp=stamp, type=kind.MatchingId, id=id) for id in before.keys() - contents.keys()]
        if complete:
            deletions = [deletion(timestamp=stamp, type=kind.All)]
        entities = [self._entity(id, content, stamp) for id, content in contents.items() if before.get(id) != content]
        self._published = contents
        if not deletions and not entities:
            return None
        return self._messages.SceneUpdate(deletions=deletions, entities=entities)

    def _contents(self, snapshot: StateSnapshot) -> Iterator[tuple[str, _Content]]:
        bodies = {body.id: body for body in self._state_reader.world().bodies}
        geometry = self._state_reader.simulation.geometry
        frames = self._state_reader.frame_names.assign(snapshot.ids)
        for id, frame in zip(snapshot.ids, frames, strict=True):
            if id in bodies:
                body = replace(bodies[id], pose=Pose())  # its pose is that of its frame
                yield f"body/{id}", _Content(frame, body, geometry.get(id), snapshot.highlights.get(id))
        for marker in snapshot.markers:
            copied = geometry.get(BodyId(marker.body)) if marker.type is MarkerType.BODY_COPY else None
            yield f"marker/{marker.id}", _Content(ROOT_FRAME, marker, copied, None)

    def _entity(self, id: str, content: _Content, stamp: Any) -> Any:
        shown, metadata = content.shown, []
        if isinstance(shown, Marker):
            parts = self._marker_parts(shown, content.geometry)
        else:
            parts = self._body_parts(shown, content)
            pairs = {"id": shown.id, "iri": shown.iri, "class": shown.cls}
            metadata = [self._messages.KeyValuePair(key=key, value=value) for key, value in pairs.items()]
        return self._messages.SceneEntity(
            timestamp=stamp, frame_id=content.frame, id=id, frame_locked=True, metadata=metadata, **parts
        )

    def _body_parts(self, body: Body, content: _Content) -> dict[str, list[Any]]:
        color = body.color
        if content.geometry is not None and content.geometry.visuals:
            return {"triangles": self._triangles(_Drawing(content.geometry, color, content.highlight))}
        size = body.size or _DEFAULT_SIZE_M
        opacity = 1.0 if content.highlight is None else _HIGHLIGHT_OPACITY
        type = body.shape.type if body.shape else PrimitiveType.BOX
        return self._primitive(type, Pose(), size, content.highlight or color or _GRAY, opacity)

    def _make_triangles(self, drawing: _Drawing) -> list[Any]:
        found = []
        for visual in drawing.geometry.visuals:
            material = visual.material
            # Glass stays glass, unless it is highlighted.
            color = material.color if drawing.color is None or material.opacity < 1.0 else drawing.color
            opacity = material.opacity
            if drawing.highlight is not None:
                color, opacity = drawing.highlight, max(opacity, _HIGHLIGHT_OPACITY)
            found.append(
                self._messages.TriangleListPrimitive(
                    pose=self._pose(drawing.pose),
                    points=[self._messages.Point3(x=x, y=y, z=z) for x, y, z in visual.points.tolist()],
                    indices=visual.faces.reshape(-1).tolist(),
                    color=self._color(color, opacity if drawing.opacity is None else drawing.opacity),
                )
            )
        return found

    def _marker_parts(self, marker: Marker, copied: BodyGeometry | None) -> dict[str, list[Any]]:
        messages, color, pose = self._messages, self._color(marker.color, marker.opacity), self._pose(marker.pose)
        match marker.type:
            case MarkerType.CUBE | MarkerType.SPHERE | MarkerType.CYLINDER | MarkerType.CONE:
                tapered = marker.type is MarkerType.CONE
                type = {MarkerType.CUBE: PrimitiveType.BOX, MarkerType.SPHERE: PrimitiveType.SPHERE}.get(
                    marker.type, PrimitiveType.CYLINDER
                )
                return self._primitive(type, marker.pose, marker.size, marker.color, marker.opacity, tapered=tapered)
            case MarkerType.ARROW:
                length, width = marker.size[0], marker.size[1]
                arrow = messages.ArrowPrimitive(
                    pose=pose,
                    shaft_length=0.77 * length,
                    shaft_diameter=width / 2,
                    head_length=0.23 * length,
                    head_diameter=width,
                    color=color,
                )
                return {"arrows": [arrow]}
            case MarkerType.TEXT:
                text = messages.TextPrimitive(
                    pose=pose, billboard=True, font_size=marker.size[2], color=color, text=marker.text
                )
                return {"texts": [text]}
            case MarkerType.BODY_COPY:
                drawing = None if copied is None else _Drawing(copied, None, marker.color, marker.pose, marker.opacity)
                return {} if drawing is None else {"triangles": self._triangles(drawing)}
        kinds = messages.LinePrimitiveLineType
        line = messages.LinePrimitive(
            type=kinds.LineStrip if marker.type is MarkerType.LINE_STRIP else kinds.LineList,
            pose=pose,
            thickness=marker.size[0],
            points=[messages.Point3(x=x, y=y, z=z) for x, y, z in marker.points],
            color=color,
            colors=[self._color(each, marker.opacity) for each in marker.colors],
        )
        if marker.type is not MarkerType.POINTS:
            return {"lines": [line]}
        size = messages.Vector3(x=marker.size[0], y=marker.size[0], z=marker.size[0])
        dots = [
            messages.SpherePrimitive(pose=self._pose(Pose(_moved(marker.pose, point))), size=size, color=color)
            for point in marker.points
        ]
        return {"spheres": dots}

    def _primitive(
        self, type: PrimitiveType, pose: Pose, size: Vector, color: Color, opacity: float, *, tapered: bool = False
    ) -> dict[str, list[Any]]:
        messages = self._messages
        fields = {
            "pose": self._pose(pose),
            "size": messages.Vector3(x=size[0], y=size[1], z=size[2]),
            "color": self._color(color, opacity),
        }
        match type:
            case PrimitiveType.SPHERE:
                return {"spheres": [messages.SpherePrimitive(**fields)]}
            case PrimitiveType.CYLINDER:
                top = 0.0 if tapered else 1.0
                return {"cylinders": [messages.CylinderPrimitive(**fields, bottom_scale=1.0, top_scale=top)]}
        return {"cubes": [messages.CubePrimitive(**fields)]}

    def _pose(self, pose: Pose) -> Any:
        (x, y, z), (w, i, j, k) = pose.position, pose.quaternion
        messages = self._messages
        return messages.Pose(
            position=messages.Vector3(x=x, y=y, z=z), orientation=messages.Quaternion(x=i, y=j, z=k, w=w)
        )

    def _color(self, color: Color, opacity: float) -> Any:
        return self._messages.Color(r=color[0], g=color[1], b=color[2], a=opacity)


def _moved(pose: Pose, point: Vector) -> Vector:
    """Returns a point in the frame of a pose in the frame of the pose itself."""
    x, y, z = pose_multiply(normalized_pose_array(pose), normalized_pose_array(Pose(point)))[:3].tolist()
    return x, y, z


# -- events ------------------------------------------------------------------------------------------------------------


class _EventLog:
    """Compares states, and describes what happened between them; used by one thread."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._before = simulation.state
        self._reports = len(simulation.reports)

    def new_entries(self, snapshot: StateSnapshot) -> Iterator[tuple[_Level, str]]:
        """Yields the level and the text of each event since the last call."""
        before, self._before = self._before, snapshot
        if snapshot is before:
            return
        if snapshot.playing != before.playing:
            yield _Level.INFO, f"playing at speed {snapshot.speed:g}" if snapshot.playing else "paused"
        if snapshot.time_s < before.time_s:
            yield _Level.INFO, f"the time was reset to {snapshot.time_s:g} s"
        if snapshot.error and snapshot.error != before.error:
            yield _Level.ERROR, snapshot.error
        if snapshot.ids is not before.ids and snapshot.ids != before.ids:
            yield from _changes_of_bodies(before.ids, snapshot.ids)
        if snapshot.highlight_groups != before.highlight_groups:
            for group in snapshot.highlight_groups:
                if group not in before.highlight_groups:
                    yield _Level.INFO, f"highlighted {_listed(group.ids)}" + (f": {group.label}" if group.label else "")
        reports = self._simulation.reports
        for report in reports[self._reports :]:
            for failure in report.failed_bodies:
                yield _Level.WARNING, f"{failure.id} was not spawned: {failure.reason}"
        self._reports = len(reports)


class _Level(StrEnum):
    INFO = "Info"
    WARNING = "Warning"
    ERROR = "Error"


def _changes_of_bodies(before: Iterable[BodyId], now: Iterable[BodyId]) -> Iterator[tuple[_Level, str]]:
    old, new = set(before), set(now)
    for ids, verb in ((new - old, "added"), (old - new, "removed")):
        if ids:
            yield _Level.INFO, f"{counted(len(ids), 'body')} {verb}: {_listed(sorted(ids))}"


def _listed(ids: Iterable[str]) -> str:
    names = list(ids)
    return ", ".join(names[:_MAX_LISTED]) + (", …" if len(names) > _MAX_LISTED else "")


# -- parameters --------------------------------------------------------------------------------------------------------


class _Parameters:
    """The parameters of a simulation; used by the threads of the SDK and by the publisher."""

    def __init__(self, sdk: Any, simulation: Simulation) -> None:
        self._parameter = sdk.Parameter
        self._simulation = simulation
        self._speed = 1.0
        self._last: dict[str, Any] = self.values()
        self._refusals: list[str] = []
        self._lock = threading.Lock()

    def values(self) -> dict[str, Any]:
        """Returns the values by name."""
        snapshot, worlds = self._simulation.state, self._simulation.worlds
        return {
            "paused": not snapshot.playing,
            "speed": snapshot.speed if snapshot.playing else self._speed,
            "engine": self._simulation.engine_name,
            "map": worlds[0].iri if worlds else "",
            "bodies": len(snapshot.ids),
        }

    def get(self, names: Iterable[str] = ()) -> list[Parameter]:
        """Returns the parameters of some names, or all."""
        values = self.values()
        chosen = list(names) or list(values)
        return [self._parameter(name, value=values[name]) for name in chosen if name in values]

    def set(self, parameters: Iterable[Parameter]) -> list[Parameter]:
        """Sets parameters, and returns all as they are then; a refusal is kept for `take_refusals`."""
        for parameter in parameters:
            try:
                self._set(parameter.name, parameter.get_value())
            except MindstageError as error:
                with self._lock:
                    self._refusals.append(str(error))
        return self.get()

    def changed(self) -> list[Parameter]:
        """Returns the parameters that have changed since the last call."""
        values = self.values()
        changed = [self._parameter(name, value=value) for name, value in values.items() if self._last[name] != value]
        self._last = values
        return changed

    def take_refusals(self) -> list[str]:
        """Returns and removes the reasons why parameters were not set."""
        with self._lock:
            refusals, self._refusals = self._refusals, []
        return refusals

    def _set(self, name: str, value: object) -> None:
        simulation = self._simulation
        match name, value:
            case "paused", bool():
                if value:
                    simulation.pause()
                else:
                    simulation.play(speed=self._speed)
            case "speed", int() | float() if not isinstance(value, bool) and 0.0 < value < float("inf"):
                self._speed = float(value)
                if simulation.state.playing:
                    simulation.play(speed=self._speed)
            case "paused", _:
                raise InvalidArgumentError("paused", cause=f"{value!r} is not true or false")
            case "speed", _:
                raise InvalidArgumentError("speed", cause=f"{value!r} is not a number above 0")
            case _:
                raise InvalidArgumentError(name, cause="it cannot be set", remedy="set paused or speed")


class _Listener:
    """Receives what clients request, in the threads of the SDK."""

    def __init__(self, parameters: _Parameters) -> None:
        self._parameters = parameters
        self._topics: dict[int, set[str]] = {}
        self._new_topics: set[str] = set()
        self._lock = threading.Lock()

    def take_new_topics(self) -> frozenset[str]:
        """Returns and forgets the topics with a new subscriber."""
        with self._lock:
            topics, self._new_topics = self._new_topics, set()
        return frozenset(topics)

    def clients(self) -> tuple[ConnectedClient, ...]:
        """Returns the clients with subscriptions."""
        with self._lock:
            return tuple(
                ConnectedClient(name=f"client {id}", transport="Foxglove", activity=", ".join(sorted(topics)))
                for id, topics in self._topics.items()
            )

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Remembers a subscription."""
        with self._lock:
            self._topics.setdefault(client.id, set()).add(channel.topic)
            self._new_topics.add(channel.topic)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """Forgets a subscription, also that of a client that has disconnected."""
        with self._lock:
            topics = self._topics.get(client.id, set())
            topics.discard(channel.topic)
            if not topics:
                self._topics.pop(client.id, None)

    def on_get_parameters(self, client: Client, param_names: list[str], request_id: str | None = None) -> Any:
        """Returns parameters."""
        return self._parameters.get(param_names)

    def on_set_parameters(self, client: Client, parameters: list[Parameter], request_id: str | None = None) -> Any:
        """Sets parameters."""
        return self._parameters.set(parameters)

    def on_parameters_subscribe(self, param_names: list[str]) -> None:
        """Does nothing: changes are published to all subscribers."""

    def on_parameters_unsubscribe(self, param_names: list[str]) -> None:
        """Does nothing."""


# -- services ----------------------------------------------------------------------------------------------------------


class _AskRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    question: str
    args: dict[str, Any] = {}


class _PlaceRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    item: str
    on: str | None = None
    into: str | None = None


class _HighlightRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    ids: tuple[str, ...]
    color: str | None = None
    label: str = ""


class _ResetRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pass


def _services(sdk: Any, simulation: Simulation) -> Iterator[Service]:
    """Yields the services of a simulation."""

    def ask(request: _AskRequest) -> object:
        return answers_to_builtins(simulation.knowledge, simulation.ask(request.question, **request.args))

    def place(request: _PlaceRequest) -> object:
        return simulation.place(request.item, on=request.on, into=request.into)

    def highlight(request: _HighlightRequest) -> object:
        return simulation.highlight(request.ids, request.color, label=request.label)

    def reset(_: _ResetRequest) -> object:
        simulation.reset_to_start()
        return {}

    handlers: dict[type[Any], Callable[[Any], object]] = {
        _AskRequest: ask,
        _PlaceRequest: place,
        _HighlightRequest: highlight,
        _ResetRequest: reset,
    }
    for type, handler in handlers.items():
        name = type.__name__.removeprefix("_").removesuffix("Request").lower()
        yield sdk.Service(
            f"/mindstage/{name}",
            schema=sdk.ServiceSchema(
                f"mindstage/{name}",
                request=_json_schema(sdk, f"mindstage/{name}/request", msgspec.json.schema(type)),
                response=_json_schema(sdk, f"mindstage/{name}/response", {"type": "object"}),
            ),
            handler=_handler(type, handler),
        )


def _json_schema(sdk: Any, name: str, schema: Mapping[str, Any]) -> Any:
    definition = sdk.Schema(name=name, encoding="jsonschema", data=msgspec.json.encode(schema))
    return sdk.MessageSchema(encoding=_JSON, schema=definition)


def _handler(type: type[Any], handle: Callable[[Any], object]) -> Callable[[ServiceRequest], bytes]:
    """Returns a handler that decodes the request and encodes the response; the SDK sends the text of an exception."""

    def respond(request: ServiceRequest) -> bytes:
        try:
            decoded = msgspec.json.decode(request.payload or b"{}", type=type)
        except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
            raise InvalidArgumentError(request.service_name, cause=str(error)) from error
        return msgspec.json.encode(handle(decoded))

    return respond
