"""Frame: what everybody sees of a stage, at one moment."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mindstage.engines.contract import Poses, Statistics
from mindstage.stage.lights import Lit
from mindstage.stage.markers import Marker
from mindstage.world import BodyId, Colour

__all__ = ["Frame"]


class Frame(msgspec.Struct, frozen=True, eq=False):
    """The world at one moment; a new one replaces it, this one never changes."""

    time_s: float
    ids: tuple[BodyId, ...]
    poses: Poses
    """n x 7, in the order of `ids`."""
    highlights: Mapping[BodyId, Colour]
    lit: tuple[Lit, ...]
    """The same bodies in groups, with the reason why each is lit; the latest last."""
    markers: tuple[Marker, ...]
    """What programs want to be seen beside the bodies; the same object until it changes."""
    edition: int
    """Counts up when bodies, materials or lights came, went or changed, not when they moved."""
    playing: bool
    speed: float
    real_time_factor: float
    statistics: Statistics | None = None
    """How busy the engine is; None where it cannot say."""
    fault: str = ""
    """Why the world stands still although nobody paused it."""
