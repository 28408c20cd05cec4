"""Rigid groups and kinematic trees of a world, and the coordinates of its joints.

Attached bodies form rigid groups, which joints connect to trees. The root of a tree is a group that is not dynamic, or
else the heaviest; parents in a tree may be children in the map. Joints that would close a loop are kept separately, as
equality constraints.

Joint coordinates are x, y, z [m], then twist (about x), swing 2 (about y), swing 1 (about z) [rad] in the joint frame.
As in MuJoCo, slides come first, along axes that do not rotate, followed by hinges about z, y and x: the Tait-Bryan
angles of the rotation. Three free angles are a ball joint, which has no singularity.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.engines.entity_registry import EntityRegistry
from mindstage.scene import AngularLimits, AxisMotion, Body, BodyId, Joint, LinearLimits, Mobility, SoftLimit
from mindstage.scene.joint_kinematics import axis_ranges, coupled_positions, first_movable_axis, moving_body
from mindstage.scene.transforms import Array, pose_inverse, pose_multiply, quat_multiply

__all__ = [
    "AXIS_NAMES",
    "JointAxis",
    "KinematicForest",
    "RigidGroup",
    "TreeJoint",
    "build_kinematic_forest",
    "coupled_body_poses",
    "is_ball",
    "joint_coordinates",
    "mimic_coefficients",
    "movable_axes",
    "pose_from_joint_coordinates",
]


AXIS_NAMES = ("x", "y", "z", "twist", "swing2", "swing1")
"""The axes of a joint in the order of coordinates."""

_HINGE_ORDER = (5, 4, 3)
"""Indices of the rotational axes, outermost first."""


@dataclass(frozen=True, slots=True)
class JointAxis:
    """One movable axis of a joint."""

    index: int
    """Index into `AXIS_NAMES`: 0 to 2 are slides along x, y, z; 3 to 5 hinges about them."""
    limit: float | None
    """Half range [m or rad]; None for no limit."""
    soft_limit: SoftLimit
    middle: float = 0.0
    """Middle of the range, relative to the spawned position."""

    @property
    def is_prismatic(self) -> bool:
        """Whether it is a slide, not a hinge."""
        return self.index < 3

    @property
    def direction(self) -> int:
        """0, 1, 2 for x, y, z."""
        return self.index % 3


def movable_axes(joint: Joint, *, is_reversed: bool = False) -> tuple[JointAxis, ...]:
    """The movable axes of a joint, slides first; an axis with an empty range is locked.

    Args:
        joint: the joint.
        is_reversed: whether its child is the parent in the tree, so that all directions are inverted.
    """
    linear, angular = joint.linear, joint.angular
    soft_limits = (
        *(linear.soft_limit,) * 3,
        angular.twist_soft_limit,
        angular.swing_soft_limit,
        angular.swing_soft_limit,
    )
    ranges = axis_ranges(joint)
    sign = -1.0 if is_reversed else 1.0
    return tuple(
        JointAxis(index, None, soft_limits[index])
        if motion is AxisMotion.FREE
        else JointAxis(index, limit, soft_limits[index], sign * middle)
        for index in (0, 1, 2, *_HINGE_ORDER)
        for motion, limit, middle in [ranges[index]]
        if motion is AxisMotion.FREE or (motion is AxisMotion.LIMITED and middle - limit < middle + limit)
    )


def is_ball(axes: Sequence[JointAxis]) -> bool:
    """Whether all three rotations are free."""
    return sum(axis.limit is None for axis in axes if not axis.is_prismatic) == 3


def pose_from_joint_coordinates(coordinates: Sequence[float]) -> Array:
    """The child's joint frame in the parent's, seven numbers, for six coordinates."""
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    for index in _HINGE_ORDER:
        axis_rotation = np.zeros(4)
        axis_rotation[0], axis_rotation[1 + index % 3] = np.cos(coordinates[index] / 2), np.sin(coordinates[index] / 2)
        quaternion = quat_multiply(quaternion, axis_rotation)
    return np.array([*coordinates[:3], *quaternion])


def joint_coordinates(relative: Array, axes: Sequence[JointAxis]) -> Array:
    """The six coordinates of a joint, angles within [-pi, pi).

    Args:
        relative: the child's joint frame in the parent's, seven numbers.
        axes: the movable axes. Other motion is left out; compare with `pose_from_joint_coordinates` to detect it.
    """
    w, x, y, z = (relative[3:] / np.linalg.norm(relative[3:])).tolist()
    hinges = [axis for axis in axes if not axis.is_prismatic]
    angles = np.zeros(3)
    if len(hinges) == 1:
        direction = hinges[0].direction
        angles[direction] = 2 * np.arctan2((x, y, z)[direction], w)
    elif hinges:
        angles[0] = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        angles[1] = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
        angles[2] = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.concatenate([relative[:3], (angles + np.pi) % (2 * np.pi) - np.pi])


T = TypeVar("T")


@dataclass(slots=True)
class RigidGroup:
    """Bodies that are rigidly attached to one another."""

    root: BodyId
    """The body to which all others are attached."""
    mobility: Mobility
    """Mobility of the root, which holds for all."""
    mass_kg: float
    bodies: list[BodyId] = field(default_factory=list)
    """The root first, parents before children."""

    @property
    def is_dynamic(self) -> bool:
        """Whether the group is simulated."""
        return self.mobility is Mobility.DYNAMIC


@dataclass(slots=True)
class TreeJoint:
    """A joint that connects a rigid group to its parent in the tree."""

    joint: Joint
    parent: BodyId
    """The end nearer to the root, which may be the child in the map."""
    child: BodyId

    @property
    def is_reversed(self) -> bool:
        """Whether parent and child are swapped compared to the map."""
        return self.parent != self.joint.parent

    def order_ends(self, ends: tuple[T, T]) -> tuple[T, T]:
        """Reorders a pair for the map's parent and child to this joint's parent and child."""
        return ends[::-1] if self.is_reversed else ends


@dataclass(slots=True)
class KinematicForest:
    """All rigid groups and the joints between them."""

    groups: dict[BodyId, RigidGroup] = field(default_factory=dict)
    """Groups by their roots, parents before children."""
    root_of: dict[BodyId, BodyId] = field(default_factory=dict)
    """Root of each body's group."""
    rigid_parents: dict[BodyId, BodyId] = field(default_factory=dict)
    """Parent of each rigidly attached body; roots are not included."""
    tree_joints: dict[BodyId, TreeJoint] = field(default_factory=dict)
    """By the root of the child group."""
    loop_joints: list[TreeJoint] = field(default_factory=list)
    """Joints that close a loop."""
    notes: list[SpawnNote] = field(default_factory=list)
    is_ordered: bool = True
    """Whether groups are in the order of `build_kinematic_forest`, in which models are compiled."""

    def with_single_bodies(
        self, mobilities: Mapping[BodyId, Mobility], masses: Mapping[BodyId, float]
    ) -> KinematicForest:
        """The forest with more bodies that are neither attached nor on joints; their groups come last.

        Args:
            mobilities: the new bodies with their mobilities.
            masses: their masses, estimated ones included [kg].
        """
        groups = {id: RigidGroup(id, mobility, masses[id], [id]) for id, mobility in mobilities.items()}
        return replace(
            self,
            groups=self.groups | groups,
            root_of=self.root_of | dict(zip(groups, groups, strict=True)),
            is_ordered=False,
        )

    def without_single_bodies(self, ids: Collection[BodyId]) -> KinematicForest:
        """The forest without some bodies that are neither attached nor on joints."""
        groups, root_of = self.groups.copy(), self.root_of.copy()
        for id in ids:
            del groups[id], root_of[id]
        return replace(self, groups=groups, root_of=root_of)

    def part(self, roots: Iterable[BodyId], *, fixed: Collection[BodyId]) -> KinematicForest:
        """Some of the groups, with the joints between them.

        Args:
            roots: the roots of the groups, in the order of the forest.
            fixed: the roots of groups that are static in the result, without their joints.
        """
        groups = {
            root: replace(self.groups[root], mobility=Mobility.STATIC) if root in fixed else self.groups[root]
            for root in roots
        }
        moving = {root for root, group in groups.items() if group.is_dynamic}
        return KinematicForest(
            groups,
            self.root_of,
            self.rigid_parents,
            {root: self.tree_joints[root] for root in groups if root in moving and root in self.tree_joints},
            [
                loop for loop in self.loop_joints
                if not moving.isdisjoint((self.root_of[loop.parent], self.root_of[loop.child]))
            ],
        )  # fmt: skip

    def tree_root_of(self, root: BodyId) -> BodyId:
        """The root group of the tree of one group."""
        while (tree_joint := self.tree_joints.get(root)) is not None:
            root = self.root_of[tree_joint.parent]
        return root

    def tree_roots(self) -> dict[BodyId, BodyId]:
        """The root group of the tree of each group, by their roots; groups of one tree move together."""
        result: dict[BodyId, BodyId] = {}
        for root in self.groups:  # parents come before children
            tree_joint = self.tree_joints.get(root)
            result[root] = root if tree_joint is None else result[self.root_of[tree_joint.parent]]
        return result


