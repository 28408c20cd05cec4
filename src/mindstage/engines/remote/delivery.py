"""Delivery: a world goes to Unreal's plugin: bodies first, and once they stand, constraints and attachments.

The plugin would join what is left of a pair to whatever has the other's id. So it is sent only constraints and
attachments between bodies that stand there because of us.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from mindstage.bridge.description import (
    constraint_description,
    model_description,
    model_request,
    relation_description,
    unsaid,
)
from mindstage.engines.contract import Failure, Note, NoteKind, SpawnReport
from mindstage.engines.inventory import Added, Inventory
from mindstage.engines.remote.plugin import Plugin
from mindstage.errors import BodyExists
from mindstage.msgs import world_control_msgs as wire
from mindstage.world import Attachment, Body, World

__all__ = ["deliver"]

_NO_REASON = "Unreal's plugin did not spawn it, and gives no reason"


def deliver(plugin: Plugin, inventory: Inventory, world: World) -> tuple[SpawnReport, Inventory]:
    """Spawns what can be spawned; gives what became of it, and what stands there now.

    Raises:
        EngineError: the far side broke, and nobody knows what of it stands.
    """
    trial = inventory.copy()
    fitting = trial.add(world)
    failed = _spawn_bodies(plugin, [trial.bodies[id] for id in fitting.bodies])
    fallen = {failure.id for failure in failed}
    standing = tuple(trial.bodies[id] for id in fitting.bodies if id not in fallen)
    trial = inventory.copy()
    added = trial.add(msgspec.structs.replace(world, bodies=standing))
    _join_bodies(plugin, trial, added)
    added.failed_bodies[:] = [*fitting.failed_bodies, *failed]
    return added.report(_notes(world)), trial


def _spawn_bodies(plugin: Plugin, bodies: Sequence[Body]) -> list[Failure]:
    """Spawns them, and tells which do not stand."""
    if not bodies:
        return []
    request = wire.SpawnSemanticMap.Request(models=tuple(map(model_description, bodies)))
    refused = set(_spawned(plugin, request, parts=len(bodies)).failed_model_ids)
    again = [body for body in bodies if body.id in refused]
    # Only the reply to one alone says why; and should it stand now, all the better.
    replies = plugin.call_each(wire.SpawnModel, [model_request(body) for body in again])
    return [
        Failure(body.id, _reason(body, reply.etype))
        for body, reply in zip(again, replies, strict=True)
        if not reply.success
    ]


def _join_bodies(plugin: Plugin, inventory: Inventory, added: Added) -> None:
    """Spawns the constraints and attachments that were added, and takes back those that do not stand."""
    constraints = [inventory.constraints[id] for id in added.constraints]
    attachments = [Attachment(parent=inventory.parents[child], child=child) for child in added.attachments]
    if not constraints and not attachments:
        return
    request = wire.SpawnSemanticMap.Request(
        constraints=tuple(map(constraint_description, constraints)),
        relations=tuple(map(relation_description, attachments)),
    )
    reply = _spawned(plugin, request, parts=len(constraints) + len(attachments))
    loose = set(reply.failed_constraint_ids)
    for id in [id for id in added.constraints if id in loose]:
        added.constraints.remove(id)
        added.failed_constraints.append(Failure(id, _NO_REASON))
        del inventory.constraints[id]
    dropped = {relation.child_id for relation in reply.failed_relations}
    for child in [child for child in added.attachments if child in dropped]:
        added.attachments.remove(child)
        added.failed_attachments.append(Failure(child, _NO_REASON))
        inventory.detach(child)


def _spawned(plugin: Plugin, request: wire.SpawnSemanticMap.Request, *, parts: int) -> wire.SpawnSemanticMap.Response:
    reply: wire.SpawnSemanticMap.Response = plugin.call(wire.SpawnSemanticMap, request, parts=parts)
    failed = bool(reply.failed_model_ids or reply.failed_constraint_ids or reply.failed_relations)
    with plugin.link.making_sense("spawn_semantic_map"):
        if reply.success is failed:
            raise ValueError("success with failures" if failed else "no success, and nothing that failed")
    return reply


def _reason(body: Body, etype: str) -> str:
    match etype:
        case wire.SpawnModel.Response.ID_TAKEN:
            return str(BodyExists(body.id))
        case wire.SpawnModel.Response.OBSTRUCTED:
            return "something stands in its place"
    return f"{_NO_REASON}; is there a mesh SM_{model_description(body).name} among its content?"


def _notes(world: World) -> Iterator[Note]:
    """What Unreal does not know of the world; the log has it all the same."""
    for remark in unsaid(world):
        yield Note(NoteKind.UNTOLD, tuple(remark.ids), f"Unreal does not know its {remark.field}: {remark.text}")
