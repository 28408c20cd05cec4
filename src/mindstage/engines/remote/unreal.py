"""UnrealEngine: a world in Unreal, controlled by the services of its plugin UROSWorldControl.

Operations for which the plugin has no service (`detach`, `apply_force`, `save_state`) raise `UnsupportedByEngineError`.
The plugin cannot list its models either, so a snapshot is the spawned world with the current poses, which are read one
by one; poses that differ only by rounding are returned as spawned. Time in Unreal is wall-clock time: `step` waits.

A world is spawned in two requests: bodies, then joints and attachments between bodies that exist. The plugin would
otherwise connect whatever has the id of a missing body.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from mindstage.access.limits import Duration
from mindstage.bridge.conversions import color_code, pose_array_from_messages, pose_message
from mindstage.bridge.conversions_unreal import (
    joint_message,
    mesh_pivots,
    model_message,
    physics_message,
    relation_message,
    spawn_model_request,
    untranslatable_fields,
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
from mindstage.engines.editing import EditingEngine, Performed
from mindstage.engines.edits import RestoreBodies, SimulatedBodies
from mindstage.engines.entity_registry import AddResult, EntityRegistry, pose_error
from mindstage.engines.remote.client import TIMEOUT_PER_ENTITY_S, RemoteProfile, ServiceClient
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.errors import (
    BodyExistsError,
    EngineError,
    EngineUnavailableError,
    PoseUnreachableError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.msgs import Message, Service, snake_case
from mindstage.msgs import world_control_msgs as wire
from mindstage.ranges import ForceVector, Point, checked
from mindstage.scene import (
    Attachment,
    Body,
    BodyGeometry,
    BodyId,
    Color,
    Pose,
    Vector,
    World,
)
from mindstage.scene.edits import Attach, BodyEdit, Delete, Detach, Edit, SetMaterials, SetPhysics, Spawn
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, pose_multiply

__all__ = ["UROSWorldControlClient", "UnrealEngine", "spawn_in_unreal"]


_SERVICE_NAMES: dict[type[Service], str] = {
    wire.SetMaterial: "change_material",
    wire.HighlightModel: "highlight_models",
}
"""Services whose names differ from their types."""
_PING_REQUEST = wire.GetModelPose.Request(id="mindstage-ping")


class UROSWorldControlClient:
    """Calls the services of one plugin."""

    def __init__(self, client: ServiceClient) -> None:
        self.client = client

    @property
    def is_available(self) -> bool:
        """Whether the plugin's services exist at the address."""
        return self.client.is_available(self._service_name(wire.GetModelPose), wire.GetModelPose, _PING_REQUEST)

    def call(self, service: type[Service], request: Message, *, entity_count: int = 0) -> Any:
        """Calls a service.

        Args:
            service: service type.
            request: the request message.
            entity_count: number of models and joints in the request, which extends the timeout.
        """
        self.client.wait_ready()
        timeout_s = self.client.timeout_s + TIMEOUT_PER_ENTITY_S * entity_count
        return self.client.call(self._service_name(service), service, request, timeout_s=timeout_s)

    def call_each(self, service: type[Service], requests: Sequence[Message]) -> Iterator[Any]:
        """Calls a service once for each request; the responses have the order of the requests."""
        self.client.wait_ready()
        timeout_s = self.client.timeout_s + TIMEOUT_PER_ENTITY_S * len(requests)
        return self.client.call_each(self._service_name(service), service, requests, timeout_s=timeout_s)

    def poses(self, ids: Iterable[BodyId]) -> list[wire.GetModelPose.Response]:
        """Poses of models, read one by one."""
        return list(self.call_each(wire.GetModelPose, [wire.GetModelPose.Request(id=id) for id in ids]))

    def ping(self) -> None:
        """Checks that the plugin answers, by asking for an unknown model."""
        self.call(wire.GetModelPose, _PING_REQUEST)

    def delete(self, ids: Iterable[BodyId]) -> tuple[BodyId, ...]:
        """Deletes models and returns those that still exist."""
        removed = tuple(ids)
        replies = self.call_each(wire.DeleteModel, [wire.DeleteModel.Request(id=id) for id in removed])
        refused = [id for id, reply in zip(removed, replies, strict=True) if not reply.success]
        return tuple(id for id, reply in zip(refused, self.poses(refused), strict=True) if reply.success)

    def _service_name(self, service: type[Service]) -> str:
        name = _SERVICE_NAMES.get(service) or snake_case(service)
        return "/".join(("", *filter(None, self.client.address.namespace.split("/")), name))


