"""MindstageRemoteEngine: the engine of another Mindstage process, with the whole `Engine` protocol.

Worlds and geometry are sent as JSON, which has no NaN and no infinity. Entities with such numbers are left out and
reported as failures, as an engine in the same process does.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar
from weakref import finalize

import msgspec

from mindstage.access.limits import Duration
from mindstage.access.resources import is_granted
from mindstage.bridge.conversions import (
    color_from_message,
    color_message,
    geometry_to_json,
    message_to_error,
    point_message,
    pose_array_from_messages,
    to_json,
    vector_message,
    world_from_json,
    world_to_json,
)
from mindstage.engines.base import (
    ActuatorState,
    Applied,
    Capability,
    PoseArray,
    SavedState,
    SpawnFailure,
    SpawnNote,
    SpawnNoteKind,
    SpawnReport,
)
from mindstage.engines.editing import apply_parts
from mindstage.engines.edits import SetActuators
from mindstage.engines.entity_registry import EntityRegistry, pose_error
from mindstage.engines.remote.client import TIMEOUT_PER_ENTITY_S, RemoteProfile, ServiceClient
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.errors import (
    EngineError,
    EngineUnavailableError,
    MessageValidationError,
    PoseUnreachableError,
    SpawnRefusedError,
    WorldError,
)
from mindstage.msgs import Message, Service, encode, engine_service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ranges import Finite, ForceVector, Point, checked
from mindstage.scene import (
    NO_GEOMETRY,
    Body,
    BodyGeometry,
    BodyId,
    Color,
    GeometryMap,
    Iri,
    Joint,
    Light,
    World,
)
from mindstage.scene.collision_shapes import compile_geometry
from mindstage.scene.edits import Delete, Edit, GeometryEdit, SetPoses, Spawn, edit_from_json, edit_to_json
from mindstage.scene.joint_kinematics import without_lost_masters

__all__ = ["MeshExporter", "MindstageRemoteEngine", "encode_geometry", "encode_world"]


P = TypeVar("P", Body, Joint, Light)


def encode_world(world: World) -> tuple[str, SpawnReport]:
    """The world as JSON, and a report of the entities that were left out.

    Raises:
        MessageValidationError: a property of the world as a whole cannot be encoded.
    """
    try:
        return world_to_json(world), SpawnReport()
    except MessageValidationError:
        pass  # some entity cannot be encoded; find out which
    refused = EntityRegistry().add(world)
    reasons = {failure.id: failure.reason for failure in (*refused.failed_bodies, *refused.failed_joints)}
    bodies, failed_bodies = _split_encodable(world.bodies, reasons)
    lights, failed_lights = _split_encodable(world.lights, reasons)
    joints, failed_joints = _split_encodable(world.joints, reasons)
    rest = msgspec.structs.replace(world, bodies=bodies, lights=lights, joints=joints)
    return world_to_json(rest), SpawnReport(failed_bodies=failed_bodies + failed_lights, failed_joints=failed_joints)


def encode_geometry(geometry: GeometryMap) -> tuple[dict[BodyId, BodyGeometry], tuple[SpawnNote, ...]]:
    """The geometry without invalid collision shapes, and a note for each body that had some."""
    usable: dict[str, tuple[BodyGeometry, int]] = {}
    kept: dict[BodyId, BodyGeometry] = {}
    notes: list[SpawnNote] = []
    for id, body_geometry in geometry.items():
        if body_geometry.key not in usable:
            compiled = compile_geometry(body_geometry.collision_shapes)
            usable[body_geometry.key] = (
                replace(body_geometry, collision_shapes=compiled.shapes) if compiled.invalid_count else body_geometry,
                compiled.invalid_count,
            )
        kept[id], invalid_count = usable[body_geometry.key]
        if invalid_count:
            text = f"{invalid_count} collision shapes of {id} have invalid numbers and are left out"
            notes.append(SpawnNote(SpawnNoteKind.SHAPE, (id,), text))
    return kept, tuple(notes)


def _split_encodable(entities: Iterable[P], reasons: dict[str, str]) -> tuple[tuple[P, ...], tuple[SpawnFailure, ...]]:
    """Separates entities that can be encoded from those that cannot, with the reason."""
    kept: list[P] = []
    failed: list[SpawnFailure] = []
    for entity in entities:
        try:
            to_json(entity)
        except MessageValidationError as error:
            failed.append(SpawnFailure(entity.id, reasons.get(entity.id, str(error))))
        else:
            kept.append(entity)
    return tuple(kept), tuple(failed)


# ruff: noqa: D102 - the methods of an engine are documented in the protocol

MeshExporter = Callable[[BodyGeometry], str]
"""Writes the visual meshes of a geometry to a file that the remote engine can read.

