"""Plans: what Mindstage decided for an engine that leaves decisions to it, on the wire.

Who moves rigidly with whom, who collides with whom, what is touched, how much it weighs, and which constraints hold. A
`PhysicsModelDelta` tells what is new; whatever it does not name runs on as it was.
"""

from __future__ import annotations

import msgspec

from mindstage.bridge.description.worlds import to_json
from mindstage.world import IDENTITY, BodyId, CollisionShape, Mobility, Pose, Vector
from mindstage.world.values import FrozenStruct

__all__ = ["BodyModelDelta", "JointModelDelta", "PhysicsModelDelta", "model_delta_to_json"]


class BodyModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """How a body takes part in the physics from now on."""

    size: Vector
    """In force: assumed where the map has none [m]."""
    top: BodyId
    """The body that all others of its rigid assembly hang on; itself where it is that, or alone."""
    hold: Pose = IDENTITY
    """Where it is in the top's frame."""
    mobility: Mobility = Mobility.STATIC
    """Of the whole assembly."""
    gravity: bool = True
    """Whether it falls; of an assembly, as much of it as does counts."""
    mass_kg: float = 0.0
    """In force: estimated where the map has none; 0 for what the physics does not move."""
    ghost: bool = False
    """Whether it collides with nothing."""
    solids: tuple[CollisionShape, ...] = ()
    """All that can be touched of it, in its own frame."""
    friction: float | None = None
    """None leaves it to the engine."""
    restitution: float | None = None


class JointModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """Where a constraint's frame is, as seen from either end; its ranges are about where these two coincide."""

    parent: BodyId
    child: BodyId
    of_parent: Pose = IDENTITY
    of_child: Pose = IDENTITY


class PhysicsModelDelta(FrozenStruct, frozen=True, kw_only=True):
    """What is different from before, or all of it for a world that is new."""

    bodies: dict[BodyId, BodyModelDelta] = msgspec.field(default_factory=dict)
    """By id."""
    apart: tuple[tuple[BodyId, BodyId], ...] = ()
    """Pairs that do not collide from now on."""
    together: tuple[tuple[BodyId, BodyId], ...] = ()
    """Pairs that may collide again."""
    joints: dict[BodyId, JointModelDelta | None] = msgspec.field(default_factory=dict)
    """Constraints that hold, by id; None for one that does not."""
    poses: dict[BodyId, Pose] = msgspec.field(default_factory=dict)
    """Bodies that are put somewhere else, at rest: all that go there, not only the first."""


def model_delta_to_json(change: PhysicsModelDelta) -> str:
    """A change as JSON; what is left out has its default.

    Raises:
        MessageValidationError: it holds what JSON cannot, such as NaN.
    """
    return to_json(change)
