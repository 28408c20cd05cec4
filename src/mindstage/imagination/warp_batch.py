"""WarpBatch: many copies of one MuJoCo world that MuJoCo Warp steps together, on a GPU or, slowly, on the CPU.

All worlds have the same bodies, joints and geoms; their states, and the masses and frictions in `varied`, differ.
Numbers are of single precision, and nothing sleeps.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any

import numpy as np

from mindstage.engines.mujoco import (
    CompiledModel,
    CompiledState,
    ContactPoints,
    MergedContacts,
    contact_points,
    ground_last,
    merge_contacts,
)
from mindstage.errors import ImaginationError
from mindstage.scene.transforms import Array, normalize, quat_rotate

__all__ = ["BatchLimits", "StepEnd", "WarpBatch", "load_warp", "varied_fields"]

_MAX_CONTACTS, _MAX_CONSTRAINTS = 20_000, 60_000
"""Limits of one world; a world with more is not simulated."""
_MARGIN = 2
"""How many times the contacts at the start fit."""
_MIN_CONTACT_COUNT, _MIN_CONSTRAINT_COUNT = 64, 64
_SYNC_S = 0.1
"""The caller is asked at this interval whether to go on [s]."""
_MAX_COORDINATE = 1e10
"""MuJoCo's limit of a coordinate (mjMAXVAL); a larger one has diverged."""
_DERIVED_FIELDS = frozenset({"geom_priority", "ngravcomp"})
"""Fields that all worlds share, and that have no effect on worlds whose other fields are not changed."""


def load_warp() -> tuple[Any, Any]:
    """The modules `warp` and `mujoco_warp`.

    Raises:
        ImaginationError: they are not installed.
    """
    try:
        import warp

        warp.config.log_level = max(warp.config.log_level, warp.LOG_WARNING)  # not each kernel that is compiled
        import mujoco_warp
    except ImportError as error:
        cause = f"MuJoCo Warp is not installed ({error}); install mindstage[gpu]"
        raise ImaginationError(cause) from error
    return warp, mujoco_warp


def varied_fields(model: Any, changed: Any) -> tuple[str, ...]:
    """The fields of a model that differ from another one's, each of which can be set for each world of a batch.

    Args:
        model: a MuJoCo model.
        changed: another one.

    Raises:
        ValueError: they differ in something that cannot; its text names the field.
    """
    _, mujoco_warp = load_warp()
    found = []
    for each in fields(mujoco_warp.Model):
        before, after = getattr(model, each.name, None), getattr(changed, each.name, None)
        if not isinstance(before, np.ndarray | int | float) or after is None or np.array_equal(before, after):
            continue
        shape = getattr(each.type, "shape", ())
        if shape and shape[0] == "*" and np.shape(before) == np.shape(after):
            found.append(each.name)
        elif each.name not in _DERIVED_FIELDS:
            raise ValueError(each.name)
    return tuple(found)


class StepEnd(StrEnum):
    """How a step of all worlds ended."""

    DONE = "done"
    STOPPED = "stopped"
    """The caller stopped it before the end."""
    OVERFLOWED = "overflowed"
    """A world has more contacts or constraints than there is memory for; all worlds are invalid."""


@dataclass(frozen=True, slots=True)
class BatchLimits:
    """How many contacts and constraints of each world fit into the memory of a batch."""

    contacts: int
    constraints: int

    @classmethod
    def of(cls, compiled: CompiledModel) -> BatchLimits:
        """Limits for worlds that begin in a state in which everything is awake.

        They are powers of two, since they are compiled into the kernels, which are kept for the next batch.
        """
        return cls(
            contacts=_power_of_two(max(_MIN_CONTACT_COUNT, _MARGIN * int(compiled.data.ncon))),
            constraints=_power_of_two(max(_MIN_CONSTRAINT_COUNT, _MARGIN * int(compiled.data.nefc))),
        )

    def doubled(self, *, contacts: bool, constraints: bool) -> BatchLimits:
        """Twice as many contacts, constraints, or both.

        Raises:
            ImaginationError: so many are not possible.
        """
        larger = BatchLimits(self.contacts << contacts, self.constraints << constraints)
        if larger.contacts > _MAX_CONTACTS or larger.constraints > _MAX_CONSTRAINTS:
            exceeded = f"{self.contacts:,} contacts" if contacts else f"{self.constraints:,} constraints"
            text = f"a world has more than {exceeded}, which is too much for a batch on a GPU"
            raise ImaginationError(f"{text}; run the samples in processes (workers=2)")
        return larger


