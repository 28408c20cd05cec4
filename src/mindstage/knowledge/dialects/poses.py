"""Numbers: lengths, ways and rotations of a map, as a world has them.

Dialects 4 to 6 count in meters, in ROS's frame; whoever loads a map may know better (`source_map.conventions`). What is
gone by is said aloud with what a wrong guess would show in: the heights that come out.

Matrices: poses that are told as sixteen numbers, and what may be wrong with those.

Nesting frames: whether a part's pose is told in the frame of the map, or in that of what it is a part of.

Maps do not say it, but only one of the two puts parts near their wholes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mindstage.knowledge.dialects.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.knowledge.dialects.normalize import DialectNormalizer
from mindstage.knowledge.rdf import local_name
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


def resolve_pose_frames(
    normalizer: DialectNormalizer, poses: Mapping[Iri, Pose], parents: Mapping[Iri, Iri]
) -> Mapping[Iri, Pose]:
    """The poses in the frame of the map, whichever frame they are told in.

    Args:
        rewording: where the decision is said aloud.
        poses: as told.
        wholes: what each part is a part of.
    """
    parts = {part: whole for part, whole in parents.items() if part in poses and whole in poses}
    if not parts:
        return poses
    rows = {individual: normalized_pose_array(pose) for individual, pose in poses.items()}
    within = _compose_along_parents(parts, rows)
    nearer = 0
    for part, whole in parts.items():
        as_map = float(np.linalg.norm(rows[part][:3] - rows[whole][:3]))
        as_part = float(np.linalg.norm(within[part][:3] - within[whole][:3]))
        nearer += as_part < as_map
    evidence = f"{len(parts) - nearer} of {len(parts)} parts are not farther from their wholes this way than the other"
    if 2 * nearer <= len(parts):
        normalizer.source_map.record_assumption("poses of parts", "in the frame of the map", evidence)
        return poses
    evidence = f"{nearer} of {len(parts)} parts are nearer to their wholes this way than the other"
    normalizer.source_map.record_assumption("poses of parts", "in the frame of what they are parts of", evidence)
    return {part: pose_from_array(within[part]) if part in parts else pose for part, pose in poses.items()}


def _compose_along_parents(parents: Mapping[Iri, Iri], poses: Mapping[Iri, Array]) -> Mapping[Iri, Array]:
    """Where things are if each part is told within its whole; a circle ends where it would begin again."""
    found: dict[Iri, Array] = {}
    for start in poses:
        way: dict[Iri, None] = {}
        here = start
        while here in parents and here not in found and here not in way:
            way[here] = None
            here = parents[here]
        row = found.setdefault(here, poses[here])
        for part in reversed(way):
            if part not in found:
                row = found[part] = pose_multiply(row, poses[part])
    return found


_MIRROR = FrameConversion(signs=(1.0, -1.0, 1.0))


class NumberReader:
    """How the numbers of one map are meant."""

    def __init__(self, conventions: UnitConventions, *, order: QuaternionOrder = QuaternionOrder.WXYZ) -> None:
        """Decides.

        Args:
            conventions: what the user says.
            order: how the dialect writes quaternions.
        """
        self.units = conventions.units or LengthUnit.METERS
        self.frame = conventions.frame or Handedness.ROS
        self.order = conventions.quaternion or order
        self._per_meter = self.units.per_meter

    def pose(self, pose: Pose) -> Pose:
        """A pose whose quaternion is w x y z already."""
        x, y, z = self.lengths(pose.position)
        moved = Pose((x, y, z), pose.quaternion)
        return _MIRROR.pose(moved) if self.frame is Handedness.UNREAL else moved

    def quaternion(self, numbers: Sequence[float]) -> tuple[float, float, float, float]:
        """A quaternion as written, as w x y z."""
        a, b, c, d = numbers
        return (d, a, b, c) if self.order is QuaternionOrder.XYZW else (a, b, c, d)

    def length(self, length: float) -> float:
        """A length [m]."""
        return length / self._per_meter

    def lengths(self, lengths: Sequence[float]) -> Sequence[float]:
        """Lengths, and ways before they are mirrored [m]."""
        return tuple(map(self.length, lengths))

    def direction(self, direction: Sequence[float]) -> Sequence[float]:
        """A way whose length means nothing."""
        x, y, z = direction
        return (x, -y, z) if self.frame is Handedness.UNREAL else (x, y, z)

    def report_assumptions(self, normalizer: DialectNormalizer, *, quaternions: bool = False) -> None:
        """Says aloud what was gone by, with the heights that it leads to."""
        if not normalizer.poses:
            return
        low, high = _height_range(normalizer)
        number = int(np.argmax(high - low))
        tallest, tall = local_name([*normalizer.poses][number]), high[number] - low[number]
        evidence = f"in m, all stands from {low.min():.2f} to {high.max():.2f} m, and {tallest} is {tall:.2f} m tall"
        normalizer.source_map.record_assumption("units", self.units.value, evidence)
        normalizer.source_map.record_assumption(
            "frame", self.frame.value, "maps of this dialect are right-handed, with z up"
        )
        if quaternions:
            upright = sum(abs(pose.quaternion[0]) == 1.0 for pose in normalizer.poses.values())
            evidence = f"{upright} of {len(normalizer.poses)} things are not turned at all in this order"
            normalizer.source_map.record_assumption("quaternion", self.order.value, evidence)


def _height_range(normalizer: DialectNormalizer) -> tuple[Array, Array]:
    """From which height to which everything reaches that has a place [m]."""
    poses = pose_array(normalizer.poses.values())
    half = np.array([normalizer.sizes.get(each, (0.0, 0.0, 0.0)) for each in normalizer.poses]) / 2
    up = np.sum(np.abs(rotation_matrix(normalize(poses[:, 3:]))[:, 2, :]) * half, axis=1)
    return poses[:, 2] - up, poses[:, 2] + up
