"""Which joints of a compiled model move together, since equality constraints leave them no freedom of their own.

Joint and tendon equalities, and the connects and welds that close loops, are treated alike: the constraints are solved
at positions of the joints that stay independent, and a line is fitted to the positions of each of the others. A joint
without a drive in such a mechanism, as in fingers that adapt to what they grasp, is where its springs pull it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mindstage.scene.bounding_boxes import connected_groups
from mindstage.scene.transforms import Array

__all__ = ["JointCoupling", "joint_couplings", "tendon_joints"]

_SAMPLES = 9
"""Number of positions over the range of an independent joint."""
_DEFAULT_RANGE_RAD = 1.0
"""The constraints are solved from -1 to 1 times this for a joint without limits."""
_ITERATIONS = 40
_MAX_STEP = 0.2
"""Largest step of a solution [m or rad]."""
_SOLVED = 1e-9
"""A smaller step ends the solution of the constraints [m or rad]."""
_RELAXED = 1e-5
"""A smaller step ends the relaxation of the springs [m or rad]."""
_TOLERANCE = 1e-3
"""Largest violation of constraints that count as met [m or rad]: files state anchors with few digits."""
_MIN_SAMPLES = 3
_RANK_TOLERANCE = 1e-6
"""Derivatives that are smaller count as 0 [m/m, m/rad, rad/m or rad/rad]."""
_FIXED_SLOPE = 1e-3
"""A joint that moves less, as a fraction of another, does not follow it."""
_UNDRIVEN = 2
"""The rank of a joint without an actuator, see `_drive`."""
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))


class JointCoupling(NamedTuple):
    """A joint that others move."""

    leader: int
    """The row of the joint that it follows; -1 if the constraints hold it where it is."""
    multiplier: float
    offset: float
    """[m or rad]: its position is `multiplier` times that of the leader plus this."""
    error: float
    """Largest distance from that, over the range of the leader [m or rad]."""


def joint_couplings(model: Any) -> dict[int, JointCoupling]:
    """Finds the joints that follow others, by their rows.

    Of joints that move together, those with an actuator of their own stay independent, then those of a tendon that has
    one, then those that come first.

    Args:
        model: an `MjModel`; its options are changed while this runs, and restored.
    """
    if not model.neq:
        return {}
    flags, jacobian = int(model.opt.disableflags), int(model.opt.jacobian)
    off = mujoco.mjtDisableBit
    model.opt.disableflags = off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_FRICTIONLOSS
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    try:
        return _Constraints(model).couplings()
    finally:
        model.opt.disableflags, model.opt.jacobian = flags, jacobian


class _Constraints:
    """The equality constraints of a model, as a function of its joints with one axis."""

    def __init__(self, model: Any) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self.joints = [row for row in range(model.njnt) if int(model.jnt_type[row]) in _SCALAR]
        self.dofs = np.array([model.jnt_dofadr[row] for row in self.joints], dtype=np.intp)
        self.addresses = np.array([model.jnt_qposadr[row] for row in self.joints], dtype=np.intp)

    def couplings(self) -> dict[int, JointCoupling]:
        found: dict[int, JointCoupling] = {}
        _, slopes = self._evaluate()
        for columns in _groups(slopes):
            free = self._independent(slopes, columns)
            driven = [column for column in free if self._drive(self.joints[column]) < _UNDRIVEN] or free
            sprung = [column for column in free if column not in driven]
            found |= self._fitted(driven, sprung, [column for column in columns if column not in free])
        return found

    def _evaluate(self) -> tuple[Array, Array]:
        """The violations of the constraints, and their derivatives by the joints."""
        mujoco.mj_fwdPosition(self.model, self.data)
        rows = int(self.data.ne)
        jacobian = np.reshape(self.data.efc_J, (-1, self.model.nv))[:rows] if rows else np.zeros((0, self.model.nv))
        return self.data.efc_pos[:rows].copy(), jacobian[:, self.dofs].copy()

    def _independent(self, slopes: Array, columns: Sequence[int]) -> list[int]:
        """The joints of a group that stay free: what is driven the least depends on others first."""
        rank, dependent = int(np.linalg.matrix_rank(slopes[:, columns], tol=_RANK_TOLERANCE)), list[int]()
        for column in sorted(columns, key=lambda each: (-self._drive(self.joints[each]), -each)):
            trial = [*dependent, column]
            if len(dependent) < rank and np.linalg.matrix_rank(slopes[:, trial], tol=_RANK_TOLERANCE) == len(trial):
                dependent = trial
        return [column for column in columns if column not in dependent]

    def _drive(self, joint: int) -> int:
        """0 for a joint with an actuator of its own, 1 for one of a tendon that has one, 2 for others."""
        model, level = self.model, _UNDRIVEN
        for row in range(model.nu):
            target = int(model.actuator_trnid[row, 0])
            if model.actuator_trntype[row] == mujoco.mjtTrn.mjTRN_JOINT and target == joint:
                return 0
            if model.actuator_trntype[row] == mujoco.mjtTrn.mjTRN_TENDON and joint in tendon_joints(model, target):
                level = 1
        return level

    def _fitted(
        self, driven: Sequence[int], sprung: Sequence[int], dependent: Sequence[int]
    ) -> dict[int, JointCoupling]:
        self.data.qpos[:] = self.model.qpos0
        if not self._settle(sprung, dependent):  # constraints that contradict each other tell nothing about motion
            return {}
        others = [*sprung, *dependent]
        best = {
            self.joints[each]: JointCoupling(-1, 0.0, float(self.data.qpos[self.addresses[each]]), 0.0)
            for each in others
        }
        for leader in driven:
            at, followed = self._swept(leader, sprung, dependent)
            if len(at) < _MIN_SAMPLES:
                continue
            for column, positions in zip(others, followed.T, strict=True):
                slope, offset = np.polyfit(at, positions, 1).tolist()
                row = self.joints[column]
                if abs(slope) > max(_FIXED_SLOPE, abs(best[row].multiplier)):
                    error = float(np.abs(slope * at + offset - positions).max())
                    best[row] = JointCoupling(self.joints[leader], _rounded(slope), _rounded(offset), error)
        return best

    def _swept(self, leader: int, sprung: Sequence[int], dependent: Sequence[int]) -> tuple[Array, Array]:
        """Positions of a joint over its range, and those of the joints that follow it."""
        address, (low, high) = self.addresses[leader], self._range(leader, _DEFAULT_RANGE_RAD)
        start = float(np.clip(self.model.qpos0[address], low, high))
        others = self.addresses[[*sprung, *dependent]]
        found: dict[float, Array] = {}
        for end in (low, high):  # from the reference to each end, each solution from the one before
            self.data.qpos[:] = self.model.qpos0
            for at in np.linspace(start, end, _SAMPLES).tolist():
                self.data.qpos[address] = at
                if not self._settle(sprung, dependent):
                    break
                found[at] = self.data.qpos[others].copy()
        ordered = sorted(found)
        return np.array(ordered), np.array([found[at] for at in ordered]).reshape(len(ordered), len(others))

    def _range(self, column: int, default: float) -> tuple[float, float]:
        row = self.joints[column]
        if not self.model.jnt_limited[row]:
            return -default, default
        low, high = self.model.jnt_range[row].tolist()
        return low, high

    def _settle(self, sprung: Sequence[int], dependent: Sequence[int]) -> bool:
        """Moves the dependent joints to where the constraints are met, and the sprung ones to the least energy."""
        for _ in range(_ITERATIONS):
            if not self._close(dependent):
                return False
            step = self._relaxation(sprung, dependent)
            if float(np.abs(step).max(initial=0.0)) < _RELAXED:
                break
            self.data.qpos[self.addresses[list(sprung)]] += step
        return True

    def _relaxation(self, sprung: Sequence[int], dependent: Sequence[int]) -> Array:
        """A step of each sprung joint towards the least energy of the springs, within its limits."""
        model, steps = self.model, np.zeros(len(sprung))
        _, slopes = self._evaluate()
        for number, column in enumerate(sprung):
            moved = np.linalg.lstsq(slopes[:, list(dependent)], -slopes[:, column], rcond=None)[0]
            columns, ratios = [column, *dependent], np.concatenate([[1.0], moved])
            stiffness = np.array([np.ravel(model.jnt_stiffness[self.joints[each]])[0] for each in columns])
            stretch = self.data.qpos[self.addresses[columns]] - model.qpos_spring[self.addresses[columns]]
            curvature = float(stiffness @ ratios**2)
            if curvature > 0.0:
                step = float(np.clip(-(stiffness * stretch) @ ratios / curvature, -_MAX_STEP, _MAX_STEP))
                low, high = self._range(column, np.inf)
                at = float(self.data.qpos[self.addresses[column]])
                steps[number] = min(max(at + step, low), high) - at
        return steps

    def _close(self, dependent: Sequence[int]) -> bool:
        """Moves the dependent joints to where the constraints are met; whether there is such a place."""
        addresses = self.addresses[list(dependent)]
        for _ in range(_ITERATIONS):
            violation, slopes = self._evaluate()
            step = np.linalg.lstsq(slopes[:, list(dependent)], -violation, rcond=None)[0]
            if float(np.abs(step).max(initial=0.0)) < _SOLVED:
                break
            self.data.qpos[addresses] += np.clip(step, -_MAX_STEP, _MAX_STEP)
        return float(np.abs(violation).max(initial=0.0)) < _TOLERANCE


def tendon_joints(model: Any, tendon: int) -> dict[int, float]:
    """The joints of a fixed tendon by their rows, and their coefficients; empty for a spatial one."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    return {
        int(model.wrap_objid[row]): float(model.wrap_prm[row])
        for row in range(first, first + count)
        if model.wrap_type[row] == mujoco.mjtWrap.mjWRAP_JOINT
    }


def _groups(slopes: Array) -> Iterator[list[int]]:
    """The columns that rows connect."""
    rows, columns = np.nonzero(np.abs(slopes) > _RANK_TOLERANCE)
    group = connected_groups(slopes.shape[1], columns[np.searchsorted(rows, rows)], columns)
    for number in np.unique(group[columns]).tolist():
        yield np.flatnonzero(group == number).tolist()


def _rounded(number: float) -> float:
    """A coefficient without the last digits of the solution, in which files state 1 rather than 0.9999999."""
    return round(number, 6) + 0.0
