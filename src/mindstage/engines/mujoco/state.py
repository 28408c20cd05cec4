"""The state of a compiled MuJoCo model, and its transfer to the next model.

An edit produces a new model. Joint coordinates, velocities and sleep are copied from the old one by name; bodies on new
joints get their coordinates from their poses.
"""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import ActuatorState, Contact, DynamicsScale
from mindstage.engines.kinematic_tree import JointAxis, TreeJoint, joint_coordinates
from mindstage.engines.mujoco.arena import ARENA_CAP_BYTES, copy_state, is_exhausted, larger_model, new_data, run_mujoco
from mindstage.errors import EngineError
from mindstage.ranges import Count, NotNegative, checked
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array, pose_inverse, pose_multiply, quat_conjugate, quat_rotate

__all__ = [
    "STIFFENING",
    "SUBSTEPS",
    "CompiledModel",
    "CompiledState",
    "ContactPoints",
    "FastContact",
    "FastGroup",
    "KinematicMotion",
    "MergedContacts",
    "ModelActuators",
    "ModelJoint",
    "Obstacle",
    "actuator_states",
    "contact_points",
    "current_joint_coordinates",
    "find_contacts",
    "ground_last",
    "limit_stiffness",
    "merge_contacts",
    "scale_model",
    "set_commands",
    "set_joint_coordinates",
    "set_tolerance",
    "transfer_state",
    "wake_islands",
]

T = TypeVar("T")


@dataclass(slots=True)
class ModelJoint:
    """A tree joint in a compiled model."""

    tree_joint: TreeJoint
    axes: tuple[JointAxis, ...]
    is_ball: bool
    qpos_address: int
    """Start of its coordinates in `qpos`, in the order of `axes`; the quaternion of a ball joint comes last."""
    dof_address: int
    """Start of its velocities in `qvel`."""
    body_id: int
    """The MuJoCo body that it moves."""


class ModelActuators(NamedTuple):
    """The actuators of a compiled model, in the order of its controls."""

    names: tuple[str, ...]
    positions: list[int]
    """Addresses of their positions in `qpos`."""
    dofs: list[int]
    """Addresses of their velocities in `qvel`."""
    signs: list[float]
    """-1 where the coordinate in the tree is that of the map negated."""


_NO_ACTUATORS = ModelActuators((), [], [], [])


class CompiledState(NamedTuple):
    """All that changes in a model while time passes, except what is for speed only."""

    qpos: Array
    qvel: Array
    time_s: float


class FastGroup(NamedTuple):
    """A rigid group that moves fast."""

    root: BodyId
    velocity: Array
    """That of the origin of the root [m/s]."""
    spin: Array
    """Its angular velocity [rad/s], 0 for a free body; both in the world frame."""
    is_free: bool


class Obstacle(NamedTuple):
    """What a point of a fast group will hit, or that will be hit by the group."""

    distance_m: float
    speed: float
    """How fast they get nearer to one another [m/s]."""
    row: int
    """The row of the body of the group."""
    thickness_m: float
    friction: float


class FastContact(NamedTuple):
    """How the contacts of a fast group are changed."""

    friction: float
    """The least friction of what it hits."""
    stiffening: float
    """By how much their time constants are shorter, unless they bounce: from 1 to `STIFFENING`."""


class KinematicMotion(NamedTuple):
    """How a kinematic body gets to the pose that was set last; velocities are those of a free joint.

    These are linear in the world frame [m/s], then angular in the body frame [rad/s].
    """

    set_at_s: float
    """The simulated time at which that pose was set [s]."""
    steps: int
    """Number of time steps until it is there."""
    pose: Array
    """Where the body is for the physics; `qpos` has the pose that was set."""
    velocity: Array
    """Its velocity there."""
    acceleration: Array
    """[m/s²], [rad/s²]."""
    mean_velocity: Array
    """Of the whole motion."""
    before: Array
    """The mean velocity of the motion before."""


SUBSTEPS, STIFFENING = 8, 40
"""The number of parts of a time step in which a body may pass through another one, and the largest factor by which the
time constants of contacts are then shorter: to two parts, the least with which a contact is stable."""
_FAST_PRIORITY = 20_000
"""Added to the priority of the geoms of fast bodies, above that of all others."""
_DEEP_M = 0.0005
_NONE_FAST: Mapping[BodyId, FastContact] = MappingProxyType({})
_MAX_ARM_M = 5.0
"""No door is wider [m]."""
_CORNERS = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), axis=-1).reshape(8, 3)
_FIRST_PERIOD_S, _MAX_PERIOD_S = 0.02, 0.1
"""The time of the first motion of a kinematic body, and the longest one [s]."""
_CORRECTION_STEPS = 50
"""Number of time steps after which kinematic bodies at rest are put back where they belong."""
_MAX_SPEEDS = (5.0, 30.0)
"""Largest speeds of a kinematic body that moves to a pose [m/s, rad/s]."""
_MAX_ACCELERATIONS = (20.0, 200.0)
"""Largest accelerations between two motions [m/s², rad/s²]; beyond these, the velocity changes suddenly."""


def _exceeds(vector: Array, limits: tuple[float, float]) -> bool:
    """Whether the linear or the angular half of a vector is longer than its limit."""
    return bool(np.linalg.norm(vector[:3]) > limits[0] or np.linalg.norm(vector[3:]) > limits[1])


