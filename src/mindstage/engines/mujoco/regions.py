"""Regions: the parts of a world that have a MuJoCo model each.

A *unit* is what moves as one for the partition: a kinematic tree without what is fixed, or several trees that loops of
joints or couplings connect. A region simulates some units. Fixed bodies near them are in its model, and so are the
units of other regions there, as fixed geoms at their present poses: nothing passes through these until both are in one
region. A small world is one region, with all of its bodies.

The partition is a function of the edits and of the state. A unit whose swept box meets a unit of another region is
handed over to that one before they touch, with what it may touch itself.
"""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, compress, islice
from operator import is_, is_not
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.ground import Ground
from mindstage.engines.mujoco.compiler import ModelInput, is_fixed_group
from mindstage.engines.mujoco.state import CompiledModel, ModelJoint
from mindstage.engines.physics_model import PhysicsModelBuilder
from mindstage.scene import Body, BodyId, Joint
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, connected_groups, overlapping_pairs
from mindstage.scene.transforms import Array, quat_rotate

__all__ = [
    "REGION_BODIES",
    "Boxes",
    "Handovers",
    "Region",
    "WorldTables",
    "assign_units",
    "box_meets",
    "find_handovers",
    "reach_of",
]

REGION_BODIES = 300
"""A region begins with at most so many bodies that move, unless more of them touch one another."""
_MAX_SINGLE_BODIES = 1500
"""A world with more bodies has several regions, even if few of them move."""
_REACH_M = 0.5
"""The bodies of a model are those within this distance of its units [m]."""
_TOUCH_M = 0.02
"""Units whose boxes are so near begin in one region [m]."""
_MARGIN_M = 0.05
"""What is added to the boxes of units, for accelerations until the next check [m]."""
_GRAVITY_M_S2 = 9.81
_MOVED = 1e-6
"""A difference of poses by which a body has moved [m]."""
_FEW = 200_000
"""So many pairs of boxes are compared one by one; more, by a sweep along an axis."""

Boxes = tuple[Array, Array]
"""Lower and upper corners of axis-aligned boxes, n x 3 each [m]."""
_Partners = Mapping[BodyId, list[BodyId]]
"""The second bodies of pairs by the first ones."""


