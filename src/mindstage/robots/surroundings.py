"""What a map and its ontologies state about the things that a skill handles.

Which handle belongs to which door, which doors and drawers a container has and how far they are open, what a thing is
in, where its kind is stored: these are answers to declared questions about the running world.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.errors import (
    AmbiguousNameError,
    BodyNotFoundError,
    InvalidArgumentError,
    KnowledgeError,
    NameNotFoundError,
    closest_names,
)
from mindstage.knowledge.names import EntityType
from mindstage.rdf.graphs import local_name
from mindstage.scene import Body, BodyId, Iri, Mobility, Pose, World
from mindstage.scene.geometry import BodyGeometry
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_inverse,
    pose_multiply,
    quat_conjugate,
    quat_rotate,
)
from mindstage.simulation.joint_motion import SimulationJoint, find_joint
from mindstage.simulation.simulation import Simulation

__all__ = ["ArticulatedPart", "Surroundings", "Thing"]

_RELATIONS = {True: "into", False: "onto"}
_CLOSED_SHARE = 0.05
"""A door or drawer that is open by less counts as closed."""
_TOP_WIDTH_M, _TOP_HEIGHTS_M = 0.25, (0.4, 1.2)
"""Least width, and least and largest height, of a top on which things are set aside."""


class ArticulatedPart(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """A door, drawer or lid."""

    id: BodyId
    container: BodyId
    joint: SimulationJoint
    handle: BodyId | None
    """None if no handle belongs to it, and nothing else that can be held."""

    @property
    def openness(self) -> float:
        """The fraction by which it is open now, from 0 to 1."""
        return self.joint.openness

    @property
    def is_closed(self) -> bool:
        """Whether it is closed, or open by less than 5 %."""
        return self.openness < _CLOSED_SHARE


class Thing(NamedTuple):
    """A thing that a robot handles, as it is at one time."""

    id: BodyId
    body: Body
    geometry: BodyGeometry | None
    """None if it is its primitive shape."""
    pose: Array
    """Position [m] and unit quaternion (w, x, y, z) in the world frame."""
    low: Array
    """The lowest corner of its box along the axes of the world [m]."""
    high: Array
    """The highest one [m]."""
    container: tuple[Array, Array] | None
    """The lowest and the highest corner of what it is in [m]."""


class Surroundings:
    """Answers about the things of a running world; a new one is made after bodies were added or removed."""

    def __init__(self, session: Simulation, *, ignored: Collection[BodyId] = ()) -> None:
        """Takes a snapshot of the world.

        Args:
            ignored: bodies that are not things of the world, such as the links of robots.
        """
        self._session = session
        self._ignored = frozenset(ignored)
        self.world: World = session.snapshot()
        self._bodies = {body.id: body for body in self.world.bodies if body.id not in self._ignored}
        self._by_iri = {body.iri: body.id for body in self._bodies.values()}
        self._articulated_parts: tuple[ArticulatedPart, ...] | None = None
        self._odd_parts: dict[BodyId, tuple[BodyId, KnowledgeError]] = {}
        """Doors and drawers of which no single joint can be moved, with their containers, and why."""

    # -- bodies ------------------------------------------------------------------------------------------------------

    def body(self, id: BodyId) -> Body:
        """The body, with the pose that it had when this object was made.

        Raises:
            BodyNotFoundError: it does not exist.
        """
        if id not in self._bodies:
            raise BodyNotFoundError(id, known=self._bodies, world=self.world.name)
        return self._bodies[id]

    def exists(self, id: BodyId) -> bool:
        """Whether there is a body of that id."""
        return id in self._bodies

    def bodies(self) -> tuple[BodyId, ...]:
        """The ids of all things."""
        return tuple(self._bodies)

    def geometry(self, id: BodyId) -> BodyGeometry | None:
        """The geometry of a body; None if it is its primitive shape."""
        return self._session.geometry.get(id)

    def pose(self, id: BodyId) -> Array:
        """The present pose of a body: position [m] and unit quaternion (w, x, y, z) in the world frame.

        Raises:
            BodyNotFoundError: it does not exist.
        """
        state = self._session.state
        try:
            row = state.ids.index(id)
        except ValueError:
            raise BodyNotFoundError(id, known=state.ids) from None
        pose: Array = state.poses[row].copy()
        pose[3:] = normalize(pose[3:])
        return pose

    def box(self, id: BodyId) -> tuple[Array, Array]:
        """The lowest and the highest corner of the box of a body along the axes of the world, each 3 numbers [m]."""
        pose, size = self.pose(id), np.asarray(self.body(id).size or (0.0, 0.0, 0.0))
        corners = np.array(np.meshgrid(*[(-each / 2, each / 2) for each in size])).reshape(3, -1).T
        placed = pose[:3] + quat_rotate(pose[3:], corners)
        return placed.min(axis=0), placed.max(axis=0)

    def thing(self, id: BodyId) -> Thing:
        """What is to be known of a thing to handle it.

        Raises:
            BodyNotFoundError: it does not exist.
        """
        inside = self.containers_of(id)
        container = self.box(inside[0]) if inside else None
        return Thing(id, self.body(id), self.geometry(id), self.pose(id), *self.box(id), container)

    def find(self, name: str) -> BodyId:
        """The body of that id or IRI, the individual named by these words, or the only body of that class.

        Raises:
            NameNotFoundError: there is none.
            AmbiguousNameError: there are several.
        """
        if name in self._bodies:
            return BodyId(name)
        if name in self._by_iri:
            return self._by_iri[Iri(name)]
        names = self._session.knowledge.names
        try:
            individual = names.find(name, EntityType.INDIVIDUAL)
        except NameNotFoundError:
            individual = None
        if individual in self._by_iri:
            return self._by_iri[Iri(str(individual))]
        found = self.instances(name)
        if len(found) > 1:
            raise AmbiguousNameError(name, entity_type="thing", candidates=found)
        return found[0]

    def instances(self, kind: str) -> list[BodyId]:
        """The bodies of a class, by its name.

        Raises:
            NameNotFoundError: there is no such class, or no body of it.
        """
        knowledge = self._session.knowledge
        try:
            cls = knowledge.names.find(kind, EntityType.CLASS)
        except NameNotFoundError as error:
            known = [*self._bodies, *closest_names(kind, self._bodies)]
            raise NameNotFoundError(kind, entity_type="thing or class", known=known) from error
        found = [body.id for body in self._bodies.values() if body.cls == cls or knowledge.is_a(body.cls, cls)]
        if not found:
            kinds = {local_name(body.cls) for body in self._bodies.values()}
            raise NameNotFoundError(kind, entity_type="thing", known=sorted(kinds))
        return found

    # -- doors and drawers -------------------------------------------------------------------------------------------

    def articulated_parts(self) -> tuple[ArticulatedPart, ...]:
        """All doors, drawers and lids with a joint that has a range."""
        if self._articulated_parts is None:
            self._articulated_parts = tuple(self._find_articulated_parts())
        return self._articulated_parts

    def articulated_parts_of(self, thing: BodyId) -> list[ArticulatedPart]:
        """The doors and drawers that a name stands for: itself, that of a handle, or all of a container."""
        own = [each for each in self.articulated_parts() if thing in {each.id, each.handle}]
        return own or [each for each in self.articulated_parts() if each.container == thing]

    def articulated_part(self, thing: BodyId) -> ArticulatedPart:
        """The only door or drawer that a name stands for.

        Raises:
            NameNotFoundError: it has none.
            AmbiguousNameError: it has several, or several joints with a range move it.
            InvalidArgumentError: its joint has no range.
        """
        found = self.articulated_parts_of(thing)
        if not found:
            for id, (container, error) in self._odd_parts.items():
                if thing in {id, container, self._handle_of(id)}:
                    raise error
            known = [each.id for each in self.articulated_parts()]
            raise NameNotFoundError(thing, entity_type="door or drawer", known=known)
        if len(found) > 1:
            raise AmbiguousNameError(thing, entity_type="door or drawer", candidates=[each.id for each in found])
        return found[0]

    def _find_articulated_parts(self) -> Iterator[ArticulatedPart]:
        containers: dict[BodyId, BodyId] = {}
        for row in self._session.ask("articulated_parts"):  # one for each joint
            id, container = self._by_iri.get(row.part), self._by_iri.get(row.thing)
            if id is not None and container is not None:
                containers.setdefault(id, container)
        for id, container in containers.items():
            try:
                joint = self._joint_of(id)
            except KnowledgeError as error:
                self._odd_parts[id] = container, error
                continue
            handle = self._handle_of(id) or self._knob_of(id, container)
            yield ArticulatedPart(id=id, container=container, joint=joint, handle=handle)

    def _joint_of(self, part: BodyId) -> SimulationJoint:
        """The only joint of a part that has a range.

        Raises:
            AmbiguousNameError: there are several.
            InvalidArgumentError: there is none.
        """
        ambiguous: AmbiguousNameError | None = None
        try:
            joints = [find_joint(self._session, part)]
        except AmbiguousNameError as error:
            joints = [find_joint(self._session, each) for each in error.candidates]
            ambiguous = error
        ranged = [each for each in joints if np.isfinite(each.range).all() and np.ptp(each.range) > 0.0]
        if len(ranged) > 1 and ambiguous is not None:
            raise ambiguous
        if not ranged:
            raise InvalidArgumentError(part, cause="no joint of it has a range", remedy="give its joint limits")
        return ranged[0]

    def _handle_of(self, part: BodyId) -> BodyId | None:
        """The handle of a part; of several, the one that is largest."""
        rows = self._session.ask("handle_of", individual=self._bodies[part].iri)
        handles = [self._by_iri[row.handle] for row in rows if row.handle in self._by_iri]
        return max(handles, key=lambda each: float(np.prod(self._bodies[each].size or (0.0,))), default=None)

    def _knob_of(self, part: BodyId, container: BodyId) -> BodyId | None:
        """What is attached to a part and farther out than it, of whatever class, such as a knob; the farthest one."""
        found: dict[BodyId, float] = {}
        pose, size = self.pose(part), np.asarray(self.body(part).size or (np.inf,) * 3)
        outward = pose[:3] - self.pose(container)[:3]
        for each in self.world.attachments:
            if each.parent != part or each.child not in self._bodies:
                continue
            offset = self.pose(each.child)[:3] - pose[:3]
            beyond = np.abs(quat_rotate(quat_conjugate(pose[3:]), offset)) - size / 2
            if beyond.max() > 0.0 and offset @ outward > 0.0:
                found[each.child] = float(beyond.max())
        return max(found, key=found.__getitem__, default=None)

    # -- places ------------------------------------------------------------------------------------------------------

    def containers_of(self, thing: BodyId) -> list[BodyId]:
        """The bodies that a thing is in, the innermost first."""
        rows = self._session.ask("where_is", thing=self.body(thing).iri, relation="inside")
        found = [self._by_iri[row.other] for row in rows if row.other in self._by_iri]
        return sorted(dict.fromkeys(found), key=lambda each: float(np.prod(self._bodies[each].size or (np.inf,))))

    def contents_of(self, part: ArticulatedPart) -> list[BodyId]:
        """The loose things that are in a drawer, or in the container of a door."""
        holder = part.id if part.joint.is_prismatic else part.container
        rows = self._session.ask("where_is", relation="inside", other=self.body(holder).iri)
        found = dict.fromkeys(self._by_iri[row.thing] for row in rows if row.thing in self._by_iri)
        held = {end for joint in self.world.joints for end in (joint.parent, joint.child)}
        held.update(end for each in self.world.attachments for end in (each.parent, each.child))
        return [each for each in found if self.body(each).physics.is_dynamic and each not in held]

    def in_front_of(self, thing: BodyId) -> list[ArticulatedPart]:
        """The doors or drawers that have to be open to get to a thing, open or not."""
        return self._parts_before(self.containers_of(thing), self.pose(thing)[:3])

    def closed_in_front_of(self, thing: BodyId) -> list[ArticulatedPart]:
        """The closed doors or drawers that have to be opened to get to a thing."""
        return [each for each in self.in_front_of(thing) if each.is_closed]

    def closed_on(self, holder: BodyId, point: Array | None = None) -> list[ArticulatedPart]:
        """The closed doors or drawers that have to be opened to put something into a container.

        Args:
            holder: the container, or a drawer.
            point: where in it, in the world frame [m]; None for anywhere.
        """
        own = [each for each in self.articulated_parts() if each.id == holder]
        if own:
            return [each for each in own if each.is_closed]
        parts = self._parts_before([holder], self.pose(holder)[:3] if point is None else point)
        return [each for each in parts if each.is_closed]

    def _parts_before(self, containers: Sequence[BodyId], point: Array) -> list[ArticulatedPart]:
        """The articulated parts of containers; of several doors of one, that which is in front of the point."""
        found: dict[BodyId, ArticulatedPart] = {}
        for container in containers:
            drawers = [each for each in self.articulated_parts() if each.id == container]
            if drawers:  # the other doors of its furniture do not close a drawer
                return drawers
            doors = [
                each for each in self.articulated_parts() if each.container == container and not each.joint.is_prismatic
            ]
            if doors:
                nearest = min(doors, key=lambda each: self._offset(each, point))
                found[nearest.id] = nearest
        return list(found.values())

    def _offset(self, part: ArticulatedPart, point: Array) -> float:
        """The distance of a point from the middle of a closed part, in its plane [m]."""
        closed = normalized_pose_array(part.joint.pose_at(part.joint.closed_position))
        local = pose_multiply(pose_inverse(closed), np.array([*point, 1.0, 0.0, 0.0, 0.0]))[:3]
        size = np.asarray(self.body(part.id).size or (0.0, 0.0, 0.0))
        across = [axis for axis in range(3) if axis != int(np.argmin(size))]
        return float(np.linalg.norm(local[across]))

    def storage_places(self, thing: BodyId) -> list[BodyId]:
        """The bodies in which the kind of a thing is stored, the most specific first."""
        rows = self._session.ask("storage_place_in_environment", item=self.body(thing).cls)
        return list(dict.fromkeys(self._by_iri[row.individual] for row in rows if row.individual in self._by_iri))

    def supports_of(self, thing: BodyId) -> list[BodyId]:
        """The bodies that a thing is on."""
        rows = self._session.ask("where_is", thing=self.body(thing).iri, relation="on")
        return [self._by_iri[row.other] for row in rows if row.other in self._by_iri]

    def support_of(self, thing: BodyId) -> str:
        """Where a thing is, in words, such as "in fridge" or "on table"."""
        inside = self.containers_of(thing)
        if inside:
            return f"in {inside[0]}"
        supports = self.supports_of(thing)
        return f"on {supports[0]}" if supports else "on nothing that is known"

    def free_places(self, thing: BodyId, support: BodyId, *, inside: bool, count: int) -> list[Pose]:
        """Free poses of a thing in or on a body, the one with the largest margin first."""
        rows = self._session.ask(
            "free_place",
            thing=self.body(thing).iri,
            relation=_RELATIONS[inside],
            support=self.body(support).iri,
            count=count,
        )
        return [row.pose for row in rows]

    def tops_near(self, point: Array) -> list[BodyId]:
        """Bodies that do not move, with a wide top at the height of a hand; the one nearest to a point [m] first."""
        found: list[tuple[float, BodyId]] = []
        for id, body in self._bodies.items():
            if body.physics.mobility is not Mobility.STATIC or body.size is None:
                continue
            low, high = self.box(id)
            lowest, highest = _TOP_HEIGHTS_M
            if min((high - low)[:2]) >= _TOP_WIDTH_M and lowest <= high[2] <= highest:
                nearest = np.clip(point, low, high)
                found.append((float(np.linalg.norm(nearest - point)), id))
        return [id for _, id in sorted(found)]

    def why_no_place(self, thing: BodyId, support: BodyId, *, inside: bool) -> str:
        """Why there is no free place."""
        answers = self._session.ask(
            "free_place", thing=self.body(thing).iri, relation=_RELATIONS[inside], support=self.body(support).iri
        )
        missing = getattr(answers, "missing", ())
        return missing[0].reason if missing else "no place is free"
