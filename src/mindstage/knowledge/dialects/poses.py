"""Numbers: lengths, ways and rotations of a map, as a world has them.

Dialects 4 to 6 count in meters, in ROS's frame; whoever loads a map may know better (`source_map.conventions`). What is
gone by is said aloud with what a wrong guess would show in: the heights that come out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.rewording import DialectNormalizer
from mindstage.knowledge.reading.conventions import Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.world import Pose
from mindstage.world.frames import FrameConversion
from mindstage.world.geometry import Array, normalize, pose_array, rotation_matrix

__all__ = ["NumberReader"]

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
