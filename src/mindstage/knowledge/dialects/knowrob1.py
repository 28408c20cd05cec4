"""Dialect 4, KnowRob 1 (2009 to 2016): what robots perceived, and what hangs together.

An object's pose is where it was perceived last, or in the oldest maps where it says that it stands; earlier perceptions
stay facts. Matrices tell it (see `matrices`). Parts go with their whole, unless a joint lets them move.

Perceptions: where KnowRob 1 says that things are, and when it was that they were there.

KnowRob 1's joints: individuals of their own, and the things around them that say to be joined.

A joint names its two ends, or they name it, or its whole does. What it leaves out (where it is, which way it goes) is
decided from where things stand (see `likely_joints`) and said aloud.

Dialect 4, KnowRob 1: what has moved was perceived once more, a second after it was perceived last.

The exact pose stands beside it in dialect 1's words, since a matrix rounds; the perception only restates it.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from math import floor, isfinite
from typing import NamedTuple

import numpy as np

from mindstage.knowledge.dialects.joints import (
    JointLimits,
    JointRange,
    JointType,
    ObservedBox,
    infer_hinge_axis,
    infer_prismatic_axis,
    joint_from_axis,
)
from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.dialects.normalize import DialectNormalizer, abbreviated_names
from mindstage.knowledge.dialects.poses import MatrixPose, NumberReader, pose_from_matrix, resolve_pose_frames
from mindstage.knowledge.dialects.semlog import read_semlog
from mindstage.knowledge.dialects.soma import is_soma, read_soma
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.rdf import Graph, local_name, part_name
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.serialize import SubjectBlock
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONNECTIONS,
    CONSTRAINT,
    EVENT_OCCURS_AT,
    HAS_LINEAR,
    HAS_POSE,
    HINGED_TO,
    JOINT_VALUES,
    KNOWROB,
    OBJECT_ACTED_ON,
    ORIENTATION,
    PARENT,
    PRISMATICALLY_CONNECTED_TO,
    RESTATES,
    START_TIME,
    TO_PARTS,
    TO_WHOLES,
    TYPE,
    knowrob,
    xsd,
)
from mindstage.scene import BlankNode, Body, FactValue, Iri, IriRef, Literal, Pose, PropertyAssertion, World
from mindstage.scene.transforms import Array, normalized_pose_array, rotation_matrix

__all__ = [
    "KNOWROB1_DIALECT",
    "PerceivedPoses",
    "add_joints",
    "find_joints",
    "is_knowrob1",
    "perception_blocks",
    "read_knowrob1",
]


_MATRIX_ELEMENTS = {knowrob(f"m{row}{column}"): (row, column) for row in range(4) for column in range(4)}
_LAST_COLUMN = {(0, 3), (1, 3), (2, 3)}
_REQUIRED_ELEMENTS = frozenset((row, column) for row in range(3) for column in range(4))
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*", re.ASCII)
_SECONDS = re.compile(r"(\d+(?:\.\d+)?)$", re.ASCII)


class _Perception(NamedTuple):
    """One place at which something was seen."""

    time_s: float
    """Seconds; least where nobody says when."""
    order: int
    """Of several at one time, what was told first counts."""
    pose_node: FactValue
    property: Iri


class PerceivedPoses:
    """All that is said about where things are."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._by_individual: dict[Iri, list[_Perception]] = {}
        for facts in graph.values():
            self._collect(facts)

    def _collect(self, facts: Sequence[PropertyAssertion]) -> None:
        seen = [fact.value.iri for fact in facts if fact.property == OBJECT_ACTED_ON and isinstance(fact.value, IriRef)]
        if not seen:
            return
        at = max((_time_of(fact.value) for fact in facts if fact.property == START_TIME), default=-np.inf)
        for place in (fact.value for fact in facts if fact.property == EVENT_OCCURS_AT):
            for individual in seen:
                sights = self._by_individual.setdefault(individual, [])
                sights.append(_Perception(at, -len(sights), place, EVENT_OCCURS_AT))

    def perceptions_of(self, individual: Iri) -> list[_Perception]:
        """Where it was seen, the last time first; then where it says itself that it is."""
        facts = self._graph.get(individual, ())
        told = [_Perception(-np.inf, 0, fact.value, ORIENTATION) for fact in facts if fact.property == ORIENTATION]
        return [*sorted(self._by_individual.get(individual, ()), reverse=True, key=lambda sight: sight[:2]), *told]

    def latest_pose(self, normalizer: DialectNormalizer, individual: Iri) -> MatrixPose | None:
        """The last place of a thing that can be understood; what had to be done for it is reported."""
        for sight in self.perceptions_of(individual):
            found = self._parse_pose(sight.pose_node)
            if isinstance(found, str):
                normalizer.warn(individual, sight.property, found, "it tells no place")
                continue
            for what, did in found.repairs:
                normalizer.warn(individual, sight.property, what, did)
            return found
        return None

    def _parse_pose(self, node: FactValue) -> MatrixPose | str:
        facts = self._facts(node)
        name = local_name(node.iri) if isinstance(node, IriRef) else "its matrix"
        if not facts:
            return f"{name} is not described anywhere"
        if pose := _pose_from_facts(facts):
            return MatrixPose(pose)
        return self._parse_matrix(name, facts)

    def _parse_matrix(self, name: str, facts: Sequence[PropertyAssertion]) -> MatrixPose | str:
        told: dict[tuple[int, int], float] = {}
        for fact in facts:
            if place := _MATRIX_ELEMENTS.get(fact.property):
                number = words.parse_number(words.literal_text(fact.value) or "")
                if number is None:
                    return (
                        f"{name} has {_value_text(fact.value)} as m{place[0]}{place[1]}, which is not a finite number"
                    )
                told.setdefault(place, number)
        missing = _REQUIRED_ELEMENTS - told.keys()
        by_rows = missing <= _LAST_COLUMN and any(told.get((3, column)) for column in range(3))
        if missing and not by_rows:
            return f"{name} does not tell {', '.join(f'm{row}{column}' for row, column in sorted(missing))}"
        matrix = np.eye(4)
        for place, number in told.items():
            matrix[place] = number
        return pose_from_matrix(matrix)

    def _facts(self, value: FactValue) -> list[PropertyAssertion]:
        if isinstance(value, BlankNode):
            return list(value.facts)
        return list(self._graph.get(value.iri, ())) if isinstance(value, IriRef) else []


