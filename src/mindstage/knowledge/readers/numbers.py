"""Numbers: lengths, ways and rotations of a map, as a world has them.

Dialects 4 to 6 count in metres, in ROS's frame; whoever loads a map may know better (`excerpt.conventions`). What is
gone by is said aloud with what a wrong guess would show in: the heights that come out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mindstage.knowledge.names import local_name
from mindstage.knowledge.readers.rewording import Rewording
from mindstage.knowledge.reading.conventions import Conventions, Frame, QuaternionOrder, Units
from mindstage.world import Pose
from mindstage.world.frames import Conversion
from mindstage.world.geometry import Array, pose_array, rotation_matrix, unit

__all__ = ["Numbers"]

_MIRROR = Conversion(signs=(1.0, -1.0, 1.0))


class Numbers:
    """How the numbers of one map are meant."""

    def __init__(self, conventions: Conventions, *, order: QuaternionOrder = QuaternionOrder.WXYZ) -> None:
        """Decides.

        Args:
            conventions: what the user says.
            order: how the dialect writes quaternions.
        """
        self.units = conventions.units or Units.METRES
        self.frame = conventions.frame or Frame.ROS
        self.order = conventions.quaternion or order
        self._per_metre = self.units.per_metre

    def pose(self, pose: Pose) -> Pose:
        """A pose whose quaternion is w x y z already."""
        x, y, z = self.lengths(pose.position)
        moved = Pose((x, y, z), pose.quaternion)
        return _MIRROR.pose(moved) if self.frame is Frame.UNREAL else moved

    def quaternion(self, numbers: Sequence[float]) -> tuple[float, float, float, float]:
        """A quaternion as written, as w x y z."""
        a, b, c, d = numbers
        return (d, a, b, c) if self.order is QuaternionOrder.XYZW else (a, b, c, d)

    def length(self, length: float) -> float:
        """A length [m]."""
        return length / self._per_metre

    def lengths(self, lengths: Sequence[float]) -> Sequence[float]:
        """Lengths, and ways before they are mirrored [m]."""
        return tuple(map(self.length, lengths))

    def direction(self, direction: Sequence[float]) -> Sequence[float]:
        """A way whose length means nothing."""
        x, y, z = direction
        return (x, -y, z) if self.frame is Frame.UNREAL else (x, y, z)

    def tell(self, rewording: Rewording, *, quaternions: bool = False) -> None:
        """Says aloud what was gone by, with the heights that it leads to."""
        if not rewording.poses:
            return
        low, high = _reaches(rewording)
        number = int(np.argmax(high - low))
        tallest, tall = local_name([*rewording.poses][number]), high[number] - low[number]
        evidence = f"in m, all stands from {low.min():.2f} to {high.max():.2f} m, and {tallest} is {tall:.2f} m tall"
        rewording.excerpt.assume("units", self.units.value, evidence)
        rewording.excerpt.assume("frame", self.frame.value, "maps of this dialect are right-handed, with z up")
        if quaternions:
            upright = sum(abs(pose.quaternion[0]) == 1.0 for pose in rewording.poses.values())
            evidence = f"{upright} of {len(rewording.poses)} things are not turned at all in this order"
            rewording.excerpt.assume("quaternion", self.order.value, evidence)


def _reaches(rewording: Rewording) -> tuple[Array, Array]:
    """From which height to which everything reaches that has a place [m]."""
    poses = pose_array(rewording.poses.values())
    half = np.array([rewording.sizes.get(each, (0.0, 0.0, 0.0)) for each in rewording.poses]) / 2
    up = np.sum(np.abs(rotation_matrix(unit(poses[:, 3:]))[:, 2, :]) * half, axis=1)
    return poses[:, 2] - up, poses[:, 2] + up
