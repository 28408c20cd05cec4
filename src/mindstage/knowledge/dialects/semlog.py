"""Dialect 1, SemLog's maps with physics: from a graph to a world (`mapwriter` is the way back).

Every individual that says `describedInMap` becomes a body, a constraint or a light, if it has a pose. Every statement
about it that has no field stays a fact of it, and all else that the source says stays a resource: each statement of
the source is in the world, once. What cannot be taken as it is told is reported, and written again as it was.

Crowds: many bodies in one and the same place, which is what a map looks like whose poses were never written.

Dialect 2, SemLog's early maps: dialect 1 without properties for the physics, of which the tags tell.

Their constraints do not say what map they are described in; the census finds that out, since it is true of any map.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

from mindstage.knowledge.dialects.conventions import SI
from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.dialects.unit_conversion import convert_source_map
from mindstage.knowledge.dialects.units import default_conventions
from mindstage.knowledge.map_statistics import is_constraint
from mindstage.knowledge.rdf import FindingSink, Severity, assign_ids, local_name
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.fields import (
    AttachmentReader,
    ClassSizes,
    map_class_sizes,
    parse_tags,
    read_materials,
    read_size,
    read_tags,
)
from mindstage.knowledge.rdf_mapping.nested import (
    NESTED_ANGULAR_LIMITS,
    NESTED_LINEAR_LIMITS,
    NESTED_POSE,
    NestedResource,
    NestedResourceReader,
)
from mindstage.knowledge.rdf_mapping.properties import (
    GRAVITY,
    MASS,
    MOBILITY,
    OVERLAP_EVENTS,
    PropertyCodec,
    SubjectReader,
    literal_text,
)
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
    TAGS_DATA,
    THING,
    TYPE,
)
from mindstage.scene import (
    AngularLimits,
    Attachment,
    Body,
    BodyId,
    BodyPhysics,
    Iri,
    Joint,
    Light,
    LightType,
    LinearLimits,
    Literal,
    NamedResource,
    Pose,
    PrimitiveShape,
    PropertyAssertion,
    World,
)

__all__ = [
    "check_duplicate_poses",
    "is_early_semlog",
    "read_early_semlog",
    "read_semlog",
    "read_semlog_map",
    "with_tag_properties",
]


_MIN_DUPLICATES = 10
"""So many bodies in one place are a crowd; a door, its panel and its hinge may well share one."""


def check_duplicate_poses(world: World, report: FindingSink) -> None:
    """Reports the places that many bodies are in."""
    places = Counter(body.pose.position for body in world.bodies)
    for place, number in places.items():
        if number >= _MIN_DUPLICATES:
            where = " ".join(f"{part:g}" for part in place)
            report(
                Severity.WARNING,
                world.iri,
                HAS_POSE,
                f"{number:,} bodies are in one place ({where})",
                "they stay there",
            )


T = TypeVar("T")


class _SizeSources(NamedTuple):
    all_classes: ClassSizes
    map_classes: ClassSizes


def read_semlog(source_map: SourceMap) -> World:
    """Reads what is said in the words of dialect 1, in meters, ROS's frame and with w x y z."""
    return _SemlogReader(source_map).world()


def read_semlog_map(source_map: SourceMap) -> World:
    """Reads a map of dialect 1, whose numbers are as they are in a world unless somebody says otherwise."""
    return read_semlog(
        convert_source_map(source_map, default_conventions(source_map, SI, dialect="SemLog"), dialect="SemLog")
    )


