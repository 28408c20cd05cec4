"""Dialects 1 and 2, SemLog maps: conversion of a map's statements to a world.

Every individual with `describedInMap` and a pose becomes a body, a joint or a light. A statement about it that has no
field in the world becomes one of its facts, and every other statement of the source becomes a fact of a named resource,
so each statement is in the world exactly once. Values that cannot be used as given are reported, and written back
unchanged. `mindstage.maps.io.write` is the inverse.

The early maps (dialect 2) give physical properties in tags only. Their constraints do not name the map that they belong
to; `individuals_by_map` infers it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

from mindstage.maps.dialects.body_boxes import with_body_boxes
from mindstage.maps.dialects.conventions import SI
from mindstage.maps.dialects.map_statistics import is_constraint
from mindstage.maps.dialects.membership import types_of
from mindstage.maps.dialects.source_map import Dialect, SourceMap
from mindstage.maps.dialects.unit_conversion import convert_source_map
from mindstage.maps.dialects.units import default_conventions
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.fields import (
    AttachmentReader,
    ClassGeometry,
    map_class_geometry,
    parse_tags,
    read_materials,
    read_mesh,
    read_size,
    read_tags,
)
from mindstage.maps.rdf_mapping.nested import (
    NESTED_ANGULAR_LIMITS,
    NESTED_LINEAR_LIMITS,
    NESTED_POSE,
    NestedResource,
    NestedResourceReader,
)
from mindstage.maps.rdf_mapping.properties import (
    GRAVITY,
    MASS,
    MOBILITY,
    OVERLAP_EVENTS,
    PropertyCodec,
    SubjectReader,
    literal_text,
)
from mindstage.rdf.graphs import FindingSink, Severity, assign_ids, local_name
from mindstage.rdf.vocabulary import (
    ASSUMED_PARENT,
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
    JointMimic,
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
    "EARLY_SEMLOG",
    "SEMLOG",
    "check_duplicate_poses",
    "is_early_semlog",
    "read_early_semlog",
    "read_semlog",
    "read_semlog_map",
    "with_tag_properties",
]


_MIN_DUPLICATES = 10
"""Number of bodies at one position above which it is reported; a door, its panel and its hinge may share one."""


T = TypeVar("T")
_TAG_CODECS: dict[str, PropertyCodec[Any]] = {
    "mobility": MOBILITY,
    "mass": MASS,
    "gravity": GRAVITY,
    "overlapevents": OVERLAP_EVENTS,
}
"""Codecs of the properties that tags may give, by the tag's key in lower case."""
_MOBILITY_MARKER = ";mobility,"


def check_duplicate_poses(world: World, report: FindingSink) -> None:
    """Reports each position that many bodies share, as in a map whose poses were never written."""
    positions = Counter(body.pose.position for body in world.bodies)
    for position, number in positions.items():
        if number >= _MIN_DUPLICATES:
            where = " ".join(f"{part:g}" for part in position)
            report(
                Severity.WARNING,
                world.iri,
                HAS_POSE,
                f"{number:,} bodies are at one position ({where})",
                "they stay there",
            )


class _ClassSources(NamedTuple):
    all_classes: ClassGeometry
    map_classes: ClassGeometry


def read_semlog(source_map: SourceMap) -> World:
    """Reads a map in the vocabulary of dialect 1 with SI units, ROS axes and quaternions w x y z."""
    return _SemlogReader(source_map).world()


def read_semlog_map(source_map: SourceMap) -> World:
    """Reads a map of dialect 1, in SI units and ROS axes unless the map or the user declares others."""
    conventions = default_conventions(source_map, SI, dialect="SemLog")
    return read_semlog(with_body_boxes(convert_source_map(source_map, conventions, dialect="SemLog"), conventions))