def mimic_coefficients(follower: TreeJoint, master: TreeJoint) -> tuple[float, float]:
    """Multiplier and offset from a master's coordinate in the tree to that of the joint that follows it.

    Coordinates of the tree are those of the world, negated where parent and child are swapped.
    """
    mimic = follower.joint.mimic
    assert mimic is not None
    own, other = (-1.0 if each.is_reversed else 1.0 for each in (follower, master))
    return own * other * mimic.multiplier, own * mimic.offset


def coupled_body_poses(
    joints: Mapping[BodyId, Joint],
    frames: Mapping[BodyId, tuple[Array, Array]],
    bodies: Mapping[BodyId, Body],
    poses: Mapping[BodyId, Array],
    moved: BodyId,
) -> dict[BodyId, Array]:
    """Returns new poses of bodies on joints that are coupled, by `Joint.mimic`, to the joint of a body that was moved.

    Args:
        joints: all joints by id.
        frames: each joint's frame in the map's parent and in its child.
        bodies: all bodies by id.
        poses: current poses of all bodies, with the moved body at its new pose.
        moved: the body that was moved.
    """
    if not any(joint.mimic for joint in joints.values()):
        return {}
    found: dict[BodyId, Array] = {}
    for joint in joints.values():
        axis = first_movable_axis(joint)
        if axis is None or moving_body(joint, bodies[joint.parent], bodies[joint.child])[0].id != moved:
            continue
        ends = [pose_multiply(poses[end], frame) for end, frame in _ends(joint, frames)]
        coordinates = joint_coordinates(pose_multiply(pose_inverse(ends[0]), ends[1]), movable_axes(joint))
        for id, position in coupled_positions(joints, joint.id, float(coordinates[axis])).items():
            pose = _body_pose_at(joints[id], frames, bodies, poses, position)
            if pose is not None:
                found[pose[0]] = pose[1]
    found.pop(moved, None)
    return found


