"""Inventory: what stands in an engine, as it was described.

Every engine keeps one: it refuses what contradicts itself (an id used twice, a constraint to nowhere, a circle of
attachments) in the same words everywhere, and it is what the log starts from.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import isfinite

import msgspec

from mindstage.engines.contract import Failure, Note, SpawnReport
from mindstage.errors import AttachmentRefused, BodyExists, BodyUnknown, PoseUnreachable
from mindstage.world import (
    Attachment,
    Body,
    BodyId,
    Colour,
    Constraint,
    Iri,
    Light,
    Material,
    Physics,
    Pose,
    World,
)

__all__ = ["Added", "Inventory", "placeable"]


@dataclass(slots=True)
class Added:
    """What of a world went in, and what did not."""

    bodies: list[BodyId] = field(default_factory=list)
    constraints: list[BodyId] = field(default_factory=list)
    attachments: list[BodyId] = field(default_factory=list)
    """The children."""
    failed_bodies: list[Failure] = field(default_factory=list)
    failed_constraints: list[Failure] = field(default_factory=list)
    failed_attachments: list[Failure] = field(default_factory=list)

    def report(self, notes: Iterable[Note] = ()) -> SpawnReport:
        """The same as the contract reports it."""
        return SpawnReport(
            bodies=len(self.bodies),
            constraints=len(self.constraints),
            attachments=len(self.attachments),
            failed_bodies=tuple(self.failed_bodies),
            failed_constraints=tuple(self.failed_constraints),
            failed_attachments=tuple(self.failed_attachments),
            notes=tuple(notes),
        )


class Inventory:
    """Bodies, constraints, lights and attachments by id."""

    def __init__(self) -> None:
        self.bodies: dict[BodyId, Body] = {}
        self.constraints: dict[BodyId, Constraint] = {}
        self.lights: dict[BodyId, Light] = {}
        self.parents: dict[BodyId, BodyId] = {}
        """Whom each attached child hangs on."""
        self.lit: dict[BodyId, Colour] = {}
        self._children: dict[BodyId, dict[BodyId, None]] = {}  # a set that keeps its order
        self._worlds: list[World] = []
        self._ids: tuple[BodyId, ...] | None = None

    def copy(self) -> Inventory:
        """An inventory of its own with the same content; the values are frozen and are shared."""
        twin = Inventory()
        twin.bodies, twin.constraints, twin.lights = dict(self.bodies), dict(self.constraints), dict(self.lights)
        twin.parents, twin.lit = dict(self.parents), dict(self.lit)
        twin._children = {parent: dict(children) for parent, children in self._children.items()}
        twin._worlds, twin._ids = list(self._worlds), self._ids
        return twin

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """All bodies; the same object until one comes or goes."""
        if self._ids is None:
            self._ids = tuple(self.bodies)
        return self._ids

    def body(self, id: BodyId) -> Body:
        """Looks a body up.

        Raises:
            BodyUnknown: there is none of that id.
        """
        try:
            return self.bodies[id]
        except KeyError:
            raise BodyUnknown(id, known=self.bodies, world=self._worlds[0].name if self._worlds else "") from None

    def children(self, id: BodyId) -> tuple[BodyId, ...]:
        """What is attached to a body directly."""
        return tuple(self._children.get(id, ()))

    def hanging_on(self, id: BodyId) -> Iterator[BodyId]:
        """What is attached to a body, to any depth, parents before children."""
        waiting = list(self.children(id))
        while waiting:
            child = waiting.pop()
            yield child
            waiting.extend(self.children(child))

    # -- coming ----------------------------------------------------------------------------------------------

    def add(self, world: World) -> Added:
        """Takes in what can be taken in: bodies and lights, then constraints, then attachments."""
        added = Added()
        for body in world.bodies:
            reason = self._why_not(body.id) or placeable(body.pose) or _why_not_size(body)
            if reason:
                added.failed_bodies.append(Failure(body.id, reason))
            else:
                self.bodies[body.id] = body
                added.bodies.append(body.id)
        for light in world.lights:
            if reason := self._why_not(light.id):
                added.failed_bodies.append(Failure(light.id, reason))
            else:
                self.lights[light.id] = light
        for constraint in world.constraints:
            if reason := self._why_not_constraint(constraint):
                added.failed_constraints.append(Failure(constraint.id, reason))
            else:
                self.constraints[constraint.id] = constraint
                added.constraints.append(constraint.id)
        for attachment in world.attachments:
            if reason := self._why_not_attachment(attachment):
                added.failed_attachments.append(Failure(attachment.child, reason))
            else:
                self._hang(attachment.parent, attachment.child)
                added.attachments.append(attachment.child)
        self._worlds.append(msgspec.structs.replace(world, bodies=(), constraints=(), attachments=(), lights=()))
        self._ids = None
        return added

    def _why_not(self, id: BodyId) -> str:
        if id in self.bodies or id in self.constraints or id in self.lights:
            return str(BodyExists(id))
        return ""

    def _why_not_constraint(self, constraint: Constraint) -> str:
        ends = (constraint.parent, constraint.child)
        unknown = [end for end in ends if end not in self.bodies]
        if unknown:
            return f"it joins {' and '.join(map(repr, unknown))}, which is not there"
        if ends[0] == ends[1]:
            return f"it joins {ends[0]!r} to itself"
        return self._why_not(constraint.id) or placeable(constraint.pose) or _why_not_limits(constraint)

    def _why_not_attachment(self, attachment: Attachment) -> str:
        for end in (attachment.parent, attachment.child):
            if end not in self.bodies:
                return f"there is no body {end!r}"
        holder = self.parents.get(attachment.child)
        if holder is not None:
            return f"it already hangs on {holder!r}, so it cannot hang on {attachment.parent!r} too"
        return self._why_not_hang(attachment.parent, attachment.child)

    def _why_not_hang(self, parent: BodyId, child: BodyId) -> str:
        above: BodyId | None = parent
        while above is not None:
            if above == child:
                return "it is itself" if parent == child else f"a circle: {parent!r} already hangs on it"
            above = self.parents.get(above)
        return ""

    # -- changing --------------------------------------------------------------------------------------------

    def replace(
        self,
        id: BodyId,
        *,
        pose: Pose | None = None,
        physics: Physics | None = None,
        materials: tuple[Material, ...] | None = None,
    ) -> None:
        """Changes how a body is described.

        Raises:
            BodyUnknown: there is none of that id.
            PoseUnreachable: the pose is not finite, or no rotation.
        """
        body = self.body(id)
        if pose is not None and (reason := placeable(pose)):
            raise PoseUnreachable(id, reason=reason)
        self.bodies[id] = msgspec.structs.replace(
            body,
            pose=body.pose if pose is None else pose,
            physics=body.physics if physics is None else physics,
            materials=body.materials if materials is None else materials,
        )

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """See `Engine.attach`."""
        self.body(parent), self.body(child)
        if reason := self._why_not_hang(parent, child):
            raise AttachmentRefused(parent, child, reason=reason)
        self.detach(child)
        self._hang(parent, child)

    def detach(self, child: BodyId) -> None:
        """See `Engine.detach`."""
        self.body(child)
        parent = self.parents.pop(child, None)
        if parent is not None:
            del self._children[parent][child]

    def _hang(self, parent: BodyId, child: BodyId) -> None:
        self.parents[child] = parent
        self._children.setdefault(parent, {})[child] = None

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        """See `Engine.highlight`."""
        lit = [self.body(id).id for id in ids]
        changed = dict(self.lit)  # a new one each time, so that a watcher may keep the old
        for id in lit:
            if colour is None:
                changed.pop(id, None)
            else:
                changed[id] = colour
        self.lit = changed

    def remove(self, ids: Iterable[BodyId]) -> None:
        """See `Engine.delete`."""
        gone = {self.body(id).id for id in ids}
        for id in gone:
            for child in self.children(id):
                self.detach(child)
            self.detach(id)
            del self.bodies[id]
            self._children.pop(id, None)
        self.lit = {id: colour for id, colour in self.lit.items() if id not in gone}
        self.constraints = {
            id: constraint
            for id, constraint in self.constraints.items()
            if constraint.parent not in gone and constraint.child not in gone
        }
        self._ids = None

    # -- going -----------------------------------------------------------------------------------------------

    def world(self, moved: Mapping[BodyId, Pose] | None = None) -> World:
        """Everything as one world; several that were spawned come back as one, under the first one's name.

        Args:
            moved: poses that are no longer the described ones.
        """
        moved = moved or {}
        bodies = (
            msgspec.structs.replace(body, pose=moved[id]) if id in moved else body for id, body in self.bodies.items()
        )
        return World(
            iri=self._worlds[0].iri if self._worlds else Iri("http://mindstage.org/maps/empty.owl#map"),
            name=self._worlds[0].name if self._worlds else "",
            bodies=tuple(bodies),
            constraints=tuple(self.constraints.values()),
            attachments=tuple(Attachment(parent=parent, child=child) for child, parent in self.parents.items()),
            lights=tuple(self.lights.values()),
            facts=tuple(fact for world in self._worlds for fact in world.facts),
            resources=tuple(dict.fromkeys(resource for world in self._worlds for resource in world.resources)),
        )


def placeable(pose: Pose) -> str:
    """Why nothing can be put at that pose, or an empty string."""
    if not all(map(isfinite, (*pose.position, *pose.quaternion))):
        return "its pose has numbers that are not finite"
    if not any(pose.quaternion):
        return "its quaternion is all zeros, which is no rotation"
    return ""


def _why_not_size(body: Body) -> str:
    size = body.size
    if size is not None and not (all(map(isfinite, size)) and min(size) >= 0.0):
        return f"its size {size} is not three finite lengths"
    mass = body.physics.mass_kg
    if mass is not None and not (isfinite(mass) and mass >= 0.0):
        return f"its mass {mass} is not a finite mass"
    return ""


def _why_not_limits(constraint: Constraint) -> str:
    angular = constraint.angular
    limits = (constraint.linear.limit, angular.swing1_limit, angular.swing2_limit, angular.twist_limit)
    if not (all(map(isfinite, limits)) and min(limits) >= 0.0):
        return f"its limits {limits} are not all finite and positive"
    linear = constraint.linear
    slides = (linear.x_middle, linear.y_middle, linear.z_middle)
    middles = (*slides, angular.swing1_middle, angular.swing2_middle, angular.twist_middle)
    if not all(map(isfinite, middles)):
        return f"the middles {middles} of its ranges are not all finite"
    return ""
