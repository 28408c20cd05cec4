"""Dialect 3, AMEVA maps: the vocabulary of dialect 1 in other units, with joints that have neither axes nor limits.

Units, handedness and quaternion order are inferred (see `infer_conventions`). Values that a class gives for all its
members are copied to the members. All statements of the source are kept.

A joint in these maps is an individual of the class LinearJoint or RevoluteJoint with a pose. It is a child of the body
that it moves, which is a child of the body that it moves relative to. Axis and range are inferred from the poses and
sizes of these bodies: a drawer slides along the joint's x axis, at most by its own depth; a door turns about the edge
at which the joint is located, at most by a right angle; a body with the joint at its center is a knob and turns about
its thinnest axis without limits; every other body turns about the vertical. Drawers and doors only open outwards where
their handle, their casing, or the other doors and drawers of that casing show the front; otherwise both ways.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mindstage.maps.dialects.body_boxes import with_body_boxes
from mindstage.maps.dialects.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.maps.dialects.joint_ends import DescribedEnd, order_of_ends
from mindstage.maps.dialects.joints import OPEN_ANGLE_RAD, HingeEvidence, InferredAxis, infer_hinge_axis
from mindstage.maps.dialects.membership import pose_facts, references, types_of
from mindstage.maps.dialects.semlog import read_semlog, with_tag_properties
from mindstage.maps.dialects.source_map import Dialect, SourceMap, ignore_finding
from mindstage.maps.dialects.unit_conversion import convert_source_map, is_converted, original_property
from mindstage.maps.dialects.units import infer_conventions
from mindstage.maps.rdf_mapping.fields import ClassGeometry
from mindstage.maps.rdf_mapping.nested import NESTED_ANGULAR_LIMITS, NESTED_LINEAR_LIMITS, NestedResource
from mindstage.maps.rdf_mapping.properties import MASS, QUATERNION, TRANSLATION, SubjectWriter
from mindstage.rdf.graphs import Severity, local_name, part_name
from mindstage.rdf.vocabulary import (
    ASSUMED,
    CHILD,
    CONSTRAINT,
    EQUIVALENT_CLASS,
    HAS_ANGULAR,
    HAS_LINEAR,
    HAS_VALUE,
    JOINT_CLASSES,
    LINEAR_JOINT,
    NAMED_INDIVIDUAL,
    ON_PROPERTY,
    PARENT,
    SUBCLASS_OF,
    TYPE,
    knowrob,
)
from mindstage.scene import (
    AngularLimits,
    AxisMotion,
    BlankNode,
    Iri,
    IriRef,
    LinearLimits,
    Literal,
    Pose,
    PropertyAssertion,
    Vector,
    World,
)
from mindstage.scene.joint_kinematics import FrontSide, ObservedBox, front_side, is_handle_class
from mindstage.scene.transforms import Array

__all__ = ["AMEVA", "AMEVA_DIALECT", "add_joint_definitions", "is_ameva", "read_ameva"]


_CENTER_TOLERANCE = 0.1
"""Offset from the center, as a fraction of the half extent, below which a joint counts as centered."""
_MIN_FURNITURE_M = 0.2
"""Largest extent from which a body without a handle counts as a door, a drawer or a rack [m]."""
_PANEL_RATIO = 0.4
"""A panel (a door) is thinner than this fraction of its shorter side."""


AMEVA_DIALECT = "AMEVA"
AMEVA_DEFAULTS = UnitConventions(units=LengthUnit.CENTIMETERS, frame=Handedness.UNREAL, quaternion=QuaternionOrder.XYZW)
_DISTINCTIVE_PROPERTIES = frozenset({knowrob("maskColor"), knowrob("levelName")})


def add_joint_definitions(source_map: SourceMap) -> SourceMap:
    """Returns the map with its joints described in the vocabulary of dialect 1: both bodies, axis and limits."""
    joints = [iri for iri in source_map.members if JOINT_CLASSES.intersection(types_of(source_map.graph[iri]))]
    if not joints:
        return source_map
    reader = _AmevaJointReader(source_map)
    for joint in joints:
        reader.add_joint(joint)
    evidence = f"{len(joints)} joints give neither; they are inferred from the poses and sizes of the bodies"
    source_map.record_assumption("joints", "axes and limits", evidence)
    return replace(source_map, graph=reader.graph)


class _AmevaJointReader:
    def __init__(self, source_map: SourceMap) -> None:
        self.source_map = source_map
        self.graph: dict[Iri, Sequence[PropertyAssertion]] = dict(source_map.graph)
        self.sizes = ClassGeometry([source_map.graph, *source_map.ontologies], source_map.hierarchy, ignore_finding)
        self.parents = _parents(source_map)
        self.children: dict[Iri, list[Iri]] = {}
        for each, parent in self.parents.items():
            if each in source_map.graph:
                self.children.setdefault(parent, []).append(each)
        self.joined_pairs: set[tuple[Iri, Iri]] = set()
        """Pairs (parent, child) that already have a joint."""

    def add_joint(self, joint: Iri) -> None:
        """Adds the bodies that a joint connects and its motion, where the map does not give them."""
        facts = self.graph[joint]
        given = {fact.property for fact in facts}
        self._add(joint, PropertyAssertion(TYPE, IriRef(CONSTRAINT)))
        ends = references(facts, PARENT), references(facts, CHILD)
        if ends[0] and ends[1]:
            base, moving = ends[0][0], ends[1][0]
        else:
            moving = next(iter(ends[0] or ends[1]), self.parents.get(joint, joint))
            base = self.parents.get(moving, joint)
            if joint in (base, moving):
                return  # the SemLog reader omits a joint without both bodies and reports it
            self._preserve_as_original(joint, PARENT, moving)
            self._preserve_as_original(joint, CHILD, moving)
            self._preserve_as_original(moving, CHILD, joint)
            self._preserve_as_original(moving, PARENT, joint)
            self._add(joint, PropertyAssertion(PARENT, IriRef(base)), PropertyAssertion(CHILD, IriRef(moving)))
        if HAS_LINEAR not in given and HAS_ANGULAR not in given:
            base, moving = self._ordered(joint, base, moving)
        self._preserve_as_original(moving, PARENT, base)
        self._preserve_as_original(base, CHILD, moving)
        if HAS_LINEAR in given or HAS_ANGULAR in given:
            return
        linear, angular, motion = self._infer_motion(joint, base, moving)
        self._add(joint, PropertyAssertion(ASSUMED, Literal("axis limits")))
        self._add_nested(joint, NESTED_LINEAR_LIMITS, linear)
        self._add_nested(joint, NESTED_ANGULAR_LIMITS, angular)
        self.source_map.report(
            Severity.WARNING,
            joint,
            HAS_LINEAR,
            "the joint gives neither an axis nor limits",
            f"{local_name(moving)} {motion}",
        )

    def _ordered(self, joint: Iri, base: Iri, moving: Iri) -> tuple[Iri, Iri]:
        """Returns the end of a joint that holds and the one that moves; the map may name them the other way round."""
        order = order_of_ends(self._end(base), self._end(moving, is_child=True))
        ends = (base, moving) if order.is_second else (moving, base)
        if order.problem:
            self.source_map.report(Severity.WARNING, joint, CHILD, order.problem, f"{local_name(ends[1])} moves")
        if not order.is_second:
            self._preserve_as_original(joint, PARENT, base)
            self._preserve_as_original(joint, CHILD, moving)
            self._preserve_as_original(base, PARENT, moving)
            self._preserve_as_original(moving, CHILD, base)
            self._add(joint, PropertyAssertion(PARENT, IriRef(moving)), PropertyAssertion(CHILD, IriRef(base)))
        return ends

    def _end(self, body: Iri, *, is_child: bool = False) -> DescribedEnd:
        types = types_of(self.graph.get(body, ()))
        above = [upper for cls in types for upper in self.source_map.hierarchy.ancestors(cls)]
        box = self._observe(body)
        return DescribedEnd(
            name=local_name(body),
            class_names=[local_name(cls) for cls in (*types, *above)],
            has_handle=self._handle(body) is not None,
            is_child=is_child,
            volume=None if box is None or box.size is None else float(np.prod(box.size)),
        )

    def _infer_motion(self, joint: Iri, parent: Iri, child: Iri) -> tuple[LinearLimits, AngularLimits, str]:
        free = AxisMotion.FREE
        if (parent, child) in self.joined_pairs:
            note = "already has another joint, so this joint leaves it free"
            return LinearLimits(x=free, y=free, z=free), AngularLimits(swing1=free, swing2=free, twist=free), note
        self.joined_pairs.add((parent, child))
        frame, body = self._observe(joint), self._observe(child)
        if LINEAR_JOINT in types_of(self.graph[joint]):
            limit = _slide_limit(body, frame)
            rail = np.array([1.0, 0.0, 0.0]) if frame is None else frame.axis(0)
            front = self._front_along(parent, child, rail)
            if front is None:
                note = f"slides along the joint's x axis by at most {limit:.3g} m either way"
                return LinearLimits(x=AxisMotion.LIMITED, limit=limit), AngularLimits(), note
            note = f"slides out along the joint's x axis by at most {limit:.3g} m: {front.evidence}"
            middle = front.sign * limit / 2
            return LinearLimits(x=AxisMotion.LIMITED, limit=limit / 2, x_middle=middle), AngularLimits(), note
        inferred, limited = self._infer_hinge(parent, child, frame, body)
        number = 2 if frame is None else int(np.argmax(np.abs(frame.axes @ inferred.axis)))
        motion, limit, middle, how = free, 0.0, 0.0, "without limits"
        if limited and inferred.opens:
            reverse = frame is not None and float(frame.axis(number) @ inferred.axis) < 0.0
            middle, limit = (-1 if reverse else 1) * inferred.opens * OPEN_ANGLE_RAD / 2, OPEN_ANGLE_RAD / 2
            motion, how = AxisMotion.LIMITED, f"outwards by at most a right angle: {inferred.evidence}"
        elif limited:
            motion, limit, how = AxisMotion.LIMITED, OPEN_ANGLE_RAD, "by at most a right angle either way"
        angular = (
            AngularLimits(twist=motion, twist_limit=limit, twist_middle=middle),
            AngularLimits(swing2=motion, swing2_limit=limit, swing2_middle=middle),
            AngularLimits(swing1=motion, swing1_limit=limit, swing1_middle=middle),
        )[number]
        return LinearLimits(), angular, f"turns about the joint's {'xyz'[number]} axis {how}"

    def _infer_hinge(
        self, parent: Iri, child: Iri, frame: ObservedBox | None, body: ObservedBox | None
    ) -> tuple[InferredAxis, bool]:
        """Returns the axis that a body turns about, and whether its range is limited."""
        up = InferredAxis(np.zeros(3), np.array([0.0, 0.0, 1.0]), "")
        if body is None or body.size is None or frame is None:
            return up, True
        half = body.half_extents
        thin, short, _ = (int(number) for number in np.argsort(half))
        if np.abs(body.local_center_of(frame) / half).max() < _CENTER_TOLERANCE:
            return up._replace(axis=body.axis(thin)), False
        if half[thin] >= _PANEL_RATIO * half[short]:
            return up, True
        inferred, _ = infer_hinge_axis(
            HingeEvidence(
                parent=self._observe(parent) or body,
                child=body,
                handle=self._handle(child),
                origin=frame.center,
                class_names=[local_name(cls) for each in (parent, child) for cls in types_of(self.graph[each])],
            )
        )
        if not inferred.opens and (front := self._front_along(parent, child, body.axis(thin))) is not None:
            opening = np.cross(inferred.axis, body.center - frame.center) @ body.axis(thin)
            inferred = inferred._replace(opens=int(np.sign(opening)) * front.sign, evidence=front.evidence)
        return inferred, True

    def _front_along(self, parent: Iri, child: Iri, direction: Array) -> FrontSide | None:
        """Returns which way along a direction a body faces: by itself, otherwise as its neighbors in the casing do."""
        casing = self._observe(parent)
        body = self._observe(child)
        handle = self._handle(child)
        if body is None or (handle is None and body.half_extents.max() < _MIN_FURNITURE_M / 2):
            return None  # a slider or a switch within its casing has no front
        if front := front_side(body, casing, handle, direction):
            return front
        votes = [
            found.sign
            for sibling in self.children.get(parent, ())
            if sibling != child and (box := self._observe(sibling)) is not None and self._is_moved(sibling)
            if (found := front_side(box, casing, self._handle(sibling), direction)) is not None
        ]
        if not votes or abs(sum(votes)) <= len(votes) / 2:
            return None
        evidence = f"{len(votes)} other doors and drawers of {local_name(parent)} face that side"
        return FrontSide(int(np.sign(sum(votes))), evidence)

    def _is_moved(self, body: Iri) -> bool:
        """Whether a joint belongs to a body."""
        return any(JOINT_CLASSES.intersection(types_of(self.graph[each])) for each in self.children.get(body, ()))

    def _handle(self, body: Iri) -> ObservedBox | None:
        """Returns the handle of a body, if it has one."""
        for child in self.children.get(body, ()):
            if any(is_handle_class(cls) for cls in types_of(self.graph[child])):
                return self._observe(child)
        return None

    # -- reading -------------------------------------------------------------------------------------------------------

    def _observe(self, iri: Iri) -> ObservedBox | None:
        facts = self.graph.get(iri, ())
        pose = pose_facts(self.graph, facts) or ()
        position, quaternion = TRANSLATION.first_value(pose), QUATERNION.first_value(pose)
        if position is None or quaternion is None:
            return None
        (x, y, z), (w, i, j, k) = position, quaternion
        return ObservedBox(Pose((x, y, z), (w, i, j, k)), self._size(facts))

    def _size(self, facts: Sequence[PropertyAssertion]) -> Vector | None:
        depth, width, height = self.sizes.of(facts, types_of(facts))
        return None if depth is None or width is None or height is None else (depth, width, height)

    # -- writing -------------------------------------------------------------------------------------------------------

    def _add(self, iri: Iri, *facts: PropertyAssertion) -> None:
        self.graph[iri] = [*self.graph[iri], *(fact for fact in facts if fact not in self.graph[iri])]

    def _preserve_as_original(self, iri: Iri, property: Iri, other: Iri) -> None:
        """Renames a statement's property to its `original_property`, since dialect 1 reads it as a rigid attachment."""
        old, new = (
            PropertyAssertion(property, IriRef(other)),
            PropertyAssertion(original_property(property), IriRef(other)),
        )
        self.graph[iri] = [new if fact == old else fact for fact in self.graph.get(iri, ())]

    def _add_nested(
        self, owner: Iri, nested_resource: NestedResource[Any], value: LinearLimits | AngularLimits
    ) -> None:
        name = part_name(owner, nested_resource.suffix, self.graph)
        writer = SubjectWriter(name)
        writer.add_reference(TYPE, NAMED_INDIVIDUAL)
        writer.add_reference(TYPE, nested_resource.cls)
        nested_resource.write(writer, value)
        self.graph[name] = writer.all_facts()
        self._add(owner, PropertyAssertion(nested_resource.property, IriRef(name)))


