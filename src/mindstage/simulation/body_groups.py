"""Groups of bodies: the parts of bodies and what is on or in them, and copies of several bodies.

A copied group is text (JSON), so that it can be pasted into another simulation. Copies have ids of their own, the same
relative poses, and the joints and attachments among them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from typing import Literal

import msgspec
import numpy as np
from msgspec.structs import replace

from mindstage.errors import BodyNotFoundError, InvalidArgumentError, SpawnRefusedError
from mindstage.scene import Attachment, Body, BodyId, Iri, Joint, Pose, Vector, World
from mindstage.scene.bounding_boxes import world_bounds
from mindstage.scene.edits import counted_ids
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from mindstage.simulation.placement import FreePlaces, free_id, iri_prefix
from mindstage.simulation.state import EngineSession

__all__ = ["BodyGroup", "Dependents", "find_dependents", "paste_group"]

_MAX_GROUP = 2000
_LIFT_M = 0.002
"""A copy is tested for free space by so much above its pose, since bodies touch what they stand on."""
_SPACING_M = 0.02
_RINGS = 6
"""How many group sizes away a free place is searched."""


class Dependents(msgspec.Struct, frozen=True, kw_only=True):
    """What belongs to bodies, and what would lose its support without them."""

    parts: tuple[BodyId, ...] = ()
    """Bodies that are attached to them, or that a joint moves against them, such as a door and its handle."""
    contents: tuple[BodyId, ...] = ()
    """Loose bodies on or in them or their parts, and on or in those."""


def find_dependents(world: World, ids: Iterable[BodyId]) -> Dependents:
    """Finds the parts of bodies, and the loose bodies on and in them.

    Raises:
        BodyNotFoundError: for the first id that does not exist.
    """
    chosen = tuple(dict.fromkeys(ids))
    dynamic = {body.id: body.physics.is_dynamic for body in world.bodies}
    if unknown := [id for id in chosen if id not in dynamic]:
        raise BodyNotFoundError(unknown[0], known=dynamic, world=world.name)
    children: dict[BodyId, list[BodyId]] = {}
    for link in world.attachments:
        children.setdefault(link.parent, []).append(link.child)
    for joint in world.joints:
        # In some maps the moving body is the parent; what it moves against is no part of it.
        ends = (joint.parent, joint.child)
        fixed, moving = ends[::-1] if dynamic.get(joint.parent) and not dynamic.get(joint.child) else ends
        children.setdefault(fixed, []).append(moving)
    family = dict.fromkeys(chosen)
    waiting = list(chosen)
    while waiting:
        new = [each for each in children.get(waiting.pop(), ()) if each not in family and each in dynamic]
        family.update(dict.fromkeys(new))
        waiting += new
    jointed = {moving for moved in children.values() for moving in moved}
    loose = [id for id, is_dynamic in dynamic.items() if is_dynamic and id not in jointed and id not in family]
    contents = dict.fromkeys(_things_held(world, family, loose))
    return Dependents(parts=tuple(each for each in family if each not in chosen), contents=tuple(contents))


def _things_held(world: World, holders: Collection[BodyId], loose: Collection[BodyId]) -> Iterator[BodyId]:
    """Loose bodies on or in others, and on or in those."""
    held_by: dict[BodyId, list[BodyId]] = {}
    relations = (SpatialRelation.INSIDE, SpatialRelation.ON)
    for pair in SpatialRelations(world).related(subjects=loose, relations=relations):
        held_by.setdefault(pair.other.id, []).append(pair.body.id)
    seen, waiting = set(holders), list(holders)
    while waiting:
        for each in held_by.get(waiting.pop(), ()):
            if each not in seen:
                seen.add(each)
                waiting.append(each)
                yield each


class BodyGroup(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bodies with the joints and attachments among them, to be pasted here or elsewhere."""

    content: Literal["mindstage bodies"] = "mindstage bodies"
    format_version: Literal[1] = 1
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...] = ()
    attachments: tuple[Attachment, ...] = ()

    @classmethod
    def from_world(cls, world: World, ids: Iterable[BodyId]) -> BodyGroup:
        """Copies bodies with their parts; statements about the individuals themselves are left out.

        Raises:
            BodyNotFoundError: for the first id that does not exist.
        """
        chosen = tuple(ids)
        group = {*chosen, *find_dependents(world, chosen).parts}
        return cls(
            bodies=tuple(replace(body, facts=(), tags=()) for body in world.bodies if body.id in group),
            joints=tuple(
                replace(each, facts=(), tags=()) for each in world.joints if {each.parent, each.child} <= group
            ),
            attachments=tuple(each for each in world.attachments if {each.parent, each.child} <= group),
        )

    @classmethod
    def from_text(cls, text: str) -> BodyGroup:
        """Reads a copied group.

        Raises:
            InvalidArgumentError: the text is something else, or has too many bodies.
        """
        try:
            group = msgspec.json.decode(text, type=cls)
        except (msgspec.DecodeError, UnicodeEncodeError) as error:
            cause = f"it is not a copied group of bodies ({error})"
            raise InvalidArgumentError("the pasted text", cause=cause, remedy="copy bodies first") from None
        if not 0 < len(group.bodies) <= _MAX_GROUP:
            cause = f"it has {len(group.bodies)} bodies"
            raise InvalidArgumentError("the pasted text", cause=cause, remedy=f"paste 1 to {_MAX_GROUP}")
        return group

    @property
    def text(self) -> str:
        """The group as JSON."""
        return msgspec.json.encode(self).decode()