@dataclass(slots=True)
class CompiledModel:
    """A compiled model with its data, and the addresses of bodies and joints in it."""

    model: Any
    data: Any
    rows: dict[BodyId, int]
    """Row of each body in arrays of poses."""
    body_ids: dict[BodyId, int]
    """MuJoCo's id of each body; scenery has none."""
    body_id_order: NDArray[np.intp]
    """The same as an array in the order of `rows`, to read all poses at once; 0 for scenery."""
    scenery: NDArray[np.intp]
    """Rows of the bodies that are part of MuJoCo's world body."""
    scenery_poses: Array
    """Their poses, k x 7."""
    joints: dict[BodyId, ModelJoint]
    """The tree joints by id."""
    free_joint_addresses: dict[BodyId, tuple[int, int]]
    """Addresses in `qpos` and `qvel` of each rigid group with a free joint."""
    kinematic_addresses: dict[BodyId, tuple[int, int]]
    """The same of each kinematic group that can be moved."""
    geom_rows: NDArray[np.intp]
    """Row of the body of each geom; -1 for the ground."""
    actuators: ModelActuators = _NO_ACTUATORS
    arena_cap_bytes: int = ARENA_CAP_BYTES
    """The size up to which the arena grows."""
    poses_outdated: bool = False
    """Whether time has advanced since the poses in `data` were computed: `mj_step` computes those before its step."""
    motions: dict[BodyId, KinematicMotion] = field(default_factory=dict)
    """The last motion of each kinematic group."""
    kinematic_state: tuple[Array, Array] | None = None
    """Where kinematic groups are for the physics, k x 7, and their velocities, k x 6, as contacts have changed them by
    less than a micrometer since the last correction; None for the poses that were set, at rest."""
    kinematic_rows: dict[BodyId, int] = field(init=False)
    """The row of each kinematic group in these."""
    kinematic_roots: dict[int, BodyId] = field(init=False)
    """The root of each kinematic group by MuJoCo's number of it."""
    free_heights: NDArray[np.intp] = field(init=False)
    """Addresses in `qpos` of the heights of the free joints, in the order of `free_joint_addresses`."""

    free_velocities: NDArray[np.intp] = field(init=False)
    """Addresses in `qvel` of their linear velocities, k x 3."""
    kinematic_qpos: NDArray[np.intp] = field(init=False)
    """The addresses of all coordinates of kinematic groups in `qpos`, k x 7."""
    kinematic_dofs: NDArray[np.intp] = field(init=False)
    """Those of their velocities in `qvel`, k x 6."""
    is_kinematic: NDArray[np.bool_] = field(init=False)
    """Whether each MuJoCo body is part of a kinematic group that can be moved."""
    divided: tuple[Any, dict[BodyId, FastContact], Any] | None = None
    """A model, fast bodies, and the same model with divided time steps for these; None until a step needs it."""
    before: tuple[Any, dict[BodyId, KinematicMotion], tuple[Array, Array] | None] | None = field(
        init=False, default=None
    )
    """Data, motions and `kinematic_state` before the last step; None before the first one."""

    _jointed: tuple[list[BodyId], NDArray[np.intp], Array] | None = field(init=False, default=None)
    """The result of `_jointed_groups`."""

    def __post_init__(self) -> None:
        addresses = np.array(list(self.free_joint_addresses.values()), dtype=np.intp).reshape(-1, 2)
        self.free_heights = addresses[:, 0] + 2
        self.free_velocities = addresses[:, 1:] + np.arange(3)
        self.kinematic_rows = {root: row for row, root in enumerate(self.kinematic_addresses)}
        addresses = np.array(list(self.kinematic_addresses.values()), dtype=np.intp).reshape(-1, 2)
        self.kinematic_qpos, self.kinematic_dofs = addresses[:, :1] + np.arange(7), addresses[:, 1:] + np.arange(6)
        self.kinematic_roots = {self.body_ids[root]: root for root in self.kinematic_addresses}
        self.is_kinematic = np.isin(self.model.body_weldid, list(self.kinematic_roots))

    def copy(self) -> CompiledModel:
        """An independent copy of the state, sleep included; the model and all addresses are shared."""
        result = replace(self, motions=dict(self.motions))
        result.data = copy.copy(self.data)
        return result

    def set_kinematic_pose(self, root: BodyId, target: Array, *, at_once: bool) -> None:
        """Sets the pose of a kinematic group.

        For the physics, it moves there within the time since its pose was set before, at most `_MAX_PERIOD_S`, else
        within `_FIRST_PERIOD_S`: as a program moves a body that sets a pose in each of its cycles. Its mean velocity
        follows from the distance, and its acceleration from the mean velocity before, unless that were beyond
        `_MAX_ACCELERATIONS`. If the velocity were beyond `_MAX_SPEEDS`, or with `at_once`, the body is there at once,
        at rest.
        """
        address, now_s, timestep_s = self.kinematic_addresses[root][0], float(self.data.time), self.model.opt.timestep
        qpos = self.data.qpos[address : address + 7]
        last, steps, before = self.motions.get(root), round(_FIRST_PERIOD_S / timestep_s), np.zeros(6)
        start = last.pose if last is not None and last.steps else qpos.copy()
        if last is not None and now_s - last.set_at_s < _MAX_PERIOD_S:
            passed = round((now_s - last.set_at_s) / timestep_s)
            before = last.mean_velocity if passed else last.before
            steps = passed or last.steps or steps
        duration_s, turn = max(steps, 1) * timestep_s, np.zeros(3)
        mujoco.mju_subQuat(turn, target[3:], start[3:])
        mean = np.concatenate([target[:3] - start[:3], turn]) / duration_s
        acceleration = (mean - before) / duration_s
        if at_once or _exceeds(mean, _MAX_SPEEDS):
            steps, mean = 0, np.zeros(6)
        if _exceeds(acceleration, _MAX_ACCELERATIONS):
            acceleration = np.zeros(6)
        velocity = mean - acceleration * (duration_s + timestep_s) / 2  # MuJoCo changes the velocity, then the pose
        self.motions[root] = KinematicMotion(now_s, steps, start, velocity, acceleration, mean, before)
        if self.kinematic_state is not None:
            poses, velocities = (each.copy() for each in self.kinematic_state)
            poses[self.kinematic_rows[root]], velocities[self.kinematic_rows[root]] = target, 0.0
            self.kinematic_state = poses, velocities
        qpos[:] = target

    @checked
    def step(self, count: Count, *, fast: Mapping[BodyId, FastContact] = _NONE_FAST) -> None:
        """Advances time by some steps; if the arena is exhausted, it grows, and the steps are repeated.

        The result is the same as with an arena that was large from the beginning.

        Args:
            count: number of time steps.
            fast: groups that may pass through others, by root: each step is divided into `SUBSTEPS`, in which their
                contacts are stiffer.

        Raises:
            EngineMemoryError: the arena would exceed its largest size; nothing has changed.
            EngineError: MuJoCo failed; nothing has changed.
        """
        data = new_data(self.model) if self.before is None else self.before[0]
        mujoco.mj_copyData(data, self.model, self.data)
        self.before = data, dict(self.motions), self.kinematic_state
        try:
            while not self._advance(count, fast):
                larger = larger_model(self.model, self.data, cap_bytes=self.arena_cap_bytes)
                self.before = copy_state(larger, self.before[0]), *self.before[1:]
                self.model, self.data = larger, new_data(larger)
                self.step_back()
        except EngineError:
            self.step_back()
            raise

    def _advance(self, count: int, fast: Mapping[BodyId, FastContact]) -> bool:
        """Advances time by some steps; False if the arena was exhausted, and the state is invalid."""
        while count:
            if not self.kinematic_addresses:
                return self._run(count, fast)
            moving = {root: motion for root, motion in self.motions.items() if motion.steps}
            part = min(count, self._steps_to_correction(), *(motion.steps for motion in moving.values()))
            if not self._step_with_motions(moving, part, fast):
                return False
            count -= part
        return True

    def _steps_to_correction(self) -> int:
        """The time steps until kinematic bodies at rest are put back where they belong: a function of the time."""
        return _CORRECTION_STEPS - round(float(self.data.time / self.model.opt.timestep)) % _CORRECTION_STEPS

    def _step_with_motions(
        self, moving: Mapping[BodyId, KinematicMotion], count: int, fast: Mapping[BodyId, FastContact]
    ) -> bool:
        """As `_advance`, with steps in which kinematic bodies have the poses and velocities of their motions.

        However the steps are divided among calls, the result is the same: nothing is rounded between two of them.
        """
        data, dofs, is_corrected = self.data, self.kinematic_dofs, count == self._steps_to_correction()
        targets = data.qpos[self.kinematic_qpos]
        poses, velocities = (targets, np.zeros(dofs.shape)) if self.kinematic_state is None else self.kinematic_state
        poses, velocities, forces = poses.copy(), velocities.copy(), np.zeros(dofs.shape)
        # Semi-implicit steps add the acceleration first: the distance of shorter ones is the same from a later speed.
        later_s = self.model.opt.timestep * (SUBSTEPS - 1) / (2 * SUBSTEPS) if fast else 0.0
        for root, motion in moving.items():
            row = self.kinematic_rows[root]
            poses[row], velocities[row] = motion.pose, motion.velocity + later_s * motion.acceleration
            forces[row] = self.model.dof_M0[dofs[row]] * motion.acceleration
        data.qpos[self.kinematic_qpos], data.qvel[dofs], data.qfrc_applied[dofs] = poses, velocities, forces
        try:
            if not self._run(count, fast):
                return False
            poses, velocities = self.data.qpos[self.kinematic_qpos], self.data.qvel[dofs]
            is_there = np.full(len(dofs), is_corrected)
            for root, motion in moving.items():
                row = self.kinematic_rows[root]
                pose, velocity = poses[row].copy(), velocities[row] - later_s * motion.acceleration
                self.motions[root] = motion._replace(pose=pose, velocity=velocity, steps=motion.steps - count)
                is_there[row] = motion.steps == count
            poses[is_there], velocities[is_there] = targets[is_there], 0.0
            self.kinematic_state = poses, velocities
        finally:
            self.data.qpos[self.kinematic_qpos] = targets
            self.data.qvel[dofs] = self.data.qfrc_applied[dofs] = 0.0
        return True

    def _run(self, count: int, fast: Mapping[BodyId, FastContact]) -> bool:
        self.poses_outdated = True
        steps = count * (SUBSTEPS if fast else 1)
        return run_mujoco(mujoco.mj_step, self._divided(fast), self.data, nstep=steps) and not is_exhausted(self.data)

    def step_back(self) -> None:
        """Restores the state before the last `step`."""
        assert self.before is not None
        data, motions, self.kinematic_state = self.before
        self.motions = dict(motions)
        mujoco.mj_copyData(self.data, self.model, data)
        self.poses_outdated = True

    def _divided(self, fast: Mapping[BodyId, FastContact]) -> Any:
        """The model with a shorter time step, in which the contacts of fast bodies have shorter time constants.

        Others keep theirs: what is deep in a soft contact would be thrown out of a stiff one.
        """
        if not fast:
            return self.model
        if self.divided is None or self.divided[0] is not self.model or self.divided[1] != fast:
            divided = copy.copy(self.model)
            divided.opt.timestep /= SUBSTEPS
            for root in fast.keys() & self.body_ids.keys():
                geoms = self._geoms_of_tree(root)
                divided.geom_priority[geoms] += _FAST_PRIORITY
                divided.geom_friction[geoms, 0] = np.minimum(divided.geom_friction[geoms, 0], fast[root].friction)
                damping = divided.geom_solref[geoms, 1]
                divided.geom_solref[geoms, 0] /= np.where(damping < 1.0, SUBSTEPS, fast[root].stiffening)
            self.divided = self.model, dict(fast), divided
        return self.divided[2]

    def pressed_trees(self) -> set[int]:
        """All trees, as MuJoCo numbers them, that are already deep in a contact."""
        contact = self.data.contact
        deep = np.asarray(contact.geom)[np.asarray(contact.dist) < -_DEEP_M]
        return set(self.model.body_treeid[self.model.geom_bodyid[deep]].ravel().tolist())

    def is_falling(self, root: BodyId) -> bool:
        """Whether nothing carried a loose body in the last step."""
        dof = self.free_joint_addresses[root][1]
        return bool(self.data.qacc[dof + 2] < self.model.opt.gravity[2] / 2)

    @contextmanager
    def at_physical_poses(self) -> Iterator[None]:
        """While it is open, geoms of kinematic groups are where they are for the physics, not where they were set."""
        self.update_poses()
        moving = {root: motion for root, motion in self.motions.items() if motion.steps}
        if not moving:
            yield
            return
        targets = self.data.qpos[self.kinematic_qpos]
        for root, motion in moving.items():
            self.data.qpos[self.kinematic_qpos[self.kinematic_rows[root]]] = motion.pose
        mujoco.mj_kinematics(self.model, self.data)
        yield
        self.data.qpos[self.kinematic_qpos] = targets
        mujoco.mj_kinematics(self.model, self.data)

    def _geoms_of_tree(self, root: BodyId) -> NDArray[np.bool_]:
        """Whether each geom is one of the tree of a body."""
        trees = self.model.body_treeid
        return np.asarray(trees[self.model.geom_bodyid] == trees[self.body_ids[root]])

    @checked
    def fast_groups(self, min_speed: NotNegative) -> Iterator[FastGroup]:
        """Loose bodies, groups on joints without actuators and kinematic ones that may have a part so fast [m/s]."""
        data, nothing = self.data, np.zeros(3)
        velocities, roots = data.qvel[self.free_velocities], list(self.free_joint_addresses)
        for row in np.flatnonzero(np.linalg.norm(velocities, axis=1) > min_speed).tolist():
            yield FastGroup(roots[row], velocities[row], nothing, is_free=True)
        jointed, numbers, arms = self._jointed_groups()
        spins, arm = data.cvel[numbers, :3], data.xpos[numbers] - data.subtree_com[self.model.body_rootid[numbers]]
        linear = data.cvel[numbers, 3:] + np.cross(spins, arm)
        speeds = np.linalg.norm(linear, axis=1) + np.linalg.norm(spins, axis=1) * arms
        for row in np.flatnonzero(speeds > min_speed).tolist():
            yield FastGroup(jointed[row], linear[row], spins[row], is_free=False)
        for root, motion in self.motions.items():
            if motion.steps:
                spin = quat_rotate(motion.pose[3:], motion.mean_velocity[3:])
                if self._is_fast(root, motion.mean_velocity[:3], spin, min_speed):
                    yield FastGroup(root, motion.mean_velocity[:3], spin, is_free=False)

    @checked
    def may_be_fast(self, min_speed: NotNegative) -> bool:
        """Whether `fast_groups` may find some, which costs less."""
        free = np.abs(self.data.qvel[self.free_velocities]).max(initial=0.0)
        is_jointed = bool(self.joints) and np.abs(self.data.qvel).max(initial=0.0) > min_speed / _MAX_ARM_M
        return bool(free > min_speed / 2 or is_jointed or any(each.steps for each in self.motions.values()))

    def _jointed_groups(self) -> tuple[list[BodyId], NDArray[np.intp], Array]:
        """The roots of the groups on joints without actuators, MuJoCo's numbers of them, and how far they reach."""
        if self._jointed is None:
            driven, known = set(self.actuators.dofs), {number: id for id, number in self.body_ids.items()}
            free = [
                each.body_id
                for each in self.joints.values()
                if each.body_id in known
                and driven.isdisjoint(range(each.dof_address, each.dof_address + len(each.axes)))
            ]
            arms = np.array([self._arm_m(number) for number in free])
            self._jointed = [known[number] for number in free], np.array(free, dtype=np.intp), arms
        return self._jointed

    def _arm_m(self, number: int) -> float:
        """How far the geoms of a rigid group are from the origin of its root, at most [m]."""
        model, data = self.model, self.data
        geoms = np.flatnonzero(model.body_weldid[model.geom_bodyid] == number)
        arms = np.linalg.norm(data.geom_xpos[geoms] - data.xpos[number], axis=1) + model.geom_rbound[geoms]
        return float(arms.max(initial=0.0))

    def _is_fast(self, root: BodyId, velocity: Array, spin: Array, min_speed: float) -> bool:
        return bool(np.linalg.norm(velocity) + np.linalg.norm(spin) * self._arm_m(self.body_ids[root]) > min_speed)

    def _velocity_at(self, body_id: int, point: Array) -> Array:
        """The velocity of a point of a body in the world frame [m/s]."""
        spin, linear = self.data.cvel[body_id, :3], self.data.cvel[body_id, 3:]
        center = self.data.subtree_com[self.model.body_rootid[body_id]]
        return np.asarray(linear + np.cross(spin, point - center))

    @checked
    def obstacles(self, group: FastGroup, within_s: NotNegative, contact_s: NotNegative) -> Iterator[Obstacle]:
        """What a fast group will hit within a time [s], and for one that is not free, what it may pass through.

        Rays are cast from the corners and the center of each of its geoms. For a group that is not free, such as a door
        that sweeps over a table, rays against its motion are cast from what can move near it, too. Planes, which stop
        everything, and bodies that bounce are left out.

        Args:
            group: the group.
            within_s: the time to look ahead [s].
            contact_s: how long a body moves on after a contact began [s].
        """
        model = self.model
        body_id = self.body_ids[group.root]
        is_own = self._geoms_of_tree(group.root)
        own = np.flatnonzero(is_own if group.is_free else model.body_weldid[model.geom_bodyid] == body_id)
        others = (
            np.zeros(0, dtype=np.intp) if group.is_free else self._thin_geoms(group, own, is_own, within_s, contact_s)
        )
        if group.is_free or len(others):
            for geom in own.tolist():
                for point, velocity in self._moving_points(geom, group):
                    yield from self._hit(geom, point, velocity, within_s, is_own, is_reversed=False)
        for geom in others[model.body_treeid[model.geom_bodyid[others]] >= 0].tolist():
            for point, velocity in self._moving_points(geom, group):
                yield from self._hit(geom, point, velocity, within_s, is_own, is_reversed=True)

    def _thin_geoms(
        self, group: FastGroup, own: NDArray[np.intp], is_own: NDArray[np.bool_], within_s: float, contact_s: float
    ) -> NDArray[np.intp]:
        """The geoms near enough to a group to be hit, and so thin, or it is, that they may pass through each other."""
        model, data = self.model, self.data
        arms = np.linalg.norm(data.geom_xpos[own] - data.xpos[self.body_ids[group.root]], axis=1)
        arms += model.geom_rbound[own]
        speed, spin = float(np.linalg.norm(group.velocity)), float(np.linalg.norm(group.spin))
        others, half = np.flatnonzero(~is_own), model.geom_aabb[:, 3:].min(axis=1)
        largest_m = (speed + spin * arms.max(initial=0.0)) * contact_s
        if half[own].min(initial=np.inf) >= largest_m:
            others = others[half[others] < largest_m]
        reach = speed * within_s + min(spin * within_s, 2.0) * arms + model.geom_rbound[own]
        distances = np.linalg.norm(data.geom_xpos[others, None] - data.geom_xpos[own], axis=2)
        is_near = distances <= reach + model.geom_rbound[others, None]
        is_near |= model.geom_rbound[others, None] <= 0.0  # planes
        return np.asarray(others[is_near.any(axis=1)])

    def _moving_points(self, geom: int, group: FastGroup) -> Iterator[tuple[Array, Array]]:
        """Corners and center of a geom, and the velocity of a group there."""
        center, half = self.model.geom_aabb[geom, :3], self.model.geom_aabb[geom, 3:]
        points = np.concatenate([center[None], center + 0.9 * half * _CORNERS])
        points = points @ self.data.geom_xmat[geom].reshape(3, 3).T + self.data.geom_xpos[geom]
        origin = self.data.xpos[self.body_ids[group.root]]
        yield from zip(points, group.velocity + np.cross(group.spin, points - origin), strict=True)

    def _hit(
        self, geom: int, point: Array, velocity: Array, within_s: float, is_own: NDArray[np.bool_], *, is_reversed: bool
    ) -> Iterator[Obstacle]:
        """What a ray from a point of a geom hits in time, with or against a velocity there."""
        model, found = self.model, np.full(1, -1, dtype=np.int32)
        speed, sign = float(np.linalg.norm(velocity)), -1.0 if is_reversed else 1.0
        if speed == 0.0:
            return
        direction, body_id = velocity / speed, int(model.geom_bodyid[geom])
        distance_m = mujoco.mj_ray(model, self.data, point, sign * direction, None, 1, body_id, found)
        hit = int(found[0])
        if hit < 0 or bool(is_own[hit]) is not is_reversed or not self._can_touch(geom, hit):
            return
        other, mine = (geom, hit) if is_reversed else (hit, geom)
        is_plane = model.geom_type[other] == int(mujoco.mjtGeom.mjGEOM_PLANE)
        speed -= float(direction @ self._velocity_at(int(model.geom_bodyid[other]), point))
        if distance_m <= speed * within_s and not is_plane and model.geom_solref[other, 1] >= 1.0:
            thickness_m = 2 * float(model.geom_aabb[other, 3:].min())
            friction = float(model.geom_friction[other, 0])
            yield Obstacle(distance_m, speed, int(self.geom_rows[mine]), thickness_m, friction)

    def _can_touch(self, a: int, b: int) -> bool:
        """Whether two geoms of different trees can touch."""
        model = self.model
        if not (model.geom_contype[a] & model.geom_conaffinity[b] or model.geom_contype[b] & model.geom_conaffinity[a]):
            return False
        low, high = sorted((int(model.geom_bodyid[a]), int(model.geom_bodyid[b])))
        return not (model.exclude_signature == (low << 16) + high).any()

    def forward(self) -> None:
        """Computes all that depends on the state, such as contacts; the arena grows if it is exhausted.

        Raises:
            EngineMemoryError: the arena would exceed its largest size.
        """
        state = copy.copy(self.data)
        while not run_mujoco(mujoco.mj_forward, self.model, self.data) or is_exhausted(self.data):
            self.model = larger_model(self.model, self.data, cap_bytes=self.arena_cap_bytes)
            self.data, self.before = copy_state(self.model, state), None

    def __getstate__(self) -> tuple[None, dict[str, object]]:
        """The state to pickle, without the data that are allocated again when they are needed."""
        return None, {each.name: getattr(self, each.name) for each in fields(self)} | {
            "before": None,
            "divided": None,
        }

    def __setstate__(self, state: object) -> None:
        """Restores a pickled model, whose data lack MuJoCo's lists of awake bodies."""
        for each in fields(self):
            setattr(self, each.name, state[1][each.name])  # type: ignore[index]
        if _UPDATE_SLEEP is not None:
            _UPDATE_SLEEP(self.model._address, self.data._address)
        else:  # then all bodies wake up, and fall asleep again
            self.data.tree_asleep[:] = _FULLY_AWAKE
            self.forward()

    def without(self, removed: Collection[BodyId], *, remaining_joints: Container[BodyId]) -> CompiledModel:
        """The same model without some bodies and joints, so that their state is not transferred.

        Args:
            removed: ids of the bodies to omit.
            remaining_joints: ids of the joints to keep.
        """

        def kept(addresses: Mapping[BodyId, T]) -> dict[BodyId, T]:
            return {id: address for id, address in addresses.items() if id not in removed}

        return replace(
            self,
            body_ids=kept(self.body_ids),
            free_joint_addresses=kept(self.free_joint_addresses),
            kinematic_addresses=kept(self.kinematic_addresses),
            joints={id: joint for id, joint in self.joints.items() if id in remaining_joints},
        )

    def set_state(self, state: CompiledState, *, contacts: bool = True) -> None:
        """Sets the state; everything is awake then.

        Args:
            state: the state.
            contacts: whether contacts and forces are computed, too, and not the poses only.
        """
        data = self.data
        data.time = state.time_s
        data.qpos[:], data.qvel[:] = state.qpos, state.qvel
        self.motions, self.kinematic_state = {}, None
        data.tree_asleep[:] = _FULLY_AWAKE
        self.poses_outdated = False
        if _UPDATE_SLEEP is not None:
            _UPDATE_SLEEP(self.model._address, data._address)
        if contacts or _UPDATE_SLEEP is None:
            self.forward()
        else:
            mujoco.mj_kinematics(self.model, data)

    def state(self) -> CompiledState:
        """A copy of the state."""
        data = self.data
        return CompiledState(data.qpos.copy(), data.qvel.copy(), float(data.time))

    def update_poses(self) -> None:
        """Computes the poses of bodies and geoms in `data` if time has advanced."""
        if self.poses_outdated:
            mujoco.mj_kinematics(self.model, self.data)
            self.poses_outdated = False

    def include_pairs(self, pairs: Iterable[tuple[BodyId, BodyId]]) -> None:
        """Lets excluded pairs collide, in a copy of the model, since forks share it.

        MuJoCo searches the sorted signatures of excluded pairs: each one is overwritten by a neighbor that stays.
        """
        self.model = copy.copy(self.model)
        signatures = self.model.exclude_signature
        ends = np.sort([[self.body_ids[id] for id in pair] for pair in pairs], axis=1)
        kept = np.flatnonzero(~np.isin(signatures, (ends[:, 0] << 16) + ends[:, 1]))
        if len(kept):
            nearest = np.searchsorted(kept, np.arange(len(signatures))).clip(max=len(kept) - 1)
            signatures[:] = signatures[kept[nearest]]
        else:
            signatures[:] = 0  # no pair has this one

    def poses(self) -> Array:
        """All poses, n x 7, in the order of `rows`."""
        self.update_poses()
        poses = np.empty((len(self.body_id_order), 7))
        poses[:, :3], poses[:, 3:] = self.data.xpos[self.body_id_order], self.data.xquat[self.body_id_order]
        poses[self.scenery] = self.scenery_poses
        return poses


