"""Matrices: poses that are told as sixteen numbers, and what may be wrong with those."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mindstage.world import Pose
from mindstage.world.geometry import Array, pose_from_array, quaternion_from_matrix

__all__ = ["MatrixPose", "pose_from_matrix"]

_ROUNDING_TOLERANCE = 1e-3
"""By so much a matrix may be off a rotation for having been rounded."""
_SINGULAR_TOLERANCE = 1e-6
_TOO_LARGE = 1e100


class MatrixPose(NamedTuple):
    """What a matrix says, and what had to be done to understand it."""

    pose: Pose
    mirrored: bool = False
    """Whether it was left-handed: its y axis was turned round."""
    repairs: tuple[tuple[str, str], ...] = ()
    """What was met, and what was done."""


def pose_from_matrix(matrix: Array) -> MatrixPose | str:
    """A pose from a matrix 4 x 4, or why it is none.

    The nearest rotation counts, which is what is left of a matrix without its stretches (its polar decomposition).
    """
    remedies: list[tuple[str, str]] = []
    if np.any(matrix[3, :3]) and not np.any(matrix[:3, 3]):
        remedies.append(("its position stands in the last row", "rows are taken as columns"))
        matrix = matrix.T
    if np.any(matrix[3, :3]):
        remedies.append((f"its last row is {_row_text(matrix[3])}", "the last row is ignored"))
    scale = float(matrix[3, 3])
    if scale == 0.0:
        return "its last number, m33, is 0"
    if scale != 1.0:
        remedies.append((f"its last number, m33, is {scale:g}", "all its numbers are divided by it"))
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = matrix / scale
    if not np.abs(matrix).max() < _TOO_LARGE:
        return "its numbers are too large to reckon with"
    left, stretch, right = np.linalg.svd(matrix[:3, :3])
    if stretch[2] <= _SINGULAR_TOLERANCE * stretch[0]:
        return "its axes lie in one plane, so it is no rotation"
    rotation = left @ right
    off = float(np.abs(matrix[:3, :3] - rotation).max())
    if off > _ROUNDING_TOLERANCE:
        remedies.append((f"it is off a rotation by {off:.2g}", "the nearest rotation counts"))
    mirrored = bool(np.linalg.det(rotation) < 0.0)
    if mirrored:
        rotation = rotation * np.array([1.0, -1.0, 1.0])
    row = np.concatenate([matrix[:3, 3], quaternion_from_matrix(rotation)])
    return MatrixPose(pose_from_array(row + 0.0), mirrored, tuple(remedies))


def _row_text(numbers: Array) -> str:
    return " ".join(f"{number:g}" for number in numbers)
