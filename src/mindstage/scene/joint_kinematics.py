"""Kinematics: ranges and displacements of joints, the front of jointed bodies, and rigid groups of attached bodies."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.scene.display import short_name
from mindstage.scene.transforms import Array, normalized_pose_array, quat_rotate
from mindstage.scene.world_model import (
    AxisMotion,
    Body,
    BodyId,
    Joint,
    Mobility,
    Pose,
    Vector,
    World,
)

__all__ = [
    "FrontSide",
    "JointAxisRange",
    "JointDisplacement",
    "ObservedBox",
    "OutwardJoint",
    "RigidGroups",
    "axis_ranges",
    "coupled_positions",
    "drawer_front",
    "first_movable_axis",
    "front_side",
    "handles_by_body",
    "is_floating",
    "is_handle_class",
    "is_moving_part_class",
    "is_robot_part",
    "joint_displacement",
    "joint_reach",
    "moving_body",
    "outward_joints",
    "without_lost_masters",
]


class JointAxisRange(NamedTuple):
    """The motion that a joint allows on one of its six axes."""

    motion: AxisMotion
    limit: float
    """Half of the range [m or rad]; ignored unless the motion is limited."""
    middle: float
    """Middle of the range, relative to the spawn pose [m or rad]."""


class JointDisplacement(NamedTuple):
    """The displacement of a joint from its spawn pose, on the axis with the largest displacement."""

    displacement: float
    """[m] or [rad], never negative."""
    is_prismatic: bool
    """Whether the axis is a translation [m] rather than a rotation [rad]."""
    fraction: float | None
    """The displacement relative to the reach of the axis, 0 to 1; None if the axis is unlimited."""


def axis_ranges(joint: Joint) -> tuple[JointAxisRange, ...]:
    """Returns the ranges of all six axes: x, y, z [m], twist (about x), swing2 (about y), swing1 (about z) [rad]."""
    linear, angular = joint.linear, joint.angular
    return (
        JointAxisRange(linear.x, linear.limit, linear.x_middle),
        JointAxisRange(linear.y, linear.limit, linear.y_middle),
        JointAxisRange(linear.z, linear.limit, linear.z_middle),
        JointAxisRange(angular.twist, angular.twist_limit, angular.twist_middle),
        JointAxisRange(angular.swing2, angular.swing2_limit, angular.swing2_middle),
        JointAxisRange(angular.swing1, angular.swing1_limit, angular.swing1_middle),
    )


def is_floating(joint: Joint) -> bool:
    """Whether a joint constrains nothing, such as a floating one in URDF: its bodies are free, as without it."""
    return all(each.motion is AxisMotion.FREE for each in axis_ranges(joint))


def first_movable_axis(joint: Joint) -> int | None:
    """Returns the first axis that is not locked, in the order of `axis_ranges`, or None."""
    for number, each in enumerate(axis_ranges(joint)):
        if each.motion is AxisMotion.FREE or (each.motion is AxisMotion.LIMITED and each.limit > 0.0):
            return number
    return None


def coupled_positions(joints: Mapping[BodyId, Joint], id: BodyId, position: float) -> dict[BodyId, float]:
    """Returns the positions of all joints that are coupled to a joint by `Joint.mimic`, without its own.

    A follower whose multiplier is 0 has no effect on its master.

    Args:
        joints: all joints by id.
        id: the joint whose position is given.
        position: on its first movable axis, relative to the spawned pose [m or rad].
    """
    if id not in joints or not any(joint.mimic for joint in joints.values()):
        return {}
    followers: dict[BodyId, list[Joint]] = {}
    for joint in joints.values():
        if joint.mimic is not None and joint.mimic.joint in joints and joint.mimic.joint != joint.id:
            followers.setdefault(joint.mimic.joint, []).append(joint)
    found, queue = {id: position}, [id]
    for current in queue:
        mimic = joints[current].mimic
        if mimic is not None and mimic.multiplier and mimic.joint in joints and mimic.joint not in found:
            found[mimic.joint] = (found[current] - mimic.offset) / mimic.multiplier
            queue.append(mimic.joint)
        for follower in followers.get(current, ()):
            if follower.mimic is not None and follower.id not in found:
                found[follower.id] = follower.mimic.multiplier * found[current] + follower.mimic.offset
                queue.append(follower.id)
    del found[id]
    return found


def without_lost_masters(joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Returns joints of which those that mimic a joint that is not among them mimic none."""
    ids = {joint.id for joint in joints}
    return tuple(
        joint if joint.mimic is None or joint.mimic.joint in ids else replace(joint, mimic=None) for joint in joints
    )


