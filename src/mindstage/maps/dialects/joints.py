"""Joint axes and frames, shared by the dialects that describe a joint by an axis and a range.

A joint frame has its x axis along the joint axis. A range from `lower` to `upper` has its middle halfway and its limit
at half the distance, so that middle - limit is `lower` and middle + limit is `upper`.

Where a map gives no axis, it is inferred from the poses and sizes of the bodies. A drawer opens towards its handle. A
door turns about one of the four edges of its panel: the one that fits the evidence best, such as a given position, the
handle far from it, the radius, the casing that it closes, and that tall doors turn about a vertical edge. Without such
evidence a door turns about its left vertical edge and a drawer slides along its x axis, which points forward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import pi
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.scene import AngularLimits, AxisMotion, LinearLimits, Pose, SoftLimit, Vector
from mindstage.scene.joint_kinematics import ObservedBox, drawer_front, front_side
from mindstage.scene.transforms import Array, pose_from_array

__all__ = [
    "OPEN_ANGLE_RAD",
    "HingeEvidence",
    "InferredAxis",
    "JointLimits",
    "JointRange",
    "JointType",
    "center_and_half_range",
    "infer_hinge_axis",
    "infer_prismatic_axis",
    "joint_from_axis",
    "opening_range",
    "to_vector",
]


JointRange = tuple[float, float] | None
"""Lower and upper limit relative to the initial pose [m or rad]; None for no limits."""
_OFFSET_TOLERANCE = 0.05
"""Offset from the center, as a fraction of the half extent, below which a box counts as centered."""
OPEN_ANGLE_RAD = pi / 2
"""Angle to which a door opens whose map gives no limits [rad]."""
_UP = np.array([0.0, 0.0, 1.0])
_PARALLEL_COSINE = 0.7
"""Cosine of the angle below which two directions count as parallel."""
_PANEL_RATIO = 0.5
"""A panel (a door) is thinner than this fraction of its shorter side."""
_EDGE_TOLERANCE = 0.15
"""Distance of a given position from an edge, as a fraction of the panel, below which it is on that edge."""
_HANDLE_ON_AXIS = 0.2
"""Distance of a handle from an axis, as a fraction of the panel, below which it could not open the door."""
_FAR_SHARE = 0.75
"""Distance of a handle from an axis, as a fraction of the panel, from which it is far enough."""
_TALL_M = 1.0
"""Height of a door from which it does not fold like a flap [m]."""
_UPRIGHT_RATIO, _WIDE_RATIO = 1.3, 2.5
"""Ratio of height to width, and of width to height, from which a door is upright or wide."""
_OVERHEAD_M = 1.5
"""Height of the center of a flap from which it opens upwards [m]."""
_MAX_CASING_M = 2.5
"""Extent from which a body is a room or a building rather than a casing [m]."""
_FLAP_CLASSES = ("Oven", "Dishwasher", "Dryer-Tumble")
"""Words in the names of classes whose doors fold down."""

# Costs of an edge that does not fit a piece of evidence, as negative logarithms of likelihoods.
_NEAR_HANDLE_COST = 8.0
_HANDLE_COST = 4.0
_MAX_RADIUS_COST = 4.0
_TALL_COST = 6.0
_UPRIGHT_COST, _HORIZONTAL_COST = 1.5, 0.7
_FLAP_COST = 1.5
_WRONG_FLAP_COST = 0.3
_FRAME_COST, _DEFAULT_FRAME_COST = 2.0, 0.5
_INNER_EDGE_COST = 1.5
_NOT_LEFT_COST = 0.05


class JointType(StrEnum):
    """The kind of motion that a joint allows."""

    REVOLUTE = "hinge"
    PRISMATIC = "slide"
    FIXED = "fixed"
    FLOATING = "floating"
    PLANAR = "planar"
    """Translation and rotation in the plane perpendicular to its axis."""


class JointLimits(msgspec.Struct, frozen=True):
    """Pose and degrees of freedom of a joint."""

    pose: Pose
    linear: LinearLimits
    angular: AngularLimits

    @property
    def is_movable(self) -> bool:
        """Whether any axis is not locked."""
        linear, angular = self.linear, self.angular
        axes = (linear.x, linear.y, linear.z, angular.twist, angular.swing1, angular.swing2)
        return any(axis is not AxisMotion.LOCKED for axis in axes)


def center_and_half_range(lower: float, upper: float) -> tuple[float, float]:
    """Returns the middle of a range and half its width."""
    return (lower + upper) / 2, (upper - lower) / 2


def joint_from_axis(
    joint_type: JointType, origin: Array, axis: Array, range: JointRange, *, damping: float = 0.0
) -> JointLimits:
    """Creates a joint from a point and an axis in the world frame.

    Args:
        joint_type: the motion that it allows.
        origin: a point on the joint axis [m].
        axis: direction of the axis; any length but 0.
        range: limits of a revolute or prismatic joint, lower one first.
        damping: of the motion [Ns/m or Nms/rad].
    """
    pose = pose_from_array(np.concatenate([origin, _rotation_from_x(axis / np.linalg.norm(axis))]))
    linear, angular = LinearLimits(), AngularLimits()
    motion = AxisMotion.FREE if range is None else AxisMotion.LIMITED
    middle, limit = (0.0, 0.0) if range is None else center_and_half_range(*range)
    soft = SoftLimit(damping=damping)
    free = AxisMotion.FREE
    if joint_type is JointType.PRISMATIC:
        linear = LinearLimits(x=motion, limit=limit, x_middle=middle, soft_limit=soft)
    elif joint_type is JointType.REVOLUTE:
        angular = AngularLimits(twist=motion, twist_limit=limit, twist_middle=middle, twist_soft_limit=soft)
    elif joint_type is JointType.PLANAR:
        linear, angular = LinearLimits(y=free, z=free), AngularLimits(twist=free)
    elif joint_type is JointType.FLOATING:
        linear, angular = LinearLimits(x=free, y=free, z=free), AngularLimits(swing1=free, swing2=free, twist=free)
    return JointLimits(pose, linear, angular)


def _rotation_from_x(axis: Array) -> Array:
    """Returns the shortest rotation (w x y z) that maps x to a unit axis; half a turn about z for -x."""
    x, y, z = (float(part) for part in axis)
    if x < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def to_vector(row: Array) -> Vector:
    """Converts an array of three numbers to a tuple."""
    x, y, z = (float(part) for part in row)
    return x, y, z


class InferredAxis(NamedTuple):
    """An axis in the world frame, a point on it, and the evidence for it."""

    origin: Array
    axis: Array
    evidence: str
    opens: int = 0
    """1 if positive positions move the body outwards, -1 if negative ones do, 0 if its front is unknown."""


def infer_prismatic_axis(parent: ObservedBox, child: ObservedBox, handle: ObservedBox | None) -> InferredAxis:
    """Returns the direction in which a child slides out of its parent.

    Args:
        parent: the body that contains the child, such as a cupboard.
        child: the body that slides, such as a drawer.
        handle: the handle of the child, if there is one.
    """
    level = [axis for axis in child.axes if abs(float(axis @ _UP)) < _PARALLEL_COSINE]
    if handle is None:
        fronts = [(axis, found) for axis in level if (found := drawer_front(child, parent, axis)) is not None]
        if len(fronts) == 1:
            axis, front = fronts[0]
            return InferredAxis(child.center, front.sign * axis, front.evidence, opens=1)
    for base, other, evidence in ((child, handle, "its handle is on that side"), (parent, child, "it is on that side")):
        if other is None:
            continue
        off = base.local_center_of(other) / base.half_extents
        number = int(np.argmax(np.abs(off)))
        if abs(off[number]) > _OFFSET_TOLERANCE:
            return InferredAxis(child.center, np.sign(off[number]) * base.axis(number), evidence, opens=1)
    return InferredAxis(child.center, child.axis(0), "there is no evidence for another direction than forward")


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeEvidence:
    """What a map says about a hinged body, from which the line that it turns about is inferred."""

    parent: ObservedBox
    """The body that the child closes, such as a cupboard."""
    child: ObservedBox
    """The body that turns, such as a door."""
    handle: ObservedBox | None = None
    range: JointRange = None
    """Limits of the rotation [rad]."""
    origin: Array | None = None
    """A point on the line, if the map gives one."""
    axis: Array | None = None
    """The direction of the line, if the map gives one."""
    frame: Array | None = None
    """The axes of the hinge's own frame, as rows; its z axis may be the axis of rotation."""
    radius: float | None = None
    """Distance of the handle from the line, if the map gives it [m]."""
    class_names: Sequence[str] = ()
    """Local names of the classes of both bodies and of their superclasses."""