class WorldTables:
    """What the models of all regions have in common; valid until the next edit."""

    def __init__(
        self, builder: PhysicsModelBuilder, *, kinematics_driven: bool, before: WorldTables | None = None
    ) -> None:
        """Reads the world.

        Args:
            builder: the world.
            kinematics_driven: whether kinematic bodies are moved.
            before: the tables before an edit, from which all is taken but bodies on their own that were added, deleted
                or changed.
        """
        if len(builder.registry.ids) <= _MAX_SINGLE_BODIES:
            builder.order_forest()  # else it costs more than to compile what has changed
        self.kinematics_driven = kinematics_driven
        registry, self.forest = builder.registry, builder.forest
        self.ids, self.rows = registry.ids, registry.rows
        self.group_roots = list(self.forest.groups)
        found = before._sources_in(self) if before is not None and before.ids else None
        before = None if found is None else before
        self.sources = None if found is None else found[0]
        """The row in `before` of each body that is simulated as there, -1 for others; None if all are read anew."""
        self.overlapping = frozenset(builder.collision_filter.excluded_pairs | builder.given_excluded_pairs)
        self.jointed_pairs: frozenset[tuple[BodyId, BodyId]] = (
            builder.jointed_pairs() if before is None else before.jointed_pairs
        )
        self._jointed_partners: _Partners | None = None if before is None else before._jointed_partners
        self._overlapping_partners: _Partners | None = None
        self.linked: frozenset[BodyId]
        self.places = None if before is None or found is None else _inverse(found[0], len(before.ids))
        """The row here of each body of `before`, -1 for those that are not here, and at the end."""
        if before is not None and before.overlapping == self.overlapping:
            self.linked, self._overlapping_partners = before.linked, before._overlapping_partners
        else:
            ends = ((each.parent, each.child) for each in registry.joints.values())
            self.linked = frozenset(chain(*self.overlapping, *ends))
        is_new = np.ones(len(self.ids), dtype=bool) if self.sources is None else self.sources < 0
        new = [self.ids[row] for row in np.flatnonzero(is_new).tolist()]
        self.sizes = builder.mass_properties.sizes(new)
        self.local_centers, extents = builder.mass_properties.local_boxes(new)
        self.half_extents = extents / 2
        self.group_of: Indices
        """The number of the group of each body."""
        self.unit_of_group: Indices
        """The unit of each group, -1 for fixed ones."""
        self.holders: Indices
        """The units that fixed groups hold, and the numbers of these, n x 2."""
        if before is None or found is None:
            numbers = {root: number for number, root in enumerate(self.group_roots)}
            groups = (numbers[self.forest.root_of[id]] for id in self.ids)
            self.group_of = np.fromiter(groups, dtype=np.intp, count=len(self.ids))
            self.unit_of_group, self.holders = self._units(numbers)
        else:
            self._take(before, *found)
        self.unit_of = self.unit_of_group[self.group_of]
        """The unit of each body, -1 for fixed ones."""
        self.unit_sizes = np.bincount(self.unit_of[self.unit_of >= 0])
        """Number of bodies of each unit."""
        moving = np.flatnonzero(self.unit_of >= 0)
        self.moving = moving[np.argsort(self.unit_of[moving], kind="stable")]
        """The rows of the bodies that move, by unit."""
        self._first = np.searchsorted(self.unit_of[self.moving], np.arange(len(self.unit_sizes)))
        self._described = _Described.of(builder)

    def _sources_in(self, after: WorldTables) -> tuple[Indices, Indices] | None:
        """Where the bodies and groups of a world are here, -1 for new ones; None if attachments or joints differ."""
        old, new = self.forest.groups, after.forest.groups
        if (
            after.forest.tree_joints is not self.forest.tree_joints  # then the forest was built anew
            or after.kinematics_driven != self.kinematics_driven
        ):
            return None
        sources = np.full(len(after.ids), -1, dtype=np.intp)
        if len(old) <= len(new) and all(map(is_, old.values(), new.values())):
            groups, rows, kept = np.arange(len(old)), np.arange(len(self.ids)), self.ids
        else:
            is_kept = np.fromiter(map(is_, map(new.get, old), old.values()), dtype=bool, count=len(old))
            if not all(map(is_, compress(old.values(), is_kept), new.values())):
                return None  # others come before them
            groups, rows = np.flatnonzero(is_kept), np.flatnonzero(is_kept[self.group_of])
            kept = tuple(compress(self.ids, is_kept[self.group_of]))
        sources[slice(len(kept)) if after.ids[: len(kept)] == kept else [after.rows[id] for id in kept]] = rows
        return sources, np.concatenate([groups, np.full(len(new) - len(groups), -1)])

    def _take(self, before: WorldTables, sources: Indices, group_sources: Indices) -> None:
        """Takes the bodies that are simulated as before; others are neither attached nor on joints.

        Args:
            before: the tables before.
            sources: the row there of each body, -1 for new ones.
            group_sources: the number there of each group, -1 for new ones.
        """
        is_new, group_is_new = sources < 0, group_sources < 0
        for name in ("sizes", "local_centers", "half_extents"):
            rows = np.empty((len(self.ids), 3))
            rows[~is_new], rows[is_new] = getattr(before, name)[sources[~is_new]], getattr(self, name)
            setattr(self, name, rows)
        groups = _inverse(group_sources, len(before.group_roots))
        self.group_of = groups[before.group_of[sources]]
        new = {self.group_roots[number]: number for number in np.flatnonzero(group_is_new).tolist()}
        self.group_of[is_new] = [new[self.ids[row]] for row in np.flatnonzero(is_new).tolist()]
        groups_here = (self.forest.groups[root] for root in new)
        moves = np.array(
            [not is_fixed_group(each, kinematics_driven=self.kinematics_driven) for each in groups_here], dtype=bool
        )
        is_kept = np.zeros(len(before.unit_sizes), dtype=bool)
        kept = before.unit_of_group[group_sources[~group_is_new]]
        is_kept[kept[kept >= 0]] = True
        units = np.append(np.where(is_kept, np.cumsum(is_kept) - 1, -1), -1)
        self.unit_of_group = np.empty(len(self.group_roots), dtype=np.intp)
        self.unit_of_group[~group_is_new] = units[kept]
        self.unit_of_group[group_is_new] = np.where(moves, np.count_nonzero(is_kept) - 1 + np.cumsum(moves), -1)
        self.holders = np.stack([units[before.holders[:, 0]], groups[before.holders[:, 1]]], axis=1)

    def _units(self, numbers: Mapping[BodyId, int]) -> tuple[Indices, Indices]:
        forest = self.forest
        moves = np.array(
            [not is_fixed_group(each, kinematics_driven=self.kinematics_driven) for each in forest.groups.values()],
            dtype=bool,
        )
        links = [(numbers[root], numbers[forest.root_of[each.parent]]) for root, each in forest.tree_joints.items()]
        links += [(numbers[a], numbers[b]) for a, b in self._couplings()]
        ends = np.array(links, dtype=np.intp).reshape(-1, 2)
        is_inner = moves[ends].all(axis=1)
        trees = connected_groups(len(moves), *ends[is_inner].T)
        unit_of_group = np.full(len(moves), -1, dtype=np.intp)
        unit_of_group[moves] = np.unique(trees[moves], return_inverse=True)[1]
        held = ends[~is_inner & moves[ends].any(axis=1)]
        held = np.where(moves[held[:, :1]], held, held[:, ::-1])
        return unit_of_group, np.stack([unit_of_group[held[:, 0]], held[:, 1]], axis=1)

    def _couplings(self) -> Iterable[tuple[BodyId, BodyId]]:
        """Pairs of groups that have to be in one model: those of loops, and of joints that follow others."""
        forest = self.forest
        for loop in forest.loop_joints:
            yield forest.root_of[loop.parent], forest.root_of[loop.child]
        roots = {tree_joint.joint.id: root for root, tree_joint in forest.tree_joints.items()}
        for root, tree_joint in forest.tree_joints.items():
            mimic = tree_joint.joint.mimic
            if mimic is not None and mimic.joint in roots:
                yield root, roots[mimic.joint]

    @property
    def is_single(self) -> bool:
        """Whether the world is small enough for one region."""
        return len(self.moving) <= REGION_BODIES and len(self.ids) <= _MAX_SINGLE_BODIES

    def boxes(self, poses: Array, rows: Indices) -> Boxes:
        """Axis-aligned boxes around some bodies, by their rows."""
        oriented = OrientedBoxes.from_poses(poses[rows], 2 * self.half_extents[rows])
        centers = poses[rows, :3] + quat_rotate(poses[rows, 3:], self.local_centers[rows])
        return OrientedBoxes(centers, oriented.rotation, oriented.half_extents).bounds()

    def moves(self, id: BodyId) -> bool:
        """Whether a body is part of a unit."""
        return bool(self.unit_of[self.rows[id]] >= 0)

    def has_bodies(self, units: Indices, region: Region) -> bool:
        """Whether some units have exactly the bodies of a region."""
        is_one = np.zeros(len(self.unit_sizes), dtype=bool)
        is_one[units] = True
        own = self.unit_of[region.rows[region.is_own]]
        return int(self.unit_sizes[units].sum()) == len(region.bodies) and bool(is_one[own].all())

    def bodies_of(self, units: NDArray[np.bool_]) -> set[BodyId]:
        """The bodies of some units, by a mask of all units."""
        return {self.ids[row] for row in self.moving[units[self.unit_of[self.moving]]].tolist()}

    def unit_boxes(self, boxes: Boxes) -> Boxes:
        """Boxes around all units, from those of all bodies."""
        if not len(self.moving):
            return np.zeros((0, 3)), np.zeros((0, 3))
        low, high = boxes
        return (
            np.minimum.reduceat(low[self.moving], self._first),
            np.maximum.reduceat(high[self.moving], self._first),
        )

    def model_input(self, builder: PhysicsModelBuilder, poses: Array, timestep_s: float) -> ModelInput:
        """The input of one model for the whole world; the builder is that of the tables, or a copy."""
        return ModelInput(
            builder, poses, timestep_s, builder.registry.bodies, self.rows, self.sizes, builder.masses(), self.forest,
            builder.overlapping_pairs() | self.jointed_pairs, self.linked, self.kinematics_driven,
            is_divisible=not self.is_single,
        )  # fmt: skip

    def region_input(
        self,
        builder: PhysicsModelBuilder,
        poses: Array,
        timestep_s: float,
        units: NDArray[np.bool_],
        within: NDArray[np.bool_],
    ) -> ModelInput:
        """The input of the model of a region.

        Args:
            builder: that of the tables, or a copy.
            poses: poses of all bodies.
            timestep_s: the time step [s].
            units: whether each unit is simulated in it.
            within: whether each body is within its reach.
        """
        forest, chosen = self.forest, np.zeros(len(self.group_roots), dtype=bool)
        is_unit = self.unit_of_group >= 0
        moves = is_unit & units[self.unit_of_group] if len(units) else is_unit
        chosen[self.group_of[within]] = True
        chosen |= moves
        chosen[self.holders[units[self.holders[:, 0]], 1]] = True
        rows = np.flatnonzero(chosen[self.group_of])
        ids = [self.ids[row] for row in rows.tolist()]
        roots = [self.group_roots[number] for number in np.flatnonzero(chosen).tolist()]
        frozen = {self.group_roots[number] for number in np.flatnonzero(chosen & is_unit & ~moves).tolist()}
        local, bodies = {id: row for row, id in enumerate(ids)}, builder.registry.bodies
        return ModelInput(
            builder, poses[rows], timestep_s, {id: bodies[id] for id in ids}, local, self.sizes[rows],
            builder.masses(ids), forest.part(roots, fixed=frozen), self._pairs_of(local),
            self.linked, self.kinematics_driven, is_divisible=True,
        )  # fmt: skip

    def _pairs_of(self, ids: Collection[BodyId]) -> set[tuple[BodyId, BodyId]]:
        """The excluded pairs of some bodies."""
        if self._jointed_partners is None:
            self._jointed_partners = _partners(self.jointed_pairs)
        if self._overlapping_partners is None:
            self._overlapping_partners = _partners(self.overlapping)
        root_of = self.forest.root_of
        return {
            (a, b)
            for partners in (self._jointed_partners, self._overlapping_partners)
            for a in ids
            if a in partners
            for b in partners[a]
            if b in ids and root_of[a] != root_of[b]
        }

    def without_pairs(self, pairs: Collection[tuple[BodyId, BodyId]]) -> WorldTables:
        """The tables of the same world in which some pairs that overlapped collide; copies share these here."""
        result = copy.copy(self)
        result.overlapping, result._overlapping_partners = self.overlapping - set(pairs), None
        return result

    def changed_since(self, before: WorldTables) -> tuple[set[BodyId], bool]:
        """The bodies that are simulated differently than before, and whether everything is."""
        old, new = before._described, self._described
        changed = set(_differing(old.bodies, new.bodies))
        changed.update(_differing(old.wall_panels, new.wall_panels), _differing(old.attachments, new.attachments))
        changed.update(_differing(old.shapes, new.shapes))
        changed.update(*(before_it ^ now for before_it, now in zip(old.flags, new.flags, strict=True)))
        changed.update(*(before.overlapping ^ self.overlapping))
        if before.jointed_pairs is not self.jointed_pairs:
            changed.update(*(before.jointed_pairs ^ self.jointed_pairs))
        for joints, others in ((old.joints, new.joints), (old.simulated, new.simulated)):
            for id in _differing(joints, others):
                for joint in (joints.get(id), others.get(id)):
                    changed.update(() if joint is None else (joint.parent, joint.child))
        if self.sources is None:
            roots, now = before.forest.root_of, self.forest.root_of
            changed.update(id for id, root in now.items() if roots.get(id) != root)
        if old.actuators != new.actuators:
            for joint in (each.joint for each in {*old.actuators.values(), *new.actuators.values()}):
                if found := new.joints.get(joint) or old.joints.get(joint):
                    changed.update((found.parent, found.child))
        return changed, old.ground != new.ground or before.kinematics_driven != self.kinematics_driven


