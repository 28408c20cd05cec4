"""Engines whose steps take their time, as those of large worlds and of other processes do."""

from __future__ import annotations

import time

from mindstage.engines import NullEngine
from mindstage.engines.base import Applied, RebuildTime
from mindstage.scene.edits import Edit, SetPhysics

__all__ = ["RebuildingNullEngine", "SlowEngine", "SlowInterruptibleEngine"]


class SlowEngine(NullEngine):
    """Takes a wall time for each simulated second, in one piece."""

    def __init__(self, wall_s_per_s: float) -> None:
        super().__init__()
        self.wall_s_per_s = wall_s_per_s

    def step(self, duration_s: float) -> None:
        time.sleep(duration_s * self.wall_s_per_s)
        super().step(duration_s)


class SlowInterruptibleEngine(SlowEngine):
    """The same with time steps of 10 ms, between which a step can be interrupted."""

    def step_for(self, duration_s: float, *, wall_s: float) -> float:
        end_s, left_s = time.monotonic() + wall_s, duration_s
        while left_s > 1e-9:
            self.step(min(left_s, 0.01))
            left_s -= 0.01
            if time.monotonic() >= end_s:
                break
        return max(0.0, left_s)


class RebuildingNullEngine(NullEngine):
    """Rebuilds a model for a time, or until a test ends it, after the physics of a body was set."""

    def __init__(self, rebuild_s: float) -> None:
        super().__init__()
        self.rebuild_s = rebuild_s
        self.rebuild_pending = False
        self.last_rebuild: RebuildTime | None = None

    @property
    def expected_rebuild_s(self) -> float:
        return self.rebuild_s if self.rebuild_pending else 0.0

    def apply(self, edit: Edit) -> Applied:
        applied = super().apply(edit)
        self.rebuild_pending |= isinstance(edit, SetPhysics)
        return applied

    def rebuild(self) -> None:
        if self.rebuild_pending:
            self.last_rebuild = RebuildTime(began_s=time.monotonic())
            time.sleep(self.rebuild_s)
            self.last_rebuild = RebuildTime(began_s=self.last_rebuild.began_s, ended_s=time.monotonic())
            self.rebuild_pending = False

    def step(self, duration_s: float) -> None:
        self.rebuild()
        super().step(duration_s)