@dataclass(frozen=True, slots=True)
class _Edge:
    """An edge of a panel, which it may turn about."""

    origin: Array
    axis: Array
    """Direction of the edge."""
    towards: Array
    """Unit vector from the edge to the middle of the panel."""
    extent: float
    """Extent of the panel along `towards` [m]."""

    def distance_to(self, point: Array) -> float:
        """The distance of a point from the edge, within the plane of the panel [m]."""
        return abs(float((point - self.origin) @ self.towards))


def infer_hinge_axis(evidence: HingeEvidence) -> tuple[InferredAxis, tuple[str, ...]]:
    """Returns the line that a child turns about; positive rotation opens it if the upper limit is the farther one.

    A position and a direction that the map gives are used, unless the handle of the door is then on the axis or the
    door would turn about its normal. Also returns those contradictions; what they are about is inferred.
    """
    conflicts: list[str] = []
    if evidence.axis is None and _is_middle_of_door(evidence):
        conflicts.append("the given position is the middle of the door, which has a handle")
        evidence = replace(evidence, origin=None)
    without_axis = replace(evidence, axis=None)
    attempts = [evidence, without_axis, replace(without_axis, origin=None)]
    for attempt in attempts:
        inferred = _hinge_line(attempt)
        conflict = _conflict_with_handle(evidence.child, evidence.handle, inferred.origin, inferred.axis)
        if conflict is None or (attempt.origin is None and attempt.axis is None):
            break
        given = [name for name, value in (("position", attempt.origin), ("axis", attempt.axis)) if value is not None]
        text = f"with the given {' and '.join(given)}, {conflict}"
        conflicts += [text] if text not in conflicts else []
    return inferred, tuple(conflicts)


