"""Paths of a gripper as motions of an arm, and of the base where the arm alone does not follow.

A path is a sequence of poses of the grasp frame in the world. Each is solved from the one before, so that the arm does
not change its configuration on the way; where that fails, the base moves along.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mindstage.robots.models.robot_model import Arm, BaseType, RobotJoint, RobotModel
from mindstage.robots.robot_kinematics import BASE_JOINTS, IkResult, IkTolerance, RobotKinematics
from mindstage.robots.trajectories import JointTrajectory, TrajectoryPoint
from mindstage.scene.transforms import Array, normalize, quat_angle

__all__ = ["LINE_STEP_M", "POSE_JOINTS", "ArmPath", "driven_joints", "follow_poses", "interpolated_poses", "timed"]

_TOLERANCE = IkTolerance(position_m=0.002, rotation_rad=0.02)
POSE_JOINTS = 6
"""Joints that an arm needs to take its hand to any pose in reach."""
_MAX_JUMP_RAD = 0.35
"""Largest change of a joint between neighboring poses; more is another configuration of the arm."""
LINE_STEP_M = 0.02
"""Distance between neighboring poses of a straight line [m]."""
_STEP_RAD = 0.08
_DEFAULT_VELOCITY = 1.0
"""Of joints whose description has none [m/s or rad/s]."""
_RAMP_S = 0.25


class ArmPath(NamedTuple):
    """Positions of joints, and the pose of the root link, for each pose of a path."""

    joints: tuple[str, ...]
    positions: Array
    """n x joints [m or rad]."""
    roots: Array
    """n x 7: poses of the root link in the world frame."""
    reached: int
    """Number of poses that are reached; the path ends there."""
    reason: str
    """Why it ends before the last pose; empty if it does not."""
    shortfall_m: float | None = None
    """By how much the hand does not get to the next pose [m], if that is the reason."""

    @property
    def is_complete(self) -> bool:
        """Whether the last pose is reached."""
        return not self.reason

    @property
    def moves_base(self) -> bool:
        """Whether the base moves along."""
        return bool(np.abs(self.roots - self.roots[:1]).max(initial=0.0) > 1e-6)

    def cut(self, count: int, reason: str) -> ArmPath:
        """The first poses of it.

        Args:
            count: their number.
            reason: why it ends there.
        """
        return self._replace(
            positions=self.positions[:count], roots=self.roots[:count], reached=count, reason=reason, shortfall_m=None
        )

    def backwards(self) -> ArmPath:
        """The same in the opposite direction."""
        return self._replace(positions=self.positions[::-1], roots=self.roots[::-1])

    def joined(self, other: ArmPath) -> ArmPath:
        """This path and another one, which begins where this one ends."""
        return other._replace(
            positions=np.concatenate([self.positions, other.positions[1:]]),
            roots=np.concatenate([self.roots, other.roots[1:]]),
            reached=self.reached + max(other.reached - 1, 0),
        )

    def at(self, row: int) -> dict[str, float]:
        """The positions at one pose."""
        return dict(zip(self.joints, self.positions[row].tolist(), strict=True))


def interpolated_poses(start: Array, end: Array, *, step_m: float = LINE_STEP_M) -> Array:
    """Poses on a straight line from one pose to another, both included, at most a step and 5 degrees apart."""
    distance = float(np.linalg.norm(end[:3] - start[:3]))
    turn = float(quat_angle(start[3:], end[3:]))
    count = max(int(np.ceil(max(distance / step_m, turn / _STEP_RAD))), 1)
    fractions = np.linspace(0.0, 1.0, count + 1)[:, None]
    last = end[3:] if float(start[3:] @ end[3:]) >= 0.0 else -end[3:]
    if turn < 1e-6:
        rotations = np.repeat(start[None, 3:], count + 1, axis=0)
    else:
        half = turn / 2
        rotations = (np.sin((1 - fractions) * half) * start[3:] + np.sin(fractions * half) * last) / np.sin(half)
    return np.concatenate([start[:3] + fractions * (end[:3] - start[:3]), normalize(rotations)], axis=1)


def follow_poses(
    kinematics: RobotKinematics,
    arm: Arm,
    poses: Array,
    *,
    root: Array,
    seed: Mapping[str, float],
    free: str = "",
    may_drive: bool = False,
    from_seed: bool = False,
    guide: ArmPath | None = None,
) -> ArmPath:
    """Solves a path pose by pose.

    Args:
        poses: n x 7: poses of the grasp frame in the world frame.
        root: pose of the root link at the first pose.
        seed: positions of all joints before the first pose; the first solution is near to it.
        free: axes of the grasp frame about which it may turn.
        may_drive: whether the base may move where the arm alone does not follow.
        from_seed: whether the arm is at the seed now, so that the first solution must be near to it.
        guide: a motion along nearly the same poses, whose configurations of the arm are preferred.
    """
    frame = kinematics.frame_of(arm)
    rows, roots, known = list[Array](), list[Array](), dict(seed)
    reason, shortfall_m = "", None
    driven = driven_joints(kinematics.model) if may_drive else ()
    needs_base = bool(driven) and len(arm.joints) < POSE_JOINTS
    for number, pose in enumerate(poses):
        is_bound = number > 0 or from_seed
        start = known
        if guide is not None and 0 < number < guide.reached:
            start, root = {**known, **guide.at(number)}, guide.roots[number]
        found: IkResult | None = None
        for joints in ((*driven, *arm.joints),) if needs_base and is_bound else (arm.joints, (*driven, *arm.joints)):
            if found is None or (driven and is_bound and not (found and _is_near(arm, known, found.positions))):
                found = kinematics.solve_ik(
                    frame, pose, joints=joints, seed=start, root_pose=root, free=free, tolerance=_TOLERANCE, attempts=1
                )
        assert found is not None
        if not found:
            reason, shortfall_m = found.reason, found.shortfall_m
            break
        if is_bound and not _is_near(arm, known, found.positions):
            reason = "the arm would have to change its configuration"
            break
        root = np.array(found.root_pose)
        known.update(found.positions)
        rows.append(np.array([known[name] for name in arm.joints]))
        roots.append(root)
    return ArmPath(
        arm.joints,
        np.array(rows).reshape(-1, len(arm.joints)),
        np.array(roots).reshape(-1, 7),
        len(rows),
        reason,
        shortfall_m,
    )


def driven_joints(model: RobotModel) -> tuple[str, ...]:
    """The motions that a base can make in a small step."""
    match model.base.type:
        case BaseType.PLANAR:
            return BASE_JOINTS
        case BaseType.DIFFERENTIAL:
            return (BASE_JOINTS[0], BASE_JOINTS[2])
        case BaseType.FIXED:
            return ()


def _is_near(arm: Arm, before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    return all(abs(after[name] - before[name]) <= _MAX_JUMP_RAD for name in arm.joints if name in before)


def timed(
    path: ArmPath, joints: Mapping[str, RobotJoint], *, speed: float = 0.5, least_s: Array | None = None
) -> JointTrajectory:
    """A path with times, from rest to rest, within a fraction of the velocity limits.

    Args:
        path: at least two poses.
        joints: the joints by name.
        speed: the fraction.
        least_s: the least time between neighboring poses [s], one number fewer than poses.
    """
    limits = np.array([speed * (joints[name].velocity or _DEFAULT_VELOCITY) for name in path.joints])
    steps = np.abs(np.diff(path.positions, axis=0))
    durations = np.maximum((steps / limits).max(axis=1), 0.02)
    if least_s is not None:
        durations = np.maximum(durations, least_s)
    times = np.concatenate([[0.0], np.cumsum(durations)])
    times = _with_ramps(times)
    velocities = _slopes(times, path.positions)
    points = tuple(
        TrajectoryPoint(positions=tuple(row.tolist()), velocities=tuple(slope.tolist()), time_s=float(at))
        for row, slope, at in zip(path.positions, velocities, times, strict=True)
    )
    return JointTrajectory(path.joints, points)


def _with_ramps(times: Array) -> Array:
    """Times with a slow start and end: speed grows and shrinks linearly during the ramps."""
    whole = float(times[-1])
    ramp = min(_RAMP_S, whole / 2)
    # The path parameter s is the given time; ds/dt rises from 0 to 1 within 2 * ramp.
    slow = np.where(times < ramp, 2 * np.sqrt(np.maximum(times, 0.0) * ramp), times + ramp)
    left = whole - times
    return np.where(left < ramp, whole + 2 * ramp - 2 * np.sqrt(np.maximum(left, 0.0) * ramp), slow)


def _slopes(times: Array, positions: Array) -> Array:
    """Velocities at the points that let a cubic spline not overshoot (harmonic means, Fritsch and Butland 1984)."""
    slopes = np.diff(positions, axis=0) / np.diff(times)[:, None]
    found = np.zeros_like(positions)
    before, after = slopes[:-1], slopes[1:]
    same = before * after > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        found[1:-1] = np.where(same, 2 * before * after / (before + after), 0.0)
    return found