def _update_sleep() -> Callable[[int, int], object] | None:
    """MuJoCo's internal function that updates all other sleep data from `tree_asleep`, if it can be loaded.

    The library exports it, but the Python binding does not. Without it, sleeping bodies wake up at each edit until they
    fall asleep again.
    """
    for path in Path(mujoco.__file__).parent.glob(f"*mujoco*{mujoco.__version__}*"):
        if path.suffix in {".dll", ".dylib"} or ".so" in path.name:
            function = getattr(ctypes.CDLL(str(path)), "mj_updateSleep", None)
            if function is not None:
                function.argtypes, function.restype = (ctypes.c_void_p, ctypes.c_void_p), None
                return cast("Callable[[int, int], object]", function)
    return None


_UPDATE_SLEEP = _update_sleep()
_TOLERANCE = 1e-8
"""MuJoCo's default."""
_FULLY_AWAKE = -(1 + mujoco.mjMINAWAKE)
"""MuJoCo increments this value in every step in which a tree does not move; at 0 the tree sleeps."""


def transfer_state(
    owners: Mapping[BodyId, CompiledModel],
    new: CompiledModel,
    poses: Mapping[BodyId, Array],
    joint_frames: Mapping[BodyId, tuple[Array, Array]],
    at_rest: set[BodyId],
    changed_boxes: NDArray[np.float64],
    commands: dict[str, float],
    *,
    is_first: bool = False,
    is_same_world: bool = False,
) -> None:
    """Sets the state of a new model from that of the models before it.

    Args:
        owners: for each body that moved in a model, that model.
        new: the model to set.
        poses: current poses of all bodies [m, w x y z].
        joint_frames: each joint's frame in its parent and in its child.
        at_rest: bodies that were just moved and have zero velocity.
        changed_boxes: k x 2 x 3, lower and upper corners of boxes in which something changed [m]; bodies that sleep
            there wake up.
        commands: the commands of actuators; an actuator without one gets its position.
        is_first: whether there was no model before, so that all joints are as they were spawned.
        is_same_world: whether nothing was edited since: then bodies go on as if they had stayed in their model, bit for
            bit.
    """
    data = new.data
    if is_same_world:
        _copy_constants(owners, new)
    for root in new.kinematic_addresses:
        old = owners.get(root)
        if old is not None and root in old.motions and root not in at_rest:
            new.motions[root] = old.motions[root]
    for root, (position, velocity) in new.free_joint_addresses.items():
        old = owners.get(root)
        if old is not None and root in old.body_ids and root not in at_rest:  # scenery has no velocity
            data.qvel[velocity : velocity + 6] = _velocity(old, root)
            if root in old.free_joint_addresses:
                old_qpos, old_dof = old.free_joint_addresses[root]
                data.qacc_warmstart[velocity : velocity + 6] = old.data.qacc_warmstart[old_dof : old_dof + 6]
                if is_same_world:
                    data.qpos[position : position + 7] = old.data.qpos[old_qpos : old_qpos + 7]
    for id, joint in new.joints.items():
        if not is_first and not _copy_joint(owners.get(joint.tree_joint.child), new, id, joint, at_rest):
            set_joint_coordinates(new, joint, current_joint_coordinates(joint, poses, joint_frames[id]))
    if new.actuators.names:
        for name, address, sign in zip(new.actuators.names, new.actuators.positions, new.actuators.signs, strict=True):
            commands.setdefault(name, sign * data.qpos.item(address))
        set_commands(new, commands)
    new.forward()
    if is_same_world:
        _copy_countdowns(owners, new)
    _keep_asleep(owners, new, changed_boxes)


