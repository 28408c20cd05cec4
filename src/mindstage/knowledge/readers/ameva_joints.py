"""AMEVA's joints: what hangs on one, on which axis it moves, and how far.

A joint there is a thing of its own that hangs on the body it moves, which hangs on the body it moves in. It has a
pose and a class, LinearJoint or RevoluteJoint, and says nothing else. Drawers come out along the joint's x axis, at
most by their own depth; a door turns about the edge that the joint is at, at most by a right angle; what has its joint
in its middle is a knob and turns about its thinnest side's axis without end; all else turns upright.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mindstage.knowledge.findings import Severity
from mindstage.knowledge.names import local_name, part_name
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.conversion import given
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    HAS_ANGULAR,
    HAS_LINEAR,
    HAS_POSE,
    JOINT_CLASSES,
    LINEAR_JOINT,
    NAMED_INDIVIDUAL,
    PARENT,
    TYPE,
)
from mindstage.knowledge.wording.parts import ANGULAR_PART, LINEAR_PART, Part
from mindstage.knowledge.wording.sizes import ClassSizes
from mindstage.knowledge.wording.statements import Said
from mindstage.knowledge.wording.words import QUATERNION, SIZE, TRANSLATION
from mindstage.world import AngularMotion, Anonymous, Fact, Iri, LinearMotion, Motion, Pose, Reference
from mindstage.world.geometry import Array, rotation_matrix, unit_pose

__all__ = ["with_joints"]

_CENTRED = 0.1
"""What is off the middle by less than this part of half the extent is in the middle."""
_PANEL = 0.4
"""A door is thinner than this part of its shorter side."""
_RIGHT_ANGLE = math.pi / 2


@dataclass(frozen=True, slots=True)
class _Told:
    """Where something is, and how large, as far as the map says."""

    pose: Array
    size: Array | None

    @property
    def axes(self) -> Array:
        """In columns."""
        return rotation_matrix(self.pose[3:])


def with_joints(excerpt: Excerpt) -> Excerpt:
    """The excerpt, whose joints say in dialect 1's words what they join and how it moves."""
    joints = [iri for iri in excerpt.members if JOINT_CLASSES.intersection(types_of(excerpt.graph[iri]))]
    if not joints:
        return excerpt
    joining = _Joining(excerpt)
    for joint in joints:
        joining.join(joint)
    evidence = f"{len(joints)} joints tell neither; bodies' sizes and where the joints are do"
    excerpt.assume("joints", "axes and limits", evidence)
    return replace(excerpt, graph=joining.graph)