def _is_middle_of_door(evidence: HingeEvidence) -> bool:
    """Whether a given position is that of a door, as in maps that copy its pose, rather than that of its hinge."""
    child, origin = evidence.child, evidence.origin
    if origin is None or evidence.handle is None:
        return False
    half = child.half_extents
    thin, short = (int(number) for number in np.argsort(half)[:2])
    offset = np.delete(np.abs(child.axes @ (origin - child.center)) / half, thin)
    return bool(half[thin] < _PANEL_RATIO * half[short] and offset.max() < _OFFSET_TOLERANCE)


def _hinge_line(evidence: HingeEvidence) -> InferredAxis:
    child, thin = evidence.child, int(np.argmin(evidence.child.half_extents))
    normal = child.axis(thin)
    front = front_side(child, evidence.parent, evidence.handle, normal)
    out = (1 if front is None else front.sign) * normal
    if front is None and (child.center - evidence.parent.center) @ out < 0.0:
        out = -out
    if evidence.origin is not None and evidence.axis is not None:
        speed = float(np.cross(evidence.axis, child.center - evidence.origin) @ out)
        is_known = front is not None and abs(speed) > 0.0
        return InferredAxis(evidence.origin, evidence.axis, "it is given", int(np.sign(speed)) if is_known else 0)
    edges = _edges(evidence, thin)
    costs = [_edge_cost(evidence, edge, out) for edge in edges]
    best = min(range(len(edges)), key=lambda number: costs[number].total)
    edge, reasons = edges[best], costs[best].reasons
    origin = edge.origin
    if evidence.radius is not None and evidence.handle is not None and evidence.origin is None:
        origin = origin + (float((evidence.handle.center - origin) @ edge.towards) - evidence.radius) * edge.towards
    opens = float(np.cross(edge.axis, edge.towards) @ out)
    axis = edge.axis if opens >= 0.0 else -edge.axis
    sign = 1
    if evidence.axis is not None:
        sign = int(np.sign(axis @ evidence.axis)) or 1
        axis = sign * evidence.axis
    elif evidence.range is not None and abs(evidence.range[0]) > abs(evidence.range[1]):
        sign = -1
    text = ", ".join(reasons) or "there is no evidence for another edge than the left one"
    if front is not None:
        text += f"; {front.evidence}"
    return InferredAxis(origin, sign * axis, text, 0 if front is None else sign)


