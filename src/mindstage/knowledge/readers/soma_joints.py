"""SOMA's joints: things without a name on their parent link, whose classes say what they do and how far."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.joint_frames import JointLimits, JointRange, JointType, joint_from_axis
from mindstage.knowledge.readers.likely_joints import ObservedBox, infer_hinge_axis, infer_prismatic_axis
from mindstage.knowledge.readers.numbers import NumberReader
from mindstage.knowledge.readers.rewording import DialectNormalizer, abbreviated_names
from mindstage.knowledge.readers.soma_nodes import RdfNode, RdfNodes
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.other_words import HAS_JOINT, TO_PARTS, soma, urdf
from mindstage.knowledge.vocabulary import HAS_LINEAR, HAS_VALUE, ON_PROPERTY, SUBCLASS_OF
from mindstage.world import Iri, IriRef
from mindstage.world.geometry import Array, normalized_pose_array, quat_rotate

__all__ = ["add_joints"]

_JOINT_TYPES = {
    "PrismaticJoint": JointType.PRISMATIC,
    "RevoluteJoint": JointType.REVOLUTE,
    "HingedJoint": JointType.REVOLUTE,
    "HingeJoint": JointType.REVOLUTE,
    "ContinuousJoint": JointType.REVOLUTE,
    "FixedJoint": JointType.FIXED,
    "FloatingJoint": JointType.FLOATING,
    "PlanarJoint": JointType.PLANAR,
}
_CONTINUOUS = "ContinuousJoint"
_PARENT_LINK, _CHILD_LINK = (urdf("hasParentLink"), soma("hasParentLink")), (urdf("hasChildLink"), soma("hasChildLink"))
_LIMITS = (urdf("hasJointLimits"), soma("hasJointLimit"), soma("hasJointLimits"))
_LOWER = (urdf("hasLowerLimit"), urdf("hasJointPositionMin"), soma("hasJointPositionMin"))
_UPPER = (urdf("hasUpperLimit"), urdf("hasJointPositionMax"), soma("hasJointPositionMax"))
_AXIS = (urdf("hasAxisVector"), urdf("hasJointAxis"), urdf("hasAxis"))
_ORIGIN, _XYZ = urdf("hasOrigin"), (urdf("hasXYZ"), urdf("hasTranslation"))


def add_joints(normalizer: DialectNormalizer, nodes: RdfNodes, number_reader: NumberReader) -> None:
    """Says of every joint what it joins and how."""
    joining = _SomaJointReader(normalizer, nodes, number_reader)
    for owner in list(normalizer.members):
        for value in normalizer.values(owner, HAS_JOINT):
            node = nodes.node_from_value(value)
            if node is None:
                normalizer.warn(owner, HAS_JOINT, "its joint is not described anywhere", "it stays a fact")
            elif not node.has(HAS_LINEAR):
                joining.add_joint(owner, node)
    joining.report_inferred()


class _SomaJointReader:
    """All joints of a map."""

    def __init__(self, normalizer: DialectNormalizer, nodes: RdfNodes, number_reader: NumberReader) -> None:
        self.normalizer, self.nodes, self.number_reader = normalizer, nodes, number_reader
        self.existing_pairs = frozenset(normalizer.joined_pairs)
        self.inferred: dict[str, list[Iri]] = {}
        self._ancestor_cache: dict[tuple[Iri, ...], Sequence[Iri]] = {}

    def add_joint(self, owner: Iri, node: RdfNode) -> None:
        """Says what one joint joins, and how."""
        parent, child = self._referenced_iri(node, _PARENT_LINK) or owner, self._referenced_iri(node, _CHILD_LINK)
        for end, role in ((parent, _PARENT_LINK), (child, _CHILD_LINK)):
            if end not in self.normalizer.poses:
                name = "it" if end is None else end
                what = f"one end of its joint is missing: {name} is no body of this map"
                self.normalizer.warn(owner, role[0], what, "the joint stays a fact")
                return
        assert child is not None
        if parent == child:
            self.normalizer.warn(owner, HAS_JOINT, "its joint joins it to itself", "the joint stays a fact")
            return
        if frozenset((parent, child)) in self.existing_pairs:
            return  # it is told in the words of dialect 1 already
        if frozenset((parent, child)) in self.normalizer.joined_pairs:
            self.normalizer.warn(
                owner, HAS_JOINT, f"a second joint joins it with {local_name(child)}", "it stays a fact"
            )
            return
        kinds = self._class_names(node)
        kind = next((_JOINT_TYPES[name] for name in kinds if name in _JOINT_TYPES), None)
        if kind is None:
            what = f"{', '.join(node.types()) or 'a joint without class'} is no known kind of joint"
            self.normalizer.warn(owner, HAS_JOINT, what, "it holds its two ends together")
        range = (
            self._range(owner, node)
            if kind in (JointType.REVOLUTE, JointType.PRISMATIC) and _CONTINUOUS not in kinds
            else None
        )
        joint = self._joint_limits(node, kind or JointType.FIXED, range, parent, child)
        self.normalizer.add_joint(owner, parent, child, joint, name=node.name)

    def report_inferred(self) -> None:
        """Says aloud what joints do not tell."""
        for what, children in self.inferred.items():
            evidence = f"{len(children)} joints do not tell it, such as those of {abbreviated_names(children)}"
            self.normalizer.source_map.record_assumption(f"joints: {what}", "from where things stand", evidence)

    def _referenced_iri(self, node: RdfNode, properties: Sequence[Iri]) -> Iri | None:
        return next((value.iri for value in node.values(*properties) if isinstance(value, IriRef)), None)

    def _classes(self, node: RdfNode) -> Sequence[Iri]:
        """The classes of a joint, and those above them, the nearest first."""
        types = types_of(node.facts)
        if types not in self._ancestor_cache:
            classes = dict.fromkeys(types)
            for cls in types:
                classes |= dict.fromkeys(self.normalizer.source_map.hierarchy.ancestors(cls))
            self._ancestor_cache[types] = tuple(classes)
        return self._ancestor_cache[types]

    def _class_names(self, node: RdfNode) -> list[str]:
        return [local_name(cls) for cls in self._classes(node)]

    def _range(self, owner: Iri, node: RdfNode) -> JointRange:
        """From the joint itself, or from the nearest of its classes that says it of all its members."""
        for limits in self._limits(node):
            lower, upper = limits.number(*_LOWER), limits.number(*_UPPER)
            if lower is None or upper is None:
                self.normalizer.warn(owner, _LIMITS[0], "its limits are not two finite numbers", "they limit nothing")
                continue
            if lower > upper:
                what = f"its lower limit {lower:g} is above its upper limit {upper:g}"
                self.normalizer.warn(owner, _LOWER[0], what, "the two are taken the other way round")
                lower, upper = upper, lower
            if JointType.PRISMATIC in (_JOINT_TYPES.get(name) for name in self._class_names(node)):
                lower, upper = self.number_reader.lengths((lower, upper))
            return lower, upper
        self.normalizer.warn(owner, _LIMITS[0], "its joint has no limits", "it may move without end")
        return None

    def _limits(self, node: RdfNode) -> list[RdfNode]:
        found = list(self.nodes.descendants(node, *_LIMITS, depth=1))
        for cls in self._classes(node):
            for restriction in self.nodes.descendants(self.nodes.node_named(cls), SUBCLASS_OF, depth=1):
                on = self._referenced_iri(restriction, (ON_PROPERTY,))
                if on in _LIMITS:
                    found += self.nodes.descendants(restriction, HAS_VALUE, depth=1)
        return found

    def _joint_limits(
        self, node: RdfNode, joint_type: JointType, range: JointRange, parent: Iri, child: Iri
    ) -> JointLimits:
        base = self._box(parent)
        origin, axis = self._origin(node, base), self._axis(node, base)
        turns = joint_type in (JointType.REVOLUTE, JointType.PRISMATIC)
        if turns and (axis is None or (origin is None and joint_type is JointType.REVOLUTE)):
            handle = self._find_handle(child)
            if joint_type is JointType.REVOLUTE:
                likely = infer_hinge_axis(base, self._box(child), handle, range, origin=origin)
            else:
                likely = infer_prismatic_axis(base, self._box(child), handle)
            for what, told in (("where they are", origin), ("which way they go", axis)):
                if told is None:
                    self.inferred.setdefault(what, []).append(child)
            origin = likely.origin if origin is None else origin
            axis = likely.axis if axis is None else axis
        origin = self._box(child).center if origin is None else origin
        return joint_from_axis(joint_type, origin, np.array([1.0, 0.0, 0.0]) if axis is None else axis, range)

    def _axis(self, node: RdfNode, base: ObservedBox) -> Array | None:
        """As in a robot's description, told in the frame of the parent link."""
        axis = next((row for each in self._with_axis_nodes(node) if len(row := each.numbers(*_AXIS)) == 3), ())
        if not any(axis):
            return None
        return quat_rotate(normalized_pose_array(base.pose)[3:], self.number_reader.direction(axis))

    def _origin(self, node: RdfNode, base: ObservedBox) -> Array | None:
        row = next((row for each in self.nodes.descendants(node, _ORIGIN) if len(row := each.numbers(*_XYZ)) == 3), ())
        if not row:
            return None
        way = self.number_reader.direction(self.number_reader.lengths(row))
        return base.center + quat_rotate(normalized_pose_array(base.pose)[3:], way)

    def _with_axis_nodes(self, node: RdfNode) -> list[RdfNode]:
        return [node, *self.nodes.descendants(node, *_AXIS, depth=1)]

    def _box(self, body: Iri) -> ObservedBox:
        return ObservedBox(self.normalizer.poses[body], self.normalizer.sizes.get(body))

    def _find_handle(self, child: Iri) -> ObservedBox | None:
        """The part of a child that it is likely pulled by."""
        parts = [part for part in self.normalizer.references(child, *TO_PARTS) if part in self.normalizer.poses]
        parts.sort(key=lambda part: not self.normalizer.class_name_contains(part, "Handle"))
        return self._box(parts[0]) if parts else None
