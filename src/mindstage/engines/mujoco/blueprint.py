"""Blueprint: all that was decided before a model is built, so that nothing is decided while it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mindstage.engines.forest import Assembly, Forest
from mindstage.engines.planning import Planner
from mindstage.world import Body, BodyId, Mobility
from mindstage.world.geometry import Array

__all__ = ["Blueprint"]

_FIXED = (Mobility.STATIC, Mobility.STATIONARY)


@dataclass(slots=True)
class Blueprint:
    """All that a model is made from; rows of arrays go with `rows`."""

    planner: Planner
    where: Array
    """Where the bodies stand, n x 7, unit quaternions."""
    timestep_s: float
    bodies: Mapping[BodyId, Body]
    rows: dict[BodyId, int]
    sizes: Array
    masses: dict[BodyId, float]
    forest: Forest
    apart: set[tuple[BodyId, BodyId]]
    driven: bool = False
    """Whether somebody moves kinematic bodies; until then they are fixed like static ones, which costs nothing."""

    def stands(self, assembly: Assembly) -> bool:
        """Whether it is fixed to the world."""
        return assembly.mobility in _FIXED or (assembly.mobility is Mobility.KINEMATIC and not self.driven)

    @classmethod
    def of(cls, planner: Planner, where: Array, timestep_s: float, *, driven: bool = False) -> Blueprint:
        """What a planner decided about bodies that stand somewhere."""
        ids = planner.inventory.ids
        rows = {id: row for row, id in enumerate(ids)}
        sizes, masses, bodies = planner.matter.sizes(ids), planner.masses(), planner.inventory.bodies
        return cls(planner, where, timestep_s, bodies, rows, sizes, masses, planner.forest, planner.apart(), driven)