@dataclass(frozen=True, slots=True)
class _Described:
    """What else models depend on, as it was when it was read."""

    bodies: Mapping[BodyId, Body]
    wall_panels: Mapping[BodyId, object]
    attachments: Mapping[BodyId, Array]
    shapes: Mapping[BodyId, object]
    joints: Mapping[BodyId, Joint]
    simulated: Mapping[BodyId, Joint]
    actuators: Mapping[str, Any]
    flags: tuple[frozenset[BodyId], ...]
    ground: Ground | None

    @classmethod
    def of(cls, builder: PhysicsModelBuilder) -> _Described:
        registry, filtered = builder.registry, builder.collision_filter
        return cls(
            dict(registry.bodies), dict(filtered.wall_panels), dict(builder.attachment_poses), dict(builder.geometry),
            dict(registry.joints), dict(builder.simulated_joints), dict(builder.actuators.actuators),
            builder.simulation_flags(), builder.ground,
        )  # fmt: skip


def _inverse(sources: Indices, count: int) -> Indices:
    """Where each of a number of things is that are elsewhere now; -1 for others, and at the end, so that -1 stays."""
    places = np.full(count + 1, -1, dtype=np.intp)
    now = np.flatnonzero(sources >= 0)
    places[sources[now]] = now
    return places