def _time_of(value: FactValue) -> float:
    """Seconds of a time point, which KnowRob writes into its name, or of a date."""
    text = local_name(value.iri) if isinstance(value, IriRef) else words.literal_text(value) or ""
    if found := _DATE.search(text):
        try:
            date = datetime.fromisoformat(found[0])
        except ValueError:
            return -np.inf
        return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    seconds = _SECONDS.search(text.strip())
    return float(seconds[1]) if seconds else -np.inf


def _pose_from_facts(facts: list[PropertyAssertion]) -> Pose | None:
    """A pose told by translation and quaternion, as the last maps of this kind have it."""
    found: dict[Iri, Array] = {}
    for word in (words.TRANSLATION, words.QUATERNION):
        values = (word.decode(fact.value) for fact in facts if fact.property == word.property)
        told = next((value for value in values if value is not None), None)
        if told is None:
            return None
        found[word.property] = np.array(told)
    x, y, z = found[words.TRANSLATION.property].tolist()
    w, i, j, k = found[words.QUATERNION.property].tolist()
    return Pose((x, y, z), (w, i, j, k))


def _value_text(value: FactValue) -> str:
    return repr(value.text) if isinstance(value, Literal) else "a thing"


_JOINT_TYPES = {
    "HingedJoint": JointType.REVOLUTE,
    "RevoluteJoint": JointType.REVOLUTE,
    "PrismaticJoint": JointType.PRISMATIC,
    "FixedJoint": JointType.FIXED,
    "RigidJoint": JointType.FIXED,
}
_DIRECTION, _TURN_RADIUS = knowrob("direction"), knowrob("turnRadius")
_VECTOR = tuple(knowrob(f"vector{axis}") for axis in "XYZ")
_CONNECTION_JOINT_TYPES = {HINGED_TO: JointType.REVOLUTE, PRISMATICALLY_CONNECTED_TO: JointType.PRISMATIC}