Returns the file name; empty if there is none.
"""

_MAX_SLOWDOWN = 6.0
"""Timeout of a simulated second, in timeouts of a call; the server allows as much."""
_DISCONNECT_TIMEOUT_S = 1.0
_FORMAT_VERSION = World(iri=Iri("")).format_version


class MindstageRemoteEngine(RemoteEngine):
    """The engine of another Mindstage process.

    The remote world may be stepped, edited and observed by other clients, too. After a restart of the other process,
    every call raises `EngineUnavailableError` until a world is spawned or the engine is cleared.
    """

    profile = RemoteProfile.MINDSTAGE

    def __init__(
        self, client: ServiceClient, *, control_time: bool = True, export_mesh: MeshExporter = lambda geometry: ""
    ) -> None:
        """Connects to the world and stops its time, which then advances by `step` only, until `close`.

        Args:
            client: connection to the server.
            control_time: False to observe a world that runs in its own time.
            export_mesh: writes visual meshes for the remote engine; by default it shows the collision shapes.
        """
        super().__init__(client)
        self._export_mesh = export_mesh
        self._control_time = control_time
        self._speed_before = 0.0
        self._own_meshes: dict[BodyId, str] = {}
        """Names of meshes in files of this machine, which the other process neither has nor accepts."""
        self._ids: tuple[BodyId, ...] = ()
        self._saved_states: set[_StateHandle] = set()
        """States saved on the remote side."""
        self._released_states: deque[_StateHandle] = deque()
        """Those of them that have been garbage-collected here."""
        self._world_lost = False
        self._remote_info = self._describe()
        self._connection_number = client.connection_count
        self._take_time_control()

    @classmethod
    def is_available(cls, client: ServiceClient) -> bool:
        """Whether a Mindstage answers at the address."""
        return client.is_available(_service_name(client, wire.Describe), wire.Describe, wire.Describe.Request())

    @property
    def capabilities(self) -> frozenset[Capability]:
        # The wire has no messages for others.
        sent = (Capability.SAVE, Capability.JOINTS, Capability.ACTUATORS, Capability.KINEMATIC_VELOCITIES)
        return frozenset(each for each in sent if each.value in self._remote_info.abilities)

    @property
    def remote_engine_name(self) -> str:
        """Name of the engine that runs there, such as "mujoco"."""
        return self._remote_info.engine

    @property
    def time_s(self) -> float:
        description: wire.Describe.Response = self._call(wire.Describe, wire.Describe.Request())
        return description.time_s

    def ping(self) -> float:
        start = time.perf_counter()
        self._call(wire.Describe, wire.Describe.Request(), even_if_restarted=True)
        return time.perf_counter() - start

    # -- the world -----------------------------------------------------------------------------------------------------

    def apply(self, edit: Edit) -> Applied:
        if parts := edit.parts():
            return apply_parts(self, edit, parts)
        if isinstance(edit, Spawn):
            report = self._spawn_world(edit)
            failed = {each.id for each in report.failed_bodies}
            inverse: Edit = Delete(tuple(id for id in edit.ids if id not in failed))
            if edit.whole and not report.ok:
                self.apply(inverse)
                raise SpawnRefusedError(report.failures[0].id, reason=report.failures[0].reason)
            return Applied(edit=edit, inverse=inverse, report=report)
        if isinstance(edit, SetPoses):  # JSON has no such numbers
            for id, pose in edit.poses.items():
                if reason := pose_error(pose):
                    raise PoseUnreachableError(id, reason=reason)
        if isinstance(edit, SetActuators):
            self._require_actuators()
        sent = msgspec.structs.replace(edit, geometry={}) if isinstance(edit, GeometryEdit) else edit
        refusal = ValueError if isinstance(edit, SetActuators) else WorldError
        request = wire.ApplyEdit.Request(edit=edit_to_json(sent).decode())
        reply: wire.ApplyEdit.Response = self._call(wire.ApplyEdit, request, refusal=refusal)
        with self._client.validating("apply_edit"):
            return Applied(edit=edit, inverse=edit_from_json(reply.inverse))

    def _spawn_world(self, edit: Spawn) -> SpawnReport:
        world, geometry = edit.world, edit.geometry
        names = {body.id: body.mesh for body in world.bodies if body.mesh and not is_granted(body.mesh)}
        self._own_meshes |= names
        sent = (msgspec.structs.replace(body, mesh=None) if body.id in names else body for body in world.bodies)
        text, unsent = encode_world(msgspec.structs.replace(world, bodies=tuple(sent)) if names else world)
        usable, notes = encode_geometry(geometry if "geometries" in self._remote_info.takes else NO_GEOMETRY)
        if edit.immovable:
            reason = f"{self.name} decides by its own ontology which dynamic bodies are immovable"
            notes = (*notes, SpawnNote(SpawnNoteKind.UNSTATED, tuple(sorted(edit.immovable)), reason))
        if edit.excluded_pairs:
            pairs = tuple(sorted({id for pair in edit.excluded_pairs for id in pair}))
            notes = (
                *notes,
                SpawnNote(SpawnNoteKind.UNSTATED, pairs, f"{self.name} decides which pairs collide"),
            )
        request = wire.SpawnWorld.Request(world=text, geometries=geometry_to_json(usable, mesh=self._export_mesh))
        report = self._spawn(request, entity_count=len(world.bodies) + len(world.joints))
        return msgspec.structs.replace(
            report,
            failed_bodies=unsent.failed_bodies + report.failed_bodies,
            failed_joints=unsent.failed_joints + report.failed_joints,
            notes=notes + report.notes,
        )

    def _spawn(self, request: wire.SpawnWorld.Request, *, entity_count: int) -> SpawnReport:
        timeout_s = self._timeout_s + TIMEOUT_PER_ENTITY_S * entity_count
        reply: wire.SpawnWorld.Response = self._call(
            wire.SpawnWorld, request, timeout_s=timeout_s, even_if_restarted=True
        )
        with self._client.validating("spawn_world"):
            return msgspec.convert(encode(reply.report), SpawnReport)

    def clear(self) -> None:
        self._call(wire.Clear, wire.Clear.Request(), even_if_restarted=True)

    def snapshot(self) -> World:
        reply: wire.LogWorld.Response = self._call(wire.LogWorld, wire.LogWorld.Request())
        with self._client.validating("log_world"):
            world = world_from_json(reply.world)
        own = (msgspec.structs.replace(body, mesh=body.mesh or self._own_meshes.get(body.id)) for body in world.bodies)
        bodies = tuple(own) if self._own_meshes else world.bodies
        return msgspec.structs.replace(world, bodies=bodies, joints=without_lost_masters(world.joints))

    # -- bodies --------------------------------------------------------------------------------------------------------

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        request = wire.Highlight.Request(ids=tuple(ids))
        if color is not None:
            request = msgspec.structs.replace(request, highlighted=True, color=color_message(color))
        self._call(wire.Highlight, request)

    def highlights(self) -> Mapping[BodyId, Color]:
        reply: wire.GetHighlights.Response = self._call(wire.GetHighlights, wire.GetHighlights.Request())
        with self._client.validating("get_highlights"):
            return dict(zip(map(BodyId, reply.ids), map(color_from_message, reply.colors), strict=True))

    @checked
    def apply_force(self, id: BodyId, force: ForceVector, point: Point | None = None) -> None:
        request = wire.Push.Request(id=id, force=vector_message(force))
        if point is not None:
            request = msgspec.structs.replace(request, at_point=True, point=point_message(point))
        self._call(wire.Push, request)

    # -- time and state ------------------------------------------------------------------------------------------------

    @checked
    def step(self, duration_s: Duration) -> None:
        self._step(wire.Step.Request(duration_s=duration_s))

    def _step(self, request: wire.Step.Request) -> wire.Step.Response:
        timeout_s = self._timeout_s * (1.0 + _MAX_SLOWDOWN * max(0.0, request.duration_s))
        reply: wire.Step.Response = self._call(wire.Step, request, timeout_s=timeout_s)
        return reply

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        reply: wire.GetPoses.Response = self._call(wire.GetPoses, wire.GetPoses.Request())
        with self._client.validating("get_poses"):
            rows = pose_array_from_messages(reply.poses)
            if len(rows) != len(reply.ids):
                raise ValueError(f"{len(reply.ids)} ids and {len(rows)} poses")
        if reply.ids != self._ids:
            self._ids = tuple(map(BodyId, reply.ids))
        return self._ids, rows

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        reply: wire.GetJointPositions.Response = self._call(wire.GetJointPositions, wire.GetJointPositions.Request())
        return {
            BodyId(each.id): (each.x, each.y, each.z, each.twist, each.swing2, each.swing1) for each in reply.joints
        }

    def save_state(self) -> SavedState:
        self._release_states()
        reply: wire.SaveState.Response = self._call(wire.SaveState, wire.SaveState.Request())
        saved = _RemoteState(self, _StateHandle(self._remote_info.session, reply.handle))
        self._saved_states.add(saved.location)
        finalize(saved, self._released_states.append, saved.location).atexit = False
        return SavedState(saved)

    def restore_state(self, state: SavedState) -> None:
        self._require_open()
        if not isinstance(state, _RemoteState) or state.engine is not self:
            raise TypeError(f"expected a state from this engine's save_state, not {type(state).__name__}")
        if state.location not in self._saved_states:
            raise EngineUnavailableError(self.name, cause="it was restarted, and its saved states are lost")
        self._call(wire.RestoreState, wire.RestoreState.Request(handle=state.location.handle))

    # -- actuators -----------------------------------------------------------------------------------------------------

    @checked
    def set_commands(self, commands: Mapping[str, Finite]) -> None:
        self._require_actuators()
        request = wire.SetCommands.Request(names=tuple(commands), commands=tuple(commands.values()))
        self._call(wire.SetCommands, request, refusal=KeyError)

    def actuator_states(self) -> Mapping[str, ActuatorState]:
        self._require_actuators()
        reply: wire.GetActuatorStates.Response = self._call(wire.GetActuatorStates, wire.GetActuatorStates.Request())
        return {
            each.name: ActuatorState(
                position=each.position, velocity=each.velocity, effort=each.effort, command=each.command
            )
            for each in reply.actuators
        }

    def _require_actuators(self) -> None:
        self._require_open()
        if Capability.ACTUATORS not in self.capabilities:
            raise self._unsupported_actuators()

    # -- calls ---------------------------------------------------------------------------------------------------------

    @property
    def _timeout_s(self) -> float:
        """Timeout of a call for a world of this size [s]."""
        return self._client.timeout_s + TIMEOUT_PER_ENTITY_S * len(self._ids)

    def _call(
        self,
        service: type[Service],
        request: Message,
        *,
        timeout_s: float | None = None,
        even_if_restarted: bool = False,
        refusal: type[Exception] = WorldError,
    ) -> Any:
        """Calls a service; raises the error of a refused request.

        Args:
            service: service type.
            request: the request message.
            timeout_s: timeout [s]; by default `_timeout_s`.
            even_if_restarted: whether the call is also valid after a restart of the remote process.
            refusal: the error of a refused request that is about no body.
        """
        client = self._require_open()
        client.wait_ready()
        if client.connection_count != self._connection_number:
            self._reconnect()
        if self._world_lost and not even_if_restarted:
            cause = "it was restarted, and its world is lost"
            raise EngineUnavailableError(self.name, cause=cause, remedy="spawn the world again, or clear the engine")
        timeout_s = self._timeout_s if timeout_s is None else timeout_s
        reply = client.call(_service_name(client, service), service, request, timeout_s=timeout_s)
        _raise_refusal(reply, refusal)
        if isinstance(reply, wire.SpawnWorld.Response | wire.Clear.Response):
            self._world_lost = False
        return reply

    def _reconnect(self) -> None:
        """Identifies the process after a reconnection; a new one does not have the world."""
        connection_number = self._client.connection_count
        remote_info = self._describe()
        if remote_info.session != self._remote_info.session:
            self._world_lost = True
            self._saved_states.clear()
        self._remote_info, self._connection_number = remote_info, connection_number
        self._take_time_control()

    def _describe(self) -> wire.Describe.Response:
        client = self._client
        remote_info: wire.Describe.Response = client.call(
            _service_name(client, wire.Describe), wire.Describe, wire.Describe.Request()
        )
        if remote_info.format_version != _FORMAT_VERSION:
            cause = f"its world format is {remote_info.format_version}, and this Mindstage's is {_FORMAT_VERSION}"
            raise EngineUnavailableError(self.name, cause=cause, remedy="use the same version on both machines")
        return remote_info

    def _take_time_control(self) -> None:
        if self._control_time:
            reply: wire.SetSpeed.Response = self._client.call(
                _service_name(self._client, wire.SetSpeed), wire.SetSpeed, wire.SetSpeed.Request(speed=0.0)
            )
            self._speed_before = reply.before or self._speed_before

    def _release_states(self) -> None:
        """Deletes unused states there, since their number is limited."""
        while self._released_states:
            handle = self._released_states.popleft()
            if handle in self._saved_states:
                self._call(wire.ForgetState, wire.ForgetState.Request(handle=handle.handle))
                self._saved_states.discard(handle)

    def _disconnect(self) -> None:
        client = self._client
        states = [wire.ForgetState.Request(handle=handle.handle) for handle in self._saved_states]
        speeds = [wire.SetSpeed.Request(speed=self._speed_before)] if self._speed_before else []
        with suppress(EngineError):  # after a crash there is nothing left to release
            list(
                client.call_each(
                    _service_name(client, wire.ForgetState), wire.ForgetState, states, timeout_s=_DISCONNECT_TIMEOUT_S
                )
            )
            list(
                client.call_each(
                    _service_name(client, wire.SetSpeed), wire.SetSpeed, speeds, timeout_s=_DISCONNECT_TIMEOUT_S
                )
            )


class _StateHandle(NamedTuple):
    """Identifies a state on the remote side."""

    session: str
    handle: str


class _RemoteState:
    """A state on the remote side; it is deleted there when this object is garbage-collected."""

    def __init__(self, engine: MindstageRemoteEngine, location: _StateHandle) -> None:
        self.engine, self.location = engine, location


def _service_name(client: ServiceClient, service: type[Service]) -> str:
    return engine_service(service, client.address.namespace)


def _raise_refusal(reply: Any, error: type[Exception]) -> None:
    """Raises the error of a refused request.

    Raises:
        WorldError: the request was refused, because of a body; otherwise the given error.
    """
    if getattr(reply, "success", True):
        return
    if reply.refusal.code:
        raise message_to_error(reply.refusal)
    if not isinstance(reply, wire.SpawnWorld.Response):  # its report lists the failures
        raise error(reply.refusal.text or "the remote engine refused the request without a reason")