def _slide_limit(body: ObservedBox | None, frame: ObservedBox | None) -> float:
    """Returns the distance that a body can slide [m]: its extent along the joint's x axis."""
    if body is None or body.size is None:
        return 0.0
    return 2 * body.half_extent_along(np.array([1.0, 0.0, 0.0]) if frame is None else frame.axis(0))


def _parents(source_map: SourceMap) -> Mapping[Iri, Iri]:
    """Returns the parent of each child; the first one given counts."""
    members = set(source_map.members)
    parents: dict[Iri, Iri] = {}
    for iri in source_map.members:
        for other in references(source_map.graph[iri], PARENT):
            if other in members:
                parents.setdefault(iri, other)
    for iri in source_map.members:
        for other in references(source_map.graph[iri], CHILD):
            parents.setdefault(other, iri)
    return parents


def is_ameva(source_map: SourceMap) -> bool:
    """Whether a map is written in this dialect and has not been converted to dialect 1 by Mindstage."""
    if is_converted(source_map):
        return False
    classes: set[Iri] = set()
    for iri in (source_map.map, *source_map.members):
        for fact in source_map.graph.get(iri, ()):
            if fact.property in _DISTINCTIVE_PROPERTIES:
                return True
            if fact.property == TYPE and isinstance(fact.value, IriRef):
                classes.add(fact.value.iri)
    values = (fact for cls in classes for fact in _class_values(source_map.graph.get(cls, ())))
    return not JOINT_CLASSES.isdisjoint(classes) or any(fact.property == MASS.property for fact in values)


