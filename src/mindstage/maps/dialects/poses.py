"""Poses of dialects 4 to 6: units, axes, quaternion order, matrices and frames of reference.

These dialects use meters and ROS axes by default; `source_map.conventions` overrides this. The conventions used are
recorded as assumptions together with the range of heights that results, which shows whether they are plausible.

The maps do not state whether the pose of a part is relative to the map or to its whole. `resolve_pose_frames` chooses
the frame that puts parts closer to their wholes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mindstage.maps.dialects.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.maps.dialects.normalize import DialectNormalizer
from mindstage.maps.dialects.units import ConventionGuess
from mindstage.rdf.graphs import local_name
from mindstage.scene import Iri, Pose
from mindstage.scene.transforms import (
    Array,
    FrameConversion,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_multiply,
    quaternion_from_matrix,
    rotation_matrix,
)

__all__ = ["MatrixPose", "NumberReader", "pose_from_matrix", "resolve_pose_frames"]


_ROUNDING_TOLERANCE = 1e-3
"""Largest difference of a matrix element from a rotation that is attributed to rounding."""
_SINGULAR_TOLERANCE = 1e-6
"""A matrix is singular if the ratio of its least stretch to the largest is at most this fraction."""
_TOO_LARGE = 1e100
"""Entries of matrices are smaller, so that their squares are finite; a number of any unit."""


_MIRROR = FrameConversion(signs=(1.0, -1.0, 1.0))


class MatrixPose(NamedTuple):
    """A pose read from a matrix, and the repairs that were necessary."""

    pose: Pose
    mirrored: bool = False
    """Whether the matrix was left-handed; its y axis is negated."""
    repairs: tuple[tuple[str, str], ...] = ()
    """Problem and remedy of each repair."""


def pose_from_matrix(matrix: Array) -> MatrixPose | str:
    """Converts a 4 x 4 matrix to a pose, or returns the reason why it is not one.

    The rotation is the one nearest to the matrix: the orthogonal factor of its polar decomposition.
    """
    repairs: list[tuple[str, str]] = []
    if np.any(matrix[3, :3]) and not np.any(matrix[:3, 3]):
        repairs.append(("its position is in the last row", "the matrix is transposed"))
        matrix = matrix.T
    if np.any(matrix[3, :3]):
        last = " ".join(f"{number:g}" for number in matrix[3])
        repairs.append((f"its last row is {last}", "the last row is ignored"))
    scale = float(matrix[3, 3])
    if scale == 0.0:
        return "its last number, m33, is 0"
    if scale != 1.0:
        repairs.append((f"its last number, m33, is {scale:g}", "all its numbers are divided by it"))
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = matrix / scale
    if not np.abs(matrix).max() < _TOO_LARGE:
        return "its numbers are too large"
    left, stretch, right = np.linalg.svd(matrix[:3, :3])
    if stretch[2] <= _SINGULAR_TOLERANCE * stretch[0]:
        return "its axes are linearly dependent, so it is not a rotation"
    rotation = left @ right
    difference = float(np.abs(matrix[:3, :3] - rotation).max())
    if difference > _ROUNDING_TOLERANCE:
        repairs.append((f"it differs from a rotation by {difference:.2g}", "the nearest rotation is used"))
    mirrored = bool(np.linalg.det(rotation) < 0.0)
    if mirrored:
        rotation = rotation * np.array([1.0, -1.0, 1.0])
    row = np.concatenate([matrix[:3, 3], quaternion_from_matrix(rotation)])
    return MatrixPose(pose_from_array(row + 0.0), mirrored, tuple(repairs))


def resolve_pose_frames(
    normalizer: DialectNormalizer, poses: Mapping[Iri, Pose], parents: Mapping[Iri, Iri]
) -> Mapping[Iri, Pose]:
    """Converts poses to the map frame, from the frame that the map gives them in.

    Args:
        normalizer: its map records the assumption.
        poses: as given, by individual.
        parents: the whole of each part.
    """
    parts = {part: whole for part, whole in parents.items() if part in poses and whole in poses}
    if not parts:
        return poses
    rows = {individual: normalized_pose_array(pose) for individual, pose in poses.items()}
    composed = _compose_along_parents(parts, rows)
    closer = 0
    for part, whole in parts.items():
        as_map = float(np.linalg.norm(rows[part][:3] - rows[whole][:3]))
        as_part = float(np.linalg.norm(composed[part][:3] - composed[whole][:3]))
        closer += as_part < as_map
    evidence = f"{len(parts) - closer} of {len(parts)} parts are not farther from their wholes in this frame"
    if 2 * closer <= len(parts):
        normalizer.source_map.record_assumption("poses of parts", "in the frame of the map", evidence)
        return poses
    evidence = f"{closer} of {len(parts)} parts are closer to their wholes in this frame"
    normalizer.source_map.record_assumption("poses of parts", "in the frame of their wholes", evidence)
    return {part: pose_from_array(composed[part]) if part in parts else pose for part, pose in poses.items()}


def _compose_along_parents(parents: Mapping[Iri, Iri], poses: Mapping[Iri, Array]) -> Mapping[Iri, Array]:
    """Composes each part's pose with that of its whole; a cycle of parts is broken where it closes."""
    found: dict[Iri, Array] = {}
    for start in poses:
        chain: dict[Iri, None] = {}
        here = start
        while here in parents and here not in found and here not in chain:
            chain[here] = None
            here = parents[here]
        row = found.setdefault(here, poses[here])
        for part in reversed(chain):
            if part not in found:
                row = found[part] = pose_multiply(row, poses[part])
    return found


