"""Assemblies: bodies that hang together by attachments, and what the constraints between them let move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mindstage.world.values import Body, BodyId, Joint, Mobility, World

__all__ = ["RigidGroups", "moving_body"]

_MOBILITY_RANK = {Mobility.DYNAMIC: 0, Mobility.KINEMATIC: 1}
"""Who gives way first."""


@dataclass(frozen=True, slots=True)
class RigidGroups:
    """The bodies of a world, in its order."""

    root_row: NDArray[np.intp]
    """For each body, that of its assembly: the row of the body that all of it finally hangs on."""
    jointed_pairs: frozenset[tuple[int, int]]
    """Pairs of assemblies that a constraint joins: the one that moves, then the one that holds it."""
    is_jointed: NDArray[np.bool_]
    """For each body, whether its assembly hangs in a constraint, as a door with its handle does."""
    is_dynamic: NDArray[np.bool_]
    """For each body, whether the physics moves its assembly."""

    @classmethod
    def from_world(cls, world: World) -> RigidGroups:
        """Finds them; a circle of attachments is cut somewhere."""
        rows = {body.id: row for row, body in enumerate(world.bodies)}
        parents = {hold.child: hold.parent for hold in world.attachments if hold.parent in rows}
        number = np.array([rows[_root_of(body.id, parents)] for body in world.bodies], dtype=np.intp)
        joined = set()
        for joint in world.joints:
            if joint.parent in rows and joint.child in rows:
                moving, holder = moving_body(joint, world.bodies[rows[joint.parent]], world.bodies[rows[joint.child]])
                joined.add((int(number[rows[moving.id]]), int(number[rows[holder.id]])))
        hung = np.isin(number, [moving for moving, _ in joined])
        simulates = np.array([body.physics.is_dynamic for body in world.bodies], dtype=bool)
        return cls(number, frozenset(joined), hung, simulates[number])


def moving_body(joint: Joint, parent: Body, child: Body) -> tuple[Body, Body]:
    """Which of its two bodies a constraint lets move, and which one holds it.

    Maps have the roles either way round. What the physics moves gives way before what a program moves, and that before
    what is fixed; of two alike the smaller one does.
    """

    def rank(body: Body) -> tuple[int, float]:
        mobility = body.physics.mobility
        return (2 if mobility is None else _MOBILITY_RANK.get(mobility, 2), _volume(body))

    moving, holder = sorted((child, parent), key=rank)
    return moving, holder


def _volume(body: Body) -> float:
    return float(np.prod(body.size)) if body.size else 0.0


def _root_of(id: BodyId, parents: Mapping[BodyId, BodyId]) -> BodyId:
    seen = {id}
    while (above := parents.get(id)) is not None and above not in seen:
        seen.add(above)
        id = above
    return id
