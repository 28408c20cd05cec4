"""Dialect 1, SemLog's maps with physics: from a graph to a world (`mapwriter` is the way back).

Every individual that says `describedInMap` becomes a body, a constraint or a light, if it has a pose. Every statement
about it that has no field stays a fact of it, and all else that the source says stays a resource: each statement of
the source is in the world, once. What cannot be taken as it is told is reported, and written again as it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

from mindstage.knowledge.analysis import is_constraint
from mindstage.knowledge.findings import Severity
from mindstage.knowledge.names import ids_for, local_name
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.conventions import SI
from mindstage.knowledge.reading.conversion import convert
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.settling import usual_conventions
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    HAS_POSE,
    LIGHT_CLASSES,
    NAMED_INDIVIDUAL,
    OWL,
    PARENT,
    RDFS,
    SEMANTIC_MAP,
    THING,
    TYPE,
)
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.body_sizes import hear_size
from mindstage.knowledge.wording.materials import materials_of
from mindstage.knowledge.wording.part_reading import PartReader
from mindstage.knowledge.wording.parts import ANGULAR_PART, LINEAR_PART, POSE_PART, Part
from mindstage.knowledge.wording.relations import Relations
from mindstage.knowledge.wording.sizes import ClassSizes, class_sizes_of
from mindstage.knowledge.wording.statements import Heard
from mindstage.knowledge.wording.tags import tags_of
from mindstage.world import (
    AngularMotion,
    Attachment,
    Body,
    BodyId,
    Constraint,
    Iri,
    Light,
    LightKind,
    LinearMotion,
    Physics,
    Pose,
    Resource,
    Shape,
    World,
)

__all__ = ["read_semlog", "read_semlog_map"]

T = TypeVar("T")


class _Sizes(NamedTuple):
    known: ClassSizes
    resources: ClassSizes


def read_semlog(excerpt: Excerpt) -> World:
    """Reads what is said in the words of dialect 1, in metres, ROS's frame and with w x y z."""
    return _Reading(excerpt).world()


def read_semlog_map(excerpt: Excerpt) -> World:
    """Reads a map of dialect 1, whose numbers are as they are in a world unless somebody says otherwise."""
    return read_semlog(convert(excerpt, usual_conventions(excerpt, SI, dialect="SemLog"), dialect="SemLog"))


