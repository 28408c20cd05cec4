"""Planning: what an engine has to know beyond a world, worked out once for all engines and kept true through edits.

Which bodies hang together, what each is made of, what it weighs where nobody said so, and who may collide with whom.
The engine tells where things stand; nothing here moves anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from mindstage.engines.collision import CollisionFilter, CollisionFilterInput, compute_collision_filter
from mindstage.engines.contract import SpawnNote, SpawnReport
from mindstage.engines.forest import KinematicForest, build_kinematic_forest
from mindstage.engines.inventory import AddResult, EntityRegistry
from mindstage.engines.matter import MassProperties
from mindstage.engines.plan import PhysicsModel, build_physics_model
from mindstage.engines.solids import fallback_collision_shape, wall_collision_shapes
from mindstage.world import NO_GEOMETRY, BodyId, BodyPhysics, CollisionShape, GeometryMap, Joint, World
from mindstage.world.geometry import Array, normalize, pose_array, pose_inverse, pose_multiply

__all__ = ["PhysicsModelBuilder"]


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
