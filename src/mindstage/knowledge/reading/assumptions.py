"""Assumptions: what a map does not say and a reader had to decide, with what speaks for it."""

from __future__ import annotations

from typing import Protocol

import msgspec

from mindstage.world import Iri

__all__ = ["Assumption", "AssumptionSink"]


class Assumption(msgspec.Struct, frozen=True, rename={"topic": "about"}):
    """One decision about a whole map. If it is wrong, all that was read is wrong with it, so it is said aloud."""

    map: Iri
    topic: str
    """What had to be decided, such as "units", "frame" or "quaternion"."""
    value: str
    evidence: str
    """What speaks for it, in numbers where there are any."""
    overridden: bool = False
    """Whether the user decided it; `evidence` then says what would have been decided."""

    def __str__(self) -> str:
        how = "as told" if self.overridden else "assumed"
        return f"{self.topic}: {self.value}, {how}: {self.evidence}"


class AssumptionSink(Protocol):
    """Where assumptions go while a map is read."""

    def __call__(self, assumption: Assumption) -> None:
        """Keeps one."""
