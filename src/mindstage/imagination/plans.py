"""Plans: what is to be done in a world, how uncertain that world is, and what must hold at the end.

A plan is plain data: frozen, comparable, and serializable as JSON and YAML. Positions and directions are in the world
frame (x forward, y left, z up), lengths in meters, forces in newtons, times in simulated seconds.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec

from mindstage.access.limits import Deadline, PositiveDuration
from mindstage.ranges import ForceVector, Fraction, Point, PositiveMass, check_fields
from mindstage.scene import Mobility, Pose, as_pose
from mindstage.scene.edits import Attach, Detach

__all__ = [
    "GUESSES",
    "MAX_DEVIATION",
    "ChangePhysics",
    "Check",
    "Close",
    "GivenUncertainty",
    "Move",
    "Open",
    "Perform",
    "Place",
    "Plan",
    "PlanStep",
    "Pull",
    "Push",
    "Uncertainty",
    "Wait",
]


_DEADLINE_S = 30.0
"""Time of a plan that states no deadline, besides those of its steps [s]."""
_STEP_DEADLINE_S = 10.0
"""Time of a step that states no deadline, besides its duration [s]."""


MAX_DEVIATION = 100.0
"""Largest standard deviation [m, rad, or relative]; larger ones could only overflow."""
_Deviation: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=MAX_DEVIATION)]


GUESSES: Literal["guesses"] = "guesses"
"""As an uncertainty: that of what is guessed."""


class _Step(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", forbid_unknown_fields=True):
    deadline_s: Deadline | None = None
    """The step fails if it has not ended after this simulated time [s]; None for 10 s after its duration, if any."""

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def given_duration_s(self) -> float:
        """The simulated time that the step takes by its own definition [s]; 0 if it ends when it is done."""
        return 0.0

    @property
    def time_limit_s(self) -> float:
        """The simulated time after which the step fails [s]."""
        return self.given_duration_s + _STEP_DEADLINE_S if self.deadline_s is None else self.deadline_s


class Place(_Step, frozen=True, kw_only=True, tag="place"):
    """Puts a thing at a free place on or in another one, at which it stays; several at once where all of them fit.

    Room is left for what the next steps put there, too.
    """

    thing: str | tuple[str, ...]
    """The id of a body, which is moved there, or the name of a class, of which a new body is spawned; or several."""
    on: str | None = None
    into: str | None = None
    """The id of the holder; exactly one of `on` and `into`."""

    @property
    def things(self) -> tuple[str, ...]:
        """All that is put there."""
        return (self.thing,) if isinstance(self.thing, str) else self.thing


class Move(_Step, frozen=True, kw_only=True, tag="move"):
    """Sets the pose of a thing, at rest; what is attached to it, and what stands on it or in it, moves along."""

    thing: str
    to: Pose | list[float] | None = None
    """In the world frame; as numbers x, y, z [m], without a rotation or with w, x, y, z: see `as_pose`."""
    by: Point | None = None
    """A displacement [m] instead of a pose; exactly one of `to` and `by`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.to is not None:
            numbers = (*self.to.position, *self.to.quaternion) if isinstance(self.to, Pose) else self.to
            msgspec.structs.force_setattr(self, "to", as_pose(numbers, "to"))  # which checks the numbers


class Pull(_Step, frozen=True, kw_only=True, tag="pull"):
    """Pulls a point of a thing to a target with the force of an arm, and releases it there."""

    thing: str
    target: Point
    """Where the point is pulled to, in the world frame [m]."""
    point: Point = (0.0, 0.0, 0.0)
    """The point, in the frame of the body [m]."""


class Push(_Step, frozen=True, kw_only=True, tag="push"):
    """Applies a constant force to a thing."""

    thing: str
    force: ForceVector
    """In the world frame [N]."""
    point: Point | None = None
    """Where it acts, in the frame of the body [m]; None for the center of mass."""
    duration_s: PositiveDuration = 0.5

    @property
    def given_duration_s(self) -> float:
        """See `Wait`."""
        return self.duration_s


class Open(_Step, frozen=True, kw_only=True, tag="open"):
    """Opens a door or drawer by pulling."""

    thing: str
    """The id of the joint or of the body that it moves."""
    fraction: Fraction = 1.0


class Close(_Step, frozen=True, kw_only=True, tag="close"):
    """Closes a door or drawer by pulling."""

    thing: str