class NumberReader:
    """Converts the numbers of a map to SI units and ROS axes."""

    def __init__(self, conventions: UnitConventions, *, order: QuaternionOrder = QuaternionOrder.WXYZ) -> None:
        """Creates a reader.

        Args:
            conventions: choices of the user; None in them means the default of the dialect.
            order: quaternion order of the dialect.
        """
        self.units = conventions.units or LengthUnit.METERS
        self.frame = conventions.frame or Handedness.ROS
        self.order = conventions.quaternion or order
        self._per_meter = self.units.per_meter
        self._chosen_units = conventions.units
        self._units_evidence = ""

    def consider_units(self, guess: ConventionGuess) -> None:
        """Takes the units that a map's sizes indicate if their evidence is overwhelming and the user chose none."""
        if guess.is_overwhelming and self._chosen_units is None and isinstance(guess.value, LengthUnit):
            self.units, self._per_meter = guess.value, guess.value.per_meter
            self._units_evidence = f"; {guess.evidence}"

    def pose(self, pose: Pose) -> Pose:
        """Converts a pose whose quaternion is w x y z."""
        x, y, z = self.lengths(pose.position)
        moved = Pose((x, y, z), pose.quaternion)
        return _MIRROR.pose(moved) if self.frame is Handedness.UNREAL else moved

    def quaternion(self, numbers: Sequence[float]) -> tuple[float, float, float, float]:
        """Converts a quaternion to w x y z."""
        a, b, c, d = numbers
        return (d, a, b, c) if self.order is QuaternionOrder.XYZW else (a, b, c, d)

    def length(self, length: float) -> float:
        """Converts a length to meters."""
        return length / self._per_meter

    def lengths(self, lengths: Sequence[float]) -> Sequence[float]:
        """Converts lengths, or an offset before `direction`, to meters."""
        return tuple(map(self.length, lengths))

    def direction(self, direction: Sequence[float]) -> Sequence[float]:
        """Converts the axes of a direction; its length is not converted."""
        x, y, z = direction
        return (x, -y, z) if self.frame is Handedness.UNREAL else (x, y, z)

    def report_assumptions(self, normalizer: DialectNormalizer) -> None:
        """Records the conventions used as assumptions, with the heights that result."""
        if not normalizer.poses:
            return
        low, high = _height_range(normalizer)
        number = int(np.argmax(high - low))
        tallest, tall = local_name([*normalizer.poses][number]), high[number] - low[number]
        evidence = f"in m, heights range from {low.min():.2f} to {high.max():.2f} m, and {tallest} is {tall:.2f} m tall"
        evidence += self._units_evidence
        normalizer.source_map.record_assumption("units", self.units.value, evidence)
        normalizer.source_map.record_assumption(
            "frame", self.frame.value, "maps of this dialect are right-handed, with z up"
        )


def _height_range(normalizer: DialectNormalizer) -> tuple[Array, Array]:
    """Returns the lowest and the highest point of each body with a pose [m]."""
    poses = pose_array(normalizer.poses.values())
    half = np.array([normalizer.sizes.get(each, (0.0, 0.0, 0.0)) for each in normalizer.poses]) / 2
    up = np.sum(np.abs(rotation_matrix(normalize(poses[:, 3:]))[:, 2, :]) * half, axis=1)
    return poses[:, 2] - up, poses[:, 2] + up