_NO_REASON = "Unreal's plugin did not spawn it, without a reason"


_CENTERED: Vector = (0.0, 0.0, 0.0)
"""The pivot in the center of a body [m]."""


def _pose_of_pivot(pose: Pose, pivot: Vector) -> Pose:
    """The pose of a mesh, whose origin is relative to the center of its body [m]."""
    if pivot == _CENTERED:
        return pose
    return pose_from_array(pose_multiply(normalized_pose_array(pose), [*pivot, 1.0, 0.0, 0.0, 0.0]))


def spawn_in_unreal(
    client: UROSWorldControlClient, registry: EntityRegistry, world: World
) -> tuple[SpawnReport, EntityRegistry]:
    """Spawns the valid part of a world; returns a report and the registry of what exists then.

    Models are placed by the origins of their meshes.

    Raises:
        EngineError: the call failed; an unknown part of the world may exist.
    """
    trial = registry.copy()
    accepted = trial.add(world)
    pivots = mesh_pivots(world)
    models = [
        msgspec.structs.replace(body, pose=_pose_of_pivot(body.pose, pivots.get(body.id, _CENTERED)))
        for body in (trial.bodies[id] for id in accepted.bodies)
    ]
    failed = _spawn_bodies(client, models)
    failed_ids = {failure.id for failure in failed}
    spawned = tuple(trial.bodies[id] for id in accepted.bodies if id not in failed_ids)
    trial = registry.copy()
    added = trial.add(msgspec.structs.replace(world, bodies=spawned))
    _spawn_joints_and_attachments(client, trial, added)
    added.failed_bodies[:] = [*accepted.failed_bodies, *failed]
    return added.report(_omission_notes(world)), trial


def _spawn_bodies(client: UROSWorldControlClient, bodies: Sequence[Body]) -> list[SpawnFailure]:
    """Spawns bodies and returns those that failed."""
    if not bodies:
        return []
    request = wire.SpawnSemanticMap.Request(models=tuple(map(model_message, bodies)))
    refused = set(_spawn_map(client, request, entity_count=len(bodies)).failed_model_ids)
    retried = [body for body in bodies if body.id in refused]
    # Only the response to a single body has a reason; the second attempt may also succeed.
    replies = client.call_each(wire.SpawnModel, [spawn_model_request(body) for body in retried])
    return [
        SpawnFailure(body.id, _failure_reason(body, reply.etype))
        for body, reply in zip(retried, replies, strict=True)
        if not reply.success
    ]


def _spawn_joints_and_attachments(client: UROSWorldControlClient, registry: EntityRegistry, added: AddResult) -> None:
    """Spawns added joints and attachments, and removes those that failed from the registry."""
    joints = [registry.joints[id] for id in added.joints]
    attachments = [Attachment(parent=registry.parents[child], child=child) for child in added.attachments]
    if not joints and not attachments:
        return
    request = wire.SpawnSemanticMap.Request(
        constraints=tuple(map(joint_message, joints)),
        relations=tuple(map(relation_message, attachments)),
    )
    reply = _spawn_map(client, request, entity_count=len(joints) + len(attachments))
    failed_joints = set(reply.failed_constraint_ids)
    for id in [id for id in added.joints if id in failed_joints]:
        added.joints.remove(id)
        added.failed_joints.append(SpawnFailure(id, _NO_REASON))
        del registry.joints[id]
    detached = {relation.child_id for relation in reply.failed_relations}
    for child in [child for child in added.attachments if child in detached]:
        added.attachments.remove(child)
        added.failed_attachments.append(SpawnFailure(child, _NO_REASON))
        registry.detach(child)


