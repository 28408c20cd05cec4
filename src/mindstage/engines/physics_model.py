"""Planning: what an engine has to know beyond a world, worked out once for all engines and kept true through edits.

Which bodies hang together, what each is made of, what it weighs where nobody said so, and who may collide with whom.
The engine tells where things stand; nothing here moves anything.

Plan: all that an engine needs to run a world in the way that was decided, as values.

Two plans of one planner, compared, say what an edit changed; a far engine is sent just that.

Traveling: where constraints have let their bodies go, and where they would let them go, from poses alone.

For engines that do not say so themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from mindstage.engines.base import SpawnNote, SpawnReport
from mindstage.engines.collision_filter import CollisionFilter, CollisionFilterInput, compute_collision_filter
from mindstage.engines.collision_shapes import fallback_collision_shape, wall_collision_shapes
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
from mindstage.engines.registry import AddResult, EntityRegistry
from mindstage.errors import PoseUnreachableError
from mindstage.scene import (
    IDENTITY,
    NO_GEOMETRY,
    BodyId,
    BodyPhysics,
    CollisionShape,
    GeometryMap,
    Joint,
    Mobility,
    Pose,
    Vector,
    World,
)
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_angle,
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
    """One body."""

    size: Vector
    """In force: an assumed one where the map has none."""
    root: BodyId
    """The body that its rigid assembly hangs on; itself where nothing holds it."""
    pose_in_root: Pose
    """Where it is in the frame of that body."""
    mobility: Mobility
    """Of the assembly."""
    gravity: bool
    mass_kg: float
    """Given or estimated; 0 where nobody knows and nobody needs to."""
    non_colliding: bool
    """Whether it collides with nothing."""
    collision_shapes: tuple[CollisionShape, ...]
    """What of it can be touched, in its own frame."""
    friction: float | None = None
    restitution: float | None = None


@dataclass(frozen=True, slots=True)
class JointModel:
    """One constraint between two assemblies of which at least one is simulated."""

    joint: Joint
    parent: BodyId
    """The end nearer to what does not move; it need not be what the map calls the parent."""
    child: BodyId
    parent_from_joint: Pose
    """The joint's frame as that parent sees it; what moves moves from there."""
    child_from_joint: Pose
    closes_loop: bool
    """Whether it closes a loop of constraints."""


@dataclass(frozen=True, slots=True)
class PhysicsModel:
    """Everything in one engine."""

    bodies: Mapping[BodyId, BodyModel]
    excluded_pairs: frozenset[tuple[BodyId, BodyId]]
    """Pairs that never collide, the lower id first; two of one assembly never do either and are not in it."""
    joints: Mapping[BodyId, JointModel]
    """By constraint; without those that are not taken, because they join what cannot move against each other."""


def build_physics_model(builder: PhysicsModelBuilder) -> PhysicsModel:
    """What a planner decided."""
    forest, masses = builder.forest, builder.masses()
    holds: dict[BodyId, Pose] = {}
    for assembly in forest.groups.values():
        for id in assembly.bodies:  # parents come before children
            holder = forest.rigid_parents.get(id)
            above = IDENTITY if holder is None else holds[holder]
            holds[id] = (
                IDENTITY
                if holder is None
                else pose_from_array(pose_multiply(normalized_pose_array(above), builder.attachment_poses[id]))
            )
    bodies = {id: _body_model(builder, forest, id, holds[id], masses[id]) for id in builder.registry.bodies}
    branches = [(branch, False) for branch in forest.tree_joints.values()]
    branches += [(branch, True) for branch in forest.loop_joints]
    joints = {branch.joint.id: _joint_model(builder, branch, loop) for branch, loop in branches}
    return PhysicsModel(bodies, frozenset(builder.excluded_pairs()), joints)


def _body_model(
    builder: PhysicsModelBuilder, forest: KinematicForest, id: BodyId, pose_in_root: Pose, mass_kg: float
) -> BodyModel:
    assembly = forest.groups[forest.root_of[id]]
    form = builder.geometry.get(id)
    return BodyModel(
        size=builder.mass_properties.size(id),
        root=assembly.root,
        pose_in_root=pose_in_root,
        mobility=assembly.mobility,
        gravity=builder.registry.bodies[id].physics.gravity is not False,
        mass_kg=mass_kg,
        non_colliding=id in builder.collision_filter.non_colliding,
        collision_shapes=builder.collision_shapes(id)[0],
        friction=form.friction if form else None,
        restitution=form.restitution if form else None,
    )


