"""Travelling: where constraints have let their bodies go, and where they would let them go, from poses alone.

For engines that do not say so themselves.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mindstage.engines.forest import Branch
from mindstage.engines.joints import Axis, axes_of, is_ball, place_from, place_of
from mindstage.engines.planning import Planner
from mindstage.errors import PoseUnreachable
from mindstage.world import BodyId
from mindstage.world.geometry import Array, compose, invert, rotation_angle

__all__ = ["joint_places", "require_reachable"]

_REACHED_M, _REACHED_RAD = 1e-6, 1e-6


def joint_places(planner: Planner, where: Mapping[BodyId, Array]) -> dict[BodyId, tuple[float, ...]]:
    """How far each constraint that can move has moved: see `Engine.joint_positions`.

    Args:
        planner: who hangs on whom.
        where: all poses.
    """
    places = {}
    for branch in planner.forest.branches.values():
        constraint = branch.constraint
        if axes := axes_of(constraint, upside_down=branch.upside_down):
            of_parent, of_child = planner.ends[constraint.id]
            fixed = compose(where[constraint.parent], of_parent)
            moving = compose(where[constraint.child], of_child)
            places[constraint.id] = tuple(place_of(compose(invert(fixed), moving), axes).tolist())
    return places


def require_reachable(
    planner: Planner, id: BodyId, target: Array, where: Mapping[BodyId, Array], *, slack: float = 0.0
) -> None:
    """Makes sure that the constraint which holds a body lets it get somewhere.

    Args:
        planner: who hangs on whom.
        id: a body that hangs on a constraint, the top of its assembly.
        target: where it is to be.
        where: all poses now.
        slack: how far off the engine's own poses may be [m, rad].

    Raises:
        PoseUnreachable: it does not.
    """
    branch = planner.forest.branches[id]
    axes = axes_of(branch.constraint, upside_down=branch.upside_down)
    if not axes:
        raise PoseUnreachable(id, reason=f"the constraint {branch.constraint.id!r} locks it")
    of_parent, of_child = branch.seen_from_root(planner.ends[branch.constraint.id])
    fixed = compose(where[branch.parent], of_parent)
    wanted = compose(target, compose(invert(where[id]), where[branch.child]))
    asked = compose(invert(fixed), compose(wanted, of_child))
    place = place_of(asked, axes)
    for axis in axes:
        _require_within(id, branch, axis, float(place[axis.index]), slack)
    allowed = np.zeros(6)
    for axis in axes:
        allowed[axis.index] = place[axis.index]
    relative = place_from(allowed.tolist())
    if is_ball(axes):
        relative[3:] = asked[3:]
    reached = compose(compose(fixed, relative), invert(of_child))
    off_m = float(np.linalg.norm(reached[:3] - wanted[:3]))
    if off_m > _REACHED_M + slack or float(rotation_angle(reached[3:], wanted[3:])) > _REACHED_RAD + slack:
        reason = f"{branch.constraint.id!r} does not lead there; the nearest it allows is {off_m:.3g} m off"
        raise PoseUnreachable(id, reason=reason)


def _require_within(id: BodyId, branch: Branch, axis: Axis, place: float, slack: float) -> None:
    beyond = place - axis.middle
    if axis.limit is not None and abs(beyond) > axis.limit + _REACHED_M + slack:
        end = axis.middle + np.copysign(axis.limit, beyond)
        asked_for = f"{place:.4g} {'m' if axis.slides else 'rad'}"
        raise PoseUnreachable(id, reason=f"{branch.constraint.id!r} ends at {end:g}, asked for was {asked_for}")