_BODY_CONSTANTS = ("body_invweight0", "body_subtreemass")
_DOF_CONSTANTS = ("dof_invweight0", "dof_M0", "dof_frictionloss", "dof_damping")


def _copy_constants(owners: Mapping[BodyId, CompiledModel], new: CompiledModel) -> None:
    """Copies what a model derives from masses and from the poses at which it is compiled."""
    for old, before, now in _common_bodies(owners, new):
        old_model, model = old.model, new.model
        for name in _BODY_CONSTANTS:
            getattr(model, name)[now] = getattr(old_model, name)[before]
        counts = model.body_dofnum[now]
        offsets = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        here = np.repeat(model.body_dofadr[now], counts) + offsets
        there = np.repeat(old_model.body_dofadr[before], counts) + offsets
        for name in _DOF_CONSTANTS:
            getattr(model, name)[here] = getattr(old_model, name)[there]
        joints, old_joints = model.dof_jntid[here], old_model.dof_jntid[there]
        model.jnt_solref[joints] = old_model.jnt_solref[old_joints]
        model.jnt_solimp[joints] = old_model.jnt_solimp[old_joints]


def _copy_countdowns(owners: Mapping[BodyId, CompiledModel], new: CompiledModel) -> None:
    """Lets trees that are awake fall asleep as soon as they would have in their models."""
    for old, before, now in _common_bodies(owners, new):
        trees, old_trees = new.model.body_treeid[now], old.model.body_treeid[before]
        counts = old.data.tree_asleep[old_trees]
        is_awake = counts < 0
        new.data.tree_asleep[trees[is_awake]] = counts[is_awake]