def find_joints(normalizer: DialectNormalizer) -> Mapping[Iri, JointType | None]:
    """The members that are joints, and of what kind; None for one of no kind that is known."""
    joints: dict[Iri, JointType | None] = {}
    for member in normalizer.members:
        types = types_of(normalizer.graph.get(member, ()))
        names = [local_name(cls) for cls in types]
        above = [local_name(upper) for cls in types for upper in normalizer.source_map.hierarchy.ancestors(cls)]
        kind = next((_JOINT_TYPES[name] for name in (*names, *above) if name in _JOINT_TYPES), None)
        if kind or any(name.endswith("Joint") for name in names) or normalizer.values(member, *JOINT_VALUES):
            joints[member] = kind
    return joints


def add_joints(normalizer: DialectNormalizer, joints: Mapping[Iri, JointType | None]) -> None:
    """Says of every joint what it joins and how."""
    _Knowrob1JointReader(normalizer, joints).run()


class _Knowrob1JointReader:
    """All joints of a map."""

    def __init__(self, normalizer: DialectNormalizer, joints: Mapping[Iri, JointType | None]) -> None:
        self.normalizer, self.joints = normalizer, joints
        self.perceived_poses = PerceivedPoses(normalizer.source_map.graph)
        self.number_reader = NumberReader(normalizer.source_map.conventions)
        self.inferred: dict[str, list[Iri]] = {}
        self.parts = {
            member: [part for part in normalizer.references(member, *TO_PARTS) if part in normalizer.poses]
            for member in normalizer.members
        }
        self.neighbors = self._find_neighbors()

    def run(self) -> None:
        for joint, kind in self.joints.items():
            if self.normalizer.values(joint, HAS_LINEAR):
                continue  # it is told in the words of dialect 1 already
            ends = self._joint_ends(joint)
            if ends is None:
                # A constraint without its ends is left out by dialect 1's reader, which says why.
                self.normalizer.add(joint, TYPE, IriRef(CONSTRAINT))
                continue
            parent, child = ends
            if kind is None:
                what = f"{', '.join(map(local_name, types_of(self.normalizer.graph[joint])))} is no known kind of joint"
                self.normalizer.warn(joint, TYPE, what, "it holds its two ends together")
            self.normalizer.add_joint(
                joint, parent, child, self._joint_limits(joint, kind or JointType.FIXED, *ends), name=joint
            )
        for what, joints in self.inferred.items():
            evidence = f"{len(joints)} joints do not tell it, such as {abbreviated_names(joints)}"
            self.normalizer.source_map.record_assumption(f"joints: {what}", "from where things stand", evidence)

    # -- what is joined ------------------------------------------------------------------------------------------------

    def _find_neighbors(self) -> Mapping[Iri, Sequence[Iri]]:
        """By joint, the things that it names or that name it, whatever they say of one another."""
        ways = (*CONNECTIONS, *TO_PARTS, *TO_WHOLES, PARENT, CHILD)
        found: dict[Iri, dict[Iri, None]] = {}
        for member in self.normalizer.members:
            for other in self.normalizer.references(member, *ways):
                found.setdefault(member, {})[other] = None
                found.setdefault(other, {})[member] = None
        return {joint: list(found.get(joint, ())) for joint in self.joints}

    def _joint_ends(self, joint: Iri) -> tuple[Iri, Iri] | None:
        bodies = [other for other in self.neighbors[joint] if other in self.normalizer.poses]
        if len(bodies) == 1:
            bodies += self._connected_bodies(bodies[0], self.joints[joint])[:1]
        if len(bodies) < 2:
            return None
        if len(bodies) > 2:
            what = f"it has to do with {len(bodies)} things: {abbreviated_names(bodies)}"
            self.normalizer.warn(joint, "", what, "the first whole and its part are joined")
        pairs = [(one, other) for one in bodies for other in bodies if other in self.parts[one]]
        if pairs:
            return pairs[0]
        one, other = bodies[:2]
        if one in self.normalizer.references(other, HINGED_TO, PRISMATICALLY_CONNECTED_TO) or self._volume(
            other
        ) > self._volume(one):
            return other, one
        return one, other

    def _connected_bodies(self, body: Iri, joint_type: JointType | None) -> list[Iri]:
        """What a body says to be joined with, in the way of a joint that names only this body; else its whole."""
        ways = [way for way, how in _CONNECTION_JOINT_TYPES.items() if joint_type in (how, None)]
        told = self.normalizer.references(body, *ways)
        told += [member for member in self.normalizer.members if body in self.normalizer.references(member, *ways)]
        told += [whole for whole, parts in self.parts.items() if body in parts]
        return [other for other in told if other in self.normalizer.poses]

    def _volume(self, body: Iri) -> float:
        return float(np.prod(self.normalizer.sizes.get(body, (0.0, 0.0, 0.0))))

    # -- how -----------------------------------------------------------------------------------------------------------

    def _joint_limits(self, joint: Iri, joint_type: JointType, parent: Iri, child: Iri) -> JointLimits:
        range = self._range(joint, joint_type)
        origin, axis = self._origin(joint), self._axis(joint)
        if origin is None or (axis is None and joint_type is not JointType.FIXED):
            for what, told in (("where they are", origin), ("which way they go", axis)):
                if told is None and joint_type is not JointType.FIXED:
                    self.inferred.setdefault(what, []).append(joint)
            boxes = self._box(parent), self._box(child), self._find_handle(child)
            if joint_type is JointType.REVOLUTE:
                radius = next(iter(self._numbers(joint, _TURN_RADIUS)), None)
                likely = infer_hinge_axis(*boxes, range, origin=origin, radius=radius)
            else:
                likely = infer_prismatic_axis(*boxes)
            origin = likely.origin if origin is None else origin
            axis = likely.axis if axis is None else axis
        return joint_from_axis(joint_type, origin, np.array([1.0, 0.0, 0.0]) if axis is None else axis, range)

    def _range(self, joint: Iri, joint_type: JointType) -> JointRange:
        if joint_type not in (JointType.REVOLUTE, JointType.PRISMATIC):
            return None
        told = [next(iter(self._numbers(joint, property)), None) for property in JOINT_VALUES]
        lower, upper = told
        if lower is None or upper is None:
            missing = [property for property, value in zip(JOINT_VALUES, told, strict=True) if value is None]
            self.normalizer.warn(joint, missing[0], "nothing understandable is told", "it may move without end")
            return None
        if lower > upper:
            what = f"its least value {lower:g} is more than its greatest {upper:g}"
            self.normalizer.warn(joint, JOINT_VALUES[0], what, "the two are taken the other way round")
            lower, upper = upper, lower
        if joint_type is JointType.PRISMATIC:
            lower, upper = self.number_reader.lengths((lower, upper))
        return lower, upper

    def _origin(self, joint: Iri) -> Array | None:
        if not self.perceived_poses.perceptions_of(joint):
            return None
        placement = self.perceived_poses.latest_pose(self.normalizer, joint)
        return None if placement is None else np.array(self.number_reader.pose(placement.pose).position)

    def _axis(self, joint: Iri) -> Array | None:
        for value in self.normalizer.values(joint, _DIRECTION):
            facts = value.facts if isinstance(value, BlankNode) else ()
            if isinstance(value, IriRef):
                facts = tuple(self.normalizer.graph.get(value.iri, ()))
            told = [
                next((words.parse_number(words.literal_text(f.value) or "") for f in facts if f.property == part), None)
                for part in _VECTOR
            ]
            direction = np.array([part for part in told if part is not None])
            if len(direction) == 3 and np.linalg.norm(direction) > 0.0:
                return np.array(self.number_reader.direction(direction.tolist()))
            self.normalizer.warn(
                joint, _DIRECTION, "it is not three finite numbers that are not all 0", "it tells no way"
            )
        return None

    def _numbers(self, joint: Iri, property: Iri) -> list[float]:
        told = (
            words.parse_number(words.literal_text(value) or "") for value in self.normalizer.values(joint, property)
        )
        return [number for number in told if number is not None]

    def _box(self, body: Iri) -> ObservedBox:
        return ObservedBox(self.normalizer.poses[body], self.normalizer.sizes.get(body))

    def _find_handle(self, child: Iri) -> ObservedBox | None:
        """The part of a child that it is likely pulled by: the handle, or in front of a drawer its door."""
        parts = [part for part in self.parts[child] if part not in self.joints]
        parts.sort(key=lambda part: not self.normalizer.class_name_contains(part, "Handle"))
        return self._box(parts[0]) if parts else None