def joint_reach(joint: Joint) -> tuple[float | None, ...]:
    """Returns the largest displacement from the spawn pose on each axis, in the order of `axis_ranges` [m or rad].

    0 for a locked axis, None for a free one.
    """
    return tuple(
        None if motion is AxisMotion.FREE else 0.0 if motion is AxisMotion.LOCKED else limit + abs(middle)
        for motion, limit, middle in axis_ranges(joint)
    )


def joint_displacement(joint: Joint, positions: Sequence[float]) -> JointDisplacement | None:
    """Returns the displacement of a joint; None if all of its axes are locked.

    Args:
        positions: its displacement on each axis, in the order of `axis_ranges` [m or rad].
    """
    displacements = [
        JointDisplacement(abs(position), axis < 3, None if reach is None else min(abs(position) / reach, 1.0))
        for axis, (position, reach) in enumerate(zip(positions, joint_reach(joint), strict=True))
        if reach != 0.0
    ]
    return max(
        displacements,
        key=lambda each: each.fraction if each.fraction is not None else each.displacement,
        default=None,
    )


_MOBILITY_RANK = {Mobility.DYNAMIC: 0, Mobility.KINEMATIC: 1}
"""Bodies with a lower rank are moved first; all others have rank 2."""


@dataclass(frozen=True, slots=True)
class RigidGroups:
    """Groups of bodies that attachments connect rigidly; rows are indices into `World.bodies`."""

    root_row: NDArray[np.intp]
    """For each body, the row of the root body of its group, which identifies the group."""
    jointed_pairs: frozenset[tuple[int, int]]
    """Pairs of groups that a joint connects, unless it is floating: the moving group, then the holding one."""
    is_jointed: NDArray[np.bool_]
    """For each body, whether a joint holds its group, as it does a door with its handle."""
    is_dynamic: NDArray[np.bool_]
    """For each body, whether the physics simulation moves its group."""

    @classmethod
    def from_world(cls, world: World) -> RigidGroups:
        """Computes the groups of a world; a cycle of attachments is cut at an arbitrary body."""
        rows = {body.id: row for row, body in enumerate(world.bodies)}
        parents = {attachment.child: attachment.parent for attachment in world.attachments if attachment.parent in rows}
        root_row = np.array([rows[_root_of(body.id, parents)] for body in world.bodies], dtype=np.intp)
        jointed_pairs = set()
        for joint in world.joints:
            if joint.parent in rows and joint.child in rows and not is_floating(joint):
                moving, holder = moving_body(joint, world.bodies[rows[joint.parent]], world.bodies[rows[joint.child]])
                jointed_pairs.add((int(root_row[rows[moving.id]]), int(root_row[rows[holder.id]])))
        is_jointed = np.zeros(len(world.bodies), dtype=bool)
        is_jointed[[moving for moving, _ in jointed_pairs]] = True
        is_dynamic = np.array([body.physics.is_dynamic for body in world.bodies], dtype=bool)
        return cls(root_row, frozenset(jointed_pairs), is_jointed[root_row], is_dynamic[root_row])


def moving_body(joint: Joint, parent: Body, child: Body) -> tuple[Body, Body]:
    """Returns the body that a joint moves and the body that holds it.

    Maps use parent and child either way. Dynamic bodies are moved before kinematic ones, and those before static ones;
    of two with equal mobility, the door or drawer is moved, otherwise the smaller one. Joints of robots always move
    their child: a link of an arm may be larger than the one that carries it.
    """
    if is_robot_part(parent) and is_robot_part(child):
        return child, parent

    def rank(body: Body) -> tuple[int, bool, float]:
        mobility = body.physics.mobility
        by_mobility = 2 if mobility is None else _MOBILITY_RANK.get(mobility, 2)
        return by_mobility, not is_moving_part_class(body.cls), _volume(body)

    moving, holder = sorted((child, parent), key=rank)
    return moving, holder


def is_robot_part(body: Body) -> bool:
    """Whether a body is tagged as a part of a robot."""
    return any(tag.type == "robot" for tag in body.tags)


def _volume(body: Body) -> float:
    return float(np.prod(body.size)) if body.size else 0.0


def _root_of(id: BodyId, parents: Mapping[BodyId, BodyId]) -> BodyId:
    visited = {id}
    while (parent := parents.get(id)) is not None and parent not in visited:
        visited.add(parent)
        id = parent
    return id


# -- the front of jointed bodies ---------------------------------------------------------------------------------------

