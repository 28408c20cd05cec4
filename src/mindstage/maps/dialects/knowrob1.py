"""Dialect 4, KnowRob 1 (2009 to 2016): perceived objects, parts and joints.

The pose of an object is that of its latest perception, or in the oldest maps that of its `orientation`; earlier
perceptions are kept as facts. Poses are 4 x 4 matrices (see `pose_from_matrix`). Parts are attached to their whole
unless a joint lets them move.

A joint is an individual. It refers to its two bodies, or they or their whole refer to it. Its position and axis are
inferred where they are missing (see `mindstage.maps.dialects.joints`), and recorded as assumptions.

A body that has moved is written with an additional perception, one second after its latest one. Matrices are rounded,
so the exact pose is written in the vocabulary of dialect 1 and the perception only restates it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from math import floor, isfinite
from typing import NamedTuple

import numpy as np

from mindstage.maps.dialects.conventions import QuaternionOrder
from mindstage.maps.dialects.joint_ends import JointEnds
from mindstage.maps.dialects.joints import (
    HingeEvidence,
    InferredAxis,
    JointLimits,
    JointRange,
    JointType,
    infer_hinge_axis,
    infer_prismatic_axis,
    joint_from_axis,
    opening_range,
)
from mindstage.maps.dialects.membership import node_facts, references, types_of
from mindstage.maps.dialects.normalize import DialectNormalizer, abbreviated_names
from mindstage.maps.dialects.poses import MatrixPose, NumberReader, pose_from_matrix, resolve_pose_frames
from mindstage.maps.dialects.semlog import read_semlog
from mindstage.maps.dialects.serialize import SubjectBlock
from mindstage.maps.dialects.soma import is_soma, read_soma
from mindstage.maps.dialects.source_map import Dialect, SourceMap
from mindstage.maps.dialects.srdl import add_kinematics, find_kinematics
from mindstage.maps.dialects.units import decide_quaternion_order, guess_units
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.rdf.graphs import Graph, local_name, part_name
from mindstage.rdf.vocabulary import (
    CHILD,
    CONNECTIONS,
    CONSTRAINT,
    DOOR_HINGED_TO,
    DOOR_HINGED_WITH,
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
from mindstage.scene import Body, FactValue, Iri, IriRef, Literal, Pose, PropertyAssertion, World
from mindstage.scene.joint_kinematics import ObservedBox
from mindstage.scene.transforms import Array, normalized_pose_array, rotation_matrix

__all__ = [
    "KNOWROB1",
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


_JOINT_TYPES = {
    "HingedJoint": JointType.REVOLUTE,
    "RevoluteJoint": JointType.REVOLUTE,
    "PrismaticJoint": JointType.PRISMATIC,
    "FixedJoint": JointType.FIXED,
    "RigidJoint": JointType.FIXED,
}
_DIRECTION, _TURN_RADIUS = knowrob("direction"), knowrob("turnRadius")
_VECTOR = tuple(knowrob(f"vector{axis}") for axis in "XYZ")
_RELATIVE_TO = knowrob("relativeTo")
_CONNECTION_JOINT_TYPES = {
    DOOR_HINGED_TO: JointType.REVOLUTE,
    HINGED_TO: JointType.REVOLUTE,
    PRISMATICALLY_CONNECTED_TO: JointType.PRISMATIC,
}
KNOWROB1_DIALECT = "KnowRob 1"
_RESTATES_POSE = PropertyAssertion(RESTATES, IriRef(HAS_POSE))


class _Perception(NamedTuple):
    """A pose at which an individual was perceived."""

    time_s: float
    """Time [s]; -inf if unknown."""
    order: int
    """Order among perceptions of the same time; the first one given counts."""
    pose_node: FactValue
    property: Iri


class PerceivedPoses:
    """The poses of individuals by perceptions and by their `orientation`."""

    def __init__(self, graph: Graph, *, quaternion_order: QuaternionOrder = QuaternionOrder.WXYZ) -> None:
        self._graph = graph
        self._quaternion_order = quaternion_order
        self._by_individual: dict[Iri, list[_Perception]] = {}
        for facts in graph.values():
            self._collect(facts)

    def _collect(self, facts: Sequence[PropertyAssertion]) -> None:
        seen = references(facts, OBJECT_ACTED_ON)
        if not seen:
            return
        at = max((_time_of(fact.value) for fact in facts if fact.property == START_TIME), default=-np.inf)
        for pose_node in (fact.value for fact in facts if fact.property == EVENT_OCCURS_AT):
            for individual in seen:
                perceptions = self._by_individual.setdefault(individual, [])
                perceptions.append(_Perception(at, -len(perceptions), pose_node, EVENT_OCCURS_AT))

    def perceptions_of(self, individual: Iri) -> list[_Perception]:
        """Returns the perceptions of an individual, latest first, then the poses that it gives itself."""
        facts = self._graph.get(individual, ())
        own = [_Perception(-np.inf, 0, fact.value, ORIENTATION) for fact in facts if fact.property == ORIENTATION]
        perceptions = sorted(
            self._by_individual.get(individual, ()), reverse=True, key=lambda perception: perception[:2]
        )
        return [*perceptions, *own]

    def quaternions(self, individuals: Iterable[Iri]) -> list[tuple[float, ...]]:
        """Returns the quaternions of individuals whose latest pose is not a matrix, as given."""
        found: list[tuple[float, ...]] = []
        for individual in individuals:
            for perception in self.perceptions_of(individual)[:1]:
                pose = _pose_from_facts(node_facts(self._graph, perception.pose_node), QuaternionOrder.WXYZ)
                if pose is not None:
                    found.append(pose.quaternion)
        return found

    def latest_pose(self, normalizer: DialectNormalizer, individual: Iri) -> MatrixPose | None:
        """Returns the latest valid pose of an individual, or None; repairs and invalid poses are reported."""
        for perception in self.perceptions_of(individual):
            found = self._parse_pose(perception.pose_node)
            if isinstance(found, str):
                normalizer.warn(individual, perception.property, found, "this pose is ignored")
                continue
            for problem, action in found.repairs:
                normalizer.warn(individual, perception.property, problem, action)
            return found
        return None

    def _parse_pose(self, node: FactValue) -> MatrixPose | str:
        facts = node_facts(self._graph, node)
        name = local_name(node.iri) if isinstance(node, IriRef) else "its matrix"
        if not facts:
            return f"{name} is not described anywhere"
        if pose := _pose_from_facts(facts, self._quaternion_order):
            return MatrixPose(pose)
        return self._parse_matrix(name, facts)

    def _parse_matrix(self, name: str, facts: Sequence[PropertyAssertion]) -> MatrixPose | str:
        elements: dict[tuple[int, int], float] = {}
        for fact in facts:
            if index := _MATRIX_ELEMENTS.get(fact.property):
                number = codecs.parse_number(codecs.literal_text(fact.value) or "")
                if number is None:
                    return (
                        f"{name} has {_value_text(fact.value)} as m{index[0]}{index[1]}, which is not a finite number"
                    )
                elements.setdefault(index, number)
        missing = _REQUIRED_ELEMENTS - elements.keys()
        by_rows = missing <= _LAST_COLUMN and any(elements.get((3, column)) for column in range(3))
        if missing and not by_rows:
            return f"{name} does not give {', '.join(f'm{row}{column}' for row, column in sorted(missing))}"
        matrix = np.eye(4)
        for index, number in elements.items():
            matrix[index] = number
        return pose_from_matrix(matrix)


def _time_of(value: FactValue) -> float:
    """Returns the time [s] of a date, or of a time point, which KnowRob encodes in its name; -inf if there is none."""
    text = local_name(value.iri) if isinstance(value, IriRef) else codecs.literal_text(value) or ""
    if found := _DATE.search(text):
        try:
            date = datetime.fromisoformat(found[0])
        except ValueError:
            return -np.inf
        return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    seconds = _SECONDS.search(text.strip())
    return float(seconds[1]) if seconds else -np.inf


def _pose_from_facts(facts: Sequence[PropertyAssertion], order: QuaternionOrder) -> Pose | None:
    """Reads a pose given by translation and quaternion, as in the latest maps of this dialect; None if incomplete."""
    position, quaternion = codecs.TRANSLATION.first_value(facts), codecs.QUATERNION.first_value(facts)
    if position is None or quaternion is None:
        return None
    (x, y, z), (a, b, c, d) = position, quaternion
    w, i, j, k = (d, a, b, c) if order is QuaternionOrder.XYZW else (a, b, c, d)
    return Pose((x, y, z), (w, i, j, k))


def _value_text(value: FactValue) -> str:
    return repr(value.text) if isinstance(value, Literal) else "a resource"


def _numbers(normalizer: DialectNormalizer, individual: Iri, property: Iri) -> list[float]:
    texts = (codecs.literal_text(value) or "" for value in normalizer.values(individual, property))
    return [number for number in map(codecs.parse_number, texts) if number is not None]


def _lengths(normalizer: DialectNormalizer, individual: Iri) -> list[float | None]:
    return [next(iter(_numbers(normalizer, individual, codec.property)), None) for codec in codecs.SIZE]


def find_joints(normalizer: DialectNormalizer) -> Mapping[Iri, JointType | None]:
    """Returns the members that are joints and their types; None for an unknown type."""
    joints: dict[Iri, JointType | None] = {}
    for member in normalizer.members:
        types = types_of(normalizer.graph.get(member, ()))
        names = [local_name(cls) for cls in types]
        above = [local_name(upper) for cls in types for upper in normalizer.source_map.hierarchy.ancestors(cls)]
        joint_type = next((_JOINT_TYPES[name] for name in (*names, *above) if name in _JOINT_TYPES), None)
        if joint_type or any(name.endswith("Joint") for name in names) or normalizer.values(member, *JOINT_VALUES):
            joints[member] = joint_type
    return joints


def add_joints(
    normalizer: DialectNormalizer, joints: Mapping[Iri, JointType | None], number_reader: NumberReader
) -> None:
    """Adds every joint of a map to the normalizer, with the bodies that it connects and its motion."""
    _Knowrob1JointReader(normalizer, joints, number_reader).run()


class _Knowrob1JointReader:
    """Reads the joints of a map."""

    def __init__(
        self, normalizer: DialectNormalizer, joints: Mapping[Iri, JointType | None], number_reader: NumberReader
    ) -> None:
        self.normalizer, self.joints, self.number_reader = normalizer, joints, number_reader
        self.perceived_poses = PerceivedPoses(normalizer.source_map.graph, quaternion_order=number_reader.order)
        self.inferred: dict[str, list[Iri]] = {}
        self.evidence: list[str] = []
        self.parts = {
            member: [part for part in normalizer.references(member, *TO_PARTS) if part in normalizer.poses]
            for member in normalizer.members
        }
        self.neighbors = self._find_neighbors()
        self.ends = JointEnds(normalizer)

    def run(self) -> None:
        for joint, joint_type in self.joints.items():
            if self.normalizer.values(joint, HAS_LINEAR):
                continue  # the joint is already given in the vocabulary of dialect 1
            ends = self._joint_ends(joint)
            if ends is None:
                # Dialect 1's reader omits a constraint without its ends and reports the reason.
                self.normalizer.add(joint, TYPE, IriRef(CONSTRAINT))
                continue
            parent, child = ends
            if joint_type is None:
                names = ", ".join(map(local_name, types_of(self.normalizer.graph[joint])))
                self.normalizer.warn(
                    joint, TYPE, f"{names} is an unknown type of joint", "the two bodies are joined rigidly"
                )
            self.normalizer.add_joint(
                joint, parent, child, self._joint_limits(joint, joint_type or JointType.FIXED, *ends), name=joint
            )
        self.normalizer.record_inferred(self.inferred, self.evidence)
        self.ends.record_carried()

    # -- connected bodies ----------------------------------------------------------------------------------------------

    def _find_neighbors(self) -> Mapping[Iri, Sequence[Iri]]:
        """Returns the resources that each joint refers to or that refer to it."""
        properties = (*CONNECTIONS, *TO_PARTS, *TO_WHOLES, DOOR_HINGED_WITH, PARENT, CHILD)
        found: dict[Iri, dict[Iri, None]] = {}
        for member in self.normalizer.members:
            for other in self.normalizer.references(member, *properties):
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
            problem = f"it is related to {len(bodies)} bodies: {abbreviated_names(bodies)}"
            self.normalizer.warn(joint, "", problem, "the first whole and its part are joined")
        pairs = [(one, other) for one in bodies for other in bodies if other in self.parts[one]]
        first, second = pairs[0] if pairs else (bodies[0], bodies[1])
        children = self.normalizer.references(joint, CHILD)
        if first in children or second in self.normalizer.references(joint, PARENT):
            first, second = second, first
        child = second if {first, second} & {*children, *self.normalizer.references(joint, PARENT)} else None
        parent, child = self.ends.ordered(joint, first, second, property="", child=child)
        return self.ends.carrier(self.joints[joint], parent, child)

    def _connected_bodies(self, body: Iri, joint_type: JointType | None) -> list[Iri]:
        """Returns the bodies that one with a joint is connected to by a joint of this type, then its wholes."""
        properties = [
            property for property, connected in _CONNECTION_JOINT_TYPES.items() if joint_type in (connected, None)
        ]
        candidates = self.normalizer.references(body, *properties)
        candidates += [
            member for member in self.normalizer.members if body in self.normalizer.references(member, *properties)
        ]
        candidates += [whole for whole, parts in self.parts.items() if body in parts]
        return [other for other in candidates if other in self.normalizer.poses]

    # -- axis and limits -----------------------------------------------------------------------------------------------

    def _joint_limits(self, joint: Iri, joint_type: JointType, parent: Iri, child: Iri) -> JointLimits:
        range = self._range(joint, joint_type)
        pose, axis = self._pose(joint), self._axis(joint)
        origin = None if pose is None else pose[:3]
        if joint_type is not JointType.FIXED:
            for attribute, given in (("position", origin), ("axis", axis)):
                if given is None:
                    self.inferred.setdefault(attribute, []).append(joint)
                    self.normalizer.assumed.setdefault(child, []).append(attribute)
        boxes = self.normalizer.box(parent), self.normalizer.box(child), self._find_handle(child)
        if joint_type is JointType.REVOLUTE:
            inferred, conflicts = infer_hinge_axis(
                HingeEvidence(
                    parent=boxes[0],
                    child=boxes[1],
                    handle=boxes[2],
                    range=range,
                    origin=origin,
                    axis=axis,
                    frame=None if pose is None else rotation_matrix(pose[3:]).T,
                    radius=next(iter(_numbers(self.normalizer, joint, _TURN_RADIUS)), None),
                    class_names=self.normalizer.class_names(parent, child),
                )
            )
            for conflict in conflicts:
                self.normalizer.warn(joint, _DIRECTION if axis is not None else "", conflict, "it is inferred instead")
            origin, axis = inferred.origin, inferred.axis
            self.evidence.append(f"{local_name(joint)}: {inferred.evidence}")
        elif origin is None or axis is None:
            inferred = infer_prismatic_axis(*boxes)
            origin = inferred.origin if origin is None else origin
            inferred = inferred if axis is None else inferred._replace(opens=int(np.sign(inferred.axis @ axis)))
            axis = inferred.axis if axis is None else axis
        else:
            inferred = InferredAxis(origin, axis, "it is given")
        if range is None:
            range = self._missing_range(joint, joint_type, boxes[1], inferred)
            if range is not None:
                self.normalizer.assumed.setdefault(child, []).append("limits")
        return joint_from_axis(joint_type, origin, np.array([1.0, 0.0, 0.0]) if axis is None else axis, range)

    def _missing_range(
        self, joint: Iri, joint_type: JointType, child: ObservedBox, inferred: InferredAxis
    ) -> JointRange:
        """Returns an assumed range of a joint that gives none or half of one; None if it may move without limits."""
        if joint_type not in (JointType.REVOLUTE, JointType.PRISMATIC):
            return None
        assumed = opening_range(child, inferred, joint_type)
        given = [next(iter(_numbers(self.normalizer, joint, property)), None) for property in JOINT_VALUES]
        if joint_type is JointType.PRISMATIC:
            given = [None if value is None else self.number_reader.length(value) for value in given]
        if assumed is None:
            action = "it may move without limits"
        else:
            # A limit that is given is kept.
            lower, upper = (own if value is None else value for value, own in zip(given, assumed, strict=True))
            assumed = (lower, upper) if lower < upper else assumed
            unit = "m" if joint_type is JointType.PRISMATIC else "rad"
            action = f"it opens outwards, by {max(map(abs, assumed)):.3g} {unit}"
        self.normalizer.warn(joint, JOINT_VALUES[given.index(None)], "it has no valid limit", action)
        return assumed

    def _range(self, joint: Iri, joint_type: JointType) -> JointRange:
        """Returns the range that a joint gives, or None."""
        if joint_type not in (JointType.REVOLUTE, JointType.PRISMATIC):
            return None
        lower, upper = (next(iter(_numbers(self.normalizer, joint, property)), None) for property in JOINT_VALUES)
        if lower is None or upper is None:
            return None
        lower, upper = self.normalizer.ordered_limits(joint, JOINT_VALUES[0], lower, upper)
        if joint_type is JointType.PRISMATIC:
            lower, upper = self.number_reader.lengths((lower, upper))
        return lower, upper

    def _pose(self, joint: Iri) -> Array | None:
        """Returns the pose of a joint, seven numbers, or None."""
        if not self.perceived_poses.perceptions_of(joint):
            return None
        matrix_pose = self.perceived_poses.latest_pose(self.normalizer, joint)
        return None if matrix_pose is None else normalized_pose_array(self.number_reader.pose(matrix_pose.pose))

    def _axis(self, joint: Iri) -> Array | None:
        for value in self.normalizer.values(joint, _DIRECTION):
            facts = node_facts(self.normalizer.graph, value)
            vector = [
                next(
                    (codecs.parse_number(codecs.literal_text(f.value) or "") for f in facts if f.property == part), None
                )
                for part in _VECTOR
            ]
            direction = np.array([part for part in vector if part is not None])
            if len(direction) == 3 and np.linalg.norm(direction) > 0.0:
                return np.array(self.number_reader.direction(direction.tolist()))
            self.normalizer.warn(
                joint, _DIRECTION, "it is not three finite numbers that are not all 0", "it is ignored"
            )
        return None

    def _find_handle(self, child: Iri) -> ObservedBox | None:
        """Returns what a child is most likely pulled by: a handle, its knobs, or for a drawer possibly its door."""
        parts = [part for part in self.parts[child] if part not in self.joints]
        for word in ("Handle", "Knob"):
            if named := [part for part in parts if self.normalizer.class_name_contains(part, word)]:
                return _mean_box([self.normalizer.box(part) for part in named])
        return self.normalizer.box(parts[0]) if parts else None


def _mean_box(boxes: Sequence[ObservedBox]) -> ObservedBox:
    """Returns the first of some boxes, at the mean of their positions."""
    x, y, z = np.mean([box.center for box in boxes], axis=0).tolist()
    return ObservedBox(Pose((x, y, z), boxes[0].pose.quaternion), boxes[0].size)


def perception_blocks(body: Body, perceived: PerceivedPoses, used_names: Container[str]) -> Iterator[SubjectBlock]:
    """Yields a perception of a body at its current pose, and the matrix of the pose.

    Args:
        body: the body that has moved.
        perceived: the earlier perceptions of the map.
        used_names: names that are taken.
    """
    last = max((each.time_s for each in perceived.perceptions_of(body.iri) if isfinite(each.time_s)), default=-1.0)
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
    """Whether some individual of the map has a pose in this dialect only."""
    unplaced = [member for member in source_map.members if not _has_pose(source_map, member)]
    return bool(unplaced) and any(map(PerceivedPoses(source_map.graph).perceptions_of, unplaced))


def read_knowrob1(source_map: SourceMap) -> World:
    """Reads a KnowRob 1 map."""
    with np.errstate(over="ignore", invalid="ignore"):  # overflowing poses are reported afterwards
        normalized = _normalize(DialectNormalizer(source_map))
    # Maps were migrated between dialects by hand, and may contain statements of several of them.
    return read_soma(normalized) if is_soma(normalized) else read_semlog(normalized)


def _normalize(normalizer: DialectNormalizer) -> SourceMap:
    source_map = normalizer.source_map
    joints = find_joints(normalizer)
    numbers = NumberReader(source_map.conventions)
    kinematics = find_kinematics(normalizer)
    others = {joint: joint_type for joint, joint_type in joints.items() if joint not in kinematics.joints}
    unplaced = [
        each
        for each in source_map.members
        if each not in joints and each not in kinematics.links and not _has_pose(source_map, each)
    ]
    _decide_conventions(normalizer, unplaced, numbers)
    _set_poses(normalizer, unplaced, numbers)
    add_kinematics(normalizer, kinematics, _joint_frames(normalizer, numbers))
    _set_sizes(normalizer, numbers)
    numbers.report_assumptions(normalizer)
    add_joints(normalizer, others, numbers)
    _attach_parts(normalizer)
    normalizer.make_jointed_dynamic()
    return normalizer.normalized()


def _joint_frames(
    normalizer: DialectNormalizer, number_reader: NumberReader
) -> Callable[[Iri], tuple[Array, bool] | None]:
    """Returns a function that gives the pose of a joint, and whether it is relative to the joint before it."""
    graph = normalizer.source_map.graph
    perceptions = PerceivedPoses(graph, quaternion_order=number_reader.order)

    def frame(joint: Iri) -> tuple[Array, bool] | None:
        found = perceptions.latest_pose(normalizer, joint)
        if found is None:
            return None
        node = node_facts(graph, perceptions.perceptions_of(joint)[0].pose_node)
        return normalized_pose_array(number_reader.pose(found.pose)), bool(references(node, _RELATIVE_TO))

    return frame


def _has_pose(source_map: SourceMap, individual: Iri) -> bool:
    return any(fact.property == HAS_POSE for fact in source_map.graph.get(individual, ()))


def _decide_conventions(normalizer: DialectNormalizer, individuals: list[Iri], number_reader: NumberReader) -> None:
    """Decides units and quaternion order by the numbers of individuals: m and w x y z unless ruled out."""
    lengths = {each: _lengths(normalizer, each) for each in individuals}
    sizes = {each: [x for x in row if x is not None] for each, row in lengths.items() if None not in row}
    number_reader.consider_units(guess_units(normalizer.source_map, sizes))
    if quaternions := PerceivedPoses(normalizer.source_map.graph).quaternions(individuals):
        number_reader.order = decide_quaternion_order(
            normalizer.source_map, quaternions, number_reader.order, dialect=KNOWROB1_DIALECT
        )


def _set_poses(normalizer: DialectNormalizer, individuals: list[Iri], number_reader: NumberReader) -> None:
    """Adds the poses of individuals."""
    source_map = normalizer.source_map
    perceptions = PerceivedPoses(source_map.graph, quaternion_order=number_reader.order)
    matrix_poses = {}
    for individual in individuals:
        matrix_pose = perceptions.latest_pose(normalizer, individual)
        if matrix_pose is not None:
            matrix_poses[individual] = matrix_pose
    mirrored = [individual for individual, matrix_pose in matrix_poses.items() if matrix_pose.mirrored]
    if mirrored:
        evidence = f"{len(mirrored)} of {len(matrix_poses)} matrices are left-handed: {abbreviated_names(mirrored)}"
        value = "mirrored matrices are converted: x and z are kept, y is negated"
        source_map.record_assumption("handedness", value, evidence)
    poses = {individual: number_reader.pose(matrix_pose.pose) for individual, matrix_pose in matrix_poses.items()}
    for individual, pose in resolve_pose_frames(normalizer, poses, dict(_part_pairs(normalizer))).items():
        normalizer.set_pose(individual, pose)


def _set_sizes(normalizer: DialectNormalizer, number_reader: NumberReader) -> None:
    """Adds the sizes of individuals; the sign of a length, which may encode the direction of an axis, is dropped."""
    negative = []
    for individual in normalizer.poses:
        lengths = _lengths(normalizer, individual)
        if any(length is not None and length < 0.0 for length in lengths):
            negative.append(individual)
        normalizer.set_size(individual, [None if each is None else abs(number_reader.length(each)) for each in lengths])
    if negative:
        evidence = (
            f"{len(negative)} of {len(normalizer.poses)} bodies have a negative length: {abbreviated_names(negative)}"
        )
        normalizer.source_map.record_assumption("negative lengths", "their absolute values", evidence)


def _part_pairs(normalizer: DialectNormalizer) -> Iterator[tuple[Iri, Iri]]:
    """Yields each part with its whole."""
    for member in normalizer.members:
        for part in normalizer.references(member, *TO_PARTS):
            yield part, member
        for whole in normalizer.references(member, *TO_WHOLES):
            yield member, whole


def _attach_parts(normalizer: DialectNormalizer) -> None:
    """Attaches parts and connected bodies, unless a joint lets them move."""
    pairs = dict.fromkeys((whole, part) for part, whole in _part_pairs(normalizer))
    for member in normalizer.members:
        for property in CONNECTIONS:
            for other in normalizer.references(member, property):
                if (other, member) not in pairs:
                    pairs[member, other] = None
                if (
                    property in (HINGED_TO, PRISMATICALLY_CONNECTED_TO)
                    and frozenset((member, other)) not in normalizer.joined_pairs | normalizer.carried_pairs
                ):
                    problem = f"it is connected to {local_name(other)}, but no joint gives their motion"
                    normalizer.warn(member, property, problem, "they are attached rigidly")
    normalizer.attach_loose(pairs)


KNOWROB1 = Dialect("KnowRob 1", is_knowrob1, read_knowrob1, order=10)
