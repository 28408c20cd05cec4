"""Forest: which body moves with which, worked out before any physics.

Bodies that hang rigidly together form an assembly. Constraints join assemblies. MuJoCo wants kinematic trees: each
tree grows from an assembly that the physics does not move (else from the heaviest), whatever the map calls parent
and child. A constraint that would close a loop cannot be part of a tree; it is kept as an equality.

Joints: the six axes of a constraint as slides, hinges and balls.

Coordinates are those of the joint frame: x, y, z [m], then twist (about x), swing 2 (about y), swing 1 (about z) [rad].
Slides come first, so that they go along axes that do not turn, then the hinges about z, y and x, which are the angles
of a rotation in that order (Tait-Bryan); MuJoCo applies joints so. Three free angles are a ball, which has no singular
pose.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.engines.registry import EntityRegistry
from mindstage.scene import AngularLimits, AxisMotion, Body, BodyId, Joint, LinearLimits, Mobility, SoftLimit
from mindstage.scene.kinematics import axis_ranges
from mindstage.scene.transforms import Array, quat_multiply

__all__ = [
    "AXIS_NAMES",
    "JointAxis",
    "KinematicForest",
    "RigidGroup",
    "TreeJoint",
    "build_kinematic_forest",
    "is_ball",
    "joint_coordinates",
    "movable_axes",
    "pose_from_joint_coordinates",
]


AXIS_NAMES = ("x", "y", "z", "twist", "swing2", "swing1")
"""Of a constraint, in the order of coordinates."""

_HINGE_ORDER = (5, 4, 3)


@dataclass(frozen=True, slots=True)
class JointAxis:
    """One axis along or about which something can move."""

    index: int
    """Into `AXIS_NAMES`: 0 to 2 are slides along x, y, z; 3 to 5 hinges about them."""
    limit: float | None
    """Either way from the middle [m or rad]; None for no limit."""
    soft_limit: SoftLimit
    middle: float = 0.0
    """Of its range, from where it was spawned."""

    @property
    def is_prismatic(self) -> bool:
        """Whether it is a slide, not a hinge."""
        return self.index < 3

    @property
    def direction(self) -> int:
        """0, 1, 2 for x, y, z."""
        return self.index % 3


def movable_axes(joint: Joint, *, is_reversed: bool = False) -> tuple[JointAxis, ...]:
    """The axes that can move, slides first; a range of one point is none.

    Args:
        constraint: the constraint.
        upside_down: whether its child holds its parent, so that all goes the other way.
    """
    linear, angular = joint.linear, joint.angular
    softs = (*(linear.soft_limit,) * 3, angular.twist_soft_limit, angular.swing_soft_limit, angular.swing_soft_limit)
    ranges = axis_ranges(joint)
    way = -1.0 if is_reversed else 1.0
    return tuple(
        JointAxis(index, None, softs[index])
        if motion is AxisMotion.FREE
        else JointAxis(index, limit, softs[index], way * middle)
        for index in (0, 1, 2, *_HINGE_ORDER)
        for motion, limit, middle in [ranges[index]]
        if motion is AxisMotion.FREE or (motion is AxisMotion.LIMITED and middle - limit < middle + limit)
    )


def is_ball(axes: Sequence[JointAxis]) -> bool:
    """Whether all three rotations are free."""
    return sum(axis.limit is None for axis in axes if not axis.is_prismatic) == 3


def pose_from_joint_coordinates(coordinates: Sequence[float]) -> Array:
    """The child's joint frame seen from the parent's, seven numbers, for six coordinates."""
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    for index in _HINGE_ORDER:
        turn = np.zeros(4)
        turn[0], turn[1 + index % 3] = np.cos(coordinates[index] / 2), np.sin(coordinates[index] / 2)
        quaternion = quat_multiply(quaternion, turn)
    return np.array([*coordinates[:3], *quaternion])


def joint_coordinates(relative: Array, axes: Sequence[JointAxis]) -> Array:
    """Six coordinates of a joint frame seen from the parent's; angles within a half turn either way.

    What the axes cannot express is left out; compare `pose_from_joint_coordinates` of the result to know whether there
    was any.
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
    """Bodies that keep their places among one another."""

    root: BodyId
    """The body all others hang on."""
    mobility: Mobility
    """Of the top; it decides for all."""
    mass_kg: float
    bodies: list[BodyId] = field(default_factory=list)
    """The top first, parents before children."""

    @property
    def is_dynamic(self) -> bool:
        """Whether the physics moves it."""
        return self.mobility is Mobility.DYNAMIC


@dataclass(slots=True)
class TreeJoint:
    """An assembly hanging on a body of another one, by a constraint."""

    joint: Joint
    parent: BodyId
    """The end nearer to the root, which need not be what the map calls the parent."""
    child: BodyId

    @property
    def is_reversed(self) -> bool:
        """Whether the map has the roles the other way round."""
        return self.parent != self.joint.parent

    def order_ends(self, ends: tuple[T, T]) -> tuple[T, T]:
        """What belongs to the map's parent and to its child, as what belongs to this branch's parent and child."""
        return ends[::-1] if self.is_reversed else ends


@dataclass(slots=True)
class KinematicForest:
    """All assemblies and how they hang together."""

    groups: dict[BodyId, RigidGroup] = field(default_factory=dict)
    """By their tops, each one after the one it hangs on."""
    root_of: dict[BodyId, BodyId] = field(default_factory=dict)
    """The top of each body's assembly."""
    rigid_parents: dict[BodyId, BodyId] = field(default_factory=dict)
    """Whom each body hangs on rigidly; tops are not in it."""
    tree_joints: dict[BodyId, TreeJoint] = field(default_factory=dict)
    """By the top of the hanging assembly."""
    loop_joints: list[TreeJoint] = field(default_factory=list)
    """Constraints that close a loop."""
    notes: list[SpawnNote] = field(default_factory=list)


