"""MindstageEngine: the engine of another Mindstage, with the whole contract and nothing lost on the way.

Parcel: what of a world can travel as JSON, and why the rest cannot.

JSON has no NaN and no infinity. An engine in the same process would spawn what it can of such a world and list the
rest, so a far one does too. The same holds for forms.
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

from mindstage.bridge.conversions import (
    color_from_message,
    color_message,
    geometry_to_json,
    message_to_error,
    point_message,
    pose_array_from_messages,
    pose_message,
    to_json,
    vector_message,
    world_from_json,
    world_to_json,
)
from mindstage.engines.base import (
    Capability,
    PoseArray,
    SavedState,
    SpawnFailure,
    SpawnNote,
    SpawnNoteKind,
    SpawnReport,
)
from mindstage.engines.collision_shapes import compile_geometry
from mindstage.engines.registry import EntityRegistry, pose_error
from mindstage.engines.remote.client import RemoteProfile, ServiceClient
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.errors import (
    EngineError,
    EngineUnavailableError,
    MessageValidationError,
    PoseUnreachableError,
    WorldError,
)
from mindstage.msgs import Message, Service, encode, engine_service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.scene import (
    NO_GEOMETRY,
    Body,
    BodyGeometry,
    BodyId,
    BodyPhysics,
    Color,
    GeometryMap,
    Iri,
    Joint,
    Light,
    Material,
    Pose,
    Vector,
    World,
)

__all__ = ["MeshExporter", "MindstageRemoteEngine", "encode_geometry", "encode_world"]


P = TypeVar("P", Body, Joint, Light)


def encode_world(world: World) -> tuple[str, SpawnReport]:
    """A world as JSON, and a report of what had to be left out.

    Raises:
        MessageValidationError: what is said about the map as a whole cannot travel.
    """
    try:
        return world_to_json(world), SpawnReport()
    except MessageValidationError:
        pass  # one part of it cannot, and now it is looked which
    refused = EntityRegistry().add(world)
    reasons = {failure.id: failure.reason for failure in (*refused.failed_bodies, *refused.failed_joints)}
    bodies, no_bodies = _split_encodable(world.bodies, reasons)
    lights, no_lights = _split_encodable(world.lights, reasons)
    constraints, no_constraints = _split_encodable(world.joints, reasons)
    rest = msgspec.structs.replace(world, bodies=bodies, lights=lights, joints=constraints)
    return world_to_json(rest), SpawnReport(failed_bodies=no_bodies + no_lights, failed_joints=no_constraints)


def encode_geometry(geometry: GeometryMap) -> tuple[dict[BodyId, BodyGeometry], tuple[SpawnNote, ...]]:
    """Forms without the solids that nobody can build, and a note for each that had some."""
    usable: dict[str, tuple[BodyGeometry, int]] = {}
    kept: dict[BodyId, BodyGeometry] = {}
    notes: list[SpawnNote] = []
    for id, form in geometry.items():
        if form.key not in usable:
            ready = compile_geometry(form.collision_shapes)
            usable[form.key] = (
                replace(form, collision_shapes=ready.shapes) if ready.invalid_count else form,
                ready.invalid_count,
            )
        kept[id], left_out = usable[form.key]
        if left_out:
            text = f"{left_out} solids of {id}'s form have numbers that mean nothing; nothing touches them"
            notes.append(SpawnNote(SpawnNoteKind.SHAPE, (id,), text))
    return kept, tuple(notes)


def _split_encodable(parts: Iterable[P], reasons: dict[str, str]) -> tuple[tuple[P, ...], tuple[SpawnFailure, ...]]:
    """What can travel, and what cannot, in the words of other engines where they would refuse it as well."""
    kept: list[P] = []
    left: list[SpawnFailure] = []
    for part in parts:
        try:
            to_json(part)
        except MessageValidationError as error:
            left.append(SpawnFailure(part.id, reasons.get(part.id, str(error))))
        else:
            kept.append(part)
    return tuple(kept), tuple(left)


# ruff: noqa: D102 - the contract documents an engine's methods, once for all

MeshExporter = Callable[[BodyGeometry], str]
"""Puts what a form looks like where the far engine can read it, and gives the name of that; empty if it cannot."""

_TIMEOUT_PER_ENTITY_S = 0.05
"""So much longer may a call take for each body or constraint that it is about [s]."""
_MAX_SLOWDOWN = 6.0
"""A simulated second may take so many times a call's timeout; the far side's stage is as patient."""
_DISCONNECT_TIMEOUT_S = 1.0
_FORMAT_VERSION = World(iri=Iri("")).format_version


class MindstageRemoteEngine(RemoteEngine):
    """The contract, kept by whichever engine runs over there.

    That world may be stepped, edited and watched by others as well. Should it be started anew, every call says so
    until something is spawned, or all is cleared.
    """

    profile = RemoteProfile.MINDSTAGE

    def __init__(
        self, client: ServiceClient, *, control_time: bool = True, export_mesh: MeshExporter = lambda form: ""
    ) -> None:
        """Takes its time over, so that it passes by `step` only, until `close`.

        Args:
            link: to whom the services are offered.
            holds_time: False to look at a world that lives by itself.
            show: has the far engine see what bodies look like; by default it sees what can be touched of them.
        """
        super().__init__(client)
        self._export_mesh = export_mesh
        self._control_time = control_time
        self._speed_before = 0.0
        self._ids: tuple[BodyId, ...] = ()
        self._saved_states: set[_StateHandle] = set()
        """States that the far side keeps for us."""
        self._released_states: deque[_StateHandle] = deque()
        """Those that nobody here can bring back any more."""
        self._world_lost = False
        self._remote_info = self._describe()
        self._connection_number = client.connection_count
        self._take_time_control()

    @classmethod
    def is_available(cls, client: ServiceClient) -> bool:
        """Whether someone at the other end speaks so."""
        return client.is_available(_service_name(client, wire.Describe), wire.Describe, wire.Describe.Request())

    @property
    def capabilities(self) -> frozenset[Capability]:
        known = {each.value for each in Capability} - {Capability.STATISTICS.value}
        return frozenset(Capability(each) for each in self._remote_info.abilities if each in known)

    @property
    def remote_engine_name(self) -> str:
        """Which engine runs there, such as `mujoco`."""
        return self._remote_info.engine

    @property
    def time_s(self) -> float:
        told: wire.Describe.Response = self._call(wire.Describe, wire.Describe.Request())
        return told.time_s

    def ping(self) -> float:
        start = time.perf_counter()
        self._call(wire.Describe, wire.Describe.Request(), even_if_restarted=True)
        return time.perf_counter() - start

    # -- the world -----------------------------------------------------------------------------------------------------

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        text, left_out = encode_world(world)
        usable, notes = encode_geometry(geometry if "forms" in self._remote_info.takes else NO_GEOMETRY)
        request = wire.SpawnWorld.Request(world=text, forms=geometry_to_json(usable, mesh=self._export_mesh))
        report = self._spawn(request, entity_count=len(world.bodies) + len(world.joints))
        return msgspec.structs.replace(
            report,
            failed_bodies=left_out.failed_bodies + report.failed_bodies,
            failed_joints=left_out.failed_joints + report.failed_joints,
            notes=notes + report.notes,
        )

    def _spawn(self, request: wire.SpawnWorld.Request, *, entity_count: int) -> SpawnReport:
        patience_s = self._timeout_s + _TIMEOUT_PER_ENTITY_S * entity_count
        reply: wire.SpawnWorld.Response = self._call(
            wire.SpawnWorld, request, timeout_s=patience_s, even_if_restarted=True
        )
        with self._client.validating("spawn_world"):
            return msgspec.convert(encode(reply.report), SpawnReport)

    def delete(self, ids: Iterable[BodyId]) -> None:
        self._call(wire.Delete, wire.Delete.Request(ids=tuple(ids)))

    def clear(self) -> None:
        self._call(wire.Clear, wire.Clear.Request(), even_if_restarted=True)

    def attach(self, parent: BodyId, child: BodyId) -> None:
        self._call(wire.Attach, wire.Attach.Request(parent=parent, child=child))

    def detach(self, child: BodyId) -> None:
        self._call(wire.Detach, wire.Detach.Request(child=child))

    def snapshot(self) -> World:
        reply: wire.LogWorld.Response = self._call(wire.LogWorld, wire.LogWorld.Request())
        with self._client.validating("log_world"):
            return world_from_json(reply.world)

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)  # the wire has no word for such numbers
        self._call(wire.SetPose, wire.SetPose.Request(id=id, pose=pose_message(pose)))

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        self._call(wire.SetPhysics, wire.SetPhysics.Request(id=id, physics=to_json(physics)))

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        text = to_json(materials, tuple[Material, ...])
        self._call(wire.SetMaterials, wire.SetMaterials.Request(id=id, materials=text))

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        lit = wire.Highlight.Request(ids=tuple(ids))
        if color is not None:
            lit = msgspec.structs.replace(lit, lit=True, color=color_message(color))
        self._call(wire.Highlight, lit)

    def highlights(self) -> Mapping[BodyId, Color]:
        reply: wire.GetHighlights.Response = self._call(wire.GetHighlights, wire.GetHighlights.Request())
        with self._client.validating("get_highlights"):
            return dict(zip(map(BodyId, reply.ids), map(color_from_message, reply.colors), strict=True))

    def apply_force(self, id: BodyId, force: Vector, point: Vector | None = None) -> None:
        push = wire.Push.Request(id=id, force=vector_message(force))
        if point is not None:
            push = msgspec.structs.replace(push, at_point=True, point=point_message(point))
        self._call(wire.Push, push)

    # -- time and state ------------------------------------------------------------------------------------------------

    def step(self, duration_s: float) -> None:
        self._step(wire.Step.Request(duration_s=duration_s))

    def _step(self, request: wire.Step.Request) -> wire.Step.Response:
        patience_s = self._timeout_s * (1.0 + _MAX_SLOWDOWN * max(0.0, request.duration_s))
        reply: wire.Step.Response = self._call(wire.Step, request, timeout_s=patience_s)
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
            raise TypeError(f"a state that this very engine's save made is needed, not {type(state).__name__}")
        if state.location not in self._saved_states:
            raise EngineUnavailableError(self.name, cause="it was started anew, and the state went with its world")
        self._call(wire.RestoreState, wire.RestoreState.Request(handle=state.location.handle))

    # -- asking --------------------------------------------------------------------------------------------------------

    @property
    def _timeout_s(self) -> float:
        """How long a call may take in a world of this size [s]."""
        return self._client.timeout_s + _TIMEOUT_PER_ENTITY_S * len(self._ids)

    def _call(
        self,
        service: type[Service],
        request: Message,
        *,
        timeout_s: float | None = None,
        even_if_restarted: bool = False,
    ) -> Any:
        """Calls a service of the far engine; what the world refuses is raised.

        Args:
            service: which.
            request: with what.
            timeout_s: how long to wait [s].
            in_any_world: whether the call makes sense in a world that was started anew as well.
        """
        link = self._require_open()
        link.wait_ready()
        if link.connection_count != self._connection_number:
            self._reconnect()
        if self._world_lost and not even_if_restarted:
            cause = "it was started anew since, and the world that it ran is gone"
            raise EngineUnavailableError(self.name, cause=cause, remedy="spawn it again, or clear first")
        patience_s = self._timeout_s if timeout_s is None else timeout_s
        reply = link.call(_service_name(link, service), service, request, timeout_s=patience_s)
        _raise_world_error(reply)
        if isinstance(reply, wire.SpawnWorld.Response | wire.Clear.Response):
            self._world_lost = False
        return reply

    def _reconnect(self) -> None:
        """Learns who is there after a loss; someone else than before has another world."""
        meetings = self._client.connection_count
        far = self._describe()
        if far.session != self._remote_info.session:
            self._world_lost = True
            self._saved_states.clear()
        self._remote_info, self._connection_number = far, meetings
        self._take_time_control()

    def _describe(self) -> wire.Describe.Response:
        link = self._client
        far: wire.Describe.Response = link.call(
            _service_name(link, wire.Describe), wire.Describe, wire.Describe.Request()
        )
        if far.format_version != _FORMAT_VERSION:
            cause = f"it reads worlds of the format {far.format_version}, and this Mindstage writes {_FORMAT_VERSION}"
            raise EngineUnavailableError(self.name, cause=cause, remedy="use the same version on both sides")
        return far

    def _take_time_control(self) -> None:
        if self._control_time:
            reply: wire.SetSpeed.Response = self._client.call(
                _service_name(self._client, wire.SetSpeed), wire.SetSpeed, wire.SetSpeed.Request(speed=0.0)
            )
            self._speed_before = reply.before or self._speed_before

    def _release_states(self) -> None:
        """The far side keeps only so many states."""
        while self._released_states:
            place = self._released_states.popleft()
            if place in self._saved_states:
                self._call(wire.ForgetState, wire.ForgetState.Request(handle=place.handle))
                self._saved_states.discard(place)

    def _disconnect(self) -> None:
        link = self._client
        states = [wire.ForgetState.Request(handle=place.handle) for place in self._saved_states]
        speeds = [wire.SetSpeed.Request(speed=self._speed_before)] if self._speed_before else []
        with suppress(EngineError):  # whoever is gone keeps nothing, and its time is its own
            list(
                link.call_each(
                    _service_name(link, wire.ForgetState), wire.ForgetState, states, timeout_s=_DISCONNECT_TIMEOUT_S
                )
            )
            list(
                link.call_each(
                    _service_name(link, wire.SetSpeed), wire.SetSpeed, speeds, timeout_s=_DISCONNECT_TIMEOUT_S
                )
            )


class _StateHandle(NamedTuple):
    """Where a state is kept."""

    session: str
    handle: str


class _RemoteState:
    """A state that is kept over there, for as long as somebody has this."""

    def __init__(self, engine: MindstageRemoteEngine, location: _StateHandle) -> None:
        self.engine = engine
        self.location = location


def _service_name(client: ServiceClient, service: type[Service]) -> str:
    return engine_service(service, client.address.namespace)


def _raise_world_error(reply: Any) -> None:
    """Raises what the world refused with.

    Raises:
        WorldError: the reply says no.
    """
    if getattr(reply, "success", True):
        return
    if reply.refusal.kind:
        raise message_to_error(reply.refusal)
    if not isinstance(reply, wire.SpawnWorld.Response):  # whose report says what failed
        raise WorldError(reply.refusal.text or "the far engine's world refuses it, and does not say why")