class _Reading:
    """One map on its way to a world. The order matters: places, relations, joints, ids, resources, sizes."""

    def __init__(self, excerpt: Excerpt) -> None:
        self.excerpt = excerpt
        self.map, self.graph, self.report = excerpt.map, excerpt.graph, excerpt.report
        self.members = excerpt.members
        self.parts = PartReader(self.graph, {self.map, *self.members}, self.report)
        self.heard: dict[Iri, Heard] = {}
        """All individuals that are there in the end."""
        self.poses: dict[Iri, Pose] = {}
        self.motions: dict[Iri, tuple[LinearMotion, AngularMotion]] = {}
        self.types: dict[Iri, tuple[Iri, ...]] = {}

    def world(self) -> World:
        bodies, constraints, lights = self._sort()
        relations = Relations(bodies, constraints)
        ends = {iri: joined for iri, heard in constraints.items() if (joined := self._join(heard, bodies, relations))}
        self.heard = {iri: self.heard[iri] for iri in self.members if iri in self.heard}
        ids = self._ids()
        resources = self._resources()
        sizes = self._sizes(resources)
        heard = Heard(self.map, self.graph.get(self.map, ()), self.report)
        heard.drop(TYPE, NAMED_INDIVIDUAL, SEMANTIC_MAP)
        if SEMANTIC_MAP not in types_of(heard.facts):
            heard.warn(TYPE, "individuals are described in it, but nothing calls it a map", "it is taken as one")
        name = heard.value(words.LABEL_WORD)
        return World(
            iri=self.map,
            name=local_name(self.map) if name is None else name,
            bodies=tuple(self._body(iri, ids[iri], sizes) for iri in bodies),
            constraints=tuple(
                self._constraint(iri, ids[iri], ids[parent], ids[child]) for iri, (parent, child) in ends.items()
            ),
            attachments=tuple(
                Attachment(parent=ids[relations.parents[child]], child=ids[child])
                for child in bodies
                if child in relations.parents
            ),
            lights=tuple(self._light(iri, ids[iri], kind) for iri, kind in lights.items()),
            facts=heard.left(),
            resources=resources,
        )

    # -- who is what ---------------------------------------------------------------------------------------------------

    def _sort(self) -> tuple[dict[Iri, Heard], dict[Iri, Heard], dict[Iri, LightKind]]:
        kinds = {cls: kind for kind, cls in LIGHT_CLASSES.items()}
        bodies: dict[Iri, Heard] = {}
        constraints: dict[Iri, Heard] = {}
        lights: dict[Iri, LightKind] = {}
        for iri in self.members:
            heard = Heard(iri, self.graph[iri], self.report)
            heard.drop(TYPE, NAMED_INDIVIDUAL)
            heard.drop(DESCRIBED_IN_MAP, self.map)
            types = self.types[iri] = types_of(heard.facts)
            if is_constraint(types, self.excerpt.hierarchy):
                constraints[iri] = heard
            elif self._place(heard):
                if kind := next((kinds[cls] for cls in types if cls in kinds), None):
                    lights[iri] = kind
                else:
                    bodies[iri] = heard
        return bodies, constraints, lights

    def _place(self, heard: Heard) -> bool:
        """Whether the individual has a pose; only those that have one are in the world."""
        pose = self.parts.take(heard, POSE_PART)
        if pose is None:
            self._leave_out(heard.subject, HAS_POSE, "it has no pose that can be understood")
            return False
        self.heard[heard.subject] = heard
        self.poses[heard.subject] = pose
        return True

    def _join(self, heard: Heard, bodies: Mapping[Iri, Heard], relations: Relations) -> tuple[Iri, Iri] | None:
        """The two bodies that a constraint joins, if they are there and it has a pose."""
        ends = []
        for role in (PARENT, CHILD):
            end = self._end(heard, role, bodies) or relations.ends.get((heard.subject, role))
            if end is None:
                name = local_name(role)
                self._leave_out(heard.subject, role, f"its {name} is missing, or is no body of this map")
                return None
            ends.append(end)
        if not self._place(heard):
            return None
        linear, angular = self._motion(heard, LINEAR_PART), self._motion(heard, ANGULAR_PART)
        self.motions[heard.subject] = (linear or LinearMotion(), angular or AngularMotion())
        return ends[0], ends[1]

    def _motion(self, heard: Heard, part: Part[T]) -> T | None:
        motion = self.parts.take(heard, part)
        if motion is None:
            heard.warn(part.property, "nothing understandable is told", "all of it is taken as locked")
        return motion

    def _end(self, heard: Heard, role: Iri, bodies: Mapping[Iri, Heard]) -> Iri | None:
        found: Iri | None = None
        for index, other in heard.references(role):
            if other not in bodies:
                heard.warn(role, f"{other} is no body of this map", "it stays a fact")
            elif found is None:
                found = other
                heard.take(index)
            elif other != found:
                heard.warn(role, "it is told twice, differently", "the first counts, the other stays a fact")
        return found

    def _leave_out(self, individual: Iri, property: Iri, why: str) -> None:
        self.report(Severity.ERROR, individual, property, why, "it is left out; what is said about it is kept")

    # -- what they are called ------------------------------------------------------------------------------------------

    def _ids(self) -> dict[Iri, BodyId]:
        explicit: dict[Iri, str] = {}
        taken: set[str] = set()
        for iri, heard in self.heard.items():
            id = heard.value(words.ID, keep=taken.__contains__)
            if id in taken:
                heard.warn(words.ID.property, f"the id {id!r} is taken", "it gets another one")
            elif id is not None:
                explicit[iri] = id
                taken.add(id)
        ids = ids_for(explicit, (iri for iri in self.heard if iri not in explicit))
        for iri in ids.keys() - explicit.keys():
            if ids[iri] != local_name(iri):
                self.heard[iri].warn("", f"the id {local_name(iri)!r} is taken", f"it is called {ids[iri]!r}")
        return ids

    # -- what they are -------------------------------------------------------------------------------------------------

    def _body(self, iri: Iri, id: BodyId, sizes: _Sizes) -> Body:
        heard = self.heard[iri]
        cls = self._class(heard)
        classes = (cls, *(other for other in self.types[iri] if other != cls))
        shape = heard.value(words.SHAPE)
        return Body(
            id=id,
            iri=iri,
            cls=cls,
            pose=self.poses[iri],
            label=heard.value(words.LABEL_WORD),
            size=hear_size(heard, classes, known=sizes.known, resources=sizes.resources),
            mesh=heard.value(words.MESH),
            shape=None if shape is None else Shape(kind=shape),
            physics=Physics(
                mobility=heard.value(words.MOBILITY),
                gravity=heard.value(words.GRAVITY),
                overlap_events=heard.value(words.OVERLAP_EVENTS),
                mass_kg=heard.value(words.MASS),
            ),
            materials=materials_of(heard),
            tags=tags_of(heard),
            facts=heard.left(),
        )

    def _class(self, heard: Heard) -> Iri:
        types = self.types[heard.subject]
        telling = [cls for cls in types if not cls.startswith((OWL, RDFS))]
        if telling:
            cls = self.excerpt.hierarchy.most_specific(telling)
            heard.drop(TYPE, cls)
            return cls
        if not types:
            heard.warn(TYPE, "it has no class", "it is taken as an owl:Thing, which everything is")
        return THING

    def _constraint(self, iri: Iri, id: BodyId, parent: BodyId, child: BodyId) -> Constraint:
        heard = self.heard[iri]
        heard.drop(TYPE, CONSTRAINT)
        linear, angular = self.motions[iri]
        return Constraint(
            id=id,
            iri=iri,
            parent=parent,
            child=child,
            pose=self.poses[iri],
            linear=linear,
            angular=angular,
            disable_collision=heard.value(words.DISABLE_COLLISION),
            tags=tags_of(heard),
            facts=heard.left(),
        )

    def _light(self, iri: Iri, id: BodyId, kind: LightKind) -> Light:
        heard = self.heard[iri]
        heard.drop(TYPE, LIGHT_CLASSES[kind])
        red, green, blue = heard.value(words.COLOUR) or (1.0, 1.0, 1.0)
        intensity = heard.value(words.INTENSITY)
        return Light(
            id=id,
            iri=iri,
            kind=kind,
            pose=self.poses[iri],
            colour=(red, green, blue),
            intensity=1.0 if intensity is None else intensity,
            tags=tags_of(heard),
            facts=heard.left(),
        )

    # -- what else there is --------------------------------------------------------------------------------------------

    def _resources(self) -> tuple[Resource, ...]:
        elsewhere = {self.map, *self.heard}
        left = {iri: self.parts.left.get(iri, facts) for iri, facts in self.graph.items() if iri not in elsewhere}
        return tuple(Resource(iri, tuple(facts)) for iri, facts in left.items() if facts)

    def _sizes(self, resources: Sequence[Resource]) -> _Sizes:
        own = {resource.iri: resource.facts for resource in resources}
        return _Sizes(
            known=ClassSizes([own, *self.excerpt.background], self.excerpt.hierarchy, self.report),
            resources=class_sizes_of(resources),
        )
