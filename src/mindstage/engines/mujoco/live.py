"""Live: a compiled model, its state, and where everything of ours is in it."""

from __future__ import annotations

from collections.abc import Collection, Container
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.forest import Branch
from mindstage.engines.joints import Axis
from mindstage.world import BodyId
from mindstage.world.geometry import Array

__all__ = ["Joint", "Live"]


@dataclass(slots=True)
class Joint:
    """A branch of the forest as it stands in the model."""

    branch: Branch
    axes: tuple[Axis, ...]
    ball: bool
    position: int
    """Where its coordinates begin in `qpos`, in the order of `axes` (a ball's quaternion last)."""
    velocity: int
    """Where they begin in `qvel`."""
    body: int
    """The MuJoCo body that the joints move."""


@dataclass(slots=True)
class Live:
    """A compiled model, its state, and where everything is in it."""

    model: Any
    data: Any
    rows: dict[BodyId, int]
    """The order of poses: as in the blueprint."""
    numbers: dict[BodyId, int]
    """MuJoCo's number of each body; scenery has none."""
    order: NDArray[np.intp]
    """The same in the order of `Blueprint.rows`, for reading all poses at once; 0 for scenery."""
    scenery: NDArray[np.intp]
    """Rows of bodies that are part of MuJoCo's world."""
    scenery_poses: Array
    """Where those stand."""
    joints: dict[BodyId, Joint]
    """By constraint."""
    free: dict[BodyId, tuple[int, int]]
    """Of each assembly that moves freely: where its pose begins in `qpos`, its velocity in `qvel`."""
    mocap: dict[BodyId, int]
    """MuJoCo's mocap number of each kinematic assembly."""

    def without(self, gone: Collection[BodyId], *, joints: Container[BodyId]) -> Live:
        """The same, as a state to carry over, in which some bodies are not known any more.

        Args:
            gone: those bodies.
            joints: the constraints that are still there.
        """
        return replace(
            self,
            numbers={id: number for id, number in self.numbers.items() if id not in gone},
            free={id: place for id, place in self.free.items() if id not in gone},
            joints={id: joint for id, joint in self.joints.items() if id in joints},
        )

    def poses(self) -> Array:
        """All poses, n x 7, in the order of `Blueprint.rows`."""
        poses = np.empty((len(self.order), 7))
        poses[:, :3], poses[:, 3:] = self.data.xpos[self.order], self.data.xquat[self.order]
        poses[self.scenery] = self.scenery_poses
        return poses
