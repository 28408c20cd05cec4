"""Grip: a spring between a point on a body and a point in the air, as a hand or a mouse pulls.

The force is what a person would use on furniture, so a door opens and a wall does not. Spring and damper follow the
mass that is pulled: one that suits a fridge door would shake a teaspoon to pieces.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mindstage.engines.contract import Engine, PoseArray
from mindstage.world import BodyId, Vector, World
from mindstage.world.geometry import Array, normalize, quat_rotate

__all__ = ["Perturbations", "SpringPerturbation"]

_SUBSTEP_S = 0.004
"""The force is computed anew this often [s]; spring and damper below are stable at this pace."""
_MAX_STIFFNESS = 400.0  # [N/m]
_STIFFNESS_PER_KG = 1500.0  # [N/(m kg)], by which gravity makes a held thing sag 7 mm


@dataclass(slots=True, kw_only=True)
class SpringPerturbation:
    """One hold on one body."""

    id: BodyId
    point: Vector
    """Where it is held, in the body's own frame [m]."""
    target: Vector
    """Where that point shall go, in the world [m]."""
    mass_kg: float = 1.0
    """Of what is pulled."""
    max_force: float = 150.0
    """[N]: about what one arm can pull."""
    _previous_position: Array | None = None

    def force(self, pose: PoseArray, duration_s: float) -> tuple[Vector, Vector]:
        """The force [N] and where it acts [m], both in the world.

        Args:
            pose: the body's present pose, seven numbers.
            duration_s: time since the last call, to know the point's speed.
        """
        held = pose[:3] + quat_rotate(normalize(pose[3:]), np.asarray(self.point))
        velocity = (
            np.zeros(3) if self._previous_position is None else (held - self._previous_position) / max(duration_s, 1e-6)
        )
        self._previous_position = held
        stiffness = min(_MAX_STIFFNESS, _STIFFNESS_PER_KG * self.mass_kg)
        damping = 1.4 * (stiffness * self.mass_kg) ** 0.5
        force = stiffness * (np.asarray(self.target) - held) - damping * velocity
        size = float(np.linalg.norm(force))
        if size > self.max_force:
            force *= self.max_force / size
        return _vector(force), _vector(held)


class Perturbations(dict[BodyId, SpringPerturbation]):
    """All holds, by body."""

    def pull(self, id: BodyId, *, point: Vector, target: Vector, worlds: Iterable[World]) -> None:
        """Takes hold of a body, or moves the hand that holds it there already."""
        held = self.get(id)
        if held is None or held.point != point:
            self[id] = SpringPerturbation(id=id, point=point, target=target, mass_kg=_effective_mass(id, worlds))
        else:
            held.target = target

    def release(self, id: BodyId | None = None) -> None:
        """Lets go of one body, or of all."""
        if id is None:
            self.clear()
        else:
            self.pop(id, None)

    def step(self, engine: Engine, duration_s: float) -> None:
        """Lets time pass [s], and pulls meanwhile."""
        left_s = duration_s
        while self and left_s > _SUBSTEP_S:
            self._apply_forces(engine, _SUBSTEP_S)
            engine.step(_SUBSTEP_S)
            left_s -= _SUBSTEP_S
        engine.step(left_s)

    def _apply_forces(self, engine: Engine, duration_s: float) -> None:
        ids, poses = engine.poses()
        rows = {id: row for row, id in enumerate(ids) if id in self}
        for id, grip in list(self.items()):
            if id in rows:
                engine.apply_force(id, *grip.force(poses[rows[id]], duration_s))


def _effective_mass(id: BodyId, worlds: Iterable[World]) -> float:
    """What one pulls when one pulls that body: its own mass and that of all it hangs on [kg]."""
    masses: dict[BodyId, float] = {}
    parents: dict[BodyId, BodyId] = {}
    for world in worlds:
        masses |= {body.id: body.physics.mass_kg or 0.0 for body in world.bodies}
        parents |= {hold.child: hold.parent for hold in world.attachments}
    mass, above = 0.0, set[BodyId]()
    while id in masses and id not in above:
        mass += masses[id]
        above.add(id)
        id = parents.get(id, BodyId(""))
    return mass or 1.0


def _vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
