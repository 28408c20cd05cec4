"""Opening: doors and drawers pulled open, one after the other, as a hand would."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.stage import Simulation
    from mindstage.world import Vector, World

__all__ = ["pull_open"]

_MAX_PULL_M = 0.6
_PULL_DURATION_S = 3.0
_SETTLE_S = 0.5


def pull_open(simulation: Simulation, world: World, ids: Iterable[str]) -> None:
    """Pulls each by its handle, if it has one, and lets everything come to rest.

    Raises:
        BodyNotFoundError: one of them is not there.
    """
    from mindstage.world import BodyId

    wanted = [world.body(BodyId(id)).id for id in ids]
    frames = {joint.child: joint.parent for joint in world.joints}
    frames |= {joint.parent: joint.child for joint in world.joints if joint.parent in wanted}
    for id in wanted:
        front, frame = world.body(id).pose.position, world.body(frames.get(id, id)).pose.position
        grip = next((hold.child for hold in world.attachments if hold.parent == id), id)
        simulation.pull(grip, point=(0.0, 0.0, 0.0), target=_pull_target(world.body(grip).pose.position, front, frame))
        simulation.step(_PULL_DURATION_S)
        simulation.release(grip)
    if wanted:
        simulation.step(_SETTLE_S)


def _pull_target(point: Vector, front: Vector, frame: Vector) -> Vector:
    """Level, from the middle of a piece of furniture to its front, as far as a hand reaches."""
    x, y = front[0] - frame[0], front[1] - frame[1]
    if abs(x) < abs(y):
        x = 0.0
    else:
        y = 0.0
    scale = _MAX_PULL_M / max(abs(x) + abs(y), 1e-9)
    return point[0] + scale * x, point[1] + scale * y, point[2]
