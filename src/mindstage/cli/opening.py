"""Opening: doors and drawers pulled open, one after the other, as a hand would."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.stage import Stage
    from mindstage.world import Vector, World

__all__ = ["open_up"]

_REACH_M = 0.6
_PULL_S = 3.0
_REST_S = 0.5


def open_up(stage: Stage, world: World, ids: Iterable[str]) -> None:
    """Pulls each by its handle, if it has one, and lets everything come to rest.

    Raises:
        BodyUnknown: one of them is not there.
    """
    from mindstage.world import BodyId

    wanted = [world.body(BodyId(id)).id for id in ids]
    frames = {joint.child: joint.parent for joint in world.constraints}
    frames |= {joint.parent: joint.child for joint in world.constraints if joint.parent in wanted}
    for id in wanted:
        front, frame = world.body(id).pose.position, world.body(frames.get(id, id)).pose.position
        grip = next((hold.child for hold in world.attachments if hold.parent == id), id)
        stage.grip(grip, point=(0.0, 0.0, 0.0), target=_target(world.body(grip).pose.position, front, frame))
        stage.step(_PULL_S)
        stage.release(grip)
    if wanted:
        stage.step(_REST_S)


def _target(held: Vector, front: Vector, frame: Vector) -> Vector:
    """Level, from the middle of a piece of furniture to its front, as far as a hand reaches."""
    x, y = front[0] - frame[0], front[1] - frame[1]
    if abs(x) < abs(y):
        x = 0.0
    else:
        y = 0.0
    scale = _REACH_M / max(abs(x) + abs(y), 1e-9)
    return held[0] + scale * x, held[1] + scale * y, held[2]