def _common_bodies(
    owners: Mapping[BodyId, CompiledModel], new: CompiledModel
) -> Iterator[tuple[CompiledModel, NDArray[np.intp], NDArray[np.intp]]]:
    """For each model before, the numbers of the bodies in it that move in the new one, and their numbers there."""
    trees = new.model.body_treeid
    for old in {id(each): each for each in owners.values()}.values():
        pairs = [
            (old.body_ids[body], number)
            for body, number in new.body_ids.items()
            if owners.get(body) is old and body in old.body_ids and trees[number] >= 0
        ]
        if pairs:
            before, now = np.array(pairs, dtype=np.intp).T
            yield old, before, now


def set_commands(compiled: CompiledModel, commands: Mapping[str, float]) -> None:
    """Sets the controls of a model to the commands of all of its actuators."""
    compiled.data.ctrl[:] = [commands[name] for name in compiled.actuators.names]


def limit_stiffness(compiled: CompiledModel) -> dict[str, float]:
    """Limits the stiffness of servos to half of that with which they become unstable.

    MuJoCo's implicit integration covers the damping d of a servo and not its stiffness k: with the inertia m and the
    time step h, it is stable for h² k < 4 m + 2 h d.

    Returns:
        The stiffness of the servos that were limited, by name [N/m] or [Nm/rad].
    """
    model, dofs = compiled.model, compiled.actuators.dofs
    stiffness, damping = -model.actuator_biasprm[:, 1], -model.actuator_biasprm[:, 2]
    step_s = model.opt.timestep
    inertia = 1.0 / np.maximum(model.dof_invweight0[dofs], 1e-12)
    largest = (2.0 * inertia + step_s * damping) / step_s**2
    limited = np.flatnonzero(stiffness > largest)
    model.actuator_gainprm[limited, 0], model.actuator_biasprm[limited, 1] = largest[limited], -largest[limited]
    return {compiled.actuators.names[row]: float(largest[row]) for row in limited.tolist()}