KNOWROB1_DIALECT = "KnowRob 1"
_RESTATES_POSE = PropertyAssertion(RESTATES, IriRef(HAS_POSE))


def perception_blocks(body: Body, graph: Graph, used_names: Container[str]) -> Iterator[SubjectBlock]:
    """A perception of a body where it is now, and the matrix that says where.

    Args:
        body: what has moved.
        graph: what the map says, earlier perceptions among it.
        taken: names that others have.
    """
    sights = PerceivedPoses(graph).perceptions_of(body.iri)
    last = max((sight.time_s for sight in sights if isfinite(sight.time_s)), default=-1.0)
    event, matrix = (part_name(body.iri, suffix, used_names) for suffix in ("perception", "matrix"))
    yield SubjectBlock(
        event,
        [
            PropertyAssertion(TYPE, IriRef(knowrob("SemanticMapPerception"))),
            _RESTATES_POSE,
            PropertyAssertion(OBJECT_ACTED_ON, IriRef(body.iri)),
            PropertyAssertion(EVENT_OCCURS_AT, IriRef(matrix)),
            PropertyAssertion(START_TIME, IriRef(Iri(f"{KNOWROB}timepoint_{floor(last) + 1}"))),
        ],
        f"Perception of {body.id}",
    )
    yield SubjectBlock(
        matrix,
        [PropertyAssertion(TYPE, IriRef(knowrob("RotationMatrix3D"))), _RESTATES_POSE, *_matrix_facts(body.pose)],
    )


