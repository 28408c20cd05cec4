"""Delivery: a world goes to Unreal's plugin: bodies first, and once they stand, constraints and attachments.

The plugin would join what is left of a pair to whatever has the other's id. So it is sent only constraints and
attachments between bodies that stand there because of us.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from mindstage.bridge.description import (
    joint_message,
    model_message,
    relation_message,
    spawn_model_request,
    untranslatable_fields,
)
from mindstage.engines.contract import SpawnFailure, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.engines.inventory import AddResult, EntityRegistry
from mindstage.engines.remote.plugin import UROSWorldControlClient
from mindstage.errors import BodyExistsError
from mindstage.msgs import world_control_msgs as wire
from mindstage.world import Attachment, Body, World

__all__ = ["spawn_in_unreal"]

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
