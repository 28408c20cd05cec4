"""The result of one execution of a plan in an imagined world: a sample, its events and its end poses."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from mindstage.robots.skill_declaration import SkillResult
from mindstage.scene import BodyId, Pose

__all__ = ["EventKind", "ImaginedEvent", "Outcome", "SampleResult"]


class Outcome(StrEnum):
    """How a sample, or all samples together, ended."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    UNKNOWN = "unknown"
    """It is not known how it ended: a worker was lost, the budget was used up, or the engine failed."""


class EventKind(StrEnum):
    """What can happen to a thing while a plan is executed."""

    FELL = "fell"
    TIPPED = "tipped"
    COLLIDED = "collided"
    """A thing that a step moves touched something that it did not touch before, or began inside of it."""
    CORRECTED = "corrected"
    """A thing that began inside of something was pushed out of it by the physics: it is not where it was set."""
    MOVED = "moved"
    """A thing was pushed away by one that began inside of it."""
    JAMMED = "jammed"
    """A door, drawer or pulled thing did not arrive."""
    LEFT = "left"
    """A thing left the place."""
    FAST = "fast"
    """A thing hit something so fast that it may have passed through it: what follows may be wrong."""
    LATE = "late"
    """A step or the plan did not end before its deadline."""
    REFUSED = "refused"
    """The world does not allow a step, such as placing a thing where no place is free."""
    SKILL = "skill"
    """A robot failed to perform a skill, or it is not known whether it did."""
    CHECK = "check"
    """The question at the end had another answer."""
    LOST = "lost"
    """The sample did not end: its worker was lost, the budget was used up, or the engine failed."""


class ImaginedEvent(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened in a sample."""

    kind: EventKind
    text: str
    """In words, such as "milk_1 fell by 0.72 m from table_1"."""
    time_s: float = 0.0
    """Simulated time since the start of the sample [s]."""
    thing: BodyId | None = None
    other: BodyId | None = None
    """What it fell from, collided with or is blocked by."""
    step: int | None = None
    """Index of the step during which it happened; None after the last one."""
    amount: float | None = None
    """How far it fell or was pushed [m], how deep it began in another one [m], by how much it tipped [rad], or how open
    an articulated part was (0 to 1)."""


class SampleResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one sample."""

    index: int
    """The number of the sample; with the seed it determines its random numbers."""
    outcome: Outcome
    events: tuple[ImaginedEvent, ...] = ()
    """In the order of time. The first one of a failed sample that the plan forbids is `cause`."""
    cause: ImaginedEvent | None = None
    """Why it failed or is unknown; None if it succeeded."""
    duration_s: float = 0.0
    """Simulated time [s]."""
    end_poses: dict[str, Pose] = msgspec.field(default_factory=dict)
    """Poses at the end of the bodies that the plan names, that are uncertain, or that moved by more than 1 cm."""
    is_interrupted: bool = False
    """Whether it was ended by the deadline or by who asked for it."""
    began_in_collision: bool = False
    """Whether a thing was inside of another one at the start, or where a step has set it."""
    answers: tuple[dict[str, object], ...] = ()
    """The answers to the plan's check, as rows."""
    skills: tuple[SkillResult, ...] = ()
    """The results of the skills that robots have performed, in their order."""