def _conflict_with_handle(child: ObservedBox, handle: ObservedBox | None, origin: Array, axis: Array) -> str | None:
    """Returns why a given line cannot be the axis of a door; None if it can.

    A handle on the axis cannot open a door, and a door that turned about its normal would stay closed.
    """
    half, unit = child.half_extents, axis / np.linalg.norm(axis)
    thin, short = (int(number) for number in np.argsort(half)[:2])
    if half[thin] > _PANEL_RATIO * half[short]:
        return None
    if abs(float(unit @ child.axis(thin))) > _PARALLEL_COSINE:
        return "the axis is the normal of the door, which would stay closed"
    if handle is None:
        return None
    offset = handle.center - origin
    in_plane = offset - float(offset @ child.axis(thin)) * child.axis(thin)
    distance = float(np.linalg.norm(in_plane - float(in_plane @ unit) * unit))
    extent = 2 * max(child.half_extent_along(np.cross(unit, child.axis(thin))), float(half[short]))
    if distance < _HANDLE_ON_AXIS * extent:
        return f"its handle is {100 * distance:.0f} cm from the axis of a door of {100 * extent:.0f} cm"
    return None


@dataclass(slots=True)
class _Cost:
    """How badly an edge fits the evidence, and what speaks for it."""

    total: float = 0.0
    reasons: list[str] = field(default_factory=list)

    def add(self, cost: float, reason: str = "") -> None:
        """Adds a cost; a reason is kept if the edge fits."""
        self.total += cost
        if reason and cost <= 0.0:
            self.reasons.append(reason)


def _edges(evidence: HingeEvidence, thin: int) -> list[_Edge]:
    """The edges that a panel may turn about: those at a given position or along a given axis, otherwise all four."""
    child = evidence.child
    edges = []
    for side in (number for number in range(3) if number != thin):
        along = next(number for number in range(3) if number not in (thin, side))
        for sign in (1.0, -1.0):
            outer, half = sign * child.axis(side), float(child.half_extents[side])
            edges.append(_Edge(child.center + half * outer, child.axis(along), -outer, 2 * half))
    if evidence.axis is not None:
        given = evidence.axis / np.linalg.norm(evidence.axis)
        edges = [edge for edge in edges if abs(float(edge.axis @ given)) > _PARALLEL_COSINE] or edges
    if evidence.origin is not None:
        shares = [edge.distance_to(evidence.origin) / edge.extent for edge in edges]
        nearest = max(_EDGE_TOLERANCE, min(shares) + _EDGE_TOLERANCE / 2)  # near a corner it may be on either edge
        edges = [
            replace(edge, origin=evidence.origin) for edge, share in zip(edges, shares, strict=True) if share <= nearest
        ]
    return edges


def _edge_cost(evidence: HingeEvidence, edge: _Edge, out: Array) -> _Cost:
    cost = _Cost()
    if evidence.origin is not None:
        cost.add(0.0, "its position is given")
    if evidence.axis is not None:
        cost.add(0.0, "its direction is given")
    if evidence.frame is not None and abs(float(evidence.frame[2] @ edge.axis)) < _PARALLEL_COSINE:
        is_own = abs(float(evidence.frame[2] @ evidence.child.axis(2))) > _PARALLEL_COSINE
        cost.add(_DEFAULT_FRAME_COST if is_own else _FRAME_COST)
    elif evidence.frame is not None:
        cost.add(0.0, "its z axis is along this edge")
    if evidence.handle is not None:
        _add_handle_cost(cost, evidence, edge, evidence.handle)
    _add_shape_cost(cost, evidence, edge)
    _add_casing_cost(cost, evidence, edge)
    right = np.cross(_UP, out)
    is_left = abs(float(edge.axis @ _UP)) > _PARALLEL_COSINE and float(edge.towards @ right) > 0.0
    cost.add(0.0 if is_left else _NOT_LEFT_COST)
    return cost