_DEFAULT_EXTENT_M = 0.1
"""Extent of a body without a size [m]."""
_HANDLE_WORDS = ("Handle", "Knob", "Latch")
"""Words in the names of classes of things by which doors and drawers are pulled."""
_MOVING_PART_WORDS = frozenset({"Door", "Drawer", "Lid", "Flap", "Hatch", "Gate", "Rack"})
_OTHER_NOUNS = frozenset(
    ("Area", "Bell", "Block", "Cabinet", "Case", "Casing", "Frame", "Handle", "Hinge", "Joint", "Knob", "Latch", "Lock")
)
"""Words after that of a moving part which name something that does not move with it, or only a part of it."""
_NAME_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_MIN_HANDLE_OFFSET_M = 0.005
_HANDLE_OFFSET = 0.25
"""Least offset of a handle from the center of its body, as a fraction of the half extent, that shows the front."""
_CASING_OFFSET = 0.3
"""Least offset of a body from the center of its casing, as a fraction of the half extent, that shows the front."""
_OUTSIDE_OFFSET = 0.8
"""Offset of a body from the center of its casing beyond which the casing outweighs a handle that shows otherwise."""
_ALONG_COSINE = 0.1
"""Cosine of the angle between the normal of a sliding door and the direction that it slides in."""
_FLUSH_M, _MIN_BEHIND_M = 0.01, 0.02
"""The end of a drawer that is in the front of its casing or before it is this close to it, and the other one farther
than that from the back [m]."""
_MAX_CASING_M = 2.5
"""Extent towards the front beyond which a body is a room or a building rather than a casing [m]."""
_MIN_FURNITURE_M = 0.2
"""Largest extent from which a body without a handle counts as a door or a drawer [m]."""
_PANEL_RATIO = 0.5
"""A panel (a door) is thinner than this fraction of its shorter side."""
_BEHIND_M = 0.03
"""Depth behind a panel at which its casing is looked for [m]."""
_RANGE_TOLERANCE = {True: 0.01, False: 0.03}
"""Travel beyond the closed position that a prismatic [m] or a revolute joint [rad] may have, as play."""


class ObservedBox(NamedTuple):
    """Pose and size of a body in the world frame; the size is None if unknown."""

    pose: Pose
    size: Vector | None

    @classmethod
    def of(cls, body: Body) -> ObservedBox:
        """Returns the box of a body at its pose."""
        return cls(body.pose, body.size)

    @property
    def center(self) -> Array:
        """Position in the world frame [m]."""
        return np.array(self.pose.position)

    @property
    def half_extents(self) -> Array:
        """Half the extents along the box's own axes [m], never 0."""
        return np.maximum(self.size or (_DEFAULT_EXTENT_M,) * 3, 1e-3) / 2

    def axis(self, number: int) -> Array:
        """Returns the direction of one of the box's axes in the world frame."""
        return quat_rotate(normalized_pose_array(self.pose)[3:], np.eye(3)[number])

    @property
    def axes(self) -> Array:
        """The directions of the box's axes in the world frame, as rows."""
        return quat_rotate(normalized_pose_array(self.pose)[3:], np.eye(3))

    def half_extent_along(self, direction: Array) -> float:
        """Returns half the extent of the box along a direction of the world frame [m]."""
        return float(np.abs(self.axes @ direction) @ self.half_extents)

    def local_center_of(self, other: ObservedBox) -> Array:
        """Returns the center of another box relative to this one's, along this one's axes [m]."""
        return np.asarray(self.axes @ (other.center - self.center))

    def contains(self, point: Array, *, margin: float = 0.0) -> bool:
        """Whether a point of the world frame is in the box, enlarged by a margin [m]."""
        return bool(np.all(np.abs(self.axes @ (point - self.center)) <= self.half_extents + margin))


class FrontSide(NamedTuple):
    """The side of a door or drawer that faces outwards."""

    sign: int
    """1 if a given direction points outwards, otherwise -1."""
    evidence: str


def is_handle_class(name: str) -> bool:
    """Whether the name of a class is that of something by which doors and drawers are pulled."""
    return any(word in short_name(name) for word in _HANDLE_WORDS)


@lru_cache(maxsize=4096)
def is_moving_part_class(name: str) -> bool:
    """Whether the name of a class is that of a part of furniture that moves: IAIFridgeDoor, not DoorFrame."""
    words = _NAME_WORD.findall(short_name(name))
    moving = [number for number, word in enumerate(words) if word in _MOVING_PART_WORDS]
    return bool(moving) and _OTHER_NOUNS.isdisjoint(words[moving[-1] :])


