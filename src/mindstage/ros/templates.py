"""Templates: a world, or a part of one, as the pattern for something new with another name in another place."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from msgspec.structs import replace

from mindstage.ros.names import namespace_of
from mindstage.world import Attachment, Body, BodyId, Constraint, Iri, Pose, World
from mindstage.world.geometry import Array, compose, invert, pose_from, unit_pose

__all__ = ["part_of", "placed", "root_of"]


def root_of(world: World) -> Body | None:
    """The body that all others of a description hang on: the first one that hangs on nothing; None of none."""
    held = {hold.child for hold in world.attachments} | {joint.child for joint in world.constraints}
    roots = [body for body in world.bodies if body.id not in held] or list(world.bodies)
    return roots[0] if roots else None


def part_of(world: World, id: BodyId) -> World:
    """A body with all that hangs on it."""
    kept = {id}
    while more := {hold.child for hold in world.attachments if hold.parent in kept} - kept:
        kept |= more
    return replace(
        world,
        bodies=tuple(body for body in world.bodies if body.id in kept),
        constraints=(),
        attachments=tuple(hold for hold in world.attachments if hold.parent in kept and hold.child in kept),
        lights=(),
        facts=(),
        resources=(),
    )


def placed(template: World, root: Body, *, name: str, pose: Pose | None, map: str) -> World:
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

    move = _mover(root.pose, pose)
    space = namespace_of(map)
    return World(
        iri=Iri(map),
        bodies=tuple(_body(body, renamed(body.id), space, move) for body in template.bodies),
        constraints=tuple(_constraint(joint, renamed, space, move) for joint in template.constraints),
        attachments=_attachments(template.attachments, renamed),
    )


def _mover(before: Pose, after: Pose | None) -> Callable[[Pose], Pose]:
    if after is None:
        return lambda pose: pose
    after_from_before: Array = compose(unit_pose(after), invert(unit_pose(before)))
    return lambda pose: after if pose == before else pose_from(compose(after_from_before, unit_pose(pose)))


def _body(body: Body, id: BodyId, space: str, move: Callable[[Pose], Pose]) -> Body:
    return replace(body, id=id, iri=Iri(space + id), pose=move(body.pose))


def _constraint(
    joint: Constraint, renamed: Callable[[BodyId], BodyId], space: str, move: Callable[[Pose], Pose]
) -> Constraint:
    id = renamed(joint.id)
    ends = {"parent": renamed(joint.parent), "child": renamed(joint.child)}
    return replace(joint, id=id, iri=Iri(space + id), pose=move(joint.pose), **ends)


def _attachments(holds: Iterable[Attachment], renamed: Callable[[BodyId], BodyId]) -> tuple[Attachment, ...]:
    return tuple(Attachment(parent=renamed(hold.parent), child=renamed(hold.child)) for hold in holds)