def actuator_states(compiled: CompiledModel) -> dict[str, ActuatorState]:
    """The states of the actuators of a model; see `Engine.actuator_states`."""
    data, states = compiled.data, {}
    qpos, qvel = data.qpos, data.qvel  # numbers of a few joints are read faster one by one than by an array of indices
    for name, position, dof, sign, effort, command in zip(
        *compiled.actuators, data.actuator_force.tolist(), data.ctrl.tolist(), strict=True
    ):
        states[name] = ActuatorState(
            position=sign * qpos.item(position), velocity=sign * qvel.item(dof), effort=effort, command=command
        )
    return states


def current_joint_coordinates(
    joint: ModelJoint, poses: Mapping[BodyId, Array], joint_frames: tuple[Array, Array]
) -> Array:
    """Six coordinates of a joint from the poses of its bodies, followed by its rotation as a quaternion."""
    parent_from_frame, child_from_frame = joint.tree_joint.order_ends(joint_frames)
    fixed, moving = (
        pose_multiply(poses[joint.tree_joint.parent], parent_from_frame),
        pose_multiply(poses[joint.tree_joint.child], child_from_frame),
    )
    relative = pose_multiply(pose_inverse(fixed), moving)
    return np.concatenate([joint_coordinates(relative, joint.axes), relative[3:]])