def _ends(joint: Joint, frames: Mapping[BodyId, tuple[Array, Array]]) -> Iterable[tuple[BodyId, Array]]:
    return zip((joint.parent, joint.child), frames[joint.id], strict=True)


def _body_pose_at(
    joint: Joint,
    frames: Mapping[BodyId, tuple[Array, Array]],
    bodies: Mapping[BodyId, Body],
    poses: Mapping[BodyId, Array],
    position: float,
) -> tuple[BodyId, Array] | None:
    """Returns the body that a joint moves and its pose at a position of the first movable axis."""
    axis = first_movable_axis(joint)
    if axis is None:
        return None
    coordinates = [0.0] * 6
    coordinates[axis] = position
    relative = pose_from_joint_coordinates(coordinates)
    parent_from_joint, child_from_joint = frames[joint.id]
    if moving_body(joint, bodies[joint.parent], bodies[joint.child])[0].id == joint.child:
        joint_pose = pose_multiply(pose_multiply(poses[joint.parent], parent_from_joint), relative)
        return joint.child, pose_multiply(joint_pose, pose_inverse(child_from_joint))
    joint_pose = pose_multiply(pose_multiply(poses[joint.child], child_from_joint), pose_inverse(relative))
    return joint.parent, pose_multiply(joint_pose, pose_inverse(parent_from_joint))


def build_kinematic_forest(
    registry: EntityRegistry, masses: Mapping[BodyId, float], *, simulated_joints: Mapping[BodyId, Joint] | None = None
) -> KinematicForest:
    """Computes the forest of a registry.

    Args:
        registry: bodies, joints and attachments.
        masses: masses of all bodies, estimated ones included [kg].
        simulated_joints: joints that are simulated with other limits than those of the registry.
    """
    forest = KinematicForest()
    _build_groups(forest, registry, masses)
    edges = _edges(forest, (registry.joints | dict(simulated_joints or {})).values())
    ordered: dict[BodyId, RigidGroup] = {}
    fixed = [group for group in forest.groups.values() if not group.is_dynamic]
    free = sorted((a for a in forest.groups.values() if a.is_dynamic), key=lambda a: -a.mass_kg)
    used: set[BodyId] = set()
    # A kinematic root may be moved later, so groups between a static and a kinematic one belong to the static tree.
    roots = sorted(fixed, key=lambda group: group.mobility is Mobility.KINEMATIC)
    _grow_trees(forest, roots, edges, ordered, used)
    for group in free:
        _grow_trees(forest, [group], edges, ordered, used)
    forest.groups = ordered
    return forest


