"""Blueprint: all that was decided before a model is built, so that nothing is decided while it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mindstage.engines.forest import KinematicForest, RigidGroup
from mindstage.engines.planning import PhysicsModelBuilder
from mindstage.world import Body, BodyId, Mobility
from mindstage.world.geometry import Array

__all__ = ["ModelInput"]

_FIXED_MOBILITIES = (Mobility.STATIC, Mobility.STATIONARY)


@dataclass(slots=True)
class ModelInput:
    """All that a model is made from; rows of arrays go with `rows`."""

    builder: PhysicsModelBuilder
    poses: Array
    """Where the bodies stand, n x 7, unit quaternions."""
    timestep_s: float
    bodies: Mapping[BodyId, Body]
    rows: dict[BodyId, int]
    sizes: Array
    masses: dict[BodyId, float]
    forest: KinematicForest
    excluded_pairs: set[tuple[BodyId, BodyId]]
    kinematics_driven: bool = False
    """Whether somebody moves kinematic bodies; until then they are fixed like static ones, which costs nothing."""

    def is_fixed(self, group: RigidGroup) -> bool:
        """Whether it is fixed to the world."""
        return group.mobility in _FIXED_MOBILITIES or (
            group.mobility is Mobility.KINEMATIC and not self.kinematics_driven
        )

    @classmethod
    def from_builder(
        cls, builder: PhysicsModelBuilder, poses: Array, timestep_s: float, *, kinematics_driven: bool = False
    ) -> ModelInput:
        """What a planner decided about bodies that stand somewhere."""
        ids = builder.registry.ids
        rows = {id: row for row, id in enumerate(ids)}
        sizes, masses, bodies = builder.mass_properties.sizes(ids), builder.masses(), builder.registry.bodies
        return cls(
            builder,
            poses,
            timestep_s,
            bodies,
            rows,
            sizes,
            masses,
            builder.forest,
            builder.excluded_pairs(),
            kinematics_driven,
        )