def handles_by_body(bodies: Mapping[BodyId, Body], parents: Mapping[BodyId, BodyId]) -> dict[BodyId, Body]:
    """Returns the first handle that is attached to each body.

    Args:
        bodies: all bodies by id.
        parents: the parent of each attached body.
    """
    handles: dict[BodyId, Body] = {}
    for child, parent in parents.items():
        if child in bodies and is_handle_class(bodies[child].cls):
            handles.setdefault(parent, bodies[child])
    return handles


def front_side(
    moving: ObservedBox, casing: ObservedBox | None, handle: ObservedBox | None, direction: Array
) -> FrontSide | None:
    """Returns which way along a direction a door or drawer faces; None without evidence.

    A handle protrudes from the front, and a door is in front of its casing. Where the two contradict each other, as
    with a handle on the inside of a door, a body clearly outside its casing decides.

    Args:
        moving: the door or drawer.
        casing: the body that it closes or that it slides out of.
        handle: what it is pulled by.
        direction: unit vector in the world frame, normal to a door or along the rails of a drawer.
    """
    half = moving.half_extent_along(direction)
    handle_offset = 0.0 if handle is None else float((handle.center - moving.center) @ direction)
    by_handle = abs(handle_offset) > max(_MIN_HANDLE_OFFSET_M, _HANDLE_OFFSET * half)
    share = 0.0
    if casing is not None and 2 * (depth := casing.half_extent_along(direction)) <= _MAX_CASING_M:
        share = float((moving.center - casing.center) @ direction) / depth
    by_casing = abs(share) > _CASING_OFFSET
    if by_handle and by_casing and handle_offset * share < 0.0:
        by_handle, by_casing = abs(share) < _OUTSIDE_OFFSET, abs(share) >= _OUTSIDE_OFFSET
    if by_handle:
        evidence = f"its handle is {100 * abs(handle_offset):.0f} cm from its center on that side"
        return FrontSide(int(np.sign(handle_offset)), evidence)
    if by_casing:
        return FrontSide(int(np.sign(share)), "it is on that side of its casing")
    return None if casing is None else drawer_front(moving, casing, direction)


def drawer_front(moving: ObservedBox, casing: ObservedBox, direction: Array) -> FrontSide | None:
    """Returns which way along a direction a drawer faces whose one end is in the front of its casing, or before it.

    Its other end is then not at the back: there is room behind a drawer.
    """
    half, depth = moving.half_extent_along(direction), casing.half_extent_along(direction)
    offset = float((moving.center - casing.center) @ direction)
    behind = depth - half + abs(offset)
    if 2 * depth > _MAX_CASING_M or abs(offset) >= depth or behind < _MIN_BEHIND_M:
        return None
    if half + abs(offset) < depth - _FLUSH_M:
        return None
    evidence = f"its other end is {100 * behind:.0f} cm from the back of its casing"
    return FrontSide(int(np.sign(offset)), evidence)


class OutwardJoint(NamedTuple):
    """A joint whose range is limited to the outward direction, and the reason."""

    joint: Joint
    text: str


def outward_joints(
    joints: Sequence[Joint], bodies: Mapping[BodyId, Body], handles: Mapping[BodyId, Body]
) -> dict[BodyId, OutwardJoint]:
    """Returns the joints that would let a door or drawer move into its casing, limited to the outward direction.

    Many maps give a range on both sides of the closed position. It is limited where the front is known and the casing
    is behind it; a door in a wall, a swing door and whatever has no casing keep their ranges. So do the joints of
    robots, whose models state them: a lift in front of its mast, at half of its height, looks like a drawer.

    Args:
        joints: the joints, at the positions of the bodies' poses.
        bodies: all bodies by id.
        handles: the handle of each body that has one.
    """
    found: dict[BodyId, OutwardJoint] = {}
    for joint in joints:
        if joint.parent in bodies and joint.child in bodies:
            moving, holder = moving_body(joint, bodies[joint.parent], bodies[joint.child])
            if is_robot_part(moving):
                continue
            limited = _outward_joint(joint, moving, holder, handles.get(moving.id))
            if limited is not None:
                found[joint.id] = limited
    return found