class _SemlogReader:
    """One map on its way to a world. The order matters: places, relations, joints, ids, resources, sizes."""

    def __init__(self, source_map: SourceMap) -> None:
        self.source_map = source_map
        self.map, self.graph, self.report = source_map.map, source_map.graph, source_map.report
        self.members = source_map.members
        self.nested_reader = NestedResourceReader(self.graph, {self.map, *self.members}, self.report)
        self.readers: dict[Iri, SubjectReader] = {}
        """All individuals that are there in the end."""
        self.poses: dict[Iri, Pose] = {}
        self.joint_limits: dict[Iri, tuple[LinearLimits, AngularLimits]] = {}
        self.types: dict[Iri, tuple[Iri, ...]] = {}

    def world(self) -> World:
        bodies, constraints, lights = self._classify()
        relations = AttachmentReader(bodies, constraints)
        ends = {
            iri: joined for iri, heard in constraints.items() if (joined := self._joint_ends(heard, bodies, relations))
        }
        self.readers = {iri: self.readers[iri] for iri in self.members if iri in self.readers}
        ids = self._assign_ids()
        resources = self._resources()
        sizes = self._size_sources(resources)
        heard = SubjectReader(self.map, self.graph.get(self.map, ()), self.report)
        heard.consume_references(TYPE, NAMED_INDIVIDUAL, SEMANTIC_MAP)
        if SEMANTIC_MAP not in types_of(heard.facts):
            heard.warn(TYPE, "individuals are described in it, but nothing calls it a map", "it is taken as one")
        name = heard.read(words.LABEL_CODEC)
        return World(
            iri=self.map,
            name=local_name(self.map) if name is None else name,
            bodies=tuple(self._body(iri, ids[iri], sizes) for iri in bodies),
            joints=tuple(
                self._constraint(iri, ids[iri], ids[parent], ids[child]) for iri, (parent, child) in ends.items()
            ),
            attachments=tuple(
                Attachment(parent=ids[relations.parents[child]], child=ids[child])
                for child in bodies
                if child in relations.parents
            ),
            lights=tuple(self._light(iri, ids[iri], kind) for iri, kind in lights.items()),
            facts=heard.remaining(),
            resources=resources,
        )

    # -- who is what ---------------------------------------------------------------------------------------------------

    def _classify(self) -> tuple[dict[Iri, SubjectReader], dict[Iri, SubjectReader], dict[Iri, LightType]]:
        kinds = {cls: kind for kind, cls in LIGHT_CLASSES.items()}
        bodies: dict[Iri, SubjectReader] = {}
        constraints: dict[Iri, SubjectReader] = {}
        lights: dict[Iri, LightType] = {}
        for iri in self.members:
            heard = SubjectReader(iri, self.graph[iri], self.report)
            heard.consume_references(TYPE, NAMED_INDIVIDUAL)
            heard.consume_references(DESCRIBED_IN_MAP, self.map)
            types = self.types[iri] = types_of(heard.facts)
            if is_constraint(types, self.source_map.hierarchy):
                constraints[iri] = heard
            elif self._read_pose(heard):
                if kind := next((kinds[cls] for cls in types if cls in kinds), None):
                    lights[iri] = kind
                else:
                    bodies[iri] = heard
        return bodies, constraints, lights

    def _read_pose(self, reader: SubjectReader) -> bool:
        """Whether the individual has a pose; only those that have one are in the world."""
        pose = self.nested_reader.read(reader, NESTED_POSE)
        if pose is None:
            self._report_omitted(reader.subject, HAS_POSE, "it has no pose that can be understood")
            return False
        self.readers[reader.subject] = reader
        self.poses[reader.subject] = pose
        return True

    def _joint_ends(
        self, reader: SubjectReader, bodies: Mapping[Iri, SubjectReader], relations: AttachmentReader
    ) -> tuple[Iri, Iri] | None:
        """The two bodies that a constraint joins, if they are there and it has a pose."""
        ends = []
        for role in (PARENT, CHILD):
            end = self._resolve_end(reader, role, bodies) or relations.ends.get((reader.subject, role))
            if end is None:
                name = local_name(role)
                self._report_omitted(reader.subject, role, f"its {name} is missing, or is no body of this map")
                return None
            ends.append(end)
        if not self._read_pose(reader):
            return None
        linear, angular = (
            self._read_limits(reader, NESTED_LINEAR_LIMITS),
            self._read_limits(reader, NESTED_ANGULAR_LIMITS),
        )
        self.joint_limits[reader.subject] = (linear or LinearLimits(), angular or AngularLimits())
        return ends[0], ends[1]

    def _read_limits(self, reader: SubjectReader, nested_resource: NestedResource[T]) -> T | None:
        motion = self.nested_reader.read(reader, nested_resource)
        if motion is None:
            reader.warn(nested_resource.property, "nothing understandable is told", "all of it is taken as locked")
        return motion

    def _resolve_end(self, reader: SubjectReader, role: Iri, bodies: Mapping[Iri, SubjectReader]) -> Iri | None:
        found: Iri | None = None
        for index, other in reader.references(role):
            if other not in bodies:
                reader.warn(role, f"{other} is no body of this map", "it stays a fact")
            elif found is None:
                found = other
                reader.consume(index)
            elif other != found:
                reader.warn(role, "it is told twice, differently", "the first counts, the other stays a fact")
        return found

    def _report_omitted(self, individual: Iri, property: Iri, reason: str) -> None:
        self.report(Severity.ERROR, individual, property, reason, "it is left out; what is said about it is kept")

    # -- what they are called ------------------------------------------------------------------------------------------

    def _assign_ids(self) -> dict[Iri, BodyId]:
        explicit: dict[Iri, str] = {}
        taken: set[str] = set()
        for iri, heard in self.readers.items():
            id = heard.read(words.ID, keep_if=taken.__contains__)
            if id in taken:
                heard.warn(words.ID.property, f"the id {id!r} is taken", "it gets another one")
            elif id is not None:
                explicit[iri] = id
                taken.add(id)
        ids = assign_ids(explicit, (iri for iri in self.readers if iri not in explicit))
        for iri in ids.keys() - explicit.keys():
            if ids[iri] != local_name(iri):
                self.readers[iri].warn("", f"the id {local_name(iri)!r} is taken", f"it is called {ids[iri]!r}")
        return ids

    # -- what they are -------------------------------------------------------------------------------------------------

    def _body(self, iri: Iri, id: BodyId, sizes: _SizeSources) -> Body:
        heard = self.readers[iri]
        cls = self._most_specific_class(heard)
        classes = (cls, *(other for other in self.types[iri] if other != cls))
        shape = heard.read(words.SHAPE)
        return Body(
            id=id,
            iri=iri,
            cls=cls,
            pose=self.poses[iri],
            label=heard.read(words.LABEL_CODEC),
            size=read_size(heard, classes, all_classes=sizes.all_classes, map_classes=sizes.map_classes),
            mesh=heard.read(words.MESH),
            shape=None if shape is None else PrimitiveShape(type=shape),
            physics=BodyPhysics(
                mobility=heard.read(words.MOBILITY),
                gravity=heard.read(words.GRAVITY),
                overlap_events=heard.read(words.OVERLAP_EVENTS),
                mass_kg=heard.read(words.MASS),
            ),
            materials=read_materials(heard),
            tags=read_tags(heard),
            facts=heard.remaining(),
        )

    def _most_specific_class(self, reader: SubjectReader) -> Iri:
        types = self.types[reader.subject]
        telling = [cls for cls in types if not cls.startswith((OWL, RDFS))]
        if telling:
            cls = self.source_map.hierarchy.most_specific(telling)
            reader.consume_references(TYPE, cls)
            return cls
        if not types:
            reader.warn(TYPE, "it has no class", "it is taken as an owl:Thing, which everything is")
        return THING

    def _constraint(self, iri: Iri, id: BodyId, parent: BodyId, child: BodyId) -> Joint:
        heard = self.readers[iri]
        heard.consume_references(TYPE, CONSTRAINT)
        linear, angular = self.joint_limits[iri]
        return Joint(
            id=id,
            iri=iri,
            parent=parent,
            child=child,
            pose=self.poses[iri],
            linear=linear,
            angular=angular,
            disable_collision=heard.read(words.DISABLE_COLLISION),
            tags=read_tags(heard),
            facts=heard.remaining(),
        )

    def _light(self, iri: Iri, id: BodyId, light_type: LightType) -> Light:
        heard = self.readers[iri]
        heard.consume_references(TYPE, LIGHT_CLASSES[light_type])
        red, green, blue = heard.read(words.COLOR) or (1.0, 1.0, 1.0)
        intensity = heard.read(words.INTENSITY)
        return Light(
            id=id,
            iri=iri,
            type=light_type,
            pose=self.poses[iri],
            color=(red, green, blue),
            intensity=1.0 if intensity is None else intensity,
            tags=read_tags(heard),
            facts=heard.remaining(),
        )

    # -- what else there is --------------------------------------------------------------------------------------------

    def _resources(self) -> tuple[NamedResource, ...]:
        elsewhere = {self.map, *self.readers}
        left = {
            iri: self.nested_reader.remaining_facts.get(iri, facts)
            for iri, facts in self.graph.items()
            if iri not in elsewhere
        }
        return tuple(NamedResource(iri, tuple(facts)) for iri, facts in left.items() if facts)

    def _size_sources(self, resources: Sequence[NamedResource]) -> _SizeSources:
        own = {resource.iri: resource.facts for resource in resources}
        return _SizeSources(
            all_classes=ClassSizes([own, *self.source_map.ontologies], self.source_map.hierarchy, self.report),
            map_classes=map_class_sizes(resources),
        )


