"""KnowRob 1's joints: individuals of their own, and the things around them that say to be joined.

A joint names its two ends, or they name it, or its whole does. What it leaves out (where it is, which way it goes) is
decided from where things stand (see `likely_joints`) and said aloud.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.joint_frames import JointLimits, JointRange, JointType, joint_from_axis
from mindstage.knowledge.readers.likely_joints import ObservedBox, infer_hinge_axis, infer_prismatic_axis
from mindstage.knowledge.readers.numbers import NumberReader
from mindstage.knowledge.readers.perceptions import PerceivedPoses
from mindstage.knowledge.readers.rewording import DialectNormalizer, abbreviated_names
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.other_words import (
    CONNECTIONS,
    HINGED_TO,
    JOINT_VALUES,
    PRISMATICALLY_CONNECTED_TO,
    TO_PARTS,
    TO_WHOLES,
)
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, HAS_LINEAR, PARENT, TYPE, knowrob
from mindstage.knowledge.wording import words
from mindstage.world import BlankNode, Iri, IriRef
from mindstage.world.geometry import Array

__all__ = ["add_joints", "find_joints"]

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