def _power_of_two(number: int) -> int:
    """The smallest power of two that is at least a number."""
    return 1 << (number - 1).bit_length()


class WarpBatch:
    """Worlds, numbered from 0, that are stepped together."""

    def __init__(
        self,
        compiled: CompiledModel,
        changed: Any,
        worlds: int,
        *,
        device: str,
        limits: BatchLimits | None = None,
    ) -> None:
        """Creates the worlds, all in the same state.

        Args:
            compiled: a model with the state in which everything begins; awake.
            changed: a MuJoCo model in which everything has changed that is set for single worlds with `set_model`.
            worlds: number of worlds.
            device: name of Warp's device, such as "cuda:0" or "cpu".
            limits: see `BatchLimits`; None for those of the state.

        Raises:
            ImaginationError: MuJoCo Warp cannot simulate this model, or there is not enough memory.
        """
        self._warp, self._mujoco_warp = load_warp()
        mujoco_warp = self._mujoco_warp
        self.compiled, self.limits = compiled, limits or BatchLimits.of(compiled)
        self.timestep_s = float(compiled.model.opt.timestep)
        self._device = self._warp.get_device(device)
        self._varied = varied_fields(compiled.model, changed)
        model = copy.copy(changed)
        model.opt.enableflags &= ~int(mujoco_warp.EnableBit.SLEEP)
        model.opt.disableflags &= sum(int(bit) for bit in mujoco_warp.DisableBit)
        limits = self.limits
        try:
            with self._warp.ScopedDevice(self._device):
                self._model = mujoco_warp.put_model(model, batch_sizes=dict.fromkeys(self._varied, worlds))
                self._model.opt.warn_overflow = 0
                if self._device.is_cuda:
                    self._model.opt.graph_conditional = self._warp.is_conditional_graph_supported()
                else:  # equal digits in each run; on a GPU steps take 40 times longer with it, and some still differ
                    self._model.opt.deterministic = int(mujoco_warp.DeterminismType.ALL)
                self._data = mujoco_warp.put_data(
                    model, compiled.data, nworld=worlds, nconmax=limits.contacts, njmax=limits.constraints
                )
        except (NotImplementedError, ValueError, RuntimeError, MemoryError) as error:
            raise ImaginationError(f"MuJoCo Warp cannot simulate {worlds:,} such worlds: {error}") from error
        overflow = mujoco_warp.OverflowType
        self._too_many_constraints = int(overflow.NEFC | overflow.NJMAX_NNZ)
        self._too_many_contacts = int(overflow.BROADPHASE | overflow.NARROWPHASE | overflow.CCD)
        self._overflow = 0
        self._ends = ground_last(compiled.geom_rows, len(compiled.rows))
        self._stride = len(compiled.rows) + 1
        points = contact_points(compiled)
        self._start_contacts = merge_contacts(points, self._ends[points.geoms])
        self._fresh = set(range(worlds))
        self._rows = {name: np.array(getattr(self._model, name).numpy()) for name in self._varied}
        self._forces = np.zeros((worlds, compiled.model.nbody, 6), dtype=np.float32)
        self._changed_arrays = set(self._varied)
        self._graphs: dict[Callable[[Any, Any], None], Any] = {}
        self._step_s = 0.0
        self._contacts: MergedContacts | None = None
        """Those of all worlds, whose rows count on from world to world."""
        self._read()
        for world in range(worlds):
            self.set_model(world, compiled.model)

    @property
    def worlds(self) -> int:
        """The number of worlds."""
        return len(self._forces)

    # -- one world -----------------------------------------------------------------------------------------------------

    def reset(self, world: int) -> None:
        """Puts one world into the state in which all began, with the same masses and frictions."""
        self.set_state(world, self.compiled)
        self.set_model(world, self.compiled.model)
        self.set_force(world, None)
        self._warmstart[world] = self.compiled.data.qacc_warmstart
        self._changed_arrays.add("qacc_warmstart")
        self._fresh.add(world)

    def set_state(self, world: int, source: CompiledModel) -> None:
        """Sets the state of one world from that of the same model, whose poses are current."""
        data = source.data
        self._qpos[world], self._qvel[world] = data.qpos, data.qvel
        self._positions[world], self._quaternions[world] = data.xpos, data.xquat
        self._centers[world] = data.xipos
        self._changed_arrays |= {"qpos", "qvel"}

    def set_model(self, world: int, model: Any) -> None:
        """Sets what is varied in one world from a MuJoCo model."""
        for name, rows in self._rows.items():
            rows[world] = np.reshape(getattr(model, name), rows.shape[1:])
        self._changed_arrays |= set(self._varied)

    def set_force(self, world: int, wrenches: dict[int, Array] | None) -> None:
        """Sets the forces on a world from now on.

        Args:
            wrenches: force [N] and torque about the center of mass [N m] by MuJoCo body, in the world frame.
        """
        if wrenches or self._forces[world].any():
            self._forces[world] = 0.0
            for body, wrench in (wrenches or {}).items():
                self._forces[world, body] = wrench
            self._changed_arrays.add("xfrc_applied")

    def add_forces(self, worlds: Sequence[int], bodies: Sequence[int], forces: Array, points: Array) -> None:
        """Adds forces at points of bodies.

        Args:
            worlds: the world of each force.
            bodies: the MuJoCo body of each force.
            forces: k x 3, in the world frame [N].
            points: where they act, k x 3, in the world frame [m].
        """
        torques = np.cross(points - self._centers[worlds, bodies], forces)
        np.add.at(self._forces, (worlds, bodies), np.concatenate([forces, torques], axis=1).astype(np.float32))
        self._changed_arrays.add("xfrc_applied")

    def points(self, worlds: Sequence[int], bodies: Sequence[int], points: Array) -> Array:
        """Points of bodies in the world frame, k x 3 [m].

        Args:
            worlds: the world of each point.
            bodies: the MuJoCo body of each point.
            points: in the frame of the body, k x 3 [m].
        """
        quaternions = normalize(self._quaternions[worlds, bodies].astype(float))
        return np.asarray(self._positions[worlds, bodies] + quat_rotate(quaternions, points))

    def state(self, world: int, *, time_s: float) -> CompiledState:
        """The state of a world, at a time of which the caller keeps account [s]."""
        return CompiledState(self._qpos[world].astype(float), self._qvel[world].astype(float), time_s)

    def poses(self, world: int) -> Array:
        """The poses of all bodies in a world, n x 7, in the order of the rows of the compiled model."""
        compiled = self.compiled
        poses = np.empty((len(compiled.body_id_order), 7))
        poses[:, :3] = self._positions[world, compiled.body_id_order]
        poses[:, 3:] = self._quaternions[world, compiled.body_id_order]
        poses[compiled.scenery] = compiled.scenery_poses
        return poses

    def center_of_mass(self, world: int, body: int) -> Array:
        """The center of mass of a MuJoCo body in a world [m]."""
        center: Array = self._centers[world, body].astype(float)
        return center

    def is_finite(self, world: int) -> bool:
        """Whether the state of a world has not diverged."""
        return bool(self._is_finite[world])

    def contacts(self, world: int) -> MergedContacts:
        """The contacts of a world in its last step; before the first one, those of the start."""
        if world in self._fresh:
            return self._start_contacts
        if self._contacts is None:
            self._contacts = self._read_contacts()
        first, last = np.searchsorted(self._contacts.pairs[:, 0], np.array([world, world + 1]) * self._stride)
        merged = MergedContacts._make(array[first:last] for array in self._contacts)
        return merged._replace(pairs=merged.pairs - world * self._stride)

    # -- all worlds ----------------------------------------------------------------------------------------------------

    def step(self, steps: int, *, stop: Callable[[], bool]) -> StepEnd:
        """Advances all worlds by some time steps.

        Args:
            steps: number of time steps.
            stop: asked about every 0.1 s.

        Raises:
            ImaginationError: Warp failed.
        """
        try:
            with self._warp.ScopedDevice(self._device):
                self._write()
                self._fresh.clear()
                done = 0
                while done < steps:
                    if stop():
                        return StepEnd.STOPPED
                    part = min(steps - done, max(1, int(_SYNC_S / self._step_s)) if self._step_s else 1)
                    begin = time.perf_counter()
                    for _ in range(part):
                        self._launch(self._mujoco_warp.step)
                    self._warp.synchronize_device(self._device)
                    self._step_s = (time.perf_counter() - begin) / part
                    done += part
                self._launch(self._mujoco_warp.kinematics)
                self._overflow = int(np.bitwise_or.reduce(self._data.overflow.numpy()))
                self._read()
        except RuntimeError as error:
            raise ImaginationError(f"Warp failed on {self._device}: {error}") from error
        has_overflowed = self._overflow & (self._too_many_contacts | self._too_many_constraints)
        return StepEnd.OVERFLOWED if has_overflowed else StepEnd.DONE

    def larger_limits(self) -> BatchLimits:
        """The limits for another batch, after this one has overflowed.

        Raises:
            ImaginationError: so much is not possible.
        """
        return self.limits.doubled(
            contacts=bool(self._overflow & self._too_many_contacts),
            constraints=bool(self._overflow & self._too_many_constraints),
        )

    def _launch(self, function: Callable[[Any, Any], None]) -> None:
        """Runs a function of MuJoCo Warp as one graph: launching its kernels one by one takes longer than they do."""
        if function in self._graphs:
            self._warp.capture_launch(self._graphs[function])
            return
        function(self._model, self._data)  # compiles the kernels, which a capture cannot
        with self._warp.ScopedCapture(device=self._device) as capture:
            function(self._model, self._data)
        self._graphs[function] = capture.graph

    def _write(self) -> None:
        """Writes to the device what was changed here."""
        host = {
            "qpos": self._qpos,
            "qvel": self._qvel,
            "qacc_warmstart": self._warmstart,
            "xfrc_applied": self._forces,
        }
        for name in self._changed_arrays:
            if name in host:
                getattr(self._data, name).assign(host[name])
            else:
                getattr(self._model, name).assign(self._rows[name])
        self._changed_arrays.clear()

    def _read(self) -> None:
        """Reads the state of all worlds from the device."""
        data = self._data
        self._qpos, self._qvel = np.array(data.qpos.numpy()), np.array(data.qvel.numpy())
        self._warmstart = np.array(data.qacc_warmstart.numpy())
        self._positions, self._quaternions = np.array(data.xpos.numpy()), np.array(data.xquat.numpy())
        self._centers = np.array(data.xipos.numpy())
        self._is_finite = (np.abs(self._qpos) < _MAX_COORDINATE).all(axis=1)
        self._is_finite &= (np.abs(self._qvel) < _MAX_COORDINATE).all(axis=1)
        self._contacts = None

    def _read_contacts(self) -> MergedContacts:
        """The contacts of all worlds."""
        data, contact = self._data, self._data.contact
        count = int(data.nacon.numpy()[0])
        worlds, addresses = contact.worldid.numpy()[:count], contact.efc_address.numpy()[:count, 0]
        rows = data.efc.force.numpy()
        forces = np.where(addresses >= 0, rows[worlds, np.maximum(addresses, 0)], 0.0)
        geoms = contact.geom.numpy()[:count].astype(np.intp)
        points = ContactPoints(
            geoms,
            contact.pos.numpy()[:count].astype(float),
            contact.frame.numpy()[:count].reshape(count, 9)[:, :3].astype(float),
            forces.astype(float),
            contact.dist.numpy()[:count].astype(float),
        )
        return merge_contacts(points, self._ends[geoms] + worlds[:, None] * self._stride)
