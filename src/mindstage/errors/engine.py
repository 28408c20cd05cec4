"""Errors of engines and of the stage that owns one."""

from __future__ import annotations

from mindstage.errors.hints import also
from mindstage.errors.root import MindstageError

__all__ = [
    "EngineClosed",
    "EngineError",
    "EngineTimedOut",
    "EngineUnable",
    "EngineUnavailable",
    "SimulationUnstable",
    "StageError",
    "StageTimedOut",
]


class EngineError(MindstageError):
    """The reason lies in the engine, not in the world it runs."""


class EngineUnavailable(EngineError):
    """The engine is not installed or does not answer."""

    def __init__(self, engine: str, *, cause: str, remedy: str = "") -> None:
        self.engine = engine
        self.cause = cause
        self.remedy = remedy
        super().__init__(engine)

    def __str__(self) -> str:
        return f"the engine {self.engine!r} is not available: {self.cause}{also(self.remedy)}"


class EngineTimedOut(EngineError):
    """The engine did not answer in time; whether it did what was asked, nobody knows."""

    def __init__(self, engine: str, *, call: str, timeout_s: float) -> None:
        self.engine = engine
        self.call = call
        self.timeout_s = timeout_s
        super().__init__(engine)

    def __str__(self) -> str:
        waited = f"the engine {self.engine!r} did not answer {self.call} within {self.timeout_s:g} s"
        return f"{waited}; it may have done it all the same: look at its poses, or give it more time"


class EngineUnable(EngineError):
    """The engine has no means to do it, however the world stands."""

    def __init__(self, engine: str, *, what: str, remedy: str = "") -> None:
        self.engine = engine
        self.what = what
        self.remedy = remedy
        super().__init__(engine)

    def __str__(self) -> str:
        return f"the engine {self.engine!r} cannot {self.what}{also(self.remedy)}"


class EngineClosed(EngineError):
    """A call came after `close`."""

    def __init__(self, engine: str) -> None:
        self.engine = engine
        super().__init__(engine)

    def __str__(self) -> str:
        return f"the engine {self.engine!r} is closed; make a new one"


class SimulationUnstable(EngineError):
    """The physics diverged: positions, velocities or accelerations stopped being numbers."""

    def __init__(self, *, time_s: float, what: str) -> None:
        self.time_s = time_s
        self.what = what
        super().__init__(what)

    def __str__(self) -> str:
        return f"the simulation became unstable at {self.time_s:.3f} s: {self.what}"


class StageError(MindstageError):
    """The stage could not take the call."""


class StageTimedOut(StageError):
    """The thread that owns the engine did not finish the call in time."""

    def __init__(self, call: str, *, timeout_s: float) -> None:
        self.call = call
        self.timeout_s = timeout_s
        super().__init__(call)

    def __str__(self) -> str:
        return f"{self.call} did not finish within {self.timeout_s:g} s; the stage may be busy or stopped"
