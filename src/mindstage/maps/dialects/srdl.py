"""Kinematics of robots in SRDL 2 (2012 to 2018): links and joints that succeed one another, as in a URDF tree.

A link is a body at the frame of its joint, with the first mesh, box, cylinder or sphere that it gives and its mass; one
without any is a frame, of size 0. A matrix of a joint is relative to the frame of the joint before it, or to the map if
it has no `relativeTo`. A fixed joint is an attachment. The converter of SRDL 2 drops axes and limits: where a joint
gives no axis, it moves along or about the z axis of its frame, which is recorded as an assumption.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from mindstage.maps.dialects.joints import JointRange, JointType, joint_from_axis
from mindstage.maps.dialects.membership import node_facts, types_of
from mindstage.maps.dialects.normalize import DialectNormalizer, abbreviated_names
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import CHILD, JOINT_VALUES, SUCCEEDING_JOINT, SUCCEEDING_LINK, knowrob, srdl, urdf
from mindstage.scene import Iri, IriRef, Mobility, PrimitiveType
from mindstage.scene.transforms import Array, pose_from_array, pose_multiply, quat_rotate

__all__ = ["Kinematics", "add_kinematics", "find_kinematics"]


_JOINT_TYPES = {
    "RevoluteUrdfJoint": JointType.REVOLUTE,
    "ContinuousUrdfJoint": JointType.REVOLUTE,
    "PrismaticUrdfJoint": JointType.PRISMATIC,
    "FixedUrdfJoint": JointType.FIXED,
    "FloatingUrdfJoint": JointType.FLOATING,
    "PlanarUrdfJoint": JointType.PLANAR,
}
_PRECEDING_LINK = srdl("precedingLink")
_AXES = (srdl("axis_xyz"), srdl("axis"), urdf("hasAxisVector"))
_DIRECTION = knowrob("direction")
_VECTOR = tuple(knowrob(f"vector{axis}") for axis in "XYZ")
_LIMITS = ((JOINT_VALUES[0], srdl("limit_lower")), (JOINT_VALUES[1], srdl("limit_upper")))
_MESH, _BOX, _MASS = srdl("mesh_filename"), srdl("box_size"), srdl("mass_value")
_SPHERE_RADIUS, _CYLINDER_RADIUS, _CYLINDER_LENGTH = (
    srdl("sphere_radius"),
    srdl("cylinder_radius"),
    srdl("cylinder_length"),
)
_MIMICS, _NAME = srdl("mimic_joint"), srdl("urdfName")
_MIMIC_NUMBERS = (
    (srdl("mimic_multiplier"), codecs.MIMIC_MULTIPLIER),
    (srdl("mimic_offset"), codecs.MIMIC_OFFSET),
)
_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Kinematics:
    """The links and joints of the robots in a map."""

    links: Mapping[Iri, None]
    """All links."""
    joints: Mapping[Iri, tuple[Iri | None, Iri]]
    """By joint, the link before it, or None for the map, and the link after it."""
    after: Mapping[Iri, list[Iri]] = field(default_factory=dict)
    """By link, the joints after it."""


def find_kinematics(normalizer: DialectNormalizer) -> Kinematics:
    """Returns the links and joints of a map; none in a map without robots."""
    before: dict[Iri, Iri] = {}
    children: dict[Iri, Iri] = {}
    for subject, facts in normalizer.graph.items():
        for fact in facts:
            if not isinstance(fact.value, IriRef):
                continue
            if fact.property == SUCCEEDING_JOINT:
                before.setdefault(fact.value.iri, subject)
            elif fact.property == _PRECEDING_LINK:
                before.setdefault(subject, fact.value.iri)
            elif fact.property == SUCCEEDING_LINK and subject in normalizer.members and _is_joint(normalizer, subject):
                children.setdefault(subject, fact.value.iri)
    joints = {joint: (before.get(joint), link) for joint, link in children.items() if link in normalizer.graph}
    after: dict[Iri, list[Iri]] = {}
    for joint, (parent, _) in joints.items():
        if parent is not None:
            after.setdefault(parent, []).append(joint)
    links = dict.fromkeys(link for ends in joints.values() for link in ends if link is not None)
    return Kinematics(links, joints, after)


def _is_joint(normalizer: DialectNormalizer, individual: Iri) -> bool:
    return any(local_name(cls).endswith("Joint") for cls in types_of(normalizer.graph.get(individual, ())))


def add_kinematics(
    normalizer: DialectNormalizer, kinematics: Kinematics, joint_pose: Callable[[Iri], tuple[Array, bool] | None]
) -> None:
    """Adds the bodies and joints of the robots in a map.

    Args:
        joint_pose: returns the pose of a joint, seven numbers [m], and whether it is relative to the joint before it;
            None if it has no valid one.
    """
    if kinematics.joints:
        _KinematicsReader(normalizer, kinematics, joint_pose).run()


class _KinematicsReader:
    def __init__(
        self,
        normalizer: DialectNormalizer,
        kinematics: Kinematics,
        joint_pose: Callable[[Iri], tuple[Array, bool] | None],
    ) -> None:
        self.normalizer, self.kinematics, self.joint_pose = normalizer, kinematics, joint_pose
        self.frames: dict[Iri, Array] = {}
        self.without_axis: list[Iri] = []
        self.by_name = {name: joint for joint in kinematics.joints for name in self._texts(joint, _NAME)}

    def run(self) -> None:
        children = {link for _, link in self.kinematics.joints.values()}
        for link in self.kinematics.links:
            if link not in children:
                self._add_link(link, _IDENTITY, is_movable=False)
        for joint, (parent, _) in self.kinematics.joints.items():
            if parent is None:
                self._add_tree([(joint, False)])
        self._add_tree([(joint, False) for link in [*self.frames] for joint in self.kinematics.after.get(link, ())])
        for joint, (_, link) in self.kinematics.joints.items():
            if link not in self.frames:
                self.normalizer.warn(joint, SUCCEEDING_LINK, "the joints before it form a loop", "its link is omitted")
            if joint not in self.frames and (self._is_rigid(joint) or link not in self.frames):
                self.normalizer.members.pop(joint, None)
        if self.without_axis:
            count = len(self.without_axis)
            evidence = f"{count} joints do not give it, such as {abbreviated_names(self.without_axis)}"
            self.normalizer.source_map.record_assumption("joints: axis", "the z axis of the joint's frame", evidence)

    def _add_tree(self, pending: list[tuple[Iri, bool]]) -> None:
        """Adds joints, their links and all joints after these; with each, whether its parent can move."""
        while pending:
            joint, is_movable = pending.pop()
            parent, link = self.kinematics.joints[joint]
            if link in self.frames:
                continue
            is_movable = is_movable or not self._is_rigid(joint)
            self._add_link(link, self._frame(joint, parent), is_movable=is_movable)
            if parent is not None and self._is_rigid(joint):
                self.normalizer.add(parent, CHILD, IriRef(link))
            elif parent is not None:
                self._add_joint(joint, parent, link)
            pending += [(each, is_movable) for each in self.kinematics.after.get(link, ())]

    def _frame(self, joint: Iri, parent: Iri | None) -> Array:
        base = _IDENTITY if parent is None else self.frames[parent]
        found = self.joint_pose(joint)
        if found is None:
            self.normalizer.warn(joint, "", "it has no valid pose", "it is at the link before it")
            return base
        pose, is_relative = found
        return pose_multiply(base, pose) if is_relative else pose

    # -- links ---------------------------------------------------------------------------------------------------------

    def _add_link(self, link: Iri, frame: Array, *, is_movable: bool) -> None:
        normalizer = self.normalizer
        normalizer.members[link] = None
        self.frames[link] = frame
        normalizer.set_pose(link, pose_from_array(frame))
        if normalizer.first_value(link, codecs.MOBILITY) is None:
            normalizer.prepend_value(link, codecs.ASSUMED_MOBILITY, Mobility.DYNAMIC if is_movable else Mobility.STATIC)
        mass = next(self._numbers(link, _MASS), None)
        if mass is not None and mass > 0.0 and normalizer.first_value(link, codecs.MASS) is None:
            normalizer.prepend_value(link, codecs.MASS, mass)
        mesh = normalizer.first_value(link, codecs.MESH) or next(self._texts(link, _MESH), None)
        if mesh is not None and normalizer.first_value(link, codecs.MESH) is None:
            normalizer.set_mesh(link, mesh)
        if any(normalizer.first_value(link, codec) is not None for codec in codecs.SIZE):
            return
        size, shape = self._primitive(link)
        if size is not None:
            normalizer.set_size(link, size)
            normalizer.set_shape(link, shape)
        elif mesh is None:
            normalizer.set_size(link, (0.0, 0.0, 0.0))

    def _primitive(self, link: Iri) -> tuple[tuple[float, float, float] | None, PrimitiveType]:
        for text in self._texts(link, _BOX):
            box = [codecs.parse_number(part) for part in text.split()]
            if len(box) == 3 and None not in box:
                x, y, z = (abs(part) for part in box if part is not None)
                return (x, y, z), PrimitiveType.BOX
        for radius, length in zip(
            self._numbers(link, _CYLINDER_RADIUS), self._numbers(link, _CYLINDER_LENGTH), strict=False
        ):
            return (2 * radius, 2 * radius, length), PrimitiveType.CYLINDER
        for radius in self._numbers(link, _SPHERE_RADIUS):
            return (2 * radius, 2 * radius, 2 * radius), PrimitiveType.SPHERE
        return None, PrimitiveType.BOX

    # -- joints --------------------------------------------------------------------------------------------------------

    def _type(self, joint: Iri) -> JointType:
        names = map(local_name, types_of(self.normalizer.graph[joint]))
        return next((_JOINT_TYPES[name] for name in names if name in _JOINT_TYPES), JointType.FIXED)

    def _is_rigid(self, joint: Iri) -> bool:
        return self._type(joint) is JointType.FIXED

    def _add_joint(self, joint: Iri, parent: Iri, link: Iri) -> None:
        joint_type, frame = self._type(joint), self.frames[link]
        axis = self._axis(joint)
        if axis is None:
            self.without_axis.append(joint)
            self.normalizer.assumed.setdefault(link, []).append("axis")
            axis = np.array([0.0, 0.0, 1.0])
        limits = joint_from_axis(joint_type, frame[:3], quat_rotate(frame[3:], axis), self._range(joint, joint_type))
        # Some robots have a link and a joint of the same name.
        self.normalizer.add_joint(joint, parent, link, limits, name=None if joint in self.kinematics.links else joint)
        for master in (self.by_name[name] for name in self._texts(joint, _MIMICS) if name in self.by_name):
            if not self._is_rigid(master):
                self.normalizer.add(joint, codecs.MIMICS.property, IriRef(master))
                for given, codec in _MIMIC_NUMBERS:
                    for number in self._numbers(joint, given):
                        self.normalizer.prepend_value(joint, codec, number)

    def _axis(self, joint: Iri) -> Array | None:
        """Returns the axis of a joint in its frame; None if it gives none."""
        rows = [tuple(map(codecs.parse_number, text.split())) for text in self._texts(joint, *_AXES)]
        for value in self.normalizer.values(joint, _DIRECTION):
            facts = node_facts(self.normalizer.graph, value)
            texts = [
                [codecs.literal_text(fact.value) or "" for fact in facts if fact.property == part] for part in _VECTOR
            ]
            rows.append(tuple(codecs.parse_number(text[0]) for text in texts if text))
        for row in rows:
            numbers = np.array([part for part in row if part is not None])
            if len(numbers) == 3 == len(row) and np.linalg.norm(numbers) > 0.0:
                return numbers
        return None

    def _range(self, joint: Iri, joint_type: JointType) -> JointRange:
        is_continuous = any(local_name(cls) == "ContinuousUrdfJoint" for cls in types_of(self.normalizer.graph[joint]))
        if is_continuous or joint_type not in (JointType.REVOLUTE, JointType.PRISMATIC):
            return None
        lower, upper = (next(self._numbers(joint, *properties), None) for properties in _LIMITS)
        if lower is None or upper is None:
            missing = JOINT_VALUES[0] if lower is None else JOINT_VALUES[1]
            self.normalizer.warn(joint, missing, "it has no valid limit", "it may move without limits")
            return None
        return self.normalizer.ordered_limits(joint, JOINT_VALUES[0], lower, upper)

    # -- values --------------------------------------------------------------------------------------------------------

    def _texts(self, individual: Iri, *properties: Iri) -> Iterator[str]:
        texts: Iterable[str | None] = map(codecs.literal_text, self.normalizer.values(individual, *properties))
        return (text for text in texts if text)

    def _numbers(self, individual: Iri, *properties: Iri) -> Iterator[float]:
        numbers = map(codecs.parse_number, self._texts(individual, *properties))
        return (number for number in numbers if number is not None)