def _matrix_facts(pose: Pose) -> Iterator[PropertyAssertion]:
    row, matrix = normalized_pose_array(pose), np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_matrix(row[3:]), row[:3]
    for (i, j), number in np.ndenumerate(matrix):
        yield PropertyAssertion(knowrob(f"m{i}{j}"), Literal(repr(float(number) + 0.0), xsd("float")))


def is_knowrob1(source_map: SourceMap) -> bool:
    """Whether something in the map has a place that only this dialect understands."""
    unplaced = [member for member in source_map.members if not _has_pose(source_map, member)]
    return bool(unplaced) and any(map(PerceivedPoses(source_map.graph).perceptions_of, unplaced))


def read_knowrob1(source_map: SourceMap) -> World:
    """Reads a map of dialect 4."""
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes of too large numbers is looked at afterwards
        reworded = _normalize(DialectNormalizer(source_map))
    # Maps were carried from one generation to the next by hand, and some things were left as they were.
    return read_soma(reworded) if is_soma(reworded) else read_semlog(reworded)


def _normalize(normalizer: DialectNormalizer) -> SourceMap:
    excerpt = normalizer.source_map
    joints = find_joints(normalizer)
    numbers = NumberReader(excerpt.conventions)
    _set_poses(
        normalizer, [each for each in excerpt.members if each not in joints and not _has_pose(excerpt, each)], numbers
    )
    _set_sizes(normalizer, numbers)
    numbers.report_assumptions(normalizer)
    add_joints(normalizer, joints)
    _attach_parts(normalizer)
    normalizer.make_jointed_dynamic()
    return normalizer.normalized()


