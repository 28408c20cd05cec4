"""Templates: a world, or a part of one, as the pattern for something new with another name in another place."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from msgspec.structs import replace

from mindstage.ros.names import iri_namespace
from mindstage.world import Attachment, Body, BodyId, Iri, Joint, Pose, World
from mindstage.world.geometry import Array, normalized_pose_array, pose_from_array, pose_inverse, pose_multiply

__all__ = ["clone_at", "root_body", "subtree"]


def root_body(world: World) -> Body | None:
    """The body that all others of a description hang on: the first one that hangs on nothing; None of none."""
    held = {hold.child for hold in world.attachments} | {joint.child for joint in world.joints}
    roots = [body for body in world.bodies if body.id not in held] or list(world.bodies)
    return roots[0] if roots else None


def subtree(world: World, id: BodyId) -> World:
    """A body with all that hangs on it."""
    kept = {id}
    while more := {hold.child for hold in world.attachments if hold.parent in kept} - kept:
        kept |= more
    return replace(
        world,
        bodies=tuple(body for body in world.bodies if body.id in kept),
        joints=(),
        attachments=tuple(hold for hold in world.attachments if hold.parent in kept and hold.child in kept),
        lights=(),
        facts=(),
        resources=(),
    )


def clone_at(template: World, root: Body, *, name: str, pose: Pose | None, map: str) -> World:
    """A new thing like another one.

    Args:
        template: the thing and its parts.
        root: what its name and pose are those of.
        name: of the root; the parts are called `name/part`.
        pose: where the root is to be; None leaves everything where the template has it.
        map: the IRI of the map whose the new individuals are.
    """

    def renamed(id: BodyId) -> BodyId:
        return BodyId(name if id == root.id else f"{name}/{id}")

    move = _pose_transform(root.pose, pose)
    space = iri_namespace(map)
    return World(
        iri=Iri(map),
        bodies=tuple(_clone_body(body, renamed(body.id), space, move) for body in template.bodies),
        joints=tuple(_clone_joint(joint, renamed, space, move) for joint in template.joints),
        attachments=_attachments(template.attachments, renamed),
    )


def _pose_transform(before: Pose, after: Pose | None) -> Callable[[Pose], Pose]:
    if after is None:
        return lambda pose: pose
    after_from_before: Array = pose_multiply(normalized_pose_array(after), pose_inverse(normalized_pose_array(before)))
    return lambda pose: (
        after if pose == before else pose_from_array(pose_multiply(after_from_before, normalized_pose_array(pose)))
    )


def _clone_body(body: Body, id: BodyId, namespace: str, transform: Callable[[Pose], Pose]) -> Body:
    return replace(body, id=id, iri=Iri(namespace + id), pose=transform(body.pose))


def _clone_joint(
    joint: Joint, new_ids: Callable[[BodyId], BodyId], namespace: str, transform: Callable[[Pose], Pose]
) -> Joint:
    id = new_ids(joint.id)
    ends = {"parent": new_ids(joint.parent), "child": new_ids(joint.child)}
    return replace(joint, id=id, iri=Iri(namespace + id), pose=transform(joint.pose), **ends)


def _attachments(attachments: Iterable[Attachment], new_ids: Callable[[BodyId], BodyId]) -> tuple[Attachment, ...]:
    return tuple(Attachment(parent=new_ids(hold.parent), child=new_ids(hold.child)) for hold in attachments)