def _partners(pairs: Iterable[tuple[BodyId, BodyId]]) -> _Partners:
    found: dict[BodyId, list[BodyId]] = {}
    for a, b in pairs:
        found.setdefault(a, []).append(b)
    return found


def _differing(before: Mapping[Any, Any], after: Mapping[Any, Any]) -> set[Any]:
    """The keys whose values are other objects, or that are in one mapping only."""
    count = len(before)
    if count <= len(after) and list(islice(after, count)) == list(before):  # as in most cases, and then much faster
        is_other = map(is_not, before.values(), after.values())
        return {*compress(before, is_other), *islice(after, count, None)}
    is_other = map(is_not, map(after.get, before), before.values())
    return {*compress(before, is_other), *(after.keys() - before.keys())}


@dataclass(slots=True)
class Region:
    """A part of the world with a model of its own."""

    bodies: set[BodyId]
    """The bodies of its units."""
    compiled: CompiledModel
    box: Array
    """2 x 3: every body that meets this box is in the model [m]; infinite for a whole world."""
    frozen: dict[BodyId, Array]
    """The poses, as compiled, of the units of others that are in the model."""
    rows: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """The row in the world of each body of the model."""
    is_own: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Whether each body of the model is one of `bodies`."""
    is_current: bool = True
    """Whether the model has the present units, fixed bodies and frozen ones."""
    is_resting: bool = False
    """Whether everything is asleep, so that steps change nothing but the time."""
    is_read: bool = True
    """Whether the poses of the world have those of the model."""
    is_shared: bool = False
    """Whether copies have the same state, which is copied when one of them is woken."""

    def copy(self) -> Region:
        """An independent copy of the state; the model is shared."""
        if self.is_resting:
            self.compiled.update_poses()
            self.is_shared = True
        compiled = self.compiled if self.is_shared else self.compiled.copy()
        return replace(self, bodies=set(self.bodies), compiled=compiled, frozen=dict(self.frozen))

    def use_rows(self, tables: WorldTables) -> None:
        """Sets the rows of the bodies; those that are not there have the row -1."""
        if tables.places is not None and len(self.rows):
            self.rows = tables.places[self.rows]
            return
        ids = self.compiled.rows
        self.rows = np.fromiter((tables.rows.get(id, -1) for id in ids), dtype=np.intp, count=len(ids))
        self.is_own = np.fromiter((id in self.bodies for id in ids), dtype=bool, count=len(ids))

    def is_asleep(self) -> bool:
        """Whether a step would change nothing but the time."""
        compiled = self.compiled
        return not compiled.kinematic_addresses and not compiled.data.ntree_awake

    def wake(self, time_s: float) -> CompiledModel:
        """The model, to be changed or advanced: from then on it is stepped."""
        if self.is_shared:
            self.compiled, self.is_shared = self.compiled.copy(), False
        if self.is_resting:
            self.compiled.data.time, self.is_resting = time_s, False
        self.is_read = False
        return self.compiled

    def release(self, bodies: Collection[BodyId], joints: Collection[BodyId]) -> None:
        """Gives bodies to another region: their state in this model is not used any more.

        Args:
            bodies: the bodies.
            joints: all joints but theirs.
        """
        self.bodies -= set(bodies)
        self.compiled = self.compiled.without(bodies, remaining_joints=joints)
        is_given = np.fromiter((id in bodies for id in self.compiled.rows), dtype=bool, count=len(self.rows))
        self.is_own = self.is_own & ~is_given  # copies share the array
        self.is_current = False

    def joints(self) -> dict[BodyId, ModelJoint]:
        """The joints of its own bodies."""
        return {
            id: joint
            for id, joint in self.compiled.joints.items()
            if joint.tree_joint.child in self.bodies or joint.tree_joint.parent in self.bodies
        }

    def sleep(self) -> NDArray[np.intc]:
        """MuJoCo's state of sleep of its own bodies, without kinematic ones."""
        numbers = self.compiled.body_id_order[self.is_own]
        return np.asarray(self.compiled.data.body_awake[numbers[~self.compiled.is_kinematic[numbers]]])

    def awake_rows(self) -> Indices:
        """The places in the model of its own bodies that are awake, wake up in the next step, or may be moved."""
        compiled = self.compiled
        numbers, model, data = compiled.body_id_order, compiled.model, compiled.data
        is_woken = np.zeros(model.ntree + 1, dtype=bool)
        is_woken[model.dof_treeid[np.flatnonzero(data.qvel)]] = True  # see `wake_islands`
        is_awake = (data.body_awake[numbers] == 1) | compiled.is_kinematic[numbers]
        is_awake |= is_woken[model.body_treeid[numbers]]
        return np.flatnonzero(self.is_own & (numbers > 0) & is_awake)

    def displacements(self, places: Indices, radii: Array, duration_s: float) -> Array:
        """How far bodies move in a time at their present velocities, k x 6 [m]: to lower, and to higher coordinates.

        Kinematic ones move until the pose that was set last, where their boxes are already.
        """
        model, data = self.compiled.model, self.compiled.data
        numbers = self.compiled.body_id_order[places]
        spin, linear = data.cvel[numbers, :3], data.cvel[numbers, 3:]
        arm = data.xpos[numbers] - data.subtree_com[model.body_rootid[numbers]]
        moved = (linear + np.cross(spin, arm)) * duration_s
        turned = np.linalg.norm(spin, axis=1, keepdims=True) * radii[:, None] * duration_s
        turned = np.minimum(turned, 2 * radii[:, None])
        result = np.concatenate([np.minimum(moved, 0.0) - turned, np.maximum(moved, 0.0) + turned], axis=1)
        for row in np.flatnonzero(self.compiled.is_kinematic[numbers]).tolist():
            result[row] = self._kinematic_displacement(int(numbers[row]), float(radii[row]))
        return np.asarray(np.nan_to_num(result, nan=0.0, posinf=1e3, neginf=-1e3))

    def _kinematic_displacement(self, number: int, radius_m: float) -> Array:
        """The same of a kinematic body: back to where it is for the physics until it gets to the pose that was set."""
        compiled = self.compiled
        root = compiled.kinematic_roots[int(compiled.model.body_weldid[number])]
        motion, result = compiled.motions.get(root), np.zeros(6)
        if motion is not None and motion.steps:
            place, turn = compiled.data.qpos[compiled.kinematic_qpos[compiled.kinematic_rows[root]]], np.zeros(3)
            mujoco.mju_subQuat(turn, motion.pose[3:], place[3:])
            back = motion.pose[:3] - place[:3]
            reach_m = np.linalg.norm(compiled.data.xpos[number] - place[:3]) + radius_m
            turned_m = min(float(np.linalg.norm(turn)), 2.0) * reach_m
            result[:3], result[3:] = np.minimum(back, 0.0) - turned_m, np.maximum(back, 0.0) + turned_m
        return result


