"""Maps: a whole world as one `spawn_semantic_map`, and back."""

from __future__ import annotations

from collections.abc import Container, Iterator
from itertools import count

from mindstage.bridge.description.constraints import joint_from_message, joint_message, untranslatable_joint_fields
from mindstage.bridge.description.models import (
    body_from_message,
    iri_from_id,
    model_message,
    untranslatable_body_fields,
)
from mindstage.bridge.description.remarks import ConversionNote, merge_notes
from mindstage.msgs import world_control_msgs
from mindstage.world import Attachment, BodyId, Iri, World

__all__ = [
    "attachment_from_message",
    "relation_message",
    "spawn_request",
    "untranslatable_fields",
    "world_from_request",
]


def spawn_request(world: World) -> world_control_msgs.SpawnSemanticMap.Request:
    """A world for `spawn_semantic_map`; `untranslatable_fields` tells what is not in it."""
    return world_control_msgs.SpawnSemanticMap.Request(
        models=tuple(model_message(body) for body in world.bodies),
        constraints=tuple(joint_message(constraint) for constraint in world.joints),
        relations=tuple(relation_message(attachment) for attachment in world.attachments),
    )


def untranslatable_fields(world: World) -> tuple[ConversionNote, ...]:
    """What of a world `spawn_semantic_map` has no way to say. What is not named here comes back as it was."""
    return merge_notes(_untranslatable(world))


def world_from_request(
    request: world_control_msgs.SpawnSemanticMap.Request, *, iri: Iri, name: str = "", taken: Container[str] = ()
) -> tuple[World, tuple[ConversionNote, ...]]:
    """The world that a request describes, and what was assumed on the way.

    Args:
        request: what came.
        iri: the IRI of the map, which no request tells; those of its things start like it.
        name: what to call the map.
        taken: ids that are not to be given to a model or a constraint without one.

    Raises:
        MessageValidationError: the tags of a model that Mindstage wrote are broken.
    """
    namespace = _namespace(iri)
    named = {model.id for model in request.models} | {constraint.id for constraint in request.constraints}
    told: list[ConversionNote] = []
    bodies, constraints = [], []
    for at, model in enumerate(request.models):
        id = model.id or _generated_id(model.name or "Model", named, taken, told)
        body, assumed = body_from_message(model, id=id, namespace=namespace, path=f"models[{at}]")
        bodies.append(body)
        told += assumed
    for description in request.constraints:
        id = description.id or _generated_id("Constraint", named, taken, told)
        constraint, aside = joint_from_message(description, id=id, namespace=namespace)
        constraints.append(constraint)
        told += aside
    world = World(
        iri=iri,
        name=name,
        bodies=tuple(bodies),
        joints=tuple(constraints),
        attachments=tuple(map(attachment_from_message, request.relations)),
    )
    return world, merge_notes(told)


def relation_message(attachment: Attachment) -> world_control_msgs.RelationDescription:
    """An attachment for the wire."""
    return world_control_msgs.RelationDescription(parent_id=attachment.parent, child_id=attachment.child)


def attachment_from_message(relation: world_control_msgs.RelationDescription) -> Attachment:
    """An attachment from the wire."""
    return Attachment(parent=BodyId(relation.parent_id), child=BodyId(relation.child_id))


def _untranslatable(world: World) -> Iterator[ConversionNote]:
    for body in world.bodies:
        yield from untranslatable_body_fields(body)
    for constraint in world.joints:
        yield from untranslatable_joint_fields(constraint)
        if constraint.iri != iri_from_id(constraint.id, _namespace(world.iri)):
            yield ConversionNote("iri", (constraint.id,), "a constraint's IRI is not told; it is taken from its id")
    for light in world.lights:
        yield ConversionNote("lights", (light.id,), "there are no lights there")
    if world.facts or world.resources:
        yield ConversionNote("facts", (world.iri,), "what is said of the map and of anything but bodies stays behind")


def _namespace(iri: Iri) -> str:
    return iri.rpartition("#")[0] + "#" if "#" in iri else f"{iri}#"


def _generated_id(stem: str, name: set[str], taken: Container[str], notes: list[ConversionNote]) -> str:
    """An id of its own for something that came without one."""
    tries = (f"{stem}_{number}" for number in count(1))
    id = next(each for each in tries if each not in name and each not in taken)
    name.add(id)
    notes.append(ConversionNote("id", (id,), "it came without an id and got this one"))
    return id
