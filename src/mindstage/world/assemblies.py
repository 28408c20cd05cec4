"""Assemblies: bodies that hang together by attachments, and what the constraints between them let move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mindstage.world.values import Body, BodyId, Constraint, Mobility, World

__all__ = ["Assemblies", "moving_end"]

_LIVELY = {Mobility.DYNAMIC: 0, Mobility.KINEMATIC: 1}
"""Who gives way first."""


@dataclass(frozen=True, slots=True)
class Assemblies:
    """The bodies of a world, in its order."""

    number: NDArray[np.intp]
    """For each body, that of its assembly: the row of the body that all of it finally hangs on."""
    joined: frozenset[tuple[int, int]]
    """Pairs of assemblies that a constraint joins: the one that moves, then the one that holds it."""
    hung: NDArray[np.bool_]
    """For each body, whether its assembly hangs in a constraint, as a door with its handle does."""
    moves: NDArray[np.bool_]
    """For each body, whether the physics moves its assembly."""

    @classmethod
    def of(cls, world: World) -> Assemblies:
        """Finds them; a circle of attachments is cut somewhere."""
        rows = {body.id: row for row, body in enumerate(world.bodies)}
        parents = {hold.child: hold.parent for hold in world.attachments if hold.parent in rows}
        number = np.array([rows[_top(body.id, parents)] for body in world.bodies], dtype=np.intp)
        joined = set()
        for joint in world.constraints:
            if joint.parent in rows and joint.child in rows:
                moving, holder = moving_end(joint, world.bodies[rows[joint.parent]], world.bodies[rows[joint.child]])
                joined.add((int(number[rows[moving.id]]), int(number[rows[holder.id]])))
        hung = np.isin(number, [moving for moving, _ in joined])
        simulates = np.array([body.physics.simulates for body in world.bodies], dtype=bool)
        return cls(number, frozenset(joined), hung, simulates[number])


def moving_end(joint: Constraint, parent: Body, child: Body) -> tuple[Body, Body]:
    """Which of its two bodies a constraint lets move, and which one holds it.

    Maps have the roles either way round. What the physics moves gives way before what a program moves, and that before
    what is fixed; of two alike the smaller one does.
    """
    moving, holder = sorted((child, parent), key=lambda body: (_LIVELY.get(body.physics.mobility, 2), _volume(body)))  # type: ignore[arg-type]
    return moving, holder


def _volume(body: Body) -> float:
    return float(np.prod(body.size)) if body.size else 0.0


def _top(id: BodyId, parents: Mapping[BodyId, BodyId]) -> BodyId:
    seen = {id}
    while (above := parents.get(id)) is not None and above not in seen:
        seen.add(above)
        id = above
    return id
