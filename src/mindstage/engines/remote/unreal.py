"""UnrealEngine: a world in Unreal, by the services of its plugin UROSWorldControl and by no others.

What the plugin has no service for is an `UnsupportedByEngineError`: to detach, to push, to keep a state. It has none either that
tells what stands there. So the log is the world as it was given, with the poses that are read, one by one; a pose
that Unreal has only rounded comes back as it was given. Unreal's time is its own and passes as the clock on the wall
does: `step` waits for it.

Plugin: the services of Unreal's UROSWorldControl, by the names that it gives them.

Delivery: a world goes to Unreal's plugin: bodies first, and once they stand, constraints and attachments.

The plugin would join what is left of a pair to whatever has the other's id. So it is sent only constraints and
attachments between bodies that stand there because of us.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from mindstage.bridge.conversions import color_code, pose_array_from_messages, pose_message
from mindstage.bridge.conversions_unreal import (
    joint_message,
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
from mindstage.engines.registry import AddResult, EntityRegistry, pose_error
from mindstage.engines.remote.client import RemoteProfile, ServiceClient
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
from mindstage.scene import (
    NO_GEOMETRY,
    Attachment,
    Body,
    BodyId,
    BodyPhysics,
    Color,
    GeometryMap,
    Material,
    Pose,
    Vector,
    World,
)
from mindstage.scene.transforms import pose_array, pose_from_array, quat_angle

__all__ = ["TIMEOUT_PER_ENTITY_S", "UROSWorldControlClient", "UnrealEngine", "spawn_in_unreal"]


TIMEOUT_PER_ENTITY_S = 0.05
"""So much longer may a call take for each model or constraint that it is about [s]."""
_SERVICE_NAMES: dict[type[Service], str] = {
    wire.SetMaterial: "change_material",
    wire.HighlightModel: "highlight_models",
}
"""Services that are not called after their type."""
_PING_REQUEST = wire.GetModelPose.Request(id="mindstage-ping")


class UROSWorldControlClient:
    """Calls one plugin."""

    def __init__(self, client: ServiceClient) -> None:
        self.client = client

    @property
    def is_available(self) -> bool:
        """Whether anybody at the other end offers its services."""
        return self.client.is_available(self._service_name(wire.GetModelPose), wire.GetModelPose, _PING_REQUEST)

    def call(self, service: type[Service], request: Message, *, entity_count: int = 0) -> Any:
        """Calls one service.

        Args:
            service: which.
            request: every field of it is sent.
            parts: how many models and constraints it is about, and so how long it may take.
        """
        self.client.wait_ready()
        patience_s = self.client.timeout_s + TIMEOUT_PER_ENTITY_S * entity_count
        return self.client.call(self._service_name(service), service, request, timeout_s=patience_s)

    def call_each(self, service: type[Service], requests: Sequence[Message]) -> Iterator[Any]:
        """Calls one service many times; the responses come in the order of the requests."""
        self.client.wait_ready()
        patience_s = self.client.timeout_s + TIMEOUT_PER_ENTITY_S * len(requests)
        return self.client.call_each(self._service_name(service), service, requests, timeout_s=patience_s)

    def poses(self, ids: Iterable[BodyId]) -> list[wire.GetModelPose.Response]:
        """Where models are; they are read one by one."""
        return list(self.call_each(wire.GetModelPose, [wire.GetModelPose.Request(id=id) for id in ids]))

    def ping(self) -> None:
        """Asks for a sign of life: where somebody is whom nobody knows."""
        self.call(wire.GetModelPose, _PING_REQUEST)

    def delete(self, ids: Iterable[BodyId]) -> tuple[BodyId, ...]:
        """Takes models away; gives those that are still there."""
        wanted = tuple(ids)
        replies = self.call_each(wire.DeleteModel, [wire.DeleteModel.Request(id=id) for id in wanted])
        refused = [id for id, reply in zip(wanted, replies, strict=True) if not reply.success]
        return tuple(id for id, reply in zip(refused, self.poses(refused), strict=True) if reply.success)

    def _service_name(self, service: type[Service]) -> str:
        name = _SERVICE_NAMES.get(service) or snake_case(service)
        return "/".join(("", *filter(None, self.client.address.namespace.split("/")), name))


_NO_REASON = "Unreal's plugin did not spawn it, and gives no reason"


def spawn_in_unreal(
    client: UROSWorldControlClient, registry: EntityRegistry, world: World
) -> tuple[SpawnReport, EntityRegistry]:
    """Spawns what can be spawned; gives what became of it, and what stands there now.

    Raises:
        EngineError: the far side broke, and nobody knows what of it stands.
    """
    trial = registry.copy()
    fitting = trial.add(world)
    failed = _spawn_bodies(client, [trial.bodies[id] for id in fitting.bodies])
    fallen = {failure.id for failure in failed}
    standing = tuple(trial.bodies[id] for id in fitting.bodies if id not in fallen)
    trial = registry.copy()
    added = trial.add(msgspec.structs.replace(world, bodies=standing))
    _spawn_joints_and_attachments(client, trial, added)
    added.failed_bodies[:] = [*fitting.failed_bodies, *failed]
    return added.report(_omission_notes(world)), trial


def _spawn_bodies(client: UROSWorldControlClient, bodies: Sequence[Body]) -> list[SpawnFailure]:
    """Spawns them, and tells which do not stand."""
    if not bodies:
        return []
    request = wire.SpawnSemanticMap.Request(models=tuple(map(model_message, bodies)))
    refused = set(_spawn_map(client, request, entity_count=len(bodies)).failed_model_ids)
    again = [body for body in bodies if body.id in refused]
    # Only the reply to one alone says why; and should it stand now, all the better.
    replies = client.call_each(wire.SpawnModel, [spawn_model_request(body) for body in again])
    return [
        SpawnFailure(body.id, _failure_reason(body, reply.etype))
        for body, reply in zip(again, replies, strict=True)
        if not reply.success
    ]


def _spawn_joints_and_attachments(client: UROSWorldControlClient, registry: EntityRegistry, added: AddResult) -> None:
    """Spawns the constraints and attachments that were added, and takes back those that do not stand."""
    constraints = [registry.joints[id] for id in added.joints]
    attachments = [Attachment(parent=registry.parents[child], child=child) for child in added.attachments]
    if not constraints and not attachments:
        return
    request = wire.SpawnSemanticMap.Request(
        constraints=tuple(map(joint_message, constraints)),
        relations=tuple(map(relation_message, attachments)),
    )
    reply = _spawn_map(client, request, entity_count=len(constraints) + len(attachments))
    loose = set(reply.failed_constraint_ids)
    for id in [id for id in added.joints if id in loose]:
        added.joints.remove(id)
        added.failed_joints.append(SpawnFailure(id, _NO_REASON))
        del registry.joints[id]
    dropped = {relation.child_id for relation in reply.failed_relations}
    for child in [child for child in added.attachments if child in dropped]:
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
            raise ValueError("success with failures" if failed else "no success, and nothing that failed")
    return reply


def _failure_reason(body: Body, etype: str) -> str:
    match etype:
        case wire.SpawnModel.Response.ID_TAKEN:
            return str(BodyExistsError(body.id))
        case wire.SpawnModel.Response.OBSTRUCTED:
            return "something stands in its place"
    return f"{_NO_REASON}; is there a mesh SM_{model_message(body).name} among its content?"


def _omission_notes(world: World) -> Iterator[SpawnNote]:
    """What Unreal does not know of the world; the log has it all the same."""
    for remark in untranslatable_fields(world):
        yield SpawnNote(
            SpawnNoteKind.NOT_TRANSFERRED, tuple(remark.ids), f"Unreal does not know its {remark.field}: {remark.text}"
        )


# ruff: noqa: D102 - the contract documents an engine's methods, once for all

_ROUNDED_M, _ROUNDED_RAD = 2e-6, 1e-5
"""What single precision does to a pose of a meter's size on its way to centimetres and back, and some more."""
_MAX_STEP_GAP_S = 0.5
"""Steps that follow one another so quickly are one stretch of time: what passes between them counts [s]."""
_POLL_INTERVAL_S = 0.5
"""How often it is looked, while time passes, whether Unreal is still there [s]."""
_log = logging.getLogger("mindstage.engines.remote")