def set_joint_coordinates(compiled: CompiledModel, joint: ModelJoint, coordinates: Array) -> None:
    """Sets the coordinates of a joint and its velocity to zero."""
    position = joint.qpos_address
    for axis in joint.axes:
        if axis.is_prismatic or not joint.is_ball:
            compiled.data.qpos[position] = coordinates[axis.index]
            position += 1
    if joint.is_ball:
        compiled.data.qpos[position : position + 4] = coordinates[6:]
    compiled.data.qvel[joint.dof_address : joint.dof_address + len(joint.axes)] = 0.0


def _copy_joint(
    old: CompiledModel | None, new: CompiledModel, id: BodyId, joint: ModelJoint, at_rest: set[BodyId]
) -> bool:
    """Copies the state of a joint; False if the joint is new or changed, or one of its bodies was moved."""
    old_joint = None if old is None else old.joints.get(id)
    if (
        old is None
        or old_joint is None
        or old_joint.tree_joint.parent != joint.tree_joint.parent
        or old_joint.axes != joint.axes
    ):
        return False
    if joint.tree_joint.child in at_rest and joint.tree_joint.parent not in at_rest:
        return False
    degrees = len(joint.axes)
    now = slice(joint.qpos_address, joint.qpos_address + degrees + joint.is_ball)
    then = slice(old_joint.qpos_address, old_joint.qpos_address + degrees + joint.is_ball)
    new.data.qpos[now] = old.data.qpos[then]
    now, then = (
        slice(joint.dof_address, joint.dof_address + degrees),
        slice(old_joint.dof_address, old_joint.dof_address + degrees),
    )
    new.data.qvel[now] = old.data.qvel[then]
    new.data.qacc_warmstart[now] = old.data.qacc_warmstart[then]
    return True


def _velocity(old: CompiledModel, id: BodyId) -> Array:
    """The velocity of a body as a free joint has it: linear in the world frame, angular in the body frame."""
    if id in old.free_joint_addresses:
        start = old.free_joint_addresses[id][1]
        return np.array(old.data.qvel[start : start + 6])
    body_id = old.body_ids[id]
    spatial_velocity = np.zeros(6)
    mujoco.mj_objectVelocity(old.model, old.data, mujoco.mjtObj.mjOBJ_XBODY, body_id, spatial_velocity, 0)
    quaternion = np.array(old.data.xquat[body_id])
    return np.concatenate([spatial_velocity[3:], quat_rotate(quat_conjugate(quaternion), spatial_velocity[:3])])


def _trees_by_body(compiled: CompiledModel) -> dict[BodyId, int]:
    """MuJoCo's tree of each body that has degrees of freedom."""
    trees = compiled.model.body_treeid
    return {id: int(trees[body_id]) for id, body_id in compiled.body_ids.items() if trees[body_id] >= 0}


def _keep_asleep(
    owners: Mapping[BodyId, CompiledModel], new: CompiledModel, changed_boxes: NDArray[np.float64]
) -> None:
    """Lets trees that were asleep stay asleep.

    MuJoCo links the trees of a sleeping island in a cycle. A cycle is kept if all of its trees still exist and nothing
    changed near any of them.
    """
    if _UPDATE_SLEEP is None:
        return
    trees, disturbed, sleeping = _trees_by_body(new), _disturbed_trees(new, changed_boxes), dict[int, int]()
    for old in {id(each): each for each in owners.values()}.values():
        tree_of_old: dict[int, int] = {}
        for body, old_tree in _trees_by_body(old).items():
            if body in trees and owners.get(body) is old:
                tree_of_old.setdefault(old_tree, trees[body])
        next_of = {
            tree_of_old[tree]: tree_of_old[neighbor]
            for tree, neighbor in enumerate(old.data.tree_asleep.tolist())
            if neighbor >= 0 and tree in tree_of_old and neighbor in tree_of_old
        }
        for start, next_tree in next_of.items():
            cycle, tree = [start], next_tree
            while tree != start and tree in next_of and len(cycle) <= len(next_of):
                cycle.append(tree)
                tree = next_of[tree]
            if tree == start and not disturbed.intersection(cycle):
                sleeping.update((each, next_of[each]) for each in cycle)
    if sleeping:
        new.data.tree_asleep[list(sleeping)] = list(sleeping.values())
        _UPDATE_SLEEP(new.model._address, new.data._address)


def wake_islands(compiled: CompiledModel, changed_boxes: NDArray[np.float64]) -> None:
    """Wakes islands that sleep near some boxes (k x 2 x 3 [m]), and restarts the sleep countdown of others there.

    MuJoCo wakes a tree that has a velocity; the one set here is too small to matter.
    """
    for tree in _disturbed_trees(compiled, changed_boxes):
        if compiled.data.tree_asleep[tree] >= 0:
            compiled.data.qvel[compiled.model.tree_dofadr[tree]] += 1e-12
        else:
            compiled.data.tree_asleep[tree] = _FULLY_AWAKE


def _disturbed_trees(compiled: CompiledModel, changed_boxes: NDArray[np.float64]) -> set[int]:
    """Trees with geoms that reach into one of the boxes."""
    if not len(changed_boxes) or not compiled.model.nbody:
        return set()
    trees = compiled.model.body_treeid
    moving = np.flatnonzero(trees >= 0)
    geoms = np.flatnonzero(trees[compiled.model.geom_bodyid] >= 0)
    reach = compiled.model.geom_rbound[geoms, None] + 0.02
    center = compiled.data.geom_xpos[geoms]
    disturbed: set[int] = set()
    for low, high in changed_boxes:
        is_near = np.all((center + reach >= low) & (center - reach <= high), axis=1)
        disturbed.update(trees[compiled.model.geom_bodyid[geoms[is_near]]].tolist())
    return disturbed if len(moving) else set()