def _has_pose(source_map: SourceMap, individual: Iri) -> bool:
    return any(fact.property == HAS_POSE for fact in source_map.graph.get(individual, ()))


def _set_poses(normalizer: DialectNormalizer, individuals: list[Iri], number_reader: NumberReader) -> None:
    """Says where things are."""
    excerpt = normalizer.source_map
    perceptions = PerceivedPoses(excerpt.graph)
    placements = {}
    for individual in individuals:
        placement = perceptions.latest_pose(normalizer, individual)
        if placement is not None:
            placements[individual] = placement
    mirrored = [individual for individual, placement in placements.items() if placement.mirrored]
    if mirrored:
        evidence = f"{len(mirrored)} of {len(placements)} matrices are left-handed: {abbreviated_names(mirrored)}"
        value = "matrices are taken without their mirror: x and z stay, y is turned round"
        excerpt.record_assumption("handedness", value, evidence)
    poses = {individual: number_reader.pose(placement.pose) for individual, placement in placements.items()}
    for individual, pose in resolve_pose_frames(normalizer, poses, dict(_part_pairs(normalizer))).items():
        normalizer.set_pose(individual, pose)


def _set_sizes(normalizer: DialectNormalizer, number_reader: NumberReader) -> None:
    """Says how large things are: a length below 0 only says which way an axis was drawn."""
    backwards = []
    for individual in normalizer.poses:
        told = [_read_length(normalizer, individual, number) for number in range(3)]
        if any(length is not None and length < 0.0 for length in told):
            backwards.append(individual)
        normalizer.set_size(individual, [None if each is None else abs(number_reader.length(each)) for each in told])
    if backwards:
        evidence = (
            f"{len(backwards)} of {len(normalizer.poses)} things have a length below 0: {abbreviated_names(backwards)}"
        )
        normalizer.source_map.record_assumption("lengths below 0", "the same above 0", evidence)


def _read_length(normalizer: DialectNormalizer, individual: Iri, axis: int) -> float | None:
    for value in normalizer.values(individual, words.SIZE[axis].property):
        length = words.parse_number(words.literal_text(value) or "")
        if length is not None:
            return length
    return None


def _part_pairs(normalizer: DialectNormalizer) -> Iterator[tuple[Iri, Iri]]:
    """Each part, and what it is a part of."""
    for member in normalizer.members:
        for part in normalizer.references(member, *TO_PARTS):
            yield part, member
        for whole in normalizer.references(member, *TO_WHOLES):
            yield member, whole


def _attach_parts(normalizer: DialectNormalizer) -> None:
    """Says what goes where other things go."""
    hanging = {child for member in normalizer.members for child in normalizer.references(member, CHILD)}
    hanging |= {member for member in normalizer.members if normalizer.references(member, PARENT)}
    pairs = dict.fromkeys((whole, part) for part, whole in _part_pairs(normalizer))
    for member in normalizer.members:
        for property in CONNECTIONS:
            for other in normalizer.references(member, property):
                if (other, member) not in pairs:
                    pairs[member, other] = None
                if (
                    property in (HINGED_TO, PRISMATICALLY_CONNECTED_TO)
                    and frozenset((member, other)) not in normalizer.joined_pairs
                ):
                    what = f"it is joined with {local_name(other)}, but no joint tells how far that moves"
                    normalizer.warn(member, property, what, "they go together")
    for whole, part in pairs:
        if normalizer.can_attach(whole, part) and part not in hanging:
            normalizer.attach(whole, part)