def read_ameva(source_map: SourceMap) -> World:
    """Reads an AMEVA map."""
    conventions = infer_conventions(source_map, AMEVA_DEFAULTS)
    source_map = with_body_boxes(convert_source_map(source_map, conventions, dialect=AMEVA_DIALECT), conventions)
    return read_semlog(add_joint_definitions(with_tag_properties(_with_class_values(source_map))))


def _with_class_values(source_map: SourceMap) -> SourceMap:
    """Returns the map with the masses that classes give copied to their members; that of a member takes precedence."""
    by_class: dict[Iri, dict[Iri, PropertyAssertion]] = {}
    members = set(source_map.members)
    for cls, facts in source_map.graph.items():
        for fact in _class_values(facts) if cls not in members else ():
            if fact.property == MASS.property:
                by_class.setdefault(cls, {}).setdefault(fact.property, fact)
    if not by_class:
        return source_map
    graph = dict(source_map.graph)
    for member in source_map.members:
        facts = graph[member]
        types = types_of(facts)
        above = (cls for level in source_map.hierarchy.levels(types) for cls in level)
        inherited: dict[Iri, PropertyAssertion] = {}
        for cls in above:
            inherited = {**by_class.get(cls, {}), **inherited}
        own = {fact.property for fact in facts}
        graph[member] = [*facts, *(fact for property, fact in inherited.items() if property not in own)]
    return replace(source_map, graph=graph)


def _class_values(facts: Sequence[PropertyAssertion]) -> Iterator[PropertyAssertion]:
    """Yields the values that a class gives for its members, directly or by an `owl:hasValue` restriction."""
    for fact in facts:
        if fact.property in (SUBCLASS_OF, EQUIVALENT_CLASS) and isinstance(fact.value, BlankNode):
            inner = fact.value.facts
            on = references(inner, ON_PROPERTY)
            yield from (PropertyAssertion(on[0], each.value) for each in inner if each.property == HAS_VALUE and on)
        elif fact.property == MASS.property:
            yield fact


AMEVA = Dialect(AMEVA_DIALECT, is_ameva, read_ameva, order=30)