def reach_of(low: Array, high: Array) -> Array:
    """The box within which bodies are in the model of units with these boxes, 2 x 3 [m]."""
    return np.stack([low.min(axis=0) - _REACH_M, high.max(axis=0) + _REACH_M])


def divide_units(tables: WorldTables, boxes: Boxes, units: Indices) -> list[Indices]:
    """Divides units among new regions of at most `REGION_BODIES` bodies, except where more of them touch one another.

    Args:
        tables: the world.
        boxes: boxes of all units.
        units: the units to divide.
    """
    if not len(units):
        return []
    cluster = _clusters(boxes, units)
    count = int(cluster.max()) + 1
    sizes = np.bincount(cluster, weights=tables.unit_sizes[units], minlength=count)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, cluster, boxes[0][units])
    np.maximum.at(high, cluster, boxes[1][units])
    centers = (low + high) / 2
    parts, pending = [], [np.arange(count)]
    while pending:
        part = pending.pop()
        if len(part) == 1 or sizes[part].sum() <= REGION_BODIES:
            parts.append(np.sort(units[np.isin(cluster, part)]))
        else:
            pending += _halves(part, centers[part], sizes[part])
    return sorted(parts, key=lambda part: int(part[0]))


def _halves(part: Indices, centers: Array, sizes: NDArray[Any]) -> tuple[Indices, Indices]:
    """Divides clusters at the widest gap that leaves at least a quarter of the bodies on each side."""
    best: tuple[float, int, NDArray[np.intp], int] | None = None
    for axis in range(3):
        order = np.argsort(centers[:, axis], kind="stable")
        filled = np.cumsum(sizes[order])[:-1] / sizes.sum()
        gaps = np.diff(centers[order, axis])
        allowed = np.flatnonzero((filled >= 0.25) & (filled <= 0.75))
        if not len(allowed):
            allowed = np.array([np.argmin(np.abs(filled - 0.5))])
        place = int(allowed[np.argmax(gaps[allowed])])
        if best is None or gaps[place] > best[0]:
            best = float(gaps[place]), axis, order, place + 1
    assert best is not None
    _, _, order, place = best
    return part[order[:place]], part[order[place:]]