class _SemlogReader:
    """Conversion of one map. The order matters: poses, relations, joints, ids, resources, sizes."""

    def __init__(self, source_map: SourceMap) -> None:
        self.source_map = source_map
        self.map, self.graph, self.report = source_map.map, source_map.graph, source_map.report
        self.members = source_map.members
        self.nested_reader = NestedResourceReader(self.graph, {self.map, *self.members}, self.report)
        self.readers: dict[Iri, SubjectReader] = {}
        """Readers of the individuals that become part of the world."""
        self.poses: dict[Iri, Pose] = {}
        self.joint_limits: dict[Iri, tuple[LinearLimits, AngularLimits]] = {}
        self.types: dict[Iri, tuple[Iri, ...]] = {}

    def world(self) -> World:
        bodies, joints, lights = self._classify()
        relations = AttachmentReader(bodies, joints)
        ends = {
            iri: joined for iri, reader in joints.items() if (joined := self._joint_ends(reader, bodies, relations))
        }
        self.readers = {iri: self.readers[iri] for iri in self.members if iri in self.readers}
        ids = self._assign_ids()
        joint_ids = {iri: ids[iri] for iri in ends}
        resources = self._resources()
        given = self._class_sources(resources)
        reader = SubjectReader(self.map, self.graph.get(self.map, ()), self.report)
        reader.consume_references(TYPE, NAMED_INDIVIDUAL, SEMANTIC_MAP)
        if SEMANTIC_MAP not in types_of(reader.facts):
            reader.warn(TYPE, "individuals are described in it, but it has no map class", "it is read as a map")
        name = reader.read(codecs.LABEL_CODEC)
        return World(
            iri=self.map,
            name=local_name(self.map) if name is None else name,
            bodies=tuple(self._body(iri, ids[iri], given) for iri in bodies),
            joints=tuple(
                self._joint(iri, ids[iri], ids[parent], ids[child], joint_ids) for iri, (parent, child) in ends.items()
            ),
            attachments=tuple(
                Attachment(parent=ids[relations.parents[child]], child=ids[child])
                for child in bodies
                if child in relations.parents
            ),
            lights=tuple(self._light(iri, ids[iri], kind) for iri, kind in lights.items()),
            facts=reader.remaining(),
            resources=resources,
        )

    # -- individuals ---------------------------------------------------------------------------------------------------

    def _classify(self) -> tuple[dict[Iri, SubjectReader], dict[Iri, SubjectReader], dict[Iri, LightType]]:
        kinds = {cls: kind for kind, cls in LIGHT_CLASSES.items()}
        bodies: dict[Iri, SubjectReader] = {}
        joints: dict[Iri, SubjectReader] = {}
        lights: dict[Iri, LightType] = {}
        for iri in self.members:
            reader = SubjectReader(iri, self.graph[iri], self.report)
            reader.consume_references(TYPE, NAMED_INDIVIDUAL)
            reader.consume_references(DESCRIBED_IN_MAP, self.map)
            types = self.types[iri] = types_of(reader.facts)
            if is_constraint(types, self.source_map.hierarchy):
                joints[iri] = reader
            elif self._read_pose(reader):
                if kind := next((kinds[cls] for cls in types if cls in kinds), None):
                    lights[iri] = kind
                else:
                    bodies[iri] = reader
        return bodies, joints, lights

    def _read_pose(self, reader: SubjectReader) -> bool:
        """Reads the pose of an individual and returns whether it has one; individuals without a pose are omitted."""
        pose = self.nested_reader.read(reader, NESTED_POSE)
        if pose is None:
            self._report_omitted(reader.subject, HAS_POSE, "it has no valid pose")
            return False
        self.readers[reader.subject] = reader
        self.poses[reader.subject] = pose
        return True

    def _joint_ends(
        self, reader: SubjectReader, bodies: Mapping[Iri, SubjectReader], relations: AttachmentReader
    ) -> tuple[Iri, Iri] | None:
        """Returns the parent and the child of a joint, or None if one of them or its pose is missing."""
        ends = []
        for role in (PARENT, CHILD):
            assumed = self._resolve_end(reader, ASSUMED_PARENT, bodies) if role == PARENT else None
            end = self._resolve_end(reader, role, bodies) or assumed or relations.ends.get((reader.subject, role))
            if end is None:
                name = local_name(role)
                self._report_omitted(reader.subject, role, f"its {name} is missing, or is not a body of this map")
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
            reader.warn(nested_resource.property, "it has no valid limits", "all of its axes are locked")
        return motion

    def _resolve_end(self, reader: SubjectReader, role: Iri, bodies: Mapping[Iri, SubjectReader]) -> Iri | None:
        found: Iri | None = None
        for index, other in reader.references(role):
            if other not in bodies:
                reader.warn(role, f"{other} is not a body of this map", "it is kept as a fact")
            elif found is None:
                found = other
                reader.consume(index)
            elif other != found:
                reader.warn(role, "it is given twice, differently", "the first counts, the other is kept as a fact")
        return found

    def _report_omitted(self, individual: Iri, property: Iri, reason: str) -> None:
        self.report(Severity.ERROR, individual, property, reason, "it is omitted; its statements are kept")

    # -- ids -----------------------------------------------------------------------------------------------------------

    def _assign_ids(self) -> dict[Iri, BodyId]:
        explicit: dict[Iri, str] = {}
        taken: set[str] = set()
        for iri, reader in self.readers.items():
            id = reader.read(codecs.ID, keep_if=taken.__contains__)
            if id in taken:
                reader.warn(codecs.ID.property, f"the id {id!r} is taken", "it gets another one")
            elif id is not None:
                explicit[iri] = id
                taken.add(id)
        ids = assign_ids(explicit, (iri for iri in self.readers if iri not in explicit))
        for iri in ids.keys() - explicit.keys():
            if ids[iri] != local_name(iri):
                self.readers[iri].warn("", f"the id {local_name(iri)!r} is taken", f"its id is {ids[iri]!r}")
        return ids

    # -- bodies, joints and lights -------------------------------------------------------------------------------------

    def _body(self, iri: Iri, id: BodyId, given: _ClassSources) -> Body:
        reader = self.readers[iri]
        cls = self._most_specific_class(reader)
        classes = (cls, *(other for other in self.types[iri] if other != cls))
        shape, mobility = reader.read(codecs.SHAPE), reader.read(codecs.MOBILITY)
        assumed = None if mobility else reader.read(codecs.ASSUMED_MOBILITY)
        return Body(
            id=id,
            iri=iri,
            cls=cls,
            pose=self.poses[iri],
            label=reader.read(codecs.LABEL_CODEC),
            size=read_size(reader, classes, all_classes=given.all_classes, map_classes=given.map_classes),
            mesh=read_mesh(reader, classes, all_classes=given.all_classes, map_classes=given.map_classes),
            shape=None if shape is None else PrimitiveShape(type=shape),
            physics=BodyPhysics(
                mobility=mobility or assumed,
                assumed=("mobility",) if assumed else (),
                gravity=reader.read(codecs.GRAVITY),
                overlap_events=reader.read(codecs.OVERLAP_EVENTS),
                mass_kg=reader.read(codecs.MASS),
            ),
            materials=read_materials(reader),
            tags=read_tags(reader),
            facts=reader.remaining(),
        )

    def _most_specific_class(self, reader: SubjectReader) -> Iri:
        types = self.types[reader.subject]
        specific = [cls for cls in types if not cls.startswith((OWL, RDFS))]
        if specific:
            cls = self.source_map.hierarchy.most_specific(specific)
            reader.consume_references(TYPE, cls)
            return cls
        if not types:
            reader.warn(TYPE, "it has no class", "it is read as an owl:Thing")
        return THING

    def _joint(self, iri: Iri, id: BodyId, parent: BodyId, child: BodyId, joint_ids: Mapping[Iri, BodyId]) -> Joint:
        reader = self.readers[iri]
        reader.consume_references(TYPE, CONSTRAINT)
        linear, angular = self.joint_limits[iri]
        return Joint(
            id=id,
            iri=iri,
            parent=parent,
            child=child,
            pose=self.poses[iri],
            linear=linear,
            angular=angular,
            disable_collision=reader.read(codecs.DISABLE_COLLISION),
            mimic=self._mimic(reader, joint_ids),
            assumed=tuple((reader.read(codecs.ASSUMED) or "").split()),
            tags=read_tags(reader),
            facts=reader.remaining(),
        )

    @staticmethod
    def _mimic(reader: SubjectReader, joint_ids: Mapping[Iri, BodyId]) -> JointMimic | None:
        """Returns the joint that a joint follows, or None; what is not another joint of the map is kept as a fact."""
        others = joint_ids.keys() - {reader.subject}
        master = reader.read(codecs.MIMICS, keep_if=lambda iri: iri not in others)
        if master is None:
            return None
        if master not in others:
            reader.warn(codecs.MIMICS.property, f"{master} is not another joint of this map", "it moves independently")
            return None
        multiplier = reader.read(codecs.MIMIC_MULTIPLIER)
        return JointMimic(
            joint=joint_ids[master],
            multiplier=1.0 if multiplier is None else multiplier,
            offset=reader.read(codecs.MIMIC_OFFSET) or 0.0,
        )

    def _light(self, iri: Iri, id: BodyId, light_type: LightType) -> Light:
        reader = self.readers[iri]
        reader.consume_references(TYPE, LIGHT_CLASSES[light_type])
        red, green, blue = reader.read(codecs.COLOR) or (1.0, 1.0, 1.0)
        intensity = reader.read(codecs.INTENSITY)
        return Light(
            id=id,
            iri=iri,
            type=light_type,
            pose=self.poses[iri],
            color=(red, green, blue),
            intensity=1.0 if intensity is None else intensity,
            tags=read_tags(reader),
            facts=reader.remaining(),
        )

    # -- resources -----------------------------------------------------------------------------------------------------

    def _resources(self) -> tuple[NamedResource, ...]:
        in_world = {self.map, *self.readers}
        remaining = {
            iri: self.nested_reader.remaining_facts.get(iri, facts)
            for iri, facts in self.graph.items()
            if iri not in in_world
        }
        return tuple(NamedResource(iri, tuple(facts)) for iri, facts in remaining.items() if facts)

    def _class_sources(self, resources: Sequence[NamedResource]) -> _ClassSources:
        own = {resource.iri: resource.facts for resource in resources}
        return _ClassSources(
            all_classes=ClassGeometry([own, *self.source_map.ontologies], self.source_map.hierarchy, self.report),
            map_classes=map_class_geometry(resources),
        )