def build_kinematic_forest(registry: EntityRegistry, masses: Mapping[BodyId, float]) -> KinematicForest:
    """Works out the forest of everything in an inventory.

    Args:
        inventory: bodies, constraints, attachments.
        masses: of every body that the physics may move, estimated ones included [kg].
    """
    forest = KinematicForest()
    _build_groups(forest, registry, masses)
    edges = _edges(forest, registry.joints.values())
    ordered: dict[BodyId, RigidGroup] = {}
    fixed = [assembly for assembly in forest.groups.values() if not assembly.is_dynamic]
    free = sorted((a for a in forest.groups.values() if a.is_dynamic), key=lambda a: -a.mass_kg)
    used: set[BodyId] = set()
    # A kinematic root may be moved one day, so what also reaches a static one should rather hang there.
    roots = sorted(fixed, key=lambda assembly: assembly.mobility is Mobility.KINEMATIC)
    _grow_trees(forest, roots, edges, ordered, used)
    for assembly in free:
        _grow_trees(forest, [assembly], edges, ordered, used)
    forest.groups = ordered
    return forest


def effective_mobility(body: Body) -> Mobility:
    """The body's mobility, where what is not said is static."""
    return body.physics.mobility or Mobility.STATIC


def _build_groups(forest: KinematicForest, registry: EntityRegistry, masses: Mapping[BodyId, float]) -> None:
    joined = _joints_by_body(registry)
    for id, body in registry.bodies.items():
        holder = registry.parents.get(id)
        if holder is None:
            continue
        if not (body.physics.is_dynamic and id in joined):
            forest.rigid_parents[id] = holder
            continue
        constraints = ", ".join(joined[id])
        text = f"{id} is attached to {holder}, but moves by its constraint {constraints}"
        forest.notes.append(SpawnNote(SpawnNoteKind.ATTACHMENT, (id, holder), text))
    tops = [id for id in registry.bodies if id not in forest.rigid_parents]
    for top in tops:
        assembly = RigidGroup(top, effective_mobility(registry.bodies[top]), 0.0)
        waiting = [top]
        while waiting:
            id = waiting.pop()
            assembly.bodies.append(id)
            assembly.mass_kg += masses.get(id, 0.0)
            forest.root_of[id] = top
            waiting.extend(child for child in registry.children(id) if forest.rigid_parents.get(child) == id)
        forest.groups[top] = assembly
    for id, holder in forest.rigid_parents.items():
        if registry.bodies[id].physics.is_dynamic:
            text = f"{id} is dynamic and attached to {holder}: it moves rigidly with it and adds its mass"
            forest.notes.append(SpawnNote(SpawnNoteKind.ATTACHMENT, (id, holder), text))


def _joints_by_body(registry: EntityRegistry) -> dict[BodyId, list[BodyId]]:
    """The constraints of each body that has some."""
    joined: dict[BodyId, list[BodyId]] = {}
    for constraint in registry.joints.values():
        joined.setdefault(constraint.parent, []).append(constraint.id)
        joined.setdefault(constraint.child, []).append(constraint.id)
    return joined


_Edges = dict[BodyId, list[tuple[BodyId, TreeJoint]]]


def _edges(forest: KinematicForest, joints: Iterable[Joint]) -> _Edges:
    """For each assembly, what it could hold: the other assembly's top, and the branch seen from here."""
    edges: _Edges = {}
    for constraint in joints:
        parent, child = forest.root_of[constraint.parent], forest.root_of[constraint.child]
        ids = (constraint.id, constraint.parent, constraint.child)
        if parent == child:
            text = f"{constraint.id} joins {constraint.parent} and {constraint.child}, which hang rigidly together"
            forest.notes.append(SpawnNote(SpawnNoteKind.JOINT, ids, text))
        elif not (forest.groups[parent].is_dynamic or forest.groups[child].is_dynamic):
            text = f"{constraint.id} joins {constraint.parent} and {constraint.child}, neither of which is dynamic"
            forest.notes.append(SpawnNote(SpawnNoteKind.JOINT, ids, text))
        elif not _all_free(constraint.linear, constraint.angular):
            edges.setdefault(parent, []).append((child, TreeJoint(constraint, constraint.parent, constraint.child)))
            edges.setdefault(child, []).append((parent, TreeJoint(constraint, constraint.child, constraint.parent)))
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
    """Grows trees from some roots over all that they reach, breadth first; `used` holds the constraints so far."""
    waiting: deque[RigidGroup] = deque()
    for root in roots:
        if root.root not in ordered:
            ordered[root.root] = root
            waiting.append(root)
    while waiting:
        here = waiting.popleft()
        for top, branch in edges.get(here.root, ()):
            if branch.joint.id in used:
                continue
            used.add(branch.joint.id)
            if top in ordered:
                forest.loop_joints.append(branch)
                text = f"{branch.joint.id} closes a loop of constraints and is held by an equality"
                forest.notes.append(SpawnNote(SpawnNoteKind.JOINT, (branch.joint.id,), text))
            else:
                forest.tree_joints[top] = branch
                ordered[top] = forest.groups[top]
                waiting.append(forest.groups[top])
