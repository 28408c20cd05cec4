"""Neighborhood: how bodies stand to one another, what is in the way, and where a place on one of them is."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from mindstage.bridge.description import pose_array_messages
from mindstage.engines import PoseArray
from mindstage.errors import BodyNotFoundError
from mindstage.knowledge.names import local_name
from mindstage.msgs import geometry_msgs
from mindstage.ros.sight import StateReader
from mindstage.world import Body, BodyId, World
from mindstage.world.boxes import OrientedBoxes, overlapping_pairs, penetration_depths
from mindstage.world.geometry import normalize, pose_array
from mindstage.world.space import SpatialRelation, SpatialRelations

__all__ = ["oriented_boxes", "overlapping_bodies", "pose_message", "socket_pose", "spatial_relation_name"]

UNRELATED = "apart"
_CONTACT_TOLERANCE_M = 1e-3
"""What stands in something by less only touches it."""
_DEFAULT_SIZE = (0.05, 0.05, 0.05)
"""What has no size counts as so large here [m]."""


def spatial_relation_name(world: World, one: str, other: str) -> str:
    """The closest relation of one body to another, in a word."""
    space = SpatialRelations(world)
    found = {each.relation for each in space.related(subjects=[BodyId(one)], others=[BodyId(other)])}
    return next((relation.value for relation in SpatialRelation if relation in found), UNRELATED)


def overlapping_bodies(world: World, body: Body) -> tuple[BodyId, ...]:
    """What a body would stand in, if it were spawned; what encloses everything is no obstacle."""
    if not any(body.pose.quaternion):
        return ()  # no rotation at all: the engine will refuse it
    shells = set(SpatialRelations(replace(world, bodies=(*world.bodies, body))).enclosing_bodies)
    bodies = [each for each in world.bodies if each.id not in shells]
    boxes = oriented_boxes([*bodies, body])
    wanted = np.zeros(len(bodies) + 1, dtype=bool)
    wanted[-1] = True
    met: list[BodyId] = []
    for a, b in overlapping_pairs(boxes, wanted, ~wanted):
        deep = penetration_depths(boxes, a, b) > _CONTACT_TOLERANCE_M
        met += (bodies[min(pair)].id for pair in zip(a[deep].tolist(), b[deep].tolist(), strict=True))
    return tuple(met)


def oriented_boxes(bodies: list[Body]) -> OrientedBoxes:
    """Bodies as boxes."""
    poses = pose_array(body.pose for body in bodies)
    poses[:, 3:] = normalize(poses[:, 3:])
    return OrientedBoxes.from_poses(
        poses, np.array([body.size or _DEFAULT_SIZE for body in bodies], dtype=np.float64).reshape(-1, 3)
    )


def socket_pose(state_reader: StateReader, id: str, socket: str) -> PoseArray:
    """Where a place on a body is.

    Raises:
        BodyNotFoundError: there is no such body, or nothing of that name hangs on it.
    """
    row = state_reader.pose(id)
    if not socket:
        return row
    hanging = [state_reader.body(hold.child) for hold in state_reader.world().attachments if hold.parent == id]
    for body in hanging:
        if socket in {body.id, body.label, local_name(body.cls)}:
            return state_reader.pose(body.id)
    raise BodyNotFoundError(socket, known=[body.id for body in hanging], world=f"what hangs on {id}")


def pose_message(row: PoseArray) -> geometry_msgs.Pose:
    """Seven numbers for the wire."""
    return pose_array_messages(row[None])[0]