def _clusters(boxes: Boxes, units: Indices) -> Indices:
    """The number of the cluster of each of some units: those whose boxes touch, directly or through others."""
    everything = np.ones(len(units), dtype=bool)
    pairs = np.array(_meeting((boxes[0][units], boxes[1][units]), everything, margin_m=_TOUCH_M), dtype=np.intp)
    return connected_groups(len(units), *pairs.reshape(-1, 2).T)


def _meeting(boxes: Boxes, is_first: NDArray[np.bool_], *, margin_m: float = 0.0) -> list[tuple[int, int]]:
    """The pairs of boxes that meet, of which the first one is in a mask; sorted, and both ways if both are."""
    low, high = boxes
    chosen = np.flatnonzero(is_first)
    if len(chosen) * len(low) <= _FEW:
        meets = np.all((low[chosen, None] - margin_m <= high) & (high[chosen, None] + margin_m >= low), axis=2)
        a, b = np.nonzero(meets)
        return [(x, y) for x, y in zip(chosen[a].tolist(), b.tolist(), strict=True) if x != y]
    identity = np.broadcast_to(np.eye(3), (len(low), 3, 3))
    oriented, everything = OrientedBoxes((low + high) / 2, identity, (high - low) / 2), np.ones(len(low), dtype=bool)
    found = []
    for a, b in overlapping_pairs(oriented, is_first, everything, margin=(margin_m,) * 3):
        found += [*zip(a[is_first[a]].tolist(), b[is_first[a]].tolist(), strict=True)]
        found += [*zip(b[is_first[b]].tolist(), a[is_first[b]].tolist(), strict=True)]
    return sorted(found)


