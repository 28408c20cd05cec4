"""SOMA's joints: things without a name on their parent link, whose classes say what they do and how far."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.joint_frames import Joint, JointKind, Range, joint_along
from mindstage.knowledge.readers.likely_joints import Box, likely_hinge, likely_slide
from mindstage.knowledge.readers.numbers import Numbers
from mindstage.knowledge.readers.rewording import Rewording, few
from mindstage.knowledge.readers.soma_nodes import Node, Nodes
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.other_words import HAS_JOINT, TO_PARTS, soma, urdf
from mindstage.knowledge.vocabulary import HAS_LINEAR, HAS_VALUE, ON_PROPERTY, SUBCLASS_OF
from mindstage.world import Iri, Reference
from mindstage.world.geometry import Array, rotate, unit_pose

__all__ = ["join_all"]

_KINDS = {
    "PrismaticJoint": JointKind.SLIDE,
    "RevoluteJoint": JointKind.HINGE,
    "HingedJoint": JointKind.HINGE,
    "HingeJoint": JointKind.HINGE,
    "ContinuousJoint": JointKind.HINGE,
    "FixedJoint": JointKind.FIXED,
    "FloatingJoint": JointKind.FLOATING,
    "PlanarJoint": JointKind.PLANAR,
}
_ENDLESS = "ContinuousJoint"
_PARENT_LINK, _CHILD_LINK = (urdf("hasParentLink"), soma("hasParentLink")), (urdf("hasChildLink"), soma("hasChildLink"))
_LIMITS = (urdf("hasJointLimits"), soma("hasJointLimit"), soma("hasJointLimits"))
_LOWER = (urdf("hasLowerLimit"), urdf("hasJointPositionMin"), soma("hasJointPositionMin"))
_UPPER = (urdf("hasUpperLimit"), urdf("hasJointPositionMax"), soma("hasJointPositionMax"))
_AXIS = (urdf("hasAxisVector"), urdf("hasJointAxis"), urdf("hasAxis"))
_ORIGIN, _XYZ = urdf("hasOrigin"), (urdf("hasXYZ"), urdf("hasTranslation"))


def join_all(rewording: Rewording, nodes: Nodes, numbers: Numbers) -> None:
    """Says of every joint what it joins and how."""
    joining = _Joining(rewording, nodes, numbers)
    for owner in list(rewording.members):
        for value in rewording.values(owner, HAS_JOINT):
            node = nodes.node(value)
            if node is None:
                rewording.warn(owner, HAS_JOINT, "its joint is not described anywhere", "it stays a fact")
            elif not node.told(HAS_LINEAR):
                joining.join(owner, node)
    joining.say_what_was_guessed()


class _Joining:
    """All joints of a map."""

    def __init__(self, rewording: Rewording, nodes: Nodes, numbers: Numbers) -> None:
        self.rewording, self.nodes, self.numbers = rewording, nodes, numbers
        self.known = frozenset(rewording.joined)
        self.guessed: dict[str, list[Iri]] = {}
        self._above: dict[tuple[Iri, ...], Sequence[Iri]] = {}

    def join(self, owner: Iri, node: Node) -> None:
        """Says what one joint joins, and how."""
        parent, child = self._end(node, _PARENT_LINK) or owner, self._end(node, _CHILD_LINK)
        for end, role in ((parent, _PARENT_LINK), (child, _CHILD_LINK)):
            if end not in self.rewording.poses:
                name = "it" if end is None else end
                what = f"one end of its joint is missing: {name} is no body of this map"
                self.rewording.warn(owner, role[0], what, "the joint stays a fact")
                return
        assert child is not None
        if parent == child:
            self.rewording.warn(owner, HAS_JOINT, "its joint joins it to itself", "the joint stays a fact")
            return
        if frozenset((parent, child)) in self.known:
            return  # it is told in the words of dialect 1 already
        if frozenset((parent, child)) in self.rewording.joined:
            self.rewording.warn(
                owner, HAS_JOINT, f"a second joint joins it with {local_name(child)}", "it stays a fact"
            )
            return
        kinds = self._kinds(node)
        kind = next((_KINDS[name] for name in kinds if name in _KINDS), None)
        if kind is None:
            what = f"{', '.join(node.types()) or 'a joint without class'} is no known kind of joint"
            self.rewording.warn(owner, HAS_JOINT, what, "it holds its two ends together")
        range = (
            self._range(owner, node) if kind in (JointKind.HINGE, JointKind.SLIDE) and _ENDLESS not in kinds else None
        )
        joint = self._joint(node, kind or JointKind.FIXED, range, parent, child)
        self.rewording.join(owner, parent, child, joint, name=node.name)

    def say_what_was_guessed(self) -> None:
        """Says aloud what joints do not tell."""
        for what, children in self.guessed.items():
            evidence = f"{len(children)} joints do not tell it, such as those of {few(children)}"
            self.rewording.excerpt.assume(f"joints: {what}", "from where things stand", evidence)

    def _end(self, node: Node, properties: Sequence[Iri]) -> Iri | None:
        return next((value.iri for value in node.values(*properties) if isinstance(value, Reference)), None)

    def _classes(self, node: Node) -> Sequence[Iri]:
        """The classes of a joint, and those above them, the nearest first."""
        types = types_of(node.facts)
        if types not in self._above:
            classes = dict.fromkeys(types)
            for cls in types:
                classes |= dict.fromkeys(self.rewording.excerpt.hierarchy.ancestors(cls))
            self._above[types] = tuple(classes)
        return self._above[types]

    def _kinds(self, node: Node) -> list[str]:
        return [local_name(cls) for cls in self._classes(node)]

    def _range(self, owner: Iri, node: Node) -> Range:
        """From the joint itself, or from the nearest of its classes that says it of all its members."""
        for limits in self._limits(node):
            lower, upper = limits.number(*_LOWER), limits.number(*_UPPER)
            if lower is None or upper is None:
                self.rewording.warn(owner, _LIMITS[0], "its limits are not two finite numbers", "they limit nothing")
                continue
            if lower > upper:
                what = f"its lower limit {lower:g} is above its upper limit {upper:g}"
                self.rewording.warn(owner, _LOWER[0], what, "the two are taken the other way round")
                lower, upper = upper, lower
            if JointKind.SLIDE in (_KINDS.get(name) for name in self._kinds(node)):
                lower, upper = self.numbers.lengths((lower, upper))
            return lower, upper
        self.rewording.warn(owner, _LIMITS[0], "its joint has no limits", "it may move without end")
        return None

    def _limits(self, node: Node) -> list[Node]:
        found = list(self.nodes.below(node, *_LIMITS, depth=1))
        for cls in self._classes(node):
            for restriction in self.nodes.below(self.nodes.of(cls), SUBCLASS_OF, depth=1):
                on = self._end(restriction, (ON_PROPERTY,))
                if on in _LIMITS:
                    found += self.nodes.below(restriction, HAS_VALUE, depth=1)
        return found

    def _joint(self, node: Node, kind: JointKind, range: Range, parent: Iri, child: Iri) -> Joint:
        base = self._box(parent)
        origin, axis = self._origin(node, base), self._axis(node, base)
        turns = kind in (JointKind.HINGE, JointKind.SLIDE)
        if turns and (axis is None or (origin is None and kind is JointKind.HINGE)):
            handle = self._handle(child)
            if kind is JointKind.HINGE:
                likely = likely_hinge(base, self._box(child), handle, range, origin=origin)
            else:
                likely = likely_slide(base, self._box(child), handle)
            for what, told in (("where they are", origin), ("which way they go", axis)):
                if told is None:
                    self.guessed.setdefault(what, []).append(child)
            origin = likely.origin if origin is None else origin
            axis = likely.axis if axis is None else axis
        origin = self._box(child).centre if origin is None else origin
        return joint_along(kind, origin, np.array([1.0, 0.0, 0.0]) if axis is None else axis, range)

    def _axis(self, node: Node, base: Box) -> Array | None:
        """As in a robot's description, told in the frame of the parent link."""
        axis = next((row for each in self._with_own_nodes(node) if len(row := each.numbers(*_AXIS)) == 3), ())
        if not any(axis):
            return None
        return rotate(unit_pose(base.pose)[3:], self.numbers.direction(axis))

    def _origin(self, node: Node, base: Box) -> Array | None:
        row = next((row for each in self.nodes.below(node, _ORIGIN) if len(row := each.numbers(*_XYZ)) == 3), ())
        if not row:
            return None
        way = self.numbers.direction(self.numbers.lengths(row))
        return base.centre + rotate(unit_pose(base.pose)[3:], way)

    def _with_own_nodes(self, node: Node) -> list[Node]:
        return [node, *self.nodes.below(node, *_AXIS, depth=1)]

    def _box(self, body: Iri) -> Box:
        return Box(self.rewording.poses[body], self.rewording.sizes.get(body))

    def _handle(self, child: Iri) -> Box | None:
        """The part of a child that it is likely pulled by."""
        parts = [part for part in self.rewording.references(child, *TO_PARTS) if part in self.rewording.poses]
        parts.sort(key=lambda part: not self.rewording.is_called(part, "Handle"))
        return self._box(parts[0]) if parts else None