def _outward_joint(joint: Joint, moving: Body, holder: Body, handle: Body | None) -> OutwardJoint | None:
    ranges = axis_ranges(joint)
    axes = [number for number, each in enumerate(ranges) if each.motion is not AxisMotion.LOCKED]
    if len(axes) != 1 or ranges[axes[0]].motion is not AxisMotion.LIMITED or moving.size is None or holder.size is None:
        return None
    number = axes[0]
    _, limit, middle = ranges[number]
    is_prismatic = number < 3
    tolerance = _RANGE_TOLERANCE[is_prismatic]
    if not (middle - limit < -tolerance and middle + limit > tolerance):
        return None
    axis = quat_rotate(normalized_pose_array(joint.pose)[3:], np.eye(3)[number % 3])
    box, casing = ObservedBox.of(moving), ObservedBox.of(holder)
    if handle is None and 2 * float(box.half_extents.max()) < _MIN_FURNITURE_M:
        return None
    outward = (_slide_direction if is_prismatic else _swing_direction)(joint, axis, box, casing)
    if outward is None:
        return None
    leaf = _leaf_side(box, casing, outward) if is_prismatic else None
    front = leaf or front_side(box, casing, None if handle is None else ObservedBox.of(handle), outward)
    if front is None or not _closes(box, casing, front.sign * outward, is_prismatic=is_prismatic):
        return None
    sign = front.sign if moving.id == joint.child else -front.sign
    end = middle + sign * limit
    verb, unit = ("slide", "m") if is_prismatic else ("turn", "rad")
    where = "into" if leaf is None else "beside"
    text = (
        f"{joint.id} would let {moving.id} {verb} {abs(middle - sign * limit):.3g} {unit} {where} {holder.id}; "
        f"{front.evidence}, so it only opens outwards, to {end:.3g} {unit}"
    )
    return OutwardJoint(_with_range(joint, number, sign * abs(end) / 2, abs(end) / 2), text)


def _leaf_side(moving: ObservedBox, casing: ObservedBox, direction: Array) -> FrontSide | None:
    """Returns which way a sliding door before its casing moves: over the casing; None if it is none."""
    half = moving.half_extents
    thin, short, _ = np.argsort(half)
    normal = moving.axis(int(thin))
    offset = moving.center - casing.center
    before = abs(float(offset @ normal)) >= casing.half_extent_along(normal)
    aside = float(offset @ direction)
    if half[thin] > _PANEL_RATIO * half[short] or abs(float(normal @ direction)) > _ALONG_COSINE or not before:
        return None
    if abs(aside) < _MIN_BEHIND_M:
        return None
    return FrontSide(-int(np.sign(aside)), "it is a sliding door on the other side of its casing")


def _slide_direction(joint: Joint, axis: Array, moving: ObservedBox, casing: ObservedBox) -> Array | None:
    """Returns the direction of a slide; None if the body is not in its casing."""
    return axis if casing.contains(moving.center, margin=0.05) else None


def _swing_direction(joint: Joint, axis: Array, moving: ObservedBox, casing: ObservedBox) -> Array | None:
    """Returns the direction in which a panel moves away when its hinge turns on; None if it is not a panel."""
    half = moving.half_extents
    thin, short, _ = np.argsort(half)
    arm = moving.center - np.array(joint.pose.position)
    velocity = np.cross(axis, arm)
    speed = float(np.linalg.norm(velocity))
    if half[thin] > _PANEL_RATIO * half[short] or speed < half[short] / 4:
        return None
    normal = moving.axis(int(thin))
    along = float(normal @ velocity) / speed
    return None if abs(along) < 0.8 else np.asarray(np.sign(along) * normal)


def _closes(moving: ObservedBox, casing: ObservedBox, outward: Array, *, is_prismatic: bool) -> bool:
    """Whether the casing is behind a body, so that moving inwards would move it into the casing."""
    if 2 * casing.half_extent_along(outward) > _MAX_CASING_M:
        return False
    depth = 0.0 if is_prismatic else moving.half_extent_along(outward) + _BEHIND_M
    return casing.contains(moving.center - depth * outward, margin=0.05 if is_prismatic else 0.02)


def _with_range(joint: Joint, axis: int, middle: float, limit: float) -> Joint:
    """Returns a joint with another range of one axis."""
    linear, angular = joint.linear, joint.angular
    if axis < 3:
        x, y, z = (middle if number == axis else 0.0 for number in range(3))
        return replace(joint, linear=replace(linear, limit=limit, x_middle=x, y_middle=y, z_middle=z))
    if axis == 3:
        return replace(joint, angular=replace(angular, twist_limit=limit, twist_middle=middle))
    if axis == 4:
        return replace(joint, angular=replace(angular, swing2_limit=limit, swing2_middle=middle))
    return replace(joint, angular=replace(angular, swing1_limit=limit, swing1_middle=middle))