def _add_handle_cost(cost: _Cost, evidence: HingeEvidence, edge: _Edge, handle: ObservedBox) -> None:
    """A handle is far from the axis, since a handle on it could not open the door, and at the given radius from it."""
    distance = edge.distance_to(handle.center)
    share = distance / edge.extent
    far = f"its handle is {100 * distance:.0f} cm from this edge"
    cost.add(_HANDLE_COST * max(0.0, 1.0 - share) if share < _FAR_SHARE else 0.0, far)
    cost.add(_NEAR_HANDLE_COST if share < _HANDLE_ON_AXIS else 0.0)
    if evidence.radius is not None:
        error = abs(distance - evidence.radius) / (0.1 * edge.extent + 0.02)
        cost.add(min(error, _MAX_RADIUS_COST) if error > 1.0 else 0.0, "as far from its handle as the radius given")


def _add_shape_cost(cost: _Cost, evidence: HingeEvidence, edge: _Edge) -> None:
    """Tall doors turn about a vertical axis; doors of ovens and wide, low doors about a horizontal one."""
    vertical = np.abs(evidence.child.axes @ _UP)
    if vertical[int(np.argmin(evidence.child.half_extents))] > _PARALLEL_COSINE:
        return  # a lid: all its edges are horizontal
    height = 2 * evidence.child.half_extent_along(_UP)
    is_vertical = abs(float(edge.axis @ _UP)) > _PARALLEL_COSINE
    width = edge.extent if is_vertical else 2 * evidence.child.half_extent_along(edge.axis / np.linalg.norm(edge.axis))
    is_flap = any(word in name for name in evidence.class_names for word in _FLAP_CLASSES) and height < _TALL_M
    if is_vertical:
        cost.add(_FLAP_COST if is_flap or width > _WIDE_RATIO * height else 0.0)
        if height >= _TALL_M:
            cost.add(0.0, f"a door {height:.2f} m tall turns about a vertical axis")
        return
    cost.add(_TALL_COST if height >= _TALL_M else 0.0)
    cost.add(_UPRIGHT_COST if height > _UPRIGHT_RATIO * width else _HORIZONTAL_COST)
    if is_flap:
        cost.add(0.0, "doors of such appliances fold down")
    is_bottom = float(edge.towards @ _UP) > 0.0
    is_overhead = float(evidence.child.center[2]) > _OVERHEAD_M
    cost.add(_WRONG_FLAP_COST if is_bottom is is_overhead or (is_flap and not is_bottom) else 0.0)


def _add_casing_cost(cost: _Cost, evidence: HingeEvidence, edge: _Edge) -> None:
    """The hinge of one of several doors is at the outer side of the casing, not where the doors meet."""
    casing = evidence.parent
    half = casing.half_extent_along(edge.towards)
    if not 1.5 * edge.extent / 2 < half < _MAX_CASING_M / 2:
        return
    off_middle = float((casing.center - evidence.child.center) @ edge.towards)
    if abs(off_middle) > _OFFSET_TOLERANCE * half:
        cost.add(0.0 if off_middle > 0.0 else _INNER_EDGE_COST, "this edge is at the side of the casing")


def opening_range(child: ObservedBox, inferred: InferredAxis, joint_type: JointType) -> JointRange:
    """Returns the range of a joint that gives none, if the front of its body is known: from closed to open."""
    if inferred.opens == 0:
        return None
    if joint_type is JointType.REVOLUTE:
        end = OPEN_ANGLE_RAD
    else:
        end = 2 * child.half_extent_along(inferred.axis / np.linalg.norm(inferred.axis))
    return (0.0, end) if inferred.opens > 0 else (-end, 0.0)