def paste_group(simulation: EngineSession, group: BodyGroup, *, verb: str = "pasted") -> tuple[BodyId, ...]:
    """Spawns copies of a group beside the original, or at its pose if that is free, as one edit of the history.

    Without free space within some group sizes the copies are beside the original all the same; a simulation that runs
    then moves them apart.

    Returns:
        The ids of the copies.

    Raises:
        InvalidArgumentError: a body cannot be spawned; none is spawned then.
    """
    world = _renamed(simulation, group)
    world = _moved(world, _free_offset(simulation, world))
    pasted = tuple(body.id for body in world.bodies)
    try:
        simulation.spawn(world, persistent=False, title=f"{counted_ids(pasted)} {verb}")
    except SpawnRefusedError as error:
        raise InvalidArgumentError(error.id, cause=error.reason) from error
    return pasted


def _renamed(simulation: EngineSession, group: BodyGroup) -> World:
    """The group as a world, with ids and IRIs that are not taken."""
    worlds, prefix = simulation.worlds, iri_prefix(simulation.worlds)
    taken = set(simulation.state.ids) | {joint.id for world in worlds for joint in world.joints}
    names: dict[BodyId, BodyId] = {}
    for id in (*(each.id for each in group.bodies), *(each.id for each in group.joints)):
        names[id] = BodyId(free_id(re.sub(r"_\d+$", "", id), taken))
        taken.add(names[id])
    first = next(iter(worlds), None)
    return World(
        iri=first.iri if first else Iri("http://mindstage.org/maps/new.owl#map"),
        name=first.name if first else "new",
        bodies=tuple(replace(each, id=names[each.id], iri=Iri(prefix + names[each.id])) for each in group.bodies),
        joints=tuple(
            replace(
                each,
                id=names[each.id],
                iri=Iri(prefix + names[each.id]),
                parent=names[each.parent],
                child=names[each.child],
                mimic=None,
            )
            for each in group.joints
        ),
        attachments=tuple(Attachment(parent=names[each.parent], child=names[each.child]) for each in group.attachments),
    )


def _free_offset(simulation: EngineSession, world: World) -> Vector:
    """The nearest horizontal offset at which no body of a group penetrates anything."""
    places = FreePlaces(simulation)
    bodies = [(body, simulation.fit_geometry(body)) for body in world.bodies if body.size is not None]
    bounds = world_bounds(world)
    assert bounds is not None  # a group has a body
    step = np.subtract(bounds.high, bounds.low)[:2] + _SPACING_M
    steps = [np.array([x, y]) for x in range(-_RINGS, _RINGS + 1) for y in range(-_RINGS, _RINGS + 1)]
    offsets = sorted((each * step for each in steps), key=lambda offset: float(np.linalg.norm(offset)))
    for offset in offsets:
        moved = (float(offset[0]), float(offset[1]), _LIFT_M)
        if all(places.sampler.is_free(replace(body, pose=_shifted(body.pose, moved)), fit) for body, fit in bodies):
            return moved[0], moved[1], 0.0
    return float(step[0]), 0.0, 0.0


def _moved(world: World, offset: Vector) -> World:
    if not any(offset):
        return world
    return replace(
        world,
        bodies=tuple(replace(each, pose=_shifted(each.pose, offset)) for each in world.bodies),
        joints=tuple(replace(each, pose=_shifted(each.pose, offset)) for each in world.joints),
    )


def _shifted(pose: Pose, offset: Vector) -> Pose:
    x, y, z = (float(at + by) for at, by in zip(pose.position, offset, strict=True))
    return replace(pose, position=(x, y, z))