def _spawn_map(
    client: UROSWorldControlClient, request: wire.SpawnSemanticMap.Request, *, entity_count: int
) -> wire.SpawnSemanticMap.Response:
    reply: wire.SpawnSemanticMap.Response = client.call(wire.SpawnSemanticMap, request, entity_count=entity_count)
    failed = bool(reply.failed_model_ids or reply.failed_constraint_ids or reply.failed_relations)
    with client.client.validating("spawn_semantic_map"):
        if reply.success is failed:
            raise ValueError("success with failures" if failed else "no success, but no failures either")
    return reply


def _failure_reason(body: Body, etype: str) -> str:
    match etype:
        case wire.SpawnModel.Response.ID_TAKEN:
            return str(BodyExistsError(body.id))
        case wire.SpawnModel.Response.OBSTRUCTED:
            return "its place is obstructed"
    return f"{_NO_REASON}; does the project contain a mesh SM_{model_message(body).name}?"


def _omission_notes(world: World) -> Iterator[SpawnNote]:
    """Notes on properties that are not sent to Unreal; snapshots still have them."""
    for omission in untranslatable_fields(world):
        yield SpawnNote(
            SpawnNoteKind.UNSTATED,
            tuple(omission.ids),
            f"{omission.field} not sent to Unreal: {omission.text}",
        )


# ruff: noqa: D102 - the methods of an engine are documented in the protocol

_ROUNDED_M, _ROUNDED_RAD = 2e-6, 1e-5
"""Rounding error of a pose near the origin after conversion to single-precision centimeters and back, and a margin."""
_MAX_STEP_GAP_S = 0.5
"""Steps with a shorter gap between them are one period of time, which includes the gap [s]."""
_POLL_INTERVAL_S = 0.5
"""Interval of connection checks during a step [s]."""
_log = logging.getLogger("mindstage.engines.remote")