class UnrealEngine(RemoteEngine):
    """As much of the contract as the plugin can keep.

    What others take away in Unreal leaves the poses and the log with a warning. When everything is gone, every call
    says so until something is spawned, or all is cleared.
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
        """An engine that has spawned nothing yet.

        Args:
            link: to whom the plugin's services are offered.
            now_s: the clock on the wall [s].
            sleep: waits so long [s].
        """
        super().__init__(client)
        self._client_api = UROSWorldControlClient(client)
        self._registry = EntityRegistry()
        self._unconfirmed_worlds: list[World] = []
        """Worlds whose spawning broke off: nobody knows what of them stands."""
        self._world_lost = False
        self._now_s, self._sleep = now_s, sleep
        self._start_s = self._stepped_until_s = now_s()

    @classmethod
    def is_available(cls, client: ServiceClient) -> bool:
        """Whether someone at the other end speaks so."""
        return UROSWorldControlClient(client).is_available

    @property
    def time_s(self) -> float:
        """Time on the wall since this engine was made [s]: Unreal does not tell its own, only that it lives."""
        self._require_open()
        self._client_api.ping()
        return self._now_s() - self._start_s

    def ping(self) -> float:
        self._require_open()
        start = time.perf_counter()
        self._client_api.ping()
        return time.perf_counter() - start

    # -- the world -----------------------------------------------------------------------------------------------------

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        self._require_open()
        if self._world_lost:
            self._reset()
        self._delete_unconfirmed()
        try:
            report, self._registry = spawn_in_unreal(self._client_api, self._registry, world)
        except EngineError:
            self._unconfirmed_worlds.append(world)
            raise
        return report

    def delete(self, ids: Iterable[BodyId]) -> None:
        inventory = self._require_world()
        wanted = {inventory.body(id).id: None for id in ids}
        joints = [each.id for each in inventory.joints.values() if {each.parent, each.child} & wanted.keys()]
        left = self._client_api.delete(wanted)
        self._client_api.delete(joints)
        inventory.remove(wanted.keys() - set(left))
        if left:
            raise WorldError(f"Unreal does not take {', '.join(map(repr, left))} away, and gives no reason")

    def clear(self) -> None:
        self._require_open()
        self._client_api.call(wire.DeleteAll, _delete_all_request(), entity_count=len(self._registry.bodies))
        self._client_api.delete([*self._registry.joints, *self._registry.bodies])  # whoever has lost its tags
        self._reset()

    def attach(self, parent: BodyId, child: BodyId) -> None:
        trial = self._require_world().copy()
        trial.attach(parent, child)
        request = wire.AttachModelToParent.Request(parent_id=parent, child_id=child)
        self._require(self._client_api.call(wire.AttachModelToParent, request).success, f"hang {child!r} on {parent!r}")
        self._registry = trial

    def detach(self, child: BodyId) -> None:
        inventory = self._require_world()
        inventory.body(child)
        if child in inventory.parents:
            raise self._unsupported("detach", "delete that body and spawn it again")

    def snapshot(self) -> World:
        ids, now = self.poses()
        given = pose_array(body.pose for body in self._registry.bodies.values())
        scale = np.maximum(1.0, np.abs(given[:, :3]).max(axis=1, initial=1.0))
        stayed = (np.abs(now[:, :3] - given[:, :3]).max(axis=1, initial=0.0) <= _ROUNDED_M * scale) & (
            quat_angle(given[:, 3:], now[:, 3:]) <= _ROUNDED_RAD
        )
        return self._registry.to_world(
            {ids[row]: pose_from_array(now[row]) for row in np.flatnonzero(~stayed).tolist()}
        )

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        inventory = self._require_world()
        inventory.body(id)
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)
        request = wire.SetModelPose.Request(id=id, pose=pose_message(pose))
        if not self._client_api.call(wire.SetModelPose, request).success:
            raise PoseUnreachableError(id, reason="Unreal does not put it there, and gives no reason")
        inventory.replace(id, pose=pose)

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        inventory = self._require_world()
        inventory.body(id)
        request = wire.SetPhysicsProperties.Request(id=id, physics_properties=physics_message(physics))
        self._require(
            self._client_api.call(wire.SetPhysicsProperties, request).success, f"change the physics of {id!r}"
        )
        inventory.replace(id, physics=physics)

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        inventory = self._require_world()
        inventory.body(id)
        request = wire.SetMaterial.Request(
            id=id,
            material_names=tuple(material.name for material in materials),
            material_paths=tuple(material.path for material in materials),
        )
        self._require(self._client_api.call(wire.SetMaterial, request).success, f"change the material of {id!r}")
        inventory.replace(id, materials=materials)

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        """Outlines bodies in that of the plugin's five colors which is nearest."""
        inventory = self._require_world()
        wanted = [inventory.body(id).id for id in ids]
        requests = [wire.HighlightModel.Request(id=id, color=color_code(color)) for id in wanted]
        replies = list(self._client_api.call_each(wire.HighlightModel, requests))
        inventory.highlight([id for id, reply in zip(wanted, replies, strict=True) if reply.success], color)
        for id, reply in zip(wanted, replies, strict=True):
            self._require(reply.success, f"light up {id!r}")

    def highlights(self) -> Mapping[BodyId, Color]:
        """In the colors that were asked for."""
        return MappingProxyType(self._require_world().highlighted)

    def apply_force(self, id: BodyId, force: Vector, point: Vector | None = None) -> None:
        if self._require_world().body(id).physics.is_dynamic:
            raise self._unsupported("push bodies", "put them where they shall be with set_pose")

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        inventory = self._require_world()
        replies = self._client_api.poses(inventory.ids)
        missing = [id for id, reply in zip(inventory.ids, replies, strict=True) if not reply.success]
        if missing and len(missing) == len(replies):
            self._world_lost = True
            self._require_world()
        elif missing:
            _log.warning("%s: no longer there: %s", self.name, ", ".join(missing))
            inventory.remove(missing)
        return inventory.ids, pose_array_from_messages([reply.pose for reply in replies if reply.success])

    # -- time and state ------------------------------------------------------------------------------------------------

    def step(self, duration_s: float) -> None:
        """Waits until so much time has passed; steps in a row are one stretch of time."""
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
        raise self._unsupported("keep its state", "log the world in its place")

    def restore_state(self, state: SavedState) -> None:
        self._require_world()
        raise self._unsupported("bring a state back", "clear, and spawn a world that was logged")

    # -- what stands there ---------------------------------------------------------------------------------------------

    def _require_world(self) -> EntityRegistry:
        """What was spawned and is still there.

        Raises:
            EngineUnavailableError: none of it is.
        """
        self._require_open()
        if self._world_lost:
            cause = "nothing that was spawned is there any more; its level was started anew, or cleared by others"
            raise EngineUnavailableError(self.name, cause=cause, remedy="spawn it again, or clear first")
        return self._registry

    def _delete_unconfirmed(self) -> None:
        """Takes away what may stand of worlds whose spawning broke off; nobody else's models have our tag."""
        while self._unconfirmed_worlds:
            known = self._registry.bodies
            left = [body for body in self._unconfirmed_worlds[0].bodies if body.id not in known]
            list(self._client_api.call_each(wire.DeleteAll, [_delete_all_request(body.iri) for body in left]))
            del self._unconfirmed_worlds[0]

    def _reset(self) -> None:
        self._registry = EntityRegistry()
        self._unconfirmed_worlds.clear()
        self._world_lost = False

    def _require(self, success: bool, what: str) -> None:
        if not success:
            raise WorldError(f"Unreal does not {what}, and gives no reason")

    def _unsupported(self, what: str, remedy: str) -> UnsupportedByEngineError:
        return UnsupportedByEngineError(self.name, what=what, remedy=remedy)


def _delete_all_request(iri: str = "") -> wire.DeleteAll.Request:
    """All models that Mindstage spawned, or the one of that IRI: they have a tag that nobody else's have."""
    return wire.DeleteAll.Request(
        type_to_delete="Mindstage", key_to_delete="Iri", value_to_delete=iri, ignore_value=not iri
    )
