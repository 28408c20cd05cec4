"""Frame: what everybody sees of a stage, at one moment."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mindstage.engines.contract import EngineStats, PoseArray
from mindstage.stage.lights import HighlightGroup
from mindstage.stage.markers import Marker
from mindstage.world import BodyId, Color

__all__ = ["StateSnapshot"]


class StateSnapshot(msgspec.Struct, frozen=True, eq=False):
    """The world at one moment; a new one replaces it, this one never changes."""

    time_s: float
    ids: tuple[BodyId, ...]
    poses: PoseArray
    """n x 7, in the order of `ids`."""
    highlights: Mapping[BodyId, Color]
    highlight_groups: tuple[HighlightGroup, ...]
    """The same bodies in groups, with the reason why each is lit; the latest last."""
    markers: tuple[Marker, ...]
    """What programs want to be seen beside the bodies; the same object until it changes."""
    revision: int
    """Counts up when bodies, materials or lights came, went or changed, not when they moved."""
    playing: bool
    speed: float
    real_time_factor: float
    stats: EngineStats | None = None
    """How busy the engine is; None where it cannot say."""
    error: str = ""
    """Why the world stands still although nobody paused it."""
