"""Live: a compiled model, its state, and where everything of ours is in it."""

from __future__ import annotations

from collections.abc import Collection, Container
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.forest import TreeJoint
from mindstage.engines.joints import JointAxis
from mindstage.world import BodyId
from mindstage.world.geometry import Array

__all__ = ["CompiledModel", "ModelJoint"]


@dataclass(slots=True)
class ModelJoint:
    """A branch of the forest as it stands in the model."""

    tree_joint: TreeJoint
    axes: tuple[JointAxis, ...]
    is_ball: bool
    qpos_address: int
    """Where its coordinates begin in `qpos`, in the order of `axes` (a ball's quaternion last)."""
    dof_address: int
    """Where they begin in `qvel`."""
    body_id: int
    """The MuJoCo body that the joints move."""


@dataclass(slots=True)
class CompiledModel:
    """A compiled model, its state, and where everything is in it."""

    model: Any
    data: Any
    rows: dict[BodyId, int]
    """The order of poses: as in the blueprint."""
    body_ids: dict[BodyId, int]
    """MuJoCo's number of each body; scenery has none."""
    body_id_order: NDArray[np.intp]
    """The same in the order of `ModelInput.rows`, for reading all poses at once; 0 for scenery."""
    scenery: NDArray[np.intp]
    """Rows of bodies that are part of MuJoCo's world."""
    scenery_poses: Array
    """Where those stand."""
    joints: dict[BodyId, ModelJoint]
    """By constraint."""
    free_joint_addresses: dict[BodyId, tuple[int, int]]
    """Of each assembly that moves freely: where its pose begins in `qpos`, its velocity in `qvel`."""
    mocap_ids: dict[BodyId, int]
    """MuJoCo's mocap number of each kinematic assembly."""

    def without(self, removed: Collection[BodyId], *, remaining_joints: Container[BodyId]) -> CompiledModel:
        """The same, as a state to carry over, in which some bodies are not known any more.

        Args:
            gone: those bodies.
            joints: the constraints that are still there.
        """
        return replace(
            self,
            body_ids={id: number for id, number in self.body_ids.items() if id not in removed},
            free_joint_addresses={id: place for id, place in self.free_joint_addresses.items() if id not in removed},
            joints={id: joint for id, joint in self.joints.items() if id in remaining_joints},
        )

    def poses(self) -> Array:
        """All poses, n x 7, in the order of `ModelInput.rows`."""
        poses = np.empty((len(self.body_id_order), 7))
        poses[:, :3], poses[:, 3:] = self.data.xpos[self.body_id_order], self.data.xquat[self.body_id_order]
        poses[self.scenery] = self.scenery_poses
        return poses
