"""Neighbourhood: how bodies stand to one another, what is in the way, and where a place on one of them is."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from mindstage.bridge.description import pose_messages
from mindstage.engines import Poses
from mindstage.errors import BodyUnknown
from mindstage.knowledge.names import local_name
from mindstage.msgs import geometry_msgs
from mindstage.ros.sight import Sight
from mindstage.world import Body, BodyId, World
from mindstage.world.boxes import Boxes, depths, neighbours
from mindstage.world.geometry import pose_array, unit
from mindstage.world.space import Relation, Space

__all__ = ["boxes_of", "how_they_stand", "obstacles", "socket_pose", "wire_pose"]

APART = "apart"
_TOUCH_M = 1e-3
"""What stands in something by less only touches it."""
_UNTOLD = (0.05, 0.05, 0.05)
"""What has no size counts as so large here [m]."""


def how_they_stand(world: World, one: str, other: str) -> str:
    """The closest relation of one body to another, in a word."""
    space = Space(world)
    found = {each.relation for each in space.related(things=[BodyId(one)], others=[BodyId(other)])}
    return next((relation.value for relation in Relation if relation in found), APART)


def obstacles(world: World, body: Body) -> tuple[BodyId, ...]:
    """What a body would stand in, if it were spawned; what encloses everything is no obstacle."""
    if not any(body.pose.quaternion):
        return ()  # no rotation at all: the engine will refuse it
    shells = set(Space(replace(world, bodies=(*world.bodies, body))).shells)
    bodies = [each for each in world.bodies if each.id not in shells]
    boxes = boxes_of([*bodies, body])
    wanted = np.zeros(len(bodies) + 1, dtype=bool)
    wanted[-1] = True
    met: list[BodyId] = []
    for a, b in neighbours(boxes, wanted, ~wanted):
        deep = depths(boxes, a, b) > _TOUCH_M
        met += (bodies[min(pair)].id for pair in zip(a[deep].tolist(), b[deep].tolist(), strict=True))
    return tuple(met)


def boxes_of(bodies: list[Body]) -> Boxes:
    """Bodies as boxes."""
    poses = pose_array(body.pose for body in bodies)
    poses[:, 3:] = unit(poses[:, 3:])
    return Boxes.of(poses, np.array([body.size or _UNTOLD for body in bodies], dtype=np.float64).reshape(-1, 3))


def socket_pose(sight: Sight, id: str, socket: str) -> Poses:
    """Where a place on a body is.

    Raises:
        BodyUnknown: there is no such body, or nothing of that name hangs on it.
    """
    row = sight.row(id)
    if not socket:
        return row
    hanging = [sight.body(hold.child) for hold in sight.world().attachments if hold.parent == id]
    for body in hanging:
        if socket in {body.id, body.label, local_name(body.cls)}:
            return sight.row(body.id)
    raise BodyUnknown(socket, known=[body.id for body in hanging], world=f"what hangs on {id}")


def wire_pose(row: Poses) -> geometry_msgs.Pose:
    """Seven numbers for the wire."""
    return pose_messages(row[None])[0]