def _build_groups(forest: KinematicForest, registry: EntityRegistry, masses: Mapping[BodyId, float]) -> None:
    joints_of = _joints_by_body(registry)
    for id in registry.bodies:
        parent = registry.parents.get(id)
        if parent is None:
            continue
        if not (id in joints_of and registry.mobility(id) is Mobility.DYNAMIC):
            forest.rigid_parents[id] = parent
            continue
        joint_ids = ", ".join(joints_of[id])
        text = f"{id} is attached to {parent}, but moves on its joint {joint_ids}"
        forest.notes.append(SpawnNote(SpawnNoteKind.ATTACHMENT, (id, parent), text))
    roots = [id for id in registry.bodies if id not in forest.rigid_parents]
    for root in roots:
        group = RigidGroup(root, registry.mobility(root), 0.0)
        stack = [root]
        while stack:
            id = stack.pop()
            group.bodies.append(id)
            group.mass_kg += masses.get(id, 0.0)
            forest.root_of[id] = root
            stack.extend(child for child in registry.children(id) if forest.rigid_parents.get(child) == id)
        forest.groups[root] = group
    for id, parent in forest.rigid_parents.items():
        if registry.mobility(id) is Mobility.DYNAMIC:
            text = f"{id} is dynamic and attached to {parent}: it moves rigidly with it and adds its mass"
            forest.notes.append(SpawnNote(SpawnNoteKind.ATTACHMENT, (id, parent), text))


def _joints_by_body(registry: EntityRegistry) -> dict[BodyId, list[BodyId]]:
    """The ids of each body's joints."""
    joints_of: dict[BodyId, list[BodyId]] = {}
    for joint in registry.joints.values():
        joints_of.setdefault(joint.parent, []).append(joint.id)
        joints_of.setdefault(joint.child, []).append(joint.id)
    return joints_of


_Edges = dict[BodyId, list[tuple[BodyId, TreeJoint]]]


def _edges(forest: KinematicForest, joints: Iterable[Joint]) -> _Edges:
    """For each group, its neighbors: the other group's root, and the joint from here to there."""
    edges: _Edges = {}
    for joint in joints:
        parent, child = forest.root_of[joint.parent], forest.root_of[joint.child]
        ids = (joint.id, joint.parent, joint.child)
        if parent == child:
            text = f"{joint.id} connects {joint.parent} and {joint.child}, which are rigidly attached"
            forest.notes.append(SpawnNote(SpawnNoteKind.JOINT, ids, text))
        elif not (forest.groups[parent].is_dynamic or forest.groups[child].is_dynamic):
            text = f"{joint.id} connects {joint.parent} and {joint.child}, neither of which is dynamic"
            forest.notes.append(SpawnNote(SpawnNoteKind.JOINT, ids, text))
        elif not _all_free(joint.linear, joint.angular):
            edges.setdefault(parent, []).append((child, TreeJoint(joint, joint.parent, joint.child)))
            edges.setdefault(child, []).append((parent, TreeJoint(joint, joint.child, joint.parent)))
    return edges


def _all_free(linear: LinearLimits, angular: AngularLimits) -> bool:
    axes = (linear.x, linear.y, linear.z, angular.twist, angular.swing1, angular.swing2)
    return all(axis is AxisMotion.FREE for axis in axes)


def _grow_trees(
    forest: KinematicForest,
    roots: list[RigidGroup],
    edges: _Edges,
    ordered: dict[BodyId, RigidGroup],
    used: set[BodyId],
) -> None:
    """Grows trees breadth-first from some roots; `used` has the ids of all joints so far."""
    pending: deque[RigidGroup] = deque()
    for start in roots:
        if start.root not in ordered:
            ordered[start.root] = start
            pending.append(start)
    while pending:
        group = pending.popleft()
        for root, tree_joint in edges.get(group.root, ()):
            if tree_joint.joint.id in used:
                continue
            used.add(tree_joint.joint.id)
            if root in ordered:
                forest.loop_joints.append(tree_joint)
                text = f"{tree_joint.joint.id} closes a loop of joints and is an equality constraint"
                forest.notes.append(SpawnNote(SpawnNoteKind.JOINT, (tree_joint.joint.id,), text))
            else:
                forest.tree_joints[root] = tree_joint
                ordered[root] = forest.groups[root]
                pending.append(forest.groups[root])