def scale_model(
    compiled: CompiledModel,
    root_of: Mapping[BodyId, BodyId],
    scales: Mapping[BodyId, DynamicsScale],
) -> None:
    """Scales masses, frictions and joint frictions in a model that nothing else uses.

    MuJoCo takes the friction of a contact from the geom of higher priority, otherwise the higher one of both. The
    priority of a scaled geom is therefore raised by one, above that of geoms which are alike.

    Args:
        compiled: the model to change.
        root_of: the root of the rigid group of each body.
        scales: factors by body.
    """
    model = compiled.model
    for id, scale in scales.items():
        body_id, root = compiled.body_ids.get(id), compiled.body_ids.get(root_of.get(id, id))
        if body_id is not None and scale.mass != 1.0:
            model.body_mass[body_id] *= scale.mass
            model.body_inertia[body_id] *= scale.mass
        if scale.friction != 1.0:
            geoms = compiled.geom_rows == compiled.rows[id]
            model.geom_friction[geoms, 0] *= scale.friction
            model.geom_priority[geoms] += 1
        if scale.joint_friction != 1.0 and root is not None:
            for joint in compiled.joints.values():
                if joint.body_id == root:
                    dofs = slice(joint.dof_address, joint.dof_address + len(joint.axes))
                    model.dof_frictionloss[dofs] *= scale.joint_friction
                    model.dof_damping[dofs] *= scale.joint_friction
    _update_mass_constants(compiled, {id: scale.mass for id, scale in scales.items() if scale.mass != 1.0})


def _update_mass_constants(compiled: CompiledModel, factors: Mapping[BodyId, float]) -> None:
    """Updates what MuJoCo derives from masses: in closed form for bodies that move freely and alone, else by MuJoCo."""
    model, needs_mujoco = compiled.model, False
    for id, factor in factors.items():
        body_id = compiled.body_ids.get(id)
        if body_id is None:
            continue  # scenery has no mass
        tree = model.body_treeid[body_id]
        if id in compiled.free_joint_addresses and np.count_nonzero(model.body_treeid == tree) == 1:
            dofs = slice(compiled.free_joint_addresses[id][1], compiled.free_joint_addresses[id][1] + 6)
            model.body_subtreemass[0] += model.body_mass[body_id] - model.body_subtreemass[body_id]
            model.body_subtreemass[body_id] = model.body_mass[body_id]
            model.body_invweight0[body_id] /= factor
            model.dof_invweight0[dofs] /= factor
            model.dof_M0[dofs] *= factor
        else:
            needs_mujoco = True
    if needs_mujoco:
        mujoco.mj_setConst(model, mujoco.MjData(model))


def set_tolerance(model: Any, kinematic_dofs: NDArray[np.intp]) -> None:
    """Sets the tolerance of the solver, which is relative to the mean inertia, as if kinematic bodies had none."""
    inertia = np.delete(model.dof_M0, kinematic_dofs)
    if kinematic_dofs.size and inertia.size:
        model.opt.tolerance = _TOLERANCE * inertia.mean() / model.dof_M0.mean()


class ContactPoints(NamedTuple):
    """The contact points of a world, k."""

    geoms: NDArray[np.intp]
    """The geoms that touch, k x 2."""
    positions: Array
    """k x 3, in the world frame [m]."""
    normals: Array
    """k x 3, from the first geom to the second one."""
    forces: Array
    """Normal forces, k [N]."""
    distances: Array
    """k, negative for a penetration [m]."""


def find_contacts(compiled: CompiledModel, rows: NDArray[np.intp], ids: Sequence[BodyId]) -> tuple[Contact, ...]:
    """The contacts in the current state, merged by pair of bodies, in the order of the ids.

    Args:
        compiled: the model.
        rows: the row of each of its bodies in the ids.
        ids: all bodies.
    """
    points, ends = contact_points(compiled), ground_last(compiled.geom_rows, len(rows))
    return merge_contacts(points, np.append(rows, len(ids))[ends[points.geoms]]).contacts(ids)


def contact_points(compiled: CompiledModel) -> ContactPoints:
    """The contact points in the current state."""
    contact = compiled.data.contact
    addresses = np.asarray(contact.efc_address)
    force = np.zeros(len(addresses))
    active = addresses >= 0
    force[active] = compiled.data.efc_force[addresses[active]]
    return ContactPoints(
        np.array(contact.geom, dtype=np.intp),
        np.array(contact.pos),
        np.array(contact.frame).reshape(-1, 9)[:, :3],
        force,
        np.array(contact.dist),
    )


class MergedContacts(NamedTuple):
    """Contact points merged by pair of bodies, k, in the order of the pairs."""

    pairs: NDArray[np.intp]
    """Rows of both bodies, k x 2, the lower one first."""
    positions: Array
    """k x 3, weighted by force, in the world frame [m]."""
    normals: Array
    """Unit vectors from the first body to the second one, k x 3."""
    forces: Array
    """Sums of the normal forces, k [N]."""
    depths: Array
    """k [m]."""

    def contacts(self, ids: Sequence[BodyId]) -> tuple[Contact, ...]:
        """As contacts of bodies; the row after the last body is the ground."""
        return tuple(
            Contact(
                a=ids[a], b=ids[b] if b < len(ids) else None, position=tuple(position), normal=tuple(normal),
                force_n=force_n, depth_m=depth,
            )
            for (a, b), position, normal, force_n, depth in zip(*(array.tolist() for array in self), strict=True)
        )  # fmt: skip


def ground_last(geom_rows: NDArray[np.intp], bodies: int) -> NDArray[np.intp]:
    """The row of the body of each geom; that of the ground, -1 so far, is the one after all bodies."""
    return np.where(geom_rows < 0, bodies, geom_rows)


def merge_contacts(points: ContactPoints, ends: NDArray[np.intp]) -> MergedContacts:
    """Merges contact points by pair of bodies.

    Args:
        points: the contact points, k.
        ends: the rows of the two bodies of each point, k x 2; the ground is the last row.
    """
    if not len(ends):
        return MergedContacts(ends, points.positions, points.normals, points.forces, points.distances)
    is_reversed = ends[:, 0] > ends[:, 1]
    stride = int(ends.max()) + 1
    keys = np.where(is_reversed, ends[:, 1] * stride + ends[:, 0], ends[:, 0] * stride + ends[:, 1])
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    # Few calls of NumPy: a recording does this for each frame, and most have few contacts.
    weights = np.maximum(points.forces, 1e-9)
    columns = np.empty((len(ends), 8))
    columns[:, 0] = points.forces
    columns[:, 1] = weights
    columns[:, 2:5] = points.positions
    columns[:, 5:] = points.normals
    columns[:, 2:] *= weights[:, None]
    columns[is_reversed, 5:] *= -1.0
    sums = np.add.reduceat(columns[order], starts, axis=0)
    directions = sums[:, 5:] / sums[:, 1:2]
    directions /= np.maximum(np.sqrt((directions**2).sum(axis=1, keepdims=True)), 1e-12)
    pairs = np.stack(np.divmod(keys[starts], stride), axis=1)
    depths = np.maximum.reduceat(-points.distances[order], starts)
    return MergedContacts(pairs, sums[:, 2:5] / sums[:, 1:2], directions, sums[:, 0], depths)