def box_meets(box: Array, boxes: Boxes) -> NDArray[np.bool_]:
    """Whether each of some boxes meets a box, 2 x 3."""
    return np.asarray(np.all((boxes[0] <= box[1]) & (boxes[1] >= box[0]), axis=1))


def assign_units(
    tables: WorldTables, boxes: Boxes, regions: Sequence[Region], *, moved: Collection[BodyId]
) -> list[tuple[Indices, Region | None]]:
    """The regions of a world after an edit: the units of each, and which region it was before; None for a new one.

    Units stay where they are, unless they were moved out of the box of their region, or that has grown to twice its
    size. Others join the smallest region whose box contains what they touch, or else form regions of their own.

    Args:
        tables: the world.
        boxes: boxes of all units.
        regions: the regions so far.
        moved: bodies whose poses were set.
    """
    home = np.full(len(tables.unit_sizes), -1, dtype=np.intp)
    kept = [number for number, each in enumerate(regions) if _is_kept(each)]
    for number in kept:
        region = regions[number]
        rows = region.rows[region.is_own]
        units = tables.unit_of[rows[rows >= 0]]
        units = units[units >= 0]
        if not region.bodies.isdisjoint(moved):
            is_inside = _contains(region.box, (boxes[0][units], boxes[1][units]))
            is_moved = np.isin(units, tables.unit_of[[tables.rows[id] for id in moved if id in tables.rows]])
            units = units[is_inside | ~is_moved]
        home[units] = number
    counts = np.bincount(home[home >= 0], weights=tables.unit_sizes[home >= 0], minlength=len(regions))
    sizes = {number: int(counts[number]) for number in kept}
    loose = np.flatnonzero(home < 0)
    if kept and len(loose):
        cluster = _clusters(boxes, loose)
        for each in range(int(cluster.max()) + 1):
            units = loose[cluster == each]
            box = np.array([boxes[0][units].min(axis=0), boxes[1][units].max(axis=0)])
            count = int(tables.unit_sizes[units].sum())
            fitting = [
                (float(np.prod(regions[number].box[1] - regions[number].box[0])), number)
                for number in kept
                if sizes[number] + count <= 2 * REGION_BODIES and _contains(regions[number].box, (box[:1], box[1:]))[0]
            ]
            if fitting:
                number = min(fitting)[1]
                home[units], sizes[number] = number, sizes[number] + count
    found: list[tuple[Indices, Region | None]] = [(np.flatnonzero(home == number), regions[number]) for number in kept]
    found += [(units, None) for units in divide_units(tables, boxes, np.flatnonzero(home < 0))]
    return [(units, region) for units, region in found if len(units)]


def _is_kept(region: Region) -> bool:
    """Whether a region is not to be divided after an edit."""
    return bool(np.isfinite(region.box).all()) and len(region.bodies) <= 2 * REGION_BODIES


def _contains(box: Array, boxes: Boxes) -> NDArray[np.bool_]:
    """Whether a box, 2 x 3, contains each of some boxes."""
    return np.asarray(np.all((boxes[0] >= box[0]) & (boxes[1] <= box[1]), axis=1))


class Handovers(NamedTuple):
    """What has to change before time goes on."""

    regions: list[tuple[NDArray[np.bool_], int | None]]
    """The units of each region that needs another model, and the number that it had; None for a new region."""
    resting: list[int]
    """The numbers of regions in which only sleeping units are left."""
    swept: Boxes
    """Boxes within which all units are until the next check."""


