"""Edits whose data are those of engines: actuators, and bodies as they were simulated before they were deleted."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mindstage.engines.base import Actuator
from mindstage.ranges import Finite
from mindstage.scene import BodyId, Joint, World
from mindstage.scene.collision_shapes import WallPanel
from mindstage.scene.edits import Edit, GeometryEdit
from mindstage.scene.world_model import FrozenStruct

__all__ = ["BodyPair", "PoseRow", "RestoreBodies", "SetActuators", "SettledPose", "SimulatedBodies"]

PoseRow = tuple[float, float, float, float, float, float, float]
"""A pose as engines have it: x y z [m], and a unit quaternion w x y z."""
BodyPair = tuple[BodyId, BodyId]
"""Two bodies, the lower id first."""


class SetActuators(Edit, frozen=True):
    """Adds actuators, replacing those of the same names (capability ACTUATORS).

    A joint with actuators has their friction and no other damping. The command of a new one is its current position, or
    0 for a velocity or an effort. Actuators are part of saved states and forks, not of snapshots; they are removed with
    their joints.

    Raises `BodyNotFoundError` if a joint or body does not exist, and `ValueError` if a joint cannot move along an axis,
    or has another actuator there; nothing changes then.
    """

    actuators: tuple[Actuator, ...]
    without_weight: tuple[BodyId, ...] = ()
    """Bodies whose weight the drives compensate, as those of real arms do, beside those of earlier edits."""
    removed: tuple[str, ...] = ()
    """Names of actuators that are removed first."""
    with_weight: tuple[BodyId, ...] = ()
    """Bodies whose weight is no longer compensated."""
    commands: Mapping[str, Finite] = MappingProxyType({})
    """Commands of the actuators, by name."""

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return tuple(dict.fromkeys(each.joint for each in self.actuators))


class SettledPose(FrozenStruct, frozen=True, kw_only=True):
    """Where a spawn moved a body."""

    pose: PoseRow
    before: PoseRow
    """Where it was before that: for a new body, the described pose."""
    shift_m: float
    """Distance from the described pose [m]."""


class SimulatedBodies(FrozenStruct, frozen=True, kw_only=True):
    """How some bodies, their joints and attachments are simulated: what a spawn decides about them."""

    attachment_poses: Mapping[BodyId, PoseRow] = {}
    """Pose of each attached child in its parent's frame."""
    joint_frames: Mapping[BodyId, tuple[PoseRow, PoseRow]] = {}
    """Frame of each joint in the map's parent and in its child."""
    simulated_joints: Mapping[BodyId, Joint] = {}
    """Joints whose limits are narrower than those of the world."""
    excluded_pairs: frozenset[BodyPair] = frozenset()
    """Pairs that do not collide, since they overlapped."""
    temporary_pairs: frozenset[BodyPair] = frozenset()
    """Those of them that collide again once they were apart."""
    given_excluded_pairs: frozenset[BodyPair] = frozenset()
    """Pairs that do not collide, since a spawn stated it."""
    non_colliding: frozenset[BodyId] = frozenset()
    wall_panels: Mapping[BodyId, tuple[WallPanel, ...]] = {}
    """Those of hollow bodies, in their frames."""
    contents: Mapping[BodyId, tuple[BodyId, ...]] = {}
    """The bodies for which each hollow body was made hollow."""
    actuators: tuple[Actuator, ...] = ()
    commands: Mapping[str, float] = {}
    weightless: frozenset[BodyId] = frozenset()
    immovable: frozenset[BodyId] = frozenset()
    settled: Mapping[BodyId, SettledPose] = {}
    below_ground: frozenset[BodyId] = frozenset()
    uncertain_poses: frozenset[BodyId] = frozenset()
    undecided: frozenset[BodyId] = frozenset()
    """Bodies whose collisions are decided anew before the next step, the others of the world included."""


class RestoreBodies(GeometryEdit, frozen=True):
    """Adds deleted bodies again, at rest, as they were simulated: nothing is decided anew, as a spawn does.

    They have their joints and attachments to bodies that exist, where those are now, at the positions that the joints
    had, their actuators with commands, and collide with what they collided with.

    Raises `BodyExistsError` if an id is in use; nothing changes then.
    """

    world: World
    """The bodies, their joints and attachments, as they were described."""
    poses: Mapping[BodyId, PoseRow]
    """The poses that they had, and those of the bodies at the other ends of their joints and attachments."""
    decisions: SimulatedBodies = SimulatedBodies()

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """See `Edit`."""
        return tuple(body.id for body in self.world.bodies)