class _Joining:
    def __init__(self, excerpt: Excerpt) -> None:
        self.excerpt = excerpt
        self.graph: dict[Iri, Sequence[Fact]] = dict(excerpt.graph)
        self.sizes = ClassSizes([excerpt.graph, *excerpt.background], excerpt.hierarchy, _silent)
        self.parents = _parents(excerpt)
        self.free: set[tuple[Iri, Iri]] = set()
        """Pairs that a joint joins already."""

    def join(self, joint: Iri) -> None:
        """Says what a joint joins, unless it says so itself; and how, unless it says that."""
        facts = self.graph[joint]
        told = {fact.property for fact in facts}
        self._add(joint, Fact(TYPE, Reference(CONSTRAINT)))
        ends = _named(facts, PARENT), _named(facts, CHILD)
        if ends[0] and ends[1]:
            base, moving = ends[0][0], ends[1][0]
        else:
            moving = next(iter(ends[0] or ends[1]), self.parents.get(joint, joint))
            base = self.parents.get(moving, joint)
            if joint in (base, moving):
                return  # it is left out, for want of an end, by whoever makes the world
            self._rename(joint, PARENT, moving)
            self._rename(joint, CHILD, moving)
            self._rename(moving, CHILD, joint)
            self._rename(moving, PARENT, joint)
            self._add(joint, Fact(PARENT, Reference(base)), Fact(CHILD, Reference(moving)))
        self._rename(moving, PARENT, base)
        self._rename(base, CHILD, moving)
        if HAS_LINEAR in told or HAS_ANGULAR in told:
            return
        linear, angular, what = self._motion(joint, base, moving)
        self._part(joint, LINEAR_PART, linear)
        self._part(joint, ANGULAR_PART, angular)
        self.excerpt.report(
            Severity.WARNING,
            joint,
            HAS_LINEAR,
            "the joint tells neither an axis nor limits",
            f"{local_name(moving)} {what}",
        )

    def _motion(self, joint: Iri, base: Iri, moving: Iri) -> tuple[LinearMotion, AngularMotion, str]:
        free = Motion.FREE
        if (base, moving) in self.free:
            what = "hangs on another joint already, so that this one lets it move as it may"
            return LinearMotion(x=free, y=free, z=free), AngularMotion(swing1=free, swing2=free, twist=free), what
        self.free.add((base, moving))
        frame, body = self._told(joint), self._told(moving)
        if LINEAR_JOINT in types_of(self.graph[joint]):
            limit = _reach(body, frame)
            what = f"slides along the joint's x axis by at most {limit:.3g} m either way"
            return LinearMotion(x=Motion.LIMITED, limit=limit), AngularMotion(), what
        axis, limited = _hinge(body, frame)
        number = 2 if frame is None else int(np.argmax(np.abs(frame.axes.T @ axis)))
        motion, limit = (Motion.LIMITED, _RIGHT_ANGLE) if limited else (free, 0.0)
        angular = (
            AngularMotion(twist=motion, twist_limit=limit),
            AngularMotion(swing2=motion, swing2_limit=limit),
            AngularMotion(swing1=motion, swing1_limit=limit),
        )[number]
        how = "by at most a right angle either way" if limited else "without end"
        return LinearMotion(), angular, f"turns about the joint's {'xyz'[number]} axis {how}"

    # -- what the map tells --------------------------------------------------------------------------------------------

    def _told(self, iri: Iri) -> _Told | None:
        facts = self.graph.get(iri, ())
        for fact in facts:
            if fact.property != HAS_POSE:
                continue
            inner: Sequence[Fact] = ()
            if isinstance(fact.value, Reference):
                inner = self.graph.get(fact.value.iri, ())
            elif isinstance(fact.value, Anonymous):
                inner = fact.value.facts
            position, quaternion = TRANSLATION.first(inner), QUATERNION.first(inner)
            if position and quaternion:
                (x, y, z), (w, i, j, k) = position, quaternion
                return _Told(unit_pose(Pose((x, y, z), (w, i, j, k))), self._size(facts))
        return None

    def _size(self, facts: Sequence[Fact]) -> Array | None:
        inherited = self.sizes.of(types_of(facts))
        own = [word.first(facts) for word in SIZE]
        size = [of_class if told is None else told for told, of_class in zip(own, inherited, strict=True)]
        return None if None in size else np.array(size, dtype=np.float64)

    # -- what is said --------------------------------------------------------------------------------------------------

    def _add(self, iri: Iri, *facts: Fact) -> None:
        self.graph[iri] = [*self.graph[iri], *(fact for fact in facts if fact not in self.graph[iri])]

    def _rename(self, iri: Iri, property: Iri, other: Iri) -> None:
        """Keeps a statement under another name, since in dialect 1 it would mean that the two cannot move."""
        old, new = Fact(property, Reference(other)), Fact(given(property), Reference(other))
        self.graph[iri] = [new if fact == old else fact for fact in self.graph.get(iri, ())]

    def _part(self, whole: Iri, part: Part[Any], value: LinearMotion | AngularMotion) -> None:
        name = part_name(whole, part.suffix, self.graph)
        said = Said(name)
        said.add(TYPE, NAMED_INDIVIDUAL)
        said.add(TYPE, part.cls)
        part.write(said, value)
        self.graph[name] = said.everything()
        self._add(whole, Fact(part.property, Reference(name)))


def _reach(body: _Told | None, frame: _Told | None) -> float:
    """How far something comes out: by its own extent along the joint's x axis."""
    if body is None or body.size is None:
        return 0.0
    direction = np.array([1.0, 0.0, 0.0]) if frame is None else frame.axes[:, 0]
    return float(np.abs(body.axes.T @ direction) @ body.size)


def _hinge(body: _Told | None, frame: _Told | None) -> tuple[Array, bool]:
    """The axis in the world about which something turns, and whether it ends."""
    up = np.array([0.0, 0.0, 1.0])
    if body is None or body.size is None or frame is None:
        return up, True
    half = np.maximum(body.size, 1e-6) / 2
    off = np.abs(body.axes.T @ (frame.pose[:3] - body.pose[:3])) / half
    thin, short, _ = np.argsort(half)
    if off.max() < _CENTRED:
        return body.axes[:, thin], False
    if half[thin] < _PANEL * half[short]:
        plane = [number for number in range(3) if number != thin]
        side = max(plane, key=lambda number: float(off[number]))
        return body.axes[:, next(number for number in plane if number != side)], True
    return up, True


def _parents(excerpt: Excerpt) -> Mapping[Iri, Iri]:
    """By child; the first that is told counts."""
    members = set(excerpt.members)
    parents: dict[Iri, Iri] = {}
    for iri in excerpt.members:
        for other in _named(excerpt.graph[iri], PARENT):
            if other in members:
                parents.setdefault(iri, other)
    for iri in excerpt.members:
        for other in _named(excerpt.graph[iri], CHILD):
            parents.setdefault(other, iri)
    return parents


def _named(facts: Sequence[Fact], property: Iri) -> list[Iri]:
    return [fact.value.iri for fact in facts if fact.property == property and isinstance(fact.value, Reference)]


def _silent(severity: Severity, individual: str, property: str, what: str, did: str) -> None:
    """Whoever makes the world reports the same."""