class Wait(_Step, frozen=True, kw_only=True, tag="wait"):
    """Lets time pass."""

    duration_s: PositiveDuration

    @property
    def given_duration_s(self) -> float:
        """The simulated time that the step takes [s]."""
        return self.duration_s


class ChangePhysics(_Step, frozen=True, kw_only=True, tag="set_physics"):
    """Changes physical properties of a body; those that are None remain."""

    thing: str
    mass_kg: PositiveMass | None = None
    mobility: Mobility | None = None
    gravity: bool | None = None


class Perform(_Step, frozen=True, kw_only=True, tag="perform"):
    """Lets a robot perform a skill; the step fails if the skill does, and is unknown if the skill is."""

    skill: str
    """The name of a skill, such as "pick"."""
    args: dict[str, str | float] = msgspec.field(default_factory=dict)
    """The arguments of the skill by name."""
    robot: str = ""
    """The name of the robot; empty for the only one."""
    deadline_s: Deadline | None = 300.0


# An edit is a step, too. Of these the others are part of what a step does, or are made of what has no words in a file.
PlanStep: TypeAlias = Place | Move | Pull | Push | Open | Close | Wait | Attach | Detach | ChangePhysics | Perform


class Uncertainty(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Standard deviations of normally distributed properties of one body, or of each body of a class.

    Deviations of a pose apply to where a free body is at the start, and to where a step places or moves it.
    """

    thing: str
    """The id of a body, or the name of a class."""
    position_m: float | tuple[float, float, float] = 0.0  # msgspec 0.22 crashes if these numbers have constraints
    """Along x, y, z of the world; one number is for x and y, and the height is then exact."""
    yaw_rad: _Deviation = 0.0
    """Rotation about the vertical axis."""
    mass: _Deviation = 0.0
    """Relative to the mass."""
    friction: _Deviation = 0.0
    """Relative to the coefficients of friction."""
    joint_friction: _Deviation = 0.0
    """Relative to the friction and damping of the joint that moves the body."""

    def __post_init__(self) -> None:
        check_fields(self)


GivenUncertainty: TypeAlias = tuple[Uncertainty | Literal["guesses"], ...] | Literal["guesses"]
"""What a plan gives: deviations of named things, "guesses" for those of what is guessed, or both."""


class Check(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A question that is asked at the end, and the answer with which a sample succeeds."""

    question: str
    args: dict[str, str | float | bool] = msgspec.field(default_factory=dict)
    expect: Literal["any", "none"] | dict[str, str | float | bool] = "any"
    """At least one answer, none, or one with these values in its columns."""


class Plan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Steps that are executed in order, and what must hold at the end."""

    steps: tuple[PlanStep, ...]
    name: str = ""
    uncertainty: GivenUncertainty = ()
    """Of named things; "guesses", alone or among them, is kept in `guesses`."""
    guesses: bool = False
    """Whether masses and frictions that no map states vary; see `mindstage.imagination.guesses`."""
    check: Check | None = None
    """None if it is enough that each step ends in time and that no forbidden event occurs."""
    until: Check | None = None
    """After the last step, time passes until this holds, or else until everything is at rest."""
    deadline_s: Deadline | None = None
    """The sample fails if the plan has not ended after this simulated time [s]; None for 30 s, and in addition the
    deadlines of all steps."""
    forbid: tuple[str, ...] = ("fell", "tipped", "left")
    """Kinds of events (`EventKind`) with which a sample fails. Setting a pose is no event, what follows from it is."""
    format_version: Literal[1] = 1

    def __post_init__(self) -> None:
        check_fields(self)
        given = (self.uncertainty,) if self.uncertainty == GUESSES else self.uncertainty
        if GUESSES in given:
            msgspec.structs.force_setattr(self, "guesses", True)
            msgspec.structs.force_setattr(self, "uncertainty", tuple(each for each in given if each != GUESSES))

    @property
    def stated(self) -> tuple[Uncertainty, ...]:
        """The uncertainty of named things."""
        return tuple(each for each in self.uncertainty if isinstance(each, Uncertainty))

    @property
    def time_limit_s(self) -> float:
        """The simulated time after which a sample fails [s]."""
        if self.deadline_s is not None:
            return self.deadline_s
        return _DEADLINE_S + sum(step.time_limit_s for step in self.steps if isinstance(step, _Step))
