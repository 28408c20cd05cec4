"""SceneKeeper: everything that a MuJoCo model is made from, kept true while a world is edited.

Edits are cheap: they change what is planned and mark the model as stale. `live` builds it when physics is
needed next, once for all edits since, and carries the running state over.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.contract import SpawnNote, SpawnReport
from mindstage.engines.forest import KinematicForest
from mindstage.engines.inventory import EntityRegistry
from mindstage.engines.mujoco.blueprint import ModelInput
from mindstage.engines.mujoco.build import compile_model
from mindstage.engines.mujoco.carry import transfer_state
from mindstage.engines.mujoco.live import CompiledModel
from mindstage.engines.planning import PhysicsModelBuilder
from mindstage.world import NO_GEOMETRY, BodyId, BodyPhysics, GeometryMap, Mobility, World
from mindstage.world.boxes import OrientedBoxes
from mindstage.world.geometry import Array, normalize, pose_array, pose_inverse, pose_multiply

__all__ = ["ModelCache"]


class ModelCache:
    """The plan, where everything stands, and the model made from both."""

    def __init__(self, timestep_s: float, *, time_s: float = 0.0) -> None:
        self.builder = PhysicsModelBuilder()
        self.stale = True
        self._timestep_s = timestep_s
        self._time_s = time_s
        self._compiled: CompiledModel | None = None
        self._pending_poses: dict[BodyId, Array] = {}
        """Poses that the model does not have yet."""
        self._at_rest: set[BodyId] = set()
        self._kinematics_driven = False
        self._changed_boxes: list[Array] = []

    def copy(self) -> ModelCache:
        """A keeper of its own in the same state, stale if this one is; compiled models never change, so are shared."""
        twin = ModelCache(self._timestep_s, time_s=self._time_s)
        twin.builder, twin.stale = self.builder.copy(), self.stale
        if self._compiled is not None:
            twin._compiled = copy.copy(self._compiled)
            twin._compiled.data = copy.copy(self._compiled.data)
        twin._pending_poses, twin._at_rest = dict(self._pending_poses), set(self._at_rest)
        twin._changed_boxes, twin._kinematics_driven = list(self._changed_boxes), self._kinematics_driven
        return twin

    # -- what there is -----------------------------------------------------------------------------------------

    @property
    def registry(self) -> EntityRegistry:
        """What stands here, as it was described."""
        return self.builder.registry

    @property
    def forest(self) -> KinematicForest:
        """Who hangs on whom now."""
        return self.builder.forest

    @property
    def late_notes(self) -> list[SpawnNote]:
        """What had to be decided because of edits, and what the physics warned of."""
        return self.builder.late_notes

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self._time_s if self._compiled is None else float(self._compiled.data.time)

    @property
    def last_model(self) -> CompiledModel | None:
        """The model that was built last, stale or not; None before the first."""
        return self._compiled

    def model(self) -> CompiledModel:
        """The model, made anew if anything changed since."""
        if self.stale or self._compiled is None:
            self._rebuild()
        assert self._compiled is not None
        return self._compiled

    def poses(self) -> Array:
        """All poses now, n x 7, in the order of the inventory's ids."""
        if not self.stale and self._compiled is not None:
            return self._compiled.poses()
        ids = self.registry.ids
        poses = np.zeros((len(ids), 7))
        known: Mapping[BodyId, int] = {}
        if self._compiled is not None:
            known, before = self._compiled.rows, self._compiled.poses()
            old = np.fromiter((known.get(id, -1) for id in ids), dtype=np.intp, count=len(ids))
            poses[old >= 0] = before[old[old >= 0]]
        for row, id in enumerate(ids):
            if id in self._pending_poses:
                poses[row] = self._pending_poses[id]
        return poses

    def poses_by_id(self) -> dict[BodyId, Array]:
        """All poses now, by body."""
        return dict(zip(self.registry.ids, self.poses(), strict=True))

    def bounds(self, ids: Iterable[BodyId]) -> Array:
        """The box around some bodies, 2 x 3: lower and upper corner [m]."""
        where = self.poses_by_id()
        wanted = list(ids)
        poses = np.array([where[id] for id in wanted]).reshape(-1, 7)
        low, high = OrientedBoxes.from_poses(poses, self.builder.mass_properties.sizes(wanted)).bounds()
        return np.array([low.min(axis=0), high.max(axis=0)])

    def model_input(self, poses: Array | None = None) -> ModelInput:
        """All that a model of it is made from.

        Args:
            where: all poses, if they are at hand.
        """
        poses = self.poses() if poses is None else poses
        return ModelInput.from_builder(self.builder, poses, self._timestep_s, kinematics_driven=self._kinematics_driven)

    # -- edits -------------------------------------------------------------------------------------------------

    def add(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        """See `Engine.spawn`."""
        before = self.poses()
        report = self.builder.add(world, before, geometry=geometry)
        came = self.registry.ids[len(before) :]
        poses = pose_array(self.registry.bodies[id].pose for id in came)
        poses[:, 3:] = normalize(poses[:, 3:])
        self._pending_poses.update(zip(came, poses, strict=True))
        self.stale = True
        return report

    def remove(self, ids: tuple[BodyId, ...]) -> None:
        """See `Engine.delete`."""
        gone = {self.registry.body(id).id for id in ids}
        if not gone:
            return
        self._changed_boxes.append(self.bounds(gone))
        self.builder.remove(gone)
        for id in gone:
            self._pending_poses.pop(id, None)
        self._at_rest -= gone
        self.stale = True
        if self._compiled is not None:  # what comes under the same name later is something else
            self._compiled = self._compiled.without(gone, remaining_joints=self.registry.joints)

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """See `Engine.attach_parts`."""
        self.builder.attach(parent, child, self.poses())
        self.stale = True

    def detach(self, child: BodyId) -> None:
        """See `Engine.detach`."""
        self.stale |= self.builder.detach(child)

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        """See `Engine.set_physics`."""
        self.builder.set_physics(id, physics)
        self._changed_boxes.append(self.bounds([id]))
        self.stale = True

    def move(self, id: BodyId, target: Array) -> None:
        """Puts a body, and all that goes with it, somewhere else; for bodies that no joint holds."""
        where = self.poses_by_id()
        moving = self.builder.bodies_moving_with(id)
        self._changed_boxes.append(self.bounds(moving))
        self.builder.update_attachment_pose(id, target, self.poses())
        new_from_old = pose_multiply(target, pose_inverse(where[id]))
        moved = pose_multiply(new_from_old, np.array([where[body] for body in moving]))
        moved[:, 3:] = normalize(moved[:, 3:])
        self._pending_poses.update(zip(moving, moved, strict=True))
        self._pending_poses[id] = target
        self._at_rest.update(moving)
        self._changed_boxes.append(self.bounds(moving))
        self.stale = True

    def enable_kinematic_motion(self, id: BodyId) -> None:
        """Makes kinematic bodies such that they can be moved in place, if this is one and the first that is."""
        assembly = self.forest.groups.get(id)
        if not self._kinematics_driven and assembly is not None and assembly.mobility is Mobility.KINEMATIC:
            self._kinematics_driven = self.stale = True

    def _rebuild(self) -> None:
        where = self.poses()
        self.builder.update_collisions(where)
        ids = self.registry.ids
        new = compile_model(self.model_input(where))
        new.data.time = self.time_s
        disturbed: NDArray[np.float64] = np.array(self._changed_boxes).reshape(-1, 2, 3)
        transfer_state(
            self._compiled, new, dict(zip(ids, where, strict=True)), self.builder.joint_frames, self._at_rest, disturbed
        )
        self._compiled, self.stale = new, False
        self._pending_poses, self._at_rest, self._changed_boxes = {}, set(), []