def _joint_model(builder: PhysicsModelBuilder, tree_joint: TreeJoint, closes_loop: bool) -> JointModel:
    of_parent, of_child = tree_joint.order_ends(builder.joint_frames[tree_joint.joint.id])
    frames = pose_from_array(of_parent), pose_from_array(of_child)
    return JointModel(tree_joint.joint, tree_joint.parent, tree_joint.child, *frames, closes_loop=closes_loop)


class PhysicsModelBuilder:
    """The description of everything in one engine, and the decisions about it.

    Wherever poses are asked for as `where`, they are n x 7 with unit quaternions, in the order of `registry.ids`.
    """

    def __init__(self) -> None:
        self.registry = EntityRegistry()
        self.mass_properties = MassProperties(self.registry)
        self.collision_filter = CollisionFilter()
        self.attachment_poses: dict[BodyId, Array] = {}
        """Each attached child's pose as seen from what it hangs on."""
        self.joint_frames: dict[BodyId, tuple[Array, Array]] = {}
        """Each constraint's frame as seen from the map's parent and from its child."""
        self.late_notes: list[SpawnNote] = []
        """What had to be decided because of edits; what a spawn decided is in its report."""
        self._forest: KinematicForest | None = None
        self._changed_bodies: set[BodyId] = set()
        self._collision_state = _CollisionState()

    def copy(self) -> PhysicsModelBuilder:
        """A planner of its own with the same decisions."""
        twin = PhysicsModelBuilder()
        twin.registry, twin.collision_filter = self.registry.copy(), self.collision_filter.copy()
        twin.mass_properties = self.mass_properties.copy(twin.registry)
        twin.attachment_poses, twin.joint_frames, twin.late_notes = (
            dict(self.attachment_poses),
            dict(self.joint_frames),
            list(self.late_notes),
        )
        twin._forest, twin._changed_bodies, twin._collision_state = (
            self._forest,
            set(self._changed_bodies),
            self._collision_state,
        )
        return twin

    @property
    def forest(self) -> KinematicForest:
        """Who hangs on whom now."""
        if self._forest is None:
            self._forest = build_kinematic_forest(self.registry, self.mass_properties.approximate_masses())
        return self._forest

    @property
    def geometry(self) -> GeometryMap:
        """What the bodies are made of that have a form."""
        return self.mass_properties.geometry

    def masses(self) -> dict[BodyId, float]:
        """Given masses, estimates for what moves without one, and 0 for the rest [kg]."""
        moving = {id for each in self.forest.groups.values() if each.is_dynamic for id in each.bodies}
        return {id: self.mass_properties.mass(id, is_dynamic=id in moving) for id in self.registry.bodies}

    def collision_shapes(self, id: BodyId) -> tuple[tuple[CollisionShape, ...], Array | None]:
        """What of a body can be touched: hollow plates, a form's solids, or its shape.

        Also gives where they are in the body's frame, k x 7; None for one that is just where the body is.
        """
        plates = self.collision_filter.wall_panels.get(id)
        if plates is not None:
            made = wall_collision_shapes(plates)
            return made, pose_array(solid.pose for solid in made)
        if id in self.mass_properties.geometry:
            prepared = self.mass_properties.compiled(id)
            return prepared.shapes, prepared.poses
        return (fallback_collision_shape(self.registry.bodies[id], self.mass_properties.size(id)),), None

    def build_model(self) -> PhysicsModel:
        """All of it as a value. Call `settle` first if anything was edited since."""
        return build_physics_model(self)

    def bodies_moving_with(self, id: BodyId) -> list[BodyId]:
        """A body and all that goes where it goes, rigidly or on joints."""
        forest = self.forest
        on_joint: dict[BodyId, list[BodyId]] = {}
        for top, branch in forest.tree_joints.items():
            on_joint.setdefault(branch.parent, []).append(top)
        found, waiting = [], [id]
        while waiting:
            body = waiting.pop()
            found.append(body)
            waiting += [child for child in self.registry.children(body) if forest.rigid_parents.get(child) == body]
            waiting += on_joint.get(body, ())
        return found

    # -- edits -------------------------------------------------------------------------------------------------

    def add(self, world: World, poses: Array, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        """See `Engine.spawn`.

        Args:
            world: what comes; its bodies stand as described.
            where: the poses of all bodies so far.
            forms: what the world's bodies are made of.
        """
        self.update_collisions(poses)
        added = self.registry.add(world)
        strange = self.mass_properties.add(added.bodies, geometry)
        came = pose_array(self.registry.bodies[id].pose for id in added.bodies)
        came[:, 3:] = normalize(came[:, 3:])
        poses = np.concatenate([poses, came])
        self._record_frames(added, poses)
        self._forest = None
        notes = [*self.mass_properties.assumption_notes(added.bodies, self._is_dynamic), *strange]
        new = {*added.bodies, *added.joints}
        notes += [note for note in self.forest.notes if new.intersection(note.ids)]
        notes += self._decide_collisions(set(added.bodies), poses)
        return added.report(notes)

    def remove(self, ids: Iterable[BodyId]) -> None:
        """See `Engine.delete`."""
        gone = {self.registry.body(id).id for id in ids}
        if not gone:
            return
        orphans = [child for id in gone for child in self.registry.children(id) if child not in gone]
        hung = [top for top, branch in self.forest.tree_joints.items() if branch.parent in gone and top not in gone]
        self.registry.remove(gone)
        self.mass_properties.remove(gone)
        for id in [*gone, *orphans]:
            self.attachment_poses.pop(id, None)
        self.joint_frames = {id: ends for id, ends in self.joint_frames.items() if id in self.registry.joints}
        self._changed_bodies -= gone
        self.collision_filter.remove(gone)
        self._forest = None
        self._changed_bodies.update(*(self.bodies_moving_with(id) for id in (*orphans, *hung)))

    def attach(self, parent: BodyId, child: BodyId, poses: Array) -> None:
        """See `Engine.attach_parts`."""
        self.registry.attach(parent, child)
        rows = [self.registry.ids.index(id) for id in (parent, child)]
        self.attachment_poses[child] = pose_multiply(pose_inverse(poses[rows[0]]), poses[rows[1]])
        self._forest = None

    def detach(self, child: BodyId) -> bool:
        """See `Engine.detach`; False if it hung nowhere."""
        if self.registry.body(child).id not in self.registry.parents:
            return False
        self.registry.detach(child)
        self.attachment_poses.pop(child, None)
        self._forest = None
        self._changed_bodies.update(self.bodies_moving_with(child))
        return True

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        """See `Engine.set_physics`."""
        self.registry.replace(id, physics=physics)
        self._forest = None
        self._changed_bodies.update(self.bodies_moving_with(id))
        self.late_notes += self.mass_properties.assumption_notes([id], self._is_dynamic)

    def update_attachment_pose(self, id: BodyId, target: Array, poses: Array) -> None:
        """Tells that a body stands somewhere else now; what it hangs on holds it there."""
        holder = self.forest.rigid_parents.get(id)
        if holder is not None:
            self.attachment_poses[id] = pose_multiply(pose_inverse(poses[self.registry.ids.index(holder)]), target)

    def update_collisions(self, poses: Array) -> None:
        """Decides about what edits changed; the notes are late ones."""
        if self._changed_bodies:
            self.late_notes += self._decide_collisions(self._changed_bodies, poses)

    # -- who collides with whom ----------------------------------------------------------------------------------

    def excluded_pairs(self) -> set[tuple[BodyId, BodyId]]:
        """All pairs that never collide, in the order of their ids: decided ones, and parts of one piece of furniture.

        Bodies of one assembly never do either; they are not listed.
        """
        forest = self.forest
        pairs = {
            pair for pair in self.collision_filter.excluded_pairs if forest.root_of[pair[0]] != forest.root_of[pair[1]]
        }
        for one, other in self._jointed_groups():
            for a in forest.groups[one].bodies:
                pairs |= {(a, b) if a < b else (b, a) for b in forest.groups[other].bodies}
        return pairs

    def _jointed_groups(self) -> set[tuple[BodyId, BodyId]]:
        """Pairs of tops: two ends of a constraint, and a door with what else is fixed to its case (racks, bars)."""
        forest = self.forest
        neighbors: dict[BodyId, set[BodyId]] = {}
        for constraint in self.registry.joints.values():
            if constraint.disable_collision is not False:
                one, other = forest.root_of[constraint.parent], forest.root_of[constraint.child]
                neighbors.setdefault(one, set()).add(other)
                neighbors.setdefault(other, set()).add(one)
        pairs = {(one, other) for one, others in neighbors.items() for other in others if one < other}
        for top, branch in forest.tree_joints.items():
            beside = neighbors.get(forest.root_of[branch.parent], ())
            fixed = (other for other in beside if not forest.groups[other].is_dynamic)
            pairs |= {(top, other) if top < other else (other, top) for other in fixed if other != top}
        return pairs

    def _is_dynamic(self, id: BodyId) -> bool:
        """Whether the physics moves it."""
        return self.forest.groups[self.forest.root_of[id]].is_dynamic

    def _record_frames(self, added: AddResult, poses: Array) -> None:
        """Where attached children and constraint frames are, as seen from what they hang on."""
        if not (added.attachments or added.joints):
            return
        rows = {id: row for row, id in enumerate(self.registry.ids)}
        holders = [rows[self.registry.parents[child]] for child in added.attachments]
        children = [rows[child] for child in added.attachments]
        self.attachment_poses.update(
            zip(added.attachments, pose_multiply(pose_inverse(poses[holders]), poses[children]), strict=True)
        )
        constraints = [self.registry.joints[id] for id in added.joints]
        frames = pose_array(constraint.pose for constraint in constraints)
        frames[:, 3:] = normalize(frames[:, 3:])
        of_parent = pose_multiply(pose_inverse(poses[[rows[constraint.parent] for constraint in constraints]]), frames)
        of_child = pose_multiply(pose_inverse(poses[[rows[constraint.child] for constraint in constraints]]), frames)
        self.joint_frames.update(zip(added.joints, zip(of_parent, of_child, strict=True), strict=True))

    def _decide_collisions(self, new_ids: set[BodyId], poses: Array) -> list[SpawnNote]:
        """Decides what collides among fresh bodies and between them and the others."""
        ids, forest, constraints = self.registry.ids, self.forest, self.registry.joints.values()
        numbers = {top: number for number, top in enumerate(forest.groups)}
        tops = [forest.root_of[id] for id in ids]
        held = {forest.root_of[end] for constraint in constraints for end in (constraint.parent, constraint.child)}
        before, self._collision_state = self._collision_state, _CollisionState.from_forest(forest, constraints)
        scene = CollisionFilterInput(
            ids=ids,
            poses=poses,
            sizes=self.mass_properties.sizes(ids),
            group=np.array([numbers[top] for top in tops], dtype=np.intp),
            is_dynamic=np.array([forest.groups[top].is_dynamic for top in tops], dtype=bool),
            is_free=np.array([forest.groups[top].is_dynamic and top not in held for top in tops], dtype=bool),
            is_new=np.array([id in new_ids for id in ids], dtype=bool),
            jointed_pairs=frozenset((min(pair), max(pair)) for pair in self._collision_state.as_numbers(numbers)),
            overlap_boxes=self.mass_properties.overlap_boxes(ids, poses),
            collision_shapes=self.mass_properties.collision_shape_batch(ids, poses),
            has_geometry=self.mass_properties.has_geometry_mask(ids),
            could_collide_before=lambda a, b: before.could_collide(ids[a], ids[b]),
        )
        self.collision_filter, notes = compute_collision_filter(scene, self.collision_filter)
        self._changed_bodies = set()
        return notes


@dataclass(frozen=True, slots=True)
class _CollisionState:
    """Who could collide with whom when that was last decided."""

    root_of: Mapping[BodyId, BodyId] = field(default_factory=dict)
    dynamic_roots: frozenset[BodyId] = frozenset()
    """Tops of assemblies."""
    jointed_roots: frozenset[tuple[BodyId, BodyId]] = frozenset()
    """Pairs of tops that a constraint keeps from colliding."""

    @classmethod
    def from_forest(cls, forest: KinematicForest, joints: Iterable[Joint]) -> _CollisionState:
        simulating = frozenset(top for top, assembly in forest.groups.items() if assembly.is_dynamic)
        joined = frozenset(
            _sorted_pair(forest.root_of[constraint.parent], forest.root_of[constraint.child])
            for constraint in joints
            if constraint.disable_collision is not False
        )
        return cls(forest.root_of, simulating, joined)

    def as_numbers(self, numbers: Mapping[BodyId, int]) -> Iterable[tuple[int, int]]:
        """The joined pairs by the numbers of their tops."""
        return ((numbers[a], numbers[b]) for a, b in self.jointed_roots)

    def could_collide(self, one: BodyId, other: BodyId) -> bool:
        a, b = self.root_of.get(one), self.root_of.get(other)
        if a is None or b is None or a == b or _sorted_pair(a, b) in self.jointed_roots:
            return False
        return a in self.dynamic_roots or b in self.dynamic_roots


def _sorted_pair(a: BodyId, b: BodyId) -> tuple[BodyId, BodyId]:
    return (a, b) if a < b else (b, a)


_REACH_TOLERANCE_M, _REACH_TOLERANCE_RAD = 1e-6, 1e-6


def joint_positions_from_poses(
    builder: PhysicsModelBuilder, poses: Mapping[BodyId, Array]
) -> dict[BodyId, tuple[float, ...]]:
    """How far each constraint that can move has moved: see `Engine.joint_positions`.

    Args:
        planner: who hangs on whom.
        where: all poses.
    """
    places = {}
    for branch in builder.forest.tree_joints.values():
        constraint = branch.joint
        if axes := movable_axes(constraint, is_reversed=branch.is_reversed):
            of_parent, of_child = builder.joint_frames[constraint.id]
            fixed = pose_multiply(poses[constraint.parent], of_parent)
            moving = pose_multiply(poses[constraint.child], of_child)
            places[constraint.id] = tuple(joint_coordinates(pose_multiply(pose_inverse(fixed), moving), axes).tolist())
    return places


def check_joint_limits(
    builder: PhysicsModelBuilder, id: BodyId, target: Array, poses: Mapping[BodyId, Array], *, tolerance: float = 0.0
) -> None:
    """Makes sure that the constraint which holds a body lets it get somewhere.

    Args:
        planner: who hangs on whom.
        id: a body that hangs on a constraint, the top of its assembly.
        target: where it is to be.
        where: all poses now.
        slack: how far off the engine's own poses may be [m, rad].

    Raises:
        PoseUnreachableError: it does not.
    """
    branch = builder.forest.tree_joints[id]
    axes = movable_axes(branch.joint, is_reversed=branch.is_reversed)
    if not axes:
        raise PoseUnreachableError(id, reason=f"the constraint {branch.joint.id!r} locks it")
    of_parent, of_child = branch.order_ends(builder.joint_frames[branch.joint.id])
    fixed = pose_multiply(poses[branch.parent], of_parent)
    wanted = pose_multiply(target, pose_multiply(pose_inverse(poses[id]), poses[branch.child]))
    asked = pose_multiply(pose_inverse(fixed), pose_multiply(wanted, of_child))
    place = joint_coordinates(asked, axes)
    for axis in axes:
        _check_axis_limit(id, branch, axis, float(place[axis.index]), tolerance)
    allowed = np.zeros(6)
    for axis in axes:
        allowed[axis.index] = place[axis.index]
    relative = pose_from_joint_coordinates(allowed.tolist())
    if is_ball(axes):
        relative[3:] = asked[3:]
    reached = pose_multiply(pose_multiply(fixed, relative), pose_inverse(of_child))
    off_m = float(np.linalg.norm(reached[:3] - wanted[:3]))
    if (
        off_m > _REACH_TOLERANCE_M + tolerance
        or float(quat_angle(reached[3:], wanted[3:])) > _REACH_TOLERANCE_RAD + tolerance
    ):
        reason = f"{branch.joint.id!r} does not lead there; the nearest it allows is {off_m:.3g} m off"
        raise PoseUnreachableError(id, reason=reason)


def _check_axis_limit(id: BodyId, tree_joint: TreeJoint, axis: JointAxis, position: float, tolerance: float) -> None:
    beyond = position - axis.middle
    if axis.limit is not None and abs(beyond) > axis.limit + _REACH_TOLERANCE_M + tolerance:
        end = axis.middle + np.copysign(axis.limit, beyond)
        asked_for = f"{position:.4g} {'m' if axis.is_prismatic else 'rad'}"
        raise PoseUnreachableError(id, reason=f"{tree_joint.joint.id!r} ends at {end:g}, asked for was {asked_for}")