def find_handovers(
    tables: WorldTables, regions: Sequence[Region], boxes: Boxes, poses: Array, duration_s: float
) -> Handovers:
    """Finds which units may meet one of another region, may leave what is in their model, or meet what is not there.

    Args:
        tables: the world.
        regions: its regions.
        boxes: boxes around all bodies.
        poses: poses of all bodies.
        duration_s: the time until the next check [s].
    """
    home = np.full(len(tables.unit_sizes), -1, dtype=np.intp)
    for number, region in enumerate(regions):
        home[tables.unit_of[region.rows[region.is_own]]] = number
    is_awake = np.zeros(len(home), dtype=bool)
    swept = tables.unit_boxes(boxes)
    for region in regions:
        if region.is_resting:
            continue
        places = region.awake_rows()
        rows = region.rows[places]
        units, radii = tables.unit_of[rows], np.linalg.norm(tables.half_extents[rows], axis=1)
        shifts = region.displacements(places, radii, duration_s)
        np.minimum.at(swept[0], units, boxes[0][rows] + shifts[:, :3] - _MARGIN_M)
        np.maximum.at(swept[1], units, boxes[1][rows] + shifts[:, 3:] + _MARGIN_M)
        is_awake[units] = True
    swept[0][is_awake, 2] -= _GRAVITY_M_S2 * duration_s**2 / 2
    awake = np.flatnonzero(is_awake)
    near = _near(swept, home, is_awake)
    target, outdated, count = home.copy(), _outdated(tables, regions, home, swept, poses), len(regions)
    sizes = np.bincount(home[home >= 0], weights=tables.unit_sizes[home >= 0], minlength=count).tolist()

    def move(units: list[int], number: int) -> None:
        for unit in units:
            sizes[target[unit]] -= int(tables.unit_sizes[unit])
            sizes[number] += int(tables.unit_sizes[unit])
            target[unit] = number

    for a in awake.tolist():
        for b in near.get(a, ()):
            if target[a] != target[b]:
                cluster, other = (_cluster_of(each, near, is_awake, target) for each in (a, b))
                is_other_smaller = is_awake[b] and len(other) < len(cluster)
                move(*((other, int(target[a])) if is_other_smaller else (cluster, int(target[b]))))
        number = int(target[a])
        if number < len(regions) and not _contains(regions[number].box, (swept[0][a : a + 1], swept[1][a : a + 1]))[0]:
            cluster = _cluster_of(a, near, is_awake, target)
            if len(cluster) == np.count_nonzero(target == number):
                outdated.add(number)
            else:
                sizes.append(0)
                move(cluster, len(sizes) - 1)
    changed = outdated | set(target[target != home].tolist())
    given = set(home[target != home].tolist()) - changed
    left = {number: bool(is_awake[target == number].any()) for number in given}
    changed |= {number for number, has_awake in left.items() if has_awake}
    found = [(target == number, number if number < len(regions) else None) for number in sorted(changed)]
    return Handovers([each for each in found if each[0].any()], [n for n, awake in left.items() if not awake], swept)


def _near(swept: Boxes, home: Indices, is_awake: NDArray[np.bool_]) -> dict[int, list[int]]:
    """For each unit that is awake, the units whose boxes meet its own."""
    found: dict[int, list[int]] = {}
    for number in np.unique(home[is_awake]).tolist():
        is_here = is_awake & (home == number)
        bounds = np.stack([swept[0][is_here].min(axis=0), swept[1][is_here].max(axis=0)])
        candidates = np.flatnonzero(box_meets(bounds, swept))
        for a, b in _meeting((swept[0][candidates], swept[1][candidates]), is_here[candidates]):
            found.setdefault(int(candidates[a]), []).append(int(candidates[b]))
    return found


def _cluster_of(unit: int, near: Mapping[int, list[int]], is_awake: NDArray[np.bool_], target: Indices) -> list[int]:
    """The units of the same region that a unit may touch, directly or through others that are awake."""
    found, pending = {unit}, [unit]
    while pending:
        for other in near.get(pending.pop(), ()):
            if other not in found and target[other] == target[unit]:
                found.add(other)
                if is_awake[other]:
                    pending.append(other)
    return sorted(found)


def _outdated(
    tables: WorldTables,
    regions: Sequence[Region],
    home: Indices,
    swept: Boxes,
    poses: Array,
) -> set[int]:
    """The numbers of regions whose models are wrong where one of their units may be until the next check.

    Either they are not current, or something has moved away that a unit may meet where it was.
    """
    found = set()
    for number, region in enumerate(regions):
        if region.is_resting:
            continue
        own = np.flatnonzero(home == number)  # also what sleeps, perhaps on what has moved away
        if not region.is_current:
            found.add(number)
        elif region.frozen:
            rows = np.array([tables.rows[id] for id in region.frozen], dtype=np.intp)
            compiled = np.array(list(region.frozen.values()))
            gone = np.abs(poses[rows] - compiled).max(axis=1) > _MOVED
            if gone.any():
                old = np.zeros_like(poses)
                old[rows[gone]] = compiled[gone]
                low, high = tables.boxes(old, rows[gone])
                at = np.stack([low, high], axis=1)
                if any(box_meets(box, (swept[0][own], swept[1][own])).any() for box in at):
                    found.add(number)
    return found