class UnrealEngine(EditingEngine, RemoteEngine):
    """The part of the `Engine` protocol that the plugin supports.

    Bodies that others delete in Unreal are removed from poses and snapshots with a warning. When all are gone, every
    call raises `EngineUnavailableError` until a world is spawned or the engine is cleared.
    """

    profile = RemoteProfile.UNREAL
    capabilities: frozenset[Capability] = frozenset()

    def __init__(
        self,
        client: ServiceClient,
        *,
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Creates an engine without bodies.

        Args:
            client: connection to the server.
            now_s: returns the wall-clock time [s].
            sleep: waits for a duration [s].
        """
        super().__init__(client)
        self._client_api = UROSWorldControlClient(client)
        self._registry = EntityRegistry()
        self._pivots: dict[BodyId, Vector] = {}
        """Origins of meshes that are not centered, relative to the centers of bodies [m]."""
        self._unconfirmed_worlds: list[World] = []
        """Worlds whose spawn failed halfway, so that some of their bodies may exist."""
        self._world_lost = False
        self._now_s, self._sleep = now_s, sleep
        self._start_s = self._stepped_until_s = now_s()

    @classmethod
    def is_available(cls, client: ServiceClient) -> bool:
        """Whether the plugin answers at the address."""
        return UROSWorldControlClient(client).is_available

    @property
    def time_s(self) -> float:
        """Wall-clock time since the engine was created [s], since Unreal does not report its own."""
        self._require_open()
        self._client_api.ping()
        return self._now_s() - self._start_s

    def ping(self) -> float:
        self._require_open()
        start = time.perf_counter()
        self._client_api.ping()
        return time.perf_counter() - start

    # -- the world -----------------------------------------------------------------------------------------------------

    def _entities(self) -> EntityRegistry:
        self._require_open()
        return self._registry

    def _decisions(self, ids: Collection[BodyId]) -> tuple[SimulatedBodies, Mapping[BodyId, BodyGeometry]]:
        return SimulatedBodies(), {}

    def _perform(self, edit: Edit) -> Performed:
        if isinstance(edit, Spawn):
            return Performed(self._spawn(edit.world))
        registry = self._require_world()
        match edit:
            case Delete():
                self._delete(registry, edit.bodies)
            case Attach():
                trial = registry.copy()
                trial.attach(edit.parent, edit.child)
                attach = wire.AttachModelToParent.Request(parent_id=edit.parent, child_id=edit.child)
                reply = self._client_api.call(wire.AttachModelToParent, attach)
                self._require(reply.success, f"attach {edit.child!r} to {edit.parent!r}")
                self._registry = trial
            case Detach() if edit.child in registry.parents:
                raise self._unsupported("detach", "delete that body and spawn it again")
            case SetPhysics():
                properties = physics_message(edit.physics)
                change = wire.SetPhysicsProperties.Request(id=edit.id, physics_properties=properties)
                reply = self._client_api.call(wire.SetPhysicsProperties, change)
                self._require(reply.success, f"change the physics of {edit.id!r}")
                registry.change(edit)
            case SetMaterials():
                paint = wire.SetMaterial.Request(
                    id=edit.id,
                    material_names=tuple(material.name for material in edit.materials),
                    material_paths=tuple(material.path for material in edit.materials),
                )
                reply = self._client_api.call(wire.SetMaterial, paint)
                self._require(reply.success, f"change the material of {edit.id!r}")
                registry.change(edit)
            case BodyEdit():
                registry.change(edit)
        return Performed()

    def _restore(self, edit: RestoreBodies, displaced: Mapping[BodyId, Array]) -> None:
        bodies = (replace(body, pose=pose_from_array(edit.poses[body.id])) for body in edit.world.bodies)
        self._spawn(replace(edit.world, bodies=tuple(bodies)))

    def _rows(self) -> dict[BodyId, Array]:
        return {id: normalized_pose_array(body.pose) for id, body in self._registry.bodies.items()}

    def _spawn(self, world: World) -> SpawnReport:
        self._require_open()
        if self._world_lost:
            self._reset()
        self._delete_unconfirmed()
        before = set(self._registry.ids)
        try:
            report, self._registry = spawn_in_unreal(self._client_api, self._registry, world)
        except EngineError:
            self._unconfirmed_worlds.append(world)
            raise
        spawned = set(self._registry.ids) - before
        self._pivots = {id: pivot for id, pivot in self._pivots.items() if id in before}
        self._pivots |= {id: pivot for id, pivot in mesh_pivots(world).items() if id in spawned}
        return report

    def _delete(self, registry: EntityRegistry, ids: Iterable[BodyId]) -> None:
        removed = {registry.body(id).id: None for id in ids}
        joints = [each.id for each in registry.joints.values() if {each.parent, each.child} & removed.keys()]
        remaining = self._client_api.delete(removed)
        self._client_api.delete(joints)
        registry.remove(removed.keys() - set(remaining))
        if remaining:
            raise WorldError(f"Unreal did not delete {', '.join(map(repr, remaining))}, without a reason")

    def clear(self) -> None:
        self._require_open()
        self._client_api.call(wire.DeleteAll, _delete_all_request(), entity_count=len(self._registry.bodies))
        self._client_api.delete([*self._registry.joints, *self._registry.bodies])  # whatever has lost its tags
        self._reset()

    def snapshot(self) -> World:
        _, poses = self.poses()
        return self._registry.to_world(poses, tolerance_m=_ROUNDED_M, tolerance_rad=_ROUNDED_RAD)

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _set_pose(self, id: BodyId, pose: Pose, *, restores: bool) -> None:
        registry = self._require_world()
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)
        placed = _pose_of_pivot(pose, self._pivots.get(id, _CENTERED))
        request = wire.SetModelPose.Request(id=id, pose=pose_message(placed))
        if not self._client_api.call(wire.SetModelPose, request).success:
            raise PoseUnreachableError(id, reason="Unreal did not set the pose, without a reason")
        registry.move(id, pose)

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        """Outlines bodies in the nearest of the plugin's five colors."""
        registry = self._require_world()
        highlighted = [registry.body(id).id for id in ids]
        requests = [wire.HighlightModel.Request(id=id, color=color_code(color)) for id in highlighted]
        replies = list(self._client_api.call_each(wire.HighlightModel, requests))
        registry.highlight([id for id, reply in zip(highlighted, replies, strict=True) if reply.success], color)
        for id, reply in zip(highlighted, replies, strict=True):
            self._require(reply.success, f"highlight {id!r}")

    def highlights(self) -> Mapping[BodyId, Color]:
        """The requested colors."""
        return MappingProxyType(self._require_world().highlighted)

    @checked
    def apply_force(self, id: BodyId, force: ForceVector, point: Point | None = None) -> None:
        if self._require_world().body(id).physics.is_dynamic:
            raise self._unsupported("apply forces", "move bodies with set_pose")

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        registry = self._require_world()
        replies = self._client_api.poses(registry.ids)
        missing = [id for id, reply in zip(registry.ids, replies, strict=True) if not reply.success]
        if missing and len(missing) == len(replies):
            self._world_lost = True
            self._require_world()
        elif missing:
            _log.warning("%s: no longer in the world: %s", self.name, ", ".join(missing))
            registry.remove(missing)
        poses = pose_array_from_messages([reply.pose for reply in replies if reply.success])
        rows = [row for row, id in enumerate(registry.ids) if id in self._pivots]
        if rows:
            offsets = [(*np.negative(self._pivots[registry.ids[row]]), 1.0, 0.0, 0.0, 0.0) for row in rows]
            poses[rows] = pose_multiply(poses[rows], offsets)
        return registry.ids, poses

    # -- time and state ------------------------------------------------------------------------------------------------

    @checked
    def step(self, duration_s: Duration) -> None:
        """Waits for a duration; consecutive steps are one period of time."""
        self._require_world()
        now_s = self._now_s()
        begin_s = self._stepped_until_s if now_s - self._stepped_until_s < _MAX_STEP_GAP_S else now_s
        self._stepped_until_s = end_s = begin_s + duration_s
        while (left_s := end_s - self._now_s()) > 0.0:
            self._sleep(min(left_s, _POLL_INTERVAL_S))
            self._client.wait_ready()

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        self._require_world()
        return {}

    def save_state(self) -> SavedState:
        self._require_world()
        raise self._unsupported("save its state", "take a snapshot of the world instead")

    def restore_state(self, state: SavedState) -> None:
        self._require_world()
        raise self._unsupported("restore a state", "clear it and spawn a snapshot")

    # -- state ---------------------------------------------------------------------------------------------------------

    def _require_world(self) -> EntityRegistry:
        """The registry of spawned bodies.

        Raises:
            EngineUnavailableError: none of them exists any more.
        """
        self._require_open()
        if self._world_lost:
            cause = "no spawned body exists any more; its level was restarted, or cleared by other clients"
            raise EngineUnavailableError(self.name, cause=cause, remedy="spawn the world again, or clear the engine")
        return self._registry

    def _delete_unconfirmed(self) -> None:
        """Deletes what may be left of worlds whose spawn failed; only bodies of Mindstage have its tag."""
        while self._unconfirmed_worlds:
            known = self._registry.bodies
            bodies = [body for body in self._unconfirmed_worlds[0].bodies if body.id not in known]
            list(self._client_api.call_each(wire.DeleteAll, [_delete_all_request(body.iri) for body in bodies]))
            del self._unconfirmed_worlds[0]

    def _reset(self) -> None:
        self._registry = EntityRegistry()
        self._unconfirmed_worlds.clear()
        self._world_lost = False

    def _require(self, success: bool, action: str) -> None:
        if not success:
            raise WorldError(f"Unreal did not {action}, without a reason")

    def _unsupported(self, action: str, remedy: str) -> UnsupportedByEngineError:
        return UnsupportedByEngineError(self.name, what=action, remedy=remedy)


def _delete_all_request(iri: str = "") -> wire.DeleteAll.Request:
    """Selects all models spawned by Mindstage, or the one with an IRI, by their tag."""
    return wire.DeleteAll.Request(
        type_to_delete="Mindstage", key_to_delete="Iri", value_to_delete=iri, ignore_value=not iri
    )
