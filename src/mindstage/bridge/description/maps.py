"""Maps: a whole world as one `spawn_semantic_map`, and back."""

from __future__ import annotations

from collections.abc import Container, Iterator
from itertools import count

from mindstage.bridge.description.constraints import constraint_description, constraint_from, unsaid_of_constraint
from mindstage.bridge.description.models import body_from, individual, model_description, unsaid_of_body
from mindstage.bridge.description.remarks import Remark, gathered
from mindstage.msgs import world_control_msgs
from mindstage.world import Attachment, BodyId, Iri, World

__all__ = ["attachment_from", "relation_description", "spawn_request", "unsaid", "world_from_request"]


def spawn_request(world: World) -> world_control_msgs.SpawnSemanticMap.Request:
    """A world for `spawn_semantic_map`; `unsaid` tells what is not in it."""
    return world_control_msgs.SpawnSemanticMap.Request(
        models=tuple(model_description(body) for body in world.bodies),
        constraints=tuple(constraint_description(constraint) for constraint in world.constraints),
        relations=tuple(relation_description(attachment) for attachment in world.attachments),
    )


def unsaid(world: World) -> tuple[Remark, ...]:
    """What of a world `spawn_semantic_map` has no way to say. What is not named here comes back as it was."""
    return gathered(_unsaid(world))


def world_from_request(
    request: world_control_msgs.SpawnSemanticMap.Request, *, iri: Iri, name: str = "", taken: Container[str] = ()
) -> tuple[World, tuple[Remark, ...]]:
    """The world that a request describes, and what was assumed on the way.

    Args:
        request: what came.
        iri: the IRI of the map, which no request tells; those of its things start like it.
        name: what to call the map.
        taken: ids that are not to be given to a model or a constraint without one.

    Raises:
        MessageRefused: the tags of a model that Mindstage wrote are broken.
    """
    namespace = _namespace(iri)
    named = {model.id for model in request.models} | {constraint.id for constraint in request.constraints}
    told: list[Remark] = []
    bodies, constraints = [], []
    for at, model in enumerate(request.models):
        id = model.id or _made(model.name or "Model", named, taken, told)
        body, assumed = body_from(model, id=id, namespace=namespace, path=f"models[{at}]")
        bodies.append(body)
        told += assumed
    for description in request.constraints:
        id = description.id or _made("Constraint", named, taken, told)
        constraint, aside = constraint_from(description, id=id, namespace=namespace)
        constraints.append(constraint)
        told += aside
    world = World(
        iri=iri,
        name=name,
        bodies=tuple(bodies),
        constraints=tuple(constraints),
        attachments=tuple(map(attachment_from, request.relations)),
    )
    return world, gathered(told)


def relation_description(attachment: Attachment) -> world_control_msgs.RelationDescription:
    """An attachment for the wire."""
    return world_control_msgs.RelationDescription(parent_id=attachment.parent, child_id=attachment.child)


def attachment_from(relation: world_control_msgs.RelationDescription) -> Attachment:
    """An attachment from the wire."""
    return Attachment(parent=BodyId(relation.parent_id), child=BodyId(relation.child_id))


def _unsaid(world: World) -> Iterator[Remark]:
    for body in world.bodies:
        yield from unsaid_of_body(body)
    for constraint in world.constraints:
        yield from unsaid_of_constraint(constraint)
        if constraint.iri != individual(constraint.id, _namespace(world.iri)):
            yield Remark("iri", (constraint.id,), "a constraint's IRI is not told; it is taken from its id")
    for light in world.lights:
        yield Remark("lights", (light.id,), "there are no lights there")
    if world.facts or world.resources:
        yield Remark("facts", (world.iri,), "what is said of the map and of anything but bodies stays behind")


def _namespace(iri: Iri) -> str:
    return iri.rpartition("#")[0] + "#" if "#" in iri else f"{iri}#"


def _made(stem: str, named: set[str], taken: Container[str], told: list[Remark]) -> str:
    """An id of its own for something that came without one."""
    tries = (f"{stem}_{number}" for number in count(1))
    id = next(each for each in tries if each not in named and each not in taken)
    named.add(id)
    told.append(Remark("id", (id,), "it came without an id and got this one"))
    return id
