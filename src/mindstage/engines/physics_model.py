"""The physics model of a world: everything an engine simulates, computed once for all engines.

The model adds to a world what the map leaves open: rigid groups of attached bodies, kinematic trees of joints,
collision shapes, estimated masses, and pairs excluded from collision. A `PhysicsModelBuilder` keeps it up to date
through edits; poses come from the engine. `build_physics_model` returns it as values, which can be compared and sent to
a remote engine.

`joint_positions_from_poses` and `check_joint_limits` serve engines that do not report joint coordinates.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.actuators import ActuatorSet
from mindstage.engines.base import Actuator, SpawnNote, SpawnNoteKind
from mindstage.engines.collision_filter import (
    TOUCH_TOLERANCE_M,
    CollisionFilter,
    CollisionFilterInput,
    InteriorFloors,
    LooseOverlaps,
    compute_collision_filter,
    sorted_pair,
)
from mindstage.engines.editing import Performed, links_of, pose_row
from mindstage.engines.edits import RestoreBodies, SetActuators, SettledPose, SimulatedBodies
from mindstage.engines.entity_registry import AddResult, EntityRegistry
from mindstage.engines.environment_bounds import MAX_FALL_M, EnvironmentBounds, belongs_to_place
from mindstage.engines.ground import (
    Columns,
    Ground,
    find_balanced,
    find_columns,
    find_ground_height,
    find_resting,
    find_supported,
    ground_area,
    ground_notes,
)
from mindstage.engines.kinematic_tree import (
    JointAxis,
    KinematicForest,
    TreeJoint,
    build_kinematic_forest,
    is_ball,
    joint_coordinates,
    movable_axes,
    pose_from_joint_coordinates,
)
from mindstage.engines.mass_properties import MassProperties
from mindstage.engines.settling import KEPT_POSE_TOLERANCE_M, SettlingInput, nested_notes, settle
from mindstage.errors import PoseUnreachableError
from mindstage.scene import (
    IDENTITY,
    BodyId,
    CollisionShape,
    GeometryMap,
    Joint,
    Mobility,
    Pose,
    Vector,
)
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes
from mindstage.scene.collision_shapes import (
    CollisionShapeBatch,
    compile_geometry,
    fallback_collision_shape,
    wall_collision_shapes,
)
from mindstage.scene.edits import Attach, BodyEdit, Delete, Detach, Edit, SetPhysics, Spawn
from mindstage.scene.geometry import Inertia
from mindstage.scene.joint_kinematics import handles_by_body, is_floating, outward_joints
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_angle,
    quat_rotate,
)

__all__ = [
    "BodyModel",
    "JointModel",
    "PhysicsModel",
    "PhysicsModelBuilder",
    "build_physics_model",
    "check_joint_limits",
    "joint_positions_from_poses",
]


@dataclass(frozen=True, slots=True)
class BodyModel:
    """The model of one body."""

    size: Vector
    """Size [m]; an assumed one if the map has none."""
    root: BodyId
    """Root of its rigid group; the body itself if it is not attached."""
    pose_in_root: Pose
    """Pose in the frame of the root."""
    mobility: Mobility
    """Mobility of the group."""
    gravity: bool
    mass_kg: float
    """Given or estimated mass [kg]; 0 if it is unknown and not needed."""
    non_colliding: bool
    """Whether it collides with nothing."""
    collision_shapes: tuple[CollisionShape, ...]
    """Collision shapes in the body frame."""
    on_ground: bool = False
    """Whether it collides with the ground plane."""
    friction: float | None = None
    restitution: float | None = None
    inertia: Inertia | None = None
    """Mass distribution; None for that of the collision shapes."""


@dataclass(frozen=True, slots=True)
class JointModel:
    """A joint between two rigid groups, at least one of which is dynamic."""

    joint: Joint
    parent: BodyId
    """The end nearer to the root of the tree, which may be the child in the map."""
    child: BodyId
    parent_from_joint: Pose
    """The joint frame in that parent; joint coordinates are relative to it."""
    child_from_joint: Pose
    closes_loop: bool
    """Whether it closes a kinematic loop."""
    is_limited: bool = False
    """Whether its limits are narrower than those of the world."""
    drives: tuple[tuple[int, Actuator], ...] = ()
    """Its actuators, each with its axis as an index into `AXIS_NAMES`."""
    is_driven: bool = False
    """Whether it has actuators, or follows a joint that has some."""


@dataclass(frozen=True, slots=True)
class PhysicsModel:
    """The model of a world."""

    bodies: Mapping[BodyId, BodyModel]
    excluded_pairs: frozenset[tuple[BodyId, BodyId]]
    """Pairs that never collide, the lower id first; pairs within one rigid group are not listed."""
    joints: Mapping[BodyId, JointModel]
    """By joint id; without joints that have no effect."""
    ground: Ground | None = None
    """The assumed ground; None if there is none."""


def build_physics_model(builder: PhysicsModelBuilder) -> PhysicsModel:
    """The current model of a builder; call `update_collisions` first if anything was edited."""
    builder.order_forest()
    forest, masses = builder.forest, builder.masses()
    poses_in_root: dict[BodyId, Pose] = {}
    for group in forest.groups.values():
        for id in group.bodies:  # parents come before children
            parent = forest.rigid_parents.get(id)
            parent_pose = IDENTITY if parent is None else poses_in_root[parent]
            poses_in_root[id] = (
                IDENTITY
                if parent is None
                else pose_from_array(pose_multiply(normalized_pose_array(parent_pose), builder.attachment_poses[id]))
            )
    bodies = {id: _body_model(builder, forest, id, poses_in_root[id], masses[id]) for id in builder.registry.bodies}
    tree_joints = [(tree_joint, False) for tree_joint in forest.tree_joints.values()]
    tree_joints += [(tree_joint, True) for tree_joint in forest.loop_joints]
    joints = {
        tree_joint.joint.id: _joint_model(builder, tree_joint, closes_loop) for tree_joint, closes_loop in tree_joints
    }
    return PhysicsModel(bodies, frozenset(builder.excluded_pairs()), joints, builder.ground)


def _body_model(
    builder: PhysicsModelBuilder, forest: KinematicForest, id: BodyId, pose_in_root: Pose, mass_kg: float
) -> BodyModel:
    group = forest.groups[forest.root_of[id]]
    geometry = builder.geometry.get(id)
    return BodyModel(
        size=builder.mass_properties.size(id),
        root=group.root,
        pose_in_root=pose_in_root,
        mobility=group.mobility,
        gravity=builder.registry.bodies[id].physics.gravity is not False and id not in builder.actuators.weightless,
        mass_kg=mass_kg,
        non_colliding=id in builder.collision_filter.non_colliding,
        collision_shapes=builder.collision_shapes(id)[0],
        on_ground=builder.collides_with_ground(id),
        friction=geometry.friction if geometry else None,
        restitution=geometry.restitution if geometry else None,
        inertia=geometry.inertia if geometry else None,
    )


def _joint_model(builder: PhysicsModelBuilder, tree_joint: TreeJoint, closes_loop: bool) -> JointModel:
    parent_from_joint, child_from_joint = tree_joint.order_ends(builder.joint_frames[tree_joint.joint.id])
    frames = pose_from_array(parent_from_joint), pose_from_array(child_from_joint)
    id, mimic, table = tree_joint.joint.id, tree_joint.joint.mimic, builder.actuators
    return JointModel(
        tree_joint.joint,
        tree_joint.parent,
        tree_joint.child,
        *frames,
        closes_loop=closes_loop,
        is_limited=id in builder.simulated_joints,
        drives=tuple((table.axes[name], each) for name, each in table.actuators.items() if each.joint == id),
        is_driven=not table.driven_joints.isdisjoint((id, mimic.joint if mimic else id)),
    )


class PhysicsModelBuilder:
    """The registry of an engine, and the decisions that complete it to a physics model.

    Arguments `poses` are n x 7 with unit quaternions, in the order of `registry.ids`.
    """

    def __init__(self) -> None:
        self.registry = EntityRegistry()
        self.mass_properties = MassProperties(self.registry)
        self.collision_filter = CollisionFilter()
        self.attachment_poses: dict[BodyId, Array] = {}
        """Pose of each attached child in its parent's frame."""
        self.joint_frames: dict[BodyId, tuple[Array, Array]] = {}
        """Each joint's frame in the map's parent and in its child."""
        self.simulated_joints: dict[BodyId, Joint] = {}
        """Joints whose limits are narrower than those of the world, so that doors do not turn into their casing."""
        self.actuators = ActuatorSet()
        self.given_excluded_pairs: set[tuple[BodyId, BodyId]] = set()
        """Pairs that a spawn was told to exclude from collision, the lower id first."""
        self.late_notes: list[SpawnNote] = []
        """Notes on decisions caused by edits; those of a spawn are in its report."""
        self.settled: dict[BodyId, SettledPose] = {}
        """Bodies that a spawn moved out of others."""
        self.bounds: EnvironmentBounds | None = None
        """Bounds of the bodies when the last world was spawned."""
        self.ground: Ground | None = None
        """The assumed ground; None if there is none."""
        self._below_ground: set[BodyId] = set()
        """Loose bodies that were below the ground, or in it, when it was added."""
        self.uncertain_poses: frozenset[BodyId] = frozenset()
        """See `Spawn.uncertain_poses`."""
        self._forest: KinematicForest | None = None
        self._loose_roots: frozenset[BodyId] | None = None
        self._changed_bodies: set[BodyId] = set()
        self._collision_state = _CollisionState()

    def copy(self) -> PhysicsModelBuilder:
        """An independent copy with the same decisions."""
        result = PhysicsModelBuilder()
        result.registry, result.collision_filter = self.registry.copy(), self.collision_filter.copy()
        result.mass_properties = self.mass_properties.copy(result.registry)
        result.attachment_poses, result.joint_frames, result.late_notes = (
            dict(self.attachment_poses),
            dict(self.joint_frames),
            list(self.late_notes),
        )
        result.simulated_joints, result.actuators = dict(self.simulated_joints), self.actuators.copy()
        result.given_excluded_pairs = set(self.given_excluded_pairs)
        result._forest, result._changed_bodies, result._collision_state = (
            self._forest,
            set(self._changed_bodies),
            self._collision_state,
        )
        result.settled, result.bounds, result.ground = dict(self.settled), self.bounds, self.ground
        result._below_ground, result._loose_roots = set(self._below_ground), self._loose_roots
        result.uncertain_poses = self.uncertain_poses
        return result

    @property
    def forest(self) -> KinematicForest:
        """The current rigid groups and joint trees; see also `order_forest`."""
        if self._forest is None:
            self._forest = build_kinematic_forest(
                self.registry, self.mass_properties.approximate_masses(), simulated_joints=self.simulated_joints
            )
            self._loose_roots = None
        return self._forest

    def order_forest(self) -> None:
        """Brings the groups of the forest into the order in which models are compiled."""
        if self._forest is not None and not self._forest.is_ordered:
            self._forest = None

    @property
    def loose_roots(self) -> frozenset[BodyId]:
        """Roots of the rigid groups that no joint connects with a fixed group: they fall unless supported."""
        forest = self.forest
        if self._loose_roots is None:
            trees = forest.tree_roots()
            self._loose_roots = frozenset(root for root, tree in trees.items() if forest.groups[tree].is_dynamic)
        return self._loose_roots

    def is_loose(self, id: BodyId) -> bool:
        """Whether nothing connects a body with a fixed one."""
        return self.forest.root_of[id] in self.loose_roots

    def collides_with_ground(self, id: BodyId) -> bool:
        """Whether a body collides with the ground: loose bodies do, unless they were below it."""
        return self.ground is not None and id not in self._below_ground and self.is_loose(id)

    def simulation_flags(self) -> tuple[frozenset[BodyId], ...]:
        """For each decision that matters for models, the bodies of which it is true."""
        return (
            frozenset(self.collision_filter.non_colliding),
            frozenset(self.registry.immovable),
            frozenset(self._below_ground),
            self.loose_roots,
            frozenset(self.actuators.weightless),
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        """See `AssumingEngine`."""
        pairs = (
            f"{a} and {b} began inside each other: they do not collide until they are 1 mm apart"
            for a, b in sorted(self.collision_filter.temporary_pairs)
        )
        return (*(() if self.ground is None else (self.ground.assumption,)), *pairs)

    @property
    def geometry(self) -> GeometryMap:
        """Geometry of the bodies that have some."""
        return self.mass_properties.geometry

    def masses(self, ids: Iterable[BodyId] | None = None) -> dict[BodyId, float]:
        """Given masses, estimates for dynamic bodies without one, and 0 for others [kg]; by default of all bodies."""
        return {
            id: self.mass_properties.mass(id, is_dynamic=self._is_dynamic(id))
            for id in (self.registry.bodies if ids is None else ids)
        }

    def collision_shapes(self, id: BodyId) -> tuple[tuple[CollisionShape, ...], Array | None]:
        """Collision shapes of a body: wall panels if it is hollow, those of its geometry, or its primitive shape.

        Also returns their poses in the body frame, k x 7, or None for a single shape at the body's own pose.
        """
        panels = self.collision_filter.wall_panels.get(id)
        if panels is not None:
            shapes = wall_collision_shapes(panels)
            return shapes, pose_array(shape.pose for shape in shapes)
        if id in self.mass_properties.geometry:
            compiled = self.mass_properties.compiled(id)
            return compiled.shapes, compiled.poses
        return (fallback_collision_shape(self.registry.bodies[id], self.mass_properties.size(id)),), None

    def bodies_moving_with(self, id: BodyId) -> list[BodyId]:
        """A body and all bodies that move with it, attached or on joints."""
        forest = self.forest
        on_joint: dict[BodyId, list[BodyId]] = {}
        for root, tree_joint in forest.tree_joints.items():
            on_joint.setdefault(tree_joint.parent, []).append(root)
        result, stack = [], [id]
        while stack:
            body = stack.pop()
            result.append(body)
            stack += [child for child in self.registry.children(body) if forest.rigid_parents.get(child) == body]
            stack += on_joint.get(body, ())
        return result

    def connected_bodies(self, id: BodyId) -> list[BodyId]:
        """A body and all bodies that attachments and joints connect with it."""
        forest = self.forest
        trees, tree = forest.tree_roots(), forest.tree_root_of(forest.root_of[id])
        return [body for root in trees if trees[root] == tree for body in forest.groups[root].bodies]

    # -- edits -------------------------------------------------------------------------------------------------

    def apply(self, edit: Edit, poses: Array) -> Performed:
        """Makes an edit; setting poses is left to the engine, and so is restoring bodies.

        Args:
            edit: the edit.
            poses: poses of all bodies so far.

        Returns:
            The report of a spawn, and the poses of the bodies that have to be moved out of others, at rest.
        """
        match edit:
            case Spawn():
                return self._spawn(edit, poses)
            case Delete():
                self.remove(edit.bodies)
            case Attach():
                self._attach(edit.parent, edit.child, poses)
            case Detach():
                self._detach(edit.child)
            case BodyEdit():
                self._change_body(edit)
            case SetActuators():
                self.actuators.apply(edit, registry=self.registry, joints=self.simulated_joints)
        return Performed()

    def _spawn(self, edit: Spawn, poses: Array) -> Performed:
        """Adds a world, whose bodies are at their described poses."""
        self.update_collisions(poses)
        added = self.registry.add(edit.world)
        self.registry.immovable |= edit.immovable.intersection(added.bodies)
        self.uncertain_poses |= edit.uncertain_poses.intersection(added.bodies)
        bodies = self.registry.bodies
        self.given_excluded_pairs |= {sorted_pair(a, b) for a, b in edit.excluded_pairs if a in bodies and b in bodies}
        invalid_notes = self.mass_properties.add(added.bodies, edit.geometry)
        new_poses = pose_array(self.registry.bodies[id].pose for id in added.bodies)
        new_poses[:, 3:] = normalize(new_poses[:, 3:])
        poses = np.concatenate([poses, new_poses])
        self._record_frames(added, poses)
        outward_notes = [*self._limit_outwards(added), *self._mimic_notes(added)]
        if added.joints or added.attachments:
            self._forest = None
        else:
            self._extend_forest(added.bodies)
        notes = [*outward_notes, *self.mass_properties.assumption_notes(added.bodies, self._is_dynamic), *invalid_notes]
        new = {*added.bodies, *added.joints}
        notes += [note for note in self.forest.notes if new.intersection(note.ids)]
        excluded = set(self.collision_filter.excluded_pairs)
        collision_notes, loose = self._decide_collisions(set(added.bodies), poses, settles=edit.settle)
        notes += collision_notes
        moved = self._settle(loose, set(added.bodies), poses, notes) if loose.pairs else {}
        rows = self.registry.rows
        before = {id: poses[rows[id]].copy() for id in moved if id not in added.bodies}
        for id, pose in moved.items():
            poses[rows[id]] = pose
        notes += self._fix_non_colliding(added.bodies)
        self._mark_temporary(self.collision_filter.excluded_pairs - excluded, set(added.bodies))
        is_single = not (added.joints or added.attachments or moved)
        place_notes = self._update_place_near(added.bodies, poses, has_ground=edit.ground) if is_single else None
        if place_notes is None:
            place_notes = self._update_place(added.bodies, poses, has_ground=edit.ground)
        notes += place_notes
        return Performed(added.report(notes), moved, before)

    def remove(self, ids: Iterable[BodyId]) -> None:
        """Removes bodies; see `Delete`."""
        removed = {self.registry.body(id).id for id in ids}
        if not removed:
            return
        orphans = [child for id in removed for child in self.registry.children(id) if child not in removed]
        child_roots = [
            root
            for root, tree_joint in self.forest.tree_joints.items()
            if tree_joint.parent in removed and root not in removed
        ]
        forest = self.forest.without_single_bodies(removed) if self._are_single(removed) else None
        self.registry.remove(removed)
        self.mass_properties.remove(removed)
        for id in [*removed, *orphans]:
            self.attachment_poses.pop(id, None)
        self.joint_frames = {id: ends for id, ends in self.joint_frames.items() if id in self.registry.joints}
        self.simulated_joints = {id: each for id, each in self.simulated_joints.items() if id in self.registry.joints}
        self.given_excluded_pairs = {pair for pair in self.given_excluded_pairs if removed.isdisjoint(pair)}
        self.actuators.remove(removed, remaining_joints=self.registry.joints)
        self._changed_bodies -= removed
        self.collision_filter.remove(removed)
        self._below_ground -= removed
        self.uncertain_poses -= removed
        for id in removed:
            self.settled.pop(id, None)
        self._loose_roots = None if self._loose_roots is None else self._loose_roots - removed
        self._forest = forest
        self._changed_bodies.update(*(self.bodies_moving_with(id) for id in (*orphans, *child_roots)))

    def decisions(self, ids: Collection[BodyId]) -> SimulatedBodies:
        """How some bodies, their joints and attachments are simulated, to restore them after they were deleted."""
        kept, filtered = set(ids), self.collision_filter
        world = self.registry.fragment(ids)
        joints = {joint.id for joint in world.joints}
        actuators = tuple(each for each in self.actuators.actuators.values() if each.joint in joints)
        names, commands = {each.name for each in actuators}, self.actuators.commands
        return SimulatedBodies(
            attachment_poses={each.child: pose_row(self.attachment_poses[each.child]) for each in world.attachments},
            joint_frames={id: (pose_row(a), pose_row(b)) for id, (a, b) in self.joint_frames.items() if id in joints},
            simulated_joints={id: each for id, each in self.simulated_joints.items() if id in joints},
            excluded_pairs=frozenset(pair for pair in filtered.excluded_pairs if not kept.isdisjoint(pair)),
            temporary_pairs=frozenset(pair for pair in filtered.temporary_pairs if not kept.isdisjoint(pair)),
            given_excluded_pairs=frozenset(pair for pair in self.given_excluded_pairs if not kept.isdisjoint(pair)),
            non_colliding=frozenset(filtered.non_colliding & kept),
            wall_panels={id: panels for id, panels in filtered.wall_panels.items() if id in kept},
            contents={id: found for id, found in filtered.contents.items() if id in kept},
            actuators=actuators,
            commands={name: command for name, command in commands.items() if name in names},
            weightless=frozenset(self.actuators.weightless & kept),
            immovable=frozenset(self.registry.immovable & kept),
            settled={id: each for id, each in self.settled.items() if id in kept},
            below_ground=frozenset(self._below_ground & kept),
            uncertain_poses=self.uncertain_poses & kept,
            undecided=frozenset(self._changed_bodies),
        )

    def restore(self, edit: RestoreBodies, poses: Array) -> None:
        """Adds deleted bodies again as they were simulated.

        Args:
            edit: the edit.
            poses: poses of all bodies so far.

        Raises:
            BodyExistsError: an id is in use; nothing is added then.
        """
        before, restored = edit.decisions, set(edit.ids)
        self.registry.require_free(restored)
        neighbors = {end for link in links_of(edit.world) for end in (link.parent, link.child)}
        for id in neighbors & self.registry.bodies.keys():
            self._changed_bodies -= set(self.bodies_moving_with(id)) - before.undecided
        self.update_collisions(poses)
        joints, children = self.registry.restore(edit.world, before.immovable)
        self._forest = None
        self.mass_properties.add(restored, edit.geometry)
        self.attachment_poses |= {id: np.array(before.attachment_poses[id]) for id in children}
        self.joint_frames |= {
            id: (np.array(a), np.array(b)) for id, (a, b) in before.joint_frames.items() if id in joints
        }
        self.simulated_joints |= {id: each for id, each in before.simulated_joints.items() if id in joints}
        self.collision_filter.restore(before, existing=self.registry.bodies.keys())
        self.given_excluded_pairs |= {
            pair for pair in before.given_excluded_pairs if self.registry.bodies.keys() >= set(pair)
        }
        self.actuators.restore(before, registry=self.registry, joints=self.simulated_joints)
        self.settled |= before.settled
        self._below_ground |= before.below_ground
        self.uncertain_poses |= before.uncertain_poses
        self._changed_bodies |= before.undecided & restored
        self._collision_state = _CollisionState(self.forest, tuple(self.registry.joints.values()))

    def _attach(self, parent: BodyId, child: BodyId, poses: Array) -> None:
        self.registry.attach(parent, child)
        rows = [self.registry.rows[id] for id in (parent, child)]
        self.attachment_poses[child] = pose_multiply(pose_inverse(poses[rows[0]]), poses[rows[1]])
        self._forest = None

    def _detach(self, child: BodyId) -> None:
        if self.registry.body(child).id not in self.registry.parents:
            return
        self.registry.detach(child)
        self.attachment_poses.pop(child, None)
        self._forest = None
        self._changed_bodies.update(self.bodies_moving_with(child))

    def _change_body(self, edit: BodyEdit) -> None:
        self.registry.change(edit)
        if not isinstance(edit, SetPhysics):
            return  # the others are not simulated
        id = edit.id
        if self._are_single({id}):
            self._forest = self.forest.without_single_bodies({id})
            self._loose_roots = self._loose_roots and self._loose_roots - {id}
            self._extend_forest([id])
        else:
            self._forest = None
        self._changed_bodies.update(self.bodies_moving_with(id))
        self.late_notes += self.mass_properties.assumption_notes([id], self._is_dynamic)

    def update_attachment_pose(self, id: BodyId, target: Array, poses: Array) -> None:
        """Updates the attachment of a body that is moved to a target pose."""
        parent = self.forest.rigid_parents.get(id)
        if parent is not None:
            self.attachment_poses[id] = pose_multiply(pose_inverse(poses[self.registry.rows[parent]]), target)

    def update_collisions(self, poses: Array) -> None:
        """Updates collision decisions after edits; appends to `late_notes`."""
        if self._changed_bodies:
            notes, _ = self._decide_collisions(self._changed_bodies, poses, settles=False)
            self.late_notes += notes

    # -- collisions -----------------------------------------------------------------------------------------------

    def excluded_pairs(self) -> set[tuple[BodyId, BodyId]]:
        """All pairs that never collide, the lower id first: overlapping bodies, and parts connected by joints.

        Pairs within one rigid group are not listed.
        """
        return {*self.overlapping_pairs(), *self.jointed_pairs()}

    def overlapping_pairs(self) -> set[tuple[BodyId, BodyId]]:
        """Those of the pairs that never collide which overlap, or were given with a spawn."""
        root_of, pairs = self.forest.root_of, self.collision_filter.excluded_pairs | self.given_excluded_pairs
        return {pair for pair in pairs if root_of[pair[0]] != root_of[pair[1]]}

    def jointed_pairs(self) -> frozenset[tuple[BodyId, BodyId]]:
        """Those of the pairs that never collide which joints connect."""
        groups = self.forest.groups
        return frozenset(
            sorted_pair(a, b)
            for first, second in self._jointed_groups()
            for a in groups[first].bodies
            for b in groups[second].bodies
        )

    def _jointed_groups(self) -> set[tuple[BodyId, BodyId]]:
        """Pairs of group roots: the two ends of a joint, and a door with whatever else is fixed to its case."""
        forest = self.forest
        neighbors: dict[BodyId, set[BodyId]] = {}
        for joint in self.registry.joints.values():
            if _disables_collision(joint):
                first, other = forest.root_of[joint.parent], forest.root_of[joint.child]
                neighbors.setdefault(first, set()).add(other)
                neighbors.setdefault(other, set()).add(first)
        pairs = {(first, other) for first, others in neighbors.items() for other in others if first < other}
        for root, tree_joint in forest.tree_joints.items():
            adjacent = neighbors.get(forest.root_of[tree_joint.parent], ())
            fixed = (other for other in adjacent if not forest.groups[other].is_dynamic)
            pairs |= {sorted_pair(root, other) for other in fixed if other != root}
        return pairs

    def _extend_forest(self, ids: Iterable[BodyId]) -> None:
        """Adds bodies to the forest that are neither attached nor on joints, if it is known."""
        if self._forest is None:
            return
        mobilities = {id: self.registry.mobility(id) for id in ids}
        masses = {id: self.mass_properties.mass(id, is_dynamic=True) for id in mobilities}
        self._forest = self._forest.with_single_bodies(mobilities, masses)
        if self._loose_roots is not None:
            self._loose_roots |= {id for id, mobility in mobilities.items() if mobility is Mobility.DYNAMIC}

    def _are_single(self, ids: Collection[BodyId]) -> bool:
        """Whether some bodies are neither attached nor on joints, and nothing is attached to them."""
        forest, joints = self.forest, self.registry.joints.values()
        jointed = {end for joint in joints for end in (joint.parent, joint.child)}
        alone = jointed.isdisjoint(ids) and self.registry.parents.keys().isdisjoint(ids)
        return alone and all(len(forest.groups[id].bodies) == 1 and not self.registry.children(id) for id in ids)

    def _is_dynamic(self, id: BodyId) -> bool:
        """Whether the body's group is dynamic."""
        return self.forest.groups[self.forest.root_of[id]].is_dynamic

    def _record_frames(self, added: AddResult, poses: Array) -> None:
        """Records poses of attached children in their parents, and joint frames in both bodies."""
        if not (added.attachments or added.joints):
            return
        rows = self.registry.rows
        holders = [rows[self.registry.parents[child]] for child in added.attachments]
        children = [rows[child] for child in added.attachments]
        self.attachment_poses.update(
            zip(added.attachments, pose_multiply(pose_inverse(poses[holders]), poses[children]), strict=True)
        )
        joints = [self.registry.joints[id] for id in added.joints]
        frames = pose_array(joint.pose for joint in joints)
        frames[:, 3:] = normalize(frames[:, 3:])
        parent_from_joint = pose_multiply(pose_inverse(poses[[rows[joint.parent] for joint in joints]]), frames)
        child_from_joint = pose_multiply(pose_inverse(poses[[rows[joint.child] for joint in joints]]), frames)
        self.joint_frames.update(zip(added.joints, zip(parent_from_joint, child_from_joint, strict=True), strict=True))

    def _limit_outwards(self, added: AddResult) -> list[SpawnNote]:
        """Limits new joints that would let a door or drawer move into its casing; the world keeps their limits."""
        if not added.joints:
            return []
        bodies = self.registry.bodies
        handles = handles_by_body(bodies, self.registry.parents)
        limited = outward_joints([self.registry.joints[id] for id in added.joints], bodies, handles)
        self.simulated_joints.update({id: each.joint for id, each in limited.items()})
        if len(limited) <= _MAX_LISTED:
            return [SpawnNote(SpawnNoteKind.JOINT, (id,), each.text) for id, each in limited.items()]
        example = next(iter(limited.values())).text
        text = f"{len(limited)} joints would let doors and drawers move into their casings, and only open outwards"
        return [SpawnNote(SpawnNoteKind.JOINT, tuple(limited), f"{text}; {example}")]

    def _mimic_notes(self, added: AddResult) -> Iterator[SpawnNote]:
        """Yields notes about joints that mimic a joint which is not there."""
        for id in added.joints:
            mimic = self.registry.joints[id].mimic
            if mimic is not None and (mimic.joint not in self.registry.joints or mimic.joint == id):
                text = f"{id} mimics {mimic.joint!r}, which is not another joint here; it moves independently"
                yield SpawnNote(SpawnNoteKind.JOINT, (id,), text)

    def _decide_collisions(
        self, new_ids: set[BodyId], poses: Array, *, settles: bool
    ) -> tuple[list[SpawnNote], LooseOverlaps]:
        """Decides which of the new bodies collide with one another and with the others.

        Args:
            new_ids: the bodies that were added or changed.
            poses: poses of all bodies.
            settles: whether loose bodies may be moved out of others, which is left to the caller.
        """
        forest = self.forest
        previous, state = self._collision_state, _CollisionState(forest, tuple(self.registry.joints.values()))
        self._collision_state, self._changed_bodies = state, set()
        rows = self._rows_near(new_ids, poses, state)
        if rows is not None and len(rows) <= 1:
            return [], LooseOverlaps()  # nothing is near a single new body
        all_ids = self.registry.ids
        ids = all_ids if rows is None else tuple(all_ids[row] for row in rows)
        poses = poses if rows is None else poses[rows]
        roots = [forest.root_of[id] for id in ids]
        indices = {root: index for index, root in enumerate(dict.fromkeys(roots))}
        filter_input = CollisionFilterInput(
            ids=ids,
            poses=poses,
            sizes=self.mass_properties.sizes(ids),
            group=np.array([indices[root] for root in roots], dtype=np.intp),
            is_dynamic=np.array([forest.groups[root].is_dynamic for root in roots], dtype=bool),
            is_free=np.array(
                [forest.groups[root].is_dynamic and root not in state.neighbors for root in roots], dtype=bool
            ),
            is_new=np.array([id in new_ids for id in ids], dtype=bool),
            jointed_pairs=state.jointed_pairs_as_numbers(indices),
            overlap_boxes=self.mass_properties.overlap_boxes(ids, poses),
            collision_shapes=self.mass_properties.collision_shape_batch(ids, poses),
            has_geometry=self.mass_properties.has_geometry_mask(ids),
            tree=self._tree_numbers(ids) if settles else None,
            is_loose=np.array([root in self.loose_roots for root in roots], dtype=bool) if settles else None,
            floors=self._interior_floors(ids, poses) if settles else None,
            could_collide_before=lambda a, b: (
                previous.could_collide(ids[a], ids[b]) or sorted_pair(ids[a], ids[b]) in self.given_excluded_pairs
            ),  # pairs that are excluded anyway need no decision
        )
        self.collision_filter, notes, loose = compute_collision_filter(filter_input, self.collision_filter)
        return notes, loose if rows is None else loose.with_rows(rows)

    def _interior_floors(self, ids: Sequence[BodyId], poses: Array) -> InteriorFloors:
        """The surfaces inside of bodies, which are at poses."""
        owners, centers, halves = list[int](), list[Vector](), list[Array]()
        for row, id in enumerate(ids):
            geometry = self.geometry.get(id)
            for surface in geometry.support_surfaces if geometry else ():
                if surface.is_inside:
                    owners.append(row)
                    centers.append(surface.center)
                    halves.append(np.insert(surface.size, int(np.argmax(np.abs(surface.normal))), 0.0) / 2)
        at = poses[owners].copy()
        at[:, :3] += quat_rotate(at[:, 3:], np.reshape(centers, (-1, 3)))
        boxes = OrientedBoxes.from_poses(at, 2 * np.reshape(halves, (-1, 3)))
        return InteriorFloors(np.array(owners, dtype=np.intp), *boxes.bounds())

    def _rows_near(self, new_ids: set[BodyId], poses: Array, state: _CollisionState) -> list[int] | None:
        """Rows of the bodies on which the decisions about a few new bodies depend, in order; None for all.

        They are the bodies whose bounds meet those of a new one, their groups, what the hollow ones of them contain,
        and the groups that joints connect to them: the doors and drawers of a cabinet.
        """
        ids, forest = self.registry.ids, self.forest
        if not 0 < len(new_ids) <= _MAX_LOCAL_BODIES or len(ids) <= _MAX_LOCAL_BODIES:
            return None
        radii = self.mass_properties.bounding_radii(ids)
        new_rows = [ids.index(id) for id in new_ids]
        is_near = np.zeros(len(ids), dtype=bool)
        for row in new_rows:
            offsets = poses[:, :3] - poses[row, :3]
            reach = radii + (radii[row] + TOUCH_TOLERANCE_M)
            is_near |= np.einsum("ni,ni->n", offsets, offsets) <= reach * reach
        near = np.flatnonzero(is_near)
        near_ids = [ids[row] for row in near.tolist()]
        low, high = self.mass_properties.overlap_boxes(near_ids, poses[near]).bounds()
        meets = np.zeros(len(near), dtype=bool)
        for row in np.searchsorted(near, new_rows):
            meets |= np.all((low <= high[row]) & (high >= low[row]), axis=1)
        found = {id for id, meeting in zip(near_ids, meets.tolist(), strict=True) if meeting}
        if found == new_ids:
            return sorted(new_rows)
        roots = {forest.root_of[id] for id in found}
        roots.update(*(state.neighbors.get(root, ()) for root in roots))
        found.update(*(self.collision_filter.contents.get(id, ()) for id in found))
        found.update(*(forest.groups[root].bodies for root in roots))
        return [row for row, id in enumerate(ids) if id in found]

    def _tree_numbers(self, ids: Iterable[BodyId]) -> NDArray[np.intp]:
        """For each body, a number of the tree of its group."""
        forest, numbers = self.forest, dict[BodyId, int]()
        trees = (forest.tree_root_of(forest.root_of[id]) for id in ids)
        return np.array([numbers.setdefault(tree, len(numbers)) for tree in trees], dtype=np.intp)

    def _mark_temporary(self, pairs: Iterable[tuple[BodyId, BodyId]], new_ids: Collection[BodyId]) -> None:
        """Excluded pairs that collide again once they were apart: bodies that were added to others, and loose ones.

        Parts that one world describes as overlapping, such as a drawer and its casing, have to return to each other.
        """
        root_of = self.forest.root_of
        for a, b in pairs:
            jointed = self._collision_state.jointed_roots
            is_added_to = (a in new_ids) is not (b in new_ids)
            is_part = sorted_pair(root_of[a], root_of[b]) in jointed or (a, b) in self.given_excluded_pairs
            if not is_part and (is_added_to or (self.is_loose(a) and self.is_loose(b))):
                self.collision_filter.temporary_pairs.add((a, b))

    def separated_pairs(self, poses: Array, *, are_touching: bool = False) -> set[tuple[BodyId, BodyId]]:
        """The temporarily excluded pairs that are apart now.

        MuJoCo's own distance is not used: it is positive for some boxes that are deep inside each other.

        Args:
            poses: poses of all bodies.
            are_touching: whether those are included that overlap by at most as much as others have to be apart.
        """
        pairs = sorted(self.collision_filter.temporary_pairs)
        place = {id: number for number, id in enumerate(dict.fromkeys(id for pair in pairs for id in pair))}
        rows = {id: row for row, id in enumerate(self.registry.ids) if id in place}
        compiled = [compile_geometry(self.collision_shapes(id)[0]) for id in place]
        shapes = CollisionShapeBatch.from_compiled(poses[[rows[id] for id in place]], compiled)
        ends = np.array([[place[id] for id in pair] for pair in pairs], dtype=np.intp)
        depths = shapes.penetration_depths(ends[:, 0], ends[:, 1], np.zeros(len(pairs)), margin_m=_APART_M)
        largest_m = _APART_M if are_touching else -_APART_M
        return {pair for pair, depth in zip(pairs, depths.tolist(), strict=True) if depth <= largest_m}

    def include_pairs(self, pairs: Collection[tuple[BodyId, BodyId]]) -> None:
        """Lets pairs collide again that were apart; appends to `late_notes`."""
        self.collision_filter.excluded_pairs -= set(pairs)
        self.collision_filter.temporary_pairs -= set(pairs)
        self.late_notes += [
            SpawnNote(SpawnNoteKind.OVERLAP, (a, b), f"{a} and {b} are apart: they collide from now on")
            for a, b in sorted(pairs)
        ]

    # -- rest --------------------------------------------------------------------------------------------------------

    def _settle(
        self, loose: LooseOverlaps, new_ids: set[BodyId], poses: Array, notes: list[SpawnNote]
    ) -> dict[BodyId, Array]:
        """Moves loose bodies out of what they overlap; returns the new poses, and appends notes."""
        ids, forest = self.registry.ids, self.forest
        compiled = [compile_geometry(self.collision_shapes(id)[0]) for id in ids]
        rows = {id: row for row, id in enumerate(ids)}
        excluded = [(rows[a], rows[b]) for a, b in self.collision_filter.excluded_pairs]
        settlement = settle(
            SettlingInput(
                ids=ids,
                shapes=CollisionShapeBatch.from_compiled(poses, compiled),
                tree=self._tree_numbers(ids),
                is_loose=np.array([self.is_loose(id) for id in ids], dtype=bool),
                is_new=np.array([id in new_ids for id in ids], dtype=bool),
                is_ignored=np.array([id in self.collision_filter.non_colliding for id in ids], dtype=bool),
                excluded_pairs=frozenset((*excluded, *((b, a) for a, b in excluded), *loose.nested)),
                overlaps=loose.pairs,
            )
        )
        notes += settlement.notes
        for a, b in (*settlement.nested_pairs, *settlement.stuck_pairs):
            self.collision_filter.excluded_pairs.add(sorted_pair(ids[a], ids[b]))
        if settlement.nested_pairs:
            notes += nested_notes([(ids[a], ids[b]) for a, b in settlement.nested_pairs])
        if settlement.stuck:
            self.make_immovable(forest.root_of[ids[row]] for row in settlement.stuck)
        moved = {}
        for row, shift in settlement.shifts.items():
            moved[ids[row]] = np.concatenate([poses[row, :3] + shift, poses[row, 3:]])
            self.settled[ids[row]] = SettledPose(
                pose=pose_row(moved[ids[row]]), before=pose_row(poses[row]), shift_m=float(np.linalg.norm(shift))
            )
        return moved

    def _fix_non_colliding(self, new_ids: Iterable[BodyId]) -> list[SpawnNote]:
        """Makes loose bodies static that collide with nothing, since they would fall for ever."""
        ignored = [id for id in new_ids if id in self.collision_filter.non_colliding and self.is_loose(id)]
        if not ignored:
            return []
        self.make_immovable(self.forest.root_of[id] for id in ignored)
        text = f"{len(ignored):,} loose bodies that collide with nothing are simulated as static"
        return [SpawnNote(SpawnNoteKind.IMMOVABLE, tuple(ignored), text)]

    def make_immovable(self, ids: Iterable[BodyId]) -> None:
        """Makes dynamic bodies static, until their physics is replaced; the description keeps their mobility."""
        self.registry.immovable.update(ids)
        self._forest = None

    def stop_fallen(self, positions: Mapping[BodyId, Array]) -> list[BodyId]:
        """Makes loose bodies static that fell far below the place; returns them, and appends to `late_notes`.

        Args:
            positions: those of roots of loose groups, 3 each [m].
        """
        bounds = self.bounds
        if bounds is None:
            return []
        fallen = [id for id, at in positions.items() if bounds.falls_for_ever(at) and id not in self.registry.immovable]
        for id in fallen:
            below = f"{MAX_FALL_M:g} m below what is loose and its floor, and above nothing"
            text = f"{id} fell to {bounds.fall_limit_m:.3g} m, {below}: it is stopped there"
            self.late_notes.append(SpawnNote(SpawnNoteKind.STOPPED, (id,), text))
        if fallen:
            self.make_immovable(fallen)
        return fallen

    def mark_simulated(self) -> None:
        """Must be called before time advances: from then on, snapshots show bodies where the spawn moved them.

        Those that it moved slightly keep their described pose, as long as they stay there.
        """
        if self.settled:
            self.settled = {id: each for id, each in self.settled.items() if each.shift_m <= KEPT_POSE_TOLERANCE_M}

    def described_if_settled(self, poses: Array) -> Array:
        """The poses for a snapshot: those before a spawn for bodies that still are where it moved them."""
        if not self.settled:
            return poses
        poses, rows = poses.copy(), self.registry.rows
        for id, settled in self.settled.items():
            row = rows[id]
            at = np.array(settled.pose)
            is_near = np.abs(poses[row, :3] - at[:3]).max() <= _RESTING_TOLERANCE
            if is_near and float(quat_angle(poses[row, 3:], at[3:])) <= _RESTING_TOLERANCE:
                poses[row] = settled.before
        return poses

    def _update_place(self, new_ids: Sequence[BodyId], poses: Array, *, has_ground: bool) -> list[SpawnNote]:
        """Updates the bounds of the place, and the ground below it.

        A ground stays where it is as long as a body needs it, unless one that is added begins below it, or a fixed body
        that is added is lower.
        """
        ids, before = self.registry.ids, self.ground
        boxes = self.mass_properties.overlap_boxes(ids, poses)
        is_loose = np.array([self.is_loose(id) for id in ids], dtype=bool)
        self.bounds = EnvironmentBounds.from_boxes(boxes, is_loose)
        if not has_ground:
            return []
        is_new = np.arange(len(ids)) >= len(ids) - len(new_ids)
        belongs, low = belongs_to_place(boxes), boxes.bounds()[0][:, 2]
        is_certain = np.array([id not in self.uncertain_poses for id in ids], dtype=bool)
        hanging, unbalanced = self._unsupported_rows(np.flatnonzero(is_loose & belongs), poses)
        needs = np.union1d(hanging, unbalanced)
        if not len(needs):
            self.ground, self._below_ground = None, set()
            return []
        is_hanging, is_decided = np.isin(np.arange(len(ids)), hanging), ~is_new
        if (
            before is None
            or (low[needs[is_new[needs]]] < before.height_m - _IN_GROUND_M).any()
            or (low[is_new & ~is_loose & belongs & is_certain] < before.height_m - _GROUND_TOLERANCE_M).any()
        ):
            height_m = find_ground_height(
                boxes, belongs=belongs, is_loose=is_loose, unsupported=is_hanging, is_certain=is_certain
            )
            if before is None or abs(height_m - before.height_m) > _IN_GROUND_M:
                self._below_ground, is_decided[:] = set(), False
            else:
                height_m = before.height_m
        else:
            height_m = before.height_m
        is_lower = low < height_m - _IN_GROUND_M
        self._below_ground |= {ids[row] for row in np.flatnonzero(is_lower & is_loose & ~is_decided).tolist()}
        collides = np.array([id not in self.collision_filter.non_colliding for id in ids], dtype=bool)
        area = ground_area(boxes, needs=needs) if np.any(is_lower & collides & ~is_hanging) else None
        self.ground = Ground(height_m, tuple(ids[row] for row in needs.tolist()), area)
        return ground_notes(
            height_m,
            hanging=[ids[row] for row in hanging.tolist() if not is_decided[row]],
            unbalanced=[ids[row] for row in unbalanced.tolist() if not is_decided[row]],
        )

    def _update_place_near(
        self, new_ids: Sequence[BodyId], poses: Array, *, has_ground: bool
    ) -> list[SpawnNote] | None:
        """Does the same as `_update_place` for a few new bodies, without those far away; None if these matter.

        The bodies must be neither attached nor on joints. The bounds only grow, and a ground stays where it is.
        """
        ids, bounds = self.registry.ids, self.bounds
        if not 0 < len(new_ids) <= _MAX_LOCAL_BODIES < len(ids) or bounds is None:
            return None
        is_loose = np.array([self.is_loose(id) for id in new_ids], dtype=bool)
        first, ground = len(ids) - len(new_ids), self.ground
        boxes = self.mass_properties.overlap_boxes(new_ids, poses[first:])
        belongs, (low, high) = bounds.includes(boxes), boxes.bounds()
        notes = []
        if has_ground:
            if ground is not None and (
                ground.area is not None or not is_loose.all() or (low[:, 2] < ground.height_m - _IN_GROUND_M).any()
            ):
                return None  # they may change its height or area, or be a support for what is on it
            hanging, unbalanced = self._unsupported_rows(first + np.flatnonzero(is_loose & belongs), poses)
            needs = [ids[row] for row in np.union1d(hanging, unbalanced).tolist()]
            if needs and ground is None:
                return None  # a ground is added
            if needs and ground is not None:
                self.ground = ground._replace(bodies=(*ground.bodies, *needs))
                notes = ground_notes(
                    ground.height_m,
                    hanging=[ids[row] for row in hanging.tolist()],
                    unbalanced=[ids[row] for row in unbalanced.tolist()],
                )
        self.bounds = bounds.extended(low[belongs], high[belongs])
        return notes

    def _unsupported_rows(self, loose: Indices, poses: Array) -> tuple[Indices, Indices]:
        """Those of some loose bodies, by their rows, that have nothing below them; and those that may fall past it.

        Args:
            loose: the rows of all bodies of some loose trees.
            poses: poses of all bodies.
        """
        ids = self.registry.ids
        if not len(loose):
            return loose, loose
        names = [ids[row] for row in loose.tolist()]
        tree = self._tree_numbers(names)
        non_colliding = self.collision_filter.non_colliding
        near = np.flatnonzero(self._may_be_below(loose, poses)).tolist()
        fixed = [row for row in near if ids[row] not in non_colliding and not self.is_loose(ids[row])]
        shapes = [compile_geometry(self.collision_shapes(ids[row])[0]) for row in fixed]
        supports = CollisionShapeBatch.from_compiled(poses[fixed], shapes).boxes
        rests = find_resting(self._mass_centers(names, tree, poses[loose]), supports)[tree]
        left, resting = loose[~rests], {id for id, done in zip(names, rests.tolist(), strict=True) if done}
        if not len(left):
            return left, left
        rows, columns = self._columns(left, poses, resting)
        names = [ids[row] for row in rows.tolist()]
        tree = self._tree_numbers(names)
        is_held = np.array([id in resting or not self.is_loose(id) for id in names], dtype=bool)
        supported = find_supported(columns, tree, ~is_held)
        balanced = find_balanced(columns, tree, ~is_held, self._mass_centers(names, tree, poses[rows]))
        asked = np.isin(rows, left)
        return rows[asked & ~supported], rows[asked & supported & ~balanced]

    def _columns(self, loose: Indices, poses: Array, resting: Collection[BodyId]) -> tuple[Indices, Columns]:
        """What is below some loose bodies, and below the loose ones of that unless they are known to rest.

        Returns the rows of all of these bodies; the columns number the bodies by their places in these rows.
        """
        ids, non_colliding = self.registry.ids, self.collision_filter.non_colliding
        excluded = self.collision_filter.excluded_pairs | self.given_excluded_pairs
        seen = np.isin(np.arange(len(ids)), loose)
        while True:
            near = np.flatnonzero(seen | self._may_be_below(np.flatnonzero(seen), poses))
            names = [ids[row] for row in near.tolist()]
            number = {id: place for place, id in enumerate(names)}
            shapes = [compile_geometry(() if id in non_colliding else self.collision_shapes(id)[0]) for id in names]
            columns = find_columns(
                CollisionShapeBatch.from_compiled(poses[near], shapes),
                is_upper=seen[near],
                tree=self._tree_numbers(names),
                excluded=[(number[a], number[b]) for a, b in excluded if a in number and b in number],
            )
            lower = {ids[near[place]] for place in np.unique(columns.lower).tolist()} - set(resting)
            found = {each for id in lower if self.is_loose(id) for each in self.connected_bodies(id)}
            before = np.count_nonzero(seen)
            seen[[row for row, id in enumerate(ids) if id in found]] = True
            if np.count_nonzero(seen) == before:
                return near, columns

    def _may_be_below(self, rows: Indices, poses: Array) -> NDArray[np.bool_]:
        """Whether each body may be in the column of one of some others; all may be if these are many."""
        if len(rows) > _MAX_LOCAL_BODIES:
            return np.ones(len(poses), dtype=bool)
        radii = self.mass_properties.bounding_radii(self.registry.ids)
        offsets = poses[None, :, :2] - poses[rows, None, :2]
        reach = radii + radii[rows, None]
        return np.asarray((np.einsum("lni,lni->ln", offsets, offsets) <= reach * reach).any(axis=0))

    def _mass_centers(self, ids: Sequence[BodyId], tree: Indices, poses: Array) -> Array:
        """The center of mass of each tree, k x 3 [m]."""
        masses = np.array([self.mass_properties.mass(id, is_dynamic=True) for id in ids])
        local = np.array([self.mass_properties.center_of_mass(id) for id in ids])
        moments = masses[:, None] * (poses[:, :3] + quat_rotate(poses[:, 3:], local))
        totals = np.bincount(tree, weights=masses)
        sums = [np.bincount(tree, weights=column) for column in moments.T]
        return np.asarray(np.stack(sums, axis=1) / np.maximum(totals, 1e-12)[:, None])


_RESTING_TOLERANCE = 1e-3
"""A resting body is at most this far from where it was put [m, rad]."""
_APART_M = 0.001
"""Pairs that overlapped collide again once they were so far apart [m]."""
_GROUND_TOLERANCE_M = 0.05
"""The ground stays where it is unless a fixed body that is added is lower by more [m]."""
_IN_GROUND_M = 0.02
"""A body that is lower than the ground by more does not collide with it: it would be thrown out [m]."""


_MAX_LOCAL_BODIES = 8
"""For at most so many new bodies, collisions are decided with the bodies near them instead of with all."""


@dataclass(frozen=True)
class _CollisionState:
    """Which groups could collide when that was last decided; computed on first use."""

    forest: KinematicForest = field(default_factory=KinematicForest)
    joints: tuple[Joint, ...] = ()

    @cached_property
    def neighbors(self) -> Mapping[BodyId, set[BodyId]]:
        """For each group on joints, by its root: the roots of the groups at the other ends, itself included."""
        found: dict[BodyId, set[BodyId]] = {}
        for joint in self.joints:
            ends = {self.forest.root_of[joint.parent], self.forest.root_of[joint.child]}
            for root in ends:
                found.setdefault(root, set()).update(ends)
        return found

    @cached_property
    def jointed_roots(self) -> frozenset[tuple[BodyId, BodyId]]:
        """Pairs of roots whose collisions a joint disables."""
        root_of = self.forest.root_of
        return frozenset(
            sorted_pair(root_of[joint.parent], root_of[joint.child])
            for joint in self.joints
            if _disables_collision(joint)
        )

    def jointed_pairs_as_numbers(self, indices: Mapping[BodyId, int]) -> frozenset[tuple[int, int]]:
        """The jointed pairs of the groups that have an index, as indices, the lower one first."""
        pairs = ((a, b) for a, b in self.jointed_roots if a in indices and b in indices)
        return frozenset(sorted_pair(indices[a], indices[b]) for a, b in pairs)

    def could_collide(self, first: BodyId, second: BodyId) -> bool:
        """Whether two bodies that existed then could collide."""
        groups, a, b = self.forest.groups, self.forest.root_of.get(first), self.forest.root_of.get(second)
        if a is None or b is None or a == b or sorted_pair(a, b) in self.jointed_roots:
            return False
        return groups[a].is_dynamic or groups[b].is_dynamic


def _disables_collision(joint: Joint) -> bool:
    """Whether the bodies that a joint connects do not collide; those of one that constrains nothing do, if not told."""
    return not is_floating(joint) if joint.disable_collision is None else joint.disable_collision


_MAX_LISTED = 3
"""Number of joints with a common note from which the note is given once, with an example."""
_REACH_TOLERANCE_M, _REACH_TOLERANCE_RAD = 1e-6, 1e-6


def joint_positions_from_poses(
    builder: PhysicsModelBuilder, poses: Mapping[BodyId, Array]
) -> dict[BodyId, tuple[float, ...]]:
    """Displacement of each movable joint, computed from poses; see `Engine.joint_positions`.

    Args:
        builder: the physics model.
        poses: current poses of all bodies.
    """
    positions = {}
    for tree_joint in builder.forest.tree_joints.values():
        joint = tree_joint.joint
        if axes := movable_axes(joint, is_reversed=tree_joint.is_reversed):
            parent_from_joint, child_from_joint = builder.joint_frames[joint.id]
            fixed = pose_multiply(poses[joint.parent], parent_from_joint)
            moving = pose_multiply(poses[joint.child], child_from_joint)
            positions[joint.id] = tuple(joint_coordinates(pose_multiply(pose_inverse(fixed), moving), axes).tolist())
    return positions


def check_joint_limits(
    builder: PhysicsModelBuilder, id: BodyId, target: Array, poses: Mapping[BodyId, Array], *, tolerance: float = 0.0
) -> None:
    """Checks that a body on a joint can reach a pose.

    Args:
        builder: the physics model.
        id: the root of a group on a joint.
        target: the requested pose.
        poses: current poses of all bodies.
        tolerance: accuracy of the engine's poses [m, rad].

    Raises:
        PoseUnreachableError: the joint does not allow the pose.
    """
    tree_joint = builder.forest.tree_joints[id]
    axes = movable_axes(tree_joint.joint, is_reversed=tree_joint.is_reversed)
    if not axes:
        raise PoseUnreachableError(id, reason=f"the joint {tree_joint.joint.id!r} is locked")
    parent_from_joint, child_from_joint = tree_joint.order_ends(builder.joint_frames[tree_joint.joint.id])
    fixed = pose_multiply(poses[tree_joint.parent], parent_from_joint)
    wanted_child = pose_multiply(target, pose_multiply(pose_inverse(poses[id]), poses[tree_joint.child]))
    wanted_relative = pose_multiply(pose_inverse(fixed), pose_multiply(wanted_child, child_from_joint))
    coordinates = joint_coordinates(wanted_relative, axes)
    for axis in axes:
        _check_axis_limit(id, tree_joint, axis, float(coordinates[axis.index]), tolerance)
    allowed = np.zeros(6)
    for axis in axes:
        allowed[axis.index] = coordinates[axis.index]
    relative = pose_from_joint_coordinates(allowed.tolist())
    if is_ball(axes):
        relative[3:] = wanted_relative[3:]
    reached = pose_multiply(pose_multiply(fixed, relative), pose_inverse(child_from_joint))
    error_m = float(np.linalg.norm(reached[:3] - wanted_child[:3]))
    if (
        error_m > _REACH_TOLERANCE_M + tolerance
        or float(quat_angle(reached[3:], wanted_child[3:])) > _REACH_TOLERANCE_RAD + tolerance
    ):
        reason = f"{tree_joint.joint.id!r} does not reach it; the nearest pose it allows is {error_m:.3g} m away"
        raise PoseUnreachableError(id, reason=reason)


def _check_axis_limit(id: BodyId, tree_joint: TreeJoint, axis: JointAxis, position: float, tolerance: float) -> None:
    offset = position - axis.middle
    if axis.limit is not None and abs(offset) > axis.limit + _REACH_TOLERANCE_M + tolerance:
        end = axis.middle + np.copysign(axis.limit, offset)
        requested = f"{position:.4g} {'m' if axis.is_prismatic else 'rad'}"
        raise PoseUnreachableError(
            id, reason=f"{tree_joint.joint.id!r} is limited to {end:g}, but {requested} was requested"
        )