def is_early_semlog(source_map: SourceMap) -> bool:
    """Whether some individual's mobility is given by a tag only."""
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
    """Returns the map with the values that are given by tags only added as properties."""
    graph = dict(source_map.graph)
    for member in source_map.members:
        if facts := list(_facts_from_tags(source_map, member, graph[member])):
            graph[member] = [*graph[member], *facts]
    return replace(source_map, graph=graph)


def _lacks_mobility(facts: Sequence[PropertyAssertion]) -> bool:
    """Whether no statement gives the mobility."""
    return all(fact.property != MOBILITY.property for fact in facts)


def _facts_from_tags(
    source_map: SourceMap, member: Iri, facts: Sequence[PropertyAssertion]
) -> Iterator[PropertyAssertion]:
    """Yields the values that are given by tags only, as property assertions."""
    if not _lacks_mobility(facts):
        return
    given = {fact.property for fact in facts}
    for tag in (tag for fact in facts if fact.property == TAGS_DATA for tag in parse_tags(fact.value)):
        codec = _TAG_CODECS.get(tag.key.lower())
        if codec is None or codec.property in given:
            continue
        given.add(codec.property)
        value = codec.decode(Literal(tag.value))
        if value is None:
            problem, action = f"the tag {tag.key} is {tag.value!r}, not {codec.expected}", "the tag is ignored"
            source_map.report(Severity.WARNING, member, codec.property, problem, action)
        else:
            yield PropertyAssertion(codec.property, codec.encode(value))


EARLY_SEMLOG = Dialect("SemLog, early", is_early_semlog, read_early_semlog, order=40)


SEMLOG = Dialect("SemLog", lambda source_map: True, read_semlog_map, order=50)
