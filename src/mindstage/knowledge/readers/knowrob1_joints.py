"""KnowRob 1's joints: individuals of their own, and the things around them that say to be joined.

A joint names its two ends, or they name it, or its whole does. What it leaves out (where it is, which way it goes) is
decided from where things stand (see `likely_joints`) and said aloud.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.joint_frames import Joint, JointKind, Range, joint_along
from mindstage.knowledge.readers.likely_joints import Box, likely_hinge, likely_slide
from mindstage.knowledge.readers.numbers import Numbers
from mindstage.knowledge.readers.perceptions import Perceptions
from mindstage.knowledge.readers.rewording import Rewording, few
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.other_words import CONNECTIONS, HINGED, JOINT_VALUES, SLID, TO_PARTS, TO_WHOLES
from mindstage.knowledge.vocabulary import CHILD, CONSTRAINT, HAS_LINEAR, PARENT, TYPE, knowrob
from mindstage.knowledge.wording import words
from mindstage.world import Anonymous, Iri, Reference
from mindstage.world.geometry import Array

__all__ = ["join_all", "joints_of"]

_KINDS = {
    "HingedJoint": JointKind.HINGE,
    "RevoluteJoint": JointKind.HINGE,
    "PrismaticJoint": JointKind.SLIDE,
    "FixedJoint": JointKind.FIXED,
    "RigidJoint": JointKind.FIXED,
}
_DIRECTION, _TURN_RADIUS = knowrob("direction"), knowrob("turnRadius")
_VECTOR = tuple(knowrob(f"vector{axis}") for axis in "XYZ")
_SAY_HOW = {HINGED: JointKind.HINGE, SLID: JointKind.SLIDE}


def joints_of(rewording: Rewording) -> Mapping[Iri, JointKind | None]:
    """The members that are joints, and of what kind; None for one of no kind that is known."""
    joints: dict[Iri, JointKind | None] = {}
    for member in rewording.members:
        types = types_of(rewording.graph.get(member, ()))
        names = [local_name(cls) for cls in types]
        above = [local_name(upper) for cls in types for upper in rewording.excerpt.hierarchy.ancestors(cls)]
        kind = next((_KINDS[name] for name in (*names, *above) if name in _KINDS), None)
        if kind or any(name.endswith("Joint") for name in names) or rewording.values(member, *JOINT_VALUES):
            joints[member] = kind
    return joints


def join_all(rewording: Rewording, joints: Mapping[Iri, JointKind | None]) -> None:
    """Says of every joint what it joins and how."""
    _Joining(rewording, joints).run()


class _Joining:
    """All joints of a map."""

    def __init__(self, rewording: Rewording, joints: Mapping[Iri, JointKind | None]) -> None:
        self.rewording, self.joints = rewording, joints
        self.perceptions = Perceptions(rewording.excerpt.graph)
        self.numbers = Numbers(rewording.excerpt.conventions)
        self.guessed: dict[str, list[Iri]] = {}
        self.parts = {
            member: [part for part in rewording.references(member, *TO_PARTS) if part in rewording.poses]
            for member in rewording.members
        }
        self.neighbours = self._neighbours()

    def run(self) -> None:
        for joint, kind in self.joints.items():
            if self.rewording.values(joint, HAS_LINEAR):
                continue  # it is told in the words of dialect 1 already
            ends = self._ends(joint)
            if ends is None:
                # A constraint without its ends is left out by dialect 1's reader, which says why.
                self.rewording.add(joint, TYPE, Reference(CONSTRAINT))
                continue
            parent, child = ends
            if kind is None:
                what = f"{', '.join(map(local_name, types_of(self.rewording.graph[joint])))} is no known kind of joint"
                self.rewording.warn(joint, TYPE, what, "it holds its two ends together")
            self.rewording.join(joint, parent, child, self._joint(joint, kind or JointKind.FIXED, *ends), name=joint)
        for what, joints in self.guessed.items():
            evidence = f"{len(joints)} joints do not tell it, such as {few(joints)}"
            self.rewording.excerpt.assume(f"joints: {what}", "from where things stand", evidence)

    # -- what is joined ------------------------------------------------------------------------------------------------

    def _neighbours(self) -> Mapping[Iri, Sequence[Iri]]:
        """By joint, the things that it names or that name it, whatever they say of one another."""
        ways = (*CONNECTIONS, *TO_PARTS, *TO_WHOLES, PARENT, CHILD)
        found: dict[Iri, dict[Iri, None]] = {}
        for member in self.rewording.members:
            for other in self.rewording.references(member, *ways):
                found.setdefault(member, {})[other] = None
                found.setdefault(other, {})[member] = None
        return {joint: list(found.get(joint, ())) for joint in self.joints}

    def _ends(self, joint: Iri) -> tuple[Iri, Iri] | None:
        bodies = [other for other in self.neighbours[joint] if other in self.rewording.poses]
        if len(bodies) == 1:
            bodies += self._partners(bodies[0], self.joints[joint])[:1]
        if len(bodies) < 2:
            return None
        if len(bodies) > 2:
            what = f"it has to do with {len(bodies)} things: {few(bodies)}"
            self.rewording.warn(joint, "", what, "the first whole and its part are joined")
        pairs = [(one, other) for one in bodies for other in bodies if other in self.parts[one]]
        if pairs:
            return pairs[0]
        one, other = bodies[:2]
        if one in self.rewording.references(other, HINGED, SLID) or self._volume(other) > self._volume(one):
            return other, one
        return one, other

    def _partners(self, body: Iri, kind: JointKind | None) -> list[Iri]:
        """What a body says to be joined with, in the way of a joint that names only this body; else its whole."""
        ways = [way for way, how in _SAY_HOW.items() if kind in (how, None)]
        told = self.rewording.references(body, *ways)
        told += [member for member in self.rewording.members if body in self.rewording.references(member, *ways)]
        told += [whole for whole, parts in self.parts.items() if body in parts]
        return [other for other in told if other in self.rewording.poses]

    def _volume(self, body: Iri) -> float:
        return float(np.prod(self.rewording.sizes.get(body, (0.0, 0.0, 0.0))))

    # -- how -----------------------------------------------------------------------------------------------------------

    def _joint(self, joint: Iri, kind: JointKind, parent: Iri, child: Iri) -> Joint:
        range = self._range(joint, kind)
        origin, axis = self._origin(joint), self._axis(joint)
        if origin is None or (axis is None and kind is not JointKind.FIXED):
            for what, told in (("where they are", origin), ("which way they go", axis)):
                if told is None and kind is not JointKind.FIXED:
                    self.guessed.setdefault(what, []).append(joint)
            boxes = self._box(parent), self._box(child), self._handle(child)
            if kind is JointKind.HINGE:
                radius = next(iter(self._numbers(joint, _TURN_RADIUS)), None)
                likely = likely_hinge(*boxes, range, origin=origin, radius=radius)
            else:
                likely = likely_slide(*boxes)
            origin = likely.origin if origin is None else origin
            axis = likely.axis if axis is None else axis
        return joint_along(kind, origin, np.array([1.0, 0.0, 0.0]) if axis is None else axis, range)

    def _range(self, joint: Iri, kind: JointKind) -> Range:
        if kind not in (JointKind.HINGE, JointKind.SLIDE):
            return None
        told = [next(iter(self._numbers(joint, property)), None) for property in JOINT_VALUES]
        lower, upper = told
        if lower is None or upper is None:
            missing = [property for property, value in zip(JOINT_VALUES, told, strict=True) if value is None]
            self.rewording.warn(joint, missing[0], "nothing understandable is told", "it may move without end")
            return None
        if lower > upper:
            what = f"its least value {lower:g} is more than its greatest {upper:g}"
            self.rewording.warn(joint, JOINT_VALUES[0], what, "the two are taken the other way round")
            lower, upper = upper, lower
        if kind is JointKind.SLIDE:
            lower, upper = self.numbers.lengths((lower, upper))
        return lower, upper

    def _origin(self, joint: Iri) -> Array | None:
        if not self.perceptions.sights(joint):
            return None
        placement = self.perceptions.placement(self.rewording, joint)
        return None if placement is None else np.array(self.numbers.pose(placement.pose).position)

    def _axis(self, joint: Iri) -> Array | None:
        for value in self.rewording.values(joint, _DIRECTION):
            facts = value.facts if isinstance(value, Anonymous) else ()
            if isinstance(value, Reference):
                facts = tuple(self.rewording.graph.get(value.iri, ()))
            told = [
                next((words.number_in(words.text_in(f.value) or "") for f in facts if f.property == part), None)
                for part in _VECTOR
            ]
            direction = np.array([part for part in told if part is not None])
            if len(direction) == 3 and np.linalg.norm(direction) > 0.0:
                return np.array(self.numbers.direction(direction.tolist()))
            self.rewording.warn(
                joint, _DIRECTION, "it is not three finite numbers that are not all 0", "it tells no way"
            )
        return None

    def _numbers(self, joint: Iri, property: Iri) -> list[float]:
        told = (words.number_in(words.text_in(value) or "") for value in self.rewording.values(joint, property))
        return [number for number in told if number is not None]

    def _box(self, body: Iri) -> Box:
        return Box(self.rewording.poses[body], self.rewording.sizes.get(body))

    def _handle(self, child: Iri) -> Box | None:
        """The part of a child that it is likely pulled by: the handle, or in front of a drawer its door."""
        parts = [part for part in self.parts[child] if part not in self.joints]
        parts.sort(key=lambda part: not self.rewording.is_called(part, "Handle"))
        return self._box(parts[0]) if parts else None