_TAG_CODECS: dict[str, PropertyCodec[Any]] = {
    "mobility": MOBILITY,
    "mass": MASS,
    "gravity": GRAVITY,
    "overlapevents": OVERLAP_EVENTS,
}
"""What tags tell, by their keys in small letters."""
_MOBILITY_MARKER = ";mobility,"


def is_early_semlog(source_map: SourceMap) -> bool:
    """Whether tags alone tell of the mobility of something."""
    return any(
        fact.property == TAGS_DATA
        and _MOBILITY_MARKER in (literal_text(fact.value) or "").lower()
        and _lacks_mobility(facts)
        for facts in (source_map.graph[member] for member in source_map.members)
        for fact in facts
    )


def read_early_semlog(source_map: SourceMap) -> World:
    """Reads a map of dialect 2."""
    return read_semlog_map(with_tag_properties(source_map))


def with_tag_properties(source_map: SourceMap) -> SourceMap:
    """What is said nowhere but in tags, said as properties too."""
    graph = dict(source_map.graph)
    for member in source_map.members:
        if told := list(_facts_from_tags(source_map, member, graph[member])):
            graph[member] = [*graph[member], *told]
    return replace(source_map, graph=graph)


def _lacks_mobility(facts: Sequence[PropertyAssertion]) -> bool:
    """Whether no property tells of the mobility."""
    return all(fact.property != MOBILITY.property for fact in facts)


def _facts_from_tags(
    source_map: SourceMap, member: Iri, facts: Sequence[PropertyAssertion]
) -> Iterator[PropertyAssertion]:
    """What is said nowhere but in tags, as properties."""
    if not _lacks_mobility(facts):
        return
    told = {fact.property for fact in facts}
    for tag in (tag for fact in facts if fact.property == TAGS_DATA for tag in parse_tags(fact.value)):
        word = _TAG_CODECS.get(tag.key.lower())
        if word is None or word.property in told:
            continue
        told.add(word.property)
        value = word.decode(Literal(tag.value))
        if value is None:
            what, did = f"the tag {tag.key} is {tag.value!r}, not {word.expected}", "it stays a tag without meaning"
            source_map.report(Severity.WARNING, member, word.property, what, did)
        else:
            yield PropertyAssertion(word.property, word.encode(value))
